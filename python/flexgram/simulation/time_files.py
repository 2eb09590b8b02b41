"""Text files of times and numbers: loads over time, coordinates of a multibody code."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from flexgram.basics import BodyError, Floats

Row = tuple[int, list[str]]


def rows_of(path: Path) -> list[Row]:
    """The lines of a comma separated file with their numbers, from 1; comments (#) are left out.

    Raises
    ------
    BodyError
        If it cannot be read.

    Examples
    --------
    >>> rows_of(Path("loads.csv"))[0]
    (1, ['t', 'upper.fx'])
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [
                (n, [word.strip() for word in row])
                for n, row in enumerate(csv.reader(file), 1)
                if row and not row[0].lstrip().startswith("#")
            ]
    except FileNotFoundError:
        raise BodyError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BodyError(f"{path}: {error}") from None
    if rows and ";" in rows[0][1][0]:
        raise BodyError(
            f"{path}, line {rows[0][0]}: expected commas between columns, and decimal points"
        )
    return rows


def table_of(path: Path, rows: list[Row], width: int) -> Floats:
    """The numbers of lines, (n, width); the first of each line is a time, and these rise.

    Raises
    ------
    BodyError
        With the line: what is no number, a line of another length, times that do not rise.

    Examples
    --------
    >>> path = Path("loads.csv")
    >>> table_of(path, rows_of(path)[1:], 2)[0, 0]
    0.0
    """
    table = np.empty((len(rows), width))
    for values, (number, row) in zip(table, rows, strict=True):
        try:
            values[:] = np.array([float(word) for word in row]).reshape(width)
        except ValueError:
            raise BodyError(f"{path}, line {number}: expected {width} numbers") from None
        if not np.all(np.isfinite(values)):
            raise BodyError(f"{path}, line {number}: holds NaN or Inf")
    rises = np.diff(table[:, 0]) > 0
    if not np.all(rises):
        raise BodyError(
            f"{path}, line {rows[1 + int(np.argmin(rises))][0]}: the time does not rise"
        )
    return table
