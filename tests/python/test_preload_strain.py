"""Bodies under heat, and with bolts that are tightened, against CalculiX and closed forms."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from test_importers import ccx_frequencies, write_deck
from test_preload import RHO, E, lowest

import flexgram
from bodies import CALCULIX, FORMULATIONS, box
from conftest import assembled, body_system, run
from flexgram import BodyError, ReducedModel
from flexgram.__main__ import main
from flexgram.body.description import import_description

TWO_PI = 2 * np.pi
EXPANSION = 1.2e-5
STEEL = {"steel": {"E": E, "nu": 0.3, "rho": RHO, "expansion": EXPANSION}}
HELD = {"start": {"nodes": "start"}, "end": {"nodes": "end", "components": ["x", "y"]}}
ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed")


def numbers(chosen: Any) -> list[int]:
    """Node numbers, from 1."""
    return [int(node) + 1 for node in np.flatnonzero(chosen)]


def content(element: str, **more: Any) -> dict[str, Any]:
    return {
        "materials": STEEL,
        "regions": {"all": {"material": "steel", **FORMULATIONS.get(element, {})}},
        "interfaces": {"tip": {"coupling": "distributing", "nodes": "end"}},
        "mass_integration": "reduced",
    } | more


def frequencies(given: Any, mesh: Any, folder: Path, ranks: int = 1) -> Any:
    """The first eight of the assembled body [Hz]."""
    import_description(given, "box", folder / "body.h5", mesh=mesh)
    a = assembled(folder / "matrices.h5", folder / "body.h5", ranks)
    values, _ = lowest(a["K"].toarray(), a["M"].toarray(), 8)
    return np.sqrt(values) / TWO_PI


def kept(mesh: Any, chosen: Any) -> tuple[Any, Any]:
    """Points and cells of some of a mesh's elements."""
    cells = mesh.cells[0].data[chosen]
    used, new = np.unique(cells, return_inverse=True)
    return mesh.points[used], [(mesh.cells[0].type, new.reshape(cells.shape))]


def warm_deck(folder: Path, element: str, mesh: Any) -> tuple[Path, Any]:
    """A box between two walls, warmed along x and y; the temperatures above those at first."""
    size = np.ptp(mesh.points, axis=0)
    above = 60 * mesh.points[:, 0] / size[0] + 30 * mesh.points[:, 1] / size[1]
    rows = "\n".join(f"{node + 10}, {20 + t:.15g}" for node, t in enumerate(above))
    steps = (
        "*BOUNDARY\nSTART, 1, 3\nEND, 1, 2\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20\n"
        f"*STEP\n*STATIC\n*TEMPERATURE\n{rows}\n*END STEP\n"
        "*STEP, PERTURBATION\n*FREQUENCY\n8\n*END STEP\n"
    )
    deck = write_deck(folder / "box.inp", element, steps, mesh=mesh)
    section = "*SOLID SECTION"
    deck.write_text(deck.read_text().replace(section, f"*EXPANSION\n{EXPANSION}\n{section}"))
    return deck, above


@ccx
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D15", "C3D20", "C3D6", "C3D8", "C3D20R"])
def test_warm_boxes_of_calculix(element: str, tmp_path: Path) -> None:
    """C3D8 of ccx takes one temperature an element, which is 0.4 % of what heat does here."""
    mesh = box(CALCULIX[element], (6, 2, 2))
    deck, above = warm_deck(tmp_path, element, mesh)
    theirs = ccx_frequencies(deck)[:8]
    loads = {"warm": {"type": "temperature", "table": [[k + 1, t] for k, t in enumerate(above)]}}
    given = content(element, supports=HELD, loads=loads)
    cold = frequencies(given, mesh, tmp_path)
    warm = frequencies(given | {"preload": {"warm.T": 1.0}}, mesh, tmp_path)
    np.testing.assert_allclose(warm, theirs, rtol=2e-5 if element == "C3D8" else 1e-6)
    assert max(abs(warm / cold - 1)) > 2e-3


@ccx
def test_the_heat_of_a_deck_stays(tmp_path: Path) -> None:
    deck, _ = warm_deck(tmp_path, "C3D10", box("tetra10", (6, 2, 2)))
    theirs = ccx_frequencies(deck)[:8]
    more = ["--distributing", "tip=NSET:END", "--assemble", "-o", str(tmp_path / "body.h5")]
    loads = ["--deck-loads", "--preload", "step1_temperature.T=1"]
    assert main(["import", str(deck), *more, *loads]) == 0
    a = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    values, _ = lowest(a["K"].toarray(), a["M"].toarray(), 8)
    np.testing.assert_allclose(np.sqrt(values) / TWO_PI, theirs, rtol=1e-6)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "tetra10", "wedge15"])
