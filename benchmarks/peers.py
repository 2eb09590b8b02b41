"""The rack beside what other tools make of it, at the same order: largest error and wall time.

The rack is clamped at its lower plate (balanced truncation by Lyapunov equations and IRKA want a
stable body; the free one has poles at zero), ports at the upper, 10-500 Hz. pyMOR's second-order
balanced truncation and IRKA, and the paper's first route in plain SciPy (sparse LU of 30 samples,
SVD), each in this process on the same matrices; flexgram by its whole command, reading included.
Errors are eq. (17) at 200 frequencies of a full sweep. One BLAS thread. Needs pymor from PyPI:
``benchmarks/run peers`` installs it.

    benchmarks/run peers [--order 20] [--limit 1200] [--only scipy ...]
"""

from __future__ import annotations

import argparse
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.sparse.linalg as spla
import yaml
from common import OUT, ROOT, assembled, flexgram, matrices_of, transfer, write_table

from flexgram import import_body

ALPHA, BETA = 2.4, 6e-6
Reduced = tuple[Any, Any, Any, Any]  # M, D, K, B


def clamped_rack() -> Path:
    """Body of matrices of the rack without its lower plate's motion."""
    description = yaml.safe_load((ROOT / "meshes" / "rack.yaml").read_text())
    description["mesh"] = str(ROOT / "meshes" / "rack.msh")
    description["interfaces"].pop("lower")
    description["supports"] = {"base": {"nodes": "lower_plate"}}
    (OUT / "clamped.yaml").write_text(yaml.safe_dump(description))
    import_body(OUT / "clamped.yaml", OUT / "clamped_mesh.h5")
    flexgram("assemble", "-body", OUT / "clamped_mesh.h5", "-body_out", OUT / "clamped.h5")
    return OUT / "clamped.h5"


def by_flexgram(body: Path, order: int, method: str) -> Callable[[], Reduced]:
    def reduce() -> Reduced:
        rom = OUT / "peer.rom.h5"
        flexgram(
            "reduce", "-body", body, "-mor_order", order, "-mor_method", method, "-mor_out", rom
        )
        return matrices_of(rom)

    return reduce


def project(matrices: dict[str, Any], V: Any) -> Reduced:
    M, K = (V.T @ (matrices[name] @ V) for name in ("M", "K"))
    return M, ALPHA * M + BETA * K, K, V.T @ matrices["B"]


def by_scipy(matrices: dict[str, Any], order: int, samples: int = 30) -> Callable[[], Reduced]:
    def reduce() -> Reduced:
        M, K, B = matrices["M"].tocsc(), matrices["K"].tocsc(), matrices["B"]
        first, last = 2 * np.pi * 10, 2 * np.pi * 500
        parts = []
        for omega in first + (last - first) * (np.arange(samples) + 0.5) / samples:
            A = (1 + 1j * omega * BETA) * K + (1j * omega * ALPHA - omega**2) * M
            X = spla.splu(A).solve(B.astype(complex))
            parts += [X.real, X.imag]
        Z = np.hstack(parts)
        return project(matrices, np.linalg.svd(Z, full_matrices=False)[0][:, :order])

    return reduce


def by_pymor(matrices: dict[str, Any], order: int, method: str) -> Callable[[], Reduced]:
    def reduce() -> Reduced:
        from pymor.core.logger import set_log_levels
        from pymor.models.iosys import SecondOrderModel
        from pymor.reductors.sobt import SOBTpReductor
        from pymor.reductors.sor_irka import SORIRKAReductor

        set_log_levels({"pymor": "ERROR"})
        M, K, B = matrices["M"].tocsc(), matrices["K"].tocsc(), matrices["B"]
        fom = SecondOrderModel.from_matrices(M, ALPHA * M + BETA * K, K, B, B.T)
        if method == "balanced":
            rom = SOBTpReductor(fom).reduce(order)
        else:
            rom = SORIRKAReductor(fom).reduce(order, maxit=20)
        dense = [np.asarray(op.matrix) for op in (rom.M, rom.E, rom.K)]
        return (*dense, np.asarray(rom.B.matrix), np.asarray(rom.Cp.matrix))  # type: ignore[return-value]

    return reduce


def largest_error(rom: Any, omega: Any, H: Any) -> float:
    M, D, K, B = rom[:4]
    C = rom[4] if len(rom) > 4 else B.T
    return max(
        float(
            np.linalg.norm(h - C @ np.linalg.solve(K + 1j * w * D - w**2 * M, B))
            / np.linalg.norm(h)
        )
        for w, h in zip(omega, H, strict=True)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--order", type=int, default=20)
    parser.add_argument("--limit", type=int, default=1200, help="seconds for each")
    parser.add_argument("--only", nargs="+", default=[], help="part of the names to run")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    body = clamped_rack()
    matrices = assembled(OUT / "clamped.h5", OUT / "clamped_mesh.h5")
    flexgram(
        "sweep", "-body", body, "-mor_sweep_hz", "10,500,200", "-mor_sweep_out", OUT / "full.h5"
    )
    omega, H = transfer(OUT / "full.h5")
    m = options.order
    peers = {
        "flexgram two_step": by_flexgram(body, m, "two_step"),
        "flexgram pod, 30 samples": by_flexgram(body, m, "pod"),
        "SciPy sparse LU and POD, 30 samples": by_scipy(matrices, m),
        "pyMOR second-order IRKA": by_pymor(matrices, m, "irka"),
        "pyMOR second-order balanced truncation": by_pymor(matrices, m, "balanced"),
    }
    rows = []

    def stop(*_: Any) -> None:
        raise TimeoutError(f"stopped after {options.limit} s")

    signal.signal(signal.SIGALRM, stop)
    for name, reduce in peers.items():
        if options.only and not any(part in name for part in options.only):
            continue
        start, note, error = time.perf_counter(), "", float("nan")
        signal.alarm(options.limit)
        try:
            rom = reduce()
            seconds = time.perf_counter() - start
            error = largest_error(rom, omega, H)
        except Exception as failure:  # a peer may not converge: that is a result too
            seconds, note = time.perf_counter() - start, f"{type(failure).__name__}: {failure}"
        signal.alarm(0)
        rows.append({"method": name, "order": m, "seconds": seconds, "error": error, "note": note})
        print(f"{name:40s} m = {m}  {seconds:8.2f} s  error {error:.1e}  {note}", flush=True)
    write_table(OUT / "peers.csv", rows)
    with h5py.File(OUT / "full.h5") as file:
        print(f"rack clamped: n = {matrices['K'].shape[0]}, {file['omega'].shape[0]} frequencies")


if __name__ == "__main__":
    main()
