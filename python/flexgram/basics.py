"""What many modules share: the one error of users, looking numbers up, writing files whole."""

from __future__ import annotations

import difflib
import glob
import os
import shutil
import signal
import sys
import tempfile
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Types of arrays.
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]


class BodyError(ValueError):
    """A body, file or argument that cannot be used; the message says what to change."""


class ReductionWarning(UserWarning):
    """A result that may not be what its user needs; the message says why, and what to change."""


def meant(word: str, known: Iterable[str]) -> str:
    """The question whether a known word is meant that is near, or empty."""
    names = {name.lower(): name for name in known}
    near = difflib.get_close_matches(word.lower(), names, 1, 0.8)
    return f", did you mean {names[near[0]]}?" if near else ""


def counted(number: int, thing: str) -> str:
    """As ``1 node``, ``2 nodes``, ``2 masses``."""
    ending = "" if number == 1 else "es" if thing.endswith("s") else "s"
    return f"{number} {thing}{ending}"


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """A BodyError names the file, if it does not."""
    try:
        yield
    except BodyError as error:
        if str(path) in str(error):
            raise
        raise BodyError(f"{path}: {error}") from None


@contextmanager
def errors_of(path: str | Path) -> Iterator[None]:
    """Turn whatever a reader raises of a damaged file into one BodyError that names the file."""
    try:
        with naming(path):
            yield
    except BodyError:
        raise
    except (
        ValueError,
        LookupError,
        TypeError,
        ArithmeticError,
        AttributeError,
        MemoryError,
        RuntimeError,
    ) as error:
        words = " ".join(str(error).split())[:200]
        raise BodyError(
            f"{path}: cannot be read ({type(error).__name__}: {words}); is it complete "
            "and of this format?"
        ) from error


def whole_numbers(what: str | Path, values: ArrayLike) -> Ints:
    """Numbers that count or number something, as integers.

    Raises
    ------
    BodyError
        For fractions, NaN and what no index can be.
    """
    numbers = np.asarray(values)
    if numbers.dtype.kind in "iu":
        return numbers.astype(np.int64)
    bad = ~(np.abs(numbers) < 2.0**53) | (numbers != np.floor(numbers))
    if np.any(bad):
        raise BodyError(f"{what}: {numbers[bad].ravel()[0]:.17g} where a whole number is expected")
    return numbers.astype(np.int64)


