"""Grids of Nastran bulk data that no element has: springs, equations and beams beside them hold
these."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexgram.basics import Floats
from flexgram.importers.nastran_deck import SPRINGS, BulkDeck
from flexgram.importers.nastran_elements import Elements

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


def grids_alone(deck: BulkDeck, elements: Elements) -> list[int]:
    """Grids that something else than elements and whole rigid bodies joins, ascending."""
    references, partial = _of_rigid_elements(deck, elements)
    joined = set(partial)
    joined |= {arm.grid for arm in elements.arms}
    joined |= {int(n) for cards in deck.model.mpcs.values() for card in cards
               for n in card.node_ids if n in deck.model.nodes}  # fmt: skip
    for _, element in elements.later:
        if element.type in SPRINGS:
            given = element.nodes if hasattr(element, "nodes") else element.node_ids
            joined |= {int(n) for n in given if n and int(n) not in references}
    known = set(map(int, deck.labels))
    return sorted((joined & known) - elements.used)


def _of_rigid_elements(deck: BulkDeck, elements: Elements) -> tuple[set[int], set[int]]:
    """Grids that move others as a whole, or are the mean of their displacements, which become
    references of interfaces; and those of rigid elements of some components, and of means of
    others."""
    references: set[int] = set()
    partial: set[int] = set()
    for element in deck.model.rigid_elements.values():
        if element.type == "RBE3":
            moved = int(element.ref_grid_id)
            (references if {str(c) for c in element.comps} == {"123"} else partial).add(moved)
        elif element.type == "RBE2":
            nodes, coupled = {int(n) for n in element.Gmi}, set(str(element.cm))
            whole = coupled >= set("123456")
            if whole or (coupled >= set("123") and not elements.turning & nodes):
                references.add(int(element.Gn()))
            else:
                partial |= {int(element.Gn()), *nodes}
    return references, partial


def untouched(alone: list[int], content: Mapping[str, Any], points: Floats) -> dict[int, list[str]]:
    """Components of nodes alone (from 1) that no equation, spring, mass or interface touches, and
    no support holds."""
    touched = {node: np.zeros((6, 6)) for node in alone}
    for entry in content["equations"].values():
        for equation in entry["terms"]:
            for node in {term[0] for term in equation} & set(touched):
                row = np.zeros(6)
                for _, component, factor in (term for term in equation if term[0] == node):
                    row[COMPONENTS.index(component)] += factor
                touched[node] += np.outer(row, row)
    for entry in content["springs"].values():
        ends = [entry[key][0] for key in ("nodes", "to_nodes") if len(entry.get(key, [])) == 1]
        for node in set(ends) & set(touched):
            arm = np.mean(points[[n - 1 for n in ends]], axis=0) - points[node - 1]
            carried = np.eye(6)
            carried[:3, 3:] = np.column_stack([np.cross(e, arm) for e in np.eye(3)])
            for matrix in (entry.get("stiffness"), entry.get("damping")):
                if matrix is not None and np.shape(matrix) == (6, 6):
                    touched[node] += carried.T @ np.array(matrix) @ carried
    for entry in content["masses"].values():
        for node in set(entry.get("nodes", [])) & set(touched):
            touched[node][:3, :3] += np.eye(3)
            if "inertia" in entry or "offset" in entry:
                touched[node][3:, 3:] += np.eye(3)
    whole = {n for entry in content["interfaces"].values() for n in entry["nodes"]}
    held: dict[int, set[str]] = {}
    for entry in content["supports"].values():
        for node in entry["nodes"]:
            held.setdefault(node, set()).update(entry["components"])
    free = {}
    for node, matrix in touched.items():
        some = [
            name
            for name, own in zip(COMPONENTS, np.diag(matrix), strict=True)
            if own == 0 and name not in held.get(node, ())
        ]
        if some and node not in whole:
            free[node] = some
    return free
