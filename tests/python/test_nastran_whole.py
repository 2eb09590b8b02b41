"""What of Nastran bulk data decks of whole structures hold: beams beside their grids and with pins,
bushes, grids that no element has, sandwich plates, files of executive control."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg as sl
from scipy.sparse.linalg import eigsh
from test_nastran_cards import mpc, plate

from conftest import assembled
from flexgram.basics import BodyError
from flexgram.importers import parse
from flexgram.importers.alone import hold_untouched
from flexgram.importers.nastran_bulk import assemble_bulk

E_, NU, RHO = 2.1e11, 0.3, 7850.0
BEGIN = "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nPARAM,COUPMASS,1\n"
PROPERTY = "PBAR,1,1,6.-4,4.5-8,2.-8,5.-8\nMAT1,1,2.1+11,,0.3,7850.\n"


def bars(cards: str, count: int = 4, length: float = 1.0, held: str = "SPC1,1,123456,1\n") -> str:
    """Bulk data of bars along x, whose grids are numbered from 1; ``cards`` takes the number of an
    element, of which the first grid is one."""
    grids = "".join(f"GRID,{k + 1},,{k * length / count},0.,0.\n" for k in range(count + 1))
    elements = "".join(cards.format(e=e, f=e + 1) for e in range(1, count + 1))
    return f"{BEGIN}{grids}{elements}{PROPERTY}{held}ENDDATA\n"


def body_of(folder: Path, text: str, ports: str = "tip=NODES:5", ranks: int = 1) -> dict[str, Any]:
    (folder / "b.bdf").write_text(text)
    facts = assemble_bulk(folder / "b.bdf", folder / "b.h5", [parse("node", ports)])
    return assembled(folder / "a.h5", folder / "b.h5", ranks) | {"facts": facts}


def lowest(a: dict[str, Any], count: int = 6) -> Any:
    return np.sort(eigsh(a["K"], count, a["M"], sigma=0, return_eigenvectors=False))


PLAIN = "CBAR,{e},1,{e},{f},0.,1.,0.\n"


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("cd", ["", "7"])
def test_beams_beside_their_grids(cd: str, ranks: int, tmp_path: Path) -> None:
    """A clamped beam, all of whose ends lie beside the grids, is the same beam; its grids turn with
    it, about axes of their own too."""
    plain = lowest(body_of(tmp_path, bars(PLAIN), ranks=ranks))
    offset = "CBAR,{e},1,{e},{f},0.,1.,0.\n,,,0.,0.1,-0.05,0.,0.1,-0.05\n"
    text = bars(offset)
    if cd:  # y and z of the grids are z and -y; so are the vector and the offsets
        turned = offset.replace("0.,1.,0.", "0.,0.,-1.").replace("0.,0.1,-0.05", "0.,-0.05,-0.1")
        text = bars(turned).replace(",0.,0.\n", ",0.,0.,7\n")
        text = text.replace("ENDDATA", "CORD2R,7,,0.,0.,0.,0.,-1.,0.\n,1.,0.,0.\nENDDATA")
    a = body_of(tmp_path, text, ranks=ranks)
    np.testing.assert_allclose(lowest(a), plain, rtol=1e-8)


def test_a_force_beside_a_beam(tmp_path: Path) -> None:
    """A force at a grid beside the beam bends and twists it: its compliance by hand."""
    arm = 0.2
    offset = f"CBAR,{{e}},1,{{e}},{{f}},0.,1.,0.\n,,,0.,{arm},0.,0.,{arm},0.\n"
    a = body_of(tmp_path, bars(offset))
    f = a["B"][:, a["names"].index("tip.fz")]
    found = f @ np.linalg.solve(a["K"].toarray(), f)
    G = E_ / (2 * (1 + NU))
    assert found == pytest.approx(1 / (3 * E_ * 2e-8) + arm**2 / (G * 5e-8), rel=1e-3)


@pytest.mark.parametrize("ranks", [1, 2])
def test_pins(ranks: int, tmp_path: Path) -> None:
    """A beam between two walls with a hinge in its middle: two cantilevers side by side."""
    hinge = PLAIN.replace("\n", "\n,{p}\n")
    cards = [hinge.format(e=e, f=e + 1, p=",56" if e == 2 else "") for e in range(1, 5)]
    text = bars("").replace("PBAR", "".join(cards) + "PBAR", 1)
    text = text.replace("SPC1,1,123456,1\n", "SPC1,1,123456,1,5\n")
    a = body_of(tmp_path, text, "tip=NODES:3", ranks)
    for direction, inertia in (("y", 4.5e-8), ("z", 2e-8)):
        f = a["B"][:, a["names"].index(f"tip.f{direction}")]
        stiff = 1 / (f @ np.linalg.solve(a["K"].toarray(), f))
        assert stiff == pytest.approx(2 * 3 * E_ * inertia / 0.5**3, rel=1e-3)
    f = a["B"][:, a["names"].index("tip.mx")]
    twist = 1 / (f @ np.linalg.solve(a["K"].toarray(), f))
    assert twist == pytest.approx(2 * E_ / 2.6 * 5e-8 / 0.5, rel=1e-9)


def test_a_bush_with_its_vector(tmp_path: Path) -> None:
    """Between two grids that lie apart it acts midway, along the line and the vector."""
    bush = "GRID,9,,1.3,0.4,0.\nCBUSH,9,9,5,9,0.,0.,1.\nPBUSH,9,K,1.+5,2.+5,3.+5,40.,50.,60.\n"
    text = bars(PLAIN).replace("ENDDATA", bush + "SPC1,1,123456,9\nENDDATA")
    a, plain = body_of(tmp_path, text), body_of(tmp_path, bars(PLAIN))
    added = (a["K"] - plain["K"]).toarray()[-6:, -6:]
    x = np.array([0.3, 0.4, 0.0]) / 0.5
    y = np.array([0.0, 0.0, 1.0])
    z = np.cross(x, y)
    axes = np.kron(np.eye(2), np.array([x, y, z]))
    arm = np.array([0.15, 0.2, 0.0])
    H = np.eye(6)
    H[:3, 3:] = np.column_stack([np.cross(e, arm) for e in np.eye(3)])
    expected = H.T @ axes.T @ np.diag([1e5, 2e5, 3e5, 40.0, 50.0, 60.0]) @ axes @ H
    np.testing.assert_allclose(added, expected, atol=1e-6)


def test_a_mass_beside_its_grid(tmp_path: Path) -> None:
    """By its offset, in a system's axes, and by its place (CID = -1)."""
    found = []
    for card in (
        "CONM2,8,5,,2.0,0.1,0.2,0.3\n",
        "CONM2,8,5,7,2.0,0.1,0.3,-0.2\nCORD2R,7,,0.,0.,0.,0.,-1.,0.\n,1.,0.,0.\n",
        "CONM2,8,5,-1,2.0,1.1,0.2,0.3\n",
    ):
        text = bars(PLAIN).replace("ENDDATA", card + "ENDDATA")
        found.append(body_of(tmp_path, text)["M"])
        with h5py.File(tmp_path / "b.h5") as file:
            offset = file["masses/conm8"].attrs["offset"]
            np.testing.assert_allclose(offset, [0.1, 0.2, 0.3], atol=1e-12)
    assert abs(found[0] - found[1]).max() < 1e-12 and abs(found[0] - found[2]).max() < 1e-12


