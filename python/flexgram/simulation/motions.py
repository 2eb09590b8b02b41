"""Elastic motions of a reduced body over time: its answer to a load history, or what a multibody
code computed; with the stress of the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.model.elastic_part import in_its_frame, without_rigid_modes
from flexgram.model.kinds import ports_of
from flexgram.model.recovery import StressPeaks, has_stress, stress_fields, stress_peaks
from flexgram.model.reduced import ReducedBody
from flexgram.simulation.histories import evenly, read_history, refined, step_of
from flexgram.simulation.time_files import rows_of, table_of

#: Moments of a motion that a page goes through, beside the worst one.
MOMENTS = 40
#: A history with fewer moments is divided further, up to so many, for its peaks to be seen.
ENOUGH_MOMENTS = 2000
#: Moments that a period of the lowest mode needs at least, for its peaks to be seen.
PER_PERIOD = 8


def read_coordinates(path: str | Path, order: int) -> tuple[Floats, Floats]:
    """Times and elastic coordinates that a multibody code wrote: each line a time [s] and the
    coordinates then, with commas. A first line ``t,…`` of names and comments (#) are left out:
    the file of EXUDYN's ``SensorNode`` is read as it is.

    Returns
    -------
    t : (n,) array
    q : (n, order) array

    Raises
    ------
    BodyError
        For another number of coordinates, what is no number, or times that do not rise; with the
        line.

    Examples
    --------
    >>> t, q = read_coordinates("motion.csv", 4)
    >>> q.shape == (len(t), 4)
    True
    """
    path = Path(path)
    rows = rows_of(path)
    if rows and rows[0][1][0].lower() in ("t", "time"):
        del rows[0]
    if len(rows) < 2:
        raise BodyError(f"{path}: expected a line for each moment: time and {order} coordinates")
    found = len(rows[0][1]) - 1
    if found != order:
        raise BodyError(
            f"{path}, line {rows[0][0]}: {found} coordinates, but the body has {order} elastic "
            "ones; of a floating frame give those of its modal node alone"
        )
    table = table_of(path, rows, 1 + order)
    return table[:, 0], table[:, 1:]


@dataclass
class Motion:
    """An elastic motion of a body.

    Attributes
    ----------
    part : ReducedBody
        The body without its rigid motion.
    t : (n,) array
        [s]
    q : (n, m) array
        Coordinates of ``part``.
    u : (n, n_in) array
        Inputs; zero where none are known.
    stresses : dict
        Outputs that are stresses: name -> (n,) array [N/m²].
    peaks : StressPeaks or None
        Extremes of the stress over all nodes; nothing of bodies without stress.
    is_given : bool
        Whether a multibody code computed it.
    """

    part: ReducedBody
    t: Floats
    q: Floats
    u: Floats
    stresses: dict[str, Floats]
    peaks: StressPeaks | None
    is_given: bool

    @classmethod
    def answer(cls, model: ReducedBody, loads: str | Path, body: str | Path | None) -> Motion:
        """The answer to a file of loads over time, from rest.

        Raises
        ------
        BodyError
            Without a time domain, for a rigid body, or if the answer grows beyond all numbers.
        """
        part = _elastic(without_rigid_modes(model))
        t, u = read_history(loads, model.inputs)
        t, u = evenly(t, u, step_of_answers(model, t))
        between = min(_steps_between(part, t), max(1, ENOUGH_MOMENTS // len(t)))
        t, u = refined(t, u, np.linspace(t[0], t[-1], between * (len(t) - 1) + 1))
        y, q = part.system.simulate(u, t)
        if not np.all(np.isfinite(q)):
            raise BodyError("the answer grows beyond all numbers: the body is unstable")
        return cls(part, t, q, u, _stresses(part, y), _peaks(part, q, u, body), False)

    @classmethod
    def given(
        cls,
        model: ReducedBody,
        coordinates: str | Path,
        body: str | Path | None,
        loads: str | Path | None = None,
    ) -> Motion:
        """What a multibody code computed (``read_coordinates``). Where heat strains the body its
        stress needs the temperatures, of a file of loads.

        Raises
        ------
        BodyError
            As ``read_coordinates``; where heat strains the body, without ``loads`` at all times of
            the motion.
        """
        part = _elastic(in_its_frame(model))
        t, q = read_coordinates(coordinates, part.order)
        u = np.zeros((len(t), len(part.inputs)))
        fields = stress_fields(part, body) if has_stress(part, body) else []
        if heats := sorted({name for field in fields for name in field.held}):
            if loads is None:
                raise BodyError(
                    f"{', '.join(heats)} strains the body: give the temperatures by --loads, too"
                )
            of_times, history = read_history(loads, model.inputs)
            if t[0] < of_times[0] or t[-1] > of_times[-1]:
                raise BodyError(
                    f"{loads}: its times are {of_times[0]:g} to {of_times[-1]:g} s, those of the "
                    f"motion {t[0]:g} to {t[-1]:g} s"
                )
            u = np.column_stack([np.interp(t, of_times, column) for column in history.T])
        system = part.system
        y = q @ system.C.T + u @ system.feedthrough.T
        return cls(part, t, q, u, _stresses(part, y), _peaks(part, q, u, body), True)

    @cached_property
    def worst(self) -> int:
        """The moment of the largest von Mises stress, or else of the largest strain energy."""
        if self.peaks is not None:
            return self.peaks.von_mises.when
        K = self.part.system.in_time().K
        return int(np.argmax(np.einsum("ki,ij,kj->k", self.q, K, self.q, optimize=True)))

    @property
    def moments(self) -> Ints:
        """Some moments, evenly chosen, and the worst one."""
        some = np.linspace(0, len(self.t) - 1, MOMENTS).astype(int)
        chosen: Ints = np.unique(np.append(some, self.worst))
        return chosen

    @property
    def doubts(self) -> list[str]:
        """Whether moments lie too far apart for the lowest mode."""
        said = too_far_apart(self.part, self.t)
        remedy = ". Give the loads at more times"
        if self.is_given:
            remedy = ". Write more of them (EXUDYN: settings.solution.sensors.writePeriod)"
        return [said + remedy] if said else []


def too_far_apart(part: ReducedBody, t: Floats) -> str:
    """What peaks of a motion hide between its moments t [s]; empty where these are close enough for
    the lowest elastic mode.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> too_far_apart(rom, np.linspace(0, 1, 5)).partition(",")[0]
    'moments are up to 250 ms apart'
    """
    elastic = part.modes[part.frame.rigid_modes :]
    if not len(elastic) or len(t) < 2:
        return ""
    lowest = float(elastic.min()) / (2 * np.pi)
    step = float(np.diff(t).max())
    if lowest * step * PER_PERIOD <= 1:
        return ""
    return (
        f"moments are up to {1e3 * step:.3g} ms apart, and a period of the first natural "
        f"frequency ({lowest:.4g} Hz) is {1e3 / lowest:.3g} ms: peaks between them are not seen"
    )


def step_of_answers(model: ReducedBody, t: Floats) -> float:
    """A step for the answer to loads with corners at these times [s]: that of the band, but for no
    more than ``ENOUGH_MOMENTS``."""
    return max(step_of(model), float(np.ptp(t)) / ENOUGH_MOMENTS)


def _steps_between(part: ReducedBody, t: Floats) -> int:
    """Steps to divide each into for the peaks of the lowest elastic mode to be seen."""
    elastic = part.modes[part.frame.rigid_modes :]
    if not len(elastic):
        return 1
    return max(1, int(np.ceil(2 * PER_PERIOD * elastic.min() / (2 * np.pi) * (t[1] - t[0]))))


def _elastic(part: ReducedBody) -> ReducedBody:
    if not part.order:
        raise BodyError("the body has no elastic coordinates")
    return part


def _stresses(part: ReducedBody, y: Floats) -> dict[str, Floats]:
    """The outputs that are stresses, of all (n, n_out)."""
    return {part.outputs[k]: y[:, k] for k in ports_of(part.outputs, "stress")}


def _peaks(part: ReducedBody, q: Floats, u: Floats, body: str | Path | None) -> StressPeaks | None:
    if part.basis.parts:  # an assembly
        return None
    return stress_peaks(part, q, u, body) if has_stress(part, body) else None
