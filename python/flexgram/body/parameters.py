"""Materials and springs with numbers known between two others: parameters of the body. The laws of
what varies, relaxes or is in a table, as files hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import h5py

from flexgram.basics import BodyError
from flexgram.body.bodyfile import write_law
from flexgram.body.laws import Law, loss, viscous
from flexgram.body.reader import LOSS, Reader, short
from flexgram.body.varying_laws import Parameter, Product, parameter, product

PARAMETER = "parameter"
STIFFNESS, DAMPING = "stiffness", "damping"


def _two(data: Reader, key: str) -> tuple[float, float]:
    value = data.get(key)
    try:
        first, last = (float(x) for x in value)
    except (TypeError, ValueError):
        raise BodyError(f"{data.where}: {key} = {short(value)} must be [from, to]") from None
    return first, last


def _between(data: Reader, key: str, now: float, of: str, unit: float = 1.0) -> Parameter:
    """A parameter of these two numbers."""
    least, most = _two(data, key)
    positive = key != LOSS
    enough = least > 0 if positive else least >= 0
    if not (enough and least <= now <= most and least < most):
        raise BodyError(
            f"{data.where}: {key} = [{least:g}, {most:g}] must rise from "
            f"{'a positive number' if positive else 'zero or more'}, with {of} ({now:g}) between"
        )
    return parameter(least * unit, most * unit, now * unit)


@dataclass
class Varying:
    """What is known between two numbers of a material, or of a spring, with the name of each
    parameter."""

    stiffness: tuple[str, Parameter] | None = None
    loss: tuple[str, Product] | None = None
    damping: tuple[str, Product] | None = None
    #: Of the given stiffness that K holds.
    share: float = 1.0

    def write(self, group: h5py.Group, laws: Mapping[str, Law]) -> str:
        """Write these and the laws of parts that relax, or are in tables, each a group; in words.
        What relaxes does so in proportion to the stiffness."""
        words = []
        for part, law in laws.items():
            written, name = law, ""
            if self.stiffness:
                written = product(self.stiffness[1], law)
                name = f"{self.stiffness[0]}:{part}"
            _write(group, part, name, written)
            words.append(law.words)
        for part, known in (
            (PARAMETER, self.stiffness),
            (LOSS, self.loss),
            ("damper", self.damping),
        ):
            if known:
                _write(group, part, *known)
                words.append(f"{known[0]} from {known[1].least:g} to {known[1].most:g}")
        return ", ".join(words)


def _write(group: h5py.Group, part: str, name: str, law: Law) -> None:
    write_law(group.create_group(part), law)
    if name:
        group[part].attrs["name"] = name


def read_varying(entry: Reader, name: str, stress: float, of_spring: bool = False) -> Varying:
    """What ``parameter`` of a material, or a spring, says.

    Parameters
    ----------
    entry : Reader
        Perhaps with the key ``parameter``, a mapping with ``E``: [from, to] in the unit of E, which
        must lie between them; or ``stiffness``: [from, to], a factor of all moduli, or of the
        stiffness of a spring; ``loss_factor``: [from, to], with the present one between; of
        springs ``damping``: [from, to], a factor.
    name : str
        Of the material or spring: the parameter is E_NAME, stiffness_NAME, and so on.
    stress : float
        Unit of E [Pa]: parameters are in SI units.

    Raises
    ------
    BodyError
        Naming the place of the mistake.
    """
    found = Varying()
    if PARAMETER not in entry.data:
        return found
    known = (STIFFNESS, LOSS, DAMPING) if of_spring else ("E", STIFFNESS, LOSS)
    data = Reader(entry.get(PARAMETER), f"{entry.where}: {PARAMETER}", known)
    if not data.data:
        raise BodyError(f"{data.where}: give {', '.join(f'{key}: [from, to]' for key in known)}")
    stiff = [key for key in ("E", STIFFNESS) if key in data.data]
    if len(stiff) > 1:
        raise BodyError(f"{data.where}: give E, or stiffness, not both")
    if stiff and LOSS in data.data:
        raise BodyError(
            f"{data.where}: a stiffness and its loss factor cannot both vary: what is lost would "
            "be the product of two parameters"
        )
    if stiff == ["E"]:
        if "E" not in entry.data:
            raise BodyError(
                f"{data.where}: E is of isotropic materials without a table: give stiffness"
            )
        law = _between(data, "E", entry.number("E"), "E of the material", stress)
    elif stiff:
        law = _between(data, STIFFNESS, 1.0, "1")
    if stiff:
        found.stiffness = f"{stiff[0]}_{name}", replace(law, slope=1 / law.least)
        found.share = law.least / law.value
    if LOSS in data.data:
        if LOSS not in entry.data:
            raise BodyError(f"{entry.where}: {LOSS} is missing, the present one")
        law = _between(data, LOSS, entry.loss_factor(), "the present one")
        found.loss = f"{LOSS}_{name}", product(law, loss(1.0))
    if DAMPING in data.data:
        law = _between(data, DAMPING, 1.0, "1")
        found.damping = f"{DAMPING}_{name}", product(law, viscous())
    return found


def region_material(materials: Mapping[str, Any], entry: Reader, region: str) -> tuple[str, Any]:
    """The material of a region with a ``parameter`` of its own: its name and description.

    Raises
    ------
    BodyError
        For a region that is named like a material, or a material that has a parameter itself.
    """
    of = entry.choice("material", materials)
    if region in materials:
        raise BodyError(
            f"{entry.where}: a material has that name: name the region otherwise, for its parameter"
        )
    if PARAMETER in materials[of]:
        raise BodyError(f"{entry.where}: material {of} has a parameter itself")
    return region, {**materials[of], PARAMETER: entry.get(PARAMETER)}
