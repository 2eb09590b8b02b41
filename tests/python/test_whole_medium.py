"""Small bodies, of which the medium model is the whole: its error is rounding, whatever damps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from conftest import run
from flexgram import ReducedModel

N, BAND = 14, (0.02, 0.3)
K = sp.diags([-np.ones(N - 1), 2.2 * np.ones(N), -np.ones(N - 1)], [-1, 0, 1]).tocsr()
M = sp.diags(np.linspace(1.0, 2.0, N)).tocsr()
B = np.eye(N)[:, [2, 11]]
#: Far stronger than what a proof by coupled modes takes.
D = sp.csr_matrix((np.array([60.0, 25.0]), ([5, 9], [5, 9])), shape=(N, N))
SOFT = sp.csr_matrix(np.diag(np.r_[np.zeros(N - 4), np.ones(4)]))
PRONY = flexgram.prony([3.0, 8.0], [0.4, 5.0])


def exact(w: float) -> Any:
    A = K + complex(PRONY.at(w)) * SOFT + 1j * w * D - w * w * M
    return B.T @ np.linalg.solve(A.toarray(), B)


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_strong_dampers_are_certified(tolerance: float, ranks: int, tmp_path: Path) -> None:
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    terms = {"soft": (SOFT, PRONY)}
    flexgram.write_matrices(body, K, M, B, D=D, inputs=["a", "b"], terms=terms)
    said = run(
        *("reduce", "-body", body, "-mor_band_hz", ",".join(map(str, BAND))),
        *("-mor_tol", tolerance, "-mor_out", out),
        ranks=ranks,
    ).out
    assert f"medium model   order {N}," in said
    assert "medium error   rounding alone: its order is that of the body" in said
    rom = ReducedModel.load(out)
    assert rom.met and rom.kind == "certified" and rom.certified_error <= tolerance
    for w in 2 * np.pi * np.random.default_rng(8).uniform(*BAND, 60):
        H = exact(float(w))
        assert np.linalg.norm(rom.transfer(w) - H) <= rom.certified_error * np.linalg.norm(H)
