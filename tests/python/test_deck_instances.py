"""Abaqus decks of parts and instances, assembled here: the same as flat ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from conftest import assembled, run
from flexgram import BodyError
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck
from flexgram.importers.deck_instances import flat

NODES = np.array([[x, y, z] for x in (0.0, 0.1, 0.2) for y in (0.0, 0.05) for z in (0.0, 0.05)])
#: Of two hexahedra between nodes at x = 0, 0.1 and 0.2.
CELLS = [[4 * i + k for k in (1, 3, 4, 2)] + [4 * i + k for k in (5, 7, 8, 6)] for i in (0, 1)]
CELLS = [[c[0], c[4], c[5], c[1], c[3], c[7], c[6], c[2]] for c in CELLS]
MATERIAL = "*Material, name=Steel\n*Elastic\n210e9, 0.3\n*Density\n7800.,\n"


def rows(points: Any, first: int = 1) -> str:
    return "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(points, first))


def part(name: str, more: str = "") -> str:
    elements = "".join(f"{k}, " + ", ".join(map(str, c)) + "\n" for k, c in enumerate(CELLS, 1))
    return (
        f"*Part, name={name}\n*Node\n{rows(NODES)}*Element, type=C3D8\n{elements}"
        "*Nset, nset=Root, generate\n1, 4, 1\n*Elset, elset=All\n1, 2\n"
        "*Elset, elset=_End_S, internal\n2,\n*Surface, type=ELEMENT, name=End\n_End_S, S4\n"
        f"{more}*Solid Section, elset=All, material=Steel\n,\n*End Part\n"
    )


#: The second box is moved and turned about z by 90°, where it then is.
ASSEMBLY = (
    "*Assembly, name=Assembly\n"
    "*Instance, name=Box-1, part=Box\n*End Instance\n"
    "*Instance, name=Box-2, part=Box\n0.25, 0., 0.\n0.25, 0., 0., 0.25, 0., 1., 90.\n"
    "*End Instance\n"
    "*Node\n1, 0.3, 0.4, 0.\n*Nset, nset=Eye\n1,\n"
    "*Nset, nset=Tip, instance=Box-2, generate\n9, 12, 1\n"
    "*Elset, elset=_Top_S, instance=Box-2\n2,\n"
    "*Surface, type=NODE, name=Tip_Face\nTip, 1.\n"
    "*Nset, nset=Side, instance=Box-1\n9, 10, 11, 12\n*Surface, type=NODE, name=Side\nSide, 1.\n"
    "*Coupling, constraint name=Hold, ref node=Eye, surface=Tip_Face\n*Kinematic\n"
    "*End Assembly\n"
)
HELD = "*Boundary\nBox-1.Root, 1, 3\n"
STEP = "*Step\n*Frequency\n6\n*End Step\n"


def deck(path: Path, assembly: str = ASSEMBLY, more: str = "", held: str = HELD) -> Path:
    path.write_text(part("Box", more) + assembly + MATERIAL + held + STEP)
    return path


def lowest(a: dict[str, Any]) -> Any:
    return np.sort(eigsh(a["K"], 6, a["M"], sigma=-1e6, return_eigenvectors=False))


def flat_deck(path: Path) -> Path:
    """The same by hand."""
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    second = NODES @ turned.T + [0.25, 0.0, 0.0]
    elements = "".join(
        f"{k + 10 * i}, " + ", ".join(str(n + 20 * i) for n in c) + "\n"
        for i in (0, 1)
        for k, c in enumerate(CELLS, 1)
    )
    path.write_text(
        f"*Node\n{rows(NODES)}{rows(second, 21)}90, 0.3, 0.4, 0.\n"
        f"*Element, type=C3D8, elset=All\n{elements}"
        "*Nset, nset=Root\n1, 2, 3, 4\n*Nset, nset=Tip\n29, 30, 31, 32\n"
        "*Surface, type=NODE, name=Tip_Face\nTip, 1.\n"
        "*Coupling, constraint name=Hold, ref node=90, surface=Tip_Face\n*Kinematic\n"
        "*Solid Section, elset=All, material=Steel\n,\n"
        + MATERIAL
        + HELD.replace("Box-1.", "")
        + STEP
    )
    return path


@pytest.mark.parametrize("ranks", [1, 2])
def test_two_instances_are_a_flat_deck(ranks: int, tmp_path: Path) -> None:
    found = []
    for path in (deck(tmp_path / "a.inp"), flat_deck(tmp_path / "b.inp")):
        facts = assemble_deck(path, tmp_path / "b.h5", [])
        assert list(facts["interfaces"]) == ["hold"]
        found.append(assembled(tmp_path / "m.h5", tmp_path / "b.h5", ranks))
    a, b = found
    assert abs(a["K"] - b["K"]).max() <= 1e-9 * abs(a["K"]).max()
    assert abs(a["M"] - b["M"]).max() <= 1e-12 * abs(a["M"]).max()
    np.testing.assert_allclose(a["B"], b["B"], atol=1e-12)


def test_names_and_numbers(tmp_path: Path) -> None:
    """Sets of one instance by their own name, and by the instance's; numbers of the second."""
    path = deck(tmp_path / "a.inp")
    for coupling, where, nodes in (
        ("distributing", "NSET:Box-1.Root", [0, 1, 2, 3]),
        ("distributing", "NSET:Box-2.Root", [12, 13, 14, 15]),
        ("rigid", "NSET:Side", [8, 9, 10, 11]),
        ("node", "NODES:103", [14]),
    ):
        assemble_deck(path, tmp_path / "b.h5", [parse(coupling, f"port={where}")])
        with h5py.File(tmp_path / "b.h5") as file:
            assert file["interfaces/port/nodes"][:].tolist() == nodes


