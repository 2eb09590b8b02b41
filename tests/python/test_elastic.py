"""Errors relative to the elastic part of H: what counts of a free body that joints hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp

from bodies import box, write_body_file
from conftest import assembled, message, run
from flexgram import BodyError, Matrices, ReducedModel, certify, reduce
from flexgram.assembly.couple import Joint, couple

LAST = 100.0
ALPHA, BETA = 3.0, 1e-6


class Free:
    """A free bar by all of its modes, from LAPACK: the first six are rigid."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "bar.h5"
        ends = {name: {"set": name, "coupling": "distributing"} for name in ("start", "end")}
        write_body_file(
            self.path,
            box("hexahedron20", (10, 2, 2), (1.0, 0.1, 0.08)),
            interfaces=ends,
            damping=(ALPHA, BETA, 0),
        )
        body = assembled(folder / "matrices.h5", self.path)
        self.K, self.M, self.B = body["K"].tocsr(), body["M"].tocsr(), body["B"]
        self.eigenvalues, modes = sl.eigh(self.K.toarray(), self.M.toarray())
        assert self.eigenvalues[5] < 1e-3 * self.eigenvalues[6]
        self.loads = modes.T @ self.B

    def elastic(self, omega: float, B: Any = None) -> Any:
        loads = (self.loads if B is None else B)[6:]
        values = self.eigenvalues[6:]
        a = values * (1 + 1j * omega * BETA) + 1j * omega * ALPHA - omega**2
        return loads.T @ (loads / a[:, None])

    def transfer(self, omega: float) -> Any:
        """H of the bar whose rigid modes have no stiffness at all: the stored K holds roundings."""
        rigid = self.loads[:6]
        return self.elastic(omega) + rigid.T @ rigid / (1j * omega * ALPHA - omega**2)

    def worst(self, rom: ReducedModel, first: float = 1.0) -> float:
        """Largest error of the elastic part, at frequencies that the program does not know."""
        r = int(rom.frame["rigid_modes"])
        assert r == 6 and np.abs(rom.M[:r, r:]).max() < 1e-9 * np.abs(rom.M).max()
        e = slice(r, None)
        worst = 0.0
        for omega in 2 * np.pi * np.geomspace(1.003 * first, 0.997 * LAST, 61):
            A = (1 + 1j * rom.eta) * rom.K[e, e] + 1j * omega * rom.D[e, e] - omega**2 * rom.M[e, e]
            H = self.elastic(omega)
            error = rom.C[:, e] @ np.linalg.solve(A, rom.B[e]) - H
            worst = max(worst, np.linalg.norm(error) / np.linalg.norm(H))
        return worst


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Free:
    return Free(tmp_path_factory.mktemp("free"))


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
def test_the_elastic_part_is_certified(bar: Free, ranks: int, tmp_path: Path) -> None:
    worst = {}
    for reference in ("pointwise", "elastic"):
        out = tmp_path / f"{reference}.h5"
        said = run(
            "reduce",
            "-body",
            bar.path,
            "-mor_band_hz",
            f"1,{LAST}",
            "-mor_tol",
            2e-2,
            "-mor_tol_of",
            "whole",
            "-mor_tol_relative_to",
            reference,
            "-mor_out",
            out,
            ranks=ranks,
        )
        rom = ReducedModel.load(out)
        worst[reference] = bar.worst(rom)
        assert rom.relative_to == reference and rom.kind == "certified"
        if reference == "pointwise":
            # What the claim does not say is said beside it.
            assert "the body is free, and its error is" in said.err + said.out
        else:
            assert worst[reference] <= rom.certified_error <= 2e-2
            assert rom.certified_error <= 1.3 * worst[reference]
    assert worst["pointwise"] > 0.5 and worst["elastic"] < 2e-2


