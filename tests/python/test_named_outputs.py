"""Outputs that are kinds of their own, effective masses, rigid bodies, loss factors, inputs."""

from __future__ import annotations

import warnings
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from test_mesh_loads import sided

from bodies import box
from conftest import CLAMPED, body_system, message, run
from flexgram import BodyError, ReducedModel
from flexgram.body.damping import rayleigh
from flexgram.body.description import import_description
from flexgram.model.equivalent_damping import with_viscous_damping
from flexgram.simulation.expressions import between_times


def test_numbers_that_are_no_frequency_and_no_force(held: Path) -> None:
    model = ReducedModel.load(held / "box.rom.h5")
    for omega in (np.nan, np.inf, 1 + 1j, [1.0, np.nan]):
        with pytest.raises(BodyError, match="finite real numbers"):
            model.transfer(omega)
    model.eta = 0.0
    u = np.ones((3, len(model.inputs)))
    for wrong in (u * np.nan, u * np.inf, u * 1j):
        with pytest.raises(BodyError, match="NaN, infinite or complex"):
            model.simulate(wrong, [0, 1e-3, 2e-3])
    failed = run(
        *("frf", held / "box.rom.h5", "--pair", "end.fx=end.fx", "--hz", "10,20,2.5"),
        *("-o", held / "f.csv"),
        expect=1,
    )
    assert "whole number" in message(failed)


def test_a_force_above_the_band_is_told(viscous: Path, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "s.csv")
    sampled = run(
        *("simulate", viscous, "--force", "end.fx=sin(2*pi*20000*t)"),
        *("--time", "0,0.01,201", *out),
    )
    assert "moves between the times" in sampled.out
    fine = run(
        *("simulate", viscous, "--force", "end.fx=sin(2*pi*20000*t)"),
        *("--time", "0,0.01,4001", *out),
    )
    assert "lies above the band" in fine.out and "moves between" not in fine.out
    assert between_times("t > 0.5", np.linspace(0, 1, 11)) is None


def test_a_damping_ratio_at_two_frequencies(held: Path, tmp_path: Path) -> None:
    alpha, beta = rayleigh("2%,100,1000")
    for hz in (100, 1000):
        w = 2 * np.pi * hz
        assert alpha / (2 * w) + beta * w / 2 == pytest.approx(0.02)
    meshio.write(tmp_path / "box.vtu", box("hexahedron", (4, 2, 2)))
    done = run(
        *("import", tmp_path / "box.vtu", "--material", "steel", "--zeta", "2%,100,1000"),
        *("--rigid", "p=BOX:-1,-1,-1,0.001,1,1", "-o", tmp_path / "b.h5"),
    )
    assert f"alpha = {alpha:g}" in done.out
    with pytest.raises(BodyError, match="expected a ratio"):
        rayleigh("2,100,100")


