"""What an assembly of reduced bodies errs by, from the errors of its parts as forms.

A part answers by H = H_m + E, E = W_Cᵀ S⁻¹ W_B, with its medium model H_m and ‖S⁻¹‖ at most
1/(1 - δ). Joined by Q the parts answer by H - H Q H (``small_gain``). The assembly of the medium
models errs by (1 - H_m Q) E (1 + Q E)⁻¹ (1 - Q H_m), which for blocks of all parts is

    (W_C (1 - H_m Q)ᵀ)ᵀ (S + W_B Q W_Cᵀ)⁻¹ W_B (1 - Q H_m):

no port's unit or strength counts, and of the loop only the forces that act in it. What the
assembly of the reduced bodies differs by from that of the medium models is computed.
Derivation: docs/proof.md, section 8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg

from flexgram.assembly.band_bound import BandBound
from flexgram.assembly.interval_series import Pieces, Series, about, block_diag
from flexgram.assembly.loop_series import Bodies, LoopOverInterval, LoopSeries
from flexgram.assembly.pencil import Pencil
from flexgram.assembly.small_gain import Loop, View
from flexgram.basics import Bools, ComplexArray, Floats
from flexgram.model.error_form import ErrorForm


class PartForm:
    """The residuals of a part over intervals."""

    def __init__(self, form: ErrorForm) -> None:
        self.form = form
        damping = form.alpha * form.mass + form.beta * form.stiffness
        self.pencil = Pencil.of_modes(form.stiffness, damping, form.mass, form.eta)
        same = np.array_equal(form.inputs.modal, form.outputs.modal)
        self.sides = [form.inputs] if same else [form.inputs, form.outputs]

    def over(self, omega: Floats, h: Floats) -> tuple[Series, Series, Bools]:
        """W_B and W_C, where the norm of S⁻¹ is one and rounding is among them, and on which of the
        intervals something is known of them (m,)."""
        form, last = self.form, omega + h
        a_k, a_m = np.hypot(1, form.eta + last * form.beta), last * np.hypot(last, form.alpha)
        answer = np.abs(self.pencil.steps(omega)[1]) / (1 - self.pencil.reach(omega, h))[:, None]
        own = (form.cutoff**2 * a_k + a_m)[:, None] * form.coupling
        delta = (own**2 * answer[:, : len(form.coupling)]).sum(axis=1)
        known = (last <= form.cutoff) & (delta < 1)
        delta = np.where(known, delta, 0.0)
        x, sizes = [], []
        for ports in self.sides:
            loads = np.zeros((1, 3, *ports.modal.shape), dtype=complex)
            loads[:, 0] = ports.modal
            x.append(self.pencil.response(omega, h, loads))
            sizes.append(np.abs(x[-1].coefficients).sum(axis=1) + x[-1].tail)
        # Rounding F of the modal matrices: of D⁻½ F D⁻½, D the sums of its rows, no more than one
        # is left (Schur). Rounding of a port meets the other's answer, each at a share of both.
        sums = a_k[:, None] * form.rounding_stiffness + last[:, None] ** 2 * form.rounding_mass
        of_ports = np.hstack([ports.rounding for ports in self.sides]).max(axis=1, initial=0)
        largest = np.concatenate(sizes, axis=2).max(axis=2, initial=0)
        share = of_ports / np.maximum(largest, 1e-300)
        factor = about(
            omega,
            h,
            np.array([1 + 1j * form.eta]),
            np.array([1j * (form.beta - form.kappa * form.alpha)]),
            np.array([form.kappa + 0j]),
        )
        size_of_factor = np.abs(factor).sum(axis=1)[:, None, None]
        result = []
        for ports, x_i, size in zip(self.sides, x, sizes, strict=True):
            w = x_i.times(-factor).behind(form.residual_stiffness).plus(ports.residual)
            w = w.scaled(rows=1 / np.sqrt(1 - delta)[:, None])
            lost = form.lost_stiffness[:, None] * size_of_factor * size
            squares = (ports.lost**2 + (lost**2).sum(axis=1)) / (1 - delta)[:, None]
            squares += ((sums + share)[:, :, None] * size**2).sum(axis=1)
            squares += (ports.rounding**2 / np.maximum(share, 1e-300)[:, :, None]).sum(axis=1)
            result.append(_with_norms(w, np.sqrt(squares)))
        return result[0], result[-1], known


def _with_norms(w: Series, beside: Floats) -> Series:
    """With rows for columns of these norms (m, columns): Σ_j norm_j |y_j| is at most the norm of a
    diagonal matrix times y."""
    m, d, _, columns = w.coefficients.shape
    rows = np.zeros((m, d, columns, columns))
    every = np.arange(columns)
    rows[:, 0, every, every] = np.sqrt(columns) * beside
    return Series(
        np.concatenate([w.coefficients, rows], axis=2),
        np.concatenate([w.tail, np.zeros((m, columns, columns))], axis=1),
    )


def _side_by_side(parts: list[Series]) -> Series:
    """A block for each part."""
    return Series(block_diag([s.coefficients for s in parts]), block_diag([s.tail for s in parts]))


@dataclass
class _Values:
    """A matrix in the middles of the pieces (m, pieces, rows, columns), and how far each column is
    from these anywhere in them at most (m, pieces, columns)."""

    middle: ComplexArray
    away: Floats

    @classmethod
    def of(cls, series: Series, at: Pieces) -> _Values:
        sizes = np.linalg.norm(series.coefficients, axis=2)
        moved = at.moved[:, : sizes.shape[1]] @ sizes
        return cls(series.in_middles(at), moved + np.linalg.norm(series.tail, axis=1)[:, None])

    def compressed(self) -> _Values:
        """With as many rows as columns and the same norms of products from the right."""
        if self.middle.shape[2] <= self.middle.shape[3]:
            return self
        R: ComplexArray = np.asarray(np.linalg.qr(self.middle, mode="r"))
        return _Values(R, self.away)

    def times(self, other: _Values) -> _Values:
        size = np.linalg.norm(self.middle, axis=(2, 3))[..., None]
        away = np.linalg.norm(self.away, axis=2)[..., None]
        sizes = np.linalg.norm(other.middle, axis=2)
        return _Values(self.middle @ other.middle, away * (sizes + other.away) + size * other.away)

    def transposed(self) -> _Values:
        """Each column as far away as all of them."""
        away = np.linalg.norm(self.away, axis=2)[..., None]
        return _Values(self.middle.transpose(0, 1, 3, 2), np.repeat(away, self.middle.shape[2], 2))

    def columns(self, chosen: list[int]) -> _Values:
        return _Values(self.middle[..., chosen], self.away[..., chosen])

    def norms(self, order: Any = "fro") -> Floats:
        """(2, m, pieces): anywhere in each piece at most, and in its middle."""
        if not self.middle.size:
            return np.zeros((2, *self.middle.shape[:2]))
        middle = np.linalg.norm(self.middle, order, axis=(2, 3))
        return np.array([middle + np.linalg.norm(self.away, axis=2), middle])


@dataclass
class _Residuals:
    """What the parts leave of their equations, in an assembly."""

    loop: _Values  #: W_B Q W_Cᵀ
    before: _Values  #: W_B (1 - Q H_m)
    after: _Values  #: W_C (1 - H_m Q)ᵀ
    known: Bools  #: (m,)

    @cached_property
    def gain(self) -> Floats:
        """Of the loop, (2, m, pieces)."""
        return np.where(self.known[:, None], self.loop.norms(2), np.inf)

    def error(self, view: View) -> Floats:
        """Of an assembly at most, (2, m, pieces)."""
        before, after = self.before.columns(view.columns), self.after.columns(view.rows)
        sizes = np.minimum(before.norms() * after.norms(2), before.norms(2) * after.norms())
        closed = self.gain < 1
        infinite = np.full(sizes.shape, np.inf)
        return np.divide(sizes, 1 - self.gain, where=closed, out=infinite)


class FormOverBand(BandBound):
    """The bound by the forms of the parts' errors."""

    def __init__(
        self, loop: Loop, forms: list[ErrorForm], tell: Callable[[str], None] | None = None
    ) -> None:
        """``forms`` in the order of the parts."""
        self.forms = [PartForm(form) for form in forms]
        damping = np.concatenate([f.alpha * f.mass + f.beta * f.stiffness for f in forms])
        medium = Bodies(
            K=np.diag(np.concatenate([f.stiffness for f in forms])),
            D=np.diag(damping),
            M=np.diag(np.concatenate([f.mass for f in forms])),
            B=scipy.linalg.block_diag(*(f.inputs.modal for f in forms)),
            C=scipy.linalg.block_diag(*(f.outputs.modal.T for f in forms)),
            eta=loop.parts.eta,
            S=np.diag(np.concatenate([(f.eta - loop.parts.eta) * f.stiffness for f in forms])),
        )
        self.small, self.medium = LoopSeries(loop), LoopSeries(loop, medium)
        pencils = [self.small.pencil, self.medium.pencil, *(part.pencil for part in self.forms)]
        super().__init__(loop, pencils, tell)

    def over(self, omega: Floats, h: Floats) -> Floats:
        return self._over(omega, h)[0]

    def at(self, omega: Floats) -> tuple[Floats, Floats, Floats]:
        """Of each view the bound and what the reduced assembly differs by from that of the medium
        models, relative to ‖H‖, (m, views) each, and the gain (m,): at frequencies."""
        bounds, differences = np.full((2, len(omega), len(self.loop.views)), np.inf)
        gain = np.full(len(omega), np.nan)
        for first in range(0, len(omega), self.together):
            some = np.arange(first, min(first + self.together, len(omega)))
            some = some[self.reaches(omega[some], 0 * omega[some])]
            if len(some):
                of_band, of_gain, off = self._over(omega[some], 0 * omega[some])
                bounds[some], gain[some], differences[some] = (
                    of_band[:, 0, 0],
                    of_gain[0, :, 0],
                    off[0, :, 0],
                )
        return bounds, differences, gain

    def shares(self, omega: float) -> Floats:
        """What each part's own difference H_m - H_r makes of the assembly's H to first order, by
        its norm: of which part the error is."""
        w = np.array([omega])
        found = self.small.over(w, np.zeros(1))
        before, after = found.before.coefficients[0, 0], found.after.coefficients[0, 0]
        shares, row, column = [], 0, 0
        for part, model in zip(self.forms, self.loop.parts.models.values(), strict=True):
            system = model.system
            H = system.C @ np.linalg.solve(system.dynamic_stiffness(omega), system.B)
            rows, columns = slice(row, row + len(H)), slice(column, column + H.shape[1])
            lost = part.form.medium_response(omega) - H
            shares.append(np.linalg.norm(after[:, rows] @ lost @ before[columns]))
            row, column = rows.stop, columns.stop
        return np.array(shares)

    def _over(self, omega: Floats, h: Floats) -> tuple[Floats, Floats, Floats]:
        """Bounds (m, 2, pieces, views), gains (2, m, pieces) and the differences of H_m and H_r
        (2, m, pieces, views)."""
        at = Pieces(h)
        small, medium = self.small.over(omega, h), self.medium.over(omega, h)
        residuals = self._residuals(omega, h, medium, at)
        difference = _difference(medium.H, small.H)
        shape = 2, len(omega), at.count, len(self.loop.views)
        bounds, differences = np.full((2, *shape), np.inf)
        H_small = self.loop.outputs.over(small.H, omega, h)
        larger = self.loop.outputs.largest(omega + h)
        for v, view in enumerate(self.loop.views):
            H = _Values.of(H_small.part(view.rows, view.columns), at).norms()
            least = np.array([2 * H[1] - H[0], H[1]])
            factor = larger[:, view.rows].max(axis=1, initial=1)[:, None]
            off = factor * _Values.of(difference.part(view.rows, view.columns), at).norms()
            infinite = np.full(off.shape, np.inf)
            differences[..., v] = np.divide(off, least, where=least > 0, out=infinite.copy())
            error = factor * residuals.error(view) + off
            for series, found in ((self.small, small), (self.medium, medium)):
                dual = _Values.of(found.dual.part(slice(None), view.rows), at)
                motion = _Values.of(found.motion.part(slice(None), view.columns), at)
                error += factor * series.rounding * dual.norms() * motion.norms()
            closed = least > error
            bounds[..., v] = np.divide(
                error, np.where(closed, least - error, 1), where=closed, out=infinite
            )
        return bounds.transpose(1, 0, 2, 3), residuals.gain, differences

    def _residuals(
        self, omega: Floats, h: Floats, medium: LoopOverInterval, at: Pieces
    ) -> _Residuals:
        found = [part.over(omega, h) for part in self.forms]
        known = np.all([k for _, _, k in found], axis=0)
        inputs, outputs = (
            _side_by_side([b for b, _, _ in found]),
            _side_by_side([c for _, c, _ in found]),
        )
        # Ports in the units in which their residuals are alike.
        u_in, u_out = (
            np.maximum(
                np.linalg.norm(s.coefficients[:, 0], axis=1) + np.linalg.norm(s.tail, axis=1),
                1e-300,
            )
            for s in (inputs, outputs)
        )
        W_B, W_C = (
            _Values.of(s.scaled(columns=1 / u), at).compressed()
            for s, u in ((inputs, u_in), (outputs, u_out))
        )
        Q = _Values.of(medium.Q.scaled(rows=u_in, columns=u_out), at)
        before = _Values.of(medium.before.scaled(rows=u_in), at)
        after = _Values.of(medium.after.scaled(columns=u_out).transposed(), at)
        return _Residuals(
            W_B.times(Q).times(W_C.transposed()), W_B.times(before), W_C.times(after), known
        )


def _difference(one: Series, other: Series) -> Series:
    d = max(one.coefficients.shape[1], other.coefficients.shape[1])

    def padded(x: Series) -> ComplexArray:
        return np.pad(x.coefficients, ((0, 0), (0, d - x.coefficients.shape[1]), (0, 0), (0, 0)))

    return Series(padded(one) - padded(other), one.tail + other.tail)
