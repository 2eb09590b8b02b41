"""Nodes of decks that no element has: what moves with them, and what of them nothing holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


Row = list[list[Any]]  #: of an equation: node from 1, component, factor


def row_along(node: int, component: int, factor: float, axes: Floats | None = None) -> Row:
    """A factor times a component (from 0, along ``axes`` in rows, if given) of a node, from 1."""
    along = np.eye(3)[component % 3] if axes is None else axes[component % 3]
    names = COMPONENTS[:3] if component < 3 else COMPONENTS[3:]
    return [
        [node, name, float(factor * part)]
        for name, part in zip(names, along, strict=True)
        if abs(part) > 1e-14
    ]


def rigid_row(node: int, by: int, component: int, arm: Floats, axes: Floats | None = None) -> Row:
    """Terms of an equation: a component (from 0, along ``axes`` in rows, if given) of a node moves
    as a rigid body with that of another, which has rotations; both from 1, ``arm`` from that one to
    the node."""
    terms = row_along(node, component, 1.0, axes) + row_along(by, component, -1.0, axes)
    if component < 3:  # e · (θ × d) = θ · (d × e)
        turned = np.cross(arm, np.eye(3)[component] if axes is None else axes[component])
        terms += [[by, n, -float(f)] for n, f in zip(COMPONENTS[3:], turned, strict=True) if f]
    return terms


def mean_rows(node: int, at: Floats, others: Sequence[int], points: Floats) -> list[Row]:
    """Equations by which a node (from 1, place ``at``) has the least-squares mean motion of the
    displacements of others, in all six components.

    Parameters
    ----------
    others : sequence of int
        From 1.
    points : (n, 3) array
        Their places.

    Raises
    ------
    BodyError
        If they lie on a line.
    """
    arms = points - at
    carried = np.zeros((len(arms), 3, 6))  # u = U + θ × arm
    carried[:, :, :3] = np.eye(3)
    for axis, e in enumerate(np.eye(3)):
        carried[:, :, 3 + axis] = np.cross(e, arms)
    normal = np.einsum("nia,nib->ab", carried, carried)
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    if np.linalg.eigvalsh(normal * np.outer(scale, scale))[0] < 1e-10:
        raise BodyError("its nodes lie on a line or in a point, which tells no rotation about it")
    shares = np.einsum("ab,nib->ani", np.linalg.inv(normal), carried)
    return [
        [[node, name, 1.0]]
        + [
            [other, along, -float(f)]
            for other, of in zip(others, shares[c], strict=True)
            for along, f in zip(COMPONENTS, of, strict=False)
            if abs(f) > 1e-14
        ]
        for c, name in enumerate(COMPONENTS)
    ]


#: Of what acts on a component, over the most that acts on one of its kind, less is rounding; and of
#: what acts on rotations, over forces at a lever as long as the body.
TOUCH, TURN = 1e-12, 1e-20


def hold_untouched(content: dict[str, Any], points: Floats) -> None:
    """Hold the components of ``nodes_alone`` that no equation, spring, mass or interface touches,
    and no support holds."""
    whole = {n for entry in content["interfaces"].values() for n in entry["nodes"]}
    held: dict[int, set[str]] = {}
    for entry in content["supports"].values():
        for node in entry["nodes"]:
            held.setdefault(node, set()).update(entry["components"])
    for node, size in _touched(content, points).items():
        some = [
            name
            for name, own in zip(COMPONENTS, size, strict=True)
            if own <= TOUCH and name not in held.get(node, ())
        ]
        if some and node not in whole:
            content["supports"][f"untouched_{node}"] = {"nodes": [node], "components": some}


def _touched(content: Mapping[str, Any], points: Floats) -> dict[int, Floats]:
    """For each of ``nodes_alone`` (from 1) how much each component (6,) is touched, by each
    equation, spring and mass at most by 1."""
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    lengths = np.array([1.0, 1.0, 1.0, extent, extent, extent])
    touched = {node: np.zeros(6) for node in content["nodes_alone"]}

    def add(node: int, size: Floats) -> None:
        """Stiffness of the components, or squares of factors."""
        size = np.abs(size) / lengths**2
        for kind in (slice(0, 3), slice(3, 6)):
            most = float(size[kind].max())
            if most > TURN * float(size.max()):
                touched[node][kind] += size[kind] / most

    for entry in content["equations"].values():
        for equation in entry["terms"]:
            for node in {term[0] for term in equation} & set(touched):
                row = np.zeros(6)
                for _, component, factor in (term for term in equation if term[0] == node):
                    row[COMPONENTS.index(component)] += factor
                add(node, row**2)
    for entry in content["springs"].values():
        ends = [entry[key][0] for key in ("nodes", "to_nodes") if len(entry.get(key, [])) == 1]
        for node in set(ends) & set(touched):
            arm = np.mean(points[[n - 1 for n in ends]], axis=0) - points[node - 1]
            carried = np.eye(6)
            carried[:3, 3:] = np.column_stack([np.cross(e, arm) for e in np.eye(3)])
            for matrix in (entry.get("stiffness"), entry.get("damping")):
                if matrix is not None and np.shape(matrix) == (6, 6):
                    add(node, np.diag(carried.T @ np.array(matrix) @ carried))
    for entry in content["masses"].values():
        if "matrix" in entry:
            for node in set(entry.get("nodes", [])) & set(touched):
                add(node, np.diag(np.array(entry["matrix"])))
            continue
        turns = float("inertia" in entry or "offset" in entry)
        for node in set(entry.get("nodes", [])) & set(touched):
            add(node, np.array([1.0, 1.0, 1.0, turns, turns, turns]) * lengths**2)
    return touched
