"""Strain gauges, stresses at points of integration, and outputs of imported matrices by their
deck."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from test_importers import FREQUENCY, ccx, write_deck
from test_mesh_loads import KINDS, ports, sided, write_body
from test_stress_recovery import LAW, field

from bodies import CALCULIX, box
from conftest import assembled, assert_certified, body_system, certified, message, run
from flexgram import BodyError, ReducedModel
from flexgram.body.stress import COMPONENTS
from flexgram.importers import import_matrices, parse, read
from flexgram.importers.mesh import describe_output


def strained(seed: int) -> tuple[Any, Any]:
    """A displacement gradient, and its strain with engineering shears."""
    A = 1e-4 * np.random.default_rng(seed).standard_normal((3, 3))
    e = 0.5 * (A + A.T)
    return A, np.array([*np.diag(e), 2 * e[0, 1], 2 * e[1, 2], 2 * e[2, 0]])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_gauges_and_points_of_a_linear_field(kind: str, ranks: int, tmp_path: Path) -> None:
    mesh = sided(kind)
    direction, normal = np.array([2.0, -1.0, 0.5]), np.array([0.0, 3.0, 1.0])
    write_body(
        tmp_path / "body.h5",
        mesh,
        loads={},
        outputs={
            "g": {"type": "gauge", "nodes": "side", "direction": direction.tolist()},
            "r": {
                **{"type": "gauge", "nodes": [1], "direction": direction.tolist()},
                "normal": normal.tolist(),
            },
            "all": {"type": "stress", "elements": [1, 3]},
            "one": {"type": "stress", "elements": 2, "integration_point": 1},
        },
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    _, C = ports(tmp_path / "matrices.h5")
    A, e = strained(7)
    tensor = 0.5 * (A + A.T)
    u = field(a, a["position"] @ A.T)
    along = direction / np.linalg.norm(direction)
    assert C["g.e"] @ u == pytest.approx(along @ tensor @ along, rel=1e-9)
    n = normal / np.linalg.norm(normal)
    first = along - n * (n @ along)
    first /= np.linalg.norm(first)
    third = np.cross(n, first)
    for name, d in (("e0", first), ("e45", (first + third) / np.sqrt(2)), ("e90", third)):
        assert C[f"r.{name}"] @ u == pytest.approx(d @ tensor @ d, rel=1e-9)
    for name in ("all", "one"):
        found = [C[f"{name}.s{pair}"] @ u for pair in COMPONENTS]
        assert np.allclose(found, LAW @ e, rtol=1e-9)


def test_a_point_of_a_body_that_is_free_to_grow(tmp_path: Path) -> None:
    """The stress at a point of integration has no heat in it: C u and the feedthrough cancel."""
    mesh = sided("hexahedron")
    write_body(
        tmp_path / "body.h5",
        mesh,
        materials={"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0, "expansion": 1.2e-5}},
        loads={"warm": {"type": "temperature", "nodes": "all"}},
        outputs={
            "p": {"type": "stress", "elements": [2], "integration_point": 3},
            "g": {"type": "gauge", "nodes": [1], "direction": [0, 1, 0]},
        },
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    _, C = ports(tmp_path / "matrices.h5")
    u = field(a, 1.2e-5 * a["position"])
    with h5py.File(tmp_path / "matrices.h5") as file:
        F, names = file["feedthrough"][:], list(file["C"].attrs["names"])
        if F.shape[0] != len(names):
            F = F.T
    stress = np.array([C[f"p.s{pair}"] @ u for pair in COMPONENTS])
    at_once = np.array([F[names.index(f"p.s{pair}")].sum() for pair in COMPONENTS])
    assert np.abs(stress).max() > 1e6
    assert np.abs(stress + at_once).max() < 1e-8 * np.abs(stress).max()
    assert C["g.e"] @ u == pytest.approx(1.2e-5, rel=1e-9)  # a gauge shows the growth


@pytest.mark.parametrize("ranks", [1, 2])
def test_gauges_are_certified(ranks: int, tmp_path: Path) -> None:
    mesh = sided("tetra10", counts=(6, 3, 3))
    spot = int(mesh.point_sets["side"][0]) + 1
    write_body(
        tmp_path / "body.h5",
        mesh,
        damping={"alpha": 20.0, "beta": 1e-6},
        loads={"gas": {"type": "pressure", "nodes": "side"}},
        outputs={
            "r": {"type": "gauge", "nodes": [spot], "direction": [1, 0, 0], "normal": [0, 1, 0]},
            "p": {"type": "stress", "elements": [5], "integration_point": 2},
        },
        supports={"start": {"nodes": "start"}},
    )
    options = ("-mor_tol", "1e-3", "-mor_tol_kind", "strain=1e-4")
    result = certified(tmp_path / "body.h5", (100.0, 6000.0), tmp_path, *options, ranks=ranks)
    assert_certified(result, 1e-3)
    rom = ReducedModel.load(result["path"])
    assert {"strain from force", "strain from pressure", "stress from force"} <= set(rom.kinds)
    full = body_system(tmp_path / "body.h5")
    rows = [rom.outputs.index(f"r.{e}") for e in ("e0", "e45", "e90")]
    inputs = [i for i, name in enumerate(rom.inputs) if name == "gas.p"]
    claim = rom.by_kind[rom.kinds.index("strain from pressure")]
    assert claim <= 1e-4
    for hertz in (333.0, 1234.0, 5678.0):
        H, H_r = (m.transfer(2 * np.pi * hertz)[np.ix_(rows, inputs)] for m in (full, rom))
        assert np.linalg.norm(H - H_r) <= claim * np.linalg.norm(H)


def test_wrong_gauges(tmp_path: Path) -> None:
    mesh = sided("tetra")
    for entry, said in (
        ({"type": "gauge", "nodes": [1]}, "direction"),
        (
            {"type": "gauge", "nodes": [1], "direction": [0, 0, 2], "normal": [0, 0, 1]},
            "direction in the surface has no length",
        ),
        ({"type": "gauge", "nodes": [1], "direction": [0, 0, 0]}, "direction has no length"),
        ({"type": "stress", "nodes": [1], "elements": [1]}, "name nodes or elements"),
        ({"type": "stress"}, "name nodes or elements"),
        ({"type": "stress", "nodes": [1], "integration_point": 1}, "no integration_point"),
        ({"type": "stress", "elements": [1], "integration_point": 9}, "points 1 to"),
        ({"type": "stress", "elements": [123456]}, "no element 123456"),
        ({"type": "stress", "elements": ["a"]}, "expected whole numbers"),
        ({"type": "stress", "nodes": [1], "normal": [1, 0, 0]}, "stress takes no normal"),
    ):
        with pytest.raises(BodyError, match=said):
            write_body(tmp_path / "body.h5", mesh, loads={}, outputs={"x": entry})


@pytest.mark.parametrize(
    "words", ["x=stress:ELEMENTS:5@", "x=stress:ELEMENTS:5@1,2", "x=stress:ELEMENTS:a"]
)
def test_wrong_elements_of_the_command_line(words: str) -> None:
    with pytest.raises(BodyError, match="expected numbers of elements and one point"):
        describe_output(words)


def results_at_nodes(frd: Path, what: str) -> dict[int, list[float]]:
    """A block of CalculiX' results: STRESS or TOSTRAIN."""
    found, follows = {}, False
    for line in frd.read_text().splitlines():
        if line.startswith(" -4"):
            follows = line.split()[1] == what
        elif follows and line.startswith(" -1"):
            found[int(line[3:13])] = [float(line[k : k + 12]) for k in range(13, 85, 12)]
    return found


