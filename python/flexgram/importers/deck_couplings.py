"""Rigid bodies and couplings of a CalculiX or Abaqus deck as interfaces of a description."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexgram.basics import BodyError
from flexgram.body.faces import LINEAR, MIDDLES
from flexgram.importers.alone import COMPONENTS, hold_untouched, mean_rows, rigid_row
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import TURNING, Deck
from flexgram.importers.deck_loads import NUMBERED

#: Cards that are read here.
CARDS = {"RIGID BODY", "COUPLING", "KINEMATIC", "DISTRIBUTING"}


@dataclass(frozen=True)
class Coupling:
    """A reference node that moves others, or is their mean.

    Attributes
    ----------
    name : str
        Of the interface.
    kind : str
        ``rigid`` or ``distributing``.
    reference : int
        Label of the node.
    rotation : int or None
        That whose displacements are the rotations.
    nodes : tuple of int
        Labels.
    directions : frozenset of int
        From 1, if not all.
    """

    name: str
    kind: str
    reference: int
    rotation: int | None
    nodes: tuple[int, ...]
    directions: frozenset[int] = frozenset()

    def equations(self, deck: Deck, turning: Collection[int]) -> list[list[list[Any]]]:
        """Rows by which the nodes follow the reference as a rigid body, in its directions."""
        at = np.searchsorted(deck.labels, [self.reference, *self.nodes])
        found = []
        for label, place in zip(self.nodes, at[1:].tolist(), strict=True):
            arm = deck.points[place] - deck.points[at[0]]
            for c in range(6 if label in turning else 3):
                if not self.directions or c + 1 in self.directions:
                    found.append(rigid_row(place + 1, int(at[0]) + 1, c, arm))
        return found

    def turns(self, deck: Deck) -> bool:
        """Whether all displacements of the nodes follow, which do not lie on a line, so that these
        feel whatever the reference does."""
        return self.directions >= {1, 2, 3} and not self.on_a_line(deck)

    def is_hinge(self, deck: Deck) -> bool:
        """Whether the displacements alone follow, of nodes on a line: the reference can turn about
        that line without moving them."""
        return self.kind == "rigid" and self.directions == {1, 2, 3} and self.on_a_line(deck)

    def on_a_line(self, deck: Deck) -> bool:
        """Whether a turn about some line moves none of the nodes."""
        x = deck.points[np.searchsorted(deck.labels, list(self.nodes))]
        spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
        return len(x) < 3 or float(spread[1]) <= 1e-6 * float(spread[0])

    def entry(self, deck: Deck) -> dict[str, Any]:
        """Of ``interfaces`` of a description."""
        at = np.searchsorted(deck.labels, [self.reference, *self.nodes])
        return {
            "coupling": self.kind,
            "nodes": (at[1:] + 1).tolist(),
            "position": deck.points[at[0]].tolist(),
        }


def couplings_of(job: Job, deck: Deck) -> list[Coupling]:
    """Those of the model.

    Raises
    ------
    BodyError
        For those that are not supported.
    """
    used = {n for _, nodes in deck.elements.values() for n in nodes}
    turning = deck.turning()
    surfaces = nodes_of_surfaces(job, deck)
    found: list[Coupling] = []
    begun: Card | None = None
    for card in job.model:
        if card.keyword == "RIGID BODY":
            found.append(_rigid(job, deck, card, used, turning))
        elif card.keyword == "COUPLING":
            begun = card
        elif card.keyword in ("KINEMATIC", "DISTRIBUTING"):
            if begun is None:
                raise BodyError(f"{card.place} without *COUPLING")
            found.append(_coupling(job, deck, begun, card, surfaces, used, turning))
            begun = None
    references = [coupling.reference for coupling in found]
    for coupling in found:
        where = f"{job.path}: {coupling.name}"
        if references.count(coupling.reference) > 1:
            raise BodyError(f"{where}: node {coupling.reference} is the reference of another, too")
        if set(coupling.nodes) & set(references):
            raise BodyError(f"{where}: moves the reference of another: chains are not supported")
    return found


#: Sets of *RIGID BODY. Of CalculiX (NSET) and of PIN NSET the displacements follow, not the
#: rotations of shells and beams.
RIGID, PINNED = ("NSET", "ELSET", "TIE NSET", "PIN NSET"), ("NSET", "PIN NSET")


def _rigid(job: Job, deck: Deck, card: Card, used: Collection[int], turning: set[int]) -> Coupling:
    given = [key for key in RIGID if key in card.options]
    name = card.options[given[0]].upper() if given else ""
    where = f"{job.path}: *RIGID BODY ({name or 'without NSET'})"
    if others := sorted(set(card.options) - {*given[:1], "REF NODE", "ROT NODE"}):
        raise BodyError(f"{where}: {others[0]} is not supported by --assemble")
    if "REF NODE" not in card.options or name not in deck.sets:
        raise BodyError(f"{where}: needs a REF NODE, and a node or element set that is there")
    turn = card.options.get("ROT NODE")
    reference = _reference(deck, where, card.options["REF NODE"])
    nodes = tuple(int(n) for n in deck.sets[name] if int(n) in used)
    if not nodes:
        raise BodyError(f"{where}: no element has its nodes")
    own = {1, 2, 3} if given[0] in PINNED and turning & set(nodes) else set[int]()
    rotation = None if turn is None else int(turn)
    return Coupling(_interface(name), "rigid", reference, rotation, nodes, frozenset(own))


def _coupling(
    job: Job,
    deck: Deck,
    card: Card,
    kind: Card,
    surfaces: Mapping[str, list[int]],
    used: Collection[int],
    turning: set[int],
) -> Coupling:
    name = card.options.get("CONSTRAINT NAME", card.options.get("SURFACE", "")).upper()
    where = f"{job.path}: *COUPLING ({name})"
    surface = card.options.get("SURFACE", "").upper()
    if "REF NODE" not in card.options or surface not in surfaces:
        raise BodyError(f"{where}: needs a REF NODE, and a SURFACE that is there")
    known = {"CONSTRAINT NAME", "SURFACE", "REF NODE"}
    if others := sorted(set(card.options) - known):
        raise BodyError(f"{where}: {others[0]} is not supported by --assemble")
    weighting = kind.options.get("WEIGHTING METHOD", "UNIFORM").upper()
    if weighting != "UNIFORM":
        raise BodyError(f"{where}: WEIGHTING METHOD={weighting} is not supported by --assemble")
    directions: set[int] = set()
    for words in kind.words():
        rows = [int(word) for word in words if word]
        directions |= set(range(rows[0], rows[-1] + 1)) if rows else set()
    all_of = set(range(1, 7)) if turning & set(surfaces[surface]) else {1, 2, 3}
    some = kind.keyword == "KINEMATIC" and directions and not all_of <= directions
    nodes = tuple(n for n in surfaces[surface] if n in used)
    if not nodes:
        raise BodyError(f"{where}: no element has the nodes of surface {surface}")
    coupling = "rigid" if kind.keyword == "KINEMATIC" else "distributing"
    reference = _reference(deck, where, card.options["REF NODE"])
    own = frozenset(directions) if some else frozenset[int]()
    return Coupling(_interface(name), coupling, reference, None, nodes, own)


def _interface(name: str) -> str:
    """Name of an interface, of a set that may be one of an instance."""
    return name.lower().replace(".", "_")


def _reference(deck: Deck, where: str, word: str) -> int:
    """A node, or a set of one."""
    if word.isdigit():
        return int(word)
    members = deck.sets.get(word.upper())
    if members is None or len(members) != 1:
        raise BodyError(f"{where}: REF NODE={word} must be a node, or a set of one node")
    return int(members[0])


def nodes_of_surfaces(job: Job, deck: Deck) -> dict[str, list[int]]:
    """Nodes of surfaces, of nodes and of faces."""
    found: dict[str, list[int]] = {}
    for card in (card for card in job.model if card.keyword == "SURFACE"):
        nodes: set[int] = set()
        for words in card.words():
            where = words[0].upper()
            if card.options.get("TYPE", "").upper() == "NODE":
                nodes |= (
                    {int(where)} if where.isdigit() else set(map(int, deck.sets.get(where, ())))
                )
                continue
            elements = [int(where)] if where.isdigit() else deck.elsets.get(where, [])
            side = words[1].upper() if len(words) > 1 else ""
            for element in elements:
                if element in deck.elements:
                    nodes |= _face(job, card, *deck.elements[element], side)
        found[card.options.get("NAME", "").upper()] = sorted(nodes)
    return found


def _face(job: Job, card: Card, kind: str, nodes: list[int], side: str) -> set[int]:
    if kind in TURNING:
        return set(nodes)
    plain = LINEAR.get(kind, kind)
    number = int(side[1:]) if side[:1] == "S" and side[1:].isdigit() else 0
    if not 1 <= number <= len(NUMBERED.get(plain, ())):
        name = card.options.get("NAME", "")
        raise BodyError(f"{job.path}: *SURFACE {name}: {kind} has no face {side}")
    corners = [int(c) - 1 for c in NUMBERED[plain][number - 1]]
    middles = [
        middle for edge, middle in MIDDLES.get(kind, {}).items() if edge <= frozenset(corners)
    ]
    return {nodes[k] for k in (*corners, *middles)}


def hold_references(job: Job, held: dict[int, set[str]], couplings: Sequence[Coupling]) -> None:
    """The nodes of a coupling whose reference is held as a whole are held, instead of it."""
    for coupling in couplings:
        directions = held.pop(coupling.reference, set())
        if coupling.rotation is not None:
            directions |= {f"r{axis}" for axis in held.pop(coupling.rotation, set())}
        if not directions:
            continue
        if directions != set(COMPONENTS) and coupling.kind == "rigid":
            held[coupling.reference] = directions  # a node of the body
            continue
        if coupling.kind != "rigid":
            raise BodyError(
                f"{job.path}: the reference node {coupling.reference} of {coupling.name}, which is "
                "distributing, is held: take --run-ccx"
            )
        moved = {COMPONENTS[c - 1] for c in coupling.directions} or set(COMPONENTS)
        for label in coupling.nodes:
            held.setdefault(label, set()).update(moved)


FREE_ROTATIONS = (
    "rotations of shells and beams do not follow its reference (they do by directions 4 to 6 of "
    "*KINEMATIC, or TIE NSET of *RIGID BODY)"
)


def _ground(content: dict[str, Any], number: int) -> None:
    """A node that is held carries no mass, and springs end at the ground there."""
    masses, springs = content["masses"], content["springs"]
    for name in [name for name, of in masses.items() if of.get("nodes") == [number]]:
        del masses[name]
    for name, of in list(springs.items()):
        if of.get("to_nodes") == [number]:
            del of["to_nodes"]
        elif of.get("nodes") == [number] and "to_nodes" in of:
            of["nodes"] = of.pop("to_nodes")
        elif of.get("nodes") == [number]:
            del springs[name]


def _carry(
    job: Job, deck: Deck, coupling: Coupling, content: dict[str, Any], has_rotations: bool
) -> None:
    """The reference of a distributing coupling that carries something: a node of the body, which
    has the mean motion of the others."""
    at, *others = np.searchsorted(deck.labels, [coupling.reference, *coupling.nodes]).tolist()
    numbers = [k + 1 for k in others]
    try:
        rows = mean_rows(at + 1, deck.points[at], numbers, deck.points[others])
    except BodyError as error:
        raise BodyError(f"{job.path}: *COUPLING ({coupling.name}): {error}") from None
    content["equations"][coupling.name] = {"terms": rows if has_rotations else rows[:3]}
    if has_rotations:
        content["interfaces"][coupling.name] = {"coupling": "node", "nodes": [at + 1]}


def _joined_nodes(
    deck: Deck,
    couplings: Sequence[Coupling],
    content: dict[str, Any],
    used: Collection[int],
    alone: Collection[int],
) -> list[int]:
    """Nodes (from 1) of no element that equations and springs join to the body, where there are
    masses perhaps."""
    joined = {
        term[0] for of in content["equations"].values() for row in of["terms"] for term in row
    }
    for spring in content["springs"].values():
        joined |= {*spring.get("nodes", ()), *spring.get("to_nodes", ())}
    if not joined:
        return []
    taken = np.array([*used, *(coupling.reference for coupling in couplings)], dtype=np.int64)
    others = np.searchsorted(deck.labels, taken) + 1
    return sorted(joined - set(others.tolist()) - set(alone))


def add_couplings(
    job: Job, deck: Deck, couplings: Sequence[Coupling], content: dict[str, Any]
) -> list[str]:
    """Their interfaces, unless they are held, and what is at their reference nodes. Those of some
    directions, and those whose reference is held in some, become equations. Returns what is to be
    said."""
    remarks: list[str] = []
    alone: list[int] = []
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    held = {i for s in content["supports"].values() for i in s["nodes"]}
    for coupling in couplings:
        entry = coupling.entry(deck)
        number = deck.index(job.path, coupling.reference) + 1
        if coupling.kind == "rigid" and set(entry["nodes"]) <= held:
            _ground(content, number)
            remarks.append(
                f"{coupling.name} is no interface: its reference, and so its nodes, are held"
            )
            continue
        if coupling.directions or number in held:
            if coupling.name in content["equations"]:
                raise BodyError(f"two couplings are named {coupling.name}: CONSTRAINT NAME them")
            terms = coupling.equations(deck, deck.turning())
            content["equations"][coupling.name] = {"terms": terms}
            alone += [number] if coupling.reference not in used else []
            if coupling.kind == "rigid" and coupling.turns(deck) and number not in held:
                content["interfaces"].setdefault(
                    coupling.name, {"coupling": "node", "nodes": [number]}
                )
                remarks.append(f"{coupling.name}: {FREE_ROTATIONS}")
                continue
            why = (
                "its reference is held in some directions"
                if number in held
                else (
                    "it moves others in some directions; --node makes one of node "
                    f"{coupling.reference}"
                )
            )
            remarks.append(f"{coupling.name} is no interface: {why}")
            if coupling.is_hinge(deck) and number in alone and number not in held:
                remarks.append(
                    f"{coupling.name} moves displacements alone, of nodes on a line: its "
                    f"reference, node {coupling.reference}, turns freely about that line unless "
                    "something else holds it"
                )
            continue
        if coupling.name in content["interfaces"]:
            raise BodyError(f"interface {coupling.name} is given twice: it is one of the deck's")
        is_loaded = coupling.reference in used or any(
            of.get(key) == [number]
            for entries in (content["masses"], content["springs"])
            for of in entries.values()
            for key in ("nodes", "to_nodes")
        )
        if coupling.kind == "distributing" and is_loaded:
            is_alone = coupling.reference not in used
            has_rotations = is_alone or coupling.reference in deck.turning()
            _carry(job, deck, coupling, content, has_rotations)
            alone += [number] * is_alone
            continue
        content["interfaces"][coupling.name] = entry
        if coupling.reference in used:
            if coupling.kind == "rigid":
                entry["nodes"].append(number)
            continue
        for entries in (content["masses"], content["springs"]):
            for of in entries.values():
                for nodes, interface in (("nodes", "at"), ("to_nodes", "to")):
                    if of.get(nodes) == [number]:
                        del of[nodes]
                        of[interface] = coupling.name
    alone += _joined_nodes(deck, couplings, content, used, alone)
    if alone:
        content["nodes_alone"] = alone
        hold_untouched(content, deck.points)
    return remarks
