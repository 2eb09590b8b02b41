"""Ten small bodies out of one certified medium model, from Python: the block of 102,675 dofs.

Writes benchmarks/results/cuts.csv: seconds of ``certify``, then of each ``Medium.reduce``.
"""

from __future__ import annotations

import csv
import time

from common import OUT, RESULTS
from methods import ENDS, SHAPES

import flexgram
from bodies import box, write_body_file

REQUESTS = [
    *({"tol": 10.0**-k} for k in range(1, 8)),
    {"tol": 1e-4, "method": "krylov"},
    {"method": "modal"},
    {"tol": 1e-4, "method": "craig_bampton"},
]


def main() -> None:
    counts, size = SHAPES["block"][0][100], SHAPES["block"][1]
    body = OUT / "block100.h5"
    OUT.mkdir(parents=True, exist_ok=True)
    write_body_file(
        body, box("tetra10", counts, size, distort=False), interfaces=ENDS, damping=(2.0, 1e-6, 0.0)
    )
    begin = time.perf_counter()
    medium = flexgram.certify(body, band_hz=(10, 1000), tol=1e-8)
    rows = [["certify, tol 1e-8", medium.order, f"{time.perf_counter() - begin:.2f}"]]
    begin = time.perf_counter()
    for request in REQUESTS:
        before = time.perf_counter()
        rom = medium.reduce(**request)
        words = ", ".join(f"{k} {v:g}" if k == "tol" else str(v) for k, v in request.items())
        rows.append([words, rom.order, f"{time.perf_counter() - before:.2f}"])
    rows.append(["ten together", "", f"{time.perf_counter() - begin:.2f}"])
    with (RESULTS / "cuts.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["request", "order", "seconds"], *rows])
    for row in rows:
        print(*row, sep="  ")


if __name__ == "__main__":
    main()
