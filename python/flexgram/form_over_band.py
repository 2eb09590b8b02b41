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

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexgram.error_form import ErrorForm
from flexgram.gain_over_band import REACH, GainOverBand, LoopSeries
from flexgram.interval_series import PIECES, Pencil, Pieces, Series, about
from flexgram.small_gain import Loop, relative

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class PartForm:
    """The residuals of a part over intervals."""

    def __init__(self, form: ErrorForm) -> None:
        self.form = form
        damping = form.alpha * form.mass + form.beta * form.stiffness
        self.pencil = Pencil.of_modes(form.stiffness, damping, form.mass, form.eta)
        same = np.array_equal(form.inputs, form.outputs)
        self.sides = [
            ("inputs", "residual_inputs", "lost_inputs", "rounding_inputs"),
            ("outputs", "residual_outputs", "lost_outputs", "rounding_outputs"),
        ]
        self.sides = self.sides[:1] if same else self.sides

    def over(self, omega: float, h: float) -> tuple[Series, Series] | None:
        """W_B and W_C with all that is bounded beside them, of S⁻¹ of a norm of one; None where
        nothing is known."""
        form, last = self.form, omega + h
        if last > form.cutoff:
            return None
        f = about(omega, (np.array(1 + 1j * form.eta),
                          np.array(1j * (form.beta - form.kappa * form.alpha)),
                          np.array(form.kappa)))  # fmt: skip
        size_f = float(np.abs(f) @ h ** np.arange(3))
        a_k = np.hypot(1, form.eta + last * form.beta)
        c = np.hypot(form.cutoff**2 * a_k, 0) + last * np.hypot(last, form.alpha)
        _, inverse, _ = self.pencil.steps(omega)
        largest = np.abs(inverse) / (1 - self.pencil.reach(omega, h))  # 1/|a_k κ + a_m μ|
        modes = len(form.coupling)
        delta = float(((c * form.coupling) ** 2 * largest[:modes]).sum())
        if not delta < 1:
            return None
        result = []
        for ports, residual, lost, rounding in self.sides:
            loads = np.zeros((3, *getattr(form, ports).shape), dtype=complex)
            loads[0] = getattr(form, ports)
            x = self.pencil.response(omega, h, loads)
            sizes = np.tensordot(h ** np.arange(len(x.coefficients)), np.abs(x.coefficients), 1)
            sizes = sizes + x.tail
            w = x.times(-f[:, None, None] * form.residual_stiffness, h)
            w = w.plus(getattr(form, residual))
            w = Series(w.coefficients / np.sqrt(1 - delta), w.tail / np.sqrt(1 - delta))
            left_out = np.sqrt(
                getattr(form, lost) ** 2
                + ((form.lost_stiffness[:, None] * size_f * sizes) ** 2).sum(0)
            )
            # Rounding F of the modal matrices: of D⁻½ F D⁻½, D the sums of its rows, no more
            # than one is left (Schur). Rounding of ports against responses, both ways.
            rows = a_k * form.rounding_stiffness + last**2 * form.rounding_mass
            off = getattr(form, rounding)
            balance = off.max(axis=1, initial=0) / np.maximum(sizes.max(axis=1, initial=0), 1e-300)
            rounded = np.divide(off, np.sqrt(balance)[:, None], where=balance[:, None] > 0,
                                out=np.zeros_like(off))  # fmt: skip
            beside = np.sqrt(left_out**2 / (1 - delta) + (rounded**2).sum(0)
                             + ((rows + balance)[:, None] * sizes**2).sum(0))  # fmt: skip
            none = np.zeros((len(w.coefficients), 1, off.shape[1]))
            result.append(Series(np.concatenate([w.coefficients, none], axis=1),
                                 np.concatenate([w.tail, beside[None]])))  # fmt: skip
        return result[0], result[-1]


def _side_by_side(parts: list[Series]) -> Series:
    """A block for each part."""
    blocks = [[s.coefficients[k] for s in parts] for k in range(len(parts[0].coefficients))]
    return Series(np.array([scipy.linalg.block_diag(*b) for b in blocks]),
                  scipy.linalg.block_diag(*(s.tail for s in parts)))  # fmt: skip


@dataclass
class _Values:
    """A matrix in the middles of the pieces (pieces, rows, columns), and how far it is from these
    anywhere in them at most, in the Frobenius norm."""

    middle: ComplexArray
    away: Floats

    @classmethod
    def of(cls, series: Series, at: Pieces) -> _Values:
        d = len(series.coefficients)
        middle = np.tensordot(at.powers[:, :d], series.coefficients, axes=(1, 0))
        sizes = np.linalg.norm(series.coefficients, axis=(1, 2))
        return cls(middle, at.moved[:, :d] @ sizes + float(np.linalg.norm(series.tail)))

    def compressed(self) -> _Values:
        """With as many rows as columns and the same norms of products from the right."""
        if self.middle.shape[1] <= self.middle.shape[2]:
            return self
        return _Values(np.linalg.qr(self.middle, mode="r"), self.away)

    def times(self, other: _Values) -> _Values:
        sizes = [np.linalg.norm(x.middle, 2, axis=(1, 2)) if x.middle.size else np.zeros(PIECES)
                 for x in (self, other)]  # fmt: skip
        away = self.away * (sizes[1] + other.away) + sizes[0] * other.away
        return _Values(self.middle @ other.middle, away)

    def transposed(self) -> _Values:
        return _Values(self.middle.transpose(0, 2, 1), self.away)

    def columns(self, chosen: list[int]) -> _Values:
        return _Values(self.middle[:, :, chosen], self.away)

    def norms(self, order: Any, anywhere: bool) -> Floats:
        if not self.middle.size:
            return np.zeros(PIECES)
        return np.linalg.norm(self.middle, order, axis=(1, 2)) + anywhere * self.away


