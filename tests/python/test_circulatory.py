"""Bodies whose stiffness is not symmetric: oil films, friction, loads that follow. Against dense
solves of the whole body, and a rotor of Code_Aster's on bearings of this kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.io
import scipy.linalg as sl
import scipy.signal
import scipy.sparse as sp

import flexgram
from conftest import read_sparse, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.body.description import import_description
from flexgram.exporters import FORMATS, WITH_CIRCULATION, export
from flexgram.importers import import_matrices, read
from flexgram.importers.containers import read_petsc
from flexgram.model.campbell import campbell
from flexgram.model.equivalent_damping import with_viscous_damping

HZ = 2 * np.pi


def chain(
    n: int, follow: float, damping: float = 2e-4, across: float = 1.3
) -> tuple[Any, Any, Any, Any]:
    """K with a skew part, M, D and B of a chain with two dofs a node; a force at every node that
    follows the motion across."""
    one = sp.diags([-np.ones(n - 1), 2.1 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    K = sp.kron(sp.diags([1.0, across]), 1e6 * one)
    N = sp.kron([[0, 1], [-1, 0]], follow * sp.identity(n))
    M = sp.identity(2 * n)
    B = np.zeros((2 * n, 2))
    B[0, 0] = B[n + n // 2, 1] = 1
    return sp.csr_matrix(K + N), sp.csr_matrix(M), sp.csr_matrix(damping * K), B


def errors(rom: ReducedModel, K: Any, M: Any, D: Any, B: Any, frequencies: Any) -> Any:
    K, M, D = (a.toarray() for a in (K, M, D))
    found = []
    for omega in HZ * np.asarray(frequencies):
        H = B.T @ np.linalg.solve(K + 1j * omega * D - omega**2 * M, B)
        found.append(np.linalg.norm(rom.transfer([omega])[0] - H) / np.linalg.norm(H))
    return np.array(found)


@pytest.mark.parametrize(
    ("tolerance", "ranks"), [(1e-3, 2), pytest.param(1e-7, 1, marks=pytest.mark.kernels)]
)
def test_a_skew_stiffness_is_certified(tolerance: float, ranks: int, tmp_path: Path) -> None:
    K, M, D, B = chain(80, 3e4)
    write_matrices(tmp_path / "body.h5", K, M, B, D=D)
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,150"),
        *("-mor_tol", tolerance, "-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    ).out
    assert "taken for circulatory forces" in said
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.certified_error <= tolerance and rom.claim.kind == "certified"
    assert errors(rom, K, M, D, B, np.geomspace(10, 150, 61)).max() <= rom.certified_error
    # in the other sense it is another body
    assert errors(rom, K.T, M, D, B, [40.0, 90.0]).max() > 1e-2


def test_it_is_told_where_a_body_is_excited(tmp_path: Path) -> None:
    """More circulation than damping: a motion grows, and the time domain shows it."""
    K, M, D, B = chain(20, 1e4, damping=1e-6, across=1.01)
    body = flexgram.Matrices(K, M, B, D=D)
    with pytest.warns(flexgram.ReductionWarning, match="the reduced body is unstable"):
        rom = flexgram.reduce(body, (10, 330), 1e-6)
    K, M, D = (a.toarray() for a in (K, M, D))
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    full = sl.eigvals(A)
    growing = full[(full.real > 0.01) & (full.imag > 0) & (full.imag < HZ * 150)]
    assert len(growing) > 2
    poles = rom.poles()
    for pole in growing:
        assert abs(poles - pole).min() < 1e-3 * abs(pole)
    t = np.linspace(0, 0.2, 2001)
    load = np.where(t < 0.02, np.sin(np.pi * t / 0.02) ** 2, 0.0)
    forces = np.column_stack([load, 0 * load])
    y, _ = rom.simulate(forces, t)
    into = np.vstack([np.zeros((n, 2)), np.linalg.solve(M, B)])
    out = np.hstack([B.T, np.zeros((2, n))])
    _, expected, _ = scipy.signal.lsim((A, into, out, np.zeros((2, 2))), forces, t)
    assert np.abs(y - expected).max() < 2e-3 * np.abs(expected).max()
    assert abs(expected[-200:]).max() > abs(expected[:400]).max()  # it grows


def punched(path: Path, **matrices: Any) -> None:
    """A punch file by pyNastran, of grids with three components each, or an OP4."""
    if path.suffix == ".op4":
        op4 = pytest.importorskip("pyNastran.op4.op4").OP4()
        op4.write_op4(
            str(path), {n: (1, a.toarray()) for n, a in matrices.items()}, is_binary=False
        )
        return
    model = pytest.importorskip("pyNastran.bdf.bdf").BDF(debug=None)
    for name, matrix in matrices.items():
        a = sp.coo_matrix(matrix)
        rows, columns = (
            [(1 + k // 3, 1 + k % 3) for k in ends.tolist()] for ends in (a.row, a.col)
        )
        model.add_dmig(name, 1, 2, 0, 0, a.shape[0], columns, rows, a.data.tolist())
    model.write_bdf(str(path), write_header=False, enddata=False)


@pytest.mark.parametrize("kind", ["mat", "petsc", "mtx", "pch", "op4"])
def test_imported_matrices(kind: str, tmp_path: Path) -> None:
    """K, and D that is proportional to it, keep their skew parts, and the sense of them."""
    K, M, D, B = chain(12, 3e4)
    out = tmp_path / "body.h5"
    rows = ("--rows", "a=1", "--rows", "b=19", "-o", out)
    if kind == "mtx":
        for name, matrix in (("K", K), ("M", M), ("D", D)):
            scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix.tocoo(), symmetry="general")
        files = [tmp_path / f"{name}.mtx" for name in "KMD"]
        run("import", files[0], "--mass", files[1], "--damping", files[2], *rows)
    elif kind in ("pch", "op4"):
        end = "X" if kind == "pch" else ""
        parts = {f"KAA{end}": K, f"MAA{end}": M, f"BAA{end}": D}
        punched(tmp_path / f"body.{kind}", **parts)
        run("import", tmp_path / f"body.{kind}", *rows)
    elif kind == "mat":
        content = {"K": K.tocsc(), "M": M.tocsc(), "D": D.tocsc(), "B": B}
        scipy.io.savemat(tmp_path / "body.mat", content)
        import_matrices(read(tmp_path / "body.mat"), out)
    else:
        from petsc4py import PETSc

        for name, a in (("K", K), ("M", M), ("D", D), ("B", sp.csr_matrix(B))):
            mat = PETSc.Mat().createAIJ(a.shape, csr=(a.indptr, a.indices, a.data))
            mat.view(PETSc.Viewer().createBinary(str(tmp_path / name), "w"))
        fe = read_petsc(*(tmp_path / name for name in "KMBD"))
        import_matrices(fe, out)
    rom = flexgram.reduce(out, (10, 150), 1e-5)
    assert errors(rom, K, M, D, B, [20.0, 60.0, 140.0]).max() <= 1e-5


def test_where_it_is_not_taken(tmp_path: Path) -> None:
    K, M, D, B = chain(10, 3e4)
    upper = sp.triu(K).tocsr()
    write_matrices(tmp_path / "half.h5", upper, M, B, D=D)
    said = run("reduce", "-body", tmp_path / "half.h5", expect=1)
    assert "only one triangle" in said.err
    rom = flexgram.reduce(flexgram.Matrices(K, M, B, D=D), (10, 150), 1e-3)
    for format in sorted({*FORMATS} - {*WITH_CIRCULATION}):
        with pytest.raises(BodyError, match="no place for circulatory forces"):
            export(rom, tmp_path / format, format)
    with pytest.raises(BodyError, match="no damper replaces"):
        with_viscous_damping(rom)
    twice = {"skew_K": (sp.identity(20).tocsr(), flexgram.prony([0.1], [1.0]))}
    with pytest.raises(BodyError, match="two terms are named skew_K"):
        flexgram.reduce(flexgram.Matrices(K, M, B, terms=twice), (10, 150), 1e-3)


def shaft(folder: Path) -> Path:
    """Code_Aster's V2.02.125, modelling C: a hollow shaft with a disc at each end on two bearings,
    spinning about y. The symmetric parts of its bearings are springs and dashpots."""
    y = [0, 0.0175, 0.035, 0.045, 0.07, 0.1025, 0.135, 0.1675, 0.2, 0.225, 0.25, 0.275, 0.3]
    points = np.column_stack([np.zeros(13), y, np.zeros(13)])
    parts = {"journal": [0, 1], "wide": [2, 10, 11], "long": [3, 4, 5, 6, 7, 8, 9]}
    cells = np.column_stack([np.arange(12), np.arange(1, 13)])
    mesh = meshio.Mesh(
        points, [("line", cells)], cell_sets={k: [np.array(v)] for k, v in parts.items()}
    )
    mesh.point_sets = {name: np.array([at]) for name, at in (("b1", 4), ("b2", 8))}
    steel = {"E": 2e11, "nu": 0.3, "rho": 7800.0}
    content = {
        "materials": {"steel": steel},
        "sections": {
            "journal": {"shape": "circle", "radius": 0.02, "y_axis": [1, 0, 0]},
            "wide": {"shape": "tube", "radius": 0.035, "thickness": 0.03, "y_axis": [1, 0, 0]},
            "long": {"shape": "tube", "radius": 0.02, "thickness": 0.015, "y_axis": [1, 0, 0]},
        },
        "regions": {name: {"material": "steel", "section": name} for name in parts},
        "interfaces": {
            "b1": {"coupling": "node", "nodes": "b1"},
            "b2": {"coupling": "node", "nodes": "b2"},
        },
        "supports": {"axial": {"nodes": [1], "components": ["y"]}},
        "masses": {
            "d1": {"nodes": [1], "mass": 3.5, "inertia": [3.5e-3, 7e-3, 3.5e-3]},
            "d2": {"nodes": [13], "mass": 3.0, "inertia": [3e-3, 6e-3, 3e-3]},
        },
        "springs": {
            "p1": {
                "at": "b1",
                "stiffness": [[8e7, 0, -3.5e7], [0, 0, 0], [-3.5e7, 0, 1e8]],
                "damping": [[8e3, 0, -3e3], [0, 0, 0], [-3e3, 0, 1.2e4]],
            },
            "p2": {
                "at": "b2",
                "stiffness": [[5e7, 0, -2.1e7], [0, 0, 0], [-2.1e7, 0, 7e7]],
                "damping": [[6e3, 0, -1.5e3], [0, 0, 0], [-1.5e3, 0, 8e3]],
            },
        },
        "spin": {"axis": [0, 1, 0], "rpm": [0, 60000], "frame": "rest"},
    }
    import_description(content, "rotor", folder / "rotor.h5", mesh=mesh)
    return folder / "rotor.h5"


#: At 0 and 60,000 rpm frequency [Hz] and damping by ROTORINSA, and how near they are to be: the
#: frequency as Code_Aster's, which has other shear factors
PUBLISHED = {
    0: [
        (216.212, 1e-3, 4.76544e-2, 3e-3),
        (263.539, 1e-3, 7.87281e-2, 6e-3),
        (383.210, 1e-3, 5.01438e-2, 15e-3),
        (439.642, 1e-3, 6.02275e-2, 12e-3),
    ],
    60000: [
        (185.365, 1e-3, -5.17463e-2, 3e-3),
        (296.078, 1e-3, 1.55245e-1, 5e-3),
        (324.718, 1e-3, 1.57489e-3, 80e-3),
        (472.541, 1.2e-3, 1.59683e-1, 3e-3),
    ],
}


@pytest.mark.filterwarnings("ignore::flexgram.ReductionWarning")  # it is unstable
def test_a_rotor_of_code_aster(tmp_path: Path) -> None:
    body = shaft(tmp_path)
    run("assemble", "-body", body, "-body_out", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5") as file:
        K, M, D = (read_sparse(file, name) for name in ("K", "M", "D"))
        G = read_sparse(file, "terms/coriolis")
        node, component = file["dofs/node"][:], file["dofs/component"][:]
    # The skew parts of the bearings: forces along x of motion along z, and back.
    n = K.shape[0]
    N = sp.lil_matrix((n, n))
    for at, skew in ((4, 2.5e7), (8, 1.9e7)):
        x, z = (int(np.flatnonzero((node == at) & (component == c))[0]) for c in (0, 2))
        N[x, z], N[z, x] = skew, -skew
    B = np.zeros((n, 2))
    B[x, 0] = B[z, 1] = 1
    matrices = flexgram.Matrices(
        sp.csr_matrix(K + N), M, B, D=D, terms={"spin": (G, flexgram.coriolis(0, 2000 * np.pi))}
    )
    rom = flexgram.reduce(matrices, (50, 700), 1e-6)
    assert rom.certified_error <= 1e-6
    diagram = campbell(rom.system, [0.0, 2000 * np.pi])
    for i, published in enumerate(PUBLISHED.values()):
        frequencies, dampings = diagram.omega[i] / HZ, diagram.damping[i]
        for frequency, near, damping, close in published:
            k = int(np.nanargmin(abs(frequencies - frequency)))
            assert frequencies[k] == pytest.approx(frequency, rel=near)
            assert dampings[k] == pytest.approx(damping, rel=close)
