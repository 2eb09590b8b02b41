"""The stress of a body's shells at all their nodes, on one side: at each node that of the shells
around which are of one section and meet smoothly; where others meet, a node has several."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import h5py
import numpy as np
from numpy.typing import NDArray

from flexgram.basics import Floats, Ints
from flexgram.body.shell_stress import FOLD, Sheet, normals_of, sheets_of
from flexgram.body.strain import Heat, extrapolation

#: Elements whose operators are in memory at a time.
CHUNK = 1024


@dataclass
class ShellField:
    """Places of stress.

    Attributes
    ----------
    points : (N, 3) array
        [m]
    sheets : list of Sheet
    nodes : (P,) int array
        Of each place.
    place : list of (E, n) int arrays
        Of each sheet's elements the place at each corner.
    """

    points: Floats
    sheets: list[Sheet]
    nodes: Ints
    place: list[Ints]

    @classmethod
    def of(cls, file: h5py.File) -> ShellField:
        """Of an open body file."""
        points, sheets = file["mesh/points"][:], sheets_of(file)
        corner = [sheet.nodes.ravel() for sheet in sheets] or [np.empty(0, dtype=np.int64)]
        normals = [
            np.repeat(normals_of(points, s.nodes), s.nodes.shape[1], axis=0) for s in sheets
        ] or [np.empty((0, 3))]
        sections = list(dict.fromkeys(sheet.section for sheet in sheets))
        section = [np.full(s.nodes.size, sections.index(s.section)) for s in sheets]
        node, normal = np.concatenate(corner), np.concatenate(normals)
        keys = node * max(len(sections), 1) + np.concatenate([*section, node[:0]])
        _, first, group = np.unique(keys, return_index=True, return_inverse=True)
        group = group.ravel().astype(np.int64)
        smooth = np.einsum("ka,ka->k", normal, normal[first[group]]) >= np.cos(np.radians(FOLD))
        count = len(first)
        for bad in np.unique(group[~smooth]).tolist():  # corners by the normals that they follow
            known: list[tuple[Floats, int]] = []
            for corner_at in np.flatnonzero(group == bad).tolist():
                mine = normal[corner_at]
                close = [at for n, at in known if n @ mine >= np.cos(np.radians(FOLD))]
                if not close:
                    close = [bad if not known else count]
                    count += bool(known)
                    known.append((mine, close[0]))
                group[corner_at] = close[0]
        nodes = np.zeros(count, dtype=np.int64)
        nodes[group] = node
        ends = np.cumsum([s.nodes.size for s in sheets])[:-1]
        parts = np.split(group, ends) if sheets else []
        place = [p.reshape(s.nodes.shape) for p, s in zip(parts, sheets, strict=True)]
        return cls(points, sheets, nodes, place)

    @cached_property
    def alone(self) -> NDArray[np.bool_]:
        """Places whose nodes have no other, (P,)."""
        found: NDArray[np.bool_] = np.bincount(self.nodes)[self.nodes] == 1
        return found

    def elements(self, place: int) -> Ints:
        """Numbers of the elements around a place."""
        pairs = zip(self.sheets, self.place, strict=True)
        found: Ints = np.unique(np.concatenate([s.ids[(p == place).any(axis=1)] for s, p in pairs]))
        return found

    def stress(self, motion: Floats, side: str) -> Floats:
        """Stress on a side, xx, yy, zz, xy, yz, zx.

        Parameters
        ----------
        motion : (k, N, 6) array
            Displacements [m] and rotations of the nodes.
        side : str
            One of ``shell_stress.SIDES``.

        Returns
        -------
        (k, P, 6) array
            [N/m²]
        """
        stress = np.zeros((len(self.nodes), 6, len(motion)))
        for part, place, outward in self.chunks():
            rows, _ = part.rows(self.points, side, False)
            at_corners = np.einsum("nq,eqib->enib", outward, rows)
            moved = motion[:, part.nodes, : part.dofs].transpose(1, 2, 3, 0)
            moved = moved.reshape(len(part.nodes), -1, len(motion))
            here = np.einsum("enib,ebk->enik", at_corners, moved, optimize=True)
            np.add.at(stress, place, here)
        return self._mean(stress).transpose(2, 0, 1)

    def heated(self, heat: Heat, side: str) -> Floats:
        """Stress (P, 6) on a side that a field of temperature adds at once [N/m²].

        Raises
        ------
        BodyError
            If the expansion of a material is not known.
        """
        stress = np.zeros((len(self.nodes), 6, 1))
        warm = (heat.temperature != 0) | (heat.gradient != 0)
        for part, place, outward in self.chunks():
            if warm[part.nodes].any():
                held = part.held_stress(self.points, heat, side)
                np.add.at(stress[..., 0], place, np.einsum("nq,eqi->eni", outward, held))
        return self._mean(stress)[..., 0]

    def chunks(self) -> Iterator[tuple[Sheet, Ints, Floats]]:
        """Elements, not too many at once, with their places and the extrapolation to corners."""
        import _flexgram

        for sheet, place in zip(self.sheets, self.place, strict=True):
            xi = _flexgram.shape_functions(sheet.kind, np.empty((0, 3)))[0]
            outward = extrapolation(sheet.kind, xi)
            for first in range(0, len(place), CHUNK):
                some = slice(first, first + CHUNK)
                yield sheet.only(some), place[some], outward

    def _mean(self, sums: Floats) -> Floats:
        """Of the elements around each place."""
        count = np.zeros(len(self.nodes))
        for place in self.place:
            np.add.at(count, place, 1.0)
        mean: Floats = sums / np.maximum(count, 1)[:, None, None]
        return mean
