"""CalculiX decks whose steps, damping and includes matter: nothing replaced or lost in silence."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from test_importers import (
    CALCULIX,
    FREQUENCY,
    STEEL,
    assert_digits,
    ccx,
    ccx_frequencies,
    frequencies,
    write_deck,
)
from test_importers_wrong import ccx_job

from bodies import box, write_body_file
from conftest import assembled, body_system, read_sparse
from flexgram import reduce
from flexgram.basics import BodyError
from flexgram.body.bodyfile import write_matrices
from flexgram.cli.info import describe
from flexgram.importers import Interface, check, import_matrices, parse, read
from flexgram.importers.ccx import damping_of, prepare, read_job
from flexgram.importers.ccx import run_ccx as ccx_run
from flexgram.importers.interfaces import attach
from referee import System

HELD = "*BOUNDARY\nSTART, 1, 3\n"
PRELOAD = "*STEP\n*STATIC\n*CLOAD\nEND, 1, 1e5\n*END STEP\n"
MODES = "*FREQUENCY\n16\n*END STEP\n"


@ccx
def test_preload_of_a_perturbation_step_is_part_of_the_body(tmp_path: Path) -> None:
    deck = write_deck(
        tmp_path / "loaded.inp", "C3D20R", HELD + PRELOAD + "*STEP, PERTURBATION\n" + MODES
    )
    fe = read(deck, run_ccx=True)
    assert_digits(frequencies(fe.K, fe.M), ccx_frequencies(deck)[:16])
    assert any("step 2" in line and "*STATIC, *CLOAD" in line for line in fe.remarks)
    free = read(write_deck(tmp_path / "free.inp", "C3D20R", HELD + FREQUENCY), run_ccx=True)
    stiffer = frequencies(fe.K, fe.M)[0] / frequencies(free.K, free.M)[0]
    assert stiffer > 1.1  # the preload is no rounding


@ccx
def test_another_frequency_step_is_named_and_can_be_asked_for(tmp_path: Path) -> None:
    deck = write_deck(
        tmp_path / "both.inp",
        "C3D20R",
        HELD + FREQUENCY + PRELOAD + "*STEP, PERTURBATION\n" + MODES,
    )
    loaded, plain = read(deck, run_ccx=True), read(deck, run_ccx=True, step=1)
    free = read(write_deck(tmp_path / "free.inp", "C3D20R", HELD + FREQUENCY), run_ccx=True)
    assert np.allclose(frequencies(plain.K, plain.M), frequencies(free.K, free.M), rtol=1e-9)
    assert frequencies(loaded.K, loaded.M)[0] > 1.1 * frequencies(free.K, free.M)[0]
    assert any("--step 1" in line for line in loaded.remarks)
    with pytest.raises(BodyError, match=r"step 2 gives no matrices: its .* steps are 1, 3"):
        read(deck, run_ccx=True, step=2)
    with pytest.raises(BodyError, match="--step belongs to --run-ccx"):
        read(tmp_path / "free.sti", step=1)


@ccx
def test_what_is_left_out_is_named_and_strict_refuses(tmp_path: Path) -> None:
    fe = read(write_deck(tmp_path / "static.inp", "C3D10", HELD + PRELOAD), run_ccx=True)
    free = read(write_deck(tmp_path / "free.inp", "C3D10", HELD + FREQUENCY), run_ccx=True)
    assert abs(fe.K - free.K).max() == 0
    left = [line for line in fe.remarks if "left out" in line]
    assert len(left) == 1 and "*STATIC, *CLOAD" in left[0] and "supports of step 1" in left[0]
    end = [parse("rigid", "end=NSET:END")]
    with pytest.raises(BodyError, match=r"--strict: the deck has no .FREQUENCY step"):
        import_matrices(fe, tmp_path / "static.h5", end, strict=True)
    import_matrices(free, tmp_path / "free.h5", end, strict=True)


@ccx
def test_local_axes_of_supports(tmp_path: Path) -> None:
    """*TRANSFORM: a roller along an oblique line; the matrices are in global axes all the same."""
    oblique = "*TRANSFORM, NSET=START\n1, 1, 0, -1, 1, 0\n*BOUNDARY\nSTART, 1, 1\nSTART, 3, 3\n"
    deck = write_deck(
        tmp_path / "oblique.inp", "C3D10", oblique + "*BOUNDARY\nEND, 1, 3\n" + FREQUENCY
    )
    fe = read(deck, run_ccx=True)
    assert_digits(frequencies(fe.K, fe.M), ccx_frequencies(deck)[:16])


DAMPED = """*NODE
8001, 0, 0, 0
8002, 0, 3, 4
8003, 1, 0, 0
*ELEMENT, TYPE=DASHPOTA, ELSET=ED
1, 8001, 8002
2, 8003, 8001
*DASHPOT, ELSET=ED

