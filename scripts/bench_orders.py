"""Smallest order whose certified error meets a tolerance, by second stage: the README's table.

The rack (10-500 Hz), and bodies that others made where ``shared/data`` lies beside the project
(a band of ten modes, damping as in tests/python/test_certified.py). "-" is a tolerance that the
stage does not meet. Prints Markdown and writes out/bench/orders.csv.

    scripts/bench orders [--bodies rack crank ...] [--stages gramian weighted ...]
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import Any

import h5py

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "python"))

from test_certified import write_case  # noqa: E402

from conftest import SHARED, run, shared_case  # noqa: E402
from flexgram import import_body  # noqa: E402

OUT = ROOT / "out" / "bench"
TOLERANCES = ("1e-2", "1e-3", "1e-4", "1e-5", "1e-6", "1e-7", "1e-8")
STAGES = (
    "auto", "gramian", "weighted", "gramian_modes", "krylov", "irka", "balanced", "whole_axis",
    "craig_bampton", "modal",
)  # fmt: skip
OTHERS = ("crank", "ansys_hexbeam", "hb_bcsst06")


def order(body: Path, band: tuple[float, float], stage: str, tolerance: str) -> int | None:
    """The order found, or None if its certified error is above the tolerance."""
    rom = OUT / "order.rom.h5"
    result = run("reduce", "-body", body, "-mor_band_hz", ",".join(map(repr, band)), "-mor_tol",
                 tolerance, "-mor_second_stage", stage, "-mor_moments", 4, "-mor_out", rom,
                 expect=None)  # fmt: skip
    if result.status:
        return None
    with h5py.File(rom) as file:
        error = file["error"]
        worst = max(error["bound"][:].max(), *error.attrs.get("by_kind", [0.0]))
        met = worst <= float(tolerance) and error.attrs["kind"] == "certified"
        return int(file["K"].shape[0]) if met else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", nargs="+", default=["rack", *OTHERS])
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=list(STAGES))
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    print("| body | second stage | " + " | ".join(TOLERANCES) + " |")
    print("|---|---|" + "---|" * len(TOLERANCES))
    for name in options.bodies:
        body, band = OUT / "order.h5", (10.0, 500.0)
        if name == "rack":
            import_body(ROOT / "meshes" / "rack.yaml", body)
        elif SHARED.is_dir():
            band = write_case(shared_case(name), body)
        else:
            print(f"{name} left out: {SHARED} is not there", file=sys.stderr)
            continue
        for stage in options.stages:
            orders = [order(body, band, stage, tolerance) for tolerance in TOLERANCES]
            words = " | ".join("-" if m is None else str(m) for m in orders)
            print(f"| {name} | {stage} | {words} |", flush=True)
            rows.append(
                {"body": name, "stage": stage, **dict(zip(TOLERANCES, orders, strict=True))}
            )
    with (OUT / "orders.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, ["body", "stage", *TOLERANCES])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
