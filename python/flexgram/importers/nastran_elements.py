"""Solids, shells, beams and rods of Nastran bulk data, their materials and sections."""

from __future__ import annotations

from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.meshfile import LABELS
from flexgram.importers.nastran import REORDER, SOLIDS
from flexgram.importers.nastran_deck import BEAMS, RODS, SHELLS, SPRINGS, WEDGE, BulkDeck, named
from flexgram.importers.nastran_sections import beam_section, rod_section


class Elements:
    """Entries of a description for the elements of a deck."""

    def __init__(self, deck: BulkDeck) -> None:
        self.deck = deck
        self.directions: dict[tuple[float, ...], int] = {}  #: of fibres and sections
        self.materials: dict[str, dict[str, Any]] = {}
        self.sections: dict[str, dict[str, Any]] = {}
        self.regions: dict[str, dict[str, Any]] = {}
        self.groups: dict[tuple[str, str], tuple[list[list[int]], list[int]]] = {}
        self.later: list[tuple[int, Any]] = []  #: springs, and rods that resist twist
        self.used: set[int] = set()  #: grids of elements
        self.turning: set[int] = set()  #: those of shells and beams

    def mesh(self) -> meshio.Mesh:
        keys = list(self.groups)
        none = np.empty(0, dtype=np.int64)
        return meshio.Mesh(
            self.deck.points,
            [(kind, np.array(self.groups[region, kind][0])) for region, kind in keys],
            cell_sets={
                region: [
                    np.arange(len(self.groups[key][0])) if key[0] == region else none
                    for key in keys
                ]
                for region in dict.fromkeys(region for region, _ in keys)
            },
            cell_data={LABELS: [np.array(self.groups[key][1]) for key in keys]},
        )

    def add(self, number: int, element: Any) -> None:
        kind = element.type
        nodes = [int(n) for n in element.node_ids if n]
        full = f"{kind}{len(nodes)}"
        ours = {**SOLIDS, **WEDGE}.get(full)
        if ours is not None:
            region = self._solid(number, element)
        elif kind in SHELLS:
            ours, region = SHELLS[kind], self._shell(number, element)
            self.turning.update(nodes)
        elif kind in BEAMS:
            ours, region, nodes = "line", self._beam(number, element), nodes[:2]
            self.turning.update(nodes)
        elif kind in RODS:
            ours, region = "line", self._rod(number, element)
        elif kind in SPRINGS:  # whose nodes are to be known first
            return self.later.append((number, element))
        elif kind in self.deck.ignore:
            return
        else:
            raise self.deck.refuse(kind, number, f"with {len(nodes)} grids is not known")
        self.used.update(nodes)
        order = REORDER.get(ours, range(len(nodes)))
        cells, labels = self.groups.setdefault((region, ours), ([], []))
        cells.append([self.deck.at(nodes[k]) for k in order])
        labels.append(number)

    def _material(
        self, number: int, card: Any, more: float = 0.0, loss: float | None = None
    ) -> str:
        """Name of a material, with ``more`` density, and another loss factor."""
        if card is None:
            raise BodyError(f"{self.deck.path}: property {number}: its material is missing")
        name = f"mat{card.mid}" + (f"_{more:.9g}" if more else "")
        name += "" if loss is None else f"_g{loss:.9g}"
        if name in self.materials:
            return name
        wtmass = self.deck.param("WTMASS") or 1.0
        rho = (float(card.rho or 0.0) + more) * wtmass
        if card.type == "MAT1":
            E, G, nu = card.e, card.g, card.nu
            if E and G and abs(E / (2 * G) - 1 - nu) > 1e-2 * (1 + abs(nu)):
                raise self.deck.refuse("MAT1", card.mid, "E, G and NU do not belong together")
            entry: dict[str, Any] = {"E": float(E), "nu": float(nu), "rho": rho}
        elif card.type == "MAT8":
            E1, E2, nu12, G12 = (float(x) for x in (card.e11, card.e22, card.nu12, card.g12))
            of = {"E1": E1, "E2": E2, "E3": E2, "nu12": nu12, "nu13": 0.0, "nu23": 0.0, "G12": G12}
            if not (card.g1z and card.g2z):
                self.deck.remark(
                    "MAT8 without G1Z or G2Z is stiff in transverse shear in Nastran, here as G12"
                )
            of |= {"G13": float(card.g1z or G12), "G23": float(card.g2z or G12), "rho": rho}
            entry = of
        else:
            raise self.deck.refuse(
                card.type, card.mid, "only MAT1, and MAT8 of shells, are followed"
            )
        if not rho > 0:
            raise self.deck.refuse(card.type, card.mid, "has no density (RHO)")
        loss = float(card.ge or 0.0) if loss is None else loss
        if loss:
            entry["loss_factor"] = loss
        self.materials[name] = entry
        return name

    def _region(self, name: str, material: str, section: str = "") -> str:
        self.regions[name] = {"material": material} if material else {}
        if section:
            self.regions[name]["section"] = section
        return name

    def _solid(self, number: int, element: Any) -> str:
        prop = element.pid_ref
        if prop is None or prop.type != "PSOLID":
            raise self.deck.refuse(element.type, number, "needs a PSOLID")
        if prop.mid_ref is not None and prop.mid_ref.type != "MAT1":
            raise self.deck.refuse("PSOLID", prop.pid, f"{prop.mid_ref.type} is not followed")
        return self._region(f"p{prop.pid}", self._material(prop.pid, prop.mid_ref))

    def _shell(self, number: int, element: Any) -> str:
        prop = element.pid_ref
        given = [t for k in range(1, len(element.nodes) + 1)
                 if (t := getattr(element, f"T{k}", None)) is not None]  # fmt: skip
        if len({float(t) for t in given}) > 1 or (given and len(given) < len(element.nodes)):
            raise self.deck.refuse(
                element.type, number, "its corners have thicknesses of their own"
            )
        offset = float(element.zoffset or 0.0)
        if prop is not None and prop.type == "PSHELL":
            t = float(prop.t or 0.0)
            if given:
                t = float(given[0]) * (t if element.tflag == 1 else 1.0)
            self._expect_plate(prop)
            has_fibres = prop.mid1_ref.type == "MAT8"
            if not t > 0:
                raise self.deck.refuse("PSHELL", prop.pid, "has no thickness")
            nsm = float(prop.nsm or 0.0)
            material = self._material(prop.pid, prop.mid1_ref, nsm / t)
            section: dict[str, Any] = {"shape": "shell", "thickness": t, "offset": offset}
            name = f"p{prop.pid}" + (f"_t{t:.9g}" if given else "")
        elif prop is not None and prop.type == "PCOMP":
            material = ""
            has_fibres = any(m.type == "MAT8" for m in prop.mids_ref)
            if prop.nsm:
                raise self.deck.refuse("PCOMP", prop.pid, "NSM is not followed")
            if prop.lam not in (None, "", "NO", "SYM"):
                raise self.deck.refuse("PCOMP", prop.pid, f"LAM = {prop.lam} is not followed")
            loss = float(prop.ge or 0.0)  # those of its plies do not count
            plies = list(zip(prop.mids_ref, prop.thicknesses, prop.thetas, strict=True))
            if prop.is_symmetrical:
                plies += plies[::-1]
            whole = sum(float(t) for _, t, _ in plies)
            offset += float(prop.z0 or 0.0) + whole / 2
            offset = 0.0 if abs(offset) < 1e-9 * whole else offset
            layers = [
                {
                    "material": self._material(prop.pid, m, 0.0, loss),
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
        if has_fibres:
            axis = self._fibres(number, element)
            section["axis_1"], name = axis.tolist(), f"{name}_d{self._direction(axis)}"
        self.sections[name] = section
        return self._region(name, material, name)

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
        rounded: Floats = np.round(x, 7) + 0.0
        return rounded

    def _beam(self, number: int, element: Any) -> str:
        prop, kind = element.pid_ref, element.type
        if np.any(element.wa) or np.any(element.wb):
            raise self.deck.refuse(kind, number, "offsets of its ends (WA, WB) are not followed")
        if element.pa or element.pb:
            raise self.deck.refuse(kind, number, "pins (PA, PB) are not followed")
        ends = [self.deck.points[self.deck.at(int(n))] for n in element.node_ids[:2]]
        if element.g0:
            v = self.deck.points[self.deck.at(int(element.g0))] - ends[0]
        else:
            v = np.asarray(element.x, dtype=float)
            if str(element.offt)[:1] == "G":
                node = self.deck.model.nodes[int(element.node_ids[0])]
                if node.Cd() != 0:
                    if node.cd_ref.type not in ("CORD2R", "CORD1R"):
                        raise self.deck.refuse(
                            kind, number, "its vector is in cylindrical axes (CD)"
                        )
                    v = node.cd_ref.beta().T @ v
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
        try:
            section = beam_section(prop)
        except BodyError as error:
            raise self.deck.refuse(prop.type, prop.pid, str(error)) from None
        name = f"p{prop.pid}_d{self._direction(v)}"
        self.sections[name] = section | {"y_axis": v.tolist()}
        with named(self.deck.path, f"{prop.type} {prop.pid}: its area is not understood"):
            A, nsm = float(np.ravel(prop.Area())[0]), float(np.ravel(prop.Nsm() or 0.0)[0])
        material = self._material(prop.pid, prop.mid_ref, nsm / A)
        return self._region(name, material, name)

    def _expect_plate(self, prop: Any) -> None:
        """A PSHELL is one homogeneous plate."""
        why = ""
        if not prop.mid1 or prop.mid2 != prop.mid1 or abs((prop.twelveIt3 or 1.0) - 1) > 1e-6:
            why = "MID2 must be MID1, and 12I/T**3 = 1: one homogeneous plate"
        elif prop.mid3 and (prop.mid3 != prop.mid1 or abs((prop.tst or 0.833333) - 5 / 6) > 1e-3):
            why = "MID3 must be MID1, and TS/T = 5/6"
        elif prop.mid4:
            why = "MID4 is not followed"
        if why:
            raise self.deck.refuse("PSHELL", prop.pid, why)
        if not prop.mid3:
            self.deck.remark(
                "shells without MID3 are stiff in transverse shear in Nastran, here not"
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
        material = self._material(prop.mid, prop.mid_ref, float(prop.nsm or 0.0) / A)
        name = f"rod_{A:.9g}_{material}"
        self.sections[name] = {"shape": "rod", "A": A}
        return self._region(name, material, name)
