"""One body reduced in every way that there is."""

from __future__ import annotations

from pathlib import Path

from conftest import run
from flexgram import ReducedModel


def in_every_way(
    body: Path, band: tuple[float, float], order: int, ranks: int
) -> tuple[str, ReducedModel, ReducedModel, ReducedModel]:
    """What ``reduce`` says to a tolerance of 1e-6, its result, that of ``certify`` and ``cut``, and
    that of ``pod`` with so many vectors."""
    out, medium, cut, pod = (body.with_suffix(f".{x}.h5") for x in ("rom", "medium", "cut", "pod"))
    asked = ("-body", body, "-mor_band_hz", "{},{}".format(*band))
    tol = ("-mor_tol", "1e-6")
    said = run("reduce", *asked, *tol, "-mor_out", out, ranks=ranks).out
    run("certify", *asked, *tol, "-mor_medium_out", medium, ranks=ranks)
    run("cut", "-medium", medium, *tol, "-mor_out", cut, ranks=ranks)
    vectors = ("-mor_method", "pod", "-mor_order", str(order))
    run("reduce", *asked, *vectors, "-mor_out", pod, ranks=ranks)
    rom, again, sampled = (ReducedModel.load(path) for path in (out, cut, pod))
    assert rom.met and rom.kind == again.kind == "certified" and again.met
    return said, rom, again, sampled
