"""Nodes by place: in a box, or the one nearest to a point. One meaning for descriptions of meshes
(YAML) and for matrices of FE codes (command line)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexgram.basics import BodyError, Floats, Ints


def in_box(points: Floats, corners: Floats, place: str) -> Ints:
    """Indices of the points in an axis-parallel box, given by two opposite corners (2 x 3).

    Raises
    ------
    BodyError
        If there are none, with what the points span.
    """
    inside = np.all((points >= corners.min(0)) & (points <= corners.max(0)), axis=1)
    if not inside.any():
        low, high = points.min(0), points.max(0)
        raise BodyError(
            f"{place}: no node in the box; the body spans "
            f"({low[0]:.6g}, {low[1]:.6g}, {low[2]:.6g}) to "
            f"({high[0]:.6g}, {high[1]:.6g}, {high[2]:.6g})"
        )
    return np.flatnonzero(inside)


def nearest(
    points: Floats, at: Floats, place: str, doubt: Callable[[str], None] | None = None
) -> int:
    """Index of the point nearest to ``at`` (3).

    Parameters
    ----------
    doubt : callable, optional
        Told where the point is farther away than three times its distance to the next one.

    Raises
    ------
    BodyError
        If that is farther away than a tenth of the body's size: other units, probably.
    """
    distance = np.linalg.norm(points - at, axis=1)
    extent = np.linalg.norm(np.ptp(points, axis=0))
    if distance.min() > 0.1 * extent:
        raise BodyError(
            f"{place}: the nearest node is {distance.min():.6g} away, the body "
            f"measures {extent:.6g}: are these its units?"
        )
    found = int(np.argmin(distance))
    if doubt is not None and distance[found] > 0:
        beside = np.linalg.norm(points - points[found], axis=1)
        spacing = beside[beside > 0].min(initial=np.inf)
        if distance[found] > 3 * spacing:
            there = ", ".join(f"{x:.6g}" for x in points[found])
            doubt(
                f"{place}: the nearest node is {distance[found]:.3g} away, at ({there}); its "
                f"neighbours are {spacing:.3g} from it. Are these the units of the files? (A "
                "bore has no node on its axis: take its set, or a box.)"
            )
    return found
