"""Point masses, springs and dashpots of mesh bodies, against rigid bodies, closed forms and
matrices made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg as sl
from test_preload import line

import flexgram
from bodies import box
from conftest import assembled, body_system, read_sparse, run
from flexgram import BodyError
from flexgram.body.description import import_description
from flexgram.body.whole import mass_facts

STEEL = {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}}
CLAMPED = ["x", "y", "z", "rx", "ry", "rz"]
DISC = {"at": "tip", "mass": 3.0, "inertia": [0.02, 0.011, 0.012, 0.001, -0.002, 0.0005]}
TENSOR = np.array([[0.02, 0.001, 0.0005], [0.001, 0.011, -0.002], [0.0005, -0.002, 0.012]])


def beam(path: Path, **more: Any) -> dict[str, Any]:
    content = {
        "materials": STEEL,
        "sections": {"bar": {"shape": "rectangle", "width": 0.02, "height": 0.03}},
        "regions": {"all": {"material": "steel", "section": "bar"}},
        "interfaces": {
            "tip": {"coupling": "node", "nodes": "end"},
            "foot": {"coupling": "node", "nodes": "start"},
        },
    }
    return import_description(content | more, "beam", path, mesh=line(8, 0.0, 1.0))


def matrices(folder: Path, name: str, ranks: int = 1, **more: Any) -> dict[str, Any]:
    beam(folder / f"{name}.h5", **more)
    a = assembled(folder / f"{name}_matrices.h5", folder / f"{name}.h5", ranks)
    with h5py.File(folder / f"{name}_matrices.h5") as file:
        for which in ("D", "S", "G"):
            if which in file:
                a[which] = read_sparse(file, which).toarray()
    a["K"], a["M"] = a["K"].toarray(), a["M"].toarray()
    a["at"] = lambda node: [
        int(np.flatnonzero((a["node"] == node) & (a["component"] == c))[0]) for c in range(6)
    ]
    return a


@pytest.mark.parametrize("ranks", [1, 2])
def test_what_they_add(ranks: int, tmp_path: Path) -> None:
    """M, K, D and S beside those of the beam, entry by entry."""
    plain = matrices(tmp_path, "plain", ranks)
    k6 = np.diag([1e5, 2e5, 3e5, 40.0, 50.0, 60.0])
    a = matrices(
        tmp_path,
        "all",
        ranks,
        masses={"disc": DISC, "some": {"nodes": [3, 4], "mass": 0.5}},
        springs={
            "mount": {"at": "foot", "stiffness": np.diag(k6).tolist(), "damping": [10, 20, 30]},
            "rod": {"nodes": [2], "to_nodes": [7], "stiffness": 1e6, "loss_factor": 0.1},
        },
    )
    M, K = plain["M"].copy(), plain["K"].copy()
    at = a["at"]
    M[np.ix_(at(8), at(8))] += sl.block_diag(3.0 * np.eye(3), TENSOR)
    for node in (2, 3):
        M[at(node)[:3], at(node)[:3]] += 0.5
    K[np.ix_(at(0), at(0))] += k6
    rod = 1e6 * np.array([[1, -1], [-1, 1]])
    ends = [at(1)[0], at(6)[0]]
    K[np.ix_(ends, ends)] += rod
    assert plain["M"] != pytest.approx(M) and plain["K"] != pytest.approx(K)
    np.testing.assert_allclose(a["M"], M, atol=1e-12 * abs(M).max())
    np.testing.assert_allclose(a["K"], K, atol=1e-12 * abs(K).max())
    D, S = np.zeros_like(K), np.zeros_like(K)
    D[at(0)[:3], at(0)[:3]] = [10, 20, 30]
    S[np.ix_(ends, ends)] = 0.1 * rod
    np.testing.assert_allclose(a["D"], D, atol=1e-12)
    np.testing.assert_allclose(a["S"], S, atol=1e-12 * abs(S).max())


def test_a_spring_between_places_resists_no_rigid_motion(tmp_path: Path) -> None:
    """Of six stiffnesses between nodes far apart: it acts midway, each end carries its arm."""
    stiffness = np.diag([1e5, 2e5, 3e5, 40.0, 50.0, 60.0])
    plain = matrices(tmp_path, "plain")
    a = matrices(
        tmp_path,
        "tied",
        springs={"tie": {"at": "foot", "to": "tip", "stiffness": np.diag(stiffness).tolist()}},
    )
    added = a["K"] - plain["K"]
    rigid = np.zeros((len(added), 6))
    x = np.linspace(0, 1, 9)
    for node in range(9):
        at = a["at"](node)
        rigid[at[:3], [0, 1, 2]] = 1
        rigid[at[3:], [3, 4, 5]] = 1
        rigid[at[2], 4], rigid[at[1], 5] = -x[node], x[node]  # θ × x
    assert abs(added).max() > 1e4
    assert abs(added @ rigid).max() < 1e-10 * abs(added).max()
    moved = np.zeros(len(added))  # the ends turn against each other: z midway is equal
    moved[a["at"](0)[4]], moved[a["at"](8)[4]] = 0.5, -0.5
    # u_z midway: -0.5·0.5 of the first, -0.5·0.5 of the other
    assert moved @ added @ moved == pytest.approx(50.0 * 1.0)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_mass_on_a_rigid_interface(ranks: int, tmp_path: Path) -> None:
    """What it adds to M at the reference, and to mass, centre and inertia of the body."""
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end", "position": [0.5, 0.02, 0.03]}},
        "supports": {"root": {"nodes": "start"}},
    }
    mesh = box("hexahedron20", (8, 1, 1), (0.5, 0.04, 0.06), distort=False)
    position = np.array([0.5, 0.02, 0.03])
    mass, J = 5.0, np.diag([0.01, 0.02, 0.015])
    content["masses"] = {"block": {"at": "tip", "mass": mass, "inertia": np.diag(J).tolist()}}
    facts = import_description(content, "bar", tmp_path / "with.h5", mesh=mesh)
    assert "mass block: 5 kg" in " ".join(facts["summary"])
    in_mm = {
        "units": "mm-t-s",
        "springs": {"mount": {"at": "tip", "stiffness": [700, 0, 0, 5, 0, 0]}},
        "preload": {"tip.fx": -2000},
    }
    said = import_description(content | in_mm, "bar", tmp_path / "mm.h5", mesh=mesh)["summary"]
    assert "spring mount: to ground, 7e+05, 0, 0 N/m, 0.005, 0, 0 N m a radian" in said
    assert "preload tip.fx: -2000 (SI)" in said
    without = {k: v for k, v in content.items() if k != "masses"}
    import_description(without, "bar", tmp_path / "without.h5", mesh=mesh)
    a, b = (
        assembled(tmp_path / f"{name}_m.h5", tmp_path / f"{name}.h5", ranks)
        for name in ("with", "without")
    )
    added = (a["M"] - b["M"]).toarray()
    rows = np.flatnonzero(abs(added).max(axis=1) > 0)
    expected = sl.block_diag(mass * np.eye(3), J)
    np.testing.assert_allclose(added[np.ix_(rows, rows)], expected, atol=1e-12 * mass)
    assert abs(a["K"] - b["K"]).max() == 0
    with h5py.File(tmp_path / "with.h5") as file, h5py.File(tmp_path / "without.h5") as other:
        whole, bar = mass_facts(file), mass_facts(other)
    assert whole.mass == pytest.approx(bar.mass + mass)
    centre = (bar.mass * bar.centre + mass * position) / whole.mass
    assert whole.centre == pytest.approx(centre)

    def about(m: float, at: Any) -> Any:
        d = at - centre
        return m * (d @ d * np.eye(3) - np.outer(d, d))

    inertia = bar.inertia + J + about(bar.mass, bar.centre) + about(mass, position)
    assert whole.inertia == pytest.approx(inertia, abs=1e-12)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_body_on_springs_is_certified(ranks: int, tmp_path: Path) -> None:
    beam(
        tmp_path / "body.h5",
        masses={"disc": DISC},
        springs={
            "mount": {"at": "foot", "stiffness": [1e5, 2e5, 3e5, 4e3, 5e3, 6e3], "damping": [9] * 6}
        },
    )
    run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "1,400", "-mor_tol", "1e-5"),
        *("-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    )
    run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5", ranks=ranks)
    full, rom = body_system(tmp_path / "m.h5"), flexgram.ReducedModel.load(tmp_path / "rom.h5")
    assert rom.certified_error <= 1e-5 and rom.claim.kind == "certified"
    for omega in 2 * np.pi * np.geomspace(1, 400, 23):
        H, H_r = full.transfer(omega), rom.transfer([omega])[0]
        assert np.linalg.norm((H_r - H).astype(complex)) <= 1e-5 * np.linalg.norm(H.astype(complex))


@pytest.mark.filterwarnings("ignore::flexgram.ReductionWarning")  # a shaft that weighs nothing
def test_a_disc_whirls(tmp_path: Path) -> None:
    """A rigid rotor on soft springs, in both frames: bounce and twist of a rigid disc, and whirl by
    J_d θ'' ± iΩJ_pθ' + k_rθ = 0; in the turning frame frequencies are Ω less and more."""
    J_d, J_p, mass, k, k_r, speed = 0.03, 0.05, 4.0, 4e4, 900.0, 120.0
    content = {
        "materials": {"light": {"E": 210e9, "nu": 0.3, "rho": 1e-3}},
        "sections": {"bar": {"shape": "circle", "radius": 0.05}},
        "regions": {"all": {"material": "light", "section": "bar"}},
        "interfaces": {"hub": {"coupling": "node", "nodes": "start"}},
        "masses": {"disc": {"at": "hub", "mass": mass, "inertia": [J_p, J_d, J_d]}},
        "springs": {"ground": {"at": "hub", "stiffness": [k, k, k, k_r, k_r, k_r]}},
        "damping": {"beta": 1e-9},
    }
    found = {}
    for frame in ("rest", "turning"):
        spin = {"axis": [1, 0, 0], "from": 0, "to": speed, "frame": frame}
        import_description(
            content | {"spin": spin}, "disc", tmp_path / "body.h5", mesh=line(1, 0.0, 0.01)
        )
        rom = flexgram.reduce(tmp_path / "body.h5", (0.1, 200), 1e-6)
        poles = rom.at(speed=speed).poles()
        found[frame] = np.sort(poles.imag[(poles.imag > 0) & (abs(poles) < 1e4)])
    b = speed * J_p / (2 * J_d)
    whirl = np.sqrt(b**2 + k_r / J_d) + np.array([-b, b])
    bounce, twist = np.sqrt(k / mass), np.sqrt(k_r / J_p)
    at_rest = np.sort([bounce] * 3 + [twist, *whirl])
    assert found["rest"] == pytest.approx(at_rest, rel=1e-5)
    turned = [bounce, twist, bounce - speed, bounce + speed, whirl[0] + speed, whirl[1] - speed]
    assert found["turning"] == pytest.approx(np.sort(np.abs(turned)), rel=1e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"masses": {"a": {"mass": 1.0}}}, "give at"),
        ({"masses": {"a": {"at": "tip"}}}, "mass is missing"),
        ({"masses": {"a": {"at": "tip", "mass": -1}}}, "is negative"),
        ({"masses": {"a": {"at": "tipp", "mass": 1.0}}}, "must be one of"),
        ({"masses": {"a": {"at": "tip", "mass": 1.0, "inertia": [1, 2]}}}, "three numbers"),
        ({"springs": {"a": {"at": "tip"}}}, "stiffness is missing"),
        ({"springs": {"a": {"at": "tip", "stiffness": 5.0}}}, "along the line"),
        ({"springs": {"a": {"at": "tip", "stiffness": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}}}, "symm"),
        ({"springs": {"a": {"nodes": [1, 2], "to_nodes": [3, 4, 5], "stiffness": 1}}}, "ends at 3"),
        ({"springs": {"a": {"at": "tip", "to": "tip", "stiffness": [1, 1, 1]}}}, "to itself"),
        ({"springs": {"a": {"nodes": [1, 2], "to_nodes": [3, 2], "damping": [1, 1, 1]}}}, "itself"),
        (
            {"springs": {"a": {"at": "tip", "stiffness": [1, 1, 1], "loss_factor": -0.1}}},
            "loss_factor = -0.1 must be from 0 to 10",
        ),
    ],
)
def test_a_wrong_one_is_named(change: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        beam(tmp_path / "body.h5", **change)


@pytest.mark.parametrize(
    ("spring", "told"),
    [
        ({"stiffness": [1e4, 2e4, 2e4]}, False),
        ({"stiffness": [1e4, 2e4, 3e4]}, True),
        ({"stiffness": [1e4, 2e4, 2e4], "damping": [1, 1, 1]}, True),
    ],
)
@pytest.mark.parametrize("turns", ["spin", "preload"])
def test_the_ground_turns(spring: Any, told: bool, turns: str, tmp_path: Path) -> None:
    """In the frame that turns a bearing at rest is another one: about x both are alike or not."""
    more: dict[str, Any] = {"springs": {"mount": {"at": "foot"} | spring}}
    more["supports"] = {"pin": {"nodes": [5], "components": CLAMPED}}
    if turns == "spin":
        more["spin"] = {"axis": [1, 0, 0], "from": 0, "to": 50}
    else:
        more["loads"] = {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [1, 0, 0]}}
        more["preload"] = {"turn.spin": 100.0}
    beam(tmp_path / "body.h5", **more)
    said = run("assemble", "-body", tmp_path / "body.h5", "-body_out", tmp_path / "m.h5").out
    assert ("as supports do" in said) == told


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"masses": {"a": {"nodes": [30], "mass": 1, "inertia": [1, 1, 1]}}}, "has no rotations"),
        (
            {"masses": {"a": {"nodes": [30], "mass": 1, "inertia": [1, 1, -3]}}},
            "negative principal",
        ),
        (
            {"springs": {"a": {"nodes": [30], "to_nodes": [2], "stiffness": [1, 1, 1]}}},
            "has no rotations",
        ),
        ({"springs": {"a": {"nodes": [30], "stiffness": [-1, 1, 1]}}}, "negative eigenvalue"),
    ],
)
def test_what_assembly_refuses(change: Any, words: str, tmp_path: Path) -> None:
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
    }
    mesh = box("hexahedron", (6, 2, 2))
    import_description(content | change, "box", tmp_path / "body.h5", mesh=mesh)
    with pytest.raises(BodyError, match=words):
        flexgram.reduce(tmp_path / "body.h5", (100, 2000), 1e-3)


