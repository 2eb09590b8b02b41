"""Reduced bodies at work in EXUDYN, a multibody code of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.integrate

from bodies import box, write_body_file
from conftest import assembled, run
from flexgram import BodyError, ReducedModel
from flexgram.exporters import export

exu = pytest.importorskip("exudyn")
import exudyn.itemInterface as eii  # noqa: E402

from flexgram.exporters.exudyn import add_body  # noqa: E402

SIZE = (0.5, 0.02, 0.02)
PIVOT = [0.0, 0.01, 0.01]
#: soft: the beam bends as it swings
SOFT = {"E": 2e8, "nu": 0.3, "rho": 2000.0}


def reduced(folder: Path, material: Any, band: str) -> tuple[Path, Path]:
    body, rom = folder / "beam.h5", folder / "beam.rom.h5"
    mesh = box("tetra10", (3, 1, 1), SIZE, distort=False)
    ends = {name: {"coupling": "distributing", "set": name} for name in ("start", "end")}
    write_body_file(body, mesh, material=material, interfaces=ends, damping=(0, 2e-3, 0))
    run("reduce", "-body", body, "-mor_band_hz", band, "-mor_tol", "1e-4", "-mor_out", rom)
    return body, rom


def swing(mbs: Any, start: int, end: int, force: Any, end_time: float, steps: int = 160) -> Any:
    """Hang a body by a ball joint, push its end by a force that keeps its direction.

    Returns times and positions of the end, (k, 4).
    """
    sensor = mbs.AddSensor(
        eii.SensorMarker(
            markerNumber=end, storeInternal=True, outputVariableType=exu.OutputVariableType.Position
        )
    )
    mbs.AddLoad(eii.LoadForceVector(markerNumber=end, loadVector=list(force)))
    ground = mbs.AddObject(eii.ObjectGround())
    pivot = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground, localPosition=PIVOT))
    mbs.AddObject(eii.SphericalJoint(markerNumbers=[pivot, start]))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime, time.verboseMode = steps, end_time, 0
    time.newton.useModifiedNewton = True
    time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-6, 1e-8
    time.generalizedAlpha.spectralRadius = 0.5
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = end_time / 20
    mbs.SolveDynamic(settings)
    return mbs.GetSensorStoredData(sensor)


def test_large_rotation_against_exudyns_full_model(tmp_path: Path) -> None:
    """The reduced body against EXUDYN's own floating frame with all nodes of the mesh."""
    from exudyn.FEM import FEMinterface, ObjectFFRFinterface

    body, rom = reduced(tmp_path, SOFT, "0.5,200")
    force = (0.0, -5.0, 0.0)
    mbs = exu.SystemContainer().AddSystem()
    markers = add_body(exu, mbs, ReducedModel.load(rom))["markers"]
    ours = swing(mbs, markers["start"], markers["end"], force, 0.4)

    full = assembled(tmp_path / "full.h5", body)
    order = np.lexsort((full["component"], full["node"]))
    points = full["position"][order][::3]
    fem = FEMinterface()
    fem.nodes = {"Position": points}
    fem.massMatrix, fem.stiffnessMatrix = (full[x][order][:, order].tocsr() for x in "MK")
    fem.modeBasis = {"matrix": np.zeros((len(order), 0)), "type": "none"}
    fem.surface, fem.postProcessingModes = [], {}
    mbs = exu.SystemContainer().AddSystem()
    # EXUDYN 1.13 looks at the mass-proportional coefficient only to see whether there is damping.
    objects = ObjectFFRFinterface(fem).AddObjectFFRF(
        exu, mbs, massProportionalDamping=1e-12, stiffnessProportionalDamping=2e-3
    )
    marker = []
    for x in (0.0, SIZE[0]):
        nodes = np.flatnonzero(points[:, 0] == x)
        marker.append(
            mbs.AddMarker(
                eii.MarkerSuperElementPosition(
                    bodyNumber=objects["oFFRF"],
                    meshNodeNumbers=nodes.tolist(),
                    weightingFactors=[1 / len(nodes)] * len(nodes),
                )
            )
        )
    theirs = swing(mbs, *marker, force, 0.4)

    arm = theirs[:, 1:] - PIVOT
    angle = np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))
    assert np.ptp(angle) > 2  # more than 115 degrees
    tip = ReducedModel.load(rom)
    assert tip.certified_error < 1e-4
    difference = np.linalg.norm(ours[:, 1:] - theirs[:, 1:], axis=1)
    assert difference.max() < 2e-3 * SIZE[0]


