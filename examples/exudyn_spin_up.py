"""A beam that spins up in EXUDYN, with geometric stiffening and without.

    .venv/bin/python3 examples/exudyn_spin_up.py [folder]

Needs exudyn (pip install exudyn). Simo and Vu-Quoc's beam turns up to 6 rad/s in 15 s, faster than
its first natural frequency of 3.8 rad/s: a floating frame without the stress of its own centrifugal
load bends it away (Kane, Ryan and Banerjee 1987).
"""

import sys
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as eii
import matplotlib
import meshio
import numpy as np
from exudyn.utilities import AddRigidBody, RigidBodyInertia

import flexgram
from flexgram.body.description import import_description
from flexgram.exporters.exudyn import add_body

matplotlib.use("Agg")
import matplotlib.pyplot as plt

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)
length, count, top, rise = 10.0, 20, 6.0, 15.0

points = np.zeros((count + 1, 3))
points[:, 0] = np.linspace(0, length, count + 1)
cells = [("line", np.column_stack([np.arange(count), np.arange(1, count + 1)]))]
ends = {"root": np.array([0]), "tip": np.array([count])}
mesh = meshio.Mesh(points, cells, point_sets=ends, cell_sets={"beam": [np.arange(count)]})
side = np.sqrt(6e-3)
description = {
    "materials": {"soft": {"E": 2.8e7 / 6e-3, "nu": 0.3, "rho": 200.0}},
    "sections": {"bar": {"shape": "rectangle", "width": side, "height": side}},
    "regions": {"beam": {"material": "soft", "section": "bar"}},
    "interfaces": {end: {"coupling": "node", "nodes": end} for end in ends},
    "damping": {"beta": 1e-3},
}
import_description(description, "beam", out / "beam.h5", mesh=mesh)


def torque(_mbs: object, t: float, _load: object) -> list[float]:
    turning = top / rise * (1 - np.cos(2 * np.pi * t / rise)) if t < rise else 0.0
    return [0, 0, 1e8 * turning]


def deflection(stiffening: bool, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Of the tip across the beam, over time."""
    rom = flexgram.reduce(out / "beam.h5", (0.05, 10), 1e-3, frame="tangent", stiffening=stiffening)
    print(rom)
    mbs = exu.SystemContainer().AddSystem()
    added = add_body(exu, mbs, rom)
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(eii.ObjectGround())))
    inertia = RigidBodyInertia(mass=1e3, inertiaTensor=1e8 * np.eye(3))
    _, body = AddRigidBody(mbs, inertia=inertia, nodeType=exu.NodeType.RotationEulerParameters)
    hub = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body))
    mbs.AddLoad(eii.LoadTorqueVector(markerNumber=hub, loadVectorUserFunction=torque))
    mbs.AddObject(eii.GenericJoint(markerNumbers=[ground, hub], constrainedAxes=[1, 1, 1, 1, 1, 0]))
    mbs.AddObject(
        eii.GenericJoint(markerNumbers=[hub, added["markers"]["root"]], constrainedAxes=[1] * 6)
    )
    sensor = mbs.AddSensor(
        eii.SensorNode(
            nodeNumber=added["modal_node"],
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Coordinates,
        )
    )
    mbs.Assemble()
    settings = exu.SimulationSettings()
    time = settings.timeIntegration
    time.endTime, time.numberOfSteps, time.verboseMode = end, int(100 * end), 0
    time.newton.useModifiedNewton = True
    time.newton.relativeTolerance = time.newton.absoluteTolerance = 1e-6
    time.generalizedAlpha.spectralRadius = 0.7
    settings.linearSolver.solverType = exu.LinearSolverType.EXUdense
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 0.05
    mbs.SolveDynamic(settings)
    data = mbs.GetSensorStoredData(sensor)
    elastic = rom.elastic()  # in the frame of the root
    return data[:, 0], data[:, 1:] @ elastic.C[elastic.outputs.index("tip.fy")]


figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for stiffening, end, words in (
    (True, 20.0, "with geometric stiffening"),
    (False, 9.0, "without"),
):
    t, across = deflection(stiffening, end)
    axes.plot(t, across, "-" if stiffening else "--", label=words)
    print(f"{words}: at most {abs(across).max():.3f} m across the beam until {end:g} s")
axes.set(xlabel="time [s]", ylabel="tip across the beam [m]", ylim=(-1.5, 0.2))
axes.legend()
figure.savefig(out / "spin-up.svg")
