"""Shells and membranes that are warmed: growth, curvature, stress and buckling in closed form."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from test_shells import KINDS, SIX, STEEL, write

import flexgram
from conftest import assembled, body_system, run
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck
from sheets import flat, sheet

ALPHA = 1.2e-5
WARM = {**STEEL, "expansion": ALPHA}
E, NU = STEEL["E"], STEEL["nu"]
LENGTH, WIDTH, T = 0.3, 0.2, 0.006
CORNER = {"nodes": "corner", "components": SIX}
#: A plane that no axis is along.
TURNED = sl.expm(np.array([[0, -0.4, 0.9], [0.4, 0, -0.3], [-0.9, 0.3, 0]]))


def mesh_of(kind: str, turned: bool = True) -> Any:
    mesh = sheet(kind, (8, 6), flat(LENGTH, WIDTH), 0.2)
    if turned:
        mesh.points = mesh.points @ TURNED.T
    return mesh


class Warmed:
    """A sheet that is solved under one input."""

    def __init__(self, folder: Path, load: str, ranks: int = 1) -> None:
        run("assemble", "-body", folder / "b.h5", "-body_out", folder / "m.h5", ranks=ranks)
        system = body_system(folder / "m.h5")
        with h5py.File(folder / "m.h5") as file:
            names = {k: [str(n) for n in file[k].attrs["names"]] for k in "BC"}
            self.node = file["nodes/id"][:][file["dofs/node"][:]]
            self.component = file["dofs/component"][:]
            direct = file["feedthrough"][:] if "feedthrough" in file else None
        column = names["B"].index(load)
        self.u = spl.spsolve(sp.csc_matrix(system.K), np.asarray(system.B)[:, column])
        found = np.asarray(system.C) @ self.u
        if direct is not None:
            found = found + direct[:, column]
        self.outputs = dict(zip(names["C"], found, strict=True))

    def motion(self, count: int) -> Any:
        """(count, 6) of nodes."""
        u = np.zeros((count, 6))
        u[self.node, self.component] = self.u
        return u

    def tensor(self, name: str, turned: bool = True) -> Any:
        """A stress, in the axes of the sheet."""
        parts = [
            self.outputs.get(f"{name}.s{pair}", 0.0)
            for pair in ("xx", "yy", "zz", "xy", "yz", "zx")
        ]
        tensor = np.array(parts)[[[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
        return TURNED.T @ tensor @ TURNED if turned else tensor


STRESS = {
    side: {"type": "stress", "nodes": "middle", "side": side}
    for side in ("top", "middle", "bottom")
}


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_free_plate_grows(kind: str, ranks: int, tmp_path: Path) -> None:
    """By α T in its plane, without stress; under a gradient it becomes a part of a sphere of the
    curvature α g, without stress too. To rounding, on a distorted mesh."""
    mesh = mesh_of(kind)
    write(
        tmp_path / "b.h5", mesh, {"thickness": T}, WARM, supports={"at": CORNER},
        interfaces={"end": {"coupling": "node", "nodes": "middle"}}, outputs=STRESS,
        loads={"warm": {"type": "temperature", "nodes": "all"},
               "slope": {"type": "temperature_gradient", "nodes": "all"}},
    )  # fmt: skip
    warm, slope = (Warmed(tmp_path, load, ranks) for load in ("warm.T", "slope.Tn"))
    x = mesh.points @ TURNED
    u = warm.motion(len(x))
    np.testing.assert_allclose(u[:, :3] @ TURNED, ALPHA * (x - x[0]), atol=1e-8 * ALPHA * LENGTH)
    u = slope.motion(len(x))
    r = x - x[0]
    # Fibres above the middle grow: θ = α g (−y, x), w = −α g (x² + y²)/2.
    w = -ALPHA * (r[:, 0] ** 2 + r[:, 1] ** 2) / 2
    np.testing.assert_allclose(u[:, 3:] @ TURNED, ALPHA * r[:, [1, 0, 2]] * [-1, 1, 0],
                               atol=1e-7 * ALPHA * LENGTH)  # fmt: skip
    np.testing.assert_allclose((u[:, :3] @ TURNED)[:, 2], w, atol=2e-2 * np.abs(w).max())
    for of, size in ((warm, 1.0), (slope, T)):
        stresses = [value for name, value in of.outputs.items() if ".s" in name]
        assert len(stresses) == 18
        assert np.abs(stresses).max() < 1e-7 * E * ALPHA * size


@pytest.mark.parametrize("kind", KINDS)
def test_a_held_plate(kind: str, tmp_path: Path) -> None:
    """Between walls: −E α T/(1 − ν) everywhere; under a gradient ∓E α g t/2/(1 − ν) on its sides.
    With a table of both; the reduced body answers the same at 0 Hz."""
    mesh = mesh_of(kind)
    mean, slope = 40.0, 3000.0  # K, K/m
    table = [[n + 1, mean, slope] for n in range(len(mesh.points))]
    edges = np.unique(
        np.concatenate([mesh.point_sets[s] for s in ("start", "end", "top", "bottom")])
    )
    write(
        tmp_path / "b.h5", mesh, {"thickness": T}, WARM, outputs=STRESS | {
            "one": {"type": "stress", "elements": [9], "integration_point": 1, "side": "top"}},
        supports={"edge": {"nodes": (edges + 1).tolist(), "components": SIX}},
        interfaces={"middle": {"coupling": "node", "nodes": "middle"}},
        loads={"hot": {"type": "temperature", "table": table}}, damping={"beta": 1e-5},
    )  # fmt: skip
    hot = Warmed(tmp_path, "hot.T")
    unit = -E * ALPHA / (1 - NU)
    heights = {"top": T / 2, "middle": 0.0, "bottom": -T / 2, "one": T / 2}
    for name, height in heights.items():
        warm = mean + slope * height
        np.testing.assert_allclose(
            hot.tensor(name), np.diag([1, 1, 0]) * unit * warm, atol=1e-6 * abs(unit) * mean
        )
    rom = flexgram.reduce(tmp_path / "b.h5", (0, 500), 1e-5)
    row = rom.outputs.index("top.sxx")
    column = rom.inputs.index("hot.T")
    H = rom.transfer([1e-3])[0][row, column]
    assert H.real == pytest.approx(hot.outputs["top.sxx"], rel=1e-3)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_bimetal(kind: str, ranks: int, tmp_path: Path) -> None:
    """Two layers of one thickness h: κ = 24 Δα E₁E₂ / (h (E₁² + E₂² + 14 E₁E₂)) a kelvin
    (Timoshenko 1925), and their stress at the sides; without a support against cylinders a strip of
    ν = 0."""
    mesh = mesh_of(kind)
    E1, E2, a1, a2, h = 2.0e11, 0.7e11, 1.2e-5, 2.3e-5, 0.5 * T
    write(
        tmp_path / "b.h5", mesh,
        {"layers": [{"material": "brass", "thickness": h}, {"material": "steel", "thickness": h}]},
        materials={"steel": {"E": E1, "nu": 0.0, "rho": 7800.0, "expansion": a1},
                   "brass": {"E": E2, "nu": 0.0, "rho": 8500.0, "expansion": a2}},
        regions={"all": {"section": "sheet"}}, supports={"at": CORNER}, outputs=STRESS,
        interfaces={"end": {"coupling": "node", "nodes": "middle"}},
        loads={"warm": {"type": "temperature", "nodes": "all"}},
    )  # fmt: skip
    warm = Warmed(tmp_path, "warm.T", ranks)
    x = mesh.points @ TURNED
    r, u = x - x[0], warm.motion(len(x))[:, 3:] @ TURNED
    curvature = 24 * (a2 - a1) * E1 * E2 / (2 * h * (E1**2 + E2**2 + 14 * E1 * E2))
    # Brass below grows more: it bends upwards.
    np.testing.assert_allclose(u, curvature * r[:, [1, 0, 2]] * [1, -1, 0],
                               atol=1e-6 * curvature * LENGTH)  # fmt: skip
    # By sums over the layers: strain e + z k with k = −curvature, forces and moments vanish.
    A = np.array([[E1 + E2, (E1 - E2) * h / 2], [(E1 - E2) * h / 2, (E1 + E2) * h**2 / 3]])
    e, k = np.linalg.solve(A, [E1 * a1 + E2 * a2, (E1 * a1 - E2 * a2) * h / 2])
    assert k == pytest.approx(-curvature, rel=1e-9)
    for name, sigma in (("top", E1 * (e + h * k - a1)), ("bottom", E2 * (e - h * k - a2))):
        np.testing.assert_allclose(
            warm.tensor(name), sigma * np.diag([1, 1, 0]), atol=1e-6 * E1 * a1
        )


def test_fibres_grow_along_their_angle(tmp_path: Path) -> None:
    """A free ply grows by the tensor of its expansion, turned by its angle, without stress."""
    mesh, angle = mesh_of("quad", turned=False), np.radians(30)
    ply = {
        "E1": 140e9, "E2": 10e9, "E3": 10e9, "nu12": 0.3, "nu13": 0.3, "nu23": 0.4, "G12": 5e9,
        "G13": 5e9, "G23": 3.5e9, "rho": 1600.0, "expansion": [-0.5e-6, 30e-6, 30e-6],
    }  # fmt: skip
    write(
        tmp_path / "b.h5", mesh,
        {"layers": [{"material": "ply", "thickness": T, "angle": 30}], "axis_1": [1, 0, 0]},
        materials={"ply": ply}, regions={"all": {"section": "sheet"}}, supports={"at": CORNER},
        outputs=STRESS, interfaces={"end": {"coupling": "node", "nodes": "middle"}},
        loads={"warm": {"type": "temperature", "nodes": "all"}},
    )  # fmt: skip
    warm = Warmed(tmp_path, "warm.T")
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])
    strain = R @ np.diag(ply["expansion"][:2]) @ R.T
    x = mesh.points - mesh.points[0]
    u = warm.motion(len(x))
    slopes = np.linalg.lstsq(x[:, :2], u[:, :2], rcond=None)[0].T
    np.testing.assert_allclose(x[:, :2] @ slopes.T, u[:, :2], atol=1e-9 * LENGTH * 30e-6)
    np.testing.assert_allclose((slopes + slopes.T) / 2, strain, atol=1e-8 * 30e-6)
    assert max(abs(v) for name, v in warm.outputs.items() if ".s" in name) < 1e-7 * 10e9 * 30e-6


@pytest.mark.parametrize("offset", [0.0, 0.01])
def test_a_gradient_across_a_cylinder(offset: float, tmp_path: Path) -> None:
    """A long tube, warm outside: E α Δ/(2 (1 − ν)) on its sides far from its ends (Timoshenko,
    Strength of Materials II, § 30), wherever its nodes are."""
    radius, t = 0.2, 0.004
    mesh = sheet("quad", (64, 40), lambda u, v: (
        radius * np.cos(np.pi * u / 2), radius * np.sin(np.pi * u / 2), 0.6 * v))  # fmt: skip
    # Of a quarter, by symmetry; the normals point outwards.
    write(
        tmp_path / "b.h5", mesh, {"thickness": t, "offset": offset}, WARM,
        supports={"start": {"nodes": "start", "components": ["y", "rx", "rz"]},
                  "end": {"nodes": "end", "components": ["x", "ry", "rz"]},
                  "bottom": {"nodes": "bottom", "components": ["z", "rx", "ry"]}},
        interfaces={"foot": {"coupling": "node", "nodes": "middle"}},
        loads={"slope": {"type": "temperature_gradient", "nodes": "all"}},
        outputs={side: {"type": "stress", "elements": [1 + 32 * 40, 2 + 32 * 40], "side": side}
                 for side in ("top", "bottom")},
    )  # fmt: skip
    found = Warmed(tmp_path, "slope.Tn")
    sigma = E * ALPHA * t / (2 * (1 - NU))
    for side, sign in (("top", -1), ("bottom", 1)):
        values = np.linalg.eigvalsh(found.tensor(side, turned=False))
        expected = sorted([0, sign * sigma, sign * sigma])
        np.testing.assert_allclose(values, expected, atol=0.02 * sigma)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_warm_plate_is_softer(kind: str, ranks: int, tmp_path: Path) -> None:
    """A simply supported plate between walls: (2πf)² m = D (k² + l²)² − N (k² + l²) with
    N = E α T t/(1 − ν); at two thirds of where it buckles."""
    a, count, t = 1.0, 24, 0.01
    mesh = sheet(kind, (count, count), flat(a, a))
    D, m = E * t**3 / 12 / (1 - NU**2), STEEL["rho"] * t
    k2 = 2 * (np.pi / a) ** 2
    warm = 2 / 3 * D * k2 * (1 - NU) / (E * ALPHA * t)
    edge = np.unique(
        np.concatenate([mesh.point_sets[s] for s in ("start", "end", "top", "bottom")])
    )
    ends = np.union1d(mesh.point_sets["start"], mesh.point_sets["end"]) + 1
    flanks = np.union1d(mesh.point_sets["bottom"], mesh.point_sets["top"]) + 1
    write(
        tmp_path / "b.h5", mesh, {"thickness": t}, WARM,
        supports={"edge": {"nodes": (edge + 1).tolist(), "components": ["x", "y", "z"]},
                  "ends": {"nodes": ends.tolist(), "components": ["rx"]},
                  "flanks": {"nodes": flanks.tolist(), "components": ["ry"]}},
        interfaces={"middle": {"coupling": "node", "nodes": "middle"}},
        loads={"warm": {"type": "temperature", "nodes": "all"}}, preload={"warm.T": warm},
    )  # fmt: skip
    body = assembled(tmp_path / "m.h5", tmp_path / "b.h5", ranks)
    found = spl.eigsh(body["K"], 1, body["M"], sigma=0, return_eigenvectors=False)[0]
    assert found == pytest.approx(D * k2**2 / m / 3, rel=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_a_membrane_under_heat(kind: str, tmp_path: Path) -> None:
    """Between walls −E α T/(1 − ν), of a membrane as of a shell; its stress has no side."""
    mesh = mesh_of(kind)
    edges = np.unique(
        np.concatenate([mesh.point_sets[s] for s in ("start", "end", "top", "bottom")])
    )
    write(
        tmp_path / "b.h5", mesh, {"thickness": T}, WARM,
        regions={"all": {"material": "steel", "section": "sheet", "formulation": "membrane"}},
        supports={"edge": {"nodes": (edges + 1).tolist(), "components": ["x", "y", "z"]}},
        interfaces={"middle": {"coupling": "node", "nodes": "middle"}},
        loads={"hot": {"type": "temperature", "nodes": "all"}},
        outputs={"s": {"type": "stress", "nodes": "middle"}},
    )  # fmt: skip
    run("assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5")
    system = body_system(tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5") as file:
        B, C = ([str(n) for n in file[k].attrs["names"]] for k in "BC")
        direct = file["feedthrough"][:]
    # Flat, it has no stiffness across: nothing is to move.
    assert np.abs(np.asarray(system.B)[:, B.index("hot.T")]).max() < 1e-6 * E * ALPHA * T * WIDTH
    parts = {name: direct[i, B.index("hot.T")] for i, name in enumerate(C)}
    of = [parts.get(f"s.s{pair}", 0.0) for pair in ("xx", "yy", "zz", "xy", "yz", "zx")]
    tensor = np.array(of)[[[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    unit = -E * ALPHA / (1 - NU)
    np.testing.assert_allclose(
        TURNED.T @ tensor @ TURNED, np.diag([unit, unit, 0]), atol=1e-8 * abs(unit)
    )


def test_what_cannot_be_warmed(tmp_path: Path) -> None:
    mesh = mesh_of("quad")
    at = {"interfaces": {"end": {"coupling": "node", "nodes": "middle"}}}
    heat = {"warm": {"type": "temperature", "nodes": "all"}}
    with pytest.raises(BodyError, match=r"loads: warm.*has no expansion"):
        write(tmp_path / "b.h5", mesh, {"thickness": T}, STEEL, loads=heat, **at)
    slope = {"slope": {"type": "temperature_gradient", "table": [[1, 2.0]]}}
    with pytest.raises(BodyError, match="temperature_gradient takes no table"):
        write(tmp_path / "b.h5", mesh, {"thickness": T}, WARM, loads=slope, **at)


def eight_nodes(counts: tuple[int, int], size: tuple[float, float]) -> tuple[Any, Any]:
    """Nodes (N, 3) and elements (E, 8), numbers from 1, of a rectangle."""
    n, m = counts
    number: dict[tuple[int, int], int] = {}
    points = []
    elements = []
    for i in range(n):
        for j in range(m):
            places = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
            of = []
            for a, b in places:
                key = (2 * i + a, 2 * j + b)
                if key not in number:
                    number[key] = len(points) + 1
                    points.append([size[0] * key[0] / (2 * n), size[1] * key[1] / (2 * m), 0.0])
                of.append(number[key])
            elements.append(of)
    return np.array(points), np.array(elements)


def test_a_deck_against_ccx(tmp_path: Path) -> None:
    """Temperatures and their gradients of a step, of S8R and above initial ones, with ccx: a plate
    that is clamped at one end. Of the largest displacement its own differ by 0.1 % in the plane and
    1.4 % across; 24 elements a side instead of 12 halve that, and move ours by 0.04 %."""
    points, elements = eight_nodes((24, 16), (LENGTH, WIDTH))
    rows = [f"{k}, {x:.12g}, {y:.12g}, {z:.12g}" for k, (x, y, z) in enumerate(points, 1)]
    cells = [f"{k}, " + ", ".join(map(str, of)) for k, of in enumerate(elements, 1)]
    start = [str(k) for k, x in enumerate(points, 1) if x[0] < 1e-9]
    heat = [
        f"{k}, {40 + 200 * x[0]:.12g}, {3000 - 9000 * x[1]:.12g}" for k, x in enumerate(points, 1)
    ]
    text = [
        *("*NODE, NSET=ALL", *rows, "*ELEMENT, TYPE=S8R, ELSET=E", *cells),
        *("*NSET, NSET=START", *start, "*MATERIAL, NAME=M", "*ELASTIC", f"{E}, {NU}"),
        *("*DENSITY", "8000.", "*EXPANSION", f"{ALPHA}", "*SHELL SECTION, ELSET=E, MATERIAL=M"),
        *(f"{T}", "*BOUNDARY", "START, 1, 6", "*INITIAL CONDITIONS, TYPE=TEMPERATURE"),
        *("ALL, 20, 500", "*STEP", "*STATIC", "*TEMPERATURE", *heat),
        *("*NODE PRINT, NSET=ALL", "U", "*END STEP"),
    ]
    (tmp_path / "warm.inp").write_text("\n".join(text) + "\n")
    subprocess.run(["ccx", "warm"], cwd=tmp_path, check=True, capture_output=True)
    printed = [line.split() for line in (tmp_path / "warm.dat").read_text().split("\n")]
    theirs = np.array([[float(x) for x in row[1:]] for row in printed if len(row) == 4])
    facts = assemble_deck(
        tmp_path / "warm.inp", tmp_path / "b.h5", [parse("node", "tip=NODES:3")], deck_loads=True
    )
    assert list(facts["loads"]) == ["step1_temperature"]
    ours = Warmed(tmp_path, "step1_temperature.T").motion(len(points) + len(elements))
    apart = np.abs(ours[: len(points), :3] - theirs).max(axis=0) / np.abs(theirs).max()
    assert np.all(apart < [1e-3, 1e-3, 0.015])
    assert np.abs(theirs[:, 2]).max() > np.abs(theirs[:, 0]).max() > 1e-5


def test_a_composite_without_expansion(tmp_path: Path) -> None:
    """Its temperatures are left out, and the import says so."""
    points, elements = eight_nodes((2, 1), (LENGTH, WIDTH))
    rows = [f"{k}, {x:.12g}, {y:.12g}, {z:.12g}" for k, (x, y, z) in enumerate(points, 1)]
    cells = [f"{k}, " + ", ".join(map(str, of)) for k, of in enumerate(elements, 1)]
    text = [
        *("*NODE, NSET=ALL", *rows, "*ELEMENT, TYPE=S8R, ELSET=E", *cells),
        *("*MATERIAL, NAME=M", "*ELASTIC", f"{E}, {NU}", "*DENSITY", "8000."),
        *("*SHELL SECTION, ELSET=E, COMPOSITE", "0.001,, M", "0.002,, M"),
        *("*BOUNDARY", "1, 1, 6", "*STEP", "*STATIC", "*TEMPERATURE", "ALL, 20", "*END STEP"),
    ]
    (tmp_path / "warm.inp").write_text("\n".join(text) + "\n")
    facts = assemble_deck(
        tmp_path / "warm.inp", tmp_path / "b.h5", [parse("node", "tip=NODES:3")], deck_loads=True
    )
    assert not facts["loads"]
    assert "load step1_temperature is left out: a material has no *EXPANSION" in str(
        facts["remarks"]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_sandwich(kind: str, tmp_path: Path) -> None:
    """Two skins of t/2 at a distance: their stress under a moment is M/(t/2 · d) at ± d/2, and as
    thick as a shell it is that of one layer. Where their heights are not given it is refused."""
    mesh, moment, d, t = mesh_of(kind), 20.0, 0.02, 0.002
    tip = mesh.point_sets["end"]
    share = np.array([0.5, *[1.0] * (len(tip) - 2), 0.5]) / (len(tip) - 1)
    axis = TURNED[:, 1]
    rows = [[n + 1, 0, 0, 0, *(w * moment * axis)] for n, w in zip(tip, share, strict=True)]
    given = {
        "supports": {"start": {"nodes": "start", "components": SIX}},
        "interfaces": {"end": {"coupling": "node", "nodes": "middle"}},
        "loads": {"end": {"type": "nodal", "table": rows}},
        "outputs": STRESS,
    }
    section = {"thickness": t, "bending": {"factor": 3 * (d / t) ** 2}, "shear": {"factor": 50.0}}
    flat_steel = {**WARM, "nu": 0.0}
    with pytest.raises(BodyError, match=r"give it `sides: \[bottom, top\]`"):
        write(tmp_path / "b.h5", mesh, section, flat_steel, **given)
    write(tmp_path / "b.h5", mesh, section | {"sides": [-d / 2, d / 2]}, flat_steel, **given)
    found = Warmed(tmp_path, "end.load")
    along = np.zeros((3, 3))
    sigma = moment / WIDTH / (t / 2 * d)
    for side, sign in (("top", 1), ("middle", 0), ("bottom", -1)):
        along[0, 0] = sign * sigma
        np.testing.assert_allclose(found.tensor(side), along, atol=1e-3 * sigma)
    one = {"thickness": t, "bending": {"factor": 1.0}, "shear": {"factor": 5 / 6}}
    write(tmp_path / "b.h5", mesh, one, flat_steel, **given)
    apart = Warmed(tmp_path, "end.load")
    write(tmp_path / "b.h5", mesh, {"thickness": t}, flat_steel, **given)
    whole = Warmed(tmp_path, "end.load")
    largest = np.abs(whole.tensor("top")).max()
    np.testing.assert_allclose(apart.tensor("top"), whole.tensor("top"), atol=1e-8 * largest)


def test_gravity_of_layers_and_membranes(tmp_path: Path) -> None:
    """GRAV counts the layers of a composite section, and membranes; a misspelled card is named."""
    points, elements = eight_nodes((2, 1), (LENGTH, WIDTH))
    rows = [f"{k}, {x:.12g}, {y:.12g}, {z:.12g}" for k, (x, y, z) in enumerate(points, 1)]
    for kind, cells, section, mass in (
        ("S8R", elements, "*SHELL SECTION, ELSET=E, COMPOSITE\n0.001,, M\n0.002,, N", 8 + 2 * 3),
        ("M3D4", elements[:, :4], "*MEMBRANE SECTION, ELSET=E, MATERIAL=M\n0.002", 2 * 8),
    ):
        text = [
            *("*NODE, NSET=ALL", *rows, f"*ELEMENT, TYPE={kind}, ELSET=E"),
            *(f"{k}, " + ", ".join(map(str, of)) for k, of in enumerate(cells, 1)),
            *("*MATERIAL, NAME=M", "*ELASTIC", f"{E}, {NU}", "*DENSITY", "8000."),
            *("*MATERIAL, NAME=N", "*ELASTIC", f"{E}, {NU}", "*DENSITY", "3000."),
            *(section, "*STEP", "*STATIC", "*DLOAD", "E, GRAV, 9.81, 0., 0., -1."),
            *("*DLOAD", ", GRAV, 9.81, 0., 0., -1.", "*DLAOD", "E, P, 1.", "*END STEP"),
        ]
        (tmp_path / "g.inp").write_text("\n".join(text) + "\n")
        facts = assemble_deck(
            tmp_path / "g.inp", tmp_path / "b.h5", [parse("node", "tip=NODES:3")], deck_loads=True
        )
        weight = 9.81 * LENGTH * WIDTH * mass
        for name in ("step1_dload", "step1_dload2"):
            assert f"(0, 0, {-weight:.4g}) N in all" in facts["loads"][name]
        assert "*DLAOD is passed over: did you mean *DLOAD?" in str(facts["remarks"])


def test_shells_inside_a_rigid_interface(tmp_path: Path) -> None:
    """A gradient over all nodes does not reach them, and is no mistake."""
    mesh = sheet("quad", (4, 4), flat(LENGTH, WIDTH))
    corner = np.flatnonzero((mesh.points[:, 0] > 0.7 * LENGTH) & (mesh.points[:, 1] > 0.7 * WIDTH))
    facts = write(
        tmp_path / "b.h5", mesh, {"thickness": T}, WARM,
        interfaces={"patch": {"coupling": "rigid", "nodes": (corner + 1).tolist()}},
        loads={"slope": {"type": "temperature_gradient", "nodes": "all"}},
    )  # fmt: skip
    assert facts["loads"]["slope"] == "temperature gradient of 25 nodes"
