"""Assembly from a mesh: ranks, couplings, supports, beams, quality, against SciPy algebra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from bodies import box, write_body_file
from conftest import assembled, message, run, sweep_transfer
from flexgram import BodyError, import_body
from flexgram.importers import FeMatrices, Interface, import_matrices

ENDS = {
    "start": {"set": "start", "coupling": "rigid"},
    "end": {"set": "end", "coupling": "distributing"},
}


def by_node(body: dict[str, Any]) -> dict[str, Any]:
    """The same matrices with rows sorted by node and component: the partition renumbers."""
    order = np.lexsort((body["component"], body["node"]))
    sorted_ = {key: body[key].tocsr()[order][:, order] for key in ("K", "M")}
    return {**{k: body[k][order] for k in ("B", "node", "component", "position")}, **sorted_}


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron", "wedge15"])
def test_ranks_do_not_change_the_matrices(kind: str, tmp_path: Path) -> None:
    write_body_file(tmp_path / "body.h5", box(kind), interfaces=ENDS)
    one = by_node(assembled(tmp_path / "1.h5", tmp_path / "body.h5", 1))
    for ranks in (2, 3):
        many = by_node(assembled(tmp_path / "n.h5", tmp_path / "body.h5", ranks))
        assert np.array_equal(one["node"], many["node"])
        assert np.array_equal(one["position"], many["position"])
        assert np.abs(one["B"] - many["B"]).max() < 1e-15
        for key in ("K", "M"):  # sums in another order
            assert abs(one[key] - many[key]).max() < 1e-14 * abs(one[key]).max()


def test_couplings_mean_the_same_on_a_mesh_and_on_its_matrices(tmp_path: Path) -> None:
    """Rigid and distributing: during assembly, and by the importer on K and M of the same mesh."""
    mesh = box("tetra10")
    write_body_file(tmp_path / "mesh.h5", mesh, interfaces=ENDS)
    mesh.point_sets["corner"] = mesh.point_sets["start"][:1]
    bare = {"corner": {"set": "corner", "coupling": "node"}}
    write_body_file(tmp_path / "bare.h5", mesh, interfaces=bare)
    full = assembled(tmp_path / "full.h5", tmp_path / "bare.h5")
    fe = FeMatrices(
        "full",
        full["K"].tocsr(),
        full["M"].tocsr(),
        node=full["node"],
        component=full["component"],
        labels=np.arange(len(mesh.points)),
        points=mesh.points,
    )
    places = [
        Interface(name, data["coupling"], mesh.point_sets[name]) for name, data in ENDS.items()
    ]
    import_matrices(fe, tmp_path / "matrices.h5", places)
    H = []
    for name in ("mesh", "matrices"):
        out = tmp_path / f"{name}.sweep.h5"
        run(
            "sweep",
            "-body",
            tmp_path / f"{name}.h5",
            "-mor_sweep_hz",
            "50,4000,5",
            "-mor_sweep_out",
            out,
        )
        with h5py.File(out) as file:
            assert [str(x) for x in file["H"].attrs["inputs"]][6] == "end.fx"
        H.append(sweep_transfer(out)[1])
    assert np.abs(H[0] - H[1]).max() < 1e-8 * np.abs(H[0]).max()


def motion(d: Any) -> Any:
    """3 x 6: displacement of a point at distance d under six motions."""
    x, y, z = d
    return np.hstack([np.eye(3), np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])])


@pytest.mark.parametrize("ranks", [1, 2])
def test_couplings_are_what_they_claim(ranks: int, tmp_path: Path) -> None:
    mesh = box("hexahedron20", (4, 2, 2))
    point = [-0.01, 0.02, 0.0]
    interfaces = {**ENDS, "start": {**ENDS["start"], "position": point}}
    write_body_file(tmp_path / "body.h5", mesh, interfaces=interfaces)
    write_body_file(tmp_path / "free.h5", mesh, interfaces={"end": ENDS["end"]})
    coupled = by_node(assembled(tmp_path / "c.h5", tmp_path / "body.h5", ranks))
    free = by_node(assembled(tmp_path / "f.h5", tmp_path / "free.h5", ranks))
    # T: all dofs of the free body from those of the coupled one.
    slaves = set(mesh.point_sets["start"].tolist())
    T = np.zeros((free["K"].shape[0], coupled["K"].shape[0]))
    place = {
        (n, c): i
        for i, (n, c) in enumerate(zip(coupled["node"], coupled["component"], strict=True))
    }
    reference = len(mesh.points)
    for row, (n, c) in enumerate(zip(free["node"], free["component"], strict=True)):
        if n in slaves:
            G = motion(mesh.points[n] - point)
            for j in range(6):
                T[row, place[reference, j]] = G[c, j]
        else:
            T[row, place[n, c]] = 1
    for key in ("K", "M"):
        expected = T.T @ (free[key] @ T)
        assert np.abs(coupled[key] - expected).max() < 1e-13 * np.abs(expected).max()
    # Ports: unit loads at the reference; the distributing ones are G (GᵀG)⁻¹.
    for j in range(6):
        column = np.zeros(len(T.T))
        column[place[reference, j]] = 1
        assert np.array_equal(coupled["B"][:, j], column)
    nodes = mesh.point_sets["end"]
    center = mesh.points[nodes].mean(axis=0)
    G = np.vstack([motion(x - center) for x in mesh.points[nodes]])
    expected = G @ np.linalg.inv(G.T @ G)
    rows = [place[n, c] for n in nodes for c in range(3)]
    assert np.abs(coupled["B"][rows, 6:] - expected).max() < 1e-10 * np.abs(expected).max()
    # Statically equivalent: the six loads have unit resultant.
    assert np.allclose(G.T @ coupled["B"][rows, 6:], np.eye(6), atol=1e-9)


@pytest.mark.parametrize("ranks", [1, 2])
def test_free_bodies_have_six_rigid_modes_and_the_right_mass(ranks: int, tmp_path: Path) -> None:
    mesh = box("tetra10", distort=False)
    write_body_file(tmp_path / "body.h5", mesh, interfaces=ENDS)
    body = assembled(tmp_path / "m.h5", tmp_path / "body.h5", ranks)
    center = body["position"].mean(axis=0)
    R = np.array(
        [
            motion(x - center)[c] if c < 3 else np.eye(6)[c]
            for x, c in zip(body["position"], body["component"], strict=True)
        ]
    )
    stiffness = abs(body["K"]).max()
    assert np.abs(body["K"] @ R).max() < 1e-13 * stiffness
    volume = 0.1 * 0.02 * 0.03
    rigid = R.T @ (body["M"] @ R)
    assert np.allclose(np.diag(rigid)[:3], 7850 * volume, rtol=1e-13)
    offset = center - np.array([0.05, 0.01, 0.015])
    inertia = 7850 * volume * ((0.02**2 + 0.03**2) / 12 + offset[1] ** 2 + offset[2] ** 2)
    assert rigid[3, 3] == pytest.approx(inertia, rel=1e-12)
    squares = eigsh(body["K"], 8, body["M"], sigma=-1e6, return_eigenvectors=False)
    squares = np.sort(squares)
    assert np.abs(squares[:6]).max() < 1e-9 * squares[6]
    run_out = run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_samples",
        3,
        "-mor_out",
        tmp_path / "rom.h5",
        ranks=ranks,
    ).out
    assert "rigid modes    6" in run_out and f"mass {7850 * volume:.6g} kg" in run_out


def guided_bar(kind: str, elements: int, folder: Path, ranks: int = 1) -> tuple[Any, meshio.Mesh]:
    """A bar with only its axial motion left; exactly f = sqrt(E/rho) / 4L for nu = 0."""
    mesh = box(kind, (elements, 1, 1), (0.1, 0.02, 0.02), distort=False)
    mesh.point_sets["all"] = np.arange(len(mesh.points))
    write_body_file(
        folder / "body.h5",
        mesh,
        material={"E": 210e9, "nu": 0.0, "rho": 7850.0},
        interfaces={"tip": {"set": "end", "coupling": "distributing"}},
        supports={"start": [0], "all": [1, 2]},
    )
    return assembled(folder / "m.h5", folder / "body.h5", ranks), mesh


def excess(body: dict[str, Any]) -> float:
    """Relative error of the guided bar's first frequency."""
    square = eigh(body["K"].toarray(), body["M"].toarray(), eigvals_only=True)[0]
    return float(np.sqrt(square / (210e9 / 7850)) * (4 * 0.1) / (2 * np.pi) - 1)


