"""``flexgram view``: a body, a mesh or a reduced body in the browser."""

from __future__ import annotations

import argparse
import os
import tempfile
import webbrowser
from pathlib import Path

import h5py

from flexgram.basics import BodyError, say


def view_options(parser: argparse.ArgumentParser) -> None:
    """Arguments."""
    parser.add_argument("file", type=Path, help="body, mesh or reduced file")
    parser.add_argument(
        "-o", "--output", type=Path, help=".html file to write; default: shown in the browser"
    )


def run_view(options: argparse.Namespace) -> None:
    """Write the page, and show it where no file is named for it."""
    from flexgram.pictures.report import write_report
    from flexgram.pictures.view import write_view

    if not options.file.exists():
        raise BodyError(f"{options.file}: no such file")
    output = options.output
    if output is None:
        output = Path(tempfile.mkdtemp(prefix="flexgram-")) / f"{options.file.stem}.html"
    if _is_reduced(options.file):
        for line in write_report(options.file, output).left:
            say(f"  left out {line}")
    else:
        write_view(options.file, output)
    say(f"  wrote {output}")
    if options.output is None and not (_has_screen() and webbrowser.open(output.as_uri())):
        say("  no browser was found: open this file in one")


def _has_screen() -> bool:
    """Whether a browser would be one of windows: others would take the terminal."""
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))


def _is_reduced(path: Path) -> bool:
    if not h5py.is_hdf5(path):
        return False
    with h5py.File(path) as file:
        return "error" in file and "M" in file
