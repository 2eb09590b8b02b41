"""Running CalculiX: which step of a deck gives K and M, and what of the deck they do not hold.

``prepare`` keeps the model and, where the deck has a ``*FREQUENCY`` step, that step with all before
it, as ccx itself would run them (a preload of a ``*STEP, PERTURBATION`` is part of the linear
model); the step then stores its matrices instead of finding modes. Checked with ccx 2.20.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from flexgram.basics import BodyError
from flexgram.importers.deck import Line, keyword_of, raw_lines

STORAGE = "*FREQUENCY, SOLVER=MATRIXSTORAGE"

#: Cards of a step that are forces or histories: no part of a linear body.
LOADS = (
    "CLOAD",
    "DLOAD",
    "DSLOAD",
    "TEMPERATURE",
    "CFLUX",
    "DFLUX",
    "FILM",
    "RADIATE",
    "BASE MOTION",
    "GREEN",
)
#: Procedures that are named where they are left out.
FURTHER = (
    "FREQUENCY",
    "MODAL DYNAMIC",
    "STEADY STATE DYNAMICS",
    "COMPLEX FREQUENCY",
    "BUCKLE",
    "STATIC",
    "DYNAMIC",
)
#: What K and M of the model do not mean, whatever the step.
FOREIGN = {
    "CYCLIC SYMMETRY MODEL": "the deck is one sector of a cyclic body, which is no body by itself: "
    "model all of it",
    "SUBMODEL": "a submodel hangs on results of another run",
    "RESTART": "the deck starts from another run (*RESTART)",
}
#: Procedures of heat that have a mechanical half.
HEATED = ("COUPLED TEMPERATURE-DISPLACEMENT", "UNCOUPLED TEMPERATURE-DISPLACEMENT")
#: Procedures without masses and stiffnesses of a body.
NOT_MECHANICAL = ("HEAT TRANSFER", "ELECTROMAGNETICS", "CFD", "CRACK PROPAGATION")


@dataclass
class Card:
    """A keyword with its options and data lines, as written."""

    keyword: str
    options: dict[str, str]
    lines: list[str]  #: the keyword line (or lines) first

    first: int = 1  #: how many lines that is: the data come after it
    at: tuple[Path, int] | None = None  #: file and line

    @property
    def place(self) -> str:
        """For messages."""
        where = f"{self.at[0]}, line {self.at[1]}: " if self.at else ""
        return f"{where}*{self.keyword}"

    def words(self) -> Iterator[list[str]]:
        """The data lines, split."""
        for line in self.lines[self.first :]:
            if line.strip() and not line.lstrip().startswith("**"):
                yield [word.strip() for word in line.split(",")]


@dataclass
class Job:
    """A deck in cards: those of the model, and those of each step."""

    path: Path
    model: list[Card] = field(default_factory=list)
    steps: list[list[Card]] = field(default_factory=list)

    def step_of(self, number: int) -> list[Card]:
        return self.steps[number - 1]


def read_job(path: Path, lines: Iterable[Line] | None = None) -> Job:
    """The deck in cards; ``lines``: what is read instead of the file.

    Raises
    ------
    BodyError
        If it, or what it includes, cannot be read.
    """
    job = Job(path)
    cards, step = job.model, False
    open_keyword = False
    for file, number, line in raw_lines(path) if lines is None else lines:
        comment = line.lstrip().startswith("**")
        if open_keyword and not comment:
            card = cards[-1]
            card.lines.append(line)
            card.first = len(card.lines)
            head = "".join(part.strip() for part in card.lines if not part.startswith("**"))
            card.keyword, card.options = keyword_of(head)
            open_keyword = line.rstrip().endswith(",")
            continue
        if line.lstrip().startswith("*") and not comment:
            keyword, options = keyword_of(line.strip())
            open_keyword = line.rstrip().endswith(",")
            if keyword == "STEP":
                job.steps.append([])
                cards, step = job.steps[-1], True
            cards.append(Card(keyword, options, [line], at=(file, number)))
            if keyword == "END STEP" and step:
                cards, step = job.model, False
        elif cards:
            cards[-1].lines.append(line)
    return job


def frequency_step(job: Job, asked: int | None = None) -> int | None:
    """The step, from 1, that K and M are to be of: the last *FREQUENCY step with PERTURBATION, else
    the first one; None without such a step.

    Raises
    ------
    BodyError
        If the step asked for is none.
    """
    found = [
        number
        for number, cards in enumerate(job.steps, 1)
        if any(card.keyword == "FREQUENCY" for card in cards)
    ]
    if asked is not None:
        if asked not in found:
            there = (
                f"its *FREQUENCY steps are {', '.join(map(str, found))}"
                if found
                else "it has no *FREQUENCY step"
            )
            raise BodyError(f"{job.path}: step {asked} gives no matrices: {there}")
        return asked
    loaded = [n for n in found if "PERTURBATION" in job.step_of(n)[0].options]
    return loaded[-1] if loaded else found[0] if found else None


def _text(cards: list[Card]) -> str:
    return "".join(f"{line}\n" for card in cards for line in card.lines)


def _stored(step: list[Card]) -> list[Card]:
    """The step with its matrices stored instead of its modes found."""
    kept = [card for card in step if card.keyword not in ("SELECT CYCLIC SYMMETRY MODES",)]
    return [
        Card("FREQUENCY", {}, [STORAGE]) if card.keyword == "FREQUENCY" else card for card in kept
    ]


def _and(words: list[str]) -> str:
    return ", ".join(f"*{word}" for word in dict.fromkeys(words))


def prepare(job: Job, asked: int | None = None) -> tuple[str, list[str]]:
    """The deck that stores the matrices, and what of the user's deck these do not hold.

    Returns
    -------
    text : str
    remarks : list of str

    Raises
    ------
    BodyError
        For a deck whose matrices are not those of a body.
    """
    for card in job.model:
        if card.keyword in FOREIGN and not (
            card.keyword == "RESTART" and "READ" not in card.options
        ):
            raise BodyError(f"{job.path}: {FOREIGN[card.keyword]}")
    words = [card.keyword for step in job.steps for card in step]
    heat = [word for word in words if word in NOT_MECHANICAL]
    if heat and not any(word in (*FURTHER, "VISCO", *HEATED) for word in words):
        raise BodyError(f"{job.path}: *{heat[0]}: no masses and stiffnesses of a mechanical body")
    number = frequency_step(job, asked)
    remarks: list[str] = []
    if number is None:
        first = job.steps[0] if job.steps else []
        held = [card for card in first if card.keyword == "BOUNDARY"]
        text = _text(job.model) + "*STEP\n" + STORAGE + "\n" + _text(held) + "*END STEP\n"
        if job.steps:
            what = [
                card.keyword
                for step in job.steps
                for card in step
                if card.keyword
                in (
                    *LOADS,
                    "STATIC",
                    "VISCO",
                    "BUCKLE",
                    "DYNAMIC",
                    "MODAL DYNAMIC",
                    "STEADY STATE DYNAMICS",
                    *HEATED,
                )
            ]
            left = f"; left out: {_and(what)}" if what else ""
            remarks.append(
                "the deck has no *FREQUENCY step: K and M of the unloaded body with the "
                f"supports of step 1{left}"
            )
    else:
        step = job.step_of(number)
        kept = [card for earlier in job.steps[: number - 1] for card in earlier]
        text = _text(job.model) + _text(kept) + _text(_stored(step))
        preloaded = "PERTURBATION" in step[0].options
        if preloaded:
            by = [c.keyword for c in kept if c.keyword in (*LOADS, "STATIC", "BOUNDARY", "VISCO")]
            remarks.append(
                f"K and M of step {number}, *STEP, PERTURBATION: preloaded by the steps "
                f"before it ({_and(by)})"
            )
        elif number > 1:
            remarks.append(
                f"K and M of step {number}, without preload: what steps 1 to "
                f"{number - 1} load is left out (no PERTURBATION)"
            )
        others = [n for n in range(1, len(job.steps) + 1) if n > number]
        further = [c.keyword for n in others for c in job.step_of(n) if c.keyword in FURTHER]
        more = [
            n
            for n in range(1, len(job.steps) + 1)
            if n != number and any(c.keyword == "FREQUENCY" for c in job.step_of(n))
        ]
        if more:
            remarks.append(
                f"step {number} is taken; --step {more[0]} takes another *FREQUENCY step"
            )
        elif further:
            remarks.append(f"steps after it are left out: {_and(further)}")
        if "COMPLEX FREQUENCY" in words:
            remarks.append("gyroscopic terms (*COMPLEX FREQUENCY) are left out")
    return text, remarks


def without_supports(job: Job) -> str:
    """The text of a deck whose matrices are those of the free body."""
    free = [card for card in job.model if card.keyword != "BOUNDARY"]
    return _text(free) + "*STEP\n" + STORAGE + "\n*END STEP\n"


def run_ccx(
    deck: Path, folder: Path, step: int | None = None, *, free: bool = False
) -> tuple[Path, list[str]]:
    """Run ccx on a deck so that it stores its matrices.

    Parameters
    ----------
    deck, folder : Path
        The deck, and where to run.
    step : int, optional
        Which *FREQUENCY step, from 1; default: ``frequency_step``.
    free : bool
        Of the unloaded body without its supports.

    Returns
    -------
    path : Path
        The deck that ran, in ``folder``, with its results beside it.
    remarks : list of str
        What of the user's deck the matrices do not hold.
    """
    program = shutil.which("ccx")
    if program is None:
        raise BodyError(
            "ccx is not installed (apt install calculix-ccx; Debian 13 has none). --assemble reads "
            "a deck without it"
        )
    if not deck.exists():
        raise BodyError(f"{deck}: no such file")
    job_of_user = read_job(deck)
    text, remarks = (without_supports(job_of_user), []) if free else prepare(job_of_user, step)
    folder.mkdir(parents=True, exist_ok=True)
    job = folder / deck.name
    job.write_text(text)
    for suffix in (".sti", ".mas", ".dof"):  # never take an old result for a new one
        job.with_suffix(suffix).unlink(missing_ok=True)
    done = subprocess.run(
        [program, job.stem], cwd=folder, capture_output=True, text=True, errors="replace"
    )
    missing = [s for s in (".sti", ".mas", ".dof") if not job.with_suffix(s).exists()]
    said = done.stdout.splitlines()
    errors = [i for i, line in enumerate(said) if "*ERROR" in line]
    if done.returncode or missing or errors:
        first = errors[0] if errors else max(len(said) - 3, 0)  # an error goes on for some lines
        part = [line.strip() for line in said[first : first + 8]]
        lines = takewhile(bool, part) if errors else filter(bool, part)
        reason = re.sub(r"\s+", " ", " ".join(lines))
        if "plane stress" in reason:
            reason += (
                ". gmsh writes such elements for surfaces of solids: --assemble leaves them out"
            )
        raise BodyError(f"ccx on {deck} failed (exit status {done.returncode}): {reason}")
    return job, remarks


@dataclass
class Damping:
    """What a deck says of damping: none of it is in the matrices that ccx stores."""

    alpha: float = 0.0  #: [1/time]
    beta: float = 0.0  #: [time]
    eta: float = 0.0
    #: of the materials, where these differ
    loss_factors: dict[str, float] = field(default_factory=dict)
    dashpots: list[tuple[int, int, float]] = field(default_factory=list)  #: nodes, force/speed
    #: what *BOUNDARY holds, if there are dashpots: node or set, first and last direction from 1
    held: list[tuple[str, int, int]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def _number(words: list[str], at: int) -> float:
    return float(words[at]) if at < len(words) and words[at] else 0.0


def _materials_of_sections(job: Job) -> set[str]:
    """Names of the materials that sections name, others are of no element; without sections all."""
    found: set[str] = set()
    for card in job.model:
        if card.keyword.endswith("SECTION"):
            found.add(card.options.get("MATERIAL", "").upper())
            if "COMPOSITE" in card.options:
                found |= {words[2].upper() for words in card.words() if len(words) > 2}
    if not any(card.keyword.endswith("SECTION") for card in job.model):
        found = {c.options.get("NAME", "").upper() for c in job.model if c.keyword == "MATERIAL"}
    return found


def _damping_by_material(
    job: Job, used: Container[str], remarks: list[str]
) -> dict[str, tuple[float, float, float]]:
    """ALPHA, BETA and STRUCTURAL of each material in use, zero where it has no ``*DAMPING``."""
    found: dict[str, tuple[float, float, float]] = {}
    name = ""
    for card in job.model:
        if card.keyword == "MATERIAL":
            name = card.options.get("NAME", "").upper()
            if name in used:
                found[name] = (0.0, 0.0, 0.0)
        elif card.keyword == "DAMPING" and name in found:
            keys = ("ALPHA", "BETA", "STRUCTURAL")
            alpha, beta, eta = (float(card.options.get(key) or 0) for key in keys)
            one, two, three = found[name]
            found[name] = one + alpha, two + beta, three + eta
            if other := [key for key in card.options if key not in keys]:
                remarks.append(f"*DAMPING, {', '.join(other)} of {name} is left out")
    return found


def _rayleigh(job: Job, used: Container[str], damping: Damping) -> None:
    """Of ``*MODAL DAMPING, RAYLEIGH``, else of the materials, if all that are damped agree."""
    every = [card for step in [job.model, *job.steps] for card in step]
    modal = [card for card in every if card.keyword == "MODAL DAMPING"]
    found: set[tuple[float, float, float]] = set()
    for card in modal:
        if "RAYLEIGH" not in card.options:
            damping.remarks.append(
                "*MODAL DAMPING by ratios is left out: give --alpha, --beta or --eta"
            )
            continue
        found |= {(_number(words, 2), _number(words, 3), 0.0) for words in card.words()}
    of_materials = _damping_by_material(job, used, damping.remarks)
    if not found and any(map(any, of_materials.values())):
        rayleigh = {(alpha, beta) for alpha, beta, _ in of_materials.values()}
        losses = {eta for *_, eta in of_materials.values()}
        if len(losses) > 1:
            damping.loss_factors = {name: eta for name, (*_, eta) in of_materials.items()}
        alpha, beta = rayleigh.pop() if len(rayleigh) == 1 else (0.0, 0.0)
        if rayleigh:
            damping.remarks.append(
                "*DAMPING, ALPHA and BETA of the materials differ: they are left out (--alpha, "
                "--beta)"
            )
        everywhere = alpha, beta, losses.pop() if len(losses) == 1 else 0.0
        found = {everywhere} if any(everywhere) else set()
    if len(found) > 1:
        damping.remarks.append(
            "steps damp differently: *MODAL DAMPING is left out (--alpha, --beta)"
        )
    elif found:
        damping.alpha, damping.beta, damping.eta = next(iter(found))
        words = {"alpha": damping.alpha, "beta": damping.beta, "eta": damping.eta}
        said = ", ".join(f"{name} {value:g}" for name, value in words.items() if value)
        source = "*MODAL DAMPING" if modal else "*DAMPING"
        damping.remarks.append(f"damping of the deck ({source}): {said or 'none'}")


def damping_of(job: Job, used: Container[str] | None = None) -> Damping:
    """Rayleigh and structural damping of a deck, and its dashpots.

    Parameters
    ----------
    job : Job
    used : container of str, optional
        The materials of elements: the damping of others does not count. Default: those of sections.

    Raises
    ------
    BodyError
        For cards that are no numbers.
    """
    damping = Damping()
    try:
        _rayleigh(job, _materials_of_sections(job) if used is None else used, damping)
        constants: dict[str, float | None] = {}
        for card in job.model:
            if card.keyword == "DASHPOT":
                rows = [[float(word) for word in words if word] for words in card.words()]
                values = {row[0] for row in rows if row}
                constants[card.options.get("ELSET", "").upper()] = (
                    values.pop() if len(values) == 1 else None
                )
        for card in job.model:
            if card.keyword != "ELEMENT" or card.options.get("TYPE", "").upper() != "DASHPOTA":
                continue
            constant = constants.get(card.options.get("ELSET", "").upper())
            if constant is None:
                damping.remarks.append("dashpots without one constant are left out")
                continue
            labels = [int(word) for words in card.words() for word in words if word]
            damping.dashpots += [
                (labels[i + 1], labels[i + 2], constant) for i in range(0, len(labels) - 2, 3)
            ]
        if damping.dashpots:
            damping.held = [
                (words[0].upper(), int(words[1]), int(_number(words, 2) or words[1]))
                for step in [job.model, *job.steps]
                for card in step
                if card.keyword == "BOUNDARY"
                for words in card.words()
                if len(words) > 1
            ]
    except ValueError as error:
        raise BodyError(f"{job.path}: damping cards: {error}") from None
    return damping
