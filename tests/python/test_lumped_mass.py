"""Mass at the nodes alone (``mass_integration: lumped``): shares of nodes by hand, forces of spin
on point masses, frequencies that Nastran prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as sl
from scipy.sparse.linalg import eigsh

from bodies import box
from conftest import assembled, read_sparse, run
from flexgram import ReducedModel
from flexgram.basics import BodyError
from flexgram.body.description import import_description
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk
from flexgram.measured.mode_shapes import mode_shapes

RHO = 7800.0
STEEL = {"steel": {"E": 2.1e11, "nu": 0.3, "rho": RHO}}
#: Of one element: its points, and the share of each node of its mass.
ELEMENTS: dict[str, tuple[Any, Any]] = {
    "tetra": (np.eye(4, 3, -1), [1 / 4] * 4),
    "triangle": ([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [1 / 3] * 3),
    "quad": ([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], [1 / 4] * 4),
    "line": ([[0, 0, 0], [2, 0, 0]], [1 / 2] * 2),
}
SECTIONS: dict[str, dict[str, Any]] = {
    "shell": {"shape": "shell", "thickness": 0.1},
    "bar": {"shape": "rectangle", "width": 0.1, "height": 0.3},
    "rod": {"shape": "rod", "A": 0.03},
}


def described(kind: str, section: str = "", **more: Any) -> dict[str, Any]:
    section = section or {"triangle": "shell", "quad": "shell", "line": "bar"}.get(kind, "")
    used = {"sections": {section: SECTIONS[section]}} if section else {}
    region = {"material": "steel"} | ({"section": section} if section else {})
    content = {"materials": STEEL, "regions": {"all": region}, "mass_integration": "lumped"}
    return content | used | {"interfaces": {"a": {"nodes": [1], "coupling": "node"}}} | more


def body(folder: Path, content: dict[str, Any], mesh: meshio.Mesh, ranks: int = 1) -> Any:
    import_description(content, "one", folder / "body.h5", mesh=mesh)
    return assembled(folder / "matrices.h5", folder / "body.h5", ranks)


def one(kind: str) -> meshio.Mesh:
    points = np.asarray(ELEMENTS[kind][0], dtype=float)
    return meshio.Mesh(points, [(kind, [list(range(len(points)))])])


def of_components(a: dict[str, Any], matrix: Any) -> Any:
    """A matrix with rows and columns by node, then by component."""
    order = np.lexsort((a["component"], a["node"]))
    return matrix.toarray()[np.ix_(order, order)]


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ELEMENTS)
def test_shares_of_nodes(kind: str, ranks: int, tmp_path: Path) -> None:
    a = body(tmp_path, described(kind), one(kind), ranks)
    shares = np.asarray(ELEMENTS[kind][1])
    volume = {"tetra": 1 / 6, "triangle": 0.1, "quad": 0.2, "line": 0.06}[kind]
    expected = np.zeros((len(shares), 3 if kind == "tetra" else 6))
    expected[:, :3] = RHO * volume * shares[:, None]
    if kind == "line":  # the inertia of turning about it
        expected[:, 3] = RHO * volume / 2 * (0.1**2 + 0.3**2) / 12
    found = of_components(a, a["M"])
    np.testing.assert_allclose(found, np.diag(expected.ravel()), rtol=1e-12, atol=1e-12 * RHO)


def test_shares_of_elements_of_second_order(tmp_path: Path) -> None:
    """A tetrahedron's corners have 1/36 each, its edges 4/27 (Hinton, Rock and Zienkiewicz 1976);
    the masses of others are the diagonal of their consistent mass, in proportion."""
    mesh = box("tetra10", (1, 1, 1), distort=False)
    mesh = meshio.Mesh(mesh.points, [("tetra10", mesh.cells[0].data[:1])])
    used = np.unique(mesh.cells[0].data)
    mesh = meshio.Mesh(mesh.points[used], [("tetra10", np.searchsorted(used, mesh.cells[0].data))])
    a = body(tmp_path, described("tetra10"), mesh)
    masses = of_components(a, a["M"]).diagonal()[::3]
    corners = np.isin(np.arange(10), mesh.cells[0].data[0, :4])
    shares = np.where(corners, 1 / 36, 4 / 27)
    np.testing.assert_allclose(masses / masses.sum(), shares, rtol=1e-12)
    for kind in ("hexahedron", "hexahedron20", "wedge15"):
        mesh = box(kind, (1, 1, 1))
        lumped = body(tmp_path, described(kind), mesh)["M"]
        full = body(tmp_path, described(kind) | {"mass_integration": "full"}, mesh)["M"]
        assert abs(lumped - np.diag(lumped.diagonal())).max() == 0 and lumped.diagonal().min() > 0
        assert lumped.diagonal().sum() == pytest.approx(full.sum(), rel=1e-12)


@pytest.mark.parametrize("kind", ["quad", "line"])
def test_spin(kind: str, tmp_path: Path) -> None:
    """An element without mass and masses at its nodes have the same matrices, at every speed, but
    for a beam's inertia of turning about itself."""
    mesh, clamped = one(kind), "x y z rx ry rz".split()
    last = len(mesh.points)
    more = {
        "supports": {"s": {"nodes": list(range(1, last)), "components": clamped}},
        "interfaces": {"b": {"nodes": [last], "coupling": "node"}},
        "spin": {"axis": [0.0, 0.6, 0.8], "from": 0.0, "to": 7.0},
    }
    share = RHO * {"quad": 0.05, "line": 0.03}[kind]
    points = {"nodes": list(range(1, last + 1)), "mass": share}
    light = {"steel": STEEL["steel"] | {"rho": 0.0}}
    found = []
    for content in ({}, {"materials": light, "masses": {"m": points}}):
        a = body(tmp_path, described(kind) | more | content, mesh)
        with h5py.File(tmp_path / "matrices.h5") as file:
            terms = [read_sparse(file, f"terms/{name}") for name in ("spin", "coriolis")]
        found.append([of_components(a, x) for x in (a["M"], a["K"], *terms)])
    if kind == "line":
        found[0][0][3, 3] -= share * (0.1**2 + 0.3**2) / 12
    for one_way, other in zip(*found, strict=True):
        assert abs(one_way).max() > 0
        np.testing.assert_allclose(one_way, other, rtol=1e-9, atol=1e-9 * abs(one_way).max())


