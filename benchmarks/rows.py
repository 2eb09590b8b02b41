"""Stresses by the hundred: six rows of C a node beside 16 inputs, each kind to the tolerance.

A cantilever of Tet10 elements, 100-10000 Hz, with forces, gravity and pressure; stresses of random
nodes as outputs; with a tolerance of 1e-3 also the claim of the whole field (``-mor_field_error``).
Writes benchmarks/results/rows.csv. Arguments: numbers of nodes (default 10 33 100); with
``--binary PATH`` another flexgram, which is run in turn with this one's.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import time
from pathlib import Path

import numpy as np
from common import OUT, PROGRAM, RESULTS, write_table

from bodies import box
from flexgram.body.description import import_description


def write_body(path: Path, count: int) -> None:
    mesh = box("tetra10", (12, 4, 4), distort=False)
    y = mesh.points[:, 1]
    mesh.point_sets["side"] = np.flatnonzero(y > y.max() - 1e-9)
    nodes = np.random.default_rng(0).choice(len(mesh.points), count, replace=False) + 1
    description = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {
            name: {"coupling": "distributing", "nodes": name} for name in ("end", "side")
        },
        "supports": {"start": {"nodes": "start"}},
        "damping": {"alpha": 20.0},
        "loads": {
            "gravity": {"type": "acceleration"},
            "gas": {"type": "pressure", "nodes": "side"},
        },
        "outputs": {f"s{node}": {"type": "stress", "nodes": [node]} for node in nodes.tolist()},
    }
    import_description(description, "bar", path, mesh=mesh)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("nodes", nargs="*", type=int, default=[10, 33, 100])
    parser.add_argument("--binary", type=Path)
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    programs = {"this": PROGRAM} | ({"other": options.binary} if options.binary else {})
    rows = []
    for count in options.nodes:
        body = OUT / f"rows{count}.h5"
        write_body(body, count)
        for tolerance, field in ((1e-2, "no"), (1e-3, "yes"), (1e-4, "no")):
            for name, program in programs.items():
                begin = time.perf_counter()
                command = [
                    program,
                    "reduce",
                    "-body",
                    body,
                    "-mor_band_hz",
                    "100,10000",
                    "-mor_tol",
                    str(tolerance),
                    "-mor_field_error",
                    field,
                    "-mor_monitor",
                    "detail",
                    "-mor_out",
                    OUT / "rows.rom.h5",
                ]
                said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
                seconds = time.perf_counter() - begin
                outputs = int(re.search(r"(\d+) outputs", said)[1])
                medium = int(re.search(r"medium model +order (\d+)", said)[1])
                order = int(re.search(r"m = (\d+) of", said)[1])
                print(
                    name, outputs, tolerance, field, medium, order, f"{seconds:.2f} s", flush=True
                )
                if name == "this":
                    rows.append(
                        {
                            "inputs": 16,
                            "outputs": outputs,
                            "tolerance": f"{tolerance:.0e}",
                            "field": field,
                            "medium order": medium,
                            "order": order,
                            "seconds": f"{seconds:.2f}",
                        }
                    )
    write_table(RESULTS / "rows.csv", rows)


if __name__ == "__main__":
    main()
