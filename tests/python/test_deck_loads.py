"""Loads of CalculiX decks as inputs, and heat: identities, ccx' own displacements and stresses."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from test_importers import write_deck
from test_mesh_loads import KINDS, ports, sided, write_body
from test_stress_recovery import at_nodes, field

from bodies import CALCULIX
from conftest import assembled, assert_certified, body_system, certified, run
from flexgram import BodyError, ReducedModel
from flexgram.body.stress import COMPONENTS, Stresses

ALPHA = 1.2e-5
STEEL = {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850, "expansion": ALPHA}}
HEAT = {"warm": {"type": "temperature", "nodes": "all"}}
SPOT = {"spot": {"type": "stress", "nodes": "side"}}
ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_free_body_grows_without_stress(kind: str, ranks: int, tmp_path: Path) -> None:
    """K u of a uniform growth is the load of a uniform temperature, and leaves no stress."""
    mesh = sided(kind)
    write_body(tmp_path / "body.h5", mesh, materials=STEEL, loads=HEAT, outputs=SPOT)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5", ranks)
    B, _ = ports(tmp_path / "matrices.h5")
    u = ALPHA * field(a, a["position"])
    assert np.abs(a["K"] @ u - B["warm.T"]).max() < 1e-10 * np.abs(B["warm.T"]).max()
    stresses = Stresses.load(tmp_path / "body.h5")
    _, held = stresses.heated(np.ones(len(mesh.points)))
    grown = stresses.nodal(at_nodes(a, u, len(mesh.points))[None])[0]
    assert np.abs(held + grown).max() < 1e-9 * np.abs(grown).max()


def test_quadratic_elements_bend_without_stress(tmp_path: Path) -> None:
    """A linear temperature T = b·x of a free body: u = α((b·x) x − |x|² b/2)."""
    mesh = sided("tetra10", distort=False)
    b = np.array([3.0, -2.0, 1.0])
    x = mesh.points
    table = np.column_stack([np.arange(1, len(x) + 1), x @ b])
    heat = {"warm": {"type": "temperature", "table": table}}
    write_body(tmp_path / "body.h5", mesh, materials=STEEL, loads=heat, outputs={})
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    B, _ = ports(tmp_path / "matrices.h5")
    at = a["position"]
    bent = ALPHA * ((at @ b)[:, None] * at - 0.5 * np.sum(at**2, axis=1)[:, None] * b)
    u = field(a, bent)
    assert np.abs(a["K"] @ u - B["warm.T"]).max() < 1e-10 * np.abs(B["warm.T"]).max()
    stresses = Stresses.load(tmp_path / "body.h5")
    grown = stresses.nodal(at_nodes(a, u, len(x))[None])[0]
    assert np.abs(stresses.heated(x @ b)[1] + grown).max() < 1e-9 * np.abs(grown).max()


def test_heat_along_the_axes_of_a_material(tmp_path: Path) -> None:
    """An orthotropic body grows along its own axes."""
    axes = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1.0]])
    wood = {
        "E1": 11e9,
        "E2": 0.9e9,
        "E3": 0.5e9,
        "nu12": 0.37,
        "nu13": 0.42,
        "nu23": 0.47,
        "G12": 0.75e9,
        "G13": 0.72e9,
        "G23": 0.39e9,
        "rho": 450,
        "axis_1": [0.6, 0.8, 0],
        "expansion": [4e-6, 3e-5, 5e-5],
    }
    mesh = sided("hexahedron")
    write_body(tmp_path / "body.h5", mesh, materials={"steel": wood}, loads=HEAT, outputs=SPOT)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    B, _ = ports(tmp_path / "matrices.h5")
    growth = axes.T @ np.diag([4e-6, 3e-5, 5e-5]) @ axes
    u = field(a, a["position"] @ growth)
    assert np.abs(a["K"] @ u - B["warm.T"]).max() < 1e-10 * np.abs(B["warm.T"]).max()


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
def test_stress_of_heat_is_certified(ranks: int, tmp_path: Path) -> None:
    """A held body: claims of the stress of its strain, and the stress itself in time and field."""
    mesh = sided("hexahedron", counts=(6, 3, 3))
    spot = int(mesh.point_sets["side"][0]) + 1
    write_body(
        tmp_path / "body.h5",
        mesh,
        materials=STEEL,
        loads=HEAT,
        damping={"alpha": 20.0, "beta": 1e-6},
        supports={"start": {"nodes": "start"}},
        outputs={"spot": {"type": "stress", "nodes": [spot]}},
    )
    result = certified(
        tmp_path / "body.h5",
        (100.0, 6000.0),
        tmp_path,
        "-mor_tol",
        "1e-4",
        "-mor_statics",
        "yes",
        ranks=ranks,
    )
    assert_certified(result, 1e-4)
    rom = ReducedModel.load(result["path"])
    assert {"stress from force", "stress from temperature"} <= set(rom.kinds)
    assert rom.inputs[-1] == "warm.T"
    rows = [rom.outputs.index(f"spot.s{pair}") for pair in COMPONENTS]
    # At rest: the static solution of the whole body.
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    B, _ = ports(tmp_path / "matrices.h5")
    stresses = Stresses.load(tmp_path / "body.h5")
    u = spsolve(a["K"].tocsc(), B["warm.T"])
    whole = (
        stresses.nodal(at_nodes(a, u, len(mesh.points))[None])[0]
        + stresses.heated(np.ones(len(mesh.points)))[1]
    )
    found = rom.transfer(0.0)[rows, -1].real
    assert np.abs(found - whole[spot - 1]).max() < 2e-4 * np.abs(whole[spot - 1]).max()
    # The field, and the time response.
    t = np.linspace(0, 1e-3, 50)
    loads = np.zeros((50, len(rom.inputs)))
    loads[:, -1] = 80 * np.sin(4000 * t)
    y, q = rom.simulate(loads, t)
    field_then = rom.stress(q[-1], tmp_path / "body.h5", loads[-1])[0]
    assert np.allclose(field_then[spot - 1], y[-1, rows], rtol=1e-8)
    with pytest.raises(BodyError, match=r"warm\.T strains the body"):
        rom.stress(q[-1], tmp_path / "body.h5")
    # A sweep of the full body holds the same.
    run(
        "sweep",
        "-body",
        str(tmp_path / "body.h5"),
        "-rom",
        str(result["path"]),
        "-mor_sweep_hz",
        "700",
        "-mor_sweep_out",
        str(tmp_path / "sweep.h5"),
    )
    with h5py.File(tmp_path / "sweep.h5") as file:
        H, H_r = (file[name][0] @ [1, 1j] for name in ("H", "H_rom"))
    assert np.allclose(H_r, rom.transfer(1400 * np.pi), rtol=1e-9)
    assert np.abs(H - H_r)[rows, -1].max() < 1e-4 * np.abs(H[rows, -1]).max()


def frd(path: Path) -> dict[str, list[dict[int, Any]]]:
    """Displacements and stresses of every step by node."""
    found: dict[str, list[dict[int, Any]]] = {"DISP": [], "STRESS": []}
    what = ""
    for line in path.read_text().splitlines():
        if line.startswith(" -4"):
            what = line.split()[1]
            if what in found:
                found[what].append({})
        elif line.startswith(" -1") and what in found and len(line) > 40:
            found[what][-1][int(line[3:13])] = [
                float(line[k : k + 12]) for k in range(13, len(line.rstrip()) - 11, 12)
            ]
    return found


STEP = "*STEP\n*STATIC\n{}*NODE FILE\nU\n*EL FILE\nS\n*END STEP\n"
#: Every kind of load: name of its input as the first of a step, and its card.
CARDS = {
    "cload.load": "*CLOAD, OP=NEW\nEND, 2, 125.\n{first}, 1, -300.\n",
    "dload.load": "*DLOAD\nEALL, GRAV, 9810., 1., -2., 3.\n",
    "dload2.load": "*DLOAD\nEALL, CENTRIF, 4.E6, .1, .2, .3, 1., 0., 2.\n",
    "dload3.load": "*DLOAD\n3, P1, 2.5E6\n4, P2, 1.5E6\nSOME, P3, 2.E6\nSOME, P4, -1.E6\n",
    "dsload.load": "*DSLOAD, AMPLITUDE=RISE\nSKIN, P, 4.E6\n",
    "temperature.T": "*TEMPERATURE\n{temperatures}",
}


def loaded_deck(path: Path, element: str, mesh: Any, steps: list[str]) -> Path:
    """A deck with a step for each of some lists of cards."""
    deck = write_deck(path, element, "", mesh=mesh)
    extra = "*AMPLITUDE, NAME=RISE\n0., 1., 1., 1.\n*ELSET, ELSET=SOME\n5, 6\n*MATERIAL"
    text = deck.read_text().replace("*MATERIAL", extra)
    text = text.replace("*SOLID SECTION", "*EXPANSION\n1.2E-5\n*SOLID SECTION")
    text += (
        "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20.\n*SURFACE, NAME=SKIN\n1, S2\n"
        "7, S3\n*BOUNDARY\nSTART, 1, 3\n"
    )
    warm = "".join(
        f"{i + 10}, {20 + 500 * x[0] - 800 * x[1] + 200 * x[2]:.15g}\n"
        for i, x in enumerate(mesh.points)
    )
    first = int(mesh.point_sets["end"][0]) + 10
    deck.write_text(
        text + "".join(STEP.format(cards.format(first=first, temperatures=warm)) for cards in steps)
    )
    return deck


@ccx
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D15", "C3D20", "C3D6", "C3D8", "C3D20R"])
def test_loads_of_a_deck_are_those_of_calculix(element: str, tmp_path: Path) -> None:
    """Displacements and stresses of every load, to the digits that ccx prints (of nodal stresses
    six; C3D20 extrapolates them with coefficients of five)."""
    mesh = sided(CALCULIX[element], counts=(5, 3, 3))
    whole = loaded_deck(tmp_path / "whole.inp", element, mesh, ["".join(CARDS.values())])
    body = tmp_path / "body.h5"
    done = run(
        "import",
        str(whole),
        "--assemble",
        "--deck-loads",
        "--distributing",
        "end=NSET:END",
        "-o",
        str(body),
    )
    assert "load step1_dsload: its amplitude is left to the history of the input" in done.out
    a = assembled(tmp_path / "matrices.h5", body)
    B, _ = ports(tmp_path / "matrices.h5")
    assert set(B) >= {f"step1_{name}" for name in CARDS}
    stresses = Stresses.load(body)
    heat = stresses.of_temperatures(body, ["step1_temperature.T"])["step1_temperature.T"]
    labels = np.arange(len(mesh.points)) + 10
    for name, card in CARDS.items():
        if name == "temperature.T" and element in ("C3D6", "C3D8"):
            continue  # ccx takes one temperature in each of them
        if name in ("dload3.load", "dsload.load") and element == "C3D6":
            continue  # and has another rule on warped faces of wedges
        one = loaded_deck(tmp_path / "one.inp", element, mesh, [card])
        subprocess.run(["ccx", one.stem], cwd=tmp_path, capture_output=True, check=True)
        theirs = frd(one.with_suffix(".frd"))
        u = at_nodes(a, spsolve(a["K"].tocsc(), B[f"step1_{name}"]), len(mesh.points))
        printed = np.array([theirs["DISP"][-1][label][:3] for label in labels])
        assert np.abs(u - printed).max() < 5.1e-6 * np.abs(printed).max(), name  # half a digit
        if element == "C3D6":
            continue  # ccx gives nodes 1, 3, 5 one stress, and 2, 4, 6 another
        ours = stresses.nodal(u[None])[0] + (heat if name == "temperature.T" else 0)
        printed = np.array([theirs["STRESS"][-1][label][:6] for label in labels])
        off = np.abs(ours - printed).max() / np.abs(printed).max()
        assert off < (1e-5 if element in ("C3D4", "C3D10", "C3D15") else 5e-5), name


@ccx
def test_loads_of_a_deck_on_its_matrices(tmp_path: Path) -> None:
    """With ccx' own K, and through a rigid interface: as assembled here."""
    mesh = sided("tetra10", counts=(5, 3, 3))
    deck = loaded_deck(tmp_path / "whole.inp", "C3D10", mesh, ["".join(CARDS.values())])
    found = {}
    for how in ("--run-ccx", "--assemble"):
        body = tmp_path / f"{how[2:]}.h5"
        done = run(
            "import", str(deck), how, "--deck-loads", "--rigid", "end=NSET:END", "-o", str(body)
        )
        if how == "--run-ccx":
            assert "load step1_temperature is left out: a temperature needs --assemble" in done.out
        else:
            body = tmp_path / "matrices.h5"
            assembled(body, tmp_path / "assemble.h5")
        system = body_system(body)
        with h5py.File(body) as file:
            inputs, outputs = (list(file[name].attrs["names"]) for name in "BC")
        assert outputs == inputs[:6]
        chosen = [inputs.index(f"step1_{name}") for name in CARDS if name != "temperature.T"]
        motion = spsolve(system.K.tocsc(), system.B[:, chosen])
        found[how] = (system.C @ motion).T
    scale = np.abs(found["--assemble"]).max(axis=1, keepdims=True)
    assert np.abs((found["--run-ccx"] - found["--assemble"]) / scale).max() < 2e-6


