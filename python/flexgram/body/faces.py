"""Faces of elements: the outer surface of a mesh, and where the middle of an interface is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexgram.basics import Floats, Ints

#: Faces of solids by their corner nodes, in VTK's order, outward.
FACES: dict[str, list[tuple[int, ...]]] = {
    "tetra": [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)],
    "hexahedron": [
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ],
    "wedge": [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
}
#: The node between two corners of elements with such nodes.
MIDDLES: dict[str, dict[frozenset[int], int]] = {
    "tetra10": {
        frozenset(e): 4 + k for k, e in enumerate([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
    },
    "hexahedron20": {
        frozenset(e): 8 + k
        for k, e in enumerate(
            [
                (0, 1),
                (1, 2),
                (2, 3),
                (3, 0),
                (4, 5),
                (5, 6),
                (6, 7),
                (7, 4),
                (0, 4),
                (1, 5),
                (2, 6),
                (3, 7),
            ]
        )
    },
    "wedge15": {
        frozenset(e): 6 + k
        for k, e in enumerate(
            [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
        )
    },
}
LINEAR = {"tetra10": "tetra", "hexahedron20": "hexahedron", "wedge15": "wedge"}
#: Of shells.
CORNERS = {
    **{"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4},
    **{"triangle/membrane": 3, "quad/membrane": 4},
}


def faces_of(blocks: Sequence[tuple[str, Ints]], inside: NDArray[np.bool_] | None = None) -> Ints:
    """Every face of every solid by its four corner nodes, (F, 4); the last one of a triangle is its
    first. Where there is none, the shells themselves.

    Parameters
    ----------
    blocks : sequence of (str, int array)
        Meshio type and indices of nodes.
    inside : bool array, optional
        Nodes; only faces whose corners all belong to them are returned.
    """
    of_solids = [
        (nodes, face) for kind, nodes in blocks for face in FACES.get(LINEAR.get(kind, kind), [])
    ]
    faces = _chosen(of_solids, inside)
    return faces if len(faces) else shells_of(blocks, inside)


def shells_of(blocks: Sequence[tuple[str, Ints]], inside: NDArray[np.bool_] | None = None) -> Ints:
    """Shells by their corner nodes, as ``faces_of``."""
    return _chosen(
        [(nodes, tuple(range(CORNERS[kind]))) for kind, nodes in blocks if kind in CORNERS], inside
    )


def _chosen(
    corners: Sequence[tuple[Ints, tuple[int, ...]]], inside: NDArray[np.bool_] | None
) -> Ints:
    faces = [np.empty((0, 4), dtype=np.int64)]
    for nodes, face in corners:
        if inside is not None:
            for corner in face:  # few are left after the first
                nodes = nodes[inside[nodes[:, corner]]]
        chosen = nodes[:, face]
        faces.append(chosen if len(face) == 4 else np.hstack([chosen, chosen[:, :1]]))
    return np.vstack(faces)


def outer(faces: Ints) -> Ints:
    """Faces that are there once, in the order of their nodes; without quadrilaterals that two
    triangles of the same corners cover, where tetrahedra stand on hexahedra."""
    corners = faces.copy()
    corners[faces[:, 3] == faces[:, 0], 3] = -1  # seen from the other side it starts elsewhere
    _, first, count = np.unique(
        np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True
    )
    alone: Ints = faces[first[count == 1]]
    threes = alone[:, 3] == alone[:, 0]
    if threes.all() or not threes.any():
        return alone
    triangles = {tuple(sorted(alone[k, :3].tolist())): int(k) for k in np.flatnonzero(threes)}
    covered: list[int] = []
    for k in np.flatnonzero(~threes):
        a, b, c, d = alone[k].tolist()
        for halves in (((a, b, c), (a, c, d)), ((a, b, d), (b, c, d))):
            found = [triangles.get(tuple(sorted(half)), -1) for half in halves]
            if min(found) >= 0:
                covered += [int(k), *found]
    return np.delete(alone, covered, axis=0)


def whole_faces(blocks: Sequence[tuple[str, Ints]], nodes: Ints, count: int) -> list[Ints]:
    """Outer faces of solids, and shells, whose corners are all among some nodes, with the nodes
    between their corners: (F, 3), (F, 4), (F, 6) and (F, 8) arrays, those that there are. A shell
    that covers the face of a solid is left out; shells are seen from behind, so that pressure
    pushes along their normals, as in Abaqus, CalculiX and Nastran.

    Parameters
    ----------
    blocks : sequence of (str, int array)
        Meshio type and indices of nodes.
    nodes : int array
    count : int
        Number of all nodes.
    """
    inside, outside = _outside(blocks, nodes, count)
    found: dict[int, list[Ints]] = {}
    for kind, elements in blocks:
        middles = MIDDLES.get(kind, {})
        for face in FACES.get(LINEAR.get(kind, kind), []):
            between = [
                middles[frozenset(edge)]
                for edge in zip(face, (*face[1:], face[0]), strict=True)
                if middles
            ]
            near = elements[np.all(inside[elements[:, face]], axis=1)]
            mine = [row for row in near if tuple(sorted(row[list(face)].tolist())) in outside]
            if mine:
                whole = np.array(mine)[:, [*face, *between]]
                found.setdefault(whole.shape[1], []).append(whole)
    for shells in _loose(blocks, inside, outside):
        found.setdefault(shells.shape[1], []).append(shells[:, ::-1])
    return [np.vstack(faces) for faces in found.values()]


def loose_shells(blocks: Sequence[tuple[str, Ints]], nodes: Ints, count: int) -> list[Ints]:
    """Shells whose nodes are all among some nodes, without those that cover a face of a solid; as
    ``whole_faces``."""
    inside, outside = _outside(blocks, nodes, count)
    return _loose(blocks, inside, outside)


def _outside(
    blocks: Sequence[tuple[str, Ints]], nodes: Ints, count: int
) -> tuple[NDArray[np.bool_], set[tuple[int, ...]]]:
    """Which of all nodes are among some, and the outer faces of solids between those."""
    inside = np.zeros(count, dtype=bool)
    inside[nodes] = True
    solids = [block for block in blocks if block[0] not in CORNERS]
    return inside, {tuple(sorted(set(face))) for face in outer(faces_of(solids, inside)).tolist()}


def _loose(
    blocks: Sequence[tuple[str, Ints]],
    inside: NDArray[np.bool_],
    outside: set[tuple[int, ...]],
) -> list[Ints]:
    found = []
    for kind, elements in blocks:
        if kind in CORNERS:
            near = elements[np.all(inside[elements], axis=1)]
            mine = [
                row for row in near if tuple(sorted(row[: CORNERS[kind]].tolist())) not in outside
            ]
            if mine:
                found.append(np.array(mine))
    return found


def opposed(faces: Ints) -> tuple[int, int] | None:
    """Two nodes of an edge at which two faces of (F, 4) meet whose normals point to different
    sides; None where there is none."""
    directed = np.vstack([faces[:, [k, (k + 1) % 4]] for k in range(4)])
    directed = directed[directed[:, 0] != directed[:, 1]]
    edges, which, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    forward = np.bincount(which.ravel(), directed[:, 0] < directed[:, 1], len(edges))
    wrong = np.flatnonzero((count == 2) & (forward != 1))
    return (int(edges[wrong[0], 0]), int(edges[wrong[0], 1])) if len(wrong) else None


def volume_of(points: Floats, blocks: Sequence[tuple[str, Ints]]) -> float:
    """Volume of the solids, by their corner nodes (divergence theorem); 0 without solids."""
    faces = faces_of([block for block in blocks if block[0] not in CORNERS])
    vectors, centres = _areas(points, faces)
    return float(np.sum(vectors * centres)) / 3


@dataclass
class Middle:
    """Where the reference node of an interface goes by default.

    Attributes
    ----------
    position : (3,) array
        Area-weighted mean of the faces whose nodes all belong to the interface; where they lie on a
        cylinder, the middle of its axis; without such faces the mean of the nodes.
    mean : (3,) array
        Plain mean of the nodes.
    extent : float
        Diagonal of the box around the nodes.
    area : float
        Of the faces.
    axis : (3,) array or None
        Direction of the cylinder's axis.
    radii : tuple of float
        Of the cylinder, or of several on one axis (a stepped bore).
    """

    position: Floats
    mean: Floats
    extent: float
    area: float = 0.0
    axis: Floats | None = None
    radii: tuple[float, ...] = ()

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
            radii = " and ".join(f"{radius * length:.4g} m" for radius in self.radii)
            what = f"on the axis ({direction}) of its cylinder of radius {radii}"
        offset = float(np.linalg.norm(self.position - self.mean))
        beside = f", {offset * length:.3g} m beside the mean of its nodes"
        return what + (beside if offset > 1e-3 * self.extent else "")


def middle_of(points: Floats, blocks: Sequence[tuple[str, Ints]], nodes: Ints) -> Middle:
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
    middle = Middle(_rounded(area @ centres / whole, extent), mean, extent, whole)
    cylinder = _cylinder(points, faces, vectors, area, centres)
    if cylinder is not None:
        middle.axis, on_axis, middle.radii, wall = cylinder
        along = (points[wall] - on_axis) @ middle.axis
        between = on_axis + middle.axis * (0.5 * (along.min() + along.max()))
        middle.position = _rounded(between, extent)
    return middle


def _rounded(place: Floats, extent: float) -> Floats:
    """Without digits that the mesh does not have."""
    digits = 11 - int(np.floor(np.log10(max(extent, np.abs(place).max(), 1e-300))))
    rounded: Floats = np.round(place, digits) + 0.0
    return rounded


def _areas(points: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Area vectors and centres of faces, by their two triangles."""
    a, b, c, d = (points[faces[:, k]] for k in range(4))
    first, second = 0.5 * np.cross(b - a, c - a), 0.5 * np.cross(c - a, d - a)
    sizes = np.linalg.norm([first, second], axis=2)
    whole = np.maximum(sizes.sum(axis=0), 1e-300)
    middles = sizes[0][:, None] * (a + b + c) / 3 + sizes[1][:, None] * (a + c + d) / 3
    return first + second, middles / whole[:, None]


