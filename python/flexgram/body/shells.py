"""What speaks against a body's shells: hinges at solids, normals that point to different sides."""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.faces import opposed, shells_of
from flexgram.body.meshfile import SHELLS, SOLIDS
from flexgram.body.whole import Block


def first_axis(file: h5py.File, layers: Sequence[str]) -> Floats | None:
    """The direction of angle 0 by the materials of some layers: that of those with fibres.

    Raises
    ------
    BodyError
        If these have different ones.
    """
    axes = [
        np.asarray(file["materials"][name].attrs["axes"])[:3]
        for name in layers
        if "axes" in file["materials"][name].attrs
    ]
    if any(np.abs(axis - axes[0]).max() > 1e-9 for axis in axes):
        raise BodyError(
            "materials of its layers have different axis_1: give the section an axis_1, and the "
            "layers angles from it"
        )
    return axes[0] if axes else None


def doubts_of_shells(file: h5py.File, points: Floats, blocks: Sequence[Block]) -> list[str]:
    """Warnings of an open body file with the elements ``blocks``, in the order of its blocks."""
    return [*_hinges(points, blocks), *_sides(file, blocks)]


def _hinges(points: Floats, blocks: Sequence[Block]) -> list[str]:
    """Shells that share nodes with solids on one line: nothing holds their rotation about it."""
    shells = [block.nodes for block in blocks if block.kind in SHELLS]
    solids = [block.nodes.ravel() for block in blocks if block.kind in SOLIDS]
    if not shells or not solids:
        return []
    edges = np.vstack([np.column_stack([n[:, :-1].ravel(), n[:, 1:].ravel()]) for n in shells])
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(points),) * 2)
    part = connected_components(graph, directed=False)[1]
    shared = np.intersect1d(np.concatenate([n.ravel() for n in shells]), np.concatenate(solids))
    found = []
    for label in np.unique(part[shared]):
        nodes = shared[part[shared] == label]
        x = points[nodes] - points[nodes].mean(axis=0)
        size = np.linalg.svd(x, compute_uv=False)
        if len(size) < 2 or size[1] <= 1e-6 * max(float(size[0]), 1e-300):
            found.append(
                f"shells meet solids at node {nodes[0] + 1}"
                + (" and others on one line" if len(nodes) > 1 else " alone")
                + ": solids hold no rotations, so that it is a hinge there; let the shells go on "
                "over a face of the solids"
            )
    return found


def _sides(file: h5py.File, blocks: Sequence[Block]) -> list[str]:
    """Neighbours of one section whose normals point to different sides, where these matter."""
    found = []
    by_section: dict[str, list[tuple[str, Ints]]] = {}
    for group, block in zip(file["mesh/blocks"].values(), blocks, strict=True):
        if block.kind in SHELLS:
            section = str(group.attrs["section"])
            names = file["sections"][section].attrs.get(
                "layer_materials", [group.attrs["material"]]
            )
            has_sides = float(file["sections"][section].attrs["offset"]) != 0 or len(names) > 1
            if has_sides or any("axes" in file["materials"][str(n)].attrs for n in names):
                by_section.setdefault(section, []).append((block.kind, block.nodes))
    for section, some in by_section.items():
        edge = opposed(shells_of(some))
        if edge is not None:
            found.append(
                f"section {section}: the normals of two shells at nodes {edge[0] + 1} and "
                f"{edge[1] + 1} point to different sides: its offset, layers and angles change "
                "sides there"
            )
    return found
