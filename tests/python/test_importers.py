"""Importers against what the FE codes themselves say, and wrong files against their messages."""

from __future__ import annotations

import lzma
import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse as sp

from bodies import CALCULIX, box, small
from conftest import SHARED, edit, read_sparse, run
from flexgram.basics import BodyError
from flexgram.importers import check, import_matrices, parse, read
from flexgram.importers.deck import read_deck
from flexgram.importers.fe import FeMatrices, Interface, rigid_motions
from flexgram.importers.interfaces import attach
from flexgram.model.geometry import Geometry

STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n210e9, 0.3\n*DENSITY\n7850.\n"
FREQUENCY = "*STEP\n*FREQUENCY\n16\n*END STEP\n"


def frequencies(K: Any, M: Any) -> Any:
    """All finite eigenfrequencies [Hz], ascending; M may be singular."""
    k, m = K.toarray(), M.toarray()
    tau = 1e-3 * np.trace(k) / np.trace(m)
    mu = scipy.linalg.eigh(m, k + tau * m, eigvals_only=True)[::-1]
    mu = mu[mu > 1e-11 * mu[0]]
    return np.sqrt(np.maximum(1 / mu - tau, 0)) / (2 * np.pi)


def assert_digits(ours: Any, printed: Any) -> None:
    """Equal to the seven digits that the FE codes print, rigid modes aside."""
    printed = np.asarray(printed)
    elastic = printed > 1
    assert elastic.sum() >= 3
    assert np.allclose(ours[: len(printed)][elastic], printed[elastic], rtol=1.5e-6)


def unpacked(name: str, folder: Path) -> Path:
    """Files of a shared body, decompressed."""
    source = SHARED / name
    if not source.exists():
        pytest.skip(f"{source} is not there: files of other programs are not tested")
    for file in source.iterdir():
        if file.suffix == ".xz":
            (folder / file.stem).write_bytes(lzma.decompress(file.read_bytes()))
        else:
            shutil.copy(file, folder / file.name)
    return folder


def write_deck(
    path: Path, kind: str = "C3D10", extra: str = "", scale: float = 1.0, mesh: Any = None
) -> Path:
    """A distorted box, or a mesh, as a CalculiX deck with the node sets START and END."""
    mesh = mesh or box(CALCULIX[kind], (4, 2, 2))
    lines = ["*NODE, NSET=NALL"]
    lines += [
        f"{i + 10}, " + ", ".join(f"{x * scale:.12g}" for x in point)
        for i, point in enumerate(mesh.points)
    ]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=EALL")
    for e, nodes in enumerate(mesh.cells[0].data, 1):
        words = [str(e), *(str(n + 10) for n in nodes)]
        lines += [
            ", ".join(words[i : i + 12]) + ("," if i + 12 < len(words) else "")
            for i in range(0, len(words), 12)
        ]
    for name, nodes in mesh.point_sets.items():
        lines += [f"*NSET, NSET={name.upper()}", *(f"{n + 10}," for n in nodes)]
    lines.append(STEEL + "*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL")
    path.write_text("\n".join(lines) + "\n" + extra)
    return path


def ccx_frequencies(job: Path) -> Any:
    """What ccx prints for a plain frequency step."""
    subprocess.run(["ccx", job.stem], cwd=job.parent, capture_output=True, check=True)
    rows = [line.split() for line in job.with_suffix(".dat").read_text().splitlines()]
    return [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()]


ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")


@ccx
@pytest.mark.parametrize("kind", ["C3D4", "C3D10", "C3D20", "C3D20R", "C3D8I"])
def test_calculix_run_and_import(tmp_path: Path, kind: str) -> None:
    held = "*BOUNDARY\nSTART, 1, 3\n"  # a free body's rigid modes spoil ccx's own digits
    deck = write_deck(tmp_path / "held.inp", kind, held + FREQUENCY)
    fe = read(deck, run_ccx=True)
    assert_digits(frequencies(fe.K, fe.M), ccx_frequencies(deck)[:16])
    fe = read(write_deck(tmp_path / "part.inp", kind, FREQUENCY), run_ccx=True)
    if kind == "C3D8I":  # three internal nodes an element
        assert not fe.has_coordinates() and any("internal" in remark for remark in fe.remarks)
        return
    facts = check(fe)
    assert facts["free"] == 6
    assert facts["mass"] == pytest.approx(1.0, rel=1)  # about 0.47 kg
    assert set(fe.sets) >= {"START", "END"}


