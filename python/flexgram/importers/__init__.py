"""From the files of an FE code to a body file.

``read`` finds the format by the file's name and reads it by the module of that code;
``import_matrices`` checks, attaches interfaces, and writes a body of matrices in SI units.

May import: basics, body.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

from flexgram.basics import BodyError, errors_of
from flexgram.importers.body_of_matrices import import_matrices
from flexgram.importers.fe import FeMatrices, Interface, check, check_damping
from flexgram.importers.interfaces import parse

__all__ = [
    "FORMATS",
    "FeMatrices",
    "Interface",
    "check",
    "check_damping",
    "import_matrices",
    "parse",
    "read",
]

#: Further files that each format takes.
ACCEPTED = {
    "calculix": ("deck",),
    "abaqus": ("deck",),
    "nastran": ("deck",),
    "ansys": ("deck",),
    "pair": ("deck", "mass", "damping", "mapping", "inputs"),
    "matlab": (),
    "petsc": ("mass", "damping", "inputs"),
}
#: What a format is, in words.
WORDS = {
    "calculix": "a deck or job of CalculiX",
    "abaqus": "a job of Abaqus",
    "nastran": "a file of Nastran",
    "ansys": "a file of ANSYS",
    "pair": "one of several matrices in files of their own (MatrixMarket, Harwell-Boeing, text)",
    "matlab": "a file of MATLAB",
    "petsc": "a matrix in PETSc's binary format",
}
FORMATS = ("calculix", "abaqus", "nastran", "ansys", "pair", "matlab", "petsc")


def guess_format(path: Path) -> str:
    """The format that a file's name and first bytes tell."""
    suffix = path.suffix.lower()
    if suffix in (".sti", ".mas", ".dof", ".inp"):
        return "calculix"
    if suffix == ".mtx":
        if path.exists() and path.open("rb").read(14) == b"%%MatrixMarket":
            return "pair"
        if re.search(r"(STIF|MASS)\d+\.mtx$", path.name, re.IGNORECASE):
            return "abaqus"
        return "pair"
    known = {
        ".pch": "nastran",
        ".dmig": "nastran",
        ".op4": "nastran",
        ".bdf": "nastran",
        ".full": "ansys",
        ".mat": "matlab",
        ".mmf": "pair",
        ".hb": "pair",
        ".rsa": "pair",
        ".matrix": "pair",
        ".txt": "pair",
        ".csv": "pair",
        ".petsc": "petsc",
        ".bin": "petsc",
    }
    if suffix not in known:
        raise BodyError(
            f"{path}: the format is not told by the name; --format is one of {', '.join(FORMATS)}"
            + (
                "; of NumPy and SciPy: flexgram.write_matrices"
                if suffix in (".npz", ".npy")
                else ""
            )
        )
    return known[suffix]


