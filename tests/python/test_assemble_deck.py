"""CalculiX decks assembled by flexgram: as ccx has them, without its printed digits."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from test_importers import ccx_frequencies
from test_loss_factors import stored

from bodies import CALCULIX, box
from conftest import ROOT, assembled, read_sparse, run
from flexgram import BodyError, ReducedModel
from flexgram.body.terms import law_of
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck
from flexgram.importers.ccx import damping_of, read_job

sys.path.insert(0, str(ROOT / "scripts"))
from ccx_reference import deck_of

EYE = [parse("distributing", "eye=NSET:END")]
TIP = [parse("node", "tip=NODES:40")]


def deck(path: Path, element: str, *, model: str = "", step: str = "", held: str = "") -> Path:
    """A bent bar; its ends are node sets."""
    mesh = box(CALCULIX[element], (5, 2, 2), (0.2, 0.04, 0.05))
    lines = deck_of(element, mesh)
    for name in ("start", "end"):
        lines += [f"*NSET, NSET={name.upper()}"]
        lines += [f"{n + 1}" for n in mesh.point_sets[name].tolist()]
    # Two sections of one material, labels that are no indices.
    text = "\n".join(lines).replace("*SOLID SECTION, ELSET=BODY", "*SOLID SECTION,ELSET=BODY")
    text += f"\n{model}*STEP\n*FREQUENCY\n8\n{held}*END STEP\n{step}"
    path.write_text(text)
    return path


def shifted(path: Path, by: int) -> None:
    """All node labels moved: they are no indices then."""
    out, keyword = [], ""
    for line in path.read_text().splitlines():
        if line.startswith("*"):
            keyword = line.upper().replace(" ", "")
            out.append(line)
            continue
        words = line.split(",")
        if keyword.startswith("*NODE"):
            words[0] = str(int(words[0]) + by)
        elif keyword.startswith("*NSET"):
            words = [str(int(w) + by) for w in words]
        elif keyword.startswith("*ELEMENT"):
            first = not (out[-1].endswith(",") and not out[-1].startswith("*"))
            words = [
                w if (first and i == 0) or not w.strip() else f" {int(w) + by}"
                for i, w in enumerate(words)
            ]
        out.append(",".join(words))
    path.write_text("\n".join(out) + "\n")


@pytest.mark.parametrize("element", ["C3D4", "C3D6", "C3D8", "C3D10", "C3D15", "C3D20", "C3D20R"])
def test_frequencies_are_those_of_ccx(element: str, tmp_path: Path) -> None:
    if shutil.which("ccx") is None:
        pytest.skip("ccx is not installed")
    path = deck(tmp_path / "bar.inp", element, held="*BOUNDARY\nSTART, 1, 3\n")
    shifted(path, 1000)
    subprocess.run(["ccx", "bar"], cwd=tmp_path, check=True, capture_output=True)
    rows = re.findall(
        r"^\s+\d+\s+\S+\s+\S+\s+(\S+)\s+\S+\s*$", (tmp_path / "bar.dat").read_text(), re.MULTILINE
    )
    theirs = np.array([float(row) for row in rows[:8]])
    counts = assemble_deck(path, tmp_path / "bar.h5", EYE)
    assert counts["interfaces"]["eye"]["coupling"] == "distributing"
    body = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5")
    ours = eigsh(body["K"], 8, body["M"], sigma=0, return_eigenvectors=False)
    ours = np.sqrt(np.sort(ours)) / (2 * np.pi)
    assert np.abs(ours / theirs - 1).max() < 5.5e-7  # seven digits


POINTS = (
    "*ELEMENT, TYPE=MASS, ELSET=WEIGHTS\n9001, 8\n9002, 30\n*MASS, ELSET=WEIGHTS\n0.3\n"
    "*ELEMENT, TYPE=SPRINGA, ELSET=ROD\n9003, 12, 51\n*SPRING, ELSET=ROD\n\n4000000.\n"
    "*ELEMENT, TYPE=SPRING1, ELSET=FOOT\n9004, 20\n*SPRING, ELSET=FOOT\n2\n3.e7\n"
)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("element", ["C3D4", "C3D10"])
def test_masses_and_springs_are_those_of_ccx(element: str, tmp_path: Path) -> None:
    held = "*BOUNDARY\nSTART, 1, 3\n"
    found = []
    for name, model in (("plain", ""), ("loaded", POINTS)):
        path = deck(tmp_path / f"{name}.inp", element, model=model, held=held)
        theirs = np.array(ccx_frequencies(path)[:8])
        counts = assemble_deck(path, tmp_path / f"{name}.h5", EYE)
        body = assembled(tmp_path / f"{name}_m.h5", tmp_path / f"{name}.h5")
        ours = eigsh(body["K"], 8, body["M"], sigma=0, return_eigenvectors=False)
        ours = np.sqrt(np.sort(ours)) / (2 * np.pi)
        assert np.abs(ours / theirs - 1).max() < 1e-6
        found.append(ours)
    assert any(
        "2 point masses and 2 springs and dashpots" in remark for remark in counts["remarks"]
    )
    assert np.abs(found[1] / found[0] - 1).max() > 0.05


def test_a_spring_off_its_line_is_refused(tmp_path: Path) -> None:
    model = "*ELEMENT, TYPE=SPRING2, ELSET=S\n9003, 12, 51\n*SPRING, ELSET=S\n1, 1\n4000000.\n"
    path = deck(tmp_path / "bar.inp", "C3D4", model=model)
    with pytest.raises(BodyError, match="do not lie along its direction"):
        assemble_deck(path, tmp_path / "bar.h5", EYE)


def test_dashpots_of_a_deck(tmp_path: Path) -> None:
    model = "*ELEMENT, TYPE=DASHPOTA, ELSET=D\n9003, 12, 51\n*DASHPOT, ELSET=D\n\n40.\n"
    path = deck(tmp_path / "bar.inp", "C3D4", model=model)
    assemble_deck(path, tmp_path / "bar.h5", EYE)
    run("assemble", "-body", tmp_path / "bar.h5", "-body_out", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5") as file:
        D = read_sparse(file, "D").toarray()
        position = file["nodes/position"][:]
    line = position[50] - position[11]
    n = line / np.linalg.norm(line)
    rows = np.flatnonzero(abs(D).max(axis=1))
    expected = 40.0 * np.kron([[1, -1], [-1, 1]], np.outer(n, n))
    np.testing.assert_allclose(D[np.ix_(rows, rows)], expected, atol=1e-9)


def test_the_command_line(tmp_path: Path) -> None:
    path = deck(tmp_path / "bar.inp", "C3D20", model="*DAMPING, ALPHA=7.0\n")
    text = path.read_text().replace("*SOLID SECTION", "*DAMPING, ALPHA=7.0\n*SOLID SECTION")
    path.write_text(text.replace("\n*DAMPING, ALPHA=7.0\n*STEP", "\n*STEP"))
    unused = "*MATERIAL, NAME=ALU\n*ELASTIC\n70000., .3\n*DENSITY\n2.7e-9\n"
    path.write_text(path.read_text().replace("*MATERIAL", unused + "*MATERIAL", 1))
    shifted(path, 500)
    said = run(
        "import",
        path,
        "--assemble",
        "--rigid",
        "eye=NSET:end",
        "--node",
        "tip=NODES:501",
        "-o",
        tmp_path / "bar.h5",
    ).out
    assert "damping of the deck (*DAMPING): alpha 7" in said and "ALU" not in said
    run(
        "reduce",
        "-body",
        tmp_path / "bar.h5",
        "-mor_band_hz",
        "10,9000",
        "-mor_tol",
        1e-4,
        "-mor_out",
        tmp_path / "rom.h5",
    )
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.certified_error <= 1e-4 and rom.frame["rigid_modes"] == 6
    assert rom.inputs[:2] == ["eye.fx", "eye.fy"] and rom.inputs[6:] == [
        "tip.fx",
        "tip.fy",
        "tip.fz",
    ]
    assert not rom.data_rounding.any()  # nothing was printed
    assert rom.floor.max() < 1e-6  # of plain sums, which are enough here


@pytest.mark.parametrize(
    ("element", "change", "expected"),
    [
        ("C3D10", ("TYPE=C3D10", "TYPE=C3D10E"), "elements C3D10E are not supported"),
        ("C3D10", ("*STEP", "*CONTACT PAIR\nA,B\n*STEP"), r"\*CONTACT PAIR is not supported"),
        ("C3D10", ("210e9, 0.3", "210e9, 0.3, 20.\n200e9, 0.3, 80."), "depends on temperature"),
        ("C3D10", ("*DENSITY\n7850\n", ""), r"line \d+: .* material STEEL has no \*DENSITY"),
        ("C3D10", ("*ELASTIC\n210e9, 0.3\n", ""), r"material STEEL has no \*ELASTIC"),
        ("C3D10", ("ELSET=BODY, MATERIAL", "ELSET=BOBY, MATERIAL"), "there are BODY"),
        ("C3D10", ("*SOLID SECTION", "*SOILD SECTION"), r"line \d+: .* you mean \*SOLID SECTION"),
        ("C3D10", ("TYPE=C3D10", "TYPE=C3D10X"), "did you mean C3D10"),
        ("C3D10", ("210e9, 0.3", "210e9, 0.5"), r"\.inp: materials: .*nu = 0.5 must be above -1"),
        ("C3D10", ("210e9, 0.3", "-210e9, 0.3"), "Young's modulus must be positive"),
        ("C3D10", ("8\n*END STEP", "8\n*BOUNDARY\nEND,1,1,0.1\n*END STEP"), "moves nodes by 0.1"),
        ("C3D10", ("8\n*END STEP", "8\n*BOUNDARY\nNOWHERE,1\n*END STEP"), "no node set NOWHERE"),
        (
            "C3D10",
            ("MATERIAL=STEEL", "MATERIAL=GOLD"),
            "there is no material GOLD; there are STEEL",
        ),
    ],
)
def test_what_is_not_followed(
    element: str, change: tuple[str, str], expected: str, tmp_path: Path
) -> None:
    path = deck(tmp_path / "bar.inp", element)
    text = path.read_text()
    assert not change[0] or change[0] in text
    path.write_text(text.replace(*change) if change[0] else text)
    with pytest.raises(BodyError, match=expected):
        assemble_deck(path, tmp_path / "bar.h5", EYE)


def test_what_is_not_linear_is_told(tmp_path: Path) -> None:
    path = deck(tmp_path / "bar.inp", "C3D10")
    text = path.read_text()
    path.write_text(text.replace("*DENSITY", "*PLASTIC\n2e8, 0.\n*DENSITY", 1))
    facts = assemble_deck(path, tmp_path / "bar.h5", EYE)
    assert "*PLASTIC left out: the reduced body is linear" in facts["remarks"]
    path.write_text(text)
    facts = assemble_deck(path, tmp_path / "bar.h5", EYE)
    assert not any("linear" in line for line in facts["remarks"])


def test_surfaces_of_gmsh(tmp_path: Path) -> None:
    """Elements of planes without a section bound the solids: K and M do not change."""
    path = deck(tmp_path / "bar.inp", "C3D10")
    assemble_deck(path, tmp_path / "plain.h5", EYE)
    text = path.read_text()
    skin = "*ELEMENT, TYPE=CPS6, ELSET=SURFACE1\n90001, 1, 2, 3, 4, 5, 6\n"
    path.write_text(text.replace("*MATERIAL", f"{skin}*MATERIAL", 1))
    facts = assemble_deck(path, tmp_path / "bar.h5", EYE)
    assert any("CPS6 are left out" in line for line in facts["remarks"])
    with h5py.File(tmp_path / "plain.h5") as plain, h5py.File(tmp_path / "bar.h5") as bar:
        assert list(plain["mesh/blocks"]) == list(bar["mesh/blocks"])
        assert np.array_equal(plain["mesh/points"][:], bar["mesh/points"][:])
    path.write_text(
        path.read_text() + "*SOLID SECTION, ELSET=SURFACE1, MATERIAL=STEEL\n"
        if "*STEP" not in text
        else path.read_text().replace(
            "*STEP", "*SOLID SECTION, ELSET=SURFACE1, MATERIAL=STEEL\n*STEP", 1
        )
    )
    with pytest.raises(BodyError, match="ELSET=SURFACE1"):
        assemble_deck(path, tmp_path / "bar.h5", EYE)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
def test_hexahedra_that_bend(tmp_path: Path) -> None:
    """C3D8I and C3D8R are taken as ours, near ccx' C3D20; the import says so."""
    squares = {}
    for element in ("C3D8I", "C3D8R", "C3D20"):
        path = deck(tmp_path / "bar.inp", element, held="*BOUNDARY\nSTART, 1, 3\n")
        counts = assemble_deck(path, tmp_path / "bar.h5", EYE)
        said = " ".join(counts["remarks"])
        assert ("taken as hexahedra with incompatible modes" in said) == (element != "C3D20")
        body = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5")
        found = eigsh(body["K"], 4, body["M"], sigma=0, return_eigenvectors=False)
        squares[element] = np.sort(found)
    np.testing.assert_allclose(squares["C3D8I"], squares["C3D8R"], rtol=1e-9)
    hertz = {element: np.sqrt(of) for element, of in squares.items()}
    np.testing.assert_allclose(hertz["C3D8R"], hertz["C3D20"], rtol=0.08)


