"""What cannot be reduced is an exception on every rank, and the process goes on."""

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

import flexgram

K = sp.diags([2.0, 2.0, 2.0, 2.0]).tocsr()
B = np.ones((4, 1))
bad = K.copy().tolil()
bad[0, 1] = 0.5
cases = [
    (lambda: flexgram.reduce("nowhere.h5"), "cannot read nowhere.h5"),
    (lambda: flexgram.reduce("x.h5", options={"mor_toll": 1}), "did you mean tol"),
    (lambda: flexgram.reduce(flexgram.Matrices(bad.tocsr(), K, B)), "triangle"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K[:3, :3], B)), "like K"),
    (
        lambda: flexgram.reduce(flexgram.Matrices(K.toarray(), K, B)),
        "must be a SciPy",
    ),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K, B, eta=-0.1)), "eta = -0.1"),
    (
        lambda: flexgram.reduce(flexgram.Matrices(K, K, B, alpha=np.nan)),
        "alpha = nan",
    ),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K, 1j * B)), "B is complex"),
    (
        lambda: flexgram.reduce(flexgram.Matrices(K, K, np.ones((4, 2)), inputs=["a", "a"])),
        "named a",
    ),
    (lambda: flexgram.reduce("x.h5", options={"toll": 1}), "toll is none of flexgram's"),
    (lambda: flexgram.reduce("x.h5", options={"mat_typ": 1}), "cannot read x.h5"),
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(K, K, B, node=[0, 1, 2.5, 3], component=np.zeros(4, int))
        ),
        "whole numbers",
    ),
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(
                K,
                K,
                B,
                node=np.arange(4),
                component=np.zeros(4, int),
                position=np.full((4, 3), np.nan),
            )
        ),
        "position holds NaN",
    ),
    (lambda: flexgram.reduce(flexgram.Matrices(K, None, B)), "M is missing"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K, np.ones((3, 1)))), "B has shape (3, 1)"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K, np.nan * B)), "NaN"),
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(K, K, B, node=np.arange(4), component=np.full(4, 7))
        ),
        "component must be",
    ),
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(
                K,
                K,
                B,
                node=np.arange(4),
                component=np.zeros(4, int),
                position=np.zeros((4, 2)),
            )
        ),
        "expected",
    ),
    # one rank alone
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(
                K,
                K,
                B,
                inputs=["a"] * (1 + (MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1)),
            )
        ),
        "names for 1 ports",
    ),
    (lambda: flexgram.reduce(flexgram.Matrices(K, -K, B)), "M"),
    (
        lambda: flexgram.reduce(flexgram.Matrices(K, K, B), (10, 20), method="best"),
        "option method best",
    ),
]
for call, expected in cases:
    try:
        call()
    except flexgram.BodyError as error:
        assert expected in str(error), str(error)
    else:
        raise AssertionError(expected)
rom = flexgram.reduce(flexgram.Matrices(K, K, B), (0.05, 0.1))  # and goes on
vector = flexgram.reduce(flexgram.Matrices(K, K, np.ones(4)), (0.05, 0.1))  # one input
assert vector.order == rom.order and vector.inputs == ["u1"]
assert MPI.COMM_WORLD.allreduce(1) == MPI.COMM_WORLD.size
