"""A page about what is there before reduction: a body, or a mesh with its sets."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, errors_of, written_aside
from flexgram.body.meshfile import cell_regions, node_set, read_mesh
from flexgram.body.whole import mass_facts
from flexgram.model.geometry import Geometry, length_unit
from flexgram.pictures import page, tables
from flexgram.pictures.scene import MARKS, Scene, libraries


def write_view(path: str | Path, output: str | Path) -> None:
    """Write a page with the body in space, its interfaces or sets of nodes, and what it is.

    Parameters
    ----------
    path : str or Path
        Body file, or a mesh in any format that is read.
    output : str or Path
        ``.html`` file to write; nothing else is needed to show it.

    Raises
    ------
    BodyError
        Without a mesh to draw, or without the libraries of the page.

    Examples
    --------
    >>> write_view("rack.h5", "body.html")
    """
    page.expect_name(output)
    if not libraries():
        raise BodyError(page.WITHOUT)
    path = Path(path)
    is_body = path.exists() and h5py.is_hdf5(path)
    if is_body and not _has_mesh(path):
        raise BodyError(f"{path}: it has no mesh to draw (a body of matrices, or a sweep)")
    geometry = Geometry.load(path) if is_body else _of_mesh(path)
    scene = Scene.of(geometry)
    words = _of_body(path) if is_body else ""
    unit, length = length_unit(path) if is_body else ("units of the mesh", 1.0)
    references = _references(path, length) if is_body else {}
    rows = "".join(
        f'<tr><td><span style="color:{MARKS[k % len(MARKS)]}">■</span> {html.escape(name)}</td>'
        f"<td class=n>{len(nodes)}</td>"
        f"<td>{_middle(at / length)}</td>"
        + (f"<td>{references.get(name, '')}</td>" if references else "")
        + "</tr>"
        for k, ((name, nodes), at) in enumerate(
            zip(scene.interfaces.items(), scene.positions.values(), strict=True)
        )
    )
    size = ", ".join(f"{x:.4g}" for x in np.ptp(geometry.points, axis=0) / length)
    kinds = ", ".join(
        f"{sum(len(c) for k, c in geometry.blocks if k == kind):,} {kind}"
        for kind in dict.fromkeys(k for k, _ in geometry.blocks)
    )
    what = "interface" if is_body else "set"
    parts = [
        f"<h1>{html.escape(path.name)}</h1>",
        f"<p class=lead>{len(geometry.points):,} nodes, {html.escape(kinds)}; it measures {size} "
        f"{unit}.</p>",
        words,
        page.viewer(scene, f"{what}s"),
        f"<table><tr><th>{what}</th><th>nodes</th><th>their mean [{unit}]</th>"
        + (f"<th>forces act at [{unit}]</th>" if references else "")
        + f"</tr>{rows}</table>"
        if rows
        else f"<p>It has no {what}s.</p>",
    ]
    with written_aside(output, path) as place:
        place.write_text(page.document(path.name, parts, {"scene-data": scene.data()}))


def _middle(at: Any) -> str:
    if not len(at):
        return "none"
    return ", ".join(f"{x:.5g}" for x in np.round(np.mean(at, axis=0), 9) + 0.0)


def _references(path: Path, length: float) -> dict[str, str]:
    """Where forces and moments at each interface of a body act, in units of so many metres."""
    with h5py.File(path) as file:
        return {
            name: _middle(np.atleast_2d(group.attrs["position"]) / length)
            for name, group in file.get("interfaces", {}).items()
            if "position" in group.attrs
        }


def _has_mesh(path: Path) -> bool:
    with errors_of(path), h5py.File(path) as file:
        return "mesh/points" in file or "geometry/blocks" in file


def _of_body(path: Path) -> str:
    """Mass and materials of a body that flexgram assembles."""
    with h5py.File(path) as file:
        if "mesh/blocks" not in file or "materials" not in file:
            return ""
        facts = mass_facts(file)
        names = ", ".join(file["materials"])
    return tables.of_mass(facts.mass, facts.centre, facts.inertia) + (
        f"<p class=lead>Materials: {html.escape(names)}.</p>"
    )


def _of_mesh(path: Path) -> Geometry:
    """With its sets of nodes for interfaces; of sets of elements their nodes."""
    mesh = read_mesh(path)
    blocks = [(str(block.type), np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
    regions = cell_regions(mesh)
    names = dict.fromkeys([*mesh.point_sets, *(name for name in regions if name != "all")])
    sets = {str(name): node_set(mesh, regions, name) for name in names}
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    return Geometry(points, np.arange(len(points)), blocks, {}, sets)
