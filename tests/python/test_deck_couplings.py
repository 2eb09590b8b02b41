"""Couplings of decks, and masses that these and equations join to the body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from test_assemble_deck import TIP, deck

from conftest import assembled
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck


@pytest.mark.parametrize(
    ("rows", "kind"), [("*KINEMATIC\n1, 6\n", "rigid"), ("*DISTRIBUTING\n", "distributing")]
)
def test_couplings(rows: str, kind: str, tmp_path: Path) -> None:
    """Of faces of elements; loads at the reference node act as the interface does."""
    text = (
        "*NODE\n9901, 0.25, 0.03, 0.01\n*SURFACE, NAME=SKIN, TYPE=NODE\nEND,\n"
        f"*COUPLING, REF NODE=9901, SURFACE=SKIN, CONSTRAINT NAME=EYE\n{rows}"
    )
    path = deck(tmp_path / "bar.inp", "C3D10", model=text)
    content = path.read_text().replace("*END STEP", "*CLOAD\n9901, 2, 10.\n*END STEP")
    path.write_text(content)
    facts = assemble_deck(path, tmp_path / "bar.h5", [], deck_loads=True)
    assert facts["interfaces"]["eye"]["coupling"] == kind
    assert facts["interfaces"]["eye"]["position"] == [0.25, 0.03, 0.01]
    assert list(facts["loads"]) == ["step1_cload"]
    a = assembled(tmp_path / "a.h5", tmp_path / "bar.h5")
    B = {str(name): a["B"][:, k] for k, name in enumerate(a["names"])}
    np.testing.assert_allclose(B["step1_cload.load"], 10 * B["eye.fy"], atol=1e-9)


def test_a_coupling_of_one_direction(tmp_path: Path) -> None:
    """Its nodes are held in that direction, if its reference is; else they move together, but for
    what levers add."""
    skin = (
        "*NODE\n9901, 0.25, 0.03, 0.01\n*SURFACE, NAME=SKIN, TYPE=NODE\nEND,\n"
        "*COUPLING, REF NODE=9901, SURFACE=SKIN, CONSTRAINT NAME=EYE\n*KINEMATIC\n1, 1\n"
    )
    found = []
    for model, held in (
        (skin, "*BOUNDARY\nSTART, 1, 3\n9901, 1, 6\n"),
        ("", "*BOUNDARY\nSTART, 1, 3\nEND, 1, 1\n"),
        (skin, "*BOUNDARY\nSTART, 1, 3\n"),
        ("", "*BOUNDARY\nSTART, 1, 3\n"),
    ):
        path = deck(tmp_path / "bar.inp", "C3D10", model=model, held=held)
        facts = assemble_deck(path, tmp_path / "bar.h5", TIP)
        a = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5")
        found.append(np.sort(eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)))
        if held.endswith("3\n") and model:
            assert any("eye is no interface" in remark for remark in facts["remarks"])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
    assert np.all(found[2] > found[3] * (1 - 1e-9)) and np.any(found[2] > 1.0001 * found[3])


def test_a_mass_on_a_distributing_coupling(tmp_path: Path) -> None:
    """It moves as the mean of the nodes, by which the interface without it shares forces out."""
    skin = (
        "*NODE\n9901, 0.25, 0.03, 0.01\n*SURFACE, NAME=SKIN, TYPE=NODE\nEND,\n"
        "*COUPLING, REF NODE=9901, SURFACE=SKIN, CONSTRAINT NAME=EYE\n*DISTRIBUTING\n"
    )
    mass = "*ELEMENT, TYPE=MASS, ELSET=WEIGHT\n9903, 9901\n*MASS, ELSET=WEIGHT\n0.4\n"
    found = []
    for model in (skin, skin + mass):
        path = deck(tmp_path / "bar.inp", "C3D10", model=model, held="*BOUNDARY\nSTART, 1, 3\n")
        facts = assemble_deck(path, tmp_path / "bar.h5", [])
        assert facts["interfaces"]["eye"]["position"] == pytest.approx([0.25, 0.03, 0.01])
        found.append(assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5"))
    plain, heavy = found
    assert list(plain["names"]) == list(heavy["names"])
    B = np.asarray(plain["B"])
    np.testing.assert_allclose(heavy["B"], B, atol=1e-12)
    extra = (heavy["M"] - plain["M"]).toarray()
    np.testing.assert_allclose(extra, 0.4 * B[:, :3] @ B[:, :3].T, atol=1e-12)
    line = skin.replace("END,\n", "2,\n3,\n")
    path = deck(tmp_path / "bar.inp", "C3D10", model=line + mass)
    with pytest.raises(BodyError, match=r"eye.: its nodes lie on a line"):
        assemble_deck(path, tmp_path / "bar.h5", [])


@pytest.mark.parametrize(
    "tie",
    [
        "*MPC\nTIE, 9901, 30\n",
        "*MPC\nPIN, 9901, 30\n",
        "".join(f"*EQUATION\n2\n9901, {c}, 1., 30, {c}, -1.\n" for c in (1, 2, 3)),
    ],
)
def test_a_mass_that_an_equation_joins(tmp_path: Path, tie: str) -> None:
    """Its node is of no element: as if it lay at the node that it follows."""
    found = []
    for node, further in ((9901, f"*NODE\n9901, 0.1, 0.1, 0.1\n{tie}"), (30, "")):
        mass = f"*ELEMENT, TYPE=MASS, ELSET=WEIGHT\n9903, {node}\n*MASS, ELSET=WEIGHT\n0.4\n"
        held = "*BOUNDARY\nSTART, 1, 3\n"
        path = deck(tmp_path / "bar.inp", "C3D10", model=further + mass, held=held)
        assemble_deck(path, tmp_path / "bar.h5", TIP)
        body = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5")
        found.append(np.sort(eigsh(body["K"], 6, body["M"], sigma=0, return_eigenvectors=False)))
    np.testing.assert_allclose(*found, rtol=1e-9)


SHEET = (
    "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,2,0,.1\n6,2,1,0\n9,2.1,1.2,.3\n"
    "*ELEMENT, TYPE=S4, ELSET=E\n1,1,2,3,4\n2,2,5,6,3\n"
    "*MATERIAL, NAME=M\n*ELASTIC\n1e9,.3\n*DENSITY\n1000.\n"
    "*SHELL SECTION, ELSET=E, MATERIAL=M\n.02\n{model}"
    "*BOUNDARY\n1,1,6\n4,1,6\n*STEP\n*FREQUENCY\n4\n*END STEP\n"
)
HANGING = (
    "*ELEMENT, TYPE=MASS, ELSET=LUMP\n71, 9\n*MASS, ELSET=LUMP\n7.\n"
    "*ELEMENT, TYPE=ROTARYI, ELSET=TURN\n72, 9\n*ROTARY INERTIA, ELSET=TURN\n"
    ".5, .6, .7, -.01, .02, .03\n"
)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_component_hangs_on_a_beam_of_mpc(ranks: int, tmp_path: Path) -> None:
    """Its mass and rotary inertia are those of a rigid body at the node that it follows."""
    found = {}
    for name, model in (("plain", ""), ("hung", HANGING + "*MPC\nBEAM, 9, 6\n")):
        path = tmp_path / f"{name}.inp"
        path.write_text(SHEET.format(model=model))
        facts = assemble_deck(path, tmp_path / "b.h5", [parse("node", "tip=NODES:6")], abaqus=True)
        found[name] = assembled(tmp_path / "a.h5", tmp_path / "b.h5", ranks)
    assert "1 point mass and 1 rotary inertia" in " ".join(facts["remarks"])
    arm = np.array([0.1, 0.2, 0.3])
    cross = np.array([np.cross(e, arm) for e in np.eye(3)]).T  # θ ↦ θ × arm
    tensor = np.array([[0.5, -0.01, 0.02], [-0.01, 0.6, 0.03], [0.02, 0.03, 0.7]])
    own = np.block([[7 * np.eye(3), 7 * cross], [7 * cross.T, tensor + 7 * cross.T @ cross]])
    plain, hung = found["plain"], found["hung"]
    at_tip = plain["B"]  # of the six components of node 6
    wanted = plain["M"] + at_tip @ own @ at_tip.T
    assert abs(hung["M"] - wanted).max() < 1e-12 * abs(wanted).max()
    assert abs(hung["K"] - plain["K"]).max() < 1e-12 * abs(plain["K"]).max()


def test_beams_of_mpc_are_a_rigid_body(tmp_path: Path) -> None:
    """Nodes of solids follow a node that no element has."""
    ends = "*NODE, NSET=REF\n9901, 0.25, 0.03, 0.01\n"
    mass = "*ELEMENT, TYPE=MASS, ELSET=LUMP\n9901, 9901\n*MASS, ELSET=LUMP\n.3\n"
    turn = (
        "*ELEMENT, TYPE=ROTARYI, ELSET=TURN\n9902, 9901\n"
        "*ROTARY INERTIA, ELSET=TURN\n1e-3, 2e-3, 3e-3\n"
    )
    found = []
    for join in ("*RIGID BODY, NSET=END, REF NODE=9901\n", "*MPC\nBEAM, END, REF\n"):
        path = deck(
            tmp_path / "bar.inp",
            "C3D10",
            model=ends + mass + turn + join,
            held="*BOUNDARY\nSTART, 1, 3\n",
        )
        assemble_deck(path, tmp_path / "bar.h5", TIP, abaqus=True)
        a = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5")
        found.append(np.sort(eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
    with pytest.raises(BodyError, match="has no rotations to follow"):
        path = deck(tmp_path / "bar.inp", "C3D10", model="*MPC\nBEAM, END, 1\n")
        assemble_deck(path, tmp_path / "bar.h5", TIP, abaqus=True)


def test_instances_tell_that_a_deck_is_of_abaqus(tmp_path: Path) -> None:
    """BEAM of *MPC is rigid there, also between an instance and a point of the assembly."""
    sheet = SHEET.replace("9,2.1,1.2,.3\n", "")
    nodes, _, rest = sheet.partition("*MATERIAL")
    material, _, held = rest.partition("*SHELL SECTION, ELSET=E, MATERIAL=M\n.02\n{model}")
    held = held.replace("1,1,6", "Sheet-1.1,1,6").replace("4,1,6", "Sheet-1.4,1,6")
    path = tmp_path / "instance.inp"
    path.write_text(
        f"*PART, NAME=Sheet\n{nodes}*SHELL SECTION, ELSET=E, MATERIAL=M\n.02\n*END PART\n"
        "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=Sheet-1, PART=Sheet\n*END INSTANCE\n"
        f"*NODE, NSET=REF\n9,2.1,1.2,.3\n{HANGING}*MPC\nBEAM, REF, Sheet-1.6\n*END ASSEMBLY\n"
        f"*MATERIAL{material}{held}"
    )
    found = []
    assemble_deck(path, tmp_path / "i.h5", [parse("node", "tip=NODES:6")])
    found.append(assembled(tmp_path / "a.h5", tmp_path / "i.h5"))
    path = tmp_path / "flat.inp"
    path.write_text(SHEET.format(model=HANGING + "*MPC\nBEAM, 9, 6\n"))
    assemble_deck(path, tmp_path / "f.h5", [parse("node", "tip=NODES:6")], abaqus=True)
    found.append(assembled(tmp_path / "b.h5", tmp_path / "f.h5"))
    for name in ("K", "M"):
        assert abs(found[0][name] - found[1][name]).max() < 1e-12 * abs(found[1][name]).max()
