"""Where a body is in space and how it moves: by its mesh, or by those of an assembly's parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from flexgram.basics import BodyError, Floats, Ints
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.reduced import ReducedBody


@dataclass
class Space:
    """Nodes and elements, and how they move.

    Attributes
    ----------
    geometry : Geometry
        Of an assembly its parts side by side, each where its joints bring it.
    motion : callable
        Coordinates (k, m) -> displacements (k, N, 3) [m].
    """

    geometry: Geometry
    motion: Callable[[Floats], Floats]

    @classmethod
    def of(cls, model: ReducedBody, body: str | Path | None = None) -> Space:
        """Of a reduced body, or of an assembly.

        Raises
        ------
        BodyError
            If it has no mesh, or files of its parts are missing.
        """
        if not model.basis.parts:
            geometry = Geometry.load(body_of(model, body))
            return cls(geometry, lambda q: geometry.motion(model, q))
        return _assembled(model)

    def of_same(self, model: ReducedBody) -> Space:
        """That of the same body in other coordinates."""
        if model.basis.parts:
            return _assembled(model)
        return Space(self.geometry, lambda q: self.geometry.motion(model, q))


def _assembled(model: ReducedBody) -> Space:
    parts, placed = {}, {}
    for name, part in model.basis.parts.items():
        if not part.rom or not Path(part.rom).is_file():
            where = f" ({part.rom} is not there)" if part.rom else ""
            raise BodyError(f"part {name} has no reduced file{where}: nothing to draw")
        parts[name] = ReducedBody.load(part.rom)
        placed[name] = Geometry.load(body_of(parts[name]))
    turns = {
        name: Rotation.from_rotvec(p.turn).as_matrix() for name, p in model.basis.parts.items()
    }
    shifts = _shifts(model.basis.joins, placed, turns)
    points, blocks, first = [], [], 0
    interfaces: dict[str, Ints] = {}
    for name, geometry in placed.items():
        points.append(geometry.points @ turns[name].T + shifts[name])
        blocks += [(kind, nodes + first) for kind, nodes in geometry.blocks]
        interfaces |= {f"{name}.{key}": at + first for key, at in geometry.interfaces.items()}
        first += len(geometry.points)
    whole = Geometry(np.vstack(points), np.arange(first), blocks, interfaces=interfaces)

    def motion(q: Floats) -> Floats:
        moved = [
            geometry.motion(parts[name], np.atleast_2d(q) @ model.basis.parts[name].coordinates.T)
            @ turns[name].T
            for name, geometry in placed.items()
        ]
        found: Floats = np.concatenate(moved, axis=1)
        return found

    return Space(whole, motion)


def _place(geometry: Geometry, interface: str) -> Floats | None:
    """Reference position of an interface, or the mean of its nodes."""
    if interface in geometry.followers:
        return geometry.followers[interface][0]
    if interface not in geometry.interfaces:
        return None
    mean: Floats = geometry.points[geometry.interfaces[interface]].mean(axis=0)
    return mean


def _shifts(
    joins: Iterable[tuple[str, str]], placed: dict[str, Geometry], turns: dict[str, Floats]
) -> dict[str, Floats]:
    """Of each part, so that joined interfaces meet; of those that no joint has, none."""
    shifts: dict[str, Floats] = {}
    for name in placed:
        if name in shifts:
            continue
        shifts[name] = np.zeros(3)
        reached = [name]
        for here in reached:  # grows on the way
            for pair in joins:
                for mine, other in (pair, pair[::-1]):
                    part, _, interface = mine.partition(".")
                    theirs, _, their_interface = other.partition(".")
                    if part != here or theirs not in placed or theirs in shifts:
                        continue
                    one = _place(placed[part], interface)
                    two = _place(placed[theirs], their_interface)
                    if one is None or two is None:
                        continue
                    shifts[theirs] = shifts[here] + turns[here] @ one - turns[theirs] @ two
                    reached.append(theirs)
    return shifts
