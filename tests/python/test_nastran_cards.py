"""What of Nastran bulk data is read and what is refused: parameters, supports, rigid elements,
included files, and the command line."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse.linalg as spl
from test_nastran_bulk import plate

from conftest import assembled, run
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk


@pytest.mark.filterwarnings("ignore:.*are the units right")
@pytest.mark.parametrize("words", ["PARAM,WTMASS,2.5-3", "param wtmass 0.25D-2 $ lb", "PARAM"])
def test_parameters_of_case_control(words: str, tmp_path: Path) -> None:
    """They go before those of bulk data."""
    text = plate("PARAM,WTMASS,0.5\nPARAM,COUPMASS,1\n")
    if "w" in words.lower():
        text = text.replace("BEGIN BULK", f"{words}\nBEGIN BULK")
    (tmp_path / "p.bdf").write_text(text)
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert not any("lumped" in remark for remark in facts["remarks"])
    with h5py.File(tmp_path / "p.h5") as file:
        factor = 2.5e-3 if "w" in words.lower() else 0.5
        assert file["materials/mat1"].attrs["rho"] == pytest.approx(7850 * factor, rel=1e-12)


def mpc(cards: str) -> str:
    return plate(cards).replace("BEGIN BULK", "MPC = 5\nBEGIN BULK")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (plate("CGAP,90,9,10,20\nCGAP,91,9,10,20\n"), r"CGAP \(2\): not"),
        (plate(prop="PSHELL,1,,0.01,1\n"), "property 1: its material is missing"),
        (plate(material="MAT1,1,-1.,,0.3,7850.\n"), "E must be positive"),
        (
            plate(
                "CBAR,93,2,50,90,0.,0.,1.\nPBAR,2,2,1.-4,1.-8,1.-8,1.-8\n"
                "MAT8,2,1.+11,1.+10,0.3,1.+10,,,1600.\n"
            ),
            "MAT8 2: beams and rods have a MAT1",
        ),
        (mpc("MPC,5,50,0,1.0,80,1,-1.\n"), "MPC 5: grid 50 has no component 0"),
        (plate("CELAS2,93,1.0,50,3,90\n"), "no component .C1 or C2. for grid 90"),
        ("BEGIN BULK\nPARAM,COUPMASS,1\nENDDATA\n", "no GRID"),
    ],
)
def test_what_is_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "p.bdf").write_text(text)
    with pytest.raises(BodyError, match=words):
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])


def test_a_missing_include(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is named, and nothing is left in the folder of the user."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.bdf").write_text(plate("INCLUDE 'elsewhere.blk'\n"))
    with pytest.raises(BodyError, match=r"elsewhere\.blk"):
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert [p.name for p in tmp_path.iterdir()] == ["p.bdf"]


@pytest.mark.parametrize("alone", [False, True])
def test_includes_are_beside_their_deck(
    alone: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a deck, and of bulk data behind BEGIN; from another folder, by a relative path."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "mass.blk").write_text("CONM2,91,50,,2.0\n")
    text = plate("INCLUDE 'parts/mass.blk'\n")
    (tmp_path / "p.bdf").write_text(text[text.index("BEGIN") :] if alone else text)
    monkeypatch.chdir(tmp_path / "parts")
    assemble_bulk(Path("../p.bdf"), tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    with h5py.File(tmp_path / "p.h5") as file:
        assert file["masses/conm91"].attrs["mass"] == 2.0


def test_the_command_line(tmp_path: Path) -> None:
    """Cards to be ignored, loads and supports of the case, a reduction of it."""
    more = "CGAP,90,9,50,60\nFORCE,7,90,,10.,0.,0.,1.\nSPC1,2,3,50\n"
    (tmp_path / "p.bdf").write_text(plate(more))
    arguments = ("import", tmp_path / "p.bdf", "--assemble", "--node", "tip=NODES:90")
    said = run(*arguments, "-o", tmp_path / "p.h5", expect=1).err
    assert "CGAP (1): not supported" in said
    said = run(*arguments, "--ignore", "CGAP", "-o", tmp_path / "p.h5").out
    assert "passed over: CGAP (1)" in said and "left out: FORCE (1)" in said
    assert "interface tip: node" in said and "0 of 6 rigid motions are free" in said
    a = assembled(tmp_path / "m.h5", tmp_path / "p.h5")
    assert len(a["node"]) == 36  # SPC 2 is not of the case
    lowest = spl.eigsh(a["K"].tocsc(), 1, a["M"].tocsc(), sigma=0, return_eigenvectors=False)[0]
    assert 0 < np.sqrt(lowest) / (2 * np.pi) < 20
    said = run(*arguments, "--step", "1", "-o", tmp_path / "p.h5", expect=1).err
    assert "--step is of CalculiX decks" in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (plate("RBE2,92,900,123456,80,90\nGRID,900,,2.,2.,0.\nRBE2,93,901,123,900\n",
               "GRID,901,,3.,2.,0.\n"), "rotations of grid 900, which moves"),
        (plate("RBE2,92,80,123456,90\nRBE2,93,90,123456,80\n"), "moves itself: a loop"),
        (plate("RBE2,92,80,123456,90\nRBE2,93,50,123456,80\nRBE2,94,70,123456,80\n"),
         "grid 80, which moves others, is moved twice"),
        (plate("RBAR,92,80,90,123,456\n"), "RBAR 92: its independent components"),
        (plate("GRID,900,,2.,2.,0.\nSPC1,1,123456,900\nGRID,901,,3.,2.,0.\n"
               "RBE2,92,900,123456,80,90\nRBE2,93,901,123456,900\n"), "900 is held by an SPC"),
        (plate("GRID,900,,2.,2.,0.\nSPC1,1,3,90\nRBE2,92,900,123456,80,90\n"),
         "90 is held by an SPC"),
        (plate("RBE3,92,,50,123456,1.0,123,80,90\n"), "RBE3 92: its grids tell nothing of z"),
        (plate("RBE3,92,,10,123456,1.0,123,80,90,50\n"), "its grid 10 is held"),
        (plate("DMIG,KX,0,6,1,0\nDMIG,KX,50,1,,50,1,1.+5\n"), r"DMIG \(\d\): not supported"),
        (plate("CELAS1,93,7,50,3\n"), "CELAS1 93: its property is missing"),
        (plate("CTUBE,93,7,50,90\nPTUBE,7,1,0.02,0.002,,0.03\n"), "PTUBE 7: it tapers"),
        (plate("CTUBE,93,7,50,90\nPTUBE,7,1,0.02,0.02\n"), "thinner than its radius"),
        (plate("CONROD,93,50,90,1,0.\n"), "its area must be positive"),
        (plate("CBUSH,93,7,50,90\nPBUSH,7,K,1.+5,2.+5\n"), "across its line its axes are not"),
        (plate("CQUAD4,93,1,10,20,50,40,7\nCORD2C,7,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n",
               material="MAT8,1,1.+11,1.+10,0.3,1.+10,,,1600.\n"), "MCID. are cylin"),
        (plate(prop="PCOMP,1,,,,,,,MEM\n,1,0.01,0.\n"), "LAM = MEM is not supported"),
        (plate().replace("BEGIN BULK", "PARAM,WTMASS,0.x\nBEGIN BULK"), "PARAM,WTMASS of case"),
        (plate().replace("BEGIN BULK", "SUBCASE 1\nPARAM,G,0.1\nSUBCASE 2\nPARAM,G,.2\nBEGIN BULK"),
         "PARAM,G of case control differs"),
    ],
)  # fmt: skip
def test_what_would_be_another_body_is_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "p.bdf").write_text(text)
    with pytest.raises(BodyError, match=words):
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])


def test_chains_of_rbe2(tmp_path: Path) -> None:
    """One moves the reference of another: all their grids are one body."""
    rigid = "GRID,900,,2.,2.,0.\nGRID,901,,3.,2.,0.\nGRID,902,,3.,3.,0.\nCONM2,94,902,,2.0\n"
    rigid += "RBE2,91,900,123456,80,90\nRBE2,92,902,123456,901\nRBE2,93,901,123456,50,900\n"
    (tmp_path / "p.bdf").write_text(plate(rigid))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [])
    assert list(facts["interfaces"]) == ["rbe2_92"]
    with h5py.File(tmp_path / "p.h5") as file:
        of = file["interfaces/rbe2_92"]
        assert sorted(of["nodes"][:]) == [4, 7, 8]
        np.testing.assert_array_equal(of.attrs["position"], [3.0, 3.0, 0.0])
        assert file["masses/conm94"].attrs["interface"] == "rbe2_92"
    (tmp_path / "p.bdf").write_text(plate(rigid.replace("CONM2,94,902", "CONM2,94,901")))
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [])
    with h5py.File(tmp_path / "p.h5") as file:  # of the body that the chain is
        assert file["mesh/alone/connectivity"][:].tolist() == [[10]]
        assert 10 in file["interfaces/rbe2_92/nodes"][:]
    bars = "".join(rigid.splitlines(True)[:4]) + "RBAR,91,902,50\nRBAR,92,80,902,,123456\n"
    (tmp_path / "p.bdf").write_text(plate(bars + "RBAR,93,80,90,123456,,,123456\n"))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [])
    with h5py.File(tmp_path / "p.h5") as file:
        assert sorted(file["interfaces/rbar_91/nodes"][:]) == [4, 7, 8]
    (tmp_path / "p.bdf").write_text(plate(rigid + "SPC1,1,123456,902\n"))
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:70")])
    with h5py.File(tmp_path / "p.h5") as file:
        held = np.concatenate([g["nodes"][:] for g in file["supports"].values()])
    assert sorted(held) == [0, 1, 2, 4, 7, 8]


def test_supports_and_shared_references(tmp_path: Path) -> None:
    """RBE2 with one reference are one; one that is held holds its grids; supports of the case."""
    rigid = "GRID,900,,2.,2.,0.\nRBE2,92,900,123456,80\nRBE2,93,900,123456,90\nCONM2,94,900,,2.0\n"
    (tmp_path / "p.bdf").write_text(plate(rigid))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [])
    assert facts["interfaces"]["rbe2_92"]["nodes"] == 2 and list(facts["interfaces"]) == ["rbe2_92"]
    with pytest.raises(BodyError, match="grid 900 is that of rbe2_92"):
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:900")])
    tip = [parse("node", "tip=NODES:50")]
    (tmp_path / "p.bdf").write_text(plate(rigid + "SPC1,1,123456,900\n"))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", tip)
    with h5py.File(tmp_path / "p.h5") as file:
        held = np.concatenate([g["nodes"][:] for g in file["supports"].values()])
        assert "masses" not in file or not len(file["masses"])
    assert sorted(held) == [0, 1, 2, 7, 8]
    own = plate("GRDSET,,,,,,,6\n").replace("GRID,50,", "GRID,50,,0.5,0.5,0.,,0\n$")
    assert own.count(",,0\n$") == 1
    own = own.replace("GRID,60,", "GRID,60,,1.,0.5,0.,,12\n$")
    (tmp_path / "p.bdf").write_text(own)
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", tip)
    with h5py.File(tmp_path / "p.h5") as file:
        held = {frozenset(map(int, g["nodes"][:])): g for g in file["supports"].values()}
        assert set(held) == {frozenset(x) for x in ({0, 1, 2}, {3, 6, 7, 8}, {5})}
    (tmp_path / "p.bdf").write_text(plate("SPC1,1,123,900\nGRID,900,,2.,2.,0.\n"))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", tip)
    assert "supports of 1 grids without elements are left out: 900" in " ".join(facts["remarks"])
    (tmp_path / "p.bdf").write_text(plate().replace("SPC = 1\n", "ECHO = NONE\n"))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", tip)
    assert "chooses no SPC: the body is free" in " ".join(facts["remarks"])
    assert "6 of 6 rigid motions" in facts["summary"][1]


def test_systems_by_grdset(tmp_path: Path) -> None:
    """CP and CD of grids that leave these blank; 0 is the basic system."""

    system = "CORD2R,7,,0.02,0.01,0.,0.02,0.01,1.\n,1.,0.1,0.\nSPC1,1,2,20\nSPC1,1,1,50\n"
    plain = re.sub(r"GRID,50,,([^\n]*)", r"GRID,50,0,\1,0", plate(system))
    own = re.sub(r"GRID,(\d+),,([^\n]*)", r"GRID,\1,7,\2,7", plain)
    found = []
    for text in (own, plain.replace("ENDDATA", "GRDSET,,7,,,,7\nENDDATA"), plain):
        (tmp_path / "p.bdf").write_text(text)
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
        found.append(assembled(tmp_path / "m.h5", tmp_path / "p.h5")["K"].toarray())
    assert np.array_equal(found[0], found[1])
    assert found[2].shape != found[0].shape or not np.allclose(found[2], found[0])


def test_what_beams_leave_to_baror_and_beamor(tmp_path: Path) -> None:
    """Property and orientation, where a card leaves them blank."""
    rest = (
        "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,2.,0.,0.\nGRID,4,,3.,0.,0.\n"
        "PBAR,4,1,1.-4,1.-8,3.-8,1.-8\nPBAR,5,1,2.-4,2.-8,5.-8,1.-8\n"
        "PBEAM,7,1,3.-4,1.-8,2.-8,,1.-8\nMAT1,1,2.1+11,,.3,7800.\nSPC1,1,123456,1\nENDDATA\n"
    )
    found = []
    for beams in (
        "CBAR,1,4,1,2,0.,1.,0.\nCBAR,2,5,2,3,0.,0.,1.\nCBEAM,3,7,3,4,0.,0.,1.\n",
        "CBAR,1,,1,2\nBAROR,,4,,,0.,1.,0.\nCBAR,2,5,2,3,0.,0.,1.\n"
        "CBEAM,3,,3,4\nBEAMOR,,7,,,0.,0.,1.\n",
    ):
        path = tmp_path / "b.bdf"
        path.write_text("SOL 103\nCEND\nSPC = 1\nBEGIN BULK\n" + beams + rest)
        assemble_bulk(path, tmp_path / "b.h5", [parse("node", "tip=NODES:4")])
        found.append(assembled(tmp_path / "m.h5", tmp_path / "b.h5")["K"].toarray())
    assert np.array_equal(found[0], found[1])


def test_an_average_in_some_components_carries_a_mass(tmp_path: Path) -> None:
    """The rotations of the grid of a RBE3, which nothing touches, are held; it is no interface."""
    rbe3 = "GRID,900,,0.9,0.5,0.2\nCONM2,990,900,,5.\nRBE3,901,,900,123,1.,123,50,60\n,90\n"
    (tmp_path / "p.bdf").write_text(plate(rbe3))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert "rbe3_901 moves its grid 900 in 123 only" in " ".join(facts["remarks"])
    assert "rbe3_901" not in facts["interfaces"]
    a = assembled(tmp_path / "m.h5", tmp_path / "p.h5")
    size = abs(a["K"]).max(axis=1).toarray().ravel() + abs(a["M"]).max(axis=1).toarray().ravel()
    assert np.all(size > 0)
    assert a["M"].sum() > 0


def test_elements_with_the_same_grids(tmp_path: Path) -> None:
    """All of them count, as in Nastran, and so do they in K and M; it is said."""
    found = []
    for more in ("", "CQUAD4,900,1,10,20,50,40\n"):
        (tmp_path / "p.bdf").write_text(plate(more))
        facts = assemble_bulk(
            tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")]
        )
        said = " ".join(facts["remarks"])
        assert ("1 element with the same grids as others (first" in said) == bool(more)
        found.append(assembled(tmp_path / "m.h5", tmp_path / "p.h5")["M"].sum())
    assert found[1] > 1.02 * found[0]
