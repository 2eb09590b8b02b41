"""Command line of the Python package: ``flexgram import|info|report|...``."""

from __future__ import annotations

import argparse
import difflib
import os
import shutil
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from flexgram.basics import BodyError, be_quiet, expect_kept
from flexgram.cli.commands import COMMANDS
from flexgram.cli.import_command import SHORT_HELP

#: Verbs of the compiled program.
PROGRAM_VERBS = ("reduce", "certify", "cut", "sweep", "plan", "assemble")


def become_program(arguments: list[str]) -> None:
    """Replace this process by the program of the same environment, as ``flexgram`` alone is."""
    beside = Path(sys.executable).parent / "flexgram"
    program = str(beside) if os.access(beside, os.X_OK) else shutil.which("flexgram")
    if program is None:
        raise BodyError(
            f"{arguments[0]} is a verb of the program flexgram, which is not beside "
            f"{sys.executable} and not in PATH (scripts/build, or pip install .)"
        )
    os.execv(program, [program, *arguments])


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
        if out.is_file():
            expect_kept(out, *files.values())


class Parser(argparse.ArgumentParser):
    """Ends with one message and status 1 for a wrong command line, as the program does: its 2 says
    that a tolerance is not met."""

    def error(self, message: str) -> NoReturn:
        self.exit(1, f"flexgram: {message} ({self.prog} --help)\n")

    def refuse(self, words: Sequence[str]) -> NoReturn:
        """End with the first of the words that nothing takes, and the option that is near it."""
        word = words[0]
        known = [name for action in self._actions for name in action.option_strings]
        near = difflib.get_close_matches(word.split("=")[0], known, 1)
        if word.startswith("-"):
            self.error(f"unknown option {word}" + (f": did you mean {near[0]}?" if near else ""))
        self.error(f"stray word {word}: an option takes one word, lists have commas")


#: How much the program prints; these verbs have no plan.
LEVELS = ("-v", "-vv", "-q")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors of its input are one line on standard error and exit status 1.

    These commands are serial: under mpirun the first rank does the work, the others are done.
    """
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in PROGRAM_VERBS:
        try:
            become_program(words)
        except (BodyError, OSError) as error:
            print(f"flexgram: {error}", file=sys.stderr)
            return 1
    if mpi_rank() > 0:
        return 0
    parser = Parser(
        prog="flexgram",
        description="From FE codes to body files, and from reduced bodies to multibody codes and "
        "pictures. The reduction itself: flexgram.reduce in Python, or the verbs of the program: "
        f"{', '.join(PROGRAM_VERBS)}.",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    work, parsers = {}, {}
    for name, (what, example, describe, run) in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=what,
            description=what,
            epilog=f"example:\n  {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if words[:1] == [name]:  # options of others need modules that take time to load
            describe(command)
        work[name], parsers[name] = run, command
    helps = ("-help", "--help-all")
    if words[:1] == ["import"] and {"-h", "--help"} & set(words):
        print(SHORT_HELP, end="")
        return 0
    taken = ["--help" if word in helps else word for word in words if word not in LEVELS]
    options, others = parser.parse_known_args(taken)
    if others:
        parsers[options.command].refuse(others)
    if "-q" in words:
        be_quiet()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda text, *_, **__: print(f"warning: {text}", file=sys.stderr)
            keep_inputs(options)
            work[options.command](options)
    except (BodyError, OSError) as error:
        print(f"flexgram: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
