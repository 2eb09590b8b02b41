"""An assembly in space: its parts meet where joints bring them, and move as they do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexgram
from bodies import box
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.assembly.couple import couple
from flexgram.assembly.joints import Joint
from flexgram.body.description import import_description
from flexgram.model.elastic_part import without_rigid_modes
from flexgram.pictures.report import write_report
from flexgram.pictures.scene import libraries
from flexgram.pictures.space import Space

TURN = [0.3, -0.2, 1.1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two bars, each from its own origin, with their reduced files."""
    where = tmp_path_factory.mktemp("space")
    for name, length in (("arm", 0.4), ("rod", 0.3)):
        content = {
            "materials": {"s": {"E": 7e10, "nu": 0.3, "rho": 2700}},
            "regions": {"all": {"material": "s"}},
            "damping": {"beta": 1e-6},
            "interfaces": {
                "a": {"coupling": "rigid", "nodes": "start"},
                "b": {"coupling": "rigid", "nodes": "end"},
            },
        }
        mesh = box("hexahedron20", (6, 2, 2), (length, 0.02, 0.02), False)
        import_description(content, name, where / f"{name}.h5", mesh=mesh)
        rom = flexgram.reduce(where / f"{name}.h5", (5, 1500), 1e-4, statics=True)
        rom.save(where / f"{name}.rom.h5")
    return where


def joined(folder: Path, *, held: bool = True) -> ReducedModel:
    parts = {n: ReducedModel.load(folder / f"{n}.rom.h5") for n in ("arm", "rod")}
    joints = [Joint("arm.b", "rod.a"), *([Joint("arm.a", "ground")] if held else [])]
    return couple(parts, joints, turns={"rod": TURN}, keep=["rod.a"])


@pytest.mark.parametrize("held", [True, False])
def test_parts_meet_and_move_together(held: bool, folder: Path, tmp_path: Path) -> None:
    """The end of the arm and the beginning of the rod are one place, also in motion; the end of the
    rod moves as its port says, along the rod's own axes. (Shapes of double modes are turned by some
    1e-7 beside the ports.)"""
    joined(folder, held=held).save(tmp_path / "ab.rom.h5")
    model = ReducedModel.load(tmp_path / "ab.rom.h5")
    space = Space.of(model)
    of = space.geometry.interfaces
    at = {name: space.geometry.points[nodes].mean(axis=0) for name, nodes in of.items()}
    np.testing.assert_allclose(at["arm.b"], at["rod.a"], atol=1e-12)
    R = Rotation.from_rotvec(TURN).as_matrix()
    np.testing.assert_allclose(at["rod.b"] - at["rod.a"], R @ [0.3, 0, 0], atol=1e-12)
    q = np.random.default_rng(1).standard_normal((3, model.order))
    moved = space.motion(model, q)
    mean = {name: moved[:, nodes].mean(axis=1) for name, nodes in of.items()}
    size = np.abs(moved).max()
    np.testing.assert_allclose(mean["arm.b"], mean["rod.a"], atol=1e-6 * size)
    rows = [model.outputs.index(f"rod.b.f{c}") for c in "xyz"]
    np.testing.assert_allclose(mean["rod.b"], q @ model.C[rows].T @ R.T, atol=1e-6 * size)
    if held:
        assert np.abs(moved[:, of["arm.a"]]).max() < 1e-6 * size
    else:
        elastic = without_rigid_modes(model)
        p = np.random.default_rng(2).standard_normal((2, elastic.order))
        tip = space.motion(elastic, p)[:, of["rod.b"]].mean(axis=1)
        np.testing.assert_allclose(tip, p @ elastic.C[rows].T @ R.T, atol=1e-6 * np.abs(tip).max())


def test_the_report_shows_it(folder: Path, tmp_path: Path) -> None:
    """With modes and a load history; without the files of its parts it says what is missing."""
    joined(folder).save(tmp_path / "ab.rom.h5")
    t = np.linspace(0, 0.1, 101)
    loads = np.column_stack([t, np.sin(300 * t)])
    np.savetxt(tmp_path / "l.csv", loads, delimiter=",", header="t,rod.b.fz", comments="")
    made = write_report(tmp_path / "ab.rom.h5", tmp_path / "ab.html", loads=tmp_path / "l.csv")
    page = (tmp_path / "ab.html").read_text()
    assert "<h1>arm with rod, reduced</h1>" in page
    if libraries():
        assert "<h2>The assembly</h2>" in page and not any("shapes" in words for words in made.left)
        assert not any("in space" in words for words in made.left)
    run("report", tmp_path / "ab.rom.h5", "-o", tmp_path / "again.html")
    parts = {n: ReducedModel.load(folder / f"{n}.rom.h5") for n in ("arm", "rod")}
    parts["rod"].path = None
    unknown = couple(parts, [Joint("arm.b", "rod.a")])
    with pytest.raises(BodyError, match="part rod has no reduced file: nothing to draw"):
        Space.of(unknown)