def test_what_of_a_deck_is_left_out(tmp_path: Path) -> None:
    mesh = sided("tetra10")
    cards = [
        "*CLOAD, LOAD CASE=2\nEND, 1, 3.\n*DLOAD\nEALL, NEWTON\n*CLOAD\nEND, 4, 1.\n",
        "*DLOAD\nEALL, P9, 1.\n",
    ]
    deck = loaded_deck(tmp_path / "part.inp", "C3D10", mesh, cards[:1])
    arguments = [
        "import",
        str(deck),
        "--assemble",
        "--distributing",
        "end=NSET:END",
        "-o",
        str(tmp_path / "body.h5"),
    ]
    done = run(*arguments, "--deck-loads", expect=1)
    assert "expected where, what and how much" in done.err
    deck = loaded_deck(
        tmp_path / "part.inp", "C3D10", mesh, [cards[0].replace("NEWTON", "NEWTON, 1.")]
    )
    done = run(*arguments, "--deck-loads")
    for words in (
        "load step1_cload is left out: *CLOAD, LOAD CASE",
        "load step1_dload: NEWTON of *DLOAD is left out",
        "load step1_cload2: direction 4 of *CLOAD END is left out",
    ):
        assert words in done.out
    assert (
        "the loads of the deck are left out (*CLOAD, *DLOAD): --deck-loads" in run(*arguments).out
    )
    loaded_deck(tmp_path / "part.inp", "C3D10", mesh, cards[1:])
    done = run(*arguments, "--deck-loads", expect=1)
    assert "*DLOAD 'EALL, P9, 1.': tetra10 has no face 9" in done.err


