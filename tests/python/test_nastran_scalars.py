"""Elements of bulk data that act on one number made of several dofs: shear panels, springs and
masses whose ends lie apart or move in different components, scalar points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from test_nastran_cards import plate
from test_nastran_whole import PLAIN, bars, body_of

from conftest import assembled
from flexgram.basics import BodyError
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk
from flexgram.importers.nastran_scalars import panel_of

G, NU, T = 8e10, 0.3, 2e-3


def added(folder: Path, text: str, cards: str, port: str = "tip=NODES:5") -> tuple[Any, Any]:
    """What cards add to K and M, and the index of each dof by place and component."""
    plain = body_of(folder, text, port)
    more = body_of(folder, text.replace("ENDDATA", cards + "ENDDATA"), port)
    with h5py.File(folder / "a.h5") as file:
        places = np.round(file["nodes/position"][:][file["dofs/node"][:]], 6)
        component = file["dofs/component"][:]
    index = {
        (*map(float, p), int(c)): k for k, (p, c) in enumerate(zip(places, component, strict=True))
    }
    return [(more[key] - plain[key]).toarray() for key in ("K", "M")], index


def row(index: dict[Any, int], terms: list[tuple[tuple[float, float, float], int, float]]) -> Any:
    c = np.zeros(len(index))
    for place, component, factor in terms:
        c[index[(*place, component)]] = factor
    return c


def bricks(apart: int) -> str:
    """Two unit cubes of one element each, so far along x from each other."""
    lines = ["SOL 103\nCEND\nBEGIN BULK\nPARAM,COUPMASS,1\n"]
    for k in range(8):
        x, y, z = k & 1, (k >> 1) & 1, k >> 2
        lines.append(f"GRID,{k + 1},,{x}.,{y}.,{z}.\nGRID,{k + 11},,{x + apart}.,{y}.,{z}.\n")
    lines.append("CHEXA,1,1,1,2,4,3,5,6,\n,8,7\nCHEXA,2,1,11,12,14,13,15,16,\n,18,17\n")
    lines.append("PSOLID,1,1\nMAT1,1,2.1+11,,0.3,7850.\nENDDATA\n")
    return "".join(lines)


def test_springs_whose_ends_lie_apart(tmp_path: Path) -> None:
    """CELAS joins two components wherever their grids are: K = k c cᵀ, and nothing else."""
    cards = "CELAS2,90,3.+5,3,2,5,6,0.04\nCELAS2,91,2.+5,2,3,4,3\n"
    (K, _), index = added(tmp_path, bars(PLAIN), cards)
    twist = row(index, [((0.5, 0, 0), 1, 1.0), ((1.0, 0, 0), 5, -1.0)])
    lift = row(index, [((0.25, 0, 0), 2, 1.0), ((0.75, 0, 0), 2, -1.0)])
    expected = 3e5 * np.outer(twist, twist) + 2e5 * np.outer(lift, lift)
    np.testing.assert_allclose(K, expected, atol=1e-5)


def test_a_mass_between_two_grids(tmp_path: Path) -> None:
    (_, M), index = added(tmp_path, bars(PLAIN), "CMASS2,90,0.5,3,2,5,2\n")
    c = row(index, [((0.5, 0, 0), 1, 1.0), ((1.0, 0, 0), 1, -1.0)])
    np.testing.assert_allclose(M, 0.5 * np.outer(c, c), atol=1e-12)


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_absorber_of_scalar_points(ranks: int, tmp_path: Path) -> None:
    """A mass on a spring at the tip, as scalar points and as a grid that moves along y alone."""
    scalar = "SPOINT,91\nCELAS2,90,1.+5,5,2,91\nCMASS4,92,0.4,91\nCDAMP4,93,2.,91\n"
    grid = (
        "GRID,91,,1.,0.,0.\nCELAS2,90,1.+5,5,2,91,2\nCMASS2,92,0.4,91,2\nCDAMP2,93,2.,91,2\n"
        "SPC1,1,13456,91\n"
    )
    found = []
    for cards in (scalar, grid):
        a = body_of(tmp_path, bars(PLAIN).replace("ENDDATA", cards + "ENDDATA"), ranks=ranks)
        f = a["B"][:, a["names"].index("tip.fy")]
        D = a["D"] if "D" in a else 0 * a["K"]
        A = (a["K"] - 400.0**2 * a["M"] + 400j * D).toarray()
        found.append(f @ np.linalg.solve(A, f))
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_a_held_scalar_point(tmp_path: Path) -> None:
    """SPC1 holds one: the spring goes to ground."""
    cards = "SPOINT,91\nCELAS2,90,1.+5,5,2,91\nSPC1,1,0,91\n"
    (K, _), index = added(tmp_path, bars(PLAIN), cards)
    c = row(index, [((1.0, 0, 0), 1, 1.0)])
    np.testing.assert_allclose(K, 1e5 * np.outer(c, c), atol=1e-6)


def test_a_bush_between_solids(tmp_path: Path) -> None:
    """Its grids lie apart and have no rotations: it acts midway, and these count as held."""
    bush = "CBUSH,9,9,2,11,0.,1.,0.\nPBUSH,9,K,1.+5,2.+5,3.+5,40.,50.,60.\n"
    (K, _), index = added(tmp_path, bricks(3), bush, "tip=NODES:1")
    expected = 0 * K
    for c, k in enumerate((1e5, 2e5, 3e5)):
        r = row(index, [((1, 0, 0), c, 1.0), ((3, 0, 0), c, -1.0)])
        expected += k * np.outer(r, r)
    np.testing.assert_allclose(K, expected, atol=1e-4)


def panel_stiffness(x: Any) -> Any:
    forces, _, flexibility = panel_of(np.asarray(x, dtype=float), NU)
    c = forces.ravel()
    return G * T / flexibility * np.outer(c, c)


def test_a_rectangular_panel_in_shear() -> None:
    """Energy of a shear strain; none of rigid motions, of stretching and of bending."""
    a, b = 0.7, 0.4
    x = np.array([[0, 0, 0], [a, 0, 0], [a, b, 0], [0, b, 0.0]])
    K = panel_stiffness(x)
    strain = np.column_stack([x[:, 1], 0 * x[:, 1], 0 * x[:, 1]]).ravel()  # u = γ y
    assert strain @ K @ strain == pytest.approx(G * T * a * b, rel=1e-12)
    for u in (x * [1, 0, 0], x * [0, 1, 0], np.cross([0.2, -0.5, 0.7], x)):
        assert np.abs(K @ u.ravel()).max() < 1e-6


@pytest.mark.parametrize("angle", [10, 35, -25])
def test_an_oblique_panel(angle: float) -> None:
    """Garvey: a parallelogram gives way by 1 + 2 tan²α/(1 + ν) as much."""
    a, b, shift = 0.7, 0.4, 0.4 * np.tan(np.radians(angle))
    x = np.array([[0, 0, 0], [a, 0, 0], [a + shift, b, 0], [shift, b, 0.0]])
    _, area, flexibility = panel_of(x, NU)
    assert area == pytest.approx(a * b, rel=1e-12)
    expected = a * b * (1 + 2 * np.tan(np.radians(angle)) ** 2 / (1 + NU))
    assert flexibility == pytest.approx(expected, rel=1e-12)
    assert np.abs(panel_stiffness(x) @ np.cross([0.2, -0.5, 0.7], x).ravel()).max() < 1e-6


@pytest.mark.parametrize("ratio", [1.25, 2, 3])
def test_a_trapezoid(ratio: float) -> None:
    """Garvey: the flow falls with the square of the distance from the apex, so that its energy is
    an integral over the height alone."""
    x = np.array([[0, -ratio / 2, 0], [1, -0.5, 0], [1, 0.5, 0], [0, ratio / 2, 0.0]])
    near, slope = 1 / (ratio - 1), (ratio - 1) / 2  # of the apex from the short side
    far = near + 1
    flow = 4 / (1 / near**2 + 1 / far**2 + 2 / (near * far))  # mean of one along the four edges
    energy = flow**2 * slope * (1 / near**2 - 1 / far**2) * (1 + 2 / 3 * slope**2 / (1 + NU))
    assert panel_of(x, NU)[2] == pytest.approx(energy, rel=1e-9)


def test_a_panel_without_parallel_edges() -> None:
    """The flow of its energy, by the distance from the line through the points in which opposite
    edges meet, is that which the equilibrium of the edges asks for; energy by fine sums."""
    x = np.array([[0, 0], [1.0, 0.1], [1.1, 0.5], [0, 0.9]])

    def meet(a: Any, b: Any, c: Any, d: Any) -> Any:
        s = np.linalg.solve(np.column_stack([b - a, c - d]), c - a)
        return a + s[0] * (b - a)

    P, Q = meet(x[0], x[1], x[2], x[3]), meet(x[1], x[2], x[3], x[0])
    n = np.array([Q[1] - P[1], P[0] - Q[0]])
    n /= np.linalg.norm(n)
    edges = np.roll(x, -1, axis=0) - x
    s = (np.arange(20000) + 0.5) / 20000
    means = np.array([np.mean(((p + np.outer(s, e) - P) @ n) ** -2.0)
                      for p, e in zip(x, edges, strict=True)])  # fmt: skip
    signs = np.array([-1, 1, -1, 1.0])
    forces = (signs * means)[:, None] * edges
    assert np.abs(forces.sum(axis=0)).max() < 1e-6 * np.abs(forces).max()
    turns = np.cross(x, forces)
    assert abs(turns.sum()) < 1e-6 * np.abs(turns).max()
    centres = (np.arange(400) + 0.5) / 200 - 1
    a, b = np.meshgrid(centres, centres)
    N = [(1 - a) * (1 - b) / 4, (1 + a) * (1 - b) / 4, (1 + a) * (1 + b) / 4, (1 - a) * (1 + b) / 4]
    y = np.einsum("kij,kc->ijc", np.array(N), x)
    u = np.einsum("kij,kc->ijc", np.array([b - 1, 1 - b, 1 + b, -1 - b]) / 4, x)
    v = np.einsum("kij,kc->ijc", np.array([a - 1, -1 - a, 1 + a, 1 - a]) / 4, x)
    cell = np.cross(u, v) * (2 / len(a)) ** 2
    to_P, to_Q = P - y, Q - y
    tangent = np.sum(to_P * to_Q, axis=2) / np.cross(to_P, to_Q)
    flow = ((y - P) @ n) ** -2.0 / means.mean()
    energy = np.sum(cell * flow**2 * (1 + 2 * tangent**2 / (1 + NU)))
    assert panel_of(np.column_stack([x, np.zeros(4)]), NU)[2] == pytest.approx(energy, rel=1e-4)


def test_a_tapered_and_a_warped_panel_are_in_equilibrium() -> None:
    tapered = np.array([[0, 0, 0], [1.0, 0.1, 0], [1.1, 0.5, 0], [0, 0.9, 0]])
    warped = tapered + np.array([[0, 0, 0.05], [0, 0, 0], [0, 0, 0.05], [0, 0, 0]])
    for x in (tapered, warped):
        forces, *_ = panel_of(x, NU)
        assert np.abs(forces.sum(axis=0)).max() < 1e-12
        assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-12
    along = panel_of(tapered, NU)[0][0]  # between its two edges
    edges = (tapered[1] - tapered[0], tapered[3] - tapered[0])
    assert abs(np.dot(along, np.cross(*edges))) < 1e-12


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_box_of_panels_in_torsion(ranks: int, tmp_path: Path) -> None:
    """Bredt: a box of shear panels and rods twists by T L ∮ds/t / (4 A² G)."""
    b, h, bays, length = 0.4, 0.25, 3, 1.5
    lines = ["SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nMAT1,1,,8.+10,0.3,7850.\n"]
    corner = [(0.0, 0.0), (b, 0.0), (b, h), (0.0, h)]
    for s in range(bays + 1):
        for k, (y, z) in enumerate(corner):
            lines.append(f"GRID,{10 * s + k + 1},,{s * length / bays:.6f},{y},{z}\n")
    number = 0
    for s in range(bays):
        for k in range(4):
            p, q = 10 * s + k + 1, 10 * s + (k + 1) % 4 + 1
            number += 2
            lines.append(f"CSHEAR,{number},1,{p},{q},{q + 10},{p + 10}\n")
            lines.append(f"CONROD,{number + 1},{p},{p + 10},1,2.-4\n")
    for s in range(bays + 1):
        number += 1
        lines.append(
            f"CSHEAR,{500 + number},2,{10 * s + 1},{10 * s + 2},{10 * s + 3},{10 * s + 4}\n"
        )
        for k in range(4):
            number += 1
            lines.append(
                f"CONROD,{500 + number},{10 * s + k + 1},{10 * s + (k + 1) % 4 + 1},1,2.-4\n"
            )
    lines.append("PSHEAR,1,1,2.-3\nPSHEAR,2,1,50.\nSPC1,1,23,1,THRU,4\nSPC1,1,1,1,2,4\nENDDATA\n")
    (tmp_path / "b.bdf").write_text("".join(lines))
    ports = [parse("node", f"n{k}=NODES:{10 * bays + k + 1}") for k in range(4)]
    assemble_bulk(tmp_path / "b.bdf", tmp_path / "b.h5", ports)
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5", ranks)
    y, z = np.array(corner).T
    f = np.zeros(a["B"].shape[0])  # a couple on all four corners: 1 N m
    for k in range(4):
        f += a["B"][:, a["names"].index(f"n{k}.fy")] * -(z[k] - h / 2)
        f += a["B"][:, a["names"].index(f"n{k}.fz")] * (y[k] - b / 2)
    f /= np.sum((y - b / 2) ** 2 + (z - h / 2) ** 2)
    twist = f @ np.linalg.solve(a["K"].toarray(), f)
    bredt = length * (2 * (b + h) / T) / (4 * (b * h) ** 2 * G)
    assert twist == pytest.approx(bredt, rel=2e-4)  # ribs of 50 m and rods give way a little
    panels = 2e-3 * 2 * (b + h) * length + 50 * (bays + 1) * b * h
    rods = 2e-4 * (4 * length + (bays + 1) * 2 * (b + h))
    with h5py.File(tmp_path / "a.h5") as file:
        along = (file["dofs/component"][:] == 1).astype(float)
    whole, root = along @ a["M"] @ along, 7850 * (  # what the four held grids have is no dof
        panels - 2e-3 * (b + h) * length / bays - 50 * b * h
        + rods - 2e-4 * (2 * length / bays + 2 * (b + h)))  # fmt: skip
    assert whole == pytest.approx(root, rel=1e-9)


def test_a_free_box_is_free(tmp_path: Path) -> None:
    """The node of a panel's number is no support."""
    text = plate("CSHEAR,99,9,10,20,50,40\nPSHEAR,9,1,1.-3\n")
    facts = body_of(tmp_path, text, "tip=NODES:90")["facts"]
    said = [line for line in facts["summary"] if "rigid motions" in line]
    plain = body_of(tmp_path, plate(""), "tip=NODES:90")["facts"]
    assert said == [line for line in plain["summary"] if "rigid motions" in line]


