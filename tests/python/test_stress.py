"""Bodies that break numerics.

Each meets its tolerance, certified and compared with full solves, or says clearly why it does not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp

from bodies import box, write_body_file
from conftest import assembled, assert_certified, certified, message, run
from flexgram import ReducedModel, write_matrices

ENDS = {name: {"set": name, "coupling": "rigid"} for name in ("start", "end")}
TWO_PI = 2 * np.pi


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Matrices of a free steel box with two rigid ends, 12 ports; modes from 1 to 30 kHz."""
    folder = tmp_path_factory.mktemp("beam")
    mesh = box("tetra10", (5, 2, 2), (0.2, 0.02, 0.03))
    write_body_file(folder / "mesh.h5", mesh, interfaces=ENDS)
    return assembled(folder / "matrices.h5", folder / "mesh.h5")


def clamped(body: dict[str, Any]) -> tuple[Any, Any, Any]:
    """The box held at its start: six dofs fewer, six ports at its end."""
    keep = np.flatnonzero(~body["B"][:, :6].any(axis=1))
    return body["K"][keep][:, keep].tocsc(), body["M"][keep][:, keep].tocsc(), body["B"][keep, 6:]


def modes(K: Any, M: Any) -> Any:
    return np.sqrt(np.abs(sl.eigh(K.toarray(), M.toarray(), eigvals_only=True)))


def check(
    folder: Path, matrices: Any, band: Any, tolerance: float = 1e-4, *options: Any, **damping: Any
) -> Any:
    K, M, B = matrices
    write_matrices(folder / "body.h5", K, M, B, **damping)
    result = certified(folder / "body.h5", band, folder, "-mor_tol", tolerance, *options)
    assert_certified(result, tolerance)
    assert result["factorisations"] <= 4
    return result


@pytest.mark.kernels
def test_undamped_and_nearly_undamped(beam: dict[str, Any], tmp_path: Path) -> None:
    matrices = clamped(beam)
    check(tmp_path, matrices, (100.0, 6000.0))
    omega = modes(*matrices[:2])[0]
    check(tmp_path, matrices, (100.0, 6000.0), alpha=2e-6 * omega)  # damping ratio 1e-6


@pytest.mark.kernels
def test_cutoff_a_hair_beside_an_eigenvalue(beam: dict[str, Any], tmp_path: Path) -> None:
    matrices = clamped(beam)
    hz = modes(*matrices[:2])[5] * (1 + 1e-10) / TWO_PI
    check(tmp_path, matrices, (100.0, hz / 1.5), 1e-4, "-mor_cutoff", 1.5)


def test_krylov_shift_a_hair_beside_an_eigenvalue(beam: dict[str, Any], tmp_path: Path) -> None:
    K, M, B = clamped(beam)
    hz = modes(K, M)[1] * (1 + 1e-10) / TWO_PI
    write_matrices(tmp_path / "body.h5", K, M, B, alpha=50.0)
    for shifts in (f"{hz!r},5000", "2000,2000.0000001,5000"):  # and shifts that nearly coincide
        assert_certified(
            certified(
                tmp_path / "body.h5",
                (100.0, 6000.0),
                tmp_path,
                "-mor_method",
                "krylov",
                "-mor_shifts_hz",
                shifts,
            )
        )


@pytest.mark.kernels
@pytest.mark.parametrize("copies", [2, 3])
def test_multiple_eigenvalues(beam: dict[str, Any], tmp_path: Path, copies: int) -> None:
    """The same body several times, loaded in one copy and in all: every eigenvalue repeats."""
    K, M, B = clamped(beam)
    n = K.shape[0]
    loads = np.zeros((copies * n, 3))
    loads[:n, 0], loads[n : 2 * n, 1] = B[:, 1], B[:, 2]
    loads[:, 2] = np.tile(B[:, 0], copies)
    many = [sp.block_diag([A] * copies).tocsc() for A in (K, M)]
    result = check(tmp_path, (*many, loads), (100.0, 6000.0), alpha=20.0)
    assert result["order"] < 40


def test_units_do_not_matter(beam: dict[str, Any], tmp_path: Path) -> None:
    """The same forces and displacements in m-kg-s and in mm-t-s: the same order and error."""
    K, M, B = clamped(beam)
    forces = B[:, :3]
    results = []
    # Translations in mm instead of m; rotations stay: u = S u_mm. Forces in N in both.
    keep = np.flatnonzero(~beam["B"][:, :6].any(axis=1))
    S = sp.diags(np.where(beam["component"][keep] < 3, 1e-3, 1.0))
    # K: N/m → N/mm; energies in N mm are 1000 times those in N m.
    for scaled in (
        (K, M, forces),
        ((1e3 * S @ K @ S).tocsc(), (1e3 * S @ M @ S).tocsc(), 1e3 * (S @ forces)),
    ):
        results.append(check(tmp_path, scaled, (100.0, 6000.0), alpha=20.0))
    assert results[0]["order"] == results[1]["order"]
    assert np.isclose(results[0]["worst"], results[1]["worst"], rtol=1e-2, atol=1e-8)


