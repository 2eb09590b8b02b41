"""Where the reference of an interface goes, and which units the numbers of a body can be in."""

from __future__ import annotations

import itertools
from typing import Any

import gmsh
import numpy as np
import pytest

from flexgram.body.faces import faces_of, middle_of, outer, volume_of
from flexgram.body.units import UNITS, doubt, spacing

KINDS = {4: "tetra", 11: "tetra10"}


def mesh_of(order: int, make: Any, size: float) -> tuple[Any, list[tuple[str, Any]]]:
    """Points and tetrahedra of a geometry of gmsh's."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        make(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)  # or facets of holes may overlap
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.removeDuplicateNodes()
        labels, points, _ = gmsh.model.mesh.getNodes()
        at = np.zeros(int(labels.max()) + 1, dtype=np.int64)
        at[labels.astype(int)] = np.arange(len(labels))
        kinds, _, nodes = gmsh.model.mesh.getElements(3)
        count = {4: 4, 11: 10}[int(kinds[0])]
        return points.reshape(-1, 3), [
            (KINDS[int(kinds[0])], at[nodes[0].astype(int)].reshape(-1, count))
        ]
    finally:
        gmsh.finalize()


def turned(points: Any) -> tuple[Any, Any]:
    """Turned about a crooked axis and moved: coordinates of no face are round numbers."""
    u = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    S = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    R = np.eye(3) + np.sin(0.7) * S + (1 - np.cos(0.7)) * S @ S
    return points @ R.T + [100.0, -3.0, 7.0], R


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("size", [2.0, 6.0])
def test_the_reference_of_a_bore_is_on_its_axis(order: int, size: float) -> None:
    """An unstructured mesh, finer at one end, so that the mean of the nodes is beside the axis."""

    def bracket(occ: Any) -> None:
        plate = occ.addBox(0, 0, 0, 60, 40, 12)
        bore = occ.addCylinder(45, 20, 0, 0, 0, 12, 8)
        pin = occ.addCylinder(34, 20, 0, 0, 0, 12, 1.0)  # a small hole: fine nodes on one side
        occ.cut([(3, plate)], [(3, bore), (3, pin)])

    points, blocks = mesh_of(order, bracket, size)
    on = np.flatnonzero(np.abs(np.hypot(points[:, 0] - 45, points[:, 1] - 20) - 8) < 1e-6)
    moved, R = turned(points)
    middle = middle_of(moved, blocks, on)
    assert middle.axis is not None and middle.radii == pytest.approx((8,), rel=1e-9)
    assert abs(middle.axis @ R[:, 2]) == pytest.approx(1, abs=1e-12)
    exact = turned(np.array([[45.0, 20.0, 6.0]]))[0][0]
    assert np.linalg.norm(middle.position - exact) < 1e-8
    assert "radius 0.008 m" in middle.said(1e-3)


def test_a_stepped_bore_has_one_axis() -> None:
    """A bore, its counterbore, and the shoulder, whose faces partly belong to the set."""

    def lug(occ: Any) -> None:
        block = occ.addBox(0, 0, 0, 60, 30, 12)
        bore = occ.addCylinder(45, 15, 0, 0, 0, 12, 6)
        wide = occ.addCylinder(45, 15, 8, 0, 0, 4, 9)
        pin = occ.addCylinder(30, 15, 0, 0, 0, 12, 1.0)  # fine nodes on one side
        occ.cut([(3, block)], [(3, bore), (3, wide), (3, pin)])

    points, blocks = mesh_of(2, lug, 4.0)
    far = np.hypot(points[:, 0] - 45, points[:, 1] - 15)
    walls = (np.abs(far - 6) < 1e-6) | (np.abs(far - 9) < 1e-6) & (points[:, 2] > 8 - 1e-6)
    middle = middle_of(points, blocks, np.flatnonzero(walls))
    assert middle.radii == pytest.approx((6, 9), rel=1e-6)
    assert np.allclose(middle.position, [45, 15, 6], atol=1e-6)


def test_half_a_bore_has_its_axis_too() -> None:
    def shell(occ: Any) -> None:
        block = occ.addBox(-15, 0, 0, 30, 15, 20)
        occ.cut([(3, block)], [(3, occ.addCylinder(0, 0, 0, 0, 0, 20, 10))])

    points, blocks = mesh_of(2, shell, 4.0)
    on = np.flatnonzero(np.abs(np.hypot(points[:, 0], points[:, 1]) - 10) < 1e-6)
    middle = middle_of(points, blocks, on)
    assert middle.axis is not None
    assert np.hypot(*middle.position[:2]) < 1e-8
    assert middle.mean[1] > 5 and "beside the mean" in middle.said(1e-3)


def test_a_plane_face_has_its_centroid() -> None:
    def wedge(occ: Any) -> None:
        box = occ.addBox(0, 0, 0, 10, 6, 4)
        hole = occ.addCylinder(1, 3, 0, 0, 0, 4, 0.5)  # fine nodes near one end
        occ.cut([(3, box)], [(3, hole)])

    points, blocks = mesh_of(2, wedge, 3.0)
    on = np.flatnonzero(np.abs(points[:, 2]) < 1e-9)
    middle = middle_of(points, blocks, on)
    faces = outer(faces_of(blocks))
    hole = 60 - sum(  # the area that is there, by the corner nodes
        0.5 * np.linalg.norm(np.cross(points[b] - points[a], points[c] - points[a]))
        for a, b, c, _ in faces
        if np.all(np.abs(points[[a, b, c], 2]) < 1e-9)
    )
    assert middle.axis is None and middle.area == pytest.approx(60 - hole)
    assert middle.position[0] == pytest.approx((60 * 5 - hole * 1) / (60 - hole), abs=1e-2)
    assert middle.position[1] == pytest.approx(3, abs=1e-2)
    assert abs(middle.mean[0] - middle.position[0]) > 0.3  # the plain mean is elsewhere


def test_what_is_no_cylinder() -> None:
    """Edges, single nodes, the hull of a box, a flat arc: the mean or the centroid."""

    def box(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 10, 10)

    points, blocks = mesh_of(1, box, 2.0)
    edge = np.flatnonzero((np.abs(points[:, 0]) < 1e-9) & (np.abs(points[:, 1]) < 1e-9))
    middle = middle_of(points, blocks, edge)
    assert middle.area == 0 and np.allclose(middle.position, points[edge].mean(0))
    assert middle.said(1) == "the mean of its nodes"
    sides = np.flatnonzero(np.any(np.abs(points[:, :2] % 10) < 1e-9, axis=1))
    hull = middle_of(points, blocks, sides)
    assert hull.axis is None and np.allclose(hull.position, 5, atol=0.1)
    assert volume_of(points, blocks) == pytest.approx(1000)
    quads = [("quad", np.array([[0, 1, 2, 3]]))]
    flat = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]])
    assert np.allclose(middle_of(flat, quads, np.arange(4)).position, [1, 0.5, 0])


@pytest.mark.parametrize("count", [2, 3, 4, 5])
@pytest.mark.parametrize("sides", ["ring", "channel"])
def test_flat_walls_are_no_cylinder(count: int, sides: str) -> None:
    """Regular meshes of a square hole or a channel have their nodes at few distances too."""
    t = np.linspace(-1, 1, count + 1)
    bottom, right = np.column_stack([t, t * 0 - 1]), np.column_stack([t * 0 + 1, t])
    walls = [bottom, right, -right] + ([-bottom] if sides == "ring" else [])
    quads, points = [], []
    for wall in walls:
        for a, b in itertools.pairwise(wall):
            first = len(points)
            points += [[*a, 0], [*b, 0], [*b, 1], [*a, 1]]
            quads.append([first, first + 1, first + 2, first + 3])
    middle = middle_of(np.array(points), [("quad", np.array(quads))], np.arange(len(points)))
    assert middle.axis is None


def test_the_outer_surface_has_no_faces_inside() -> None:
    def box(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 6, 4)

    points, blocks = mesh_of(2, box, 2.0)
    surface = outer(faces_of(blocks))
    a, b, c, _ = (points[surface[:, k]] for k in range(4))
    assert np.linalg.norm(0.5 * np.cross(b - a, c - a), axis=1).sum() == pytest.approx(2 * 124)


@pytest.mark.parametrize("kind", ["hexahedron", "wedge"])
def test_faces_of_solids_close(kind: str) -> None:
    """The vector areas of a closed surface vanish, whatever the element."""
    corners = {
        "hexahedron": [
            [0, 0, 0],
            [1, 0, 0],
            [1, 1, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 0, 1.2],
            [1.1, 1, 1],
            [0, 1, 1],
        ],
        "wedge": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1.3, 1]],
    }[kind]
    points = np.array(corners)
    faces = outer(faces_of([(kind, np.arange(len(points))[None])]))
    a, b, c, d = (points[faces[:, k]] for k in range(4))
    assert np.abs(0.5 * np.cross(c - a, d - b).sum(axis=0)).max() < 1e-12


STEEL = {
    "SI": (5170.0, 7850.0, 0.3),
    "mm-t-s": (5.17e6, 7.85e-9, 300.0),
    "mm-kg-s": (5.17e6, 7.85e-6, 300.0),
    "in-lbf-s": (2.035e5, 7.345e-4, 11.8),
    "ft-lbf-s": (1.696e4, 15.23, 0.98),
}


@pytest.mark.parametrize("given", UNITS)
@pytest.mark.parametrize("taken", UNITS)
def test_units_are_told_apart(given: str, taken: str) -> None:
    words = doubt(taken, *STEEL[given])
    if given == taken:
        assert words is None
    else:
        assert words is not None and given in words.split("are the files in ")[1]


def test_uncommon_materials_are_no_mistake() -> None:
    for speed, density, extent in ((30, 1000, 0.02), (12e3, 1850, 2), (500, 40, 80), (1e3, 2e4, 1)):
        assert doubt("SI", speed, density, extent) is None


def test_spacing_of_nodes() -> None:
    grid = np.stack(np.meshgrid(*(np.arange(5) * h for h in (1, 2, 3))), axis=-1).reshape(-1, 3)
    assert spacing(grid.astype(float)) == 1
    assert spacing(np.zeros((3, 3))) == 0


def test_tetrahedra_on_a_hexahedron() -> None:
    """Two of them on one of its faces, by either diagonal: that face is inside."""
    hexahedron = np.arange(8)[None]
    for base in (((4, 5, 6), (4, 6, 7)), ((4, 5, 7), (5, 6, 7))):
        tetra = np.array([[*corners, 8] for corners in base])
        left = outer(faces_of([("hexahedron", hexahedron), ("tetra", tetra)]))
        sets = {frozenset(face) for face in left.tolist()}
        assert frozenset({4, 5, 6, 7}) not in sets and not sets & {frozenset(b) for b in base}
        assert len(sets) == 5 + 4
