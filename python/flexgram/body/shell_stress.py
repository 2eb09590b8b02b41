"""Stress and strain of shells on a side, from motions of their nodes and from heat; forces of heat.

They are those of the elements' own strains at the points of the stiffness, in global axes: the
stress of the layer at that side, by forces in the plane and moments. Transverse shear is left out;
it vanishes on both sides. At nodes the values of the elements around are averaged, extrapolated to
the corners by the polynomial that is linear in each direction. Membranes have the same stress on
all sides. Heat strains a layer by α (T + z g), T the temperature of the middle surface and g the
gradient along the normal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.meshfile import SHELLS
from flexgram.body.strain import (
    Heat,
    deforming,
    expansion_of,
    extrapolation,
    rigid_interfaces,
    stiffness_of,
)

SIDES = ("top", "middle", "bottom")
#: Elements around a node whose normals differ by more [degrees] have no stress in common.
FOLD = 20.0


class _Layer(NamedTuple):
    """What the stress on a side is made of: A (ε − α T) + B (κ − α' g)."""

    stretching: Floats  #: A, (3, 3)
    bending: Floats  #: B, (3, 3), times the height
    layers: tuple[int, int]  #: whose expansions α and α' are


@dataclass
class Sheet:
    """Elements of one type and section.

    Attributes
    ----------
    kind : str
        Meshio's name, and behind a stroke the formulation where it is another.
    nodes : (E, n) int array
    ids : (E,) int array
        The elements' numbers.
    section : str
    shell : _flexgram.Shell
    thickness : (L,) array
        Of its layers, from the bottom to the top [m].
    sides : (float, float) or None
        Where bending is told apart: heights of the bottom and the top [m], None if not known.
    is_apart : bool
        Whether it is.
    axis_1 : (E, 3) array
        The first axis of the material in each element, or (0, 3): that of the shell.
    """

    kind: str
    nodes: Ints
    ids: Ints
    section: str
    shell: Any
    thickness: Floats
    axis_1: Floats
    sides: tuple[float, float] | None = None
    is_apart: bool = False

    def only(self, chosen: Any) -> Sheet:
        """Some of its elements: an index."""
        axis_1 = self.axis_1[chosen] if len(self.axis_1) else self.axis_1
        return replace(self, nodes=self.nodes[chosen], ids=self.ids[chosen], axis_1=axis_1)

    def rows(self, points: Floats, side: str, strain: bool) -> tuple[Floats, Floats]:
        """Stress or strain (E, q, 6, dofs n) for unit motions of the nodes of its elements,
        components as ``stress.COMPONENTS`` (strains with engineering shears), and areas (E, q)
        [m²]."""
        area, stretch, axes = self.shell.strains(self.kind, points[self.nodes], self.axis_1)
        if strain:
            local = stretch[:, :, :3] + self._height(side) * stretch[:, :, 3:]
            local[:, :, 2] /= 2  # of the tensor
            of = _tensors(axes)
            of[..., 3:, :] *= 2
        else:
            layer = self._layer(side)
            local = layer.stretching @ stretch[:, :, :3] + layer.bending @ stretch[:, :, 3:]
            of = _tensors(axes)
        return np.einsum("eqka,eqab->eqkb", of, local), area

    @property
    def dofs(self) -> int:
        """Of a node."""
        return 3 if self.is_membrane else 6

    @property
    def is_membrane(self) -> bool:
        return "/" in self.kind

    def _height(self, side: str) -> float:
        """Of a side above the middle surface [m]."""
        if self.is_membrane or side == "middle":
            return 0.0
        if not self.is_apart:
            return {"top": 0.5, "bottom": -0.5}[side] * float(self.thickness.sum())
        if self.sides is None:
            raise BodyError(
                f"section {self.section}: its bending is told apart from its thickness: give it "
                "`sides: [bottom, top]`, the heights where stress is asked for"
            )
        return self.sides[side == "top"]

    def _layer(self, side: str) -> _Layer:
        z = self._height(side)
        if self.is_apart:
            of_both = self.shell.plane_stress(0), z * self.shell.plane_stress(1)
            return _Layer(*of_both, (0, 1))
        whole = float(self.thickness.sum())
        tops = np.cumsum(self.thickness) - 0.5 * whole
        at = int(np.searchsorted(tops[:-1], z + 1e-9 * whole))
        law = self.shell.plane_stress(at)
        return _Layer(law, z * law, (at, at))

    def _heat_at_points(self, heat: Heat) -> Floats:
        """Temperature and gradient (E, q, 2) at the points of the stiffness."""
        import _flexgram

        N = _flexgram.shape_functions(self.kind, np.empty((0, 3)))[2]
        found: Floats = np.stack([of[self.nodes] @ N.T for of in heat], axis=-1)
        return found

    def held(self, points: Floats, heat: Heat) -> tuple[Floats, Floats]:
        """Its elements, held at all their nodes, in a field of temperature.

        Returns
        -------
        forces : (E, n, dofs) array
            That the heat is on the nodes [N], [N m].
        strains : (E, q, 6) array
            And curvatures, of internal dofs that give way.

        Raises
        ------
        BodyError
            If the expansion of a material is not known.
        """
        resultants = self._heat_at_points(heat) @ self.shell.heat_resultants().T
        forces, strains = self.shell.hold(
            self.kind, points[self.nodes], self.axis_1, np.ascontiguousarray(resultants)
        )
        return forces.reshape(*self.nodes.shape, self.dofs), strains

    def held_stress(self, points: Floats, heat: Heat, side: str) -> Floats:
        """Of ``held``, the stress (E, q, 6) on a side [N/m²].

        Raises
        ------
        BodyError
            As ``held``.
        """
        strains = self.held(points, heat)[1]
        axes = self.shell.strains(self.kind, points[self.nodes], self.axis_1)[2]
        layer, warm = self._layer(side), self._heat_at_points(heat)
        of_mean, of_slope = (self.shell.heat_strain(k)[:, 0] for k in layer.layers)
        local = (strains[..., :3] - warm[..., :1] * of_mean) @ layer.stretching.T
        local += (strains[..., 3:] - warm[..., 1:] * of_slope) @ layer.bending.T
        found: Floats = np.einsum("eqka,eqa->eqk", _tensors(axes), local)
        return found


def _tensors(axes: Floats) -> Floats:
    """Components (E, q, 6, 3) in global axes of xx, yy, xy in axes (E, q, 2, 3)."""
    first, second = axes[:, :, 0], axes[:, :, 1]
    both = np.einsum("eqi,eqj->eqij", first, second)
    tensors = [
        np.einsum("eqi,eqj->eqij", first, first),
        np.einsum("eqi,eqj->eqij", second, second),
        both + both.swapaxes(2, 3),
    ]
    found: Floats = np.stack(
        [t[..., [0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]] for t in tensors], axis=-1
    )
    return found


def sheets_of(file: h5py.File) -> list[Sheet]:
    """Those of an open body file that deform."""
    import _flexgram

    follows = rigid_interfaces(file)
    sheets = []
    for group in file["mesh/blocks"].values():
        kind, nodes = str(group.attrs["type"]), group["connectivity"][:]
        if kind not in SHELLS:
            continue
        if "formulation" in group.attrs:
            kind += f"/{group.attrs['formulation']}"
        deforms = deforming(nodes, follows)
        if not deforms.any():
            continue
        section = file["sections"][str(group.attrs["section"])].attrs
        own_material = str(group.attrs.get("material", ""))
        is_apart = "bending_factor" in section
        names = [str(name) for name in section.get("layer_materials", [own_material])]
        thickness = np.atleast_1d(section.get("layer_thicknesses", section["thickness"]))
        angles = np.atleast_1d(section.get("layer_angles", 0.0))
        roles, factors = ["all"] * len(names), [1.0] * len(names)
        if is_apart:
            parts = ("bending", "shear")
            names += [str(section.get(f"{part}_material", own_material)) for part in parts]
            roles = ["stretching", *parts]
            factors += [float(section[f"{part}_factor"]) for part in parts]
            thickness, angles = np.repeat(thickness, 3), np.zeros(3)
        axis_1 = np.asarray(section.get("axis_1", _first_axis(file, names[0])))
        materials = [file["materials"][name].attrs for name in names]
        isotropic = all("E" in of for of in materials)
        shell = _flexgram.Shell(float(section["offset"]), axis_1, isotropic)
        for of, *layer in zip(materials, thickness, angles, roles, factors, strict=True):
            expansion = expansion_of(of, np.eye(3))
            shell.add(stiffness_of(of, own_axes=True), *layer, expansion)
        shell.finish()
        ids = group["ids"][:] if "ids" in group else np.arange(len(nodes)) + 1
        own = group["axes"][:, :3] if "axes" in group else np.empty((0, 3))
        sides = tuple(section["sides"]) if "sides" in section else None
        if sides is None and is_apart and factors[1] == 1:
            sides = (-0.5 * float(thickness[0]), 0.5 * float(thickness[0]))
        name = str(group.attrs["section"])
        whole = Sheet(kind, nodes, ids, name, shell, thickness, own, sides, is_apart)
        sheets.append(whole.only(deforms))
    return sheets


def _first_axis(file: h5py.File, material: str) -> Floats:
    axes: Floats = np.asarray(file["materials"][material].attrs.get("axes", np.eye(3).ravel()))[:3]
    return axes


def normals_of(points: Floats, nodes: Ints) -> Floats:
    """Of unit length, of elements (E, n)."""
    x = points[nodes]
    across = np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])
    unit: Floats = across / np.linalg.norm(across, axis=1)[:, None]
    return unit


