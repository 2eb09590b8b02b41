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

from bodies import CALCULIX, box, write_body_file
from conftest import SHARED, assembled, read_sparse, run
from flexgram.geometry import Geometry
from flexgram.importers import FeMatrices, check, import_matrices, parse, read
from flexgram.importers.deck import read_deck
from flexgram.importers.interfaces import Interface, attach
from flexgram.meshfile import BodyError

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


def write_deck(path: Path, kind: str = "C3D10", extra: str = "", scale: float = 1.0) -> Path:
    """A distorted box as a CalculiX deck with the node sets START and END."""
    mesh = box(CALCULIX[kind], (4, 2, 2))
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i + 10}, " + ", ".join(f"{x * scale:.12g}" for x in point)
              for i, point in enumerate(mesh.points)]  # fmt: skip
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=EALL")
    for e, nodes in enumerate(mesh.cells[0].data, 1):
        words = [str(e), *(str(n + 10) for n in nodes)]
        lines += [", ".join(words[i : i + 12]) + ("," if i + 12 < len(words) else "")
                  for i in range(0, len(words), 12)]  # fmt: skip
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
        run("sweep", "-body", tmp_path / f"{name}.h5", "-mor_sweep_hz", "50,4000,7",
            "-mor_sweep_out", out)  # fmt: skip
        with h5py.File(out) as file:
            assert [n.split(".")[1] for n in file["H"].attrs["inputs"]] == [
                "fx", "fy", "fz", "mx", "my", "mz"]  # fmt: skip
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
    status = main(["import", str(deck), "--run-ccx", "--units", "mm-t-s", "--rigid",
                   "left=NSET:START", "--distributing", "right=NSET:END", "--alpha", "10",
                   "-o", str(body)])  # fmt: skip
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
        "left": len(in_metres.sets["START"]), "right": len(in_metres.sets["END"])
    }  # fmt: skip
    result = run("reduce", "-body", body, "-mor_band_hz", "100,6000", "-mor_tol", "1e-4",
                 "-mor_out", rom, ranks=ranks)  # fmt: skip
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


def small() -> tuple[Any, Any]:
    """A chain with a grounded end: eight rows, three to a node but one node with two."""
    n = 8
    K = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]) * 1e6
    M = sp.diags([0.5 * np.ones(n - 1), 2 * np.ones(n), 0.5 * np.ones(n - 1)], [-1, 0, 1])
    return K.tocsr(), M.tocsr()


def assert_same(fe: Any, K: Any, M: Any) -> None:
    assert abs(fe.K - K).max() <= 1e-12 * abs(K).max()
    assert abs(fe.M - M).max() <= 1e-12 * abs(M).max()


def test_nastran_dmig_and_op4(tmp_path: Path) -> None:
    """Punch and OP4 that pyNastran wrote."""
    pytest.importorskip("pyNastran")
    from pyNastran.bdf.bdf import BDF

    K, M = small()
    dofs = [(5, 1), (5, 2), (5, 3), (7, 1), (7, 2), (7, 3), (9, 1), (9, 3)]
    model = BDF(debug=None)
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        upper = sp.triu(matrix).tocoo()
        model.add_dmig(name, 6, 2, 0, 0, 8,
                       [dofs[j] for j in upper.col], [dofs[i] for i in upper.row],
                       upper.data.tolist())  # fmt: skip
    model.write_bdf(str(tmp_path / "part.pch"), write_header=False, enddata=False)
    deck = tmp_path / "part.bdf"
    grids = {5: (0, 0, 0), 7: (1, 0, 0), 9: (0, 1, 0), 20: (0.5, 0.5, 0)}
    deck.write_text(
        "CEND\nBEGIN BULK\n"
        + "".join(f"GRID,{g},,{x:.1f},{y:.1f},{z:.1f}\n" for g, (x, y, z) in grids.items())
        + "RBE2,31,20,123456,5,7\nENDDATA\n"
    )
    fe = read(tmp_path / "part.pch", deck=deck)
    assert_same(fe, K, M)
    assert list(zip(fe.node, fe.component + 1, strict=True)) == dofs
    assert [(i.name, i.coupling) for i in fe.interfaces] == [("RBE2-31", "rigid")]
    with pytest.raises(BodyError, match="RBE2-31 has 2 nodes on a line"):
        attach(fe, fe.interfaces)

    from pyNastran.op4.op4 import OP4

    OP4().write_op4(str(tmp_path / "part.op4"), {"KAA": (6, K.toarray()), "MAA": (6, M.toarray())},
                    is_binary=False)  # fmt: skip
    assert_same(read(tmp_path / "part.op4"), K, M)


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
        mat = PETSc.Mat().createAIJ(matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data),
                                    comm=PETSc.COMM_SELF)  # fmt: skip
        viewer = PETSc.Viewer().createBinary(str(tmp_path / f"{name}.petsc"), "w",
                                             comm=PETSc.COMM_SELF)  # fmt: skip
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
    head = ["title".ljust(72) + "KEY", "".join(f"{s:14d}" for s in sizes),
            "RSA".ljust(14) + "".join(f"{s:14d}" for s in (n, n, entries, 0)),
            "(10I8)".ljust(16) + "(10I8)".ljust(16) + "(1P,3D22.14)".ljust(20)]  # fmt: skip
    path.write_text("\n".join([*head, *start, *row, *value]) + "\n")


