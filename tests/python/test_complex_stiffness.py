"""A complex K is K + iS: from every format that may hold one, and from Python."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from scipy.sparse.linalg import splu

import flexgram
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.body.terms import split_stiffness
from flexgram.importers import read

N = 40
LOSS = np.where(np.arange(N) < 12, 0.3, 2e-3)


def chain(stiffness: np.ndarray) -> sp.csc_matrix:
    """Springs from the ground to the first mass, and on."""
    K = sp.diags(
        [stiffness + np.append(stiffness[1:], 0.0), -stiffness[1:], -stiffness[1:]], [0, 1, -1]
    )
    return K.tocsc()


SPRINGS = 1e6 * (1 + 0.3 * np.cos(np.arange(N)))
K = chain(SPRINGS * (1 + 1j * LOSS))
K.sort_indices()  # SciPy's K.real and K.imag share indices with K, and sort them alone
M = sp.diags(np.where(np.arange(N) % 9 == 4, 0.0, 1.0)).tocsc()  # singular
B = np.zeros((N, 2))
B[9, 0] = B[-1, 1] = 1.0
BAND = (2.0, 60.0)


def mat(folder: Path) -> Path:
    scipy.io.savemat(folder / "body.mat", {"K": K, "M": M, "B": B})
    return folder / "body.mat"


def mat_dense(folder: Path) -> Path:
    scipy.io.savemat(folder / "body.mat", {"K": K.toarray(), "M": M.toarray(), "B": B})
    return folder / "body.mat"


def mat_73(folder: Path) -> Path:
    """As MATLAB's -v7.3 does: complex numbers are pairs."""
    with h5py.File(folder / "body.mat", "w", userblock_size=512) as file:
        pairs = np.empty(K.nnz, dtype=[("real", float), ("imag", float)])
        pairs["real"], pairs["imag"] = K.data.real, K.data.imag
        for name, matrix, data in (("K", K, pairs), ("M", M, M.data)):
            group = file.create_group(name)
            group.attrs["MATLAB_sparse"] = np.uint64(N)
            group["data"], group["ir"], group["jc"] = data, matrix.indices, matrix.indptr
        file["B"] = B.T
    return folder / "body.mat"


def mat_73_dense(folder: Path) -> Path:
    with h5py.File(folder / "body.mat", "w", userblock_size=512) as file:
        pairs = np.empty((N, N), dtype=[("real", float), ("imag", float)])
        pairs["real"], pairs["imag"] = K.toarray().real, K.toarray().imag
        file["K"], file["M"], file["B"] = pairs, M.toarray(), B.T
    return folder / "body.mat"


def market(folder: Path) -> Path:
    scipy.io.mmwrite(folder / "K.mtx", K)
    scipy.io.mmwrite(folder / "M.mtx", M)
    return folder / "K.mtx"


def op4(folder: Path) -> Path:
    pyyeti = pytest.importorskip("pyyeti.nastran.op4")
    pyyeti.write(str(folder / "body.op4"), {"KAA": K.copy(), "MAA": M.copy()})
    return folder / "body.op4"


def dmig(folder: Path) -> Path:
    """Symmetric, by columns of the lower triangle; real and imaginary parts in 16 columns."""
    lines = []
    for name, matrix, kind in (
        ("KAAX", sp.tril(K, format="csc"), 4),
        ("MAAX", sp.tril(M, format="csc"), 2),
    ):
        lines.append(f"DMIG    {name:8}{0:8}{6:8}{kind:8}{0:8}")
        for j in np.flatnonzero(np.diff(matrix.indptr)):
            lines.append(f"DMIG*   {name:16}{j + 1:16}{1:16}{'':16}*")
            for k in range(matrix.indptr[j], matrix.indptr[j + 1]):
                value = complex(matrix.data[k])
                imaginary = f"{value.imag:16.9e}" if kind == 4 else ""
                lines.append(
                    f"*       {matrix.indices[k] + 1:16}{1:16}{value.real:16.9e}{imaginary}"
                )
    (folder / "body.pch").write_text("\n".join(lines) + "\n")
    return folder / "body.pch"


@pytest.mark.parametrize("write", [mat, mat_dense, mat_73, mat_73_dense, market, op4, dmig])
def test_formats(write: Callable[[Path], Path], tmp_path: Path) -> None:
    path = write(tmp_path)
    if write is dmig:
        pytest.importorskip("pyNastran")
    fe = read(path, mass=tmp_path / "M.mtx") if write is market else read(path)
    digits = 1e-9 if write is dmig else 1e-15
    for ours, theirs in ((fe.K, K.real), (fe.S, K.imag), (fe.M, M)):
        assert abs(ours - theirs).max() <= digits * abs(theirs).max()
    assert fe.eta == 0 and any("K is complex" in remark for remark in fe.remarks)