def test_one_instance_that_is_moved(tmp_path: Path) -> None:
    """Its own names alone, and its place."""
    one = (
        "*Assembly, name=A\n*Instance, name=Only, part=Box\n0.1, 0.2, 0.3\n*End Instance\n"
        "*End Assembly\n"
    )
    path = deck(tmp_path / "a.inp", one, held="*Boundary\nOnly.Root, 1, 3\n")
    assemble_deck(path, tmp_path / "b.h5", [parse("rigid", "end=NODES:9,10,11,12")])
    with h5py.File(tmp_path / "b.h5") as file:
        np.testing.assert_allclose(file["mesh/points"][:12], NODES + np.array([[0.1, 0.2, 0.3]]))


def test_a_tie_of_two_instances(tmp_path: Path) -> None:
    """The side of the second box on the end of the first: one body."""
    tied = ASSEMBLY.replace("0.25, 0., 0.\n0.25, 0., 0., 0.25, 0., 1., 90.\n", "0.2, 0., 0.\n")
    tied = tied.replace(
        "*End Assembly", "*Tie, name=Glue\nBox-2_Root, Box-1.End\n*End Assembly"
    ).replace(
        "*Coupling",
        "*Nset, nset=Start, instance=Box-2\nRoot,\n"
        "*Surface, type=NODE, name=Box-2_Root\nStart, 1.\n*Coupling",
        1,
    )
    path = deck(tmp_path / "a.inp", tied)
    path.write_text(path.read_text().replace("C3D8", "C3D8I"))
    facts = assemble_deck(path, tmp_path / "b.h5", [])
    assert any(line.startswith("tie glue: 4 nodes") for line in facts["summary"])
    a = assembled(tmp_path / "m.h5", tmp_path / "b.h5")
    # One beam of four hexahedra.
    first = np.sqrt(lowest(a)[0])
    beam = 1.8751**2 * np.sqrt(210e9 * 0.05**4 / 12 / (7800 * 0.05**2 * 0.4**4))
    assert first == pytest.approx(beam, rel=0.1)