def test_harwell_boeing_symmetric(tmp_path: Path) -> None:
    K, M = small()
    for name, matrix in (("K", -K), ("M", M)):  # nine columns of -1.0D+06 touch
        write_rsa(tmp_path / f"{name}.rsa", matrix)
    assert_same(read(tmp_path / "K.rsa", mass=tmp_path / "M.rsa"), -K, M)
    edit(tmp_path / "K.rsa", lambda t: t[:-30])
    with pytest.raises(BodyError, match="truncated"):
        read(tmp_path / "K.rsa", mass=tmp_path / "M.rsa")


@pytest.mark.parametrize(
    ("cards", "expected"),
    [
        ("*NODE, SYSTEM=C\n1, 1, 90, 0\n", "line 1: .* writes nodes in a way"),
        ("*NODE\n1,0,0,0\n*NGEN\n1,9,2\n", "line 3: .* writes nodes in a way"),
        ("*NODE\n1,0,0,0\n1,0,0,1\n", "line 3: .* another place"),
        ("*INSTANCE, NAME=A, PART=P\n10., 0., 0.\n*NODE\n1,0,0,0\n", "line 2: .* moves the inst"),
        ("*INSTANCE, NAME=A\n*NODE\n1,0,0,0\n*INSTANCE, NAME=B\n", "line 4: .* second instance"),
        ("*NODE\n1,0,0,z\n", "line 2: .* does not belong under"),
        ("*ELEMENT, TYPE=C3D4\n1, 1,2,3,4\n", "is this a deck"),
        ("*INCLUDE, INPUT=none.inp\n", "No such file"),
    ],
)
def test_decks_that_are_not_followed(tmp_path: Path, cards: str, expected: str) -> None:
    (tmp_path / "x.inp").write_text(cards)
    with pytest.raises(BodyError, match=expected):
        read_deck(tmp_path / "x.inp")


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
        "ALL": [1, 2, 3, 4], "LEFT": [1], "RIGHT": [2, 4], "BOTH": [1, 2, 4], "E": [1, 2, 3, 4],
        "OFE": [1, 2, 3, 4],
    }  # fmt: skip
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


def test_nastran_weights_components_and_structural_damping(tmp_path: Path) -> None:
    pytest.importorskip("pyNastran")
    from pyNastran.bdf.bdf import BDF

    K = sp.eye(12).tocsr() * 1e6 + sp.diags([np.ones(11), np.ones(11)], [-1, 1])
    dofs = [(g, c) for g in (1, 2, 3, 4) for c in (1, 2, 3)]
    model = BDF(debug=None)
    flip = np.random.default_rng(1).random(23) < 0.5
    for name, matrix in (("KAAX", K), ("MAAX", sp.eye(12)), ("K4AAX", sp.eye(12))):
        upper = sp.triu(matrix).tocoo()
        pairs = [(j, i) if flip[k % 23] else (i, j)
                 for k, (i, j) in enumerate(zip(upper.row, upper.col, strict=True))]  # fmt: skip
        model.add_dmig(name, 6, 2, 0, 0, 12, [dofs[j] for _, j in pairs],
                       [dofs[i] for i, _ in pairs], upper.data.tolist())  # fmt: skip
    model.write_bdf(str(tmp_path / "p.pch"), write_header=False, enddata=False)
    grids = "".join(f"GRID,{i + 1},,{x:.1f},{y:.1f},0.0\n"
                    for i, (x, y) in enumerate([(0, 0), (1, 0), (0, 1), (1, 1)]))  # fmt: skip
    grids += "GRID,9,,0.5,0.5,0.0\n"

    def deck(rigid: str) -> Path:
        (tmp_path / "p.bdf").write_text(f"CEND\nBEGIN BULK\n{grids}{rigid}ENDDATA\n")
        return tmp_path / "p.bdf"

    weighted = deck("RBE3,7,,9,123456,10.0,123,1,1.0\n+,123,2,3,4\n")
    fe = read(tmp_path / "p.pch", deck=weighted)
    assert abs(fe.K - K).max() == 0 and "K4AAX" in fe.remarks[0]  # either triangle
    B = attach(fe, fe.interfaces)["B"]
    # The centroid of a load of weights 10:1:1:1 is not the middle: a force there has a moment too.
    weights, x = np.array([10, 1, 1, 1]), np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) - 0.5
    G = np.zeros((12, 6))
    for i in range(4):
        G[3 * i : 3 * i + 3, :3] = np.eye(3)
        for axis in range(3):
            G[3 * i : 3 * i + 3, 3 + axis] = np.cross(np.eye(3)[axis], [*x[i], 0])
    W = np.diag(np.repeat(weights, 3))
    assert np.allclose(B, W @ G @ np.linalg.inv(G.T @ W @ G))
    with pytest.raises(BodyError, match="RBE2 8 couples the components 12;"):
        read(tmp_path / "p.pch", deck=deck("RBE2,8,9,12,1,2\n"))


