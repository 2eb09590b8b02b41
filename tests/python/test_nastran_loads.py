"""Load sets of Nastran bulk data as inputs: forces by hand, totals by pyNastran, beams and plates
in closed form, gravity and spin by the body's own mass."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from test_nastran_whole import E_, PLAIN, bars

from conftest import assembled, run
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk

INERTIA = {"y": 4.5e-8, "z": 2e-8}  # against motion along these, of PROPERTY


class Body:
    """Bulk data with the loads of its cases as inputs."""

    def __init__(
        self, folder: Path, text: str, ports: str | None = "tip=NODES:5", ranks: int = 1
    ) -> None:
        (folder / "b.bdf").write_text(text)
        named = [parse("node", ports)] if ports else []
        self.facts = assemble_bulk(folder / "b.bdf", folder / "b.h5", named, deck_loads=True)
        self.a = assembled(folder / "a.h5", folder / "b.h5", ranks)
        self.names = [str(name) for name in self.a["names"]]

    def column(self, name: str) -> Any:
        return self.a["B"][:, self.names.index(name)]

    def total(self, name: str) -> Any:
        """Force and moment about the origin."""
        f, x, c = self.column(name), self.a["position"], self.a["component"]
        forces = np.zeros((len(f), 3))
        moments = np.zeros((len(f), 3))
        forces[c < 3, c[c < 3]] = f[c < 3]
        moments[c > 2, c[c > 2] - 3] = f[c > 2]
        return np.concatenate([forces.sum(0), (np.cross(x, forces) + moments).sum(0)])

    def motion(self, name: str, node: int) -> Any:
        """Of a grid (by its place among them, from 0), six numbers."""
        u = np.linalg.solve(self.a["K"].toarray(), self.column(name))
        six = np.zeros(6)
        at = self.a["node"] == node
        six[self.a["component"][at]] = u[at]
        return six


def with_cards(cards: str, **more: Any) -> str:
    """Four bars along x of one metre in all, held at grid 1, with further cards."""
    return bars(PLAIN, **more).replace("ENDDATA", cards + "ENDDATA")


def test_forces_and_moments(tmp_path: Path) -> None:
    """In systems that are turned, along lines and across planes, combined with factors."""
    cards = (
        "CORD2C,7,,0.,0.,0.,1.,0.,0.\n,0.,1.,0.\n"  # along x; its r and θ turn with the grid
        "GRID,21,,0.,3.,0.\nGRID,22,,0.,3.,4.\n"
        "LOAD,9,2.,3.,1,0.5,2\n"
        "FORCE,1,5,,10.,1.,2.,3.\nMOMENT,1,4,,2.,0.,1.,0.\n"
        "FORCE1,2,5,6.,21,22\nFORCE2,2,4,8.,1,5,1,21\nMOMENT1,2,3,4.,1,5\n"
        "FORCE,3,21,7,5.,1.,0.,0.\n"
    )
    a = Body(tmp_path, with_cards(cards))
    # Of set 3 the grid belongs to no element; 1 and 2 are combined by 9.
    assert list(a.facts["loads"]) == ["load9"]
    assert "load 3 is left out: grid 21 belongs to no element" in a.facts["remarks"]
    expected = {
        (4, 0): 2 * 3 * 10.0, (4, 1): 2 * 3 * 20.0, (4, 2): 2 * 3 * 30.0 + 2 * 0.5 * 6,
        (3, 4): 2 * 3 * 2.0, (3, 2): 2 * 0.5 * 8, (2, 3): 2 * 0.5 * 4,
    }  # fmt: skip
    found = a.column("load9.load")
    places = zip(a.a["node"].tolist(), a.a["component"].tolist(), strict=True)
    np.testing.assert_allclose(found, [expected.get(place, 0.0) for place in places], atol=1e-12)


def test_a_cylindrical_system(tmp_path: Path) -> None:
    """Its directions are those at the grid: r of a grid at 30° to x."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    cards = f"CORD2C,7,,0.,{-s:.15g},0.,0.,{-s:.15g},1.\n,1.,{-s:.15g},0.\n"
    cards += "FORCE,3,5,7,5.,1.,2.,3.\n"
    a = Body(tmp_path, with_cards(cards, length=float(c)))
    r, theta = np.array([c, s, 0]), np.array([-s, c, 0])
    expected = 5 * (r + 2 * theta + 3 * np.array([0, 0, 1]))
    np.testing.assert_allclose(a.total("load3.load")[:3], expected, rtol=1e-9)


