"""The Python tools: body files from SciPy, pictures, messages."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import ROOT, chain, run
from flexgram import write_matrices
from flexgram.__main__ import main


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"M": np.eye(59)}, "M has shape"),
        ({"B": np.ones(60)}, "B has shape"),
        ({"C": np.ones((60, 2))}, "C has shape"),
        ({"M": (1 + 0.02j) * np.eye(60)}, "M is complex"),
        ({"outputs": ["a"]}, "C is not given"),
        ({"inputs": ["a"]}, "1 names for 2 ports"),
    ],
)
def test_matrices_that_do_not_fit(change: dict[str, Any], expected: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=expected):
        write_matrices(tmp_path / "body.h5", **chain(**change))
    assert not (tmp_path / "body.h5").exists()


def test_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body, rom, sweep = (tmp_path / name for name in ("body.h5", "rom.h5", "sweep.h5"))
    write_matrices(body, **chain())
    run("reduce", "-body", body, "-mor_band_hz", "0.01,0.3", "-mor_out", rom)
    run("sweep", "-body", body, "-rom", rom, "-mor_sweep_hz", "0.02,0.2,9", "-mor_sweep_out", sweep)
    for name, extra in (("a.png", ["--rom", str(rom)]), ("b.svg", [])):
        assert main(["plot", str(sweep), "-o", str(tmp_path / name), *extra]) == 0
        assert (tmp_path / name).stat().st_size > 5000
    for arguments, expected in (
        ([str(body), "-o", "x.png"], "is no sweep file"),
        ([str(sweep), "--rom", str(sweep), "-o", "x.png"], "is no reduced file"),
        (["none.h5", "-o", "x.png"], "no such file"),
        ([str(sweep), "-o", str(tmp_path / "x.foo")], "x.foo"),
    ):
        assert main(["plot", *arguments]) == 1
        assert expected in capsys.readouterr().err


def test_options_reference_is_up_to_date() -> None:
    """Both files are what scripts/options_reference.py makes of the registry."""
    sys.path.insert(0, str(ROOT / "scripts"))
    import options_reference as made

    assert made.PAGE.read_text() == made.reference()
    assert made.KEYWORDS.read_text() == made.keywords()
