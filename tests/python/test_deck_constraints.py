"""*EQUATION, *TIE and *MPC of CalculiX decks, assembled here, against ccx."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh, spsolve
from test_assemble_deck import deck
from test_constraints import two_boxes
from test_importers import ccx_frequencies

from bodies import CALCULIX
from conftest import assembled, run
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck
from flexgram.importers.deck import read_deck

ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
HELD = "*BOUNDARY\nSTART, 1, 3\n"
EQUATIONS = """*EQUATION
3
40,1,2.,41,2,1.,46,3,-1.5
** a comment between
2
52,2,1.,40,1,-0.25
*EQUATION
2
54,3,1.,53,3,-0.5
"""


def frequencies(folder: Path, path: Path, ports: str = "NODES:20", ranks: int = 1) -> Any:
    facts = assemble_deck(path, folder / "body.h5", [parse("node", f"tip={ports}")])
    a = assembled(folder / "matrices.h5", folder / "body.h5", ranks)
    squares = eigsh(a["K"], 8, a["M"], sigma=0, return_eigenvectors=False)
    return np.sqrt(np.sort(squares)) / (2 * np.pi), facts


@ccx
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("element", ["C3D8", "C3D10"])
def test_equations_are_those_of_ccx(element: str, ranks: int, tmp_path: Path) -> None:
    """Chains of equations, of two cards."""
    found = []
    for name, model in (("plain", ""), ("tied", EQUATIONS)):
        path = deck(tmp_path / f"{name}.inp", element, model=model, held=HELD)
        ours, _ = frequencies(tmp_path, path, ranks=ranks)
        np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=1e-6)
        found.append(ours)
    assert np.abs(found[1] / found[0] - 1).max() > 0.01


TURNED = """*NSET, NSET=TIP
50, 51, 52, 53, 54
*NSET, NSET=MIDDLE
28, 29, 30
*TRANSFORM, NSET=TIP, TYPE=R
0.6, 0.8, 0., -0.8, 0.6, 0.1
*TRANSFORM, NSET=MIDDLE, TYPE=C
0.05, -0.1, 0., 0.05, -0.1, 1.
*EQUATION
2
50, 1, 1., 29, 2, -0.5
"""
SLIDING = HELD + "TIP, 2\nMIDDLE, 1\n"
PUSH = "*STEP\n*STATIC\n*CLOAD\n53, 1, 1000.\n40, 2, 500.\n*NODE PRINT, NSET=TIP\nU\n*END STEP\n"


@ccx
@pytest.mark.parametrize("element", ["C3D8", "C3D10"])
def test_axes_of_nodes_are_those_of_ccx(element: str, tmp_path: Path) -> None:
    """*TRANSFORM: supports, equations and forces along axes of nodes, rectangular and cylindrical.
    Supports of the model, as ccx keeps those of a *FREQUENCY step for itself."""
    path = deck(tmp_path / "bar.inp", element, model=TURNED + SLIDING, step=PUSH)
    ours, _ = frequencies(tmp_path, path)
    np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=1e-6)
    tip = [parse("node", "tip=NODES:20")]
    outputs = {"tip": {"nodes": [53]}}
    assemble_deck(path, tmp_path / "b.h5", tip, deck_loads=True, outputs=outputs)
    a = assembled(tmp_path / "m.h5", tmp_path / "b.h5")
    with h5py.File(tmp_path / "m.h5") as file:
        names, C = list(file["C"].attrs["names"]), file["C"][:]
    C = C.T if C.shape[0] == a["K"].shape[0] else C
    u = spsolve(a["K"].tocsc(), a["B"][:, a["names"].index("step2_cload.load")])
    found = C[[names.index(f"tip.u{c}") for c in "xyz"]] @ u
    printed = [line.split() for line in (tmp_path / "bar.dat").read_text().splitlines()]
    theirs = [row for row in printed if row[:1] == ["53"] and row[-1] == "L"][-1]  # in its axes
    first, third = np.array([0.6, 0.8, 0.0]), np.cross([0.6, 0.8, 0.0], [-0.8, 0.6, 0.1])
    third /= np.linalg.norm(third)
    axes = np.array([first, np.cross(third, first), third])
    size = np.linalg.norm(found)
    np.testing.assert_allclose(axes @ found, [float(x) for x in theirs[1:4]], atol=1e-6 * size)


def test_equations_of_sets(tmp_path: Path) -> None:
    """A set stands for its nodes, one equation each, as in Abaqus."""
    of_sets = "*NSET, NSET=A\n40, 41\n*NSET, NSET=B\n46, 47\n*EQUATION\n2\nA, 1, 1., B, 1, -1.\n"
    one_by_one = "*EQUATION\n2\n40, 1, 1., 46, 1, -1.\n2\n41, 1, 1., 47, 1, -1.\n"
    found = [
        frequencies(tmp_path, deck(tmp_path / "bar.inp", "C3D8", model=model, held=HELD))[0]
        for model in (of_sets, one_by_one, "")
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    assert np.abs(found[2] / found[0] - 1).max() > 1e-3


def tied_deck(path: Path, elements: tuple[str, str], tie: str, counts: Any) -> Path:
    """Two boxes whose meshes do not match; the first is held at its start."""
    mesh = two_boxes((CALCULIX[elements[0]], CALCULIX[elements[1]]), counts)
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in enumerate(mesh.points.tolist(), 1)]
    number = 0
    for name, element, cells in zip(("ONE", "TWO"), elements, mesh.cells, strict=True):
        lines += [f"*ELEMENT, TYPE={element}, ELSET={name}"]
        for nodes in cells.data + 1:
            number += 1
            words = [str(number), *map(str, nodes)]
            lines += [
                ", ".join(words[k : k + 15]) + ("," if k + 15 < len(words) else "")
                for k in range(0, len(words), 15)
            ]
    for name in ("start", "seam", "face"):
        lines += [f"*NSET, NSET={name.upper()}"]
        lines += [f"{n + 1}" for n in np.sort(mesh.point_sets[name]).tolist()]
    lines += ["*SURFACE, NAME=SLAVE, TYPE=NODE", "SEAM", "*SURFACE, NAME=MASTER"]
    face = set(mesh.point_sets["face"].tolist())
    first = len(mesh.cells[0].data)
    # Of a hexahedron from box() the side of least x is S6.
    for k, nodes in enumerate(mesh.cells[1].data):
        if set(nodes[[0, 3, 4, 7]].tolist()) <= face:
            lines += [f"{first + k + 1}, S6"]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "210000000000., 0.3", "*DENSITY", "7850."]
    lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL=STEEL" for name in ("ONE", "TWO")]
    lines += [tie, "*BOUNDARY", "START, 1, 3", "*STEP", "*FREQUENCY", "8", "*END STEP"]
    path.write_text("\n".join(lines) + "\n")
    return path


TIE = "*TIE, NAME=SEAM\nSLAVE, MASTER"


@ccx
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("elements", "counts"),
    [
        (("C3D8", "C3D8"), ((4, 3, 3), (4, 2, 2))),
        (("C3D10", "C3D20"), ((4, 3, 3), (4, 2, 2))),
        (("C3D20R", "C3D8"), ((4, 2, 2), (4, 3, 3))),
    ],
)
def test_ties_are_those_of_ccx(
    elements: tuple[str, str], counts: Any, ranks: int, tmp_path: Path
) -> None:
    path = tied_deck(tmp_path / "tied.inp", elements, TIE, counts)
    ours, facts = frequencies(tmp_path, path, ranks=ranks)
    np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=2e-6)
    assert any(line.startswith("tie seam: ") for line in facts["summary"])


def test_points_of_mpc(tmp_path: Path) -> None:
    """TIE and PIN between two sheets: K and M of the equations written out."""
    sheets = (
        "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,2,0,.1\n6,3,0,.1\n7,3,1,.1\n8,2,1,.1\n"
        "*ELEMENT, TYPE=S4, ELSET=E\n1,1,2,3,4\n2,5,6,7,8\n"
        "*MATERIAL, NAME=M\n*ELASTIC\n1e9,.3\n*DENSITY\n1000.\n"
        "*SHELL SECTION, ELSET=E, MATERIAL=M\n.02\n{model}"
        "*BOUNDARY\n1,1,6\n4,1,6\n*STEP\n*FREQUENCY\n4\n*END STEP\n"
    )
    found = []
    for model in (
        "*MPC\nTIE, 5, 2\nPIN, 8, 3\n",
        "*EQUATION\n"
        + "".join(f"2\n5,{c},1.,2,{c},-1.\n" for c in range(1, 7))
        + "".join(f"2\n8,{c},1.,3,{c},-1.\n" for c in (1, 2, 3)),
    ):
        path = tmp_path / "sheets.inp"
        path.write_text(sheets.format(model=model))
        assemble_deck(path, tmp_path / "body.h5", [parse("node", "tip=NODES:6")])
        found.append(assembled(tmp_path / "matrices.h5", tmp_path / "body.h5"))
    for name in ("K", "M"):
        assert abs(found[0][name] - found[1][name]).max() < 1e-12 * abs(found[1][name]).max()


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("*EQUATION\n2\n40, 1, 1.\n", "expected 6 entries"),
        ("*EQUATION\n2\n40, 7, 1., 41, 1, 1.\n", "index out of range"),
        ("*EQUATION\n2\nNONE, 1, 1., 41, 1, 1.\n", "no node set NONE"),
        ("*EQUATION\n2\nSTART, 1, 1., END, 1, 1.\n*NSET, NSET=END\n1\n", "sets of"),
        ("*EQUATION, INPUT=more.inp\n", "INPUT is not supported"),
        (
            "*NSET, NSET=U, UNSORTED\n41, 40\n*EQUATION\n2\nU, 1, 1., END, 1, 1.\n",
            "order of node set U",
        ),
        ("*MPC\nPLANE, 1, 2, 3, 4\n", "only TIE and PIN"),
        ("*MPC\nBEAM, 40, 41\n", "say --format abaqus"),
        ("*MPC\nTIE, NONE, 41\n", "no node set NONE"),
        ("*MPC\nTIE, 40, END\n", "sets of 1, "),
        ("*TIE, CYCLIC SYMMETRY\nA, B\n", "CYCLIC SYMMETRY is not supported"),
        ("*TIE, NAME=T\nA, B\n", "two surfaces"),
        ("*TRANSFORM, NSET=END, TYPE=S\n1,0,0,0,1,0\n", "TYPE=R or C"),
        ("*TRANSFORM, NSET=START, TYPE=R\n1,0,0\n", "expected six numbers"),
        ("*TRANSFORM, NSET=START, TYPE=R\n1,0,0,2,0,0\n", "have no direction"),
    ],
)
def test_what_is_refused(model: str, words: str, tmp_path: Path) -> None:
    path = deck(tmp_path / "bar.inp", "C3D8", model=model, held=HELD)
    with pytest.raises(BodyError, match=words):
        assemble_deck(path, tmp_path / "bar.h5", [parse("node", "tip=NODES:20")])


def test_equations_of_a_step(tmp_path: Path) -> None:
    path = deck(tmp_path / "bar.inp", "C3D8", held=HELD + "*EQUATION\n2\n40,1,1.,41,1,-1.\n")
    with pytest.raises(BodyError, match=r"\*EQUATION in a step is not supported"):
        assemble_deck(path, tmp_path / "bar.h5", [parse("node", "tip=NODES:20")])


@ccx
def test_two_ties_of_one_name(tmp_path: Path) -> None:
    """Both hold, as in ccx: halves of the seam."""
    counts = ((4, 3, 3), (4, 2, 2))
    path = tied_deck(tmp_path / "tied.inp", ("C3D8", "C3D8"), TIE, counts)
    text = path.read_text()
    at = text.index("*NSET, NSET=SEAM\n") + len("*NSET, NSET=SEAM\n")
    seam = text[at : text.index("*", at)].split()
    halves = "".join(
        f"*NSET, NSET=H{k}\n"
        + "".join(f"{n}\n" for n in some)
        + f"*SURFACE, NAME=S{k}, TYPE=NODE\nH{k}\n"
        for k, some in enumerate((seam[:8], seam[8:]))
    )
    both = halves + "*TIE, NAME=SEAM\nS0, MASTER\n*TIE, NAME=SEAM\nS1, MASTER"
    path.write_text(text.replace(TIE, both))
    ours, _ = frequencies(tmp_path, path)
    np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=2e-6)


@ccx
def test_a_node_all_but_on_an_axis(tmp_path: Path) -> None:
    """Cylindrical axes whose first component is 1e-9 along x: the direction that is held is y."""
    model = (
        "*NSET, NSET=ONE\n50\n*TRANSFORM, NSET=ONE, TYPE=C\n{x!r}, -1., 0., {x!r}, -1., 1.\n"
        + HELD
        + "ONE, 1\n"
    )
    path = deck(tmp_path / "bar.inp", "C3D8", model="**\n")
    x = float(read_deck(path).points[49, 0])
    path = deck(tmp_path / "bar.inp", "C3D8", model=model.format(x=x + 1e-9))
    ours, _ = frequencies(tmp_path, path)
    np.testing.assert_allclose(ours, ccx_frequencies(path)[:8], rtol=1e-6)


def test_the_command_line(tmp_path: Path) -> None:
    """What ties there are is said."""
    path = tied_deck(tmp_path / "tied.inp", ("C3D8", "C3D8"), TIE, ((3, 3, 3), (3, 2, 2)))
    said = run(
        *("import", path, "--assemble", "--node", "tip=NODES:20", "-o", tmp_path / "body.h5")
    ).out
    assert "tie seam: 16 nodes follow faces" in said