def test_heat_without_stress(kind: str, ranks: int, tmp_path: Path) -> None:
    """A body that is free to expand has no stress, also where the temperature is linear (hexahedra
    of first order: constant) in it; orthotropic bodies too, where it is constant."""
    mesh = box(kind, (4, 2, 2), distort=kind == "hexahedron")
    corner = mesh.points[[0, 2, 6]]  # three translations, two, one: nothing resists
    assert np.ptp(corner[:, 0]) == 0
    supports = {
        "a": {"nodes": [1]},
        "b": {"nodes": [3], "components": ["x", "y"]},
        "c": {"nodes": [7], "components": ["x"]},
    }
    constant = np.full(len(mesh.points), 30.0)
    linear = constant + (kind != "hexahedron") * 400 * mesh.points @ [1, 2, -1]
    wood = {
        **{"E1": 11e9, "E2": 9e8, "E3": 5e8, "nu12": 0.3, "nu13": 0.35, "nu23": 0.4},
        **{"G12": 8e8, "G13": 7e8, "G23": 6e7, "rho": 600.0},
        "axis_1": [0.6, 0.8, 0],
        "axis_2": [-0.8, 0.6, 0],
        "expansion": [4e-6, 3e-5, 5e-5],
    }
    for materials, above in (({}, linear), ({"materials": {"steel": wood}}, constant)):
        loads = {
            "warm": {"type": "temperature", "table": [[k + 1, t] for k, t in enumerate(above)]}
        }
        given = content("", supports=supports, loads=loads, **materials, preload={"warm.T": 1.0})
        import_description(given, "box", tmp_path / "body.h5", mesh=mesh)
        args = ("-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5")
        said = run("assemble", *args, ranks=ranks).out
        assert "locking" not in said
        stress = re.search(r"axial\) at\s+most (\S+)", said)
        assert stress and float(stress[1]) < 1e-8 * E * EXPANSION * 30


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_warm_column_buckles(ranks: int, tmp_path: Path) -> None:
    """Clamped at both ends, at αΔT = 4π²I/(AL²); and its reduced body below that is certified."""
    side, length = 0.02, 1.0
    mesh = box("hexahedron20", (20, 1, 1), (length, side, side), distort=False)
    middle = abs(mesh.points[:, 0] - 0.5) < 0.01
    critical = 4 * np.pi**2 * side**2 / 12 / length**2 / EXPANSION
    given = content(
        "",
        interfaces={"middle": {"coupling": "distributing", "nodes": numbers(middle)}},
        supports={end: {"nodes": end} for end in ("start", "end")},
        loads={"warm": {"type": "temperature", "nodes": numbers(middle | ~middle)}},
        damping={"beta": 1e-5},
    )
    import_description(
        given | {"preload": {"warm.T": 2 * critical}}, "column", tmp_path / "hot.h5", mesh=mesh
    )
    with pytest.raises(BodyError, match=r"buckled at about 0\.5 of these loads"):
        flexgram.reduce(tmp_path / "hot.h5", (1, 100), 1e-3)
    import_description(
        given | {"preload": {"warm.T": 0.9 * critical}}, "column", tmp_path / "body.h5", mesh=mesh
    )
    run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "5,500", "-mor_tol", "1e-4"),
        *("-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    )
    rom, full = ReducedModel.load(tmp_path / "rom.h5"), body_system(tmp_path / "body.h5")
    assert rom.certified_error <= 1e-4 and "warm.T" not in rom.inputs
    for omega in TWO_PI * np.array([5.0, 31.0, 222.0, 500.0]):
        H, H_r = full.transfer(omega), rom.transfer([omega])[0]
        assert np.linalg.norm((H_r - H).astype(complex)) <= 1e-4 * np.linalg.norm(H.astype(complex))


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20"])
def test_heat_pushes_a_rigid_end(kind: str, tmp_path: Path) -> None:
    """A rigid interface turns with the forces of warm elements at it, as a stiff block does."""
    side, length = 0.02, 1.0
    mesh = box(kind, (20, 1, 1), (length, side, side), distort=False)
    x = mesh.points[:, 0]
    mesh.point_sets["far"] = np.flatnonzero(x > 0.69)
    centre = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 0]
    whole = np.arange(len(centre))
    mesh.cell_sets = {"bar": [whole[centre < 0.7]], "block": [whole[centre > 0.7]]}
    warm = {"warm": {"type": "temperature", "nodes": numbers(x < 0.71)}}
    wall = {"wall": {"at": "tip", "stiffness": [1e10, 0, 0, 0, 0, 0]}}
    found = []
    for stiff in (1, 1e4):
        nodes = "far" if stiff == 1 else "end"
        given = content(
            "",
            materials=STEEL
            | {"stiff": {"E": stiff * E, "nu": 0.3, "rho": RHO, "expansion": 1e-30}},
            regions={"bar": {"material": "steel"}, "block": {"material": "stiff"}},
            interfaces={
                "tip": {"coupling": "rigid", "nodes": nodes, "position": [1, side / 2, side / 2]}
            },
            supports={"start": {"nodes": "start"}},
            springs=wall,
            loads=warm,
        )
        both = [
            frequencies(given | {"preload": {"warm.T": t}}, mesh, tmp_path)[:4] for t in (0.0, 1.5)
        ]
        found.append(both[1] / both[0])
    np.testing.assert_allclose(found[0], found[1], rtol=2e-3)
    assert min(found[1]) < 0.95


