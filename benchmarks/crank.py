"""A crank drive in EXUDYN over one revolution: stress at hot spots, against the full body.

A connecting rod (our own geometry, Tet10) between a crank that turns at a given speed and a piston
under gas pressure, with gravity; the pins take its bores in the mean. Reduced by flexgram it moves
in EXUDYN. The reference (``FullRod``) moves all nodes of its mesh in inertial coordinates, by code
of its own, with the same K, M and stress recovery and by the same rule and steps in time, so that
what is left is the reduction; EXUDYN's own full body (``ObjectFFRF``) did not get through three
steps in 300 s. The second revolution from rest of the elastic coordinates counts. Writes
benchmarks/results/crank.csv and docs/images/crank.png.

    benchmarks/run crank [--rpm 3000 6000] [--steps 1440] [--size 0.02]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import gmsh
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import meshio
import numpy as np
import scipy.sparse as sp
from common import OUT, RESULTS, ROOT, assembled, flexgram, write_table
from scipy.sparse.linalg import splu

from flexgram import ReducedModel
from flexgram.body.description import import_description
from flexgram.body.stress import Stresses, von_mises
from flexgram.exporters.exudyn import add_body
from flexgram.simulation.hot_spots import hot_spots

CRANK, ROD = 0.045, 0.150  # radius of the crank, length between the bores [m]
BORES = {"big": (0.0, 0.020, 0.030), "small": (ROD, 0.010, 0.016)}  # axis, inner, outer
WIDTH, SHANK, THIN = 0.018, 0.020, 0.008  # of the eyes along z, of the shank along y and z
STEEL = {"E": 210e9, "nu": 0.3, "rho": 7850.0}
BETA = 2e-6  # damping D = beta K [s]
PISTON = 0.4  # kg
AREA, PRESSURE = np.pi * 0.043**2, 2.5e6  # of the piston [m²], of the gas at its peak [Pa]
BAND = ("-mor_band_hz", "10,5000")
DRAWN = ("two_step, 1e-2", "two_step, 1e-2, statics and spin", "two_step, 1e-4, statics and spin")
STATICS = ("-mor_statics", "yes", "-mor_spin_loads", "yes")
GRAVITY = [-9.81, 0.0, 0.0]


def gas(angle: float) -> float:
    """Force of the gas on the piston along x at an angle of the crank past top dead centre."""
    past = np.degrees((angle + np.pi) % (2 * np.pi) - np.pi)
    return float(-AREA * PRESSURE * np.exp(-(((past - 10) / 25) ** 2)))


@dataclass
class Pin:
    """Nodes of a bore that follow a pin in the mean; ``middle``, on the axis, is their mean."""

    nodes: Any
    weights: Any
    middle: Any


def pin_of(points: Any, nodes: Any, axis: float) -> Pin:
    """The least change of equal weights that puts the mean on the axis (x, y) = (``axis``, 0)."""
    x = points[nodes]
    middle = np.array([axis, 0.0, x[:, 2].mean()])
    moments = np.hstack([np.ones((len(x), 1)), x - middle])
    weights = np.full(len(x), 1 / len(x))
    weights += np.linalg.pinv(moments.T) @ (np.array([1.0, 0, 0, 0]) - moments.T @ weights)
    return Pin(nodes, weights, middle)


def rod(path: Path, size: float) -> tuple[meshio.Mesh, dict[str, Pin]]:
    """The rod, two eyes and a shank between them, and its pins: two halves of the big bore."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    shank = occ.addBox(0, -SHANK / 2, -THIN / 2, ROD, SHANK, THIN)
    eyes, holes = [], []
    for x, inner, outer in BORES.values():
        eyes.append((3, occ.addCylinder(x, 0, -WIDTH / 2, 0, 0, WIDTH, outer)))
        holes.append((3, occ.addCylinder(x, 0, -WIDTH, 0, 0, 2 * WIDTH, inner)))
    solid, _ = occ.cut(occ.fuse([(3, shank)], eyes)[0], holes)
    occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in solid])
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 10)
    gmsh.option.setNumber("Mesh.ElementOrder", 2)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()
    mesh = meshio.read(path)
    mesh.cells = [block for block in mesh.cells if block.type == "tetra10"]
    mesh.cell_data = {}
    x, y, z = mesh.points.T
    bore = {
        name: np.abs(np.hypot(x - at, y) - inner) < 1e-6 for name, (at, inner, _) in BORES.items()
    }
    ends = {"front": bore["big"] & (z > 0), "back": bore["big"] & (z < 0), "small": bore["small"]}
    mesh.point_sets = {name: np.flatnonzero(inside) for name, inside in ends.items()}
    return mesh, {
        name: pin_of(mesh.points, nodes, ROD if name == "small" else 0.0)
        for name, nodes in mesh.point_sets.items()
    }


