"""A mesh body as a whole: elements that repeat, parts that nothing joins, mass, units, names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from test_importers import STEEL, write_deck

import flexgram
from bodies import box
from conftest import body_system, message, run
from flexgram import BodyError, ReductionWarning
from flexgram.basics import check_name, shown
from flexgram.body.description import import_description
from flexgram.body.free_motions import SpringAt, free_motions
from flexgram.body.whole import mass_facts

RHO = 7850.0


def describe(**changes: Any) -> dict[str, Any]:
    return {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": RHO}},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {
            "start": {"coupling": "rigid", "nodes": "start"},
            "end": {"coupling": "rigid", "nodes": "end"},
        },
    } | changes


def repeated(kind: str) -> Any:
    """A box of which one element is there twice, the second time with its nodes rotated."""
    mesh = box(kind, (4, 2, 2))
    cells = mesh.cells[0].data
    turned = np.roll(cells[2][:3], 1) if kind == "tetra" else cells[2][:3]
    again = np.concatenate([turned, cells[2][3:]])
    return meshio.Mesh(mesh.points, [(kind, np.vstack([cells, again]))], point_sets=mesh.point_sets)


@pytest.mark.parametrize("kind", ["tetra", "hexahedron", "tetra10"])
def test_a_repeated_element_is_refused_by_number(kind: str, tmp_path: Path) -> None:
    mesh = repeated(kind)
    last = len(mesh.cells[0].data)
    with pytest.raises(BodyError, match=f"elements 3 and {last} have the same nodes"):
        import_description(describe(), "box", tmp_path / "b.h5", mesh=mesh)
    assert not (tmp_path / "b.h5").exists()
    for name, keep in (("once", False), ("twice", True)):
        some = mesh if keep else box(kind, (4, 2, 2))
        content = describe(**({"repeated_elements": "keep"} if keep else {}))
        import_description(content, "box", tmp_path / f"{name}.h5", mesh=some)
    with h5py.File(tmp_path / "once.h5") as once, h5py.File(tmp_path / "twice.h5") as twice:
        assert mass_facts(twice).mass > 1.01 * mass_facts(once).mass


def test_a_field_of_the_mesh_is_no_number_of_its_elements(tmp_path: Path) -> None:
    """Only numbers that an importer has set count: a mesh may hold a field of any name."""
    mesh = box("hexahedron", (4, 2, 2))
    mesh.cell_data = {"label": [np.full(len(mesh.cells[0].data), 0.5)]}
    import_description(describe(), "box", tmp_path / "b.h5", mesh=mesh)
    with h5py.File(tmp_path / "b.h5") as file:
        assert file["mesh/blocks/0000/ids"][:].tolist() == list(
            range(1, len(mesh.cells[0].data) + 1)
        )


def test_an_element_of_two_groups_of_an_old_format(tmp_path: Path) -> None:
    """gmsh writes it twice in MSH 2.2; the message says so."""
    mesh = repeated("tetra10")
    meshio.write(tmp_path / "part.vtu", mesh)
    failed = run(
        *("import", tmp_path / "part.vtu", "--material", "steel", "-o", tmp_path / "b.h5"),
        *("--rigid", "p=BOX:-1,-1,-1,0.001,1,1"),
        expect=1,
    )
    assert "MSH 4.1" in message(failed) and "--keep-repeated" in message(failed)
    kept = ("import", tmp_path / "part.vtu", "--material", "steel", "--keep-repeated")
    done = run(*kept, "-o", tmp_path / "b.h5", "--rigid", "p=BOX:-1,-1,-1,0.001,1,1")
    assert "6 of 6 rigid motions are free" in done.out


def two_halves(gap: float) -> Any:
    """Two boxes one behind the other, which share no node."""
    first, second = (
        box("hexahedron", (4, 2, 2), distort=False),
        box("hexahedron", (4, 2, 2), distort=False),
    )
    length = np.ptp(first.points[:, 0])
    count = len(first.points)
    points = np.vstack([first.points, second.points + np.array([length + gap, 0, 0])])
    cells = np.vstack([first.cells[0].data, second.cells[0].data + count])
    sets = {"start": first.point_sets["start"], "end": second.point_sets["end"] + count}
    return meshio.Mesh(points, [("hexahedron", cells)], point_sets=sets)


@pytest.mark.parametrize("ranks", [1, 2])
def test_halves_that_share_no_node(ranks: int, tmp_path: Path) -> None:
    """Named with the nodes that lie in one place, and merged on request: then the body is that of
    a box in one piece."""
    with pytest.warns(ReductionWarning) as told:
        import_description(describe(), "box", tmp_path / "two.h5", mesh=two_halves(0.0))
    words = " ".join(str(w.message) for w in told)
    assert "2 parts that nothing joins" in words and "lie in the same place" in words
    assert "end on part 2; start on part 1" in words
    merged = describe(merge=1e-9)
    import_description(merged, "box", tmp_path / "one.h5", mesh=two_halves(0.0))
    single = box("hexahedron", (8, 2, 2), distort=False)
    length = np.ptp(box("hexahedron", (4, 2, 2), distort=False).points[:, 0])
    single.points = single.points * [2 * length / np.ptp(single.points[:, 0]), 1, 1]
    import_description(describe(), "box", tmp_path / "single.h5", mesh=single)
    H = []
    for name in ("one", "single"):
        run(
            "assemble",
            "-body",
            tmp_path / f"{name}.h5",
            "-body_out",
            tmp_path / f"{name}.m.h5",
            ranks=ranks,
        )
        H.append(body_system(tmp_path / f"{name}.m.h5").transfer(2 * np.pi * 300.0))
    assert np.abs(H[0] - H[1]).max() < 1e-9 * np.abs(H[1]).max()
    with pytest.raises(BodyError, match="larger than a hexahedron"):
        import_description(describe(merge=1.0), "box", tmp_path / "b.h5", mesh=two_halves(0.0))


@pytest.mark.parametrize("ranks", [1, 2])
def test_elements_that_are_too_thin(ranks: int, tmp_path: Path) -> None:
    """What bends them is smaller than the rounding of what stretches them: told, then refused."""
    for thickness, expect in ((1e-6, None), (1e-8, 1)):
        mesh = box("hexahedron", (4, 2, 1), (0.4, 0.2, thickness), distort=False)
        import_description(describe(), "thin", tmp_path / "thin.h5", mesh=mesh)
        out = ("-body_out", tmp_path / "thin.m.h5")
        done = run("assemble", "-body", tmp_path / "thin.h5", *out, ranks=ranks, expect=expect)
        assert "times wider than thick" in done.out + done.err
        assert expect is None or "are all coordinates in one unit?" in message(done)


def test_a_gap_and_a_part_that_nothing_holds(tmp_path: Path) -> None:
    mesh = two_halves(1e-3)
    content = describe(interfaces={"start": {"coupling": "rigid", "nodes": "start"}})
    with pytest.warns(ReductionWarning) as told:
        import_description(content, "box", tmp_path / "two.h5", mesh=mesh)
    words = " ".join(str(w.message) for w in told)
    assert "0.001 apart" in words and "neither an interface nor a support" in words


def test_mass_as_the_program_has_it(tmp_path: Path) -> None:
    """Mass, centre and inertia of distorted quadratic elements and of beams: those of the frame."""
    for kind in ("hexahedron20", "tetra10", "wedge15"):
        body = tmp_path / f"{kind}.h5"
        facts = import_description(describe(), "box", body, mesh=box(kind, (4, 2, 2)))
        rom = tmp_path / "rom.h5"
        run("reduce", "-body", body, "-mor_band_hz", "100,3000", "-mor_tol", 1e-2, "-mor_out", rom)
        with h5py.File(rom) as file, h5py.File(body) as mesh:
            ours = mass_facts(mesh)
            M_r, centre = file["frame/M_r"][:], file["frame/centre"][:]
        mass, J = M_r[0, 0], M_r[3:, 3:]
        assert ours.mass == pytest.approx(mass, rel=1e-12)
        assert np.allclose(ours.centre, centre, rtol=0, atol=1e-12)
        about = J - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        assert np.allclose(ours.inertia, about, rtol=0, atol=1e-9 * np.abs(about).max())
        assert facts["summary"][0].startswith(f"mass {mass:.6g} kg")
        assert "6 of 6 rigid motions are free" in facts["summary"]
        said = run("info", body).out
        assert f"mass {mass:.6g} kg" in said and "material steel: E = 2.1e+11 Pa" in said


def test_free_motions_of_supports() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    node = lambda *n: np.array(n)  # noqa: E731
    assert free_motions(points, []) == 6
    assert free_motions(points, [(node(0), [0, 1, 2])]) == 3
    assert free_motions(points, [(node(0, 1), [0, 1, 2])]) == 1
    assert free_motions(points, [(node(0, 1, 2), [0, 1, 2])]) == 0
    assert free_motions(points, [(node(0), [0, 1, 2, 3, 4, 5])]) == 0


def test_free_motions_of_nodes_that_no_element_has() -> None:
    """A held one holds the body by its spring alone; a chain of springs holds nothing."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0.5], [2, 0, 0]])
    at = [(np.array([k]), points[k : k + 1]) for k in range(5)]
    held, alone = [(np.array([3]), [0, 1, 2, 3, 4, 5])], [np.array([3])]
    assert free_motions(points, held, alone=alone) == 6
    pull = SpringAt(np.diag([1.0, 1, 1, 0, 0, 0]), [at[3], at[0]])
    assert free_motions(points, held, [pull], alone=alone) == 3
    turn = [(np.array([3]), [3, 4, 5])]
    assert free_motions(points, turn, [SpringAt(np.eye(6), [at[3], at[0]])], alone=alone) == 3
    chain = [SpringAt(np.eye(6), [at[3], at[4]]), SpringAt(np.eye(6), [at[4]])]
    assert free_motions(points, [], chain, alone=[np.array([3]), np.array([4])]) == 6
    chain.append(SpringAt(np.eye(6), [at[0], at[3]]))
    assert free_motions(points, [], chain, alone=[np.array([3]), np.array([4])]) == 0
    rigid = [SpringAt(np.eye(6), [at[0], at[3]]), SpringAt(np.eye(6), [at[4]])]
    assert free_motions(points, [], rigid, alone=[np.array([3, 4])]) == 0
    assert free_motions(points, [], rigid, alone=[np.array([3]), np.array([4])]) == 6


