"""Dampers at rest that a frame sees which turns with the rotor: circulatory forces that grow with
its speed, ``product(parameter, circulatory())``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from conftest import run
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.model.campbell import campbell

N, TOP = 12, 60.0
INTERNAL, EXTERNAL = 0.4, 0.3  # times the mass [1/s]


def shaft() -> dict[str, Any]:
    """Masses on a string that turns, held at its ends: K, M, and the turn J of each mass."""
    own = sp.diags([np.full(N, 2.0), np.full(N - 1, -1.0), np.full(N - 1, -1.0)], [0, 1, -1])
    M = sp.diags(1 + 0.1 * np.arange(N))
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    return {
        "K": sp.kron(8e3 * own, np.eye(2)).tocsr(),
        "M": sp.kron(M, np.eye(2)).tocsr(),
        "J": sp.kron(M, J).tocsr(),
    }


def body(external: float) -> Matrices:
    a = shaft()
    terms = {
        "spin": (-a["M"], flexgram.spin(0, TOP)),
        "coriolis": (2 * a["J"], flexgram.coriolis(0, TOP)),
    }
    if external:
        law = flexgram.product(flexgram.parameter(0, TOP, TOP), flexgram.circulatory())
        terms["speed:dampers"] = (external * a["J"], law)
    B = np.zeros((2 * N, 2))
    B[8, 0] = B[13, 1] = 1.0
    return Matrices(a["K"], a["M"], B, alpha=INTERNAL + external, terms=terms)


def full(external: float, speed: float, omega: float, B: np.ndarray) -> np.ndarray:
    """H by elimination."""
    a = {key: matrix.toarray() for key, matrix in shaft().items()}
    A = a["K"] - (omega**2 + speed**2) * a["M"] + 1j * omega * (INTERNAL + external) * a["M"]
    A = A + (2j * omega * speed + external * speed) * a["J"]
    return B.T @ np.linalg.solve(A, B)


@pytest.fixture(scope="module")
def rom() -> ReducedModel:
    return flexgram.reduce(body(EXTERNAL), (0.5, 6.0), 1e-4)


def test_the_claim_holds_at_all_speeds(rom: ReducedModel) -> None:
    assert rom.claim.met and rom.order < 2 * N
    B = body(EXTERNAL).B
    rng = np.random.default_rng(7)
    for speed, hertz in zip(rng.uniform(0, TOP, 40), rng.uniform(0.5, 6.0, 40), strict=True):
        H = full(EXTERNAL, speed, 2 * np.pi * hertz, B)
        lost = rom.at(speed=speed).transfer(2 * np.pi * hertz) - H
        assert np.linalg.norm(lost) <= 1e-4 * np.linalg.norm(H)


def test_external_damping_raises_the_limit_of_stability(rom: ReducedModel) -> None:
    """Internal damping alone makes a rotor unstable at its critical speed ω, with external damping
    at ω (1 + c_e/c_i)."""
    a = shaft()
    first = np.sqrt(np.linalg.eigvals(np.linalg.solve(a["M"].toarray(), a["K"].toarray())).min())
    alone = campbell(flexgram.reduce(body(0.0), (0.5, 6.0), 1e-4).system)
    assert alone.unstable == pytest.approx(first.real, rel=1e-4)
    both = campbell(rom.system)
    assert both.unstable == pytest.approx(first.real * (1 + EXTERNAL / INTERNAL), rel=1e-4)
    assert both.unstable < TOP
    # Forward whirl is at rest in the frame where it is as fast as the frame.
    critical = both.critical((0.0,))[0]
    assert critical.speed == pytest.approx(first.real, rel=1e-3)
    for count in (31, 61):  # a speed of the diagram is the critical one
        speeds = np.linspace(0, 2 * first.real, count)[: count * 3 // 4]
        critical = campbell(rom.system, speeds).critical((0.0,))[0]
        assert critical.speed == pytest.approx(first.real, rel=1e-3)


@pytest.mark.parametrize("speed", [10.0, 47.0])
def test_poles_are_those_of_a_body_with_fixed_numbers(rom: ReducedModel, speed: float) -> None:
    a = {key: matrix.toarray() for key, matrix in shaft().items()}
    stiffness = a["K"] - speed**2 * a["M"] + speed * EXTERNAL * a["J"]
    damping = (INTERNAL + EXTERNAL) * a["M"] + 2 * speed * a["J"]
    states = np.block(
        [
            [np.zeros((2 * N, 2 * N)), np.eye(2 * N)],
            [-np.linalg.solve(a["M"], stiffness), -np.linalg.solve(a["M"], damping)],
        ]
    )
    poles = np.linalg.eigvals(states)
    nearest = min(poles[poles.imag > 0], key=abs)
    assert min(abs(rom.at(speed=speed).poles() - nearest)) < 1e-4 * abs(nearest)


def test_it_is_kept_in_files_and_on_two_ranks(rom: ReducedModel, tmp_path: Path) -> None:
    given = body(EXTERNAL)
    flexgram.write_matrices(
        tmp_path / "b.h5", given.K, given.M, given.B, alpha=given.alpha, terms=given.terms
    )
    found = []
    for ranks in (1, 2):
        said = run(
            *("reduce", tmp_path / "b.h5", "--band", "0.5,6", "--tol", "1e-4"),
            *("-o", tmp_path / "r.h5"),
            ranks=ranks,
        )
        assert "is unstable with speed = 60" in said.out + said.err
        again = ReducedModel.load(tmp_path / "r.h5")
        found.append(again.at(speed=33.0).transfer([9.0, 21.0]))
        assert again.order == rom.order
    np.testing.assert_allclose(found[0], rom.at(speed=33.0).transfer([9.0, 21.0]), rtol=1e-6)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


def test_what_is_refused() -> None:
    speed = flexgram.parameter(0, TOP, TOP)
    a = shaft()
    B = np.eye(2 * N)[:, :2]
    for name, law in (("speed", speed), ("speed:c", flexgram.product(speed, flexgram.viscous()))):
        with pytest.raises(BodyError, match="that is the parameter of bodies that spin"):
            matrices = Matrices(a["K"], a["M"], B, alpha=1.0, terms={name: (a["M"], law)})
            flexgram.reduce(matrices, (0.5, 6.0), 1e-2)
    law = flexgram.product(speed, flexgram.circulatory())
    with pytest.raises(BodyError, match="skew"):
        matrices = Matrices(a["K"], a["M"], B, alpha=1.0, terms={"speed:c": (a["M"], law)})
        flexgram.reduce(matrices, (0.5, 6.0), 1e-2)
