"""Loads and outputs of mesh bodies: identities that hold exactly, CalculiX's statics, claims."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from test_importers import write_deck

from bodies import CALCULIX, box
from conftest import assembled, assert_certified, body_system, certified, chain, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.body.description import import_description

KINDS = ("tetra", "tetra10", "hexahedron", "hexahedron20", "wedge15")
RHO = 7850.0
POINT, AXIS = [0.01, -0.02, 0.005], [1.0, 2.0, -1.0]
LOADS = {
    "gravity": {"type": "acceleration"},
    "swing": {"type": "angular_acceleration", "point": POINT},
    "turn": {"type": "spin", "point": POINT, "axis": AXIS},
    "skin": {"type": "pressure", "nodes": "all"},
    "side": {"type": "pressure", "nodes": "side"},
    "wind": {"type": "traction", "nodes": "side"},
    "push": {"type": "force", "nodes": "side"},
}
OUTPUTS = {
    "side": {"nodes": "side"},
    "gap": {"nodes": "side", "relative_to": "end", "direction": [0, 3, 4]},
}


def sided(kind: str, distort: bool = True, counts: tuple[int, int, int] = (4, 2, 2)) -> Any:
    """A box with the node set ``side``, where y was largest."""
    plain = box(kind, counts, distort=False)
    mesh = box(kind, counts, distort=distort)
    y = plain.points[:, 1]
    mesh.point_sets["side"] = np.flatnonzero(y > y.max() - 1e-9)
    return mesh


def write_body(path: Path, mesh: Any, **changes: Any) -> dict[str, Any]:
    content = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": RHO}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "loads": LOADS,
        "outputs": OUTPUTS,
    }
    return import_description(content | changes, "box", path, mesh=mesh)


def ports(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Columns of B and rows of C by their names."""
    with h5py.File(path) as file:
        B, C = file["B"][:], file["C"][:].T  # by columns
        return (
            dict(zip(map(str, file["B"].attrs["names"]), B.T, strict=True)),
            dict(zip(map(str, file["C"].attrs["names"]), C, strict=True)),
        )


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_what_loads_must_be(kind: str, ranks: int, tmp_path: Path) -> None:
    mesh = sided(kind)
    facts = write_body(tmp_path / "body.h5", mesh)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    B, C = ports(tmp_path / "matrices.h5")
    x, axis_of = a["position"], a["component"]

    def field(vectors: Any) -> Any:
        return vectors[np.arange(len(x)), axis_of]

    arm = x - POINT
    n = np.array(AXIS) / np.linalg.norm(AXIS)
    fields = {"turn.spin": arm - np.outer(arm @ n, n)}
    for i, letter in enumerate("xyz"):
        fields[f"gravity.a{letter}"] = np.tile(np.eye(3)[i], (len(x), 1))
        fields[f"swing.alpha{letter}"] = np.cross(np.eye(3)[i], arm)
    for name, vectors in fields.items():
        expected = a["M"] @ field(vectors)
        assert np.abs(B[name] - expected).max() < 1e-12 * np.abs(expected).max(), name

    # Pressure on the whole skin: no resultant, and the work of a linear field is −tr(A) V.
    volume = a["M"].sum() / 3 / RHO
    A = np.random.default_rng(1).standard_normal((3, 3))
    for i in range(3):
        assert abs(B["skin.p"][axis_of == i].sum()) < 1e-12 * np.abs(B["skin.p"]).sum()
    assert B["skin.p"] @ field(x @ A.T) == pytest.approx(-np.trace(A) * volume, rel=1e-10)
    # Of one side the traction's resultant is its area, which no pressure's exceeds.
    total = np.array([B["side.p"][axis_of == i].sum() for i in range(3)])
    areas = [B[f"wind.t{letter}"][axis_of == i].sum() for i, letter in enumerate("xyz")]
    assert np.ptp(areas) < 1e-12 * areas[0]
    assert 0.99 * areas[0] < np.linalg.norm(total) <= areas[0] and total[1] < 0
    assert f"{areas[0]:.4g} m^2" in facts["loads"]["wind"]
    # Mean displacements.
    nodes = np.isin(a["node"], mesh.point_sets["side"])
    end = np.isin(a["node"], mesh.point_sets["end"])
    for i, letter in enumerate("xyz"):
        mean = (nodes & (axis_of == i)) / len(mesh.point_sets["side"])
        assert np.abs(C[f"side.u{letter}"] - mean).max() < 1e-15
        assert np.abs(B[f"push.f{letter}"] - mean).max() < 1e-15
    apart = nodes / len(mesh.point_sets["side"]) - end / len(mesh.point_sets["end"])
    assert np.abs(C["gap.u"] - apart * np.array([0, 0.6, 0.8])[axis_of]).max() < 1e-15


