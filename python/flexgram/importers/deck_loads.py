"""Loads of a CalculiX deck's steps as inputs: ``*CLOAD``, ``*DLOAD``, ``*DSLOAD``,
``*TEMPERATURE``.

Every card is one load, whose input 1 is what the card says: ``step1_cload``, ``step1_dload``,
``step2_dload2``. Forces of pressure, gravity and spin are integrated as ccx does, at the points of
the stiffness. Amplitudes are histories of the input and no part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexgram.basics import BodyError, IntArray
from flexgram.faces import FACES, LINEAR, MIDDLES
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import SOLIDS, Deck
from flexgram.importers.fe import FeMatrices
from flexgram.loads import areas_at_nodes

Floats = NDArray[np.float64]

CARDS = ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE")
#: Options of a card by which it is something else than a force of its values.
OTHER = ("LOAD CASE", "SUBMODEL", "USER", "SECTOR", "OMEGA0", "FILE", "BSTEP")
#: Elements that carry no distributed loads.
POINTS = ("MASS", "SPRING", "DASHPOT", "GAP", "DCOUP")
#: Faces by CalculiX' numbers, corners from 1.
NUMBERED = {
    "tetra": ("123", "142", "243", "341"),
    "hexahedron": ("1234", "5876", "1562", "2673", "3784", "4851"),
    "wedge": ("123", "456", "1254", "2365", "3146"),
}


@dataclass
class DeckLoad:
    """A load of a card, in the deck's units.

    Attributes
    ----------
    name : str
    kind : str
        ``nodal`` or ``temperature``.
    table : (k, 4) or (k, 2) array
        Node labels with forces, or with temperatures above those without stress.
    """

    name: str
    kind: str
    table: Floats


class _Deck:
    """A deck's elements, materials and fields, as loads need them."""

    def __init__(self, job: Job, deck: Deck) -> None:
        self.job, self.deck = job, deck
        self.density: dict[int, float] = {}
        self.surfaces: dict[str, list[tuple[str, str]]] = {}
        self.start: dict[int, float] = {}
        of_material: dict[str, float] = {}
        material = ""
        for card in job.model:
            name = card.options.get("NAME", "").upper()
            if card.keyword == "MATERIAL":
                material = name
            elif card.keyword == "DENSITY":
                of_material[material] = self.number(card, next(card.words(), []), 0)
            elif card.keyword == "SURFACE" and card.options.get("TYPE", "").upper() != "NODE":
                self.surfaces[name] = [(row[0], row[1]) for row in card.words() if len(row) > 1]
            elif (card.keyword == "INITIAL CONDITIONS"
                  and card.options.get("TYPE", "").upper() == "TEMPERATURE"):  # fmt: skip
                for row in card.words():
                    for label in self.nodes(card, row[0]):
                        self.start[label] = self.number(card, row, 1)
        for card in job.model:
            if card.keyword == "SOLID SECTION":
                for label in deck.elsets.get(card.options.get("ELSET", "").upper(), ()):
                    name = card.options.get("MATERIAL", "").upper()
                    self.density[label] = of_material.get(name, 0.0)

    def wrong(self, card: Card, row: list[str], why: str) -> BodyError:
        if why.startswith(str(self.job.path)):
            return BodyError(why)
        return BodyError(f"{self.job.path}: *{card.keyword} {', '.join(row)!r}: {why}")

    def number(self, card: Card, row: list[str], at: int) -> float:
        try:
            value = float(row[at]) if at < len(row) and row[at] else 0.0
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.wrong(card, row, f"{row[at]!r} is no number")
        return value

    def _members(self, card: Card, word: str, sets: Any, known: Any, what: str) -> list[int]:
        if word.lstrip("-").isdigit():
            if int(word) not in known:
                raise self.wrong(card, [word], f"there is no {what} {word}")
            return [int(word)]
        if word.upper() not in sets:
            raise self.wrong(card, [word], f"there is no {what} set {word}")
        return [int(label) for label in sets[word.upper()]]

    def nodes(self, card: Card, word: str) -> list[int]:
        return self._members(card, word, self.deck.sets, self.deck.labels, "node")

    def elements(self, card: Card, word: str) -> list[int]:
        return self._members(card, word, self.deck.elsets, self.deck.elements, "element")

    def by_kind(self, labels: list[int]) -> Iterator[tuple[str, IntArray, IntArray]]:
        """Elements by their type: indices of their nodes, and their labels."""
        kinds: dict[str, list[int]] = {}
        for label in labels:
            kinds.setdefault(self.deck.elements[label][0], []).append(label)
        for kind, mine in kinds.items():
            nodes = np.array([self.deck.elements[label][1] for label in mine], dtype=np.int64)
            yield kind, np.searchsorted(self.deck.labels, nodes), np.array(mine)

    def pressure(self, labels: list[int], side: int, value: float) -> Floats:
        """Forces (N, 3) of a pressure on a face of elements, from 1."""
        forces = np.zeros_like(self.deck.points)
        for kind, nodes, _ in self.by_kind(labels):
            plain = LINEAR.get(kind, kind)
            if not 1 <= side <= len(NUMBERED[plain]):
                raise BodyError(f"{kind} has no face {side}")
            corners = {int(c) - 1 for c in NUMBERED[plain][side - 1]}
            face = next(face for face in FACES[plain] if set(face) == corners)
            middles = MIDDLES.get(kind, {})
            edges = zip(face, (*face[1:], face[0]), strict=True)
            between = [middles[frozenset(edge)] for edge in edges if middles]
            vectors, _ = areas_at_nodes(self.deck.points, [nodes[:, [*face, *between]]])
            forces -= value * vectors
        return forces

    def weight(self, labels: list[int], field: Callable[[Floats], Floats]) -> Floats:
        """Forces (N, 3) of a field of acceleration on elements."""
        import _flexgram

        forces = np.zeros_like(self.deck.points)
        for kind, nodes, mine in self.by_kind(labels):
            if kind == "wedge":
                raise BodyError("C3D6 are not integrated here")
            _, weight, N, dN = _flexgram.shape_functions(kind, np.empty((0, 3)))
            x = self.deck.points[nodes]
            volume = weight * np.linalg.det(np.einsum("qna,enx->eqax", dN, x))
            density = np.array([self.density.get(label, 0.0) for label in mine.tolist()])
            pull = field(np.einsum("qn,enx->eqx", N, x))
            np.add.at(forces, nodes,
                      np.einsum("eq,qn,eqx->enx", volume * density[:, None], N, pull))  # fmt: skip
        return forces


