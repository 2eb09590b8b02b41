"""Generated sheets of shell elements, for references and tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def sheet(
    kind: str,
    counts: tuple[int, int],
    shape: Callable[[Array, Array], Any],
    distort: float = 0.0,
) -> meshio.Mesh:
    """A sheet of ``triangle`` or ``quad`` elements.

    Parameters
    ----------
    kind : str
    counts : (int, int)
        Squares along each of its sides; of triangles each is cut in two.
    shape : callable
        Coordinates x, y, z over two arrays from 0 to 1, along the first and the second side.
    distort : float
        How far inner nodes move at random, in sides of an element.

    Returns
    -------
    meshio.Mesh
        With the sides as node sets ``start``, ``end`` (of the first), ``bottom``, ``top`` (of the
        second), and ``corner``, the end of start and bottom.
    """
    n, m = counts
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    rng = np.random.default_rng(1)
    u[1:-1, 1:-1] += rng.uniform(-distort, distort, (n - 1, m - 1)) / n
    v[1:-1, 1:-1] += rng.uniform(-distort, distort, (n - 1, m - 1)) / m
    points = np.column_stack([np.broadcast_to(c, u.size) for c in shape(u.ravel(), v.ravel())])
    at = np.arange(points.shape[0]).reshape(u.shape)
    squares = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    if kind == "triangle":  # diagonals in turn, so that no direction is special
        first = np.add.outer(np.arange(n), np.arange(m)).ravel() % 2 == 0
        one = squares[first][:, [[0, 1, 2], [0, 2, 3]]]
        other = squares[~first][:, [[0, 1, 3], [1, 2, 3]]]
        squares = np.vstack([one.reshape(-1, 3), other.reshape(-1, 3)])
    sides = {
        "start": at[0],
        "end": at[-1],
        "bottom": at[:, 0],
        "top": at[:, -1],
        "corner": at[0, :1],
        "middle": at[n // 2, m // 2 : m // 2 + 1],
    }
    return meshio.Mesh(points, [(kind, squares)], point_sets=sides)


def flat(length: float, width: float) -> Callable[[Array, Array], Any]:
    """A rectangle in the plane z = 0."""
    return lambda u, v: (length * u, width * v, 0 * u)
