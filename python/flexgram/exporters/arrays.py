"""Matrices for MATLAB, NumPy, pyMOR and control tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from flexgram.basics import BodyError, written_aside
from flexgram.model.reduced import ReducedBody


def arrays(model: ReducedBody) -> dict[str, Any]:
    """All matrices and what is known of the error, by the names of the reduced file."""
    result = {name: getattr(model, name)
              for name in ("M", "D", "K", "B", "C", "V", "feedthrough", "omega", "error", "bound",
                           "sigma", "modes", "band")}  # fmt: skip
    result["eta"] = model.eta
    result["inputs"], result["outputs"] = np.array(model.inputs), np.array(model.outputs)
    result["kind"] = model.claim.kind
    if len(model.position):
        result |= {"node": model.node, "component": model.component, "position": model.position}
    return result | {f"frame_{key}": value for key, value in model.frame.items()}


def write_npz(model: ReducedBody, path: Path) -> None:
    """NumPy archive of ``arrays``."""
    with written_aside(path) as place, place.open("wb") as file:
        np.savez(file, **arrays(model))


def write_mat(model: ReducedBody, path: Path, *inputs: str | Path | None) -> None:
    """MATLAB file (version 5) of ``arrays``; names of ports become cell arrays. It replaces none of
    ``inputs``."""
    values = arrays(model)
    for name in ("inputs", "outputs"):
        values[name] = np.array(values[name], dtype=object)
    with written_aside(path, *inputs) as place:
        scipy.io.savemat(place, values, do_compression=False, oned_as="column", appendmat=False)


def write_state_space(
    model: ReducedBody, path: Path, rates: Sequence[str] = ("displacement",)
) -> None:
    """A, B, C, D of x' = A x + B u, y = C x + D u, x = [q, q'], as ``.mat`` or ``.npz``, with the
    names of ``inputs`` and ``outputs``; ``rates`` as of ``ReducedBody.state_space``."""
    values: dict[str, Any] = dict(zip("ABCD", model.state_space(rates), strict=True))
    kind = object if path.suffix == ".mat" else None  # a cell array
    values["inputs"] = np.array(model.inputs, dtype=kind)
    values["outputs"] = np.array(model.names_of(rates), dtype=kind)
    with written_aside(path) as place, place.open("wb") as file:
        if path.suffix == ".mat":
            scipy.io.savemat(file, values)
        else:
            np.savez(file, **values)


def to_pymor(model: ReducedBody, rates: Sequence[str] = ("displacement",)) -> Any:
    """pyMOR's ``SecondOrderModel`` of the reduced body.

    Parameters
    ----------
    model : ReducedBody
    rates : sequence of str
        Of ``displacement`` and ``velocity``: what its outputs are, one after the other.

    Raises
    ------
    BodyError
        Without pyMOR, or with structural damping, which it has no place for, as it has none for
        accelerations.
    """
    try:
        from pymor.models.iosys import SecondOrderModel
    except ImportError:
        raise BodyError("pyMOR is not installed: pip install pymor") from None
    model.expect_time_domain(rates)
    if "acceleration" in rates:
        raise BodyError("outputs of pyMOR's second-order models are displacements and velocities")
    zero = np.zeros_like(model.C)
    place = np.vstack([model.C if rate == "displacement" else zero for rate in rates])
    speed = np.vstack([model.C if rate == "velocity" else zero for rate in rates])
    direct = np.vstack([model.feedthrough] * len(rates)) if model.feedthrough.any() else None
    return SecondOrderModel.from_matrices(model.M, model.D, model.K, model.B, place,
                                          Cv=speed if speed.any() else None, D=direct)  # fmt: skip
