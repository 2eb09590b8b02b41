"""Bodies with gyroscopic forces, whose A(ω) is not symmetric, against elimination."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.linalg as sl
import scipy.sparse as sp

import flexgram
from bodies import box
from conftest import assembled, body_system, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.assembly.couple import couple
from flexgram.body.description import import_description
from flexgram.exporters.dmig import write_dmig

TWO_PI = 2 * np.pi
BAND = (2.0, 20.0)  # Hz, of the rotor


def rotor(planes: int = 30, speed: float = 60.0, massless: bool = False) -> dict[str, Any]:
    """A shaft of masses that move across it, in unequal bearings. Discs that spin couple both
    directions; with `massless` every seventh node has none."""
    n, rng = 2 * planes, np.random.default_rng(3)
    bend = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], (planes, planes))
    line = 1e6 * bend @ bend + sp.diags(1e4 * rng.random(planes))
    mass = 1 + rng.random(planes)
    if massless:
        mass[::7] = 0
    K = sp.kron(line, np.diag([1.1, 1.0])).tocsc()
    M = sp.kron(sp.diags(mass), np.eye(2)).tocsc()
    disc = sp.diags(speed * rng.uniform(0.2, 1, planes) * mass)
    G = sp.kron(disc, np.array([[0, -1.0], [1.0, 0]])).tocsc()
    B = np.zeros((n, 3))
    B[0, 0] = B[planes, 1] = B[n - 1, 2] = 1
    return {"K": K, "M": M, "G": G, "B": B}


def transfer(body: dict[str, Any], D: Any, omega: float, C: Any = None) -> Any:
    A = (body["K"] + 1j * omega * D - omega**2 * body["M"]).toarray()
    return (body["B"].T if C is None else C) @ np.linalg.solve(A, body["B"])


def largest_error(rom: Any, body: dict[str, Any], D: Any, C: Any = None) -> float:
    """Over frequencies, those of the reduced body's poles among them."""
    omega = np.concatenate([np.linspace(*BAND, 200) * TWO_PI, abs(np.imag(rom.poles()))])
    omega = omega[(omega >= TWO_PI * BAND[0]) & (omega <= TWO_PI * BAND[1])]
    worst = 0.0
    for w, H_r in zip(omega, rom.transfer(omega), strict=True):
        H = transfer(body, D, w, C)
        worst = max(worst, float(np.linalg.norm(H - H_r) / np.linalg.norm(H)))
    return worst


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("speed", "massless", "tolerance"), [(60, False, 1e-5), (600, False, 1e-3), (60, True, 1e-7)]
)
def test_a_rotor_is_certified(
    speed: float, massless: bool, tolerance: float, ranks: int, tmp_path: Path
) -> None:
    body = rotor(speed=speed, massless=massless)
    D = (2e-5 * body["K"] + body["G"]).tocsc()
    write_matrices(tmp_path / "body.h5", body["K"], body["M"], body["B"], D=D)
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "2,20"),
        *("-mor_tol", tolerance, "-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    ).out
    assert "gyroscopic forces" in said and "taken for gyroscopic forces" in said
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.kind == "certified" and rom.certified_error <= tolerance
    assert rom.order < 60
    found = largest_error(rom, body, D)
    assert 0.3 * rom.certified_error < found <= rom.certified_error
    H = rom.transfer([TWO_PI * 9.0])[0]
    assert abs(H - H.T).max() > 1e-2 * abs(H).max()  # of the one direction, and not of the other


def test_outputs_of_their_own_and_files(tmp_path: Path) -> None:
    """Outputs that are no inputs; /G apart from D; in memory; a kept medium model."""
    body = rotor()
    loss = (2e-5 * body["K"]).tocsc()
    C = np.zeros((2, 60))
    C[0, 7] = C[1, 40] = 1
    D = loss + body["G"]
    maps = (body["K"], body["M"], body["B"])
    K, M = (sp.csr_matrix(a) for a in maps[:2])
    whole = flexgram.reduce(flexgram.Matrices(K, M, maps[2], D=D.tocsr(), C=C), BAND, 1e-6)
    assert whole.kind == "certified" and largest_error(whole, body, D, C) <= whole.certified_error
    write_matrices(tmp_path / "apart.h5", *maps, C=C, D=loss)
    columns = body["G"].tocsc()
    with h5py.File(tmp_path / "apart.h5", "a") as file:
        group = file.create_group("G")
        group.attrs["MATLAB_sparse"] = np.uint64(60)
        group["data"], group["ir"], group["jc"] = columns.data, columns.indices, columns.indptr
    medium = flexgram.certify(tmp_path / "apart.h5", BAND, 1e-6)
    kept = tmp_path / "medium.h5"
    medium.save(kept)
    for source in (medium, flexgram.Medium.load(kept)):
        rom = source.reduce(tol=1e-6)
        assert rom.kind == "certified" and rom.order == whole.order
        assert largest_error(rom, body, D, C) <= rom.certified_error


@pytest.mark.parametrize(
    "method", ["gramian", "weighted", "optimal", "modal", "krylov", "balanced", "irka"]
)
def test_methods_of_the_second_stage(method: str) -> None:
    """Each leaves a claim that holds; the optimum is no worse than the Gramian's."""
    body = rotor(planes=12)
    D = 1e-4 * body["K"] + body["G"]
    matrices = flexgram.Matrices(
        sp.csr_matrix(body["K"]), sp.csr_matrix(body["M"]), body["B"], D=sp.csr_matrix(D)
    )
    error = {
        name: flexgram.reduce(
            matrices, (0.5, 3.0), order=8, options={"mor_second_stage": name}
        ).certified_error
        for name in {"gramian", method}
    }
    rom = flexgram.reduce(matrices, (0.5, 3.0), order=8, options={"mor_second_stage": method})
    omega = TWO_PI * np.linspace(0.5, 3.0, 100)
    for w, H_r in zip(omega, rom.transfer(omega), strict=True):
        H = transfer(body, D, w)
        assert np.linalg.norm(H - H_r) <= rom.certified_error * np.linalg.norm(H)
    if method == "optimal":
        assert error["optimal"] <= error["gramian"]


def test_in_time_and_in_other_codes(tmp_path: Path) -> None:
    """A state space with the forces, and no file that would lose them."""
    body = rotor(planes=12)
    matrices = flexgram.Matrices(
        *(sp.csr_matrix(body[name]) for name in "KM"),
        body["B"],
        D=sp.csr_matrix(1e-4 * body["K"] + body["G"]),
    )
    rom = flexgram.reduce(matrices, (0.5, 3.0), 1e-4)
    A, B, C, _ = rom.state_space()
    s = 1j * TWO_PI * 2.2
    np.testing.assert_allclose(
        C @ np.linalg.solve(s * np.eye(len(A)) - A, B), rom.transfer([s.imag])[0], rtol=1e-9
    )
    with pytest.raises(BodyError, match="takes symmetric matrices only"):
        couple({"a": rom}, [])
    with pytest.raises(BodyError, match="this file takes symmetric matrices only"):
        write_dmig(rom, tmp_path / "rom.pch")
    with pytest.raises(BodyError, match="this form takes symmetric matrices only"):
        rom.physical()
    rom.save(tmp_path / "rom.h5")
    first = np.sort(rom.poles().imag[rom.poles().imag > 0])[0] / TWO_PI
    assert f"or circulatory forces [Hz]: {first:.5g}" in run("info", tmp_path / "rom.h5").out


@pytest.mark.parametrize("kind", ["D", "G", "market"])
def test_imports_keep_the_sense(kind: str, tmp_path: Path) -> None:
    """A skew part of D, or G beside it, from MATLAB; D from MatrixMarket, of an FE code."""
    body = rotor(planes=12)
    loss = 1e-4 * body["K"]
    D = (loss + body["G"]).tocsc()
    file = tmp_path / "body.h5"
    if kind == "market":
        for name, matrix in (("K", body["K"]), ("M", body["M"]), ("D", D)):
            scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix.tocoo(), symmetry="general")
        files = [tmp_path / f"{name}.mtx" for name in "KMD"]
        pairs = ("--mass", files[1], "--damping", files[2], "-o", file)
        run("import", files[0], *pairs, "--rows", "a=1", "--rows", "b=24")
    else:
        parts = {"D": D} if kind == "D" else {"D": loss.tocsc(), "G": body["G"]}
        content = {"K": body["K"], "M": body["M"], "B": body["B"]} | parts
        scipy.io.savemat(tmp_path / "body.mat", content)
        run("import", tmp_path / "body.mat", "-o", file)
    rom = flexgram.reduce(file, (0.5, 3.0), 1e-6)
    maps = body["B"] if kind != "market" else np.eye(24)[:, [0, 23]]
    for omega in TWO_PI * np.array([0.7, 1.9, 2.8]):
        H = transfer(body | {"B": maps}, D, omega)
        assert np.linalg.norm(rom.transfer([omega])[0] - H) <= 1e-6 * np.linalg.norm(H)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_sweep_of_the_whole_body(ranks: int, tmp_path: Path) -> None:
    body = rotor()
    D = (2e-5 * body["K"] + body["G"]).tocsc()
    write_matrices(tmp_path / "body.h5", body["K"], body["M"], body["B"], D=D)
    said = run(
        *("sweep", "-body", tmp_path / "body.h5", "-mor_sweep_hz", "2,20,5"),
        *("-mor_sweep_out", tmp_path / "sweep.h5"),
        ranks=ranks,
    ).out
    assert "complex LU" in said
    with h5py.File(tmp_path / "sweep.h5") as file:
        omega, H = file["omega"][:], file["H"][..., 0] + 1j * file["H"][..., 1]
    for w, here in zip(omega, H, strict=True):
        np.testing.assert_allclose(here, transfer(body, D, w), rtol=1e-9, atol=1e-13)


