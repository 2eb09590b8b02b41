"""Entries given twice are summed; node labels may be any numbers."""

import numpy as np
import scipy.sparse as sp

import flexgram

n = 50
K = sp.diags([-np.ones(n - 1), 2.5 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]).tocoo()
twice = sp.csr_matrix((n, n))
split = sp.coo_matrix(
    (np.r_[0.25 * K.data, 0.75 * K.data], (np.r_[K.row, K.row], np.r_[K.col, K.col])), shape=(n, n)
)
order = np.argsort(split.row, kind="stable")
start = np.searchsorted(split.row[order], np.arange(n + 1))
raw = sp.csr_matrix((split.data[order], split.col[order], start), shape=(n, n))
assert raw.nnz == 2 * K.nnz
B = np.eye(n)[:, :2]
a, b = (
    flexgram.reduce(
        flexgram.Matrices(x, sp.eye(n).tocsr(), B, alpha=0.01, node=400_000_000 + np.arange(n)),
        (0.01, 0.2),
        1e-6,
    )
    for x in (K.tocsr(), raw)
)
assert np.allclose(a.transfer(0.7), b.transfer(0.7), rtol=1e-5)
exact = np.linalg.solve(K.toarray() + 0.7j * 0.01 * np.eye(n) - 0.49 * np.eye(n), B)[:2]
assert np.allclose(b.transfer(0.7), exact, rtol=1e-5)
assert b.node.min() == 400_000_000
