"""What loss factors by material, relaxation and a parameter cost beside one loss factor.

A clamped block of two materials (Tet10) with one interface, 10-500 Hz, 1e-3. In turn with the same
loss factor for both (``eta``), with two (``S``), with two Prony terms of the rubber and αM
(``prony``), and with a modulus of the rubber known within a factor of 4 (``parameter``). Writes
benchmarks/results/losses.csv.
Arguments: cells along the length (default 12 36: 5,500 and 133,000 dofs), runs (``--runs 3``).
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import OUT, PROGRAM, RESULTS, write_table

from bodies import box
from flexgram.body.description import import_description

PRONY = {"viscoelastic": {"prony": [[0.3, 1e-3], [0.2, 1e-4]]}}
#: What materials have beside their moduli, and the body.
KINDS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, float]]] = {
    "eta": ({"loss_factor": 0.05}, {"loss_factor": 0.05}, {}),
    "S": ({"loss_factor": 0.001}, {"loss_factor": 0.2}, {}),
    "prony": ({}, PRONY, {"alpha": 5.0}),
    "parameter": ({"loss_factor": 0.05}, {"loss_factor": 0.05, "parameter": {"E": [1e9, 4e9]}}, {}),
}


def write_body(path: Path, cells: int, kind: str) -> None:
    of_steel, of_rubber, damping = KINDS[kind]
    mesh = box("tetra10", (cells, cells // 3, cells // 3), (1.2, 0.4, 0.4), distort=False)
    first = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 0] < 0.4
    mesh.cell_sets = {"mount": [np.flatnonzero(first)], "part": [np.flatnonzero(~first)]}
    steel = {"E": 210e9, "nu": 0.3, "rho": 7850.0, **of_steel}
    rubber = {"E": 2e9, "nu": 0.4, "rho": 1200.0, **of_rubber}
    description = {
        "materials": {"steel": steel, "rubber": rubber},
        "regions": {"mount": {"material": "rubber"}, "part": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "damping": damping,
    }
    import_description(description, "block", path, mesh=mesh)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("cells", nargs="*", type=int, default=[12, 36])
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, str]] = []
    for cells in options.cells:
        for kind in KINDS:
            write_body(OUT / f"losses.{kind}.h5", cells, kind)
        seconds: dict[str, list[float]] = {kind: [] for kind in KINDS}
        facts = {}
        for _ in range(options.runs):
            for kind in KINDS:
                band = ("-mor_band_hz", "10,500", "-mor_tol", "1e-3", "-mor_monitor", "detail")
                out = ("-mor_out", OUT / "losses.rom.h5")
                begin = time.perf_counter()
                command = [PROGRAM, "reduce", "-body", OUT / f"losses.{kind}.h5", *band, *out]
                said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
                seconds[kind].append(time.perf_counter() - begin)
                facts[kind] = {
                    "dofs": re.search(r"n = (\d+)", said)[1],
                    "medium order": re.search(r"medium model +order (\d+)", said)[1],
                    "order": re.search(r"m = (\d+) of", said)[1],
                    "claim": re.search(r"\n  error +at most (\S+)", said)[1],
                }
        base = statistics.median(seconds["eta"])
        for kind in KINDS:
            median = statistics.median(seconds[kind])
            row = {"damping": kind, "seconds": f"{median:.2f}", "over eta": f"{median / base:.2f}"}
            rows.append({**facts[kind], **row})
            print(rows[-1], flush=True)
    write_table(RESULTS / "losses.csv", rows)


if __name__ == "__main__":
    main()
