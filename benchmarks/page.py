"""docs/benchmarks.md of benchmarks/results: a table for each NAME.csv below NAME.md."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

RESULTS = Path(__file__).resolve().parent / "results"
PAGE = RESULTS.parents[1] / "docs" / "benchmarks.md"
HEAD = """# Measured

Made by `benchmarks/page` of `benchmarks/results`; each section names the command that measures it.
Times on a virtual machine with two cores, one rank and one BLAS thread unless said, medians.
"""
#: Sections in this order; others follow by name.
FIRST = ("methods", "orders", "audit", "fuzz", "kills", "peers", "paper", "assembly", "importing")


def short(cell: str) -> str:
    """Three digits of a measured number; all else as it is."""
    try:
        return f"{float(cell):.3g}" if "." in cell else cell
    except ValueError:
        return cell


def table(path: Path) -> str:
    """A CSV file as a Markdown table."""
    with path.open(newline="") as file:
        rows = [[short(cell) for cell in row] for row in csv.reader(file)]
    rows.insert(1, ["---"] * len(rows[0]))
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def page() -> str:
    names = sorted(path.stem for path in RESULTS.glob("*.md"))
    names.sort(key=lambda name: FIRST.index(name) if name in FIRST else len(FIRST))
    sections = []
    for name in names:
        text = (RESULTS / f"{name}.md").read_text().rstrip()
        data = RESULTS / f"{name}.csv"
        sections.append(text + "\n" + ("\n" + table(data) if data.exists() else ""))
    return HEAD + "\n" + "\n".join(sections)


if __name__ == "__main__":
    if "--check" in sys.argv:
        if not PAGE.exists() or PAGE.read_text() != page():
            sys.exit("docs/benchmarks.md is not what benchmarks/results makes: benchmarks/page")
    else:
        PAGE.write_text(page())