@ccx
@pytest.mark.parametrize("units", ["SI", "mm-t-s"])
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D20", "C3D8I", "C3D8", "C3D20R"])
def test_outputs_of_imported_matrices(element: str, units: str, tmp_path: Path) -> None:
    """Stress at a node and at a point, strain, and displacement of K and M that ccx wrote, against
    what ccx says of the same forces: six digits at nodes, seven at points."""
    mesh = box(CALCULIX[element], (4, 2, 2), distort=element != "C3D8I")
    held = "*BOUNDARY\nSTART, 1, 3\n"
    push = "".join(f"{n + 10}, 2, {3.0 + n}\n" for n in mesh.point_sets["end"])
    static = (
        f"{held}*STEP\n*STATIC\n*CLOAD\n{push}*EL PRINT, ELSET=EALL\nS\n*EL FILE\nS, E\n"
        "*NODE FILE\nU\n*END STEP\n"
    )
    write_deck(tmp_path / "static.inp", element, static, mesh=mesh)
    subprocess.run(["ccx", "static"], cwd=tmp_path, capture_output=True, check=True)
    deck = write_deck(tmp_path / "box.inp", element, held + FREQUENCY, mesh=mesh)
    spot = int(mesh.point_sets["side" if "side" in mesh.point_sets else "end"][0]) + 10
    words = {
        "s": f"stress:NODES:{spot}",
        "g": f"gauge:1,0,0:NODES:{spot}",
        "u": f"NODES:{spot}",
        **{f"p{k}": f"stress:ELEMENTS:3@{k}" for k in range(1, 5) if element == "C3D10"},
    }
    run(
        *("import", deck, "--run-ccx", "--node", "end=NSET:END", "--units", units),
        *(word for name, where in words.items() for word in ("--measure", f"{name}={where}")),
        *("-o", tmp_path / "body.h5"),
    )
    a = body_system(tmp_path / "body.h5")
    with h5py.File(tmp_path / "body.h5") as file:
        names, inputs = list(file["C"].attrs["names"]), list(file["B"].attrs["names"])
    force = np.zeros(len(inputs))
    for n in mesh.point_sets["end"]:
        force[inputs.index(f"end-{n + 10}.fy")] = 3.0 + n
    u = spsolve(a.K.tocsc() if hasattr(a.K, "tocsc") else a.K, a.B @ force)
    y = dict(zip(names, np.asarray(a.C @ u).ravel(), strict=True))
    length, stress_unit = (1.0, 1.0) if units == "SI" else (1e-3, 1e6)
    frd = tmp_path / "static.frd"
    xx, yy, zz, xy, yz, zx = results_at_nodes(frd, "STRESS")[spot]
    scale = np.abs(list(results_at_nodes(frd, "STRESS").values())).max()
    ours = np.array([y[f"s.s{pair}"] for pair in COMPONENTS]) / stress_unit
    assert np.abs(ours - [xx, yy, zz, xy, yz, zx]).max() < 5e-5 * scale
    strains = results_at_nodes(frd, "TOSTRAIN")
    assert abs(y["g.e"] - strains[spot][0]) < 5e-5 * np.abs(list(strains.values())).max()
    moved = np.array(
        [
            [float(line[k : k + 12]) for k in range(13, 49, 12)]
            for line in frd.read_text().partition("DISP")[2].partition(" -3")[0].splitlines()
            if line.startswith(" -1") and int(line[3:13]) == spot
        ]
    )[0]
    assert np.allclose([y[f"u.u{c}"] / length for c in "xyz"], moved, rtol=2e-5, atol=1e-15)
    if element == "C3D10":
        printed = []
        for line in (tmp_path / "static.dat").read_text().splitlines():
            fields = line.split()
            if len(fields) == 8 and fields[0] == "3":
                xx, yy, zz, xy, xz, yz = map(float, fields[2:])
                printed.append([xx, yy, zz, xy, yz, xz])
        found = np.array([[y[f"p{k}.s{c}"] for c in COMPONENTS] for k in range(1, 5)]) / stress_unit
        apart = np.abs(found[:, None] - np.array(printed)[None]).max(axis=2)
        assert apart.min(axis=1).max() < 3e-6 * scale and apart.min(axis=0).max() < 3e-6 * scale


