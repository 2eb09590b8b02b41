"""Loads over time: reading them, and what a reduced body's claim over its band says of them."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError, ComplexArray, Floats, Ints
from flexgram.model.claim import Claim
from flexgram.model.elastic_part import without_rigid_modes
from flexgram.model.kinds import INPUT_KINDS, ports_of
from flexgram.model.reduced import ReducedBody
from flexgram.simulation.time_files import rows_of, table_of

#: Even steps that corners of a history are divided into: for the band, and for steps of its own.
FINE, MOST = 2**16, 2**20
#: Moments of a period of the highest frequency of the band.
PER_PERIOD = 5
#: Share of a load's energy that the band is to hold.
ENOUGH = 0.999


def read_history(path: str | Path, inputs: list[str]) -> tuple[Floats, Floats]:
    """Times and loads of a CSV file: its first line is ``t`` and names of inputs, each other one a
    time [s] and the loads [N, N m] then. Inputs that are not named carry nothing.

    Returns
    -------
    t : (n,) array
    u : (n, n_in) array

    Raises
    ------
    BodyError
        For an unknown input, what is no number, or times that do not rise; with the line.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> t, u = read_history("loads.csv", rom.inputs)
    >>> u.shape == (len(t), len(rom.inputs))
    True
    """
    path = Path(path)
    rows = rows_of(path)
    if len(rows) < 3:
        raise BodyError(f"{path}: expected a line 't,port,...' and a line for each time")
    line, head = rows[0]
    if head[0][:1].isdigit():
        raise BodyError(f"{path}, line {line}: the first line names the columns, t,port,…")
    for name in head[1:]:
        if name not in inputs:
            raise BodyError(
                f"{path}, line {line}: the body has no input {name!r}; there are "
                f"{', '.join(inputs)}"
            )
    if head[0] not in ("t", "time") or len(head) < 2 or len(set(head)) < len(head):
        raise BodyError(f"{path}, line {line}: expected t and names of inputs, each once")
    table = table_of(path, rows[1:], len(head))
    t = table[:, 0]
    u = np.zeros((len(t), len(inputs)))
    u[:, [inputs.index(name) for name in head[1:]]] = table[:, 1:]
    return t, u


def evenly(t: Floats, u: Floats, wanted: float = np.inf) -> tuple[Floats, Floats]:
    """The loads at evenly spaced times, linear between those that are there.

    Times that are even but for printed digits are samples and stay. Others are corners. Their step
    is at most the smallest one and at most ``wanted`` [s], and meets all corners if one up to half
    as large does.

    Examples
    --------
    >>> t, u = evenly(np.array([0.0, 1.0, 3.0]), np.array([[0.0], [1.0], [0.0]]))
    >>> t
    array([0., 1., 2., 3.])
    >>> u[:, 0]
    array([0. , 1. , 0.5, 0. ])
    >>> len(evenly(t[[0, 1, 3]], u[[0, 1, 3]], 0.4)[0])
    10
    """
    steps = np.diff(t)
    count = len(t) - 1
    if np.ptp(steps) > 1e-3 * steps.min():
        step = min(float(steps.min()), max(wanted, float(np.ptp(t)) / FINE))
        count = _steps_to_corners(t, int(min(np.ceil(np.ptp(t) / step - 1e-6), MOST)))
    return refined(t, u, np.linspace(t[0], t[-1], count + 1))


def refined(t: Floats, u: Floats, at: Floats) -> tuple[Floats, Floats]:
    """The loads at other times, linear between theirs.

    Examples
    --------
    >>> t, u = refined(np.array([0.0, 2.0]), np.array([[0.0], [4.0]]), np.linspace(0, 2, 3))
    >>> u[:, 0]
    array([0., 2., 4.])
    """
    return at, np.column_stack([np.interp(at, t, column) for column in u.T])


def _steps_to_corners(t: Floats, least: int) -> int:
    """``least`` even steps, or up to twice as many where these meet all times."""
    if len(t) > 1000 or least > FINE:
        return least
    places = (t - t[0]) / np.ptp(t)
    for first in range(least, 2 * least + 1, 256):
        counts = np.arange(first, min(first + 256, 2 * least + 1))
        steps = counts[:, None] * places
        meets = np.abs(steps - np.round(steps)).max(axis=1) < 1e-3
        if meets.any():
            return int(counts[np.argmax(meets)])
    return least


@dataclass
class HistoryAssessment:
    """What the claim of a reduced body says of its response to a load history.

    The history counts as one period: with zeros behind it, it is a single event.
    """

    hz: Floats  #: (k,) lines of the spectrum
    spectrum: Floats  #: (k, n_in) amplitudes of the loads there
    below: float  #: share of the energy below the band, of the input that has most there
    above: float  #: the same above the band
    worst_port: str  #: the input with most energy outside the band
    needed: float  #: [Hz] below which every input has 99.9 % of its energy
    #: of the motion in the band, root mean square, relative: at most so much; of each kind of
    #: output if the claim is of each kind
    errors: dict[str, float]
    elastic_errors: dict[str, float] | None  #: of the elastic motion of a free body; of others None
    astray: float  #: share of the energy that is none of the loads that the body was reduced for
    proved: bool  #: the errors are bounds, not estimates
    band_end: float = 0.0  #: [Hz] where the claim ends
    beside: tuple[str, ...] = ()  #: kinds of these loads without a claim of their own
    step: float = 0.0  #: [s] between the times
    statics: bool = False  #: the body's basis has the static response to every port

    @property
    def error(self) -> float:
        """The largest of ``errors``."""
        return max(self.errors.values(), default=np.inf)

    @property
    def elastic_error(self) -> float | None:
        """The largest of ``elastic_errors``."""
        if self.elastic_errors is None:
            return None
        return max(self.elastic_errors.values(), default=np.inf)

    @property
    def words(self) -> list[str]:
        """Sentences."""
        if not self.errors:
            return [
                *self.words_of_outside,
                "no part of these loads lies in the band: nothing is claimed of the response",
            ]
        small = [what for what, e in self.errors.items() if not e < 1 and len(self.errors) > 1]
        each = ", ".join(
            f"{what} at most {_percent(e)}" for what, e in self.errors.items() if what not in small
        )
        said = list(self.words_of_outside)
        if each:
            said.append(
                f"error of the response to these loads in the band, root mean square: {each}"
                + ("" if self.proved else " (estimated, not proved)")
            )
        if small:
            said.append(
                f"these loads hardly make any {' or '.join(small)}: nothing is claimed of it "
                "relative to itself"
            )
        if self.astray > 1 - ENOUGH:
            said.append(
                f"{100 * self.astray:.2g} % of the loads is no combination of those that "
                "the body was reduced for, and nothing is claimed of it"
            )
        if self.elastic_error is not None:
            said.append(
                "error of the elastic part of this response: at most "
                f"{_percent(self.elastic_error)} of that part"
                + (
                    ". Rigid motion is most of the response: --tol-relative-to both bounds the "
                    "error of the elastic motion too"
                    if self.elastic_error > 0.02
                    else ""
                )
            )
        if self.beside:
            said.append(
                f"the error of {', '.join(self.beside)} has no bound of its own: that from H as a "
                "whole may be far larger than the error"
            )
        return said

    @property
    def words_of_outside(self) -> list[str]:
        """Sentences on loads outside the band."""
        said = []
        if self.above > 1 - ENOUGH:
            said.append(
                f"{100 * self.above:.3g} % of the energy of the load at {self.worst_port}, "
                f"{100 * self.above**0.5:.2g} % of its size, lies above the band, where nothing is "
                f"claimed: {100 * ENOUGH:g} % of the energy of every load lies below "
                f"{self.needed:.4g} Hz, let the band reach beyond that"
            )
        if self.below > 1 - ENOUGH:
            said.append(
                f"{100 * self.below:.3g} % of the energy of the loads lies below the band, "
                "constant or slow: "
                + (
                    "the static responses in the basis answer it, without a claim"
                    if self.statics
                    else "let the band begin lower (at 0 for a body that is held; a free one takes "
                    "--statics yes)"
                )
            )
        if len(self.hz) > 1 and 0.5 < 1.05 * self.band_end * self.step:
            said.append(
                f"the times are {1000 * self.step:.3g} ms apart, so the history holds nothing "
                f"above {0.5 / self.step:.4g} Hz: what is faster would appear as something "
                "slower (aliasing)"
            )
        return said


def _percent(share: float) -> str:
    """Of an error, in words."""
    return f"{100 * share:.2g} %" if 1e-6 < share < 10 else f"{share:.1e}"


#: Its name in 0.1.
Verdict = HistoryAssessment


@dataclass
class _Block:
    """A block of H with what is claimed of its error: ε, of it, or of ``least`` where that is
    larger, or of all of H."""

    rows: Ints
    columns: Ints
    epsilon: float
    of_all: bool = False
    least: float = 0.0


def _blocks(model: ReducedBody) -> dict[str, list[_Block]]:
    """What is claimed, by what the outputs are."""
    all_rows, all_columns = np.arange(len(model.outputs)), np.arange(len(model.inputs))
    if not len(model.claim.by_kind):
        return {"motion": [_Block(all_rows, all_columns, model.claim.whole)]}
    claim = model.claim
    claims = {
        tuple(kind.split(" from ")): (float(e), float(least))
        for kind, e, least in zip(claim.kinds, claim.by_kind, claim.kind_least, strict=True)
    }
    blocks: dict[str, list[_Block]] = {}
    inputs = [kind for kind in INPUT_KINDS if len(ports_of(model.inputs, kind))]
    known = np.concatenate([ports_of(model.inputs, kind) for kind in inputs])
    for output in dict.fromkeys(output for output, _ in claims):
        rows = ports_of(model.outputs, output)
        mine = []
        for kind in inputs:  # what is claimed of no kind is nothing but rounding
            columns = ports_of(model.inputs, kind)
            if (output, kind) in claims:
                epsilon, least = claims[output, kind]
                mine.append(_Block(rows, columns, epsilon, least=least))
            elif model.claim.is_hidden(output, kind):
                mine.append(_Block(rows, columns, model.claim.whole, True))
        others = np.setdiff1d(all_columns, known)
        if len(others):
            mine.append(_Block(rows, others, model.claim.whole, True))
        blocks[output] = mine
    return blocks


def _beside(model: ReducedBody, energy: Floats) -> tuple[str, ...]:
    """Kinds of outputs from loads with some energy, (n_in,), that only the claim of H covers."""
    claim = model.claim
    outputs = dict.fromkeys(kind.partition(" from ")[0] for kind in claim.kinds)
    return tuple(
        f"{output} from {kind}"
        for output in outputs
        for kind in INPUT_KINDS
        if energy[ports_of(model.inputs, kind)].any()
        and f"{output} from {kind}" not in claim.kinds
        and claim.is_hidden(output, kind)
    )


def _size(H: ComplexArray, block: _Block) -> float:
    """Norm of what the claim of a block is relative to."""
    own = float(np.linalg.norm(H if block.of_all else H[np.ix_(block.rows, block.columns)]))
    return max(own, block.least)


def _for_its_loads(model: ReducedBody) -> ReducedBody:
    """A body that was reduced for few loads, as one that has these for inputs."""
    if not model.claim.load_names:
        return model
    claim = model.claim
    return model.with_parts(system=model.system.along(claim.loads, claim.load_names))


def step_of(model: ReducedBody) -> float:
    """A step that resolves the band of a body [s].

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> round(step_of(rom) * rom.claim.band[1] / (2 * np.pi), 9)
    0.2
    """
    return 2 * np.pi / (PER_PERIOD * float(model.claim.bands.max()))


def judge(model: ReducedBody, t: ArrayLike, u: ArrayLike) -> HistoryAssessment:
    """What the claim says of the response to a load history.

    For each kind of output if the claim is of each kind. By Parseval, from ‖H − H_r‖ <= ε ‖H‖ at
    every line of the spectrum in the band; ‖H‖ is at most ‖H_r‖/(1 − ε), of that part of H that ε
    is relative to. At resonances that a claim leaves out nothing is known: lines in them count as
    outside. A claim for few loads is one of the motion along them, and of what of the history is a
    combination of them.

    Parameters
    ----------
    t : (n,) array
        [s], rising; not uniform: corners between which the loads are linear (``evenly``).
    u : (n, n_in) array
        Loads.

    Raises
    ------
    BodyError
        If the loads vanish, or are none for these times and inputs.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> said = judge(rom, *read_history("loads.csv", rom.inputs))
    >>> max(said.errors.values()) < 0.1
    True
    """
    t, u = np.asarray(t, dtype=float), np.asarray(u, dtype=float)
    if u.shape != (len(t), len(model.inputs)) or len(t) < 2:
        raise BodyError(f"loads are {u.shape}, expected {(len(t), len(model.inputs))}")
    told = lines = _Spectrum(*evenly(t, u, step_of(model)))
    total = lines.energy.sum(axis=0)
    if not total.any():
        raise BodyError("all loads vanish")
    claim = model.claim
    share = lines.energy[:, total > 0] / total[total > 0]
    names = [name for name, some in zip(model.inputs, total > 0, strict=True) if some]
    inside, below = _in_band(2 * np.pi * lines.hz, claim)
    if model.frame.rigid_modes > 0:  # a free body has no steady answer to a constant load
        inside[0], below[0] = False, True
    share_below = share[below].sum(axis=0)
    share_above = share[~inside & ~below].sum(axis=0)
    reached = np.argmax(np.cumsum(share, axis=0) >= ENOUGH - 1e-12, axis=0)
    chosen = np.flatnonzero(inside & (lines.energy.sum(axis=1) > 1e-20 * total.sum()))
    astray, beside = 0.0, _beside(model, total)
    if claim.load_names:
        within = lines.u @ np.linalg.pinv(claim.loads).T
        off = np.sum((lines.u - within @ claim.loads.T) ** 2)
        astray = float(off / np.sum(lines.u**2))
        lines = _Spectrum(lines.t, within)
        model = _for_its_loads(model)
    elastic = None
    if model.frame.rigid_modes > 0:
        with contextlib.suppress(BodyError):  # dampers hold it
            elastic = without_rigid_modes(model)
    errors, elastic_errors = _errors(model, elastic, lines, chosen) if len(chosen) else ({}, None)
    return HistoryAssessment(
        lines.hz,
        told.amplitude,
        float(share_below.max()),
        float(share_above.max()),
        names[int(np.argmax(share_below + share_above))],
        float(lines.hz[reached.max()]),
        errors,
        elastic_errors,
        astray,
        claim.kind != "estimated",
        float(claim.bands.max()) / (2 * np.pi),
        beside,
        float(told.t[1] - told.t[0]),
        dict(model.provenance.log.get("options") or {}).get("-mor_statics") == "yes",
    )


class _Spectrum:
    """Loads at evenly spaced times as one period of a Fourier series."""

    def __init__(self, t: Floats, u: Floats) -> None:
        self.t, self.u = t, u
        self.U = np.fft.rfft(u, axis=0)
        self.hz = np.fft.rfftfreq(len(u), t[1] - t[0])
        lines = np.arange(len(self.hz))
        #: Two-sided: each line but the first and the last counts twice.
        self.weight = np.where((self.hz == 0) | (2 * lines == len(u)), 1.0, 2.0)
        self.energy = self.weight[:, None] * np.abs(self.U) ** 2
        self.amplitude = np.sqrt(self.weight[:, None]) * np.abs(self.U) / len(u)


def _in_band(omega: Floats, claim: Claim) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which lines the claim holds at, and which lie below the band."""
    tiny = 1e-9 * claim.band[1]
    inside = np.any([(omega >= a - tiny) & (omega <= b + tiny) for a, b in claim.bands], axis=0)
    for a, b in claim.excluded:
        inside &= (omega < a) | (omega > b)
    return inside, omega < claim.band[0] - tiny