def _distributed(deck: _Deck, card: Card, row: list[str]) -> Floats | None:
    """Forces of a row of ``*DLOAD``; None: of a kind that is not followed here."""
    kind = row[1].upper()
    value = deck.number(card, row, 2)
    vector = np.array([deck.number(card, row, k) for k in range(3, 9)])
    elements = deck.elements(card, row[0])
    if kind == "GRAV":
        along = vector[:3]
        if not np.any(along):
            raise deck.wrong(card, row, "gravity without a direction")
        pull = value * along / np.linalg.norm(along)
        return deck.weight(elements, lambda x: np.broadcast_to(pull, x.shape))
    if kind == "CENTRIF":
        point, axis = vector[:3], vector[3:]
        if not np.any(axis):
            raise deck.wrong(card, row, "spin without an axis")
        axis = axis / np.linalg.norm(axis)
        return deck.weight(elements, lambda x: value * (
            x - point - ((x - point) @ axis)[..., None] * axis))  # fmt: skip
    if kind[:1] == "P" and kind[1:].isdigit():
        return deck.pressure(elements, int(kind[1:]), value)
    return None


def _forces(deck: _Deck, card: Card, left: list[str]) -> Floats:
    """Forces (N, 3) of a card; what of it is not followed is added to ``left``."""
    forces = np.zeros_like(deck.deck.points)
    for row in card.words():
        if len(row) < 3:
            raise deck.wrong(card, row, "expected where, what and how much")
        if card.keyword == "DLOAD":
            try:
                more = _distributed(deck, card, row)
            except BodyError as error:
                raise deck.wrong(card, row, str(error)) from None
            if more is None:
                left.append(f"{row[1]} of *DLOAD")
            else:
                forces += more
        elif card.keyword == "DSLOAD":
            if row[0].upper() not in deck.surfaces or row[1].upper() != "P":
                left.append(f"{row[1]} on {row[0]} of *DSLOAD")
                continue
            for where, side in deck.surfaces[row[0].upper()]:
                if not (side[:1].upper() == "S" and side[1:].isdigit()):
                    raise deck.wrong(card, row, f"{side} of surface {row[0]} is no face")
                forces += deck.pressure(deck.elements(card, where), int(side[1:]),
                                        deck.number(card, row, 2))  # fmt: skip
        else:
            direction = deck.number(card, row, 1)
            if direction not in (1, 2, 3):
                left.append(f"direction {row[1]} of *CLOAD {row[0]}")
                continue
            at = np.searchsorted(deck.deck.labels, deck.nodes(card, row[0]))
            np.add.at(forces[:, int(direction) - 1], at, deck.number(card, row, 2))
    return forces


