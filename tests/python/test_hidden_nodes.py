"""Decks and matrices of others: nodes that a code adds, empty matrices, cards that nobody needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.sparse as sp
from test_importers import FREQUENCY, ccx, write_deck

import flexgram
from bodies import box
from conftest import CLAMPED, body_system, message, run
from flexgram import BodyError, ReducedModel
from flexgram.body.description import import_description
from flexgram.body.matrices import Matrices
from flexgram.importers import read
from flexgram.importers.nastran import _cards_of


@ccx
def test_nodes_of_incompatible_elements_have_places(tmp_path: Path) -> None:
    """C3D8I: internal nodes have none, but the real ones do."""
    deck = write_deck(tmp_path / "box.inp", "C3D8I", FREQUENCY)
    mesh = box("hexahedron", (4, 2, 2))
    labels = ",".join(str(n + 10) for n in mesh.point_sets["end"])
    at = ",".join(f"{x:.9g}" for x in mesh.points[mesh.point_sets["start"][0]])
    out, maps = ("-o", tmp_path / "b.h5"), []
    for words in (f"end=NODES:{labels}", "end=NSET:END"):
        done = run("import", deck, "--run-ccx", "--rigid", words, "--node", f"p=AT:{at}", *out)
        assert "6 of 6 rigid motions are free" in done.out and "mass" in done.out
        with h5py.File(tmp_path / "b.h5") as file:
            maps.append(file["B"][:])
            assert len(file["B"].attrs["names"]) == 9
    assert np.array_equal(*maps)
    spread = ("--distributing", "end=NSET:END", "-o", tmp_path / "c.h5")
    assert "interface end: distributing" in run("import", deck, "--run-ccx", *spread).out


@ccx
@pytest.mark.parametrize("kind", ["S8R", "S4", "S4R"])
def test_nodes_of_free_shells_by_number(kind: str, tmp_path: Path) -> None:
    """As by set: every node that ccx makes of it; one integration point is warned of."""
    lines = ["*NODE, NSET=NALL"]
    eight = kind.startswith("S8")
    step = 0.5 if eight else 1.0
    label: dict[tuple[float, float], int] = {}
    for i in np.arange(0, 4 + step, step):
        for j in np.arange(0, 2 + step, step):
            if eight and i % 1 and j % 1:
                continue
            label[float(i), float(j)] = len(label) + 1
            lines.append(f"{len(label)}, {0.1 * i}, {0.1 * j}, 0")
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=EALL")
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if eight:
        around += [(0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5)]
    for i in range(4):
        for j in range(2):
            nodes = [label[float(i + a), float(j + b)] for a, b in around]
            lines.append(f"{2 * i + j + 1}, " + ", ".join(map(str, nodes)))
    end = [n for (i, _), n in label.items() if i == 4]
    lines += ["*NSET, NSET=END", *(f"{n}," for n in end)]
    lines.append(
        "*MATERIAL, NAME=STEEL\n*ELASTIC\n210e9, 0.3\n*DENSITY\n7850\n"
        "*SHELL SECTION, ELSET=EALL, MATERIAL=STEEL\n0.01"
    )
    deck = tmp_path / "plate.inp"
    deck.write_text("\n".join(lines) + "\n" + FREQUENCY)
    found = []
    for word in ("NSET:END", "NODES:" + ",".join(map(str, end))):
        done = run(
            "import", deck, "--run-ccx", "--distributing", f"p={word}", "-o", tmp_path / "b.h5"
        )
        with h5py.File(tmp_path / "b.h5") as file:
            found.append(file["B"][:])
    assert np.array_equal(found[0], found[1])
    assert ("hourglass" in done.out) == (kind == "S4R")


@ccx
def test_the_hourglass_stiffness_is_named(tmp_path: Path) -> None:
    """A free distorted C3D8R body resists rotation in ccx: the cause, and what takes its place."""
    deck = write_deck(tmp_path / "box.inp", "C3D8I", FREQUENCY)
    text = deck.read_text()
    deck.write_text(text.replace("C3D8I", "C3D8R"))
    failed = run(
        "import", deck, "--run-ccx", "--node", "end=NSET:END", "-o", tmp_path / "b.h5", expect=1
    )
    assert "hourglass stiffness of C3D8R" in message(failed) and "C3D8I" in message(failed)
    deck.write_text(text)  # the remedy
    run("import", deck, "--run-ccx", "--node", "end=NSET:END", "-o", tmp_path / "b.h5")


def op4(path: Path, **matrices: Any) -> None:
    from pyNastran.op4.op4 import OP4

    names = list(matrices)
    OP4(debug=None).write_op4(
        str(path), {name: (6, matrices[name]) for name in names}, names, is_binary=False
    )


def test_empty_matrices_of_a_superelement(tmp_path: Path) -> None:
    """EXTSEOUT writes what is not there as one zero."""
    K = np.diag([2.0, 3.0, 4.0]) * 1e6
    for extra in ({"BXX1": np.zeros((1, 1))}, {"KASMX": np.zeros((1, 1))}, {"BAA": np.eye(2)}):
        op4(tmp_path / "x.op4", KXX=K, MXX=np.eye(3), **extra)
        for more in ((), ("--matrices", "K=KXX,M=MXX")):
            run("import", tmp_path / "x.op4", "-o", tmp_path / "b.h5", "--rows", "p=1,2", *more)
        assert np.allclose(body_system(tmp_path / "b.h5").K.toarray(), K)
        with h5py.File(tmp_path / "b.h5") as file:
            assert "D" not in file


def test_cards_of_a_file_that_cannot_be_read_whole() -> None:
    text = (
        "ID A\nCEND\nTITLE = x\nBEGIN SUPER=100\n$ comment\nGRID,1,,0.,0.,0.\n"
        "CBAR,1,bad\n+,more\nRBE2,9,1,123456,2\n,3,4\nGRID    2               1.0     0.0\n"
        "*       0.0\nENDDATA\n"
    )
    assert _cards_of(text, ("GRID", "RBE2")).splitlines() == [
        "GRID,1,,0.,0.,0.",
        "RBE2,9,1,123456,2",
        ",3,4",
        "GRID    2               1.0     0.0",
        "*       0.0",
    ]


def test_meshes_of_results_and_of_surfaces(tmp_path: Path) -> None:
    mesh = box("tetra", (2, 2, 2))
    mesh.field_data = {"med:nom": [[], []], "steps": np.array([1.0, 2.0, 3.0])}
    import_description(CLAMPED, "box", tmp_path / "b.h5", mesh=mesh)
    flat = meshio.Mesh(np.eye(3), [("triangle", np.array([[0, 1, 2]]))])
    with pytest.raises(BodyError, match=r"its elements are faces \(triangle\): if they are shells"):
        import_description(CLAMPED, "flat", tmp_path / "b.h5", mesh=flat)
    places = np.random.default_rng(1).uniform(size=(27, 3))
    large = meshio.Mesh(places, [("hexahedron27", np.arange(27)[None, :])])
    known = r"no known elements, only hexahedron27: mesh it with .*wedge15"
    with pytest.raises(BodyError, match=known):
        import_description(CLAMPED, "large", tmp_path / "b.h5", mesh=large)
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    failed = run("import", tmp_path / "part.step", "-o", tmp_path / "b.h5", expect=1)
    assert "gmsh part.step -3 -order 2" in message(failed)


@ccx
def test_the_mechanical_half_of_a_thermal_step(tmp_path: Path) -> None:
    """K and M are those of the deck without its step, and the step is named as left out."""
    held = "*BOUNDARY\nSTART, 1, 3\n"
    plain = read(write_deck(tmp_path / "plain.inp", "C3D4", held), run_ccx=True)
    for word in ("COUPLED", "UNCOUPLED"):
        step = f"*STEP\n*{word} TEMPERATURE-DISPLACEMENT\n{held}*CLOAD\n20, 1, 3.\n*END STEP\n"
        initial = "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20.\n"
        deck = write_deck(tmp_path / f"{word}.inp", "C3D4", initial + step)
        heat = "*CONDUCTIVITY\n50.\n*SPECIFIC HEAT\n500.\n*EXPANSION\n1e-5\n*DENSITY"
        deck.write_text(deck.read_text().replace("*DENSITY", heat))
        fe = read(deck, run_ccx=True)
        assert abs(fe.K - plain.K).max() == 0 and abs(fe.M - plain.M).max() == 0
        assert any(f"*{word} TEMPERATURE-DISPLACEMENT" in remark for remark in fe.remarks)
    deck = write_deck(tmp_path / "heat.inp", "C3D4", "*STEP\n*HEAT TRANSFER\n*END STEP\n")
    with pytest.raises(BodyError, match="HEAT TRANSFER: no masses and stiffnesses"):
        read(deck, run_ccx=True)


def test_a_mass_that_one_direction_carries(tmp_path: Path) -> None:
    """Its mean over the directions is no mass."""
    deck = write_deck(tmp_path / "box.inp", "C3D4")
    from flexgram.importers.fe import FeMatrices, check

    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    K = sp.csr_matrix(np.diag(np.full(9, 1e6)))
    M = sp.csr_matrix(np.diag(np.tile([2.0, 0.0, 0.0], 3)))
    fe = FeMatrices(
        *(str(deck), K, M),
        node=np.repeat([1, 2, 3], 3),
        component=np.tile([0, 1, 2], 3),
        labels=np.arange(1, 4),
        points=points,
    )
    facts = check(fe)
    assert "mass" not in facts and "6, 0, 0 in x, y, z" in fe.remarks[-1]


def test_a_number_too_small_for_a_normal_double() -> None:
    """In K: neither an error nor digits that were printed."""
    K = sp.csr_matrix(np.array([[2.0, 5e-324], [5e-324, 3.0]]))
    model = flexgram.reduce(Matrices(K, sp.identity(2, format="csr"), np.eye(2)), (0.01, 0.1), 1e-3)
    assert model.order == 2
    lists = Matrices(sp.dok_matrix(K), sp.dok_matrix(np.eye(2)), np.eye(2))
    assert flexgram.reduce(lists, (0.01, 0.1), 1e-3).order == 2


def test_rows_with_directions_join(tmp_path: Path) -> None:
    """Interfaces named by rows join where their directions are given; without, the message says
    how."""
    import scipy.io

    n = 12
    K = 1e4 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    scipy.io.savemat(tmp_path / "a.mat", {"K": sp.csc_matrix(K), "M": sp.eye(n, format="csc")})
    for name, rows in (("named", "fx:12"), ("bare", "12")):
        first = rows.replace("12", "1")
        run(
            *("import", tmp_path / "a.mat", "-o", tmp_path / f"{name}.h5", "--alpha", "0.5"),
            *("--rows", f"left={first}", "--rows", f"right={rows}"),
        )
        run(
            *("reduce", "-body", tmp_path / f"{name}.h5", "-mor_band_hz", "1,20", "-mor_tol", 1e-6),
            *("-mor_out", tmp_path / f"{name}.rom.h5"),
        )
    both = (f"x={tmp_path}/named.rom.h5", f"y={tmp_path}/named.rom.h5")
    run("couple", *both, "--join", "x.right=y.left:x", "-o", tmp_path / "w.h5")
    whole = ReducedModel.load(tmp_path / "w.h5")
    T = np.delete(np.eye(2 * n), n, axis=1)
    T[n, n - 1] = 1
    square = np.linalg.eigvals(np.linalg.solve(T.T @ T, T.T @ scipy.linalg.block_diag(K, K) @ T))
    expected = np.sort(np.sqrt(square.real))[:4]
    assert np.allclose(whole.modes[:4], expected, rtol=1e-6)
    bare = (f"x={tmp_path}/bare.rom.h5", f"y={tmp_path}/bare.rom.h5")
    failed = run("couple", *bare, "--join", "x.right=y.left", "-o", tmp_path / "v.h5", expect=1)
    assert "ports without directions" in message(failed) and "fx:25" in message(failed)
