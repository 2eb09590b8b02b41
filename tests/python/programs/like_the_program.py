"""flexgram.reduce of a file, saved: body, output."""

import sys

import flexgram

rom = flexgram.reduce(sys.argv[1], band_hz=(10, 500), tol=1e-3)
rom.save(sys.argv[2])
assert rom.V.shape[0] == len(rom.node) == len(rom.component) == len(rom.position)
assert rom.kind == "certified" and rom.certified_error <= 1e-3
assert rom.log["factorisations"] == 1 and "krylov" in rom.log["seconds"]
