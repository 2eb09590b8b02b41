"""How many rigid motions of a body its supports, springs and equations leave."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import h5py
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from flexgram.basics import Floats, Ints
from flexgram.body.constraints import Constraints
from flexgram.body.discrete import Places

#: Of a singular value, beside the largest: less is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class SpringAt:
    """A spring that resists motion of its ends against each other, or against the ground.

    Attributes
    ----------
    stiffness : (6, 6) array
        Over displacements and rotations.
    ends : sequence of (nodes, positions)
        One or two: (k,) nodes from 0, of an interface one of its nodes, and (k, 3) [m].
    """

    stiffness: Floats
    ends: Sequence[tuple[Ints, Floats]]


def springs_of(file: h5py.File) -> Iterable[SpringAt]:
    """Those of a body file that have a stiffness."""
    places = Places(file)
    for spring in file.get("springs", {}).values():
        if "stiffness" not in spring.attrs:
            continue
        ends = []
        for prefix in ("", "to_"):
            nodes = spring.get(f"{prefix}nodes")
            if name := spring.attrs.get(f"{prefix}interface"):
                nodes = file["interfaces"][str(name)]["nodes"][:1]
            if nodes is not None:
                ends.append((np.asarray(nodes), places.positions(spring, prefix)))
        yield SpringAt(np.reshape(spring.attrs["stiffness"], (6, 6)), ends)


def alone_in(file: h5py.File) -> list[Ints]:
    """Nodes that no element has and that need not move with the body: those of one rigid interface
    together."""
    if "mesh/alone" not in file:
        return []
    rest = set(np.ravel(file["mesh/alone/connectivity"][:]).tolist())
    groups = []
    for interface in file["interfaces"].values():
        nodes = set(interface["nodes"][:].tolist())
        if str(interface.attrs["coupling"]) == "rigid" and nodes & rest:
            if nodes <= rest:
                groups.append(np.array(sorted(nodes)))
            rest -= nodes
    return groups + [np.array([node]) for node in sorted(rest)]


class _Motions:
    """Motions of all nodes: six of the body as a whole, and six of each group of nodes that need
    not move with it. Displacements are in units of the body's size."""

    def __init__(self, points: Floats, alone: Sequence[Ints]) -> None:
        self.size = max(float(np.ptp(points, axis=0).max(initial=0)), 1e-300)
        self.count = 6 + 6 * len(alone)
        self.first = np.zeros(len(points), dtype=int)  #: column of each node's motion
        self.start = np.zeros((len(points), 3))  #: about this point
        self.start[:] = points.mean(axis=0) if len(points) else 0.0
        for k, nodes in enumerate(alone):
            self.first[nodes], self.start[nodes] = 6 + 6 * k, points[nodes[0]]
        arms = (points - self.start) / self.size
        dofs = 6 * np.arange(len(points))[:, None] + np.arange(3)
        rows, columns, values = [], [], []
        for a in range(3):
            turned = np.cross(np.eye(3)[a], arms)
            rows += [dofs[:, a], dofs[:, a] + 3, dofs.ravel()]
            columns += [self.first + a, self.first + 3 + a, np.repeat(self.first + 3 + a, 3)]
            values += [np.ones(len(arms)), np.ones(len(arms)), turned.ravel()]
        where = (np.concatenate(rows), np.concatenate(columns))
        self.of_dofs = sp.csr_matrix((np.concatenate(values), where), (6 * len(points), self.count))

    def at(self, place: Floats, node: int) -> Floats:
        """Of a place that moves with a node, (6, count)."""
        found = np.zeros((6, self.count))
        first = int(self.first[node])
        found[:, first : first + 6] = np.eye(6)
        arm = (place - self.start[node]) / self.size
        for a in range(3):
            found[:3, first + 3 + a] = np.cross(np.eye(3)[a], arm)
        return found


