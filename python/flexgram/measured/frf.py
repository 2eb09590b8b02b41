"""Frequency responses of a reduced body between ports: tables, Bode plots, universal files, and how
they compare with measured ones.

Universal files: dataset 58 (functions at nodal dofs), as text, of frequency responses; complex or
real, even or uneven abscissa. Ports are nodes 1, 2, … by interface, in the order of the body, and
directions 1-3 of translations, 4-6 of rotations; their names stand as entities.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats, errors_of, meant, written_aside
from flexgram.body.universal import dataset, datasets
from flexgram.model.kinds import unit_of
from flexgram.model.reduced import ReducedBody
from flexgram.model.system import RATES

#: UFF 58: frequency response function; types of complex and real numbers; what ordinates are.
FRF, FREQUENCY, FORCE = 4, 18, 13
COMPLEX, DOUBLE = (5, 6), (4, 6)
ORDINATES = {"displacement": 8, "velocity": 11, "acceleration": 12}
DIRECTIONS = {"fx": 1, "fy": 2, "fz": 3, "mx": 4, "my": 5, "mz": 6, "ux": 1, "uy": 2, "uz": 3}


@dataclass
class Response:
    """A frequency response function.

    Attributes
    ----------
    output, input : str
        What answers, what drives.
    hertz : (n,) array
    values : (n,) complex array
        SI.
    rate : str
        ``displacement``, ``velocity`` or ``acceleration``.
    nodes, directions : (int, int)
        Of a universal file: of the response, of the reference.
    """

    output: str
    input: str
    hertz: Floats
    values: ComplexArray
    rate: str = "displacement"
    nodes: tuple[int, int] = (0, 0)
    directions: tuple[int, int] = (0, 0)


def responses(
    model: ReducedBody,
    pairs: Sequence[tuple[str, str]],
    hertz: ArrayLike,
    rate: str = "displacement",
) -> list[Response]:
    """H between ports at some frequencies.

    Parameters
    ----------
    model : ReducedBody
    pairs : sequence of (output, input)
    hertz : (n,) array
    rate : str
        What answers: ``displacement``, ``velocity`` or ``acceleration`` of the outputs. The claim
        is relative, so it is that of H.

    Raises
    ------
    BodyError
        For ports that are none, and rates.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> drive = responses(rom, [("upper.fz", "upper.fz")], np.linspace(20, 400, 50))[0]
    >>> drive.values.shape
    (50,)
    """
    if rate not in RATES:
        raise BodyError(f"rate = {rate!r} must be one of {', '.join(RATES)}")
    f = np.atleast_1d(np.asarray(hertz, dtype=float))
    if not len(f) or not np.all(np.isfinite(f)) or np.any(f < 0):
        raise BodyError("frequencies must be finite and not negative")
    for output, port in pairs:
        for what, name, names in (
            ("output", output, model.outputs),
            ("input", port, model.inputs),
        ):
            if name not in names:
                few = names if len(names) <= 12 else [*names[:12], f"… ({len(names)})"]
                raise BodyError(
                    f"there is no {what} {name}{meant(name, names)}; there are {', '.join(few)}"
                )
    w = 2 * np.pi * f
    H = np.atleast_3d(model.system.transfer(w)) * ((1j * w) ** RATES.index(rate))[:, None, None]
    node = {
        name: k + 1
        for k, name in enumerate(
            dict.fromkeys(port.rpartition(".")[0] for port in (*model.inputs, *model.outputs))
        )
    }
    result = []
    for output, port in pairs:
        ends = [name.rpartition(".") for name in (output, port)]
        result.append(
            Response(
                output,
                port,
                f,
                H[:, model.outputs.index(output), model.inputs.index(port)],
                rate,
                (node[ends[0][0]], node[ends[1][0]]),
                (DIRECTIONS.get(ends[0][2], 0), DIRECTIONS.get(ends[1][2], 0)),
            )
        )
    return result


def write_csv(functions: Sequence[Response], path: str | Path) -> None:
    """Frequencies [Hz] and real and imaginary part of each, with its unit.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> write_csv(responses(rom, [("upper.fz", "lower.fz")], [50.0, 100.0]), "frf.csv")
    """
    with written_aside(path) as place, place.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(
            [
                "Hz",
                *(
                    f"{part} {_quantity(r)} {r.output} from {r.input} [{_unit(r)}]"
                    for r in functions
                    for part in ("Re", "Im")
                ),
            ]
        )
        for k, f in enumerate(functions[0].hertz):
            parts = [part for r in functions for part in (r.values[k].real, r.values[k].imag)]
            table.writerow([repr(float(x)) for x in (f, *parts)])


def write_universal(functions: Sequence[Response], path: str | Path, about: str = "") -> None:
    """Dataset 58 of each, complex doubles.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> write_universal(responses(rom, [("upper.fz", "lower.fz")], [50.0, 100.0]), "frf.unv")
    """
    lines: list[str] = []
    for number, r in enumerate(functions, 1):
        steps = np.diff(r.hertz)
        even = len(r.hertz) < 2 or bool(np.ptp(steps) <= 1e-9 * abs(steps[0]))
        step = float(steps[0]) if even and len(steps) else 0.0
        entities = [name.rpartition(".")[0][:10] or "NONE" for name in (r.output, r.input)]
        own = [f"{r.output} from {r.input}"[:80], about[:80] or "NONE", "NONE", "flexgram", "NONE"]
        own.append(
            f"{FRF:5d}{number:10d}{0:5d}{0:10d}"
            + "".join(
                f" {entity:<10}{node:10d}{direction:4d}"
                for entity, node, direction in zip(entities, r.nodes, r.directions, strict=True)
            )
        )
        own.append(
            f"{COMPLEX[1]:10d}{len(r.hertz):10d}{int(even):10d}"
            f"{float(r.hertz[0]):13.5E}{step:13.5E}{0.0:13.5E}"
        )
        for kind, label, unit in (
            (FREQUENCY, "Frequency", "Hz"),
            (ORDINATES[r.rate], r.rate.capitalize(), "SI"),
            (FORCE, "Force", "SI"),
            (0, "NONE", "NONE"),
        ):
            own.append(f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20} {unit:<20}")
        numbers = [(x.real, x.imag) for x in r.values]
        if even:
            flat = [part for pair in numbers for part in pair]
            own += ["".join(f"{x:20.11E}" for x in flat[k : k + 4]) for k in range(0, len(flat), 4)]
        else:
            own += [
                f"{f:13.5E}{re:20.11E}{im:20.11E}"
                for f, (re, im) in zip(r.hertz, numbers, strict=True)
            ]
        lines += dataset(58, own)
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")


def read_universal(path: str | Path) -> list[Response]:
    """The frequency response functions of a universal file; all else is passed over.

    Raises
    ------
    BodyError
        If there is none, or one that cannot be read.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> made = responses(rom, [("upper.fz", "lower.fz")], [50.0, 100.0])
    >>> write_universal(made, "read.unv")
    >>> bool(np.allclose(read_universal("read.unv")[0].values, made[0].values))
    True
    """
    found = []
    with errors_of(path):
        for number, lines in datasets(path):
            if number != 58:
                continue
            where, shape = lines[5], lines[6]
            if int(where[:5]) != FRF:
                continue
            kind, count, even = (int(shape[k : k + 10]) for k in (0, 10, 20))
            first, step = (float(shape[k : k + 13]) for k in (30, 43))
            numerator = int(lines[8][:10])
            rate = next(
                (name for name, code in ORDINATES.items() if code == numerator), "displacement"
            )
            width = 20 if kind in DOUBLE else 13
            parts = 2 if kind in COMPLEX else 1
            numbers: list[float] = []
            for line in lines[11:]:
                at = 0
                while line[at:].strip():
                    each = 13 if not even and len(numbers) % (parts + 1) == 0 else width
                    numbers.append(float(line[at : at + each]))
                    at += each
            table = np.array(numbers).reshape(count, -1)
            hertz = first + step * np.arange(count) if even else table[:, 0]
            values = table if even else table[:, 1:]
            whole = values[:, 0].astype(complex)
            if parts == 2:
                whole = whole + 1j * values[:, 1]
            if not (np.isfinite(hertz).all() and np.isfinite(whole).all()):
                raise BodyError("a frequency or a response is not finite")
            found.append(
                Response(
                    f"{where[31:41].strip()}",
                    f"{where[56:66].strip()}",
                    hertz,
                    whole,
                    rate,
                    (int(where[41:51]), int(where[66:76])),
                    (int(where[51:55]), int(where[76:80])),
                )
            )
    if not found:
        raise BodyError(f"{path}: no frequency response (dataset 58, function type 4)")
    return found


def frac(a: ArrayLike, b: ArrayLike) -> float:
    """Frequency response assurance criterion of two responses at the same frequencies: 1 if they
    differ by a factor only.

    Examples
    --------
    >>> round(frac([1.0, 2j], [2.0, 4j]), 12)  # alike but for the size
    1.0
    """
    x, y = np.asarray(a, dtype=complex), np.asarray(b, dtype=complex)
    size = float(np.real(np.vdot(x, x)) * np.real(np.vdot(y, y)))
    return float(np.abs(np.vdot(x, y)) ** 2 / size) if size > 0 else 0.0


def _unit(r: Response) -> str:
    """The unit of a response, per unit of the input."""
    above, below = unit_of(r.output, True, r.rate), unit_of(r.input, False)
    if not (above and below):
        return "SI"
    return f"{above}/({below})" if re.search("[./]", below) else f"{above}/{below}"


def _quantity(r: Response) -> str:
    """What answers: a rate of motions, else the kind of output that the port's name tells."""
    return r.rate if unit_of(r.output, True) in ("m", "rad") else r.output.rpartition(".")[2]


