"""Stress and strain of shells as outputs: strips, plates, laminates in closed form; claims."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from test_shells import FOAM, KINDS, PLY, STEEL, write

import flexgram
from conftest import assembled, body_system, run
from flexgram import BodyError
from flexgram.body.shell_stress import SIDES
from sheets import flat, sheet

CLAMP = {"clamp": {"nodes": "start", "components": ["x", "y", "z", "rx", "ry", "rz"]}}
PORT = {"port": {"coupling": "node", "nodes": "middle"}}
S = ("sxx", "syy", "szz", "sxy", "syz", "szx")


def outputs_under(folder: Path, load: str, ranks: int = 1) -> dict[str, float]:
    """Outputs by name under the load."""
    run("assemble", "-body", folder / "b.h5", "-body_out", folder / "m.h5", ranks=ranks)
    system, (inputs, outputs) = body_system(folder / "m.h5"), names(folder / "m.h5")
    u = spl.spsolve(sp.csc_matrix(system.K), np.asarray(system.B)[:, inputs.index(load)])
    return dict(zip(outputs, np.asarray(system.C) @ u, strict=True))


def names(path: Path) -> tuple[list[str], list[str]]:
    """Of inputs and outputs."""
    with h5py.File(path) as file:
        return tuple([str(n) for n in file[which].attrs["names"]] for which in ("B", "C"))


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("offset", [0.0, 0.004])
@pytest.mark.parametrize("kind", KINDS)
def test_a_cantilever(kind: str, offset: float, ranks: int, tmp_path: Path) -> None:
    """A strip under a moment and a pull at its end, on a slope in space: 6M/(bt²) ± N/(bt) on its
    sides, N/(bt) between, strain of a gauge along it and across."""
    slope = np.array([[0.8, 0, -0.6], [0, 1, 0], [0.6, 0, 0.8]])  # x along (0.8, 0, 0.6)
    b, t, moment, pull = 0.04, 0.008, 5.0, 300.0
    mesh = sheet(kind, (12, 4), flat(0.3, b), 0.2)
    mesh.points = mesh.points @ slope.T
    share = np.array([0.5, 1, 1, 1, 0.5]) / 4
    along, axis = slope[:, 0], slope[:, 1]
    turn = moment * axis + pull * offset * np.cross(slope[:, 2], along)
    rows = [[n + 1, *(w * pull * along), *(w * turn)]
            for n, w in zip(mesh.point_sets["end"], share, strict=True)]  # fmt: skip
    at = {"nodes": "middle"}
    facts = write(
        tmp_path / "b.h5", mesh, {"thickness": t, "offset": offset}, {**STEEL, "nu": 0.0},
        supports=CLAMP, interfaces=PORT,
        loads={"end": {"type": "nodal", "table": rows}},
        outputs={
            **{side: {"type": "stress", **at, "side": side} for side in SIDES},
            "two": {"type": "stress", "elements": [20, 21], "side": "top"},
            "one": {"type": "stress", "elements": [20], "integration_point": 2, "side": "top"},
            "gauge": {"type": "gauge", **at, "direction": along.tolist(), "side": "bottom"},
            "across": {"type": "gauge", **at, "direction": axis.tolist(), "side": "bottom"},
        },
    )  # fmt: skip
    assert re.fullmatch(r"stress at the node at \(.*\) m, top side", facts["outputs"]["top"])
    found = outputs_under(tmp_path, "end.load", ranks)
    stretch, bend = pull / (b * t), 6 * moment / (b * t**2)
    for name, expected in {
        "top": stretch + bend, "middle": stretch, "bottom": stretch - bend,
        "two": stretch + bend, "one": stretch + bend,
    }.items():  # fmt: skip
        sigma = np.array([found[f"{name}.{c}"] for c in S])
        tensor = sigma[[[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
        np.testing.assert_allclose(
            tensor, expected * np.outer(along, along), atol=2e-6 * (stretch + bend), err_msg=name
        )
    assert found["gauge.e"] == pytest.approx((stretch - bend) / STEEL["E"], rel=1e-6)
    assert abs(found["across.e"]) < 1e-6 * bend / STEEL["E"]


@pytest.mark.parametrize(("kind", "near"), [("quad", 0.01), ("triangle", 0.02)])
def test_a_plate_under_pressure(kind: str, near: float, tmp_path: Path) -> None:
    """A square, simply supported: 6 · 0.0479 q a²/t² in its middle (Timoshenko, nu = 0.3)."""
    a, t = 1.0, 0.01
    turns = {"start": "rx", "end": "rx", "bottom": "ry", "top": "ry"}
    edges = {
        name: {"nodes": name, "components": ["x", "y", "z", turn]} for name, turn in turns.items()
    }
    at = {"nodes": "middle", "side": "top"}
    write(
        tmp_path / "b.h5", sheet(kind, (24, 24), flat(a, a)), {"thickness": t},
        supports=edges, interfaces=PORT,
        loads={"gas": {"type": "pressure", "nodes": "all"}},
        outputs={"s": {"type": "stress", **at},
                 "r": {"type": "gauge", **at, "direction": [1, 0, 0], "normal": [0, 0, 1]}},
    )  # fmt: skip
    found = outputs_under(tmp_path, "gas.p")
    sigma = 6 * 0.0479 * a**2 / t**2  # pressure pushes up and stretches the top side
    assert found["s.sxx"] == pytest.approx(sigma, rel=near)
    assert found["s.syy"] == pytest.approx(sigma, rel=near)
    strain = sigma * 0.7 / STEEL["E"]
    for name in ("e0", "e45", "e90"):
        assert found[f"r.{name}"] == pytest.approx(strain, rel=near)


def test_layers(tmp_path: Path) -> None:
    """Plies on foam under a pull: they bend, each with the stress of its own stiffness."""
    mesh = sheet("quad", (6, 2), flat(0.3, 0.05))
    share = zip(mesh.point_sets["end"], (0.25, 0.5, 0.25), strict=True)
    layers = [
        {"material": "ply", "thickness": 0.001, "angle": 90},
        {"material": "foam", "thickness": 0.010},
        {"material": "ply", "thickness": 0.001, "angle": 0},
    ]
    write(
        tmp_path / "b.h5", mesh, {},
        materials={"ply": {**PLY, "nu12": 0.0}, "foam": {**FOAM, "nu": 0.0}},
        sections={"sheet": {"shape": "shell", "layers": layers}},
        regions={"all": {"section": "sheet"}},
        supports=CLAMP,
        interfaces={"port": {"coupling": "node", "nodes": [20]}},
        loads={"pull": {"type": "nodal", "table": [[n + 1, w, 0, 0] for n, w in share]}},
        outputs={side: {"type": "stress", "nodes": "middle", "side": side} for side in SIDES},
    )  # fmt: skip
    found = outputs_under(tmp_path, "pull.load")
    E, t, z = np.array([[10e9, 1e8, 140e9], [0.001, 0.01, 0.001], [-0.0055, 0.0, 0.0055]])
    A, B, D = (0.05 * np.sum(E * x) for x in (t, t * z, t * z**2 + t**3 / 12))
    stretch, curvature = np.linalg.solve([[A, B], [B, D]], [1.0, 0.0])
    for side, modulus, height in (
        ("bottom", 10e9, -0.006),
        ("middle", 1e8, 0),
        ("top", 140e9, 0.006),
    ):
        expected = modulus * (stretch + height * curvature)
        assert found[f"{side}.sxx"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("ranks", [1, 2])
def test_claims_of_stress(ranks: int, tmp_path: Path) -> None:
    """Stress of both sides from pressure and from a force, at frequencies that were not given."""
    mesh = sheet("quad", (10, 6), lambda u, v: (0.4 * u, 0.25 * v, 0.05 * np.sin(2 * u) * v))
    sides = {
        side: {"type": "stress", "nodes": "corner", "side": side} for side in ("top", "bottom")
    }
    write(
        tmp_path / "b.h5", mesh, {"thickness": 0.003}, supports=CLAMP, interfaces=PORT,
        loads={"gas": {"type": "pressure", "nodes": "all"}}, outputs=sides,
        damping={"alpha": 5.0, "beta": 1e-6},
    )  # fmt: skip
    run(
        *("reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "5,500", "-mor_tol", "1e-3"),
        *("-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    )
    rom = flexgram.ReducedModel.load(tmp_path / "rom.h5")
    assert rom.certified_error <= 1e-3 and rom.claim.kind == "certified"
    run("assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5", ranks=ranks)
    full = body_system(tmp_path / "m.h5")
    inputs, outputs = names(tmp_path / "m.h5")
    stress = [k for k, name in enumerate(outputs) if ".s" in name]
    force = [k for k, name in enumerate(inputs) if ".f" in name]
    assert len(stress) == 12 and len(force) == 3
    for omega in 2 * np.pi * np.geomspace(5, 500, 23):
        H = full.transfer(omega).astype(complex)
        H_r = rom.transfer([omega])[0].astype(complex)
        for some in (force, [inputs.index("gas.p")]):
            part = np.ix_(stress, some)
            assert np.linalg.norm(H_r[part] - H[part]) <= 1e-3 * np.linalg.norm(H[part])


def folded() -> meshio.Mesh:
    return sheet("quad", (2, 4), lambda u, v: (u, np.minimum(2 * v, 1), np.maximum(2 * v - 1, 0)))


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"type": "stress", "nodes": [1]}, "name the side of the shell"),
        ({"type": "stress", "nodes": [1], "side": "left"}, "must be one of top, middle, bottom"),
        (
            {"type": "stress", "nodes": [3], "side": "top"},
            "at node 3 shells meet at an angle.*name elements, [0-9[].* of ",
        ),
        ({"type": "stress", "elements": [77], "side": "top"}, "there is no shell 77"),
        (
            {"type": "stress", "elements": [1], "side": "top", "integration_point": 5},
            "quad have the integration points 1 to 4",
        ),
        ({"type": "displacement", "nodes": [1], "side": "top"}, "displacement takes no side"),
    ],
)
def test_what_is_refused(entry: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        write(tmp_path / "b.h5", folded(), {"thickness": 0.1}, outputs={"s": entry})


def test_moments_of_a_table(tmp_path: Path) -> None:
    """Of another number of columns; in millimetres."""
    table = [[1, 0, 0, 0, 7.0, 0, 0]]
    mesh = sheet("quad", (2, 2), flat(100, 100))
    load = {"loads": {"turn": {"type": "nodal", "table": table}}, "units": "mm-t-s"}
    steel = {"E": 200e3, "nu": 0.3, "rho": 8e-9}
    write(tmp_path / "b.h5", mesh, {"thickness": 1.0}, steel, **load)
    a = assembled(tmp_path / "m.h5", tmp_path / "b.h5")
    turned = a["B"].T[a["names"].index("turn.load")]
    assert turned[(a["node"] == 0) & (a["component"] == 3)] == pytest.approx(7e-3)
    assert np.count_nonzero(turned) == 1
    load["loads"]["turn"]["table"] = [[1, 0, 0, 0, 0]]
    with pytest.raises(BodyError, match="a node number and 3 or 6 numbers"):
        write(tmp_path / "b.h5", mesh, {"thickness": 1.0}, steel, **load)
