"""A bound of an assembly's error everywhere in a band, by halving intervals."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexgram.assembly.interval_series import DEGREE, PIECES
from flexgram.assembly.pencil import Pencil, tables_of
from flexgram.assembly.small_gain import Loop
from flexgram.basics import Bools, Floats

#: How far an interval may reach towards the next pole.
REACH = 0.5
#: No interval is narrower, relative to its frequency.
NARROWEST = 1e-6
#: Where the bound begins to close is found to this, relative.
EDGE = 1e-4
#: So far beside a sharp resonance, relative, intervals may be left out (as ``reduce`` does).
ZONE = 1e-4
#: A bound that is this much larger than in the middle of its piece is not made sharper.
SHARP = 1.2
MOST_INTERVALS = 5000
#: So many are looked at together, fewer where their matrices are larger than this [numbers].
MOST_TOGETHER, MOST_NUMBERS = 32, 1_000_000


@dataclass
class BandProof:
    """What the parts' claims say of a view of the assembly everywhere in the band.

    Attributes
    ----------
    worst : float
        Of the error relative to its ‖H‖_F at each frequency, everywhere but in ``open``.
    open : (k, 2) array
        [rad/s] where nothing follows.
    sharp : bool
        The band has resonances, beside which nothing can be claimed.
    """

    worst: float
    open: Floats
    sharp: bool


class BandBound(ABC):
    """A bound of an assembly's error on intervals."""

    def __init__(
        self, loop: Loop, pencils: list[Pencil], tell: Callable[[str], None] | None
    ) -> None:
        """``tell`` is called every few seconds with how far it is. Series about the middle of an
        interval reach as far as its pencils let them."""
        self.loop, self.pencils = loop, pencils
        self._tell, self._told = tell, time.monotonic()
        self._seen: dict[tuple[float, float], Floats | None] = {}  # bounds by interval
        self._view = 0
        ports = len(loop.S_in) + len(loop.free_in) + len(loop.free_out)
        numbers = (DEGREE + 1) * max(len(p.omega) for p in pencils) * max(ports, 1)
        self.together = int(np.clip(MOST_NUMBERS // max(numbers, 1), 1, MOST_TOGETHER))

    @abstractmethod
    def over(self, omega: Floats, h: Floats) -> Floats:
        """Bounds (m, 2, pieces, views) on each piece of m intervals that are within ``reaches``,
        and in its middle by itself."""

    def reaches(self, omega: Floats, h: Floats) -> Bools:
        """Of which intervals no pole is too near, (m,)."""
        reaches: Bools = np.all([p.reach(omega, h) <= REACH for p in self.pencils], axis=0)
        return reaches

    def _look(self, intervals: Sequence[tuple[float, float]]) -> None:
        """At those that were not seen."""
        new = [interval for interval in intervals if interval not in self._seen]
        new = new[: MOST_INTERVALS - len(self._seen)]
        if not new:
            return
        self._seen.update(dict.fromkeys(new))
        a, b = np.array(new).T
        omega, h = 0.5 * (a + b), 0.5 * (b - a)
        for wide in (h > 0, h == 0):  # points of a band that is one are another series
            near = np.flatnonzero(wide)
            near = near[self.reaches(omega[near], h[near])] if len(near) else near
            if len(near):
                for k, bounds in zip(near, self.over(omega[near], h[near]), strict=True):
                    self._seen[new[k]] = bounds

    def prove(self, bands: Floats, view: int = 0) -> BandProof:
        """The bound of a view everywhere in bands (k, 2) [rad/s], but where a part claims nothing,
        and beside sharp resonances where it is larger than in the rest."""
        excluded = [tuple(e) for m in self.loop.parts.models.values() for e in m.claim.excluded]
        sharp = np.concatenate([pencil.sharp for pencil in self.pencils])
        zones = [(w * (1 - ZONE), w * (1 + ZONE)) for w in sharp]
        poles = np.concatenate([pencil.omega for pencil in self.pencils])
        knots = [table.omega for table, _ in tables_of(self.loop.parts.terms)]
        marks = np.concatenate([np.ravel(excluded), np.ravel(zones), poles, *knots])
        plain: list[tuple[float, float]] = []
        beside: list[tuple[float, float]] = []  # sharp resonances
        for a, b in bands:
            edges = np.unique([a, b, *marks[(marks > a) & (marks < b)]])
            for interval in pairwise(edges) if b > a else [(a, b)]:
                middle = sum(interval) / 2
                if not any(c <= middle <= d for c, d in excluded):
                    near = any(c <= middle <= d for c, d in zones)
                    (beside if near else plain).append(interval)
        gone = [(max(a, c), min(b, d)) for a, b in bands for c, d in excluded if c < b and d > a]
        self._view = view
        worst = self._cover(plain, gone, 1.0, EDGE)  # an error as large as H is no bound
        cap = worst if worst >= 0 else 1.0
        worst = max(worst, self._cover(beside, gone, cap, NARROWEST))
        if worst < 0:
            worst = np.inf
        inside = any(c < b and d > a for a, b in bands for c, d in [*zones, *excluded])
        return BandProof(worst, merged(gone), inside)

    def _progress(self, todo: Sequence[tuple[float, float]]) -> None:
        if self._tell is not None and time.monotonic() - self._told > 3:
            self._told = time.monotonic()
            left = sum(b - a for a, b in todo) / (2 * np.pi)
            name = self.loop.views[self._view].name
            self._tell(f"of {'H' if self._view == 0 else name}: {left:.4g} Hz of the band left")

    def _cover(
        self,
        todo: list[tuple[float, float]],
        gone: list[tuple[float, float]],
        cap: float,
        edge: float,
    ) -> float:
        """The largest bound in intervals, -1 if there is none; where it is not below the cap they
        are `gone`."""
        worst, known = -1.0, cap if cap < 1 else 0.0  # the latter in the middles of pieces
        while todo:
            batch = todo[: -self.together - 1 : -1]
            del todo[-len(batch) :]
            self._progress(todo)
            self._look(batch)
            many = len(self._seen) >= MOST_INTERVALS
            for a, b in batch:
                omega, h = 0.5 * (a + b), 0.5 * (b - a)
                found = self._seen.get((a, b))
                final = many or h <= NARROWEST * omega
                if found is not None:
                    sure, middle = found[:, :, self._view]
                    closed = middle <= cap
                    known = max(known, middle[closed].max(initial=0))
                    mixed = closed.any() and not closed.all() and h > edge * omega
                    rough = closed.all() and sure.max() > max(SHARP * middle.max(), known)
                    if final or not (mixed or rough):
                        ends = np.linspace(a, b, PIECES + 1)
                        open_ = ~(sure <= cap)
                        gone += list(zip(ends[:-1][open_], ends[1:][open_], strict=True))
                        worst = max(worst, float(sure[~open_].max(initial=-1)))
                        continue
                if final:
                    gone.append((a, b))
                else:
                    todo += [(omega, b), (a, omega)]
        return worst


def merged(intervals: Sequence[tuple[float, float]]) -> Floats:
    """Intervals (k, 2), ascending, those that touch as one."""
    result: list[list[float]] = []
    for a, b in sorted(intervals):
        if result and a <= result[-1][1] * (1 + 1e-12):
            result[-1][1] = max(result[-1][1], b)
        else:
            result.append([a, b])
    return np.array(result).reshape(-1, 2)
