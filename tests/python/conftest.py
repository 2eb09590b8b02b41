"""Helpers of all Python tests: running the program on some ranks, bodies with known answers."""

from __future__ import annotations

import atexit
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy reads it
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "meshes"))

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from _pytest.assertion import util as assertions

from others import SHARED, shared_case
from referee import System, suspicious

# Each worker has a place of its own for Open MPI's session directories: in a common one, which the
# last to leave removes, another may be about to make its own.
SESSIONS = tempfile.mkdtemp(prefix="flexgram-")
atexit.register(shutil.rmtree, SESSIONS, ignore_errors=True)
os.environ["OMPI_MCA_orte_tmpdir_base"] = os.environ["PRTE_MCA_prte_tmpdir_base"] = SESSIONS

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "build" / "flexgram"
PYTHON = ROOT / ".venv" / "bin" / "python3"

EXPORTS = (ROOT / "scripts" / "mpi-environment").read_text().splitlines()
ENVIRONMENT = {
    **os.environ,
    **dict(line.removeprefix("export ").split("=", 1) for line in EXPORTS if "=" in line),
    "OPENBLAS_NUM_THREADS": "1",
    # Tests run side by side: no rank is tied to a core, and who waits gives way.
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_hwloc_default_binding_policy": "none",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    # No wait after a failed rank.
    "OMPI_MCA_odls_base_sigkill_timeout": "0",
    "PRTE_MCA_odls_base_sigkill_timeout": "0",
    "BROWSER": "true",  # nothing is shown
    # Tests read the plan.
    "PETSC_OPTIONS": "-mor_monitor plan",
}


#: Tests of more than some seconds, ``module::function``: ``-m "not slow"`` leaves them out. Written
#: by a run of all tests with FLEXGRAM_SLOW=3, which names those that take more seconds.
SLOW_FILE = Path(__file__).with_name("slow.txt")
SLOW = set(SLOW_FILE.read_text().split())


def _function(node: str) -> str:
    """``module::function`` of a test."""
    path, _, rest = node.partition("::")
    return f"{Path(path).stem}::{rest.partition('[')[0]}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if _function(item.nodeid) in SLOW:
            item.add_marker(pytest.mark.slow)


def _bounded(difference: Callable[..., list[str]]) -> Callable[..., list[str]]:
    """No difference of pages of some megabytes: pytest takes hours for one."""

    def short(left: str, right: str, *more: Any) -> list[str]:
        if len(left) + len(right) > 20_000:
            return ["(too long to say where they differ)"]
        return difference(left, right, *more)

    return short


if hasattr(assertions, "_diff_text"):
    assertions._diff_text = _bounded(assertions._diff_text)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    if "FLEXGRAM_SLOW" not in os.environ:
        return
    seconds: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            if hasattr(report, "duration") and hasattr(report, "nodeid"):
                seconds[report.nodeid] = seconds.get(report.nodeid, 0.0) + report.duration
    limit = float(os.environ["FLEXGRAM_SLOW"])
    slow = {_function(node) for node, each in seconds.items() if each > limit}
    SLOW_FILE.write_text("\n".join(sorted(slow)) + "\n")


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
    # Python would keep what it could write of a compiled module.
    # Open MPI 5 keeps shared memory in files that are larger than a limit.
    by_tcp = (
        {}
        if file_limit_kb is None
        else {
            "PYTHONDONTWRITEBYTECODE": "1",
            "OMPI_MCA_btl": "self,tcp",
            "OMPI_MCA_btl_tcp_if_include": "lo",
        }
    )
    process = subprocess.run(
        command, env=ENVIRONMENT | by_tcp, capture_output=True, text=True, timeout=timeout
    )
    if expect is not None:
        assert process.returncode == expect, f"{command}\n{process.stdout}\n{process.stderr}"
    return Result(process)


def program(name: str, *arguments: Any, ranks: int = 1, timeout: float = 120) -> str:
    """What a program of ``programs`` prints, run under MPI."""
    path = Path(__file__).parent / "programs" / f"{name}.py"
    command = ["mpirun", "-n", str(ranks), str(PYTHON), str(path), *map(str, arguments)]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=timeout)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


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
        data["S"] = file["S"][:] if "S" in file else None
        assert "terms" not in file, "the referee does not read them"
        data["sigma"] = file["gramian/sigma"][:]
        data["eta"] = file.attrs["eta"]
        data["outputs"] = output_terms(file)
        data["modes"] = file["modes/omega"][:]
    return data


def rom_transfer(rom: dict[str, Any], omega: float) -> Any:
    A = rom["K"] * (1 + 1j * rom["eta"]) + 1j * omega * rom["D"] - omega**2 * rom["M"]
    A = A if rom.get("S") is None else A + 1j * rom["S"]
    return rom["C"] @ np.linalg.solve(A, rom["B"])


