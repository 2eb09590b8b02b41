"""Natural frequencies, damping and direction of whirl over the speed of a body that spins."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats, Ints
from flexgram.body.laws import SPEED, Coriolis, Spin
from flexgram.model.system import System


@dataclass(frozen=True)
class CriticalSpeed:
    """A speed at which a natural frequency is a multiple of it.

    Attributes
    ----------
    mode : int
        Column of the diagram.
    order : float
        The multiple; 0: a load that turns with the body.
    speed : float
        [rad/s]
    """

    mode: int
    order: float
    speed: float


@dataclass(frozen=True, eq=False)
class Campbell:
    """A Campbell diagram, of the reduced body.

    Attributes
    ----------
    speeds : (s,) array
        [rad/s], ascending.
    omega : (s, k) array
        Natural frequencies [rad/s]: the imaginary parts of poles. A column follows one mode.
    damping : (s, k) array
        Damping ratios, -Re p/|p| of a pole p; negative where a motion grows.
    whirl : (s, k) array
        From 1 (the points move on circles, forward: in the sense of the spin) over 0 (on lines) to
        -1 (backward).
    turning : bool
        The frequencies are those seen in the frame that turns with the body; else in the frame at
        rest.
    """

    speeds: Floats
    omega: Floats
    damping: Floats
    whirl: Floats
    turning: bool

    def critical(self, orders: Sequence[float] = (1.0,)) -> list[CriticalSpeed]:
        """Speeds at which a natural frequency is ``order`` times the speed, between those of the
        diagram by lines; ascending.

        In the frame at rest an unbalance has order 1. In the frame that turns it has order 0, and
        a load that keeps its direction in space has order 1.
        """
        found = []
        for order in orders:
            # A mode that passes 0 Hz goes on as one of the other direction.
            signed = self.omega if order else self.omega * np.sign(self.whirl)
            for k, gap in enumerate((signed - order * self.speeds[:, None]).T):
                for i in np.flatnonzero(gap[:-1] * gap[1:] < 0):
                    share = gap[i] / (gap[i] - gap[i + 1])
                    step = self.speeds[i + 1] - self.speeds[i]
                    found.append(CriticalSpeed(k, order, float(self.speeds[i] + share * step)))
        return sorted(found, key=lambda one: one.speed)


@dataclass(frozen=True, eq=False)
class _Poles:
    """Of one speed, those with a frequency, ascending."""

    pole: ComplexArray
    shape: ComplexArray  # (m, k), of unit modal mass
    whirl: Floats


def _poles_at(system: System, speed: float, gyroscopic: Floats, sign: float) -> _Poles:
    now = system.at({SPEED: speed})
    if now.terms:
        raise BodyError(
            f"a Campbell diagram needs stiffness that is the same at all frequencies: the body has "
            f"{', '.join(term.name for term in now.terms)}"
        )
    m = now.order
    none, one = np.zeros((m, m)), np.eye(m)
    stiffness = now.complex_stiffness(1.0)  # of vibrations with a positive frequency
    poles, vectors = scipy.linalg.eig(
        np.block([[none, one], [-stiffness, -now.D]]), np.block([[one, none], [none, now.M]])
    )
    finite = np.isfinite(poles)
    largest = np.abs(poles[finite]).max(initial=0)
    kept = np.flatnonzero(finite & (np.where(finite, poles.imag, 0) > 1e-9 * largest))
    kept = kept[np.argsort(poles[kept].imag, kind="stable")]
    shape = vectors[:m, kept]
    shape /= np.sqrt(np.einsum("ik,ij,jk->k", shape.conj(), now.M, shape).real)
    # q^H G q = 4i ∫ρ a·(Re u × Im u): the area that points sweep, and in which sense. On ellipses
    # with half axes a and b |q^T M q| is (a² - b²)/(a² + b²).
    swept = np.einsum("ik,ij,jk->k", shape.conj(), gyroscopic, shape).imag
    flat = np.abs(np.einsum("ik,ij,jk->k", shape, now.M, shape))
    return _Poles(poles[kept], shape, sign * np.sign(swept) * np.sqrt(np.clip(1 - flat**2, 0, 1)))


def campbell(system: System, speeds: ArrayLike | None = None, modes: int | None = None) -> Campbell:
    """The Campbell diagram of a reduced body whose speed is known between two numbers.

    Parameters
    ----------
    system : System
        Of a reduced body with the parameter ``speed``.
    speeds : (s,) array, optional
        [rad/s], ascending; default 61 from the least to the most that the body knows.
    modes : int, optional
        How many of the lowest at the first speed; default all.

    Raises
    ------
    BodyError
        For a body that has no range of speeds, for speeds that it does not know, and for losses
        that have no poles.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> K, M = 4.0 * sp.identity(2).tocsr(), sp.identity(2).tocsr()
    >>> G = sp.csr_matrix([[0.0, -2.0], [2.0, 0.0]])
    >>> terms = {"coriolis": (G, flexgram.coriolis(0, 1)), "spin": (-M, flexgram.spin(0, 1))}
    >>> body = flexgram.Matrices(K, M, np.eye(2), alpha=1e-3, terms=terms)
    >>> rom = flexgram.reduce(body, (0.01, 0.2), order=2)
    >>> campbell(rom.system, [0.0, 1.0]).omega.round(4) # backward, and forward
    array([[2., 2.],
           [3., 1.]])
    """
    if SPEED not in system.parameters:
        raise BodyError(
            "the body has no range of speeds: a mesh gets it from spin: {axis, from, to}, matrices "
            "from terms with flexgram.spin and flexgram.coriolis"
        )
    known = system.parameters[SPEED]
    given = (
        np.linspace(known.least, known.most, 61) if speeds is None else np.asarray(speeds, float)
    )
    if given.ndim != 1 or len(given) < 2 or np.any(np.diff(given) <= 0):
        raise BodyError("speeds must be two or more, ascending")
    turning = any(isinstance(term.law, Spin) for term in system.terms)
    gyroscopic: Floats = sum(
        (term.matrix for term in system.terms if isinstance(term.law, Coriolis)),
        np.zeros_like(system.K),
    )
    # Gyroscopic moments in the frame at rest have the other sign for the same sense.
    sign = 1.0 if turning else -1.0
    at = [_poles_at(system, float(speed), gyroscopic, sign) for speed in given]
    count = min(len(a.pole) for a in at) if modes is None else modes
    count = min(count, *(len(a.pole) for a in at))
    order = np.arange(count)
    rows = [order]
    for before, after in itertools.pairwise(at):
        order = _followed(system.M, before, after, order)
        rows.append(order)
    pole = np.array([a.pole[row] for a, row in zip(at, rows, strict=True)])
    whirl = np.array([a.whirl[row] for a, row in zip(at, rows, strict=True)])
    return Campbell(given, pole.imag.copy(), -pole.real / np.abs(pole), whirl, turning)


def _followed(M: Floats, before: _Poles, after: _Poles, order: Ints) -> Ints:
    """The places of modes at the next speed: those of most alike shapes and frequencies."""
    first, then = before.pole[order].imag[:, None], after.pole.imag[None, :]
    costs = []
    for shape, step in (
        (before.shape[:, order], np.abs(first - then)),
        (before.shape[:, order].conj(), first + then),  # through 0 Hz
    ):
        alike = np.abs(shape.conj().T @ M @ after.shape)
        costs.append(step / np.maximum(first, then) - 0.5 * alike)
    followed: Ints = scipy.optimize.linear_sum_assignment(np.minimum(*costs))[1]
    return followed
