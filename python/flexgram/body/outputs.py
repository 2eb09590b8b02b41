"""Outputs of a mesh beside its interfaces: mean displacements, stresses, strain gauges, reactions.

Written to the body file as weights of nodes' displacements; of a reaction its nodes, axes and
point, from which the assembly makes its row.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, Ints, check_name, counted, errors_of
from flexgram.body.constraints import Constraints
from flexgram.body.faces import middle_of
from flexgram.body.loads import AXES, BodyMesh, write_vectors
from flexgram.body.meshfile import SOLIDS, TURNING
from flexgram.body.reader import Reader, short
from flexgram.body.shell_stress import SIDES, Sheet, element_rows, nodal_rows, only, sheets_of
from flexgram.body.strain import Heat
from flexgram.body.stress import COMPONENTS, Stresses, temperatures

OUTPUTS = ("displacement", "stress", "gauge", "reaction")
#: What only some of them take.
TAKEN = {
    "displacement": ("nodes", "relative_to", "direction"),
    "stress": ("nodes", "elements", "integration_point", "side"),
    "gauge": ("nodes", "direction", "normal", "side"),
    "reaction": ("nodes", "point"),
}


def _write_reaction(mesh: BodyMesh, group: h5py.Group, entry: Reader) -> str:
    """The force and the moment about a point by which supports hold nodes."""
    points, chosen = mesh.points, mesh.select(entry.get("nodes"), entry.where)
    held = np.zeros((len(points), 6), dtype=bool)
    for support in mesh.file.get("supports", {}).values():
        held[np.ix_(support["nodes"][:], support.attrs["components"].astype(int))] = True
    turning = np.concatenate(
        [
            np.zeros(0, dtype=int),
            *(nodes.ravel() for kind, nodes in mesh.blocks if kind in TURNING),
        ]
    )
    solid = np.setdiff1d(np.arange(len(points)), turning)
    held[solid, 3:] = False  # they have no rotations
    nodes = chosen[held[chosen].any(axis=1)]
    if len(skew := np.intersect1d(chosen, Constraints.of(mesh.file).holding)):
        raise BodyError(
            f"{entry.where}: node {skew[0] + 1} is held by an equation, or along axes of its own: "
            "its reaction is not known"
        )
    if not len(nodes):
        raise BodyError(f"{entry.where}: no support holds any of the {len(chosen)} nodes")
    point = entry.vector("point", middle_of(points, mesh.blocks, nodes).position)
    arms = points[nodes] - point
    size = np.ptp(points, axis=0).max()
    axes = [a for a in range(3) if held[nodes, a].any()]
    for a in range(3):  # u = e_a × d
        moved = (np.abs(np.cross(np.eye(3)[a], arms)) > 1e-9 * size) & held[nodes, :3]
        if moved.any() or held[nodes, 3 + a].any():
            axes.append(3 + a)
    group.attrs["axes"] = [float(axis) for axis in axes]
    group.attrs["point"] = mesh.length * point
    group["nodes"] = nodes
    about = ", ".join(f"{x:.4g}" for x in mesh.length * point)
    return f"reaction at {len(nodes)} held nodes, moments about ({about}) m"


class _Stresses:
    """Those of a body that is being written, and what its temperatures leave of them; made once,
    where the first output needs them."""

    def __init__(self, file: h5py.File) -> None:
        self.file = file

    @cached_property
    def of_body(self) -> Stresses:
        return Stresses.of(self.file)

    @cached_property
    def points(self) -> Floats:
        found: Floats = self.file["mesh/points"][:]
        return found

    @cached_property
    def of_shells(self) -> list[Sheet]:
        return sheets_of(self.file)

    def side(self, entry: Reader) -> str:
        """That of shells which an entry names; empty where it is of solids."""
        if "side" in entry.data:
            if not self.of_shells:
                raise BodyError(f"{entry.where}: side is one of a shell; the body has none")
            return entry.choice("side", SIDES)
        if self.of_shells and not self.has_solids:
            if all(sheet.is_membrane for sheet in self.of_shells):
                return "middle"
            raise BodyError(
                f"{entry.where}: name the side of the shell: top (where its normal points), "
                "middle or bottom (side: top; stress/top:NODES:7 of --measure)"
            )
        return ""

    @cached_property
    def has_solids(self) -> bool:
        kinds = {str(block.attrs["type"]) for block in self.file["mesh/blocks"].values()}
        return bool(kinds & set(SOLIDS))

    @cached_property
    def fields(self) -> dict[str, Heat]:
        return temperatures(self.file)

    @cached_property
    def heated(self) -> dict[str, Floats]:
        return {
            port: self.of_body.heated(field.temperature)[1] for port, field in self.fields.items()
        }


def _write_stress(mesh: BodyMesh, group: h5py.Group, entry: Reader, known: _Stresses) -> str:
    """The mean stress of nodes, or at integration points of elements."""
    side, held = known.side(entry), dict[str, Floats]()
    both = "nodes" in entry.data and "elements" in entry.data
    if not {"nodes", "elements"} & set(entry.data) or (both and not side):
        raise BodyError(f"{entry.where}: name nodes or elements")
    if both or "elements" not in entry.data:
        if "integration_point" in entry.data:
            raise BodyError(f"{entry.where}: nodes have no integration_point, elements have")
        chosen = mesh.select(entry.get("nodes"), entry.where)
        with errors_of(entry.where):
            if side:
                sheets = known.of_shells
                if both:
                    sheets = only(sheets, _whole(entry, "elements", entry.get("elements")))
                used, rows, held = nodal_rows(
                    known.points, sheets, chosen, side, heats=known.fields
                )
            else:
                used, rows = known.of_body.rows(chosen)
                held = {name: field[chosen].mean(axis=0) for name, field in known.heated.items()}
        said = f"stress {_at_nodes(mesh, chosen)}"
    else:
        ids = _whole(entry, "elements", entry.get("elements"))
        point = None
        if "integration_point" in entry.data:
            point = int(_whole(entry, "integration_point", [entry.get("integration_point")])[0])
        with errors_of(entry.where):
            if side:
                used, rows, held = element_rows(
                    known.points, known.of_shells, ids, side, point, known.fields
                )
            else:
                used, rows, held = known.of_body.element_rows(ids, point, known.fields)
        where = "at all integration points" if point is None else f"at integration point {point}"
        said = f"mean stress {where} of {len(ids)} element{'s' * (len(ids) != 1)}"
    columns = ["s" + pair for pair in COMPONENTS]
    if side:
        names = columns
        columns, rows, vanish = _without_zeros(names, rows)
        kept = [names.index(name) for name in columns]
        held = {port: stress[kept] for port, stress in held.items()}
        if not rows[..., 3:].any():  # of membranes
            rows = rows[..., :3]
        said += f" ({', '.join(vanish)} vanish)" if vanish else ""
    said += f", {side} side" if side in ("top", "bottom") else f", {side}" if side else ""
    write_vectors(group, columns, used, rows)
    if held:
        group["feedthrough"] = np.array(list(held.values())).T
        group["feedthrough"].attrs["inputs"] = list(held)
    return said


def _at_nodes(mesh: BodyMesh, nodes: Ints) -> str:
    """Where the node is [m], or how many there are."""
    if len(nodes) > 1:
        return f"in the mean of {len(nodes)} nodes"
    at = ", ".join(f"{x:.6g}" for x in mesh.points[nodes[0]] * mesh.length)
    return f"at the node at ({at}) m"


def _without_zeros(columns: list[str], rows: Floats) -> tuple[list[str], Floats, list[str]]:
    """Columns and rows (U, columns, …) without those that are nothing but rounding: of a flat shell
    across an axis; and their names."""
    size = np.abs(rows).max(axis=(0, 2))
    kept = size > 1e-10 * size.max(initial=0)
    names = [name for name, keep in zip(columns, kept, strict=True) if keep]
    return names, rows[:, kept], [name for name in columns if name not in names]


def _whole(entry: Reader, key: str, given: object) -> Ints:
    numbers = np.atleast_1d(np.asarray(given))
    if numbers.ndim != 1 or not len(numbers) or numbers.dtype.kind != "i":
        raise BodyError(f"{entry.where}: {key} = {short(given)}: expected whole numbers")
    whole: Ints = np.unique(numbers).astype(np.int64)
    return whole


def _write_gauge(mesh: BodyMesh, group: h5py.Group, entry: Reader, known: _Stresses) -> str:
    """The mean strain of nodes along a direction; with the normal of the surface a rosette: along
    the direction in the surface, at 45 and at 90 degrees, counterclockwise seen from outside."""

    def unit(key: str, vector: Floats, least: float = 0.0) -> Floats:
        size = float(np.linalg.norm(vector))
        if not size > least:
            raise BodyError(f"{entry.where}: {key} has no length")
        found: Floats = vector / size
        return found

    chosen = mesh.select(entry.get("nodes"), entry.where)
    along = unit("direction", entry.vector("direction"))
    directions, columns = [along], ["e"]
    if "normal" in entry.data:
        normal = unit("normal", entry.vector("normal"))
        along = unit("direction in the surface", along - normal * (normal @ along), 1e-6)
        across = np.cross(normal, along)
        directions = [along, (along + across) / np.sqrt(2), across]
        columns = ["e0", "e45", "e90"]
    side = known.side(entry)
    with errors_of(entry.where):
        if side:
            used, rows, _ = nodal_rows(known.points, known.of_shells, chosen, side, strain=True)
            if not rows[..., 3:].any():  # of membranes
                rows = rows[..., :3]
        else:
            used, rows = known.of_body.rows(chosen, strain=True)
    x, y, z = np.array(directions).T
    of_strain = np.array([x * x, y * y, z * z, x * y, y * z, z * x])  # engineering shears
    write_vectors(group, columns, used, np.einsum("ck,uca->uka", of_strain, rows))
    return f"strain {'gauge' if len(columns) == 1 else 'rosette'} {_at_nodes(mesh, chosen)}"


def mean_displacement(
    entry: Reader, select: Callable[[Any, str], Ints]
) -> tuple[list[str], Ints, Floats]:
    """The mean of nodes, or relative to that of others, in the axes or along a direction: names of
    columns, nodes, and their weights (nodes, columns, 3). ``select``: nodes of a choice, and where
    it stands."""
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
    return columns, nodes, values[:, None, None] * directions


def write_outputs(mesh: BodyMesh, reader: Reader) -> dict[str, str]:
    """Write the outputs of a description: mean displacements of nodes, stresses, strain gauges, and
    reactions of supports. As ``write_loads``."""
    said = {}
    stresses = _Stresses(mesh.file)
    every = tuple(dict.fromkeys(key for keys in TAKEN.values() for key in keys))
    for order, (name, data) in enumerate(reader.children("outputs").items()):
        entry = Reader(data, f"outputs: {name}", ("type", *every))
        kind = entry.choice("type", OUTPUTS, "displacement")
        for key in every:
            if key in entry.data and key not in TAKEN[kind]:
                raise BodyError(f"{entry.where}: {kind} takes no {key}")
        group = mesh.file.create_group(f"outputs/{check_name(entry.where, str(name))}")
        group.attrs["order"] = order
        if kind == "stress":
            said[str(name)] = _write_stress(mesh, group, entry, stresses)
        elif kind == "gauge":
            said[str(name)] = _write_gauge(mesh, group, entry, stresses)
        elif kind == "reaction":
            said[str(name)] = _write_reaction(mesh, group, entry)
        else:
            columns, nodes, values = mean_displacement(entry, mesh.select)
            write_vectors(group, columns, nodes, values)
            said[str(name)] = f"mean displacement of {counted(len(nodes), 'node')}"
    return said
