"""The dynamic stiffness of bodies over whole intervals of the frequency, and responses in modal
coordinates.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexgram.assembly.interval_series import DEGREE, Series, about
from flexgram.basics import ComplexArray, Floats
from flexgram.body.laws import Table
from flexgram.body.terms import Term

#: A resonance of a half width below this, relative, is sharp.
SHARPEST = 1e-6
#: Tables and the matrices that they belong to.
Tables = Sequence[tuple[Table, NDArray[Any]]]


def tables_of(terms: Iterable[Term]) -> Tables:
    """Of terms those whose laws are tables."""
    return [(term.law, term.matrix) for term in terms if isinstance(term.law, Table)]


@dataclass
class DynamicStiffness:
    """A(ω) = K + iωD - ω²M + Σ g(ω)T, or a part of it. Each table g is a line between two of its
    frequencies, so that A is a polynomial on an interval with none of these inside.

    Attributes
    ----------
    constant, linear, square : arrays
        K, which holds losses too, iD, and -M; all of one shape, of matrices or their diagonals.
    tables : sequence of (Table, array)
    """

    constant: ComplexArray
    linear: ComplexArray
    square: Floats
    tables: Tables = ()

    def between(self, left: Floats, right: Floats) -> DynamicStiffness:
        """leftᵀ A right."""
        return DynamicStiffness(
            left.T @ self.constant @ right,
            left.T @ self.linear @ right,
            left.T @ self.square @ right,
            [(g, left.T @ T @ right) for g, T in self.tables],
        )

    def polynomial(self, omega: Floats) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """The factors of 1, ω and ω² about frequencies (m,), (m or 1, …) each."""
        constant, linear = self.constant[None], self.linear[None]
        for g, T in self.tables:
            lines = np.array([g.line(w) for w in omega])
            value, slope = (x.reshape(-1, *(1,) * T.ndim) for x in lines.T)
            constant, linear = constant + value * T, linear + slope * T
        return constant, linear, self.square[None].astype(complex)

    def over(self, omega: Floats, h: Floats) -> ComplexArray:
        """A(ω + t h) as polynomials of t, (m, 3, …)."""
        return about(omega, h, *self.polynomial(omega))


def _norms(A: ComplexArray) -> Floats:
    """‖A‖ at most, of matrices (m, n, n) or diagonals (m, n)."""
    sizes = np.abs(A)
    if A.ndim == 2:
        return np.asarray(sizes.max(axis=1, initial=0))
    rows, columns = (sizes.sum(axis=k).max(axis=1, initial=0) for k in (1, 2))
    return np.asarray(np.sqrt(rows * columns))


def _is_diagonal(A: Floats) -> bool:
    diagonal = np.diag(A)
    rest = np.abs(A - np.diag(diagonal)).max(initial=0)
    return bool(rest <= 1e-13 * np.abs(diagonal).max(initial=0))


def _poles(
    stiffness: Floats, mass: Floats, lost: Floats, damping: Floats, tables: Tables
) -> tuple[Floats, Floats]:
    """Frequencies of modes by the diagonals of their matrices, and those that are sharp."""

    def roots(stiff: Floats) -> Floats:
        squares = np.divide(stiff, mass, where=mass > 0, out=np.full(len(mass), np.inf))
        frequencies: Floats = np.sqrt(np.maximum(squares, 0))
        return frequencies

    omega = roots(stiffness)
    added = np.zeros(len(omega), complex)
    for _ in range(4 * bool(tables)):  # tables stiffen a mode by what they are at its frequency
        added = sum((g.at(omega) * T for g, T in tables), np.zeros(len(omega), complex))
        omega = roots(stiffness + added.real)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.abs((lost + added.imag) / omega + damping) / (2 * omega * mass)
    return omega, omega[(half < SHARPEST) & np.isfinite(omega)]  # no rigid modes


class Pencil:
    """A(ω) of a body in modal coordinates, K and M diagonal.

    Attributes
    ----------
    modes : (n, n) array
        Of (K + τM)-norm one.
    omega : (n,) array
        Frequencies of the modes [rad/s], tables at these among their stiffness; inf: no mass.
    sharp : array
        Those of resonances that nearly nothing damps.
    """

    def __init__(
        self,
        K: Floats,
        D: Floats,
        M: Floats,
        eta: float,
        tau: float,
        S: Floats | None = None,
        tables: Tables = (),
    ) -> None:
        """K (1 + i eta) + i S + i ω D - ω² M with tables. With modes of (K + τM)-norm one those of
        the largest frequencies do not blur the low ones."""
        mass, self.modes = scipy.linalg.eigh(M, K + tau * M)
        Q = self.modes
        lost = Q.T @ (np.zeros_like(K) if S is None else S) @ Q
        of_modes = [(g, Q.T @ T @ Q) for g, T in tables]
        self._take(1 - tau * mass, Q.T @ D @ Q, mass, eta, lost, of_modes)

    @classmethod
    def of_modes(cls, stiffness: Floats, damping: Floats, mass: Floats, eta: float) -> Pencil:
        """Of a body that is diagonal."""
        pencil = cls.__new__(cls)
        pencil.modes = np.eye(len(mass))
        pencil._take(stiffness, np.diag(damping), mass, eta, np.zeros(2 * (len(mass),)), [])
        return pencil

    def _take(
        self, stiffness: Floats, D: Floats, mass: Floats, eta: float, S: Floats, tables: Tables
    ) -> None:
        parts = [D, S, *(T for _, T in tables)]
        lost, damping = eta * stiffness + np.diag(S), np.diag(D)
        diagonals = [(g, np.diag(T)) for g, T in tables]
        self.omega, self.sharp = _poles(stiffness, mass, lost, damping, diagonals)
        if all(_is_diagonal(A) for A in parts):
            self.A = DynamicStiffness(stiffness + 1j * lost, 1j * damping, -mass, diagonals)
        else:
            K = np.diag(stiffness) * (1 + 1j * eta) + 1j * S
            self.A = DynamicStiffness(K, 1j * D, -np.diag(mass), tables)
        self._at, self._steps = np.empty(0), (np.empty(0, complex),) * 3

    def steps(self, omega: Floats) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """A⁻¹A', A⁻¹ and A⁻¹A''/2 at frequencies (m,); of a diagonal the diagonals."""
        kept = np.isin(self._at, omega)
        if kept.sum() == len(omega) and not kept.all():  # some of those of before
            first, second, third = self._steps
            self._steps, self._at = (first[kept], second[kept], third[kept]), self._at[kept]
        if not np.array_equal(omega, self._at):
            constant, linear, square = self.A.polynomial(omega)
            w = omega.reshape(-1, *(1,) * (constant.ndim - 1))
            A, slope = constant + w * linear + w**2 * square, linear + 2 * w * square
            if A.ndim == 2:
                with np.errstate(divide="ignore", invalid="ignore"):
                    inverse = 1 / A
                    self._steps = slope * inverse, inverse, square * inverse
            else:
                inverse = np.linalg.inv(A)
                self._steps = inverse @ slope, inverse, inverse * np.diag(square[0])
            self._at = omega
        return self._steps

    def reach(self, omega: Floats, h: Floats) -> Floats:
        """‖A⁻¹(ω) (A(ω + t h) - A(ω))‖ at most, |t| <= 1, (m,)."""
        step, _, curve = self.steps(omega)
        return h * _norms(step) + h * h * _norms(curve)

    def response(self, omega: Floats, h: Floats, loads: ComplexArray) -> Series:
        """A⁻¹ times loads (m, 3, n, columns), polynomials of t."""
        step, inverse, curve = self.steps(omega)

        def apply(matrix: ComplexArray, x: ComplexArray) -> ComplexArray:
            return matrix[:, :, None] * x if matrix.ndim == 2 else matrix @ x

        first = apply(inverse, loads[:, 0])
        if not h.any():
            return Series(first[:, None], np.zeros(first.shape))
        x = np.zeros((len(omega), DEGREE + 3, *loads.shape[2:]), dtype=complex)
        r = h.reshape(-1, *(1,) * (step.ndim - 1))
        step, curve = r * step, r * r * curve
        for k in range(DEGREE + 3):
            if k < 3:
                x[:, k] += first if k == 0 else apply(inverse, loads[:, k])
            if 0 < k <= DEGREE + 1:
                x[:, k] -= apply(step, x[:, k - 1])
            if k > 1:
                x[:, k] -= apply(curve, x[:, k - 2])
        # The last two are what the series leaves of the equation, once A(ω)⁻¹ is applied.
        left = np.linalg.norm(x[:, DEGREE + 1 :], axis=2).sum(axis=1)
        tail = left / (1 - self.reach(omega, h))[:, None]
        return Series(x[:, : DEGREE + 1], np.repeat(tail[:, None], loads.shape[2], axis=1))
