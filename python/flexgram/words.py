"""What is said of a reduced body: in a line, and as a table for notebooks."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexgram.reduced import ReducedModel


def label_of(model: ReducedModel) -> str:
    """What is claimed of the error, in words."""
    count = len(model.load_names)
    few = f", of the motion along {count} load{'s' if count != 1 else ''} in answer to them"
    return _label_of_band(model) + (few if count else "")


def _label_of_band(model: ReducedModel) -> str:
    if model.kind != "certified outside":
        return "certified" if model.kind == "certified" else "estimated, not proved"
    widest = np.max(np.diff(model.excluded, axis=1)[:, 0] / model.excluded[:, 1])
    count = len(model.excluded)
    words = (f"certified outside {count} interval{'s' if count != 1 else ''} of relative width "
             f"{widest:.0e} at most, around undamped resonances")  # fmt: skip
    if len(model.excluded_poles):
        _, frequency, residue = model.excluded_poles.max(axis=0)
        words += f", whose frequencies are right to {frequency:.0e} and residues to {residue:.0e}"
    return words


def error_of(model: ReducedModel) -> str:
    """The error and what it is worth."""
    if not np.isfinite(model.certified_error):
        return "no bound of the error"
    return f"error {model.certified_error:.1e} ({label_of(model)})"


def table_of(model: ReducedModel) -> str:
    """HTML of order, method, band, error, and inputs."""
    rows = {
        "order": f"{model.order} of {len(model.V):,}" if len(model.V) else str(model.order),
        "method": f"{model.method} ({model.second_stage})" if model.second_stage else model.method,
        "band": ", ".join(f"{a:g} to {b:g} Hz" for a, b in model.bands / (2 * np.pi)),
        "error": error_of(model),
        "inputs": ", ".join(model.inputs),
    }
    lines = (f"<tr><th>{key}</th><td style='text-align:left'>{html.escape(value)}</td></tr>"
             for key, value in rows.items())  # fmt: skip
    return f"<table>{''.join(lines)}</table>"
