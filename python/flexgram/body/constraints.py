"""Linear constraints between displacements of nodes: equations as they are given, ties of nodes to
faces, and what is left of both when every dependent dof follows independent ones only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexgram.basics import BodyError, Floats, Ints, errors_of
from flexgram.body.face_integrals import areas_at_nodes
from flexgram.body.faces import whole_faces
from flexgram.body.meshfile import TURNING
from flexgram.body.reader import Reader, short
from flexgram.body.strain import rigid_interfaces
from flexgram.body.ties import Ties, tied

COMPONENTS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}
#: Factors smaller than this share of the largest of an equation are its rounding.
ROUNDING = 1e-12
#: The first dof of an equation becomes dependent where its factor is this share of the largest.
PIVOT = 0.1
#: Of the mean size of faces: how far nodes that are tied to them may lie, as in CalculiX.
SHARE = 0.025


@dataclass
class Elimination:
    """Dependent dofs in terms of independent ones, equation by equation. A dof is 6 · node +
    component.

    Attributes
    ----------
    held : set of int
        Dofs that supports hold: zero, and never dependent.
    rigid : (N,) bool array
        Nodes that follow a rigid interface: none of their dofs becomes dependent.
    of : dict
        Dependent dof -> independent dof -> factor.
    """

    held: set[int]
    rigid: NDArray[np.bool_]
    of: dict[int, dict[int, float]] = field(default_factory=dict)
    _used_by: dict[int, set[int]] = field(default_factory=dict)

    def add(self, terms: Sequence[tuple[int, float]], follows: bool = False) -> bool:
        """Let Σ factor · dof = 0; whether that was not known before. The first dof becomes
        dependent where it can, else the one with the largest factor.

        ``follows``: the first dof, of factor 1, is to follow the others. It is not where these
        follow it already, as in a ring of ties: what is left is differences of the others by the
        rounding of places, no equation.

        Raises
        ------
        BodyError
            If every dof that is left follows a rigid interface.
        """
        largest = max((abs(factor) for _, factor in terms), default=0.0)
        row: dict[int, float] = {}
        for dof, factor in terms:
            for other, share in self.of.get(dof, {dof: 1.0}).items():
                row[other] = row.get(other, 0.0) + factor * share
        row = {dof: factor for dof, factor in row.items() if abs(factor) > ROUNDING * largest}
        if not set(row) - self.held:
            return False
        free = [dof for dof in row if dof not in self.held and not self.rigid[dof // 6]]
        if not free:
            raise BodyError(
                "it is between dofs of rigid interfaces alone, or of these and held ones"
            )
        first = terms[0][0]
        if follows and abs(row.get(first, 0.0)) < PIVOT:
            return False
        most = max(free, key=lambda dof: abs(row[dof]))
        near = first in free and abs(row[first]) >= PIVOT * abs(row[most])
        dependent = first if near else most
        pivot = row.pop(dependent)
        mine = {dof: -factor / pivot for dof, factor in row.items()}
        for user in self._used_by.pop(dependent, set()):
            theirs = self.of[user]
            share = theirs.pop(dependent)
            for dof, factor in mine.items():
                theirs[dof] = theirs.get(dof, 0.0) + share * factor
                self._used_by.setdefault(dof, set()).add(user)
        self.of[dependent] = mine
        for dof in mine:
            self._used_by.setdefault(dof, set()).add(dependent)
        return True

    def write(self, file: h5py.File) -> None:
        """Write ``/constraints``: ``dependent`` (E, 2), node and component; of row k
        ``independent`` (…, 2) and ``factor`` from ``start[k]`` to ``start[k + 1]``."""
        if not self.of:
            return
        rows = sorted(self.of.items())
        group = file.create_group("constraints")
        dofs = np.array([dof for dof, _ in rows], dtype=np.int64)
        others = np.array([dof for _, shares in rows for dof in shares], dtype=np.int64)
        group["dependent"] = np.column_stack([dofs // 6, dofs % 6])
        group["independent"] = np.column_stack([others // 6, others % 6])
        group["factor"] = np.array([x for _, shares in rows for x in shares.values()], dtype=float)
        group["start"] = np.concatenate([[0], np.cumsum([len(shares) for _, shares in rows])])


@dataclass(frozen=True)
class Constraints:
    """Those of a body file.

    Attributes
    ----------
    dependent, independent : (E, 2), (K, 2) int arrays
        Node (0-based) and component.
    row : (K,) int array
        Which dependent dof each share is of.
    factor : (K,) array
    """

    dependent: Ints
    independent: Ints
    row: Ints
    factor: Floats

    @classmethod
    def of(cls, file: h5py.File) -> Constraints:
        """Of an open body file; none where it has none."""
        if "constraints" not in file:
            none = np.empty((0, 2), dtype=np.int64)
            return cls(none, none, none[:, 0], np.empty(0))
        group = file["constraints"]
        start = group["start"][:]
        row = np.repeat(np.arange(len(start) - 1), np.diff(start))
        return cls(group["dependent"][:], group["independent"][:], row, group["factor"][:])

    @property
    def holding(self) -> Ints:
        """Nodes with dependent dofs that follow none: equations hold them."""
        alone = np.bincount(self.row, minlength=len(self.dependent)) == 0
        found: Ints = np.unique(self.dependent[alone, 0])
        return found

    def sums(self, values: Floats) -> Floats:
        """Of the dependent dofs, (…, E), from values of the independent ones, (…, K)."""
        count, shares = len(self.dependent), len(self.factor)
        matrix = sp.csr_matrix((self.factor, (self.row, np.arange(shares))), (count, shares))
        rows = values.reshape(int(np.prod(values.shape[:-1])), shares)
        found: Floats = (matrix @ rows.T).T
        return found.reshape(*values.shape[:-1], count)

    def joined(self) -> list[Ints]:
        """Nodes that move together: of each dependent dof its node and those that it follows."""
        ends = np.searchsorted(self.row, np.arange(len(self.dependent) + 1))
        followed = np.split(self.independent[:, 0], ends[1:-1]) if len(self.dependent) else []
        pairs = zip(self.dependent[:, 0], followed, strict=True)
        return [np.append(nodes, node) for node, nodes in pairs]


def write_constraints(
    file: h5py.File,
    reader: Reader,
    select: Callable[[Any, str], Ints],
    points: Floats,
    blocks: Sequence[tuple[str, Ints]],
    length: float,
) -> list[str]:
    """Write ``equations`` and ``ties`` of a description.

    Parameters
    ----------
    file : h5py.File
        With its interfaces and supports.
    reader : Reader
        Of the whole description. ``equations``: name -> ``terms``, lists of rows of a node (from
        1), a component and a factor, whose sum is zero. ``ties``: name -> ``nodes``, which follow
        the faces with all their nodes in ``to``, if they are no farther away than ``distance``
        (default: a fortieth of the mean size of these faces); ``rotations: free`` leaves the
        rotations of shells and beams alone.
    select : function
        Nodes of a choice.
    points : (N, 3) array
        In the mesh's unit, which measures ``length`` [m].
    blocks : sequence of (str, int array)
        Elements of the body: meshio type and nodes.

    Returns
    -------
    list of str
        What is told of each.

    Raises
    ------
    BodyError
        For dofs that do not exist, equations that are not, and ties that reach nothing.
    """
    equations, ties = reader.children("equations"), reader.children("ties")
    if not equations and not ties:
        return []
    turning = np.zeros(len(points), dtype=bool)
    for kind, elements in blocks:
        if kind in TURNING:
            turning[elements.ravel()] = True
    rigid = rigid_interfaces(file) >= 0
    held = {
        6 * int(node) + int(component)
        for group in file.get("supports", {}).values()
        for node in group["nodes"][:]
        for component in np.ravel(group.attrs["components"])
    }
    elimination = Elimination(held, rigid)
    told = []
    for name, data in equations.items():
        entry = Reader(data, f"equations: {name}", ("terms",))
        rows = _equations(entry, select, turning | rigid, length)
        news = 0
        for row in rows:
            with errors_of(entry.where):
                news += elimination.add(row)
        again = f", {len(rows) - news} of them say nothing new" if news < len(rows) else ""
        told.append(f"equations {name}: {len(rows)}{again}")
    for name, data in ties.items():
        entry = Reader(data, f"ties: {name}", ("nodes", "to", "distance", "rotations"))
        found, count = _tie(entry, select, points, blocks, turning)
        turns = entry.choice("rotations", ("tied", "free"), "tied") == "tied"
        skipped = set(found.nodes[rigid[found.nodes]].tolist())
        known: set[int] = set()
        for terms in found.equations(length * points, turning, turns, length):
            node = terms[0][0] // 6
            if node in skipped:
                continue
            busy = terms[0][0] in elimination.of or terms[0][0] in held
            with errors_of(entry.where):
                if busy or not elimination.add(terms, follows=True):
                    known.add(node)
        told.append(_told(str(name), found, count, length, len(skipped), len(known)))
    elimination.write(file)
    return told


def _equations(
    entry: Reader, select: Callable[[Any, str], Ints], turning: NDArray[np.bool_], length: float
) -> list[list[tuple[int, float]]]:
    """Dofs and their factors, for displacements in metres."""
    given = entry.get("terms")
    if isinstance(given, list) and given and all(_is_term(row) for row in given):
        given = [given]
    if not (isinstance(given, list) and given) or not all(
        isinstance(rows, list) and rows and all(_is_term(row) for row in rows) for rows in given
    ):
        raise BodyError(
            f"{entry.where}: terms = {short(given)} must be rows [node, component, factor] whose "
            "sum is zero, or a list of several such equations"
        )
    result = []
    for rows in given:
        terms = []
        for node, component, factor in rows:
            at = int(select([node], entry.where)[0])
            c = COMPONENTS[component]
            if c >= 3 and not turning[at]:
                raise BodyError(f"{entry.where}: node {node} has no rotation {component}")
            terms.append((6 * at + c, float(factor) / (length if c < 3 else 1.0)))
        if not any(factor for _, factor in terms):
            raise BodyError(f"{entry.where}: all factors are 0")
        result.append(terms)
    return result


def _is_term(row: Any) -> bool:
    return (
        isinstance(row, list)
        and len(row) == 3
        and type(row[0]) is int
        and row[1] in COMPONENTS
        and isinstance(row[2], (int, float))
        and not isinstance(row[2], bool)
        and bool(np.isfinite(row[2]))
    )


def _tie(
    entry: Reader,
    select: Callable[[Any, str], Ints],
    points: Floats,
    blocks: Sequence[tuple[str, Ints]],
    turning: NDArray[np.bool_],
) -> tuple[Ties, int]:
    """The ties, and how many nodes were meant."""
    nodes = select(entry.get("nodes"), f"{entry.where}: nodes")
    targets = select(entry.get("to"), f"{entry.where}: to")
    faces = whole_faces(blocks, targets, len(points))
    if not faces:
        raise BodyError(
            f"{entry.where}: to: no face of an element has all its nodes among the "
            f"{len(targets)} chosen"
        )
    distance = entry.number("distance", SHARE * _mean_size(points, faces))
    if not distance > 0:
        raise BodyError(f"{entry.where}: distance = {distance:g} must be positive")
    nodes = np.setdiff1d(nodes, np.concatenate([f.ravel() for f in faces]))
    found, nearest = tied(points, faces, nodes, distance)
    if not len(found.nodes):
        raise BodyError(
            f"{entry.where}: no node lies within {distance:.4g} (distance) of a face of to"
            + (f"; the nearest is {nearest:.4g} away" if np.isfinite(nearest) else "")
        )
    return found, len(nodes)


def _mean_size(points: Floats, faces: Sequence[Ints]) -> float:
    """Of faces: the root of their mean area."""
    _, areas = areas_at_nodes(points, faces)
    return float(np.sqrt(areas.sum() / sum(map(len, faces))))


def _told(name: str, found: Ties, count: int, length: float, rigid: int, known: int) -> str:
    words = f"tie {name}: {len(found.nodes) - rigid - known} nodes follow faces"
    gap = length * float(found.distance.max())
    words += f", at most {gap:.3g} m away" if gap > 0 else ""
    if far := count - len(found.nodes):
        words += f"; {far} lie farther away than its distance"
    if rigid:
        words += f"; {rigid} follow a rigid interface instead"
    if known:
        words += f"; {known} are held, or follow or move these faces already, wholly or in part"
    return words
