"""Sections of PBARL: area, second moments and torsion by the corners of each shape."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from test_nastran_whole import PLAIN, bars

from flexgram.basics import BodyError
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk


def polygon(y: Any, z: Any) -> Any:
    """Of a polygon: area, the integrals of y² and z² about the axes, and its middle."""
    y, z = np.asarray(y, dtype=float), np.asarray(z, dtype=float)
    next_y, next_z = np.roll(y, -1), np.roll(z, -1)
    cross = y * next_z - next_y * z
    cross *= np.sign(cross.sum())
    A = cross.sum() / 2
    squares = [((a**2 + a * b + b**2) * cross).sum() / 12 for a, b in ((y, next_y), (z, next_z))]
    middle = [((a + b) * cross).sum() / (6 * A) for a, b in ((y, next_y), (z, next_z))]
    return np.array([A, *squares, *middle])


SHAPES = {
    "T": "40.,60.,5.,4.",
    "T1": "60.,40.,4.,5.",
    "T2": "10.,24.,1.,1.",
    "I": "60.,40.,30.,4.,5.,6.",
    "I1": "36.,4.,50.,60.",
    "CHAN": "30.,60.,4.,5.",
    "CHAN1": "26.,4.,50.,60.",
    "CHAN2": "3.,4.,50.,60.",
    "H": "30.,10.,50.,4.",
    "HAT": "40.,3.,30.,12.",
    "CROSS": "30.,4.,50.,5.",
}


@pytest.mark.parametrize("shape", list(SHAPES))
def test_open_sections(shape: str, tmp_path: Path) -> None:
    """Area and second moments by the boundary of the section that pyNastran draws."""
    from pyNastran.bdf.cards.elements import beam_connectivity

    text = bars(PLAIN).replace(
        "PBAR,1,1,6.-4,4.5-8,2.-8,5.-8", f"PBARL,1,1,,{shape}\n,{SHAPES[shape]}"
    )
    (tmp_path / "b.bdf").write_text(text)
    assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", [parse("node", "tip=NODES:5")])
    with h5py.File(tmp_path / "b.h5") as file:
        (of,) = (dict(section.attrs) for section in file["sections"].values())
    dims = np.array(SHAPES[shape].split(","), dtype=float)
    if shape == "CROSS":  # which it does not draw, nor CHAN2
        arms, web, h, t = dims / 2
        y = np.array([-h, -h, -t, -t, t, t, h, h, t, t, -t, -t])
        z = np.array([-1, 1, 1, 0, 0, 1, 1, -1, -1, 0, 0, -1]) * web
        z += np.array([0, 0, 0, 1, 1, 0, 0, 0, 0, -1, -1, 0]) * (web + arms)
    elif shape == "CHAN2":
        t, floor, h, b = dims
        y = np.array([0, 0, h, h, floor, floor, h, h])
        z = np.array([0, b, b, b - t, b - t, t, t, 0])
    else:
        drawn = getattr(beam_connectivity, f"{shape.lower()}_setup")(dims, dims)[1]
        y, z = drawn[:, 1], drawn[:, 2]
    A, yy, zz, y0, z0 = polygon(y, z)
    I_z, I_y = yy - A * y0**2, zz - A * z0**2
    found = np.array([of["A"], of["I_z"], of["I_y"]])
    np.testing.assert_allclose(found, [A, I_z, I_y], rtol=1e-9)


@pytest.mark.parametrize(
    ("shape", "dims", "torsion"),
    [
        ("BOX1", "40.,60.,2.,2.,3.,1.", 4 * (38 * 58) ** 2 / (2 * 38 / 2 + 58 / 3 + 58 / 1)),
        # a regular one of side 10: the exact torsion constant is 1.0353 a⁴, to 2 %
        ("HEXA", f"5.,20.,{10 * 3**0.5:.14g}", 1.0353e4),
        ("HEXA", "3.,30.,12.", None),
    ],
)
def test_closed_and_full_sections(
    shape: str, dims: str, torsion: float | None, tmp_path: Path
) -> None:
    """By their corners; the area of pyNastran too."""
    from pyNastran.bdf.bdf import BDF

    text = bars(PLAIN).replace("PBAR,1,1,6.-4,4.5-8,2.-8,5.-8", f"PBARL,1,1,,{shape}\n,{dims}")
    (tmp_path / "b.bdf").write_text(text)
    assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", [parse("node", "tip=NODES:5")])
    with h5py.File(tmp_path / "b.h5") as file:
        (of,) = (dict(section.attrs) for section in file["sections"].values())
    d = [float(word) for word in dims.split(",")]
    if shape == "HEXA":
        side, b, h = d
        z = np.array([-b / 2, side - b / 2, b / 2 - side, b / 2, b / 2 - side, side - b / 2])
        A, I_z, I_y, *_ = polygon(np.array([0, -h, -h, 0, h, h]) / 2, z)
    else:
        b, h, top, bottom, left, right = d
        box_of = lambda y0, y1, z0, z1: polygon([y0, y0, y1, y1], [z0, z1, z1, z0])[:3]  # noqa: E731
        A, I_z, I_y = box_of(0, h, 0, b) - box_of(bottom, h - top, left, b - right)
        z0 = (b**2 * h / 2 - (h - top - bottom) * ((b - right) ** 2 - left**2) / 2) / A
        I_z, I_y = I_z - A * (h / 2) ** 2, I_y - A * z0**2
    np.testing.assert_allclose([of["A"], of["I_z"], of["I_y"]], [A, I_z, I_y], rtol=1e-9)
    if torsion is not None:
        assert of["J"] == pytest.approx(torsion, rel=1e-12 if shape == "BOX1" else 0.02)
    model = BDF(debug=None)
    model.read_bdf(tmp_path / "b.bdf", xref=False)
    assert model.properties[1].Area() == pytest.approx(A)
    if shape == "BOX1":  # no two walls alike: principal axes turn
        (tmp_path / "b.bdf").write_text(text.replace(dims, "40.,60.,2.,4.,3.,1."))
        with pytest.raises(BodyError, match="I12 is not supported"):
            assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", [parse("node", "tip=NODES:5")])
