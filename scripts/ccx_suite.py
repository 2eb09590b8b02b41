"""Every deck of a folder: imported and compared with CalculiX' own frequencies of the same step.

    scripts/ccx-suite FOLDER [pattern]        such as the decks of CalculiX' own test suite

For each deck that ccx itself can run: ``equal`` (to the digits that ccx prints), ``named``
(different, and the import says that something is left out), ``refused`` (with the reason),
``WRONG``. Exit status 1 if one is wrong or ends in a traceback. Statics needs no masses: where a
material has no density, both programs get a copy of the deck with one. Decks for which ccx finds no
frequencies by itself (heat, fluids, other versions), and those that take more than a minute, are
counted apart, with ccx' reason.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import fnmatch
import itertools
import os
import re
import signal
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import scipy.linalg as sl
from scipy.sparse.linalg import eigsh

from flexgram.basics import BodyError
from flexgram.importers import ccx, read

COUNT, SECONDS = 10, 60


def with_masses(deck: Path, folder: Path) -> Path:
    """The deck, or a copy in which each material has a density."""
    job = ccx.read_job(deck)
    missing = 0
    cards: list[ccx.Card] = []
    for at, card in enumerate(job.model):
        cards.append(card)
        if card.keyword != "MATERIAL":
            continue
        following = itertools.takewhile(lambda c: c.keyword != "MATERIAL", job.model[at + 1 :])
        if not any(c.keyword == "DENSITY" for c in following):
            cards.append(ccx.Card("DENSITY", {}, ["*DENSITY", "7.8e-9"]))
            missing += 1
    if not missing:
        return deck
    copy = folder / deck.name
    lines = (line for part in (cards, *job.steps) for card in part for line in card.lines)
    copy.write_text("".join(f"{line}\n" for line in lines))
    return copy


def frequencies(deck: Path) -> np.ndarray | str:
    """[Hz, negative below zero] that ccx prints, else why it prints none."""
    try:
        done = subprocess.run(
            ["ccx", deck.stem],
            cwd=deck.parent,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired:
        return "ccx is too slow"
    said = done.stdout.splitlines()
    errors = [i for i, line in enumerate(said) if "*ERROR" in line]
    why = " ".join(" ".join(said[errors[0] : errors[0] + 2] if errors else said[-3:]).split())
    data = deck.with_name(deck.stem + ".dat")
    printed = data.read_text(errors="replace") if data.exists() else ""
    table = printed.rpartition("E I G E N V A L U E   O U T P U T")[2]
    number = r"([-+.\dE]+)"
    rows = re.findall(
        rf"^\s+\d+\s+{number}\s+{number}\s+{number}\s+{number}\s*$", table, re.MULTILINE
    )
    hz = np.array(
        [
            float(hz) if float(value) > 0 else -float(imaginary) / (2 * np.pi)
            for value, _, hz, imaginary in rows
        ]
    )
    if len(rows) and np.any(hz):
        return hz
    return "zeros: no masses, or fewer modes than that" if len(rows) else why


def reference(deck: Path, folder: Path) -> np.ndarray | str:
    """The same of the deck's own step, or of one in place of its steps."""
    own = ""
    try:
        job = ccx.read_job(deck)
        number = ccx.frequency_step(job)
        head, storage, tail = ccx.prepare(job)[0].partition(ccx.STORAGE)
        if number is not None:
            own = next(
                "".join(f"{line}\n" for line in card.lines)
                for card in job.step_of(number)
                if card.keyword == "FREQUENCY"
            )
    except BodyError:
        head, storage, tail = deck.read_text(errors="replace"), "", ""
    found: np.ndarray | str = ""
    # ARPACK needs more equations than it is asked for modes: ccx then prints zeros.
    for count in (COUNT, 4, 1):
        step = (own or f"*FREQUENCY\n{count}\n") if storage else ""
        (folder / deck.name).write_text(head + step + tail)
        found = frequencies(folder / deck.name)
        if not (isinstance(found, str) and found.startswith("zeros") and step != own):
            break
    return found


