"""Axes of nodes of a CalculiX or Abaqus deck (*TRANSFORM)."""

from __future__ import annotations

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.importers.ccx import Job
from flexgram.importers.deck import Deck


def axes_of_nodes(job: Job, deck: Deck) -> dict[int, Floats]:
    """Label -> axes in rows (3, 3), of the nodes that have some of their own: rectangular (TYPE=R),
    or radial, tangential and axial (TYPE=C).

    Raises
    ------
    BodyError
        For kinds, sets and numbers that are not known.
    """
    found: dict[int, Floats] = {}
    for card in (card for card in job.model if card.keyword == "TRANSFORM"):
        name, kind = (card.options.get(key, "").upper() for key in ("NSET", "TYPE"))
        where = f"{job.path}: *TRANSFORM, NSET={name}"
        if name not in deck.sets or kind not in ("", "R", "C"):
            raise BodyError(f"{where}: needs a node set that is there, and TYPE=R or C")
        try:
            a, b = np.array([float(w) for row in card.words() for w in row if w]).reshape(2, 3)
        except ValueError:
            raise BodyError(f"{where}: expected six numbers") from None
        for label in deck.sets[name].tolist():
            at = deck.index(job.path, label)
            first, third = (a, np.cross(a, b)) if kind != "C" else (deck.points[at] - a, b - a)
            if kind == "C":
                first = first - third * (first @ third) / max(float(third @ third), 1e-300)
            lengths = np.linalg.norm(first), np.linalg.norm(third)
            if not min(lengths) > 1e-12 * max(1e-300, float(np.abs([a, b]).max())):
                raise BodyError(f"{where}: its axes have no direction at node {label}")
            first, third = first / lengths[0], third / lengths[1]
            found[int(label)] = np.array([first, np.cross(third, first), third])
    return found
