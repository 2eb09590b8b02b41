"""Stress of a reduced body, recovered from its mesh: of solids, and of shells on their sides."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats, Ints, errors_of
from flexgram.body.meshfile import SHELLS, SOLIDS
from flexgram.body.shell_field import ShellField
from flexgram.body.shell_stress import SIDES
from flexgram.body.strain import deforming, rigid_interfaces
from flexgram.body.stress import Stresses, principal, signed_von_mises, temperatures, von_mises
from flexgram.model.geometry import Geometry, body_of, length_unit
from flexgram.model.reduced import ReducedBody


@dataclass
class StressField:
    """Stress of each basis vector at places of nodes: of solids, or of shells on a side, which have
    several at a node where they meet at an angle or are of different sections.

    Attributes
    ----------
    basis : (m, P, 6) array
        [N/m²]
    nodes : (P,) int array
    count : int
        Of all nodes of the body.
    held : dict
        What inputs that are temperatures add at once, (P, 6) for a unit of each.
    side : str
        Of shells; empty: of solids.
    shells : ShellField or None
    """

    basis: Floats
    nodes: Ints
    count: int
    held: dict[str, Floats]
    side: str = ""
    shells: ShellField | None = None

    def elements(self, at: int) -> tuple[int, ...]:
        """Numbers of the shells at a place, where others meet them."""
        if self.shells is None or self.shells.alone[at]:
            return ()
        return tuple(self.shells.elements(at).tolist())

    def of(self, states: Floats | None, loads: Floats | None, inputs: list[str]) -> Floats:
        """Stress (k, P, 6) for coordinates (k, m) and inputs (k, n_in)."""
        if states is None:
            return self.basis
        stress: Floats = np.tensordot(states, self.basis, axes=1)
        for name, field in self.held.items():
            assert loads is not None
            stress += loads[:, inputs.index(name), None, None] * field
        return stress


def deforming_kinds(path: Path) -> set[str]:
    """Types of elements that deform."""
    with errors_of(path), h5py.File(path) as file:
        if "mesh" not in file:
            return set()
        follows = rigid_interfaces(file)
        blocks = file["mesh/blocks"].values()
        return {
            str(block.attrs["type"])
            for block in blocks
            if deforming(block["connectivity"][:], follows).any()
        }


def has_stress(model: ReducedBody, body: str | Path | None = None) -> bool:
    """Whether its body file is there, and holds solids or shells."""
    try:
        return bool(deforming_kinds(Path(body_of(model, body))) & {*SOLIDS, *SHELLS})
    except BodyError:
        return False


def sides_of(model: ReducedBody, body: str | Path | None = None) -> list[str]:
    """Of a body with stress: ``""`` for solids, ``top`` and ``bottom`` for shells.

    Raises
    ------
    BodyError
        If the body file is missing.
    """
    kinds = deforming_kinds(Path(body_of(model, body)))
    sides = ["top", "bottom"] if kinds & set(SHELLS) else []
    return ["", *sides] if kinds & set(SOLIDS) or not sides else sides


def stress_fields(model: ReducedBody, body: str | Path | None = None) -> list[StressField]:
    """Of the body's solids, and of the top and the bottom of its shells.

    Raises
    ------
    BodyError
        If there are neither, or the body file is missing.
    """
    return [stress_field(model, body, side) for side in sides_of(model, body)]


def stress_field(model: ReducedBody, body: str | Path | None = None, side: str = "") -> StressField:
    """That of solids, or of shells on a side; kept in ``model`` until the body file changes.

    Raises
    ------
    BodyError
        If there are none, or the body file is missing.
    """
    path = Path(body_of(model, body)).resolve()
    known = (path, path.stat().st_mtime_ns, path.stat().st_size) if path.exists() else None
    if model.recovered is None or model.recovered[0] != known:
        model.recovered = (known, {})
    found: dict[str, Any] = model.recovered[1]
    if side not in found:
        found[side] = _of_shells(model, path, side) if side else _of_solids(model, path)
    field: StressField = found[side]
    return field


def _of_solids(model: ReducedBody, path: Path) -> StressField:
    if path.exists() and not (kinds := deforming_kinds(path)) & set(SOLIDS) and kinds & set(SHELLS):
        raise BodyError("stress: name the side of the shells: top, middle or bottom")
    motion = Geometry.load(path).motion(model)
    stresses = Stresses.load(path)
    basis = stresses.nodal(motion)
    nodes = np.flatnonzero(np.isfinite(basis).all(axis=(0, 2)))
    held = stresses.of_temperatures(path, model.inputs)
    held = {name: of[nodes] for name, of in held.items()}
    return StressField(basis[:, nodes], nodes, basis.shape[1], held)


def _of_shells(model: ReducedBody, path: Path, side: str) -> StressField:
    if side not in SIDES:
        raise BodyError(f"side {side!r}: there are {', '.join(SIDES)}")
    with errors_of(path), h5py.File(path) as file:
        if "mesh" not in file:
            raise BodyError("only bodies that flexgram assembles from a mesh have stresses")
        shells, heats = ShellField.of(file), temperatures(file)
    if not shells.sheets:
        raise BodyError(f"{path}: side is one of a shell; the body has none that deforms")
    motion = Geometry.load(path).motion_and_rotation(model)
    held = {name: shells.heated(heats[name], side) for name in model.inputs if name in heats}
    basis = shells.stress(motion, side)
    return StressField(basis, shells.nodes, motion.shape[1], held, side, shells)


def _at_nodes(count: int, places: Ints, stress: Floats, is_basis: bool) -> Floats:
    """Stress (k, P, 6) at places as one (k, N, 6) at nodes: of several that of the largest von
    Mises stress, of a basis that of the same shells for all vectors; NaN where there is none."""
    found: Floats = np.full((len(stress), count, 6), np.nan)
    _, at = np.unique(places, return_index=True)
    first = np.zeros(len(places), dtype=bool)
    first[at] = True
    found[:, places[first]] = stress[:, first]
    further = np.flatnonzero(~first)
    if is_basis or not len(further):
        return found
    largest = np.full((len(stress), count), -1.0)
    largest[:, places[first]] = von_mises(stress[:, first])
    of_further = von_mises(stress[:, further])
    for column, place in enumerate(further.tolist()):
        node = places[place]
        larger = np.flatnonzero(of_further[:, column] > largest[:, node])
        found[larger, node] = stress[larger, place]
        largest[larger, node] = of_further[larger, column]
    return found


def principal_stress_at_nodes(
    model: ReducedBody,
    q: ArrayLike | None = None,
    body: str | Path | None = None,
    u: ArrayLike | None = None,
    side: str = "",
) -> Floats:
    """Principal stresses at the nodes, (k, N, 3) [N/m²], descending; as ``stress_at_nodes``.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> principal_stress_at_nodes(rom).shape[::2] == (rom.order, 3)
    True
    """
    return principal(stress_at_nodes(model, q, body, u, side))


def stress_at_nodes(
    model: ReducedBody,
    q: ArrayLike | None = None,
    body: str | Path | None = None,
    u: ArrayLike | None = None,
    side: str = "",
) -> Floats:
    """Stress at the nodes of a body that flexgram assembled, (k, N, 6) [N/m²].

    Of the elements' own strain, averaged at nodes (``flexgram.body.stress``): xx, yy, zz, xy, yz,
    zx; NaN at nodes of no deforming solid, or shell. Nothing is claimed of it but of ``outputs`` of
    the type stress; their values are these.

    Parameters
    ----------
    q : (k, m) array, optional
        Generalised coordinates; default: each basis vector.
    body : str or Path, optional
        Body file; default: the one that was reduced, if it is there.
    u : (k, n_in) array, optional
        Inputs at the same moments: needed if one of them is a temperature.
    side : str
        That of shells: ``top``, ``middle`` or ``bottom``. Where shells of different sections meet,
        or meet at an angle, a node has the stress of those with the largest von Mises stress.
        Default: solids. ``larger``: of solids, and of shells that of their top or bottom.

    Raises
    ------
    BodyError
        Without that file, or if it holds matrices; without ``u`` where heat strains the body;
        without ``side`` where there are shells alone.
    """
    larger = side == "larger"
    fields = stress_fields(model, body) if larger else [stress_field(model, body, side)]
    states, loads = _states(model, q, u, [name for field in fields for name in field.held])
    of_all = [field.of(states, loads, model.inputs) for field in fields]
    places = np.concatenate([field.nodes for field in fields])
    return _at_nodes(fields[0].count, places, np.concatenate(of_all, axis=1), q is None)


def _states(
    model: ReducedBody, q: ArrayLike | None, u: ArrayLike | None, held: list[str]
) -> tuple[Floats | None, Floats | None]:
    """q and u as they are needed. ``held``: inputs that are temperatures."""
    if q is None:
        return None, None
    states = np.atleast_2d(np.asarray(q))
    if np.iscomplexobj(states) or states.shape[1] != model.order:
        raise BodyError(
            f"stress: q is {' × '.join(map(str, states.shape))} of "
            f"{states.dtype}, expected real rows of {model.order} coordinates"
        )
    if not held:
        return states.astype(float), None
    if u is None:
        raise BodyError(
            f"stress: {', '.join(dict.fromkeys(held))} strains the body: give the inputs u of "
            "these moments"
        )
    loads = np.atleast_2d(np.asarray(u, dtype=float))
    if loads.shape != (len(states), len(model.inputs)):
        raise BodyError(
            f"stress: u is {' × '.join(map(str, loads.shape))}, expected "
            f"{len(states)} × {len(model.inputs)} inputs"
        )
    return states.astype(float), loads


class Peak(NamedTuple):
    """An extreme stress at a node over a motion."""

    value: float  #: [N/m²]
    when: int  #: the row of the motion
    where: int  #: the node of the mesh, from 0
    side: str = ""  #: of shells


class StressPeaks(NamedTuple):
    """Extremes of the stress at all nodes over a motion: of the von Mises stress, and the largest
    and the least with the sign of the principal stress that dominates."""

    von_mises: Peak
    tension: Peak
    pressure: Peak
    over_time: Floats  #: (n,) the largest von Mises stress of each moment [N/m²]


def stress_peaks(
    model: ReducedBody, q: Floats, u: Floats, body: str | Path | None = None
) -> StressPeaks:
    """Extremes of the stress over a motion (n, m) under loads (n, n_in), of solids and of both
    sides of shells.

    Raises
    ------
    BodyError
        As ``stress_fields``.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> q = np.outer([0.0, 1.0, -2.0], np.ones(rom.order))
    >>> peaks = stress_peaks(rom, q, np.zeros((3, len(rom.inputs))))
    >>> peaks.von_mises.when, peaks.von_mises.value >= peaks.tension.value > 0
    (2, True)
    """
    found = [Peak(-np.inf, 0, 0)] * 3
    over_time = np.zeros(len(q))
    for field in stress_fields(model, body):
        some = max(1, int(2e6 / max(6 * len(field.nodes), 1)))  # at a time: a field is large
        for first in range(0, len(q), some):
            now = slice(first, first + some)
            stress = field.of(*_states(model, q[now], u[now], list(field.held)), model.inputs)
            signed = np.nan_to_num(signed_von_mises(stress))
            over_time[now] = np.maximum(over_time[now], np.abs(signed).max(axis=1))
            for i, sized in enumerate((np.abs(signed), signed, -signed)):
                k, at = np.unravel_index(int(sized.argmax()), sized.shape)
                if sized[k, at] > found[i].value:
                    found[i] = Peak(
                        float(sized[k, at]), first + int(k), int(field.nodes[at]), field.side
                    )
    return StressPeaks(found[0], found[1], found[2]._replace(value=-found[2].value), over_time)


def words_of_stress(
    model: ReducedBody, t: Floats, peaks: StressPeaks, body: str | Path | None = None
) -> str:
    """What ``stress_peaks`` found, at times t; places in mm where the files had these."""
    path = body_of(model, body)
    points = Geometry.load(path).points
    unit, length = length_unit(path)

    def said(peak: Peak) -> str:
        place = ", ".join(f"{x:.4g}" for x in points[peak.where] / length)
        return (
            f"{1e-6 * peak.value:.4g} MPa at ({place}) {unit}, node {peak.where + 1}"
            + (f", {peak.side} side" if peak.side else "")
            + f", t = {t[peak.when]:.6g} s"
        )

    return (
        f"largest von Mises stress {said(peaks.von_mises)}; of places in tension "
        f"{said(peaks.tension)}; of places in compression {said(peaks.pressure)}"
    )
