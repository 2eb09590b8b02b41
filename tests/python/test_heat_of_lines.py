"""Beams and rods that are warmed or tightened: displacements, forces and frequencies against closed
forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.optimize import brentq
from test_preload import lowest

import flexgram
from bodies import box
from conftest import assembled, run
from flexgram import BodyError
from flexgram.body.description import import_description

E, NU, RHO, EXPANSION = 2.1e11, 0.3, 7800.0, 1.2e-5
STEEL = {"steel": {"E": E, "nu": NU, "rho": RHO, "expansion": EXPANSION}}
SIDE = 0.01
SECTION = {"shape": "rectangle", "width": SIDE, "height": SIDE, "y_axis": [0, 0, 1]}
AREA, INERTIA = SIDE**2, SIDE**4 / 12
#: No axis of the mesh.
ALONG = np.array([2.0, 3.0, -6.0]) / 7


def line(count: int, length: float, along: Any = ALONG) -> meshio.Mesh:
    points = np.linspace(0, length, count + 1)[:, None] * np.asarray(along, float)
    cells = np.column_stack([np.arange(count), np.arange(count) + 1])
    return meshio.Mesh(points, [("line", cells)])


def body(
    folder: Path, mesh: meshio.Mesh, section: Any = SECTION, ranks: int = 1, **more: Any
) -> Any:
    given = {
        "materials": STEEL,
        "sections": {"bar": section},
        "regions": {"all": {"material": "steel", "section": "bar"}},
        "interfaces": {"tip": {"coupling": "node", "nodes": [len(mesh.points)]}},
    } | more
    import_description(given, "stay", folder / "body.h5", mesh=mesh)
    return assembled(folder / "matrices.h5", folder / "body.h5", ranks)


def held(*nodes: int, components: str = "x y z rx ry rz") -> dict[str, Any]:
    return {f"at{n}": {"nodes": [n], "components": components.split()} for n in nodes}


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_cantilever_grows(ranks: int, tmp_path: Path) -> None:
    """By α times the integral of its temperature, along its axis and in no other direction."""
    mesh, length = line(8, 0.7), 0.7
    temperature = 30 + 50 * np.linspace(0, 1, 9) ** 2
    np.savetxt(
        tmp_path / "warm.csv", np.column_stack([np.arange(1, 10), temperature]), delimiter=","
    )
    loads = {"warm": {"type": "temperature", "table": str(tmp_path / "warm.csv")}}
    a = body(tmp_path, mesh, ranks=ranks, supports=held(1), loads=loads)
    B = a["B"]
    u = np.linalg.solve(a["K"].toarray(), B[:, -1])
    tip = B[:, :3].T @ u  # ports x, y, z of the last node
    mean = 0.5 * (temperature[1:] + temperature[:-1]).mean()
    assert tip == pytest.approx(EXPANSION * mean * length * ALONG, rel=1e-9)


def test_a_held_beam_pushes(tmp_path: Path) -> None:
    """Between two walls the reaction is E A α T, in the reduced body too."""
    body(
        tmp_path,
        line(6, 0.4),
        supports=held(1, 7),
        damping={"alpha": 5.0},
        loads={"warm": {"type": "temperature", "nodes": "all"}},
        outputs={"wall": {"type": "reaction", "nodes": [7]}},
        interfaces={"middle": {"coupling": "node", "nodes": [4]}},
    )
    rom = flexgram.reduce(tmp_path / "body.h5", (1, 300), 1e-6)
    row = [rom.outputs.index(f"wall.r{c}") for c in "xyz"]
    H = rom.transfer([1e-3])[0][row, rom.inputs.index("warm.T")]
    assert H.real == pytest.approx(-E * AREA * EXPANSION * ALONG, rel=1e-5)


def simply_supported(folder: Path, warm: float, ranks: int = 1) -> Any:
    mesh = line(24, 0.5, [1, 0, 0])
    a = body(
        folder,
        mesh,
        ranks=ranks,
        supports=held(1, 25, components="x y z rx"),
        loads={"warm": {"type": "temperature", "nodes": "all"}},
        preload={"warm.T": warm},
        interfaces={"middle": {"coupling": "node", "nodes": [13]}},
    )
    values, _ = lowest(a["K"].toarray(), a["M"].toarray(), 2)
    return values[0]  # both planes are alike


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_warm_beam_between_walls_is_softer(ranks: int, tmp_path: Path) -> None:
    """ω² = (π/L)⁴ EI/ρA + (π/L)² N/ρA with N = −E A α T: linear in T, to zero where it buckles."""
    critical = np.pi**2 * INERTIA / (AREA * EXPANSION * 0.5**2)
    cold = simply_supported(tmp_path, 0.0, ranks)
    assert cold == pytest.approx((np.pi / 0.5) ** 4 * E * INERTIA / (RHO * AREA), rel=3e-3)
    for share in (-1.0, 0.5, 0.9):
        found = simply_supported(tmp_path, share * critical, ranks)
        assert found == pytest.approx((1 - share) * cold, rel=2e-3, abs=2e-3 * cold)
    with pytest.raises(AssertionError, match="does not bear it"):
        simply_supported(tmp_path, 1.05 * critical, ranks)


def test_a_cold_stay_tightens_a_frame(tmp_path: Path) -> None:
    """A rod beside a solid bar between the same ends: forces of both are in equilibrium, and the
    stay's tension is E A (ε − α T)."""
    solid = box("tetra10", (4, 1, 1), (0.2, 0.02, 0.02), distort=False)
    n = len(solid.points)
    points = np.vstack([solid.points, [[0.0, 0.05, 0.0], [0.2, 0.05, 0.0]]])
    mesh = meshio.Mesh(
        points,
        [solid.cells[0], ("line", np.array([[n, n + 1]]))],
        cell_sets={
            "bar": [np.arange(len(solid.cells[0].data)), np.array([], int)],
            "stay": [np.array([], int), np.array([0])],
        },
    )
    given = {
        "materials": STEEL,
        "sections": {"rod": {"shape": "rod", "A": 1e-5}},
        "regions": {"bar": {"material": "steel"}, "stay": {"material": "steel", "section": "rod"}},
        "interfaces": {
            "left": {"coupling": "rigid", "nodes": {"box": [[-1e-6, -1, -1], [1e-6, 1, 1]]}},
            "right": {"coupling": "rigid", "nodes": {"box": [[0.2 - 1e-6, -1, -1], [0.21, 1, 1]]}},
        },
        "loads": {"cold": {"type": "temperature", "nodes": [n + 1, n + 2]}},
    }
    import_description(given, "frame", tmp_path / "body.h5", mesh=mesh)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", 1)
    B = a["B"]
    heat = B[:, 12]
    # A unit of temperature at the references: ±E A α, with its moment about them.
    left, right = B[:, :6].T @ heat, B[:, 6:12].T @ heat
    force = E * 1e-5 * EXPANSION
    assert right[0] == pytest.approx(force) and left[0] == pytest.approx(-force)
    assert left[:3] + right[:3] == pytest.approx(np.zeros(3), abs=1e-9 * force)


