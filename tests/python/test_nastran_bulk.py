"""Nastran bulk data assembled here, against bodies of the same described otherwise, and closed
forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as sl
from test_preload import line

from bodies import box
from conftest import assembled
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk
from sheets import flat, sheet

pytest.importorskip("pyNastran")
STEEL = "MAT1,1,2.1+11,,0.3,7850.\n"
CARDS = {
    "tetra": "CTETRA", "tetra10": "CTETRA", "hexahedron": "CHEXA", "hexahedron20": "CHEXA",
    "wedge": "CPENTA", "wedge15": "CPENTA", "quad": "CQUAD4", "triangle": "CTRIA3", "line": "CBAR",
}  # fmt: skip
#: Nastran has the vertical edges before the top ones.
SWAPPED = {
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
    "wedge15": [*range(9), *range(12, 15), *range(9, 12)],
}


def card(*words: Any) -> str:
    """Comma separated, with continuations of eight fields."""
    fields = [number(w) if isinstance(w, float) else str(w) for w in words]
    rows = [fields[:9]] + [["", *fields[k : k + 8]] for k in range(9, len(fields), 8)]
    return "\n".join(",".join(row) for row in rows) + "\n"


def number(x: float) -> str:
    """Of at most sixteen characters, with a point."""
    text = f"{x:.9e}"
    return text if "." in text else text.replace("e", ".e")


def bulk(mesh: meshio.Mesh, more: str, after: dict[str, str] | None = None) -> str:
    """A deck of a mesh whose labels are 10, 20, …; ``after``: fields behind nodes of elements."""
    text = "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nPARAM,COUPMASS,1\n"
    for k, x in enumerate(mesh.points):
        text += card("GRID", 10 * k + 10, "", *(number(c) for c in x))
    label = 0
    for block in mesh.cells:
        for nodes in block.data:
            label += 1
            order = nodes[SWAPPED[block.type]] if block.type in SWAPPED else nodes
            fields = [10 * int(n) + 10 for n in order]
            text += card(CARDS[block.type], label, 1, *fields, *(after or {}).get(block.type, ()))
    return text + more + "ENDDATA\n"


def clamp(mesh: meshio.Mesh, components: str) -> str:
    return "".join(card("SPC1", 1, components, 10 * int(n) + 10) for n in mesh.point_sets["start"])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    "kind",
    ["tetra", "tetra10", "hexahedron", "hexahedron20", "wedge", "wedge15", "quad", "triangle"],
)
def test_elements_are_those_of_a_description(kind: str, ranks: int, tmp_path: Path) -> None:
    """Matrices entry by entry, with an RBE2 at its end and a mass on that; consistent mass and
    lumped."""
    if kind in ("quad", "triangle"):
        mesh = sheet(kind, (4, 3), lambda u, v: (0.4 * u, 0.3 * v, 0.1 * u * v))
        prop = "PSHELL,1,1,0.01,1,,1\n"
        section = {"sections": {"s": {"shape": "shell", "thickness": 0.01}}}
        region = {"material": "steel", "section": "s"}
        components, names = "123456", ["x", "y", "z", "rx", "ry", "rz"]
    else:
        mesh = box(kind, (3, 2, 2))
        prop, section, region = "PSOLID,1,1\n", {}, {"material": "steel"}
        components, names = "123", ["x", "y", "z"]
    far = 10 * len(mesh.points) + 10
    at = mesh.points[mesh.point_sets["end"]].mean(axis=0) + np.array([0.1, 0.0, 0.0])
    ends = [10 * int(n) + 10 for n in mesh.point_sets["end"]]
    more = prop + STEEL + clamp(mesh, components)
    more += card("GRID", far, "", *(number(c) for c in at)) + card("RBE2", 900, far, 123456, *ends)
    more += f"CONM2,901,{far},,3.0\n,0.02,0.001,0.03,-0.002,0.003,0.04\n"
    content = {
        "materials": {"steel": {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}},
        "regions": {"all": region},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end", "position": at.tolist()}},
        "supports": {"start": {"nodes": "start", "components": names}},
        "masses": {"m": {"at": "end", "mass": 3.0,
                         "inertia": [0.02, 0.03, 0.04, -0.001, -0.003, 0.002]}},
    } | section  # fmt: skip
    for rule, coupled in (("full", 1), ("lumped", -1)):
        text = bulk(mesh, more).replace("COUPMASS,1", f"COUPMASS,{coupled}")
        (tmp_path / "part.bdf").write_text(text)
        facts = assemble_bulk(tmp_path / "part.bdf", tmp_path / "part.h5", [])
        assert facts["interfaces"]["rbe2_900"]["nodes"] == len(ends)
        assert any("mass is lumped" in remark for remark in facts["remarks"]) == (rule == "lumped")
        same = content | {"mass_integration": rule}
        import_description(same, "part", tmp_path / "same.h5", mesh=mesh)
        a = assembled(tmp_path / "a.h5", tmp_path / "part.h5", ranks)
        b = assembled(tmp_path / "b.h5", tmp_path / "same.h5", ranks)
        same_matrices(a, b, 1e-8)


def test_losses_add_up(tmp_path: Path) -> None:
    """Nastran: K (1 + iG) + i Σ GE_k K_k; SDAMPING is named, a deck without losses has none."""
    mesh = box("hexahedron", (2, 1, 1))
    tip = [parse("node", f"tip=NODES:{10 * len(mesh.points)}")]

    def made(steel: str, more: str = "", control: str = "") -> tuple[float, list[str]]:
        bar, out = tmp_path / "bar.bdf", tmp_path / "m.h5"
        text = bulk(mesh, "PSOLID,1,1\n" + steel + clamp(mesh, "123") + more)
        bar.write_text(text.replace("BEGIN BULK", f"{control}BEGIN BULK"))
        facts = assemble_bulk(bar, tmp_path / "bar.h5", tip)
        assembled(out, tmp_path / "bar.h5")
        with h5py.File(out) as file:
            assert "S" not in file  # of one material a loss factor is one of K
            return float(file.attrs["eta"]), facts["remarks"]

    lossy = "MAT1,1,2.1+11,,0.3,7850.,,,0.2\n"
    for steel, more, eta in (
        (lossy, "PARAM,G,0.03\n", 0.23),
        (lossy, "", 0.2),
        (STEEL, "PARAM,G,0.03\n", 0.03),
    ):
        assert made(steel, more)[0] == pytest.approx(eta, rel=1e-14)
    none, remarks = made(STEEL, control="SDAMPING=5\n")
    assert none == 0 and any("SDAMPING of case control" in remark for remark in remarks)


def same_matrices(a: dict[str, Any], b: dict[str, Any], near: float) -> None:
    """Whatever the order of their rows on several ranks."""
    first, other = (np.lexsort((of["component"], of["node"])) for of in (a, b))
    for name in "KM":
        theirs = b[name].toarray()[np.ix_(other, other)]
        found = a[name].toarray()[np.ix_(first, first)]
        np.testing.assert_allclose(found, theirs, atol=near * abs(theirs).max(), rtol=0)


def test_beams(tmp_path: Path) -> None:
    """A cantilever of CBAR whose plane 1 is that of v: two bending frequencies, of I1 along v."""
    mesh = line(20, 0.0, 1.0)
    v = [0.0, 0.6, 0.8]
    prop = "PBAR,1,1,6.0-4,4.5-8,2.0-8,5.0-8\n"
    text = bulk(mesh, prop + STEEL + clamp(mesh, "123456"), {"line": v})
    (tmp_path / "bar.bdf").write_text(text)
    facts = assemble_bulk(
        tmp_path / "bar.bdf", tmp_path / "bar.h5", [parse("node", "tip=NODES:210")]
    )
    assert facts["kinds"] == ["line"]
    a = assembled(tmp_path / "m.h5", tmp_path / "bar.h5")
    mass, X = sl.eigh(a["M"].toarray(), a["K"].toarray())  # torsion has none
    squares, X = 1 / mass[:-3:-1], X[:, ::-1]
    for number_, I, along in ((0, 2.0e-8, [0, -0.8, 0.6]), (1, 4.5e-8, v)):  # noqa: E741
        exact = 1.8751041**2 * np.sqrt(2.1e11 * I / (7850 * 6e-4))
        assert np.sqrt(squares[number_]) == pytest.approx(exact, rel=1e-5)
        tip = [X[(a["node"] == 20) & (a["component"] == c), number_][0] for c in range(3)]
        assert abs(np.dot(tip, along)) == pytest.approx(np.linalg.norm(tip), rel=1e-6)


def test_a_mean_along_a_line(tmp_path: Path) -> None:
    """A RBE3 of a grid that is held in what it does not move: a force is shared by the weights.
    Grids on a line tell nothing of its turning about that."""
    mesh = sheet("quad", (2, 2), flat(1.0, 1.0))
    edge = [10 * int(n) + 10 for n in np.flatnonzero(mesh.points[:, 0] > 0.99)]
    text = bulk(mesh, "PSHELL,1,1,0.02,1,,1\n" + STEEL + clamp(mesh, "123456"))
    mean = "GRID,900,,1.,.5,0.,,23456\n" + card("RBE3", 51, "", 900, 1, "1.0", 12, *edge)
    (tmp_path / "m.bdf").write_text(text.replace("ENDDATA", mean + "ENDDATA"))
    assemble_bulk(tmp_path / "m.bdf", tmp_path / "m.h5", [])
    a = assembled(tmp_path / "a.h5", tmp_path / "m.h5")
    assert a["names"] == ["rbe3_51.fx"]
    nodes = [label // 10 - 1 for label in edge]
    there = np.isin(a["node"], nodes) & (a["component"] == 0)
    np.testing.assert_allclose(a["B"][there, 0], 1 / 3, rtol=1e-12)
    assert np.abs(a["B"][~there]).max() < 1e-12
    turning = mean.replace("900,1,1.0", "900,4,1.0").replace("23456", "12356")
    (tmp_path / "m.bdf").write_text(text.replace("ENDDATA", turning + "ENDDATA"))
    with pytest.raises(BodyError, match="its grids tell nothing of rx: they lie on a line"):
        assemble_bulk(tmp_path / "m.bdf", tmp_path / "m.h5", [])
    held = mean.replace("23456", "123456")
    (tmp_path / "m.bdf").write_text(text.replace("ENDDATA", held + "ENDDATA"))
    with pytest.raises(BodyError, match="RBE3 51: its grid 900 is held"):
        assemble_bulk(tmp_path / "m.bdf", tmp_path / "m.h5", [])


#: Of MSC's swept wing of 15 degrees (PT145), printed by Nastran [Hz].
WING = (39.96147, 236.4137, 250.4423, 701.4011, 703.4198, 1153.105, 1375.426)


def test_coupled_mass_of_bars_is_that_of_nastran(tmp_path: Path) -> None:
    """A swept bar that bends in one plane alone, with I2 = 0, and twists with inertias at its
    grids: its sections themselves have no rotary inertia. The digits are Nastran's."""
    text = "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nPARAM,COUPMASS,1\n"
    text += "CORD2R,1,,0.,0.,0.,0.,0.,1.\n,.96593,-.25882,0.\nSPC1,1,345,1\n"
    text += "PBAR,1,1,7.175-2,9.83-6,,36.8-6\nMAT1,1,10.4+6,3.9+6,,2.61-4\n"
    for k in range(11):
        text += f"GRID,{k + 1},1,0.,{0.572 * k:.3f},0.,1,126\n"
        if k:
            text += f"CBAR,{k},1,{k},{k + 1},0.,0.,1.\n"
            text += f"CMASS2,{20 + k},{'2.8-6' if k < 10 else '1.4-6'},{k + 1},5\n"
    (tmp_path / "w.bdf").write_text(text + "ENDDATA\n")
    assemble_bulk(tmp_path / "w.bdf", tmp_path / "w.h5", [parse("node", "tip=NODES:11")])
    a = assembled(tmp_path / "m.h5", tmp_path / "w.h5")
    mass = sl.eigh(a["M"].toarray(), a["K"].toarray(), eigvals_only=True)
    hertz = 1 / np.sqrt(mass[:-8:-1]) / (2 * np.pi)
    np.testing.assert_allclose(hertz, WING, rtol=2e-6)
    (tmp_path / "w.bdf").write_text(text.replace("9.83-6", "-9.83-6") + "ENDDATA\n")
    with pytest.raises(BodyError, match="A must be positive, I1, I2 and J zero or more"):
        assemble_bulk(tmp_path / "w.bdf", tmp_path / "w.h5", [parse("node", "tip=NODES:11")])