def bode(
    functions: Sequence[Response], measured: Sequence[Response] = (), log: bool = False
) -> Any:
    """Magnitude and phase of each over the frequency; ``measured`` beside them, one for each; with
    ``log`` on a logarithmic axis.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> figure = bode(responses(rom, [("upper.fz", "upper.fz")], np.linspace(20, 400, 50)))
    >>> len(figure.axes)
    2
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.8, 3.6 * len(functions)), layout="constrained")
    panels = figure.subplots(
        2 * len(functions), 1, sharex=True, squeeze=False, height_ratios=[3, 1] * len(functions)
    )[:, 0]
    for k, r in enumerate(functions):
        sets = [(r, "C3", "reduced")]
        if k < len(measured):
            sets.insert(0, (measured[k], "0.4", "measured"))
        for one, color, label in sets:
            panels[2 * k].semilogy(one.hertz, np.abs(one.values), color=color, label=label)
            panels[2 * k + 1].plot(one.hertz, np.angle(one.values, deg=True), color=color)
        panels[2 * k].set(
            title=f"{r.output} from {r.input}", ylabel=f"|{_quantity(r)}| [{_unit(r)}]"
        )
        panels[2 * k + 1].set(ylabel="phase [°]", ylim=(-190, 190), yticks=(-180, 0, 180))
        for axes in panels[2 * k : 2 * k + 2]:
            axes.grid(alpha=0.3)
        if len(sets) > 1:
            panels[2 * k].legend()
    panels[-1].set(xlabel="frequency [Hz]", xscale="log" if log else "linear")
    return figure
