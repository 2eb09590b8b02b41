"""Axes of nodes of a CalculiX or Abaqus deck (*TRANSFORM)."""

from __future__ import annotations

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.orientation import cylindrical, rectangular
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
        labels = [int(label) for label in deck.sets[name]]
        if kind == "C":
            places = deck.points[[deck.index(job.path, label) for label in labels]]
            axes = cylindrical(places, a, b - a, where)
        else:
            axes = np.repeat(rectangular(np.hstack([a, b])[None], where), len(labels), axis=0)
        found.update(zip(labels, axes, strict=True))
    return found
