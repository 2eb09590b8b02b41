"""Wrong files and wrong interfaces: one message that names the place and the remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from bodies import box, small, write_body_file
from conftest import assembled, edit
from flexgram.basics import BodyError
from flexgram.importers import FeMatrices, check, import_matrices, parse, read
from flexgram.importers.deck import read_deck
from flexgram.importers.interfaces import attach


@pytest.mark.parametrize(
    ("cards", "expected"),
    [
        ("*NODE, SYSTEM=C\n1, 1, 90, 0\n", "line 1: .* writes nodes in a way"),
        ("*NODE\n1,0,0,0\n*NGEN\n1,9,2\n", "line 3: .* writes nodes in a way"),
        ("*NODE\n1,0,0,0\n1,0,0,1\n", "line 3: .* another place"),
        ("*INSTANCE, NAME=A, PART=P\n10., 0., 0.\n*NODE\n1,0,0,0\n", "line 2: .* moves the inst"),
        ("*INSTANCE, NAME=A\n*NODE\n1,0,0,0\n*INSTANCE, NAME=B\n", "line 4: .* second instance"),
        ("*NODE\n1,0,0,z\n", "line 2: .* does not belong under"),
        ("*ELEMENT, TYPE=C3D4\n1, 1,2,3,4\n", "is this a deck"),
        ("*INCLUDE, INPUT=none.inp\n", "No such file"),
    ],
)
def test_decks_that_are_not_followed(tmp_path: Path, cards: str, expected: str) -> None:
    (tmp_path / "x.inp").write_text(cards)
    with pytest.raises(BodyError, match=expected):
        read_deck(tmp_path / "x.inp")


def test_wrong_containers(tmp_path: Path) -> None:
    """Complex PETSc files, dof maps of MATLAB that do not fit, options of other formats."""
    head = np.array([1211216, 2, 2, 2, 1, 1, 0, 1], dtype=">i4").tobytes()
    for name in ("K", "M"):
        (tmp_path / f"{name}.petsc").write_bytes(head + np.ones(2, dtype=">c16").tobytes())
    with pytest.raises(BodyError, match="complex scalars"):
        read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    (tmp_path / "K.petsc").write_bytes(head + np.ones(1, dtype=">f8").tobytes())
    with pytest.raises(BodyError, match="need 48 bytes, it has 40"):
        read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    K, M = small()
    body = {"K": K, "M": M, "B": np.eye(8)[:, :1], "node": np.repeat([1, 2, 3], 3)[:8],
            "component": np.tile([1, 2, 3], 3)[:8], "position": np.eye(3)}  # fmt: skip
    for change, expected in (
        ({}, "component must be 0, 1, 2"),
        ({"component": np.tile([0, 1, 2], 3)[:8], "position": np.eye(3)[:, :2]}, "nodes × 3"),
        ({"component": np.arange(3), "position": np.eye(3)}, "an entry for each"),
    ):
        scipy.io.savemat(tmp_path / "x.mat", body | change)
        with pytest.raises(BodyError, match=expected):
            read(tmp_path / "x.mat")
    body["component"] = np.tile([0, 1, 2], 3)[:8]
    scipy.io.savemat(tmp_path / "x.mat", body)
    assert read(tmp_path / "x.mat").has_coordinates()
    scipy.io.savemat(tmp_path / "x.mat", body | {"B": np.ones((7, 1))})
    with pytest.raises(BodyError, match="B is 7 × 1, expected 8 rows"):
        import_matrices(read(tmp_path / "x.mat"), tmp_path / "x.h5")
    with pytest.raises(BodyError, match="--mass does not belong to the format matlab"):
        read(tmp_path / "x.mat", mass=tmp_path / "x.mat")


def test_a_dof_map_of_another_body(tmp_path: Path) -> None:
    """Permuted nodes: translations stay free, rotations do not."""
    mesh = box("tetra", (3, 2, 2))
    write_body_file(tmp_path / "mesh.h5", mesh,
                    interfaces={"start": {"set": "start", "coupling": "distributing"}})  # fmt: skip
    full = assembled(tmp_path / "full.h5", tmp_path / "mesh.h5")
    fe = FeMatrices("x", full["K"].tocsr(), full["M"].tocsr(), node=full["node"],
                    component=full["component"], labels=np.arange(len(mesh.points)),
                    points=mesh.points)  # fmt: skip
    assert check(fe)["free"] == 6
    fe.points = mesh.points[::-1]
    with pytest.raises(BodyError, match="do not belong to these matrices"):
        check(fe)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Hand-made results of ccx: a tetrahedron's worth of rows."""
    K = np.diag([3e6, 3e6, 3e6, 2e6, 2e6, 2e6]) - 1e5
    M = np.diag(np.full(6, 2.0))
    for suffix, matrix in (("sti", K), ("mas", M)):
        with (tmp_path / f"job.{suffix}").open("w") as file:
            for j in range(6):
                for i in range(j + 1):
                    file.write(f"{i + 1} {j + 1} {matrix[i, j]:20.13e}\n")
    (tmp_path / "job.dof").write_text("".join(f"{n}.{d}\n" for n in (10, 11) for d in (1, 2, 3)))
    (tmp_path / "job.inp").write_text("*NODE\n10,0,0,0\n11,1,0,0\n12,2,0,0\n")
    return tmp_path


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ("nothing", None),
        ("lower triangle", None),
        ("truncated line", r"job.sti, line 21: .*truncated"),
        ("truncated file", r"job.mas: row 6 of 6 has no entry: the file is truncated"),
        ("swapped", "are K and M swapped"),
        ("no dof map", r"job.dof \(the dof map\) is missing"),
        ("short dof map", "row numbers from 1 to 6, expected 1 to 5"),
        ("bad dof map", r"job.dof, line 3: 'x', expected node.direction"),
        ("binary", r"job.sti: binary, expected text"),
        ("unequal triangles", r"job.sti: not symmetric: entry \(1, 2\)"),
        ("nan", r"holds NaN or Inf"),
    ],
)
def test_wrong_calculix_files(job: Path, what: str, expected: str | None) -> None:
    sti, mas, dof = (job / f"job.{suffix}" for suffix in ("sti", "mas", "dof"))
    if what == "lower triangle":
        edit(sti, lambda t: "".join(
            "{1} {0} {2}\n".format(*line.split()) for line in t.splitlines()))  # fmt: skip
    elif what == "truncated line":
        edit(sti, lambda t: t[:-9])
    elif what == "truncated file":
        edit(mas, lambda t: "\n".join(t.splitlines()[:15]) + "\n")
    elif what == "swapped":
        sti.rename(job / "x")
        mas.rename(sti)
        (job / "x").rename(mas)
    elif what == "no dof map":
        dof.unlink()
    elif what == "short dof map":
        edit(dof, lambda t: "\n".join(t.splitlines()[:5]))
    elif what == "bad dof map":
        edit(dof, lambda t: t.replace("10.3", "x"))
    elif what == "binary":
        sti.write_bytes(b"\0\1\2\3" * 100)
    elif what == "unequal triangles":
        edit(sti, lambda t: t + "2 1 5.0\n")
    elif what == "nan":
        edit(sti, lambda t: t.replace("3.0000000000000e+06", "nan", 1)
             if "3.0000000000000e+06" in t else t.replace(t.split()[2], "nan", 1))  # fmt: skip
    if expected is None:
        fe = read(sti)
        check(fe)
        assert fe.K[0, 5] == fe.K[5, 0] == -1e5
        return
    with pytest.raises(BodyError, match=expected):
        check(read(sti))


