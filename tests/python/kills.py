"""SIGKILL at random moments of every verb that writes: what was there before stays, or all of the
new is there, and the next run is not disturbed.

    scripts/kills [count] [seed]     # so many of each verb

A kill is survived if the output is, byte for byte, the earlier one or as complete as that of a run
that nobody killed, and if running again ends well. ``test_soak`` tries a few.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from conftest import ENVIRONMENT, PROGRAM, ROOT, read_sparse

EARLIER = b"what an earlier run has written"


def flexgram(*words: Any, ranks: int = 1) -> list[str]:
    """A command; verbs of the program under mpirun where it has several ranks."""
    alone = [str(PROGRAM), *map(str, words)]
    return alone if ranks == 1 else ["mpirun", "-n", str(ranks), *alone]


def prepare(folder: Path) -> None:
    """The inputs of all verbs, and a reduced rack."""
    for words in (
        ["import", ROOT / "meshes" / "rack.yaml", "-o", folder / "rack.h5"],
        ["assemble", "-body", folder / "rack.h5", "-body_out", folder / "matrices.h5"],
        ["certify", "-body", folder / "rack.h5", "-mor_medium_out", folder / "medium.h5"],
        ["cut", "-medium", folder / "medium.h5", "-mor_out", folder / "rom.h5"],
        [
            "sweep",
            "-body",
            folder / "rack.h5",
            "-rom",
            folder / "rom.h5",
            "-mor_sweep_hz",
            "10,500,20",
            "-mor_sweep_out",
            folder / "sweep.h5",
        ],
    ):
        subprocess.run(flexgram(*words), check=True, env=ENVIRONMENT, capture_output=True)
    file = h5py.File(folder / "matrices.h5")
    matrices = {name: read_sparse(file, name) for name in ("K", "M")}
    scipy.io.savemat(folder / "body.mat", matrices | {"B": file["B"][:]})
    file.close()


def verbs(folder: Path) -> dict[str, tuple[Callable[[int], list[str]], str]]:
    """Name -> command on so many ranks, and the output that it writes into ``folder / "out"``."""
    body, rom, out = folder / "rack.h5", folder / "rom.h5", folder / "out"
    force = ["--force", "upper.fz=sin(9*t)", "--time", "0,1,4001"]
    serial: dict[str, tuple[list[Any], str]] = {
        "import (mesh)": (["import", ROOT / "meshes" / "rack.yaml", "-o", out / "b.h5"], "b.h5"),
        "import (matrices)": (["import", folder / "body.mat", "-o", out / "b.h5"], "b.h5"),
        "report": (["report", rom, "-o", out / "r.html"], "r.html"),
        "plot": (["plot", rom, "--figure", "transfer", "-o", out / "p.png"], "p.png"),
        "simulate": (["simulate", rom, *force, "-o", out / "t.csv"], "t.csv"),
        "couple": (
            ["couple", f"a={rom}", f"b={rom}", "--join", "a.upper=b.lower", "-o", out / "c.h5"],
            "c.h5",
        ),
        "frf": (["frf", rom, "--pair", "upper.fz=lower.fz", "-o", out / "f.unv"], "f.unv"),
        "modes": (["modes", rom, "-o", out / "m.unv"], "m.unv"),
    }
    for name, suffix in (
        ("exudyn", "npz"),
        ("sid", "SID_FEM"),
        ("dmig", "pch"),
        ("mat", "mat"),
        ("npz", "npz"),
        ("vtu", "vtu"),
        ("nastran", "bdf"),
        ("op4", "op4"),
        ("abaqus", "inp"),
        ("simscape", "mat"),
        ("octave", "m"),
        ("mbdyn", "fem"),
        ("fmu", "fmu"),
    ):
        file = f"e.{suffix}"
        serial[f"export {name}"] = (["export", rom, "--to", name, "-o", out / file], file)
    parallel: dict[str, tuple[list[Any], str]] = {
        "reduce": (["reduce", "-body", body, "-mor_out", out / "r.h5"], "r.h5"),
        "reduce (pod)": (
            [
                "reduce",
                "-body",
                body,
                "-mor_method",
                "pod",
                "-mor_samples",
                4,
                "-mor_out",
                out / "r.h5",
            ],
            "r.h5",
        ),
        "certify": (["certify", "-body", body, "-mor_medium_out", out / "m.h5"], "m.h5"),
        "cut": (["cut", "-medium", folder / "medium.h5", "-mor_out", out / "r.h5"], "r.h5"),
        "sweep": (
            [
                "sweep",
                "-body",
                body,
                "-rom",
                rom,
                "-mor_sweep_hz",
                "10,500,20",
                "-mor_sweep_out",
                out / "s.h5",
            ],
            "s.h5",
        ),
        "assemble": (["assemble", "-body", body, "-body_out", out / "b.h5"], "b.h5"),
    }
    commands: dict[str, tuple[Callable[[int], list[str]], str]] = {}
    for name, (words, file) in {**serial, **parallel}.items():
        many = name in parallel
        commands[name] = (
            lambda ranks, words=words, many=many: flexgram(*words, ranks=ranks if many else 1),
            file,
        )
    return commands


def names_of(path: Path) -> set[str]:
    """Every dataset of an HDF5 file, each read in full."""
    found = set()

    def look(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            item[()]
            found.add(name)  # shapes may differ with the ranks, by rounding

    with h5py.File(path) as file:
        file.visititems(look)
    return found


def complete(path: Path, reference: Path) -> bool:
    """Whether a file is all there, by that of a run that nobody killed."""
    if path.suffix == ".h5":
        return names_of(path) == names_of(reference)
    if path.suffix == ".mat":
        mine, whole = scipy.io.loadmat(path), scipy.io.loadmat(reference)
        return set(mine) == set(whole) and all(
            np.shape(mine[name]) == np.shape(whole[name]) for name in mine
        )
    if path.suffix in (".fmu", ".npz"):
        with zipfile.ZipFile(path) as ours, zipfile.ZipFile(reference) as theirs:
            return ours.testzip() is None and len(ours.namelist()) == len(theirs.namelist())
    words, expected = path.read_bytes(), reference.read_bytes()
    close = abs(len(words) - len(expected)) <= 0.02 * len(expected)  # a date, a time
    return close and words[-8:] == expected[-8:]


def kill(command: list[str], after: float) -> None:
    """Run, and end the whole process group after some seconds."""
    process = subprocess.Popen(
        command,
        env=ENVIRONMENT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        process.wait(timeout=after)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    # Ranks are in groups of their own; they end when mpirun is gone.
    for _ in range(200):
        left = subprocess.run(["pgrep", "-f", "-a", str(PROGRAM)], capture_output=True, text=True)
        if str(Path(command[-1]).parent) not in left.stdout:
            return
        time.sleep(0.05)
    raise RuntimeError("ranks are left after mpirun was killed")


def survived(command: list[str], out: Path, reference: Path, after: float) -> str:
    """Nothing if a kill is survived, else what is wrong."""
    out.write_bytes(EARLIER)
    kill(command, after)
    if not out.exists():
        return "the earlier output is gone"
    if out.read_bytes() != EARLIER:
        try:
            if not complete(out, reference):
                return "the output is not complete"
        except (OSError, RuntimeError, zipfile.BadZipFile) as error:
            return f"the output cannot be read: {error}"
    again = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    if again.returncode != 0 or not complete(out, reference):
        return f"the next run failed: {again.stderr}"
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("seed", type=int, nargs="?", default=1)
    parser.add_argument("--verb", action="append", help="only these")
    options = parser.parse_args()
    lost = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        (folder / "out").mkdir()
        rng = random.Random(options.seed)
        print(f"{'verb':18s} {'kills':>6s} {'survived':>9s}")
        for verb, (make, file) in verbs(folder).items():
            if options.verb and verb not in options.verb:
                continue
            out, reference = folder / "out" / file, folder / f"reference-{file}"
            start = time.monotonic()
            subprocess.run(make(1), check=True, env=ENVIRONMENT, capture_output=True)
            whole = time.monotonic() - start
            shutil.copy(out, reference)
            good, first = 0, ""
            for number in range(options.count):
                wrong = survived(make(1 + number % 2), out, reference, rng.uniform(0, 1.2 * whole))
                good += not wrong
                first = first or wrong
            lost += options.count - good
            print(f"{verb:18s} {options.count:6d} {good:9d}", flush=True)
            if first:
                print(f"  {first}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
