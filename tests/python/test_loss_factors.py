"""Materials with loss factors of their own: K = Σ K_k (1 + iη_k), certified like other damping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.linalg as sl
import scipy.sparse as sp
from test_nastran import punched
from ways import in_every_way

import flexgram
from bodies import box
from conftest import body_system, message, run
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.body.description import import_description
from flexgram.exporters import export
from flexgram.model.equivalent_damping import with_viscous_damping

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7850.0}
RUBBER = {"E": 50e6, "nu": 0.45, "rho": 1100.0}


def mounted(path: Path, steel: float, rubber: float, **more: Any) -> Path:
    """A steel box whose first third is rubber, clamped there or free."""
    mesh = box("hexahedron", (6, 2, 2), (0.3, 0.06, 0.05), distort=False)
    middle = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 0]
    soft = middle < 0.1
    mesh.cell_sets = {"mount": [np.flatnonzero(soft)], "part": [np.flatnonzero(~soft)]}
    content = {
        "materials": {
            "steel": {**STEEL, "loss_factor": steel},
            "rubber": {**RUBBER, "loss_factor": rubber},
        },
        "regions": {"mount": {"material": "rubber"}, "part": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        **more,
    }
    import_description(content, "mounted", path, mesh=mesh)
    return path


def stored(path: Path, ranks: int = 1) -> dict[str, Any]:
    """K, M and S of an assembled body."""
    matrices = path.with_suffix(f".{ranks}.h5")
    run("assemble", "-body", path, "-body_out", matrices, ranks=ranks)
    system = body_system(matrices)
    with h5py.File(matrices) as file:
        if "S" not in file:
            return {"K": system.K, "M": system.M, "B": system.B, "eta": float(file.attrs["eta"])}
        group = file["S"]
        shape = (int(group.attrs["MATLAB_sparse"]), len(group["jc"]) - 1)
        S = sp.csc_matrix((group["data"][:], group["ir"][:], group["jc"][:]), shape=shape)
    return {"K": system.K, "M": system.M, "B": system.B, "S": S}


def response(a: dict[str, Any], omega: float, alpha: float = 0, beta: float = 0) -> Any:
    """H of the full matrices by a dense solve."""
    K, M, S = (np.asarray(x.todense()) if sp.issparse(x) else x for x in (a["K"], a["M"], a["S"]))
    A = K * (1 + 1j * omega * beta) + 1j * S - (omega**2 - 1j * omega * alpha) * M
    return a["B"].T @ sl.solve(A, a["B"])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("alpha", [0.0, 5.0])
def test_a_rubber_mount_is_certified(ranks: int, alpha: float, tmp_path: Path) -> None:
    """S is the sum over the elements; the reduced body keeps its claim at resonances and between,
    against dense solves with the full matrices."""
    body = mounted(tmp_path / "body.h5", 0.001, 0.2, damping={"alpha": alpha, "beta": 1e-7})
    a = stored(body, ranks)
    soft, hard = (stored(mounted(tmp_path / f"{x}.h5", x, 1 - x)) for x in (0.0, 1.0))
    expected = 0.2 * soft["S"] + 0.001 * hard["S"]  # rubber alone, steel alone
    assert abs(a["S"] - expected).max() < 1e-12 * abs(expected).max()
    out = tmp_path / "rom.h5"
    said = run(
        *("reduce", "-body", body, "-mor_band_hz", "5,2000", "-mor_tol", "1e-5"),
        *("-mor_out", out),
        ranks=ranks,
    ).out
    assert "structural (S, the imaginary" in said
    rom = ReducedModel.load(out)
    assert rom.met and rom.kind == "certified" and rom.order < 40
    K, M = (np.asarray(x.todense()) if sp.issparse(x) else x for x in (a["K"], a["M"]))
    modes = np.sqrt(sl.eigh(K, M, eigvals_only=True))
    inside = modes[modes < 2 * np.pi * 2000]
    assert len(inside) > 4
    rng = np.random.default_rng(3)
    for omega in [*inside, *(0.5 * (inside[1:] + inside[:-1])), *rng.uniform(32, 12500, 8)]:
        H = response(a, float(omega), alpha, 1e-7)
        error = np.linalg.norm(rom.transfer(float(omega)) - H) / np.linalg.norm(H)
        assert error <= rom.certified_error <= 1e-5


def test_one_loss_factor_is_eta(tmp_path: Path) -> None:
    """Alike in all materials, it needs no further matrix; eta of the body adds to it."""
    a = stored(mounted(tmp_path / "body.h5", 0.05, 0.05, damping={"eta": 0.01}))
    assert a["eta"] == pytest.approx(0.06, rel=1e-14) and "S" not in a
    both = stored(mounted(tmp_path / "two.h5", 0.05, 0.1))
    body = tmp_path / "S.h5"
    K = sp.csc_matrix(both["K"])
    flexgram.write_matrices(body, K, sp.csc_matrix(both["M"]), both["B"], S=0.03 * K)
    assert "structural (η = 0.03)" in run("plan", "-body", body, "-mor_band_hz", "5,100").out


def test_in_memory_from_a_medium_and_without_rigid_motion(tmp_path: Path) -> None:
    """Python's matrices, a medium model's file, saved and loaded: one H. A free body."""
    body = mounted(tmp_path / "body.h5", 0.002, 0.3, supports={})
    a = stored(body)
    sparse = {name: sp.csc_matrix(a[name]) for name in "KMS"}
    given = Matrices(
        **sparse,
        B=a["B"],
        inputs=[f"end.{d}" for d in ("fx", "fy", "fz")] + ["end.mx", "end.my", "end.mz"],
    )
    direct = flexgram.reduce(given, (20, 1500), 1e-4)
    medium, cut = tmp_path / "medium.h5", tmp_path / "cut.h5"
    band = ("-mor_band_hz", "20,1500", "-mor_tol", "1e-4")
    run("certify", "-body", body, *band, "-mor_medium_out", medium)
    run("cut", "-medium", medium, "-mor_tol", "1e-4", "-mor_out", cut)
    loaded = ReducedModel.load(cut)
    pod = tmp_path / "pod.h5"
    run(
        "reduce",
        "-body",
        body,
        *band[:2],
        "-mor_method",
        "pod",
        "-mor_order",
        "30",
        "-mor_out",
        pod,
    )
    for hertz in (33.0, 250.0, 1200.0):
        omega = 2 * np.pi * hertz
        H = response(a, omega)
        for rom in (direct, loaded):
            error = np.linalg.norm(rom.transfer(omega) - H) / np.linalg.norm(H)
            assert error <= rom.certified_error <= 1e-4
        other = ReducedModel.load(pod).transfer(omega)
        assert np.linalg.norm(other - H) < 1e-3 * np.linalg.norm(H)
    sweep = tmp_path / "sweep.h5"
    both = ("-body", body, "-rom", cut, "-mor_sweep_out", sweep)
    run("sweep", *both, "-mor_sweep_hz", "33,250,2")
    with h5py.File(sweep) as file:
        for omega, H, H_r in zip(file["omega"][:], file["H"][:], file["H_rom"][:], strict=True):
            exact = response(a, float(omega))
            assert np.linalg.norm(H[..., 0] + 1j * H[..., 1] - exact) < 1e-8 * np.linalg.norm(exact)
            error = np.linalg.norm(H_r[..., 0] + 1j * H_r[..., 1] - exact)
            assert error <= loaded.certified_error * np.linalg.norm(exact)


@pytest.mark.parametrize("kind", ["op4", "pch", "mat"])
def test_structural_damping_of_files(kind: str, tmp_path: Path) -> None:
    """K4AA of Nastran and a named matrix of MATLAB, if they are asked for; in mm-t-s."""
    n = 12
    K = 1e3 * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(n, n)).tocsc()
    M = sp.identity(n, format="csc")
    S = sp.diags(np.linspace(1.0, 50.0, n)).tocsc()
    file = tmp_path / f"part.{kind}"
    if kind == "op4":
        op4 = pytest.importorskip("pyNastran.op4.op4")
        matrices = {"KAA": (6, K.toarray()), "MAA": (6, M.toarray()), "K4AA": (6, S.toarray())}
        op4.OP4().write_op4(str(file), matrices, is_binary=False)
    elif kind == "pch":
        dofs = [(1 + i // 3, 1 + i % 3) for i in range(n)]
        punched(file, dofs, KAAX=K, MAAX=M, K4AAX=S)
    else:
        scipy.io.savemat(file, {"K": K, "M": M, "loss": S})
    name = {"op4": "K4AA", "pch": "K4AAX", "mat": "loss"}[kind]
    body = tmp_path / "body.h5"
    common = ("import", file, "--rows", "tip=12", "--units", "mm-t-s", "-o", body)
    said = run(*common).out
    assert kind == "mat" or f"{name} is left out: --matrices S={name}" in said
    run(*common, "--matrices", f"S={name}")
    full = {"K": 1e3 * K, "M": 1e3 * M, "S": 1e3 * S, "B": np.eye(n)[:, -1:]}  # N/mm and t
    out = tmp_path / "rom.h5"
    run("reduce", "-body", body, "-mor_band_hz", "0.5,4", "-mor_tol", "1e-6", "-mor_out", out)
    rom = ReducedModel.load(out)
    for hertz in (0.5, 1.7, 3.9):
        H, omega = response(full, 2 * np.pi * hertz), 2 * np.pi * hertz
        assert np.linalg.norm(rom.transfer(omega) - H) <= rom.certified_error * np.linalg.norm(H)


def test_the_physical_form_and_abaqus_hold_it(tmp_path: Path) -> None:
    """Interface motions first: the same H, and in Abaqus' file the same S."""
    body = mounted(tmp_path / "body.h5", 0.001, 0.2)
    out = tmp_path / "rom.h5"
    run("reduce", "-body", body, "-mor_band_hz", "5,800", "-mor_tol", "1e-4", "-mor_out", out)
    rom = ReducedModel.load(out)
    form = rom.physical()
    for omega in (300.0, 2000.0, 4400.0):
        H, other = rom.transfer(omega), form.transfer(omega)
        assert np.linalg.norm(other - H) < 1e-8 * np.linalg.norm(H)
    export(rom, tmp_path / "part.inp", "abaqus")
    assert "STRUCTURAL DAMPING=" in (tmp_path / "part.inp").read_text()
    for kind in ("nastran", "dmig", "mbdyn"):
        with pytest.raises(BodyError, match=r"by material.*--damping modal"):
            export(rom, tmp_path / f"b.{kind}", kind)


