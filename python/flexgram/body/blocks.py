"""Element blocks of a mesh body: the elements of each region, their material and section."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Bools, Floats, Ints, counted
from flexgram.body.faces import CORNERS
from flexgram.body.materials import write_material
from flexgram.body.meshfile import (
    FORMULATIONS,
    LABELS,
    MEMBRANE,
    PYRAMIDS,
    SECOND_ORDER,
    SHELLS,
    SOLIDS,
)
from flexgram.body.orientation import element_axes, expect_in_surface
from flexgram.body.parameters import PARAMETER, region_material
from flexgram.body.reader import Reader
from flexgram.body.sections import ROD
from flexgram.body.whole import Block

#: Keys of a region.
REGION = ("material", "section", "formulation", "orientation", PARAMETER)


def write_blocks(
    file: h5py.File,
    reader: Reader,
    mesh: Any,
    cells: dict[str, list[Ints]],
    units: tuple[float, ...],
) -> tuple[list[Block], list[str]]:
    """Write element blocks by region and cell type; returns them, and warnings of what is in no
    region.

    Parameters
    ----------
    file : h5py.File
        Body file with its materials and sections.
    reader : Reader
        The description.
    mesh : meshio.Mesh
    cells : dict
        For each part of the mesh the chosen cells of each of its blocks.
    units : tuple of float
        Length [m], mass [kg] and force [N] of the mesh's units.

    Raises
    ------
    BodyError
        For regions without elements, materials or sections that are known, and for elements that
        belong to two regions.
    """
    regions = reader.children("regions")
    if not regions:
        raise BodyError(
            f"{reader.where}: regions is missing: name a part of the mesh and its material; the "
            f"mesh has {', '.join(sorted(cells))}"
        )
    written: list[Block] = []
    taken = [np.zeros(len(block.data), dtype=bool) for block in mesh.cells]
    labels = _labels(mesh)
    points = np.asarray(mesh.points, dtype=float)
    for name, data in regions.items():
        entry = Reader(data, f"regions: {name}", REGION)
        section, material = _section_and_material(file, reader, str(name), entry, units)
        properties = file["sections"][section].attrs if section else {}
        of_shells = "thickness" in properties
        _expect_part(mesh, cells, str(name), entry)
        if of_shells:
            _expect_shells(mesh, cells[str(name)], entry)
        known = SOLIDS if not section else SHELLS if of_shells else (*SOLIDS, "line")
        before = len(written)
        for number, chosen in enumerate(cells[str(name)]):
            kind = mesh.cells[number].type
            if len(chosen) == 0 or kind not in known:
                continue
            if taken[number][chosen].any():
                raise BodyError(f"{entry.where}: some of its elements belong to another region too")
            taken[number][chosen] = True
            is_rod = kind == "line" and "I_y" not in properties
            formulation = "rod" if is_rod else _formulation(entry, kind)
            block = Block(
                ROD if is_rod else f"{kind}/{MEMBRANE}" if formulation == MEMBRANE else kind,
                np.asarray(mesh.cells[number].data[chosen], dtype=np.int64),
                np.asarray(labels[number][chosen], dtype=np.int64),
            )
            group = file.create_group(f"mesh/blocks/{len(written):04d}")
            group.attrs["type"], group.attrs["material"] = kind, material
            if kind not in SOLIDS:
                group.attrs["section"] = section
            if formulation:
                group.attrs["formulation"] = formulation
            group["connectivity"], group["ids"] = block.nodes, block.ids
            of = f"{kind}/{formulation}" if formulation else kind
            axes = _axes(mesh, number, chosen, of, entry)
            if axes is not None:
                group["axes"] = axes
                if kind in SHELLS:
                    expect_in_surface(points, block.nodes, axes, entry.where)
            written.append(block)
        if len(written) == before:
            kinds = _kinds(mesh, cells[str(name)])
            raise _without_elements(entry.where, kinds, section, of_shells)
    return written, _left_out(mesh, cells, taken, written)


def _left_out(
    mesh: Any, cells: dict[str, list[Ints]], taken: list[Bools], written: list[Block]
) -> list[str]:
    """Elements that no region has, though they are no faces or edges of elements that one has."""
    used = np.zeros(len(mesh.points), dtype=bool)
    for block in written:
        used[block.nodes.ravel()] = True
    kinds = {block.kind.partition("/")[0] for block in written}
    faces = set(CORNERS) if kinds & set(SHELLS) else set()
    lines = {"line", "line3"} if kinds & {"line", ROD} else set()
    solid = (*SOLIDS, *PYRAMIDS)
    missing: dict[str, int] = {}
    for number, block in enumerate(mesh.cells):
        if block.type not in (*solid, *faces, *lines):
            continue
        left = ~taken[number]
        if block.type not in solid:
            left &= ~used[block.data].all(axis=1)
        if not left.any():
            continue
        parts = [
            name
            for name, chosen in sorted(cells.items())
            if name not in ("all", block.type) and left[chosen[number]].any()
        ]
        of = f" of part {' and '.join(parts)}" if parts else ""
        words = f"{block.type}{of}"
        missing[words] = missing.get(words, 0) + int(left.sum())
    return [
        f"{counted(count, 'element')} ({words}) in no region: the body is without "
        f"{'it' if count == 1 else 'them'}"
        for words, count in missing.items()
    ]


def _labels(mesh: Any) -> Sequence[Ints]:
    """Numbers of the elements of each block: the FE code's, else from 1 on."""
    labels = mesh.cell_data.get(LABELS)
    if labels is not None:
        known: Sequence[Ints] = labels
        return known
    ends = np.cumsum([len(block.data) for block in mesh.cells])
    return [
        np.arange(end - len(block.data), end) + 1
        for end, block in zip(ends, mesh.cells, strict=True)
    ]


