"""What cannot be reduced is an exception on every rank, and the process goes on."""

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

import flexgram

K = sp.diags([2.0, 2.0, 2.0, 2.0]).tocsr()
bad = K.copy().tolil()
bad[0, 1] = 0.5
cases = [
    (lambda: flexgram.reduce("nowhere.h5"), "cannot read nowhere.h5"),
    (lambda: flexgram.reduce("x.h5", options={"mor_toll": 1}), "did you mean -mor_tol"),
    (lambda: flexgram.reduce(flexgram.Matrices(bad.tocsr(), K, np.ones((4, 1)))), "triangle"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K[:3, :3], np.ones((4, 1)))), "must be sparse"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, None, np.ones((4, 1)))), "M is missing"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K, np.ones((3, 1)))), "B has"),
    (lambda: flexgram.reduce(flexgram.Matrices(K, K, np.nan * np.ones((4, 1)))), "NaN"),
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(K, K, np.ones((4, 1)), node=np.arange(4), component=np.full(4, 7))
        ),
        "component must be",
    ),
    (
        lambda: flexgram.reduce(
            flexgram.Matrices(
                K,
                K,
                np.ones((4, 1)),
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
                np.ones((4, 1)),
                inputs=["a"] * (1 + (MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1)),
            )
        ),
        "do not fit",
    ),
    (lambda: flexgram.reduce(flexgram.Matrices(K, -K, np.ones((4, 1)))), "M"),
    (
        lambda: flexgram.reduce(flexgram.Matrices(K, K, np.ones((4, 1))), (10, 20), method="best"),
        "-mor_method",
    ),
]
for call, expected in cases:
    try:
        call()
    except flexgram.BodyError as error:
        assert expected in str(error), str(error)
    else:
        raise AssertionError(expected)
rom = flexgram.reduce(flexgram.Matrices(K, K, np.ones((4, 1))), (0.05, 0.1))  # and goes on
assert MPI.COMM_WORLD.allreduce(1) == MPI.COMM_WORLD.size
