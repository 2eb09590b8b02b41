"""Shell elements over the mesh: frequencies of a clamped plate and of a clamped curved panel by
quadrilaterals and triangles of flexgram, and by S4, S4R, S3 and S8R of CalculiX.

Writes benchmarks/results/shells.csv and docs/images/shells.png. The reference are flexgram's
quadrilaterals on 128 × 128 elements.

    benchmarks/run shells
"""

from __future__ import annotations

import re
import subprocess
import warnings
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import scipy.sparse.linalg as spl

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from common import OUT, RESULTS, ROOT, assembled, write_table

from flexgram.body.description import import_description
from sheets import flat, sheet

COUNTS, FINE = (4, 8, 16, 32), 128
THICKNESS = 0.02


def curved(u: Any, v: Any) -> Any:
    angle = 1.4 * (u - 0.5)
    return 2.5 * np.sin(angle), 5 * v, 2.5 * np.cos(angle)


BODIES = {"plate 1 x 0.6 m": flat(1, 0.6), "panel 5 m, radius 2.5 m": curved}


def ours(kind: str, shape: Any, count: int) -> Any:
    """The first six frequencies [Hz]."""
    content = {
        "materials": {"steel": {"E": 200e9, "nu": 0.3, "rho": 8000.0}},
        "sections": {"sheet": {"shape": "shell", "thickness": THICKNESS}},
        "regions": {"all": {"material": "steel", "section": "sheet"}},
        "interfaces": {"tip": {"coupling": "node", "nodes": "end_middle"}},
        "supports": {"clamp": {"nodes": "start", "components": ["x", "y", "z", "rx", "ry", "rz"]}},
    }
    mesh = sheet(kind, (count, count), shape)
    mesh.point_sets["end_middle"] = mesh.point_sets["end"][:1]
    import_description(content, "sheet", OUT / "sheet.h5", mesh=mesh)
    a = assembled(OUT / "matrices.h5", OUT / "sheet.h5")
    squares = spl.eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)
    return np.sqrt(np.sort(squares)) / (2 * np.pi)


def calculix(element: str, shape: Any, count: int) -> Any:
    """The same, by ccx."""
    kind = "triangle" if element == "S3" else "quad"
    mesh = sheet(kind, (2 * count if element == "S8R" else count,) * 2, shape)
    cells = mesh.cells[0].data
    if element == "S8R":  # every other node
        at = np.arange(len(mesh.points)).reshape(2 * count + 1, -1)
        a = at[:-2:2, :-2:2], at[2::2, :-2:2], at[2::2, 2::2], at[:-2:2, 2::2]
        b = at[1::2, :-2:2], at[2::2, 1::2], at[1::2, 2::2], at[:-2:2, 1::2]
        cells = np.stack([*a, *b], axis=-1).reshape(-1, 8)
    used = np.unique(cells)
    lines = ["*NODE,NSET=ALL"]
    lines += [f"{n + 1},{','.join(f'{x:.12g}' for x in mesh.points[n])}" for n in used]
    lines += [f"*ELEMENT,TYPE={element},ELSET=E"]
    lines += [f"{e}," + ",".join(map(str, row + 1)) for e, row in enumerate(cells, 1)]
    lines += [
        "*NSET,NSET=START",
        *(f"{n + 1}," for n in np.intersect1d(mesh.point_sets["start"], used)),
    ]
    lines += ["*MATERIAL,NAME=STEEL", "*ELASTIC", "200000000000.,0.3", "*DENSITY", "8000."]
    lines += ["*SHELL SECTION,ELSET=E,MATERIAL=STEEL", f"{THICKNESS}", "*BOUNDARY", "START,1,6"]
    lines += ["*STEP", "*FREQUENCY", "6", "*END STEP"]
    (OUT / "sheet.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(["ccx", "sheet"], cwd=OUT, check=True, capture_output=True)
    number = r"\s+[-+.\dE]+"
    rows = re.findall(
        rf"^\s+\d+{number}{number}\s+([-+.\dE]+){number}$",
        Path(OUT / "sheet.dat").read_text(),
        re.M,
    )
    return np.array([float(row) for row in rows[:6]])


def draw(rows: list[dict[str, Any]]) -> None:
    figure, axes = plt.subplots(1, len(BODIES), figsize=(9, 4), sharey=True)
    for axis, name in zip(axes, BODIES, strict=True):
        for row in (row for row in rows if row["body"] == name):
            label = str(row["element"])
            errors = [float(row[f"{n} x {n}"]) for n in COUNTS]
            axis.loglog(COUNTS, errors, "--s" if "ccx" in label else "-o", label=label)
        axis.set(title=name, xlabel="elements a side", xticks=COUNTS, xticklabels=COUNTS)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].set(ylabel="largest relative error of six frequencies")
    axes[0].legend(fontsize=8, loc="upper right", ncols=2)
    figure.tight_layout()
    figure.savefig(ROOT / "docs" / "images" / "shells.png", dpi=110)


def main() -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    rows = []
    for name, shape in BODIES.items():
        exact = ours("quad", shape, FINE)
        for label in ("quad", "triangle", "ccx S4", "ccx S8R", "ccx S3", "ccx S4R"):
            row: dict[str, Any] = {"body": name, "element": label}
            for n in COUNTS:
                theirs = label.startswith("ccx")
                found = calculix(label[4:], shape, n) if theirs else ours(label, shape, n)
                row[f"{n} x {n}"] = float(np.max(np.abs(found / exact - 1)))
            rows.append(row)
            print(row, flush=True)
    write_table(RESULTS / "shells.csv", rows)
    draw(rows)


if __name__ == "__main__":
    main()