def _around(points: Floats, sheets: list[Sheet], node: int) -> str:
    """The elements at a node, together those of one section and direction."""
    together: list[tuple[str, Floats, list[int]]] = []
    for sheet in sheets:
        near = (sheet.nodes == node).any(axis=1)
        normals = normals_of(points, sheet.nodes[near])
        for number, normal in zip(sheet.ids[near].tolist(), normals, strict=True):
            for section, first, numbers in together:
                if section == sheet.section and normal @ first >= np.cos(np.radians(FOLD)):
                    numbers.append(number)
                    break
            else:
                together.append((sheet.section, normal, [number]))
    return " or ".join(
        f"{numbers}" + (f" of {section}" if section else "") for section, _, numbers in together
    )


def _expect_smooth(points: Floats, sheets: list[Sheet], nodes: Ints) -> None:
    """Elements around each node are of one section and do not meet at an angle."""
    first: dict[int, tuple[str, Floats]] = {}
    chosen = np.zeros(len(points), dtype=bool)
    chosen[nodes] = True
    for sheet in sheets:
        near = sheet.nodes[np.any(chosen[sheet.nodes], axis=1)]
        for element, normal in zip(near, normals_of(points, near), strict=True):
            for node in element[chosen[element]].tolist():
                section, other = first.setdefault(node, (sheet.section, normal))
                if section != sheet.section:
                    raise BodyError(
                        f"at node {node + 1} shells of sections {section} and {sheet.section} "
                        f"meet: name elements, {_around(points, sheets, node)}"
                    )
                if normal @ other < np.cos(np.radians(FOLD)):
                    raise BodyError(
                        f"at node {node + 1} shells meet at an angle, or with normals to different "
                        f"sides: name elements, {_around(points, sheets, node)}"
                    )
    missing = np.setdiff1d(nodes, list(first))
    if len(missing):
        raise BodyError(f"node {missing[0] + 1} belongs to no shell that deforms")


