"""Functional mock-up units, by FMPy: valid, exact in co-simulation, the same system in model
exchange."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from test_superelements import reduced

import flexgram
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.assembly.couple import Joint, couple
from flexgram.body.matrices import Matrices
from flexgram.exporters import export

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi2 import FMU2Model, FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Model, FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

FORMATS = {"fmu": (FMU2Slave, FMU2Model), "fmu3": (FMU3Slave, FMU3Model)}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> ReducedModel:
    return reduced(tmp_path_factory.mktemp("fmu"), support=True)


class Unit:
    """An FMU, unpacked and instantiated: co-simulation (0) or model exchange (1)."""

    def __init__(self, path: Path, folder: Path, which: int, **start: float) -> None:
        self.version = "fmu3" if "fmu3" in path.name else "fmu"
        fmpy.extract(str(path), str(folder))
        description = fmpy.read_model_description(str(folder))
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        kind = description.modelExchange if which else description.coSimulation
        self.fmu = FORMATS[self.version][which](
            guid=description.guid,
            instanceName="x",
            modelIdentifier=kind.modelIdentifier,
            unzipDirectory=str(folder),
        )
        self.fmu.instantiate()
        for name, value in start.items():
            self.set([name], [value])
        if self.version == "fmu":
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, names: list[str], values: Any) -> None:
        where = [self.reference[name] for name in names]
        put = self.fmu.setReal if self.version == "fmu" else self.fmu.setFloat64
        put(where, [float(x) for x in values])

    def get(self, names: list[str]) -> Any:
        where = [self.reference[name] for name in names]
        return np.array((self.fmu.getReal if self.version == "fmu" else self.fmu.getFloat64)(where))

    def step(self, time: float, h: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=h)


def parameters_of(kind: str) -> tuple[str, tuple[float, ...], dict[str, Any]]:
    """A parameter's name, values of it, and the terms of a body of six coordinates."""
    T = sp.diags([1.0, 1.0, 0, 0, 0, 0]).tocsr()
    G = sp.csr_matrix(([1.0, -1.0], ([1, 2], [2, 1])), shape=(6, 6))
    law = flexgram.parameter(1.0, 5.0, 2.0, slope=0.5)
    if kind == "stiffness":
        return "k", (2.0, 1.0, 4.5), {"k": (T, law)}
    if kind == "relaxation":
        relaxing = flexgram.product(law, flexgram.prony([0.6, 0.2], [1.5, 20.0]))
        other = (sp.identity(6).tocsr(), flexgram.prony([0.01], [3.0]))
        return "k", (2.0, 1.0, 4.5), {"k": (T, law), "k:relaxation": (T, relaxing), "skin": other}
    if kind == "damper":
        law = flexgram.parameter(0.0, 2.0, 0.0)
        return "d", (0.0, 0.5, 2.0), {"d": (T, flexgram.product(law, flexgram.viscous()))}
    speeds = (0.1, 0.4, 0.2)
    terms = {
        "coriolis": (G, flexgram.coriolis(*speeds)),
        "spin": (-0.2 * T, flexgram.spin(*speeds)),
    }
    return "speed", (0.2, 0.1, 0.35), {**terms, "second": (T, flexgram.spin(*speeds, power=4))}


