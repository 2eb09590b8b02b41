"""Geometric stiffening of floating frames: against bodies under preloads, and in EXUDYN against a
geometrically exact beam and by what a free body keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.spatial.transform
from test_preload import line

from bodies import box
from conftest import assembled, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.body.description import import_description
from flexgram.exporters.exudyn_stiffening import SPINS, GeometricStiffening, frame_stiffening
from flexgram.exporters.sid import read_sid, write_sid

MATERIAL = {"E": 2e9, "nu": 0.3, "rho": 2000.0}
SIZE = (1.0, 0.03, 0.05)
SPEED, PULL = 30.0, 800.0


def blade(path: Path, cell: str, held: str = "", turned: Any = None, **more: Any) -> None:
    """A bar along x. Its ends are rigid interfaces, but the one that supports hold."""
    ends = {"root": "start", "tip": "end"}
    content: dict[str, Any] = {
        "materials": {"soft": MATERIAL},
        "regions": {"all": {"material": "soft"}},
        "interfaces": {
            name: {"coupling": "rigid", "nodes": nodes}
            for name, nodes in ends.items()
            if name != held
        },
    }
    if held:
        content["supports"] = {held: {"nodes": ends[held]}}
    mesh = box(cell, (6, 1, 1), SIZE, distort=False)
    mesh.points -= [0, SIZE[1] / 2, SIZE[2] / 2]  # a spin about z bends nothing
    if turned is not None:
        mesh.points = mesh.points @ turned.T
    import_description(content | more, "blade", path, mesh=mesh)


def stiffened(
    folder: Path, cell: str, ranks: int = 1, *more: object, turned: Any = None
) -> tuple[ReducedModel, str]:
    blade(folder / "free.h5", cell, turned=turned)
    said = run(
        *("reduce", "-body", folder / "free.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-5"),
        *("-mor_stiffening", "yes", "-mor_out", folder / "rom.h5"),
        *(() if "-mor_frame" in more else ("-mor_frame", "tangent")),
        *more,
        ranks=ranks,
    ).out
    return ReducedModel.load(folder / "rom.h5"), said


def lowest(K: Any, M: Any) -> Any:
    return np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[:3])


def under(folder: Path, cell: str, stays: dict[str, float], held: str = "root", **more: Any) -> Any:
    """Natural frequencies of the blade held at one end, under loads that stay."""
    path = folder / f"under_{next(iter(stays))}.h5"
    blade(path, cell, held, preload=stays, **more)
    full = assembled(path.with_suffix(".matrices.h5"), path)
    return lowest(full["K"].toarray(), full["M"].toarray())


@pytest.mark.parametrize(("cell", "ranks"), [("tetra10", 1), ("hexahedron", 2)])
def test_sid_against_preloads(cell: str, ranks: int, tmp_path: Path) -> None:
    """Frequencies by the blocks of a SID, against the body under a spin, a pull, its own weight."""
    rom, said = stiffened(tmp_path, cell, ranks)
    assert "18 unit loads" in said and "root holds the body" in said
    write_sid(rom, tmp_path / "blade.SID_FEM")
    sid = read_sid(tmp_path / "blade.SID_FEM")
    K, M = sid["Ke"][0], sid["Me"][0]
    at_rest = lowest(K, M)

    def by(block: Any, column: int) -> Any:  # (q, r, c)
        return block[1][:, :, column].T

    spun = K + SPEED**2 * by(sid["Oe"], 2)
    expected = under(
        tmp_path,
        cell,
        {"turn.spin": SPEED**2},
        loads={"turn": {"type": "spin", "axis": [0, 0, 1], "point": [0, 0, 0]}},
    )
    assert abs(expected - at_rest).max() > 0.2 * at_rest[0]
    assert lowest(spun, M) == pytest.approx(expected, rel=3e-3)  # strains of 5e-4 move it too

    phi = sid["nodes"][2]["phi"][1]  # (q, axis, mode): the tip
    pulled = K - PULL * phi[:, 0, :].T
    expected = under(tmp_path, cell, {"tip.fx": PULL})
    assert abs(expected - at_rest).max() > 0.2 * at_rest[0]
    assert lowest(pulled, M) == pytest.approx(expected, rel=2e-3)

    lifted = K + 300 * by(sid["Ct"], 0)  # a frame that moves along x: its root pushes
    expected = under(tmp_path, cell, {"g.ax": -300.0}, loads={"g": {"type": "acceleration"}})
    assert abs(expected - at_rest).max() > 0.05 * at_rest[0]
    assert lowest(lifted, M) == pytest.approx(expected, rel=2e-3)


def test_what_holds_the_body_does_not_matter(tmp_path: Path) -> None:
    """All loads at once are in equilibrium: their stress is the same whatever interface balances
    each by itself."""
    bodies = []
    for held in ("root", "tip"):
        folder = tmp_path / held
        folder.mkdir()
        options = ("-mor_frame", "buckens", "-mor_frame_interface", held)
        bodies.append(stiffened(folder, "hexahedron", 1, *options)[0])
    first, second = (rom.frame.integrals for rom in bodies)
    assert first is not None and second is not None
    assert bodies[0].V == pytest.approx(bodies[1].V, abs=1e-10 * abs(bodies[0].V).max())
    # Pulled at both ends along the axis through its centre, the body is lifted by what is left.
    forces = {"tip.fx": 500.0, "root.fx": -200.0, "frame.ax": 300.0 / first.mass}
    sums = [
        sum(x * body.stiffening[load] for load, x in forces.items() if load in body.stiffening)
        for body in (first, second)
    ]
    assert "root.fx" in second.stiffening and "root.fx" not in first.stiffening
    assert sums[1] == pytest.approx(sums[0], abs=1e-8 * abs(sums[0]).max())


SPIN_ABOUT_Z: dict[str, Any] = {"turn": {"type": "spin", "axis": [0, 0, 1], "point": [1, 0, 0]}}


@pytest.mark.parametrize("way", ["cut", "reduce", "inputs"])
def test_the_frame_follows_what_holds_the_body(way: str, tmp_path: Path) -> None:
    """A frame at the tip: the stress is that of a body held there, whatever `certify` knew."""
    at_tip = ("-mor_frame", "tangent", "-mor_frame_interface", "tip")
    if way == "cut":
        stiffened(tmp_path, "tetra10", 1, "-mor_medium_out", tmp_path / "medium.h5")
        run(
            *("cut", "-medium", tmp_path / "medium.h5", "-mor_tol", "1e-5", *at_tip),
            *("-mor_out", tmp_path / "rom.h5"),
        )
    else:
        more = at_tip if way == "reduce" else ("-mor_inputs", "tip")
        _, said = stiffened(tmp_path, "tetra10", 1, *more)
        assert "tip holds the body" in said
    rom = ReducedModel.load(tmp_path / "rom.h5").elastic()
    assert rom.frame.integrals is not None
    stiffening, K, M = rom.frame.integrals.stiffening, rom.system.K, rom.system.M
    # about z through the tip at x = 1: the origin is accelerated by ω² along x
    across = rom.frame.integrals.inertia_second[2, :, 2, :]
    spun = stiffening["frame.spinzz"] + stiffening["frame.ax"] - across
    expected = under(tmp_path, "tetra10", {"turn.spin": SPEED**2}, "tip", loads=SPIN_ABOUT_Z)
    assert abs(expected - lowest(K, M)).max() > 0.2 * lowest(K, M)[0]
    assert lowest(K + SPEED**2 * spun, M) == pytest.approx(expected, rel=3e-3)


def test_stiffening_turns_with_the_body(tmp_path: Path) -> None:
    """Of a body in other axes: each motion of the frame, products of speeds about oblique axes."""
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
    bodies = []
    for name, turned in (("first", np.eye(3)), ("second", turn)):
        (tmp_path / name).mkdir()
        rom = stiffened(tmp_path / name, "hexahedron20", turned=turned)[0].elastic()
        assert rom.frame.integrals is not None
        bodies.append((rom.system.K, rom.system.M, rom.frame.integrals.stiffening))

    def vectors(of: Any, start: str, v: Any) -> Any:
        return sum(v[c] * of[f"{start}{'xyz'[c]}"] for c in range(3))

    def spun(of: Any, w: Any) -> Any:
        products = [w[a] * w[b] for a, b in SPINS]
        return np.tensordot(products, frame_stiffening(of)["stiffening"][6:], 1)

    for v in ([1.0, 0.5, -0.3], [0.0, 1.0, 1.0], [-1.0, 0.0, 0.6]):
        there = turn @ np.array(v)
        for what, scale in (("frame.a", 400.0), ("frame.alpha", 400.0), ("tip.f", 200.0)):
            first, second = (
                lowest(K + scale * vectors(of, what, axis), M)
                for (K, M, of), axis in zip(bodies, (v, there), strict=True)
            )
            assert second == pytest.approx(first, rel=1e-5)
            assert abs(first - lowest(*bodies[0][:2])).max() > 1e-3 * first[0]
        first, second = (
            lowest(K + 900 * spun(of, axis), M)
            for (K, M, of), axis in zip(bodies, (v, there), strict=True)
        )
        assert second == pytest.approx(first, rel=1e-5)
        assert abs(first - lowest(*bodies[0][:2])).max() > 1e-2 * first[0]


def test_a_medium_model_keeps_it(tmp_path: Path) -> None:
    rom, _ = stiffened(tmp_path, "hexahedron")
    medium = tmp_path / "medium.h5"
    run(
        *("certify", "-body", tmp_path / "free.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-5"),
        *("-mor_stiffening", "yes", "-mor_medium_out", medium),
    )
    run(
        *("cut", "-medium", medium, "-mor_tol", "1e-5", "-mor_frame", "tangent"),
        *("-mor_out", tmp_path / "cut.h5"),
    )
    direct, cut = (b.elastic() for b in (rom, ReducedModel.load(tmp_path / "cut.h5")))
    assert direct.frame.integrals is not None and cut.frame.integrals is not None
    assert list(cut.frame.integrals.stiffening) == list(direct.frame.integrals.stiffening)
    for load, speed in (("frame.spinzz", 30.0), ("frame.spinxx", 50.0), ("tip.fx", 20.0)):
        of = [
            lowest(b.system.K + speed**2 * b.frame.integrals.stiffening[load], b.system.M)
            for b in (direct, cut)
        ]
        assert of[1] == pytest.approx(of[0], rel=1e-6)


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
        assert tip_of_reduced(exu, rom, end, steps) == pytest.approx(exact, abs=0.005)
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


def test_what_has_no_stiffening(tmp_path: Path) -> None:
    assert frame_stiffening({}) == {}
    write_matrices(tmp_path / "matrices.h5", np.eye(3), np.eye(3), np.eye(3)[:, :1], beta=1e-3)
    said = run("reduce", "-body", tmp_path / "matrices.h5", "-mor_stiffening", "yes", expect=1)
    assert "-mor_stiffening needs the mesh" in said.err
    blade(tmp_path / "held.h5", "hexahedron", "root")
    rom = tmp_path / "held.rom.h5"
    said = run(
        *("reduce", "-body", tmp_path / "held.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-4"),
        *("-mor_stiffening", "yes", "-mor_out", rom),
    )
    assert "held by its supports" in said.out
    integrals = ReducedModel.load(rom).frame.integrals
    assert integrals is not None and len(integrals.stiffening) == 18
    blade(tmp_path / "pulled.h5", "hexahedron", "root", preload={"tip.fx": 1.0})
    said = run("reduce", "-body", tmp_path / "pulled.h5", "-mor_stiffening", "yes", expect=1)
    assert "a body at rest" in said.err
    known = {"soft": MATERIAL | {"parameter": {"E": [1e9, 2e9]}}}
    blade(tmp_path / "known.h5", "hexahedron", "root", materials=known)
    said = run("reduce", "-body", tmp_path / "known.h5", "-mor_stiffening", "yes", expect=1)
    assert "known between two numbers one value" in said.err
    blade(tmp_path / "free.h5", "hexahedron")
    said = run(
        *("reduce", "-body", tmp_path / "free.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-4"),
        *("-mor_stiffening", "yes", "-mor_frame_interface", "tipp", "-mor_out", tmp_path / "x.h5"),
        expect=1,
    )
    assert "did you mean tip?" in said.err
    with pytest.raises(BodyError, match="dialect"):
        write_sid(ReducedModel.load(rom), tmp_path / "x.SID_FEM", "none")