@pytest.mark.parametrize(
    ("stiffness", "words"),
    [
        ([[1e5, 2e5], 1e5, 1e5], "must be numbers, or rows of as many numbers each"),
        ("stiff", "must be numbers, or rows"),
        ([[1e5, 2e4, 0.0], [0.0, 1e5, 0.0], [0.0, 0.0, 1e5]], "add the skew part to its K"),
    ],
)
def test_a_stiffness_that_is_none(stiffness: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        beam(tmp_path / "body.h5", springs={"b": {"at": "tip", "stiffness": stiffness}})


def test_all_of_a_mesh_of_lines(tmp_path: Path) -> None:
    """Without a group of its own."""
    grouped = beam(tmp_path / "grouped.h5")
    mesh = line(8, 0.0, 1.0)
    mesh.cell_sets = {}
    content = {
        "materials": STEEL,
        "sections": {"bar": {"shape": "rectangle", "width": 0.02, "height": 0.03}},
        "regions": {"all": {"material": "steel", "section": "bar"}},
        "interfaces": {"tip": {"coupling": "node", "nodes": "end"}},
    }
    alone = import_description(content, "beam", tmp_path / "alone.h5", mesh=mesh)
    assert alone["elements"] == grouped["elements"] == 8


def test_a_mass_that_differs_by_direction_is_told_so(tmp_path: Path) -> None:
    facts = beam(tmp_path / "b.h5", masses={"sled": {"at": "tip", "matrix": [10.0, 0.0, 0.0]}})
    own = 0.02 * 0.03 * 7850.0
    said = next(line for line in facts["summary"] if line.startswith("mass along"))
    assert said.startswith(f"mass along x, y, z {own + 10:.6g}, {own:.6g}, {own:.6g} kg; of their")
    plain = beam(tmp_path / "p.h5")
    assert any(line.startswith(f"mass {own:.6g} kg, centre") for line in plain["summary"])
