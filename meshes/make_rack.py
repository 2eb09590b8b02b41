#!/usr/bin/env python3
"""Makes rack.msh: two stiff plates joined by a frame of square struts, in Hex20 elements.

The frame is a lattice of cubes, one where struts meet; every strut is a prism between two
faces of cubes, so the mesh is conforming: posts are straight, rungs are level, braces are
sheared prisms. The plates are slabs whose grid lines go through the edges of the posts.

Our own geometry, after the rack of figure 3 in Fehr, Eberhard, Lehner ("Improving the
reduction process in flexible multibody dynamics by the use of 2nd order position Gramian
matrices"); only the idea of two plates on a frame is theirs. Run with Debian's Python:

    /usr/bin/python3 meshes/make_rack.py
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import meshio
import numpy as np

WIDTH, DEPTH, HEIGHT = 0.60, 0.40, 0.90  # outer faces of the posts, between the plates [m]
STRUT = 0.036  # side of the square section [m]
LEVELS = 5  # cubes along a post, the first and the last under the plates
POST_ELEMENTS, BRACE_ELEMENTS, RUNG_ELEMENTS = 6, 12, 7  # along a strut between cubes
OVERHANG, THICKNESS = 0.06, 0.020  # of the plates [m]

# Corners and edges of VTK's hexahedron on the unit cube.
CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
EDGES = [
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


class Hex20Mesh:
    """Elements given by eight corners; nodes that coincide are one."""

    def __init__(self) -> None:
        self.points: list[np.ndarray] = []
        self.index: dict[tuple[int, ...], int] = {}
        self.cells: list[list[int]] = []
        self.region: list[str] = []

    def node(self, point: np.ndarray) -> int:
        key = tuple(np.round(point / 1e-7).astype(int))
        if key not in self.index:
            self.index[key] = len(self.points)
            self.points.append(point)
        return self.index[key]

    def add(self, corners: np.ndarray, region: str) -> None:
        middles = [(corners[a] + corners[b]) / 2 for a, b in EDGES]
        self.cells.append([self.node(x) for x in [*corners, *middles]])
        self.region.append(region)

    def add_prism(self, start: np.ndarray, end: np.ndarray, axis: int, count: int) -> None:
        """Elements from a cube's face at `start` to the face at `end`; both lie across `axis`."""
        sides = [a for a in range(3) if a != axis]
        for k in range(count):
            corners = []
            for c in CORNERS:
                t = (k + c[axis]) / count
                x = start + t * (end - start)
                for a in sides:
                    x[a] += STRUT * c[a]
                corners.append(x)
            self.add(np.array(corners), "struts")


def cube(origin: np.ndarray) -> np.ndarray:
    return origin + STRUT * CORNERS


def build() -> Hex20Mesh:
    mesh = Hex20Mesh()
    x_post, y_post = (0.0, WIDTH - STRUT), (0.0, DEPTH - STRUT)
    z_cube = np.linspace(0.0, HEIGHT - STRUT, LEVELS)
    origin = {
        (i, j, k): np.array([x, y, z])
        for i, x in enumerate(x_post)
        for j, y in enumerate(y_post)
        for k, z in enumerate(z_cube)
    }

    def strut(a: tuple[int, int, int], b: tuple[int, int, int], axis: int, count: int) -> None:
        start = origin[a].copy()
        start[axis] += STRUT
        mesh.add_prism(start, origin[b].copy(), axis, count)

    for corner in origin.values():
        mesh.add(cube(corner), "struts")
    for i in range(2):
        for j in range(2):
            for k in range(LEVELS - 1):
                strut((i, j, k), (i, j, k + 1), 2, POST_ELEMENTS)
    strut((0, 0, 1), (1, 0, 3), 0, BRACE_ELEMENTS)  # front, rising to the right
    strut((0, 1, 3), (1, 1, 1), 0, BRACE_ELEMENTS)  # back, falling to the right
    for i in range(2):
        for k in (1, 3):
            strut((i, 0, k), (i, 1, k), 1, RUNG_ELEMENTS)  # sides

    def grid(length: float) -> np.ndarray:
        inner = np.linspace(STRUT, length - STRUT, 4)
        return np.concatenate([[-OVERHANG, 0.0], inner, [length, length + OVERHANG]])

    for region, bottom in (("lower_plate", -THICKNESS), ("upper_plate", HEIGHT)):
        xs, ys = grid(WIDTH), grid(DEPTH)
        for x0, x1 in pairwise(xs):
            for y0, y1 in pairwise(ys):
                size = np.array([x1 - x0, y1 - y0, THICKNESS])
                mesh.add(np.array([x0, y0, bottom]) + size * CORNERS, region)
    return mesh


def main() -> None:
    mesh = build()
    names = ["struts", "lower_plate", "upper_plate"]
    tags = [1 + names.index(region) for region in mesh.region]
    order = np.argsort(tags, kind="stable")
    cells = np.array(mesh.cells)[order]
    tag = np.array(tags)[order]
    blocks = [("hexahedron20", cells[tag == t]) for t in np.unique(tag)]
    data = [tag[tag == t] for t in np.unique(tag)]
    result = meshio.Mesh(
        np.array(mesh.points),
        blocks,
        cell_data={"gmsh:physical": data, "gmsh:geometrical": data},
        field_data={name: np.array([1 + k, 3]) for k, name in enumerate(names)},
    )
    path = Path(__file__).with_name("rack.msh")
    meshio.write(path, result, file_format="gmsh22", binary=False)
    plates = np.unique(cells[tag > 1])
    free = len(mesh.points) - len(plates)
    print(f"{path.name}: {len(cells)} elements, {len(mesh.points)} nodes, {3 * free + 12} dofs")


if __name__ == "__main__":
    main()
