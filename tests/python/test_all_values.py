"""Claims for every value of the parameters, everywhere in the band, against the full body at values
and frequencies that the program was not given."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from test_parameters import BAND, TWO_PI, chain, frequencies, small, springs, with_values

import flexgram
from conftest import run
from flexgram import Matrices, ReducedModel
from referee import relative_error

LOSSY = flexgram.parameter(1.0, 4.0, 1.5, loss=0.3)
DAMPED = {"eta": 0.1}


def values_of(rom: ReducedModel, trials: int) -> Iterator[dict[str, float]]:
    """Of the parameters: all corners of the box, then any."""
    laws, rng = rom.system.parameters, np.random.default_rng(7)
    for corner in range(2 ** len(laws)):
        yield {
            name: (law.least, law.most)[corner >> j & 1]
            for j, (name, law) in enumerate(laws.items())
        }
    for _ in range(trials):
        yield {name: float(rng.uniform(law.least, law.most)) for name, law in laws.items()}


def worst_error(rom: ReducedModel, a: dict[str, Any], trials: int) -> float:
    """Largest error, in extended precision, with values of the box, over frequencies of the band
    and resonances with these values."""
    worst = 0.0
    for values in values_of(rom, trials):
        model = rom.at(**values)
        assert model.kind == "certified"
        full = with_values(a, DAMPED, **values)
        errors = (relative_error(full, small(model), w) for w in frequencies(model))
        worst = max(worst, *errors)
    return worst


@pytest.mark.parametrize("ranks", [1, 2])
def test_one_parameter(ranks: int, tmp_path: Path) -> None:
    """A third of a chain one to four times as stiff: by files, on one rank and on two."""
    a = chain(soft=LOSSY)
    flexgram.write_matrices(tmp_path / "body.h5", **a, **DAMPED)
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "0.002,0.05"),
        *("-mor_tol", "1e-3", "-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    ).out
    assert "with every value of the parameters in their box (certified;" in said
    rom = ReducedModel.load(tmp_path / "rom.h5")
    (most,) = rom.claim.all_values
    assert rom.met and rom.certified_error <= most <= 1e-3
    assert f"; {most:.1e} with every value between" in rom.claim.label
    assert 0.1 * most < worst_error(rom, a, 8) <= most
    between = rom.at(soft=2.345)
    between.save(tmp_path / "at.h5")
    for model in (between, ReducedModel.load(tmp_path / "at.h5")):
        claim = model.claim
        assert claim.kind == "certified" and claim.tolerance == 1e-3 and claim.met
        assert model.certified_error == claim.whole == most and "soft = 2.345" in claim.label
    known = rom.at(soft=4.0)
    assert known.certified_error == rom.certified_error


def test_two_parameters_and_kinds() -> None:
    """Two parameters, outputs that are not the inputs, moments beside forces in another unit."""
    a = chain(
        soft=flexgram.parameter(1.0, 1.5, 1.2, loss=0.3),
        bolt=flexgram.parameter(1.0, 1.5, 1.2, loss=0.3),
    )
    B, C = np.zeros((60, 2)), np.zeros((2, 60))
    B[59, 0] = C[0, 40] = 1.0
    B[20, 1] = C[1, 59] = 1e-3
    a |= {"B": B, "C": C}
    names = {"inputs": ["tip.fx", "mid.mx"], "outputs": ["tip.fx", "mid.mx"]}
    rom = flexgram.reduce(Matrices(**a, **names, **DAMPED), (0.002, 0.03), 1e-2)
    assert rom.met and len(rom.claim.all_values) == 1 + len(rom.claim.kinds) >= 2
    assert rom.claim.all_values.max() <= 1e-2
    rng = np.random.default_rng(3)
    for values in values_of(rom, 6):
        model = rom.at(**values)
        full = with_values(a, DAMPED, **values)
        for omega in TWO_PI * rng.uniform(0.002, 0.03, 25):
            K = full.K.astype(complex) * (1 + 0.1j) + 1j * full.S - omega**2 * full.M
            H = C @ np.linalg.solve(K, B)
            away = H - model.transfer(omega)
            assert np.linalg.norm(away) <= rom.claim.all_values[0] * np.linalg.norm(H)
            for kind, most in zip(rom.claim.kinds, rom.claim.all_values[1:], strict=True):
                i = 0 if kind.startswith("displacement") else 1
                j = 0 if kind.endswith("force") else 1
                assert abs(away[i, j]) <= most * abs(H[i, j])


def test_beside_viscoelastic_terms() -> None:
    """A parameter beside a Prony series and a table, whose knots lie inside cells."""
    a = chain(soft=flexgram.parameter(1.0, 2.0, 1.5, loss=0.2))
    prony, table = springs(60, 12, 22), springs(60, 52, 59)
    knots = TWO_PI * np.array([0.01, 0.02, 0.04])
    storage, loss = np.array([0.2, 0.3, 0.6]), np.array([0.05, 0.2, 0.1])
    a["terms"] |= {
        "foam": (prony, flexgram.prony([0.5], [3.0])),
        "felt": (table, flexgram.table(knots, storage, loss)),
    }
    rom = flexgram.reduce(Matrices(**a, **DAMPED), (0.01, 0.04), 1e-2)
    assert rom.met and len(rom.claim.all_values)
    K, T = a["K"].toarray(), a["terms"]["soft"][0].toarray()
    rng, worst = np.random.default_rng(5), 0.0
    for value in [1.0, 2.0, *rng.uniform(1.0, 2.0, 8)]:
        model = rom.at(soft=float(value))
        for omega in [*knots, *rng.uniform(knots[0], knots[-1], 40)]:
            A = (1 + 0.1j) * (K + (value - 1) * T) + 0.2j * (value - 1) * T - omega**2 * np.eye(60)
            A = A + 0.5 * 3j * omega / (1 + 3j * omega) * prony.toarray()
            g = np.interp(omega, knots, storage) + 1j * np.interp(omega, knots, loss)
            H = a["B"].T @ np.linalg.solve(A + g * table.toarray(), a["B"])
            away = np.linalg.norm(H - model.transfer(omega)) / np.linalg.norm(H)
            worst = max(worst, away)
    assert 0.05 * rom.claim.all_values[0] < worst <= rom.claim.all_values[0] <= 1e-2


def test_a_singular_mass_and_rigid_motion() -> None:
    """Masses at some nodes only; and a chain that is free."""
    a = chain(soft=LOSSY)
    mass = np.ones(60)
    mass[::3] = 0.0
    a["M"] = sp.diags(mass).tocsc()
    a["B"] = np.eye(60)[:, [59, 20]]
    rom = flexgram.reduce(Matrices(**a, **DAMPED), BAND, 1e-3)
    assert rom.met and len(rom.claim.all_values)
    assert worst_error(rom, a, 6) <= rom.claim.all_values[0] <= 1e-3
    free = chain(soft=LOSSY)
    free["K"] = free["K"] - sp.coo_matrix(([1.0], ([0], [0])), shape=(60, 60))
    rom = flexgram.reduce(Matrices(**free, **DAMPED), (0.004, 0.05), 1e-2)
    assert rom.met and len(rom.claim.all_values)
    assert worst_error(rom, free, 6) <= rom.claim.all_values[0] <= 1e-2


def test_it_is_not_proved() -> None:
    """Relative to the largest response of the band nothing is proved between: other values
    are estimated."""
    a = chain(soft=LOSSY)
    rom = flexgram.reduce(
        Matrices(**a, **DAMPED), BAND, 1e-3, options={"mor_tol_relative_to": "band"}
    )
    assert rom.met and not len(rom.claim.all_values)
    between = rom.at(soft=2.345)
    assert between.kind == "estimated" and rom.at(soft=4.0).kind == "certified"
    assert between.claim.supremum >= max(rom.claim.between_values, rom.claim.supremum)


def test_order_without_a_tolerance() -> None:
    """The error is told of an order that was asked for, too."""
    a = chain(soft=LOSSY)
    rom = flexgram.reduce(Matrices(**a, **DAMPED), BAND, order=14)
    (most,) = rom.claim.all_values
    assert rom.certified_error <= most <= 3 * rom.certified_error
    assert worst_error(rom, a, 6) <= most
