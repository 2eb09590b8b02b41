"""Equations and ties of mesh bodies, against matrices of the body without them, closed forms and
CalculiX."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from scipy.spatial import cKDTree
from test_preload import line

import flexgram
from bodies import box
from conftest import assembled, assert_certified, certified, run
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.body.ties import tied
from flexgram.model.geometry import Geometry
from sheets import sheet

STEEL = {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}}
RIGID = {"coupling": "rigid"}


def two_boxes(
    kinds: tuple[str, str] = ("hexahedron", "hexahedron"),
    counts: tuple[tuple[int, int, int], ...] = ((3, 4, 4), (3, 2, 2)),
    gap: float = 0.0,
) -> meshio.Mesh:
    """Two boxes of 0.1 × 0.04 × 0.04, the second behind the first, perhaps with a gap; parts one
    and two, node sets start, end, seam (of the first) and face (of the second)."""
    first, second = (
        box(kind, count, (0.1, 0.04, 0.04), distort=False)
        for kind, count in zip(kinds, counts, strict=True)
    )
    before = len(first.points)
    points = np.vstack([first.points, second.points + np.array([0.1 + gap, 0, 0])])
    cells = [*first.cells, meshio.CellBlock(second.cells[0].type, second.cells[0].data + before)]
    none = np.empty(0, dtype=np.int64)
    return meshio.Mesh(
        points,
        cells,
        point_sets={
            "start": first.point_sets["start"],
            "seam": first.point_sets["end"],
            "face": second.point_sets["start"] + before,
            "end": second.point_sets["end"] + before,
        },
        cell_sets={
            "one": [np.arange(len(first.cells[0].data)), none],
            "two": [none, np.arange(len(second.cells[0].data))],
        },
    )


def body(path: Path, mesh: meshio.Mesh, **more: Any) -> dict[str, Any]:
    content = {
        "materials": STEEL,
        "regions": {"one": {"material": "steel"}, "two": {"material": "steel"}},
        "interfaces": {"start": RIGID | {"nodes": "start"}, "end": RIGID | {"nodes": "end"}},
    }
    return import_description(content | more, "two boxes", path, mesh=mesh)


def rigid_motions(a: dict[str, Any]) -> Any:
    R = np.zeros((len(a["node"]), 6))
    for row, (c, x) in enumerate(zip(a["component"], a["position"], strict=True)):
        R[row, c] = 1
        if c < 3:
            R[row, 3:] = np.cross(np.eye(3), x)[:, c]
    return R


@pytest.mark.parametrize("ranks", [1, 2])
def test_equations_take_out_dofs(ranks: int, tmp_path: Path) -> None:
    """K, M and loads are those of the whole body with T, u = T v, made here."""
    mesh = box("tetra10", (3, 2, 2))
    content: dict[str, Any] = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {
            "end": {"coupling": "distributing", "nodes": "end"},
            "start": RIGID | {"nodes": "start"},
        },
        "loads": {"weight": {"type": "acceleration"}, "push": {"type": "force", "nodes": [40]}},
    }
    free = (
        int(
            np.setdiff1d(
                np.arange(len(mesh.points)), np.concatenate(list(mesh.point_sets.values()))
            )[0]
        )
        + 1
    )
    slave = int(mesh.point_sets["start"][2]) + 1
    end = int(mesh.point_sets["end"][0]) + 1
    # The second equation has the first's dependent dof, the third a slave of a rigid interface.
    terms = [
        [[40, "x", 2.0], [free, "y", 1.0], [end, "x", -3.0]],
        [[41, "z", 1.0], [40, "x", -0.5]],
        [[40, "y", 1.0], [slave, "z", -1.0]],
    ]
    import_description(content, "box", tmp_path / "free.h5", mesh=mesh)
    told = import_description(
        content | {"equations": {"some": {"terms": terms}}}, "box", tmp_path / "tied.h5", mesh=mesh
    )
    assert "equations some: 3" in told["summary"]
    whole = assembled(tmp_path / "a.h5", tmp_path / "free.h5")
    a = assembled(tmp_path / "b.h5", tmp_path / "tied.h5", ranks)
    row = {
        (n, c): i for i, (n, c) in enumerate(zip(whole["node"], whole["component"], strict=True))
    }
    E = np.zeros((3, len(row)))
    reference = {c: row[len(mesh.points), c] for c in range(6)}
    middle = whole["position"][reference[0]]
    arm = mesh.points[slave - 1] - middle
    for k, equation in enumerate(terms):
        for node, component, factor in equation:
            c = "xyz".index(str(component))
            if node != slave:
                E[k, row[int(node) - 1, c]] += float(factor)
                continue
            E[k, reference[c]] += float(factor)
            for axis in range(3):
                E[k, reference[3 + axis]] += float(factor) * np.cross(np.eye(3)[axis], arm)[c]
    dependent = [row[39, 0], row[40, 2], row[39, 1]]
    kept = np.setdiff1d(np.arange(len(row)), dependent)
    T = np.zeros((len(row), len(kept)))
    T[kept, np.arange(len(kept))] = 1
    T[dependent] = -np.linalg.solve(E[:, dependent], E[:, kept])
    place = {(n, c): i for i, (n, c) in enumerate(zip(a["node"], a["component"], strict=True))}
    order = [place[whole["node"][i], whole["component"][i]] for i in kept]
    assert len(place) == len(kept)
    for name in ("K", "M"):
        expected = T.T @ whole[name].toarray() @ T
        np.testing.assert_allclose(
            a[name].toarray()[np.ix_(order, order)], expected, atol=1e-12 * abs(expected).max()
        )
    assert a["names"] == whole["names"]
    expected = T.T @ whole["B"]
    np.testing.assert_allclose(a["B"][order], expected, atol=1e-12 * abs(expected).max())


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


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_claim_of_a_tied_body(ranks: int, tmp_path: Path) -> None:
    mesh = two_boxes(("tetra10", "hexahedron"), ((4, 3, 3), (4, 2, 2)), 0.001)
    body(
        tmp_path / "body.h5",
        mesh,
        ties={"seam": {"nodes": "seam", "to": "face", "distance": 0.002}},
        equations={"link": {"terms": [[1, "y", 1.0], [30, "y", -0.5]]}},
        interfaces={
            "end": RIGID | {"nodes": "end"},
            "seam": {"coupling": "distributing", "nodes": "seam"},
        },
        loads={"weight": {"type": "acceleration"}},
        damping={"alpha": 3.0, "beta": 1e-7},
    )
    result = certified(
        tmp_path / "body.h5", (10.0, 3000.0), tmp_path, "-mor_tol", 1e-4, ranks=ranks, count=6
    )
    assert_certified(result, 1e-4)


def test_pictures_move_what_follows(tmp_path: Path) -> None:
    """Displacements of all nodes of a rigid motion of the reduced body, dependent ones too."""
    mesh = two_boxes(gap=0.002)
    tie = {"seam": {"nodes": "seam", "to": "face", "distance": 0.003}}
    body(tmp_path / "body.h5", mesh, ties=tie)
    rom = tmp_path / "rom.h5"
    run("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,5000", "-mor_out", rom)
    model = flexgram.ReducedModel.load(rom)
    motion = Geometry.load(tmp_path / "body.h5").motion(model)
    points = mesh.points - mesh.points.mean(axis=0)
    R = np.hstack(
        [
            np.tile(np.eye(3), (len(points), 1)),
            np.cross(np.eye(3)[None], points[:, None]).transpose(0, 2, 1).reshape(-1, 3),
        ]
    )
    shapes = motion[:6].reshape(6, -1).T
    left = shapes - R @ np.linalg.lstsq(R, shapes, rcond=None)[0]
    assert abs(left).max() < 1e-6 * abs(shapes).max()
    moved = motion[6:, mesh.point_sets["seam"]]
    assert (np.abs(moved).max(axis=(1, 2)) > 0).all()


def test_reactions_reach_supports_through_ties(tmp_path: Path) -> None:
    """A body whose tied nodes follow held ones: its weight arrives at the support."""
    mesh = two_boxes()
    body(
        tmp_path / "body.h5",
        mesh,
        ties={"seam": {"nodes": "seam", "to": "face"}},
        interfaces={"start": RIGID | {"nodes": "start"}},
        supports={"wall": {"nodes": "face"}},
        loads={"weight": {"type": "acceleration"}},
        outputs={"wall": {"type": "reaction", "nodes": "face", "point": [0, 0, 0]}},
    )
    rom = tmp_path / "rom.h5"
    run("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "1,500", "-mor_out", rom)
    model = flexgram.ReducedModel.load(rom)
    H = model.system.transfer(np.array([1e-3]))[0]
    force = H[list(model.outputs).index("wall.rz"), list(model.inputs).index("weight.az")].real
    # Held nodes take their share of the weight, as the others do.
    assert force == pytest.approx(-7850 * 0.2 * 0.04**2, rel=1e-6)


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


@pytest.mark.parametrize(("gap", "warned"), [(0.0, False), (0.002, True)])
def test_what_a_floating_frame_misses_is_said(gap: float, warned: bool, tmp_path: Path) -> None:
    """Levers of ties turn with the frame, which its integrals leave out: warned of, alone."""
    mesh = two_boxes(gap=gap)
    body(tmp_path / "body.h5", mesh, ties={"t": {"nodes": "seam", "to": "face", "distance": 0.003}})
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,5000"),
        *("-mor_out", tmp_path / "rom.h5"),
    )
    warnings = [line for line in said.out.splitlines() if line.startswith("warning")]
    assert len(warnings) == warned and not said.err
    assert all("integrals of second order and the spin loads" in line for line in warnings)
    assert "constraints    75 dependent dofs" in said.out


def test_a_part_that_equations_hold(tmp_path: Path) -> None:
    """It is none that nothing holds; a reaction there is refused."""
    mesh = two_boxes(gap=0.01)
    face = (mesh.point_sets["face"] + 1).tolist()
    terms = [[[n, c, 1.0]] for n in face for c in "xyz"]
    more: dict[str, Any] = {
        "equations": {"wall": {"terms": terms}},
        "interfaces": {"start": RIGID | {"nodes": "start"}},
    }
    told = body(tmp_path / "body.h5", mesh, **more)
    assert not any("nothing holds" in line for line in told["warnings"])
    reaction = {"wall": {"type": "reaction", "nodes": "face", "point": [0, 0, 0]}}
    with pytest.raises(BodyError, match="its reaction is not known"):
        body(tmp_path / "b.h5", mesh, **more, outputs=reaction)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"ties": {"a": {"nodes": "seam", "to": "end"}}}, "no node lies within"),
        ({"ties": {"a": {"nodes": "seam", "to": [1, 2]}}}, "no face of an element"),
        ({"ties": {"a": {"nodes": "seam", "to": "face", "distance": -1}}}, "must be positive"),
        ({"ties": {"a": {"nodes": "seam", "to": "face", "gap": 1}}}, "unknown key gap"),
        ({"equations": {"a": {"terms": []}}}, "must be rows"),
        ({"equations": {"a": {"terms": [[1, "x", 0]]}}}, "all factors are 0"),
        ({"equations": {"a": {"terms": [[30, "rx", 1.0]]}}}, "has no rotation rx"),
        ({"equations": {"a": {"terms": [[9999, "x", 1.0]]}}}, "node numbers run from 1"),
        (
            {"equations": {"a": {"terms": [[1, "x", 1.0], [2, "x", -1.0]]}}},
            "between dofs of rigid interfaces alone",
        ),
    ],
)
def test_what_is_refused(more: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        body(tmp_path / "body.h5", two_boxes(), **more)
    assert not (tmp_path / "body.h5").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda g: g["factor"].__setitem__(0, np.nan), "must be finite"),
        (lambda g: g["dependent"].__setitem__((0, 1), 7), "component 7"),
        (lambda g: g["start"].__setitem__(1, 10**6), "do not fit each other"),
        (lambda g: g["dependent"].__setitem__(0, g["dependent"][1]), "depends twice"),
        (lambda g: g["independent"].__setitem__(0, g["dependent"][1]), "others depend on it"),
        (lambda g: g["dependent"].__setitem__((0, 1), 5), "does not exist"),
    ],
)
def test_wrong_files(change: Any, words: str, tmp_path: Path) -> None:
    body(tmp_path / "body.h5", two_boxes(), ties={"seam": {"nodes": "seam", "to": "face"}})
    with h5py.File(tmp_path / "body.h5", "r+") as file:
        change(file["constraints"])
    said = run(
        "assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5", expect=None
    )
    assert said.status == 1
    assert words in said.err


def test_equations_are_in_the_meshs_units(tmp_path: Path) -> None:
    """Of a displacement [mm] and a rotation of a beam's node."""
    mesh = line(2, 0.0, 200.0)
    points = mesh.points
    found = []
    for units, length in (("mm-t-s", 1.0), ("SI", 1e-3)):
        mesh.points = points * length
        stress = 1e6 if units == "SI" else 1.0
        size = 10.0 * length
        import_description(
            {
                "units": units,
                "materials": {
                    "m": {
                        "E": 2.1e5 * stress,
                        "nu": 0.3,
                        "rho": 7.85e-9 * (1e12 if length < 1 else 1),
                    }
                },
                "sections": {"bar": {"shape": "rectangle", "width": size, "height": size}},
                "regions": {"all": {"material": "m", "section": "bar"}},
                "interfaces": {"tip": {"coupling": "node", "nodes": [1]}},
                "equations": {"e": {"terms": [[3, "y", 1.0], [3, "rz", -50.0 * length]]}},
            },
            "beam",
            tmp_path / "beam.h5",
            mesh=mesh,
        )
        found.append(assembled(tmp_path / "m.h5", tmp_path / "beam.h5")["K"])
    assert abs(found[0] - found[1]).max() < 1e-12 * abs(found[0]).max()
    assert sp.issparse(found[0]) and found[0].shape == (17, 17)
