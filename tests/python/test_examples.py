"""The worked examples run, and what they print is right."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from conftest import ENVIRONMENT, PYTHON, ROOT, program


def example(name: str, *arguments: object, ranks: int = 1) -> str:
    command = [str(PYTHON), str(ROOT / "examples" / name), *map(str, arguments)]
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), *command]
    done = subprocess.run(
        command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


def test_rack(tmp_path: Path) -> None:
    out = example("rack.py", tmp_path)
    assert number(r"error (\S+) \(certified\)", out) <= 1e-4
    assert (tmp_path / "rack.html").stat().st_size > 50_000


def test_rack_stress(tmp_path: Path) -> None:
    out = example("rack_stress.py", tmp_path)
    assert number(r"error (\S+) \(certified\)", out) <= 1e-3
    assert number(r"stress from acceleration: at most (\S+)", out) <= 1e-3
    # About the weight of all above the strut and the push's moment over its section.
    assert 1e6 < number(r"largest stress of the strut (\S+) N", out) < 2e7
    assert (tmp_path / "standing.png").stat().st_size > 20_000


def test_rubber_mounts(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    out = example("rubber_mounts.py", tmp_path)
    assert number(r"error (\S+) \(certified with each of 6 values", out) <= 1e-3
    soft, stiff = (number(rf"E = {E} Pa: (\S+),", out) for E in (r"1\.4e\+06", r"2\.6e\+06"))
    assert stiff / soft == pytest.approx(np.sqrt(2.6 / 1.4), rel=0.01)  # the steel hardly bends
    assert number(r"differs by (\S+) at most", out) <= 1e-3
    assert number(r"any E from .* Pa: (\S+) at most, certified", out) <= 1e-3
    assert (tmp_path / "mounts.svg").stat().st_size > 10_000


def test_turning_blade(tmp_path: Path) -> None:
    out = example("turning_blade.py", tmp_path)
    assert number(r"any speed up to 3000 rpm: (\S+) at most, certified", out) <= 1e-3
    # Euler and Bernoulli, clamped: (1.8751/l)² √(EI/ρA); at 3000 rpm the spin stiffens it.
    still = 1.8751**2 / 0.4**2 * np.sqrt(210e9 * 0.006**2 / 12 / 7850) / (2 * np.pi)
    assert number(r"\n0 rpm: (\S+),", out) == pytest.approx(still, rel=5e-3)
    assert number(r"\n3000 rpm: (\S+),", out) > 2 * still
    crossing = number(r"2 times the speed: (\S+) rpm", out) / 60 * 2
    assert still < crossing < 1.5 * still
    assert number(r"differs by (\S+) at most", out) <= 1e-3
    assert (tmp_path / "blade.svg").stat().st_size > 10_000


def test_spin_up(tmp_path: Path) -> None:
    pytest.importorskip("exudyn")
    out = example("exudyn_spin_up.py", tmp_path)
    # EXUDYN's geometrically exact beam, by test_stiffening.tip_of_exact at 7 s: 0.572 m
    assert number(r"with geometric stiffening: at most (\S+) m", out) == pytest.approx(
        0.573, rel=0.02
    )
    assert number(r"without: at most (\S+) m", out) > 1.5
    assert (tmp_path / "spin-up.svg").stat().st_size > 10_000


@pytest.mark.parametrize("has_ccx", [True, False])
def test_calculix_part(has_ccx: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the matrices of ccx, and where there is none."""
    pytest.importorskip("gmsh")
    if has_ccx and shutil.which("ccx") is None:
        pytest.skip("ccx is not installed")
    if not has_ccx:
        monkeypatch.setitem(ENVIRONMENT, "PATH", str(tmp_path))
    out = example("calculix_part.py", tmp_path)
    assert ("6 free rigid motions" if has_ccx else "6 of 6 rigid motions are free") in out
    volume = 120 * 40 * 12 - np.pi * 8**2 * 12
    assert number(r"mass ([\d.]+) kg", out) == pytest.approx(7.85e-6 * volume, rel=2e-3)
    assert (tmp_path / "part.SID_FEM").read_text().endswith("end part\n")


def test_dolfinx_beam_on_one_and_two_ranks(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    modes = []
    for ranks in (1, 2):
        rom = tmp_path / f"beam{ranks}.h5"
        out = example("dolfinx_beam.py", rom, ranks=ranks)
        assert number(r"mass (\S+) kg, exact", out) == pytest.approx(18.84, rel=1e-9)
        with h5py.File(rom) as file:
            assert file["error"].attrs["kind"] == "certified"
            assert file["error/bound"][:].max() <= 1e-4
            modes.append(file["modes/omega"][6:10])
    assert np.allclose(*modes, rtol=1e-6)
    # Euler-Bernoulli, first bending in the thin direction, within the error of that theory
    slender = 22.373 * np.sqrt(210e9 * 0.04**2 / 12 / 7850)
    assert modes[0][0] == pytest.approx(slender, rel=0.02)


def test_dolfinx_ports_equal_glue_by_hand() -> None:
    pytest.importorskip("dolfinx")
    for degree in (1, 2):
        lines = []
        for ranks in (1, 2, 3):
            out = program("dolfinx_ports", degree, ranks=ranks, timeout=600)
            assert number(r"loads (\S+)", out) < 1e-14
            assert number(r"work (\S+)", out) < 1e-10
            assert number(r"matrix (\S+)", out) == 0
            assert "rigid 6 mass 62.8" in out
            assert "certified" in out and "no facets have the tag 5 (none)" in out
            lines.append(
                [line for line in out.splitlines() if line.startswith(("free", "clamped"))]
            )
        assert lines[0] == lines[1] == lines[2]
        # a cantilever of that section, thin direction, by Euler and Bernoulli
        E = 8e10 * (3 * 1e11 + 2 * 8e10) / (1e11 + 8e10)
        slender = 3.516 / (2 * np.pi) * np.sqrt(E * 0.08**2 / 12 / 7850)
        lowest = number(r"clamped (\S+)", out)
        assert lowest == pytest.approx(slender, rel=0.02) if degree == 2 else lowest > slender


def test_matlab_matrices(tmp_path: Path) -> None:
    out = example("matlab_matrices.py", tmp_path)
    assert number(r"closed solution: (\S+)", out) < 1e-3


def test_exudyn_pendulum(tmp_path: Path) -> None:
    pytest.importorskip("exudyn")
    out = example("exudyn_pendulum.py", tmp_path)
    # A rigid body of the rack's mass, centre and inertia turns as far within a degree.
    from scipy.integrate import solve_ivp

    mass, lever, inertia = 178.278, 0.45, 89.5985 - 178.278 * 0.3**2  # about the hinge line
    end = solve_ivp(
        lambda t, s: [s[1], mass * 9.81 * lever * np.cos(s[0]) / inertia],
        (0, 0.8),
        [0, 0],
        rtol=1e-9,
    ).y[0, -1]
    assert number(r"turned by (\S+) degrees", out) == pytest.approx(np.degrees(end), abs=1.0)
