"""What every importer returns: the matrices of an FE code with its nodes, and how to check them."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexgram.basics import BodyError, Floats, Ints, index_of
from flexgram.body.laws import Law
from flexgram.body.terms import split_stiffness


@dataclass
class Interface:
    """Where forces act.

    ``rigid``: all nodes follow a reference node with six dofs (RBE2). ``distributing``: the
    reference node is the least-squares motion of the nodes (RBE3). ``node``: the dofs of each node
    are ports. ``rows``: rows of the matrices (1-based) are ports.
    """

    name: str
    coupling: str
    where: str | Ints  #: a selector such as ``NSET:TOP``, or labels (rows)
    position: Floats | None = None  #: of the reference node; default: the middle of the nodes
    weights: Floats | None = None  #: of the nodes of a distributing interface; default: equal


#: Element types with one integration point, and ccx's hourglass stiffness against its zero modes.
REDUCED = {"C3D8R", "S4R", "B31R", "CPS4R", "CPE4R", "CAX4R"}


def rigid_motions(points: Floats, component: Ints) -> Floats:
    """Three translations and three rotations about the origin on rows, n x 6: ``points`` (n, 3) are
    the places of the rows' nodes, ``component`` 0-2 a translation, 3-5 a rotation."""
    motions = np.zeros((len(points), 6))
    row, moves = np.arange(len(points)), component < 3
    motions[row, component] = 1
    for axis in range(3):
        turned = np.cross(np.eye(3)[axis], points)
        motions[row[moves], 3 + axis] = turned[row[moves], component[moves]]
    return motions


