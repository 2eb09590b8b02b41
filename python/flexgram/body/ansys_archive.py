"""Meshes of ANSYS archives (.cdb, of CDWRITE), by ansys-mapdl-reader."""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter
from pathlib import Path

import meshio
import numpy as np

from flexgram.basics import BodyError, Ints, errors_of
from flexgram.body.universal_mesh import LEFT_OUT, places_of

#: Nodes of degenerate bricks of 20 nodes: of prisms (K = L), of tetrahedra (M = N = O = P).
PRISM = (0, 1, 2, 4, 5, 6, 8, 9, 11, 12, 13, 15, 16, 17, 18)
PYRAMID = (0, 1, 2, 3, 4, 8, 9, 10, 11, 16, 17, 18, 19)
TETRAHEDRON = (0, 1, 2, 4, 8, 9, 11, 16, 17, 18)
#: Types and how many nodes they may have: without those between the corners they are linear.
BRICKS = {185: (8,), 186: (8, 20), 45: (8,), 95: (8, 20)}
TETRAHEDRA = {187: (4, 10), 92: (4, 10), 285: (4,)}
SHELLS = (181, 63, 43, 281)
BEAMS = (188, 180, 8, 4)
#: Commands of damping; DMPR and others are properties of materials.
DAMPING = ("ALPHAD", "BETAD", "DMPRAT", "DMPSTR", "MDAMP")
#: Elements without stiffness and mass: meshes, and surfaces that carry loads.
PASSED = (200, 151, 152, 153, 154, 155, 156)


def read_archive(path: Path) -> meshio.Mesh:
    """The mesh of an archive; components of nodes are point sets, of elements cell sets, and
    materials the cell sets ``MAT1``, ``MAT2`` and so on; ``info`` says what is not read.

    Raises
    ------
    BodyError
        Without ansys-mapdl-reader; for what it cannot read, and elements that are not known.
    """
    try:
        from ansys.mapdl.reader import Archive
    except ImportError:
        raise BodyError(
            f"{path}: reading ANSYS archives needs ansys-mapdl-reader (pip install "
            "ansys-mapdl-reader)"
        ) from None
    with errors_of(path), contextlib.redirect_stdout(io.StringIO()):
        archive = Archive(str(path), parse_vtk=False)
        types = {int(number): int(kind) for number, kind in archive.ekey}
        labels = np.array(archive.nnum, dtype=np.int64)
        points = np.array(archive.nodes, dtype=float)[:, :3]
        rows = [np.array(row, dtype=np.int64) for row in archive.elem]
        numbers = np.array(archive.enum, dtype=np.int64)
        nodes_of = {str(name): np.array(of) for name, of in archive.node_components.items()}
        elements_of = {str(name): np.array(of) for name, of in archive.element_components.items()}
    if not len(labels) or not rows:
        raise BodyError(f"{path}: no nodes, or no elements")
    found: dict[str, list[tuple[int, int, Ints]]] = {}  # number, material, nodes
    unknown: Counter[str] = Counter()
    for number, row in zip(numbers.tolist(), rows, strict=True):
        kind = types.get(int(row[1]), 0)
        if kind in PASSED:
            continue
        ours, nodes = _element(kind, row[10:])
        if ours:
            found.setdefault(ours, []).append((number, int(row[0]), nodes))
        else:
            unknown[f"{kind} with {len(row) - 10} nodes"] += 1
    if unknown:
        said = ", ".join(f"{kind} ({count})" for kind, count in sorted(unknown.items()))
        raise BodyError(
            f"{path}: element types that are not known as a mesh: {said}; CDWRITE the others alone"
        )

    def places(wanted: Ints) -> Ints:
        return places_of(path, labels, wanted)

    cells = [(kind, places(np.array([n for *_, n in some]))) for kind, some in found.items()]
    own = [np.array([number for number, *_ in some]) for some in found.values()]
    material = [np.array([m for _, m, _ in some]) for some in found.values()]
    cell_sets = {
        name: [np.flatnonzero(np.isin(of_block, of)) for of_block in own]
        for name, of in elements_of.items()
    }
    for number in np.unique(np.concatenate(material)).tolist():
        cell_sets.setdefault(f"MAT{number}", [np.flatnonzero(m == number) for m in material])
    point_sets = {
        name: places(np.intersect1d(of, labels)) for name, of in nodes_of.items() if len(of)
    }
    passed = _passed_over(path)
    info = {LEFT_OUT: [passed]} if passed else {}
    return meshio.Mesh(points, cells, point_sets=point_sets, cell_sets=cell_sets, info=info)


def _passed_over(path: Path) -> str:
    """What an archive says of materials and damping, which is not read, in words."""
    text = path.read_text(encoding="utf-8", errors="replace")
    words = re.findall(r"^\s*MP(?:DATA,[^,]*,[^,]*)?,\s*([A-Z]+)", text, re.M | re.I)
    commands = re.findall(rf"^\s*({'|'.join(DAMPING)})\s*,(.*)", text, re.M | re.I)
    words += [name for name, numbers in commands if re.search("[1-9]", numbers.partition("!")[0])]
    found = sorted({word.upper() for word in words})
    if not found:
        return ""
    return (
        f"materials and damping of the archive are not read ({', '.join(found)}): those given here "
        "count"
    )


def _element(kind: int, nodes: Ints) -> tuple[str, Ints]:
    """Meshio's type and nodes; empty if it is not known."""
    if np.any(nodes <= 0):  # some of those between corners are missing
        return "", nodes
    if len(nodes) in BRICKS.get(kind, ()):
        quadratic = len(nodes) == 20
        prism = nodes[2] == nodes[3] and nodes[6] == nodes[7]
        if len(set(nodes[4:8].tolist())) == 1:
            if nodes[2] != nodes[3]:
                chosen = nodes[list(PYRAMID if quadratic else PYRAMID[:5])]
                return ("pyramid13" if quadratic else "pyramid"), chosen
            chosen = nodes[list(TETRAHEDRON if quadratic else TETRAHEDRON[:4])]
            return ("tetra10" if quadratic else "tetra"), chosen
        if prism:
            chosen = nodes[list(PRISM if quadratic else PRISM[:6])]
            return ("wedge15" if quadratic else "wedge"), chosen
        return ("hexahedron20" if quadratic else "hexahedron"), nodes
    if len(nodes) in TETRAHEDRA.get(kind, ()):
        return ("tetra10" if len(nodes) == 10 else "tetra"), nodes
    if kind in SHELLS and len(nodes) in (4, 8):
        if nodes[2] == nodes[3]:
            corners = nodes[:3]
            return (
                ("triangle", corners)
                if len(nodes) == 4
                else ("triangle6", np.append(corners, nodes[[4, 5, 7]]))
            )
        return ("quad" if len(nodes) == 4 else "quad8"), nodes
    if kind in BEAMS and len(nodes) in (2, 3):
        return "line", nodes[:2]
    return "", nodes