def test_wrong_containers(tmp_path: Path) -> None:
    """Complex PETSc files, dof maps of MATLAB that do not fit, options of other formats."""
    head = np.array([1211216, 2, 2, 2, 1, 1, 0, 1], dtype=">i4").tobytes()
    for name in ("K", "M"):
        (tmp_path / f"{name}.petsc").write_bytes(head + np.ones(2, dtype=">c16").tobytes())
    with pytest.raises(BodyError, match="complex scalars"):
        read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    (tmp_path / "K.petsc").write_bytes(head + np.ones(1, dtype=">f8").tobytes())
    with pytest.raises(BodyError, match="truncated: 1 of 2"):
        read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    K, M = small()
    body = {"K": K, "M": M, "B": np.eye(8)[:, :1], "node": np.repeat([1, 2, 3], 3)[:8],
            "component": np.tile([1, 2, 3], 3)[:8], "position": np.eye(3)}  # fmt: skip
    for change, expected in (
        ({}, "component must be 0, 1, 2"),
        ({"component": np.tile([0, 1, 2], 3)[:8], "position": np.eye(3)[:, :2]}, "nodes × 3"),
        ({"component": np.arange(3), "position": np.eye(3)}, "an entry for each"),
    ):
        scipy.io.savemat(tmp_path / "x.mat", body | change)
        with pytest.raises(BodyError, match=expected):
            read(tmp_path / "x.mat")
    body["component"] = np.tile([0, 1, 2], 3)[:8]
    scipy.io.savemat(tmp_path / "x.mat", body)
    assert read(tmp_path / "x.mat").has_coordinates()
    scipy.io.savemat(tmp_path / "x.mat", body | {"B": np.ones((7, 1))})
    with pytest.raises(BodyError, match="B is 7 × 1, expected 8 rows"):
        import_matrices(read(tmp_path / "x.mat"), tmp_path / "x.h5")
    with pytest.raises(BodyError, match="--mass does not belong to the format matlab"):
        read(tmp_path / "x.mat", mass=tmp_path / "x.mat")


def test_a_dof_map_of_another_body(tmp_path: Path) -> None:
    """Permuted nodes: translations stay free, rotations do not."""
    mesh = box("tetra", (3, 2, 2))
    write_body_file(tmp_path / "mesh.h5", mesh,
                    interfaces={"start": {"set": "start", "coupling": "distributing"}})  # fmt: skip
    full = assembled(tmp_path / "full.h5", tmp_path / "mesh.h5")
    fe = FeMatrices("x", full["K"].tocsr(), full["M"].tocsr(), node=full["node"],
                    component=full["component"], labels=np.arange(len(mesh.points)),
                    points=mesh.points)  # fmt: skip
    assert check(fe)["free"] == 6
    fe.points = mesh.points[::-1]
    with pytest.raises(BodyError, match="do not belong to these matrices"):
        check(fe)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Hand-made results of ccx: a tetrahedron's worth of rows."""
    K = np.diag([3e6, 3e6, 3e6, 2e6, 2e6, 2e6]) - 1e5
    M = np.diag(np.full(6, 2.0))
    for suffix, matrix in (("sti", K), ("mas", M)):
        with (tmp_path / f"job.{suffix}").open("w") as file:
            for j in range(6):
                for i in range(j + 1):
                    file.write(f"{i + 1} {j + 1} {matrix[i, j]:20.13e}\n")
    (tmp_path / "job.dof").write_text("".join(f"{n}.{d}\n" for n in (10, 11) for d in (1, 2, 3)))
    (tmp_path / "job.inp").write_text("*NODE\n10,0,0,0\n11,1,0,0\n12,2,0,0\n")
    return tmp_path


