"""The commands of ``flexgram``: their options and their work."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, say, written_aside
from flexgram.import_command import import_body_file, import_options


def _plot_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path, help="reduced file, or file that flexgram sweep wrote")
    parser.add_argument("--rom", type=Path, help="with a sweep file: reduced file, for its Gramian")
    parser.add_argument(
        "--figure",
        default="all",
        help="of a reduced file: error, gramian, "
        "transfer, stages, shapes or all (then -o names a folder)",
    )
    parser.add_argument("--suffix", default="png", help="png, svg or pdf, for --figure all")
    _picture_options(parser)
    parser.add_argument("-o", "--output", type=Path, required=True, help=".png, .svg or .pdf")


def _picture_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--body", type=Path, help="body file with the mesh; default: the one that was reduced"
    )
    parser.add_argument("--sweep", type=Path, help="sweep file of the full body, to compare with")
    parser.add_argument(
        "--port",
        action="append",
        default=[],
        metavar="OUTPUT,INPUT",
        help="transfer function to draw; repeatable; default: the strongest",
    )


def _pairs(words: list[str]) -> list[tuple[str, str]] | None:
    pairs = [tuple(word.split(",")) for word in words]
    for word, pair in zip(words, pairs, strict=True):
        if len(pair) != 2:
            raise BodyError(f"--port {word}: expected output,input such as upper.fz,upper.fz")
    return [(pair[0], pair[1]) for pair in pairs] or None


def _plot(options: argparse.Namespace) -> None:
    import h5py

    if not options.source.exists():
        raise BodyError(f"{options.source}: no such file")
    reduced = False
    if h5py.is_hdf5(options.source):
        with h5py.File(options.source) as file:
            reduced = "gramian" in file
    if not reduced:
        from flexgram.plots import plot_sweep  # matplotlib is slow to load

        if not options.output.suffix:
            raise BodyError(
                f"-o {options.output}: a sweep is one picture: name a .png, .svg or .pdf"
            )
        plot_sweep(options.source, options.output, options.rom)
        say(f"  wrote {options.output}")
        return
    from flexgram import figures
    from flexgram.reduced import ReducedModel

    model = ReducedModel.load(options.source)
    arguments: dict[str, dict[str, Any]] = {
        "transfer": {"sweep": options.sweep, "ports": _pairs(options.port)},
        "shapes": {"body": options.body},
    }
    every = options.figure == "all"
    if not every and options.figure not in figures.FIGURES:
        raise BodyError(
            f"--figure {options.figure}: must be one of {', '.join(figures.FIGURES)} or all"
        )
    if every and options.output.suffix.lower() in (".png", ".svg", ".pdf"):
        raise BodyError(
            f"-o {options.output}: all figures go into a folder; name one by --figure "
            f"({', '.join(figures.FIGURES)})"
        )
    if every:
        options.output.mkdir(parents=True, exist_ok=True)
    for name in figures.FIGURES if every else [options.figure]:
        path = options.output / f"{name}.{options.suffix}" if every else options.output
        try:
            figures.save(figures.FIGURES[name](model, **arguments.get(name, {})), path)
            say(f"  wrote {path}")
        except BodyError as reason:
            if not every:
                raise
            say(f"  left out {name}: {reason}")


def _report_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file")
    _picture_options(parser)
    parser.add_argument(
        "--loads",
        type=Path,
        help="CSV of a load history, t,port,...: its spectrum against the band, and what the claim "
        "says of the response to it",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help=".html file to write")


def _report(options: argparse.Namespace) -> None:
    from flexgram.report import write_report

    for line in write_report(
        options.rom,
        options.output,
        body=options.body,
        sweep=options.sweep,
        ports=_pairs(options.port),
        loads=options.loads,
    ):
        say(f"  left out {line}")
    if options.loads is not None:
        from flexgram.histories import judge, read_history
        from flexgram.reduced import ReducedModel

        model = ReducedModel.load(options.rom, basis=False)
        for words in judge(model, *read_history(options.loads, model.inputs)).words:
            say(f"  {words}")
    say(f"  wrote {options.output}")


def _export_options(parser: argparse.ArgumentParser) -> None:
    from flexgram.exporters import FORMATS
    from flexgram.exporters.sid import DIALECTS

    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument(
        "--to",
        required=True,
        choices=FORMATS,
        help="; ".join(f"{name}: {what}" for name, (what, *_) in FORMATS.items()),
    )
    parser.add_argument("--dialect", choices=DIALECTS, help="of SID; default dlr")
    parser.add_argument(
        "--body", type=Path, help="body file with the mesh; default: the one that was reduced"
    )
    parser.add_argument(
        "--stress",
        action="store_true",
        help="for exudyn and vtu: the stresses of the basis come along (bodies of meshes)",
    )
    parser.add_argument(
        "--rates",
        help="for state-space (default displacement) and fmu (default all): what their outputs "
        "are, of displacement, velocity, acceleration, comma separated",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write")


def _export(options: argparse.Namespace) -> None:
    from flexgram.exporters import export
    from flexgram.reduced import ReducedModel

    if options.dialect and options.to != "sid":
        raise BodyError("--dialect belongs to --to sid")
    extra: dict[str, Any] = {}
    if options.to in ("exudyn", "vtu", "nastran", "op4", "simscape", "extptfm"):
        extra["body"] = options.body
    if options.to in ("exudyn", "vtu"):
        extra["stress"] = options.stress
    elif options.stress:
        raise BodyError("--stress belongs to --to exudyn and vtu")
    if options.to in ("state-space", "fmu", "fmu3"):
        extra["rates"] = options.rates.split(",") if options.rates else None
    elif options.rates:
        raise BodyError("--rates belongs to --to state-space and fmu")
    if options.to == "sid":
        extra["dialect"] = options.dialect
    model = ReducedModel.load(options.rom)
    export(model, options.output, options.to, **extra)
    say(f"  wrote {options.output}: {model}")


def _info_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="body, reduced or sweep file")


def _info(options: argparse.Namespace) -> None:
    from flexgram.info import describe

    for line in describe(options.file):
        say(f"  {line}")


def _couple_options(parser: argparse.ArgumentParser) -> None:
    from flexgram.couple import PORTS

    where = "PART.INTERFACE=PART.INTERFACE"
    parser.add_argument(
        "roms",
        nargs="+",
        metavar="[NAME=]ROM",
        help="reduced files; a part's name is its file's up to the first dot",
    )
    parser.add_argument("--join", action="append", default=[], metavar=f"{where}[:x,y,...]",
                        help=f"tie two interfaces (or one and ground), in all directions of "
                        f"{', '.join(PORTS)} or some")  # fmt: skip
    for what, unit in (("spring", "[N/m], [N m/rad]"), ("damper", "[N s/m], [N m s/rad]")):
        parser.add_argument(f"--{what}", action="append", default=[], metavar=f"{where}:x=1e6,...",
                            help=f"between them, {unit} by direction")  # fmt: skip
    parser.add_argument("--turn", action="append", default=[], metavar="PART=RX,RY,RZ",
                        help="rotation vector of a part in the assembly [degrees]")  # fmt: skip
    parser.add_argument("--keep", action="append", default=[], metavar="PART.INTERFACE",
                        help="a joined interface whose ports stay")  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, required=True, help="reduced file to write")


def _couple(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.couple import couple, read_joint
    from flexgram.importers.interfaces import numbers
    from flexgram.reduced import ReducedModel

    models: dict[str, ReducedModel] = {}
    for word in options.roms:
        name, equals, path = word.partition("=")
        file = Path(path if equals else word)
        part = name if equals else file.name.partition(".")[0]
        if part in models:
            raise BodyError(f"two parts are named {part}: name one, NAME={file}")
        models[part] = ReducedModel.load(file, basis=False)
    joints = [
        read_joint(f"--{kind}", kind, word)
        for kind in ("join", "spring", "damper")
        for word in getattr(options, kind)
    ]
    turns = {}
    for word in options.turn:
        part, _, vector = word.partition("=")
        if part in turns:
            raise BodyError(f"--turn {word}: {part} is turned twice")
        turns[part] = np.deg2rad(numbers(f"--turn {word}", vector, 3))
    whole = couple(models, joints, turns=turns, keep=options.keep)
    with written_aside(options.output, *(model.path for model in models.values())) as place:
        whole.save(place)
    for name, words in whole.log["plan"]:
        say(f"  {name:8s} {words}")
    say(f"  wrote {options.output}: order {whole.order}, {len(whole.inputs)} inputs")


def _frf_options(parser: argparse.ArgumentParser) -> None:
    from flexgram.reduced import RATES

    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument("--pair", action="append", default=[], metavar="OUTPUT=INPUT",
                        required=True, help="ports, several times for more")  # fmt: skip
    parser.add_argument("--hz", help="first,last,count; default: 800 over the band")
    parser.add_argument("--rate", choices=RATES, default=RATES[0],
                        help="what answers (default %(default)s)")  # fmt: skip
    parser.add_argument("--measured", type=Path,
                        help="universal file (58) whose responses are those of the pairs, in their "
                        "order: at its frequencies, with the FRAC of each")  # fmt: skip
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help=".csv, .unv (universal file 58), or a Bode plot: .png, .svg, .pdf",
    )


def _frf(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram import frf, words
    from flexgram.importers.interfaces import numbers
    from flexgram.reduced import ReducedModel

    model = ReducedModel.load(options.rom, basis=False)
    pairs = []
    for word in options.pair:
        output, equals, port = word.partition("=")
        if not equals:
            raise BodyError(f"--pair {word}: expected OUTPUT=INPUT")
        pairs.append((output, port))
    measured = frf.read_universal(options.measured) if options.measured else []
    if measured and len(measured) < len(pairs):
        raise BodyError(f"{options.measured} has {len(measured)} responses for {len(pairs)} pairs")
    if options.hz:
        first, last, count = numbers(f"--hz {options.hz}", options.hz, 3)
        hertz = np.linspace(first, last, int(count))
    else:
        hertz = np.linspace(model.band[0] / (2 * np.pi), model.band[-1] / (2 * np.pi), 800)
    functions = []
    for k, pair in enumerate(pairs):
        at = measured[k].hertz if measured and not options.hz else hertz
        functions += frf.responses(model, [pair], at, options.rate)
        if measured and not options.hz:
            if measured[k].rate != options.rate:
                raise BodyError(f"{options.measured}: response {k + 1} is a {measured[k].rate}: "
                                f"--rate {measured[k].rate}")  # fmt: skip
            likeness = frf.frac(functions[-1].values, measured[k].values)
            say(f"  {pair[0]} from {pair[1]}: FRAC {likeness:.4f} with the measured one")
    suffix = options.output.suffix.lower()
    if suffix == ".csv":
        if any(not np.array_equal(r.hertz, functions[0].hertz) for r in functions):
            raise BodyError("the measured responses are at different frequencies: --hz")
        frf.write_csv(functions, options.output)
    elif suffix in (".unv", ".uff"):
        frf.write_universal(functions, options.output, words.error_of(model))
    else:
        from flexgram.figures import save

        save(frf.bode(functions, measured[: len(pairs)]), options.output)
    say(f"  wrote {options.output}: {len(functions)} responses, {words.error_of(model)}")


def _simulate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument(
        "--force",
        action="append",
        default=[],
        metavar="PORT=f(t)",
        help="force or moment [N, N m] as an expression in t: + - * / ** < >, sin, exp, where, ...",
    )
    parser.add_argument(
        "--time", default="0,1,1001", help="first,last,count [s] (default %(default)s)"
    )
    parser.add_argument("--loads", type=Path, help="CSV of a load history, t,port,...: its times")
    parser.add_argument(
        "--rates", default="displacement",
        help="what is written of the outputs: displacement, velocity, acceleration, comma "
        "separated (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--body", type=Path, help="body file with the mesh, for --xdmf")
    parser.add_argument("--xdmf", type=Path, help="also the motion of the mesh, for ParaView")
    parser.add_argument(
        "--stress",
        action="store_true",
        help="with --xdmf: stress and von Mises stress too; its extreme is printed",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help=".csv of t and all outputs"
    )


def _hotspots_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file of a mesh of solids")
    parser.add_argument("--count", type=int, default=5, help="at most so many (%(default)s)")
    parser.add_argument(
        "--apart", type=float, help="distance between any two [m]; default: size of the body/20"
    )
    parser.add_argument(
        "--input",
        action="append",
        metavar="PORT",
        help="a load to look at, several times for more; default: all but temperatures",
    )
    parser.add_argument("--body", type=Path, help="body file with the mesh")


def _hotspots(options: argparse.Namespace) -> None:
    from flexgram.hot_spots import describe, hot_spots
    from flexgram.reduced import ReducedModel

    if options.count < 1:
        raise BodyError(f"--count {options.count} must be 1 or more")
    model = ReducedModel.load(options.rom)
    for line in describe(hot_spots(model, options.count, apart=options.apart, body=options.body,
                                   inputs=options.input)):  # fmt: skip
        say(line)


def _simulate(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.expressions import function_of_time
    from flexgram.histories import evenly, read_history
    from flexgram.reduced import ReducedModel
    from flexgram.stress import largest_stress, words_of

    model = ReducedModel.load(options.rom, basis=options.xdmf is not None or options.stress)
    if not options.force and options.loads is None:
        raise BodyError("no loads: --force PORT=f(t), or --loads FILE")
    if options.loads is not None:
        t, u = evenly(*read_history(options.loads, model.inputs))
    else:
        try:
            first, last, count = (float(x) for x in options.time.split(","))
            t = np.linspace(first, last, int(count))
        except ValueError:
            raise BodyError(f"--time {options.time}: expected first,last,count") from None
        u = np.zeros((len(t), len(model.inputs)))
    for word in options.force:
        port, _, expression = word.partition("=")
        if port not in model.inputs:
            raise BodyError(
                f"--force {word}: there is no port {port}; there are {', '.join(model.inputs)}"
            )
        try:
            u[:, model.inputs.index(port)] += function_of_time(expression, t)
        except BodyError as error:
            raise BodyError(f"--force {port}: {error}") from None
    rates = options.rates.split(",")
    y, q = model.simulate(u, t, rates=rates)
    header = "t," + ",".join(model.names_of(rates))
    with written_aside(options.output) as place:
        np.savetxt(place, np.column_stack([t, y]), delimiter=",", header=header, comments="")
    say(f"  wrote {options.output}: {len(t)} times, {y.shape[1]} outputs")
    if options.xdmf is not None:
        from flexgram.exporters.shapes import write_motion

        write_motion(model, options.xdmf, t, q, options.body, options.stress, u)
        say(f"  wrote {options.xdmf}")
    if options.stress:
        worst = largest_stress(model, q, u, options.body)
        say(f"  {words_of(model, t, worst, options.body)}")


#: name: what it does, example, its options, the work
COMMANDS: dict[
    str,
    tuple[str, str, Callable[[argparse.ArgumentParser], None], Callable[[Any], None]],
] = {
    "import": (
        "mesh description or files of an FE code -> body file",
        "flexgram import meshes/rack.yaml -o out/rack.h5\n"
        "  flexgram import part.inp --run-ccx --units mm-t-s --rigid left=NSET:LEFT "
        "--rigid right=NSET:RIGHT -o part.h5\n"
        "  flexgram import lever.msh --material steel --units mm-t-s --rigid eye=NSET:eye "
        "-o lever.h5\n"
        "  flexgram import job_STIF1.mtx --rigid hub=BOX:0,0,0,1,1,0.01@0.5,0.5,0 "
        "-o body.h5\n\nWHERE is NSET:SET, NODES:1,2,3, BOX:x0,y0,z0,x1,y1,z1 or AT:x,y,z (the "
        "nearest node), in the\nunits of the files; @x,y,z behind it places the reference node "
        "(default: the middle of the faces between\nthe nodes, on the axis where they are a "
        "cylinder).",
        import_options,
        import_body_file,
    ),
    "info": (
        "what a body, reduced or sweep file holds",
        "flexgram info out/rack.rom.h5",
        _info_options,
        _info,
    ),
    "report": (
        "reduced file -> one self-contained HTML page",
        "flexgram report out/rack.rom.h5 --sweep out/rack.sweep.h5 -o out/rack.html",
        _report_options,
        _report,
    ),
    "plot": (
        "reduced or sweep file -> figures",
        "flexgram plot out/rack.rom.h5 --figure error -o error.svg\n"
        "  flexgram plot out/rack.rom.h5 -o figures/\n"
        "  flexgram plot sweep.h5 --rom rack.rom.h5 -o rack.png",
        _plot_options,
        _plot,
    ),
    "export": (
        "reduced file -> multibody codes and other tools",
        "flexgram export out/rack.rom.h5 --to exudyn -o rack.npz\n"
        "  flexgram export out/rack.rom.h5 --to sid --dialect dlr -o rack.SID_FEM",
        _export_options,
        _export,
    ),
    "hotspots": (
        "where the stress of a reduced body is largest per unit of a load",
        "flexgram hotspots rom.h5\n  flexgram hotspots rom.h5 --input gas.p --count 3",
        _hotspots_options,
        _hotspots,
    ),
    "frf": (
        "frequency responses between ports: table, Bode plot, universal file",
        "flexgram frf rom.h5 --pair upper.fz=lower.fz --rate acceleration -o frf.png\n"
        "  flexgram frf rom.h5 --pair upper.fz=lower.fz --measured test.unv -o both.png",
        _frf_options,
        _frf,
    ),
    "couple": (
        "reduced files of several bodies -> one, with joints and springs",
        "flexgram couple crank.rom.h5 rod.rom.h5 --join crank.pin=rod.big:x,y,z,rx,ry -o ab.rom.h5",
        _couple_options,
        _couple,
    ),
    "simulate": (
        "response of a reduced body to forces over time",
        "flexgram simulate out/rack.rom.h5 --force 'upper.fz=-1e4*sin(20*pi*t)' "
        "--time 0,1,1001 -o rack.csv",
        _simulate_options,
        _simulate,
    ),
}  # fmt: skip
