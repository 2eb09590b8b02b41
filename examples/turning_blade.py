"""A blade that turns at any speed up to 3000 rpm: one reduction for all of them, and its diagram.

    .venv/bin/python3 examples/turning_blade.py [folder]

On the command line, with the YAML file and the mesh that this writes:

    flexgram import out/blade.yaml -o out/blade.h5
    flexgram reduce out/blade.h5 --band 10,300 --tol 1e-3 -o out/blade.rom.h5
    flexgram campbell out/blade.rom.h5 --orders 1,2 -o out/blade.svg
    flexgram at out/blade.rom.h5 speed=200 -o out/blade200.rom.h5
"""

import sys
from pathlib import Path

import meshio
import numpy as np

import flexgram
from flexgram.body.description import import_description
from flexgram.model.campbell import campbell
from flexgram.pictures import figures

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# A blade of 400 x 40 x 6 mm on a hub of 100 mm radius, of beams; it turns about the z axis.
count, hub, length = 24, 0.1, 0.4
points = np.zeros((count + 1, 3))
points[:, 0] = np.linspace(hub, hub + length, count + 1)
cells = [("line", np.column_stack([np.arange(count), np.arange(1, count + 1)]))]
ends = {"root": np.array([0]), "tip": np.array([count])}
mesh = meshio.Mesh(points, cells, point_sets=ends, cell_sets={"blade": [np.arange(count)]})

DESCRIPTION = {
    "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
    "sections": {"flat": {"shape": "rectangle", "width": 0.04, "height": 0.006}},
    "regions": {"blade": {"material": "steel", "section": "flat"}},
    "interfaces": {"tip": {"coupling": "node", "nodes": "tip"}},
    "supports": {"root": {"nodes": "root", "components": ["x", "y", "z", "rx", "ry", "rz"]}},
    "damping": {"alpha": 15.0},
}


def body(name: str, **more: object) -> Path:
    """The body file of the blade that turns so."""
    import_description(DESCRIPTION | more, name, out / f"{name}.h5", mesh=mesh)
    return out / f"{name}.h5"


ports = ["tip.fy", "tip.fz"]
rom = flexgram.reduce(
    body("blade", spin={"axis": [0, 0, 1], "rpm": [0, 3000]}),
    (10, 300),
    1e-3,
    inputs=ports,
    outputs=ports,
)
print(rom)
rom.save(out / "blade.rom.h5")
if len(rom.claim.all_values):
    print(f"any speed up to 3000 rpm: {rom.claim.all_values.max():.1e} at most, {rom.kind}")

diagram = campbell(rom.system, modes=3)
for i in (0, 30, 60):
    hertz = ", ".join(f"{x:.2f}" for x in np.sort(diagram.omega[i]) / (2 * np.pi))
    print(f"{diagram.speeds[i] * 30 / np.pi:.0f} rpm: {hertz} Hz, in the frame that turns")
for one in diagram.critical((1, 2)):
    print(f"mode {one.mode + 1} at {one.order:g} times the speed: {one.speed * 30 / np.pi:.0f} rpm")
figures.save(figures.campbell(diagram, (1, 2), rom.claim.band), out / "blade.svg")

# Another speed, with matrices of its own, which the reduction did not know: a preload by that spin.
speed = 210.0
turn = {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}}
other = flexgram.reduce(
    body("other", loads=turn, preload={"turn.spin": speed**2}),
    (10, 300),
    1e-6,
    inputs=ports,
    outputs=ports,
)
omega = 2 * np.pi * np.linspace(10, 300, 200)
H, H_r = other.transfer(omega), rom.at(speed=speed).transfer(omega)
away = np.linalg.norm(H_r - H, axis=(1, 2)) / np.linalg.norm(H, axis=(1, 2))
print(f"{speed:g} rad/s: differs by {away.max():.1e} at most at 200 frequencies")
print(f"wrote {out / 'blade.svg'}: frequencies over the speed")
