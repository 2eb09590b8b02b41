"""Linear systems in frequency and time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError, ComplexArray, Floats


def frequency_response(
    K: NDArray[np.generic] | Callable[[float], ComplexArray],
    D: Floats,
    M: Floats,
    B: Floats,
    C: Floats,
    omega: ArrayLike,
) -> ComplexArray:
    """C (K + i omega D - omega² M)⁻¹ B, (n_out, n_in), of several frequencies (n, n_out, n_in); K
    may depend on the frequency."""
    w = np.atleast_1d(np.asarray(omega, dtype=float))
    H: ComplexArray = np.array(
        [C @ np.linalg.solve((K(x) if callable(K) else K) + 1j * x * D - x * x * M, B) for x in w],
        dtype=np.complex128,
    )
    one: ComplexArray = H[0] if np.ndim(omega) == 0 else H
    return one


def expect_collocated(port: str, row: Floats, column: Floats) -> None:
    """Raise BodyError where a row of C is not the column of B of the same name."""
    if np.abs(row - column).max() > 1e-12 * np.abs(row).max():
        raise BodyError(f"{port}: what the output measures is not what the input drives")


def linear_response(A: Floats, B: Floats, start: Floats, u: Floats, step: float) -> Floats:
    """Solution of x' = A x + B u, exact for inputs that are linear between the times.

    Parameters
    ----------
    A, B : (n, n), (n, p) arrays
    start : (n,) array
        x at the first time.
    u : (n_t, p) array
        Inputs at evenly spaced times.
    step : float
        Between these [s].

    Returns
    -------
    (n_t, n) array
    """
    n, p = B.shape
    # exp of [[A, B, 0], [0, 0, I/h], [0, 0, 0]] h: x⁺ = Φ x + Γ_0 u + Γ_1 (u⁺ - u)
    generator = np.zeros((n + 2 * p, n + 2 * p))
    generator[:n, :n], generator[:n, n : n + p] = A * step, B * step
    generator[n : n + p, n + p :] = np.eye(p)
    power = scipy.linalg.expm(generator)
    Phi, G0, G1 = power[:n, :n], power[:n, n : n + p], power[:n, n + p :]
    x = np.empty((len(u), n))
    x[0] = start
    for k in range(len(u) - 1):
        x[k + 1] = Phi @ x[k] + G0 @ u[k] + G1 @ (u[k + 1] - u[k])
    return x
