"""Geometric stiffening in EXUDYN: against a geometrically exact beam, a Ritz method, and by what a
free body keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.spatial.transform
from test_preload import line

from conftest import run
from flexgram import ReducedModel
from flexgram.body.description import import_description
from flexgram.exporters.exudyn_stiffening import SPINS, GeometricStiffening


def spin_up(time: float, top: float = 6.0, rise: float = 15.0) -> tuple[float, float]:
    """Angle and angular acceleration, after Kane, Ryan and Banerjee (1987)."""
    w = 2 * np.pi / rise
    angle = top / rise * (time**2 / 2 + (np.cos(w * time) - 1) / w**2)
    return angle, top / rise * (1 - np.cos(w * time))


#: of Simo and Vu-Quoc (1986): EA = 2.8e7 N, EI = 1.4e4 N m², 1.2 kg/m
LENGTH, SIDE, BEAM = 10.0, np.sqrt(6e-3), {"E": 2.8e7 / 6e-3, "nu": 0.3, "rho": 200.0}


def settings(exu: Any, end: float, steps: int) -> Any:
    chosen = exu.SimulationSettings()
    time = chosen.timeIntegration
    time.numberOfSteps, time.endTime, time.verboseMode = steps, end, 0
    time.newton.useModifiedNewton = True
    time.newton.relativeTolerance = time.newton.absoluteTolerance = 1e-6
    time.generalizedAlpha.spectralRadius = 0.7
    chosen.linearSolver.solverType = exu.LinearSolverType.EXUdense
    chosen.solution.file.write = False
    chosen.solution.sensors.writePeriod = end
    return chosen


def long_beam(folder: Path, stiffening: str) -> ReducedModel:
    content = {
        "materials": {"soft": BEAM},
        "sections": {"bar": {"shape": "rectangle", "width": SIDE, "height": SIDE}},
        "regions": {"all": {"material": "soft", "section": "bar"}},
        "interfaces": {
            "root": {"coupling": "node", "nodes": "start"},
            "tip": {"coupling": "node", "nodes": "end"},
        },
    }
    import_description(content, "beam", folder / "beam.h5", mesh=line(20, 0.0, LENGTH))
    run(
        *("reduce", "-body", folder / "beam.h5", "-mor_band_hz", "0.05,10", "-mor_tol", "1e-3"),
        *("-mor_frame", "tangent", "-mor_stiffening", stiffening),
        *("-mor_out", folder / f"{stiffening}.h5"),
    )
    return ReducedModel.load(folder / f"{stiffening}.h5")


def tip_of_reduced(exu: Any, rom: ReducedModel, end: float, steps: int) -> Any:
    """Deflection of the tip across the beam; a hub of great inertia turns its root."""
    import exudyn.itemInterface as eii
    from exudyn.utilities import AddRigidBody, RigidBodyInertia

    from flexgram.exporters.exudyn import add_body

    mbs = exu.SystemContainer().AddSystem()
    added = add_body(exu, mbs, rom)
    ground, inertia = mbs.AddObject(eii.ObjectGround()), 1e8
    _, hub = AddRigidBody(
        mbs,
        inertia=RigidBodyInertia(mass=1e3, inertiaTensor=inertia * np.eye(3)),
        nodeType=exu.NodeType.RotationEulerParameters,
    )
    at_ground, at_hub = (mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=b)) for b in (ground, hub))
    mbs.AddObject(
        eii.GenericJoint(markerNumbers=[at_ground, at_hub], constrainedAxes=[1, 1, 1, 1, 1, 0])
    )
    mbs.AddObject(
        eii.GenericJoint(markerNumbers=[at_hub, added["markers"]["root"]], constrainedAxes=[1] * 6)
    )

    def torque(_mbs: Any, time: float, _load: Any) -> list[float]:
        return [0, 0, inertia * spin_up(time)[1]]

    mbs.AddLoad(eii.LoadTorqueVector(markerNumber=at_hub, loadVectorUserFunction=torque))
    q = coordinates(exu, mbs, added["modal_node"], "Coordinates", end, steps)
    elastic = rom.elastic()
    return elastic.C[elastic.outputs.index("tip.fy")] @ q


def coordinates(exu: Any, mbs: Any, node: int, what: str, end: float, steps: int) -> Any:
    """What a sensor sees of a node at the end."""
    import exudyn.itemInterface as eii

    sensor = mbs.AddSensor(
        eii.SensorNode(
            nodeNumber=node,
            storeInternal=True,
            outputVariableType=getattr(exu.OutputVariableType, what),
        )
    )
    mbs.Assemble()
    mbs.SolveDynamic(settings(exu, end, steps))
    last = mbs.GetSensorStoredData(sensor)[-1]
    assert last[0] == pytest.approx(end)
    return last[1:]


def tip_of_exact(exu: Any, end: float, steps: int, count: int) -> Any:
    """The same of EXUDYN's geometrically exact beam."""
    import exudyn.itemInterface as eii

    mbs = exu.SystemContainer().AddSystem()
    area = SIDE**2
    stretch = BEAM["E"] * area
    nodes = [
        mbs.AddNode(eii.NodeRigidBody2D(referenceCoordinates=[LENGTH * k / count, 0, 0]))
        for k in range(count + 1)
    ]
    for k in range(count):
        mbs.AddObject(
            eii.ObjectBeamGeometricallyExact2D(
                nodeNumbers=nodes[k : k + 2],
                length=LENGTH / count,
                massPerLength=BEAM["rho"] * area,
                crossSectionInertia=BEAM["rho"] * area**2 / 12,
                bendingStiffness=stretch * area / 12,
                axialStiffness=stretch,
                shearStiffness=stretch / 2.6 * 5 / 6,
            )
        )
    ground = mbs.AddMarker(
        eii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(eii.NodePointGround()), coordinate=0)
    )
    for c in range(3):
        markers = [
            ground,
            mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=c)),
        ]
        more = {"offsetUserFunction": lambda _m, t, _i, _o: spin_up(t)[0]} if c == 2 else {}
        mbs.AddObject(eii.CoordinateConstraint(markerNumbers=markers, **more))
    x, y, _ = coordinates(exu, mbs, nodes[-1], "Position", end, steps)
    angle = spin_up(end)[0]
    return np.cos(angle) * y - np.sin(angle) * x


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_spin_up_of_a_beam_in_exudyn(tmp_path: Path) -> None:
    """Kane, Ryan and Banerjee (1987): without the terms the beam bends away at 6 rad/s, above its
    first frequency of 3.8 rad/s; with them it stiffens, as a geometrically exact beam does."""
    exu = pytest.importorskip("exudyn")
    rom = long_beam(tmp_path, "yes")
    for end in (7.0, 12.0):
        steps = int(100 * end)
        exact = tip_of_exact(exu, end, steps, 10)
        assert abs(exact) > 0.1
        assert tip_of_reduced(exu, rom, end, steps) == pytest.approx(exact, rel=0.01)
    without = tip_of_reduced(exu, long_beam(tmp_path, "no"), 8.0, 800)
    assert abs(without) > 1.0