def test_samples_of_the_other_sense_are_not_taken(tmp_path: Path) -> None:
    """A checkpoint of pod belongs to one sense of rotation."""
    body = rotor(planes=12)
    for name, sign in (("body", 1), ("other", -1)):
        D = (1e-4 * body["K"] + sign * body["G"]).tocsc()
        write_matrices(tmp_path / f"{name}.h5", body["K"], body["M"], body["B"], D=D)
    words = ("-mor_band_hz", "0.5,3", "-mor_method", "pod", "-mor_checkpoint", "yes")
    kept = ("-mor_out", tmp_path / "rom.h5", "-mor_samples", "6")
    run(*("reduce", "-body", tmp_path / "body.h5"), *words, *kept, "-mor_order", "500", expect=1)
    said = run(
        *("reduce", "-body", tmp_path / "other.h5"),
        *(*words, *kept, "-mor_restart", "-mor_order", "8"),
        expect=1,
    )
    assert "sense of G" in said.err


def test_coriolis_forces_are_bounded_by_inertia(tmp_path: Path) -> None:
    """Twice the speed, for every element: the claim needs it. Incompatible modes have mass too."""
    for kind in ("tetra", "tetra10", "hexahedron", "hexahedron20", "wedge15"):
        content = {
            "materials": {"steel": {"E": 210e9, "nu": 0.45, "rho": 7850.0}},
            "regions": {"all": {"material": "steel"}},
            "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
            "supports": {"start": {"nodes": "start"}},
            "loads": {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [2, 3, 6]}},
            "preload": {"turn.spin": 100.0},
        }
        import_description(content, "box", tmp_path / f"{kind}.h5", mesh=box(kind, (3, 1, 1)))
        a = assembled(tmp_path / f"{kind}.m.h5", tmp_path / f"{kind}.h5")
        largest = sl.eigh(1j * a["G"].toarray(), a["M"].toarray(), eigvals_only=True)[-1]
        assert 0.98 * 20 < largest <= 20 * (1 + 1e-9)


