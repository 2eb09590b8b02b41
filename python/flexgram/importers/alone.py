"""Nodes of decks that no element has: what moves with them, and what of them nothing holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexgram.basics import Floats

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


def rigid_row(
    node: int, by: int, component: int, arm: Floats, axes: Floats | None = None
) -> list[list[Any]]:
    """Terms of an equation: a component (from 0, along ``axes`` in rows, if given) of a node moves
    as a rigid body with that of another, which has rotations; both from 1, ``arm`` from that one to
    the node."""
    along = np.eye(3)[component % 3] if axes is None else axes[component % 3]
    own = COMPONENTS[:3] if component < 3 else COMPONENTS[3:]
    terms: list[list[Any]] = [[node, n, float(f)] for n, f in zip(own, along, strict=True)]
    terms += [[by, n, -float(f)] for n, f in zip(own, along, strict=True)]
    if component < 3:  # e · (θ × d) = θ · (d × e)
        turned = np.cross(arm, along)
        terms += [[by, n, -float(f)] for n, f in zip(COMPONENTS[3:], turned, strict=True)]
    return [term for term in terms if abs(term[2]) > 1e-14]


def hold_untouched(content: dict[str, Any], points: Floats) -> None:
    """Hold the components of ``nodes_alone`` that no equation, spring, mass or interface touches,
    and no support holds."""
    for number, components in _untouched(content["nodes_alone"], content, points).items():
        entry = {"nodes": [number], "components": components}
        content["supports"][f"untouched_{number}"] = entry


def _untouched(
    alone: Sequence[int], content: Mapping[str, Any], points: Floats
) -> dict[int, list[str]]:
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
