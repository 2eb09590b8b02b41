"""Ties of mesh bodies: no rigid motion is resisted, patches, lap joints, shells on solids, rings,
and which face is next."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse.linalg as spl
from scipy.spatial import cKDTree
from test_constraints import RIGID, body, rigid_motions, two_boxes

from bodies import box
from conftest import assembled
from flexgram.body.ties import tied
from sheets import sheet


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("gap", [0.0, 0.003])
@pytest.mark.parametrize(
    "kinds",
    [("hexahedron", "hexahedron"), ("tetra10", "hexahedron20"), ("hexahedron20", "tetra10")],
)
def test_ties_resist_no_rigid_motion(
    kinds: tuple[str, str], gap: float, ranks: int, tmp_path: Path
) -> None:
    """Faces of all kinds, with a gap too; and they join: six eigenvalues are zero, no more."""
    mesh = two_boxes(kinds, ((3, 3, 3), (3, 2, 2)), gap)
    tie = {"seam": {"nodes": "seam", "to": "face", "distance": 0.004}}
    told = body(tmp_path / "body.h5", mesh, ties=tie)
    assert any(line.startswith("tie seam: ") for line in told["summary"])
    assert not any("parts that nothing joins" in line for line in told["warnings"])
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    K, M = a["K"].toarray(), a["M"].toarray()
    assert abs(K @ rigid_motions(a)).max() < 1e-9 * abs(K).max()
    squares = sl.eigh(K, M, eigvals_only=True)
    assert abs(squares[:6]).max() < 1e-6 * squares[6]


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20"])
def test_patch(kind: str, tmp_path: Path) -> None:
    """The faces of a mesh that divides those that it is tied to carry constant stress exactly."""
    mesh = two_boxes((kind, kind), ((3, 4, 4), (3, 2, 2)))
    body(
        tmp_path / "body.h5",
        mesh,
        ties={"seam": {"nodes": "seam", "to": "face"}},
        interfaces={"start": {"coupling": "distributing", "nodes": "start"}},
        loads={"pull": {"type": "traction", "nodes": "end"}},
        supports={
            "wall": {"nodes": "start", "components": ["x"]},
            "edge": {"nodes": [1], "components": ["y", "z"]},
            "other": {"nodes": [5], "components": ["y"]},
        },
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    u = spl.spsolve(a["K"].tocsc(), a["B"][:, a["names"].index("pull.tx")])
    along = a["component"] == 0
    np.testing.assert_allclose(u[along], a["position"][along, 0] / 210e9, rtol=1e-9)
    across = (a["component"] == 1) | (a["component"] == 2)
    assert abs(u[across]).max() < 1.01 * 0.3 * 0.04 * 1.5 / 210e9


def test_a_tie_is_near_one_mesh(tmp_path: Path) -> None:
    """Frequencies of two meshes that do not match, and of one."""
    mesh = two_boxes(("hexahedron20", "hexahedron20"), ((5, 3, 3), (5, 2, 2)))
    body(tmp_path / "tied.h5", mesh, ties={"seam": {"nodes": "seam", "to": "face"}})
    one = box("hexahedron20", (10, 3, 3), (0.2, 0.04, 0.04), distort=False)
    body(tmp_path / "one.h5", one, regions={"all": {"material": "steel"}})
    found = []
    for name in ("tied", "one"):
        a = assembled(tmp_path / "matrices.h5", tmp_path / f"{name}.h5")
        squares = sl.eigh(a["K"].toarray(), a["M"].toarray(), eigvals_only=True)
        found.append(np.sqrt(squares[6:14]))
    np.testing.assert_allclose(found[0], found[1], rtol=5e-3)


def lap(path: Path, count: int, **more: Any) -> dict[str, Any]:
    """Two sheets of 3 mm, one above the other, that overlap by a third; matrices."""
    first = sheet("quad", (count, count), lambda u, v: (0.3 * u, 0.1 * v, 0.0))
    second = sheet("quad", (count, count + 1), lambda u, v: (0.2 + 0.3 * u, 0.1 * v, 0.003))
    before = len(first.points)
    points = np.vstack([first.points, second.points])
    none = np.empty(0, dtype=np.int64)
    cells = [("quad", first.cells[0].data), ("quad", second.cells[0].data + before)]
    x = points[:, 0]
    mesh = meshio.Mesh(
        points,
        cells,
        point_sets={
            "start": np.flatnonzero(x == 0),
            "end": np.flatnonzero(x > 0.5 - 1e-9),
            "below": np.flatnonzero((np.arange(len(x)) < before) & (x > 0.2 - 1e-9)),
            "above": np.arange(before, len(x)),
        },
        cell_sets={
            "one": [np.arange(len(first.cells[0].data)), none],
            "two": [none, np.arange(len(second.cells[0].data))],
        },
    )
    region = {"material": "steel", "section": "thin"}
    return body(
        path,
        mesh,
        sections={"thin": {"shape": "shell", "thickness": 0.003}},
        regions={"one": region, "two": region},
        **more,
    )


def test_a_lap_joint_of_sheets(tmp_path: Path) -> None:
    """Middle surfaces 3 mm apart: glued, the overlap bends as a sheet of 6 mm. A bar of three
    pieces, bent by a moment at its end, in beam theory with the plates' modulus."""
    lap(
        tmp_path / "lap.h5", 12, ties={"glue": {"nodes": "below", "to": "above", "distance": 0.004}}
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "lap.h5")
    K = a["K"].tocsc()
    assert abs(K @ rigid_motions(a)).max() < 1e-9 * abs(K).max()
    start = a["node"] == a["node"].max() - 1
    kept = np.flatnonzero(~start)
    load = a["B"][:, a["names"].index("end.my")]
    u = np.zeros(len(load))
    u[kept] = spl.spsolve(K[kept][:, kept], load[kept])
    turn = u @ load
    EI = 210e9 * 0.1 * 0.003**3 / 12
    assert turn == pytest.approx(0.2 / EI + 0.1 / (8 * EI) + 0.2 / EI, rel=0.03)


