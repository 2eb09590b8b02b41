"""Loads and outputs of a mesh beside its interfaces: gravity, spin, pressure, traction, forces,
temperature.

A load is written to the body file as a field of acceleration, which the assembly weighs with the
body's mass, or as forces at nodes for a unit of its input, integrated here over faces of elements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from flexgram.basics import BodyError, IntArray, check_name, errors_of
from flexgram.faces import whole_faces
from flexgram.reader import Reader, short

if TYPE_CHECKING:
    from flexgram.stress import Stresses

Floats = NDArray[np.float64]

FIELDS = ("acceleration", "angular_acceleration", "spin")
TYPES = (*FIELDS, "pressure", "traction", "force", "nodal", "temperature")
OUTPUTS = ("displacement", "stress", "reaction")
AXES = "xyz"


def _triangle(xi: Floats, quadratic: bool) -> tuple[Floats, Floats]:
    """Shape functions (q, n) and derivatives (q, n, 2) at points of the unit triangle."""
    corner = np.column_stack([1 - xi.sum(axis=1), xi])
    slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if not quadratic:
        return corner, np.broadcast_to(slope, (len(xi), 3, 2))
    edges = ((0, 1), (1, 2), (2, 0))
    N = np.hstack(
        [
            corner * (2 * corner - 1),
            np.column_stack([4 * corner[:, i] * corner[:, j] for i, j in edges]),
        ]
    )
    dN = [(4 * corner[:, i, None] - 1) * slope[i] for i in range(3)]
    dN += [4 * (corner[:, i, None] * slope[j] + corner[:, j, None] * slope[i]) for i, j in edges]
    return N, np.stack(dN, axis=1)


def _quadrilateral(xi: Floats, quadratic: bool) -> tuple[Floats, Floats]:
    """The same at points of the square from -1 to 1: bilinear, or serendipity with 8 nodes."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    x, y = xi[:, :1], xi[:, 1:]
    a, b = corners[:, 0], corners[:, 1]
    N = 0.25 * (1 + a * x) * (1 + b * y)
    dx, dy = 0.25 * a * (1 + b * y), 0.25 * b * (1 + a * x)
    if quadratic:
        middles = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
        inner, ix, iy = N, dx, dy
        factor = a * x + b * y - 1
        N = inner * factor
        dx, dy = ix * factor + inner * a, iy * factor + inner * b
        more = []
        for p, q in middles:
            if p == 0:
                more.append((0.5 * (1 - x**2) * (1 + q * y), -x * (1 + q * y),
                             0.5 * (1 - x**2) * q))  # fmt: skip
            else:
                more.append((0.5 * (1 + p * x) * (1 - y**2), 0.5 * p * (1 - y**2),
                             -(1 + p * x) * y))  # fmt: skip
        N, dx, dy = (np.hstack([whole, *(part[k] for part in more)])
                     for k, whole in enumerate((N, dx, dy)))  # fmt: skip
    return N, np.stack([dx, dy], axis=2)


def _rule(corners: int) -> tuple[Floats, Floats]:
    """Points and weights, exact for polynomials of degree 4 (triangle, Dunavant 1985) and of degree
    5 in each direction (square)."""
    if corners == 3:
        points, weights = [], []
        for a, w in ((0.445948490915964886318, 0.5 * 0.223381589678011465699),
                     (0.091576213509770743460, 0.5 * 0.109951743655321867638)):  # fmt: skip
            points += [(a, a), (1 - 2 * a, a), (a, 1 - 2 * a)]
            weights += 3 * [w]
        return np.array(points), np.array(weights)
    line, weight = np.sqrt(0.6) * np.arange(-1.0, 2.0), np.array([5.0, 8.0, 5.0]) / 9
    X, Y = np.meshgrid(line, line)
    return np.column_stack([X.ravel(), Y.ravel()]), np.outer(weight, weight).ravel()