def read_sparse(file: h5py.File, name: str) -> sp.csc_matrix:
    group = file[name]
    n = int(group.attrs["MATLAB_sparse"])
    arrays = (group["data"][:], group["ir"][:], group["jc"][:])
    return sp.csc_matrix(arrays, shape=(n, len(arrays[2]) - 1))


def assembled(path: Path, body: Path, ranks: int = 1) -> dict[str, Any]:
    """K, M, G where there is one, B and the dof map of a mesh body, assembled by the program."""
    run("assemble", "-body", body, "-body_out", path, ranks=ranks)
    with h5py.File(path) as file:
        return {
            "K": read_sparse(file, "K"),
            "M": read_sparse(file, "M"),
            "G": read_sparse(file, "G") if "G" in file else None,
            "B": file["B"][:],
            "names": list(file["B"].attrs["names"]),
            "node": file["nodes/id"][:][file["dofs/node"][:]],
            "component": file["dofs/component"][:],
            "position": file["nodes/position"][:][file["dofs/node"][:]],
        }


def sweep_transfer(path: Path) -> tuple[Any, Any]:
    with h5py.File(path) as file:
        return file["omega"][:], file["H"][..., 0] + 1j * file["H"][..., 1]


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


def body_system(path: Path) -> System:
    """The matrices of a body file (a mesh body is assembled first), for the referee."""
    with h5py.File(path) as file:
        mesh = "mesh" in file
    if mesh:
        matrices = path.with_name(path.stem + ".assembled.h5")
        if not matrices.exists():
            run("assemble", "-body", path, "-body_out", matrices)
        path = matrices
    with h5py.File(path) as file:
        value = lambda name: (  # noqa: E731
            float(np.ravel(file.attrs[name])[0])
            if name in file.attrs
            else float(np.ravel(file[name][()])[0])
            if name in file
            else 0.0
        )
        dense = lambda name: (  # noqa: E731
            read_sparse(file, name).toarray()
            if isinstance(file[name], h5py.Group)
            else file[name][:].T
            if "MATLAB_class" in file[name].attrs
            else file[name][:]
        )
        rates = [read_sparse(file, name) for name in "DG" if name in file]
        return System(
            read_sparse(file, "K"),
            read_sparse(file, "M"),
            dense("B"),
            dense("C") if "C" in file else None,
            sum(rates[1:], rates[0]) if rates else None,
            value("alpha"),
            value("beta"),
            value("eta"),
            S=read_sparse(file, "S") if "S" in file else None,
            **output_terms(file),
        )


def output_terms(file: h5py.File) -> dict[str, Any]:
    """What outputs of a body or a reduced body hold beside C q, in the H of claims: stress without
    what a temperature adds to it at once."""
    terms = {name: file[name][:] for name in ("output_beta", "output_eta") if name in file}
    if "feedthrough" in file:
        terms["direct"] = file["feedthrough"][:]
        names = [str(x) for x in file["C"].attrs["names"]]
        terms["direct"][kinds_of(names, "stress")] = 0
    return terms


def rom_system(rom: dict[str, Any]) -> System:
    parts = (rom[x] for x in "KMBCD")
    return System(*parts, eta=rom["eta"], S=rom["S"], **rom["outputs"])


#: What ends the names of ports of each kind.
ENDS = {
    "displacement": "[fu][xyz]|u",
    "force": "f[xyz]",
    "rotation": "m[xyz]",
    "moment": "m[xyz]",
    "acceleration": "a[xyz]",
    "angular acceleration": "alpha[xyz]",
    "spin": "spin([xyz]{2})?",
    "inertia": "spin([xyz]{2})?",
    "pressure": "p",
    "stress": "s[xyz]{2}",
    "strain": "e(0|45|90)?",
    "traction": "t[xyz]",
    "load": "load",
    "temperature": "T",
    "reaction": "r[xyz]",
    "reaction moment": "rm[xyz]",
}


def kinds_of(names: list[str], word: str) -> list[int]:
    """Which of the ports are of a kind."""
    return [k for k, name in enumerate(names) if re.fullmatch(ENDS[word], name.rpartition(".")[2])]


