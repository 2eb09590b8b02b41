"""Loads that stay on a body while it vibrates, as its description gives them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

import h5py

from flexgram.basics import BodyError
from flexgram.body.reader import Reader


def write_preload(file: h5py.File, reader: Reader, names: Iterable[str]) -> list[str]:
    """Write what the description says of it: inputs and their values, in SI units.

    Parameters
    ----------
    file : h5py.File
        With the loads of the body.
    reader : Reader
        Of the whole description.
    names : iterable of str
        Of interfaces and loads.

    Returns
    -------
    list of str
        Loads and interfaces that it uses.

    Raises
    ------
    BodyError
        For an input that the body has not, or of a kind that is no preload.
    """
    entries = reader.children("preload")
    for name, group in file.get("loads", {}).items():
        if "pretension" in group and f"{name}.force" not in entries:
            raise BodyError(
                f"loads: {name}: a pretension is a load that stays: give its force [N] as "
                f"`preload: {{{name}.force: …}}`"
            )
    if not entries:
        return []
    entry, names = Reader(entries, "preload"), list(names)
    for key in map(str, entries):
        stem, dot, _ = key.rpartition(".")
        if not dot or stem not in names:
            near = difflib.get_close_matches(stem or key, names, 1)
            raise BodyError(
                f"preload: {key} must be an input, such as {names[0]}.fx or gravity.az, of an "
                "interface or a load of this body" + (f"; did you mean {near[0]}?" if near else "")
            )
    group = file.create_group("preload")
    group.attrs["inputs"] = list(map(str, entries))
    group.attrs["values"] = [entry.number(key) for key in entries]
    return [str(key).rpartition(".")[0] for key in entries]


def said_of_preload(file: h5py.File) -> list[str]:
    """Lines for who imports a body: its loads that stay, in SI units."""
    if "preload" not in file:
        return []
    attributes = file["preload"].attrs
    return [
        f"preload {name}: {value:g} (SI)"
        for name, value in zip(attributes["inputs"], attributes["values"], strict=True)
    ]
