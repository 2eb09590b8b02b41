"""Calls into the compiled module: bodies handed over, options, warnings."""

from __future__ import annotations

import difflib
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, ReductionWarning, check_name
from flexgram.body.matrices import Matrices
from flexgram.body.terms import Term, split_stiffness, with_terms
from flexgram.reduced_model import ReducedModel
from flexgram.reduction.options import NAMES

#: How the names of options start.
PREFIXES = (
    "mor_",
    "log_",
    "mat_",
    "vec_",
    "bv_",
    "ksp_",
    "pc_",
    "eps_",
    "svd_",
    "options_",
    "info",
    "malloc",
)


def core() -> Any:
    """The compiled module, started."""
    try:
        import _flexgram
    except ImportError as error:
        raise ImportError(
            f"the module _flexgram is not there ({error}): scripts/build makes it where "
            "pybind11-dev and python3-dev are installed"
        ) from None
    _flexgram.start()
    return _flexgram


def communicator(comm: Any) -> Any:
    """``comm``, or all ranks."""
    if comm is not None:
        return comm
    try:
        from mpi4py import MPI
    except ImportError:
        raise ImportError("flexgram needs mpi4py (Debian: python3-mpi4py)") from None
    return MPI.COMM_WORLD


def _agree(comm: Any, work: Any) -> Any:
    """Do rank-local work; if it fails anywhere, every rank raises the first message."""
    message, result = None, None
    try:
        result = work()
    except (BodyError, ValueError, TypeError) as error:
        message = str(error) or type(error).__name__
    failed = [m for m in comm.allgather(message) if m is not None]
    if failed:
        raise BodyError(failed[0])
    return result


