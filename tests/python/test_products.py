"""Products: Prony terms, tables, dampers and loss factors times a parameter."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp

import flexgram
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.body.terms import law_of
from flexgram.body.varying_laws import Product
from flexgram.model.damped_modes import sensitivities

BAND = (0.05, 0.2)
N = 36
E = flexgram.parameter(1.0, 3.0, 2.0, slope=0.5)
C = flexgram.parameter(0.2, 0.8, 0.5)
OMEGA = 2 * np.pi * np.array([0.0, 0.1, 0.2, 0.3, 0.6])
LAWS = {
    "relaxation": flexgram.prony([0.4, 0.3], [0.3, 2.0]),
    "table": flexgram.table(OMEGA, [0.0, 0.2, 0.3, 0.7, 0.8], [0.1, 0.3, 0.2, 0.1, 0.1]),
    "lost": flexgram.loss(0.3),
}


def chain(first: int, last: int) -> Any:
    """Springs of 10 N/m between some of N masses of a line, the first on the ground."""
    K = np.zeros((N, N))
    for k in range(first, last):
        K[k, k] += 10
        if k > 0:
            K[k - 1, k - 1] += 10
            K[k - 1, k] -= 10
            K[k, k - 1] -= 10
    return K


SOFT, STIFF, DAMPER = chain(0, N // 3), chain(N // 3, N), np.zeros((N, N))
DAMPER[N - 1, N - 1] = 1.0
B = np.eye(N)[:, [N // 2, N - 1]]


def write(path: Path, kinds: tuple[str, ...]) -> None:
    terms: dict[str, Any] = {"E": (sp.csr_matrix(SOFT), E)}
    terms |= {f"E:{kind}": (sp.csr_matrix(SOFT), flexgram.product(E, LAWS[kind])) for kind in kinds}
    terms["c"] = (sp.csr_matrix(DAMPER), flexgram.product(C, flexgram.viscous()))
    K = STIFF + E.slope * E.least * SOFT
    flexgram.write_matrices(
        path,
        sp.csr_matrix(K),
        sp.eye(N).tocsr(),
        B,
        inputs=["middle", "end"],
        alpha=0.01,
        terms=terms,
    )


def exact(kinds: tuple[str, ...], modulus: float, damper: float, w: float) -> Any:
    """H of the full body, from the definitions."""
    g = 1.0 + sum(complex(LAWS[kind].at(w)) for kind in kinds)
    A = STIFF + E.slope * modulus * g * SOFT + 1j * w * damper * DAMPER
    return B.T @ sl.solve(A + (0.01j * w - w * w) * np.eye(N), B)


@pytest.mark.parametrize(
    ("kinds", "ranks"),
    [(("relaxation",), 1), (("table", "lost"), 2), (("relaxation", "table"), 1)],
)
def test_a_modulus_that_varies_and_relaxes(
    kinds: tuple[str, ...], ranks: int, tmp_path: Path
) -> None:
    """And a damper: claimed with values at the corners, and with all between, where that closes;
    true at frequencies and values that no program was given."""
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write(body, kinds)
    done = run(
        *("reduce", "-body", body, "-mor_band_hz", "0.05,0.2", "-mor_tol", "1e-3"),
        *("-mor_out", out),
        ranks=ranks,
    )
    assert "E from 1 to 3 (2), c from 0.2 to 0.8 (0.5)" in done.out
    rom = ReducedModel.load(out)
    assert rom.met and rom.kind == "certified" and rom.order < N
    assert list(rom.system.parameters) == ["E", "c"]
    rng = np.random.default_rng(3)
    values = [tuple(row) for row in rom.claim.parameter_values]
    assert {(1.0, 0.2), (1.0, 0.8), (3.0, 0.2), (3.0, 0.8)} <= set(values)
    for modulus, damper in values:
        at = rom.at(E=modulus, c=damper)
        assert at.kind == "certified"
        for hertz in rng.uniform(*BAND, 12):
            w = 2 * np.pi * float(hertz)
            H = exact(kinds, modulus, damper, w)
            error = np.linalg.norm(at.transfer(w) - H) / np.linalg.norm(H)
            assert error <= rom.certified_error
    if not len(rom.claim.all_values):
        return
    for hertz, e, c in rng.uniform([BAND[0], 1.0, 0.2], [BAND[1], 3.0, 0.8], (40, 3)):
        w, at = 2 * np.pi * float(hertz), rom.at(E=e, c=c)
        H = exact(kinds, e, c, w)
        assert at.kind == "certified"
        assert np.linalg.norm(at.transfer(w) - H) <= at.certified_error * np.linalg.norm(H)


def test_one_value_in_time_and_in_a_file(tmp_path: Path) -> None:
    """With one value a Prony term is scaled and a damper joins D; a file holds both; the state
    space has the same H."""
    write(tmp_path / "body.h5", ("relaxation",))
    rom = flexgram.reduce(tmp_path / "body.h5", BAND, tol=1e-3)
    at = rom.at(E=3.0, c=0.2)
    assert [term.law.kind for term in at.system.terms] == ["prony"]
    at.save(tmp_path / "at.h5")
    again = ReducedModel.load(tmp_path / "at.h5")
    w = 1.1
    H = exact(("relaxation",), 3.0, 0.2, w)
    assert np.array_equal(again.transfer(w), at.transfer(w))
    assert np.linalg.norm(again.transfer(w) - H) <= rom.certified_error * np.linalg.norm(H)
    A, inputs, outputs, _ = again.state_space()
    in_time = outputs @ np.linalg.solve(1j * w * np.eye(len(A)) - A, inputs)
    assert np.linalg.norm(in_time - at.transfer(w)) <= 1e-9 * np.linalg.norm(H)


def test_how_modes_move_with_a_modulus_that_relaxes() -> None:
    """The sensitivity of natural frequencies, that of the Prony term too, against differences of
    the full body's, each with the stiffness at its own frequency."""
    terms = {"E": (SOFT, E), "E:relaxation": (SOFT, flexgram.product(E, LAWS["relaxation"]))}
    body = flexgram.Matrices(
        *(sp.csr_matrix(STIFF + E.slope * SOFT), sp.eye(N).tocsr(), B),
        alpha=0.01,
        terms={name: (sp.csr_matrix(T), law) for name, (T, law) in terms.items()},
    )
    slope = sensitivities(flexgram.reduce(body, BAND, tol=1e-6).system)["E"][:3]

    def frequency(modulus: float, mode: int) -> float:
        w = 0.1
        for _ in range(200):
            g = 1 + complex(LAWS["relaxation"].at(w)).real
            w = float(np.sqrt(sl.eigvalsh(STIFF + E.slope * modulus * g * SOFT)[mode]))
        return w

    step = 1e-4
    for mode in range(3):
        high, low = (frequency(2.0 * (1 + sign * step), mode) for sign in (1, -1))
        own = (high - low) / (high + low) / step  # with g that moves with ω
        w = frequency(2.0, mode)
        change = (complex(LAWS["relaxation"].at(w * (1 + step))) - LAWS["relaxation"].at(w)).real
        shape = sl.eigh(STIFF + 2 * E.slope * (1 + complex(LAWS["relaxation"].at(w)).real) * SOFT)[
            1
        ][:, mode]
        follows = E.slope * 2.0 * change / step * (shape @ SOFT @ shape) / (2 * w * w)
        assert slope[mode] == pytest.approx(own * (1 - follows), rel=1e-3)


