"""Where the stress of a body is largest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_mesh_loads import sided, write_body

from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.body.stress import von_mises
from flexgram.simulation.hot_spots import hot_spots


def test_hot_spots(tmp_path: Path) -> None:
    """A bar that is held at one end and bent at the other: the largest is where the stress of the
    field is largest at the spot's own frequency, and spots keep their distance."""
    mesh = sided("tetra10", counts=(8, 3, 3))
    body, rom_file = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_body(
        body,
        mesh,
        damping={"beta": 1e-6},
        outputs={},
        loads={"gas": {"type": "pressure", "nodes": "side"}},
        supports={"start": {"nodes": "start"}},
    )
    run(
        "reduce", "-body", body, "-mor_band_hz", "10,4000", "-mor_tol", "1e-3", "-mor_out", rom_file
    )
    rom = ReducedModel.load(rom_file)
    spots = hot_spots(rom, 4, apart=0.02)
    assert 1 < len(spots) <= 4 and spots[0].share == pytest.approx(1)
    places = np.array([spot.place for spot in spots])
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    assert apart[np.triu_indices(len(spots), 1)].min() > 0.02
    for spot in hot_spots(rom, 1, inputs=["gas.p"]) + hot_spots(rom, 1, inputs=["end.fy"]):
        w = 2 * np.pi * spot.hertz
        j = rom.inputs.index(spot.input)
        q = np.linalg.solve(rom.K + 1j * w * rom.D - w * w * rom.M, rom.B[:, j])
        parts = [von_mises(rom.stress(part, body)[0]) for part in (q.real, q.imag)]
        amplitude = np.hypot(*parts)
        assert spot.stress == pytest.approx(np.nanmax(amplitude), rel=1e-9)
        assert spot.node == int(np.nanargmax(amplitude)) + 1
        assert np.allclose(spot.place, mesh.points[spot.node - 1])
    assert abs(hot_spots(rom, 1, inputs=["end.fy"])[0].place[0] - mesh.points[:, 0].min()) < 0.02
    said = run("hotspots", rom_file, "--count", "2").out
    assert f"spot1: {{type: stress, nodes: [{spots[0].node}]}}" in said
    at = ",".join(f"{x:.8g}" for x in spots[0].place)
    assert f"of files in SI:\n  --measure spot1=stress:AT:{at}\n" in said
    still = hot_spots(rom, 1, inputs=["end.fy"], hertz=0.0)[0]
    q = np.linalg.solve(rom.K, rom.B[:, rom.inputs.index("end.fy")])
    of_nodes = von_mises(rom.stress(q, body)[0])
    assert still.hertz == 0 and still.stress == pytest.approx(np.nanmax(of_nodes), rel=1e-9)
    said = run("hotspots", rom_file, "--count", "1", "--input", "end.fy", "--hz", "0").out
    assert f"{still.stress:.4g} N/m² per N of end.fy, at 0 Hz" in said
    assert "nothing is claimed of these numbers" in said
    with pytest.raises(BodyError, match="there is no input gas"):
        hot_spots(rom, inputs=["gas"])
    with pytest.raises(BodyError, match="must be a distance"):
        hot_spots(rom, apart=float("nan"))
    rom.inputs[-1] = "gas.T"
    with pytest.raises(BodyError, match="temperatures have no hot spots"):
        hot_spots(rom, inputs=["gas.T"])


def test_gravity_strains_no_free_body(tmp_path: Path) -> None:
    """What rounding leaves of such a load is no hot spot."""
    body, rom_file = tmp_path / "body.h5", tmp_path / "rom.h5"
    loads = {"g": {"type": "acceleration"}}
    mesh = sided("tetra10", counts=(8, 3, 3))
    write_body(body, mesh, damping={"beta": 1e-6}, outputs={}, loads=loads)
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "500,8000",
        "-mor_tol",
        "1e-2",
        "-mor_out",
        rom_file,
    )
    rom = ReducedModel.load(rom_file)
    assert "g.ax" in rom.inputs and rom.frame.rigid_modes == 6
    assert not {spot.input for spot in hot_spots(rom, 20, apart=0.0)} & {"g.ax", "g.ay", "g.az"}
    with pytest.raises(BodyError, match="move the free body as a whole, and strain nothing"):
        hot_spots(rom, 1, inputs=["g.ax"])
