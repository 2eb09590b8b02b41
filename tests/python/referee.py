"""What a certificate is judged by: responses in extended precision, at frequencies chosen against it.

Nothing here comes from the program under test: H of the full and of the reduced matrices is solved
in double and refined with residuals in long double until it stands still, and the frequencies are
those where a bound is most likely to fail: zeros of H, poles of either model and their flanks,
local maxima of the error itself, ends of the bands, and random ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from scipy.sparse.linalg import splu

TWO_PI = 2 * np.pi
LONG = np.longdouble


@dataclass
class System:
    """K, M, D (or none), B, C (or none: Bᵀ) with damping factors; dense or sparse."""

    K: Any
    M: Any
    B: Any
    C: Any = None
    D: Any = None
    alpha: float = 0.0
    beta: float = 0.0
    eta: float = 0.0

    def __post_init__(self) -> None:
        if self.C is None:
            self.C = self.B.T
        parts = [self.K, self.M] + ([] if self.D is None else [self.D])
        self._sparse = sp.issparse(self.K) and self.K.shape[0] > 300
        if self._sparse:
            self._long = [_LongSparse(a) for a in parts]
        else:
            parts = [a.toarray() if sp.issparse(a) else np.asarray(a) for a in parts]
            self._long = [a.astype(LONG) for a in parts]
        self._double = parts

    def transfer(self, omega: float) -> Any:
        """H(omega), (n_out, n_in), as accurate as long double residuals make it."""
        w, i = LONG(omega), np.clongdouble(1j)
        k = 1 + i * (LONG(self.eta) + w * LONG(self.beta))
        m = i * w * LONG(self.alpha) - w * w
        factors = [k, m, i * w][: len(self._double)]
        A = sum(complex(f) * a for f, a in zip(factors, self._double, strict=True))
        if self._sparse:
            lu = splu(A.tocsc())
            solve: Callable[[Any], Any] = lambda r: lu.solve(r)  # noqa: E731
        else:
            pivots = sl.lu_factor(A, check_finite=False)
            solve = lambda r: sl.lu_solve(pivots, r, check_finite=False)  # noqa: E731
        B = np.asarray(self.B)
        X = solve(B.astype(complex)).astype(np.clongdouble)
        last = np.inf
        for _ in range(20):
            R = B - sum(f * (a @ X) for f, a in zip(factors, self._long, strict=True))
            step = solve(R.astype(complex))
            X = X + step
            size = np.linalg.norm(step) / np.linalg.norm(X.astype(complex))
            if size < 1e-18 or size >= 0.5 * last:
                break
            last = size
        return np.asarray(self.C).astype(LONG) @ X

    def quickly(self, omega: Any) -> Any:
        """H at many frequencies in double, (n, n_out, n_in): to find where to look."""
        if self.D is None and not self._sparse:
            lam, phi, scale = self._modes()
            b, c = phi.T @ self.B, np.asarray(self.C) @ phi
            w = np.asarray(omega)[:, None]
            k = (1 - scale * lam) * (1 + 1j * (self.eta + w * self.beta))
            a = k + lam * (1j * w * self.alpha - w * w)
            return np.einsum("oj,wj,ji->woi", c, 1 / np.where(a == 0, 1e-300, a), b, optimize=True)
        return np.array([self.transfer(w).astype(complex) for w in omega])

    def _modes(self) -> tuple[Any, Any, float]:
        if not hasattr(self, "_kept"):
            K, M = self._double[:2]
            scale = np.trace(K) / max(np.trace(M), 1e-300) * 1e-3
            mu, phi = sl.eigh(M, K + scale * M)
            self._kept = mu, phi, scale
        return self._kept

    def poles(self) -> Any:
        """Undamped eigenfrequencies [rad/s] with half their widths, from dense matrices."""
        mu, phi, scale = self._modes()
        lam = np.maximum(1 / np.maximum(mu, 1e-300) - scale, 0)
        width = self.alpha + self.beta * lam + self.eta * np.sqrt(lam)
        if self.D is not None:
            width = width + np.einsum("ij,ij->j", phi, self._double[2] @ phi) / np.maximum(mu, 1e-300)
        return np.sqrt(lam), 0.5 * width


class _LongSparse:
    """A sparse matrix times long double columns."""

    def __init__(self, matrix: Any) -> None:
        self.csr = sp.csr_matrix(matrix)
        self.csr.sum_duplicates()
        self.data = self.csr.data.astype(LONG)
        self.full = np.diff(self.csr.indptr) > 0

    def __matmul__(self, x: Any) -> Any:
        y = np.zeros((self.csr.shape[0], x.shape[1]), np.clongdouble)
        starts = self.csr.indptr[:-1][self.full]
        for j in range(x.shape[1]):
            y[self.full, j] = np.add.reduceat(self.data * x[self.csr.indices, j], starts)
        return y


def relative_error(full: System, reduced: System, omega: float) -> float:
    """‖H − H_r‖_F / ‖H‖_F (eq. 17) in extended precision."""
    H = full.transfer(omega)
    away = H - reduced.transfer(omega)
    size = np.sqrt((np.abs(H) ** 2).sum())
    return float(np.sqrt((np.abs(away) ** 2).sum()) / size) if size > 0 else np.inf


def inside(omega: Any, bands: Any, excluded: Any) -> Any:
    """Which frequencies lie in a band and in none of the excluded intervals."""
    w = np.asarray(omega)
    good = np.zeros(w.shape, bool)
    for first, last in bands:
        good |= (w >= first) & (w <= last)
    for first, last in excluded:
        good &= ~((w >= first) & (w <= last))
    return good


def hard_frequencies(
    full: System,
    reduced: System,
    bands: Any,
    excluded: Any,
    rng: np.random.Generator,
    count: int = 2000,
) -> Any:
    """Frequencies [rad/s] at which a bound of the error is most likely to fail."""
    found: list[Any] = [rng.uniform(first, last, 12) for first, last in bands]
    found.append(np.ravel(bands))
    if len(excluded):
        found.append(np.ravel(excluded) * np.tile([1 - 1e-13, 1 + 1e-13], len(excluded)))
    offsets = np.array([0, 0.3, 1, 3, 10])
    fine: list[Any] = []
    for model in (full, reduced):
        if model._sparse:
            continue
        omega, width = model.poles()
        for scale in (width, 1e-7 * omega, 1e-5 * omega, 1e-3 * omega):
            for sign in (-1, 1):
                fine.append((omega[:, None] + sign * scale[:, None] * offsets).ravel())
    for first, last in bands:
        fine.append(np.linspace(first, last, count))
        if first > 0:
            fine.append(np.geomspace(first, last, count // 4))
    grid = np.unique(np.concatenate(fine))
    grid = grid[inside(grid, bands, excluded)]
    if len(grid) == 0:
        return np.concatenate(found)

    def measures(w: Any) -> tuple[Any, Any]:
        H, H_r = full.quickly(w), reduced.quickly(w)
        size = np.linalg.norm(H, axis=(1, 2))
        return size, np.linalg.norm(H - H_r, axis=(1, 2)) / np.maximum(size, 1e-300)

    size, error = measures(grid)
    for value in (size, -error):  # minima of |H|, maxima of the error
        low = np.nonzero((value[1:-1] <= value[:-2]) & (value[1:-1] <= value[2:]))[0] + 1
        low = low[np.argsort(value[low])][:25]
        a, b = grid[low - 1], grid[low + 1]
        which = 0 if value is size else 1
        for _ in range(4):  # a finer grid around each, four times
            w = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, 17)
            m = measures(w.ravel())[which].reshape(w.shape)
            best = (m if which == 0 else -m).argmin(axis=1)
            rows = np.arange(len(low))
            a, b = w[rows, np.maximum(best - 1, 0)], w[rows, np.minimum(best + 1, 16)]
            found.append(w[rows, best])
    worst = np.argsort(-error)[:10]
    found.append(grid[worst])
    result = np.unique(np.concatenate(found))
    return result[inside(result, bands, excluded)]
