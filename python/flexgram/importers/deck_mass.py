"""*NONSTRUCTURAL MASS of an Abaqus deck: elements get materials of a larger density, which counts
in the rotary inertia of shells and beams too, as in Abaqus."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, Floats, counted, errors_of
from flexgram.body.meshfile import LABELS
from flexgram.body.reader import Reader
from flexgram.body.sections import SHELL, section_properties
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck import Deck

CARD = "NONSTRUCTURAL MASS"
OPTIONS = {"ELSET", "UNITS", "DISTRIBUTION"}


def add_nonstructural_mass(
    job: Job,
    deck: Deck,
    mesh: meshio.Mesh,
    material_of: dict[str, str],
    materials: dict[str, dict[str, Any]],
    sections: dict[str, dict[str, Any]],
) -> list[str]:
    """Divide the regions of a mesh by what the cards add to the density of their elements, as
    ``mesh_of`` and ``sections_of`` made them. Returns what is to be said.

    Raises
    ------
    BodyError
        For sets that are not there, and units that their elements do not have.
    """
    cards = [card for card in job.model if card.keyword == CARD]
    if not cards:
        return []
    region_of, size, density = _elements(mesh, material_of, materials, sections)
    factor = dict.fromkeys(size, 1.0)  # of the density of each element
    for card in cards:
        where = f"{card.place}, ELSET={card.options.get('ELSET', '')}"
        labels = deck.elsets.get(card.options.get("ELSET", "").upper(), [])
        if others := sorted(set(card.options) - OPTIONS):
            raise BodyError(f"{where}: {others[0]} is not supported")
        if not labels:
            raise BodyError(f"{where}: there is no such element set, or it is empty")
        for label, more in _added(card, where, labels, region_of, size, density, sections).items():
            factor[label] += more / density[label]
            if not factor[label] > 0:
                raise BodyError(f"{where}: takes more from element {label} than it has")
    _divide(mesh, factor, material_of, materials, sections)
    total = sum((factor[label] - 1) * density[label] * size[label] for label in size)
    number = sum(factor[label] != 1 for label in size)
    return [f"nonstructural mass of the deck: {total:.6g} on {counted(number, 'element')}"]


def _elements(
    mesh: meshio.Mesh,
    material_of: Mapping[str, str],
    materials: Mapping[str, Mapping[str, Any]],
    sections: Mapping[str, Mapping[str, Any]],
) -> tuple[dict[int, str], dict[int, float], dict[int, float]]:
    """Region, volume and mean density of each element, by its label."""
    region_of: dict[int, str] = {}
    size: dict[int, float] = {}
    density: dict[int, float] = {}
    for region, material in material_of.items():
        section = sections.get(region.partition("_")[0], {})
        layers = section.get("layers")
        if layers:
            thick = [layer["thickness"] for layer in layers]
            rho = np.average([materials[one["material"]]["rho"] for one in layers], weights=thick)
        else:
            thick, rho = [section.get("thickness", 1.0)], materials[material]["rho"]
        for block, chosen in enumerate(mesh.cell_sets[region]):
            if not len(chosen):
                continue
            x = mesh.points[mesh.cells[block].data[chosen]]
            volume = _measures(mesh.cells[block].type, x)
            if mesh.cells[block].type == "line":
                volume = volume * _area(section)
            elif section.get("shape") == SHELL:
                volume = volume * sum(thick)
            labels = mesh.cell_data[LABELS][block][chosen].tolist()
            region_of |= dict.fromkeys(labels, region)
            density |= dict.fromkeys(labels, float(rho))
            size |= dict(zip(labels, volume.tolist(), strict=True))
    return region_of, size, density


def _measures(kind: str, x: Floats) -> Floats:
    """Lengths of lines, areas of faces, volumes of solids, (n,), of places (n, k, 3)."""
    import _flexgram

    if kind == "line":
        lengths: Floats = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
        return lengths
    _, weight, _, dN = _flexgram.mass_points(kind)
    along = np.einsum("qka,ekb->eqab", dN, x)
    if kind.startswith(("triangle", "quad")):
        each = np.linalg.norm(np.cross(along[:, :, 0], along[:, :, 1]), axis=2)
    else:
        each = np.abs(np.linalg.det(along))
    measures: Floats = each @ weight
    return measures


def _area(section: Mapping[str, Any]) -> float:
    """Of a section of beams or trusses."""
    return section_properties(Reader(dict(section), "section"), 1.0)["A"]


def _added(
    card: Card,
    where: str,
    labels: list[int],
    region_of: Mapping[int, str],
    size: Mapping[int, float],
    density: Mapping[int, float],
    sections: Mapping[str, Mapping[str, Any]],
) -> dict[int, float]:
    """What a card adds to the density of elements."""
    units = " ".join(card.options.get("UNITS", "").upper().split())
    with errors_of(where):
        value = float(next(iter(card.words()), [""])[0])
    if units == "MASS PER VOLUME":
        return dict.fromkeys(labels, value)
    if units == "TOTAL MASS":
        by = card.options.get("DISTRIBUTION", "MASS PROPORTIONAL").upper().split()[0]
        if by == "VOLUME":
            return dict.fromkeys(labels, value / sum(size[label] for label in labels))
        whole = sum(size[label] * density[label] for label in labels)
        return {label: value * density[label] / whole for label in labels}
    if units not in ("MASS PER AREA", "MASS PER LENGTH"):
        raise BodyError(
            f"{where}: UNITS={units or 'nothing'} must be TOTAL MASS, or MASS PER VOLUME, AREA or "
            "LENGTH"
        )
    added = {}
    for label in labels:
        section = sections.get(region_of[label].partition("_")[0], {})
        of_faces = section.get("shape") == SHELL
        if not section or of_faces != (units == "MASS PER AREA"):
            raise BodyError(f"{where}: element {label} has no {units.lower()}")
        if of_faces:
            layers = section.get("layers", [section])
            across = sum(layer["thickness"] for layer in layers)
        else:
            across = _area(section)
        added[label] = value / across
    return added


def _divide(
    mesh: meshio.Mesh,
    factor: Mapping[int, float],
    material_of: dict[str, str],
    materials: dict[str, dict[str, Any]],
    sections: dict[str, dict[str, Any]],
) -> None:
    """A region for each factor of the density, with a material, and perhaps layers, of its own."""
    none = np.empty(0, dtype=np.int64)
    for region, material in list(material_of.items()):
        chosen = mesh.cell_sets[region]
        factors = [
            np.array([factor[label] for label in mesh.cell_data[LABELS][block][some].tolist()])
            for block, some in enumerate(chosen)
        ]
        values = np.unique(np.round(np.concatenate(factors), 14))
        if np.array_equal(values, [1.0]):
            continue
        section, _, formulation = region.partition("_")
        del material_of[region], mesh.cell_sets[region]
        for k, value in enumerate(values.tolist(), 1):
            own = f"{section}-m{k}" + (f"_{formulation}" if formulation else "")
            mesh.cell_sets[own] = [
                some[np.round(f, 14) == value] if len(some) else none
                for some, f in zip(chosen, factors, strict=True)
            ]
            material_of[own] = _denser(materials, material, value) if material else ""
            if section in sections:
                entry = dict(sections[section])
                if "layers" in entry:
                    entry["layers"] = [
                        layer | {"material": _denser(materials, layer["material"], value)}
                        for layer in entry["layers"]
                    ]
                sections[f"{section}-m{k}"] = entry


def _denser(materials: dict[str, dict[str, Any]], name: str, factor: float) -> str:
    """The name of a material whose density is larger."""
    if factor == 1:
        return name
    denser = materials[name] | {"rho": factor * materials[name]["rho"]}
    own = next(
        own for k in itertools.count(1) if materials.get(own := f"{name}-m{k}") in (None, denser)
    )
    materials[own] = denser
    return own
