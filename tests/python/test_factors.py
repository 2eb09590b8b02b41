"""Which factors a body gets: in double or single precision, on disk; what is said of memory."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import flexgram
from bodies import box, write_body_file
from conftest import assert_certified, certified, chain, rom_matrices, rom_transfer, run

ENDS = {name: {"set": name, "coupling": "rigid"} for name in ("start", "end")}
BAND = (10.0, 1000.0)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block of 27,039 dofs."""
    path = tmp_path_factory.mktemp("factors") / "block.h5"
    mesh = box("tetra10", (20, 10, 5), (4, 2, 1), distort=False)
    write_body_file(path, mesh, interfaces=ENDS, damping=(2.0, 1e-6, 0))
    return path


def paths(plan: str) -> dict[str, float]:
    """MB of the run for each way to keep the factors, the one taken first."""
    taken = re.search(r"factors +of K - ω_c²M, (.+): .* entries.*the run about (\d+) MB", plan)
    assert taken is not None, plan
    others = re.findall(r"or +(.+): \d+ MB on a rank; the run about (\d+) MB", plan)
    return {name: float(mb) for name, mb in [taken.groups(), *others]}


@pytest.mark.parametrize("ranks", [1, 2])
def test_single_precision_is_certified_like_double(rack: Path, tmp_path: Path, ranks: int) -> None:
    """Against full solves at frequencies that the program was not given."""
    results = {
        precision: certified(
            rack,
            (10.0, 500.0),
            tmp_path,
            "-mor_tol",
            1e-4,
            "-mor_precision",
            precision,
            ranks=ranks,
            count=6,
        )
        for precision in ("double", "single")
    }
    for result in results.values():
        assert_certified(result, 1e-4)
    assert results["single"]["order"] == results["double"]["order"]


def test_memory_decides(block: Path, tmp_path: Path) -> None:
    """Double precision where the run fits, single where it does not, on disk where even that is too
    much; the estimate of each is within a fifth of what is then used, and H is the same."""
    job = ["-body", block, "-mor_band_hz", f"{BAND[0]},{BAND[1]}"]
    plan = run("plan", *job).out
    estimates = paths(plan)
    assert list(estimates) == [
        "double precision",
        "single precision, refined",
        "single precision on disk",
    ]
    double, single, disk = estimates.values()
    assert double > single > disk
    H = {}
    for name, limit in zip(
        estimates, (2 * double, 0.5 * (double + single), 0.5 * (single + disk)), strict=True
    ):
        out = tmp_path / "rom.h5"
        told = run(
            "reduce",
            *job,
            "-mor_tol",
            1e-4,
            "-mor_out",
            out,
            "-mor_memory_limit_mb",
            f"{limit:.0f}",
        )
        estimate = paths(told.out)[name]
        with h5py.File(out) as file:
            peak = float(file["log"].attrs["peak_memory_mb_per_rank"])
            assert file["error"].attrs["kind"] == "certified"
        assert abs(estimate / peak - 1) < 0.2, (name, estimate, peak)
        assert ("keeps no factors" in told.out) == (limit < double)
        assert ("go to disk" in told.out + told.err) == (limit < single)
        rom = rom_matrices(out)
        H[name] = [rom_transfer(rom, 2 * np.pi * f) for f in (11.3, 333.0, 987.0)]
    for other in list(H.values())[1:]:
        for a, b in zip(H["double precision"], other, strict=True):
            assert np.linalg.norm(a - b) < 1e-8 * np.linalg.norm(a)


def test_single_precision_may_not_be_enough(tmp_path: Path) -> None:
    """A thin strip: refinement stalls, factors are made again in double, and the plan says so."""
    path = tmp_path / "strip.h5"
    mesh = box("tetra10", (40, 4, 1), (4, 0.4, 0.004), distort=False)
    write_body_file(path, mesh, interfaces=ENDS, damping=(2.0, 1e-6, 0))
    out = tmp_path / "rom.h5"
    told = run(
        "reduce",
        "-body",
        path,
        "-mor_band_hz",
        "0.5,20",
        "-mor_precision",
        "single",
        "-mor_tol",
        1e-3,
        "-mor_out",
        out,
    ).out
    assert re.search("fall-back +refinement of single precision stalled", told)
    with h5py.File(out) as file:
        assert file["error"].attrs["kind"] == "certified" and file["error"].attrs["met"] == 1


def test_modes_that_the_only_port_cannot_move(tmp_path: Path) -> None:
    """One port on one of two equal chains: eigenvalues are double, and the inertia counts both."""
    one = chain(60)
    K, M = (sp.block_diag([one[key]] * 2).tocsc() for key in "KM")
    B = np.zeros((120, 1))
    B[59] = 1
    omega = 2 * np.sin((2 * np.arange(1, 61) - 1) * np.pi / 242)
    last = 0.5 * (omega[9] + omega[10])
    cutoff = 1.1 * last
    rom = flexgram.reduce(
        flexgram.Matrices(K=K, M=M, B=B, alpha=0.01),
        (0.5 * omega[0] / 2 / np.pi, last / 2 / np.pi),
        1e-6,
    )
    assert rom.kind == "certified" and rom.met and rom.log["factorisations"] == 1
    told = dict(rom.log["plan"])["modes"]
    assert told.startswith(f"{2 * np.sum(omega < cutoff)} elastic"), told
    for w in np.linspace(omega[0], omega[9], 23):
        A = K * (1 + 0j) + (0.01j * w - w * w) * M
        H = (B.T @ spsolve(A.tocsc(), B[:, 0]))[0]
        H_r = (rom.C @ np.linalg.solve(rom.K + (0.01j * w - w * w) * rom.M, rom.B))[0, 0]
        assert abs(H - H_r) <= rom.certified_error * abs(H)


def test_a_run_that_takes_more_than_it_may_is_warned_of() -> None:
    """Its factors are small, the vectors of its modes are not."""
    body = flexgram.Matrices(**chain(3000))
    band = (0.001, 2 * np.sin(120 * np.pi / 6002) / 2 / np.pi)
    with pytest.warns(flexgram.ReductionWarning, match=r"may take \d+ MB .* and 60 MB may be"):
        flexgram.reduce(body, band, 1e-2, options={"mor_memory_limit_mb": 60})
    assert not flexgram.reduce(body, band, 1e-2).provenance.warnings
