"""Bodies under loads that stay: tension, spin in the turning frame; closed forms and CalculiX."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as sl
from test_importers import ccx_frequencies, write_deck

import flexgram
from bodies import CALCULIX, FORMULATIONS, box
from conftest import assembled, body_system, read_sparse, run
from flexgram import BodyError, ReducedModel
from flexgram.__main__ import main
from flexgram.body.description import import_description

TWO_PI = 2 * np.pi
E, RHO = 210e9, 7850.0
CLAMPED = ["x", "y", "z", "rx", "ry", "rz"]
STEEL = {"steel": {"E": E, "nu": 0.3, "rho": RHO}}

LOADED = {
    "materials": STEEL,
    "regions": {"all": {"material": "steel"}},
    "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
    "supports": {"start": {"nodes": "start"}},
    "loads": {
        "turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]},
        "gravity": {"type": "acceleration"},
        "spin": {"type": "spin", "point": [0, 0, 0], "axis": [1, 0, 0]},
        "rim": {"type": "nodal", "table": [[28, 0, 0, 1.0]]},
    },
}


def line(count: int, start: float, length: float) -> Any:
    x = np.linspace(start, start + length, count + 1)
    points = np.column_stack([x, 0 * x, 0 * x])
    cells = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    sets = {"start": np.array([0]), "end": np.array([count])}
    parts = {"all": [np.arange(count)]}
    return meshio.Mesh(points, [("line", cells)], point_sets=sets, cell_sets=parts)


def import_beam(path: Path, mesh: Any, side: float, **more: Any) -> None:
    content = {
        "materials": STEEL,
        "sections": {"bar": {"shape": "rectangle", "width": side, "height": side}},
        "regions": {"all": {"material": "steel", "section": "bar"}},
        "interfaces": {"end": {"coupling": "node", "nodes": "end"}},
        "supports": {"clamp": {"nodes": "start", "components": CLAMPED}},
    }
    import_description(content | more, "beam", path, mesh=mesh)


def modes(a: dict[str, Any], along: int, count: int) -> Any:
    """First angular frequencies of the modes whose largest motion is along an axis."""
    values, vectors = sl.eigh(a["K"].toarray(), a["M"].toarray())
    size = np.array([abs(vectors[a["component"] == c]).max(axis=0) for c in range(3)])
    return np.sqrt(values[size.argmax(axis=0) == along][:count])


def test_a_string_under_tension(tmp_path: Path) -> None:
    side, length, tension = 2e-4, 1.0, 1.0  # m, m, N
    import_beam(
        tmp_path / "body.h5",
        line(250, 0, length),
        side,
        supports={
            "clamp": {"nodes": "start", "components": CLAMPED},
            "guide": {"nodes": "end", "components": ["y", "z", "rx", "ry", "rz"]},
        },
        interfaces={"middle": {"coupling": "node", "nodes": [31]}},
        loads={"pull": {"type": "force", "nodes": "end"}},
        preload={"pull.fx": tension},
    )
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    # With clamped ends and a little stiffness (Fletcher 1964).
    order, layer = np.arange(1, 4), np.sqrt(E * side**4 / 12 / tension) / length
    stiff = 1 + 2 * layer + (4 + (np.pi * order) ** 2 / 2) * layer**2
    expected = np.pi * order / length * np.sqrt(tension / (RHO * side**2)) * stiff
    np.testing.assert_allclose(modes(a, 2, 3), expected, rtol=1e-4)


def gyroscopic_frequencies(K: Any, M: Any, G: Any) -> Any:
    """[rad/s] of M q'' + G q' + K q = 0, ascending."""
    n = len(K)
    first_order = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, G)]]
    )
    values = np.linalg.eigvals(first_order).imag
    return np.sort(values[values > 0])


