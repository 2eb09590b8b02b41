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
from flexgram.assembly.interval_series import Pieces, Series, about
from flexgram.assembly.loop_series import Bodies, LoopOverInterval, LoopSeries
from flexgram.assembly.pencil import Pencil
from flexgram.assembly.small_gain import Loop, View
from flexgram.basics import ComplexArray, Floats
from flexgram.model.error_form import ErrorForm


class PartForm:
    """The residuals of a part over intervals."""

    def __init__(self, form: ErrorForm) -> None:
        self.form = form
        damping = form.alpha * form.mass + form.beta * form.stiffness
        self.pencil = Pencil.of_modes(form.stiffness, damping, form.mass, form.eta)
        same = np.array_equal(form.inputs.modal, form.outputs.modal)
        self.sides = [form.inputs] if same else [form.inputs, form.outputs]

    def over(self, omega: float, h: float) -> tuple[Series, Series] | None:
        """W_B and W_C, where the norm of S⁻¹ is one and rounding is among them; None where nothing
        is known."""
        form, last = self.form, omega + h
        if last > form.cutoff:
            return None
        a_k, a_m = np.hypot(1, form.eta + last * form.beta), last * np.hypot(last, form.alpha)
        answer = np.abs(self.pencil.steps(omega)[1]) / (1 - self.pencil.reach(omega, h))
        own = (form.cutoff**2 * a_k + a_m) * form.coupling
        delta = float((own**2 * answer[: len(own)]).sum())
        if not delta < 1:
            return None
        x, sizes = [], []
        for ports in self.sides:
            loads = np.zeros((3, *ports.modal.shape), dtype=complex)
            loads[0] = ports.modal
            x.append(self.pencil.response(omega, h, loads))
            sizes.append(np.abs(x[-1].coefficients).sum(axis=0) + x[-1].tail)
        # Rounding F of the modal matrices: of D⁻½ F D⁻½, D the sums of its rows, no more than one
        # is left (Schur). Rounding of a port meets the other's answer, each at a share of both.
        sums = a_k * form.rounding_stiffness + last**2 * form.rounding_mass
        of_ports = np.hstack([ports.rounding for ports in self.sides]).max(axis=1, initial=0)
        share = of_ports / np.maximum(np.hstack(sizes).max(axis=1, initial=0), 1e-300)
        factor = about(
            omega,
            h,
            (
                np.array(1 + 1j * form.eta),
                np.array(1j * (form.beta - form.kappa * form.alpha)),
                np.array(form.kappa),
            ),
        )
        size_of_factor = float(np.abs(factor).sum())
        result = []
        for ports, x_i, size in zip(self.sides, x, sizes, strict=True):
            w = x_i.times(-factor[:, None, None] * form.residual_stiffness)
            w = w.plus(ports.residual).scaled(1 / np.sqrt(1 - delta))
            lost = form.lost_stiffness[:, None] * size_of_factor * size
            squares = (ports.lost**2 + (lost**2).sum(axis=0)) / (1 - delta)
            squares += ((sums + share)[:, None] * size**2).sum(axis=0)
            squares += (ports.rounding**2 / np.maximum(share, 1e-300)[:, None]).sum(axis=0)
            result.append(_with_norms(w, np.sqrt(squares)))
        return result[0], result[-1]


def _with_norms(w: Series, beside: Floats) -> Series:
    """With rows for columns of these norms: Σ_j norm_j |y_j| is at most the norm of a diagonal
    matrix times y."""
    rows = np.zeros((len(w.coefficients), len(beside), len(beside)))
    rows[0] = np.diag(np.sqrt(len(beside)) * beside)
    return Series(
        np.concatenate([w.coefficients, rows], axis=1), np.concatenate([w.tail, 0 * rows[0]])
    )


def _side_by_side(parts: list[Series]) -> Series:
    """A block for each part."""
    blocks = [[s.coefficients[k] for s in parts] for k in range(len(parts[0].coefficients))]
    return Series(
        np.array([scipy.linalg.block_diag(*b) for b in blocks]),
        scipy.linalg.block_diag(*(s.tail for s in parts)),
    )


@dataclass
class _Values:
    """A matrix in the middles of the pieces (pieces, rows, columns), and how far each column is
    from these anywhere in them at most (pieces, columns)."""

    middle: ComplexArray
    away: Floats

    @classmethod
    def of(cls, series: Series, at: Pieces) -> _Values:
        d = len(series.coefficients)
        middle = np.tensordot(at.powers[:, :d], series.coefficients, axes=(1, 0))
        sizes = np.linalg.norm(series.coefficients, axis=1)
        return cls(middle, at.moved[:, :d] @ sizes + np.linalg.norm(series.tail, axis=0))

    def compressed(self) -> _Values:
        """With as many rows as columns and the same norms of products from the right."""
        if self.middle.shape[1] <= self.middle.shape[2]:
            return self
        R: ComplexArray = np.asarray(np.linalg.qr(self.middle, mode="r"))
        return _Values(R, self.away)

    def times(self, other: _Values) -> _Values:
        size = np.linalg.norm(self.middle, axis=(1, 2))[:, None]
        away = np.linalg.norm(self.away, axis=1)[:, None]
        sizes = np.linalg.norm(other.middle, axis=1)
        return _Values(self.middle @ other.middle, away * (sizes + other.away) + size * other.away)

    def transposed(self) -> _Values:
        """Each column as far away as all of them."""
        away = np.linalg.norm(self.away, axis=1)[:, None]
        return _Values(self.middle.transpose(0, 2, 1), np.repeat(away, self.middle.shape[1], 1))

    def columns(self, chosen: list[int]) -> _Values:
        return _Values(self.middle[:, :, chosen], self.away[:, chosen])

    def norms(self, order: Any = "fro") -> Floats:
        """(2, pieces): anywhere in each piece at most, and in its middle."""
        if not self.middle.size:
            return np.zeros((2, len(self.middle)))
        middle = np.linalg.norm(self.middle, order, axis=(1, 2))
        return np.array([middle + np.linalg.norm(self.away, axis=1), middle])


