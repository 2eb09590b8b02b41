"""Figures of a reduced body, one function each; ``report`` and ``plot`` put them together."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import matplotlib
import matplotlib.cm
import matplotlib.colors
import numpy as np
from matplotlib.figure import Figure  # not pyplot: the caller's backend stays the caller's
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats, errors_of, written_aside
from flexgram.model.campbell import Campbell
from flexgram.model.reduced import ReducedBody
from flexgram.pictures.drawings import shapes as shapes
from flexgram.pictures.drawings import stress as stress  # figures, too
from flexgram.simulation.histories import HistoryAssessment

HZ = 1 / (2 * np.pi)
FULL, REDUCED, BOUND = "#444444", "#0868ac", "#e08214"


def _axes(width: float = 6.4, height: float = 3.6) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.grid(alpha=0.3)
    return figure, axes


def error(model: ReducedBody) -> Figure:
    """Relative error (eq. 17) and its certified bound over the band.

    Examples
    --------
    >>> save(error(flexgram.ReducedModel.load("rack.rom.h5")), Path("error.png"))
    """
    figure, axes = _axes(height=4.2)
    claim = model.claim
    hz = claim.omega * HZ
    if len(claim.bound):
        word = "certified" if claim.kind.startswith("certified") else "estimated"
        axes.semilogy(hz, claim.bound, color=BOUND, lw=3.5, alpha=0.6, label=f"{word} bound")
        everywhere = [("all of H, everywhere", claim.whole, "--", BOUND)]
        if len(claim.by_kind):
            everywhere += [
                (f"{kind}, everywhere", value, style, "#7a6a55")
                for kind, value, style in zip(
                    claim.kinds, claim.by_kind, itertools.cycle(("-.", ":", "--"))
                )
            ]
        for label, value, style, color in everywhere:
            for i, (first, last) in enumerate(claim.bands * HZ):
                axes.plot(
                    [first, last],
                    2 * [max(value, 1e-17)],
                    style,
                    color=color,
                    lw=1.2,
                    label=f"{label}: {value:.1e}" if i == 0 else None,
                )
        for i, (first, last) in enumerate(claim.excluded * HZ):
            axes.axvspan(first, last, color="#d7301f", lw=1.5, label="excluded" if i == 0 else None)
    if len(claim.floor):
        axes.semilogy(
            hz,
            np.maximum(claim.floor, 1e-17),
            ":",
            color=BOUND,
            lw=1,
            label="part of it that is rounding",
        )
    if claim.data_rounding.any():
        axes.semilogy(
            hz,
            np.maximum(claim.data_rounding, 1e-17),
            "-.",
            color="gray",
            lw=1,
            label="what the digits of K may change, beside the error",
        )
    if not np.array_equal(claim.error, claim.bound):  # of some assemblies the bound alone is known
        style, label = (
            ("-", model.provenance.words_of_curve) if len(claim.bound) else (".", "error")
        )
        axes.semilogy(hz, np.maximum(claim.error, 1e-17), style, color=REDUCED, lw=1, label=label)
    axes.set(xlabel="frequency [Hz]", ylabel=f"error of H, relative to {claim.short_reference}")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2, fontsize=7)
    return figure


def gramian(model: ReducedBody) -> Figure:
    """Eigenvalues of the position Gramian with the order taken.

    Examples
    --------
    >>> figure = gramian(flexgram.ReducedModel.load("rack.rom.h5"))
    """
    if not len(model.sigma):
        raise BodyError("the reduced file has no Gramian")
    figure, axes = _axes()
    sigma = model.sigma[: max(3 * model.order, 40)]
    axes.semilogy(
        np.arange(1, len(sigma) + 1), np.maximum(sigma / sigma[0], 1e-32), ".-", color=REDUCED
    )
    axes.axvline(model.order, color=BOUND, label=f"order m = {model.order}")
    axes.axhline(
        np.sqrt(np.finfo(float).eps), color="gray", lw=0.8, ls=":", label="the paper's rule, √ε"
    )
    axes.set(xlabel="j", ylabel="σ_j / σ_1")
    axes.legend()
    return figure


def transfer(
    model: ReducedBody, sweep: Path | None = None, ports: list[tuple[str, str]] | None = None
) -> Figure:
    """Amount of H_r for chosen (output, input) pairs; with a sweep file that of the full body; of a
    body with parameters that of its present values, and the envelope over the box.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> figure = transfer(rom, ports=[("upper.fz", "upper.fz"), ("upper.fx", "lower.fx")])
    """
    full, hz = None, np.linspace(model.claim.band[0] * HZ, model.claim.band[1] * HZ, 800)
    inputs, outputs = model.inputs, model.outputs
    if sweep is not None:
        omega, full = read_sweep(Path(sweep), model)
        hz = omega * HZ
    H = model.system.transfer(hz / HZ)
    box = envelope(model, hz / HZ) if model.system.parameters else None
    if not ports:
        strongest = np.argsort(
            -np.abs(np.einsum("kii->ki", H[:, : len(inputs), : len(outputs)])).max(axis=0)
        )
        kinds = [
            next((i for i in strongest if inputs[i].split(".")[-1][0] == k), None) for k in "fm"
        ]
        chosen = [i for i in kinds if i is not None] or [int(strongest[0])]
        ports = [(outputs[i], inputs[i]) for i in chosen]
    expect_ports(model, ports)
    figure = Figure(figsize=(6.4, 2.9 * len(ports)), layout="constrained")
    panels = figure.subplots(len(ports), 1, squeeze=False, sharex=True)
    for axes, (output, port) in zip(panels.flat, ports, strict=True):
        i, j = outputs.index(output), inputs.index(port)
        if box is not None:
            axes.fill_between(
                hz, box[0][:, i, j], box[1][:, i, j], color=BOUND, alpha=0.3, lw=0,
                label=f"any {', '.join(model.system.parameters)}",
            )  # fmt: skip
        if full is not None:
            axes.semilogy(hz, np.abs(full[:, i, j]), color=FULL, label="full body")
        axes.semilogy(
            hz,
            np.abs(H[:, i, j]),
            "--" if full is not None else "-",
            color=REDUCED,
            label=f"reduced, m = {model.order}",
        )
        axes.set(ylabel=f"|H| [{unit_of(output, port)}]", title=f"{output} from {port}")
        axes.grid(alpha=0.3)
        axes.legend()
    panels[-1, 0].set(xlabel="frequency [Hz]")
    return figure


def read_sweep(sweep: Path, model: ReducedBody) -> tuple[Floats, ComplexArray]:
    """Frequencies [rad/s] and H of a sweep file.

    Raises
    ------
    BodyError
        If its ports are others.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> omega, H = read_sweep(Path("rack.sweep.h5"), rom)
    >>> bool(np.abs(rom.transfer(omega) - H).max() < 1e-3 * np.abs(H).max())
    True
    """
    with errors_of(sweep), h5py.File(sweep) as file:
        if "omega" not in file or "H" not in file:
            raise BodyError(f"{sweep}: not a sweep file (flexgram sweep writes one)")
        omega, H = file["omega"][:], file["H"][..., 0] + 1j * file["H"][..., 1]
        names = [[str(x) for x in file["H"].attrs[k]] for k in ("inputs", "outputs")]
    if names != [model.inputs, model.outputs]:
        raise BodyError(f"{sweep}: its ports are not those of the reduced body")
    return omega, H


def expect_ports(model: ReducedBody, ports: Sequence[tuple[str, str]]) -> None:
    """Raise BodyError for pairs (output, input) that the body does not have.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> expect_ports(rom, [("upper.fx", "lower.fx")])
    """
    for output, port in ports:
        if output not in model.outputs:
            raise BodyError(f"no output {output}; there are {', '.join(model.outputs)}")
        if port not in model.inputs:
            raise BodyError(f"no port {port}; there are {', '.join(model.inputs)}")


def envelope(model: ReducedBody, omega: Floats) -> tuple[Floats, Floats]:
    """Least and largest amount of H_r with values of the parameters over their box.

    Parameters
    ----------
    omega : (n,) array
        [rad/s]

    Returns
    -------
    least, largest : (n, n_out, n_in) arrays
        Over 41 values of one parameter, 7 of each of two, else both ends of each.

    Examples
    --------
    A body without parameters has one curve:

    >>> import numpy as np
    >>> from flexgram import ReducedModel
    >>> least, largest = envelope(ReducedModel.load("rack.rom.h5"), np.array([600.0, 1200.0]))
    >>> bool(np.all(least == largest))
    True
    """
    known = model.system.parameters
    count = {1: 41, 2: 7}.get(len(known), 2)
    scale = [np.geomspace if law.least > 0 else np.linspace for law in known.values()]
    each = [
        space(law.least, law.most, count) for space, law in zip(scale, known.values(), strict=True)
    ]
    shape = (len(omega), len(model.outputs), len(model.inputs))
    least, largest = np.full(shape, np.inf), np.zeros(shape)
    for values in itertools.product(*each):
        inside = (
            np.clip(x, law.least, law.most) for x, law in zip(values, known.values(), strict=True)
        )
        size = np.abs(model.system.at(dict(zip(known, inside, strict=True))).transfer(omega))
        least, largest = np.minimum(least, size), np.maximum(largest, size)
    return least, largest


def unit_of(output: str, port: str) -> str:
    """Unit of an element of H, by how ports are named (``upper.fz``, ``upper.mx``).

    Examples
    --------
    >>> unit_of("upper.fz", "upper.fz"), unit_of("upper.mx", "upper.mx")
    ('m/N', 'rad/(N m)')
    """
    kinds = [name.rpartition(".")[2] for name in (output, port)]
    if not all(kind in ("fx", "fy", "fz", "mx", "my", "mz") for kind in kinds):
        return "SI"
    of_output, of_input = ("rad" if kinds[0][0] == "m" else "m"), kinds[1][0]
    return f"{of_output}/{'(N m)' if of_input == 'm' else 'N'}"


def loads(model: ReducedBody, verdict: HistoryAssessment, most: int = 6) -> Figure:
    """Spectrum of a load history, and the band.

    Examples
    --------
    >>> from flexgram.simulation.histories import judge, read_history
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> figure = loads(rom, judge(rom, *read_history("loads.csv", rom.inputs)))
    """
    figure, axes = _axes()
    largest = verdict.spectrum.max(axis=0)
    for j in np.argsort(-largest)[:most]:
        if largest[j] > 0:
            axes.semilogy(
                verdict.hz,
                np.maximum(verdict.spectrum[:, j], 1e-9 * largest[j]),
                lw=1,
                label=model.inputs[j],
            )
    for i, (first, last) in enumerate(model.claim.bands * HZ):
        axes.axvspan(first, last, color=BOUND, alpha=0.15, lw=0, label=None if i else "band")
    axes.axvline(verdict.needed, color="k", ls=":", lw=1, label="99.9 % of every load is below")
    right = min(1.5 * max(verdict.needed, model.claim.bands.max() * HZ), verdict.hz[-1])
    axes.set(xlabel="frequency [Hz]", ylabel="amplitude [N, N m]", xlim=(0, right))
    if len(verdict.hz) > 2 and verdict.needed < 0.05 * right:  # slow loads: else at the edge
        axes.set(xscale="log", xlim=(verdict.hz[1], right))
    axes.legend(fontsize=7)
    return figure


def stress_over_time(t: Floats, largest: Floats, outputs: dict[str, Floats]) -> Figure:
    """The largest von Mises stress of a body over time, and its outputs that are stresses: the
    eight largest, without those below a fiftieth of that.

    Parameters
    ----------
    t, largest : (n,) arrays
        [s], [N/m²]
    outputs : dict
        Name -> (n,) array [N/m²].

    Examples
    --------
    >>> t = np.linspace(0, 1, 11)
    >>> figure = stress_over_time(t, 1e6 * t, {"fillet.sxx": 5e5 * t})
    """
    figure, axes = _axes(8.2)
    axes.plot(t, 1e-6 * largest, color="k", lw=1.2, label="largest von Mises stress")
    sizes = {name: float(np.abs(values).max()) for name, values in outputs.items()}
    seen = sorted(sizes, key=lambda name: -sizes[name])[:8]
    for name in seen:
        if sizes[name] >= 0.02 * float(largest.max()):
            axes.plot(t, 1e-6 * outputs[name], lw=1, label=name)
    axes.set(xlabel="time [s]", ylabel="stress [MPa]", xlim=(t[0], t[-1]))
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.01, 1))
    return figure


def stages(model: ReducedBody) -> Figure:
    """Seconds of each stage.

    Examples
    --------
    >>> figure = stages(flexgram.ReducedModel.load("rack.rom.h5"))
    """
    seconds = model.provenance.seconds
    if not seconds:
        raise BodyError("the reduced file has no times")
    figure, axes = _axes(height=0.8 + 0.28 * len(seconds))
    names = sorted(seconds, key=lambda name: seconds[name])
    axes.barh(names, [seconds[name] for name in names], color=REDUCED)
    axes.set(xlabel="time [s]")
    return figure


FIGURES: dict[str, Callable[..., Figure]] = {
    "error": error,
    "gramian": gramian,
    "transfer": transfer,
    "stages": stages,
    "shapes": shapes,
}


def campbell(
    diagram: Campbell, orders: Sequence[float] = (1.0,), band: ArrayLike | None = None
) -> Figure:
    """Natural frequencies over the speed, lines of excitation, and critical speeds.

    Parameters
    ----------
    diagram : Campbell
    orders : sequence of float
        Multiples of the speed that excite.
    band : (2,) array, optional
        [rad/s] the frequencies that a claim is of, shaded.

    Examples
    --------
    >>> from flexgram.model.campbell import campbell as diagram_of
    >>> save(campbell(diagram_of(rom.system), (1, 2)), Path("a.png"))  # doctest: +SKIP
    """
    figure, axes = _axes(height=4.6)
    rpm, hz = diagram.speeds * 30 / np.pi, diagram.omega * HZ
    if band is not None:
        axes.axhspan(*np.asarray(band) * HZ, color="#888888", alpha=0.12, lw=0, label="band")
    scale = matplotlib.colors.Normalize(-1, 1)
    senses = matplotlib.colors.LinearSegmentedColormap.from_list(
        "senses", ["#2166ac", FULL, "#b2182b"]
    )
    for k in range(hz.shape[1]):
        axes.plot(rpm, hz[:, k], color="#bbbbbb", lw=0.8, zorder=1)
        points = axes.scatter(
            rpm, hz[:, k], c=diagram.whirl[:, k], cmap=senses, norm=scale, s=9, zorder=2
        )
    top = 1.05 * np.nanmax(hz)
    for order in orders:
        if order > 0:
            axes.plot(rpm, order * diagram.speeds * HZ, "--", color=FULL, lw=0.9)
            inside = np.flatnonzero(order * diagram.speeds * HZ <= top)
            if not len(inside):
                continue
            at = inside[-1]
            axes.annotate(f"{order:g}×", (rpm[at], order * diagram.speeds[at] * HZ), fontsize=8)
    for one in diagram.critical(orders):
        height = one.order * one.speed * HZ
        axes.plot(one.speed * 30 / np.pi, height, "o", mfc="none", mec=BOUND, ms=9)
    axes.set(
        xlabel="speed [rpm]",
        ylabel=f"natural frequency{', frame that turns' if diagram.turning else ''} [Hz]",
        ylim=(0, top),
    )
    bar = figure.colorbar(points, ax=axes, ticks=[-1, 0, 1])
    bar.ax.set_yticklabels(["backward", "on lines", "forward"])
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the suffix chooses the format.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> save(gramian(rom), Path("gramian.svg"))
    """
    try:
        with written_aside(path) as place:
            figure.savefig(place, dpi=150)
    except ValueError as failure:  # matplotlib does not know the suffix
        raise BodyError(f"{path}: {failure}") from None
