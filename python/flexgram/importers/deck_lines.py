"""Sections of beams and trusses of a CalculiX or Abaqus deck, as a body's description has them."""

from __future__ import annotations

from typing import Any

from flexgram.basics import BodyError
from flexgram.body.beam_shapes import box, ellipse, general, i_beam
from flexgram.importers.ccx import Card, Job

#: Element types of beams and trusses. A beam of three nodes becomes two.
BEAMS = ("B31", "B31R", "B32", "B32R")
TRUSSES = ("T3D2",)
#: Cards of their sections.
CARDS = ("BEAM SECTION", "BEAM GENERAL SECTION")
OPTIONS = {"ELSET", "MATERIAL", "SECTION", "DENSITY", "TEMPERATURE", "POISSON"}
#: Dimensions of shapes.
SHAPES = {"RECT": (2,), "CIRC": (1, 2), "PIPE": (2,), "BOX": (6,), "I": (7,)}


def where_of(job: Job, card: Card) -> str:
    """The place of a section, for messages."""
    return f"{card.place}, ELSET={card.options.get('ELSET', '')}"


def own_material(card: Card) -> str:
    """Name of the material that a *BEAM GENERAL SECTION holds itself; empty for others."""
    general = card.keyword == "BEAM GENERAL SECTION"
    return f"beam general section {card.options.get('ELSET', '').upper()}" if general else ""


def _rows(where: str, card: Card) -> list[list[float]]:
    try:
        return [[float(w) if w else 0.0 for w in row] for row in card.words()]
    except ValueError:
        raise BodyError(f"{where}: expected numbers") from None


def truss_section(job: Job, card: Card) -> dict[str, Any]:
    """Entry of ``sections`` of a *SOLID SECTION of trusses: its first number is the area."""
    where = where_of(job, card)
    rows = _rows(where, card)
    if not rows or not rows[0] or not rows[0][0] > 0:
        raise BodyError(f"{where}: trusses need an area")
    return {"shape": "rod", "A": rows[0][0]}


def beam_section(job: Job, card: Card, *, abaqus: bool) -> dict[str, Any]:
    """Entry of ``sections`` of a *BEAM SECTION or *BEAM GENERAL SECTION. The local y axis is
    direction 1 of the deck.

    Parameters
    ----------
    abaqus : bool
        The deck is for Abaqus, where the size of CIRC is a radius; CalculiX takes a diameter.

    Raises
    ------
    BodyError
        For shapes and options that are not supported.
    """
    where = where_of(job, card)
    if others := sorted(set(card.options) - OPTIONS):
        raise BodyError(f"{where}: {others[0]} is not supported by --assemble: take --run-ccx")
    rows = _rows(where, card)
    shape = card.options.get("SECTION", "GENERAL" if own_material(card) else "").upper()
    sizes = rows[0] if rows else []
    if own_material(card):
        entry = _general(where, shape, sizes)
    elif len(sizes) not in SHAPES.get(shape, ()):
        raise BodyError(
            f"{where}: SECTION={shape} with {len(sizes)} numbers is not supported; "
            f"{', '.join(SHAPES)} are, with "
            + ", ".join(" or ".join(map(str, counts)) for counts in SHAPES.values())
        )
    elif any(not size > 0 for size in sizes):
        raise BodyError(f"{where}: its dimensions must be positive")
    else:
        entry = _of_shape(where, shape, sizes, abaqus)
    first = rows[1] if len(rows) > 1 and any(rows[1]) else [0.0, 0.0, -1.0]
    if len(first) != 3:
        raise BodyError(f"{where}: direction 1 needs three numbers")
    return {**entry, "y_axis": first}


def general_material(job: Job, card: Card) -> dict[str, float]:
    """Entry of ``materials`` of a *BEAM GENERAL SECTION: E and G of its third row, DENSITY."""
    where = where_of(job, card)
    rows = _rows(where, card)
    try:
        E, G = rows[2][:2]
        rho = float(card.options["DENSITY"])
    except (IndexError, KeyError, ValueError):
        raise BodyError(f"{where}: needs E and G in its third row, and a DENSITY") from None
    nu = E / (2 * G) - 1 if G else -1.0
    if not -1 < nu < 0.5:
        raise BodyError(f"{where}: E and G make a Poisson's ratio of {nu:g}")
    return {"E": E, "nu": nu, "rho": rho}


def _general(where: str, shape: str, sizes: list[float]) -> dict[str, Any]:
    if shape != "GENERAL" or len(sizes) < 5:
        raise BodyError(f"{where}: SECTION=GENERAL with A, I11, I12, I22 and J is followed")
    A, I11, I12, I22, J = sizes[:5]
    if abs(I12) > 1e-9 * (I11 + I22):
        raise BodyError(f"{where}: I12 is not supported: take principal axes")
    return general(A, I11, I22, J)


def _of_shape(where: str, shape: str, sizes: list[float], abaqus: bool) -> dict[str, Any]:
    if shape == "RECT":
        return {"shape": "rectangle", "width": sizes[0], "height": sizes[1]}
    if shape == "PIPE":
        return {"shape": "tube", "radius": sizes[0], "thickness": sizes[1]}
    if shape == "CIRC":
        if abaqus and len(sizes) == 1:
            return {"shape": "circle", "radius": sizes[0]}
        if len(sizes) == 1:
            raise BodyError(
                f"{where}: one number of CIRC is a radius in Abaqus and a diameter in CalculiX: "
                "say --format abaqus, or write two diameters"
            )
        return ellipse(0.5 * sizes[0], 0.5 * sizes[1])
    return _box(where, sizes) if shape == "BOX" else _i_beam(where, sizes)


def _box(where: str, sizes: list[float]) -> dict[str, Any]:
    """Width along 1 and height along 2; walls: right, top, left, bottom."""
    b, h, right, top, left, bottom = sizes
    if abs(right - left) > 1e-9 * b or abs(top - bottom) > 1e-9 * h:
        raise BodyError(f"{where}: BOX with different opposite walls is not supported")
    if not (b > 2 * right and h > 2 * top):
        raise BodyError(f"{where}: the walls of its BOX leave no hollow")
    return box(b, h, right, top)


def _i_beam(where: str, sizes: list[float]) -> dict[str, Any]:
    """Height of the origin, height along 2, widths of bottom and top, thicknesses of bottom, top
    and web."""
    origin, h, bottom, top, low, high, web = sizes
    even = abs(bottom - top) <= 1e-9 * h and abs(low - high) <= 1e-9 * h
    if not even or abs(origin - h / 2) > 1e-9 * h:
        raise BodyError(
            f"{where}: an I with equal flanges and its origin in the middle is followed"
        )
    if not h > 2 * low or web > top:
        raise BodyError(f"{where}: its dimensions make no I")
    return i_beam(h, top, low, web)
