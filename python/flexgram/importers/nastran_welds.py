"""Spot welds and fasteners of Nastran bulk data, CWELD and CFAST, between two sheets of shells.

Each end of a weld is a node of its own. It moves as four points around it, which lie on the sheet:
with their mean, and turned as their displacements say (least squares, as RBE3). A spring between
both ends is the weld: the stiffness of a CFAST, or of a short beam of the weld's diameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from flexgram.basics import Floats, Ints
from flexgram.body.face_integrals import face_functions
from flexgram.body.ties import cross_matrices, tied
from flexgram.importers.alone import COMPONENTS, Row
from flexgram.importers.nastran_deck import BulkDeck, named
from flexgram.importers.nastran_elements import Elements
from flexgram.importers.nastran_equations import Equations
from flexgram.importers.nastran_points import PointElements

#: Shells that welds join; of second order by their corners.
CORNERS = {"CQUAD4": 4, "CQUADR": 4, "CQUAD8": 4, "CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 3}
#: Faces whose middles are next to a point are looked at.
AROUND = 24
#: Of a weld's length over its diameter.
LEAST, MOST = 0.2, 5.0

#: Of a point on a face: weights of its nodes, and these.
Share = tuple[Floats, Ints]


@dataclass(frozen=True)
class Weld:
    """What a card says.

    Attributes
    ----------
    card, number
        For messages.
    where : (2, 3) array
        Points beside its ends.
    sheets : pair of lists of (k,) int arrays
        Faces of both sheets: indices of their nodes.
    diameter : float
    prop : pyNastran's PFAST, or the fields of a PWELD.
    length : float
        Of a CWELD whose length is not the distance of its ends (SPOT), else 0.
    """

    card: str
    number: int
    where: Floats
    sheets: tuple[list[Ints], list[Ints]]
    diameter: float
    prop: Any
    length: float


class Welds:
    """Nodes, springs, masses and equations of all welds of a deck."""

    def __init__(
        self, deck: BulkDeck, elements: Elements, points: PointElements, equations: Equations
    ) -> None:
        self.deck, self.elements, self.points = deck, elements, points
        self.equations = equations
        self.nodes: list[int] = []  #: from 1
        self._faces: dict[int, list[Ints]] = {}  #: by property
        self._pwelds = {row[1]: row for row in deck.rejected("PWELD")}
        self._at_node: dict[int, dict[int, set[int]]] = {}  #: by property, its faces at a node
        welds = [self._fastener(number, element) for number, element in elements.fasteners]
        cards = deck.rejected("CWELD")
        welds += [self._weld(fields) for fields in cards if fields[4].upper() != "ALIGN"]
        for fields in cards:
            if fields[4].upper() == "ALIGN":
                self._align(fields)
        sides = (0, 1)
        feet = [self._on_sheets([w.sheets[k] for w in welds], [w.where[k : k + 1] for w in welds])
                for k in sides]  # fmt: skip
        found = [[self._foot(*foot[0]) for foot in feet[k]] for k in sides]
        squares = [
            [_square(*foot, weld.diameter) for foot, weld in zip(found[k], welds, strict=True)]
            for k in sides
        ]
        met = [self._on_sheets([w.sheets[k] for w in welds], squares[k]) for k in sides]
        for j, weld in enumerate(welds):
            if set(feet[0][j][0][1].tolist()) == set(feet[1][j][0][1].tolist()):
                raise deck.refuse(weld.card, weld.number, "both its ends are on one element")
            self._add(weld, [found[k][j] for k in sides], [met[k][j] for k in sides])

    def _patch(self, card: str, number: int, eid: int, alone: bool) -> list[Ints]:
        """The face of an element, and those of its property that share a node with it."""
        element = self.deck.model.elements.get(eid)
        if element is None or element.type not in CORNERS:
            raise self.deck.refuse(card, number, f"element {eid} is no shell")
        corners = element.node_ids[: CORNERS[element.type]]
        own = np.array([self.deck.at(int(n)) for n in corners])
        patch = [own]
        if not alone:
            pid = int(element.pid)
            faces = self._sheet(card, number, pid)
            if pid not in self._at_node:
                at_node = self._at_node.setdefault(pid, {})
                for k, face in enumerate(faces):
                    for n in face.tolist():
                        at_node.setdefault(n, set()).add(k)
            near = set().union(*(self._at_node[pid][n] for n in own.tolist()))
            patch = [faces[k] for k in sorted(near)]
        return patch

    def _sheet(self, card: str, number: int, pid: int) -> list[Ints]:
        """Faces of a property."""
        model = self.deck.model
        if pid not in self._faces:
            self._faces[pid] = [
                np.array([self.deck.at(int(n)) for n in e.node_ids[: CORNERS[e.type]]])
                for e in model.elements.values()
                if e.type in CORNERS and int(e.pid) == pid
            ]
        if not self._faces[pid]:
            raise self.deck.refuse(card, number, f"property {pid} has no shells")
        return self._faces[pid]

    def _place(self, card: str, number: int, *grids: Any) -> Floats:
        """Points beside both ends: of GS, or of GA and GB."""
        gs, ga, gb = (int(g) if g else None for g in grids)
        if ga and gb:
            given = [ga, gb]
        elif gs:
            given = [gs, gs]
        else:
            raise self.deck.refuse(card, number, "its place must be given by GS, or by GA and GB")
        return self.deck.points[[self.deck.at(n) for n in given]]

    def _fastener(self, number: int, element: Any) -> Weld:
        prop = self.deck.model.properties.get(element.pid)
        if prop is None or prop.type != "PFAST":
            raise self.deck.refuse("CFAST", number, "needs a PFAST")
        where = self._place("CFAST", number, element.gs, element.ga, element.gb)
        ids = [int(element.ida), int(element.idb)]
        sheets = (
            self._sheets("CFAST", number, ids)
            if element.Type == "PROP"
            else [self._patch("CFAST", number, eid, False) for eid in ids]
        )
        both = (sheets[0], sheets[1])
        return Weld("CFAST", number, where, both, self._size("CFAST", number, prop.d), prop, 0.0)

    def _size(self, card: str, number: int, given: Any) -> float:
        if not float(given or 0.0) > 0:
            raise self.deck.refuse(card, number, "its diameter must be positive")
        return float(given)

    def _sheets(self, card: str, number: int, pids: list[int]) -> list[list[Ints]]:
        if pids[0] == pids[1]:
            raise self.deck.refuse(card, number, "it joins a property with itself: name elements")
        return [self._sheet(card, number, pid) for pid in pids]

    def _thickness(self, number: int, id_: int, by_element: bool) -> float:
        """Of a shell, by its property or its element."""
        model = self.deck.model
        prop = model.properties.get(int(model.elements[id_].pid) if by_element else id_)
        with named(self.deck.path, f"CWELD {number}: the thickness of its shells is not known"):
            return float(prop.Thickness())

    def _weld(self, fields: list[str]) -> Weld:
        number, kind = int(fields[1]), fields[4].upper()
        where = self._place("CWELD", number, fields[3], fields[5], fields[6])
        if kind == "GRIDID":
            faces = [self._of_grids(number, fields, side) for side in (0, 1)]
            prop, diameter = self._pweld(number, fields[2])
            return Weld("CWELD", number, where, ([faces[0]], [faces[1]]), diameter, prop, 0.0)
        if kind not in ("PARTPAT", "ELPAT", "ELEMID"):
            raise self.deck.refuse("CWELD", number, f"{kind or 'its form'} is not supported")
        ids = [int(word) for word in fields[9:11] if word]
        if len(ids) < 2:
            raise self.deck.refuse("CWELD", number, "the parts that it joins are missing")
        sheets = (
            self._sheets("CWELD", number, ids)
            if kind == "PARTPAT"
            else [self._patch("CWELD", number, eid, kind == "ELEMID") for eid in ids]
        )
        prop, diameter = self._pweld(number, fields[2])
        length = 0.0
        if prop[8].upper() == "SPOT":
            length = sum(self._thickness(number, i, kind != "PARTPAT") for i in ids) / 2
        return Weld("CWELD", number, where, (sheets[0], sheets[1]), diameter, prop, length)

    def _pweld(self, number: int, pid: str) -> tuple[list[str], float]:
        """Fields of a PWELD, and its diameter."""
        prop = self._pwelds.get(pid)
        if prop is None:
            raise self.deck.refuse("CWELD", number, f"there is no PWELD {pid}")
        return prop, self._size("CWELD", number, prop[3])

    def _of_grids(self, number: int, fields: list[str], side: int) -> Ints:
        """The face of a CWELD by its grids (GRIDID): SPTYP says of each side whether it has three
        or four corners; those in the middle of edges do not count."""
        kinds = fields[7].upper()
        if len(kinds) < 2 or set(kinds) - {"Q", "T"}:
            raise self.deck.refuse("CWELD", number, f"SPTYP {kinds or '(none)'} is not supported")
        first = 9 + 8 * side
        grids = fields[first : first + (4 if kinds[side] == "Q" else 3)]
        if not grids or not all(grids):
            raise self.deck.refuse("CWELD", number, f"corners of {'AB'[side]} are missing")
        return np.array([self.deck.at(int(n)) for n in grids])

    def _align(self, fields: list[str]) -> None:
        """A CWELD between two grids of the shells themselves (ALIGN)."""
        number = int(fields[1])
        where = self._place("CWELD", number, None, fields[5], fields[6])
        prop, diameter = self._pweld(number, fields[2])
        nodes = [self.deck.at(int(n)) + 1 for n in fields[5:7]]
        weld = Weld("CWELD", number, where, ([], []), diameter, prop, 0.0)
        self._between(weld, where, np.eye(3)[0], nodes)

    def _add(self, weld: Weld, feet: list[tuple[Floats, Floats]], met: list[list[Share]]) -> None:
        """Nodes at both feet (places and normals), and what is between them."""
        ends = []
        for (place, _), around in zip(feet, met, strict=True):
            self.elements.ends.append(place)
            node = len(self.deck.points) + len(self.elements.ends)
            self.nodes.append(node)
            ends.append(node)
            self._follow(weld, node, place, around)
        self._between(weld, np.array([feet[0][0], feet[1][0]]), feet[0][1], ends)

    def _between(self, weld: Weld, places: Floats, normal: Floats, ends: list[int]) -> None:
        """The spring and the mass between two nodes, from 1; ``normal``: where both are in one
        place."""
        diameter = weld.diameter
        line = places[1] - places[0]
        length = float(np.linalg.norm(line))
        x = line / length if length > 1e-6 * diameter else normal
        y = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
        y /= np.linalg.norm(y)
        axes = np.kron(np.eye(2), np.array([x, y, np.cross(x, y)]))
        stiffness, mass, loss = (
            self._beam(weld, diameter, length) if weld.card == "CWELD" else self._springs(weld)
        )
        name = f"{weld.card.lower()}{weld.number}"
        entry: dict[str, Any] = {"nodes": [ends[0]], "to_nodes": [ends[1]]}
        entry["stiffness"] = (axes.T @ np.diag(stiffness) @ axes).tolist()
        entry |= {"loss_factor": loss} if loss else {}
        self.points.springs[name] = entry
        if mass:
            self.points.masses[name] = {"nodes": ends, "mass": mass / 2}

    def _foot(self, weights: Floats, face: Ints) -> tuple[Floats, Floats]:
        """A place on a face, and the normal there."""
        x = self.deck.points[face]
        normal = np.cross(x[2] - x[0], x[-1] - x[1] if len(x) == 4 else x[2] - x[1])
        return weights @ x, normal / np.linalg.norm(normal)

    def _on_sheets(
        self, sheets: Sequence[list[Ints]], places: Sequence[Floats]
    ) -> list[list[Share]]:
        """Of points (k, 3) of each weld what of its sheet is next to each, a sheet at a time."""
        of_sheet: dict[int, list[int]] = {}
        for j, sheet in enumerate(sheets):
            of_sheet.setdefault(id(sheet), []).append(j)
        found: list[list[Share]] = [[] for _ in sheets]
        for mine in of_sheet.values():
            together = np.vstack([places[j] for j in mine])
            shares = iter(self._on_sheet(sheets[mine[0]], together))
            for j in mine:
                found[j] = [next(shares) for _ in places[j]]
        return found

    def _on_sheet(self, sheet: list[Ints], places: Floats) -> list[Share]:
        middles = np.array([self.deck.points[face].mean(axis=0) for face in sheet])
        _, next_ones = cKDTree(middles).query(places, k=min(AROUND, len(sheet)))
        faces = [sheet[k] for k in np.unique(next_ones)]
        nodes = np.unique(np.concatenate(faces))
        points = np.vstack([self.deck.points[nodes], places])
        by_width: dict[int, list[Ints]] = {}
        for face in faces:
            by_width.setdefault(len(face), []).append(np.searchsorted(nodes, face))
        groups = [np.array(some) for some in by_width.values()]
        ties, _ = tied(points, groups, len(nodes) + np.arange(len(places)), np.inf)
        found = []
        for face, xi in zip(ties.faces, ties.xi, strict=True):
            N, _ = face_functions(len(face), xi[None])
            found.append((N[0], nodes[np.asarray(face)]))
        return found

    def _follow(self, weld: Weld, node: int, place: Floats, met: list[Share]) -> None:
        """Equations of an end, which moves as points around it."""
        arms = [weights @ self.deck.points[face] - place for weights, face in met]
        moved = np.vstack([np.hstack([np.eye(3), -a]) for a in cross_matrices(np.array(arms))])
        fit = np.linalg.pinv(moved)  # (6, 12)
        rows: list[Row] = []
        for c in range(6):
            terms: Row = [[node, COMPONENTS[c], 1.0]]
            for k, (weights, face) in enumerate(met):
                for weight, n in zip(weights, face.tolist(), strict=True):
                    terms += [
                        [n + 1, COMPONENTS[a], -float(weight * fit[c, 3 * k + a])]
                        for a in range(3)
                        if abs(weight * fit[c, 3 * k + a]) > 1e-14
                    ]
            rows.append(terms)
        name = f"of_{weld.card.lower()}s"
        self.equations.entries.setdefault(name, {"terms": []})["terms"] += rows

    def _springs(self, weld: Weld) -> tuple[list[float], float, float]:
        """Stiffness along and about the axes of a CFAST, mass and loss factor."""
        prop = weld.prop
        stiffness = [float(getattr(prop, f"k{kind}{k}") or 0.0) for kind in "tr" for k in (1, 2, 3)]
        if stiffness[1] != stiffness[2] or stiffness[4] != stiffness[5]:
            raise self.deck.refuse("PFAST", prop.pid, "KT2 and KT3, or KR2 and KR3, differ")
        along = len(set(stiffness[:3])) == 1 and len(set(stiffness[3:])) == 1
        if getattr(prop, "mflag", 0) == 1 and not along:
            raise self.deck.refuse(
                "PFAST", prop.pid, "axes of a system (MFLAG = 1) are not supported"
            )
        wtmass = self.deck.param("WTMASS") or 1.0
        return stiffness, float(prop.mass or 0.0) * wtmass, float(prop.ge or 0.0)

    def _beam(self, weld: Weld, diameter: float, length: float) -> tuple[list[float], float, float]:
        """The same of a round beam between the ends; unless it is told (SPOT), no shorter than a
        fifth of its diameter and no longer than five (LDMIN, LDMAX)."""
        card = self.deck.model.materials.get(int(weld.prop[2]))
        if card is None or card.type != "MAT1":
            raise self.deck.refuse("PWELD", int(weld.prop[1]), "needs a MAT1")
        E, G = float(card.e), float(card.g)
        least, most = (
            float(word) if word else usual
            for word, usual in zip(weld.prop[9:11], (LEAST, MOST), strict=True)
        )
        L = weld.length or float(np.clip(length, least * diameter, most * diameter))
        A, inertia = np.pi * diameter**2 / 4, np.pi * diameter**4 / 64
        shear = 12 * E * inertia / (0.9 * G * A * L**2)
        across = 12 * E * inertia / L**3 / (1 + shear)
        turn = E * inertia / L
        mass = float(card.rho or 0.0) * A * length * (self.deck.param("WTMASS") or 1.0)
        stiffness = [E * A / L, across, across, 2 * G * inertia / L, turn, turn]
        return [float(k) for k in stiffness], mass, float(card.ge or 0.0)


def _square(place: Floats, normal: Floats, diameter: float) -> Floats:
    """Corners (4, 3) of a square of a weld's area around its foot."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first *= np.sqrt(np.pi) * diameter / 4 / np.linalg.norm(first)
    second = np.cross(normal, first)
    corners: Floats = place + np.array([a * first + b * second for a in (-1, 1) for b in (-1, 1)])
    return corners
