"""Matrices without an FE code's dof map: MATLAB ``.mat``, PETSc binary."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp

from flexgram.basics import BodyError, Floats, check_name, expect_survival, stored, whole_numbers
from flexgram.body.laws import Law, loss, prony, table, viscous
from flexgram.body.varying_laws import parameter
from flexgram.importers.fe import (
    FeMatrices,
    is_symmetric,
    real_or_complex,
    symmetric,
    with_skew_part,
)

#: Class numbers in PETSc's binary files.
PETSC_MATRIX, PETSC_VECTOR = 1211216, 1211214
#: Variables of MATLAB files that have a role by their names.
ROLES = (*"KMDGBC", "alpha", "beta", "eta", "node", "component", "position")
#: Laws of terms, as functions of their numbers.
TERM_LAWS: dict[str, Callable[..., Law]] = {
    law.__name__: law for law in (loss, viscous, prony, table, parameter)
}


def _sparse(path: Path, name: str, value: Any, make: Any = symmetric) -> sp.csr_matrix:
    if sp.issparse(value) and value.format in ("csc", "csr"):
        kind = sp.csc_matrix if value.format == "csc" else sp.csr_matrix
        parts = (value.data, value.indices, value.indptr)
        value = checked(f"{path}: {name}", parts, value.shape, kind)
    if name != "K" and np.iscomplexobj(value.data if sp.issparse(value) else value):
        raise BodyError(f"{path}: {name} is complex; K alone may be: K + iS")
    entries = sp.coo_matrix(value)
    if entries.shape[0] != entries.shape[1]:
        raise BodyError(
            f"{path}: {name} is {entries.shape[0]} × {entries.shape[1]}, expected square"
        )
    made: sp.csr_matrix = make(
        f"{path}, {name}", entries.row, entries.col, real_or_complex(entries.data), entries.shape[0]
    )
    return made


def checked(what: str, parts: tuple[Any, Any, Any], shape: tuple[int, int], kind: Any) -> Any:
    """A compressed matrix (values, indices, starts) whose indices lie within it: SciPy's own
    routines trust them.

    Raises
    ------
    BodyError
        Naming what does not fit.
    """
    value, index, start = parts[0], whole_numbers(what, parts[1]), whole_numbers(what, parts[2])
    major, minor = shape if kind is sp.csr_matrix else shape[::-1]
    if len(start) != major + 1 or start[0] != 0 or np.any(np.diff(start) < 0):
        raise BodyError(f"{what}: the starts of its rows or columns do not rise from 0")
    if start[-1] != len(value) or len(index) != len(value):
        raise BodyError(
            f"{what}: {len(value)} values and {len(index)} indices for the "
            f"{start[-1]} entries that it declares"
        )
    if len(index) and (index.min() < 0 or index.max() >= minor):
        raise BodyError(
            f"{what}: indices from {index.min()} to {index.max()}, expected 0 to {minor - 1}"
        )
    return kind((real_or_complex(value), index, start), shape=shape)


def _sparse_ports(what: str, value: Any) -> Any:
    if value.format not in ("csc", "csr"):  # SciPy has looked at these indices itself
        return value.toarray()
    parts = (value.data, value.indices, value.indptr)
    return checked(what, parts, value.shape, type(value)).toarray()


def _sparse_of_hdf5(what: str, group: h5py.Group) -> sp.csc_matrix:
    start = stored(what, group["jc"])
    rows = int(whole_numbers(what, group.attrs["MATLAB_sparse"]))
    if "ir" not in group:  # MATLAB leaves data and ir out of an empty matrix
        return checked(
            what, (np.empty(0), np.empty(0), start), (rows, len(start) - 1), sp.csc_matrix
        )
    value = _complex(stored(what, group["data"]))
    if value.dtype.kind not in "fc":
        raise BodyError(f"{what} is not of doubles")
    parts = (value, stored(what, group["ir"]), start)
    return checked(what, parts, (rows, len(start) - 1), sp.csc_matrix)


def _complex(data: Any) -> Any:
    """MATLAB's pairs of real and imaginary parts as complex numbers."""
    return data["real"] + 1j * data["imag"] if data.dtype.names == ("real", "imag") else data


