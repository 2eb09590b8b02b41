"""Viscoelastic materials: Prony series and tables by frequency, as terms g(ω)T, certified."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.linalg as sl
import scipy.sparse as sp
from test_restart import start
from ways import in_every_way

import flexgram
from conftest import message, run
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.exporters import export
from referee import System, relative_error

TWO_PI = 2 * np.pi
SERIES = ([0.9, 3.0], [2.0, 30.0])  # g, tau
POINTS = ([0.0, 0.05, 0.11, 0.3], [0.0, 0.4, 0.9, 1.0], [0.02, 0.3, 0.1, 0.2])


def chain(n: int = 60) -> dict[str, Any]:
    """Springs between masses, of which a third relaxes and a sixth is known by a table."""

    def springs(first: int, last: int) -> Any:
        ends = np.zeros((n, n))
        for k in range(first, last):
            ends[k : k + 2, k : k + 2] += [[1.0, -1.0], [-1.0, 1.0]]
        return sp.csc_matrix(ends)

    K = (springs(0, n - 1) + sp.coo_matrix(([1.0], ([0], [0])), shape=(n, n))).tocsc()
    rubber, foam = springs(n // 2, n - n // 6), springs(10, 10 + n // 6)
    return {"K": K, "M": sp.identity(n, format="csc"), "B": np.eye(n)[:, [n - 1, n // 3]]} | {
        "terms": {
            "rubber": (rubber, flexgram.prony(*SERIES)),
            "foam": (foam, flexgram.table(*POINTS)),
        }
    }


def referee(a: dict[str, Any], **damping: float) -> System:
    """The same body for the referee, which knows laws by their definitions."""
    rubber, foam = (a["terms"][name][0].toarray() for name in ("rubber", "foam"))
    terms = [(rubber, "prony", *SERIES), (foam, "table", *POINTS)]
    return System(a["K"].toarray(), a["M"].toarray(), a["B"], terms=terms, **damping)


def reduced(rom: ReducedModel) -> System:
    terms = [(t.matrix, t.law.kind, *t.law.numbers().values()) for t in rom.system.terms]
    return System(rom.K, rom.M, rom.B, rom.C, rom.D, terms=terms)


def frequencies(band: tuple[float, float]) -> Any:
    """Of the band: spread, and beside the frequencies of the table."""
    rng = np.random.default_rng(1)
    at = np.concatenate([rng.uniform(*band, 60), band, np.array(POINTS[0]) / TWO_PI])
    at = np.concatenate([at, np.nextafter(at, 0), at * (1 + 1e-6)])
    return TWO_PI * at[(at >= band[0]) & (at <= band[1])]


@pytest.mark.parametrize("ranks", [1, 2])
def test_prony_terms_and_a_table_are_certified(ranks: int, tmp_path: Path) -> None:
    """Below the claim against extended precision, from a file, from its medium model, by pod."""
    a = chain()
    body, band = tmp_path / "body.h5", (0.001, 0.04)
    flexgram.write_matrices(body, **a, alpha=1e-4)
    said, rom, again, sampled = in_every_way(body, band, 16, ranks)
    assert "rubber viscoelastic (2 Prony terms)" in said
    assert "foam viscoelastic (a table of 4 frequencies)" in said
    full = referee(a, alpha=1e-4)
    for omega in frequencies(band):
        H = full.transfer(omega).astype(complex)
        for model in (rom, again):
            assert relative_error(full, reduced(model), omega) <= model.certified_error <= 1e-6
            assert np.allclose(model.transfer(omega), H, rtol=0, atol=2e-6 * np.linalg.norm(H))
        assert np.linalg.norm(sampled.transfer(omega) - H) < 0.1 * np.linalg.norm(H)


def test_internal_variables_are_a_second_way() -> None:
    """z in the range of T makes a body of K, M and D with a singular M of the same relaxation:
    the same H, whose claim holds for both."""
    a = chain(36)
    T, law = a["terms"]["rubber"]
    direct = flexgram.reduce(Matrices(**{**a, "terms": {"rubber": (T, law)}}), (0.002, 0.04), 1e-5)
    values, vectors = sl.eigh(T.toarray())
    L = vectors[:, values > 1e-9] * np.sqrt(values[values > 1e-9])
    n, r = L.shape
    K, D, M = (np.zeros((n + 2 * r, n + 2 * r)) for _ in range(3))
    K[:n, :n], M[:n, :n] = a["K"].toarray(), np.eye(n)
    for k, (g, tau) in enumerate(zip(*SERIES, strict=True)):
        z = slice(n + k * r, n + (k + 1) * r)
        K[:n, :n] += g * L @ L.T
        K[:n, z], K[z, :n], K[z, z] = -g * L, -g * L.T, g * np.eye(r)
        D[z, z] = g * tau * np.eye(r)
    B = np.vstack([a["B"], np.zeros((2 * r, 2))])
    parts = (sp.csr_matrix(x) for x in (K, M, B, D))
    K_s, M_s, B_s, D_s = parts
    other = flexgram.reduce(Matrices(K_s, M_s, B_s.toarray(), D=D_s), (0.002, 0.04), 1e-5)
    assert direct.met and other.met and direct.kind == other.kind == "certified"
    for omega in frequencies((0.002, 0.04)):
        H, second = direct.transfer(omega), other.transfer(omega)
        allowed = direct.certified_error + other.certified_error
        assert np.linalg.norm(H - second) <= 1.01 * allowed * np.linalg.norm(H)


def test_laws_of_d_and_s_as_terms() -> None:
    """``loss`` and ``viscous`` are S and D by another name."""
    a = chain()
    T = a["terms"]["rubber"][0]
    base = {name: a[name] for name in "KMB"}
    terms = {"rubber": (T, flexgram.loss(0.2)), "oil": (T, flexgram.viscous())}
    named = flexgram.reduce(Matrices(**base, terms=terms), (0.002, 0.04), 1e-5)
    given = flexgram.reduce(Matrices(**base, S=0.2 * T, D=T), (0.002, 0.04), 1e-5)
    assert not named.system.terms
    for name in "KMDS":
        assert np.array_equal(getattr(named.system, name), getattr(given.system, name))


def one_mass(k: float = 400.0, g: float = 1.5, tau: float = 0.02) -> ReducedModel:
    """A mass of 1 kg on a standard linear solid, beside a mass that moves by itself."""
    K, M = sp.diags([k, 900.0]).tocsr(), sp.identity(2, format="csr")
    T = sp.diags([k, 0.0]).tocsr()
    matrices = Matrices(
        K, M, np.eye(2), alpha=0.5, terms={"solid": (T, flexgram.prony([g], [tau]))}
    )
    return flexgram.reduce(matrices, (0.1, 20), order=2)


def test_relaxation_in_closed_form() -> None:
    """The step response of a mass on a standard linear solid, by the roots of its cubic."""
    k, g, tau = 400.0, 1.5, 0.02
    rom = one_mass(k, g, tau)
    # (s² + α s + k + k g s τ/(1 + s τ)) q = 1/s
    cubic = np.polyadd(np.polymul([1, 0.5, k], [tau, 1]), [k * g * tau, 0])
    poles = np.roots(cubic)
    slope = np.polyder(np.polymul(cubic, [1, 0]))
    t = np.linspace(0, 1.5, 3001)
    exact = sum((1 + s * tau) / np.polyval(slope, s) * np.exp(s * t) for s in [*poles, 0.0])
    y, _ = rom.simulate(np.column_stack([np.ones_like(t), 0 * t]), t)
    assert np.abs(y[:, 0] - exact.real).max() < 1e-10 * np.abs(exact).max()
    assert y[-1, 0] == pytest.approx(1 / k, rel=2e-2)  # creeps to the long-term stiffness
    found = rom.poles()
    assert len(found) == 5 and all(np.abs(found - s).min() < 1e-9 * abs(s) for s in poles)
    start, _ = rom.simulate(np.zeros((2, 2)), [0.0, 1e-6], q0=np.linalg.solve(rom.C, [1.0, 0.0]))
    assert start[1, 0] == pytest.approx(1 - 0.5e-12 * k, abs=1e-14)  # held long, and let go


def test_state_space_has_the_same_response_and_is_passive(tmp_path: Path) -> None:
    a = chain()
    a["terms"].pop("foam")
    rom = flexgram.reduce(Matrices(**a, alpha=1e-4), (0.002, 0.04), 1e-6)
    A, B, C, D = rom.state_space()
    assert len(A) > 2 * rom.order
    for omega in (0.02, 0.1, 0.24):
        H = C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B) + D
        assert np.allclose(H, rom.transfer(omega), rtol=1e-9, atol=0)
    assert rom.poles().real.max() < 0
    export(rom, tmp_path / "part.mat", "state-space")
    assert scipy.io.loadmat(tmp_path / "part.mat")["A"].shape == A.shape


@pytest.mark.parametrize("kind", ["fmu", "fmu3"])
def test_an_fmu_relaxes(kind: str, tmp_path: Path) -> None:
    """Simulated by another program, with the internal states of the Prony term: its step response
    is that of ``simulate``."""
    fmpy = pytest.importorskip("fmpy")
    k, g, tau = 400.0, 1.5, 0.02
    rom = one_mass(k, g, tau)
    path = tmp_path / "part.fmu"
    export(rom, path, kind)
    t = np.linspace(0, 0.5, 501)
    inputs = np.zeros(2, dtype=[("time", float), *((name, float) for name in rom.inputs)])
    inputs["time"], inputs[rom.inputs[0]] = [0, 0.5], 1.0
    output = f"{rom.outputs[0]}.motion"
    found = fmpy.simulate_fmu(
        str(path), stop_time=0.5, output_interval=1e-3, input=inputs, output=[output]
    )
    y, _ = rom.simulate(np.column_stack([np.ones_like(t), 0 * t]), t)
    exact = np.interp(found["time"], t, y[:, 0])
    assert np.abs(found[output] - exact).max() < 1e-6 * np.abs(y).max()


@pytest.mark.skipif(not shutil.which("octave"), reason="Octave is not installed")
def test_octave_computes_the_same_response(tmp_path: Path) -> None:
    a = chain()
    rom = flexgram.reduce(Matrices(**a, alpha=1e-4), (0.002, 0.04), 1e-5)
    export(rom, tmp_path / "part.m", "octave")
    omega = 0.15
    lines = f"quiet = true; part; x = H({omega}); printf('%.15g ', real(x), imag(x));"
    done = subprocess.run(
        ["octave", "--no-gui", "--eval", lines], cwd=tmp_path, capture_output=True, text=True
    )
    numbers = np.array(done.stdout.split()[-8:], dtype=float)
    H = (numbers[:4] + 1j * numbers[4:]).reshape(2, 2).T
    assert np.allclose(H, rom.transfer(omega), rtol=1e-9)


def test_a_rigid_mount_has_no_mode_below_the_cutoff(tmp_path: Path) -> None:
    """No mode to eliminate: the claim holds by the residual alone."""
    a = chain(30)
    a["K"] = a["K"] + sp.identity(30, format="csc")
    rom = flexgram.reduce(Matrices(**a), (1e-4, 0.01), 1e-6)
    assert rom.met and rom.kind == "certified"
    full = referee(a)
    for omega in np.linspace(1e-4, 0.01, 7) * TWO_PI:
        assert relative_error(full, reduced(rom), float(omega)) <= rom.certified_error


def test_a_checkpoint_knows_its_laws(tmp_path: Path) -> None:
    """Numbers of a law that change places make another body."""
    a = chain(40)
    body, medium = tmp_path / "body.h5", tmp_path / "m.h5"
    flexgram.write_matrices(body, **a)
    asked = ("-body", body, "-mor_band_hz", "0.002,0.04", "-mor_tol", "1e-4")
    asked += ("-mor_medium_out", medium)
    # The run removes its checkpoint when it is done; a second name keeps the last one.
    state, kept = Path(f"{medium}.checkpoint"), tmp_path / "kept"
    process = start("certify", *asked, "-mor_checkpoint", "yes", ranks=1)
    while process.poll() is None:
        with contextlib.suppress(FileNotFoundError, FileExistsError):
            os.link(state, tmp_path / "now")
            (tmp_path / "now").replace(kept)
    assert process.returncode == 0
    kept.replace(state)
    T = a["terms"]["rubber"][0]
    other = flexgram.prony(SERIES[0][::-1], SERIES[1])
    flexgram.write_matrices(body, **{**a, "terms": {**a["terms"], "rubber": (T, other)}})
    failed = run("certify", *asked, "-mor_restart", expect=1)
    assert "is of another job" in message(failed) and "g of rubber" in message(failed)


def test_what_is_refused(tmp_path: Path) -> None:
    a = chain(30)
    body = tmp_path / "body.h5"
    flexgram.write_matrices(body, **a)
    failed = run("reduce", "-body", body, "-mor_band_hz", "0.01,0.06", expect=1)
    assert "foam is known from 0 to 0.0477465 Hz, the band is 0.01 to 0.06 Hz" in message(failed)
    with h5py.File(body, "a") as file:
        file["terms/rubber"].attrs["tau"] = [2.0]
    failed = run("reduce", "-body", body, "-mor_band_hz", "0.01,0.04", expect=1)
    assert "/terms/rubber: law prony: tau has 1 numbers, g 2" in message(failed)
    with h5py.File(body, "a") as file:
        file["terms/rubber"].attrs["law"] = "proni"
    failed = run("reduce", "-body", body, "-mor_band_hz", "0.01,0.04", expect=1)
    assert "there is no law proni, did you mean prony?" in message(failed)
    T, law = a["terms"]["rubber"]
    flexgram.write_matrices(body, **{**a, "terms": {"rubber": (-T, law)}})
    failed = run("reduce", "-body", body, "-mor_band_hz", "0.01,0.04", expect=1)
    assert "rubber has" in message(failed) and "negative eigenvalue" in message(failed)
    with pytest.raises(BodyError, match=r"term rubber: expected \(matrix, law\)"):
        flexgram.write_matrices(body, **{**a, "terms": {"rubber": T}})
    with pytest.raises(BodyError, match="term rubber has shape"):
        flexgram.write_matrices(body, **{**a, "terms": {"rubber": (T[:5, :5], law)}})
    with pytest.raises(BodyError, match="positive"):
        flexgram.prony([1.0], [0.0])
    with pytest.raises(BodyError, match="rise"):
        flexgram.table([1.0, 0.5], [0, 1], [0, 1])
