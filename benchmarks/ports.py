"""Hundreds of ports: forces at nodes of the faces of a block, to 1e-3 of each kind.

Writes benchmarks/results/ports.csv. Arguments: numbers of ports (default 60 100 200 300).
"""

from __future__ import annotations

import csv
import sys
import time

import numpy as np
from common import OUT, RESULTS, assembled
from methods import ENDS, SHAPES

import flexgram
from bodies import box, write_body_file


def main() -> None:
    counts = [int(word) for word in sys.argv[1:]] or [60, 100, 200, 300]
    OUT.mkdir(parents=True, exist_ok=True)
    mesh = box("tetra10", SHAPES["block"][0][6], SHAPES["block"][1], distort=False)
    write_body_file(OUT / "block6.h5", mesh, interfaces=ENDS)
    body = assembled(OUT / "block6_matrices.h5", OUT / "block6.h5")
    n = body["K"].shape[0]
    rng = np.random.default_rng(1)
    dofs = rng.permutation(np.flatnonzero(body["component"] < 3))
    rows = []
    for ports in counts:
        B = np.zeros((n, ports))
        B[dofs[:ports], range(ports)] = 1.0
        matrices = flexgram.Matrices(K=body["K"], M=body["M"], B=B, alpha=2.0, beta=1e-6)
        begin = time.perf_counter()
        rom = flexgram.reduce(matrices, band_hz=(10, 1000), tol=1e-3)
        seconds = time.perf_counter() - begin
        medium = int(rom.log["medium_order"])
        rows.append([n, ports, medium, rom.order, f"{rom.certified_error:.1e}", f"{seconds:.2f}"])
        print(*rows[-1], sep="  ", flush=True)
    with (RESULTS / "ports.csv").open("w", newline="") as file:
        head = ["dofs", "ports", "medium order", "order", "certified", "seconds"]
        csv.writer(file).writerows([head, *rows])


if __name__ == "__main__":
    main()
