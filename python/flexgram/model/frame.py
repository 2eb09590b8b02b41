"""The frame of reference of a reduced body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from flexgram.basics import Floats


@dataclass(frozen=True)
class FrameIntegrals:
    """What a floating frame needs of a body besides its reduced matrices: the coefficients of its
    mass matrix in eq. (1) of Fehr, Eberhard and Lehner (``src/model/frame_integrals.hpp``).

    Attributes
    ----------
    mass : float
        [kg]
    centre : (3,) array
        Centre of mass [m].
    M_r : (6, 6) array
        Mass matrix of the rigid motions about the origin.
    M_er : (m, 6) array
        Coupling of the coordinates with these.
    gyroscopic : (m, 3, m) array
        ∫ρ φ_j · (e_a × φ_k), indices j, a, k.
    inertia_first : (3, 3, m) array
        ∫ρ (e_a × x) · (e_b × φ_j), indices a, b, j.
    inertia_second : (3, m, 3, m) array
        ∫ρ (e_a × φ_j) · (e_b × φ_k), indices a, j, b, k.
    stiffening : dict of (m, m) arrays
        Geometric stiffening (``--stiffening``): what the stress under a unit of each load adds
        to the stiffness (``src/model/stiffening.hpp``), by load; empty if not asked for.
    """

    mass: float
    centre: Floats
    M_r: Floats
    M_er: Floats
    gyroscopic: Floats
    inertia_first: Floats
    inertia_second: Floats
    stiffening: dict[str, Floats] = field(default_factory=dict)

    def without_first(self, count: int) -> FrameIntegrals:
        """Those of the body without its first coordinates."""
        keep = slice(count, None)
        return replace(
            self,
            M_er=self.M_er[keep],
            gyroscopic=self.gyroscopic[keep, :, keep],
            inertia_first=self.inertia_first[:, :, keep],
            inertia_second=self.inertia_second[:, keep, :, keep],
            stiffening={load: K[keep, keep] for load, K in self.stiffening.items()},
        )


@dataclass(frozen=True, eq=False)
class Frame(Mapping[str, Any]):
    """The frame of reference, and for a body that can move the integrals of a floating one. As in
    0.1 it can be read as a mapping of these.

    Attributes
    ----------
    kind : str
        ``none``, ``buckens`` or ``tangent`` (``--frame``).
    rigid_modes : int
        Of the body; its first coordinates unless ``kind`` is ``none``.
    integrals : FrameIntegrals or None
    """

    kind: str = "none"
    rigid_modes: int = 0
    integrals: FrameIntegrals | None = None

    @classmethod
    def of(cls, stored: dict[str, Any]) -> Self:
        """From the fields of a reduced body."""
        integrals = None
        if "frame/M_r" in stored:
            arrays = {
                f.name: np.asarray(stored[f"frame/{f.name}"], dtype=np.float64)
                for f in fields(FrameIntegrals)
                if f.name not in ("mass", "stiffening")
            }
            stiffening = {
                str(load): np.asarray(K, dtype=np.float64)
                for load, K in zip(
                    stored.get("frame/stiffening/names", ()),
                    stored.get("frame/stiffening", ()),
                    strict=True,
                )
            }
            integrals = FrameIntegrals(
                mass=float(stored["frame/mass"]), **arrays, stiffening=stiffening
            )
        return cls(
            str(stored.get("frame/kind", "none")),
            int(stored.get("frame/rigid_modes", 0)),
            integrals,
        )

    def without_rigid_modes(self) -> Self:
        """The frame of the body without its first, rigid coordinates."""
        left = self.integrals and self.integrals.without_first(self.rigid_modes)
        return replace(self, rigid_modes=0, integrals=left)

    def _all(self) -> dict[str, Any]:
        own = {"kind": self.kind, "rigid_modes": self.rigid_modes}
        return own | (asdict(self.integrals) if self.integrals else {})

    def __getitem__(self, name: str) -> Any:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())