def test_supports_hold_single_components(tmp_path: Path) -> None:
    body, mesh = guided_bar("hexahedron20", 40, tmp_path, ranks=2)
    assert set(body["component"].tolist()) == {0}
    assert len(body["component"]) == len(mesh.points) - len(mesh.point_sets["start"])
    assert abs(excess(body)) < 1e-8  # h^4 with 40 elements


@pytest.mark.parametrize(
    ("kind", "order"),
    [("tetra", 2), ("hexahedron", 2), ("tetra10", 4), ("hexahedron20", 4), ("wedge15", 4)],
)
def test_frequencies_converge_with_the_order_of_the_element(
    kind: str, order: int, tmp_path: Path
) -> None:
    """The error of the first frequency falls as h^2 or h^4, from above."""
    coarse, fine = (excess(guided_bar(kind, count, tmp_path)[0]) for count in (4, 8))
    assert fine > 0
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.25)


BEAM = """
mesh: beam.vtu
materials: {steel: {E: 210.0e9, nu: 0.3, rho: 7850}}
sections: {round: {shape: circle, radius: 0.01, y_axis: [0, 0, 1]}}
regions: {frame: {material: steel, section: round}}
interfaces: {tip: {coupling: node, nodes: [11]}}
supports: {root: {nodes: [1], components: [x, y, z, rx, ry, rz]}}
"""


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_cantilever_of_beams(ranks: int, tmp_path: Path) -> None:
    points = np.linspace([0, 0, 0], [0.3, 0.4, 0], 11)  # 0.5 m, askew
    cells = np.column_stack([np.arange(10), np.arange(1, 11)])
    mesh = meshio.Mesh(points, [("line", cells)], cell_sets={"frame": [np.arange(10)]})
    meshio.write(tmp_path / "beam.inp", mesh)
    (tmp_path / "beam.yaml").write_text(BEAM.replace("beam.vtu", "beam.inp"))
    import_body(tmp_path / "beam.yaml", tmp_path / "beam.h5")
    body = assembled(tmp_path / "m.h5", tmp_path / "beam.h5", ranks)
    assert body["K"].shape == (60, 60) and len(body["names"]) == 6
    C = body["B"].T @ np.linalg.solve(body["K"].toarray(), body["B"])
    L, A, inertia, E, nu = 0.5, np.pi * 1e-4, np.pi * 1e-8 / 4, 210e9, 0.3
    k = 6 * (1 + nu) / (7 + 6 * nu)
    bend = L**3 / (3 * E * inertia) + L / (k * E / (2 * (1 + nu)) * A)
    axis = np.array([0.6, 0.8, 0])
    assert axis @ C[:3, :3] @ axis == pytest.approx(L / (E * A), rel=1e-9)
    assert C[2, 2] == pytest.approx(bend, rel=1e-9)
    twist = L / (E / (2 * (1 + nu)) * 2 * inertia)
    assert axis @ C[3:, 3:] @ axis == pytest.approx(twist, rel=1e-9)
    # First bending frequencies of a slender cantilever: 1.8751²/2π sqrt(EI/ρA L⁴), in pairs.
    squares = eigh(body["K"].toarray(), body["M"].toarray(), eigvals_only=True)
    euler = 1.8751041**2 * np.sqrt(E * inertia / (7850 * A * L**4))
    assert np.allclose(np.sqrt(squares[:2]), euler, rtol=2e-3)  # shear lowers it by 1e-3


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_interface_that_is_held_in_part(ranks: int, tmp_path: Path) -> None:
    """It has no ports where it is held, and says so; held in all directions it is refused."""
    points = np.linspace([0, 0, 0], [0.3, 0.4, 0], 11)
    cells = np.column_stack([np.arange(10), np.arange(1, 11)])
    mesh = meshio.Mesh(points, [("line", cells)], cell_sets={"frame": [np.arange(10)]})
    meshio.write(tmp_path / "beam.inp", mesh)
    held = (
        BEAM.replace("beam.vtu", "beam.inp") + "  plane: {nodes: [11], components: [z, rx, ry]}\n"
    )
    held = held.replace("{root", "\n  root").replace("rx, ry, rz]}}", "rx, ry, rz]}")
    (tmp_path / "beam.yaml").write_text(held)
    import_body(tmp_path / "beam.yaml", tmp_path / "beam.h5")
    body = assembled(tmp_path / "m.h5", tmp_path / "beam.h5", ranks)
    assert body["names"] == ["tip.fx", "tip.fy", "tip.mz"]
    said = run(
        "assemble", "-body", tmp_path / "beam.h5", "-body_out", tmp_path / "m.h5", ranks=ranks
    )
    assert "tip: no port fz, mx, my" in said.out
    (tmp_path / "beam.yaml").write_text(held.replace("[z, rx, ry]", "[x, y, z, rx, ry, rz]"))
    import_body(tmp_path / "beam.yaml", tmp_path / "beam.h5")
    said = run("assemble", "-body", tmp_path / "beam.h5", "-body_out", tmp_path / "m.h5",
               ranks=ranks, expect=1)  # fmt: skip
    assert "interface tip: all its components are held" in said.err


