"""Many calls in one process, tiny bodies on many ranks, a few kills (``scripts/kills``: more)."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from conftest import ENVIRONMENT, PYTHON, message, program, rom_matrices, rom_transfer, run
from flexgram import write_matrices


def test_many_calls_take_no_more_memory_than_some() -> None:
    words = program("soak", 90, timeout=600).split()
    assert words[:3] == ["orders", "1", "grown"]
    assert float(words[3]) < 3.5  # MB over the last 67 rounds, each with two results, four errors


@pytest.mark.parametrize("ranks", [1, 2, 3, 5, 7])
def test_tiny_bodies_on_more_ranks_than_rows(tmp_path: Path, ranks: int) -> None:
    """One to four dofs: the reduced body is the body."""
    for n in (1, 2, 4):
        K = sp.diags([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsr()
        B = np.zeros((n, 1))
        B[-1] = 1
        body, out = tmp_path / "b.h5", tmp_path / "r.h5"
        write_matrices(body, K * 1e6, sp.eye(n).tocsr(), B, alpha=3.0)
        run(
            "reduce",
            "-body",
            body,
            "-mor_band_hz",
            "10,500",
            "-mor_tol",
            "1e-9",
            "-mor_out",
            out,
            ranks=ranks,
        )
        rom = rom_matrices(out)
        for omega in (100.0, 1234.5):
            A = 1e6 * K.toarray() + (3j * omega - omega**2) * np.eye(n)
            exact = B.T @ np.linalg.solve(A, B)
            assert abs(rom_transfer(rom, omega) - exact) < 1e-9 * abs(exact)
    write_matrices(body, K * 0, sp.eye(n).tocsr(), B)  # nothing but rigid modes
    told = run("reduce", "-body", body, "-mor_out", out, ranks=ranks).out
    assert "reduced modes  4 rigid, up to 0 Hz\n" in told and "nan" not in told
    write_matrices(body, K, sp.eye(n).tocsr() * -1, B)
    refused = run("reduce", "-body", body, "-mor_out", out, ranks=ranks, expect=1)
    assert "negative" in message(refused)


@pytest.mark.parametrize("verb", ["reduce", "certify", "import (mesh)", "export npz", "report"])
def test_kills(verb: str) -> None:
    script = Path(__file__).with_name("kills.py")
    done = subprocess.run(
        [str(PYTHON), str(script), "2", "5", "--verb", verb],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].split()[-2:] == ["2", "2"]
