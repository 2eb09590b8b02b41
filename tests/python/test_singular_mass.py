"""Reduced bodies whose mass matrix is singular: assemblies, natural modes, and no state space."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import flexgram
from flexgram import BodyError, ReducedModel
from flexgram.assembly.couple import Joint, couple
from flexgram.body.matrices import Matrices
from flexgram.exporters import export
from flexgram.model.modes import massless, natural_modes


def lumped(rng: np.random.Generator, n: int = 12) -> Matrices:
    """A beam in bending, whose rotations have no inertia; ports at both ends."""
    ends = [(2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3) for k in range(n)]
    size, L, EI = 2 * (n + 1), 1.0 / n, 20.0
    K = np.zeros((size, size))
    k = EI / L**3 * np.array(
        [[12, 6 * L, -12, 6 * L], [6 * L, 4 * L * L, -6 * L, 2 * L * L],
         [-12, -6 * L, 12, -6 * L], [6 * L, 2 * L * L, -6 * L, 4 * L * L]]
    )  # fmt: skip
    for dofs in ends:
        K[np.ix_(dofs, dofs)] += k
    K[0, 0] += 1e3
    K[1, 1] += 1e2
    M = np.diag(np.where(np.arange(size) % 2 == 0, rng.uniform(0.5, 1.5, size) / n, 0.0))
    B = np.zeros((size, 4))
    B[0, 0] = B[1, 1] = B[-2, 2] = B[-1, 3] = 1
    names = ["a.fy", "a.mz", "b.fy", "b.mz"]
    return Matrices(sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=names, alpha=0.2)


def with_massless_coordinate(model: ReducedModel, mass: float = 0.0) -> ReducedModel:
    """The body with a further coordinate without mass (or with little) at port b.fy."""
    system = model.system
    row = np.zeros((1, len(model.inputs)))
    row[0, model.inputs.index("b.fy")] = 1
    stiffness = 50 * float(np.diag(system.K).max())
    return model.with_parts(
        system=dataclasses.replace(
            system,
            M=scipy.linalg.block_diag(system.M, mass),
            D=scipy.linalg.block_diag(system.D, 0.0),
            K=scipy.linalg.block_diag(system.K, stiffness),
            B=np.vstack([system.B, row]),
            C=np.hstack([system.C, row.T]),
        )
    )


def test_assemblies_of_bodies_whose_mass_is_singular() -> None:
    """Joins in both orders and springs: frequencies and H of the assembly are those with a mass
    that is nearly nothing, and so is the claim."""
    bodies = [lumped(np.random.default_rng(seed)) for seed in (1, 2)]
    models = [flexgram.reduce(body, (0.05, 6.0), 1e-5, statics="yes") for body in bodies]
    without = [with_massless_coordinate(m) for m in models]
    assert [massless(m.system.K, m.system.M) for m in without] == [1, 1]
    light = 1e-9 * float(np.diag(without[0].system.M).max())
    for joint in (
        Joint("x.b", "y.a", directions=("y", "rz")),
        Joint("x.b", "y.b", directions=("y",)),
        Joint("x.b", "y.b", stiffness={"y": 1e3}),
    ):
        for order in (1, -1) if joint.second == "y.a" else (1,):
            found, expected = (
                couple(dict(zip("xy", some[::order], strict=True)), [joint])
                for some in (without, [with_massless_coordinate(m, light) for m in models])
            )
            values = scipy.linalg.eigvals(found.K, found.M)  # QZ: infinite ones apart
            exact = np.sqrt(np.sort(np.real(values[np.isfinite(values)])))
            slow = exact < 2 * np.pi * 10
            assert slow.sum() > 1
            for body in (found, expected):
                assert np.allclose(body.modes[: slow.sum()], exact[slow], rtol=1e-6)
                assert np.all(np.isfinite(body.modes))
            w = 2 * np.pi * 1.7
            H, other = found.transfer(w), expected.transfer(w)
            assert np.linalg.norm(H - other) < 1e-6 * np.linalg.norm(other)
            assert found.claim.kind == expected.claim.kind


def test_no_state_space_without_mass(tmp_path: Path) -> None:
    model = with_massless_coordinate(
        flexgram.reduce(lumped(np.random.default_rng(1)), (0.05, 6.0), 1e-5)
    )
    for work in (
        lambda: model.state_space(),
        lambda: model.simulate(np.ones((3, 4)), [0, 1, 2]),
        lambda: export(model, tmp_path / "b.pch", "dmig"),
        lambda: export(model, tmp_path / "b.fmu", "fmu"),
    ):
        with pytest.raises(BodyError, match="no mass"):
            work()


def test_natural_modes_of_singular_masses() -> None:
    K, M = np.diag([1.0, 4.0, 2.0]), np.diag([1.0, 1.0, 0.0])
    squares, modes = natural_modes(K, M)
    assert np.allclose(squares[:2], [1, 4]) and squares[2] == np.inf
    assert np.allclose(modes.T @ K @ modes, np.diag([1, 4, 1]))