def test_grids_that_no_element_has(tmp_path: Path) -> None:
    """An MPC through a grid alone, a RBE2 of one component, and a spring to another: what nothing
    touches is held."""
    cards = "GRID,900,,1.,0.5,0.\nMPC,5,50,3,1.0,900,3,-1.\n"
    cards += "CELAS2,93,1000.,900,3,901,3\nGRID,901,,1.,0.5,0.\nRBE2,94,901,3,80\n"
    (tmp_path / "p.bdf").write_text(mpc(cards))
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    with h5py.File(tmp_path / "p.h5") as file:
        alone = file["mesh/alone/connectivity"][:].ravel()
        assert alone.tolist() == [9, 10]
        held = {
            int(group["nodes"][0]): sorted(map(int, group.attrs["components"]))
            for name, group in file["supports"].items()
            if name.startswith("untouched")
        }
        assert held == {9: [0, 1, 3, 4, 5], 10: [0, 1, 3, 4, 5]}
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5")
    (tmp_path / "q.bdf").write_text(plate())
    assemble_bulk(tmp_path / "q.bdf", tmp_path / "q.h5", [parse("node", "tip=NODES:90")])
    b = assembled(tmp_path / "b.h5", tmp_path / "q.h5")
    # A spring of 1000 N/m between w of grids 50 and 80.
    at = [int(np.flatnonzero((b["node"] == n) & (b["component"] == 2))[0]) for n in (4, 7)]
    spring = np.zeros(b["K"].shape[0])
    spring[at] = [1.0, -1.0]
    expected = np.sort(
        eigsh(b["K"] + 1000 * np.outer(spring, spring), 4, b["M"], sigma=0,
              return_eigenvectors=False)
    )  # fmt: skip
    np.testing.assert_allclose(lowest(a, 4), expected, rtol=1e-9)


