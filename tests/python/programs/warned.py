"""Warnings of reductions on some ranks: prints how many of those that results hold are Python's."""

import warnings

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

import flexgram

comm = MPI.COMM_WORLD
n = 60
K = sp.diags([2.0, -1, -1], [0, 1, -1], shape=(n, n)).tolil()
K[0, 0] = K[-1, -1] = 1
B = np.zeros((n, 2))
B[0, 0] = B[-1, 1] = 1
body = flexgram.Matrices(K.tocsr() * 1e6, sp.eye(n).tocsr(), B, alpha=1.0)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    rom = flexgram.reduce(body, (0.05, 0.5), 1e-2, relative_to="pointwise")
    medium = flexgram.certify(body, (0.05, 0.5), 1e-2, relative_to="pointwise")
    cut = medium.reduce(1e-2, relative_to="pointwise")
said = [str(w.message) for w in caught if w.category is flexgram.ReductionWarning]
held = [*rom.provenance.warnings, *medium.warnings, *cut.provenance.warnings]
rom.save("warned.rom.h5")
places = {w.filename for w in caught} - {__file__}
told = "all" if said == held and len(caught) == len(held) else str(len(caught))
lines = comm.gather(f"rank {comm.rank}: {told} of {len(held)}, {len(places)} elsewhere")
if lines:  # rank 0 prints: mpirun may mix the lines of several ranks
    print(*lines, sep="\n")
