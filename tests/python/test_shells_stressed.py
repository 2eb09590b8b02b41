"""Shells under stress and in bodies that spin: closed forms, and beams of the same strip."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
from test_preload import line
from test_shells import KINDS, SIX, STEEL, Sheet

from conftest import assembled
from flexgram.body.description import import_description
from sheets import flat, sheet


@pytest.mark.parametrize("force", [1e6, -4.5e5])
@pytest.mark.parametrize("kind", KINDS)
def test_a_plate_in_tension(kind: str, force: float, tmp_path: Path) -> None:
    """A simply supported plate under forces N along x: (2πf)² m = D (k² + l²)² + N k²; a third of
    what buckles it is taken from it."""
    a, b, t, count = 1.2, 0.8, 0.01, 32
    mesh = sheet(kind, (count, count), flat(a, b))
    D, m = STEEL["E"] * t**3 / 12 / 0.91, STEEL["rho"] * t
    share = np.full(count + 1, b / count)
    share[[0, -1]] /= 2
    pull = [[n + 1, s * w, 0, 0] for side, s in (("start", -1), ("end", 1))
            for n, w in zip(mesh.point_sets[side], share, strict=True)]  # fmt: skip
    edge = np.unique(
        np.concatenate([mesh.point_sets[s] for s in ("start", "end", "top", "bottom")])
    )
    sides = {"ends": ("start", "end"), "flanks": ("bottom", "top")}
    rotations = {"ends": "rx", "flanks": "ry"}
    supports = {"edge": {"nodes": (edge + 1).tolist(), "components": ["z"]}}
    for name, of in sides.items():
        nodes = np.union1d(*(mesh.point_sets[s] for s in of)) + 1
        supports[name] = {"nodes": nodes.tolist(), "components": [rotations[name]]}
    corners = [int(np.intersect1d(mesh.point_sets["start"], mesh.point_sets[s])[0]) + 1
               for s in ("bottom", "top")]  # fmt: skip
    supports["in_plane"] = {"nodes": corners[:1], "components": ["x", "y"]}
    supports["turn"] = {"nodes": corners[1:], "components": ["x"]}
    middle = {"middle": {"coupling": "node", "nodes": "middle"}}
    plate = Sheet(
        tmp_path, mesh, {"thickness": t}, interfaces=middle,
        supports=supports, loads={"pull": {"type": "nodal", "table": pull}},
        preload={"pull.load": force},
    )  # fmt: skip
    k, l = np.pi * np.arange(1, 4) / a, np.pi * np.arange(1, 4) / b  # noqa: E741
    square = D * np.add.outer(k**2, l**2) ** 2 + force * k[:, None] ** 2
    exact = np.sort(np.sqrt(square / m).ravel())[:3] / (2 * np.pi)
    unloaded = np.sort(np.sqrt(D * np.add.outer(k**2, l**2) ** 2 / m).ravel())[:3] / (2 * np.pi)
    assert abs(exact[0] / unloaded[0] - 1) > 0.15
    np.testing.assert_allclose(plate.hertz(3), exact, rtol=0.01 if kind == "quad" else 0.015)


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 1, 0], [0.0, 0.6, 0.8]])
def test_a_strip_that_spins(axis: list[float], tmp_path: Path) -> None:
    """A blade of shells, about axes along its normal, in its plane, and askew (where bending across
    it and in its plane are coupled), beside the same of beams."""
    length, width, t, hub = 1.0, 0.04, 0.008, 0.1
    spin = {"type": "spin", "point": [0, 0, 0], "axis": axis}
    speed = 250.0
    more = {
        "interfaces": {"end": {"coupling": "node", "nodes": [10]}},
        "loads": {"turn": spin},
        "preload": {"turn.spin": speed**2},
        "supports": {"clamp": {"nodes": "start", "components": SIX}},
        "materials": {"steel": {**STEEL, "nu": 0.0}},  # a beam's section keeps its shape
        "regions": {"all": {"material": "steel", "section": "bar"}},
    }
    mesh = sheet("quad", (40, 2), flat(length, width))
    mesh.points += [hub, -width / 2, 0.0]
    bar: dict[str, Any] = {"shape": "shell", "thickness": t}
    import_description(more | {"sections": {"bar": bar}}, "strip", tmp_path / "s.h5", mesh=mesh)
    strip = assembled(tmp_path / "s.m.h5", tmp_path / "s.h5")
    bar = {"shape": "rectangle", "width": width, "height": t}
    beams = line(40, hub, length)
    import_description(more | {"sections": {"bar": bar}}, "beam", tmp_path / "b.h5", mesh=beams)
    beam = assembled(tmp_path / "b.m.h5", tmp_path / "b.h5")
    G = strip["G"].toarray()
    np.testing.assert_allclose(G, -G.T, atol=1e-12 * abs(G).max())
    found, expected = lowest(strip, 5), lowest(beam, 5)
    np.testing.assert_allclose(found, expected, rtol=5e-3)
    without = lowest(strip | {"G": 0 * strip["G"]}, 5)
    assert axis[2] == 1 or np.max(abs(without / found - 1)) > 1e-3


def lowest(a: dict[str, Any], count: int) -> Any:
    """Angular frequencies, by the lowest sixty modes of K and M: of K x + iω G x − ω² M x = 0."""
    n = a["K"].shape[0]
    inverse, X = sl.eigh(a["M"].toarray(), a["K"].toarray(), subset_by_index=(n - 60, n - 1))
    X, values = X / np.sqrt(inverse), 1 / inverse
    G = X.T @ a["G"] @ X
    n = len(values)
    both = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(values), -G]])
    omega = sl.eigvals(both).imag
    return np.sort(omega[omega > 0])[:count]
