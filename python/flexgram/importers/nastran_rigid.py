"""Supports (SPC), rigid (RBE2, RBAR) and distributing (RBE3) elements of Nastran bulk data."""

from __future__ import annotations

from typing import Any

from flexgram.basics import BodyError
from flexgram.importers.nastran_deck import BulkDeck, named
from flexgram.importers.nastran_elements import Elements
from flexgram.importers.nastran_equations import Equations
from flexgram.importers.nastran_points import PointElements


class RigidElements:
    """Entries of ``supports`` and ``interfaces`` of a description; what is fixed to them."""

    def __init__(
        self, deck: BulkDeck, elements: Elements, points: PointElements, equations: Equations
    ) -> None:
        self.deck, self.elements, self.points = deck, elements, points
        self.equations = equations
        self.supports: dict[str, dict[str, Any]] = {}
        self.interfaces: dict[str, dict[str, Any]] = {}
        self.references: dict[int, str] = {}  #: of interfaces, where nothing else is
        self.carried: dict[int, str] = {}  #: further grids of no element, moved by interfaces
        self.grounded: set[int] = set()  #: grids of RBE2 that are held
        self.shared: dict[int, tuple[str, list[int]]] = {}  #: of RBE2 by their reference
        self.loose: set[int] = set()  #: grids whose rotations RBE2 leave free
        held = self._held()
        for number, rigid in sorted(deck.model.rigid_elements.items()):
            self._add(int(number), rigid, held)
        self._join(held)
        self._attach()
        self._write_supports(held)

    def _held(self) -> dict[int, set[int]]:
        """Components, from 1, that are held at grids: by GRID, and by the SPC of the case."""
        held: dict[int, set[int]] = {}
        defaults = self.deck.model.grdset
        common = "" if defaults is None else str(defaults.Ps())
        for label, node in self.deck.model.nodes.items():
            own = {int(c) for c in str(node.ps) or common} - {0}  # 0: none, whatever GRDSET says
            if own:
                held.setdefault(int(label), set()).update(own)
        cards, model = [], self.deck.model
        for number in self.deck.chosen("SPC", [*model.spcs, *model.spcadds]):
            with named(self.deck.path, f"SPC {number} is not there"):
                cards += self.deck.model.get_reduced_spcs(int(number), consider_spcadd=True)
        for card in cards:
            if card.type == "SPC1":
                pairs = [(int(n), str(card.components)) for n in card.node_ids]
            elif card.type == "SPC":
                if any(float(x or 0.0) for x in card.enforced):
                    self.deck.remark(f"SPC {card.conid} moves grids, which are held here")
                pairs = [
                    (int(n), str(c)) for n, c in zip(card.node_ids, card.components, strict=True)
                ]
            else:
                raise BodyError(f"{self.deck.path}: {card.type} is not supported")
            for n, components in pairs:
                if n in self.elements.scalars:
                    entry = {"nodes": [self.elements.scalars[n]], "components": ["x"]}
                    self.supports[f"held_spoint{n}"] = entry
                    continue
                held.setdefault(n, set()).update(int(c) for c in components if c != "0")
        return held

    def _write_supports(self, held: dict[int, set[int]]) -> None:
        alike: dict[tuple[int, ...], list[int]] = {}
        lost: list[int] = []
        for label, components in held.items():
            if label in self.elements.scalars:
                continue
            if label not in self.elements.used:
                lost.append(label)
                continue
            kept = {c for c in components if c < 4 or label in self.elements.turning}
            if not kept:
                continue
            if self.deck.model.nodes[label].Cd() != 0:
                blocks = [kept & {1, 2, 3}, kept & {4, 5, 6}]
                some = [c for block in blocks if len(block) < 3 for c in sorted(block)]
                self.equations.hold(label, some)
                kept -= set(some)
                if not kept:
                    continue
            alike.setdefault(tuple(sorted(kept)), []).append(self.deck.at(label) + 1)
        names = ("x", "y", "z", "rx", "ry", "rz")
        for key, nodes in alike.items():
            entry = {"nodes": nodes, "components": [names[c - 1] for c in key]}
            self.supports["held_" + "".join(map(str, key))] = entry
        if lost:
            said = ", ".join(map(str, sorted(lost)[:5])) + (" …" if len(lost) > 5 else "")
            self.deck.remarks.append(
                f"supports of {len(lost)} grids without elements are left out: {said}"
            )

    def _add(self, number: int, element: Any, held: dict[int, set[int]]) -> None:
        kind = element.type
        if kind in ("RBE2", "RBAR"):
            if kind == "RBE2":
                reference, nodes, coupled = int(element.Gn()), element.Gmi, str(element.cm)
            else:
                reference, nodes, coupled = self._bar(number, element)
            self._move(f"{kind.lower()}_{number}", reference, [int(n) for n in nodes], coupled)
            return
        if kind == "RBE3":
            reference = int(element.ref_grid_id)
            nodes = [int(n) for group in element.Gijs for n in group]
            weights = [
                float(w) for w, g in zip(element.weights, element.Gijs, strict=True) for _ in g
            ]
            averaged = [str(c) for c, g in zip(element.comps, element.Gijs, strict=True) for _ in g]
        else:
            if kind in self.deck.ignore:
                return
            raise self.deck.refuse(kind, number, "only RBE2, RBAR and RBE3 are followed")
        kept = [(n, w) for n, w in zip(nodes, weights, strict=True) if n in self.elements.used]
        if len(kept) < len(nodes):
            raise self.deck.refuse(kind, number, "some of its grids belong to no element")
        if reference in held:
            if held[reference] & {int(c) for c in str(element.refc)}:
                raise self.deck.refuse(kind, number, f"its grid {reference} is held")
            if reference not in self.elements.used:
                self.elements.take_alone([reference])  # held in what the others do not move
        if reference in self.elements.used:
            self.equations.average(number, element, nodes, weights, averaged)
            if reference not in self.elements.alone:
                return
            held_here = {str(c) for c in held.get(reference, ())}
            if set(str(element.refc)) | held_here >= set("123456"):
                self.interfaces[f"rbe3_{number}"] = {
                    "coupling": "node",
                    "nodes": [self.deck.at(reference) + 1],
                }
            else:
                self.deck.remark(
                    f"rbe3_{number} moves its grid {reference} in {element.refc} only: it is no "
                    "interface"
                )
            return
        self.interfaces[f"rbe3_{number}"] = {
            "coupling": "distributing",
            "nodes": [self.deck.at(n) + 1 for n in nodes],
            "position": self.deck.points[self.deck.at(reference)].tolist(),
            "weights": weights,
        }
        self.references[self.deck.at(reference) + 1] = f"rbe3_{number}"

    def _bar(self, number: int, bar: Any) -> tuple[int, list[int], str]:
        """Of a RBAR: the grid that moves, the grid it moves, and in which components."""
        for independent, other, grids, coupled in (
            (bar.cna, bar.cnb, (bar.Ga(), bar.Gb()), bar.cmb),
            (bar.cnb, bar.cna, (bar.Gb(), bar.Ga()), bar.cma),
        ):
            if set(str(independent)) == set("123456") and not str(other).strip("0"):
                return int(grids[0]), [int(grids[1])], str(coupled).strip("0") or "123456"
        raise self.deck.refuse("RBAR", number, "its independent components are not all of one grid")

    def _move(self, name: str, reference: int, nodes: list[int], coupled: str) -> None:
        """A grid moves others as a rigid body."""
        if set(coupled) != set("123456"):
            if not set("123") <= set(coupled) or self.elements.turning & set(nodes):
                self.elements.take_alone({reference, *nodes} - self.elements.used)
                for n in nodes:
                    self.equations.follow(name, n, reference, sorted(map(int, coupled)))
                return
            self.loose.update(nodes)
        self.shared.setdefault(reference, (name, []))[1].extend(nodes)

    def _chained(self) -> dict[int, tuple[str, list[int]]]:
        """RBE2 and RBAR by their reference, each with those whose reference it moves."""
        moved = [n for _, nodes in self.shared.values() for n in nodes if n in self.shared]
        if free := sorted(set(moved) & self.loose):
            raise BodyError(
                f"{self.deck.path}: rotations of grid {free[0]}, which moves others, are left free"
            )
        if len(set(moved)) < len(moved):
            twice = next(n for n in moved if moved.count(n) > 1)
            raise BodyError(f"{self.deck.path}: grid {twice}, which moves others, is moved twice")
        found = {}
        for reference, (name, own) in self.shared.items():
            if reference in moved:
                continue
            nodes = list(own)
            for n in nodes:  # grows on the way
                nodes += self.shared[n][1] if n in self.shared else []
            found[reference] = name, nodes
        met = {n for reference, (_, nodes) in found.items() for n in (reference, *nodes)}
        if lost := sorted(set(self.shared) - met):
            raise BodyError(
                f"{self.deck.path}: grid {lost[0]} moves itself: a loop of rigid elements"
            )
        return found

    def _join(self, held: dict[int, set[int]]) -> None:
        """RBE2 with one reference are one interface; the grids of one that is held are held."""
        for reference, (name, nodes) in self._chained().items():
            where = f"{self.deck.path}: {name.upper().replace('_', ' ')}"
            fixed = sorted(n for n in nodes if n in held)
            bare = [self.deck.at(n) + 1 for n in nodes if n not in self.elements.used]
            nodes = [n for n in dict.fromkeys(nodes) if n in self.elements.used]
            if reference in held and held[reference] >= set(range(1, 7)):
                self.grounded.update(bare)
            if not nodes:
                self.deck.remarks.append(
                    f"{name} is left out: the grids that it moves belong to no element"
                )
                continue
            if reference in held:
                if not held[reference] >= set(range(1, 7)):
                    self._hang(name, reference, nodes, held)
                    continue
                if reference not in self.elements.used:
                    del held[reference]
                    self.grounded.add(self.deck.at(reference) + 1)
                for n in nodes:
                    held.setdefault(n, set()).update(range(1, 7))
                continue
            if fixed:
                raise BodyError(f"{where}: its grid {fixed[0]} is held by an SPC")
            if reference in self.elements.used:
                nodes.append(reference)
            else:
                self.references[self.deck.at(reference) + 1] = name
            self.carried |= dict.fromkeys(bare, name)
            self.interfaces[name] = {
                "coupling": "rigid",
                "nodes": [self.deck.at(n) + 1 for n in nodes],
                "position": self.deck.points[self.deck.at(reference)].tolist(),
            }

    def _hang(self, name: str, reference: int, nodes: list[int], held: dict[int, set[int]]) -> None:
        """Grids follow one that is held in some components, a node of the body."""
        where = f"{self.deck.path}: {name.upper().replace('_', ' ')}"
        if fixed := sorted(n for n in nodes if n in held and n != reference):
            raise BodyError(f"{where}: its grid {fixed[0]} is held by an SPC")
        if reference not in self.elements.used:
            self.elements.take_alone([reference])
        for n in nodes:
            self.equations.follow(name, n, reference, range(1, 7))
        self.deck.remark(f"{name}: its grid {reference} is held in part: it is no interface")

    def _attach(self) -> None:
        """Masses and springs at the grid of an RBE2 are its interface's; others need elements."""
        known = {self.deck.at(label) + 1 for label in self.elements.used}
        behind = len(self.deck.points) + 1  # nodes that are no grids
        known |= set(range(behind, behind + len(self.elements.ends)))
        for entries in (self.points.masses, self.points.springs):
            for name, entry in list(entries.items()):
                for nodes, interface in (("nodes", "at"), ("to_nodes", "to")):
                    given = entry.get(nodes, [])
                    if len(given) == 1 and given[0] in self.grounded:
                        entry.pop(nodes)
                    elif len(given) == 1 and given[0] in self.references:
                        entry[interface] = self.references[entry.pop(nodes)[0]]
                    elif given and entries is self.points.masses and given[0] not in known:
                        label = self.deck.labels[given[0] - 1]
                        self.deck.remark(f"{name} is left out: nothing joins its grid {label}")
                        del entries[name]
                        break
                    elif lost := [n for n in given if n not in known]:
                        raise BodyError(
                            f"{self.deck.path}: {name}: grid {self.deck.labels[lost[0] - 1]} "
                            "belongs to no element, and to no RBE2: springs alone hold none"
                        )
                if name not in entries:
                    continue
                if not {"nodes", "at"} & set(entry):  # it begins at what is held
                    for end, start in (("to_nodes", "nodes"), ("to", "at")):
                        if end in entry:
                            entry[start] = entry.pop(end)
                    if not {"nodes", "at"} & set(entry):
                        del entries[name]
