"""Stress of a whole body of shells: on its sides, over time, in files, EXUDYN and the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from test_exudyn import swing
from test_shells import SIX, STEEL, write

import flexgram
from bodies import box
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.body.description import import_description
from flexgram.body.stress import von_mises
from flexgram.model.recovery import stress_peaks
from flexgram.pictures.report import write_report
from sheets import flat, sheet

S = ("sxx", "syy", "szz", "sxy", "syz", "szx")
CLAMP = {"clamp": {"nodes": "start", "components": SIX}}
WARM = {**STEEL, "expansion": 1.2e-5}


def channel(kind: str) -> meshio.Mesh:
    """A strip whose half is bent upwards, a fold in its middle."""
    mesh = sheet(kind, (10, 8), flat(0.4, 0.16))
    x, y = mesh.points[:, 0], mesh.points[:, 1] - 0.08
    across = np.abs(y) < 1e-9
    mesh.points = np.column_stack([x, np.where(y > 0, 0, y), np.where(y > 0, y, 0)])
    mesh.point_sets["fold"] = np.flatnonzero(across)
    return mesh


def reduced(folder: Path, mesh: meshio.Mesh, outputs: Any, **more: Any) -> ReducedModel:
    end = int(mesh.point_sets["end"][2]) + 1
    given: dict[str, Any] = {
        "supports": CLAMP,
        "damping": {"beta": 1e-5},
        "interfaces": {"tip": {"coupling": "node", "nodes": [end]}},
        "outputs": outputs,
    }
    write(folder / "b.h5", mesh, {"thickness": 0.003}, WARM, **(given | more))
    run("reduce", "-body", folder / "b.h5", "-mor_band_hz", "0,300", "-mor_tol", "1e-5",
        "-mor_out", folder / "r.h5")  # fmt: skip
    return ReducedModel.load(folder / "r.h5")


def expected(rom: ReducedModel, name: str, q: Any, u: Any) -> Any:
    """(k, 6) of an output of the body."""
    rows = np.zeros((len(q), 6))
    for c, part in enumerate(S):
        if f"{name}.{part}" in rom.outputs:
            at = rom.outputs.index(f"{name}.{part}")
            rows[:, c] = q @ rom.C[at] + u @ rom.feedthrough[at]
    return rows


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_against_outputs(kind: str, tmp_path: Path) -> None:
    """At nodes of one sheet the field is that of the outputs, heat included, on each side; on the
    fold that of the wall with the larger stress."""
    mesh = channel(kind)
    inner = int(mesh.point_sets["middle"][0]) - 3
    fold = int(mesh.point_sets["fold"][4])
    cells = mesh.cells[0].data
    flat_wall = np.all(mesh.points[cells][:, :, 2] < 1e-9, axis=1)
    around = np.any(cells == fold, axis=1)
    walls = [(np.flatnonzero(around & wall) + 1).tolist() for wall in (flat_wall, ~flat_wall)]
    outputs: dict[str, Any] = {
        side: {"type": "stress", "nodes": [inner + 1], "side": side}
        for side in ("top", "middle", "bottom")
    }
    for k, wall in enumerate(walls):
        outputs[f"wall{k}"] = {
            "type": "stress",
            "nodes": [fold + 1],
            "elements": wall,
            "side": "top",
        }
    rom = reduced(
        tmp_path, mesh, outputs,
        loads={"warm": {"type": "temperature", "nodes": "all"},
               "slope": {"type": "temperature_gradient", "nodes": "end"}},
    )  # fmt: skip
    rng = np.random.default_rng(3)
    q = rng.standard_normal((4, rom.order)) * 1e-3
    u = rng.standard_normal((4, len(rom.inputs))) * 10
    for side in ("top", "middle", "bottom"):
        field = rom.stress(q, u=u, side=side)
        assert field.shape == (4, len(mesh.points), 6)
        wanted = expected(rom, side, q, u)
        np.testing.assert_allclose(field[:, inner], wanted, atol=1e-9 * np.abs(wanted).max())
    both = np.array([expected(rom, f"wall{k}", q, u) for k in range(2)])
    larger = both[von_mises(both).argmax(axis=0), np.arange(4)]
    top = rom.stress(q, u=u, side="top")[:, fold]
    np.testing.assert_allclose(top, larger, atol=1e-9 * np.abs(larger).max())
    sides = [von_mises(rom.stress(q, u=u, side=side)) for side in ("top", "bottom")]
    largest = von_mises(rom.stress(q, u=u, side="larger"))
    np.testing.assert_allclose(largest, np.maximum(*sides), rtol=1e-12)
    peak = stress_peaks(rom, q, u).von_mises
    where = np.unravel_index(np.argmax(sides), (2, 4, len(mesh.points)))
    assert (peak.side, peak.when, peak.where) == (("top", "bottom")[where[0]], *where[1:])
    assert peak.value == pytest.approx(np.max(sides), rel=1e-12)
    # A combination of basis vectors is that of their stresses, also on the fold.
    basis = rom.stress(side="top")
    assert basis.shape == (rom.order, len(mesh.points), 6)
    with pytest.raises(BodyError, match=r"warm\.T, slope\.Tn strains the body: give the inputs u"):
        rom.stress(q, side="top")
    with pytest.raises(BodyError, match="name the side of the shells: top, middle or bottom"):
        rom.stress(q)
    with pytest.raises(BodyError, match="side 'left': there are top, middle, bottom"):
        rom.stress(q, u=u, side="left")


def test_over_time_and_in_files(tmp_path: Path) -> None:
    """`simulate --stress --xdmf` names the side, the report draws it; basis vectors go to VTU."""
    mesh = channel("quad")
    rom = reduced(tmp_path, mesh, {})
    said = run(
        *("simulate", tmp_path / "r.h5", "--force", "tip.fz=20*sin(300*t)", "--time", "0,0.05,26"),
        *("--xdmf", tmp_path / "m.xdmf", "--stress", "-o", tmp_path / "y.csv"),
    )
    line = next(line for line in said.out.splitlines() if "largest von Mises stress" in line)
    assert "top side" in line or "bottom side" in line
    with meshio.xdmf.TimeSeriesReader(tmp_path / "m.xdmf") as reader:
        reader.read_points_cells()
        data = [reader.read_data(k)[1] for k in range(reader.num_steps)]
    mises = np.array([d["von_mises"].ravel() for d in data])
    assert f"{1e-6 * mises.max():.4g} MPa" in line
    for k in (0, 7, 25):
        of_sides = [von_mises(data[k][f"stress_{side}"]) for side in ("top", "bottom")]
        np.testing.assert_allclose(mises[k], np.maximum(*of_sides), rtol=1e-10)
    assert "m.xdmf: 26 moments" in said.out
    run(
        *("simulate", tmp_path / "r.h5", "--force", "tip.fz=20*sin(300*t)", "--time", "0,0.05,26"),
        *("--xdmf", tmp_path / "few.xdmf", "--frames", 6, "-o", tmp_path / "y.csv"),
    )
    with meshio.xdmf.TimeSeriesReader(tmp_path / "few.xdmf") as reader:
        reader.read_points_cells()
        few = [reader.read_data(k) for k in range(reader.num_steps)]
    np.testing.assert_allclose([step[0] for step in few], np.linspace(0, 0.05, 6), atol=1e-12)
    np.testing.assert_allclose(few[2][1]["u"], data[10]["u"])
    t = np.linspace(0, 0.05, 26)
    loads = np.column_stack([t, 20 * np.sin(300 * t)])
    np.savetxt(tmp_path / "l.csv", loads, delimiter=",", header="t,tip.fz", comments="")
    write_report(tmp_path / "r.h5", tmp_path / "report.html", loads=tmp_path / "l.csv")
    page = (tmp_path / "report.html").read_text()
    assert "argest von Mises stress" in page and "side, t =" in page
    run("export", tmp_path / "r.h5", "--to", "vtu", "--stress", "-o", tmp_path / "v.vtu")
    found = meshio.read(tmp_path / "v.vtu").point_data
    np.testing.assert_allclose(found["sigma_bottom_002"], rom.stress(side="bottom")[1], rtol=1e-6)


def test_shells_on_a_solid(tmp_path: Path) -> None:
    """Solids have one stress, shells two: each node that of its own elements."""
    block = box("hexahedron", (3, 3, 2), (0.1, 0.1, 0.05), distort=False)
    top = np.flatnonzero(np.abs(block.points[:, 2] - 0.05) < 1e-9)
    order = top[np.lexsort((block.points[top, 0], block.points[top, 1]))].reshape(4, 4)
    squares = np.stack([order[:-1, :-1], order[:-1, 1:], order[1:, 1:], order[1:, :-1]], axis=-1)
    mesh = meshio.Mesh(
        block.points, [block.cells[0], ("quad", squares.reshape(-1, 4))],
        cell_sets={"block": [np.arange(len(block.cells[0].data)), []], "skin": [[], np.arange(9)]},
    )  # fmt: skip
    ground = (np.flatnonzero(block.points[:, 2] < 1e-9) + 1).tolist()
    content = {
        "materials": {"steel": STEEL},
        "sections": {"sheet": {"shape": "shell", "thickness": 0.004}},
        "regions": {
            "block": {"material": "steel"},
            "skin": {"material": "steel", "section": "sheet"},
        },
        "supports": {"ground": {"nodes": ground, "components": ["x", "y", "z"]}},
        "interfaces": {"eye": {"coupling": "node", "nodes": [int(order[1, 2]) + 1]}},
    }
    import_description(content, "b", tmp_path / "b.h5", mesh=mesh)
    run(
        "reduce",
        "-body",
        tmp_path / "b.h5",
        "-mor_band_hz",
        "10,9000",
        "-mor_out",
        tmp_path / "r.h5",
    )
    rom = ReducedModel.load(tmp_path / "r.h5")
    q = np.ones((1, rom.order))
    solids, upper = rom.stress(q)[0], rom.stress(q, side="top")[0]
    assert np.isfinite(solids).all()
    assert np.isfinite(upper[top]).all() and np.isnan(np.delete(upper, top, axis=0)).all()
    larger = von_mises(rom.stress(q, side="larger"))[0]
    sides = [von_mises(rom.stress(q, side=side))[0] for side in ("", "top", "bottom")]
    np.testing.assert_allclose(larger, np.nanmax(sides, axis=0), rtol=1e-12)


def test_sensors_of_exudyn(tmp_path: Path) -> None:
    """EXUDYN's sensor of stress at a node of a shell is that of its top."""
    exu = pytest.importorskip("exudyn")
    eii = pytest.importorskip("exudyn.itemInterface")
    from flexgram.exporters.exudyn import add_body

    mesh = sheet("quad", (12, 3), flat(0.5, 0.06), 0.1)
    plastic = {"E": 2e9, "nu": 0.3, "rho": 1200.0}
    ends = {
        side: {"coupling": "rigid", "nodes": side} for side in ("start", "end")
    }  # the eyes of a slender body
    write(tmp_path / "b.h5", mesh, {"thickness": 0.004}, plastic, interfaces=ends,
          damping={"beta": 1e-5})  # fmt: skip
    run("reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "0.5,200", "-mor_out",
        tmp_path / "r.h5")  # fmt: skip
    model = ReducedModel.load(tmp_path / "r.h5")
    mbs = exu.SystemContainer().AddSystem()
    added = add_body(exu, mbs, model, stress=True)
    node = int(mesh.point_sets["middle"][0])
    kinds = exu.OutputVariableType
    sensors = [
        mbs.AddSensor(sensor)
        for sensor in (
            eii.SensorSuperElement(
                bodyNumber=added["object"],
                meshNodeNumber=added["mesh_nodes"][node + 1],
                storeInternal=True,
                outputVariableType=kinds.StressLocal,
            ),
            eii.SensorNode(
                nodeNumber=added["modal_node"],
                storeInternal=True,
                outputVariableType=kinds.Coordinates,
            ),
        )
    ]
    swing(mbs, added["markers"]["start"], added["markers"]["end"], (0.0, 0.0, -0.5), 0.05, 20)
    stress, q = (mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors)
    wanted = model.elastic().stress(q, side="top")[:, node][:, [0, 1, 2, 4, 5, 3]]
    assert np.abs(wanted).max() > 0
    assert np.abs(stress - wanted).max() < 1e-8 * np.abs(wanted).max()


