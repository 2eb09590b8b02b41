"""Shells and beams of second order: elements of first order between all of their nodes."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from test_deck_constraints import frequencies
from test_importers import ccx_frequencies

from conftest import assembled, run
from flexgram.body.description import import_description
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck

ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
#: A plate of 2 × 1 m that is held along one edge, 10 mm thick.
LENGTH, WIDTH, THICKNESS = 2.0, 1.0, 0.01
#: Places in a quadrilateral, in thirds of which elements of second order have nodes.
EIGHT = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
SIX = (
    [(0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1)],
    [(0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1)],
)


def plate(kind: str, count: int = 10) -> tuple[Any, Any]:
    """Points (N, 3) on a grid of halves of elements, and elements by rows of these."""
    nx, ny = 2 * count, count
    grid = np.array(
        [(x, y) for y in range(2 * ny // 2 * 2 + 1) for x in range(2 * nx + 1)], dtype=float
    )
    points = np.column_stack([grid * [LENGTH / (2 * nx), WIDTH / (2 * ny)], np.zeros(len(grid))])
    shapes = {"quad8": (EIGHT,), "quad9": ([*EIGHT, (1, 1)],), "triangle6": SIX}[kind]
    cells = [
        [(2 * j + b) * (2 * nx + 1) + 2 * i + a for a, b in shape]
        for j in range(ny)
        for i in range(nx)
        for shape in shapes
    ]
    used = np.unique(cells)
    place = np.zeros(len(points), dtype=np.int64)
    place[used] = np.arange(len(used))
    return points[used], place[np.array(cells)]


def deck(path: Path, element: str, kind: str, load: str = "") -> tuple[Path, int]:
    """A deck of the plate, and a node at its far edge."""
    points, cells = plate(kind)
    left = np.flatnonzero(points[:, 0] == 0) + 1
    tip = int(np.argmin(np.linalg.norm(points - [LENGTH, WIDTH / 2, 0], axis=1))) + 1
    path.write_text(
        "*NODE, NSET=NALL\n"
        + "".join(f"{k},{x},{y},{z}\n" for k, (x, y, z) in enumerate(points, 1))
        + f"*ELEMENT, TYPE={element}, ELSET=ALL\n"
        + "".join(
            f"{k}," + ",".join(str(n + 1) for n in row) + "\n" for k, row in enumerate(cells, 1)
        )
        + "*NSET, NSET=LEFT\n"
        + "".join(f"{n},\n" for n in left)
        + "*MATERIAL, NAME=STEEL\n*ELASTIC\n200e9, 0.3\n*DENSITY\n8000\n"
        + f"*SHELL SECTION, ELSET=ALL, MATERIAL=STEEL\n{THICKNESS}\n"
        + "*BOUNDARY\nLEFT, 1, 6\n"
        + load
        + "*STEP\n*FREQUENCY\n8\n*END STEP\n"
    )
    return path, tip


@ccx
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("element", "kind"), [("S8R", "quad8"), ("S8", "quad8"), ("S6", "triangle6")]
)
def test_plates_are_those_of_ccx(element: str, kind: str, ranks: int, tmp_path: Path) -> None:
    """ccx makes solids of them: six bending modes within 1.1 %, of its S6 from above."""
    path, tip = deck(tmp_path / "plate.inp", element, kind)
    ours, facts = frequencies(tmp_path, path, f"NODES:{tip}", ranks)
    np.testing.assert_allclose(ours[:6], ccx_frequencies(path)[:6], rtol=0.011)
    assert any(f"{element} are taken as four" in words for words in facts["remarks"])


def described(kind: str) -> tuple[dict[str, Any], meshio.Mesh]:
    points, cells = plate(kind)
    left = np.flatnonzero(points[:, 0] == 0)
    right = np.flatnonzero(points[:, 0] == LENGTH)
    mesh = meshio.Mesh(points, [(kind, cells)], point_sets={"left": left, "right": right})
    content = {
        "name": kind,
        "materials": {"steel": {"E": 200e9, "nu": 0.3, "rho": 8000}},
        "sections": {"sheet": {"shape": "shell", "thickness": THICKNESS}},
        "regions": {"all": {"material": "steel", "section": "sheet"}},
        "supports": {"held": {"nodes": "left", "components": ["x", "y", "z", "rx", "ry", "rz"]}},
        "interfaces": {"edge": {"coupling": "rigid", "nodes": "right"}},
        "loads": {"wind": {"type": "pressure", "nodes": {"box": [[-1, -1, -1], [3, 3, 1]]}}},
    }
    return content, mesh


def test_eight_nodes_are_nine(tmp_path: Path) -> None:
    """The middle that a quadrilateral of eight nodes gains is that of one with nine."""
    found = []
    for kind in ("quad8", "quad9"):
        content, mesh = described(kind)
        counts = import_description(content, kind, tmp_path / "b.h5", mesh=mesh)
        a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
        modes = np.sqrt(np.sort(eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)))
        wind = a["B"][:, a["names"].index("wind.p")]
        found.append((modes, np.sort(wind[wind != 0]), counts["elements"], counts["points"]))
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-8)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-9, atol=1e-15)
    assert found[0][2:] == found[1][2:] == (800, 41 * 21)


def test_elements_keep_their_numbers(tmp_path: Path) -> None:
    """Stress at an element of second order: of its four pieces."""
    content, mesh = described("quad8")
    node = int(mesh.cells[0].data[4, 5]) + 1
    content["outputs"] = {
        "spot": {"type": "stress", "nodes": [node], "elements": [5, 6], "side": "top"}
    }
    import_description(content, "plate", tmp_path / "b.h5", mesh=mesh)
    with h5py.File(tmp_path / "b.h5") as file:
        numbers, count = np.unique(file["mesh/blocks/0000/ids"][:], return_counts=True)
        assert numbers.tolist() == list(range(1, 201)) and set(count.tolist()) == {4}
        assert file["outputs/spot/values"].shape[0] > 0


def test_a_support_of_sets_holds_the_middles_too(tmp_path: Path) -> None:
    """A node set that holds all eight nodes of an element holds its new one."""
    content, mesh = described("quad8")
    first = mesh.cells[0].data[0]
    mesh.point_sets["left"] = np.unique([*mesh.point_sets["left"], *first])
    import_description(content, "plate", tmp_path / "b.h5", mesh=mesh)
    with h5py.File(tmp_path / "b.h5") as file:
        held = file["supports/held/nodes"][:]
        middle = file["mesh/points"][:][first[:4]].mean(axis=0)
        assert np.abs(file["mesh/points"][:][held] - middle).sum(axis=1).min() < 1e-12


@pytest.mark.parametrize("ranks", [1, 2])
def test_beams_of_three_nodes_are_two(ranks: int, tmp_path: Path) -> None:
    """An arc of beams, in a mesh of second order and of first order between the same nodes."""
    angles = np.linspace(0, np.pi / 2, 17)
    points = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(17)])
    meshes = {
        "line3": [[k, k + 2, k + 1] for k in range(0, 16, 2)],
        "line": [[k, k + 1] for k in range(16)],
    }
    found = []
    for kind, cells in meshes.items():
        content = {
            "name": kind,
            "materials": {"steel": {"E": 200e9, "nu": 0.3, "rho": 8000}},
            "sections": {"bar": {"shape": "circle", "radius": 0.02, "y_axis": [0, 0, 1]}},
            "regions": {"bow": {"material": "steel", "section": "bar"}},
            "supports": {"held": {"nodes": [1], "components": ["x", "y", "z", "rx", "ry", "rz"]}},
            "interfaces": {"end": {"coupling": "node", "nodes": [17]}},
        }
        mesh = meshio.Mesh(
            points, [(kind, np.array(cells))], cell_sets={"bow": [np.arange(len(cells))]}
        )
        import_description(content, kind, tmp_path / "b.h5", mesh=mesh)
        found.append(assembled(tmp_path / "a.h5", tmp_path / "b.h5", ranks))
    np.testing.assert_allclose(
        eigsh(found[0]["K"], 6, found[0]["M"], sigma=0, return_eigenvectors=False),
        eigsh(found[1]["K"], 6, found[1]["M"], sigma=0, return_eigenvectors=False),
        rtol=1e-9,
    )


@pytest.mark.parametrize(("element", "kind"), [("S8R", "quad8"), ("S6", "triangle6")])
def test_loads_of_decks(element: str, kind: str, tmp_path: Path) -> None:
    """Pressure and gravity of the steps: what all nodes carry, and its moments."""
    rows = ("ALL, P, 100.", "ALL, GRAV, 9.81, 0, 0, -1")
    load = "".join(f"*STEP\n*STATIC\n*DLOAD\n{row}\n*END STEP\n" for row in rows)
    path, tip = deck(tmp_path / "plate.inp", element, kind, load)
    assemble_deck(path, tmp_path / "b.h5", [parse("node", f"tip=NODES:{tip}")], deck_loads=True)
    area = LENGTH * WIDTH
    whole = {"step1_dload": 100.0 * area, "step2_dload": -9.81 * 8000 * THICKNESS * area}
    with h5py.File(tmp_path / "b.h5") as file:
        for name, total in whole.items():
            group = file[f"loads/{name}"]
            forces = group["values"][:][:, 0, 2]
            places = file["mesh/points"][:][group["nodes"][:]]
            np.testing.assert_allclose(forces.sum(), total, rtol=1e-12)
            np.testing.assert_allclose(forces @ places[:, 0], total * LENGTH / 2, rtol=1e-12)
            assert np.all(forces / total > 0)


def test_a_reduction_of_a_plate_of_second_order(tmp_path: Path) -> None:
    """From the mesh to a claim."""
    content, mesh = described("triangle6")
    content["damping"] = {"alpha": 1.0}
    import_description(content, "plate", tmp_path / "b.h5", mesh=mesh)
    said = run(
        *("reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "0,60", "-mor_tol", "1e-3"),
        *("-mor_out", tmp_path / "r.h5"),
    )
    assert "met" in said.out and "not met" not in said.out, said.out


def cubes(quadratic: bool) -> meshio.Mesh:
    """Two cubes side by side: a hexahedron, and six pyramids around a middle a little off."""
    x = np.array([[i, j, k] for i in (0, 1, 2) for j in (0, 1) for k in (0, 1)], dtype=float)
    points = np.vstack([x, [[1.5, 0.45, 0.55]]])
    at = {tuple(p): n for n, p in enumerate(x.astype(int).tolist())}
    hexa = [at[p] for p in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
                            (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))]  # fmt: skip
    second = [at[p[0] + 1, p[1], p[2]] for p in x[hexa].astype(int)]
    faces = [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    pyramids = [[*(second[c] for c in face), 12] for face in faces]
    if not quadratic:
        return meshio.Mesh(points, [("hexahedron", [hexa]), ("pyramid", pyramids)])
    known = [*points]
    middles: dict[frozenset[int], int] = {}

    def middle(a: int, b: int) -> int:
        if frozenset((a, b)) not in middles:
            middles[frozenset((a, b))] = len(known)
            known.append((known[a] + known[b]) / 2)
        return middles[frozenset((a, b))]

    ring = [(0, 1), (1, 2), (2, 3), (3, 0)]
    of_hexa = [*ring, *((a + 4, b + 4) for a, b in ring), *((k, k + 4) for k in range(4))]
    hexa += [middle(hexa[a], hexa[b]) for a, b in of_hexa]
    for p in pyramids:
        p += [middle(p[a], p[b]) for a, b in [*ring, *((k, 4) for k in range(4))]]
    return meshio.Mesh(np.array(known), [("hexahedron20", [hexa]), ("pyramid13", pyramids)])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("quadratic", [False, True])
def test_pyramids_pass_a_constant_strain(quadratic: bool, ranks: int, tmp_path: Path) -> None:
    """Nodes of the surface moved by a linear field: the inner ones follow it, and the energy is
    that of its stress; mass is that of the box."""
    mesh = cubes(quadratic)
    content = {
        "name": "cubes",
        "materials": {"steel": {"E": 2.0, "nu": 0.3, "rho": 3.0}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"a": {"coupling": "node", "nodes": [1]}},
    }
    counts = import_description(content, "cubes", tmp_path / "b.h5", mesh=mesh)
    assert counts["elements"] == 13
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5", ranks)
    strain = np.array([[0.1, 0.3, -0.2], [0.0, -0.4, 0.1], [0.2, 0.05, 0.3]])
    u = np.einsum("na,ba->nb", a["position"], strain)[np.arange(len(a["node"])), a["component"]]
    low, high = 1e-9, np.array([2.0, 1.0, 1.0]) - 1e-9
    inside = ((mesh.points > low) & (mesh.points < high)).all(axis=1)
    inner = np.isin(a["node"], np.flatnonzero(inside))
    force = a["K"] @ u
    assert inner.sum() >= 3
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
    e = (strain + strain.T) / 2
    mu, lam = 2 / 2.6, 2 * 0.3 / (1.3 * 0.4)
    assert u @ force == pytest.approx(
        2 * (2 * mu * (e * e).sum() + lam * np.trace(e) ** 2), rel=1e-9
    )
    ones = (a["component"] == 0).astype(float)
    assert ones @ a["M"] @ ones == pytest.approx(6.0, rel=1e-9)


def test_nodes_by_number_hold_the_middles_too(tmp_path: Path) -> None:
    """A tie to, a pressure on and a support of shells by lists of the nodes that the mesh had."""
    content, mesh = described("quad8")
    nodes = [int(n) + 1 for n in np.unique(mesh.cells[0].data[:3])]
    content["loads"] = {"push": {"type": "pressure", "nodes": nodes}}
    content["supports"]["more"] = {"nodes": nodes, "components": ["z"]}
    mesh.points = np.vstack([mesh.points, [[0.11, 0.05, 0.001], [0.11, 0.09, 0.3]]])
    last = len(mesh.points)
    mesh.cells.append(meshio.CellBlock("line", np.array([[last - 2, last - 1]])))
    mesh.cell_sets = {"sheets": [np.arange(200), np.array([], int)],
                      "bar": [np.array([], int), np.array([0])]}  # fmt: skip
    content["sections"]["bar"] = {"shape": "circle", "radius": 0.01}
    content["regions"] = {
        "sheets": {"material": "steel", "section": "sheet"},
        "bar": {"material": "steel", "section": "bar"},
    }
    content["ties"] = {"glue": {"nodes": [last - 1], "to": nodes}}
    import_description(content, "plate", tmp_path / "b.h5", mesh=mesh)
    with h5py.File(tmp_path / "b.h5") as file:
        assert len(file["supports/more/nodes"]) == len(nodes) + 3
        force = file["loads/push/values"][:][:, 0, 2]
        assert abs(force.sum()) == pytest.approx(3 * 0.1 * 0.1, rel=1e-9)
        assert len(file["constraints/dependent"]) == 6
