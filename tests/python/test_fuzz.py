"""A few mutated files of every kind; ``scripts/fuzz`` tries more."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from fuzz import KINDS

from conftest import ENVIRONMENT, PYTHON


@pytest.mark.parametrize("kind", [kind.__name__ for kind in KINDS])
def test_mutated_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    fuzz = Path(__file__).with_name("fuzz.py")
    done = subprocess.run(
        [str(PYTHON), str(fuzz), "20", "20261121", "--kind", kind, "--place", str(tmp_path)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    name, tried, _, refused, crashed = done.stdout.splitlines()[1].split()
    assert (name, tried, crashed) == (kind, "20", "0") and int(refused) > 0