def test_loads_along_beams(tmp_path: Path) -> None:
    """Of slender beams, nodes move as in closed form: under an even load, one that grows, a force
    and a moment between nodes."""
    cards = (
        "PLOAD1,1,1,FZ,FR,0.,5.,1.,5.\nPLOAD1,1,2,FZ,LE,0.,5.,0.25,5.\nPLOAD1,1,3,FZE,FR,0.,5.,1.,\n"
        "PLOAD1,1,4,FZE,FR,0.,5.,1.,5.\n"
        "PLOAD1,2,2,FY,FR,0.4,7.\nPLOAD1,3,2,MZ,FR,0.4,3.\n"
        "PLOAD1,4,1,FZ,FR,0.,0.,1.,2.\nPLOAD1,4,2,FZ,FR,0.,2.,1.,4.\nPLOAD1,4,3,FZ,FR,0.,4.,1.,6.\n"
        "PLOAD1,4,4,FZ,FR,0.,6.,1.,8.\nPLOAD1,5,2,FZ,FRPR,0.,1.,1.,1.\n"
        "PLOAD1,6,2,MX,FR,0.,2.,1.,2.\n"
    )
    a = Body(tmp_path, with_cards(cards))
    EI, EI_y, L = E_ * INERTIA["z"], E_ * INERTIA["y"], 1.0
    for node in range(1, 5):
        x = node / 4
        even = 5 * x**2 * (6 * L**2 - 4 * L * x + x**2) / (24 * EI)
        assert a.motion("load1.load", node)[2] == pytest.approx(even, rel=2e-3)
        growing = 8 * x**2 * (20 * L**3 - 10 * L**2 * x + x**3) / (120 * EI * L)
        assert a.motion("load4.load", node)[2] == pytest.approx(growing, rel=2e-3)
    place = 0.25 + 0.4 * 0.25
    bent = 7 * place**2 * (3 * L - place) / (6 * EI_y)
    assert a.motion("load2.load", 4)[1] == pytest.approx(bent, rel=2e-3)
    turned = a.motion("load3.load", 4)
    assert turned[1] == pytest.approx(3 * place * (L - place / 2) / EI_y, rel=1e-6)
    assert turned[5] == pytest.approx(3 * place / EI_y, rel=1e-6)
    np.testing.assert_allclose(a.total("load6.load"), [0, 0, 0, 2 * 0.25, 0, 0], atol=1e-12)
    assert "load 5 is left out: PLOAD1 by projected length (FRPR)" in a.facts["remarks"]


def test_loads_along_a_beam_that_tapers(tmp_path: Path) -> None:
    """In pieces: totals of an even load and of a moment between its ends."""
    text = with_cards("PLOAD1,1,2,FY,FR,0.1,4.,0.9,4.\nPLOAD1,2,2,MZ,FR,0.37,3.\n")
    taper = "PBEAM,2,1,1.-3,2.-8,2.-8,,5.-8\n,,,,,,,,\n,NO,1.,5.-4,1.-8,1.-8,,3.-8\nENDDATA"
    text = text.replace("CBAR,2,1,", "CBEAM,2,2,").replace("ENDDATA", taper)
    a = Body(tmp_path, text)
    force = 4 * 0.8 * 0.25
    np.testing.assert_allclose(a.total("load1.load"), [0, force, 0, 0, 0, force * 0.375], atol=1e-9)
    np.testing.assert_allclose(a.total("load2.load"), [0, 0, 0, 0, 0, 3], atol=1e-9)


