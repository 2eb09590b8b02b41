"""Systems of units, and which of them the numbers of a body can be in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: A pound-force [N].
LBF = 4.4482216152605
#: Factors that bring lengths, masses and forces to SI.
UNITS = {
    "SI": (1.0, 1.0, 1.0),
    "mm-t-s": (1e-3, 1e3, 1.0),
    "mm-kg-s": (1e-3, 1.0, 1e-3),
    "in-lbf-s": (0.0254, LBF / 0.0254, LBF),
    "ft-lbf-s": (0.3048, LBF / 0.3048, LBF),
}

#: What bodies are made of: rubber to diamond in the speed of sound [m/s], foam to osmium in density
#: [kg/m³]; wide enough for what is only estimated.
SPEED = (10.0, 1e5)
DENSITY = (20.0, 5e4)
#: Largest extent of a part [m].
EXTENT = (1e-5, 300.0)


#: Largest extent [m] of a part in millimetres below which that is doubted.
SMALLEST = 2e-3
#: E [N/m²] and rho [kg/m³] of steel.
STEEL = (2.1e11, 7850.0)


def _is_material(system: str, speed: float, density: float) -> bool:
    length, mass, _ = UNITS[system]
    values = (speed * length, density * mass / length**3)
    return all(low <= x <= high for x, (low, high) in zip(values, (SPEED, DENSITY), strict=True))


def _is_extent(system: str, extent: float) -> bool:
    return EXTENT[0] <= extent * UNITS[system][0] <= EXTENT[1]


def plausible(system: str, speed: float, density: float, extent: float) -> bool:
    """Whether numbers in the units of a file, taken in a system, are those of a part."""
    return _is_material(system, speed, density) and _is_extent(system, extent)


def doubt(system: str, speed: float, density: float, extent: float) -> str | None:
    """What speaks against a system of units, and which others the numbers fit.

    Parameters
    ----------
    system : str
        Of ``UNITS``: in which the numbers are taken to be.
    speed, density, extent : float
        Of sound, of mass, and largest extent, in the units of the file.

    Returns
    -------
    str or None
        None where nothing speaks against it.
    """
    length, mass, force = UNITS[system]
    if plausible(system, speed, density, extent):
        if length < 0.01 and extent * length < SMALLEST:
            return f"the part measures {1e3 * extent * length:.3g} mm: is its mesh in metres?"
        return None
    fits = [name for name in UNITS if plausible(name, speed, density, extent)]
    hint = f"are the files in {' or '.join(fits)} (--units)?" if fits else "are the units right?"
    if system != "SI" and _is_material("SI", speed, density) and _is_extent(system, extent):
        E, rho = STEEL[0] * length**2 / force, STEEL[1] * length**3 / mass
        hint += f" Or E and rho alone in SI? In {system} steel has E={E:.6g}, rho={rho:.6g}"
    return (
        f"in {system} the speed of sound is about {speed * length:.2g} m/s, the density about "
        f"{density * mass / length**3:.2g} kg/m³ and the part measures {extent * length:.3g} m:"
        f" {hint}"
    )


def spacing(points: NDArray[np.float64]) -> float:
    """Typical distance of a node to the nearest other one; 0 where all lie in one place."""
    from scipy.spatial import cKDTree

    points = np.unique(points, axis=0)
    if len(points) < 2:
        return 0.0
    some = points[:: max(1, len(points) // 2000)]
    return float(np.median(cKDTree(points).query(some, k=2)[0][:, 1]))
