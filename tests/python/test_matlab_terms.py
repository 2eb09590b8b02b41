"""Terms of materials in MATLAB files, of both formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

import flexgram
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.importers import read

N = 12
K = 1e3 * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(N, N)).tocsc()
M = sp.identity(N, format="csc")
T = sp.diags(np.linspace(1.0, 300.0, N)).tocsc()
G, TAU = [0.5, 0.3], [0.05, 0.6]


def write_hdf5(file: h5py.Group, name: str, value: Any) -> None:
    """As MATLAB's -v7.3 does."""
    if isinstance(value, dict):
        group = file.create_group(name)
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, entry in value.items():
            write_hdf5(group, key, entry)
    elif isinstance(value, str):
        file[name] = np.array([[ord(c)] for c in value], dtype=np.uint16)
        file[name].attrs["MATLAB_class"] = np.bytes_("char")
    elif sp.issparse(value):
        group = file.create_group(name)
        group.attrs["MATLAB_sparse"] = np.uint64(value.shape[0])
        group["data"], group["ir"], group["jc"] = value.data, value.indices, value.indptr
    else:
        file[name] = np.atleast_2d(np.asarray(value, dtype=float)).T


def write(path: Path, content: dict[str, Any], kind: str) -> None:
    if kind == "v5":
        scipy.io.savemat(path, content)
        return
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            write_hdf5(file, name, value)


@pytest.mark.parametrize("kind", ["v5", "v7.3"])
def test_terms_of_a_struct(kind: str, tmp_path: Path) -> None:
    """H of the reduced body against its definition; in mm-t-s; nothing is lost without a word."""
    file, body, out = tmp_path / "part.mat", tmp_path / "body.h5", tmp_path / "rom.h5"
    terms = {
        "rubber": {"T": T, "law": "prony", "g": G, "tau": TAU},
        "felt": {"T": 0.1 * T, "law": "loss", "eta": 0.2},
        "oil": {"T": 1e-3 * T, "law": "viscous"},
        "bolt": {"T": 2.0 * T, "law": "parameter", "least": 1.0, "most": 1.5, "value": 1.2},
    }
    write(file, {"K": K, "M": M, "S": T, "terms": terms}, kind)
    said = run("import", file, "--rows", "tip=12", "--units", "mm-t-s", "-o", body).out
    assert "variables that are not read, left out: S (--matrices S=S takes S for" in said
    for words in ("rubber (2 Prony terms)", "felt (loss factor 0.2)", "oil (viscous)"):
        assert words in said.partition("damping: ")[2]
    strict = ("import", file, "--rows", "tip=12", "--strict", "-o", tmp_path / "x.h5")
    assert "left out: S" in run(*strict, expect=1).err
    run("reduce", "-body", body, "-mor_band_hz", "0.5,4", "-mor_tol", "1e-6", "-mor_out", out)
    rom = ReducedModel.load(out)
    for hertz in (0.5, 1.7, 3.9):
        w = 2 * np.pi * hertz
        prony = sum(g * 1j * w * t / (1 + 1j * w * t) for g, t in zip(G, TAU, strict=True))
        factor = prony + 0.1 * 0.2j + 1e-3 * 1j * w + 2.0 * (1.2 - 1.0)
        A = 1e3 * (K + factor * T - w**2 * M)
        H = np.linalg.solve(A.toarray(), np.eye(N)[:, -1:])[-1:]
        assert np.linalg.norm(rom.transfer(w) - H) <= rom.certified_error * np.linalg.norm(H)
    assert list(rom.system.parameters) == ["bolt"]


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        (3.0, "terms must be a struct"),
        ({"a": {"T": T}}, "terms.a must be a struct with T"),
        ({"a": {"T": T, "law": "wax"}}, "law wax must be one of loss, viscous, prony, table, para"),
        ({"a": {"T": T, "law": "prony", "g": 1.0}}, "law prony has g, tau, not g"),
        ({"a": {"T": T, "law": "prony", "g": -1.0, "tau": 1.0}}, "g must not be negative"),
        ({"a": {"T": np.ones((2, 3)), "law": "viscous"}}, "is 2 × 3, expected square"),
    ],
)
def test_wrong_terms(terms: Any, words: str, tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "part.mat", {"K": K, "M": M, "terms": terms})
    with pytest.raises(BodyError, match=words):
        read(tmp_path / "part.mat")


def test_tables_of_a_struct(tmp_path: Path) -> None:
    law = flexgram.table([0.0, 50.0], [0.0, 1.0], [0.1, 0.3])
    entry = {"T": T, "law": "table", "omega": law.omega, "storage": law.storage, "loss": law.loss}
    scipy.io.savemat(tmp_path / "part.mat", {"K": K, "M": M, "terms": {"rubber": entry}})
    matrix, found = read(tmp_path / "part.mat").terms["rubber"]
    assert found.at(20.0) == law.at(20.0) and abs(matrix - T).max() == 0
