"""Responses in modal coordinates over whole intervals of the frequency.

A response is a power series about the middle of an interval, up to a tail that Neumann's series
bounds; pieces of the interval take the values in their middles and how far these move at most.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexgram.basics import ComplexArray, Floats
from flexgram.model.system import System

#: Rows or columns of a matrix.
Chosen = Sequence[int] | NDArray[np.int64] | slice

#: Powers of a series, and pieces of its interval.
DEGREE, PIECES = 16, 16
#: A resonance of a half width below this, relative, is sharp.
SHARPEST = 1e-6


class Pieces:
    """Pieces of an interval, one of a point, and what powers of t do on them, |t| <= 1."""

    def __init__(self, h: float) -> None:
        self.count = PIECES if h else 1
        self.half = 1 / self.count if h else 0.0
        self.middles = np.linspace(self.half - 1, 1 - self.half, self.count) if h else np.zeros(1)
        k = np.arange(DEGREE + 3)
        far = np.abs(self.middles)[:, None]
        self.powers = self.middles[:, None] ** k
        self.moved = (far + self.half) ** k - far**k  # |t^k - middle^k| at most


@dataclass
class Series:
    """A matrix over ω + t h, |t| <= 1: Σ coefficients[k] t^k, each entry off by `tail` at most.

    Attributes
    ----------
    coefficients : (d + 1, rows, columns) array
        One at a point, h = 0.
    tail : (rows, columns) array
    """

    coefficients: ComplexArray
    tail: Floats

    def between(self, left: Floats, right: Floats) -> Series:
        return Series(left @ self.coefficients @ right, np.abs(left) @ self.tail @ np.abs(right))

    def times(self, polynomial: ComplexArray) -> Series:
        """A polynomial (3, rows', rows) times this."""
        if len(self.coefficients) == 1:
            return Series(polynomial[0] @ self.coefficients, np.abs(polynomial[0]) @ self.tail)
        d, columns = len(self.coefficients), self.coefficients.shape[2]
        product = np.zeros((d + 2, polynomial.shape[1], columns), dtype=complex)
        tail = np.zeros((polynomial.shape[1], columns))
        for k, factor in enumerate(polynomial):
            product[k : k + d] += factor @ self.coefficients
            tail += np.abs(factor) @ self.tail
        return Series(product, tail)

    def plus(self, polynomial: ComplexArray | Floats) -> Series:
        """With a polynomial (3, rows, columns) or a constant added to it."""
        added = self.coefficients.copy()
        if polynomial.ndim == 2:
            added[0] += polynomial
        else:
            added[:3] += polynomial[: len(added)]
        return Series(added, self.tail)

    def scaled(self, factor: float | Floats) -> Series:
        """Each column times its factor, which is positive."""
        return Series(self.coefficients * factor, self.tail * factor)

    def transposed(self) -> Series:
        return Series(self.coefficients.transpose(0, 2, 1), self.tail.T)

    def part(self, rows: Chosen, columns: Chosen) -> Series:
        return Series(self.coefficients[:, rows][:, :, columns], self.tail[rows][:, columns])

    def norms(self, at: Pieces, order: Literal[2, "fro"]) -> tuple[Floats, Floats]:
        """Norms in the middles of the pieces, and how far they are off in each at most."""
        d = len(self.coefficients)
        values = np.tensordot(at.powers[:, :d], self.coefficients, axes=(1, 0))
        sizes = np.linalg.norm(self.coefficients, axis=(1, 2))
        return (
            np.linalg.norm(values, order, axis=(1, 2)),
            at.moved[:, :d] @ sizes + float(np.linalg.norm(self.tail)),
        )


@dataclass
class OutputTerms:
    """What outputs hold beside C q: H = diag(1 + i eta + i ω beta) C A⁻¹ B + direct."""

    beta: Floats
    eta: Floats
    direct: Floats

    @classmethod
    def of(cls, systems: Iterable[System]) -> OutputTerms:
        """Of systems side by side."""
        all_of_them = list(systems)
        return cls(
            np.concatenate([s.output_beta for s in all_of_them]),
            np.concatenate([s.output_eta for s in all_of_them]),
            scipy.linalg.block_diag(*(s.claimed_feedthrough for s in all_of_them)),
        )

    def part(self, rows: list[int], columns: list[int]) -> OutputTerms:
        return OutputTerms(self.beta[rows], self.eta[rows], self.direct[np.ix_(rows, columns)])

    @property
    def are_plain(self) -> bool:
        return not (self.beta.any() or self.eta.any() or self.direct.any())

    def largest(self, last: float) -> Floats:
        """The sizes of the factors up to a frequency."""
        sizes: Floats = np.hypot(1, self.eta + last * self.beta)
        return sizes

    def at(self, H: ComplexArray, omega: float) -> ComplexArray:
        """H from C A⁻¹ B at a frequency."""
        whole: ComplexArray = (1 + 1j * (self.eta + omega * self.beta))[:, None] * H + self.direct
        return whole

    def over(self, H: Series, omega: float, h: float) -> Series:
        """The same over an interval."""
        if self.are_plain:
            return H
        factors = np.diag(1 + 1j * self.eta), 1j * np.diag(self.beta), 0 * np.diag(self.beta)
        return H.times(about(omega, h, factors)).plus(self.direct)


def _norm(A: ComplexArray) -> float:
    """‖A‖ at most, of a matrix or a diagonal."""
    if A.ndim == 1:
        return float(np.abs(A).max(initial=0))
    sizes = np.abs(A)
    return float(np.sqrt(sizes.sum(axis=0).max(initial=0) * sizes.sum(axis=1).max(initial=0)))


def _diagonal(A: Floats) -> Floats:
    """The diagonal of A, where nothing else is in it."""
    if A.ndim == 1:
        return A
    diagonal = np.diag(A)
    rest = np.abs(A - np.diag(diagonal)).max(initial=0)
    return diagonal if rest <= 1e-13 * np.abs(diagonal).max(initial=0) else A


class Pencil:
    """A(ω) = K (1 + i eta) + i S + i ω D - ω² M of a body in modal coordinates, K and M
    diagonal."""

    def __init__(
        self, K: Floats, D: Floats, M: Floats, eta: float, tau: float, S: Floats | None = None
    ) -> None:
        """Modes of (K + τM)-norm one: those of the largest frequencies do not blur the low ones."""
        mass, self.modes = scipy.linalg.eigh(M, K + tau * M)
        lost = None if S is None or not S.any() else self.modes.T @ S @ self.modes
        self._take(1 - tau * mass, self.modes.T @ D @ self.modes, mass, eta, lost)

    @classmethod
    def of_modes(cls, stiffness: Floats, damping: Floats, mass: Floats, eta: float) -> Pencil:
        """Of a body that is diagonal."""
        pencil = cls.__new__(cls)
        pencil.modes = np.eye(len(mass))
        pencil._take(stiffness, damping, mass, eta)
        return pencil

    def _take(
        self, stiffness: Floats, D: Floats, mass: Floats, eta: float, S: Floats | None = None
    ) -> None:
        heavy = mass > 0
        squares = np.divide(stiffness, mass, where=heavy, out=np.full(len(mass), np.inf))
        self.omega = np.sqrt(np.maximum(squares, 0))
        self.K, self.M, self.D = stiffness * (1 + 1j * eta), mass, _diagonal(D)
        lost = np.zeros(len(mass)) if S is None else _diagonal(S)
        if lost.ndim == 2 or self.D.ndim == 2:
            self.D = np.diag(self.D) if self.D.ndim == 1 else self.D
            lost = np.diag(lost) if lost.ndim == 1 else lost
        self.S = lost
        of_modes, losses = (A if A.ndim == 1 else np.diag(A) for A in (self.D, self.S))
        with np.errstate(divide="ignore", invalid="ignore"):
            imaginary = (self.K.imag + losses) / self.omega
            half = np.abs(imaginary + of_modes) / (2 * self.omega * mass)
        self.sharp = self.omega[(half < SHARPEST) & np.isfinite(self.omega)]  # no rigid modes
        self._at, self._steps = np.nan, (np.empty(0, complex),) * 3

    def steps(self, omega: float) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """A⁻¹A', A⁻¹ and A⁻¹M; of a diagonal the diagonals."""
        if omega != self._at:
            if self.D.ndim == 1:
                with np.errstate(divide="ignore", invalid="ignore"):
                    lossy = self.K + 1j * self.S
                    inverse = 1 / (lossy + 1j * omega * self.D - omega**2 * self.M)
                    self._steps = (
                        (1j * self.D - 2 * omega * self.M) * inverse,
                        inverse,
                        self.M * inverse,
                    )
            else:
                damped = 1j * (omega * self.D + self.S)
                inverse = np.linalg.inv(np.diag(self.K - omega**2 * self.M) + damped)
                self._steps = (
                    inverse @ (1j * self.D - 2 * omega * np.diag(self.M)),
                    inverse,
                    inverse * self.M,
                )
            self._at = omega
        return self._steps

    def reach(self, omega: float, h: float) -> float:
        """‖A⁻¹(ω) (A(ω + t h) - A(ω))‖ at most, |t| <= 1."""
        step, _, curve = self.steps(omega)
        return h * _norm(step) + h * h * _norm(curve)

    def response(self, omega: float, h: float, loads: ComplexArray) -> Series:
        """A⁻¹ times loads (3, n, columns), a polynomial of t."""
        step, inverse, curve = self.steps(omega)

        def apply(matrix: ComplexArray, x: ComplexArray) -> ComplexArray:
            return matrix[:, None] * x if matrix.ndim == 1 else matrix @ x

        if not h:
            return Series(apply(inverse, loads[0])[None], np.zeros(loads.shape[1:]))
        x = np.zeros((DEGREE + 3, *loads.shape[1:]), dtype=complex)
        step, curve = h * step, h * h * curve
        for k in range(DEGREE + 3):
            if k < 3:
                x[k] += apply(inverse, loads[k])
            if 0 < k <= DEGREE + 1:
                x[k] -= apply(step, x[k - 1])
            if k > 1:
                x[k] += apply(curve, x[k - 2])
        # The last two are what the series leaves of the equation, once A(ω)⁻¹ is applied.
        left = np.linalg.norm(x[DEGREE + 1], axis=0) + np.linalg.norm(x[DEGREE + 2], axis=0)
        tail = left / (1 - self.reach(omega, h))
        return Series(x[: DEGREE + 1], np.tile(tail, (loads.shape[1], 1)))


def about(omega: float, h: float, coefficients: Sequence[NDArray[Any]]) -> ComplexArray:
    """Σ coefficients[k] (ω + t h)^k as a polynomial of t."""
    a, b, c = (np.asarray(x, dtype=complex) for x in coefficients)
    return np.array([a + omega * b + omega**2 * c, h * (b + 2 * omega * c), h * h * c])
