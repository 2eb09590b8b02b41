"""What many modules share: the one error of users, and looking numbers up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


class BodyError(Exception):
    """A body description or mesh that cannot be used; the message says what to change."""


def index_of(labels: IntArray, wanted: IntArray) -> tuple[IntArray, NDArray[np.bool_]]:
    """Where each wanted label stands in ``labels`` (in any order), and whether it does."""
    if not len(labels):
        return np.zeros(np.shape(wanted), dtype=np.int64), np.zeros(np.shape(wanted), dtype=bool)
    order = np.argsort(labels, kind="stable")
    at = order[np.minimum(np.searchsorted(labels, wanted, sorter=order), len(order) - 1)]
    return at, labels[at] == wanted
