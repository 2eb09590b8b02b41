"""Free bodies at such low frequencies that rounding of K shows: rigid modes count as rigid."""

from __future__ import annotations

import warnings
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from flexgram import Matrices, ReductionWarning

N, K, ETA = 40, 1e12, 1e-3


def chain() -> sp.csr_matrix:
    """Free, of springs whose sums in the diagonal are rounded."""
    own = K * (1 + 0.3 * np.sin(np.arange(N - 1)))
    D = sp.diags([np.ones(N), -np.ones(N - 1)], [0, 1]).tocsr()[: N - 1]
    return (D.T @ sp.diags(own) @ D).tocsr()


@pytest.mark.parametrize(("first", "warned"), [(0.001, True), (50.0, False)])
def test_what_rounding_would_change_is_told(first: float, warned: bool) -> None:
    B = np.zeros((N, 2))
    B[0, 0] = B[-1, 1] = 1.0
    stored = chain()
    body = Matrices(stored, sp.identity(N).tocsr(), B, eta=ETA)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rom = flexgram.reduce(body, (first, 100), 1e-5)
    said = [str(one.message) for one in caught if one.category is ReductionWarning]
    told = [words for words in said if "rounding of K holds the rigid modes a little" in words]
    assert bool(told) == warned, said
    assert rom.claim.met
    # Of the stored numbers the rigid motion has a stiffness: the sum of all entries, exactly.
    omega = 2 * np.pi * first
    held = float(sum(map(Fraction, stored.data))) / N
    change = abs(held) / abs(omega**2 - held)
    if warned:
        H = rom.transfer([omega])[0]
        np.testing.assert_allclose(H, -1 / (N * omega**2), rtol=1e-8)  # of the body that is meant
        assert 1e-5 < change <= float(told[0].split("up to ")[1].split()[0])
    else:
        assert change < 1e-9
