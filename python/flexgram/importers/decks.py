"""Decks of FE codes that flexgram assembles: CalculiX, Abaqus, Nastran."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError
from flexgram.body.damping import by_ratio
from flexgram.importers.fe import Interface
from flexgram.importers.mesh import interfaces_of

#: Endings of Nastran's bulk data.
BULK_DATA = (".bdf", ".nas", ".dat")


def import_deck(
    deck: str | Path,
    output: str | Path,
    interfaces: Mapping[str, str] | Sequence[Interface],
    *,
    units: str = "SI",
    alpha: float | None = None,
    beta: float | None = None,
    eta: float | None = None,
    zeta: str | None = None,
    loads: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    deck_loads: bool = False,
    step: int | None = None,
    merge: float | None = None,
    keep_repeated: bool = False,
    spin: Mapping[str, Any] | None = None,
    preload: Mapping[str, float] | None = None,
    ignore: Collection[str] = (),
    abaqus: bool = False,
) -> dict[str, Any]:
    """Turn a deck of CalculiX or Abaqus (``.inp``) or of Nastran (``.bdf``, ``.nas``, ``.dat``)
    into a body file, assembled by flexgram.

    Parameters
    ----------
    deck : str or Path
        With materials, sections and supports; numbers and sets of nodes are those of the deck.
    output : str or Path
        Body file to write.
    interfaces : mapping, or sequence of Interface
        Name -> coupling and nodes, as on the command line: ``{"eye": "rigid NSET:EYE"}``.
    units : str
        Of the deck: ``SI``, ``mm-t-s``, ``mm-kg-s``, ``in-lbf-s`` or ``ft-lbf-s``.
    alpha, beta, eta : float, optional
        Damping, instead of that of the deck.
    zeta : str, optional
        A damping ratio at two frequencies instead of alpha and beta: ``"1%,50,2000"``.
    loads, outputs, spin, preload : mapping, optional
        As in a YAML description.
    deck_loads : bool
        Whether the loads of the deck become inputs.
    step : int, optional
        Of a CalculiX deck: whose supports count.
    merge : float, optional
        Nodes no farther apart than this, in units of the deck, become one.
    keep_repeated : bool
        Elements with the same nodes count each, instead of being refused.
    ignore : collection of str
        Cards of Nastran that are left out.
    abaqus : bool
        Whether Abaqus wrote the deck, where it means something else than CalculiX.

    Returns
    -------
    dict
        As ``import_body``, and ``remarks``: what was left out.

    Raises
    ------
    BodyError
        With the place and what was expected.

    Examples
    --------
    >>> counts = flexgram.import_deck("bar.inp", "bar.h5", {"end": "rigid NSET:END"})
    >>> counts["elements"]
    24
    """
    from flexgram.importers.assemble import assemble_deck
    from flexgram.importers.nastran_bulk import assemble_bulk

    alpha, beta = by_ratio(zeta, alpha, beta)
    more: dict[str, Any] = {
        "units": units,
        "alpha": alpha,
        "beta": beta,
        "eta": eta,
        "loads": loads,
        "outputs": outputs,
        "deck_loads": deck_loads,
        "merge": merge,
        "keep_repeated": keep_repeated,
        "spin": spin,
        "preload": preload,
    }
    named = interfaces_of(interfaces)
    if Path(deck).suffix.lower() in BULK_DATA:
        if step is not None or abaqus:
            raise BodyError(f"{deck}: step and abaqus are for decks of CalculiX and Abaqus")
        return assemble_bulk(Path(deck), output, named, ignore=ignore, **more)
    if ignore:
        raise BodyError(f"{deck}: ignore is for bulk data of Nastran")
    return assemble_deck(Path(deck), output, named, step=step, abaqus=abaqus, **more)
