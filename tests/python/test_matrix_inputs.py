"""Matrices without nodes: loads in files of their own, and what is doubted and told of them."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from conftest import chain, message, run
from flexgram import BodyError, Matrices, reduce, write_matrices
from flexgram.basics import counted
from flexgram.body import bodyfile

N = 30


def petsc_bytes(matrix: Any, whole: str = ">i4") -> bytes:
    """A Mat as PETSc's MatView writes it, of a build with indices of 32 or 64 bits."""
    A = sp.csr_matrix(matrix)
    head = np.array([1211216, *A.shape, A.nnz], whole)
    counts = np.diff(A.indptr).astype(whole)
    return b"".join(
        x.tobytes() for x in (head, counts, A.indices.astype(whole), A.data.astype(">f8"))
    )


def dense_bytes(matrix: Any) -> bytes:
    head = np.array([1211216, *matrix.shape, -1], ">i4")
    return head.tobytes() + np.asarray(matrix).astype(">f8").tobytes()


def vector_bytes(values: Any) -> bytes:
    return np.array([1211214, len(values)], ">i4").tobytes() + values.astype(">f8").tobytes()


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """K and M of a chain, by PETSc and as MatrixMarket."""
    body = chain(N)
    for name in "KM":
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", body[name])
        (tmp_path / f"{name}.petsc").write_bytes(petsc_bytes(body[name]))
    return tmp_path


def imported(folder: Path, kind: str, inputs: Path, expect: int = 0) -> Any:
    words = (folder / f"K.{kind}", "--mass", folder / f"M.{kind}", "--inputs", inputs)
    return run("import", *words, "-o", folder / "b.h5", expect=expect)


@pytest.mark.parametrize("kind", ["mtx", "petsc"])
@pytest.mark.parametrize("columns", [1, 3])
def test_files_of_loads(files: Path, kind: str, columns: int) -> None:
    B = np.random.default_rng(columns).standard_normal((N, columns))
    ways = {
        "mtx": lambda p: scipy.io.mmwrite(p.with_suffix(".mtx"), B),
        "txt": lambda p: np.savetxt(p, B),
        "csv": lambda p: np.savetxt(p, B, delimiter=","),
        "petsc": lambda p: p.write_bytes(petsc_bytes(B)),
        "dense": lambda p: p.write_bytes(dense_bytes(B)),
    }
    if columns == 1:
        ways["vec"] = lambda p: p.write_bytes(vector_bytes(B[:, 0]))
    of_kind = ("mtx", "txt", "csv") if kind == "mtx" else ("petsc", "dense", "vec")
    for way in of_kind:
        if way not in ways:
            continue
        path = files / f"B.{way}"
        ways[way](path)
        imported(files, kind, path)
        with h5py.File(files / "b.h5") as file:
            np.testing.assert_allclose(file["B"][:].reshape(B.shape), B, rtol=1e-12)


def test_indices_of_64_bits(files: Path) -> None:
    """As PETSc --with-64-bit-indices writes them: the same body."""
    B = np.eye(N)[:, :2]
    (files / "B.petsc").write_bytes(petsc_bytes(B))
    imported(files, "petsc", files / "B.petsc")
    with h5py.File(files / "b.h5") as file:
        known = file["K/data"][:]
    for name, matrix in (*((n, chain(N)[n]) for n in "KM"), ("B", B)):
        (files / f"{name}.petsc").write_bytes(petsc_bytes(matrix, ">i8"))
    imported(files, "petsc", files / "B.petsc")
    with h5py.File(files / "b.h5") as file:
        np.testing.assert_allclose(file["B"][:].reshape(B.shape), B)
        np.testing.assert_array_equal(file["K/data"][:], known)


@pytest.mark.parametrize(
    ("B", "words"),
    [
        (np.eye(N - 1)[:, :2], f"B is {N - 1} × 2, expected {N} rows"),
        (np.eye(N)[:2], f"B is 2 × {N}, expected {N} rows, a column for each input: write its tr"),
        (np.eye(N)[:, :2] * [1, 0], "column 2 of B is zero"),
    ],
)
@pytest.mark.parametrize("kind", ["mtx", "petsc"])
def test_loads_that_do_not_fit(files: Path, B: Any, words: str, kind: str) -> None:
    """The message names the file of B, not that of K."""
    path = files / f"B.{kind}"
    if kind == "petsc":
        path.write_bytes(petsc_bytes(B))
    else:
        scipy.io.mmwrite(path, B)
    said = message(imported(files, kind, path, expect=1))
    assert words in said and f"B.{kind}: " in said


def test_what_belongs_to_other_files_and_no_loads_at_all(files: Path) -> None:
    words = (files / "K.petsc", "--mass", files / "M.petsc", "--mapping", files / "K.mtx")
    said = message(run("import", *words, "-o", files / "b.h5", expect=1))
    assert "that takes --mass, --damping, --inputs, not --mapping" in said
    for kind in ("mtx", "petsc"):
        words = (files / f"K.{kind}", "--mass", files / f"M.{kind}")
        said = message(run("import", *words, "-o", files / "b.h5", expect=1))
        assert "--rows tip=fx:715,fy:716" in said and "--inputs FILE" in said
    (files / "K.petsc").write_bytes(vector_bytes(np.ones(N)))
    (files / "B.petsc").write_bytes(petsc_bytes(np.eye(N)[:, :1]))
    assert "a Vec of PETSc" in message(imported(files, "petsc", files / "B.petsc", expect=1))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence, whatever HDF5 does after a write that failed, and nothing is left."""
    body = chain(2000)

    @contextmanager
    def full(path: Any) -> Any:
        yield "/dev/full"

    monkeypatch.setattr(bodyfile, "written_aside", full)
    with pytest.raises(BodyError, match=r"cannot write .*b\.h5: no space left on the device"):
        write_matrices(tmp_path / "b.h5", body["K"], body["M"], body["B"])
    assert not list(tmp_path.iterdir())


def held_chain(n: int = 60) -> tuple[sp.lil_matrix, sp.csr_matrix, np.ndarray]:
    K = 1e6 * sp.diags([-1.0, 2, -1], [-1, 0, 1], shape=(n, n)).tolil()
    return K, sp.eye(n, format="csr"), np.eye(n)[:, [0, n - 1]]


@pytest.mark.parametrize("pairs", [1, 3, 4])
def test_few_unsymmetric_entries_are_doubted(pairs: int) -> None:
    """A slip, more often than friction."""
    K, M, B = held_chain()
    for k in range(pairs):
        K[10 * k, 10 * k + 1] *= 1 + 1e-6 * (k + 1)
    body = Matrices(K.tocsr(), M, B, beta=1e-4)
    said = reduce(body, (1, 50), 1e-2).provenance.warnings
    words = f"K is symmetric but for {counted(pairs, 'pair')} of entries"
    assert any(words in one for one in said) == (pairs < 4)


def test_rigid_motions_of_matrices_are_told(tmp_path: Path) -> None:
    """The import of matrices cannot tell, as that of a mesh does."""
    K, M, B = held_chain()
    for name, end in (("held", 2e6), ("free", 1e6)):
        K[0, 0] = K[-1, -1] = end
        write_matrices(tmp_path / f"{name}.h5", K.tocsc(), M.tocsc(), B, beta=1e-4)
        words = ("--band", "1,50", "--tol", "1e-2", "-o", tmp_path / "b.rom.h5")
        said = run("reduce", tmp_path / f"{name}.h5", *words).out
        assert ("1 of them is a rigid motion: nothing holds the body" in said) == (name == "free")