def test_proportional_losses_are_a_loss_factor(tmp_path: Path) -> None:
    """What a body does not need is skipped: no S where a number does."""
    scipy.io.savemat(
        tmp_path / "body.mat", {"K": K.real * (1 + 0.03j), "M": M, "B": B, "eta": 0.01}
    )
    fe = read(tmp_path / "body.mat")
    assert fe.S is None and fe.eta == pytest.approx(0.04, rel=1e-14)
    assert any("the loss factor 0.03" in remark for remark in fe.remarks)


@pytest.mark.parametrize("ranks", [1, 2])
def test_claim(ranks: int, tmp_path: Path) -> None:
    """Reduced from the imported file; the truth by solves with the complex matrix."""
    body, small = tmp_path / "body.h5", tmp_path / "rom.h5"
    run("import", mat(tmp_path), "-o", body)
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "2,60",
        "-mor_tol",
        "1e-5",
        "-mor_out",
        small,
        ranks=ranks,
    )
    check_claim(ReducedModel.load(small), K)


def check_claim(rom: ReducedModel, full: sp.csc_matrix) -> None:
    assert rom.met and rom.kind == "certified"
    omega = 2 * np.pi * np.concatenate([np.linspace(*BAND, 41), np.geomspace(*BAND, 29)])
    for w, H_r in zip(omega, rom.transfer(omega), strict=True):
        H = B.T @ splu((full - w**2 * M).tocsc()).solve(B.astype(complex))
        assert np.linalg.norm(H - H_r) <= rom.certified_error * np.linalg.norm(H)


def test_python(tmp_path: Path) -> None:
    """Matrices and write_matrices; S and eta that are given too are added."""
    rom = flexgram.reduce(flexgram.Matrices(K, M, B), BAND, 1e-5)
    check_claim(rom, K)
    more = sp.diags(np.linspace(0, 1e4, N)).tocsc()
    flexgram.write_matrices(tmp_path / "body.h5", K, M, B, S=more, eta=0.02)
    rom = flexgram.reduce(tmp_path / "body.h5", BAND, 1e-5)
    check_claim(rom, (K + 1j * more + 0.02j * K.real).tocsc())


def test_entries_in_any_order() -> None:
    """Of an unsorted K, which stays as it is."""
    order = np.concatenate([np.arange(a, b)[::-1] for a, b in itertools.pairwise(K.indptr)])
    given = sp.csc_matrix((K.data[order], K.indices[order], K.indptr), shape=K.shape)
    assert not given.has_sorted_indices
    before = given.data.copy(), given.indices.copy()
    real, S, eta = split_stiffness(given, sp.identity(N), 0.1)
    assert np.array_equal(real.toarray(), K.toarray().real)
    assert np.array_equal(S.toarray(), K.toarray().imag + np.eye(N)) and eta == 0.1
    assert np.array_equal(given.data, before[0]) and np.array_equal(given.indices, before[1])


def test_what_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=r"negative, as for motions exp\(-iωt\)"):
        flexgram.reduce(flexgram.Matrices(K.conj(), M, B), BAND, 1e-5)
    with pytest.raises(BodyError, match=r"K is negative .*; change the signs"):
        flexgram.reduce(flexgram.Matrices(-K, -M, B), BAND, 1e-5)
    skew = sp.csc_matrix(([1e3j, -1e3j], ([0, 1], [1, 0])), shape=(N, N))
    with pytest.raises(BodyError, match="its imaginary part is not symmetric"):
        flexgram.write_matrices(tmp_path / "body.h5", K + skew, M, B)
    with pytest.raises(BodyError, match="M is complex; K alone may be"):
        flexgram.reduce(flexgram.Matrices(K.real, (1 + 1j) * M, B), BAND, 1e-5)
    scipy.io.savemat(tmp_path / "body.mat", {"K": K, "M": M * 1j, "B": B})
    with pytest.raises(BodyError, match="M is complex; K alone may be"):
        read(tmp_path / "body.mat")
    scipy.io.savemat(tmp_path / "body.mat", {"K": K.real, "M": M, "B": B * 1j})
    said = run("import", tmp_path / "body.mat", "-o", tmp_path / "body.h5", expect=1)
    assert "B is complex; K alone may be" in said.err