def free_motions(
    points: Floats,
    held: Sequence[tuple[Ints, list[int]]],
    springs: Iterable[SpringAt] = (),
    constraints: Constraints | None = None,
    alone: Sequence[Ints] = (),
) -> int:
    """How many of six rigid motions are left.

    Parameters
    ----------
    points : (N, 3) array
        [m]
    held : sequence of (nodes, components)
        Supports, from 0.
    springs, constraints
        Those of the body.
    alone : sequence of int arrays
        Nodes that need not move with the body, in groups that move as one (``alone_in``).
    """
    motions = _Motions(points, alone)
    rows = [
        motions.of_dofs[(6 * np.asarray(nodes)[:, None] + np.array(components, int)).ravel()]
        for nodes, components in held
        if len(components)
    ]
    rows += [sp.csr_matrix(_resisted(motions, spring)) for spring in springs]
    if constraints is not None and len(constraints.dependent):
        rows.append(_constrained(motions, constraints, len(points)))
    if not rows:
        return 6
    return 6 - _rank(_of_body(sp.vstack(rows, format="csr")))


def _resisted(motions: _Motions, spring: SpringAt) -> Floats:
    """What a spring's ends do along the directions in which it is stiff."""
    values, vectors = np.linalg.eigh(spring.stiffness)
    stiff = vectors[:, values > 1e-12 * values.max(initial=0)].T
    rows = [np.zeros((0, motions.count))]
    start, *rest = [(np.asarray(nodes), where) for nodes, where in spring.ends]
    for k, place in enumerate(start[1]):
        if not rest:
            moved = motions.at(place, int(start[0][k]))
        else:
            nodes, where = rest[0]
            other = min(k, len(where) - 1)
            middle = (place + where[other]) / 2
            moved = motions.at(middle, int(start[0][k]))
            moved = moved - motions.at(middle, int(nodes[other]))
        rows.append(stiff @ moved)
    return np.vstack(rows)


def _constrained(motions: _Motions, constraints: Constraints, count: int) -> sp.csr_matrix:
    """What motions do to each constraint: zero where they fulfil it."""
    equations, size = len(constraints.dependent), motions.size

    def terms(row: Ints, dofs: Ints, factor: Floats) -> sp.csr_matrix:
        lengths = np.where(dofs[:, 1] < 3, size, 1.0)
        at = (row, 6 * dofs[:, 0] + dofs[:, 1])
        return sp.csr_matrix((factor * lengths, at), (equations, 6 * count))

    first = terms(np.arange(equations), constraints.dependent, np.ones(equations))
    rest = terms(constraints.row, constraints.independent, constraints.factor)
    units = sp.diags(1 / np.where(constraints.dependent[:, 1] < 3, size, 1.0))
    found: sp.csr_matrix = units @ ((first - rest) @ motions.of_dofs)
    return found


def _of_body(rows: sp.csr_matrix) -> Floats:
    """What rows say of the whole body's motions, whatever the nodes alone do."""
    rows.data[np.abs(rows.data) < ROUNDING] = 0
    rows.eliminate_zeros()
    body, own = rows[:, :6].toarray(), rows[:, 6:].tocsc()
    touched = np.flatnonzero(np.diff(own.indptr))
    own = own[:, touched].tocsr()
    free = np.diff(own.indptr) == 0
    found = [body[free]]
    met = abs(own)  # else sums cancel
    count, group = connected_components(met.T @ met, directed=False)
    of_row = np.full(rows.shape[0], -1)
    of_row[~free] = group[own.indices[own.indptr[:-1][~free]]]
    order = np.argsort(of_row, kind="stable")
    starts = np.searchsorted(of_row[order], np.arange(count + 1))
    columns = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[columns], np.arange(count + 1))
    for k in range(count):
        mine = order[starts[k] : starts[k + 1]]
        block = own[mine][:, columns[ends[k] : ends[k + 1]]].toarray()
        left, values, _ = np.linalg.svd(block, full_matrices=False)
        moved = left[:, values > ROUNDING * values[0]]
        found.append(body[mine] - moved @ (moved.T @ body[mine]))
    result = np.vstack(found)
    said: Floats = result[np.abs(result).max(axis=1, initial=0) > ROUNDING]
    return said


def _rank(rows: Floats) -> int:
    if not len(rows):
        return 0
    values = np.linalg.svd(rows, compute_uv=False)
    return int((values > ROUNDING * values[0]).sum())
