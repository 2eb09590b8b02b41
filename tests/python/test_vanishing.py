"""Kinds of ports whose response vanishes somewhere: a support under a moment at 0 Hz."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from bodies import box
from conftest import (
    assert_certified,
    body_system,
    certified,
    kinds_of,
    rom_matrices,
    rom_system,
    run,
)
from flexgram import ReducedModel
from flexgram.body.description import import_description
from flexgram.simulation.histories import judge

STEEL = {"E": 2.1e11, "nu": 0.3, "rho": 7800.0}
FROM_MOMENT = "reaction from moment"


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cantilever whose support's force and moment are outputs."""
    path = tmp_path_factory.mktemp("vanishing") / "b.h5"
    content = {
        "materials": {"s": STEEL},
        "regions": {"all": {"material": "s"}},
        "damping": {"beta": 1e-6},
        "supports": {"wall": {"nodes": "start", "components": ["x", "y", "z"]}},
        "interfaces": {"eye": {"coupling": "rigid", "nodes": "end"}},
        "outputs": {"wall": {"type": "reaction", "nodes": "start"}},
    }
    import_description(content, "b", path, mesh=box("hexahedron20", (6, 2, 2), (0.3, 0.02, 0.03)))
    # Matrices: on two ranks the sums of the assembly are others, and move H by some 1e-9.
    run("assemble", "-body", path, "-body_out", path.with_name("m.h5"))
    return path.with_name("m.h5")


@pytest.mark.parametrize(("tolerance", "ranks"), [(1e-6, 1), (1e-4, 2)])
def test_a_band_from_zero(tolerance: float, ranks: int, body: Path, tmp_path: Path) -> None:
    """Is met by as few coordinates as one from 1 Hz, nearly; the claim holds against full solves,
    and its size is 1e-8 of what the ports answer to themselves."""
    result = certified(
        body, (0, 2000), tmp_path, "-mor_tol", f"{tolerance}", "-mor_monitor", "plan", ranks=ranks
    )
    assert_certified(result, tolerance, sharp=np.inf)
    with h5py.File(result["path"]) as file:
        claim = dict(file["error"].attrs)
        names = [[str(x) for x in file[k].attrs["names"]] for k in "CB"]
    full = body_system(body)
    kinds = [str(kind) for kind in claim["kinds"]]
    own = np.inf
    rows, columns = (
        kinds_of(n, k) for n, k in zip(names, FROM_MOMENT.split(" from "), strict=True)
    )
    for omega in 2 * np.pi * np.linspace(0, 2000, 9):
        A = full.K * (1 + 1e-6j * omega) - omega**2 * full.M
        A = np.asarray(A.todense() if hasattr(A, "todense") else A, dtype=complex)
        answers = [
            np.abs(np.einsum("na,na->a", P, np.linalg.solve(A, P))).sum()
            for P in (np.asarray(full.C).T[:, rows], np.asarray(full.B)[:, columns])
        ]
        own = min(own, float(np.sqrt(np.prod(answers))))
    assert claim["kind_least"][kinds.index(FROM_MOMENT)] == pytest.approx(1e-8 * own, rel=1e-3)
    still = rom_system(rom_matrices(result["path"]))
    # Relative to itself, it is far from the tolerance there: the smaller size is what is told.
    block = np.ix_(rows, columns)
    H, away = (S.transfer(0.0)[block] for S in (full, still))
    assert np.linalg.norm(H) < 1e-3 * claim["kind_least"][kinds.index(FROM_MOMENT)]
    assert np.linalg.norm(H - away) <= tolerance * claim["kind_least"][kinds.index(FROM_MOMENT)]
    (tmp_path / "above").mkdir()
    above = certified(body, (1, 2000), tmp_path / "above", "-mor_tol", f"{tolerance}", ranks=ranks)
    assert result["order"] <= above["order"] + 6


def test_it_is_told(body: Path) -> None:
    """In the plan of a band from 0 Hz, not in that of one from 1 Hz."""
    import flexgram

    words = "reaction from moment nearly vanishes somewhere: there relative to 1e-8 of what its"
    for first, there in ((0.0, True), (1.0, False)):
        rom = flexgram.reduce(body, (first, 2000), 1e-4)
        plan = " ".join(map(str, rom.provenance.plan))
        assert (words in plan) == there


def test_slow_moments(body: Path, tmp_path: Path) -> None:
    """A load history that is nearly static: what is said of the support's force holds."""
    import flexgram

    rom = flexgram.reduce(body, (0, 2000), 1e-4)
    t = np.linspace(0, 40, 4001)
    u = np.zeros((len(t), len(rom.inputs)))
    u[:, rom.inputs.index("eye.mx")] = np.sin(2 * np.pi * 0.05 * t) ** 4
    errors = judge(rom, t, u).errors
    full = body_system(body)
    rows = kinds_of(list(rom.outputs), "reaction")
    column = rom.inputs.index("eye.mx")
    U = np.fft.rfft(u[:, column])
    lines = np.argsort(-np.abs(U))[:6]
    off = motion = 0.0
    for k in lines.tolist():
        omega = 2 * np.pi * k / 40
        H, H_r = (S.transfer(omega)[rows, column] for S in (full, rom_system_of(rom, tmp_path)))
        off += np.linalg.norm((H - H_r) * U[k]) ** 2
        motion += np.linalg.norm(H * U[k]) ** 2
    assert np.sqrt(off / motion) <= errors["reaction"]


def rom_system_of(rom: ReducedModel, folder: Path) -> object:
    path = folder / "saved.rom.h5"
    if not path.exists():
        rom.save(path)
    return rom_system(rom_matrices(path))