def test_steel_in_pascals_beside_millimetres(tmp_path: Path) -> None:
    mesh = box("hexahedron", (4, 2, 2))
    mesh.points = 1000 * mesh.points
    with pytest.warns(ReductionWarning, match="the speed of sound"):
        import_description(describe(units="mm-t-s"), "box", tmp_path / "b.h5", mesh=mesh)
    right = {"steel": {"E": 210e3, "nu": 0.3, "rho": 7.85e-9}}
    facts = import_description(
        describe(units="mm-t-s", materials=right), "box", tmp_path / "b.h5", mesh=mesh
    )
    assert facts["warnings"] == []


def test_overlapping_sections_of_a_deck(tmp_path: Path) -> None:
    """The last *SOLID SECTION of an element counts, as in ccx, and the mass is counted once."""
    plain = write_deck(tmp_path / "plain.inp", "C3D10")
    text = plain.read_text()
    again = "*ELSET, ELSET=SOME\n1, 2, 3\n*SOLID SECTION, ELSET=SOME, MATERIAL=STEEL\n"
    (tmp_path / "twice.inp").write_text(text + again)
    lines = []
    for name in ("plain", "twice"):
        done = run(
            *("import", tmp_path / f"{name}.inp", "--assemble", "-o", tmp_path / f"{name}.h5"),
            *("--rigid", "end=NSET:END"),
        )
        lines.append(next(line for line in done.out.splitlines() if "mass" in line))
    assert lines[0] == lines[1]
    assert "3 elements are in several sections" in done.out
    (tmp_path / "redefined.inp").write_text(
        text.replace(
            STEEL,
            "*ELEMENT, TYPE=C3D10, ELSET=EALL\n1, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19\n" + STEEL,
        )
    )
    failed = run(
        *("import", tmp_path / "redefined.inp", "--assemble", "-o", tmp_path / "b.h5"),
        *("--rigid", "end=NSET:END"),
        expect=1,
    )
    assert "defines element 1 a second time" in message(failed)