def test_tables_of_forces(tmp_path: Path) -> None:
    """Forces at nodes from a file, and what such a table must be."""
    mesh = sided("tetra")
    node = int(mesh.point_sets["side"][0])
    (tmp_path / "push.csv").write_text(f"{node + 1}, 0, 2.5, 0\n{node + 1}, 1, 0, -1\n1, 0, 0, 7\n")
    push = {"push": {"type": "nodal", "table": str(tmp_path / "push.csv")}}
    write_body(tmp_path / "body.h5", mesh, loads=push, outputs={})
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    B, _ = ports(tmp_path / "matrices.h5")
    there = at_nodes(a, B["push.load"], len(mesh.points))
    assert there[node] == pytest.approx([1, 2.5, -1]) and there[0] == pytest.approx([0, 0, 7])
    assert np.abs(there).sum() == pytest.approx(11.5)
    wrong_tables: list[tuple[Any, str]] = [
        ("none.csv", "no such file"),
        ([[1.5, 0, 0, 1]], "whole"),
        ([[1, 0, 1]], "a node number and 3 or 6 numbers"),
        ([[10**6, 0, 0, 1]], "run from 1 to"),
        (None, "table is missing"),
    ]
    for table, words in wrong_tables:
        wrong = {"type": "nodal"} if table is None else {"type": "nodal", "table": table}
        with pytest.raises(BodyError, match=words):
            write_body(tmp_path / "no.h5", mesh, loads={"push": wrong}, outputs={})
    with pytest.raises(BodyError, match="has no expansion"):
        write_body(tmp_path / "no.h5", mesh, loads=HEAT, outputs={})
    with pytest.raises(BodyError, match="needs nodes, or a table"):
        write_body(tmp_path / "no.h5", mesh, loads={"warm": {"type": "temperature"}}, outputs={})


