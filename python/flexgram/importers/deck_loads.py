"""Loads of a CalculiX deck's steps as inputs: ``*CLOAD``, ``*DLOAD``, ``*DSLOAD``,
``*TEMPERATURE``.

Every card of forces is one load, whose input 1 is what the card says: ``step1_cload``,
``step1_dload``, ``step2_dload2``; the temperatures of a step are one. Forces of pressure, gravity
and spin are integrated by the elements' own functions, those of the body at the points of the
stiffness, as ccx does (but for C3D8R). Amplitudes are histories of the input.
"""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.face_integrals import areas_at_nodes
from flexgram.body.faces import FACES, LINEAR, MIDDLES
from flexgram.body.meshfile import SECOND_ORDER
from flexgram.body.second_order import Divided
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import (
    FORMULATIONS,
    LINE_KINDS,
    LINES,
    SHELL_KINDS,
    SHELLS,
    SOLIDS,
    Deck,
)
from flexgram.importers.deck_axes import axes_of_nodes
from flexgram.importers.fe import FeMatrices

CARDS = ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE")
#: Options of a card by which it is something else than a force of its values.
OTHER = ("LOAD CASE", "SUBMODEL", "USER", "SECTOR", "OMEGA0", "FILE", "BSTEP")
#: Sections of shells and membranes.
OF_SHELLS = ("SHELL SECTION", "MEMBRANE SECTION")
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
    table : (k, 4), (k, 7), (k, 2) or (k, 3) array
        Node labels with forces, with forces and moments, or with temperatures above those without
        stress and, of shells, their gradients along the normal.
    spins : bool
        Centrifugal forces (CENTRIF) are among it.
    """

    name: str
    kind: str
    table: Floats
    spins: bool = False


def _offset(card: Card) -> float:
    """OFFSET of a *SHELL SECTION, in thicknesses; of what is no number, some."""
    try:
        return float(card.options.get("OFFSET", "0"))
    except ValueError:
        return 1.0


class LeftOut(Exception):
    """A load that is not supported here, and why."""


class _Deck:
    """A deck's elements, materials and fields, as loads need them."""

    def __init__(self, job: Job, deck: Deck) -> None:
        self.job, self.deck = job, deck
        self.axes = axes_of_nodes(job, deck)
        self.density: dict[int, float] = {}  # of shells by area
        self.turning = deck.turning()
        self.offset: set[int] = set()  # shells whose middle is not at their nodes
        self.surfaces: dict[str, list[tuple[str, str]]] = {}
        self.start: dict[int, tuple[float, float]] = {}
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
            elif (
                card.keyword == "INITIAL CONDITIONS"
                and card.options.get("TYPE", "").upper() == "TEMPERATURE"
            ):
                for row in card.words():
                    for label in self.nodes(card, row[0]):
                        self.start[label] = self.number(card, row, 1), self.number(card, row, 2)
        for card in job.model:
            if card.keyword in ("SOLID SECTION", *OF_SHELLS):
                of_shells = card.keyword in OF_SHELLS
                name = card.options.get("MATERIAL", "").upper()
                density = of_material.get(name, 0.0)
                if of_shells and "COMPOSITE" in card.options:
                    layers = [row for row in card.words() if len(row) > 2]
                    density = sum(
                        self.number(card, row, 0) * of_material.get(row[2].upper(), 0.0)
                        for row in layers
                    )
                elif of_shells:
                    density *= self.number(card, next(card.words(), []), 0)
                for label in deck.elsets.get(card.options.get("ELSET", "").upper(), ()):
                    self.density[label] = density
                    self.offset.discard(label)
                    if of_shells and _offset(card) != 0:
                        self.offset.add(label)

    def initial(self) -> Floats:
        """Temperatures of the beginning and their gradients across shells, (N, 2)."""
        return np.array([self.start.get(label, (0.0, 0.0)) for label in self.deck.labels.tolist()])

    def wrong(self, card: Card, row: list[str], why: str) -> BodyError:
        if why.startswith(str(self.job.path)):
            return BodyError(why)
        return BodyError(f"{self.job.path}: *{card.keyword} {', '.join(row)!r}: {why}")

    def number(self, card: Card, row: list[str], at: int) -> float:
        try:
            word = row[at] if at < len(row) else ""
            value = float(re.sub("[dD]", "e", word)) if word else 0.0
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
        if word.upper() in self.deck.repeated:
            raise LeftOut(f"{what} set {word} names members twice, which ccx loads twice")
        return [int(label) for label in sets[word.upper()]]

    def nodes(self, card: Card, word: str) -> list[int]:
        return self._members(card, word, self.deck.sets, self.deck.labels, "node")

    def elements(self, card: Card, word: str) -> list[int]:
        if not word:  # of Abaqus: the whole model
            return [label for label in self.deck.elements if label in self.density]
        return self._members(card, word, self.deck.elsets, self.deck.elements, "element")

    def by_kind(
        self, labels: list[int], *, formulated: bool = False
    ) -> Iterator[tuple[str, Ints, Ints]]:
        """Elements by their type, or by type and formulation: indices of their nodes, and their
        labels."""
        kinds: dict[str, list[int]] = {}
        for label in labels:
            kind = self.deck.elements[label][0]
            formulation = FORMULATIONS.get(self.deck.types[label])
            if formulated and formulation:
                kind += f"/{formulation}"
            kinds.setdefault(kind, []).append(label)
        for kind, mine in kinds.items():
            nodes = np.array([self.deck.elements[label][1] for label in mine], dtype=np.int64)
            yield kind, np.searchsorted(self.deck.labels, nodes), np.array(mine)

    def pieces(self, kind: str, nodes: Ints) -> tuple[Floats, str, Ints]:
        """Points, kind and nodes of elements; of shells of second order and pyramids those of the
        elements that they become, whose new points are behind those of the deck."""
        points = self.deck.points
        if kind not in (*SECOND_ORDER, "pyramid"):
            return points, kind, nodes
        whole = Divided.of(kind, nodes, points, len(points))
        return np.vstack([points, whole.middles]), whole.kind, whole.cells

    def at_nodes(self, nodes: Ints, forces: Floats) -> Floats:
        """Forces at points of ``pieces`` of some elements, at the deck's nodes (N, 3): those in the
        middle of a shell at the four nodes beside it."""
        count = len(self.deck.points)
        whole = forces[:count].copy()
        if len(forces) > count:
            np.add.at(whole, nodes[:, 4:], forces[count:, None] / 4)
        return whole

    def pressure(self, labels: list[int], side: int, value: float) -> Floats:
        """Forces (N, 3) of a pressure on a face of elements, from 1; on shells, side 0, along
        their normals."""
        forces = np.zeros_like(self.deck.points)
        for kind, nodes, _ in self.by_kind(labels):
            if (kind in SHELL_KINDS) != (side == 0):
                raise BodyError(f"{kind} has no face {side or 'P'}")
            if side == 0:
                points, _, cells = self.pieces(kind, nodes)
                forces += self.at_nodes(nodes, value * areas_at_nodes(points, [cells])[0])
                continue
            plain = LINEAR.get(kind, kind)
            if plain not in NUMBERED or not 1 <= side <= len(NUMBERED[plain]):
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
        for whole, elements, mine in self.by_kind(labels, formulated=True):
            if whole in LINE_KINDS:
                raise LeftOut("body loads of beams and trusses are not integrated here")
            points, kind, nodes = self.pieces(whole, elements)
            _, weight, N, dN = _flexgram.shape_functions(kind, np.empty((0, 3)))
            x = points[nodes]
            J = np.einsum("qna,enx->eqax", dN, x)
            if kind.partition("/")[0] in SHELL_KINDS:
                if self.offset & set(mine.tolist()):
                    raise LeftOut("body loads of shells with an OFFSET are not integrated here")
                volume = weight * np.linalg.norm(np.cross(J[:, :, 0], J[:, :, 1]), axis=2)
            else:
                volume = weight * np.linalg.det(J)
            density = np.array([self.density.get(label, 0.0) for label in mine.tolist()])
            density = np.repeat(density, len(nodes) // len(elements))
            pull = field(np.einsum("qn,enx->eqx", N, x))
            own = np.zeros_like(points)
            np.add.at(own, nodes, np.einsum("eq,qn,eqx->enx", volume * density[:, None], N, pull))
            forces += self.at_nodes(elements, own)
        return forces


def _distributed(deck: _Deck, card: Card, row: list[str], spun: set[int]) -> Floats | None:
    """Forces of a row of ``*DLOAD``; None: of a kind that is not supported here. ``spun`` gains the
    elements that a centrifugal load of the step acts on: of several ccx takes the first."""
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
        if spun & set(elements):
            raise LeftOut("a second CENTRIF on an element, which ccx ignores")
        spun |= set(elements)
        return deck.weight(
            elements, lambda x: value * (x - point - ((x - point) @ axis)[..., None] * axis)
        )
    if kind == "P" or (kind[:1] == "P" and kind[1:].isdigit()):
        return deck.pressure(elements, int(kind[1:] or 0), value)
    return None


def _forces(deck: _Deck, card: Card, left: list[str], spun: set[int]) -> Floats:
    """Forces of a card (N, 3), or with moments at nodes of shells (N, 6); what of it is not
    followed is added to ``left``."""
    forces, moments = np.zeros_like(deck.deck.points), np.zeros_like(deck.deck.points)
    for row in card.words():
        if len(row) < 3:
            raise deck.wrong(card, row, "expected where, what and how much")
        if card.keyword == "DLOAD":
            try:
                more = _distributed(deck, card, row, spun)
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
                on_shells = {"SPOS": -1.0, "SNEG": 1.0}.get(side.upper())
                of_shells = any(
                    deck.deck.elements[e][0] in SHELL_KINDS for e in deck.elements(card, where)
                )
                if of_shells and on_shells is None:
                    left.append(f"{side or 'no side'} of shells in surface {row[0]} of *DSLOAD")
                    continue
                if on_shells is None and not (side[:1].upper() == "S" and side[1:].isdigit()):
                    raise deck.wrong(card, row, f"{side} of surface {row[0]} is no face")
                forces += deck.pressure(
                    deck.elements(card, where),
                    0 if on_shells else int(side[1:]),
                    deck.number(card, row, 2) * (on_shells or 1.0),
                )
        else:
            direction = deck.number(card, row, 1)
            nodes = deck.nodes(card, row[0])
            turns = direction in (4, 5, 6) and deck.turning.issuperset(nodes)
            if direction not in (1, 2, 3) and not turns:
                left.append(f"direction {row[1]} of *CLOAD {row[0]}")
                continue
            into = moments if turns else forces
            at = np.searchsorted(deck.deck.labels, nodes)
            np.add.at(into[:, (int(direction) - 1) % 3], at, deck.number(card, row, 2))
    if card.keyword == "CLOAD":
        for label, axes in deck.axes.items():
            row_of = int(np.searchsorted(deck.deck.labels, label))
            for vectors in (forces, moments):
                vectors[row_of] = vectors[row_of] @ axes
    return np.hstack([forces, moments]) if moments.any() else forces


def _temperature(deck: _Deck, card: Card, now: Floats) -> None:
    """The temperatures and their gradients across shells (N, 2) after a card."""
    if card.options.get("OP", "").upper() == "NEW":
        now[:] = deck.initial()
    for row in card.words():
        at = np.searchsorted(deck.deck.labels, deck.nodes(card, row[0]))
        now[at] = deck.number(card, row, 1), deck.number(card, row, 2)


def in_steps(job: Job) -> str:
    """The cards of loads that the steps of a deck hold."""
    words = dict.fromkeys(c.keyword for cards in job.steps for c in cards if c.keyword in CARDS)
    return ", ".join(f"*{word}" for word in words)


def held_of(job: Job, deck: Deck) -> set[tuple[int, int]]:
    """Nodes and directions, from 0, that a *BOUNDARY holds somewhere in the deck."""
    held = set()
    for card in (c for cards in (job.model, *job.steps) for c in cards):
        if card.keyword != "BOUNDARY":
            continue
        for row in card.words():
            try:
                first = int(row[1])
                last = int(row[2]) if len(row) > 2 and row[2] else first
                labels = [int(row[0])] if row[0].isdigit() else deck.sets[row[0].upper()].tolist()
            except (IndexError, ValueError, KeyError):
                continue  # ccx has run: it is of another kind
            held |= {(label, d - 1) for label in labels for d in range(first, last + 1)}
    return held


def attach_loads(fe: FeMatrices, job: Job, deck: Deck) -> None:
    """The loads of the deck as forces on the rows of its matrices, ``fe.loads``. What acts on rows
    that a *BOUNDARY holds is carried by it.

    Raises
    ------
    BodyError
        As ``loads_of``.
    """
    loads, remarks = loads_of(job, deck, known=SOLIDS)  # ccx makes other nodes of shells
    turned = any(card.keyword == "TRANSFORM" for card in job.model)
    held = held_of(job, deck) if loads else set()
    where: dict[tuple[int, int], int] = {}
    several: set[tuple[int, int]] = set()
    for row, place in enumerate(zip(fe.node.tolist(), fe.component.tolist(), strict=True)):
        if place in where:
            several.add(place)
        where[place] = row
    for load in loads:
        if load.kind != "nodal":
            remarks.append(f"load {load.name} is left out: a temperature needs --assemble")
            continue
        forces, why = np.zeros(fe.n), "the nodes have axes of their own (*TRANSFORM)"
        good = not turned
        for label, *force in load.table.tolist() if good else ():
            for direction, value in enumerate(force):
                place = int(label), direction
                if place in where and place not in several:
                    forces[where[place]] += value
                elif value and place not in held:
                    good, why = (
                        False,
                        (
                            f"node {place[0]} has no row of its own in direction "
                            f"{direction + 1}: it depends on others"
                        ),
                    )
        if good:
            fe.loads[f"{load.name}.load"] = forces
        else:
            remarks.append(f"load {load.name} is left out: {why}")
    fe.remarks += remarks


def loads_of(
    job: Job, deck: Deck, known: Iterable[str] = (*SOLIDS, *SHELLS, *LINES)
) -> tuple[list[DeckLoad], list[str]]:
    """The loads of all steps, and what of them is left out, in words. Forces of each card by
    themselves; temperatures as they are at the end of a step that has such cards. All are left out
    of a deck with other elements than ``known``, points apart.

    Raises
    ------
    BodyError
        For cards that cannot be meant.
    """
    others = sorted(
        {
            kind
            for card in job.model
            if card.keyword == "ELEMENT"
            for kind in [card.options.get("TYPE", "").upper()]
            if not kind.startswith((*known, *POINTS))
        }
    )
    if others and in_steps(job):
        return [], [
            f"the loads of the deck are left out: it has {', '.join(others)} elements beside solids"
        ]
    found = _Loads(job, deck)
    for number, step in enumerate(job.steps, 1):
        found.step(number, step)
    return found.loads, found.remarks


class _Loads:
    """The loads of a deck, step by step."""

    def __init__(self, job: Job, deck: Deck) -> None:
        self.loads: list[DeckLoad] = []
        self.remarks: list[str] = []
        self.deck = _Deck(job, deck) if in_steps(job) else None
        self.now = self.deck.initial() if self.deck else np.empty(0)

    def step(self, number: int, cards: Sequence[Card]) -> None:
        count: dict[str, int] = {}
        spun: set[int] = set()
        for card in cards:
            near = difflib.get_close_matches(card.keyword, (*CARDS, "BOUNDARY"), 1, 0.8)
            if near and card.keyword not in (*CARDS, "BOUNDARY"):
                self.remarks.append(f"*{card.keyword} is passed over: did you mean *{near[0]}?")
            if card.keyword not in CARDS or self.deck is None:
                continue
            count[card.keyword] = count.get(card.keyword, 0) + 1
            again = str(count[card.keyword]) if count[card.keyword] > 1 else ""
            name = f"step{number}_{card.keyword.lower()}"
            special = [key for key in OTHER if key in card.options]
            try:
                if special:
                    raise LeftOut(f"*{card.keyword}, {special[0]}")
                if card.keyword == "TEMPERATURE":
                    _temperature(self.deck, card, self.now)
                    self._amplitude(name, card, ", which multiplies T in ccx and T - T0 here,")
                    continue
                left: list[str] = []
                before = len(spun)
                forces = _forces(self.deck, card, left, spun)
                self.remarks += [
                    f"load {name + again}: {what} is left out" for what in dict.fromkeys(left)
                ]
                has_rows = any(True for _ in card.words())
                self._add(name + again, "nodal", forces, bool(left), len(spun) > before, has_rows)
                self._amplitude(name + again, card)
            except LeftOut as reason:
                self.remarks.append(f"load {name + again} is left out: {reason}")
        if self.deck is not None and "TEMPERATURE" in count:
            if not self.deck.start:
                self.remarks.append(
                    "no *INITIAL CONDITIONS, TYPE=TEMPERATURE: temperatures count from 0"
                )
            above = self.now - self.deck.initial()
            deck = self.deck.deck
            of_shells = [nodes for kind, nodes in deck.elements.values() if kind in SHELL_KINDS]
            on_shells = np.isin(deck.labels, list(itertools.chain(*of_shells)))
            above[~on_shells, 1] = 0
            columns = 2 if above[:, 1].any() else 1
            self._add(f"step{number}_temperature", "temperature", above[:, :columns], False)

    def _amplitude(self, name: str, card: Card, more: str = "") -> None:
        if "AMPLITUDE" in card.options:
            self.remarks.append(
                f"load {name}: its amplitude{more} is left to the history of the input"
            )

    def _add(
        self,
        name: str,
        kind: str,
        values: Floats,
        excused: bool,
        spins: bool = False,
        has_rows: bool = True,
    ) -> None:
        assert self.deck is not None
        used = np.flatnonzero(np.any(values != 0, axis=1))
        if len(used):
            labels = self.deck.deck.labels[used]
            table = np.column_stack([labels, values[used]])
            self.loads.append(DeckLoad(name, kind, table, spins))
        elif not excused and has_rows:
            self.remarks.append(f"load {name} vanishes: it is left out")
