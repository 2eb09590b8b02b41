"""A few mutated files of every kind; ``scripts/fuzz`` tries more."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzz import KINDS, Kind, fuzz


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_mutated_files_are_read_or_refused(kind: Kind, tmp_path: Path) -> None:
    found, first = fuzz(kind, 20, 20261121, tmp_path)
    assert found["crashed"] == 0, first
    assert found["refused"] > 0
