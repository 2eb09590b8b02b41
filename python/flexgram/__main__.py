"""Command line of the Python package: ``python3 -m flexgram import|plot``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from flexgram.description import BodyError, import_body


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors are one line on standard error and exit status 1."""
    parser = argparse.ArgumentParser(
        prog="python3 -m flexgram",
        description="Prepares bodies for the program flexgram and shows its results.",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    importer = commands.add_parser(
        "import",
        help="YAML description and mesh -> body file",
        epilog="example: python3 -m flexgram import meshes/rack.yaml -o out/rack.h5",
    )
    importer.add_argument("description", type=Path, help="YAML file, see meshes/rack.yaml")
    importer.add_argument("-o", "--output", type=Path, required=True, help="body file to write")
    plotter = commands.add_parser(
        "plot",
        help="sweep file (and reduced file) -> picture",
        epilog="example: python3 -m flexgram plot sweep.h5 --rom rack.rom.h5 -o rack.png",
    )
    plotter.add_argument("sweep", type=Path, help="file that flexgram sweep wrote")
    plotter.add_argument("--rom", type=Path, help="reduced file, for its Gramian eigenvalues")
    plotter.add_argument("-o", "--output", type=Path, required=True, help=".png, .svg or .pdf")
    options = parser.parse_args(arguments)
    try:
        if options.command == "import":
            counts = import_body(options.description, options.output)
            print(f"  {options.output}: {counts['points']} nodes, {counts['elements']} elements")
            for name, facts in counts["interfaces"].items():
                at = ", ".join(f"{x:.6g}" for x in facts["position"])
                print(f"  interface {name}: {facts['coupling']}, {facts['nodes']} nodes, "
                      f"reference at ({at}) m")  # fmt: skip
                if facts["distance"] > 3 and facts["nodes"] > 1:
                    print(f"  warning: the reference of {name} is {facts['distance']:.0f} sizes of "
                          "its node set away from its middle: right units?")  # fmt: skip
        else:
            from flexgram.plots import plot_sweep  # matplotlib is slow to load

            plot_sweep(options.sweep, options.output, options.rom)
            print(f"  wrote {options.output}")
    except (BodyError, OSError) as error:
        print(f"flexgram: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
