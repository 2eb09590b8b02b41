"""Materials and springs whose stiffness is known between two numbers: parameters of the body."""

from __future__ import annotations

from flexgram.basics import BodyError
from flexgram.body.laws import Law
from flexgram.body.reader import Reader, short
from flexgram.body.varying_laws import parameter

PARAMETER = "parameter"


def _two(data: Reader, key: str) -> tuple[float, float]:
    value = data.get(key)
    try:
        first, last = (float(x) for x in value)
    except (TypeError, ValueError):
        raise BodyError(f"{data.where}: {key} = {short(value)} must be [from, to]") from None
    return first, last


def read_parameter(
    material: Reader, name: str, stress: float
) -> tuple[float, tuple[str, Law] | None]:
    """The share of a material's moduli that K holds, and the parameter with its law.

    Parameters
    ----------
    material : Reader
        Perhaps with the key ``parameter``, a mapping with one of ``E``: [from, to] in the unit of
        E, which must lie between them; and ``stiffness``: [from, to], a factor of all moduli.
    name : str
        Of the material: the parameter is E_NAME or stiffness_NAME.
    stress : float
        Unit of E [Pa]: parameters are in SI units.

    Raises
    ------
    BodyError
        Naming the place of the mistake.
    """
    if PARAMETER not in material.data:
        return 1.0, None
    data = Reader(material.get(PARAMETER), f"{material.where}: {PARAMETER}", ("E", "stiffness"))
    if len(data.data) != 1:
        raise BodyError(f"{data.where}: give E: [from, to] or stiffness: [from, to]")
    key = next(iter(data.data))
    if key == "E" and "E" not in material.data:
        raise BodyError(f"{data.where}: E is of isotropic materials: give stiffness")
    least, most = _two(data, key)
    now = material.number("E") if key == "E" else 1.0
    if not 0 < least <= now <= most or not least < most:
        raise BodyError(
            f"{data.where}: {key} = [{least:g}, {most:g}] must rise from a positive number, with "
            f"{'E of the material' if key == 'E' else '1'} ({now:g}) between"
        )
    unit = stress if key == "E" else 1.0
    law = parameter(least * unit, most * unit, now * unit, slope=1 / (least * unit))
    return float(least / now), (f"{key}_{name}", law)
