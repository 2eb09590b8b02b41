"""Nodes, node sets, elements and rigid bodies of an Abaqus or CalculiX deck."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.meshfile import MEMBRANE

#: Element types by the beginning of their name: meshio type, number of nodes.
SOLIDS = {
    "C3D20": ("hexahedron20", 20),
    "C3D10": ("tetra10", 10),
    "C3D15": ("wedge15", 15),
    "C3D8": ("hexahedron", 8),
    "C3D6": ("wedge", 6),
    "C3D5": ("pyramid", 5),
    "C3D4": ("tetra", 4),
}
#: Shells, likewise: S4R and S4 alike, and S3R.
SHELLS = {
    "S4": ("quad", 4),
    "S3": ("triangle", 3),
    "S8": ("quad8", 8),
    "S6": ("triangle6", 6),
    "STRI65": ("triangle6", 6),
    "STRI3": ("triangle", 3),
    "M3D4": ("quad", 4),
    "M3D3": ("triangle", 3),
}
#: Beams and trusses.
LINES = {"B31": ("line", 2), "B32": ("line3", 3), "T3D2": ("line", 2)}
#: Meshio types of shells; with those of lines of elements whose nodes turn.
SHELL_KINDS = frozenset(kind for kind, _ in SHELLS.values())
LINE_KINDS = frozenset(kind for kind, _ in LINES.values())
TURNING = SHELL_KINDS | LINE_KINDS

#: Formulations of our elements that types have, where not the usual ones.
FORMULATIONS = {
    "C3D8": "full",
    "C3D20R": "reduced",
    "C3D6": "reduced",
    **dict.fromkeys(("M3D3", "M3D4", "M3D4R"), MEMBRANE),
}
#: Types of Abaqus, and what they are taken as: mixed or modified elements whose displacements are
#: the same, shells with five dofs at a node or for small strains.
TAKEN_AS = {
    "C3D10M": "C3D10",
    "C3D10H": "C3D10",
    "C3D10HS": "C3D10",
    "C3D10MH": "C3D10",
    "C3D4H": "C3D4",
    "C3D20H": "C3D20",
    "C3D20RH": "C3D20R",
    "C3D15H": "C3D15",
    "C3D6H": "C3D6",
    "S4RS": "S4",
    "S4R5": "S4",
    "S3RS": "S3",
    "STRI3": "S3",
    "STRI65": "S6",
    "S8R5": "S8R",
}


@dataclass
class Deck:
    """What of a deck matters beside its matrices; labels as written."""

    labels: Ints
    points: Floats
    sets: dict[str, Ints] = field(default_factory=dict)
    blocks: list[tuple[str, Ints]] = field(default_factory=list)
    #: *RIGID BODY: name of its node set -> reference node and, if named, rotation node
    rigid: dict[str, tuple[int, int | None]] = field(default_factory=dict)
    transformed: bool = False  #: *TRANSFORM: matrices are in local axes
    #: solids, shells, beams and trusses by label: meshio type and node labels; and their sets
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    elsets: dict[str, list[int]] = field(default_factory=dict)
    types: dict[int, str] = field(default_factory=dict)  #: of these elements, as written
    remarks: list[str] = field(default_factory=list)
    repeated: set[str] = field(default_factory=set)  #: sets that name members more than once
    directed: list[int] = field(default_factory=list)  #: beams with a node for their direction 1

    def turning(self) -> set[int]:
        """Nodes with rotations: of shells and of beams, not of trusses."""
        return {
            node
            for label, (kind, nodes) in self.elements.items()
            if kind in TURNING and not self.types[label].startswith(("T3D", "M3D"))
            for node in nodes
        }

    def index(self, path: Path, label: int) -> int:
        """Of a node in ``points``.

        Raises
        ------
        BodyError
            If there is none, with the deck's ``path``.
        """
        at = int(np.searchsorted(self.labels, label))
        if at == len(self.labels) or self.labels[at] != label:
            raise BodyError(f"{path}: there is no node {label}")
        return at


def keyword_of(line: str) -> tuple[str, dict[str, str]]:
    """Keyword and options of a card, in capitals; values as written, without quotes."""
    parts = [part.strip() for part in line[1:].split(",")]
    options = {}
    for part in parts[1:]:
        key, _, value = part.partition("=")
        options[key.strip().upper()] = value.strip().strip('"')
    return " ".join(parts[0].upper().split()), options


def included(line: str, path: Path, folder: Path) -> Path:
    """The file that an ``*INCLUDE`` of ``path`` names: relative to the folder of the deck, as the
    codes take it, or to the file that includes.

    Raises
    ------
    BodyError
        If it is in neither.
    """
    name = keyword_of(line.strip())[1].get("INPUT", "")
    for place in (folder / name, path.parent / name):
        if place.is_file():
            return place
    raise BodyError(f"{path}: *INCLUDE {name or line.strip()!r}: no such file")


Line = tuple[Path, int, str]  #: file, number from 1, text


def raw_lines(path: Path, folder: Path | None = None, depth: int = 0) -> Iterator[Line]:
    """Lines of a deck as written, those of an ``*INCLUDE`` in its place.

    Raises
    ------
    BodyError
        If a file cannot be read, or is no text.
    """
    if depth > 20:
        raise BodyError(f"{path}: *INCLUDE goes round in circles")
    folder = folder or path.parent
    try:
        content = path.read_text(errors="replace")
    except OSError as error:
        raise BodyError(f"{path}: {error.strerror}") from None
    if "\0" in content[:4096]:
        raise BodyError(f"{path}: binary, expected an input deck")
    lines = iter(enumerate(content.splitlines(), start=1))
    for number, line in lines:
        if not re.match(r"\s*\*\s*INCLUDE\b", line, re.IGNORECASE):
            yield path, number, line
            continue
        while line.rstrip().endswith(",") and (more := next(lines, None)):
            line = line.rstrip() + more[1]
        yield from raw_lines(included(line, path, folder), folder, depth + 1)


def files_of(path: Path) -> list[Path]:
    """A deck and all that it includes: what an output must not replace."""
    try:
        return sorted({file for file, _, _ in raw_lines(path)})
    except BodyError:  # said where it is read
        return [path]


def _lines(source: Iterable[Line]) -> Iterator[Line]:
    """Lines that say something: no comments; keyword lines that end in a comma joined with the
    next."""
    begun: Line | None = None
    for file, number, raw in source:
        line = raw.strip()
        if line.startswith("**") or not line:
            continue
        if begun:
            file, number, line = begun[0], begun[1], begun[2] + line
        begun = (file, number, line) if line.startswith("*") and line.endswith(",") else None
        if not begun:
            yield file, number, line
    if begun:
        yield begun


#: Elements of a plane, which gmsh writes for the surfaces of solids.
PLANE = re.compile(r"(?:CPS|CPE|CAX)(\d)")
OF_PLANE = "plane"
#: Cards that make or move nodes in ways that are not supported here.
UNKNOWN_NODES = ("NGEN", "NFILL", "NCOPY", "SYSTEM", "NMAP")


class _Model:
    """What a deck says, card by card."""

    def __init__(self) -> None:
        self.points: dict[int, tuple[float, ...]] = {}
        self.sets: dict[str, list[int | str]] = {}
        self.elsets: dict[str, list[int | str]] = {}
        self.of_elements: dict[str, list[str]] = {}  # node set -> element sets it is made of
        self.connectivity: dict[int, tuple[str, list[int]]] = {}
        self.rigid: dict[str, tuple[int, int | None]] = {}
        self.transformed = False
        self.instances = 0
        self.types: dict[int, str] = {}
        self.planes: dict[int, tuple[str, list[int]]] = {}  # elements of a plane, of surfaces
        self.directed: list[int] = []  # beams with a further node, for their direction 1
        self.kind, self.count, self.pending = "", 0, list[int]()

    def card(self, keyword: str, options: dict[str, str]) -> None:
        if keyword in UNKNOWN_NODES or (
            keyword == "NODE" and ("SYSTEM" in options or "INPUT" in options)
        ):
            raise ValueError(
                "writes nodes in a way that is not read here; write them one by one, Cartesian"
            )
        if keyword == "INSTANCE":
            self.instances += 1
            if self.instances > 1:
                raise ValueError(
                    "is a second instance; write a flat input file (without parts and assemblies)"
                )
        self.transformed = self.transformed or keyword == "TRANSFORM"
        if keyword == "RIGID BODY" and options.get("REF NODE", "").isdigit():
            name = options.get("NSET", options.get("ELSET", f"RIGID{len(self.rigid) + 1}")).upper()
            turn = options.get("ROT NODE")
            self.rigid[name] = int(options["REF NODE"]), None if turn is None else int(turn)
        if keyword == "NSET" and "ELSET" in options:
            self.of_elements.setdefault(options.get("NSET", "").upper(), []).append(
                options["ELSET"].upper()
            )
        if keyword == "ELEMENT":
            name = options.get("TYPE", "").upper()
            self.kind, self.count = next(
                (of for start, of in (SOLIDS | SHELLS | LINES).items() if name.startswith(start)),
                ("", 0),
            )
            if of_plane := PLANE.match(name):
                self.kind, self.count = OF_PLANE, int(of_plane[1])
            self.pending = []

    def data(self, keyword: str, options: dict[str, str], words: list[str]) -> None:
        if keyword == "NODE":
            label = int(words[0])
            xyz = [float(re.sub("[dD]", "e", word)) if word else 0.0 for word in words[1:4]]
            place = (*xyz, *[0.0] * (3 - len(xyz)))
            if self.points.setdefault(label, place) != place:
                raise ValueError(
                    "gives a node that is there already another place; write a flat input file"
                )
            if "NSET" in options:
                self.sets.setdefault(options["NSET"].upper(), []).append(label)
        elif keyword == "INSTANCE" and any(float(word) for word in words if word):
            raise ValueError("moves the instance; write a flat input file, in its place")
        elif keyword == "ELEMENT" and self.count:
            self.pending += [int(word) for word in words]
            if len(self.pending) > self.count:
                nodes = self.pending[1 : self.count + 1]
                if self.kind in LINE_KINDS and len(self.pending) > self.count + 1:
                    self.directed.append(self.pending[0])
                if self.kind == "line3":  # whose second node is that in the middle
                    nodes = [nodes[0], nodes[2], nodes[1]]
                label, element = self.pending[0], (self.kind, nodes)
                of_plane = self.kind == OF_PLANE
                known, others = (
                    (self.planes, self.connectivity)
                    if of_plane
                    else (self.connectivity, self.planes)
                )
                if label in others or known.setdefault(label, element) != element:
                    raise ValueError(f"defines element {label} a second time")
                if not of_plane:
                    self.types[label] = options.get("TYPE", "").upper()
                if "ELSET" in options:
                    self.elsets.setdefault(options["ELSET"].upper(), []).append(self.pending[0])
                self.pending = []
        elif keyword in ("NSET", "ELSET"):
            into = self.sets if keyword == "NSET" else self.elsets
            target = into.setdefault(options[keyword].upper(), [])
            if "GENERATE" in options:
                first, last, *step = (int(word) for word in words)
                target += range(first, last + 1, step[0] if step else 1)
                return
            for word in words:
                plain = word.rpartition(".")[2] if self.instances else word  # INSTANCE.label
                target.append(int(plain) if plain.lstrip("-").isdigit() else word.upper())

    def resolved(self, sets: dict[str, list[int | str]], name: str, depth: int = 0) -> list[int]:
        """Members of a set, names of other sets followed."""
        if name not in sets or depth > 20:
            raise ValueError(name)
        result: list[int] = []
        for member in sets[name]:
            result += (
                [member] if isinstance(member, int) else self.resolved(sets, member, depth + 1)
            )
        return result


def read_deck(path: Path, lines: Iterable[Line] | None = None) -> Deck:
    """Read the model part of a deck (everything before the first step); ``lines``: what is read
    instead of the file."""
    model = _Model()
    keyword, options = "", dict[str, str]()
    for file, number, line in _lines(raw_lines(path) if lines is None else lines):
        try:
            if line.startswith("*"):
                keyword, options = keyword_of(line)
                if keyword == "STEP":
                    break
                model.card(keyword, options)
                continue
            words = [word.strip() for word in line.split(",")]
            if words and not words[-1]:
                words.pop()
            model.data(keyword, options, words)
        except (ValueError, KeyError) as error:
            reason = str(error)
            known = reason.startswith(("gives", "moves", "writes", "is a", "defines"))
            what = reason if known else f"does not belong under *{keyword}"
            raise BodyError(f"{file}, line {number}: {line[:60]!r} {what}") from None
    labels, points, connectivity = (
        list(model.points),
        list(model.points.values()),
        model.connectivity,
    )
    if not labels:
        raise BodyError(f"{path}: no *NODE: is this a deck?")
    blocks = []
    for name, _ in (SOLIDS | SHELLS).values():
        nodes = np.array([c for k, c in connectivity.values() if k == name], dtype=np.int64)
        if len(nodes):
            blocks.append((name, nodes))  # VTK's order is the deck's
    sets: dict[str, Ints] = {}
    left: list[str] = []
    repeated: set[str] = set()
    for name in model.sets:
        try:
            every = np.array(model.resolved(model.sets, name), dtype=np.int64)
            sets[name] = np.unique(every)
            if len(sets[name]) < len(every):
                repeated.add(name)
        except ValueError as missing:
            left.append(f"node set {name} names {missing}, which is not there")
    elsets: dict[str, list[int]] = {}
    for name in model.elsets:
        with contextlib.suppress(ValueError):
            members = model.resolved(model.elsets, name)
            elsets[name] = [e for e in dict.fromkeys(members) if e in connectivity]
            if len(set(members)) < len(members):
                repeated.add(name)
    for name, parts in {**{n: [n] for n in model.elsets}, **model.of_elements}.items():
        try:
            members = [e for part in parts for e in model.resolved(model.elsets, part)]
        except ValueError:
            continue
        found = {n for e in members if e in connectivity for n in connectivity[e][1]}
        found |= {n for e in members if e in model.planes for n in model.planes[e][1]}
        if found and name not in sets:
            sets[name] = np.array(sorted(found), dtype=np.int64)
    order = np.argsort(labels)
    return Deck(
        np.array(labels, dtype=np.int64)[order],
        np.array(points)[order],
        sets,
        blocks,
        model.rigid,
        model.transformed,
        connectivity,
        elsets,
        model.types,
        left,
        repeated,
        model.directed,
    )
