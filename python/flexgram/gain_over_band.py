"""The small gain of an assembly on whole intervals of the frequency, not at points of them.

With the dynamic stiffness A(ω) of the parts and the springs between them, ties
Gᵀq = g and q = N z + L g, where Gᵀ N = 0, Gᵀ L = 1:

    Nᵀ A N z = Nᵀ (f - A L g),  λ = Lᵀ (f - A q).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexgram.interval_series import DEGREE, PIECES, Chosen, Pencil, Pieces, Series, about
from flexgram.reduced import ReducedModel
from flexgram.small_gain import FEW, Loop, Sizes, errors_of, growth_of, reference_of, relative

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

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


class PartSeries:
    """Receptances C A⁻¹ B of a part."""

    def __init__(self, model: ReducedModel, B: Floats, C: Floats) -> None:
        tau = float(model.bands.max()) ** 2 / 4
        self.pencil = Pencil(model.K, model.D, model.M, model.eta, tau)
        self.B, self.C = self.pencil.modes.T @ B, C @ self.pencil.modes

    def over(self, omega: float, h: float) -> Series:
        loads = np.zeros((3, *self.B.shape), dtype=complex)
        loads[0] = self.B
        one = np.eye(self.B.shape[1])
        return self.pencil.response(omega, h, loads).between(self.C, one)


@dataclass
class LoopOverInterval:
    """Of an assembly over an interval, inputs and outputs as of ``Loop``."""

    Q: Series
    after: Series  #: 1 - H Q, the rows of the outputs that are left
    before: Series  #: 1 - Q H, the columns of the inputs that are left
    H: Series  #: of these
    motion: Series  #: in modal coordinates, in answer to these inputs
    dual: Series  #: the same in answer to loads like these outputs


class LoopSeries:
    """An assembly over intervals."""

    def __init__(self, loop: Loop) -> None:
        parts = loop.parts
        self.S_in, self.S_out = loop.S_in, loop.S_out
        self.free_in, self.free_out = loop.free_in, loop.free_out
        self.ties = [k for k, (_, joint) in enumerate(loop.ties) if joint.ties]
        self.springs = [k for k in range(len(loop.ties)) if k not in self.ties]
        springs = [loop.ties[k] for k in self.springs]
        self.stiffness = np.array([joint.stiffness.get(d, 0.0) for d, joint in springs])
        self.damping = np.array([joint.damping.get(d, 0.0) for d, joint in springs])
        G, b = parts.B @ self.S_in[self.ties].T, parts.B @ self.S_in[self.springs].T
        K = parts.K + (b * self.stiffness) @ b.T
        D = parts.D + (b * self.damping) @ b.T
        N = np.eye(len(K))
        if self.ties:
            N = scipy.linalg.null_space(G.T / np.linalg.norm(G, axis=0)[:, None])
        tau = max(float(m.bands.max()) for m in parts.models.values()) ** 2 / 4
        self.pencil = Pencil(N.T @ K @ N, N.T @ D @ N, N.T @ parts.M @ N, parts.eta, tau)
        # Of the matrices of modes: some roundings, of the stiffest spring's where it is stiffer
        # than the parts.
        self.rounding = 80 * np.finfo(float).eps * float(
            scipy.linalg.eigh(K, parts.K + tau * parts.M, eigvals_only=True)[-1])  # fmt: skip
        N, L = N @ self.pencil.modes, np.linalg.pinv(G).T
        stiffness = (K * (1 + 1j * parts.eta), 1j * D, -parts.M)
        self.NAL = [N.T @ A @ L for A in stiffness]
        self.LAL = [L.T @ A @ L for A in stiffness]
        forces, outputs = parts.B[:, self.free_in], parts.C[self.free_out]
        self.NB, self.Nb = N.T @ forces, N.T @ b
        self.LB, self.Lb, self.bL = L.T @ forces, L.T @ b, b.T @ L
        self.CN, self.CL = outputs @ N, outputs @ L

    def over(self, omega: float, h: float) -> LoopOverInterval:
        p, t, o = len(self.free_in), len(self.S_in), len(self.free_out)
        ties, springs = self.ties, self.springs
        tied, sprung = [p + k for k in ties], [p + k for k in springs]
        NAL, LAL = about(omega, self.NAL), about(omega, self.LAL)
        Y = about(omega, (np.diag(self.stiffness), 1j * np.diag(self.damping),
                           0 * np.diag(self.damping)))  # fmt: skip
        loads = np.zeros((3, len(self.NB), p + t + o), dtype=complex)  # forces, gaps, outputs
        loads[0, :, :p], loads[:, :, tied], loads[:, :, sprung] = self.NB, -NAL, self.Nb @ Y
        loads[0, :, p + t :] = self.CN.T
        answers = self.pencil.response(omega, h, loads)
        every = slice(None)
        z = answers.part(every, slice(0, p + t))
        at_ties = np.zeros((3, len(ties), p + t), dtype=complex)
        at_ties[0, :, :p], at_ties[:, :, tied], at_ties[:, :, sprung] = self.LB, -LAL, self.Lb @ Y
        of_ties = z.times(-NAL.transpose(0, 2, 1), h).plus(at_ties)
        stretch = np.zeros((len(springs), p + t))
        stretch[:, tied], stretch[:, sprung] = self.bL, -np.eye(len(springs))
        of_springs = z.between(self.Nb.T, np.eye(p + t)).plus(stretch).times(Y, h)
        coefficients = np.zeros((DEGREE + 3, t, p + t), dtype=complex)
        tail = np.zeros((t, p + t))
        for rows, series in ((ties, of_ties), (springs, of_springs)):
            coefficients[:, rows], tail[rows] = series.coefficients, series.tail
        forces = Series(coefficients, tail)  # λ
        moved = np.zeros((o, t))
        moved[:, ties] = self.CL
        outputs = z.between(self.CN, np.eye(p + t))
        to_gaps, to_forces = slice(p, None), slice(0, p)
        gaps = outputs.part(every, to_gaps).plus(moved)
        return LoopOverInterval(
            Q=forces.part(every, to_gaps).between(-self.S_in.T, self.S_out),
            after=gaps.between(np.eye(o), -self.S_out).plus(
                np.eye(self.S_out.shape[1])[self.free_out]),
            before=forces.part(every, to_forces).between(-self.S_in.T, np.eye(p)).plus(
                np.eye(self.S_in.shape[1])[:, self.free_in]),
            H=outputs.part(every, to_forces),
            motion=z.part(every, to_forces),
            dual=answers.part(every, slice(p + t, None)),
        )  # fmt: skip


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


class GainOverBand:
    """The bound of an assembly's error on intervals."""

    def __init__(self, loop: Loop, tell: Callable[[str], None] | None = None) -> None:
        """``tell`` is called every few seconds with how far it is."""
        self.loop, self.series = loop, LoopSeries(loop)
        self._tell, self._told = tell, time.monotonic()
        models = loop.parts.models
        self.parts = {name: PartSeries(m, m.B, m.C) for name, m in models.items()}
        self.elastic = {name: PartSeries(m, m.B, m.C) for name, m in loop.elastic.items()}
        self.own = {name: (PartSeries(m, m.C.T, m.C), PartSeries(m, m.B, m.B.T))
                    for name, m in models.items()}  # fmt: skip
        self._seen: dict[tuple[float, float], Floats | None] = {}  # bounds by interval
        self._view = 0
        self.pencils = [self.series.pencil, *(p.pencil for p in self.parts.values())]

    def over(self, omega: float, h: float) -> Floats | None:
        """Bounds (2, pieces, views) on each piece of an interval, and in its middle by itself;
        nothing if a pole is too near."""
        if not all(pencil.reach(omega, h) <= REACH for pencil in self.pencils):
            return None
        at, loop, found = Pieces(h), self.loop, self.series.over(omega, h)
        every = slice(None)
        both = np.array([1.0, 0.0])[:, None]  # anywhere in a piece, and in its middle

        def sizes(series: Series, order: Literal[2, "fro"] = "fro") -> Floats:
            if 0 in series.tail.shape:
                return np.zeros((2, PIECES))
            if min(series.tail.shape) > FEW:
                order = "fro"
            middle, away = series.norms(at, order)
            return middle + both * away

        def sizes_of(H: Series) -> Sizes:
            return lambda rows, columns: sizes(H.part(rows, columns))

        def own_of(name: str) -> Sizes:
            def root(part: PartSeries, ports: Chosen) -> Floats:  # of the sum of its diagonal
                if not part.pencil.reach(omega, h) <= REACH:
                    return np.full((2, PIECES), np.inf)
                block = part.over(omega, h).part(ports, ports)
                return np.asarray(np.sqrt(np.sqrt(len(block.tail)) * sizes(block)))

            return lambda rows, columns: (
                root(self.own[name][0], rows) * root(self.own[name][1], columns))  # fmt: skip

        errors = []
        for name, part in self.parts.items():
            model, reference = loop.parts.models[name], sizes_of(part.over(omega, h))
            if name in self.elastic:
                bent = sizes_of(self.elastic[name].over(omega, h))
                reference = reference_of(model, reference, bent)
            errors.append(errors_of(model, *loop.kinds[name], reference, own_of(name)))
        of_Q = np.array(
            [[sizes(found.Q.part(r, c), 2) for c in loop.out_blocks] for r in loop.in_blocks]
        )
        growths = {}
        for i, k in np.ndindex(2, PIECES):
            E = scipy.linalg.block_diag(*(e[:, :, i, k] for e in errors))
            growths[i, k] = growth_of(of_Q[:, :, i, k], E)[0]
        bounds = np.full((2, PIECES, len(loop.views)), np.inf)
        for v, view in enumerate(loop.views):
            left = np.array([sizes(found.after.part(view.rows, c), 2) for c in loop.out_blocks])
            right = np.array([sizes(found.before.part(r, view.columns), 2) for r in loop.in_blocks])
            middle, away = found.H.part(view.rows, view.columns).norms(at, "fro")
            H = middle - both * away
            rounding = (
                self.series.rounding
                * sizes(found.dual.part(every, view.rows))
                * sizes(found.motion.part(every, view.columns))
            )
            for (i, k), growth in growths.items():
                if growth is not None:
                    error = left[:, i, k] @ growth @ right[:, i, k] + rounding[i, k]
                    bounds[i, k, v] = relative(float(error), float(H[i, k]))
        return bounds

    def prove(self, bands: Floats, view: int = 0) -> BandProof:
        """The bound of a view everywhere in bands (k, 2) [rad/s], but where a part claims nothing,
        and beside sharp resonances where it is larger than in the rest."""
        excluded = [tuple(e) for m in self.loop.parts.models.values() for e in m.excluded]
        sharp = np.concatenate([pencil.sharp for pencil in self.pencils])
        zones = [(w * (1 - ZONE), w * (1 + ZONE)) for w in sharp]
        poles = np.concatenate([pencil.omega for pencil in self.pencils])
        marks = np.concatenate([np.ravel(excluded), np.ravel(zones), poles])
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
            self._tell(f"{self.loop.views[self._view].name}: {len(self._seen)} intervals, "
                       f"{left:.4g} Hz left")  # fmt: skip

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
            a, b = todo.pop()
            self._progress(todo)
            omega, h = 0.5 * (a + b), 0.5 * (b - a)
            many = len(self._seen) >= MOST_INTERVALS
            if (a, b) not in self._seen and not many:
                self._seen[a, b] = self.over(omega, h)
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