@pytest.mark.parametrize("ranks", [1, 2])
def test_inverted_elements_are_named(ranks: int, tmp_path: Path) -> None:
    mesh = box("tetra10")
    write_body_file(tmp_path / "body.h5", mesh, interfaces=ENDS)
    with h5py.File(tmp_path / "body.h5", "r+") as file:
        nodes = file["mesh/blocks/0000/connectivity"]
        nodes[17, :2] = nodes[17, :2][::-1]
    result = run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_out",
        tmp_path / "r.h5",
        ranks=ranks,
        expect=1,
    )
    assert "element 17 (tetra10, material steel) is inverted" in message(result)
    assert not (tmp_path / "r.h5").exists()


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"material": {"E": 210e9, "nu": 0.6, "rho": 7850.0}}, "nu = 0.6"),
        ({"interfaces": {}}, "/interfaces is empty"),
        (
            {"interfaces": {"a": ENDS["start"], "b": ENDS["start"]}},
            "already follows another rigid interface",
        ),
        ({"interfaces": ENDS, "supports": {"start": [0]}}, "also held by a support"),
    ],
)
def test_impossible_descriptions(
    change: dict[str, Any], expected: str, ranks: int, tmp_path: Path
) -> None:
    write_body_file(tmp_path / "body.h5", box("tetra"), **{"interfaces": ENDS, **change})
    result = run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_out",
        tmp_path / "r.h5",
        ranks=ranks,
        expect=1,
    )
    assert expected in message(result)


