"""The certified error of the whole field, in the norm of the strain energy, against full solves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from assemblies import random_body
from scipy.sparse.linalg import splu

import flexgram
from bodies import box, write_body_file
from conftest import body_system, run
from flexgram import ReducedModel
from flexgram.body.matrices import Matrices

LETTERS = {"force": "f", "moment": "m"}


def largest_errors(
    rom: ReducedModel, K: Any, M: Any, B: Any, damping: tuple[float, float, float], omega: Any
) -> dict[str, float]:
    """Of each kind of inputs, over some frequencies, by full solves."""
    alpha, beta, eta = damping
    worst = dict.fromkeys(rom.field_inputs, 0.0)
    for w in omega:
        A = K * (1 + 1j * eta + 1j * w * beta) + M * (1j * w * alpha - w * w)
        X = splu(sp.csc_matrix(A)).solve(B.astype(complex))
        q = np.linalg.solve(rom.K * (1 + 1j * rom.eta) + 1j * w * rom.D - w * w * rom.M, rom.B)
        away = X - rom.V @ q
        energy, lost = (np.einsum("ij,ij->j", Y.conj(), K @ Y).real for Y in (X, away))
        for kind in worst:
            mine = [
                j
                for j, port in enumerate(rom.inputs)
                if kind == "all ports" or port.rpartition(".")[2][0] == LETTERS[kind]
            ]
            worst[kind] = max(worst[kind], float(np.sqrt(lost[mine].sum() / energy[mine].sum())))
    return worst


def chosen_omega(rom: ReducedModel, rng: np.random.Generator) -> Any:
    """Random ones, and beside resonances; none that the claim leaves out."""
    first, last = rom.bands[0, 0], rom.bands[-1, 1]
    beside = rom.modes[(rom.modes > first) & (rom.modes < last / 1.001)] * 1.0003
    w = np.concatenate([rng.uniform(first, last, 12), beside, [first, last]])
    out = (
        np.any([(w >= a) & (w <= b) for a, b in rom.excluded], axis=0)
        if len(rom.excluded)
        else np.zeros(len(w), dtype=bool)
    )
    return w[~out]


def assert_claimed(rom: ReducedModel, truth: dict[str, float], sharp: float) -> None:
    for kind, claim in zip(rom.field_inputs, rom.field_error, strict=True):
        assert truth[kind] <= claim * (1 + 1e-6), kind
        assert claim <= sharp * truth[kind] + 1e-9, kind  # rounding of plain sums is in the claim


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("support", [False, True])
@pytest.mark.parametrize("damping", [(3.0, 2e-6, 0.0), (0.0, 0.0, 0.01), (0.0, 0.0, 0.0)])
def test_field_of_a_beam(
    damping: tuple[float, float, float], support: bool, ranks: int, tmp_path: Path
) -> None:
    mesh = box("tetra10", (8, 2, 2), (0.3, 0.04, 0.03))
    names = ("end",) if support else ("start", "end")
    write_body_file(
        tmp_path / "beam.h5",
        mesh,
        damping=damping,
        interfaces={n: {"coupling": "rigid", "set": n} for n in names},
        supports={"start": [0, 1, 2]} if support else None,
    )
    out = run(
        "reduce",
        "-body",
        tmp_path / "beam.h5",
        "-mor_band_hz",
        "10,4000",
        "-mor_tol",
        "1e-4",
        "-mor_field_error",
        *(["yes"] if ranks == 1 else []),  # a flag alone too
        "-mor_out",
        tmp_path / "rom.h5",
        ranks=ranks,
    ).out
    assert "of the square root of its strain energy" in out
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.field_inputs == ["all ports", "force", "moment"]
    run(
        "assemble",
        "-body",
        tmp_path / "beam.h5",
        "-body_out",
        tmp_path / "matrices.h5",
        ranks=ranks,
    )
    full = body_system(tmp_path / "matrices.h5")
    omega = chosen_omega(rom, np.random.default_rng(5))
    truth = largest_errors(rom, full.K, full.M, full.B, damping, omega)
    assert_claimed(rom, truth, 2)


def test_random_bodies() -> None:
    rng = np.random.default_rng(11)
    for _ in range(25):
        K, M, B, names, alpha, beta = random_body(rng, 6)
        M[rng.choice(len(M), 3, replace=False)] = 0  # massless dofs
        given = Matrices(
            sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=names, alpha=alpha, beta=beta
        )
        rom = flexgram.reduce(
            given, (0.05, 0.6), float(10 ** rng.uniform(-5, -1)), options={"mor_field_error": "yes"}
        )
        truth = largest_errors(rom, K, M, B, (alpha, beta, 0.0), chosen_omega(rom, rng))
        assert_claimed(rom, truth, 10)


def test_with_a_damping_matrix_nothing_is_claimed() -> None:
    rng = np.random.default_rng(12)
    K, M, B, names, alpha, _ = random_body(rng, 6)
    D = np.zeros_like(K)
    D[3, 3] = 0.2
    given = Matrices(
        sp.csr_matrix(K), sp.csr_matrix(M), B, D=sp.csr_matrix(D), inputs=names, alpha=alpha
    )
    rom = flexgram.reduce(given, (0.05, 0.6), 1e-3, options={"mor_field_error": "yes"})
    assert rom.kind == "certified" and np.isinf(rom.field_error).all()
    assert ("field", "its error is not known: dampers") in [
        (key, words.split(",")[0]) for key, words in rom.provenance.plan
    ]
    assert len(flexgram.reduce(given, (0.05, 0.6), 1e-3).field_error) == 0


def test_of_which_inputs_it_is(tmp_path: Path) -> None:
    """With load patterns of these loads; with pod, whose errors are estimated, there is none."""
    rng = np.random.default_rng(13)
    K, M, B, names, alpha, beta = random_body(rng, 6)
    given = Matrices(sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=names, alpha=alpha, beta=beta)
    options = {"mor_field_error": "yes", "mor_load_patterns": 2}
    rom = flexgram.reduce(given, (0.05, 0.6), 1e-3, options=options)
    assert rom.field_inputs == ["these loads"]
    omega = chosen_omega(rom, rng)
    along = ReducedModel(
        {
            "K": rom.K,
            "M": rom.M,
            "D": rom.D,
            "B": rom.B @ rom.loads,
            "C": rom.C,
            "V": rom.V,
            "error/field_inputs": ["all ports"],
        },
        None,
    )
    truth = largest_errors(along, K, M, B @ rom.loads, (alpha, beta, 0.0), omega)["all ports"]
    assert truth <= rom.field_error[0] * (1 + 1e-6)
    rom.save(tmp_path / "rom.h5")
    assert "field, by its strain energy" in run("info", tmp_path / "rom.h5").out
    with pytest.raises(flexgram.BodyError, match="no with method pod"):
        flexgram.reduce(given, (0.05, 0.6), 1e-3, method="pod", options={"mor_field_error": "yes"})
