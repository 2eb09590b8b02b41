"""Where the stress of a body is largest per unit of a load over the band: places for outputs."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.units import UNITS
from flexgram.model.damped_modes import natural_frequencies
from flexgram.model.elastic_part import without_rigid_modes
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.kinds import ports_of, unit_of
from flexgram.model.recovery import stress_fields
from flexgram.model.reduced import ReducedBody

#: Rows whose squares add up to the square of the von Mises stress of xx, yy, zz, xy, yz, zx.
_MISES = np.array([[1, -1, 0, 0, 0, 0], [0, 1, -1, 0, 0, 0], [-1, 0, 1, 0, 0, 0]]) / np.sqrt(2)
MISES = np.vstack([_MISES, np.sqrt(3) * np.eye(6)[3:]])
#: Nodes whose stress is in memory at a time.
CHUNK = 2000


@dataclass
class HotSpot:
    """A node of large stress.

    Attributes
    ----------
    node : int
        Of the mesh, from 1.
    place : (3,) array
        [m]
    input : str
        The load under which it stands out most.
    stress : float
        Amplitude of its von Mises stress for a unit of that load [N/m²].
    hertz : float
        Where in the band.
    share : float
        Of the largest under the same load anywhere.
    side : str
        Of a shell: ``top`` or ``bottom``; empty for solids.
    elements : tuple of int
        Of shells that meet others there: the numbers of those whose stress it is.
    """

    node: int
    place: Floats
    input: str
    stress: float
    hertz: float
    share: float
    side: str = ""
    elements: tuple[int, ...] = ()


def hot_spots(
    model: ReducedBody,
    count: int = 5,
    *,
    apart: float | None = None,
    body: str | Path | None = None,
    inputs: list[str] | None = None,
    frequencies: int = 60,
    hertz: float | None = None,
) -> list[HotSpot]:
    """Nodes of the largest von Mises stress per unit of a load over the band.

    Of each load by itself: every one is scaled by its own largest stress. The stress is that of the
    reduced body, of which nothing is claimed: an output of the type stress at such a node is
    certified.

    Parameters
    ----------
    model : ReducedBody
        Of a mesh of solids, shells, or both.
    count : int
        At most so many.
    apart : float, optional
        Distance between any two [m]; default: a twentieth of the body's size.
    body : str or Path, optional
        Body file; default: the one that was reduced.
    inputs : list of str, optional
        Loads to look at; default: all but temperatures, of which there are none.
    frequencies : int
        Of the curve of the error so many, evenly chosen, beside the resonances.
    hertz : float, optional
        At this frequency alone; 0: under a constant load.

    Raises
    ------
    BodyError
        If the body has no stresses, or an input is none of its own.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> spots = hot_spots(rom, 2, inputs=["upper.fx"], frequencies=5)
    >>> [spot.input for spot in spots]
    ['upper.fx', 'upper.fx']
    """
    whole = model.system.B
    with contextlib.suppress(BodyError):  # dampers hold it
        model = without_rigid_modes(model)  # rigid motion strains nothing
    strain = np.linalg.norm(model.system.B, axis=0) > 1e-9 * np.linalg.norm(whole, axis=0)
    warm = {
        model.inputs[k]
        for kind in ("temperature", "temperature gradient")
        for k in ports_of(model.inputs, kind)
    }
    chosen = inputs or [name for name in model.inputs if name not in warm]
    for name in chosen:
        if name not in model.inputs:
            raise BodyError(f"there is no input {name}; there are {', '.join(model.inputs)}")
    if not any(strain[model.inputs.index(name)] for name in chosen):
        raise BodyError(
            f"{', '.join(chosen[:6])}: these loads move the free body as a whole, and strain "
            "nothing"
        )
    chosen = [name for name in chosen if strain[model.inputs.index(name)]]
    if warm.intersection(chosen):
        raise BodyError(
            "temperatures have no hot spots: their stress is not that of the motion "
            "alone, and hangs on what holds the body (rom.stress(q, u=u))"
        )
    if apart is not None and not (np.isfinite(apart) and apart >= 0):
        raise BodyError(f"apart = {apart} must be a distance")
    if model.system.parameters:
        model = model.at()
    columns = [model.inputs.index(name) for name in chosen]
    fields = stress_fields(model, body)
    geometry = Geometry.load(body_of(model, body))
    omega = _over_band(model, frequencies) if hertz is None else _at(model, hertz)
    motion = np.array(
        [
            np.linalg.solve(model.system.dynamic_stiffness(w), model.system.B[:, columns])
            for w in omega
        ]
    )
    motion = np.nan_to_num(motion).transpose(1, 0, 2).reshape(model.order, -1)
    parts = np.hstack([motion.real, motion.imag])
    nodes = np.concatenate([field.nodes for field in fields])
    largest = np.zeros((len(nodes), len(columns)))  # of each place and load, over the band
    when = np.zeros_like(largest)
    ends = np.cumsum([len(field.nodes) for field in fields])
    for field, end in zip(fields, ends.tolist(), strict=True):
        begin = end - len(field.nodes)
        for first in range(0, len(field.nodes), CHUNK):
            some = field.basis[:, first : first + CHUNK]
            rows = np.einsum("mnc,kc->nkm", some, MISES)
            squares = np.sum((rows @ parts) ** 2, axis=1)  # (n, 2 ω j)
            squares = squares.reshape(some.shape[1], 2, len(omega), len(columns))
            amplitude = np.sqrt(squares.sum(axis=1))
            here = slice(begin + first, begin + first + some.shape[1])
            largest[here] = amplitude.max(axis=1)
            when[here] = omega[amplitude.argmax(axis=1)]
    scale = largest.max(axis=0)
    shares = largest / np.where(scale > 0, scale, 1.0)
    score = shares.max(axis=1)
    points = geometry.points[nodes]
    distance = 0.05 * float(np.ptp(points, axis=0).max()) if apart is None else apart
    found: list[HotSpot] = []
    left = np.ones(len(nodes), dtype=bool)
    while len(found) < count and left.any():
        at = int(np.argmax(np.where(left, score, -1.0)))
        load = int(np.argmax(shares[at]))
        which = int(np.searchsorted(ends, at, side="right"))
        field = fields[which]
        found.append(
            HotSpot(
                int(nodes[at]) + 1,
                points[at],
                chosen[load],
                float(largest[at, load]),
                float(when[at, load] / (2 * np.pi)),
                float(shares[at, load]),
                field.side,
                field.elements(at - int(ends[which]) + len(field.nodes)),
            )
        )
        left &= np.linalg.norm(points - points[at], axis=1) > distance
        left[at] = False
    return found


def _over_band(model: ReducedBody, count: int) -> Floats:
    """Frequencies of the curve of the error, and the resonances in the bands [rad/s]."""
    curve = model.claim.omega[:: max(1, len(model.claim.omega) // count)]
    modes = natural_frequencies(model)
    inside = np.any([(modes >= a) & (modes <= b) for a, b in model.claim.bands], axis=0)
    if not model.system.loss and not np.any(model.system.D + model.system.D.T):
        inside &= False  # there is no largest stress at resonances without damping
    omega: Floats = np.unique(np.concatenate([curve, modes[inside]]))
    return omega


def _at(model: ReducedBody, hertz: float) -> Floats:
    if not (np.isfinite(hertz) and hertz >= 0):
        raise BodyError(f"{hertz} Hz must be a frequency, zero or more")
    if hertz == 0 and model.frame.rigid_modes:
        raise BodyError("nothing holds the body under a constant load: dampers alone do not")
    return np.array([2 * np.pi * hertz])


def describe(spots: list[HotSpot], units: str = "") -> list[str]:
    """Lines for a reader: each spot, and the outputs that would certify them, for files in
    ``units``; empty: of unknown ones."""
    lines = [
        f"node {spot.node} at ({', '.join(f'{x:.5g}' for x in spot.place)}) m{_where(spot)}: "
        f"{spot.stress:.4g} N/m² per {unit_of(spot.input, False) or 'unit'} of {spot.input}, "
        f"at {spot.hertz:.5g} Hz "
        f"({100 * spot.share:.0f} % of the largest stress that this load causes)"
        for spot in spots
    ]
    lines += [
        "",
        "nothing is claimed of these numbers; as outputs of the body they are certified:",
        "outputs:",
    ]
    for k, spot in enumerate(spots, 1):
        more = f", elements: {list(spot.elements)}" if spot.elements else ""
        more += f", side: {spot.side}" if spot.side else ""
        lines.append(f"  spot{k}: {{type: stress, nodes: [{spot.node}]{more}}}")
    length = UNITS[units or "SI"][0]
    lines.append(
        f"or by options of the import, of files in {units}:"
        if units
        else "or by options of the import (here in metres, there in the units of its files):"
    )
    for k, spot in enumerate(spots, 1):
        at = ",".join(f"{x / length:.8g}" for x in spot.place)
        side = f"/{spot.side}" if spot.side else ""
        among = f"/ELEMENTS:{','.join(map(str, spot.elements))}" if spot.elements else ""
        lines.append(f"  --measure spot{k}=stress{side}:AT:{at}{among}")
    return lines


def _where(spot: HotSpot) -> str:
    """Of shells: on which side, and of which elements where others meet these."""
    of = f" of elements {', '.join(map(str, spot.elements))}" if spot.elements else ""
    return f", {spot.side} side{of}" if spot.side else ""
