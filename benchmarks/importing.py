"""Time and memory of importing a large CalculiX export.

A generated Tet10 body is assembled by flexgram and its K and M are written as ccx writes them (its
own export takes 50 s at 108k dofs and grows fast), with a deck; then ``flexgram import``
is timed.

    .venv/bin/python3 benchmarks/run importing [--thousand 250] [--runs 3]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time

import numpy as np
import scipy.sparse as sp
from common import ROOT, assembled
from methods import SHAPES

from bodies import box, write_body_file

OUT = ROOT / "out" / "bench" / "import"


def write_job(thousand: int) -> tuple[int, int]:
    """The files of a job; returns rows and stored nonzeros of both matrices."""
    counts, edges = SHAPES["block"]
    mesh = box("tetra10", counts[thousand], edges, distort=False)
    body = OUT / "body.h5"
    write_body_file(body, mesh, interfaces={"start": {"set": "start", "coupling": "distributing"}})
    full = assembled(OUT / "matrices.h5", body)
    lines = 0
    pattern = sp.triu(abs(full["K"]) + abs(full["M"])).tocoo()
    order = np.lexsort((pattern.row, pattern.col))
    row, column = pattern.row[order], pattern.col[order]
    for suffix, name in (("sti", "K"), ("mas", "M")):
        value = np.asarray(full[name].tocsr()[row, column]).ravel()
        table = np.column_stack([row + 1, column + 1, value])
        np.savetxt(OUT / f"job.{suffix}", table, fmt="%d %d %20.13e")
        lines += len(table)
    dofs = zip(full["node"] + 1, full["component"] + 1, strict=True)
    (OUT / "job.dof").write_text("".join(f"{n}.{c}\n" for n, c in dofs))
    with (OUT / "job.inp").open("w") as deck:
        deck.write("*NODE\n")
        np.savetxt(
            deck,
            np.column_stack([np.arange(len(mesh.points)) + 1, mesh.points]),
            fmt="%d, %.12g, %.12g, %.12g",
        )
        deck.write("*ELEMENT, TYPE=C3D10, ELSET=EALL\n")
        cells = mesh.cells[0].data + 1
        np.savetxt(
            deck, np.column_stack([np.arange(len(cells)) + 1, cells]), fmt="%d", delimiter=", "
        )
        for name, nodes in mesh.point_sets.items():
            deck.write(f"*NSET, NSET={name.upper()}\n" + "".join(f"{n + 1},\n" for n in nodes))
    return full["K"].shape[0], lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--thousand", type=int, default=250, choices=[6, 30, 100, 250])
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    n, lines = write_job(options.thousand)
    # VmHWM, not ru_maxrss: that one starts from what this process had when it forked.
    code = (
        "import sys; from flexgram.__main__ import main; main(sys.argv[1:]); "
        "print([x for x in open('/proc/self/status') if 'VmHWM' in x][0].split()[1])"
    )
    command = [
        sys.executable,
        "-c",
        code,
        "import",
        str(OUT / "job.sti"),
        "--rigid",
        "start=NSET:START",
        "-o",
        str(OUT / "imported.h5"),
    ]
    seconds, peak = [], 0.0
    for _ in range(options.runs):
        start = time.perf_counter()
        done = subprocess.run(
            command,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        seconds.append(time.perf_counter() - start)
        peak = float(done.stdout.split()[-1]) / 1e3
    median = statistics.median(seconds)
    text = sum((OUT / f"job.{s}").stat().st_size for s in ("sti", "mas")) / 1e6
    stored = 12e-6 * 2 * lines  # both triangles, 8 bytes a value and 4 a column
    times = f"{peak / stored:.1f} times K and M in memory"
    print(
        f"n = {n}, {lines:.3g} lines, {text:.0f} MB of text: {median:.1f} s, "
        f"{lines / median:.3g} nonzeros/s, peak {peak:.0f} MB = {times}"
    )


if __name__ == "__main__":
    main()
