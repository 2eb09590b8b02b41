"""Stress of reduced bodies of equal order: with the statics of the loads, and without.

A cantilever of Tet10 elements, 10-2000 Hz, under gravity, a traction on its end and a pressure on a
patch of its side: the largest error of the nodal stress of the whole field, over the largest stress
of the full body under the same load, at three frequencies that no method saw. Writes
benchmarks/results/stress.csv.
"""

from __future__ import annotations

import h5py
import numpy as np
from common import OUT, RESULTS, assembled, flexgram, write_table
from scipy.sparse.linalg import splu

from bodies import box
from flexgram import ReducedModel
from flexgram.body.description import import_description
from flexgram.body.stress import Stresses

EDGES, COUNTS = (0.5, 0.1, 0.1), (25, 6, 6)
ALPHA, BETA, HZ = 20.0, 1e-6, (23.0, 611.0, 1873.0)
LOADS = {"gravity": "gravity.az", "traction": "pull.ty", "pressure": "patch.p"}


def main() -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    mesh = box("tetra10", COUNTS, EDGES, distort=False)
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    mesh.point_sets["patch"] = np.flatnonzero((y > y.max() - 1e-9) & (x > 0.2) & (x < 0.3))
    body, rom_file = OUT / "stress.h5", OUT / "stress.rom.h5"
    description = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "damping": {"alpha": ALPHA, "beta": BETA},
        "loads": {
            "gravity": {"type": "acceleration"},
            "pull": {"type": "traction", "nodes": "end"},
            "patch": {"type": "pressure", "nodes": "patch"},
        },
    }
    import_description(description, "bar", body, mesh=mesh)
    full = assembled(OUT / "stress_matrices.h5", body)
    with h5py.File(OUT / "stress_matrices.h5") as file:
        inputs = [str(name) for name in file["B"].attrs["names"]]
    B = (
        np.reshape(full["B"], (len(inputs), -1)).T
        if full["B"].shape[0] == len(inputs)
        else full["B"]
    )
    stresses = Stresses.load(body)

    def of_field(u: np.ndarray) -> np.ndarray:
        there = np.zeros((2, len(mesh.points), 3))
        there[0][full["node"], full["component"]] = u.real
        there[1][full["node"], full["component"]] = u.imag
        parts = stresses.nodal(there)
        return parts[0] + 1j * parts[1]

    reference = {}
    for hertz in HZ:
        w = 2 * np.pi * hertz
        A = full["K"] * (1 + 1j * w * BETA) + (1j * w * ALPHA - w * w) * full["M"]
        factors = splu(A.tocsc())
        for name, port in LOADS.items():
            reference[hertz, name] = of_field(factors.solve(B[:, inputs.index(port)] + 0j))
    rows, order = [], 0
    for title, options in (
        ("two_step, statics", ("-mor_tol", "1e-4", "-mor_statics", "yes")),
        ("two_step", ("-mor_order", "{m}")),
        ("craig_bampton", ("-mor_order", "{m}", "-mor_method", "craig_bampton")),
        ("modal", ("-mor_order", "{m}", "-mor_method", "modal")),
    ):
        flexgram(
            "reduce",
            "-body",
            body,
            "-mor_band_hz",
            "10,2000",
            "-mor_out",
            rom_file,
            *(word.format(m=order) for word in options),
        )
        rom = ReducedModel.load(rom_file)
        order = order or rom.order
        row: dict[str, object] = {
            "method": title,
            "order": rom.order,
            "claim": f"{rom.certified_error:.1e}",
        }
        for name, port in LOADS.items():
            worst = 0.0
            for hertz in HZ:
                w = 2 * np.pi * hertz
                q = np.linalg.solve(
                    rom.K + 1j * w * rom.D - w * w * rom.M, rom.B[:, rom.inputs.index(port)]
                )
                field = rom.stress(q.real, body)[0] + 1j * rom.stress(q.imag, body)[0]
                truth = reference[hertz, name]
                worst = max(worst, float(np.abs(field - truth).max() / np.abs(truth).max()))
            row[name] = f"{worst:.1e}"
        rows.append(row)
        print(row, flush=True)
    write_table(RESULTS / "stress.csv", rows)
    print(f"{len(full['node'])} dofs")


if __name__ == "__main__":
    main()
