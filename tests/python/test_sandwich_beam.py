"""A sandwich beam with a core that loses energy in shear, against the sixth-order theory of such
beams (Mead and Markus 1969; Rao 1978), solved without a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl

import flexgram
from bodies import box
from flexgram.body.description import import_description

TWO_PI = 2 * np.pi
LENGTH, WIDTH, FACE, CORE = 0.2, 0.01, 0.002, 0.001
E, RHO, RHO_CORE = 210e9, 7850.0, 1200.0
G = 8e6  # of the core, in the long term
SHARES, TIMES = [0.4, 0.3], [1e-3, 2e-4]  # of its relaxation, of the instantaneous modulus


def tip_by_theory(f: Any, shear_modulus: Any) -> Any:
    """Deflection of the tip of a cantilever by a unit force there, at frequencies f [Hz].

    With w the deflection, u the slip of one face against the other and gamma = (u + d w')/CORE the
    shear of the core: D w'''' - G d gamma' = mu omega² w and S u'' = G gamma, all by the width.
    """
    d, bending, axial = FACE + CORE, E * FACE**3 / 6, E * FACE / 2
    mass = 2 * RHO * FACE + RHO_CORE * CORE
    A = np.zeros((len(f), 6, 6), dtype=complex)  # of w, w', w'', w''', u, u'
    A[:, [0, 1, 2, 4], [1, 2, 3, 5]] = 1
    A[:, 3, 0] = mass * (TWO_PI * f) ** 2 / bending
    A[:, 3, 2] = shear_modulus * d * d / (CORE * bending)
    A[:, 3, 5] = shear_modulus * d / (CORE * bending)
    A[:, 5, 1] = shear_modulus * d / (CORE * axial)
    A[:, 5, 4] = shear_modulus / (CORE * axial)
    values, vectors = np.linalg.eig(A)
    grown = (vectors * np.exp(values * LENGTH)[:, None]) @ np.linalg.inv(vectors)
    end = grown[:, :, [2, 3, 5]]  # the clamped end has w = w' = u = 0
    gamma = (end[:, 4] + d * end[:, 1]) / CORE
    force = -bending * end[:, 3] + (shear_modulus * d)[:, None] * gamma
    free = np.stack([end[:, 2], end[:, 5], WIDTH * force], axis=1)
    unknown = np.linalg.solve(free, np.array([0, 0, 1.0])[None, :, None])
    return (end[:, :1] @ unknown)[:, 0, 0]


def peaks(f: Any, H: Any) -> list[tuple[float, float]]:
    """Where |omega H| is largest, and the width at half of its power over that."""
    size, found = np.abs(f * H), []
    for k in np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1:
        low = np.flatnonzero(size[:k] < size[k] / np.sqrt(2))
        high = np.flatnonzero(size[k:] < size[k] / np.sqrt(2))
        found.append((f[k], (f[k + high[0]] - f[low[-1]]) / f[k]))
    return found


@pytest.mark.parametrize("core", ["loss_factor", "prony"])
def test_sandwich_against_sixth_order_theory(core: str, tmp_path: Path) -> None:
    """Resonances within 0.2 %, loss factors within 1 %; of a loss factor and of Prony terms."""
    mesh = box("hexahedron20", (40, 1, 5), (LENGTH, WIDTH, 2 * FACE + CORE), distort=False)
    middle = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 2] - mesh.points[:, 2].min()
    inner = (middle > FACE) & (middle < FACE + CORE)
    mesh.cell_sets = {"faces": [np.flatnonzero(~inner)], "core": [np.flatnonzero(inner)]}
    losses: dict[str, Any] = {"loss_factor": 0.2}
    if core == "prony":
        losses = {"viscoelastic": {"prony": np.column_stack([SHARES, TIMES]).tolist()}}
    content = {
        "materials": {
            "steel": {"E": E, "nu": 0.0, "rho": RHO},
            "polymer": {"E": 2 * G, "nu": 0.0, "rho": RHO_CORE, **losses},
        },
        "regions": {"faces": {"material": "steel"}, "core": {"material": "polymer"}},
        "interfaces": {"tip": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
    }
    import_description(content, "sandwich", tmp_path / "a.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "a.h5", (5, 1500), 1e-4, inputs=["tip.fz"])
    assert rom.met and rom.kind == "certified"
    f = np.arange(5.0, 1500.0, 0.05)
    shear = np.full(len(f), G * (1 + 0.2j))
    if core == "prony":
        z = 1j * TWO_PI * f[:, None] * np.array(TIMES)
        shear = G * (1 + (z / (1 + z)) @ np.array(SHARES) / (1 - sum(SHARES)))
    z = rom.outputs.index("tip.fz")
    ours = peaks(f, rom.transfer(TWO_PI * f)[:, z, 0])
    theirs = peaks(f, tip_by_theory(f, shear))
    assert len(ours) == len(theirs) >= 3
    for (at, loss), (other, other_loss) in zip(ours, theirs, strict=True):
        assert at == pytest.approx(other, rel=0.002)
        assert loss == pytest.approx(other_loss, rel=0.01)


def test_two_layers_against_code_aster(tmp_path: Path) -> None:
    """Test V2.02.151 of Code_Aster: a steel strip, eta 0.001, with a layer whose modulus and loss
    factor are tables by frequency, clamped at the steel's edge. Its three bending modes and their
    dampings within its tolerances: 1, 1 and 2 %, 12, 10 and 10 %. The layer is up to twenty times
    stiffer than in K: a tolerance of 1e-5 takes many Krylov blocks."""
    length, width, strip, layer = 0.15, 0.01, 0.001, 0.002
    mesh = box("hexahedron20", (30, 2, 3), (length, width, strip + layer), distort=False)
    points = mesh.points - mesh.points.min(axis=0)
    low = points[mesh.cells[0].data].mean(axis=1)[:, 2] < strip
    mesh.cell_sets = {"strip": [np.flatnonzero(low)], "layer": [np.flatnonzero(~low)]}
    edge = (points[:, 0] < 1e-9) & (points[:, 2] < strip * (1 + 1e-9))
    mesh.point_sets["edge"] = np.flatnonzero(edge)
    table = {
        "hz": [1, 10, 50, 100, 500, 1000, 1500],
        "storage": [23.2e6, 58e6, 145e6, 203e6, 348e6, 435e6, 464e6],
        "loss_factor": [1.1, 0.85, 0.7, 0.6, 0.4, 0.35, 0.34],
    }
    content = {
        "materials": {
            "steel": {"E": 210e9, "nu": 0.3, "rho": 7800.0, "loss_factor": 1e-3},
            "elastomer": {"nu": 0.45, "rho": 1200.0, "viscoelastic": {"table": table}},
        },
        "regions": {"strip": {"material": "steel"}, "layer": {"material": "elastomer"}},
        "interfaces": {"tip": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "edge"}},
    }
    import_description(content, "V2.02.151", tmp_path / "a.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "a.h5", (1, 1500), 1e-5, inputs=["tip.fz"])
    assert rom.met and rom.kind == "certified"
    found = []
    for guess in (33.0, 211.0, 600.0):
        square = (TWO_PI * guess) ** 2 + 0j
        for _ in range(20):  # the matrices are those of the mode's own frequency
            K = rom.system.complex_stiffness(np.sqrt(square.real))
            squares = sl.eigvals(K, rom.M)
            square = squares[np.argmin(np.abs(squares - square))]
        found.append((np.sqrt(square.real) / TWO_PI, square.imag / square.real / 2))
    theirs = [(33.093, 0.011782), (211.356, 0.018138), (601.643, 0.018834)]
    for (f, damping), (at, other), (near, near_damping) in zip(
        found, theirs, [(0.01, 0.12), (0.01, 0.1), (0.02, 0.1)], strict=True
    ):
        assert f == pytest.approx(at, rel=near)
        assert damping == pytest.approx(other, rel=near_damping)


def test_sandwich_against_ross_kerwin_ungar(tmp_path: Path) -> None:
    """A simply supported sandwich: complex bending stiffness B = E H³/6 (1 + Y g/(1 + g)) at the
    wave number k of each mode, Y = 3 (1 + h/H)², g = 2 G (1 + iη)/(E H h k²) (Ross, Kerwin, Ungar
    1959, of equal faces). Three frequencies are within 0.2 %, loss factors within 1 %. The
    theory leaves out the rotary inertia, which is more in the fourth."""
    mesh = box("hexahedron20", (40, 1, 5), (LENGTH, WIDTH, 2 * FACE + CORE), distort=False)
    points = mesh.points - mesh.points.min(axis=0)
    middle = points[mesh.cells[0].data].mean(axis=1)[:, 2]
    inner = (middle > FACE) & (middle < FACE + CORE)
    mesh.cell_sets = {"faces": [np.flatnonzero(~inner)], "core": [np.flatnonzero(inner)]}
    at_end = np.minimum(points[:, 0], LENGTH - points[:, 0]) < 1e-9
    half = np.abs(points[:, 0] - LENGTH / 2) < 1e-9
    mesh.point_sets |= {
        "ends": np.flatnonzero(at_end),
        "every": np.arange(len(points)),
        "half": np.flatnonzero(half),
        "load": np.flatnonzero(np.abs(points[:, 0] - 0.15 * LENGTH) < 1e-9),
    }
    content = {
        "materials": {
            "steel": {"E": E, "nu": 0.0, "rho": RHO},
            "polymer": {"E": 2 * G, "nu": 0.0, "rho": RHO_CORE, "loss_factor": 0.5},
        },
        "regions": {"faces": {"material": "steel"}, "core": {"material": "polymer"}},
        "interfaces": {"load": {"coupling": "distributing", "nodes": "load"}},
        "supports": {
            "ends": {"nodes": "ends", "components": ["z"]},
            "plane": {"nodes": "every", "components": ["y"]},
            "along": {"nodes": [int(np.flatnonzero(half)[0])], "components": ["x"]},
        },
    }
    import_description(content, "sandwich", tmp_path / "a.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "a.h5", (5, 1500), 1e-4, inputs=["load.fz"])
    assert rom.met and rom.kind == "certified"
    squares = sl.eigvals(rom.system.complex_stiffness(0.0), rom.M)
    mass = 2 * RHO * FACE + RHO_CORE * CORE
    for n in range(1, 4):
        k = n * np.pi / LENGTH
        g = 2 * G * (1 + 0.5j) / (E * FACE * CORE * k * k)
        bending = E * FACE**3 / 6 * (1 + 3 * (1 + CORE / FACE) ** 2 * g / (1 + g))
        square = bending * k**4 / mass
        nearest = squares[np.argmin(np.abs(squares - square))]
        assert np.sqrt(nearest.real) == pytest.approx(np.sqrt(square.real), rel=0.002)
        assert nearest.imag / nearest.real == pytest.approx(square.imag / square.real, rel=0.01)
