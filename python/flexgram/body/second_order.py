"""Elements that become others between their nodes: shells and beams of second order, pyramids.

A triangle of six nodes becomes four of three, a quadrilateral of eight or nine four of four, a beam
of three nodes two. A quadrilateral of eight nodes gains a node in its middle. A pyramid becomes two
tetrahedra; one of thirteen nodes gains a node in the middle of its base, which follows the eight
around by their shape functions, as the face of a hexahedron does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from flexgram.basics import Floats, Ints
from flexgram.body.meshfile import AXES, LABELS, SECOND_ORDER

#: By meshio type: what its elements become, and of which of its nodes.
PIECES: dict[str, tuple[str, list[list[int]]]] = {
    "triangle6": ("triangle", [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]),
    "quad9": ("quad", [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]]),
    "line3": ("line", [[0, 2], [2, 1]]),
    "pyramid": ("tetra", [[0, 1, 2, 4], [0, 2, 3, 4]]),
    "pyramid14": (
        "tetra10",
        [[0, 1, 2, 4, 5, 6, 13, 9, 10, 11], [0, 2, 3, 4, 13, 7, 8, 9, 11, 12]],
    ),
}
#: Those that gain a node: what they are with it, and the eight nodes that it is between.
GAINING = {
    "quad8": ("quad9", [0, 1, 2, 3, 4, 5, 6, 7]),
    "pyramid13": ("pyramid14", [0, 1, 2, 3, 5, 6, 7, 8]),
}
#: Shape functions of eight nodes in the middle.
MIDDLE = np.array([-0.25] * 4 + [0.5] * 4)


@dataclass
class Divided:
    """Elements instead of others.

    Attributes
    ----------
    kind : str
        Their meshio type.
    cells : (m k, p) array
        Their nodes, k of them for each of the m elements, one after the other.
    middles : (m, 3) array
        Places of new nodes, counted from ``first`` on; none but of ``GAINING``.
    around : (m, 8) array
        The nodes that these are between.
    """

    kind: str
    cells: Ints
    middles: Floats
    around: Ints

    @classmethod
    def of(cls, kind: str, nodes: Ints, points: Floats, first: int) -> Divided:
        """Of elements (m, n) of a kind of ``PIECES`` or ``GAINING``."""
        middles, around = np.empty((0, 3)), np.empty((0, 8), dtype=np.int64)
        if kind in GAINING:
            kind, chosen = GAINING[kind]
            around = nodes[:, chosen]
            middles = np.einsum("n,enx->ex", MIDDLE, points[around])
            nodes = np.column_stack([nodes, first + np.arange(len(nodes))])
        becomes, pieces = PIECES[kind]
        return cls(becomes, nodes[:, pieces].reshape(-1, len(pieces[0])), middles, around)


@dataclass
class Gained:
    """New nodes, in the middle of elements of a kind.

    Attributes
    ----------
    kind : str
        Meshio type of the elements.
    nodes : (m,) array
    around : (m, 8) array
        The nodes that each is between.
    """

    kind: str
    nodes: Ints
    around: Ints

    def equations(self) -> list[list[Any]]:
        """As a description has them: each moves by the shape functions of the eight around it."""
        factors = MIDDLE.tolist()
        return [
            [[node + 1, c, 1.0], *([n + 1, c, -f] for n, f in zip(row, factors, strict=True))]
            for node, row in zip(self.nodes.tolist(), self.around.tolist(), strict=True)
            for c in ("x", "y", "z")
        ]


def divide(
    mesh: meshio.Mesh, cells: dict[str, list[Ints]], chosen: Mapping[int, NDArray[np.bool_]]
) -> tuple[meshio.Mesh, dict[str, list[Ints]], list[Gained]]:
    """A mesh with some elements divided.

    Parameters
    ----------
    mesh : meshio.Mesh
    cells : dict
        Parts of the mesh: the chosen cells of each of its blocks.
    chosen : mapping
        Of blocks by their number: which of their cells are divided.

    Returns
    -------
    mesh, cells, gained
        The same with blocks behind the others. New nodes are behind the others too; those of shells
        belong to the node sets that hold all nodes of their element. An element's number
        (``LABELS``) is that of its pieces.
    """
    gained: list[Gained] = []
    points = np.asarray(mesh.points, dtype=float)
    blocks = [(block.type, block.data) for block in mesh.cells]
    ends = np.cumsum([len(block.data) for block in mesh.cells])
    labels = mesh.cell_data.get(LABELS) or [
        np.arange(end - len(block.data), end) + 1
        for end, block in zip(ends, mesh.cells, strict=True)
    ]
    labels = [np.asarray(of_block) for of_block in labels]
    axes = list(mesh.cell_data[AXES]) if AXES in mesh.cell_data else None
    cells = {name: list(parts) for name, parts in cells.items()}
    sets = {name: np.asarray(nodes, dtype=np.int64) for name, nodes in mesh.point_sets.items()}
    for block, some in chosen.items():
        kind, nodes = mesh.cells[block].type, np.asarray(mesh.cells[block].data[some], np.int64)
        pieces = Divided.of(kind, nodes, points, len(points))
        count = len(pieces.cells) // len(nodes)
        if len(pieces.middles):
            new = len(points) + np.arange(len(nodes))
            if kind in SECOND_ORDER:
                for name, members in sets.items():
                    inside = np.isin(pieces.around, members).all(axis=1)
                    sets[name] = np.append(members, new[inside])
            gained.append(Gained(kind, new, pieces.around))
            points = np.vstack([points, pieces.middles])
        place = np.cumsum(some) - 1  # of a divided cell among these
        for name, parts in cells.items():
            mine = some[parts[block]]
            first = count * place[parts[block][mine]]
            cells[name] = [*parts, (first[:, None] + np.arange(count)).ravel()]
            cells[name][block] = parts[block][~mine]
        blocks.append((pieces.kind, pieces.cells))
        labels.append(np.repeat(labels[block][some], count))
        if axes is not None:
            axes.append(np.repeat(axes[block][some], count, axis=0))
    data = {LABELS: labels} | ({AXES: axes} if axes is not None else {})
    divided = meshio.Mesh(points, blocks, point_sets=sets, cell_data=data)
    return divided, cells, gained