def squares(hz: np.ndarray) -> np.ndarray:
    """λ [rad²/s²] with its sign."""
    return np.sign(hz) * (2 * np.pi * hz) ** 2


def imported(deck: Path, count: int) -> tuple[np.ndarray, float, list[str]]:
    """The lowest λ, the rounding of the printed matrices in it, and what the import says."""
    fe = read(deck, run_ccx=True)
    K, M = fe.K, fe.M
    largest = float(np.max(K.diagonal()[M.diagonal() > 0] / M.diagonal()[M.diagonal() > 0]))
    shift = 1e-7 * largest
    if fe.n <= 3000:
        E, M = K.toarray() + shift * M.toarray(), M.toarray()
        unit = 1 / np.sqrt(np.maximum(np.abs(E.diagonal()), 1e-300))
        E, M = unit[:, None] * E * unit, unit[:, None] * M * unit
        energy, Q = sl.eigh(E)
        some = np.abs(energy) > 1e-13 * energy[-1]  # else neither stiff nor heavy
        Q = Q[:, some] / np.sqrt(np.abs(energy[some]))
        if np.all(energy[some] > 0):
            mu = sl.eigvalsh(Q.T @ M @ Q)[::-1]
        else:  # a body that its preload buckles
            mu = np.sort(sl.eigvals(Q.T @ M @ Q, Q.T @ E @ Q).real)[::-1]
            mu = np.concatenate([mu[mu < 0], mu[mu > 0]])
        values = 1 / mu[:count] - shift
    else:
        values = eigsh(K, min(count, fe.n - 2), M, sigma=-shift, return_eigenvectors=False)
    return np.sort(values)[:count], 1e-12 * largest, fe.remarks


def _stop(*_: object) -> None:
    raise TimeoutError


def verdict(deck: Path) -> tuple[str, str]:
    signal.signal(signal.SIGALRM, _stop)
    with tempfile.TemporaryDirectory() as folder:
        own = deck
        with contextlib.suppress(BodyError):
            own = with_masses(deck, Path(folder))
        run = Path(folder) / "reference"
        run.mkdir()
        theirs = reference(own, run)
        alone = isinstance(theirs, str)
        try:
            signal.alarm(SECONDS)
            if alone:  # refused for a reason, at least
                read(own, run_ccx=True)
                return "no frequencies", theirs
            ours, rounding, remarks = imported(own, len(theirs))
        except BodyError as error:
            return "refused", str(error)
        except TimeoutError:
            return "too slow", ""
        except Exception:
            return "WRONG", "traceback: " + traceback.format_exc().splitlines()[-1]
        finally:
            signal.alarm(0)
    expected = np.sort(squares(theirs))[: len(ours)]
    off = np.abs(ours[: len(expected)] - expected)
    said = "; ".join(remarks)
    if np.all(off <= 2e-6 * np.abs(expected) + rounding):
        return "equal", said
    worst = int(np.argmax(off / (2e-6 * np.abs(expected) + rounding)))
    hz = np.sqrt(np.abs([ours[worst], expected[worst]])) / (2 * np.pi)
    first = f"mode {worst + 1}: {hz[0]:.6g} for {hz[1]:.6g} Hz"
    if (
        np.min(np.abs(ours)) <= rounding
    ):  # ccx shifts by nothing: it misses modes, and makes some up
        return "named", f"{first}: K is singular, modes of ccx itself are not reliable; {said}"
    return ("named" if "left out" in said else "WRONG"), f"{first}; {said}"


def main() -> int:
    folder, pattern = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "*.inp"
    decks = sorted(path for path in folder.iterdir() if fnmatch.fnmatch(path.name, pattern))
    counts: Counter[str] = Counter()
    with concurrent.futures.ProcessPoolExecutor(os.cpu_count()) as pool:
        for deck, (word, why) in zip(decks, pool.map(verdict, decks), strict=True):
            counts[word] += 1
            print(f"{word:10} {deck.name:28} {why}"[:300], flush=True)
    print(", ".join(f"{number} {word}" for word, number in sorted(counts.items())))
    return 1 if counts["WRONG"] else 0


if __name__ == "__main__":
    sys.exit(main())
