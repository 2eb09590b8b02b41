"""The error of the mesh: how far its natural frequencies are too high, by the jumps of stress from
element to element."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, Floats, Ints, errors_of
from flexgram.body.meshfile import SOLIDS
from flexgram.body.shell_field import ShellField
from flexgram.body.strain import at_points, extrapolation, stress_operator
from flexgram.body.stress import Solid, Stresses
from flexgram.model.damped_modes import NaturalModes
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.recovery import deforming_kinds
from flexgram.model.reduced import ReducedBody

#: Simpson's rule over the thickness of a shell, exact for energies of bending.
SIMPSON = {"top": 1 / 6, "middle": 4 / 6, "bottom": 1 / 6}


class _Strained(NamedTuple):
    """Elements with their state at the points of the stiffness."""

    places: Ints  #: (E, n), of their corners
    stress: Floats  #: (E, q, 6, k)
    strain: Floats  #: (E, q, 6, k), engineering shears
    volume: Floats  #: (E, q)
    outward: Floats  #: (n, q), from points to corners
    functions: Floats  #: (q, n), from corners to points


#: Some elements after the other.
_Walk = Callable[[], Iterator[_Strained]]


def mesh_errors(
    model: ReducedBody,
    modes: Ints | None = None,
    body: str | Path | None = None,
    natural: NaturalModes | None = None,
) -> Floats:
    """How far natural frequencies are too high because elements have a size, estimated.

    The stress of displacements jumps from element to element, that of the exact solution does not.
    The energy of the difference between the elements' stress and its mean at nodes, over that of
    the mode, is the relative error of ω² [Zienkiewicz and Zhu, International Journal for Numerical
    Methods in Engineering 24 (1987) 337]. It tells the size of the error. For plates with one or
    two elements over the thickness, of six kinds of elements, the largest of six modes was 0.26 to
    0.95 of the true one (``tests/python/test_mesh_error.py``); torsion with a single C3D20 over the
    thickness hides more of it (0.03). The errors of beams and of the geometry are not in it.

    Parameters
    ----------
    modes : (k,) int array, optional
        Numbers of modes from 0, as in ``NaturalModes``. Default: the first twelve elastic ones.
    body : str or Path, optional
        Body file; default: the one that was reduced, if it is there.
    natural : NaturalModes, optional
        Of ``model``, where they are known.

    Returns
    -------
    (k,) array
        0.01: one per cent.

    Raises
    ------
    BodyError
        Without that file, or if it has no solids and no shells.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> bool(mesh_errors(rom).max() < 0.03)
    True
    """
    natural = natural or NaturalModes.of(model)
    if modes is None:
        last = int(np.isfinite(natural.omega).sum())
        modes = np.arange(natural.rigid, min(natural.rigid + 12, last))
    if not len(modes):
        return np.empty(0)
    path = Path(body_of(model, body))
    shapes = natural.shapes[:, modes].T
    motion = Geometry.load(path).motion_and_rotation(natural.model, shapes)
    of_jumps = np.zeros(len(shapes))
    for places, elements in _parts(path, motion):
        of_jumps += _energy_of_jumps(places, elements, len(shapes))
    squares = natural.omega[modes] ** 2  # of modes with unit mass: twice the energy
    share = np.minimum(of_jumps / np.maximum(squares, 1e-300), 0.99)
    found: Floats = 1 / np.sqrt(1 - share) - 1
    return found


def modes_to_judge(natural: NaturalModes, most: int = 12) -> Ints:
    """Numbers of elastic modes in the band: the lowest, and the highest."""
    inside = np.flatnonzero(natural.omega <= natural.model.claim.band[1])
    inside = inside[inside >= natural.rigid]
    return inside if len(inside) <= most else np.append(inside[: most - 1], inside[-1])


def _energy_of_jumps(places: int, elements: _Walk, count: int) -> Floats:
    """∫ (σ* − σ)ᵀ(ε* − ε) dV of each mode, σ* and ε* the means at nodes between them."""
    sums, volume = np.zeros((2, places, 6 * count)), np.zeros(places)
    for part in elements():
        weight = np.repeat(part.volume.sum(axis=1), part.places.shape[1])
        used, at = np.unique(part.places, return_inverse=True)
        gather = sp.csr_matrix((weight, (at.ravel(), np.arange(part.places.size))))
        for of, values in zip(sums, (part.stress, part.strain), strict=True):
            corners = part.outward @ values.reshape(*part.volume.shape, -1)
            of[used] += gather @ corners.reshape(part.places.size, -1)
        volume[used] += gather @ np.ones(part.places.size)
    sums /= np.maximum(volume, 1e-300)[:, None]
    energy = np.zeros(count)
    for part in elements():
        stress, strain = (
            (part.functions @ of[part.places]).reshape(values.shape) - values
            for of, values in zip(sums, (part.stress, part.strain), strict=True)
        )
        energy += np.einsum("eq,eqk->k", part.volume, (stress * strain).sum(axis=2))
    return energy


def _parts(path: Path, motion: Floats) -> Iterator[tuple[int, _Walk]]:
    """Of a body file, parts in which stress has no jumps of its own: solids of one material, one
    side of all shells; each with the number of places at which it has a mean."""
    kinds = deforming_kinds(path)
    with errors_of(path), h5py.File(path) as file:
        if "mesh" not in file:
            raise BodyError("only the mesh of bodies that flexgram assembles can be judged")
        solids = Stresses.of(file) if kinds & set(SOLIDS) else None
        shells = ShellField.of(file)
    if solids is None and not shells.sheets:
        raise BodyError("the body has no solids and no shells: the error of its mesh is not known")
    if solids is not None:
        for solid in solids.blocks:
            yield len(solids.points), partial(_of_solid, solid, solids.points, motion)
    if shells.sheets:
        for side, share in SIMPSON.items():
            yield len(shells.nodes), partial(_of_shells, shells, side, share, motion)


def _of_solid(solid: Solid, points: Floats, motion: Floats) -> Iterator[_Strained]:
    import _flexgram

    xi, _, functions, _ = _flexgram.shape_functions(solid.kind, np.empty((0, 3)))
    outward = extrapolation(solid.kind, xi)
    for part in solid.chunks():
        _, operator, volume = stress_operator(solid.kind, points[part.nodes], part.law)
        strain = _times(operator, motion[:, part.nodes, :3])
        stress = at_points(part.law) @ strain
        yield _Strained(part.nodes, stress, strain, volume, outward, functions)


def _of_shells(shells: ShellField, side: str, share: float, motion: Floats) -> Iterator[_Strained]:
    import _flexgram

    for part, place, outward in shells.chunks():
        if part.is_membrane and side != "middle":
            continue
        functions = _flexgram.shape_functions(part.kind, np.empty((0, 3)))[2]
        stress, area = part.rows(shells.points, side, False)
        strain, _ = part.rows(shells.points, side, True)
        moved = motion[:, part.nodes, : part.dofs]
        height = float(part.thickness.sum()) * (1.0 if part.is_membrane else share)
        yield _Strained(
            place, _times(stress, moved), _times(strain, moved), height * area, outward, functions
        )


def _times(operator: Floats, moved: Floats) -> Floats:
    """(E, q, 6, k) of an operator (E, q, 6, d n) and motions (k, E, n, d)."""
    elements, points = operator.shape[:2]
    states = moved.transpose(1, 2, 3, 0).reshape(elements, -1, len(moved))
    found: Floats = (operator.reshape(elements, points * 6, -1) @ states).reshape(
        elements, points, 6, len(moved)
    )
    return found
