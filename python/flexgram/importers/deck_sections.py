"""Sections of a CalculiX or Abaqus deck: the mesh by regions, their materials and shells."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.meshfile import AXES, LABELS, SOLIDS
from flexgram.body.orientation import stiffness_places
from flexgram.importers import deck_lines
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import FORMULATIONS, SHELL_KINDS, TAKEN_AS, Deck
from flexgram.importers.deck_distributions import Distribution, distributions_of
from flexgram.importers.deck_materials import Orientation, laminas_of, orientations_of

#: What *ELASTIC gives a material, one of these.
MODULI = {"E", "E1", "stiffness", "viscoelastic"}  # a table holds them
OF_SHELLS = ("SHELL SECTION", "MEMBRANE SECTION")
#: Options of *SHELL SECTION that are followed.
OPTIONS = {
    *("ELSET", "MATERIAL", "OFFSET", "SECTION INTEGRATION", "ORIENTATION", "COMPOSITE"),
    *("SHELL THICKNESS", "CONTROLS", "TEMPERATURE", "POISSON"),  # the last say nothing of it
}


def _sections(job: Job) -> list[tuple[str, Card]]:
    """*SOLID SECTION, *SHELL SECTION and those of beams, each with the name of its region."""
    known = ("SOLID SECTION", *OF_SHELLS, *deck_lines.CARDS)
    cards = [c for c in job.model if c.keyword in known]
    return [(f"section{number}", card) for number, card in enumerate(cards, 1)]


def materials_of_sections(job: Job) -> dict[str, dict[str, float]]:
    """Materials that sections of beams hold themselves."""
    cards = [card for card in job.model if deck_lines.own_material(card)]
    return {deck_lines.own_material(card): deck_lines.general_material(job, card) for card in cards}


def _kind_of(deck: Deck, label: int) -> str:
    """Of elements that a section may be of: solids, shells, beams or trusses."""
    if deck.types[label] in deck_lines.TRUSSES:
        return "trusses"
    if deck.types[label] in deck_lines.BEAMS:
        return "beams"
    return "shells" if deck.elements[label][0] in SHELL_KINDS else "solids"


def sections_of(job: Job, deck: Deck, *, abaqus: bool) -> dict[str, dict[str, Any]]:
    """Entries of ``sections`` of a description, by region."""
    found = _shell_sections(job, deck, abaqus=abaqus)
    for region, card in _sections(job):
        labels = deck.elsets.get(card.options.get("ELSET", "").upper(), [])
        if card.keyword in deck_lines.CARDS:
            found[region] = deck_lines.beam_section(job, card, abaqus=abaqus)
        elif card.keyword == "SOLID SECTION" and labels:
            if _kind_of(deck, labels[0]) == "trusses":
                found[region] = deck_lines.truss_section(job, card)
    return found


def _thicknesses(
    job: Job, deck: Deck, known: Mapping[str, Distribution], card: Card, region: str
) -> dict[int, tuple[str, float]]:
    """Of a shell section whose thickness is a distribution: region and thickness by element."""
    name = card.options.get("SHELL THICKNESS", "").upper()
    if not name:
        return {}
    where = f"{job.path}: *SHELL SECTION, ELSET={card.options.get('ELSET', '')}"
    if name not in known:
        raise BodyError(f"{where}: there is no distribution {name}")
    labels = deck.elsets.get(card.options.get("ELSET", "").upper(), [])
    if not labels:  # mesh_of says so
        return {}
    values = known[name].at(labels, where)[:, 0]
    numbers = {value: k for k, value in enumerate(np.unique(values).tolist(), 1)}
    return {
        label: (f"{region}-{numbers[value]}", value)
        for label, value in zip(labels, values.tolist(), strict=True)
    }


def _parts(region: str, regions: Iterable[str]) -> list[str]:
    """Those that a section became: by thickness and formulation."""
    return [r for r in regions if r.partition("_")[0].partition("-")[0] == region]


def _shell_sections(job: Job, deck: Deck, *, abaqus: bool) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    orientations, known = orientations_of(job), distributions_of(job)
    for region, card in _sections(job):
        if card.keyword not in OF_SHELLS:
            continue
        where = f"{card.place}, ELSET={card.options.get('ELSET', '')}"
        if others := sorted(set(card.options) - OPTIONS):
            raise BodyError(f"{where}: {others[0]} is not supported by --assemble: take --run-ccx")
        rows = [words for words in card.words() if any(words)]
        entry: dict[str, Any] = {"shape": "shell"}
        if "COMPOSITE" in card.options:
            entry["layers"] = [_layer(where, row) for row in rows]
            thickness = sum(layer["thickness"] for layer in entry["layers"])
        else:
            try:
                given = rows[0][0] if rows else ""
                nominal = "SHELL THICKNESS" in card.options  # a table names those of its elements
                entry["thickness"] = thickness = 1.0 if nominal else float(given)
            except ValueError:
                raise BodyError(f"{where}: expected a thickness") from None
        given = card.options.get("OFFSET", "0").upper()
        try:
            offset = {"SPOS": 0.5, "SNEG": -0.5}.get(given)
            offset = float(given) if offset is None else offset
        except ValueError:
            raise BodyError(f"{where}: expected an OFFSET in thicknesses") from None
        entry["offset"] = -offset * thickness  # of the nodes above the middle surface
        if (name := card.options.get("ORIENTATION", "").upper()) or "COMPOSITE" in card.options:
            axes = _orientation(where, orientations, name)
            if axes.is_cylindrical and not abaqus:
                raise BodyError(
                    f"{where}: its orientation is cylindrical, and CalculiX takes it as that of a "
                    "solid, with axis 1 outward: --format abaqus takes the axes in the surface"
                )
            if not axes.varies:
                first = _first_in_surface(axes, abaqus=abaqus and bool(name))
                entry["axis_1"] = axes.at(np.zeros((1, 3)), where)[0, first].tolist()
        found[region] = entry
        for own, thickness in set(_thicknesses(job, deck, known, card, region).values()):
            if "layers" in entry:
                raise BodyError(
                    f"{where}: SHELL THICKNESS scales its layers, which is not supported"
                )
            found[own] = entry | {
                "thickness": thickness,
                "offset": entry["offset"] * thickness,  # that of a thickness of 1
            }
    return found


def _layer(where: str, row: list[str]) -> dict[str, Any]:
    """Thickness, number of points, material, and an angle [degrees] about the normal."""
    row = [*row, "", "", "", ""]
    try:
        layer = {"thickness": float(row[0]), "material": row[2].upper()}
        if row[3]:
            layer["angle"] = float(row[3])
    except ValueError:
        raise BodyError(
            f"{where}: expected layers of a thickness, a number of points, a material, and an "
            "angle; orientations of layers by name are not supported"
        ) from None
    return layer


def _orientation(where: str, orientations: Mapping[str, Orientation], name: str) -> Orientation:
    if name and name not in orientations:
        raise BodyError(f"{where}: there is no orientation {name}")
    return orientations.get(name, Orientation(np.eye(3)))


def _first_in_surface(axes: Orientation, *, abaqus: bool) -> int:
    """The axis that shells take for the first of their material. In Abaqus the one about which an
    orientation turns, or else the first, is the normal, and the next one is taken."""
    return (axes.about + 1) % 3 if abaqus else 0


def turn_elements(
    job: Job, mesh: meshio.Mesh, material_of: dict[str, str], *, abaqus: bool = False
) -> None:
    """Elements of sections whose ORIENTATION is cylindrical, or a distribution, get axes of their
    own, solids at each point of the stiffness as in CalculiX, others at their middle."""
    orientations = orientations_of(job)
    axes: list[Floats] = [np.full((len(block.data), 6), np.nan) for block in mesh.cells]
    for region, card in _sections(job):
        given = orientations.get(card.options.get("ORIENTATION", "").upper())
        if given is None or not given.varies:
            continue
        where = f"{card.place}, ELSET={card.options.get('ELSET', '')}"
        of_shells = card.keyword in OF_SHELLS
        first = _first_in_surface(given, abaqus=abaqus) if of_shells else 0
        for own in _parts(region, material_of):
            for block, chosen in enumerate(mesh.cell_sets[own]):
                if not len(chosen):
                    continue
                kind, nodes = mesh.cells[block].type, mesh.cells[block].data
                formulation = own.partition("_")[2]
                kind += f"/{formulation}" if formulation else ""
                places = stiffness_places(kind, mesh.points[nodes[chosen]])
                labels = np.repeat(mesh.cell_data[LABELS][block][chosen], places.shape[1])
                at = given.at(places.reshape(-1, 3), where, labels.tolist())
                two = np.hstack([at[:, first], at[:, (first + 1) % 3]])
                if kind.partition("/")[0] in SOLIDS:
                    axes[block] = np.full((len(nodes), places.shape[1], 6), np.nan)
                axes[block][chosen] = two.reshape(-1, *axes[block].shape[1:])
    if any(np.isfinite(of_block).any() for of_block in axes):
        mesh.cell_data[AXES] = axes


def turn_materials(
    job: Job, material_of: dict[str, str], materials: dict[str, dict[str, Any]]
) -> None:
    """Solids of orthotropic materials whose section has an ORIENTATION get a material along its
    axes, ``MATERIAL_ORIENTATION``."""
    orientations = orientations_of(job)
    for region, card in _sections(job):
        name = card.options.get("ORIENTATION", "").upper()
        if card.keyword != "SOLID SECTION" or not name:
            continue
        where = f"{job.path}: *SOLID SECTION, ELSET={card.options.get('ELSET', '')}"
        given = _orientation(where, orientations, name)
        if given.varies:
            continue  # turn_elements
        axes = given.at(np.zeros((1, 3)), where)[0]
        for own in _parts(region, material_of):
            material = material_of[own]
            if not {"E1", "stiffness"} & set(materials[material]):
                continue
            turned = f"{material}_{name}"
            along = {"axis_1": axes[0].tolist(), "axis_2": axes[1].tolist()}
            materials[turned] = materials[material] | along
            material_of[own] = turned


def regions_of(
    material_of: Mapping[str, str], sections: Mapping[str, Any]
) -> dict[str, dict[str, str]]:
    """Entries of ``regions`` of a description, of what ``mesh_of`` returns."""
    entries: dict[str, dict[str, str]] = {}
    for region, material in material_of.items():
        entries[region] = {"material": material} if material else {}
        section, _, formulation = region.partition("_")
        if section in sections:
            entries[region]["section"] = section
        if formulation:
            entries[region]["formulation"] = formulation
    return entries


def mesh_of(
    job: Job,
    deck: Deck,
    materials: Mapping[str, Mapping[str, Any]],
    sections: Mapping[str, Mapping[str, Any]],
) -> tuple[meshio.Mesh, dict[str, str], int]:
    """The mesh with a region for each section, the material of each region, and how many elements
    are in several sections, of which the last one counts."""
    plane, distributions = laminas_of(job), distributions_of(job)
    material_of: dict[str, str] = {}
    region_of: dict[int, str] = {}  # of each element
    given = 0
    for region, card in _sections(job):
        name, material = (card.options.get(key, "").upper() for key in ("ELSET", "MATERIAL"))
        where = f"{card.place}, ELSET={name}, MATERIAL={material}"
        of_shells = card.keyword in OF_SHELLS
        material = deck_lines.own_material(card) or material
        made_of = [material]
        if of_shells and "COMPOSITE" in card.options:
            material = ""
            made_of = [layer["material"] for layer in sections[region]["layers"]]
        known = [set(materials.get(one, ())) for one in made_of]
        if not of_shells and material in plane:
            raise BodyError(f"{where}: *ELASTIC, TYPE=LAMINA is of shells, not of solids")
        if lost := sorted({one for one in made_of if one not in materials}):
            name = f"there is no material {lost[0]}" if lost[0] else "it names no material"
            raise BodyError(f"{where}: {name}; there are {', '.join(sorted(materials))}")
        if not deck.elsets.get(name):
            there = ", ".join(sorted(deck.elsets)[:20]) or "none"
            raise BodyError(
                f"{where}: there is no such element set, or it is empty; there are {there}"
            )
        for one, has in zip(made_of, known, strict=True):
            if lacks := [
                card
                for card, there in (("*ELASTIC", bool(MODULI & has)), ("*DENSITY", "rho" in has))
                if not there
            ]:
                raise BodyError(f"{where}: material {one} has no {' and no '.join(lacks)}")
        expected = ("beams",) if card.keyword in deck_lines.CARDS else ("shells",)
        if card.keyword == "SOLID SECTION":
            expected = ("trusses",) if region in sections else ("solids",)
        others = [e for e in deck.elsets[name] if _kind_of(deck, e) not in expected]
        if others:
            raise BodyError(f"{where}: its element {others[0]} is a {deck.types[others[0]]}")
        of_own = _thicknesses(job, deck, distributions, card, region) if of_shells else {}
        for label in deck.elsets[name]:
            written = deck.types[label]
            formulation = FORMULATIONS.get(TAKEN_AS.get(written, written))
            own, _ = of_own.get(label, (region, 0.0))
            region_of[label] = own + (f"_{formulation}" if formulation else "")
            material_of[region_of[label]] = material
        given += len(set(deck.elsets[name]))
    if without := sorted(set(deck.elements) - set(region_of)):
        raise BodyError(
            f"{job.path}: {len(without)} elements have no section (*SOLID SECTION, *SHELL SECTION, "
            f"*MEMBRANE SECTION, *BEAM SECTION), first {without[0]} ({deck.types[without[0]]})"
        )
    groups: dict[tuple[str, str], list[int]] = {}  # labels by region and kind
    for label, region in region_of.items():
        groups.setdefault((region, deck.elements[label][0]), []).append(label)
    cells = [
        (kind, np.searchsorted(deck.labels, np.array([deck.elements[e][1] for e in labels])))
        for (_, kind), labels in groups.items()
    ]
    none = np.empty(0, dtype=np.int64)
    used = {region for region, _ in groups}
    mesh = meshio.Mesh(
        deck.points,
        cells,
        point_sets={
            name: np.searchsorted(deck.labels, nodes[np.isin(nodes, deck.labels)])
            for name, nodes in deck.sets.items()
        },
        cell_sets={
            region: [
                np.arange(len(labels)) if owner == region else none
                for (owner, _), labels in groups.items()
            ]
            for region in used
        },
        cell_data={LABELS: [np.array(labels) for labels in groups.values()]},
    )
    kept = {region: material for region, material in material_of.items() if region in used}
    return mesh, kept, given - len(region_of)
