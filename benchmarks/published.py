"""Bodies of the collection NLEVP with damping that is not proportional to K, reduced and compared.

The matrices are those of the collection (folder private of its repository, no part of this one):

- foundation: a machine foundation of reinforced concrete on the ground. Hysteretic damping of two
  materials, and dashpots (Feriani, Perotti, Simoncini 2000).
- sandwich beam: a core of a fractional derivative model (Van Beeumen, Meerbergen, Michiels 2013),
  by a table of 300 frequencies.
- disk brake: gyroscopic forces of the disk, with the friction's circulatory forces and without
  (Gräbner, Mehrmann, Quraishi, Schröder, von Wagner 2016).

The reference are direct solves of the full matrices at 200 random frequencies and at the natural
ones. Writes benchmarks/results/published.csv.

    benchmarks/run published FOLDER
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from common import RESULTS, write_table

import flexgram

TWO_PI = 2 * np.pi
Stiffness = Callable[[float], Any]
#: Name, body, damping, complex stiffness at a frequency [rad/s], and how many modes the band holds.
Case = tuple[str, flexgram.Matrices, Any, Stiffness, int]


def foundation(data: dict[str, Any], rng: np.random.Generator) -> Iterator[Case]:
    M, D, K = sp.csr_matrix(data["M"]), sp.csr_matrix(-data["D"].imag), -sp.csr_matrix(data["K"])
    B = np.eye(M.shape[0])[:, rng.choice(M.shape[0], 6, replace=False)]
    yield "foundation", flexgram.Matrices(K, M, B, D=D), D, lambda _: K, 15


def sandwich_beam(data: dict[str, Any], _: np.random.Generator) -> Iterator[Case]:
    M, elastic, core = (
        sp.csr_matrix(0.5 * (a + a.T)) for a in (data[k] for k in ("M", "Ke", "Kv"))
    )
    static, instant, alpha, tau = 3.504e5, 3.062e9, 0.675, 8.230e-9
    table = TWO_PI * np.geomspace(1, 1e5, 300)
    z = (1j * table * tau) ** alpha
    modulus = (static + instant * z) / (1 + z) - static
    law = flexgram.table(table, modulus.real, modulus.imag)
    K, n = elastic + static * core, M.shape[0]
    B = np.eye(n)[:, [n // 2 - 1, n - 3]]
    body = flexgram.Matrices(K, M, B, terms={"core": (core, law)})
    yield "sandwich beam", body, 0 * M, lambda w: K + complex(law.at(w)) * core, 9


def disk_brake(data: dict[str, Any], rng: np.random.Generator) -> Iterator[Case]:
    M, stiffness, friction, material, contact, gyroscopic = (
        sp.csr_matrix(data[k]) for k in ("M", "K1", "KR", "D1", "DR", "DG")
    )
    speed = TWO_PI * 4
    D = material + contact / speed + speed * gyroscopic
    K, skew = stiffness + 0.5 * (friction + friction.T), 0.5 * (friction - friction.T)
    B = np.eye(M.shape[0])[:, rng.choice(M.shape[0], 3, replace=False)]
    yield "disk brake, gyroscopic", flexgram.Matrices(K, M, B, D=D), D, lambda _: K, 12
    terms = {"friction": (skew, flexgram.circulatory())}
    whole = K + skew
    body = flexgram.Matrices(K, M, B, D=D, terms=terms)
    yield "disk brake, friction too", body, D, lambda _: whole, 12


CASES = {
    "foundation": foundation,
    "sandwich_beam_840": sandwich_beam,
    "disk_brake100": disk_brake,
}


def judged(case: Case, tolerance: float, rng: np.random.Generator) -> dict[str, str]:
    """A row of the table."""
    name, body, D, stiffness, modes = case
    M = sp.csc_matrix(body.M)
    K = sp.csc_matrix(body.K.real)
    squares = spl.eigsh(K, modes + 1, M, sigma=0, return_eigenvectors=False)
    natural = np.sqrt(np.sort(np.abs(squares))) / TWO_PI
    band = 0.3 * natural[0], 0.5 * (natural[-1] + natural[-2])
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a brake that squeals is unstable
        rom = flexgram.reduce(body, band, tolerance)
    seconds = time.perf_counter() - begin
    errors = []
    for f in (*rng.uniform(*band, 200), *natural[:-1]):
        w = TWO_PI * f
        A = sp.csc_matrix(stiffness(w) + 1j * w * D - w * w * M)
        H = body.B.T @ spl.splu(A).solve(body.B.astype(complex))
        errors.append(np.linalg.norm(rom.transfer(w) - H) / np.linalg.norm(H))
    return {
        "body": name,
        "dofs": str(M.shape[0]),
        "tolerance": f"{tolerance:g}",
        "order": str(rom.order),
        "claim": f"{rom.certified_error:.3g}",
        "kind": rom.kind,
        "largest error": f"{max(errors):.3g}",
        "seconds": f"{seconds:.3g}",
    }


def main() -> None:
    folder = Path(sys.argv[1])
    rows = []
    for file, cases in CASES.items():
        data = scipy.io.loadmat(folder / f"{file}.mat")
        rng = np.random.default_rng(1)
        for case in cases(data, rng):
            for tolerance in (1e-3, 1e-6):
                rows.append(judged(case, tolerance, rng))
                print(rows[-1])
    write_table(RESULTS / "published.csv", rows)


if __name__ == "__main__":
    main()