def only(sheets: list[Sheet], ids: Ints) -> list[Sheet]:
    """The elements with these numbers.

    Raises
    ------
    BodyError
        If there is no such shell that deforms.
    """
    missing = np.setdiff1d(ids, np.concatenate([sheet.ids for sheet in sheets]))
    if len(missing):
        raise BodyError(f"there is no shell {missing[0]} that deforms")
    chosen = [(sheet, np.isin(sheet.ids, ids)) for sheet in sheets]
    return [sheet.only(some) for sheet, some in chosen if some.any()]


def forces_of_heat(points: Floats, sheets: list[Sheet], heat: Heat) -> Floats:
    """Forces and moments (N, 6) [N], [N m] of a field of temperature on nodes that are held.

    Raises
    ------
    BodyError
        If the expansion of a material is not known.
    """
    forces = np.zeros((len(points), 6))
    warm = (heat.temperature != 0) | (heat.gradient != 0)
    for sheet in sheets:
        part = sheet.only(warm[sheet.nodes].any(axis=1))
        if len(part.nodes):
            np.add.at(forces[:, : sheet.dofs], part.nodes, part.held(points, heat)[0])
    return forces


def nodal_rows(
    points: Floats,
    sheets: list[Sheet],
    nodes: Ints,
    side: str,
    *,
    strain: bool = False,
    heats: Mapping[str, Heat] | None = None,
) -> tuple[Ints, Floats, dict[str, Floats]]:
    """The mean stress, or strain, of some nodes as a function of motions.

    Parameters
    ----------
    points : (N, 3) array
        [m]
    sheets : list of Sheet
        As ``sheets_of``.
    nodes : int array
    side : str
        One of ``SIDES``, seen along the normals.
    strain : bool
        Strains with engineering shears instead.
    heats : mapping, optional
        Fields of temperature by their inputs.

    Returns
    -------
    used : (U,) int array
        Nodes of the elements around.
    values : (U, 6, 6) array
        Each component for unit displacements and rotations of each.
    held : dict
        The stress (6,) that each field of temperature adds at once.

    Raises
    ------
    BodyError
        Where no shell is, or shells that have no stress in common.
    """
    import _flexgram

    nodes = np.unique(nodes)
    _expect_smooth(points, sheets, nodes)
    count = np.zeros(len(points))
    for sheet in sheets:
        np.add.at(count, sheet.nodes, 1.0)
    weight = np.zeros(len(points))
    weight[nodes] = 1 / count[nodes] / len(nodes)
    values = np.zeros((len(points), 6, 6))
    held = {name: np.zeros(6) for name in heats or {}}
    for sheet in sheets:
        part = sheet.only(np.any(weight[sheet.nodes] > 0, axis=1))
        near = part.nodes
        if not len(near):
            continue
        xi = _flexgram.shape_functions(sheet.kind, np.empty((0, 3)))[0]
        outward = extrapolation(sheet.kind, xi)
        rows, _ = part.rows(points, side, strain)
        of = np.einsum("en,nq,eqib->eib", weight[near], outward, rows, optimize=True)
        of_nodes = of.reshape(len(near), 6, -1, sheet.dofs).transpose(0, 2, 1, 3)
        np.add.at(values[..., : sheet.dofs], near, of_nodes)
        for name, heat in (heats or {}).items():
            warm = part.held_stress(points, heat, side)
            held[name] += np.einsum("en,nq,eqi->i", weight[near], outward, warm, optimize=True)
    used = np.flatnonzero(np.any(values != 0, axis=(1, 2)))
    return used, values[used], held


