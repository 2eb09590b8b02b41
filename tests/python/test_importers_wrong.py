"""Wrong files and wrong interfaces: one message that names the place and the remedy."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from bodies import box, small, write_body_file
from conftest import ROOT, assembled, edit
from flexgram import import_body, write_matrices
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
        ("*INCLUDE, INPUT=none.inp\n", "no such file"),
    ],
)
def test_decks_that_are_not_followed(tmp_path: Path, cards: str, expected: str) -> None:
    (tmp_path / "x.inp").write_text(cards)
    with pytest.raises(BodyError, match=expected):
        read_deck(tmp_path / "x.inp")


def ccx_job(folder: Path, name: str = "job") -> Path:
    """K = diag(2, 2, 2, …), M = 1 of two nodes, as ccx writes them."""
    lines = "".join(f"{i + 1} {i + 1} 2.0\n" for i in range(6))
    (folder / f"{name}.sti").write_text(lines)
    (folder / f"{name}.mas").write_text(lines.replace("2.0", "1.0"))
    (folder / f"{name}.dof").write_text("".join(f"{i // 3 + 1}.{i % 3 + 1}\n" for i in range(6)))
    return folder / f"{name}.sti"


def test_dotted_names_are_names(tmp_path: Path) -> None:
    """part.v2.sti read part.sti."""
    ccx_job(tmp_path, "part")
    (tmp_path / "part.sti").write_text("9 9 9\n")
    fe = read(ccx_job(tmp_path, "part.v2"))
    assert fe.n == 6 and np.all(fe.K.diagonal() == 2.0)


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("job.sti", "3 3 2.0", "3.5 3 2.0", "3.5 where a whole number"),
        ("job.mas", "3 3 1.0", "3 3 1.0\n3 3 1.0", r"entry \(3, 3\) is given twice"),
        ("job.sti", "3 3 2.0", "3 3 nan", "NaN or Inf"),
        ("job.sti", "3 3 2.0", "nan 3 2.0", "nan where a whole number"),
        ("job.dof", "2.1", "99999999999999999999.1", "cannot be read"),
    ],
)
def test_numbers_that_are_none(
    tmp_path: Path, file: str, old: str, new: str, expected: str
) -> None:
    job = ccx_job(tmp_path)
    edit(tmp_path / file, lambda text: text.replace(old, new, 1))
    with pytest.raises(BodyError, match=expected):
        read(job)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("a=AT:0,0,nan", "finite numbers"),
        ("a=BOX:0,0,0,1,1,inf", "finite numbers"),
        ("a=NODES:99999999999999999999", "expected node numbers"),
        ("a=NODES:1.5", "expected node numbers"),
        ("a/b=NODES:1", "is no name"),
        ("a,b=NODES:1", "is no name"),
        ("..=NODES:1", "is no name"),
    ],
)
def test_places_that_are_none(tmp_path: Path, place: str, expected: str) -> None:
    fe = read(ccx_job(tmp_path))
    fe.labels, fe.points = np.array([1, 2]), np.array([[0.0, 0, 0], [1, 0, 0]])
    with pytest.raises(BodyError, match=expected):
        attach(fe, [parse("node", place)])


@pytest.mark.parametrize("damping", [{"alpha": np.nan}, {"beta": -1.0}, {"eta": np.inf}])
def test_damping_that_is_none(tmp_path: Path, damping: dict[str, float]) -> None:
    fe = read(ccx_job(tmp_path))
    with pytest.raises(BodyError, match="finite and not negative"):
        import_matrices(fe, tmp_path / "b.h5", [parse("rows", "a=ROWS:1")], **damping)
    with pytest.raises(BodyError, match="finite and not negative"):
        write_matrices(tmp_path / "b.h5", fe.K, fe.M, np.eye(6)[:, :1], **damping)


def test_indices_that_point_outside(tmp_path: Path) -> None:
    """SciPy's routines trust them: a write out of bounds, and a crash."""
    head = np.array([1211216, 2, 2, 2, 1, 1, 0, 7], dtype=">i4").tobytes()
    for name in ("K", "M"):
        (tmp_path / f"{name}.petsc").write_bytes(head + np.ones(2, dtype=">f8").tobytes())
    with pytest.raises(BodyError, match="indices from 0 to 7, expected 0 to 1"):
        read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    huge = np.array([1211216, 2**30, 2**30, 2**30], dtype=">i4").tobytes()
    (tmp_path / "K.petsc").write_bytes(huge)
    with pytest.raises(BodyError, match="truncated"):
        read(tmp_path / "K.petsc", mass=tmp_path / "M.petsc")
    for change, expected in (
        ({"ir": [0, 9]}, "indices from 0 to 9, expected 0 to 1"),
        ({"ir": [0, 0.5]}, "whole number"),
        ({"jc": [0, 1, 1]}, "2 values and 2 indices for the 1 entries"),
        ({"jc": [0, 2, 1]}, "do not rise"),
    ):
        with h5py.File(tmp_path / "b.mat", "w") as file:
            for name in ("K", "M"):
                parts = {"data": [1.0, 1.0], "ir": [0, 1], "jc": [0, 1, 2]}
                parts |= change if name == "K" else {}
                for key, values in parts.items():
                    file[f"{name}/{key}"] = np.asarray(values)
                file[name].attrs["MATLAB_sparse"] = np.uint64(2)
        with pytest.raises(BodyError, match=expected):
            read(tmp_path / "b.mat")
    with h5py.File(tmp_path / "b.mat", "r+") as file:
        del file["K/jc"]
        file.create_dataset("K/jc", (10**9,), dtype="u8")
    with pytest.raises(BodyError, match="declares 1000000000 numbers"):
        read(tmp_path / "b.mat")


