"""Sections of Nastran's beams as entries of a description."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexgram.basics import BodyError

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
    return {
        "shape": "general",
        "A": A,
        "I_y": I2,
        "I_z": I1,
        "J": J,
        "k_y": float(k1) or stiff,
        "k_z": float(k2) or stiff,
    }


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
    if shape == "BOX":
        b, h, t1, t2 = d  # width, height, thickness of the horizontal and of the vertical walls
        inner = (b - 2 * t2, h - 2 * t1)
        A = b * h - inner[0] * inner[1]
        area, around = (b - t2) * (h - t1), (b - t2) / t1 + (h - t1) / t2
        return {
            "shape": "general",
            "A": A,
            "I_y": (h * b**3 - inner[1] * inner[0] ** 3) / 12,
            "I_z": (b * h**3 - inner[0] * inner[1] ** 3) / 12,
            "J": 4 * area**2 / (2 * around),
            "k_y": 2 * t2 * h / A,
            "k_z": 2 * t1 * b / A,
        }
    if shape == "I":
        h, bottom, top, web, low, high = d
        if abs(bottom - top) > 1e-9 * h or abs(low - high) > 1e-9 * h:
            raise BodyError("an I with two different flanges is not followed")
        inner_height = h - 2 * low
        A = 2 * top * low + web * inner_height
        return {
            "shape": "general",
            "A": A,
            "I_y": (2 * low * top**3 + inner_height * web**3) / 12,
            "I_z": (top * h**3 - (top - web) * inner_height**3) / 12,
            "J": (2 * top * low**3 + inner_height * web**3) / 3,
            "k_y": web * h / A,
            "k_z": 5 / 3 * top * low / A,
        }
    raise BodyError(f"shape {shape} is not followed (ROD, TUBE, BAR, BOX, symmetric I are)")