def column_by_ritz(along: float, across: float) -> float:
    """Deflection of the tip of the long beam under gravity, by polynomials; its axial force is
    what hangs on each section."""
    mass, bending = BEAM["rho"] * SIDE**2, BEAM["E"] * SIDE**4 / 12
    x, w = np.polynomial.legendre.leggauss(30)
    x, w = (x + 1) / 2, w / 2
    power = np.arange(2, 10)[:, None]
    shape, slope, bend = x**power, power * x ** (power - 1), power * (power - 1) * x ** (power - 2)
    K = bending / LENGTH**3 * (bend * w) @ bend.T
    K += mass * along * ((1 - x) * slope * w) @ slope.T
    return float(np.linalg.solve(K, mass * LENGTH * across * shape @ w).sum())


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_column_under_its_weight_in_exudyn(tmp_path: Path) -> None:
    """Hanging it is stiffer, standing softer; gravity makes stress as an acceleration does."""
    exu = pytest.importorskip("exudyn")
    import exudyn.itemInterface as eii

    from flexgram.exporters.exudyn import add_body

    rom = long_beam(tmp_path, "yes")
    elastic = rom.elastic()
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    for along in (8.0, -8.0, -40.0):
        mbs = exu.SystemContainer().AddSystem()
        gravity = turn @ [along, 0.01, 0.0]
        added = add_body(exu, mbs, rom, gravity=gravity, rotation=turn)
        ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(eii.ObjectGround())))
        mbs.AddObject(
            eii.GenericJoint(
                markerNumbers=[ground, added["markers"]["root"]],
                rotationMarker0=turn,
                constrainedAxes=[1] * 6,
            )
        )
        mbs.Assemble()
        chosen = exu.SimulationSettings()
        chosen.staticSolver.newton.relativeTolerance = 1e-10
        chosen.staticSolver.verboseMode = 0
        chosen.solutionSettings.writeSolutionToFile = False
        mbs.SolveStatic(chosen)
        q = mbs.GetNodeOutput(added["modal_node"], exu.OutputVariableType.Coordinates)
        tip = elastic.C[elastic.outputs.index("tip.fy")] @ np.asarray(q)
        assert tip == pytest.approx(column_by_ritz(along, 0.01), rel=5e-3)
    ratio = column_by_ritz(-40.0, 1.0) / column_by_ritz(0.0, 1.0)
    assert ratio > 1.7


