"""Hot spots of shells: both sides, folds, shells beside solids, and the same as outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import yaml
from test_shell_bodies import angle
from test_shells import KINDS, STEEL, write

from bodies import box
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.body.description import import_description
from flexgram.body.shell_field import ShellField
from flexgram.body.stress import von_mises
from flexgram.simulation.hot_spots import describe, hot_spots
from sheets import sheet

LOADS = {"gravity": {"type": "acceleration"}}
CLAMP = {"clamp": {"nodes": "bottom", "components": ["x", "y", "z", "rx", "ry", "rz"]}}


def reduced(path: Path, *options: Any) -> ReducedModel:
    rom = path.with_suffix(".rom.h5")
    run("reduce", "-body", path, "-mor_band_hz", "5,900", "-mor_tol", "1e-4", "-mor_out", rom)
    return ReducedModel.load(rom)


def amplitude(rom: ReducedModel, output: str, spot: Any) -> float:
    """Of the von Mises stress of an output under the spot's load, at its frequency."""
    H = rom.transfer([2 * np.pi * spot.hertz])[0][:, rom.inputs.index(spot.input)]
    six = np.zeros(6, complex)
    for k, pair in enumerate(("xx", "yy", "zz", "xy", "yz", "zx")):
        if f"{output}.s{pair}" in rom.outputs:
            six[k] = H[rom.outputs.index(f"{output}.s{pair}")]
    return float(np.hypot(von_mises(six.real[None]), von_mises(six.imag[None]))[0])


@pytest.mark.parametrize("kind", KINDS)
def test_spots_as_outputs(kind: str, tmp_path: Path) -> None:
    """A bracket, whose plates meet on an edge: the lines for the description give the same
    stresses, by rows that are certified."""
    mesh = angle(kind)
    tip = int(np.intersect1d(mesh.point_sets["end"], mesh.point_sets["top"])[0]) + 1
    more: dict[str, Any] = {
        "loads": LOADS,
        "supports": CLAMP,
        "damping": {"beta": 1e-6},
        "interfaces": {"tip": {"coupling": "node", "nodes": [tip]}},
    }
    write(tmp_path / "body.h5", mesh, {"thickness": 0.002}, **more)
    rom = reduced(tmp_path / "body.h5")
    spots = hot_spots(rom, 8, apart=0.015)
    assert spots[0].share == pytest.approx(1) and {spot.side for spot in spots} <= {"top", "bottom"}
    folded = [spot for spot in spots if spot.elements]
    z, y = mesh.points[:, 2], mesh.points[:, 1]
    for spot in spots:
        on_edge = abs(z[spot.node - 1]) < 1e-9 and abs(y[spot.node - 1] - 0.08) < 1e-9
        assert bool(spot.elements) == on_edge
    assert folded
    lines = describe(spots)
    outputs = yaml.safe_load("\n".join(lines[lines.index("outputs:") :]))["outputs"]
    assert len(outputs) == len(spots)
    write(tmp_path / "again.h5", mesh, {"thickness": 0.002}, outputs=outputs, **more)
    again = reduced(tmp_path / "again.h5")
    for k, spot in enumerate(spots, 1):
        assert amplitude(again, f"spot{k}", spot) == pytest.approx(spot.stress, rel=2e-3)
    said = run("hotspots", tmp_path / "body.rom.h5", "--count", "8", "--apart", "0.015").out
    assert all(line in said for line in lines[:2]) and "side: " in said


def test_a_strip_in_pure_bending(tmp_path: Path) -> None:
    """A moment at its end: σ = 6M/(b t²) everywhere, pressed on one side, pulled on the other."""
    strip = sheet("quad", (12, 2), lambda u, v: (0.3 * u, 0.02 * v, 0.0))
    write(
        tmp_path / "body.h5",
        strip,
        {"thickness": 0.002},
        material={**STEEL, "nu": 0.0},
        interfaces={"end": {"coupling": "rigid", "nodes": "end"}},
        supports={"clamp": {"nodes": "start", "components": ["x", "y", "z", "rx", "ry", "rz"]}},
    )
    rom = reduced(tmp_path / "body.h5")
    from flexgram.model.geometry import Geometry

    with h5py.File(tmp_path / "body.h5") as file:
        field = ShellField.of(file)
    assert field.alone.all()
    q = np.linalg.solve(rom.K, rom.B[:, rom.inputs.index("end.my")])
    motion = Geometry.load(tmp_path / "body.h5").motion_and_rotation(rom, q)
    expected = 6 / (0.02 * 0.002**2)
    inside = strip.points[field.nodes, 0] < 0.26  # away from the rigid end
    top, bottom = (field.stress(motion, side)[0, inside, 0] for side in ("top", "bottom"))
    np.testing.assert_allclose(np.abs(top), expected, rtol=1e-3)
    np.testing.assert_allclose(top, -bottom, rtol=1e-9)


