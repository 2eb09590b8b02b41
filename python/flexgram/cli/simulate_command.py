"""The verb simulate: a reduced body's motion under loads over time."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexgram.basics import BodyError, meant, say, written_aside
from flexgram.cli.port_commands import count_of


def simulate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument(
        "--force",
        action="append",
        default=[],
        metavar="PORT=f(t)",
        help="force or moment [N, N m] as an expression in t: + - * / ** < >, sin, exp, where, ...",
    )
    parser.add_argument(
        "--time",
        help="first,last,count [s] (default 0,1,1001); a file of loads has its own times",
    )
    parser.add_argument("--loads", type=Path, help="CSV of a load history, t,port,...: its times")
    parser.add_argument(
        "--rates",
        default="displacement",
        help="what is written of the outputs: displacement, velocity, acceleration, comma "
        "separated (default %(default)s)",
    )
    parser.add_argument("--body", type=Path, help="body file with the mesh, for --xdmf")
    parser.add_argument("--xdmf", type=Path, help="also the motion of the mesh, for ParaView")
    parser.add_argument(
        "--frames", type=int, help="with --xdmf: so many moments, evenly chosen; default: all"
    )
    parser.add_argument(
        "--stress",
        action="store_true",
        help="print the extremes of the stress; with --xdmf the file holds it, too",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help=".csv of t and all outputs"
    )


def run_simulate(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.model.kinds import OUTPUT_KINDS, ports_of, unit_of
    from flexgram.model.recovery import stress_peaks, words_of_stress
    from flexgram.reduced_model import ReducedModel
    from flexgram.simulation.expressions import between_times, function_of_time
    from flexgram.simulation.histories import evenly, judge, read_history
    from flexgram.simulation.motions import step_of_answers, too_far_apart

    model = ReducedModel.load(options.rom, basis=options.xdmf is not None or options.stress)
    if not options.force and options.loads is None:
        raise BodyError("no loads: --force PORT=f(t), or --loads FILE")
    if options.loads is not None:
        if options.time is not None:
            raise BodyError("--time and --loads exclude each other: the file has its own times")
        t, u = read_history(options.loads, model.inputs)
        t, u = evenly(t, u, step_of_answers(model, t))
    else:
        try:
            words = options.time or "0,1,1001"
            first, last, count = (float(x) for x in words.split(","))
            t = np.linspace(first, last, count_of(f"--time {words}", count))
        except ValueError:
            raise BodyError(f"--time {options.time}: expected first,last,count") from None
        u = np.zeros((len(t), len(model.inputs)))
    for word in options.force:
        port, _, expression = word.partition("=")
        if port not in model.inputs:
            raise BodyError(
                f"--force {word}: there is no port {port}{meant(port, model.inputs)}; there are "
                f"{', '.join(model.inputs)}"
            )
        try:
            u[:, model.inputs.index(port)] += function_of_time(expression, t)
            if words := between_times(expression, t):
                say(f"  warning: --force {port}: {words}")
        except BodyError as error:
            raise BodyError(f"--force {port}: {error}") from None
    rates = options.rates.split(",")
    y, q = model.simulate(u, t, rates=rates)
    header = "t," + ",".join(model.system.names_of(rates))
    with written_aside(options.output) as place:
        np.savetxt(place, np.column_stack([t, y]), delimiter=",", header=header, comments="")
    say(f"  wrote {options.output}: {len(t)} times [s], {y.shape[1]} outputs")
    for kind in OUTPUT_KINDS:
        ports = [model.outputs[k] for k in ports_of(model.outputs, kind)]
        for rate in rates if ports else ():
            ends = ", ".join(dict.fromkeys("." + port.rpartition(".")[2] for port in ports))
            what = kind if rate == "displacement" else f"{rate} of {kind}"
            if unit := unit_of(ports[0], True, rate):
                say(f"    {what} [{unit}]: {ends}")
    if u.any():
        for words in judge(model, t, u).words_of_outside:
            say(f"  note: {words}")
    if options.xdmf is not None:
        from flexgram.exporters.shapes import numbers_of_motion, write_motion

        if options.frames is not None and options.frames < 2:
            raise BodyError(f"--frames {options.frames}: expected 2 or more")
        count = min(len(q), options.frames or len(q))
        numbers = numbers_of_motion(model, options.body, options.stress)
        if count > 200 and 8e-6 * count * numbers > 200:
            say(
                f"  note: {options.xdmf} will hold some {8e-6 * count * numbers:.0f} MB, {count} "
                "moments; --frames 200 writes fewer"
            )
        more = (options.body, options.stress, u, options.frames)
        count = write_motion(
            model, options.xdmf, t, q, *more, tell=lambda words: say(f"  {options.xdmf}: {words}")
        )
        say(f"  wrote {options.xdmf}: {count} moments")
    if options.stress:
        peaks = stress_peaks(model, q, u, options.body)
        say(f"  {words_of_stress(model, t, peaks, options.body)}")
        if said := too_far_apart(model, t):
            where = "--time FIRST,LAST,COUNT" if options.loads is None else "in the file of loads"
            say(f"  warning: {said}. Take more of them ({where})")
