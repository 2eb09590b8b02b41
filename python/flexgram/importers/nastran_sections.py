"""Sections of Nastran's beams as entries of a description."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from flexgram.basics import BodyError
from flexgram.body.beam_shapes import Plate, box, general, i_beam, plates, turned
from flexgram.body.reader import Reader
from flexgram.body.sections import section_properties

#: What a PBEAM may say that is not supported: neutral axes and masses beside the shear centre,
#: inertia of masses, warping.
BESIDE = ("n1a", "n1b", "n2a", "n2b", "m1a", "m1b", "m2a", "m2b", "nsia", "nsib", "cwa", "cwb")


def rod_section(prop: Any) -> tuple[float, float]:
    """Area and torsion constant of PROD, CONROD or PTUBE."""
    if prop.type != "PTUBE":
        return float(prop.A or 0.0), float(prop.j or 0.0)
    outer, inner = float(prop.OD1), float(prop.OD1) - 2 * float(prop.t)
    if float(prop.OD2) != outer:
        raise BodyError("it tapers")
    if not outer > inner >= 0:
        raise BodyError("its wall must be thinner than its radius")
    return math.pi / 4 * (outer**2 - inner**2), math.pi / 32 * (outer**4 - inner**4)


def tapers(prop: Any) -> bool:
    """Whether the section of a PBEAM or PBEAML changes along the beam."""
    if prop.type == "PBEAML":
        rows = np.atleast_2d(np.asarray(prop.dim, dtype=float))
        rows = np.column_stack([rows, np.resize(np.ravel(prop.nsm), len(rows))])
        return bool(np.any(np.ptp(rows, axis=0) > 1e-3 * np.abs(rows).max(axis=0)))
    if prop.type != "PBEAM":
        return False
    values = [np.ravel(getattr(prop, key)) for key in ("A", "i1", "i2", "i12", "j", "nsm")]
    return any(np.ptp(v) > 1e-3 * float(np.abs(v).max()) for v in values)


def along(prop: Any, values: Any, place: float) -> Any:
    """What a PBEAM or PBEAML says at its stations, at a place from 0 to 1."""
    rows = np.asarray(values, dtype=float)
    if len(rows) < 2:
        return rows[0]
    order = np.argsort(prop.xxb)
    stations, columns = np.asarray(prop.xxb, dtype=float)[order], rows[order]
    if columns.ndim == 1:
        return float(np.interp(place, stations, columns))
    return np.array([np.interp(place, stations, column) for column in columns.T])


def beam_section(prop: Any, place: float = 0.0) -> dict[str, Any]:
    """Entry of ``sections`` of a PBAR, PBARL, PBEAM or PBEAML of pyNastran, without ``y_axis``. The
    local y axis is that of plane 1; ``turn`` [rad] about the beam, if it is there, brings it to a
    principal axis. ``place``: from 0 to 1, of a beam that tapers.

    Raises
    ------
    BodyError
        For what is not supported, without the place.
    """
    if prop.type in ("PBARL", "PBEAML"):
        return _of_shape(prop, place)
    if prop.type not in ("PBAR", "PBEAM"):
        raise BodyError("beams need a PBAR, PBARL, PBEAM or PBEAML")
    if prop.type == "PBEAM":
        for key in BESIDE:
            if np.any(np.abs(np.ravel(getattr(prop, key, 0.0) or 0.0)) > 0):
                raise BodyError(f"{key.upper()} is not supported")
        A, I1, I2, I12, J = (
            float(along(prop, np.ravel(getattr(prop, key)), place))
            for key in ("A", "i1", "i2", "i12", "j")
        )
        k1, k2 = 1.0 if prop.k1 is None else prop.k1, 1.0 if prop.k2 is None else prop.k2
    else:
        A, I1, I2, I12, J = (
            float(getattr(prop, key) or 0.0) for key in ("A", "i1", "i2", "i12", "j")
        )
        k1, k2 = prop.k1 or 0.0, prop.k2 or 0.0
    turn = 0.0
    if abs(I12) > 1e-9 * (I1 + I2):
        if abs(k1 - k2) > 1e-6:
            raise BodyError("I12 with two different K1 and K2 is not supported")
        (I2, I1), axes = np.linalg.eigh([[I1, I12], [I12, I2]])
        turn = math.atan2(axes[1, 1], axes[0, 1])
    if not (A > 0 and min(I1, I2, J) >= 0):
        raise BodyError("A must be positive, I1, I2 and J zero or more")
    stiff = 1e6  # K = 0: no shear
    section = general(A, float(I2), float(I1), J, float(k1) or stiff, float(k2) or stiff)
    return section | ({"turn": turn} if turn else {})


def sheared(section: dict[str, Any], factor: float) -> dict[str, Any]:
    """A section that twists and shears as with a ``factor`` times larger G."""
    if factor == 1:
        return section
    of = section_properties(Reader(section, "section"), 1.0)
    return {"shape": "general"} | of | {key: factor * of[key] for key in ("J", "k_y", "k_z")}


def _t(flange: float, h: float, thick: float, web: float) -> list[Plate]:
    return [Plate(thick, flange), Plate(h - thick, web, h / 2)]


def _t1(h: float, foot: float, web: float, thick: float) -> list[Plate]:
    return [Plate(h, web), Plate(thick, foot, 0.0, (foot + web) / 2)]


def _i(h: float, bottom: float, top: float, web: float, low: float, high: float) -> list[Plate]:
    inner = h - low - high
    return [
        Plate(low, bottom, low / 2),
        Plate(inner, web, low + inner / 2),
        Plate(high, top, h - high / 2),
    ]


def _i1(feet: float, web: float, inner: float, h: float) -> list[Plate]:
    thick = (h - inner) / 2
    return _i(h, feet + web, feet + web, web, thick, thick)


def _chan(flange: float, h: float, web: float, thick: float) -> list[Plate]:
    flanges = [Plate(thick, flange, sign * (h - thick) / 2, flange / 2) for sign in (1, -1)]
    return [*flanges, Plate(h - 2 * thick, web, 0.0, web / 2)]


def _chan1(foot: float, web: float, inner: float, h: float) -> list[Plate]:
    return _chan(foot + web, h, web, (h - inner) / 2)


def _chan2(leg: float, floor: float, h: float, width: float) -> list[Plate]:
    legs = [Plate(h, leg, h / 2, sign * (width - leg) / 2) for sign in (1, -1)]
    return [*legs, Plate(floor, width - 2 * leg, floor / 2)]


def _h(inner: float, legs: float, h: float, bar: float) -> list[Plate]:
    sides = [Plate(h, legs / 2, 0.0, sign * (inner + legs / 2) / 2) for sign in (1, -1)]
    return [*sides, Plate(bar, inner)]


def _hat(h: float, thick: float, top: float, foot: float) -> list[Plate]:
    webs = [Plate(h - 2 * thick, thick, h / 2, sign * (top - thick) / 2) for sign in (1, -1)]
    feet = [
        Plate(thick, foot + thick, thick / 2, sign * (top + foot - thick) / 2) for sign in (1, -1)
    ]
    return [*webs, *feet, Plate(thick, top, h - thick / 2)]


def _cross(arms: float, web: float, h: float, thick: float) -> list[Plate]:
    sides = [Plate(thick, arms / 2, 0.0, sign * (arms / 2 + web) / 2) for sign in (1, -1)]
    return [*sides, Plate(h, web)]


def _box1(
    b: float, h: float, top: float, bottom: float, left: float, right: float
) -> dict[str, Any]:
    """A box of four different walls, thin in torsion (Bredt)."""
    sides, y = h - top - bottom, (bottom - top) / 2
    section = plates(
        [
            Plate(top, b, (h - top) / 2),
            Plate(bottom, b, (bottom - h) / 2),
            Plate(sides, left, y, (left - b) / 2),
            Plate(sides, right, y, (b - right) / 2),
        ]
    )
    b, h = b - (left + right) / 2, h - (top + bottom) / 2
    around = b / top + b / bottom + h / left + h / right
    return section | {"J": 4 * (b * h) ** 2 / around}


def _hexa(side: float, b: float, h: float) -> dict[str, Any]:
    """A full hexagon of width b and height h, whose corners at the sides reach out by ``side``.
    Torsion: A⁴/(40 (I_y + I_z)), Saint-Venant's rule for full sections."""
    A, half = h * (b - side), b / 2 - side
    I_z = h**3 * (2 * half / 12 + side / 24)
    I_y = h * (2 * half**3 / 3 + half**2 * side + 2 * half * side**2 / 3 + side**3 / 6)
    return general(A, I_y, I_z, A**4 / (40 * (I_y + I_z)), 5 / 6, 5 / 6)


