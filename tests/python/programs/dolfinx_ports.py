"""flexgram.importers.dolfinx.body against glue by hand, on some ranks: prints what differs.

dolfinx_ports.py DEGREE
"""

import logging
import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix, assemble_vector
from mpi4py import MPI
from petsc4py import PETSc

import flexgram
import flexgram.importers.dolfinx
from flexgram.basics import BodyError
from flexgram.importers.fe import rigid_motions

logging.disable(logging.INFO)
comm, degree = MPI.COMM_WORLD, int(sys.argv[1])
size = np.array([1.0, 0.1, 0.08])
domain = mesh.create_box(comm, [np.zeros(3), size], [8, 2, 2], mesh.CellType.tetrahedron)
if hasattr(fem, "VectorFunctionSpace"):
    V = fem.VectorFunctionSpace(domain, ("CG", degree))
else:
    V = fem.functionspace(domain, ("Lagrange", degree, (3,)))
u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
sym = lambda w: ufl.sym(ufl.grad(w))  # noqa: E731
k = (2 * 8e10 * ufl.inner(sym(u), sym(v)) + 1e11 * ufl.div(u) * ufl.div(v)) * ufl.dx
m = 7850.0 * ufl.inner(u, v) * ufl.dx
ends = [
    mesh.locate_entities_boundary(domain, 2, lambda p, at=x: np.isclose(p[0], at))
    for x in (0.0, 1.0)
]
facets, which = np.concatenate(ends), np.repeat([3, 7], [len(faces) for faces in ends])
order = np.argsort(facets)
tags = mesh.meshtags(domain, 2, facets[order], which[order].astype(np.int32))
body = flexgram.importers.dolfinx.body(V, k, m, tags, {7: "tip", 3: "root"}, alpha=2.0)
assert list(body.inputs) == [
    f"{name}.{port}" for name in ("tip", "root") for port in ("fx", "fy", "fz", "mx", "my", "mz")
]

# Forces: a uniform traction. Moments: resultants about the middle, by rigid motions.
ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)
worst = 0.0
for first, tag in ((0, 7), (6, 3)):
    for axis in range(3):
        load = np.zeros(3)
        load[axis] = 1 / (size[1] * size[2])
        vector = assemble_vector(
            fem.form(ufl.inner(fem.Constant(domain, PETSc.ScalarType(load)), v) * ds(tag))
        )
        vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        mine = np.abs(body.B[:, first + axis] - vector.array_r).max(initial=0)
        worst = max(worst, comm.allreduce(mine, op=MPI.MAX))
middle = np.array([1.0, 0.05, 0.04])
work = comm.allreduce(rigid_motions(body.position - middle, body.component).T @ body.B[:, :6])
K = assemble_matrix(fem.form(k))
K.assemble()
K.axpy(-1.0, body.K)
rom = flexgram.reduce(body, band_hz=(10, 1500), tol=1e-4, comm=comm)

# Held at the root: as a body without those rows.
held = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, ends[0]), V)
tip = flexgram.importers.dolfinx.body(V, k, m, tags, {7: "tip"}, supports=[held], alpha=2.0)
clamped = flexgram.reduce(tip, band_hz=(1, 1500), tol=1e-4, comm=comm)
try:
    flexgram.importers.dolfinx.body(V, k, m, tags, {5: "none"})
    refused = ""
except BodyError as error:
    refused = str(error)
if comm.rank == 0:
    print(f"loads {worst:.1e}")
    print(f"work {np.abs(work - np.eye(6)).max():.1e}")
    print(f"matrix {K.norm():.1e}")
    print(f"rigid {rom.frame['rigid_modes']} mass {float(rom.frame['mass']):.9g}")
    print("free", *np.round(rom.modes[6:9] / (2 * np.pi), 4))
    print("clamped", *np.round(clamped.modes[:3] / (2 * np.pi), 4), clamped.kind)
    print("refused", refused)
else:
    K.norm()
