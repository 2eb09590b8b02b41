"""A DOLFINx model as a body: forms and tagged facets instead of glue.

``body`` assembles K and M, makes six ports of each tagged part of the boundary, and says where the
rows are, so that rigid modes, frame integrals and pictures come along. In parallel, without files;
DOLFINx 0.5 (Debian) and later.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.matrices import Matrices
from flexgram.importers.fe import rigid_motions

PORTS = ("fx", "fy", "fz", "mx", "my", "mz")


def _assembled(form: Any, rows: Any, diagonal: float) -> Any:
    """The matrix of a form; rows that are held have nothing but their diagonal."""
    from dolfinx import fem
    from dolfinx.fem.petsc import assemble_matrix

    matrix = assemble_matrix(fem.form(form))
    matrix.assemble()
    matrix.zeroRowsColumns(rows, diagonal)
    return matrix


def _held(V: Any, supports: Sequence[Any]) -> Any:
    """Global numbers of this rank's rows that Dirichlet conditions hold."""
    size, first = V.dofmap.index_map_bs, V.dofmap.index_map.local_range[0]
    local = [condition.dof_indices()[0] for condition in supports]
    rows = np.unique(np.concatenate(local)) if local else np.empty(0, dtype=np.int64)
    return (rows[rows < size * V.dofmap.index_map.size_local] + size * first).astype(np.int32)


def _loads(V: Any, ds: Any, tag: int) -> Floats:
    """∫ v·r ds of the six rigid motions r about the origin, rows of this rank x 6."""
    import ufl
    from dolfinx import fem
    from dolfinx.fem.petsc import assemble_vector
    from petsc4py import PETSc

    v, x = ufl.TestFunction(V), ufl.SpatialCoordinate(V.mesh)
    e = np.eye(3)
    motions = [ufl.as_vector(e[i].tolist()) for i in range(3)]
    motions += [ufl.cross(ufl.as_vector(e[i].tolist()), x) for i in range(3)]
    columns = []
    for motion in motions:
        vector = assemble_vector(fem.form(ufl.inner(motion, v) * ds(tag)))
        vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        columns.append(vector.array_r.copy())
    return np.column_stack(columns)


def body(
    V: Any,
    stiffness: Any,
    mass: Any,
    tags: Any,
    interfaces: Mapping[int, str],
    *,
    supports: Sequence[Any] = (),
    alpha: float = 0.0,
    beta: float = 0.0,
    eta: float = 0.0,
    name: str = "DOLFINx",
) -> Matrices:
    """K, M and ports of forms and tagged facets.

    Each interface has six ports: a force and a moment at the middle of its facets, spread over
    these as a traction that is linear in space (its work is that of the mean motion of the facets:
    a distributing coupling weighed by area).

    Parameters
    ----------
    V : dolfinx.fem.FunctionSpace
        Of displacements: three components, Lagrange, on a mesh in space.
    stiffness, mass : UFL forms
        Bilinear, of trial and test functions of V, in SI units.
    tags : dolfinx.mesh.MeshTags
        Of facets.
    interfaces : mapping
        Tag of the facets -> name of the interface.
    supports : sequence of DirichletBC, optional
        What holds the body.
    alpha, beta, eta : float
        Rayleigh coefficients [1/s], [s], structural loss factor.

    Returns
    -------
    Matrices
        For ``flexgram.reduce`` and ``flexgram.certify`` on the communicator of the mesh.

    Raises
    ------
    BodyError
        For another kind of space, complex scalars, or a tag without facets. On all ranks.

    Examples
    --------
    >>> import ufl
    >>> from dolfinx import fem, mesh
    >>> from mpi4py import MPI
    >>> box = mesh.create_unit_cube(MPI.COMM_SELF, 2, 2, 2)
    >>> make = getattr(fem, "VectorFunctionSpace", None)
    >>> V = make(box, ("CG", 1)) if make else fem.functionspace(box, ("Lagrange", 1, (3,)))
    >>> u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    >>> k = 1e9 * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) * ufl.dx
    >>> top = mesh.locate_entities_boundary(box, 2, lambda x: np.isclose(x[2], 1.0))
    >>> tags = mesh.meshtags(box, 2, np.sort(top), np.full(len(top), 5, dtype=np.int32))
    >>> given = body(V, k, 1e3 * ufl.inner(u, v) * ufl.dx, tags, {5: "top"})
    >>> given.inputs[0]
    'top.fx'
    """
    import ufl
    from petsc4py import PETSc

    if V.dofmap.index_map_bs != 3 or V.mesh.geometry.dim != 3:
        raise BodyError("dolfinx.body: V must have three components on a mesh in space")
    if np.iscomplexobj(PETSc.Vec().createSeq(1).array_r):
        raise BodyError("dolfinx.body: PETSc has complex scalars; flexgram takes a real one")
    comm = V.mesh.comm
    blocks, first = V.dofmap.index_map.size_local, V.dofmap.index_map.local_range[0]
    points = V.tabulate_dof_coordinates()[:blocks]
    position, component = np.repeat(points, 3, axis=0), np.tile(np.arange(3), blocks)
    held = _held(V, supports)
    ds = ufl.Measure("ds", domain=V.mesh, subdomain_data=tags)
    ports, names = [], []
    for tag, interface in interfaces.items():
        loads = _loads(V, ds, tag)
        area = comm.allreduce(float(loads[component == 0, 0].sum()))
        if not area > 0:
            raise BodyError(f"dolfinx.body: no facets have the tag {tag} ({interface})")
        # ∫ x ds is what the loads along x, y and z do against a motion that is x, y, z there.
        middle = (
            np.array(
                [comm.allreduce(float(points[:, i] @ loads[component == 0, 0])) for i in range(3)]
            )
            / area
        )
        about = np.zeros((6, 6))  # motions about the middle by those about the origin
        about[:3, :3] = about[3:, 3:] = np.eye(3)
        about[:3, 3:] = -np.array([np.cross(e, middle) for e in np.eye(3)]).T
        loads = loads @ about
        work = comm.allreduce(rigid_motions(position - middle, component).T @ loads)
        ports.append(loads @ np.linalg.inv(work))
        names += [f"{interface}.{port}" for port in PORTS]
    B = np.hstack(ports)
    B[held - 3 * first] = 0
    return Matrices(
        _assembled(stiffness, held, 1.0),
        _assembled(mass, held, 0.0),
        B,
        alpha=alpha,
        beta=beta,
        eta=eta,
        inputs=names,
        node=np.repeat(first + np.arange(blocks), 3),
        component=component,
        position=position,
        name=name,
    )
