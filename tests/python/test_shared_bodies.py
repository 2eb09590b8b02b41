"""Bodies made by other people, with reference results computed independently (SciPy, CalculiX).

They live beside the repository in ../shared/data and are skipped where that folder is absent.
"""

from __future__ import annotations

import lzma
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as sl
from scipy.sparse.linalg import eigsh

from conftest import SHARED, assembled, message, run, sweep_transfer
from flexgram import import_body, write_matrices

Loader = Callable[[str], dict[str, Any]]

PLEUEL = """
mesh: pleuel.msh
materials: {steel: {E: 210.0e9, nu: 0.3, rho: 7850}}
regions: {"361": {material: steel}}
interfaces:
  big_end: {coupling: rigid, nodes: "362"}
  small_end: {coupling: distributing, nodes: "363"}
damping: {alpha: 10, beta: 1.0e-7}
"""
FREE = """
mesh: pleuel.msh
materials: {steel: {E: 210.0e9, nu: 0.3, rho: 7850}}
regions: {"361": {material: steel}}
interfaces:
  big_end: {coupling: distributing, nodes: "362"}
  small_end: {coupling: distributing, nodes: "363"}
"""


@pytest.fixture(scope="module")
def pleuel(load_case: Loader, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the connecting rod's mesh in metres."""
    folder = tmp_path_factory.mktemp("pleuel")
    raw = folder / "raw.msh"
    raw.write_bytes(lzma.decompress((SHARED / "amfe_pleuel/pleuel_7000.msh.xz").read_bytes()))
    mesh = meshio.read(raw)
    mesh.points *= 0.01  # the file has no unit, the reference takes centimetres
    meshio.write(folder / "pleuel.msh", mesh, file_format="gmsh22", binary=False)
    return folder


def make(folder: Path, description: str) -> Path:
    (folder / "body.yaml").write_text(description)
    import_body(folder / "body.yaml", folder / "body.h5")
    return folder / "body.h5"


@pytest.mark.parametrize("ranks", [1, 2])
def test_connecting_rod_from_a_foreign_mesh(
    load_case: Loader, pleuel: Path, tmp_path: Path, ranks: int
) -> None:
    reference = load_case("amfe_pleuel")["ref"]
    body = assembled(tmp_path / "matrices.h5", make(pleuel, FREE), ranks)
    assert body["K"].shape[0] == reference["n"]
    translation = (body["component"] == 0).astype(float)
    assert translation @ (body["M"] @ translation) == pytest.approx(reference["mass"], rel=1e-8)
    squares = eigsh(body["K"], 16, body["M"], sigma=-1e7, tol=0, return_eigenvectors=False)
    hz = np.sqrt(np.abs(np.sort(squares))) / (2 * np.pi)
    assert np.allclose(hz[6:16], reference["freq_Hz"][6:16], rtol=1e-8)
    assert np.all(hz[:6] < 1)
    # Both ends carry their loads: the ports of a bore sum up to unit forces.
    assert body["B"].shape[1] == 12
    for axis in range(3):
        total = body["B"][body["component"] == axis].sum(axis=0)
        assert np.allclose(total[axis], 1) and np.allclose(total[6 + axis], 1)


@pytest.mark.parametrize("ranks", [1, 2])
def test_connecting_rod_is_reduced(pleuel: Path, tmp_path: Path, ranks: int) -> None:
    body, out = make(pleuel, PLEUEL), tmp_path / "rom.h5"
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "100,12000",
        "-mor_tol",
        "1e-4",
        "-mor_out",
        out,
        ranks=ranks,
    )
    sweep = tmp_path / "sweep.h5"
    run(
        "sweep",
        "-body",
        body,
        "-rom",
        out,
        "-mor_sweep_hz",
        "150,11900,60",
        "-mor_sweep_out",
        sweep,
        ranks=ranks,
    )
    with h5py.File(sweep) as file:
        assert file["error/relative"][:].max() < 1e-3
    with h5py.File(out) as file:
        assert file["K"].shape[0] < 60


def sweep_at(body: Path, hz: Any, folder: Path, ranks: int) -> Any:
    H = []
    for f in hz:
        out = folder / "point.h5"
        run(
            "sweep",
            "-body",
            body,
            "-mor_sweep_hz",
            repr(float(f)),
            "-mor_sweep_out",
            out,
            ranks=ranks,
        )
        H.append(sweep_transfer(out)[1][0])
    return np.array(H)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("name", ["crank", "hb_bcsst08", "nlevp_shaft"])