def test_two_interfaces_on_one_set(tmp_path: Path) -> None:
    both = {name: {"coupling": "rigid", "nodes": "end"} for name in ("a", "b")}
    with pytest.raises(BodyError, match="a and b are on the same nodes"):
        import_description(
            describe(interfaces=both), "box", tmp_path / "b.h5", mesh=box("hexahedron", (4, 2, 2))
        )


@pytest.mark.parametrize(
    "name", ["", " ", "a\0b", "a\x1b[31m", "a\x07", "a\ud800", "a,b", "a/b", "\u202eab", "\ufffe"]
)
def test_names_that_are_none(name: str, tmp_path: Path) -> None:
    """One rule, in memory, in files and in YAML; foreign files that hold one are escaped."""
    with pytest.raises(BodyError, match="is no name"):
        check_name("x", name)
    K = np.diag([2.0, 3.0])
    body = flexgram.Matrices(K=_sparse(K), M=_sparse(np.eye(2)), B=np.eye(2), inputs=["u", name])
    with pytest.raises(BodyError, match="is no name"):
        flexgram.reduce(body, (0.01, 0.1), 1e-2)
    with pytest.raises(BodyError, match="is no name"):
        flexgram.write_matrices(
            tmp_path / "b.h5", _sparse(K), _sparse(np.eye(2)), np.eye(2), inputs=["u", name]
        )
    assert "\x1b" not in shown(name) and "\0" not in shown(name)


