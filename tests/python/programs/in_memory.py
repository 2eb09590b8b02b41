"""SciPy or petsc4py matrices in memory against sparse solves: output, scipy|petsc."""

import sys

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

import flexgram

n = 300
K = 1e6 * sp.diags([-np.ones(n - 1), np.r_[2 * np.ones(n - 1), 1], -np.ones(n - 1)], [-1, 0, 1])
M = sp.diags([0.5 * np.ones(n - 1), 2 * np.ones(n), 0.5 * np.ones(n - 1)], [-1, 0, 1])
B = np.zeros((n, 2))
B[-1, 0] = B[n // 2, 1] = 1
C = np.zeros((1, n))
C[0, n // 3] = 1
which = sys.argv[2]
K, M = K.tocsr(), M.tocsr()
if which == "scipy":
    body = flexgram.Matrices(K, M, B, C=C, alpha=0.5, inputs=["tip", "middle"], outputs=["third"])
else:
    from petsc4py import PETSc

    def mat(a):
        m = PETSc.Mat().create(MPI.COMM_WORLD)
        m.setSizes((n, n))
        m.setType("aij")
        m.setUp()
        first, last = m.getOwnershipRange()
        r = a[first:last]
        m.setPreallocationCSR((r.indptr, r.indices, r.data))
        m.assemble()
        return m, first, last

    (Kp, first, last), (Mp, *_) = mat(K), mat(M)
    body = flexgram.Matrices(
        Kp,
        Mp,
        B[first:last],
        C=C[:, first:last],
        alpha=0.5,
        inputs=["tip", "middle"],
        outputs=["third"],
    )
rom = flexgram.reduce(body, band_hz=(1, 20), tol=1e-5)
if which == "petsc":
    assert Kp.refcount >= 1 and abs(Kp.norm() - np.sqrt((K.multiply(K)).sum())) < 1e-3
worst = 0
for w in 2 * np.pi * np.linspace(1, 20, 23):
    A = (K + 1j * w * 0.5 * M - w * w * M).tocsc()
    exact = C @ sp.linalg.spsolve(A, B)
    worst = max(worst, np.linalg.norm(rom.transfer(w) - exact) / np.linalg.norm(exact))
assert worst <= rom.certified_error <= 1e-5, (worst, rom.certified_error)
rom.save(sys.argv[1])