def test_sizes_that_no_file_holds(tmp_path: Path) -> None:
    """A header of 8 KB asked for all memory; one without sizes was read for ever."""
    path = tmp_path / "k.mtx"
    start = "%%MatrixMarket matrix coordinate real symmetric\n"
    for text, expected in (
        (start + f"{10**9} {10**9} {10**9}\n1 1 1\n", "is not in"),
        (start[:30], "only comments"),
    ):
        path.write_text(text)
        with pytest.raises(BodyError, match=expected):
            read(path, mass=path)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("nodes: lower_plate", "nodes: [1, 2.5]", "must be node numbers"),
        ("nodes: lower_plate", "nodes: {box: [[0, 0, 0], [1, .nan, 1]]}", "box must be"),
        ("nodes: lower_plate", "nodes: {box: 3}", "box"),
        ("  lower:", "  a/b:", "is no name"),
        (
            "{E: 210.0e9, nu: 0.3, rho: 7850}",
            "{E1: 1, E2: 1, E3: 1, nu12: 0, nu13: 0, nu23: 0, G12: 1, G13: 1, G23: 1, rho: 1, "
            "axis_1: [0, 0, 0]}",
            "no direction",
        ),
        ("damping:", "supports: {base: {nodes: lower_plate, components: x}}\ndamping:", "a list"),
    ],
)
def test_descriptions_that_are_none(tmp_path: Path, old: str, new: str, expected: str) -> None:
    text = (ROOT / "meshes" / "rack.yaml").read_text()
    assert old in text
    (tmp_path / "body.yaml").write_text(
        text.replace(old, new, 1).replace("mesh: rack.msh", f"mesh: {ROOT / 'meshes' / 'rack.msh'}")
    )
    with pytest.raises(BodyError, match=expected):
        import_body(tmp_path / "body.yaml", tmp_path / "b.h5")
    assert not (tmp_path / "b.h5").exists()


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
    body = {
        "K": K,
        "M": M,
        "B": np.eye(8)[:, :1],
        "node": np.repeat([1, 2, 3], 3)[:8],
        "component": np.tile([1, 2, 3], 3)[:8],
        "position": np.eye(3),
    }
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
    with pytest.raises(BodyError, match="a file of MATLAB: that takes no further file, not --mass"):
        read(tmp_path / "x.mat", mass=tmp_path / "x.mat")


def test_a_dof_map_of_another_body(tmp_path: Path) -> None:
    """Permuted nodes: translations stay free, rotations do not."""
    mesh = box("tetra", (3, 2, 2))
    write_body_file(
        tmp_path / "mesh.h5",
        mesh,
        interfaces={"start": {"set": "start", "coupling": "distributing"}},
    )
    full = assembled(tmp_path / "full.h5", tmp_path / "mesh.h5")
    fe = FeMatrices(
        "x",
        full["K"].tocsr(),
        full["M"].tocsr(),
        node=full["node"],
        component=full["component"],
        labels=np.arange(len(mesh.points)),
        points=mesh.points,
    )
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
        edit(
            sti, lambda t: "".join("{1} {0} {2}\n".format(*line.split()) for line in t.splitlines())
        )
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
        edit(
            sti,
            lambda t: (
                t.replace("3.0000000000000e+06", "nan", 1)
                if "3.0000000000000e+06" in t
                else t.replace(t.split()[2], "nan", 1)
            ),
        )
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