def lowest(K: Any, M: Any, count: int) -> tuple[Any, Any]:
    """Eigenvalues of K x = λ M x and vectors, of a K that is definite; M may be singular."""
    inverse, X = sl.eigh(M, K)
    return 1 / inverse[::-1][:count], (X / np.sqrt(abs(inverse)))[:, ::-1][:, :count]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("load", ["turn", "pull"])
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D15", "C3D20", "C3D6", "C3D8", "C3D20R"])
def test_frequencies_of_calculix(element: str, load: str, tmp_path: Path) -> None:
    """Frequencies after a static step, to the digits that ccx prints."""
    mesh = box(CALCULIX[element], (6, 2, 2))
    card, preload = {
        "turn": ("*DLOAD\nEALL, CENTRIF, 1e8, 0.01, -0.02, 0.005, 0, 0.6, 0.8", {"turn.spin": 1e8}),
        "pull": ("*CLOAD\nEND, 1, 2e4", {"pull.fx": 2e4 * len(mesh.point_sets["end"])}),
    }[load]
    steps = (
        f"*BOUNDARY\nSTART, 1, 3\n*STEP\n*STATIC\n{card}\n*END STEP\n"
        "*STEP, PERTURBATION\n*FREQUENCY\n8\n*END STEP\n"
    )
    theirs = ccx_frequencies(write_deck(tmp_path / "box.inp", element, steps, mesh=mesh))[:8]
    plain = steps.replace(card, "*CLOAD\nEND, 1, 0")
    without = ccx_frequencies(write_deck(tmp_path / "plain.inp", element, plain, mesh=mesh))[:8]
    content = LOADED | {
        "loads": {
            "turn": {"type": "spin", "point": [0.01, -0.02, 0.005], "axis": [0, 3, 4]},
            "pull": {"type": "force", "nodes": "end"},
        },
        "mass_integration": "reduced",
        "regions": {"all": {"material": "steel", **FORMULATIONS.get(element, {})}},
    }
    for loads, expected in (({}, without), (preload, theirs)):
        import_description(content | {"preload": loads}, "box", tmp_path / "body.h5", mesh=mesh)
        a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
        values, _ = lowest(a["K"].toarray(), a["M"].toarray(), 8)
        np.testing.assert_allclose(np.sqrt(values) / TWO_PI, expected, rtol=1e-6)
    assert max(abs(np.array(theirs) / without - 1)) > 0.01  # the load matters


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("element", ["C3D4", "C3D20"])
def test_a_static_step_of_a_deck(element: str, tmp_path: Path) -> None:
    """The loads of a deck's first step stay: frequencies of its next, to the digits of ccx."""
    steps = (
        "*BOUNDARY\nSTART, 1, 3\n*STEP\n*STATIC\n*CLOAD\nEND, 1, 2e4\n*END STEP\n"
        "*STEP, PERTURBATION\n*FREQUENCY\n8\n*END STEP\n"
    )
    mesh = box(CALCULIX[element], (6, 2, 2))
    deck = write_deck(tmp_path / "box.inp", element, steps, mesh=mesh)
    theirs = ccx_frequencies(deck)[:8]
    more = ["--distributing", "tip=NSET:END", "--assemble", "-o", str(tmp_path / "body.h5")]
    assert main(["import", str(deck), *more]) == 1  # it is preloaded, by what?
    loads = ["--deck-loads", "--preload", "step1_cload.load=1"]
    assert main(["import", str(deck), *more, *loads]) == 0
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    values = sl.eigh(a["K"].toarray(), a["M"].toarray(), eigvals_only=True)[:8]
    np.testing.assert_allclose(np.sqrt(values) / TWO_PI, theirs, rtol=1e-6)
    assert a["names"] == ["tip.fx", "tip.fy", "tip.fz", "tip.mx", "tip.my", "tip.mz"]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
def test_a_spin_of_a_deck_is_not_its_stress_alone(tmp_path: Path, capsys: Any) -> None:
    """CENTRIF as a preload is told to lack the softening; the spin that is named has the
    frequencies of ccx."""
    turn = "4e4, 0, 0, 0, 0, 0, 1"
    steps = (
        f"*BOUNDARY\nSTART, 1, 3\n*STEP\n*STATIC\n*DLOAD\nEALL, CENTRIF, {turn}\n*END STEP\n"
        "*STEP, PERTURBATION\n*FREQUENCY\n4\n*END STEP\n"
    )
    deck = write_deck(tmp_path / "box.inp", "C3D20", steps, mesh=box("hexahedron20", (6, 2, 2)))
    theirs, body = np.array(ccx_frequencies(deck)[:4]), tmp_path / "body.h5"
    more = ["--distributing", "tip=NSET:END", "--assemble", "--deck-loads", "-o", str(body)]
    ways = {
        "stress alone": ["--preload", "step1_dload.load=1"],
        "spin": ["--load", "turn=spin:0,0,0,0,0,1", "--preload", "turn.spin=4e4"],
    }
    found = {}
    for name, words in ways.items():
        assert main(["import", str(deck), *more, *words]) == 0
        said = capsys.readouterr().out
        assert ("softening by that spin" in said) == (name == "stress alone")
        a = assembled(tmp_path / "matrices.h5", body)
        values = sl.eigh(a["K"].toarray(), a["M"].toarray(), eigvals_only=True)[:4]
        found[name] = np.sqrt(values) / TWO_PI
    np.testing.assert_allclose(found["spin"], theirs, rtol=1e-6)
    assert found["stress alone"][0] > theirs[0] * (1 + 1e-4)


