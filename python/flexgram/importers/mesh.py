"""Bodies of a mesh of one material, described in words instead of YAML."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, naming
from flexgram.body.constraints import COMPONENTS
from flexgram.body.damping import by_ratio
from flexgram.body.description import import_description
from flexgram.body.loads import TYPES
from flexgram.body.materials import EXPANSION, ISOTROPIC
from flexgram.body.outputs import OUTPUTS
from flexgram.body.units import UNITS
from flexgram.importers.fe import Interface, check_damping
from flexgram.importers.interfaces import numbers, parse

#: Materials by name [SI]: Young's modulus, Poisson's ratio, density, expansion.
MATERIALS = {
    "steel": (210e9, 0.3, 7850.0, 12e-6),
    "aluminium": (70e9, 0.33, 2700.0, 23e-6),
    "titanium": (114e9, 0.34, 4430.0, 8.6e-6),
    "cast-iron": (110e9, 0.28, 7200.0, 10.5e-6),
}


def describe_interfaces(interfaces: Sequence[Interface]) -> dict[str, Any]:
    """Interfaces of a description, from the words of a command line."""
    described: dict[str, Any] = {}
    for interface in interfaces:
        name = interface.name
        if name in described:
            raise BodyError(f"interface {name} is given twice")
        if interface.coupling == "rows" or not isinstance(interface.where, str):
            raise BodyError(f"--{interface.coupling} {name}: a mesh has nodes, no rows of matrices")
        described[name] = {"coupling": interface.coupling, "nodes": _choice(interface)}
        if interface.position is not None:
            described[name]["position"] = interface.position.tolist()
    return described


def describe_load(text: str) -> tuple[str, dict[str, Any]]:
    """Name and entry of a load from the words of a command line, ``NAME=TYPE[:MORE]``: ``MORE`` are
    nodes, of ``acceleration`` a vector, of ``angular_acceleration`` a point, of ``spin`` a point
    and an axis."""
    name, equals, rest = text.partition("=")
    kind, _, more = rest.partition(":")
    if not equals or kind not in TYPES:
        raise BodyError(f"--load {text}: expected NAME=TYPE, TYPE one of {', '.join(TYPES)}")
    entry: dict[str, Any] = {"type": kind}
    if kind == "angular_acceleration":
        entry["point"] = numbers(f"--load {text}", more, 3).tolist()
    elif kind == "spin":
        six = numbers(f"--load {text} (point and axis)", more, 6).tolist()
        entry |= {"point": six[:3], "axis": six[3:]}
    elif kind == "nodal":
        entry["table"] = more
    elif kind != "acceleration":
        if not more:
            raise BodyError(f"--load {text}: expected nodes behind it: {name}={kind}:NSET:SET")
        entry["nodes"] = _choice(parse("load", f"{name}={more}"))
    elif more:
        where = f"--load {text} (acceleration takes no nodes, it may have a vector)"
        entry["vector"] = numbers(where, more, 3).tolist()
    return name, entry


def describe_output(text: str) -> tuple[str, dict[str, Any]]:
    """Name and entry of an output, ``NAME=[stress:|gauge:|reaction:]NODES``; a gauge has its
    direction before the nodes, a rosette also the normal of the surface, and a stress may be of
    ``ELEMENTS:1,2``, at one integration point of ``ELEMENTS:1,2@POINT``. Of shells with a side,
    ``stress/top:`` and ``gauge/top:``; where walls meet of some elements around a node,
    ``stress/top:NODES:7/ELEMENTS:1,2``."""
    name, _, rest = text.partition("=")
    kind, colon, nodes = rest.partition(":")
    kind, _, side = kind.partition("/")
    if not colon or kind not in OUTPUTS:
        if colon and (near := difflib.get_close_matches(kind, OUTPUTS, 1, 0.7)):
            raise BodyError(f"--measure {text}: {kind} is unknown, did you mean {near[0]}?")
        kind, nodes, side = "displacement", rest, ""
    entry: dict[str, Any] = {"type": kind} | ({"side": side} if side else {})
    if kind == "gauge":
        directions, _, nodes = nodes.partition(":")
        for key, words in zip(("direction", "normal"), directions.split("/"), strict=False):
            entry[key] = numbers(f"--measure {text} ({key})", words, 3).tolist()
    if kind == "stress" and nodes.upper().startswith("ELEMENTS:"):
        elements, at, point = nodes.partition(":")[2].partition("@")
        try:
            entry["elements"] = [int(word) for word in elements.split(",")]
            if at:
                entry["integration_point"] = int(point)
        except ValueError:
            raise BodyError(
                f"--measure {text}: expected numbers of elements and one point: ELEMENTS:5,6@2"
            ) from None
        return name, entry
    if kind == "stress" and "/ELEMENTS:" in nodes.upper():
        cut = nodes.upper().index("/ELEMENTS:")
        try:
            entry["elements"] = [int(n) for n in nodes[cut + len("/ELEMENTS:") :].split(",")]
        except ValueError:
            raise BodyError(
                f"--measure {text}: expected numbers of elements: NODES:7/ELEMENTS:5,6"
            ) from None
        nodes = nodes[:cut]
    return name, {**entry, "nodes": _choice(parse("measure", f"{name}={nodes}"))}


def describe_supports(words: Sequence[str], of_shells: bool = False) -> dict[str, Any]:
    """Entry ``supports`` from words of a command line, ``NAME=[x,y,…:]WHERE``: directions that are
    held there, by default all that nodes have."""
    found: dict[str, Any] = {}
    for text in words:
        name, _, where = text.partition("=")
        if name in found:
            raise BodyError(f"--support {name} is given twice")
        first, colon, rest = where.partition(":")
        directions = [word.strip() for word in first.split(",")]
        some = colon and set(directions) <= set(COMPONENTS)
        every = [*COMPONENTS] if of_shells else [*COMPONENTS][:3]
        entry = {"components": directions if some else every}
        nodes = _choice(parse("support", f"{name}={rest if some else where}"))
        found[name] = {"nodes": nodes, **entry}
    return found


def describe_mesh(
    mesh: Path,
    material: str,
    interfaces: Sequence[Interface],
    *,
    units: str = "SI",
    damping: Mapping[str, float | None] | None = None,
    loads: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    supports: Mapping[str, Any] | None = None,
    thickness: float | None = None,
) -> dict[str, Any]:
    """The description of a mesh of one material, from the words of a command line.

    Parameters
    ----------
    mesh : Path
        Of any meshio format.
    material : str
        One of ``MATERIALS``, or ``E=210e9,nu=0.3,rho=7850`` in the given units.
    interfaces : sequence of Interface
        Names, couplings, selectors, references, as ``importers.parse`` reads them.
    units : str
        Of the mesh.
    damping : mapping, optional
        alpha [1/s], beta [s], eta.
    loads, outputs : mapping, optional
        As in a YAML description.
    thickness : float, optional
        The mesh is one of shells of this thickness, in its units.

    Raises
    ------
    BodyError
        For words that no mesh can be described by.
    """
    if units not in UNITS:
        raise BodyError(f"--units {units} must be one of {', '.join(UNITS)}")
    length, mass, force = UNITS[units]
    if material in MATERIALS:
        E, nu, rho, expansion = MATERIALS[material]
        values = {
            "E": E / (force / length**2),
            "nu": nu,
            "rho": rho / (mass / length**3),
            EXPANSION: expansion,
        }
    else:
        pairs = [word.partition("=") for word in material.split(",")]
        try:
            values = {name.strip(): float(number) for name, _, number in pairs}
        except ValueError:
            values = {}
        if set(values) - {EXPANSION} != set(ISOTROPIC):
            E, nu, rho, _ = MATERIALS["steel"]
            own = f"E={E / (force / length**2):.6g},nu={nu:g},rho={rho / (mass / length**3):.6g}"
            missing = [key for key in ISOTROPIC if values and key not in values]
            raise BodyError(
                f"--material {material}: "
                + (f"{', '.join(missing)} is missing; " if missing else "")
                + f"expected one of {', '.join(MATERIALS)}, or numbers in {units}, of steel "
                f"{own}, and expansion=12e-6 [1/K] for heat"
            )
    called = material if material in MATERIALS else "material"
    described = describe_interfaces(interfaces)
    given = {key: value for key, value in (damping or {}).items() if value is not None}
    sheet: dict[str, Any] = {} if thickness is None else {"section": "sheet"}
    sections = {"sheet": {"shape": "shell", "thickness": thickness}} if sheet else {}
    return {
        "name": mesh.stem,
        "mesh": str(mesh.absolute()),
        "units": units,
        "materials": {called: values},
        "sections": sections,
        "regions": {"all": {"material": called} | sheet},
        "interfaces": described,
        "damping": given,
        "loads": dict(loads or {}),
        "outputs": dict(outputs or {}),
        "supports": dict(supports or {}),
    }


def import_mesh(
    mesh: str | Path,
    output: str | Path,
    material: str,
    interfaces: Mapping[str, str] | Sequence[Interface],
    *,
    units: str = "SI",
    alpha: float | None = None,
    beta: float | None = None,
    eta: float | None = None,
    zeta: str | None = None,
    loads: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    supports: Mapping[str, Any] | None = None,
    merge: float | None = None,
    keep_repeated: bool = False,
    spin: Mapping[str, Any] | None = None,
    preload: Mapping[str, float] | None = None,
    thickness: float | None = None,
) -> dict[str, Any]:
    """Turn a mesh of one material into a body file, without YAML.

    Parameters
    ----------
    mesh : str or Path
        Of any meshio format.
    output : str or Path
        Body file to write.
    material : str
        ``steel``, ``aluminium``, ``titanium``, ``cast-iron``, or ``E=210e9,nu=0.3,rho=7850`` in the
        given units.
    interfaces : mapping, or sequence of Interface
        Name -> coupling and nodes, as on the command line: ``{"eye": "rigid NSET:eye"}``.
    units : str
        Of the mesh: ``SI``, ``mm-t-s``, ``mm-kg-s``, ``in-lbf-s`` or ``ft-lbf-s``.
    alpha, beta, eta : float, optional
        Damping.
    zeta : str, optional
        A damping ratio at two frequencies instead of alpha and beta: ``"1%,50,2000"``.
    loads, outputs : mapping, optional
        As in a YAML description: ``{"gravity": {"type": "acceleration"}}``,
        ``{"fillet": {"type": "stress", "nodes": "fillet"}}``.
    supports : mapping, optional
        Likewise: ``{"foot": {"nodes": "foot", "components": ["x", "z"]}}``.
    merge : float, optional
        Nodes no farther apart than this, in units of the mesh, become one.
    keep_repeated : bool
        Elements with the same nodes count each, instead of being refused.
    spin, preload : mapping, optional
        As in a YAML description.
    thickness : float, optional
        Of a mesh of shells (triangles, quadrilaterals), in units of the mesh.

    Returns
    -------
    dict
        As ``import_body``.

    Raises
    ------
    BodyError
        With the place and what was expected.

    Examples
    --------
    >>> ends = {"lower": "rigid NSET:lower_plate", "upper": "rigid NSET:upper_plate"}
    >>> counts = flexgram.import_mesh("rack.msh", "steel.h5", "steel", ends, alpha=2.4)
    >>> counts["points"]
    2768
    """
    alpha, beta = by_ratio(zeta, alpha, beta)
    check_damping(alpha, beta, eta)
    named = interfaces_of(interfaces)
    described = describe_mesh(
        Path(mesh),
        material,
        named,
        units=units,
        damping={"alpha": alpha, "beta": beta, "eta": eta},
        loads=loads,
        outputs=outputs,
        supports=supports,
        thickness=thickness,
    )
    described |= further_keys(merge, keep_repeated, spin, preload)
    with naming(mesh):
        return import_description(described, str(mesh), output)


def further_keys(
    merge: float | None,
    keep_repeated: bool,
    spin: Mapping[str, Any] | None = None,
    preload: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Of a description, from the command line."""
    keys: dict[str, Any] = {"repeated_elements": "keep"} if keep_repeated else {}
    for name, value in (("merge", merge), ("spin", spin), ("preload", preload)):
        if value is not None:
            keys[name] = value
    return keys