def with_loss_factors(path: Path, first: float, second: float) -> Path:
    """The bar, a tenth of its elements of a second material, with a loss factor for each."""
    text = deck(path, "C3D10").read_text()
    name = re.search(r"\*MATERIAL, *NAME=(\w+)", text)[1]
    start = text.index("*SOLID SECTION")
    more = (
        "*MATERIAL, NAME=MOUNT\n*ELASTIC\n2e9, 0.4\n*DENSITY\n1200.\n"
        f"*DAMPING, STRUCTURAL={second}\n*ELSET, ELSET=SOFT, GENERATE\n1, 12\n"
        "*SOLID SECTION, ELSET=SOFT, MATERIAL=MOUNT\n"
    )
    text = text[:start] + text[start:].replace("*STEP", more + "*STEP", 1)
    text = re.sub(
        rf"\*MATERIAL, *NAME={name}\n", rf"\g<0>*DAMPING, STRUCTURAL={first}\n", text, count=1
    )
    path.write_text(text)
    return path


@pytest.mark.parametrize("ranks", [1, 2])
def test_loss_factors_of_its_materials(ranks: int, tmp_path: Path) -> None:
    found = {}
    for name, (first, second) in {"a": (1, 0), "b": (0, 1), "both": (0.01, 0.2)}.items():
        path = with_loss_factors(tmp_path / f"{name}.inp", first, second)
        counts = assemble_deck(path, tmp_path / f"{name}.h5", EYE)
        assert any(f"MOUNT {second:g}" in remark for remark in counts["remarks"])
        found[name] = stored(tmp_path / f"{name}.h5", ranks)
    a, b, both = (found[name]["S"] for name in found)
    assert abs(a + b - found["a"]["K"]).max() < 1e-14 * abs(found["a"]["K"]).max()
    assert abs(0.01 * a + 0.2 * b - both).max() < 1e-15 * abs(both).max() + 1e-14 * abs(a).max()
    assert 0 < b.nnz and abs(b).sum() < 0.1 * abs(a).sum()
    # What is given takes the place of what the deck has.
    assemble_deck(tmp_path / "both.inp", tmp_path / "eta.h5", EYE, eta=0.05)
    assert stored(tmp_path / "eta.h5", ranks)["eta"] == 0.05