def _cylinder(
    points: Floats, faces: Ints, vectors: Floats, area: Floats, centres: Floats
) -> tuple[Floats, Floats, tuple[float, ...], Ints] | None:
    """Axis, a point on it, radii and nodes of a cylinder of a third of a turn or more, or of
    several on one axis: a bore with its counterbore and perhaps the shoulder between them.

    The faces' normals are across the axis (walls) or along it (shoulders); those of the walls
    spread over at least 120°. Walls' corner nodes, at eight angles or more, are at one distance
    from the axis, or at few (to 1 %), by least squares.
    """
    normals = vectors / np.maximum(area, 1e-300)[:, None]
    _, directions = np.linalg.eigh((normals * area[:, None]).T @ normals)
    for k in range(3):
        slope = np.abs(normals @ directions[:, k])
        wall = slope < 0.35
        if not np.all(wall | (slope > 0.95)) or area[wall].sum() < 0.3 * area.sum():
            continue
        found = _fit(points, np.unique(faces[wall]), normals[wall], area[wall], centres[wall])
        if found is not None:
            return found
    return None


def _fit(
    points: Floats, nodes: Ints, normals: Floats, area: Floats, centres: Floats
) -> tuple[Floats, Floats, tuple[float, ...], Ints] | None:
    from scipy.optimize import least_squares

    spread, frame = np.linalg.eigh((normals * area[:, None]).T @ normals / area.sum())
    if spread[0] > 0.02 or spread[1] < 0.29:
        return None
    frame = frame[:, [1, 2, 0]]  # the axis last
    origin = points[nodes].mean(axis=0)
    size = float(np.abs(points[nodes] - origin).max())
    local = (points[nodes] - origin) @ frame / size

    def arms(x: Floats) -> Floats:
        """From the axis through (x0, x1, 0) along (x2, x3, 1) to the nodes."""
        direction = np.array([x[2], x[3], 1.0]) / np.sqrt(1 + x[2] ** 2 + x[3] ** 2)
        arm = local - [x[0], x[1], 0.0]
        across: Floats = arm - np.outer(arm @ direction, direction)
        return across

    # Normals of walls meet on the axis, whatever the radius.
    across = normals @ frame[:, :2]
    tangents = np.sqrt(area)[:, None] * np.column_stack([-across[:, 1], across[:, 0]])
    through = np.sum(tangents * ((centres - origin) @ frame[:, :2] / size), axis=1)
    x = np.append(np.linalg.lstsq(tangents, through, rcond=None)[0], [0.0, 0.0])
    for _ in range(3):  # radii by gaps between the distances, which the fit makes sharper
        distance = np.linalg.norm(arms(x), axis=1)
        order = np.argsort(distance)
        step = np.diff(distance[order]) > 0.04 * distance.max()
        group = np.empty(len(nodes), dtype=np.int64)
        group[order] = np.concatenate([[0], np.cumsum(step)])
        count = int(group.max()) + 1
        if count > 3:
            return None

        def off(y: Floats, group: Ints = group, count: int = count) -> Floats:
            """Each distance beside the mean of those of its radius."""
            far = np.linalg.norm(arms(y), axis=1)
            means = np.bincount(group, far, count) / np.bincount(group, minlength=count)
            beside: Floats = far - means[group]
            return beside

        fit = least_squares(off, x, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        x = fit.x
    arm = arms(x)
    distance = np.linalg.norm(arm, axis=1)
    angles = np.unique(np.round(np.arctan2(arm[:, 1], arm[:, 0]), 3))
    if len(angles) < 8 or np.any(np.abs(fit.fun) > 0.01 * distance):
        return None
    axis = frame @ np.array([x[2], x[3], 1.0])
    # Flat walls may have their nodes at few distances too, but not their normals at the axis.
    arm = centres - origin - size * (frame[:, :2] @ x[:2])
    arm -= np.outer(arm @ axis, axis) / (axis @ axis)
    if np.any(np.abs(np.sum(normals * arm, axis=1)) < 0.94 * np.linalg.norm(arm, axis=1)):
        return None
    axis *= np.sign(axis[np.argmax(np.abs(axis))]) / np.linalg.norm(axis)
    radii = tuple(float(size * distance[group == g].mean()) for g in range(count))
    return axis, origin + size * (frame[:, :2] @ x[:2]), radii, nodes
