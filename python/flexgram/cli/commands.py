"""The commands of ``flexgram``: their options and their work."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, expect_kept, say
from flexgram.cli.campbell_command import campbell_options, run_campbell
from flexgram.cli.completion import SHELLS, script
from flexgram.cli.import_command import import_body_file, import_options
from flexgram.cli.port_commands import (
    couple_options,
    frf_options,
    hotspots_options,
    modes_options,
    run_couple,
    run_frf,
    run_hotspots,
    run_modes,
)
from flexgram.cli.simulate_command import run_simulate, simulate_options
from flexgram.cli.view_command import run_view, view_options


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
        from flexgram.pictures.plots import plot_sweep  # matplotlib is slow to load

        if not options.output.suffix:
            raise BodyError(
                f"-o {options.output}: a sweep is one picture: name a .png, .svg or .pdf"
            )
        plot_sweep(options.source, options.output, options.rom)
        say(f"  wrote {options.output}")
        return
    from flexgram.pictures import figures
    from flexgram.reduced_model import ReducedModel

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
        "says of the response to it; the stress of that from rest",
    )
    parser.add_argument(
        "--motion",
        type=Path,
        help="elastic coordinates over time that a multibody code wrote, a line t,q1,q2,... for "
        "each moment (the file of EXUDYN's SensorNode): the stress of that motion",
    )
    parser.add_argument(
        "--measured", type=Path, help="universal file of a test: its modes beside the body's"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help=".html file to write")


def _report(options: argparse.Namespace) -> None:
    from flexgram.pictures.report import write_report

    made = write_report(
        options.rom,
        options.output,
        body=options.body,
        sweep=options.sweep,
        ports=_pairs(options.port),
        loads=options.loads,
        motion=options.motion,
        measured=options.measured,
    )
    for line in made.left:
        say(f"  left out {line}")
    for words in made.told:
        say(f"  {words}")
    say(f"  wrote {options.output}")


#: Closed formats of multibody codes, and what others may lead there.
CLOSED = {
    **dict.fromkeys(("mnf", "adams"), "Adams"),
    **dict.fromkeys(("rfi", "recurdyn"), "RecurDyn"),
    **dict.fromkeys(("fbi", "simpack"), "Simpack"),
}


def _format(word: str) -> str:
    """The name of a format, in small letters."""
    name = word.lower()
    if name in CLOSED:
        raise argparse.ArgumentTypeError(
            f"{word}: the flexible bodies of {CLOSED[name]} are closed files, which flexgram does "
            "not write; it may import op4, nastran, sid or fmu (not tried; docs/exports.md)"
        )
    return name


def _export_options(parser: argparse.ArgumentParser) -> None:
    from flexgram.exporters import FORMATS
    from flexgram.exporters.sid import DIALECTS

    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument(
        "--to",
        required=True,
        type=_format,
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
    parser.add_argument(
        "--damping",
        choices=("modal", "rayleigh"),
        help="of a body with a loss factor (eta), which exists in frequency only: viscous damping "
        "in its place, eta/2 of each mode, or alpha and beta fitted to it; the error is printed",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write")


def _export(options: argparse.Namespace) -> None:
    from flexgram.exporters import export, keeps_parameters
    from flexgram.model.internal_states import InternalStates
    from flexgram.reduced_model import ReducedModel

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
    known = model.system.parameters
    if options.damping:
        from flexgram.model.equivalent_damping import with_viscous_damping

        in_time = options.to in ("state-space", "fmu", "fmu3")
        lost, keeps = model.system.loss, in_time and bool(model.system.timeless)
        model, error = with_viscous_damping(model, options.damping, keep_relaxation=keeps)
        if keeps and model.system.loss:
            say(f"  {options.to} keeps {model.system.loss}")
            lost = "the loss factors"
        say(
            f"  {options.damping} damping instead of {lost} changes H by up to {error:.1e} at the "
            "frequencies looked at"
        )
        if in_time and not keeps:
            say(f"  note: without --damping, {options.to} keeps this relaxation as it is")
    if known and keeps_parameters(model, options.to):
        say(f"  parameters of the FMU: damping_factor, {', '.join(known)}")
    elif known:
        now = ", ".join(f"{name} = {law.value:g}" for name, law in known.items())
        say(f"  with {now}, present values (flexgram at takes others)")
        model = model.at()
    if options.to in ("state-space", "fmu", "fmu3"):
        system = model.system.in_time()
        if states := InternalStates.of(system.terms, system.order).count:
            say(
                f"  Prony terms have {states} internal states, beside the {2 * system.order} of "
                "coordinates and velocities"
            )
    target = export(model, options.output, options.to, **extra)
    say(f"  wrote {target}: order {model.order}, {len(model.inputs)} inputs, {model.claim}")
    for warning in model.provenance.warnings:
        say(f"  warning of the reduction: {warning}")
    if options.to in ("fmu", "fmu3", "state-space") and model.frame.rigid_modes:
        say("  note: the file holds for small motions and small rotations of this free body")


def _at_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file of a body with parameters")
    parser.add_argument(
        "values", nargs="+", metavar="NAME=VALUE", help="of parameters, in SI units: E_rubber=2e6"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="reduced file to write")


def _at(options: argparse.Namespace) -> None:
    from flexgram.reduced_model import ReducedModel

    model = ReducedModel.load(options.rom)
    expect_kept(options.output, options.rom)
    values = {}
    for word in options.values:
        name, _, value = word.partition("=")
        try:
            values[name] = float(value)
        except ValueError:
            raise BodyError(f"{word}: expected NAME=VALUE") from None
    one = model.at(**values)
    one.save(options.output)
    say(f"  wrote {options.output}: order {one.order}, {one.claim}")


def _info_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="body, reduced or sweep file")


def _info(options: argparse.Namespace) -> None:
    from flexgram.cli.info import describe

    for line in describe(options.file):
        say(f"  {line}")


def _completion_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS)


def _completion(options: argparse.Namespace) -> None:
    parsers = {}
    for verb, (_, _, describe, _) in COMMANDS.items():
        parsers[verb] = argparse.ArgumentParser()
        describe(parsers[verb])
    say(script(options.shell, parsers).rstrip())


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
    "view": (
        "show a body, a mesh or a reduced body in the browser",
        "flexgram view out/rack.h5\n  flexgram view lever.msh\n  flexgram view out/rack.rom.h5",
        view_options,
        run_view,
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
    "at": (
        "reduced file of a body with parameters -> the same at given values",
        "flexgram at mounts.rom.h5 E_rubber=2e6 -o soft.rom.h5",
        _at_options,
        _at,
    ),
    "campbell": (
        "natural frequencies, damping and whirl of a reduced body over its speed",
        "flexgram campbell rotor.rom.h5 --orders 1,2 -o campbell.png",
        campbell_options,
        run_campbell,
    ),
    "hotspots": (
        "where the stress of a reduced body is largest per unit of a load",
        "flexgram hotspots rom.h5\n  flexgram hotspots rom.h5 --input gas.p --count 3",
        hotspots_options,
        run_hotspots,
    ),
    "frf": (
        "frequency responses between ports: table, Bode plot, universal file",
        "flexgram frf rom.h5 --pair upper.fz=lower.fz --rate acceleration -o frf.png\n"
        "  flexgram frf rom.h5 --pair upper.fz=lower.fz --measured test.unv -o both.png",
        frf_options,
        run_frf,
    ),
    "modes": (
        "natural modes of a body, compared with measured ones: table, universal file, MAC",
        "flexgram modes rom.h5 -o modes.unv\n"
        "  flexgram modes body.h5 --band 10,500\n"
        "  flexgram modes rom.h5 --measured test.unv -o mac.png",
        modes_options,
        run_modes,
    ),
    "couple": (
        "reduced files of several bodies -> one, with joints and springs",
        "flexgram couple crank.rom.h5 rod.rom.h5 --join crank.pin=rod.big:x,y,z,rx,ry -o ab.rom.h5",
        couple_options,
        run_couple,
    ),
    "simulate": (
        "response of a reduced body to forces over time",
        "flexgram simulate out/rack.rom.h5 --force 'upper.fz=-1e4*sin(20*pi*t)' "
        "--time 0,1,1001 -o rack.csv",
        simulate_options,
        run_simulate,
    ),
    "completion": (
        "script that makes bash or zsh complete flexgram",
        "source <(flexgram completion bash)",
        _completion_options,
        _completion,
    ),
}
