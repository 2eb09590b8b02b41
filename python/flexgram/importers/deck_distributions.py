"""Numbers of each element of a CalculiX or Abaqus deck: *DISTRIBUTION."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.importers.ccx import Job


@dataclass(frozen=True)
class Distribution:
    """Numbers of elements.

    Attributes
    ----------
    name : str
    default : (k,) array or None
        Of elements that are not named.
    of : dict
        By element label.
    """

    name: str
    default: Floats | None
    of: dict[int, Floats]

    def at(self, labels: Iterable[int], where: str) -> Floats:
        """Of elements (E, k).

        Raises
        ------
        BodyError
            For an element that has none.
        """
        rows = []
        for label in labels:
            row = self.of.get(int(label), self.default)
            if row is None:
                raise BodyError(
                    f"{where}: distribution {self.name} has nothing for element {label}"
                )
            rows.append(row)
        return np.array(rows)


def distributions_of(job: Job) -> dict[str, Distribution]:
    """Those of *DISTRIBUTION, by name.

    Raises
    ------
    BodyError
        For rows of different lengths, of sets, or of what is no element.
    """
    found: dict[str, Distribution] = {}
    for card in (card for card in job.model if card.keyword == "DISTRIBUTION"):
        name = card.options.get("NAME", "").upper()
        where = f"{job.path}: *DISTRIBUTION, NAME={name}"
        if card.options.get("LOCATION", "ELEMENT").upper() != "ELEMENT":
            raise BodyError(f"{where}: only LOCATION=ELEMENT is followed")
        default, of = None, {}
        try:
            for words in card.words():
                if not any(words):
                    continue
                numbers = np.array([float(word) for word in words[1:] if word])
                if words[0]:
                    of[int(words[0])] = numbers
                else:
                    default = numbers
        except ValueError:
            raise BodyError(
                f"{where}: expected rows of an element and numbers; sets are not supported"
            ) from None
        rows = [*of.values(), *([] if default is None else [default])]
        if not rows or len({len(row) for row in rows}) > 1 or not len(rows[0]):
            raise BodyError(f"{where}: expected as many numbers in each row")
        found[name] = Distribution(name, default, of)
    return found
