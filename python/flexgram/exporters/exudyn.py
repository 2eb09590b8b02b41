"""EXUDYN: a flexible body with a floating frame of reference.

The displacements of a node subset (interfaces and the surface) serve markers and drawing; the
integrals are those of the whole mesh. Each interface of six ports becomes six points around its
reference, moved by the interface's translation and rotation, so a rigid-body marker on them has
exactly the interface's motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, Ints, written_aside
from flexgram.exporters.exudyn_stiffening import GeometricStiffening, frame_stiffening
from flexgram.model.elastic_part import expect_one_body, in_its_frame
from flexgram.model.geometry import Geometry, body_of, interface_motion, interface_positions
from flexgram.model.recovery import sides_of, stress_at_nodes
from flexgram.model.reduced import ReducedBody

STRESS_LOCAL = "OutputVariableType.StressLocal"
SATELLITES = np.vstack([np.eye(3), -np.eye(3)])
EPSILON = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    EPSILON[_a, _b, _c], EPSILON[_a, _c, _b] = 1, -1


#: EXUDYN's order of stresses, of ours.
STRESSES = [0, 1, 2, 4, 5, 3]


def _surface(
    model: ReducedBody, body: str | Path | None, most: int, more: Ints
) -> tuple[Floats, Floats, list[list[int]], Ints]:
    """Surface points (N, 3), their motion (m, N, 3), triangles, and the nodes of the mesh that the
    points are: those of the surface, then ``more`` of them; empty without a mesh."""
    nothing = (
        np.empty((0, 3)),
        np.empty((model.order, 0, 3)),
        list[list[int]](),
        np.empty(0, dtype=np.int64),
    )
    try:
        geometry = Geometry.load(body_of(model, body))
    except BodyError:
        if body is not None:
            raise
        return nothing
    triangles = geometry.surface()
    used, renumbered = np.unique(triangles, return_inverse=True)
    if not 0 < len(used) <= most:
        return nothing
    if len(more) and (more.min() < 0 or more.max() >= len(geometry.points)):
        raise BodyError(f"nodes of the mesh run from 1 to {len(geometry.points)}")
    used = np.concatenate([used, np.setdiff1d(more, used)])
    motion = geometry.motion(model)[:, used]
    return geometry.points[used], motion, renumbered.reshape(-1, 3).tolist(), used


def ffrf_terms(
    model: ReducedBody,
    body: str | Path | None = None,
    most_nodes: int = 5000,
    stress: bool = False,
    nodes: Sequence[int] = (),
) -> dict[str, Any]:
    """Everything that EXUDYN's ``ObjectFFRFreducedOrder`` takes, by the keys of its NPZ files.

    Parameters
    ----------
    model : ReducedBody
        Free body with a floating frame (``--frame buckens`` or ``tangent``).
    body : str or Path, optional
        Body file, for its surface; default: the one that was reduced, if it is there.
    most_nodes : int
        A surface with more nodes is not drawn.
    stress : bool
        Whether the stress of the surface comes along, for pictures and sensors of ``StressLocal``;
        for bodies that flexgram assembled. Of shells it is that of their top.
    nodes : sequence of int
        Nodes of the mesh, from 1, that come along beside the corners of its surface: inner and
        middle ones, of hot spots say.

    Returns
    -------
    dict
        EXUDYN's keys (``postProcessingModes`` as ``stressModes``, its matrix alone), and
        ``dampingMatrixReduced``, ``interfaceNames``, ``interfaceNodes`` (six
        node numbers each), ``interfacePositions``, ``meshNodes`` (for each point its node of the
        mesh, from 1; 0: none), and ``stiffening`` (12, n, n) where the body has it.

    Examples
    --------
    >>> terms = ffrf_terms(flexgram.ReducedModel.load("rack.rom.h5"))
    >>> terms["interfaceNames"].tolist()
    ['lower', 'upper']
    """
    expect_one_body(model, "EXUDYN's floating frame")
    if not model.frame.integrals or model.frame.rigid_modes != 6:
        raise BodyError(
            "EXUDYN's floating frame needs a free body with six rigid modes and its frame "
            "integrals: reduce it without supports, with coordinates, by --frame buckens or "
            "tangent, and fix it by joints there"
        )
    if model.system.loss:
        raise BodyError(
            f"EXUDYN has no structural damping ({model.system.loss}): give Rayleigh damping, or "
            "export with --damping modal or rayleigh"
        )
    positions = interface_positions(model)
    elastic = in_its_frame(model)
    n, f = elastic.order, model.frame.integrals.without_first(6)
    further = np.array(sorted({int(node) - 1 for node in nodes}), dtype=np.int64)
    points, moved, triangles, surface = _surface(model, body, most_nodes, further)
    if len(further) and not len(surface):
        raise BodyError(f"nodes want the surface of the body, of {most_nodes} nodes at most")
    moved = moved[model.frame.rigid_modes :]
    if stress and not len(surface):
        raise BodyError(f"the stress needs the surface of the body, of {most_nodes} nodes at most")
    extent = float(np.ptp(np.vstack([points, *positions.values()]), axis=0).max()) or 1.0
    names, satellites = [], []
    for name, (translation, rotation) in interface_motion(elastic).items():
        arms = 0.01 * extent * SATELLITES
        names.append(name)
        satellites.append(list(range(len(points), len(points) + 6)))
        points = np.vstack([points, positions[name] + arms])
        turned = np.cross(rotation.T[:, None, :], arms[None])
        moved = np.concatenate([moved, translation.T[:, None, :] + turned], axis=1)
    stresses = np.zeros((len(points), 6 * n if stress else 0))
    if stress:
        rigid = model.frame.rigid_modes
        sides = sides_of(model, body)
        of_modes = stress_at_nodes(model, body=body, side=sides[0])
        if len(sides) == 3:  # solids, and the top of shells
            top = stress_at_nodes(model, body=body, side="top")
            of_modes = np.where(np.isnan(of_modes), top, of_modes)
        of_modes = of_modes[rigid:, surface][..., STRESSES]
        stresses[: len(surface)] = np.nan_to_num(of_modes).transpose(1, 0, 2).reshape(-1, 6 * n)
    Ct = f.M_er[:, :3]
    inertia_first = f.inertia_first
    return {
        "modeBasis": moved.reshape(n, -1).T.copy(),
        "trigList": np.array(triangles, dtype=int),
        "postProcessingModes": {"matrix": stresses, "outputVariableType": STRESS_LOCAL}
        if stress
        else {},
        "stressModes": stresses,
        "massMatrixReduced": elastic.system.M,
        "stiffnessMatrixReduced": elastic.system.K,
        "dampingMatrixReduced": elastic.system.D,
        "infoList": np.array([n, len(points), 3, 4, 7, 7 + n]),
        "rigidBodyNodeType": "NodeType.RotationEulerParameters",
        "xRef": points.ravel(),
        "inertiaLocal": f.M_r[3:, 3:],
        "Mtt": f.M_r[:3, :3],
        "totalMass": f.mass,
        "chiU": f.centre,
        "chiUtilde": -EPSILON @ f.centre,
        # columns of skew(φ) are −e_a × φ
        "mPsiTildePsi": -np.transpose(f.gyroscopic, (2, 1, 0)).reshape(3 * n, n),
        "mPsiTildePsiTilde": np.transpose(f.inertia_second, (1, 0, 3, 2)).reshape(3 * n, 3 * n),
        "mPhitTPsi": Ct.T.copy(),
        "mPhitTPsiTilde": -np.einsum("abc,jc->ajb", EPSILON, Ct).reshape(3, 3 * n),
        "mXRefTildePsi": -f.M_er[:, 3:].T,
        "mXRefTildePsiTilde": np.transpose(inertia_first, (0, 2, 1)).reshape(3, 3 * n),
        "interfaceNames": np.array(names),
        "interfaceNodes": np.array(satellites).reshape(-1, 6),
        "interfacePositions": np.array([positions[name] for name in names]).reshape(-1, 3),
        "meshNodes": np.concatenate([surface + 1, np.zeros(len(points) - len(surface), int)]),
        **frame_stiffening(f.stiffening),
        "fileVersion": 1,
        "type": "ObjectFFRFreducedOrderInterface",
    }


def write_npz(
    model: ReducedBody, path: Path, body: str | Path | None = None, stress: bool = False
) -> None:
    """NPZ that ``ObjectFFRFreducedOrderInterface.LoadFromFile`` reads; as ``ffrf_terms``."""
    terms = ffrf_terms(model, body, stress=stress)
    with written_aside(path, body) as place, place.open("wb") as file:
        np.savez(file, **terms)


#: What ``add_body`` passes on as it is, and all that it reads of a file.
DIRECT = (
    "mPsiTildePsi",
    "mPsiTildePsiTilde",
    "mPhitTPsi",
    "mPhitTPsiTilde",
    "mXRefTildePsi",
    "mXRefTildePsiTilde",
    "modeBasis",
)
USED = {
    *DIRECT,
    "infoList",
    "stiffnessMatrixReduced",
    "massMatrixReduced",
    "dampingMatrixReduced",
    "xRef",
    "totalMass",
    "inertiaLocal",
    "chiU",
    "trigList",
    "interfaceNames",
    "interfaceNodes",
    "stressModes",
    "meshNodes",
    "stiffening",
}


def add_body(
    exu: Any,
    mbs: Any,
    source: ReducedBody | str | Path,
    *,
    position: Any = (0, 0, 0),
    rotation: Any = None,
    velocity: Any = (0, 0, 0),
    angular_velocity: Any = (0, 0, 0),
    gravity: Any = (0, 0, 0),
    color: Any = (0.4, 0.6, 0.8, 1.0),
    stress: bool = False,
    nodes: Sequence[int] = (),
    coordinates: Any = None,
) -> dict[str, Any]:
    """Add a reduced body to an EXUDYN system, with its projected damping.

    A body with geometric stiffening (``--stiffening``) gets a second object on the same nodes
    for it (``GeometricStiffening``): Python is called in each step, which is slower.

    Parameters
    ----------
    exu, mbs
        The module ``exudyn`` and a ``MainSystem``.
    source : ReducedBody or path
        Body, its reduced file, or the NPZ that ``export`` wrote.
    position, velocity, angular_velocity, gravity : 3 numbers
        Of the origin of the body's coordinates [m, m/s, rad/s, m/s²].
    rotation : (3, 3) array, optional
        From the body's axes to the inertial ones.
    stress : bool
        Whether a ``ReducedBody`` brings its stress (``ffrf_terms``); an NPZ brings what it has.
    nodes : sequence of int
        Further nodes of the mesh, from 1, that a ``ReducedBody`` brings (``ffrf_terms``).
    coordinates : (n,) array, optional
        Of the deformation in the beginning; default: none.

    Returns
    -------
    dict
        ``object``, ``rigid_node``, ``modal_node``, ``stiffening`` (an object, or None);
        ``markers``: interface -> marker of its rigid
        motion (position and rotation), for joints, loads and sensors; ``mesh_nodes``: node of the
        mesh, from 1 -> ``meshNodeNumber`` of EXUDYN's sensors and markers. The outputs that a claim
        is of are ``rom.elastic().C @ q``, q the coordinates of ``modal_node``.

    Examples
    --------
    >>> import exudyn
    >>> container = exudyn.SystemContainer()
    >>> mbs = container.AddSystem()
    >>> rack = add_body(exudyn, mbs, "rack.rom.h5", gravity=(0, 0, -9.81))
    >>> sorted(rack["markers"])
    ['lower', 'upper']
    """
    import exudyn.itemInterface as eii

    if np.shape(gravity) != (3,):
        raise BodyError(f"gravity = {gravity} must be three numbers, such as (0, 0, -9.81)")
    terms = _terms_of(source, stress, nodes)
    n = int(terms["infoList"][0])
    start = [0.0] * n if coordinates is None else np.asarray(coordinates, dtype=float).tolist()
    if len(start) != n:
        raise BodyError(f"coordinates: {len(start)} numbers, expected {n}")
    motion = {"position": position, "velocity": velocity, "angularVelocity": angular_velocity}
    rigid_node = _rigid_node(exu, mbs, motion, rotation)
    modal_node = mbs.AddNode(
        eii.NodeGenericODE2(
            numberOfODE2Coordinates=n,
            referenceCoordinates=[0] * n,
            initialCoordinates=start,
            initialCoordinates_t=[0] * n,
        )
    )
    number = _flexible_object(exu, mbs, terms, [rigid_node, modal_node], color)
    stiffening = None
    if "stiffening" in terms:
        stiffening = GeometricStiffening(terms["stiffening"])
        stiffening = stiffening.add(mbs, rigid_node, modal_node, gravity)
    if np.any(np.asarray(gravity)):
        marker = mbs.AddMarker(eii.MarkerBodyMass(bodyNumber=number))
        mbs.AddLoad(eii.LoadMassProportional(markerNumber=marker, loadVector=list(gravity)))
    markers = _Named("interface", "")
    for name, of_interface in zip(terms["interfaceNames"], terms["interfaceNodes"], strict=True):
        markers[str(name)] = mbs.AddMarker(
            eii.MarkerSuperElementRigid(
                bodyNumber=number,
                meshNodeNumbers=[int(i) for i in of_interface],
                weightingFactors=[1 / 6] * 6,
            )
        )
    mesh_nodes = _Named("mesh node", ": nodes=[…] brings more")
    mesh_nodes.update({int(node): k for k, node in enumerate(terms.get("meshNodes", ())) if node})
    return {
        "object": number,
        "rigid_node": rigid_node,
        "modal_node": modal_node,
        "stiffening": stiffening,
        "markers": markers,
        "mesh_nodes": mesh_nodes,
    }


class _Named(dict[Any, int]):
    """Numbers by name; a wrong name is told with the right ones."""

    def __init__(self, kind: str, remedy: str) -> None:
        super().__init__()
        self.kind, self.remedy = kind, remedy

    def __repr__(self) -> str:
        return super().__repr__() if len(self) < 50 else f"<{len(self)} of the {self.kind}s>"

    def __missing__(self, name: Any) -> int:
        names = [str(each) for each in self]
        shown = ", ".join(names[:12]) + (" …" if len(names) > 12 else "")
        raise BodyError(f"no {self.kind} {name!r} (there are: {shown or 'none'}){self.remedy}")


def _terms_of(
    source: ReducedBody | str | Path, stress: bool, nodes: Sequence[int]
) -> dict[str, Any]:
    """``ffrf_terms`` of a body or a reduced file, or what an NPZ holds of them."""
    if not isinstance(source, ReducedBody) and h5py.is_hdf5(source):
        source = ReducedBody.load(source)
    if isinstance(source, ReducedBody):
        return ffrf_terms(source, stress=stress, nodes=nodes)
    if len(nodes):
        raise BodyError("an NPZ brings the nodes that it was exported with: give the reduced file")
    with np.load(source) as file:  # what others may have pickled into it stays shut
        return {key: file[key] for key in file.files if key in USED}


def _rigid_node(exu: Any, mbs: Any, motion: dict[str, Any], rotation: Any) -> Any:
    from exudyn.rigidBodyUtilities import GetRigidBodyNode

    turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
    node = GetRigidBodyNode(
        nodeType=exu.NodeType.RotationEulerParameters,
        rotationMatrix=turn,
        **{key: list(value) for key, value in motion.items()},
    )
    return mbs.AddNode(node)


def _flexible_object(
    exu: Any, mbs: Any, terms: dict[str, Any], node_numbers: list[int], color: Any
) -> Any:
    import exudyn.itemInterface as eii

    def container(a: Any) -> Any:
        matrix = exu.MatrixContainer()
        matrix.SetWithDenseMatrix(np.asarray(a), useDenseMatrix=True)
        return matrix

    post = {}
    if "stressModes" in terms and terms["stressModes"].size:
        post = {
            "outputVariableModeBasis": terms["stressModes"],
            "outputVariableTypeModeBasis": exu.OutputVariableType.StressLocal,
        }
    return mbs.AddObject(
        eii.ObjectFFRFreducedOrder(
            nodeNumbers=node_numbers,
            stiffnessMatrixReduced=container(terms["stiffnessMatrixReduced"]),
            massMatrixReduced=container(terms["massMatrixReduced"]),
            dampingMatrixReduced=container(terms["dampingMatrixReduced"]),
            referencePositions=terms["xRef"],
            mass=float(terms["totalMass"]),
            inertia=terms["inertiaLocal"],
            centerOfMass=terms["chiU"],
            **{key: terms[key] for key in DIRECT},
            computeFFRFterms=True,
            **post,
            visualization=eii.VObjectFFRF(
                triangleMesh=terms["trigList"].tolist(), color=list(color)
            ),
        )
    )
