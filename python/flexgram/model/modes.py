"""Natural modes of small systems whose mass matrix may be singular."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexgram.basics import BodyError, Floats

#: A mode of λ is without mass where τ/(λ + τ) is below this: rounding of M is larger.
MASSLESS = 1e-13
#: Above this times τ the largest λ blurs the low ones where the pencil (K, M) is solved as it is.
LIGHT = 1e8


def is_regular(M: Floats) -> bool:
    """Whether every direction has mass that rounding does not blur."""
    largest = float(np.abs(M).max(initial=0))
    if not largest > 0 or np.any(np.diag(M) <= 0):
        return len(M) == 0
    scale = 1 / np.sqrt(np.diag(M))
    return float(np.linalg.eigvalsh(scale[:, None] * M * scale)[0]) > MASSLESS * len(M)


def natural_modes(K: Floats, M: Floats) -> tuple[Floats, Floats]:
    """Squares λ [rad²/s²] of the natural frequencies, ascending, and the modes (m, m).

    M may be singular, exactly or to rounding (scalar points, rotations without inertia): directions
    without mass come last, with λ infinite and a mode of unit stiffness; all others have unit
    mass. There, and where a mass is very small, the modes are those of M v = μ (K + τM) v,
    λ = 1/μ - τ, in which large λ do not blur small ones.

    Parameters
    ----------
    K, M : (m, m) arrays
        Symmetric, M positive semidefinite, without a common null vector. K may have negative
        eigenvalues, as of a body that spins beyond its critical speed; then some λ are negative.

    Raises
    ------
    BodyError
        If K is negative in a direction without mass.
    """
    K, M = 0.5 * (K + K.T), 0.5 * (M + M.T)
    k, m = np.diag(K), np.diag(M)
    both = (k > 0) & (m > 1e-14 * m.max(initial=0))
    tau = float(np.median(k[both] / m[both])) if both.any() else 1.0
    if is_regular(M):
        squares, modes = scipy.linalg.eigh(K, M)
        if not len(squares) or squares[-1] < LIGHT * tau:
            return squares, modes
    for _ in range(30):
        try:
            mass, modes = scipy.linalg.eigh(M, K + tau * M)
            break
        except np.linalg.LinAlgError:  # K + τM is not positive
            tau *= 10
    else:
        raise BodyError("K is negative in a direction without mass: the body has no modes")
    mass, modes = mass[::-1], modes[:, ::-1]
    light = mass * tau < MASSLESS
    size = np.where(light, 1.0, np.sqrt(np.where(light, 1.0, mass)))
    squares = np.where(light, np.inf, 1 / np.where(light, 1.0, mass) - tau)
    return squares, modes / size


def massless(K: Floats, M: Floats) -> int:
    """How many directions have no mass, to rounding of M beside K."""
    return int(np.isinf(natural_modes(K, M)[0]).sum())
