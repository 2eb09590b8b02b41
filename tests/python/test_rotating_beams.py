"""Beams and solids that turn: flap and chord over the speed, by other methods and published."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
from scipy.sparse.linalg import eigsh
from test_preload import RHO, E, gyroscopic_frequencies, import_beam, line, modes

from bodies import box
from conftest import assembled
from flexgram.body.description import import_description


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("hub", "speed", "published"),
    [  # Wright et al. 1982; Hodges and Rutkowski 1981
        (0.0, 6.0, [7.3604]),
        (0.0, 12.0, [13.1702, 37.6031, 79.6145]),
        (1.0, 12.0, [19.7215, 51.0701, 98.5268]),
    ],
)
def test_flap_of_a_rotating_beam(
    hub: float, speed: float, published: list[float], ranks: int, tmp_path: Path
) -> None:
    side, length = 2e-3, 1.0  # so slender that shear and rotary inertia do not matter
    unit = np.sqrt(E * side**2 / 12 / RHO) / length**2
    turn = {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}
    import_beam(
        tmp_path / "body.h5",
        line(80, hub, length),
        side,
        loads={"turn": turn},
        preload={"turn.spin": (speed * unit) ** 2},
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    assert a["names"] == [f"end.{c}" for c in ("fx", "fy", "fz", "mx", "my", "mz")]
    flap = modes(a, 2, len(published))
    np.testing.assert_allclose(flap / unit, published, rtol=1e-3)
    # In the plane of the rotation the spin softens by Ω² exactly, without Coriolis forces.
    lag = modes(a, 1, len(published))
    np.testing.assert_allclose(lag**2, flap**2 - (speed * unit) ** 2, rtol=1e-4)


def chord_by_ritz(speed: float, slenderness: float, shear: bool) -> Any:
    """Frequencies of a rotating cantilever in its plane, of Euler and Bernoulli or with a turning
    section and shear, over √(EI/ρA)/L²: polynomials of degree 14."""
    degree = 14
    x, w = (np.polynomial.legendre.leggauss(40)[k] / 2 for k in (0, 1))
    x = x + 0.5
    powers = [np.polynomial.Legendre.basis(k, domain=[0, 1]) for k in range(degree)]
    root = np.polynomial.Polynomial([0, 1])

    def values(clamps: int, derivative: int) -> Any:
        shapes = [p.convert(kind=np.polynomial.Polynomial) * root**clamps for p in powers]
        return np.array([p.deriv(derivative)(x) if derivative else p(x) for p in shapes])

    def product(f: Any, g: Any, factor: Any = 1.0) -> Any:
        return (f * (w * factor)) @ g.T

    u, du = values(1, 0), values(1, 1)
    tension, none = speed**2 * (1 - x**2) / 2, np.zeros((degree, degree))
    along = slenderness**2 * product(du, du) - speed**2 * product(u, u)
    if shear:  # v, θ of the same shapes
        s, rotary = 13 / 15.3 / 2.6 * slenderness**2, product(u, u) / slenderness**2
        across = s * product(du, du) + product(du, du, tension) - speed**2 * product(u, u)
        coupled = -s * product(du, u)
        turn = product(du, du) + s * product(u, u)
        K = np.block([[along, none, none], [none, across, coupled], [none, coupled.T, turn]])
        M = sl.block_diag(product(u, u), product(u, u), rotary)
        mixed = product(u, u)
    else:
        v, dv, ddv = (values(2, k) for k in range(3))
        across = product(ddv, ddv) + product(dv, dv, tension) - speed**2 * product(v, v)
        K, M = sl.block_diag(along, across), sl.block_diag(product(u, u), product(v, v))
        mixed = product(u, v)
    G = np.zeros_like(M)
    G[:degree, degree : 2 * degree] = -2 * speed * mixed
    G[degree : 2 * degree, :degree] = 2 * speed * mixed.T
    return gyroscopic_frequencies(K, M, G)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("speed", "published"), [(2, 3.6195), (6, 4.2393), (10, 4.97), (50, 7.3362)]
)
def test_chord_of_a_rotating_beam(
    speed: float, published: float, ranks: int, tmp_path: Path
) -> None:
    """With its Coriolis coupling (Hamza-Cherif and Houmat, slenderness 70, without shear). A Ritz
    method finds their numbers, and with shear and rotary inertia those of the elements."""
    slenderness = 70.0
    np.testing.assert_allclose(chord_by_ritz(speed, slenderness, False)[0], published, rtol=4e-4)
    side, turn = np.sqrt(12) / slenderness, {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}
    unit = np.sqrt(E * side**2 / 12 / RHO)
    import_beam(
        tmp_path / "body.h5",
        line(300, 0, 1.0),
        side,
        loads={"turn": turn},
        preload={"turn.spin": (speed * unit) ** 2},
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    plane = np.isin(a["component"], [0, 1, 5])
    K, M, G = (a[name].toarray()[np.ix_(plane, plane)] for name in "KMG")
    assert abs(G + G.T).max() == 0
    found = gyroscopic_frequencies(K, M, G)[:3] / unit
    np.testing.assert_allclose(found, chord_by_ritz(speed, slenderness, True)[:3], rtol=1e-3)


#: Hamza-Cherif and Houmat, slenderness 70: speed, first flap, first chord with its Coriolis
#: coupling, all over √(EI/ρA)/L².
ROTATING = [
    (2, 4.1373, 3.6195),
    (4, 5.5850, 3.888),
    (6, 7.3603, 4.2393),
    (8, 9.2568, 4.6105),
    (10, 11.2023, 4.97),
    (50, 51.0805, 7.3362),
]


@pytest.mark.parametrize(("speed", "flap", "chord"), ROTATING)
def test_published_beams(speed: float, flap: float, chord: float, tmp_path: Path) -> None:
    """Beams stiff in shear, as theirs are: to 0.1 %."""
    side = np.sqrt(12) / 70
    unit, own = np.sqrt(E * side**2 / 12 / RHO), side**4 / 12
    stiff = {"shape": "general", "A": side**2, "I_y": own, "I_z": own, "J": 2 * own}
    import_beam(
        tmp_path / "body.h5",
        line(100, 0, 1.0),
        side,
        sections={"bar": stiff | {"k_y": 1e4, "k_z": 1e4}},
        loads={"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}},
        preload={"turn.spin": (speed * unit) ** 2},
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    out = np.isin(a["component"], [2, 4])
    K, M = (a[name].toarray()[np.ix_(out, out)] for name in "KM")
    found = np.sqrt(sl.eigh(K, M, eigvals_only=True)[0]) / unit
    np.testing.assert_allclose(found, flap, rtol=1e-3)
    plane = np.isin(a["component"], [0, 1, 5])
    K, M, G = (a[name].toarray()[np.ix_(plane, plane)] for name in "KMG")
    np.testing.assert_allclose(gyroscopic_frequencies(K, M, G)[0] / unit, chord, rtol=1e-3)


@pytest.mark.parametrize(
    ("hub", "speed", "published"),
    [(0, 12, (13.1702, 37.6031, 79.6145)), (1, 12, (19.7215, 51.0701, 98.5268))],
)
@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "tetra10"])
def test_flap_of_rotating_solids(
    kind: str, hub: float, speed: float, published: tuple[float, ...], tmp_path: Path
) -> None:
    """A hundred times as long as thick, to what the mesh gives; numbers as of the beams."""
    count = {"hexahedron": 60, "hexahedron20": 30, "tetra10": 40}[kind]
    mesh = box(kind, (count, 1, 1), (1.0, 0.01, 0.01), distort=False)
    mesh.points = mesh.points + np.array([hub, -0.005, -0.005])
    unit = np.sqrt(E * 0.01**2 / 12 / RHO)
    content = {
        "materials": {"steel": {"E": E, "nu": 0.3, "rho": RHO}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "loads": {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}},
        "preload": {"turn.spin": (speed * unit) ** 2},
    }
    import_description(content, "blade", tmp_path / "body.h5", mesh=mesh)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    squares, shapes = eigsh(a["K"], 10, a["M"], sigma=0)
    squares, shapes = np.sort(squares), shapes[:, np.argsort(squares)]
    across = [abs(shapes[a["component"] == c]).max(axis=0) for c in range(3)]
    found = np.sqrt(squares[np.argmax(across, axis=0) == 2])[: len(published)] / unit
    np.testing.assert_allclose(found, published, rtol=4e-3)