def _from_hdf5(path: Path) -> dict[str, Any]:
    """Variables of a v7.3 file: sparse, dense (stored by columns), scalars."""
    values: dict[str, Any] = {}
    with h5py.File(path) as file:
        for name, item in file.items():
            if not name.startswith("#"):  # of cells
                values[name] = _value_of_hdf5(f"{path}: {name}", item)
    return {name: value for name, value in values.items() if value is not None}


def _value_of_hdf5(what: str, item: Any) -> Any:
    """A matrix, text, or a struct as a dict; None for what is neither."""
    if isinstance(item, h5py.Group):
        if "MATLAB_sparse" in item.attrs:
            return _sparse_of_hdf5(what, item)
        return {key: _value_of_hdf5(f"{what}.{key}", item[key]) for key in item}
    if item.dtype.kind not in "fiu" and item.dtype.names != ("real", "imag"):
        return None
    data = _complex(stored(what, item))
    if item.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.ravel(data)))
    return data.T if item.ndim == 2 else data


def read_matlab(path: Path, matrices: Mapping[str, str] | None = None) -> FeMatrices:
    """Read ``K``, ``M``, ``B`` (and ``D``, ``C``, ``alpha``, ``beta``, ``eta``, ``node``,
    ``component``, ``position``) from a MATLAB file of any version. A skew ``G`` of their size is
    added to D: gyroscopic forces; the skew part of a K that is not symmetric is of circulatory
    forces.

    ``terms`` is a struct of viscoelastic and uncertain parts: ``terms.rubber.T`` a matrix like K,
    ``terms.rubber.law`` its law (``loss``, ``viscous``, ``prony``, ``table``, ``parameter``), and
    the law's numbers by the names of the function of that name (``terms.rubber.g``, ``.tau``).

    ``node`` is the row (from 1) of ``position`` (nodes x 3) for each row of the matrices,
    ``component`` its direction, 0 to 5. ``matrices`` maps K, M, D, B, C to other names,
    and S (structural damping) to its own: not every S is that.
    """
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    try:
        if not h5py.is_hdf5(path):
            expect_survival(path, lambda: scipy.io.loadmat(path))
        values = _from_hdf5(path) if h5py.is_hdf5(path) else scipy.io.loadmat(path)
        if "terms" in values and not h5py.is_hdf5(path):
            values |= scipy.io.loadmat(path, simplify_cells=True, variable_names=["terms"])
    except BodyError:
        raise
    except Exception as error:
        raise BodyError(f"{path}: not a MATLAB file ({error})") from error
    asked = matrices or {}
    there = ", ".join(key for key in values if not key.startswith("__")) or "none"
    for name in asked.values():
        if name not in values:
            raise BodyError(f"{path}: {name} is missing; there are {there}")
    named = {role: values[name] for role, name in asked.items()}
    for name in set(asked.values()) - set(asked):  # it has a role now, not that of its name
        values.pop(name)
    values |= named
    for name in ("K", "M"):
        if name not in values:
            raise BodyError(
                f"{path}: {name} is missing; there are {there} (--matrices "
                "K=Kmat,M=Mmat names them)"
            )
    square = np.shape(values["C"]) == np.shape(values["K"]) if "C" in values else False
    if square and "C" not in asked and np.shape(values["K"])[0] > 1:
        raise BodyError(
            f"{path}: C is as large as K: damping (--matrices D=C), or an output for "
            "each row (--matrices C=C)?"
        )

    def number(name: str) -> float:
        if name not in values:
            return 0.0
        value = np.ravel(values[name])
        if len(value) != 1 or np.iscomplexobj(value) or not (np.isfinite(value[0]) and value >= 0):
            raise BodyError(f"{path}: {name} must be one number, finite and not negative")
        return float(value[0])

    def dense(name: str) -> Any:
        value = values.get(name)
        return _sparse_ports(f"{path}: {name}", value) if sp.issparse(value) else value

    fe = FeMatrices(
        str(path),
        _sparse(path, "K", values["K"], with_skew_part),
        _sparse(path, "M", values["M"]),
        _damping_of(path, values),
        S=_sparse(path, "S", values["S"]) if "S" in asked else None,
        B=dense("B"),
        C=dense("C"),
        alpha=number("alpha"),
        beta=number("beta"),
        eta=number("eta"),
        terms=_terms_of(path, values.get("terms", {})),
    )
    read = {*ROLES, "terms", *asked}
    if rest := [name for name in values if name not in read and not name.startswith("__")]:
        fe.remarks.append(
            f"variables that are not read, left out: {', '.join(rest)}"
            + (" (--matrices S=S takes S for structural damping)" if "S" in rest else "")
        )
    fe.is_symmetric = is_symmetric(fe.K)
    if {"node", "component", "position"} <= set(values):
        fe.node = whole_numbers(f"{path}: node", np.ravel(values["node"]))
        fe.component = whole_numbers(f"{path}: component", np.ravel(values["component"]))
        fe.points = np.asarray(values["position"], dtype=float)
        fe.labels = np.arange(1, len(fe.points) + 1)
        if len(fe.node) != fe.n or len(fe.component) != fe.n:
            raise BodyError(f"{path}: node and component need an entry for each of the {fe.n} rows")
        if fe.points.ndim != 2 or fe.points.shape[1] != 3:
            raise BodyError(f"{path}: position must be nodes × 3")
        if not np.all(np.isfinite(fe.points)):
            raise BodyError(f"{path}: position holds NaN or Inf")
        if fe.component.min() < 0 or fe.component.max() > 5 or 0 not in fe.component:
            raise BodyError(
                f"{path}: component must be 0, 1, 2 (translations) or 3, 4, 5 "
                "(rotations); node counts from 1"
            )
    return fe


