"""Shape functions of faces of elements, and integrals of them: what pressure and traction do at
nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexgram.basics import Floats, Ints


def _triangle(xi: Floats, quadratic: bool) -> tuple[Floats, Floats]:
    """Shape functions (q, n) and derivatives (q, n, 2) at points of the unit triangle."""
    corner = np.column_stack([1 - xi.sum(axis=1), xi])
    slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if not quadratic:
        return corner, np.broadcast_to(slope, (len(xi), 3, 2))
    edges = ((0, 1), (1, 2), (2, 0))
    N = np.hstack(
        [
            corner * (2 * corner - 1),
            np.column_stack([4 * corner[:, i] * corner[:, j] for i, j in edges]),
        ]
    )
    dN = [(4 * corner[:, i, None] - 1) * slope[i] for i in range(3)]
    dN += [4 * (corner[:, i, None] * slope[j] + corner[:, j, None] * slope[i]) for i, j in edges]
    return N, np.stack(dN, axis=1)


def _quadrilateral(xi: Floats, quadratic: bool) -> tuple[Floats, Floats]:
    """The same at points of the square from -1 to 1: bilinear, or serendipity with 8 nodes."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    x, y = xi[:, :1], xi[:, 1:]
    a, b = corners[:, 0], corners[:, 1]
    N = 0.25 * (1 + a * x) * (1 + b * y)
    dx, dy = 0.25 * a * (1 + b * y), 0.25 * b * (1 + a * x)
    if quadratic:
        middles = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
        inner, ix, iy = N, dx, dy
        factor = a * x + b * y - 1
        N = inner * factor
        dx, dy = ix * factor + inner * a, iy * factor + inner * b
        more = []
        for p, q in middles:
            if p == 0:
                more.append(
                    (0.5 * (1 - x**2) * (1 + q * y), -x * (1 + q * y), 0.5 * (1 - x**2) * q)
                )
            else:
                more.append(
                    (0.5 * (1 + p * x) * (1 - y**2), 0.5 * p * (1 - y**2), -(1 + p * x) * y)
                )
        N, dx, dy = (
            np.hstack([whole, *(part[k] for part in more)]) for k, whole in enumerate((N, dx, dy))
        )
    return N, np.stack([dx, dy], axis=2)


def corners_of(nodes: int) -> int:
    """Corners of a face with so many nodes: 3, 4, 6 or 8."""
    return 3 if nodes in (3, 6) else 4


def face_functions(nodes: int, xi: Floats) -> tuple[Floats, Floats]:
    """Shape functions (q, n) and derivatives (q, n, 2) of a face with 3, 4, 6 or 8 nodes at points
    (q, 2) of the unit triangle, or of the square from -1 to 1."""
    corners = corners_of(nodes)
    shape = _triangle if corners == 3 else _quadrilateral
    return shape(xi, nodes > corners)


def face_rule(corners: int) -> tuple[Floats, Floats]:
    """Points and weights, exact for polynomials of degree 4 (triangle, Dunavant 1985) and of degree
    5 in each direction (square)."""
    if corners == 3:
        points, weights = [], []
        for a, w in (
            (0.445948490915964886318, 0.5 * 0.223381589678011465699),
            (0.091576213509770743460, 0.5 * 0.109951743655321867638),
        ):
            points += [(a, a), (1 - 2 * a, a), (a, 1 - 2 * a)]
            weights += 3 * [w]
        return np.array(points), np.array(weights)
    line, weight = np.sqrt(0.6) * np.arange(-1.0, 2.0), np.array([5.0, 8.0, 5.0]) / 9
    X, Y = np.meshgrid(line, line)
    return np.column_stack([X.ravel(), Y.ravel()]), np.outer(weight, weight).ravel()


def areas_at_nodes(points: Floats, faces: Sequence[Ints]) -> tuple[Floats, Floats]:
    """Integrals of the shape functions over faces: times the normal, and by themselves.

    Parameters
    ----------
    points : (N, 3) array
    faces : sequence of (F, 3), (F, 4), (F, 6) or (F, 8) int arrays
        Faces of elements, outward: corners, then the nodes between them.

    Returns
    -------
    vectors : (N, 3) array
        ``∫ N n dA``, outward.
    areas : (N,) array
        ``∫ N dA``.
    """
    vectors, areas = np.zeros_like(points), np.zeros(len(points))
    for nodes in faces:
        xi, weights = face_rule(corners_of(nodes.shape[1]))
        N, dN = face_functions(nodes.shape[1], xi)
        tangents = np.einsum("qna,fnx->qafx", dN, points[nodes])
        normals = weights[:, None, None] * np.cross(tangents[:, 0], tangents[:, 1])
        np.add.at(vectors, nodes, np.einsum("qn,qfx->fnx", N, normals))
        np.add.at(areas, nodes, np.einsum("qn,qf->fn", N, np.linalg.norm(normals, axis=2)))
    return vectors, areas