def test_a_shell_beside_its_nodes(tmp_path: Path) -> None:
    """Its mass is where its middle surface is: a turn of the nodes moves it."""
    SHELL = {"shape": "shell", "thickness": 0.1, "offset": 0.3}
    a = body(tmp_path, described("quad") | {"sections": {"shell": SHELL}}, one("quad"))
    at, total = np.array([0.5, 1.0, 0.3]), RHO * 0.2
    M = of_components(a, a["M"])
    points = np.asarray(ELEMENTS["quad"][0], dtype=float)
    rigid = np.zeros((len(M), 6))
    for k, x in enumerate(points):
        for c in range(3):
            rigid[6 * k + c, c] = 1
            rigid[6 * k + 3 + c, 3 + c] = 1
            rigid[6 * k : 6 * k + 3, 3 + c] = np.cross(np.eye(3)[c], x)
    of_body = rigid.T @ M @ rigid
    np.testing.assert_allclose(of_body[:3, :3], total * np.eye(3), rtol=1e-12)
    coupling = total * np.array([[0, at[2], -at[1]], [-at[2], 0, at[0]], [at[1], -at[0], 0]])
    np.testing.assert_allclose(of_body[:3, 3:], coupling, atol=1e-10)


def test_it_converges_to_the_consistent_one(tmp_path: Path) -> None:
    """As the square of the element's size."""
    off = []
    for times in (1, 2, 4):
        squares = {}
        for rule in ("full", "lumped"):
            mesh = box("hexahedron20", (6 * times, times, times), (1.0, 0.1, 0.1), distort=False)
            content = described("hexahedron20") | {
                "mass_integration": rule,
                "supports": {"s": {"nodes": "start"}},
                "interfaces": {"b": {"nodes": "end", "coupling": "rigid"}},
            }
            a = body(tmp_path, content, mesh)
            squares[rule] = eigsh(a["K"], 1, a["M"], sigma=0, return_eigenvectors=False)[0]
        off.append(abs(squares["lumped"] / squares["full"] - 1))
    assert off[0] > 1e-5 and 3.5 < off[0] / off[1] < 4.5 and 3.5 < off[1] / off[2] < 4.5


#: Of pyNastran's model beam_modes, printed by Nastran: bending twice each, torsion, tension.
PRINTED = (456.6603, 456.6603, 2674.588, 2674.588, 3554.923, 4507.487, 6626.104, 6626.104)


