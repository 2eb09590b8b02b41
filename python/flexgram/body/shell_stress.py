"""Stress and strain of shells on a side, from motions of their nodes.

They are those of the elements' own strains at the points of the stiffness, in global axes: the
stress of the layer at that side, by forces in the plane and moments. Transverse shear is left out;
it vanishes on both sides. At nodes the values of the elements around are averaged, extrapolated to
the corners by the polynomial that is linear in each direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.meshfile import MEMBRANE, SHELLS
from flexgram.body.strain import deforming, extrapolation, rigid_interfaces, stiffness_of

SIDES = ("top", "middle", "bottom")
#: Elements around a node whose normals differ by more [degrees] have no stress in common.
FOLD = 20.0


@dataclass
class Sheet:
    """Elements of one type and section.

    Attributes
    ----------
    kind : str
        Meshio's name.
    nodes : (E, n) int array
    ids : (E,) int array
        The elements' numbers.
    section : str
    shell : _flexgram.Shell
    thickness : (L,) array
        Of its layers, from the bottom to the top [m].
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

    def only(self, chosen: Any) -> Sheet:
        """Some of its elements: an index."""
        axis_1 = self.axis_1[chosen] if len(self.axis_1) else self.axis_1
        return replace(self, nodes=self.nodes[chosen], ids=self.ids[chosen], axis_1=axis_1)

    def rows(self, points: Floats, side: str, strain: bool) -> tuple[Floats, Floats]:
        """Stress or strain (E, q, 6, 6n) for unit motions of the nodes of its elements, components
        as ``stress.COMPONENTS`` (strains with engineering shears), and areas (E, q) [m²]."""
        whole = float(self.thickness.sum())
        z = {"top": 0.5, "middle": 0.0, "bottom": -0.5}[side] * whole
        tops = np.cumsum(self.thickness) - 0.5 * whole
        layer = int(np.searchsorted(tops[:-1], z + 1e-9 * whole))
        area, stretch, axes = self.shell.strains(self.kind, points[self.nodes], self.axis_1)
        local = stretch[:, :, :3] + z * stretch[:, :, 3:]
        if strain:
            local[:, :, 2] /= 2  # of the tensor
        else:
            local = self.shell.plane_stress(layer) @ local
        first, second = axes[:, :, 0], axes[:, :, 1]
        tensors = [
            np.einsum("eqi,eqj->eqij", first, first),
            np.einsum("eqi,eqj->eqij", second, second),
            np.einsum("eqi,eqj->eqij", first, second) + np.einsum("eqi,eqj->eqij", second, first),
        ]
        of = np.stack([t[..., [0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]] for t in tensors], axis=-1)
        if strain:
            of[..., 3:, :] *= 2
        return np.einsum("eqka,eqab->eqkb", of, local), area


def sheets_of(file: h5py.File) -> list[Sheet]:
    """Those of an open body file that deform."""
    import _flexgram

    follows = rigid_interfaces(file)
    sheets = []
    for group in file["mesh/blocks"].values():
        kind, nodes = str(group.attrs["type"]), group["connectivity"][:]
        if kind not in SHELLS or group.attrs.get("formulation") == MEMBRANE:
            continue
        deforms = deforming(nodes, follows)
        section = file["sections"][str(group.attrs["section"])].attrs
        if "bending_factor" in section:
            raise BodyError(
                f"section {group.attrs['section']}: its bending is told apart from its thickness: "
                "stress of such shells is not known"
            )
        names = section.get("layer_materials", [group.attrs["material"]])
        thickness = np.atleast_1d(section.get("layer_thicknesses", section["thickness"]))
        angles = np.atleast_1d(section.get("layer_angles", 0.0))
        laws, isotropic = [], True
        axis_1 = np.asarray(section.get("axis_1", _first_axis(file, str(names[0]))))
        for name in names:
            of = file["materials"][str(name)].attrs
            isotropic = isotropic and "E" in of
            laws.append(stiffness_of(of, own_axes=True))
        offset = float(section["offset"])
        shell = _flexgram.Shell(laws, thickness, angles, offset, axis_1, isotropic)
        ids = group["ids"][:] if "ids" in group else np.arange(len(nodes)) + 1
        own = group["axes"][:, :3] if "axes" in group else np.empty((0, 3))
        whole = Sheet(kind, nodes, ids, str(group.attrs["section"]), shell, thickness, own)
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
                        "meet: name elements"
                    )
                if normal @ other < np.cos(np.radians(FOLD)):
                    raise BodyError(
                        f"at node {node + 1} shells meet at an angle, or with normals to different "
                        "sides: name elements"
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


def nodal_rows(
    points: Floats, sheets: list[Sheet], nodes: Ints, side: str, *, strain: bool = False
) -> tuple[Ints, Floats]:
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

    Returns
    -------
    used : (U,) int array
        Nodes of the elements around.
    values : (U, 6, 6) array
        Each component for unit displacements and rotations of each.

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
    for sheet in sheets:
        part = sheet.only(np.any(weight[sheet.nodes] > 0, axis=1))
        near = part.nodes
        if not len(near):
            continue
        xi = _flexgram.shape_functions(sheet.kind, np.empty((0, 3)))[0]
        outward = extrapolation(sheet.kind, xi)
        rows, _ = part.rows(points, side, strain)
        of = np.einsum("en,nq,eqib->eib", weight[near], outward, rows, optimize=True)
        np.add.at(values, near, of.reshape(len(near), 6, -1, 6).transpose(0, 2, 1, 3))
    used = np.flatnonzero(np.any(values != 0, axis=(1, 2)))
    return used, values[used]


def element_rows(
    points: Floats, sheets: list[Sheet], ids: Ints, side: str, point: int | None = None
) -> tuple[Ints, Floats]:
    """The stress of some elements, their mean by area over the points of the stiffness or at one of
    these (from 1); as ``nodal_rows``.

    Raises
    ------
    BodyError
        If there is no such shell that deforms, or no such point.
    """
    values, area = np.zeros((len(points), 6, 6)), 0.0
    for sheet in only(sheets, ids):
        some = sheet.nodes
        rows, size = sheet.rows(points, side, False)
        if point is not None and not 1 <= point <= size.shape[1]:
            raise BodyError(
                f"elements {sheet.kind} have the integration points 1 to {size.shape[1]}"
            )
        chosen = slice(None) if point is None else slice(point - 1, point)
        part = np.einsum("eq,eqib->eib", size[:, chosen], rows[:, chosen])
        np.add.at(values, some, part.reshape(len(some), 6, -1, 6).transpose(0, 2, 1, 3))
        area += float(size[:, chosen].sum())
    used = np.flatnonzero(np.any(values != 0, axis=(1, 2)))
    return used, values[used] / area