def test_losses_of_rigid_motion_are_no_elastic_part(tmp_path: Path) -> None:
    """A free body's S that acts on rigid motion: its elastic part is refused, as with dashpots."""
    n = 12
    K = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n)).tolil()
    K[0, 0] = K[-1, -1] = 1.0
    S = 0.02 * K.copy()
    S[3, 3] += 0.5
    B = np.eye(n)[:, [0, n - 1]]
    rom = flexgram.reduce(
        Matrices(K.tocsr(), sp.identity(n, format="csr"), B, S=S.tocsr()), (0.05, 0.2), 1e-3
    )
    assert rom.frame.rigid_modes == 1
    for part in (rom.elastic, rom.without_rigid_modes):
        with pytest.raises(BodyError, match="rigid motion"):
            part()


def test_there_is_no_time_domain(tmp_path: Path) -> None:
    """Formats in time refuse S by name; an equivalent viscous damping, mode by mode, tells the
    error that it makes."""
    body = mounted(tmp_path / "body.h5", 0.001, 0.1)
    out = tmp_path / "rom.h5"
    run("reduce", "-body", body, "-mor_band_hz", "5,800", "-mor_tol", "1e-3", "-mor_out", out)
    rom = ReducedModel.load(out)
    for work in (
        lambda: rom.state_space(),
        lambda: rom.simulate(np.ones((3, 6)), [0.0, 1.0, 2.0]),
        lambda: export(rom, tmp_path / "b.fmu", "fmu"),
    ):
        with pytest.raises(BodyError, match="by material"):
            work()
    viscous, error = with_viscous_damping(rom)
    assert not viscous.system.loss and 0 < error < 0.3
    viscous.state_space()
    _, other = with_viscous_damping(rom, "rayleigh")
    assert other > error  # two numbers for all modes
    assert np.allclose(viscous.system.D, viscous.system.D.T)


