"""Smallest order whose certified error meets a tolerance, by method.

The rack (10-500 Hz), and bodies that others made where ``shared/data`` lies beside the project (a
band of ten modes, lightly damped: meshes/others.py). One medium model a body, certified for the
tightest tolerance; every number is a cut. "-" is a tolerance that the method does not meet.
Prints Markdown and writes benchmarks/results/orders.csv.

    benchmarks/run orders [--bodies rack crank ...] [--methods gramian weighted ...]
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from typing import Any

from common import OUT, RESULTS, ROOT, write_table

import flexgram
from others import SHARED, shared_case, write_case

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
METHODS = (
    "auto",
    "optimal",
    "gramian",
    "weighted",
    "gramian_modes",
    "krylov",
    "irka",
    "balanced",
    "whole_axis",
    "craig_bampton",
    "modal",
)
OTHERS = ("crank", "ansys_hexbeam", "hb_bcsst06")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", nargs="+", default=["rack", *OTHERS])
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")  # tolerances that are not met are what is looked for
    rows: list[dict[str, Any]] = []
    print("| body | method | " + " | ".join(f"{t:.0e}" for t in TOLERANCES) + " | seconds |")
    print("|---|---|" + "---|" * (len(TOLERANCES) + 1))
    for name in options.bodies:
        body, band = OUT / "order.h5", (10.0, 500.0)
        if name == "rack":
            flexgram.import_body(ROOT / "meshes" / "rack.yaml", body)
        elif SHARED.is_dir():
            band = write_case(shared_case(name), body)
        else:
            print(f"{name} left out: {SHARED} is not there", file=sys.stderr)
            continue
        medium = flexgram.certify(body, band_hz=band, tol=min(TOLERANCES))
        for method in options.methods:
            start, orders = time.perf_counter(), []
            for tolerance in TOLERANCES:
                rom = medium.reduce(
                    tol=tolerance, options={"mor_second_stage": method, "mor_moments": 4}
                )
                met = rom.met and rom.kind == "certified"
                orders.append(str(rom.order) if met else "-")
            seconds = time.perf_counter() - start
            print(f"| {name} | {method} | {' | '.join(orders)} | {seconds:.1f} |", flush=True)
            rows.append(
                {
                    "body": name,
                    "method": method,
                    **{f"{t:.0e}": m for t, m in zip(TOLERANCES, orders, strict=True)},
                    "seconds": f"{seconds:.2f}",
                }
            )
    RESULTS.mkdir(exist_ok=True)
    write_table(RESULTS / "orders.csv", rows)


if __name__ == "__main__":
    main()