def edit(path: Path, change: Any) -> None:
    path.write_text(change(path.read_text()))


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ("nothing", None),
        ("lower triangle", None),
        ("truncated line", r"job.sti, line 21: .*truncated"),
        ("truncated file", r"job.mas: row 6 of 6 has no entry: the file is truncated"),
        ("swapped", "are K and M swapped"),
        ("no dof map", r"job.dof \(the dof map\) is missing"),
        ("short dof map", "row numbers from 1 to 6, expected 1 to 5"),
        ("bad dof map", r"job.dof, line 3: 'x', expected node.direction"),
        ("binary", r"job.sti: binary, expected text"),
        ("unequal triangles", r"job.sti: not symmetric: entry \(1, 2\)"),
        ("nan", r"holds NaN or Inf"),
    ],
)
def test_wrong_calculix_files(job: Path, what: str, expected: str | None) -> None:
    sti, mas, dof = (job / f"job.{suffix}" for suffix in ("sti", "mas", "dof"))
    if what == "lower triangle":
        edit(sti, lambda t: "".join(
            "{1} {0} {2}\n".format(*line.split()) for line in t.splitlines()))  # fmt: skip
    elif what == "truncated line":
        edit(sti, lambda t: t[:-9])
    elif what == "truncated file":
        edit(mas, lambda t: "\n".join(t.splitlines()[:15]) + "\n")
    elif what == "swapped":
        sti.rename(job / "x")
        mas.rename(sti)
        (job / "x").rename(mas)
    elif what == "no dof map":
        dof.unlink()
    elif what == "short dof map":
        edit(dof, lambda t: "\n".join(t.splitlines()[:5]))
    elif what == "bad dof map":
        edit(dof, lambda t: t.replace("10.3", "x"))
    elif what == "binary":
        sti.write_bytes(b"\0\1\2\3" * 100)
    elif what == "unequal triangles":
        edit(sti, lambda t: t + "2 1 5.0\n")
    elif what == "nan":
        edit(sti, lambda t: t.replace("3.0000000000000e+06", "nan", 1)
             if "3.0000000000000e+06" in t else t.replace(t.split()[2], "nan", 1))  # fmt: skip
    if expected is None:
        fe = read(sti)
        check(fe)
        assert fe.K[0, 5] == fe.K[5, 0] == -1e5
        return
    with pytest.raises(BodyError, match=expected):
        check(read(sti))


@pytest.mark.parametrize(
    ("option", "where", "expected"),
    [
        ("rigid", "a=NSET:TOP", "there is no node set TOP; there are none"),
        ("rigid", "a=NODES:10,12", "node 12 has no free x translation: it is constrained"),
        ("node", "a=NODES:12", "node 12 has no row"),
        ("distributing", "a=NODES:10,11", "2 nodes on a line and cannot carry moments"),
        ("distributing", "a=NODES:10", "is one node and cannot carry moments"),
        ("rigid", "a=NODES:10", "is one node and cannot carry moments"),
        ("rigid", "a=BOX:5,5,5,6,6,6", "no node in the box; the body spans"),
        ("rows", "a=7", "the matrices have rows 1 to 6"),
        ("rigid", "a", "expected name=NSET:SET"),
        ("rigid", "a=PLANE:1", "PLANE must be NSET, NODES, BOX or AT"),
        ("rigid", "a=NODES:-3", "internal node"),
    ],
)
def test_wrong_interfaces(job: Path, option: str, where: str, expected: str) -> None:
    fe = read(job / "job.sti")
    with pytest.raises(BodyError, match=expected):
        attach(fe, [parse(option, where)])


def test_no_interface_and_overlap(job: Path) -> None:
    fe = read(job / "job.sti")
    with pytest.raises(BodyError, match="no interface is named"):
        attach(fe, [])
    pair = [parse("rigid", "a=NODES:10"), parse("rigid", "b=NODES:10,11")]
    with pytest.raises(BodyError, match="interfaces a and b share node 10"):
        attach(fe, pair)


def test_abaqus_matrix_input_and_negative_labels(tmp_path: Path) -> None:
    """FORMAT=MATRIX INPUT: node, dof on both sides; one triangle; an internal node."""
    K, M = small()
    dofs = [(-1, 1), *((n, d) for n in (4, 6) for d in (1, 2, 3)), (8, 2)]
    for name, matrix in (("STIF", K), ("MASS", M)):
        lower = sp.tril(matrix).tocoo()
        lines = [f"{dofs[i][0]},{dofs[i][1]}, {dofs[j][0]},{dofs[j][1]}, {v:.15e}\n"
                 for i, j, v in zip(lower.row, lower.col, lower.data, strict=True)]  # fmt: skip
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
