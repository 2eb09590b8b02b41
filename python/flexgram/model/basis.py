"""The basis of a reduced body: what its coordinates do at the nodes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats, Ints


@dataclass(frozen=True)
class PartOfAssembly:
    """A part of an assembly, as ``couple`` stores it.

    Attributes
    ----------
    coordinates : (m_part, m) array
        Its coordinates by those of the assembly.
    rom : str
        Its reduced file; empty if it was in memory.
    turn : (3,) array
        Rotation vector of its axes [rad].
    """

    coordinates: Floats
    rom: str
    turn: Floats


@dataclass(frozen=True)
class Basis:
    """Full displacements ``V q``; of an assembly the coordinates of its parts.

    Attributes
    ----------
    V : (rows, m) array
        After a parallel ``reduce`` the rows of this rank; empty if it was loaded without.
    node, component, position : arrays
        For the rows of V the label of the node, 0-2 (translation) or 3-5 (rotation), and its place
        (rows, 3) [m]; empty for a body without a dof map.
    """

    V: Floats
    node: Ints
    component: Ints
    position: Floats
    #: Of an assembly, by their names.
    parts: dict[str, PartOfAssembly] = field(default_factory=dict)
    #: The pairs of interfaces that it joins.
    joins: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Self:
        """From the fields of a reduced body."""
        names = [str(name) for name in fields.get("assembly/parts", [])]
        pairs = [str(pair).partition("=") for pair in fields.get("assembly/joins", [])]
        return cls(
            parts={
                name: PartOfAssembly(
                    np.asarray(fields[f"parts/{name}"], dtype=float),
                    str(fields[f"parts/{name}/rom"]),
                    np.asarray(fields[f"parts/{name}/turn"], dtype=float),
                )
                for name in names
            },
            joins=tuple((first, second) for first, _, second in pairs),
            V=np.asarray(fields.get("V", []), dtype=np.float64),
            node=np.asarray(fields.get("dofs/node", []), dtype=np.int64),
            component=np.asarray(fields.get("dofs/component", []), dtype=np.int64),
            position=np.asarray(fields.get("dofs/position", []), dtype=np.float64).reshape(-1, 3),
        )

    def projected(self, Q: Floats) -> Self:
        """The basis of the coordinates p of q = Q p."""
        parts = {
            name: replace(part, coordinates=part.coordinates @ Q)
            for name, part in self.parts.items()
        }
        return replace(self, V=self.V @ Q if self.V.ndim == 2 else self.V, parts=parts)

    def without_first(self, count: int) -> Self:
        """The basis without its first vectors."""
        parts = {
            name: replace(part, coordinates=part.coordinates[:, count:])
            for name, part in self.parts.items()
        }
        return replace(self, V=self.V[:, count:] if self.V.ndim == 2 else self.V, parts=parts)

    def lift(self, q: ArrayLike) -> Floats:
        """Displacements V q of the full body, (…, m) -> (…, rows of V)."""
        return np.asarray(q, dtype=float) @ self.V.T

    def expect_places(self) -> None:
        """Refuse a body without a dof map."""
        if not len(self.position) or len(self.component) != len(self.V):
            raise BodyError("the body has no dof map or coordinates: its shapes cannot be drawn")

    def nodal(self, q: ArrayLike) -> tuple[Ints, Floats, Floats]:
        """Nodes with their translations, for pictures and exporters.

        Parameters
        ----------
        q : (k, m) array
            Generalised coordinates.

        Returns
        -------
        labels : (N,) int array
        points : (N, 3) array
            [m]
        motion : (k, N, 3) array
            Translations; zero where a node has no free dof.

        Raises
        ------
        BodyError
            For a body without a dof map.
        """
        self.expect_places()
        shapes = np.atleast_2d(np.asarray(q))
        labels, first, at = np.unique(self.node, return_index=True, return_inverse=True)
        motion = np.zeros((len(shapes), len(labels), 3))
        moves = self.component < 3
        motion[:, at[moves], self.component[moves]] = self.lift(shapes)[:, moves]
        return labels, self.position[first], motion
