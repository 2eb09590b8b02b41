"""What the program warns of reaches whoever uses its results."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from conftest import program, run
from flexgram.assembly.couple import couple
from flexgram.assembly.joints import Joint

WORDS = "its error is .* of its elastic motion"


def free_chain(n: int = 60) -> flexgram.Matrices:
    """Unit masses on springs, no supports, ports at its ends."""
    K = sp.diags([2.0, -1, -1], [0, 1, -1], shape=(n, n)).tolil()
    K[0, 0] = K[-1, -1] = 1
    B = np.zeros((n, 2))
    B[0, 0] = B[-1, 1] = 1
    ports = ["left.fx", "right.fx"]
    return flexgram.Matrices(K.tocsr() * 1e6, sp.eye(n).tocsr(), B, inputs=ports, alpha=1.0)


@pytest.fixture(scope="module")
def warned() -> flexgram.ReducedModel:
    """Its claim is of H, which is mostly rigid motion: a third of the elastic motion is wrong."""
    with pytest.warns(flexgram.ReductionWarning, match=WORDS) as caught:
        rom = flexgram.reduce(free_chain(), (0.05, 0.5), 1e-2, relative_to="pointwise")
    assert [str(w.message) for w in caught] == rom.provenance.warnings
    assert [w.filename for w in caught] == [__file__]  # the user's line, not one of flexgram's
    assert rom.claim.met
    return rom


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_first_rank_warns_of_all(
    ranks: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = program("warned", ranks=ranks).splitlines()
    assert said[0] == "rank 0: all of 2, 0 elsewhere"
    assert said[1:] == ["rank 1: 0 of 2, 0 elsewhere"] * (ranks - 1)
    kept = run("info", "warned.rom.h5").out
    assert re.search(f"^ *warning: .*{WORDS}", kept, re.MULTILINE)


def test_a_result_shows_that_it_was_warned_of(warned: flexgram.ReducedModel) -> None:
    assert repr(warned).endswith(", 1 warning>")
    assert re.search(f"warning</th>.*{WORDS}", warned._repr_html_())


def test_a_result_without_warnings_shows_none() -> None:
    rom = flexgram.reduce(free_chain(), (0.05, 0.5), 1e-2)
    assert not rom.provenance.warnings
    assert "warning" not in repr(rom) + rom._repr_html_()


def test_a_unit_of_fmi_says_it(warned: flexgram.ReducedModel, tmp_path: Path) -> None:
    flexgram.export(warned, tmp_path / "chain.fmu", "fmu")
    with zipfile.ZipFile(tmp_path / "chain.fmu") as unit:
        assert re.search(WORDS, unit.read("modelDescription.xml").decode())


def test_an_assembly_names_the_part(warned: flexgram.ReducedModel) -> None:
    other = flexgram.reduce(free_chain(), (0.05, 0.5), 1e-2)
    tie = Joint("a.right", "b.left", directions=("x",))
    whole = couple({"a": warned, "b": other}, [tie])
    assert len(whole.provenance.warnings) == 1
    assert re.match(f"a: .*{WORDS}", whole.provenance.warnings[0])
    assert "1 warning" in repr(whole)