def _kinds(mesh: Any, part: list[Ints]) -> set[str]:
    """Of the cells of a part."""
    return {block.type for block, chosen in zip(mesh.cells, part, strict=True) if len(chosen)}


def _section_and_material(
    file: h5py.File, reader: Reader, name: str, entry: Reader, units: tuple[float, ...]
) -> tuple[str, str]:
    """Of a region; either may be empty: solids have no section, layers materials of their own."""
    section = ""  # parts may hold lines and faces beside solids
    if "section" in entry.data:
        section = entry.choice("section", reader.children("sections"))
    if section and "layer_materials" in file["sections"][section].attrs:
        if PARAMETER in entry.data:
            raise BodyError(
                f"{entry.where}: layers have no parameter; a section of one material can"
            )
        if "material" in entry.data:
            raise BodyError(f"{entry.where}: the layers of section {section} have materials")
        return section, ""
    materials = reader.children("materials")
    material = entry.choice("material", materials)
    if PARAMETER in entry.data:
        material, own = region_material(materials, entry, name)
        write_material(file, material, own, units)
    return section, material


def _formulation(region: Reader, kind: str) -> str:
    """Of the elements of a kind in a region; empty: the usual one."""
    known = FORMULATIONS.get(kind, ())
    given = str(region.data.get("formulation", ""))
    if given and given not in known:
        of_kind = f"{kind} has {', '.join(known)}" if known else f"{kind} has one only"
        raise BodyError(f"{region.where}: formulation = {given!r}: {of_kind}")
    usual = known[:1]
    return "" if given in ("", *usual) else given


def _axes(mesh: Any, number: int, chosen: Ints, kind: str, entry: Reader) -> Floats | None:
    """Of the material in each element, if the region or the mesh gives some."""
    if mesh.cells[number].type in (*SOLIDS, *SHELLS):
        return element_axes(mesh, number, chosen, kind, entry)
    if "orientation" in entry.data:
        raise BodyError(f"{entry.where}: orientation is of solids and shells")
    return None


def _expect_part(mesh: Any, cells: dict[str, list[Ints]], name: str, entry: Reader) -> None:
    """A part of the mesh has the region's name."""
    if name in cells:
        return
    has = f"it has {', '.join(sorted(cells))}"
    if "all" not in cells:
        only = ", ".join(sorted({block.type for block in mesh.cells})) or "nothing"
        has = f"it has no known elements, only {only}: mesh it with {', '.join(SOLIDS)}"
    raise BodyError(f"{entry.where}: the mesh has no such part; {has}")


def _expect_shells(mesh: Any, part: list[Ints], entry: Reader) -> None:
    """A part with a section of shells has no other elements than these, points and lines."""
    kinds = _kinds(mesh, part)
    others = {kind for kind in kinds - set(SHELLS) if kind in CORNERS or kind in SOLIDS}
    if others and kinds & set(SHELLS):
        raise BodyError(
            f"{entry.where}: it has a section of shells, which are {' and '.join(SHELLS)}, and "
            f"{', '.join(sorted(others))} too: name parts of one kind"
        )


def _without_elements(where: str, kinds: Iterable[str], section: str, of_shells: bool) -> BodyError:
    """Why a region with cells of such kinds has no elements."""
    has = ", ".join(sorted(kinds))
    if of_shells:
        return BodyError(
            f"{where}: a section of shells takes {', '.join((*SHELLS, *SECOND_ORDER))}; it has "
            f"{has}"
        )
    if not section and set(kinds) <= set(CORNERS):
        return BodyError(
            f"{where}: its elements are faces ({has}): if they are shells, give the region a "
            "section of shape shell (import: --thickness); if they bound solids, name the part "
            "with these"
        )
    return BodyError(
        f"{where}: no elements that flexgram knows; it has {has}, known are {', '.join(SOLIDS)}; "
        f"with a section of a shell {', '.join(SHELLS)}, with that of a beam line"
    )
