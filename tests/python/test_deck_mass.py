"""*NONSTRUCTURAL MASS of Abaqus decks."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from test_assemble_deck import TIP, deck

from conftest import assembled
from flexgram import BodyError
from flexgram.body.whole import mass_facts
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck

SHEETS = (
    "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,2,0,0\n6,2,1,0\n7,2,2,0\n8,1,2,0\n9,2,0,1\n"
    "*ELEMENT, TYPE=S4, ELSET=E\n1,1,2,3,4\n2,2,5,6,3\n3,3,6,7,8\n"
    "*ELEMENT, TYPE=B31, ELSET=P\n9,5,9\n*ELSET, ELSET=SOME\n2,3\n"
    "*MATERIAL, NAME=M\n*ELASTIC\n1e9,.3\n*DENSITY\n{rho}\n*DAMPING, STRUCTURAL=0.01\n"
    "*MATERIAL, NAME=N\n*ELASTIC\n1e9,.3\n*DENSITY\n500.\n"
    "*SHELL SECTION, ELSET=E, MATERIAL=M\n.02\n"
    "*BEAM SECTION, ELSET=P, MATERIAL=N, SECTION=RECT\n.02, .03\n1.,0.,0.\n{model}"
    "*BOUNDARY\n1,1,6\n4,1,6\n*STEP\n*FREQUENCY\n4\n*END STEP\n"
)


def facts_of(folder: Path, model: str, rho: float = 1000.0) -> tuple[float, np.ndarray, str]:
    path = folder / "sheets.inp"
    path.write_text(SHEETS.format(model=model, rho=rho))
    said = assemble_deck(path, folder / "s.h5", [parse("node", "tip=NODES:7")])
    with h5py.File(folder / "s.h5") as file:
        facts = mass_facts(file)
    return facts.mass, facts.centre * facts.mass, " ".join(said["remarks"])


def card(units: str, value: float, elset: str = "SOME", more: str = "") -> str:
    return f"*NONSTRUCTURAL MASS, ELSET={elset}, UNITS={units}{more}\n{value}\n"


@pytest.mark.parametrize(
    ("text", "added"),
    [
        (card("MASS PER AREA", 3.0), {2: 3.0, 3: 3.0}),
        (card("MASS PER VOLUME", 50.0), {2: 1.0, 3: 1.0}),
        (card("TOTAL MASS", 7.0), {2: 3.5, 3: 3.5}),
        (card("total mass", 7.0, more=", DISTRIBUTION=VOLUME PROPORTIONAL"), {2: 3.5, 3: 3.5}),
        (card("MASS PER LENGTH", 0.4, "P"), {9: 0.4}),
        (card("MASS PER AREA", 3.0) + card("TOTAL MASS", -6.0, "E"), {1: -2.0, 2: 1.0, 3: 1.0}),
    ],
)
def test_masses_are_where_they_belong(text: str, added: dict[int, float], tmp_path: Path) -> None:
    plain, first, _ = facts_of(tmp_path, "")
    mass, moment, said = facts_of(tmp_path, text)
    middle = {1: [0.5, 0.5, 0], 2: [1.5, 0.5, 0], 3: [1.5, 1.5, 0], 9: [2, 0, 0.5]}
    assert mass == pytest.approx(plain + sum(added.values()), rel=1e-9)
    more = sum(value * np.array(middle[label]) for label, value in added.items())
    np.testing.assert_allclose(moment, first + more, rtol=1e-9, atol=1e-9)
    assert "nonstructural mass of the deck" in said


def test_it_is_a_larger_density(tmp_path: Path) -> None:
    """K, M and losses are those of a deck with that density, on two ranks too."""
    found = []
    for model, rho, name in ((card("MASS PER VOLUME", 250.0, "E"), 1e3, "M-m1"), ("", 1250.0, "M")):
        facts_of(tmp_path, model, rho)
        found.append([assembled(tmp_path / "m.h5", tmp_path / "s.h5", ranks) for ranks in (1, 2)])
        with h5py.File(tmp_path / "s.h5") as file:
            assert sorted(file["materials"]) == sorted([name, "N"])
            assert file["materials"][name].attrs["loss_factor"] == 0.01
    for a, b in zip(*found, strict=True):
        for which in ("K", "M"):
            assert abs(a[which] - b[which]).max() < 1e-12 * abs(b[which]).max()


def test_of_solids(tmp_path: Path) -> None:
    masses = []
    for model in ("", card("TOTAL MASS", 2.0, "EALL")):
        path = deck(tmp_path / "bar.inp", "C3D10", model=model)
        text = path.read_text()
        name = next(w for w in text.upper().split("ELSET=")[1:]).split(",")[0].split("\n")[0]
        path.write_text(text.replace("ELSET=EALL, UNITS", f"ELSET={name}, UNITS"))
        assemble_deck(path, tmp_path / "bar.h5", TIP)
        with h5py.File(tmp_path / "bar.h5") as file:
            masses.append(mass_facts(file).mass)
    assert masses[1] - masses[0] == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (card("MASS PER LENGTH", 3.0), "element 2 has no mass per length"),
        (card("MASS PER AREA", 3.0, "P"), "element 9 has no mass per area"),
        (card("KILOGRAMS", 3.0), "UNITS=KILOGRAMS must be"),
        (card("TOTAL MASS", 3.0, "NONE"), "no such element set"),
        (card("TOTAL MASS", -300.0), "takes more from element 2 than it has"),
        (card("TOTAL MASS", 3.0, more=", COLOR=RED"), "COLOR is not supported"),
    ],
)
def test_what_is_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        facts_of(tmp_path, text)