def test_doubtful_units_and_thin_rigid_sets(tmp_path: Path) -> None:
    body, out = tmp_path / "body.h5", tmp_path / "r.h5"
    soft = {"E": 210e3, "nu": 0.3, "rho": 7850.0}  # E in MPa beside kg/m^3
    write_body_file(body, box("tetra"), interfaces=ENDS, material=soft)
    result = run("plan", "-body", body)
    assert "warning: material steel: the speed of sound" in result.out
    mesh = box("tetra", distort=False)
    mesh.point_sets["line"] = np.flatnonzero((mesh.points[:, 0] == 0) & (mesh.points[:, 1] == 0))
    write_body_file(body, mesh, interfaces={"edge": {"set": "line", "coupling": "rigid"}})
    result = run("reduce", "-body", body, "-mor_out", out, expect=1)
    assert "interface edge: its 3 nodes cannot carry all six loads" in message(result)


GOOD = """
mesh: box.inp
materials: {steel: {E: 210000, nu: 0.3, rho: 7.85e-9}}
units: mm-t-s
regions: {all: {material: steel}}
interfaces:
  near: {coupling: rigid, nodes: {box: [[-1, -1, -1], [1.0e-6, 99, 99]]}}
  far: {coupling: distributing, nodes: far, position: [100, 10, 15]}
"""