class FormOverBand(GainOverBand):
    """The bound of an assembly's error by the forms of its parts."""

    def __init__(self, loop: Loop, tell: Callable[[str], None] | None = None) -> None:
        super().__init__(loop, tell)
        models = loop.parts.models
        self.forms = {name: PartForm(m.form) for name, m in models.items() if m.form is not None}
        if len(self.forms) != len(models):
            raise ValueError("a part has no form of its error")
        medium = copy.copy(loop)
        medium.parts = copy.copy(loop.parts)
        forms = [part.form for part in self.forms.values()]
        medium.parts.K = np.diag(np.concatenate([f.stiffness for f in forms]))
        medium.parts.M = np.diag(np.concatenate([f.mass for f in forms]))
        medium.parts.D = np.diag(
            np.concatenate([f.alpha * f.mass + f.beta * f.stiffness for f in forms]))  # fmt: skip
        medium.parts.B = scipy.linalg.block_diag(*(f.inputs for f in forms))
        medium.parts.C = scipy.linalg.block_diag(*(f.outputs.T for f in forms))
        self.medium = LoopSeries(medium)
        self.pencils = [self.series.pencil, self.medium.pencil,
                        *(part.pencil for part in self.forms.values())]  # fmt: skip
        self.gain = np.inf  #: of the interval that was looked at last
        self.difference = np.full(len(loop.views), np.inf)

    def over(self, omega: float, h: float) -> Floats | None:
        if not all(pencil.reach(omega, h) <= REACH for pencil in self.pencils):
            return None
        at, loop = Pieces(h), self.loop
        bounds = np.full((2, PIECES, len(loop.views)), np.inf)
        small, medium = self.series.over(omega, h), self.medium.over(omega, h)
        residuals = [part.over(omega, h) for part in self.forms.values()]
        known = [pair for pair in residuals if pair is not None]
        W_B = W_C = Q = None
        if len(known) == len(residuals):
            series = [_side_by_side([pair[side] for pair in known]) for side in (0, 1)]
            # Ports in the units in which their residuals are alike.
            units = [np.maximum(np.linalg.norm(s.coefficients[0], axis=0)
                                + np.linalg.norm(s.tail, axis=0), 1e-300)
                     for s in series]  # fmt: skip
            W_B, W_C = (_Values.of(Series(s.coefficients / u, s.tail / u), at).compressed()
                        for s, u in zip(series, units, strict=True))  # fmt: skip
            Q = _Values.of(medium.Q.between(np.diag(units[0]), np.diag(units[1])), at)
            before = _Values.of(medium.before.between(np.diag(units[0]), np.eye(
                len(loop.free_in))), at)  # fmt: skip
            after = _Values.of(medium.after.between(np.eye(len(loop.free_out)),
                                                    np.diag(units[1])), at)  # fmt: skip
            loop_gain = W_B.times(Q).times(W_C.transposed())
            right, left = W_B.times(before), W_C.times(after.transposed())
        every = slice(None)
        d = max(len(small.H.coefficients), len(medium.H.coefficients))

        def padded(series: Series) -> ComplexArray:
            more = d - len(series.coefficients)
            return np.pad(series.coefficients, ((0, more), (0, 0), (0, 0)))

        away = Series(padded(medium.H) - padded(small.H), medium.H.tail + small.H.tail)
        for anywhere in (0, 1):  # in the middles of the pieces, and anywhere in them
            gain = (loop_gain.norms(2, bool(anywhere)) if Q is not None
                    else np.full(PIECES, np.inf))  # fmt: skip
            self.gain = float(gain[PIECES // 2]) if not anywhere else self.gain
            for v, view in enumerate(loop.views):
                H, off = small.H.part(view.rows, view.columns).norms(at, "fro")
                middle, moved = away.part(view.rows, view.columns).norms(at, "fro")
                difference = middle + anywhere * moved
                rounding = np.zeros(PIECES)
                for series_, found in ((self.series, small), (self.medium, medium)):
                    sizes = [
                        s.norms(at, "fro")
                        for s in (
                            found.dual.part(every, view.rows),
                            found.motion.part(every, view.columns),
                        )
                    ]
                    rounding += series_.rounding * np.prod(
                        [m + anywhere * o for m, o in sizes], axis=0)  # fmt: skip
                if not anywhere:
                    self.difference[v] = difference[PIECES // 2] / H[PIECES // 2]
                if Q is None:
                    continue
                R, L = right.columns(view.columns), left.columns(view.rows)
                form = np.minimum(
                    R.norms("fro", bool(anywhere)) * L.norms(2, bool(anywhere)),
                    R.norms(2, bool(anywhere)) * L.norms("fro", bool(anywhere)),
                )
                for i in np.flatnonzero(gain < 1):
                    error = form[i] / (1 - gain[i]) + difference[i] + rounding[i]
                    bounds[1 - anywhere, i, v] = relative(error, H[i] - anywhere * off[i])
        return bounds

    def at(self, omega: float) -> tuple[Floats, float]:
        """As ``Loop.at``."""
        bounds = self.over(omega, 0.0)
        return (np.full(len(self.loop.views), np.inf) if bounds is None
                else bounds[1, PIECES // 2]), self.gain  # fmt: skip