def describe_spin(text: str) -> dict[str, Any]:
    """Entry ``spin`` from the words of a command line, ``X,Y,Z,AX,AY,AZ:FROM,TO[:rest]``: a point
    and the axis, speeds in rpm, and the frame if it is at rest."""
    where, _, more = text.partition(":")
    speeds, _, frame = more.partition(":")
    six = numbers(f"--spin {text} (point and axis)", where, 6).tolist()
    rpm = numbers(f"--spin {text} (speeds from, to in rpm)", speeds, 2).tolist()
    return {"point": six[:3], "axis": six[3:], "rpm": rpm, "frame": frame or "turning"}


def describe_preload(words: Sequence[str]) -> dict[str, float]:
    """Entry ``preload`` from words of a command line, ``INPUT=VALUE``."""
    found: dict[str, float] = {}
    for text in words:
        name, _, value = text.partition("=")
        if name in found:
            raise BodyError(f"--preload {name} is given twice")
        found[name] = float(numbers(f"--preload {text} (INPUT=VALUE)", value, 1)[0])
    return found


def interfaces_of(interfaces: Mapping[str, str] | Sequence[Interface]) -> Sequence[Interface]:
    """Interfaces by name, ``{"eye": "rigid NSET:eye"}``, or as they are."""
    if isinstance(interfaces, Mapping):
        return [_parsed(*item) for item in interfaces.items()]
    return interfaces


