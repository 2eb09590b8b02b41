"""Stress of mesh bodies from displacements: by the elements' own strain, averaged at nodes.

The stress is that of the points at which the stiffness is integrated, extrapolated to the corners
of the element by the polynomial that is linear in each direction (by least squares where there are
more points; nodes between corners have the mean of these), in hexahedra of 20 nodes to all of them
by the element's own functions, as CalculiX does, and averaged over the elements around a node.
Elements inside a rigid interface carry none and are left out. Order of components: xx, yy,
zz, xy, yz, zx. Heat strains by α T: its load are the forces that hold this strain back, and the
stress is that of the strain without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Bools, Floats, Ints, errors_of
from flexgram.body.meshfile import SOLIDS
from flexgram.body.strain import (
    Heat,
    deforming,
    expansion_of,
    extrapolation,
    heat_operator,
    rigid_interfaces,
    stiffness_of,
    stress_operator,
    turned,
    whole_axes,
)

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "zx")
#: Elements whose operators are in memory at a time.
CHUNK = 1024


class Solid(NamedTuple):
    """Elements of one type and material."""

    kind: str  #: meshio's name, and behind a stroke the formulation where it is another
    nodes: Ints  #: (E, n)
    law: Floats  #: (6, 6) [N/m²], or of each element, or at each of its points
    #: Strain of one kelvin (6,), engineering shears, or as many as laws; None: not known.
    expansion: Floats | None
    ids: Ints  #: (E,) the elements' numbers

    def only(self, chosen: Any) -> Solid:
        """Some of its elements: an index."""
        law, expansion = self.law, self.expansion
        if law.ndim > 2:
            law = law[chosen]
            expansion = None if expansion is None else expansion[chosen]
        return Solid(self.kind, self.nodes[chosen], law, expansion, self.ids[chosen])

    def chunks(self) -> Iterator[Solid]:
        """Its elements, not too many at once."""
        for first in range(0, len(self.nodes), CHUNK):
            yield self.only(slice(first, first + CHUNK))

    def free_strain(self, temperature: Floats) -> Floats:
        """Strain without stress (E, q, 6) at the points of the stiffness, of temperatures (N,).

        Raises
        ------
        BodyError
            If the expansion is not known.
        """
        import _flexgram

        if self.expansion is None:
            raise BodyError("temperature: a material that it warms has no expansion [1/K]")
        N = _flexgram.shape_functions(self.kind, np.empty((0, 3)))[2]
        warm = (temperature[self.nodes] @ N.T)[..., None]
        strain: Floats = warm * (self.expansion[:, None] if self.law.ndim == 3 else self.expansion)
        return strain


@dataclass
class Stresses:
    """What the stress of a mesh body is made of.

    Attributes
    ----------
    points : (N, 3) array
        [m]
    blocks : list of Solid
        Those that deform.
    """

    points: Floats
    blocks: list[Solid]

    @classmethod
    def load(cls, path: str | Path) -> Stresses:
        """Of a body file.

        Raises
        ------
        BodyError
            If the body has no mesh of solids.
        """
        with errors_of(path), h5py.File(path) as file:
            return cls.of(file)

    @classmethod
    def of(cls, file: h5py.File) -> Stresses:
        """Of an open body file."""
        if "mesh" not in file:
            raise BodyError("only bodies that flexgram assembles from a mesh have stresses")
        follows = rigid_interfaces(file)
        blocks = []
        for group in file["mesh/blocks"].values():
            kind, nodes = str(group.attrs["type"]), group["connectivity"][:]
            if kind not in SOLIDS:
                continue
            if "formulation" in group.attrs:
                kind += f"/{group.attrs['formulation']}"
            steel = file["materials"][str(group.attrs["material"])].attrs
            deforms = deforming(nodes, follows)
            if not deforms.any():
                continue
            ids = group["ids"][:] if "ids" in group else np.arange(len(nodes)) + 1
            if "axes" in group and "E" not in steel:
                of_elements = group["axes"][:]
                law = turned(stiffness_of(steel, own_axes=True).reshape(6, 6), of_elements)
                expansion = expansion_of(steel, whole_axes(of_elements))
            else:
                law = stiffness_of(steel).reshape(6, 6)
                expansion = expansion_of(steel, np.reshape(steel.get("axes", np.eye(3)), (3, 3)))
            blocks.append(Solid(kind, nodes, law, expansion, ids).only(deforms))
        if not blocks:
            raise BodyError("the body has no solids that deform: no stresses")
        return cls(file["mesh/points"][:], blocks)

    def _counts(self) -> Floats:
        """Elements around each node."""
        count = np.zeros(len(self.points))
        for solid in self.blocks:
            np.add.at(count, solid.nodes, 1.0)
        return count

    def nodal(self, displacements: ArrayLike) -> Floats:
        """Stress at the nodes.

        Parameters
        ----------
        displacements : (k, N, 3) array
            [m]

        Returns
        -------
        (k, N, 6) array
            [N/m²]; NaN at nodes of no deforming solid.
        """
        import _flexgram

        u = np.asarray(displacements, dtype=float)
        stress = np.zeros((len(self.points), 6 * len(u)))
        for solid in self.blocks:
            kind = solid.kind
            outward = extrapolation(kind, _flexgram.shape_functions(kind, np.empty((0, 3)))[0])
            for part in solid.chunks():
                some = part.nodes
                operator = stress_operator(kind, self.points[some], part.law)[0]
                elements, size = some.shape
                at_nodes = np.tensordot(operator, outward, axes=(1, 1))  # (E, 6, 3n, n)
                rows = at_nodes.transpose(0, 3, 1, 2).reshape(elements, 6 * size, 3 * size)
                moved = u[:, some].transpose(1, 2, 3, 0).reshape(elements, 3 * size, len(u))
                here = (rows @ moved).reshape(elements * size, -1)
                used, at = np.unique(some, return_inverse=True)
                gather = sp.csr_matrix((np.ones(some.size), (at.ravel(), np.arange(some.size))))
                stress[used] += gather @ here
        return self._averaged(stress.reshape(len(self.points), 6, len(u)).transpose(2, 0, 1))

    def _averaged(self, sums: Floats) -> Floats:
        """Sums over elements (…, N, 6) as means at nodes."""
        count = self._counts()
        result = sums.copy()
        result[..., count > 0, :] /= count[count > 0, None]
        result[..., count == 0, :] = np.nan
        return result

    def heated(self, temperature: Floats) -> tuple[Floats, Floats]:
        """A body that is held at all its nodes, in a field of temperature.

        Parameters
        ----------
        temperature : (N,) array
            Above that of the body without stress [K]; between nodes by the elements' functions.

        Returns
        -------
        forces : (N, 3) array
            That its load is [N].
        stress : (N, 6) array
            At the nodes [N/m²], beside that of displacements; NaN as of ``nodal``.

        Raises
        ------
        BodyError
            If the expansion of a material is not known.
        """
        import _flexgram

        forces, stress = np.zeros_like(self.points), np.zeros((len(self.points), 6))
        for solid in self.blocks:
            kind = solid.kind
            outward = extrapolation(kind, _flexgram.shape_functions(kind, np.empty((0, 3)))[0])
            for part in solid.only(np.any(temperature[solid.nodes] != 0, axis=1)).chunks():
                strain = part.free_strain(temperature)
                force, held = heat_operator(kind, self.points[part.nodes], part.law, strain)
                np.add.at(forces, part.nodes, force)
                np.add.at(stress, part.nodes, np.einsum("nq,eqi->eni", outward, held))
        return forces, self._averaged(stress)

    def shortened(self, nodes: Bools, axis: Floats) -> tuple[Floats, float, float, list[Ints]]:
        """A body that is held at all its nodes while some of its elements shorten by their length.

        Parameters
        ----------
        nodes : (N,) bool array
            Elements that have no others shorten.
        axis : (3,) array
            Along which, of unit length.

        Returns
        -------
        forces : (N, 3) array
            That the load is [N].
        held : float
            Their stress along the axis, over their volume [N m].
        volume : float
            Theirs [m³].
        shank : list of (E, n) int arrays
            Their nodes.
        """
        forces = np.zeros_like(self.points)
        work, size, shank = 0.0, 0.0, []
        n = np.outer(axis, axis)
        along = np.array([n[0, 0], n[1, 1], n[2, 2], n[0, 1], n[1, 2], n[2, 0]])
        engineering = along * [1, 1, 1, 2, 2, 2]
        for solid in self.blocks:
            inside = solid.only(nodes[solid.nodes].all(axis=1))
            for part in inside.chunks():
                of = (part.kind, self.points[part.nodes], part.law)
                volume = stress_operator(*of)[2]
                strain = np.broadcast_to(-engineering, (*volume.shape, 6))
                force, stress = heat_operator(*of, strain)
                np.add.at(forces, part.nodes, force)
                work += float(np.einsum("eq,eqi,i->", volume, stress, engineering))
                size += float(volume.sum())
            shank.append(inside.nodes)
        return forces, work, size, shank

    def of_temperatures(self, body: str | Path, inputs: list[str]) -> dict[str, Floats]:
        """Those of the inputs that are temperatures, with the stress that ``heated`` gives."""
        with errors_of(body), h5py.File(body) as file:
            fields = temperatures(file)
        return {name: self.heated(fields[name].temperature)[1] for name in inputs if name in fields}

    def rows(self, nodes: Ints, *, strain: bool = False) -> tuple[Ints, Floats]:
        """The mean stress of some nodes as a function of displacements, or their mean strain with
        engineering shears.

        Returns
        -------
        used : (U,) int array
            Nodes of the elements around.
        values : (U, 6, 3) array
            Each component for unit displacements of each.

        Raises
        ------
        BodyError
            If one of the nodes belongs to no deforming solid.
        """
        import _flexgram

        nodes = np.unique(nodes)
        count = self._counts()
        if np.any(count[nodes] == 0):
            raise BodyError(
                f"node {nodes[count[nodes] == 0][0] + 1} belongs to no solid that "
                "deforms: it has no stress"
            )
        weight = np.zeros(len(self.points))
        weight[nodes] = 1 / count[nodes] / len(nodes)
        values = np.zeros((len(self.points), 6, 3))
        for solid in self.blocks:
            kind = solid.kind
            outward = extrapolation(kind, _flexgram.shape_functions(kind, np.empty((0, 3)))[0])
            for near in solid.only(np.any(weight[solid.nodes] > 0, axis=1)).chunks():
                some = near.nodes
                operator = stress_operator(kind, self.points[some], near.law)[int(strain)]
                part = np.einsum("en,nq,eqib->eib", weight[some], outward, operator, optimize=True)
                np.add.at(values, some, part.reshape(len(some), 6, -1, 3).transpose(0, 2, 1, 3))
        used = np.flatnonzero(np.any(values != 0, axis=(1, 2)))
        return used, values[used]

    def element_rows(
        self, ids: Ints, point: int | None = None, fields: Mapping[str, Heat] | None = None
    ) -> tuple[Ints, Floats, dict[str, Floats]]:
        """The stress at an integration point of each of some elements, their mean by volume, as a
        function of displacements.

        Parameters
        ----------
        ids : int array
            The elements' numbers.
        point : int, optional
            Of the stiffness, from 1; default: all of them.
        fields : mapping, optional
            Fields of temperature by their inputs.

        Returns
        -------
        used : (U,) int array
            Nodes of the elements.
        values : (U, 6, 3) array
            Each component for unit displacements of each.
        held : dict
            The stress (6,) that each field adds at once.

        Raises
        ------
        BodyError
            If there is no such element that deforms, or no such point.
        """
        import _flexgram

        values, volume = np.zeros((len(self.points), 6, 3)), 0.0
        held = {name: np.zeros(6) for name in fields or {}}
        missing = np.setdiff1d(ids, np.concatenate([solid.ids for solid in self.blocks]))
        if len(missing):
            raise BodyError(f"there is no element {missing[0]} that deforms")
        for solid in self.blocks:
            here = solid.only(np.isin(solid.ids, ids))
            kind, some, law = here.kind, here.nodes, here.law
            if not len(some):
                continue
            count = len(_flexgram.shape_functions(kind, np.empty((0, 3)))[2])
            if point is not None and not 1 <= point <= count:
                raise BodyError(f"elements {kind} have the integration points 1 to {count}")
            chosen = slice(None) if point is None else slice(point - 1, point)
            stress, _, size = (a[:, chosen] for a in stress_operator(kind, self.points[some], law))
            part = np.einsum("eq,eqib->eib", size, stress).reshape(len(some), 6, -1, 3)
            np.add.at(values, some, part.transpose(0, 2, 1, 3))
            volume += float(size.sum())
            for name, field in (fields or {}).items():
                strain = here.free_strain(field.temperature)
                warm = heat_operator(kind, self.points[some], law, strain)[1][:, chosen]
                held[name] += np.einsum("eq,eqi->i", size, warm)
        used = np.flatnonzero(np.any(values != 0, axis=(1, 2)))
        return used, values[used] / volume, {name: s / volume for name, s in held.items()}


def temperatures(file: h5py.File) -> dict[str, Heat]:
    """Fields of temperature of a body file by their inputs."""
    found = {}
    for name, group in file.get("loads", {}).items():
        if "temperature" not in group:
            continue
        heat = Heat(*np.zeros((2, len(file["mesh/points"]))))
        nodes = group["temperature/nodes"][:]
        for field, key in zip(heat, ("values", "gradients"), strict=True):
            if key in group["temperature"]:
                field[nodes] = group["temperature"][key][:]
        found[f"{name}.{group.attrs['columns'][0]}"] = heat
    return found


def von_mises(stress: ArrayLike) -> Floats:
    """Equivalent stress of (…, 6) components.

    Examples
    --------
    >>> von_mises([[100.0, 0, 0, 0, 0, 0], [0, 0, 0, 100.0, 0, 0]]).round(2)
    array([100.  , 173.21])
    """
    s = np.asarray(stress, dtype=float)
    xx, yy, zz, xy, yz, zx = (s[..., i] for i in range(6))
    equivalent: Floats = np.sqrt(
        0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * (xy**2 + yz**2 + zx**2)
    )
    return equivalent


def principal(stress: ArrayLike) -> Floats:
    """Principal stresses (…, 3), descending, of (…, 6) components xx, yy, zz, xy, yz, zx; NaN where
    these are.

    Examples
    --------
    >>> principal([0, 0, 0, 100.0, 0, 0]).round(9) + 0.0
    array([ 100.,    0., -100.])
    """
    s = np.asarray(stress, dtype=float)
    tensor = s[..., [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    known = np.isfinite(s).all(axis=-1)
    values: Floats = np.full((*s.shape[:-1], 3), np.nan)
    values[known] = np.linalg.eigvalsh(tensor[known])[..., ::-1]
    return values


def signed_von_mises(stress: ArrayLike) -> Floats:
    """Equivalent stress of (…, 6) components with the sign of the principal stress that is largest
    in size: negative where pressure dominates. What fatigue counts.

    Examples
    --------
    >>> signed_von_mises([[100.0, 0, 0, 0, 0, 0], [-100.0, 0, 0, 0, 0, 0]])
    array([ 100., -100.])
    """
    s = np.asarray(stress, dtype=float)
    mean = s[..., :3].mean(axis=-1)
    x, y, z = (s[..., i] - mean for i in range(3))
    xy, yz, zx = (s[..., i] for i in range(3, 6))
    equivalent = von_mises(s)
    # The largest and the least principal stress add up to 2 mean - the middle one of the deviator,
    # by the Lode angle.
    third = x * y * z + 2 * xy * yz * zx - x * yz**2 - y * zx**2 - z * xy**2
    size = np.maximum(equivalent, np.finfo(float).tiny)
    angle = np.arccos(np.clip(13.5 * third / size / size / size, -1, 1)) / 3
    middle = 2 / 3 * equivalent * np.cos(angle - 2 * np.pi / 3)
    dominant = np.where(2 * mean - middle >= -1e-12 * equivalent, 1.0, -1.0)
    return dominant * equivalent
