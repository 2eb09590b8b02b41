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
        for node, face, xi, distance in zip(
            self.nodes, self.faces, self.xi, self.distance, strict=True
        ):
            N, dN = (part[0] for part in face_functions(len(face), xi[None]))
            x = points[face]
            gap = points[node] - N @ x
            if distance * length < 1e-9 * np.linalg.norm(np.ptp(x, axis=0)):
                gap = np.zeros(3)
            if turning[face].all():
                shift = np.einsum("i,ab->iab", N, np.eye(3))
                by_turning = np.einsum("i,ab->iab", N, -_cross_matrix(gap))
                whole = np.concatenate([shift, by_turning], axis=2)  # (n, 3, 6)
                rotation = np.concatenate([np.zeros_like(shift), shift], axis=2)
            else:
                whole, rotation = _of_solid(N, dN, x, gap)
            yield from _rows(int(node), face, whole, 0)
            if turns and turning[node]:
                yield from _rows(int(node), face, rotation, 3)


def _cross_matrix(a: Floats) -> Floats:
    """[a ×]."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _of_solid(N: Floats, dN: Floats, x: Floats, gap: Floats) -> tuple[Floats, Floats]:
    """Displacement at a gap from a face, and the face's rotation, from displacements of its nodes:
    (n, 3, 3) each."""
    tangents = dN.T @ x  # (2, 3)
    normal = np.cross(tangents[0], tangents[1])
    normal /= np.linalg.norm(normal)
    reciprocal = np.linalg.pinv(tangents)  # (3, 2): a^α · a_β = δ
    slopes = dN @ reciprocal.T  # b_i = a^α ∂_αN_i, (n, 3)
    along = dN @ (gap @ reciprocal)
    displacement = np.einsum("i,ab->iab", N + along, np.eye(3))
    displacement -= (gap @ normal) * np.einsum("ia,b->iab", slopes, normal)
    turned = np.cross(normal, slopes)
    rotation = -np.einsum("ia,b->iab", turned, normal)
    rotation += 0.5 * np.einsum("a,ib->iab", normal, turned)
    return displacement, rotation


def _rows(node: int, face: Ints, of_nodes: Floats, first: int) -> Iterator[list[tuple[int, float]]]:
    """dof - Σ of_nodes · u = 0; ``of_nodes`` (n, 3, 3 or 6)."""
    for c in range(3):
        terms = [(6 * node + first + c, 1.0)]
        shares = of_nodes[:, c]
        for i, j in zip(*np.nonzero(np.abs(shares) > 1e-14 * np.abs(of_nodes).max()), strict=True):
            terms.append((6 * int(face[i]) + int(j), -float(shares[i, j])))
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
    for group in faces:
        node, face = _candidates(points, group, points[nodes], distance)
        xi, away = _feet(points[group[face]], points[nodes][node])
        order = np.lexsort((away, node))
        for k in order[np.unique(node[order], return_index=True)[1]]:  # the next of each node
            if away[k] < best[node[k]]:
                best[node[k]], at[node[k]], of[node[k]] = away[k], xi[k], group[face[k]]
    near = np.flatnonzero(best <= distance)
    ties = Ties(
        nodes[near], [f for f in (of[k] for k in near) if f is not None], at[near], best[near]
    )
    return ties, float(best.min(initial=np.inf))


def _candidates(points: Floats, faces: Ints, places: Floats, distance: float) -> tuple[Ints, Ints]:
    """Pairs of a place and a face that may be no farther apart; at least the place's next face."""
    x = points[faces]
    centres = x.mean(axis=1)
    radii = np.linalg.norm(x - centres[:, None], axis=2).max(axis=1)
    tree = cKDTree(centres)
    found = tree.query_ball_point(places, radii.max() + distance)
    node = np.repeat(np.arange(len(places)), [len(some) for some in found])
    face = np.array([f for some in found for f in some], dtype=np.int64)
    apart = np.linalg.norm(places[node] - centres[face], axis=1)
    close = apart <= radii[face] + distance
    next_one = tree.query(places)[1]
    return (
        np.concatenate([node[close], np.arange(len(places))]),
        np.concatenate([face[close], next_one]),
    )


def _feet(x: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Where faces with nodes x (P, n, 3) are next to places (P, 3): (P, 2), and how far that is."""
    count = x.shape[1]
    triangle = corners_of(count) == 3
    xi = np.full((len(x), 2), 1 / 3 if triangle else 0.0)
    for step in range(12):
        N, dN = face_functions(count, xi)
        away = places - np.einsum("pi,pia->pa", N, x)
        tangents = np.einsum("pik,pia->pka", dN, x)
        metric = np.einsum("pka,pla->pkl", tangents, tangents)
        metric += 1e-14 * np.trace(metric, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        right = np.einsum("pka,pa->pk", tangents, away)
        xi = xi + np.linalg.solve(metric, right[..., None])[..., 0]
        xi = np.clip(xi, -2, 2) if step < 6 else _inside(xi, triangle)
    N, _ = face_functions(count, xi)
    away = np.linalg.norm(places - np.einsum("pi,pia->pa", N, x), axis=1)
    return xi, away


def _inside(xi: Floats, triangle: bool) -> Floats:
    """The next point of the unit triangle, or of the square."""
    if not triangle:
        square: Floats = np.clip(xi, -1, 1)
        return square
    beyond = np.maximum(xi.sum(axis=1) - 1, 0)[:, None]
    xi = np.clip(xi - 0.5 * beyond, 0, None)
    inside: Floats = xi / np.maximum(xi.sum(axis=1), 1)[:, None]
    return inside