def with_dampers(n: int = 90) -> dict[str, Any]:
    """A chain whose last third has a loss factor of 0.1, with a dashpot at a quarter of it."""
    stiff = sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(n, n), format="csc")
    soft = sp.diags(np.where(np.arange(n) < 2 * n // 3, 0.0, 1.0))
    D = sp.coo_matrix(([0.02], ([n // 4], [n // 4])), shape=(n, n)).tocsc()
    B = np.eye(n)[:, [n - 1, n // 2]]
    M = sp.identity(n, format="csc")
    return {"K": stiff, "M": M, "B": B, "D": D, "S": 0.1 * (soft @ stiff @ soft).tocsc()}


@pytest.mark.parametrize("ranks", [1, 2])
def test_dampers_and_loss_factors_together(ranks: int, tmp_path: Path) -> None:
    """A body with D and S is certified; the claim holds against dense solves in and between
    resonances, from a file, from its medium model and by pod."""
    a = with_dampers()
    K, M, D, S = (a[name].toarray() for name in "KMDS")
    body, band = tmp_path / "body.h5", (0.002, 0.04)
    flexgram.write_matrices(body, **a, alpha=1e-4)
    said, rom, again, sampled = in_every_way(body, band, 12, ranks)
    assert "general D + structural (S" in said
    assert rom.system.S.any() and rom.D.any()
    modes = np.sqrt(sl.eigh(K, M, eigvals_only=True))
    inside = modes[(modes > 2 * np.pi * band[0]) & (modes < 2 * np.pi * band[1])]
    assert len(inside) > 4
    for omega in [*inside, *(0.5 * (inside[1:] + inside[:-1]))]:
        A = K + 1j * S + 1j * omega * (D + 1e-4 * M) - omega**2 * M
        H = a["B"].T @ sl.solve(A, a["B"])
        size = np.linalg.norm(H)
        for model in (rom, again):
            assert np.linalg.norm(model.transfer(float(omega)) - H) <= 1e-6 * size
        assert np.linalg.norm(sampled.transfer(float(omega)) - H) < 0.1 * size


def test_dampers_stay_beside_an_equivalent_of_loss_factors() -> None:
    """Viscous damping that replaces S is added to D, and is what it is without D."""
    rom = flexgram.reduce(Matrices(**with_dampers()), (0.002, 0.04), 1e-6)
    without = rom.with_parts(system=replace(rom.system, D=np.zeros_like(rom.D)))
    viscous, alone = (with_viscous_damping(model)[0] for model in (rom, without))
    assert alone.D.any() and not viscous.system.S.any()
    assert np.array_equal(viscous.D, rom.D + alone.D)


def test_what_is_refused(tmp_path: Path) -> None:
    K = sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(30, 30)).tocsc()
    M, B = sp.identity(30, format="csc"), np.eye(30)[:, :1]
    S = sp.diags(np.linspace(0.1, 0.2, 30)).tocsc()
    flexgram.write_matrices(tmp_path / "b.h5", K, M, B, S=-S)
    failed = run("reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "0.01,0.1", expect=1)
    assert "S(0, 0) = -0.1 is negative" in message(failed)
    with pytest.raises(BodyError, match="loss_factor = -1"):
        mounted(tmp_path / "c.h5", -1, 0.1)
    body = mounted(
        tmp_path / "d.h5", 0.1, 0.2, outputs={"foot": {"type": "reaction", "nodes": "start"}}
    )
    failed = run("reduce", "-body", body, "-mor_band_hz", "10,100", expect=1)
    assert "reactions of a body whose materials have loss factors" in message(failed)
