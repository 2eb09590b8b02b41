"""Prony terms in the time domain: internal states, exact and passive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from flexgram.basics import Floats
from flexgram.body.laws import Prony
from flexgram.body.terms import Term

#: Eigenvalues of T, scaled to a unit diagonal, below this share of the largest are rounding.
RANK = 1e-13
#: Diagonal entries of T below this share of the largest are rounding.
ROUNDING = 1e-14


@dataclass(frozen=True)
class InternalStates:
    """z' = ``drive`` q - diag(``rate``) z, and the force ``stiffness`` q - ``force`` z on q.

    With T = L Lᵀ of rank r each pair g, τ of a Prony term has r states, τ z' = Lᵀ q - z: the
    strain of its damper. The force is Σ g L (Lᵀ q - z).

    Attributes
    ----------
    stiffness : (m, m) array
        Σ g T, of all pairs: what the body is stiffer by at once.
    force : (m, k) array
    drive : (k, m) array
    rate : (k,) array
        1/τ [1/s].
    share : (k,) array
        g of each state's pair.
    """

    stiffness: Floats
    force: Floats
    drive: Floats
    rate: Floats
    share: Floats

    @property
    def count(self) -> int:
        """Number k of states."""
        return len(self.rate)

    @classmethod
    def of(cls, terms: Sequence[Term], m: int) -> Self:
        """Of the Prony terms among these, of a body with m coordinates."""
        stiffness = np.zeros((m, m))
        force, drive = [np.zeros((m, 0))], [np.zeros((0, m))]
        rate, share = [np.zeros(0)], [np.zeros(0)]
        for term in terms:
            if not isinstance(term.law, Prony):
                continue
            own = np.diag(term.matrix)  # of stiff coordinates and soft; of rigid ones rounding
            size = np.sqrt(np.maximum(own, max(ROUNDING * own.max(initial=0), 1e-300)))
            scaled = term.matrix / np.outer(size, size)
            values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
            kept = values > RANK * np.abs(values).max(initial=0)
            L = size[:, None] * vectors[:, kept] * np.sqrt(values[kept])
            stiffness += term.law.g.sum() * (L @ L.T)
            for g, tau in zip(term.law.g, term.law.tau, strict=True):
                if g == 0:
                    continue
                force.append(g * L)
                drive.append(L.T / tau)
                rate.append(np.full(L.shape[1], 1 / tau))
                share.append(np.full(L.shape[1], g))
        return cls(
            stiffness,
            np.hstack(force),
            np.vstack(drive),
            np.concatenate(rate),
            np.concatenate(share),
        )