def test_sweep_equals_the_reference(
    load_case: Loader, tmp_path: Path, name: str, ranks: int
) -> None:
    case = load_case(name)
    reference = case["npz"]["H"]
    damping: dict[str, Any] = {"D": case["D"]} if "D" in case else {}
    if name == "crank":
        damping = {"alpha": case["ref"]["alpha"], "beta": case["ref"]["beta"]}
    body = tmp_path / "body.h5"
    write_matrices(body, case["K"], case["M"], case["B"], C=case["C"], **damping)
    H = sweep_at(body, case["ref"]["frf_freq_Hz"], tmp_path, ranks)
    assert H.shape == reference.shape
    for found, expected in zip(H, reference, strict=True):
        assert np.linalg.norm(found - expected) < 1e-6 * np.linalg.norm(expected)


def test_pod_has_the_reference_singular_values(load_case: Loader, tmp_path: Path) -> None:
    """Crank, 20 snapshots: log-spaced ones of the reference by the logarithmic midpoint rule."""
    case = load_case("crank")
    fsnap = np.asarray(case["npz"]["fsnap"])
    step = np.sqrt(fsnap[1] / fsnap[0])  # the midpoint rule's band starts half a step earlier
    band = f"{float(fsnap[0] / step)!r},{float(fsnap[-1] * step)!r}"
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(
        body,
        case["K"],
        case["M"],
        case["B"],
        C=case["C"],
        alpha=case["ref"]["alpha"],
        beta=case["ref"]["beta"],
    )
    run(
        "reduce",
        "-body",
        body,
        "-mor_method",
        "pod",
        "-mor_band_hz",
        band,
        "-mor_samples",
        len(fsnap),
        "-mor_spacing",
        "log",
        "-mor_inner_product",
        "euclidean",
        "-mor_port_scaling",
        "none",
        "-mor_order",
        20,
        "-mor_out",
        out,
    )
    with h5py.File(out) as file:
        sigma, omega = file["gramian/sigma"][:], file["error/omega"][:]
    assert np.all([np.abs(omega / (2 * np.pi) / f - 1).min() < 1e-9 for f in fsnap])
    # The reference keeps singular values of unweighted snapshots; the rule weighs them by w_l/π
    # with w_l = ω_l ln(step²). So compare with samples computed and weighted here.
    M, K = case["M"].toarray(), case["K"].toarray()
    D = case["ref"]["alpha"] * M + case["ref"]["beta"] * K
    B = case["B"].toarray() if hasattr(case["B"], "toarray") else case["B"]
    Z = []
    for f in fsnap:
        w = 2 * np.pi * f
        X = np.linalg.solve(K + 1j * w * D - w**2 * M, B) * np.sqrt(2 * w * np.log(step) / np.pi)
        Z += [X.real, X.imag]
    expected = sl.svdvals(np.hstack(Z)) ** 2
    count = int(np.sum(expected > 1e-8 * expected[0]))
    assert np.allclose(sigma[:count], expected[:count], rtol=1e-6)


def test_constrained_rows_of_ansys_are_named(load_case: Loader, tmp_path: Path) -> None:
    """ANSYS leaves constrained dofs as zero rows; the message must say so."""
    import scipy.sparse as sp

    case = load_case("ansys_hexbeam")
    zero = sp.csr_matrix((1, 1))
    K, M = sp.block_diag([case["K"], zero]), sp.block_diag([case["M"], zero])
    B = np.zeros((K.shape[0], 1))
    B[0] = 1
    write_matrices(tmp_path / "body.h5", K, M, B)
    result = run("reduce", "-body", tmp_path / "body.h5", "-mor_out", tmp_path / "r.h5", expect=1)
    assert "ANSYS" in message(result)


@pytest.mark.parametrize("name", ["ccx_beamf4", "exudyn_blockC3D20R"])
def test_singular_mass_is_reduced(load_case: Loader, tmp_path: Path, name: str) -> None:
    """A fifth of the mass matrix' eigenvalues are zero, rounded to 14 digits by the export."""
    case = load_case(name)
    n = case["K"].shape[0]
    B = np.zeros((n, 3))
    B[n // 3, 0] = B[n // 2, 1] = B[n - 1, 2] = 1
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, case["K"], case["M"], B, alpha=5.0, beta=1e-7)
    top = float(np.asarray(case["ref"]["freq_Hz"]).max()) if "freq_Hz" in case["ref"] else 5000.0
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        f"{top / 50},{top / 2}",
        "-mor_tol",
        "1e-5",
        "-mor_out",
        out,
        ranks=2,
    )
    with h5py.File(out) as file:
        assert file["error/relative"][:].max() <= 1e-5
        assert np.linalg.eigvalsh(file["M"][:]).min() > 0
