"""What every benchmark needs: the program on some ranks, small files, the places."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy reads it

import h5py
import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "bench"
RESULTS = ROOT / "benchmarks" / "results"  #: CSV that benchmarks/page makes docs/benchmarks.md of
PROGRAM = ROOT / "build" / "flexgram"
sys.path.insert(0, str(ROOT / "meshes"))


def flexgram(*arguments: Any, ranks: int = 1) -> str:
    """What ``flexgram`` prints under mpirun, with its plan. BLAS threads: the variable
    BLAS_THREADS, default 1."""
    command = ["mpirun", "-n", str(ranks), str(PROGRAM), *map(str, arguments)]
    environment = {
        **os.environ,
        "OPENBLAS_NUM_THREADS": os.environ.get("BLAS_THREADS", "1"),
        "PETSC_OPTIONS": "-mor_monitor detail",
    }
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout


def read_sparse(file: h5py.File, name: str) -> sp.csc_matrix:
    """A sparse matrix of a body file."""
    group = file[name]
    n = int(group.attrs["MATLAB_sparse"])
    arrays = (group["data"][:], group["ir"][:], group["jc"][:])
    return sp.csc_matrix(arrays, shape=(n, len(arrays[2]) - 1))


def assembled(matrices: Path, body: Path) -> dict[str, Any]:
    """K, M, B and the dof map of a mesh body, assembled by the program into ``matrices``."""
    flexgram("assemble", "-body", body, "-body_out", matrices)
    with h5py.File(matrices) as file:
        return {
            "K": read_sparse(file, "K"),
            "M": read_sparse(file, "M"),
            "B": file["B"][:],
            "node": file["nodes/id"][:][file["dofs/node"][:]],
            "component": file["dofs/component"][:],
        }


def write_table(path: Path, rows: list[dict[str, Any]]) -> None:
    """A CSV file of rows with the same keys."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def transfer(path: Path) -> tuple[Any, Any]:
    """Frequencies [rad/s] and H of a sweep file."""
    with h5py.File(path) as file:
        return file["omega"][:], file["H"][..., 0] + 1j * file["H"][..., 1]


def matrices_of(rom: Path) -> tuple[Any, Any, Any, Any]:
    """M, D, K, B of a reduced file."""
    with h5py.File(rom) as file:
        return tuple(np.asarray(file[name][:]) for name in "MDKB")  # type: ignore[return-value]
