"""Nodes, node sets, elements and rigid bodies of an Abaqus or CalculiX deck."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexgram.importers.fe import Floats, Ints
from flexgram.meshfile import BodyError

#: Element types by the beginning of their name: meshio type, number of nodes.
SOLIDS = {
    "C3D20": ("hexahedron20", 20),
    "C3D10": ("tetra10", 10),
    "C3D15": ("wedge15", 15),
    "C3D8": ("hexahedron", 8),
    "C3D6": ("wedge", 6),
    "C3D4": ("tetra", 4),
}


@dataclass
class Deck:
    """What of a deck matters beside its matrices; labels as written."""

    labels: Ints
    points: Floats
    sets: dict[str, Ints] = field(default_factory=dict)
    blocks: list[tuple[str, Ints]] = field(default_factory=list)
    #: *RIGID BODY: name of its node set -> reference and rotation node
    rigid: dict[str, tuple[int, int]] = field(default_factory=dict)
    transformed: bool = False  #: *TRANSFORM: matrices are in local axes


def _keyword(line: str) -> tuple[str, dict[str, str]]:
    parts = [part.strip() for part in line[1:].split(",")]
    options = {}
    for part in parts[1:]:
        key, _, value = part.partition("=")
        options[key.strip().upper()] = value.strip().strip('"')
    return " ".join(parts[0].upper().split()), options


def _lines(path: Path, depth: int = 0) -> list[tuple[Path, int, str]]:
    """All lines with their place, *INCLUDE resolved, comments left out."""
    if depth > 10:
        raise BodyError(f"{path}: *INCLUDE goes round in circles")
    try:
        content = path.read_text(errors="replace")
    except OSError as error:
        raise BodyError(f"{path}: {error.strerror}") from None
    if "\0" in content[:4096]:
        raise BodyError(f"{path}: binary, expected an input deck")
    result: list[tuple[Path, int, str]] = []
    for number, line in enumerate(content.splitlines(), start=1):
        if line.startswith("**") or not line.strip():
            continue
        if line.upper().startswith("*INCLUDE"):
            name = _keyword(line)[1].get("INPUT", "")
            result += _lines(path.parent / name, depth + 1)
        else:
            result.append((path, number, line))
    return result


def read_deck(path: Path) -> Deck:
    """Read the model part of a deck (everything before the first step)."""
    labels: list[int] = []
    points: list[list[float]] = []
    sets: dict[str, list[int]] = {}
    elsets: dict[str, list[int]] = {}
    connectivity: dict[int, tuple[str, list[int]]] = {}
    rigid: dict[str, tuple[int, int]] = {}
    transformed = False
    keyword, options = "", dict[str, str]()
    kind, pending, count = "", list[int](), 0
    for file, number, line in _lines(path):
        if line.startswith("*"):
            keyword, options = _keyword(line)
            if keyword == "STEP":
                break
            transformed = transformed or keyword == "TRANSFORM"
            if keyword == "RIGID BODY" and "REF NODE" in options:
                reference = int(options["REF NODE"])
                name = options.get("NSET", options.get("ELSET", f"RIGID{len(rigid) + 1}")).upper()
                rigid[name] = (reference, int(options.get("ROT NODE", reference)))
            if keyword == "ELEMENT":
                name = options.get("TYPE", "").upper()
                kind, count = next(
                    (value for start, value in SOLIDS.items() if name.startswith(start)), ("", 0)
                )
                pending = []
            continue
        words = [word.strip() for word in line.split(",")]
        if words and not words[-1]:
            words.pop()
        try:
            if keyword == "NODE":
                labels.append(int(words[0]))
                xyz = [float(word.replace("D", "E")) if word else 0.0 for word in words[1:4]]
                points.append(xyz + [0.0] * (3 - len(xyz)))
                if "NSET" in options:
                    sets.setdefault(options["NSET"].upper(), []).append(labels[-1])
            elif keyword == "ELEMENT" and count:
                pending += [int(word) for word in words]
                if len(pending) > count:
                    connectivity[pending[0]] = (kind, pending[1 : count + 1])
                    if "ELSET" in options:
                        elsets.setdefault(options["ELSET"].upper(), []).append(pending[0])
                    pending = []
            elif keyword in ("NSET", "ELSET"):
                into, name = (sets, "NSET") if keyword == "NSET" else (elsets, "ELSET")
                target = into.setdefault(options.get(name, "").upper(), [])
                if "GENERATE" in options:
                    first, last, *step = (int(word) for word in words)
                    target += range(first, last + 1, step[0] if step else 1)
                else:
                    for word in words:
                        known = word.lstrip("-").isdigit()
                        target += [int(word)] if known else into.get(word.upper(), [])
        except ValueError:
            raise BodyError(f"{file}, line {number}: {line.strip()[:60]!r} does not belong under "
                            f"*{keyword}") from None  # fmt: skip
    if not labels:
        raise BodyError(f"{path}: no *NODE: is this a deck?")
    blocks = []
    for name, _ in SOLIDS.values():
        nodes = np.array([c for k, c in connectivity.values() if k == name], dtype=np.int64)
        if len(nodes):
            blocks.append((name, nodes))  # VTK's order is the deck's
    all_sets = {name: np.unique(np.array(value, dtype=np.int64)) for name, value in sets.items()}
    for name, elements in elsets.items():
        found = [connectivity[e][1] for e in elements if e in connectivity]
        if found and name not in all_sets:
            all_sets[name] = np.unique(np.array([n for nodes in found for n in nodes]))
    unique, first_of = np.unique(np.array(labels, dtype=np.int64), return_index=True)
    return Deck(unique, np.array(points)[first_of], all_sets, blocks, rigid, transformed)
