"""A bracket on rubber mounts whose modulus is known to 30 %: one reduction for all of it.

    .venv/bin/python3 examples/rubber_mounts.py [folder]

Needs gmsh (Debian: python3-gmsh). On the command line, with the YAML file that this writes:

    flexgram import out/mounts.yaml -o out/mounts.h5
    flexgram reduce out/mounts.h5 --band 5,400 --tol 1e-3 -o out/mounts.rom.h5
    flexgram plot out/mounts.rom.h5 --figure transfer -o out/mounts.svg
    flexgram at out/mounts.rom.h5 E_rubber=1.4e6 -o out/soft.rom.h5
"""

import sys
from pathlib import Path

import gmsh
import numpy as np

import flexgram
from flexgram.pictures import figures

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# A plate of 200 x 120 x 10 mm with an upright, on four blocks of rubber of 25 x 25 x 20 mm.
gmsh.initialize()
gmsh.option.setNumber("General.Verbosity", 0)
box = gmsh.model.occ.addBox
steel = [(3, box(0, 0, 0, 0.2, 0.12, 0.01)), (3, box(0.09, 0, 0.01, 0.01, 0.12, 0.08))]
mounts = [(3, box(x, y, -0.02, 0.025, 0.025, 0.02)) for x in (0, 0.175) for y in (0, 0.095)]
gmsh.model.occ.fragment(steel, mounts)
gmsh.model.occ.synchronize()
at = {tag: gmsh.model.occ.getCenterOfMass(3, tag)[2] for _, tag in gmsh.model.getEntities(3)}
for name, chosen in (
    ("rubber", [tag for tag, z in at.items() if z < 0]),
    ("bracket", [tag for tag, z in at.items() if z > 0]),
):
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, chosen), name)
for name, height in (("feet", -0.02), ("top", 0.09)):
    found = [
        tag for _, tag in gmsh.model.getEntities(2)
        if abs(gmsh.model.occ.getCenterOfMass(2, tag)[2] - height) < 1e-6
    ]  # fmt: skip
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, found), name)
gmsh.option.setNumber("Mesh.MeshSizeMax", 0.02)
gmsh.model.mesh.generate(3)
gmsh.model.mesh.setOrder(2)
gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
gmsh.write(str(out / "mounts.msh"))
gmsh.finalize()

DESCRIPTION = """
mesh: mounts.msh
materials:
  steel: {E: 210.0e9, nu: 0.3, rho: 7850, loss_factor: 0.002}
  rubber: {E: %.4e, nu: 0.45, rho: 1100, loss_factor: 0.15%s}
regions:
  bracket: {material: steel}
  rubber: {material: rubber}
interfaces:
  top: {coupling: rigid, nodes: top}
supports:
  floor: {nodes: feet}
"""


def body(name: str, E: float, more: str = "") -> Path:
    """The body file with this modulus of the rubber."""
    (out / f"{name}.yaml").write_text(DESCRIPTION % (E, more))
    flexgram.import_body(out / f"{name}.yaml", out / f"{name}.h5")
    return out / f"{name}.h5"


rom = flexgram.reduce(body("mounts", 2e6, ", parameter: {E: [1.4e6, 2.6e6]}"), (5, 400), 1e-3)
print(rom)
rom.save(out / "mounts.rom.h5")
for E in (1.4e6, 2.0e6, 2.6e6):
    one = rom.at(E_rubber=E)
    first = ", ".join(f"{x:.2f}" for x in one.modes[:3] / (2 * np.pi))
    print(f"E = {E:.1e} Pa: {first} Hz, {one.claim.label}")

# The claim for every modulus between, and a body of its own, which the reduction did not know.
most = rom.claim.all_values.max()
print(
    f"any E from 1.4e+06 to 2.6e+06 Pa: {most:.1e} at most, {rom.at(E_rubber=1.85e6).claim.label}"
)
other = flexgram.reduce(body("other", 1.85e6), (5, 400), 1e-6)
omega = 2 * np.pi * np.linspace(5, 400, 200)
H, H_r = other.transfer(omega), rom.at(E_rubber=1.85e6).transfer(omega)
away = np.linalg.norm(H_r - H, axis=(1, 2)) / np.linalg.norm(H, axis=(1, 2))
print(f"E = 1.85e6 Pa, not among them: differs by {away.max():.1e} at most at 200 frequencies")
picture = figures.transfer(rom, ports=[("top.fz", "top.fz"), ("top.fx", "top.fx")])
figures.save(picture, out / "mounts.svg")
print(f"wrote {out / 'mounts.svg'}: the response, and its envelope over all moduli")
