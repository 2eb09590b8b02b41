"""From a meshed body to a certified reduced one, a report and a response over time.

.venv/bin/python3 examples/rack.py [folder]
"""

import sys
from pathlib import Path

import numpy as np

import flexgram
from flexgram.pictures.report import write_report

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)
flexgram.import_body("meshes/rack.yaml", out / "rack.h5")
rom = flexgram.reduce(out / "rack.h5", band_hz=(10, 500), tol=1e-4)
print(rom)
rom.save(out / "rack.rom.h5")
write_report(out / "rack.rom.h5", out / "rack.html")

# The free rack is shaken at its lower plate; how much does the upper one turn?
t = np.linspace(0, 0.2, 2001)
force = np.zeros((len(t), len(rom.inputs)))
force[:, rom.inputs.index("lower.fx")] = 1000 * np.sin(2 * np.pi * 60 * t)
y, q = rom.simulate(force, t)
turn = y[:, rom.outputs.index("upper.my")]
print(f"the upper plate turns by up to {1e6 * np.abs(turn).max():.2f} microradians")
print(f"report: {out / 'rack.html'}")
