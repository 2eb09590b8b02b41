"""Sections of beams: areas, moments and shear factors of shapes with names; and of shells."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

from flexgram.basics import BodyError
from flexgram.body.reader import Reader

ROD = "rod"
SHAPES = {
    ROD: ("A",),
    "circle": ("radius",),
    "tube": ("radius", "thickness"),
    "rectangle": ("width", "height"),
    "general": ("A", "I_y", "I_z", "J", "k_y", "k_z"),
}


SHELL = "shell"
#: What of a shell can be told apart: its bending over that of its thickness, t³/12, and its shear
#: over t; and what these are of one layer.
APART = {"bending": 1.0, "shear": 5 / 6}


def is_shell(reader: Reader) -> bool:
    """Whether a section is that of a shell."""
    return reader.choice("shape", (*SHAPES, SHELL)) == SHELL


def shell_properties(reader: Reader, length: float, materials: Collection[str]) -> dict[str, Any]:
    """Thickness and offset [m] of a shell's section, its layers if it has such (bottom to top,
    angles [rad]), its bending and shear if they are told apart, with the heights of its sides, and
    the direction of the first axis if that is given. ``materials``: those known.
    """
    known = ("shape", "thickness", "layers", "offset", "axis_1", *APART, "sides")
    section = Reader(reader.data, reader.where, known)
    if ("thickness" in section.data) == ("layers" in section.data):
        raise BodyError(f"{section.where}: a shell needs a thickness, or layers")
    found: dict[str, Any] = {"offset": section.number("offset", 0.0) * length}
    if "layers" in section.data:
        given = section.get("layers")
        if not isinstance(given, list) or not given:
            raise BodyError(f"{section.where}: layers must be a list, from the bottom to the top")
        layers = [
            Reader(layer, f"{section.where}: layer {k}", ("material", "thickness", "angle"))
            for k, layer in enumerate(given, 1)
        ]
        found["layer_materials"] = [layer.choice("material", materials) for layer in layers]
        found["layer_thicknesses"] = [_thickness(layer) * length for layer in layers]
        found["layer_angles"] = [math.radians(layer.number("angle", 0.0)) for layer in layers]
        found["thickness"] = sum(found["layer_thicknesses"])
    else:
        found["thickness"] = _thickness(section) * length
    if {*APART, "sides"} & set(section.data):
        found |= _apart(section, materials)
    if "sides" in section.data:
        found["sides"] = [height * length for height in _sides(section)]
    if "axis_1" in section.data:
        found["axis_1"] = section.vector("axis_1")
        if not any(found["axis_1"]):
            raise BodyError(f"{section.where}: axis_1 = [0, 0, 0] has no direction")
    return found


def _apart(section: Reader, materials: Collection[str]) -> dict[str, Any]:
    """Bending and shear of a shell that are told apart from its stretching."""
    if "layers" in section.data:
        raise BodyError(f"{section.where}: layers have their own bending and shear")
    found: dict[str, Any] = {}
    for key, usual in APART.items():
        entry = Reader(section.data.get(key, {}), f"{section.where}: {key}", ("material", "factor"))
        factor = entry.number("factor", usual)
        if not factor > 0:
            raise BodyError(f"{entry.where}: factor = {factor:g} must be positive")
        found[f"{key}_factor"] = factor
        if "material" in entry.data:
            found[f"{key}_material"] = entry.choice("material", materials)
    return found


def _sides(section: Reader) -> tuple[float, float]:
    """Heights of the bottom and the top above the middle surface."""
    try:
        bottom, top = (float(height) for height in section.data["sides"])
    except (TypeError, ValueError):
        bottom = top = math.nan
    if not -math.inf < bottom <= top < math.inf:
        raise BodyError(f"{section.where}: sides must be [bottom, top], heights above the middle")
    return bottom, top


def _thickness(reader: Reader) -> float:
    thickness = reader.number("thickness")
    if not thickness > 0:
        raise BodyError(f"{reader.where}: thickness = {thickness:g} must be positive")
    return thickness


def section_properties(reader: Reader, length: float) -> dict[str, float]:
    """Area, second moments of area, torsion constant and shear factors of a beam section [SI].

    Shear factors after Cowper (1966) for nu = 0.3; torsion of a rectangle by Saint-Venant's
    series to 1e-5.
    """
    shape = reader.choice("shape", (*SHAPES, SHELL))
    value = {
        key: reader.number(key, 5 / 6 if key.startswith("k_") else None) for key in SHAPES[shape]
    }
    nu = 0.3
    if shape == ROD:
        return {"A": value["A"] * length**2}
    if shape == "general":
        powers = {"A": 2, "I_y": 4, "I_z": 4, "J": 4, "k_y": 0, "k_z": 0}
        return {key: value[key] * length ** powers[key] for key in powers}
    size = {key: x * length for key, x in value.items()}
    if shape == "rectangle":  # width along y, height along z
        b, h = size["width"], size["height"]
        a, c = max(b, h), min(b, h)
        series = sum(math.tanh(n * math.pi * a / (2 * c)) / n**5 for n in range(1, 40, 2))
        J = a * c**3 / 3 * (1 - 192 * c / (math.pi**5 * a) * series)
        k = 10 * (1 + nu) / (12 + 11 * nu)
        return {"A": b * h, "I_y": b * h**3 / 12, "I_z": h * b**3 / 12, "J": J, "k_y": k, "k_z": k}
    R = size["radius"]
    r = R - size["thickness"] if shape == "tube" else 0.0
    if r < 0:
        raise BodyError(f"{reader.where}: thickness is larger than radius")
    second = math.pi * (R**4 - r**4) / 4
    m2 = (r / R) ** 2
    k = 6 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
    return {
        "A": math.pi * (R**2 - r**2),
        "I_y": second,
        "I_z": second,
        "J": 2 * second,
        "k_y": k,
        "k_z": k,
    }