@ccx
def test_imported_outputs_beside_a_rigid_interface(tmp_path: Path) -> None:
    """What follows a reference node moves with it: the same outputs as of the deck assembled here,
    reduced and certified."""
    deck = write_deck(tmp_path / "box.inp", "C3D10", "*BOUNDARY\nSTART, 1, 3\n" + FREQUENCY)
    options = ("--rigid", "end=NSET:END", "--measure", "s=stress:NODES:40", "--beta", "1e-6")
    H = []
    for name, how in (("ccx", "--run-ccx"), ("own", "--assemble")):
        run("import", deck, how, *options, "-o", tmp_path / f"{name}.h5")
        out = tmp_path / f"{name}.rom.h5"
        band = ("-mor_band_hz", "10,2000", "-mor_tol", "1e-8")
        run("reduce", "-body", tmp_path / f"{name}.h5", *band, "-mor_out", out)
        rom = ReducedModel.load(out)
        assert "stress from force" in rom.kinds
        assert rom.outputs[6:] == [f"s.s{pair}" for pair in COMPONENTS]
        H.append(rom.transfer(2 * np.pi * 700.0))
    for rows in (slice(0, 6), slice(6, 12)):
        assert np.linalg.norm(H[0][rows] - H[1][rows]) < 1e-6 * np.linalg.norm(H[1][rows])