def test_shells_beside_solids(tmp_path: Path) -> None:
    """A soft block on a stiff sheet: each has spots, of solids without a side."""
    block = box("hexahedron", (4, 4, 2), (0.1, 0.1, 0.02), distort=False)
    plate = sheet("quad", (4, 4), lambda u, v: (0.1 * u, 0.1 * v, 0.0))
    before = len(block.points)
    none = np.empty(0, dtype=np.int64)
    mesh = meshio.Mesh(
        np.vstack([block.points, plate.points]),
        [*block.cells, ("quad", plate.cells[0].data + before)],
        point_sets={
            "start": np.append(block.point_sets["start"], plate.point_sets["start"] + before),
            "top": np.flatnonzero(block.points[:, 2] > 0.0199),
            "below": np.flatnonzero(block.points[:, 2] < 1e-9),
            "above": np.arange(before, before + len(plate.points)),
        },
        cell_sets={"one": [np.arange(32), none], "two": [none, np.arange(16)]},
    )
    import_description(
        {
            "materials": {"soft": {"E": 3e9, "nu": 0.3, "rho": 1200.0}, "steel": STEEL},
            "sections": {"thin": {"shape": "shell", "thickness": 0.003, "offset": -0.0015}},
            "regions": {
                "one": {"material": "soft"},
                "two": {"material": "steel", "section": "thin"},
            },
            "interfaces": {"tip": {"coupling": "distributing", "nodes": "top"}},
            "ties": {"glue": {"nodes": "below", "to": "above", "distance": 1e-4}},
            "supports": {"clamp": {"nodes": "start"}},
            "loads": {"gas": {"type": "pressure", "nodes": "top"}},
            "damping": {"beta": 1e-6},
        },
        "block on a sheet",
        tmp_path / "body.h5",
        mesh=mesh,
    )
    rom = reduced(tmp_path / "body.h5")
    spots = hot_spots(rom, 150, apart=0.0, inputs=["gas.p"])
    shells = [spot for spot in spots if spot.side]
    solids = [spot for spot in spots if not spot.side]
    assert shells and solids
    assert all(spot.node > before for spot in shells)
    assert all(spot.node <= before for spot in solids)
    assert max(spot.stress for spot in shells) > max(spot.stress for spot in solids)


def test_elements_that_a_node_names(tmp_path: Path) -> None:
    """The stress at a node of some of its elements, which must be there."""
    mesh = angle("quad")
    y, z = mesh.points[:, 1], mesh.points[:, 2]
    edge = np.flatnonzero((abs(z) < 1e-9) & (abs(y - 0.08) < 1e-9))
    node = int(edge[2])
    upright = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 2] > 1e-9
    around = (mesh.cells[0].data == node).any(axis=1)
    ids = (np.flatnonzero(around & upright) + 1).tolist()
    entry = {"type": "stress", "nodes": [node + 1], "elements": ids, "side": "top"}
    write(tmp_path / "body.h5", mesh, {"thickness": 0.002}, outputs={"a": entry})
    with h5py.File(tmp_path / "body.h5") as file:
        used = file["outputs/a/nodes"][:]
    assert set(used) == set(mesh.cells[0].data[around & upright].ravel())
    for change, words in (
        ({"elements": [10**6]}, "there is no shell 1000000"),
        ({"nodes": [1]}, "belongs to no shell that deforms"),
    ):
        with pytest.raises(BodyError, match=words):
            write(tmp_path / "b.h5", mesh, {"thickness": 0.002}, outputs={"a": entry | change})
