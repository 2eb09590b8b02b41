"""Abaqus: ``job_STIFn.mtx`` and ``job_MASSn.mtx`` of ``*MATRIX GENERATE``, and the deck."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, whole_numbers
from flexgram.importers.deck import read_deck
from flexgram.importers.fe import FeMatrices, check_indices, folded, read_triplets, symmetric


def _partner(path: Path, of: str, to: str) -> Path:
    """The other matrix of the same job and step."""
    name = re.sub(rf"(_?){of}(\d+)\.mtx$", rf"\1{to}\2.mtx", path.name, flags=re.IGNORECASE)
    if name == path.name:
        raise BodyError(f"{path}: expected a name like job_{of}1.mtx, as *MATRIX OUTPUT gives it")
    return path.with_name(name)


def _first_line(path: Path) -> str:
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    with path.open(errors="replace") as file:
        return next((line for line in file if line.strip() and not line.startswith("*")), "")


def read_abaqus(path: Path, deck: Path | None = None) -> FeMatrices:
    """Read the stiffness matrix ``path`` and the mass matrix beside it, in either format.

    FORMAT=MATRIX INPUT carries its own dof map; FORMAT=COORDINATE counts equations, which are
    taken as three to a node in the order of the deck's labels, so it needs the deck.
    """
    stiffness = (
        path
        if re.search(r"STIF\d+\.mtx$", path.name, re.IGNORECASE)
        else _partner(path, "MASS", "STIF")
    )
    mass = _partner(stiffness, "STIF", "MASS")
    job = stiffness.with_name(
        re.sub(r"_?STIF\d+\.mtx$", ".inp", stiffness.name, flags=re.IGNORECASE)
    )
    deck = deck or (job if job.exists() else None)
    model = read_deck(deck) if deck is not None else None
    if "," in _first_line(stiffness):  # node, dof, node, dof, value
        tables = {file: read_triplets(file, 5) for file in (stiffness, mass)}
        whole = {f: whole_numbers(f, t[:, :4]) for f, t in tables.items()}
        ends = [w[:, c] * 8 + w[:, c + 1] for w in whole.values() for c in (0, 2)]
        code = np.unique(np.concatenate([np.unique(end) for end in ends]))
        n = len(code)

        def build(file: Path) -> sp.csr_matrix:
            w = whole[file]
            row, column = (np.searchsorted(code, w[:, c] * 8 + w[:, c + 1]) for c in (0, 2))
            return folded(file, row, column, tables[file][:, 4], n)

        component = code % 8 - 1
        node = (code - component - 1) // 8
        if component.min() < 0 or component.max() > 5:
            raise BodyError(
                f"{stiffness}: dof {component.max() + 1} is no displacement or rotation (1 to 6)"
            )
        fe = FeMatrices(
            str(stiffness), build(stiffness), build(mass), node=node, component=component
        )
    else:
        tables = {file: read_triplets(file) for file in (stiffness, mass)}
        whole = {f: whole_numbers(f, t[:, :2]) for f, t in tables.items()}
        n = int(max(w.max() for w in whole.values()))
        if n > len(tables[stiffness]):
            raise BodyError(f"{stiffness}: {len(tables[stiffness])} entries cannot fill {n} rows")
        for file, pairs in whole.items():
            check_indices(file, pairs, n, "equations")
        K, M = (
            symmetric(f, whole[f][:, 0] - 1, whole[f][:, 1] - 1, t[:, 2], n)
            for f, t in tables.items()
        )
        fe = FeMatrices(str(stiffness), K, M)
        if model is None:
            raise BodyError(
                f"{stiffness}: FORMAT=COORDINATE numbers equations only: name the deck (--deck), "
                "or export with FORMAT=MATRIX INPUT, which carries node and dof"
            )
        used = {int(i) for _, nodes in model.blocks for i in nodes.ravel()}
        labels = np.array(sorted(used) if used else model.labels, dtype=np.int64)
        if 3 * len(labels) != n:
            raise BodyError(
                f"{stiffness}: {n} equations, but {deck} has {len(labels)} nodes with three dofs "
                "each; export with FORMAT=MATRIX INPUT, which carries node and dof"
            )
        fe.node, fe.component = np.repeat(labels, 3), np.tile(np.arange(3), len(labels))
        fe.remarks.append("equations are taken as three to a node in the order of the labels")
    if np.any(fe.node < 0):
        fe.remarks.append(
            f"{int(np.sum(fe.node < 0))} rows belong to internal nodes (negative labels): "
            "interfaces are found by the places of the others, and no coordinates are kept"
        )
    if model is not None:
        fe.remarks += model.remarks
    if model is None:
        fe.remarks.append("no deck: no coordinates, no node sets (--deck names it)")
    else:
        fe.labels, fe.sets, fe.blocks = model.labels, model.sets, model.blocks
        fe.points = model.points
    return fe