@ccx
def test_displacements_need_rows_alone(tmp_path: Path) -> None:
    """Of shells, whose nodes ccx expands; of materials that are not read; of supports in another
    step: a mean displacement is weights of rows."""
    from test_calculix import shell_plate

    plate = shell_plate(tmp_path / "plate.inp", "S8R", "*BOUNDARY\nLEFT, 1, 6\n" + FREQUENCY)
    common = ("--node", "edge=AT:0.8,0,0", "-o", tmp_path / "body.h5")
    run("import", plate, "--run-ccx", *common, "--measure", "u=AT:0.8,0.2,0")
    a = body_system(tmp_path / "body.h5")
    rows = np.asarray(a.C)[-3:]
    assert np.allclose(rows.sum(axis=1), 1) and (np.abs(rows) > 0).sum() >= 6
    solid = write_deck(
        tmp_path / "two.inp",
        "C3D10",
        "*STEP\n*STATIC\n*BOUNDARY\nSTART, 1, 3\n*END STEP\n*STEP, PERTURBATION\n*FREQUENCY\n5\n"
        "*END STEP\n",
    )
    common = ("--node", "end=NSET:END", "-o", tmp_path / "body.h5")
    run("import", solid, "--run-ccx", *common, "--measure", "s=stress:NODES:10")
    (tmp_path / "turned.inp").write_text(
        solid.read_text().replace(
            "*STEP\n*STATIC",
            "*TRANSFORM, NSET=START\n0.8, 0.6, 0., -0.6, 0.8, 0.\n*STEP\n*STATIC",
            1,
        )
    )
    failed = run(
        *("import", tmp_path / "turned.inp", "--run-ccx", *common),
        *("--measure", "s=stress:NODES:10"),
        expect=1,
    )
    assert "*TRANSFORM" in message(failed)


@ccx
def test_what_has_no_imported_outputs(tmp_path: Path) -> None:
    deck = write_deck(tmp_path / "box.inp", "C3D20R", FREQUENCY)
    common = ("--node", "end=NSET:END", "-o", tmp_path / "body.h5")
    failed = run("import", deck, "--run-ccx", *common, "--measure", "s=reaction:NODES:40", expect=1)
    assert "--assemble" in message(failed)
    tied = "*EQUATION\n2\n40,1,1.,41,1,-1.\n*BOUNDARY\nSTART, 1, 3\n"
    deck = write_deck(tmp_path / "tied.inp", "C3D10", tied + FREQUENCY)
    failed = run("import", deck, "--run-ccx", *common, "--measure", "s=stress:NODES:40", expect=1)
    assert "node 40 has no row for x" in message(failed)
    fe = read(write_deck(tmp_path / "plain.inp", "C3D10", FREQUENCY), run_ccx=True)
    fe.deck = None
    with pytest.raises(BodyError, match="elements and materials of a CalculiX deck"):
        import_matrices(
            fe,
            tmp_path / "body.h5",
            [parse("node", "end=NSET:END")],
            outputs={"s": {"type": "stress", "nodes": [40]}},
        )


def test_stress_of_some_shells_on_the_command_line() -> None:
    """Around a node where walls meet: the elements behind a stroke."""
    name, entry = describe_output("weld=stress/top:NODES:231/ELEMENTS:220,221")
    assert name == "weld" and entry["elements"] == [220, 221]
    assert entry == {"type": "stress", "side": "top", "elements": [220, 221], "nodes": [231]}
    with pytest.raises(BodyError, match="expected numbers of elements: NODES:7/ELEMENTS:5,6"):
        describe_output("weld=stress/top:NODES:231/ELEMENTS:wall")
