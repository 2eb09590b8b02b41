"""Loads of a mesh beside its interfaces: gravity, spin, pressure, traction, forces, temperature,
bolts that are tightened.

A load is written to the body file as a field of acceleration, which the assembly weighs with the
body's mass, or as forces at nodes for a unit of its input, integrated here over faces of elements.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Bools, Floats, Ints, check_name, errors_of
from flexgram.body.face_integrals import areas_at_nodes
from flexgram.body.faces import loose_shells, opposed, whole_faces
from flexgram.body.meshfile import ALONE, LINES, SHELLS, SOLIDS, TURNING
from flexgram.body.reader import Reader
from flexgram.body.second_order import MIDDLE, Gained
from flexgram.body.sections import ROD
from flexgram.body.shell_stress import forces_of_heat, sheets_of
from flexgram.body.spin import unit_axis
from flexgram.body.strain import Heat, expansion_of
from flexgram.body.stress import Stresses
from flexgram.body.whole import Block, Parts

FIELDS = ("acceleration", "angular_acceleration", "spin")
HEAT = ("temperature", "temperature_gradient")
TYPES = (*FIELDS, "pressure", "traction", "force", "nodal", *HEAT, "pretension")
AXES = "xyz"


@dataclass(frozen=True)
class BodyMesh:
    """A body file that is being written, and the mesh that it is made of.

    Attributes
    ----------
    file : h5py.File
    points : (N, 3) array
        In the mesh's unit.
    blocks : sequence of (str, int array)
        Elements of the body: meshio type and nodes.
    length, force : float
        The mesh's units [m], [N].
    select : callable
        Nodes of a choice, and where it stands.
    folder : Path
        Which paths are relative to.
    merged : int array or None
        The node that each became.
    middles : sequence of Gained
        New nodes in the middle of others.
    """

    file: h5py.File
    points: Floats
    blocks: Sequence[tuple[str, Ints]]
    length: float
    force: float
    select: Callable[[Any, str], Ints]
    folder: Path
    merged: Ints | None = None
    middles: Sequence[Gained] = ()


def write_vectors(group: h5py.Group, columns: list[str], nodes: Ints, values: Floats) -> None:
    group.attrs["columns"] = columns
    group["nodes"] = nodes
    group["values"] = values


def _table(mesh: BodyMesh, entry: Reader, *counts: int, mean: bool = False) -> tuple[Ints, Floats]:
    """Nodes, ascending, and as many numbers of each as one of the counts: of a CSV file of node
    numbers (from 1) and numbers, or an array of such rows. Rows of one node, and of nodes that
    merge, are summed, or their mean is taken."""
    given, where = entry.get("table"), f"{entry.where}: table"
    with errors_of(where):
        if isinstance(given, str):
            if not (mesh.folder / given).is_file():
                raise BodyError(f"{where}: {mesh.folder / given}: no such file")
            given = np.loadtxt(mesh.folder / given, delimiter=",", ndmin=2)
        table = np.array(given, dtype=float)
    if table.ndim != 2 or table.shape[1] - 1 not in counts or not len(table):
        raise BodyError(
            f"{where}: expected rows of a node number and {' or '.join(map(str, counts))} "
            f"number{'s' if counts[-1] > 1 else ''}, comma separated"
        )
    if not np.all(np.isfinite(table)) or np.any(table[:, 0] != np.round(table[:, 0])):
        raise BodyError(f"{where}: node numbers must be whole, and all numbers finite")
    mesh.select([int(label) for label in np.unique(table[:, 0])], where)  # all are there
    places = table[:, 0].astype(np.int64) - 1
    if mesh.merged is not None:
        places = mesh.merged[places]
    nodes, at = np.unique(places, return_inverse=True)
    values = np.zeros((len(nodes), table.shape[1] - 1))
    if mean:
        np.add.at(values, at, table[:, 1:] / np.bincount(at)[at][:, None])
    else:
        np.add.at(values, at, table[:, 1:])
    return nodes, values


@dataclass(frozen=True)
class _Lines:
    """Beams and rods of a body file, of one material and section.

    Attributes
    ----------
    nodes, along, length : (e, 2), (e, 3), (e,) array
        Of each, its direction and [m].
    stiffness, area : float
        E A [N], [m²].
    material : mapping
    """

    nodes: Ints
    along: Floats
    length: Floats
    stiffness: float
    area: float
    material: Any

    @classmethod
    def of(cls, file: h5py.File) -> Iterator[_Lines]:
        points = file["mesh/points"][:]
        for block in file["mesh/blocks"].values():
            if str(block.attrs["type"]) not in LINES:
                continue
            nodes = block["connectivity"][:]
            along = points[nodes[:, 1]] - points[nodes[:, 0]]
            length = np.linalg.norm(along, axis=1)
            material = file["materials"][str(block.attrs["material"])].attrs
            area = float(file["sections"][str(block.attrs["section"])].attrs["A"])
            stiffness = float(material["E"]) * area
            yield cls(nodes, along / length[:, None], length, stiffness, area, material)

    def add_forces(self, strain: Floats, forces: Floats) -> None:
        """What strains (e,) along them push at their ends, if these are held, to forces (N, 3)."""
        force = self.stiffness * strain[:, None] * self.along
        np.add.at(forces, self.nodes[:, 1], force)
        np.add.at(forces, self.nodes[:, 0], -force)


def _heat_of_lines(file: h5py.File, temperature: Floats) -> Floats:
    """Forces (N, 3) [N] of beams and rods in a field of temperature (N,): E A α T along each,
    T the mean of its ends."""
    forces: Floats = np.zeros((len(temperature), 3))
    for lines in _Lines.of(file):
        if not temperature[lines.nodes].any():
            continue
        axes = np.reshape(lines.material.get("axes", np.eye(3)), (3, 3))
        strain = expansion_of(lines.material, axes)
        if strain is None:
            raise BodyError("temperature: a material that it warms has no expansion [1/K]")
        x, y, z = lines.along.T
        stretch = np.column_stack([x * x, y * y, z * z, x * y, y * z, z * x]) @ strain
        lines.add_forces(stretch * temperature[lines.nodes].mean(axis=1), forces)
    return forces


def _shortened_lines(
    file: h5py.File, chosen: Bools, axis: Floats
) -> tuple[Floats, float, float, list[Ints]]:
    """As ``Stresses.shortened``, of beams and rods: by the part of the strain along them."""
    forces: Floats = np.zeros((len(chosen), 3))
    held = volume = 0.0
    shanks = []
    for lines in _Lines.of(file):
        own = chosen[lines.nodes].all(axis=1)
        share = np.where(own, (lines.along @ axis) ** 2, 0.0)
        lines.add_forces(-share, forces)
        held += lines.stiffness * float(share**2 @ lines.length)
        volume += lines.area * float(lines.length[own].sum())
        shanks.append(lines.nodes[own])
    return forces, held, volume, shanks


def _write_temperature(mesh: BodyMesh, group: h5py.Group, entry: Reader) -> str:
    """A field of temperature as the load of its strain; the field itself for stresses."""
    is_gradient = entry.get("type") == "temperature_gradient"
    temperature, gradient = heat = Heat(*np.zeros((2, len(mesh.points))))
    if is_gradient:
        gradient[mesh.select(entry.get("nodes"), entry.where)] = 1.0
    elif ("nodes" in entry.data) == ("table" in entry.data):
        raise BodyError(
            f"{entry.where}: temperature needs nodes, or a table of node and temperature"
        )
    elif "table" in entry.data:
        nodes, values = _table(mesh, entry, 1, 2, mean=True)
        temperature[nodes] = values[:, 0]
        gradient[nodes] = values[:, 1] / mesh.length if values.shape[1] > 1 else 0.0
    else:
        temperature[mesh.select(entry.get("nodes"), entry.where)] = 1.0
    for middles in mesh.middles:
        around = middles.around if mesh.merged is None else mesh.merged[middles.around]
        for field in heat:
            field[middles.nodes] = field[around] @ MIDDLE
    with errors_of(entry.where):
        sheets = sheets_of(mesh.file)
        slanted = np.flatnonzero(gradient)
        of_shells = [n.ravel() for kind, n in mesh.blocks if kind.partition("/")[0] in SHELLS]
        flat = np.setdiff1d(slanted, np.concatenate([slanted[:0], *of_shells]))
        if len(flat):
            raise BodyError(
                f"a gradient of temperature is one of shells, and node {flat[0] + 1} is of none"
            )
        forces = forces_of_heat(mesh.length * mesh.points, sheets, heat)
        forces[:, :3] += _heat_of_lines(mesh.file, temperature)
        if any(kind in SOLIDS for kind, _ in mesh.blocks):
            forces[:, :3] += Stresses.of(mesh.file).heated(temperature)[0]
    if not forces[:, 3:].any():
        forces = forces[:, :3]
    used = np.flatnonzero(np.any(forces != 0, axis=1))
    if not len(used):
        raise BodyError(f"{entry.where}: it warms nothing that deforms")
    write_vectors(group, ["Tn" if is_gradient else "T"], used, forces[used][:, None, :])
    warm = np.flatnonzero((temperature != 0) | (gradient != 0))
    group["temperature/nodes"], group["temperature/values"] = warm, temperature[warm]
    if gradient.any():
        group["temperature/gradients"] = gradient[warm]
    if is_gradient:
        return f"temperature gradient of {len(warm)} nodes"
    said = f"temperature of {len(warm)} nodes, {_range(temperature[warm])} K"
    return said + (f", gradient {_range(gradient[warm])} K/m" if gradient.any() else "")


def _three(vector: Floats) -> str:
    """Three numbers, those that are rounding beside the others as 0."""
    size = float(np.abs(vector).max(initial=0))
    return ", ".join(f"{x if abs(x) > 1e-9 * size else 0.0:.4g}" for x in vector)


def _range(values: Floats) -> str:
    least, most = float(values.min()), float(values.max())
    return f"{most:.4g}" if most - least <= 1e-9 * abs(most) else f"{least:.4g} to {most:.4g}"


def _totals(mesh: BodyMesh, nodes: Ints, table: Floats) -> str:
    """Of forces and moments (k, 3 or 6) [N], [N m]; the moment where there is no force alone."""
    forces, place = table[:, :3], mesh.length * mesh.points[nodes]
    moment = np.cross(place, forces).sum(axis=0)
    if table.shape[1] > 3:
        moment += table[:, 3:].sum(axis=0)
    total = forces.sum(axis=0)
    arm = max(float(np.ptp(place, axis=0).max()), 1e-300)
    largest = max(float(np.abs(forces).max()), float(np.abs(moment).max()) / arm)
    total[np.abs(total) < 1e-9 * largest] = 0
    said = f"({_three(total)}) N in all"
    if table.shape[1] > 3 or not total.any():
        said += f", ({_three(moment)}) N m about the origin"
    return said


def _write_pretension(mesh: BodyMesh, group: h5py.Group, entry: Reader) -> str:
    """A shank that shortens along its axis, as the load of that strain, and what its force is
    computed from."""
    chosen = np.zeros(len(mesh.points), dtype=bool)
    chosen[mesh.select(entry.get("nodes"), entry.where)] = True
    for middles in mesh.middles:
        chosen[middles.nodes] = chosen[middles.around].all(axis=1)
    axis = unit_axis(entry)
    for kind, elements in mesh.blocks:
        if kind not in (*SOLIDS, *LINES, ROD, ALONE) and chosen[elements].all(axis=1).any():
            raise BodyError(f"{entry.where}: a pretension is of solids, beams and rods")
    with errors_of(entry.where):
        forces, held, volume, elements_of = _shortened_lines(mesh.file, chosen, axis)
        if any(kind in SOLIDS for kind, _ in mesh.blocks):
            of_solids = Stresses.of(mesh.file).shortened(chosen, axis)
            forces = forces + of_solids[0]
            held, volume = held + of_solids[1], volume + of_solids[2]
            elements_of += of_solids[3]
    shank = np.unique(np.concatenate([*elements_of, np.empty((0, 1), np.int64)], axis=None))
    if not len(shank):
        raise BodyError(
            f"{entry.where}: no element that deforms has all its nodes among the "
            f"{np.count_nonzero(chosen)} chosen: choose those of the whole shank, not of a face"
        )
    blocks = [Block("", nodes, nodes[:, 0]) for nodes in elements_of if len(nodes)]
    pieces = len(Parts.of(len(mesh.points), blocks, ()).nodes)
    if pieces > 1:
        raise BodyError(
            f"{entry.where}: its shank is in {pieces} pieces: give each bolt a load of its own "
            "(what is inside a rigid interface does not shorten)"
        )
    for name, other in mesh.file["loads"].items():
        if "pretension" not in other or other == group:
            continue
        theirs = np.isin(np.arange(len(chosen)), other["pretension/nodes"][:])
        if any(theirs[elements].all(axis=1).any() for elements in elements_of):
            raise BodyError(f"{entry.where}: it shares elements of its shank with {name}")
    length = float(np.ptp(mesh.length * mesh.points[shank] @ axis))
    if not length > 0 or not held > 0:
        raise BodyError(f"{entry.where}: its shank has no length along the axis")
    used = np.flatnonzero(np.any(forces != 0, axis=1))
    write_vectors(group, ["force"], used, forces[used][:, None, :])
    group["pretension/nodes"] = np.flatnonzero(chosen)
    group["pretension"].attrs.update(axis=axis, held=held, length=length)
    return f"pretension of a shank {length:.4g} m long, {volume / length:.3g} m² in the mean"


def _expect_rotations(mesh: BodyMesh, nodes: Ints, where: str) -> None:
    """Refuse moments at nodes that have no rotations: of solids, and of no rigid interface."""
    turning = [elements.ravel() for kind, elements in mesh.blocks if kind in TURNING]
    turning += [
        group["nodes"][:]
        for group in mesh.file.get("interfaces", {}).values()
        if str(group.attrs["coupling"]) == "rigid"
    ]
    without = np.setdiff1d(nodes, np.concatenate([np.empty(0, dtype=np.int64), *turning]))
    if len(without):
        raise BodyError(
            f"{where}: node {without[0] + 1} is one of solids, which take no moment: give a couple "
            "of forces, or make a rigid interface there"
        )


def _expect_one_side(faces: Sequence[Ints], where: str) -> None:
    """Refuse a pressure on shells whose normals point to different sides."""
    whole = [np.column_stack([f, f[:, :1]]) if f.shape[1] == 3 else f for f in faces]
    edge = opposed(np.vstack(whole)) if whole else None
    if edge is not None:
        raise BodyError(
            f"{where}: pressure acts along the normals of shells, and those of two shells at "
            f"nodes {edge[0] + 1} and {edge[1] + 1} point to different sides: turn one of them in "
            "the mesh (gmsh: Reverse Surface), or give each its own load"
        )


def write_loads(mesh: BodyMesh, reader: Reader) -> dict[str, str]:
    """Write the loads of a description, of which ``reader`` reads the whole; returns for each load
    what it is."""
    said = {}
    for order, (name, data) in enumerate(reader.children("loads").items()):
        entry = Reader(
            data, f"loads: {name}", ("type", "nodes", "point", "axis", "table", "vector")
        )
        kind = entry.choice("type", TYPES)
        group = mesh.file.create_group(f"loads/{check_name(entry.where, str(name))}")
        group.attrs["order"] = order
        group.attrs["type"] = kind if kind in FIELDS else "forces"
        for key in ("nodes", "point", "axis", "table", "vector"):
            needs = {
                "vector": kind == "acceleration",
                "nodes": kind not in (*FIELDS, "nodal"),
                "point": kind in FIELDS[1:],
                "axis": kind in ("spin", "pretension"),
                "table": kind in ("nodal", "temperature"),
            }[key]
            if key in entry.data and not needs:
                raise BodyError(f"{entry.where}: {kind} takes no {key}")
        if kind in FIELDS:
            said[str(name)] = kind
            if "vector" in entry.data:
                group.attrs["vector"] = mesh.length * entry.vector("vector")
                said[str(name)] += f" ({_three(group.attrs['vector'])}) m/s²"
                if not group.attrs["vector"].any():
                    raise BodyError(f"{entry.where}: vector = [0, 0, 0] is no acceleration")
            if kind != "acceleration":
                group.attrs["point"] = mesh.length * entry.vector("point")
            if kind == "spin":
                group.attrs["axis"] = unit_axis(entry)
            continue
        if kind == "nodal":
            nodes, table = _table(mesh, entry, 3, 6)
            _expect_rotations(mesh, nodes[np.any(table[:, 3:] != 0, axis=1)], entry.where)
            table *= mesh.force
            table[:, 3:] *= mesh.length
            write_vectors(group, ["load"], nodes, table[:, None, :])
            said[str(name)] = f"forces at {len(nodes)} nodes, {_totals(mesh, nodes, table)}"
            continue
        if kind in HEAT:
            said[str(name)] = _write_temperature(mesh, group, entry)
            continue
        if kind == "pretension":
            said[str(name)] = _write_pretension(mesh, group, entry)
            continue
        nodes = mesh.select(entry.get("nodes"), entry.where)
        if kind == "force":
            values = np.broadcast_to(np.eye(3) / len(nodes), (len(nodes), 3, 3))
            write_vectors(group, ["f" + axis for axis in AXES], nodes, values)
            said[str(name)] = f"force, spread over {len(nodes)} nodes"
            continue
        faces = whole_faces(mesh.blocks, nodes, len(mesh.points))
        if not faces:
            raise BodyError(
                f"{entry.where}: no face of an element has all its nodes among the "
                f"{len(nodes)} chosen"
            )
        vectors, areas = areas_at_nodes(mesh.length * mesh.points, faces)
        used = np.flatnonzero(areas)
        if kind == "pressure":
            _expect_one_side(loose_shells(mesh.blocks, nodes, len(mesh.points)), entry.where)
            write_vectors(group, ["p"], used, -vectors[used][:, None, :])
        else:
            write_vectors(
                group, ["t" + axis for axis in AXES], used, areas[used][:, None, None] * np.eye(3)
            )
        said[str(name)] = f"{kind} on {sum(map(len, faces))} faces, {areas.sum():.4g} m^2"
    return said
