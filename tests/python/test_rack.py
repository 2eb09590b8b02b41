"""The rack: the paper's route on the body that the project exists for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from conftest import assembled, rom_matrices, rom_transfer, run

BAND = ("-mor_method", "pod", "-mor_band_hz", "10,500", "-mor_samples", "30")


@pytest.fixture(scope="module")
def roms(rack: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[int, int], Any]:
    """Reduced racks by ranks and groups."""
    folder = tmp_path_factory.mktemp("roms")
    result = {}
    for ranks, groups in ((1, 1), (2, 1), (2, 2), (4, 1), (4, 2)):
        path = folder / f"{ranks}{groups}.h5"
        run("reduce", "-body", rack, *BAND, "-mor_groups", groups, "-mor_out", path, ranks=ranks)
        result[ranks, groups] = path
    return result


def test_has_the_size_and_modes_asked_for(rack: Path, tmp_path: Path) -> None:
    body = assembled(tmp_path / "matrices.h5", rack, ranks=2)
    n = body["K"].shape[0]
    assert 5500 <= n <= 6500
    assert body["B"].shape == (n, 12)
    assert body["names"] == [
        f"{plate}.{port}"
        for plate in ("lower", "upper")
        for port in ("fx", "fy", "fz", "mx", "my", "mz")
    ]
    shift = -((2 * np.pi * 10) ** 2)
    squares = eigsh(body["K"], 40, body["M"], sigma=shift, return_eigenvectors=False)
    hz = np.sqrt(np.abs(np.sort(squares))) / (2 * np.pi)
    assert np.all(hz[:6] < 0.5) and hz[6] > 10  # free: six rigid modes
    assert np.sum((hz > 10) & (hz < 500)) >= 8


@pytest.mark.parametrize("ranks", [1, 2])
def test_order_rule_and_error(
    rack: Path, roms: dict[tuple[int, int], Path], tmp_path: Path, ranks: int
) -> None:
    rom = rom_matrices(roms[ranks, 1])
    order = rom["K"].shape[0]
    assert 15 <= order <= 40
    assert rom["sigma"][order] / rom["sigma"][0] < np.sqrt(np.finfo(float).eps)
    assert rom["sigma"][order - 1] / rom["sigma"][0] >= np.sqrt(np.finfo(float).eps)
    sixty = tmp_path / "sixty.h5"
    run("reduce", "-body", rack, *BAND, "-mor_order", 60, "-mor_out", sixty, ranks=ranks)
    for path, tolerance in ((roms[ranks, 1], 1e-2), (sixty, 1e-6)):
        out = tmp_path / "sweep.h5"
        run(
            "sweep",
            "-body",
            rack,
            "-rom",
            path,
            "-mor_sweep_hz",
            "10,500,80",
            "-mor_sweep_out",
            out,
            ranks=ranks,
        )
        with h5py.File(out) as file:
            assert file["error/relative"].shape == (80,)
            assert file["error/relative"][:].max() < tolerance
    samples = 10 + 490 / 30 * (np.arange(30) + 0.5)
    assert np.abs(samples[:, None] - np.linspace(10, 500, 80)).min() > 1e-3
    M, K = rom["M"], rom["K"]
    assert np.linalg.eigvalsh(M).min() > 0
    # V holds the rigid modes: K is positive up to the rounding of its largest eigenvalue.
    values = np.linalg.eigvalsh(K)
    assert values.min() > -1e-12 * values.max()
    assert np.abs(M - np.eye(order)).max() < 1e-12


def test_ranks_and_groups_do_not_matter(roms: dict[tuple[int, int], Path]) -> None:
    reference = rom_matrices(roms[1, 1])
    count = int(np.sum(reference["sigma"] > 1e-8 * reference["sigma"][0]))
    omegas = 2 * np.pi * np.linspace(10, 500, 60)
    for key, path in roms.items():
        rom = rom_matrices(path)
        assert rom["K"].shape == reference["K"].shape
        ratio = rom["sigma"][:count] / reference["sigma"][:count]
        assert np.abs(ratio - 1).max() < 1e-8, key
        for omega in omegas:
            H, H_r = rom_transfer(reference, omega), rom_transfer(rom, omega)
            assert np.linalg.norm(H - H_r) < 1e-8 * np.linalg.norm(H), key


def test_reduced_file_tells_its_story(roms: dict[tuple[int, int], Path]) -> None:
    with h5py.File(roms[2, 2]) as file:
        assert file.attrs["method"] == "pod"
        assert np.allclose(file.attrs["band"], 2 * np.pi * np.array([10, 500]))
        assert file["log/options"].attrs["-mor_samples"] == "30"
        assert file["log/options"].attrs["-mor_groups"] == "2"
        assert file["log"].attrs["factorisations"] == 40
        assert file["log"].attrs["ranks"] == 2
        assert file["error"].attrs["kind"] == "estimated"
        assert len(file["error/omega"]) == len(file["error/relative"]) == 40
        m = file["K"].shape[0]
        assert file["V"].shape[1] == m and file["modes/omega"].shape == (m,)
        modes = np.sqrt(np.maximum(eigh(file["K"][:], file["M"][:], eigvals_only=True), 0))
        assert np.allclose(modes[6:], file["modes/omega"][6:], rtol=1e-10)
        assert file["log/seconds"].attrs["samples"] > 0


def test_plan_says_what_is_done_and_skipped(rack: Path) -> None:
    result = run("plan", "-body", rack, *BAND, ranks=2)
    for word in ("proportional", "30 samples", "MB on a rank", "groups", "skipped"):
        assert word in result.out


def test_options_file_and_log_view(rack: Path, tmp_path: Path) -> None:
    options = tmp_path / "run.opts"
    options.write_text(
        "-mor_method pod\n-mor_samples 5\n-mor_validate 0\n# comment\n-mor_monitor detail\n"
    )
    out = tmp_path / "rom.h5"
    result = run(
        "reduce", "-body", rack, "-options_file", options, "-mor_out", out, "-log_view", ranks=2
    )
    assert "sample (one of 2 groups) 1/" in result.out and "Summary of Stages" in result.out
    with h5py.File(out) as file:
        assert file["log/options"].attrs["-mor_samples"] == "5"
        assert len(file["error/omega"]) == 5