@ccx
def test_rotations_in_millimetres(tmp_path: Path) -> None:
    """Loads of the deck change nothing of what its interfaces measure, in any units."""
    mesh = sided("tetra10", counts=(5, 3, 3))
    text = loaded_deck(tmp_path / "m.inp", "C3D10", mesh, [CARDS["cload.load"]]).read_text()
    lines, node = text.splitlines(), False
    for k, line in enumerate(lines):  # the same part in millimetres, tonnes and seconds
        if line.startswith("*"):
            node = line.startswith("*NODE, NSET=NALL")
        elif node:
            label, *xyz = line.split(",")
            lines[k] = ", ".join([label, *(f"{1000 * float(x):.12g}" for x in xyz)])
    text = "\n".join(lines) + "\n"
    text = text.replace("210e9, 0.3", "210e3, 0.3").replace("7850.", "7.85e-9")
    (tmp_path / "mm.inp").write_text(text)
    H = {}
    for deck, units, more in (
        ("m", "SI", ["--deck-loads"]),
        ("mm", "mm-t-s", []),
        ("mm", "mm-t-s", ["--deck-loads"]),
    ):
        body = tmp_path / "body.h5"
        run(
            "import",
            tmp_path / f"{deck}.inp",
            "--run-ccx",
            "--units",
            units,
            *more,
            "--rigid",
            "end=NSET:END",
            "-o",
            body,
        )
        system = body_system(body)
        C = system.B.T if system.C is None else system.C
        H[deck, bool(more)] = C @ spsolve(system.K.tocsc(), system.B)
    whole = H["m", True]
    assert whole.shape == (6, 7)
    for other in (H["mm", True], np.hstack([H["mm", False], whole[:, 6:]])):
        assert np.allclose(other, whole, rtol=1e-5, atol=1e-7 * np.abs(whole[:3]).max())


