"""Abaqus decks of parts and instances, written flat: one model, whose nodes, elements and sets are
those of all instances.

The first instance keeps its numbers; those of the next are higher by a power of ten. A set of an
instance is INSTANCE.SET; where one instance alone has a set of that name, it is SET too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.spatial.transform

from flexgram.basics import BodyError, Floats
from flexgram.importers.deck import Line, keyword_of, raw_lines

#: Options whose values name sets, surfaces or axes of a part.
NAMES = ("NSET", "ELSET", "NAME", "SURFACE", "ORIENTATION", "SHELL THICKNESS")
INSTANCE = re.compile(r"\s*\*\s*INSTANCE\b", re.IGNORECASE)
#: Cards of which NAME is nothing of the part.
GLOBAL = ("MATERIAL", "AMPLITUDE")
#: Cards of a part with rows of nodes, which are not supported; and with directions, not turned.
ROWS = ("EQUATION", "MPC", "TIE")
TURNED = ("BEAM SECTION", "BEAM GENERAL SECTION", "TRANSFORM", "SPRING", "ROTARY INERTIA")
#: Cards whose first column names nodes, elements or sets.
FIRST = (
    *("NODE", "SURFACE", "BOUNDARY", "CLOAD", "DLOAD", "TEMPERATURE", "INITIAL CONDITIONS"),
    "DISTRIBUTION",
)


@dataclass
class Card:
    """A keyword with its rows, and where it stands."""

    at: tuple[Path, int]
    keyword: str
    options: dict[str, str]
    rows: list[list[str]] = field(default_factory=list)

    def written(self) -> Iterator[Line]:
        options = "".join(f", {k}={v}" if v else f", {k}" for k, v in self.options.items())
        yield (*self.at, f"*{self.keyword}{options}")
        for row in self.rows:
            yield (*self.at, ", ".join(row))

    def wrong(self, why: str) -> BodyError:
        return BodyError(f"{self.at[0]}, line {self.at[1]}: *{self.keyword} {why}")


@dataclass
class Instance:
    """A part in its place: its cards, and what is added to its labels."""

    name: str
    cards: list[Card]
    shift: Floats
    turn: Floats  #: (3, 3)
    more: int = 0

    @property
    def turns(self) -> bool:
        return bool(np.abs(self.turn - np.eye(3)).max() > 1e-14)


def _cards(path: Path) -> list[Card]:
    cards: list[Card] = []
    open_line = ""
    for file, number, raw in raw_lines(path):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if open_line or line.startswith("*"):
            begun = open_line + line
            if not open_line:
                cards.append(Card((file, number), *keyword_of(line)))
            cards[-1].keyword, cards[-1].options = keyword_of(begun)
            open_line = begun if line.endswith(",") else ""
        elif cards:
            words = [word.strip().replace('"', "") for word in line.split(",")]
            cards[-1].rows.append(words)
    return cards


def _placed(card: Card) -> tuple[Floats, Floats]:
    """Translation and rotation of an *INSTANCE: x becomes R (x + t - a) + a."""
    try:
        rows = [np.array([float(word) for word in row if word]) for row in card.rows[:2]]
        shift = rows[0] if rows else np.zeros(3)
        if len(rows) < 2:
            return shift + np.zeros(3), np.eye(3)
        a, b, angle = rows[1][:3], rows[1][3:6], float(rows[1][6])
        length = float(np.linalg.norm(b - a))
        if not length > 0:
            raise card.wrong("turns about an axis without a length")
        axis = (b - a) / length
    except (ValueError, IndexError):
        raise card.wrong("needs three numbers, and seven of a rotation") from None
    rotation = scipy.spatial.transform.Rotation.from_rotvec(np.radians(angle) * axis)
    turn: Floats = rotation.as_matrix()
    return turn @ (shift - a) + a, turn


def _divided(cards: Sequence[Card]) -> tuple[list[Instance], list[Card], list[Card]]:
    """Instances, cards of the assembly, and the others."""
    parts: dict[str, list[Card]] = {}
    instances: list[Instance] = []
    assembly: list[Card] = []
    rest: list[Card] = []
    into = rest
    for card in cards:
        if card.keyword == "PART":
            into = parts.setdefault(card.options.get("NAME", "").upper(), [])
        elif card.keyword == "ASSEMBLY":
            into = assembly
        elif card.keyword == "INSTANCE":
            part = card.options.get("PART", "").upper()
            if part and part not in parts:
                raise card.wrong(f"is of part {part}, which is not there")
            into = list(parts.get(part, []))
            name = card.options.get("NAME", "").upper()
            instances.append(Instance(name, into, *_placed(card)))
        elif card.keyword in ("END PART", "END ASSEMBLY"):
            into = rest
        elif card.keyword == "END INSTANCE":
            into = assembly
        else:
            into.append(card)
    return instances, assembly, rest


def _labels(cards: Sequence[Card]) -> list[int]:
    rows = (row for c in cards if c.keyword in ("NODE", "ELEMENT") for row in c.rows)
    return [int(row[0]) for row in rows if row and row[0].isdigit()]


def _renamed(card: Card, of: Callable[[str], str]) -> list[list[str]]:
    """Rows of a card with other labels and names of sets."""
    if card.keyword == "ELEMENT":
        return [[of(word) for word in row] for row in card.rows]
    if card.keyword in ("NSET", "ELSET"):
        if "GENERATE" in card.options:  # first, last and step
            return [[*map(of, row[:2]), *row[2:]] for row in card.rows]
        return [[of(word) for word in row] for row in card.rows]
    if card.keyword == "ORIENTATION" and card.rows and not _has_numbers(card):
        return [[of(card.rows[0][0])], *card.rows[1:]]  # of a distribution
    if card.keyword in FIRST:
        return [[of(row[0]), *row[1:]] for row in card.rows]
    return card.rows


def _has_numbers(card: Card) -> bool:
    """Whether an orientation gives its points, no name."""
    return any(word for row in card.rows[:1] for word in row[1:])


def _has_directions(card: Card) -> bool:
    """Whether a distribution gives axes, which turn with their part."""
    return any(len([word for word in row[1:] if word]) >= 6 for row in card.rows)


def _own(instance: Instance, card: Card) -> Card:
    """A card of a part, of an instance."""

    def of(word: str) -> str:
        if word.lstrip("-").isdigit():
            return str(int(word) + instance.more)
        return f"{instance.name}.{word.upper()}" if word else word

    moved = instance.turns or bool(np.any(instance.shift))
    by_places = card.keyword in ("TRANSFORM", "ORIENTATION") and "C" in (
        card.options.get("TYPE", "").upper()[:1],
        card.options.get("SYSTEM", "").upper()[:1],
    )
    if (
        card.keyword in ROWS
        or (instance.turns and card.keyword in TURNED)
        or (moved and by_places)
        or card.options.get("DEFINITION", "COORDINATES").upper() != "COORDINATES"
        or (instance.turns and card.keyword == "DISTRIBUTION" and _has_directions(card))
    ):
        raise card.wrong(f"in instance {instance.name} is not supported; write a flat deck")
    options = dict(card.options)
    for key in NAMES:
        if options.get(key) and not (key == "NAME" and card.keyword in GLOBAL):
            options[key] = of(options[key])
    if "REF NODE" in options:
        options["REF NODE"] = of(options["REF NODE"])
    rows = _renamed(card, of)
    if card.keyword == "NODE":
        rows = []
        for row in card.rows:
            try:
                x = [float(w.replace("d", "e").replace("D", "e")) if w else 0.0 for w in row[1:4]]
            except ValueError:
                raise card.wrong(f"{', '.join(row)!r}: expected a label and a place") from None
            place = instance.turn @ np.array([*x, 0.0, 0.0, 0.0][:3]) + instance.shift
            rows.append([of(row[0]), *(repr(float(c)) for c in place)])
    elif card.keyword == "ORIENTATION" and instance.turns and _has_numbers(card):
        try:
            numbers = np.array([float(word) for word in rows[0] if word])
            turned = (numbers.reshape(-1, 3) @ instance.turn.T).ravel()
        except (ValueError, IndexError):
            raise card.wrong("needs six numbers") from None
        rows = [[repr(float(x)) for x in turned], *rows[1:]]
    return Card(card.at, card.keyword, options, rows)


def _common(instances: dict[str, Instance], more: int, card: Card) -> Card:
    """A card of the assembly, or of the model: INSTANCE.LABEL becomes a label."""
    options = dict(card.options)
    home = options.pop("INSTANCE", "").upper()
    if home and home not in instances:
        raise card.wrong(f"names instance {home}, which is not there")

    def of(word: str) -> str:
        instance, _, own = word.upper().rpartition(".")
        if instance in instances:
            known = instances[instance]
            return str(int(own) + known.more) if own.isdigit() else f"{instance}.{own}"
        if word.isdigit():
            return str(int(word) + (instances[home].more if home else more))
        return f"{home}.{word.upper()}" if home and word else word

    if "REF NODE" in options:
        options["REF NODE"] = of(options["REF NODE"])
    rows = _renamed(card, of)
    if card.keyword in ("EQUATION", "MPC"):
        if more:
            raise card.wrong("beside nodes of the assembly of equal numbers is not supported")
        rows = [[of(word) if "." in word else word for word in row] for row in rows]
    return Card(card.at, card.keyword, options, rows)


def flat(path: Path) -> list[Line] | None:
    """The lines of a deck without parts and instances; None of one that has none.

    Raises
    ------
    BodyError
        For parts and instances that are not there, and what of a part is not supported.
    """
    if not any(INSTANCE.match(line) for _, _, line in raw_lines(path)):
        return None
    cards = _cards(path)
    instances, assembly, rest = _divided(cards)
    named = {instance.name: instance for instance in instances}
    if len(named) < len(instances):
        raise BodyError(f"{path}: two instances have one name")
    every = [rest, assembly, *(instance.cards for instance in instances)]
    most = max((label for some in every for label in _labels(some)), default=0)
    step = 10 ** len(str(most))
    for k, instance in enumerate(instances):
        instance.more = k * step
    taken = set(_labels(rest)) | set(_labels(instances[0].cards))
    more = len(instances) * step if taken & set(_labels(assembly)) else 0
    written: list[Card] = []
    count: dict[tuple[str, str], list[str]] = {}  # names of sets, by those of their instances
    for instance in instances:
        for card in instance.cards:
            own = _own(instance, card)
            written.append(own)
            for key in ("NSET", "ELSET"):
                name = card.options.get(key, "").upper()
                if name and card.keyword in ("NODE", "ELEMENT", key):
                    owners = count.setdefault((key, name), [])
                    owners += [] if instance.name in owners else [instance.name]
    common = [_common(named, more, card) for card in assembly]
    others = {
        (key, card.options[key].upper())
        for card in common
        for key in ("NSET", "ELSET")
        if key in card.options
    }
    for (key, name), owners in count.items():
        if len(owners) == 1 and (key, name) not in others:
            written.append(Card((path, 0), key, {key: name}, [[f"{owners[0]}.{name}"]]))
    model = [_common(named, 0, card) for card in rest]
    return [line for card in (*written, *common, *model) for line in card.written()]