def test_a_medium_model_and_its_cuts(bar: Free, tmp_path: Path) -> None:
    medium = certify(
        bar.path, band_hz=(1, LAST), tol=1e-5, options={"mor_tol_relative_to": "elastic"}
    )
    medium.save(tmp_path / "medium.h5")
    elastic = {"mor_tol_relative_to": "elastic", "mor_tol_of": "whole"}
    for stage in ("weighted", "optimal"):
        rom = medium.reduce(tol=1e-3, options={**elastic, "mor_second_stage": stage})
        assert bar.worst(rom) <= rom.certified_error <= 1e-3
    # The same medium model serves the other references.
    rom = medium.reduce(tol=1e-3, options={"mor_tol_relative_to": "band"})
    assert rom.certified_error <= 1e-3 and rom.relative_to == "band"


def test_many_ports(bar: Free) -> None:
    rng = np.random.default_rng(3)
    rows = rng.permutation(bar.K.shape[0])[:90]
    B = np.zeros((bar.K.shape[0], 90))
    B[rows, range(90)] = 1
    body = Matrices(K=bar.K, M=bar.M, B=B, alpha=ALPHA, beta=BETA)
    rom = reduce(body, (1, LAST), 1e-2, options={"mor_tol_relative_to": "elastic"})
    many = object.__new__(Free)
    modes = sl.eigh(bar.K.toarray(), bar.M.toarray())[1]
    many.eigenvalues, many.loads = bar.eigenvalues, modes.T @ B
    assert many.worst(rom) <= rom.certified_error <= 2e-2


def test_where_there_is_no_elastic_part_by_itself(bar: Free, tmp_path: Path) -> None:
    D = sp.lil_matrix(bar.K.shape)
    D[5, 5] = 2.0
    damped = Matrices(K=bar.K, M=bar.M, B=bar.B, D=D.tocsr())
    with pytest.raises(BodyError, match="H has no elastic part by itself"):
        reduce(damped, (1, LAST), 1e-2, options={"mor_tol_relative_to": "elastic"})
    wrong = run("reduce", "-body", bar.path, "-mor_tol_relative_to", "elastc", expect=1)
    assert "did you mean elastic?" in message(wrong)
    # A held body has no rigid motion: both are the same.
    held = Matrices(K=bar.K + 1e6 * bar.M, M=bar.M, B=bar.B, alpha=ALPHA)
    both = [
        reduce(held, (1, LAST), 1e-3, options={"mor_tol_relative_to": reference})
        for reference in ("pointwise", "elastic")
    ]
    assert both[0].order == both[1].order
    assert both[0].certified_error == pytest.approx(both[1].certified_error, rel=1e-6)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("stage", ["auto", "optimal", "krylov"])
def test_statics_are_exact(bar: Free, stage: str, ranks: int, tmp_path: Path) -> None:
    """Far below the band the elastic part of a free body is that of the medium model."""
    off = {}
    for statics in ("no", "yes"):
        out = tmp_path / f"{statics}.h5"
        run(
            "reduce",
            "-body",
            bar.path,
            "-mor_band_hz",
            f"30,{LAST}",
            "-mor_tol",
            1e-2,
            "-mor_statics",
            statics,
            "-mor_second_stage",
            stage,
            "-mor_medium_tol",
            1e-9,
            "-mor_out",
            out,
            ranks=ranks,
        )
        rom = ReducedModel.load(out)
        assert rom.certified_error <= 1e-2
        part, omega = rom.elastic(), 2 * np.pi * 0.01
        H = bar.elastic(omega)
        off[statics] = np.linalg.norm(part.transfer(omega) - H) / np.linalg.norm(H)
    assert off["yes"] < 1e-6 and off["yes"] < 0.01 * off["no"]