@pytest.mark.parametrize("version", FORMATS)
@pytest.mark.parametrize("kind", ["stiffness", "relaxation", "damper", "speed"])
def test_parameters_of_the_body(kind: str, version: str, tmp_path: Path) -> None:
    """They are the unit's: with values of them it answers as the body with these does, and values
    outside are refused."""
    n = 6
    K = sp.diags([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsr()
    name, values, terms = parameters_of(kind)
    given = Matrices(K, sp.identity(n).tocsr(), np.eye(n)[:, [0, 5]], inputs=["a.fx", "b.fx"],
                     alpha=0.01, beta=0.05, terms=terms)  # fmt: skip
    rom = flexgram.reduce(given, (0.01, 0.3), 1e-3)
    path = tmp_path / f"part.{version}.fmu"
    export(rom, path, version)
    assert validate_fmu(str(path)) == []
    t, h = np.linspace(0, 20, 41), 0.5
    outputs = [f"{port}.{rate}" for port in ("a.fx", "b.fx") for rate in ("motion", "acceleration")]
    reached = []
    for value in values:
        unit = Unit(path, tmp_path / f"{version}{value}", 0, **{name: value})
        assert unit.get([name])[0] == value
        y, _ = rom.at(**{name: value}).simulate(
            np.column_stack([np.ones(41), np.zeros(41)]), t, rates=("displacement", "acceleration")
        )
        unit.set(["a.fx"], [1.0])
        for k in range(40):
            unit.step(t[k], h)
        expected = y[-1][[0, 2, 1, 3]]
        assert np.allclose(unit.get(outputs), expected, rtol=1e-8, atol=1e-10)
        reached.append(expected)
    assert np.ptp(np.array(reached), axis=0).max() > 1e-3  # the parameter matters
    with pytest.raises(Exception, match="rror"):
        Unit(path, tmp_path / f"{version}wrong", 0, **{name: 5.5})


def test_gyroscopic_forces_are_no_damping(tmp_path: Path) -> None:
    """They stay where the unit's damping is taken away."""
    n = 4
    G = sp.csr_matrix(([0.5, -0.5], ([0, 1], [1, 0])), shape=(n, n))
    K = sp.diags([1.0, 1.2, 3.0, 4.0]).tocsr()
    B = np.eye(n)[:, :2]
    names = ["a.fx", "a.fy"]
    rom = flexgram.reduce(Matrices(K, sp.identity(n).tocsr(), B, D=G, inputs=names, beta=0.02),
                          (0.01, 0.1), 1e-3)  # fmt: skip
    export(rom, tmp_path / "spinning.fmu", "fmu")
    unit = Unit(tmp_path / "spinning.fmu", tmp_path / "unit", 0, damping_factor=0.0)
    unit.set(["a.fx"], [1.0])
    for k in range(10):
        unit.step(0.3 * k, 0.3)
    whole = np.block([[np.zeros((n, n)), np.eye(n)], [-K.toarray(), -G.toarray()]])
    load = np.linalg.solve(whole, np.r_[np.zeros(n), B[:, 0]])
    moved = (scipy.linalg.expm(3.0 * whole) @ load - load)[:2]
    assert abs(moved[1]) > 0.1
    assert np.allclose(unit.get([f"{name}.motion" for name in names]), moved, rtol=1e-2, atol=1e-2)


@pytest.mark.parametrize("version", FORMATS)
def test_valid_and_exact(version: str, model: ReducedModel, tmp_path: Path) -> None:
    """Steps of co-simulation against the exact response, for inputs that jump and (FMI 2.0, by
    their slopes) that rise; the state can be taken back."""
    path = tmp_path / f"part.{version}.fmu"
    export(model, path, version)
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    assert "sources/model.c" in names and any(name.startswith("binaries/") for name in names)
    h, steps = 1e-4, 80
    t = h * np.arange(steps + 1)
    outputs = [
        f"{port}.{what}"
        for what in ("motion", "velocity", "acceleration")
        for port in model.outputs
    ]
    unit = Unit(path, tmp_path / version, 0)
    u = np.zeros((steps + 1, len(model.inputs)))
    u[:, 1], u[:, 3] = 100.0, -2.0
    unit.set(model.inputs, u[0])
    found = [unit.get(outputs)]
    for k in range(steps):
        unit.step(t[k], h)
        found.append(unit.get(outputs))
    rates = ["displacement", "velocity", "acceleration"]
    y, _ = model.simulate(u, t, rates=rates)
    scale = np.abs(y).max(axis=0) + 1e-300
    assert (np.abs(np.array(found) - y) / scale).max() < 1e-10
    kept = unit.fmu.getFMUState()
    unit.step(t[-1], 3.7 * h)
    after = unit.get(outputs)
    unit.fmu.setFMUState(kept)
    unit.step(t[-1], 3.7 * h)
    assert np.array_equal(unit.get(outputs), after)
    if version == "fmu":
        unit = Unit(path, tmp_path / "again", 0)
        rise = np.outer(np.minimum(t, 2e-3) * 1e5, np.eye(len(model.inputs))[2])
        y, _ = model.simulate(rise, t)
        where = [unit.reference[name] for name in model.inputs]
        for k in range(steps):
            unit.set(model.inputs, rise[k])
            unit.fmu.setRealInputDerivatives(where, [1] * len(where), (rise[k + 1] - rise[k]) / h)
            unit.step(t[k], h)
        motion = unit.get(outputs[: len(model.outputs)])
        assert np.abs(motion - y[-1]).max() < 1e-10 * np.abs(y).max()


@pytest.mark.parametrize("version", FORMATS)
def test_model_exchange_is_the_same_system(
    version: str, model: ReducedModel, tmp_path: Path
) -> None:
    """A, B, C, D column by column: the body's response; without damping it has none."""
    export(model, tmp_path / f"part.{version}.fmu", version, rates=["displacement"])
    n, inputs = 2 * model.order, model.inputs
    states = [f"state[{k + 1}]" for k in range(n)]
    rates = [f"der({name})" for name in states]
    outputs = [f"{port}.motion" for port in model.outputs]
    for factor in (1.0, 0.0):
        unit = Unit(
            tmp_path / f"part.{version}.fmu", tmp_path / f"{factor}", 1, damping_factor=factor
        )
        columns = []
        for name in (*states, *inputs):
            unit.set([*states, *inputs], np.zeros(n + len(inputs)))
            unit.set([name], [1.0])
            columns.append(unit.get([*rates, *outputs]))
        whole = np.array(columns).T
        A, B, C, D = whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]
        for w in 2 * np.pi * np.array([30.0, 700.0, 1900.0]):
            H = C @ np.linalg.solve(1j * w * np.eye(n) - A, B) + D
            K, M = model.K, model.M
            expected = model.C @ np.linalg.solve(K + 1j * w * factor * model.D - w * w * M, model.B)
            assert np.linalg.norm(H - expected) < 1e-10 * np.linalg.norm(expected)


def test_two_of_them_behave_as_their_assembly(model: ReducedModel, tmp_path: Path) -> None:
    """A spring between two units, its force exchanged every small step, against the exact
    assembly."""
    export(model, tmp_path / "part.fmu", "fmu", rates=["displacement"])
    units = [Unit(tmp_path / "part.fmu", tmp_path / name, 0) for name in ("a", "b")]
    stiffness, port = 3e5, "end.fz"
    whole = couple(
        {"a": model, "b": model},
        [Joint("a.end", "b.end", stiffness={"z": stiffness})],
        keep=["a.end", "b.end"],
    )
    h, steps = 2e-7, 10000
    t = h * np.arange(steps + 1)
    u = np.zeros((steps + 1, len(whole.inputs)))
    u[:, whole.inputs.index("a.end.fz")] = 50.0
    y, _ = whole.simulate(u, t)
    at = [whole.outputs.index(f"{name}.end.fz") for name in "ab"]
    motion = np.zeros((steps + 1, 2))
    for k in range(steps):
        spring = stiffness * (motion[k, 0] - motion[k, 1])
        units[0].set([port], [50.0 - spring])
        units[1].set([port], [spring])
        for unit in units:
            unit.step(t[k], h)
        motion[k + 1] = [unit.get([f"{port}.motion"])[0] for unit in units]
    assert np.abs(motion[:, 1]).max() > 0.05 * np.abs(motion[:, 0]).max()
    assert np.abs(motion - y[:, at]).max() < 2e-3 * np.abs(y[:, at]).max()


def test_what_makes_no_unit(model: ReducedModel, tmp_path: Path) -> None:
    assert model.path is not None
    run("export", model.path, "--to", "fmu", "--rates", "velocity", "-o", tmp_path / "p.fmu")
    described = fmpy.read_model_description(str(tmp_path / "p.fmu"))
    assert [v.name for v in described.modelVariables if v.causality == "output"] == [
        f"{port}.velocity" for port in model.outputs
    ]
    assert {v.unit for v in described.modelVariables if v.causality == "output"} == {"m/s", "rad/s"}
    refused = run(
        "export", model.path, "--to", "fmu", "--rates", "jerk", "-o", tmp_path / "p.fmu", expect=1
    )
    assert "rates are jerk" in refused.err
    model.eta = 0.01
    try:
        with pytest.raises(BodyError, match="structural damping"):
            export(model, tmp_path / "p.fmu", "fmu")
    finally:
        model.eta = 0.0


def test_names_soft_mounts_and_feedthrough(tmp_path: Path) -> None:
    """Any names of ports; a mount far softer than the rest keeps its digits; no two variables of
    one name; rates of a feedthrough are refused."""
    rng = np.random.default_rng(5)
    n = 40
    K = np.diag(10.0 ** rng.uniform(4, 12, n))
    K[0, 0] = 0.4
    turn = np.eye(n)
    turn[:3, :3] = scipy.linalg.qr(rng.standard_normal((3, 3)))[0]
    M = np.eye(n)
    B = turn.T[:, :2] + 0.1 * rng.standard_normal((n, 2))
    given = Matrices(
        sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=["101.fx", 'a "b" <c> & é'], beta=1e-7
    )
    rom = flexgram.reduce(given, (0.05, 3000.0), order=38)
    export(rom, tmp_path / "soft.fmu", "fmu", rates=["displacement"])
    assert validate_fmu(str(tmp_path / "soft.fmu")) == []
    export(rom, tmp_path / "soft3.fmu", "fmu3")
    assert validate_fmu(str(tmp_path / "soft3.fmu")) == []
    unit = Unit(tmp_path / "soft.fmu", tmp_path / "soft", 0)
    unit.set(rom.inputs, [1.0, 0.0])
    t = np.linspace(0, 20.0, 41)
    for k in range(40):
        unit.step(t[k], 0.5)
    y, _ = rom.simulate(np.outer(np.ones(41), [1.0, 0.0]), t)
    motion = unit.get([f"{port}.motion" for port in rom.outputs])
    assert np.abs(motion - y[-1]).max() < 1e-6 * np.abs(y).max()
    rom.feedthrough[0, 0] = 1.0
    with pytest.raises(BodyError, match="displacement alone"):
        export(rom, tmp_path / "x.fmu", "fmu", rates=["velocity"])
    export(rom, tmp_path / "x.fmu", "fmu")
    rom.feedthrough[0, 0] = 0.0
    rom.inputs = ["a", "a.motion"]
    rom.outputs = ["a", "b"]
    with pytest.raises(BodyError, match=r"would be named a\.motion"):
        export(rom, tmp_path / "x.fmu", "fmu")


def test_stiff_coordinates_at_low_frequencies(tmp_path: Path) -> None:
    """Statically exact bodies have coordinates of megahertz: accelerations lose digits of what
    nearly vanishes at low frequencies, not of what they are in the band."""
    hertz = np.array([100.0, 800.0, 2e6, 3e6])
    given = Matrices(
        sp.diags((2 * np.pi * hertz) ** 2).tocsr(), sp.identity(4).tocsr(),
        np.array([[1.0, 0.2], [0.5, 1.0], [9e3, 1e3], [2e3, 7e3]]), alpha=2.0,
    )  # fmt: skip
    rom = flexgram.reduce(given, (0, 1000), order=4)
    export(rom, tmp_path / "stiff.fmu", "fmu")
    unit = Unit(tmp_path / "stiff.fmu", tmp_path / "stiff", 0)
    t = np.linspace(0, 0.02, 401)
    unit.set(rom.inputs, [1.0, -0.5])
    y, _ = rom.simulate(np.outer(np.ones(401), [1.0, -0.5]), t)
    for k in range(400):
        unit.step(t[k], t[1])
        found = unit.get([f"{port}.motion" for port in rom.outputs])
        assert np.abs(found - y[k + 1]).max() < 1e-6 * np.abs(y).max()
    too_stiff = Matrices(
        sp.diags((2 * np.pi * np.array([1.0, 1e6])) ** 2).tocsr(), sp.identity(2).tocsr(),
        np.array([[1.0], [1e6]]), alpha=2.0,
    )  # fmt: skip
    with pytest.raises(BodyError, match=r"differ too much .* accelerations"):
        export(flexgram.reduce(too_stiff, (0, 3), order=2), tmp_path / "x.fmu", "fmu")
