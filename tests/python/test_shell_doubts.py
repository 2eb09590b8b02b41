"""What bodies of shells say or refuse where they would be another body than is meant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.sparse.linalg as spl
from test_preload import line
from test_shells import FOAM, PLY, SIX, STEEL, Sheet, write

import flexgram
from bodies import box
from conftest import assembled, run
from flexgram import BodyError, ReductionWarning
from flexgram.body.description import import_description
from sheets import flat, sheet

PORT = {"port": {"coupling": "node", "nodes": "middle"}}
TURN = {"turn": {"type": "spin", "point": [0.1, 0.0, 0.0], "axis": [0.48, 0.6, 0.64]}}


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_flat_sheet_is_reduced_with_its_stress(axis: str, tmp_path: Path) -> None:
    """Components across a coordinate plane vanish: they are no outputs, and the import says so."""
    mesh = sheet("quad", (8, 6), flat(0.3, 0.2))
    mesh.points = np.roll(mesh.points, "zxy".index(axis), axis=1)
    facts = write(
        tmp_path / "b.h5", mesh, {"thickness": 0.002}, interfaces=PORT,
        supports={"clamp": {"nodes": "start", "components": SIX}}, damping={"alpha": 3.0},
        outputs={"q": {"type": "stress", "nodes": "corner", "side": "top"},
                 "two": {"type": "stress", "elements": [7, 8], "side": "bottom"}},
    )  # fmt: skip
    gone = {"z": "szz, syz, szx", "x": "sxx, sxy, szx", "y": "syy, sxy, syz"}[axis]
    assert facts["outputs"]["q"].endswith(f") m ({gone} vanish), top side")
    rom = flexgram.reduce(tmp_path / "b.h5", (5, 500), 1e-3)
    assert rom.certified_error <= 1e-3 and sum(name.startswith("q.") for name in rom.outputs) == 3


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_axes_do_not_matter(kind: str, tmp_path: Path) -> None:
    """Warped elements of an isotropic sheet are the same whatever axis they face."""
    rng = np.random.default_rng(4)
    mesh = sheet(kind, (5, 3), flat(1.0, 0.4), 0.2)
    mesh.points[:, 2] += 0.01 * rng.normal(size=len(mesh.points))
    points, found = mesh.points.copy(), {}
    for shift in range(3):
        mesh.points = np.roll(points, shift, axis=1)
        found[shift] = Sheet(tmp_path, mesh, {"thickness": 0.01}).hertz(16)[6:]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-6)


def test_spin_loads_are_of_all_the_mass(tmp_path: Path) -> None:
    """∫ρ (x − p)⊥ and its moment, of shells beside their nodes, layers, beams and oblique inertia,
    by points of the same mass."""
    layers = [{"material": "foam", "thickness": 0.03}, {"material": "steel", "thickness": 0.01}]
    mesh = sheet("quad", (3, 2), flat(0.4, 0.3), 0.2)
    point = {"mass": 2.0, "inertia": [0.2, 0.3, 0.4, 0.05, -0.03, 0.02]}
    write(
        tmp_path / "s.h5", mesh, {}, loads=TURN, interfaces=PORT,
        materials={"steel": STEEL, "foam": FOAM},
        sections={"sheet": {"shape": "shell", "layers": layers, "offset": 0.05}},
        regions={"all": {"section": "sheet"}},
        masses={"disc": {"at": "port", **point}},
    )  # fmt: skip
    beams = line(3, 0.1, 0.5)
    section = {"shape": "rectangle", "width": 0.06, "height": 0.02}
    import_description(
        {
            "materials": {"steel": STEEL},
            "sections": {"bar": section},
            "regions": {"all": {"material": "steel", "section": "bar"}},
            "interfaces": {"port": {"coupling": "node", "nodes": "end"}},
            "loads": TURN,
        },
        "bar", tmp_path / "b.h5", mesh=beams,
    )  # fmt: skip
    middle = mesh.points[mesh.point_sets["middle"][0]]
    J = np.array([[0.2, 0.05, 0.02], [0.05, 0.3, -0.03], [0.02, -0.03, 0.4]])
    second = 0.5 * np.trace(J) * np.eye(3) - J  # ∫ρ r rᵀ
    values, vectors = np.linalg.eigh(second)
    arms = np.sqrt(values / 2.0 * 3.0)[:, None] * vectors.T  # six points of a sixth of the mass
    disc = [(2.0 / 6, middle + s * arm) for arm in arms for s in (-1, 1)]
    g = np.array([-1, 1]) / np.sqrt(3)
    gauss = [(0.5 * (1 + a), 0.5 * (1 + b), 0.5 * (1 + c)) for a in g for b in g for c in g]

    def brick(low: Any, high: Any, density: float) -> list[tuple[float, Any]]:
        size = np.subtract(high, low)
        return [(density * size.prod() / 8, low + size * np.array(x)) for x in gauss]

    low, top = 0.05 - 0.02, 0.05 + 0.02
    plate = brick([0, 0, low], [0.4, 0.3, low + 0.03], FOAM["rho"])
    plate += brick([0, 0, low + 0.03], [0.4, 0.3, top], STEEL["rho"])
    bar = brick([0.1, -0.03, -0.01], [0.6, 0.03, 0.01], STEEL["rho"])
    p, e = np.array([0.1, 0, 0]), np.array([0.48, 0.6, 0.64])
    for name, points in (("s", [*plate, *disc]), ("b", bar)):
        a = assembled(tmp_path / f"{name}.m.h5", tmp_path / f"{name}.h5")
        f = a["B"].T[a["names"].index("turn.spin")]
        force, moment = np.zeros(3), np.zeros(3)
        for c in range(3):
            force[c] = f[a["component"] == c].sum()
            moment[c] = f[a["component"] == 3 + c].sum()
        at = np.zeros((a["node"].max() + 1, 3))
        for node, c, value in zip(a["node"], a["component"], f, strict=True):
            if c < 3:
                at[node, c] = value
        places = np.zeros_like(at)
        places[a["node"]] = a["position"]
        moment += np.cross(places, at).sum(axis=0)
        push = [m * ((x - p) - e * (e @ (x - p))) for m, x in points]
        np.testing.assert_allclose(force, np.sum(push, axis=0), atol=1e-10)
        expected = np.sum([np.cross(x, f) for (_, x), f in zip(points, push, strict=True)], axis=0)
        np.testing.assert_allclose(moment, expected, atol=1e-9)


def test_axes_of_layers(tmp_path: Path) -> None:
    """Angles are from the fibres' own axis, whichever layer comes first; two axes need the
    section's."""
    across = {**PLY, "axis_1": [0, 1, 0], "axis_2": [-1, 0, 0]}
    mesh = sheet("quad", (4, 3), flat(0.4, 0.2))

    def strip(materials: Any, *names: str, **more: Any) -> Any:
        layers = [{"material": name, "thickness": 0.001} for name in names]
        a = Sheet(
            tmp_path, mesh, {}, materials=materials, regions={"all": {"section": "sheet"}},
            sections={"sheet": {"shape": "shell", "layers": layers, **more}},
        )  # fmt: skip
        return a.hertz(3, a.rows("start", SIX))

    of = {"ply": across, "foam": FOAM}
    np.testing.assert_allclose(strip(of, "foam", "ply"), strip(of, "ply", "foam"), rtol=1e-9)
    two = {"ply": PLY, "turned": across}
    with pytest.raises(BodyError, match="different axis_1: give the section an axis_1"):
        strip(two, "ply", "turned")
    alike = strip(two, "ply", "turned", axis_1=[0, 1, 0])
    np.testing.assert_allclose(alike, strip(of, "ply", "ply"), rtol=1e-9)


