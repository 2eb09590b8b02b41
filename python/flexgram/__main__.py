"""Command line of the Python package: ``python3 -m flexgram import|info|report|...``."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from flexgram.basics import BodyError
from flexgram.commands import COMMANDS


def mpi_rank() -> int:
    """Rank under mpirun or srun, without starting MPI; 0 alone."""
    for name in ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID"):
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return 0


def keep_inputs(options: argparse.Namespace) -> None:
    """Refuse an output that is one of the inputs of the same command."""
    files = {name: value for name, value in vars(options).items() if isinstance(value, Path)}
    for out in [files.pop(name) for name in ("output", "xdmf") if name in files]:
        for given in files.values():
            if out.is_file() and given.exists() and out.samefile(given):
                raise BodyError(f"{out} would replace the input {given}")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors of its input are one line on standard error and exit status 1.

    These commands are serial: under mpirun the first rank does the work, the others are done.
    """
    if mpi_rank() > 0:
        return 0
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
        keep_inputs(options)
        work[options.command](options)
    except (BodyError, OSError) as error:
        print(f"flexgram: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
