"""Natural frequencies, damping and direction of whirl over the speed of a body that spins."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Bools, ComplexArray, Floats, Ints
from flexgram.body.varying_laws import SPEED, Coriolis, Spin
from flexgram.model.modes import is_regular
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
        where it does not vibrate (damped beyond ``1 - VIBRATES²/2``, or a motion that grows).
    damping : (s, k) array
        Damping ratios, ``-Re p/|p|`` of a pole p; negative where a motion grows.
    whirl : (s, k) array
        From 1 (the points move on circles, forward: in the sense of the spin) over 0 (on lines) to
        -1 (backward).
    growth : (s,) array
        [1/s] the largest real part of all poles, those without a frequency too: a motion grows
        where it is positive.
    singular : tuple of (int, float)
        Of each speed [rad/s] at which a motion is at 0 Hz, the column that is nearest, and it:
        where the stiffness is singular, whatever the damping; with circulatory forces where a mode
        passes 0 Hz, between the speeds of the diagram by lines.
    unstable : float or None
        [rad/s] the least speed from which on a motion grows.
    turning : bool
        The frequencies are those seen in the frame that turns with the body; else in the frame at
        rest.
    """

    speeds: Floats
    omega: Floats
    damping: Floats
    whirl: Floats
    growth: Floats
    singular: tuple[tuple[int, float], ...]
    unstable: float | None
    turning: bool

    def critical(self, orders: Sequence[float] = (1.0,)) -> list[CriticalSpeed]:
        """Speeds at which a natural frequency is ``order`` times the speed, between those of the
        diagram by lines (of order 0 see ``singular``); ascending.

        In the frame at rest an unbalance has order 1. In the frame that turns it has order 0, and
        a load that keeps its direction in space has order 1.
        """
        found = []
        for order in orders:
            if not order:
                found += [CriticalSpeed(mode, 0.0, speed) for mode, speed in self.singular]
                continue
            for k, omega in enumerate(self.omega.T):
                gap = omega - order * self.speeds
                for i in np.flatnonzero((gap[:-1] != 0) & (gap[:-1] * gap[1:] <= 0)):
                    share = gap[i] / (gap[i] - gap[i + 1])
                    speed = self.speeds[i] + share * (self.speeds[i + 1] - self.speeds[i])
                    found.append(CriticalSpeed(k, order, float(speed)))
        return sorted(found, key=lambda one: one.speed)

    def of_modes(self, columns: ArrayLike) -> Campbell:
        """The diagram of some of its columns.

        Examples
        --------
        >>> lowest = diagram.of_modes([0, 1])  # doctest: +SKIP
        """
        kept = np.asarray(columns, dtype=int)
        omega = self.omega[:, kept]
        return replace(
            self,
            omega=omega,
            damping=self.damping[:, kept],
            whirl=self.whirl[:, kept],
            singular=tuple(
                (_nearest_zero(omega, self.speeds, speed), speed) for _, speed in self.singular
            ),
        )


def _nearest_zero(omega: Floats, speeds: Floats, speed: float) -> int:
    """The column with the least frequency beside a speed, or if none vibrates there anywhere."""
    beside = np.clip(np.searchsorted(speeds, speed) + np.array([-2, -1, 0, 1]), 0, len(speeds) - 1)
    least = np.where(np.isnan(omega), np.inf, omega)
    if not omega.shape[1]:
        return 0
    near = least[beside].min(axis=0)
    return int(np.argmin(near if np.isfinite(near).any() else least.min(axis=0)))


@dataclass(frozen=True, eq=False)
class _Poles:
    """Of one speed, those with a frequency, ascending."""

    pole: ComplexArray
    shape: ComplexArray  # (m, k), of unit modal mass
    whirl: Floats
    growth: float  # of all poles