@ccx
def test_calculix_rigid_body_keeps_its_interface(tmp_path: Path) -> None:
    """*RIGID BODY of ccx against our own rigid coupling of the same nodes."""
    rigid = "*NODE\n9001, 0.,0.01,0.015\n9002, 0.,0.01,0.015\n"
    rigid += "*RIGID BODY, NSET=START, REF NODE=9001, ROT NODE=9002\n"
    theirs = read(write_deck(tmp_path / "theirs.inp", "C3D10", rigid + FREQUENCY), run_ccx=True)
    assert theirs.rigid == {"START": 9001}
    import_matrices(theirs, tmp_path / "theirs.h5")
    ours = read(write_deck(tmp_path / "ours.inp", "C3D10", FREQUENCY), run_ccx=True)
    start = parse("rigid", "START=NSET:START@0,0.01,0.015")
    import_matrices(ours, tmp_path / "ours.h5", [start])
    H = []
    for name in ("theirs", "ours"):
        out = tmp_path / f"{name}.sweep.h5"
        run(
            "sweep",
            "-body",
            tmp_path / f"{name}.h5",
            "-mor_sweep_hz",
            "50,4000,7",
            "-mor_sweep_out",
            out,
        )
        with h5py.File(out) as file:
            assert [n.split(".")[1] for n in file["H"].attrs["inputs"]] == [
                "fx",
                "fy",
                "fz",
                "mx",
                "my",
                "mz",
            ]
            H.append(file["H"][..., 0])
    assert np.abs(H[0] - H[1]).max() < 1e-6 * np.abs(H[0]).max()


@ccx
@pytest.mark.parametrize("ranks", [1, 2])
def test_command_line_to_reduced_body(tmp_path: Path, ranks: int) -> None:
    """A millimetre part by one command, in SI afterwards, reduced with a proof."""
    from flexgram.__main__ import main

    deck = write_deck(tmp_path / "part.inp", "C3D10", scale=1e3)
    text = deck.read_text().replace("210e9", "210e3").replace("7850.", "7.85e-9")
    deck.write_text(text)
    body, rom = tmp_path / "part.h5", tmp_path / "part.rom.h5"
    status = main(
        [
            "import",
            str(deck),
            "--run-ccx",
            "--units",
            "mm-t-s",
            "--rigid",
            "left=NSET:START",
            "--distributing",
            "right=NSET:END",
            "--alpha",
            "10",
            "-o",
            str(body),
        ]
    )
    assert status == 0
    in_metres = read(write_deck(tmp_path / "metre.inp", "C3D10"), run_ccx=True)
    couplings = [parse("rigid", "left=NSET:START"), parse("distributing", "right=NSET:END")]
    import_matrices(in_metres, tmp_path / "metre.h5", couplings, alpha=10.0)
    with h5py.File(body) as a, h5py.File(tmp_path / "metre.h5") as b:
        for name in ("K", "M"):
            first, second = read_sparse(a, name), read_sparse(b, name)
            assert abs(first - second).max() < 1e-9 * abs(second).max()
        assert np.allclose(a["B"][:], b["B"][:], rtol=1e-9, atol=1e-9)
        assert np.allclose(a["nodes/position"][:], b["nodes/position"][:])
    shown = Geometry.load(body).interfaces
    assert {name: len(nodes) for name, nodes in shown.items()} == {
        "left": len(in_metres.sets["START"]),
        "right": len(in_metres.sets["END"]),
    }
    result = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "100,6000",
        "-mor_tol",
        "1e-4",
        "-mor_out",
        rom,
        ranks=ranks,
    )
    assert "certified" in result.out and "6, from the geometry" in result.out


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("ccx_beamf4", "beamf4.sti"),
        ("crank", "crank_mat.sti"),
        ("exudyn_blockC3D4", "blockC3D4_STIF1.mtx"),
        ("exudyn_blockC3D10", "blockC3D10_STIF1.mtx"),
        ("exudyn_blockC3D20R", "blockC3D20R_STIF1.mtx"),
        ("exudyn_rotorDiscTest", "rotorDiscTest_STIF1.mtx"),
    ],
)
def test_files_of_other_programs(tmp_path: Path, load_case: Any, name: str, file: str) -> None:
    fe = read(unpacked(name, tmp_path) / file)
    reference = load_case(name)["ref"]
    ours = frequencies(fe.K, fe.M)
    printed = reference.get("ccx_beamf_dat_ref_Hz", reference.get("ccx_free_Hz"))
    if printed:
        assert_digits(ours, printed)
    for key in ("freq_Hz", "free_elastic_Hz"):
        if key in reference:
            theirs = np.array([f for f in reference[key] if f > 1])[:10]
            assert np.allclose(ours[ours > 1][: len(theirs)], theirs, rtol=1e-7)
    facts = check(fe)
    if "mass" in reference:
        assert facts["mass"] == pytest.approx(reference["mass"], rel=1e-12)
        scale = np.abs(reference["inertia_cog"]).max()
        assert np.allclose(facts["inertia"], reference["inertia_cog"], atol=1e-9 * scale)
        assert facts["free"] == 6