@pytest.mark.parametrize("moduli", ["LONG TERM", "INSTANTANEOUS"])
def test_relaxation_of_its_materials(moduli: str, tmp_path: Path) -> None:
    """Abaqus' *VISCOELASTIC, TIME=PRONY: the body that YAML's `viscoelastic` makes, here by the
    limits of H: its static and its fastest stiffness."""
    path = deck(tmp_path / "bar.inp", "C3D20")
    text = path.read_text()
    E, nu = (float(x) for x in re.search(r"\*ELASTIC\n([^,]+),([^\n]+)", text).groups())
    card = f"*ELASTIC, MODULI={moduli}\n"
    rows = "*VISCOELASTIC, TIME=PRONY\n0.2, 0.2, 1e-7\n0.3, 0.3, 1e-8\n"
    text = text.replace("*ELASTIC\n", card)
    path.write_text(re.sub(r"(\*ELASTIC, .*\n.*\n)", lambda m: m.group(1) + rows, text))
    body = tmp_path / "bar.h5"
    said = run("import", path, "--assemble", *("--distributing", "eye=NSET:END"), "-o", body).out
    assert "relaxation of the deck's materials (*VISCOELASTIC)" in said
    with h5py.File(body) as file:
        (material,) = file["materials"].values()
        share = 1.0 if moduli == "LONG TERM" else 0.5
        assert material.attrs["E"] == pytest.approx(share * E)
        assert material.attrs["nu"] == pytest.approx(nu)
        assert material["whole"].attrs["g"] == pytest.approx([0.4, 0.6])
        assert list(material["whole"].attrs["tau"]) == [1e-7, 1e-8]
    path.write_text(path.read_text().replace("0.2, 0.2, 1e-7", "0.2, 0.1, 1e-7"))
    run("import", path, "--assemble", *("--distributing", "eye=NSET:END"), "-o", body)
    with h5py.File(body) as file:
        (material,) = file["materials"].values()
        assert set(material) == {"shear", "bulk"}
    path.write_text(path.read_text().replace("TIME=PRONY", "TIME=CREEP TEST DATA"))
    with pytest.raises(BodyError, match="TIME=PRONY, FREQUENCY=PRONY and FREQUENCY=TABULAR"):
        assemble_deck(path, body, EYE)


