"""Helpers of all Python tests: running the program on some ranks, bodies with known answers."""

from __future__ import annotations

import importlib.util
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "build" / "flexgram"
SHARED = ROOT.parent / "shared" / "data"

EXPORTS = (ROOT / "scripts" / "mpi-environment").read_text().splitlines()
ENVIRONMENT = {
    **os.environ,
    **dict(line.removeprefix("export ").split("=", 1) for line in EXPORTS if "=" in line),
    "OPENBLAS_NUM_THREADS": "1",
}


class Result:
    """Exit status and output of one run."""

    def __init__(self, process: subprocess.CompletedProcess[str]) -> None:
        self.status, self.out, self.err = process.returncode, process.stdout, process.stderr


def run(
    *arguments: Any,
    ranks: int = 1,
    expect: int | None = 0,
    timeout: float = 300,
    file_limit_kb: int | None = None,
) -> Result:
    """Run ``flexgram`` under mpirun; a hang is a failure through the timeout."""
    program = [str(PROGRAM), *map(str, arguments)]
    if file_limit_kb is not None:  # for the ranks only: mpirun needs larger files
        program = ["bash", "-c", f'ulimit -f {file_limit_kb}; exec "$@"', "-", *program]
    command = ["mpirun", "-n", str(ranks), *program]
    process = subprocess.run(
        command, env=ENVIRONMENT, capture_output=True, text=True, timeout=timeout
    )
    if expect is not None:
        assert process.returncode == expect, f"{command}\n{process.stdout}\n{process.stderr}"
    return Result(process)


def message(result: Result) -> str:
    """The one message of a failed run."""
    lines = [line for line in result.err.splitlines() if line.startswith("flexgram:")]
    assert len(lines) == 1, f"one message expected:\n{result.err}"
    return lines[0]


def edit(path: Path, change: Callable[[str], str]) -> None:
    """Change a text file in place."""
    path.write_text(change(path.read_text()))


def rom_matrices(path: Path) -> dict[str, Any]:
    with h5py.File(path) as file:
        data = {key: file[key][:] for key in ("M", "D", "K", "B", "C", "V")}
        data["sigma"] = file["gramian/sigma"][:]
        data["eta"] = file.attrs["eta"]
        data["modes"] = file["modes/omega"][:]
    return data


def rom_transfer(rom: dict[str, Any], omega: float) -> Any:
    A = rom["K"] * (1 + 1j * rom["eta"]) + 1j * omega * rom["D"] - omega**2 * rom["M"]
    return rom["C"] @ np.linalg.solve(A, rom["B"])


def read_sparse(file: h5py.File, name: str) -> sp.csc_matrix:
    group = file[name]
    n = int(group.attrs["MATLAB_sparse"])
    arrays = (group["data"][:], group["ir"][:], group["jc"][:])
    return sp.csc_matrix(arrays, shape=(n, len(arrays[2]) - 1))


def assembled(path: Path, body: Path, ranks: int = 1) -> dict[str, Any]:
    """K, M, B and the dof map of a mesh body, assembled by the program."""
    run("assemble", "-body", body, "-body_out", path, ranks=ranks)
    with h5py.File(path) as file:
        return {
            "K": read_sparse(file, "K"),
            "M": read_sparse(file, "M"),
            "B": file["B"][:],
            "names": list(file["B"].attrs["names"]),
            "node": file["nodes/id"][:][file["dofs/node"][:]],
            "component": file["dofs/component"][:],
            "position": file["nodes/position"][:][file["dofs/node"][:]],
        }


def sweep_transfer(path: Path) -> tuple[Any, Any]:
    with h5py.File(path) as file:
        return file["omega"][:], file["H"][..., 0] + 1j * file["H"][..., 1]


