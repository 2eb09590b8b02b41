"""The paper's figures on our rack (not the paper's: the same kind of part, another geometry).

Figure 4: singular values of the position Gramian over the order. Figure 5: relative error over the
band of Krylov, two-step, POD and modal reduction at the order of the paper's rule. Figure 6:
two-step reduction for three bands.

    benchmarks/run paper [--frequencies 200]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import h5py
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from common import ROOT, flexgram

OUT = ROOT / "out" / "paper"
BODY = ROOT / "out" / "rack.h5"
BANDS = ((10, 500), (10, 250), (250, 500))


def reduce(name: str, *options: Any) -> Path:
    path = OUT / f"{name}.h5"
    flexgram("reduce", "-body", BODY, "-mor_out", path, *options)
    return path


def errors(rom: Path, frequencies: int) -> tuple[Any, Any]:
    """Frequencies [Hz] and true relative error, eq. (17), by full solves."""
    sweep = OUT / "sweep.h5"
    flexgram(
        "sweep",
        "-body",
        BODY,
        "-rom",
        rom,
        "-mor_sweep_hz",
        f"5,600,{frequencies}",
        "-mor_sweep_out",
        sweep,
    )
    with h5py.File(sweep) as file:
        return file["omega"][:] / (2 * np.pi), file["error/relative"][:]


def draw(name: str, xlabel: str, ylabel: str, lines: dict[str, tuple[Any, Any]]) -> None:
    figure, axes = plt.subplots(figsize=(7, 4))
    for label, (x, y) in lines.items():
        axes.semilogy(x, y, label=label)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(OUT / f"{name}.png", dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frequencies", type=int, default=200, help="full solves for each error")
    count = parser.parse_args().frequencies
    OUT.mkdir(parents=True, exist_ok=True)

    rule = reduce("two_step_rule", "-mor_second_stage", "gramian", "-mor_order", "rule")
    pod = reduce("pod_rule", "-mor_method", "pod")
    with h5py.File(rule) as two, h5py.File(pod) as samples:
        order = two["K"].shape[0]
        lines = {
            name: (np.arange(1, len(s) + 1), s / s[0])
            for name, s in (
                ("two-step, converged integral", two["gramian/sigma"][:]),
                ("POD, 30 samples", samples["gramian/sigma"][:]),
            )
        }
    lines["the rule, sqrt(eps)"] = (np.array([1, 80]), np.full(2, 1.5e-8))
    draw("figure4", "m", "sigma_m / sigma_1", {k: (x[:80], y[:80]) for k, (x, y) in lines.items()})

    roms = {
        "Krylov": reduce("krylov", "-mor_method", "krylov", "-mor_order", order),
        "two-step": rule,
        "POD": reduce("pod", "-mor_method", "pod", "-mor_order", order),
        "modal": reduce("modal", "-mor_method", "modal", "-mor_order", order),
    }
    curves = {f"{name}, m = {order}": errors(rom, count) for name, rom in roms.items()}
    draw("figure5", "frequency [Hz]", "relative error", curves)
    print(f"largest relative error in 10-500 Hz at m = {order} ({count} full solves)")
    for name, (hz, epsilon) in curves.items():
        print(f"  {name:20s} {epsilon[(hz >= 10) & (hz <= 500)].max():.2e}")

    bands = {}
    for first, last in BANDS:
        rom = reduce(
            f"band_{first}_{last}",
            "-mor_band_hz",
            f"{first},{last}",
            "-mor_order",
            order,
            "-mor_second_stage",
            "gramian",
        )
        bands[f"{first}-{last} Hz"] = errors(rom, count)
    draw("figure6", "frequency [Hz]", "relative error", bands)
    print(f"figures 4 to 6 are in {OUT}")


if __name__ == "__main__":
    main()
