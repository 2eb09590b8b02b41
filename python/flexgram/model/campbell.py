"""Natural frequencies, damping and direction of whirl over the speed of a body that spins."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Bools, ComplexArray, Floats, Ints
from flexgram.body.varying_laws import SPEED, Coriolis, Spin
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
        Natural frequencies [rad/s]: the imaginary parts of poles. A column follows one mode; NaN
        where it does not vibrate.
    damping : (s, k) array
        Damping ratios, ``-Re p/|p|`` of a pole p; negative where a motion grows.
    whirl : (s, k) array
        From 1 (the points move on circles, forward: in the sense of the spin) over 0 (on lines) to
        -1 (backward).
    growth : (s,) array
        [1/s] the largest real part of all poles, those without a frequency too: a motion grows
        where it is positive.
    passed : (s - 1, k) array of bool
        Whether a mode went through 0 Hz between two speeds.
    turning : bool
        The frequencies are those seen in the frame that turns with the body; else in the frame at
        rest.
    """

    speeds: Floats
    omega: Floats
    damping: Floats
    whirl: Floats
    growth: Floats
    passed: Bools
    turning: bool

    def critical(self, orders: Sequence[float] = (1.0,)) -> list[CriticalSpeed]:
        """Speeds at which a natural frequency is ``order`` times the speed, between those of the
        diagram by lines; ascending.

        In the frame at rest an unbalance has order 1. In the frame that turns it has order 0, and
        a load that keeps its direction in space has order 1.
        """
        found = []
        for order in orders:
            for k, omega in enumerate(self.omega.T):
                if not order:
                    found += [CriticalSpeed(k, 0.0, x) for x in self._through_zero(k)]
                    continue
                gap = omega - order * self.speeds
                for i in np.flatnonzero((gap[:-1] != 0) & (gap[:-1] * gap[1:] <= 0)):
                    speed = self._between(i, gap[i] / (gap[i] - gap[i + 1]))
                    found.append(CriticalSpeed(k, order, speed))
        return sorted(found, key=lambda one: one.speed)

    def _between(self, i: int, share: float) -> float:
        return float(self.speeds[i] + share * (self.speeds[i + 1] - self.speeds[i]))

    def _through_zero(self, k: int) -> list[float]:
        """Where a mode comes out on the other side, and where it ceases to vibrate: there ω² goes
        to zero like a line."""
        omega, found = self.omega[:, k], []
        for i in range(len(omega) - 1):
            if self.passed[i, k]:
                found.append(self._between(i, omega[i] / (omega[i] + omega[i + 1])))
            elif i > 0 and np.isnan(omega[i + 1]) and omega[i] < omega[i - 1]:
                step = self.speeds[i] - self.speeds[i - 1]
                ahead = step * omega[i] ** 2 / (omega[i - 1] ** 2 - omega[i] ** 2)
                if ahead <= 2 * (self.speeds[i + 1] - self.speeds[i]):
                    found.append(float(self.speeds[i] + ahead))
        return found


@dataclass(frozen=True, eq=False)
class _Poles:
    """Of one speed, those with a frequency, ascending."""

    pole: ComplexArray
    shape: ComplexArray  # (m, k), of unit modal mass
    whirl: Floats
    growth: float  # of all poles


def _poles_at(system: System, speed: float, gyroscopic: Floats, sign: float) -> _Poles:
    now = system.at({SPEED: speed}).in_time()
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
    # q^H G q = -4i ∫ρ a·(Re u × Im u): the area that points sweep, and in which sense. On ellipses
    # with half axes a and b |q^T M q| is (a² - b²)/(a² + b²).
    swept = np.einsum("ik,ij,jk->k", shape.conj(), gyroscopic, shape).imag
    flat = np.abs(np.einsum("ik,ij,jk->k", shape, now.M, shape))
    whirl = sign * np.sign(swept) * np.sqrt(np.clip(1 - flat**2, 0, 1))
    upper = finite & (np.where(finite, poles.imag, -1) >= -1e-9 * largest)
    return _Poles(poles[kept], shape, whirl, float(poles.real[upper].max(initial=-np.inf)))


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
    turning = any(
        isinstance(term.law, Spin) and not term.name.endswith("_at_rest") for term in system.terms
    )
    gyroscopic: Floats = sum(
        (term.matrix for term in system.terms if isinstance(term.law, Coriolis)),
        np.zeros_like(system.K),
    )
    # Gyroscopic moments in the frame at rest have the other sign for the same sense.
    sign = 1.0 if turning else -1.0
    at = [_poles_at(system, float(speed), gyroscopic, sign) for speed in given]
    rows, passed = _followed(system.M, given, at)
    columns = np.arange(rows.shape[1])
    if modes is not None:
        first = np.array([a.pole.imag[row] if row >= 0 else np.inf for a, row in _firsts(at, rows)])
        columns = np.sort(np.argsort(first, kind="stable")[:modes])

    def table(of: Callable[[_Poles], Floats]) -> Floats:
        values = np.full((len(at), len(columns)), np.nan)
        for i, a in enumerate(at):
            row = rows[i, columns]
            values[i, row >= 0] = of(a)[row[row >= 0]]
        return values

    return Campbell(
        given,
        table(lambda a: a.pole.imag),
        table(lambda a: -a.pole.real / np.abs(a.pole)),
        table(lambda a: a.whirl),
        np.array([a.growth for a in at]),
        passed[:, columns],
        turning,
    )


def _firsts(at: Sequence[_Poles], rows: Ints) -> list[tuple[_Poles, int]]:
    """Of each column the first speed at which it vibrates, and its place there."""
    found = []
    for column in rows.T:
        i = int(np.argmax(column >= 0))
        found.append((at[i], int(column[i])))
    return found


def _followed(M: Floats, speeds: Floats, at: Sequence[_Poles]) -> tuple[Ints, Bools]:
    """The place of each mode among the poles of each speed, (s, k), -1 where it does not vibrate,
    and whether it went through 0 Hz since the one before: those of most alike shapes and
    frequencies."""
    count = max(len(a.pole) for a in at)
    rows = np.full((len(at), count), -1)
    rows[0, : len(at[0].pole)] = np.arange(len(at[0].pole))
    passed = np.zeros((len(at) - 1, count), dtype=bool)
    for i, (before, after) in enumerate(itertools.pairwise(at)):
        known = np.flatnonzero(rows[i] >= 0)
        shape = before.shape[:, rows[i, known]]
        first, then = before.pole[rows[i, known]].imag[:, None], after.pole.imag[None, :]
        costs, turned = [], 2 * (speeds[i + 1] - speeds[i])  # frequencies move no faster
        for side, step in ((shape, np.abs(first - then)), (shape.conj(), first + then)):
            alike = np.abs(side.conj().T @ M @ after.shape)
            costs.append(step / np.maximum(np.maximum(first, then), turned) - alike)
        mode, place = scipy.optimize.linear_sum_assignment(np.minimum(*costs))
        rows[i + 1, known[mode]] = place
        passed[i, known[mode]] = (costs[1] < costs[0])[mode, place]
        others = np.setdiff1d(np.arange(len(after.pole)), place)
        rows[i + 1, np.flatnonzero(rows[i + 1] < 0)[: len(others)]] = others
    return rows, passed