def element_rows(
    points: Floats,
    sheets: list[Sheet],
    ids: Ints,
    side: str,
    point: int | None = None,
    heats: Mapping[str, Heat] | None = None,
) -> tuple[Ints, Floats, dict[str, Floats]]:
    """The stress of some elements, their mean by area over the points of the stiffness or at one of
    these (from 1); as ``nodal_rows``.

    Raises
    ------
    BodyError
        If there is no such shell that deforms, or no such point.
    """
    values, area = np.zeros((len(points), 6, 6)), 0.0
    held = {name: np.zeros(6) for name in heats or {}}
    for sheet in only(sheets, ids):
        some = sheet.nodes
        rows, size = sheet.rows(points, side, False)
        if point is not None and not 1 <= point <= size.shape[1]:
            raise BodyError(
                f"elements {sheet.kind} have the integration points 1 to {size.shape[1]}"
            )
        chosen = slice(None) if point is None else slice(point - 1, point)
        part = np.einsum("eq,eqib->eib", size[:, chosen], rows[:, chosen])
        of_nodes = part.reshape(len(some), 6, -1, sheet.dofs).transpose(0, 2, 1, 3)
        np.add.at(values[..., : sheet.dofs], some, of_nodes)
        area += float(size[:, chosen].sum())
        for name, heat in (heats or {}).items():
            warm = sheet.held_stress(points, heat, side)[:, chosen]
            held[name] += np.einsum("eq,eqi->i", size[:, chosen], warm)
    used = np.flatnonzero(np.any(values != 0, axis=(1, 2)))
    return used, values[used] / area, {name: s / area for name, s in held.items()}