def test_a_foreign_file_with_control_characters(tmp_path: Path) -> None:
    path = tmp_path / "b.h5"
    flexgram.write_matrices(
        path, _sparse(np.diag([2.0, 3.0])), _sparse(np.eye(2)), np.eye(2), inputs=["u", "v"]
    )
    with h5py.File(path, "r+") as file:
        del file["B"].attrs["names"]
        file["B"].attrs["names"] = ["u", "v\x1b]0;title\x07"]
    assert "\x1b" not in run("info", path).out
    failed = run(
        "reduce", "-body", path, "-mor_band_hz", "0.01,0.1", "-mor_out", tmp_path / "r.h5", expect=1
    )
    assert "control characters" in message(failed)


def _sparse(a: Any) -> Any:
    import scipy.sparse as sp

    return sp.csr_matrix(a)


def test_gravity_and_materials_in_other_units_than_the_mesh(tmp_path: Path) -> None:
    """9.81 of a millimetre, and E and rho of SI with a mesh in millimetres."""
    mesh = box("hexahedron", (4, 2, 2), (200.0, 40.0, 30.0), distort=False)
    meshio.write(tmp_path / "part.vtu", mesh)
    words = ["import", tmp_path / "part.vtu", "--units", "mm-t-s", "-o", tmp_path / "b.h5"]
    words += ["--rigid", "p=BOX:-1,-100,-100,0.001,100,100", "--load"]
    done = run(*words, "weight=acceleration:0,0,-9.81", "--material", "steel")
    said = done.out + done.err
    assert "load weight: 9.81 is in units of the mesh, where gravity is 9810" in said
    done = run(*words, "weight=acceleration:0,0,-9810", "--material", "E=210e9,nu=0.3,rho=7850")
    said = done.out + done.err
    assert "gravity is" not in said
    assert "Or E and rho alone in SI?" in said and "E=210000, rho=7.85e-09" in said