def standing(over: bool) -> meshio.Mesh:
    """A plate that stands on the edge of a block, or goes on over its face."""
    block = box("hexahedron", (4, 3, 2), (0.4, 0.3, 0.1), distort=False)
    edge = np.flatnonzero(np.isclose(block.points[:, 0], 0) & np.isclose(block.points[:, 2], 0.1))
    edge = edge[np.argsort(block.points[edge, 1])]
    upper = len(block.points) + np.arange(len(edge))
    points = np.vstack([block.points, block.points[edge] + [0, 0, 0.2]])
    quads = [np.column_stack([edge[:-1], edge[1:], upper[1:], upper[:-1]])]
    if over:
        down = [np.flatnonzero(np.all(np.isclose(block.points, x - [0, 0, 0.05]), axis=1))[0]
                for x in block.points[edge]]  # fmt: skip
        lower = np.array(down)
        quads.append(np.column_stack([lower[:-1], lower[1:], edge[1:], edge[:-1]]))
    cells = np.vstack(quads)
    return meshio.Mesh(
        points,
        [*block.cells, ("quad", cells)],
        cell_sets={"wall": [np.empty(0, int), np.arange(len(cells))]},
        point_sets={"foot": np.flatnonzero(np.isclose(points[:, 2], 0)), "corner": upper[:1]},
    )


