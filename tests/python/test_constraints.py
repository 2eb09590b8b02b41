"""Equations and ties of mesh bodies, against matrices of the body without them, closed forms and
CalculiX."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.sparse as sp
from test_preload import line

import flexgram
from bodies import box
from conftest import assembled, assert_certified, certified, run
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.model.geometry import Geometry

STEEL = {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}}
RIGID = {"coupling": "rigid"}


def two_boxes(
    kinds: tuple[str, str] = ("hexahedron", "hexahedron"),
    counts: tuple[tuple[int, int, int], ...] = ((3, 4, 4), (3, 2, 2)),
    gap: float = 0.0,
) -> meshio.Mesh:
    """Two boxes of 0.1 × 0.04 × 0.04, the second behind the first, perhaps with a gap; parts one
    and two, node sets start, end, seam (of the first) and face (of the second)."""
    first, second = (
        box(kind, count, (0.1, 0.04, 0.04), distort=False)
        for kind, count in zip(kinds, counts, strict=True)
    )
    before = len(first.points)
    points = np.vstack([first.points, second.points + np.array([0.1 + gap, 0, 0])])
    cells = [*first.cells, meshio.CellBlock(second.cells[0].type, second.cells[0].data + before)]
    none = np.empty(0, dtype=np.int64)
    return meshio.Mesh(
        points,
        cells,
        point_sets={
            "start": first.point_sets["start"],
            "seam": first.point_sets["end"],
            "face": second.point_sets["start"] + before,
            "end": second.point_sets["end"] + before,
        },
        cell_sets={
            "one": [np.arange(len(first.cells[0].data)), none],
            "two": [none, np.arange(len(second.cells[0].data))],
        },
    )


def body(path: Path, mesh: meshio.Mesh, **more: Any) -> dict[str, Any]:
    content = {
        "materials": STEEL,
        "regions": {"one": {"material": "steel"}, "two": {"material": "steel"}},
        "interfaces": {"start": RIGID | {"nodes": "start"}, "end": RIGID | {"nodes": "end"}},
    }
    return import_description(content | more, "two boxes", path, mesh=mesh)


def rigid_motions(a: dict[str, Any]) -> Any:
    R = np.zeros((len(a["node"]), 6))
    for row, (c, x) in enumerate(zip(a["component"], a["position"], strict=True)):
        R[row, c] = 1
        if c < 3:
            R[row, 3:] = np.cross(np.eye(3), x)[:, c]
    return R


@pytest.mark.parametrize("ranks", [1, 2])
def test_equations_take_out_dofs(ranks: int, tmp_path: Path) -> None:
    """K, M and loads are those of the whole body with T, u = T v, made here."""
    mesh = box("tetra10", (3, 2, 2))
    content: dict[str, Any] = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {
            "end": {"coupling": "distributing", "nodes": "end"},
            "start": RIGID | {"nodes": "start"},
        },
        "loads": {"weight": {"type": "acceleration"}, "push": {"type": "force", "nodes": [40]}},
    }
    free = (
        int(
            np.setdiff1d(
                np.arange(len(mesh.points)), np.concatenate(list(mesh.point_sets.values()))
            )[0]
        )
        + 1
    )
    slave = int(mesh.point_sets["start"][2]) + 1
    end = int(mesh.point_sets["end"][0]) + 1
    # The second equation has the first's dependent dof, the third a slave of a rigid interface.
    terms = [
        [[40, "x", 2.0], [free, "y", 1.0], [end, "x", -3.0]],
        [[41, "z", 1.0], [40, "x", -0.5]],
        [[40, "y", 1.0], [slave, "z", -1.0]],
    ]
    import_description(content, "box", tmp_path / "free.h5", mesh=mesh)
    told = import_description(
        content | {"equations": {"some": {"terms": terms}}}, "box", tmp_path / "tied.h5", mesh=mesh
    )
    assert "equations some: 3" in told["summary"]
    whole = assembled(tmp_path / "a.h5", tmp_path / "free.h5")
    a = assembled(tmp_path / "b.h5", tmp_path / "tied.h5", ranks)
    row = {
        (n, c): i for i, (n, c) in enumerate(zip(whole["node"], whole["component"], strict=True))
    }
    E = np.zeros((3, len(row)))
    reference = {c: row[len(mesh.points), c] for c in range(6)}
    middle = whole["position"][reference[0]]
    arm = mesh.points[slave - 1] - middle
    for k, equation in enumerate(terms):
        for node, component, factor in equation:
            c = "xyz".index(str(component))
            if node != slave:
                E[k, row[int(node) - 1, c]] += float(factor)
                continue
            E[k, reference[c]] += float(factor)
            for axis in range(3):
                E[k, reference[3 + axis]] += float(factor) * np.cross(np.eye(3)[axis], arm)[c]
    dependent = [row[39, 0], row[40, 2], row[39, 1]]
    kept = np.setdiff1d(np.arange(len(row)), dependent)
    T = np.zeros((len(row), len(kept)))
    T[kept, np.arange(len(kept))] = 1
    T[dependent] = -np.linalg.solve(E[:, dependent], E[:, kept])
    place = {(n, c): i for i, (n, c) in enumerate(zip(a["node"], a["component"], strict=True))}
    order = [place[whole["node"][i], whole["component"][i]] for i in kept]
    assert len(place) == len(kept)
    for name in ("K", "M"):
        expected = T.T @ whole[name].toarray() @ T
        np.testing.assert_allclose(
            a[name].toarray()[np.ix_(order, order)], expected, atol=1e-12 * abs(expected).max()
        )
    assert a["names"] == whole["names"]
    expected = T.T @ whole["B"]
    np.testing.assert_allclose(a["B"][order], expected, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_claim_of_a_tied_body(ranks: int, tmp_path: Path) -> None:
    mesh = two_boxes(("tetra10", "hexahedron"), ((4, 3, 3), (4, 2, 2)), 0.001)
    body(
        tmp_path / "body.h5",
        mesh,
        ties={"seam": {"nodes": "seam", "to": "face", "distance": 0.002}},
        equations={"link": {"terms": [[1, "y", 1.0], [30, "y", -0.5]]}},
        interfaces={
            "end": RIGID | {"nodes": "end"},
            "seam": {"coupling": "distributing", "nodes": "seam"},
        },
        loads={"weight": {"type": "acceleration"}},
        damping={"alpha": 3.0, "beta": 1e-7},
    )
    result = certified(
        tmp_path / "body.h5", (10.0, 3000.0), tmp_path, "-mor_tol", 1e-4, ranks=ranks, count=6
    )
    assert_certified(result, 1e-4)


def test_pictures_move_what_follows(tmp_path: Path) -> None:
    """Displacements of all nodes of a rigid motion of the reduced body, dependent ones too."""
    mesh = two_boxes(gap=0.002)
    tie = {"seam": {"nodes": "seam", "to": "face", "distance": 0.003}}
    body(tmp_path / "body.h5", mesh, ties=tie)
    rom = tmp_path / "rom.h5"
    run("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,5000", "-mor_out", rom)
    model = flexgram.ReducedModel.load(rom)
    motion = Geometry.load(tmp_path / "body.h5").motion(model)
    points = mesh.points - mesh.points.mean(axis=0)
    R = np.hstack(
        [
            np.tile(np.eye(3), (len(points), 1)),
            np.cross(np.eye(3)[None], points[:, None]).transpose(0, 2, 1).reshape(-1, 3),
        ]
    )
    shapes = motion[:6].reshape(6, -1).T
    left = shapes - R @ np.linalg.lstsq(R, shapes, rcond=None)[0]
    assert abs(left).max() < 1e-6 * abs(shapes).max()
    moved = motion[6:, mesh.point_sets["seam"]]
    assert (np.abs(moved).max(axis=(1, 2)) > 0).all()


def test_reactions_reach_supports_through_ties(tmp_path: Path) -> None:
    """A body whose tied nodes follow held ones: its weight arrives at the support."""
    mesh = two_boxes()
    body(
        tmp_path / "body.h5",
        mesh,
        ties={"seam": {"nodes": "seam", "to": "face"}},
        interfaces={"start": RIGID | {"nodes": "start"}},
        supports={"wall": {"nodes": "face"}},
        loads={"weight": {"type": "acceleration"}},
        outputs={"wall": {"type": "reaction", "nodes": "face", "point": [0, 0, 0]}},
    )
    rom = tmp_path / "rom.h5"
    run("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "1,500", "-mor_out", rom)
    model = flexgram.ReducedModel.load(rom)
    H = model.system.transfer(np.array([1e-3]))[0]
    force = H[list(model.outputs).index("wall.rz"), list(model.inputs).index("weight.az")].real
    # Held nodes take their share of the weight, as the others do.
    assert force == pytest.approx(-7850 * 0.2 * 0.04**2, rel=1e-6)


@pytest.mark.parametrize(("gap", "warned"), [(0.0, False), (0.002, True)])
def test_what_a_floating_frame_misses_is_said(gap: float, warned: bool, tmp_path: Path) -> None:
    """Levers of ties turn with the frame, which its integrals leave out: warned of, alone."""
    mesh = two_boxes(gap=gap)
    body(tmp_path / "body.h5", mesh, ties={"t": {"nodes": "seam", "to": "face", "distance": 0.003}})
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,5000"),
        *("-mor_out", tmp_path / "rom.h5"),
    )
    warnings = [line for line in said.out.splitlines() if line.startswith("warning")]
    assert len(warnings) == warned and not said.err
    assert all("terms of second order are approximate" in line for line in warnings)
    assert "constraints    75 dependent dofs" in said.out


def test_a_part_that_equations_hold(tmp_path: Path) -> None:
    """It is none that nothing holds; a reaction there is refused."""
    mesh = two_boxes(gap=0.01)
    face = (mesh.point_sets["face"] + 1).tolist()
    terms = [[[n, c, 1.0]] for n in face for c in "xyz"]
    more: dict[str, Any] = {
        "equations": {"wall": {"terms": terms}},
        "interfaces": {"start": RIGID | {"nodes": "start"}},
    }
    told = body(tmp_path / "body.h5", mesh, **more)
    assert not any("nothing holds" in line for line in told["warnings"])
    reaction = {"wall": {"type": "reaction", "nodes": "face", "point": [0, 0, 0]}}
    with pytest.raises(BodyError, match="its reaction is not known"):
        body(tmp_path / "b.h5", mesh, **more, outputs=reaction)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"ties": {"a": {"nodes": "seam", "to": "end"}}}, "no node lies within"),
        ({"ties": {"a": {"nodes": "seam", "to": [1, 2]}}}, "no face of an element"),
        ({"ties": {"a": {"nodes": "seam", "to": "face", "distance": -1}}}, "must be positive"),
        ({"ties": {"a": {"nodes": "seam", "to": "face", "gap": 1}}}, "unknown key gap"),
        ({"equations": {"a": {"terms": []}}}, "must be rows"),
        ({"equations": {"a": {"terms": [[1, "x", 0]]}}}, "all factors are 0"),
        ({"equations": {"a": {"terms": [[30, "rx", 1.0]]}}}, "has no rotation rx"),
        ({"equations": {"a": {"terms": [[9999, "x", 1.0]]}}}, "node numbers run from 1"),
        (
            {"equations": {"a": {"terms": [[1, "x", 1.0], [2, "x", -1.0]]}}},
            "between dofs of rigid interfaces alone",
        ),
    ],
)
def test_what_is_refused(more: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        body(tmp_path / "body.h5", two_boxes(), **more)
    assert not (tmp_path / "body.h5").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda g: g["factor"].__setitem__(0, np.nan), "must be finite"),
        (lambda g: g["dependent"].__setitem__((0, 1), 7), "component 7"),
        (lambda g: g["start"].__setitem__(1, 10**6), "do not fit each other"),
        (lambda g: g["dependent"].__setitem__(0, g["dependent"][1]), "depends twice"),
        (lambda g: g["independent"].__setitem__(0, g["dependent"][1]), "others depend on it"),
        (lambda g: g["dependent"].__setitem__((0, 1), 5), "does not exist"),
    ],
)
def test_wrong_files(change: Any, words: str, tmp_path: Path) -> None:
    body(tmp_path / "body.h5", two_boxes(), ties={"seam": {"nodes": "seam", "to": "face"}})
    with h5py.File(tmp_path / "body.h5", "r+") as file:
        change(file["constraints"])
    said = run(
        "assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5", expect=None
    )
    assert said.status == 1
    assert words in said.err


def test_equations_are_in_the_meshs_units(tmp_path: Path) -> None:
    """Of a displacement [mm] and a rotation of a beam's node."""
    mesh = line(2, 0.0, 200.0)
    points = mesh.points
    found = []
    for units, length in (("mm-t-s", 1.0), ("SI", 1e-3)):
        mesh.points = points * length
        stress = 1e6 if units == "SI" else 1.0
        size = 10.0 * length
        import_description(
            {
                "units": units,
                "materials": {
                    "m": {
                        "E": 2.1e5 * stress,
                        "nu": 0.3,
                        "rho": 7.85e-9 * (1e12 if length < 1 else 1),
                    }
                },
                "sections": {"bar": {"shape": "rectangle", "width": size, "height": size}},
                "regions": {"all": {"material": "m", "section": "bar"}},
                "interfaces": {"tip": {"coupling": "node", "nodes": [1]}},
                "equations": {"e": {"terms": [[3, "y", 1.0], [3, "rz", -50.0 * length]]}},
            },
            "beam",
            tmp_path / "beam.h5",
            mesh=mesh,
        )
        found.append(assembled(tmp_path / "m.h5", tmp_path / "beam.h5")["K"])
    assert abs(found[0] - found[1]).max() < 1e-12 * abs(found[0]).max()
    assert sp.issparse(found[0]) and found[0].shape == (17, 17)
