"""Bad input: one message that names the place, exit status 1, no output file, no hang."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from conftest import chain, message, run
from flexgram import ReducedModel, write_matrices
from flexgram.body.bodyfile import write_sparse


def with_entries(matrix: Any, **entries: float) -> Any:
    """A copy with some entries set: ``r3c5=1.0`` is entry (3, 5)."""
    changed = sp.lil_matrix(matrix)
    for name, value in entries.items():
        row, column = name[1:].split("c")
        changed[int(row), int(column)] = value
    return changed.tocsc()


def negative_mass() -> Any:
    """Unit diagonal, neighbours 0.7: eigenvalues 1 + 1.4 cos θ, symmetric but indefinite."""
    return sp.diags([0.7 * np.ones(59), np.ones(60), 0.7 * np.ones(59)], [-1, 0, 1]).tocsc()


def mechanism() -> dict[str, Any]:
    """The last two dofs are massless and joined only to each other."""
    body = chain()
    K, M = body["K"].tolil(), body["M"].tolil()
    K[57, 58] = K[58, 57] = 0
    K[58, 58] = K[59, 59] = 1
    K[58, 59] = K[59, 58] = -1
    M[58, 58] = M[59, 59] = 0
    return chain(K=K.tocsc(), M=M.tocsc())


K, M = chain()["K"], chain()["M"]
BODIES: dict[str, tuple[Callable[[], dict[str, Any]], str]] = {
    "NaN": (lambda: chain(K=with_entries(K, r3c3=np.nan)), "/K(3, 3) = nan"),
    "Inf": (lambda: chain(M=with_entries(M, r5c5=np.inf)), "/M(5, 5) = inf"),
    "NaN in B": (lambda: chain(B=np.full((60, 1), np.nan)), "/B holds nan"),
    "unsymmetric M, one entry": (
        lambda: chain(M=with_entries(M, r3c9=1.0, r9c3=0.5)),
        "/M is not symmetric: (3, 9)",
    ),
    "unsymmetric M": (
        lambda: chain(M=with_entries(M, r1c2=0.1, r2c1=-0.1)),
        "no mass matrix has one",
    ),
    "one triangle": (lambda: chain(K=sp.triu(K).tocsc()), "only one triangle"),
    "M with a negative eigenvalue": (lambda: chain(M=negative_mass()), "M has"),
    "negative diagonal of M": (lambda: chain(M=with_entries(M, r4c4=-1.0)), "M(4, 4) = -1"),
    "negative K": (lambda: chain(K=with_entries(K, r4c4=-5.0)), "K(4, 4) = -5"),
    "very indefinite K": (
        lambda: chain(K=K - 0.9 * sp.identity(60)),
        "it must be positive semidefinite (a buckled state, or K and M swapped?)",
    ),
    "huge K": (lambda: chain(K=1e300 * K), "K has an entry of 2e+300 in row 0"),
    "huge D": (
        lambda: chain(D=1e300 * sp.identity(60)),
        "D has entries of 1e+300, which doubles cannot square",
    ),
    "huge alpha": (lambda: chain(alpha=1e300), "alpha = 1e+300 1/s is no damping of a body"),
    "huge beta": (lambda: chain(beta=1e300), "beta = 1e+300 s is no damping of a body"),
    "huge eta": (lambda: chain(eta=1e300), "eta = 1e+300 is no damping of a body"),
    "indefinite K": (
        lambda: chain(K=with_entries(K, r4c5=-9.0, r5c4=-9.0)),
        "K has 1 negative eigenvalue",
    ),
    "mechanism": (mechanism, "K and M share 1 null vector"),
    "zero rows": (
        lambda: chain(
            K=with_entries(sp.block_diag([K[:59, :59], 0]).tocsc(), r58c58=1.0),
            M=sp.block_diag([sp.identity(59), sp.csc_matrix((1, 1))]).tocsc(),
        ),
        "row 59",
    ),
    "port of 1e80": (
        lambda: chain(B=np.eye(60)[:, :2] * [1, 1e80]),
        "port in2: its column of B is as large as 1e+80",
    ),
    "zero port": (lambda: chain(B=np.eye(60)[:, :2] * [1, 0]), "port in2: its column of B is zero"),
    "negative diagonal damping": (
        lambda: chain(D=with_entries(sp.csc_matrix((60, 60)), r3c3=-2.0)),
        "D(3, 3) = -2 is negative",
    ),
}


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("case", BODIES)
def test_bad_bodies(case: str, ranks: int, tmp_path: Path) -> None:
    make, expected = BODIES[case]
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, **make())
    result = run("reduce", "-body", body, "-mor_out", out, ranks=ranks, expect=1, timeout=300)
    assert expected in message(result)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["body.h5"]


def _short_data(file: h5py.File) -> None:
    """A dataset that declares more than is stored."""
    del file["K/jc"], file["K"].attrs["MATLAB_sparse"]
    file.create_dataset("K/jc", (10**9 + 1,), dtype="u8")


def _external(file: h5py.File) -> None:
    value = file["K/data"][:]
    del file["K/data"]
    Path(file.filename).with_suffix(".raw").write_bytes(value.tobytes())
    raw = str(Path(file.filename).with_suffix(".raw"))
    file.create_dataset("K/data", value.shape, "f8", external=[(raw, 0, value.nbytes)])


def _fractions(file: h5py.File) -> None:
    rows = file["K/ir"][:].astype(float)
    rows[3] += 0.5
    del file["K/ir"]
    file["K/ir"] = rows


def _longer(file: h5py.File) -> None:
    for name in ("data", "ir"):
        longer = np.append(file[f"K/{name}"][:], 0)
        del file[f"K/{name}"]
        file[f"K/{name}"] = longer


def _linked(file: h5py.File) -> None:
    del file["M"]
    file["M"] = h5py.ExternalLink("elsewhere.h5", "/M")


def _two_names(file: h5py.File) -> None:
    file["B"].attrs["names"] = ["a", "a"]


def _vector_eta(file: h5py.File) -> None:
    del file.attrs["eta"]
    file["eta"] = np.empty(0)


EDITS = {
    "negative damping": (lambda file: file.attrs.__setitem__("alpha", -1.0), "alpha = -1"),
    "two ports of one name": (_two_names, "two ports named a"),
    "declared, not stored": (_short_data, "declares 1000000001 numbers, which are not all"),
    "stored elsewhere": (_external, "which are not all in this file"),
    "link to another file": (_linked, "/M is a link to another file"),
    "fractional rows": (_fractions, "expected whole numbers"),
    "entries behind the last column": (_longer, "/K/jc points to entry"),
    "rows that are no number": (
        lambda file: file["K"].attrs.__setitem__("MATLAB_sparse", np.nan),
        "MATLAB_sparse = nan",
    ),
    "damping without a number": (_vector_eta, "eta must be one number"),
}


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("case", EDITS)
def test_damaged_bodies(case: str, ranks: int, tmp_path: Path) -> None:
    damage, expected = EDITS[case]
    body = tmp_path / "body.h5"
    write_matrices(body, **chain())
    with h5py.File(body, "r+") as file:
        damage(file)
    result = run(
        "reduce", "-body", body, "-mor_out", tmp_path / "rom.h5", ranks=ranks, expect=1, timeout=300
    )
    assert expected in message(result)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("size", [0, 2**17, 2**60, 2**63])
def test_a_damaged_heap_of_texts(size: int, ranks: int, tmp_path: Path) -> None:
    """HDF5 loops for ever, or writes beyond its memory, where an object of the heap that texts of
    variable length lie in has a wrong size."""
    body = tmp_path / "body.h5"
    names = [f"port {k}" for k in range(chain()["B"].shape[1])]
    write_matrices(body, **chain(), inputs=names)
    content = bytearray(body.read_bytes())
    heap = content.index(b"GCOL")
    content[heap + 24 : heap + 32] = size.to_bytes(8, "little")  # of its first object
    body.write_bytes(content)
    result = run(
        "reduce", "-body", body, "-mor_out", tmp_path / "rom.h5", ranks=ranks, expect=1, timeout=100
    )
    assert "names of /B" in message(result)


@pytest.mark.parametrize("layout", ["earliest", "v108"])
def test_a_damaged_attribute_is_not_a_missing_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, layout: str
) -> None:
    """eta = 0.1 was lost when its header did not parse: the program reads what h5py reads, or
    refuses the file. The layout of HDF5 1.8, which flexgram writes, has checksums."""
    monkeypatch.setattr("flexgram.body.bodyfile.LAYOUT", (layout, "v110"))
    body, damaged, out = (tmp_path / name for name in ("body.h5", "damaged.h5", "rom.h5"))
    write_matrices(body, **chain(eta=0.1))
    data = body.read_bytes()
    at, read = data.index(b"eta\0"), 0
    for offset in range(-10, 40):
        changed = bytearray(data)
        changed[at + offset] ^= 0xFF
        damaged.write_bytes(changed)
        result = run(
            "reduce",
            "-body",
            damaged,
            "-mor_band_hz",
            "0.01,0.3",
            "-mor_order",
            "4",
            "-mor_out",
            out,
            expect=None,
            timeout=300,
        )
        assert result.status in (0, 1)
        if result.status == 0:
            read += 1
            with h5py.File(damaged) as file:
                assert ReducedModel.load(out).eta == float(file.attrs.get("eta", 0.0))
    assert (read > 0) == (layout == "earliest")


OPTIONS = {
    "band": (["-mor_band_hz", "500,10"], "--band 500,10"),
    "negative band": (["-mor_band_hz", "-1,10"], "zero or more"),
    "tolerance": (["-mor_tol", "-1e-3"], "--tol -0.001"),
    "zero tolerance": (["-mor_tol", "0"], "--tol 0"),
    "samples": (["-mor_samples", "0"], "--samples 0"),
    "fraction": (["-mor_samples", "2.5"], "whole number"),
    "no number": (["-mor_samples", "many"], "finite number"),
    "unknown option": (["-mor_sampels", "30"], "did you mean --samples?"),
    "unknown choice": (["-mor_quadrature", "gaus"], "did you mean gauss?"),
    "unknown port": (["-mor_inputs", "in3"], "no port in3"),
    "groups": (["-mor_method", "pod", "-mor_groups", "5"], "between 1 and the number of ranks"),
    "log from zero": (
        ["-mor_method", "pod", "-mor_band_hz", "0,1", "-mor_spacing", "log"],
        "start above zero",
    ),
    "tolerance and order": (["-mor_tol", "0.1", "-mor_order", "3"], "give --tol or --order"),
    "hyphen": (["-mor-order", "3"], "did you mean --order?"),
    "prefix": (["-order", "3"], "did you mean --order (-mor_order"),
    "options file": (["-options_file", "none.opts"], "No such file"),
    "stray word": (["-mor_order", "3", "500"], "stray word 500"),
    "icntl": (["-mor_mumps_icntl_61", "1"], "numbered 1 to 60"),
    "owned icntl": (["-mor_mumps_icntl_21", "0"], "left alone"),
    "workspace": (["-mor_mumps_workspace", "-1"], "0 or more"),
    "port twice": (["-mor_inputs", "in1,in1"], "named twice"),
    "order": (["-mor_order", "500", "-mor_samples", "2"], "--order 500"),
}


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("case", OPTIONS)
def test_bad_options(case: str, ranks: int, tmp_path: Path) -> None:
    options, expected = OPTIONS[case]
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, **chain())
    result = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "0.01,0.3",
        "-mor_out",
        out,
        *options,
        ranks=ranks,
        expect=1,
        timeout=300,
    )
    assert expected in message(result)
    assert not out.exists()


def test_a_band_that_nobody_chose_is_named(tmp_path: Path) -> None:
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, **chain())
    result = run("reduce", "-body", body, "-mor_out", out)
    assert "--band is not given: the band is 10 to 500 Hz" in result.out + result.err


def damaged(name: str, path: Path) -> None:
    if name == "scalar B":
        with h5py.File(path, "a") as file:
            del file["B"]
            file["B"] = 1.0
    elif name == "wrong shape of M":
        with h5py.File(path, "a") as file:
            del file["M"]
            write_sparse(file, "M", sp.identity(59))
    elif name == "wrong shape of B":
        with h5py.File(path, "a") as file:
            del file["B"]
            file["B"] = np.ones((7, 2))
    elif name == "wrong shape of C":
        with h5py.File(path, "a") as file:
            file["C"] = np.ones((2, 7))
    elif name == "missing dataset":
        with h5py.File(path, "a") as file:
            del file["M"]
    elif name == "missing B":
        with h5py.File(path, "a") as file:
            del file["B"]
    elif name == "row out of range":
        with h5py.File(path, "a") as file:
            file["K/ir"][5] = 1000
    elif name == "dense K":
        with h5py.File(path, "a") as file:
            del file["K"]
            file["K"] = np.eye(60)
    elif name == "text":
        path.write_text("no HDF5")
    elif name == "truncated":
        path.write_bytes(path.read_bytes()[:3000])
    elif name == "missing file":
        path.unlink()
    elif name == "folder":
        path.unlink()
        path.mkdir()


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("missing dataset", "/M is missing"),
        ("missing B", "/B (input map, n × n_in) is missing"),
        ("scalar B", "/B must be a matrix"),
        ("wrong shape of M", "/M is 59 × 59"),
        ("wrong shape of B", "/B is 7 × 2, expected n × n_in"),
        ("wrong shape of C", "/C is 2 × 7, expected n_out × n"),
        ("row out of range", "/K/ir holds row 1000"),
        ("dense K", "/K must be a sparse matrix"),
        ("text", "is not an HDF5 file"),
        ("truncated", "body.h5"),
        ("missing file", "No such file"),
        ("folder", "body.h5"),
    ],
)
def test_bad_files(name: str, expected: str, ranks: int, tmp_path: Path) -> None:
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, **chain())
    damaged(name, body)
    result = run("reduce", "-body", body, "-mor_out", out, ranks=ranks, expect=1, timeout=300)
    assert expected in message(result)
    assert not out.exists()


def test_a_resonance_in_one_group_ends_the_other(tmp_path: Path) -> None:
    """Two groups of one rank: the first meets an undamped resonance, the second is fine."""
    body = tmp_path / "body.h5"
    unit = sp.identity(60).tocsc()
    write_matrices(body, **chain(K=unit, M=unit, alpha=0.0))
    resonance = 1 / (2 * np.pi)
    result = run(
        "sweep",
        "-body",
        body,
        "-mor_groups",
        2,
        "-mor_sweep_hz",
        f"{resonance!r},{2 * resonance!r},2",
        "-mor_sweep_out",
        tmp_path / "s.h5",
        ranks=2,
        expect=1,
        timeout=300,
    )
    assert "frequency 1 of 2" in message(result) and "singular" in message(result)
    assert not (tmp_path / "s.h5").exists()


def test_a_rom_of_other_ports_is_refused(tmp_path: Path) -> None:
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, **chain())
    band = ("-mor_band_hz", "0.01,0.3")
    run("reduce", "-body", body, *band, "-mor_inputs", "in1", "-mor_out", out)
    sweep = (
        "sweep",
        "-body",
        body,
        "-rom",
        out,
        "-mor_sweep_hz",
        "0.02,0.2,3",
        "-mor_sweep_out",
        tmp_path / "s.h5",
    )
    assert "1 inputs, 1 outputs" in run(*sweep, "-mor_inputs", "in1").out
    run(*sweep)  # without a choice the rom's ports count
    with h5py.File(tmp_path / "s.h5") as file:
        assert file["H"].shape == (3, 1, 1, 2) and list(file["H"].attrs["inputs"]) == ["in1"]
    assert "no port in2" in message(run(*sweep, "-mor_inputs", "in2", expect=1))
    assert "this is a reduced file" in message(run("sweep", "-body", out, expect=1))


def test_misspelt_options_of_petsc_are_named(tmp_path: Path) -> None:
    body = tmp_path / "body.h5"
    write_matrices(body, **chain())
    result = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "0.01,0.3",
        "-mor_out",
        tmp_path / "rom.h5",
        "-log_vieww",
        "x.h5",
    )
    assert "option -log_vieww was not used" in result.out


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_undamped_free_body_at_zero_frequency(ranks: int, tmp_path: Path) -> None:
    free = with_entries(K, r0c0=1.0)
    body = tmp_path / "body.h5"
    write_matrices(body, **chain(K=free, alpha=0.0))
    result = run(
        "sweep",
        "-body",
        body,
        "-mor_sweep_hz",
        "0",
        "-mor_sweep_out",
        tmp_path / "sweep.h5",
        ranks=ranks,
        expect=1,
        timeout=300,
    )
    assert "no finite response" in message(result) and "0 Hz" in message(result)
    assert not (tmp_path / "sweep.h5").exists()


@pytest.mark.parametrize("ranks", [1, 2])
def test_too_little_memory(rack: Path, tmp_path: Path, ranks: int) -> None:
    result = run(
        "reduce",
        "-body",
        rack,
        "-mor_memory_limit_mb",
        3,
        "-mor_out",
        tmp_path / "rom.h5",
        ranks=ranks,
        expect=1,
    )
    assert "needs" in message(result) and "3 MB may be used" in message(result)


def test_verbs_and_help() -> None:
    assert "did you mean reduce?" in message(run("reduc", expect=1))
    result = run("-help")
    assert "-mor_band_hz" in result.out and "[10,500]" in result.out
    assert "no body file is named" in message(run("reduce", expect=1))
    assert "-rom" in run("sweep", "-help", ranks=2).out
    said = dict(line.split(maxsplit=1) for line in run("--version").out.splitlines())
    assert said["flexgram"] == flexgram.__version__ and {"PETSc", "MUMPS", "MPI"} <= set(said)