@pytest.mark.parametrize("frame", ["buckens", "tangent", "none"])
def test_elastic_part_in_any_frame(frame: str, bar: Free) -> None:
    """Without its rigid modes the reduced body answers like the full one without its own; in a
    tangent frame the elastic coordinates by themselves are a body that is held there."""
    rom = reduce(
        bar.path, (1, LAST), 1e-4, options={"mor_frame": frame, "mor_tol_relative_to": "elastic"}
    )
    part = rom.without_rigid_modes()
    assert part.order == rom.order - 6 and part.frame["rigid_modes"] == 0
    for hertz in (1.7, 23.0, 96.0):
        omega = 2 * np.pi * hertz
        H = bar.elastic(omega)
        assert np.linalg.norm(part.transfer(omega) - H) <= rom.certified_error * np.linalg.norm(H)
    if frame == "tangent":
        held = rom.elastic().transfer(omega)
        assert np.linalg.norm(held - H) > 0.1 * np.linalg.norm(H)
    on_springs = couple(
        {"bar": rom}, [Joint("bar.start", "ground", stiffness={"x": 1e4})], keep=["bar.start"]
    )
    assert on_springs.kind == "certified"
    g = bar.B[:, rom.inputs.index("start.fx")]
    for hertz in (2.3, 17.0, 99.0):
        omega = 2 * np.pi * hertz
        A = (1 + 1j * omega * BETA) * bar.K + 1j * omega * ALPHA * bar.M - omega**2 * bar.M
        H = bar.B.T @ np.linalg.solve(A.toarray() + 1e4 * np.outer(g, g), bar.B)
        off = np.linalg.norm(on_springs.transfer(omega) - H)
        assert off <= on_springs.certified_error * np.linalg.norm(H)


def test_statics_of_a_held_body(bar: Free) -> None:
    # Springs to the ground.
    held = Matrices(
        K=bar.K + 1e6 * sp.identity(bar.K.shape[0], format="csr"), M=bar.M, B=bar.B, alpha=ALPHA
    )
    rom = reduce(held, (50, LAST), 1e-2, options={"mor_statics": "yes", "mor_medium_tol": 1e-9})
    exact = bar.B.T @ sp.linalg.spsolve(held.K.tocsc(), bar.B)
    assert np.linalg.norm(rom.transfer(0.0) - exact) <= 1e-6 * np.linalg.norm(exact)


def springs(pairs: list[tuple[int, int]], n: int, rng: Any) -> Any:
    K = np.zeros((n, n))
    for i, j in pairs:
        k = 1e4 * rng.uniform(0.5, 2)
        K[np.ix_([i, j], [i, j])] += k * np.array([[1, -1], [-1, 1]])
    return K


@pytest.mark.kernels
@pytest.mark.parametrize(("parts", "seed"), [(1, 4), (1, 9), (1, 22), (12, 7)])
def test_rigid_modes_that_are_hard_to_see(parts: int, seed: int) -> None:
    """Loads like gravity, which move nearly nothing but the whole body: the search leaves its mode
    loose. And more rigid modes than a solid has."""
    rng = np.random.default_rng(seed)
    n = 60 if parts == 1 else 240
    size = n // parts
    pairs = [(i, i + 1) for i in range(n - 1) if (i + 1) % size]
    pairs += [
        (a, b)
        for p in range(parts)
        for a, b in rng.integers(p * size, (p + 1) * size, (3 * size // 2, 2))
        if a != b
    ]
    K, m = springs(pairs, n, rng), rng.integers(1, 5, n).astype(float)
    B = np.zeros((n, 3 if parts == 1 else 12))
    if parts == 1:
        B += (m / m.sum())[:, None]
    B[rng.choice(n, B.shape[1], replace=False), range(B.shape[1])] += 1e-2 if parts == 1 else 1.0
    values, modes = sl.eigh(K, np.diag(m))
    last = np.sqrt(values[parts]) / (2 * np.pi) * 0.85
    body = Matrices(K=sp.csr_matrix(K), M=sp.diags(m).tocsr(), B=B, beta=1e-6)
    rom = reduce(body, (last / 60, last), 1e-3, options={"mor_tol_relative_to": "elastic"})
    loads, worst = modes.T @ B, 0.0
    for omega in 2 * np.pi * np.geomspace(1.01 * last / 60, 0.99 * last, 31):
        a = values * (1 + 1e-6j * omega) - omega**2
        a[:parts] = -(omega**2)
        H = loads.T @ (loads / a[:, None])
        elastic = loads[parts:].T @ (loads[parts:] / a[parts:, None])
        off = np.linalg.norm(rom.transfer(omega) - H) / np.linalg.norm(elastic)
        worst = max(worst, off)
    assert rom.frame["rigid_modes"] == parts
    assert worst <= rom.certified_error <= 1e-3