@dataclass
class _Residuals:
    """What the parts leave of their equations, in an assembly."""

    loop: _Values  #: W_B Q W_Cᵀ
    before: _Values  #: W_B (1 - Q H_m)
    after: _Values  #: W_C (1 - H_m Q)ᵀ

    @cached_property
    def gain(self) -> Floats:
        """Of the loop, (2, pieces)."""
        return self.loop.norms(2)

    def error(self, view: View) -> tuple[Floats, Floats]:
        """Of an assembly at most, and the gain, (2, pieces) each."""
        gain = self.gain
        before, after = self.before.columns(view.columns), self.after.columns(view.rows)
        sizes = np.minimum(before.norms() * after.norms(2), before.norms(2) * after.norms())
        closed = gain < 1
        return np.divide(sizes, 1 - gain, where=closed, out=np.full(gain.shape, np.inf)), gain


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

    def over(self, omega: float, h: float) -> Floats | None:
        return found[0] if (found := self._over(omega, h)) is not None else None

    def at(self, omega: float) -> tuple[Floats, float, Floats]:
        """Of each view the bound and what the reduced assembly differs by from that of the medium
        models, relative to ‖H‖, and the gain: at a frequency."""
        found = self._over(omega, 0.0)
        if found is None:
            nothing = np.full(len(self.loop.views), np.inf)
            return nothing, np.inf, np.full(len(nothing), np.nan)
        return found[0][0, 0], float(found[1][0, 0]), found[2][0, 0]

    def _over(self, omega: float, h: float) -> tuple[Floats, Floats, Floats] | None:
        """Bounds, gains and the differences of H_m and H_r."""
        if not self.reaches(omega, h):
            return None
        at = Pieces(h)
        small, medium = self.small.over(omega, h), self.medium.over(omega, h)
        residuals = self._residuals(omega, h, medium, at)
        difference = _difference(medium.H, small.H)
        bounds, differences = np.full((2, 2, at.count, len(self.loop.views)), np.inf)
        gain = np.full((2, at.count), np.inf)
        H_small = self.loop.outputs.over(small.H, omega, h)
        larger = self.loop.outputs.largest(omega + h)
        for v, view in enumerate(self.loop.views):
            H = _Values.of(H_small.part(view.rows, view.columns), at).norms()
            least = np.array([2 * H[1] - H[0], H[1]])
            factor = larger[view.rows].max(initial=1)
            off = factor * _Values.of(difference.part(view.rows, view.columns), at).norms()
            differences[:, :, v] = np.divide(
                off, least, where=least > 0, out=np.full(off.shape, np.inf)
            )
            if residuals is None:
                continue
            error, gain = residuals.error(view)
            error = factor * error + off
            for series, found in ((self.small, small), (self.medium, medium)):
                dual = _Values.of(found.dual.part(slice(None), view.rows), at)
                motion = _Values.of(found.motion.part(slice(None), view.columns), at)
                error += factor * series.rounding * dual.norms() * motion.norms()
            bounds[:, :, v] = np.divide(
                error, least - error, where=least > error, out=np.full(error.shape, np.inf)
            )
        return bounds, gain, differences

    def _residuals(
        self, omega: float, h: float, medium: LoopOverInterval, at: Pieces
    ) -> _Residuals | None:
        known = [pair for part in self.forms if (pair := part.over(omega, h)) is not None]
        if len(known) < len(self.forms):
            return None
        inputs, outputs = (_side_by_side([pair[side] for pair in known]) for side in (0, 1))
        # Ports in the units in which their residuals are alike.
        u_in, u_out = (
            np.maximum(
                np.linalg.norm(s.coefficients[0], axis=0) + np.linalg.norm(s.tail, axis=0), 1e-300
            )
            for s in (inputs, outputs)
        )
        W_B, W_C = (
            _Values.of(s.scaled(1 / u), at).compressed()
            for s, u in ((inputs, u_in), (outputs, u_out))
        )
        left, right = np.diag(u_in), np.diag(u_out)
        free_in, free_out = (np.eye(len(x)) for x in (self.loop.free_in, self.loop.free_out))
        Q = _Values.of(medium.Q.between(left, right), at)
        before = _Values.of(medium.before.between(left, free_in), at)
        after = _Values.of(medium.after.between(free_out, right).transposed(), at)
        return _Residuals(W_B.times(Q).times(W_C.transposed()), W_B.times(before), W_C.times(after))


def _difference(one: Series, other: Series) -> Series:
    d = max(len(one.coefficients), len(other.coefficients))

    def padded(x: Series) -> ComplexArray:
        return np.pad(x.coefficients, ((0, d - len(x.coefficients)), (0, 0), (0, 0)))

    return Series(padded(one) - padded(other), one.tail + other.tail)