def test_a_panel_that_is_not_convex_is_named(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match="CSHEAR 99: it is not convex"):
        body_of(tmp_path, plate("CSHEAR,99,9,10,20,80,50\nPSHEAR,9,1,1.-3\n"), "tip=NODES:90")


def test_a_mass_on_a_mean(tmp_path: Path) -> None:
    """RBE3 with a CONM2 at its grid: the mass moves with the mean of the others, which the
    interface is, too."""
    cards = "GRID,9,,0.5,0.2,0.\nRBE3,901,,9,123456,1.,123,1,2\n,3,4,5\nCONM2,92,9,,0.4\n"
    wide = "".join(f"GRID,1{k},,{k}.,0.2,0.\nCBAR,4{k},1,{k + 1},1{k},0.,0.,1.\n" for k in range(2))
    text = bars(PLAIN).replace("ENDDATA", wide + cards.replace("3,4,5", "3,5,10,11") + "ENDDATA")
    a = body_of(tmp_path, text)
    assert a["facts"]["interfaces"]["rbe3_901"]["coupling"] == "node"
    plain = body_of(tmp_path, text.replace("CONM2,92,9,,0.4\n", ""))
    assert plain["facts"]["interfaces"]["rbe3_901"]["coupling"] == "distributing"
    B = plain["B"][:, [plain["names"].index(f"rbe3_901.f{c}") for c in "xyz"]]
    np.testing.assert_allclose((a["M"] - plain["M"]).toarray(), 0.4 * B @ B.T, atol=1e-12)