def _temperature(deck: _Deck, card: Card) -> Floats:
    """Temperature (N,) above that of the beginning."""
    above = np.zeros(len(deck.deck.labels))
    for row in card.words():
        for label in deck.nodes(card, row[0]):
            at = np.searchsorted(deck.deck.labels, label)
            above[at] = deck.number(card, row, 1) - deck.start.get(label, 0.0)
    return above


def in_steps(job: Job) -> str:
    """The cards of loads that the steps of a deck hold."""
    words = dict.fromkeys(c.keyword for cards in job.steps for c in cards if c.keyword in CARDS)
    return ", ".join(f"*{word}" for word in words)


#: Cards by which nodes depend on others.
COUPLED = ("EQUATION", "MPC", "RIGID BODY", "TIE", "COUPLING", "KINEMATIC", "DISTRIBUTING",
           "DISTRIBUTING COUPLING", "TRANSFORM", "NETWORK MPC", "PRE-TENSION SECTION")  # fmt: skip


def attach_loads(fe: FeMatrices, job: Job, deck: Deck) -> None:
    """The loads of the deck as forces on the rows of its matrices, ``fe.loads``. What acts on rows
    that are not there is carried by the supports.

    Raises
    ------
    BodyError
        As ``loads_of``; and if nodes without rows may depend on others, or the rows are in axes of
        their own.
    """
    loads, remarks = loads_of(job, deck)
    coupled = sorted({card.keyword for card in job.model if card.keyword in COUPLED})
    where = {pair: row for row, pair in enumerate(zip(fe.node.tolist(), fe.component.tolist(),
                                                      strict=True))}  # fmt: skip
    for load in loads:
        if load.kind != "nodal":
            remarks.append(f"load {load.name} is left out: a temperature needs --assemble")
            continue
        forces = np.zeros(fe.n)
        for label, *force in load.table.tolist():
            for direction, value in enumerate(force):
                row = where.get((int(label), direction))
                if row is not None and "TRANSFORM" not in coupled:
                    forces[row] += value
                elif value and coupled:
                    raise BodyError(
                        f"{job.path}: load {load.name} acts on node {int(label)}, which may depend "
                        f"on others or have axes of its own (*{', *'.join(coupled)})"
                    )
        fe.loads[f"{load.name}.load"] = forces
    fe.remarks += remarks


def loads_of(job: Job, deck: Deck) -> tuple[list[DeckLoad], list[str]]:
    """The loads of all steps, and what of them is left out, in words.

    Raises
    ------
    BodyError
        For cards that cannot be meant.
    """
    loads: list[DeckLoad] = []
    remarks: list[str] = []
    every: _Deck | None = None
    others = sorted({
        kind for card in job.model if card.keyword == "ELEMENT"
        for kind in [card.options.get("TYPE", "").upper()]
        if not kind.startswith((*SOLIDS, *POINTS))
    })  # fmt: skip
    for number, step in enumerate(job.steps, 1):
        count: dict[str, int] = {}
        for card in step:
            if card.keyword not in CARDS:
                continue
            count[card.keyword] = count.get(card.keyword, 0) + 1
            again = str(count[card.keyword]) if count[card.keyword] > 1 else ""
            name = f"step{number}_{card.keyword.lower()}{again}"
            special = [key for key in OTHER if key in card.options]
            if special:
                remarks.append(f"load {name} is left out: *{card.keyword}, {special[0]}")
                continue
            if card.keyword != "CLOAD" and others:
                remarks.append(f"load {name} is left out: the deck has {', '.join(others)} "
                               "elements beside solids")  # fmt: skip
                continue
            every = every or _Deck(job, deck)
            left: list[str] = []
            if card.keyword == "TEMPERATURE":
                values, kind = _temperature(every, card)[:, None], "temperature"
            else:
                values, kind = _forces(every, card, left), "nodal"
            remarks += [f"load {name}: {what} is left out" for what in dict.fromkeys(left)]
            used = np.flatnonzero(np.any(values != 0, axis=1))
            if not len(used):
                if not left:
                    remarks.append(f"load {name} vanishes: it is left out")
                continue
            loads.append(DeckLoad(name, kind, np.column_stack([deck.labels[used], values[used]])))
            if "AMPLITUDE" in card.options:
                remarks.append(f"load {name}: its amplitude is left to the history of the input")
    return loads, remarks
