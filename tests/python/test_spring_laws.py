"""Springs that relax, or whose stiffness is known between two numbers, against matrices by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from test_discrete import beam, matrices

import flexgram
from conftest import run
from flexgram import BodyError, Matrices, ReducedModel

MOUNT = {"at": "foot", "stiffness": [2e6, 3e6, 4e6, 5e3, 6e3, 7e3]}
BAND = (5.0, 900.0)
#: The tip hangs on springs that are known, too.
TIP = {"at": "tip", "stiffness": [1e5, 1e5, 1e5, 1e3, 1e3, 1e3]}


def reduced(folder: Path, ranks: int, **mount: Any) -> ReducedModel:
    body, out = folder / "body.h5", folder / "rom.h5"
    beam(body, springs={"mount": MOUNT | mount, "tip": TIP}, damping={"alpha": 3.0, "beta": 1e-6})
    run(
        *("reduce", "-body", body, "-mor_band_hz", "5,900", "-mor_tol", "1e-4", "-mor_out", out),
        ranks=ranks,
    )
    return ReducedModel.load(out)


def by_hand(folder: Path, law: Any, share: float, loss: float = 0.0) -> Matrices:
    """The same body, its mount's stiffness a term; K holds a share of it."""
    less = {"mount": MOUNT | {"stiffness": list(share * np.array(MOUNT["stiffness"]))}, "tip": TIP}
    a = matrices(folder, "least", springs=less, damping={"alpha": 3.0, "beta": 1e-6})
    none = matrices(folder, "none", springs={"tip": TIP}, damping={"alpha": 3.0, "beta": 1e-6})
    T = sp.csr_matrix(a["K"] - none["K"])
    S = {"S": loss * T} if loss else {}
    return Matrices(
        *(sp.csr_matrix(a["K"]), sp.csr_matrix(a["M"]), a["B"]),
        **{"alpha": 3.0, "beta": 1e-6, "inputs": a["names"], "terms": {"law": (T, law)}},
        **S,
    )


def same(one: ReducedModel, other: ReducedModel) -> None:
    order = [other.inputs.index(name) for name in one.inputs]
    for hertz in (5.0, 77.0, 333.0, 900.0):
        H, second = (rom.transfer(2 * np.pi * hertz) for rom in (one, other))
        second = second[np.ix_(order, order)]
        assert np.linalg.norm(H - second) <= 2.5e-4 * np.linalg.norm(H)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_mount_that_relaxes(ranks: int, tmp_path: Path) -> None:
    """Shares of the instantaneous stiffness, which the given one is, or is not."""
    rom = reduced(tmp_path, ranks, viscoelastic={"prony": [[0.3, 1e-3]]})
    assert rom.met and [term.name for term in rom.system.terms] == ["mount"]
    same(rom, flexgram.reduce(by_hand(tmp_path, flexgram.prony(0.3 / 0.7, 1e-3), 1.0), BAND, 1e-4))
    at_once = {"prony": [[0.3, 1e-3]], "moduli": "instantaneous"}
    rom = reduced(tmp_path, ranks, viscoelastic=at_once)
    same(rom, flexgram.reduce(by_hand(tmp_path, flexgram.prony(0.3 / 0.7, 1e-3), 0.7), BAND, 1e-4))


@pytest.mark.parametrize("ranks", [2])
def test_a_mount_known_between_two_numbers(ranks: int, tmp_path: Path) -> None:
    """Its loss factor is one of all that it is; other springs have none."""
    rom = reduced(tmp_path, ranks, parameter={"stiffness": [0.5, 2.0]}, loss_factor=0.1)
    assert list(rom.system.parameters) == ["stiffness_mount"]
    law = flexgram.parameter(0.5, 2.0, 1.0, slope=2.0, loss=0.1)
    other = flexgram.reduce(by_hand(tmp_path, law, 0.5, 0.1), BAND, 1e-4)
    same(rom, other)
    for value in (0.5, 2.0):
        same(rom.at(stiffness_mount=value), other.at(law=value))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"parameter": {"E": [1, 2]}}, "unknown key E; there are stiffness"),
        ({"parameter": {"stiffness": [2, 3]}}, "must rise from a positive number, with 1"),
        ({"viscoelastic": {"table": {}}}, "are for isotropic materials"),
    ],
)
def test_what_a_spring_is_not(more: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        beam(tmp_path / "body.h5", springs={"mount": MOUNT | more})
    dashpot = {"at": "foot", "damping": [1.0, 1.0, 1.0], "parameter": {"stiffness": [0.5, 2]}}
    with pytest.raises(BodyError, match="stiffness is missing"):
        beam(tmp_path / "body.h5", springs={"mount": dashpot})