def test_loss_factors_of_a_bush(tmp_path: Path) -> None:
    """GE1 alone is that of all directions; others each count for their own."""
    bush = "GRID,9,,1.,0.,0.\nCBUSH,9,9,5,9,,,,0\nSPC1,1,123456,9\nPBUSH,9,K,1.+5,2.+5,3.+5"
    for given, expected in ((",GE,0.1", [0.1] * 3), (",GE,0.1,0.2,0.3", [0.1, 0.2, 0.3])):
        text = bars(PLAIN).replace("ENDDATA", f"{bush}\n,{given}\nENDDATA")
        body_of(tmp_path, text)
        with h5py.File(tmp_path / "b.h5") as file:
            springs = [spring.attrs for spring in file["springs"].values()]
            S = sum(of["loss_factor"] * np.reshape(of["stiffness"], (6, 6)) for of in springs)
        np.testing.assert_allclose(np.diag(S)[:3], np.array(expected) * [1e5, 2e5, 3e5])


def test_scalars_at_the_grid_of_a_rigid_element(tmp_path: Path) -> None:
    """An absorber there, and masses of every kind on a grid that it moves."""
    rigid = "GRID,500,,1.,0.1,0.\nRBE2,95,500,123456,5\n"
    scalar = "SPOINT,91\nCELAS2,90,1.+5,{grid},2,91\nCMASS4,92,0.4,91\n"
    found: list[Any] = []
    for cards in (rigid + scalar.format(grid=500), scalar.format(grid=5)):
        text = bars(PLAIN).replace("ENDDATA", cards + "ENDDATA")
        a = body_of(tmp_path, text, "tip=NODES:4")
        f = a["B"][:, a["names"].index("tip.fy")]
        found.append(f @ np.linalg.solve((a["K"] - 400.0**2 * a["M"]).toarray(), f))
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    moved = "GRID,501,,1.1,0.1,0.\nRBE2,96,5,123456,501\n"
    found = []
    for mass in ("CONM2,77,501,,5.\n", "CONM1,77,501,0,5.,,5.,,\n,5.\n", ""):
        text = bars(PLAIN).replace("ENDDATA", moved + mass + "ENDDATA")
        found.append(body_of(tmp_path, text, "tip=NODES:4")["M"].sum())
    assert found[0] == pytest.approx(found[1], rel=1e-9) and found[0] > found[2] + 4.9


