"""Nastran bulk data assembled by flexgram, read by pyNastran.

Solids, shells and straight beams become elements, CONM2 masses, CELAS, CDAMP and CBUSH springs,
CROD rods, RBE2 rigid and RBE3 distributing interfaces, SPC supports, and loads of cases inputs if
they are asked for. Cards that say something else of stiffness or mass are refused by name, with
their count, unless they are to be ignored.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, naming
from flexgram.body.description import import_description
from flexgram.importers.alone import hold_untouched
from flexgram.importers.fe import Interface, check_damping
from flexgram.importers.mesh import describe_interfaces, further_keys
from flexgram.importers.nastran_alone import grids_alone
from flexgram.importers.nastran_deck import BulkDeck
from flexgram.importers.nastran_elements import Elements
from flexgram.importers.nastran_equations import Equations
from flexgram.importers.nastran_loads import LoadSets
from flexgram.importers.nastran_points import PointElements
from flexgram.importers.nastran_rigid import RigidElements
from flexgram.importers.nastran_welds import Welds


def assemble_bulk(
    path: Path,
    output: str | Path,
    interfaces: Sequence[Interface],
    *,
    units: str = "SI",
    alpha: float | None = None,
    beta: float | None = None,
    eta: float | None = None,
    loads: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    merge: float | None = None,
    keep_repeated: bool = False,
    spin: Mapping[str, Any] | None = None,
    preload: Mapping[str, float] | None = None,
    ignore: Collection[str] = (),
    deck_loads: bool = False,
) -> dict[str, Any]:
    """Write a mesh body of bulk data.

    Parameters
    ----------
    path : Path
        ``.bdf``, ``.nas``, ``.dat``: a deck, or its bulk data alone.
    output : str or Path
        Body file to write.
    interfaces : sequence of Interface
        Beside those of RBE2 and RBE3; node numbers are those of grids.
    units : str
        Of the deck: ``SI``, ``mm-t-s``, ``mm-kg-s``, ``in-lbf-s`` or ``ft-lbf-s``.
    ignore : collection of str
        Cards to pass over though they say something of stiffness or mass.
    deck_loads : bool
        Make inputs of the deck's loads too (``nastran_loads.LoadSets``).

    Other parameters are those of ``import_mesh``.

    Returns
    -------
    dict
        As ``import_body``, with ``remarks``.

    Raises
    ------
    BodyError
        For a deck that says more of K or M than is followed here.
    """
    check_damping(alpha, beta, eta)
    bulk = _Bulk(path, {card.upper() for card in ignore})
    content = bulk.describe()
    named = describe_interfaces(interfaces)
    for entry in (*named.values(), *(loads or {}).values(), *(outputs or {}).values()):
        bulk.number(entry)
    for name in named:
        if name in content["interfaces"]:
            raise BodyError(f"interface {name} is given twice: it is one of the deck's")
    content["interfaces"] |= named
    if not content["interfaces"]:
        raise BodyError(
            f"{path}: name an interface (--rigid, --node): it has no RBE2 or RBE3 that is one "
            "(an RBE2 of some components becomes equations)"
        )
    content |= {
        "name": path.stem,
        "units": units,
        "loads": {name: dict(entry) for name, entry in (loads or {}).items()},
        "outputs": {name: dict(entry) for name, entry in (outputs or {}).items()},
        "damping": {
            key: value
            for key, value in (
                ("alpha", alpha),
                ("beta", beta),
                ("eta", bulk.deck.eta() if eta is None else eta),
            )
            if value is not None
        },
    }
    sets = LoadSets(bulk.deck, bulk.elements, bulk.rigid)
    if not deck_loads:
        sets.name_them()
    for name, entry in sets.describe().items() if deck_loads else ():
        if name in content["loads"]:
            raise BodyError(f"load {name} is given twice: it is one of the deck's")
        content["loads"][name] = entry
    content |= further_keys(merge, bulk.elements.repeats() or keep_repeated, spin, preload)
    with naming(path):
        counts = import_description(
            content, str(path), output, inputs=[path], mesh=bulk.elements.mesh()
        )
    return {**counts, "remarks": bulk.deck.remarks}


class _Bulk:
    """A deck as a description."""

    def __init__(self, path: Path, ignore: set[str]) -> None:
        self.deck = deck = BulkDeck(path, ignore)
        deck.expect_known()
        self.elements = elements = Elements(deck)
        for number, element in sorted(deck.model.elements.items()):
            elements.add(int(number), element)
        if not elements.groups:
            raise BodyError(f"{path}: no solids, shells or beams")
        elements.take_alone(grids_alone(deck, elements))
        elements.take_scalars()
        self.equations = Equations(deck, elements)
        self.points = PointElements(deck, elements, self.equations)
        for number, element in elements.later:
            self.points.add_spring(number, element)
        for number, mass in sorted(deck.model.masses.items()):
            self.points.add_mass(int(number), mass)
        self.welds = Welds(deck, elements, self.points, self.equations)
        self.rigid = RigidElements(deck, elements, self.points, self.equations)
        self.equations.arms()
        self.equations.read_mpc(self.rigid.references)

    def describe(self) -> dict[str, Any]:
        content: dict[str, Any] = {
            "materials": self.elements.materials.entries,
            "sections": self.elements.sections,
            "regions": self.elements.regions,
            "masses": self.points.masses,
            "springs": self.points.springs,
            "supports": self.rigid.supports,
            "interfaces": self.rigid.interfaces,
            "equations": self.equations.entries,
        }
        if not (self.deck.param("COUPMASS") or 0) > 0:
            content["mass_integration"] = "lumped"
            self.deck.remarks.append(
                "mass is lumped, as in Nastran without PARAM,COUPMASS,1: rotations of shells and "
                "CBAR have none"
            )
        alone = [self.deck.at(label) + 1 for label in sorted(self.elements.alone)]
        alone += [*self.elements.scalars.values(), *self.points.scalars.nodes, *self.welds.nodes]
        if alone:
            content["nodes_alone"] = alone
            hold_untouched(content, self.elements.places())
        return content

    def number(self, entry: dict[str, Any]) -> None:
        """Numbers from 1 for labels of grids."""
        for key in ("nodes", "relative_to"):
            if not isinstance(entry.get(key), list):
                continue
            for label in map(int, entry[key]):
                k = self.deck.at(label) + 1
                if k in self.rigid.references:
                    raise BodyError(
                        f"{self.deck.path}: grid {label} is that of {self.rigid.references[k]}: "
                        "name no other interface there"
                    )
                if label not in self.elements.used:
                    raise BodyError(f"{self.deck.path}: grid {label} belongs to no element")
            entry[key] = [self.deck.at(int(label)) + 1 for label in entry[key]]
