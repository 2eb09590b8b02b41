"""Matrices by their names in the files of Nastran and MATLAB: found, asked for, or asked about."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from test_importers import assert_same

from bodies import small
from flexgram.__main__ import main
from flexgram.basics import BodyError
from flexgram.importers import read

OP4 = pytest.importorskip("pyNastran.op4.op4").OP4


def record(content: bytes) -> bytes:
    """A Fortran record."""
    return struct.pack("<i", len(content)) + content + struct.pack("<i", len(content))


def write_op4(path: Path, matrices: dict[str, Any], binary: bool = False) -> Path:
    if binary:  # as Nastran does (pyNastran's own writer fails)
        with path.open("wb") as file:
            for name, a in matrices.items():
                head = struct.pack("<4i", a.shape[1], a.shape[0], 6, 2)
                file.write(record(head + name.ljust(8).encode()))
                for j, column in enumerate(a.T, 1):
                    head = struct.pack("<3i", j, 1, 2 * len(column))
                    file.write(record(head + column.astype("<f8").tobytes()))
                end = struct.pack("<3i", a.shape[1] + 1, 1, 2) + struct.pack("<d", 1.0)
                file.write(record(end))
        return path
    OP4().write_op4(
        str(path),
        {name: (6 if a.shape[0] == a.shape[1] else 2, a) for name, a in matrices.items()},
        is_binary=binary,
    )
    return path


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("names", [("KAA", "MAA"), ("KGG", "MGG"), ("KXX", "MXX"), ("KHH", "MHH")])
def test_usual_names(tmp_path: Path, names: tuple[str, str], binary: bool) -> None:
    K, M = (a.toarray() for a in small())
    file = write_op4(tmp_path / "part.op4", dict(zip(names, (K, M), strict=True)), binary)
    assert_same(read(file), *small())


def test_the_analysis_set_comes_before_the_grid_set(tmp_path: Path) -> None:
    K, M = (a.toarray() for a in small())
    more = np.eye(12)
    file = write_op4(tmp_path / "part.op4", {"KGG": more, "MGG": more, "KAA": K, "MAA": M})
    fe = read(file)
    assert_same(fe, *small())
    assert any("not needed: KGG, MGG" in line for line in fe.remarks)
    assert read(file, matrices={"K": "KGG", "M": "mgg"}).n == 12
    with pytest.raises(BodyError, match=r"different sets: KGG 12, MAA 8 rows"):
        read(file, matrices={"K": "KGG"})


def test_a_superelement_of_extseout(tmp_path: Path) -> None:
    """Its file holds more than K and M: loads, recovery matrices, structural damping."""
    K, M = (a.toarray() for a in small())
    others = {"K4XX": K, "MUG1": np.ones((20, 8)), "PA": np.ones((8, 2))}
    file = write_op4(tmp_path / "ext.op4", {"KXX": K, "MXX": M, "BXX": 1e-3 * K, **others})
    fe = read(file)
    assert_same(fe, *small())
    assert fe.D is not None and abs(fe.D - 1e-3 * small()[0]).max() < 1e-15 * abs(K).max()
    said = "; ".join(fe.remarks)
    for words in ("K4XX is left out", "MUG1", "PA", "boundary dofs and modal coordinates"):
        assert words in said


def test_names_that_tell_nothing(tmp_path: Path) -> None:
    K, M = (a.toarray() for a in small())
    file = write_op4(tmp_path / "part.op4", {"STIFF": K, "MASSES": M, "MASS2": M})
    with pytest.raises(BodyError, match=r"no matrix is K; there are .*STIFF.*--matrices"):
        read(file)
    with pytest.raises(BodyError, match=r"several matrices could be M"):
        read(file, matrices={"K": "STIFF"})
    assert_same(read(file, matrices={"K": "STIFF", "M": "MASSES"}), *small())
    with pytest.raises(BodyError, match=r"no matrix NONE; there are"):
        read(file, matrices={"K": "NONE"})
    with pytest.raises(BodyError, match=r"--matrices Q=…: Q must be one of K, M, D"):
        read(file, matrices={"Q": "STIFF"})
    wide = write_op4(tmp_path / "wide.op4", {"KAA": np.ones((3, 4)), "MAA": M})
    with pytest.raises(BodyError, match=r"KAA is 3 × 4; K is square"):
        read(wide)


def test_abaqus_names_without_an_underscore(tmp_path: Path) -> None:
    K, M = (sp.triu(a).tocoo() for a in small())
    for name, a in (("discSTIF1", K), ("discMASS1", M)):
        (tmp_path / f"{name}.mtx").write_text(
            "".join(
                f"{i // 3 + 1},{i % 3 + 1},{j // 3 + 1},{j % 3 + 1},{x:.16e}\n"
                for i, j, x in zip(a.row, a.col, a.data, strict=True)
            )
        )
    for name in ("discSTIF1", "discMASS1"):
        assert_same(read(tmp_path / f"{name}.mtx"), *small())


def test_text_files(tmp_path: Path) -> None:
    for first in (0, 1):
        for name, a in zip("KM", small(), strict=True):
            entries = a.tocoo()
            table = np.column_stack([entries.row + first, entries.col + first, entries.data])
            np.savetxt(tmp_path / f"{name}.txt", table, header="row column value", fmt="%.17g")
        assert_same(read(tmp_path / "K.txt", mass=tmp_path / "M.txt"), *small())
    for name, a in zip("KM", small(), strict=True):
        np.savetxt(tmp_path / f"{name}.csv", a.toarray(), delimiter=",", fmt="%.17g")
    assert_same(read(tmp_path / "K.csv", mass=tmp_path / "M.csv"), *small())
    (tmp_path / "K.txt").write_text("1 1\n2 2\n3 3\n")
    with pytest.raises(BodyError, match=r"3 × 2 numbers, expected a square"):
        read(tmp_path / "K.txt", mass=tmp_path / "M.txt")
    (tmp_path / "K.txt").write_text("1 1 2.0\n1000000 1 2.0\n")
    with pytest.raises(BodyError, match=r"cannot fill that"):
        read(tmp_path / "K.txt", mass=tmp_path / "M.txt")
    (tmp_path / "K.txt").write_text("stiffness\n")
    with pytest.raises(BodyError, match=r"no table of numbers"):
        read(tmp_path / "K.txt", mass=tmp_path / "M.txt")


def test_a_mapping_of_ansys(tmp_path: Path) -> None:
    """HBMAT's map of equations; a vector of *EXPORT says nothing of nodes."""
    for name, matrix in zip("KM", small(), strict=True):
        scipy.io.hb_write(tmp_path / f"{name}.hb", matrix.tocsc())
    map_file = tmp_path / "K.mapping"
    lines = [f"{i + 1:8d} {11 + i // 3:8d}  {('UX', 'UY', 'UZ')[i % 3]}" for i in range(8)]
    map_file.write_text("\n".join(["Matrix Eqn    Node    DOF", *lines]))
    fe = read(tmp_path / "K.hb", mass=tmp_path / "M.hb", mapping=map_file)
    assert fe.node.tolist() == [11, 11, 11, 12, 12, 12, 13, 13]
    assert fe.component.tolist() == [0, 1, 2, 0, 1, 2, 0, 1]
    map_file.write_text("1 11 UX\n")
    with pytest.raises(BodyError, match="maps 1 equations, the matrices have 8"):
        read(tmp_path / "K.hb", mass=tmp_path / "M.hb", mapping=map_file)
    scipy.io.mmwrite(tmp_path / "nod2bcs.mtx", np.arange(8.0)[:, None])
    with pytest.raises(BodyError, match="HBMAT with MAPPING=YES"):
        read(tmp_path / "K.hb", mass=tmp_path / "M.hb", mapping=tmp_path / "nod2bcs.mtx")


