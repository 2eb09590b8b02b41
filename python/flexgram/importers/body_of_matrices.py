"""Matrices of an FE code as a body file: checked, with interfaces and outputs, in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, index_of
from flexgram.body.bodyfile import write_matrices
from flexgram.body.faces import volume_of
from flexgram.body.units import UNITS, doubt, spacing
from flexgram.importers.fe import FeMatrices, Interface, check, check_damping, printed_rounding
from flexgram.importers.interfaces import attach, middle, select


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
        ``SI``, ``mm-t-s``, ``mm-kg-s``, ``in-lbf-s`` or ``ft-lbf-s``: of the matrices and the deck.
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
        What ``check`` found, in SI; ``extent`` (3 [m]); ``damping``, ``losses`` (further ones, in
        words); ``rows``, ``ports``, ``remarks``, and
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
        "losses": _losses(fe),
        "interfaces": became,
        "rows": body["K"].shape[0],
        "ports": body["inputs"],
        "remarks": fe.remarks,
    }


def _losses(fe: FeMatrices) -> list[str]:
    """What damps beside α, β and η."""
    words = ["a damping matrix"] * (fe.D is not None)
    words += ["structural damping S"] * (fe.S is not None)
    return words + [f"{name} ({law.words})" for name, (_, law) in fe.terms.items()]


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

    K = scaled(body["K"], force / length)
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
        "K": K if body["is_symmetric"] else K.T,
        "M": scaled(body["M"], mass),
        "B": B,
        "D": None if body["D"] is None else scaled(body["D"], mass).T,  # may have a skew part
        "S": None if body["S"] is None else scaled(body["S"], force / length),
        "terms": {n: (scaled(T, force / length), law) for n, (T, law) in body["terms"].items()},
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
