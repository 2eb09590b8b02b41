#!/usr/bin/env python3
"""How assembly and ordering grow with the body, beside one factorisation of the same matrix.

Generated Tet10 boxes (4:2:1), free, twelve ports, undamped (real factorisation) and with Rayleigh
damping (complex symmetric). Each size runs several times; medians. Prints the table of the README.

    benchmarks/run assembly [--sizes 30 100 300] [--runs 3] [--ranks 1]
"""

from __future__ import annotations

import argparse
import re
import statistics
import tempfile
from pathlib import Path

from common import flexgram

from bodies import box, write_body_file

COUNTS = {10: (14, 7, 4), 30: (20, 10, 5), 100: (31, 16, 8), 300: (45, 23, 11)}
ENDS = {name: {"set": name, "coupling": "rigid"} for name in ("start", "end")}


def measure(body: Path, ranks: int, folder: Path) -> dict[str, float]:
    """One run: seconds of the stages, of the factorisation and its solve, and peak memory [MB]."""
    out = flexgram(
        "sweep",
        "-body",
        body,
        "-mor_sweep_hz",
        "100",
        "-mor_sweep_out",
        folder / "sweep.h5",
        "-mor_monitor",
        "detail",
        ranks=ranks,
    )

    def number(pattern: str) -> float:
        found = re.search(pattern, out)
        assert found, f"{pattern}\n{out}"
        return float(found[1])

    return {
        "n": number(r"n = (\d+)"),
        "assemble": number(r"partition ([\d.]+) s") + number(r"assemble ([\d.]+) s"),
        "order": number(r"analyse ([\d.]+) s"),
        "factor": number(r"factor ([\d.]+) s"),
        "solve": number(r"solve ([\d.]+) s"),
        "peak": number(r"peak (\d+) MB"),
        "factor_mb": number(r"(\d+) MB on a rank"),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=[30, 100, 300], help="thousands of dofs"
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=1)
    options = parser.parse_args()
    print(
        "| dofs | assemble s | order s | real factor s | complex factor s | 12 solves s "
        "(real, complex) | (assemble + order) / real factor | peak MB (real, complex) |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for size in options.sizes:
            mesh = box("tetra10", COUNTS[size], (0.4, 0.2, 0.1), distort=False)
            results = {}
            for kind, damping in (("real", (0, 0, 0)), ("complex", (2.0, 1e-6, 0))):
                body = folder / f"{kind}.h5"
                write_body_file(body, mesh, interfaces=ENDS, damping=damping)
                runs = [measure(body, options.ranks, folder) for _ in range(options.runs)]
                results[kind] = {key: statistics.median(r[key] for r in runs) for key in runs[0]}
            r, c = results["real"], results["complex"]
            share = (r["assemble"] + r["order"]) / r["factor"]
            print(
                f"| {r['n']:.0f} | {r['assemble']:.2f} | {r['order']:.2f} | {r['factor']:.2f} | "
                f"{c['factor']:.2f} | {r['solve']:.2f}, {c['solve']:.2f} | {share:.2f} | "
                f"{r['peak']:.0f}, {c['peak']:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
