"""The small gain of an assembly on whole intervals of the frequency, not at points of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import scipy.linalg

from flexgram.assembly.band_bound import REACH, BandBound
from flexgram.assembly.interval_series import Chosen, OutputTerms, Pieces, Series
from flexgram.assembly.loop_series import LoopSeries, PartSeries
from flexgram.assembly.small_gain import (
    FEW,
    Loop,
    Sizes,
    errors_of,
    growth_of,
    reference_of,
    relative,
)
from flexgram.basics import Floats


class GainOverBand(BandBound):
    """The bound by the norms of the parts' errors."""

    def __init__(self, loop: Loop, tell: Callable[[str], None] | None = None) -> None:
        self.series = LoopSeries(loop)
        models = loop.parts.models
        ports = {name: (m.system.B, m.system.C) for name, m in models.items()}
        self.parts = {name: PartSeries(m, *ports[name]) for name, m in models.items()}
        self.elastic = {
            name: PartSeries(m, m.system.B, m.system.C) for name, m in loop.elastic.items()
        }
        self.own = {}
        for name, m in models.items():
            B, C = ports[name]
            self.own[name] = PartSeries(m, C.T, C), PartSeries(m, B, B.T)
        pencils = [self.series.pencil, *(p.pencil for p in self.parts.values())]
        super().__init__(loop, pencils, tell)

    def over(self, omega: float, h: float) -> Floats | None:
        if not self.reaches(omega, h):
            return None
        at, loop, found = Pieces(h), self.loop, self.series.over(omega, h)
        every = slice(None)
        both = np.array([1.0, 0.0])[:, None]  # anywhere in a piece, and in its middle

        def sizes(series: Series, order: Literal[2, "fro"] = "fro") -> Floats:
            if 0 in series.tail.shape:
                return np.zeros((2, at.count))
            if min(series.tail.shape) > FEW:
                order = "fro"
            middle, away = series.norms(at, order)
            return middle + both * away

        def sizes_of(H: Series) -> Sizes:
            return lambda rows, columns: sizes(H.part(rows, columns))

        def own_of(name: str) -> Sizes:
            def root(part: PartSeries, ports: Chosen) -> Floats:  # of the sum of its diagonal
                if not part.pencil.reach(omega, h) <= REACH:
                    return np.full((2, at.count), np.inf)
                block = part.over(omega, h).part(ports, ports)
                return np.asarray(np.sqrt(np.sqrt(len(block.tail)) * sizes(block)))

            return lambda rows, columns: (
                root(self.own[name][0], rows) * root(self.own[name][1], columns)
            )

        errors = []
        for name, part in self.parts.items():
            model = loop.parts.models[name]
            terms = OutputTerms.of([model.system])
            reference = sizes_of(terms.over(part.over(omega, h), omega, h))
            if name in self.elastic:
                bent = sizes_of(terms.over(self.elastic[name].over(omega, h), omega, h))
                reference = reference_of(model, reference, bent)
            errors.append(errors_of(model, *loop.kinds[name], reference, own_of(name)))
        of_Q = np.array(
            [[sizes(found.Q.part(r, c), 2) for c in loop.out_blocks] for r in loop.in_blocks]
        )
        growths = {}
        for i, k in np.ndindex(2, at.count):
            E = scipy.linalg.block_diag(*(e[:, :, i, k] for e in errors))
            growths[i, k] = growth_of(of_Q[:, :, i, k], E)[0]
        bounds = np.full((2, at.count, len(loop.views)), np.inf)
        H_free, larger = loop.outputs.over(found.H, omega, h), loop.outputs.largest(omega + h)
        for v, view in enumerate(loop.views):
            left = np.array([sizes(found.after.part(view.rows, c), 2) for c in loop.out_blocks])
            right = np.array([sizes(found.before.part(r, view.columns), 2) for r in loop.in_blocks])
            middle, away = H_free.part(view.rows, view.columns).norms(at, "fro")
            H = middle - both * away
            rounding = (
                self.series.rounding
                * sizes(found.dual.part(every, view.rows))
                * sizes(found.motion.part(every, view.columns))
            )
            for (i, k), growth in growths.items():
                if growth is not None:
                    error = left[:, i, k] @ growth @ right[:, i, k] + rounding[i, k]
                    error *= larger[view.rows].max(initial=1)
                    bounds[i, k, v] = relative(float(error), float(H[i, k]))
        return bounds
