"""From the files of an FE code to a body file.

``read`` finds the format by the file's name and reads it by the module of that code;
``import_matrices`` checks, attaches interfaces, and writes a body of matrices in SI units.

May import: basics, body.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, errors_of, index_of
from flexgram.body.bodyfile import write_matrices
from flexgram.body.faces import volume_of
from flexgram.body.units import UNITS, doubt, spacing
from flexgram.importers.fe import FeMatrices, Interface, check, check_damping, printed_rounding
from flexgram.importers.interfaces import attach, middle, parse, select

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
    "pair": ("deck", "mass", "damping", "mapping"),
    "matlab": (),
    "petsc": ("mass", "damping", "inputs"),
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
            raise BodyError(f"--{name} does not belong to the format {kind}")
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
        raise BodyError("--deck-loads belongs to CalculiX decks")
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
    return ansys.read_pair(first, other["mass"], other["damping"], other["mapping"], other["deck"])


def import_matrices(
    fe: FeMatrices,
    output: str | Path,
    interfaces: Sequence[Interface] = (),
    *,
    units: str = "SI",
    alpha: float | None = None,
    beta: float | None = None,
    eta: float | None = None,
    strict: bool = False,
    outputs: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Check the matrices, attach interfaces, and write a body file in SI units.

    Parameters
    ----------
    fe : FeMatrices
        From ``read``.
    output : str or Path
        Body file to write.
    interfaces : sequence of Interface
        Where forces act, positions in the units of the deck. Couplings that the FE code condensed
        itself (CalculiX ``*RIGID BODY``) are kept as interfaces too.
    units : str
        ``SI``, ``mm-t-s`` or ``mm-kg-s``: units of the matrices and the deck.
    alpha, beta, eta : float, optional
        Rayleigh coefficients [1/s], [s] and loss factor; default: those of the files.
    strict : bool
        Refuse files of which something is left out, by name.
    outputs : mapping, optional
        Displacements, stresses and strain gauges of a CalculiX deck, as in a YAML description
        (``deck_outputs``).

    Returns
    -------
    dict
        What ``check`` found, in SI; ``extent`` (3 [m]); ``rows``, ``ports``, ``remarks``, and
        ``interfaces``: for each rigid or distributing one its ``coupling``, ``nodes`` (how many),
        ``position`` [m] of its reference, and ``middle``: what that is.

    Examples
    --------
    >>> import scipy.io, scipy.sparse as sp
    >>> K = 1e6 * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(50, 50)).tocsc()
    >>> scipy.io.savemat("bar.mat", {"K": K, "M": sp.eye(50, format="csc")})
    >>> tip = flexgram.importers.parse("rows", "tip=50")
    >>> facts = flexgram.importers.import_matrices(
    ...     flexgram.importers.read("bar.mat"), "bar.h5", [tip], alpha=1.0
    ... )
    >>> facts["rows"], facts["ports"]
    (50, ['tip.50'])
    """
    if units not in UNITS:
        raise BodyError(f"--units {units} must be one of {', '.join(UNITS)}")
    check_damping(alpha, beta, eta)
    if strict and (left := [line for line in fe.remarks if "left out" in line]):
        raise BodyError(f"{fe.source}: --strict: {'; '.join(left)}")
    length, mass, force = UNITS[units]
    facts = check(fe)
    every = list(interfaces) + fe.interfaces
    named = {i.name for i in every}
    for name, label in fe.rigid.items():
        if name not in named:
            every.append(Interface(name, "node", np.array([label])))
    if outputs:
        fe.measured = _measured(fe, outputs, units)
    rounding = printed_rounding(fe.K.data)  # before anything is added or scaled
    body = attach(fe, every)
    new = body.pop("new_points")
    labels = np.concatenate([fe.labels, np.array(list(new), dtype=np.int64)])
    points = np.vstack([fe.points, *new.values()]) if new else fe.points
    damping = {
        "alpha": fe.alpha if alpha is None else alpha,
        "beta": fe.beta if beta is None else beta,
        "eta": fe.eta if eta is None else eta,
    }
    write_matrices(
        output,
        **_in_SI(body, length, mass, force),
        alpha=damping["alpha"],
        beta=damping["beta"],
        eta=damping["eta"],
        rounding=rounding,
        **_places(fe, body, labels, points * length),
        blocks=fe.indexed_blocks() if fe.has_coordinates() else [],
    )
    if rounding:
        fe.remarks.append(_digits(fe, rounding))
    if doubts := _doubt(fe, facts.get("mass", 0.0), units):
        fe.remarks.append(doubts)
    for key, factor in (("mass", mass), ("centre", length), ("inertia", mass * length**2)):
        if key in facts:
            facts[key] = facts[key] * factor
    if fe.has_coordinates():
        facts["extent"] = np.ptp(fe.positions(np.unique(fe.node)), axis=0) * length
    became = _references(fe, every, body["followers"], labels, points, length)
    return {
        **facts,
        "damping": damping,
        "interfaces": became,
        "rows": body["K"].shape[0],
        "ports": body["inputs"],
        "remarks": fe.remarks,
    }


def _measured(fe: FeMatrices, outputs: Mapping[str, Any], units: str) -> dict[str, Any]:
    """Rows of C by the names of their outputs."""
    if fe.deck is None or fe.deck.suffix.lower() != ".inp":
        raise BodyError(
            "--measure needs the elements and materials of a CalculiX deck: import job.inp or "
            "job.sti beside it"
        )
    from flexgram.importers.deck_outputs import deck_outputs

    names, rows = deck_outputs(fe, fe.deck, outputs, units)
    return dict(zip(names, rows, strict=True))


