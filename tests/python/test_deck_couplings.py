"""Couplings of decks, and masses that these and equations join to the body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from test_assemble_deck import TIP, deck

from conftest import assembled
from flexgram import BodyError
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