def test_spin_of_the_command_line(tmp_path: Path) -> None:
    """As the same of a description in YAML."""
    mesh = box("tetra10", (6, 1, 1))
    meshio.write(tmp_path / "box.vtu", meshio.Mesh(mesh.points, mesh.cells))
    places = ["--distributing", "tip=BOX:0.099,-1,-1,0.101,1,1"]
    where = "0,0,0,0,0,1:600,3000"
    source = [str(tmp_path / "box.vtu"), "--material", "steel", "-o", str(tmp_path / "spun.h5")]
    assert main(["import", *source, *places, "--spin", where]) == 0
    with h5py.File(tmp_path / "spun.h5") as file:
        spin = dict(file["spin"].attrs)
    assert spin["frame"] == "turning" and spin["axis"].tolist() == [0, 0, 1]
    assert spin["least"] == pytest.approx(20 * np.pi) and spin["most"] == pytest.approx(100 * np.pi)
    assert main(["import", *source, *places, "--spin", "0,0,0,0,0,1"]) == 1
    more = ("assemble", "-body", tmp_path / "spun.h5", "-body_out", tmp_path / "m.h5")
    assert "a spin needs supports (--support of a mesh" in run(*more, expect=1).err
    root = "root=BOX:-0.001,-1,-1,0.001,1,1"
    assert main(["import", *source, *places, "--spin", where, "--support", root]) == 0
    run(*more)
    with h5py.File(tmp_path / "m.h5") as file:
        held = read_sparse(file, "K")
        assert held.shape[0] == 3 * (len(mesh.points) - np.sum(mesh.points[:, 0] < 1e-3))
    twice = ["--support", f"root=x,z:{root[5:]}", "--support", f"rail=y:{root[5:]}"]
    assert main(["import", *source, *places, "--spin", where, *twice]) == 0
    run(*more)
    with h5py.File(tmp_path / "m.h5") as file:
        assert abs(read_sparse(file, "K") - held).max() == 0
    assert main(["import", *source, *places, "--support", "root=q:BOX:0,0,0,1,1,1"]) == 1
    assert main(["import", *source, *places, *twice[:2], *twice[:2]]) == 1
    assert main(["import", *source, *places, "--preload", "tip.fx"]) == 1


