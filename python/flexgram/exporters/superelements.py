"""Codes whose reduced bodies are superelements: motions of interfaces first, then internal modes.

All of ``flexgram.model.physical``: the same body in these coordinates.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from flexgram.basics import BodyError, Floats, written_aside
from flexgram.exporters.dmig import matrix_cards, number
from flexgram.model.physical import PhysicalForm, facts, physical_form
from flexgram.model.reduced import ReducedBody

#: Grids of a Nastran file and nodes of Abaqus count from here, modes from a thousand above them.
FIRST_GRID = 1


def _without_structural_damping(form: PhysicalForm, remedy: str) -> None:
    if form.loss:
        raise BodyError(
            f"structural damping ({form.loss}) {remedy}: export it with --damping modal or rayleigh"
        )


def _head(form: PhysicalForm, sign: str) -> list[str]:
    return [f"{sign} flexgram: {key}: {words}" for key, words in facts(form).items()]


def write_nastran(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """A bulk data file: GRIDs at the interfaces, SPOINTs of the modes, KAAX, MAAX, BAAX by DMIG.

    The deck that includes it asks for them in its case control: ``K2GG = KAAX``, ``M2GG = MAAX``,
    ``B2GG = BAAX``, and connects to the grids. Sixteen columns hold eleven or twelve digits.

    Examples
    --------
    >>> write_nastran(flexgram.ReducedModel.load("rack.rom.h5"), Path("rack.bdf"))
    """
    form = physical_form(model)
    _without_structural_damping(
        form, "has no matrix in this file (eta alone goes into Nastran by PARAM,G)"
    )
    places = form.positions(body)
    lines = [
        *_head(form, "$"),
        "$ case control: K2GG=KAAX, M2GG=MAAX" + (", B2GG=BAAX" if np.any(form.D) else ""),
    ]
    dofs: list[tuple[int, int]] = [(0, 0)] * len(form.boundary)
    for k, (name, moves) in enumerate(form.interfaces.items()):
        grid = FIRST_GRID + k
        lines += [
            f"$ grid {grid}: {name}",
            f"{'GRID*':<8}{grid:>16}{'':16}"
            + "".join(f"{number(x).replace('D', 'E'):>16}" for x in places[name][:2])
            + "*",
            f"{'*':<8}{number(places[name][2]).replace('D', 'E'):>16}",
        ]
        for direction, row in moves.items():
            dofs[row] = (grid, direction + 1)
    first = FIRST_GRID + max(1000, len(form.interfaces))
    modes = form.order - len(form.boundary)
    dofs += [(first + k, 0) for k in range(modes)]
    if modes:
        lines.append(f"{'SPOINT':<8}{first:>8}{'THRU':<8}{first + modes - 1:>8}")
    for name, a in (("KAAX", form.K), ("MAAX", form.M), ("BAAX", form.D)):
        if np.any(a):
            lines += matrix_cards(name, a, True, dofs)
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")


def write_abaqus(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """Keywords to include in an Abaqus model: nodes at the interfaces, a node for each mode (its
    degree of freedom 1), ``*MATRIX INPUT`` of stiffness, mass, viscous and structural damping.

    Examples
    --------
    >>> write_abaqus(flexgram.ReducedModel.load("rack.rom.h5"), Path("rack.inp"))
    """
    form = physical_form(model)
    if form.terms:
        _without_structural_damping(form, "that changes with frequency has no matrix in this file")
    places = form.positions(body)
    lines = [*_head(form, "**"), "*NODE, NSET=FLEXGRAM_INTERFACES"]
    dofs: list[tuple[int, int]] = [(0, 0)] * len(form.boundary)
    for k, (name, moves) in enumerate(form.interfaces.items()):
        node = FIRST_GRID + k
        lines += [
            f"** node {node}: {name}",
            f"{node}, " + ", ".join(f"{x:.16e}" for x in places[name]),
        ]
        for direction, row in moves.items():
            dofs[row] = (node, direction + 1)
    first = FIRST_GRID + max(1000, len(form.interfaces))
    modes = form.order - len(form.boundary)
    if modes:
        lines.append("*NODE, NSET=FLEXGRAM_MODES")
        lines += [f"{first + k}, 0., 0., 0." for k in range(modes)]
    dofs += [(first + k, 1) for k in range(modes)]
    parts = {
        "STIFFNESS": form.K,
        "MASS": form.M,
        "VISCOUS DAMPING": form.D,
        "STRUCTURAL DAMPING": form.eta * form.K + form.S,
    }
    roles = []
    for role, a in parts.items():
        if not np.any(a):
            continue
        name = "FLEXGRAM_" + role.replace(" ", "_")
        roles.append(f"{role}={name}")
        lines.append(f"*MATRIX INPUT, NAME={name}, TYPE=SYMMETRIC")
        lines += [
            f"{dofs[i][0]}, {dofs[i][1]}, {dofs[j][0]}, {dofs[j][1]}, {a[i, j]:.16e}"
            for j in range(form.order)
            for i in range(j + 1)
            if a[i, j] != 0
        ]
    lines.append(f"*MATRIX ASSEMBLE, {', '.join(roles)}")
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")


def _op4_matrix(name: str, a: Floats, symmetric: bool) -> list[str]:
    """A dense matrix in the text form of OUTPUT4, three numbers of seventeen digits a line."""
    rows, columns = a.shape
    a = np.where(np.abs(a) < 1e-99, 0.0, a)  # exponents have two digits
    form = 6 if symmetric else 1 if rows == columns else 2
    lines = [f"{columns:8d}{rows:8d}{form:8d}{2:8d}{name:<8}1P,3E23.16"]
    for j in range(columns):
        used = np.flatnonzero(a[:, j])
        if not len(used):
            continue
        first, last = int(used[0]), int(used[-1])
        values = a[first : last + 1, j]
        lines.append(f"{j + 1:8d}{first + 1:8d}{len(values):8d}")
        lines += [
            "".join(f"{x:23.16E}" for x in values[k : k + 3]) for k in range(0, len(values), 3)
        ]
    lines += [f"{columns + 1:8d}{1:8d}{1:8d}", f"{1.0:23.16E}"]
    return lines


def write_op4(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """KAA, MAA, BAA and PA (the load of each input) in a text file of OUTPUT4.

    Examples
    --------
    >>> write_op4(flexgram.ReducedModel.load("rack.rom.h5"), Path("rack.op4"))
    """
    form = physical_form(model)
    _without_structural_damping(form, "has no matrix in this file")
    lines = []
    for name, a, symmetric in (
        ("KAA", form.K, True),
        ("MAA", form.M, True),
        ("BAA", form.D, True),
        ("PA", form.B, False),
    ):
        lines += _op4_matrix(name, a, symmetric)
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")


def write_simscape(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """What the block Reduced Order Flexible Solid of Simscape Multibody asks for, as a .mat file:
    ``origins`` (frames × 3), ``quaternions``, ``K``, ``M``, ``D``; six motions of each frame, then
    the modes.

    Examples
    --------
    >>> write_simscape(flexgram.ReducedModel.load("rack.rom.h5"), Path("simscape.mat"))
    """
    form = physical_form(model)
    _without_structural_damping(form, "is none that the block knows")
    places = form.positions(body)
    order: list[int] = []
    for name, moves in form.interfaces.items():
        if len(moves) != 6:
            raise BodyError(
                f"interface {name} has {len(moves)} ports: a frame has six motions, fx to mz"
            )
        order += [moves[direction] for direction in range(6)]
    order += range(len(form.boundary), form.order)
    at = np.ix_(order, order)
    values: dict[str, Any] = {
        "origins": np.array([places[name] for name in form.interfaces]),
        "quaternions": np.tile([1.0, 0, 0, 0], (len(places), 1)),
        "K": form.K[at],
        "M": form.M[at],
        "D": form.D[at],
        "frames": np.array(list(form.interfaces), dtype=object),
        "about": np.array([f"{key}: {words}" for key, words in facts(form).items()], dtype=object),
    }
    with written_aside(path) as place:
        scipy.io.savemat(place, values, oned_as="column", appendmat=False)


def write_extptfm(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """The superelement of OpenFAST's module ExtPtfm (Flex 5 format): a held body with one
    interface, at the transition piece; without loads of its own.

    Examples
    --------
    >>> held = flexgram.reduce("standing.h5", (5, 300), tol=1e-2, inputs="upper", outputs="upper")
    >>> write_extptfm(held, Path("tower.dat"))
    """
    form = physical_form(model)
    _without_structural_damping(form, "is none that OpenFAST knows")
    if len(form.interfaces) != 1 or len(form.boundary) != 6:
        raise BodyError(
            "ExtPtfm takes a body with one interface of six ports, at the transition piece; this "
            f"one has {', '.join(form.interfaces)} (--inputs keeps one)"
        )
    moves = next(iter(form.interfaces.values()))
    order = [moves[direction] for direction in range(6)] + list(range(6, form.order))
    at, n = np.ix_(order, order), form.order
    lines = [
        "!Comment: " + "; ".join(f"{key}: {words}" for key, words in facts(form).items()),
        "!Comment Flex 5 Format",
        f"!Dimension: {n}",
        "!Time increment in simulation: 1.0",
        "!Total simulation time in file: 1.0",
    ]
    for name, a in (("Mass", form.M), ("Stiffness", form.K), ("Damping", form.D)):
        lines += ["", f"!{name} Matrix", f"!Dimension: {n}"]
        lines += ["".join(f"{x:25.16e}" for x in row) for row in a[at]]
    lines += ["", "!Loading and Wave Elevation"]
    # OpenFAST passes over a column of the wave's elevation; other readers take none.
    lines += [f"!Dimension: 1 time column - {n} force columns"]
    lines += ["".join(f"{x:25.16e}" for x in [t, *[0.0] * n]) for t in (0.0, 1.0)]
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")
