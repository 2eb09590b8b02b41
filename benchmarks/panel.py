"""A panel of shells with beads and stiffeners beside the plate of solids of as many dofs: time in
factorisations, claim and true error of a certified reduction.

Writes benchmarks/results/panel.csv.

    benchmarks/run panel [--runs 3] [--ranks 1] [--checks 12] [--count 160]
    benchmarks/run panel --large 1 2 4       a million dofs on so many ranks; panel_ranks.csv
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from typing import Any

import h5py
import meshio
import numpy as np
from common import OUT, RESULTS, write_table
from methods import SHAPES, flexgram, full_response, measure, unit

from bodies import box, write_body_file
from flexgram.body.description import import_description
from sheets import sheet

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7850.0}
LENGTH, WIDTH, DEPTH = 2.0, 1.2, 0.04  # of the panel, and of its stiffeners [m]


def beaded(u: Any, v: Any) -> Any:
    """A sheet with three beads across, 6 mm deep."""
    bead = np.clip(np.cos(6 * np.pi * u) - 0.5, 0, None) * np.clip(np.sin(np.pi * v), 0, None)
    return LENGTH * u, WIDTH * v, 0.012 * bead


def panel(count: int) -> meshio.Mesh:
    """``count`` elements along it, and two stiffeners of five elements' depth under it."""
    across = 6 * (count // 10)
    skin = sheet("quad", (count, across), beaded)
    points, cells = [skin.points], [skin.cells[0].data]
    at = np.arange(len(skin.points)).reshape(count + 1, across + 1)
    sets = {name: skin.point_sets[name] for name in ("start", "end")}
    for place in (across // 3, 2 * across // 3):
        line, layers = at[:, place], [at[:, place]]
        for depth in np.linspace(0, DEPTH, 6)[1:]:
            first = sum(map(len, points))
            points.append(skin.points[line] - [0, 0, depth])
            layers.append(np.arange(first, first + count + 1))
        for upper, lower in pairwise(layers):
            cells.append(np.column_stack([upper[:-1], upper[1:], lower[1:], lower[:-1]]))
    return meshio.Mesh(
        np.vstack(points),
        [("quad", np.vstack(cells))],
        point_sets=sets,
        cell_sets={
            "skin": [np.arange(len(cells[0]))],
            "ribs": [np.arange(len(cells[0]), sum(map(len, cells)))],
        },
    )


def write_panel(path: Any, count: int, damping: dict[str, float]) -> int:
    content = {
        "materials": {"steel": STEEL},
        "sections": {
            "skin": {"shape": "shell", "thickness": 0.012},
            "ribs": {"shape": "shell", "thickness": 0.012},
        },
        "regions": {
            "skin": {"material": "steel", "section": "skin"},
            "ribs": {"material": "steel", "section": "ribs"},
        },
        "interfaces": {side: {"coupling": "rigid", "nodes": side} for side in ("start", "end")},
        "damping": damping,
    }
    return 6 * int(import_description(content, "panel", path, mesh=panel(count))["points"])


def large(ranks: list[int]) -> None:
    """The panel with a million dofs, from its file to its reduced file, on some ranks."""
    body, rom = OUT / "large.h5", OUT / "rom.h5"
    write_panel(body, 520, {"alpha": 2.0, "beta": 1e-6})
    rows = []
    for count in ranks:
        flexgram("reduce", body, "--band", "10,100", "--tol", "1e-4", "-o", rom, ranks=count)
        with h5py.File(rom) as file:
            stages = dict(file["log/seconds"].attrs)
            rows.append(
                {
                    "ranks": count,
                    "n": file["V"].shape[0],
                    "order": file["K"].shape[0],
                    "claim": float(file["error"].attrs["worst"]),
                    "seconds": float(sum(stages.values())),
                    "assemble": float(stages["assemble"]),
                    "peak_mb_per_rank": float(file["log"].attrs["peak_memory_mb_per_rank"]),
                }
            )
        print(rows[-1], flush=True)
    write_table(RESULTS / "panel_ranks.csv", rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--checks", type=int, default=12, help="full solves of the true error")
    parser.add_argument("--count", type=int, default=160, help="elements along the panel")
    parser.add_argument("--large", type=int, nargs="+", help="ranks of the large one, alone")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    if options.large:
        large(options.large)
        return
    damped, undamped = OUT / "damped.h5", OUT / "undamped.h5"
    rows = []
    for shape in ("panel of shells", "plate of solids"):
        if shape == "panel of shells":
            write_panel(damped, options.count, {"alpha": 2.0, "beta": 1e-6})
            write_panel(undamped, options.count, {})
        else:
            counts, edges = SHAPES["plate"]
            mesh = box("tetra10", counts[100], edges, distort=False)
            ends = {n: {"set": n, "coupling": "rigid"} for n in ("start", "end")}
            write_body_file(damped, mesh, interfaces=ends, damping=(2.0, 1e-6, 0))
            write_body_file(undamped, mesh, interfaces=ends)
        real, _ = unit(undamped, options.ranks, options.runs)
        reference = full_response(damped, "10,200", options.ranks, options.checks)
        row = measure(damped, "two_step", "10,200", options.ranks, options.runs, reference)
        with h5py.File(OUT / "rom.h5") as file:
            row["n"] = file["V"].shape[0]
            omega = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(file["M"][:], file["K"][:]))))
        row["modes"] = int(np.sum((omega > 2 * np.pi) & (omega < 400 * np.pi)))
        row = {"body": shape, **row, "unit_s": real, "units": row["seconds"] / real}
        rows.append(row)
        print(row, flush=True)
    write_table(RESULTS / "panel.csv", rows)


if __name__ == "__main__":
    main()