def _parsed(name: str, words: str) -> Interface:
    coupling, _, where = str(words).partition(" ")
    if coupling not in ("rigid", "distributing", "node"):
        raise BodyError(
            f"interface {name}: {words!r} must be rigid, distributing or node and "
            "its nodes: 'rigid NSET:eye'"
        )
    return parse(coupling, f"{name}={where}")


def _choice(interface: Interface) -> Any:
    """Nodes of a description, from a selector of the command line."""
    kind, _, words = str(interface.where).partition(":")
    place = f"{interface.name}={interface.where}"
    if kind.upper() == "NSET":
        return words
    if kind.upper() not in ("NODES", "AT", "BOX"):
        if not words:
            if kind.isdigit():
                raise BodyError(f"{place}: node {kind} is named with NODES:{kind}")
            raise BodyError(f"{place}: a node set is named with NSET:{kind}")
        raise BodyError(
            f"{place}: {kind} is unknown: NSET:{words} for a set, NODES:1,2,3, AT:x,y,z or "
            "BOX:x0,y0,z0,x1,y1,z1"
        )
    if kind.upper() == "NODES":
        try:
            return [int(word) for word in words.split(",")]
        except ValueError:
            raise BodyError(f"{place}: expected node numbers, not {words!r}") from None
    if kind.upper() == "AT":
        return {"at": numbers(place, words, 3).tolist()}
    return {"box": numbers(place, words, 6).reshape(2, 3).tolist()}
