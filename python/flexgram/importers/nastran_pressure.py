"""Pressure on faces and loads along beams of Nastran bulk data, as forces at nodes."""

from __future__ import annotations

import numpy as np

from flexgram.basics import Floats, Ints
from flexgram.body.face_integrals import corners_of, face_functions, face_rule
from flexgram.body.faces import FACES, LINEAR, MIDDLES


def face_of(kind: str, cell: list[int], first: int, other: int | None) -> Ints | None:
    """The face of a solid that Nastran names by a corner and another node: its nodes, outward; None
    if there is none, or several.

    Parameters
    ----------
    kind : str
        Meshio's name.
    cell : list of int
        Nodes of the element.
    first : int
        A corner of the face (G1).
    other : int or None
        That across from it (G3), or of a tetrahedron that beside the face (G4); None: the face is
        a triangle.
    """
    linear = LINEAR.get(kind, kind)
    found = []
    for face in FACES.get(linear, ()):
        nodes = [cell[k] for k in face]
        if first not in nodes:
            continue
        if linear == "tetra":
            fits = other is not None and other not in nodes
        elif other is None:
            fits = len(nodes) == 3
        else:
            fits = len(nodes) == 4 and nodes[(nodes.index(first) + 2) % 4] == other
        if fits:
            found.append(face)
    if len(found) != 1:
        return None
    face, middles = found[0], MIDDLES.get(kind, {})
    edges = zip(face, (*face[1:], face[0]), strict=True)
    between = [middles[frozenset(edge)] for edge in edges] if middles else []
    return np.array([cell[k] for k in (*face, *between)])


def inward(corners: Ints, first: int) -> list[int]:
    """The corners of an outward face in the order in which Nastran gives pressures, from ``first``
    on: seen from outside it runs the other way round."""
    at = corners.tolist().index(first)
    return [(at - k) % len(corners) for k in range(len(corners))]


def pressed(points: Floats, pressure: Floats, along: Floats | None = None) -> Floats:
    """Forces (n, 3) on the nodes of a face under a pressure, which is linear between its corners.

    Parameters
    ----------
    points : (n, 3) array
        Corners, then the nodes between them.
    pressure : array
        At the corners.
    along : (3,) array, optional
        Of unit length; default: the normal.
    """
    corners = corners_of(len(points))
    xi, weights = face_rule(corners)
    N, dN = face_functions(len(points), xi)
    between, _ = face_functions(corners, xi)
    tangents = np.einsum("qna,nx->qax", dN, points)
    normals = np.cross(tangents[:, 0], tangents[:, 1])
    if along is not None:
        normals = np.linalg.norm(normals, axis=1)[:, None] * along
    forces: Floats = np.einsum("q,qn,q,qx->nx", weights, N, between @ pressure, normals)
    return forces


def along_beam(
    points: Floats, along: Floats, nodes: list[int], place: float, vector: Floats, *, turns: bool
) -> tuple[list[int], Floats]:
    """A force, or a moment, at a place of a beam from 0 to 1, by the cubic functions of bending:
    the two nodes beside it, and forces and moments (2, 6) on them.

    Parameters
    ----------
    points : (N, 3) array
        Of all nodes.
    along : (3,) array
        Direction of the beam.
    nodes : list of int
        From its beginning to its end, evenly.
    vector : (3,) array
        The force; if it ``turns`` the moment.
    """
    pieces = len(nodes) - 1
    k = min(int(place * pieces), pieces - 1)
    ends = nodes[k : k + 2]
    length, s = float(np.linalg.norm(points[ends[1]] - points[ends[0]])), place * pieces - k
    lengthwise = (vector @ along) * along
    across = vector - lengthwise
    of_ends = np.zeros((2, 6))
    turn = slice(3, 6) if turns else slice(0, 3)
    of_ends[:, turn] += np.outer([1 - s, s], lengthwise)
    if turns:
        of_ends[:, :3] += np.outer([1.0, -1.0], np.cross(across, along) * 6 * s * (s - 1) / length)
        of_ends[:, 3:] += np.outer([1 - 4 * s + 3 * s**2, 3 * s**2 - 2 * s], across)
    else:
        turned = length * np.cross(along, across)
        of_ends[:, :3] += np.outer([1 - 3 * s**2 + 2 * s**3, 3 * s**2 - 2 * s**3], across)
        of_ends[:, 3:] += np.outer([s - 2 * s**2 + s**3, s**3 - s**2], turned)
    return ends, of_ends