def test_a_sandwich(tmp_path: Path) -> None:
    """PSHELL with 12I/T**3, TS/T and a core; NSM is mass alone."""
    prop = "PSHELL,1,1,0.001,1,700.,2,22.,0.5\n"
    core = "MAT1,2,1.+9,,0.3\n"
    (tmp_path / "p.bdf").write_text(plate(core, prop=prop))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    with h5py.File(tmp_path / "p.h5") as file:
        (section,) = file["sections"].values()
        of = section.attrs
        assert (of["bending_factor"], of["shear_factor"]) == (700, 22)
        assert of["shear_material"] == "mat2_shear" and "bending_material" not in of
        core = file["materials/mat2_shear"].attrs
        assert core["E"] / (2 * (1 + core["nu"])) == pytest.approx(1e9 / 2.6, rel=1e-6)
    mass = next(line for line in facts["summary"] if line.startswith("mass"))
    assert f"{7850 * 0.001 + 0.5:.6g}" in mass, mass


def test_moduli_that_do_not_belong_together(tmp_path: Path) -> None:
    """Beams twist by G, plates and solids take E and NU, transverse shear G."""
    text = bars(PLAIN).replace("MAT1,1,2.1+11,,0.3", "MAT1,1,2.1+11,9.+10,0.3")
    a = body_of(tmp_path, text)
    f = a["B"][:, a["names"].index("tip.mx")]
    assert 1 / (f @ np.linalg.solve(a["K"].toarray(), f)) == pytest.approx(9e10 * 5e-8, rel=1e-9)
    (tmp_path / "p.bdf").write_text(plate(material="MAT1,1,2.1+11,4.+10,0.3,7850.\n"))
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    with h5py.File(tmp_path / "p.h5") as file:
        (section,) = file["sections"].values()
        shear = float(section.attrs["shear_factor"])
        assert shear == pytest.approx(5 / 6 * 4e10 * 2.6 / 2.1e11, rel=1e-5)
        assert file["materials/mat1"].attrs["nu"] == 0.3


def test_corners_with_thicknesses_of_their_own(tmp_path: Path) -> None:
    """Their mean; one that is blank is the property's."""
    text = plate().replace("CQUAD4,1,1,10,40,50,20\n", "CQUAD4,1,1,10,40,50,20\n,,,0.02,0.01\n")
    (tmp_path / "p.bdf").write_text(text)
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert any("take their mean" in remark for remark in facts["remarks"])
    with h5py.File(tmp_path / "p.h5") as file:
        thick = sorted(float(of.attrs["thickness"]) for of in file["sections"].values())
        np.testing.assert_allclose(thick, [0.01, 0.0125])


