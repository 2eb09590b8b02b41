"""Matrices without an FE code's dof map: MATLAB ``.mat``, PETSc binary."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp

from flexgram.basics import BodyError
from flexgram.importers.fe import FeMatrices, symmetric

PETSC_MATRIX = 1211216


def _sparse(path: Path, name: str, value: Any) -> sp.csr_matrix:
    if np.iscomplexobj(value.data if sp.issparse(value) else value):
        raise BodyError(f"{path}: {name} is complex; flexgram takes K (1 + i eta) as K with eta")
    entries = sp.coo_matrix(value)
    if entries.shape[0] != entries.shape[1]:
        raise BodyError(f"{path}: {name} is {entries.shape[0]} × {entries.shape[1]}, expected "
                        "square")  # fmt: skip
    return symmetric(f"{path}, {name}", entries.row, entries.col, entries.data.astype(float),
                     entries.shape[0])  # fmt: skip


def _from_hdf5(path: Path) -> dict[str, Any]:
    """Variables of a v7.3 file: sparse, dense (stored by columns), scalars."""
    values: dict[str, Any] = {}
    with h5py.File(path) as file:
        for name, item in file.items():
            if isinstance(item, h5py.Group) and "MATLAB_sparse" in item.attrs:
                start = item["jc"][:]
                shape = (int(item.attrs["MATLAB_sparse"]), len(start) - 1)
                if "ir" in item and item["data"].dtype.kind != "f":
                    raise BodyError(f"{path}: {name} is complex or not of doubles")
                parts = (item["data"][:], item["ir"][:], start) if "ir" in item else ([], [], start)
                values[name] = sp.csc_matrix(parts, shape=shape)
            elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
                values[name] = item[:].T if item.ndim == 2 else item[()]
    return values


def read_matlab(path: Path) -> FeMatrices:
    """Read ``K``, ``M``, ``B`` (and ``D``, ``C``, ``alpha``, ``beta``, ``eta``, ``node``,
    ``component``, ``position``) from a MATLAB file of any version.

    ``node`` is the row (from 1) of ``position`` (nodes x 3) for each row of the matrices,
    ``component`` its direction, 0 to 5.
    """
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    try:
        values = _from_hdf5(path) if h5py.is_hdf5(path) else scipy.io.loadmat(path)
    except Exception as error:
        raise BodyError(f"{path}: not a MATLAB file ({error})") from error
    for name in ("K", "M"):
        if name not in values:
            there = [key for key in values if not key.startswith("__")]
            raise BodyError(f"{path}: {name} is missing; there are {', '.join(there) or 'none'}")

    def number(name: str) -> float:
        return float(np.ravel(values[name])[0]) if name in values else 0.0

    def dense(name: str) -> Any:
        value = values.get(name)
        return value.toarray() if sp.issparse(value) else value

    fe = FeMatrices(
        str(path), _sparse(path, "K", values["K"]), _sparse(path, "M", values["M"]),
        _sparse(path, "D", values["D"]) if "D" in values else None, B=dense("B"), C=dense("C"),
        alpha=number("alpha"), beta=number("beta"), eta=number("eta"),
    )  # fmt: skip
    if {"node", "component", "position"} <= set(values):
        fe.node = np.ravel(values["node"]).astype(np.int64)
        fe.component = np.ravel(values["component"]).astype(np.int64)
        fe.points = np.asarray(values["position"], dtype=float)
        fe.labels = np.arange(1, len(fe.points) + 1)
        if len(fe.node) != fe.n or len(fe.component) != fe.n:
            raise BodyError(f"{path}: node and component need an entry for each of the {fe.n} rows")
        if fe.points.ndim != 2 or fe.points.shape[1] != 3:
            raise BodyError(f"{path}: position must be nodes × 3")
        if fe.component.min() < 0 or fe.component.max() > 5 or 0 not in fe.component:
            raise BodyError(f"{path}: component must be 0, 1, 2 (translations) or 3, 4, 5 "
                            "(rotations); node counts from 1")  # fmt: skip
    return fe


def _petsc_matrix(path: Path) -> sp.csr_matrix:
    """One Mat in PETSc's binary format (big-endian, 32-bit indices)."""
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    with path.open("rb") as file:
        head = np.fromfile(file, dtype=">i4", count=4)
        if len(head) < 4 or head[0] != PETSC_MATRIX:
            raise BodyError(f"{path}: no PETSc binary Mat with 32-bit indices (MatView to a binary "
                            "viewer writes one)")  # fmt: skip
        _, rows, columns, count = (int(x) for x in head)
        if count < 0:
            raise BodyError(f"{path}: a dense Mat; flexgram takes sparse ones (AIJ)")
        lengths = np.fromfile(file, dtype=">i4", count=rows)
        index = np.fromfile(file, dtype=">i4", count=count)
        value = np.fromfile(file, dtype=">f8", count=count)
        rest = len(file.read())
    if rest == 8 * count and count:
        raise BodyError(
            f"{path}: written by a PETSc with complex scalars; write it with a real one"
        )
    if rest:
        raise BodyError(f"{path}: {rest} bytes follow the matrix: one Mat to a file is expected")
    if len(value) != count or len(lengths) != rows:
        raise BodyError(f"{path}: truncated: {len(value)} of {count} values are there")
    start = np.concatenate([[0], np.cumsum(lengths)])
    return sp.csr_matrix((value.astype(float), index.astype(np.int32), start),
                         shape=(rows, columns))  # fmt: skip


def read_petsc(stiffness: Path, mass: Path, inputs: Path | None = None, damping: Path | None = None,
               ) -> FeMatrices:  # fmt: skip
    """Read K, M (and B, D) from files of one PETSc Mat each."""
    K, M = (_sparse(p, "Mat", _petsc_matrix(p)) for p in (stiffness, mass))
    D = _sparse(damping, "Mat", _petsc_matrix(damping)) if damping else None
    B = _petsc_matrix(inputs).toarray() if inputs else None
    return FeMatrices(str(stiffness), K, M, D, B=B)
