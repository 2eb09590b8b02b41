"""Outputs of imported matrices beside their interfaces: mean displacements, stresses and strain
gauges, by the nodes, elements and materials of their CalculiX deck."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.description import import_description
from flexgram.importers.assemble import ELEMENTS, materials_of, mesh_of, number_nodes, supports_of
from flexgram.importers.ccx import Job, frequency_step, read_job
from flexgram.importers.deck import Deck, read_deck
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
    strains = [name for name, entry in outputs.items() if entry["type"] in ("stress", "gauge")]
    others = sorted(fe.types - set(STRAINED))
    if strains and others:
        raise BodyError(
            f"--measure {strains[0]}: stress and strain are known of {', '.join(STRAINED)}; "
            f"{path} has {', '.join(others)}"
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
    return _rows(fe, deck, _resting(job, deck), _vectors(job, deck, outputs, units))


Vectors = dict[str, tuple[list[str], Any, Floats]]  #: columns, nodes from 0, (U, columns, 3)


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
    with tempfile.TemporaryDirectory() as folder:
        body = Path(folder) / "outputs.h5"
        import_description(content, str(job.path), body, mesh=mesh)
        with h5py.File(body) as file:
            groups = sorted(file["outputs"].items(), key=lambda item: int(item[1].attrs["order"]))
            return {
                name: (list(group.attrs["columns"]), group["nodes"][:], group["values"][:])
                for name, group in groups
            }


def _resting(job: Job, deck: Deck) -> set[tuple[int, int]]:
    """Nodes and components that supports hold at zero: (label, 0 to 2)."""
    number = frequency_step(job, None)
    cards = job.step_of(number or 1) if job.steps else []
    return {
        (int(deck.labels[at]), "xyz".index(axis))
        for directions, nodes in supports_of(job, deck, cards).items()
        for at in nodes
        for axis in directions
    }


def _rows(
    fe: FeMatrices, deck: Deck, resting: set[tuple[int, int]], vectors: Vectors
) -> tuple[list[str], Floats]:
    """Weights of the nodes as rows of C."""
    row_of = {
        (int(label), int(c)): row
        for row, (label, c) in enumerate(zip(fe.node, fe.component, strict=True))
        if c < 3
    }
    names: list[str] = []
    rows: list[Floats] = []
    for name, (columns, nodes, values) in vectors.items():
        block = np.zeros((len(columns), fe.n))
        for label, weights in zip(deck.labels[nodes].tolist(), values, strict=True):
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
