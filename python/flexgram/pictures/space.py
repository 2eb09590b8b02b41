"""Where a body is in space and how it moves: by its mesh, or by those of an assembly's parts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
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
    parts : dict
        Of an assembly by their names: reduced body, mesh, and turn of its axes (3, 3).
    """

    geometry: Geometry
    parts: dict[str, tuple[ReducedBody, Geometry, Floats]] = field(default_factory=dict)

    @classmethod
    def of(cls, model: ReducedBody, body: str | Path | None = None) -> Space:
        """Of a reduced body, or of an assembly.

        Raises
        ------
        BodyError
            If it has no mesh, or files of its parts are missing.
        """
        if model.basis.parts:
            return _assembled(model)
        return cls(Geometry.load(body_of(model, body)))

    def motion(self, model: ReducedBody, q: Floats) -> Floats:
        """Displacements (k, N, 3) [m] for coordinates (k, m) of the body, or of the same in other
        coordinates."""
        if not self.parts:
            return self.geometry.motion(model, q)
        moved = [
            mesh.motion(part, np.atleast_2d(q) @ model.basis.parts[name].coordinates.T) @ turn.T
            for name, (part, mesh, turn) in self.parts.items()
        ]
        found: Floats = np.concatenate(moved, axis=1)
        return found


def _assembled(model: ReducedBody) -> Space:
    parts: dict[str, tuple[ReducedBody, Geometry, Floats]] = {}
    for name, part in model.basis.parts.items():
        if not part.rom or not Path(part.rom).is_file():
            where = f" ({part.rom} is not there)" if part.rom else ""
            raise BodyError(f"part {name} has no reduced file{where}: nothing to draw")
        body = ReducedBody.load(part.rom)
        turn = Rotation.from_rotvec(part.turn).as_matrix()
        parts[name] = body, Geometry.load(body_of(body)), turn
    placed = {name: geometry for name, (_, geometry, _) in parts.items()}
    shifts = _shifts(model.basis.joins, placed, {name: turn for name, (*_, turn) in parts.items()})
    points, blocks, first = [], [], 0
    interfaces: dict[str, Ints] = {}
    for name, (_, geometry, turn) in parts.items():
        points.append(geometry.points @ turn.T + shifts[name])
        blocks += [(kind, nodes + first) for kind, nodes in geometry.blocks]
        interfaces |= {f"{name}.{key}": at + first for key, at in geometry.interfaces.items()}
        first += len(geometry.points)
    whole = Geometry(np.vstack(points), np.arange(first), blocks, interfaces=interfaces)
    return Space(whole, parts)


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
