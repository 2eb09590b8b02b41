"""Solids, shells, beams and rods of Nastran bulk data, their materials and sections."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, Floats, counted
from flexgram.body.meshfile import AXES, LABELS, MEMBRANE
from flexgram.body.orientation import with_second
from flexgram.body.reader import Reader
from flexgram.body.sections import section_properties
from flexgram.importers.nastran import REORDER, SOLIDS
from flexgram.importers.nastran_deck import BEAMS, RODS, SHELLS, SPRINGS, WEDGE, BulkDeck, named
from flexgram.importers.nastran_materials import Materials, beam_ratio, own_shear
from flexgram.importers.nastran_sections import along as at_place
from flexgram.importers.nastran_sections import beam_section, rod_section, sheared, tapers

#: Of one section each, a beam that tapers is made of.
PIECES = 8


@dataclass(frozen=True)
class Arm:
    """The end of a beam, a node of its own.

    Attributes
    ----------
    grid : int
        That it follows.
    end : int
        Index of the node.
    axes : (3, 3) array
        Of the beam, in rows.
    pins : set of int
        Components, from 1 and along these axes, in which it does not follow.
    """

    grid: int
    end: int
    axes: Floats
    pins: frozenset[int]


class Elements:
    """Entries of a description for the elements of a deck."""

    def __init__(self, deck: BulkDeck) -> None:
        self.deck = deck
        self.directions: dict[tuple[float, ...], int] = {}  #: of sections
        self.fibres: dict[int, Floats] = {}  #: first axis of the material in elements
        self.materials = Materials(deck)
        self.sections: dict[str, dict[str, Any]] = {}
        self.regions: dict[str, dict[str, Any]] = {}
        self.groups: dict[tuple[str, str], tuple[list[list[int]], list[int]]] = {}
        self.later: list[tuple[int, Any]] = []  #: springs, and rods that resist twist
        self.fasteners: list[tuple[int, Any]] = []
        self.beams: dict[int, tuple[Floats, list[int]]] = {}  #: axes in rows, nodes along it
        self.arms: list[Arm] = []  #: of beams beside their grids, or with pins
        self.at_offsets: dict[tuple[int, bytes], int] = {}  #: those without pins
        self.ends: list[Floats] = []  #: new nodes, behind the grids
        self.used: set[int] = set()  #: grids of elements
        self.turning: set[int] = set()  #: those of shells and beams, and those alone
        self.alone: set[int] = set()  #: grids of no element, which something else joins
        self.scalars: dict[int, int] = {}  #: scalar points: their nodes, from 1

    def take_alone(self, grids: Iterable[int]) -> None:
        """Grids that no element has are nodes with six dofs too."""
        self.alone.update(grids)
        self.used |= self.alone
        self.turning |= self.alone

    def take_scalars(self) -> None:
        """Scalar points are the x of a node each."""
        for label in sorted(map(int, self.deck.model.spoints)):
            self.ends.append(self.deck.points.mean(axis=0))
            self.scalars[label] = len(self.deck.points) + len(self.ends)

    def point(self, index: int) -> Floats:
        """Where a node is, a grid or the end of a beam."""
        count = len(self.deck.points)
        place: Floats = self.deck.points[index] if index < count else self.ends[index - count]
        return place

    def places(self) -> Floats:
        """Of all nodes: grids, and those behind them."""
        return np.vstack([self.deck.points, *(end[None, :] for end in self.ends)])

    def mesh(self) -> meshio.Mesh:
        keys = list(self.groups)
        none = np.empty(0, dtype=np.int64)
        return meshio.Mesh(
            self.places(),
            [(kind, np.array(self.groups[region, kind][0])) for region, kind in keys],
            cell_sets={
                region: [
                    np.arange(len(self.groups[key][0])) if key[0] == region else none
                    for key in keys
                ]
                for region in dict.fromkeys(region for region, _ in keys)
            },
            cell_data={LABELS: [np.array(self.groups[key][1]) for key in keys]} | self._axes(),
        )

    def repeats(self) -> bool:
        """Whether elements have the same grids, which is said."""
        seen: dict[tuple[int, ...], int] = {}
        pairs = []
        for cells, labels in self.groups.values():
            for cell, label in zip(cells, labels, strict=True):
                first = seen.setdefault(tuple(sorted(cell)), label)
                pairs += [(first, label)] if first != label else []
        if pairs:
            a, b = pairs[0]
            self.deck.remark(
                f"{counted(len(pairs), 'element')} with the same grids as others (first {a} and "
                f"{b}): all count, as in Nastran"
            )
        return bool(pairs)

    def _axes(self) -> dict[str, list[Floats]]:
        """Cell data ``AXES``, of elements with fibres."""
        if not self.fibres:
            return {}
        axes = []
        for _, labels in self.groups.values():
            axes.append(np.full((len(labels), 6), np.nan))
            some = [k for k, label in enumerate(labels) if label in self.fibres]
            if some:
                first = np.array([self.fibres[labels[k]] for k in some])
                axes[-1][some] = with_second(first)
        return {AXES: axes}

    def add(self, number: int, element: Any) -> None:
        kind = element.type
        if kind == "CFAST":
            return self.fasteners.append((number, element))
        nodes = [int(n) for n in element.node_ids if n]
        full = f"{kind}{len(nodes)}"
        ours = {**SOLIDS, **WEDGE}.get(full)
        if ours is not None:
            region = self._solid(number, element)
        elif kind in SHELLS:
            ours, region = SHELLS[kind], self._shell(number, element)
            if "formulation" not in self.regions[region]:  # a membrane
                self.turning.update(nodes)
        elif kind in BEAMS:
            self._beam(number, element)
            return None
        elif kind in RODS:
            ours, region = "line", self._rod(number, element)
        elif kind in SPRINGS or kind == "CSHEAR":  # whose nodes are to be known first
            return self.later.append((number, element))
        elif kind in self.deck.ignore:
            return
        else:
            raise self.deck.refuse(kind, number, f"with {len(nodes)} grids is not known")
        self.used.update(nodes)
        order = REORDER.get(ours, range({"quad8": 8, "triangle6": 6}.get(ours, len(nodes))))
        cells, labels = self.groups.setdefault((region, ours), ([], []))
        if len(nodes) < len(order):
            raise self.deck.refuse(kind, number, "lacks grids between its corners")
        cells.append([self.deck.at(nodes[k]) for k in order])
        labels.append(number)

    def _region(self, name: str, material: str, section: str = "") -> str:
        self.regions[name] = {"material": material} if material else {}
        if section:
            self.regions[name]["section"] = section
        return name

    def _solid(self, number: int, element: Any) -> str:
        prop = element.pid_ref
        if prop is None or prop.type != "PSOLID":
            raise self.deck.refuse(element.type, number, "needs a PSOLID")
        if prop.mid_ref is not None and prop.mid_ref.type == "MAT9":
            return self._region(f"p{prop.pid}", self.materials.of_solid(prop))
        if prop.mid_ref is not None and prop.mid_ref.type != "MAT1":
            raise self.deck.refuse("PSOLID", prop.pid, f"{prop.mid_ref.type} is not supported")
        return self._region(f"p{prop.pid}", self.materials.of(prop.pid, prop.mid_ref))

    def _shell(self, number: int, element: Any) -> str:
        prop = element.pid_ref
        corners, stretches = 3 if element.type.startswith("CTRI") else 4, False
        given = [getattr(element, f"T{k}", None) for k in range(1, corners + 1)]
        offset = float(element.zoffset or 0.0)
        if prop is not None and prop.type == "PSHELL":
            t = self._thickness(element, prop, given)
            nsm = float(prop.nsm or 0.0)
            material = self.materials.of(prop.pid, prop.mid1_ref, nsm / t)
            section: dict[str, Any] = {"shape": "shell", "thickness": t, "offset": offset}
            stretches = prop.mid1_ref is not None and prop.mid2 in (None, 0)  # alone
            section |= {} if stretches else self._apart(prop, t)
            has_fibres = any(
                card is not None and card.type in ("MAT2", "MAT8")
                for card in (prop.mid1_ref, prop.mid2_ref, prop.mid3_ref)
            )
            own = any(x is not None for x in given)
            name = f"p{prop.pid}" + (f"_t{t:.9g}" if own else "")
        elif prop is not None and prop.type in ("PCOMP", "PCOMPG"):
            material = ""
            has_fibres = any(m.type in ("MAT2", "MAT8") for m in prop.mids_ref)
            if prop.lam not in (None, "", "NO", "SYM"):
                raise self.deck.refuse("PCOMP", prop.pid, f"LAM = {prop.lam} is not supported")
            loss = float(prop.ge or 0.0)  # those of its plies do not count
            plies = list(zip(prop.mids_ref, prop.thicknesses, prop.thetas, strict=True))
            if prop.lam == "SYM":
                plies += plies[::-1]
            whole = sum(float(t) for _, t, _ in plies)
            nsm = float(prop.nsm or 0.0)
            offset += float(prop.z0 or 0.0) + whole / 2
            offset = 0.0 if abs(offset) < 1e-9 * whole else offset
            layers = [
                {
                    "material": self.materials.of(
                        prop.pid, m, nsm / whole, loss, reference=float(prop.tref or 0.0)
                    ),
                    "thickness": float(t),
                    "angle": float(a),
                }
                for m, t, a in plies
            ]
            section = {"shape": "shell", "layers": layers, "offset": offset}
            name = f"p{prop.pid}"
        else:
            what = "none" if prop is None else prop.type
            raise self.deck.refuse(
                element.type, number, f"needs a PSHELL or a PCOMP, it has {what}"
            )
        name += f"_z{offset:.9g}" if offset else ""
        name += "_m" if stretches else ""
        if has_fibres:
            self.fibres[number] = self._fibres(number, element)
            name += "_f"
        self.sections[name] = section
        self._region(name, material, name)
        if stretches:
            self.regions[name]["formulation"] = MEMBRANE
            self.deck.remark("a PSHELL with MID2 blank or -1 is a membrane, under plane stress")
        return name

    def _direction(self, axis: Floats) -> int:
        """The number of a direction, from 1."""
        return self.directions.setdefault(tuple(axis.tolist()), len(self.directions) + 1)

    def _fibres(self, number: int, element: Any) -> Floats:
        """First axis of an element's material: by THETA from the side from its first grid to the
        second, or the x axis of a system (MCID), which the shell projects onto itself."""
        given, x = element.theta_mcid, np.array([1.0, 0.0, 0.0])
        if isinstance(given, int):
            system = element.theta_mcid_ref
            if given and system is None:
                raise self.deck.refuse(element.type, number, f"there is no system {given} (MCID)")
            if given and system.type not in ("CORD2R", "CORD1R"):
                raise self.deck.refuse(element.type, number, "its axes (MCID) are cylindrical")
            x = system.beta()[0] if given else x
        else:
            p = self.deck.points[[self.deck.at(int(n)) for n in element.node_ids[:4] if n]]
            normal = np.cross(p[2] - p[0], p[-1] - p[1] if len(p) == 4 else p[2] - p[1])
            normal /= max(float(np.linalg.norm(normal)), 1e-300)
            side = p[1] - p[0] - normal * (normal @ (p[1] - p[0]))
            side /= max(float(np.linalg.norm(side)), 1e-300)
            angle = np.radians(float(given or 0.0))
            x = np.cos(angle) * side + np.sin(angle) * np.cross(normal, side)
        axis: Floats = np.asarray(x, dtype=float)
        return axis

    def _beam(self, number: int, element: Any) -> None:
        prop, kind = element.pid_ref, element.type
        grids = [int(n) for n in element.node_ids[:2]]
        offsets = [np.asarray(w, dtype=float) for w in (element.wa, element.wb)]
        frames = str(element.offt)[1:3] if isinstance(element.offt, str) else "GG"
        for k, grid in enumerate(grids):
            if offsets[k].any() and frames[k : k + 1] == "O":
                raise self.deck.refuse(kind, number, f"OFFT = {element.offt} is not supported")
            offsets[k] = offsets[k] @ self.deck.axes(grid)
        ends = [self.deck.points[self.deck.at(n)] + w for n, w in zip(grids, offsets, strict=True)]
        if element.g0:
            v = self.deck.points[self.deck.at(int(element.g0))] - (ends[0] - offsets[0])
        else:
            v = np.asarray(element.x, dtype=float)
            if str(element.offt)[:1] == "G" and v.shape == (3,):
                v = v @ self.deck.axes(grids[0])
        along = ends[1] - ends[0]
        if not np.linalg.norm(along) > 0:
            raise self.deck.refuse(kind, number, "it has no length")
        along = along / np.linalg.norm(along)
        v = np.asarray(v, dtype=float)
        if v.shape != (3,) or not np.all(np.isfinite(v)):
            raise self.deck.refuse(kind, number, "it has no orientation vector")
        v = v - along * (v @ along)
        if not np.linalg.norm(v) > 0:
            raise self.deck.refuse(kind, number, "its orientation vector is along it")
        v = np.round(v / np.linalg.norm(v), 9) + 0.0
        if prop is None:
            raise self.deck.refuse(kind, number, "its property is missing")
        if prop.type == "PBEAML" and tapers(prop):
            self.deck.remark("a PBEAML that tapers does so by its dimensions, not by A and I")
        axes = np.array([along, v, np.cross(along, v)])
        nodes = [
            self._end(grid, offset, axes, str(pins or ""))
            for grid, offset, pins in zip(grids, offsets, (element.pa, element.pb), strict=True)
        ]
        count = PIECES if tapers(prop) else 1
        inner = [len(self.deck.points) + len(self.ends) + k for k in range(count - 1)]
        self.ends += [ends[0] + (ends[1] - ends[0]) * k / count for k in range(1, count)]
        nodes[1:1] = inner
        self.beams[number] = axes, nodes
        for k in range(count):
            region = self._piece(element, along, v, (k + 0.5) / count if count > 1 else 0.0)
            cells, labels = self.groups.setdefault((region, "line"), ([], []))
            cells.append(nodes[k : k + 2])
            labels.append(number)

    def _piece(self, element: Any, along: Floats, v: Floats, place: float) -> str:
        """Region of a beam, or of a piece of one that tapers, whose middle is at a place from 0 to
        1; ``v``: its y axis."""
        prop = element.pid_ref
        try:
            section = beam_section(prop, place)
        except BodyError as error:
            raise self.deck.refuse(prop.type, prop.pid, str(error)) from None
        y = v
        if turn := section.pop("turn", 0.0):
            y = np.cos(turn) * v + np.sin(turn) * np.cross(along, v)
        if prop.mid_ref is not None and prop.mid_ref.type == "MAT1" and prop.mid_ref.e:
            section = sheared(section, beam_ratio(prop.mid_ref)[1])
        name = f"p{prop.pid}_d{self._direction(y)}" + (f"_at{place:g}" if place else "")
        self.sections[name] = section | {"y_axis": y.tolist()}
        with named(self.deck.path, f"{prop.type} {prop.pid}: its area is not understood"):
            A, nsm = self._area(prop, section, place)
        structural = A * float(getattr(prop.mid_ref, "rho", None) or 0.0)
        is_beam = element.type == "CBEAM"
        turns = structural / (structural + nsm) if is_beam and structural else 0.0
        # None of the mass beside its material's, and none of a CBAR's, with coupled mass too.
        self.sections[name] |= {"torsional_inertia": turns, "rotary_inertia": turns}
        material = self.materials.of(prop.pid, prop.mid_ref, nsm / A, beam=True)
        return self._region(name, material, name)

    def _area(self, prop: Any, section: dict[str, Any], place: float) -> tuple[float, float]:
        """Area, and mass by length beside that of the material."""
        if not place:
            return float(np.ravel(prop.Area())[0]), float(np.ravel(prop.Nsm() or 0.0)[0])
        A = section_properties(Reader(section, "section"), 1.0)["A"]
        return A, float(at_place(prop, np.ravel(prop.nsm), place))

    def _end(self, grid: int, offset: Floats, axes: Floats, pins: str) -> int:
        """Index of a beam's end: its grid, or a node of its own."""
        freed = frozenset(int(c) for c in pins if c in "123456")
        if not offset.any() and not freed:
            self.used.add(grid)
            self.turning.add(grid)
            return self.deck.at(grid)
        known = (grid, offset.tobytes())
        if not freed and known in self.at_offsets:
            return self.at_offsets[known]
        end = len(self.deck.points) + len(self.ends)
        self.ends.append(self.deck.points[self.deck.at(grid)] + offset)
        self.arms.append(Arm(grid, end, axes if freed else np.eye(3), freed))
        if not freed:
            self.at_offsets[known] = end
        return end

    def _thickness(self, element: Any, prop: Any, given: list[Any]) -> float:
        """Of an element with PSHELL: the mean of its corners, where these have their own."""
        usual = float(prop.t or 0.0)
        scale = usual if element.tflag == 1 else 1.0
        corners = [usual if x is None else float(x) * scale for x in given]
        if max(corners) - min(corners) > 1e-6 * max(corners):
            self.deck.remark("elements whose corners have different thicknesses take their mean")
        t = float(np.mean(corners))
        if not t > 0:
            raise self.deck.refuse("PSHELL", prop.pid, "has no thickness")
        return t

    def _apart(self, prop: Any, t: float) -> dict[str, Any]:
        """Bending and shear of a PSHELL, where these are not those of its thickness and MID1, and
        the heights at which Nastran gives its stress."""
        if not prop.mid1_ref or prop.mid2 in (None, 0, -1):
            raise self.deck.refuse("PSHELL", prop.pid, "MID1 or MID2 is blank: no plate")
        if prop.mid4:
            raise self.deck.refuse("PSHELL", prop.pid, "MID4 is not supported")
        bending = 1.0 if prop.twelveIt3 is None else float(prop.twelveIt3)
        shear = 5 / 6
        if prop.mid3:
            if prop.mid3 != prop.mid1 and prop.mid3_ref.type == "MAT2":
                raise self.deck.refuse("PSHELL", prop.pid, "MAT2 as MID3 is not supported")
            shear = 5 / 6 if prop.tst is None else float(prop.tst)
            if prop.mid3 == prop.mid1:
                shear *= own_shear(prop.mid3_ref) or 1.0
        else:
            self.deck.remark(
                "shells without MID3 are stiff in transverse shear in Nastran, here not"
            )
        plain = prop.mid2 == prop.mid1 and prop.mid3 in (None, 0, prop.mid1)
        if plain and abs(bending - 1) < 1e-6 and abs(shear * 6 / 5 - 1) < 1e-3:
            if not np.allclose(self._sides(prop, t), [-t / 2, t / 2]):
                self.deck.remark("Z1 and Z2 of a PSHELL of one layer: its stress is on its sides")
            return {}
        found: dict[str, Any] = {
            "bending": {"factor": bending},
            "shear": {"factor": shear},
            "sides": self._sides(prop, t),
        }
        materials = (
            ("bending", prop.mid2, prop.mid2_ref),
            ("shear", prop.mid3 or prop.mid2, prop.mid3_ref if prop.mid3 else prop.mid2_ref),
        )
        for key, mid, card in materials:
            if mid != prop.mid1:
                of_shear = key == "shear" and card is not None and card.type == "MAT1"
                found[key]["material"] = (
                    self.materials.of_shear(card) if of_shear else self.materials.of(prop.pid, card)
                )
        return found

    def _sides(self, prop: Any, t: float) -> list[float]:
        """Heights of a PSHELL's stress: Z1 and Z2, or half of the element's thickness."""
        usual = float(prop.t or 0.0) / 2  # which pyNastran puts in their place
        heights = [prop.z1, prop.z2]
        given = [z is not None and abs(abs(float(z)) - usual) > 1e-9 * usual for z in heights]
        return sorted(
            float(z) if own else sign * t / 2
            for z, own, sign in zip(heights, given, (-1, 1), strict=True)
        )

    def _rod(self, number: int, element: Any) -> str:
        prop = self.deck.property_of(number, element)
        try:
            A, J = rod_section(prop)
        except BodyError as error:
            raise self.deck.refuse(prop.type, prop.pid, str(error)) from None
        if not A > 0:
            raise self.deck.refuse(element.type, number, "its area must be positive")
        if J > 0:  # felt where both ends have rotations, which all elements tell
            self.later.append((number, element))
        more = float(prop.nsm or 0.0) / A
        material = self.materials.of(prop.mid, prop.mid_ref, more, beam=True)  # E and G
        name = f"rod_{A:.9g}_{material}"
        self.sections[name] = {"shape": "rod", "A": A}
        return self._region(name, material, name)