def test_coordinate_systems_and_springs(tmp_path: Path) -> None:
    """Grids in a cylinder's coordinates; rods, CELAS2, CBUSH and mass by WTMASS against a
    description."""
    angles = np.radians([0, 90, 180])
    text = "BEGIN BULK\nPARAM,COUPMASS,1\n"
    text += "CORD2C,5,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nPARAM,WTMASS,0.5\n"
    for k, angle in enumerate(angles):
        text += card("GRID", k + 1, 5, 2.0, number(np.degrees(angle)), 0.5)
    text += "GRID,4,,0.,0.,0.\nGRID,5,,2.,0.,0.5\nGRID,6,,0.,0.,0.5\n"
    text += "CTRIA3,1,1,1,2,3\nPSHELL,1,1,0.02,1,,1,,15.7\nMAT1,1,2.+11,,0.25,8000.\n"
    text += "CROD,2,2,2,4\nPROD,2,3,0.001\nMAT1,3,1.+11,,0.3,4000.\n"
    text += "CELAS2,3,1000.,3,2\nCBUSH,4,4,1,5,,,,0\nPBUSH,4,K,1.+5,2.+5,3.+5,40.,50.,60.\n"
    text += "CONM2,9,5,,2.0\nRBE3,7,,6,123,1.0,123,1,2\n,3\nENDDATA\n"
    (tmp_path / "s.bdf").write_text(text)
    assemble_bulk(tmp_path / "s.bdf", tmp_path / "s.h5", [])  # its grid 5 has a CBUSH alone
    with h5py.File(tmp_path / "s.h5") as file:
        assert file["mesh/alone/connectivity"][:].tolist() == [[4]]
    text = text.replace("CROD,2,2,2,4", "CROD,2,2,2,3").replace("CBUSH,4,4,1,5", "CBUSH,4,4,1")
    (tmp_path / "s.bdf").write_text(text.replace("CONM2,9,5", "CONM2,9,1"))
    facts = assemble_bulk(tmp_path / "s.bdf", tmp_path / "s.h5", [])
    assert facts["interfaces"]["rbe3_7"]["coupling"] == "distributing"
    points = np.array([[2, 0, 0.5], [0, 2, 0.5], [-2, 0, (0.5).real]])
    content = {
        "materials": {"m": {"E": 2e11, "nu": 0.25, "rho": 0.5 * (8000 + 15.7 / 0.02)},
                      "r": {"E": 1e11, "nu": 0.3, "rho": 2000.0}},
        "sections": {"s": {"shape": "shell", "thickness": 0.02}, "r": {"shape": "rod", "A": 1e-3}},
        "regions": {"sheet": {"material": "m", "section": "s"},
                    "rod": {"material": "r", "section": "r"}},
        "interfaces": {"mean": {"coupling": "distributing", "nodes": [1, 2, 3],
                                "position": [0, 0, 0.5]}},
        "masses": {"b": {"nodes": [1], "mass": 1.0}},
        "springs": {
            "c": {"nodes": [3], "stiffness": [0, 1000.0, 0]},
            "bush": {"nodes": [1], "stiffness": [1e5, 2e5, 3e5, 40.0, 50.0, 60.0]},
        },
    }  # fmt: skip
    mesh = meshio.Mesh(
        points,
        [("triangle", np.array([[0, 1, 2]])), ("line", np.array([[1, 2]]))],
        cell_sets={"sheet": [[0], []], "rod": [[], [0]]},
    )
    import_description(content, "s", tmp_path / "same.h5", mesh=mesh)
    a = assembled(tmp_path / "a.h5", tmp_path / "s.h5")
    b = assembled(tmp_path / "b.h5", tmp_path / "same.h5")
    same_matrices(a, b, 1e-9)
    np.testing.assert_allclose(a["B"], b["B"], atol=1e-12)
    # A rod has E and G: what its NU says is not asked.
    text = text.replace("CONM2,9,5", "CONM2,9,1").replace("1.+11,,0.3,", "1.+11,1.+9,49.,")
    (tmp_path / "s.bdf").write_text(text)
    assemble_bulk(tmp_path / "s.bdf", tmp_path / "s.h5", [])
    same_matrices(assembled(tmp_path / "a.h5", tmp_path / "s.h5"), b, 1e-9)


