#!/usr/bin/env python3
"""Remakes tests/data/ccx.json: eigenfrequencies by CalculiX of the boxes in meshes/bodies.py.

Needs the package calculix-ccx (group "test" in scripts/packages.txt):

    scripts/install test && .venv/bin/python3 scripts/ccx_reference.py
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import meshio

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "meshes"))

from bodies import CALCULIX, box  # noqa: E402

COUNT = 10


def deck_of(element: str, mesh: meshio.Mesh) -> list[str]:
    """Nodes, elements and steel; numbers in the 20 columns that CalculiX reads."""
    deck = ["*NODE, NSET=ALL"]
    deck += [
        f"{i + 1}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(mesh.points.tolist())
    ]
    deck.append(f"*ELEMENT, TYPE={element}, ELSET=BODY")
    for i, nodes in enumerate(mesh.cells[0].data.tolist()):
        words = [str(i + 1), *(str(n + 1) for n in nodes)]
        lines = [words[k : k + 14] for k in range(0, len(words), 14)]
        deck += [", ".join(line) + ("," if line is not lines[-1] else "") for line in lines]
    deck += [
        "*MATERIAL, NAME=STEEL",
        "*ELASTIC",
        "210e9, 0.3",
        "*DENSITY",
        "7850",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL",
    ]
    return deck


def run_ccx(deck: list[str], folder: str) -> None:
    Path(folder, "box.inp").write_text("\n".join(deck) + "\n")
    subprocess.run(["ccx", "box"], cwd=folder, check=True, capture_output=True)


def frequencies(element: str, counts: tuple[int, int, int], distort: bool) -> list[float]:
    """First frequencies [Hz] of the box, its face ``start`` held."""
    mesh = box(CALCULIX[element], counts, distort=distort)
    deck = [*deck_of(element, mesh), "*BOUNDARY"]
    deck += [f"{n + 1}, 1, 3" for n in mesh.point_sets["start"].tolist()]
    deck += ["*STEP", "*FREQUENCY", str(COUNT), "*END STEP"]
    with tempfile.TemporaryDirectory() as folder:
        run_ccx(deck, folder)
        table = Path(folder, "box.dat").read_text()
    rows = re.findall(r"^\s+\d+\s+\S+\s+\S+\s+(\S+)\s+\S+\s*$", table, re.MULTILINE)
    return [float(row) for row in rows[:COUNT]]


def one_element(element: str) -> dict[str, Any]:
    """Matrices of a single rectangular element, upper triangle by columns; C3D8I keeps the three
    nodes of its incompatible modes (9, 10, 11) as dofs with mass."""
    mesh = box(CALCULIX[element], (1, 1, 1), (0.02, 0.01, 0.015), distort=False)
    with tempfile.TemporaryDirectory() as folder:
        run_ccx(
            [*deck_of(element, mesh), "*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "*END STEP"],
            folder,
        )
        dofs = Path(folder, "box.dof").read_text().split()
        assert dofs == [f"{node}.{c}" for node in range(1, 12) for c in (1, 2, 3)]
        columns = {
            key: [float(line.split()[2]) for line in Path(folder, f"box.{ending}").open()]
            for key, ending in (("K", "sti"), ("M", "mas"))
        }
    assert all(len(values) == 33 * 34 // 2 for values in columns.values())
    return {"element": element, **columns}


def main() -> None:
    version = subprocess.run(["ccx", "-v"], capture_output=True, text=True).stdout.strip()
    result: dict[str, Any] = {"program": version, "unit": "Hz", "boxes": []}
    for element in CALCULIX:
        for counts, distort in (((6, 2, 2), True), ((6, 2, 2), False), ((12, 4, 4), True)):
            hz = frequencies(element, counts, distort)
            assert len(hz) == COUNT, element
            result["boxes"].append(
                {"element": element, "counts": counts, "distort": distort, "frequencies": hz}
            )
            print(element, counts, distort, hz[:3])
    result["one_element"] = one_element("C3D8I")
    path = ROOT / "tests" / "data" / "ccx.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