def areas_at_nodes(points: Floats, faces: Sequence[IntArray]) -> tuple[Floats, Floats]:
    """Integrals of the shape functions over faces: times the normal, and by themselves.

    Parameters
    ----------
    points : (N, 3) array
    faces : sequence of (F, 3), (F, 4), (F, 6) or (F, 8) int arrays
        Faces of elements, outward: corners, then the nodes between them.

    Returns
    -------
    vectors : (N, 3) array
        ``∫ N n dA``, outward.
    areas : (N,) array
        ``∫ N dA``.
    """
    vectors, areas = np.zeros_like(points), np.zeros(len(points))
    for nodes in faces:
        corners = 3 if nodes.shape[1] in (3, 6) else 4
        xi, weights = _rule(corners)
        shape = _triangle if corners == 3 else _quadrilateral
        N, dN = shape(xi, nodes.shape[1] > corners)
        tangents = np.einsum("qna,fnx->qafx", dN, points[nodes])
        normals = weights[:, None, None] * np.cross(tangents[:, 0], tangents[:, 1])
        np.add.at(vectors, nodes, np.einsum("qn,qfx->fnx", N, normals))
        np.add.at(areas, nodes, np.einsum("qn,qf->fn", N, np.linalg.norm(normals, axis=2)))
    return vectors, areas


def _write_vectors(group: h5py.Group, columns: list[str], nodes: IntArray, values: Floats) -> None:
    group.attrs["columns"] = columns
    group["nodes"] = nodes
    group["values"] = values


def _table(
    entry: Reader, columns: int, select: Callable[[Any, str], IntArray], folder: Path
) -> tuple[IntArray, Floats]:
    """Nodes, ascending, and so many numbers of each: of a CSV file of node numbers (from 1) and
    numbers, or an array of such rows. Rows of one node are summed."""
    given, where = entry.get("table"), f"{entry.where}: table"
    with errors_of(where):
        if isinstance(given, str):
            if not (folder / given).is_file():
                raise BodyError(f"{where}: {folder / given}: no such file")
            given = np.loadtxt(folder / given, delimiter=",", ndmin=2)
        table = np.array(given, dtype=float)
    if table.ndim != 2 or table.shape[1] != columns + 1 or not len(table):
        raise BodyError(f"{where}: expected rows of a node number and {columns} "
                        f"number{'s' if columns > 1 else ''}, comma separated")  # fmt: skip
    if not np.all(np.isfinite(table)) or np.any(table[:, 0] != np.round(table[:, 0])):
        raise BodyError(f"{where}: node numbers must be whole, and all numbers finite")
    labels, at = np.unique(table[:, 0], return_inverse=True)
    nodes = select([int(label) for label in labels], where)
    values = np.zeros((len(nodes), columns))
    np.add.at(values, at, table[:, 1:])
    return nodes, values


def _write_temperature(
    file: h5py.File,
    group: h5py.Group,
    entry: Reader,
    blocks: Sequence[tuple[str, IntArray]],
    select: Callable[[Any, str], IntArray],
    folder: Path,
) -> str:
    """A field of temperature as the load of its strain; the field itself for stresses."""
    from flexgram.stress import Stresses  # it takes the compiled module

    temperature = np.zeros(len(file["mesh/points"]))
    if ("nodes" in entry.data) == ("table" in entry.data):
        raise BodyError(f"{entry.where}: temperature needs nodes, or a table of node and "
                        "temperature")  # fmt: skip
    if "table" in entry.data:
        nodes, values = _table(entry, 1, select, folder)
        temperature[nodes] = values[:, 0]
    else:
        temperature[select(entry.get("nodes"), entry.where)] = 1.0
    for kind, elements in blocks:
        if kind == "line" and temperature[elements].any():
            raise BodyError(f"{entry.where}: beams take no temperature")
    with errors_of(entry.where):
        forces, _ = Stresses.of(file).heated(temperature)
    used = np.flatnonzero(np.any(forces != 0, axis=1))
    if not len(used):
        raise BodyError(f"{entry.where}: it warms nothing that deforms")
    _write_vectors(group, ["T"], used, forces[used][:, None, :])
    warm = np.flatnonzero(temperature)
    group["temperature/nodes"], group["temperature/values"] = warm, temperature[warm]
    return f"temperature of {len(warm)} nodes"


def temperatures(file: h5py.File) -> dict[str, Floats]:
    """Fields of temperature of a body file by their inputs, (N,) [K]."""
    found = {}
    for name, group in file.get("loads", {}).items():
        if "temperature" in group:
            field = np.zeros(len(file["mesh/points"]))
            field[group["temperature/nodes"][:]] = group["temperature/values"][:]
            found[f"{name}.T"] = field
    return found


