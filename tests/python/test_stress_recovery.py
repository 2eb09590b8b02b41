"""Stress of mesh bodies: patch tests, energy, CalculiX, and what is claimed of it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from test_importers import write_deck
from test_mesh_loads import KINDS, ports, sided, write_body

from bodies import CALCULIX, FORMULATIONS, box
from conftest import assembled, assert_certified, certified, run
from flexgram import BodyError, ReducedModel
from flexgram.body.strain import stress_operator
from flexgram.body.stress import COMPONENTS, Stresses, signed_von_mises, von_mises
from flexgram.model.recovery import stress_peaks

LAW = (
    210e9
    / 1.3
    * (
        np.diag([1.0, 1, 1, 0.5, 0.5, 0.5])
        + 0.3 / 0.4 * np.outer([1, 1, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0])
    )
)


def field(body: dict[str, Any], vectors: Any) -> Any:
    return vectors[np.arange(len(vectors)), body["component"]]


def at_nodes(a: dict[str, Any], u: Any, count: int) -> Any:
    """Displacements of rows as (N, 3)."""
    there = np.zeros((count, 3))
    there[a["node"], a["component"]] = u
    return there


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_uniform_strain_and_energy(kind: str, ranks: int, tmp_path: Path) -> None:
    """A linear field has one stress everywhere, in recovery and in outputs; and of any field the
    stress does the work that K says."""
    mesh = sided(kind)
    write_body(
        tmp_path / "body.h5", mesh, loads={}, outputs={"spot": {"type": "stress", "nodes": "side"}}
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    _, C = ports(tmp_path / "matrices.h5")
    A = 1e-4 * np.random.default_rng(2).standard_normal((3, 3))
    e = 0.5 * (A + A.T)
    expected = LAW @ np.array([e[0, 0], e[1, 1], e[2, 2], 2 * e[0, 1], 2 * e[1, 2], 2 * e[2, 0]])
    u = field(a, a["position"] @ A.T)
    stresses = Stresses.load(tmp_path / "body.h5")
    found = stresses.nodal(at_nodes(a, u, len(mesh.points))[None])[0]
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    spot = [C[f"spot.s{pair}"] @ u for pair in COMPONENTS]
    assert np.allclose(spot, expected, rtol=1e-9)
    # Any displacements.
    u = np.random.default_rng(3).standard_normal(len(u))
    there, energy = at_nodes(a, u, len(mesh.points)), 0.0
    for element, nodes, law, *_ in stresses.blocks:
        stress, strain, volume = stress_operator(element, mesh.points[nodes], law)
        moved = there[nodes].reshape(len(nodes), -1)
        energy += np.einsum(
            "eqib,eb,eqic,ec,eq->", stress, moved, strain, moved, volume, optimize=True
        )
    assert energy == pytest.approx(u @ a["K"] @ u, rel=1e-10)
    # Recovery and outputs are one.
    whole = stresses.nodal(there[None])[0][mesh.point_sets["side"]].mean(axis=0)
    assert np.allclose([C[f"spot.s{pair}"] @ u for pair in COMPONENTS], whole, rtol=1e-9)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D15", "C3D20", "C3D6", "C3D8", "C3D20R"])
def test_stresses_of_calculix(element: str, tmp_path: Path) -> None:
    """At the points of integration and at nodes, under gravity, to the digits that ccx prints:
    seven, and six at nodes, where those of C3D20 come of coefficients that it has to five."""
    mesh = sided(CALCULIX[element])
    extra = (
        "*BOUNDARY\nSTART, 1, 3\n*STEP\n*STATIC\n*DLOAD\nEALL, GRAV, 9810, 0, 0, 1\n"
        "*EL PRINT, ELSET=EALL\nS\n*EL FILE\nS\n*END STEP\n"
    )
    deck = write_deck(tmp_path / "box.inp", element, extra, mesh=mesh)
    subprocess.run(["ccx", deck.stem], cwd=tmp_path, capture_output=True, check=True)
    theirs: dict[int, list[list[float]]] = {}
    for line in deck.with_suffix(".dat").read_text().splitlines():
        words = line.split()
        if len(words) == 8 and words[0].isdigit():
            xx, yy, zz, xy, xz, yz = map(float, words[2:])
            theirs.setdefault(int(words[0]) - 1, []).append([xx, yy, zz, xy, yz, xz])
    write_body(
        tmp_path / "body.h5",
        mesh,
        regions={"all": {"material": "steel", **FORMULATIONS.get(element, {})}},
        mass_integration="reduced",
        outputs={},
        supports={"start": {"nodes": "start"}},
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    B, _ = ports(tmp_path / "matrices.h5")
    there = at_nodes(a, spsolve(a["K"].tocsc(), 9810 * B["gravity.az"]), len(mesh.points))
    kind, nodes, law, *_ = Stresses.load(tmp_path / "body.h5").blocks[0]
    stress = np.einsum(
        "eqib,eb->eqi",
        stress_operator(kind, mesh.points[nodes], law)[0],
        there[nodes].reshape(len(nodes), -1),
    )
    printed = np.array([theirs[e] for e in range(len(nodes))])
    scale = np.abs(printed).max()
    for ours, other in zip(stress, printed, strict=True):  # the points in any order
        apart = np.abs(ours[:, None] - other[None]).max(axis=2)
        assert apart.min(axis=1).max() < 3e-6 * scale and apart.min(axis=0).max() < 3e-6 * scale
    nodal = Stresses.load(tmp_path / "body.h5").nodal(there[None])[0]
    at, stresses_follow = {}, False
    for line in deck.with_suffix(".frd").read_text().splitlines():
        if line.startswith(" -4"):
            stresses_follow = "STRESS" in line
        elif stresses_follow and line.startswith(" -1"):
            at[int(line[3:13]) - 10] = [float(line[k : k + 12]) for k in range(13, 85, 12)]
    theirs_at = np.array([at[node] for node in range(len(mesh.points))])
    off = np.abs(nodal - theirs_at).max() / np.abs(theirs_at).max()
    if element == "C3D6":
        return  # ccx gives nodes 1, 3, 5 one stress, and 2, 4, 6 another
    assert off < (1e-5 if element in ("C3D4", "C3D10", "C3D15") else 5e-5)


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
def test_stress_is_certified(ranks: int, tmp_path: Path) -> None:
    mesh = sided("tetra10", counts=(6, 3, 3))
    spot = int(mesh.point_sets["side"][0]) + 1
    write_body(
        tmp_path / "body.h5",
        mesh,
        damping={"alpha": 20.0, "beta": 1e-6},
        loads={"gas": {"type": "pressure", "nodes": "side"}},
        outputs={"spot": {"type": "stress", "nodes": [spot]}},
        supports={"start": {"nodes": "start"}},
    )
    result = certified(
        tmp_path / "body.h5", (100.0, 6000.0), tmp_path, "-mor_tol", "1e-3", ranks=ranks
    )
    assert_certified(result, 1e-3)
    rom = ReducedModel.load(result["path"])
    assert {"stress from force", "stress from pressure", "displacement from force"} <= set(
        rom.kinds
    )
    # The field of stress at that node is the certified output.
    q = np.random.default_rng(4).standard_normal((3, rom.order))
    rows = [rom.outputs.index(f"spot.s{pair}") for pair in COMPONENTS]
    stress = rom.stress(q, tmp_path / "body.h5")
    assert np.allclose(stress[:, spot - 1], q @ rom.C[rows].T, rtol=1e-8)
    assert np.allclose(von_mises([[3.0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0]]), [3, np.sqrt(3)])


def test_where_there_is_no_stress(tmp_path: Path) -> None:
    """Inside rigid interfaces, and in bodies of matrices."""
    mesh = sided("tetra")
    rigid = {"end": {"coupling": "rigid", "nodes": "side"}}
    whole = {"end": {"coupling": "rigid", "nodes": "all"}}
    spot = {"spot": {"type": "stress", "nodes": "side"}}
    write_body(tmp_path / "body.h5", mesh, interfaces=rigid, loads={}, outputs=spot)
    with pytest.raises(BodyError, match="outputs: spot: the body has no solids that deform"):
        write_body(tmp_path / "other.h5", mesh, interfaces=whole, loads={}, outputs=spot)
    with pytest.raises(BodyError, match="stress takes no direction"):
        write_body(
            tmp_path / "other.h5",
            mesh,
            loads={},
            outputs={"spot": {**spot["spot"], "direction": [1, 0, 0]}},
        )
    run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "matrices.h5")
    with pytest.raises(BodyError, match="only bodies that flexgram assembles"):
        Stresses.load(tmp_path / "matrices.h5")


def test_stress_over_time(tmp_path: Path) -> None:
    """The command line: pictures, and where the largest stress is. A bar that is pulled slowly."""
    mesh = box("hexahedron20", (6, 2, 2), (0.1, 0.02, 0.03), distort=False)
    write_body(
        tmp_path / "body.h5",
        mesh,
        outputs={},
        damping={"alpha": 2e3},
        materials={"steel": {"E": 210e9, "nu": 0.0, "rho": 7850.0}},
        loads={"pull": {"type": "traction", "nodes": "end"}},
        supports={"start": {"nodes": "start"}},
    )
    rom = tmp_path / "rom.h5"
    run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_band_hz",
        "0,8000",
        "-mor_tol",
        "1e-4",
        "-mor_statics",
        "yes",
        "-mor_out",
        rom,
    )
    said = run(
        "simulate",
        rom,
        "--force",
        "pull.tx=1e7*(1-exp(-(t/2e-3)**2))",
        "--time",
        "0,0.02,201",
        "--stress",
        "--xdmf",
        tmp_path / "pull.xdmf",
        "-o",
        tmp_path / "y.csv",
    ).out
    assert "largest von Mises stress" in said and "node" in said and "of places in tension" in said
    model = ReducedModel.load(rom)
    q = np.random.default_rng(8).standard_normal((5, model.order))
    u = np.zeros((5, len(model.inputs)))
    peaks = stress_peaks(model, q, u, tmp_path / "body.h5")
    signed = signed_von_mises(model.stress(q, tmp_path / "body.h5"))
    for peak, of, value in (
        (peaks.von_mises, np.abs(signed), np.nanmax(np.abs(signed))),
        (peaks.tension, signed, np.nanmax(signed)),
        (peaks.pressure, signed, np.nanmin(signed)),
    ):
        assert peak.value == pytest.approx(value, rel=1e-12)
        assert of[peak.when, peak.where] == pytest.approx(value, rel=1e-12)
    q = np.linalg.solve(model.K, model.B[:, model.inputs.index("pull.tx")] * 1e7)
    field = model.stress(q, tmp_path / "body.h5")[0]
    expected = np.array([1e7, 0, 0, 0, 0, 0])
    assert np.abs(field - expected).max() < 2e4 and np.allclose(von_mises(field), 1e7, rtol=2e-3)
    run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_band_hz",
        "0,8000",
        "-mor_tol",
        "1e-4",
        "-mor_out",
        tmp_path / "no.h5",
    )
    without = ReducedModel.load(tmp_path / "no.h5")
    q = np.linalg.solve(without.K, without.B[:, without.inputs.index("pull.tx")] * 1e7)
    assert np.abs(without.stress(q)[0] - expected).max() > 5e6  # why the statics are there
    mesh_over_time = meshio.xdmf.TimeSeriesReader(tmp_path / "pull.xdmf")
    mesh_over_time.read_points_cells()
    _, data, _ = mesh_over_time.read_data(mesh_over_time.num_steps - 1)
    assert np.allclose(data["von_mises"], 1e7, rtol=5e-3)
    run("export", rom, "--to", "vtu", "--stress", "-o", tmp_path / "shapes.vtu")
    shapes = meshio.read(tmp_path / "shapes.vtu")
    assert np.allclose(shapes.point_data["sigma_001"], model.stress()[0])
    history = tmp_path / "pull.csv"
    history.write_text("t,pull.tx\n0,0\n0.004,2e7\n0.02,2e7\n")
    run("report", rom, "--loads", history, "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Largest von Mises stress" in page and "Nothing is claimed of it" in page
    refused = run("export", rom, "--to", "npz", "--stress", "-o", tmp_path / "x.npz", expect=1)
    assert "--stress belongs to" in refused.err


def test_whose_stress_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file that is named, as it is now; nodes named once; paths may be relative."""
    monkeypatch.chdir(tmp_path)
    mesh = sided("tetra10")
    given = {"loads": {}, "supports": {"start": {"nodes": "start"}}, "damping": {"alpha": 20.0}}
    spot = {"spot": {"type": "stress", "nodes": [3, 5]}}
    write_body(Path("body.h5"), mesh, outputs=spot, **given)
    for wrong, what in (([3, 5, 3], "a node is named twice"), ([10**6], "node numbers run from")):
        with pytest.raises(BodyError, match=what):
            write_body(
                Path("wrong.h5"),
                mesh,
                outputs={"spot": {"type": "stress", "nodes": wrong}},
                **given,
            )
    run("reduce", "-body", "body.h5", "-mor_band_hz", "100,3000", "-mor_out", "rom.h5")
    rom = ReducedModel.load("rom.h5")
    run(
        "simulate",
        "rom.h5",
        "--force",
        "end.fx=sin(t)",
        "--time",
        "0,0.01,11",
        "--stress",
        "--xdmf",
        "m.xdmf",
        "-o",
        "y.csv",
    )
    q = np.ones((1, rom.order))
    before = rom.stress(q)
    rom.stress()[:] = 0
    assert np.array_equal(rom.stress(q), before, equal_nan=True)
    soft = {"steel": {"E": 105e9, "nu": 0.3, "rho": 7850.0}}
    write_body(Path("soft.h5"), mesh, outputs={}, materials=soft, **given)
    assert np.allclose(rom.stress(q, "soft.h5"), 0.5 * before, equal_nan=True)
    with pytest.raises(BodyError, match="expected real rows"):
        rom.stress(1j * q)
