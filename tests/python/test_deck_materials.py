"""Orthotropic materials, orientations and layers of decks, against ccx and descriptions in YAML."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from test_assemble_deck import deck
from test_importers import ccx_frequencies

from conftest import assembled
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck

ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
TIP = [parse("node", "tip=NODES:20")]
E, NU, G = (120e9, 10e9, 8e9), (0.3, 0.25, 0.4), (5e9, 4e9, 3e9)
CONSTANTS = (
    "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
    + ", ".join(map(repr, (*E, *NU, *G[:2])))
    + f"\n{G[2]!r}\n"
)
ORIENTATION = "*ORIENTATION, NAME=FIBRE\n0.8, 0.6, 0., -0.6, 0.8, 0.1\n"


def stiffness() -> str:
    """The same as nine entries of the stiffness."""
    S = np.diag(1 / np.array(E))
    S[0, 1] = S[1, 0] = -NU[0] / E[0]
    S[0, 2] = S[2, 0] = -NU[1] / E[0]
    S[1, 2] = S[2, 1] = -NU[2] / E[1]
    C = np.linalg.inv(S)
    nine = (C[0, 0], C[0, 1], C[1, 1], C[0, 2], C[1, 2], C[2, 2], *G)
    words = [repr(float(x)) for x in nine]
    return "*ELASTIC, TYPE=ORTHO\n" + ", ".join(words[:8]) + f"\n{words[8]}\n"


def turned(path: Path, element: str, elastic: str, orientation: str = ORIENTATION) -> Path:
    deck(path, element, held="*BOUNDARY\nSTART, 1, 3\n")
    text = path.read_text().replace("*ELASTIC\n210e9, 0.3\n", elastic)
    option = ", ORIENTATION=FIBRE" if orientation else ""
    section = "*SOLID SECTION,ELSET=BODY, MATERIAL=STEEL"
    assert section in text and elastic in text
    path.write_text(text.replace(section, orientation + section + option))
    return path


def frequencies(folder: Path, path: Path) -> Any:
    assemble_deck(path, folder / "body.h5", TIP)
    a = assembled(folder / "matrices.h5", folder / "body.h5")
    squares = eigsh(a["K"], 8, a["M"], sigma=0, return_eigenvectors=False)
    return np.sqrt(np.sort(squares)) / (2 * np.pi)


@ccx
@pytest.mark.parametrize("element", ["C3D8", "C3D10"])
def test_orthotropic_solids_are_those_of_ccx(element: str, tmp_path: Path) -> None:
    """By engineering constants and by stiffness, along an orientation and along the axes."""
    found = []
    for elastic in (CONSTANTS, stiffness()):
        for orientation in (ORIENTATION, ""):
            path = turned(tmp_path / "bar.inp", element, elastic, orientation)
            ours = frequencies(tmp_path, path)
            np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=1e-6)
            found.append(ours)
    np.testing.assert_allclose(found[0], found[2], rtol=1e-9)
    assert np.abs(found[1] / found[0] - 1).max() > 0.05


#: A stiffness without symmetries, xx yy zz xy xz yz [Pa].
ROOT = np.random.default_rng(7).normal(size=(6, 6))
ANY = 1e10 * (ROOT @ ROOT.T + 6 * np.eye(6))


def anisotropic() -> str:
    words = [repr(float(ANY[row, column])) for column in range(6) for row in range(column + 1)]
    rows = [", ".join(words[k : k + 8]) for k in (0, 8, 16)]
    return "*ELASTIC, TYPE=ANISO\n" + "\n".join(rows) + "\n"


@ccx
@pytest.mark.parametrize("orientation", [ORIENTATION, ""])
@pytest.mark.parametrize("element", ["C3D8", "C3D10"])
def test_anisotropic_solids_are_those_of_ccx(
    element: str, orientation: str, tmp_path: Path
) -> None:
    path = turned(tmp_path / "bar.inp", element, anisotropic(), orientation)
    ours = frequencies(tmp_path, path)
    np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=1e-6)


def test_an_orientation_that_is_turned_about_an_axis(tmp_path: Path) -> None:
    """Its further row, of Abaqus: 30° about the third axis."""
    by_row = "*ORIENTATION, NAME=FIBRE\n1., 0., 0., 0., 1., 0.\n3, 30.\n"
    by_points = (
        "*ORIENTATION, NAME=FIBRE\n0.8660254037844387, 0.5, 0., -0.5, 0.8660254037844387, 0.\n"
    )
    found = [
        frequencies(tmp_path, turned(tmp_path / "bar.inp", "C3D8", CONSTANTS, words))
        for words in (by_row, by_points)
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-10)


SHEET = """*NODE
1,0,0,0
2,.1,0,0
3,.1,.1,0
4,0,.1,0
5,.2,0,.02
6,.2,.1,.02
*ELEMENT,TYPE=S4,ELSET=E
1,1,2,3,4
2,2,5,6,3
*MATERIAL,NAME=PLY
*ELASTIC,TYPE=LAMINA
120e9,10e9,0.3,5e9,4e9,3e9
*DENSITY
1600.
*MATERIAL,NAME=CORE
*ELASTIC
1e9,.3
*DENSITY
200.
*ORIENTATION,NAME=A
1.,1.,0.,-1.,1.,0.
*SHELL SECTION,ELSET=E,{section}
{rows}
*BOUNDARY
1,1,6
4,1,6
*STEP
*FREQUENCY
4
*END STEP
"""
PLY = {"E1": 120e9, "E2": 10e9, "E3": 10e9, "nu12": 0.3, "nu13": 0.0, "nu23": 0.0}
PLY |= {"G12": 5e9, "G13": 4e9, "G23": 3e9, "rho": 1600.0}


@pytest.mark.parametrize(
    ("section", "rows", "yaml"),
    [
        ("MATERIAL=PLY,ORIENTATION=A", "0.004", {"thickness": 0.004, "axis_1": [1, 1, 0]}),
        (
            "COMPOSITE,ORIENTATION=A,OFFSET=SPOS",
            "0.001,3,PLY,0.\n0.002,3,CORE\n0.0015,3,PLY,45.",
            {
                "layers": [
                    {"material": "PLY", "thickness": 0.001},
                    {"material": "CORE", "thickness": 0.002},
                    {"material": "PLY", "thickness": 0.0015, "angle": 45.0},
                ],
                "offset": -0.00225,
                "axis_1": [1, 1, 0],
            },
        ),
    ],
    ids=["one material", "layers"],
)
def test_shells_along_orientations(section: str, rows: str, yaml: Any, tmp_path: Path) -> None:
    (tmp_path / "sheet.inp").write_text(SHEET.format(section=section, rows=rows))
    assemble_deck(tmp_path / "sheet.inp", tmp_path / "a.h5", [parse("node", "tip=NODES:6")])
    a = assembled(tmp_path / "am.h5", tmp_path / "a.h5")
    points = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0.2, 0, 0.02], [0.2, 0.1, 0.02]]
    mesh = meshio.Mesh(np.array(points), [("quad", np.array([[0, 1, 2, 3], [1, 4, 5, 2]]))])
    region = {"section": "s"} | ({} if "layers" in yaml else {"material": "PLY"})
    import_description(
        {
            "materials": {"PLY": PLY, "CORE": {"E": 1e9, "nu": 0.3, "rho": 200.0}},
            "sections": {"s": {"shape": "shell", **yaml}},
            "regions": {"all": region},
            "interfaces": {"tip": {"coupling": "node", "nodes": [6]}},
            "supports": {
                "foot": {"nodes": [1, 4], "components": ["x", "y", "z", "rx", "ry", "rz"]}
            },
            "mass_integration": "reduced",
        },
        "sheet",
        tmp_path / "b.h5",
        mesh=mesh,
    )
    b = assembled(tmp_path / "bm.h5", tmp_path / "b.h5")
    for name in ("K", "M"):
        assert abs(a[name] - b[name]).max() < 1e-12 * abs(b[name]).max()


@pytest.mark.parametrize(
    ("elastic", "orientation", "words"),
    [
        ("*ELASTIC, TYPE=LAMINA\n1e9,1e9,.3,1e9,1e9,1e9\n", "", "LAMINA is of shells, not of"),
        ("*ELASTIC, TYPE=ANISO\n1.,2.,3.\n", "", "expected 21 numbers"),
        ("*ELASTIC, TYPE=ENGINEERING CONSTANTS\n1.,2.,3.\n", "", "expected 9 numbers"),
        (CONSTANTS, ORIENTATION.replace("NAME=FIBRE", "NAME=OTHER"), "no orientation FIBRE"),
        (CONSTANTS, "*ORIENTATION, NAME=FIBRE, SYSTEM=SPHERICAL\n0,0,0,0,0,1\n", "only SYSTEM="),
        (CONSTANTS, "*ORIENTATION, NAME=FIBRE, SYSTEM=C\n0,0,1,0,0,1\n", "have no direction"),
        (CONSTANTS, "*ORIENTATION, NAME=FIBRE\n1,0,0,2,0,0\n", "have no direction"),
        (CONSTANTS, "*ORIENTATION, NAME=FIBRE\n1,0,0\n", "expected six numbers"),
    ],
)
def test_what_is_refused(elastic: str, orientation: str, words: str, tmp_path: Path) -> None:
    path = turned(tmp_path / "bar.inp", "C3D8", elastic, orientation)
    with pytest.raises(BodyError, match=words):
        assemble_deck(path, tmp_path / "bar.h5", TIP)