def stored(what: str | Path, dataset: h5py.Dataset) -> NDArray[np.generic]:
    """All of an HDF5 dataset, if all of it is in this file.

    Raises
    ------
    BodyError
        If it declares more than is stored (a few bytes could ask for all memory, and HDF5 gives
        zeros for what a killed writer left out), or if it is stored in other files.
    """
    here = not dataset.external and not dataset.is_virtual
    if here and dataset.chunks is not None:
        parts = [-(-n // c) for n, c in zip(dataset.shape, dataset.chunks, strict=True)]
        here = dataset.id.get_num_chunks() >= np.prod(parts, dtype=float)
    elif here:
        here = dataset.id.get_storage_size() >= dataset.size * dataset.dtype.itemsize
    if not here:
        raise BodyError(
            f"{what}: {dataset.name} declares {dataset.size} numbers, which are not "
            "all in this file"
        )
    values: NDArray[np.generic] = dataset[()]
    return values


def expect_survival(path: str | Path, work: Callable[[], object]) -> None:
    """Try a library's reader on a file in a child process: damaged files crash some of them
    (HDF5 1.10 in texts of variable length, SciPy, ansys-mapdl-reader). Not where MPI runs: its
    processes should not fork.

    Raises
    ------
    BodyError
        If the child died of a signal; other errors come again when the file is read.
    """
    if {"mpi4py.MPI", "_flexgram", "petsc4py.PETSc"} & set(sys.modules):
        return
    child = os.fork()
    if child == 0:
        try:
            os.close(2)
            work()
        finally:
            os._exit(0)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (
        signal.SIGSEGV,
        signal.SIGBUS,
        signal.SIGABRT,
        signal.SIGFPE,
    ):
        raise BodyError(f"{path}: damaged: its reader crashes")


def check_name(what: str, name: str) -> str:
    """The name of an interface or a port: it becomes part of lists, of paths in the file, of XML
    and of what is printed.

    Raises
    ------
    BodyError
        For an empty or blank name, one with ``/``, commas, spaces at its ends, and characters that
        no text shows (controls, lone surrogates, noncharacters).
    """
    hidden = [c for c in name if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Cn", "Co")]
    if hidden:
        raise BodyError(f"{what}: {name!r} is no name: it holds {hidden[0]!r}, which no text shows")
    if not name or name != name.strip() or any(c in name for c in "/,") or name in (".", ".."):
        raise BodyError(f"{what}: {name!r} is no name: without / and commas, please")
    return name


def shown(text: str) -> str:
    """A text of a file as a terminal may print it: characters that no text shows are escaped."""
    return "".join(
        c.encode("unicode_escape").decode()
        if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Cn", "Co")
        else c
        for c in text
    )


def index_of(labels: Ints, wanted: Ints) -> tuple[Ints, Bools]:
    """Where each wanted label stands in ``labels`` (in any order), and whether it does."""
    if not len(labels):
        return np.zeros(np.shape(wanted), dtype=np.int64), np.zeros(np.shape(wanted), dtype=bool)
    order = np.argsort(labels, kind="stable")
    at = order[np.minimum(np.searchsorted(labels, wanted, sorter=order), len(order) - 1)]
    return at, labels[at] == wanted


def expect_kept(output: str | Path, *inputs: str | Path | None) -> None:
    """Refuse to write over what the output is made from.

    Raises
    ------
    BodyError
        If ``output`` is there, and is one of ``inputs``.
    """
    for given in inputs:
        if given is not None and Path(output).exists() and Path(given).exists():
            if Path(output).samefile(given):
                raise BodyError(f"{output} would replace the input {given}")


@contextmanager
def written_aside(
    path: str | Path, *inputs: str | Path | None, companions: Sequence[str] = ()
) -> Iterator[Path]:
    """A place to write ``path``: what is written there appears under its name when all is done.

    The place has the final name, in a folder of its own beside the target, so a format of several
    files (XDMF) works; a failure leaves what was there before. Symlinks are followed. A file that
    comes with the target replaces one that is there only if it is among ``companions``.

    Parameters
    ----------
    path : str or Path
        File to write. Its folder is made.
    inputs : str or Path
        What it is made from, and must not replace.
    companions : sequence of str
        Names of files that belong to the target, of which the caller knows that one that is there
        may be replaced: ``rack.xdmf.h5`` beside ``rack.xdmf``.

    Raises
    ------
    BodyError
        If ``path``, or a file that comes with it, is one of ``inputs``, a folder, a device or a
        pipe; if a file that comes with it would replace one that may be another's; if no file of
        this name was written (a writer that adds an ending of its own).
    """
    target = Path(os.path.realpath(path))

    def expect_free(place: Path) -> None:
        if place.exists() and not place.is_file():
            raise BodyError(f"cannot write {place}: it is no file")
        expect_kept(place, *inputs)

    expect_free(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{target.name}.part-"
    for old in target.parent.glob(f"{glob.escape(prefix)}*"):  # of a killed run, long ago
        if time.time() - old.stat().st_mtime > 86400:
            shutil.rmtree(old, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=prefix, dir=target.parent))
    try:
        yield folder / target.name
        others = [file for file in folder.iterdir() if file.name != target.name]
        if not (folder / target.name).exists():
            made = ", ".join(sorted(file.name for file in others)) or "nothing"
            raise BodyError(f"{path}: this format would write {made}: give that name")
        for file in others:
            place = target.parent / file.name
            expect_free(place)
            if place.exists() and file.name not in companions:
                raise BodyError(
                    f"{path} comes with a file {file.name}, and there is one that may "
                    "be another's: take another name"
                )
        for file in (*others, folder / target.name):  # the one that names the others last
            file.replace(target.parent / file.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


_is_quiet = False


def be_quiet() -> None:
    """Print nothing from now on but errors and warnings."""
    global _is_quiet
    _is_quiet = True


def say(line: str) -> None:
    """Print, with what no terminal should get escaped; where nobody listens any more (``| head``)
    the work goes on."""
    if _is_quiet:
        return
    try:
        print("\n".join(shown(part) for part in line.split("\n")), flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
