"""CalculiX: ``job.sti``, ``job.mas``, ``job.dof`` of a matrix-storage step, and the deck.

The step is ``*FREQUENCY, SOLVER=MATRIXSTORAGE``; ``ccx`` makes one of a deck's steps and runs it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from flexgram.basics import BodyError, Floats, Ints, index_of, whole_numbers
from flexgram.importers import ccx
from flexgram.importers.deck import read_deck
from flexgram.importers.deck_loads import attach_loads, in_steps
from flexgram.importers.fe import (
    REDUCED,
    FeMatrices,
    check_indices,
    read_triplets,
    rigid_motions,
    symmetric,
)


def _matrix(path: Path, n: int) -> sp.csr_matrix:
    data = read_triplets(path)
    row, column = (whole_numbers(path, data[:, i]).astype(np.int32) for i in (0, 1))
    value = data[:, 2].copy()
    del data
    check_indices(path, row, n, "the lines of the .dof file")
    check_indices(path, column, n, "the lines of the .dof file")
    seen = np.zeros(n, dtype=bool)
    seen[row - 1] = True
    if not seen.all():
        raise BodyError(
            f"{path}: row {int(np.argmin(seen)) + 1} of {n} has no entry: the file is "
            "truncated or belongs to another .dof file"
        )
    return symmetric(path, row - 1, column - 1, value, n)


def read_calculix(
    path: Path,
    deck: Path | None = None,
    own: Path | None = None,
    loads: bool = False,
    free: FeMatrices | None = None,
) -> FeMatrices:
    """Read ``job.sti``, ``job.mas``, ``job.dof`` beside each other; ``path`` names any of them or
    the deck ``job.inp``, which gives coordinates, node sets and damping; ``own`` is the user's
    deck if that one was made of it; with ``loads`` those of its steps become inputs; ``free`` are
    the matrices of the body without its supports, which know where expanded nodes are.

    Raises
    ------
    BodyError
        For missing, truncated or inconsistent files, with the line.
    """
    # Not with_suffix: part.v2.sti is of the job part.v2.
    job = path.with_name(re.sub(r"\.(sti|mas|dof|inp)$", "", path.name, flags=re.IGNORECASE))
    files = {suffix: path.with_name(job.name + suffix) for suffix in (".sti", ".mas", ".dof")}
    for suffix, file in files.items():
        if not file.exists():
            what = {".sti": "K", ".mas": "M", ".dof": "the dof map"}[suffix]
            raise BodyError(
                f"{file} ({what}) is missing; ccx writes it in a step *FREQUENCY, "
                "SOLVER=MATRIXSTORAGE. --assemble needs no such files; --run-ccx makes them"
            )
    node, component = [], []
    for number, line in enumerate(files[".dof"].read_text(errors="replace").splitlines(), 1):
        label, dot, direction = line.strip().partition(".")
        # never as a float: 12.10 is not 12.1
        if not dot or not label.lstrip("-").isdigit() or direction not in tuple("123456"):
            if not line.strip():
                continue
            raise BodyError(
                f"{files['.dof']}, line {number}: {line.strip()[:40]!r}, expected "
                "node.direction with direction 1 to 6"
            )
        node.append(int(label))
        component.append(int(direction) - 1)
    n = len(node)
    if n == 0:
        raise BodyError(
            f"{files['.dof']}: empty: the deck has no free mechanical dof (every node is held, or "
            "its elements are of heat or flow alone)"
        )
    K = _matrix(files[".sti"], n)
    M = _matrix(files[".mas"], n)
    fe = FeMatrices(
        str(job), K, M, node=np.array(node, dtype=np.int64), component=np.array(component)
    )
    deck = deck or path.with_name(job.name + ".inp")
    if not deck.exists():
        fe.remarks.append(f"{deck} is not there: no coordinates, no node sets (--deck names it)")
        return fe
    model = read_deck(deck)
    fe.labels, fe.points, fe.sets, fe.blocks = model.labels, model.points, model.sets, model.blocks
    fe.remarks += model.remarks
    # ccx numbers a rotation node that the deck does not name by itself: a label of its own with
    # three rows, in the order of the rigid bodies.
    unnamed = [name for name, (_, rotation) in model.rigid.items() if rotation is None]
    strangers = [
        n for n in np.unique(fe.node[~np.isin(fe.node, fe.labels)]) if np.sum(fe.node == n) == 3
    ]
    made = dict(zip(unnamed, strangers, strict=False)) if len(strangers) == len(unnamed) else {}
    for name, (reference, named) in model.rigid.items():
        # The rotation node's "translations" are the rotations of the reference node.
        rotation = named if named is not None else made.get(name)
        turns = fe.node == rotation
        if rotation is None or rotation == reference or not turns.any():
            fe.remarks.append(
                f"*RIGID BODY {name}: its rotation rows are not known (give it a ROT "
                "NODE); its reference node has translations only"
            )
            continue
        if turns.sum() != 3:
            missing = [n for c, n in enumerate("xyz") if not np.any(fe.component[turns] == c)]
            fe.remarks.append(
                f"*RIGID BODY {name}: it has no free rotation about {', '.join(missing)} (nodes "
                "on a line, or it is held): no moment about that is a port"
            )
        fe.node[turns] = reference
        fe.component[turns] += 3
        fe.rigid[name] = reference
    _expand(fe, free)
    job_of_user = ccx.read_job(own or deck)
    _take_damping(fe, ccx.damping_of(job_of_user))
    if loads:
        attach_loads(fe, job_of_user, model)
    elif words := in_steps(job_of_user):
        fe.remarks.append(f"loads of the deck become inputs by --deck-loads ({words})")
    known = np.isin(fe.node, fe.labels)
    if not known.all():
        fe.remarks.append(
            f"{len(np.unique(fe.node[~known]))} nodes are not in the deck (expanded shells or "
            "beams, internal nodes of C3D8I): interfaces are found by the places of the others, "
            "and no coordinates are kept"
        )
    fe.deck = own or deck
    elements = (card for card in job_of_user.model if card.keyword == "ELEMENT")
    fe.types = {card.options.get("TYPE", "").upper() for card in elements}
    fe.remarks += doubts_of_elements(fe.types)
    return fe


def doubts_of_elements(types: set[str]) -> list[str]:
    """What element types of a deck are known to get wrong in ccx."""
    found = []
    if reduced := sorted(types & REDUCED):
        found.append(
            f"{', '.join(reduced)}: ccx computes these with one integration point and a hourglass "
            "stiffness, and bends them wrong by factors: take C3D8I, C3D20R or C3D10, S4 or S8R, "
            "B31 or B32"
        )
    if "C3D8" in types:
        found.append("C3D8 is too stiff in bending: C3D8I, C3D20R and C3D10 converge faster")
    if types & {"C3D4", "C3D6"}:
        found.append("linear tetrahedra and wedges are too stiff: C3D10 and C3D15 converge faster")
    return found


def _take_damping(fe: FeMatrices, damping: ccx.Damping) -> None:
    """Rayleigh coefficients, and D of the dashpots: c e eᵀ along the line between their nodes."""
    fe.alpha, fe.beta, fe.eta = damping.alpha, damping.beta, damping.eta
    fe.remarks += damping.remarks
    if any(damping.loss_factors.values()):
        fe.remarks.append(
            "*DAMPING, STRUCTURAL of the materials differs: it is left out (--eta, or --assemble, "
            "which reads it)"
        )
    if not damping.dashpots:
        return
    held: set[tuple[int, int]] = set()
    for name, first, last in damping.held:
        labels = [int(name)] if name.isdigit() else fe.sets.get(name, [])
        held |= {(int(n), c) for n in labels for c in range(first - 1, last)}
    D = sp.lil_matrix((fe.n, fe.n))
    taken = 0
    for first, second, constant in damping.dashpots:
        ends = np.searchsorted(fe.labels, [first, second])
        line = fe.points[ends[1]] - fe.points[ends[0]]
        length = float(np.linalg.norm(line))
        whole = length > 0
        rows: list[int] = []
        shares: list[float] = []
        for node, sign in ((first, 1.0), (second, -1.0)):
            for direction in np.flatnonzero(line):
                own = np.flatnonzero((fe.node == node) & (fe.component == direction))
                whole &= len(own) == 1 or (len(own) == 0 and (node, int(direction)) in held)
                rows += own.tolist()
                shares += [sign * line[direction] / length] * len(own)
        if not whole:
            fe.remarks.append(
                f"the dashpot between nodes {first} and {second} is left out: they "
                "are in one place, or depend on other nodes"
            )
            continue
        D[np.ix_(rows, rows)] += constant * np.outer(shares, shares)
        taken += 1
    if taken:
        fe.D = D.tocsr()
        fe.remarks.append(f"{taken} dashpot{'s' if taken > 1 else ''} of the deck in D")


def _expand(fe: FeMatrices, free: FeMatrices | None = None) -> None:
    """Nodes of shells and beams, which ccx expands to solids: a label has the rows of two, three or
    more nodes, and nobody says where these are. In a free body rigid rotations cost no energy: of
    all places whose mean is that of the label, the expanded nodes are at those where they do not.
    A held body has the places of the free one. Each node gets a label of its own, and is in the
    sets that the label is in.
    """
    if free is not None and free.copies:
        _take_places(fe, free)
        return
    first = np.flatnonzero(fe.component == 0)
    together = (len(fe.node) == 3 * len(first)) and np.array_equal(
        fe.component, np.tile(np.arange(3), len(first))
    )
    label, count = np.unique(fe.node[first], return_counts=True)
    several = label[(count > 1) & np.isin(label, fe.labels)]
    if not len(several):
        return
    if not together or len(first) != count.sum():
        fe.remarks.append(
            "nodes of shells or beams have several rows, some of them held: where "
            "these are is not known, no coordinates are kept (--run-ccx finds them)"
        )
        fe.points, fe.hides_places = np.empty((0, 3)), True
        return
    # Nodes of the rows, three rows each; unknown places of the expanded ones about the label's.
    # Internal nodes (S4, B31: incompatible modes) do not take part in rigid motion.
    at, inside = index_of(fe.labels, fe.node[first])
    base = np.where(inside[:, None], fe.points[at], 0.0)
    expanded = np.isin(fe.node[first], several)
    order = np.argsort(fe.node[first], kind="stable")
    last = np.zeros(len(first), dtype=bool)  # the last copy of each label makes the mean right
    ends = np.flatnonzero(np.diff(np.append(fe.node[first][order], -1)))
    last[order[ends]] = True
    loose = np.flatnonzero(expanded & ~last)
    unknown = np.full(len(first), -1)
    unknown[loose] = np.arange(len(loose))
    copies = [(unknown[i], i, 1.0) for i in loose]
    tail = dict(zip(fe.node[first][expanded & last], np.flatnonzero(expanded & last), strict=True))
    copies += [(unknown[i], tail[fe.node[first[i]]], -1.0) for i in loose]
    column, node, sign = (np.array(part) for part in zip(*copies, strict=True))
    place = sp.csr_matrix((sign, (node, column)), shape=(len(first), len(loose)))
    place = sp.kron(place, sp.identity(3), format="csr")  # places of all nodes by the unknown ones
    A = sp.csr_matrix((3 * len(loose), 3 * len(loose)))
    b = np.zeros(3 * len(loose))
    for axis in np.eye(3):
        turn = np.array([np.cross(axis, e) for e in np.eye(3)]).T  # x -> axis × x
        turned = sp.kron(sp.identity(len(first)), turn, format="csr")
        S = turned @ place
        KS = fe.K @ S
        A = A + S.T @ KS
        b -= KS.T @ (turned @ base.ravel())
    offset = place @ splu(A.tocsc()).solve(b)
    points = base + offset.reshape(-1, 3)
    motion = rigid_motions(np.repeat(points, 3, axis=0), fe.component)
    motion[~np.repeat(inside, 3)] = 0
    energy = np.einsum("ij,ij->j", motion, fe.K @ motion)
    scale = np.einsum("ij,i,ij->j", motion, fe.K.diagonal(), motion)
    if not np.all(np.abs(energy) <= 1e-9 * scale):
        fe.remarks.append(
            "nodes of shells or beams are expanded, and the body is held: where they "
            "are is not known, no coordinates are kept (import it free, or by --run-ccx)"
        )
        fe.points, fe.hides_places = np.empty((0, 3)), True
        return
    old = fe.node[first][expanded]
    triples = np.flatnonzero(np.repeat(expanded, 3)).reshape(-1, 3)
    _name_copies(fe, old, list(triples), points[expanded])


def _name_copies(fe: FeMatrices, old: Ints, rows: Sequence[Ints], points: Floats) -> None:
    """Labels of their own for expanded nodes: ``old`` is what the deck calls each, ``rows`` are its
    rows, ``points`` its places."""
    fresh = np.arange(len(old)) + max(fe.labels.max(), fe.node.max()) + 1
    for label, own in zip(fresh, rows, strict=True):
        fe.node[own] = label
    several = np.unique(old)
    fe.thin = True
    fe.copies = {int(label): fresh[old == label] for label in several}
    fe.labels = np.concatenate([fe.labels, fresh])
    fe.points = np.vstack([fe.points, points])
    for name, members in fe.sets.items():
        fe.sets[name] = np.concatenate(
            [members[~np.isin(members, several)], fresh[np.isin(old, members)]]
        )
    fe.remarks.append(
        f"{len(several)} nodes of shells or beams are {len(old)} of the solids "
        "that ccx makes of them; sets hold these"
    )


def _take_places(fe: FeMatrices, free: FeMatrices) -> None:
    """Places of a held body's expanded nodes: those of the free body, whose copies of a label come
    in the same order. Of a label that supports touch it is not known which copies are left: its
    rows are at the place of the label itself."""
    at = dict(zip(free.labels.tolist(), free.points, strict=True))
    own = dict(zip(fe.labels.tolist(), fe.points, strict=True))
    by_label: dict[int, list[list[int]]] = {}
    for row, (label, component) in enumerate(zip(fe.node.tolist(), fe.component, strict=True)):
        if label in free.copies:
            groups = by_label.setdefault(label, [])
            if not groups or component <= fe.component[groups[-1][-1]]:
                groups.append([])
            groups[-1].append(row)
    old, rows, points, touched = [], [], [], 0
    for label, groups in by_label.items():
        copies = free.copies[label]
        whole = len(groups) == len(copies) and all(len(group) == 3 for group in groups)
        touched += not whole
        for k, group in enumerate(groups):
            old.append(label)
            rows.append(np.array(group))
            points.append(at[int(copies[k])] if whole else own[label])
    if not old:
        return
    _name_copies(fe, np.array(old, dtype=np.int64), rows, np.array(points))
    if touched:
        fe.remarks.append(
            f"rows of {touched} partly held nodes of shells or beams are at the place of the node "
            "itself, not of its copy"
        )
