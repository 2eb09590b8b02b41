"""A run that was ended goes on: killed anywhere, it ends with the same model."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from test_continuum import chain, chain_modes

from conftest import ENVIRONMENT, PROGRAM, message, rom_matrices, rom_system, run
from flexgram import write_matrices
from referee import relative_error

BAND = ("-mor_band_hz", "10,500")


def offspring(pid: int) -> list[int]:
    """Processes below one, by /proc."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        parents.setdefault(int(words[1]), []).append(int(stat.parent.name))
    found, open_ = [], [pid]
    while open_:
        children = parents.get(open_.pop(), [])
        found += children
        open_ += children
    return found


def left_by(out: Path, method: str) -> Path:
    return Path(f"{out}.{'samples' if method == 'pod' else 'checkpoint'}")


def start(*arguments: Any, ranks: int) -> subprocess.Popen[str]:
    command = ["mpirun", "-n", str(ranks), str(PROGRAM), *map(str, arguments)]
    return subprocess.Popen(
        command, env=ENVIRONMENT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )


def strike(process: subprocess.Popen[str], how: int, after: float) -> None:
    """Send a signal to the ranks after so many seconds (or not at all: they were faster)."""
    try:
        process.wait(after)
        return
    except subprocess.TimeoutExpired:
        pass
    for pid in offspring(process.pid):
        try:
            name = Path(f"/proc/{pid}/comm").read_text().strip()
            if how == signal.SIGKILL or name == "flexgram":
                os.kill(pid, how)
        except OSError:
            continue
    if how == signal.SIGKILL:
        process.kill()
    process.wait(60)


def difference(a: Path, b: Path) -> float:
    """Largest relative difference of H over the band."""
    one, other = (rom_system(rom_matrices(path)) for path in (a, b))
    assert one.K.shape == other.K.shape
    return max(relative_error(one, other, w) for w in 2 * np.pi * np.linspace(11, 490, 23))


@pytest.mark.parametrize(("ranks", "then"), [(1, 1), (2, 2), (2, 1), (1, 2)])
@pytest.mark.parametrize("method", ["two_step", "pod"])
def test_killed_at_random_moments(
    tmp_path: Path, rack: Path, method: str, ranks: int, then: int
) -> None:
    job = ["-body", rack, *BAND, "-mor_out"]
    options = (
        ["-mor_tol", "1e-8"]
        if method == "two_step"
        else ["-mor_method", "pod", "-mor_samples", "12", "-mor_validate", "4", "-mor_order", "24"]
    )
    begin = time.time()
    whole = tmp_path / "whole.h5"
    run("reduce", *job, whole, *options, ranks=then)
    length = time.time() - begin
    rng = np.random.default_rng([ranks, then, len(method)])
    kept = 0
    for trial in range(int(os.environ.get("FLEXGRAM_KILLS", "1"))):
        out = tmp_path / f"killed_{trial}.h5"
        state = left_by(out, method)
        strike(
            start("reduce", *job, out, *options, "-mor_checkpoint", "yes", ranks=ranks),
            signal.SIGKILL,
            float(rng.uniform(0.2, 1.1)) * length,
        )
        kept += state.exists()
        result = run("reduce", *job, out, *options, "-mor_restart", ranks=then)
        assert ("restart" in result.out) or method == "pod"
        # Another number of ranks is another rounding, of some 1e-9 of H here.
        assert difference(whole, out) < (1e-10 if ranks == then else 1e-7), trial
        assert not state.exists()
    print(f"{method}, {ranks} then {then} ranks: {kept} checkpoints")


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("method", ["two_step", "pod"])
def test_sigterm_leaves_a_checkpoint(tmp_path: Path, rack: Path, method: str, ranks: int) -> None:
    """The signal of a batch system's time limit, to the ranks: exit status 3 and a way on."""
    out = tmp_path / "rom.h5"
    job = ["reduce", "-body", rack, *BAND, "-mor_out", out]
    job += (
        ["-mor_tol", "1e-8"]
        if method == "two_step"
        else ["-mor_method", "pod", "-mor_samples", "20", "-mor_order", "24"]
    )
    begin = time.time()
    run(*job, ranks=ranks)
    length = time.time() - begin
    early, late = 0.1 * length, length  # the machine may be busier or idler than it was
    for _ in range(40):
        if late - early < 0.02 * length:
            early, late = 0.8 * early, 1.2 * late
        after = 0.5 * (early + late)
        out.unlink(missing_ok=True)
        process = start(*job, ranks=ranks)
        strike(process, signal.SIGTERM, after)
        said = process.stdout.read() if process.stdout else ""
        early, late = (early, after) if out.exists() else (after, late)
        if "ended by SIGTERM" in said:
            assert process.returncode == 3 and not out.exists()
        if "--restart goes on" in said:
            assert left_by(out, method).exists()
            result = run(*job, "-mor_restart", ranks=ranks)
            assert out.exists() and not left_by(out, method).exists()
            assert method == "pod" or "restart" in result.out
            return
    raise AssertionError("no moment of forty left a checkpoint")


