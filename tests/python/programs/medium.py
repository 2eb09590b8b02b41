"""certify, cut, save and load on several ranks: body, band, medium file. Prints orders and rows."""

import json
import sys

from mpi4py import MPI

import flexgram

body, first, last, out = sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
medium = flexgram.certify(body, band_hz=(first, last), tol=1e-7)
medium.save(out)
orders = [medium.reduce(tol=t).order for t in (1e-2, 1e-4, 1e-6)]
rows = MPI.COMM_WORLD.allreduce(len(medium.reduce(tol=1e-3).V))
again = flexgram.Medium.load(out).reduce(tol=1e-4)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps([orders, rows, again.order]))
