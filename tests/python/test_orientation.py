"""Materials whose axes turn from element to element, against one material an element, and ccx."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from test_deck_materials import CONSTANTS, NU, E, G
from test_importers import ccx_frequencies, write_deck
from test_preload_strain import numbers

from bodies import CALCULIX, FORMULATIONS, box
from conftest import assembled, run
from flexgram import BodyError
from flexgram.__main__ import main
from flexgram.body.description import import_description
from flexgram.body.meshfile import AXES
from flexgram.importers.deck_materials import ENGINEERING

WOOD = {
    **{"E1": 11e9, "E2": 9e8, "E3": 5e8, "nu12": 0.3, "nu13": 0.35, "nu23": 0.4},
    **{"G12": 8e8, "G13": 7e8, "G23": 6e7, "rho": 600.0},
}
POINT, AXIS = np.array([0.02, -0.3, 0.0]), np.array([0.1, 0.2, 1.0])


def around(mesh: Any, first: str) -> Any:
    """First and second axis of each element, around POINT and AXIS."""
    z = AXIS / np.linalg.norm(AXIS)
    arm = mesh.points[mesh.cells[0].data].mean(axis=1) - POINT
    r = arm - np.outer(arm @ z, z)
    r /= np.linalg.norm(r, axis=1)[:, None]
    axes = [r, np.cross(z, r), np.broadcast_to(z, r.shape)]
    k = ["radial", "around", "along"].index(first)
    return axes[k], axes[(k + 1) % 3]


def bodies(mesh: Any, folder: Path, first: str, more: Any, **shell: Any) -> tuple[Path, Path]:
    """A body whose elements have axes of their own (shells by the orientation of their region), and
    one with a material or a section an element."""
    count = len(mesh.cells[0].data)
    mesh = meshio.Mesh(mesh.points, mesh.cells, point_sets=mesh.point_sets)
    mesh.cell_sets = {"all": [np.arange(count)]}
    entry: dict[str, Any] = {"material": "wood"}
    if shell:
        place = {"point": POINT.tolist(), "axis": AXIS.tolist(), "first": first}
        entry["orientation"] = place
    else:
        mesh.cell_data = {AXES: [np.hstack(around(mesh, first))]}
    sections = {"skin": {"shape": "shell", **shell}} if shell else {}
    wood = WOOD if shell else WOOD | {"expansion": [4e-6, 3e-5, 5e-5]}
    layered = "layers" in shell
    if shell:
        entry["section"] = "skin"
    if layered:
        del entry["material"]
    one = {"materials": {"wood": wood}, "regions": {"all": entry}, "sections": sections}
    import_description(one | more, "one", folder / "one.h5", mesh=mesh)
    mesh.cell_sets = {f"e{k}": [np.array([k])] for k in range(count)}
    mesh.cell_data = {}
    materials, regions, sections = {"wood": wood}, {}, {}
    for k, (a, b) in enumerate(zip(*around(mesh, first), strict=True)):
        if shell:
            sections[f"s{k}"] = {"shape": "shell", "axis_1": a.tolist(), **shell}
            regions[f"e{k}"] = {"section": f"s{k}"} | ({} if layered else {"material": "wood"})
        else:
            materials[f"m{k}"] = wood | {"axis_1": a.tolist(), "axis_2": b.tolist()}
            regions[f"e{k}"] = {"material": f"m{k}"}
    many = {"materials": materials, "regions": regions, "sections": sections}
    import_description(many | more, "many", folder / "many.h5", mesh=mesh)
    return folder / "one.h5", folder / "many.h5"


def assert_equal(paths: tuple[Path, Path], folder: Path, ranks: int) -> None:
    """Matrices and ports of both, and the vectors of their loads and outputs."""
    found = []
    for path in paths:
        a = assembled(folder / f"{path.stem}.m.h5", path, ranks)
        place = {at: k for k, at in enumerate(zip(a["node"], a["component"], strict=True))}
        order = [place[at] for at in sorted(place)]
        found.append([a[k].toarray()[np.ix_(order, order)] for k in "KM"])
        with h5py.File(folder / f"{path.stem}.m.h5") as file:
            found[-1] += [a["B"][order], file["C"][:][order]]
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * abs(other).max())


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("first", ["radial", "around", "along"])
@pytest.mark.parametrize("kind", ["hexahedron", "tetra10"])
def test_solids_around_an_axis(kind: str, first: str, ranks: int, tmp_path: Path) -> None:
    """Stiffness, heat, stress at nodes and in elements, and what a preload adds."""
    mesh = box(kind, (3, 2, 1))
    more = {
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "loads": {
            "warm": {"type": "temperature", "nodes": "end"},
            "spin": {"type": "spin", "point": [0, 0, 0], "axis": [0, 1, 0]},
        },
        "outputs": {
            "s": {"type": "stress", "nodes": "end"},
            "e": {"type": "stress", "elements": [1, 2]},
        },
    }
    assert_equal(bodies(mesh, tmp_path, first, more), tmp_path, ranks)
    more["preload"] = {"warm.T": 40.0, "spin.spin": 1e4}
    assert_equal(bodies(mesh, tmp_path, first, more), tmp_path, ranks)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("cell", ["quad", "triangle"])
@pytest.mark.parametrize("layers", [False, True])
def test_shells_around_an_axis(cell: str, layers: bool, ranks: int, tmp_path: Path) -> None:
    angle, z = np.meshgrid(np.linspace(0.2, 1.4, 5), np.linspace(0, 0.3, 4), indexing="ij")
    around_axis = [0.2 * np.cos(angle).ravel(), 0.2 * np.sin(angle).ravel()]
    points = np.column_stack([*around_axis, z.ravel()])
    at = np.arange(20).reshape(5, 4)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    cells = quads if cell == "quad" else np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    sets = {"start": at[0], "end": at[-1]}
    mesh = meshio.Mesh(points, [(cell, cells)], point_sets=sets)
    ply = {"material": "wood", "thickness": 1e-3}
    shell = {"layers": [ply, ply | {"angle": 60.0}]} if layers else {"thickness": 2e-3}
    more = {
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start", "components": ["x", "y", "z", "rx", "ry", "rz"]}},
        "outputs": {"s": {"type": "stress", "elements": [1, 2, 7], "side": "top"}},
        "loads": {"spin": {"type": "spin", "point": [0, 0, 0], "axis": [0, 1, 0]}},
    }
    paths = bodies(mesh, tmp_path, "around", more, **shell)
    assert_equal(paths, tmp_path, ranks)
    more["preload"] = {"spin.spin": 1e3}
    assert_equal(bodies(mesh, tmp_path, "around", more, **shell), tmp_path, ranks)


ROUND = "*ORIENTATION, NAME=FIBRE, SYSTEM=CYLINDRICAL\n-0.1, 0., 0., -0.08, 0.01, 1.\n"
ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")


@ccx
@pytest.mark.parametrize("element", ["C3D20", "C3D10", "C3D8", "C3D20R", "C3D6", "C3D15", "C3D4"])
def test_cylindrical_orientations_of_ccx(element: str, tmp_path: Path) -> None:
    """At each point of the stiffness, warm and orthotropic in that too; as the deck and in YAML."""
    mesh = box(CALCULIX[element], (4, 2, 2))
    steps = (
        "*BOUNDARY\nSTART, 1, 3\nEND, 1, 3\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 0\n"
        "*STEP\n*STATIC\n*TEMPERATURE\nNALL, 80\n*END STEP\n"
        "*STEP, PERTURBATION\n*FREQUENCY\n6\n*END STEP\n"
    )
    path = write_deck(tmp_path / "round.inp", element, steps, mesh=mesh)
    text = path.read_text()
    elastic = text[text.index("*ELASTIC") : text.index("*DENSITY")]
    expansion = "*EXPANSION, TYPE=ORTHO\n4e-5, 3e-5, -1e-5\n"
    section = "*SOLID SECTION"
    text = text.replace(elastic, CONSTANTS).replace(section, expansion + ROUND + section)
    made_of = "MATERIAL=STEEL"
    path.write_text(text.replace(f"{made_of}\n*BOUND", f"{made_of}, ORIENTATION=FIBRE\n*BOUND"))
    theirs = np.array(ccx_frequencies(path)[:6])
    middle = numbers(abs(mesh.points[:, 0] - 0.05) < 0.02)
    tip = f"tip=NODES:{','.join(str(n + 9) for n in middle)}"
    source = [str(path), "--assemble", "--distributing", tip, "--deck-loads"]
    out = ["-o", str(tmp_path / "deck.h5")]
    assert main(["import", *source, *out, "--preload", "step1_temperature.T=1"]) == 0
    content = {
        "materials": {
            "wood": {
                **dict(zip(ENGINEERING, (*E, *NU, *G), strict=True)),
                "rho": 7850.0,
                "expansion": [4e-5, 3e-5, -1e-5],
            }
        },
        "regions": {
            "all": {
                "material": "wood",
                "orientation": {"point": [-0.1, 0, 0], "axis": [0.02, 0.01, 1]},
                **FORMULATIONS.get(element, {}),
            }
        },
        "interfaces": {"tip": {"coupling": "distributing", "nodes": middle}},
        "supports": {end: {"nodes": end} for end in ("start", "end")},
        "loads": {
            "warm": {
                "type": "temperature",
                "table": [[k + 1, 80.0] for k in range(len(mesh.points))],
            }
        },
        "mass_integration": "reduced",
    }
    found = {}
    for preload in ({}, {"warm.T": 1.0}):
        import_description(content | {"preload": preload}, "b", tmp_path / "yaml.h5", mesh=mesh)
        for name in ("yaml",) if not preload else ("yaml", "deck"):
            a = assembled(tmp_path / "m.h5", tmp_path / f"{name}.h5")
            squares = eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)
            found[name, bool(preload)] = np.sqrt(np.sort(squares)) / (2 * np.pi)
    np.testing.assert_allclose(found["deck", True], theirs, rtol=1e-6)
    np.testing.assert_allclose(found["yaml", True], theirs, rtol=1e-6)
    assert max(abs(found["yaml", False] / theirs - 1)) > 1e-3


def test_axes_at_each_point_are_those_of_the_element(tmp_path: Path) -> None:
    """Where they are the same: stress and heat too."""
    mesh = box("hexahedron20", (2, 1, 1))
    of_elements = np.hstack(around(mesh, "around"))
    content = {
        "materials": {"wood": WOOD | {"expansion": [4e-6, 3e-5, 5e-5]}},
        "regions": {"all": {"material": "wood"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "loads": {"warm": {"type": "temperature", "nodes": "end"}},
        "outputs": {"s": {"type": "stress", "nodes": "end"}},
        "preload": {"warm.T": 30.0},
    }
    for name, axes in (("one", of_elements), ("many", np.repeat(of_elements[:, None], 27, axis=1))):
        mesh.cell_data = {AXES: [axes]}
        import_description(content, "box", tmp_path / f"{name}.h5", mesh=mesh)
    assert_equal((tmp_path / "one.h5", tmp_path / "many.h5"), tmp_path, 1)


def test_shells_of_abaqus_take_the_next_axis(tmp_path: Path) -> None:
    """Local 1 is the normal, and around the axis the first axis of the material."""
    angle = np.linspace(0, np.pi / 2, 4)
    rows = [
        f"{k * 2 + j + 1}, {np.cos(a):.12g}, {np.sin(a):.12g}, {j * 0.5}"
        for k, a in enumerate(angle)
        for j in range(2)
    ]
    cells = [f"{k + 1}, {2 * k + 1}, {2 * k + 3}, {2 * k + 4}, {2 * k + 2}" for k in range(3)]
    text = (
        "*NODE\n" + "\n".join(rows) + "\n*ELEMENT, TYPE=S4, ELSET=E\n" + "\n".join(cells) + "\n"
        "*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n0,0,0,0,0,1\n{about}"
        "*MATERIAL, NAME=PLY\n*ELASTIC, TYPE=LAMINA\n1e11,1e10,0.3,4e9,4e9,3e9\n*DENSITY\n1500\n"
        "*SHELL SECTION, ELSET=E, MATERIAL=PLY, ORIENTATION=O\n0.01\n*NSET, NSET=N\n1,2\n"
    )
    middle = 0.5 * (angle[:-1] + angle[1:])
    tangent = np.column_stack([-np.sin(middle), np.cos(middle), 0 * middle])
    out = tmp_path / "b.h5"
    source = [str(tmp_path / "tube.inp"), "--assemble", "--rigid", "tip=NSET:N", "-o", str(out)]
    for about, expected in (("", tangent), ("1, 0.\n", tangent), ("2, 0.\n", [[0, 0, 1]] * 3)):
        (tmp_path / "tube.inp").write_text(text.format(about=about))
        assert main(["import", *source, "--format", "abaqus"]) == 0
        with h5py.File(out) as file:
            (group,) = file["mesh/blocks"].values()
            np.testing.assert_allclose(group["axes"][:, :3], expected, atol=1e-12)
    assert main(["import", *source, "--format", "calculix"]) == 1


@pytest.mark.parametrize(
    ("orientation", "words"),
    [
        ({"point": [0, 0, 0], "axis": [0, 0, 0]}, "no direction"),
        ({"point": [0, 0, 0]}, "axis"),
        ({"point": [0, 0, 0], "axis": [0, 0, 1], "first": "up"}, "radial, around, along"),
        ({"point": [0.25, 0.25, 7], "axis": [0, 0, 1]}, "on the axis"),
    ],
)
def test_a_wrong_orientation_is_named(orientation: Any, words: str, tmp_path: Path) -> None:
    content = {
        "materials": {"wood": WOOD},
        "regions": {"all": {"material": "wood", "orientation": orientation}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": [1, 2, 3]}},
    }
    corners = np.vstack([np.zeros(3), np.eye(3)])
    mesh = meshio.Mesh(corners, [("tetra", np.array([[0, 1, 2, 3]]))])
    with pytest.raises(BodyError, match=words):
        import_description(content, "box", tmp_path / "b.h5", mesh=mesh)


def test_an_orientation_of_what_has_none(tmp_path: Path) -> None:
    """Beams, and shells whose normal is the first axis."""
    line = meshio.Mesh(np.eye(3)[:2], [("line", np.array([[0, 1]]))])
    square = np.array([[1.0, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]])
    sheet = meshio.Mesh(square, [("quad", np.array([[0, 1, 2, 3]]))])
    place = {"point": [0, 0.5, 0], "axis": [0, 0, 1]}
    for mesh, section, words in (
        (line, {"shape": "circle", "radius": 0.1}, "of solids and shells"),
        (sheet, {"shape": "shell", "thickness": 0.01}, "along the normal of a shell"),
    ):
        mesh.cell_sets = {"part": [np.array([0])]}
        content = {
            "materials": {"steel": {"E": 2e11, "nu": 0.3, "rho": 7800.0}},
            "sections": {"s": section},
            "regions": {"part": {"material": "steel", "section": "s", "orientation": place}},
            "interfaces": {"end": {"coupling": "node", "nodes": [1]}},
        }
        with pytest.raises(BodyError, match=words):
            import_description(content, "body", tmp_path / "b.h5", mesh=mesh)


def test_axes_of_a_file_by_hand(tmp_path: Path) -> None:
    content = {
        "materials": {"wood": WOOD},
        "regions": {
            "all": {"material": "wood", "orientation": {"point": [9, 9, 9], "axis": [0, 0, 1]}}
        },
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
    }
    mesh = box("hexahedron", (2, 1, 1))
    import_description(content, "box", tmp_path / "b.h5", mesh=mesh)
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        file["mesh/blocks/0000/axes"][1, 0] += 1e-3
    args = ("-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5")
    assert "not orthonormal" in run("assemble", *args, expect=1).err


@ccx
@pytest.mark.parametrize("element", ["C3D20", "C3D8", "C3D10"])
def test_distributions_of_ccx(element: str, tmp_path: Path) -> None:
    """Axes of single elements, and of all others."""
    mesh = box(CALCULIX[element], (4, 2, 2))
    held = "*BOUNDARY\nSTART, 1, 3\n*STEP\n*FREQUENCY\n8\n*END STEP\n"
    path = write_deck(tmp_path / "single.inp", element, held, mesh=mesh)
    text = path.read_text()
    elastic = text[text.index("*ELASTIC") : text.index("*DENSITY")]
    count = len(mesh.cells[0].data)
    rows = [
        f"{k}, {1 + 0.1 * k}, {0.3 * k}, 0.2, -{0.3 * k}, 1, {0.1 * k}" for k in range(2, count)
    ]
    given = (
        "*DISTRIBUTION, NAME=EACH\n, 0., 1., 0., -1., 0., 0.\n" + "\n".join(rows) + "\n"
        "*ORIENTATION, NAME=FIBRE\nEACH\n"
    )
    section = "*SOLID SECTION"
    text = text.replace(elastic, CONSTANTS).replace(section, given + section)
    path.write_text(
        text.replace("MATERIAL=STEEL\n*BOUND", "MATERIAL=STEEL, ORIENTATION=FIBRE\n*BOUND")
    )
    theirs = np.array(ccx_frequencies(path)[:6])
    out = ["--assemble", "--distributing", "tip=NSET:END", "-o", str(tmp_path / "b.h5")]
    assert main(["import", str(path), *out]) == 0
    a = assembled(tmp_path / "m.h5", tmp_path / "b.h5")
    squares = eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)
    np.testing.assert_allclose(np.sqrt(np.sort(squares)) / (2 * np.pi), theirs, rtol=1e-6)


def test_thickness_of_single_elements(tmp_path: Path) -> None:
    """As the same sheets by sections of their own, offsets too."""
    nodes = "*NODE\n1,0,0,0\n2,1,0,0\n3,2,0,0\n4,3,0,0\n5,0,1,0\n6,1,1,0\n7,2,1,0\n8,3,1,0\n"
    cells = "*ELEMENT, TYPE=S4, ELSET=E\n1,1,2,6,5\n2,2,3,7,6\n3,3,4,8,7\n"
    steel = "*MATERIAL, NAME=M\n*ELASTIC\n2e11,0.3\n*DENSITY\n7800\n*NSET, NSET=N\n4,8\n"
    table = "*DISTRIBUTION, NAME=T, LOCATION=ELEMENT, TABLE=X\n, 0.01\n2, 0.02\n"
    section = "*SHELL SECTION, MATERIAL=M, OFFSET=SPOS, ELSET="
    by_table = f"*DISTRIBUTION TABLE, NAME=X\nLENGTH\n{table}{section}E, SHELL THICKNESS=T\n0.5\n"
    sets = "*ELSET, ELSET=A\n1,3\n*ELSET, ELSET=B\n2\n"
    by_sets = f"{sets}{section}A\n0.01\n{section}B\n0.02\n"
    found = []
    for name, text in (("table", by_table), ("sets", by_sets)):
        (tmp_path / f"{name}.inp").write_text(nodes + cells + steel + text)
        out = ["--rigid", "tip=NSET:N", "-o", str(tmp_path / f"{name}.h5")]
        assert main(["import", str(tmp_path / f"{name}.inp"), "--assemble", *out]) == 0
        found.append(assembled(tmp_path / f"{name}.m.h5", tmp_path / f"{name}.h5"))
    for key in "KM":
        assert abs(found[0][key] - found[1][key]).max() < 1e-12 * abs(found[1][key]).max()
    deck = tmp_path / "table.inp"
    for nominal in ("", "0.\n"):  # what the section says does not matter
        deck.write_text(nodes + cells + steel + by_table.replace("0.5\n", nominal))
        out = ["--rigid", "tip=NSET:N", "-o", str(tmp_path / "again.h5")]
        assert main(["import", str(deck), "--assemble", *out]) == 0
        again = assembled(tmp_path / "again.m.h5", tmp_path / "again.h5")
        assert abs(again["K"] - found[1]["K"]).max() < 1e-12 * abs(found[1]["K"]).max()
    deck.write_text(nodes + cells + steel + by_table.replace("ELSET=E,", "ELSET=F,"))
    assert main(["import", str(deck), "--assemble", *out]) == 1
    deck.write_text(nodes + cells + steel + by_table.replace(", 0.01\n2", "2"))
    assert main(["import", str(tmp_path / "table.inp"), "--assemble", *out]) == 1


def test_distributions_of_an_instance(tmp_path: Path) -> None:
    """Axes and thicknesses of a part that stands twice, and one that is turned is refused."""
    part = (
        "*PART, NAME=P\n*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n"
        "*ELEMENT, TYPE=S4, ELSET=E\n1,1,2,3,4\n"
        "*DISTRIBUTION, NAME=T, LOCATION=ELEMENT, TABLE=X\n, 0.01\n1, 0.02\n"
        "*DISTRIBUTION, NAME=D, LOCATION=ELEMENT, TABLE=Y\n, 1,0,0,0,1,0\n1, 1,1,0,-1,1,0\n"
        "*ORIENTATION, NAME=O, DEFINITION=COORDINATES\nD\n3, 0.\n"
        "*SHELL SECTION, ELSET=E, MATERIAL=M, ORIENTATION=O, SHELL THICKNESS=T\n0.5\n*END PART\n"
    )
    ply = "*MATERIAL, NAME=M\n*ELASTIC, TYPE=LAMINA\n1e11,1e10,0.3,4e9,4e9,3e9\n*DENSITY\n1500\n"
    text = (
        f"{part}*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n*END INSTANCE\n"
        "*INSTANCE, NAME=J, PART=P\n5,0,0\n{more}*END INSTANCE\n"
        f"*NSET, NSET=N, INSTANCE=I\n1,2\n*END ASSEMBLY\n{ply}"
    )
    source = [str(tmp_path / "two.inp"), "--assemble", "--rigid", "tip=NSET:N"]
    source += ["--format", "abaqus", "-o", str(tmp_path / "b.h5")]
    (tmp_path / "two.inp").write_text(text.replace("{more}", ""))
    assert main(["import", *source]) == 0
    with h5py.File(tmp_path / "b.h5") as file:
        sections = {str(b.attrs["section"]) for b in file["mesh/blocks"].values()}
        assert {float(file["sections"][s].attrs["thickness"]) for s in sections} == {0.02}
        for block in file["mesh/blocks"].values():
            np.testing.assert_allclose(block["axes"][:, :3], [[0.5**0.5, 0.5**0.5, 0]])
    turned_one = text.replace("{more}", "0,0,0,0,0,1,30\n")
    for change in (("", ""), ("\nD\n3, 0.", ""), ("\nD\n3, 0.", "\nZ"), ("3, 0.", "1.5, 0.")):
        (tmp_path / "two.inp").write_text(turned_one.replace(*change))
        assert main(["import", *source]) == 1
