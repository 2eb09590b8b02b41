"""Two superelements of NX Nastran, reduced and joined: the coupled frequencies against Nastran's.

The case is pyYeti's (folder pyyeti/tests/nas2cam_csuper of its repository, no part of this one):
an inboard and an outboard structure that share four grids, each already in its boundary motions and
modes below 50 Hz, so that 1e-6 keeps all; ``assemble.out`` prints what Nastran finds of both.

    benchmarks/run superelements FOLDER
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import scipy.io
import scipy.linalg
import scipy.sparse as sp

import flexgram
from flexgram.assembly.couple import Joint, couple

GRIDS = (3, 11, 19, 27)
PORTS = [f"g{grid}.{port}" for grid in GRIDS for port in ("fx", "fy", "fz", "mx", "my", "mz")]
LAST = 100.0  # Hz


def printed(path: Path) -> list[float]:
    """Frequencies [Hz] of the table of eigenvalues."""
    number = r"(-?\d\.\d+E[+-]\d+)"
    row = re.compile(rf"\s+\d+\s+\d+\s+{number}\s+{number}\s+{number}\s+{number}\s+{number}\s*$")
    found = [row.match(line) for line in path.read_text(errors="replace").splitlines()]
    return [float(match[3]) for match in found if match]


def main() -> None:
    folder = Path(sys.argv[1])
    data = scipy.io.loadmat(folder / "nas2cam.mat", squeeze_me=True, struct_as_record=False)["nas"]
    parts = {}
    for name, key in (("outboard", "k101"), ("inboard", "k102")):
        K, M = (getattr(getattr(data, role), key) for role in ("kaa", "maa"))
        used = np.flatnonzero(np.abs(M).sum(axis=0))  # some scalar points are empty
        K, M = (sp.csr_matrix(0.5 * (A + A.T)[np.ix_(used, used)]) for A in (K, M))
        body = flexgram.Matrices(K=K, M=M, B=np.eye(len(used))[:, : len(PORTS)], inputs=PORTS)
        parts[name] = flexgram.reduce(body, (0.5, LAST), 1e-6, statics=True)
        print(
            f"{name}: {parts[name].order} of {len(used)} coordinates, "
            f"{parts[name].certified_error:.1e} ({parts[name].kind})"
        )
    joints = [Joint(f"outboard.g{grid}", f"inboard.g{grid}") for grid in GRIDS]
    whole = couple(parts, joints, keep=["outboard.g3"])
    ours = whole.modes[whole.modes > 1] / (2 * np.pi)
    theirs = np.array([f for f in printed(folder / "assemble.out") if 0.1 < f < LAST])
    off = np.abs(ours[: len(theirs)] / theirs - 1)
    print(f"{len(theirs)} elastic modes below {LAST:g} Hz, largest difference {off.max():.1e}")


if __name__ == "__main__":
    main()
