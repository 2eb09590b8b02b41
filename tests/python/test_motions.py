"""Motions that a multibody code computed: read, shown with their stress, and doubted."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from test_mesh_loads import write_body

from bodies import box, write_body_file
from conftest import run
from flexgram import BodyError, ReducedModel, reduce
from flexgram.assembly.couple import Joint, couple
from flexgram.body.stress import von_mises
from flexgram.pictures.report import write_report
from flexgram.pictures.space import Space
from flexgram.simulation.motions import Motion, read_coordinates

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7850.0, "expansion": 1.2e-5}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected a line for each moment: time and 2 coordinates"),
        ("t,q1,q2\n0,1,2\n", "expected a line for each moment"),
        ("# EXUDYN\n0,1\n1,1\n", "line 2: 1 coordinates, but the body has 2 elastic ones"),
        ("0;1;2\n1;1;1\n", "line 1: expected commas between columns"),
        ("0,1,2\n1,1\n", "line 2: expected 3 numbers"),
        ("time,a,b\n0,1,2\n1,x,1\n", "line 3: expected 3 numbers"),
        ("0,1,2\n0,1,2\n", "line 2: the time does not rise"),
    ],
)
def test_files_that_are_none(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(BodyError, match=expected):
        read_coordinates(path, 2)


def test_a_swing_in_exudyn(tmp_path: Path) -> None:
    """The page of the file that EXUDYN's sensor writes has the stress that EXUDYN has."""
    exu = pytest.importorskip("exudyn")
    import exudyn.itemInterface as eii
    from test_exudyn import SOFT, reduced, swing

    from flexgram.exporters.exudyn import add_body

    body, rom = reduced(tmp_path, SOFT, "0.5,200")
    mbs = exu.SystemContainer().AddSystem()
    model = ReducedModel.load(rom)
    with h5py.File(body) as file:
        nodes = range(1, len(file["mesh/points"]) + 1)
    added = add_body(exu, mbs, model, stress=True, nodes=nodes)
    motion = tmp_path / "motion.txt"
    mbs.AddSensor(
        eii.SensorNode(
            nodeNumber=added["modal_node"],
            fileName=str(motion),
            outputVariableType=exu.OutputVariableType.Coordinates,
        )
    )
    everywhere = {
        node: mbs.AddSensor(
            eii.SensorSuperElement(
                bodyNumber=added["object"],
                meshNodeNumber=number,
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.StressLocal,
            )
        )
        for node, number in added["mesh_nodes"].items()
    }
    swing(mbs, added["markers"]["start"], added["markers"]["end"], (0.0, -5.0, 0.0), 0.05, 20)
    said = run("report", rom, "--motion", motion, "-o", tmp_path / "swing.html").out
    found = re.search(r"largest von Mises stress (\S+) MPa at .*? node (\d+), t = (\S+) s", said)
    assert found
    stress, node, when = float(found[1]), int(found[2]), float(found[3])
    of_node = mbs.GetSensorStoredData(everywhere[node])
    at = int(np.argmin(np.abs(of_node[:, 0] - when)))
    own = von_mises(of_node[at, [1, 2, 3, 6, 4, 5]])
    assert stress == pytest.approx(1e-6 * own, rel=1e-3)
    largest = max(
        von_mises(mbs.GetSensorStoredData(sensor)[:, [1, 2, 3, 6, 4, 5]]).max()
        for sensor in everywhere.values()
    )
    assert stress == pytest.approx(1e-6 * largest, rel=1e-3)
    page = (tmp_path / "swing.html").read_text()
    assert "The motion motion.txt" in page and "motion of the multibody code" in page
    assert "peaks between them" not in page
    assert "The error of this stress has no bound" in page
    few = tmp_path / "few.csv"
    t, q = read_coordinates(motion, model.elastic().order)
    np.savetxt(few, np.column_stack([100 * t, q]), delimiter=",", header="t", comments="# ")
    said = run("report", rom, "--motion", few, "-o", tmp_path / "few.html").out
    assert "peaks between them are not seen" in said


