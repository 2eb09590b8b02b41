"""Natural modes of a reduced body on its mesh, and how they compare with measured ones.

Universal files, as text: nodes by dataset 2411 (or 15) in the units of dataset 164 (without: SI),
real normal modes by dataset 55; of measured ones complex modes too.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.spatial
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError, Floats, errors_of, written_aside
from flexgram.body.universal import dataset, datasets
from flexgram.model.damped_modes import losses, modes_of
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.kinds import ports_of
from flexgram.model.reduced import ReducedBody

#: Dataset 55: structural model; analyses; three translations; displacement; number types.
STRUCTURAL, NORMAL, COMPLEX_MODE = 1, 2, 3
TRANSLATIONS, DISPLACEMENT, REAL, COMPLEX = 2, 8, 2, 5
#: Three translations, or with rotations.
VECTORS = (TRANSLATIONS, 3)
#: Of tests also unknown, velocity, acceleration: in a mode all are alike.
MOTIONS = (0, DISPLACEMENT, 11, 12)
#: A frequency below this share of the largest is that of a rigid mode: the root of rounding.
ROUNDING = 5e-8
#: A MAC below this names no partner.
ALIKE = 0.3
#: A node of a test farther from every node of the mesh than this share of its size is another's.
FAR = 0.05


@dataclass
class ModeShapes:
    """Modes at nodes.

    Attributes
    ----------
    hertz, damping : (k,) arrays
        Natural frequencies, and damping ratios (1: critical).
    shapes : (k, N, 3) array
        Translations; of the body's modes real, for a modal mass of 1 kg.
    labels : (N,) int array
        Of the nodes; of a mesh that flexgram assembles they count from 1.
    points : (N, 3) array
        [m]; NaN where a file does not say.
    coupled : float
        Largest damping between two modes relative to that of a mode; where it is not nearly zero, a
        damping matrix couples them: frequencies are those without damping, dampings the diagonal.
    effective_mass : (k, 3) array, optional
        [kg] in x, y, z, by the body's inputs of acceleration (``type: acceleration``); their sums
        over all modes of a held body are its mass, less what its supports hold. None without.
    """

    hertz: Floats
    damping: Floats
    shapes: NDArray[Any]
    labels: NDArray[np.int64]
    points: Floats
    coupled: float = 0.0
    effective_mass: Floats | None = None


def effective_masses(model: ReducedBody, Q: Floats) -> Floats | None:
    """Effective masses (k, 3) of modes Q (m, k) of unit mass: squares of their participation
    factors φᵀM r, which are φᵀB of inputs of acceleration in x, y, z. None without such inputs.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> Q = flexgram.model.modes.natural_modes(rom.K, rom.M)[1]
    >>> effective_masses(rom, Q).shape == (rom.order, 3)
    True
    """
    inputs = model.system.inputs
    columns = {
        name[-1]: k for k, name in enumerate(inputs) if k in ports_of(inputs, "acceleration")
    }
    if set(columns) != set("xyz"):
        return None
    factors = Q.T @ model.system.B[:, [columns[axis] for axis in "xyz"]]
    return np.asarray(factors**2)


def mode_shapes(
    model: ReducedBody,
    body: str | Path | None = None,
    last_hz: float | None = None,
    *,
    at_nodes: bool = True,
) -> ModeShapes:
    """Elastic normal modes of a reduced body, up to the end of its band.

    The claim is of H at the ports: a mode that they hardly drive or show may be missing, or off.

    Parameters
    ----------
    model : ReducedBody
    body : str or Path, optional
        Body file with the mesh; default: the one that was reduced. Without a mesh the nodes are
        those that have degrees of freedom.
    last_hz : float, optional
        Up to here; beyond the band modes are those of the reduced body only.
    at_nodes : bool
        Whether the shapes are wanted; without, there are no nodes.

    Raises
    ------
    BodyError
        For a body without coordinates, whose body file is not there, or without modes.

    Examples
    --------
    >>> modes = mode_shapes(flexgram.ReducedModel.load("rack.rom.h5"))
    >>> print(f"{modes.hertz[0]:.1f} Hz")
    105.5 Hz
    """
    last = 2 * np.pi * last_hz if last_hz is not None else float(model.claim.band[-1])
    squares, Q = modes_of(model.system)
    omega = np.sqrt(np.maximum(squares, 0))
    rigid = model.frame.rigid_modes
    if not rigid:  # a basis that mixes them with others (pod): those that are nothing but rounding
        largest = omega[np.isfinite(omega)].max(initial=0)  # others have no mass
        rigid = int(np.sum(omega < ROUNDING * largest))
    chosen = [k for k in range(rigid, len(omega)) if omega[k] <= last]
    if not chosen:
        first = f"; the first is at {omega[rigid] / (2 * np.pi):.5g} Hz" if rigid < len(Q) else ""
        raise BodyError(f"no elastic mode up to {last / (2 * np.pi):.5g} Hz{first}")
    omega, Q = omega[chosen], Q[:, chosen]
    D = Q.T @ model.system.D @ Q
    lost = losses(model.system, omega**2, Q)
    damping = np.diag(D) / (2 * omega) + 0.5 * (model.system.eta + lost)
    between = np.abs(D - np.diag(np.diag(D))).max(initial=0)
    coupled = float(between / max(np.abs(np.diag(D)).max(), 1e-300)) if between else 0.0
    if at_nodes:
        labels, points, shapes = _at_nodes(model, body, Q.T)
    else:
        labels, points, shapes = np.empty(0, int), np.empty((0, 3)), np.empty((len(omega), 0, 3))
    masses = effective_masses(model, Q)
    return ModeShapes(omega / (2 * np.pi), damping, shapes, labels, points, coupled, masses)


def _at_nodes(
    model: ReducedBody, body: str | Path | None, q: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Labels, places and motion: of the mesh, or of a body without one of the nodes it has."""
    stored = model.provenance.body
    if body is None and (not stored or (not Path(stored).suffix and not Path(stored).exists())):
        return model.basis.nodal(q)  # handed over in memory
    path = body_of(model, body)
    with errors_of(path), h5py.File(path) as file:
        assembled, imported = "mesh" in file, "geometry/blocks" in file
    if not assembled and not imported:
        return model.basis.nodal(q)
    geometry = Geometry.load(path)
    return geometry.labels + int(assembled), geometry.points, geometry.motion(model, q)


