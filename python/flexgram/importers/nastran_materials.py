"""Materials of Nastran bulk data as entries of a description."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexgram.basics import BodyError
from flexgram.importers.nastran_deck import BulkDeck


def own_shear(card: Any) -> float:
    """G of a MAT1 over E / 2(1 + NU), where these do not belong together; else 0."""
    if card is None or card.type != "MAT1" or not (card.e and card.g):
        return 0.0
    ratio = float(card.g) * 2 * (1 + float(card.nu or 0.0)) / float(card.e)
    return ratio if abs(ratio - 1) > 1e-2 else 0.0


def _of_plane(card: Any) -> list[list[float]]:
    """The stiffness of a MAT2, which says that of plane stress alone."""
    G = {
        key: float(getattr(card, f"G{key}") or 0.0) for key in ("11", "12", "13", "22", "23", "33")
    }
    matrix = np.zeros((6, 6))
    for i, j in ((0, 0), (0, 1), (0, 3), (1, 1), (1, 3), (3, 3)):
        row, column = (min(k, 2) + 1 for k in (i, j))
        matrix[i, j] = matrix[j, i] = G[f"{row}{column}"]
    matrix[2, 2], matrix[4, 4], matrix[5, 5] = G["11"], G["33"], G["33"]
    rows: list[list[float]] = matrix.tolist()
    return rows


def _expansion(card: Any) -> float | list[float] | None:
    """Along the axes of a material, if it is all that there is of it [1/K]."""
    if card.type == "MAT1":
        return float(card.a or 0.0) or None
    if card.type not in ("MAT2", "MAT8"):
        return None
    along = [float(x or 0.0) for x in (card.a1, card.a2)]
    shears = card.type == "MAT2" and card.a3
    return [*along, 0.0] if any(along) and not shears else None


def beam_ratio(card: Any) -> tuple[float, float]:
    """Of a MAT1: Poisson's ratio with which E gives the G of a beam; and, where there is none, zero
    and what to multiply the areas by that G resists with."""
    E, nu = float(card.e), float(card.nu or 0.0)
    if not card.g or (not own_shear(card) and -1 < nu < 0.5):
        return nu, 1.0
    by_moduli = E / (2 * float(card.g)) - 1
    return (by_moduli, 1.0) if -1 < by_moduli < 0.5 else (0.0, 2 * float(card.g) / E)


class Materials:
    """Entries of ``materials``, made as elements need them."""

    def __init__(self, deck: BulkDeck) -> None:
        self.deck = deck
        self.references: set[float] = set()  #: temperatures without stress (TREF)
        self.entries: dict[str, dict[str, Any]] = {}

    def _density(self, card: Any, more: float) -> float:
        """By PARAM,WTMASS, with ``more``."""
        rho = (float(card.rho or 0.0) + more) * (self.deck.param("WTMASS") or 1.0)
        if not rho > 0:
            self.deck.remark("a material without density (RHO) weighs nothing")
        return rho

    def of(
        self,
        number: int,
        card: Any,
        more: float = 0.0,
        loss: float | None = None,
        *,
        beam: bool = False,
        reference: float | None = None,
    ) -> str:
        """Name of a material of property ``number``, with ``more`` density, another loss factor,
        and another temperature without stress than its own (TREF). Of a MAT1 whose E, G and NU do
        not belong together beams and rods have E and G, others E and NU, as in Nastran."""
        if card is None:
            raise BodyError(f"{self.deck.path}: property {number}: its material is missing")
        name = f"mat{card.mid}" + (f"_{more:.9g}" if more else "")
        name += "" if loss is None else f"_g{loss:.9g}"
        if beam and card.type != "MAT1":
            raise self.deck.refuse(card.type, card.mid, "beams and rods have a MAT1")
        if beam and (own_shear(card) or not -1 < float(card.nu or 0.0) < 0.5):
            name += "_beam"
        if _expansion(card):
            self.references.add(float((card.tref if reference is None else reference) or 0.0))
        if name in self.entries:
            return name
        rho = self._density(card, more)
        if card.type == "MAT1":
            E, nu = float(card.e or 0.0), float(card.nu or 0.0)
            if not E > 0:
                raise self.deck.refuse("MAT1", card.mid, "E must be positive")
            if beam:
                nu = beam_ratio(card)[0]
            if not -1 < nu < 0.5:
                raise self.deck.refuse("MAT1", card.mid, f"NU = {nu:g} is no Poisson's ratio")
            entry: dict[str, Any] = {"E": E, "nu": nu, "rho": rho}
        elif card.type == "MAT8":
            E1, E2, nu12, G12 = (float(x) for x in (card.e11, card.e22, card.nu12, card.g12))
            of = {"E1": E1, "E2": E2, "E3": E2, "nu12": nu12, "nu13": 0.0, "nu23": 0.0, "G12": G12}
            if not (card.g1z and card.g2z):
                self.deck.remark(
                    "MAT8 without G1Z or G2Z is stiff in transverse shear in Nastran, here as G12"
                )
            of |= {"G13": float(card.g1z or G12), "G23": float(card.g2z or G12), "rho": rho}
            entry = of
        elif card.type == "MAT2":
            entry = {"stiffness": _of_plane(card), "rho": rho}
            self.deck.remark("MAT2 resists transverse shear by its G33, where MID3 gives no other")
        else:
            raise self.deck.refuse(
                card.type, card.mid, "only MAT1, MAT2 and MAT8 of shells, MAT9 of solids are known"
            )
        loss = float(card.ge or 0.0) if loss is None else loss
        if loss:
            entry["loss_factor"] = loss
        if expansion := _expansion(card):
            entry["expansion"] = expansion
        self.entries[name] = entry
        return name

    def of_solid(self, prop: Any) -> str:
        """Name of the material of a PSOLID with MAT9, along the axes of its CORDM."""
        card, axes = prop.mid_ref, np.eye(3)
        name = f"mat{card.mid}_p{prop.pid}"
        if name in self.entries:
            return name
        if prop.cordm not in (0, None):
            system = self.deck.model.coords.get(prop.cordm)
            if system is None or system.type not in ("CORD2R", "CORD1R"):
                raise self.deck.refuse("PSOLID", prop.pid, "only a rectangular CORDM is followed")
            axes = np.asarray(system.beta(), dtype=float)
        matrix = [[float(getattr(card, f"G{min(i, j)}{max(i, j)}") or 0.0) for j in range(1, 7)]
                  for i in range(1, 7)]  # fmt: skip
        entry: dict[str, Any] = {"stiffness": matrix, "rho": self._density(card, 0.0)}
        entry |= {"axis_1": axes[0].tolist(), "axis_2": axes[1].tolist()}
        if card.ge:
            entry["loss_factor"] = float(card.ge)
        self.entries[name] = entry
        return name

    def of_shear(self, card: Any) -> str:
        """Name of a material with G of a MAT1, which may be all that the core of a sandwich has."""
        G = float(card.g or 0.0)
        if not G > 0:
            raise self.deck.refuse("MAT1", card.mid, "G must be positive: it resists shear")
        name = f"mat{card.mid}_shear"
        self.entries[name] = {"E": 2 * G, "nu": 0.0, "rho": 0.0}
        if card.ge:
            self.entries[name]["loss_factor"] = float(card.ge)
        return name
