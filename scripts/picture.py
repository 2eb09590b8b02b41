#!/usr/bin/env python3
"""Draws docs/rack.png, the README's picture, from what scripts/quickstart left in out/.

scripts/quickstart && .venv/bin/python3 scripts/picture.py
"""

from __future__ import annotations

from pathlib import Path

import h5py
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

ROOT = Path(__file__).resolve().parents[1]
FACES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def surface(cells: np.ndarray) -> np.ndarray:
    """Faces that only one element has."""
    faces = cells[:, FACES].reshape(-1, 4)
    _, index, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return faces[index[count == 1]]


def main() -> None:
    with h5py.File(ROOT / "out/rack.h5") as file:
        points = file["mesh/points"][:]
        blocks = [file[f"mesh/blocks/{name}/connectivity"][:] for name in file["mesh/blocks"]]
        nodes = [file[f"interfaces/{name}"].attrs["position"] for name in ("lower", "upper")]
    with h5py.File(ROOT / "out/rack.sweep.h5") as file:
        hz = file["omega"][:] / (2 * np.pi)
        H, H_r = (file[k][..., 0] + 1j * file[k][..., 1] for k in ("H", "H_rom"))
        error = file["error/relative"][:]
        names = file["H"].attrs["inputs"]
    with h5py.File(ROOT / "out/rack.rom.h5") as file:
        order, n = file["V"].shape[1], file["V"].shape[0]

    figure = plt.figure(figsize=(13, 4.2))
    view = figure.add_subplot(1, 3, 1, projection="3d")
    for cells, color in zip(blocks, ("#5b7fa6", "#c9b37e", "#c9b37e"), strict=True):
        view.add_collection3d(
            Poly3DCollection(points[surface(cells)], facecolor=color, edgecolor="#333", lw=0.15)
        )
    for k, node in enumerate(nodes, 1):
        view.scatter(*node, color="crimson", depthshade=False, zorder=9)
        view.text(*node, f" node {k}", color="crimson", zorder=10)
    low, high = points.min(0), points.max(0)
    view.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    view.set_box_aspect(high - low)
    view.computed_zorder = False
    view.set_axis_off()
    view.set_title(f"the rack: n = {n}, 12 inputs, 12 outputs")
    response = figure.add_subplot(1, 3, 2)
    i, j = list(names).index("upper.fx"), list(names).index("lower.fx")
    response.semilogy(hz, np.abs(H[:, i, j]), label=f"full, n = {n}")
    response.semilogy(hz, np.abs(H_r[:, i, j]), "--", label=f"reduced, m = {order}")
    response.set(xlabel="frequency [Hz]", ylabel="|H|", title=f"{names[i]} from {names[j]}")
    response.legend()
    panel = figure.add_subplot(1, 3, 3)
    panel.semilogy(hz, error)
    panel.set(xlabel="frequency [Hz]", title=f"relative error of all 144 entries, m = {order}")
    for axes in (response, panel):
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(ROOT / "docs/rack.png", dpi=90)


if __name__ == "__main__":
    main()