#: A pole whose imaginary part is a smaller share of its size is real but for rounding, or as good
#: as: such a motion does not vibrate.
VIBRATES = 1e-6


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
    least = np.maximum(1e-9 * largest, VIBRATES * np.abs(np.where(finite, poles, 0)))
    kept = np.flatnonzero(finite & (np.where(finite, poles.imag, 0) > least))
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
    for i in _at_zero(at):
        beside = given[i + 1] if i + 1 < len(given) else given[i - 1]
        moved = float(given[i] + 1e-6 * (beside - given[i]))
        near = _poles_at(system, moved, gyroscopic, sign)
        at[i] = near if len(near.pole) > len(at[i].pole) else at[i]
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

    omega = table(lambda a: a.pole.imag)
    still = _singular(system, given)
    if still is None:  # circulatory forces: by lines
        still = []
        for i, column in np.argwhere(passed):
            own = [at[j].pole.imag[rows[j, column]] for j in (i, i + 1)]
            still.append(float(given[i] + own[0] / sum(own) * (given[i + 1] - given[i])))
    growth = np.array([a.growth for a in at])

    negligible = 1e-9 * float(np.nanmax(omega, initial=0.0))

    def grows(speed: float) -> float:
        return _poles_at(system, speed, gyroscopic, sign).growth - negligible

    unstable = None
    if len(growing := np.flatnonzero(growth > negligible)):
        i = int(growing[0])
        unstable = float(given[i])
        if i > 0 and grows(given[i - 1]) < 0 < grows(unstable):
            ends = float(given[i - 1]), unstable
            unstable = float(scipy.optimize.brentq(grows, *ends, xtol=1e-7 * given[-1]))
    return Campbell(
        given,
        omega,
        table(lambda a: -a.pole.real / np.abs(a.pole)),
        table(lambda a: a.whirl),
        growth,
        tuple((_nearest_zero(omega, given, x), x) for x in still),
        unstable,
        turning,
    )


def _static(system: System, speed: float) -> Floats:
    """The stiffness at a speed, without losses, over M where that has an inverse; (m, m)."""
    stiffness: Floats = system.at({SPEED: speed}).in_time().complex_stiffness(0.0).real
    if not is_regular(system.M):
        return stiffness  # the signs of its eigenvalues are the same
    L = np.linalg.cholesky(system.M)
    half = scipy.linalg.solve_triangular(L, stiffness, lower=True)
    whole: Floats = scipy.linalg.solve_triangular(L, half.T, lower=True).T
    return whole


def _at_zero(at: Sequence[_Poles]) -> list[int]:
    """Speeds at which fewer modes vibrate than at those beside: one meets 0 Hz just there."""
    count = [len(a.pole) for a in at]
    beside = [
        count[1],
        *(min(count[i - 1], count[i + 1]) for i in range(1, len(at) - 1)),
        count[-2],
    ]
    return [i for i in range(len(at)) if count[i] < beside[i]]


def _singular(system: System, speeds: Floats) -> list[float] | None:
    """Speeds at which an eigenvalue of the stiffness changes its sign: there it has a null vector,
    and a pole is zero with any D. None of a stiffness that is not symmetric, where poles are not
    zero."""
    stiffness = [_static(system, float(speed)) for speed in speeds]
    if any(np.abs(a - a.T).max() > 1e-9 * np.abs(a).max() for a in stiffness):
        return None

    def eigenvalues(speed: float) -> Floats:
        return np.linalg.eigvalsh(_static(system, speed))

    at = np.array([np.linalg.eigvalsh(a) for a in stiffness])
    signs = np.where(np.abs(at) > 1e-12 * np.abs(at).max(), np.sign(at), 0)
    found: list[float] = []
    for k, own in enumerate(signs.T):
        told = np.flatnonzero(own)  # zeros: rigid motions, and a speed that meets one exactly
        for i, j in itertools.pairwise(told):
            if own[i] != own[j]:
                ends = float(speeds[i]), float(speeds[j])
                found.append(scipy.optimize.brentq(lambda x, k=k: eigenvalues(x)[k], *ends))
    apart = 1e-6 * float(np.abs(speeds).max())  # two eigenvalues of a body with equal stiffness
    found.sort()
    return [x for n, x in enumerate(found) if n == 0 or x - found[n - 1] > apart]


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
