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
    """Motions of nodes: six of the body as a whole, and six of each group of nodes that need not
    move with it. Displacements are in units of the body's size."""

    def __init__(self, points: Floats, alone: Sequence[Ints]) -> None:
        self.points = points
        self.size = max(float(np.ptp(points, axis=0).max(initial=0)), 1e-300)
        self.count = 6 + 6 * len(alone)
        self.centre = points.mean(axis=0) if len(points) else np.zeros(3)
        self.group = np.zeros(len(points), dtype=int)
        for k, nodes in enumerate(alone, 1):
            self.group[nodes] = k
        self.starts = [self.centre, *(points[nodes[0]] for nodes in alone)]

    def of(self, nodes: Ints, places: Floats) -> tuple[Ints, Floats]:
        """Of places (k, 3) that move with nodes: the first column of each one's motion, and what
        this is there, (k, 6, 6)."""
        groups = self.group[nodes]
        arms = (places - np.array(self.starts)[groups]) / self.size
        found = np.broadcast_to(np.eye(6), (len(nodes), 6, 6)).copy()
        for a in range(3):
            found[:, :3, 3 + a] = np.cross(np.eye(3)[a], arms)
        return 6 * groups, found

    def rows(self, first: Ints, values: Floats) -> sp.csr_matrix:
        """Rows (k, 6) of motions that begin at these columns."""
        columns = first[:, None] + np.arange(6)
        at = (np.repeat(np.arange(len(first)), 6), columns.ravel())
        return sp.csr_matrix((values.ravel(), at), (len(first), self.count))

    def of_dofs(self, nodes: Ints, components: Ints) -> sp.csr_matrix:
        """Of dofs, a row each."""
        first, motion = self.of(nodes, self.points[nodes])
        return self.rows(first, motion[np.arange(len(nodes)), components])


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
        motions.of_dofs(np.asarray(nodes), np.full(len(nodes), component))
        for nodes, components in held
        for component in components
    ]
    rows += [row for spring in springs for row in _resisted(motions, spring)]
    if constraints is not None and len(constraints.dependent):
        rows.append(_constrained(motions, constraints))
    if not rows:
        return 6
    return 6 - _rank(_of_body(sp.vstack(rows, format="csr")))


def _resisted(motions: _Motions, spring: SpringAt) -> list[sp.csr_matrix]:
    """What a spring's ends do along each direction in which it is stiff."""
    values, vectors = np.linalg.eigh(spring.stiffness)
    stiff = vectors[:, values > 1e-12 * values.max(initial=0)].T
    (nodes, places), *rest = spring.ends
    middle = (places + rest[0][1]) / 2 if rest else places
    first, motion = motions.of(nodes, middle)
    if not rest:
        return [motions.rows(first, direction @ motion) for direction in stiff]
    other = np.broadcast_to(rest[0][0], nodes.shape)
    of_other, against = motions.of(other, middle)
    apart = first != of_other  # ends that move as one do not resist it
    return [
        motions.rows(first[apart], direction @ motion[apart])
        - motions.rows(of_other[apart], direction @ against[apart])
        for direction in stiff
        if apart.any()
    ]


def _constrained(motions: _Motions, constraints: Constraints) -> sp.csr_matrix:
    """What motions do to each constraint: zero where they fulfil it."""
    size, (dofs, others) = motions.size, (constraints.dependent, constraints.independent)
    own, theirs = (np.where(of[:, 1] < 3, size, 1.0) for of in (dofs, others))
    shares = (constraints.factor * theirs / own[constraints.row],
              (constraints.row, np.arange(len(others))))  # fmt: skip
    followed = sp.csr_matrix(shares, (len(dofs), len(others))) @ motions.of_dofs(*others.T)
    found: sp.csr_matrix = motions.of_dofs(*dofs.T) - followed
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
