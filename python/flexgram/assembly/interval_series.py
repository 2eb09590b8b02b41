"""Responses in modal coordinates over whole intervals of the frequency.

A response is a power series about the middle of an interval, up to a tail that Neumann's series
bounds; pieces of the interval take the values in their middles and how far these move at most.

Many intervals are looked at together: the first axis of each array is theirs, of length m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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

    def __init__(self, h: Floats) -> None:
        """Half widths (m,) of intervals, or zeros, of points."""
        wide = bool(h.any())
        self.count = PIECES if wide else 1
        self.half = 1 / self.count if wide else 0.0
        self.middles = (
            self.half - 1 + 2 * self.half * np.arange(self.count) if wide else np.zeros(1)
        )
        k = np.arange(DEGREE + 3)
        far = np.abs(self.middles)[:, None]
        self.powers = self.middles[:, None] ** k
        self.moved = (far + self.half) ** k - far**k  # |t^k - middle^k| at most


@dataclass
class Series:
    """A matrix over ω + t h, |t| <= 1: Σ coefficients[:, k] t^k, each entry off by `tail` at most.

    Attributes
    ----------
    coefficients : (m, d + 1, rows, columns) array
        One at a point, h = 0.
    tail : (m, rows, columns) array
    """

    coefficients: ComplexArray
    tail: Floats

    def between(self, left: Floats, right: Floats) -> Series:
        return Series(left @ self.coefficients @ right, np.abs(left) @ self.tail @ np.abs(right))

    def times(self, polynomial: ComplexArray) -> Series:
        """A polynomial (m, 3, rows', rows) times this, or one of numbers, (m, 3)."""
        if polynomial.ndim == 2:
            return self._times(polynomial[:, :, None, None], np.multiply)
        return self._times(polynomial, np.matmul)

    def _times(self, polynomial: ComplexArray, product: Callable[..., Any]) -> Series:
        if self.coefficients.shape[1] == 1:
            constant = polynomial[:, 0]
            return Series(
                product(constant[:, None], self.coefficients), product(np.abs(constant), self.tail)
            )
        d = self.coefficients.shape[1]
        terms = [product(polynomial[:, k, None], self.coefficients) for k in range(3)]
        whole = np.zeros((len(terms[0]), d + 2, *terms[0].shape[2:]), dtype=complex)
        for k, term in enumerate(terms):
            whole[:, k : k + d] += term
        tails = (product(np.abs(polynomial[:, k]), self.tail) for k in range(3))
        return Series(whole, sum(tails, np.zeros(whole.shape[2:])))

    def behind(self, left: Floats) -> Series:
        """left times this. Real numbers meet complex ones as pairs of real ones."""
        pairs = np.ascontiguousarray(self.coefficients).view(np.float64)
        return Series((left @ pairs).view(np.complex128), np.abs(left) @ self.tail)

    def plus(self, polynomial: ComplexArray | Floats) -> Series:
        """With a polynomial (m, 3, rows, columns) or a constant (rows, columns) added to it."""
        added = self.coefficients.copy()
        if polynomial.ndim == 2:
            added[:, 0] += polynomial
        else:
            added[:, :3] += polynomial[:, : added.shape[1]]
        return Series(added, self.tail)

    def scaled(self, *, rows: Floats | None = None, columns: Floats | None = None) -> Series:
        """Rows and columns times positive factors (m, rows) and (m, columns)."""
        factor = np.ones((1, 1, 1))
        if rows is not None:
            factor = factor * rows[:, :, None]
        if columns is not None:
            factor = factor * columns[:, None, :]
        return Series(self.coefficients * factor[:, None], self.tail * factor)

    def transposed(self) -> Series:
        return Series(self.coefficients.transpose(0, 1, 3, 2), self.tail.transpose(0, 2, 1))

    def part(self, rows: Chosen, columns: Chosen) -> Series:
        return Series(self.coefficients[:, :, rows][..., columns], self.tail[:, rows][..., columns])

    def in_middles(self, at: Pieces) -> ComplexArray:
        """(m, pieces, rows, columns)"""
        m, d, rows, columns = self.coefficients.shape
        values: ComplexArray = at.powers[:, :d] @ self.coefficients.reshape(m, d, rows * columns)
        return values.reshape(m, at.count, rows, columns)

    def norms(self, at: Pieces, order: Literal[2, "fro"]) -> tuple[Floats, Floats]:
        """Norms in the middles of the pieces, and how far they are off in each at most, (m, pieces)
        each."""
        sizes = np.linalg.norm(self.coefficients, axis=(2, 3))
        away = sizes @ at.moved[:, : sizes.shape[1]].T
        return (
            np.linalg.norm(self.in_middles(at), order, axis=(2, 3)),
            away + np.linalg.norm(self.tail, axis=(1, 2))[:, None],
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

    def largest(self, last: float | Floats) -> Floats:
        """The sizes of the factors up to frequencies, (…, outputs)."""
        sizes: Floats = np.hypot(1, self.eta + np.multiply.outer(last, self.beta))
        return sizes

    def at(self, H: ComplexArray, omega: float) -> ComplexArray:
        """H from C A⁻¹ B at a frequency."""
        whole: ComplexArray = (1 + 1j * (self.eta + omega * self.beta))[:, None] * H + self.direct
        return whole

    def over(self, H: Series, omega: Floats, h: Floats) -> Series:
        """The same over intervals."""
        if self.are_plain:
            return H
        factors = np.diag(1 + 1j * self.eta), 1j * np.diag(self.beta), 0j * np.diag(self.beta)
        a, b, c = (factor[None] for factor in factors)
        return H.times(about(omega, h, a, b, c)).plus(self.direct)


def about(
    omega: Floats, h: Floats, a: ComplexArray, b: ComplexArray, c: ComplexArray
) -> ComplexArray:
    """a + b (ω + t h) + c (ω + t h)², with a, b and c of each interval or of all, (m or 1, …), as
    polynomials of t, (m, 3, …)."""
    w, r = (x.reshape(-1, *(1,) * (a.ndim - 1)) for x in (omega, h))
    return np.stack([a + w * b + w * w * c, r * (b + 2 * w * c), r * r * c + 0 * a], axis=1)


def block_diag(blocks: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Of stacks (…, rows, columns) of matrices one of block diagonal matrices."""
    rows, columns = (sum(block.shape[k] for block in blocks) for k in (-2, -1))
    whole = np.zeros((*blocks[0].shape[:-2], rows, columns), dtype=blocks[0].dtype)
    row = column = 0
    for block in blocks:
        next_row, next_column = row + block.shape[-2], column + block.shape[-1]
        whole[..., row:next_row, column:next_column] = block
        row, column = next_row, next_column
    return whole