def test_shells_of_second_order(tmp_path: Path) -> None:
    """CQUAD8 and CTRIA6 become four each; without a middle grid they are refused."""
    text = plate()
    cells = [line for line in text.splitlines() if line.startswith("CQUAD4")]
    for cell in cells:
        text = text.replace(cell + "\n", "")
    whole = "CQUAD8,1,1,10,70,90,30,40,80\n,60,20\n"
    (tmp_path / "p.bdf").write_text(text.replace("PSHELL", whole + "PSHELL", 1))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert facts["elements"] == 4 and facts["points"] == 9
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5")
    (tmp_path / "q.bdf").write_text(plate())
    assemble_bulk(tmp_path / "q.bdf", tmp_path / "q.h5", [parse("node", "tip=NODES:90")])
    b = assembled(tmp_path / "b.h5", tmp_path / "q.h5")
    np.testing.assert_allclose(lowest(a, 4), lowest(b, 4), rtol=1e-9)


def test_files_of_executive_control_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "parts.blk").write_text("CONM2,91,50,,2.0\n")
    text = plate("INCLUDE 'parts.blk'\n")
    text = text.replace("CEND", "INCLUDE '/dmaps/alter.v9'\ninclude 'other.v9'\nCEND", 1)
    (tmp_path / "p.bdf").write_text(text)
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert any("/dmaps/alter.v9, other.v9" in remark for remark in facts["remarks"])
    with h5py.File(tmp_path / "p.h5") as file:
        assert file["masses/conm91"].attrs["mass"] == 2.0


def test_a_material_without_density(tmp_path: Path) -> None:
    (tmp_path / "p.bdf").write_text(plate("CONM2,91,90,,2.0\n", material="MAT1,1,2.1+11,,0.3\n"))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    assert any("weighs nothing" in remark for remark in facts["remarks"])
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5")
    assert a["M"].sum() == pytest.approx(6.0)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_mean_with_rotations(ranks: int, tmp_path: Path) -> None:
    """RBE3 of all components: what a force or moment at its grid does to the others is their
    least-squares mean, rotations by the square of the mean distance."""
    rbe3 = "GRID,900,,1.3,0.6,0.2\nRBE3,9,,900,123456,1.0,123456,50,60\n,80,2.0,123,90\n"
    (tmp_path / "p.bdf").write_text(plate(rbe3))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [])
    assert facts["interfaces"]["rbe3_9"]["coupling"] == "node"
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5", ranks)
    at = {4: [0.5, 0.5, 0.0], 5: [0.5, 1.0, 0.0], 7: [1.0, 0.5, 0.0], 8: [1.0, 1.0, 0.0]}
    arms = {n: np.array(x) - [1.3, 0.6, 0.2] for n, x in at.items()}
    length = np.mean([np.linalg.norm(d) for d in arms.values()])
    rows, scales, columns = [], [], []
    for n, d in arms.items():
        carried = np.eye(6)
        carried[:3, 3:] = np.column_stack([np.cross(e, d) for e in np.eye(3)])
        for c in range(3 if n == 8 else 6):
            rows.append(carried[c])
            scales.append(np.sqrt(2.0) if n == 8 else length if c > 2 else 1.0)
            columns.append((n, c))
    mean = np.linalg.pinv(np.array(rows) * np.array(scales)[:, None]) * np.array(scales)
    for k, port in enumerate(("fx", "fy", "fz", "mx", "my", "mz")):
        b = a["B"][:, a["names"].index(f"rbe3_9.{port}")]
        found = [b[(a["node"] == n) & (a["component"] == c)][0] for n, c in columns]
        np.testing.assert_allclose(found, mean[k], atol=1e-12)
        assert np.abs(b).sum() == pytest.approx(np.abs(found).sum(), rel=1e-12)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_rigid_element_that_is_held_in_part(ranks: int, tmp_path: Path) -> None:
    """A hinge: the grid of a RBE2 is held but for its turn about y. Against equations by hand."""
    hinge = "GRID,900,,1.2,0.75,0.1\nSPC1,1,12346,900\nRBE2,92,900,123456,80,90\n"
    (tmp_path / "p.bdf").write_text(plate(hinge))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:60")])
    assert any("grid 900 is held in part" in remark for remark in facts["remarks"])
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5", ranks)
    (tmp_path / "q.bdf").write_text(plate())
    assemble_bulk(tmp_path / "q.bdf", tmp_path / "q.h5", [parse("node", "tip=NODES:60")])
    b = assembled(tmp_path / "b.h5", tmp_path / "q.h5")
    n = b["K"].shape[0]
    moved = np.isin(b["node"], [7, 8])
    T = np.zeros((n, int((~moved).sum()) + 1))
    T[np.flatnonzero(~moved), np.arange(T.shape[1] - 1)] = 1
    for row in np.flatnonzero(moved):
        arm = b["position"][row] - [1.2, 0.75, 0.1]
        turned = np.concatenate([np.cross([0, 1, 0], arm), [0, 1, 0]])
        T[row, -1] = turned[b["component"][row]]
    expected = sl.eigh(T.T @ b["K"] @ T, T.T @ b["M"] @ T, eigvals_only=True)[:4]
    np.testing.assert_allclose(lowest(a, 4), expected, rtol=1e-8)


