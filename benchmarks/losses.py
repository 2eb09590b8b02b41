"""What loss factors by material cost beside one loss factor.

A clamped block of two materials (Tet10) with one interface, 10-500 Hz, 1e-3. In turn with the same
loss factor for both (``eta``) and with two (``S``). Writes benchmarks/results/losses.csv.
Arguments: cells along the length (default 12 36: 5,500 and 133,000 dofs), runs (``--runs 3``).
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import time
from pathlib import Path

import numpy as np
from common import OUT, PROGRAM, RESULTS, write_table

from bodies import box
from flexgram.body.description import import_description


def write_body(path: Path, cells: int, losses: tuple[float, float]) -> None:
    mesh = box("tetra10", (cells, cells // 3, cells // 3), (1.2, 0.4, 0.4), distort=False)
    first = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 0] < 0.4
    mesh.cell_sets = {"mount": [np.flatnonzero(first)], "part": [np.flatnonzero(~first)]}
    steel = {"E": 210e9, "nu": 0.3, "rho": 7850.0, "loss_factor": losses[0]}
    rubber = {"E": 2e9, "nu": 0.4, "rho": 1200.0, "loss_factor": losses[1]}
    description = {
        "materials": {"steel": steel, "rubber": rubber},
        "regions": {"mount": {"material": "rubber"}, "part": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
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
        kinds = {"eta": (0.05, 0.05), "S": (0.001, 0.2)}
        for kind, losses in kinds.items():
            write_body(OUT / f"losses.{kind}.h5", cells, losses)
        seconds: dict[str, list[float]] = {kind: [] for kind in kinds}
        facts = {}
        for _ in range(options.runs):
            for kind in kinds:
                band = ("-mor_band_hz", "10,500", "-mor_tol", "1e-3")
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
        for kind in kinds:
            median = statistics.median(seconds[kind])
            row = {"damping": kind, "seconds": f"{median:.2f}", "over eta": f"{median / base:.2f}"}
            rows.append({**facts[kind], **row})
            print(rows[-1], flush=True)
    write_table(RESULTS / "losses.csv", rows)


if __name__ == "__main__":
    main()
