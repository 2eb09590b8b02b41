"""Matrices for MATLAB, NumPy, pyMOR and control tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from flexgram.basics import BodyError, written_aside
from flexgram.reduced import ReducedModel


def arrays(model: ReducedModel) -> dict[str, Any]:
    """All matrices and what is known of the error, by the names of the reduced file."""
    result = {name: getattr(model, name)
              for name in ("M", "D", "K", "B", "C", "V", "feedthrough", "omega", "error", "bound",
                           "sigma", "modes", "band")}  # fmt: skip
    result["eta"] = model.eta
    result["inputs"], result["outputs"] = np.array(model.inputs), np.array(model.outputs)
    result["kind"] = model.kind
    if len(model.position):
        result |= {"node": model.node, "component": model.component, "position": model.position}
    return result | {f"frame_{key}": value for key, value in model.frame.items()}


def write_npz(model: ReducedModel, path: Path) -> None:
    """NumPy archive of ``arrays``."""
    with written_aside(path) as place, place.open("wb") as file:
        np.savez(file, **arrays(model))


def write_mat(model: ReducedModel, path: Path) -> None:
    """MATLAB file (version 5) of ``arrays``; names of ports become cell arrays."""
    values = arrays(model)
    for name in ("inputs", "outputs"):
        values[name] = np.array(values[name], dtype=object)
    with written_aside(path) as place:
        scipy.io.savemat(place, values, do_compression=False, oned_as="column", appendmat=False)


def write_state_space(model: ReducedModel, path: Path) -> None:
    """A, B, C, D of x' = A x + B u, y = C x, x = [q, q'], as ``.mat`` or ``.npz``."""
    values = dict(zip("ABCD", model.state_space(), strict=True))
    with written_aside(path) as place, place.open("wb") as file:
        if path.suffix == ".mat":
            scipy.io.savemat(file, values)
        else:
            np.savez(file, **values)


def to_pymor(model: ReducedModel) -> Any:
    """pyMOR's ``SecondOrderModel`` of the reduced body.

    Raises
    ------
    BodyError
        Without pyMOR, or with structural damping, which it has no place for.
    """
    try:
        from pymor.models.iosys import SecondOrderModel
    except ImportError:
        raise BodyError("pyMOR is not installed: pip install pymor") from None
    if model.eta:
        raise BodyError("pyMOR's second-order models have no structural damping (eta)")
    direct = model.feedthrough if model.feedthrough.any() else None
    return SecondOrderModel.from_matrices(model.M, model.D, model.K, model.B, model.C, D=direct)
