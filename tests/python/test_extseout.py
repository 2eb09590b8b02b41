"""External superelements that Nastran wrote, and what ten printed digits leave of them."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as sl
from test_nastran import punched

from conftest import body_system, run
from flexgram import ReducedModel
from flexgram.assembly.couple import Joint, couple

GRIDS = (3, 11, 19, 27)  # where the two superelements meet, six directions each
DIRECTIONS = ("fx", "fy", "fz", "mx", "my", "mz")


def nastran_runs() -> Path:
    """Nastran's files of a structure in two superelements, which pyYeti brings along."""
    folder = Path(pytest.importorskip("pyyeti").__file__).parent / "tests" / "nas2cam_extseout"
    if not folder.is_dir():
        pytest.skip("this pyYeti comes without its tests' files")
    return folder


def printed_frequencies(listing: Path) -> np.ndarray:
    """[Hz] of the table of real eigenvalues, of seven digits."""
    table = listing.read_text(errors="replace").split("R E A L   E I G E N V A L U E S")[1]
    rows = re.findall(r"^ +\d+ +\d+" + r" +(-?\d\.\d+E[+-]\d+)" * 5, table, flags=re.M)
    return np.array([float(row[0]) for row in rows])


def test_two_superelements_have_the_frequencies_of_nastrans_own_run(tmp_path: Path) -> None:
    """Each part is imported and reduced alone; what Nastran found of the whole is held out."""
    runs = nastran_runs()
    squares = printed_frequencies(runs / "assemble.out")
    exact = np.sqrt(squares[squares > 1]) / (2 * np.pi)
    ports = [
        word
        for i, grid in enumerate(GRIDS)
        for word in (
            "--rows",
            f"g{grid}=" + ",".join(f"{d}:{6 * i + k + 1}" for k, d in enumerate(DIRECTIONS)),
        )
    ]
    parts = {}
    for name in ("inboard", "outboard"):
        body, rom = tmp_path / f"{name}.h5", tmp_path / f"{name}.rom.h5"
        run("import", runs / f"{name}.op4", *ports, "-o", body)
        run("reduce", "-body", body, "-mor_band_hz", "0.5,12", "-mor_tol", "1e-6", "-mor_out", rom)
        parts[name] = ReducedModel.load(rom)
    joints = [Joint(f"outboard.g{grid}", f"inboard.g{grid}") for grid in GRIDS]
    both = couple(parts, joints, keep=["outboard.g3"])
    found = both.modes / (2 * np.pi)
    found = found[found > 0.1]
    inside = exact < 12
    assert inside.sum() == 8
    assert np.allclose(found[: inside.sum()], exact[inside], rtol=1e-6)
    assert both.claim.kind == "certified outside"  # undamped: resonances are left out
    assert both.certified_error < 0.05


def test_a_tighter_tolerance_of_ten_digits_is_no_worse(tmp_path: Path) -> None:
    """K of a free superelement with ten digits, as DMIG prints them. The claims hold against the
    stored matrices at frequencies of the test's own. A tighter tolerance has no larger error."""
    runs = nastran_runs()
    from pyNastran.op4.op4 import read_op4

    read = read_op4(str(runs / "outboard.op4"), debug=None)
    exact = [read[name].data for name in ("KXX", "MXX")]
    exact = [np.asarray(a.toarray() if hasattr(a, "toarray") else a) for a in exact]
    K, M = (np.vectorize(lambda x: float(f"{x:.9e}"))(0.5 * (a + a.T)) for a in exact)
    dofs = [(grid, c) for grid in GRIDS for c in range(1, 7)]
    dofs += [(1995001 + j, 0) for j in range(len(K) - len(dofs))]
    deck = punched(tmp_path / "outboard.pch", dofs, KAAX=K, MAAX=M)
    body = tmp_path / "body.h5"
    run("import", deck, "--node", "eye=NODES:3", "-o", body)
    full = body_system(body)
    assert sl.norm(full.K - K) < 1e-9 * sl.norm(K)  # as printed
    rng = np.random.default_rng(5)
    omega = 2 * np.pi * rng.uniform(1, 60, 400)
    H = [full.transfer(w) for w in omega]
    errors, orders = [], []
    for tolerance in ("1e-2", "1e-4", "1e-6"):
        rom_file = tmp_path / f"{tolerance}.h5"
        run(
            *("reduce", "-body", body, "-mor_band_hz", "1,60", "-mor_tol", tolerance),
            *("-mor_out", rom_file),
            expect=None,
        )
        rom = ReducedModel.load(rom_file)
        worst = max(
            float(sl.norm(rom.transfer(w) - h) / sl.norm(h)) for w, h in zip(omega, H, strict=True)
        )
        assert worst <= rom.certified_error + rom.rigid_rounding, tolerance
        errors.append(worst)
        orders.append(rom.order)
    assert orders == sorted(orders)
    # Rounding of rigid modes is all that is left of each: equal to eight digits.
    assert all(b <= 1.001 * a for a, b in itertools.pairwise(errors)), (errors, orders)
