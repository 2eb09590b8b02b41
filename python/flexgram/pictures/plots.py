"""Pictures of sweeps and reduced bodies."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from matplotlib.figure import Figure

from flexgram.basics import BodyError, written_aside
from flexgram.model.reduced import ReducedBody


def _open(path: Path, kind: str, needed: str) -> h5py.File:
    """An HDF5 file that holds `needed`, or a message that says what it should have been."""
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    try:
        file = h5py.File(path)
    except OSError:
        raise BodyError(f"{path} is not an HDF5 file") from None
    if needed not in file:
        file.close()
        raise BodyError(f"{path} is no {kind} file")
    return file


def sweep_figure(sweep: Path, rom: Path | None = None) -> Figure:
    """What ``flexgram sweep`` found.

    Parameters
    ----------
    sweep : Path
        Sweep file with ``/omega`` [rad/s], ``/H`` and, compared with a reduced body, ``/H_rom``
        and ``/error/relative`` (eq. 17 of Fehr, Eberhard and Lehner).
    rom : Path, optional
        Reduced file to compare with the sweep, and for the eigenvalues of its Gramian.
    """
    with _open(sweep, "sweep", "H") as file:
        hz = file["omega"][:] / (2 * np.pi)
        H = file["H"][..., 0] + 1j * file["H"][..., 1]
        H_rom = file["H_rom"][..., 0] + 1j * file["H_rom"][..., 1] if "H_rom" in file else None
        error = file["error/relative"][:] if "error" in file else None
        inputs, outputs = file["H"].attrs["inputs"], file["H"].attrs["outputs"]
    sigma, order = None, 0
    if rom is not None:
        _open(rom, "reduced", "gramian/sigma").close()
        model = ReducedBody.load(rom, basis=False)
        if [model.inputs, model.outputs] != [[str(x) for x in inputs], [str(x) for x in outputs]]:
            raise BodyError(f"{rom}: its ports are not those of {sweep}")
        sigma, order = model.sigma, model.order
        sampled = model.claim.omega / (2 * np.pi), model.claim.error
        # Of the body that is named, which the sweep may not have been compared with.
        H_rom = model.system.transfer(2 * np.pi * hz)
        size = np.linalg.norm(H, axis=(1, 2))
        error = np.linalg.norm(H - H_rom, axis=(1, 2)) / np.maximum(size, 1e-300)

    count = 1 + (error is not None) + (sigma is not None)
    figure = Figure(figsize=(5.2 * count, 4.0))
    axes = figure.subplots(1, count, squeeze=False)
    response = axes[0, 0]
    strongest = np.argmax(np.abs(H).max(axis=0).diagonal())
    i = min(int(strongest), H.shape[1] - 1)
    j = min(int(strongest), H.shape[2] - 1)
    response.semilogy(hz, np.abs(H[:, i, j]), label="full body")
    if H_rom is not None:
        label = f"reduced, m = {order}" if order else "reduced"
        response.semilogy(hz, np.abs(H_rom[:, i, j]), "--", label=label)
    response.set(xlabel="frequency [Hz]", ylabel="|H|", title=f"{outputs[i]} from {inputs[j]}")
    response.legend()
    if error is not None:
        panel = axes[0, 1]
        panel.semilogy(hz, error, label="full sweep")
        if sigma is not None:
            panel.semilogy(*sampled, ".", label="known at reduction")
            panel.legend()
        panel.set(xlabel="frequency [Hz]", ylabel="relative error ε", title="eq. (17)")
    if sigma is not None:
        panel = axes[0, -1]
        panel.semilogy(np.arange(1, len(sigma) + 1), sigma / sigma[0], ".-")
        panel.axvline(order, color="gray", lw=0.8)
        panel.axhline(np.sqrt(np.finfo(float).eps), color="gray", lw=0.8, ls=":")
        panel.set(xlabel="j", ylabel="σ_j / σ_1", title=f"position Gramian, m = {order}")
    for panel in axes.flat:
        panel.grid(alpha=0.3)
    figure.tight_layout()
    return figure


def plot_sweep(sweep: Path, output: Path, rom: Path | None = None) -> None:
    """Draw a sweep into a file; its suffix chooses the format."""
    figure = sweep_figure(sweep, rom)
    try:
        with written_aside(output, sweep, rom) as place:
            figure.savefig(place, dpi=120)
    except ValueError as error:  # matplotlib does not know the suffix
        raise BodyError(f"{output}: {error}") from None
