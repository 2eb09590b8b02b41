"""Mistakes that new users made: what is said of each, and what would have been wrong."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from test_mesh_loads import write_body

import flexgram
from bodies import box
from conftest import assembled, run
from flexgram import BodyError, ReducedModel, ReductionWarning, reduce
from flexgram.body.description import import_description
from flexgram.body.units import doubt
from flexgram.exporters import export
from flexgram.importers import parse
from flexgram.importers.assemble import assemble_deck
from flexgram.model.geometry import Geometry, length_unit
from flexgram.pictures.scene import Scene, libraries
from flexgram.pictures.view import write_view
from flexgram.simulation.histories import judge

PLAIN: dict[str, Any] = {"loads": {}, "outputs": {}, "damping": {"alpha": 5.0, "beta": 1e-6}}
HELD = {"supports": {"foot": {"nodes": "start"}}}


def bar() -> meshio.Mesh:
    return box("tetra10", (4, 1, 1), (0.2, 0.02, 0.03), distort=False)


def two_bars() -> meshio.Mesh:
    """One beside the other, with a gap."""
    one = bar()
    count = len(one.points)
    points = np.vstack([one.points, one.points + np.array([0, 0.1, 0])])
    return meshio.Mesh(
        points,
        [("tetra10", np.vstack([one.cells[0].data, one.cells[0].data + count]))],
        point_sets=one.point_sets,
    )


def test_a_constant_load_counts(tmp_path: Path) -> None:
    """Of a held body whose band begins at 0 Hz: nothing of it was in the error that was told."""
    write_body(tmp_path / "b.h5", bar(), **PLAIN, **HELD)
    coarse = reduce(tmp_path / "b.h5", (0, 500), 3e-2)
    full = assembled(tmp_path / "m.h5", tmp_path / "b.h5")
    t = np.linspace(0, 1, 400)
    u = np.zeros((len(t), len(coarse.inputs)))
    u[:, coarse.inputs.index("end.fy")] = -100.0
    verdict = judge(coarse, t, u)
    assert full["names"] == coarse.inputs == coarse.outputs
    exact = full["B"].T @ spsolve(full["K"].tocsc(), full["B"] @ u[0])
    H = coarse.transfer(0.0) @ u[0]
    for what, kind in (("displacement", "f"), ("rotation", "m")):
        rows = [k for k, name in enumerate(coarse.outputs) if name.split(".")[1][0] == kind]
        off = np.linalg.norm((H - exact)[rows]) / np.linalg.norm(exact[rows])
        assert 0 < off <= verdict.errors[what]
    assert verdict.below == 0
    assert any("has no bound of its own" in words for words in verdict.words)


def test_loads_outside_the_band_are_not_answered(tmp_path: Path) -> None:
    write_body(tmp_path / "b.h5", bar(), **PLAIN)
    rom = reduce(tmp_path / "b.h5", (10, 500), 1e-3)
    u = np.zeros((100, len(rom.inputs)))
    u[:, 0] = 1.0
    said = " ".join(judge(rom, np.linspace(0, 1, 100), u).words)
    assert "no part of these loads lies in the band" in said and "at most" not in said


def test_parts_that_nothing_joins(tmp_path: Path) -> None:
    counts = write_body(tmp_path / "b.h5", two_bars(), **PLAIN)
    assert any("it has 2 parts that nothing joins" in line for line in counts["summary"])
    said = run(
        *("reduce", tmp_path / "b.h5", "--band", "10,500", "--tol", "1e-2"),
        *("-o", tmp_path / "b.rom.h5"),
    )
    assert "has 12 rigid modes, more than the six of one body" in said.out + said.err
    rom = ReducedModel.load(tmp_path / "b.rom.h5")
    for kind in ("sid", "mbdyn", "exudyn"):
        with pytest.raises(BodyError, match="takes one body with six rigid modes, and this has 12"):
            export(rom, tmp_path / "b.out", kind)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_bolt_that_presses_nothing_together(ranks: int, tmp_path: Path) -> None:
    """Half of a bar with a free end is no shank; between two walls it is one."""
    mesh = box("tetra10", (20, 2, 2), (0.2, 0.02, 0.03))  # its faces across are not plane
    x = box("tetra10", (20, 2, 2), (0.2, 0.02, 0.03), distort=False).points[:, 0]
    mesh.point_sets["inner"] = np.flatnonzero((x > 0.049) & (x < 0.151))
    tip = {"tip": {"coupling": "node", "nodes": {"at": [0.1, 0, 0]}}}
    bolt = {"bolt": {"type": "pretension", "nodes": "inner", "axis": [1, 0, 0]}}
    write_body(
        tmp_path / "b.h5", mesh, **(PLAIN | HELD | {"loads": bolt}),
        preload={"bolt.force": 1e3}, interfaces=tip,
    )  # fmt: skip
    words = ("reduce", tmp_path / "b.h5", "--band", "10,500", "--tol", "1e-2")
    said = run(*words, "-o", tmp_path / "b.rom.h5", ranks=ranks)
    assert re.search(r"resists the shank with [0-9.]+ % of the shank's own", said.out + said.err)
    walls = {"supports": {name: {"nodes": name} for name in ("start", "end")}}
    write_body(
        tmp_path / "b.h5", mesh, **(PLAIN | walls | {"loads": bolt}),
        preload={"bolt.force": 1e3}, interfaces=tip,
    )  # fmt: skip
    said = run(*words, "-o", tmp_path / "b.rom.h5", ranks=ranks)
    assert "shortens its shank" in said.out and "resists" not in said.out + said.err


def test_few_moments_of_a_stress(tmp_path: Path) -> None:
    write_body(tmp_path / "b.h5", bar(), **PLAIN, **HELD)
    reduce(tmp_path / "b.h5", (0, 500), 1e-2).save(tmp_path / "b.rom.h5")
    words = ("simulate", tmp_path / "b.rom.h5", "--force", "end.fy=-100", "--stress")
    said = run(*words, "--time", "0,0.1,11", "-o", tmp_path / "y.csv").out
    assert "the times are 10 ms apart, so the history holds nothing above 50 Hz" in said
    assert "displacement [m]: .fx, .fy, .fz\n    rotation [rad]: .mx, .my, .mz" in said
    said = run(*words, "--time", "0,0.1,5", "-o", tmp_path / "y.csv").out
    assert "moments are up to 25 ms apart" in said and "--time FIRST,LAST,COUNT" in said
    said = run(*words, "--time", "0,0.1,2001", "-o", tmp_path / "y.csv").out
    assert "ms apart" not in said
    (tmp_path / "l.csv").write_text("t,end.fy\n0,0\n0.1,1\n")
    words = (
        "simulate",
        tmp_path / "b.rom.h5",
        "--loads",
        tmp_path / "l.csv",
        "-o",
        tmp_path / "y.csv",
    )
    said = run(*words, "--time", "0,1,2", expect=1).err
    assert "--time and --loads exclude each other" in said
    words = ("simulate", tmp_path / "b.rom.h5", "--force", "end.Fy=1", "-o", tmp_path / "y.csv")
    assert "did you mean end.fy?" in run(*words, expect=1).err


def test_a_body_without_mass_is_doubted(tmp_path: Path) -> None:
    content = {
        "materials": {"m": {"E": 2e11, "nu": 0.3, "rho": 0.0}},
        "regions": {"all": {"material": "m"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
    }
    counts = import_description(content, "b", tmp_path / "b.h5", mesh=bar())
    assert any("no mass at all" in words for words in counts["warnings"])
    content["masses"] = {"m": {"nodes": "start", "mass": 1.0}}
    counts = import_description(content, "b", tmp_path / "b.h5", mesh=bar())
    assert not any("no mass at all" in words for words in counts["warnings"])


def test_shells_in_another_unit_are_doubted(tmp_path: Path) -> None:
    """A thickness in metres in a mesh of millimetres: its mass may hide it."""
    from sheets import flat, sheet

    mesh = sheet("quad", (6, 4), flat(300.0, 200.0))
    for thickness, doubted in ((2.0, False), (0.002, True)):
        counts = import_description(
            {
                "units": "mm-t-s",
                "materials": {"m": {"E": 70000, "nu": 0.3, "rho": 2.7e-9}},
                "sections": {"s": {"shape": "shell", "thickness": thickness}},
                "regions": {"all": {"material": "m", "section": "s"}},
                "interfaces": {"end": {"coupling": "rigid", "nodes": "start"}},
            },
            "b", tmp_path / "b.h5", mesh=mesh,
        )  # fmt: skip
        assert f"shells of section s: {thickness:g} mm thick, 24 elements" in counts["summary"]
        assert any("in the units of the mesh?" in w for w in counts["warnings"]) == doubted


def test_a_node_of_a_rigid_interface_is_refused(tmp_path: Path) -> None:
    node = int(bar().point_sets["end"][0]) + 1
    tip = {"end": {"coupling": "rigid", "nodes": "end"}, "p": {"coupling": "node", "nodes": [node]}}
    with pytest.raises(BodyError, match=f"node {node} is one of the rigid interface end"):
        write_body(tmp_path / "b.h5", bar(), **PLAIN, interfaces=tip)


def test_slow_loads_that_statics_answer(tmp_path: Path) -> None:
    """The advice went on when it was followed."""
    write_body(tmp_path / "b.h5", bar(), **PLAIN)
    u = np.zeros((400, 6))
    u[:, 1] = 1 + np.sin(np.linspace(0, 300, 400))
    for statics, said in ((False, "takes --statics yes"), (True, "answer it, without a claim")):
        rom = reduce(tmp_path / "b.h5", (10, 500), 1e-2, statics=statics)
        rom.save(tmp_path / "r.h5")
        rom = ReducedModel.load(tmp_path / "r.h5")
        words = judge(rom, np.linspace(0, 1, 400), u).words_of_outside
        assert any(said in each for each in words)


@pytest.mark.parametrize("sheet", [False, True])
def test_parts_in_no_region_are_told(sheet: bool, tmp_path: Path) -> None:
    """Half of a bar, and ribs on a plate, were left out without a word."""
    if sheet:
        n = 5  # a plate of quads in x and y, a rib on its middle line
        x = np.linspace(0, 1, n)
        plate = np.array([[a, b, 0.0] for b in x for a in x])
        rib = np.array([[a, 0.5, 0.2] for a in x])
        quads = [[n * j + i, n * j + i + 1, n * j + n + i + 1, n * j + n + i]
                 for j in range(n - 1) for i in range(n - 1)]  # fmt: skip
        foot = [10 + i for i in range(n)]
        ribs = [[foot[i], foot[i + 1], n * n + i + 1, n * n + i] for i in range(n - 1)]
        kind, cells, some = "quad", np.array(quads + ribs), len(quads)
        points, start = np.vstack([plate, rib]), np.arange(0, n * n, n)
        section = {"section": "s"}
        what, area = "4 elements (quad of part rest)", 1.0
    else:
        mesh = bar()
        kind, cells = "tetra10", mesh.cells[0].data
        cells = cells[np.argsort(mesh.points[cells].mean(axis=1)[:, 0])]
        some, points, start = len(cells) // 2, mesh.points, mesh.point_sets["start"]
        section = {}
        what, area = f"{len(cells) - some} elements (tetra10 of part rest)", 0.0
    chosen = np.arange(len(cells))
    mesh = meshio.Mesh(
        points, [(kind, cells)], point_sets={"start": start},
        cell_sets={"part": [chosen[:some]], "rest": [chosen[some:]]},
    )  # fmt: skip
    content: dict[str, Any] = {
        "materials": {"m": {"E": 2e11, "nu": 0.3, "rho": 7850.0}},
        "sections": {"s": {"shape": "shell", "thickness": 0.01}},
        "regions": {"part": {"material": "m", **section}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "start"}},
    }
    counts = import_description(content, "b", tmp_path / "b.h5", mesh=mesh)
    told = [words for words in counts["warnings"] if "in no region" in words]
    assert told == [f"{what} in no region: the body is without them"]
    if sheet:
        assert any(f"mass {area * 78.5:.6g} kg" in line for line in counts["summary"])
    content["regions"]["rest"] = {"material": "m", **section}
    counts = import_description(content, "b", tmp_path / "b.h5", mesh=mesh)
    assert not any("in no region" in words for words in counts["warnings"])


def test_faces_in_no_region_are_only_faces(tmp_path: Path) -> None:
    """Surfaces that name interfaces of solids, and edges of shells, belong to no region."""
    mesh = bar()
    faces = np.array([[a, b, c] for a, b, c in mesh.cells[0].data[:4, :3]])
    mesh = meshio.Mesh(mesh.points, [*mesh.cells, ("triangle", faces)], point_sets=mesh.point_sets)
    counts = write_body(tmp_path / "b.h5", mesh, **PLAIN)
    assert not any("in no region" in words for words in counts["warnings"])


@pytest.mark.parametrize("rule", ["full", "reduced"])  # reduced: decks of CalculiX
def test_nodes_in_the_order_of_gmsh_are_refused(rule: str, tmp_path: Path) -> None:
    """It has the last two of a tetra10 in another order: the import told a wrong mass."""
    mesh = bar()
    mesh.cells[0].data[:, [8, 9]] = mesh.cells[0].data[:, [9, 8]]
    with pytest.raises(BodyError, match=r"is inverted or flat.*from gmsh to CalculiX|another one"):
        write_body(tmp_path / "b.h5", mesh, **PLAIN, mass_integration=rule)
    assert not (tmp_path / "b.h5").exists()


def test_a_sweep_beside_another_body(tmp_path: Path) -> None:
    write_body(tmp_path / "free.h5", bar(), **PLAIN)
    write_body(tmp_path / "held.h5", bar(), **PLAIN, **HELD)
    reduce(tmp_path / "held.h5", (0, 500), 1e-2).save(tmp_path / "held.rom.h5")
    words = ("sweep", tmp_path / "free.h5", tmp_path / "held.rom.h5", "--sweep", "10,50,3")
    said = run(*words, "-o", tmp_path / "s.h5", ranks=2)
    assert (said.out + said.err).count("is it that body?") == 1
    words = ("sweep", tmp_path / "held.h5", tmp_path / "held.rom.h5", "--sweep", "10,50,3")
    said = run(*words, "-o", tmp_path / "s.h5", ranks=2)
    assert "is it that body?" not in said.out + said.err


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_sweep_tells_the_error_of_each_kind(ranks: int, tmp_path: Path) -> None:
    """The claim is of the worst kind, which that of all of H does not check."""
    write_body(tmp_path / "b.h5", bar(), **PLAIN, **HELD)
    rom = reduce(tmp_path / "b.h5", (0, 3000), 1e-2)
    rom.save(tmp_path / "b.rom.h5")
    words = ("sweep", tmp_path / "b.h5", tmp_path / "b.rom.h5", "--sweep", "0,3000,31")
    said = run(*words, "-o", tmp_path / "s.h5", ranks=ranks).out
    with h5py.File(tmp_path / "s.h5") as file:
        H, H_r = (file[name][:].view(complex)[..., 0] for name in ("H", "H_rom"))
    of = {"displacement from force": "f", "rotation from moment": "m"}
    assert list(of) == rom.claim.kinds
    for kind, claim in zip(rom.claim.kinds, rom.claim.by_kind, strict=True):
        k = [i for i, name in enumerate(rom.inputs) if name.split(".")[1][0] == of[kind]]
        off, size = (np.linalg.norm(x[:, k][:, :, k], axis=(1, 2)) for x in (H - H_r, H))
        told = float(re.search(rf"{kind} (\S+) at", said)[1])  # type: ignore[index]
        assert told == pytest.approx((off / size).max(), rel=0.01) and told <= claim


def test_faces_of_gmsh_name_nodes(tmp_path: Path) -> None:
    """gmsh writes surfaces as element sets of plane elements, unless it is told otherwise."""
    from test_assemble_deck import deck

    path = deck(tmp_path / "bar.inp", "C3D10")
    text = path.read_text()
    skin = (
        "*ELEMENT, TYPE=CPS6, ELSET=SURFACE1\n90001, 1, 2, 3, 4, 5, 6\n90002, 3, 2, 7, 5, 8, 9\n"
        "*ELSET, ELSET=BORE\n90001, 90002\n"
    )
    path.write_text(text.replace("*MATERIAL", f"{skin}*MATERIAL", 1))
    facts = assemble_deck(path, tmp_path / "bar.h5", [parse("rigid", "bore=NSET:BORE")])
    assert facts["interfaces"]["bore"]["nodes"] == 9
    broken = skin.replace("3, 4, 5, 6", "3,\n 4, 5, 6")  # a line that goes on
    path.write_text(text.replace("*MATERIAL", f"{broken}*MATERIAL", 1))
    facts = assemble_deck(path, tmp_path / "bar.h5", [parse("rigid", "bore=NSET:BORE")])
    assert facts["interfaces"]["bore"]["nodes"] == 9
    same = skin.replace("90001", "1")  # a solid has this number
    path.write_text(text.replace("*MATERIAL", f"{same}*MATERIAL", 1))
    with pytest.raises(BodyError, match="defines element 1 a second time"):
        assemble_deck(path, tmp_path / "bar.h5", [parse("rigid", "bore=NSET:BORE")])


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("SURF:end", "SURF is unknown: NSET:end for a set"),
        ("NSET:endd", "there is no node set endd, did you mean end?"),
        ("end", "a node set is named with NSET:end"),
        ("17", "node 17 is named with NODES:17"),
    ],
)
def test_selectors(where: str, expected: str, tmp_path: Path) -> None:
    mesh = bar()
    mesh.cell_data["gmsh:physical"] = [np.ones(len(mesh.cells[0].data), dtype=int)]
    meshio.write(tmp_path / "bar.inp", mesh)
    words = ("import", tmp_path / "bar.inp", "--material", "steel", "--rigid", f"eye={where}")
    said = run(*words, "-o", tmp_path / "bar.h5", expect=1)
    assert expected in said.err


def test_supports(tmp_path: Path) -> None:
    """They are told and seen, and share no node with a rigid interface."""
    counts = write_body(tmp_path / "b.h5", bar(), **PLAIN, **HELD)
    assert "support foot: 9 nodes held in x, y, z" in counts["summary"]
    marked = Scene.of(Geometry.load(tmp_path / "b.h5")).marked()
    assert list(marked) == ["end", "support foot"]
    rigid = {"foot": {"coupling": "rigid", "nodes": "start"}}
    with pytest.raises(BodyError, match="interface foot and support foot share 9 nodes"):
        write_body(tmp_path / "b.h5", bar(), **PLAIN, **HELD, interfaces=rigid)


def test_interfaces_are_named_whole(tmp_path: Path) -> None:
    write_body(tmp_path / "b.h5", bar(), **PLAIN)
    words = ("reduce", tmp_path / "b.h5", "--band", "10,500", "--inputs", "endd")
    assert "did you mean end?" in run(*words, "-o", tmp_path / "b.rom.h5", expect=1).err


def test_metres_taken_for_millimetres() -> None:
    speed, density = (210000 / 7.85e-9) ** 0.5, 7.85e-9
    assert doubt("mm-t-s", speed, density, 150.0) is None
    assert "is its mesh in metres?" in (doubt("mm-t-s", speed, density, 0.15) or "")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--rigid", "eye=NSET:end", "--measure", "n=strss:AT:0,0,0"], "did you mean stress?"),
        (["--rigid", "eye=NSET:end", "--load", "gas=pressure"], "gas=pressure:NSET:SET"),
        ([], "--rigid NAME=NSET:SET"),
    ],
)
def test_options_of_the_import(words: list[str], expected: str, tmp_path: Path) -> None:
    meshio.write(tmp_path / "bar.inp", bar())
    mesh = (tmp_path / "bar.inp", "--material", "steel")
    assert expected in run("import", *mesh, *words, "-o", tmp_path / "b.h5", expect=1).err
    own = ("import", *mesh[:1], "--material", "E=2e11,nu=0.3", "--units", "mm-t-s")
    said = run(*own, "--rigid", "eye=NSET:end", "-o", tmp_path / "b.h5", expect=1).err
    assert "rho is missing" in said and "rho=7.85e-09" in said
    said = run("import", *mesh, "--assemble", "-o", tmp_path / "b.h5", expect=1).err
    assert "--assemble is of decks, which name their materials, and --material of meshes" in said


def test_results_are_kept_and_told_apart(tmp_path: Path) -> None:
    """A reduced file is no place for a body, no body, and no sweep; nor has it another format."""
    write_body(tmp_path / "b.h5", bar(), **PLAIN)
    rom = tmp_path / "b.rom.h5"
    reduce(tmp_path / "b.h5", (10, 500), 1e-2).save(rom)
    meshio.write(tmp_path / "bar.inp", bar())
    words = ("import", tmp_path / "bar.inp", "--material", "steel", "--rigid", "eye=NSET:end")
    assert "is a reduced file" in run(*words, "-o", rom, expect=1).err
    assert "reduce its body once more" in run("reduce", rom, "-o", tmp_path / "x.h5", expect=1).err
    said = run("report", rom, "--sweep", rom, "-o", tmp_path / "r.html", expect=1).err
    assert "not a sweep file" in said
    said = run("export", rom, "--to", "MNF", "-o", tmp_path / "b.mnf", expect=None).err
    assert "closed files" in said
    said = run("export", rom, "--to", "FMU", "-o", tmp_path / "b.fmu").out
    assert "small motions and small rotations" in said and "(certified)" in said


def test_a_preload_needs_supports(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match="a preload needs supports: 6 of 6 rigid motions are free"):
        write_body(tmp_path / "b.h5", bar(), **PLAIN, preload={"end.fx": 1.0})


@pytest.mark.parametrize("coupling", ["rigid", "distributing"])
def test_one_node_carries_no_moment(coupling: str, tmp_path: Path) -> None:
    few = {"tip": {"coupling": coupling, "nodes": {"at": [0.2, 0, 0]}}}
    with pytest.raises(BodyError, match="interface tip has 1 node in a line or a point"):
        write_body(tmp_path / "b.h5", bar(), **PLAIN, interfaces=few)


def test_several_nodes_are_no_node(tmp_path: Path) -> None:
    some = {"tip": {"coupling": "node", "nodes": "end"}}
    with pytest.raises(BodyError, match="coupling node is of one node, and it has 9"):
        write_body(tmp_path / "b.h5", bar(), **PLAIN, interfaces=some)


def test_a_distributing_interface_joins_no_parts(tmp_path: Path) -> None:
    mesh = two_bars()
    mesh.point_sets["both"] = np.flatnonzero(mesh.points[:, 0] > 0.2 - 1e-9)
    both = {"both": {"coupling": "distributing", "nodes": "both"}}
    counts = write_body(tmp_path / "b.h5", mesh, **PLAIN, interfaces=both)
    assert any("2 parts that nothing joins" in words for words in counts["warnings"])


def test_hot_spots_at_a_frequency(tmp_path: Path) -> None:
    """Outside the band it is told; under a constant load dampers hold nothing."""
    dampers = {"springs": {"s": {"nodes": "start", "damping": [100.0, 100.0, 100.0]}}}
    write_body(tmp_path / "b.h5", bar(), **PLAIN, **dampers)
    rom = tmp_path / "b.rom.h5"
    reduce(tmp_path / "b.h5", (10, 500), order=20).save(rom)
    assert "nothing holds the body" in run("hotspots", rom, "--hz", "0", expect=1).err
    assert "must be a frequency" in run("hotspots", rom, "--hz", "inf", expect=1).err
    said = run("hotspots", rom, "--count", "1").out
    assert "5 loads have no place here; --count shows more places" in said
    said = run("hotspots", rom, "--hz", "50000", "--count", "1").out
    assert "reduced for 10 to 500 Hz; at 50000 Hz nothing is claimed" in said


def test_a_tolerance_that_doubles_do_not_hold(tmp_path: Path) -> None:
    """It took two minutes of one user before that was said."""
    write_body(tmp_path / "b.h5", bar(), **PLAIN, **HELD)
    words = ("reduce", tmp_path / "b.h5", "--band", "10,500", "-o", tmp_path / "r.h5", "--tol")
    said = run(*words, "1e-12", expect=None)
    assert "near the rounding of doubles" in said.out + said.err
    said = run(*words, "1e-8")
    assert "rounding of doubles" not in said.out + said.err
    with pytest.warns(ReductionWarning, match="near the rounding of doubles"):
        reduce(tmp_path / "b.h5", (10, 500), 1e-12)


def test_a_deck_from_python(tmp_path: Path) -> None:
    """As by the command line; what belongs to another kind of deck is refused."""
    from test_assemble_deck import deck

    path = deck(tmp_path / "bar.inp", "C3D10")
    ends = {"end": "rigid NSET:END"}
    flexgram.import_deck(path, tmp_path / "a.h5", ends, zeta="2%,10,1000")
    with h5py.File(tmp_path / "a.h5") as a:
        omega = 2 * np.pi * np.array([10, 1000])
        ratio = a.attrs["alpha"] / (2 * omega) + a.attrs["beta"] * omega / 2
        np.testing.assert_allclose(ratio, 0.02, rtol=1e-12)
    with pytest.raises(BodyError, match="zeta gives alpha and beta"):
        flexgram.import_deck(path, tmp_path / "a.h5", ends, zeta="2%,10,1000", alpha=3.0)
    counts = flexgram.import_deck(path, tmp_path / "a.h5", ends, alpha=3.0)
    words = ("import", path, "--assemble", "--rigid", "end=NSET:END", "--alpha", "3")
    run(*words, "-o", tmp_path / "b.h5")
    with h5py.File(tmp_path / "a.h5") as a, h5py.File(tmp_path / "b.h5") as b:
        assert np.array_equal(a["mesh/points"][:], b["mesh/points"][:])
        assert a.attrs["alpha"] == b.attrs["alpha"] == 3.0
    assert counts["interfaces"]["end"]["coupling"] == "rigid" and "remarks" in counts
    with pytest.raises(BodyError, match="ignore is for bulk data"):
        flexgram.import_deck(path, tmp_path / "a.h5", {"end": "rigid NSET:END"}, ignore=["PLOTEL"])
    with pytest.raises(BodyError, match="step and abaqus are for decks"):
        flexgram.import_deck("a.bdf", tmp_path / "a.h5", {"end": "rigid NODES:1"}, step=1)


def test_what_a_killed_import_left_is_replaced(tmp_path: Path) -> None:
    write_body(tmp_path / "b.h5", bar(), **PLAIN)
    whole = (tmp_path / "b.h5").read_bytes()
    (tmp_path / "b.h5").write_bytes(whole[: len(whole) // 2])
    meshio.write(tmp_path / "bar.inp", bar())
    words = ("import", tmp_path / "bar.inp", "--material", "steel", "--rigid", "eye=NSET:end")
    run(*words, "-o", tmp_path / "b.h5")
    assert h5py.is_hdf5(tmp_path / "b.h5")


def test_places_are_in_the_units_of_the_files(tmp_path: Path) -> None:
    """Of a mesh in millimetres."""
    mesh = bar()
    mesh.points *= 1000
    steel = {"steel": {"E": 210e3, "nu": 0.3, "rho": 7.85e-9}}
    write_body(tmp_path / "b.h5", mesh, **PLAIN, **HELD, units="mm-t-s", materials=steel)
    assert length_unit(tmp_path / "b.h5") == ("mm", 1e-3)
    reduce(tmp_path / "b.h5", (0, 500), 1e-2).save(tmp_path / "b.rom.h5")
    words = ("simulate", tmp_path / "b.rom.h5", "--force", "end.fy=-100", "--stress")
    said = run(*words, "--time", "0,0.1,2001", "-o", tmp_path / "y.csv").out
    found = re.search(r"largest von Mises stress \S+ MPa at \(([^)]*)\) mm, node (\d+)", said)
    assert found
    place = mesh.points[int(found[2]) - 1]
    np.testing.assert_allclose([float(x) for x in found[1].split(",")], place, rtol=1e-3)
    if libraries():
        write_view(tmp_path / "b.h5", tmp_path / "b.html")
        page = (tmp_path / "b.html").read_text()
        assert "it measures 200, 20, 30 mm" in page and "forces act at [mm]" in page
