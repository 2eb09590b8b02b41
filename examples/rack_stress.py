"""The rack on the ground under its own weight, pushed at its upper plate: the stress, certified.

    python3 examples/rack_stress.py [folder]

The stress at a strut is an output like any other: its error is proved. The picture shows the whole
field at the moment when that stress is largest.
"""

import sys
from pathlib import Path

import numpy as np

import flexgram
from flexgram import figures
from flexgram.body.stress import von_mises

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(exist_ok=True)
flexgram.import_body("meshes/standing_rack.yaml", out / "standing.h5")
rom = flexgram.reduce(out / "standing.h5", band_hz=(0, 500), tol=1e-3, statics=True)
print(f"order {rom.order}, error {rom.certified_error:.1e} ({rom.label})")
for kind, error in zip(rom.kinds, rom.by_kind, strict=True):
    print(f"  {kind}: at most {error:.1e}")

t = np.linspace(0, 0.2, 2001)
u = np.zeros((len(t), len(rom.inputs)))
u[:, rom.inputs.index("gravity.az")] = -9.81
u[:, rom.inputs.index("upper.fx")] = 500 * np.sin(np.pi * t / 0.02) * (t < 0.02)
weight = np.linalg.solve(rom.K, rom.B @ u[0])  # at rest under its weight
y, q = rom.simulate(u, t, q0=weight)
rows = [rom.outputs.index(f"strut.s{c}") for c in ("xx", "yy", "zz", "xy", "yz", "zx")]
strut = von_mises(y[:, rows])
worst = int(strut.argmax())
print(f"largest stress of the strut {strut[worst]:.4g} N/m^2 at t = {t[worst]:.4f} s")
figures.save(figures.stress(rom, q[worst]), out / "standing.png")
