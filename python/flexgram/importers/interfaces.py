"""Interfaces on matrices: rigid, force averaging, single nodes, rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, Floats, Ints, check_name, index_of
from flexgram.body.faces import Middle, middle_of
from flexgram.body.selection import in_box, nearest
from flexgram.importers.fe import FeMatrices, Interface, rigid_motions

FORCES = ("fx", "fy", "fz", "mx", "my", "mz")


def parse(coupling: str, text: str) -> Interface:
    """``name=SELECTOR[@x,y,z]`` of the command line.

    Examples
    --------
    >>> eye = flexgram.importers.parse("rigid", "eye=NSET:EYE@0,0,12.5")
    >>> eye.name, eye.where, eye.position.tolist()
    ('eye', 'NSET:EYE', [0.0, 0.0, 12.5])
    """
    name, equals, rest = text.partition("=")
    if not equals or not name or not rest:
        raise BodyError(
            f"--{coupling} {text}: expected name=NSET:SET, name=NODES:1,2,3, "
            "name=BOX:x0,y0,z0,x1,y1,z1 or name=AT:x,y,z, and @x,y,z for the "
            "reference"
        )
    check_name(f"--{coupling} {text}", name)
    where, at, position = rest.partition("@")
    return Interface(name, coupling, where, numbers(text, position, 3) if at else None)


def numbers(text: str, words: str, count: int) -> Floats:
    """So many finite numbers with commas between them; ``text`` is for the message."""
    try:
        values = np.array([float(word) for word in words.split(",")])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.all(np.isfinite(values)):
        raise BodyError(f"{text}: expected {count} finite numbers, not {words!r}")
    return values


def select(fe: FeMatrices, interface: Interface) -> Ints:
    """Labels of the nodes that a selector means."""
    if not isinstance(interface.where, str):
        return np.asarray(interface.where, dtype=np.int64)
    kind, _, words = interface.where.partition(":")
    place = f"{interface.name}={interface.where}"
    kind = kind.upper()
    if kind == "NSET":
        known = {name.upper(): nodes for name, nodes in fe.sets.items()}
        if words.upper() not in known:
            names = ", ".join(sorted(fe.sets)[:20]) or "none (--deck names the input deck)"
            raise BodyError(f"{place}: there is no node set {words}; there are {names}")
        return known[words.upper()]
    if kind == "NODES":
        try:
            chosen = [int(word) for word in words.split(",")]
            some = [fe.copies.get(label, np.array([label], dtype=np.int64)) for label in chosen]
            return np.concatenate(some).astype(np.int64)
        except (ValueError, OverflowError):
            raise BodyError(f"{place}: expected node numbers, not {words!r}") from None
    if kind in ("BOX", "AT"):
        if not len(fe.points):
            raise BodyError(f"{place}: the nodes have no coordinates (--deck names the input deck)")
        here = np.isin(fe.labels, fe.node)
        points, labels = fe.points[here], fe.labels[here]
        if kind == "AT":
            at = numbers(place, words, 3)
            return labels[[nearest(points, at, place, fe.remarks.append)]]
        return labels[in_box(points, numbers(place, words, 6).reshape(2, 3), place)]
    hint = f" (NSET:{kind})" if not words else ""
    raise BodyError(f"{place}: {kind} must be NSET, NODES, BOX or AT{hint}")


def _rows(fe: FeMatrices, name: str, labels: Ints) -> tuple[Ints, Ints]:
    """Rows of all three translations (and rotations, where there are) of every node."""
    if not len(fe.node):
        raise BodyError(f"interface {name}: the files have no dof map; name rows (--rows)")
    labels = np.unique(labels)
    if len(labels) and labels.min() < 0:
        raise BodyError(f"interface {name}: node {labels.min()} is an internal node of the FE code")
    at, mine = index_of(labels, fe.node)
    rows, at = np.flatnonzero(mine), at[mine]
    count = np.zeros((len(labels), 3), dtype=int)
    moves = fe.component[rows] < 3
    np.add.at(count, (at[moves], fe.component[rows][moves]), 1)
    if not np.all(count == 1):
        node, c = np.argwhere(count != 1)[0]
        if count[node, c] > 1:
            raise BodyError(
                f"interface {name}: node {labels[node]} has {count[node, c]} rows for its "
                f"{'xyz'[c]} translation: ccx expands nodes of shells and beams, and where these "
                "rows lie is known of free bodies, or by --run-ccx"
            )
        raise BodyError(
            f"interface {name}: node {labels[node]} has no free {'xyz'[c]} translation: it is "
            "constrained in the FE model (or not part of it); take the support or coupling out "
            "there, or choose other nodes"
        )
    return rows, at


def attach(fe: FeMatrices, interfaces: list[Interface]) -> dict[str, Any]:
    """The body with its interfaces: arguments of ``flexgram.write_matrices``, in the deck's units,
    ``moment`` (which ports are moments), ``load`` (which are loads, in the deck's unit of force),
    ``new_points`` (label -> position of reference nodes), ``followers`` (labels of each rigid
    interface, its reference node first) and ``members`` (labels of every interface).

    Rigid interfaces condense their nodes into reference nodes with six rows each, at the end.
    """
    seen: set[str] = set()
    for interface in interfaces:
        if interface.name in seen:
            raise BodyError(f"interface {interface.name} is given twice")
        seen.add(interface.name)
    for name, value, axis in (("B", fe.B, 0), ("C", fe.C, 1)):
        if value is not None and (np.ndim(value) != 2 or np.shape(value)[axis] != fe.n):
            raise BodyError(
                f"{fe.source}: {name} is {' × '.join(map(str, np.shape(value)))}, "
                f"expected {fe.n} {'rows' if axis == 0 else 'columns'}"
            )
        if value is not None and not np.all(np.isfinite(value)):
            raise BodyError(f"{fe.source}: {name} holds NaN or Inf")
    T, node, component, extra = _condense(fe, [i for i in interfaces if i.coupling == "rigid"])

    def condensed(A: sp.csr_matrix, skew_part: bool = False) -> sp.csr_matrix:
        if T is None:
            return A
        B = (T.T @ A @ T).tocsr()
        if skew_part:
            return B
        B.sort_indices()
        mirrored = B.T.tocsr()
        mirrored.sort_indices()
        if not np.array_equal(B.indices, mirrored.indices):  # an entry cancelled on one side
            return (0.5 * (B + mirrored)).tocsr()
        B.data += mirrored.data  # else the sum needs no third matrix
        B.data *= 0.5
        return B

    n = len(node) if T is not None else fe.n
    columns: list[Any] = []
    names: list[str] = []
    moments: list[bool] = []
    if fe.B is not None:
        B = sp.csc_matrix(fe.B)
        columns.append(T.T @ B if T is not None else B)
        names += fe.inputs or [f"u{i + 1}" for i in range(B.shape[1])]
        moments += [False] * B.shape[1]
    for interface in interfaces:
        block, ports, of_moment = _ports(fe, interface, node, component, extra, n)
        moments += of_moment
        columns.append(T.T @ block if T is not None and block.shape[0] == fe.n else block)
        names += ports
    if not columns:
        sets = ", ".join(sorted(fe.sets)[:20]) or "none"
        if not len(fe.node):
            raise BodyError(
                f"{fe.source}: no interface is named, and the files do not say which rows belong "
                "to which node: --rows tip=fx:715,fy:716 (from 1), or loads B (--inputs FILE; of "
                "MATLAB a variable)"
            )
        raise BodyError(
            f"{fe.source}: no interface is named: --rigid, --distributing or --node "
            f"name=NSET:SET; node sets are {sets}"
        )
    of_interfaces = len(names)
    for load, forces in fe.loads.items():
        column = sp.csc_matrix(forces[:, None])
        columns.append(T.T @ column if T is not None else column)
        names.append(load)
    moments += [False] * len(fe.loads)
    is_load = np.arange(len(names)) >= of_interfaces
    arguments: dict[str, Any] = {
        "K": condensed(fe.K, skew_part=not fe.is_symmetric),
        "M": condensed(fe.M),
        "B": sp.hstack(columns).toarray(),
        "D": condensed(fe.D, skew_part=True) if fe.D is not None else None,
        "S": condensed(fe.S) if fe.S is not None else None,
        "terms": {name: (condensed(T), law) for name, (T, law) in fe.terms.items()},
        "inputs": names,
        "moment": np.array(moments),
        "load": is_load,
        "is_symmetric": fe.is_symmetric,
        "C": None,
        "outputs": None,
        "measured": {name: row @ T if T is not None else row for name, row in fe.measured.items()},
        "node": node,
        "component": component,
        "new_points": {label: at for label, at in extra.values()},
        "members": {i.name: np.unique(select(fe, i)) for i in interfaces if i.coupling != "rows"},
        "followers": {
            i.name: np.concatenate([[extra[i.name][0]], np.unique(select(fe, i))])
            for i in interfaces
            if i.coupling == "rigid"
        },
    }
    if fe.C is not None:
        C = sp.csr_matrix(fe.C)
        arguments["C"] = (C @ T if T is not None else C).toarray()
        arguments["outputs"] = fe.outputs or [f"y{i + 1}" for i in range(C.shape[0])]
    return arguments


def _require_extent(fe: FeMatrices, interface: Interface, labels: Ints) -> None:
    """Nodes with translations only carry moments if they do not lie on a line."""
    if np.any(fe.component[np.isin(fe.node, labels)] >= 3):
        return
    points = fe.positions(np.unique(labels))
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 3 or spread[1] < 1e-8 * spread[0]:
        what = "is one node" if len(points) == 1 else f"has {len(points)} nodes on a line"
        raise BodyError(
            f"interface {interface.name} {what} and cannot carry moments; take more "
            "nodes, or --node"
        )


def middle(fe: FeMatrices, labels: Ints) -> Middle:
    """The middle of the faces or nodes of an interface, in the units of the deck."""
    at, known = index_of(fe.labels, np.unique(labels))
    if not known.all():
        fe.positions(labels)  # says which
    return middle_of(fe.points, fe.indexed_blocks(), at)


def _reference(fe: FeMatrices, interface: Interface, labels: Ints) -> Floats:
    return interface.position if interface.position is not None else middle(fe, labels).position


def _condense(
    fe: FeMatrices, rigid: list[Interface]
) -> tuple[sp.csc_matrix | None, Ints, Ints, dict[str, tuple[int, Floats]]]:
    """T with u = T v: the nodes of each rigid interface follow its reference node."""
    if not rigid:
        return None, fe.node, fe.component, {}
    owner = np.full(fe.n, -1)
    next_label = int(max(fe.labels.max(initial=0), fe.node.max(initial=0))) + 1
    entries: list[tuple[Ints, Ints, Floats]] = []
    extra: dict[str, tuple[int, Floats]] = {}
    for number, interface in enumerate(rigid):
        labels = select(fe, interface)
        rows, _ = _rows(fe, interface.name, labels)
        if np.any(owner[rows] >= 0):
            other = rigid[owner[rows].max()].name
            raise BodyError(
                f"interfaces {other} and {interface.name} share node "
                f"{fe.node[rows[owner[rows] >= 0][0]]}"
            )
        owner[rows] = number
        reference = _reference(fe, interface, labels)
        extra[interface.name] = (next_label + number, reference)
        six = rigid_motions(fe.positions(fe.node[rows]) - reference, fe.component[rows])
        r, k = np.nonzero(six)
        entries.append((rows[r], 6 * number + k, six[r, k]))
    for interface in rigid:
        _require_extent(fe, interface, select(fe, interface))
    kept = np.flatnonzero(owner < 0)
    size = len(kept) + 6 * len(rigid)
    row = np.concatenate([kept, *(e[0] for e in entries)])
    column = np.concatenate([np.arange(len(kept)), *(len(kept) + e[1] for e in entries)])
    value = np.concatenate([np.ones(len(kept)), *(e[2] for e in entries)])
    T = sp.csc_matrix((value, (row, column)), shape=(fe.n, size))
    references = np.repeat(next_label + np.arange(len(rigid)), 6)
    node = np.concatenate([fe.node[kept], references])
    component = np.concatenate([fe.component[kept], np.tile(np.arange(6), len(rigid))])
    return T, node, component, extra


def _unit_columns(rows: Ints, n: int) -> sp.csc_matrix:
    return sp.csc_matrix((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(n, len(rows)))


def _ports(
    fe: FeMatrices,
    interface: Interface,
    node: Ints,
    component: Ints,
    extra: dict[str, tuple[int, Floats]],
    n: int,
) -> tuple[sp.csc_matrix, list[str], list[bool]]:
    """Input columns over the old rows (fe.n) or, for rigid interfaces, the new ones; names; which
    are moments."""
    six = [False] * 3 + [True] * 3
    name = interface.name
    if interface.coupling == "rigid":
        rows = np.flatnonzero(node == extra[name][0])
        return _unit_columns(rows, n), [f"{name}.{force}" for force in FORCES], six
    if interface.coupling == "rows":
        words = str(interface.where).removeprefix("ROWS:")
        named = [word.rpartition(":")[::2] for word in words.split(",")]
        try:
            rows = np.array([int(number) - 1 for _, number in named])
        except ValueError:
            raise BodyError(
                f"--rows {name}={words}: expected row numbers from 1, or directions and rows, "
                "fx:25,fy:26"
            ) from None
        directions = [direction for direction, _ in named]
        if any(directions) and (
            not set(directions) <= set(FORCES) or len(set(directions)) < len(directions)
        ):
            raise BodyError(f"--rows {name}={words}: directions are {', '.join(FORCES)}, each once")
        if len(np.unique(rows)) < len(rows):
            raise BodyError(f"--rows {name}={words}: a row is named twice")
        if rows.min() < 0 or rows.max() >= fe.n:
            raise BodyError(f"--rows {name}={words}: the matrices have rows 1 to {fe.n}")
        turns = fe.component[rows] >= 3 if len(fe.component) else np.zeros(len(rows), dtype=bool)
        if any(directions):
            turns = np.array([direction.startswith("m") for direction in directions])
        ports = [f"{name}.{d or row + 1}" for d, row in zip(directions, rows, strict=True)]
        return _unit_columns(rows, fe.n), ports, turns.tolist()
    chosen = select(fe, interface)
    labels, first = np.unique(chosen, return_index=True)
    if interface.coupling == "node":
        columns, names, turned = [], list[str](), list[bool]()
        for label in labels:
            rows = np.flatnonzero(fe.node == label)
            if not len(rows):
                raise BodyError(
                    f"interface {name}: node {label} has no row: it is constrained in "
                    "the FE model, or not part of it"
                )
            rows = rows[np.argsort(fe.component[rows])]
            if len(np.unique(fe.component[rows])) < len(rows):
                raise BodyError(
                    f"interface {name}: node {label} has several rows in a direction: "
                    "it is of a shell or beam that the FE code expands"
                )
            prefix = name if len(labels) == 1 else f"{name}-{label}"
            columns.append(_unit_columns(rows, fe.n))
            names += [f"{prefix}.{FORCES[c]}" for c in fe.component[rows]]
            turned += (fe.component[rows] >= 3).tolist()
        return sp.hstack(columns).tocsc(), names, turned
    rows, at = _rows(fe, name, labels)
    weights = np.ones(len(labels)) if interface.weights is None else interface.weights[first]
    _require_extent(fe, interface, labels)
    points = fe.positions(labels)
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) > 2 and spread[1] > 1e-8 * spread[0]:  # translations tell the six motions
        moves = fe.component[rows] < 3
        rows, at = rows[moves], at[moves]
    arm = fe.positions(fe.node[rows]) - _reference(fe, interface, labels)
    G = rigid_motions(arm, fe.component[rows])
    # On a line, of a shell or of beams, the nodes' rotations count too, as lengths.
    size = spread[0] / np.sqrt(len(points)) or 1.0
    W = (weights[at] * np.where(fe.component[rows] < 3, 1.0, size**2))[:, None]
    B = W * G @ np.linalg.inv(G.T @ (W * G))
    r, k = np.indices(B.shape)
    columns_of = sp.csc_matrix((B.ravel(), (rows[r.ravel()], k.ravel())), shape=(fe.n, 6))
    return columns_of, [f"{name}.{force}" for force in FORCES], six
