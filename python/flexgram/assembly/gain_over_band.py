"""The small gain of an assembly on whole intervals of the frequency, not at points of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from flexgram.assembly.band_bound import REACH, BandBound
from flexgram.assembly.interval_series import Chosen, OutputTerms, Pieces, Series, block_diag
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

    def over(self, omega: Floats, h: Floats) -> Floats:
        at, loop, found = Pieces(h), self.loop, self.series.over(omega, h)
        every = slice(None)
        shape = 2, len(omega), at.count
        both = np.array([1.0, 0.0])[:, None, None]  # anywhere in a piece, and in its middle

        def sizes(series: Series, order: Literal[2, "fro"] = "fro") -> Floats:
            if 0 in series.tail.shape:
                return np.zeros(shape)
            if min(series.tail.shape[1:]) > FEW:
                order = "fro"
            middle, away = series.norms(at, order)
            return middle + both * away

        def sizes_of(H: Series) -> Sizes:
            return lambda rows, columns: sizes(H.part(rows, columns))

        def own_of(name: str) -> Sizes:
            def root(part: PartSeries, ports: Chosen) -> Floats:  # of the sum of its diagonal
                near = part.pencil.reach(omega, h) <= REACH
                result = np.full(shape, np.inf)
                if near.any():
                    block = part.over(omega[near], h[near]).part(ports, ports)
                    middle, away = block.norms(at, "fro")
                    of_near = np.sqrt(np.sqrt(block.tail.shape[1]) * (middle + both * away))
                    result[:, near] = of_near
                return result

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
        E = block_diag([np.moveaxis(e, (0, 1), (-2, -1)) for e in errors])
        growth = growth_of(np.moveaxis(of_Q, (0, 1), (-2, -1)), E)[0]
        closed = np.isfinite(growth).all(axis=(-2, -1))
        growth = np.where(closed[..., None, None], growth, 0)
        bounds = np.full((*shape, len(loop.views)), np.inf)
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
            factor = larger[:, view.rows].max(axis=1, initial=1)
            error = np.einsum("o...,...oi,i...->...", left, growth, right) + rounding
            error = np.where(closed, error * factor[:, None], np.inf)
            bounds[..., v] = relative(error, H)
        return bounds.transpose(1, 0, 2, 3)