def millimetres(folder: Path) -> None:
    mesh = box("tetra10", distort=False)
    mesh.points *= 1000
    mesh.point_sets = {"far": mesh.point_sets["end"]}
    meshio.write(folder / "box.inp", mesh)


def test_units_are_converted(tmp_path: Path) -> None:
    millimetres(tmp_path)
    (tmp_path / "box.yaml").write_text(GOOD)
    counts = import_body(tmp_path / "box.yaml", tmp_path / "box.h5")
    assert counts["elements"] == 6 * 24
    assert list(counts["interfaces"]) == ["near", "far"]
    assert counts["interfaces"]["far"]["position"] == [0.1, 0.01, 0.015]
    assert (
        counts["interfaces"]["far"]["nodes"] == 25
        and counts["interfaces"]["far"]["distance"] < 1e-9
    )
    write_body_file(tmp_path / "si.h5", box("tetra10", distort=False), interfaces=ENDS)
    millimetre = by_node(assembled(tmp_path / "1.h5", tmp_path / "box.h5", 1))
    si = by_node(assembled(tmp_path / "2.h5", tmp_path / "si.h5", 1))
    for key in ("K", "M"):
        assert abs(millimetre[key] - si[key]).max() < 1e-12 * abs(si[key]).max()
    with h5py.File(tmp_path / "box.h5") as file:
        assert list(file["interfaces/far"].attrs["position"]) == [0.1, 0.01, 0.015]


def test_a_node_by_its_place(tmp_path: Path) -> None:
    millimetres(tmp_path)
    tip = "nodes: {at: [101, 21, 31]}"
    (tmp_path / "box.yaml").write_text(GOOD.replace("distributing, nodes: far", f"node, {tip}"))
    import_body(tmp_path / "box.yaml", tmp_path / "box.h5")
    with h5py.File(tmp_path / "box.h5") as file:
        (node,) = file["interfaces/far/nodes"][:]
        assert np.allclose(file["mesh/points"][int(node)], [0.1, 0.02, 0.03])


@pytest.mark.parametrize("zeta", ["[2%, 100, 1000]", "[0.02, 1000, 100]", "2%,100,1000"])
def test_a_damping_ratio(zeta: str, tmp_path: Path) -> None:
    millimetres(tmp_path)
    (tmp_path / "box.yaml").write_text(f"{GOOD}damping:\n  zeta: {zeta}\n")
    import_body(tmp_path / "box.yaml", tmp_path / "box.h5")
    with h5py.File(tmp_path / "box.h5") as file:
        alpha, beta = (float(file.attrs[name]) for name in ("alpha", "beta"))
    for omega in (200 * np.pi, 2000 * np.pi):
        assert alpha / (2 * omega) + beta * omega / 2 == pytest.approx(0.02)


def test_a_mesh_is_no_description(tmp_path: Path) -> None:
    millimetres(tmp_path)
    with pytest.raises(BodyError, match="not") as error:
        import_body(tmp_path / "box.inp", tmp_path / "box.h5")
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("box.inp", "nothing.inp", "no such file"),
        ("E: 210000", "E: stiff", "E = 'stiff' must be a number"),
        ("rho: 7.85e-9", "density: 1", "unknown key density"),
        ("nodes: far", "nodes: fra", "there is no node set fra"),
        ("coupling: rigid", "coupling: stiff", "one of rigid, distributing, node"),
        ("regions: {all:", "regions: {body:", "the mesh has no such part"),
        ("material: steel", "material: gold", "material = 'gold' must be one of steel"),
        ("units: mm-t-s", "units: inch", "one of SI"),
        ("mesh: box.inp", "mash: box.inp", "unknown key mash"),
        ("[1.0e-6, 99, 99]", "[-0.5, 99, 99]", "no node in the box; the body spans"),
        ("interfaces:", "interfaces: [", "not YAML"),
        ("  far:", "  near:", "the key near is given twice"),
        ("mesh: box.inp", "- 1", "not"),
        ("interfaces:", "damping: {zeta: [1, 100, 1000]}\ninterfaces:", "a ratio below 1"),
        ("interfaces:", "damping: {zeta: [1%, 5, 50], beta: 1}\ninterfaces:", "leave these out"),
    ],
)
def test_descriptions_that_cannot_be_read(
    old: str, new: str, expected: str, tmp_path: Path
) -> None:
    millimetres(tmp_path)
    (tmp_path / "box.yaml").write_text(GOOD.replace(old, new, 1))
    with pytest.raises(BodyError, match=expected):
        import_body(tmp_path / "box.yaml", tmp_path / "box.h5")
    assert not list(tmp_path.glob("box.h5*"))