50.
"""


def test_damping_of_the_deck(tmp_path: Path) -> None:
    def damping(extra: str, deck: str = "part.inp") -> Any:
        return damping_of(read_job(write_deck(tmp_path / deck, "C3D10", extra)))

    modal = damping(
        FREQUENCY + "*STEP\n*MODAL DYNAMIC\n1e-4, 1.\n*MODAL DAMPING, RAYLEIGH\n"
        ",, 20., 3e-6\n*END STEP\n"
    )
    assert (modal.alpha, modal.beta, modal.eta) == (20.0, 3e-6, 0.0)
    other = "*MATERIAL, NAME=STEEL2\n*DAMPING, ALPHA=5., BETA=1e-5\n"
    unused = damping(other + FREQUENCY)
    assert unused.alpha == 0 and not unused.remarks
    material = damping(other + "*SOLID SECTION, ELSET=NONE, MATERIAL=STEEL2\n" + FREQUENCY)
    assert material.alpha == 0 and "differ:" in material.remarks[0]  # STEEL has none
    deck = write_deck(tmp_path / "one.inp", "C3D10", FREQUENCY)
    deck.write_text(deck.read_text().replace("*DENSITY", "*DAMPING, ALPHA=5., BETA=1e-5\n*DENSITY"))
    for text in ("", "*MATERIAL, NAME=ALU\n*DENSITY\n2700\n"):  # of no element
        deck.write_text(text + deck.read_text())
        one = damping_of(read_job(deck))
        assert (one.alpha, one.beta) == (5.0, 1e-5)
    ratios = damping("*STEP\n*MODAL DYNAMIC\n*MODAL DAMPING\n1, 5, 0.02\n*END STEP\n")
    assert (ratios.alpha, ratios.beta) == (0, 0) and "left out" in ratios.remarks[0]
    assert damping(DAMPED).dashpots == [(8001, 8002, 50.0), (8003, 8001, 50.0)]
    with pytest.raises(BodyError, match="damping cards"):
        damping("*DASHPOT, ELSET=E\n\nfifty\n")


def test_stored_matrices_have_no_loss_factors_of_materials(tmp_path: Path) -> None:
    job = ccx_job(tmp_path)
    job.with_suffix(".inp").write_text(
        "*NODE\n1, 0, 0, 0\n2, 0, 3, 4\n"
        "*MATERIAL, NAME=A\n*DAMPING, STRUCTURAL=0.2\n*MATERIAL, NAME=B\n"
    )
    fe = read(job)
    assert fe.eta == 0 and any("--assemble" in remark for remark in fe.remarks)


def test_dashpots_act_along_their_line(tmp_path: Path) -> None:
    job = ccx_job(tmp_path)  # rows of the nodes 1 and 2
    deck = job.with_suffix(".inp")
    deck.write_text(
        "*NODE\n1, 0, 0, 0\n2, 0, 3, 4\n3, 1, 0, 0\n"
        "*ELEMENT, TYPE=DASHPOTA, ELSET=ED\n1, 1, 2\n2, 1, 3\n"
        "*DASHPOT, ELSET=ED\n\n50.\n*BOUNDARY\n3, 1, 3\n"
    )
    fe = read(job)
    e = np.array([0, 0.6, 0.8])
    expected = 50 * np.block([[np.outer(e, e), -np.outer(e, e)], [-np.outer(e, e), np.outer(e, e)]])
    expected[0, 0] += 50  # to the held node
    assert fe.D is not None and np.allclose(fe.D.toarray(), expected)
    deck.write_text(deck.read_text().replace("3, 1, 3", "3, 2, 3"))
    fe = read(job)  # node 3 has neither rows nor a support along the second dashpot
    assert fe.D is not None and fe.D[0, 0] == 0
    assert any("1 and 3 is left out" in line for line in fe.remarks)


def test_includes_nested_quoted_and_in_long_folders(tmp_path: Path) -> None:
    deck = write_deck(tmp_path / "flat.inp", "C3D10", HELD + FREQUENCY)
    text = deck.read_text()
    folder = tmp_path / ("a folder with a long name " * 6).strip()
    folder.mkdir()
    nodes, rest = text.split("*ELEMENT", 1)
    (folder / "nodes of the part.inc").write_text(nodes)
    (folder / "model.inc").write_text('*INCLUDE, INPUT="nodes of the part.inc"\n*ELEMENT' + rest)
    split = tmp_path / "split.inp"
    split.write_text(f'*Include, Input="{folder.name}/model.inc"\n')
    assert prepare(read_job(split)) == prepare(read_job(deck))
    (folder / "model.inc").write_text("*INCLUDE, INPUT=nowhere.inc\n")
    with pytest.raises(BodyError, match=r"nowhere.inc.*no such file"):
        read_job(split)


def test_a_cyclic_sector_is_no_body(tmp_path: Path) -> None:
    deck = write_deck(
        tmp_path / "sector.inp",
        "C3D10",
        "*CYCLIC SYMMETRY MODEL, N=8, TIE=T\n0,0,0,0,0,1\n" + FREQUENCY,
    )
    with pytest.raises(BodyError, match="one sector of a cyclic body"):
        prepare(read_job(deck))


def test_rotations_in_the_dof_file(tmp_path: Path) -> None:
    job = ccx_job(tmp_path)
    dof = job.with_suffix(".dof")
    dof.write_text(
        dof.read_text().replace("2.1", "1.4").replace("2.2", "1.5").replace("2.3", "1.6")
    )
    assert list(read(job).component) == [0, 1, 2, 3, 4, 5]


def test_thousands_of_ports_have_names(tmp_path: Path) -> None:
    n = 5000
    names = [f"port_{i}.fx" for i in range(n)]
    write_matrices(
        tmp_path / "many.h5",
        sp.identity(n).tocsr(),
        sp.identity(n).tocsr(),
        np.eye(n),
        inputs=names,
    )
    with h5py.File(tmp_path / "many.h5") as file:
        assert list(file["B"].attrs["names"]) == names


def shell_plate(path: Path, kind: str, extra: str) -> Path:
    """A plate of 8 x 4 quadratic shells, 0.8 x 0.4 x 0.01 m, with its left edge as a set."""
    places = [(i, j) for i in range(17) for j in range(9) if i % 2 == 0 or j % 2 == 0]
    label = {place: k for k, place in enumerate(places, 1)}
    lines = ["*NODE"] + [f"{label[i, j]}, {0.05 * i}, {0.05 * j}, 0" for i, j in places]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=EALL")
    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    for e, (i, j) in enumerate([(i, j) for i in range(0, 16, 2) for j in range(0, 8, 2)], 1):
        lines.append(", ".join(map(str, [e, *(label[i + a, j + b] for a, b in around)])))
    lines += ["*NSET, NSET=LEFT", *(f"{label[0, j]}," for j in range(9))]
    lines.append(STEEL + "*SHELL SECTION, ELSET=EALL, MATERIAL=STEEL\n0.01")
    path.write_text("\n".join(lines) + "\n" + extra)
    return path


@ccx
@pytest.mark.parametrize(("shell", "solid"), [("S8", "C3D20"), ("S8R", "C3D20R")])
def test_shells_are_the_solids_that_ccx_makes_of_them(
    tmp_path: Path, shell: str, solid: str
) -> None:
    """ccx prints one label for two or three nodes, and no places: both are found again."""
    plate = read(shell_plate(tmp_path / "shell.inp", shell, FREQUENCY), run_ccx=True)
    facts = check(plate)
    mass = 7850 * 0.8 * 0.4 * 0.01
    assert facts["mass"] == pytest.approx(mass, rel=1e-9)
    assert np.allclose(facts["centre"], [0.4, 0.2, 0], atol=1e-9)
    inertia = mass / 12 * np.array([0.4**2 + 1e-4, 0.8**2 + 1e-4, 0.8**2 + 0.4**2])
    assert np.allclose(np.diag(facts["inertia"]), inertia, rtol=1e-9)
    mesh = box(CALCULIX[solid], (8, 4, 1), (0.8, 0.4, 0.01), distort=False)
    brick = read(write_deck(tmp_path / "solid.inp", solid, FREQUENCY, mesh=mesh), run_ccx=True)
    for coupling in ("rigid", "distributing"):
        found = []
        for fe, where in ((plate, "NSET:LEFT@0,0.2,0"), (brick, "NSET:START@0,0.2,0.005")):
            import_matrices(fe, tmp_path / "body.h5", [parse(coupling, f"edge={where}")])
            with h5py.File(tmp_path / "body.h5") as file:
                found.append(frequencies(read_sparse(file, "K"), read_sparse(file, "M"))[6:18])
        assert np.allclose(*found, rtol=1e-7)


@ccx
@pytest.mark.parametrize(("shell", "solid"), [("S8", "C3D20"), ("S8R", "C3D20R")])
def test_held_shells_have_the_places_of_free_ones(tmp_path: Path, shell: str, solid: str) -> None:
    """A clamped plate is the solid that ccx makes of it, with a rigid edge too, which needs places
    (in its plane ccx clamps shells softer than solids: the eighth frequency, by up to 0.5 %).
    One whose edge turns keeps them where nothing is held."""
    mesh = box(CALCULIX[solid], (8, 4, 1), (0.8, 0.4, 0.01), distort=False)
    brick = write_deck(
        tmp_path / "solid.inp", solid, "*BOUNDARY\nSTART, 1, 3\n" + FREQUENCY, mesh=mesh
    )
    edge, found = "edge=BOX:0.79,-1,-1,0.81,1,1", []
    for deck, middle in (
        (shell_plate(tmp_path / "shell.inp", shell, "*BOUNDARY\nLEFT, 1, 6\n" + FREQUENCY), 0.0),
        (brick, 0.005),
    ):
        fe = read(deck, run_ccx=True)
        import_matrices(fe, tmp_path / "body.h5", [parse("rigid", f"{edge}@0.8,0.2,{middle}")])
        with h5py.File(tmp_path / "body.h5") as file:
            K, M = read_sparse(file, "K"), read_sparse(file, "M")
        found.append(frequencies(K, M)[:8])
        assert fe.has_coordinates()
    alike = np.isclose(*found, rtol=1e-6)
    assert alike[:7].all() and np.allclose(*found, rtol=5e-3)
    turning = shell_plate(tmp_path / "turn.inp", shell, "*BOUNDARY\nLEFT, 1, 3\n" + FREQUENCY)
    fe = read(turning, run_ccx=True)
    assert any("partly held nodes" in line for line in fe.remarks)
    points = fe.positions(np.unique(fe.node))
    assert np.allclose(np.ptp(points, axis=0), [0.8, 0.4, 0.01], rtol=1e-9)
    attach(fe, [parse("node", "corner=AT:0.8,0.4,0.005"), parse("distributing", edge)])


@ccx
def test_held_shells_without_a_run_say_that_places_are_not_known(tmp_path: Path) -> None:
    deck = shell_plate(tmp_path / "held.inp", "S8R", "*BOUNDARY\nLEFT, 1, 3\n" + FREQUENCY)
    job, _ = ccx_run(deck, tmp_path / "run")
    held = read(job)
    assert any("--run-ccx" in line for line in held.remarks)
    assert not held.has_coordinates()


def test_printed_digits_are_told_beside_the_claim(tmp_path: Path) -> None:
    """A slender bar: its lowest frequencies lose digits when K is printed with fourteen. The claim
    is of the K that is stored; what its digits change of the meant K is told beside it."""
    body = tmp_path / "bar.h5"
    write_body_file(
        body,
        box("hexahedron20", (60, 1, 1), (1.0, 0.004, 0.004), distort=False),
        interfaces={"start": {"set": "start", "coupling": "distributing"}},
    )
    exact = assembled(tmp_path / "exact.h5", body)
    node, component = np.unique(exact["node"], return_inverse=True)[1] + 1, exact["component"]
    job = tmp_path / "job.inp"
    points = {n: x for n, x in zip(node, exact["position"], strict=True)}
    job.write_text("*NODE\n" + "".join(f"{n}, {x[0]}, {x[1]}, {x[2]}\n" for n, x in points.items()))
    job.with_suffix(".dof").write_text(
        "".join(f"{n}.{c + 1}\n" for n, c in zip(node, component, strict=True))
    )
    for name, suffix in (("K", ".sti"), ("M", ".mas")):
        upper = sp.triu(exact[name]).tocoo()
        job.with_suffix(suffix).write_text(
            "".join(
                f"{i + 1} {j + 1} {x:.13e}\n"
                for i, j, x in zip(upper.row, upper.col, upper.data, strict=True)
            )
        )
    ends = [node[np.argmin(exact["position"][:, 0])], node[np.argmax(exact["position"][:, 0])]]
    fe = read(job)
    facts = import_matrices(
        fe,
        tmp_path / "printed.h5",
        [Interface("tip", "node", np.array(ends))],
        alpha=2.0,
        beta=1e-6,
    )
    assert any("printed with 14 digits" in line for line in facts["remarks"])
    rows = [int(np.flatnonzero((node == n) & (component == c))[0]) for n in ends for c in range(3)]
    B = np.zeros((len(node), 6))
    B[rows, range(6)] = 1
    truth = System(exact["K"], exact["M"], B, alpha=2.0, beta=1e-6)
    with h5py.File(tmp_path / "printed.h5", "r+") as file:
        assert file.attrs["rounding"] == 5e-14
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the tolerance is met
        rom = reduce(tmp_path / "printed.h5", band_hz=(18, 24), tol=1e-8)
    assert rom.met and rom.certified_error <= 1e-8
    stored = body_system(tmp_path / "printed.h5")
    omega = 2 * np.pi * np.linspace(18.01, 23.99, 23)

    def worst(full: System) -> float:
        return max(
            float(np.linalg.norm(rom.transfer(w) - H) / np.linalg.norm(H))
            for w, H in ((w, full.transfer(w)) for w in omega)
        )

    # The claim is of a body that is exactly rigid; the stored K is so up to its digits.
    assert rom.certified_error < worst(stored) <= rom.certified_error + rom.rigid_rounding
    assert 10 * worst(stored) < worst(truth)
    assert worst(truth) <= rom.data_rounding.max() < 1000 * worst(truth)
    rom.save(tmp_path / "rom.h5")
    assert any(
        "the digits in which the FE code wrote K" in line for line in describe(tmp_path / "rom.h5")
    )


def test_damping_of_materials_that_differ(tmp_path: Path) -> None:
    """Loss factors stay with their materials, whatever ALPHA and BETA do; nothing goes unsaid."""

    def damping(cards: str) -> Any:
        deck = tmp_path / "two.inp"
        deck.write_text(f"*NODE\n1, 0, 0, 0\n{cards}")
        return damping_of(read_job(deck))

    two = damping(
        "*MATERIAL, NAME=A\n*DAMPING, ALPHA=5.\n*DAMPING, STRUCTURAL=0.2\n"
        "*MATERIAL, NAME=B\n*DAMPING, COMPOSITE=0.3\n"
    )
    assert two.loss_factors == {"A": 0.2, "B": 0.0} and two.alpha == 0
    assert any("ALPHA and BETA of the materials differ" in said for said in two.remarks)
    assert "*DAMPING, COMPOSITE of B is left out" in two.remarks
    same = damping(
        "*MATERIAL, NAME=A\n*DAMPING, ALPHA=5., STRUCTURAL=0.2\n"
        "*MATERIAL, NAME=B\n*DAMPING, ALPHA=5.\n"
    )
    assert (same.alpha, same.eta) == (5.0, 0.0) and same.loss_factors == {"A": 0.2, "B": 0.0}
