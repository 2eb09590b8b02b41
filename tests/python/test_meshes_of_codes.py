"""Meshes of universal files and ANSYS archives, against gmsh's own format, and against matrices of
ANSYS."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import gmsh
import h5py
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from conftest import assembled, run
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.body.meshfile import read_mesh
from flexgram.body.whole import mass_facts
from flexgram.importers import read

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7850.0}
#: Two blocks, swept, of tetrahedra, wedges or hexahedra, with a group of faces at each end.
GEOMETRY = """SetFactory("OpenCASCADE");
Rectangle(1) = {{0, 0, 0, 0.04, 0.03}};
{recombine}
Extrude {{0, 0, 0.1}} {{ Surface{{1}}; {layers} }}
Physical Volume("body") = {{1}};
Physical Surface("foot") = {{1}};
Physical Surface("head") = {{6}};
Mesh.MeshSizeMax = 0.02;
Mesh.SecondOrderIncomplete = 1;
Mesh.SaveGroupsOfNodes = 1;
"""


def meshed(folder: Path, shape: str, order: int) -> dict[str, Any]:
    """The same mesh by gmsh as .msh and as .unv."""
    (folder / "part.geo").write_text(
        GEOMETRY.format(
            recombine="Recombine Surface{1};" if shape == "hexahedra" else "",
            layers="" if shape == "tetrahedra" else "Layers{4}; Recombine;",
        )
    )
    found = {}
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        gmsh.open(str(folder / "part.geo"))
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        for ending in ("msh", "unv"):
            found[ending] = folder / f"part.{ending}"
            gmsh.write(str(found[ending]))
    finally:
        gmsh.finalize()
    return found


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("shape", ["tetrahedra", "wedges", "hexahedra"])
def test_universal_files_of_gmsh(shape: str, order: int, tmp_path: Path) -> None:
    """Natural frequencies are those of gmsh's own format; groups are there."""
    found = []
    for path in meshed(tmp_path, shape, order).values():
        content = {
            "mesh": path.name,
            "materials": {"steel": STEEL},
            "regions": {"all": {"material": "steel"}},
            "interfaces": {
                "head": {"coupling": "rigid", "nodes": {"box": [[0, 0, 0.1], [1, 1, 0.1]]}}
            },
            "supports": {"foot": {"nodes": {"box": [[0, 0, 0], [1, 1, 0]]}}},
        }
        facts = import_description(content, str(path), tmp_path / "body.h5", folder=tmp_path)
        a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
        squares = eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False)
        found.append((facts["elements"], np.sort(squares)))
    assert found[0][0] == found[1][0]
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-6)
    mesh = read_mesh(tmp_path / "part.unv")
    groups = {**mesh.point_sets, **mesh.cell_sets}
    assert {"body", "foot", "head"} <= set(groups)


def test_groups_of_elements_and_nodes(tmp_path: Path) -> None:
    """Labels that are no indices, exponents with D, a beam with its further line."""
    (tmp_path / "part.unv").write_text(
        "    -1\n  2411\n"
        + "".join(
            f"{label:10d}         1         1        11\n  {x}D+00  0.0D+00  0.0D+00\n"
            for label, x in ((30, 0.0), (10, 1.0), (20, 2.0))
        )
        + "    -1\n    -1\n  2412\n"
        + "         7        21         1         1         7         2\n         0 1 1\n"
        + "        30        10\n"
        + "         9        21         1         1         7         2\n         0 1 1\n"
        + "        10        20\n"
        + "        11       161         1         1         7         1\n        20\n"
        + "    -1\n    -1\n  2467\n"
        + "         1         0         0         0         0         0         0         1\n"
        + "far\n         8         9         0         0\n"
        + "         2         0         0         0         0         0         0         2\n"
        + "ends\n         7        30         0         0         7        20         0         0\n"
        + "    -1\n"
    )
    mesh = read_mesh(tmp_path / "part.unv")
    assert mesh.points[:, 0].tolist() == [1.0, 2.0, 0.0]  # by label
    assert mesh.cells[0].data.tolist() == [[2, 0], [0, 1]]
    assert mesh.cell_sets["far"][0].tolist() == [1]
    assert sorted(mesh.point_sets["ends"].tolist()) == [1, 2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("    -1\n   151\nnothing\n    -1\n", "no mesh in it"),
        ("    -1\n  2411\n         1 1 1 1\n 0. 0. 0.\n    -1\n    -1\n  2412\n"
         "         1       300         1         1         7         1\n         1\n    -1\n",
         r"not known: 300 \(1\)"),
        ("    -1\n  2411\n         1 1 1 1\n 0. 0. 0.\n    -1\n    -1\n  2412\n"
         "         1        41         1         1         7         3\n  1  1  5\n    -1\n",
         "there is no node 5"),
        ("    -1\n  2411\n         1 1 1 1\n 0. 0. zero\n    -1\n", "could not convert"),
    ],
)  # fmt: skip
def test_wrong_universal_files(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "part.unv").write_text(text)
    with pytest.raises(BodyError, match=words):
        read_mesh(tmp_path / "part.unv")


