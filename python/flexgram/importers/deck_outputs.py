"""Outputs of imported matrices beside their interfaces: mean displacements, stresses and strain
gauges, by the nodes, elements and materials of their CalculiX deck."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.description import import_description
from flexgram.body.selection import in_box, nearest
from flexgram.importers.assemble import ELEMENTS, materials_of, mesh_of, number_nodes
from flexgram.importers.ccx import Job, read_job
from flexgram.importers.deck import Deck, read_deck
from flexgram.importers.deck_loads import held_of
from flexgram.importers.fe import FeMatrices

#: Elements whose strain is that of ours.
STRAINED = (*ELEMENTS, "C3D8I")


def deck_outputs(
    fe: FeMatrices, path: Path, outputs: Mapping[str, Any], units: str
) -> tuple[list[str], Floats]:
    """Rows of C, as assembled bodies have them.

    Parameters
    ----------
    fe : FeMatrices
        The matrices, whose rows belong to nodes of the deck.
    path : Path
        The deck.
    outputs : mapping
        As in a YAML description; node and element numbers and sets are those of the deck.
    units : str
        Of the deck.

    Returns
    -------
    names : list of str
        Such as ``lip.sxx``.
    rows : (k, n) array
        In SI units, of displacements in SI units.

    Raises
    ------
    BodyError
        For elements whose stress is not ours, and for nodes that move but have no rows.
    """
    job, deck = read_job(path), read_deck(path)
    if deck.transformed:
        raise BodyError(
            f"--measure {next(iter(outputs))}: {path} has *TRANSFORM, whose local directions these "
            "outputs do not follow"
        )
    strains = {n: e for n, e in outputs.items() if e["type"] in ("stress", "gauge")}
    others = sorted(fe.types - set(STRAINED))
    if strains and others:
        raise BodyError(
            f"--measure {next(iter(strains))}: stress and strain are known of "
            f"{', '.join(STRAINED)}; {path} has {', '.join(others)}"
        )
    for name, entry in outputs.items():
        if entry["type"] == "reaction":
            raise BodyError(
                f"--measure {name}: reactions are of bodies that flexgram assembles (--assemble): "
                "imported matrices have no rows of held nodes"
            )
    if "C3D8I" in fe.types and strains:
        fe.remarks.append(
            "stress of C3D8I is that of flexgram's own incompatible modes, equal to ccx' in "
            "rectangular elements"
        )
    vectors = _vectors(job, deck, strains, units) if strains else {}
    for name, entry in outputs.items():
        if name not in strains:
            vectors[name] = _displacement(fe, name, entry)
    return _rows(fe, {name: vectors[name] for name in outputs}, held_of(job, deck))


Vectors = dict[str, tuple[list[str], Any, Floats]]  #: columns, node labels, (U, columns, 3)


def _labels(fe: FeMatrices, name: str, where: Any) -> list[int]:
    """Nodes of a choice, as a YAML description has it."""
    place = f"--measure {name}"
    if isinstance(where, dict):
        points = fe.points
        if not len(points):
            raise BodyError(f"{place}: the nodes have no coordinates")
        if "at" in where:
            return [int(fe.labels[nearest(points, np.array(where["at"], dtype=float), place)])]
        corners = np.array(where["box"], dtype=float).reshape(2, 3)
        return [int(label) for label in fe.labels[in_box(points, corners, place)]]
    if isinstance(where, str):
        if where.upper() not in fe.sets:
            known = ", ".join(sorted(fe.sets)) or "none"
            raise BodyError(f"{place}: there is no node set {where}; there are {known}")
        return [int(label) for label in fe.sets[where.upper()]]
    return [int(label) for label in where]


def _displacement(fe: FeMatrices, name: str, entry: Mapping[str, Any]) -> Any:
    """Weights of a mean displacement; nodes that ccx expands count as the mean of these."""
    weights: dict[int, float] = {}
    for key, sign in (("nodes", 1.0), ("relative_to", -1.0)):
        chosen = _labels(fe, name, entry[key]) if key in entry else []
        for label in chosen:
            copies = fe.copies.get(label, np.array([label]))
            for copy in copies.tolist():
                share = sign / len(chosen) / len(copies)
                weights[int(copy)] = weights.get(int(copy), 0.0) + share
    directions, columns = np.eye(3), ["ux", "uy", "uz"]
    if "direction" in entry:
        along = np.array(entry["direction"], dtype=float)
        directions, columns = (along / np.linalg.norm(along))[None, :], ["u"]
    values = np.array(list(weights.values()))
    return columns, np.array(list(weights)), values[:, None, None] * directions


def _vectors(job: Job, deck: Deck, outputs: Mapping[str, Any], units: str) -> Vectors:
    """The outputs of a mesh body of the deck, in SI units."""
    materials = materials_of(job)
    mesh, material_of, _ = mesh_of(job, deck, materials)
    entries = {name: dict(entry) for name, entry in outputs.items()}
    for entry in entries.values():
        number_nodes(job.path, deck, entry)
    used = int(mesh.cells[0].data.min())
    content = {
        "units": units,
        "materials": materials,
        "regions": {region: {"material": name} for region, name in material_of.items()},
        "interfaces": {"a_port": {"coupling": "node", "nodes": [used + 1]}},
        "outputs": entries,
        "repeated_elements": "keep",
    }
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the mesh as a body by itself
        body = Path(folder) / "outputs.h5"
        import_description(content, str(job.path), body, mesh=mesh)
        with h5py.File(body) as file:
            return {
                name: (
                    list(group.attrs["columns"]),
                    deck.labels[group["nodes"][:]],
                    group["values"][:],
                )
                for name, group in file["outputs"].items()
            }


def _rows(
    fe: FeMatrices, vectors: Vectors, resting: set[tuple[int, int]]
) -> tuple[list[str], Floats]:
    """Weights of the nodes as rows of C. ``resting``: nodes and directions that supports hold."""
    row_of = {
        (int(label), int(c)): row
        for row, (label, c) in enumerate(zip(fe.node, fe.component, strict=True))
        if c < 3
    }
    names: list[str] = []
    rows: list[Floats] = []
    for name, (columns, nodes, values) in vectors.items():
        block = np.zeros((len(columns), fe.n))
        for label, weights in zip(nodes.tolist(), values, strict=True):
            for axis in range(3):
                row = row_of.get((label, axis))
                if row is not None:
                    block[:, row] += weights[:, axis]
                elif (label, axis) not in resting and np.any(weights[:, axis]):
                    raise BodyError(
                        f"--measure {name}: node {label} has no row for {'xyz'[axis]} in the "
                        "matrices and no support: it follows others (*EQUATION, *RIGID BODY)"
                    )
        names += [f"{name}.{column}" for column in columns]
        rows.append(block)
    return names, np.vstack(rows)
