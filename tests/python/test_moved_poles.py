"""Poles that terms move far from those of K and M, and that hardly anything damps: the claim of H
holds at them too, where each rounding of a term counts a thousand times and more."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from audit import reduced_system
from flexgram.body.varying_laws import Coriolis, Spin
from referee import System, relative_error

N, SPEED = 40, 100.0


def spinning(rng: np.random.Generator) -> System:
    """Stiffness in a frame that turns, softened by nearly all that it has at the largest speed."""
    n = N
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    K = (Q * np.geomspace(1.02 * SPEED**2, 3e6, n)) @ Q.T
    M = np.diag(rng.uniform(0.5, 2, n))
    root = np.sqrt(np.diag(M))
    K = 0.5 * (K + K.T) * np.outer(root, root)
    J = np.zeros((n, n))
    for k in range(0, n - 1, 2):
        J[k, k + 1], J[k + 1, k] = -1, 1
    G = 2 * J * np.outer(root, root)
    B = np.zeros((n, 2))
    B[[1, n // 2], range(2)] = 1
    return System(
        K,
        M,
        B,
        alpha=4e-4,
        terms=[(-M, "spin", SPEED, 0.0, 2), (G, "coriolis", SPEED)],
    )


@pytest.mark.parametrize("seed", [0, 2])
def test_the_claim_holds_at_poles_that_a_spin_moves(seed: int) -> None:
    full = spinning(np.random.default_rng(seed))
    (S, *_), (G, *_) = full.terms
    body = flexgram.Matrices(
        sp.csr_matrix(full.K),
        sp.csr_matrix(full.M),
        full.B,
        alpha=full.alpha,
        terms={
            "softening": (sp.csr_matrix(S), Spin(0.0, SPEED, SPEED)),
            "coriolis": (sp.csr_matrix(G), Coriolis(0.0, SPEED, SPEED)),
        },
    )
    rom = flexgram.reduce(body, (2.0, 30.0), 1e-8, options={"mor_parameter_values": "2"})
    assert rom.kind == "certified" and rom.certified_error < 1e-8
    small = rom.at(speed=SPEED)
    curve, poles = small.claim, np.abs(small.poles().imag)
    at_poles = [k for k, x in enumerate(curve.omega) if abs(poles - x).min() < 1e-7 * x]
    assert len(at_poles) > 3
    for k in at_poles:
        omega = float(curve.omega[k])
        error = relative_error(full, reduced_system(small), omega, "pointwise", exactly=True)
        assert error <= curve.bound[k] <= curve.supremum