def test_reactions_of_a_spinning_body_are_refused(tmp_path: Path) -> None:
    content = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "loads": {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 3, 4]}},
        "outputs": {"foot": {"type": "reaction", "nodes": "start"}},
        "preload": {"turn.spin": 4e6},
    }
    import_description(content, "box", tmp_path / "body.h5", mesh=box("tetra10", (2, 1, 1)))
    with pytest.raises(BodyError, match="spins are not known yet"):
        flexgram.reduce(tmp_path / "body.h5", (100, 6000), 1e-3)


def test_forces_that_hold_an_unstable_body(tmp_path: Path) -> None:
    """K has negative eigenvalues: with enough spin no motion grows, with less one does. The claim
    is of H in both cases."""
    body = rotor(planes=12, speed=0.0)
    K = (body["K"] - 1.2e4 * sp.identity(24)).tocsc()
    negative = int((np.linalg.eigvalsh(K.toarray()) < 0).sum())
    assert negative >= 2
    sense = sp.kron(sp.diags(np.ones(12)), np.array([[0, -1.0], [1.0, 0]]))
    for speed, words in ((400.0, "gyroscopic forces hold the reduced body"), (20.0, "is unstable")):
        D = (1e-3 * sp.identity(24) + speed * sense).tocsc() if speed < 100 else speed * sense
        write_matrices(tmp_path / "body.h5", K, body["M"], body["B"], D=sp.csc_matrix(D), eta=0.0)
        said = run(
            *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "5,12"),
            *("-mor_tol", "1e-4", "-mor_out", tmp_path / "rom.h5"),
        )
        assert words in said.out + said.err
        rom = ReducedModel.load(tmp_path / "rom.h5")
        assert rom.certified_error <= 1e-4
        for omega in TWO_PI * np.linspace(5, 12, 40):
            A = (K + 1j * omega * D - omega**2 * body["M"]).toarray()
            H = body["B"].T @ np.linalg.solve(A, body["B"])
            if np.any(abs(omega - np.ravel(rom.excluded)) < 1e-3 * omega):
                continue
            assert np.linalg.norm(rom.transfer([omega])[0] - H) <= 1e-4 * np.linalg.norm(H)


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron"])
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_spinning_part_of_a_mesh(ranks: int, kind: str, tmp_path: Path) -> None:
    """Coriolis forces of solids in the frame that turns: twice the speed is what they weigh."""
    content = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0, "loss_factor": 0.01}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "loads": {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 3, 4]}},
        "preload": {"turn.spin": 4e6},
    }
    import_description(content, "box", tmp_path / "body.h5", mesh=box(kind, (6, 2, 2)))
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "100,6000"),
        *("-mor_tol", "1e-4", "-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    ).out
    assert "at most 4000 rad/s of the inertia" in said
    rom, full = ReducedModel.load(tmp_path / "rom.h5"), body_system(tmp_path / "body.h5")
    assert rom.kind == "certified" and rom.certified_error <= 1e-4
    difference = 0.0
    for omega in TWO_PI * np.array([100.0, 1234.5, 3000.0, 6000.0]):
        H = full.transfer(omega).astype(complex)
        assert np.linalg.norm(rom.transfer([omega])[0] - H) <= 1e-4 * np.linalg.norm(H)
        difference = max(difference, float(abs(H - H.T).max() / abs(H).max()))
    assert difference > 1e-2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"D": "upper"}, "holds only one triangle"),
        ({"G": "symmetric"}, "G is not skew"),
        ({"M": "skew"}, "only K and D may have one"),
    ],
)
def test_what_is_not_taken(change: dict[str, str], words: str, tmp_path: Path) -> None:
    body = rotor(planes=6)
    K, M, B, D = body["K"], body["M"], body["B"], None
    if "D" in change:
        D = sp.triu(body["G"]).tocsc()
    if "M" in change:
        M = (M + 0.1 * body["G"]).tocsc()
    write_matrices(tmp_path / "body.h5", K, M, B, D=D)
    if "G" in change:
        columns = abs(body["G"]).tocsc()
        with h5py.File(tmp_path / "body.h5", "a") as file:
            group = file.create_group("G")
            group.attrs["MATLAB_sparse"] = np.uint64(12)
            group["data"], group["ir"], group["jc"] = columns.data, columns.indices, columns.indptr
    with pytest.raises(BodyError, match=words):
        flexgram.reduce(tmp_path / "body.h5", (0.5, 3.0), 1e-3)


def test_strong_forces_without_mass_are_refused() -> None:
    """On dofs without mass and nearly without stiffness nothing bounds them."""
    body = rotor(planes=12)
    M = body["M"].tolil()
    M[0, 0] = M[1, 1] = 0
    G = body["G"].tolil()
    G[0, 1], G[1, 0] = 1e9, -1e9
    D = (1e-4 * body["K"] + G).tocsr()
    matrices = flexgram.Matrices(body["K"].tocsr(), M.tocsr(), body["B"], D=D)
    with pytest.raises(BodyError, match="no bound of them was found"):
        flexgram.reduce(matrices, (0.5, 3.0), 1e-3)
