"""A force and a moment at the reference of an interface, on the nodes that it moves or averages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexgram.basics import Floats


def share(
    points: Floats, place: Floats, six: Floats, weights: Sequence[float] | None = None
) -> tuple[Floats, Floats]:
    """Forces on nodes that equal a force and a moment, by weights and arms, as a distributing
    interface does; on a rigid one all such forces do the same.

    Parameters
    ----------
    points : (n, 3) array
        The nodes.
    place : (3,) array
        Where the force acts.
    six : (6,) array
        Force and moment.
    weights : sequence of n floats, optional
        Default: equal.

    Returns
    -------
    forces : (n, 3) array
    moments : (n, 3) array
        Zero, unless all nodes lie on a line about which the moment turns.
    """
    w = np.ones(len(points)) if weights is None else np.asarray(weights, dtype=float)
    middle = w @ points / w.sum()
    r = points - middle
    moment = six[3:] + np.cross(place - middle, six[:3])
    inertia = np.einsum("n,na,nb->ab", w, r, r)
    inertia = np.trace(inertia) * np.eye(3) - inertia
    turn = np.linalg.lstsq(inertia, moment, rcond=1e-9)[0]
    forces: Floats = w[:, None] * (six[:3] / w.sum() + np.cross(turn, r))
    left = moment - inertia @ turn
    if np.linalg.norm(left) <= 1e-9 * float(np.linalg.norm(moment)):
        left = np.zeros(3)
    moments: Floats = w[:, None] * left / w.sum()
    return forces, moments