def check_damping(alpha: float | None, beta: float | None, eta: float | None) -> None:
    """Refuse what no damping can be."""
    for name, value in (("alpha", alpha), ("beta", beta), ("eta", eta)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise BodyError(f"--{name} {value}: damping must be finite and not negative")


@dataclass
class FeMatrices:
    """Matrices of an FE code in its own units, both triangles stored.

    Attributes
    ----------
    K, M, D, S : csr_matrix, n x n
        Stiffness, mass, and damping or structural damping if the code wrote one. D may have a skew
        part, and K of MATLAB and PETSc files. The imaginary part of a complex K becomes S, or eta.
    node, component : int arrays, n
        For each row the label of its node and 0-2 for a translation, 3-5 for a rotation; empty
        where the files do not say.
    labels, points : arrays, N and N x 3
        Nodes of the model; those of constrained rows too. Empty without coordinates.
    sets : dict
        Node sets by name, as labels.
    blocks : list of (str, array)
        Elements as meshio type and node labels; for pictures.
    terms : dict
        Terms g(ω)T of materials by name: (T, its law), T like K.
    B, C, inputs, outputs
        Ports that came with the matrices (MATLAB, PETSc); usually interfaces are named instead.
    loads : dict
        Loads beside the interfaces, (n,) forces by the names of their inputs.
    measured : dict
        Outputs beside the interfaces, (n,) weights of displacements in SI units by their names.
    rigid : dict
        Rigid couplings that the code itself condensed: name -> label of the reference node, which
        has six rows.
    interfaces : list of Interface
        Couplings of the FE model that its matrices do not hold yet; kept as interfaces.
    alpha, beta, eta : float
        Damping coefficients that came with the matrices.
    remarks : list of str
        What the importer did that the user should know.
    """

    source: str
    K: sp.csr_matrix
    M: sp.csr_matrix
    D: sp.csr_matrix | None = None
    node: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    component: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    labels: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    sets: dict[str, Ints] = field(default_factory=dict)
    blocks: list[tuple[str, Ints]] = field(default_factory=list)
    B: Any = None
    C: Any = None
    inputs: list[str] | None = None
    outputs: list[str] | None = None
    loads: dict[str, Floats] = field(default_factory=dict)
    S: sp.csr_matrix | None = None
    terms: dict[str, tuple[sp.csr_matrix, Law]] = field(default_factory=dict)
    measured: dict[str, Floats] = field(default_factory=dict)
    rigid: dict[str, int] = field(default_factory=dict)
    interfaces: list[Interface] = field(default_factory=list)
    alpha: float = 0.0
    beta: float = 0.0
    eta: float = 0.0
    is_symmetric: bool = True  #: K; else its skew part is of circulatory forces
    thin: bool = False  #: of shells or beams: distances of nodes tell no volume
    #: nodes that the code expands to several: label -> labels of these
    copies: dict[int, Ints] = field(default_factory=dict)
    hides_places: bool = False  #: such nodes are somewhere, but the held body does not say where
    deck: Path | None = None  #: of CalculiX
    types: set[str] = field(default_factory=set)  #: element types of the deck, as it names them
    remarks: list[str] = field(default_factory=list)
    _indexed: list[tuple[str, Ints]] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Split a complex K."""
        if not np.iscomplexobj(self.K):
            return
        given = self.eta
        self.K, self.S, self.eta = split_stiffness(self.K, self.S, given, f"{self.source}: K")
        added = f"the loss factor {self.eta - given:.6g}" if self.eta > given else "S"
        self.remarks.append(f"K is complex: its imaginary part is structural damping, {added}")

    @property
    def n(self) -> int:
        return int(self.K.shape[0])

    def placed(self) -> NDArray[np.bool_]:
        """Which rows belong to a node with coordinates (n,): not those of internal nodes (C3D8I) or
        scalar points, which no rigid motion moves."""
        if len(self.node) != self.n or not len(self.points):
            return np.zeros(self.n, dtype=bool)
        return index_of(self.labels, self.node)[1]

    def has_coordinates(self) -> bool:
        """Whether every row has a place."""
        return bool(self.placed().all()) and len(self.points) > 0

    def indexed_blocks(self) -> list[tuple[str, Ints]]:
        """Elements by indices into ``points``, where all their nodes are known."""
        if self._indexed is None:
            self._indexed = []
            for kind, connectivity in self.blocks if self.placed().any() else ():
                at, known = index_of(self.labels, connectivity)
                if known.all():
                    self._indexed.append((kind, at))
        return self._indexed

    def positions(self, labels: Ints) -> Floats:
        """Coordinates of the given labels; a label without coordinates is an error."""
        if not len(self.points):
            raise BodyError(
                f"{self.source}: the nodes have no coordinates (--deck names the model)"
            )
        at, known = index_of(self.labels, np.asarray(labels))
        missing = np.asarray(labels)[~known]
        if len(missing):
            raise BodyError(
                f"{self.source}: node {missing[0]} has no coordinates in the deck"
                f" ({len(np.unique(missing))} such nodes)"
            )
        return self.points[at]


def folded(path: Path | str, row: Any, column: Any, value: Any, n: int) -> sp.csr_matrix:
    """A symmetric matrix from triplets (0-based) of a format that stores each pair once, in either
    triangle; a pair given both ways must be the same twice."""
    low, high = np.minimum(row, column).astype(np.int64), np.maximum(row, column).astype(np.int64)
    code, first, inverse = np.unique(low * n + high, return_index=True, return_inverse=True)
    value = real_or_complex(value)
    kept = value[first]
    other = np.flatnonzero(np.abs(value - kept[inverse]) > 1e-12 * np.abs(value).max(initial=0))
    if len(other):
        k = int(other[0])
        raise BodyError(
            f"{path}: rows {low[k] + 1} and {high[k] + 1} are coupled by "
            f"{value[k]:.6g} and by {kept[inverse[k]]:.6g}: not symmetric"
        )
    return symmetric(path, code // n, code % n, kept, n)


def is_symmetric(matrix: sp.csr_matrix) -> bool:
    """Whether it is, entry by entry."""
    return bool((matrix != matrix.T).nnz == 0)


def with_skew_part(path: Path | str, row: Any, column: Any, value: Any, n: int) -> sp.csr_matrix:
    """The same of D or K, whose skew part is kept where both triangles are given: gyroscopic or
    circulatory forces."""
    return symmetric(path, row, column, value, n, skew_part=True)


def real_or_complex(values: Any) -> Any:
    """Doubles, or complex ones."""
    return np.asarray(values, dtype=complex if np.iscomplexobj(values) else float)


def symmetric(
    path: Path | str, row: Any, column: Any, value: Any, n: int, skew_part: bool = False
) -> sp.csr_matrix:
    """A symmetric matrix from triplets (0-based) of one triangle, or of both.

    Raises
    ------
    BodyError
        If both triangles are given and differ, unless it may have a skew part.
    """
    entries = sp.coo_matrix((value, (row, column)), shape=(n, n)).tocsr()
    if entries.nnz < len(value):
        code = np.sort(np.asarray(row, dtype=np.int64) * n + np.asarray(column))
        twice = int(code[:-1][np.diff(code) == 0][0])
        raise BodyError(f"{path}: the entry ({twice // n + 1}, {twice % n + 1}) is given twice")
    if not np.all(np.isfinite(entries.data)):
        raise BodyError(f"{path}: holds NaN or Inf")
    upper = sp.triu(entries, 1, format="csr")
    lower = sp.tril(entries, -1, format="csr")
    if upper.count_nonzero() == 0 or lower.count_nonzero() == 0:
        off = upper if lower.count_nonzero() == 0 else lower
        return (entries + off.T).tocsr()
    difference = abs(entries - entries.T)
    scale = np.abs(entries.data).max()
    if difference.nnz and difference.data.max() > 1e-12 * scale:
        if skew_part:
            return entries
        where = difference.tocoo()
        k = int(np.argmax(where.data))
        i, j = int(where.row[k]), int(where.col[k])
        raise BodyError(
            f"{path}: not symmetric: entry ({i + 1}, {j + 1}) is {entries[i, j]:.6g}, "
            f"({j + 1}, {i + 1}) is {entries[j, i]:.6g}; flexgram takes one triangle, or both alike"
        )
    return (0.5 * (entries + entries.T)).tocsr()


def printed_rounding(values: Floats) -> float:
    """Relative rounding of numbers that were printed with 7 to 15 digits, half a unit of the last
    one; 0 for doubles, and for numbers that are short by nature."""
    sample = values[values != 0][:: max(1, np.count_nonzero(values) // 2000)]
    needed = np.array(
        [
            next((d for d in range(6, 16) if float(f"{x:.{d - 1}e}") == x), 16)
            for x in sample.tolist()
        ]
    )
    if not len(needed):
        return 0.0
    # Columns of a width have room for a digit less where there is a sign.
    counts = np.bincount(needed, minlength=18)
    digits = int(np.argmax(counts[:-1] + counts[1:]))
    signs = min(counts[digits : digits + 2]) > 0.2 * len(needed)
    digits = digits if signs else int(np.argmax(counts))
    alike = np.mean((needed == digits) | (signs & (needed == digits + 1))) > 0.5
    short = np.mean(needed <= digits + signs) > 0.95
    return 0.5 * 10.0 ** (1 - digits) if 6 < digits < 16 and alike and short else 0.0


def read_triplets(path: Path, columns: int = 3) -> Floats:
    """Whitespace- or comma-separated numbers, ``columns`` on each line.

    A wrong or incomplete line is named by its number.
    """
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    with path.open("rb") as file:
        head = file.read(4096)
        if b"\0" in head:
            raise BodyError(f"{path}: binary, expected text with {columns} numbers on each line")
    comma = b"," in head
    with path.open() as text:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # at a word: found below
            if comma or re.search(rb"\d[dD][+-]?\d", head):
                values = np.fromstring(re.sub("[dD]", "e", text.read().replace(",", " ")), sep=" ")
            else:
                values = np.fromfile(text, sep=" ")
    whole = values.size % columns == 0 and values.size > 0
    # A text cut within its last number still parses: every line must end.
    with path.open("rb") as file:
        file.seek(-min(1, path.stat().st_size), 2)
        ended = file.read() == b"\n"
    lines = _count_lines(path)
    if whole and ended and lines == values.size // columns:
        return values.reshape(-1, columns)
    with path.open(errors="replace") as text:
        for number, line in enumerate(text, start=1):
            words = re.sub("[dD]", "e", line.replace(",", " ")).split()
            if not words:
                continue
            try:
                [float(word) for word in words]
                good = len(words) == columns and line.endswith("\n")
            except ValueError:
                good = False
            if not good:
                last = "" if line.endswith("\n") else " (the last line: is the file truncated?)"
                raise BodyError(
                    f"{path}, line {number}: {line.strip()[:60]!r}, expected {columns} "
                    f"numbers{last}"
                )
    if values.size == 0:
        raise BodyError(f"{path}: empty")
    return values.reshape(-1, columns)


def _count_lines(path: Path) -> int:
    with path.open("rb") as file:
        return sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 22), b""))


def check_indices(path: Path | str, indices: Any, n: int, what: str) -> None:
    """Row numbers 1 … n."""
    low, high = int(indices.min()), int(indices.max())
    if low < 1 or high > n:
        raise BodyError(f"{path}: row numbers from {low} to {high}, expected 1 to {n} ({what})")


def check(fe: FeMatrices) -> dict[str, Any]:
    """Checks of everything that an importer can get wrong, and the rigid body facts.

    Returns
    -------
    dict
        ``n``, ``nonzeros``; with coordinates ``mass``, ``centre``, ``inertia`` (about the centre,
        all in the units of the deck) of the rows that are there, ``rigid_energy`` (for each of the
        six motions, relative to K), ``free`` (how many of them K does not resist).

    Raises
    ------
    BodyError
        K and M swapped, rows without stiffness and mass, a mass that depends on the direction.
    """
    where = fe.source
    if fe.K.shape != fe.M.shape:
        raise BodyError(f"{where}: K is {fe.K.shape}, M is {fe.M.shape}")
    k, m = fe.K.diagonal(), fe.M.diagonal()
    empty = np.flatnonzero((k == 0) & (m == 0))
    if len(empty):
        raise BodyError(
            f"{where}: row {empty[0] + 1} has neither stiffness nor mass"
            f" ({len(empty)} such rows); is the file truncated?"
        )
    both = (k > 0) & (m > 0)
    if not both.any():
        raise BodyError(f"{where}: no row has positive stiffness and mass on the diagonal")
    if np.median(k[both] / m[both]) < 1:
        raise BodyError(
            f"{where}: the stiffness is below the mass on the diagonal (median ratio "
            f"{np.median(k[both] / m[both]):.1e} 1/s²): are K and M swapped?"
        )
    facts: dict[str, Any] = {"n": fe.n, "nonzeros": int(fe.K.nnz)}
    if not fe.placed().any():
        return facts
    with np.errstate(all="ignore"):  # what overflows is refused below
        return facts | _rigid_facts(where, fe)


def _rigid_facts(where: str, fe: FeMatrices) -> dict[str, Any]:
    facts: dict[str, Any] = {}
    k, placed = fe.K.diagonal(), fe.placed()
    motions = np.zeros((fe.n, 6))
    motions[placed] = rigid_motions(fe.positions(fe.node[placed]), fe.component[placed])
    energy = np.abs(np.sum(motions * (fe.K @ motions), axis=0))
    weight = np.sum(motions**2 * np.abs(k)[:, None], axis=0)
    facts["rigid_energy"] = energy / np.where(weight > 0, weight, 1)
    if not np.all(np.isfinite(facts["rigid_energy"])):
        raise BodyError(f"{where}: numbers so large that products overflow")
    free = (facts["rigid_energy"] < 1e-10) & (weight > 0)  # a motion that no row shows is held
    facts["free"] = int(free.sum())
    if free[:3].all() and not free.all():
        hourglass = sorted(fe.types & REDUCED)
        cause = (
            f"the hourglass stiffness of {', '.join(hourglass)} in ccx strains rigid rotations of "
            "distorted elements: take C3D8I or C3D20R (of shells S8R or S4)"
            if hourglass
            else "the dof map or the coordinates do not belong to these matrices"
        )
        raise BodyError(
            f"{where}: K lets all translations free but resists rotation (relative energy "
            f"{facts['rigid_energy'].max():.1e}): {cause}"
        )
    mass6 = motions.T @ (fe.M @ motions)
    mass6 = 0.5 * (mass6 + mass6.T)
    masses = np.diag(mass6)[:3]
    if facts["free"] == 6 and np.ptp(masses) > 1e-6 * masses.max():
        raise BodyError(
            f"{where}: the mass differs with the direction, {masses[0]:.6g}, "
            f"{masses[1]:.6g}, {masses[2]:.6g}: the dof map does not belong to "
            "these matrices"
        )
    if np.ptp(masses) > 1e-6 * masses.max():  # of a held body, or one whose mass is directed
        words = ", ".join(f"{m:.6g}" for m in masses)
        fe.remarks.append(f"the mass of the free rows is {words} in x, y, z")
        return facts
    mass = float(masses.mean())
    if not 0 < mass < np.inf:
        raise BodyError(f"{where}: the mass is {mass:.6g}")
    centre = np.array(
        [mass6[1, 5] - mass6[2, 4], mass6[2, 3] - mass6[0, 5], mass6[0, 4] - mass6[1, 3]]
    ) / (2 * mass)
    inertia = mass6[3:, 3:] - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    facts |= {"mass": mass, "centre": centre, "inertia": inertia}
    return facts
