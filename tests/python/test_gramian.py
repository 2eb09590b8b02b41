"""The band-limited Gramian against its closed form: matrix logarithm and Lyapunov equation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg as sl

from conftest import chain, run
from flexgram import write_matrices


def closed_form(body: dict[str, Any], first: float, last: float) -> Any:
    """Position Gramian over [first, last] rad/s (Antoulas 2005, section 7.6): with x' = A x + B u,

    A P + P Aᵀ + S B Bᵀ + B Bᵀ Sᴴ = 0,  S = i/(2π) [log((A + iω)(A − iω)⁻¹)] over ω.
    """
    K, M = body["K"].toarray(), body["M"].toarray()
    n, alpha = len(K), body["alpha"]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-sl.solve(M, K), -alpha * np.eye(n)]])
    B = np.vstack([np.zeros_like(body["B"]), sl.solve(M, body["B"])])
    eye = np.eye(2 * n)

    def S(omega: float) -> Any:
        if omega == 0:
            return np.zeros_like(A)
        quotient = sl.solve((A - 1j * omega * eye).T, (A + 1j * omega * eye).T).T
        return (1j / (2 * np.pi)) * sl.logm(quotient)

    weighted = (S(last) - S(first)).real @ B @ B.T  # S is real: the band is symmetric about zero
    return sl.solve_continuous_lyapunov(A, -(weighted + weighted.T))[:n, :n]


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("band", [(0.0, 0.1), (0.03, 0.2)])
def test_against_matrix_logarithm(tmp_path: Path, band: tuple[float, float], ranks: int) -> None:
    body = chain(40, alpha=0.05)
    write_matrices(tmp_path / "body.h5", **body)
    run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_band_hz",
        f"{band[0]},{band[1]}",
        "-mor_inner_product",
        "euclidean",
        "-mor_port_scaling",
        "none",
        "-mor_second_stage",
        "gramian",
        "-mor_order",
        "rule",
        "-mor_out",
        tmp_path / "rom.h5",
        ranks=ranks,
    )
    with h5py.File(tmp_path / "rom.h5") as file:
        ours, V = file["gramian/sigma"][:], file["V"][:]
    P = closed_form(body, *(2 * np.pi * f for f in band))
    theirs, vectors = np.linalg.eigh(P)
    theirs, vectors = theirs[::-1], vectors[:, ::-1]
    large = theirs > 1e-8 * theirs[0]
    assert large.sum() > 8
    count = int(large.sum())
    assert np.allclose(ours[:count], theirs[large], rtol=1e-6)
    # and the dominant subspace
    leading = int(np.sum(theirs > 1e-3 * theirs[0]))
    angle = np.linalg.norm(
        vectors[:, :leading] - V @ np.linalg.lstsq(V, vectors[:, :leading], rcond=None)[0]
    )
    assert angle < 1e-6