def test_shells_stand_on_a_solid(tmp_path: Path) -> None:
    """The edge of a sheet tied to a block: clamped there, or hinged where rotations are free."""
    block = box("hexahedron", (4, 4, 2), (0.1, 0.1, 0.05), distort=False)
    plate = sheet("quad", (6, 8), lambda u, v: (0.05, 0.01 + 0.08 * v, 0.05 + 0.12 * u))
    before = len(block.points)
    points = np.vstack([block.points, plate.points])
    none = np.empty(0, dtype=np.int64)
    mesh = meshio.Mesh(
        points,
        [*block.cells, ("quad", plate.cells[0].data + before)],
        point_sets={
            "bottom": np.flatnonzero(points[:, 2] == 0),
            "top": np.flatnonzero((points[:, 2] > 0.05 - 1e-9) & (np.arange(len(points)) < before)),
            "foot": plate.point_sets["start"] + before,
            "tip": plate.point_sets["end"] + before,
        },
        cell_sets={
            "one": [np.arange(len(block.cells[0].data)), none],
            "two": [none, np.arange(len(plate.cells[0].data))],
        },
    )
    frequencies = {}
    for rotations in ("tied", "free"):
        body(
            tmp_path / "body.h5",
            mesh,
            sections={"thin": {"shape": "shell", "thickness": 0.002}},
            regions={
                "one": {"material": "steel"},
                "two": {"material": "steel", "section": "thin"},
            },
            interfaces={"tip": RIGID | {"nodes": "tip"}},
            supports={"floor": {"nodes": "bottom"}},
            ties={"weld": {"nodes": "foot", "to": "top", "rotations": rotations}},
        )
        a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
        squares = sl.eigh(a["K"].toarray(), a["M"].toarray(), eigvals_only=True)
        frequencies[rotations] = np.sqrt(abs(squares[0])) / (2 * np.pi)
    # A strip of 0.12 m: λ² 3.516 of a cantilever, with the plate's modulus at most.
    strip = 3.516 / (2 * np.pi * 0.12**2) * np.sqrt(210e9 * 0.002**2 / 12 / 7850)
    assert 0.97 * strip < frequencies["tied"] < 1.06 * strip
    assert frequencies["free"] < 1e-2 * frequencies["tied"]


@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-5])
def test_rings_of_ties_lock_nothing(noise: float, tmp_path: Path) -> None:
    """Two equal meshes, each tied to the other, whose nodes lie in nearly the same places."""
    found = []
    for ties in (("seam",), ("seam", "face")):
        mesh = two_boxes(counts=((3, 3, 3), (3, 3, 3)))
        rng = np.random.default_rng(3)
        seam = mesh.point_sets["seam"]
        mesh.points[seam, 1:] += noise * 0.013 * rng.uniform(-1, 1, (len(seam), 2))
        other = {"seam": "face", "face": "seam"}
        body(
            tmp_path / "body.h5",
            mesh,
            ties={n: {"nodes": n, "to": other[n], "distance": 1e-4} for n in ties},
        )
        a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
        squares = sl.eigh(a["K"].toarray(), a["M"].toarray(), eigvals_only=True)
        found.append((len(squares), np.sqrt(squares[6:10])))
    assert found[0][0] == found[1][0]
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-3 if noise > 1e-6 else 1e-6)


def test_the_next_face_of_a_graded_mesh() -> None:
    """Small faces, large ones and triangles: distances are those of the nearest by brute force."""
    rng = np.random.default_rng(5)
    x = np.array([0.0, 0.01, 0.03, 0.1, 0.4, 1.5])
    X, Y = np.meshgrid(x, x, indexing="ij")
    points = np.column_stack([X.ravel(), Y.ravel(), 0.2 * np.sin(X.ravel() + Y.ravel())])
    number = np.arange(36).reshape(6, 6)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    quads = np.stack(corners, -1).reshape(-1, 4)
    faces = [quads[::2], np.vstack([quads[1::2, :3], quads[1::2][:, [0, 2, 3]]])]
    places = np.column_stack([rng.uniform(-0.1, 1.6, (400, 2)), rng.uniform(-0.2, 0.4, 400)])
    ties, nearest = tied(np.vstack([points, places]), faces, 36 + np.arange(400), 0.3)
    fine = np.linspace(0, 1, 81)
    u, v = (a.ravel() for a in np.meshgrid(fine, fine))
    shape = np.column_stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    inside = u + v <= 1 + 1e-12
    flat = np.column_stack([1 - u - v, u, v])[inside]
    surface = [np.einsum("qi,fia->fqa", shape, points[faces[0]]).reshape(-1, 3)]
    surface += [np.einsum("qi,fia->fqa", flat, points[faces[1]]).reshape(-1, 3)]
    brute = cKDTree(np.vstack(surface)).query(places)[0]
    assert 0 <= brute.min() - nearest < 0.01
    near = brute <= 0.29
    assert set(np.flatnonzero(near) + 36) <= set(ties.nodes.tolist())
    assert np.all(ties.distance <= brute[ties.nodes - 36] + 1e-9)
    assert np.all(ties.distance >= brute[ties.nodes - 36] - 0.02)
