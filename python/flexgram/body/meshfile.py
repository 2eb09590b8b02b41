"""Meshes of any meshio format: parts by region, node sets by name."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import meshio
import numpy as np

from flexgram.basics import BodyError, Ints, meant
from flexgram.body.ansys_archive import read_archive
from flexgram.body.universal_mesh import read_universal

# Debian's meshio 5.0 reads these but forgot their dimension.
for _kind in ("wedge15", "pyramid13", "pyramid14"):
    meshio._mesh.topological_dimension.setdefault(_kind, 3)

#: Cell data of a mesh that we made: the FE code's numbers of its elements.
LABELS = "flexgram:label"
#: First and second axis of the material in each element (E, 6), or at each point of the stiffness
#: of solids (E, q, 6); NaN: the material's own.
AXES = "flexgram:axes"
SOLIDS = ("tetra", "tetra10", "hexahedron", "hexahedron20", "wedge15", "wedge")
#: Of shells that resist stretching alone, whose nodes have no rotations.
MEMBRANE = "membrane"
#: Those of kinds that have several, the usual one first.
FORMULATIONS = {
    "hexahedron": ("incompatible", "full"),
    "hexahedron20": ("full", "reduced"),
    "wedge": ("full", "reduced"),
    "triangle": ("bending", MEMBRANE),
    "quad": ("bending", MEMBRANE),
}
SHELLS = ("triangle", "quad")
#: Shells that are divided into these (``second_order``).
SECOND_ORDER = ("triangle6", "quad8", "quad9")
LINES = ("line", "line3")
#: Solids that are divided into tetrahedra.
PYRAMIDS = ("pyramid", "pyramid13", "pyramid14")
ALONE = "vertex"  #: nodes with six dofs that no element has
TURNING = (*SHELLS, "line", ALONE)  #: whose nodes have rotations: with beams, without rods


CAD = (
    "a geometry, no mesh: make one with gmsh, for instance gmsh {} -3 -order 2 -clmax SIZE -o "
    "part.msh, with physical groups for interfaces"
)
#: What to do with files that are no mesh that meshio reads, by their endings.
REMEDIES = {
    ending: CAD.format(f"part{ending}")
    for ending in (".step", ".stp", ".iges", ".igs", ".brep", ".stl", ".geo")
} | {
    ".rmed": "results of Code_Aster: give its mesh, .med",
}


#: What meshio does not read, by ending.
READERS = {".unv": read_universal, ".cdb": read_archive}


def read_mesh(path: Path) -> meshio.Mesh:
    """Read a mesh, by our own readers or by meshio, with its many errors as one."""
    if not path.exists():
        raise BodyError(f"mesh {path}: no such file")
    if remedy := REMEDIES.get(path.suffix.lower()):
        raise BodyError(f"mesh {path}: {remedy}")
    if reader := READERS.get(path.suffix.lower()):
        return _checked(path, reader(path))
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh = meshio.read(path)
    except (Exception, SystemExit) as error:
        words = " ".join((said.getvalue().strip() or str(error)).split())[-200:]
        raise BodyError(
            f"mesh {path}: meshio cannot read it ({words or type(error).__name__})"
            + (
                "; flexgram import --assemble (or --run-ccx) reads decks, and view shows the body "
                "file; from gmsh, save .msh"
                if path.suffix.lower() == ".inp"
                else ""
            )
        ) from error
    return _checked(path, mesh)


def _checked(path: Path, mesh: meshio.Mesh) -> meshio.Mesh:
    if mesh.points.ndim != 2 or mesh.points.shape[1] not in (2, 3):
        raise BodyError(f"mesh {path}: its points have no two or three coordinates each")
    if not np.all(np.isfinite(mesh.points)):
        raise BodyError(f"mesh {path}: a coordinate is NaN or Inf")
    for block in mesh.cells:
        if len(block.data) and not 0 <= block.data.min() <= block.data.max() < len(mesh.points):
            raise BodyError(f"mesh {path}: elements name nodes that are not there")
    if mesh.points.shape[1] == 2:
        mesh.points = np.column_stack([mesh.points, np.zeros(len(mesh.points))])
    return mesh


def data_files(path: Path) -> list[Path]:
    """Files beside an XDMF mesh in which its numbers are, those of ``rack.h5:/data0``."""
    if path.suffix not in (".xdmf", ".xmf") or not path.exists():
        return []
    named = re.findall(r"(?:^|>)\s*([^\s<>:]+):/", path.read_text(errors="replace"), re.MULTILINE)
    return [path.parent / name for name in sorted(set(named))]


def cell_regions(mesh: meshio.Mesh) -> dict[str, list[Ints]]:
    """Named sets of cells: for each name the indices of its cells in every block of the mesh.

    Names come from gmsh's physical groups (by name, or by number without one), from cell sets
    (Abaqus ELSET and others). ``all`` is every solid, in a mesh without solids every shell, in one
    without these every line.
    """
    regions: dict[str, list[Ints]] = {}
    blocks = len(mesh.cells)
    none = np.empty(0, dtype=np.int64)

    def add(name: str, block: int, cells: Ints) -> None:
        if len(cells) > 0:
            parts = regions.setdefault(name, [none] * blocks)
            parts[block] = np.union1d(parts[block], cells)

    names = {  # other formats keep results here
        (int(group[0]), int(group[1])): name
        for name, group in mesh.field_data.items()
        if np.shape(group) == (2,) and np.issubdtype(np.asarray(group).dtype, np.integer)
    }
    for block, tags in enumerate(mesh.cell_data.get("gmsh:physical", [])):
        for tag in np.unique(tags):
            name = names.get((int(tag), mesh.cells[block].dim), str(int(tag)))
            add(name, block, np.flatnonzero(tags == tag).astype(np.int64))
    for name, parts in mesh.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        for block, cells in enumerate(parts):
            if cells is not None:
                add(name, block, np.asarray(cells, dtype=np.int64))
    ranks = ((*SOLIDS, *PYRAMIDS), (*SHELLS, *SECOND_ORDER), LINES)
    there = {group.type for group in mesh.cells}
    whole = next((kinds for kinds in ranks if there & set(kinds)), ())
    if whole == LINES and "all" in regions:  # a group of that name, of some beams
        return regions
    for block, group in enumerate(mesh.cells):
        if group.type in whole:
            add("all", block, np.arange(len(group.data), dtype=np.int64))
    return regions


def node_set(mesh: meshio.Mesh, regions: dict[str, list[Ints]], name: str) -> Ints:
    """Nodes of a named point set or of all cells of a region, ascending."""
    if name in mesh.point_sets:
        return np.unique(np.asarray(mesh.point_sets[name], dtype=np.int64))
    if name not in regions:
        names = {*regions, *mesh.point_sets} - {"all"}
        known = sorted(n for n in names if not re.fullmatch(r"section\d+", n))  # of a deck's cards
        hint = meant(name, known) or ";"
        raise BodyError(
            f"there is no node set {name}{hint} the mesh has {', '.join(known) or 'none'}"
        )
    used = [mesh.cells[b].data[cells].ravel() for b, cells in enumerate(regions[name])]
    nodes: Ints = np.unique(np.concatenate(used)).astype(np.int64)
    return nodes