def read(
    path: str | Path,
    *,
    format: str | None = None,
    deck: str | Path | None = None,
    mass: str | Path | None = None,
    damping: str | Path | None = None,
    inputs: str | Path | None = None,
    mapping: str | Path | None = None,
    matrices: Mapping[str, str] | None = None,
    run_ccx: bool = False,
    step: int | None = None,
    deck_loads: bool = False,
) -> FeMatrices:
    """Read the matrices of an FE code.

    Parameters
    ----------
    path : str or Path
        What ``format`` starts from: ``job.sti`` or ``job.inp`` (CalculiX), ``job_STIF1.mtx``
        (Abaqus), ``.pch`` or ``.op4`` (Nastran), ``.full`` (ANSYS), ``.mat`` (MATLAB), the
        stiffness matrix (MatrixMarket, Harwell-Boeing, text, PETSc; ``mass`` names the other one).
    format : str, optional
        One of ``FORMATS``; default: by the name.
    deck : path, optional
        Model with nodes and node sets, where it does not lie beside ``path``.
    mass, damping, inputs, mapping : path, optional
        Further files of formats that keep each matrix in its own.
    matrices : mapping, optional
        Names of the matrices in the file, where these are not the usual ones: ``{"K": "KXX"}``;
        of Nastran K, M, D, S (structural damping), of MATLAB B and C too.
    run_ccx : bool
        ``path`` is a CalculiX deck without results: run ccx on it first.
    step : int, optional
        With ``run_ccx``: the ``*FREQUENCY`` step, from 1, whose matrices are taken; default: the
        last with ``PERTURBATION``, else the first.
    deck_loads : bool
        Make inputs of the loads of a CalculiX deck's steps: forces, pressure, gravity, spin.

    Raises
    ------
    BodyError
        Naming file, line and remedy.

    Examples
    --------
    >>> import scipy.io, scipy.sparse as sp
    >>> K = 1e6 * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(50, 50)).tocsc()
    >>> scipy.io.savemat("chain.mat", {"K": K, "M": sp.eye(50, format="csc")})
    >>> flexgram.importers.read("chain.mat").n
    50
    """
    first = Path(path)
    kind = format or guess_format(first)
    other = {
        name: Path(p) if p is not None else None
        for name, p in (
            ("deck", deck),
            ("mass", mass),
            ("damping", damping),
            ("inputs", inputs),
            ("mapping", mapping),
        )
    }
    if kind not in FORMATS:
        raise BodyError(f"--format {kind} must be one of {', '.join(FORMATS)}")
    for name, given in other.items():
        if given is not None and name not in ACCEPTED[kind]:
            takes = ", ".join(f"--{key}" for key in ACCEPTED[kind]) or "no further file"
            raise BodyError(f"{first} is taken for {WORDS[kind]}: that takes {takes}, not --{name}")
        if given is not None and not given.exists():
            raise BodyError(f"{given}: no such file (--{name})")
    if kind in ("pair", "petsc") and other["mass"] is None:
        raise BodyError(f"{first} holds one matrix: name the mass matrix too (--mass)")
    allowed = {"nastran": "KMDS", "matlab": "KMDSBC"}.get(kind, "")
    for role in matrices or {}:
        if role not in allowed or len(role) != 1:
            what = f"one of {', '.join(allowed)}" if allowed else "nothing of the format " + kind
            raise BodyError(f"--matrices {role}=…: {role} must be {what}")
    if step is not None and not run_ccx:
        raise BodyError("--step belongs to --run-ccx")
    if deck_loads and kind != "calculix":
        raise BodyError("--deck-loads: add --assemble (bulk data), or take a CalculiX deck")
    with errors_of(first):
        return _read(kind, first, other, matrices, run_ccx, step, deck_loads)


def _read(
    kind: str,
    first: Path,
    other: dict[str, Path | None],
    matrices: Mapping[str, str] | None,
    run_ccx: bool,
    step: int | None,
    deck_loads: bool,
) -> FeMatrices:
    """Hand over to the format's own reader."""
    if kind == "calculix":
        from flexgram.importers import calculix, ccx

        if run_ccx:
            with tempfile.TemporaryDirectory(prefix="flexgram-ccx-") as folder:
                try:
                    job, remarks = ccx.run_ccx(first, Path(folder), step)
                    fe = calculix.read_calculix(job, own=first, loads=deck_loads)
                    if fe.hides_places:
                        own, _ = ccx.run_ccx(first, Path(folder) / "free", free=True)
                        free = calculix.read_calculix(own, own=first)
                        fe = calculix.read_calculix(job, own=first, loads=deck_loads, free=free)
                except BodyError as error:  # the user knows the deck, not the folder of the run
                    raise BodyError(str(error).replace(folder, str(first.parent))) from error
                fe.source = str(first)
                fe.remarks = remarks + [
                    line.replace(folder, str(first.parent)) for line in fe.remarks
                ]
                return fe
        return calculix.read_calculix(first, other["deck"], loads=deck_loads)
    if run_ccx:
        raise BodyError(f"--run-ccx wants a CalculiX deck, not {first}")
    if kind == "abaqus":
        from flexgram.importers import abaqus

        return abaqus.read_abaqus(first, other["deck"])
    if kind == "nastran":
        from flexgram.importers import nastran

        return nastran.read_nastran(first, other["deck"], matrices)
    if kind == "matlab":
        from flexgram.importers import containers

        return containers.read_matlab(first, matrices)
    from flexgram.importers import ansys, containers

    if kind == "ansys":
        return ansys.read_full(first, other["deck"])
    assert other["mass"] is not None
    if kind == "petsc":
        return containers.read_petsc(first, other["mass"], other["inputs"], other["damping"])
    return ansys.read_pair(
        first,
        other["mass"],
        *(other[key] for key in ("damping", "mapping", "deck", "inputs")),
    )