def test_what_turns_at_solids_is_held(tmp_path: Path) -> None:
    """A CBUSH in one place, and a CELAS about an axis, as AUTOSPC does."""
    cards = "CBUSH,9,9,2,11,,,,0\nPBUSH,9,K,1.+8,2.+8,3.+8,1.+5,1.+5,1.+5\nCELAS2,90,1.+5,1,5\n"
    (K, _), _ = added(tmp_path, bricks(1), cards, "tip=NODES:1")
    values = np.linalg.eigvalsh(K)
    np.testing.assert_allclose(values[-3:], [2e8, 4e8, 6e8], rtol=1e-6)


def test_grids_of_panels_alone(tmp_path: Path) -> None:
    """Panels with rods of their own along their edges need no other element there."""
    grids = "".join(f"GRID,9{k},,{1 + k % 2}.,{k // 2}.,0.\n" for k in range(4))
    panel = "CSHEAR,99,9,90,91,93,92\nPSHEAR,9,1,1.-3,,1.,1.\nRBE2,98,5,123456,90\n"
    panel += "SPC1,1,3,91,92,93\n"
    text = bars(PLAIN).replace("ENDDATA", grids + panel + "ENDDATA")
    a = body_of(tmp_path, text, "tip=NODES:4")
    assert "0 of 6 rigid motions are free" in a["facts"]["summary"]
    assert np.linalg.eigvalsh(a["K"].toarray())[0] > -1e-6