@pytest.mark.parametrize(
    ("option", "where", "expected"),
    [
        ("rigid", "a=NSET:TOP", "there is no node set TOP; there are none"),
        ("rigid", "a=NODES:10,12", "node 12 has no free x translation: it is constrained"),
        ("node", "a=NODES:12", "node 12 has no row"),
        ("distributing", "a=NODES:10,11", "2 nodes on a line and cannot carry moments"),
        ("distributing", "a=NODES:10", "is one node and cannot carry moments"),
        ("rigid", "a=NODES:10", "is one node and cannot carry moments"),
        ("rigid", "a=BOX:5,5,5,6,6,6", "no node in the box; the body spans"),
        ("rows", "a=7", "the matrices have rows 1 to 6"),
        ("rigid", "a", "expected name=NSET:SET"),
        ("rigid", "a=PLANE:1", "PLANE must be NSET, NODES, BOX or AT"),
        ("rigid", "a=NODES:-3", "internal node"),
    ],
)
def test_wrong_interfaces(job: Path, option: str, where: str, expected: str) -> None:
    fe = read(job / "job.sti")
    with pytest.raises(BodyError, match=expected):
        attach(fe, [parse(option, where)])


def test_no_interface_and_overlap(job: Path) -> None:
    fe = read(job / "job.sti")
    with pytest.raises(BodyError, match="no interface is named"):
        attach(fe, [])
    pair = [parse("rigid", "a=NODES:10"), parse("rigid", "b=NODES:10,11")]
    with pytest.raises(BodyError, match="interfaces a and b share node 10"):
        attach(fe, pair)
