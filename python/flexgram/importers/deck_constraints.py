"""Equations, ties and multi-point constraints of a CalculiX or Abaqus deck, as a body's description
has them. TIE, PIN and BEAM of *MPC are Abaqus'; in a deck for CalculiX BEAM is refused, where it
keeps a distance and no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flexgram.basics import BodyError, Floats, errors_of
from flexgram.importers.alone import rigid_row, row_along
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import Deck
from flexgram.importers.deck_axes import axes_of_nodes
from flexgram.importers.deck_couplings import nodes_of_surfaces

#: Cards that are read here.
CARDS = {"EQUATION", "TIE", "MPC", "TRANSFORM"}
COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
#: Options of *TIE that are followed, or change nothing here: a gap needs no adjusted nodes.
OPTIONS = {"NAME", "POSITION TOLERANCE", "ADJUST", "TYPE", "NO ROTATION"}

Equation = list[list[Any]]  #: rows of a number of a node from 1, a component, a factor


def equations_of(job: Job, deck: Deck, *, abaqus: bool = False) -> dict[str, dict[str, Any]]:
    """Entries of ``equations`` of a description: of *EQUATION and *MPC; ``abaqus``: as Abaqus means
    them.

    Raises
    ------
    BodyError
        For equations that are not, and kinds of *MPC that are not supported.
    """
    for cards in job.steps:
        if some := [card.keyword for card in cards if card.keyword in CARDS]:
            raise BodyError(f"{job.path}: *{some[0]} in a step is not supported (--run-ccx)")
    axes = axes_of_nodes(job, deck)
    terms: dict[str, list[Equation]] = {"equation": [], "mpc": []}
    for card in job.model:
        if card.keyword == "EQUATION":
            terms["equation"] += _equations(job, deck, axes, card)
        elif card.keyword == "MPC":
            terms["mpc"] += _points(job, deck, axes, card, abaqus)
    return {name: {"terms": own} for name, own in terms.items() if own}


def along(axes: Mapping[int, Floats], label: int, number: int, c: int, factor: float) -> Equation:
    """Rows of a factor times a component, from 0, along the axes of a node of this number."""
    return row_along(number, c, factor, axes.get(label))


def _equations(job: Job, deck: Deck, axes: Mapping[int, Floats], card: Card) -> list[Equation]:
    """Each: how many terms, then node (or a set of as many nodes), direction and factor of each,
    some in a line."""
    where = f"{job.path}: *EQUATION"
    if card.options:
        raise BodyError(f"{where}: {next(iter(card.options))} is not supported: --run-ccx knows it")
    words = [word for row in card.words() for word in row if word]
    found: list[Equation] = []
    while words:
        with errors_of(where):
            count = int(words[0])
        own, words = words[1 : 1 + 3 * count], words[1 + 3 * count :]
        if count < 1 or len(own) < 3 * count:
            raise BodyError(f"{where}: expected {3 * count} entries, found {', '.join(own)!r}")
        columns: list[list[Equation]] = []
        for name, direction, factor in zip(own[::3], own[1::3], own[2::3], strict=True):
            labels = _members(job, deck, where, name)
            with errors_of(where):
                c, value = range(6)[int(direction) - 1], float(factor)
            columns.append([along(axes, n, deck.index(job.path, n) + 1, c, value) for n in labels])
        most = max(map(len, columns))
        columns = [column * most if len(column) == 1 else column for column in columns]
        if len({len(column) for column in columns}) > 1:
            raise BodyError(f"{where}: sets of {', '.join(str(len(c)) for c in columns)} nodes")
        found += [[row for term in terms for row in term] for terms in zip(*columns, strict=True)]
    return found


def _points(
    job: Job, deck: Deck, axes: Mapping[int, Floats], card: Card, abaqus: bool
) -> list[Equation]:
    """TIE, PIN and BEAM of *MPC: the first node follows the second, by BEAM as a rigid body."""
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    turning = deck.turning() | (set(deck.labels.tolist()) - used)
    found: list[Equation] = []
    for words in card.words():
        words = [word for word in words if word]
        where = f"{job.path}: *MPC {', '.join(words)}"
        kind = words[0].upper() if words else ""
        if kind not in ("TIE", "PIN", "BEAM") or len(words) != 3:
            raise BodyError(
                f"{where}: only TIE and PIN of two nodes are followed, and BEAM of Abaqus; "
                "*RIGID BODY and *EQUATION join nodes too"
            )
        if kind == "BEAM" and not abaqus:
            raise BodyError(
                f"{where}: say --format abaqus if it is a rigid beam, as in Abaqus; in CalculiX "
                "it keeps a distance and no more, which is not supported"
            )
        followers, leaders = (_members(job, deck, where, word) for word in words[1:])
        if len(leaders) not in (1, len(followers)):
            raise BodyError(f"{where}: sets of {len(followers)}, {len(leaders)} nodes")
        leaders = leaders * len(followers) if len(leaders) == 1 else leaders
        for first, second in zip(followers, leaders, strict=True):
            if {first, second} & set(axes):
                raise BodyError(f"{where}: axes of its nodes (*TRANSFORM) are not supported")
            if kind == "BEAM" and second not in turning:
                raise BodyError(
                    f"{where}: node {second} is one of solids, which has no rotations to follow: "
                    "put a node that no element has in the second place"
                )
            a, b = deck.index(job.path, first), deck.index(job.path, second)
            turns = {first, second} <= turning and kind != "PIN"
            arm = deck.points[a] - deck.points[b]
            for c in range(6 if turns else 3):
                if kind == "BEAM":
                    found.append(rigid_row(a + 1, b + 1, c, arm))
                else:
                    found.append([[a + 1, COMPONENTS[c], 1.0], [b + 1, COMPONENTS[c], -1.0]])
    return found


def _members(job: Job, deck: Deck, where: str, word: str) -> list[int]:
    """A node, or the nodes of a set in their order."""
    if word.isdigit():
        return [int(word)]
    name = word.upper()
    if name not in deck.sets:
        raise BodyError(f"{where}: there is no node set {word}")
    unsorted = any(
        card.keyword == "NSET"
        and card.options.get("NSET", "").upper() == name
        and "UNSORTED" in card.options
        for card in job.model
    )
    if unsorted or name in deck.repeated:
        raise BodyError(
            f"{where}: the order of node set {word} is not known here (UNSORTED, or nodes named "
            "twice): name one node after the other"
        )
    return [int(label) for label in deck.sets[name]]


def ties_of(job: Job, deck: Deck) -> dict[str, dict[str, Any]]:
    """Entries of ``ties`` of a description.

    Raises
    ------
    BodyError
        For surfaces that are not there, and options that are not supported.
    """
    cards = [card for card in job.model if card.keyword == "TIE"]
    surfaces = nodes_of_surfaces(job, deck) if cards else {}
    found: dict[str, dict[str, Any]] = {}
    for number, card in enumerate(cards, 1):
        name = card.options.get("NAME", f"tie{number}").lower()
        where = f"{job.path}: *TIE ({name})"
        if others := sorted(set(card.options) - OPTIONS):
            raise BodyError(f"{where}: {others[0]} is not supported by --assemble: take --run-ccx")
        for row, words in enumerate((w for w in card.words() if any(w)), 1):
            names = [word.upper() for word in words if word]
            if len(names) != 2 or not set(names) <= set(surfaces):
                raise BodyError(f"{where}: expected two surfaces that are there: slave, master")
            slave, master = ([deck.index(job.path, n) + 1 for n in surfaces[s]] for s in names)
            entry: dict[str, Any] = {"nodes": slave, "to": master}
            with errors_of(f"{where}: POSITION TOLERANCE"):
                tolerance = float(card.options.get("POSITION TOLERANCE") or 0.0)
            if tolerance > 0:
                entry["distance"] = tolerance
            if "NO ROTATION" in card.options:
                entry["rotations"] = "free"
            own = name if row == 1 else f"{name}_{row}"
            while own in found:
                own += "_"
            found[own] = entry
    return found
