"""Thousands of ports: each translation of each node of two faces, reduced for its leading patterns.

A block of 100,000 dofs (Tet10), 10-1000 Hz, 1e-3; random loads in the span of the patterns, at a
frequency of this script, against a solve of the body itself. Writes benchmarks/results/faces.csv.
Arguments: numbers of patterns (default 30 100 200).
"""

from __future__ import annotations

import csv
import re
import sys
import time

import h5py
import numpy as np
import scipy.sparse as sp
from common import OUT, RESULTS, assembled, flexgram, matrices_of, transfer
from methods import SHAPES

from bodies import box, write_body_file
from flexgram.body.bodyfile import write_matrices

HZ, ALPHA, BETA = 437.0, 2.0, 1e-6


def main() -> None:
    counts = [int(word) for word in sys.argv[1:]] or [30, 100, 200]
    OUT.mkdir(parents=True, exist_ok=True)
    mesh = box("tetra10", SHAPES["block"][0][100], SHAPES["block"][1], distort=False)
    ends = {name: {"set": name, "coupling": "distributing"} for name in ("start", "end")}
    write_body_file(OUT / "faces_mesh.h5", mesh, interfaces=ends)
    body = assembled(OUT / "faces_matrices.h5", OUT / "faces_mesh.h5")
    with h5py.File(OUT / "faces_matrices.h5") as file:
        x = file["nodes/position"][:][file["dofs/node"][:], 0]
    n = len(x)
    rows = np.flatnonzero(
        (np.isclose(x, x.min()) | np.isclose(x, x.max())) & (body["component"] < 3)
    )
    B = sp.csr_matrix((np.ones(len(rows)), (rows, range(len(rows)))), shape=(n, len(rows)))
    node, direction = body["node"][rows], body["component"][rows]
    names = [f"n{label}.f{'xyz'[c]}" for label, c in zip(node, direction, strict=True)]
    path = OUT / "faces.h5"
    write_matrices(path, body["K"], body["M"], B, inputs=names, alpha=ALPHA, beta=BETA)
    omega = 2 * np.pi * HZ
    table = []
    for count in counts:
        begin = time.perf_counter()
        said = flexgram(
            "reduce",
            "-body",
            path,
            "-mor_band_hz",
            "10,1000",
            "-mor_tol",
            "1e-3",
            "-mor_load_patterns",
            count,
            "-mor_out",
            OUT / "faces.rom.h5",
        )
        seconds = time.perf_counter() - begin
        M, D, K, B_r = matrices_of(OUT / "faces.rom.h5")
        with h5py.File(OUT / "faces.rom.h5") as file:
            P, claim = file["loads/patterns"][:], file["error"].attrs["worst"]
        loads = P @ np.random.default_rng(2).standard_normal((count, 12))
        sweep = OUT / "faces_loads.h5"
        write_matrices(sweep, body["K"], body["M"], B @ loads, C=(B @ P).T, alpha=ALPHA, beta=BETA)
        flexgram(
            "sweep",
            "-body",
            sweep,
            "-mor_sweep_hz",
            f"{HZ},{HZ},1",
            "-mor_sweep_out",
            OUT / "faces.sweep.h5",
        )
        H = transfer(OUT / "faces.sweep.h5")[1][0]
        H_r = (B_r @ P).T @ np.linalg.solve(K + 1j * omega * D - omega**2 * M, B_r @ loads)
        error = np.linalg.norm(H_r - H) / np.linalg.norm(H)
        peak = re.search(r"peak (\d+) MB", said)
        assert peak
        table.append(
            [n, len(rows), count, len(K), f"{claim:.1e}", f"{error:.1e}", f"{seconds:.0f}", peak[1]]
        )
        print(*table[-1], sep="  ", flush=True)
    with (RESULTS / "faces.csv").open("w", newline="") as file:
        head = [
            "dofs",
            "ports",
            "patterns",
            "order",
            "certified",
            f"random loads at {HZ:g} Hz",
            "seconds",
            "MB",
        ]
        csv.writer(file).writerows([head, *table])


if __name__ == "__main__":
    main()
