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

import flexgram
from bodies import box
from conftest import body_system, message, read_sparse, run
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.assembly.couple import couple
from flexgram.body.description import import_description
from flexgram.exporters import export
from flexgram.model.equivalent_damping import with_viscous_damping
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
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    flexgram.write_matrices(body, **a, alpha=1e-4)
    asked = ("-body", body, "-mor_band_hz", "0.001,0.04")
    said = run("reduce", *asked, "-mor_tol", "1e-6", "-mor_out", out, ranks=ranks).out
    assert "rubber viscoelastic (2 Prony terms)" in said
    assert "foam viscoelastic (a table of 4 frequencies)" in said
    medium, cut, pod = (tmp_path / f"{name}.h5" for name in ("medium", "cut", "pod"))
    run("certify", *asked, "-mor_tol", "1e-6", "-mor_medium_out", medium, ranks=ranks)
    run("cut", "-medium", medium, "-mor_tol", "1e-6", "-mor_out", cut, ranks=ranks)
    run("reduce", *asked, "-mor_method", "pod", "-mor_order", "16", "-mor_out", pod, ranks=ranks)
    rom, again, sampled = (ReducedModel.load(path) for path in (out, cut, pod))
    assert rom.met and rom.kind == "certified" and again.met
    full = referee(a, alpha=1e-4)
    for omega in frequencies((0.001, 0.04)):
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