def test_laws_that_no_parameter_multiplies() -> None:
    for law in (E, flexgram.spin(0, 1), flexgram.coriolis(0, 1)):
        with pytest.raises(BodyError, match="a parameter multiplies viscous"):
            flexgram.product(C, law)
    with pytest.raises(BodyError, match="must not be negative"):
        flexgram.product(flexgram.parameter(-1, 1, 0), flexgram.viscous())
    with pytest.raises(BodyError, match="no loss factor of its own"):
        flexgram.product(flexgram.parameter(1, 2, loss=0.1), flexgram.viscous())
    with pytest.raises(BodyError, match="a loss factor of zero"):
        flexgram.product(C, flexgram.loss(0))
    for one, other in product((E, C), (flexgram.viscous(), *LAWS.values())):
        law = flexgram.product(one, other)
        read = law_of(law.kind, law.numbers(), "x")
        assert isinstance(read, Product)
        assert np.array_equal(read.at([0.3, 2.0]), law.at([0.3, 2.0]))


def test_one_parameter_has_one_range(tmp_path: Path) -> None:
    other = flexgram.parameter(1.0, 4.0, 2.0)
    terms = {
        "E": (sp.csr_matrix(SOFT), E),
        "E:relaxation": (sp.csr_matrix(SOFT), flexgram.product(other, LAWS["relaxation"])),
    }
    body = flexgram.Matrices(sp.csr_matrix(STIFF + SOFT), sp.eye(N).tocsr(), B, terms=terms)
    with pytest.raises(Exception, match="most of E is 3 and 4"):
        flexgram.reduce(body, BAND, tol=1e-3)