def write_csv(modes: ModeShapes, path: str | Path) -> None:
    """Frequencies [Hz] and damping ratios.

    Examples
    --------
    >>> write_csv(mode_shapes(flexgram.ReducedModel.load("rack.rom.h5")), "modes.csv")
    """
    with written_aside(path) as place, place.open("w", newline="") as file:
        table = csv.writer(file)
        masses = modes.effective_mass
        more = [] if masses is None else [f"effective mass {axis} [kg]" for axis in "xyz"]
        table.writerow(["mode", "Hz", "damping ratio", *more])
        for k, (f, zeta) in enumerate(zip(modes.hertz, modes.damping, strict=True)):
            own = [] if masses is None else [repr(float(x)) for x in masses[k]]
            table.writerow([k + 1, repr(float(f)), repr(float(zeta)), *own])


def write_universal(modes: ModeShapes, path: str | Path, about: str = "") -> None:
    """Dataset 164 (SI), 2411 (nodes), and 55 of each mode, five digits after the point.

    Examples
    --------
    >>> write_universal(mode_shapes(flexgram.ReducedModel.load("rack.rom.h5")), "modes.unv")
    """
    lines = dataset(
        164,
        [
            f"{1:10d}{'SI: Meter (newton)':<20}{2:10d}",
            f"{1.0:25.16E}{1.0:25.16E}{1.0:25.16E}".replace("E", "D"),
            f"{273.15:25.16E}".replace("E", "D"),
        ],
    )
    lines += dataset(
        2411,
        [
            line
            for label, point in zip(modes.labels, modes.points, strict=True)
            for line in (
                f"{label:10d}{1:10d}{1:10d}{11:10d}",
                "".join(f"{x:25.16E}" for x in point).replace("E", "D"),
            )
        ],
    )
    for k, (f, zeta, shape) in enumerate(
        zip(modes.hertz, modes.damping, modes.shapes, strict=True), 1
    ):
        own = [
            about[:80] or "NONE",
            "flexgram",
            "NONE",
            f"mode {k}",
            f"{'Mode':<10}{k:10d}{'Frequency':<10}{f:13.5E}",
            "".join(f"{x:10d}" for x in (STRUCTURAL, NORMAL, TRANSLATIONS, DISPLACEMENT, REAL, 3)),
            "".join(f"{x:10d}" for x in (2, 4, 1, k)),
            "".join(f"{x:13.5E}" for x in (f, 1.0, zeta, 0.0)),
        ]
        for label, moved in zip(modes.labels, shape, strict=True):
            own += [f"{label:10d}", "".join(f"{x:13.5E}" for x in moved)]
        lines += dataset(55, own)
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")


def _numbers(line: str, width: int = 13) -> list[float]:
    words = (line[k : k + width] for k in range(0, len(line.rstrip()), width))
    return [float(word.upper().replace("D", "E")) for word in words if word.strip()]


def _places(number: int, lines: Sequence[str]) -> dict[int, list[float]]:
    """Nodes of a dataset 15, 781 or 2411."""
    lines = [line for line in lines if line.strip()]
    if number == 15:
        return {int(line[:10]): _numbers(line[40:]) for line in lines}
    return {
        int(label[:10]): _numbers(point, 25)
        for label, point in zip(lines[::2], lines[1::2], strict=True)
    }


