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
}
OUTPUT_KINDS = ("displacement", "rotation", "stress", "inertia", "reaction", "reaction moment")
INPUT_KINDS = tuple(kind for kind in KINDS if kind not in OUTPUT_KINDS)
#: Pairs that no claim is made of beside those of their own kinds; the claim of all of H holds.
CROSSED = {("displacement", "moment"), ("rotation", "force")}


def ports_of(names: list[str], kind: str) -> Ints:
    """Which ports are of a kind, by their names."""
    ends = [name.rpartition(".")[2] for name in names]
    return np.array([i for i, end in enumerate(ends) if re.fullmatch(KINDS[kind], end)], dtype=int)