def test_ansys_full(tmp_path: Path, load_case: Any) -> None:
    pytest.importorskip("ansys.mapdl.reader")
    folder = unpacked("ansys_hexbeam", tmp_path)
    fe = read(folder / "file.full", deck=folder / "HexBeam.cdb")
    reference = load_case("ansys_hexbeam")["ref"]
    assert fe.n == reference["n"]
    assert np.allclose(frequencies(fe.K, fe.M)[:4], reference["published_Hz"], rtol=1e-6)
    assert "constrained" in fe.remarks[0] and fe.blocks[0][1].shape == (40, 20)
    with pytest.raises(BodyError, match="node 1 has no row: it is constrained"):
        attach(fe, [parse("node", "end=NSET:NCOMP2")])


def assert_same(fe: Any, K: Any, M: Any) -> None:
    assert abs(fe.K - K).max() <= 1e-12 * abs(K).max()
    assert abs(fe.M - M).max() <= 1e-12 * abs(M).max()


def test_matrixmarket_harwell_boeing_matlab_petsc(tmp_path: Path) -> None:
    K, M = small()
    scipy.io.mmwrite(tmp_path / "K.mtx", K, symmetry="symmetric")
    scipy.io.mmwrite(tmp_path / "M.mtx", M, symmetry="general")
    assert_same(read(tmp_path / "K.mtx", mass=tmp_path / "M.mtx"), K, M)
    for name, matrix in (("K", K), ("M", M)):
        scipy.io.hb_write(tmp_path / f"{name}.hb", matrix.tocsc())
    assert_same(read(tmp_path / "K.hb", mass=tmp_path / "M.hb"), K, M)
    B = np.eye(8)[:, :2]
    scipy.io.savemat(tmp_path / "old.mat", {"K": K, "M": M, "B": B, "alpha": 3.0})
    fe = read(tmp_path / "old.mat")
    assert_same(fe, K, M)
    assert fe.alpha == 3 and np.array_equal(fe.B, B)
    import_matrices(fe, tmp_path / "old.h5")
    again = read(tmp_path / "old.h5", format="matlab")  # a body file is MATLAB's own v7.3
    assert_same(again, K, M)
    PETSc = pytest.importorskip("petsc4py.PETSc")
    for name, matrix in (("K", K), ("M", M)):
        mat = PETSc.Mat().createAIJ(
            matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=PETSc.COMM_SELF
        )
        viewer = PETSc.Viewer().createBinary(
            str(tmp_path / f"{name}.petsc"), "w", comm=PETSc.COMM_SELF
        )
        viewer(mat)
        viewer.destroy()
    fe = read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    assert_same(fe, K, M)
    import_matrices(fe, tmp_path / "petsc.h5", [Interface("tip", "rows", "ROWS:8")])


def write_rsa(path: Path, matrix: Any) -> None:
    """Harwell-Boeing as ANSYS and the collections have it: lower triangle, touching columns, D."""
    lower = sp.tril(matrix, format="csc")
    lower.sort_indices()

    def cards(values: Any, form: str, each: int) -> list[str]:
        words = [form % v for v in values]
        return ["".join(words[i : i + each]) for i in range(0, len(words), each)]

    start = cards(lower.indptr + 1, "%8d", 10)
    row = cards(lower.indices + 1, "%8d", 10)
    value = [line.replace("E", "D") for line in cards(lower.data, "%22.14E", 3)]
    n, entries = matrix.shape[0], lower.nnz
    sizes = [len(start) + len(row) + len(value), len(start), len(row), len(value), 0]
    head = [
        "title".ljust(72) + "KEY",
        "".join(f"{s:14d}" for s in sizes),
        "RSA".ljust(14) + "".join(f"{s:14d}" for s in (n, n, entries, 0)),
        "(10I8)".ljust(16) + "(10I8)".ljust(16) + "(1P,3D22.14)".ljust(20),
    ]
    path.write_text("\n".join([*head, *start, *row, *value]) + "\n")


def test_harwell_boeing_symmetric(tmp_path: Path) -> None:
    K, M = small()
    for name, matrix in (("K", -K), ("M", M)):  # nine columns of -1.0D+06 touch
        write_rsa(tmp_path / f"{name}.rsa", matrix)
    assert_same(read(tmp_path / "K.rsa", mass=tmp_path / "M.rsa"), -K, M)
    edit(tmp_path / "K.rsa", lambda t: t[:-30])
    with pytest.raises(BodyError, match="truncated"):
        read(tmp_path / "K.rsa", mass=tmp_path / "M.rsa")