#: Shapes of PBARL by their dimensions. CBAR takes their shear centre and centre of area as one.
OPEN: dict[str, Callable[..., list[Plate]]] = {
    "T": _t,
    "T1": _t1,
    "T2": _t,
    "I": _i,
    "I1": _i1,
    "CHAN": _chan,
    "CHAN1": _chan1,
    "CHAN2": _chan2,
    "H": _h,
    "HAT": _hat,
    "CROSS": _cross,
}


def _of_shape(prop: Any, place: float) -> dict[str, Any]:
    """Of a named shape: exact, or (box, I) of thin walls in torsion and shear."""
    rows = np.atleast_2d(np.asarray(prop.dim, dtype=float))
    shape, d = str(prop.beam_type), along(prop, rows, place).tolist()
    if shape == "ROD":
        area, second = math.pi * d[0] ** 2, math.pi * d[0] ** 4 / 4
        return general(area, second, second, 2 * second, 0.9, 0.9)
    if shape == "TUBE":
        return {"shape": "tube", "radius": d[0], "thickness": d[0] - d[1]}
    if shape == "TUBE2":
        return {"shape": "tube", "radius": d[0], "thickness": d[1]}
    if shape == "BAR":  # its second dimension is along y
        return {"shape": "rectangle", "width": d[1], "height": d[0]}
    if shape == "BOX":  # thickness of the horizontal and of the vertical walls; height along y
        b, h, top, side = d
        return turned(box(b, h, side, top))
    if shape == "BOX1" and prop.type == "PBARL":
        return _box1(*d)
    if shape == "HEXA" and prop.type == "PBARL":
        return _hexa(*d)
    if shape == "I":
        h, bottom, top, web, low, high = d
        if abs(bottom - top) <= 1e-9 * h and abs(low - high) <= 1e-9 * h:
            return turned(i_beam(h, top, low, web))
        if prop.type != "PBARL":
            raise BodyError("an I with two different flanges is not supported")
    if shape in OPEN and prop.type == "PBARL":
        return plates(OPEN[shape](*d))
    more = ("BOX1", "HEXA", *OPEN) if prop.type == "PBARL" else ()
    known = ["ROD", "TUBE", "TUBE2", "BAR", "BOX", "I", *more]
    raise BodyError(f"shape {shape} is not supported ({', '.join(dict.fromkeys(known))} are)")
