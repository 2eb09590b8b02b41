"""Calls into the compiled module: bodies handed over, options, warnings."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError
from flexgram.reduced import ReducedModel


@dataclass
class Matrices:
    """A body handed over in memory.

    Attributes
    ----------
    K, M, D : SciPy sparse or petsc4py Mat, n x n
        Stiffness [N/m], mass [kg], optional damping [N s/m]; symmetric, both triangles. SciPy
        matrices are the same on every rank, each takes its rows; petsc4py matrices (AIJ) are used
        as they are, without a copy.
    B : array, n x n_in
        Inputs; with petsc4py matrices the rows that this rank owns.
    C : array, n_out x n, optional
        Outputs, default ``B.T``; with petsc4py the columns of the rows that this rank owns.
    alpha, beta, eta : float
        Rayleigh coefficients [1/s], [s], structural loss factor.
    inputs, outputs : sequence of str, optional
        Port names.
    node, component : int arrays, n, optional
        Label of each row's node (any number), and 0-2 for its translation, 3-5 for its rotation.
        Helps the ordering, and gives rigid modes and frame integrals.
    position : array, n x 3, optional
        Place of each row's node [m]. Like B by rows of this rank where the matrices are petsc4py's.
    name : str
        For messages.
    """

    K: Any
    M: Any
    B: Any
    D: Any = None
    C: Any = None
    alpha: float = 0.0
    beta: float = 0.0
    eta: float = 0.0
    inputs: Sequence[str] | None = None
    outputs: Sequence[str] | None = None
    node: Any = None
    component: Any = None
    position: Any = None
    name: str = "matrices"


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


def _own_rows(matrices: Matrices, comm: Any) -> dict[str, Any]:
    """What this rank hands over, checked: rows, CSR or handles, ports, places. Local."""
    parts: dict[str, Any] = {}
    whole = sp.issparse(matrices.K)
    for name in ("K", "M", "D"):
        matrix = getattr(matrices, name)
        if matrix is None:
            if name == "D":
                continue
            raise BodyError(f"{name} is missing")
        if whole:
            if not sp.issparse(matrix) or matrix.shape != matrices.K.shape:
                raise BodyError(f"{name} must be sparse and {matrices.K.shape} like K")
            if np.iscomplexobj(matrix.data):
                raise BodyError(f"{name} is complex; K (1 + i eta) is K with eta=...")
            n, size, rank = matrix.shape[0], comm.size, comm.rank
            if matrix.shape[1] != n:
                raise BodyError(f"{name} is {matrix.shape}, expected a square matrix")
            first = rank * (n // size) + min(rank, n % size)
            last = first + n // size + (rank < n % size)
            mine = sp.csr_matrix(matrix)[first:last].astype(np.float64)
            mine.sum_duplicates()
            parts[name] = (first, last, n, mine.indptr, mine.indices, mine.data)
        elif hasattr(matrix, "handle"):
            if matrix.comm.size != comm.size:
                raise BodyError(f"{name} lives on {matrix.comm.size} ranks, comm has {comm.size}")
            first, last = matrix.getOwnershipRange()
            parts[name] = matrix.handle
        else:
            raise BodyError(f"{name} must be a SciPy sparse or petsc4py matrix, not "
                            f"{type(matrix).__name__}")  # fmt: skip
        if parts.setdefault("rows", (first, last)) != (first, last):
            raise BodyError(f"{name} is not split over the ranks like K")
    first, last = parts["rows"]
    mine_of = slice(first, last) if whole else slice(None)

    def dense(value: Any) -> Any:
        return np.atleast_2d(np.asarray(value.toarray() if sp.issparse(value) else value, float))

    B = dense(matrices.B)[mine_of]
    C = None if matrices.C is None else dense(matrices.C).T[mine_of]
    for name, block in (("B", B), ("C", C)):
        if block is not None and len(block) != last - first:
            raise BodyError(f"{name} has {len(block)} entries along the {last - first} rows of "
                            "K that this rank has")  # fmt: skip
        if block is not None and not np.all(np.isfinite(block)):
            raise BodyError(f"{name} holds NaN or Inf")
    inputs = list(matrices.inputs or [f"u{i + 1}" for i in range(B.shape[1])])
    outputs = (inputs if C is None
               else list(matrices.outputs or [f"y{i + 1}" for i in range(C.shape[1])]))  # fmt: skip
    if len(inputs) != B.shape[1] or (C is not None and len(outputs) != C.shape[1]):
        raise BodyError("the names of inputs and outputs do not fit B and C")
    parts["ports"] = (B, C, inputs, outputs)
    if matrices.node is not None:
        shapes = {"node": (last - first,), "component": (last - first,),
                  "position": (last - first, 3)}  # fmt: skip
        for name, shape in shapes.items():
            value = getattr(matrices, name)
            if value is None:
                parts[name] = None
                continue
            parts[name] = np.asarray(value)[mine_of]
            if parts[name].shape != shape:
                raise BodyError(f"{name} has shape {parts[name].shape}, expected {shape}")
        component = parts["component"]
        if (
            component is not None
            and len(component)
            and (component.min() < 0 or component.max() > 5)
        ):
            raise BodyError("component must be 0 to 2 (translations) or 3 to 5 (rotations)")
    return parts


def _matrices_over(matrices: Matrices, comm: Any) -> Any:
    parts = _agree(comm, lambda: _own_rows(matrices, comm))
    body = core().Body(comm.py2f(), matrices.name)
    for name in ("K", "M", "D"):
        if isinstance(parts.get(name), tuple):
            body.set_csr(name, *parts[name])
        elif name in parts:
            body.set_petsc(name, parts[name])
    body.set_ports(*parts["ports"])
    body.set_damping(matrices.alpha, matrices.beta, matrices.eta)
    if matrices.node is not None:
        labels = np.unique(np.concatenate(comm.allgather(np.unique(parts["node"]))))
        body.set_dofs(np.searchsorted(labels, parts["node"]), parts["node"], parts["component"],
                      parts["position"])  # fmt: skip
    return body


def hand_over(body: str | Path | Matrices, comm: Any, values: dict[str, str]) -> Any:
    """The compiled module's body, or None and the file's name among the options."""
    if isinstance(body, Matrices):
        return _matrices_over(body, comm)
    values["-body"] = str(body)
    return None


def option_values(
    band_hz: Sequence[float] | None,
    tol: float | None,
    order: int | None,
    method: str,
    options: Mapping[str, Any] | None,
    verbose: bool,
) -> dict[str, str]:
    """The options of one call, as words."""
    values = {"-mor_method": method, "-mor_monitor": "summary" if verbose else "silent"}
    if band_hz is not None:
        values["-mor_band_hz"] = ",".join(repr(float(f)) for f in band_hz)
    if tol is not None:
        values["-mor_tol"] = repr(float(tol))
    if order is not None:
        values["-mor_order"] = str(int(order))
    for name, value in (options or {}).items():
        word = ",".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
        values[f"-{name.lstrip('-')}"] = word
    return values


def warn_if_unmet(model: ReducedModel, comm: Any) -> ReducedModel:
    """Warn, once, of a tolerance that is not met."""
    if not model.met and comm.rank == 0:
        said = [text for text in model.log.get("warnings", []) if text.startswith("-mor_tol ")]
        warnings.warn(said[0] if said else "the tolerance is not met", stacklevel=3)
    return model