@pytest.mark.filterwarnings("ignore:.*are the units right")
def test_an_archive_gives_the_matrices_of_ansys(tmp_path: Path) -> None:
    """SOLID186 by reduced integration, of which M has other points: eigenvalues are those of
    file.full, which was made with a material of its own (by its mass and the example it is of)."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    archive = shutil.copy(examples.hexarchivefile, tmp_path / "beam.cdb")
    theirs = read(Path(examples.fullfile), deck=Path(archive))
    free = set(theirs.node.tolist())  # of file.full, which leaves out what is constrained
    nodes = range(1, len(read_mesh(Path(archive)).points) + 1)
    held = [node for node in nodes if node not in free]
    assert 0 < len(held) < 30
    content = {
        "mesh": "beam.cdb",
        "materials": {"m": {"E": 16.9e6, "nu": 0.31, "rho": 4.1408e-4}},
        "regions": {"MAT1": {"material": "m", "formulation": "reduced"}},
        "interfaces": {"tip": {"coupling": "node", "nodes": [max(free)]}},
        "supports": {"foot": {"nodes": held}},
    }
    with Path(archive).open("a") as file:  # losses of ANSYS are named, not lost without a word
        file.write("MPDATA,R5.0, 1,DMPR,       1, 1,  0.02\nDMPSTR, 0.01\nBETAD, 0.0\n")
    counts = import_description(content, "beam", tmp_path / "body.h5", folder=tmp_path)
    (note,) = (line for line in counts["summary"] if line.startswith("note: materials and"))
    assert "(DENS, DMPR, DMPSTR, EX, NUXY)" in note
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    ours = np.sort(eigsh(a["K"], 8, a["M"], sigma=0, return_eigenvectors=False))
    expected = np.sort(eigsh(theirs.K, 8, theirs.M, sigma=0, return_eigenvectors=False))
    np.testing.assert_allclose(ours, expected, rtol=2e-5)


@pytest.mark.filterwarnings("ignore:.*are the units right")
def test_tetrahedra_of_an_archive(tmp_path: Path) -> None:
    """SOLID187 without nodes between corners, beside elements that only mesh (MESH200): the volume
    is that of its box."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    shutil.copy(examples.tetarchivefile, tmp_path / "beam.cdb")
    mesh = read_mesh(tmp_path / "beam.cdb")
    assert [block.type for block in mesh.cells] == ["tetra"]
    box = np.ptp(mesh.points, axis=0)
    content = {
        "mesh": "beam.cdb",
        "materials": {"m": {"E": 7e10, "nu": 0.35, "rho": 1.0}},
        "regions": {"all": {"material": "m"}},
        "interfaces": {"tip": {"coupling": "node", "nodes": [1]}},
    }
    facts = import_description(content, "beam", tmp_path / "body.h5", folder=tmp_path)
    with h5py.File(tmp_path / "body.h5") as file:
        assert mass_facts(file).mass == pytest.approx(box.prod(), rel=1e-6)
    assert facts["elements"] == len(mesh.cells[0].data)


def test_the_command_line(tmp_path: Path) -> None:
    """A part of one material, its groups as interfaces."""
    path = meshed(tmp_path, "hexahedra", 2)["unv"]
    said = run(
        *("import", path, "--material", "steel", "--rigid", "foot=NSET:foot"),
        *("--rigid", "head=NSET:head", "-o", tmp_path / "body.h5"),
    ).out
    assert "interface head: rigid" in said and "6 of 6 rigid motions are free" in said
