"""ANSYS: ``.full`` files by ansys-mapdl-reader, Harwell-Boeing and MMF exports, ``.cdb`` decks."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp

from flexgram.basics import BodyError, Ints, expect_survival, whole_numbers
from flexgram.importers.containers import inputs_of
from flexgram.importers.fe import (
    FeMatrices,
    is_symmetric,
    real_or_complex,
    symmetric,
    with_skew_part,
)


def _reader() -> Any:
    try:
        import ansys.mapdl.reader as reader
    except ImportError:
        raise BodyError(
            "ANSYS files are read by ansys-mapdl-reader: pip install ansys-mapdl-reader"
        ) from None
    return reader


def read_full(path: Path, deck: Path | None = None) -> FeMatrices:
    """Read a ``.full`` file; ``deck`` is a ``.cdb`` archive for nodes, components and elements.

    Constrained dofs are rows without any entry in K and M there; they are dropped.
    """
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    reader = _reader()
    expect_survival(path, lambda: reader.read_binary(str(path)).load_km(sort=True, as_sparse=True))
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            dofs, k, m = reader.read_binary(str(path)).load_km(sort=True, as_sparse=True)
    except Exception as error:
        raise BodyError(
            f"{path}: ansys-mapdl-reader cannot read it ({error}); is it a .full file "
            "of a modal or harmonic analysis?"
        ) from error
    if m is None or m.nnz == 0:
        raise BodyError(f"{path}: holds no mass matrix: write it by a modal analysis")
    n = k.shape[0]
    K, M = (symmetric(path, a.row, a.col, a.data, n) for a in (sp.coo_matrix(k), sp.coo_matrix(m)))
    used = np.flatnonzero((abs(K).sum(axis=1).A1 > 0) | (abs(M).sum(axis=1).A1 > 0))
    fe = FeMatrices(str(path), K[used][:, used], M[used][:, used])
    fe.node = dofs[used, 0].astype(np.int64)
    fe.component = dofs[used, 1].astype(np.int64)
    if np.any((fe.component < 0) | (fe.component > 5)):
        raise BodyError(f"{path}: dof {int(fe.component.max())} is no displacement or rotation")
    if n > len(used):
        fe.remarks.append(f"{n - len(used)} constrained dofs (empty rows) were dropped")
    _add_archive(fe, deck)
    return fe


def _add_archive(fe: FeMatrices, deck: Path | None) -> None:
    if deck is None:
        fe.remarks.append("no deck: no coordinates, no node sets (--deck names the .cdb file)")
        return
    if not deck.exists():
        raise BodyError(f"{deck}: no such file")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            archive = _reader().Archive(str(deck), parse_vtk=False)
    except Exception as error:
        raise BodyError(f"{deck}: ansys-mapdl-reader cannot read it ({error})") from error
    fe.labels = np.asarray(archive.nnum, dtype=np.int64)
    fe.points = np.asarray(archive.nodes[:, :3], dtype=np.float64)
    fe.sets = {
        name.strip().upper(): np.asarray(nodes, dtype=np.int64)
        for name, nodes in archive.node_components.items()
    }
    kinds: dict[str, list[Ints]] = {}
    for element in archive.elem:
        nodes = np.asarray(element[10:], dtype=np.int64)
        kind = {8: "hexahedron", 20: "hexahedron20", 10: "tetra10"}.get(len(nodes))
        if kind and len(set(nodes.tolist())) == len(nodes):  # not degenerate
            kinds.setdefault(kind, []).append(nodes)
    fe.blocks = [(kind, np.array(nodes)) for kind, nodes in kinds.items()]


def _fields(lines: list[str], form: str, count: int, kind: type) -> list[Any]:
    """Numbers of a Fortran format such as (8I10) or (1P,4D20.12), ``count`` of them."""
    found = re.search(r"(\d*)\s*([IEDFG])(\d+)", form.upper().rpartition(",")[2])
    if not found:
        raise ValueError(f"format {form}")
    width = int(found[3])
    values: list[Any] = []
    words = re.sub("[dD]", "e", " ".join(lines)).split()
    if len(words) == count:  # columns that do not touch need no widths, which some writers miss
        return [kind(word) for word in words]
    for line in lines:
        text = line.rstrip("\n").rstrip()
        for at in range(0, len(text), width):
            word = text[at : at + width]
            if word.strip():
                values.append(kind(re.sub("[dD]", "e", word)))
    if len(values) < count:
        raise ValueError(f"{len(values)} of {count} numbers are there: truncated")
    return values[:count]


def read_harwell_boeing(path: Path) -> sp.coo_matrix:
    """A real assembled matrix in Harwell-Boeing format: RSA (one triangle), PSA or RUA.

    SciPy reads unsymmetric ones only.
    """
    lines = path.read_text(errors="replace").splitlines()
    try:
        _, *cards = (int(word) for word in lines[1].split()[:5])
        kind = lines[2][:3].upper()
        rows, columns, entries = (int(word) for word in lines[2][3:].split()[:3])
        forms = [lines[3][:16], lines[3][16:32], lines[3][32:52]]
    except (ValueError, IndexError):
        raise BodyError(f"{path}, lines 1 to 4: no Harwell-Boeing header") from None
    if max(rows, columns) > max(entries, 10**7) or entries > path.stat().st_size:
        raise BodyError(
            f"{path}: a matrix of {rows} × {columns} with {entries} entries is not in "
            f"{path.stat().st_size} bytes"
        )
    if kind[0] != "R" or kind[2] != "A" or kind[1] not in "SU":
        raise BodyError(f"{path}: type {kind}; flexgram takes real assembled matrices (RSA, RUA)")
    first = 5 if len(cards) > 3 and cards[3] > 0 else 4
    start_of = [first, first + cards[0], first + cards[0] + cards[1]]
    try:
        start = _fields(lines[start_of[0] : start_of[1]], forms[0], columns + 1, int)
        row = _fields(lines[start_of[1] : start_of[2]], forms[1], entries, int)
        value = _fields(lines[start_of[2] : start_of[2] + cards[2]], forms[2], entries, float)
    except ValueError as error:
        raise BodyError(f"{path}: {error}") from None
    if start[0] != 1 or start[-1] != entries + 1 or np.any(np.diff(start) < 0):
        raise BodyError(f"{path}: its column starts do not rise from 1 to {entries + 1}")
    if row and (min(row) < 1 or max(row) > rows):
        raise BodyError(f"{path}: row numbers from {min(row)} to {max(row)}, expected 1 to {rows}")
    column = np.repeat(np.arange(columns), np.diff(start))
    return sp.coo_matrix((value, (np.array(row) - 1, column)), shape=(rows, columns))


def _read_market(path: Path) -> sp.coo_matrix:
    """A MatrixMarket file whose header declares no more than the file can hold."""
    with path.open("rb") as file:  # without a line of sizes SciPy would look for it for ever
        if not any(line.strip() and not line.startswith(b"%") for line in file):
            raise BodyError(f"{path}: truncated: only comments are there")
    rows, columns, entries, *_ = scipy.io.mminfo(str(path))
    if max(rows, columns) > max(entries, 10**7) or entries > path.stat().st_size:
        raise BodyError(
            f"{path}: a matrix of {rows} × {columns} with {entries} entries is not in "
            f"{path.stat().st_size} bytes"
        )
    return sp.coo_matrix(scipy.io.mmread(str(path)))


def _read_inputs(path: Path) -> sp.coo_matrix:
    """B, of a MatrixMarket file or a table of numbers."""
    if path.open("rb").read(14) == b"%%MatrixMarket":
        return _read_market(path)
    try:
        comma = "," if path.suffix.lower() == ".csv" else None
        return sp.coo_matrix(np.loadtxt(path, delimiter=comma, comments=["#", "%"], ndmin=2))
    except ValueError as error:
        raise BodyError(f"{path}: neither MatrixMarket nor a table of numbers ({error})") from None


def _read_text(path: Path) -> sp.coo_matrix:
    """Triplets (row, column, value; numbers from 1, or from 0 if one is) or a whole matrix."""
    first = next(
        (
            line
            for line in path.read_text(errors="replace").splitlines()
            if line.strip() and not line.lstrip().startswith(("#", "%"))
        ),
        "",
    )
    comma = "," if "," in first else None
    try:
        values = np.loadtxt(path, delimiter=comma, comments=["#", "%"], ndmin=2)
    except ValueError as error:
        raise BodyError(f"{path}: no table of numbers ({error})") from None
    if values.shape[0] == values.shape[1]:
        return sp.coo_matrix(values)
    if values.shape[1] != 3:
        raise BodyError(
            f"{path}: {values.shape[0]} × {values.shape[1]} numbers, expected a square "
            "matrix, or row, column and value on each line"
        )
    pairs = whole_numbers(path, values[:, :2])
    pairs = pairs - (0 if pairs.min() == 0 else 1)
    n = int(pairs.max()) + 1
    if pairs.min() < 0 or n > len(values):
        raise BodyError(
            f"{path}: numbers of rows and columns from {pairs.min()} to {n}: "
            f"{len(values)} entries cannot fill that"
        )
    return sp.coo_matrix((values[:, 2], (pairs[:, 0], pairs[:, 1])), shape=(n, n))


def _node_map(path: Path | None, n: int) -> tuple[Ints, Ints]:
    """A mapping file of HBMAT or ``*EXPORT``: equation, node, direction on each line."""
    none = np.empty(0, dtype=np.int64)
    if path is None:
        return none, none
    directions = {"UX": 0, "UY": 1, "UZ": 2, "ROTX": 3, "ROTY": 4, "ROTZ": 5}
    rows: dict[int, tuple[int, int]] = {}
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    if path.open("rb").read(14) == b"%%MatrixMarket":
        raise BodyError(
            f"{path}: a vector of *EXPORT,MMF (NOD2BCS, USR2BCS) counts ANSYS' own nodes; "
            "HBMAT with MAPPING=YES writes the nodes' numbers, and file.full has them"
        )
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        words = line.split()
        if not words or not words[0].isdigit():
            continue  # heading
        try:
            rows[int(words[0]) - 1] = (int(words[1]), directions[words[2].upper()])
        except (IndexError, KeyError, ValueError):
            raise BodyError(
                f"{path}, line {number}: {line.strip()[:60]!r}, expected equation, node, UX … ROTZ"
            ) from None
    if sorted(rows) != list(range(n)):
        raise BodyError(f"{path}: maps {len(rows)} equations, the matrices have {n}")
    return (
        np.array([rows[i][0] for i in range(n)], dtype=np.int64),
        np.array([rows[i][1] for i in range(n)], dtype=np.int64),
    )


def read_pair(
    stiffness: Path,
    mass: Path,
    damping: Path | None = None,
    mapping: Path | None = None,
    deck: Path | None = None,
    inputs: Path | None = None,
) -> FeMatrices:
    """Read K and M (and D, B) from files of their own, one triangle or both.

    Harwell-Boeing, MatrixMarket, or text: ``.txt`` and ``.csv`` have row, column and value on
    each line, or the whole matrix.
    ``mapping`` is the node map that HBMAT writes with MAPPING=YES.
    """
    found, remarks = {}, []
    for name, path in (("K", stiffness), ("M", mass), ("D", damping)):
        if path is None:
            continue
        if not path.exists():
            raise BodyError(f"{path}: no such file")
        head = path.open("rb").read(64)
        try:
            market = head.startswith(b"%%MatrixMarket")
            text = path.suffix.lower() in (".txt", ".csv")
            reader = _read_market if market else _read_text if text else read_harwell_boeing
            raw = reader(path)
        except BodyError:
            raise
        except Exception as error:
            raise BodyError(f"{path}: not read as MatrixMarket; truncated? ({error})") from error
        if raw.shape[0] != raw.shape[1]:
            raise BodyError(f"{path}: {raw.shape[0]} × {raw.shape[1]}, expected a square matrix")
        if name != "K" and np.iscomplexobj(raw.data):
            raise BodyError(f"{path}: complex; K alone may be: K + iS")
        if market:  # of elements before their assembly, which SciPy writes too
            count = raw.nnz
            raw.sum_duplicates()
            if raw.nnz < count:
                remarks.append(f"{path}: {count - raw.nnz} repeated entries are summed")
        make = with_skew_part if name in "KD" else symmetric
        found[name] = make(path, raw.row, raw.col, real_or_complex(raw.data), raw.shape[0])
    fe = FeMatrices(str(stiffness), found["K"], found["M"], found.get("D"), remarks=remarks)
    fe.is_symmetric = is_symmetric(fe.K)
    if inputs is not None:
        fe.B = inputs_of(inputs, _read_inputs(inputs), fe.n)
    fe.node, fe.component = _node_map(mapping, fe.n)
    if len(fe.node) and deck is not None and deck.suffix.lower() == ".cdb":
        _add_archive(fe, deck)
    elif not len(fe.node):
        fe.remarks.append("the files have no dof map: interfaces by rows only (--rows)")
    return fe
