"""Point masses, rotary inertias (Abaqus), springs and dashpots of a CalculiX or Abaqus deck, as a
body's description has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats, counted
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import Deck

#: Element types -> the card of their property and how many nodes they have.
TYPES = {
    "MASS": ("MASS", 1),
    "ROTARYI": ("ROTARY INERTIA", 1),
    "SPRINGA": ("SPRING", 2),
    "SPRING1": ("SPRING", 1),
    "SPRING2": ("SPRING", 2),
    "DASHPOTA": ("DASHPOT", 2),
}
CARDS = {card for card, _ in TYPES.values()}


@dataclass
class DeckPoints:
    """Entries of ``masses`` and ``springs`` of a description, and what is said of them."""

    masses: dict[str, dict[str, Any]]
    springs: dict[str, dict[str, Any]]
    remarks: list[str]


def _elements(job: Job) -> tuple[dict[int, tuple[str, list[int]]], dict[str, list[int]]]:
    """Of these types by label: type and nodes; and their sets, of *ELEMENT and *ELSET."""
    elements: dict[int, tuple[str, list[int]]] = {}
    sets: dict[str, list[int]] = {}
    for card in job.model:
        kind, name = (card.options.get(key, "").upper() for key in ("TYPE", "ELSET"))
        if card.keyword == "ELEMENT" and kind in TYPES:
            numbers = [int(word) for words in card.words() for word in words if word]
            width = 1 + TYPES[kind][1]
            for first in range(0, len(numbers) - width + 1, width):
                label, *nodes = numbers[first : first + width]
                if elements.setdefault(label, (kind, nodes)) != (kind, nodes):
                    raise BodyError(f"{job.path}: element {label}, a {kind}, is given twice")
                sets.setdefault(name, []).append(label)
        elif card.keyword == "ELSET":
            for words in card.words():
                words = [word for word in words if word]
                if "GENERATE" in card.options:
                    first, last, *by = (int(word) for word in words)
                    sets.setdefault(name, []).extend(range(first, last + 1, *by))
                    continue
                for word in words:
                    members = [int(word)] if word.isdigit() else sets.get(word.upper(), [])
                    sets.setdefault(name, []).extend(members)
    return elements, {name: [m for m in of if m in elements] for name, of in sets.items()}


def _property(job: Job, card: Card) -> list[list[float]]:
    where = f"{card.place}"
    others = [o for o in card.options if o not in ("ELSET", "SPRING CONSTANT", "DASHPOT CONSTANT")]
    if others:
        raise BodyError(f"{where} with {others[0]} is not supported by --assemble: take --run-ccx")
    try:
        rows = [[float(word) for word in words if word] for words in card.words()]
    except ValueError:
        rows = []
    rows = [row for row in rows if row]
    if not rows:
        raise BodyError(f"{where}: expected numbers")
    return rows


def _inertia(card: Card, rows: list[list[float]]) -> list[float]:
    """xx, yy, zz, xy, yz, zx of an inertia tensor, which Abaqus has as xx, yy, zz, xy, xz, yz."""
    if len(rows) != 1 or len(rows[0]) > 6:
        raise BodyError(f"{card.place}: expected I11, I22, I33, I12, I13, I23")
    xx, yy, zz, xy, zx, yz = [*rows[0], *[0.0] * 5][:6]
    return [xx, yy, zz, xy, yz, zx]


def _along(job: Job, kind: str, rows: list[list[float]]) -> Any:
    """What ``stiffness`` is: one number along the line of a SPRINGA, six of a direction."""
    if kind in ("SPRINGA", "DASHPOTA"):
        if len(rows) > 1:
            raise BodyError(f"{job.path}: *SPRING or *DASHPOT of temperature: take --run-ccx")
        return rows[0][0]
    directions = {int(d) for d in rows[0]}
    if len(rows) != 2 or len(directions) != 1 or not directions <= set(range(1, 7)):
        raise BodyError(
            f"{job.path}: *SPRING of {kind}: expected one direction from 1 to 6 and a constant; "
            "--run-ccx knows others"
        )
    six = np.zeros(6)
    six[directions.pop() - 1] = rows[1][0]
    return six.tolist()


def _expect_on_line(job: Job, label: int, ends: Floats, stiffness: list[float]) -> None:
    """A spring of displacements between places off its direction resists turns of the whole body
    in CalculiX; ours resist none."""
    line, along = ends[1] - ends[0], np.array(stiffness[:3])
    if np.linalg.norm(np.cross(line, along)) > 1e-9 * np.linalg.norm(line) * np.linalg.norm(along):
        raise BodyError(
            f"{job.path}: element {label} (SPRING2): its nodes do not lie along its direction; "
            "--assemble does not follow that, take --run-ccx"
        )


def points_of(job: Job, deck: Deck) -> DeckPoints:
    """Masses, springs and dashpots of a deck.

    Raises
    ------
    BodyError
        For cards that say more than is followed here, and elements without one.
    """
    found = DeckPoints({}, {}, [])
    try:
        elements, sets = _elements(job)
    except ValueError as error:
        raise BodyError(f"{job.path}: *ELEMENT or *ELSET: {error}") from None

    def index(label: int) -> int:
        return deck.index(job.path, label) + 1

    left = dict(elements)
    for card in job.model:
        if card.keyword not in CARDS:
            continue
        rows = _property(job, card)
        name = card.options.get("ELSET", "").upper()
        for label in sets.get(name, []):
            kind, nodes = elements[label]
            if TYPES[kind][0] != card.keyword:
                continue
            left.pop(label, None)
            places = [index(node) for node in nodes]
            if kind == "MASS":
                found.masses[f"mass_{label}"] = {"nodes": places, "mass": rows[0][0]}
                continue
            if kind == "ROTARYI":
                inertia = _inertia(card, rows)
                found.masses[f"inertia_{label}"] = {"nodes": places, "inertia": inertia}
                continue
            entry: dict[str, Any] = {"nodes": places[:1]}
            if len(places) > 1:
                entry["to_nodes"] = places[1:]
            key = "damping" if card.keyword == "DASHPOT" else "stiffness"
            entry[key] = _along(job, kind, rows)
            if kind == "SPRING2":
                _expect_on_line(job, label, deck.points[np.array(places) - 1], entry[key])
            found.springs[f"{card.keyword.lower()}_{label}"] = entry
    if left:
        label, (kind, _) = next(iter(left.items()))
        raise BodyError(f"{job.path}: element {label} ({kind}) has no *{TYPES[kind][0]}")
    if found.masses or found.springs:
        inertias = sum("inertia" in of for of in found.masses.values())
        masses, springs = len(found.masses) - inertias, len(found.springs)
        joined = "1 spring or dashpot" if springs == 1 else f"{springs} springs and dashpots"
        said = " and ".join(
            [counted(masses, "point mass")] * bool(masses)
            + [counted(inertias, "rotary inertia")] * bool(inertias)
            + [joined] * bool(springs)
        )
        found.remarks.append(f"part of the body: {said} of the deck")
    return found
