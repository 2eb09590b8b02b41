"""Nodes that no element has, masses beside their nodes, shells whose bending is told apart, and
materials that weigh nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh, spsolve

from conftest import assembled, read_sparse, run
from flexgram import BodyError
from flexgram.body.description import import_description

ALL = ["x", "y", "z", "rx", "ry", "rz"]


def bar(**more: Any) -> tuple[dict[str, Any], meshio.Mesh]:
    """A beam of 1 m along x in four elements, held at its first node; three points besides."""
    points = np.zeros((8, 3))
    points[:5, 0] = np.linspace(0, 1, 5)
    points[5:] = [[1.0, 0.1, 0.05], [1.2, 0.1, 0.05], [0.5, 0.0, 0.3]]
    mesh = meshio.Mesh(points, [("line", np.array([[k, k + 1] for k in range(4)]))])
    mesh.cell_sets = {"bar": [np.arange(4)]}
    content = {
        "name": "bar",
        "materials": {"steel": {"E": 200e9, "nu": 0.3, "rho": 8000}},
        "sections": {"bar": {"shape": "rectangle", "width": 0.02, "height": 0.03}},
        "regions": {"bar": {"material": "steel", "section": "bar"}},
        "supports": {"held": {"nodes": [1], "components": ALL}},
        "interfaces": {"tip": {"coupling": "node", "nodes": [5]}},
    }
    return content | more, mesh


def matrices(folder: Path, content: dict[str, Any], mesh: Any, ranks: int = 1) -> dict[str, Any]:
    import_description(content, "bar", folder / "b.h5", mesh=mesh)
    return assembled(folder / "a.h5", folder / "b.h5", ranks)


def rigid(of: int, by: int, mesh: Any) -> list[list[Any]]:
    """A node moves as a rigid body with another, both from 1."""
    d = mesh.points[of - 1] - mesh.points[by - 1]
    terms = []
    for c in range(3):
        row = [[of, ALL[c], 1.0], [by, ALL[c], -1.0]]
        for a in range(3):
            lever = float(np.cross(np.eye(3)[a], d)[c])
            row += [[by, ALL[3 + a], -lever]] if lever else []
        terms += [row, [[of, ALL[3 + c], 1.0], [by, ALL[3 + c], -1.0]]]
    return terms


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_arm_to_a_node_alone(ranks: int, tmp_path: Path) -> None:
    """A mass on a massless arm is one beside its node; the same frequencies, and the same rigid
    interface by hand."""
    J = [0.02, 0.025, 0.03, 0.001, 0.002, -0.003]
    content, mesh = bar()
    arm = [0.0, 0.1, 0.05]
    ways = {
        "arm": {
            "nodes_alone": [6],
            "equations": {"arm": {"terms": rigid(6, 5, mesh)}},
            "masses": {"disc": {"nodes": [6], "mass": 3.0, "inertia": J}},
        },
        "beside": {"masses": {"disc": {"nodes": [5], "mass": 3.0, "inertia": J, "offset": arm}}},
        "plain": {},
    }
    found = {name: matrices(tmp_path, content | more, mesh, ranks) for name, more in ways.items()}
    values = {
        name: np.sort(eigsh(a["K"], 6, a["M"], sigma=0, return_eigenvectors=False))
        for name, a in found.items()
    }
    np.testing.assert_allclose(values["arm"], values["beside"], rtol=1e-9)
    a, b = found["beside"], found["plain"]
    added = (a["M"] - b["M"]).toarray()
    at = np.flatnonzero(np.abs(added).sum(axis=1))
    H = np.eye(6)
    H[:3, 3:] = np.column_stack([np.cross(np.eye(3)[k], arm) for k in range(3)])
    xx, yy, zz, xy, yz, zx = J
    own = np.zeros((6, 6))
    own[:3, :3], own[3:, 3:] = 3 * np.eye(3), [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]
    np.testing.assert_allclose(added[np.ix_(at, at)], H.T @ own @ H, atol=1e-12)


def test_facts_of_a_mass_beside_its_node(tmp_path: Path) -> None:
    """Mass and centre that the import tells, and the rigid body that the reduction keeps."""
    content, mesh = bar(supports={})
    content["masses"] = {"disc": {"nodes": [5], "mass": 3.0, "offset": [0.0, 0.1, 0.05]}}
    facts = import_description(content, "bar", tmp_path / "b.h5", mesh=mesh)
    weight = 8000 * 0.02 * 0.03
    centre = (weight * np.array([0.5, 0, 0]) + 3 * np.array([1, 0.1, 0.05])) / (weight + 3)
    said = next(line for line in facts["summary"] if "centre" in line)
    for x in centre:
        assert f"{x:.6g}" in said, said
    assert any("beside its node" in line for line in facts["summary"])


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_frame_of_a_mass_beside_its_node(ranks: int, tmp_path: Path) -> None:
    """A floating body's mass and centre are those of the same mass at the reference of a rigid
    interface, which lies there, and so is what its shapes move; of the deformed body it is told
    that the arm is not supported."""
    found = []
    for more in (
        {"masses": {"disc": {"nodes": [5], "mass": 3.0, "offset": [0.0, 0.1, 0.05]}}},
        {"masses": {"disc": {"at": "end", "mass": 3.0}}},
    ):
        content, mesh = bar(supports={}, damping={"alpha": 1.0}, **more)
        position = [1.0, 0.1, 0.05] if "at" in more["masses"]["disc"] else [1.0, 0.0, 0.0]
        content["interfaces"] = {
            "end": {"coupling": "rigid", "nodes": [5], "position": position},
            "start": {"coupling": "node", "nodes": [1]},
        }
        import_description(content, "bar", tmp_path / "b.h5", mesh=mesh)
        files = ("-body", tmp_path / "b.h5", "-mor_out", tmp_path / "r.h5")
        said = run("reduce", *files, "-mor_band_hz", "1,200", "-mor_tol", "1e-6", ranks=ranks)
        beside = "offset" in more["masses"]["disc"]
        assert ("masses beside" in " ".join((said.out + said.err).split())) == beside
        with h5py.File(tmp_path / "r.h5") as file:
            names = [str(name) for name in file["B"].attrs["names"]]
            loads = file["B"][:][6:, [names.index(f"start.f{c}") for c in "yz"]]
            q = np.zeros((len(file["K"]), 2))
            q[6:] = np.linalg.solve(file["K"][:][6:, 6:], loads)
            frame = file["frame"]
            moved = frame["M_er"][:].T @ q
            scale = np.abs(np.diag(frame["M_r"][:])).max() * np.abs(q).max()
            found.append((frame["M_r"][:], frame["centre"][:], moved / scale))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)


def test_springs_hold_a_node_alone(tmp_path: Path) -> None:
    """A mass at the end of a spring to a node alone, of two springs in series."""
    k = 1e4
    content, mesh = bar(
        nodes_alone=[6, 7],
        masses={"ball": {"nodes": [7], "mass": 2.0}},
        springs={
            "one": {"nodes": [5], "to_nodes": [6], "stiffness": [k] * 6},
            "two": {"nodes": [6], "to_nodes": [7], "stiffness": [2 * k] * 6},
        },
    )
    content["supports"]["turns"] = {"nodes": [7], "components": ["rx", "ry", "rz"]}
    a = matrices(tmp_path, content, mesh)
    lowest = np.sort(eigsh(a["K"], 4, a["M"], sigma=0, return_eigenvectors=False))
    assert 0 < lowest[0] < 2 * k / 3 / 2.0


SANDWICH = {"bending": {"factor": 100.0}, "shear": {"material": "core", "factor": 8.0}}


def sheet(section: dict[str, Any]) -> tuple[dict[str, Any], meshio.Mesh]:
    x, y = np.meshgrid(np.linspace(0, 1, 13), np.linspace(0, 0.5, 7))
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    quads = np.array(
        [[13 * j + i, 13 * j + i + 1, 13 * j + i + 14, 13 * j + i + 13]
         for j in range(6) for i in range(12)]
    )  # fmt: skip
    mesh = meshio.Mesh(points, [("quad", quads)], cell_sets={"all_of_it": [np.arange(72)]})
    content = {
        "name": "sheet",
        "materials": {
            "skin": {"E": 70e9, "nu": 0.3, "rho": 2700, "loss_factor": 0.001},
            "core": {"E": 1e9, "nu": 0.3, "rho": 0.0, "loss_factor": 0.05},
        },
        "sections": {"panel": {"shape": "shell", "thickness": 1e-3, **section}},
        "regions": {"all_of_it": {"material": "skin", "section": "panel"}},
        "supports": {"held": {"nodes": {"box": [[-1, -1, -1], [1e-9, 1, 1]]}, "components": ALL}},
        "interfaces": {"tip": {"coupling": "node", "nodes": [13]}},
    }
    return content, mesh


@pytest.mark.parametrize("ranks", [1, 2])
def test_bending_and_shear_told_apart(ranks: int, tmp_path: Path) -> None:
    """Of one layer's usual numbers the plain shell; of a sandwich its layers' own stiffness."""
    plain, same = {}, {"bending": {"factor": 1.0}, "shear": {"factor": 5 / 6}}
    a, b = (matrices(tmp_path, *sheet(section), ranks) for section in (plain, same))
    assert abs(a["K"] - b["K"]).max() <= 1e-12 * abs(a["K"]).max()
    assert abs(a["M"] - b["M"]).max() <= 1e-12 * abs(a["M"]).max()
    # 12 I / t³ of two skins of t/2 that are h apart, and a core without stretch of height h − t/2
    t, h, core = 1e-3, 20e-3, 1e9 / 2.6
    skins = [{"material": "skin", "thickness": t / 2}] * 2
    layers = [skins[0], {"material": "core", "thickness": h - t / 2}, skins[1]]
    of_layers, mesh = sheet({"layers": layers})
    del of_layers["sections"]["panel"]["thickness"], of_layers["regions"]["all_of_it"]["material"]
    of_layers["materials"]["core"] = {"E1": 1.0, "E2": 1.0, "E3": 1.0, "nu12": 0.0, "nu13": 0.0,
                                      "nu23": 0.0, "G12": 1.0, "G13": core, "G23": core,
                                      "rho": 0.0}  # fmt: skip
    expected = matrices(tmp_path, of_layers, mesh, ranks)
    bending = 2 * (t / 2) * (h / 2) ** 2 + 2 * (t / 2) ** 3 / 12
    effective = core * h**2 / (h - t / 2)
    apart = {"bending": {"factor": 12 * bending / t**3},
             "shear": {"material": "core", "factor": effective / core / t}}  # fmt: skip
    found = matrices(tmp_path, *sheet(apart), ranks)
    tip = expected["B"][:, expected["names"].index("tip.fz")]
    deflection = [float(tip @ spsolve(m["K"].tocsc(), tip)) for m in (expected, found)]
    assert deflection[1] == pytest.approx(deflection[0], rel=2e-3)
    np.testing.assert_allclose(
        np.sort(eigsh(expected["K"], 3, expected["M"], sigma=0, return_eigenvectors=False)),
        np.sort(eigsh(found["K"], 3, found["M"], sigma=0, return_eigenvectors=False)),
        rtol=5e-3,
    )


def test_losses_of_what_is_told_apart(tmp_path: Path) -> None:
    """The core's loss factor is that of the shear alone: S is Σ η_k K_k."""
    content, mesh = sheet(SANDWICH)
    import_description(content, "sheet", tmp_path / "b.h5", mesh=mesh)
    run("assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "a.h5")
    stiff = {}
    for name, changed in (("whole", 1.0), ("core", 2.0)):
        more, mesh = sheet(SANDWICH)
        more["materials"]["core"]["E"] *= changed
        stiff[name] = matrices(tmp_path, more, mesh)["K"]
    import_description(content, "sheet", tmp_path / "b.h5", mesh=mesh)
    run("assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        S = read_sparse(file, "S")
    core = stiff["core"] - stiff["whole"]
    expected = 0.001 * (stiff["whole"] - core) + 0.05 * core
    assert abs(S - expected).max() <= 1e-9 * abs(expected).max()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "a node with elements": ({"nodes_alone": [5, 6]}, "node 5 has elements"),
    "a node that is not there": ({"nodes_alone": [9]}, "from 1 to 8"),
    "no list": ({"nodes_alone": "tip"}, "must be a list of node numbers"),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_wrong_nodes_are_refused(case: str, tmp_path: Path) -> None:
    more, words = WRONG[case]
    content, mesh = bar(**more)
    with pytest.raises(BodyError, match=words):
        import_description(content, "bar", tmp_path / "b.h5", mesh=mesh)


def test_stress_of_shells_told_apart_is_refused(tmp_path: Path) -> None:
    content, mesh = sheet(SANDWICH)
    content["outputs"] = {"spot": {"type": "stress", "nodes": [20], "side": "top"}}
    with pytest.raises(BodyError, match="bending is told apart"):
        import_description(content, "sheet", tmp_path / "b.h5", mesh=mesh)


def test_what_weighs_nothing_is_told(tmp_path: Path) -> None:
    content, mesh = bar(masses={"ball": {"nodes": [5], "mass": 2.0}})
    content["materials"]["steel"]["rho"] = 0.0
    facts = import_description(content, "bar", tmp_path / "b.h5", mesh=mesh)
    assert any("weighs nothing" in words for words in facts["warnings"])
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
    assert a["M"].diagonal().sum() == pytest.approx(6.0)


def test_inertias_that_no_body_has(tmp_path: Path) -> None:
    """Of one axis alone, as decks give them; a body that spins takes none, and none is negative."""
    content, mesh = bar(masses={"disc": {"nodes": [5], "mass": 3.0, "inertia": [0.0, 0.0, 0.1]}})
    a = matrices(tmp_path, content, mesh)
    assert np.all(eigsh(a["K"], 4, a["M"], sigma=0, return_eigenvectors=False) > 0)
    spin = {"axis": [1, 0, 0], "point": [0, 0, 0], "from": 0, "to": 10}
    import_description(content | {"spin": spin}, "bar", tmp_path / "s.h5", mesh=mesh)
    wrong = ("assemble", "-body", tmp_path / "s.h5", "-body_out", tmp_path / "a.h5")
    assert "no body that spins has the principal" in run(*wrong, expect=1).err
    content["masses"]["disc"]["inertia"] = [0.0, 0.0, -0.1]
    import_description(content, "bar", tmp_path / "s.h5", mesh=mesh)
    assert "negative principal moment" in run(*wrong, expect=1).err


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_material_by_its_stiffness(ranks: int, tmp_path: Path) -> None:
    """That of engineering constants, along axes of its own; a shell's too, and its stress."""
    E, nu, G = (120e9, 10e9, 8e9), (0.3, 0.25, 0.4), (5e9, 4e9, 3e9)
    S = np.diag([*(1 / np.array(E)), 1 / G[0], 1 / G[2], 1 / G[1]])
    S[0, 1] = S[1, 0] = -nu[0] / E[0]
    S[0, 2] = S[2, 0] = -nu[1] / E[0]
    S[1, 2] = S[2, 1] = -nu[2] / E[1]
    names = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")
    constants = dict(zip(names, (*E, *nu, *G), strict=True))
    axes = {"axis_1": [0.8, 0.6, 0.1], "axis_2": [-0.6, 0.8, 0.2], "rho": 1600.0}
    found = []
    for law in (constants, {"stiffness": np.linalg.inv(S).tolist()}):
        content, mesh = sheet({})
        content["materials"]["skin"] = {**law, **axes}
        content["outputs"] = {"spot": {"type": "stress", "nodes": [20], "side": "top"}}
        a = matrices(tmp_path, content, mesh, ranks)
        with h5py.File(tmp_path / "b.h5") as file:
            found.append((a["K"], file["outputs/spot/values"][:]))
    assert abs(found[0][0] - found[1][0]).max() <= 1e-11 * abs(found[0][0]).max()
    np.testing.assert_allclose(
        found[0][1], found[1][1], atol=1e-9 * np.abs(found[0][1]).max(), rtol=1e-9
    )


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[1.0]], "six rows of six"),
        (np.diag([1.0, 1, 1, 1, 1, -1]).tolist(), "not positive definite"),
        ((np.eye(6) + np.triu(np.ones((6, 6)), 1)).tolist(), "not symmetric"),
        ("steel", "stiffness"),
    ],
)
def test_a_stiffness_that_is_none(matrix: Any, words: str, tmp_path: Path) -> None:
    content, mesh = sheet({})
    content["materials"]["skin"] = {"stiffness": matrix, "rho": 1600.0}
    with pytest.raises(BodyError, match=words):
        import_description(content, "sheet", tmp_path / "b.h5", mesh=mesh)
