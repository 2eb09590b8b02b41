"""A reduced body by the motion of its interfaces and internal coordinates, as superelements are.

q = T [u_b; p]: u_b are the displacements and rotations of the interfaces themselves, p the modes of
the body with all interfaces held. An exact change of basis (Craig and Bampton's form of whatever
basis the body has): the responses stay what they are, and so does the certified error.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from flexgram.basics import BodyError, Floats
from flexgram.model.geometry import body_of, interface_positions, positions_in_file
from flexgram.model.reduced import ReducedBody
from flexgram.model.response import expect_collocated
from flexgram.model.system import System

#: A motion of the interfaces that is smaller than this in the basis, relative, is none.
HELD = 1e-9
DIRECTIONS = {"fx": 0, "fy": 1, "fz": 2, "mx": 3, "my": 4, "mz": 5}


@dataclass(frozen=True, kw_only=True)
class PhysicalForm(System):
    """The system in the coordinates x = [u_b; p].

    K has no part between u_b and p, and is diagonal in p, where M is the identity. Ports of the
    interfaces are unit vectors of x.

    Attributes
    ----------
    interfaces : dict
        For each interface which of x moves it, by direction: 0-2 translation, 3-5 rotation.
    boundary : list of str
        Ports of u_b, in the order of x.
    frequencies : (m - n_b,) array
        Modes with all interfaces held [rad/s].
    T : (m, m) array
        q = T x.
    source : ReducedBody
    """

    interfaces: dict[str, dict[int, int]]
    boundary: list[str]
    frequencies: Floats
    T: Floats
    source: ReducedBody

    def positions(self, body: str | Path | None = None) -> dict[str, Floats]:
        """Where the interfaces are (3,) [m]: of a free body by its rigid modes, else by its file.

        Raises
        ------
        BodyError
            If nothing tells.
        """
        model = self.source
        if (
            model.frame.rigid_modes == 6
            and model.frame.integrals
            and all(len(moves) == 6 for moves in self.interfaces.values())
        ):
            return {
                name: place
                for name, place in interface_positions(model).items()
                if name in self.interfaces
            }
        path = body_of(model, body)
        found = positions_in_file(path)
        missing = [name for name in self.interfaces if name not in found]
        if missing:
            raise BodyError(f"{path} does not tell where interface {missing[0]} is")
        return {name: found[name] for name in self.interfaces}

    def rigid_motions(self, body: str | Path | None = None) -> Floats:
        """u_b of the six rigid motions, (n_b, 6): translations, rotations about the origin."""
        places = self.positions(body)
        R = np.zeros((len(self.boundary), 6))
        for name, moves in self.interfaces.items():
            for direction, row in moves.items():
                if direction >= 3:
                    R[row, direction] = 1
                    continue
                R[row, direction] = 1
                for axis in range(3):
                    R[row, 3 + axis] = np.cross(np.eye(3)[axis], places[name])[direction]
        return R


def _boundary(system: System) -> tuple[list[str], Floats, dict[str, dict[int, int]]]:
    """Ports of interfaces, their rows of C, and whose they are."""
    names: list[str] = []
    interfaces: dict[str, dict[int, int]] = {}
    for port in system.inputs:
        name, _, force = port.rpartition(".")
        if force not in DIRECTIONS or port not in system.outputs:
            continue
        expect_collocated(
            port, system.C[system.outputs.index(port)], system.B[:, system.inputs.index(port)]
        )
        interfaces.setdefault(name, {})[DIRECTIONS[force]] = len(names)
        names.append(port)
    if not names:
        raise BodyError(
            "no port is a force and its displacement (x.fx … x.mz): the body has no "
            "interfaces whose motion could be coordinates"
        )
    return names, np.array([system.C[system.outputs.index(name)] for name in names]), interfaces


def physical_form(model: ReducedBody) -> PhysicalForm:
    """The body in the motion of its interfaces and the modes with these held.

    Raises
    ------
    BodyError
        If the body's coordinates do not hold every motion of the interfaces by itself: it is too
        small for that, or a motion is no part of its basis. For gyroscopic forces.

    Examples
    --------
    >>> form = physical_form(flexgram.ReducedModel.load("rack.rom.h5"))
    >>> len(form.boundary) + len(form.frequencies) == len(form.K)
    True
    """
    system = model.system
    system.expect_symmetric("this form")
    names, C_b, interfaces = _boundary(system)
    m, n_b = system.order, len(names)
    scale = max(float(model.claim.bands[-1, 1]), 1e-12)
    try:
        L = np.linalg.cholesky(system.M + system.K / scale**2)
    except np.linalg.LinAlgError:
        raise BodyError("M + K/omega² is not positive definite") from None
    C = scipy.linalg.solve_triangular(L, C_b.T, lower=True).T  # of orthonormal coordinates
    sizes = np.linalg.norm(C, axis=1)
    if np.any(sizes == 0):
        raise BodyError(f"{names[int(np.argmin(sizes))]}: the body does not move there")
    values = np.linalg.svd(C / sizes[:, None], compute_uv=False)
    rank = int(np.sum(values > HELD * values[0]))
    if rank < n_b:
        raise BodyError(
            f"the {m} coordinates hold {rank} of the {n_b} motions of {', '.join(interfaces)}: "
            "take the static response to every port into the basis (--statics yes), a smaller "
            "--tol, or fewer ports (--inputs)"
        )

    def by_energy(A: Floats) -> Floats:
        A = scipy.linalg.solve_triangular(L, A, lower=True)
        both: Floats = scipy.linalg.solve_triangular(L, A.T, lower=True)
        both = 0.5 * (both + both.T)
        return both

    K, M = by_energy(system.K), by_energy(system.M)
    Q, R = np.linalg.qr(C.T, mode="complete")
    follow, inner = Q[:, :n_b] @ np.linalg.inv(R[:n_b]).T, Q[:, n_b:]
    K_p, M_p = inner.T @ K @ inner, inner.T @ M @ inner
    squares, modes = scipy.linalg.eigh(0.5 * (K_p + K_p.T), 0.5 * (M_p + M_p.T))
    inner = inner @ modes
    if len(squares) and squares[0] <= 1e-12 * squares[-1]:
        raise BodyError(
            "the body can move with all its interfaces held: these ports leave a rigid motion free"
        )
    # Static: no force on p. Elastic energy couples u_b and p no more.
    follow = follow - inner @ ((inner.T @ (K @ follow)) / squares[:, None])
    X = np.hstack([follow, inner])
    T = scipy.linalg.solve_triangular(L.T, X, lower=False)

    def turned(A: Floats) -> Floats:
        B: Floats = X.T @ A @ X
        B = 0.5 * (B + B.T)
        return B

    K_x, M_x = turned(K), turned(M)
    K_x[:n_b, n_b:], K_x[n_b:, :n_b] = 0, 0
    K_x[n_b:, n_b:], M_x[n_b:, n_b:] = np.diag(squares), np.eye(m - n_b)
    B_x, C_x = T.T @ system.B, system.C @ T
    for unit, name in zip(np.eye(m), names, strict=False):
        B_x[:, system.inputs.index(name)] = unit
        C_x[system.outputs.index(name)] = unit
    return PhysicalForm(
        M=M_x,
        D=turned(by_energy(system.D)),
        K=K_x,
        eta=system.eta,
        S=turned(by_energy(system.S)),
        terms=system.terms_by(lambda T: turned(by_energy(T))),
        B=B_x,
        C=C_x,
        inputs=system.inputs,
        outputs=system.outputs,
        feedthrough=system.feedthrough,
        output_beta=system.output_beta,
        output_eta=system.output_eta,
        interfaces=interfaces,
        boundary=names,
        frequencies=np.sqrt(np.maximum(squares, 0)),
        T=T,
        source=model,
    )


def file_name(text: str) -> str:
    """A name that every code takes."""
    return re.sub(r"\W", "_", text)


def facts(form: PhysicalForm) -> dict[str, Any]:
    """What a reader of an exported file wants to know, as words."""
    return {
        "order": f"{len(form.boundary)} motions of {', '.join(form.interfaces)} and "
        f"{form.order - len(form.boundary)} modes with these held",
        **facts_of(form.source),
    }


def facts_of(model: ReducedBody) -> dict[str, Any]:
    """Error, units and warnings of a body."""
    facts = {
        "error": f"{model.claim.supremum:.1e} ({model.claim.label})",
        "units": "m, rad, kg, s, N",
    }
    if model.provenance.warnings:
        facts["warnings"] = " ".join(model.provenance.warnings)
    return facts
