"""Generated bodies: a distorted box in every element type, for references and tests."""

from __future__ import annotations

from itertools import permutations, product
from typing import Any

import meshio
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

import flexgram.body.meshfile  # noqa: F401  (teaches Debian's meshio the wedge15)

Array = NDArray[Any]

#: Corner-to-corner edges that carry a middle node, in VTK's order.
EDGES = {
    "tetra10": [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)],
    "hexahedron20": [
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 0),
        (4, 5),
        (5, 6),
        (6, 7),
        (7, 4),
        (0, 4),
        (1, 5),
        (2, 6),
        (3, 7),
    ],
    "wedge15": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
}

#: CalculiX element, and the meshio type that flexgram assembles for it.
CALCULIX = {
    "C3D4": "tetra",
    "C3D10": "tetra10",
    "C3D8I": "hexahedron",
    "C3D20": "hexahedron20",
    "C3D20R": "hexahedron20",
    "C3D15": "wedge15",
    "C3D6": "wedge",
    "C3D8": "hexahedron",
    "C3D8R": "hexahedron",
}

#: What a region of these elements says, where flexgram's usual formulation is another.
FORMULATIONS = {
    "C3D6": {"formulation": "reduced"},
    "C3D8": {"formulation": "full"},
    "C3D20R": {"formulation": "reduced"},
}


def distortion(points: Array, size: Array) -> Array:
    """A smooth bend and taper that keeps the ends plane enough and all elements valid."""
    x, y, z = (points / size).T
    return points + size * np.column_stack(
        [0.02 * np.sin(3 * y) * np.sin(np.pi * x), 0.10 * x * z, 0.15 * x**2 - 0.08 * x * y]
    )


def box(
    kind: str,
    counts: tuple[int, int, int] = (6, 2, 2),
    size: tuple[float, float, float] = (0.1, 0.02, 0.03),
    distort: bool = True,
) -> meshio.Mesh:
    """A box of one element type (meshio's name), with the node sets ``start`` and ``end``."""
    grid = [np.linspace(0, s, c + 1) for s, c in zip(size, counts, strict=True)]
    points = np.array(list(product(*grid)))
    number = np.arange(len(points)).reshape([c + 1 for c in counts])
    hexes = []
    for i, j, k in product(*map(range, counts)):
        c = number[i : i + 2, j : j + 2, k : k + 2]
        hexes.append(
            [
                c[0, 0, 0],
                c[1, 0, 0],
                c[1, 1, 0],
                c[0, 1, 0],
                c[0, 0, 1],
                c[1, 0, 1],
                c[1, 1, 1],
                c[0, 1, 1],
            ]
        )
    cells = np.array(hexes)
    if kind.startswith("wedge"):  # two prisms with axis z
        cells = np.vstack([cells[:, [0, 1, 2, 4, 5, 6]], cells[:, [0, 2, 3, 4, 6, 7]]])
    elif kind.startswith("tetra"):  # six around the main diagonal (Kuhn): conforming everywhere
        corner = {
            (0, 0, 0): 0,
            (1, 0, 0): 1,
            (1, 1, 0): 2,
            (0, 1, 0): 3,
            (0, 0, 1): 4,
            (1, 0, 1): 5,
            (1, 1, 1): 6,
            (0, 1, 1): 7,
        }
        tets = []
        for path in permutations(range(3)):
            place, chain = [0, 0, 0], [0]
            for axis in path:
                place[axis] = 1
                chain.append(corner[place[0], place[1], place[2]])
            even = np.linalg.det(np.eye(3)[list(path)]) > 0
            tets.append(cells[:, chain if even else [chain[0], chain[2], chain[1], chain[3]]])
        cells = np.vstack(tets)
    start, end = points[:, 0] == 0, points[:, 0] == size[0]
    if distort:
        points = distortion(points, np.array(size))
    if kind in EDGES:
        pairs = np.sort(np.stack([cells[:, edge] for edge in EDGES[kind]], axis=1), axis=2)
        unique, inverse = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
        cells = np.hstack([cells, len(points) + inverse.reshape(len(cells), -1)])
        start = np.concatenate([start, start[unique].all(axis=1)])
        end = np.concatenate([end, end[unique].all(axis=1)])
        points = np.vstack([points, points[unique].mean(axis=1)])
    return meshio.Mesh(
        points,
        [(kind, cells)],
        point_sets={"start": np.flatnonzero(start), "end": np.flatnonzero(end)},
    )


def write_body_file(
    path: Any,
    mesh: meshio.Mesh,
    *,
    material: dict[str, Any] | None = None,
    interfaces: dict[str, dict[str, Any]] | None = None,
    supports: dict[str, list[int]] | None = None,
    mass: str = "full",
    damping: tuple[float, float, float] = (0, 0, 0),
) -> None:
    """A mesh body file without going through YAML; node sets by name in the mesh."""
    import h5py

    with h5py.File(path, "w") as file:
        file["mesh/points"] = mesh.points
        file["mesh"].attrs["mass_integration"] = mass
        for i, block in enumerate(mesh.cells):
            group = file.create_group(f"mesh/blocks/{i:04d}")
            group.attrs["type"], group.attrs["material"] = block.type, "steel"
            group["connectivity"] = block.data.astype(np.int64)
        steel = file.create_group("materials/steel")
        steel.attrs.update(material or {"E": 210e9, "nu": 0.3, "rho": 7850.0})
        for order, (name, data) in enumerate((interfaces or {}).items()):
            group = file.create_group(f"interfaces/{name}")
            nodes = np.asarray(mesh.point_sets[data["set"]], dtype=np.int64)
            group.attrs["coupling"], group.attrs["order"] = data["coupling"], order
            group.attrs["position"] = data.get("position", mesh.points[nodes].mean(axis=0))
            group["nodes"] = nodes
        for name, components in (supports or {}).items():
            group = file.create_group(f"supports/{name}")
            group["nodes"] = np.asarray(mesh.point_sets[name], dtype=np.int64)
            group.attrs["components"] = np.asarray(components, dtype=float)
        file.attrs["alpha"], file.attrs["beta"], file.attrs["eta"] = damping


def small() -> tuple[Any, Any]:
    """A chain with a grounded end: eight rows, three to a node but one node with two."""
    n = 8
    K = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]) * 1e6
    M = sp.diags([0.5 * np.ones(n - 1), 2 * np.ones(n), 0.5 * np.ones(n - 1)], [-1, 0, 1])
    return K.tocsr(), M.tocsr()
