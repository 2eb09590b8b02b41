"""Mutated files of every kind that flexgram reads. Each must be read or refused in one line.

    scripts/fuzz [count] [seed]     # so many of each kind

Bytes are cut, changed, inserted, repeated, or a word is put in a number's place. A crash is a
signal, a traceback, a hang, or a message that names nothing; it ends with status 1, and the file
stays in out/fuzz. ``test_fuzz`` runs a few of each kind.
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import random
import shutil
import subprocess
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "meshes"))

import h5py
import meshio
import numpy as np
import scipy.io
import scipy.sparse as sp

from bodies import box
from conftest import ENVIRONMENT, PROGRAM, ROOT
from flexgram import BodyError, ReducedModel, import_body, write_matrices
from flexgram.body.bodyfile import write_sparse
from flexgram.body.description import import_description
from flexgram.cli.info import describe
from flexgram.importers import Interface, import_matrices, read
from flexgram.measured import frf, mode_shapes

N = 12  #: rows of the small matrices
K = sp.diags([2.0, -1, -1], [0, 1, -1], shape=(N, N)).tocsr() * 1e6
M = sp.eye(N).tocsr()
WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"99999999999999999999",
    b"1.5",
    b"1e300",
    b",",
    b"\0",
    b"abc",
    b"0",
    b"*",
    b"\xff",
    b"../x",
)

#: Makes the files of a kind in a folder; gives the ones to mutate, and what reads them.
Kind = Callable[[Path], tuple[list[str], Callable[[Path], Any]]]


def _imported(first: str, **others: str) -> Callable[[Path], Any]:
    def work(folder: Path) -> None:
        fe = read(folder / first, **{key: folder / name for key, name in others.items()})
        import_matrices(fe, folder / "out.h5", [Interface("tip", "rows", "ROWS:2")])

    return work


def _upper(matrix: Any) -> list[tuple[int, int, float]]:
    entries = sp.triu(matrix).tocoo()
    return list(zip(entries.row.tolist(), entries.col.tolist(), entries.data.tolist(), strict=True))


def calculix(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    for suffix, matrix in ((".sti", K), (".mas", M)):
        lines = [f"{i + 1} {j + 1} {x:.12e}\n" for i, j, x in _upper(matrix)]
        (folder / f"job{suffix}").write_text("".join(lines))
    (folder / "job.dof").write_text("".join(f"{i // 3 + 1}.{i % 3 + 1}\n" for i in range(N)))
    nodes = "".join(f"{i + 1},{i * 1.0},{i % 2},{i // 2 * 0.5}\n" for i in range(4))
    (folder / "job.inp").write_text(
        f"*NODE,NSET=ALL\n{nodes}*ELEMENT,TYPE=C3D4,ELSET=E\n1,1,2,3,4\n*NSET,NSET=TOP\n1,2\n"
    )
    return ["job.sti", "job.mas", "job.dof", "job.inp"], _imported("job.sti")


def abaqus(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    for name, matrix in (("job_STIF1.mtx", K), ("job_MASS1.mtx", M)):
        lines = [
            f"{i // 3 + 1},{i % 3 + 1},{j // 3 + 1},{j % 3 + 1},{x:.12e}\n"
            for i, j, x in _upper(matrix)
        ]
        (folder / name).write_text("".join(lines))
    return ["job_STIF1.mtx", "job_MASS1.mtx"], _imported("job_STIF1.mtx")


def nastran(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    lines = []
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        lines.append(f"DMIG    {name:8s}0       6       2       0")
        for j in range(N):
            lines.append(f"DMIG*   {name:<8s}        {j // 3 + 1:16d}{j % 3 + 1:16d}")
            lines += [
                f"*       {i // 3 + 1:16d}{i % 3 + 1:16d}{x:16.9E}"
                for k, i, x in _upper(matrix)
                if k == j
            ]
    (folder / "job.pch").write_text("\n".join(lines) + "\n")
    return ["job.pch"], _imported("job.pch")


def market(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    scipy.io.mmwrite(folder / "k.mtx", K)
    scipy.io.mmwrite(folder / "m.mtx", M)
    return ["k.mtx", "m.mtx"], _imported("k.mtx", mass="m.mtx")


def harwell_boeing(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    scipy.io.hb_write(folder / "k.rsa", K.tocsc())
    scipy.io.hb_write(folder / "m.rsa", M.tocsc())
    return ["k.rsa", "m.rsa"], _imported("k.rsa", mass="m.rsa")


def matlab(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    values = {
        "K": K,
        "M": M,
        "B": np.eye(N)[:, :2],
        "node": np.arange(N) // 3 + 1,
        "component": np.arange(N) % 3,
        "position": np.arange(12.0).reshape(4, 3),
        "eta": 0.1,
    }
    scipy.io.savemat(folder / "b.mat", values)
    return ["b.mat"], _imported("b.mat")


def matlab_73(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    with h5py.File(folder / "b.mat", "w") as file:
        write_sparse(file, "K", K)
        write_sparse(file, "M", M)
        file["B"], file["eta"] = np.eye(N)[:2], [[0.1]]
    return ["b.mat"], _imported("b.mat")


def petsc(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    for name, matrix in (("k.bin", K), ("m.bin", M)):
        with (folder / name).open("wb") as file:
            np.array([1211216, N, N, matrix.nnz], ">i4").tofile(file)
            np.diff(matrix.indptr).astype(">i4").tofile(file)
            matrix.indices.astype(">i4").tofile(file)
            matrix.data.astype(">f8").tofile(file)
    return ["k.bin", "m.bin"], _imported("k.bin", mass="m.bin")


YAML = """name: part
mesh: part.inp
units: mm-t-s
materials:
  steel: {E: 210.0e3, nu: 0.3, rho: 7.85e-9}