class Drive:
    """The multibody system around a rod that ``add`` brings: crank, piston, pins, loads."""

    def __init__(self, pins: dict[str, Pin], rpm: float, steps: int, turns: int) -> None:
        self.turns = turns
        self.pins = pins
        self.spin = rpm * 2 * np.pi / 60
        self.steps = steps
        self.time = 2 * np.pi / self.spin

    def run(self, add: Any) -> tuple[Any, Any, float]:
        """Angles of the crank (k,), what ``record`` gave at each (k, …), seconds.

        ``add(mbs, position, velocity, angular_velocity)`` adds the rod and returns the markers of
        its bores and a function that tells its elastic coordinates.
        """
        mbs = exu.SystemContainer().AddSystem()
        # at bottom dead centre the rod lies along x, behind the crank's pin
        pin = np.array([-CRANK, 0.0, 0.0])
        markers, record = add(
            mbs, pin, [0.0, -CRANK * self.spin, 0.0], [0.0, 0.0, CRANK * self.spin / ROD]
        )
        still = mbs.AddMarker(
            eii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(eii.NodePointGround()), coordinate=0)
        )
        turning = mbs.AddNode(
            eii.NodeRigidBodyRxyz(
                referenceCoordinates=[0, 0, 0, 0, 0, np.pi],
                initialVelocities=[0, 0, 0, 0, 0, self.spin],
            )
        )
        crank = mbs.AddObject(
            eii.ObjectRigidBody(mass=2, inertia=[1e-3, 1e-3, 1e-3, 0, 0, 0], nodeNumber=turning)
        )
        for k in range(5):
            hold = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=turning, coordinate=k))
            mbs.AddObject(eii.CoordinateConstraint(markerNumbers=[still, hold]))
        turn = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=turning, coordinate=5))
        mbs.AddObject(
            eii.CoordinateConstraint(
                markerNumbers=[still, turn],
                offsetUserFunction=lambda mbs, t, item, offset: self.spin * t,
                offsetUserFunction_t=lambda mbs, t, item, offset: self.spin,
            )
        )
        for name, axes in (("front", [1, 1, 1]), ("back", [1, 1, 0])):
            place = [CRANK, 0, self.pins[name].middle[2]]
            web = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=crank, localPosition=place))
            mbs.AddObject(
                eii.SphericalJoint(markerNumbers=[web, markers[name]], constrainedAxes=axes)
            )
        guide = mbs.AddNode(eii.NodePoint(referenceCoordinates=[pin[0] + ROD, 0, 0]))
        piston = mbs.AddObject(eii.MassPoint(mass=PISTON, nodeNumber=guide))
        for k in (1, 2):
            hold = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=guide, coordinate=k))
            mbs.AddObject(eii.CoordinateConstraint(markerNumbers=[still, hold]))
        head = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=piston))
        mbs.AddObject(
            eii.SphericalJoint(markerNumbers=[head, markers["small"]], constrainedAxes=[1, 1, 0])
        )
        mbs.AddLoad(
            eii.LoadForceVector(
                markerNumber=head,
                loadVector=[0, 0, 0],
                loadVectorUserFunction=lambda mbs, t, load: [gas(np.pi + self.spin * t), 0, 0],
            )
        )
        heavy = mbs.AddMarker(eii.MarkerBodyMass(bodyNumber=piston))
        mbs.AddLoad(eii.LoadMassProportional(markerNumber=heavy, loadVector=GRAVITY))
        mbs.Assemble()

        angles: list[float] = []
        seen: list[Any] = []

        def after_step(mbs: Any, t: float) -> bool:
            angles.append(np.pi + self.spin * t)
            seen.append(record(mbs))
            return True

        mbs.SetPostStepUserFunction(after_step)
        settings = exu.SimulationSettings()
        run = settings.timeIntegration
        run.endTime, run.numberOfSteps = self.turns * self.time, self.turns * self.steps
        run.verboseMode = 0
        run.newton.useModifiedNewton = True
        run.newton.relativeTolerance, run.newton.absoluteTolerance = 1e-9, 1e-11
        run.generalizedAlpha.spectralRadius = 0.7
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        settings.solution.file.write = False
        start = time.perf_counter()
        mbs.SolveDynamic(settings)
        seconds = time.perf_counter() - start
        return np.array(angles[1:]), np.array(seen[1:]), seconds  # the first is the beginning


