"""Bodies with many modes in the band: what block Lanczos finds, against all eigenvalues and direct
solves of the full body (SciPy)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import flexgram
from conftest import run
from flexgram import Matrices, ReducedModel, write_matrices

ROWS, COLUMNS = 34, 22  # of a net of masses: many modes lie close to each other
TOLERANCE = 1e-4
PORTS = (0, 5, 340)


def net(ground: float, massless: int = 0) -> tuple[Any, Any, Any]:
    """K, M, B of a net of springs [1] and masses [1]; `ground`: springs at the first row of it."""
    line = [
        sp.diags([[2.0] * n, [-1.0] * (n - 1), [-1.0] * (n - 1)], [0, 1, -1]).tolil()
        for n in (ROWS, COLUMNS)
    ]
    for K in line:  # free ends
        K[0, 0] = K[-1, -1] = 1.0
    K = (sp.kron(line[0], sp.eye(COLUMNS)) + sp.kron(sp.eye(ROWS), line[1])).tolil()
    for i in range(COLUMNS):
        K[i, i] += ground
    n = ROWS * COLUMNS
    mass = 1 + 0.3 * np.sin(np.arange(n))
    mass[700 : 700 + massless] = 0
    B = np.zeros((n, len(PORTS)))
    B[PORTS, range(len(PORTS))] = 1.0
    return K.tocsr(), sp.diags(mass).tocsr(), B


def frequencies(K: Any, M: Any) -> Any:
    """Natural frequencies [rad/s], of dofs with mass."""
    m = M.diagonal()
    heavy, light = np.flatnonzero(m), np.flatnonzero(m == 0)
    K = K.toarray()
    held = K[np.ix_(heavy, heavy)]
    if len(light):
        across = K[np.ix_(light, heavy)]
        held = held - across.T @ np.linalg.solve(K[np.ix_(light, light)], across)
    return np.sqrt(np.maximum(scipy.linalg.eigvalsh(held, np.diag(m[heavy])), 0))


def full_response(matrices: Matrices, w: float) -> Any:
    m = matrices
    A = m.K * (1 + 1j * w * m.beta) + (1j * w * m.alpha - w * w) * m.M
    if m.D is not None:
        A = A + 1j * w * m.D
    return m.B.T @ sp.linalg.spsolve(A.tocsc(), m.B)


def dampers() -> Any:
    D = sp.lil_matrix((ROWS * COLUMNS, ROWS * COLUMNS))
    D[60, 60] = D[401, 401] = 0.05
    return D.tocsr()


CASES: dict[str, dict[str, Any]] = {
    "held": {"ground": 0.1, "alpha": 1e-3, "beta": 1e-3},
    "free": {"ground": 0.0, "alpha": 1e-3, "beta": 1e-3},
    "massless": {"ground": 0.1, "massless": 9, "alpha": 1e-3, "beta": 1e-3},
    "dashpots": {"ground": 0.1, "alpha": 1e-3, "D": dampers(), "modes": 55},
    "undamped": {"ground": 0.1, "modes": 60},
}


@pytest.mark.parametrize("name", CASES)
def test_the_claim_holds_and_all_modes_are_there(name: str) -> None:
    case = dict(CASES[name])
    modes = case.pop("modes", 160)
    K, M, B = net(case.pop("ground"), case.pop("massless", 0))
    matrices = Matrices(K=K, M=M, B=B, **case)
    own = frequencies(K, M)
    last = 0.5 * (own[modes - 1] + own[modes])
    first = 0.3 * own[own > 1e-6][0]
    rom = flexgram.reduce(matrices, (first / (2 * np.pi), last / (2 * np.pi)), TOLERANCE)
    assert rom.met and rom.kind.startswith("certified")
    plan = dict(rom.provenance.plan)
    assert plan["search"].startswith("block Lanczos")
    assert "MB on a rank, with the vectors of" in plan["memory"]
    below = np.sum(own < last * 1.1) - (name == "free")
    assert int(plan["modes"].split()[0]) == below, "by the inertia, and all of them found"
    here = [w for w in np.linspace(first, last, 41) if np.abs(own - w).min() > 1e-4 * w]
    worst = 0.0
    for w in here:
        exact = full_response(matrices, w)
        lost = exact - rom.transfer(np.array([w]))[0]
        worst = max(worst, np.linalg.norm(lost) / np.linalg.norm(exact))
    assert 0 < worst <= rom.certified_error <= TOLERANCE


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_program_on_ranks(tmp_path: Path, ranks: int) -> None:
    K, M, B = net(0.1)
    matrices = Matrices(K=K, M=M, B=B, alpha=1e-3, beta=1e-3)
    last = frequencies(K, M)[159] / (2 * np.pi)
    body, out = tmp_path / "net.h5", tmp_path / "rom.h5"
    write_matrices(body, K, M, B, alpha=1e-3, beta=1e-3)
    job = ["-body", body, "-mor_band_hz", f"{0.1 * last!r},{last!r}", "-mor_out", out]
    said = run("reduce", *job, "-mor_tol", TOLERANCE, ranks=ranks).out
    assert "block Lanczos" in said
    rom = ReducedModel.load(out)
    assert rom.met
    for w in 2 * np.pi * last * np.array([0.11, 0.43, 0.77, 0.99]):
        exact = full_response(matrices, w)
        lost = np.linalg.norm(exact - rom.transfer(np.array([w]))[0])
        assert lost <= rom.certified_error * np.linalg.norm(exact)


def test_a_band_with_hundreds_of_modes_is_told_before_the_search(tmp_path: Path) -> None:
    """The band may have been meant otherwise."""
    K, M, B = net(0.1)
    own = frequencies(K, M)
    last = 0.5 * (own[399] + own[400]) / (2 * np.pi)
    body = tmp_path / "net.h5"
    write_matrices(body, K, M, B, alpha=1e-3, beta=1e-3)
    job = ["-body", body, "-mor_band_hz", f"{0.1 * last!r},{last!r}", "-mor_tol", 1e-2]
    said = run("reduce", *job, "-mor_out", tmp_path / "rom.h5", "-mor_monitor", "plan").out
    below = np.sum(own < 1.1 * 2 * np.pi * last)
    told = f"{below} natural frequencies lie below the cutoff"
    assert told in said and said.index(told) < said.index("  modes ")