regions:
  all: {material: steel}
interfaces:
  left: {coupling: rigid, nodes: start}
  right: {coupling: distributing, nodes: {box: [[99, -9, -9], [101, 99, 99]]}}
damping: {alpha: 2.4, beta: 6.0e-6}
"""


def yaml(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    meshio.write(folder / "part.inp", box("tetra", (3, 1, 1), (100, 20, 30), distort=False))
    (folder / "body.yaml").write_text(YAML)
    return ["body.yaml", "part.inp"], lambda here: import_body(here / "body.yaml", here / "out.h5")


def _run(*arguments: str) -> Callable[[Path], Any]:
    """The program on files of a folder; its refusals as the package's error."""

    def work(folder: Path) -> None:
        words = [word.replace("@", f"{folder}/") for word in arguments]
        done = subprocess.run(
            [str(PROGRAM), *words], env=ENVIRONMENT, capture_output=True, text=True, timeout=300
        )
        said = [line for line in done.stderr.splitlines() if line.startswith("flexgram: ")]
        if done.returncode == 1 and said:
            raise BodyError(said[0])
        if done.returncode not in (0, 2):
            raise RuntimeError(f"status {done.returncode}: {done.stderr[-500:]}")

    return work


BAND = ("-mor_band_hz", "10,100")


def body(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    write_matrices(
        folder / "b.h5",
        K,
        M,
        np.eye(N)[:, :2],
        eta=0.02,
        inputs=["a", "b"],
        node=np.arange(N) // 3,
        component=np.arange(N) % 3,
        position=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    )
    return ["b.h5"], _run("reduce", "-body", "@b.h5", *BAND, "-mor_out", "@rom.h5")


def mesh_body(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    description = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0, "expansion": 1.2e-5}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "loads": {
            "warm": {"type": "temperature", "nodes": "start"},
            "turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]},
        },
        "outputs": {
            "foot": {"type": "reaction", "nodes": "start"},
            "s": {"type": "stress", "nodes": "start"},
        },
    }
    import_description(description, "box", folder / "b.h5", mesh=box("tetra", (2, 1, 1)))
    return ["b.h5"], _run("assemble", "-body", "@b.h5", "-body_out", "@out.h5")


