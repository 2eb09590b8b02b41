"""Many calls in one process: memory stays, errors leave nothing behind."""

import resource
import sys

import numpy as np
import scipy.sparse as sp

import flexgram

count = int(sys.argv[1])
n = 400
K = sp.diags([2.0, -1, -1], [0, 1, -1], shape=(n, n)).tocsr() * 1e9
M = sp.eye(n).tocsr()
B = np.eye(n)[:, [0, n - 1]]
body = flexgram.Matrices(K, M, B, beta=1e-6)
bad = flexgram.Matrices(K, M, B, alpha=-1)
medium = flexgram.certify(body, band_hz=(1, 500), tol=1e-6)
orders, seen = set(), {}
for call in range(count):
    rom = flexgram.reduce(body, band_hz=(1, 500), tol=1e-4)
    small = medium.reduce(tol=1e-3)
    orders.add((rom.order, small.order))
    for wrong in (
        lambda: flexgram.reduce(bad),
        lambda: flexgram.reduce(body, tol=-1),
        lambda: medium.reduce(band_hz=(1, 900)),
        lambda: flexgram.reduce("nothing.h5"),
    ):
        try:
            wrong()
        except flexgram.BodyError:
            continue
        raise SystemExit("no error where one was due")
    seen[call] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print("orders", len(orders))
print("grown", seen[count - 1] - seen[count // 4])
