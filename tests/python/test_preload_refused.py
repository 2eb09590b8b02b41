"""Preloads that are wrong, and bodies that cannot bear theirs: each is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from test_preload import LOADED

import flexgram
from bodies import box
from flexgram import BodyError
from flexgram.body.description import import_description

RIGID = {"end": {"coupling": "rigid", "nodes": "end"}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"preload": {"turn": 1.0}}, "must be an input"),
        ({"preload": {"trun.spin": 1.0}}, "did you mean turn?"),
        ({"preload": {"turn.spin": "fast"}}, "must be a number"),
    ],
)
def test_a_wrong_preload_is_named(change: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words.replace("?", r"\?")):
        import_description(
            LOADED | change, "box", tmp_path / "body.h5", mesh=box("tetra10", (2, 1, 1))
        )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"preload": {"turn.ax": 1.0}}, "did you mean turn.spin"),
        ({"preload": {"turn.spin": -1.0}}, "square of a speed, and negative"),
        ({"preload": {"end.fx": -4e6}}, "buckled"),
        ({"preload": {"turn.spin": 1.0, "spin.spin": 1.0}}, "a body turns about one axis"),
        ({"preload": {"rim.load": 1.0}, "interfaces": RIGID}, "nodes of a rigid interface"),
    ],
)
def test_a_body_that_cannot_bear_it(change: Any, words: str, tmp_path: Path) -> None:
    import_description(LOADED | change, "box", tmp_path / "body.h5", mesh=box("tetra10", (6, 1, 1)))
    with pytest.raises(BodyError, match=words):
        flexgram.reduce(tmp_path / "body.h5", (100, 2000), 1e-3)


def test_a_free_body_bears_no_preload(tmp_path: Path) -> None:
    """The import refuses it; a part that is free beside one that is held, the reduction."""
    mesh = box("tetra10", (6, 1, 1))
    free = LOADED | {"preload": {"turn.spin": 1.0}, "supports": {}}
    with pytest.raises(BodyError, match="a preload needs supports: 6 of 6"):
        import_description(free, "box", tmp_path / "body.h5", mesh=mesh)
    count = len(mesh.points)
    two = meshio.Mesh(
        np.vstack([mesh.points, mesh.points + np.array([0, 1, 0])]),
        [("tetra10", np.vstack([mesh.cells[0].data, mesh.cells[0].data + count]))],
        point_sets=mesh.point_sets,
    )
    held = LOADED | {"preload": {"turn.spin": 1.0}}
    import_description(held, "box", tmp_path / "body.h5", mesh=two)
    with pytest.raises(BodyError, match="a preload or a spin needs supports"):
        flexgram.reduce(tmp_path / "body.h5", (100, 2000), 1e-3)