def test_a_deck_of_beams(tmp_path: Path) -> None:
    """Temperatures of a step are an input, as with solids."""
    (tmp_path / "stay.inp").write_text(
        "*NODE, NSET=ALL\n1, 0, 0, 0\n2, 0, 0, 0.25\n3, 0, 0, 0.5\n"
        "*ELEMENT, TYPE=B31, ELSET=BAR\n1, 1, 2\n2, 2, 3\n"
        "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7800\n*EXPANSION\n1.2e-5\n"
        "*BEAM SECTION, ELSET=BAR, MATERIAL=STEEL, SECTION=RECT\n0.01, 0.01\n1, 0, 0\n"
        "*BOUNDARY\n1, 1, 6\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20\n"
        "*STEP\n*STATIC\n*TEMPERATURE\nALL, 70\n*END STEP\n"
    )
    run(
        *("import", tmp_path / "stay.inp", "--assemble", "--deck-loads", "--node", "tip=NODES:3"),
        *("-o", tmp_path / "body.h5"),
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", 1)
    B = a["B"]
    u = np.linalg.solve(a["K"].toarray(), B[:, -1])
    assert (B[:, :3].T @ u) == pytest.approx([0, 0, EXPANSION * 50 * 0.5], rel=1e-9, abs=1e-15)


def test_what_is_refused(tmp_path: Path) -> None:
    loads = {"warm": {"type": "temperature", "nodes": "all"}}
    iron = {"steel": {"E": E, "nu": NU, "rho": RHO}}
    with pytest.raises(BodyError, match="no expansion"):
        body(tmp_path, line(3, 0.2), supports=held(1), loads=loads, materials=iron)


def tightened(folder: Path, force: float, along: Any = (1.0, 0.0, 0.0), ranks: int = 1) -> Any:
    """ω² of a beam without shear on two walls, whose middle is a turnbuckle."""
    inertia = {"I_y": INERTIA, "I_z": INERTIA, "J": 2 * INERTIA, "k_y": 1e4, "k_z": 1e4}
    stiff = {"shape": "general", "A": AREA, "y_axis": [0, 0, 1]} | inertia
    a = body(
        folder,
        line(24, 0.5, along),
        section=stiff,
        ranks=ranks,
        supports=held(1, 25, components="x y z rx ry rz"),
        loads={"bolt": {"type": "pretension", "nodes": list(range(10, 17)), "axis": list(along)}},
        preload={"bolt.force": force},
        interfaces={"middle": {"coupling": "node", "nodes": [13]}},
    )
    return lowest(a["K"].toarray(), a["M"].toarray(), 2)[0][0]


def clamped(force: float) -> float:
    """ω² of a clamped beam under tension: the roots of 2ab(1 − cosh a cos b) + (a² − b²) sinh a
    sin b with a² − b² = NL²/EI and ab = ωL²√(ρA/EI)."""
    length, stiffness = 0.5, E * INERTIA

    def residual(omega: float) -> float:
        s, p = force * length**2 / stiffness, omega * length**2 * np.sqrt(RHO * AREA / stiffness)
        a, b = (np.sqrt(np.hypot(s / 2, p) + sign * s / 2) for sign in (1, -1))
        return float(
            2 * a * b * (1 - np.cosh(a) * np.cos(b)) + (a**2 - b**2) * np.sinh(a) * np.sin(b)
        )

    first = 4.73**2 / length**2 * np.sqrt(stiffness / (RHO * AREA))
    tried = first * np.linspace(0.3, 3, 60)
    change = int(np.flatnonzero(np.diff(np.sign([residual(omega) for omega in tried])))[0])
    return float(brentq(residual, tried[change], tried[change + 1])) ** 2


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_turnbuckle_pulls_with_its_force(ranks: int, tmp_path: Path) -> None:
    """The whole beam has the tension of its middle, along any axis; a bolt that pushes softens."""
    buckles = 4 * np.pi**2 * E * INERTIA / 0.5**2
    for force in (-0.6 * buckles, 0.5 * buckles, 3 * buckles):
        found = tightened(tmp_path, force, ranks=ranks)
        assert found == pytest.approx(clamped(force), rel=2e-3)
        assert tightened(tmp_path, force, ALONG, ranks) == pytest.approx(found, rel=1e-6)
    with pytest.raises(AssertionError, match="does not bear it"):
        tightened(tmp_path, -1.05 * buckles)


def test_what_a_bolt_of_beams_counts(tmp_path: Path) -> None:
    """Its length, and E A L of the part along the axis, beside solids between its ends."""
    solid = box("hexahedron20", (4, 1, 1), (0.2, 0.02, 0.02), distort=False)
    n = len(solid.points)
    points = np.vstack([solid.points, [[x, 0.05, 0.0] for x in (0.0, 0.1, 0.2)]])
    bolt = np.array([[n, n + 1], [n + 1, n + 2]])
    mesh = meshio.Mesh(
        points,
        [solid.cells[0], ("line", bolt)],
        cell_sets={
            "bar": [np.arange(len(solid.cells[0].data)), np.array([], int)],
            "bolt": [np.array([], int), np.arange(2)],
        },
    )
    ends = [{"box": [[x - 1e-6, -1, -1], [x + 1e-6, 1, 1]]} for x in (0.0, 0.2)]
    given = {
        "materials": STEEL,
        "sections": {"bar": SECTION},
        "regions": {"bar": {"material": "steel"}, "bolt": {"material": "steel", "section": "bar"}},
        "interfaces": {
            name: {"coupling": "rigid", "nodes": nodes}
            for name, nodes in zip(("left", "right"), ends, strict=True)
        },
        "supports": {"foot": {"nodes": [n + 2], "components": ["x", "y", "z", "rx", "ry", "rz"]}},
        "loads": {
            "bolt": {"type": "pretension", "nodes": [n + 1, n + 2, n + 3], "axis": [1, 0, 0]}
        },
        "preload": {"bolt.force": 100.0},
    }
    import_description(given, "clamp", tmp_path / "body.h5", mesh=mesh)
    with h5py.File(tmp_path / "body.h5") as file:
        bolt_of_file = dict(file["loads/bolt/pretension"].attrs)
    assert bolt_of_file["held"] == pytest.approx(E * AREA * 0.2)
    assert bolt_of_file["length"] == pytest.approx(0.2)
    loose = {"bolt": given["loads"]["bolt"] | {"axis": [0, 1, 0]}}
    with pytest.raises(BodyError, match="no length along the axis"):
        import_description(given | {"loads": loose}, "clamp", tmp_path / "b.h5", mesh=mesh)
