"""Bodies of shells, whole: claims of their reduced bodies, loads, sections, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from test_shells import KINDS, STEEL, write

import flexgram
from bodies import box
from conftest import assembled, assert_certified, body_system, certified, run
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.body.whole import mass_facts
from flexgram.model.geometry import Geometry
from sheets import flat, sheet


def angle(kind: str, count: int = 6) -> meshio.Mesh:
    """Two plates on one edge, 100 × 80 × 60 mm."""

    def shape(u: Any, v: Any) -> Any:
        along = 0.16 * v
        return 0.1 * u, np.minimum(along, 0.08), np.maximum(along - 0.08, 0)

    return sheet(kind, (count, 2 * count), shape)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_claims_hold(kind: str, ranks: int, tmp_path: Path) -> None:
    """A bracket of two materials with losses, thicknesses and an offset of their own, pressure
    on one of its plates and gravity, at frequencies that it was not given."""
    mesh = angle(kind)
    upright = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 2] > 1e-9
    mesh.cell_sets = {"flat": [np.flatnonzero(~upright)], "upright": [np.flatnonzero(upright)]}
    tip = int(np.intersect1d(mesh.point_sets["end"], mesh.point_sets["top"])[0]) + 1
    write(
        tmp_path / "body.h5",
        mesh,
        {"thickness": 0.002},
        materials={
            "steel": {**STEEL, "loss_factor": 0.002},
            "alloy": {"E": 70e9, "nu": 0.33, "rho": 2700.0, "loss_factor": 0.01},
        },
        sections={
            "sheet": {"shape": "shell", "thickness": 0.002},
            "thick": {"shape": "shell", "thickness": 0.003, "offset": 0.0015},
        },
        regions={
            "flat": {"material": "steel", "section": "sheet"},
            "upright": {"material": "alloy", "section": "thick"},
        },
        interfaces={"tip": {"coupling": "node", "nodes": [tip]}},
        supports={"clamp": {"nodes": "bottom", "components": ["x", "y", "z"]}},
        loads={
            "gas": {"type": "pressure", "nodes": {"box": [[-1, 0.0799, -1], [1, 0.0801, 1]]}},
            "gravity": {"type": "acceleration"},
        },
    )
    run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5", ranks=ranks)
    full = body_system(tmp_path / "m.h5")
    of_body = certified(
        *(tmp_path / "body.h5", (5, 900), tmp_path, "-mor_tol", "1e-4"), ranks=ranks, full=full
    )
    assert_certified(of_body, 1e-4)
    geometry = Geometry.load(tmp_path / "body.h5")
    faces = geometry.surface()
    assert len(faces) == len(mesh.cells[0].data) * (2 if kind == "quad" else 1)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_what_loads_are(kind: str, ranks: int, tmp_path: Path) -> None:
    """Pressure pushes along the normals, weight is that of the mass, and both turn about the mass
    centre where nodes are beside it."""
    t, offset, side = 0.01, 0.02, (0.4, 0.3)
    mesh = sheet(kind, (4, 3), flat(*side), 0.2)
    facts = write(
        tmp_path / "body.h5",
        mesh,
        {"thickness": t, "offset": offset},
        loads={
            "gas": {"type": "pressure", "nodes": "all"},
            "wind": {"type": "traction", "nodes": "all"},
            "gravity": {"type": "acceleration"},
            "start": {"type": "angular_acceleration", "point": [0, 0, 0]},
        },
        interfaces={"all": {"coupling": "rigid", "nodes": [1]}},
    )
    assert facts["loads"]["gas"].startswith("pressure on")
    a = assembled(tmp_path / "m.h5", tmp_path / "body.h5", ranks)
    names = a["names"]
    R = np.zeros((len(a["node"]), 6))
    for c in range(6):
        axis = np.eye(3)[c % 3]
        moved = np.cross(axis, a["position"]) if c > 2 else np.broadcast_to(axis, (len(R), 3))
        motion = np.hstack([moved, np.broadcast_to(axis if c > 2 else 0 * axis, moved.shape)])
        R[:, c] = motion[np.arange(len(R)), a["component"]]

    def resultant(name: str) -> Any:
        return R.T @ a["B"].T[names.index(name)]

    area, mass = side[0] * side[1], side[0] * side[1] * t * STEEL["rho"]
    x, y = side[0] / 2, side[1] / 2
    np.testing.assert_allclose(resultant("gas.p"), area * np.array([0, 0, 1, y, -x, 0]), atol=1e-12)
    np.testing.assert_allclose(
        resultant("wind.tx"), area * np.array([1, 0, 0, 0, 0, -y]), atol=1e-12
    )
    weight = mass * np.array([1, 0, 0, 0, offset, -y])
    np.testing.assert_allclose(resultant("gravity.ax"), weight, atol=1e-12 * mass)
    with h5py.File(tmp_path / "body.h5") as file:
        whole = mass_facts(file)
    assert whole.mass == pytest.approx(mass) and facts["summary"][0].startswith("mass 9.6 kg")
    np.testing.assert_allclose(whole.centre, [x, y, offset], atol=1e-12)
    about = [mass * (side[1] ** 2 + t**2) / 12, mass * (side[0] ** 2 + t**2) / 12]
    np.testing.assert_allclose(np.diag(whole.inertia)[:2], about, rtol=1e-12)
    turned = resultant("start.alphax")[3]
    assert turned == pytest.approx(about[0] + mass * (y**2 + offset**2), rel=1e-12)


def test_shells_on_a_solid(tmp_path: Path) -> None:
    """A plate stands on a block, with nodes of both: pressure on the top counts once, a part of the
    mesh that bounds the block is no shell."""
    block = box("hexahedron", (4, 3, 2), (0.4, 0.3, 0.1), distort=False)
    top = np.flatnonzero(np.isclose(block.points[:, 2], block.points[:, 2].max()))
    face = [row for row in block.cells[0].data[:, [4, 5, 6, 7]] if np.isin(row, top).all()]
    mesh = meshio.Mesh(
        block.points,
        [*block.cells, ("quad", np.array(face))],
        cell_sets={"lid": [np.empty(0, int), np.arange(len(face))],
                   "block": [np.arange(len(block.cells[0].data)), np.empty(0, int)]},
    )  # fmt: skip
    content = {
        "materials": {"steel": STEEL},
        "sections": {"sheet": {"shape": "shell", "thickness": 0.004, "offset": 0.002}},
        "regions": {
            "block": {"material": "steel"},
            "lid": {"material": "steel", "section": "sheet"},
        },
        "interfaces": {
            "foot": {"coupling": "rigid", "nodes": {"box": [[-1, -1, -1], [1, 1, 0.001]]}}
        },
        "loads": {"gas": {"type": "pressure", "nodes": "lid"}},
    }
    facts = import_description(content, "both", tmp_path / "both.h5", mesh=mesh)
    assert facts["loads"]["gas"] == "pressure on 12 faces, 0.12 m^2"
    a = assembled(tmp_path / "m.h5", tmp_path / "both.h5")
    down = a["B"].T[a["names"].index("gas.p")]
    assert down[a["component"] == 2].sum() == pytest.approx(-0.12)
    assert flexgram.reduce(tmp_path / "both.h5", (10, 1000), 1e-3).certified_error <= 1e-3
    content["regions"] = {"block": {"material": "steel"}}
    again = import_description(content, "bare", tmp_path / "bare.h5", mesh=mesh)
    assert again["kinds"] == ["hexahedron"]


def wrong(change: Any, tmp_path: Path, mesh: Any = None) -> None:
    write(
        tmp_path / "body.h5",
        mesh or sheet("quad", (2, 2), flat(1, 1)),
        {"thickness": 0.1},
        **change,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"regions": {"all": {"material": "steel"}}}, "give the region a section of shape shell"),
        ({"sections": {"sheet": {"shape": "shell"}}}, "needs a thickness, or layers"),
        ({"sections": {"sheet": {"shape": "shell", "thickness": 0}}}, "must be positive"),
        ({"sections": {"sheet": {"shape": "shell", "thickness": 1, "width": 2}}}, "unknown key"),
        (
            {"sections": {"sheet": {"shape": "shell", "thickness": 1, "axis_1": [0, 0, 0]}}},
            "has no direction",
        ),
        (
            {"sections": {"sheet": {"shape": "circle", "radius": 1}}},
            "with a section of a shell triangle, quad",
        ),
        (
            {"sections": {"sheet": {"shape": "shell", "layers": []}}},
            "layers must be a list, from the bottom",
        ),
        (
            {"sections": {"sheet": {"shape": "shell", "layers": [{"material": "wood"}]}}},
            "layer 1: material = 'wood' must be one of steel",
        ),
        (
            {
                "sections": {
                    "sheet": {
                        "shape": "shell",
                        "layers": [{"material": "steel", "thickness": 0.001}],
                    }
                }
            },
            "the layers of section sheet have materials",
        ),
        ({"outputs": {"s": {"type": "stress", "nodes": "end"}}}, "name the side of the shell"),
        ({"loads": {"heat": {"type": "temperature", "nodes": "end"}}}, "has no expansion"),
    ],
)
def test_what_is_refused(change: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        wrong(change, tmp_path)


def test_sides_of_pressure(tmp_path: Path) -> None:
    """Normals that point to different sides, and a joint of three plates, where they may."""
    mesh = sheet("quad", (2, 2), flat(1, 1))
    load = {"loads": {"gas": {"type": "pressure", "nodes": "all"}}}
    wrong(load, tmp_path, mesh)
    mesh.cells[0].data[0] = mesh.cells[0].data[0][::-1].copy()
    with pytest.raises(BodyError, match="at nodes 2 and 5 point to different sides"):
        wrong(load, tmp_path, mesh)
    more = np.vstack([mesh.points, [[0.5, 0, 1], [0.5, 0.5, 1]]])
    mesh = sheet("quad", (2, 1), flat(1, 0.5))
    cells = np.vstack([mesh.cells[0].data, [[2, 3, 7, 6]]])
    more = np.vstack([mesh.points, [[0.5, 0, 1], [0.5, 0.5, 1]]])
    joint = meshio.Mesh(more, [("quad", cells)], point_sets={"corner": [0]})
    wrong(load, tmp_path, joint)


def test_errors_of_the_program(tmp_path: Path) -> None:
    """Fibres along the normal, inverted and thin elements, and what takes no offset."""
    wood = {"E1": 12e9, "E2": 0.9e9, "E3": 0.5e9, "nu12": 0.4, "nu13": 0.4, "nu23": 0.3,
            "G12": 0.7e9, "G13": 0.7e9, "G23": 0.2e9, "rho": 600.0}  # fmt: skip
    mesh = sheet("quad", (2, 2), flat(1, 1))
    path = tmp_path / "body.h5"

    def said(section: Any, material: Any = STEEL, mesh: Any = mesh, **more: Any) -> str:
        write(path, mesh, section, material, **more)
        arguments = ("assemble", "-body", path, "-body_out", tmp_path / "m.h5")
        return run(*arguments, expect=1).err

    assert "axis_1 of a shell's section is along its normal" in said(
        {"thickness": 0.01, "axis_1": [0, 0, 1]}, wood
    )
    relaxes = {**STEEL, "viscoelastic": {"prony": [[0.3, 0.01]]}}
    layers = [{"material": name, "thickness": 0.001} for name in ("steel", "rubber")]
    assert "material rubber of a layer: layers of several materials take loss factors" in said(
        {},
        materials={"steel": STEEL, "rubber": relaxes},
        sections={"sheet": {"shape": "shell", "layers": layers}},
        regions={"all": {"section": "sheet"}},
    )
    spin = {"spin": {"axis": [0, 0, 1], "to": 5.0}}
    held = {"supports": {"hub": {"nodes": "start", "components": ["x", "y", "z", "rx", "ry"]}}}
    apart = {"interfaces": {"end": {"coupling": "node", "nodes": "middle"}}}
    beside = said({"thickness": 0.01, "offset": 0.1}, **spin, **held, **apart)
    assert "element 1 (quad, material steel): a shell whose mass is not at its nodes" in beside
    assert "element 1 (quad, material steel): it is some 5e+07 times wider" in said(
        {"thickness": 1e-8}
    )
    turned = sheet("quad", (2, 2), flat(1, 1))
    turned.points[4] = [0.05, 0.05, 0]
    assert "is inverted or flat" in said({"thickness": 0.01}, mesh=turned)


def test_one_material_on_the_command_line(tmp_path: Path) -> None:
    mesh = sheet("triangle", (4, 4), flat(200, 100))
    meshio.write(tmp_path / "sheet.vtu", mesh)
    arguments = ("import", tmp_path / "sheet.vtu", "--material", "steel", "--units", "mm-t-s")
    ports = ("--node", "tip=NODES:1", "-o", tmp_path / "sheet.h5")
    said = run(*arguments, *ports, "--thickness", "2.5").out
    assert "mass 0.3925 kg" in said and "quadrilaterals converge faster" in said
    assert "give the region a section of shape shell" in run(*arguments, *ports, expect=1).err