def test_deck_sets_and_lines(tmp_path: Path) -> None:
    """Names before they are defined, joined keyword lines, element sets, instances, D exponents."""
    (tmp_path / "x.inp").write_text(
        "*heading\n*Node , nset = all\n 1, 0.d0, 0, 0\r\n2,1.0D+00,,\n\n3,0,1,0\n4,0,0,1\n"
        "*NSET, NSET=BOTH\nLEFT, RIGHT\n*NSET,\nNSET=LEFT\n1\n*nset, nset=RIGHT, generate\n2,4,2\n"
        "*ELEMENT, TYPE=C3D4, ELSET=E\n7, 1, 2,\n3, 4\n*NSET, NSET=OFE, ELSET=E\n"
        "*NSET, NSET=LOST\nNO\n"
        "*STEP\n*NSET, NSET=LATE\n1\n"
    )
    deck = read_deck(tmp_path / "x.inp")
    assert {name: nodes.tolist() for name, nodes in deck.sets.items()} == {
        "ALL": [1, 2, 3, 4],
        "LEFT": [1],
        "RIGHT": [2, 4],
        "BOTH": [1, 2, 4],
        "E": [1, 2, 3, 4],
        "OFE": [1, 2, 3, 4],
    }
    assert deck.points[1].tolist() == [1, 0, 0] and "LOST names NO" in deck.remarks[0]
    assert deck.blocks[0][1].tolist() == [[1, 2, 3, 4]]


@ccx
def test_supports_of_the_step_and_unnamed_rotation_node(tmp_path: Path) -> None:
    step = "*STEP\n*FREQUENCY\n5\n*BOUNDARY\nEND, 1, 3\n*END STEP\n"
    rigid = "*NODE\n9001, 0.,0.01,0.015\n*RIGID BODY, NSET=START, REF NODE=9001\n"
    fe = read(write_deck(tmp_path / "part.inp", "C3D10", rigid + step), run_ccx=True)
    assert check(fe)["free"] == 0
    assert fe.rigid == {"START": 9001}
    facts = import_matrices(fe, tmp_path / "part.h5")
    assert facts["ports"] == [f"START.{f}" for f in ("fx", "fy", "fz", "mx", "my", "mz")]
    with h5py.File(tmp_path / "part.h5") as file:  # the coupled nodes follow, for pictures
        assert len(file["geometry/followers/START"]) == 1 + len(fe.sets["START"])


def test_abaqus_matrix_input_and_negative_labels(tmp_path: Path) -> None:
    """FORMAT=MATRIX INPUT: node, dof on both sides; one triangle; an internal node."""
    K, M = small()
    dofs = [(-1, 1), *((n, d) for n in (4, 6) for d in (1, 2, 3)), (8, 2)]
    for name, matrix in (("STIF", K), ("MASS", M)):
        lower = sp.tril(matrix).tocoo()
        lines = [
            f"{dofs[i][0]},{dofs[i][1]}, {dofs[j][0]},{dofs[j][1]}, {v:.15e}\n"
            for i, j, v in zip(lower.row, lower.col, lower.data, strict=True)
        ]
        (tmp_path / f"job_{name}2.mtx").write_text("".join(lines))
    fe = read(tmp_path / "job_MASS2.mtx")
    assert_same(fe, K, M)
    assert list(zip(fe.node, fe.component + 1, strict=True)) == dofs
    assert any("negative labels" in remark for remark in fe.remarks)
    with pytest.raises(BodyError, match="node -1 is an internal node"):
        attach(fe, [parse("rigid", "a=NODES:-1,4")])
    (tmp_path / "job_STIF3.mtx").write_text("1 1 2.0\n")
    (tmp_path / "job_MASS3.mtx").write_text("1 1 1.0\n")
    with pytest.raises(BodyError, match="name the deck"):
        read(tmp_path / "job_STIF3.mtx")


def test_distributing_along_an_edge_with_rotations() -> None:
    """Nodes on a line that turn (a shell's edge): the reference has all six rigid motions of
    theirs; of nodes that do not turn the line is refused."""
    count = 5
    node, component = np.repeat(np.arange(count), 6), np.tile(np.arange(6), count)
    points = np.outer(np.arange(count), [0.0, 0.3, 0.1])
    eye = sp.identity(6 * count, format="csr")
    fe = FeMatrices(
        "edge", eye, eye, node=node, component=component, labels=np.arange(count), points=points
    )
    edge = Interface("edge", "distributing", "NODES:0,1,2,3,4", position=np.array([1.0, 0, 0]))
    B = attach(fe, [edge])["B"]
    motions = rigid_motions(points[node] - edge.position, component)
    assert np.allclose(B.T @ motions, np.eye(6), atol=1e-12)
    fe.component, fe.node, fe.K = component[component < 3], node[component < 3], eye[:15, :15]
    fe.M = fe.K
    with pytest.raises(BodyError, match="has 5 nodes on a line"):
        attach(fe, [edge])
