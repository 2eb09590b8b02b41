"""Mesh of a body file with the motion of its nodes, for pictures and exporters."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats, Ints, errors_of, index_of
from flexgram.body.constraints import Constraints
from flexgram.body.faces import CORNERS, faces_of, loose_shells, outer
from flexgram.model.reduced import ReducedBody


@dataclass
class Geometry:
    """Nodes and elements of a body.

    Attributes
    ----------
    points : (N, 3) array
        [m]
    labels : (N,) int array
        As ``ReducedBody.node`` counts them.
    blocks : list of (str, int array)
        Meshio type and indices into ``points``.
    followers : dict
        Rigid interface -> (reference position [m], indices of the nodes that follow it).
    interfaces : dict
        Name -> indices of its nodes, for marking them.
    constraints : Constraints, optional
        What dependent dofs follow, with indices into ``points``.
    supports : dict
        Name -> indices of its nodes, for marking them.
    """

    points: Floats
    labels: Ints
    blocks: list[tuple[str, Ints]]
    followers: dict[str, tuple[Floats, Ints]] = field(default_factory=dict)
    interfaces: dict[str, Ints] = field(default_factory=dict)
    constraints: Constraints | None = None
    supports: dict[str, Ints] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | Path) -> Geometry:
        """Read the mesh of a body file (of a mesh, or imported with a deck).

        Raises
        ------
        BodyError
            If the body has no mesh.
        """
        path = Path(path)
        if not path.exists():
            raise BodyError(f"{path}: no such file (the body file is needed for its mesh)")
        with errors_of(path), h5py.File(path) as file:
            followers: dict[str, tuple[Floats, Ints]] = {}
            interfaces: dict[str, Ints] = {}
            if "mesh" in file:
                group = file["mesh/blocks"]
                blocks = [(str(g.attrs["type"]), g["connectivity"][:]) for g in group.values()]
                points = file["mesh/points"][:]
                for name, item in file["interfaces"].items() if "interfaces" in file else ():
                    interfaces[name] = item["nodes"][:]
                    if str(item.attrs["coupling"]) == "rigid":
                        followers[name] = (np.array(item.attrs["position"]), item["nodes"][:])
                constraints = Constraints.of(file)
                labels = np.arange(len(points))
                supports = {name: of["nodes"][:] for name, of in file.get("supports", {}).items()}
                return cls(points, labels, blocks, followers, interfaces, constraints, supports)
            if "geometry/blocks" not in file or "nodes/position" not in file:
                raise BodyError(f"{path}: the body has no mesh (import it with its deck)")
            blocks = [
                (str(g.attrs["type"]), g["connectivity"][:])
                for g in file["geometry/blocks"].values()
            ]
            points = file["nodes/position"][:]
            labels = file["nodes/id"][:] if "nodes/id" in file else np.arange(len(points))
            followers = {
                name: (points[nodes[0]], nodes[1:])
                for name, nodes in (
                    (n, d[:]) for n, d in file.get("geometry/followers", {}).items()
                )
            }
            marked = {name: nodes for name, (_, nodes) in followers.items()}
            for name, item in file.get("geometry/interfaces", {}).items():
                marked.setdefault(name, item[:])
            return cls(points, labels, blocks, followers, marked)

    def motion(self, model: ReducedBody, q: ArrayLike | None = None) -> Floats:
        """Displacements of all nodes [m], (k, N, 3), in generalised coordinates (k, m).

        Nodes inside a rigid interface follow its reference node, dependent dofs what they depend
        on; supported nodes rest.

        Raises
        ------
        BodyError
            For a body without a dof map.
        """
        return self.motion_and_rotation(model, q)[..., :3]

    def motion_and_rotation(self, model: ReducedBody, q: ArrayLike | None = None) -> Floats:
        """Displacements [m] and rotations of all nodes, (k, N, 6); as ``motion``. Nodes without
        rotations have zeros there."""
        basis = model.basis
        basis.expect_places()
        shapes = np.atleast_2d(np.eye(model.order) if q is None else np.asarray(q, dtype=float))
        motion = np.zeros((len(shapes), len(self.points), 6))
        at, known = index_of(self.labels, basis.node)
        away = np.abs(self.points[at[known]] - basis.position[known]).max(initial=0)
        if away > 1e-6 * np.ptp(self.points, axis=0).max():
            raise BodyError(
                "the mesh is not that of the body that was reduced: nodes are elsewhere"
            )
        motion[:, at[known], basis.component[known]] = basis.lift(shapes)[:, known]
        for reference, nodes in self.followers.values():
            six = _six(model, shapes, reference)
            if six is not None:
                arm = self.points[nodes] - reference
                motion[:, nodes, :3] = six[:, None, :3] + np.cross(six[:, None, 3:], arm[None])
                motion[:, nodes, 3:] = six[:, None, 3:]
        if self.constraints is not None and len(self.constraints.dependent):
            node, component = self.constraints.independent.T
            followed = self.constraints.sums(motion[:, node, component])
            node, component = self.constraints.dependent.T
            motion[:, node, component] = followed
        return motion

    def surface(self) -> Ints:
        """Triangles of the outer surface, and of shells, by corner nodes, (T, 3)."""
        own = outer(faces_of([b for b in self.blocks if b[0] not in CORNERS]))
        shells = loose_shells(self.blocks, np.arange(len(self.points)), len(self.points))
        own = np.vstack([own, *(_four(some) for some in shells)])
        square = own[:, 3] != own[:, 0]
        return np.vstack([own[:, :3], own[square][:, [0, 2, 3]]])


def _four(shells: Ints) -> Ints:
    """Corners of shells, (F, 4); the last one of a triangle is its first."""
    corners = 3 if shells.shape[1] in (3, 6) else 4
    return shells[:, [0, 1, 2, 0]] if corners == 3 else shells[:, :4]


def units_of(path: str | Path) -> str:
    """Units of the files that a mesh body was imported from; empty if it does not know."""
    with errors_of(path), h5py.File(path) as file:
        return str(file.attrs.get("units", ""))


def length_unit(path: str | Path) -> tuple[str, float]:
    """For people: the name of a unit of length and its metres, millimetres where the files that a
    body was imported from had these."""
    return ("mm", 1e-3) if units_of(path).startswith("mm") else ("m", 1.0)


def body_of(model: ReducedBody, body: str | Path | None = None) -> str | Path:
    """The body file of a reduced body: as named, where it was, or beside the reduced file.

    Raises
    ------
    BodyError
        If it is not known or not there.
    """
    stored = model.provenance.body
    if body is not None:
        return body
    if not stored:
        raise BodyError("the mesh is in the body file: name it (--body)")
    if " with " in stored:  # couple names all parts
        raise BodyError(f"an assembly ({stored}) has no mesh: take one of its parts")
    beside = model.path.parent / Path(stored).name if model.path is not None else None
    if not Path(stored).exists() and beside is not None and beside.exists():
        return beside
    if Path(stored).suffix == "" and not Path(stored).exists():
        raise BodyError(f"the body {stored} was handed over in memory: it has no mesh to draw")
    if not Path(stored).exists():
        raise BodyError(f"{stored}: no such file (the body file holds the mesh: --body names it)")
    return stored


def _six(model: ReducedBody, shapes: Floats, reference: Floats) -> Floats | None:
    """Translation and rotation (k, 6) of the node with rotations at a place; None without one."""
    turning = np.flatnonzero(model.basis.component >= 3)
    if not len(turning):
        return None
    distance = np.linalg.norm(model.basis.position[turning] - reference, axis=1)
    node = model.basis.node[turning[np.argmin(distance)]]
    if distance.min() > 1e-6 * max(float(np.ptp(model.basis.position, axis=0).max()), 1e-300):
        return None
    rows = np.flatnonzero(model.basis.node == node)
    six = np.zeros((len(shapes), 6))
    six[:, model.basis.component[rows]] = shapes @ model.basis.V[rows].T
    return six


def interface_motion(model: ReducedBody) -> dict[str, tuple[Floats, Floats]]:
    """For each interface with six ports its translation and rotation, (3, m) each. Loads, which
    are inputs alone or loads of the body's spin, are no interfaces.

    Raises
    ------
    BodyError
        If a port belongs to an interface that has not all six.
    """
    found: dict[str, dict[str, int]] = {}
    for i, port in enumerate(model.inputs):
        name, _, force = port.rpartition(".")
        if port not in model.outputs or (name == "frame" and force.startswith("spin")):
            continue
        found.setdefault(name, {})[force] = i
    result, B = {}, model.system.B
    for name, ports in found.items():
        if {"fx", "fy", "fz", "mx", "my", "mz"} <= set(ports):
            result[name] = (
                B[:, [ports[f] for f in ("fx", "fy", "fz")]].T,
                B[:, [ports[f] for f in ("mx", "my", "mz")]].T,
            )
    lacking = [name for name in found if name not in result]
    if lacking:
        where = f"the interface {lacking[0]}" if lacking[0] else "the body"
        raise BodyError(
            f"{where} has the ports "
            f"{', '.join(found[lacking[0]])} only; a multibody code needs all six, fx "
            "to mz: reduce with them (--inputs)"
        )
    return result


def positions_in_file(path: str | Path) -> dict[str, Floats]:
    """Reference positions (3,) [m] of the interfaces of a body file; of one without a reference
    the mean of its nodes.

    Raises
    ------
    BodyError
        If the file does not tell.
    """
    with errors_of(path), h5py.File(path) as file:
        found = {
            name: np.asarray(group.attrs["position"], dtype=float)
            for name, group in file.get("interfaces", {}).items()
        }
    if found:
        return found
    try:
        geometry = Geometry.load(path)
    except BodyError as error:
        raise BodyError(f"where the interfaces are is not known: {error}") from None
    found = {name: place for name, (place, _) in geometry.followers.items()}
    for name, nodes in geometry.interfaces.items():
        found.setdefault(name, geometry.points[nodes].mean(axis=0))
    return found


def interface_positions(model: ReducedBody, body: str | Path | None = None) -> dict[str, Floats]:
    """Reference positions (3,) [m] of the interfaces. Of a free body from how its rigid modes move
    them: the translation under the rotation e_a × x is e_a × x_reference. Of others from the body's
    file (default: the one that was reduced).

    Raises
    ------
    BodyError
        For a body that is held and whose file is not there, or does not tell.
    """
    if not model.frame.integrals or model.frame.rigid_modes != 6:
        return positions_in_file(body_of(model, body))
    turns = model.frame.integrals.M_er[:6, 3:]  # coordinates of the rotations about the origin
    result = {}
    for name, (translation, _) in interface_motion(model).items():
        W = translation[:, :6] @ turns  # column a: e_a × x
        result[name] = 0.5 * np.array([W[1, 2] - W[2, 1], W[2, 0] - W[0, 2], W[0, 1] - W[1, 0]])
    return result
