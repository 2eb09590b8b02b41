"""Faces of elements: the outer surface of a mesh, and where the middle of an interface is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexgram.basics import IntArray

Floats = NDArray[np.float64]

#: Faces of solids by their corner nodes, in VTK's order, outward.
FACES: dict[str, list[tuple[int, ...]]] = {
    "tetra": [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)],
    "hexahedron": [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6),
                   (3, 0, 4, 7)],
    "wedge": [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
}  # fmt: skip
LINEAR = {"tetra10": "tetra", "hexahedron20": "hexahedron", "wedge15": "wedge"}
SHELLS = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4}


def faces_of(
    blocks: Sequence[tuple[str, IntArray]], inside: NDArray[np.bool_] | None = None
) -> IntArray:
    """Every face of every solid by its four corner nodes, (F, 4); the last one of a triangle is its
    first. Without solids, the shells themselves.

    Parameters
    ----------
    blocks : sequence of (str, int array)
        Meshio type and indices of nodes.
    inside : bool array, optional
        Nodes; only faces whose corners all belong to them are returned.
    """
    corners = [(nodes, face) for kind, nodes in blocks
               for face in FACES.get(LINEAR.get(kind, kind), [])]  # fmt: skip
    if not corners:
        corners = [(nodes, tuple(range(SHELLS[kind]))) for kind, nodes in blocks if kind in SHELLS]
    faces = [np.empty((0, 4), dtype=np.int64)]
    for nodes, face in corners:
        if inside is not None:
            for corner in face:  # few are left after the first
                nodes = nodes[inside[nodes[:, corner]]]
        chosen = nodes[:, face]
        faces.append(chosen if len(face) == 4 else np.hstack([chosen, chosen[:, :1]]))
    return np.vstack(faces)


def outer(faces: IntArray) -> IntArray:
    """Faces that are there once, in the order of their nodes."""
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True,
                                return_counts=True)  # fmt: skip
    alone: IntArray = faces[first[count == 1]]
    return alone


def volume_of(points: Floats, blocks: Sequence[tuple[str, IntArray]]) -> float:
    """Volume of the solids, by their corner nodes (divergence theorem); 0 without solids."""
    faces = faces_of([block for block in blocks if block[0] not in SHELLS])
    vectors, centres = _areas(points, faces)
    return float(np.sum(vectors * centres)) / 3


@dataclass
class Middle:
    """Where the reference node of an interface goes by default.

    Attributes
    ----------
    position : (3,) array
        Area-weighted mean of the faces whose nodes all belong to the interface, moved onto the axis
        where they lie on a cylinder; without such faces the mean of the nodes.
    mean : (3,) array
        Plain mean of the nodes.
    extent : float
        Diagonal of the box around the nodes.
    area : float
        Of the faces.
    axis : (3,) array or None
        Direction of the cylinder's axis.
    radius : float
        Of the cylinder.
    """

    position: Floats
    mean: Floats
    extent: float
    area: float = 0.0
    axis: Floats | None = None
    radius: float = 0.0

    def away(self, position: Floats) -> float:
        """Distance of a place from the middle, in extents of the interface."""
        return float(np.linalg.norm(position - self.position)) / max(self.extent, 1e-300)

    def said(self, length: float) -> str:
        """What it is, in metres if the unit of the points measures ``length``."""
        if not self.area > 0:
            return "the mean of its nodes"
        if self.axis is None:
            what = "the middle of its faces"
        else:
            direction = ", ".join(f"{x:.3g}" for x in np.round(self.axis, 6) + 0.0)
            what = (
                f"on the axis ({direction}) of its cylinder of radius {self.radius * length:.4g} m"
            )
        offset = float(np.linalg.norm(self.position - self.mean))
        beside = f", {offset * length:.3g} m beside the mean of its nodes"
        return what + (beside if offset > 1e-3 * self.extent else "")


def middle_of(points: Floats, blocks: Sequence[tuple[str, IntArray]], nodes: IntArray) -> Middle:
    """The middle of an interface.

    Parameters
    ----------
    points : (N, 3) array
    blocks : sequence of (str, int array)
        Elements of the mesh: meshio type and indices into ``points``.
    nodes : int array
        Indices of the interface's nodes.
    """
    chosen = points[nodes]
    mean = chosen.mean(axis=0)
    extent = float(np.linalg.norm(np.ptp(chosen, axis=0)))
    inside = np.zeros(len(points), dtype=bool)
    inside[nodes] = True
    faces = outer(faces_of(blocks, inside))
    vectors, centres = _areas(points, faces)
    area = np.linalg.norm(vectors, axis=1)
    whole = float(area.sum())
    if not whole > 0:
        return Middle(mean, mean, extent)
    middle = Middle(area @ centres / whole, mean, extent, whole)
    cylinder = _cylinder(points[np.unique(faces)], vectors, area)
    if cylinder is not None:
        middle.axis, on_axis, middle.radius = cylinder
        middle.position = on_axis + middle.axis * (middle.axis @ (middle.position - on_axis))
    return middle


def _areas(points: Floats, faces: IntArray) -> tuple[Floats, Floats]:
    """Area vectors and centres of faces, by their two triangles."""
    a, b, c, d = (points[faces[:, k]] for k in range(4))
    first, second = 0.5 * np.cross(b - a, c - a), 0.5 * np.cross(c - a, d - a)
    sizes = np.linalg.norm([first, second], axis=2)
    whole = np.maximum(sizes.sum(axis=0), 1e-300)
    middles = sizes[0][:, None] * (a + b + c) / 3 + sizes[1][:, None] * (a + c + d) / 3
    return first + second, middles / whole[:, None]


def _cylinder(points: Floats, vectors: Floats, area: Floats) -> tuple[Floats, Floats, float] | None:
    """Axis, a point on it and radius, if the faces lie on a cylinder of a third of a turn or more.

    The faces' normals have nearly no part along the axis and spread over at least 120° about it;
    the corner nodes, at eight angles or more, are at one distance from it (to 1 %), by least
    squares.
    """
    from scipy.optimize import least_squares

    normals = vectors / np.maximum(area, 1e-300)[:, None]
    spread, frame = np.linalg.eigh((normals * area[:, None]).T @ normals / area.sum())
    if spread[0] > 0.02 or spread[1] < 0.29:
        return None
    frame = frame[:, [1, 2, 0]]  # the axis last
    origin = points.mean(axis=0)
    size = float(np.abs(points - origin).max())
    local = (points - origin) @ frame / size

    def arms(x: Floats) -> Floats:
        """From the axis through (x0, x1, 0) along (x2, x3, 1) to the nodes."""
        direction = np.array([x[2], x[3], 1.0]) / np.sqrt(1 + x[2] ** 2 + x[3] ** 2)
        arm = local - [x[0], x[1], 0.0]
        across: Floats = arm - np.outer(arm @ direction, direction)
        return across

    flat = np.column_stack([2 * local[:, :2], np.ones(len(local))])
    circle, _, rank, _ = np.linalg.lstsq(flat, np.sum(local[:, :2] ** 2, axis=1), rcond=None)
    if rank < 3:
        return None
    radius = np.sqrt(max(circle[2] + circle[:2] @ circle[:2], 0.0))
    fit = least_squares(lambda x: np.linalg.norm(arms(x), axis=1) - x[4],
                        [circle[0], circle[1], 0.0, 0.0, radius])  # fmt: skip
    x = fit.x
    arm = arms(x)
    angles = np.unique(np.round(np.arctan2(arm[:, 1], arm[:, 0]), 3))
    if len(angles) < 8 or np.abs(fit.fun).max() > 0.01 * x[4]:
        return None
    axis = frame @ np.array([x[2], x[3], 1.0])
    axis *= np.sign(axis[np.argmax(np.abs(axis))]) / np.linalg.norm(axis)
    return axis, origin + size * (frame[:, :2] @ x[:2]), size * float(x[4])
