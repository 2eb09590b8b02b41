"""Stress of a reduced body, recovered from its mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats
from flexgram.body.stress import Stresses, principal, von_mises
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.reduced import ReducedBody


def principal_stress_at_nodes(
    model: ReducedBody,
    q: ArrayLike | None = None,
    body: str | Path | None = None,
    u: ArrayLike | None = None,
) -> Floats:
    """Principal stresses at the nodes, (k, N, 3) [N/m²], descending; as ``stress_at_nodes``.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> principal_stress_at_nodes(rom).shape[::2] == (rom.order, 3)
    True
    """
    return principal(stress_at_nodes(model, q, body, u))


def stress_at_nodes(
    model: ReducedBody,
    q: ArrayLike | None = None,
    body: str | Path | None = None,
    u: ArrayLike | None = None,
) -> Floats:
    """Stress at the nodes of a body that flexgram assembled, (k, N, 6) [N/m²].

    Of the elements' own strain, averaged at nodes (``flexgram.body.stress``): xx, yy, zz, xy, yz,
    zx; NaN at nodes of no deforming solid. Nothing is claimed of it but of ``outputs`` of the
    type stress; their values are these.

    Parameters
    ----------
    q : (k, m) array, optional
        Generalised coordinates; default: each basis vector.
    body : str or Path, optional
        Body file; default: the one that was reduced, if it is there.
    u : (k, n_in) array, optional
        Inputs at the same moments: needed if one of them is a temperature.

    Raises
    ------
    BodyError
        Without that file, or if it holds matrices; without ``u`` where heat strains the body.
    """
    path = Path(body_of(model, body)).resolve()
    known = (path, path.stat().st_mtime_ns, path.stat().st_size) if path.exists() else None
    if model.recovered is None or model.recovered[0] != known:
        motion = Geometry.load(path).motion(model)
        stresses = Stresses.load(path)
        held = stresses.of_temperatures(path, model.inputs)
        model.recovered = (known, stresses.nodal(motion), held)
    _, basis, held = model.recovered
    if q is None:
        return basis.copy()
    states = np.atleast_2d(np.asarray(q))
    if np.iscomplexobj(states) or states.shape[1] != model.order:
        raise BodyError(
            f"stress: q is {' × '.join(map(str, states.shape))} of "
            f"{states.dtype}, expected real rows of {model.order} coordinates"
        )
    stress: Floats = np.tensordot(states.astype(float), basis, axes=1)
    if held:
        if u is None:
            raise BodyError(
                f"stress: {', '.join(held)} strains the body: give the inputs u of these moments"
            )
        loads = np.atleast_2d(np.asarray(u, dtype=float))
        if loads.shape != (len(states), len(model.inputs)):
            raise BodyError(
                f"stress: u is {' × '.join(map(str, loads.shape))}, expected "
                f"{len(states)} × {len(model.inputs)} inputs"
            )
        for name, field in held.items():
            stress += loads[:, model.inputs.index(name), None, None] * field
    return stress


def largest_stress(
    model: ReducedBody, q: Floats, u: Floats, body: str | Path | None = None
) -> tuple[float, int, int]:
    """The largest von Mises stress at a node over a motion (n, m) under loads (n, n_in): its value,
    when (a row of q) and where (a node of the mesh)."""
    largest, when, where = -1.0, 0, 0
    for k, (state, load) in enumerate(zip(q, u, strict=True)):  # one at a time: a field is large
        field = np.nan_to_num(von_mises(stress_at_nodes(model, state, body, load)[0]))
        if field.max() > largest:
            largest, when, where = float(field.max()), k, int(field.argmax())
    return largest, when, where


def words_of_stress(
    model: ReducedBody, t: Floats, worst: tuple[float, int, int], body: str | Path | None = None
) -> str:
    """What ``largest_stress`` found, at times t."""
    largest, when, where = worst
    place = ", ".join(f"{x:.4g}" for x in Geometry.load(body_of(model, body)).points[where])
    return (
        f"largest von Mises stress {largest:.4g} N/m² at ({place}) m, node {where + 1}, "
        f"t = {t[when]:.6g} s"
    )