def bolted(element: str, force: float) -> tuple[dict[str, Any], Any]:
    """A bar between two walls whose middle is tightened."""
    mesh = box(CALCULIX[element], (24, 1, 1), (1, 0.01, 0.01), False)
    x = mesh.points[:, 0]
    return content(
        element,
        interfaces={"middle": {"coupling": "distributing", "nodes": numbers(abs(x - 0.5) < 0.05)}},
        supports={end: {"nodes": end} for end in ("start", "end")},
        loads={
            "bolt": {
                "type": "pretension",
                "nodes": numbers((x > 0.24) & (x < 0.76)),
                "axis": [2, 0, 0],
            }
        },
        preload={"bolt.force": force},
    ), mesh


@ccx
@pytest.mark.parametrize("element", ["C3D8", "C3D20"])
def test_pretension_of_calculix(element: str, tmp_path: Path) -> None:
    """ccx tightens by a cut, with the same force; strains of 1e-4 are what that differs by."""
    force = E * 1e-4 * 1e-4
    given, mesh = bolted(element, force)
    ends = mesh.points[mesh.cells[0].data][:, :, 0].max(axis=1)
    cut = "\n".join(f"{k + 1}, S4" for k in np.flatnonzero(abs(ends - 0.5) < 1e-9))
    steps = (
        f"*NODE\n9999, 0, 0, 0\n*SURFACE, NAME=CUT\n{cut}\n"
        "*PRE-TENSION SECTION, SURFACE=CUT, NODE=9999\n1., 0., 0.\n"
        "*BOUNDARY\nSTART, 1, 3\nEND, 1, 3\n"
        f"*STEP\n*STATIC\n*CLOAD\n9999, 1, {force}\n*END STEP\n"
        "*STEP, PERTURBATION\n*BOUNDARY\n9999, 1, 1\n*FREQUENCY\n8\n*END STEP\n"
    )
    theirs = ccx_frequencies(write_deck(tmp_path / "box.inp", element, steps, mesh=mesh))[:6]
    ours = frequencies(given, mesh, tmp_path)[:6]
    np.testing.assert_allclose(ours, theirs, rtol=1e-4)
    loose = frequencies(given | {"preload": {"bolt.force": 0.0}}, mesh, tmp_path)[:6]
    assert ours[0] / loose[0] > (1.01 if element == "C3D8" else 1.1)