def _errors(
    model: ReducedBody, elastic: ReducedBody | None, lines: _Spectrum, chosen: Ints
) -> tuple[dict[str, float], dict[str, float] | None]:
    """Root mean square errors of the motion at some lines, relative to it, by what the outputs are;
    and relative to its elastic part, if there is one."""
    w = 2 * np.pi * lines.hz[chosen]
    loads, twice = lines.U[chosen], lines.weight[chosen]
    claim, groups = model.claim, _blocks(model)
    most: dict[int, float] = {}  # of each block over the band
    if claim.relative_to == "band":
        everywhere = [model.system.claimed(x) for x in np.unique(np.concatenate([claim.omega, w]))]
        most = {
            id(block): max(_size(H, block) for H in everywhere)
            for blocks in groups.values()
            for block in blocks
        }
    unclaimed = model.system.feedthrough - model.system.claimed_feedthrough
    off, motion, bent = ({what: np.zeros(len(w)) for what in groups} for _ in range(3))
    for i, x in enumerate(w):
        H = model.system.claimed(x)
        H_e = H if elastic is None else elastic.system.claimed(x)
        for what, blocks in groups.items():
            for block in blocks:
                by_elastic = claim.bounds_elastic_part and elastic is not None
                size = most.get(id(block), 0.0) or _size(H_e if by_elastic else H, block)
                if claim.relative_to == "both":
                    size = min(size, _size(H, block))
                share_of = block.epsilon / (1 - block.epsilon) if block.epsilon < 1 else np.inf
                load = float(np.linalg.norm(loads[i][block.columns]))
                off[what][i] += share_of * size * load if load > 0 else 0.0
            rows = blocks[0].rows
            heat = unclaimed[rows]
            motion[what][i] = np.linalg.norm((H[rows] + heat) @ loads[i])
            bent[what][i] = np.linalg.norm((H_e[rows] + heat) @ loads[i])

    def relative(moved: dict[str, Floats]) -> dict[str, float]:
        return {
            what: float(
                np.sqrt(np.sum(twice * off[what] ** 2))
                / max(np.sqrt(np.sum(twice * moved[what] ** 2)), 1e-300)
            )
            if np.any(off[what])
            else 0.0
            for what in groups
        }

    return relative(motion), None if elastic is None else relative(bent)
