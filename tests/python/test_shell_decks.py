"""Shells of CalculiX decks, assembled here and by ccx, which makes solids of them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg as spl
from test_importers import ccx_frequencies

from conftest import assembled, run
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck
from sheets import flat, sheet

pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
STEPS = """*STEP
*FREQUENCY
6
*END STEP
*STEP
*STATIC
*DLOAD
{load}
*NODE PRINT,NSET=probe
U
*END STEP
"""


def roof(u: Any, v: Any) -> Any:
    angle = 1.4 * (u - 0.5)
    return 2.5 * np.sin(angle), 5 * v, 2.5 * np.cos(angle)


def write(
    path: Path,
    shape: Any,
    count: int,
    element: str = "S4",
    section: str = "",
    load: str = "E,P,1000.",
    clamp: str = "1,6",
) -> int:
    """A deck of a sheet that is clamped at its start; returns the node whose motion is printed."""
    kind = "triangle" if element.startswith("S3") else "quad"
    mesh = sheet(kind, (count, count), shape)
    probe = int(mesh.point_sets["end"][count // 3]) + 1
    lines = ["*NODE,NSET=ALL"]
    lines += [f"{n},{x:.10g},{y:.10g},{z:.10g}" for n, (x, y, z) in enumerate(mesh.points, 1)]
    lines += [f"*ELEMENT,TYPE={element},ELSET=E"]
    lines += [
        f"{e}," + ",".join(map(str, nodes + 1)) for e, nodes in enumerate(mesh.cells[0].data, 1)
    ]
    lines += ["*NSET,NSET=START", *(f"{n + 1}," for n in mesh.point_sets["start"])]
    lines += ["*NSET,NSET=PROBE", f"{probe},", "*MATERIAL,NAME=STEEL", "*ELASTIC"]
    lines += ["200000000000.,0.3", "*DENSITY", "8000."]
    lines += [f"*SHELL SECTION,ELSET=E,MATERIAL=STEEL{section}", "0.02", "*BOUNDARY"]
    lines += [f"START,{clamp}", STEPS.format(load=load)]
    path.write_text("\n".join(lines))
    return probe


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("shape", "section", "load", "near"),
    [
        (flat(1, 0.6), "", "E,P,1000.", 0.008),
        (flat(1, 0.6), ",OFFSET=0.5", "E,P,-1000.", 0.008),
        (roof, "", "E,GRAV,9.81,0.,-0.6,-0.8", 0.02),
        (roof, ",OFFSET=-0.5", "E,P,1000.", 0.02),
    ],
    ids=["flat", "flat beside its nodes", "curved", "curved beside its nodes"],
)
def test_frequencies_and_statics_near_those_of_ccx(
    shape: Any, section: str, load: str, near: float, ranks: int, tmp_path: Path
) -> None:
    probe = write(tmp_path / "sheet.inp", shape, 24, "S4", section, load)
    subprocess.run(["ccx", "sheet"], cwd=tmp_path, check=True, capture_output=True)
    facts = assemble_deck(
        tmp_path / "sheet.inp",
        tmp_path / "sheet.h5",
        [parse("node", f"tip=NODES:{probe}")],
        deck_loads=True,
    )
    assert list(facts["loads"]) == ["step2_dload"]
    a = assembled(tmp_path / "matrices.h5", tmp_path / "sheet.h5", ranks)
    K, M = a["K"].tocsc(), a["M"].tocsc()
    squares = spl.eigsh(K, 6, M, sigma=0, return_eigenvectors=False)
    hertz = np.sqrt(np.sort(squares)) / (2 * np.pi)
    np.testing.assert_allclose(hertz, ccx_frequencies(tmp_path / "sheet.dat")[:6], rtol=near)
    u = spl.spsolve(K, a["B"].T[a["names"].index("step2_dload.load")])
    at = a["node"] == probe - 1
    printed = [line for line in (tmp_path / "sheet.dat").read_text().split("\n") if line.split()]
    theirs = [float(word) for word in printed[-1].split()[1:]]  # in its middle surface
    assert u[at & (a["component"] == 2)][0] == pytest.approx(theirs[2], rel=near)


def test_elements_of_the_same_kind(tmp_path: Path) -> None:
    """S4R and S3 are ours: those of ccx bend by hourglasses, or hardly. Words of the import."""
    write(tmp_path / "four.inp", flat(1, 0.6), 16)
    found = {}
    for element, clamp in (("S4", "1,6"), ("S4R", "ENCASTRE"), ("S3", "1,6")):
        write(tmp_path / "sheet.inp", flat(1, 0.6), 16, element, clamp=clamp)
        said = run(
            *("import", tmp_path / "sheet.inp", "--assemble", "--node", "tip=NODES:40"),
            *("-o", tmp_path / "sheet.h5"),
        ).out
        assert ("integrated fully" in said) == (element == "S4R")
        assert ("too stiff in their plane" in said) == (element == "S3")
        a = assembled(tmp_path / "matrices.h5", tmp_path / "sheet.h5")
        found[element] = a["K"].tocsc(), a["M"].tocsc()
    assert abs(found["S4"][0] - found["S4R"][0]).max() == 0
    three, four = (
        np.sort(spl.eigsh(K, 4, M, sigma=0, return_eigenvectors=False))
        for K, M in (found["S3"], found["S4"])
    )
    np.testing.assert_allclose(three, four, rtol=0.02)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (",ORIENTATION=O1", "there is no orientation O1"),
        (",COMPOSITE", "it names no material; there are STEEL"),
        (",STACK DIRECTION=1", "STACK DIRECTION is not supported by --assemble"),
        (",OFFSET=half", "an OFFSET in thicknesses"),
    ],
)
def test_sections_that_are_not_followed(section: str, words: str, tmp_path: Path) -> None:
    write(tmp_path / "sheet.inp", flat(1, 0.6), 2, section=section)
    with pytest.raises(BodyError, match=words):
        assemble_deck(tmp_path / "sheet.inp", tmp_path / "s.h5", [parse("node", "tip=NODES:5")])


def test_moments_of_a_deck(tmp_path: Path) -> None:
    """*CLOAD in directions 4 to 6, and pressure on a named side."""
    probe = write(tmp_path / "sheet.inp", flat(1, 0.6), 4)
    text = (tmp_path / "sheet.inp").read_text()
    surface = "*SURFACE,NAME=UNDER\nE,SNEG\n*MATERIAL"
    text = text.replace("*MATERIAL", surface, 1).replace(
        "*DLOAD\nE,P,1000.", "*DSLOAD\nUNDER,P,10."
    )
    text = text.replace("*NODE PRINT", f"*CLOAD\n{probe},5,3.\n{probe},3,1.\n*NODE PRINT")
    (tmp_path / "sheet.inp").write_text(text)
    tip = [parse("node", f"tip=NODES:{probe}")]
    assemble_deck(tmp_path / "sheet.inp", tmp_path / "sheet.h5", tip, deck_loads=True)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "sheet.h5")
    B = a["B"].T
    at = a["node"] == probe - 1
    moment = B[a["names"].index("step2_cload.load")]
    assert moment[at & (a["component"] == 4)] == [3.0]
    assert moment[at & (a["component"] == 2)] == [1.0] and np.count_nonzero(moment) == 2
    up = B[a["names"].index("step2_dsload.load")][a["component"] == 2]
    assert up.min() > 0 and 4.0 < up.sum() < 10 * 0.6


def with_rigid_body(path: Path, given: str, nodes: list[int], held: str = "") -> None:
    """A clamped sheet with a rigid body of some of its nodes."""
    write(path, flat(1, 0.6), 20)
    rigid = "*NODE\n9901,1.1,0.3,0.1\n9902,1.1,0.3,0.1\n*NSET,NSET=SOME\n"
    rigid += "".join(f"{node},\n" for node in nodes)
    rigid += f"*RIGID BODY,{given}=SOME,REF NODE=9901,ROT NODE=9902\n"
    path.write_text(path.read_text().replace("*BOUNDARY", f"{rigid}*BOUNDARY\n{held}", 1))


def end_of_sheet(count: int = 20) -> list[int]:
    return (sheet("quad", (count, count), flat(1, 0.6)).point_sets["end"] + 1).tolist()


def hertz_of(path: Path, folder: Path, ranks: int = 1) -> Any:
    assemble_deck(path, folder / "b.h5", [parse("node", "tip=NODES:40")])
    a = assembled(folder / "a.h5", folder / "b.h5", ranks)
    squares = spl.eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)
    return np.sqrt(np.sort(squares)) / (2 * np.pi)


@pytest.mark.parametrize("ranks", [1, 2])
def test_rotations_of_shells_in_a_rigid_body_are_those_of_ccx(ranks: int, tmp_path: Path) -> None:
    """Free: an end that is held by its rigid body is hinged, as in ccx; TIE NSET clamps it."""
    held = "9901,1,3\n9902,1,3\n"
    with_rigid_body(tmp_path / "sheet.inp", "NSET", end_of_sheet(), held)
    subprocess.run(["ccx", "sheet"], cwd=tmp_path, check=True, capture_output=True)
    theirs = ccx_frequencies(tmp_path / "sheet.dat")[:6]
    hinged = hertz_of(tmp_path / "sheet.inp", tmp_path, ranks)
    np.testing.assert_allclose(hinged[:5], theirs[:5], rtol=0.01)
    for given in ("PIN NSET", "TIE NSET"):
        with_rigid_body(tmp_path / "tied.inp", given, end_of_sheet(), held)
        found = hertz_of(tmp_path / "tied.inp", tmp_path, ranks)
        away = np.abs(found / hinged - 1)
        assert away.max() < 1e-9 if given == "PIN NSET" else away.max() > 0.1


def test_a_rigid_body_of_shells_is_an_interface(tmp_path: Path) -> None:
    """Of its displacements alone, with six ports, and the body is as free as it was."""
    path = tmp_path / "sheet.inp"
    ring = [*end_of_sheet(), *(n - 2 for n in end_of_sheet())]
    with_rigid_body(path, "NSET", ring)
    text = path.read_text()
    path.write_text(text[: text.index("*BOUNDARY")] + "*STEP\n*FREQUENCY\n6\n*END STEP\n")
    facts = assemble_deck(path, tmp_path / "b.h5", [])
    assert list(facts["interfaces"]) == ["some"]
    assert "6 of 6 rigid motions are free" in facts["summary"]
    assert any("rotations of shells and beams do not follow" in r for r in facts["remarks"])
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
    assert len(a["names"]) == 6
    path.write_text(path.read_text().replace("*RIGID BODY,NSET", "*RIGID BODY,TIE NSET"))
    facts = assemble_deck(path, tmp_path / "b.h5", [])
    assert facts["interfaces"]["some"]["coupling"] == "rigid"


def test_a_rigid_body_of_a_line_of_shells_is_a_hinge(tmp_path: Path) -> None:
    """The import says which rotation nothing holds, unless a node of an element has it."""
    path = tmp_path / "sheet.inp"
    with_rigid_body(path, "NSET", end_of_sheet())
    text = path.read_text()
    path.write_text(text[: text.index("*BOUNDARY")] + "*STEP\n*FREQUENCY\n6\n*END STEP\n")
    hinge = parse("node", "hinge=NODES:20")
    remarks = assemble_deck(path, tmp_path / "b.h5", [hinge])["remarks"]
    assert any("nodes on a line: its reference, node 9901, turns freely" in r for r in remarks)
    path.write_text(path.read_text().replace("*RIGID BODY,NSET", "*RIGID BODY,TIE NSET"))
    assert not any("on a line" in r for r in assemble_deck(path, tmp_path / "b.h5", [])["remarks"])


def test_membranes_of_a_deck(tmp_path: Path) -> None:
    """M3D4 with *MEMBRANE SECTION: three dofs a node, and the stiffness of a sheet in its plane."""
    write(tmp_path / "sheet.inp", flat(1, 0.6), 4)
    text = (tmp_path / "sheet.inp").read_text().replace("TYPE=S4", "TYPE=M3D4R")
    (tmp_path / "sheet.inp").write_text(text.replace("*SHELL SECTION", "*MEMBRANE SECTION"))
    assemble_deck(tmp_path / "sheet.inp", tmp_path / "b.h5", [parse("node", "tip=NODES:20")])
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
    assert set(a["component"]) == {0, 1, 2}
    across = a["component"] == 2
    assert abs(a["K"][across][:, across]).max() < 1e-6 * abs(a["K"]).max()
    stretched = np.where(a["component"] == 0, a["position"][:, 0], 0.0)
    energy = stretched @ a["K"] @ stretched
    assert energy == pytest.approx(2e11 * 0.02 * 0.6 / (1 - 0.3**2), rel=1e-9)


def test_elements_of_abaqus_that_are_taken_as_others(tmp_path: Path) -> None:
    write(tmp_path / "sheet.inp", flat(1, 0.6), 4)
    plain = (tmp_path / "sheet.inp").read_text()
    found = {}
    for kind in ("S4", "S4R5", "CPS4"):
        (tmp_path / "sheet.inp").write_text(plain.replace("TYPE=S4", f"TYPE={kind}"))
        tip = [parse("node", "tip=NODES:20")]
        if kind == "CPS4":
            with pytest.raises(BodyError, match="elements CPS4 are elements of a plane"):
                assemble_deck(tmp_path / "sheet.inp", tmp_path / "b.h5", tip)
            continue
        facts = assemble_deck(tmp_path / "sheet.inp", tmp_path / "b.h5", tip)
        assert ("S4R5 are taken as S4" in facts["remarks"]) == (kind == "S4R5")
        found[kind] = assembled(tmp_path / "a.h5", tmp_path / "b.h5")["K"]
    assert abs(found["S4"] - found["S4R5"]).max() == 0
    (tmp_path / "sheet.inp").write_text(plain.replace("MATERIAL=STEEL", "MATERIAL=STEAL"))
    with pytest.raises(BodyError, match="there is no material STEAL; there are STEEL"):
        assemble_deck(tmp_path / "sheet.inp", tmp_path / "b.h5", tip)