def certified(
    body: Path,
    band: tuple[float, ...],
    folder: Path,
    *options: Any,
    ranks: int = 1,
    count: int = 12,
    full: System | None = None,
    expect: int = 0,
) -> dict[str, Any]:
    """Reduce ``body`` and let the referee judge what the file claims.

    The referee's frequencies are never given to the program: random ones, ends of the bands, poles
    of the reduced body and their flanks, minima of |H_r| (antiresonances). The truth is solved
    from the body's matrices in extended precision.
    """
    rom = folder / "certified.rom.h5"
    ends = ",".join(repr(float(f)) for f in band)
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        ends,
        "-mor_out",
        rom,
        *options,
        ranks=ranks,
        expect=expect,
    )
    full = full or body_system(body)
    data = rom_matrices(rom)
    reduced = rom_system(data)
    with h5py.File(rom) as file:
        error = file["error"].attrs
        claim = {key: error[key] for key in error}
        omega, bound, floor = (file[f"error/{k}"][:] for k in ("omega", "bound", "floor"))
        bands = file["error/bands"][:]
        excluded = file["error/excluded"][:] if "error/excluded" in file else np.zeros((0, 2))
        factorisations, stage = file["log"].attrs["factorisations"], file.attrs["second_stage"]
        names = [[str(x) for x in file[k].attrs["names"]] for k in "CB"]
    rng = np.random.default_rng(zlib.crc32(repr((ends, options)).encode()))  # every run alike
    at = suspicious(reduced, bands, excluded, rng, count)
    views = [
        [kinds_of(group, word) for group, word in zip(names, kind.split(" from "), strict=True)]
        for kind in claim.get("kinds", [])
    ]
    least = list(claim.get("kind_least", [0.0] * len(views)))
    claims = np.array([claim["whole"], *claim.get("by_kind", [])])

    def errors(H: Any, away: Any) -> Any:
        """Of all of H, and of each kind."""
        found = [np.linalg.norm(np.abs(away)) / np.linalg.norm(np.abs(H))]
        for view, size in zip(views, least, strict=True):
            block = np.ix_(*view)
            own = max(np.linalg.norm(np.abs(H[block])), size)
            found.append(np.linalg.norm(np.abs(away[block])) / own)
        return np.array(found, dtype=float)

    found = []
    for w in np.append(at, claim["at"]):
        H = full.transfer(w)
        now = errors(H, H - reduced.transfer(w))
        if np.any(now > claims) and full.exact_is_cheap:  # by the referee's own rounding?
            H = full.exactly(w)
            now = errors(H, H - reduced.exactly(w))
        elif np.any(now > claims) and full.refinement_is_cheap and not claim["rigid_rounding"]:
            H = full.refined(w)
            now = errors(H, H - reduced.refined(w))
        found.append(now)
    truth, kinds = np.array(found)[:, 0], np.array(found)[:, 1:].max(axis=0).tolist()
    return {
        "kinds": kinds,
        "by_kind": list(claim.get("by_kind", [])),
        "full": full,
        "at": at,
        "truth": truth,
        "worst": float(claim["worst"]),
        "whole": float(claim["whole"]),
        "attained": float(claim["attained"]),
        "kind": claim["kind"],
        "met": claim.get("met"),
        "rigid_rounding": float(claim["rigid_rounding"]),
        "floor": floor.max(),
        "order": data["K"].shape[0],
        "factorisations": factorisations,
        "stage": stage,
        "rom": data,
        "path": rom,
        "omega": omega,
        "bound": bound,
        "excluded": excluded,
        "bands": bands,
    }


def assert_certified(
    result: dict[str, Any], tolerance: float | None = None, sharp: float = 5
) -> None:
    """No true error exceeds the claim, and the claim is no more than ``sharp`` times the largest
    that was found (where that is above its rounding)."""
    assert result["kind"] in ("certified", "certified outside")
    worst = result["truth"].max()
    # What the stored K holds of rigid modes within its rounding is stated beside the claim.
    assert worst <= result["whole"] + result["rigid_rounding"], (worst, result["whole"])
    if worst > 2 * (result["floor"] + result["rigid_rounding"]):
        assert result["whole"] <= sharp * worst
    assert all(
        t <= b + result["rigid_rounding"]
        for t, b in zip(result["kinds"], result["by_kind"], strict=True)
    )
    if tolerance is not None:
        assert result["worst"] <= tolerance and result["met"]
        assert all(bound <= tolerance for bound in result["by_kind"])


#: Description of a clamped box of ``bodies.box``.
CLAMPED = {
    "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
    "regions": {"all": {"material": "steel"}},
    "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
    "supports": {"clamp": {"nodes": "start"}},
}


@pytest.fixture(scope="session")
def held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clamped box beside its reduced body."""
    from bodies import box
    from flexgram.body.description import import_description

    folder = tmp_path_factory.mktemp("held")
    mesh = box("hexahedron", (4, 2, 2))
    import_description(CLAMPED | {"damping": {"eta": 0.01}}, "box", folder / "box.h5", mesh=mesh)
    run(
        *("reduce", "-body", folder / "box.h5", "-mor_band_hz", "100,8000"),
        *("-mor_tol", 1e-4, "-mor_out", folder / "box.rom.h5"),
    )
    return folder


@pytest.fixture(scope="session")
def viscous(held: Path) -> Path:
    """The same with Rayleigh damping, reduced."""
    from bodies import box
    from flexgram.body.description import import_description

    mesh = box("hexahedron", (4, 2, 2))
    damping = {"damping": {"alpha": 20.0}}
    import_description(CLAMPED | damping, "box", held / "alpha.h5", mesh=mesh)
    run(
        *("reduce", "-body", held / "alpha.h5", "-mor_band_hz", "100,8000"),
        *("-mor_tol", 1e-4, "-mor_out", held / "alpha.rom.h5"),
    )
    return held / "alpha.rom.h5"
