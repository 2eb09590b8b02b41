"""Viscoelastic materials of a description: Prony series, or tables by frequency.

The file of the body holds the long-term, or least, moduli, and for each part of the stiffness that
changes (``whole``, ``shear``, ``bulk``) a law beside them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.laws import Law, prony, table
from flexgram.body.reader import Reader, short

KEY = "viscoelastic"
PARTS = ("shear", "bulk")
#: Columns of a table: loss_factor is loss over storage.
COLUMNS = ("hz", "storage", "loss", "loss_factor")


class Moduli(NamedTuple):
    """Young's modulus in the unit of the description, and Poisson's ratio."""

    E: float
    nu: float


def read_isotropic(material: Reader) -> tuple[Moduli, dict[str, Law]]:
    """The moduli that K holds, and the laws beside them, of an isotropic material.

    Parameters
    ----------
    material : Reader
        With E and nu. Perhaps with the key ``viscoelastic``, a mapping with either of
        ``prony``: a list of [g, tau] (shares of the instantaneous moduli, as FE codes count them;
        relaxation times in s), or a mapping of such lists for ``shear`` and ``bulk``; and
        ``moduli``, what E is: ``long-term``, the default, or ``instantaneous``.
        ``table``: a mapping of lists ``hz``, ``storage`` and ``loss`` or ``loss_factor``, moduli in
        the unit of E, which is left out; or a mapping of such tables for ``shear`` and ``bulk``,
        one of them perhaps a number, a modulus that does not change, without E and nu.

    Raises
    ------
    BodyError
        Naming the place of the mistake.
    """
    if KEY not in material.data:
        return Moduli(material.number("E"), material.number("nu")), {}
    data = _mapping(material)
    if "table" in data.data:
        if "E" in material.data:
            raise BodyError(f"{material.where}: the table holds E by frequency: leave E out")
        if isinstance(data.get("table"), dict) and set(data.get("table")) & set(PARTS):
            return _tables_by_part(material, data)
        least, of_table = _table(data.get("table"), f"{data.where}: table")
        return Moduli(least, material.number("nu")), {"whole": of_table}
    moduli = Moduli(material.number("E"), material.number("nu"))
    if not isinstance(data.get("prony"), dict):
        share, laws = _alike(data)
        return Moduli(share * moduli.E, moduli.nu), laws
    parts = Reader(data.get("prony"), f"{data.where}: prony", PARTS)
    series = {
        part: _series(parts.get(part), f"{parts.where}: {part}")
        for part in PARTS
        if part in parts.data
    }
    if not series:
        raise BodyError(f"{parts.where}: give shear, bulk or both")
    laws = {part: law for part, (law, _) in series.items()}
    if not _is_instantaneous(data):
        return moduli, laws
    left = {part: series[part][1] if part in series else 1.0 for part in PARTS}
    shear = left["shear"] * moduli.E / (2 * (1 + moduli.nu))
    bulk = left["bulk"] * moduli.E / (3 * (1 - 2 * moduli.nu))
    return _moduli_of(shear, bulk), laws


def _moduli_of(shear: float, bulk: float) -> Moduli:
    nu = (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))
    return Moduli(9 * bulk * shear / (3 * bulk + shear), nu)


def _tables_by_part(material: Reader, data: Reader) -> tuple[Moduli, dict[str, Law]]:
    """Of ``table`` by ``shear`` and ``bulk``: the moduli at their least, and the laws beside."""
    parts = Reader(data.get("table"), f"{data.where}: table", PARTS)
    if "nu" in material.data:
        raise BodyError(f"{parts.where}: shear and bulk tell nu: leave it out")
    least: dict[str, float] = {}
    laws: dict[str, Law] = {}
    for part in PARTS:
        if isinstance(parts.get(part), dict):
            least[part], laws[part] = _table(parts.get(part), f"{parts.where}: {part}")
        else:
            least[part] = parts.number(part)
    if not laws or min(least.values()) <= 0:
        raise BodyError(
            f"{parts.where}: give shear and bulk, each a table or a positive modulus, one a table"
        )
    return _moduli_of(least["shear"], least["bulk"]), laws


def read_orthotropic(material: Reader) -> tuple[float, dict[str, Law]]:
    """What K holds of all moduli of an orthotropic material, which relax alike (``prony``, a list),
    and the law beside it. Raises as ``read_isotropic``."""
    if KEY not in material.data:
        return 1.0, {}
    data = _mapping(material)
    if "table" in data.data or isinstance(data.get("prony"), dict):
        raise BodyError(f"{data.where}: tables, shear and bulk are for isotropic materials")
    return _alike(data)


def _mapping(material: Reader) -> Reader:
    data = Reader(material.get(KEY), f"{material.where}: {KEY}", ("prony", "moduli", "table"))
    if ("prony" in data.data) == ("table" in data.data):
        raise BodyError(f"{data.where}: give prony, or table")
    if "table" in data.data and "moduli" in data.data:
        raise BodyError(f"{data.where}: moduli go with prony")
    return data


def _is_instantaneous(data: Reader) -> bool:
    return data.choice("moduli", ("long-term", "instantaneous"), "long-term") == "instantaneous"


def _alike(data: Reader) -> tuple[float, dict[str, Law]]:
    """The share of given moduli that K holds, and the law of all of them."""
    law, share = _series(data.get("prony"), f"{data.where}: prony")
    return share if _is_instantaneous(data) else 1.0, {"whole": law}


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


def _series(rows: Any, where: str) -> tuple[Law, float]:
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


def _table(given: Any, where: str) -> tuple[float, Law]:
    """The least storage modulus, and the law beside it."""
    columns = Reader(given, where, COLUMNS)
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