def test_moments_in_newton_millimetres(beam: dict[str, Any], tmp_path: Path) -> None:
    """Ports are weighed alike: a moment in N mm spans what one in N m does."""
    K, M, B = clamped(beam)
    spaces = []
    for factor in (1.0, 1e-3):
        scaled = B * np.where(np.arange(6) < 3, 1.0, factor)
        write_matrices(tmp_path / "body.h5", K, M, scaled, alpha=20.0)
        result = certified(
            tmp_path / "body.h5", (100.0, 6000.0), tmp_path, "-mor_second_stage", "gramian"
        )
        assert_certified(result)
        spaces.append(result["rom"]["V"])
    assert spaces[0].shape == spaces[1].shape
    overlap = np.linalg.svd(spaces[0].T @ M @ spaces[1], compute_uv=False)
    assert overlap.min() > 1 - 1e-6


def test_stiffness_contrast(beam: dict[str, Any], tmp_path: Path) -> None:
    """A soft half beside a half that is 1e8 times stiffer."""
    n = 200
    k = np.where(np.arange(n + 1) < n // 2, 1e-2, 1e6)
    K = sp.diags([-k[1:n], k[:n] + k[1:], -k[1:n]], [-1, 0, 1]).tocsc()
    M = sp.identity(n).tocsc()
    B = np.zeros((n, 2))
    B[20, 0] = B[n - 20, 1] = 1
    write_matrices(tmp_path / "body.h5", K, M, B, alpha=1e-3)
    first = modes(K, M)[0] / TWO_PI
    band = (0.1 * first, 5 * first)
    result = run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_band_hz",
        f"{band[0]!r},{band[1]!r}",
        "-mor_tol",
        "1e-4",
        "-mor_out",
        tmp_path / "rom.h5",
        expect=None,
    )
    result = certified(tmp_path / "body.h5", band, tmp_path, "-mor_tol", 1e-4, expect=result.status)
    assert_certified(result)
    assert result["met"] or result["floor"] > 5e-5


@pytest.mark.kernels
def test_lumped_rotations_and_massless_dofs(beam: dict[str, Any], tmp_path: Path) -> None:
    K, M, B = clamped(beam)
    keep = np.flatnonzero(~beam["B"][:, :6].any(axis=1))
    lumped = np.asarray(M.sum(axis=1)).ravel()
    lumped[beam["component"][keep] >= 3] = 0  # rotations without inertia
    lumped[::7] = 0
    massless = sp.diags(np.abs(lumped)).tocsc()
    check(tmp_path, (K, massless, B), (100.0, 5000.0), alpha=20.0, beta=1e-8)


