"""A DOLFINx program hands its own matrices to flexgram, without files and in parallel.

    mpirun -n 2 .venv/bin/python3 examples/dolfinx_beam.py [out/beam.rom.h5]

A steel beam of quadratic tetrahedra, free, with the resultant forces on its two ends as inputs;
10 to 1000 Hz, error at most 1e-4. Needs Debian's python3-dolfinx-real.
"""

import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix, assemble_vector
from mpi4py import MPI
from petsc4py import PETSc

import flexgram

comm = MPI.COMM_WORLD
size = np.array([1.0, 0.06, 0.04])
domain = mesh.create_box(comm, [np.zeros(3), size], [16, 2, 2], mesh.CellType.tetrahedron)
if hasattr(fem, "VectorFunctionSpace"):  # DOLFINx 0.5
    V = fem.VectorFunctionSpace(domain, ("CG", 2))
else:
    V = fem.functionspace(domain, ("Lagrange", 2, (3,)))
u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
E, nu, rho = 210e9, 0.3, 7850.0
mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def strain(w):
    return ufl.sym(ufl.grad(w))


stress = 2 * mu * strain(u) + lame * ufl.tr(strain(u)) * ufl.Identity(3)
matrices = []
for form in (ufl.inner(stress, strain(v)) * ufl.dx, rho * ufl.inner(u, v) * ufl.dx):
    matrix = assemble_matrix(fem.form(form))
    matrix.assemble()
    matrices.append(matrix)
K, M = matrices

# One input for each direction at each end: a force of 1 N, evenly over the face.
columns, names = [], []
for end, x in (("start", 0.0), ("end", size[0])):
    faces = mesh.locate_entities_boundary(domain, 2, lambda p, at=x: np.isclose(p[0], at))
    tags = mesh.meshtags(domain, 2, np.sort(faces), np.ones(len(faces), dtype=np.int32))
    ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)
    for axis in range(3):
        direction = np.zeros(3)
        direction[axis] = 1 / (size[1] * size[2])
        load = fem.Constant(domain, PETSc.ScalarType(direction))
        vector = assemble_vector(fem.form(ufl.inner(load, v) * ds(1)))
        vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        columns.append(vector.array_r.copy())
        names.append(f"{end}.f{'xyz'[axis]}")

# Where the rows are: rigid modes and frame integrals come from the coordinates.
blocks = V.dofmap.index_map.size_local
first = V.dofmap.index_map.local_range[0]
position = np.repeat(V.tabulate_dof_coordinates()[:blocks], 3, axis=0)
body = flexgram.Matrices(
    K, M, np.column_stack(columns), alpha=2.0, beta=1e-6, inputs=names, name="DOLFINx beam",
    node=np.repeat(first + np.arange(blocks), 3), component=np.tile(np.arange(3), blocks),
    position=position,
)  # fmt: skip
rom = flexgram.reduce(body, band_hz=(10, 1000), tol=1e-4, comm=comm)
if comm.rank == 0:
    print(rom)
    print(f"mass {float(rom.frame['mass']):.6f} kg, exact {rho * size.prod():.6f} kg")
    print("elastic modes [Hz]:", np.round(rom.modes[6:10] / (2 * np.pi), 2))
if len(sys.argv) > 1:
    rom.save(sys.argv[1])
