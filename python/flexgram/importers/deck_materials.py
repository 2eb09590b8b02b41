"""Materials of a CalculiX or Abaqus deck, as a body's description has them, and orientations."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.orientation import cylindrical, rectangular
from flexgram.importers.ccx import Card, Job
from flexgram.importers.deck_distributions import Distribution, distributions_of

ENGINEERING = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")


def _numbers(job: Job, card: Card, count: int) -> list[float]:
    """The numbers of a card of a material, eight in a row."""
    words = [word for row in card.words() for word in row if word]
    where = f"{card.place}"
    rows = [row for row in card.words() if any(row)]
    if len(rows) > (count + 7) // 8 or len(words) > count + 1:  # behind them: a temperature
        raise BodyError(f"{where}: depends on temperature; --run-ccx knows it")
    try:
        values = [float(word) for word in words[:count]]
    except ValueError:
        values = []
    if len(values) < count:
        raise BodyError(f"{where}: expected {count} number{'s' if count > 1 else ''}")
    return values


#: Components of the 21 constants, 11 22 33 12 13 23, as xx yy zz xy yz zx of ours.
OURS = (0, 1, 2, 3, 5, 4)


def _anisotropic(constants: list[float]) -> list[list[float]]:
    """The stiffness of 21 constants, column by column of its upper triangle."""
    matrix = np.zeros((6, 6))
    rest = iter(constants)
    for column in range(6):
        for row in range(column + 1):
            i, j = OURS[row], OURS[column]
            matrix[i, j] = matrix[j, i] = next(rest)
    rows: list[list[float]] = matrix.tolist()
    return rows


def _elastic(job: Job, card: Card) -> dict[str, Any]:
    """Moduli: isotropic, engineering constants, nine entries of an orthotropic stiffness, or 21 of
    any."""
    kind = card.options.get("TYPE", "ISO").upper()
    if kind in ("ISO", "ISOTROPIC"):
        return dict(zip(("E", "nu"), _numbers(job, card, 2), strict=True))
    if kind == "ENGINEERING CONSTANTS":
        return dict(zip(ENGINEERING, _numbers(job, card, 9), strict=True))
    if kind == "LAMINA":
        E1, E2, nu12, G12, G13, G23 = _numbers(job, card, 6)
        return dict(zip(ENGINEERING, (E1, E2, E2, nu12, 0.0, 0.0, G12, G13, G23), strict=True))
    if kind in ("ANISO", "ANISOTROPIC"):
        return {"stiffness": _anisotropic(_numbers(job, card, 21))}
    if kind not in ("ORTHO", "ORTHOTROPIC"):
        raise BodyError(f"{job.path}: *ELASTIC, TYPE={kind}: not supported; --run-ccx knows more")
    c11, c12, c22, c13, c23, c33, *shear = _numbers(job, card, 9)
    try:
        S = np.linalg.inv([[c11, c12, c13], [c12, c22, c23], [c13, c23, c33]])
    except np.linalg.LinAlgError:
        raise BodyError(f"{job.path}: *ELASTIC, TYPE=ORTHO: the stiffness is singular") from None
    E = 1 / np.diag(S)
    values = (*E, -S[0, 1] * E[0], -S[0, 2] * E[0], -S[1, 2] * E[1], *shear)
    return dict(zip(ENGINEERING, map(float, values), strict=True))


def _relaxation(job: Job, card: Card) -> dict[str, Any]:
    """Abaqus' *VISCOELASTIC as YAML has it: of TIME=PRONY and FREQUENCY=PRONY rows g, k, tau,
    shares of the instantaneous shear and bulk modulus, and relaxation times; of
    FREQUENCY=TABULAR the rows as they are, for ``_with_moduli``."""
    where = f"{job.path}: *VISCOELASTIC"
    kind = ", ".join(f"{key}={value}" for key, value in card.options.items()) or "without TIME"
    by_time, by_frequency = (card.options.get(key, "").upper() for key in ("TIME", "FREQUENCY"))
    is_table = by_frequency == "TABULAR"
    if "PRELOAD" in card.options or not (is_table or "PRONY" in (by_time, by_frequency)):
        raise BodyError(
            f"{where} ({kind}): TIME=PRONY, FREQUENCY=PRONY and FREQUENCY=TABULAR without PRELOAD "
            "are read; give a table in YAML instead"
        )
    try:
        rows = [[float(word or 0) for word in words] for words in card.words() if any(words)]
    except ValueError:
        rows = []
    if is_table:
        if not rows or any(len(row) != 5 for row in rows):
            raise BodyError(
                f"{where} ({kind}): expected rows of five numbers: real and imaginary part of ωg* "
                "and of ωk*, and the frequency"
            )
        return {"table": sorted(rows, key=lambda row: row[4])}
    if not rows or any(len(row) != 3 for row in rows):
        raise BodyError(f"{where}: expected rows of three numbers: g, k and tau")
    if all(g == k for g, k, _ in rows):
        return {"prony": [[g, tau] for g, _, tau in rows]}
    parts = {"shear": [[g, t] for g, _, t in rows if g], "bulk": [[k, t] for _, k, t in rows if k]}
    return {"prony": {part: series for part, series in parts.items() if series}}


def _with_moduli(job: Job, name: str, material: dict[str, Any]) -> None:
    """Tables of moduli by the long-term ones: Re ωg* = G_loss/G, Im ωg* = 1 - G_storage/G (Abaqus
    Analysis User's Guide, frequency domain viscoelasticity)."""
    rows = np.array(material["viscoelastic"].pop("table"))
    if not {"E", "nu"} <= set(material) or material["viscoelastic"]:
        raise BodyError(
            f"{job.path}: *VISCOELASTIC, FREQUENCY=TABULAR of {name}: it goes with an isotropic "
            "*ELASTIC of long-term moduli"
        )
    if not rows[:, :4].any():  # nothing relaxes
        del material["viscoelastic"]
        return
    E, nu = material.pop("E"), material.pop("nu")

    def table(modulus: float, columns: Floats) -> Any:
        if not columns.any():
            return modulus
        return {
            "hz": rows[:, 4].tolist(),
            "storage": (modulus * (1 - columns[:, 1])).tolist(),
            "loss": (modulus * columns[:, 0]).tolist(),
        }

    if np.array_equal(rows[:, :2], rows[:, 2:4]):
        material["nu"], material["viscoelastic"]["table"] = nu, table(E, rows[:, :2])
        return
    shear, bulk = E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu))
    parts = {"shear": table(shear, rows[:, :2]), "bulk": table(bulk, rows[:, 2:4])}
    material["viscoelastic"]["table"] = parts


