"""Bodies that spin at a speed known between two numbers: their matrices against those under a
preload at each speed, closed forms and published frequencies, and claims against elimination."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.sparse as sp
from test_preload import CLAMPED, RHO, STEEL, E, import_beam, line

import flexgram
from bodies import box
from conftest import assembled, read_sparse, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.assembly.couple import couple
from flexgram.body.description import import_description
from flexgram.model.campbell import campbell

TWO_PI = 2 * np.pi
TOP = 3.0  # rad/s, of the blade


def blade(count: int = 12) -> dict[str, Any]:
    """Masses on a string that moves along it and across it, in the plane in which it turns: tension
    by the centrifugal load, softening, Coriolis forces."""
    rng = np.random.default_rng(1)
    mass, x = 1 + rng.random(count), 0.1 * np.arange(1, count + 1)

    def between(k: Any) -> Any:
        return np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)

    tension = np.append(np.cumsum((mass * x)[::-1])[::-1], 0) / 0.1
    K = np.kron(between(1e3 * (1 + rng.random(count + 1))), np.diag([1.0, 0.6]))
    M = np.kron(np.diag(mass), np.eye(2))
    B = np.zeros((2 * count, 2))
    B[-2, 0] = B[-1, 1] = 1
    return {
        "K": sp.csc_matrix(K),
        "M": sp.csc_matrix(M),
        "B": B,
        "S": sp.csc_matrix(np.kron(between(tension), np.diag([0, 1.0])) - M),
        "G": sp.csc_matrix(np.kron(np.diag(2 * mass), np.array([[0, -1.0], [1.0, 0]]))),
    }


def terms_of(body: dict[str, Any]) -> dict[str, Any]:
    return {
        "stiffening": (body["S"], flexgram.spin(0, TOP)),
        "coriolis": (body["G"], flexgram.coriolis(0, TOP)),
    }


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_claim_over_speeds(ranks: int, tmp_path: Path) -> None:
    body, tolerance, band = blade(), 1e-3, (0.2, 1.6)
    write_matrices(
        tmp_path / "body.h5", body["K"], body["M"], body["B"], alpha=0.1, beta=1e-3,
        terms=terms_of(body),
    )  # fmt: skip
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_tol", tolerance),
        *("-mor_band_hz", "0.2,1.6", "-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    ).out
    assert "speed from 0 to 3" in said and "a spin takes from the stiffness 3² of the mass" in said
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.kind == "certified" and rom.certified_error <= tolerance and rom.order < 24
    assert rom.claim.parameters == ["speed"] and len(rom.claim.parameter_values) >= 5
    assert len(rom.claim.all_values) and "with every value of the parameters" in said
    worst = 0.0
    for speed in [*rom.claim.parameter_values[:, 0], 0.4, 1.234, 2.9]:
        chosen = speed in rom.claim.parameter_values
        one = rom.at(speed=speed)
        claim = rom.certified_error if chosen else rom.claim.all_values[0]
        assert one.kind == "certified" and one.certified_error == claim <= tolerance
        omega = np.concatenate([TWO_PI * np.linspace(*band, 150), abs(one.poles().imag)])
        D = 0.1 * body["M"] + 1e-3 * body["K"] + speed * body["G"]
        for w in omega[(omega >= TWO_PI * band[0]) & (omega <= TWO_PI * band[1])]:
            A = body["K"] + speed**2 * body["S"] + 1j * w * D - w**2 * body["M"]
            H = body["B"].T @ np.linalg.solve(A.toarray(), body["B"])
            error = np.linalg.norm(one.transfer([w])[0] - H) / np.linalg.norm(H)
            assert error <= claim
            worst = max(worst, error) if chosen else worst
    assert worst > 0.3 * rom.certified_error
    # As a file of one speed.
    run("at", tmp_path / "rom.h5", "speed=2", "-o", tmp_path / "two.h5")
    two = ReducedModel.load(tmp_path / "two.h5")
    np.testing.assert_allclose(two.transfer([5.0]), rom.at(speed=2.0).transfer([5.0]), rtol=1e-12)
    with pytest.raises(BodyError, match=r"speed = 4: the body knows speed from 0 to 3"):
        rom.at(speed=4.0)
    with pytest.raises(BodyError, match="circulatory forces are skew"):
        couple({"a": rom}, [])


KINDS = ("tetra", "tetra10", "hexahedron", "hexahedron20", "wedge15")


@pytest.mark.parametrize("load", ["spin", "spin and force"])
@pytest.mark.parametrize("kind", [*KINDS, "beam"])
def test_matrices_are_those_of_each_speed(kind: str, load: str, tmp_path: Path) -> None:
    """K + (Ω² - least²)S + (Ω⁴ - least⁴)Q and ΩG, against a preload with that spin."""
    axis = {"point": [0.01, -0.02, 0.005], "axis": [0, 3, 4]}
    force = {"tip.fx": 3e4, "tip.fz": -2e4} if "force" in load else {}
    mesh = line(6, 0.1, 0.5) if kind == "beam" else box(kind, (3, 2, 1))
    content: dict[str, Any] = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
    }
    if kind == "beam":
        content |= {
            "sections": {"bar": {"shape": "rectangle", "width": 0.02, "height": 0.03}},
            "regions": {"all": {"material": "steel", "section": "bar"}},
            "interfaces": {"tip": {"coupling": "node", "nodes": "end"}},
            "supports": {"start": {"nodes": "start", "components": CLAMPED}},
        }
    first, ranged = 400.0, axis | {"from": 400.0, "to": 3000.0}
    more = {"preload": force} if force else {}
    import_description(content | more | {"spin": ranged}, "box", tmp_path / "range.h5", mesh=mesh)
    a = assembled(tmp_path / "range.m.h5", tmp_path / "range.h5")
    with h5py.File(tmp_path / "range.m.h5") as file:
        S, G = (read_sparse(file, f"terms/{name}") for name in ("spin", "coriolis"))
        moved = read_sparse(file, "terms/spin_moved") if "spin_moved" in file["terms"] else 0 * S
    for speed in (400.0, 1100.0, 3000.0):
        other = {
            "loads": {"turn": axis | {"type": "spin"}},
            "preload": force | {"turn.spin": speed**2},
        }
        import_description(content | other, "box", tmp_path / "one.h5", mesh=mesh)
        one = assembled(tmp_path / "one.m.h5", tmp_path / "one.h5")
        K = a["K"] + (speed**2 - first**2) * S + (speed**4 - first**4) * moved
        added = abs(one["K"] - a["K"]).max() if speed > first else abs(one["K"]).max()
        assert abs(K - one["K"]).max() < 1e-9 * added
        assert abs(speed * G - one["G"]).max() < 1e-10 * abs(one["G"]).max()
        assert abs(a["M"] - one["M"]).max() < 1e-12 * abs(a["M"]).max()


@pytest.mark.parametrize("ranks", [1, 2])
def test_flap_of_a_beam_over_its_speeds(ranks: int, tmp_path: Path) -> None:
    """Wright et al. 1982, speeds 6 and 12; of one reduced body. Another mode passes near."""
    side, length = 0.02, 1.0
    unit = np.sqrt(E * side**2 / 12 / RHO) / length**2
    import_beam(
        tmp_path / "body.h5",
        line(40, 0, length),
        side,
        damping={"alpha": 1.0},
        spin={"axis": [0, 0, 1], "rpm": [0, 12 * unit * 30 / np.pi]},
    )
    run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", f"1,{9 * unit / TWO_PI}"),
        *("-mor_outputs", "end.fy,end.fz", "-mor_inputs", "end.fy,end.fz", "-mor_tol", "1e-3"),
        *("-mor_out", tmp_path / "rom.h5"),
        ranks=ranks,
    )
    rom = ReducedModel.load(tmp_path / "rom.h5")
    found = campbell(rom.system, np.array([0.0, 6.0, 12.0]) * unit)
    for omega, published in zip(found.omega / unit, (3.5160, 7.3604, 13.1702), strict=True):
        assert np.min(abs(omega / published - 1)) < 2e-3


def shaft(path: Path, top: float, frame: str, pins: tuple[float, float] = (0, 1)) -> float:
    """A round shaft without shear, simply supported; its first frequency at rest, about."""
    radius, length = 0.02, 1.0
    A, I = np.pi * radius**2, np.pi * radius**4 / 4  # noqa: E741
    section = {"shape": "general", "A": A, "I_y": I, "I_z": I, "J": 2 * I, "k_y": 1e4, "k_z": 1e4}
    mesh = line(30, 0, length)
    mesh.point_sets["off"] = np.array([9])
    content = {
        "materials": STEEL,
        "sections": {"round": section},
        "regions": {"all": {"material": "steel", "section": "round"}},
        "interfaces": {"off": {"coupling": "node", "nodes": "off"}},
        "supports": {
            "left": {"nodes": "start", "components": ["x", "y", "z", "rx"]},
            "right": {"nodes": "end", "components": ["y", "z"]},
        },
        "damping": {"alpha": 4.0},
        "spin": {"axis": [1, 0, 0], "to": top, "frame": frame},
    }
    import_description(content, "shaft", path, mesh=mesh)
    return float(np.pi**2 * np.sqrt(E * I / (RHO * A)) / length**2)


def whirl(speed: float, mode: int) -> tuple[float, float]:
    """Backward and forward frequency of the shaft: EIk⁴ ± 2ρIΩk²ω - (ρA + ρIk²)ω² = 0 (with λ =
    ΩI_x/(2√(EIρS)) and without rotary inertia ω/ω₀ = √(λ² + 1) ± λ, Code_Aster V2.02.141)."""
    A, I = np.pi * 0.02**2, np.pi * 0.02**4 / 4  # noqa: E741
    k = mode * np.pi
    mass, turn = RHO * A + RHO * I * k**2, RHO * I * speed * k**2
    root = np.sqrt(turn**2 + mass * E * I * k**4)
    return (root - turn) / mass, (root + turn) / mass


def test_whirl_in_the_frame_at_rest(tmp_path: Path) -> None:
    top = 2e4
    shaft(tmp_path / "body.h5", top, "rest")
    ports = ("-mor_inputs", "off.fy,off.fz", "-mor_outputs", "off.fy,off.fz")
    said = run(
        *("reduce", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,400", *ports),
        *("-mor_tol", "1e-3", "-mor_out", tmp_path / "rom.h5"),
    ).out
    assert "gyroscopic moments of beams on its axis" in said
    system = ReducedModel.load(tmp_path / "rom.h5").system
    for speed in (0.3 * top, top):
        found = campbell(system, [0.5 * speed, speed], modes=4)
        assert not found.turning
        order = np.argsort(found.omega[-1])
        expected = [x for mode in (1, 2) for x in whirl(speed, mode)]
        np.testing.assert_allclose(found.omega[-1][order], expected, rtol=1e-4)
        assert np.all(np.sign(found.whirl[-1][order]) == [-1, 1, -1, 1])
        assert np.all(abs(found.whirl) > 0.99)  # circles
    for found in (campbell(system, modes=4), campbell(system, np.linspace(0, top, 301), 4)):
        critical = [one for one in found.critical((1.0,)) if one.mode < 2]
        for one in critical:  # whirl(Ω) = Ω
            backward, forward = whirl(one.speed, 1)
            own = forward if found.whirl[-1, one.mode] > 0 else backward
            assert abs(own / one.speed - 1) < 1e-3
        assert len(critical) == 2
    said = run("campbell", tmp_path / "rom.h5", "--orders", "1,2", "-o", tmp_path / "c.csv").out
    assert "frame at rest" in said and "1 times the speed, forward" in said
    rows = (tmp_path / "c.csv").read_text().splitlines()
    assert rows[0].startswith("speed [rad/s],mode,frequency") and len(rows) > 61
    run("campbell", tmp_path / "rom.h5", "--modes", "4", "-o", tmp_path / "c.png")
    assert (tmp_path / "c.png").stat().st_size > 10000
    assert "expected FROM,TO" in run("campbell", tmp_path / "rom.h5", "--speeds", "1", expect=1).err


def test_the_same_shaft_in_both_frames(tmp_path: Path) -> None:
    """Forward whirl is slower by the speed in the frame that turns, backward whirl faster. What
    meets 0 Hz there is the critical speed, which the assembly tells too."""
    first = shaft(tmp_path / "turning.h5", 700.0, "turning")
    ports = ("-mor_inputs", "off.fy,off.fz", "-mor_outputs", "off.fy,off.fz")
    said = run(
        *("reduce", "-body", tmp_path / "turning.h5", "-mor_band_hz", "1,200", *ports),
        *("-mor_tol", "1e-3", "-mor_out", tmp_path / "rom.h5"),
    )
    told = next(line for line in said.out.splitlines() if "critical speed" in line)
    assert abs(float(told.split("about")[1].split()[0]) / first - 1) < 0.01
    rom = ReducedModel.load(tmp_path / "rom.h5")
    assert rom.kind == "certified"
    found = campbell(rom.system, np.linspace(0, 700, 36), modes=2)
    assert found.turning
    for i in (5, 12, 35):
        speed = found.speeds[i]
        backward, forward = whirl(speed, 1)
        expected = sorted([backward + speed, abs(forward - speed)])
        np.testing.assert_allclose(np.sort(found.omega[i]), expected, rtol=2e-3)
    (critical,) = found.critical((0.0,))
    assert abs(critical.speed / first - 1) < 2e-3
    # Damping that turns with the shaft makes forward whirl grow beyond the critical speed.
    assert np.all(found.growth[found.speeds < 0.98 * first] < 0)
    assert np.all(found.growth[found.speeds > 1.02 * first] > 0)
    assert "is unstable with speed = 700" in said.out + said.err
    grows = run("campbell", tmp_path / "rom.h5").out
    told = next(line for line in grows.splitlines() if "meets 0 Hz, where an unbalance" in line)
    assert abs(float(told.split("speed")[1].split()[0]) / first - 1) < 2e-3
    speed = float(grows.split("unstable from ")[1].split()[0])
    assert abs(speed / first - 1) < 2e-3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"from": 10.0, "to": 5.0}, "speeds must rise"),
        ({"rpm": [0, 10], "to": 5.0}, "not both"),
        ({"rpm": 3}, r"rpm = 3 must be \[from, to\]"),
        ({"to": 5.0, "axis": [0, 0, 0]}, "no direction"),
        ({"to": 5.0, "frame": "inertial"}, "must be one of turning, rest"),
        ({"to": 5.0, "unit": "rpm"}, "unit"),
    ],
)
def test_a_wrong_spin_is_named(change: Any, words: str, tmp_path: Path) -> None:
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "spin": {"axis": [0, 0, 1]} | change,
    }
    with pytest.raises(BodyError, match=words):
        import_description(content, "box", tmp_path / "b.h5", mesh=box("tetra", (2, 1, 1)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"spin": {"axis": [0, 0, 1], "to": 5.0, "frame": "rest"}},
            "solids are bodies of revolution about its axis",
        ),
        (
            {
                "loads": {"t": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}},
                "preload": {"t.spin": 4.0},
            },
            "it turns at one speed",
        ),
        ({"supports": {}}, "needs supports"),
        (
            {"materials": {"steel": STEEL["steel"] | {"parameter": {"E": [1e11, 3e11]}}}},
            "depends on E_steel",
        ),
    ],
)
def test_a_spin_that_is_not_taken(change: Any, words: str, tmp_path: Path) -> None:
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "spin": {"axis": [0, 0, 1], "to": 5.0},
    }
    import_description(content | change, "box", tmp_path / "b.h5", mesh=box("tetra", (2, 1, 1)))
    said = run("assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5", expect=1)
    assert words in said.err


def test_beams_beside_the_axis_and_flat_ones(tmp_path: Path) -> None:
    for section, points, words in (
        ({"width": 0.02, "height": 0.02}, [[0, 0, 0.1], [1, 0, 0.1]], "lie on the axis"),
        ({"width": 0.02, "height": 0.03}, [[0, 0, 0], [1, 0, 0]], "have I_y = I_z"),
    ):
        mesh = meshio.Mesh(
            np.array(points, float), [("line", np.array([[0, 1]]))],
            point_sets={"start": np.array([0]), "end": np.array([1])},
            cell_sets={"all": [np.array([0])]},
        )  # fmt: skip
        content = {
            "materials": STEEL,
            "sections": {"bar": {"shape": "rectangle"} | section},
            "regions": {"all": {"material": "steel", "section": "bar"}},
            "interfaces": {"end": {"coupling": "node", "nodes": "end"}},
            "supports": {"start": {"nodes": "start", "components": CLAMPED}},
            "spin": {"axis": [1, 0, 0], "to": 5.0, "frame": "rest"},
        }
        import_description(content, "bar", tmp_path / "b.h5", mesh=mesh)
        words_of = run(
            "assemble", "-body", tmp_path / "b.h5", "-body_out", tmp_path / "m.h5", expect=1
        ).err
        assert words in words_of


def test_speeds_that_do_not_fit_each_other(tmp_path: Path) -> None:
    body = blade(4)
    terms = terms_of(body) | {"coriolis": (body["G"], flexgram.coriolis(0, 2 * TOP))}
    matrices = flexgram.Matrices(
        body["K"].tocsr(), body["M"].tocsr(), body["B"], alpha=0.1, terms=terms
    )
    with pytest.raises(BodyError, match="most of speed is 3 and 6"):
        flexgram.reduce(matrices, (0.2, 1.0), 1e-3)
    skew = {"coriolis": (body["M"], flexgram.coriolis(0, TOP))}
    matrices = flexgram.Matrices(
        body["K"].tocsr(), body["M"].tocsr(), body["B"], alpha=0.1, terms=skew
    )
    with pytest.raises(BodyError, match="coriolis is not skew"):
        flexgram.reduce(matrices, (0.2, 1.0), 1e-3)
    with pytest.raises(BodyError, match="power 3 must be 2 or 4"):
        flexgram.spin(0, 3, power=3)
    for make in (flexgram.spin, flexgram.coriolis):
        with pytest.raises(BodyError, match="must rise from 0"):
            make(5, 3)
        with pytest.raises(BodyError, match="must be from 1 to 3"):
            make(1, 3, 4)


def test_a_body_without_speeds_has_no_diagram() -> None:
    body = blade(4)
    matrices = flexgram.Matrices(body["K"].tocsr(), body["M"].tocsr(), body["B"], alpha=0.1)
    rom = flexgram.reduce(matrices, (0.2, 1.0), order=4)
    with pytest.raises(BodyError, match="no range of speeds"):
        campbell(rom.system)


@pytest.mark.parametrize("damping", [{"eta": 0.05, "alpha": 0.0}, {"beta": 0.01, "alpha": 0.0}])
def test_losses_belong_to_the_stiffness_at_the_least_speed(
    damping: dict[str, float], tmp_path: Path
) -> None:
    """At a speed, in memory and as a file that the program reads, as elimination has it."""
    body = blade(6)
    write_matrices(
        tmp_path / "body.h5", body["K"], body["M"], body["B"], terms=terms_of(body), **damping
    )
    rom = flexgram.reduce(tmp_path / "body.h5", (0.2, 1.2), 1e-4)
    one = rom.at(speed=TOP)
    one.save(tmp_path / "one.h5")
    run(
        *("sweep", "-body", tmp_path / "body.h5", "-rom", tmp_path / "one.h5"),
        *("-mor_sweep_hz", "0.2,1.2,5", "-mor_sweep_out", tmp_path / "s.h5"),
    )
    with h5py.File(tmp_path / "s.h5") as file:
        omega, seen = file["omega"][:], file["error/relative"][:]
    for w, error in zip(omega, seen, strict=True):
        K = body["K"] * (1 + 1j * damping.get("eta", 0) + 1j * w * damping.get("beta", 0))
        A = K + TOP**2 * body["S"] + 1j * w * TOP * body["G"] - w**2 * body["M"]
        H = body["B"].T @ np.linalg.solve(A.toarray(), body["B"])
        assert np.linalg.norm(one.transfer([w])[0] - H) <= 1e-4 * np.linalg.norm(H)
        assert error <= 1e-4


def test_a_blade_beside_its_axis(tmp_path: Path) -> None:
    """It bends far, so that its spin takes thousands of times Ω² of the mass: reduced all the same.
    Against the body under that spin as a preload."""
    mesh = box("hexahedron", (3, 1, 1), (0.5, 0.02, 0.03), distort=False)
    content = {
        "materials": {"soft": {"E": 2e9, "nu": 0.3, "rho": 2000.0}},
        "regions": {"all": {"material": "soft"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"root": {"nodes": "start"}},
        "damping": {"alpha": 40.0},
    }
    turn = {"turn": {"type": "spin", "point": [0, 0, 0], "axis": [0, 0, 1]}}
    body, still, out = (tmp_path / name for name in ("body.h5", "still.h5", "rom.h5"))
    import_description(content | {"spin": {"axis": [0, 0, 1], "to": 100.0}}, "a", body, mesh=mesh)
    said = run(
        *("reduce", "-body", body, "-mor_band_hz", "5,30", "-mor_tol", "1e-2"),
        *("-mor_parameter_values", "2", "-mor_inputs", "tip.fy", "-mor_outputs", "tip.fy"),
        *("-mor_out", out),
    ).out
    assert "a spin takes from the stiffness" in said
    rom = ReducedModel.load(out).at(speed=100.0)
    loaded = content | {"loads": turn, "preload": {"turn.spin": 1e4}}
    import_description(loaded, "b", still, mesh=mesh)
    a = assembled(tmp_path / "m.h5", still)
    K, M, G = (a[name].toarray() for name in "KMG")
    b = a["B"][:, a["names"].index("tip.fy")]
    assert rom.kind == "certified"
    for hertz in (5.0, 13.3, 18.7, 29.9):
        w = 2 * np.pi * hertz
        H = b @ np.linalg.solve(K + 1j * w * (40.0 * M + G) - w * w * M, b)
        assert abs(rom.transfer(w)[0, 0] - H) <= rom.certified_error * abs(H)