FIBRES = {"E1": 1.4e11, "E2": 1e10, "E3": 1e10, "nu12": 0.3, "nu13": 0.0, "nu23": 0.0,
          "G12": 5e9, "G13": 4e9, "G23": 3e9, "rho": 1600.0}  # fmt: skip
MAT8 = "MAT8,1,1.4+11,1.+10,0.3,5.+9,4.+9,3.+9,1600.\n"


@pytest.mark.parametrize("kind", ["quad", "triangle"])
@pytest.mark.parametrize("way", ["THETA", "MCID", "plies"])
def test_fibres(kind: str, way: str, tmp_path: Path) -> None:
    """Each element begins at another of its corners; fibres lie along one direction."""
    surface = (lambda u, v: (u + 0.1 * v * u, 0.8 * v, 0.2 * u * v)) if way == "MCID" else (
        lambda u, v: (u + 0.1 * v * u, 0.8 * v, 0.0))  # fmt: skip
    mesh = sheet(kind, (3, 2), surface)
    d = np.array([0.8, 0.6, 0.0])
    nodes = mesh.cells[0].data
    nodes[:] = [np.roll(row, k % len(row)) for k, row in enumerate(nodes)]
    text = bulk(mesh, "", {}).replace("ENDDATA\n", "")
    rows = []
    for line_ in text.splitlines():
        if line_.startswith(CARDS[kind]):
            first, second = (mesh.points[int(n) // 10 - 1] for n in line_.split(",")[3:5])
            side = second - first
            angle = np.degrees(np.arctan2(d[1], d[0]) - np.arctan2(side[1], side[0]))
            line_ += ",7" if way == "MCID" else f",{angle:.4f}"
        rows.append(line_)
    text = "\n".join(rows) + "\n" + clamp(mesh, "123456") + MAT8
    text += "CORD2R,7,,0.,0.,0.,0.,0.,1.\n,0.8,0.6,0.\n"
    last = len(mesh.points)
    if way == "plies":
        text += "PCOMP,1,,,,,,,\n,1,0.002,30.,,1,0.003,-45.\n"
        layers = [{"material": "m", "thickness": t, "angle": a} for t, a in
                  ((0.002, 30), (0.003, -45))]  # fmt: skip
        section: dict[str, Any] = {"layers": layers}
    else:
        text += "PSHELL,1,1,0.005,1,,1\n"
        section = {"thickness": 0.005}
    (tmp_path / "p.bdf").write_text(text + "ENDDATA\n")
    tip = [parse("node", f"tip=NODES:{10 * last}")]
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", tip)
    content = {
        "materials": {"m": FIBRES},
        "sections": {"s": {"shape": "shell", "axis_1": d.tolist()} | section},
        "regions": {"all": {"section": "s"} | ({} if way == "plies" else {"material": "m"})},
        "interfaces": {"tip": {"coupling": "node", "nodes": [last]}},
        "supports": {"start": {"nodes": "start",
                               "components": ["x", "y", "z", "rx", "ry", "rz"]}},
    }  # fmt: skip
    import_description(content, "p", tmp_path / "same.h5", mesh=mesh)
    a = assembled(tmp_path / "a.h5", tmp_path / "p.h5")
    b = assembled(tmp_path / "b.h5", tmp_path / "same.h5")
    same_matrices(a, b, 1e-5)
    if way == "plies":  # with numbers that are of all laminates
        text = text.replace("PCOMP,1", "PCOMPG,1")
        text = text.replace(",1,0.002,30.,,1,0.003,-45.", ",11,1,0.002,30.\n,12,1,0.003,-45.")
        (tmp_path / "p.bdf").write_text(text + "ENDDATA\n")
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", tip)
        same_matrices(assembled(tmp_path / "a.h5", tmp_path / "p.h5"), b, 1e-5)
    content["sections"]["s"]["axis_1"] = [0.6, 0.8, 0.0]
    import_description(content, "p", tmp_path / "other.h5", mesh=mesh)
    with pytest.raises(AssertionError):
        same_matrices(a, assembled(tmp_path / "c.h5", tmp_path / "other.h5"), 1e-3)


def test_tubes(tmp_path: Path) -> None:
    """A tube on a sheet, whose nodes turn: as a CONROD of its area and torsion constant."""
    A, J = np.pi / 4 * (0.02**2 - 0.016**2), np.pi / 32 * (0.02**4 - 0.016**4)
    for name, cards in (
        ("tube", "CTUBE,93,7,50,90\nPTUBE,7,1,0.02,0.002,1.5\n"),
        ("rod", card("CONROD", 93, 50, 90, 1, float(A), float(J), 0.0, 1.5)),
    ):
        (tmp_path / f"{name}.bdf").write_text(plate(cards))
        tip = [parse("node", "tip=NODES:90")]
        assemble_bulk(tmp_path / f"{name}.bdf", tmp_path / f"{name}.h5", tip)
    a = assembled(tmp_path / "a.h5", tmp_path / "tube.h5")
    b = assembled(tmp_path / "b.h5", tmp_path / "rod.h5")
    same_matrices(a, b, 1e-9)
    (tmp_path / "none.bdf").write_text(plate())
    assemble_bulk(tmp_path / "none.bdf", tmp_path / "none.h5", [parse("node", "tip=NODES:90")])
    none = assembled(tmp_path / "n.h5", tmp_path / "none.h5")
    K = (a["K"] - none["K"]).toarray()
    assert np.abs(K).max() > 1e-4 * abs(none["K"]).max()  # what is compared is there


def test_inertia_in_axes_of_its_own(tmp_path: Path) -> None:
    """Principal moments about axes that are turned by 30° about z."""
    c, s = np.sqrt(0.75), 0.5
    axes = f"CORD2R,7,,1.,1.,0.,1.,1.,1.\n,{number(1 + c)},1.5,0.\n"
    (tmp_path / "p.bdf").write_text(plate(axes, "CONM2,91,50,7,2.0\n,0.03,,0.01,,,0.02\n"))
    assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])
    with h5py.File(tmp_path / "p.h5") as file:
        found = file["masses/conm91"].attrs["inertia"]
    xx, yy, xy = 0.03 * c**2 + 0.01 * s**2, 0.03 * s**2 + 0.01 * c**2, 0.02 * s * c
    np.testing.assert_allclose(found, [xx, yy, 0.02, xy, 0.0, 0.0], atol=1e-7)
    text = plate(axes.replace("2R", "2C"), "CONM2,91,50,7,2.0\n,0.03,,0.01,,,0.02\n")
    (tmp_path / "p.bdf").write_text(text)
    with pytest.raises(BodyError, match="cylindrical"):
        assemble_bulk(tmp_path / "p.bdf", tmp_path / "p.h5", [parse("node", "tip=NODES:90")])


