"""A part in millimetres: meshed by gmsh, a CalculiX deck, reduced, handed on as SID.

    .venv/bin/python3 examples/calculix_part.py [folder]

Needs gmsh (Debian: python3-gmsh). The matrices are those of ccx (calculix-ccx) where it is
installed, else flexgram assembles the deck. The same on the command line, from a deck:

    flexgram import part.inp --assemble --units mm-t-s --rigid foot=NSET:FOOT \
        --rigid eye=NSET:EYE --alpha 5 -o part.h5
    flexgram reduce part.h5 --band 10,5000 --tol 1e-3 -o part.rom.h5
    flexgram export part.rom.h5 --to sid -o part.SID_FEM
"""

import shutil
import sys
from pathlib import Path

import gmsh
import numpy as np

import flexgram
from flexgram.exporters import export
from flexgram.importers import import_matrices, parse, read
from flexgram.importers.assemble import assemble_deck

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# A bracket of 120 x 40 x 12 mm with an eye of 16 mm diameter.
gmsh.initialize()
gmsh.option.setNumber("General.Verbosity", 0)
plate = gmsh.model.occ.addBox(0, 0, 0, 120, 40, 12)
eye = gmsh.model.occ.addCylinder(95, 20, 0, 0, 0, 12, 8)
gmsh.model.occ.cut([(3, plate)], [(3, eye)])
gmsh.model.occ.synchronize()
gmsh.option.setNumber("Mesh.MeshSizeMax", 9)
gmsh.model.mesh.generate(3)
gmsh.model.mesh.setOrder(2)
labels, points, _ = gmsh.model.mesh.getNodes()
points = points.reshape(-1, 3)
_, elements, nodes = gmsh.model.mesh.getElements(3)
tets = nodes[0].reshape(-1, 10)[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]  # gmsh swaps the last two
gmsh.finalize()

radius = np.hypot(points[:, 0] - 95, points[:, 1] - 20)
sets = {"FOOT": labels[points[:, 0] < 1e-6], "EYE": labels[np.abs(radius - 8) < 1e-3]}
deck = ["*NODE, NSET=NALL"]
deck += [f"{n}, {x:.10g}, {y:.10g}, {z:.10g}" for n, (x, y, z) in zip(labels, points, strict=True)]
deck.append("*ELEMENT, TYPE=C3D10, ELSET=EALL")
deck += [f"{e}, " + ", ".join(map(str, tet)) for e, tet in zip(elements[0], tets, strict=True)]
for name, members in sets.items():
    deck += [f"*NSET, NSET={name}", *(f"{n}," for n in members)]
deck += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "210000, 0.3", "*DENSITY", "7.85e-9"]
deck += ["*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL"]
(out / "part.inp").write_text("\n".join(deck) + "\n")

interfaces = [parse("rigid", "foot=NSET:FOOT"), parse("rigid", "eye=NSET:EYE")]
if shutil.which("ccx"):
    fe = read(out / "part.inp", run_ccx=True)
    facts = import_matrices(fe, out / "part.h5", interfaces, units="mm-t-s", alpha=5.0)
    print(f"n = {facts['rows']}, mass {facts['mass']:.4f} kg, {facts['free']} free rigid motions")
else:
    facts = assemble_deck(out / "part.inp", out / "part.h5", interfaces, units="mm-t-s", alpha=5.0)
    print("\n".join(facts["summary"]))
rom = flexgram.reduce(out / "part.h5", band_hz=(10, 5000), tol=1e-3)
print(rom)
rom.save(out / "part.rom.h5")
export(rom, out / "part.SID_FEM", "sid", dialect="dlr")
print(f"wrote {out / 'part.SID_FEM'}")