def test_matlab_names_and_a_square_C(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    K, M = small()
    file = tmp_path / "other.mat"
    scipy.io.savemat(file, {"Kmat": K, "Mmat": M, "Bu": np.eye(8)[:, :2]})
    with pytest.raises(BodyError, match=r"K is missing; there are .*Kmat.*--matrices K=Kmat"):
        read(file)
    fe = read(file, matrices={"K": "Kmat", "M": "Mmat", "B": "Bu"})
    assert_same(fe, K, M)
    assert fe.B.shape == (8, 2)
    scipy.io.savemat(file, {"K": K, "M": M, "C": 1e-3 * K, "B": np.eye(8)[:, :2]})
    with pytest.raises(BodyError, match=r"C is as large as K: damping \(--matrices D=C\)"):
        read(file)
    damped = read(file, matrices={"D": "C"})
    assert damped.C is None and abs(damped.D - 1e-3 * K).max() < 1e-15 * abs(K).max()
    assert read(file, matrices={"C": "C"}).C.shape == (8, 8)
    assert main(["import", str(file), "--matrices", "D=C", "-o", str(tmp_path / "b.h5")]) == 0
    assert main(["import", str(file), "--matrices", "D:C", "-o", str(tmp_path / "b.h5")]) == 1
    assert "expected K=NAME,M=NAME" in capsys.readouterr().err
