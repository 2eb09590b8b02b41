"""Nastran: DMIG punch or OP4 matrices, and bulk data for grids and rigid elements, by pyNastran.

Punch files come from ``PARAM,EXTOUT,DMIGPCH`` or ``EXTSEOUT(...DMIGPCH)``. Names beginning with
K, M, B are taken as stiffness, mass, damping, those of the analysis set first.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError
from flexgram.importers.fe import (
    FeMatrices,
    Interface,
    folded,
    is_symmetric,
    real_or_complex,
    symmetric,
    with_skew_part,
)

#: Our (VTK) order of nodes where Nastran's has the vertical edges before the top ones.
REORDER = {
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
    "wedge15": [*range(9), *range(12, 15), *range(9, 12)],
}
SOLIDS = {
    "CTETRA4": "tetra",
    "CTETRA10": "tetra10",
    "CHEXA8": "hexahedron",
    "CHEXA20": "hexahedron20",
    "CPENTA15": "wedge15",
    "CPYRAM5": "pyramid",
    "CPYRAM13": "pyramid13",
}


def _pynastran() -> Any:
    try:
        from pyNastran.bdf.bdf import BDF
    except ImportError:
        raise BodyError(
            "Nastran files are read by pyNastran: .venv/bin/pip install --no-deps pyNastran"
        ) from None
    return BDF


#: What of a deck is read; what else is in it may be as it likes.
CARDS = (
    "GRID",
    "GRDSET",
    "SPOINT",
    "CORD1R",
    "CORD1C",
    "CORD1S",
    "CORD2R",
    "CORD2C",
    "CORD2S",
    "CTETRA",
    "CHEXA",
    "CPENTA",
    "RBE2",
    "RBE3",
)


def _cards_of(text: str, cards: Sequence[str]) -> str:
    """The cards of these names with their continuations, from BEGIN BULK on if there is one: what
    else a deck or a punch file holds may be as it likes."""
    lines = text.splitlines()
    starts = [k for k, line in enumerate(lines) if re.match(r"\s*BEGIN\b", line, re.I)]
    kept, wanted = [], False
    for line in lines[starts[0] + 1 if starts else 0 :]:
        plain = line.split("$", 1)[0].rstrip()
        if not plain:
            continue
        first = re.split(r"[,\s*]", plain.lstrip(), maxsplit=1)[0].upper()
        goes_on = plain[0] in "+*," or (plain[0] == " " and plain[:8].strip() == "")
        if not goes_on:
            wanted = first in cards
        if wanted:
            kept.append(plain)
    return "\n".join(kept) + "\n"


@contextlib.contextmanager
def reading(path: Path) -> Iterator[tuple[Any, Path]]:
    """A quiet model of pyNastran for a file of text, and a folder for other files. Its many errors
    become one. The folder is the working directory: pyNastran leaves a file there where an INCLUDE
    is missing."""
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    if b"\0" in path.open("rb").read(4096):
        raise BodyError(f"{path}: binary, expected bulk data as text")
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            warnings.catch_warnings(),
            tempfile.TemporaryDirectory() as folder,
            contextlib.chdir(folder),
        ):
            warnings.simplefilter("ignore")
            yield _pynastran()(debug=None), Path(folder)
    except BodyError:
        raise
    except (Exception, SystemExit) as error:
        raise BodyError(f"{path}: {_in_words(error)}") from error


def _in_words(error: BaseException) -> str:
    """What pyNastran says, without its lists."""
    said = " ".join(str(error).replace("\\n", " ").split()).strip("'")
    if missing := re.search(r"(\w+)=(\d+) is not .*?required by (\w+) (\w+=\d+)", said):
        kind = {"nid": "grid", "eid": "element", "mid": "material", "pid": "property"}
        what = kind.get(missing[1], missing[1])
        return f"{what} {missing[2]} of {missing[3]} {missing[4]} is not in the deck"
    if missing := re.search(r"KeyError: '(\w+)' card=(.*)", said):
        card = missing[2].strip()[:80]
        return f"something that a card refers to ({missing[1]}) is not in the deck: {card}"
    if "must be a" in said:  # a word in the place of a number
        return f"pyNastran cannot read it: {said[:300]}"
    reason = said[:300] or type(error).__name__
    return f"pyNastran cannot read it ({reason}): is the card right, and the file complete?"


def _bulk_data(path: Path, punch: bool | None) -> Any:
    """A parsed file; pyNastran's many errors as one. punch: its DMIG; None: the ``CARDS`` of a
    deck."""
    path = path.absolute()
    with reading(path) as (model, folder):
        cards = ("DMIG",) if punch else CARDS
        model.enable_cards(cards)
        text = path.read_text(errors="replace")
        if re.search(r"^\s*INCLUDE\b", text, re.M | re.I):  # read as it is
            begins = re.search(r"^\s*BEGIN\s*,?\s*BULK", text, re.M | re.I)
            model.read_bdf(str(path), punch=not begins, xref=False, validate=False)
        else:
            wanted = folder / "wanted.bdf"
            wanted.write_text(_cards_of(text, cards))
            model.read_bdf(str(wanted), punch=True, xref=False, validate=False)
    return model


#: The matrices of a role, in the order in which they are looked for: of the analysis set first.
ROLES = {
    "K": ("KAA", "KXX", "KHH", "KLL", "KFF", "KGG", "KJJ"),
    "M": ("MAA", "MXX", "MHH", "MLL", "MFF", "MGG", "MJJ"),
    "D": ("BAA", "BXX", "BHH", "BLL", "BFF", "BGG", "BJJ"),
    "S": (),  # K4AA and so on, if they are asked for
}


def _role(names: list[str], role: str, path: Path, asked: Mapping[str, str]) -> str | None:
    """The matrix of a role: by the user's words, by its usual names, or the only one whose name
    begins with the letter (K4 is structural damping, not K)."""
    there = f"there are {', '.join(names) or 'none'} (--matrices K=KXX,M=MXX names them)"
    if role in asked:
        for name in names:
            if name.upper() == asked[role].upper():
                return name
        raise BodyError(f"{path}: no matrix {asked[role]}; {there}")
    if role == "S":
        return None
    for usual in ROLES[role]:
        for name in names:
            if name.upper() == usual:
                return name
    letter = "B" if role == "D" else role
    found = [n for n in names if n.upper().startswith(letter) and not n.upper().startswith("K4")]
    if len(found) > 1 and role != "D":
        raise BodyError(
            f"{path}: several matrices could be {role}: {', '.join(found)} "
            "(--matrices K=KXX,M=MXX names them)"
        )
    if role != "D" and not found:
        raise BodyError(f"{path}: no matrix is {role}; {there}")
    return found[0] if len(found) == 1 else None


def _left_out(fe: FeMatrices, names: list[str], taken: list[str | None]) -> None:
    """Name what is not read."""
    lossy = [n for n in names if n.upper().startswith("K4") and n not in taken]
    if lossy:
        fe.remarks.append(
            f"structural damping {', '.join(lossy)} is left out: --matrices S={lossy[0]} takes it, "
            "or give --eta"
        )
    rest = [name for name in names if name not in taken and name not in lossy]
    if rest:
        fe.remarks.append(f"other matrices of the file are not needed: {', '.join(rest)}")
    if any(str(name).upper() in ("KXX", "MXX") for name in taken):
        fe.remarks.append(
            "KXX is a reduced body (EXTSEOUT): rows of boundary dofs and modal "
            "coordinates; name the former by --rows"
        )


def _dmig(path: Path, asked: Mapping[str, str]) -> FeMatrices:
    model = _bulk_data(path, punch=True)
    names = list(model.dmig)
    if not names:
        raise BodyError(
            f"{path}: no DMIG: is this a punch file? --assemble assembles bulk data of elements"
        )
    entries: dict[str, tuple[Any, Any, Any]] = {}
    roles: dict[str, str] = {}
    for letter in ROLES:
        name = _role(names, letter, path, asked)
        if name is None:
            continue
        card = model.dmig[name]
        roles[letter] = name
        if card.is_complex and letter != "K":
            raise BodyError(f"{path}: DMIG {name} is complex; K alone may be: K + iS")
        row, column = np.array(card.GCi), np.array(card.GCj)
        value = np.array(card.Real, dtype=float)
        if card.is_complex:
            value = value + 1j * np.array(card.Complex, dtype=float)
        entries[letter] = (row, column, value)
    codes = {
        letter: [8 * e[:, 0].astype(np.int64) + e[:, 1].astype(np.int64) for e in data[:2]]
        for letter, data in entries.items()
    }
    dofs = np.unique(np.concatenate([c for pair in codes.values() for c in pair]))
    matrices = {}
    for letter, (row, column) in codes.items():
        at = np.searchsorted(dofs, row), np.searchsorted(dofs, column)
        whole = with_skew_part if letter in "KD" else symmetric
        make = folded if model.dmig[roles[letter]].matrix_form == 6 else whole
        matrices[letter] = make(f"{path}, {letter}", *at, entries[letter][2], len(dofs))
    node, component = dofs // 8, dofs % 8 - 1
    scalar = component < 0
    fe = FeMatrices(str(path), matrices["K"], matrices["M"], matrices.get("D"), S=matrices.get("S"))
    fe.is_symmetric = model.dmig[roles["K"]].matrix_form == 6 or is_symmetric(fe.K)
    _left_out(fe, names, list(roles.values()))
    fe.node, fe.component = node, np.maximum(component, 0)
    if scalar.any():
        fe.remarks.append(
            f"{scalar.sum()} scalar points are modal coordinates or the like, "
            "without a place in space: no coordinates are kept; interfaces are found "
            f"among the {len(np.unique(node[~scalar]))} grids"
        )
    return fe


def _op4(path: Path, asked: Mapping[str, str]) -> FeMatrices:
    _pynastran()
    from pyNastran.op4.op4 import read_op4

    if not path.exists():
        raise BodyError(f"{path}: no such file")
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            matrices = read_op4(str(path), debug=None)
    except (Exception, SystemExit) as error:
        raise BodyError(
            f"{path}: pyNastran cannot read it ({error}); is the file complete?"
        ) from error
    # A matrix that Nastran does not have is one zero.
    empty = {
        name
        for name, matrix in matrices.items()
        if matrix.data.shape == (1, 1) and not sp.coo_matrix(matrix.data).nnz
    }
    names = [name for name in matrices if name not in empty]
    roles = {role: _role(names, role, path, asked) for role in ROLES}
    if roles["D"] and "D" not in asked and roles["K"]:
        shape = matrices[roles["K"]].data.shape
        if matrices[roles["D"]].data.shape != shape:  # guessed, and of another set
            roles["D"] = None
    found = {}
    for role, name in roles.items():
        if name is None:
            continue
        data = sp.coo_matrix(matrices[name].data)
        wrong_kind = role != "K" and np.iscomplexobj(data.data)
        if data.shape[0] != data.shape[1] or wrong_kind:
            raise BodyError(
                f"{path}: {name} is {data.shape[0]} × {data.shape[1]}"
                f"{' and complex' if wrong_kind else ''}; {role} is "
                "square and real, but for K (--matrices K=KXX,M=MXX names them)"
            )
        make = with_skew_part if role in "KD" else symmetric
        found[role] = make(
            f"{path}, {name}", data.row, data.col, real_or_complex(data.data), data.shape[0]
        )
    sizes = {matrix.shape[0] for matrix in found.values()}
    if len(sizes) > 1:
        words = ", ".join(f"{roles[r]} {m.shape[0]}" for r, m in found.items())
        raise BodyError(
            f"{path}: matrices of different sets: {words} rows (--matrices K=KXX,M=MXX "
            "names others)"
        )
    fe = FeMatrices(str(path), found["K"], found["M"], found.get("D"), S=found.get("S"))
    fe.is_symmetric = is_symmetric(fe.K)
    _left_out(fe, names, list(roles.values()))
    return fe


def _turned(Q: sp.csr_matrix, matrix: sp.csr_matrix) -> sp.csr_matrix:
    """Q A Qᵀ, symmetric without rounding where A is."""
    turned = sp.csr_matrix(Q @ matrix @ Q.T)
    return 0.5 * (turned + turned.T) if is_symmetric(matrix) else turned


def _to_basic(fe: FeMatrices, model: Any, deck: Path) -> None:
    """Turn rows of grids with a displacement coordinate system (CD) into the basic one."""
    present = set(fe.node.tolist())
    turned = {n: grid for n, grid in model.nodes.items() if grid.cd and n in present}
    if not turned:
        return
    rows, columns, values = [], [], []
    plain = ~np.isin(fe.node, list(turned))
    for label, grid in turned.items():
        coord = grid.cd_ref
        axes = np.array(coord.beta(), dtype=float)  # rows: the system's axes
        if coord.type[5] in "CS":  # along r, θ, z (or r, θ, φ) at the grid itself
            x, y, z = axes @ (grid.get_position() - coord.origin)
            r = np.hypot(x, y)
            c, s = (x / r, y / r) if r > 0 else (1.0, 0.0)
            local = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            if coord.type[5] == "S":
                R = np.hypot(r, z)
                st, ct = (r / R, z / R) if R > 0 else (0.0, 1.0)
                local = np.array([[st * c, st * s, ct], [ct * c, ct * s, -st], [-s, c, 0]])
            axes = local @ axes
        for first in (0, 3):
            own = np.flatnonzero((fe.node == label) & (fe.component // 3 == first // 3))
            if len(own) == 0:
                continue
            if len(own) != 3:
                raise BodyError(
                    f"{deck}: grid {label} has a displacement coordinate system (CD) "
                    f"and only {len(own)} of three components in the matrices: they "
                    "cannot be turned into the basic one"
                )
            own = own[np.argsort(fe.component[own])]
            rows += np.repeat(own, 3).tolist()  # basic = axesᵀ local
            columns += np.tile(own, 3).tolist()
            values += axes.T.ravel().tolist()
    same = np.flatnonzero(plain)
    Q = sp.csr_matrix(
        (
            np.concatenate([values, np.ones(len(same))]),
            (np.concatenate([rows, same]), np.concatenate([columns, same])),
        ),
        shape=(fe.n, fe.n),
    )
    for name in ("K", "M", "D", "S"):
        if (matrix := getattr(fe, name)) is not None:
            setattr(fe, name, _turned(Q, matrix))
    fe.remarks.append(
        f"{len(turned)} grids have displacement coordinate systems (CD): their rows "
        "are turned into the basic one"
    )


def read_nastran(
    path: Path, deck: Path | None = None, matrices: Mapping[str, str] | None = None
) -> FeMatrices:
    """Read a punch file (``.pch``, ``.dmig``, ``.bdf`` with DMIG) or OP4 (``.op4``).

    The deck gives grids, elements for pictures, and RBE2 and RBE3 elements, which
    become interfaces where Nastran has not condensed them already. ``matrices`` maps K, M, D to
    names of the file where these are not the usual ones.
    """
    reader = _op4 if path.suffix.lower() == ".op4" else _dmig
    fe = reader(path, matrices or {})
    if deck is None:
        fe.remarks.append("no deck: no coordinates, no node sets (--deck names the bulk data)")
        return fe
    model = _bulk_data(deck, None)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            others = (
                "elements",
                "properties",
                "masses",
                "materials",
                "loads",
                "constraints",
                "aero",
                "sets",
                "optimization",
            )
            model.cross_reference(**{f"xref_{what}": False for what in others})
    except (Exception, SystemExit) as error:
        raise BodyError(
            f"{deck}: its grids cannot be placed ({str(error).strip().splitlines()[0]})"
        ) from error
    fe.labels = np.array(sorted(model.nodes), dtype=np.int64)
    fe.points = np.array([model.nodes[int(n)].get_position() for n in fe.labels])
    if not len(fe.node):
        per_node = fe.n // max(len(fe.labels), 1)
        if per_node in (3, 6) and per_node * len(fe.labels) == fe.n:
            fe.node = np.repeat(fe.labels, per_node)
            fe.component = np.tile(np.arange(per_node), len(fe.labels))
            fe.remarks.append(f"OP4 has no dof map: {per_node} dofs a grid, by rising number")
        else:
            fe.points = np.empty((0, 3))
            fe.remarks.append(
                f"OP4 has no dof map, and {fe.n} rows are not 3 or 6 for each of "
                f"{len(fe.labels)} grids: no coordinates"
            )
    _to_basic(fe, model, deck)
    by_kind: dict[str, list[list[int]]] = {}
    for element in model.elements.values():
        nodes = [int(n) for n in element.nodes if n]
        kind = SOLIDS.get(f"{element.type}{len(nodes)}")
        if kind is not None:
            by_kind.setdefault(kind, []).append(nodes)
    for kind, lists in by_kind.items():
        table = np.array(lists, dtype=np.int64)
        fe.blocks.append((kind, table[:, REORDER[kind]] if kind in REORDER else table))
    present = set(fe.node.tolist())
    for number, element in model.rigid_elements.items():
        weights = None
        if element.type == "RBE2":
            coupling, reference, nodes = "rigid", element.Gn(), list(element.Gmi)
            components = {str(element.cm)}
        elif element.type == "RBE3":
            coupling, reference = "distributing", element.ref_grid_id
            groups = list(zip(element.weights, element.Gijs, strict=True))
            nodes = [n for _, group in groups for n in group]
            weights = np.array([float(w) for w, group in groups for _ in group])
            components = {str(c) for c in element.comps}
        else:
            continue
        labels = np.array(nodes, dtype=np.int64)
        turning = set(fe.node[fe.component >= 3].tolist()) & set(nodes)
        if (
            not components <= {"123", "123456"}
            or (turning and len(components) > 1)
            or (turning and components != ({"123456"} if coupling == "rigid" else {"123"}))
        ):
            raise BodyError(
                f"{deck}: {element.type} {number} couples the components "
                f"{', '.join(sorted(components))}; only all of each node's (RBE2) or "
                "its translations 123 (RBE3) are supported"
            )
        name = f"{element.type}-{number}"
        fe.sets[name] = labels
        if set(labels.tolist()) <= present and reference not in present:
            at = fe.positions(np.array([reference]))[0]
            fe.interfaces.append(Interface(name, coupling, labels, at, weights))
    return fe
