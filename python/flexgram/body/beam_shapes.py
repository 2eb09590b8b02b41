"""Sections of beams by their sizes, as entries of ``sections`` of a description.

Widths are along the section's y axis, heights along its z axis. Walls of boxes and I are thin in
torsion and shear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flexgram.basics import BodyError


def general(
    A: float, I_y: float, I_z: float, J: float, k_y: float = 1.0, k_z: float = 1.0
) -> dict[str, Any]:
    """By its properties: area, second moments, torsion constant, shear factors."""
    properties = {"A": A, "I_y": I_y, "I_z": I_z, "J": J, "k_y": k_y, "k_z": k_z}
    return {"shape": "general", **properties}


def turned(section: dict[str, Any]) -> dict[str, Any]:
    """A general section with its y and z axes exchanged."""
    pairs = {"I_y": "I_z", "I_z": "I_y", "k_y": "k_z", "k_z": "k_y"}
    return {key: section[pairs.get(key, key)] for key in section}


def ellipse(a: float, b: float) -> dict[str, Any]:
    """Half axes a along y and b along z; Saint-Venant's torsion."""
    if abs(a - b) <= 1e-12 * a:
        return {"shape": "circle", "radius": a}
    A = math.pi * a * b
    return general(A, A * b**2 / 4, A * a**2 / 4, A * (a * b) ** 2 / (a**2 + b**2), 0.9, 0.9)


def box(b: float, h: float, side: float, top: float) -> dict[str, Any]:
    """Width, height, and the walls at the sides, and at the top and bottom."""
    inner_b, inner_h = b - 2 * side, h - 2 * top
    A = b * h - inner_b * inner_h
    area, around = (b - side) * (h - top), (b - side) / top + (h - top) / side
    return general(
        A,
        (b * h**3 - inner_b * inner_h**3) / 12,
        (h * b**3 - inner_h * inner_b**3) / 12,
        2 * area**2 / around,
        2 * top * b / A,
        2 * side * h / A,
    )


@dataclass(frozen=True)
class Plate:
    """A rectangle of a section: its width along y, its height along z, its middle."""

    width: float
    height: float
    y: float = 0.0
    z: float = 0.0

    @property
    def area(self) -> float:
        return self.width * self.height


def plates(parts: Sequence[Plate]) -> dict[str, Any]:
    """A section of rectangles that do not overlap, about its centre of area.

    Raises
    ------
    BodyError
        If y and z are not its principal axes.
    """
    A = sum(p.area for p in parts)
    y0, z0 = sum(p.area * p.y for p in parts) / A, sum(p.area * p.z for p in parts) / A
    I_y = sum(p.width * p.height**3 / 12 + p.area * (p.z - z0) ** 2 for p in parts)
    I_z = sum(p.height * p.width**3 / 12 + p.area * (p.y - y0) ** 2 for p in parts)
    if abs(sum(p.area * (p.y - y0) * (p.z - z0) for p in parts)) > 1e-9 * (I_y + I_z):
        raise BodyError("I12 is not supported: take principal axes")
    J = sum(max(p.width, p.height) * min(p.width, p.height) ** 3 / 3 for p in parts)
    along_y = sum(p.area for p in parts if p.width > p.height)
    shares = (along_y / A or 5 / 6, (A - along_y) / A or 5 / 6)
    return general(A, I_y, I_z, J, *(5 / 6 if share == 1 else share for share in shares))


def i_beam(h: float, flange: float, thick: float, web: float) -> dict[str, Any]:
    """Height, width and thickness of both flanges, thickness of the web."""
    inner = h - 2 * thick
    A = 2 * flange * thick + web * inner
    return general(
        A,
        (flange * h**3 - (flange - web) * inner**3) / 12,
        (2 * thick * flange**3 + inner * web**3) / 12,
        (2 * flange * thick**3 + inner * web**3) / 3,
        5 / 3 * flange * thick / A,
        web * h / A,
    )
