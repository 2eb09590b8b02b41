"""Temperatures of Nastran bulk data (TEMP, TEMPD) as loads."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from flexgram.basics import Floats
from flexgram.importers.nastran_deck import BulkDeck, LeftOut
from flexgram.importers.nastran_elements import Elements


class TemperatureSets:
    """Those of a deck."""

    def __init__(self, deck: BulkDeck, elements: Elements) -> None:
        self.deck, self.elements = deck, elements

    def numbers(self) -> set[int]:
        """Of all sets."""
        model = self.deck.model
        grids = {int(n) for n, of in model.loads.items() if any(map(is_heat, of))}
        return grids | {*map(int, model.tempds), *(n for _, n in self.deck.heat_of_elements)}

    def entry(self, number: int) -> dict[str, Any]:
        """Entry of ``loads`` of a set: temperatures above those without stress.

        Raises
        ------
        LeftOut
            If it is not supported, or leaves a grid without one.
        """
        model = self.deck.model
        cards = model.loads.get(number, [])
        others = Counter(
            card.type for card in cards if card.type.startswith("TEMP") and card.type != "TEMP"
        )
        others.update(kind for kind, of in self.deck.heat_of_elements if of == number)
        others.pop("TEMPD", None)
        if others:
            said = ", ".join(f"{kind} ({n})" for kind, n in sorted(others.items()))
            raise LeftOut(f"{said} is not supported")
        without = [name for name, of in self.elements.materials.entries.items()
                   if "expansion" not in of and not name.endswith("_shear")]  # fmt: skip
        if without:
            raise LeftOut(f"material {without[0]} has no expansion, or one that shears")
        above = self._field(number) - self._start()
        used = np.array([self.deck.at(label) for label in sorted(self.elements.used)])
        warm = np.append(above, np.zeros(len(self.elements.places()) - len(above)))
        more = []
        for arm in self.elements.arms:  # ends of beams are as warm as their grids
            warm[arm.end] = above[self.deck.at(arm.grid)]
            more.append(arm.end)
        for _, nodes in self.elements.beams.values():  # and tapered ones between
            for k, node in enumerate(nodes[1:-1], 1):
                at = k / (len(nodes) - 1)
                warm[node] = (1 - at) * warm[nodes[0]] + at * warm[nodes[-1]]
                more.append(node)
        used = np.concatenate([used, np.array(more, dtype=np.int64)])
        if not np.all(np.isfinite(warm[used])):
            first = int(used[~np.isfinite(warm[used])][0])
            grids = {arm.end: arm.grid for arm in self.elements.arms}
            grid = grids.get(first, self.deck.labels[min(first, len(above) - 1)])
            raise LeftOut(f"grid {grid} has no temperature (TEMP, TEMPD)")
        used = np.unique(used)
        used = used[warm[used] != 0]
        if not len(used):
            raise LeftOut("it is that without stress")
        return {"type": "temperature", "table": np.column_stack([used + 1, warm[used]])}

    def _field(self, number: int) -> Floats:
        """Temperatures (G,) of grids; NaN where none is given."""
        model = self.deck.model
        field = np.full(len(self.deck.points), np.nan)
        if number in model.tempds:
            field[:] = float(model.tempds[number].temperature)
        for card in (c for c in model.loads.get(number, []) if c.type == "TEMP"):
            for label, value in card.temperatures.items():
                field[self.deck.at(int(label))] = float(value)
        return field

    def _start(self) -> Floats | float:
        """Those without stress: of TEMPERATURE(INITIAL), or TREF of all materials."""
        control = self.deck.model.case_control_deck
        for case in control.subcases.values() if control is not None else ():
            if "TEMPERATURE(INITIAL)" in case.params:
                return self._field(int(case.params["TEMPERATURE(INITIAL)"][0]))
        references = self.elements.materials.references
        if len(references) > 1:
            said = ", ".join(f"{t:g}" for t in sorted(references))
            raise LeftOut(f"materials have different temperatures without stress (TREF {said})")
        return next(iter(references), 0.0)


def is_heat(card: Any) -> bool:
    """Whether a card of a load set is a temperature."""
    return str(card.type).startswith("TEMP")