def write_loads(
    file: h5py.File,
    reader: Reader,
    points: Floats,
    blocks: Sequence[tuple[str, IntArray]],
    units: Sequence[float],
    select: Callable[[Any, str], IntArray],
    folder: Path,
) -> dict[str, str]:
    """Write the loads of a description to a body file.

    Parameters
    ----------
    file : h5py.File
    reader : Reader
        Of the whole description.
    points : (N, 3) array
        In the mesh's unit.
    blocks : sequence of (str, int array)
        Elements of the body: meshio type and nodes.
    units : sequence of float
        Of the mesh: length [m], mass [kg], force [N].
    select : callable
        Nodes of a choice, and where it stands.
    folder : Path
        Which paths are relative to.

    Returns
    -------
    dict of str
        For each load what it is.
    """
    said = {}
    length, _, force = units
    for order, (name, data) in enumerate(reader.children("loads").items()):
        entry = Reader(data, f"loads: {name}", ("type", "nodes", "point", "axis", "table"))
        kind = entry.choice("type", TYPES)
        group = file.create_group(f"loads/{check_name(entry.where, str(name))}")
        group.attrs["order"] = order
        group.attrs["type"] = kind if kind in FIELDS else "forces"
        for key in ("nodes", "point", "axis", "table"):
            needs = {
                "nodes": kind not in (*FIELDS, "nodal"),
                "point": kind in FIELDS[1:],
                "axis": kind == "spin",
                "table": kind in ("nodal", "temperature"),
            }[key]
            if key in entry.data and not needs:
                raise BodyError(f"{entry.where}: {kind} takes no {key}")
        if kind in FIELDS:
            said[str(name)] = kind
            if kind != "acceleration":
                group.attrs["point"] = length * entry.vector("point")
            if kind == "spin":
                axis = entry.vector("axis")
                if not np.linalg.norm(axis) > 0:
                    raise BodyError(f"{entry.where}: axis = [0, 0, 0] has no direction")
                group.attrs["axis"] = axis / np.linalg.norm(axis)
            continue
        if kind == "nodal":
            nodes, table = _table(entry, 3, select, folder)
            _write_vectors(group, ["load"], nodes, force * table[:, None, :])
            total = ", ".join(f"{x:.4g}" for x in force * table.sum(axis=0))
            said[str(name)] = f"forces at {len(nodes)} nodes, ({total}) N in all"
            continue
        if kind == "temperature":
            said[str(name)] = _write_temperature(file, group, entry, blocks, select, folder)
            continue
        nodes = select(entry.get("nodes"), entry.where)
        if kind == "force":
            values = np.broadcast_to(np.eye(3) / len(nodes), (len(nodes), 3, 3))
            _write_vectors(group, ["f" + axis for axis in AXES], nodes, values)
            said[str(name)] = f"force, spread over {len(nodes)} nodes"
            continue
        faces = whole_faces(blocks, nodes, len(points))
        if not faces:
            raise BodyError(f"{entry.where}: no face of an element has all its nodes among the "
                            f"{len(nodes)} chosen")  # fmt: skip
        vectors, areas = areas_at_nodes(length * points, faces)
        used = np.flatnonzero(areas)
        if kind == "pressure":
            _write_vectors(group, ["p"], used, -vectors[used][:, None, :])
        else:
            _write_vectors(group, ["t" + axis for axis in AXES], used,
                           areas[used][:, None, None] * np.eye(3))  # fmt: skip
        said[str(name)] = (f"{kind} on {sum(map(len, faces))} faces, "
                           f"{areas.sum():.4g} m^2")  # fmt: skip
    return said


