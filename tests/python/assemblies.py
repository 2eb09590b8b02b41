"""Random bodies for assemblies, and assemblies of full bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp

import flexgram
from flexgram import ReducedModel
from flexgram.assembly.couple import Joint
from flexgram.body.matrices import Matrices

BAND = (0.05, 0.6)  # [Hz]


def random_body(rng: np.random.Generator, ports: int) -> tuple[Any, ...]:
    """A held body with n dofs, every port a force in a direction of an interface of its own."""
    n = int(rng.integers(30, 60))
    springs = sp.random(n, n, 0.15, random_state=int(rng.integers(1 << 30)))
    G = springs.toarray() - np.diag(springs.toarray().sum(axis=1))
    K = G @ G.T + np.diag(rng.uniform(0.5, 3, n))
    M = np.diag(rng.uniform(0.3, 2, n))
    B = np.zeros((n, ports))
    B[rng.choice(n, ports, replace=False), range(ports)] = 1
    names = [f"{name}.f{axis}" for name in ("a", "b") for axis in "xyz"][:ports]
    alpha, beta = rng.uniform(0.005, 0.05), rng.uniform(0.001, 0.02)
    return K, M, B, names, float(alpha), float(beta)


def reduced(body: tuple[Any, ...], tol: float, band: tuple[float, float] = BAND) -> ReducedModel:
    K, M, B, names, alpha, beta = body
    given = Matrices(sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=names, alpha=alpha, beta=beta)
    return flexgram.reduce(given, band, tol)


def by_number(model: ReducedModel) -> ReducedModel:
    """The body with no more known of its error than how large it is."""
    model.claim.form = None
    return model


def joined_response(
    A: Any, B: Any, names: list[str], joints: list[Joint], keep: list[int], w: float
) -> Any:
    """H at frequency w of bodies side by side with the dynamic stiffness A, joined: constraints by
    Lagrange multipliers, springs in A."""
    A = A.astype(complex)
    ties = []
    for joint in joints:
        for d in joint.directions or {*joint.stiffness, *joint.damping} or "xyz":
            g = B[:, names.index(f"{joint.first}.f{d}")].copy()
            if joint.second != "ground":
                g -= B[:, names.index(f"{joint.second}.f{d}")]
            if joint.ties:
                ties.append(g)
            else:
                k = joint.stiffness.get(d, 0) * (1 + 1j * joint.loss)
                k = k + 1j * w * joint.damping.get(d, 0)
                A += k * np.outer(g, g)
    t = len(ties)
    L = np.array(ties).reshape(t, len(A))
    whole = np.block([[A, L.T], [L, np.zeros((t, t))]])
    X = np.linalg.solve(whole, np.vstack([B[:, keep], np.zeros((t, len(keep)))]))[: len(A)]
    return B[:, keep].T @ X


def exactly(A: Any, B: Any) -> Any:
    """A⁻¹B in long doubles, whose solution is improved until it is right to their digits."""
    factors = scipy.linalg.lu_factor(A.astype(complex))
    X, before = np.zeros_like(B), np.inf
    for _ in range(12):
        step = scipy.linalg.lu_solve(factors, (B - A @ X).astype(complex))
        X, size = X + step, abs(step).max()
        if size <= 1e-18 * abs(X).max() or size > before / 2:
            break
        before = size
    return X
