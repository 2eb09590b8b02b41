"""Viscoelastic materials of a description: Prony series, or tables by frequency.

The file of the body holds the long-term, or least, moduli, and for each part of the stiffness that
changes (``whole``, ``shear``, ``bulk``) a law beside them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.laws import Law, Prony, prony, table
from flexgram.body.reader import Reader, short

KEY = "viscoelastic"
PARTS = ("shear", "bulk")
#: Columns of a table: loss_factor is loss over storage.
COLUMNS = ("hz", "storage", "loss", "loss_factor")


class Moduli(NamedTuple):
    """Young's modulus in the unit of the description, and Poisson's ratio."""

    E: float
    nu: float


def read_viscoelastic(
    material: Reader, moduli: Moduli | None
) -> tuple[float, Moduli, dict[str, Law]]:
    """What is in K, and what is beside it.

    Parameters
    ----------
    material : Reader
        With the key ``viscoelastic``: a mapping with ``prony``, a list of [g, tau] (shares of the
        instantaneous moduli, as FE codes count them; relaxation times in s) or a mapping of such
        lists for ``shear`` and ``bulk``, and ``moduli`` (``long-term``, the default, or
        ``instantaneous``: what E is); or with ``table``, a mapping of lists ``hz``, ``storage``
        and ``loss`` or ``loss_factor``, moduli in the unit of E, which is left out.
    moduli : Moduli, optional
        As given: None for a table, and for an orthotropic material.

    Returns
    -------
    factor, moduli, laws
        ``factor``: of all moduli as given, to those in K.

    Raises
    ------
    BodyError
        Naming the place of the mistake.
    """
    data = Reader(material.get(KEY), f"{material.where}: {KEY}", ("prony", "moduli", "table"))
    if ("prony" in data.data) == ("table" in data.data):
        raise BodyError(f"{data.where}: give prony, or table")
    if "table" in data.data:
        if "moduli" in data.data:
            raise BodyError(f"{data.where}: moduli go with prony")
        least, of_table = _table(data)
        return 1.0, Moduli(least, material.number("nu")), {"whole": of_table}
    instantaneous = (
        data.choice("moduli", ("long-term", "instantaneous"), "long-term") != "long-term"
    )
    given = data.get("prony")
    if not isinstance(given, dict):
        law, share = _series(given, f"{data.where}: prony")
        factor = share if instantaneous else 1.0
        return factor, moduli or Moduli(0, 0), {"whole": law}
    if moduli is None:
        raise BodyError(f"{data.where}: shear and bulk are parts of isotropic materials")
    parts = Reader(given, f"{data.where}: prony", PARTS)
    series = {
        part: _series(parts.get(part), f"{parts.where}: {part}") for part in PARTS if part in given
    }
    if not series:
        raise BodyError(f"{parts.where}: give shear, bulk or both")
    laws: dict[str, Law] = {part: law for part, (law, _) in series.items()}
    if not instantaneous:
        return 1.0, moduli, laws
    left = {part: series[part][1] if part in series else 1.0 for part in PARTS}
    shear = left["shear"] * moduli.E / (2 * (1 + moduli.nu))
    bulk = left["bulk"] * moduli.E / (3 * (1 - 2 * moduli.nu))
    nu = (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))
    return 1.0, Moduli(9 * bulk * shear / (3 * bulk + shear), nu), laws


def _numbers(values: Any, where: str) -> Floats:
    try:
        if isinstance(values, str):
            raise TypeError
        array = np.array([float(x) for x in values])
    except (TypeError, ValueError):
        raise BodyError(f"{where} = {short(values)} must be a list of numbers") from None
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise BodyError(f"{where} = {short(values)} must be a list of finite numbers")
    return array


def _series(rows: Any, where: str) -> tuple[Prony, float]:
    """The law of [g, tau], and the long-term share 1 - Σ g of the instantaneous modulus."""
    if not (isinstance(rows, list) and rows):
        raise BodyError(f"{where} = {short(rows)} must be a list of [g, tau]")
    pairs = [_numbers(row, where) for row in rows]
    if any(len(pair) != 2 for pair in pairs):
        raise BodyError(f"{where} = {short(rows)} must be a list of [g, tau]")
    g, tau = np.transpose(pairs)
    left = 1 - g.sum()
    if np.any(g < 0) or np.any(tau <= 0) or not left > 1e-9:
        raise BodyError(
            f"{where}: g are shares of the instantaneous modulus, not negative, with a sum below 1 "
            f"(it is {g.sum():g}); tau [s] is positive"
        )
    return prony(g / left, tau), float(left)


def _table(data: Reader) -> tuple[float, Law]:
    """The least storage modulus, and the law beside it."""
    columns = Reader(data.get("table"), f"{data.where}: table", COLUMNS)
    where = columns.where
    if ("loss" in columns.data) == ("loss_factor" in columns.data):
        raise BodyError(f"{where}: give hz, storage, and loss or loss_factor")
    hz, storage = (_numbers(columns.get(key), f"{where}: {key}") for key in ("hz", "storage"))
    key = "loss" if "loss" in columns.data else "loss_factor"
    loss = _numbers(columns.get(key), f"{where}: {key}")
    if not len(hz) == len(storage) == len(loss):
        raise BodyError(
            f"{where}: hz, storage and {key} have {len(hz)}, {len(storage)} and {len(loss)} numbers"
        )
    if np.any(storage <= 0):
        raise BodyError(f"{where}: storage must be positive")
    loss = loss * storage if key == "loss_factor" else loss
    least = float(storage.min())
    try:
        return least, table(2 * np.pi * hz, (storage - least) / least, loss / least)
    except BodyError as error:
        raise BodyError(f"{where}: {error}".replace("omega", "hz")) from None