@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D15", "C3D20", "C3D6", "C3D8", "C3D20R"])
def test_coriolis_of_calculix(element: str, tmp_path: Path) -> None:
    """Frequencies in the turning frame, by ten modes, to the digits that ccx finds."""
    mesh, count, spin = box(CALCULIX[element], (3, 2, 1)), 10, 1e8
    card = f"*DLOAD\nEALL, CENTRIF, {spin}, 0.01, -0.02, 0.005, 0, 0.6, 0.8"
    steps = (
        f"*BOUNDARY\nSTART, 1, 3\n*STEP\n*STATIC\n{card}\n*END STEP\n"
        f"*STEP, PERTURBATION\n*FREQUENCY, STORAGE=YES\n{count}\n*END STEP\n"
        f"*STEP, PERTURBATION\n*COMPLEX FREQUENCY, CORIOLIS\n{count}\n{card}\n*END STEP\n"
    )
    job = write_deck(tmp_path / "box.inp", element, steps, mesh=mesh)
    subprocess.run(["ccx", job.stem], cwd=tmp_path, capture_output=True, check=True)
    text = job.with_suffix(".dat").read_text()
    table = text[text.rindex("IMAGINARY PART") :].splitlines()[3 : 3 + count]
    theirs = np.array([float(row.split()[1]) for row in table])
    content = LOADED | {
        "loads": {"turn": {"type": "spin", "point": [0.01, -0.02, 0.005], "axis": [0, 3, 4]}},
        "mass_integration": "reduced",
        "preload": {"turn.spin": spin},
        "regions": {"all": {"material": "steel", **FORMULATIONS.get(element, {})}},
    }
    import_description(content, "box", tmp_path / "body.h5", mesh=mesh)
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    K, M, G = (a[name].toarray() for name in "KMG")
    _, V = lowest(K, M, count)
    ours = gyroscopic_frequencies(V.T @ K @ V, V.T @ M @ V, V.T @ G @ V)
    np.testing.assert_allclose(ours, theirs, rtol=1e-5)
    assert max(abs(ours / np.sqrt(np.diag(V.T @ K @ V)) - 1)) > 1e-3  # G matters


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ["hexahedron", "tetra10"])
def test_a_loaded_body_is_certified(kind: str, ranks: int, tmp_path: Path) -> None:
    """Loss factors of materials are of K without stress; loads of the preload are no inputs."""
    content = LOADED | {
        "materials": {"steel": STEEL["steel"] | {"loss_factor": 0.01}},
        "preload": {"turn.spin": 4e7, "end.fz": 2e3},
    }
    mesh = box(kind, (6, 2, 2))
    import_description(content, "box", tmp_path / "body.h5", mesh=mesh)
    run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5", ranks=ranks)
    import_description(content | {"preload": {}}, "box", tmp_path / "rest.h5", mesh=mesh)
    rest = assembled(tmp_path / "rest_matrices.h5", tmp_path / "rest.h5", ranks)
    with h5py.File(tmp_path / "m.h5") as file:
        S = read_sparse(file, "S")
        names = list(file["B"].attrs["names"])
    assert "turn.spin" not in names and "gravity.az" in names
    assert abs(S - 0.01 * rest["K"]).max() < 1e-12 * abs(rest["K"]).max()
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "100,8000"),
        *("-mor_tol", "1e-4", "-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    ).out
    assert "whose Coriolis forces are G" in said and "not read" not in said
    rom, full = ReducedModel.load(tmp_path / "rom.h5"), body_system(tmp_path / "m.h5")
    assert rom.certified_error <= 1e-4
    for omega in TWO_PI * np.array([100.0, 1234.5, 3000.0, 8000.0]):
        H, H_r = full.transfer(omega), rom.transfer([omega])[0]
        assert np.linalg.norm((H_r - H).astype(complex)) <= 1e-4 * np.linalg.norm(H.astype(complex))


@pytest.mark.kernels
def test_an_undamped_spin_is_certified(tmp_path: Path) -> None:
    """Coriolis forces move resonances away from those of K and M; nothing damps either."""
    content = LOADED | {"preload": {"turn.spin": 2e7}}
    import_description(content, "box", tmp_path / "body.h5", mesh=box("hexahedron", (8, 2, 2)))
    full = body_system(tmp_path / "body.h5")
    rom = flexgram.reduce(tmp_path / "body.h5", (100, 8000), 1e-4)
    assert rom.certified_error <= 1e-4
    assert rom.claim.kind == "certified outside"
    for omega in TWO_PI * np.array([100.0, 1234.5, 3000.0, 8000.0]):
        H, H_r = full.transfer(omega), rom.transfer([omega])[0]
        assert np.linalg.norm((H_r - H).astype(complex)) <= 1e-4 * np.linalg.norm(H.astype(complex))


@pytest.mark.parametrize("ranks", [1, 2])
def test_locking_is_told(ranks: int, tmp_path: Path) -> None:
    """A preload that bends a bar of few elements: how much stiffer it is by locking is what the
    warning says, against many elements; quadratic elements follow."""
    content = {
        "materials": {"soft": {"E": 2e9, "nu": 0.3, "rho": 2000.0}},
        "regions": {"all": {"material": "soft"}},
        "interfaces": {"tip": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"root": {"nodes": "start"}},
        "damping": {"beta": 1e-4},
        "loads": {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}},
    }
    stiffer, told = {}, {}
    for kind, along in (("hexahedron", 6), ("hexahedron", 48), ("hexahedron20", 6)):
        mesh = box(kind, (along, 1, 1), (1.0, 0.03, 0.05), distort=False)  # beside the axis
        lowest = []
        for load in ({}, {"turn.spin": 900.0}):
            import_description(content | {"preload": load}, "bar", tmp_path / "b.h5", mesh=mesh)
            a = assembled(tmp_path / "m.h5", tmp_path / "b.h5")
            lowest.append(sl.eigh(a["K"].toarray(), a["M"].toarray(), eigvals_only=True)[0])
        stiffer[kind, along] = lowest[1] / lowest[0]
        said = run(
            "assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5", ranks=ranks
        )
        told[kind, along] = re.findall(r"about (\S+) % too stiff", said.out)
    excess = 100 * (stiffer["hexahedron", 6] / stiffer["hexahedron", 48] - 1)
    assert float(told["hexahedron", 6][0]) == pytest.approx(excess, rel=0.5) and excess > 3
    assert stiffer["hexahedron20", 6] == pytest.approx(stiffer["hexahedron", 48], rel=0.01)
    assert not told["hexahedron", 48] and not told["hexahedron20", 6]


