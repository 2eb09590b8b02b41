"""Campbell diagrams of springs and masses that turn: critical speeds, and where a motion grows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from flexgram import ReducedModel
from flexgram.model.campbell import campbell


def springs(stiffness: Any, top: float, coriolis: float = 1.0, **more: Any) -> ReducedModel:
    """Unit masses on springs, in pairs across the axis of a spin; reduced to themselves."""
    K = sp.diags(np.asarray(stiffness, float)).tocsr()
    n = K.shape[0]
    M = sp.identity(n).tocsr()
    G = coriolis * sp.kron(sp.identity(n // 2), np.array([[0, -2.0], [2.0, 0]])).tocsr()
    terms = {"spin": (-M, flexgram.spin(0, top))}
    if coriolis:
        terms["coriolis"] = (G, flexgram.coriolis(0, top))
    body = flexgram.Matrices(K, M, np.eye(n), terms=terms, **({"alpha": 1e-3} | more))
    return flexgram.reduce(body, (0.01, 0.1), order=n)


def test_modes_that_pass_zero_and_those_that_fly_apart() -> None:
    """A mass on equal springs passes its critical speed and goes on; on unequal ones it flies apart
    between both; without Coriolis forces it does from the first on."""
    (one,) = campbell(springs([4.0, 4.0], 3.0).system, np.linspace(0, 3, 32)).critical((0.0,))
    assert one.speed == pytest.approx(2, rel=1e-9)
    unequal = campbell(springs([4.0, 9.0], 3.6).system, np.linspace(0, 3.6, 61))
    inside = (unequal.speeds > 2.001) & (unequal.speeds < 2.999)
    assert np.all(unequal.growth[inside] > 0.01)
    outside = (unequal.speeds < 1.999) | (unequal.speeds > 3.001)
    assert np.all(unequal.growth[outside] < 1e-3)
    assert np.isnan(unequal.omega[inside]).any() and not np.isnan(unequal.omega[outside]).any()
    assert [one.speed for one in unequal.critical((0.0,))] == pytest.approx([2, 3], rel=1e-9)
    assert unequal.unstable == pytest.approx(2, rel=1e-3)
    still = campbell(springs([1.0, 4.0], 3.0, coriolis=0.0).system, np.linspace(0, 3, 61))
    assert np.all(still.growth[still.speeds > 1.05] > 0.1)
    speeds = [round(one.speed, 2) for one in still.critical((0.0,))]
    assert speeds == [1.0, 2.0]
    for one in campbell(springs([4.0, 4.0], 2.0).system, np.linspace(0, 2, 21)).critical():
        assert one.speed == pytest.approx(1.0, abs=1e-3)  # ω₀ - Ω = Ω, at a speed of the grid


@pytest.mark.parametrize("count", [2, 9, 51, 61, 251])
def test_a_critical_speed_that_the_diagram_meets(count: int) -> None:
    """A pole is real there, and the mode has no frequency: the speed is told all the same."""
    for damping in (1e-3, 0.8):
        rom = springs([4.0, 4.0], 2.5, alpha=damping)
        found = campbell(rom.system, np.linspace(0, 2.5, count))
        assert [one.speed for one in found.critical((0.0,))] == pytest.approx([2], rel=1e-9)
        assert found.unstable is None or found.unstable > 2 - 1e-6


def test_motions_damped_beyond_vibrating_are_no_modes() -> None:
    """Real poles, whose imaginary parts are rounding, have no critical speed."""
    K = np.diag([4.0, 4.0, 1e10, 1.02e10])
    M = np.eye(4)
    G = np.kron(np.eye(2), np.array([[0, -2.0], [2.0, 0]]))
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((4, 4)))[0]
    terms = {
        "spin": (sp.csr_matrix(turn.T @ np.diag([-1.0, -1, 0, 0]) @ turn), flexgram.spin(0, 1.5)),
        "coriolis": (sp.csr_matrix(turn.T @ G @ turn), flexgram.coriolis(0, 1.5)),
    }
    body = flexgram.Matrices(
        sp.csr_matrix(turn.T @ K @ turn),
        sp.csr_matrix(M),
        np.eye(4),
        beta=2.0000001e-5,
        terms=terms,
    )
    found = campbell(flexgram.reduce(body, (0.01, 0.1), order=4).system)
    assert found.critical((0.0,)) == []
    vibrating = np.isfinite(found.omega)
    assert np.all(found.omega[vibrating] > 0.4)


def test_modes_on_lines_have_no_critical_speeds() -> None:
    """Directions that the spin does not move."""
    n = 8
    rng = np.random.default_rng(4)
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    across = np.diag([1.0, 1.0] + [0.0] * (n - 2))
    G = np.zeros((n, n))
    G[0, 1], G[1, 0] = -2.0, 2.0
    K = np.diag([50.0, 50.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    terms = {
        "spin": (sp.csr_matrix(-turn.T @ across @ turn), flexgram.spin(0, 3.0)),
        "coriolis": (sp.csr_matrix(turn.T @ G @ turn), flexgram.coriolis(0, 3.0)),
    }
    body = flexgram.Matrices(
        sp.csr_matrix(turn.T @ K @ turn), sp.identity(n).tocsr(), np.eye(n), alpha=0.01, terms=terms
    )
    rom = flexgram.reduce(body, (0.01, 0.5), order=n)
    found = campbell(rom.system)
    assert found.critical((0.0,)) == []
    assert not np.isnan(found.omega).any()