def test_loads_at_rigid_interfaces(tmp_path: Path) -> None:
    """A slave's share goes to its reference, with its moment: any motion of the reference does the
    work that the same motion of the free nodes does."""
    mesh = sided("tetra10")
    rigid = {"end": {"coupling": "rigid", "nodes": "end", "position": [0.12, 0.01, 0.0]}}
    given = {"side": {"type": "pressure", "nodes": "side"}, "gravity": {"type": "acceleration"}}
    work = []
    for name, interfaces in (
        ("rigid", rigid),
        ("free", {"end": {**rigid["end"], "coupling": "distributing"}}),
    ):
        write_body(tmp_path / "body.h5", mesh, interfaces=interfaces, loads=given, outputs={})
        a = assembled(tmp_path / f"{name}.h5", tmp_path / "body.h5")
        B, _ = ports(tmp_path / f"{name}.h5")
        axes, turn = np.eye(3), a["component"] - 3
        moved = []
        for i in range(6):  # rigid motions of the whole body
            u = np.zeros(len(turn))
            translate = turn < 0
            vectors = (
                np.tile(axes[i], (len(u), 1)) if i < 3 else np.cross(axes[i - 3], a["position"])
            )
            u[translate] = vectors[translate, a["component"][translate]]
            if i >= 3:
                u[~translate] = turn[~translate] == i - 3
            moved.append([B["side.p"] @ u, B["gravity.ay"] @ u])
        work.append(moved)
    assert np.allclose(work[0], work[1], rtol=1e-11, atol=1e-14)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D15", "C3D20"])
