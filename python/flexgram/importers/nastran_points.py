"""Point masses, springs and dampers of Nastran bulk data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexgram.basics import Floats
from flexgram.importers.nastran_deck import RODS, BulkDeck
from flexgram.importers.nastran_elements import Elements
from flexgram.importers.nastran_equations import Equations
from flexgram.importers.nastran_scalars import Scalars
from flexgram.importers.nastran_sections import rod_section


def _losses(given: Sequence[Any]) -> list[float]:
    """Loss factors of the six directions of a PBUSH: GE1 alone is that of all."""
    losses = [float(x or 0.0) for x in [*given, *6 * [0.0]][:6]]
    return 6 * losses[:1] if losses[0] and not any(losses[1:]) else losses


class PointElements:
    """Entries of ``masses`` and ``springs`` of a description."""

    def __init__(self, deck: BulkDeck, elements: Elements, equations: Equations) -> None:
        self.deck, self.elements = deck, elements
        self.masses: dict[str, dict[str, Any]] = {}
        self.springs: dict[str, dict[str, Any]] = {}
        self.scalars = Scalars(deck, elements, equations, self.springs, self.masses)

    def add_spring(self, number: int, element: Any) -> None:
        if element.type in RODS:
            self._torsion(number, element)
        elif element.type == "CSHEAR":
            self.scalars.panel(number, element)
        elif element.type == "CBUSH":
            self._bush(number, element)
        else:
            self._scalar_spring(number, element)

    def _torsion(self, number: int, element: Any) -> None:
        """Of a rod, as a spring."""
        prop = self.deck.property_of(number, element)
        nodes = [int(n) for n in element.node_ids]
        if not set(nodes) <= self.elements.turning:
            return
        ends = self.deck.points[[self.deck.at(n) for n in nodes]]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        along = (ends[1] - ends[0]) / length
        twist = float(prop.mid_ref.g) * rod_section(prop)[1] / length
        K = np.kron(np.diag([0.0, twist]), np.outer(along, along))
        entry = {"nodes": [self.deck.at(nodes[0]) + 1], "to_nodes": [self.deck.at(nodes[1]) + 1]}
        self.springs[f"rod{number}"] = entry | {"stiffness": K.tolist()}

    def _scalar_spring(self, number: int, element: Any) -> None:
        """CELAS and CDAMP, with numbers of their own (2, 4) or of a property (1, 3)."""
        source = self.deck.property_of(number, element)
        is_damper = element.type.startswith("CDAMP")
        ends = self._ends(number, element)
        if not ends:
            return
        if self.scalars.are_needed(ends):
            terms, place = self.scalars.between(ends)
            size = float(source.b if is_damper else source.k)
            self.scalars.add(
                f"{element.type.lower()}{number}",
                terms,
                place,
                stiffness=0.0 if is_damper else size,
                damping=size if is_damper else 0.0,
                loss=0.0 if is_damper else float(getattr(source, "ge", 0.0) or 0.0),
            )
            return
        axes = np.kron(np.eye(2), self.deck.common_axes(element.type, number, [n for n, _ in ends]))
        c = ends[0][1] - 1
        of_motion = np.zeros((6, 6))
        of_motion[c, c] = float(source.b if is_damper else source.k)
        of_motion = axes.T @ of_motion @ axes
        labels = [n for n, _ in ends]
        if is_damper:
            self._spring(element.type, number, labels, np.zeros((6, 6)), 0.0, of_motion)
        else:
            loss = float(getattr(source, "ge", 0.0) or 0.0)
            self._spring(element.type, number, labels, of_motion, loss)

    def _bush(self, number: int, element: Any) -> None:
        prop = self.deck.property_of(number, element)
        nodes = [int(n) for n in element.node_ids if n]
        if prop.type != "PBUSH":
            raise self.deck.refuse("CBUSH", number, "only PBUSH is followed")
        if element.ocid not in (-1, None) or getattr(prop, "mass", None):
            raise self.deck.refuse("CBUSH", number, "OCID and M are not supported")
        if len(nodes) == 2 and element.s not in (None, 0.5):
            a, b = (self.deck.at(n) for n in nodes)
            if np.any(self.deck.points[a] != self.deck.points[b]):
                raise self.deck.refuse("CBUSH", number, "S other than 0.5 is not supported")
        K = [float(x or 0.0) for x in (list(prop.Ki) + 6 * [0.0])[:6]]
        B = [float(x or 0.0) for x in (list(prop.Bi) + 6 * [0.0])[:6]]
        both = np.kron(np.eye(2), self._axes_of_bush(number, element, nodes, any([*K[1:], *B[1:]])))
        losses = _losses(getattr(prop, "GEi", None) or [])
        still = (set(nodes) & self.elements.used) - self.elements.turning  # nodes of solids
        if len(nodes) == 2 and still and set(nodes) <= self.elements.used:
            self.scalars.bush(number, nodes, both[:3, :3], {"K": K, "B": B, "losses": losses})
            return
        for loss in sorted({x for x, k in zip(losses, K, strict=True) if k} or {0.0}):
            some = [k if x == loss else 0.0 for x, k in zip(losses, K, strict=True)]
            of_motion = [both.T @ np.diag(x) @ both for x in (some, B)]
            self._spring("CBUSH", number, nodes, of_motion[0], loss, of_motion[1])
            B = 6 * [0.0]  # once

    def _axes_of_bush(self, number: int, element: Any, nodes: list[int], across: bool) -> Floats:
        """In rows: of a system (CID), or the line between its grids, with a vector or a grid for
        the second; ``across``: whether more than the first one matters."""
        if element.cid_ref is not None:
            if element.cid_ref.type not in ("CORD2R", "CORD1R"):
                raise self.deck.refuse("CBUSH", number, "its axes (CID) are cylindrical")
            axes: Floats = np.asarray(element.cid_ref.beta(), dtype=float)
            return axes
        ends = self.deck.points[[self.deck.at(n) for n in nodes]]
        line = ends[-1] - ends[0]
        given = element.x[0] is not None or bool(element.g0)
        if not np.linalg.norm(line) > 0:
            if given:
                raise self.deck.refuse(
                    "CBUSH", number, "its grids lie in one place: axes by a vector need a line"
                )
            return np.eye(3)
        x = line / np.linalg.norm(line)
        if element.g0:
            v = self.deck.points[self.deck.at(int(element.g0))] - ends[0]
        elif given:
            v = np.asarray(element.x, dtype=float) @ self.deck.axes(nodes[0])
        elif across:
            raise self.deck.refuse("CBUSH", number, "across its line its axes are not known")
        else:
            v = np.eye(3)[int(np.argmin(np.abs(x)))]
        z = np.cross(x, v)
        if not np.linalg.norm(z) > 1e-9 * np.linalg.norm(v):
            raise self.deck.refuse("CBUSH", number, "its orientation vector is along it")
        z /= np.linalg.norm(z)
        return np.array([x, np.cross(z, x), z])

    def _spring(
        self,
        card: str,
        number: int,
        nodes: Sequence[int],
        K: Floats,
        loss: float,
        B: Floats | None = None,
    ) -> None:
        """Between two grids, or to ground."""
        if not (np.any(K) or (B is not None and np.any(B))):
            return
        entry: dict[str, Any] = {"nodes": [self.deck.at(nodes[0]) + 1]}
        if len(nodes) == 2:
            entry["to_nodes"] = [self.deck.at(nodes[1]) + 1]
        if np.any(K):
            entry["stiffness"] = K.tolist()
        if B is not None and np.any(B):
            entry["damping"] = B.tolist()
        if loss:
            entry["loss_factor"] = loss
        name = f"{card.lower()}{number}"
        self.springs[f"{name}_{loss:g}" if name in self.springs else name] = entry

    def _ends(self, number: int, element: Any) -> list[tuple[int, int]]:
        """Grids and their components, scalar points and 0."""
        nodes = element.nodes if hasattr(element, "nodes") else element.node_ids
        components = (getattr(element, "c1", 0), getattr(element, "c2", 0))
        ends = [(int(n), int(c or 0)) for n, c in zip(nodes, components, strict=False) if n]
        for label, c in ends:
            if label not in self.elements.scalars and not c:
                raise self.deck.refuse(
                    element.type, number, f"no component (C1 or C2) for grid {label}"
                )
        still = self.elements.used - self.elements.turning  # rotations that AUTOSPC holds
        return [(label, c) for label, c in ends if c < 4 or label not in still]

    def add_mass(self, number: int, mass: Any) -> None:
        if mass.type != "CONM2":
            if mass.type not in self.deck.ignore:
                self._add_matrix(number, mass)
            return
        axes, beside = np.eye(3), np.asarray(mass.X, dtype=float)
        if mass.Cid() == -1:  # its place
            beside = beside - self.deck.points[self.deck.at(int(mass.nid))]
        elif mass.Cid() != 0:
            if mass.cid_ref.type not in ("CORD2R", "CORD1R"):
                raise self.deck.refuse("CONM2", number, "its axes (CID) are cylindrical")
            axes = np.asarray(mass.cid_ref.beta(), dtype=float)  # a row each
            beside = beside @ axes
        wtmass = self.deck.param("WTMASS") or 1.0
        xx, yx, yy, zx, zy, zz = (float(x or 0.0) * wtmass for x in mass.I)
        entry: dict[str, Any] = {
            "nodes": [self.deck.at(int(mass.nid)) + 1],
            "mass": float(mass.mass) * wtmass,
        }
        if any((xx, yx, yy, zx, zy, zz)):
            J = np.array([[xx, -yx, -zx], [-yx, yy, -zy], [-zx, -zy, zz]])  # Nastran's I21 is ∫xy
            J = axes.T @ J @ axes
            tensor = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[1, 2], J[2, 0]]
            entry["inertia"] = [float(x) for x in tensor]
        if entry["mass"] > 0 and np.any(np.abs(beside) > 1e-12 * np.abs(self.deck.points).max()):
            entry["offset"] = beside.tolist()
        if entry["mass"] > 0 or "inertia" in entry:
            self.masses[f"conm{number}"] = entry

    def _add_matrix(self, number: int, mass: Any) -> None:
        """CONM1, and CMASS1 and CMASS2 of one grid: masses by their matrix."""
        M, wtmass = np.zeros((6, 6)), self.deck.param("WTMASS") or 1.0
        if mass.type == "CONM1":
            label = int(mass.nid)
            lower = np.tril(np.asarray(mass.mass_matrix, dtype=float))
            M = lower + np.tril(lower, -1).T
            if mass.Cid() == 0:
                axes = np.eye(3)
            elif mass.cid_ref.type in ("CORD2R", "CORD1R"):
                axes = np.asarray(mass.cid_ref.beta(), dtype=float)
            else:
                raise self.deck.refuse("CONM1", number, "its axes (CID) are cylindrical")
        elif mass.type in ("CMASS1", "CMASS2", "CMASS3", "CMASS4"):
            ends = self._ends(number, mass)
            if len(ends) != 1 or ends[0][0] in self.elements.scalars:
                terms, place = self.scalars.between(ends)
                name = f"{mass.type.lower()}{number}"
                self.scalars.add(name, terms, place, mass=wtmass * float(mass.Mass()))
                return
            label, component = ends[0]
            M[component - 1, component - 1] = float(mass.Mass())
            axes = self.deck.axes(label)
        else:
            raise self.deck.refuse(mass.type, number, "it is not supported")
        both = np.kron(np.eye(2), axes)
        M = wtmass * both.T @ M @ both
        if np.any(M):
            entry = {"nodes": [self.deck.at(label) + 1], "matrix": M.tolist()}
            self.masses[f"{mass.type.lower()}{number}"] = entry
