"""Drawings of a body's mesh: its interfaces and modes, and its stress; of ``figures``."""

from __future__ import annotations

import base64
import io
import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.cm
import matplotlib.colors
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure  # not pyplot: the caller's backend stays the caller's
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats, Ints
from flexgram.body.stress import von_mises
from flexgram.model.damped_modes import NaturalModes
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.recovery import stress_at_nodes
from flexgram.model.reduced import ReducedBody
from flexgram.pictures.scene import ANGLE, ASPECT, DIRECTION, FILL, MARKS, PLAIN, Scene


def elastic_modes(model: ReducedBody, count: int) -> tuple[Floats, Floats]:
    """Frequencies [Hz] and shapes (k, m) of the lowest modes of the reduced body that are not
    rigid, without damping.

    Examples
    --------
    >>> hertz, shapes = elastic_modes(flexgram.ReducedModel.load("rack.rom.h5"), 3)
    >>> hertz.round(1)
    array([105.5, 176.6, 189. ])
    """
    return NaturalModes.of(model).elastic(count)


def shapes(model: ReducedBody, body: str | Path | None = None, count: int = 5) -> Figure:
    """The mesh with its interfaces, and the lowest elastic modes of the reduced body.

    Examples
    --------
    >>> figure = shapes(flexgram.ReducedModel.load("rack.rom.h5"), count=2)
    """
    geometry, triangles = _surface(model, body)
    marked = {
        name: triangles[np.isin(triangles, nodes).all(axis=1)]
        for name, nodes in geometry.interfaces.items()
    }
    is_closed = _is_closed(triangles)
    triangles = triangles[:: len(triangles) // 20000 + 1]  # a picture needs no more
    hz, modes = elastic_modes(model, count)
    motion = geometry.motion(model, modes) if len(modes) else np.empty((0, 0, 3))
    used = np.unique(triangles)
    size = float(np.ptp(geometry.points[used], axis=0).max())
    columns = 3
    rows = -(-(1 + len(modes)) // columns)
    height = 0.5 + np.clip(3.2 * _height_by_width(geometry.points[used]), 1.2, 4.5)
    figure = Figure(figsize=(3.4 * columns, height * rows), layout="constrained")
    for place in range(1 + len(modes)):
        axes = figure.add_subplot(rows, columns, place + 1)
        if place:
            field = motion[place - 1]
            scale = 0.12 * size / max(np.abs(field[used]).max(), 1e-300)
            amount = np.linalg.norm(field[triangles].mean(axis=1), axis=1)
            color = matplotlib.colormaps["viridis"](amount / max(amount.max(), 1e-300))
            _draw(axes, (geometry.points + scale * field)[triangles], color, is_closed)
        else:
            plain = matplotlib.colors.to_rgba("#9ecae1")
            _draw(axes, geometry.points[triangles], plain, is_closed)
            _mark(axes, geometry, marked)
        title = f"{hz[place - 1]:.5g} Hz" if place else "body and interfaces"
        axes.set_title(title, fontsize=9)
    return figure


def _surface(model: ReducedBody, body: str | Path | None) -> tuple[Geometry, Any]:
    geometry = Geometry.load(body_of(model, body))
    triangles = geometry.surface()
    if not len(triangles):
        raise BodyError("the body has no solid elements to draw")
    return geometry, triangles


@dataclass(frozen=True)
class Eye:
    """Where a picture is seen from.

    Attributes
    ----------
    right, up, near : (3,) arrays
        Directions of the picture in space: to the right, up, and towards who looks.
    distance : float
        Of the eye from the origin [m]; infinite: parallel rays.
    """

    right: Floats
    up: Floats
    near: Floats
    distance: float = np.inf

    @classmethod
    def towards(cls, near: ArrayLike, distance: float = np.inf) -> Eye:
        """With the z axis upright; ``near`` has any length and is not along z."""
        unit = np.asarray(near, dtype=float) / np.linalg.norm(near)
        right = np.cross([0.0, 0.0, 1.0], unit)
        right /= np.linalg.norm(right)
        return cls(right, np.cross(unit, right), unit, distance)

    @classmethod
    def fitting(cls, near: ArrayLike, half: Floats, tangent: float, aspect: float) -> Eye:
        """As near as a box of half sides ``half`` about the origin allows, so that it fills the
        ``tangent`` of the angle of view upwards and ``aspect`` times as much to the right; as in
        ``page/scene.js``."""
        eye = cls.towards(near)
        corners = half * np.array(list(itertools.product((-1, 1), repeat=3)))
        sizes = np.maximum(np.abs(corners @ eye.up), np.abs(corners @ eye.right) / aspect)
        distance = float((corners @ eye.near + sizes / tangent).max())
        radius = float(np.linalg.norm(half)) or 0.5
        return replace(eye, distance=max(distance, 1.2 * radius))

    def flat(self, points: Floats) -> Floats:
        """(…, 3) points in space -> (…, 2) in the picture, in the scale of the origin's depth."""
        scale = 1 / (1 - points @ self.near / self.distance)
        return np.stack([scale * (points @ self.right), scale * (points @ self.up)], axis=-1)

    def faces(self, middles: Floats, normals: Floats) -> Any:
        """Whether each face turns to the eye."""
        return np.einsum("ij,ij->i", normals, self.near - middles / self.distance) > 0


#: Azimuth -60, elevation 30 degrees.
_EYE = Eye.towards([np.sqrt(3) / 4, -0.75, 0.5])


def _is_closed(triangles: Ints) -> bool:
    """Whether they are the surface of solids alone: each edge is that of a neighbour, reversed."""
    first, last = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    count = int(triangles.max()) + 1
    return np.array_equal(np.sort(first * count + last), np.sort(last * count + first))


def _height_by_width(points: Floats) -> float:
    across, up = np.ptp(_EYE.flat(points), axis=0)
    return float(up / max(across, 1e-300))


def _draw(
    axes: Any,
    corners: Floats,
    color: Any,
    is_closed: bool = False,
    shade: float = 0.35,
    eye: Eye = _EYE,
) -> None:
    """Triangles (k, 3, 3), the far ones first; those that turn from the light are darker, and of a
    closed surface those that turn from who looks are left out."""
    color = np.array(np.broadcast_to(color, (len(corners), 4)))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if is_closed:
        seen = eye.faces(corners.mean(axis=1), normal)
        corners, color, normal = corners[seen], color[seen], normal[seen]
    area = np.linalg.norm(normal, axis=1)
    light = eye.near + 0.3 * eye.up - 0.4 * eye.right
    facing = np.abs(normal @ light) / np.maximum(area, 1e-300) / np.linalg.norm(light)
    color[:, :3] *= (1 - shade + shade * facing)[:, None]
    order = np.argsort(corners.mean(axis=1) @ eye.near)
    axes.add_collection(
        PolyCollection(eye.flat(corners[order]), facecolor=color[order], edgecolor="face", lw=0.4)
    )
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()


def stress(
    model: ReducedBody,
    q: ArrayLike,
    body: str | Path | None = None,
    magnify: float | None = None,
    u: ArrayLike | None = None,
) -> Figure:
    """Von Mises stress on the surface of the deformed mesh, of shells the larger of both sides.

    Parameters
    ----------
    model : ReducedBody
    q : (m,) array
        Generalised coordinates.
    body : str or Path, optional
        Body file; default: the one that was reduced.
    magnify : float, optional
        Factor of the deformation; default: a twentieth of the body's size.
    u : (n_in,) array, optional
        Inputs at that moment: needed if one of them is a temperature.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> figure = stress(rom, np.eye(rom.order)[0])
    """
    geometry, triangles = _surface(model, body)
    is_closed = _is_closed(triangles)
    triangles = triangles[:: len(triangles) // 40000 + 1]
    field = geometry.motion(model, q)[0]
    used = np.unique(triangles)
    if magnify is None:
        size = float(np.ptp(geometry.points[used], axis=0).max())
        magnify = 0.05 * size / max(float(np.abs(field[used]).max()), 1e-300)
    of_nodes = von_mises(stress_at_nodes(model, q, body, u, "larger")[0])
    amount = 1e-6 * of_nodes[triangles].max(axis=1)  # a peak at one node is seen
    height = np.clip(0.3 + 5 * _height_by_width(geometry.points[used]), 2.2, 6)
    figure = Figure(figsize=(6.2, height), layout="constrained")
    axes = figure.subplots()
    scale = matplotlib.cm.ScalarMappable(
        matplotlib.colors.Normalize(0, 1e-6 * float(np.nanmax(of_nodes))), "turbo"
    )
    color = scale.to_rgba(np.nan_to_num(amount))
    color[np.isnan(amount)] = (0.8, 0.8, 0.8, 1.0)
    _draw(axes, (geometry.points + magnify * field)[triangles], color, is_closed, shade=0.15)
    figure.colorbar(scale, ax=axes, shrink=0.8, label="von Mises stress [MPa]")
    return figure


#: So many interfaces have their names in a still picture.
FEW = 12


def still(scene: Scene) -> str:
    """The body of a page at rest. It is shown until the page's script draws, and where none can.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    str
        Address with the picture inside.

    Examples
    --------
    >>> still(Scene.of(Geometry.load("rack.h5")))[:22]
    'data:image/png;base64,'
    """
    low, high = scene.points.min(axis=0), scene.points.max(axis=0)
    centre, half = 0.5 * (low + high), np.tan(np.radians(ANGLE / 2))
    eye = Eye.fitting(DIRECTION, 0.5 * (high - low), FILL * half, ASPECT)
    points = scene.points - centre
    figure = Figure(figsize=(4.8 * ASPECT, 4.8), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    if len(scene.triangles):
        plain = matplotlib.colors.to_rgba(PLAIN)
        _draw(axes, points[scene.triangles], plain, _is_closed(scene.triangles), eye=eye)
    axes.add_collection(LineCollection(eye.flat(points[scene.lines]), color=PLAIN, lw=1.5))
    marked = scene.marked()
    for k, (name, (_, at)) in enumerate(marked.items()):
        flat, color = eye.flat(at - centre), MARKS[k % len(MARKS)]
        axes.plot(*flat.T, "s", ms=2.5, mew=0, color=color)
        if len(flat) and len(marked) <= FEW:
            box = {"facecolor": "white", "edgecolor": color, "alpha": 0.9, "pad": 2}
            axes.text(*flat.mean(axis=0), name, size=8, bbox=box, clip_on=True)
    half *= eye.distance
    axes.set(xlim=(-ASPECT * half, ASPECT * half), ylim=(-half, half))
    axes.set_axis_off()
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()


def _mark(axes: Any, geometry: Geometry, marked: dict[str, Any]) -> None:
    """Faces of each interface in a colour, seen through the body, and its nodes."""
    for k, (name, nodes) in enumerate(geometry.interfaces.items()):
        color = f"C{1 + k % 9}"
        faces = marked[name]
        if len(faces):
            flat = _EYE.flat(geometry.points[faces])
            axes.add_collection(PolyCollection(flat, facecolor=color, alpha=0.6, zorder=10))
        size = 1 if len(faces) else 4
        axes.plot(
            *_EYE.flat(geometry.points[nodes]).T, ".", ms=size, color=color, label=name, zorder=11
        )
    if geometry.interfaces:
        axes.legend(fontsize=7, loc="best", markerscale=4)