def _mode(lines: Sequence[str]) -> tuple[float, float, dict[int, list[complex]]] | None:
    """Frequency, damping and translations at nodes of a dataset 55; none if it is no mode."""
    kinds = [int(lines[5][k : k + 10]) for k in range(0, 60, 10)]
    if kinds[1] not in (NORMAL, COMPLEX_MODE) or kinds[3] not in MOTIONS:
        return None
    if kinds[2] not in VECTORS:
        return None  # scalars and tensors
    if kinds[4] not in (REAL, COMPLEX):
        raise BodyError(
            f"a mode of dataset 55 has numbers of type {kinds[4]}: 2 (real) and 5 "
            "(complex) are read"
        )
    told = _numbers(lines[7])
    if kinds[1] == NORMAL:
        hertz, damping = told[0], told[2] + 0.5 * told[3]
    else:
        pole = abs(complex(told[0], told[1]))
        hertz, damping = pole / (2 * np.pi), -told[0] / pole if pole else 0.0
    parts = 2 if kinds[4] == COMPLEX else 1
    per_node = 1 + -(-kinds[5] * parts // 6)
    moved = {}
    for k in range(8, len(lines) - per_node + 1, per_node):
        values = [x for line in lines[k + 1 : k + per_node] for x in _numbers(line)]
        if parts == 2:
            values = [complex(*values[i : i + 2]) for i in range(0, len(values), 2)]  # type: ignore[misc]
        moved[int(lines[k][:10])] = [complex(x) for x in (values + [0.0] * 3)[:3]]
    return hertz, damping, moved


def read_universal(path: str | Path) -> ModeShapes:
    """The modes of a universal file and where its nodes are; all else is passed over.

    Raises
    ------
    BodyError
        If there is none, or one that cannot be read.

    Examples
    --------
    >>> modes = mode_shapes(flexgram.ReducedModel.load("rack.rom.h5"))
    >>> write_universal(modes, "test.unv")
    >>> bool(np.allclose(read_universal("test.unv").hertz, modes.hertz, rtol=1e-5))
    True
    """
    places: dict[int, list[float]] = {}
    found, there, length = [], set(), 1.0
    with errors_of(path):
        for number, lines in datasets(path):
            there.add(number)
            if number == 164:
                length = _numbers(lines[1], 25)[0]  # of the file's units in a metre
                if not (np.isfinite(length) and length > 0):
                    raise BodyError(f"dataset 164: {length:g} units of length in a metre")
            elif number in (15, 781, 2411):
                places |= _places(number, lines)
            elif number == 55:
                mode = _mode(lines)
                found += [mode] if mode is not None else []
    if not found:
        numbers = ", ".join(str(number) for number in sorted(there)) or "none"
        raise BodyError(
            f"{path}: no mode shape (dataset 55, normal or complex modes of type 2 or "
            f"3, translations); its datasets: {numbers}"
        )
    rows = {label: k for k, label in enumerate(sorted({x for *_, moved in found for x in moved}))}
    shapes = np.zeros((len(found), len(rows), 3), dtype=complex)
    for k, (_, _, moved) in enumerate(found):
        for label, motion in moved.items():
            shapes[k, rows[label]] = motion
    hertz, damping = (np.array([mode[j] for mode in found], dtype=float) for j in (0, 1))
    nowhere = [float("nan")] * 3
    with errors_of(path):
        points = np.array([places.get(label, nowhere) for label in rows]).reshape(-1, 3) / length
    if not all(np.isfinite(x).all() for x in (hertz, damping, shapes)) or np.isinf(points).any():
        raise BodyError(f"{path}: a number of a mode or of a node is not finite")
    return ModeShapes(hertz, damping, shapes, np.array(list(rows), dtype=np.int64), points)


def mac(a: ArrayLike, b: ArrayLike) -> Floats:
    """Modal assurance criterion (Allemang and Brown 1982) of shapes (k, n) and (l, n): (k, l).

    Examples
    --------
    >>> mac([[1.0, 0.0], [1.0, 1.0]], [[2.0, 0.0]]).round(2)
    array([[1. ],
           [0.5]])
    """
    x, y = (np.asarray(shapes, dtype=complex) for shapes in (a, b))
    sizes = np.outer(np.sum(np.abs(x) ** 2, axis=1), np.sum(np.abs(y) ** 2, axis=1))
    likeness: Floats = np.abs(x.conj() @ y.T) ** 2 / np.where(sizes > 0, sizes, 1.0)
    return likeness


@dataclass
class Comparison:
    """Measured modes beside those of a body.

    Attributes
    ----------
    mac : (k, l) array
        Of the measured ones with the body's, over the directions that the test moved.
    partner : (k,) int array
        The body's mode most like each.
    nodes : int
        Of the test.
    farthest : float
        Of a node of the test from its node of the mesh [m]; NaN: found by labels.
    measured, modes : ModeShapes
    """

    mac: Floats
    partner: NDArray[np.int64]
    nodes: int
    farthest: float
    measured: ModeShapes
    modes: ModeShapes

    def words(self) -> list[str]:
        """A line on the nodes, and one for each measured mode."""
        by = (
            "found by their labels"
            if np.isnan(self.farthest)
            else f"at most {self.farthest:.3g} m from a node of the mesh"
        )
        lines = [f"{self.nodes} nodes of the test, {by}"]
        for k, other in enumerate(self.partner):
            f, own = self.measured.hertz[k], self.modes.hertz[other]
            if not self.mac[k, other] >= ALIKE:
                lines.append(
                    f"measured mode {k + 1}, {f:.5g} Hz: no mode is like it (MAC at most "
                    f"{self.mac[k, other]:.2f}, mode {other + 1})"
                )
                continue
            away = f" ({100 * (own / f - 1):+.2g} %)" if f > 0 else ""
            lines.append(
                f"measured mode {k + 1}, {f:.5g} Hz, damping "
                f"{100 * self.measured.damping[k]:.3g} %: mode {other + 1}, {own:.5g} Hz{away}, "
                "damping "
                f"{100 * self.modes.damping[other]:.3g} %, MAC {self.mac[k, other]:.3f}"
            )
        return lines


def compare(measured: ModeShapes, modes: ModeShapes) -> Comparison:
    """Measured modes with those of a body, at the nodes of the test.

    Nodes are found by their places, in the axes and metres of the body; without places by labels.

    Raises
    ------
    BodyError
        If a node of the test is not one of the mesh.

    Examples
    --------
    >>> modes = mode_shapes(flexgram.ReducedModel.load("rack.rom.h5"))
    >>> found = compare(modes, modes)
    >>> found.partner[:3]
    array([0, 1, 2])
    """
    placed = np.isfinite(measured.points).all(axis=1)
    if placed.any() and not placed.all():
        label = measured.labels[int(np.argmin(placed))]
        raise BodyError(f"the file says where nodes of the test are, but not of node {label}")
    if placed.all():
        far, at = scipy.spatial.cKDTree(modes.points).query(measured.points)
        size = float(np.ptp(modes.points, axis=0).max())
        farthest = float(np.max(far, initial=0.0))
        if farthest > FAR * size:
            label = measured.labels[int(np.argmax(far))]
            raise BodyError(
                f"node {label} of the test is {farthest:.3g} m from every node of the mesh, which "
                f"is {size:.3g} m large: the same axes, in metres?"
            )
    else:
        row = {int(label): k for k, label in enumerate(modes.labels)}
        missing = [int(label) for label in measured.labels if int(label) not in row]
        if missing:
            raise BodyError(
                f"node {missing[0]} of the test is no node of the mesh, and the file "
                "does not say where it is (dataset 15 or 2411)"
            )
        at, farthest = np.array([row[int(label)] for label in measured.labels]), float("nan")
    x = measured.shapes.reshape(len(measured.shapes), -1)
    y = modes.shapes[:, at].reshape(len(modes.shapes), -1)
    used = np.any(x != 0, axis=0)  # a test measures some directions only
    if not used.any():
        raise BodyError("the measured modes are zero")
    likeness = mac(x[:, used], y[:, used])
    return Comparison(
        likeness, likeness.argmax(axis=1), len(measured.labels), farthest, measured, modes
    )


def picture(comparison: Comparison) -> Any:
    """The matrix of the MAC, with its numbers where there are few.

    Examples
    --------
    >>> modes = mode_shapes(flexgram.ReducedModel.load("rack.rom.h5"))
    >>> figure = picture(compare(modes, modes))
    """
    from matplotlib.figure import Figure

    k, n = comparison.mac.shape
    figure = Figure(figsize=(2.2 + 0.45 * n, 1.6 + 0.45 * k), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(comparison.mac, vmin=0, vmax=1, cmap="Blues")
    for i in range(k):
        for j in range(n):
            value = comparison.mac[i, j]
            if value >= 0.05:
                axes.text(
                    j,
                    i,
                    f"{value:.2f}",
                    ha="center",
                    va="center",
                    fontsize=7,
                    color="white" if value > 0.6 else "black",
                )
    axes.set_xticks(range(n), [f"{f:.4g}" for f in comparison.modes.hertz], rotation=90)
    axes.set_yticks(range(k), [f"{f:.4g}" for f in comparison.measured.hertz])
    axes.set(xlabel="modes of the reduced body [Hz]", ylabel="measured [Hz]")
    figure.colorbar(image, label="MAC")
    return figure
