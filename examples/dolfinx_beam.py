"""A DOLFINx program hands its own forms to flexgram, without files and in parallel.

    mpirun -n 2 .venv/bin/python3 examples/dolfinx_beam.py [out/beam.rom.h5]

A steel beam of quadratic tetrahedra, free, with forces and moments on its two ends as inputs;
10 to 1000 Hz, error at most 1e-4. Needs Debian's python3-dolfinx-real.
"""

import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

import flexgram
import flexgram.importers.dolfinx

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
ends = [
    mesh.locate_entities_boundary(domain, 2, lambda p, at=x: np.isclose(p[0], at))
    for x in (0.0, size[0])
]
facets, which = np.concatenate(ends), np.repeat([3, 7], [len(faces) for faces in ends])
order = np.argsort(facets)
tags = mesh.meshtags(domain, 2, facets[order], which[order].astype(np.int32))

body = flexgram.importers.dolfinx.body(
    V,
    ufl.inner(stress, strain(v)) * ufl.dx,
    rho * ufl.inner(u, v) * ufl.dx,
    tags,
    {3: "start", 7: "end"},
    alpha=2.0,
    beta=1e-6,
    name="DOLFINx beam",
)
rom = flexgram.reduce(body, band_hz=(10, 1000), tol=1e-4, comm=comm)

if comm.rank == 0:
    print(rom)
    print(f"mass {float(rom.frame['mass']):.6f} kg, exact {rho * size.prod():.6f} kg")
    print("elastic modes [Hz]:", np.round(rom.modes[6:10] / (2 * np.pi), 2))
if len(sys.argv) > 1:
    rom.save(sys.argv[1])
