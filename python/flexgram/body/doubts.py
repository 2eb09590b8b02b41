"""Warnings and refusals of an import: loose parts, hinges, impossible interfaces, some stress."""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.constraints import Constraints
from flexgram.body.discrete import joined_nodes
from flexgram.body.meshfile import SHELLS, TURNING
from flexgram.body.reader import LOSS, Reader
from flexgram.body.whole import Block, Parts, doubts_of_parts


def parts_of(file: h5py.File, count: int, elements: Sequence[Block]) -> Parts:
    """Parts of a body of ``count`` nodes, by what joins them."""
    nodes = [
        group["nodes"][:]
        for group in file["interfaces"].values()
        if group.attrs["coupling"] == "rigid"  # the others follow their nodes
    ]
    joined = [*nodes, *joined_nodes(file), *Constraints.of(file).joined()]
    return Parts.of(count, elements, joined)


def doubts_of_joints(
    file: h5py.File, points: Floats, parts: Parts, used: Ints, held: Sequence[Ints]
) -> list[str]:
    """Parts that nothing joins, and rigid interfaces that leave nothing elastic.

    Parameters
    ----------
    file : h5py.File
        Body file with its interfaces, constraints, masses and springs.
    points : (N, 3) array
        In the mesh's own units.
    parts : Parts
    used : (n,) int array
        Nodes of the body.
    held : sequence of int arrays
        Nodes of each support.
    """
    nodes = {name: group["nodes"][:] for name, group in file["interfaces"].items()}
    supported = np.concatenate([*held, Constraints.of(file).holding])
    found = doubts_of_parts(points, parts, nodes, supported)
    for name, group in file["interfaces"].items():
        if group.attrs["coupling"] == "rigid" and np.isin(used, nodes[name]).all():
            found.append(f"the rigid interface {name} holds every node: nothing is elastic")
    return found


def doubts_of_hinges(file: h5py.File, reader: Reader, elements: Sequence[Block]) -> list[str]:
    """Supports that say nothing of rotations, which their nodes have."""
    turning = [block.nodes.ravel() for block in elements if block.kind in ("line", *SHELLS)]
    nodes_that_turn = np.unique(np.concatenate([*turning, np.empty(0, np.int64)]))
    return [
        f"support {name}: x, y and z of its nodes are held, and they turn freely. A clamp is "
        "components: [x, y, z, rx, ry, rz]"
        for name, entry in reader.children("supports").items()
        if "components" not in entry
        and np.isin(file[f"supports/{name}/nodes"][:], nodes_that_turn).any()
    ]


def doubts_of_gravity(file: h5py.File, length: float) -> list[str]:
    """Accelerations of 9.81 in a unit of ``length`` [m] that is not the metre."""
    found = []
    for name, group in file.get("loads", {}).items():
        size = float(np.linalg.norm(group.attrs.get("vector", 0.0))) / length
        if length != 1 and 9.7 < size < 9.9:
            found.append(
                f"load {name}: {size:.4g} is in units of the mesh, where gravity is "
                f"{9.81 / length:.6g}"
            )
    return found


def doubts_of_stress(file: h5py.File, reader: Reader) -> list[str]:
    """Stress, that of heat too, is that of what K holds: materials that relax have more."""
    relaxing = [name for name, material in file["materials"].items() if set(material) - {LOSS}]
    found = []
    for key, kind in (("outputs", "stress"), ("loads", "temperature")):
        entries = reader.children(key)
        some = [str(name) for name, entry in entries.items() if entry.get("type") == kind]
        if relaxing and some:
            found.append(
                f"{key} {', '.join(some)}: stress in {', '.join(relaxing)} is that of the "
                "long-term (of a table or a parameter: the least) moduli, without what is "
                "beside these"
            )
    return found


def expect_possible_interfaces(
    file: h5py.File, points: Floats, elements: Sequence[Block], alone: Ints
) -> None:
    """Nodes without rotations carry moments unless they lie on a line, and a rigid interface
    moves all of its nodes: no support holds one. ``points`` as in the mesh; ``alone``: nodes
    without elements.

    Raises
    ------
    BodyError
        Naming the interface.
    """
    of_rigid = {
        name: group["nodes"][:]
        for name, group in file["interfaces"].items()
        if group.attrs["coupling"] == "rigid"
    }
    kinds = [block.nodes.ravel() for block in elements if block.kind in TURNING]
    turn = np.unique(np.concatenate([*kinds, alone.ravel()]))
    for name, group in file["interfaces"].items():
        coupling, nodes = group.attrs["coupling"], group["nodes"][:]
        if coupling == "node" and len(nodes) > 1:
            raise BodyError(
                f"interface {name}: coupling node is of one node, and it has {len(nodes)}; a rigid "
                "or a distributing one takes them all"
            )
        for other, moved in of_rigid.items():
            if coupling == "node" and np.isin(nodes, moved).any():
                raise BodyError(
                    f"interface {name}: node {nodes[0] + 1} is one of the rigid interface {other}, "
                    f"and moves with it: forces act at {other}"
                )
        if coupling != "node" and not np.isin(nodes, turn).any():
            places = points[nodes] - points[nodes].mean(axis=0)
            sizes = [*np.linalg.svd(places, compute_uv=False), 0.0]
            if not sizes[1] > 1e-9 * sizes[0]:
                raise BodyError(
                    f"interface {name} has {len(nodes)} node{'s' * (len(nodes) > 1)} in a line or "
                    "a point, which carry no moment: nodes of solids do not turn. Take those of a "
                    "face, or one node with its own dofs (--node, coupling: node)"
                )
        if coupling != "rigid":
            continue
        for support, entry in file.get("supports", {}).items():
            shared = np.intersect1d(group["nodes"][:], entry["nodes"][:])
            if len(shared):
                raise BodyError(
                    f"interface {name} and support {support} share {len(shared)} nodes, such "
                    f"as {shared[0] + 1}: what is held cannot move as a rigid interface. Leave "
                    "the interface out (the forces of a support are an output, --measure "
                    "NAME=reaction:WHERE), or the support, or take these nodes out of one"
                )