def sheet(cards: str, elements: str = "CQUAD4,1,1,1,2,4,3\n") -> str:
    """A rectangle of 2 m × 1 m in x and y, off the origin, with cards."""
    grids = "".join(f"GRID,{k + 1},,{1 + 2 * (k & 1)}.,{2 + (k >> 1)}.,0.5\n" for k in range(4))
    return (
        f"SOL 101\nCEND\nBEGIN BULK\n{grids}{elements}PSHELL,1,1,0.01,1,,1\n"
        f"MAT1,1,2.1+11,,0.3,7850.\n{cards}ENDDATA\n"
    )


def integrated(pressure: Any, along: Any = (0, 0, 1)) -> Any:
    """Force and moment about the origin of a pressure p(x, y) from 0 to 1 along the sheet."""
    xi, w = np.polynomial.legendre.leggauss(5)
    xi, w = (xi + 1) / 2, w / 2
    found = np.zeros(6)
    for a, wa in zip(xi, w, strict=True):
        for b, wb in zip(xi, w, strict=True):
            force = 2.0 * wa * wb * pressure(a, b) * np.asarray(along, float)
            found[:3] += force
            found[3:] += np.cross([1 + 2 * a, 2 + b, 0.5], force)
    return found


@pytest.mark.parametrize("ranks", [1, 2])
def test_pressure_on_a_shell(ranks: int, tmp_path: Path) -> None:
    """Even, different at the corners, in a direction, on triangles."""
    cards = (
        "PLOAD2,1,3.,1\nPLOAD4,2,1,1.,2.,3.14,1.67\nPLOAD4,3,1,2.,,,,,\n,0,3.,0.,4.\n"
        "PLOAD,4,3.,1,2,4,3\nLOAD,5,5.,7.,1\nLOAD,6,2.,1.,5\n"
    )
    cases = "".join(f"SUBCASE {k}\nLOAD={k}\n" for k in range(2, 7))
    text = sheet(cards).replace("CEND\n", f"CEND\n{cases}")
    a = Body(tmp_path, text, "tip=NODES:4", ranks)
    bilinear = lambda u, v: (  # noqa: E731
        (1 - u) * (1 - v) * 1 + u * (1 - v) * 2 + u * v * 3.14 + (1 - u) * v * 1.67
    )
    for name, expected in {
        "load2": integrated(bilinear),
        "load3": integrated(lambda u, v: 2.0, (0.6, 0, 0.8)),
        "load4": integrated(lambda u, v: 3.0),
        "load5": integrated(lambda u, v: 105.0),
    }.items():
        np.testing.assert_allclose(a.total(f"{name}.load"), expected, atol=1e-9)
    assert "load 6 is left out: it combines 5, which is a LOAD itself" in a.facts["remarks"]
    triangles = "CTRIA3,1,1,1,2,4\nCTRIA3,2,1,1,4,3\n"
    a = Body(tmp_path, sheet("PLOAD4,1,1,3.,,,,THRU,2\nPLOAD2,2,3.,1,2\n", triangles),
             "tip=NODES:4", ranks)  # fmt: skip
    for name in ("load1.load", "load2.load"):
        np.testing.assert_allclose(a.total(name), integrated(lambda u, v: 3.0), atol=1e-9)