@pytest.mark.parametrize("load", ["force", "spin"])
def test_where_a_column_gives_way(load: str, tmp_path: Path) -> None:
    """At Euler's load of a cantilever, and at the first critical speed of a shaft."""
    side, length = 5e-3, 1.0
    stiffness, mass = E * side**4 / 12, RHO * side**2
    if load == "force":
        more = {"preload": {"end.fx": -2.5 * np.pi**2 * stiffness / (4 * length**2)}}
        share = "buckled at about 0.4 of these loads"
    else:
        first = 1.875104**2 * np.sqrt(stiffness / mass) / length**2  # rad/s
        turn = {"type": "spin", "point": [0, 0, 0], "axis": [1, 0, 0]}
        more = {"loads": {"turn": turn}, "preload": {"turn.spin": (first / 0.6) ** 2}}
        share = "tears it apart at about 0.6 of its speed"
    import_beam(tmp_path / "body.h5", line(40, 0, length), side, **more)
    with pytest.raises(BodyError, match=share):
        flexgram.reduce(tmp_path / "body.h5", (1, 100), 1e-3)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("force", [50.0, -8.0])
def test_a_rigid_arm_is_one_of_stiff_beams(force: float, ranks: int, tmp_path: Path) -> None:
    """A force at the end of an arm turns with nothing: it straightens the arm, or topples it."""
    side, length, arm = 5e-3, 1.0, 0.5
    slender = line(20, 0, length)
    nodes = {"coupling": "rigid", "nodes": "end", "position": [length + arm, 0, 0]}
    preload = {"end.fx": force}
    import_beam(tmp_path / "body.h5", slender, side, interfaces={"end": nodes}, preload=preload)
    longer = line(30, 0, length + arm)
    longer.cell_sets = {"all": [np.arange(20)], "arm": [np.arange(20, 30)]}
    stiff = {"stiff": {"E": 1e6 * E, "nu": 0.3, "rho": RHO}}
    import_beam(
        tmp_path / "beams.h5",
        longer,
        side,
        materials=STEEL | stiff,
        regions={
            "all": {"material": "steel", "section": "bar"},
            "arm": {"material": "stiff", "section": "bar"},
        },
        preload=preload,
    )
    found = []
    for name in ("body", "beams"):
        a = assembled(tmp_path / f"{name}.m.h5", tmp_path / f"{name}.h5", ranks)
        found.append(a["B"].T @ np.linalg.solve(a["K"].toarray(), a["B"]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4, atol=1e-6 * abs(found[1]).max())


def test_a_rigid_block_is_softened_by_spin(tmp_path: Path) -> None:
    """What is added to K is that of the turning mass, in a rigid interface too."""
    spin = 4e4
    mesh = box("hexahedron20", (4, 2, 2), distort=False)
    mesh.point_sets["half"] = np.flatnonzero(mesh.points[:, 0] > 0.049)
    stiff = LOADED | {
        "interfaces": {"end": {"coupling": "rigid", "nodes": "half", "position": [0.1, 0, 0]}},
    }
    turn = {"type": "spin", "point": [0, 0, 0], "axis": [1, 0, 0]}  # nothing pulls along the axis
    matrices = []
    for preload in ({}, {"turn.spin": spin}):
        content = stiff | {"loads": {"turn": turn}, "preload": preload}
        import_description(content, "box", tmp_path / "body.h5", mesh=mesh)
        matrices.append(assembled(tmp_path / "m.h5", tmp_path / "body.h5"))
    rest, turning = matrices
    K, K_s, M = (a.toarray() for a in (rest["K"], turning["K"], rest["M"]))
    (i,) = np.flatnonzero(rest["B"][:, rest["names"].index("end.fy")])
    np.testing.assert_allclose(K_s[i, i] - K[i, i], -spin * M[i, i], rtol=0.02)