def test_a_body_file_without_shells(tmp_path: Path) -> None:
    block = box("hexahedron", (2, 1, 1), (0.2, 0.1, 0.1))
    content = {
        "materials": {"steel": STEEL},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"eye": {"coupling": "node", "nodes": [1]}},
    }
    import_description(content, "b", tmp_path / "b.h5", mesh=block)
    rom = flexgram.reduce(tmp_path / "b.h5", (10, 3000), 1e-3)
    with pytest.raises(BodyError, match="side is one of a shell"):
        rom.stress(side="top", body=tmp_path / "b.h5")
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        del file["mesh"]
    with pytest.raises(BodyError, match="assembles from a mesh"):
        rom.stress(side="top", body=tmp_path / "b.h5")


def test_shells_that_do_not_deform(tmp_path: Path) -> None:
    """A block whose skin lies inside a rigid interface has the stress of its solids alone."""
    block = box("hexahedron", (4, 2, 2), (0.2, 0.05, 0.05), distort=False)
    end = np.flatnonzero(np.abs(block.points[:, 0] - 0.2) < 1e-9)
    order = end[np.lexsort((block.points[end, 1], block.points[end, 2]))].reshape(3, 3)
    squares = np.stack([order[:-1, :-1], order[:-1, 1:], order[1:, 1:], order[1:, :-1]], axis=-1)
    mesh = meshio.Mesh(
        block.points, [block.cells[0], ("quad", squares.reshape(-1, 4))],
        cell_sets={"block": [np.arange(16), []], "skin": [[], np.arange(4)]},
    )  # fmt: skip
    steel = {"material": "steel"}
    content = {
        "materials": {"steel": STEEL},
        "sections": {"sheet": {"shape": "shell", "thickness": 0.004}},
        "regions": {"block": steel, "skin": steel | {"section": "sheet"}},
        "interfaces": {"eye": {"coupling": "rigid", "nodes": (end + 1).tolist()}},
    }
    import_description(content, "b", tmp_path / "b.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "b.h5", (10, 9000), 1e-3)
    q = np.ones((1, rom.order))
    np.testing.assert_array_equal(rom.stress(q), rom.stress(q, side="larger"))
    assert stress_peaks(rom, q, np.zeros((1, len(rom.inputs)))).von_mises.side == ""