def plate(*extra: str, prop: str = "PSHELL,1,1,0.01,1,,1\n", material: str = STEEL) -> str:
    mesh = sheet("quad", (2, 2), flat(1, 1))
    return bulk(mesh, prop + material + clamp(mesh, "123456") + "".join(extra))


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_truss(ranks: int, tmp_path: Path) -> None:
    """Three rods on a grid that nothing else holds: matrices in closed form, tension stiffens."""
    ends = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 1.5]])
    text = "BEGIN BULK\nPARAM,COUPMASS,1\nGRID,9,,0.,0.,0.\n" + "".join(
        card("GRID", k + 1, "", *map(float, x)) + card("CONROD", k + 1, k + 1, 9, 1, 2e-4)
        for k, x in enumerate(ends)
    )
    text += STEEL + "SPC1,1,123,1,2,3\nENDDATA\n"
    (tmp_path / "t.bdf").write_text(text)
    pull = {"pull": {"type": "nodal", "table": [[9, -3e4, 0.0, 0.0]]}}
    found = {}
    for preload in (None, {"pull.load": 1.0}):
        assemble_bulk(
            tmp_path / "t.bdf", tmp_path / "t.h5", [parse("node", "tip=NODES:9")],
            loads={"pull": {**pull["pull"], "table": [[4, -3e4, 0.0, 0.0]]}}, preload=preload,
        )  # fmt: skip
        found[preload is None] = assembled(tmp_path / "m.h5", tmp_path / "t.h5", ranks)
    a = found[True]
    lengths = np.linalg.norm(ends, axis=1)
    np.testing.assert_allclose(a["K"].toarray(), np.diag(2.1e11 * 2e-4 / lengths), rtol=1e-12)
    mass = 7850 * 2e-4 * lengths.sum() / 3
    np.testing.assert_allclose(a["M"].toarray(), mass * np.eye(3), atol=1e-12)
    added = (found[False]["K"] - a["K"]).toarray()
    np.testing.assert_allclose(added, np.diag([0, 3e4, 3e4]), atol=1e-6)