def by_frequency(path: Path, card: str, rows: Iterable[Sequence[float]]) -> Path:
    """The bar, of a material with *VISCOELASTIC by frequency."""
    lines = "".join(", ".join(f"{x:.12g}" for x in row) + "\n" for row in rows)
    text = deck(path, "C3D20").read_text()
    with_card = rf"\g<1>*VISCOELASTIC, FREQUENCY={card}\n{lines}"
    path.write_text(re.sub(r"(\*ELASTIC\n.*\n)", with_card, text, count=1))
    return path


@pytest.mark.parametrize("bulk", ["alike", "none", "its own"])
def test_relaxation_by_frequency(bulk: str, tmp_path: Path) -> None:
    """Tables of Abaqus are those of a Prony series to what lies between their rows: K and the laws
    of shear and bulk at frequencies of no row."""
    g, tau = np.array([0.3, 0.2]), np.array([2e-3, 1e-4])
    k = {"alike": g, "none": 0 * g, "its own": np.array([0.1, 0.05])}[bulk]
    hz = np.geomspace(1, 1e4, 400)
    series = list(zip(g, k, tau, strict=True))

    def relative(shares: Any, w: Any) -> Any:  # Re, Im of ωg*: loss, and 1 - storage
        z = 1j * w[:, None] * tau
        factor = 1 + (z / (1 + z)) @ (shares / (1 - shares.sum()))
        return factor.imag, 1 - factor.real

    table = np.column_stack([*relative(g, 2 * np.pi * hz), *relative(k, 2 * np.pi * hz), hz])
    shuffled = np.random.default_rng(1).permutation(table)
    laws, moduli = {}, {}
    for card, rows in (("PRONY", series), ("TABULAR", shuffled)):
        body = tmp_path / f"{card}.h5"
        assemble_deck(by_frequency(tmp_path / f"{card}.inp", card, rows), body, EYE)
        with h5py.File(body) as file:
            (material,) = file["materials"].values()
            moduli[card] = (float(material.attrs["E"]), float(material.attrs["nu"]))
            laws[card] = {
                part: law_of(str(group.attrs["law"]), group.attrs, part)
                for part, group in material.items()
            }
    assert (
        set(laws["PRONY"])
        == set(laws["TABULAR"])
        == {
            "alike": {"whole"},
            "none": {"shear"},
            "its own": {"shear", "bulk"},
        }[bulk]
    )
    w = 2 * np.pi * np.geomspace(1.3, 9e3, 77)
    least, own = (
        {"shear": E / (2 * (1 + nu)), "bulk": E / (3 * (1 - 2 * nu)), "whole": E}
        for E, nu in (moduli["PRONY"], moduli["TABULAR"])
    )
    for part, law in laws["PRONY"].items():
        expected = least[part] * (1 + law.at(w))
        found = own[part] * (1 + laws["TABULAR"][part].at(w))
        np.testing.assert_allclose(found, expected, rtol=2e-4)
    if bulk == "none":
        assert own["bulk"] == pytest.approx(least["bulk"], rel=1e-12)