def _rows_of(matrices: Matrices, comm: Any) -> tuple[int, int]:
    """This rank's rows: those of the first petsc4py matrix, else an even share."""
    for matrix in (matrices.K, matrices.M, matrices.D):
        if hasattr(matrix, "handle"):
            owned: tuple[int, int] = matrix.getOwnershipRange()
            return owned
    n, size, rank = matrices.K.shape[0], comm.size, comm.rank
    first = rank * (n // size) + min(rank, n % size)
    return first, first + n // size + (rank < n % size)


def _one_matrix(name: str, matrix: Any, rows: tuple[int, int], n: int, comm: Any) -> Any:
    """Rows of a SciPy matrix as CSR, or a petsc4py matrix in a format that is taken."""
    if sp.issparse(matrix):
        if matrix.dtype.kind == "c":
            raise BodyError(f"{name} is complex; K alone may be: K + iS")
        if matrix.shape != (n, n):
            raise BodyError(f"{name} is {matrix.shape}, expected {(n, n)}: square, and like K")
        mine = sp.csr_matrix(matrix)[slice(*rows)].astype(np.float64)
        mine.sum_duplicates()
        return (*rows, n, mine.indptr, mine.indices, mine.data)
    if matrix.comm.size != comm.size:
        raise BodyError(f"{name} lives on {matrix.comm.size} ranks, comm has {comm.size}")
    if matrix.getOwnershipRange() != rows:
        raise BodyError(f"{name} is not split over the ranks like K")
    # SBAIJ, BAIJ and others become AIJ, which is what the kernels read.
    return matrix if "aij" == matrix.getType()[-3:] and "b" not in matrix.getType() else None


def _dense(name: str, value: Any, rows: int, axis: int) -> Any:
    """A port map with its ports along the other axis; a vector is one port."""
    if sp.issparse(value):
        value = value.toarray()
    if np.iscomplexobj(value):
        raise BodyError(f"{name} is complex; input and output maps are real")
    block = np.asarray(value, dtype=float)
    if block.ndim == 1:
        block = np.expand_dims(block, 1 - axis)
    if block.ndim != 2 or block.shape[axis] != rows:
        raise BodyError(
            f"{name} has shape {np.shape(value)}, but there are {rows} rows of K that go with it"
        )
    if not np.all(np.isfinite(block)):
        raise BodyError(f"{name} holds NaN or Inf")
    return block


def _matrices_of(matrices: Matrices) -> tuple[dict[str, Any], list[Term]]:
    """What is handed over by rows, of terms D and S where they are these, else by their names; and
    the terms with names."""
    D, S, others = with_terms(matrices.D, matrices.S, matrices.terms)
    given = {"K": matrices.K, "M": matrices.M, "D": D, "S": S}
    for term in others:
        if term.name in given:
            raise BodyError(f"term {term.name}: the name of another matrix")
        given[term.name] = term.matrix
    return given, others


def _port_names(what: str, given: Sequence[str] | None, count: int, prefix: str) -> list[str]:
    names = [str(name) for name in given or (f"{prefix}{i + 1}" for i in range(count))]
    if len(names) != count:
        raise BodyError(f"{what}: {len(names)} names for {count} ports")
    if twice := {name for name in names if names.count(name) > 1}:
        raise BodyError(f"{what}: two ports are named {sorted(twice)[0]}")
    return [check_name(what, name) for name in names]


def _own_rows(matrices: Matrices, comm: Any) -> dict[str, Any]:
    """What this rank hands over, checked: rows, CSR or matrices, ports, places. Local."""
    for name in ("K", "M", "B"):
        if getattr(matrices, name) is None:
            raise BodyError(f"{name} is missing")
    given, terms = _matrices_of(matrices)
    for name, matrix in given.items():
        if not (matrix is None or sp.issparse(matrix) or hasattr(matrix, "handle")):
            kind = type(matrix).__name__
            raise BodyError(f"{name} must be a SciPy sparse or petsc4py matrix, not {kind}")
    for name in ("alpha", "beta", "eta"):
        value = getattr(matrices, name)
        if not (np.isfinite(value) and value >= 0):
            raise BodyError(f"{name} = {value}: damping must be finite and not negative")
    first, last = _rows_of(matrices, comm)
    n = int(matrices.K.shape[0] if sp.issparse(matrices.K) else matrices.K.getSize()[0])
    parts: dict[str, Any] = {"rows": (first, last), "given": given, "terms": terms}
    for name, matrix in given.items():
        if matrix is not None:
            parts[name] = _one_matrix(name, matrix, (first, last), n, comm)
    whole = sp.issparse(matrices.K)  # then ports and places have all rows
    mine, rows = (slice(first, last), n) if whole else (slice(None), last - first)
    B = _dense("B", matrices.B, rows, 0)[mine]
    C = None if matrices.C is None else _dense("C", matrices.C, rows, 1).T[mine]
    inputs = _port_names("inputs", matrices.inputs, B.shape[1], "u")
    if C is None and matrices.outputs is not None and list(matrices.outputs) != inputs:
        raise BodyError("outputs are named but C is not given (the outputs are the inputs)")
    outputs = inputs if C is None else _port_names("outputs", matrices.outputs, C.shape[1], "y")
    parts["ports"] = (B, C, inputs, outputs)
    if matrices.node is not None:
        parts |= _places(matrices, mine, last - first)
    return parts


def _places(matrices: Matrices, mine: slice, rows: int) -> dict[str, Any]:
    """Node, component and position of this rank's rows."""
    places: dict[str, Any] = {}
    shapes = {"node": (rows,), "component": (rows,), "position": (rows, 3)}
    for name, shape in shapes.items():
        value = getattr(matrices, name)
        places[name] = None if value is None else np.asarray(value)[mine]
        if value is None:
            continue
        if places[name].shape != shape:
            raise BodyError(f"{name} has shape {places[name].shape}, expected {shape}")
        if not np.all(np.isfinite(places[name])):
            raise BodyError(f"{name} holds NaN or Inf")
        if name != "position" and np.any(places[name] != np.floor(places[name])):
            raise BodyError(f"{name} must hold whole numbers")
    component = places["component"]
    if component is not None and len(component) and (component.min() < 0 or component.max() > 5):
        raise BodyError("component must be 0 to 2 (translations) or 3 to 5 (rotations)")
    return places


def _with_real_stiffness(matrices: Matrices) -> Matrices:
    K, S, eta = split_stiffness(matrices.K, matrices.S, matrices.eta)
    return replace(matrices, K=K, S=S, eta=eta)


def _matrices_over(matrices: Matrices, comm: Any) -> Any:
    matrices = _agree(comm, lambda: _with_real_stiffness(matrices))
    parts = _agree(comm, lambda: _own_rows(matrices, comm))
    body = core().Body(comm.py2f(), matrices.name)
    for term in parts["terms"]:
        numbers = {name: list(values) for name, values in term.law.numbers().items()}
        body.set_law(term.name, term.law.kind, numbers)
    for name, given in parts["given"].items():
        if isinstance(parts.get(name), tuple):
            body.set_csr(name, *parts[name])
        elif name in parts:
            matrix = parts[name]
            if matrix is None:
                matrix = given.copy().convert("aij")
            body.set_petsc(name, matrix.handle)
    body.set_ports(*parts["ports"])
    body.set_damping(matrices.alpha, matrices.beta, matrices.eta)
    if matrices.node is not None:
        labels = np.unique(np.concatenate(comm.allgather(np.unique(parts["node"]))))
        body.set_dofs(
            np.searchsorted(labels, parts["node"]),
            parts["node"],
            parts["component"],
            parts["position"],
        )
    return body


def hand_over(body: str | Path | Matrices, comm: Any, values: dict[str, str]) -> Any:
    """The compiled module's body, or None and the file's name among the options."""
    if isinstance(body, Matrices):
        return _matrices_over(body, comm)
    if not isinstance(body, (str, os.PathLike)):
        raise BodyError(
            "a body is the name of a file or flexgram.Matrices(K, M, B, ...), not "
            f"{type(body).__name__}"
        )
    values["-body"] = os.fspath(body)
    return None


def option_values(
    band_hz: Sequence[float] | Sequence[tuple[float, float]] | None,
    tol: float | None,
    order: int | str | None,
    method: str,
    options: Mapping[str, Any] | None,
    verbose: bool,
    keywords: Mapping[str, Any],
    known: type,
) -> dict[str, str]:
    """The options of one call, as words.

    Parameters
    ----------
    keywords : mapping
        Further keyword arguments of the call.
    known : type
        The ``TypedDict`` of those that it has.

    Raises
    ------
    BodyError
        For a key of ``options`` that neither flexgram nor PETSc would look at.
    TypeError
        For a keyword argument that is no option.
    """
    try:
        ends = None if band_hz is None else np.array(list(band_hz), dtype=float).ravel()
    except (TypeError, ValueError):
        ends = np.empty(0)
    if ends is not None and (
        not len(ends) or (len(ends) % 2 and len(ends) > 1) or not np.all(np.isfinite(ends))
    ):
        raise BodyError(
            f"band_hz must be first and last frequency, (10, 500), or pairs of them, or one "
            f"frequency, (50,), not {band_hz!r}"
        )
    try:
        tol = None if tol is None else float(tol)
    except (TypeError, ValueError):
        raise BodyError(f"tol must be a number, not {tol!r}") from None
    values = {"-mor_method": method, "-mor_monitor": "plan" if verbose else "silent"}
    if ends is not None:
        values["-mor_band_hz"] = ",".join(repr(float(f)) for f in ends)
    if tol is not None:
        values["-mor_tol"] = repr(float(tol))
    if order is not None:
        values["-mor_order"] = str(order)
    for key, value in (options or {}).items():
        name = key.lstrip("-")
        if not name.startswith(PREFIXES):
            raise BodyError(
                f"options: {key} is none of flexgram's (mor_...) or PETSc's "
                f"({', '.join(PREFIXES[1:])}...)"
            )
        values[f"-{name}"] = _word(value)
    for key, value in keywords.items():
        if key not in known.__annotations__:
            taken = ["band_hz", "tol", "order", "method", *known.__annotations__]
            near = difflib.get_close_matches(key, taken, 1)
            near += [name for name in taken if key.startswith(name)]
            hint = f": did you mean {near[0]}?" if near else " (help(flexgram.reduce))"
            raise TypeError(f"there is no option {key}{hint}")
        if value is not None:
            values[NAMES[key]] = _word(value)
    return values


def _word(value: Any) -> str:
    """A value as the command line has it."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple, np.ndarray)):
        return ",".join(map(str, value))
    return str(value)


def pass_warnings_on(said: Sequence[str], comm: Any) -> None:
    """What the program warned of, as warnings of Python that point at the user's call."""
    if comm.rank == 0:
        for text in said:
            warnings.warn(text, ReductionWarning, stacklevel=3)


def reduced(result: Any) -> ReducedModel:
    """The reduced body that the compiled module made."""
    return ReducedModel(result.fields(), result.save)
