"""K, M, B from MATLAB, and the reduced body back to MATLAB.

    .venv/bin/python3 examples/matlab_matrices.py [folder]

In MATLAB, ``save('body.mat', '-v7.3', 'K', 'M', 'B')`` alone is a body file for
build/flexgram; files of older versions are imported. Here SciPy writes what MATLAB would.
"""

import sys
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

import flexgram
from flexgram.exporters import export
from flexgram.importers import import_matrices, read

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# A clamped rod of 400 elements: E A = 1e7 N, rho A = 2 kg/m, 2 m long; force at the end.
n, length = 400, 2.0
h = length / n
K = 1e7 / h * sp.diags([-np.ones(n - 1), np.r_[2 * np.ones(n - 1), 1], -np.ones(n - 1)], [-1, 0, 1])
M = 2 * h / 6 * sp.diags([np.ones(n - 1), np.r_[4 * np.ones(n - 1), 2], np.ones(n - 1)], [-1, 0, 1])
B = np.zeros((n, 1))
B[-1] = 1
scipy.io.savemat(out / "rod.mat", {"K": K.tocsc(), "M": M.tocsc(), "B": B, "beta": 1e-6})

import_matrices(read(out / "rod.mat"), out / "rod.h5")
rom = flexgram.reduce(out / "rod.h5", band_hz=(10, 5000), tol=1e-6)
print(rom)
export(rom, out / "rod_reduced.mat", "mat")

# Against the closed solution of the rod, tan(k l) / (E A k), up to the mesh's own error.
f = np.array([100.0, 700.0, 1800.0])
k = 2 * np.pi * f * np.sqrt(2 / 1e7 / (1 + 2j * np.pi * f * 1e-6))
exact = np.tan(k * length) / (1e7 * (1 + 2j * np.pi * f * 1e-6) * k)
ours = rom.transfer(2 * np.pi * f)[:, 0, 0]
print("relative difference from the rod's closed solution:", np.abs(ours / exact - 1).max())
