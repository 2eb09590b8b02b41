"""Load histories: what lies outside the band, and the error that the claim leaves in time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from test_elastic import LAST, Free
from test_mesh_loads import sided, write_body

from bodies import box, write_body_file
from conftest import body_system, run
from flexgram import BodyError, Matrices, ReducedModel, reduce
from flexgram.body.stress import von_mises
from flexgram.simulation.histories import evenly, judge, read_history
from flexgram.simulation.motions import Motion
from referee import System

T, COUNT = 2.0, 4000  # half a Hz from line to line, up to 1000 Hz


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Free:
    return Free(tmp_path_factory.mktemp("free"))


def tones(lines: dict[float, Any]) -> tuple[Any, Any]:
    """A period of tones: amplitudes of the inputs by frequency [Hz]."""
    t = np.arange(COUNT) * T / COUNT
    u = sum(np.outer(np.cos(2 * np.pi * hz * t + hz), amplitude) for hz, amplitude in lines.items())
    return t, u


@pytest.mark.parametrize("reference", ["pointwise", "band", "elastic"])
def test_the_error_in_time_is_within_the_verdict(bar: Free, reference: str) -> None:
    rom = reduce(
        bar.path, (1, LAST), 2e-2, options={"mor_tol_of": "whole", "mor_tol_relative_to": reference}
    )
    rng = np.random.default_rng(0)
    lines = {hz: rng.standard_normal(12) for hz in (1.5, 7.0, 23.5, 61.0, 98.5)}
    verdict = judge(rom, *tones(lines))
    assert verdict.below < 1e-12 and verdict.above < 1e-12 and verdict.needed == 98.5
    # Mean squares of the stationary response, tone by tone.
    off = whole = elastic = 0.0
    free, part = System(bar.K, bar.M, bar.B, alpha=3.0, beta=1e-6), rom.elastic()
    for hz, amplitude in lines.items():
        omega = 2 * np.pi * hz
        H_e = bar.elastic(omega)
        off += np.linalg.norm((part.transfer(omega) - H_e) @ amplitude) ** 2
        elastic += np.linalg.norm(H_e @ amplitude) ** 2
        whole += np.linalg.norm(free.transfer(omega) @ amplitude) ** 2
    assert np.sqrt(off / whole) <= verdict.error
    assert verdict.elastic_error is not None and np.sqrt(off / elastic) <= verdict.elastic_error
    if reference == "elastic":
        assert verdict.elastic_error < 0.2
    else:
        assert verdict.elastic_error > 0.1 and "--tol-relative-to both" in verdict.words[1]


def test_what_lies_outside_the_band() -> None:
    body = Matrices(
        K=sp.diags([1e4, 9e4]).tocsr(),
        M=sp.identity(2, format="csr"),
        B=np.eye(2),
        alpha=0.5,
        inputs=["a", "b"],
    )
    rom = reduce(body, (10, 60), 1e-6)
    verdict = judge(rom, *tones({20.0: [1.0, 3.0], 80.0: [0.0, 1.0]}))
    assert verdict.above == pytest.approx(0.1) and verdict.worst_port == "b"
    assert verdict.needed == 80.0 and verdict.elastic_error is None
    assert any("let the band reach beyond that" in words for words in verdict.words)
    assert not any("ms apart" in words for words in verdict.words)
    coarse = np.arange(0, 1, 0.01)  # 50 Hz at most
    verdict = judge(rom, coarse, np.cos(40 * np.pi * coarse)[:, None] * [1.0, 1.0])
    assert any("10 ms apart, so the history holds nothing above 50 Hz" in w for w in verdict.words)
    verdict = judge(rom, *tones({0.0: [1.0, 0.0], 20.0: [1.0, 1.0]}))
    share = np.cos(0) ** 2 / (np.cos(0) ** 2 + 0.5)
    assert verdict.below == pytest.approx(share) and verdict.worst_port == "a"
    with pytest.raises(BodyError, match="all loads vanish"):
        judge(rom, [0, 1, 2], np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t,a\n0,1\n", "expected a line"),
        ("t,c\n0,1\n1,2\n", "line 1: the body has no input 'c'; there are a, b"),
        ("a,b\n0,1\n1,2\n", "line 1: expected t and names"),
        ("t,a,a\n0,1,1\n1,2,2\n", "line 1: expected t and names"),
        ("t,a\n0,1\n1,x\n", "line 3: expected 2 numbers"),
        ("t,a\n0,1\n1\n", "line 3: expected 2 numbers"),
        ("t,a\n0,1\n1,nan\n", "line 3: holds NaN or Inf"),
        ("t,a\n0,1\n# no\n1,1\n1,2\n", "line 5: the time does not rise"),
    ],
)
def test_histories_that_are_none(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    path.write_text(text)
    with pytest.raises(BodyError, match=expected):
        read_history(path, ["a", "b"])


def test_uneven_times_and_the_command_line(bar: Free, tmp_path: Path) -> None:
    t, u = evenly(np.array([0.0, 0.1, 0.4]), np.array([[0.0], [1.0], [4.0]]))
    assert np.allclose(t, [0, 0.1, 0.2, 0.3, 0.4]) and np.allclose(u[:, 0], 10 * t)
    corners = np.array([0, 1e-3, 1e-2, 0.011, 0.05])
    for wanted in (1e-4, 1.3e-4, 1.0):
        t, u = evenly(corners, np.column_stack([corners]), wanted)
        assert np.ptp(np.diff(t)) < 1e-12 and t[1] <= min(wanted, 1e-3) * (1 + 1e-9)
        assert max(np.abs(t - corner).min() for corner in corners) < 1e-3 * t[1]
        assert np.allclose(u[:, 0], t)
    rom = tmp_path / "bar.rom.h5"
    reduce(bar.path, (1, LAST), 2e-2).save(rom)
    port = ReducedModel.load(rom).inputs[0]
    history = tmp_path / "history.csv"
    times = np.linspace(0, 1, 801)
    force = np.sin(2 * np.pi * 30 * times) + 0.5 * np.sin(2 * np.pi * 150 * times)
    history.write_text(
        f"t,{port}\n" + "".join(f"{a:.5g},{b:.6g}\n" for a, b in zip(times, force, strict=True))
    )
    said = run("report", rom, "--loads", history, "-o", tmp_path / "bar.html").out
    assert "lies above the band" in said and "wrote" in said
    page = (tmp_path / "bar.html").read_text()
    assert "The load history history.csv" in page and "lies above the band" in page
    run("simulate", rom, "--loads", history, "-o", tmp_path / "y.csv")
    assert (tmp_path / "y.csv").read_text().count("\n") == 802


def test_a_body_for_few_loads_answers_for_these(bar: Free) -> None:
    rom = reduce(bar.path, (1, LAST), 1e-3, options={"mor_tol_of": "whole", "mor_load_patterns": 4})
    P = rom.loads
    rng = np.random.default_rng(1)
    lines = {hz: P @ rng.standard_normal(P.shape[1]) for hz in (3.0, 40.5, 97.0)}
    verdict = judge(rom, *tones(lines))
    assert verdict.astray < 1e-12 and verdict.proved
    off = whole = 0.0
    for hz, amplitude in lines.items():
        omega = 2 * np.pi * hz
        H, H_r = P.T @ bar.transfer(omega), P.T @ rom.transfer(omega)
        off += np.linalg.norm((H_r - H) @ amplitude) ** 2
        whole += np.linalg.norm(H @ amplitude) ** 2
    assert np.sqrt(off / whole) <= verdict.error < 0.1

    other = rng.standard_normal(len(P))  # a load beside them
    other -= P @ np.linalg.lstsq(P, other, rcond=None)[0]
    beside = {
        hz: amplitude + 3 * other * np.linalg.norm(amplitude) / np.linalg.norm(other)
        for hz, amplitude in lines.items()
    }
    verdict = judge(rom, *tones(beside))
    assert verdict.astray == pytest.approx(0.9)
    assert any("90 % of the loads is no combination" in words for words in verdict.words)


@pytest.mark.parametrize("reference", ["pointwise", "band"])
def test_each_kind_of_output_has_its_error(reference: str, tmp_path: Path) -> None:
    """Loads and outputs of unlike units: displacements and stresses are judged by their own claims,
    which in all of H together would say nothing of either."""
    write_body(
        tmp_path / "body.h5",
        sided("tetra10"),
        damping={"alpha": 20.0, "beta": 1e-6},
        supports={"start": {"nodes": "start"}},
        loads={"gas": {"type": "pressure", "nodes": "side"}, "gravity": {"type": "acceleration"}},
        outputs={"spot": {"type": "stress", "nodes": "side"}},
    )
    rom = reduce(tmp_path / "body.h5", (10, 6000), 1e-3, options={"mor_tol_relative_to": reference})
    full = body_system(tmp_path / "body.h5")
    rng = np.random.default_rng(6)
    scale = np.array([1e6 if name == "gas.p" else 1.0 for name in rom.inputs])
    t = np.arange(20000) / 20000.0
    tones = {hz: scale * rng.standard_normal(len(scale)) for hz in (25.0, 400.0, 2750.0, 5900.0)}
    u = sum(np.outer(np.cos(2 * np.pi * hz * t + hz), a) for hz, a in tones.items())
    verdict = judge(rom, t, u)
    assert list(verdict.errors) == ["displacement", "rotation", "stress"]
    rows = {"displacement": [0, 1, 2], "rotation": [3, 4, 5], "stress": list(range(6, 12))}
    for what, error in verdict.errors.items():
        off = whole = 0.0
        for hz, amplitude in tones.items():
            H = full.transfer(2 * np.pi * hz)[rows[what]]
            H_r = rom.transfer(2 * np.pi * hz)[rows[what]]
            off += np.linalg.norm((H_r - H) @ amplitude) ** 2
            whole += np.linalg.norm(H @ amplitude) ** 2
        assert np.sqrt(off / whole) <= error < 0.1, what
    assert "stress at most" in verdict.words[0]


def held_bar(path: Path, kind: str) -> ReducedModel:
    mesh = box(kind, (6, 1, 1), (0.3, 0.02, 0.01), distort=False)
    end = {"end": {"set": "end", "coupling": "rigid"}}
    held = {"start": [0, 1, 2]}
    write_body_file(path, mesh, interfaces=end, supports=held, damping=(5, 1e-5, 0))
    return reduce(path, (10, 4000), 1e-3)


def test_a_pulse_is_seen_whole(tmp_path: Path) -> None:
    """Four corners say all of it: the peak of stress and the spectrum are those of fine samples."""
    rom = held_bar(tmp_path / "b.h5", "tetra10")
    corners = np.array([0, 3e-4, 4e-3, 5e-3, 0.03])
    force = np.array([0, 100.0, 100, 0, 0])
    t = np.linspace(0, 0.03, 30001)
    fine = np.interp(t, corners, force)
    u = np.zeros((len(t), len(rom.inputs)))
    u[:, rom.inputs.index("end.fz")] = fine
    q = rom.simulate(u, t)[1]
    at = np.argmax(np.abs(rom.simulate(u, t)[0][:, rom.outputs.index("end.fz")]))
    near = q[max(at - 300, 0) : at + 300 : 10]
    largest = float(np.nanmax(von_mises(rom.stress(near))))
    table = "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(corners, force, strict=True))
    (tmp_path / "loads.csv").write_text(f"t,end.fz\n{table}")
    motion = Motion.answer(rom, tmp_path / "loads.csv", None)
    assert motion.peaks is not None and not motion.doubts
    assert motion.peaks.von_mises.value == pytest.approx(largest, rel=3e-3)
    whole, sampled = (
        judge(rom, *x) for x in (read_history(tmp_path / "loads.csv", rom.inputs), (t, u))
    )
    assert whole.errors == pytest.approx(sampled.errors, rel=0.02)
    assert not any("ms apart" in words for words in whole.words)


def test_a_motion_that_the_loads_do_not_make(tmp_path: Path) -> None:
    """A bar that is pulled does not turn: an error relative to that rotation means nothing."""
    rom = held_bar(tmp_path / "b.h5", "hexahedron20")
    t = np.linspace(0, 0.01, 1001)
    for port, is_told in (("end.fx", False), ("end.fz", True)):
        u = np.zeros((len(t), len(rom.inputs)))
        u[:, rom.inputs.index(port)] = np.sin(2 * np.pi * 1000 * t)
        words = " ".join(judge(rom, t, u).words)
        assert ("rotation at most" in words) == is_told
        assert ("hardly make any rotation" in words) != is_told
        assert "displacement at most" in words
