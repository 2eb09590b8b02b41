"""Command line of the Python package: ``python3 -m flexgram import|info|...``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexgram.meshfile import BodyError

COUPLINGS = {
    "rigid": "all nodes follow a reference node with six dofs (RBE2)",
    "distributing": "force averaging (RBE3)",
    "node": "the dofs of the nodes themselves",
    "rows": "rows of the matrices, numbers from 1: name=1,2,3",
}


class _Named(argparse.Action):
    """Collects --rigid, --distributing, … in the order of the command line."""

    def __call__(self, parser: Any, namespace: Any, value: Any, option: Any = None) -> None:
        found = getattr(namespace, "interfaces", None) or []
        namespace.interfaces = [*found, (str(option).lstrip("-"), value)]


def _import_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        help="YAML description of a mesh, or a file of an FE "
        "code: job.inp, job.sti (CalculiX), job_STIF1.mtx (Abaqus), .pch, .op4 "
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
    parser.add_argument("--units", default="SI", help="of the files: SI, mm-t-s, mm-kg-s")
    for name, unit in (("alpha", "[1/s]"), ("beta", "[s]"), ("eta", "loss factor")):
        parser.add_argument(f"--{name}", type=float, help=f"damping {unit}")


def _import(options: argparse.Namespace) -> None:
    named = getattr(options, "interfaces", None) or []
    if options.source.suffix.lower() in (".yaml", ".yml"):
        from flexgram.description import import_body

        if named or options.run_ccx or options.deck:
            raise BodyError(
                "interfaces of a meshed body stand in its YAML file, not on the command line"
            )
        counts = import_body(options.source, options.output)
        print(f"  {options.output}: {counts['points']} nodes, {counts['elements']} elements")
        for name, facts in counts["interfaces"].items():
            at = ", ".join(f"{x:.6g}" for x in facts["position"])
            print(
                f"  interface {name}: {facts['coupling']}, {facts['nodes']} nodes, "
                f"reference at ({at}) m"
            )
            if facts["distance"] > 3 and facts["nodes"] > 1:
                print(
                    f"  warning: the reference of {name} is {facts['distance']:.0f} sizes of "
                    "its node set away from its middle: right units?"
                )
        return
    from flexgram.importers import import_matrices, parse, read

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
        [parse(*pair) for pair in named],
        units=options.units,
        alpha=options.alpha,
        beta=options.beta,
        eta=options.eta,
    )
    print(f"  {options.output}: n = {facts['rows']}, {facts['nonzeros']:.3g} nonzeros in K as read")
    if "mass" in facts:
        at = ", ".join(f"{x:.6g}" for x in facts["centre"])
        inertia = ", ".join(f"{facts['inertia'][i, i]:.6g}" for i in range(3))
        print(
            f"  mass {facts['mass']:.6g} kg of the free rows, centre ({at}) m, inertia about it "
            f"{inertia} kg m²"
        )
        left = f"{facts['free']} of 6 rigid motions are free"
        print(f"  {left} (relative energy at most {facts['rigid_energy'].max():.0e})")
    print(
        f"  {len(facts['ports'])} ports: {', '.join(facts['ports'][:12])}"
        f"{' …' if len(facts['ports']) > 12 else ''}"
    )
    for remark in facts["remarks"]:
        print(f"  note: {remark}")


def _plot_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sweep", type=Path, help="file that flexgram sweep wrote")
    parser.add_argument("--rom", type=Path, help="reduced file, for its Gramian eigenvalues")
    parser.add_argument("-o", "--output", type=Path, required=True, help=".png, .svg or .pdf")


def _plot(options: argparse.Namespace) -> None:
    from flexgram.plots import plot_sweep  # matplotlib is slow to load

    plot_sweep(options.sweep, options.output, options.rom)
    print(f"  wrote {options.output}")


#: name: what it does, example, its options, the work
COMMANDS: dict[
    str,
    tuple[str, str, Callable[[argparse.ArgumentParser], None], Callable[[Any], None]],
] = {
    "import": (
        "mesh description or files of an FE code -> body file",
        "python3 -m flexgram import meshes/rack.yaml -o out/rack.h5\n"
        "  python3 -m flexgram import part.inp --run-ccx --units mm-t-s --rigid left=NSET:LEFT "
        "--rigid right=NSET:RIGHT -o part.h5\n"
        "  python3 -m flexgram import job_STIF1.mtx --rigid hub=BOX:0,0,0,1,1,0.01@0.5,0.5,0 "
        "-o body.h5",
        _import_options,
        _import,
    ),
    "plot": (
        "sweep file (and reduced file) -> picture",
        "python3 -m flexgram plot sweep.h5 --rom rack.rom.h5 -o rack.png",
        _plot_options,
        _plot,
    ),
}  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors are one line on standard error and exit status 1."""
    parser = argparse.ArgumentParser(
        prog="python3 -m flexgram",
        description="From FE codes to body files, and from reduced bodies to multibody codes and "
        "pictures. The reduction itself: build/flexgram, or flexgram.reduce in Python.",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    work = {}
    for name, (what, example, describe, run) in COMMANDS.items():
        command = commands.add_parser(
            name, help=what, description=what, epilog=f"example:\n  {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        describe(command)
        work[name] = run
    options = parser.parse_args(arguments)
    try:
        work[options.command](options)
    except (BodyError, OSError, ValueError) as error:
        print(f"flexgram: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