def _in_SI(body: Mapping[str, Any], length: float, mass: float, force: float) -> dict[str, Any]:
    """K, M, D, B and C in SI units, with the names of their ports.

    Matrices come by columns, as the file has them: the transpose of a symmetric one is itself.
    """
    component = body["component"]
    turn = np.where(component >= 3, length, 1.0) if len(component) else np.ones(body["K"].shape[0])

    def scaled(A: Any, factor: float) -> Any:
        if np.any(turn != 1):
            A = sp.diags(turn) @ A @ sp.diags(turn)
        if factor != 1:
            A = factor * A
        return A.T

    unit = np.where(body["moment"], 1 / length, np.where(body["load"], force, 1.0))
    B = turn[:, None] * body["B"] * unit
    C = None if body["C"] is None else body["C"] * turn
    outputs = body["outputs"]
    if C is None and body["load"].any():  # what interfaces do, not the loads
        C = B[:, ~body["load"]].T
        outputs = [n for n, load in zip(body["inputs"], body["load"], strict=True) if not load]
    if body["measured"]:
        if C is None:
            C, outputs = B.T, body["inputs"]
        C = np.vstack([C, np.array(list(body["measured"].values())) * turn])
        outputs = [*outputs, *body["measured"]]
    return {
        "K": scaled(body["K"], force / length),
        "M": scaled(body["M"], mass),
        "B": B,
        "D": None if body["D"] is None else scaled(body["D"], mass),
        "S": None if body["S"] is None else scaled(body["S"], force / length),
        "C": C,
        "inputs": body["inputs"],
        "outputs": outputs,
    }


def _places(fe: FeMatrices, body: Mapping[str, Any], labels: Any, points: Any) -> dict[str, Any]:
    """Nodes and components of the rows, where nodes are [m], and which belong to interfaces."""
    component = body["component"]
    if not len(component):
        return {}
    known = labels if fe.has_coordinates() else np.unique(body["node"])
    places: dict[str, Any] = {
        "component": component,
        "ids": known,
        "node": index_of(known, body["node"])[0],
    }
    if not fe.has_coordinates():
        return places
    for name, label in fe.rigid.items():  # coupled by the FE code itself
        inside = fe.sets.get(name, np.empty(0, dtype=np.int64))
        inside = inside[index_of(known, inside)[1] & ~np.isin(inside, body["node"])]
        body["followers"][name] = np.concatenate([[label], inside])
    followers, members = (
        {name: index_of(known, nodes)[0] for name, nodes in body[which].items()}
        for which in ("followers", "members")
    )
    return {**places, "position": points, "followers": followers, "interfaces": members}


def _digits(fe: FeMatrices, rounding: float) -> str:
    """What the digits of printed matrices leave of low frequencies: λ is wrong by some 8 ε/√n of
    the median of K_ii/M_ii."""
    k, m = fe.K.diagonal(), fe.M.diagonal()
    rows = (k > 0) & (m > 0)
    largest = float(np.median(k[rows] / m[rows])) if rows.any() else 0.0
    lost = 8 * rounding / np.sqrt(fe.n) * largest  # of λ
    digits = round(1 - np.log10(2 * rounding))
    return (
        f"K is printed with {digits} digits: frequencies below about "
        f"{np.sqrt(lost / 2e-4) / (2 * np.pi):.2g} Hz are known to less than 1e-4 "
        "(the rounding floor of a result tells)"
    )


def _doubt(fe: FeMatrices, mass: float, units: str) -> str | None:
    """What speaks against the units: the speed of sound by stiffness and mass of the rows and the
    distance of nodes, the density by the volume of the elements (without them, of one cell a node),
    the size of the part."""
    if not fe.has_coordinates() or not mass > 0 or fe.thin:
        return None
    k, m = fe.K.diagonal(), fe.M.diagonal()
    rows = (fe.component < 3) & (k > 0) & (m > 0)
    points = fe.positions(np.unique(fe.node))
    h = spacing(points)
    if not h > 0 or not rows.any():
        return None
    speed = h * float(np.sqrt(np.median(k[rows] / m[rows]))) / 2.5  # 2.5: linear hexahedra
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    volume = volume_of(fe.points, fe.indexed_blocks())
    return doubt(units, speed, mass / (volume if volume > 0 else len(points) * h**3), extent)


def _references(
    fe: FeMatrices,
    interfaces: Sequence[Interface],
    followers: dict[str, Any],
    labels: Any,
    points: Any,
    length: float,
) -> dict[str, dict[str, Any]]:
    """What became of each rigid or distributing interface; a far reference is remarked on."""
    became: dict[str, dict[str, Any]] = {}
    for name, nodes in followers.items():
        at = points[np.flatnonzero(labels == nodes[0])[0]]
        became[name] = {
            "coupling": "rigid",
            "nodes": len(nodes) - 1,
            "position": at * length,
            "middle": "",
        }
    for interface in interfaces:
        name = interface.name
        if interface.coupling not in ("rigid", "distributing"):
            continue
        chosen = select(fe, interface)
        its_middle = middle(fe, chosen)
        at = its_middle.position if interface.position is None else interface.position
        became[name] = {
            "coupling": interface.coupling,
            "nodes": len(np.unique(chosen)),
            "position": at * length,
            "middle": "" if interface.position is not None else its_middle.said(length),
        }
        if its_middle.extent > 0 and its_middle.away(at) > 3:
            fe.remarks.append(
                f"the reference of {name} is {its_middle.away(at):.0f} sizes of its "
                "node set away from its middle: right units?"
            )
    return became
