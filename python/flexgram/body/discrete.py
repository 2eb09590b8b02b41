"""Masses, springs and dashpots at nodes and interfaces, as a body's description gives them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, Ints, check_name
from flexgram.body.parameters import PARAMETER, read_varying
from flexgram.body.reader import Reader, short
from flexgram.body.viscoelastic import KEY, read_orthotropic

Select = Callable[[Any, str], Ints]


def _list(entry: Reader, key: str) -> Floats:
    try:
        values = np.array(entry.get(key), dtype=float)
    except (ValueError, TypeError):
        raise BodyError(
            f"{entry.where}: {key} = {short(entry.get(key))} must be numbers, or rows of as many "
            "numbers each"
        ) from None
    if not np.all(np.isfinite(values)):
        raise BodyError(f"{entry.where}: {key} = {short(entry.get(key))} must be finite")
    return values


class Places:
    """Interfaces by name, nodes by a choice of them, as groups of the file hold them."""

    def __init__(self, file: h5py.File) -> None:
        self.file = file

    def write(
        self, group: h5py.Group, entry: Reader, select: Select, key: str, prefix: str = ""
    ) -> None:
        """``at`` or ``to``: an interface; ``nodes`` or ``to_nodes``: a choice of nodes."""
        nodes_key = f"{prefix}nodes"
        if (key in entry.data) == (nodes_key in entry.data):
            raise BodyError(f"{entry.where}: give {key} (an interface) or {nodes_key}")
        if nodes_key in entry.data:
            group[nodes_key] = select(entry.get(nodes_key), f"{entry.where}: {nodes_key}")
            return
        name = entry.choice(key, list(self.file["interfaces"]))
        if self.file["interfaces"][name].attrs["coupling"] == "distributing":
            raise BodyError(
                f"{entry.where}: interface {name} is distributing and carries nothing: give "
                f"{nodes_key}, or make the interface rigid"
            )
        group.attrs[f"{prefix}interface"] = name

    def positions(self, group: h5py.Group, prefix: str = "") -> Floats:
        """Of its nodes, or of the interface [m], (k, 3)."""
        if f"{prefix}interface" in group.attrs:
            interface = self.file["interfaces"][str(group.attrs[f"{prefix}interface"])]
            if interface.attrs["coupling"] == "rigid":
                return np.array(interface.attrs["position"])[None]
            points: Floats = self.file["mesh/points"][:][interface["nodes"][:1]]
            return points
        found: Floats = self.file["mesh/points"][:][group[f"{prefix}nodes"][:]]
        return found


def write_masses(
    file: h5py.File, reader: Reader, select: Select, units: tuple[float, ...]
) -> list[str]:
    """Write ``masses``: name -> ``at`` (an interface) or ``nodes``, ``mass``, ``inertia``,
    ``offset``.

    Parameters
    ----------
    file : h5py.File
        With its interfaces.
    reader : Reader
        Of the whole description. ``inertia`` is three principal moments along the axes, or xx, yy,
        zz, xy, yz, zx of the tensor, about the centre of mass, which lies at ``offset`` from the
        node. A mass at several nodes is one at each.
    select : function
        Nodes of a choice.
    units : tuple of float
        Length [m], mass [kg] and force [N].

    Returns
    -------
    list of str
        What is told of each.
    """
    told = []
    places = Places(file)
    for order, (name, data) in enumerate(reader.children("masses").items()):
        known = ("at", "nodes", "mass", "inertia", "offset", "matrix")
        entry = Reader(data, f"masses: {name}", known)
        group = file.create_group(f"masses/{check_name(entry.where, str(name))}")
        places.write(group, entry, select, "at")
        group.attrs["order"] = order
        if "matrix" in entry.data:
            told.append(_mass_by_matrix(group, entry, str(name), units))
            continue
        inertia = np.zeros(6)
        if "inertia" in entry.data:
            given = _list(entry, "inertia")
            if given.shape not in ((3,), (6,)):
                raise BodyError(
                    f"{entry.where}: inertia must be three numbers (xx, yy, zz) or six (then xy, "
                    "yz, zx too)"
                )
            inertia[: len(given)] = given
        if not {"mass", "inertia"} & set(entry.data):
            raise BodyError(f"{entry.where}: mass is missing, or inertia")
        if entry.number("mass", 0.0) < 0:
            raise BodyError(f"{entry.where}: mass = {entry.number('mass'):g} is negative")
        group.attrs["mass"] = entry.number("mass", 0.0) * units[1]
        group.attrs["inertia"] = inertia * units[1] * units[0] ** 2
        offset = units[0] * entry.vector("offset", [0, 0, 0])
        if offset.any():
            group.attrs["offset"] = offset
        count = len(places.positions(group))
        each = f" at each of {count} nodes" if count > 1 else ""
        words = f"mass {name}: {group.attrs['mass']:.6g} kg{each}"
        if inertia.any():
            words += f", inertia {', '.join(f'{x:.6g}' for x in group.attrs['inertia'][:3])} kg m²"
        if offset.any():
            words += f", {np.linalg.norm(offset):.4g} m beside its node"
        told.append(words)
    return told


def _mass_by_matrix(group: h5py.Group, entry: Reader, name: str, units: tuple[float, ...]) -> str:
    """``matrix`` of a mass: three or six numbers along and about the axes, or 3×3 or 6×6. What is
    told of it."""
    if other := sorted({"mass", "inertia", "offset"} & set(entry.data)):
        raise BodyError(f"{entry.where}: matrix stands for {other[0]}: give one of them")
    arms = np.array([1.0] * 3 + [units[0]] * 3)
    matrix = _of_motion(entry, "matrix", units[1] * np.outer(arms, arms), [])
    group.attrs["matrix"] = matrix.ravel()
    group.attrs["mass"] = matrix.diagonal()[:3].mean()  # what is told of the whole body
    group.attrs["inertia"] = np.r_[matrix.diagonal()[3:], 0.0, 0.0, 0.0]
    kg = ", ".join(f"{x:.6g}" for x in matrix.diagonal()[:3])
    return f"mass {name}: {kg} kg along the axes"


def _of_motion(entry: Reader, key: str, scale: Floats, ends: list[Floats]) -> Floats:
    """6×6 over displacements and rotations, in SI, of one number along the line between the ends,
    three or six numbers along the axes, or a matrix of these sizes."""
    given = _list(entry, key)
    if given.shape == ():
        if len(ends) < 2:
            raise BodyError(
                f"{entry.where}: {key} is one number, along the line to another node or interface: "
                f"give to or to_nodes, or three or six numbers along the axes"
            )
        lines = np.broadcast_to(ends[1], ends[0].shape) - ends[0]
        lengths = np.linalg.norm(lines, axis=1)
        directions = lines / np.where(lengths > 0, lengths, 1)[:, None]
        if not lengths.all() or np.ptp(np.abs(directions @ directions[0])) > 1e-9:
            raise BodyError(
                f"{entry.where}: {key} is one number, along the line between its ends, and these "
                "lie in one place or in several directions: give three or six numbers along the "
                "axes, or a spring for each"
            )
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = given * np.outer(directions[0], directions[0])
    elif given.shape in ((3,), (6,)):
        matrix = np.diag(np.concatenate([given, np.zeros(6 - len(given))]))
    elif given.shape in ((3, 3), (6, 6)):
        matrix = np.zeros((6, 6))
        matrix[: len(given), : len(given)] = given
    else:
        raise BodyError(
            f"{entry.where}: {key} must be one number (along the line between its ends), three or "
            "six (along and about the axes), or a 3×3 or 6×6 matrix"
        )
    if np.abs(matrix - matrix.T).max() > 1e-12 * np.abs(matrix).max():
        raise BodyError(
            f"{entry.where}: {key} is not symmetric: bearings with oil films push across their "
            "motion, which springs of a description cannot. Write the body as matrices (flexgram "
            "assemble), and add the skew part to its K (flexgram.write_matrices)"
        )
    result: Floats = matrix * scale
    return result


def _to_itself(spring: h5py.Group) -> bool:
    """Whether a spring between two places starts at a node or interface where it ends."""
    start, end = spring.attrs.get("interface"), spring.attrs.get("to_interface")
    if start is not None or end is not None:
        return bool(start == end)
    return bool((spring["nodes"][:] == spring["to_nodes"][:]).any())


def _sizes(stiffness: Floats) -> str:
    """Of a spring along and about the axes, in words."""
    diagonal = np.diag(np.reshape(stiffness, (6, 6)))
    return "".join(
        f", {', '.join(f'{k:.4g}' for k in some)} {unit}"
        for some, unit in ((diagonal[:3], "N/m"), (diagonal[3:], "N m a radian"))
        if some.any()
    )


def write_springs(
    file: h5py.File, reader: Reader, select: Select, units: tuple[float, ...]
) -> list[str]:
    """Write ``springs``: name -> ``at`` or ``nodes``, perhaps ``to`` or ``to_nodes`` (else to
    ground), ``stiffness``, ``damping``, ``loss_factor``, ``viscoelastic`` or ``parameter``. As
    ``write_masses``.

    Stiffness and damping are one number along the line between two ends, three or six along and
    about the axes, or a symmetric 3×3 or 6×6 matrix. A spring between two places acts midway."""
    told = []
    places = Places(file)
    force, length = units[2], units[0]
    scale = np.full((6, 6), force)
    scale[:3, :3] /= length
    scale[3:, 3:] *= length
    for order, (name, data) in enumerate(reader.children("springs").items()):
        keys = (*("at", "nodes", "to", "to_nodes"), *("stiffness", "damping", "loss_factor"))
        entry = Reader(data, f"springs: {name}", (*keys, KEY, PARAMETER))
        group = file.create_group(f"springs/{check_name(entry.where, str(name))}")
        places.write(group, entry, select, "at")
        ends = [places.positions(group)]
        grounded = "to" not in entry.data and "to_nodes" not in entry.data
        if not grounded:
            places.write(group, entry, select, "to", "to_")
            ends.append(places.positions(group, "to_"))
            if len(ends[1]) not in (1, len(ends[0])):
                raise BodyError(
                    f"{entry.where}: it starts at {len(ends[0])} nodes and ends at {len(ends[1])}"
                )
            if _to_itself(group):
                raise BodyError(
                    f"{entry.where}: it goes from a place to itself, where nothing moves against "
                    "itself; leave out to or to_nodes for a spring to ground"
                )
        given = [key for key in ("stiffness", "damping") if key in entry.data]
        if not given:
            raise BodyError(f"{entry.where}: stiffness is missing, or damping")
        for key in given:
            group.attrs[key] = _of_motion(entry, key, scale, ends).ravel()
        varies = _write_laws(group, entry, str(name))
        group.attrs["order"] = order
        many = f", {len(ends[0])} of them" if len(ends[0]) > 1 else ""
        size = _sizes(group.attrs["stiffness"]) if "stiffness" in given else ""
        told.append(
            f"spring {name}: {'to ground' if grounded else 'between nodes'}{many}{size}{varies}"
        )
    return told


def _write_laws(group: h5py.Group, entry: Reader, name: str) -> str:
    """What relaxes of a spring, or is known between two numbers, of which ``stiffness`` then is the
    least; in words."""
    share, laws = read_orthotropic(entry)
    varying = read_varying(entry, name, 1.0, of_spring=True)
    for key, needed in (
        ("stiffness", laws or varying.stiffness or varying.loss),
        ("damping", varying.damping),
    ):
        if needed and key not in entry.data:
            raise BodyError(f"{entry.where}: {key} is missing, of which this is")
    if "stiffness" in entry.data:
        group.attrs["stiffness"] = share * varying.share * group.attrs["stiffness"]
    if "loss_factor" in entry.data and not varying.loss:
        group.attrs["loss_factor"] = entry.loss_factor()
    words = varying.write(group, laws)
    return f", {words}" if words else ""


def joined_nodes(file: h5py.File) -> list[Ints]:
    """Sets of nodes that a spring joins: its ends; of a rigid interface all its nodes."""
    sets = []
    for spring in file.get("springs", {}).values():
        if not ({"to_interface", "to_nodes"} & {*spring.attrs, *spring}):
            continue
        ends = []
        for prefix in ("", "to_"):
            if f"{prefix}interface" in spring.attrs:
                interface = file["interfaces"][str(spring.attrs[f"{prefix}interface"])]
                ends.append(interface["nodes"][:][None, :])
            else:
                ends.append(spring[f"{prefix}nodes"][:][:, None])
        count = max(len(end) for end in ends)
        first, second = (np.broadcast_to(end, (count, end.shape[1])) for end in ends)
        sets += list(np.concatenate([first, second], axis=1))
    return sets