def mounted(path: Path, rubber: dict[str, Any], kind: str = "hexahedron", **more: Any) -> Path:
    """A steel box whose first third is rubber, held there."""
    cells = (3, 1, 1) if kind == "tetra10" else (6, 2, 2)
    mesh = box(kind, cells, (0.3, 0.06, 0.05), distort=False)
    middle = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 0]
    soft = middle < 0.1
    mesh.cell_sets = {"mount": [np.flatnonzero(soft)], "part": [np.flatnonzero(~soft)]}
    content = {
        "materials": {
            "steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0},
            "rubber": {"nu": 0.4, "rho": 1100.0, **rubber},
        },
        "regions": {"mount": {"material": "rubber"}, "part": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "damping": {"alpha": 2.0},
        **more,
    }
    import_description(content, "mounted", path, mesh=mesh)
    return path


def model_of(path: Path, rubber: dict[str, Any], **more: Any) -> ReducedModel:
    rom = flexgram.reduce(mounted(path, rubber, **more), (5, 1500), 1e-5)
    assert rom.met and rom.kind == "certified"
    return rom


def same(one: ReducedModel, other: ReducedModel, at: Any = (5.0, 140.0, 640.0, 1500.0)) -> bool:
    for hertz in at:
        H, second = (rom.transfer(TWO_PI * hertz) for rom in (one, other))
        if not np.linalg.norm(H - second) <= 3e-5 * np.linalg.norm(H):
            return False
    return True


def test_materials_of_a_description(tmp_path: Path) -> None:
    """Ways to say the same material: shares of long-term and of instantaneous moduli, all moduli
    at once or shear and bulk alike, a table; and limits that are bodies without terms."""
    series = [[0.2, 1e-3], [0.3, 1e-4]]
    prony = lambda E, **more: {"E": E, "viscoelastic": {"prony": series, **more}}  # noqa: E731
    rom = model_of(tmp_path / "a.h5", prony(5e7))
    assert same(rom, model_of(tmp_path / "b.h5", prony(10e7, moduli="instantaneous")))
    both = {"E": 5e7, "viscoelastic": {"prony": {"shear": series, "bulk": series}}}
    tets = {"kind": "tetra10"}
    whole = model_of(tmp_path / "c.h5", prony(5e7), **tets)
    assert same(whole, model_of(tmp_path / "d.h5", both, **tets))
    alone = {"E": 5e7, "viscoelastic": {"prony": {"shear": series}}}
    assert not same(whole, model_of(tmp_path / "e.h5", alone, **tets))
    # A table of the series at many frequencies is the series, nearly: linear between them.
    law = flexgram.prony(np.array([0.2, 0.3]) / 0.5, [1e-3, 1e-4])
    hz = np.linspace(4, 1501, 400)
    modulus = 5e7 * (1 + law.at(TWO_PI * hz))
    columns = {"hz": list(hz), "storage": list(modulus.real), "loss": list(modulus.imag)}
    table = model_of(tmp_path / "f.h5", {"viscoelastic": {"table": columns}})
    assert not table.system.poles().size == 0 and table.system.timeless
    for hertz in (hz[0] + 1, hz[200], 1499.0):
        H, second = (m.transfer(TWO_PI * hertz) for m in (rom, table))
        assert np.linalg.norm(H - second) < 1e-3 * np.linalg.norm(H)
    # Constant storage without loss is another E; slow relaxation is the instantaneous one.
    still = {"hz": [0, 2000], "storage": [8e7, 8e7], "loss_factor": [0, 0]}
    elastic = model_of(tmp_path / "g.h5", {"E": 8e7})
    assert same(elastic, model_of(tmp_path / "h.h5", {"viscoelastic": {"table": still}}))
    slow = {"E": 4e7, "viscoelastic": {"prony": [[0.5, 1e9]]}}
    assert same(elastic, model_of(tmp_path / "i.h5", slow))
    stress = {"outputs": {"root": {"type": "stress", "nodes": "start"}}}
    with pytest.warns(flexgram.ReductionWarning, match="stress in rubber is that of the long-term"):
        mounted(tmp_path / "j.h5", prony(5e7), **stress)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["materials/rubber/whole"].attrs["law"] == "prony"
    said = run("info", tmp_path / "a.h5").out
    assert "2 Prony terms" in said


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_term_is_what_the_material_adds(ranks: int, tmp_path: Path) -> None:
    """T of the assembly is K with twice the rubber's E less K, and holds no more than its law."""
    prony = {"viscoelastic": {"prony": [[0.2, 1e-3]]}}
    assembled = tmp_path / "T.h5"
    body = mounted(tmp_path / "a.h5", {"E": 5e7, "loss_factor": 0.1, **prony})
    run("assemble", "-body", body, "-body_out", assembled, ranks=ranks)
    one, two = (body_system(mounted(tmp_path / f"{E:g}.h5", {"E": E})) for E in (5e7, 1e8))
    with h5py.File(assembled) as file:
        T = read_sparse(file, "terms/rubber")
        S = read_sparse(file, "S")
        assert file["terms/rubber"].attrs["law"] == "prony"
        assert file["terms/rubber"].attrs["g"] == pytest.approx(0.25)
    K_rubber = two.K - one.K
    assert abs(T - K_rubber).max() < 1e-12 * abs(two.K).max()
    assert abs(S - 0.1 * K_rubber).max() < 1e-12 * abs(two.K).max()


def test_mixed_relaxation_of_shear_and_bulk_by_another_assembly(tmp_path: Path) -> None:
    """At a frequency the body is the elastic one with complex moduli: of small parts of it, as
    the derivative of K by G and by the bulk modulus."""
    shear, bulk = [[0.4, 2e-4]], [[0.1, 1e-3]]
    rubber = {"E": 6e7, "viscoelastic": {"prony": {"shear": shear, "bulk": bulk}}}
    rom = model_of(tmp_path / "a.h5", rubber, kind="tetra10")
    G, k = 6e7 / 2.8, 6e7 / 0.6

    def matrices(G: float, k: float, name: str) -> System:
        E, nu = 9 * k * G / (3 * k + G), (3 * k - 2 * G) / (2 * (3 * k + G))
        path = tmp_path / f"{name}.h5"
        return body_system(mounted(path, {"E": E, "nu": nu}, kind="tetra10"))

    here, stiff, dense = matrices(G, k, "x"), matrices(2 * G, k, "y"), matrices(G, 2 * k, "z")
    K, M = here.K.toarray(), here.M.toarray()
    K_G, K_k = stiff.K.toarray() - K, dense.K.toarray() - K
    for hertz in (5.0, 200.0, 900.0, 1500.0):
        s = 1j * TWO_PI * hertz
        g_G, g_k = (g / (1 - g) * s * tau / (1 + s * tau) for [[g, tau]] in (shear, bulk))
        A = K + g_G * K_G + g_k * K_k + (s * s + 2.0 * s) * M
        H = here.B.T @ np.linalg.solve(A, here.B)
        assert np.linalg.norm(rom.transfer(TWO_PI * hertz) - H) <= 1e-5 * np.linalg.norm(H)


def test_free_layer_damping_against_beam_theory(tmp_path: Path) -> None:
    """Oberst's beam, a steel strip with a damping layer whose modulus is a table: resonances and
    loss factors of H at the tip are those of a cantilever with the layers' complex bending
    stiffness (Oberst 1952), E and eta at each frequency. Poisson's ratio is zero, as in a beam."""
    length, width, h1, h2, E1, rho1, rho2 = 0.2, 0.01, 0.002, 0.003, 210e9, 7850.0, 1500.0
    hz = [0.0, 40.0, 200.0, 500.0, 1200.0]
    storage, eta = [1.5e9, 2.0e9, 3.0e9, 4.0e9, 5.0e9], [0.1, 0.3, 0.5, 0.4, 0.3]
    mesh = box("hexahedron20", (40, 1, 5), (length, width, h1 + h2), distort=False)
    middle = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 2]
    low = middle - mesh.points[:, 2].min() < h1
    mesh.cell_sets = {"strip": [np.flatnonzero(low)], "layer": [np.flatnonzero(~low)]}
    table = {"hz": hz, "storage": storage, "loss_factor": eta}
    content = {
        "materials": {
            "steel": {"E": E1, "nu": 0.0, "rho": rho1},
            "polymer": {"nu": 0.0, "rho": rho2, "viscoelastic": {"table": table}},
        },
        "regions": {"strip": {"material": "steel"}, "layer": {"material": "polymer"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
    }
    import_description(content, "Oberst", tmp_path / "a.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "a.h5", (5, 1200), 1e-3, inputs=["tip.fz"])
    assert rom.met and rom.kind == "certified"

    def stiffness(f: Any) -> Any:
        E2 = np.interp(f, hz, storage) + 1j * np.interp(f, hz, np.array(storage) * np.array(eta))
        axis = (E1 * h1 * h1 / 2 + E2 * h2 * (h1 + h2 / 2)) / (E1 * h1 + E2 * h2)
        strip, layer = h1**3 / 12 + h1 * (axis - h1 / 2) ** 2, h2**3 / 12
        return width * (E1 * strip + E2 * (layer + h2 * (h1 + h2 / 2 - axis) ** 2))

    def tip(f: Any) -> Any:
        EI, w = stiffness(f), TWO_PI * f
        b = (w * w * width * (rho1 * h1 + rho2 * h2) / EI) ** 0.25
        x = b * length
        top = np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)
        return top / (EI * b**3 * (1 + np.cos(x) * np.cosh(x)))

    def peaks(f: Any, H: Any) -> list[tuple[float, float]]:
        """Where |ω H| is largest, and the width at half of its power over that."""
        size, found = np.abs(f * H), []
        for k in np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1:
            above = size > size[k] / np.sqrt(2)
            first, last = k, k
            while above[first - 1]:
                first -= 1
            while above[last + 1]:
                last += 1
            found.append((f[k], (f[last] - f[first]) / f[k]))
        return found

    f = np.arange(5.0, 1200.0, 0.02)
    z = rom.outputs.index("tip.fz")
    ours, theirs = peaks(f, rom.transfer(TWO_PI * f)[:, z, 0]), peaks(f, tip(f))
    assert len(ours) == len(theirs) >= 3
    for (at, loss), (other, other_loss) in zip(ours, theirs, strict=True):
        assert at == pytest.approx(other, rel=0.01)
        assert loss == pytest.approx(other_loss, rel=0.05)


def test_exports_say_what_they_cannot_hold(tmp_path: Path) -> None:
    """Formats of K, M and D refuse terms; an equivalent damping tells what it changes."""
    rom = model_of(tmp_path / "a.h5", {"E": 5e7, "viscoelastic": {"prony": [[0.3, 3e-4]]}})
    for kind in ("abaqus", "nastran", "dmig", "mbdyn"):
        with pytest.raises(BodyError, match=r"rubber: 1 Prony term.*--damping modal"):
            export(rom, tmp_path / f"b.{kind}", kind)
    viscous, error = with_viscous_damping(rom)
    assert not viscous.system.loss and 0 < error < 0.5
    _, other = with_viscous_damping(rom, "rayleigh")
    assert other > error
    shapes = np.linalg.eigvalsh(np.linalg.solve(viscous.M, viscous.K))
    assert np.sqrt(shapes.min()) > rom.modes.min()  # stiffer than in the long term
    form = rom.physical()
    for omega in (300.0, 2000.0, 9000.0):
        H, turned = rom.transfer(omega), form.transfer(omega)
        assert np.linalg.norm(turned - H) < 1e-8 * np.linalg.norm(H)
    with pytest.raises(BodyError, match="part a has viscoelastic materials"):
        couple({"a": rom, "b": rom}, [("a.end", "b.end")])


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


@pytest.mark.parametrize(
    ("rubber", "said"),
    [
        ({"E": 1e7, "viscoelastic": {}}, "give prony, or table"),
        ({"E": 1e7, "viscoelastic": 5}, "viscoelastic must be a mapping"),
        ({"E": 1e7, "viscoelastic": {"prony": ["12"]}}, "must be a list of numbers"),
        ({"E": 1e7, "viscoelastic": {"prony": [[0.6, 1], [0.5, 2]]}}, "sum below 1"),
        ({"E": 1e7, "viscoelastic": {"prony": [[-0.1, 1]]}}, "not negative"),
        ({"E": 1e7, "viscoelastic": {"prony": [[0.1, 0]]}}, "tau [s] is positive"),
        ({"E": 1e7, "viscoelastic": {"prony": [0.1, 1]}}, "must be a list"),
        ({"E": 1e7, "viscoelastic": {"prony": [[0.1, 1]], "modulus": "x"}}, "unknown key modulus"),
        ({"E": 1e7, "viscoelastic": {"prony": {"axial": [[0.1, 1]]}}}, "unknown key axial"),
        ({"E": 1e7, "viscoelastic": {"table": {"hz": [1, 2]}}}, "leave E out"),
        ({"viscoelastic": {"table": {"hz": [1, 2], "storage": [1e7, 2e7]}}}, "loss or loss_factor"),
        (
            {"viscoelastic": {"table": {"hz": [2, 1], "storage": [1e7, 2e7], "loss": [0, 0]}}},
            "hz must rise",
        ),
        (
            {"viscoelastic": {"table": {"hz": [1, 2], "storage": [1e7], "loss": [0, 0]}}},
            "have 2, 1 and 2 numbers",
        ),
    ],
)
def test_descriptions_that_are_refused(rubber: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match="materials: rubber") as refused:
        mounted(tmp_path / "a.h5", rubber)
    assert said in str(refused.value)


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
    shear = {"E": 5e7, "viscoelastic": {"prony": {"shear": [[0.3, 3e-4]]}}}
    failed = run(
        *("reduce", "-body", mounted(tmp_path / "b.h5", shear), "-mor_band_hz", "10,100"), expect=1
    )
    assert "needs tetrahedra, hexahedra of 20 nodes or wedges, not hexahedron" in message(failed)