def test_heat_needs_the_temperatures(tmp_path: Path) -> None:
    mesh = box("tetra10", (3, 1, 1), (0.3, 0.05, 0.05), distort=False)
    write_body(
        tmp_path / "b.h5",
        mesh,
        materials={"steel": STEEL},
        loads={"warm": {"type": "temperature", "nodes": "all"}},
        outputs={},
        damping={"beta": 1e-6},
    )
    rom = reduce(tmp_path / "b.h5", (100, 2000), 1e-2)
    rom.save(tmp_path / "b.rom.h5")
    part = rom.elastic()
    t = np.linspace(0, 1e-3, 40)
    q = 1e-6 * np.outer(np.sin(4000 * t), np.ones(part.order))
    motion = tmp_path / "motion.csv"
    np.savetxt(motion, np.column_stack([t, q]), delimiter=",", header="t", comments="# ")
    words = ("report", tmp_path / "b.rom.h5", "--motion", motion, "-o", tmp_path / "b.html")
    failed = run(*words, expect=None)
    assert failed.status != 0 and "give the temperatures by --loads" in failed.err
    (tmp_path / "warm.csv").write_text("t,warm.T\n0,10\n0.01,110\n")
    said = run(*words, "--loads", tmp_path / "warm.csv").out
    u = np.zeros((len(t), len(rom.inputs)))
    u[:, rom.inputs.index("warm.T")] = 10 + 1e4 * t
    largest = 1e-6 * np.nanmax(von_mises(part.stress(q, u=u)))
    assert f"largest von Mises stress {largest:.4g} MPa" in said
    (tmp_path / "warm.csv").write_text("t,warm.T\n0,10\n0.0005,110\n")
    failed = run(*words, "--loads", tmp_path / "warm.csv", expect=1)
    assert "its times are 0 to 0.0005 s, those of the motion 0 to 0.001 s" in failed.err


def test_the_answer_of_an_assembly(tmp_path: Path) -> None:
    """Its parts move by the answer to a load history as its ports do; its stress has no picture."""
    ends = {n: {"set": n, "coupling": "rigid"} for n in ("start", "end")}
    mesh = box("tetra10", (6, 1, 1), (0.3, 0.02, 0.01), distort=False)
    write_body_file(tmp_path / "b.h5", mesh, interfaces=ends, damping=(5, 1e-5, 0))
    reduce(tmp_path / "b.h5", (10, 2000), 1e-3).save(tmp_path / "b.rom.h5")
    part = ReducedModel.load(tmp_path / "b.rom.h5")
    joints = [Joint("p.end", "q.start"), Joint("p.start", "ground")]
    couple({"p": part, "q": part}, joints).save(tmp_path / "whole.h5")
    whole = ReducedModel.load(tmp_path / "whole.h5")
    (tmp_path / "l.csv").write_text("t,q.end.fz\n0,0\n0.002,5\n0.01,5\n0.02,0\n")
    motion = Motion.answer(whole, tmp_path / "l.csv", None)
    space = Space.of(whole)
    moments = np.argsort(np.abs(motion.q).max(axis=1))[-3:]
    moved = space.motion(motion.part, motion.q[moments])
    at = space.geometry.interfaces["q.end"]
    ports = [motion.part.outputs.index(f"q.end.f{axis}") for axis in "xyz"]
    seen = motion.q[moments] @ motion.part.system.C[ports].T
    # A rigid face: the mean of its nodes is near its reference, which is their middle.
    np.testing.assert_allclose(moved[:, at].mean(axis=1), seen, atol=0.02 * np.abs(seen).max())
    made = write_report(tmp_path / "whole.h5", tmp_path / "w.html", loads=tmp_path / "l.csv")
    assert not any("answer to the load history" in line for line in made.left)