def test_the_first_ctrl_c_asks(tmp_path: Path, rack: Path) -> None:
    """A word at once, and the end after the present step; where no checkpoint is wanted no word."""
    out = tmp_path / "rom.h5"
    job = ["reduce", "-body", rack, *BAND, "-mor_out", out, "-mor_tol", "1e-8"]
    begin = time.time()
    run(*job)
    length = time.time() - begin
    out.unlink()
    told = False
    for trial in range(30):
        process = start(*job, ranks=1)
        strike(process, signal.SIGINT, (0.2 + 0.02 * trial) * length)
        said = process.stdout.read() if process.stdout else ""
        told = told or "ending after the present step" in said
        if "ended by SIGTERM or Ctrl-C" in said:
            assert process.returncode == 3 and not out.exists() and told
            break
        out.unlink(missing_ok=True)
    else:
        raise AssertionError("none of thirty was ended")
    left_by(out, "two_step").unlink(missing_ok=True)
    process = start(*job, "--checkpoint", "no", ranks=1)
    strike(process, signal.SIGINT, 0.5 * length)
    said = process.stdout.read() if process.stdout else ""
    assert "ending after" not in said and process.returncode in (0, 1, 130), said
    out.unlink(missing_ok=True)
    result = run(*job, "--restart")
    assert "there is no checkpoint" in result.out and out.exists()


def ended(folder: Path, monkeypatch: pytest.MonkeyPatch, **changes: Any) -> tuple[Path, Path]:
    """A body, and the checkpoint of a certify that is through but for the removal."""
    K, M, B, _ = chain(60, "three")
    omega = chain_modes(60)
    body = folder / "body.h5"
    write_matrices(body, K, M, B, alpha=1e-2 * omega[0], beta=1e-4 / omega[9], **changes)
    return body, folder / "medium.h5"


def test_another_job_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The difference is named: body, ports, damping, band, cutoff."""
    body, out = ended(tmp_path, monkeypatch)
    omega = chain_modes(60)
    first, last = 0.3 * omega[0] / 2 / np.pi, omega[7] / 2 / np.pi
    band = f"{first!r},{last!r}"
    job = [
        "certify",
        "-body",
        body,
        "-mor_band_hz",
        band,
        "-mor_tol",
        "1e-6",
        "-mor_medium_out",
        out,
    ]
    # The run removes its checkpoint when it is done; a second name keeps the last one.
    state, kept = Path(f"{out}.checkpoint"), tmp_path / "kept"
    process = start(*job, "-mor_checkpoint", "yes", ranks=1)
    while process.poll() is None:
        with contextlib.suppress(FileNotFoundError, FileExistsError):
            os.link(state, tmp_path / "now")
            (tmp_path / "now").replace(kept)
    assert process.returncode == 0 and not state.exists()
    kept.replace(state)
    out.unlink()

    def refused(*changed: Any) -> str:
        kept = state.read_bytes()
        words = message(run(*job, "-mor_restart", *changed, expect=1))
        assert state.read_bytes() == kept and not out.exists()
        return words

    assert "band" in refused("-mor_band_hz", f"{first!r},{0.9 * last!r}")
    assert "inputs" in refused("-mor_inputs", "u1,u2")
    assert "--cutoff" in refused("-mor_cutoff", "1.4")
    K, M, B, _ = chain(60, "three")
    write_matrices(body, 1.001 * K, M, B, alpha=1e-2 * omega[0], beta=1e-4 / omega[9])
    assert "norm of K" in refused()
    write_matrices(body, K, M, B, alpha=2e-2 * omega[0], beta=1e-4 / omega[9])
    assert "alpha" in refused()
    write_matrices(body, K, M, np.roll(B, 3, axis=0), alpha=1e-2 * omega[0], beta=1e-4 / omega[9])
    assert "the ports differ" in refused()  # all norms are the same
    write_matrices(body, K, M, B, alpha=1e-2 * omega[0], beta=1e-4 / omega[9])
    with h5py.File(state, "r+") as file:
        version = file.attrs["flexgram_medium"]
        file.attrs["flexgram_medium"] = 0.0
    assert "another version" in refused()
    with h5py.File(state, "r+") as file:
        file.attrs["flexgram_medium"] = version
    result = run(*job, "-mor_restart")
    assert "levels certified" in result.out and out.exists() and not state.exists()


def test_restart_without_a_checkpoint_begins(tmp_path: Path, rack: Path) -> None:
    result = run(
        "reduce",
        "-body",
        rack,
        *BAND,
        "-mor_tol",
        "1e-2",
        "-mor_restart",
        "-mor_out",
        tmp_path / "rom.h5",
    )
    assert "from the beginning" in result.out and (tmp_path / "rom.h5").exists()
