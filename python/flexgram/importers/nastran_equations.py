"""What of Nastran bulk data becomes linear equations between grids: MPC, supports in axes of their
own (CD), RBE2 of some components, and RBE3 whose grid belongs to an element."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from flexgram.basics import BodyError
from flexgram.importers.alone import COMPONENTS, rigid_row, row_along
from flexgram.importers.nastran_deck import BulkDeck, named
from flexgram.importers.nastran_elements import Elements


class Equations:
    """Entries of ``equations`` of a description."""

    def __init__(self, deck: BulkDeck, elements: Elements) -> None:
        self.deck, self.elements = deck, elements
        self.entries: dict[str, dict[str, Any]] = {}

    def row(self, label: int, component: int, factor: float) -> list[list[Any]]:
        """Factor times a component (from 1) of a grid, along its own axes, or a scalar point."""
        if label in self.elements.scalars:
            return [[self.elements.scalars[label], "x", factor]]
        axes = self.deck.axes(label)
        return row_along(self.deck.at(label) + 1, component - 1, factor, axes)

    def _add(self, name: str, equations: list[list[list[Any]]]) -> None:
        if equations:
            self.entries.setdefault(name, {"terms": []})["terms"] += equations

    def hold(self, label: int, components: Iterable[int]) -> None:
        """A support along axes of the grid."""
        self._add("held_cd", [self.row(label, c, 1.0) for c in components])

    def follow(self, name: str, label: int, reference: int, components: Iterable[int]) -> None:
        """Some components of a grid move as a rigid body with another that has rotations, or lies
        in the same place."""
        arm = self.deck.points[self.deck.at(label)] - self.deck.points[self.deck.at(reference)]
        turns = reference in self.elements.turning
        number = self.deck.at(reference) + 1
        found = []
        for c in components:
            if c > 3 and label not in self.elements.turning:
                continue
            if not turns and (c > 3 or np.any(arm)):
                raise BodyError(
                    f"{self.deck.path}: {name.upper().replace('_', ' ')}: grid {reference} has no "
                    "rotations to move others by"
                )
            node, axes = self.deck.at(label) + 1, self.deck.axes(label)
            if turns:
                found.append(rigid_row(node, number, c - 1, arm, axes))
            else:
                rest = row_along(number, c - 1, -1.0, axes)
                found.append(row_along(node, c - 1, 1.0, axes) + rest)
        self._add(name, found)

    def arms(self) -> None:
        """Ends of beams beside their grids, or with pins, follow these as rigid bodies, along the
        beam's axes and but for the pins."""
        for arm in self.elements.arms:
            d = self.elements.point(arm.end) - self.deck.points[self.deck.at(arm.grid)]
            number = self.deck.at(arm.grid) + 1
            tied = [c for c in range(6) if c + 1 not in arm.pins]
            self._add("beams", [rigid_row(arm.end + 1, number, c, d, arm.axes) for c in tied])

    def average(
        self,
        number: int,
        element: Any,
        nodes: Sequence[int],
        weights: Sequence[float],
        averaged: Sequence[str],
    ) -> None:
        """The grid of a RBE3 that is a node of the body: its motion is the weighted least-squares
        mean of some components of others. Rotations weigh by the square of the mean distance of
        these from the grid, as in Nastran."""
        reference = int(element.ref_grid_id)
        at = self.deck.points[[self.deck.at(n) for n in nodes]]
        arms = at - self.deck.points[self.deck.at(reference)]
        length = float(np.linalg.norm(arms, axis=1).mean())
        normal, shares = np.zeros((6, 6)), []
        for n, weight, components, arm in zip(nodes, weights, averaged, arms, strict=True):
            carried = np.eye(6)
            carried[:3, 3:] = np.column_stack([np.cross(e, arm) for e in np.eye(3)])
            own = np.kron(np.eye(2), self.deck.axes(n))
            chosen = [int(c) - 1 for c in components if c in "123456"]
            chosen = [c for c in chosen if c < 3 or n in self.elements.turning]
            size = np.array([weight if c < 3 else weight * length**2 for c in chosen])
            measured = own[chosen]  # along the grid's axes
            share = (measured @ carried).T @ (size[:, None] * measured)
            normal += share @ carried
            shares.append(share)
        size = np.diag(normal)
        scale = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1)), 1)
        values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
        told = vectors[:, values > 1e-10]  # motions that the other grids tell
        own = np.kron(np.eye(2), self.deck.axes(reference))
        found = []
        for c in sorted(int(digit) - 1 for digit in str(element.refc) if digit in "123456"):
            if c > 2 and reference not in self.elements.turning:
                continue
            terms = self.row(reference, c + 1, 1.0)
            asked = scale * own[c]
            shares_of_told = told.T @ asked
            if np.linalg.norm(asked - told @ shares_of_told) > 1e-8 * np.linalg.norm(asked):
                words = (
                    f"its grids tell nothing of {COMPONENTS[c]}: they lie on a line or in a point"
                )
                raise self.deck.refuse("RBE3", number, words)
            of_mean = scale * (told @ (shares_of_told / values[values > 1e-10]))
            for n, share in zip(nodes, shares, strict=True):
                at_node = self.deck.at(n) + 1
                terms += [
                    [at_node, name, -float(f)]
                    for name, f in zip(COMPONENTS, of_mean @ share, strict=True)
                    if abs(f) > 1e-14
                ]
            found.append(terms)
        self._add(f"rbe3_{number}", found)

    def read_mpc(self, references: dict[int, str]) -> None:
        """MPC of the first subcase; of bulk data alone, all. ``references``: grids (from 1) that
        stand for interfaces."""
        for number in self.deck.chosen("MPC", [*self.deck.model.mpcs, *self.deck.model.mpcadds]):
            with named(self.deck.path, f"MPC {number} is not there"):
                cards = self.deck.model.get_reduced_mpcs(int(number), consider_mpcadd=True)
            for card in cards:
                self._add(f"mpc_{number}", [self._mpc(card, references)])

    def _mpc(self, card: Any, references: dict[int, str]) -> list[list[Any]]:
        terms: list[list[Any]] = []
        rows = zip(card.node_ids, card.components, card.coefficients, strict=True)
        for label, component, factor in rows:
            c = int(str(component) or 0)
            if int(label) in self.elements.scalars:
                terms += self.row(int(label), c, float(factor))
                continue
            k = self.deck.at(int(label)) + 1
            if k in references:
                why = f"grid {label} is that of {references[k]}, an interface"
            elif c not in range(1, 7) or (c > 3 and int(label) not in self.elements.turning):
                why = f"grid {label} has no component {component}"
            else:
                terms += self.row(int(label), c, float(factor))
                continue
            raise BodyError(f"{self.deck.path}: MPC {card.conid}: {why}")
        return terms