def materials_of(job: Job) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    name = ""
    for card in job.model:
        if card.keyword == "MATERIAL":
            name = card.options.get("NAME", "").upper()
            found[name] = {}
        elif card.keyword == "ELASTIC" and name:
            found[name].update(_elastic(job, card))
            if card.options.get("MODULI", "").upper() == "INSTANTANEOUS":
                found[name].setdefault("viscoelastic", {})["moduli"] = "instantaneous"
        elif card.keyword == "VISCOELASTIC" and name:
            found[name].setdefault("viscoelastic", {}).update(_relaxation(job, card))
        elif card.keyword == "DENSITY" and name:
            found[name]["rho"] = _numbers(job, card, 1)[0]
        elif card.keyword == "EXPANSION" and name:
            ortho = card.options.get("TYPE", "ISO").upper() == "ORTHO"
            with contextlib.suppress(BodyError):  # a temperature load will miss it
                values = _numbers(job, card, 3 if ortho else 1)
                found[name]["expansion"] = values if ortho else values[0]
    for name, material in found.items():
        relaxing = material.get("viscoelastic", {})
        if "table" in relaxing:
            _with_moduli(job, name, material)
        elif relaxing and "prony" not in relaxing:
            del material["viscoelastic"]  # *ELASTIC, MODULI of what does not relax
    return found


def laminas_of(job: Job) -> set[str]:
    """Materials whose moduli are those of a plane (TYPE=LAMINA)."""
    found, name = set(), ""
    for card in job.model:
        if card.keyword == "MATERIAL":
            name = card.options.get("NAME", "").upper()
        elif card.keyword == "ELASTIC" and card.options.get("TYPE", "").upper() == "LAMINA":
            found.add(name)
    return found