def test_pendulum_under_gravity(tmp_path: Path) -> None:
    """A stiff body from its NPZ against the rigid pendulum's equation."""
    body, rom = reduced(tmp_path, {"E": 70e9, "nu": 0.3, "rho": 2700.0}, "1,2000")
    export(ReducedModel.load(rom), tmp_path / "beam.npz", "exudyn", body=body)
    mbs = exu.SystemContainer().AddSystem()
    added = add_body(exu, mbs, tmp_path / "beam.npz", gravity=(0, -9.81, 0))
    with pytest.raises(BodyError, match=r"no interface 'begin' \(there are: start, end\)"):
        added["markers"]["begin"]
    with pytest.raises(BodyError, match=r"no mesh node 999 .*nodes=\[…\] brings more"):
        added["mesh_nodes"][999]
    found = swing(mbs, added["markers"]["start"], added["markers"]["end"], (0, 0, 0), 0.6, 600)
    a, b, _ = SIZE
    reach, inertia = a / 2, (a**2 + b**2) / 12 + (a / 2) ** 2  # per mass, about the pivot
    exact = scipy.integrate.solve_ivp(
        lambda t, s: [s[1], -9.81 * reach * np.cos(s[0]) / inertia],
        (0, 0.6),
        [0, 0],
        t_eval=found[:, 0],
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    arm = found[:, 1:] - PIVOT
    assert np.ptp(exact) > 2.5
    assert np.abs(np.unwrap(np.arctan2(arm[:, 1], arm[:, 0])) - exact).max() < 2e-3


@pytest.mark.parametrize("from_file", [False, True])
def test_stress_sensors(from_file: bool, tmp_path: Path) -> None:
    """EXUDYN's sensor of stress at a node of the surface is the reduced body's own stress."""
    body, rom = reduced(tmp_path, SOFT, "0.5,200")
    model = ReducedModel.load(rom)
    mbs = exu.SystemContainer().AddSystem()
    if from_file:
        export(model, tmp_path / "beam.npz", "exudyn", body=body, stress=True)
        added = add_body(exu, mbs, tmp_path / "beam.npz")
    else:
        added = add_body(exu, mbs, rom, stress=True)  # the reduced file itself
    positions = np.array(mbs.GetObject(added["object"])["referencePositions"]).reshape(-1, 3)
    node = int(np.argmin(np.linalg.norm(positions - [SIZE[0] / 3, 0, 0], axis=1)))
    with h5py.File(body) as file:
        own = int(np.argmin(np.linalg.norm(file["mesh/points"][:] - positions[node], axis=1)))
    sensors = [
        mbs.AddSensor(sensor)
        for sensor in (
            eii.SensorSuperElement(
                bodyNumber=added["object"],
                meshNodeNumber=node,
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.StressLocal,
            ),
            eii.SensorNode(
                nodeNumber=added["modal_node"],
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Coordinates,
            ),
        )
    ]
    swing(mbs, added["markers"]["start"], added["markers"]["end"], (0.0, -5.0, 0.0), 0.05, 20)
    stress, q = (mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors)
    expected = model.elastic().stress(q, body)[:, own][:, [0, 1, 2, 4, 5, 3]]
    assert np.abs(expected).max() > 0
    assert np.abs(stress - expected).max() < 1e-8 * np.abs(expected).max()


def test_further_nodes_and_a_bent_beginning(tmp_path: Path) -> None:
    """Middle nodes come along by name, and the body may be bent when it starts."""
    body, rom = reduced(tmp_path, SOFT, "0.5,200")
    model = ReducedModel.load(rom)
    mbs = exu.SystemContainer().AddSystem()
    corners = add_body(exu, mbs, model, stress=True)["mesh_nodes"]
    with h5py.File(body) as file:
        points = file["mesh/points"][:]
    left = [k + 1 for k in range(len(points)) if k + 1 not in corners]
    bent = 1e-3 * np.random.default_rng(2).standard_normal(model.elastic().order)
    mbs = exu.SystemContainer().AddSystem()
    added = add_body(exu, mbs, model, stress=True, nodes=[left[7], left[3]], coordinates=bent)
    assert set(added["mesh_nodes"]) == {*corners, left[3], left[7]}
    positions = np.array(mbs.GetObject(added["object"])["referencePositions"]).reshape(-1, 3)
    for node, number in added["mesh_nodes"].items():
        assert np.allclose(positions[number], points[node - 1])
    mbs.Assemble()
    stress = mbs.GetObjectOutputSuperElement(
        added["object"],
        exu.OutputVariableType.StressLocal,
        added["mesh_nodes"][left[7]],
        exu.ConfigurationType.Initial,
    )
    expected = model.elastic().stress(bent, body)[0, left[7] - 1, [0, 1, 2, 4, 5, 3]]
    assert np.abs(stress - expected).max() < 1e-8 * np.abs(expected).max()
    with pytest.raises(BodyError, match="nodes of the mesh run from 1"):
        add_body(exu, mbs, model, nodes=[10**7])
    with pytest.raises(BodyError, match="coordinates: 2 numbers"):
        add_body(exu, mbs, model, coordinates=[0, 0])