def test_frequencies_that_nastran_prints(tmp_path: Path) -> None:
    """A clamped round bar of nine CBAR, one CBEAM and a mass with inertia: to the seven digits, but
    for torsion, which leans on a number of seven digits itself."""
    grids = "".join(f"GRID,{k + 1},,{k}.,0.,0.\n" for k in range(11))
    bars = "".join(f"CBAR,{k},1,{k},{k + 1},0.,1.,0.\n" for k in range(1, 10))
    text = (
        f"SOL 103\nCEND\nSPC = 1\nBEGIN BULK\n{grids}{bars}CBEAM,10,3,10,11,0.,1.,0.\n"
        "CONM2,21,11,,2.59-3\n,2.59-3,,2.59-3,,,2.59-3\nSPC1,1,123456,1\n"
        "MAT1,2,3.+7,1.1628+7,.29,7.4851-4\n"
        "PBARL,1,2,,ROD\n,1.\nPBEAML,3,2,,ROD\n,1.\nENDDATA\n"
    )
    (tmp_path / "b.bdf").write_text(text)
    facts = assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", [parse("node", "tip=NODES:11")])
    assert any("mass is lumped" in remark for remark in facts["remarks"])
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
    squares = np.sort(eigsh(a["K"], 8, a["M"], sigma=0, return_eigenvectors=False))
    np.testing.assert_allclose(np.sqrt(squares) / (2 * np.pi), PRINTED, rtol=5e-6)
    (tmp_path / "b.bdf").write_text(text.replace("SPC1", "PARAM,COUPMASS,1\nSPC1"))
    assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", [parse("node", "tip=NODES:11")])
    full = assembled(tmp_path / "a.h5", tmp_path / "b.h5")["M"]
    assert full.nnz > a["M"].nnz


def test_modes_of_a_body_whose_rotations_have_no_mass(tmp_path: Path) -> None:
    """Their frequencies are infinite; the others are found, and none of them is rigid."""
    body, rom = tmp_path / "b.h5", tmp_path / "r.h5"
    (tmp_path / "b.bdf").write_text(
        "SOL 103\nCEND\nSPC=1\nBEGIN BULK\nMAT1,1,2.1+11,,.3,7850.\nPBARL,1,1,,BAR\n,.01,.02\n"
        "SPC1,1,123456,1\nGRID,1,,0.,0.,0.\nGRID,2,,.1,0.,0.\nGRID,3,,.2,0.,0.\n"
        "CBAR,1,1,1,2,0.,1.,0.\nCBAR,2,1,2,3,0.,1.,0.\nENDDATA\n"
    )
    assemble_bulk(tmp_path / "b.bdf", body, [parse("node", "m=NODES:3")], alpha=5)
    run("reduce", "-body", body, "-mor_band_hz", "0,3000", "-mor_out", rom)
    a = assembled(tmp_path / "a.h5", body)
    mass, _ = sl.eigh(a["M"].toarray(), a["K"].toarray())
    expected = np.sqrt(1 / mass[mass > 1e-9 * mass.max()])[::-1] / (2 * np.pi)
    model = ReducedModel.load(rom)
    found = mode_shapes(model).hertz
    np.testing.assert_allclose(found, expected[expected <= 3000], rtol=1e-6)
    assert len(found) == 4
    np.testing.assert_allclose(model.elastic_frequencies[:4] / (2 * np.pi), found, rtol=1e-6)


@pytest.mark.parametrize(("units", "length"), [("in-lbf-s", 0.0254), ("ft-lbf-s", 0.3048)])
def test_pounds(units: str, length: float, tmp_path: Path) -> None:
    """A body in inches or feet, with pounds of force, is that in metres."""
    pound = 0.45359237 * 9.80665  # N
    stress, density = pound / length**2, pound / length**4  # mass: pound s²/length
    law = {"E": 2.1e11 / stress, "nu": 0.3, "rho": RHO / density}
    mesh = box("hexahedron", (2, 1, 1))
    plain = body(tmp_path, described("hexahedron"), mesh)
    mesh.points /= length
    content = described("hexahedron") | {"units": units, "materials": {"steel": law}}
    ours = body(tmp_path, content, mesh)
    for name in ("K", "M"):
        assert abs(ours[name] - plain[name]).max() < 1e-12 * abs(plain[name]).max()


def test_what_is_refused(tmp_path: Path) -> None:
    content = described("tetra") | {"mass_integration": "none"}
    with pytest.raises(BodyError, match=r"mass_integration .*full, reduced, lumped"):
        import_description(content, "one", tmp_path / "body.h5", mesh=one("tetra"))
