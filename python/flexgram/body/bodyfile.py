"""Writing body files: matrices as they are, or a mesh with materials and interfaces.

The layout is described in ``docs/files.md``; both kinds are HDF5 and open in
MATLAB and h5py.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, check_name, written_aside
from flexgram.body.laws import Law
from flexgram.body.terms import split_stiffness, with_terms

#: HDF5 1.8 to 1.10: thousands of port names do not fit into an attribute of older layouts.
LAYOUT = ("v108", "v110")


@contextmanager
def written_whole(path: str | Path) -> Iterator[h5py.File]:
    """An HDF5 file that appears under its name only when all of it is written.

    Raises
    ------
    BodyError
        If the disk is full.
    """
    with _full_disks_told(path), written_aside(path) as place:
        with h5py.File(place, "w", libver=LAYOUT) as file:
            yield file


@contextmanager
def _full_disks_told(path: str | Path) -> Iterator[None]:
    """HDF5 goes on after a write that failed, and then fails in many places."""
    full = os.strerror(errno.ENOSPC)
    hooks = sys.unraisablehook, sys.excepthook  # both told of objects that h5py cannot close
    sys.unraisablehook = lambda of: None if full in str(of.exc_value) else hooks[0](of)
    sys.excepthook = lambda kind, e, trace: None if full in str(e) else hooks[1](kind, e, trace)
    try:
        yield
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None:
            if full in str(cause) or getattr(cause, "errno", None) == errno.ENOSPC:
                raise BodyError(f"cannot write {path}: no space left on the device") from None
            cause = cause.__context__
        raise
    finally:
        sys.unraisablehook, sys.excepthook = hooks


def write_sparse(file: h5py.File, name: str, matrix: Any) -> None:
    """Store a sparse matrix as MATLAB v7.3 does: ``data``, ``ir``, ``jc`` by columns.

    Parameters
    ----------
    file : h5py.File
        Open for writing.
    name : str
        Group to create, such as ``"K"``.
    matrix : sparse matrix or array, n x m
        Real entries; duplicates are summed.
    """
    columns = sp.csc_matrix(matrix)
    columns.sum_duplicates()
    columns.sort_indices()
    group = file.create_group(name)
    group.attrs["MATLAB_class"] = np.bytes_("double")
    group.attrs["MATLAB_sparse"] = np.uint64(columns.shape[0])
    group["data"] = columns.data.astype(np.float64, copy=False)
    group["ir"] = columns.indices.astype(np.uint64)
    group["jc"] = columns.indptr.astype(np.uint64)


def write_matrices(
    path: str | Path,
    K: Any,
    M: Any,
    B: Any,
    *,
    D: Any = None,
    C: Any = None,
    alpha: float = 0.0,
    beta: float = 0.0,
    eta: float = 0.0,
    S: Any = None,
    terms: Mapping[str, tuple[Any, Law]] | None = None,
    rounding: float = 0.0,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    node: Any = None,
    component: Any = None,
    position: Any = None,
    ids: Any = None,
    blocks: Sequence[tuple[str, Any]] = (),
    followers: Mapping[str, Any] | None = None,
    interfaces: Mapping[str, Any] | None = None,
) -> None:
    """Write a body of matrices: M q'' + (D + alpha M + beta K) q' + ((1 + i eta) K + i S) q = B u.

    Parameters
    ----------
    path : str or Path
        File to write, ``.h5``.
    K, M : sparse, n x n
        Stiffness [N/m] and mass [kg], symmetric, both triangles. The imaginary part of a complex K
        is structural damping, added to S or ``eta``.
    B : array or sparse, n x n_in
        Input map.
    D : sparse, n x n, optional
        Damping [N s/m]; a proportional one is recognised when the file is read, and a skew part
        is taken for gyroscopic forces.
    C : array or sparse, n_out x n, optional
        Output map; without it the outputs are the inputs, ``B.T``.
    alpha, beta, eta : float
        Rayleigh coefficients [1/s], [s] and structural loss factor.
    S : sparse, n x n, optional
        Structural damping, Σ η_k K_k of materials with loss factors η_k [N/m].
    terms : mapping, optional
        By name (T, law): a matrix, sparse, n x n, symmetric and positive semidefinite [N/m], and
        ``flexgram.loss``, ``viscous``, ``prony`` or ``table``. A(ω) has g(ω)T in addition.
    rounding : float
        Relative rounding of the entries of K, if it was printed with few digits; it enters
        the floor of what is claimed. 0: by the digits of the entries.
    inputs, outputs : sequence of str, optional
        Port names.
    node, component : array of int, n, optional
        For each row the index of its node in ``position``, and 0-2 for a translation,
        3-5 for a rotation.
    position : array, n_nodes x 3, optional
        Node coordinates [m].
    ids : array of int, n_nodes, optional
        The FE code's numbers of these nodes.
    blocks : sequence of (str, array), optional
        Elements for pictures: meshio type, indices into ``position``.
    followers : mapping, optional
        For pictures: name of a rigid interface -> indices into ``position`` of the nodes that
        follow it and have no rows, the reference node first.
    interfaces : mapping, optional
        For pictures: name of any interface -> indices into ``position`` of its nodes.

    Raises
    ------
    BodyError
        For shapes that do not fit, complex entries, or names that do not fit the ports.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> K = 1e6 * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(50, 50))
    >>> flexgram.write_matrices("chain.h5", K, sp.eye(50), np.eye(50)[:, -1:], alpha=1.0)
    >>> flexgram.reduce("chain.h5", (1, 50), tol=1e-6).claim.met
    True
    """
    K, S, eta = split_stiffness(K, S, eta)
    D, S, others = with_terms(D, S, terms)
    maps = {"K": K, "M": M, "D": D, "S": S, "B": B, "C": C}
    _expect_shapes({**maps, **{f"term {term.name}": term.matrix for term in others}})
    if outputs is not None and C is None:
        raise BodyError("outputs are named but C is not given (the outputs are the inputs)")
    _expect_names("inputs", inputs, np.shape(B)[-1])
    _expect_names("outputs", outputs, C is None or np.shape(C)[0])
    damping = {"alpha": alpha, "beta": beta, "eta": eta}
    for name, number in damping.items():
        if not (np.isfinite(number) and number >= 0):
            raise BodyError(f"{name} = {number}: damping must be finite and not negative")
    with written_whole(path) as file:
        for name in "KMDS":
            if maps[name] is not None:
                write_sparse(file, name, maps[name])
        for term in others:
            write_sparse(file, f"terms/{term.name}", term.matrix)
            write_law(file[f"terms/{term.name}"], term.law)
        _write_ports(file, {"B": (B, inputs), "C": (C, outputs)})
        for name, number in damping.items():
            file.attrs[name] = float(number)
        if rounding:
            file.attrs["rounding"] = float(rounding)
        for name, value in (("dofs/node", node), ("dofs/component", component), ("nodes/id", ids)):
            if value is not None:
                file[name] = np.asarray(value, dtype=np.int64)
        if position is not None:
            file["nodes/position"] = np.asarray(position, dtype=np.float64)
        _write_geometry(file, blocks, followers or {}, interfaces or {})


def _expect_shapes(maps: Mapping[str, Any]) -> None:
    n = maps["K"].shape[0]
    square = dict.fromkeys((name for name in maps if name not in "BC"), (n, n))
    for name, shape in {**square, "B": (n, None), "C": (None, n)}.items():
        value = maps[name]
        if value is None:
            continue
        actual = np.shape(value)
        if len(actual) != 2 or any(e not in (None, a) for e, a in zip(shape, actual, strict=True)):
            wanted = " x ".join("any" if e is None else str(e) for e in shape)
            raise BodyError(f"{name} has shape {actual}, expected {wanted}")
        if np.iscomplexobj(value):
            raise BodyError(f"{name} is complex; K alone may be: K + iS")


def write_law(group: h5py.Group, law: Law) -> None:
    """The law of a term, as attributes of the group of its matrix."""
    group.attrs["law"] = law.kind
    for name, values in law.numbers().items():
        group.attrs[name] = values


def _expect_names(what: str, names: Sequence[str] | None, count: int) -> None:
    if names is None:
        return
    if len(names) != count:
        raise BodyError(f"{what}: {len(names)} names for {count} ports")
    if len(set(names)) != len(names):
        raise BodyError(f"{what}: a name is given twice")
    for name in names:
        check_name(what, str(name))


def _write_ports(file: h5py.File, maps: Mapping[str, tuple[Any, Sequence[str] | None]]) -> None:
    """B and C, dense or sparse, with the names of their ports."""
    for name, (value, names) in maps.items():
        if value is None:
            continue
        if sp.issparse(value):
            write_sparse(file, name, value)
        else:
            file[name] = np.atleast_2d(np.asarray(value, dtype=np.float64))
        if names is not None:
            file[name].attrs["names"] = list(names)


def _write_geometry(
    file: h5py.File,
    blocks: Sequence[tuple[str, Any]],
    followers: Mapping[str, Any],
    interfaces: Mapping[str, Any],
) -> None:
    """What pictures need: elements, and the nodes of interfaces."""
    for i, (kind, connectivity) in enumerate(blocks):
        group = file.create_group(f"geometry/blocks/{i:04d}")
        group.attrs["type"] = kind
        group["connectivity"] = np.asarray(connectivity, dtype=np.int64)
    for role, members in (("followers", followers), ("interfaces", interfaces)):
        for name, nodes in members.items():
            file[f"geometry/{role}/{name}"] = np.asarray(nodes, dtype=np.int64)