def _write_reaction(
    file: h5py.File,
    group: h5py.Group,
    entry: Reader,
    points: Floats,
    blocks: Sequence[tuple[str, IntArray]],
    length: float,
    select: Callable[[Any, str], IntArray],
) -> str:
    """The force and the moment about a point by which supports hold nodes."""
    chosen = select(entry.get("nodes"), entry.where)
    held = np.zeros((len(points), 6), dtype=bool)
    for support in file.get("supports", {}).values():
        held[np.ix_(support["nodes"][:], support.attrs["components"].astype(int))] = True
    turning = np.concatenate(
        [np.zeros(0, dtype=int), *(nodes.ravel() for kind, nodes in blocks if kind == "line")]
    )
    solid = np.setdiff1d(np.arange(len(points)), turning)
    held[solid, 3:] = False  # they have no rotations
    nodes = chosen[held[chosen].any(axis=1)]
    if not len(nodes):
        raise BodyError(f"{entry.where}: no support holds any of the {len(chosen)} nodes")
    point = entry.vector("point", points[nodes].mean(axis=0))
    arms = points[nodes] - point
    size = np.ptp(points, axis=0).max()
    axes = [a for a in range(3) if held[nodes, a].any()]
    for a in range(3):  # u = e_a × d
        moved = (np.abs(np.cross(np.eye(3)[a], arms)) > 1e-9 * size) & held[nodes, :3]
        if moved.any() or held[nodes, 3 + a].any():
            axes.append(3 + a)
    group.attrs["axes"] = [float(axis) for axis in axes]
    group.attrs["point"] = length * point
    group["nodes"] = nodes
    about = ", ".join(f"{x:.4g}" for x in length * point)
    return f"reaction at {len(nodes)} held nodes, moments about ({about}) m"


def write_outputs(
    file: h5py.File,
    reader: Reader,
    points: Floats,
    blocks: Sequence[tuple[str, IntArray]],
    length: float,
    select: Callable[[Any, str], IntArray],
) -> dict[str, str]:
    """Write the outputs of a description: mean displacements of nodes, of one set or relative to
    another, in the axes or along a direction, mean stresses, and reactions of supports. As
    ``write_loads``; ``length`` is the mesh's unit [m]."""
    said = {}
    stresses: Stresses | None = None  # of the body, and those that its temperatures leave
    heated: dict[str, Floats] = {}
    for order, (name, data) in enumerate(reader.children("outputs").items()):
        entry = Reader(data, f"outputs: {name}",
                       ("type", "nodes", "relative_to", "direction", "point"))  # fmt: skip
        kind = entry.choice("type", OUTPUTS, "displacement")
        foreign = {"displacement": ("point",), "stress": ("relative_to", "direction", "point"),
                   "reaction": ("relative_to", "direction")}[kind]  # fmt: skip
        for key in foreign:
            if key in entry.data:
                raise BodyError(f"{entry.where}: {kind} takes no {key}")
        group = file.create_group(f"outputs/{check_name(entry.where, str(name))}")
        group.attrs["order"] = order
        if kind == "stress":
            from flexgram.stress import COMPONENTS, Stresses  # it takes the compiled module

            chosen = select(entry.get("nodes"), entry.where)
            with errors_of(entry.where):
                if stresses is None:
                    stresses = Stresses.of(file)
                    fields = temperatures(file)
                    heated = {port: stresses.heated(field)[1] for port, field in fields.items()}
                used, rows = stresses.rows(chosen)
            _write_vectors(group, ["s" + pair for pair in COMPONENTS], used, rows)
            if heated:
                held = [stress[chosen].mean(axis=0) for stress in heated.values()]
                group["feedthrough"] = np.array(held).T
                group["feedthrough"].attrs["inputs"] = list(heated)
            said[str(name)] = f"mean stress of {len(chosen)} nodes"
            continue
        if kind == "reaction":
            said[str(name)] = _write_reaction(file, group, entry, points, blocks, length, select)
            continue
        weights: dict[int, float] = {}
        for key, sign in (("nodes", 1.0), ("relative_to", -1.0)):
            if key == "nodes" or key in entry.data:
                chosen = select(entry.get(key), f"{entry.where}: {key}")
                for node in chosen.tolist():
                    weights[node] = weights.get(node, 0.0) + sign / len(chosen)
        if not any(weights.values()):
            raise BodyError(f"{entry.where}: nodes and relative_to are the same")
        directions, columns = np.eye(3), ["u" + axis for axis in AXES]
        if "direction" in entry.data:
            direction = entry.vector("direction")
            if not np.linalg.norm(direction) > 0:
                raise BodyError(f"{entry.where}: direction = {short(direction.tolist())} is none")
            directions, columns = (direction / np.linalg.norm(direction))[None, :], ["u"]
        nodes = np.array(sorted(weights), dtype=np.int64)
        values = np.array([weights[node] for node in nodes.tolist()])
        _write_vectors(group, columns, nodes, values[:, None, None] * directions)
        said[str(name)] = f"mean displacement of {len(nodes)} nodes"
    return said