def test_axes_that_are_not_principal(tmp_path: Path) -> None:
    """A rectangle by I1, I2 and I12 about axes at 30 degrees, and about its own."""
    angle, I1, I2 = np.radians(30), 4.5e-8, 2e-8
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    (zz, yz), (_, yy) = turn.T @ np.diag([I1, I2]) @ turn
    own = f"PBAR,1,1,6.-4,{zz:.9e},{yy:.9e},5.-8\n,\n,,,{yz:.9e}".replace("e-0", "-")
    vector = f"{np.cos(angle):.9f},{np.sin(angle):.9f}"
    turned = PLAIN.replace("0.,1.,0.", f"0.,{vector}")
    a = body_of(tmp_path, bars(turned).replace("PBAR,1,1,6.-4,4.5-8,2.-8,5.-8", own))
    b = body_of(tmp_path, bars(PLAIN))
    assert abs(a["K"] - b["K"]).max() < 1e-7 * abs(b["K"]).max()


def test_masses_by_their_matrix(tmp_path: Path) -> None:
    """CONM1, CMASS1 and CMASS2 act along the axes of their grid, or of a system."""
    cards = (
        "CORD2R,7,,0.,0.,0.,1.,0.,0.\n,0.,1.,0.\n"  # its x, y, z are y, z, x
        "CONM1,90,4,7,3.0,0.5,2.0,,\n,1.0\nCMASS2,91,0.25,5,2\nCMASS1,92,9,5,6\nPMASS,9,0.125\n"
    )
    plain = body_of(tmp_path, bars(PLAIN))
    a = body_of(tmp_path, bars(PLAIN).replace("ENDDATA", cards + "ENDDATA"))
    order = np.lexsort((a["component"], a["node"]))
    added = (a["M"] - plain["M"]).toarray()[np.ix_(order, order)]
    expected = np.zeros_like(added)
    fourth, fifth = added.shape[0] - 12, added.shape[0] - 6
    expected[fourth : fourth + 3, fourth : fourth + 3] = [[1, 0, 0], [0, 3, 0.5], [0, 0.5, 2]]
    expected[fifth + 1, fifth + 1], expected[fifth + 5, fifth + 5] = 0.25, 0.125
    np.testing.assert_allclose(added, expected, atol=1e-12)


def test_what_is_passed_over_with_words(tmp_path: Path) -> None:
    """Moduli by temperature without a temperature, and grids that a SPC moves."""
    cards = "MATT1,1,7\nTABLEM1,7\n,0.,1.,100.,2.,ENDT\nSPC,1,3,3,0.1\n"
    a = body_of(tmp_path, bars(PLAIN).replace("ENDDATA", cards + "ENDDATA"))
    assert "SPC 1 moves grids, which are held here" in a["facts"]["remarks"]
    held = body_of(tmp_path, bars(PLAIN).replace("ENDDATA", "SPC,1,3,3,0.\nENDDATA"))
    assert abs(a["K"] - held["K"]).max() == 0
    warm = bars(PLAIN).replace("SPC = 1", "SPC = 1\nTEMPERATURE(MATERIAL) = 3")
    with pytest.raises(BodyError, match=r"MATT1 \(1\), TABLEM1 \(1\): not supported"):
        body_of(tmp_path, warm.replace("ENDDATA", cards + "ENDDATA"))


