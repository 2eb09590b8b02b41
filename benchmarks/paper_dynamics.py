"""The paper's section 3.2 on our rack: figure 7 and table 1.

The rack is clamped at its lower plate and loaded at the upper by F = (0, 0, -10000 sin(2 10 pi t))
N for one second, from rest. Full model and reduced bodies by the same integrator, PETSc's
generalised alpha of second order (steps of 0.1 ms); the reduced bodies also exactly
(``ReducedModel.simulate``), and in EXUDYN as free bodies with a floating frame, held by a joint.
Computing times are of the integration alone, medians of five, relative to two-step.

Krylov has all that four moments at both ends and the middle of the band span (the paper: 63).

    benchmarks/run dynamics        (needs petsc4py and exudyn)
"""

from __future__ import annotations

import statistics
import sys
import time
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import petsc4py

petsc4py.init(sys.argv[:1])
from common import ROOT, assembled, flexgram  # noqa: E402
from peers import ALPHA, BETA, clamped_rack  # noqa: E402
from petsc4py import PETSc  # noqa: E402

from flexgram import ReducedModel  # noqa: E402

OUT = ROOT / "out" / "paper"
STEP, END = 1e-4, 1.0
#: name, method, options of the clamped body, the paper's time
BODIES = (
    ("two-step", "two_step", (), 1.0),
    ("POD", "pod", ("-mor_samples", "30"), 1.57),
    ("Krylov", "krylov", ("-mor_moments", "4"), 8.05),
    ("modal", "modal", ("like two-step",), None),
)


def force(t: Any) -> Any:
    return -10000 * np.sin(2 * 10 * np.pi * t)


def dense(a: Any) -> Any:
    matrix = PETSc.Mat().createDense(a.shape, array=np.asfortranarray(a), comm=PETSc.COMM_SELF)
    matrix.assemble()
    return matrix


def sparse(a: Any) -> Any:
    csr = a.tocsr()
    matrix = PETSc.Mat().createAIJ(
        csr.shape, csr=(csr.indptr, csr.indices, csr.data), comm=PETSc.COMM_SELF
    )
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix


def integrate(
    M: Any, D: Any, K: Any, load: Any, output: Any, package: str
) -> tuple[Any, Any, float]:
    """Times, output over time, seconds, by generalised alpha with one factorisation."""
    u, v = M.createVecRight(), M.createVecRight()
    residual = u.duplicate()
    J = K.duplicate(copy=True)

    def function(ts: Any, t: float, u: Any, v: Any, a: Any, F: Any) -> None:
        M.mult(a, F)
        D.multAdd(v, F, F)
        K.multAdd(u, F, F)
        F.axpy(-force(t), load)

    def jacobian(
        ts: Any,
        t: float,
        u: Any,
        v: Any,
        a: Any,
        sv: float,
        sa: float,
        A: Any,
        P: Any,
    ) -> None:
        A.zeroEntries()
        for factor, matrix in ((1.0, K), (sv, D), (sa, M)):  # patterns differ
            A.axpy(factor, matrix)

    ts = PETSc.TS().create(comm=PETSc.COMM_SELF)
    # PETSc 3.18 takes the first of its two stages wrong if the problem is declared linear.
    ts.setProblemType(PETSc.TS.ProblemType.NONLINEAR)
    ts.setType("alpha2")
    ts.setI2Function(function, residual)
    ts.setI2Jacobian(jacobian, J)
    ts.setTimeStep(STEP)
    ts.setMaxTime(END)
    ts.setExactFinalTime(PETSc.TS.ExactFinalTime.STEPOVER)
    snes = ts.getSNES()
    options = PETSc.Options()
    options["snes_lag_jacobian"] = options["snes_lag_preconditioner"] = 1
    snes.setFromOptions()
    ksp = snes.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("cholesky")
    ksp.getPC().setFactorSolverType(package)
    times, values = [], []

    def monitor(ts: Any, step: int, t: float, u: Any) -> None:
        times.append(t)
        values.append(output.dot(u))
        if step == 1:  # the first step halves itself; from here on one factorisation serves all
            options["snes_lag_jacobian"] = options["snes_lag_preconditioner"] = -2
            snes.setFromOptions()

    ts.setMonitor(monitor)
    ts.setSolution2(u, v)
    start = time.perf_counter()
    ts.solve(u)
    seconds = time.perf_counter() - start
    return np.array(times), np.array(values), seconds


def reduced_dynamics(model: ReducedModel) -> tuple[Any, Any, float]:
    port = model.inputs.index("upper.fz")
    load, output = (
        PETSc.Vec().createWithArray(a.copy(), comm=PETSc.COMM_SELF)
        for a in (model.B[:, port], model.C[port])
    )
    matrices = [dense(a) for a in (model.M, model.D, model.K)]
    runs = [integrate(*matrices, load, output, "petsc") for _ in range(5)]
    return *runs[0][:2], statistics.median(r[2] for r in runs)