@dataclass(frozen=True)
class Orientation:
    """Axes of a material.

    Attributes
    ----------
    axes : (3, 3) array
        In rows; of a cylindrical one a point of its axis, the axis, and zeros.
    is_cylindrical : bool
        They are those outward, around and along the axis.
    of_elements : Distribution or None
        Points a and b of each element, as in *ORIENTATION, instead of ``axes``.
    about, angle : int, float
        Turned about one of them, from 0, by an angle [rad].
    """

    axes: Floats
    is_cylindrical: bool = False
    of_elements: Distribution | None = None
    about: int = 0
    angle: float = 0.0

    @property
    def varies(self) -> bool:
        """Whether elements have axes of their own."""
        return self.is_cylindrical or self.of_elements is not None

    def at(self, places: Floats, where: str, labels: Sequence[int] = ()) -> Floats:
        """At places (E, 3), in elements with labels if these matter: (E, 3, 3).

        Raises
        ------
        BodyError
            For a place on the axis, and an element without axes.
        """
        axes = np.broadcast_to(self.axes, (len(places), 3, 3)).copy()
        if self.is_cylindrical:
            axes = cylindrical(places, self.axes[0], self.axes[1], where)
        if self.of_elements is not None:
            axes = rectangular(self.of_elements.at(labels, where), where)
        i, j = (self.about + 1) % 3, (self.about + 2) % 3
        c, s = np.cos(self.angle), np.sin(self.angle)
        axes[:, i], axes[:, j] = (
            c * axes[:, i] + s * axes[:, j],
            c * axes[:, j] - s * axes[:, i],
        )
        return axes


def orientations_of(job: Job) -> dict[str, Orientation]:
    """Those of *ORIENTATION, by name.

    Raises
    ------
    BodyError
        For systems other than rectangular and cylindrical ones, and axes without a direction.
    """
    found: dict[str, Orientation] = {}
    distributions = distributions_of(job)
    for card in (card for card in job.model if card.keyword == "ORIENTATION"):
        name = card.options.get("NAME", "").upper()
        where = f"{job.path}: *ORIENTATION, NAME={name}"
        system = card.options.get("SYSTEM", "RECTANGULAR").upper()
        if system not in ("RECTANGULAR", "R", "CYLINDRICAL", "C"):
            raise BodyError(
                f"{where}: only SYSTEM=RECTANGULAR and CYLINDRICAL are followed; --run-ccx knows "
                "others"
            )
        if others := sorted(set(card.options) - {"NAME", "SYSTEM", "DEFINITION"}):
            raise BodyError(f"{where}: {others[0]} is not supported by --assemble: take --run-ccx")
        rows = [[word for word in row if word] for row in card.words()]
        named = None
        if rows and len(rows[0]) == 1:
            named = distributions.get(rows[0][0].upper())
            if named is None:
                raise BodyError(f"{where}: there is no *DISTRIBUTION, NAME={rows[0][0]}")
        try:
            numbers = [] if named else [float(word) for word in rows[0]]
            points = np.array(numbers or [1.0, 0, 0, 0, 1, 0])
            if len(points) < 6:
                raise ValueError
            turn = [float(word) for word in rows[1]] if len(rows) > 1 else []
        except (ValueError, IndexError):
            raise BodyError(f"{where}: expected six numbers, or a *DISTRIBUTION") from None
        about, angle = 0, 0.0
        if turn:
            if turn[0] not in (1, 2, 3):
                raise BodyError(f"{where}: turned about axis {turn[0]:g}, which must be 1, 2 or 3")
            about = int(turn[0]) - 1
            angle = float(np.radians(turn[1])) if len(turn) > 1 else 0.0
        if named is not None:
            if system.startswith("C"):
                raise BodyError(f"{where}: a *DISTRIBUTION of cylindrical systems is not supported")
            found[name] = Orientation(np.eye(3), False, named, about, angle)
            continue
        if system.startswith("C"):
            a, b = points[:3], points[3:6]
            if not np.linalg.norm(b - a) > 0:
                raise BodyError(f"{where}: its axes have no direction")
            found[name] = Orientation(np.array([a, b - a, 0 * a]), True, None, about, angle)
            continue
        axes = rectangular(points[None, : 9 if len(points) >= 9 else 6], where)[0]
        found[name] = Orientation(axes, False, None, about, angle)
    return found