def test_an_assembled_body_keeps_its_feedthrough(tmp_path: Path) -> None:
    mesh = sided("tetra10")
    write_body(
        tmp_path / "body.h5",
        mesh,
        materials=STEEL,
        loads=HEAT,
        outputs=SPOT,
        supports={"start": {"nodes": "start"}},
        damping={"beta": 1e-6},
    )
    run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "matrices.h5")
    through = []
    for name in ("body", "matrices"):
        run(
            "reduce",
            "-body",
            tmp_path / f"{name}.h5",
            "-mor_band_hz",
            "100,4000",
            "-mor_out",
            tmp_path / "rom.h5",
        )
        through.append(ReducedModel.load(tmp_path / "rom.h5").feedthrough)
    assert np.abs(through[0]).max() > 1e6 and np.array_equal(*through)
    with h5py.File(tmp_path / "matrices.h5", "a") as file:
        direct = file["feedthrough"][:]
        del file["feedthrough"]
        file["feedthrough"] = direct[:, :-1]
    refused = run(
        "reduce",
        "-body",
        tmp_path / "matrices.h5",
        "-mor_band_hz",
        "100,4000",
        "-mor_out",
        tmp_path / "rom.h5",
        expect=1,
    )
    assert "/feedthrough must be n_out × n_in" in refused.err


@ccx
def test_temperatures_of_several_cards_and_steps(tmp_path: Path) -> None:
    """What is in force at the end of each step, as ccx has it."""
    mesh = sided("tetra10", counts=(5, 3, 3))
    first = "*TEMPERATURE\nNALL, 70.\n*TEMPERATURE\nEND, 120.\n"
    second = "*TEMPERATURE\nSTART, 10.\n"
    deck = loaded_deck(tmp_path / "warm.inp", "C3D10", mesh, [first, second])
    body = tmp_path / "body.h5"
    run("import", deck, "--assemble", "--deck-loads", "--distributing", "end=NSET:END", "-o", body)
    a = assembled(tmp_path / "matrices.h5", body)
    B, _ = ports(tmp_path / "matrices.h5")
    subprocess.run(["ccx", deck.stem], cwd=tmp_path, capture_output=True, check=True)
    theirs = frd(deck.with_suffix(".frd"))["DISP"]
    labels = np.arange(len(mesh.points)) + 10
    for k in (0, 1):
        u = at_nodes(a, spsolve(a["K"].tocsc(), B[f"step{k + 1}_temperature.T"]), len(mesh.points))
        printed = np.array([theirs[k][label][:3] for label in labels])
        assert np.abs(u - printed).max() < 5.1e-6 * np.abs(printed).max()