def test_statics_of_calculix(element: str, tmp_path: Path) -> None:
    """Displacements under gravity, spin and pressure, to the digits that ccx prints."""
    mesh = sided(CALCULIX[element])
    cells = mesh.cells[0].data
    faces = {
        "tetra": [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)],
        "wedge": [(0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
        "hexahedron": [
            (0, 1, 2, 3),
            (4, 7, 6, 5),
            (0, 4, 5, 1),
            (1, 5, 6, 2),
            (2, 6, 7, 3),
            (3, 7, 4, 0),
        ],
    }[mesh.cells[0].type.rstrip("0123456789")]
    inside = np.isin(cells, mesh.point_sets["side"])
    pressed = [
        f"{e + 1}, P{k + 1}, 2e6"
        for e in range(len(cells))
        for k, face in enumerate(faces)
        if inside[e, list(face)].all()
    ]
    n = np.array(AXIS) / np.linalg.norm(AXIS)
    spin = ", ".join(map(str, [1e6, *POINT, *n]))
    loads = {
        "gravity.az": "EALL, GRAV, 9.81, 0, 0, 1",
        "turn.spin": f"EALL, CENTRIF, {spin}",
        "side.p": "\n".join(pressed),
    }
    factors = {"gravity.az": 9.81, "turn.spin": 1e6, "side.p": 2e6}
    extra = "*BOUNDARY\nSTART, 1, 3\n" + "".join(
        f"*STEP\n*STATIC\n*DLOAD, OP=NEW\n{cards}\n*NODE PRINT, NSET=NALL\nU\n*END STEP\n"
        for cards in loads.values()
    )
    deck = write_deck(tmp_path / "box.inp", element, extra, mesh=mesh)
    subprocess.run(["ccx", deck.stem], cwd=tmp_path, capture_output=True, check=True)
    printed: list[dict[int, Any]] = []
    for line in deck.with_suffix(".dat").read_text().splitlines():
        if "displacements" in line:
            printed.append({})
        elif printed and len(line.split()) == 4:
            label, *u = line.split()
            printed[-1][int(label) - 10] = [float(v) for v in u]
    assert len(printed) == 3

    write_body(
        tmp_path / "body.h5",
        mesh,
        mass_integration="reduced",
        supports={"start": {"nodes": "start"}},
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    B, _ = ports(tmp_path / "matrices.h5")
    for (name, factor), theirs in zip(factors.items(), printed, strict=True):
        u = spsolve(a["K"].tocsc(), factor * B[name])
        there = np.array(
            [theirs[node][c] for node, c in zip(a["node"], a["component"], strict=True)]
        )
        assert np.abs(u - there).max() < 2e-6 * np.abs(there).max(), name


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("held", [True, False])
def test_claims_hold_for_each_kind(held: bool, ranks: int, tmp_path: Path) -> None:
    """Held at one end, and free, where gravity is all rigid motion."""
    mesh = sided("tetra10", counts=(6, 3, 3))
    write_body(
        tmp_path / "body.h5",
        mesh,
        damping={"alpha": 20.0, "beta": 1e-6},
        supports={"start": {"nodes": "start"}} if held else {},
    )
    run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "matrices.h5")
    result = certified(
        tmp_path / "matrices.h5", (100.0, 9000.0), tmp_path, "-mor_tol", "1e-4", ranks=ranks
    )
    # Of the free body's H as a whole nearly all is rigid motion by gravity, per m/s².
    assert_certified(result, 1e-4, sharp=5 if held else 1000)
    worst = int(np.argmax(result["by_kind"]))
    assert result["by_kind"][worst] <= 5 * result["kinds"][worst]
    rom = ReducedModel.load(result["path"])
    assert {
        "displacement from force",
        "displacement from pressure",
        "rotation from moment",
        "displacement from acceleration",
        "displacement from spin",
        "displacement from traction",
    } <= set(rom.kinds)
    assert rom.inputs[6:9] == ["gravity.ax", "gravity.ay", "gravity.az"]
    assert rom.outputs[6:] == ["side.ux", "side.uy", "side.uz", "gap.u"]


@pytest.mark.parametrize(
    ("section", "entry", "expected"),
    [
        ("loads", {"type": "weight"}, "type = 'weight' must be one of acceleration"),
        ("loads", {"type": "spin", "point": POINT}, "loads: new: axis is missing"),
        ("loads", {"type": "spin", "point": POINT, "axis": [0, 0, 0]}, "has no direction"),
        ("loads", {"type": "acceleration", "point": POINT}, "acceleration takes no point"),
        ("loads", {"type": "pressure", "nodes": [1]}, "no face of an element"),
        ("loads", {"type": "pressure", "nodes": "nowhere"}, "there is no node set nowhere"),
        ("outputs", {"nodes": "end", "relative_to": "end"}, "are the same"),
        ("outputs", {"nodes": "end", "direction": [0, 0, 0]}, "is none"),
    ],
)
def test_wrong_loads(section: str, entry: Any, expected: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=expected):
        write_body(tmp_path / "body.h5", sided("tetra"), **{section: {"new": entry}})
    assert not (tmp_path / "body.h5").exists()


def test_names_of_ports_are_their_own(tmp_path: Path) -> None:
    write_body(
        tmp_path / "body.h5", sided("tetra"), loads={"end": {"type": "force", "nodes": "side"}}
    )
    result = run(
        "assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5", expect=1
    )
    assert "two ports are named end.fx" in result.err


def test_loads_of_the_command_line(tmp_path: Path) -> None:
    """Of a mesh and of a CalculiX deck with labels of its own: the same columns as of YAML."""
    mesh = sided("tetra10")
    write_body(
        tmp_path / "yaml.h5",
        mesh,
        mass_integration="reduced",
        outputs={"side": OUTPUTS["side"], "spot": {"type": "stress", "nodes": "side"}},
    )
    run("assemble", "-body", tmp_path / "yaml.h5", "-body_out", tmp_path / "yaml.m.h5")
    expected = ports(tmp_path / "yaml.m.h5")
    point, axis = (",".join(map(str, words)) for words in (POINT, AXIS))
    words = [
        "--load",
        "gravity=acceleration",
        "--load",
        f"swing=angular_acceleration:{point}",
        "--load",
        f"turn=spin:{point},{axis}",
        "--load",
        "skin=pressure:BOX:-1,-1,-1,1,1,1",
        "--load",
        "side=pressure:NSET:side",
        "--load",
        "wind=traction:NSET:side",
        "--load",
        "push=force:NSET:side",
        "--measure",
        "side=NSET:side",
        "--measure",
        "spot=stress:NSET:side",
        "--distributing",
        "end=NSET:end",
    ]
    write_deck(tmp_path / "part.inp", "C3D10", mesh=mesh)
    meshio.Mesh(mesh.points, mesh.cells).write(tmp_path / "part.vtu")
    said = run(
        "import", tmp_path / "part.inp", "--assemble", *words, "-o", tmp_path / "deck.h5"
    ).out
    assert "load skin: pressure on" in said and "output spot: stress in the mean of" in said
    run("assemble", "-body", tmp_path / "deck.h5", "-body_out", tmp_path / "deck.m.h5")
    for ours, theirs in zip(ports(tmp_path / "deck.m.h5"), expected, strict=True):
        assert list(ours) == list(theirs)
        for name in ours:
            assert np.allclose(
                ours[name], theirs[name], rtol=1e-9, atol=1e-9 * np.abs(theirs[name]).max()
            ), name
    box_words = [
        word.replace("NSET:side", "BOX:-1,0.015,-1,1,1,1").replace(
            "NSET:end", "BOX:0.09,-1,-1,1,1,1"
        )
        for word in words
    ]
    said = run(
        "import",
        tmp_path / "part.vtu",
        "--material",
        "steel",
        *box_words,
        "-o",
        tmp_path / "vtu.h5",
    ).out
    assert "load gravity: acceleration" in said
    for wrong, what in (
        (["--load", "a=weight"], "expected NAME=TYPE"),
        (["--load", "a=acceleration:NSET:side"], "takes no nodes"),
        (["--load", "a=spin:1,2,3"], "expected 6 finite numbers"),
        (["--load", "a=acceleration", "--load", "a=acceleration"], "given twice"),
        (["--measure", "a=stress"], "a node set is named with"),
    ):
        refused = run(
            "import",
            tmp_path / "part.inp",
            "--assemble",
            "--distributing",
            "end=NSET:end",
            *wrong,
            "-o",
            tmp_path / "x.h5",
            expect=1,
        )
        assert what in refused.err, refused.err
    write_matrices(tmp_path / "K.h5", **chain())
    refused = run(
        "import", tmp_path / "K.mat", "--load", "a=acceleration", "-o", tmp_path / "x.h5", expect=1
    )
    assert "is for bodies that flexgram assembles" in refused.err


@pytest.mark.kernels
def test_kinds_that_are_nothing(tmp_path: Path) -> None:
    """Gravity strains no free body: that kind is left out by name and spoils no other. And where
    all of H is zero there is nothing to reduce."""
    mesh = sided("tetra10")
    write_body(
        tmp_path / "body.h5",
        mesh,
        damping={"alpha": 20.0},
        loads={"gravity": {"type": "acceleration"}},
        outputs={
            "spot": {"type": "stress", "nodes": "side"},
            "gap": {"nodes": "side", "relative_to": "end"},
        },
    )
    result = certified(tmp_path / "body.h5", (100.0, 9000.0), tmp_path, "-mor_tol", "1e-4")
    assert_certified(result, 1e-4, sharp=1000)
    rom = ReducedModel.load(result["path"])
    assert "stress from acceleration" not in rom.kinds and "stress from force" in rom.kinds
    assert any(
        "stress from acceleration" in value for name, value in rom.log["plan"] if name == "skipped"
    )
    band = ("-mor_band_hz", "100,9000", "-mor_out", tmp_path / "none.h5")
    refused = run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_inputs",
        "gravity",
        "-mor_outputs",
        "gap",
        *band,
        expect=1,
    )
    assert "these inputs move none of these outputs" in refused.err
    refused = run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_inputs",
        "gravity",
        "-mor_tol_relative_to",
        "elastic",
        *band,
        expect=1,
    )
    assert "H has no elastic part" in refused.err


