"""Frequency responses between ports: tables, universal files as pyuff reads them, measured ones."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from test_superelements import reduced

from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.measured.frf import frac, read_universal, responses, write_universal

PAIRS = [("end.fz", "start.fz"), ("end.my", "end.fy")]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> ReducedModel:
    return reduced(tmp_path_factory.mktemp("frf"))


@pytest.mark.parametrize("even", [True, False])
def test_universal_files(even: bool, model: ReducedModel, tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    hertz = np.linspace(20, 1900, 301) if even else np.geomspace(20, 1900, 301)
    ours = responses(model, PAIRS, hertz, "acceleration")
    write_universal(ours, tmp_path / "r.unv", "a beam")
    sets = pyuff.UFF(str(tmp_path / "r.unv")).read_sets()
    assert len(sets) == 2
    w = 2 * np.pi * hertz
    H = model.transfer(w)
    for k, (output, port) in enumerate(PAIRS):
        truth = -w * w * H[:, model.outputs.index(output), model.inputs.index(port)]
        assert np.allclose(sets[k]["data"], truth, rtol=1e-10)
        assert np.allclose(sets[k]["x"], hertz, rtol=2e-5 if not even else 1e-5)
        assert sets[k]["func_type"] == 4 and sets[k]["ordinate_spec_data_type"] == 12
    assert sets[0]["rsp_ent_name"].strip() == "end" and sets[0]["rsp_dir"] == 3
    assert sets[1]["rsp_dir"] == 5 and sets[1]["ref_dir"] == 2
    again = read_universal(tmp_path / "r.unv")
    for r, back in zip(ours, again, strict=True):
        assert np.allclose(back.values, r.values, rtol=1e-10) and back.rate == "acceleration"
        assert (back.nodes, back.directions) == (r.nodes, r.directions)


@pytest.mark.parametrize("double", [True, False])
def test_measured_by_others(double: bool, model: ReducedModel, tmp_path: Path) -> None:
    """A file that pyuff wrote, of the same beam measured with noise."""
    pyuff = pytest.importorskip("pyuff")
    hertz = np.linspace(20, 1900, 200)
    rng = np.random.default_rng(4)
    truth = responses(model, [PAIRS[0]], hertz)[0].values
    noisy = truth * (1 + 0.02 * (rng.standard_normal(200) + 1j * rng.standard_normal(200)))
    data = pyuff.prepare_58(
        binary=0,
        func_type=4,
        rsp_node=1,
        rsp_dir=3,
        ref_dir=3,
        ref_node=2,
        data=noisy,
        x=hertz,
        id1="test",
        rsp_ent_name="a",
        ref_ent_name="b",
        abscissa_spacing=1,
        ordinate_spec_data_type=8,
        orddenom_spec_data_type=13,
        abscissa_spec_data_type=18,
        ord_data_type=6 if double else 5,
        return_full_dict=True,
    )
    texts = ("id", "lab", "name")
    data = {
        key: ("NONE" if any(t in key for t in texts) and "load" not in key else 0)
        if value is None
        else value
        for key, value in data.items()
    }
    pyuff.UFF(str(tmp_path / "test.unv")).write_sets([data], "add")
    read = read_universal(tmp_path / "test.unv")[0]
    assert np.allclose(read.values, noisy, rtol=1e-9 if double else 1e-4)
    assert np.allclose(read.hertz, hertz, rtol=1e-4)
    assert model.path is not None
    said = run(
        "frf",
        model.path,
        "--pair",
        "=".join(PAIRS[0]),
        "--measured",
        tmp_path / "test.unv",
        "-o",
        tmp_path / "both.png",
    ).out
    likeness = float(said.partition("FRAC")[2].split()[0])
    assert 0.99 < likeness < 1 and likeness == pytest.approx(frac(truth, noisy), abs=2e-3)
    assert (tmp_path / "both.png").stat().st_size > 5000
    refused = run(
        "frf",
        model.path,
        "--pair",
        "=".join(PAIRS[0]),
        "--rate",
        "velocity",
        "--measured",
        tmp_path / "test.unv",
        "-o",
        tmp_path / "x.png",
        expect=1,
    )
    assert "response 1 is a displacement: --rate displacement" in refused.err


def test_tables_and_what_is_refused(model: ReducedModel, tmp_path: Path) -> None:
    assert model.path is not None
    run(
        "frf",
        model.path,
        "--pair",
        "end.fz=start.fz",
        "--hz",
        "50,500,10",
        "-o",
        tmp_path / "r.csv",
    )
    table = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    H = model.transfer(2 * np.pi * table[:, 0])
    i, j = model.outputs.index("end.fz"), model.inputs.index("start.fz")
    assert np.allclose(table[:, 1] + 1j * table[:, 2], H[:, i, j], rtol=1e-12)
    for words, what in (
        (["--pair", "end.fz"], "expected OUTPUT=INPUT"),
        (["--pair", "end.fz=top.fz"], "there is no input top.fz"),
        (["--pair", "end.fz=end.fz", "--hz", "1,2"], "expected 3 finite numbers"),
        (["--pair", "end.fz=end.fz", "--measured", tmp_path / "r.csv"], "no frequency response"),
    ):
        assert what in run("frf", model.path, *words, "-o", tmp_path / "x.csv", expect=1).err
    with pytest.raises(BodyError, match="finite and not negative"):
        responses(model, [PAIRS[0]], [-1.0])
    assert frac([1, 2, 3j], [2j, 4j, -6]) == pytest.approx(1)


def test_a_table_tells_quantity_and_unit_and_may_have_equal_ratios(
    model: ReducedModel, tmp_path: Path
) -> None:
    table = tmp_path / "x.csv"
    pair = ("--pair", "end.fx=end.fx", "--rate", "acceleration")
    run("frf", model.path, *pair, "--hz", "10,1000,5", "--log", "-o", table)
    head, *rows = csv.reader(table.read_text().splitlines())
    assert head == [
        "Hz",
        "Re acceleration end.fx from end.fx [m/s2/N]",
        "Im acceleration end.fx from end.fx [m/s2/N]",
    ]
    hertz = [float(row[0]) for row in rows]
    assert hertz == pytest.approx([10, 10**1.5, 100, 10**2.5, 1000])
    said = run("frf", model.path, *pair, "--hz", "0,1000,5", "--log", "-o", table, expect=1).err
    assert "a first frequency above 0" in said