def test_a_beam_of_soft_shear(tmp_path: Path) -> None:
    """E and G of which no Poisson's ratio comes: it bends by E, twists by G."""
    text = bars(PLAIN).replace("MAT1,1,2.1+11,,0.3", "MAT1,1,2.1+11,5.+10,")
    a = body_of(tmp_path, text)
    for port, stiff in (("tip.mx", 5e10 * 5e-8), ("tip.my", 2.1e11 * 2e-8)):
        f = a["B"][:, a["names"].index(port)]
        assert 1 / (f @ np.linalg.solve(a["K"].toarray(), f)) == pytest.approx(stiff, rel=1e-5)


def test_masses_at_grids_without_elements(tmp_path: Path) -> None:
    """That a RBE2 moves they are of its body; that nothing joins they are left out, and named."""
    cards = "GRID,900,,2.,2.,0.\nGRID,901,,2.,2.5,0.\nGRID,902,,9.,9.,0.\n"
    cards += "RBE2,92,900,123456,80,90,901\nCONM2,8,901,,2.0\nCONM2,9,902,,3.0\n"
    (tmp_path / "p.bdf").write_text(plate(cards))
    facts = assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [])
    assert "conm9 is left out: nothing joins its grid 902" in facts["remarks"]
    with h5py.File(tmp_path / "p.h5") as file:
        assert list(file["masses"]) == ["conm8"]
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5")
    at = (a["node"] == a["node"].max()) & (a["component"] == 2)
    assert a["M"].diagonal()[at] > 2.0


PLANE = [[float(E_ / (1 - NU**2)), float(NU * E_ / (1 - NU**2)), 0.0],
         [float(NU * E_ / (1 - NU**2)), float(E_ / (1 - NU**2)), 0.0],
         [0.0, 0.0, float(E_ / 2 / (1 + NU))]]  # fmt: skip


