"""Stress of a reduced body, recovered from its mesh."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats
from flexgram.body.stress import Stresses, principal, signed_von_mises
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


class Peak(NamedTuple):
    """An extreme stress at a node over a motion."""

    value: float  #: [N/m²]
    when: int  #: the row of the motion
    where: int  #: the node of the mesh, from 0


class StressPeaks(NamedTuple):
    """Extremes of the stress at all nodes over a motion: of the von Mises stress, and the largest
    and the least with the sign of the principal stress that dominates."""

    von_mises: Peak
    tension: Peak
    pressure: Peak


def stress_peaks(
    model: ReducedBody, q: Floats, u: Floats, body: str | Path | None = None
) -> StressPeaks:
    """Extremes of the stress over a motion (n, m) under loads (n, n_in); as ``stress_at_nodes``.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> q = np.outer([0.0, 1.0, -2.0], np.ones(rom.order))
    >>> peaks = stress_peaks(rom, q, np.zeros((3, len(rom.inputs))))
    >>> peaks.von_mises.when, peaks.von_mises.value >= peaks.tension.value > 0
    (2, True)
    """
    found = [Peak(-np.inf, 0, 0)] * 3
    for k, (state, load) in enumerate(zip(q, u, strict=True)):  # one at a time: a field is large
        field = np.nan_to_num(signed_von_mises(stress_at_nodes(model, state, body, load)[0]))
        for i, sized in enumerate((np.abs(field), field, -field)):
            at = int(sized.argmax())
            if sized[at] > found[i].value:
                found[i] = Peak(float(sized[at]), k, at)
    return StressPeaks(found[0], found[1], found[2]._replace(value=-found[2].value))


def words_of_stress(
    model: ReducedBody, t: Floats, peaks: StressPeaks, body: str | Path | None = None
) -> str:
    """What ``stress_peaks`` found, at times t."""
    points = Geometry.load(body_of(model, body)).points

    def said(peak: Peak) -> str:
        place = ", ".join(f"{x:.4g}" for x in points[peak.where])
        return (
            f"{peak.value:.4g} N/m² at ({place}) m, node {peak.where + 1}, t = {t[peak.when]:.6g} s"
        )

    return (
        f"largest von Mises stress {said(peaks.von_mises)}; with the sign of the dominant "
        f"principal stress from {said(peaks.pressure)} to {said(peaks.tension)}"
    )