def shared_case(name: str) -> dict[str, Any]:
    """One of the bodies in ../shared/data."""
    spec = importlib.util.spec_from_file_location("load_case", SHARED / "load_case.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    case: dict[str, Any] = module.load_case(str(SHARED / name))
    return case


@pytest.fixture(scope="session")
def load_case() -> Callable[[str], dict[str, Any]]:
    """Loader of the bodies in ../shared/data, where that folder is there."""
    if not (SHARED / "load_case.py").exists():
        pytest.skip(f"{SHARED} is not there: bodies by other people are not tested")
    return shared_case


def chain(n: int = 60, **changes: Any) -> dict[str, Any]:
    """Matrices of a fixed-free chain of unit masses and springs, for bad-input tests."""
    K = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]).tolil()
    K[-1, -1] = 1
    B = np.zeros((n, 2))
    B[-1, 0] = B[n // 2, 1] = 1
    body: dict[str, Any] = {"K": K.tocsc(), "M": sp.identity(n).tocsc(), "B": B, "alpha": 0.01}
    body.update(changes)
    return body


@pytest.fixture(scope="session")
def rack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Body file of the rack."""
    from flexgram import import_body

    path = tmp_path_factory.mktemp("rack") / "rack.h5"
    import_body(ROOT / "meshes" / "rack.yaml", path)
    return path


def certified(
    body: Path,
    band: tuple[float, float],
    folder: Path,
    *options: Any,
    ranks: int = 1,
    count: int = 500,
    H: Any = None,
) -> dict[str, Any]:
    """Reduce ``body`` and compare its bound with full solves at frequencies that it never saw.

    The full transfer function ``H`` (count, n_out, n_in) may be handed over from an earlier call.
    """
    first, last = band
    inside = ",".join(
        repr(x) for x in (first + 7e-4 * (last - first), last - 3e-4 * (last - first), count)
    )
    rom, sweep = folder / "certified.rom.h5", folder / "certified.sweep.h5"
    run("reduce", "-body", body, "-mor_band_hz", f"{first!r},{last!r}", "-mor_error_hz", inside,
        "-mor_out", rom, *options, ranks=ranks)  # fmt: skip
    if H is None:
        run("sweep", "-body", body, "-mor_sweep_hz", inside, "-mor_sweep_out", sweep, ranks=ranks)
        H = sweep_transfer(sweep)[1]
    data = rom_matrices(rom)
    with h5py.File(rom) as file:
        omega, bound = file["error/omega"][:], file["error/bound"][:]
        floor, kind = file["error/floor"][:], file["error"].attrs["kind"]
        factorisations = file["log"].attrs["factorisations"]
        stage = file.attrs["second_stage"]
        by_kind = file["error"].attrs.get("by_kind")
        ports = (
            [[str(x) for x in file[k].attrs["names"]] for k in "CB"] if by_kind is not None else []
        )
    at = 2 * np.pi * np.linspace(*[float(x) for x in inside.split(",")[:2]], count)
    index = np.abs(omega[:, None] - at).argmin(axis=0)
    assert np.allclose(omega[index], at, rtol=1e-12)
    truth = np.array(
        [
            np.linalg.norm(h - rom_transfer(data, w)) / np.linalg.norm(h)
            for h, w in zip(H, at, strict=True)
        ]
    )
    kinds = []  # displacement from force, rotation from moment
    for letter in "fm" if by_kind is not None else "":
        block = np.ix_(*([i for i, n in enumerate(names) if n.split(".")[-1][0] == letter]
                         for names in ports))  # fmt: skip
        kinds.append(max(
            np.linalg.norm((h - rom_transfer(data, w))[block]) / np.linalg.norm(h[block])
            for h, w in zip(H, at, strict=True)))  # fmt: skip
    above = truth > floor[index]
    ratio = bound[index][above] / truth[above]
    return {
        "kinds": kinds, "by_kind": [] if by_kind is None else list(by_kind),
        "H": H, "truth": truth, "bound": bound[index], "floor": floor[index], "kind": kind,
        "worst": bound.max(), "order": data["K"].shape[0], "factorisations": factorisations,
        "stage": stage, "ratio": ratio, "rom": data, "path": rom,
    }  # fmt: skip


def assert_certified(result: dict[str, Any], tolerance: float | None = None) -> None:
    """The bound holds everywhere, and is no more than 30 times (median 5) the error."""
    assert result["kind"] == "certified"
    assert np.all(result["truth"] <= result["bound"])
    if result["ratio"].size:
        assert np.median(result["ratio"]) <= 5 and result["ratio"].max() <= 30
    assert all(t <= b for t, b in zip(result["kinds"], result["by_kind"], strict=True))
    if tolerance is not None:
        assert result["worst"] <= tolerance
        assert all(bound <= tolerance for bound in result["by_kind"])
