"""Springs of assemblies that are so stiff that rounding shows."""

from __future__ import annotations

import warnings

import numpy as np
import scipy.sparse as sp

import flexgram
from flexgram import Matrices, ReducedModel, ReductionWarning
from flexgram.assembly.couple import couple
from flexgram.assembly.joints import GROUND, Joint

N = 30
BETA = 1e-4


def stiffness() -> sp.csr_matrix:
    K = sp.diags([np.full(N, 2e6), np.full(N - 1, -1e6), np.full(N - 1, -1e6)], [0, 1, -1]).tolil()
    K[0, 0] = K[-1, -1] = 1e6
    return K.tocsr()


def bar() -> ReducedModel:
    """A free chain of unit masses."""
    B = np.zeros((N, 2))
    B[0, 0] = B[-1, 1] = 1.0
    body = Matrices(stiffness(), sp.identity(N).tocsr(), B, inputs=["a.fx", "b.fx"], beta=BETA)
    return flexgram.reduce(body, (1, 20), 1e-6)


def full(k: float, omega: float) -> np.ndarray:
    """H of the two chains, the first one held, at the far end, in the displacements of the first
    and the elongation of the spring: nothing cancels there."""
    K = stiffness().toarray()
    # The second chain's displacements are those of the first's end, the spring's, and its own.
    T = np.zeros((2 * N, 2 * N))
    T[:N, :N] = np.eye(N)
    T[N:, N - 1] = T[N:, N] = 1.0
    T[N + 1 :, N + 1 :] += np.tril(np.ones((N - 1, N - 1)))
    own = np.zeros((2 * N, 2 * N))
    own[:N, :N] = K
    own[N, N] = k
    own[N + 1 :, N + 1 :] = 1e6 * np.eye(N - 1)
    damped = own.astype(complex)
    damped[:N, :N] *= 1 + 1j * omega * BETA
    damped[N + 1 :, N + 1 :] *= 1 + 1j * omega * BETA
    A = (damped - omega**2 * T.T @ T)[1:, 1:]  # held at its first node
    load = T[-1, 1:]
    return load @ np.linalg.solve(A, load)


def test_rounding_of_a_stiff_spring_is_told() -> None:
    part = bar()
    ends = [Joint("p.a", GROUND)]
    omega = 2 * np.pi * 3.0
    for k, stiff in ((1e6, False), (1e16, True)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            whole = couple({"p": part, "q": part}, [*ends, Joint("p.b", "q.a", stiffness={"x": k})])
        said = [str(one.message) for one in caught if one.category is ReductionWarning]
        assert bool(said) == stiff, said
        error = abs(whole.transfer([omega])[0, 0, 0] / full(k, omega) - 1)
        if stiff:
            assert "so stiff that rounding changes H by about" in said[0]
            assert whole.provenance.warnings == said  # for info and the report
            assert error > 1e-6  # worth a warning
        else:
            assert error < 1e-5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tie = couple({"p": part, "q": part}, [*ends, Joint("p.b", "q.a")])
    assert abs(tie.transfer([omega])[0, 0, 0] / full(1e16, omega) - 1) < 1e-5