def _terms_of(path: Path, given: Any) -> dict[str, tuple[sp.csr_matrix, Law]]:
    """Terms of a struct, by name."""
    if not isinstance(given, dict):
        raise BodyError(f"{path}: terms must be a struct: terms.NAME.T, terms.NAME.law and so on")
    terms = {}
    for name, entry in given.items():
        where = f"{path}: terms.{name}"
        if not isinstance(entry, dict) or not {"T", "law"} <= set(entry):
            raise BodyError(f"{where} must be a struct with T, a matrix like K, and law, a name")
        check_name(where, name)
        kind = str(entry["law"])
        if kind not in TERM_LAWS:
            raise BodyError(f"{where}: law {kind} must be one of {', '.join(TERM_LAWS)}")
        lists = {key: np.ravel(x) for key, x in entry.items() if key not in ("T", "law")}
        numbers = {key: x if len(x) != 1 else x[0] for key, x in lists.items()}
        try:
            law = TERM_LAWS[kind](**numbers)
        except TypeError:
            wanted = ", ".join(inspect.signature(TERM_LAWS[kind]).parameters) or "no numbers"
            raise BodyError(
                f"{where}: law {kind} has {wanted}, not {', '.join(numbers) or 'none'}"
            ) from None
        except BodyError as error:
            raise BodyError(f"{where}: {error}") from None
        terms[name] = _sparse(path, f"terms.{name}.T", entry["T"]), law
    return terms


def _damping_of(path: Path, values: Mapping[str, Any]) -> sp.csr_matrix | None:
    """D, and G where that is skew and as large as K."""
    parts = [_sparse(path, "D", values["D"], with_skew_part)] if "D" in values else []
    if "G" in values and np.shape(values["G"]) == np.shape(values["K"]):
        G = _sparse(path, "G", values["G"], with_skew_part)
        if abs(G + G.T).max() <= 1e-12 * abs(G).max():
            parts.append(G)
    return sum(parts[1:], parts[0]).tocsr() if parts else None