@pytest.mark.parametrize("ranks", [1, 2])
def test_dashpot_and_general_damping(beam: dict[str, Any], tmp_path: Path, ranks: int) -> None:
    K, M, B = clamped(beam)
    n = K.shape[0]
    dashpot = sp.csc_matrix(([30.0], ([n // 2], [n // 2])), shape=(n, n))
    half = sp.diags((np.arange(n) < n // 2).astype(float))
    general = (2e-8 * half @ K @ half).tocsc()
    for D in (dashpot, general):
        write_matrices(tmp_path / "body.h5", K, M, B, D=D)
        result = certified(
            tmp_path / "body.h5",
            (100.0, 6000.0),
            tmp_path,
            "-mor_tol",
            1e-4,
            count=120,
            ranks=ranks,
        )
        assert_certified(result, 1e-4)
        assert result["factorisations"] == 1


def test_a_dashpot_of_any_strength(beam: dict[str, Any], tmp_path: Path) -> None:
    """So strong that it nearly holds its node: certified with all the space it takes; with a small
    one the bound is larger than H, so that nothing is claimed, and that is said."""
    K, M, B = clamped(beam)
    n = K.shape[0]
    D = sp.csc_matrix(([1e6], ([n // 2], [n // 2])), shape=(n, n))
    body = tmp_path / "body.h5"
    write_matrices(body, K, M, B, D=D)
    result = certified(body, (100.0, 3000.0), tmp_path, "-mor_order", 25)
    assert_certified(result)
    small = ("-mor_order", 12, "-mor_medium_order", 24, "-mor_out", tmp_path / "rom.h5")
    run("reduce", "-body", body, "-mor_band_hz", "100,3000", *small)
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert np.isinf(rom.certified_error) and "no bound of the error" in rom.claim.words


@pytest.mark.kernels
def test_free_body_from_a_hundredth_of_a_hertz(tmp_path: Path) -> None:
    """Rigid modes from the geometry: low frequencies stay accurate. What rounding left of their
    stiffness in the stored K is 2 % of H at 0.01 Hz: not an error of this body, but told."""
    write_body_file(
        tmp_path / "mesh.h5",
        box("tetra10", (5, 2, 2), (0.2, 0.02, 0.03)),
        interfaces=ENDS,
        damping=(1e-3, 1e-7, 0),
    )
    result = certified(tmp_path / "mesh.h5", (0.01, 6000.0), tmp_path, "-mor_tol", 1e-6)
    assert_certified(result, 1e-6)
    with h5py.File(result["path"]) as file:
        assert file["error/floor"][:].max() < 1e-7
    assert 1e-3 < result["rigid_rounding"] < 0.1
    with h5py.File(result["path"]) as file:
        assert np.all(file["modes/omega"][:6] == 0)


@pytest.mark.kernels
def test_soft_mounts_are_no_rigid_modes(beam: dict[str, Any], tmp_path: Path) -> None:
    K = beam["K"] + sp.diags(np.where(beam["B"].any(axis=1), 5e3, 0.0))
    matrices = (K.tocsc(), beam["M"], beam["B"])
    result = check(tmp_path, matrices, (10.0, 6000.0), 1e-4, alpha=5.0)
    suspension = modes(*matrices[:2])[:6]
    assert np.allclose(result["rom"]["modes"][:6], suspension, rtol=1e-4)


@pytest.mark.kernels
def test_a_slow_mode_is_not_rigid(tmp_path: Path) -> None:
    """The first mode of a slender cantilever, far below the cutoff, leaves a hundred-millionth of
    each row of K: no rounding."""
    mesh = box("hexahedron20", (6, 1, 1), (0.4, 0.01, 0.03), distort=False)
    end = {"tip": {"set": "end", "coupling": "rigid"}}
    held = {"start": [0, 1, 2]}
    write_body_file(tmp_path / "mesh.h5", mesh, interfaces=end, supports=held)
    a = assembled(tmp_path / "m.h5", tmp_path / "mesh.h5")
    slow = modes(a["K"], a["M"])[0]
    assert slow * 316 < 25e3 * TWO_PI and len(a["B"]) >= 100
    matrices = (a["K"], a["M"], a["B"])
    result = check(tmp_path, matrices, (10.0, 500.0), 1e-4, "-mor_cutoff", 50, alpha=5.0)
    assert result["rom"]["modes"][0] == pytest.approx(slow, rel=1e-6)


@pytest.mark.kernels
def test_constraint_modes_on_very_soft_mounts(beam: dict[str, Any], tmp_path: Path) -> None:
    """All statics are the same suspension mode to ten digits: constraint modes are not."""
    K = beam["K"] + sp.diags(np.where(beam["B"].any(axis=1), 0.05, 0.0))
    matrices = (K.tocsc(), beam["M"], beam["B"])
    check(
        tmp_path, matrices, (1000.0, 6000.0), 1e-4, "-mor_second_stage", "craig_bampton", alpha=5.0
    )


def test_band_without_a_mode_and_band_with_many(beam: dict[str, Any], tmp_path: Path) -> None:
    matrices = clamped(beam)
    omega = modes(*matrices[:2])
    check(tmp_path, matrices, (1.0, 0.3 * omega[0] / TWO_PI), 1e-6, alpha=20.0)
    many = check(tmp_path, matrices, (100.0, 1.001 * omega[59] / TWO_PI), 1e-3, alpha=200.0)
    assert many["order"] >= 60


def test_ports_one_many_duplicate_and_elsewhere(beam: dict[str, Any], tmp_path: Path) -> None:
    K, M, B = clamped(beam)
    n = K.shape[0]
    band = (100.0, 6000.0)
    check(tmp_path, (K, M, B[:, 1:2]), band, alpha=20.0)
    sixty = np.zeros((n, 60))
    sixty[np.random.default_rng(2).choice(n, 60, replace=False), range(60)] = 1
    check(tmp_path, (K, M, sixty), band, 1e-3, alpha=20.0)
    check(tmp_path, (K, M, np.hstack([B, B[:, :2], 3 * B[:, :1]])), band, alpha=20.0)
    check(tmp_path, (K, M, B), band, alpha=20.0, C=sixty[:, :4].T)


def test_medium_order_limit_is_named(beam: dict[str, Any], tmp_path: Path) -> None:
    """Too small for the modes: an error. Too small for the tolerance: the best body, exit 2."""
    body = tmp_path / "body.h5"
    write_matrices(body, *clamped(beam), alpha=20.0)
    limit = ("-mor_tol", "1e-7", "-mor_medium_order")
    result = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "100,6000",
        *limit,
        3,
        "-mor_out",
        tmp_path / "rom.h5",
        expect=1,
    )
    assert "modes lie below the cutoff" in message(result)
    assert not (tmp_path / "rom.h5").exists()
    found = certified(body, (100.0, 6000.0), tmp_path, *limit, 20, expect=2)
    assert_certified(found)
    assert not found["met"] and found["worst"] > 1e-7
