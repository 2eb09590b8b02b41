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


def shortfall_of(model: ReducedModel) -> str:
    """Which tolerance is not met, and where; empty if it is met."""
    if model.met or model.tolerance is None:
        return ""
    said = f"NOT within the tolerance {model.tolerance:g} that was asked for"
    hz = model.unmet / (2 * np.pi)
    bands = np.diff(model.bands / (2 * np.pi), axis=1).sum()
    if not len(hz) or np.diff(hz, axis=1).sum() > 0.999 * bands:
        return said
    widest = hz[np.argsort(hz[:, 0] - hz[:, 1], kind="stable")][:3]
    places = [f"from {a:.5g} to {b:.5g} Hz" if b - a > 0.1 * b else f"near {(a + b) / 2:.6g} Hz"
              for a, b in widest]  # fmt: skip
    more = f" and in {len(hz) - 3} smaller intervals" if len(hz) > 3 else ""
    return f"{said}: {', '.join(places)}{more}; elsewhere it is"


def data_rounding_of(model: ReducedModel) -> str:
    """What the digits of K themselves may change; empty if K was not printed."""
    worst = float(model.data_rounding.max(initial=0))
    if not worst > 0:
        return ""
    return (f"the digits in which the FE code wrote K may change H by {worst:.1e} (an estimate, of "
            "the full body: not part of the error)")  # fmt: skip


def held_of(model: ReducedModel) -> list[str]:
    """Frequencies and static compliance with each interface held, a line for each."""
    lines = []
    for name, held in model.held.items():
        hz = held.omega / (2 * np.pi)
        more = ", …" if len(hz) > 6 else ""
        said = "no frequency in the band"
        if len(hz):
            said = ", ".join(f"{full:.5g}" for _, full in hz[:6]) + f"{more} Hz "
            if held.frequency_error < 0.05:
                said += f"within {held.frequency_error:.1e}"
            else:
                said += (
                    "of the body come out as "
                    + ", ".join(f"{own:.5g}" if np.isfinite(own) else "none" for own, _ in hz[:6])
                    + more
                )
        if np.isfinite(held.compliance):
            said += f", static compliance within {held.compliance:.1e} ({held.port})"
        lines.append(f"held at {name}: {said}")
    return lines


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
