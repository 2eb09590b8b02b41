"""Tolerances of kinds of their own (-mor_tol_kind)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from test_mesh_loads import sided, write_body

from conftest import assert_certified, certified, run
from flexgram import ReducedModel

BAND = (100.0, 6000.0)


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A held bar with pressure, and the stress at a node."""
    mesh = sided("tetra10", counts=(6, 3, 3))
    path = tmp_path_factory.mktemp("kinds") / "body.h5"
    spot = int(mesh.point_sets["side"][0]) + 1
    write_body(
        path,
        mesh,
        damping={"alpha": 20.0, "beta": 1e-6},
        loads={"gas": {"type": "pressure", "nodes": "side"}},
        outputs={"spot": {"type": "stress", "nodes": [spot]}},
        supports={"start": {"nodes": "start"}},
    )
    return path


def limits(rom: ReducedModel) -> dict[str, tuple[float, float]]:
    """Of each kind what is claimed, and what was asked."""
    return {
        kind: (float(e), float(t))
        for kind, e, t in zip(rom.kinds, rom.by_kind, rom.kind_tolerances, strict=True)
    }


def test_the_plan_says_what_many_outputs_cost(tmp_path: Path) -> None:
    """Before anything is factorised; what a run takes is near it, in solves and in memory."""
    mesh = sided("tetra10", counts=(10, 4, 4))
    nodes = {f"s{k}": {"type": "stress", "nodes": [k + 1]} for k in range(0, 300, 6)}
    body = tmp_path / "body.h5"
    write_body(
        body,
        mesh,
        damping={"alpha": 20.0},
        loads={"g": {"type": "acceleration"}},
        outputs=nodes,
        supports={"start": {"nodes": "start"}},
    )
    planned = run("plan", "-body", body, "-mor_band_hz", "100,6000").out
    count = re.search(r"for 309 ports about (\d+) right-hand sides .* factorisations", planned)
    megabytes = re.search(r"the run about (\d+) MB", planned)
    assert count and megabytes
    assert re.search(r"many modes +if hundreds .* about \S+ MB more on a rank for each", planned)
    done = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "100,6000",
        "-mor_tol",
        "1e-2",
        "-mor_out",
        tmp_path / "rom.h5",
    ).out
    solved = re.search(r"(\d+) solved columns", done)
    peak = re.search(r"peak (\d+) MB", done)
    assert solved and peak
    assert 0.7 < int(solved[1]) / int(count[1]) < 1.5
    assert 0.7 < int(peak[1]) / int(megabytes[1]) < 1.4


@pytest.mark.parametrize("ranks", [pytest.param(1, marks=pytest.mark.kernels), 2])
def test_each_kind_keeps_its_own(ranks: int, body: Path, tmp_path: Path) -> None:
    plain = certified(body, BAND, tmp_path, "-mor_tol", "1e-4", ranks=ranks)
    loose = certified(
        body, BAND, tmp_path, "-mor_tol", "1e-4", "-mor_tol_kind", "stress=5e-2", ranks=ranks
    )
    assert_certified(loose)
    asked = limits(ReducedModel.load(loose["path"]))
    assert asked["stress from force"][1] == pytest.approx(5e-2)
    assert asked["displacement from force"][1] == pytest.approx(1e-4)
    assert all(claim <= limit * (1 + 1e-12) for claim, limit in asked.values())
    assert asked["stress from pressure"][0] > 1e-4  # the leave was taken
    assert loose["met"] and loose["order"] < plain["order"]
    mixed = certified(
        body,
        BAND,
        tmp_path,
        "-mor_tol",
        "1e-2",
        "-mor_tol_kind",
        "displacement from force=1e-5,stress=1e-3",
        ranks=ranks,
    )
    assert_certified(mixed)
    asked = limits(ReducedModel.load(mixed["path"]))
    assert asked["displacement from force"][0] <= 1e-5
    assert asked["stress from moment"] == (asked["stress from moment"][0], pytest.approx(1e-3))
    assert asked["displacement from pressure"][1] == pytest.approx(1e-2)
    assert all(claim <= limit * (1 + 1e-12) for claim, limit in asked.values())


def test_a_cut_keeps_it_too(body: Path, tmp_path: Path) -> None:
    """Out of a medium model that was made for it, or for the tightest of all."""
    kinds = ("-mor_tol", "1e-3", "-mor_tol_kind", "stress=2e-2")
    medium, rom = tmp_path / "medium.h5", tmp_path / "rom.h5"
    straight = certified(body, BAND, tmp_path, *kinds)
    for given in (kinds, ("-mor_tol", "1e-3")):
        run("certify", "-body", body, "-mor_band_hz", "100,6000", "-mor_medium_out", medium, *given)
        run("cut", "-medium", medium, "-mor_out", rom, *kinds)
        cut = ReducedModel.load(rom)
        assert cut.met and cut.order == straight["order"]
        if given == kinds:
            assert np.allclose(cut.by_kind, straight["by_kind"], rtol=1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("-mor_tol_kind", "torque=1e-2"), "KIND=TOLERANCE"),
        (("-mor_tol_kind", "stress=2"), "a tolerance above 0 and below 1"),
        (("-mor_tol_kind", "stress"), "KIND=TOLERANCE"),
        (("-mor_tol_kind", "rotation from spin=1e-2"), "no ports make rotation from spin"),
        (("-mor_tol_kind", "stress=1e-2", "-mor_tol_of", "whole"), "each_kind"),
        (("-mor_tol_kind", "stress=1e-2", "-mor_order", "20"), "no tolerance chooses the order"),
        (("-mor_tol_kind", "stress=1e-2", "-mor_method", "pod"), "given beside --tol"),
        (("-mor_tol_kind", "stress=1e-2", "-mor_method", "modal"), "given beside --tol"),
        (("-mor_tol_kind", "stress=1e-2,stress=1e-1"), "of each kind once"),
    ],
)
def test_what_is_refused(options: tuple[str, ...], words: str, body: Path, tmp_path: Path) -> None:
    done = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "100,6000",
        "-mor_out",
        tmp_path / "rom.h5",
        *options,
        expect=1,
    )
    assert words in done.err + done.out