def _petsc_matrix(path: Path, is_dense: bool = False) -> sp.csr_matrix:
    """One Mat in PETSc's binary format (big-endian, indices of 32 or 64 bits); with ``is_dense``
    also a dense one, or a Vec as a column."""
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    with path.open("rb") as file:
        wide = np.fromfile(file, dtype=">i8", count=1)
        whole = ">i8" if len(wide) and wide[0] in (PETSC_MATRIX, PETSC_VECTOR) else ">i4"
        file.seek(0)
        size = np.dtype(whole).itemsize
        kind = np.fromfile(file, dtype=whole, count=1).tolist()
        if kind == [PETSC_VECTOR] and not is_dense:
            raise BodyError(f"{path}: a Vec of PETSc, a matrix is expected")
        if kind not in ([PETSC_MATRIX], [PETSC_VECTOR]):
            raise BodyError(f"{path}: no PETSc binary file (MatView to a binary viewer writes one)")
        is_vector = kind == [PETSC_VECTOR]
        sizes = np.fromfile(file, dtype=whole, count=1 if is_vector else 3).tolist()
        if len(sizes) < (1 if is_vector else 3):
            raise BodyError(f"{path}: truncated: its sizes are missing")
        rows, columns, count = (*sizes, 1, -1) if is_vector else sizes
        if count < 0 and not is_dense:
            raise BodyError(f"{path}: a dense Mat; flexgram takes sparse ones (AIJ)")
        head = size * (1 + len(sizes))
        needed = head + (8 * rows * columns if count < 0 else size * (rows + count) + 8 * count)
        if rows < 0 or columns < 0 or path.stat().st_size < needed:
            what = (
                f"{rows} × {columns} numbers" if count < 0 else f"{rows} rows with {count} entries"
            )
            raise BodyError(
                f"{path}: truncated: {what} need {needed} bytes, it has {path.stat().st_size}"
            )
        if count < 0:
            dense = np.fromfile(file, dtype=">f8", count=rows * columns).reshape(rows, columns)
            rest, values = len(file.read()), rows * columns
        else:
            lengths = np.fromfile(file, dtype=whole, count=rows)
            index = np.fromfile(file, dtype=whole, count=count)
            value = np.fromfile(file, dtype=">f8", count=count)
            rest, values = len(file.read()), count
    if rest == 8 * values and values:
        raise BodyError(
            f"{path}: written by a PETSc with complex scalars; write it with a real one"
        )
    if rest:
        raise BodyError(f"{path}: {rest} bytes follow the matrix: one Mat to a file is expected")
    if count < 0:
        return sp.csr_matrix(dense.astype(float))
    start = np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])
    return checked(str(path), (value, index, start), (rows, columns), sp.csr_matrix)


def inputs_of(path: Path, B: sp.spmatrix, rows: int) -> Floats:
    """Columns of loads from a file of their own, (rows, inputs).

    Raises
    ------
    BodyError
        Naming the file, if B has another number of rows, is complex or has a column of zeros.
    """
    if B.shape[0] != rows:
        turned = ": write its transpose" if B.shape[1] == rows else ""
        raise BodyError(
            f"{path}: B is {B.shape[0]} × {B.shape[1]}, expected {rows} rows, a column for each "
            f"input{turned}"
        )
    if np.iscomplexobj(B.data):
        raise BodyError(f"{path}: B is complex")
    found: Floats = B.toarray()
    zero = np.flatnonzero(~found.any(axis=0))
    if len(zero):
        raise BodyError(f"{path}: column {zero[0] + 1} of B is zero: no load")
    return found


def read_petsc(
    stiffness: Path,
    mass: Path,
    inputs: Path | None = None,
    damping: Path | None = None,
) -> FeMatrices:
    """Read K, M (and B, D) from files of one PETSc Mat each."""
    K = _sparse(stiffness, "Mat", _petsc_matrix(stiffness), with_skew_part)
    M = _sparse(mass, "Mat", _petsc_matrix(mass))
    D = _sparse(damping, "Mat", _petsc_matrix(damping), with_skew_part) if damping else None
    B = inputs_of(inputs, _petsc_matrix(inputs, True), K.shape[0]) if inputs else None
    return FeMatrices(str(stiffness), K, M, D, B=B, is_symmetric=is_symmetric(K))
