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


def about(omega: float, h: float, coefficients: Sequence[NDArray[Any]]) -> ComplexArray:
    """Σ coefficients[k] (ω + t h)^k as a polynomial of t."""
    a, b, c = (np.asarray(x, dtype=complex) for x in coefficients)
    return np.array([a + omega * b + omega**2 * c, h * (b + 2 * omega * c), h * h * c])
