"""Bodies with many modes: time, memory, claim and true error as the band of a thin plate grows.

Writes benchmarks/results/many_modes.csv. `--beside PROGRAM` runs another build in turn.

    benchmarks/run many_modes [--bands 200 1000 3000] [--runs 3] [--ranks 1] [--checks 6]
                              [--beside PROGRAM]
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path
from typing import Any

import common
import h5py
import numpy as np
from common import OUT, RESULTS, flexgram, write_table
from methods import SHAPES, full_response, unit

from bodies import box, write_body_file
from flexgram import ReducedModel

TOLERANCE = 1e-3
FROM = 10  # [Hz]


def reduced(body: Path, last: int, ranks: int) -> dict[str, float]:
    """One run: time without reading and assembling [s], peak memory, the plan's numbers."""
    rom = OUT / "rom.h5"
    flexgram(
        *("reduce", "-body", body, "-mor_band_hz", f"{FROM},{last}", "-mor_tol", TOLERANCE),
        *("-mor_out", rom),
        ranks=ranks,
    )
    with h5py.File(rom) as file:
        log = file["log"]
        seconds = sum(
            s for name, s in log["seconds"].attrs.items() if name not in ("partition", "assemble")
        )
        return {
            "seconds": float(seconds),
            "peak_mb": float(log.attrs["peak_memory_mb_per_rank"]),
            "medium": int(log.attrs["medium_order"]),
            "order": file["K"].shape[0],
            "bound": float(file["error/bound"][:].max()),
        }


def true_error(reference: tuple[Any, Any]) -> float:
    """Of the last reduced body, relative to H at frequencies that the reduction did not choose."""
    omega, H = reference
    lost = ReducedModel.load(OUT / "rom.h5", basis=False).transfer(omega) - H
    return float((np.linalg.norm(lost, axis=(1, 2)) / np.linalg.norm(H, axis=(1, 2))).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bands", type=int, nargs="+", default=[200, 1000, 3000], help="[Hz]")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--checks", type=int, default=6, help="full solves of the true error")
    parser.add_argument("--beside", type=Path, help="another build of flexgram")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    body, undamped = OUT / "plate.h5", OUT / "undamped.h5"
    counts, edges = SHAPES["plate"]
    mesh = box("tetra10", counts[100], edges, distort=False)
    ends = {n: {"set": n, "coupling": "rigid"} for n in ("start", "end")}
    write_body_file(body, mesh, interfaces=ends, damping=(2.0, 1e-6, 0))
    write_body_file(undamped, mesh, interfaces=ends)
    real, _ = unit(undamped, options.ranks, 3)
    programs = {"this": common.PROGRAM}
    if options.beside:
        programs["beside"] = options.beside
    rows = []
    for last in options.bands:
        reference = full_response(body, f"{FROM},{last}", options.ranks, options.checks)
        runs: dict[str, list[dict[str, float]]] = {name: [] for name in programs}
        errors = {}
        for _ in range(options.runs):
            for name, program in programs.items():
                common.PROGRAM = program
                runs[name].append(reduced(body, last, options.ranks))
                errors[name] = true_error(reference)
        common.PROGRAM = programs["this"]
        for name, of in runs.items():
            seconds = statistics.median(run["seconds"] for run in of)
            row = {"program": name, "band_hz": f"{FROM}-{last}", **of[-1], "seconds": seconds}
            rows.append({**row, "error": errors[name], "unit_s": real, "units": seconds / real})
            print(rows[-1], flush=True)
    write_table(RESULTS / "many_modes.csv", rows)


if __name__ == "__main__":
    main()