@pytest.mark.parametrize("over", [False, True])
def test_a_hinge_is_told(over: bool, tmp_path: Path) -> None:
    content = {
        "materials": {"steel": STEEL},
        "sections": {"sheet": {"shape": "shell", "thickness": 0.004}},
        "regions": {
            "all": {"material": "steel"},
            "wall": {"material": "steel", "section": "sheet"},
        },
        "interfaces": {"corner": {"coupling": "node", "nodes": "corner"}},
        "supports": {"foot": {"nodes": "foot", "components": ["x", "y", "z"]}},
    }
    facts = import_description(content, "s", tmp_path / "s.h5", mesh=standing(over))
    told = [word for word in facts["warnings"] if "it is a hinge there" in word]
    a = assembled(tmp_path / "m.h5", tmp_path / "s.h5")
    scale = a["K"].diagonal().max()
    lowest = spl.eigsh(a["K"].tocsc(), 1, sigma=-1e-9 * scale, return_eigenvectors=False)[0]
    assert bool(told) == (not over) == (abs(lowest) < 1e-13 * scale)


def test_sides_that_matter(tmp_path: Path) -> None:
    """Normals that point to different sides, where the section has an offset."""
    mesh = sheet("quad", (2, 2), flat(1, 1))
    mesh.cells[0].data[0] = mesh.cells[0].data[0][::-1].copy()
    write(tmp_path / "b.h5", mesh, {"thickness": 0.1})
    with pytest.warns(ReductionWarning, match="nodes 2 and 5 point to different sides: its offset"):
        write(tmp_path / "b.h5", mesh, {"thickness": 0.1, "offset": 0.05})


def test_parts_of_two_kinds(tmp_path: Path) -> None:
    block = box("hexahedron", (2, 1, 1), distort=False)
    both = meshio.Mesh(
        block.points,
        [*block.cells, ("quad", block.cells[0].data[:1, [4, 5, 6, 7]])],
        cell_sets={"part": [np.arange(2), np.arange(1)]},
        point_sets={"corner": [0]},
    )
    regions = {"regions": {"part": {"material": "steel", "section": "sheet"}}}
    with pytest.raises(BodyError, match="and hexahedron too: name parts of one kind"):
        write(tmp_path / "b.h5", both, {"thickness": 0.1}, **regions)
    table = {"pull": {"type": "nodal", "table": [[5, 0, 0, 1, 7, 8, 9]]}}
    alone = {"regions": {"part": {"material": "steel"}}, "loads": table}
    with pytest.raises(BodyError, match="node 5 is one of solids, which take no moment"):
        write(tmp_path / "b.h5", both, {"thickness": 0.1}, **alone)


def test_supports_of_sheets(tmp_path: Path) -> None:
    """The command line clamps; a description that says nothing of rotations makes a hinge of an
    edge, and the import says so."""
    mesh = sheet("quad", (4, 2), flat(0.2, 0.1))
    meshio.write(tmp_path / "sheet.inp", mesh)
    words = ["import", tmp_path / "sheet.inp", "--material", "steel", "--thickness", "0.002"]
    words += ["--node", "tip=NODES:1", "-o", tmp_path / "sheet.h5"]
    clamped = run(*words, "--support", "edge=NSET:end").out
    assert "0 of 6 rigid motions are free" in clamped and "turn freely" not in clamped
    hinged = run(*words, "--support", "edge=x,y,z:NSET:end").out
    assert "1 of 6 rigid motions are free" in hinged and "turn freely" not in hinged
    facts = write(
        tmp_path / "b.h5", mesh, {"thickness": 0.002}, interfaces=PORT,
        supports={"edge": {"nodes": "end"}}, damping={"alpha": 3.0},
    )  # fmt: skip
    assert any("support edge: " in said and "turn freely" in said for said in facts["warnings"])


def test_outputs_of_the_command_line(tmp_path: Path) -> None:
    meshio.write(tmp_path / "sheet.vtu", sheet("quad", (4, 2), flat(0.2, 0.1)))
    said = run(
        *("import", tmp_path / "sheet.vtu", "--material", "steel", "--thickness", "0.002"),
        *("--node", "tip=NODES:1", "--measure", "q=stress/top:NODES:8"),
        *("--measure", "g=gauge/bottom:1,0,0:NODES:8", "-o", tmp_path / "sheet.h5"),
    ).out
    assert "output q: stress at the node at (" in said and "top side" in said
    with h5py.File(tmp_path / "sheet.h5") as file:
        assert file["outputs/g/values"].shape[2] == 6
