"""The commands of ``flexgram``: their options and their work."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, written_aside

COUPLINGS = {
    "rigid": "all nodes follow a reference node with six dofs (RBE2)",
    "distributing": "force averaging (RBE3)",
    "node": "the dofs of the nodes themselves",
    "rows": "rows of the matrices, numbers from 1: name=1,2,3",
}


#: Endings of files that are meshes and nothing else.
MESHES = (".msh", ".vtu", ".vtk", ".med", ".xdmf", ".xmf", ".exo", ".e", ".cgns", ".unv", ".h5m",
          ".ugrid", ".su2", ".mesh", ".meshb", ".vol")  # fmt: skip


def say(line: str) -> None:
    """Print; where nobody listens any more (``| head``) the work goes on."""
    try:
        print(line, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _Named(argparse.Action):
    """Collects --rigid, --distributing, … in the order of the command line."""

    def __call__(self, parser: Any, namespace: Any, value: Any, option: Any = None) -> None:
        found = getattr(namespace, "interfaces", None) or []
        namespace.interfaces = [*found, (str(option).lstrip("-"), value)]


def _import_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        help="YAML description of a mesh, a mesh (.msh, .vtu, .med, with --material), or a file "
        "of an FE code: job.inp, job.sti (CalculiX), job_STIF1.mtx (Abaqus), .pch, .op4 "
        "(Nastran), .full (ANSYS), .mat, .mtx (MatrixMarket), PETSc binary",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="body file to write")
    from flexgram.importers import FORMATS  # light: NumPy and SciPy

    parser.add_argument("--format", choices=FORMATS, help="default: by the file's name")
    parser.add_argument("--deck", type=Path, help="model with nodes and node sets")
    parser.add_argument("--mass", type=Path, help="mass matrix, where the source holds K only")
    parser.add_argument("--damping", type=Path, help="damping matrix in a file of its own")
    parser.add_argument("--inputs", type=Path, help="input matrix B in a file of its own (PETSc)")
    parser.add_argument("--mapping", type=Path, help="ANSYS node map of HBMAT or *EXPORT")
    parser.add_argument(
        "--run-ccx",
        action="store_true",
        help="run CalculiX on the deck first, with a matrix-storage step in place of its steps",
    )
    for coupling, what in COUPLINGS.items():
        parser.add_argument(
            f"--{coupling}", metavar="NAME=WHERE", action=_Named, help=f"interface: {what}"
        )
    parser.add_argument(
        "--material",
        help="of a mesh without YAML: steel, aluminium, titanium, cast-iron, or "
        "E=210e9,nu=0.3,rho=7850 in its units",
    )
    parser.add_argument("--units", help="of the files: SI (default), mm-t-s, mm-kg-s")
    for name, unit in (("alpha", "[1/s]"), ("beta", "[s]"), ("eta", "loss factor")):
        parser.add_argument(f"--{name}", type=float, help=f"damping {unit}")


def _lengths(numbers: Any) -> str:
    return " × ".join(f"{x:.4g}" for x in numbers)


def _interface(facts: dict[str, Any]) -> str:
    """An interface in a line: coupling, nodes, and where its reference is and why there."""
    at = ", ".join(f"{x:.6g}" for x in facts["position"])
    why = f": {facts['middle']}" if facts["middle"] else ""
    return f"{facts['coupling']}, {facts['nodes']} nodes, reference at ({at}) m{why}"


def _say_mesh(options: argparse.Namespace, counts: dict[str, Any]) -> None:
    say(f"  {options.output}: {counts['points']} nodes, {counts['elements']} elements")
    say(f"  it measures {_lengths(counts['extent'])} m")
    for name, facts in counts["interfaces"].items():
        say(f"  interface {name}: {_interface(facts)}")
        if facts["distance"] > 3 and facts["nodes"] > 1:
            say(
                f"  warning: the reference of {name} is {facts['distance']:.0f} sizes of "
                "its node set away from its middle: right units?"
            )
    if {"tetra"} & set(counts["kinds"]):
        say("  note: linear tetrahedra are too stiff; second-order ones (tetra10) converge faster")
    if max(counts["extent"]) > 15 and counts["units"] == "SI":
        say("  note: is the mesh in millimetres (units mm-t-s)?")


def _import_mesh(options: argparse.Namespace, named: list[tuple[str, str]]) -> None:
    """A mesh of one material, described on the command line."""
    from flexgram.importers import parse
    from flexgram.meshbody import import_mesh

    if options.material is None:
        raise BodyError(
            f"{options.source} is a mesh: name what it is made of and its interfaces (--material "
            "steel --rigid eye=NSET:EYE), or describe it in YAML (several materials, supports, "
            "beams), see meshes/rack.yaml"
        )
    for name in ("format", "deck", "mass", "damping", "inputs", "mapping", "run_ccx"):
        if getattr(options, name):
            raise BodyError(f"--{name.replace('_', '-')} is nothing for a mesh")
    counts = import_mesh(
        options.source,
        options.output,
        options.material,
        [parse(*pair) for pair in named],
        units=options.units or "SI",
        alpha=options.alpha,
        beta=options.beta,
        eta=options.eta,
    )
    _say_mesh(options, counts)


def _import(options: argparse.Namespace) -> None:
    named = getattr(options, "interfaces", None) or []
    if options.source.suffix.lower() in (".yaml", ".yml"):
        from flexgram.description import import_body

        every = ("material", "format", "deck", "mass", "damping", "inputs", "mapping", "run_ccx",
                 "units", "alpha", "beta", "eta")  # fmt: skip
        given = [name.replace("_", "-") for name in every if getattr(options, name)]
        given += [coupling for coupling, _ in named]
        if given:
            raise BodyError(
                f"--{given[0]}: interfaces, units and damping of a meshed body stand "
                f"in its YAML file {options.source}, not on the command line"
            )
        _say_mesh(options, import_body(options.source, options.output))
        return
    if options.material is not None or options.source.suffix.lower() in MESHES:
        _import_mesh(options, named)
        return
    from flexgram.importers import check_damping, import_matrices, parse, read

    interfaces = [parse(*pair) for pair in named]  # before ccx runs for minutes
    check_damping(options.alpha, options.beta, options.eta)
    fe = read(
        options.source,
        format=options.format,
        deck=options.deck,
        mass=options.mass,
        damping=options.damping,
        inputs=options.inputs,
        mapping=options.mapping,
        run_ccx=options.run_ccx,
    )
    facts = import_matrices(
        fe,
        options.output,
        interfaces,
        units=options.units or "SI",
        alpha=options.alpha,
        beta=options.beta,
        eta=options.eta,
    )
    say(f"  {options.output}: n = {facts['rows']}, {facts['nonzeros']:.3g} nonzeros in K as read")
    if "extent" in facts:
        say(f"  it measures {_lengths(facts['extent'])} m")
    if "mass" in facts:
        at = ", ".join(f"{x:.6g}" for x in facts["centre"])
        inertia = ", ".join(f"{facts['inertia'][i, i]:.6g}" for i in range(3))
        say(
            f"  mass {facts['mass']:.6g} kg of the free rows, centre ({at}) m, inertia about it "
            f"{inertia} kg m²"
        )
        left = f"{facts['free']} of 6 rigid motions are free"
        say(f"  {left} (relative energy at most {facts['rigid_energy'].max():.0e})")
    for name, interface in facts["interfaces"].items():
        say(f"  interface {name}: {_interface(interface)}")
    say(
        f"  {len(facts['ports'])} ports: {', '.join(facts['ports'][:12])}"
        f"{' …' if len(facts['ports']) > 12 else ''}"
    )
    for remark in facts["remarks"]:
        say(f"  note: {remark}")


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
    parser.add_argument("-o", "--output", type=Path, required=True, help=".html file to write")


def _report(options: argparse.Namespace) -> None:
    from flexgram.report import write_report

    for line in write_report(
        options.rom,
        options.output,
        body=options.body,
        sweep=options.sweep,
        ports=_pairs(options.port),
    ):
        say(f"  left out {line}")
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
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write")


def _export(options: argparse.Namespace) -> None:
    from flexgram.exporters import export
    from flexgram.reduced import ReducedModel

    if options.dialect and options.to != "sid":
        raise BodyError("--dialect belongs to --to sid")
    extra: dict[str, Any] = {"body": options.body} if options.to in ("exudyn", "vtu") else {}
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


def _simulate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument(
        "--force",
        action="append",
        default=[],
        metavar="PORT=f(t)",
        required=True,
        help="force or moment [N, N m] as an expression in t: + - * / ** < >, sin, exp, where, ...",
    )
    parser.add_argument(
        "--time", default="0,1,1001", help="first,last,count [s] (default %(default)s)"
    )
    parser.add_argument("--body", type=Path, help="body file with the mesh, for --xdmf")
    parser.add_argument("--xdmf", type=Path, help="also the motion of the mesh, for ParaView")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help=".csv of t and all outputs"
    )


def _simulate(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.expressions import function_of_time
    from flexgram.reduced import ReducedModel

    model = ReducedModel.load(options.rom, basis=options.xdmf is not None)
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
    y, q = model.simulate(u, t)
    header = "t," + ",".join(model.outputs)
    with written_aside(options.output) as place:
        np.savetxt(place, np.column_stack([t, y]), delimiter=",", header=header, comments="")
    say(f"  wrote {options.output}: {len(t)} times, {len(model.outputs)} outputs")
    if options.xdmf is not None:
        from flexgram.exporters.shapes import write_motion

        write_motion(model, options.xdmf, t, q, body=options.body)
        say(f"  wrote {options.xdmf}")


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
        _import_options,
        _import,
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
    "simulate": (
        "response of a reduced body to forces over time",
        "flexgram simulate out/rack.rom.h5 --force 'upper.fz=-1e4*sin(20*pi*t)' "
        "--time 0,1,1001 -o rack.csv",
        _simulate_options,
        _simulate,
    ),
}  # fmt: skip