def test_a_law_by_its_matrix(tmp_path: Path) -> None:
    """MAT2 and MAT9 with the numbers of a MAT1: the same body, along axes of their own too."""
    G = E_ / (2 * (1 + NU))
    lam = E_ * NU / ((1 + NU) * (1 - 2 * NU))
    row = [f"{x:.7E}" for x in (PLANE[0][0], PLANE[0][1], 0, PLANE[1][1], 0, PLANE[2][2])]
    mat2 = "MAT2*,1," + ",".join(row[:3]) + "\n*," + ",".join(row[3:]) + ",7850.\n"
    found = []
    for material in ("MAT1,1,2.1+11,,0.3,7850.\n", mat2):
        (tmp_path / "p.bdf").write_text(plate(material=material))
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
        found.append(assembled(tmp_path / "a.h5", tmp_path / "p.h5")["K"])
    assert abs(found[0] - found[1]).max() < 1e-6 * abs(found[0]).max()
    C = np.zeros((6, 6))
    C[:3, :3] = lam
    C += np.diag([2 * G] * 3 + [G] * 3)
    upper = [f"{C[i, j]:.7E}" for i in range(6) for j in range(i, 6)]
    fields = ["1", *upper, "7850."]
    lines = [fields[k : k + 4] for k in range(0, len(fields), 4)]
    mat9 = "MAT9*," + "\n*,".join(",".join(line) for line in lines) + "\n"
    grids = "".join(
        f"GRID,{k + 1},,{x}.,{y}.,{z}.\n"
        for k, (x, y, z) in enumerate([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
                                       (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
    )  # fmt: skip
    cube = "CHEXA,1,1,1,2,3,4,5,6\n,7,8\nSPC1,1,123,1,2,3,4\n"
    system = "CORD2R,7,,0.,0.,0.,0.3,0.2,1.\n,1.,0.4,0.\n"
    solids = []
    for material, prop in (
        ("MAT1,1,2.1+11,,0.3,7850.\n", "PSOLID,1,1\n"),
        (mat9, "PSOLID,1,1\n"),
        (mat9, "PSOLID,1,1,7\n"),
    ):
        text = f"{BEGIN}{grids}{cube}{system}{prop}{material}ENDDATA\n"
        solids.append(body_of(tmp_path, text, "tip=NODES:7")["K"])
    for other in solids[1:]:
        assert abs(solids[0] - other).max() < 1e-6 * abs(solids[0]).max()


def test_what_touches_a_grid_alone_is_told_from_rounding(tmp_path: Path) -> None:
    """A spring along a line through it, in axes that are not those of the deck: what is across
    the line is held, whatever rounding leaves there; soft rotations are not."""
    content: dict[str, Any] = {
        "nodes_alone": [1, 2],
        "equations": {},
        "springs": {},
        "masses": {},
        "interfaces": {},
        "supports": {},
    }
    x = np.array([1.0, 1e-17, -1e-17])
    stiff = np.zeros((6, 6))
    stiff[:3, :3] = 1e9 * np.outer(x, x)
    content["springs"]["a"] = {"nodes": [1], "to_nodes": [3], "stiffness": stiff.tolist()}
    both = np.diag([1e9, 1e9, 1e9, 1e-3, 0.0, 0.0])
    content["springs"]["b"] = {"nodes": [2], "stiffness": both.tolist()}
    points = np.array([[0.0, 0.0, 0.0], [0.0, 1e3, 0.0], [1e3, 1e-13, 0.0]])
    hold_untouched(content, points)
    held = {name: entry["components"] for name, entry in content["supports"].items()}
    assert held == {"untouched_1": ["y", "z", "rx", "ry", "rz"], "untouched_2": ["ry", "rz"]}


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ["PBEAM", "PBEAML"])
def test_a_beam_that_tapers(kind: str, ranks: int, tmp_path: Path) -> None:
    """One element: its tip's compliance and twist by integrals, its mass, and the frequencies of
    the same beam of many elements."""
    if kind == "PBEAM":
        prop = "PBEAM,1,1,8.-4,6.-8,3.-8,0.,5.-8,,\n,,,,,,,,,\n,YES,1.0,4.-4,2.-8,1.-8,0.,1.-8\n"
        values = {"A": (8e-4, 4e-4), "Iz": (6e-8, 2e-8), "Iy": (3e-8, 1e-8), "J": (5e-8, 1e-8)}
    else:
        prop = "PBEAML,1,1,,BAR,,,,,\n,0.02,0.04,0.,YES,1.0,0.02,0.02,0.\n"
        values = {}
    material = "MAT1,1,2.1+11,,0.3,7850.\nPARAM,COUPMASS,1\n"
    text = (
        "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.2,0.,0.\n"
        f"CBEAM,1,1,1,2,0.,1.,0.\n{prop}{material}SPC1,1,123456,1\nENDDATA\n"
    )
    a = body_of(tmp_path, text, "tip=NODES:2", ranks)
    s = np.linspace(0, 1, 20001)

    def over(name: str, weight: Any) -> float:
        if values:
            first, last = values[name]
            of = first + (last - first) * s
        else:
            b, h = 0.02, 0.04 - 0.02 * s
            of = {"A": b * h, "Iz": b * h**3 / 12, "Iy": b**3 * h / 12}[name]
        ratio = weight / of
        return float(np.sum((ratio[1:] + ratio[:-1]) / 2 * 1.2 * np.diff(s)))

    G = E_ / 2.6
    for port, inertia in (("fy", "Iz"), ("fz", "Iy")):
        f = a["B"][:, a["names"].index(f"tip.{port}")]
        found = f @ np.linalg.solve(a["K"].toarray(), f)
        bending = over(inertia, (1.2 * (1 - s)) ** 2) / E_
        assert found == pytest.approx(bending + over("A", 1.0 + 0 * s) / (G * 5 / 6), rel=0.01)
    if values:
        f = a["B"][:, a["names"].index("tip.mx")]
        assert f @ np.linalg.solve(a["K"].toarray(), f) == pytest.approx(
            over("J", 1 + 0 * s) / G, rel=0.01
        )
    mass = 7850 * 1.2 * (6e-4 if values else 0.02 * 0.03)
    assert any(f"mass {mass:.6g} kg" in line for line in a["facts"]["summary"])