LEVER = [
    "--units",
    "mm-t-s",
    "--alpha",
    "2",
    "--rigid",
    "near=BOX:-1,-1,-1,1e-6,99,99",
    "--distributing",
    "far=NSET:far@100,10,15",
]


def test_a_mesh_with_its_material_on_the_command_line(tmp_path: Path) -> None:
    """The same body as by YAML; a mesh alone says what it lacks."""
    millimetres(tmp_path)
    (tmp_path / "box.yaml").write_text(GOOD + "damping: {alpha: 2}\n")
    mesh, by_words, by_yaml = (tmp_path / name for name in ("box.inp", "words.h5", "yaml.h5"))
    import_body(tmp_path / "box.yaml", by_yaml)
    words = ["import", mesh, "--material", "E=210000,nu=0.3,rho=7.85e-9", *LEVER, "-o", by_words]
    out = run(*words).out
    assert "it measures 0.1 × 0.02 × 0.03 m" in out
    assert "near: rigid, 25 nodes, reference at (0, 0.01, 0.015) m: the middle of its faces" in out
    with h5py.File(by_words) as one, h5py.File(by_yaml) as other:
        assert one.attrs["alpha"] == other.attrs["alpha"] == 2
        for name in ("mesh/points", "interfaces/near/nodes", "interfaces/far/nodes"):
            assert np.array_equal(one[name][:], other[name][:])
        for name in ("near", "far"):
            ours, theirs = one[f"interfaces/{name}"].attrs, other[f"interfaces/{name}"].attrs
            assert ours["coupling"] == theirs["coupling"]
            assert np.array_equal(ours["position"], theirs["position"])
        steel = one["materials/material"].attrs
        assert dict(steel) == dict(other["materials/steel"].attrs)
    run("import", mesh, "--material", "steel", *LEVER, "-o", by_words)
    with h5py.File(by_words) as file:
        named = file["materials/steel"].attrs
        assert named["E"] == pytest.approx(210e9) and named["rho"] == pytest.approx(7850)

    def refused(*arguments: Any) -> str:
        return message(run("import", *arguments, "-o", tmp_path / "no.h5", expect=1))

    meshio.write(tmp_path / "box.vtu", meshio.read(mesh))
    assert "is a mesh: name what it is made of" in refused(tmp_path / "box.vtu", *LEVER)
    assert "expected one of steel" in refused(mesh, "--material", "wood", *LEVER)
    assert "no rows of matrices" in refused(mesh, "--material", "steel", "--rows", "a=1,2")
    assert "--mass is nothing for a mesh" in refused(mesh, "--material", "steel", "--mass", mesh)
    assert "a=BOX:1,2: expected 6 finite numbers" in refused(
        mesh, "--material", "steel", "--rigid", "a=BOX:1,2"
    )
    assert "there is no node set EYE" in refused(
        mesh, "--material", "steel", "--rigid", "a=NSET:EYE"
    )
    large = tmp_path / "large.inp"
    big = meshio.read(mesh)
    big.points *= 0.2
    meshio.write(large, big)
    assert (
        "in millimetres"
        in run(
            "import",
            large,
            "--material",
            "steel",
            "--rigid",
            "near=BOX:-1,-1,-1,1e-6,99,99",
            "-o",
            by_words,
        ).out
    )
