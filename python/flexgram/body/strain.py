"""Strain and stress of single elements from displacements of their nodes, and from heat; which
elements have some."""

from __future__ import annotations

from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from flexgram.basics import Floats, Ints
from flexgram.body.faces import LINEAR, MIDDLES

#: Places of the corners on the reference element.
CORNERS = {
    "tetra": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [
        (-1, -1, -1),
        (1, -1, -1),
        (1, 1, -1),
        (-1, 1, -1),
        (-1, -1, 1),
        (1, -1, 1),
        (1, 1, 1),
        (-1, 1, 1),
    ],
    "triangle": [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
    "quad": [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)],
    "wedge": [(0, 0, -1), (1, 0, -1), (0, 1, -1), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
}


class Heat(NamedTuple):
    """A field of temperature."""

    temperature: Floats  #: (N,) above that of the body without stress [K]
    gradient: Floats  #: (N,) along the normals of shells [K/m]


def stiffness_of(material: Any, *, own_axes: bool = False) -> Floats:
    """The law of a material of a body file, (36,) [Pa], in global axes or in its own: of stress xx,
    yy, zz, xy, yz, zx over strains with engineering shears.

    Examples
    --------
    >>> steel = {"E": 2.1e11, "nu": 0.3}
    >>> round(stiffness_of(steel)[-1] / 1e10, 3)  # the shear modulus
    8.077
    """
    import _flexgram

    axes = np.eye(3).ravel() if own_axes else material.get("axes")
    if "E" in material:
        law = _flexgram.isotropic(material["E"], material["nu"])
    elif "stiffness" in material:
        law = _flexgram.anisotropic(material["stiffness"], axes)
    else:
        law = _flexgram.orthotropic(material["engineering_constants"], axes)
    found: Floats = np.array(law)
    return found


def expansion_of(material: Any, axes: Floats) -> Floats | None:
    """Strain of one kelvin (..., 6), of a material of a body file with axes (..., 3, 3); None where
    it is not known.

    Examples
    --------
    >>> expansion_of({"expansion": [1e-6, 3e-5, 3e-5]}, np.eye(3)[[1, 0, 2]])
    array([3.e-05, 1.e-06, 3.e-05, 0.e+00, 0.e+00, 0.e+00])
    """
    if "expansion" not in material:
        return None
    along = np.broadcast_to(material["expansion"], 3)
    e = np.einsum("...ka,k,...kb->...ab", axes, along, axes)
    strain: Floats = e[..., [0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]] * [1, 1, 1, 2, 2, 2]
    return strain


def turned(law: Floats, axes: Floats) -> Floats:
    """Laws of elements whose material has axes of its own in each.

    Parameters
    ----------
    law : (6, 6) array
        In the material's axes [N/m²].
    axes : (E, 6) or (E, q, 6) array
        Its first and second axis in each element, or at each of its points, orthonormal.

    Returns
    -------
    (E, 6, 6) or (E, q, 6, 6) array
        In global axes.

    Examples
    --------
    >>> law = np.diag([9.0, 1, 1, 1, 1, 1])
    >>> turned(law, np.array([[0.0, 1, 0, -1, 0, 0]]))[0].diagonal().round(12)
    array([1., 9., 1., 1., 1., 1.])
    """
    R = whole_axes(axes.reshape(-1, 6))
    i, j = np.array([0, 1, 2, 0, 1, 2]), np.array([0, 1, 2, 1, 2, 0])
    both = R[:, i][:, :, i] * R[:, j][:, :, j] + R[:, i][:, :, j] * R[:, j][:, :, i]
    T = both * np.where(i == j, 1.0, 2.0)[:, None] * 0.5
    found: Floats = (np.swapaxes(T, 1, 2) @ law @ T).reshape(*axes.shape[:-1], 6, 6)
    return found


def whole_axes(axes: Floats) -> Floats:
    """Three axes as rows (..., 3, 3), of the first and the second (..., 6).

    Examples
    --------
    >>> whole_axes(np.array([1.0, 0, 0, 0, 1, 0]))[2].tolist()
    [0.0, 0.0, 1.0]
    """
    first, second = axes[..., :3], axes[..., 3:]
    return np.stack([first, second, np.cross(first, second)], axis=-2)


def rigid_interfaces(file: h5py.File) -> Ints:
    """The number of the rigid interface that each node of an open body file follows, (N,); -1 where
    it follows none.

    Examples
    --------
    >>> with h5py.File("rack.h5") as file:
    ...     np.unique(rigid_interfaces(file))
    array([-1,  0,  1])
    """
    follows = np.full(len(file["mesh/points"]), -1)
    for number, item in enumerate(file["interfaces"].values()):
        if str(item.attrs["coupling"]) == "rigid":
            follows[item["nodes"][:]] = number
    return follows


def deforming(nodes: Ints, follows: Ints) -> NDArray[np.bool_]:
    """Which elements of ``nodes`` (E, n) do not move with one rigid interface as a whole, (E,).

    Examples
    --------
    >>> deforming(np.array([[0, 1, 2], [1, 2, 3]]), follows=np.array([0, 0, 0, -1]))
    array([False,  True])
    """
    at = follows[nodes]
    result: NDArray[np.bool_] = (at[:, 0] < 0) | np.any(at != at[:, :1], axis=1)
    return result


def _polynomials(kind: str, xi: Floats, points: int) -> Floats:
    """Functions (q, k) of the reference coordinates that are linear in each direction, those that
    so many points tell."""
    x, y, z = xi.T
    one = np.ones(len(xi))
    if kind == "triangle":
        return np.column_stack([one, x, y])
    if kind == "quad":
        return np.column_stack([one, x, y, x * y])
    if kind == "tetra":
        return np.column_stack([one, x, y, z])
    if kind == "wedge":
        if points == 2:  # on its middle axis
            return np.column_stack([one, z])
        return np.column_stack([one, x, y, z, x * z, y * z])
    return np.column_stack([one, x, y, z, x * y, y * z, z * x, x * y * z])


def extrapolation(kind: str, xi: Floats) -> Floats:
    """Values at the nodes of an element (n, q) from those at points xi (q, 3).

    Examples
    --------
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> extrapolation("tetra", np.full((1, 3), 0.25)) @ np.array([7.0])
    array([7., 7., 7., 7.])
    """
    if kind == "hexahedron20":
        import _flexgram

        own: Floats = np.linalg.pinv(_flexgram.shape_functions(kind, xi)[2])
        return own
    kind = kind.partition("/")[0]
    corner = LINEAR.get(kind, kind)
    at = np.array(CORNERS[corner], dtype=float)
    if len(xi) == 1:
        corners = np.ones((len(at), 1))
    else:
        inner = _polynomials(corner, xi, len(xi))
        corners = _polynomials(corner, at, len(xi)) @ np.linalg.pinv(inner)
    middles = sorted((number, sorted(edge)) for edge, number in MIDDLES.get(kind, {}).items())
    between = [corners[edge].mean(axis=0) for _, edge in middles]
    whole: Floats = np.vstack([corners, *between])
    return whole


def _strain(gradients: Floats) -> Floats:
    """Strains (…, 6, n, 3), engineering shears, of unit displacements of functions with gradients
    (…, n, 3)."""
    strain = np.zeros((*gradients.shape[:-2], 6, *gradients.shape[-2:]))
    x, y, z = (gradients[..., a] for a in range(3))
    for row, direction, slope in (
        (0, 0, x),
        (1, 1, y),
        (2, 2, z),
        (3, 0, y),
        (3, 1, x),
        (4, 1, z),
        (4, 2, y),
        (5, 0, z),
        (5, 2, x),
    ):
        strain[..., row, :, direction] = slope
    return strain


def _incompatible(points: Floats, xi: Floats, size: Floats) -> Floats:
    """Strains (E, q, 6, 9) of the modes 1 − ξ² of hexahedra with 8 nodes."""
    import _flexgram

    slopes = _flexgram.shape_functions("hexahedron", np.zeros((1, 3)))[3][0]
    centre = np.einsum("na,enx->eax", slopes, points)
    inverse, at_centre = np.linalg.inv(centre), np.linalg.det(centre)
    factor = -2 * xi[None] * (at_centre[:, None] / size)[..., None]
    return _strain(np.einsum("eqa,exa->eqax", factor, inverse)).reshape(*size.shape, 6, 9)


def stress_operator(kind: str, points: Floats, law: Floats) -> tuple[Floats, Floats, Floats]:
    """Stress at the points of the stiffness for unit displacements of the nodes.

    Parameters
    ----------
    kind : str
        Meshio's name of the element, and behind a stroke the formulation where it is another.
    points : (E, n, 3) array
        Nodes of each element [m].
    law : (6, 6), (E, 6, 6) or (E, q, 6, 6) array
        [N/m²]

    Returns
    -------
    stress, strain : (E, q, 6, 3n) arrays
        Rows and columns as ``COMPONENTS`` and x, y, z of each node.
    volume : (E, q) array
        Of each point [m³].

    Examples
    --------
    >>> corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    >>> law = np.diag([2.0, 2, 2, 1, 1, 1])
    >>> B, *_ = stress_operator("tetra", corners, law)
    >>> stretch = corners * [0.1, 0, 0]  # u_x = 0.1 x
    >>> np.round(B.reshape(-1, 6, 12)[0] @ stretch.ravel(), 3)
    array([0.2, 0. , 0. , 0. , 0. , 0. ])
    """
    import _flexgram

    xi, weight, _, dN = _flexgram.shape_functions(kind, np.empty((0, 3)))
    jacobian = np.einsum("qna,enx->eqax", dN, points)
    size = np.linalg.det(jacobian)
    gradients = np.einsum("eqxa,qna->eqnx", np.linalg.inv(jacobian), dN)
    volume = weight * size
    count = points.shape[1]
    strain = _strain(gradients).reshape(*size.shape, 6, 3 * count)
    if kind == "hexahedron":  # with the incompatible modes 1 − ξ², condensed
        inner = _incompatible(points, xi, size)
        weighed = volume[..., None, None] * (at_points(law) @ inner)
        stiffness = np.einsum("eqja,eqjb->eab", weighed, inner)
        coupling = np.einsum("eqja,eqjb->eab", weighed, strain)
        strain = strain - inner @ np.linalg.solve(stiffness, coupling)[:, None]
    return at_points(law) @ strain, strain, volume


def at_points(law: Floats) -> Floats:
    """Laws of all elements, of each or at each point, as factors of arrays (E, q, 6, ...).

    Examples
    --------
    >>> [at_points(np.zeros(shape)).shape for shape in ((6, 6), (8, 6, 6), (8, 4, 6, 6))]
    [(6, 6), (8, 1, 6, 6), (8, 4, 6, 6)]
    """
    return law[:, None] if law.ndim == 3 else law


def heat_operator(kind: str, points: Floats, law: Floats, strain: Floats) -> tuple[Floats, Floats]:
    """What a strain without stress, that of heat, does to elements whose nodes are held.

    Parameters
    ----------
    kind, points, law
        As of ``stress_operator``.
    strain : (E, q, 6) array
        At the points of the stiffness.

    Returns
    -------
    forces : (E, n, 3) array
        On the nodes [N].
    stress : (E, q, 6) array
        [N/m²]

    Examples
    --------
    >>> corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    >>> warm = np.full((1, 1, 6), 1e-5) * [1, 1, 1, 0, 0, 0]
    >>> forces, stress = heat_operator("tetra", corners, 2e11 * np.eye(6), warm)
    >>> bool(np.allclose(forces.sum(axis=1), 0, atol=1e-6))  # it pushes nothing as a whole
    True
    """
    import _flexgram

    _, own, volume = stress_operator(kind, points, law)
    held = (at_points(law) @ strain[..., None])[..., 0]
    forces = np.einsum("eq,eqib,eqi->eb", volume, own, held).reshape(points.shape)
    stress = -held
    if kind == "hexahedron":  # its inner modes give way
        xi, weight = _flexgram.shape_functions(kind, np.empty((0, 3)))[:2]
        inner = _incompatible(points, xi, volume / weight)
        weighed = volume[..., None, None] * (at_points(law) @ inner)
        stiffness = np.einsum("eqia,eqib->eab", inner, weighed)
        push = np.einsum("eq,eqia,eqi->ea", volume, inner, held)
        give = np.linalg.solve(stiffness, push[..., None])[..., 0]
        stress = stress + (at_points(law) @ inner @ give[:, None, :, None])[..., 0]
    return forces, stress
