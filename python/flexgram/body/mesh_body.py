"""Writing a mesh body file: materials, sections, element blocks, interfaces, supports, loads.

``MeshBody`` is given a description that is read already (``body.description``) and its mesh.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from flexgram.basics import BodyError, Ints, check_name, errors_of
from flexgram.body import damping
from flexgram.body.blocks import write_blocks
from flexgram.body.constraints import COMPONENTS, write_constraints
from flexgram.body.discrete import write_masses, write_springs
from flexgram.body.doubts import (
    doubts_of_gravity,
    doubts_of_hinges,
    doubts_of_joints,
    doubts_of_stress,
    expect_possible_interfaces,
    parts_of,
)
from flexgram.body.faces import middle_of
from flexgram.body.loads import BodyMesh, write_loads
from flexgram.body.materials import write_material
from flexgram.body.meshfile import ALONE, PYRAMIDS, SECOND_ORDER, node_set
from flexgram.body.outputs import write_outputs
from flexgram.body.preload import said_of_preload, write_preload
from flexgram.body.reader import Reader, short
from flexgram.body.second_order import Gained, divide
from flexgram.body.sections import ROD, SHELL, is_shell, section_properties, shell_properties
from flexgram.body.selection import in_box, nearest
from flexgram.body.shells import doubts_of_shells, first_axis
from flexgram.body.spin import write_spin
from flexgram.body.universal_mesh import LEFT_OUT
from flexgram.body.whole import (
    Block,
    doubts_of_thickness,
    doubts_of_units,
    expect_no_repeats,
    free_in,
    merged_nodes,
    summary,
)


class MeshBody:
    """A mesh body, written part by part.

    Parameters
    ----------
    file : h5py.File
        Open for writing.
    reader : Reader
        The description.
    mesh : meshio.Mesh
    cells : dict
        For each part of the mesh the chosen cells of each of its blocks.
    units : tuple of float
        Length [m], mass [kg] and force [N] of the mesh's units.
    folder : Path
        Which paths in the description are relative to.
    """

    def __init__(
        self,
        file: h5py.File,
        reader: Reader,
        mesh: Any,
        cells: dict[str, list[Ints]],
        units: tuple[float, ...],
        folder: Path,
    ) -> None:
        self.file, self.reader, self.mesh, self.cells = file, reader, mesh, cells
        self.units, self.folder = units, folder
        self.length = units[0]
        self.points = np.asarray(mesh.points, dtype=float)
        self.used = np.zeros(len(self.points), dtype=bool)  # by an element of the body
        self.merged: Ints | None = None  # the node that each became one with
        self.elements: list[Block] = []
        self.gained: list[Gained] = []  # nodes in the middle of shells
        self.far: list[str] = []  # places that no node is near
        self.middles: list[Gained] = []  # and of pyramids' bases
        self.alone: Ints = np.empty((0, 1), dtype=np.int64)  # nodes that no element has

    def write(self) -> dict[str, Any]:
        """Write all of it; returns the counts of ``import_body``."""
        file, reader = self.file, self.reader
        file.attrs["name"] = str(reader.get("name", reader.where))
        file.attrs["units"] = reader.get("units", "SI")
        self._divide_second_order()
        file["mesh/points"] = self.points * self.length
        file["mesh"].attrs["mass_integration"] = reader.choice(
            "mass_integration", ("full", "reduced", "lumped"), "full"
        )
        for name, data in reader.children("materials").items():
            write_material(file, name, data, self.units)
        self._write_sections()
        self._merge_nodes()
        self.elements, left_out = write_blocks(file, reader, self.mesh, self.cells, self.units)
        if reader.choice("repeated_elements", ("refuse", "keep"), "refuse") == "refuse":
            expect_no_repeats(self.elements)
        for block in self.elements:
            self.used[block.nodes.ravel()] = True
        self._write_nodes_alone()
        interfaces = self._write_interfaces()
        held = self._write_supports()
        expect_possible_interfaces(file, self.points, self.elements, self.alone)
        blocks = [(block.kind, block.nodes) for block in self.elements]
        placed = [*blocks, (ALONE, self.alone)]
        constraints = write_constraints(
            file, reader, self.select_areas, self.points, placed, self.length
        )
        discrete = write_masses(file, reader, self.select, self.units)
        discrete += write_springs(file, reader, self.select, self.units)
        written = BodyMesh(
            *(file, self.points, placed, self.length, self.units[2], self.select_areas),
            *(self.folder, self.merged, [*self.middles, *self.gained]),
        )
        loads, outputs = write_loads(written, reader), write_outputs(written, reader)
        doubts = doubts_of_shells(file, self.points, self.elements)
        parts = parts_of(file, len(self.points), self.elements)
        for name in set(write_preload(file, reader, [*interfaces, *loads])) & set(loads):
            loads[name] += ", of the preload: no input"
        preload = said_of_preload(file)
        if preload and (free := free_in(file)):
            raise BodyError(
                f"{self.reader.where}: a preload needs supports: {free} of 6 rigid motions are free"
            )
        write_spin(file, reader, self.length)
        for key, value in damping.described(reader).items():
            file.attrs[key] = value
        extent = np.ptp(self.points[self.used], axis=0) * self.length
        notes = [f"note: {words}" for words in (self.mesh.info or {}).get(LEFT_OUT, [])]
        return {
            "points": int(self.used.sum()),
            "elements": sum(len(nodes) for _, nodes in blocks),
            "interfaces": interfaces,
            "loads": loads,
            "outputs": outputs,
            "extent": extent,
            "units": reader.get("units", "SI"),
            "kinds": sorted({kind for kind, _ in blocks}),
            "summary": [
                *summary(file, len(parts.nodes)),
                *discrete,
                *constraints,
                *preload,
                *notes,
            ],
            "warnings": [
                *left_out,
                *doubts_of_units(file, reader.get("units", "SI"), extent),
                *doubts_of_thickness(file, extent),
                *doubts_of_joints(file, self.points, parts, np.flatnonzero(self.used), held),
                *doubts_of_hinges(file, reader, self.elements),
                *doubts_of_stress(file, reader),
                *doubts_of_gravity(file, self.length),
                *dict.fromkeys(self.far),
                *doubts,
            ],
        }

    def _divide_second_order(self) -> None:
        """Shells and beams of second order become elements of first order, pyramids tetrahedra."""
        sections = self.reader.children("sections")
        chosen: dict[int, NDArray[np.bool_]] = {}
        for name, data in self.reader.children("regions").items():
            if not isinstance(data, dict) or str(name) not in self.cells:
                continue
            section = sections.get(str(data.get("section")))
            shape = section.get("shape") if isinstance(section, dict) else ""
            lines = ("line3",) if shape and shape != ROD else ()
            kinds = SECOND_ORDER if shape == SHELL else (*PYRAMIDS, *lines)
            for block, cells in enumerate(self.cells[str(name)]):
                if self.mesh.cells[block].type in kinds and len(cells):
                    some = chosen.setdefault(
                        block, np.zeros(len(self.mesh.cells[block].data), dtype=bool)
                    )
                    some[cells] = True
        if chosen:
            self.mesh, self.cells, gained = divide(self.mesh, self.cells, chosen)
            self.gained = [some for some in gained if some.kind in SECOND_ORDER]
            self.middles = following = [some for some in gained if some.kind not in SECOND_ORDER]
            if equations := [row for some in following for row in some.equations()]:
                known = {**self.reader.children("equations"), "pyramids": {"terms": equations}}
                self.reader = Reader({**self.reader.data, "equations": known}, self.reader.where)
            self.points = np.asarray(self.mesh.points, dtype=float)
            self.used = np.zeros(len(self.points), dtype=bool)

    def _merge_nodes(self) -> None:
        """Nodes no farther apart than ``merge`` become one, where the description asks for it."""
        if "merge" not in self.reader.data:
            return
        tolerance = self.reader.number("merge")
        if not tolerance > 0:
            raise BodyError(f"{self.reader.where}: merge = {tolerance:g} must be positive")
        self.mesh = copy.deepcopy(self.mesh)
        used = np.zeros(len(self.points), dtype=bool)
        for block in self.mesh.cells:
            used[block.data.ravel()] = True
        place = self.merged = merged_nodes(self.points, used, tolerance)
        for block in self.mesh.cells:
            block.data = place[block.data]
            again = (np.diff(np.sort(block.data, axis=1), axis=1) == 0).any(axis=1)
            if again.any():
                raise BodyError(
                    f"{self.reader.where}: merge = {tolerance:g} is larger than a {block.type} "
                    f"(number {int(np.argmax(again)) + 1} of its kind): its own nodes would merge"
                )
        self.mesh.point_sets = {
            name: np.unique(place[np.asarray(nodes, dtype=np.int64)])
            for name, nodes in self.mesh.point_sets.items()
        }

    def select(self, choice: Any, where: str) -> Ints:
        """Nodes by set name, by list of 1-based numbers, or, in the mesh's own units, by a box or
        as the one nearest to a place."""
        in_set = False
        if isinstance(choice, dict) and "at" in choice:
            at = Reader(choice, where, ("at",)).vector("at")
            nodes = np.flatnonzero(self.used)
            nodes = nodes[[nearest(self.points[nodes], at, where, self.far.append)]]
        elif isinstance(choice, dict):
            with errors_of(f"{where}: box"):
                box = np.array(Reader(choice, where, ("box",)).get("box"), dtype=float)
            if box.shape != (2, 3) or not np.all(np.isfinite(box)):
                raise BodyError(
                    f"{where}: box must be [[x, y, z] of one corner, [x, y, z] of the other]"
                )
            nodes = np.flatnonzero(self.used)
            nodes = nodes[in_box(self.points[nodes], box, where)]
        elif isinstance(choice, list):
            if not all(type(number) is int for number in choice):
                raise BodyError(f"{where}: {short(choice)} must be node numbers")
            with errors_of(where):
                nodes = np.array(choice, dtype=np.int64) - 1
            if nodes.size and (nodes.min() < 0 or nodes.max() >= len(self.points)):
                raise BodyError(f"{where}: node numbers run from 1 to {len(self.points)}")
            if len(np.unique(nodes)) < len(nodes):
                raise BodyError(f"{where}: a node is named twice")
            if self.merged is not None:
                nodes = np.unique(self.merged[nodes])
            if not self.used[nodes].all():
                alone = nodes[~self.used[nodes]][0] + 1
                raise BodyError(f"{where}: node {alone} belongs to no element of the body")
        else:
            try:
                nodes = node_set(self.mesh, self.cells, str(choice))
            except BodyError as error:
                raise BodyError(f"{where}: {error}") from None
            in_set = len(nodes) > 0
            nodes = nodes[self.used[nodes]]
        if len(nodes) == 0:
            raise BodyError(
                f"{where}: no nodes of the body are selected"
                + (
                    ": no element has those of the set; are its parts in a region?"
                    if in_set
                    else ""
                )
            )
        return np.asarray(nodes, dtype=np.int64)

    def select_areas(self, choice: Any, where: str) -> Ints:
        """As ``select``; behind them the new nodes in the middle of shells whose nodes are all
        among them."""
        nodes = self.select(choice, where)
        if not self.gained or len(nodes) < 8:
            return nodes
        middles = [some.nodes[np.isin(some.around, nodes).all(axis=1)] for some in self.gained]
        new = np.setdiff1d(np.concatenate([nodes[:0], *middles]), nodes)
        return np.concatenate([nodes, new[self.used[new]]])

    def _write_sections(self) -> None:
        for name, data in self.reader.children("sections").items():
            section = Reader(data, f"sections: {name}")
            group = self.file.create_group(f"sections/{check_name(section.where, str(name))}")
            if is_shell(section):
                known = self.reader.children("materials")
                found = shell_properties(section, self.length, known)
                if "axis_1" not in found and "layer_materials" in found:
                    with errors_of(section.where):
                        axis = first_axis(self.file, found["layer_materials"])
                    found |= {} if axis is None else {"axis_1": axis}
                group.attrs.update(found)
                continue
            group.attrs.update(section_properties(section, self.length))
            if "I_y" not in group.attrs:  # a rod
                continue
            y_axis = section.vector("y_axis", [0, 1, 0])
            if not np.linalg.norm(y_axis) > 0:
                raise BodyError(f"{section.where}: y_axis = [0, 0, 0] has no direction")
            group.attrs["y_axis"] = y_axis
            for key in ("torsional_inertia", "rotary_inertia"):
                share = section.number(key, 1.0)
                if not 0 <= share <= 1:
                    raise BodyError(
                        f"{section.where}: {key} = {share:g} must be from 0 to 1, a share of that "
                        "of all mass"
                    )
                group.attrs[key] = share

    def _write_interfaces(self) -> dict[str, dict[str, Any]]:
        """Write them; returns what is told of each."""
        blocks = [(block.kind, block.nodes) for block in self.elements]
        interfaces: dict[str, dict[str, Any]] = {}
        follows: dict[int, str] = {}  # node -> rigid interface
        if not self.reader.children("interfaces"):
            known = ", ".join(sorted({*self.cells, *self.mesh.point_sets} - {"all"})) or "none"
            raise BodyError(
                f"{self.reader.where}: no interface is named, and a body without one has nothing "
                f"to reduce: --rigid NAME=NSET:SET, or interfaces: in YAML; parts and node sets of "
                f"the mesh are {known}"
            )
        for order, (name, data) in enumerate(self.reader.children("interfaces").items()):
            entry = Reader(
                data, f"interfaces: {name}", ("coupling", "nodes", "position", "weights")
            )
            nodes = self.select_areas(entry.get("nodes"), entry.where)
            group = self.file.create_group(f"interfaces/{check_name(entry.where, str(name))}")
            group.attrs["coupling"] = entry.choice("coupling", ("rigid", "distributing", "node"))
            middle = middle_of(self.points, blocks, nodes)
            position = entry.vector("position", middle.position)
            group.attrs["position"] = self.length * position
            interfaces[str(name)] = {
                "coupling": str(entry.get("coupling")),
                "nodes": len(nodes),
                "position": (self.length * position).tolist(),
                "middle": middle.said(self.length) if "position" not in entry.data else "",
                "distance": middle.away(position),
            }
            group.attrs["order"] = order
            group["nodes"] = nodes
            if group.attrs["coupling"] == "rigid":
                twice = [node for node in nodes.tolist() if node in follows]
                if twice:
                    other = follows[twice[0]]
                    same = len(twice) == len(nodes)
                    raise BodyError(
                        f"interfaces {other} and {name} "
                        + (
                            f"are on the same nodes, {short(entry.get('nodes'))}"
                            if same
                            else f"share node {twice[0] + 1} ({len(twice)} such nodes)"
                        )
                        + ": a node can follow one rigid interface"
                    )
                follows.update(dict.fromkeys(nodes.tolist(), str(name)))
            if "weights" in entry.data:
                with errors_of(f"{entry.where}: weights"):
                    group["weights"] = np.asarray(entry.get("weights"), dtype=np.float64)
        return interfaces

    def _write_supports(self) -> list[Ints]:
        """Write them; returns the nodes of each."""
        supports: list[Ints] = []
        for order, (name, data) in enumerate(self.reader.children("supports").items()):
            entry = Reader(data, f"supports: {name}", ("nodes", "components"))
            group = self.file.create_group(f"supports/{check_name(entry.where, str(name))}")
            group["nodes"] = self.select_areas(entry.get("nodes"), entry.where)
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
            supports.append(group["nodes"][:])
        return supports

    def _write_nodes_alone(self) -> None:
        """Nodes with six dofs that no element has: equations, springs and masses hold them."""
        if not (given := self.reader.data.get("nodes_alone")):
            return
        where = f"{self.reader.where}: nodes_alone"
        if not (isinstance(given, list) and all(type(number) is int for number in given)):
            raise BodyError(f"{where}: {short(given)} must be a list of node numbers")
        nodes = np.unique(np.array(given, dtype=np.int64)) - 1
        if nodes[0] < 0 or nodes[-1] >= len(self.points):
            raise BodyError(f"{where}: node numbers run from 1 to {len(self.points)}")
        if self.used[nodes].any():
            raise BodyError(f"{where}: node {nodes[self.used[nodes]][0] + 1} has elements")
        self.file["mesh/alone/connectivity"] = self.alone = nodes[:, None]
        self.used[nodes] = True
