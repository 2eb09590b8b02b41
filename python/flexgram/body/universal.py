"""Universal files (SDRC, text): their datasets, which test and FE programs exchange."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from flexgram.basics import BodyError


def datasets(path: str | Path) -> Iterator[tuple[int, list[str]]]:
    """Number and lines of each dataset.

    Raises
    ------
    BodyError
        If there is no such file, or it ends inside a dataset; for binary datasets (58b).
    """
    source = Path(path)
    if not source.is_file():
        raise BodyError(f"{path}: no such file")
    inside: list[str] | None = None
    text = source.read_text(encoding="utf-8-sig", errors="replace")
    for line in text.replace("\r", "").split("\n"):
        if line.strip() == "-1" and line[:6].strip() == "-1":
            if inside and inside[0].strip().startswith("58b"):
                raise BodyError("binary universal files (58b) are not read: write text")
            if inside and inside[0].strip().isdigit():
                yield int(inside[0]), inside[1:]
            inside = [] if inside is None else None
        elif inside is not None:
            inside.append(line)
    if inside is not None and any(line.strip() for line in inside):
        raise BodyError(f"the file ends inside a dataset ({inside[0].strip()}): is it complete?")


def dataset(number: int, lines: Iterable[str]) -> list[str]:
    """The lines of a dataset with what frames it."""
    return [f"{-1:6d}", f"{number:6d}", *lines, f"{-1:6d}"]
