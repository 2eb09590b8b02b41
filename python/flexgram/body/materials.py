"""Materials of a mesh body: by moduli or by a stiffness, with what relaxes and what varies."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, check_name, errors_of
from flexgram.body.parameters import PARAMETER, read_varying
from flexgram.body.reader import LOSS, Reader
from flexgram.body.viscoelastic import KEY, read_isotropic, read_orthotropic

ENGINEERING = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")
ISOTROPIC = ("E", "nu", "rho")
STIFFNESS = "stiffness"  #: of a material, six rows of six
EXPANSION = "expansion"  #: [1/K], if heat is to strain the body; of three directions if orthotropic


def _matrix(material: Reader) -> Floats:
    """Stiffness (6, 6) of a material, in its axes."""
    where = f"{material.where}: {STIFFNESS}"
    with errors_of(where):
        matrix: Floats = np.array(material.get(STIFFNESS), dtype=float)
    if matrix.shape != (6, 6) or not np.all(np.isfinite(matrix)):
        raise BodyError(f"{where} must be six rows of six numbers: xx, yy, zz, xy, yz, zx")
    if np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
        raise BodyError(f"{where} is not symmetric")
    if np.linalg.eigvalsh(matrix)[0] <= 0:
        raise BodyError(f"{where} is not positive definite")
    return matrix


def write_material(file: h5py.File, name: str, data: Any, units: tuple[float, ...]) -> None:
    """Write ``materials/name`` of an entry of ``materials``; ``units``: length [m], mass [kg] and
    force [N] of its numbers.

    Raises
    ------
    BodyError
        With the place of what is wrong.
    """
    length, mass, force = units
    stress, density = force / length**2, mass / length**3
    where = f"materials: {name}"
    group = file.create_group(f"materials/{check_name(where, str(name))}")
    if isinstance(data, dict) and {"E1", STIFFNESS} & set(data):
        matrix = STIFFNESS in data
        known = (
            *((STIFFNESS,) if matrix else ENGINEERING),
            "rho",
            "axis_1",
            "axis_2",
            EXPANSION,
            LOSS,
            KEY,
            PARAMETER,
        )
        reader = Reader(data, where, known)
        factor, laws = read_orthotropic(reader)
        varying = read_varying(reader, str(name), stress)
        factor *= varying.share
        if matrix:
            group.attrs[STIFFNESS] = (stress * factor * _matrix(reader)).ravel()
        else:
            group.attrs["engineering_constants"] = [
                reader.number(key) * (1.0 if key.startswith("nu") else stress * factor)
                for key in ENGINEERING
            ]
        first, second = reader.vector("axis_1", [1, 0, 0]), reader.vector("axis_2", [0, 1, 0])
        if not np.linalg.norm(first) > 0:
            raise BodyError(f"{where}: axis_1 = [0, 0, 0] has no direction")
        first = first / np.linalg.norm(first)
        second = second - first * (first @ second)
        if np.linalg.norm(second) < 1e-9:
            raise BodyError(f"{where}: axis_1 and axis_2 are parallel")
        second = second / np.linalg.norm(second)
        group.attrs["axes"] = np.concatenate([first, second, np.cross(first, second)])
    else:
        reader = Reader(data, where, (*ISOTROPIC, EXPANSION, LOSS, KEY, PARAMETER))
        moduli, laws = read_isotropic(reader)
        if not moduli.E > 0:
            raise BodyError(f"{where}: E = {moduli.E:g}: Young's modulus must be positive")
        if not -1 < moduli.nu < 0.5:
            raise BodyError(f"{where}: nu = {moduli.nu:g} must be above -1 and below 0.5")
        varying = read_varying(reader, str(name), stress)
        group.attrs["E"] = varying.share * moduli.E * stress
        group.attrs["nu"] = moduli.nu
    varying.write(group, laws)
    group.attrs["rho"] = reader.number("rho") * density
    if LOSS in reader.data and not varying.loss:
        group.attrs[LOSS] = reader.loss_factor()
    if EXPANSION in reader.data:
        several = isinstance(reader.data[EXPANSION], list)
        if several and not {"E1", STIFFNESS} & set(reader.data):
            raise BodyError(f"{where}: expansion is one number where E is")
        group.attrs[EXPANSION] = reader.vector(EXPANSION) if several else reader.number(EXPANSION)