@pytest.mark.parametrize(
    ("card", "rows", "words"),
    [
        ("TABULAR", [(0.1, -0.1, 0.1, 10)], "expected rows of five numbers"),
        ("TABULAR, PRELOAD=UNIAXIAL", [(1, 2, 3, 0)], "FREQUENCY=TABULAR without PRELOAD"),
        ("FORMULA", [(1, 2, 3, 1, 2, 3)], "TIME=PRONY, FREQUENCY=PRONY and FREQUENCY=TABULAR"),
    ],
)
def test_relaxation_that_is_not_read(card: str, rows: Any, words: str, tmp_path: Path) -> None:
    path = by_frequency(tmp_path / "bar.inp", card, rows)
    with pytest.raises(BodyError, match=words):
        assemble_deck(path, tmp_path / "bar.h5", EYE)


def test_stored_matrices_name_loss_factors_of_materials(tmp_path: Path) -> None:
    damping = damping_of(read_job(with_loss_factors(tmp_path / "bar.inp", 0.01, 0.2)))
    assert damping.eta == 0 and sorted(damping.loss_factors.values()) == [0.01, 0.2]
    same = damping_of(read_job(with_loss_factors(tmp_path / "bar.inp", 0.1, 0.1)))
    assert same.eta == 0.1 and not same.loss_factors


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_rigid_body_is_that_of_ccx(ranks: int, tmp_path: Path) -> None:
    """With a mass at its reference node and a spring to ground, frequencies to printed digits."""
    text = (
        "*NODE\n9901, 0.25, 0.03, 0.01\n9902, 0.25, 0.03, 0.01\n"
        "*RIGID BODY, NSET=END, REF NODE=9901, ROT NODE=9902\n"
        "*ELEMENT, TYPE=MASS, ELSET=WEIGHT\n9903, 9901\n*MASS, ELSET=WEIGHT\n0.4\n"
    )
    path = deck(tmp_path / "bar.inp", "C3D10", model=text, held="*BOUNDARY\nSTART, 1, 3\n")
    subprocess.run(["ccx", "bar"], cwd=tmp_path, check=True, capture_output=True)
    theirs = np.array(ccx_frequencies(tmp_path / "bar.dat")[:8])
    facts = assemble_deck(path, tmp_path / "bar.h5", [])
    assert facts["interfaces"]["end"]["coupling"] == "rigid"
    body = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5", ranks)
    ours = eigsh(body["K"], 8, body["M"], sigma=0, return_eigenvectors=False)
    assert np.abs(np.sqrt(np.sort(ours)) / (2 * np.pi) / theirs - 1).max() < 1e-6
    held = text + "*BOUNDARY\n9901, 1, 3\n9902, 1, 3\n"
    deck(tmp_path / "held.inp", "C3D10", model=held)
    facts = assemble_deck(tmp_path / "held.inp", tmp_path / "held.h5", TIP)
    assert "end" not in facts["interfaces"] and "0 of 6 rigid motions" in facts["summary"][1]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("pinned", ["9901, 1, 3\n", "9902, 3\n"])
