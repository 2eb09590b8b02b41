"""Geometric stiffening of floating frames, against bodies under preloads; in EXUDYN:
test_stiffening_exudyn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.spatial.transform

from bodies import box
from conftest import assembled, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.body.description import import_description
from flexgram.exporters.exudyn_stiffening import SPINS, frame_stiffening
from flexgram.exporters.sid import read_sid, write_sid
from sheets import sheet

MATERIAL = {"E": 2e9, "nu": 0.3, "rho": 2000.0}
SIZE = (1.0, 0.03, 0.05)
SPEED, PULL = 30.0, 800.0


def blade(path: Path, cell: str, held: str = "", turned: Any = None, **more: Any) -> None:
    """A bar along x. Its ends are rigid interfaces, but the one that supports hold."""
    ends = {"root": "start", "tip": "end"}
    content: dict[str, Any] = {
        "materials": {"soft": MATERIAL},
        "regions": {"all": {"material": "soft"}},
        "interfaces": {
            name: {"coupling": "rigid", "nodes": nodes}
            for name, nodes in ends.items()
            if name != held
        },
    }
    if held:
        content["supports"] = {held: {"nodes": ends[held]}}
    if cell == "quad":
        mesh = sheet(cell, (12, 2), lambda u, v: (SIZE[0] * u, 0 * u, SIZE[2] * (v - 0.5)))
        content["sections"] = {"sheet": {"shape": "shell", "thickness": SIZE[1]}}
        content["regions"]["all"]["section"] = "sheet"
        if held:
            content["supports"][held]["components"] = ["x", "y", "z", "rx", "ry", "rz"]
    else:
        mesh = box(cell, (6, 1, 1), SIZE, distort=False)
        mesh.points -= [0, SIZE[1] / 2, SIZE[2] / 2]  # a spin about z bends nothing
    if turned is not None:
        mesh.points = mesh.points @ turned.T
    import_description(content | more, "blade", path, mesh=mesh)


def stiffened(
    folder: Path, cell: str, ranks: int = 1, *more: object, turned: Any = None
) -> tuple[ReducedModel, str]:
    blade(folder / "free.h5", cell, turned=turned)
    said = run(
        *("reduce", "-body", folder / "free.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-5"),
        *("-mor_stiffening", "yes", "-mor_out", folder / "rom.h5"),
        *(() if "-mor_frame" in more else ("-mor_frame", "tangent")),
        *more,
        ranks=ranks,
    ).out
    return ReducedModel.load(folder / "rom.h5"), said


def lowest(K: Any, M: Any) -> Any:
    return np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[:3])


def under(folder: Path, cell: str, stays: dict[str, float], held: str = "root", **more: Any) -> Any:
    """Natural frequencies of the blade held at one end, under loads that stay."""
    path = folder / f"under_{next(iter(stays))}.h5"
    blade(path, cell, held, preload=stays, **more)
    full = assembled(path.with_suffix(".matrices.h5"), path)
    return lowest(full["K"].toarray(), full["M"].toarray())


@pytest.mark.parametrize(
    ("cell", "ranks"), [("tetra10", 1), ("hexahedron", 2), ("quad", 1), ("quad", 2)]
)
def test_sid_against_preloads(cell: str, ranks: int, tmp_path: Path) -> None:
    """Frequencies by the blocks of a SID, against the body under a spin, a pull, its own weight."""
    rom, said = stiffened(tmp_path, cell, ranks)
    assert "18 unit loads" in said and "root holds the body" in said
    write_sid(rom, tmp_path / "blade.SID_FEM")
    sid = read_sid(tmp_path / "blade.SID_FEM")
    K, M = sid["Ke"][0], sid["Me"][0]
    at_rest = lowest(K, M)

    def by(block: Any, column: int) -> Any:  # (q, r, c)
        return block[1][:, :, column].T

    spun = K + SPEED**2 * by(sid["Oe"], 2)
    expected = under(
        tmp_path,
        cell,
        {"turn.spin": SPEED**2},
        loads={"turn": {"type": "spin", "axis": [0, 0, 1], "point": [0, 0, 0]}},
    )
    assert abs(expected - at_rest).max() > 0.2 * at_rest[0]
    assert lowest(spun, M) == pytest.approx(expected, rel=3e-3)  # strains of 5e-4 move it too

    phi = sid["nodes"][2]["phi"][1]  # (q, axis, mode): the tip
    pulled = K - PULL * phi[:, 0, :].T
    expected = under(tmp_path, cell, {"tip.fx": PULL})
    assert abs(expected - at_rest).max() > 0.2 * at_rest[0]
    assert lowest(pulled, M) == pytest.approx(expected, rel=2e-3)

    lifted = K + 300 * by(sid["Ct"], 0)  # a frame that moves along x: its root pushes
    expected = under(tmp_path, cell, {"g.ax": -300.0}, loads={"g": {"type": "acceleration"}})
    assert abs(expected - at_rest).max() > 0.05 * at_rest[0]
    assert lowest(lifted, M) == pytest.approx(expected, rel=2e-3)


def test_what_holds_the_body_does_not_matter(tmp_path: Path) -> None:
    """All loads at once are in equilibrium: their stress is the same whatever interface balances
    each by itself."""
    bodies = []
    for held in ("root", "tip"):
        folder = tmp_path / held
        folder.mkdir()
        options = ("-mor_frame", "buckens", "-mor_frame_interface", held)
        bodies.append(stiffened(folder, "hexahedron", 1, *options)[0])
    first, second = (rom.frame.integrals for rom in bodies)
    assert first is not None and second is not None
    assert bodies[0].V == pytest.approx(bodies[1].V, abs=1e-10 * abs(bodies[0].V).max())
    # Pulled at both ends along the axis through its centre, the body is lifted by what is left.
    forces = {"tip.fx": 500.0, "root.fx": -200.0, "frame.ax": 300.0 / first.mass}
    sums = [
        sum(x * body.stiffening[load] for load, x in forces.items() if load in body.stiffening)
        for body in (first, second)
    ]
    assert "root.fx" in second.stiffening and "root.fx" not in first.stiffening
    assert sums[1] == pytest.approx(sums[0], abs=1e-8 * abs(sums[0]).max())


SPIN_ABOUT_Z: dict[str, Any] = {"turn": {"type": "spin", "axis": [0, 0, 1], "point": [1, 0, 0]}}


@pytest.mark.parametrize("way", ["cut", "reduce", "inputs"])
def test_the_frame_follows_what_holds_the_body(way: str, tmp_path: Path) -> None:
    """A frame at the tip: the stress is that of a body held there, whatever `certify` knew."""
    at_tip = ("-mor_frame", "tangent", "-mor_frame_interface", "tip")
    if way == "cut":
        stiffened(tmp_path, "tetra10", 1, "-mor_medium_out", tmp_path / "medium.h5")
        run(
            *("cut", "-medium", tmp_path / "medium.h5", "-mor_tol", "1e-5", *at_tip),
            *("-mor_out", tmp_path / "rom.h5"),
        )
    else:
        more = at_tip if way == "reduce" else ("-mor_inputs", "tip")
        _, said = stiffened(tmp_path, "tetra10", 1, *more)
        assert "tip holds the body" in said
    rom = ReducedModel.load(tmp_path / "rom.h5").elastic()
    assert rom.frame.integrals is not None
    stiffening, K, M = rom.frame.integrals.stiffening, rom.system.K, rom.system.M
    # about z through the tip at x = 1: the origin is accelerated by ω² along x
    across = rom.frame.integrals.inertia_second[2, :, 2, :]
    spun = stiffening["frame.spinzz"] + stiffening["frame.ax"] - across
    expected = under(tmp_path, "tetra10", {"turn.spin": SPEED**2}, "tip", loads=SPIN_ABOUT_Z)
    assert abs(expected - lowest(K, M)).max() > 0.2 * lowest(K, M)[0]
    assert lowest(K + SPEED**2 * spun, M) == pytest.approx(expected, rel=3e-3)


def test_stiffening_turns_with_the_body(tmp_path: Path) -> None:
    """Of a body in other axes: each motion of the frame, products of speeds about oblique axes."""
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
    bodies = []
    for name, turned in (("first", np.eye(3)), ("second", turn)):
        (tmp_path / name).mkdir()
        rom = stiffened(tmp_path / name, "hexahedron20", turned=turned)[0].elastic()
        assert rom.frame.integrals is not None
        bodies.append((rom.system.K, rom.system.M, rom.frame.integrals.stiffening))

    def vectors(of: Any, start: str, v: Any) -> Any:
        return sum(v[c] * of[f"{start}{'xyz'[c]}"] for c in range(3))

    def spun(of: Any, w: Any) -> Any:
        products = [w[a] * w[b] for a, b in SPINS]
        return np.tensordot(products, frame_stiffening(of)["stiffening"][6:], 1)

    for v in ([1.0, 0.5, -0.3], [0.0, 1.0, 1.0], [-1.0, 0.0, 0.6]):
        there = turn @ np.array(v)
        for what, scale in (("frame.a", 400.0), ("frame.alpha", 400.0), ("tip.f", 200.0)):
            first, second = (
                lowest(K + scale * vectors(of, what, axis), M)
                for (K, M, of), axis in zip(bodies, (v, there), strict=True)
            )
            assert second == pytest.approx(first, rel=1e-5)
            assert abs(first - lowest(*bodies[0][:2])).max() > 1e-3 * first[0]
        first, second = (
            lowest(K + 900 * spun(of, axis), M)
            for (K, M, of), axis in zip(bodies, (v, there), strict=True)
        )
        assert second == pytest.approx(first, rel=1e-5)
        assert abs(first - lowest(*bodies[0][:2])).max() > 1e-2 * first[0]


def test_a_medium_model_keeps_it(tmp_path: Path) -> None:
    rom, _ = stiffened(tmp_path, "hexahedron")
    medium = tmp_path / "medium.h5"
    run(
        *("certify", "-body", tmp_path / "free.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-5"),
        *("-mor_stiffening", "yes", "-mor_medium_out", medium),
    )
    run(
        *("cut", "-medium", medium, "-mor_tol", "1e-5", "-mor_frame", "tangent"),
        *("-mor_out", tmp_path / "cut.h5"),
    )
    direct, cut = (b.elastic() for b in (rom, ReducedModel.load(tmp_path / "cut.h5")))
    assert direct.frame.integrals is not None and cut.frame.integrals is not None
    assert list(cut.frame.integrals.stiffening) == list(direct.frame.integrals.stiffening)
    for load, speed in (("frame.spinzz", 30.0), ("frame.spinxx", 50.0), ("tip.fx", 20.0)):
        of = [
            lowest(b.system.K + speed**2 * b.frame.integrals.stiffening[load], b.system.M)
            for b in (direct, cut)
        ]
        assert of[1] == pytest.approx(of[0], rel=1e-6)


def test_what_has_no_stiffening(tmp_path: Path) -> None:
    assert frame_stiffening({}) == {}
    write_matrices(tmp_path / "matrices.h5", np.eye(3), np.eye(3), np.eye(3)[:, :1], beta=1e-3)
    said = run("reduce", "-body", tmp_path / "matrices.h5", "-mor_stiffening", "yes", expect=1)
    assert "--stiffening needs the mesh" in said.err
    blade(tmp_path / "held.h5", "hexahedron", "root")
    rom = tmp_path / "held.rom.h5"
    said = run(
        *("reduce", "-body", tmp_path / "held.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-4"),
        *("-mor_stiffening", "yes", "-mor_out", rom),
    )
    assert "held by its supports" in said.out
    integrals = ReducedModel.load(rom).frame.integrals
    assert integrals is not None and len(integrals.stiffening) == 18
    blade(tmp_path / "pulled.h5", "hexahedron", "root", preload={"tip.fx": 1.0})
    said = run("reduce", "-body", tmp_path / "pulled.h5", "-mor_stiffening", "yes", expect=1)
    assert "a body at rest" in said.err
    known = {"soft": MATERIAL | {"parameter": {"E": [1e9, 2e9]}}}
    blade(tmp_path / "known.h5", "hexahedron", "root", materials=known)
    said = run("reduce", "-body", tmp_path / "known.h5", "-mor_stiffening", "yes", expect=1)
    assert "known between two numbers one value" in said.err
    blade(tmp_path / "free.h5", "hexahedron")
    said = run(
        *("reduce", "-body", tmp_path / "free.h5", "-mor_band_hz", "1,300", "-mor_tol", "1e-4"),
        *("-mor_stiffening", "yes", "-mor_frame_interface", "tipp", "-mor_out", tmp_path / "x.h5"),
        expect=1,
    )
    assert "did you mean tip?" in said.err
    with pytest.raises(BodyError, match="dialect"):
        write_sid(ReducedModel.load(rom), tmp_path / "x.SID_FEM", "none")
