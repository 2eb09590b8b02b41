"""Prony terms as coordinates without mass: the same body with K, D and M alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

from flexgram.basics import Floats
from flexgram.body.laws import Prony
from flexgram.model.internal_states import RANK, ROUNDING, InternalStates
from flexgram.model.system import System


def with_internal_variables(system: System) -> System:
    """The system with the internal states of its Prony terms as coordinates.

    Each pair g, τ of a Prony term with the matrix T = L Lᵀ has the coordinates z with
    g(z + τ z') = g Lᵀ q, and its force on q is g L(Lᵀ q - z). K, D and M stay symmetric, M is
    singular, and H is the same up to the rounding of T = L Lᵀ (``rounding_of_variables``).

    Parameters
    ----------
    system : System
        Without parameters; its other terms stay, with zeros.

    Returns
    -------
    System
        (m + k coordinates; eta is in S.)
    """
    m = system.order
    inner = InternalStates.of(system.terms, m)
    if not inner.count:
        return system
    share = inner.share

    def with_zeros(matrix: Floats) -> Floats:
        whole: Floats = scipy.linalg.block_diag(matrix, np.zeros((inner.count, inner.count)))
        return whole

    K = np.block([[system.K + inner.stiffness, -inner.force], [-inner.force.T, np.diag(share)]])
    none = np.zeros((inner.count, system.B.shape[1]))
    return replace(
        system,
        M=with_zeros(system.M),
        D=scipy.linalg.block_diag(system.D, np.diag(share / inner.rate)),
        K=K,
        S=with_zeros(system.S + system.eta * system.K),
        eta=0.0,
        terms=tuple(
            term.with_matrix(with_zeros(term.matrix))
            for term in system.terms
            if not isinstance(term.law, Prony)
        ),
        B=np.vstack([system.B, none]),
        C=np.hstack([system.C, np.zeros((len(system.C), inner.count))]),
    )


def rounding_of_variables(system: System, W: Floats) -> float:
    """How far T and L Lᵀ are apart at most, in the norm of W, summed over the Prony terms.

    Eigenvalues below ``RANK`` of the largest are left out, of T scaled to a unit diagonal.
    """
    apart = 0.0
    for term in system.terms:
        if isinstance(term.law, Prony):
            own = np.maximum(np.diag(term.matrix), ROUNDING * np.diag(term.matrix).max())
            size = float(scipy.linalg.eigh(np.diag(own), W, eigvals_only=True)[-1])
            apart += float(term.law.g.sum()) * 2 * RANK * len(own) * size
    return apart