def block(cards: str) -> str:
    """A hexahedron of 2 × 1 × 1, a wedge and a tetrahedron apart from it, each of its own."""
    corners = [
        (0, 0, 0),
        (2, 0, 0),
        (2, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (2, 0, 1),
        (2, 1, 1),
        (0, 1, 1),
    ]
    wedge = [(5, 0, 0), (6, 0, 0), (5, 1, 0), (5, 0, 2), (6, 0, 2), (5, 1, 2)]
    tetra = [(8, 0, 0), (9, 0, 0), (8, 2, 0), (8, 0, 3)]
    lines = ["SOL 101\nCEND\nBEGIN BULK\n"]
    for first, of in ((1, corners), (21, wedge), (31, tetra)):
        lines += [f"GRID,{first + k},,{x}.,{y}.,{z}.\n" for k, (x, y, z) in enumerate(of)]
    lines.append("CHEXA,1,1,1,2,3,4,5,6,\n,7,8\nCPENTA,2,1,21,22,23,24,25,26\n")
    lines.append("CTETRA,3,1,31,32,33,34\nPSOLID,1,1\nMAT1,1,2.1+11,,0.3,7850.\n")
    lines.append(f"{cards}ENDDATA\n")
    return "".join(lines)


def test_pressure_on_solids(tmp_path: Path) -> None:
    """Inward on the face that its grids name; the sum that pyNastran has."""
    from pyNastran.bdf.bdf import read_bdf
    from pyNastran.bdf.mesh_utils.loads import sum_forces_moments

    cards = (
        "PLOAD4,1,1,3.,,,,2,7\nPLOAD4,2,2,3.,,,,21\nPLOAD4,3,2,3.,,,,22,26\nPLOAD4,4,3,3.,,,,32,31\n"
        "PLOAD4,5,1,1.,2.,4.,3.,2,7\nPLOAD4,6,1,1.\n"
    )
    a = Body(tmp_path, block(cards), "tip=NODES:2")
    model = read_bdf(str(tmp_path / "b.bdf"), debug=None)
    for number in (1, 2, 3, 4):
        force, moment = sum_forces_moments(model, np.zeros(3), number, include_grav=False)
        np.testing.assert_allclose(
            a.total(f"load{number}.load"), np.concatenate([force, moment]), atol=1e-6
        )
    np.testing.assert_allclose(a.total("load1.load")[:3], [-3, 0, 0], atol=1e-12)
    # Pressures at 2, then the corners clockwise seen from outside: 6, 7, 3 have 1, 2, 4, 3.
    forces = {}
    of = a.column("load5.load")
    for node, component, value in zip(a.a["node"], a.a["component"], of, strict=True):
        if component == 0 and value:
            forces[int(node) + 1] = value
    # ∫ N_i N_j over a unit square: 4, 2, 1, 2 thirty-sixths.
    ring = [2, 6, 7, 3]
    p = dict(zip(ring, (1.0, 2.0, 4.0, 3.0), strict=True))
    for k, node in enumerate(ring):
        around = [ring[(k + s) % 4] for s in (1, 2, 3)]
        expected = -(4 * p[node] + 2 * p[around[0]] + p[around[1]] + 2 * p[around[2]]) / 36
        assert forces[node] == pytest.approx(expected, rel=1e-9)
    assert "load 6 is left out: PLOAD4 on the solid 1 names no grid of a face" in a.facts["remarks"]


@pytest.mark.parametrize("mass", ["", "PARAM,COUPMASS,1\n"])
def test_gravity_and_spin(mass: str, tmp_path: Path) -> None:
    """M times the acceleration, point masses and either mass included; with forces in one set, an
    input of its own. A spin is that of `--load`."""
    cards = (
        f"{mass}CONM2,50,5,,3.\n,0.1,,0.2,,,0.3\n"
        "CORD2R,7,,0.,0.,0.,0.,1.,0.\n,1.,0.,0.\n"
        "GRAV,1,7,2.,1.,2.,3.\nFORCE,1,5,,1.,1.\nLOAD,9,3.,2.,1\nRFORCE,2,2,,0.5,0.,3.,4.\n"
    )
    text = with_cards(cards, held="").replace("PARAM,COUPMASS,1\n", "", 1)
    a = Body(tmp_path, text)
    assert list(a.facts["loads"]) == ["load2_spin", "load9", "load9_gravity"]
    # Axes of the system: z along y, x along x, so y along −z.
    vector = 12 * np.array([1.0, 3.0, -2.0])
    field = np.where(a.a["component"] < 3, np.append(vector, np.zeros(3))[a.a["component"]], 0.0)
    expected = a.a["M"] @ field
    np.testing.assert_allclose(a.column("load9_gravity.load"), expected, rtol=1e-9,
                               atol=1e-9 * np.abs(expected).max())  # fmt: skip
    assert a.total("load9.load")[0] == pytest.approx(6)
    square = (2 * np.pi * 0.5 * 5) ** 2
    assert f"that of the deck (RFORCE) is {square:.9g} rad²/s²" in str(a.facts["remarks"])
    assemble_bulk(
        tmp_path / "b.bdf", tmp_path / "c.h5", [parse("node", "tip=NODES:5")],
        loads={"gravity": {"type": "acceleration"},
               "turn": {"type": "spin", "point": [0.25, 0, 0], "axis": [0, 0.6, 0.8]}},
    )  # fmt: skip
    other = assembled(tmp_path / "a.h5", tmp_path / "c.h5")
    np.testing.assert_allclose(
        a.column("load9_gravity.load"), other["B"][:, -4:-1] @ vector, rtol=1e-9, atol=1e-8
    )
    np.testing.assert_allclose(a.column("load2_spin.spin"), other["B"][:, -1], rtol=1e-12)


@pytest.mark.parametrize("kind", ["RBE2", "RBE3"])
@pytest.mark.parametrize("ranks", [1, 2])
def test_loads_at_the_grid_of_an_interface(kind: str, ranks: int, tmp_path: Path) -> None:
    """Which moves a face: the load is that of the interface's own inputs; also at a grid that is
    only carried."""
    grids = [(x, y, z) for z in range(3) for y in range(2) for x in range(2)]
    lines = ["SOL 101\nCEND\nBEGIN BULK\nPARAM,COUPMASS,1\n"]
    lines += [f"GRID,{k},,{x}.,{y}.,{z}.\n" for k, (x, y, z) in enumerate(grids, 1)]
    lines.append("CHEXA,1,1,1,2,4,3,5,6,\n,8,7\nCHEXA,2,1,5,6,8,7,9,10,\n,12,11\n")
    lines.append("PSOLID,1,1\nMAT1,1,2.1+11,,0.3,7850.\nSPC1,1,123,1,2,3,4\nGRID,50,,0.3,0.2,2.7\n")
    lines.append("FORCE,1,50,,10.,1.,-2.,3.\nMOMENT,1,50,,5.,3.,2.,1.\n")
    if kind == "RBE2":
        lines.append(
            "GRID,51,,0.9,0.4,3.1\nRBE2,7,50,123456,9,10,11,12,51\nFORCE,2,51,,4.,0.,1.,2.\n"
        )
    else:
        lines.append("RBE3,7,,50,123456,1.,123,9,10,\n,2.,123,11,12\n")
    a = Body(tmp_path, "".join([*lines, "ENDDATA\n"]), None, ranks)
    name = f"{kind.lower()}_7"
    ports = np.column_stack([a.column(f"{name}.{c}") for c in ("fx", "fy", "fz", "mx", "my", "mz")])
    six = np.array([10.0, -20, 30, 15, 10, 5])
    np.testing.assert_allclose(a.column("load1.load"), ports @ six, atol=1e-9)
    if kind == "RBE2":
        force, arm = np.array([0.0, 4, 8]), np.array([0.6, 0.2, 0.4])
        of_carried = np.concatenate([force, np.cross(arm, force)])
        np.testing.assert_allclose(a.column("load2.load"), ports @ of_carried, atol=1e-9)


def test_moments_that_no_grid_takes(tmp_path: Path) -> None:
    a = Body(tmp_path, block("FORCE,1,2,,1.,1.\nMOMENT,1,2,,1.,1.\n"), "tip=NODES:3")
    np.testing.assert_allclose(a.total("load1.load")[:3], [1, 0, 0])
    assert (
        "moments at grids without rotations are left out, first at 2, as AUTOSPC does"
        in (a.facts["remarks"])
    )


def test_temperatures(tmp_path: Path) -> None:
    """Above TREF, or above those of the beginning; by TEMPD where no TEMP says another."""
    heat = (
        "TEMP,3,1,120.,2,120.,3,140.\nTEMPD,3,160.\nTEMPD,4,30.\nTEMP,5,1,50.\n"
        "MAT1,9,2.+11,,0.3,7800.,1.1-5,20.\n"
    )
    text = with_cards(heat).replace("PBAR,1,1,", "PBAR,1,9,")
    a = Body(tmp_path, text)
    assert list(a.facts["loads"]) == ["temperature3", "temperature4"]
    assert (
        "temperature 5 is left out: grid 2 has no temperature (TEMP, TEMPD)" in a.facts["remarks"]
    )
    above = np.array([100, 100, 120, 140, 140.0])
    grown = 1.1e-5 * 0.25 * ((above[1:] + above[:-1]) / 2).sum()
    assert a.motion("temperature3.T", 4)[0] == pytest.approx(grown, rel=1e-9)
    assert a.motion("temperature4.T", 4)[0] == pytest.approx(1.1e-5 * 10, rel=1e-9)
    control = (
        "SUBCASE 1\nTEMP(LOAD)=3\nTEMP(INIT)=4\nSUBCASE 2\nLOAD=8\nSPC=1\nBEGIN BULK\n"
        "FORCE,8,5,,1.,1.\nFORCE,7,5,,1.,1.\n"
    )
    a = Body(tmp_path, text.replace("BEGIN BULK\n", control))
    assert list(a.facts["loads"]) == ["load8", "temperature3"]
    above = np.array([90, 90, 110, 130, 130.0])
    grown = 1.1e-5 * 0.25 * ((above[1:] + above[:-1]) / 2).sum()
    assert a.motion("temperature3.T", 4)[0] == pytest.approx(grown, rel=1e-9)


def test_a_shell_with_heat(tmp_path: Path) -> None:
    """A material of a PSHELL brings its expansion; a MAT1 without A is named."""
    heat = "TEMPD,3,70.\nSPC1,1,123456,1\n"
    text = sheet(heat).replace("0.3,7850.", "0.3,7850.,1.2-5,20.")
    a = Body(tmp_path, text, "tip=NODES:4")
    moved = a.motion("temperature3.T", 3)
    np.testing.assert_allclose(moved[:3], 1.2e-5 * 50 * np.array([2, 1, 0]), atol=1e-12)
    a = Body(tmp_path, sheet(heat), "tip=NODES:4")
    assert not a.facts["loads"]
    assert "temperature 3 is left out: material mat1 has no expansion" in str(a.facts["remarks"])


def test_the_command_line(tmp_path: Path) -> None:
    """Without the option the loads are named, with it they are inputs; cards that are not supported
    leave out their set."""
    (tmp_path / "b.bdf").write_text(with_cards("FORCE,1,5,,1.,1.\nACCEL1,2,,9.81,0.,0.,1.\n,5\n"))
    said = run("import", tmp_path / "b.bdf", "--assemble", "--node", "tip=NODES:5", "-o",
               tmp_path / "b.h5")  # fmt: skip
    assert "loads of the deck are left out: ACCEL1 (1), FORCE (1) (--deck-loads makes" in said.out
    said = run("import", tmp_path / "b.bdf", "--assemble", "--node", "tip=NODES:5", "--deck-loads",
               "-o", tmp_path / "b.h5")  # fmt: skip
    assert "load 2 is left out: ACCEL1 (1) is not supported" in said.out
    with h5py.File(tmp_path / "b.h5") as file:
        assert list(file["loads"]) == ["load1"]
    run(
        "reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "1,500", "-mor_out", tmp_path / "r.h5"
    )
    with h5py.File(tmp_path / "r.h5") as file:
        assert "load1.load" in [str(name) for name in file["B"].attrs["names"]]


def test_an_acceleration_as_one_input(tmp_path: Path) -> None:
    """On the command line, in the units of the mesh; a vector of zeros is refused."""
    (tmp_path / "b.bdf").write_text(with_cards("", held=""))
    given = [
        "import",
        tmp_path / "b.bdf",
        "--assemble",
        "--node",
        "tip=NODES:5",
        "--units",
        "mm-t-s",
    ]
    vectors = {"weight": "0,0,-9810", "none": "0,0,0", "two": "1,2"}
    loads = [f"--load={name}=acceleration:{words}" for name, words in vectors.items()]
    run(*given, loads[0], "--load", "all=acceleration", "-o", tmp_path / "b.h5")
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
    B = {str(name): a["B"][:, k] for k, name in enumerate(a["names"])}
    np.testing.assert_allclose(B["weight.load"], -9.81 * B["all.az"], atol=1e-9)
    said = run(*given, loads[1], "-o", tmp_path / "c.h5", expect=1)
    assert "loads: none: vector = [0, 0, 0] is no acceleration" in said.err
    said = run(*given, loads[2], "-o", tmp_path / "c.h5", expect=1)
    assert "expected 3 finite numbers, not '1,2'" in said.err


def test_sets_that_name_what_is_not_there(tmp_path: Path) -> None:
    """Elements, systems and sets that are missing leave out their set, and say which; a set that
    combines temperatures, and temperatures with the number of forces, become inputs."""
    cards = (
        "PLOAD4,1,5000,1.\nPLOAD4,2,1,1.,,,,THRU,9\nPLOAD2,3,1.,7\nGRAV,4,5,1.,0.,0.,1.\n"
        "FORCE,5,4,9,1.,1.\nLOAD,6,1.,1.,8,1.,77\nFORCE,8,4,,2.,1.\nTEMPD,8,70.\nLOAD,9,3.,1.,8\n"
        "FORCES,10,4,,1.,1.\nRFORCE,11,1,8,1.,0.,0.,1.\nTEMPP1,12,1,70.,5.\nTEMPD,13,90.\n"
        "INCLUDE 'more.bdf'\n"
    )
    (tmp_path / "more.bdf").write_text("tempp1* 13              1\n*       70.\n")
    text = sheet(cards).replace("0.3,7850.", "0.3,7850.,1.2-5")
    cases = "".join(f"SUBCASE {k}\nLOAD={k}\nTEMP(LOAD)=8\n" for k in (1, 2, 3, 4, 5, 6, 8, 9, 11))
    cases += "SUBCASE 12\nTEMP(LOAD)=12\nSUBCASE 13\nTEMP(LOAD)=13\n"
    a = Body(tmp_path, text.replace("CEND\n", f"CEND\n{cases}"), "tip=NODES:4")
    said = str(a.facts["remarks"])
    for words in (
        "load 1 is left out: PLOAD4 on element 5000, which is not in the deck",
        "load 2 is left out: PLOAD4 on element 2, which is not in the deck",
        "load 3 is left out: PLOAD2 on element 7, which is not in the deck",
        "load 4 is left out: GRAV in the system 5, which is not in the deck",
        "load 5 is left out: FORCE in the system 9, which is not in the deck",
        "load 6 is left out: it combines 77, which is not in the deck",
        "load 11 is left out: RFORCE in the system 8, which is not in the deck",
        "temperature 12 is left out: TEMPP1 (1) is not supported",
        "temperature 13 is left out: TEMPP1 (1) is not supported",
        "cards that pyNastran does not know are passed over: FORCES (1)",
    ):
        assert words in said, words
    assert list(a.facts["loads"]) == ["load8", "load9", "temperature8"]
    assert a.total("load9.load")[0] == pytest.approx(6)


def test_heat_reaches_nodes_behind_the_grids(tmp_path: Path) -> None:
    """A beam that tapers grows as a whole; a plate with a stiffener beside its nodes, evenly warm
    and of one material, grows without bending."""
    taper = "PBEAM,2,1,1.-3,2.-8,2.-8,,5.-8\n,,,,,,,,\n,NO,1.,5.-4,1.-8,1.-8,,3.-8\nENDDATA"
    text = with_cards("TEMPD,3,100.\n").replace("0.3,7850.", "0.3,7850.,1.1-5")
    text = text.replace("CBAR,2,1,", "CBEAM,2,2,").replace("ENDDATA", taper)
    moved = Body(tmp_path, text).motion("temperature3.T", 4)
    np.testing.assert_allclose(moved, [1.1e-3, 0, 0, 0, 0, 0], atol=1e-12)
    text = sheet(
        "TEMPD,3,50.\nSPC1,1,123456,1\nCBAR,9,5,1,2,0.,1.,0.\n,,,0.,0.,0.2,0.,0.,0.2\n"
        "PBAR,5,1,1.-3,2.-6,2.-6,2.-6\n"
    ).replace("0.3,7850.", "0.3,7850.,1.2-5")
    moved = Body(tmp_path, text, "tip=NODES:4").motion("temperature3.T", 3)
    np.testing.assert_allclose(moved, 6e-4 * np.array([2, 1, 0, 0, 0, 0]), atol=1e-12)


def test_temperatures_without_stress_of_laminates(tmp_path: Path) -> None:
    """Of a PCOMP its TREF counts, not those of its plies; the core of a sandwich needs no
    expansion."""
    text = sheet("TEMPD,3,70.\nSPC1,1,123456,1\n").replace("0.3,7850.", "0.3,7850.,1.2-5,20.")
    laminate = text.replace("PSHELL,1,1,0.01,1,,1\n", "PCOMP,1,,,,,50.\n,1,0.01,0.\n")
    moved = Body(tmp_path, laminate, "tip=NODES:4").motion("temperature3.T", 3)
    np.testing.assert_allclose(moved[:2], 1.2e-5 * 20 * np.array([2, 1]), rtol=1e-7)
    core = "PSHELL,1,1,0.01,1,4.,2,3.\nMAT1,2,1.+9,4.+8,,100.\n"
    sandwich = text.replace("PSHELL,1,1,0.01,1,,1\n", core)
    moved = Body(tmp_path, sandwich, "tip=NODES:4").motion("temperature3.T", 3)
    np.testing.assert_allclose(moved[:2], 1.2e-5 * 50 * np.array([2, 1]), rtol=1e-7)


def test_heights_of_stress(tmp_path: Path) -> None:
    """Z1 and Z2 of a PSHELL, or half of the thickness that an element has of its own."""
    own = "CQUAD4,1,1,1,2,4,3\n,,,0.02,0.02,0.02,0.02\n"
    for cards, wanted, elements in (
        ("PSHELL,1,1,0.01,1,4.,1\n", (-0.005, 0.005), None),
        ("PSHELL,1,1,0.01,1,4.,1,,\n,0.03,-0.02\n", (-0.02, 0.03), None),
        ("PSHELL,1,1,0.01,1,4.,1\n", (-0.01, 0.01), own),
    ):
        text = sheet("", elements or "CQUAD4,1,1,1,2,4,3\n")
        Body(tmp_path, text.replace("PSHELL,1,1,0.01,1,,1\n", cards), "tip=NODES:4")
        with h5py.File(tmp_path / "b.h5") as file:
            (section,) = file["sections"].values()
            assert tuple(section.attrs["sides"]) == pytest.approx(wanted)


def test_scalar_points_and_what_is_held(tmp_path: Path) -> None:
    """SLOAD acts on scalar points. A force at a grid that only a held RBE2 moves does nothing, and
    the rest of its set counts."""
    cards = "SPOINT,90\nCELAS2,91,2.+5,5,1,90,1\nCMASS2,92,0.5,90,1\nSLOAD,1,90,3.\n"
    a = Body(tmp_path, with_cards(cards))
    assert np.abs(a.column("load1.load")).sum() == pytest.approx(3)
    cards = "GRID,30,,0.,1.,0.\nRBE2,7,1,123456,30\nFORCE,1,30,,1.,1.\nFORCE,1,5,,2.,1.\n"
    a = Body(tmp_path, with_cards(cards))
    np.testing.assert_allclose(a.total("load1.load")[:3], [2, 0, 0])


@pytest.mark.parametrize(
    ("cards", "words"),
    [
        ("FORCE,1,8888,,1.,1.\n", "grid 8888 of FORCE sid=1 is not in the deck"),
        ("CQUAD4,2,1,1,2,4,77\n", "grid 77 of CQUAD4 eid=2 is not in the deck"),
        ("FORCE,1,4,,five,1.\n", "pyNastran cannot read it: mag = 'FIVE'"),
        ("PSHELL,2,5,0.01\nCQUAD4,2,2,1,2,4,3\n", "is not in the deck: PSHELL"),
    ],
)
def test_mistakes_are_named(cards: str, words: str, tmp_path: Path) -> None:
    """Without the lists of what is there."""
    with pytest.raises(BodyError) as refused:
        Body(tmp_path, sheet(cards), "tip=NODES:4")
    assert words in str(refused.value) and "is the file complete" not in str(refused.value)
    assert len(str(refused.value)) < 400