class FullRod:
    """All nodes of the mesh, in inertial coordinates, where M is constant.

    The elastic forces are those of u = Rᵀ(r - c) - X in mean axes: R is the polar factor of
    Xᵀ M r, and what a virtual turn of R does is taken out of them, so that they are the gradient
    of ½ uᵀKu. Neither a reduction nor a floating frame's inertia terms come in.
    """

    def __init__(self, body: Path, mesh: meshio.Mesh, pins: dict[str, Pin]) -> None:
        full = assembled(OUT / "rod_matrices.h5", body)
        rows = np.lexsort((full["component"], full["node"]))
        self.K, M = (full[name][rows][:, rows].tocsr() for name in "KM")
        self.M = M[::3][:, ::3]  # M is this times the unit matrix of the directions
        self.place, self.pins = mesh.points, pins
        self.shares = np.asarray(self.M.sum(axis=0)).ravel() / self.M.sum()
        self.X = self.place - self.shares @ self.place
        self.MX = self.M @ self.X
        assert abs(M - sp.kron(self.M, sp.eye(3))).max() < 1e-12 * abs(M).max()

    def forces(self, r: Any, v: Any) -> tuple[Any, Any, Any]:
        """Elastic and damping forces (N, 3) in the frame, the frame R, u (N, 3)."""
        U, _, Vt = np.linalg.svd(r.T @ self.MX)
        R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        there = (r - self.shares @ r) @ R
        turned = np.stack([np.cross(np.eye(3)[a], there) for a in range(3)])  # (3, N, 3)
        MZ = np.stack([np.cross(np.eye(3)[a], self.MX) for a in range(3)])
        inertia = np.einsum("aij,bij->ab", MZ, turned)
        w = (v - self.shares @ v) @ R
        spin = np.linalg.solve(inertia, np.einsum("aij,ij->a", MZ, w))
        u = there - self.X
        rate = w - np.einsum("a,aij->ij", spin, turned)
        g = (self.K @ (u + BETA * rate).ravel()).reshape(-1, 3)
        g -= np.einsum(
            "a,aij->ij", np.linalg.solve(inertia.T, np.einsum("aij,ij->a", turned, g)), MZ
        )
        return g, R, u

    def run(self, drive: Drive) -> tuple[Any, Any, float]:
        """Angles of the crank (k,), u at each (k, N, 3), seconds: by generalised alpha."""
        h, rho, n = drive.time / drive.steps, 0.7, self.X.size
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma = 0.5 + af - am
        beta = (gamma + 0.5) ** 2 / 4
        of_a, of_v = (1 - am) / (h * h * beta * (1 - af)), gamma / (h * beta)
        start = time.perf_counter()
        solve = splu((of_a * sp.kron(self.M, sp.eye(3)) + (1 + of_v * BETA) * self.K).tocsc()).solve
        means = np.zeros((n, 9))  # of the pins, three directions each
        for k, pin in enumerate(self.pins.values()):
            for axis in range(3):
                means[3 * pin.nodes + axis, 3 * k + axis] = pin.weights
        answers = solve(means)
        first = {name: 3 * k for k, name in enumerate(self.pins)}
        held = [
            first["front"],
            first["front"] + 1,
            first["front"] + 2,
            first["back"],
            first["back"] + 1,
            first["small"] + 1,
            first["small"],
        ]
        G = np.hstack([means[:, held].T, np.zeros((7, 1))])
        G[6, n] = -1.0  # the piston follows the small bore
        chosen = np.eye(9)[:, held]

        def wanted(t: float) -> Any:
            angle = np.pi + drive.spin * t
            x, y = CRANK * np.cos(angle), CRANK * np.sin(angle)
            return np.array([x, y, self.pins["front"].middle[2], x, y, 0.0, 0.0])

        def turned(x: Any, R: Any) -> Any:
            """The vectors of all nodes, columns of x (n, …), times R."""
            return np.einsum("ab,nb...->na...", R, x.reshape(-1, 3, *x.shape[1:])).reshape(x.shape)

        spin = np.array([0.0, 0.0, CRANK * drive.spin / ROD])
        start_at, speed = np.array([-CRANK, 0.0, 0.0]), np.array([0.0, -CRANK * drive.spin, 0.0])
        q = np.append((self.place + start_at).ravel(), ROD - CRANK)
        dq = np.append((speed + np.cross(spin, self.place)).ravel(), 0.0)
        ddq, a = np.zeros(n + 1), np.zeros(n + 1)
        weight = (self.M @ np.tile(GRAVITY, (n // 3, 1))).ravel()
        multipliers = np.zeros(7)
        angles, seen = [], []
        for step in range(1, drive.steps * drive.turns + 1):
            t = step * h
            q = q + h * dq + h * h * (0.5 - beta) * a
            dq = dq + h * (1 - gamma) * a
            a = (af * ddq - am * a) / (1 - am)
            q += h * h * beta * a
            dq += h * gamma * a
            ddq = np.zeros(n + 1)
            push = gas(np.pi + drive.spin * t) + PISTON * GRAVITY[0]
            for _ in range(30):
                g, R, _u = self.forces(q[:n].reshape(-1, 3), dq[:n].reshape(-1, 3))
                inertia = (self.M @ ddq[:n].reshape(-1, 3)).ravel()
                rest = np.append(inertia - weight + turned(g.ravel(), R), PISTON * ddq[n] - push)
                rest += G.T @ multipliers
                # the tangent is constant in the axes of the frame
                free = np.append(turned(solve(turned(rest[:n], R.T)), R), rest[n] / (of_a * PISTON))
                by_pins = turned(answers @ (np.kron(np.eye(3), R.T) @ chosen), R)
                by_pins = np.vstack([by_pins, G[:, n] / (of_a * PISTON)])
                change = np.linalg.solve(G @ by_pins, G @ q - wanted(t) - G @ free)
                delta = -(free + by_pins @ change)
                q += delta
                dq += of_v * delta
                ddq += of_a * delta
                multipliers += change
                if np.abs(delta).max() < 1e-13 * ROD:
                    break
            else:
                raise RuntimeError(f"no convergence at t = {t}")
            a += (1 - af) / (1 - am) * ddq
            angles.append(np.pi + drive.spin * t)
            seen.append(self.forces(q[:n].reshape(-1, 3), dq[:n].reshape(-1, 3))[2])
        return np.array(angles), np.array(seen), time.perf_counter() - start


def in_reduced(drive: Drive, rom: ReducedModel) -> tuple[Any, Any, float]:
    """Angles, elastic coordinates (k, m), seconds."""

    def add(mbs: Any, position: Any, velocity: Any, angular_velocity: Any) -> Any:
        added = add_body(
            exu,
            mbs,
            rom,
            position=position,
            velocity=velocity,
            angular_velocity=angular_velocity,
            gravity=GRAVITY,
        )
        node = added["modal_node"]
        return added["markers"], lambda mbs: mbs.GetNodeOutput(
            node, exu.OutputVariableType.Coordinates
        )

    return drive.run(add)


def von_mises_at(spots: list[int], rom: ReducedModel, q: Any) -> Any:
    """(k, spots): of the outputs that the claim is of."""
    parts = ("xx", "yy", "zz", "xy", "yz", "zx")
    rows = [rom.outputs.index(f"spot{node}.s{part}") for node in spots for part in parts]
    return von_mises((q @ rom.elastic().C[rows].T).reshape(len(q), -1, 6))


def prepare(size: float) -> tuple[Path, meshio.Mesh, dict[str, Pin], list[int]]:
    """The rod's body with the stress at its three hottest spots as outputs: nodes from 1."""
    body, path = OUT / "rod.h5", OUT / "rod.rom.h5"
    mesh, pins = rod(OUT / "rod.msh", size)
    description: dict[str, Any] = {
        "materials": {"steel": STEEL},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {
            name: {
                "coupling": "distributing",
                "nodes": name,
                "position": pin.middle.tolist(),
                "weights": pin.weights.tolist(),
            }
            for name, pin in pins.items()
        },
        "damping": {"beta": BETA},
    }
    import_description(description, "rod", body, mesh=mesh)
    flexgram("reduce", "-body", body, *BAND, "-mor_tol", "1e-3", "-mor_out", path)
    spots = [spot.node for spot in hot_spots(ReducedModel.load(path), 3)]
    description["outputs"] = {f"spot{n}": {"type": "stress", "nodes": [n]} for n in spots}
    import_description(description, "rod", body, mesh=mesh)
    return body, mesh, pins, spots


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rpm", type=float, nargs="+", default=[3000, 6000])
    parser.add_argument("--steps", type=int, default=1440, help="of a revolution")
    parser.add_argument("--size", type=float, default=0.02, help="of elements [m]")
    given = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    body, mesh, pins, spots = prepare(given.size)
    stresses, path = Stresses.load(body), OUT / "rod.rom.h5"
    rows = []
    figure, axes = plt.subplots(2, len(given.rpm), figsize=(10, 6), sharex=True, squeeze=False)
    for column, rpm in enumerate(given.rpm):
        drive = Drive(pins, rpm, given.steps, turns=2)
        angles, motion, seconds = FullRod(body, mesh, pins).run(drive)
        last = slice(-drive.steps, None)
        truth = von_mises(stresses.nodal(motion[last])[:, [node - 1 for node in spots]])
        degrees = np.degrees(angles[last]) - 540
        order = 0
        for title, options in (
            ("two_step, 1e-2", ("-mor_tol", "1e-2")),
            ("two_step, 1e-2, statics", ("-mor_tol", "1e-2", *STATICS[:2])),
            ("two_step, 1e-2, spin", ("-mor_tol", "1e-2", *STATICS[2:])),
            ("two_step, 1e-2, statics and spin", ("-mor_tol", "1e-2", *STATICS)),
            ("craig_bampton", ("-mor_method", "craig_bampton", "-mor_order", "{m}")),
            ("modal", ("-mor_method", "modal", "-mor_order", "{m}")),
            ("two_step, 1e-4, statics and spin", ("-mor_tol", "1e-4", *STATICS)),
        ):
            flexgram(
                "reduce",
                "-body",
                body,
                *BAND,
                "-mor_out",
                path,
                *(word.format(m=order) for word in options),
            )
            rom = ReducedModel.load(path)
            order = rom.order
            there, q, quick = in_reduced(drive, rom)
            assert np.allclose(there, angles)
            found = von_mises_at(spots, rom, q)[last]
            error = np.abs(found - truth)
            line: dict[str, Any] = {
                "rpm": int(rpm),
                "method": title,
                "order": rom.order,
                "claim": f"{rom.certified_error:.1e}",
            }
            for k, node in enumerate(spots):
                line[f"node_{node}"] = f"{error[:, k].max() / truth[:, k].max():.1e}"
            line |= {"seconds": f"{quick:.1f}", "full_seconds": f"{seconds:.1f}"}
            rows.append(line)
            print(line, flush=True)
            if title in DRAWN:
                worst = error.max(axis=1) / truth.max()
                axes[1][column].semilogy(degrees, worst, lw=1, label=f"{title}, m = {rom.order}")
        half = Drive(pins, rpm, 2 * given.steps, turns=2)
        finer = FullRod(body, mesh, pins).run(half)[1][1::2][last]
        error = np.abs(von_mises(stresses.nodal(finer)[:, [node - 1 for node in spots]]) - truth)
        line = dict.fromkeys(rows[-1], "") | {"rpm": int(rpm), "method": "all nodes, half the step"}
        for k, node in enumerate(spots):
            line[f"node_{node}"] = f"{error[:, k].max() / truth[:, k].max():.1e}"
        rows.append(line)
        print(line, flush=True)
        for k, node in enumerate(spots):
            axes[0][column].plot(
                degrees, 1e-6 * truth[:, k], lw=1.2, color=f"C{k}", label=f"node {node}, full"
            )
            axes[0][column].plot(
                degrees, 1e-6 * found[:, k], "--", lw=2.4, color=f"C{k}", alpha=0.5, label="reduced"
            )
        axes[0][column].set(title=f"{rpm:g} rpm, 3 of {len(mesh.points)} nodes")
        axes[1][column].set(xlabel="crank past bottom dead centre [°]")
    axes[0][0].set(ylabel="von Mises stress [MPa]")
    axes[1][0].set(ylabel="difference over the largest")
    for panel in axes.ravel():
        panel.grid(alpha=0.3)
    axes[0][0].legend(fontsize=7)
    axes[1][0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(ROOT / "docs" / "images" / "crank.png", dpi=110)
    write_table(RESULTS / "crank.csv", rows)
    print(f"{mesh.points.size} dofs")


if __name__ == "__main__":
    main()
