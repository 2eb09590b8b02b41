"""Axes of the material in each element: around an axis, or as an importer gives them.

Solids take a first and a second axis, shells the first one, projected onto their surface.
"""

from __future__ import annotations

from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.meshfile import AXES, SOLIDS
from flexgram.body.reader import Reader

#: The material's first, second and third axis: outward (r), around (t) and along (z) the axis.
FIRST = {"radial": (0, 1, 2), "around": (1, 2, 0), "along": (2, 0, 1)}


def cylindrical(places: Floats, point: Floats, axis: Floats, where: str) -> Floats:
    """Directions outward, around and along an axis.

    Parameters
    ----------
    places : (E, 3) array
    point, axis : (3,) arrays
        Of the axis; its length does not matter.
    where : str
        For messages.

    Returns
    -------
    (E, 3, 3) array
        In rows.

    Raises
    ------
    BodyError
        If the axis has no direction, or a place is on it.

    Examples
    --------
    >>> z = np.array([0, 0, 3.0])
    >>> cylindrical(np.array([[0.0, 2, 5]]), np.zeros(3), z, "tube")[0].round(12)
    array([[ 0.,  1.,  0.],
           [-1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    length = np.linalg.norm(axis)
    if not length > 0:
        raise BodyError(f"{where}: its axis has no direction")
    along = np.broadcast_to(axis / length, places.shape)
    arm = places - point
    outward = arm - (arm @ along[0])[:, None] * along if len(places) else arm
    distance = np.linalg.norm(outward, axis=1)
    if np.any(distance <= 1e-9 * np.abs(arm).max(initial=0.0)):
        raise BodyError(f"{where}: a place is on the axis, and has no direction outward")
    outward = outward / distance[:, None]
    return np.stack([outward, np.cross(along, outward), along], axis=1)


def rectangular(points: Floats, where: str) -> Floats:
    """Axes of points a on the first one and b in the plane of the first and the second.

    Parameters
    ----------
    points : (E, 6) or (E, 9) array
        a, b, and if it is not zero the origin.
    where : str
        For messages.

    Returns
    -------
    (E, 3, 3) array
        In rows.

    Raises
    ------
    BodyError
        If there are other numbers, or the points have no direction.

    Examples
    --------
    >>> rectangular(np.array([[0.0, 2, 0, -1, 1, 0]]), "axes")[0].tolist()
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if points.shape[1] not in (6, 9):
        raise BodyError(f"{where}: its axes need six numbers, or nine")
    origin = points[:, 6:] if points.shape[1] == 9 else 0.0
    first, in_plane = points[:, :3] - origin, points[:, 3:6] - origin
    third = np.cross(first, in_plane)
    size = np.linalg.norm(third, axis=1)[:, None]
    if not np.all(size > 0):
        raise BodyError(f"{where}: its axes have no direction")
    first, third = first / np.linalg.norm(first, axis=1)[:, None], third / size
    return np.stack([first, np.cross(third, first), third], axis=1)


def with_second(first: Floats) -> Floats:
    """Some second axis for shells, which need the first alone: (E, 3) -> (E, 6), orthonormal.

    Examples
    --------
    >>> with_second(np.array([[0.0, 2, 0]]))
    array([[0., 1., 0., 1., 0., 0.]])
    """
    first = first / np.linalg.norm(first, axis=1)[:, None]
    beside = np.eye(3)[np.argmin(np.abs(first), axis=1)]
    second = beside - first * np.einsum("ei,ei->e", first, beside)[:, None]
    return np.hstack([first, second / np.linalg.norm(second, axis=1)[:, None]])


def stiffness_places(kind: str, points: Floats) -> Floats:
    """Where the axes of elements count (E, q, 3): in solids the points of the stiffness, in others
    the middle.

    Parameters
    ----------
    kind : str
        Meshio's name, and behind a stroke the formulation.
    points : (E, n, 3) array
        Their nodes.

    Examples
    --------
    >>> corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    >>> stiffness_places("tetra", corners)
    array([[[0.25, 0.25, 0.25]]])
    """
    if kind.partition("/")[0] not in SOLIDS:
        middle: Floats = points.mean(axis=1)[:, None]
        return middle
    import _flexgram

    N = _flexgram.shape_functions(kind, np.empty((0, 3)))[2]
    places: Floats = np.einsum("qn,enx->eqx", N, points)
    return places


def expect_in_surface(points: Floats, nodes: Ints, axes: Floats, where: str) -> None:
    """Refuse a first axis (E, 6) along the normal of its shell (E, n).

    Raises
    ------
    BodyError
        If there is one.

    Examples
    --------
    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> expect_in_surface(square, np.array([[0, 1, 2, 3]]), np.array([[1.0, 0, 0, 0, 1, 0]]), "")
    """
    x = points[nodes]
    normal = np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])
    along = np.abs(np.einsum("ei,ei->e", normal, axes[:, :3]))
    if np.any(along > 0.999999 * np.linalg.norm(normal, axis=1)):
        raise BodyError(
            f"{where}: the first axis of the material is along the normal of a shell; around an "
            "axis take another one (orientation: first: around, or along)"
        )


def element_axes(
    mesh: meshio.Mesh, block: int, chosen: Ints, kind: str, entry: Reader
) -> Floats | None:
    """First and second axis of the material in some elements, at the points of the stiffness of
    solids (E, q, 6), in the middle of others (E, 6); None: the material's own.

    Parameters
    ----------
    mesh : meshio.Mesh
        With cell data ``AXES`` where an importer knows them.
    block : int
    chosen : int array
        Elements of that block of the mesh.
    kind : str
        Meshio's name of them, and behind a stroke the formulation.
    entry : Reader
        Of the region; its ``orientation`` comes first.

    Raises
    ------
    BodyError
        For a wrong orientation.
    """
    if "orientation" in entry.data:
        where = f"{entry.where}: orientation"
        given = Reader(entry.get("orientation"), where, ("point", "axis", "first"))
        first, second, _ = FIRST[given.choice("first", FIRST, "radial")]
        nodes = mesh.cells[block].data[chosen]
        places = stiffness_places(kind, np.asarray(mesh.points, dtype=float)[nodes])
        shape = (len(nodes), places.shape[1], 6) if kind.partition("/")[0] in SOLIDS else (-1, 6)
        place, axis = given.vector("point"), given.vector("axis")
        axes = cylindrical(places.reshape(-1, 3), place, axis, where)
        found: Floats = np.hstack([axes[:, first], axes[:, second]]).reshape(shape)
        return found
    known: Any = mesh.cell_data.get(AXES)
    if known is None:
        return None
    axes = np.asarray(known[block], dtype=float)[chosen]
    missing = np.isnan(axes[..., 0]).reshape(len(axes), -1).any(axis=1)
    if missing.all():
        return None
    if missing.any():
        raise BodyError(f"{entry.where}: some of its elements have axes of their own, others none")
    return axes
