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
    """All matrices and what is known of the error, by the names of the reduced file.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> arrays(rom)["K"].shape == (rom.order, rom.order)
    True
    """
    system, claim, basis = model.system, model.claim, model.basis
    matrices = ("M", "D", "K", "S", "B", "C", "C_rate", "feedthrough", "eta", "output_eta")
    result: dict[str, Any] = {name: getattr(system, name) for name in matrices}
    for k, term in enumerate(system.terms, 1):
        result |= {f"term_{k}": term.matrix, f"term_{k}_name": term.name}
        result |= {f"term_{k}_law": term.law.kind}
        result |= {f"term_{k}_{name}": values for name, values in term.law.numbers().items()}
    result |= {name: getattr(claim, name) for name in ("omega", "error", "bound", "band")}
    result |= {"V": basis.V, "sigma": model.sigma, "modes": model.modes}
    result["inputs"], result["outputs"] = np.array(model.inputs), np.array(model.outputs)
    result["kind"] = claim.kind
    if len(basis.position):
        places = {"node": basis.node, "component": basis.component, "position": basis.position}
        result |= places
    return result | {f"frame_{key}": value for key, value in model.frame.items()}


def write_npz(model: ReducedBody, path: Path) -> None:
    """NumPy archive of ``arrays``.

    Examples
    --------
    >>> write_npz(flexgram.ReducedModel.load("rack.rom.h5"), Path("rack.npz"))
    >>> "K" in np.load("rack.npz")
    True
    """
    with written_aside(path) as place, place.open("wb") as file:
        np.savez(file, **arrays(model))


def write_mat(model: ReducedBody, path: Path, *inputs: str | Path | None) -> None:
    """MATLAB file (version 5) of ``arrays``; names of ports become cell arrays. It replaces none of
    ``inputs``.

    Examples
    --------
    >>> write_mat(flexgram.ReducedModel.load("rack.rom.h5"), Path("arrays.mat"))
    """
    values = arrays(model)
    for name in ("inputs", "outputs"):
        values[name] = np.array(values[name], dtype=object)
    with written_aside(path, *inputs) as place:
        scipy.io.savemat(place, values, do_compression=False, oned_as="column", appendmat=False)


def write_state_space(
    model: ReducedBody, path: Path, rates: Sequence[str] = ("displacement",)
) -> None:
    """A, B, C, D of x' = A x + B u, y = C x + D u, x = [q, q', internal states], as ``.mat`` or
    ``.npz``, with the names of ``inputs`` and ``outputs``; ``rates`` as of
    ``ReducedBody.state_space``.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> write_state_space(rom, Path("rack_ss.npz"), rates=("displacement", "velocity"))
    >>> np.load("rack_ss.npz")["C"].shape == (2 * len(rom.outputs), 2 * rom.order)
    True
    """
    values: dict[str, Any] = dict(zip("ABCD", model.system.state_space(rates), strict=True))
    kind = object if path.suffix == ".mat" else None  # a cell array
    values["inputs"] = np.array(model.inputs, dtype=kind)
    values["outputs"] = np.array(model.system.names_of(rates), dtype=kind)
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

    Examples
    --------
    >>> to_pymor(flexgram.ReducedModel.load("rack.rom.h5")).dim_input
    12
    """
    try:
        from pymor.models.iosys import SecondOrderModel
    except ImportError:
        raise BodyError("pyMOR is not installed: pip install pymor") from None
    system = model.system
    system.expect_time_domain(rates)
    if system.loss:
        raise BodyError(
            f"pyMOR's second-order models have no place for relaxation ({system.loss}): take the "
            "state space (--to state-space), or equivalent_damping"
        )
    if "acceleration" in rates:
        raise BodyError("outputs of pyMOR's second-order models are displacements and velocities")
    zero = np.zeros_like(system.C)
    place = np.vstack([system.C if rate == "displacement" else zero for rate in rates])
    speed = np.vstack([system.C if rate == "velocity" else system.C_rate for rate in rates])
    direct = np.vstack([system.feedthrough] * len(rates)) if system.feedthrough.any() else None
    return SecondOrderModel.from_matrices(
        system.M, system.D, system.K, system.B, place, Cv=speed if speed.any() else None, D=direct
    )
