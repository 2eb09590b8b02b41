"""Assemblies of reduced bodies over whole intervals of the frequency.

With the dynamic stiffness A(ω) of the parts and the springs between them, ties
Gᵀq = g and q = N z + L g, where Gᵀ N = 0, Gᵀ L = 1:

    Nᵀ A N z = Nᵀ (f - A L g),  λ = Lᵀ (f - A q).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexgram.assembly.interval_series import Series, about
from flexgram.assembly.pencil import DynamicStiffness, Pencil, tables_of
from flexgram.assembly.small_gain import Loop
from flexgram.basics import Floats
from flexgram.body.terms import Term
from flexgram.model.reduced import ReducedBody


class PartSeries:
    """Receptances C A⁻¹ B of a part."""

    def __init__(self, model: ReducedBody, B: Floats, C: Floats) -> None:
        tau = float(model.claim.bands.max()) ** 2 / 4
        system = model.system
        tables = tables_of(system.terms)
        self.pencil = Pencil(system.K, system.D, system.M, system.eta, tau, system.S, tables)
        self.B, self.C = self.pencil.modes.T @ B, C @ self.pencil.modes

    def over(self, omega: Floats, h: Floats) -> Series:
        loads = np.zeros((1, 3, *self.B.shape), dtype=complex)
        loads[:, 0] = self.B
        return self.pencil.response(omega, h, loads).behind(self.C)


@dataclass
class Bodies:
    """Matrices of bodies side by side."""

    K: Floats
    D: Floats
    M: Floats
    B: Floats
    C: Floats
    eta: float
    S: Floats  #: beside eta: the imaginary part of the stiffness
    terms: Sequence[Term] = ()  #: with laws that are tables


@dataclass
class LoopOverInterval:
    """Of an assembly over intervals, inputs and outputs as of ``Loop``."""

    Q: Series
    after: Series  #: 1 - H Q, the rows of the outputs that are left
    before: Series  #: 1 - Q H, the columns of the inputs that are left
    H: Series  #: of these
    motion: Series  #: in modal coordinates, in answer to these inputs
    dual: Series  #: the same in answer to loads like these outputs


class LoopSeries:
    """An assembly over intervals, of the bodies of the loop or of others with the same ports."""

    def __init__(self, loop: Loop, bodies: Bodies | None = None) -> None:
        parts = loop.parts if bodies is None else bodies
        self.S_in, self.S_out = loop.S_in, loop.S_out
        self.free_in, self.free_out = loop.free_in, loop.free_out
        self.ties = [k for k, (_, joint) in enumerate(loop.ties) if joint.ties]
        self.springs = [k for k in range(len(loop.ties)) if k not in self.ties]
        springs = [loop.ties[k] for k in self.springs]
        self.stiffness = np.array([joint.complex_stiffness(d) for d, joint in springs], complex)
        self.damping = np.array([joint.damper(d) for d, joint in springs])
        G, b = parts.B @ self.S_in[self.ties].T, parts.B @ self.S_in[self.springs].T
        K, S = parts.K + (b * self.stiffness.real) @ b.T, parts.S + (b * self.stiffness.imag) @ b.T
        D = parts.D + (b * self.damping) @ b.T
        N = np.eye(len(K))
        if self.ties:
            N = scipy.linalg.null_space(G.T / np.linalg.norm(G, axis=0)[:, None])
        tau = max(float(m.claim.bands.max()) for m in loop.parts.models.values()) ** 2 / 4
        K_N, D_N, M_N, S_N = (N.T @ A @ N for A in (K, D, parts.M, S))
        tables = tables_of(parts.terms)
        tables_N = [(g, N.T @ T @ N) for g, T in tables]
        self.pencil = Pencil(K_N, D_N, M_N, parts.eta, tau, S_N, tables_N)
        # Of the matrices of modes: some roundings, of the stiffest spring's, or of what a table
        # adds, where these are stiffer than the parts.
        stiffest = K + sum(g.largest * T for g, T in tables)
        self.rounding = loop.parts.rounding + (
            80
            * np.finfo(float).eps
            * float(scipy.linalg.eigh(stiffest, parts.K + tau * parts.M, eigvals_only=True)[-1])
        )
        N, L = N @ self.pencil.modes, np.linalg.pinv(G).T
        A = DynamicStiffness(K * (1 + 1j * parts.eta) + 1j * S, 1j * D, -parts.M, tables)
        self.NAL, self.LAL = A.between(N, L), A.between(L, L)
        forces, outputs = parts.B[:, self.free_in], parts.C[self.free_out]
        self.NB, self.Nb = N.T @ forces, N.T @ b
        self.LB, self.Lb, self.bL = L.T @ forces, L.T @ b, b.T @ L
        self.CN, self.CL = outputs @ N, outputs @ L

    def over(self, omega: Floats, h: Floats) -> LoopOverInterval:
        m, p, t, o = len(omega), len(self.free_in), len(self.S_in), len(self.free_out)
        ties, springs = self.ties, self.springs
        tied, sprung = [p + k for k in ties], [p + k for k in springs]
        NAL, LAL = self.NAL.over(omega, h), self.LAL.over(omega, h)
        stiffness, damping = np.diag(self.stiffness)[None], np.diag(self.damping)[None]
        Y = about(omega, h, stiffness, 1j * damping, 0j * damping)
        loads = np.zeros((m, 3, len(self.NB), p + t + o), dtype=complex)  # forces, gaps, outputs
        loads[:, 0, :, :p], loads[..., tied], loads[..., sprung] = self.NB, -NAL, self.Nb @ Y
        loads[:, 0, :, p + t :] = self.CN.T
        answers = self.pencil.response(omega, h, loads)
        every = slice(None)
        z = answers.part(every, slice(0, p + t))
        at_ties = np.zeros((m, 3, len(ties), p + t), dtype=complex)
        at_ties[:, 0, :, :p], at_ties[..., tied], at_ties[..., sprung] = self.LB, -LAL, self.Lb @ Y
        of_ties = z.times(-NAL.transpose(0, 1, 3, 2)).plus(at_ties)
        stretch = np.zeros((len(springs), p + t))
        stretch[:, tied], stretch[:, sprung] = self.bL, -np.eye(len(springs))
        of_springs = z.behind(self.Nb.T).plus(stretch).times(Y)
        coefficients = np.zeros((m, of_springs.coefficients.shape[1], t, p + t), dtype=complex)
        tail = np.zeros((m, t, p + t))
        for rows, series in ((ties, of_ties), (springs, of_springs)):
            coefficients[:, :, rows], tail[:, rows] = series.coefficients, series.tail
        forces = Series(coefficients, tail)  # λ
        moved = np.zeros((o, t))
        moved[:, ties] = self.CL
        outputs = z.behind(self.CN)
        to_gaps, to_forces = slice(p, None), slice(0, p)
        gaps = outputs.part(every, to_gaps).plus(moved)
        return LoopOverInterval(
            Q=forces.part(every, to_gaps).between(-self.S_in.T, self.S_out),
            after=gaps.between(np.eye(o), -self.S_out).plus(
                np.eye(self.S_out.shape[1])[self.free_out]
            ),
            before=forces.part(every, to_forces)
            .behind(-self.S_in.T)
            .plus(np.eye(self.S_in.shape[1])[:, self.free_in]),
            H=outputs.part(every, to_forces),
            motion=z.part(every, to_forces),
            dual=answers.part(every, slice(p + t, None)),
        )