@pytest.mark.parametrize("ranks", [1, 2])
def test_two_bolts_and_their_walls(ranks: int, tmp_path: Path) -> None:
    """Two legs and a bridge: each bolt has its force as tightened, with the other one. The wall
    feels it, by the whole stiffness matrix and the shortenings that are printed."""
    side = 0.01
    mesh = box("hexahedron20", (12, 3, 1), (0.6, 3 * side, side), distort=False)
    centre = mesh.points[mesh.cells[0].data].mean(axis=1)
    slot = (abs(centre[:, 1] - 1.5 * side) < side / 2) & (centre[:, 0] < 0.45)
    mesh = meshio.Mesh(*kept(mesh, ~slot))
    mesh.cell_sets = {"all": [np.arange(len(mesh.cells[0].data))]}
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    shank = (x > 0.19) & (x < 0.41)
    legs = {"a": y < 1.01 * side, "b": y > 1.99 * side}
    forces = {"a": 900.0, "b": 2500.0}
    axis = {"type": "pretension", "axis": [1, 0, 0]}
    given = content(
        "",
        interfaces={"grip": {"coupling": "distributing", "nodes": numbers(abs(x - 0.5) < 0.01)}},
        loads={name: axis | {"nodes": numbers(shank & leg)} for name, leg in legs.items()},
    )
    walls = {"walls": {"nodes": numbers((x < 1e-9) | (x > 0.6 - 1e-9))}}
    preload = {f"{name}.force": force for name, force in forces.items()}
    held = given | {"supports": walls, "preload": preload}
    import_description(held, "pair", tmp_path / "body.h5", mesh=mesh)
    said = run(
        *("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5"), ranks=ranks
    ).out
    shortened = dict(re.findall(r"(\w)\.force\s+shortens\s+its\s+shank\s+by\s+(\S+)\s+m", said))
    loose = {key: of for key, of in given.items() if key != "loads"}  # K without supports
    import_description(loose, "pair", tmp_path / "loose.h5", mesh=mesh)
    a = assembled(tmp_path / "loose.m.h5", tmp_path / "loose.h5")
    K, load = a["K"].toarray(), np.zeros(len(a["node"]))
    at = {
        (node, c): row for row, (node, c) in enumerate(zip(a["node"], a["component"], strict=True))
    }
    with h5py.File(tmp_path / "body.h5") as file:
        for name in legs:
            group = file[f"loads/{name}"]
            for node, force in zip(group["nodes"][:], group["values"][:, 0], strict=True):
                for c in range(3):
                    load[at[node, c]] += float(shortened[name]) / 0.2 * force[c]
    wall = np.isin(a["node"], np.array(walls["walls"]["nodes"]) - 1)
    u = np.zeros(len(load))
    u[~wall] = np.linalg.solve(K[np.ix_(~wall, ~wall)], load[~wall])
    reaction = K @ u - load
    for name, leg in legs.items():
        here = (x < 1e-9) & leg
        pull = -sum(reaction[at[node, 0]] for node in np.flatnonzero(here))
        assert pull == pytest.approx(forces[name], rel=0.01)


X = bolted("C3D8", 0.0)[1].points[:, 0]
MIDDLE = numbers(abs(X - 0.5) < 0.05)


def bolts(*shanks: tuple[float, ...]) -> dict[str, Any]:
    """Those of the bar with shanks between pairs of places, 1000 N and 900 N."""
    loads = {}
    for name, ends in zip("ab", shanks, strict=False):
        chosen = np.zeros(len(X), dtype=bool)
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            chosen |= (X > first) & (X < last)
        loads[name] = {"type": "pretension", "nodes": numbers(chosen), "axis": [1, 0, 0]}
    return {
        "loads": loads,
        "preload": {f"{name}.force": 1000.0 - 100 * k for k, name in enumerate(loads)},
    }


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"preload": {}}, "a pretension is a load that stays"),
        ({"loads": {"bolt": {"type": "pretension", "nodes": "end", "axis": [1, 0, 0]}}}, "shank"),
        ({"loads": {"bolt": {"type": "pretension", "nodes": "all"}}}, "axis"),
        ({"supports": {"start": {"nodes": "start"}}}, "nothing resists the shank"),
        (bolts((0.24, 0.55), (0.45, 0.76)), "shares elements of its shank with a"),
        (bolts((0.24, 0.51), (0.49, 0.76)), "a.force, b.force pull on each other"),
        (bolts((0.1, 0.3, 0.6, 0.8)), "in 2 pieces"),
        ({"interfaces": {"rigid": {"coupling": "rigid", "nodes": MIDDLE}}}, "in 2 pieces"),
    ],
)
def test_a_bolt_that_is_none(change: Any, words: str, tmp_path: Path) -> None:
    given, mesh = bolted("C3D8", 100.0)
    mesh.point_sets["all"] = np.arange(len(mesh.points))
    with pytest.raises(BodyError, match=words):
        import_description(given | change, "bar", tmp_path / "body.h5", mesh=mesh)
        flexgram.reduce(tmp_path / "body.h5", (1, 100), 1e-3)