@pytest.mark.kernels
def test_every_pair_of_kinds_is_claimed(tmp_path: Path) -> None:
    """Moments alone on the input: displacements and stresses from them are kinds of their own."""
    write_body(
        tmp_path / "body.h5",
        sided("tetra10"),
        loads={},
        damping={"alpha": 20.0},
        outputs={"spot": {"type": "stress", "nodes": "side"}},
        supports={"start": {"nodes": "start"}},
    )
    result = certified(
        tmp_path / "body.h5",
        (100.0, 6000.0),
        tmp_path,
        "-mor_tol",
        "1e-3",
        "-mor_inputs",
        "end.mx,end.my,end.mz",
        "-mor_outputs",
        "spot,end.fx,end.fy,end.fz",
        full=chosen(tmp_path / "body.h5"),
    )
    assert_certified(result, 1e-3)
    rom = ReducedModel.load(result["path"])
    assert sorted(rom.kinds) == ["displacement from moment", "stress from moment"]


def chosen(path: Path) -> Any:
    """The body with moments as inputs, stresses and displacements as outputs."""
    full = body_system(path)
    B, C = ports(path.with_name(path.stem + ".assembled.h5"))
    outputs = [name for name in C if name.startswith("spot")] + ["end.fx", "end.fy", "end.fz"]
    full.B = np.array([B[f"end.m{axis}"] for axis in "xyz"]).T
    full.C = np.array([C[name] for name in outputs])
    return full