def test_a_rigid_body_that_is_held_in_part_is_that_of_ccx(
    pinned: str, ranks: int, tmp_path: Path
) -> None:
    """Hinges and sliders, with a mass at the reference node; frequencies to printed digits."""
    text = (
        "*NODE\n9901, 0.25, 0.03, 0.01\n9902, 0.25, 0.03, 0.01\n"
        "*RIGID BODY, NSET=END, REF NODE=9901, ROT NODE=9902\n"
        "*ELEMENT, TYPE=MASS, ELSET=WEIGHT\n9903, 9901\n*MASS, ELSET=WEIGHT\n0.4\n"
    )
    held = f"*BOUNDARY\nSTART, 1, 3\n{pinned}"
    path = deck(tmp_path / "bar.inp", "C3D10", model=text, held=held)
    subprocess.run(["ccx", "bar"], cwd=tmp_path, check=True, capture_output=True)
    theirs = np.array(ccx_frequencies(tmp_path / "bar.dat")[:6])
    facts = assemble_deck(path, tmp_path / "bar.h5", TIP)
    assert any("end is no interface: its reference is held" in r for r in facts["remarks"])
    body = assembled(tmp_path / "matrices.h5", tmp_path / "bar.h5", ranks)
    ours = eigsh(body["K"], 6, body["M"], sigma=0, return_eigenvectors=False)
    assert np.abs(np.sqrt(np.sort(ours)) / (2 * np.pi) / theirs - 1).max() < 1e-6
