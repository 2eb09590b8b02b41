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

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.description import import_description
from flexgram.body.outputs import TAKEN, mean_displacement
from flexgram.body.reader import Reader
from flexgram.body.selection import nearest
from flexgram.importers.assemble import ELEMENTS, number_nodes
from flexgram.importers.ccx import Job, read_job
from flexgram.importers.deck import Deck, read_deck
from flexgram.importers.deck_loads import held_of
from flexgram.importers.deck_materials import materials_of
from flexgram.importers.deck_sections import mesh_of, regions_of, turn_elements, turn_materials
from flexgram.importers.fe import FeMatrices, Interface
from flexgram.importers.interfaces import select

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


def _displacement(fe: FeMatrices, name: str, entry: Mapping[str, Any]) -> Any:
    """Weights of a mean displacement. A node that ccx expands counts as the mean of its copies."""

    def chosen(where: Any, place: str) -> Ints:
        if isinstance(where, Mapping) and "at" in where and len(fe.points):
            # Of all nodes: one that is expanded lies between its copies.
            at = np.array(where["at"], dtype=float)
            return fe.labels[[nearest(fe.points, at, place, fe.remarks.append)]]
        if isinstance(where, Mapping):
            kind, values = next(iter(where.items()))
            where = f"{kind.upper()}:" + ",".join(str(x) for x in np.ravel(values))
        elif isinstance(where, str):
            where = f"NSET:{where}"
        return select(fe, Interface(place, "node", where))

    reader = Reader(dict(entry), f"--measure {name}", ("type", *TAKEN["displacement"]))
    columns, nodes, values = mean_displacement(reader, chosen)
    copies = [fe.copies.get(label, np.array([label])) for label in nodes.tolist()]
    shares = [
        np.repeat(v[None] / len(c), len(c), axis=0) for v, c in zip(values, copies, strict=True)
    ]
    return columns, np.concatenate(copies), np.concatenate(shares)


def _vectors(job: Job, deck: Deck, outputs: Mapping[str, Any], units: str) -> Vectors:
    """The outputs of a mesh body of the deck, in SI units."""
    materials = materials_of(job)
    mesh, material_of, _ = mesh_of(job, deck, materials, {})
    turn_materials(job, material_of, materials)
    turn_elements(job, mesh, material_of)
    entries = {name: dict(entry) for name, entry in outputs.items()}
    for entry in entries.values():
        number_nodes(job.path, deck, entry)
    used = int(mesh.cells[0].data.min())
    content = {
        "units": units,
        "materials": materials,
        "regions": regions_of(material_of, {}),
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
