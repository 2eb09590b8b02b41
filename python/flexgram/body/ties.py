"""Nodes tied to faces on which they lie, or from which they stand off: where each touches its
face, and the equations by which it follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexgram.basics import Floats, Ints
from flexgram.body.face_integrals import corners_of, face_functions

#: Nodes whose faces are looked for at a time.
CHUNK = 4096


@dataclass(frozen=True)
class Ties:
    """Nodes, the face that each follows, and where that is next to it.

    Attributes
    ----------
    nodes : (T,) int array
    faces : list of (n,) int arrays
        Nodes of the faces.
    xi : (T, 2) array
        On the face: of the unit triangle, or of the square from -1 to 1.
    distance : (T,) array
        In the unit of the points.
    """

    nodes: Ints
    faces: list[Ints]
    xi: Floats
    distance: Floats

    def equations(
        self, points: Floats, turning: NDArray[np.bool_], turns: bool, length: float = 1.0
    ) -> Iterator[list[tuple[int, float]]]:
        """The equations Σ factor · dof = 0 of each node, three of its displacement and, if it
        ``turns``, three of its rotation; the dof of the node comes first. A dof is 6 · node +
        component.

        The node at x = Σ N_i x_i + g follows the face and its normal n, so that every rigid motion
        of the face moves it along: where all nodes of the face have rotations, u = Σ N_i (u_i + θ_i
        × g) and θ = Σ N_i θ_i; else g = g^α a_α + g_n n moves with the tangents a_α = Σ ∂_αN_i x_i,
        and δn = -Σ a^α (n · ∂_αN_i u_i) with their reciprocals a^α.

        Parameters
        ----------
        points : (N, 3) array
            [m]
        turning : (N,) bool array
            Nodes with rotations.
        turns : bool
            Whether rotations are tied too.
        length : float
            Unit of the points in which the ties were found [m].
        """
        widths = np.array([len(face) for face in self.faces])
        for width in np.unique(widths).tolist():
            mine = np.flatnonzero(widths == width)
            faces = np.array([self.faces[k] for k in mine])
            shells = turning[faces].all(axis=1)
            for which in (mine[shells], mine[~shells]):
                if len(which):
                    some = np.array([self.faces[k] for k in which])
                    yield from self._of(which, some, points, turning, turns, length)

    def _of(
        self,
        which: Ints,
        faces: Ints,
        points: Floats,
        turning: NDArray[np.bool_],
        turns: bool,
        length: float,
    ) -> Iterator[list[tuple[int, float]]]:
        """Of some ties to faces (T, n) of one kind."""
        N, dN = face_functions(faces.shape[1], self.xi[which])
        x = points[faces]
        gap = points[self.nodes[which]] - np.einsum("ti,tia->ta", N, x)
        sizes = np.linalg.norm(np.ptp(x, axis=1), axis=1)
        gap[self.distance[which] * length < 1e-9 * sizes] = 0
        if turning[faces[0]].all():
            shift = np.einsum("ti,ab->tiab", N, np.eye(3))
            by_turning = -np.einsum("ti,tab->tiab", N, cross_matrices(gap))
            whole = np.concatenate([shift, by_turning], axis=3)
            rotation = np.concatenate([np.zeros_like(shift), shift], axis=3)
        else:
            whole, rotation = _of_solids(N, dN, x, gap)
        for k, node in enumerate(self.nodes[which].tolist()):
            yield from _rows(node, faces[k], whole[k], 0)
            if turns and turning[node]:
                yield from _rows(node, faces[k], rotation[k], 3)


def cross_matrices(a: Floats) -> Floats:
    """[a ×] of vectors (T, 3)."""
    result = np.zeros((len(a), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[:, i, j], result[:, j, i] = -a[:, k], a[:, k]
    return result


def _of_solids(N: Floats, dN: Floats, x: Floats, gap: Floats) -> tuple[Floats, Floats]:
    """Displacements at gaps (T, 3) from faces with nodes x (T, n, 3), and rotations of the faces,
    from displacements of their nodes: (T, n, 3, 3) each."""
    tangents = np.einsum("tik,tia->tka", dN, x)  # a_α
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    reciprocal = np.linalg.pinv(tangents)  # a^α in columns: a^α · a_β = δ
    slopes = np.einsum("tik,tak->tia", dN, reciprocal)  # b_i = a^α ∂_αN_i
    along = np.einsum("tia,ta->ti", slopes, gap)
    displacement = np.einsum("ti,ab->tiab", N + along, np.eye(3))
    height = np.einsum("ta,ta->t", gap, normal)
    displacement -= np.einsum("t,tia,tb->tiab", height, slopes, normal)
    turned = np.cross(normal[:, None], slopes)
    rotation = -np.einsum("tia,tb->tiab", turned, normal)
    rotation += 0.5 * np.einsum("ta,tib->tiab", normal, turned)
    return displacement, rotation


def _rows(node: int, face: Ints, of_nodes: Floats, first: int) -> Iterator[list[tuple[int, float]]]:
    """dof - Σ of_nodes · u = 0; ``of_nodes`` (n, 3, 3 or 6)."""
    limit = 1e-14 * float(np.abs(of_nodes).max())
    width = of_nodes.shape[2]
    dofs = (6 * face[:, None] + np.arange(width)).ravel().tolist()
    for c in range(3):
        shares = of_nodes[:, c].ravel().tolist()
        terms = [(6 * node + first + c, 1.0)]
        terms += [
            (dof, -share) for dof, share in zip(dofs, shares, strict=True) if abs(share) > limit
        ]
        yield terms


def tied(points: Floats, faces: Sequence[Ints], nodes: Ints, distance: float) -> tuple[Ties, float]:
    """Ties of nodes to the nearest of some faces no farther away than a distance.

    Parameters
    ----------
    points : (N, 3) array
    faces : sequence of (F, 3), (F, 4), (F, 6) or (F, 8) int arrays
        As ``faces.whole_faces`` returns them.
    nodes : int array
    distance : float

    Returns
    -------
    ties : Ties
    nearest : float
        The least distance of a node from a face that was looked at; infinite where none was.
    """
    best = np.full(len(nodes), np.inf)
    at = np.zeros((len(nodes), 2))
    of: list[Ints | None] = [None] * len(nodes)
    classes = [_FaceClass(points, some) for group in faces for some in _by_size(points, group)]
    for begin in range(0, len(nodes), CHUNK):
        places = points[nodes[begin : begin + CHUNK]]
        next_ones = np.array([own.tree.query(places)[0] for own in classes])
        bound = next_ones.min(axis=0)  # a centre is a point of its face
        for own, away_from in zip(classes, next_ones, strict=True):
            node, face = own.candidates(places, np.minimum(bound, distance), away_from <= bound)
            if not len(node):
                continue
            xi, away = _feet(points[own.faces[face]], places[node])
            order = np.lexsort((away, node))
            for k in order[np.unique(node[order], return_index=True)[1]]:  # the next of each node
                row = begin + int(node[k])
                if away[k] < best[row]:
                    best[row], at[row], of[row] = away[k], xi[k], own.faces[face[k]]
    near = np.flatnonzero(best <= distance)
    chosen = [f for f in (of[k] for k in near) if f is not None]
    return Ties(nodes[near], chosen, at[near], best[near]), float(best.min(initial=np.inf))


def _by_size(points: Floats, faces: Ints) -> Iterator[Ints]:
    """Faces (F, n) in classes of sizes that differ by a factor of two at most."""
    size = np.linalg.norm(np.ptp(points[faces], axis=1), axis=1)
    classes = np.floor(np.log2(np.maximum(size, 1e-300)))
    for which in np.unique(classes):
        yield faces[classes == which]


class _FaceClass:
    """Faces (F, n) of similar sizes, by their centres."""

    def __init__(self, points: Floats, faces: Ints) -> None:
        x = points[faces]
        centres = x.mean(axis=1)
        self.faces = faces
        self.radius = float(np.linalg.norm(x - centres[:, None], axis=2).max())
        self.tree = cKDTree(centres)

    def candidates(
        self, places: Floats, reach: Floats, with_next: NDArray[np.bool_]
    ) -> tuple[Ints, Ints]:
        """Pairs of a place and a face that may be no farther apart than its reach, and the next
        face of some places."""
        found = self.tree.query_ball_point(places, reach + self.radius)
        counts = np.array([len(some) for some in found])
        node = np.repeat(np.arange(len(places)), counts)
        face = np.concatenate([np.array(some, dtype=np.int64) for some in found])
        more = np.flatnonzero(with_next & (counts == 0))
        if len(more):
            node = np.append(node, more)
            face = np.append(face, self.tree.query(places[more])[1])
        return node, face


#: Edges of the unit triangle and of the square: a corner and the way to the next.
EDGES = {
    3: (((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (-1.0, 1.0)), ((0.0, 1.0), (0.0, -1.0))),
    4: (
        ((-1.0, -1.0), (2.0, 0.0)),
        ((1.0, -1.0), (0.0, 2.0)),
        ((1.0, 1.0), (-2.0, 0.0)),
        ((-1.0, 1.0), (0.0, -2.0)),
    ),
}
STEPS = 8


def _feet(x: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Where faces with nodes x (P, n, 3) are next to places (P, 3): (P, 2), and how far that is."""
    count = x.shape[1]
    triangle = corners_of(count) == 3
    xi = np.full((len(x), 2), 1 / 3 if triangle else 0.0)
    for _ in range(STEPS):
        N, dN = face_functions(count, xi)
        away = places - np.einsum("pi,pia->pa", N, x)
        tangents = np.einsum("pik,pia->pka", dN, x)
        metric = np.einsum("pka,pla->pkl", tangents, tangents)
        metric += 1e-14 * np.trace(metric, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        right = np.einsum("pka,pa->pk", tangents, away)
        xi = np.clip(xi + np.linalg.solve(metric, right[..., None])[..., 0], -2, 2)
    if triangle:
        outside = (xi.min(axis=1) < 0) | (xi.sum(axis=1) > 1)
    else:
        outside = np.abs(xi).max(axis=1) > 1
    beyond = np.flatnonzero(outside)
    if len(beyond):
        xi[beyond] = _on_edges(x[beyond], places[beyond])
    N, _ = face_functions(count, xi)
    distance: Floats = np.linalg.norm(places - np.einsum("pi,pia->pa", N, x), axis=1)
    return xi, distance


def _on_edges(x: Floats, places: Floats) -> Floats:
    """The next points of the edges of faces, (P, 2)."""
    count = x.shape[1]
    best, found = np.full(len(x), np.inf), np.zeros((len(x), 2))
    for corner, way in EDGES[corners_of(count)]:
        t = np.full(len(x), 0.5)
        for step in range(STEPS + 1):
            xi = np.array(corner) + t[:, None] * np.array(way)
            N, dN = face_functions(count, xi)
            away = places - np.einsum("pi,pia->pa", N, x)
            if step == STEPS:
                break
            along = np.einsum("pik,pia,k->pa", dN, x, np.array(way))
            size = np.maximum(np.einsum("pa,pa->p", along, along), 1e-300)
            t = np.clip(t + np.einsum("pa,pa->p", along, away) / size, 0, 1)
        distance = np.linalg.norm(away, axis=1)
        better = distance < best
        best[better], found[better] = distance[better], xi[better]
    return found
