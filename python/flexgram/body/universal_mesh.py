"""Meshes of universal files, which I-DEAS, Salome, gmsh and others write."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

from flexgram.basics import BodyError, Ints, errors_of, index_of
from flexgram.body.universal import datasets

#: Descriptor of an element -> meshio type, and where its nodes stand in the file's order. Edges of
#: three nodes and points bound other elements.
KINDS: dict[int, tuple[str, tuple[int, ...]]] = {
    11: ("line", (0, 1)),
    21: ("line", (0, 1)),
    **dict.fromkeys((22, 24), ("line3", (0, 2, 1))),
    161: ("vertex", (0,)),
    111: ("tetra", (0, 1, 2, 3)),
    112: ("wedge", (0, 1, 2, 3, 4, 5)),
    113: ("wedge15", (0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8)),
    115: ("hexahedron", (0, 1, 2, 3, 4, 5, 6, 7)),
    116: (
        "hexahedron20",
        (0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11),
    ),
    118: ("tetra10", (0, 2, 4, 9, 1, 3, 5, 6, 7, 8)),
    **dict.fromkeys((41, 51, 61, 74, 81, 91), ("triangle", (0, 1, 2))),
    **dict.fromkeys((44, 54, 64, 71, 84, 94), ("quad", (0, 1, 2, 3))),
    **dict.fromkeys((42, 52, 62, 72, 82, 92), ("triangle6", (0, 2, 4, 1, 3, 5))),
    **dict.fromkeys((45, 55, 65, 75, 85, 95), ("quad8", (0, 2, 4, 6, 1, 3, 5, 7))),
}
#: Rods and beams, which have a line more; of three nodes too.
BEAMS = (11, 21, 22, 23, 24)
GROUPS = (2435, 2452, 2467, 2477)
#: Key of a mesh's ``info``: what its file says beside the mesh, which is not read.
LEFT_OUT = "left out"


def read_universal(path: Path) -> meshio.Mesh:
    """The mesh of a universal file: datasets 2411 (nodes), 2412 (elements) and permanent groups, of
    nodes as point sets, of elements as cell sets.

    Raises
    ------
    BodyError
        For files without a mesh, elements that are not known, and nodes that are not there.
    """
    nodes: dict[int, list[float]] = {}
    elements: dict[str, list[tuple[int, list[int]]]] = {}
    unknown: dict[int, int] = {}
    groups: list[tuple[str, list[tuple[int, int]]]] = []
    with errors_of(path):
        for number, lines in datasets(path):
            if number in (781, 2411):
                for head, place in zip(lines[::2], lines[1::2], strict=True):
                    xyz = [float(x) for x in place.replace("D", "E").replace("d", "e").split()]
                    nodes[int(head.split()[0])] = xyz
            elif number == 2412:
                _elements(lines, elements, unknown)
            elif number in GROUPS:
                groups += _groups(lines)
    if not nodes or not (elements or unknown):
        raise BodyError(f"{path}: no mesh in it (datasets 2411 and 2412)")
    if unknown:
        said = ", ".join(f"{kind} ({count})" for kind, count in sorted(unknown.items()))
        raise BodyError(f"{path}: elements with these descriptors are not known: {said}")
    labels = np.array(sorted(nodes), dtype=np.int64)
    points = np.array([nodes[label] for label in labels.tolist()])
    if points.ndim != 2 or points.shape[1] != 3:
        raise BodyError(f"{path}: a node has no three coordinates")
    cells: list[tuple[str, Ints]] = []
    of_elements: dict[int, tuple[int, int]] = {}
    for block, (kind, some) in enumerate(elements.items()):
        wanted = np.array([own for _, own in some], dtype=np.int64)
        cells.append((kind, places_of(path, labels, wanted)))
        of_elements |= {label: (block, k) for k, (label, _) in enumerate(some)}
    point_sets: dict[str, Ints] = {}
    cell_sets: dict[str, list[Ints]] = {}
    for name, members in groups:
        if own := [label for code, label in members if code == 7]:
            point_sets[name] = places_of(path, labels, np.unique(own))
        chosen = [
            of_elements[label] for code, label in members if code == 8 and label in of_elements
        ]
        if chosen:
            cell_sets[name] = [
                np.array(sorted(k for b, k in chosen if b == block), dtype=np.int64)
                for block in range(len(cells))
            ]
    return meshio.Mesh(points, cells, point_sets=point_sets, cell_sets=cell_sets)


def places_of(path: Path, labels: Ints, wanted: Ints) -> Ints:
    at, known = index_of(labels, wanted)
    if not known.all():
        raise BodyError(f"{path}: there is no node {wanted[~known].flat[0]}")
    return at


def _elements(
    lines: list[str], elements: dict[str, list[tuple[int, list[int]]]], unknown: dict[int, int]
) -> None:
    k = 0
    while k < len(lines):
        label, descriptor, *_, count = (int(word) for word in lines[k].split()[:6])
        k += 2 if descriptor in BEAMS else 1
        own: list[int] = []
        while len(own) < count:
            own += [int(word) for word in lines[k].split()]
            k += 1
        kind, order = KINDS.get(descriptor, ("", ()))
        if len(order) != count:
            unknown[descriptor] = unknown.get(descriptor, 0) + 1
            continue
        elements.setdefault(kind, []).append((label, [own[place] for place in order]))


def _groups(lines: list[str]) -> list[tuple[str, list[tuple[int, int]]]]:
    """Names, and codes with labels of the members: 7 a node, 8 an element."""
    found = []
    k = 0
    while k + 1 < len(lines):
        count = int(lines[k].split()[7])
        name = lines[k + 1].strip()
        k += 2
        words: list[int] = []
        while len(words) < 4 * count:
            words += [int(word) for word in lines[k].split()]
            k += 1
        found.append((name, list(zip(words[::4], words[1::4], strict=True))))
    return found