def test_a_free_body_keeps_energy_and_momentum() -> None:
    """The equations of motion of ``GeometricStiffening`` beside a free mass, integrated by SciPy,
    against the energy and the momenta that they must keep."""
    import scipy.integrate

    rng = np.random.default_rng(3)
    n = 3
    a = rng.standard_normal((12, n, n))
    extra = GeometricStiffening(0.1 * (a + a.transpose(0, 2, 1)))
    mass, inertia, K = 5.0, np.diag([4.0, 5.0, 6.0]), np.diag([30.0, 40.0, 50.0])
    own = np.zeros((6 + n, 6 + n))
    own[:3, :3], own[3:6, 3:6], own[6:, 6:] = mass * np.eye(3), inertia, np.eye(n)

    def momenta(state: Any) -> Any:
        """∂T/∂v, ∂T/∂ω in the axes of the frame, and the energy; T by its formula."""
        v, w, q, rate = state[12:15], state[15:18], state[18 : 18 + n], state[18 + n :]

        def T(x: Any) -> Any:
            v, w, r = x[:3], x[3:6], x[6:]
            s = extra.K_t @ q @ q / 2
            products = np.array([w[a] * w[b] for a, b in SPINS])
            return (
                x @ own @ x / 2
                + v @ (extra.K_t @ q @ r)
                + w @ (extra.K_r @ q @ r)
                - products @ (extra.K_spin @ q @ q) / 2
                + v @ np.cross(w, s)
            )

        x = np.concatenate([v, w, rate])
        step = 1e-3  # T is quadratic in x: central differences are exact
        slopes = np.array([(T(x + step * e) - T(x - step * e)) / (2 * step) for e in np.eye(6 + n)])
        return slopes[:3], slopes[3:6], T(x) + q @ K @ q / 2

    def rates(_t: float, state: Any) -> Any:
        A = state[:9].reshape(3, 3)
        v, w, q, rate = state[12:15], state[15:18], state[18 : 18 + n], state[18 + n :]
        right = -extra.forces(w, q, rate)
        right[3:6] -= np.cross(w, inertia @ w)
        right[6:] -= K @ q
        x = np.linalg.solve(own + extra.mass(q), right)
        turning = A @ np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        # x holds the acceleration in the frame's axes: v' = a - ω × v
        return np.concatenate([turning.ravel(), A @ v, x[:3] - np.cross(w, v), x[3:6], rate, x[6:]])

    start = np.concatenate(
        [np.eye(3).ravel(), np.zeros(3), [0.3, -0.2, 0.1], [1.0, 0.5, -0.7], 0.3 * np.ones(n),
         [0.2, -0.4, 0.1]]
    )  # fmt: skip
    path = scipy.integrate.solve_ivp(rates, (0, 5), start, rtol=1e-11, atol=1e-12)

    def kept(state: Any) -> Any:
        A, p = state[:9].reshape(3, 3), state[9:12]
        P, L, energy = momenta(state)
        return np.concatenate([A @ P, A @ L + np.cross(p, A @ P), [energy]])

    first, last = kept(start), kept(path.y[:, -1])
    assert abs(path.y[18:21]).max() > 0.2
    assert last == pytest.approx(first, abs=1e-7)
    # without the forces of velocities nothing of it would be kept
    assert abs(extra.forces(start[15:18], start[18:21], start[21:])).max() > 0.01
