"""Drawings of meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexgram
from bodies import box, write_body_file
from flexgram.pictures import drawings


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> flexgram.ReducedModel:
    """A straight bar, 6 × 2 × 2 hexahedra, along x."""
    path = tmp_path_factory.mktemp("bar") / "bar.h5"
    mesh = box("hexahedron", (6, 2, 2), (0.6, 0.1, 0.1), distort=False)
    ends = {n: {"set": n, "coupling": "rigid"} for n in ("start", "end")}
    write_body_file(path, mesh, interfaces=ends, damping=(5.0, 1e-7, 0))
    return flexgram.reduce(path, (10, 2000), 1e-2)


def test_what_is_behind_is_left_out(bar: flexgram.ReducedModel) -> None:
    """Of a closed surface those faces are drawn that one sees: three of the six sides of a bar, and
    where the mesh is one of shells all."""
    figure = drawings.shapes(bar, count=0)
    (axes,) = figure.axes
    count = len(axes.collections[0].get_paths())
    assert count == 2 * (2 * 2 + 6 * 2 + 6 * 2)
    geometry, triangles = drawings._surface(bar, None)
    assert drawings._is_closed(triangles)
    assert not drawings._is_closed(triangles[1:]) and not drawings._is_closed(
        triangles[:, ::-1][:1]
    )
    assert len(triangles) == 2 * count and len(geometry.points) == 7 * 3 * 3


def test_the_body_fills_the_picture(bar: flexgram.ReducedModel) -> None:
    """Its extent in the plane that is seen, at an azimuth of -60 and an elevation of 30 degrees."""
    (axes,) = drawings.shapes(bar, count=0).axes
    geometry, _ = drawings._surface(bar, None)
    azimuth, elevation = np.radians([-60, 30])
    near = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    assert np.allclose(drawings._EYE.near, near) and np.isclose(
        drawings._EYE.right @ drawings._EYE.near, 0
    )
    assert np.allclose(np.cross(drawings._EYE.right, drawings._EYE.up), near)
    flat = drawings._EYE.flat(geometry.points)
    limits = np.array([axes.get_xlim(), axes.get_ylim()]).T
    size = np.ptp(flat, axis=0)
    assert np.all(limits[0] <= flat.min(axis=0)) and np.all(limits[1] >= flat.max(axis=0))
    assert np.all(np.ptp(limits, axis=0) <= 1.2 * size)


def test_stress_is_in_megapascal(bar: flexgram.ReducedModel, tmp_path: Path) -> None:
    q = np.zeros(bar.order)
    q[bar.frame.rigid_modes] = 1e-4
    figure = drawings.stress(bar, q)
    scale = figure.axes[1]
    assert scale.get_ylabel() == "von Mises stress [MPa]"
    largest = np.nanmax(flexgram.body.stress.von_mises(bar.stress(q[None])[0])) / 1e6
    assert 0.5 * largest < scale.get_ylim()[1] <= largest  # means of three corners
    flexgram.figures.save(figure, tmp_path / "stress.png")
    assert (tmp_path / "stress.png").stat().st_size > 3000
