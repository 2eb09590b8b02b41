"""Loads of Nastran bulk data as inputs: forces, moments, pressure, gravity, spin, temperatures.

Every load set that case control chooses is one input, whose value 1 is what the deck says:
``load7.load``; the gravity of the set is another one, ``load7_gravity.load``, and its spin
``load7_spin.spin``; the temperatures of a case are ``temperature3.T``. A set of which a card is not
supported is left out as a whole, and named.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from flexgram.basics import Floats, Ints
from flexgram.body.face_integrals import corners_of
from flexgram.body.faces import CORNERS
from flexgram.importers.nastran_deck import BulkDeck, LeftOut
from flexgram.importers.nastran_elements import Elements
from flexgram.importers.nastran_heat import TemperatureSets, is_heat
from flexgram.importers.nastran_pressure import along_beam, face_of, inward, pressed
from flexgram.importers.nastran_rigid import RigidElements
from flexgram.importers.shared_load import share

OF_LOADS = ("FORCE", "MOMENT", "PLOAD", "GRAV", "ACCEL", "RFORCE", "SLOAD", "TEMP")


class LoadSets:
    """The load sets of a deck.

    Attributes
    ----------
    forces : (N, 6) array
        Of the set at hand: forces and moments of grids, and of nodes behind them.
    """

    def __init__(self, deck: BulkDeck, elements: Elements, rigid: RigidElements) -> None:
        self.deck, self.elements, self.rigid = deck, elements, rigid
        self.where = {
            label: (kind, cell)
            for (_, kind), (cells, labels) in elements.groups.items()
            for cell, label in zip(cells, labels, strict=True)
        }
        self.points = elements.places()
        self.forces = np.zeros((len(self.points), 6))
        self.gravity = np.zeros(3)
        self.spins: list[tuple[float, Floats, Floats]] = []

    def name_them(self) -> None:
        """Say what is left out if no input is made of it."""
        counts = Counter({str(k): int(v) for k, v in self.deck.model.card_count.items()})
        some = [f"{c} ({n})" for c, n in sorted(counts.items()) if c.startswith(OF_LOADS)]
        if some:
            self.deck.remark(
                f"loads of the deck are left out: {', '.join(some)} (--deck-loads makes inputs of "
                "them)"
            )

    def describe(self) -> dict[str, dict[str, Any]]:
        """Entries of ``loads`` of a description."""
        found: dict[str, dict[str, Any]] = {}
        for number in self._chosen("LOAD", *self._sets()):
            name = f"load{number}"
            try:
                self._collect(number)
                self._at_grids(name, found)
            except LeftOut as reason:
                self.deck.remark(f"load {number} is left out: {reason}")
        heat = TemperatureSets(self.deck, self.elements)
        numbers = heat.numbers()
        for number in self._chosen("TEMPERATURE(LOAD)", numbers, numbers):
            try:
                found[f"temperature{number}"] = heat.entry(number)
            except LeftOut as reason:
                self.deck.remark(f"temperature {number} is left out: {reason}")
        return found

    def _sets(self) -> tuple[set[int], set[int]]:
        """Numbers of all sets; those that no LOAD combines."""
        model = self.deck.model
        combined = [
            card
            for cards in model.load_combinations.values()
            for card in cards
            if card.type == "LOAD"
        ]
        parts = {int(n) for card in combined for n in card.load_ids}
        forces = {int(n) for n, of in model.loads.items() if not all(map(is_heat, of))}
        every = {int(card.sid) for card in combined} | forces
        return every, every - parts

    def _chosen(self, kind: str, known: set[int], alone: set[int]) -> list[int]:
        """The sets of all cases; where none chooses one, those alone."""
        control = self.deck.model.case_control_deck
        if control is None:
            return sorted(alone)
        keys = (kind, "TEMPERATURE(BOTH)", "TEMPERATURE") if "TEMP" in kind else (kind,)
        chosen = {
            int(case.params[key][0])
            for case in control.subcases.values()
            for key in keys
            if key in case.params
        }
        if lost := sorted(chosen - known):
            self.deck.remark(f"case control chooses {kind} {lost[0]}, which is not in the deck")
        return sorted(chosen & known) if chosen else sorted(alone)

    def _collect(self, number: int) -> None:
        """The forces, the gravity and the spins of a set.

        Raises
        ------
        LeftOut
            If one of its cards is not supported.
        """
        self.forces[:] = 0
        self.gravity[:] = 0
        self.spins = []
        cards = self._cards(number)
        makers = {
            "FORCE": self._force, "FORCE1": self._force, "FORCE2": self._force,
            "MOMENT": self._force, "MOMENT1": self._force, "MOMENT2": self._force,
            "PLOAD": self._pload, "PLOAD2": self._pload2, "PLOAD4": self._pload4,
            "PLOAD1": self._pload1, "GRAV": self._grav, "RFORCE": self._rforce,
            "SLOAD": self._sload,
        }  # fmt: skip
        unknown = Counter(card.type for card, _ in cards if card.type not in makers)
        if unknown:
            said = ", ".join(f"{kind} ({n})" for kind, n in sorted(unknown.items()))
            raise LeftOut(f"{said} is not supported")
        for card, factor in cards:
            makers[card.type](card, factor)

    def _cards(self, number: int) -> list[tuple[Any, float]]:
        """Cards of a set with their factors; not its temperatures, which are a set of their own."""
        model = self.deck.model
        parts = [(number, 1.0)] if number in model.loads else []
        for card in model.load_combinations.get(number, []):
            numbers = [int(n) for n in card.load_ids]
            if nested := [n for n in numbers if n in model.load_combinations]:
                raise LeftOut(f"it combines {min(nested)}, which is a LOAD itself")
            if lost := sorted(set(numbers) - {*map(int, model.loads)}):
                raise LeftOut(f"it combines {lost[0]}, which is not in the deck")
            factors = [float(card.scale) * float(x) for x in card.scale_factors]
            parts += list(zip(numbers, factors, strict=True))
        return [
            (card, factor) for n, factor in parts for card in model.loads[n] if not is_heat(card)
        ]

    def _system(self, card: Any) -> Any:
        """The coordinate system of a card; None: the basic one."""
        if card.Cid() in (0, None):
            return None
        if card.cid_ref is None:
            raise LeftOut(f"{card.type} in the system {card.Cid()}, which is not in the deck")
        return card.cid_ref

    def _turned(self, card: Any, vector: Floats) -> Floats:
        """A vector in the system of a card, which has to be rectangular, in the basic one."""
        system = self._system(card)
        if system is None:
            return vector
        if system.type[-1] != "R":
            raise LeftOut(f"{card.type} in the system {card.Cid()}, which is not rectangular")
        basic: Floats = vector @ np.asarray(system.beta(), dtype=float)
        return basic

    def _elements_of(self, card: Any) -> list[int]:
        labels = [int(n) for n in card.eids]
        if lost := sorted(set(labels) - {*map(int, self.deck.model.elements)}):
            raise LeftOut(f"{card.type} on element {lost[0]}, which is not in the deck")
        return labels

    def _at_grids(self, name: str, found: dict[str, dict[str, Any]]) -> None:
        """Entries of the set that was collected."""
        if self.forces.any():
            self._spread()
        used = np.flatnonzero(self.forces.any(axis=1))
        if len(used):
            columns = 6 if self.forces[:, 3:].any() else 3
            rows = np.column_stack([used + 1, self.forces[used, :columns]])
            found[name] = {"type": "nodal", "table": rows}
        if self.gravity.any():
            found[f"{name}_gravity"] = {"type": "acceleration", "vector": self.gravity.tolist()}
        for k, (square, point, axis) in enumerate(self.spins, 1):
            own = f"{name}_spin{k if len(self.spins) > 1 else ''}"
            found[own] = {"type": "spin", "point": point.tolist(), "axis": axis.tolist()}
            self.deck.remark(
                f"input {own}.spin is the square of a speed: that of the deck (RFORCE) is "
                f"{square:.9g} rad²/s²"
            )
        if not (len(used) or self.gravity.any() or self.spins):
            raise LeftOut("it vanishes")

    def _place(self, label: int) -> Floats:
        place: Floats = self.deck.points[self.deck.at(int(label))]
        return place

    def _force(self, card: Any, factor: float) -> None:
        grid = int(card.node_id)
        turns = card.type.startswith("MOMENT")
        if card.type in ("FORCE", "MOMENT"):
            vector = np.asarray(card.xyz, dtype=float)
            if system := self._system(card):
                vector = vector @ self.deck.axes_at(system, self._place(grid))
        elif card.type in ("FORCE1", "MOMENT1"):
            vector = self._unit(card, self._place(card.G2()) - self._place(card.G1()))
        else:
            ends = [self._place(n) for n in (card.G1(), card.G2(), card.G3(), card.G4())]
            vector = self._unit(card, np.cross(ends[1] - ends[0], ends[3] - ends[2]))
        if grid in self.elements.scalars:
            raise LeftOut(f"{card.type} at the scalar point {grid}")
        self.forces[self.deck.at(grid), 3 * turns : 3 * turns + 3] += factor * card.mag * vector

    @staticmethod
    def _unit(card: Any, vector: Floats) -> Floats:
        size = float(np.linalg.norm(vector))
        if not size > 0:
            raise LeftOut(f"{card.type} at grid {card.node_id} has no direction")
        unit: Floats = vector / size
        return unit

    def _sload(self, card: Any, factor: float) -> None:
        for node, size in zip(card.node_ids, card.mags, strict=True):
            if int(node) not in self.elements.scalars:
                raise LeftOut(f"SLOAD at {node}, which is no scalar point")
            self.forces[self.elements.scalars[int(node)] - 1, 0] += factor * float(size)

    def _grav(self, card: Any, factor: float) -> None:
        vector = self._turned(card, np.asarray(card.N, dtype=float))
        self.gravity += factor * float(card.scale) * vector

    def _rforce(self, card: Any, factor: float) -> None:
        if float(card.racc or 0.0):
            raise LeftOut("RFORCE with an angular acceleration (RACC)")
        axis = self._turned(card, np.asarray(card.r123, dtype=float))
        size = float(np.linalg.norm(axis))
        speed = 2 * np.pi * float(card.scale) * size
        if not size > 0 or not factor > 0:
            raise LeftOut("RFORCE without an axis, or with a negative factor")
        point = self._place(card.node_id) if card.node_id else np.zeros(3)
        self.spins.append((factor * speed**2, point, axis / size))

    def _pload(self, card: Any, factor: float) -> None:
        cell = np.array([self.deck.at(int(n)) for n in card.node_ids if n])
        if len(cell) not in (3, 4):
            raise LeftOut("PLOAD between other than 3 or 4 grids")
        self._press(cell, np.full(len(cell), factor * float(card.pressure)))

    def _pload1(self, card: Any, factor: float) -> None:
        """Forces and moments along a beam, by the cubic functions of its bending."""
        label, kind = int(card.eid), str(card.load_type)
        if label not in self.elements.beams:
            raise LeftOut(f"PLOAD1 on element {label}, which is no beam")
        if card.scale not in ("LE", "FR"):
            raise LeftOut(f"PLOAD1 by projected length ({card.scale})")
        axes, nodes = self.elements.beams[label]
        x = self.points[nodes]
        length = float(np.linalg.norm(x[-1] - x[0]))
        direction = np.eye(3)["XYZ".index(kind[1])]
        if kind.endswith("E"):
            direction = axes["XYZ".index(kind[1])]
        unit = 1.0 if card.scale == "FR" else length
        first, last = float(card.x1) / unit, float(card.x1 if card.x2 is None else card.x2) / unit
        p1, p2 = float(card.p1), float(card.p1 if card.p2 is None else card.p2)
        if not 0 <= first <= last <= 1 + 1e-9:
            raise LeftOut(f"PLOAD1 beside the beam {label}")
        if last - first < 1e-12:
            at, sizes = np.array([first]), np.array([p1])
        else:
            ends = np.unique(np.clip([first, *np.linspace(0, 1, len(nodes)), last], first, last))
            xi, weight = np.polynomial.legendre.leggauss(4)  # type: ignore[no-untyped-call]
            half, middle = np.diff(ends) / 2, (ends[1:] + ends[:-1]) / 2
            at = (middle[:, None] + half[:, None] * xi).ravel()
            sizes = (half[:, None] * weight).ravel() * length
            sizes = sizes * (p1 + (p2 - p1) * (at - first) / (last - first))
        for place, size in zip(at.tolist(), (factor * sizes).tolist(), strict=True):
            ends, of_ends = along_beam(
                self.points, axes[0], nodes, place, size * direction, turns=kind[0] == "M"
            )
            self.forces[ends] += of_ends

    def _pload2(self, card: Any, factor: float) -> None:
        for label in self._elements_of(card):
            self._press_shell("PLOAD2", label, np.full(4, factor * float(card.pressure)))

    def _pload4(self, card: Any, factor: float) -> None:
        if card.surf_or_line not in ("SURF", None) or str(card.line_load_dir or "NORM") != "NORM":
            raise LeftOut("PLOAD4 along lines")
        pressure = factor * np.asarray(card.pressures, dtype=float)
        direction = np.asarray(card.nvector if card.nvector is not None else np.zeros(3), float)
        if direction.any():
            direction = self._turned(card, direction)
        along = direction / np.linalg.norm(direction) if direction.any() else None
        for label in self._elements_of(card):
            kind, cell = self._element("PLOAD4", label)
            if kind in CORNERS:
                self._press_shell("PLOAD4", label, pressure, along)
                continue
            if card.g1_ref is None:
                raise LeftOut(f"PLOAD4 on the solid {label} names no grid of a face")
            first = self.deck.at(int(card.g1_ref.nid))
            other = None if card.g34_ref is None else self.deck.at(int(card.g34_ref.nid))
            face = face_of(kind, cell, first, other)
            if face is None:
                raise LeftOut(f"PLOAD4 on element {label}: its grids name no face")
            corners = corners_of(len(face))
            order = inward(face[:corners], first)
            values = np.empty(corners)
            values[order] = pressure[:corners]
            self._press(face, -values if along is None else values, along)

    def _element(self, card: str, label: int) -> tuple[str, list[int]]:
        if label not in self.where:
            raise LeftOut(f"{card} on element {label}, which is no solid and no shell")
        return self.where[label]

    def _press_shell(
        self, card: str, label: int, pressure: Floats, along: Floats | None = None
    ) -> None:
        """Along its normal, or another direction."""
        kind, cell = self._element(card, label)
        if kind not in CORNERS:
            raise LeftOut(f"{card} on element {label}, which is no shell")
        self._press(np.array(cell), pressure[: CORNERS[kind]], along)

    def _press(self, face: Ints, pressure: Floats, along: Floats | None = None) -> None:
        np.add.at(self.forces[:, :3], face, pressed(self.points[face], pressure, along))

    def _spread(self) -> None:
        """Forces at grids that only interfaces move, on the nodes of these, as their RBE2 or RBE3
        does; moments that no grid takes are left out, as AUTOSPC does."""
        reached = np.zeros(len(self.forces), dtype=bool)
        reached[[self.deck.at(label) for label in self.elements.used]] = True
        reached[len(self.deck.points) :] = True
        for k in np.flatnonzero(self.forces.any(axis=1) & ~reached).tolist():
            name = self.rigid.references.get(k + 1) or self.rigid.carried.get(k + 1)
            if name is None and k + 1 in self.rigid.grounded:
                self.forces[k] = 0  # it is held
                continue
            if name is None:
                raise LeftOut(f"grid {self.deck.labels[k]} belongs to no element")
            six, self.forces[k] = self.forces[k].copy(), 0
            interface = self.rigid.interfaces[name]
            nodes = np.array(interface["nodes"]) - 1
            of_nodes = share(self.points[nodes], self.points[k], six, interface.get("weights"))
            np.add.at(self.forces, nodes, np.hstack(of_nodes))
        turning = np.zeros(len(self.forces), dtype=bool)
        turning[[self.deck.at(label) for label in self.elements.turning]] = True
        turning[len(self.deck.points) :] = True
        for interface in self.rigid.interfaces.values():
            if interface["coupling"] == "rigid":
                turning[np.array(interface["nodes"]) - 1] = True
        lost = np.flatnonzero(self.forces[:, 3:].any(axis=1) & ~turning)
        if len(lost):
            self.deck.remark(
                f"moments at grids without rotations are left out, first at "
                f"{self.deck.labels[lost[0]]}, as AUTOSPC does"
            )
            self.forces[lost, 3:] = 0