def test_more_that_is_left_out(tmp_path: Path) -> None:
    """What ccx loads twice, or once only, by name; numbers of tables are the deck's; heat without
    an expansion that is known."""
    mesh = sided("tetra10")
    cards = (
        "*DLOAD\nEALL, CENTRIF, 4.E6, 0., 0., 0., 1., 0., 0.\n"
        "EALL, CENTRIF, 1.E6, 0., 0., 0., 1., 0., 0.\n*DLOAD\nTWICE, P1, 1.D6\n"
        "*DLOAD\nEALL, GRAV, 1.D1, 0., 0., 1.\n*TEMPERATURE\nNALL, 30.\n"
    )
    deck = loaded_deck(tmp_path / "part.inp", "C3D10", mesh, [cards])
    text = deck.read_text().replace("*MATERIAL", "*ELSET, ELSET=TWICE\nSOME, SOME\n*MATERIAL", 1)
    deck.write_text(text.replace("*EXPANSION\n1.2E-5", "*EXPANSION\n1.2E-5, 20.\n1.3E-5, 90."))
    body = tmp_path / "body.h5"
    node = int(mesh.point_sets["end"][2])
    (tmp_path / "push.csv").write_text(f"{node + 10}, 0, 5, 0\n")
    said = run(
        "import",
        deck,
        "--assemble",
        "--deck-loads",
        "--load",
        f"push=nodal:{tmp_path / 'push.csv'}",
        "--distributing",
        "end=NSET:END",
        "-o",
        body,
    ).out
    for load, words in (
        ("dload", "a second CENTRIF on an element, which ccx ignores"),
        ("dload2", "element set TWICE names members twice"),
        ("temperature", "a material has no *EXPANSION, or one of"),
    ):
        assert f"load step1_{load} is left out: {words}" in said
    a = assembled(tmp_path / "matrices.h5", body)
    B, _ = ports(tmp_path / "matrices.h5")
    assert "step1_dload3.load" in B
    there = at_nodes(a, B["push.load"], len(mesh.points))
    assert there[node, 1] == 5 and np.abs(there).sum() == 5


@ccx
def test_loads_on_what_depends_on_others(tmp_path: Path) -> None:
    """A held body with an equation: gravity on all but the dependent node's share is no load of
    its rows; a force elsewhere is. Shells have no loads here."""
    mesh = sided("tetra10")
    *end, other = (int(n) + 10 for n in mesh.point_sets["end"][:3])
    deck = loaded_deck(
        tmp_path / "eq.inp",
        "C3D10",
        mesh,
        ["*DLOAD\nEALL, GRAV, 9.81, 0., 0., 1.\n", f"*CLOAD\n{other}, 2, 10.\nSTART, 1, 5.\n"],
    )
    equation = f"*EQUATION\n2\n{end[0]}, 3, 1., {end[1]}, 3, -1.\n*BOUNDARY"
    deck.write_text(deck.read_text().replace("*BOUNDARY", equation, 1))
    said = run(
        "import",
        deck,
        "--run-ccx",
        "--deck-loads",
        "--node",
        f"tip=NODES:{other}",
        "-o",
        tmp_path / "body.h5",
    ).out
    assert f"load step1_dload is left out: node {end[0]} has no row of its own in dir" in said
    system = body_system(tmp_path / "body.h5")
    assert np.count_nonzero(system.B[:, -1]) == 1 and system.B[:, -1].sum() == 10
    shell = (
        "*NODE, NSET=NALL\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n*ELEMENT, TYPE=S4, ELSET=E\n"
        "1,1,2,3,4\n*MATERIAL, NAME=M\n*ELASTIC\n2.1e11,.3\n*DENSITY\n7850.\n"
        "*SHELL SECTION, ELSET=E, MATERIAL=M\n.1\n*STEP\n*STATIC\n*CLOAD\n3,3,10.\n"
        "*END STEP\n"
    )
    (tmp_path / "shell.inp").write_text(shell)
    said = run(
        "import",
        tmp_path / "shell.inp",
        "--run-ccx",
        "--deck-loads",
        "--rows",
        "tip=1",
        "-o",
        tmp_path / "shell.h5",
    ).out
    assert "the loads of the deck are left out: it has S4 elements beside solids" in said
    assert "no coordinates are kept" in said
    whole = run(  # both nodes that ccx makes of it
        *("import", tmp_path / "shell.inp", "--run-ccx", "--node", "tip=NODES:3"),
        *("-o", tmp_path / "shell.h5"),
    )
    assert "6 ports: tip-" in whole.out
