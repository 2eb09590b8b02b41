"""Grids of Nastran bulk data that no element has: springs, equations and beams beside them hold
these."""

from __future__ import annotations

import numpy as np

from flexgram.importers.nastran_deck import SPRINGS, BulkDeck
from flexgram.importers.nastran_elements import Elements


def grids_alone(deck: BulkDeck, elements: Elements) -> list[int]:
    """Grids that something else than elements and whole rigid bodies joins, ascending."""
    references, means, partial = _of_rigid_elements(deck, elements)
    joined = set(partial)
    joined |= means & {int(getattr(mass, "nid", 0) or 0) for mass in deck.model.masses.values()}
    joined |= {arm.grid for arm in elements.arms}
    joined |= {int(n) for cards in deck.model.mpcs.values() for card in cards
               for n in card.node_ids if n in deck.model.nodes}  # fmt: skip
    for _, element in elements.later:
        if element.type in SPRINGS:
            given = element.nodes if hasattr(element, "nodes") else element.node_ids
            ends = [int(n) for n in given if n and int(n) in deck.model.nodes]
            places = [deck.points[deck.at(n)] for n in ends]
            apart = len(ends) == 2 and bool(np.any(places[0] != places[1]))
            joined |= {n for n in ends if apart or n not in references}
    joined |= _with_masses(deck)
    known = set(map(int, deck.labels))
    return sorted((joined & known) - elements.used)


def _with_masses(deck: BulkDeck) -> set[int]:
    """Grids with a mass that a RBE2 or RBAR moves."""
    moved: set[int] = set()
    for element in deck.model.rigid_elements.values():
        if element.type == "RBE2":
            moved |= {int(n) for n in element.Gmi}
        elif element.type == "RBAR":
            leads = set(str(element.cna)) >= set("123456")
            moved.add(int(element.Gb() if leads else element.Ga()))
    return moved & {int(mass.nid) for mass in deck.model.masses.values() if mass.type == "CONM2"}


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
