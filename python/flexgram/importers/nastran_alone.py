"""Grids of Nastran bulk data that no element has: springs, equations and beams beside them hold
these."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexgram.importers.nastran_deck import SPRINGS, BulkDeck
from flexgram.importers.nastran_elements import Elements


def grids_alone(deck: BulkDeck, elements: Elements) -> list[int]:
    """Grids that something else than elements and whole rigid bodies joins, ascending."""
    references, means, partial = _of_rigid_elements(deck, elements)
    joined = set(partial)
    with_mass = {n for mass in deck.model.masses.values() for n in _grids_of(mass)}
    joined |= means & with_mass
    joined |= {arm.grid for arm in elements.arms}
    joined |= {int(n) for cards in deck.model.mpcs.values() for card in cards
               for n in card.node_ids if n in deck.model.nodes}  # fmt: skip
    for _, element in elements.later:
        if element.type in SPRINGS:
            given = element.nodes if hasattr(element, "nodes") else element.node_ids
            joined |= _ends(deck, element, [int(n) for n in given if n], references)
        elif element.type == "CSHEAR":
            joined |= {int(n) for n in element.node_ids}
    for mass in deck.model.masses.values():
        if len(_grids_of(mass)) == 2:
            joined |= set(_grids_of(mass))
    joined |= _moved(deck) & with_mass
    known = set(map(int, deck.labels))
    return sorted((joined & known) - elements.used)


def _ends(deck: BulkDeck, element: Any, given: list[int], references: set[int]) -> set[int]:
    """Grids of a spring that need a node: not those of interfaces, if it is between two nodes in
    one place, or from one to ground."""
    ends = [n for n in given if n in deck.model.nodes]
    places = [deck.points[deck.at(n)] for n in ends]
    components = {getattr(element, key, 0) or 0 for key in ("c1", "c2")}
    apart = len(ends) == 2 and (bool(np.any(places[0] != places[1])) or len(components) > 1)
    return {n for n in ends if apart or len(ends) < len(given) or n not in references}


def _grids_of(mass: Any) -> list[int]:
    """Of CONM1, CONM2 and CMASS, those that there are."""
    if hasattr(mass, "nid"):
        return [int(mass.nid)]
    return [int(n) for n in getattr(mass, "nodes", []) if n]


def _moved(deck: BulkDeck) -> set[int]:
    """Grids that a RBE2 or RBAR moves."""
    moved: set[int] = set()
    for element in deck.model.rigid_elements.values():
        if element.type == "RBE2":
            moved |= {int(n) for n in element.Gmi}
        elif element.type == "RBAR":
            leads = set(str(element.cna)) >= set("123456")
            moved.add(int(element.Gb() if leads else element.Ga()))
    return moved


def _of_rigid_elements(deck: BulkDeck, elements: Elements) -> tuple[set[int], set[int], set[int]]:
    """Grids that move others as a whole, and those that are the mean of their displacements, which
    become references of interfaces; and those of rigid elements of some components, and of means
    of others."""
    references: set[int] = set()
    means: set[int] = set()
    partial: set[int] = set()
    for element in deck.model.rigid_elements.values():
        if element.type == "RBE3":
            moved = int(element.ref_grid_id)
            (means if {str(c) for c in element.comps} == {"123"} else partial).add(moved)
        elif element.type == "RBE2":
            nodes, coupled = {int(n) for n in element.Gmi}, set(str(element.cm))
            whole = coupled >= set("123456")
            if whole or (coupled >= set("123") and not elements.turning & nodes):
                references.add(int(element.Gn()))
            else:
                partial |= {int(element.Gn()), *nodes}
    return references, means, partial