@pytest.mark.parametrize(
    ("prop", "I1", "I2", "J", "A"),
    [
        ("PBARL,1,1,,BAR\n,0.02,0.03\n", 0.02 * 0.03**3 / 12, 0.03 * 0.02**3 / 12, 4.697e-8, 6e-4),
        ("PBARL,1,1,,ROD\n,0.01\n", np.pi / 4 * 1e-8, np.pi / 4 * 1e-8, np.pi / 2 * 1e-8, None),
        ("PBEAML,1,1,,BOX\n,0.1,0.2,0.01,0.01\n", None, None, 2.0904e-5, 0.0056),
        ("PBARL,1,1,,I\n,0.1,0.06,0.06,0.005,0.008,0.008\n", None, None, 2.398e-8, 0.00138),
    ],
    ids=["bar", "rod", "box", "I"],
)
def test_shapes_of_beams(prop: str, I1: Any, I2: Any, J: float, A: Any, tmp_path: Path) -> None:
    """Areas and moments in closed form; of the box by Bredt, of the I by thin walls."""
    mesh = line(2, 0.0, 1.0)
    text = bulk(mesh, prop + STEEL + clamp(mesh, "123456"), {"line": [0.0, 1.0, 0.0]})
    (tmp_path / "b.bdf").write_text(text)
    assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", [parse("node", "tip=NODES:30")])
    with h5py.File(tmp_path / "b.h5") as file:
        of = dict(next(iter(file["sections"].values())).attrs)
    if I1 is None and "BOX" in prop:
        I1 = (0.1 * 0.2**3 - 0.08 * 0.18**3) / 12
        I2 = (0.2 * 0.1**3 - 0.18 * 0.08**3) / 12
    elif I1 is None:
        I1 = 0.005 * 0.084**3 / 12 + 2 * (0.06 * 0.008**3 / 12 + 0.06 * 0.008 * 0.046**2)
        I2 = 0.084 * 0.005**3 / 12 + 2 * 0.008 * 0.06**3 / 12
    assert of["I_z"] == pytest.approx(I1, rel=1e-9) and of["I_y"] == pytest.approx(I2, rel=1e-9)
    assert of["J"] == pytest.approx(J, rel=1e-3)
    assert A is None or of["A"] == pytest.approx(A)