def in_exudyn(model: ReducedModel) -> tuple[Any, Any, float]:
    """The free body with a floating frame, held at its lower plate by a joint."""
    import exudyn as exu
    import exudyn.itemInterface as eii

    from flexgram.exporters.exudyn import add_body
    from flexgram.model.geometry import interface_positions

    def once() -> tuple[Any, Any, float]:
        mbs = exu.SystemContainer().AddSystem()
        markers = add_body(exu, mbs, model)["markers"]
        ground = mbs.AddObject(eii.ObjectGround())
        at = interface_positions(model)["lower"].tolist()
        wall = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground, localPosition=at))
        mbs.AddObject(
            eii.GenericJoint(markerNumbers=[wall, markers["lower"]], constrainedAxes=[1] * 6)
        )
        mbs.AddLoad(
            eii.LoadForceVector(
                markerNumber=markers["upper"],
                loadVector=[0, 0, 1],
                loadVectorUserFunction=lambda mbs, t, load: [0, 0, float(force(t))],
            )
        )
        sensor = mbs.AddSensor(
            eii.SensorMarker(
                markerNumber=markers["upper"],
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Position,
            )
        )
        mbs.Assemble()
        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(END / STEP)
        settings.timeIntegration.endTime = END
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = STEP
        start = time.perf_counter()
        mbs.SolveDynamic(settings)
        seconds = time.perf_counter() - start
        data = mbs.GetSensorStoredData(sensor)
        return data[:, 0], data[:, 3] - data[0, 3], seconds

    runs = [once() for _ in range(3)]
    return *runs[0][:2], statistics.median(r[2] for r in runs)


def main() -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    (ROOT / "out" / "bench").mkdir(parents=True, exist_ok=True)
    body, free = clamped_rack(), ROOT / "out" / "rack.h5"
    full = assembled(OUT / "clamped.h5", ROOT / "out" / "bench" / "clamped_mesh.h5")
    names = [str(x.decode() if isinstance(x, bytes) else x) for x in full["names"]]
    column = full["B"][:, names.index("upper.fz")]
    load = PETSc.Vec().createWithArray(column.copy(), comm=PETSc.COMM_SELF)
    M, K = sparse(full["M"]), sparse(full["K"])
    D = sparse(ALPHA * full["M"] + BETA * full["K"])
    t, reference, full_seconds = integrate(M, D, K, load, load.copy(), "mumps")
    print(
        f"full model, n = {len(column)}: largest |u_z| {np.abs(reference).max():.3e} m, "
        f"{full_seconds:.2f} s for {len(t) - 1} steps"
    )

    rows: list[tuple[Any, ...]] = []
    curves = {"full model": (t, reference)}
    order = 0
    for name, method, given, paper in BODIES:
        like = given == ("like two-step",)
        options = ("-mor_order", order) if like else given
        rom, moving = OUT / f"dynamics_{method}.h5", OUT / f"dynamics_free_{method}.h5"
        flexgram("reduce", "-body", body, "-mor_method", method, "-mor_out", rom, *options)
        model = ReducedModel.load(rom)
        order = order or model.order
        _, y, seconds = reduced_dynamics(model)
        port = model.inputs.index("upper.fz")
        forces = np.zeros((len(t), len(model.inputs)))
        forces[:, port] = force(t)
        exact = model.simulate(forces, t)[0][:, port]
        error = [np.abs(x - reference).max() / np.abs(reference).max() for x in (y, exact)]
        line: tuple[Any, ...] = (name, model.order, seconds, paper, *error)
        if method != "pod":  # the paper's POD mixes rigid motion into its basis: no floating frame
            size = ("-mor_order", order + 6) if like else given
            flexgram("reduce", "-body", free, "-mor_method", method, "-mor_out", moving, *size)
            at, z, multibody = in_exudyn(ReducedModel.load(moving))
            there = np.interp(at, t, reference)
            line += (multibody, np.abs(z - there).max() / np.abs(reference).max())
            if method == "two_step":
                curves["two-step in EXUDYN"] = (at, z)
        curves[f"{name}, m = {model.order}"] = (t, y)
        rows.append(line)
    unit = rows[0][2]
    print("error: largest difference from the full model, relative to its largest displacement")
    print(
        f"{'body':10s} {'m':>3s} {'time':>7s} {'paper':>7s} {'error':>9s} {'simulate':>9s}"
        f" {'EXUDYN s':>9s} {'error':>9s}"
    )
    for name, m, seconds, paper, error_ts, error_exact, *more in rows:
        known = f"{paper:7.2f}" if paper else "      -"
        tail = f" {more[0]:9.2f} {more[1]:9.1e}" if more else ""
        print(
            f"{name:10s} {m:3d} {seconds / unit:7.2f} {known} {error_ts:9.1e} {error_exact:9.1e}"
            + tail
        )
    print(f"{'FEM':10s} {len(column):3d} {full_seconds / unit:7.1f}   161.3")

    figure, axes = plt.subplots(2, 1, figsize=(7, 6), sharex=True)
    for label, (x, y) in curves.items():
        axes[0].plot(x, 1e3 * y, label=label, lw=1)
        if label != "full model":
            axes[1].semilogy(x, np.abs(y - np.interp(x, t, reference)) + 1e-15, label=label, lw=1)
    axes[0].set(ylabel="u_z of the upper plate [mm]")
    axes[1].set(ylabel="difference from the full model [m]", xlabel="t [s]")
    for panel in axes:
        panel.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(OUT / "figure7.png", dpi=150)
    print(f"figure 7 is {OUT / 'figure7.png'}")


if __name__ == "__main__":
    main()