def test_a_loss_factor_is_told_and_replaced(held: Path, tmp_path: Path) -> None:
    """At the import; in the file; and by viscous damping whose error is that of H."""
    assert "exists in frequency only" in run("info", held / "box.h5").out
    model = ReducedModel.load(held / "box.rom.h5")
    assert model.eta == 0.01
    for kind, largest in (("modal", 0.02), ("rayleigh", 0.5)):
        viscous, error = with_viscous_damping(model, kind)
        assert viscous.eta == 0 and 0 < error < largest
        inside = model.modes[model.modes < model.band[1]]
        w = np.concatenate([inside, np.linspace(*model.band, 40)])
        H, other = model.transfer(w), viscous.transfer(w)
        true = np.linalg.norm(other - H, axis=(1, 2)) / np.linalg.norm(H, axis=(1, 2))
        assert true.max() < 1.2 * error
        assert "loss factor" in viscous.provenance.warnings[-1]
    failed = run("export", held / "box.rom.h5", "--to", "fmu", "-o", tmp_path / "b.fmu", expect=1)
    assert "structural damping" in message(failed)
    done = run(
        *("export", held / "box.rom.h5", "--to", "state-space", "--damping", "modal"),
        *("-o", tmp_path / "b.mat"),
    )
    assert "instead of eta = 0.01 changes H by up to" in done.out
    with pytest.raises(BodyError, match="no loss factor"):
        with_viscous_damping(viscous)


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_output_may_be_a_kind_of_its_own(ranks: int, tmp_path: Path) -> None:
    """A row that is small beside others of its kind keeps the tolerance that it has by name."""
    mesh = sided("hexahedron", counts=(6, 2, 2))
    body = tmp_path / "box.h5"
    outputs = {"foot": {"type": "reaction", "nodes": "start"}}
    import_description(
        CLAMPED | {"outputs": outputs, "damping": {"alpha": 20.0}}, "box", body, mesh=mesh
    )
    rom = tmp_path / "rom.h5"
    options = ["-mor_band_hz", "200,4000", "-mor_tol", 1e-2, "-mor_out", rom]
    run("reduce", "-body", body, *options, "-mor_tol_kind", "foot.rz=1e-4", ranks=ranks)
    model = ReducedModel.load(rom)
    claims = dict(zip(model.claim.kinds, model.claim.by_kind, strict=True))
    named = {kind: e for kind, e in claims.items() if kind.startswith("foot.rz from")}
    assert set(named) == {"foot.rz from force", "foot.rz from moment"}
    assert max(named.values()) <= 1e-4
    full = body_system(body)
    with h5py.File(tmp_path / "box.assembled.h5") as file:
        names = [[str(x) for x in file[k].attrs["names"]] for k in "CB"]
    row = names[0].index("foot.rz")
    for kind, letter in (("force", "f"), ("moment", "m")):
        columns = [k for k, name in enumerate(names[1]) if f".{letter}" in name]
        for hz in (250.0, 1234.5, 2777.0, 3900.0):
            H = full.transfer(2 * np.pi * hz)[row, columns]
            ours = model.transfer(2 * np.pi * hz)[row, columns]
            assert np.linalg.norm(ours - H) <= named[f"foot.rz from {kind}"] * np.linalg.norm(H)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        from flexgram.simulation.histories import judge

        t = np.linspace(0, 0.01, 101)
        judge(model, t, np.outer(np.sin(2 * np.pi * 1000 * t), np.eye(len(model.inputs))[0]))
    failed = run("reduce", "-body", body, *options, "-mor_tol_kind", "foot.rq=1e-4", expect=1)
    assert "there is no output foot.rq" in message(failed)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_body_that_is_rigid_as_a_whole(ranks: int, tmp_path: Path) -> None:
    """A rigid interface that holds every node: six modes, and H of the rigid body's mass."""
    mesh = box("hexahedron", (2, 2, 2))
    mesh.point_sets["all"] = np.arange(len(mesh.points))
    ends = {"interfaces": {"a": {"coupling": "rigid", "nodes": "all", "position": [0, 0, 0]}}}
    free = {key: value for key, value in CLAMPED.items() if key != "supports"}
    import_description(free | ends, "box", tmp_path / "b.h5", mesh=mesh)
    rom = tmp_path / "rom.h5"
    run(
        *("reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "10,500", "-mor_out", rom),
        ranks=ranks,
    )
    model = ReducedModel.load(rom)
    assert model.order == 6 and model.claim.kind == "certified" and model.claim.whole < 1e-9
    with h5py.File(rom) as file:
        mass = file["frame/M_r"][:]
    w = 2 * np.pi * 100.0
    assert np.allclose(model.transfer(w) @ mass, -np.eye(6) / w**2, atol=1e-9 / w**2)


def test_effective_masses_and_principal_stresses(tmp_path: Path) -> None:
    """Of all modes of a clamped bar they add up to its moving mass, and those of a bar along x to
    8/((2k - 1)² π²) of it; principal stresses are the tensor's eigenvalues."""
    from flexgram.body.stress import principal, signed_von_mises, von_mises

    mesh = box("hexahedron20", (10, 2, 2), distort=False)
    loads = {"gravity": {"type": "acceleration"}}
    body = tmp_path / "b.h5"
    import_description(CLAMPED | {"loads": loads}, "bar", body, mesh=mesh)
    rom = tmp_path / "rom.h5"
    run(
        *("reduce", "-body", body, "-mor_band_hz", "100,60000", "-mor_tol", 1e-3),
        *("-mor_out", rom),
    )
    out = tmp_path / "modes.csv"
    said = run("modes", rom, "-o", out).out
    assert "effective mass of these modes in x, y, z" in said
    table = np.genfromtxt(out, delimiter=",", names=True)
    columns = [name for name in table.dtype.names if name.startswith("effective")]
    masses = np.array([table[name] for name in columns]).T
    with h5py.File(body) as file:
        from flexgram.body.whole import mass_facts

        mass = mass_facts(file).mass
    assert np.all(masses.sum(axis=0) < 1.0001 * mass) and masses[:, 0].sum() > 0.8 * mass
    first = masses[:, 0].max()
    assert first == pytest.approx(8 / np.pi**2 * mass, rel=0.02)
    run("report", rom, "-o", tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "effective masses" in page and f"<td class=n>{first:.4g}</td>" in page
    rng = np.random.default_rng(1)
    s = rng.normal(size=(7, 6))
    for six, values in zip(s, principal(s), strict=True):
        xx, yy, zz, xy, yz, zx = six
        tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        assert np.allclose(np.sort(np.linalg.eigvals(tensor).real), values[::-1])
    s = np.vstack([s, 1e-9 * s, 1e9 * rng.normal(size=(5000, 6))])
    assert np.allclose(np.abs(signed_von_mises(s)), von_mises(s))
    largest, _, least = principal(s).T
    assert np.array_equal(signed_von_mises(s) > 0, np.abs(largest) > np.abs(least))
    assert signed_von_mises([[0, 0, 0, 100.0, 0, 0], [0, 0, -5.0, 0, 0, 0]])[1] == -5
    assert np.isnan(principal(np.full(6, np.nan))).all()
