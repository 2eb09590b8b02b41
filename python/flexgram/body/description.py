"""Body descriptions in YAML: mesh, materials by region, interfaces, supports, damping.

``meshes/rack.yaml`` is the example. ``import_body`` turns a description into a body file that
the program ``flexgram`` assembles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import yaml
from numpy.typing import NDArray

from flexgram.basics import BodyError, Ints, check_name, errors_of, expect_kept
from flexgram.body.bodyfile import written_whole
from flexgram.body.faces import middle_of
from flexgram.body.loads import BodyMesh, write_loads
from flexgram.body.meshfile import (
    ELEMENTS,
    cell_regions,
    data_files,
    node_set,
    read_mesh,
)
from flexgram.body.outputs import write_outputs
from flexgram.body.reader import Reader, UniqueKeys, short
from flexgram.body.sections import section_properties
from flexgram.body.selection import in_box, nearest
from flexgram.body.units import UNITS

COMPONENTS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}
ENGINEERING = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")
ISOTROPIC = ("E", "nu", "rho")
EXPANSION = "expansion"  #: [1/K], if heat is to strain the body; of three directions if orthotropic


def _write_material(file: h5py.File, name: str, data: Any, units: tuple[float, ...]) -> None:
    length, mass, force = units
    stress, density = force / length**2, mass / length**3
    where = f"materials: {name}"
    group = file.create_group(f"materials/{check_name(where, str(name))}")
    if isinstance(data, dict) and "E1" in data:
        reader = Reader(data, where, (*ENGINEERING, "rho", "axis_1", "axis_2", EXPANSION))
        group.attrs["engineering_constants"] = [
            reader.number(key) * (1.0 if key.startswith("nu") else stress) for key in ENGINEERING
        ]
        first, second = reader.vector("axis_1", [1, 0, 0]), reader.vector("axis_2", [0, 1, 0])
        if not np.linalg.norm(first) > 0:
            raise BodyError(f"{where}: axis_1 = [0, 0, 0] has no direction")
        first = first / np.linalg.norm(first)
        second = second - first * (first @ second)
        if np.linalg.norm(second) < 1e-9:
            raise BodyError(f"{where}: axis_1 and axis_2 are parallel")
        second = second / np.linalg.norm(second)
        group.attrs["axes"] = np.concatenate([first, second, np.cross(first, second)])
    else:
        reader = Reader(data, where, (*ISOTROPIC, EXPANSION))
        group.attrs["E"] = reader.number("E") * stress
        group.attrs["nu"] = reader.number("nu")
    group.attrs["rho"] = reader.number("rho") * density
    if EXPANSION in reader.data:
        several = isinstance(reader.data[EXPANSION], list)
        if several and "E1" not in reader.data:
            raise BodyError(f"{where}: expansion is one number where E is")
        group.attrs[EXPANSION] = reader.vector(EXPANSION) if several else reader.number(EXPANSION)


def _select_nodes(
    choice: Any,
    where: str,
    points: NDArray[np.float64],
    used: NDArray[np.bool_],
    sets: Callable[[str], Ints],
) -> Ints:
    """Nodes by set name, by list of 1-based numbers, or, in the mesh's own units, by a box or as
    the one nearest to a place."""
    if isinstance(choice, dict) and "at" in choice:
        at = Reader(choice, where, ("at",)).vector("at")
        nodes = np.flatnonzero(used)
        nodes = nodes[[nearest(points[nodes], at, where)]]
    elif isinstance(choice, dict):
        with errors_of(f"{where}: box"):
            box = np.array(Reader(choice, where, ("box",)).get("box"), dtype=float)
        if box.shape != (2, 3) or not np.all(np.isfinite(box)):
            raise BodyError(
                f"{where}: box must be [[x, y, z] of one corner, [x, y, z] of the other]"
            )
        nodes = np.flatnonzero(used)
        nodes = nodes[in_box(points[nodes], box, where)]
    elif isinstance(choice, list):
        if not all(type(number) is int for number in choice):
            raise BodyError(f"{where}: {short(choice)} must be node numbers")
        with errors_of(where):
            nodes = np.array(choice, dtype=np.int64) - 1
        if nodes.size and (nodes.min() < 0 or nodes.max() >= len(points)):
            raise BodyError(f"{where}: node numbers run from 1 to {len(points)}")
        if len(np.unique(nodes)) < len(nodes):
            raise BodyError(f"{where}: a node is named twice")
        if not used[nodes].all():
            raise BodyError(
                f"{where}: node {nodes[~used[nodes]][0] + 1} belongs to no element of the body"
            )
    else:
        try:
            nodes = sets(str(choice))
        except BodyError as error:
            raise BodyError(f"{where}: {error}") from None
        nodes = nodes[used[nodes]]
    if len(nodes) == 0:
        raise BodyError(f"{where}: no nodes of the body are selected")
    return np.asarray(nodes, dtype=np.int64)


def import_body(description: str | Path, output: str | Path) -> dict[str, Any]:
    """Turn a YAML body description and its mesh into a body file.

    Parameters
    ----------
    description : str or Path
        YAML file; paths in it are relative to it.
    output : str or Path
        Body file to write (HDF5, SI units).

    Returns
    -------
    dict
        ``points`` and ``elements`` (counts), ``interfaces`` (for each name its coupling, number of
        nodes, reference position [m], what that is, and its distance from the middle of the
        interface in extents of that), ``loads`` and ``outputs`` (what each is), ``extent`` (of
        the body, 3 [m]), ``units``.

    Raises
    ------
    BodyError
        With the place in the description and what was expected.
    """
    path = Path(description)
    try:
        content = yaml.load(path.read_text(), UniqueKeys)
    except UnicodeDecodeError:
        raise BodyError(f"{path}: not a text file; describe the mesh in YAML") from None
    except OSError as error:
        raise BodyError(f"{path}: {error.strerror}") from None
    except yaml.YAMLError as error:
        raise BodyError(f"{path}: not YAML: {error}") from None
    if not isinstance(content, dict):
        raise BodyError(
            f"{path}: not a body description; if it is a mesh, name it in a YAML file such as "
            "meshes/rack.yaml, or say what it is made of (flexgram import --material, in Python "
            "flexgram.import_mesh)"
        )
    with errors_of(path):
        return import_description(content, path.name, output, folder=path.parent, inputs=(path,))


def import_description(
    content: dict[str, Any],
    where: str,
    output: str | Path,
    *,
    folder: Path = Path(),
    inputs: Sequence[Path] = (),
    mesh: meshio.Mesh | None = None,
) -> dict[str, Any]:
    """Turn a description that is read already into a body file; as ``import_body``.

    Parameters
    ----------
    content : dict
        What the YAML file would hold.
    where : str
        For messages.
    output : str or Path
        Body file to write.
    folder : Path
        Which paths in the description are relative to.
    inputs : sequence of Path
        Files that the output must not replace, beside the mesh.
    mesh : meshio.Mesh, optional
        Instead of the file that the description names.
    """
    reader = Reader(
        content,
        where,
        (
            "name",
            "mesh",
            "units",
            "materials",
            "regions",
            "sections",
            "interfaces",
            "supports",
            "loads",
            "outputs",
            "damping",
            "mass_integration",
        ),
    )
    units = UNITS[reader.choice("units", UNITS, "SI")]
    source = Path(where) if mesh is not None else folder / str(reader.get("mesh"))
    expect_kept(output, *inputs, source, *data_files(source))
    mesh = mesh if mesh is not None else read_mesh(source)
    with errors_of(source):
        cells = cell_regions(mesh)
    with written_whole(output) as file:
        return _write(file, reader, mesh, cells, units, folder)


def _write(
    file: h5py.File,
    reader: Reader,
    mesh: Any,
    cells: dict[str, list[Ints]],
    units: tuple[float, ...],
    folder: Path,
) -> dict[str, Any]:
    length = units[0]
    file.attrs["name"] = str(reader.get("name", reader.where))
    file["mesh/points"] = np.asarray(mesh.points, dtype=np.float64) * length
    file["mesh"].attrs["mass_integration"] = reader.choice(
        "mass_integration", ("full", "reduced"), "full"
    )
    for name, data in reader.children("materials").items():
        _write_material(file, name, data, units)
    for name, data in reader.children("sections").items():
        section = Reader(data, f"sections: {name}")
        group = file.create_group(f"sections/{check_name(section.where, str(name))}")
        group.attrs.update(section_properties(section, length))
        y_axis = section.vector("y_axis", [0, 1, 0])
        if not np.linalg.norm(y_axis) > 0:
            raise BodyError(f"{section.where}: y_axis = [0, 0, 0] has no direction")
        group.attrs["y_axis"] = y_axis

    used = np.zeros(len(mesh.points), dtype=bool)
    blocks = _write_blocks(file, reader, mesh, cells, used)
    elements = sum(len(nodes) for _, nodes in blocks)

    def sets(name: str) -> Ints:
        return node_set(mesh, cells, name)

    interfaces: dict[str, dict[str, Any]] = {}
    follows: dict[int, str] = {}  # node -> rigid interface
    if not reader.children("interfaces"):
        known = ", ".join(sorted({*cells, *mesh.point_sets} - {"all"})) or "none"
        raise BodyError(
            f"{reader.where}: no interface is named, and a body without one has nothing to reduce; "
            f"parts and node sets of the mesh are {known}"
        )
    for order, (name, data) in enumerate(reader.children("interfaces").items()):
        entry = Reader(data, f"interfaces: {name}", ("coupling", "nodes", "position", "weights"))
        nodes = _select_nodes(entry.get("nodes"), entry.where, mesh.points, used, sets)
        group = file.create_group(f"interfaces/{check_name(entry.where, str(name))}")
        group.attrs["coupling"] = entry.choice("coupling", ("rigid", "distributing", "node"))
        middle = middle_of(mesh.points, blocks, nodes)
        position = entry.vector("position", middle.position)
        group.attrs["position"] = length * position
        interfaces[str(name)] = {
            "coupling": str(entry.get("coupling")),
            "nodes": len(nodes),
            "position": (length * position).tolist(),
            "middle": middle.said(length) if "position" not in entry.data else "",
            "distance": middle.away(position),
        }
        group.attrs["order"] = order
        group["nodes"] = nodes
        if group.attrs["coupling"] == "rigid":
            twice = [node for node in nodes.tolist() if node in follows]
            if twice:
                raise BodyError(
                    f"interfaces {follows[twice[0]]} and {name} share node {twice[0] + 1}"
                )
            follows.update(dict.fromkeys(nodes.tolist(), str(name)))
        if "weights" in entry.data:
            with errors_of(f"{entry.where}: weights"):
                group["weights"] = np.asarray(entry.get("weights"), dtype=np.float64)
    for order, (name, data) in enumerate(reader.children("supports").items()):
        entry = Reader(data, f"supports: {name}", ("nodes", "components"))
        group = file.create_group(f"supports/{check_name(entry.where, str(name))}")
        group["nodes"] = _select_nodes(entry.get("nodes"), entry.where, mesh.points, used, sets)
        held = entry.get("components", ["x", "y", "z"])
        if not isinstance(held, list):
            raise BodyError(f"{entry.where}: components = {short(held)} must be a list")
        unknown = [c for c in held if c not in COMPONENTS]
        if unknown:
            raise BodyError(
                f"{entry.where}: component {unknown[0]} must be one of {', '.join(COMPONENTS)}"
            )
        group.attrs["components"] = [float(COMPONENTS[c]) for c in held]
        group.attrs["order"] = order

    def select(choice: Any, where: str) -> Ints:
        return _select_nodes(choice, where, mesh.points, used, sets)

    points = np.asarray(mesh.points, dtype=float)
    written = BodyMesh(file, points, blocks, length, units[2], select, folder)
    loads, outputs = write_loads(written, reader), write_outputs(written, reader)
    damping = Reader(reader.get("damping", {}) or {}, "damping", ("alpha", "beta", "eta"))
    for key in ("alpha", "beta", "eta"):
        file.attrs[key] = damping.number(key, 0.0)
    extent = np.ptp(mesh.points[used], axis=0) * length
    return {
        "points": int(used.sum()),
        "elements": elements,
        "interfaces": interfaces,
        "loads": loads,
        "outputs": outputs,
        "extent": extent,
        "units": reader.get("units", "SI"),
        "kinds": sorted({kind for kind, _ in blocks}),
    }


def _write_blocks(
    file: h5py.File,
    reader: Reader,
    mesh: Any,
    cells: dict[str, list[Ints]],
    used: NDArray[np.bool_],
) -> list[tuple[str, Ints]]:
    """Element blocks by region and cell type; marks the nodes that they use. Returns their types
    and nodes."""
    regions = reader.children("regions")
    if not regions:
        raise BodyError(
            f"{reader.where}: regions is missing: name a part of the mesh and its "
            f"material; the mesh has {', '.join(sorted(cells))}"
        )
    taken = [np.zeros(len(block.data), dtype=bool) for block in mesh.cells]
    first = np.cumsum([0, *(len(block.data) for block in mesh.cells)])
    blocks: list[tuple[str, Ints]] = []
    for name, data in regions.items():
        entry = Reader(data, f"regions: {name}", ("material", "section"))
        material = entry.choice("material", reader.children("materials"))
        if str(name) not in cells:
            raise BodyError(
                f"{entry.where}: the mesh has no such part; it has {', '.join(sorted(cells))}"
            )
        solid = False
        for block, chosen in enumerate(cells[str(name)]):
            kind = mesh.cells[block].type
            if len(chosen) == 0 or kind not in ELEMENTS:
                continue
            if kind == "line" and "section" not in data:
                continue
            if taken[block][chosen].any():
                raise BodyError(f"{entry.where}: some of its elements belong to another region too")
            taken[block][chosen] = solid = True
            nodes = np.asarray(mesh.cells[block].data[chosen], dtype=np.int64)
            used[nodes.ravel()] = True
            group = file.create_group(f"mesh/blocks/{len(blocks):04d}")
            group.attrs["type"], group.attrs["material"] = kind, material
            if kind == "line":
                group.attrs["section"] = entry.choice("section", reader.children("sections"))
            group["connectivity"] = nodes
            group["ids"] = first[block] + chosen + 1  # 1-based, in the order of the mesh file
            blocks.append((kind, nodes))
        if not solid:
            kinds = {mesh.cells[b].type for b, c in enumerate(cells[str(name)]) if len(c)}
            raise BodyError(
                f"{entry.where}: no elements that flexgram knows; it has "
                f"{', '.join(sorted(kinds))}, known are {', '.join(ELEMENTS)} (line "
                "with a section)"
            )
    return blocks
