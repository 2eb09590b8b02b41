"""Sections of Nastran's beams as entries of a description."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexgram.basics import BodyError
from flexgram.body.beam_shapes import box, general, i_beam, turned

#: What a PBEAM may say that is not followed: neutral axes and masses beside the shear centre,
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


def beam_section(prop: Any) -> dict[str, Any]:
    """Entry of ``sections`` of a PBAR, PBARL, PBEAM or PBEAML of pyNastran, without ``y_axis``. The
    local y axis is that of plane 1.

    Raises
    ------
    BodyError
        For what is not followed, without the place.
    """
    if prop.type in ("PBARL", "PBEAML"):
        return _of_shape(prop)
    if prop.type not in ("PBAR", "PBEAM"):
        raise BodyError("beams need a PBAR, PBARL, PBEAM or PBEAML")
    if prop.type == "PBEAM":
        for key in BESIDE:
            if np.any(np.abs(np.ravel(getattr(prop, key, 0.0) or 0.0)) > 0):
                raise BodyError(f"{key.upper()} is not followed")
        values = [np.ravel(getattr(prop, key)) for key in ("A", "i1", "i2", "i12", "j")]
        if any(np.ptp(v) > 1e-3 * float(np.abs(v).max()) for v in values):
            raise BodyError("its section changes along the beam")
        A, I1, I2, I12, J = (float(v[0]) for v in values)
        k1, k2 = 1.0 if prop.k1 is None else prop.k1, 1.0 if prop.k2 is None else prop.k2
    else:
        A, I1, I2, I12, J = (
            float(getattr(prop, key) or 0.0) for key in ("A", "i1", "i2", "i12", "j")
        )
        k1, k2 = prop.k1 or 0.0, prop.k2 or 0.0
    if abs(I12) > 1e-9 * (I1 + I2):
        raise BodyError("I12 is not followed: take principal axes")
    if not min(A, I1, I2, J) > 0:
        raise BodyError("A, I1, I2 and J must be positive")
    stiff = 1e6  # K = 0: no shear
    return general(A, I2, I1, J, float(k1) or stiff, float(k2) or stiff)


def _of_shape(prop: Any) -> dict[str, Any]:
    """Of a named shape: exact, or (box, I) of thin walls in torsion and shear."""
    rows = np.atleast_2d(np.asarray(prop.dim, dtype=float))
    if np.any(np.ptp(rows, axis=0) > 1e-3 * np.abs(rows).max(axis=0)):
        raise BodyError("its section changes along the beam")
    shape, d = str(prop.beam_type), rows[0].tolist()
    if shape == "ROD":
        return {"shape": "circle", "radius": d[0]}
    if shape == "TUBE":
        return {"shape": "tube", "radius": d[0], "thickness": d[0] - d[1]}
    if shape == "BAR":  # its second dimension is along y
        return {"shape": "rectangle", "width": d[1], "height": d[0]}
    if shape == "BOX":  # thickness of the horizontal and of the vertical walls; height along y
        b, h, top, side = d
        return turned(box(b, h, side, top))
    if shape == "I":
        h, bottom, top, web, low, high = d
        if abs(bottom - top) > 1e-9 * h or abs(low - high) > 1e-9 * h:
            raise BodyError("an I with two different flanges is not followed")
        return turned(i_beam(h, top, low, web))
    raise BodyError(f"shape {shape} is not followed (ROD, TUBE, BAR, BOX, symmetric I are)")
