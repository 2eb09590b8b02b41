"""Kinds of ports, by their names."""

from __future__ import annotations

import re

import numpy as np

from flexgram.basics import Ints

#: Last parts of the names of ports of each kind, as the program reads them.
KINDS = {
    "displacement": "[fu][xyz]|u",
    "rotation": "m[xyz]",
    "stress": "s[xyz]{2}",
    "strain": "e(0|45|90)?",
    "inertia": "spin([xyz]{2})?",
    "reaction": "r[xyz]",
    "reaction moment": "rm[xyz]",
    "force": "f[xyz]",
    "moment": "m[xyz]",
    "acceleration": "a[xyz]",
    "angular acceleration": "alpha[xyz]",
    "spin": "spin([xyz]{2})?",
    "pressure": "p",
    "traction": "t[xyz]",
    "load": "load",
    "temperature": "T",
    "temperature gradient": "Tn",
}
OUTPUT_KINDS = (
    *("displacement", "rotation", "stress", "strain"),
    *("inertia", "reaction", "reaction moment"),
)
INPUT_KINDS = tuple(kind for kind in KINDS if kind not in OUTPUT_KINDS)
#: Pairs that no claim is made of beside those of their own kinds; the claim of all of H holds.
CROSSED = {("displacement", "moment"), ("rotation", "force")}


def ports_of(names: list[str], kind: str) -> Ints:
    """Which ports are of a kind, by their names; a kind may be such a name, or ``foot.*``."""
    if kind not in KINDS:
        stem = kind.removesuffix("*")
        same = [n == kind or (stem != kind and n.startswith(stem)) for n in names]
        return np.flatnonzero(same).astype(int)
    ends = [name.rpartition(".")[2] for name in names]
    return np.array([i for i, end in enumerate(ends) if re.fullmatch(KINDS[kind], end)], dtype=int)


#: Units of inputs and outputs by what ends their names.
UNITS = {
    "f": ("N", "m"),
    "m": ("N.m", "rad"),
    "a": ("m/s2", None),
    "alpha": ("rad/s2", None),
    "p": ("Pa", None),
    "t": ("Pa", None),
    "T": ("K", None),
    "Tn": ("K/m", None),
    "u": (None, "m"),
    "s": (None, "Pa"),
    "r": (None, "N"),
    "rm": (None, "N.m"),
}


def unit_of(port: str, output: bool, rate: str = "displacement") -> str | None:
    """The SI unit of a port as an input or an output, or of an output's rate; None where its name
    does not tell.

    Examples
    --------
    >>> unit_of("eye.mx", output=False), unit_of("eye.mx", output=True, rate="velocity")
    ('N.m', 'rad/s')
    """
    letters = re.sub("[xyz]+$", "", port.rpartition(".")[2])
    unit = UNITS.get(letters, (None, None))[output]
    if unit is None or rate == "displacement":
        return unit
    return f"{unit}/s" + ("2" if rate == "acceleration" else "") if unit in ("m", "rad") else None
