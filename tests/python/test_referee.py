"""The referee's own digits: elimination with eighty against refinement with forty-five, where long
double has lost its own."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp

from referee import System

N = 60


@pytest.mark.parametrize("damper", [None, 1e7])
def test_two_ways_agree_beside_a_resonance(damper: float | None) -> None:
    """A chain of 1e6 N/m, 1e-11 beside a pole; and with a damper that nearly holds a mass."""
    K = 1e6 * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(N, N)).tocsr()
    M = sp.identity(N, format="csr")
    D = None if damper is None else sp.csr_matrix(([damper], ([30], [30])), shape=(N, N))
    B = np.eye(N)[:, [3, 59]]
    free = np.arange(N) != 30 if damper else np.ones(N, bool)
    pole = np.sqrt(sl.eigvalsh(K.toarray()[np.ix_(free, free)]))[2]
    system = System(K, M, B, D=D, eta=1e-13)
    omega = float(pole * (1 + 1e-11))
    exact, refined, plain = (H(omega) for H in (system.exactly, system.refined, system.transfer))
    size = np.linalg.norm(exact.astype(complex))
    assert np.abs(exact - refined).max() <= 1e-17 * size
    # What long double alone leaves is more, but no more than its rounding beside the pole.
    assert np.linalg.norm((plain - exact).astype(complex)) <= 1e-6 * size
