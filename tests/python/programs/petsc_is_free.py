"""A kept result does not keep the caller's matrices."""

import numpy as np
from petsc4py import PETSc

import flexgram

n = 30
K = PETSc.Mat().createAIJ((n, n), nnz=3)
for i in range(n):
    K[i, i] = 2
    if i:
        K[i, i - 1] = K[i - 1, i] = -1
K.assemble()
M = PETSc.Mat().createAIJ((n, n), nnz=1)
for i in range(n):
    M[i, i] = 1
M.assemble()
rom = flexgram.reduce(flexgram.Matrices(K, M, np.eye(n)[:, :1], alpha=0.01), (0.01, 0.1), 1e-4)
assert K.refcount == 1 and M.refcount == 1
