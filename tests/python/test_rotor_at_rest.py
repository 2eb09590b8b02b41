"""Solids of revolution that spin, seen in the frame at rest: against the frame that turns and rigid
discs, and claims on unsymmetric bearings against elimination."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse.linalg as spl

from bodies import box
from conftest import assembled, read_sparse, run
from flexgram import ReducedModel
from flexgram.body.description import import_description
from flexgram.model.campbell import campbell

STEEL = {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}}
TOP = 2000.0  # rad/s
LENGTH, INNER, OUTER = 0.4, 0.02, 0.06
TWO_PI = 2 * np.pi


def tube(kind: str, counts: tuple[int, int, int]) -> meshio.Mesh:
    """A thick tube about the x axis, by elements along it, around it and through its wall."""
    mesh = box(kind, counts, (LENGTH, TWO_PI, OUTER - INNER), distort=False)
    x, angle, depth = mesh.points.T
    r = INNER + depth
    points = np.column_stack([x, r * np.cos(angle), -r * np.sin(angle)])
    keys = np.round(points / 1e-9).astype(np.int64)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = number.ravel()
    return meshio.Mesh(
        points[first],
        [(block.type, number[block.data]) for block in mesh.cells],
        point_sets={name: np.unique(number[nodes]) for name, nodes in mesh.point_sets.items()},
    )


def describe(mesh: meshio.Mesh, path: Path, frame: str, **changes: Any) -> None:
    """The tube, clamped at one end."""
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "spin": {"axis": [1, 0, 0], "from": 0, "to": TOP, "frame": frame},
    } | changes
    import_description(content, "tube", path, mesh=mesh)


def matrices(path: Path, ranks: int = 1) -> dict[str, Any]:
    """K, M, D, B of the assembled body, and its terms by their names."""
    out = path.with_suffix(".m.h5")
    parts = assembled(out, path, ranks=ranks)
    with h5py.File(out) as file:
        terms = {name: read_sparse(file, f"terms/{name}") for name in file.get("terms", ())}
        D = read_sparse(file, "D") if "D" in file else 0 * parts["K"]
        return parts | {"terms": terms, "D": D + file.attrs["alpha"] * parts["M"]}


def at_speed(parts: dict[str, Any], speed: float) -> tuple[Any, Any]:
    """K and G."""
    K, G = parts["K"], 0 * parts["K"]
    for name, matrix in parts["terms"].items():
        if name == "coriolis":
            G = G + speed * matrix
        elif name.startswith("spin"):
            K = K + speed ** (4 if "moved" in name else 2) * matrix
    return K, G


def frequencies(parts: dict[str, Any], speed: float, count: int = 6) -> Any:
    """The lowest whirl frequencies, in the span of eighty modes at rest."""
    M = parts["M"]
    _, modes = spl.eigsh(parts["K"].tocsc(), 80, M.tocsc(), sigma=0)
    K, G = (modes.T @ (a @ modes) for a in at_speed(parts, speed))
    m = modes.T @ (M @ modes)
    state = np.block([[np.zeros_like(K), np.eye(len(K))], [-sl.solve(m, K), -sl.solve(m, G)]])
    poles = np.linalg.eigvals(state)
    return np.sort(poles.imag[poles.imag > 0])[:count]


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron", "hexahedron20", "wedge15"])
def test_both_frames_see_the_same_rotor(kind: str, tmp_path: Path) -> None:
    """Bending is faster by the speed in one sense and slower in the other in the frame that turns;
    twisting and stretching are the same."""
    mesh = tube(kind, (6, 16, 2) if kind == "hexahedron" else (6, 12, 1))
    for frame in ("turning", "rest"):
        describe(mesh, tmp_path / f"{frame}.h5", frame)
    turning, rest = (matrices(tmp_path / f"{frame}.h5") for frame in ("turning", "rest"))
    assert set(rest["terms"]) == {"coriolis", "spin_at_rest", "spin_moved_at_rest"}
    for speed in (700.0, TOP):
        seen, still = frequencies(turning, speed), frequencies(rest, speed)
        # Bending slower and faster, twist, the same again, stretching.
        expected = seen + speed * np.array([1, -1, 0, 1, -1, 0])
        np.testing.assert_allclose(still, np.sort(expected), rtol=1e-4)
        assert still[1] - still[0] > 0.02 * speed  # gyroscopic moments part them


def test_a_rigid_disc_has_its_gyroscopic_moment(tmp_path: Path) -> None:
    """All of a tube follows one reference: J Ω, and a tilt that nothing stiffens."""
    mesh = tube("hexahedron20", (2, 12, 1))
    everything = {"all": np.arange(len(mesh.points))}
    mesh.point_sets |= everything
    centre = [0.5 * LENGTH, 0, 0]
    describe(
        mesh,
        tmp_path / "disc.h5",
        "rest",
        interfaces={"disc": {"coupling": "rigid", "nodes": "all", "position": centre}},
        supports={},
        springs={"bearing": {"at": "disc", "stiffness": [1e6, 1e6, 1e6, 1e4, 1e4, 1e4]}},
    )
    parts = matrices(tmp_path / "disc.h5")
    M, (K, G) = parts["M"].toarray(), at_speed(parts, TOP)
    spin = np.zeros((6, 6))
    spin[4, 5], spin[5, 4] = M[3, 3], -M[3, 3]
    np.testing.assert_allclose(G.toarray(), TOP * spin, atol=2e-3 * TOP * M[3, 3])
    np.testing.assert_allclose(K.toarray(), parts["K"].toarray(), atol=2e-3 * TOP**2 * M[3, 3])


def on_bearings(path: Path, frame: str = "rest") -> None:
    """The tube on two bearings that are softer in one direction, with dashpots."""
    bearing = {"stiffness": [1e6, 4e7, 1e8, 1e4, 0, 0], "damping": [50, 2e3, 3e3, 1, 0, 0]}
    describe(
        tube("hexahedron20", (6, 12, 1)),
        path,
        frame,
        interfaces={
            "left": {"coupling": "rigid", "nodes": "start"},
            "right": {"coupling": "rigid", "nodes": "end"},
        },
        supports={},
        springs={name: bearing | {"at": name} for name in ("left", "right")},
        damping={"alpha": 5.0},
    )


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_claim_on_unsymmetric_bearings(ranks: int, tmp_path: Path) -> None:
    on_bearings(tmp_path / "body.h5")
    said = run(
        *("reduce", tmp_path / "body.h5", "--band", "10,700", "--tol", "1e-3"),
        *("-o", tmp_path / "rom.h5"),
        ranks=ranks,
    )
    assert "seen in the frame at rest, through which the body runs" in said.out
    assert "a dashpot there" not in said.out + said.err
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.kind == "certified" and rom.certified_error <= 1e-3
    parts = matrices(tmp_path / "body.h5", ranks)
    names = np.array([name.split(".")[1][0] for name in parts["names"]])
    kinds = [np.ix_(names == kind, names == kind) for kind in "fm"]
    worst = 0.0
    for (speed,) in rom.claim.parameter_values:
        K, G = at_speed(parts, speed)
        one = rom.at(speed=speed)
        peaks = one.poles().imag
        omega = np.append(TWO_PI * np.linspace(10, 700, 12), peaks[(peaks > 63) & (peaks < 4398)])
        for w in omega:
            A = K + 1j * w * (parts["D"] + G) - w**2 * parts["M"]
            H = parts["B"].T @ spl.splu(A.tocsc()).solve(parts["B"].astype(complex))
            away = one.transfer([w])[0] - H
            error = max(np.linalg.norm(away[k]) / np.linalg.norm(H[k]) for k in kinds)
            assert error <= rom.certified_error
            worst = max(worst, error)
    assert worst > 0.5 * rom.certified_error


def test_whirl_of_a_clamped_tube(tmp_path: Path) -> None:
    """Circles, the faster forward; their frequencies are those of the body."""
    describe(tube("wedge15", (6, 12, 1)), tmp_path / "b.h5", "rest", damping={"alpha": 30.0})
    words = ("--band", "100,700", "--tol", "1e-4", "--inputs", "tip.fy,tip.fz")
    run("reduce", tmp_path / "b.h5", *words, "-o", tmp_path / "r.h5")
    found = campbell(ReducedModel.load(tmp_path / "r.h5").system, [0.0, 0.5 * TOP, TOP], modes=2)
    assert not found.turning
    order = np.argsort(found.omega[-1])
    expected = frequencies(matrices(tmp_path / "b.h5"), TOP, 2)
    np.testing.assert_allclose(found.omega[-1][order], expected, rtol=1e-4)
    np.testing.assert_allclose(found.whirl[-1][order], [-1, 1], atol=0.01)


def test_what_is_no_body_of_revolution(tmp_path: Path) -> None:
    def refused(mesh: meshio.Mesh, **changes: Any) -> str:
        describe(mesh, tmp_path / "b.h5", "rest", **changes)
        return run("assemble", tmp_path / "b.h5", "-o", tmp_path / "m.h5", expect=1).err

    round_one = tube("tetra10", (3, 12, 1))
    assert "bodies of revolution" in refused(box("tetra10", (4, 2, 2)))
    spin = {"axis": [1, 0, 0], "point": [0, 0.02, 0], "to": TOP, "frame": "rest"}
    assert "bodies of revolution" in refused(round_one, spin=spin)
    halves = round_one.points[round_one.cells[0].data].mean(axis=1)[:, 1] > 0
    round_one.cell_sets = {
        name: [np.flatnonzero(halves == on)] for name, on in (("a", 1), ("b", 0))
    }
    light = {"a": {"material": "steel"}, "b": {"material": "wood"}}
    wood = STEEL | {"wood": {"E": 210e9, "nu": 0.3, "rho": 3000.0}}
    assert "bodies of revolution" in refused(round_one, materials=wood, regions=light)
    fibres = {"E1": 140e9, "E2": 10e9, "E3": 10e9, "nu12": 0.3, "nu13": 0.3, "nu23": 0.4}
    fibres |= {"G12": 5e9, "G13": 5e9, "G23": 3e9, "rho": 1600.0}
    round_one.cell_sets = {}
    assert "isotropic" in refused(round_one, materials={"steel": fibres})
