"""Outputs of a mesh beside its interfaces: mean displacements and stresses, reactions.

Written to the body file as weights of nodes' displacements; of a reaction its nodes, axes and
point, from which the assembly makes its row.
"""

from __future__ import annotations

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, check_name, errors_of
from flexgram.body.loads import AXES, BodyMesh, write_vectors
from flexgram.body.reader import Reader, short
from flexgram.body.stress import COMPONENTS, Stresses, temperatures

OUTPUTS = ("displacement", "stress", "reaction")


def _write_reaction(mesh: BodyMesh, group: h5py.Group, entry: Reader) -> str:
    """The force and the moment about a point by which supports hold nodes."""
    points, chosen = mesh.points, mesh.select(entry.get("nodes"), entry.where)
    held = np.zeros((len(points), 6), dtype=bool)
    for support in mesh.file.get("supports", {}).values():
        held[np.ix_(support["nodes"][:], support.attrs["components"].astype(int))] = True
    turning = np.concatenate(
        [np.zeros(0, dtype=int), *(nodes.ravel() for kind, nodes in mesh.blocks if kind == "line")]
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
    group.attrs["point"] = mesh.length * point
    group["nodes"] = nodes
    about = ", ".join(f"{x:.4g}" for x in mesh.length * point)
    return f"reaction at {len(nodes)} held nodes, moments about ({about}) m"


def write_outputs(mesh: BodyMesh, reader: Reader) -> dict[str, str]:
    """Write the outputs of a description: mean displacements of nodes, of one set or relative to
    another, in the axes or along a direction, mean stresses, and reactions of supports. As
    ``write_loads``."""
    said = {}
    stresses: Stresses | None = None  # of the body, and those that its temperatures leave
    heated: dict[str, Floats] = {}
    for order, (name, data) in enumerate(reader.children("outputs").items()):
        entry = Reader(
            data, f"outputs: {name}", ("type", "nodes", "relative_to", "direction", "point")
        )
        kind = entry.choice("type", OUTPUTS, "displacement")
        foreign = {
            "displacement": ("point",),
            "stress": ("relative_to", "direction", "point"),
            "reaction": ("relative_to", "direction"),
        }[kind]
        for key in foreign:
            if key in entry.data:
                raise BodyError(f"{entry.where}: {kind} takes no {key}")
        group = mesh.file.create_group(f"outputs/{check_name(entry.where, str(name))}")
        group.attrs["order"] = order
        if kind == "stress":
            chosen = mesh.select(entry.get("nodes"), entry.where)
            with errors_of(entry.where):
                if stresses is None:
                    stresses = Stresses.of(mesh.file)
                    fields = temperatures(mesh.file)
                    heated = {port: stresses.heated(field)[1] for port, field in fields.items()}
                used, rows = stresses.rows(chosen)
            write_vectors(group, ["s" + pair for pair in COMPONENTS], used, rows)
            if heated:
                held = [stress[chosen].mean(axis=0) for stress in heated.values()]
                group["feedthrough"] = np.array(held).T
                group["feedthrough"].attrs["inputs"] = list(heated)
            said[str(name)] = f"mean stress of {len(chosen)} nodes"
            continue
        if kind == "reaction":
            said[str(name)] = _write_reaction(mesh, group, entry)
            continue
        weights: dict[int, float] = {}
        for key, sign in (("nodes", 1.0), ("relative_to", -1.0)):
            if key == "nodes" or key in entry.data:
                chosen = mesh.select(entry.get(key), f"{entry.where}: {key}")
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
        write_vectors(group, columns, nodes, values[:, None, None] * directions)
        said[str(name)] = f"mean displacement of {len(nodes)} nodes"
    return said