@pytest.mark.parametrize("load", ["nodes", "table"])
@pytest.mark.parametrize("kind", ["pyramid", "pyramid13"])
def test_warm_pyramids(kind: str, load: str, tmp_path: Path) -> None:
    """A cube of six: the nodes in the middle of their bases are warm too."""
    corners = 0.1 * np.array(
        [*([x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))), [0.5] * 3]
    )
    faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    points = list(corners)
    middle: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        if (key := (min(a, b), max(a, b))) not in middle:
            middle[key] = len(points)
            points.append((corners[a] + corners[b]) / 2)
        return middle[key]

    cells = []
    for face in faces:
        q = face[::-1]
        cells.append([*q, 8])
        if kind == "pyramid13":
            cells[-1] += [between(q[i], q[(i + 1) % 4]) for i in range(4)]
            cells[-1] += [between(node, 8) for node in q]
    mesh = meshio.Mesh(np.array(points), [(kind, np.array(cells))])
    mesh.point_sets = {"end": np.array([1, 2, 5, 6]), "every": np.arange(len(points))}
    every = {"table": [[k + 1, 1.0] for k in range(len(points))]}
    supports = {
        "a": {"nodes": [1]},
        "b": {"nodes": [2], "components": ["y", "z"]},
        "c": {"nodes": [4], "components": ["z"]},
    }
    warm = {"type": "temperature"} | (every if load == "table" else {"nodes": "every"})
    given = content("", supports=supports, loads={"warm": warm}, preload={"warm.T": 30.0})
    import_description(given, "cube", tmp_path / "body.h5", mesh=mesh)
    said = run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5").out
    stress = re.search(r"axial\) at\s+most (\S+)", said)
    assert stress and float(stress[1]) < 1e-8 * E * EXPANSION * 30


def test_tables_beside_merged_nodes(tmp_path: Path) -> None:
    """Rows belong to their nodes also where some of these become one."""
    half = box("hexahedron20", (2, 1, 1), (0.1, 0.05, 0.05), distort=False)
    other = half.points + np.array([0.1, 0, 0])
    cells = half.cells[0].data
    whole = meshio.Mesh(
        np.vstack([half.points, other]), [("hexahedron20", np.vstack([cells, cells + len(other)]))]
    )
    x = whole.points[:, 0]
    bodies = []
    for first in (0, len(other)):  # of all, and of the second half alone
        table = [[k + 1, 30 + 100 * x[k]] for k in range(first, len(x))]
        given = content(
            "",
            merge=1e-9,
            interfaces={"tip": {"coupling": "distributing", "nodes": numbers(x > 0.2 - 1e-9)}},
            supports={"a": {"nodes": numbers(x < 1e-9)}},
            loads={"warm": {"type": "temperature", "table": table}},
        )
        import_description(given, "bar", tmp_path / "body.h5", mesh=whole)
        with h5py.File(tmp_path / "body.h5") as file:
            warm = file["loads/warm/temperature"]
            places = file["mesh/points"][:][warm["nodes"][:], 0]
            np.testing.assert_allclose(warm["values"][:], 30 + 100 * places, rtol=1e-12)
            bodies.append(len(places))
    assert bodies == [len(x) - 8, len(other)]


def test_a_node_alone_is_no_part_of_a_shank(tmp_path: Path) -> None:
    given, mesh = bolted("C3D8", 100.0)
    more = np.vstack([mesh.points, [0.5, 0.005, 0.02]])
    alone = meshio.Mesh(more, mesh.cells, point_sets=mesh.point_sets)
    given["loads"]["bolt"]["nodes"] = {"box": [[0.24, -1, -1], [0.76, 1, 1]]}
    given["loads"]["warm"] = {"type": "temperature", "nodes": {"box": [[-1] * 3, [2, 1, 1]]}}
    given["nodes_alone"] = [len(more)]
    import_description(given, "bar", tmp_path / "body.h5", mesh=alone)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("pretension@length", np.inf, "length must be positive"),
        ("pretension@held", -1.0, "held and length must be positive"),
        ("pretension@axis", [2.0, 0, 0], "axis of unit length"),
        ("pretension/nodes", 10**6, "the mesh has"),
    ],
)
def test_a_bolt_of_a_file_by_hand(place: str, value: Any, words: str, tmp_path: Path) -> None:
    given, mesh = bolted("C3D8", 100.0)
    import_description(given, "bar", tmp_path / "b.h5", mesh=mesh)
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        name, _, attribute = place.partition("@")
        group = file[f"loads/bolt/{name}"]
        if attribute:
            group.attrs[attribute] = value
        else:
            group[0] = value
    args = ("-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5")
    assert words in " ".join(run("assemble", *args, expect=1).err.split())