def medium(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    body(folder)
    _run("certify", "-body", "@b.h5", *BAND, "-mor_medium_out", "@m.h5")(folder)
    return ["m.h5"], _run("cut", "-medium", "@m.h5", "-mor_tol", "1e-3", "-mor_out", "@rom.h5")


def reduced(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    body(folder)[1](folder)

    def work(here: Path) -> None:
        ReducedModel.load(here / "rom.h5").transfer(np.array([100.0]))
        describe(here / "rom.h5")

    return ["rom.h5"], work


def universal(folder: Path) -> tuple[list[str], Callable[[Path], Any]]:
    hertz = np.linspace(10, 100, 12)
    frf.write_universal([frf.Response("a.fx", "b.fx", hertz, 1 / (hertz + 2j))], folder / "f.unv")
    shapes = np.arange(24.0).reshape(2, 4, 3)
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    modes = mode_shapes.ModeShapes(
        np.array([10.0, 20]), np.array([0.01, 0.02]), shapes, np.arange(1, 5), points
    )
    mode_shapes.write_universal(modes, folder / "m.unv")

    def work(here: Path) -> None:
        for r in frf.read_universal(here / "f.unv"):
            assert np.isfinite(r.values).all()
        read = mode_shapes.read_universal(here / "m.unv")
        assert np.isfinite(mode_shapes.compare(read, modes).mac).all()

    return ["f.unv", "m.unv"], work


KINDS: tuple[Kind, ...] = (
    calculix,
    abaqus,
    nastran,
    market,
    harwell_boeing,
    matlab,
    matlab_73,
    petsc,
    yaml,
    body,
    mesh_body,
    medium,
    reduced,
    universal,
)


def mutate(data: bytes, rng: random.Random) -> bytes:
    """One of six kinds of damage."""
    kind, length = rng.randrange(6), len(data)
    first = rng.randrange(length)
    last = min(length, first + rng.randrange(1, 50))
    if kind == 0:
        return data[:first]
    if kind == 1:
        changed = bytearray(data)
        for _ in range(rng.randrange(1, 6)):
            changed[rng.randrange(length)] = rng.randrange(256)
        return bytes(changed)
    if kind == 2:
        return data[:first] + data[last:]
    if kind == 3:
        return data[:first] + rng.choice(WORDS) + data[first:]
    if kind == 4:
        return data[:last] + data[first:last] + data[last:]
    lines = data.split(b"\n")
    line = rng.randrange(len(lines))
    words = lines[line].replace(b",", b" ").split()
    if words:
        words[rng.randrange(len(words))] = rng.choice(WORDS)
        lines[line] = (b"," if b"," in lines[line] else b" ").join(words)
    return b"\n".join(lines)


def attempt(work: Callable[[Path], Any], folder: Path, answer: Any) -> None:
    """Child process: what became of one file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            work(folder)
        answer.send(("read", ""))
    except (BodyError, OSError) as error:
        good = len(str(error)) > 10
        answer.send(("refused", "") if good else ("crashed", f"says only {error!r}"))
    except BaseException:
        answer.send(("crashed", traceback.format_exc(limit=-4)))


def fuzz(kind: Kind, count: int, seed: int, place: Path) -> tuple[collections.Counter[str], str]:
    """Mutate files of one kind; how many were read, refused, crashed, and how the first crashed."""
    source = place / kind.__name__
    shutil.rmtree(source, ignore_errors=True)
    source.mkdir(parents=True)
    names, work = kind(source)
    work(source)  # the files as they are
    rng = random.Random(f"{seed} {kind.__name__}")
    found: collections.Counter[str] = collections.Counter()
    first = ""
    for number in range(count):
        folder = place / f"{kind.__name__}-{seed}-{number}"
        shutil.copytree(source, folder, dirs_exist_ok=True)
        victim = folder / rng.choice(names)
        victim.write_bytes(mutate((source / victim.name).read_bytes(), rng))
        mine, theirs = multiprocessing.Pipe()
        child = multiprocessing.get_context("fork").Process(
            target=attempt, args=(work, folder, theirs)
        )
        child.start()
        child.join(timeout=90)
        if child.is_alive():
            child.kill()
            what, words = "crashed", "does not end"
        elif child.exitcode != 0 or not mine.poll():
            what, words = "crashed", f"ended with status {child.exitcode}"
        else:
            what, words = mine.recv()
        found[what] += 1
        if what == "crashed":
            first = first or f"{victim}\n{words}"
        else:
            shutil.rmtree(folder)
    return found, first


def main() -> int:
    global PROGRAM
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=300)
    parser.add_argument("seed", type=int, nargs="?", default=1)
    parser.add_argument("--kind", action="append", choices=[kind.__name__ for kind in KINDS])
    parser.add_argument("--program", type=Path, default=PROGRAM, help="another build of flexgram")
    parser.add_argument("--place", type=Path, default=ROOT / "out" / "fuzz")
    options = parser.parse_args()
    PROGRAM = options.program.resolve()
    failed = 0
    print(f"{'kind':16s} {'tried':>6s} {'read':>6s} {'refused':>8s} {'crashed':>8s}")
    for kind in KINDS:
        if options.kind and kind.__name__ not in options.kind:
            continue
        found, first = fuzz(kind, options.count, options.seed, options.place)
        failed += found["crashed"]
        print(
            f"{kind.__name__:16s} {options.count:6d} {found['read']:6d} {found['refused']:8d} "
            f"{found['crashed']:8d}",
            flush=True,
        )
        if first:
            print(first)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
