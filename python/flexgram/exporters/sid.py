"""Standard input data of a flexible body (SID_FEM), after Wallrapp, in named dialects.

Readers disagree on the order of the first-order indices and of the columns of Gr and Ge, so a
dialect is named:

======================  ===========  ============  ============
dialect                 m1 index     Gr columns    Ge columns
======================  ===========  ============  ============
``dlr``                 (r, q, c)    axis-major    axis-major
``python``              (r, q, c)    mode-major    axis-major
``emb``                 (r, q, c)    mode-major    mode-major
``fembeam``             (r, c, q)    mode-major    mode-major
======================  ===========  ============  ============

``dlr``: DLR FlexibleBodies; ``python``: SID writers of pyFEM; ``emb``: EMBSlib's reader (needs an
M-orthonormal basis); ``fembeam``: FEMBeam and welib.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats, written_aside
from flexgram.model.elastic_part import expect_one_body, in_its_frame
from flexgram.model.geometry import interface_motion, interface_positions
from flexgram.model.reduced import ReducedBody

#: m1 with the mode before the column; Gr, Ge axis-major
DIALECTS = {
    "dlr": (True, True, True),
    "python": (True, False, True),
    "emb": (True, False, False),
    "fembeam": (False, False, False),
}
#: loads of the frame's motion: translation, rotation, and spins in the order of Oe
FRAME_LOADS = {
    "Ct": ["frame.ax", "frame.ay", "frame.az"],
    "Cr": ["frame.alphax", "frame.alphay", "frame.alphaz"],
    "Oe": [f"frame.spin{axes}" for axes in ("xx", "yy", "zz", "xy", "yz", "zx")],
}
#: places of a symmetric 3 × 3 matrix in a vector of six
INERTIA = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
CENTRIFUGAL = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]

Taylor = tuple[Any, Any]  #: m0 (r, c) and m1 (q, r, c) or None


def _skew(v: Floats) -> Floats:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def taylor_terms(model: ReducedBody) -> dict[str, Taylor]:
    """Every Taylor block of the SID by its name, dialect-free: Gr and Ge as (…, mode, axis).

    The model must have its rigid vectors taken out (``ReducedModel.elastic``). With geometric
    stiffening (``--stiffening``) Ct, Cr and Oe have K_σ of the frame's motion in their first
    order (K0t, K0r and K0ω of Wallrapp).

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> [part.shape for part in taylor_terms(rom)["mdCM"]] == [(3, 1), (rom.order, 3, 1)]
    True
    """
    f, n = model.frame.integrals, model.order
    assert f is not None  # write_sid
    mass, centre = f.mass, f.centre
    Ct, Cr = f.M_er[:, :3], f.M_er[:, 3:]
    C4 = -np.moveaxis(f.inertia_first, 2, 0)  # (mode, 3, 3): ∫ρ skew(x) skew(φ)
    S, gyro = f.inertia_second, f.gyroscopic
    inertia = f.M_r[3:, 3:]
    J1 = np.array([[[-(c + c.T)[a, b]] for a, b in INERTIA] for c in C4]).reshape(n, 6, 1)

    def pair(X: Any) -> Any:  # (…, 3, 3) -> (…, 6)
        parts = [X[..., a, b] if a == b else X[..., a, b] + X[..., b, a] for a, b in CENTRIFUGAL]
        return np.stack(parts, axis=-1)

    Cr1 = np.swapaxes(gyro, 1, 2)  # [j, q, a]: ∫ρ φ_j · (e_a × φ_q)
    Oe1 = -pair(np.transpose(S, (1, 3, 0, 2)))  # [j, q, 6]
    blocks = {
        "mdCM": ((mass * centre)[:, None], Ct[:, :, None].copy()),
        "J": (np.array([[inertia[a, b]] for a, b in INERTIA]), J1),
        "Ct": (Ct, None),
        "Cr": (Cr, np.swapaxes(Cr1, 0, 1)),
        "Me": (model.system.M, None),
        "Gr": (np.moveaxis(-2 * C4, 0, 1).reshape(3, 3 * n), None),  # columns (mode, axis)
        "Ge": ((2 * Cr1).reshape(n, 3 * n), None),  # columns (mode, axis)
        "Oe": (pair(C4), np.swapaxes(Oe1, 0, 1)),
        "ksigma": (np.zeros((n, 1)), None),
        "Ke": (model.system.K, None),
        "De": (model.system.D, None),
    }
    if f.stiffening:
        for name, loads in FRAME_LOADS.items():
            m0, m1 = blocks[name]
            blocks[name] = (m0, _by_coordinates(f.stiffening, loads) + (0 if m1 is None else m1))
    return blocks


def _by_coordinates(stiffening: dict[str, Floats], loads: list[str]) -> Floats:
    """m1 (q, r, c) of the forces K_σ q a unit of each load; zero for one that makes no stress."""
    n = next(iter(stiffening.values())).shape[0]
    return np.stack([stiffening.get(load, np.zeros((n, n))) for load in loads], axis=-1)


def _axis_major(a: Floats) -> Floats:
    """Columns (mode, axis) -> (axis, mode)."""
    rows = a.shape[0]
    return np.swapaxes(a.reshape(rows, -1, 3), 1, 2).reshape(rows, -1)


def _block(name: str, term: Taylor, nq: int, mode_first: bool, indent: str = "  ") -> list[str]:
    m0, m1 = term
    zero = not np.any(m0) and (m1 is None or not np.any(m1))
    order = 0 if m1 is None else 1
    lines = [
        f"{indent}{name}",
        f"{indent}  order = {order}",
        f"{indent}  nrow = {m0.shape[0]}",
        f"{indent}  ncol = {m0.shape[1]}",
        f"{indent}  nq = {nq}",
        f"{indent}  nqn = 0",
        f"{indent}  structure = {0 if zero else 3}",
    ]
    for r, c in np.argwhere(m0):
        lines.append(f"{indent}  m0( {r + 1}, {c + 1}) = {_number(m0[r, c])}")
    if m1 is not None:
        for q, r, c in np.argwhere(m1):
            index = f"{r + 1}, {q + 1}, {c + 1}" if mode_first else f"{r + 1}, {c + 1}, {q + 1}"
            lines.append(f"{indent}  m1( {index}) = {_number(m1[q, r, c])}")
    return [*lines, f"{indent}end {name}"]


def _number(value: float) -> str:
    return f"{value:.16E}".replace("E", "D")


def write_sid(model: ReducedBody, path: Path, dialect: str = "dlr") -> None:
    """Write a SID_FEM file with a node for every interface of six ports.

    Parameters
    ----------
    model : ReducedBody
        Reduced with a floating frame (``--frame buckens`` or ``tangent``); its rigid vectors are
        left out.
    path : Path
        File to write.
    dialect : str
        ``dlr``, ``python``, ``emb`` or ``fembeam``.

    Raises
    ------
    BodyError
        If the body cannot move, has no integrals, or has structural damping.

    Examples
    --------
    >>> write_sid(flexgram.ReducedModel.load("rack.rom.h5"), Path("lower.SID_FEM"))
    """
    if dialect not in DIALECTS:
        raise BodyError(f"SID dialect {dialect}: must be one of {', '.join(DIALECTS)}")
    if not model.frame.integrals:
        raise BodyError(
            "a SID needs the frame integrals: reduce a free body with coordinates "
            "(--frame-integrals)"
        )
    expect_one_body(model, "a SID")
    model.system.expect_symmetric("a SID")
    if model.system.loss:
        raise BodyError(
            f"a SID has no structural damping ({model.system.loss}): give Rayleigh damping, or "
            "export with --damping modal or rayleigh"
        )
    mode_first, gr_axis, ge_axis = DIALECTS[dialect]
    positions = interface_positions(model)
    body = in_its_frame(model)
    n = body.order
    motion = interface_motion(body)
    if dialect == "emb" and np.abs(body.system.M - np.eye(n)).max() > 1e-8:
        raise BodyError(
            "EMBSlib takes the mass matrix as unit: reduce with "
            "--inner-product mass and --frame buckens"
        )
    lines = [
        f"{len(motion)} {n}",
        "part",
        "new modal = flexgram",
        "  refmod",
        f"    mass = {_number(model.frame.integrals.mass)}",
        f"    nelastq = {n}",
    ]
    hz = body.modes / (2 * np.pi)
    lines += [
        f"    ielastq ( {j + 1}) = coordinate {j + 1}, up to {hz[-1]:.6g} Hz" for j in range(n)
    ]
    lines += ["  end refmod", "  frame"]
    assert body.frame.integrals is not None
    stiffening = body.frame.integrals.stiffening

    def by_load(interface: str, kind: str) -> Any:  # forces at a node do work on Φ(q)ᵀ F
        if not stiffening:
            return None
        loads = [f"{interface}.{kind}{axis}" for axis in "xyz"]
        return -np.swapaxes(_by_coordinates(stiffening, loads), 1, 2)

    for number, (name, (phi, psi)) in enumerate(motion.items(), 1):
        rotation = np.array([_skew(psi[:, q]) for q in range(n)])
        lines += [
            f"    new node = {number}",
            "      rframe = body ref",
            *_block(
                "origin",
                (positions[name][:, None], phi.T[:, :, None].copy()),
                n,
                mode_first,
                "      ",
            ),
            *_block("phi", (phi, by_load(name, "f")), n, mode_first, "      "),
            *_block("psi", (psi, by_load(name, "m")), n, mode_first, "      "),
            *_block("AP", (np.eye(3), rotation), n, mode_first, "      "),
            "    end node",
        ]
    lines.append("  end frame")
    for name, (m0, m1) in taylor_terms(body).items():
        if (name == "Gr" and gr_axis) or (name == "Ge" and ge_axis):
            m0 = _axis_major(m0)
        lines += _block(name, (m0, m1), n, mode_first)
    lines += ["end modal", "end part"]
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")


def read_sid(path: str | Path, dialect: str = "dlr") -> dict[str, Any]:
    """Read a SID_FEM file: Taylor blocks as (m0, m1), nodes under ``nodes``.

    Returns
    -------
    dict
        ``mass``, ``nelastq``, the blocks by name with m1 as (q, r, c) and Gr, Ge with columns
        (mode, axis), and ``nodes``: id -> its blocks.

    Raises
    ------
    BodyError
        Naming the line that is not understood.

    Examples
    --------
    >>> write_sid(flexgram.ReducedModel.load("rack.rom.h5"), Path("read.SID_FEM"))
    >>> float(read_sid("read.SID_FEM")["mass"]) > 178
    True
    """
    if dialect not in DIALECTS:
        raise BodyError(f"SID dialect {dialect}: must be one of {', '.join(DIALECTS)}")
    mode_first, gr_axis, ge_axis = DIALECTS[dialect]
    result: dict[str, Any] = {"nodes": {}}
    target: dict[str, Any] = result
    name, header = "", dict[str, int]()
    m0 = m1 = np.empty(0)
    entry = re.compile(r"(m[01])\s*\(([^)]*)\)\s*=\s*(\S+)")
    for number, raw in enumerate(Path(path).read_text().splitlines(), 1):
        line = raw.strip()
        try:
            key, _, value = (part.strip() for part in line.partition("="))
            found = entry.match(line)
            if number == 1 or line.startswith(("part", "new modal", "rframe", "ielastq")):
                continue
            if key == "new node":
                target = result["nodes"].setdefault(int(value), {})
            elif line == "end node":
                target = result
            elif key in ("mass", "nelastq"):
                result[key] = float(value.replace("D", "E"))
            elif name and line == f"end {name}":
                if (name == "Gr" and gr_axis) or (name == "Ge" and ge_axis):
                    m0 = np.swapaxes(m0.reshape(m0.shape[0], 3, -1), 1, 2).reshape(m0.shape)
                target[name] = (m0, m1 if header["order"] else None)
                name = ""
            elif found:
                index = [int(i) - 1 for i in found[2].split(",")]
                number_read = float(found[3].replace("D", "E"))
                if found[1] == "m0":
                    m0[index[0], index[1]] = number_read
                else:
                    r, q, c = index if mode_first else (index[0], index[2], index[1])
                    m1[q, r, c] = number_read
            elif name and key in ("order", "nrow", "ncol", "nq", "nqn", "structure"):
                header[key] = int(value)
                if key == "structure":
                    m0 = np.zeros((header["nrow"], header["ncol"]))
                    m1 = np.zeros((header["nq"], header["nrow"], header["ncol"]))
            elif re.fullmatch(r"[A-Za-z]+", line) and line not in ("refmod", "frame"):
                name, header = line, {}
            elif not line.startswith("end") and line not in ("refmod", "frame", ""):
                raise ValueError(line)
        except (ValueError, IndexError, KeyError):
            raise BodyError(f"{path}, line {number}: {line!r} is not understood") from None
    return result