WRONG: dict[str, tuple[str, str]] = {
    "a part that is not there": (
        ASSEMBLY.replace("part=Box\n0.25", "part=Bolt\n0.25"),
        "part BOLT",
    ),
    "two of one name": (ASSEMBLY.replace("Box-2", "Box-1"), "two instances have one name"),
    "an instance that is not there": (
        ASSEMBLY.replace("instance=Box-1\n9", "instance=Box-3\n9"),
        "names instance BOX-3",
    ),
    "half a rotation": (ASSEMBLY.replace("0.25, 0., 1., 90.", "0.25"), "seven of a rotation"),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_what_is_refused(case: str, tmp_path: Path) -> None:
    assembly, words = WRONG[case]
    with pytest.raises(BodyError, match=words):
        assemble_deck(deck(tmp_path / "a.inp", assembly), tmp_path / "b.h5", [])


def test_equations_of_a_part_are_refused(tmp_path: Path) -> None:
    path = deck(tmp_path / "a.inp", more="*Equation\n2\n1, 1, 1., 2, 1, -1.\n")
    with pytest.raises(BodyError, match=r"EQUATION in instance BOX-1 is not supported"):
        assemble_deck(path, tmp_path / "b.h5", [])


def test_a_deck_without_instances_is_as_it_is(tmp_path: Path) -> None:
    assert flat(flat_deck(tmp_path / "b.inp")) is None


def test_from_the_command_line(tmp_path: Path) -> None:
    path = deck(tmp_path / "a.inp")
    said = run("import", path, "--assemble", "-o", tmp_path / "b.h5").out
    assert "interface hold: rigid" in said and "4 elements" in said


CAE = """*Heading
*Preprint, echo=NO, model=NO, history=NO, contact=NO
*Part, name=Plate
*Node
 1, 0., 0., 0.
 2, 100., 0., 0.
 3, 200., 0., 0.
 4, 0., 100., 0.
 5, 100., 100., 0.
 6, 200., 100., 0.
*Element, type=S4R
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*Elset, elset=Set-1
 1, 2
*Shell Section, elset=Set-1, material=Material-1
2., 5
*End Part
*Part, name=Bar
*Node
 1, 0., 0., 0.
 2, 0., 0., 50.
 3, 0., 0., 100.
*Element, type=B31
1, 1, 2
2, 2, 3
*Elset, elset=Set-1, generate
 1, 2, 1
*Beam Section, elset=Set-1, material=Material-1, temperature=GRADIENTS, section=RECT
5., 5.
1.,0.,0.
*End Part
*Assembly, name=Assembly
*Instance, name=Plate-1, part=Plate
*End Instance
*Instance, name=Bar-1, part=Bar
 200., 100., 0.
*End Instance
*Nset, nset=_PickedSet10, internal, instance=Plate-1
 1, 4
*Nset, nset="Tip Set", instance=Bar-1
 3,
*Nset, nset=s2, instance=Bar-1
 1,
*Surface, type=NODE, name=s2_CNS_, internal
s2, 1.
*Elset, elset=_Surf-1_SPOS, internal, instance=Plate-1
 2,
*Surface, type=ELEMENT, name=Surf-1
_Surf-1_SPOS, SPOS
*Tie, name=Constraint-1, adjust=yes
s2_CNS_, Surf-1
*End Assembly
*Material, name=Material-1
*Density
 7.8e-09,
*Elastic
210000., 0.3
*Boundary
_PickedSet10, ENCASTRE
*Step, name=Step-1, nlgeom=NO, perturbation
*Frequency, eigensolver=Lanczos, sim, acoustic coupling=on, normalization=mass
10, , , , ,
*End Step
"""


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_deck_as_abaqus_writes_it(ranks: int, tmp_path: Path) -> None:
    """A sheet with a bar that is tied to its corner: the bar turns with the sheet."""
    (tmp_path / "a.inp").write_text(CAE)
    tip = [parse("node", "tip=NSET:Tip Set")]
    facts = assemble_deck(tmp_path / "a.inp", tmp_path / "b.h5", tip, units="mm-t-s")
    assert facts["kinds"] == ["line", "quad"] and facts["elements"] == 4
    a = assembled(tmp_path / "m.h5", tmp_path / "b.h5", ranks)
    assert np.all(eigsh(a["K"], 4, a["M"], sigma=0, return_eigenvectors=False) > 0)
    ones = (a["component"] == 0).astype(float)
    assert ones @ a["M"] @ ones < 7800 * (0.2 * 0.1 * 0.002 + 0.1 * 0.005**2)


POINT = "*Element, type=MASS, elset=pm\n2, 5\n*Mass, elset=pm\n1000.\n"


def test_labels_of_the_assembly_are_its_own(tmp_path: Path) -> None:
    """A mass of the assembly whose number one of the second instance would have: both count."""
    own = ASSEMBLY.replace(
        "*End Assembly",
        "*Element, type=MASS, elset=own\n102, 1\n*Mass, elset=own\n500.\n*End Assembly",
    )
    facts = assemble_deck(deck(tmp_path / "a.inp", own, POINT), tmp_path / "b.h5", [])
    with h5py.File(tmp_path / "b.h5") as file:
        masses = [
            float(of.attrs["mass"]) * (len(of["nodes"]) if "nodes" in of else 1)
            for of in file["masses"].values()
        ]
    assert sum(masses) == 2500 and facts["elements"] == 4


SILENT: dict[str, tuple[str, str, str]] = {
    "a cylinder of a moved part": (
        "*Transform, nset=Root, type=C\n0.,0.,0.,0.,0.,1.\n", "", "TRANSFORM in instance BOX-2"),
    "a number that is none": ("*Node\n90, abc, 0., 0.\n", "", "expected a label and a place"),
    "an option of a coupling": (
        "", "surface=Tip_Face, influence radius=0.1", "INFLUENCE RADIUS is not supported"),
    "a weighting": (
        "", "surface=Tip_Face\n*Distributing, weighting method=QUADRATIC",
        "WEIGHTING METHOD=QUADRATIC is not supported"),
}  # fmt: skip


@pytest.mark.parametrize("case", list(SILENT))
def test_what_would_be_passed_over(case: str, tmp_path: Path) -> None:
    more, surface, words = SILENT[case]
    assembly = ASSEMBLY.replace("surface=Tip_Face", surface) if surface else ASSEMBLY
    if "weighting" in surface:
        assembly = assembly.replace("*Kinematic\n", "")
    with pytest.raises(BodyError, match=words):
        assemble_deck(deck(tmp_path / "a.inp", assembly, more), tmp_path / "b.h5", [])


def test_a_quoted_instance_of_a_set(tmp_path: Path) -> None:
    quoted = ASSEMBLY.replace("Box-1", '"Box 1"').replace(
        "*End Assembly", '*Nset, nset=Mine\n"Box 1".Root\n*End Assembly'
    )
    path = deck(tmp_path / "a.inp", quoted, held='*Boundary\n"Box 1".Root, 1, 3\n')
    assemble_deck(path, tmp_path / "b.h5", [parse("node", "a=NODES:9")])
    assemble_deck(path, tmp_path / "b.h5", [parse("distributing", "port=NSET:Mine")])
    with h5py.File(tmp_path / "b.h5") as file:
        assert file["interfaces/port/nodes"][:].tolist() == [0, 1, 2, 3]
