"""Wall time and peak memory against true error and certified bound, for every method.

Generated Tet10 bodies, cube-like and thin-walled, free, twelve ports, Rayleigh damping. Beside
them, from the same run, the machine's own unit: one real (and one complex) factorisation and one
block solve of the same matrix. Writes
benchmarks/results/methods.csv and out/bench/methods.png. Long for large ones.

    benchmarks/run methods [--sizes 6 30 100] [--methods two_step pod ...] [--runs 3] [--ranks 1]
                  [--checks 12]
"""

from __future__ import annotations

import argparse
import re
import statistics
from pathlib import Path
from typing import Any

import h5py
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from common import OUT, RESULTS, flexgram, write_table

from bodies import box, write_body_file
from flexgram import ReducedModel

ENDS = {name: {"set": name, "coupling": "rigid"} for name in ("start", "end")}
#: Elements along the edges and edges [m] by shape and thousands of dofs.
SHAPES = {
    "block": ({6: (11, 6, 3), 30: (20, 10, 5), 100: (31, 16, 8), 250: (43, 22, 11)}, (4, 2, 1)),
    "plate": ({6: (20, 10, 1), 30: (46, 23, 1), 100: (84, 42, 1), 250: (132, 66, 1)}, (4, 2, 0.05)),
}
METHODS = {
    "two_step": ("-mor_tol", "1e-6", "-mor_tol_of", "whole"),
    "pod": ("-mor_method", "pod", "-mor_samples", "30"),
    "modal": ("-mor_method", "modal"),
    "craig_bampton": ("-mor_method", "craig_bampton"),
    "krylov": ("-mor_method", "krylov", "-mor_moments", "4"),
}


def unit(body: Path, ranks: int, runs: int) -> tuple[float, float]:
    """Median seconds of one factorisation and one block solve, as the program itself reports them,
    and the peak memory of such a run [MB]."""
    seconds, peak_mb = [], 0.0
    for _ in range(runs):
        out = flexgram(
            "sweep",
            "-body",
            body,
            "-mor_sweep_hz",
            "100",
            "-mor_sweep_out",
            OUT / "unit.h5",
            "-mor_monitor",
            "detail",
            ranks=ranks,
        )
        found = re.search(r"factor ([\d.]+) s, solve ([\d.]+) s", out)
        peak = re.search(r"peak (\d+) MB", out)
        assert found and peak, out
        seconds.append(float(found[1]) + float(found[2]))
        peak_mb = float(peak[1])
    return statistics.median(seconds), peak_mb


def full_response(body: Path, band: str, ranks: int, checks: int) -> tuple[Any, Any]:
    """Frequencies [rad/s] that no method sees, and the full body's H there."""
    first, last = (float(word) for word in band.split(","))
    flexgram(
        "sweep",
        "-body",
        body,
        "-mor_sweep_hz",
        f"{first * 1.03},{last * 0.997},{checks}",
        "-mor_sweep_out",
        OUT / "sweep.h5",
        ranks=ranks,
    )
    with h5py.File(OUT / "sweep.h5") as file:
        return file["omega"][:], file["H"][:] @ [1, 1j]


def measure(
    body: Path, method: str, band: str, ranks: int, runs: int, reference: tuple[Any, Any]
) -> dict[str, Any]:
    """Median seconds without reading and assembling, peak memory, order, bound, true error."""
    rom, seconds = OUT / "rom.h5", []
    for _ in range(runs):
        flexgram(
            "reduce",
            "-body",
            body,
            "-mor_band_hz",
            band,
            "-mor_out",
            rom,
            *METHODS[method],
            ranks=ranks,
        )
        with h5py.File(rom) as file:
            stages = dict(file["log/seconds"].attrs)
            peak = float(file["log"].attrs["peak_memory_mb_per_rank"])
            order, n = file["K"].shape[0], file["V"].shape[0]
            medium = float(file["log"].attrs.get("medium_order", 0))
            bound = float(file["error/bound"][:].max()) if "error/bound" in file else float("nan")
        seconds.append(
            sum(s for name, s in stages.items() if name not in ("partition", "assemble"))
        )
    omega, H = reference
    lost = ReducedModel.load(rom, basis=False).transfer(omega) - H
    error = float((np.linalg.norm(lost, axis=(1, 2)) / np.linalg.norm(H, axis=(1, 2))).max())
    return {
        "method": method,
        "order": order,
        "seconds": statistics.median(seconds),
        "peak_mb": peak,
        "basis_mb": 8e-6 * n * medium / ranks,
        "error": error,
        "bound": bound,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[6, 30], help="thousand dofs")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--checks", type=int, default=12, help="full solves of the true error")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    rows = []
    for shape, (counts, edges) in SHAPES.items():
        for size in options.sizes:
            mesh = box("tetra10", counts[size], edges, distort=False)
            damped, undamped = OUT / "damped.h5", OUT / "undamped.h5"
            write_body_file(damped, mesh, interfaces=ENDS, damping=(2.0, 1e-6, 0))
            write_body_file(undamped, mesh, interfaces=ENDS)
            real, real_mb = unit(undamped, options.ranks, options.runs)
            complex_, complex_mb = unit(damped, options.ranks, options.runs)
            print(
                f"{shape} {size}k: unit real {real:.2f} s, {real_mb:.0f} MB; complex "
                f"{complex_:.2f} s, {complex_mb:.0f} MB"
            )
            band = "10,1000" if shape == "block" else "10,200"
            reference = full_response(damped, band, options.ranks, options.checks)
            for method in options.methods:
                row = measure(damped, method, band, options.ranks, options.runs, reference)
                unit_of = {
                    "unit_real_s": real,
                    "unit_complex_s": complex_,
                    "unit_real_mb": real_mb,
                    "unit_complex_mb": complex_mb,
                }
                row = {"shape": shape, "thousand_dofs": size, **unit_of, **row}
                row["units"] = row["seconds"] / real
                rows.append(row)
                print(
                    f"  {method:14s} m = {row['order']:3d}  {row['seconds']:8.2f} s "
                    f"= {row['units']:6.1f} units  {row['peak_mb']:6.0f} MB, "
                    f"4 bases {4 * row['basis_mb']:.0f} MB  error "
                    f"{row['error']:.1e}  bound {row['bound']:.1e}",
                    flush=True,
                )
    write_table(RESULTS / "methods.csv", rows)
    figure, axes = plt.subplots(figsize=(7, 4))
    for method in options.methods:
        mine = [row for row in rows if row["method"] == method]
        axes.loglog([r["units"] for r in mine], [r["error"] for r in mine], "o", label=method)
    axes.set(xlabel="time / (one real factorisation + one block solve)", ylabel="largest error")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(OUT / "methods.png", dpi=150)
    print(f"table and figure are in {OUT}")


if __name__ == "__main__":
    main()
