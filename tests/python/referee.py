"""What a certificate is judged by: extended precision, at frequencies chosen against it.

Nothing here comes from the program under test: H of the full and of the reduced matrices is solved
in double and refined with residuals in long double until it stands still, where that seems to break
a claim once more with eighty digits, and the frequencies are
those where a bound is most likely to fail: zeros of H, poles of either model and their flanks,
local maxima of the error itself, ends of the bands, and random ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

TWO_PI = 2 * np.pi
LONG = np.longdouble


def _prony(i: Any, w: Any, g: Any, tau: Any) -> Any:
    z = [i * w * t for t in tau]
    return sum(share * x / (1 + x) for share, x in zip(g, z, strict=True))


def _table(i: Any, w: Any, omega: Any, storage: Any, loss: Any) -> Any:
    one = 1 + 0 * w
    k = min(max(int(np.searchsorted(omega, float(w), "right")) - 1, 0), len(omega) - 2)
    t = (w - one * omega[k]) / (one * omega[k + 1] - one * omega[k])
    return sum(
        f * ((1 - t) * (one * y[k]) + t * (one * y[k + 1])) for f, y in ((1, storage), (i, loss))
    )


def _parameter(i: Any, w: Any, p: Any, least: Any, slope: Any, loss: Any, beta: Any) -> Any:
    one = 1 + 0 * w
    return slope * (one * p - one * least) * (1 + i * (loss + beta * w))


def _product(i: Any, w: Any, p: Any, slope: Any, law: str, *numbers: Any) -> Any:
    one = 1 + 0 * w
    return one * p * (one * slope) * _LAWS[law](i, w, *numbers)


def _spin(i: Any, w: Any, speed: Any, least: Any, power: int) -> Any:
    one = 1 + 0 * w
    return (one * speed) ** power - (one * least) ** power


def _coriolis(i: Any, w: Any, speed: Any) -> Any:
    return i * w * speed


_LAWS = {
    "prony": _prony,
    "table": _table,
    "parameter": _parameter,
    "product": _product,
    "viscous": lambda i, w: i * w,
    "structural": lambda i, w: i + 0 * w,
    "spin": _spin,
    "coriolis": _coriolis,
    "circulatory": lambda i, w: 1 + 0 * w,
}


@dataclass
class System:
    """K, M, D (or none), B, C (or none: Bᵀ) with damping factors; dense or sparse. Dense K and S
    may have the digits of long double."""

    K: Any
    M: Any
    B: Any
    C: Any = None
    D: Any = None
    alpha: float = 0.0
    beta: float = 0.0
    eta: float = 0.0
    rigid: int = 0  #: so many first coordinates are rigid modes, apart from the others
    direct: Any = 0.0  #: what inputs add to outputs at once
    output_beta: Any = 0.0  #: of outputs that are forces of the damped stiffness
    output_eta: Any = 0.0
    S: Any = None  #: the imaginary part of the stiffness
    #: g(ω)T in addition: (T, "prony", g, tau), (T, "table", omega, storage, loss) or
    #: (T, "parameter", p, least, slope, loss, beta), (T, "product", p, slope, law, *numbers),
    #: (T, "spin", speed, least, power),
    #: (T, "coriolis", speed)
    terms: Any = ()

    def __post_init__(self) -> None:
        if self.C is None:
            self.C = self.B.T
        parts = [a for a in (self.K, self.M, self.D, self.S) if a is not None]
        parts += [T for T, *_ in self.terms]
        self._known: dict[float, Any] = {}
        self._sparse = sp.issparse(self.K) and self.K.shape[0] > 300
        if self._sparse:
            self._long = [sp.csr_matrix(a).astype(LONG) for a in parts]
        else:
            parts = [a.toarray() if sp.issparse(a) else np.asarray(a) for a in parts]
            self._long = [a.astype(LONG) for a in parts]
            parts = [a.astype(float) for a in parts]
        self._double = parts

    def transfer(self, omega: float) -> Any:
        """H(omega), (n_out, n_in), as accurate as long double residuals make it; kept."""
        if omega not in self._known:
            self._known[omega] = self._outputs(self._transfer(omega), omega)
        return self._known[omega]

    def _factors_of_terms(self, i: Any, w: Any) -> list[Any]:
        """Of D, S and the others, in the arithmetic of i and w."""
        factors = [f for f, a in ((i * w, self.D), (i, self.S)) if a is not None]
        return factors + [_LAWS[law](i, w, *numbers) for _, law, *numbers in self.terms]

    def _outputs(self, H: Any, omega: float) -> Any:
        """H from C A⁻¹ B."""
        beta, eta = (np.asarray(x, dtype=LONG) for x in (self.output_beta, self.output_eta))
        factors = 1 + np.clongdouble(1j) * (eta + LONG(omega) * beta)
        return factors[..., None] * H + np.asarray(self.direct, dtype=LONG)

    def _transfer(self, omega: float) -> Any:
        w, i = LONG(omega), np.clongdouble(1j)
        k = 1 + i * (LONG(self.eta) + w * LONG(self.beta))
        m = i * w * LONG(self.alpha) - w * w
        factors = [k, m, *self._factors_of_terms(i, w)]
        A = sum(complex(f) * a for f, a in zip(factors, self._double, strict=True))
        if self._sparse:
            lu = splu(
                A.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.01,
                options={"SymmetricMode": True},
            )
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
            # The first solve leaves a share of X, and each later one that share of its step.
            share = min(size, 0.4) if np.isinf(last) else size / last
            if size * share < 1e-20 or share >= 0.5:
                break
            last = size
        return np.asarray(self.C).astype(LONG) @ X

    @property
    def exact_is_cheap(self) -> bool:
        """Whether ``exactly`` takes seconds and not minutes, by the bandwidth."""
        pattern = sp.csr_matrix(sum(abs(sp.csr_matrix(a)) for a in self._double))
        order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        banded = pattern[order][:, order].tocoo()
        width = int(np.abs(banded.row - banded.col).max(initial=0))
        return len(order) * width**2 < 2e6

    @property
    def refinement_is_cheap(self) -> bool:
        """Whether ``refined`` takes some ten seconds, by the entries and inputs."""
        entries = sum(sp.csr_matrix(a).nnz for a in self._double)
        return bool(entries * self.B.shape[1] < 1e6)

    def refined(self, omega: float) -> Any:
        """H(omega) with forty-five digits, rounded to long double: solves in double whose residuals
        have all of these. Beside a sharp resonance a system loses ten digits and more."""
        with mpmath.workdps(45):
            w, i = mpmath.mpf(omega), mpmath.mpc(0, 1)
            factors = [
                1 + i * (mpmath.mpf(self.eta) + w * self.beta),
                i * w * self.alpha - w * w,
                *self._factors_of_terms(i, w),
            ]
            entries: dict[tuple[int, int], Any] = {}
            for factor, part in zip(factors, self._double, strict=True):
                some = sp.coo_matrix(part)
                for r, c, value in zip(some.row, some.col, some.data, strict=True):
                    entries[r, c] = entries.get((r, c), 0) + factor * mpmath.mpf(float(value))
            rows, columns = np.array(list(entries)).T
            n, B, C = self.K.shape[0], np.asarray(self.B), np.asarray(self.C)
            values = [complex(v) for v in entries.values()]
            lu = splu(sp.csc_matrix((values, (rows, columns)), shape=(n, n)))
            H = np.zeros((len(C), B.shape[1]), np.clongdouble)
            for j, load in enumerate(B.T):
                x = [mpmath.mpc(0)] * n
                for _ in range(12):
                    left = [mpmath.mpc(float(b)) for b in load]
                    for (r, c), value in entries.items():
                        left[r] -= value * x[c]
                    step = lu.solve(np.array([complex(r) for r in left]))
                    x = [a + mpmath.mpc(complex(b)) for a, b in zip(x, step, strict=True)]
                    if abs(step).max() < 1e-28 * max(abs(complex(a)) for a in x):
                        break
                else:
                    raise ArithmeticError(f"no solution at {omega} rad/s: doubles are too few")
                for k, row in enumerate(C):
                    some = np.flatnonzero(row)
                    h = sum((mpmath.mpf(float(row[c])) * x[c] for c in some), mpmath.mpc(0))
                    re, im = (LONG(mpmath.nstr(part, 25)) for part in (h.real, h.imag))
                    H[k, j] = re + np.clongdouble(1j) * im
        return self._outputs(H, omega)

    def exactly(self, omega: float) -> Any:
        """H(omega) with eighty digits, rounded to long double: soft and lightly damped systems lose
        more at a resonance than long double has to spare. Elimination without pivoting, for which
        the digits make up."""
        with mpmath.workdps(80):
            w, i = mpmath.mpf(omega), mpmath.mpc(0, 1)
            factors = [
                1 + i * (mpmath.mpf(self.eta) + w * self.beta),
                i * w * self.alpha - w * w,
                *self._factors_of_terms(i, w),
            ]
            parts = [sp.csr_matrix(a) for a in self._double]
            if not self._sparse:  # what doubles leave of them
                more = zip(self._long, self._double, strict=True)
                parts += [sp.csr_matrix((a - b).astype(float)) for a, b in more]
                factors *= 2
            pattern = sum(abs(a) for a in parts)
            order = reverse_cuthill_mckee(sp.csr_matrix(pattern), symmetric_mode=True)
            n, B, C = len(order), np.asarray(self.B)[order], np.asarray(self.C)[:, order]
            rows: list[dict[int, Any]] = [{} for _ in range(n)]
            for factor, part in zip(factors, parts, strict=False):
                some = part[order][:, order].tocoo()
                for r, c, value in zip(some.row, some.col, some.data, strict=True):
                    rows[r][c] = rows[r].get(c, 0) + factor * mpmath.mpf(float(value))
            for r, row in enumerate(rows):  # right-hand sides beside the matrix
                row |= {n + j: mpmath.mpf(float(x)) for j, x in enumerate(B[r]) if x}
            below: list[set[int]] = [set() for _ in range(n)]
            for r, row in enumerate(rows):
                for c in row:
                    if c < r:
                        below[c].add(r)
            for k in range(n):
                pivot = rows[k]
                for r in below[k]:
                    share = rows[r].pop(k) / pivot[k]
                    for c, value in pivot.items():
                        if c > k:
                            rows[r][c] = rows[r].get(c, 0) - share * value
                            if c < r:
                                below[c].add(r)
            X = np.zeros((n, B.shape[1]), object)
            for k in reversed(range(n)):
                for j in range(B.shape[1]):
                    left = rows[k].get(n + j, mpmath.mpf(0))
                    left -= sum((v * X[c, j] for c, v in rows[k].items() if k < c < n), 0)
                    X[k, j] = left / rows[k][k]
            H = [
                [
                    sum(
                        (mpmath.mpf(float(c)) * x for c, x in zip(row, X[:, j], strict=True) if c),
                        0,
                    )
                    for j in range(B.shape[1])
                ]
                for row in C
            ]
            rounded = np.array(
                [
                    [
                        LONG(mpmath.nstr(mpmath.re(h), 25))
                        + np.clongdouble(1j) * LONG(mpmath.nstr(mpmath.im(h), 25))
                        for h in row
                    ]
                    for row in H
                ]
            )
        return self._outputs(rounded, omega)

    def quickly(self, omega: Any) -> Any:
        """H at many frequencies in double, (n, n_out, n_in), by partial fractions: to find where
        to look, not to judge."""
        w = np.asarray(omega, float)[:, None]
        if self.terms:
            sizes = (len(w), np.shape(self.C)[0], np.shape(self.B)[1])
            return np.array([self._roughly(float(x)) for x in w[:, 0]]).reshape(sizes)
        if self.D is None and self.S is None:
            lam, phi, scale = self._modes()
            b, c = phi.T @ self.B, np.asarray(self.C) @ phi
            k = (1 - scale * lam) * (1 + 1j * (self.eta + w * self.beta))
            a = k + lam * (1j * w * self.alpha - w * w)
        elif self.D is None:  # without alpha, beta and eta
            b, c, mu, shift = self._lossy_modes()
            a = 1 - (shift + w * w) * mu
        else:
            c, g, b, shift = self._first_order()
            a = 1 + (1j * w - shift) * g
        residues = (c.T[:, :, None] * b[:, None, :]).reshape(len(b), -1)
        with np.errstate(all="ignore"):
            H = (1 / np.where(a == 0, 1e-30, a)) @ residues
        return np.nan_to_num(H.reshape(len(w), len(c), b.shape[1]), nan=1e30)

    def _roughly(self, omega: float) -> Any:
        k = 1 + 1j * (self.eta + omega * self.beta)
        m = 1j * omega * self.alpha - omega**2
        factors = [k, m, *self._factors_of_terms(1j, omega)]
        A = sum(f * a for f, a in zip(factors, self._double, strict=True))
        with np.errstate(all="ignore"):
            return np.asarray(self.C) @ np.linalg.solve(A, np.asarray(self.B))

    def _lossy_modes(self) -> tuple[Any, Any, Any, float]:
        """M v = μ (K + iS + τM) v with vᵀ(…)v = 1, and the ports in these vectors."""
        if not hasattr(self, "_lossy"):
            K, M, S = self._double
            shift = 1e-3 * float(np.trace(K) / max(np.trace(M), 1e-300))
            E = K + 1j * S + shift * M
            mu, V = sl.eig(M, E)
            V = V / np.sqrt(np.einsum("ij,ij->j", V, E @ V))
            self._lossy = V.T @ np.asarray(self.B), np.asarray(self.C) @ V, mu, shift
        return self._lossy

    def _first_order(self) -> tuple[Any, Any, Any, float]:
        if not hasattr(self, "_pencil"):
            K, M, D = self._double[:3]
            n = len(K)
            if self.S is not None:
                K = K + 1j * self._double[3]
            E, A = np.eye(2 * n), np.zeros((2 * n, 2 * n), K.dtype)
            E[n:, n:] = M
            A[:n, n:], A[n:, :n] = np.eye(n), -K
            A[n:, n:] = -(D + self.alpha * M + self.beta * K)
            shift = float(np.sqrt(abs(np.trace(K.real)) / np.trace(M))) * 0.1
            solved = sl.solve(shift * E - A, np.hstack([E, np.vstack([0 * self.B, self.B])]))
            g, V = sl.eig(solved[:, : 2 * n])
            C = np.hstack([np.asarray(self.C), 0 * np.asarray(self.C)])
            self._pencil = C @ V, g, sl.solve(V, solved[:, 2 * n :].astype(complex)), shift
        return self._pencil

    def _modes(self) -> tuple[Any, Any, float]:
        if not hasattr(self, "_kept"):
            K, M = self._double[:2]
            scale = abs(np.trace(K)) / max(np.trace(M), 1e-300) * 1e-3
            while True:  # K may be indefinite by rounding
                try:
                    mu, phi = sl.eigh(M, K + scale * M)
                    break
                except sl.LinAlgError:
                    scale *= 100
            self._kept = mu, phi, scale
        return self._kept

    def _is_skew_in_part(self) -> bool:
        D = self._double[2]
        return bool(abs(D - D.T).max() > 0)

    def poles(self) -> Any:
        """Undamped eigenfrequencies [rad/s], half their widths, from dense matrices; with a skew
        part of D those of the damped body."""
        if self.D is not None and self._is_skew_in_part():
            _, g, _, shift = self._first_order()
            s = shift + 1 / np.where(g == 0, 1e-300, -g)
            s = s[(s.imag > 0) & np.isfinite(s)]
            return s.imag, abs(s.real)
        mu, phi, scale = self._modes()
        lam = np.maximum(1 / np.maximum(mu, 1e-300) - scale, 0)
        own = [
            np.einsum("ij,ij->j", phi, T @ phi) / np.maximum(mu, 1e-300) for T in self._double[2:]
        ]
        omega = np.sqrt(lam)
        for _ in range(4 if self.terms else 1):  # each mode with the stiffness at its frequency
            g = np.array([self._factors_of_terms(1j, w) for w in omega]).T
            with np.errstate(over="ignore"):  # of massless coordinates
                square = lam + sum((f * a for f, a in zip(g, own, strict=True)), 0)
            omega = np.sqrt(np.maximum(square.real, 0)) if self.terms else omega
        width = self.alpha + self.beta * lam + self.eta * np.sqrt(lam)
        width = width + (square - lam).imag / np.maximum(omega, 1e-150)
        return omega, 0.5 * width


def relative_error(
    full: System,
    reduced: System,
    omega: float,
    relative_to: str = "pointwise",
    exactly: bool = False,
) -> float:
    """‖H − H_r‖_F / ‖H‖_F (eq. 17) in extended precision, perhaps with eighty digits.

    Of a free chain without D ``elastic``: the same of the elastic part of both, what the motion of
    all masses alike leaves; and the error of the rigid part relative to ‖H‖_F if that is larger.
    ``both``: where ‖H‖ is the smaller of the two, relative to that.
    """
    H = full.exactly(omega) if exactly else full.transfer(omega)
    away = H - (reduced.exactly(omega) if exactly else reduced.transfer(omega))
    norm = lambda A: np.sqrt((np.abs(A) ** 2).sum())  # noqa: E731
    if relative_to == "pointwise":
        return float(norm(away) / norm(H)) if norm(H) > 0 else np.inf
    mass = np.asarray(full.M).astype(LONG).sum()
    loads, motion = np.asarray(full.B).sum(axis=0), np.asarray(full.C).sum(axis=1)
    w, i = LONG(omega), np.clongdouble(1j)
    shape = np.outer(motion, loads).astype(
        np.clongdouble
    )  # by a scalar alone NumPy 1 keeps doubles
    rigid = shape / (mass * (i * w * full.alpha - w * w))
    bent = norm(H - rigid)
    r = reduced.rigid
    theirs = System(
        *(a[:r, :r] for a in (reduced.K, reduced.M)),
        reduced.B[:r],
        reduced.C[:, :r],
        None if reduced.D is None else reduced.D[:r, :r],
    )
    rigid_r = theirs.exactly(omega) if exactly else theirs.transfer(omega)
    size = bent if relative_to == "elastic" else min(norm(H), bent)
    return float(max(norm(away - rigid + rigid_r) / size, norm(rigid - rigid_r) / norm(H)))


def inside(omega: Any, bands: Any, excluded: Any) -> Any:
    """Which frequencies lie in a band and in none of the excluded intervals."""
    w = np.asarray(omega)
    good = np.zeros(w.shape, bool)
    for first, last in bands:
        good |= (w >= first) & (w <= last)
    for first, last in excluded:
        good &= ~((w >= first) & (w <= last))
    return good


def suspicious(
    reduced: System, bands: Any, excluded: Any, rng: np.random.Generator, count: int = 12
) -> Any:
    """Frequencies [rad/s] that the reduced model alone gives away, for a full model whose solves
    are dear: its poles in the bands, their flanks, its antiresonances, ends, and random ones."""
    omega, width = reduced.poles()
    near = np.concatenate([omega + s * np.maximum(width, 1e-7 * omega) for s in (-3, -1, 0, 1, 3)])
    fine = np.concatenate([np.linspace(first, last, 4000) for first, last in bands])
    size = np.linalg.norm(reduced.quickly(fine), axis=(1, 2))
    low = np.nonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]))[0] + 1
    zeros = []
    for i in low[np.argsort(size[low])][: count // 2]:
        a, b = fine[i - 1], fine[i + 1]
        for _ in range(5):
            w = np.linspace(a, b, 17)
            best = np.linalg.norm(reduced.quickly(w), axis=(1, 2)).argmin()
            a, b = w[max(best - 1, 0)], w[min(best + 1, 16)]
        zeros.append(0.5 * (a + b))
    near = near[inside(near, bands, excluded)]
    near = rng.choice(near, min(count, len(near)), replace=False)
    rng = np.random.default_rng(5)  # the same for every model of a body: solved once
    spread = np.concatenate([rng.uniform(first, last, count) for first, last in bands])
    found = np.concatenate([near, zeros, np.ravel(bands), spread])
    return np.unique(found[inside(found, bands, excluded)])


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
