"""Reactions of supports as outputs: against the matrices of the body without its supports, against
CalculiX, by the balance of forces, and their claims."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from test_importers import write_deck
from test_mesh_loads import RHO, sided

from bodies import CALCULIX
from conftest import (
    assembled,
    assert_certified,
    body_system,
    certified,
    chain,
    message,
    run,
    sweep_transfer,
)
from flexgram import BodyError, ReducedModel, ReductionWarning, reduce, write_matrices
from flexgram.body.description import import_description
from flexgram.body.matrices import Matrices
from flexgram.model.system import System

POINT = [0.01, -0.02, 0.005]
LETTERS = ("rx", "ry", "rz", "rmx", "rmy", "rmz")
STEEL = {"E": 210e9, "nu": 0.3, "rho": RHO, "expansion": 12e-6}


def write_body(path: Path, mesh: Any, **changes: Any) -> dict[str, Any]:
    content = {
        "materials": {"steel": STEEL},
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "loads": {
            "gravity": {"type": "acceleration"},
            "turn": {"type": "spin", "point": POINT, "axis": [1, 2, -1]},
            "skin": {"type": "pressure", "nodes": "all"},
            "warm": {"type": "temperature", "nodes": "side"},
        },
    }
    return import_description(content | changes, "box", path, mesh=mesh)


def full_answer(
    free: dict[str, Any],
    held: Any,
    summed: Any,
    omega: float,
    damping: dict[str, float] | None = None,
    point: Any = POINT,
) -> Any:
    """Resultants (6, inputs) of the forces at ``summed`` dofs of the body without supports whose
    dofs ``held`` rest: by their own rows of its damped matrices, reactions' definition."""
    d = {"alpha": 0.0, "beta": 0.0, "eta": 0.0} | (damping or {})
    stiffness = 1 + 1j * (d["eta"] + omega * d["beta"])
    A = (stiffness * free["K"] + (1j * omega * d["alpha"] - omega**2) * free["M"]).tocsr()
    B = free["B"]
    moves = np.flatnonzero(~held)
    u = np.zeros(B.shape, dtype=complex)
    u[moves] = spsolve(A[moves][:, moves].tocsc(), B[moves].astype(complex))
    r = np.where(summed[:, None], A @ u - B, 0)
    c, arms = free["component"], free["position"] - np.asarray(point)
    rows = []
    for axis in range(6):
        w = (c == axis).astype(float)
        if axis >= 3:
            turned = np.cross(np.eye(3)[axis - 3], arms)
            w = np.where(c < 3, turned[np.arange(len(c)), np.minimum(c, 2)], w)
        rows.append(w @ r)
    return np.array(rows)


def answers(path: Path, folder: Path, ranks: int) -> tuple[Any, Any, list[str]]:
    """H with the feedthrough at some frequencies [rad/s], and the outputs' names."""
    run(
        "sweep",
        "-body",
        path,
        "-mor_sweep_hz",
        "20,9000,3",
        "-mor_sweep_out",
        folder / "sweep.h5",
        ranks=ranks,
    )
    with h5py.File(folder / "sweep.h5") as file:
        outputs = [str(x) for x in file["H"].attrs["outputs"]]
    return *sweep_transfer(folder / "sweep.h5"), outputs


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("kind", "damping"),
    [
        ("tetra10", {"alpha": 40.0, "beta": 2e-6}),
        ("hexahedron", {"beta": 2e-5, "eta": 0.01}),
        ("wedge15", {"alpha": 40.0}),
    ],
)
def test_equal_the_rows_of_the_held_dofs(
    kind: str, damping: dict[str, float], ranks: int, tmp_path: Path
) -> None:
    """Of a support in all directions and one that slides, with loads that act on held nodes too,
    above the first resonances, with every kind of damping."""
    mesh = sided(kind)
    y = sided(kind, distort=False).points
    mesh.point_sets["rail"] = np.flatnonzero(
        (y[:, 1] > y[:, 1].max() - 1e-9) & (y[:, 0] > 0.06) & (y[:, 0] < 0.09)
    )
    write_body(tmp_path / "free.h5", mesh)
    facts = write_body(
        tmp_path / "held.h5",
        mesh,
        damping=damping,
        supports={"clamp": {"nodes": "start"}, "rail": {"nodes": "rail", "components": ["y"]}},
        outputs={
            "foot": {"type": "reaction", "nodes": "start", "point": POINT},
            "rail": {"type": "reaction", "nodes": "rail", "point": POINT},
        },
    )
    assert "held nodes" in facts["outputs"]["foot"]
    free = assembled(tmp_path / "free.h5.matrices", tmp_path / "free.h5")
    start = np.isin(free["node"], mesh.point_sets["start"])
    rail = np.isin(free["node"], mesh.point_sets["rail"]) & (free["component"] == 1)
    omega, H, outputs = answers(tmp_path / "held.h5", tmp_path, ranks)
    names = [f"foot.{x}" for x in LETTERS] + ["rail.ry", "rail.rmx", "rail.rmz"]
    assert outputs[6:] == names
    for w, ours in zip(omega, H, strict=True):
        of_foot = full_answer(free, start | rail, start, w, damping)
        of_rail = full_answer(free, start | rail, rail, w, damping)[[1, 3, 5]]
        expected = np.vstack([of_foot, of_rail])
        scale = np.abs(expected).max(axis=0)
        assert np.all(np.abs(ours[6:] - expected) < 1e-8 * scale), w


def test_of_beams_and_beside_rigid_and_distributing_interfaces(tmp_path: Path) -> None:
    """Moments of clamped beams; elements between a rigid interface and the support; an interface
    that spreads its forces over held nodes too."""
    points = np.column_stack([np.linspace(0, 1, 9), 0.1 * np.linspace(0, 1, 9) ** 2, np.zeros(9)])
    lines = np.column_stack([np.arange(8), np.arange(1, 9)])
    beam = meshio.Mesh(
        points,
        [("line", lines)],
        cell_sets={"all": [np.arange(8)]},
        point_sets={"tip": np.array([8]), "root": np.array([0])},
    )
    changes: dict[str, Any] = {
        "sections": {"strut": {"shape": "circle", "radius": 0.01}},
        "regions": {"all": {"material": "steel", "section": "strut"}},
        "interfaces": {"tip": {"coupling": "node", "nodes": "tip"}},
        "loads": {"gravity": {"type": "acceleration"}},
    }
    directions = ["x", "y", "z", "rx", "ry", "rz"]
    support = {"root": {"nodes": "root", "components": directions}}
    outputs = {"root": {"type": "reaction", "nodes": "root", "point": POINT}}
    write_body(tmp_path / "beam.h5", beam, **changes)
    write_body(tmp_path / "clamped.h5", beam, **changes, supports=support, outputs=outputs)
    block = sided("tetra10", counts=(2, 2, 2))
    near: dict[str, Any] = {
        "interfaces": {
            "end": {"coupling": "rigid", "nodes": "end"},
            "start": {"coupling": "distributing", "nodes": "start"},
        },
        "loads": {"gravity": {"type": "acceleration"}},
    }
    corner = np.flatnonzero((block.points[:, 0] < 1e-9) & (block.points[:, 1] < 0.011))
    block.point_sets["corner"] = corner
    foot = {"foot": {"type": "reaction", "nodes": "corner", "point": POINT}}
    write_body(tmp_path / "block.h5", block, **near)
    write_body(
        tmp_path / "foot.h5", block, **near, supports={"corner": {"nodes": "corner"}}, outputs=foot
    )
    for free_body, held_body, mesh, where in (
        ("beam", "clamped", beam, "root"),
        ("block", "foot", block, "corner"),
    ):
        free = assembled(tmp_path / f"{free_body}.matrices", tmp_path / f"{free_body}.h5")
        held = np.isin(free["node"], mesh.point_sets[where])
        omega, H, outputs_ = answers(tmp_path / f"{held_body}.h5", tmp_path, 1)
        rows = [k for k, name in enumerate(outputs_) if ".r" in name]
        assert len(rows) == 6
        for w, ours in zip(omega, H, strict=True):
            expected = full_answer(free, held, held, w)
            scale = np.abs(expected).max(axis=0)
            assert np.all(np.abs(ours[rows] - expected) < 1e-8 * scale), (held_body, w)


def test_balance_of_forces_and_certified_reactions(tmp_path: Path) -> None:
    """At rest a support carries the weight, the push and its moment; over the band the reduced
    reactions err by no more than the claim."""
    mesh = sided("tetra10", counts=(8, 2, 2))
    body = tmp_path / "body.h5"
    foot = {"type": "reaction", "nodes": "start", "point": [0, 0, 0]}
    write_body(
        body,
        mesh,
        supports={"clamp": {"nodes": "start"}},
        damping={"alpha": 20.0},
        outputs={"foot": foot},
    )
    full = body_system(body)
    result = certified(
        body, (50.0, 4000.0), tmp_path, "-mor_tol", 1e-4, "-mor_statics", "yes", full=full
    )
    assert_certified(result, 1e-4)
    model = ReducedModel.load(result["path"])
    assert {"reaction from force", "reaction moment from acceleration"} <= set(model.kinds)
    rows = [model.outputs.index(f"foot.{x}") for x in LETTERS]
    still = np.real(model.transfer(0.0)[rows])
    with h5py.File(body) as file:
        at = file["interfaces/end"].attrs["position"]
    volume = assembled(tmp_path / "free.h5", body)["M"].sum()  # less the held nodes' share
    for axis in range(3):
        push = still[:, model.inputs.index(f"end.{'fx fy fz'.split()[axis]}")]
        e = np.eye(3)[axis]
        assert push == pytest.approx(-np.concatenate([e, np.cross(at, e)]), abs=1e-8)
        weight = still[:3, model.inputs.index(f"gravity.a{'xyz'[axis]}")]
        assert abs(weight[axis]) > volume / 3
        assert weight == pytest.approx(weight[axis] * e, abs=1e-8 * abs(weight[axis]))
    skin = still[:, model.inputs.index("skin.p")]  # pressure all around has no resultant
    assert np.abs(skin).max() < 1e-10
    weights = [still[a, model.inputs.index(f"gravity.a{x}")] for a, x in enumerate("xyz")]
    assert np.ptp(weights) < 1e-8 * abs(weights[0])
    with pytest.raises(BodyError, match="reactions"):
        model.state_space(["velocity"])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("damping", [{"beta": 2e-6}, {"alpha": 30.0, "eta": 0.02}])
def test_damped_reactions_err_by_no_more_than_the_claim(
    damping: dict[str, float], ranks: int, tmp_path: Path
) -> None:
    """The force by which the support holds the damped body, at resonances and between them, of
    forces, a temperature and gravity: each kind within its claim, relative to the force itself."""
    mesh = sided("tetra10", counts=(8, 2, 2))
    body = tmp_path / "held.h5"
    loads = {
        "gravity": {"type": "acceleration"},
        "warm": {"type": "temperature", "nodes": "side"},
    }
    write_body(tmp_path / "free.h5", mesh, loads=loads)
    write_body(
        body,
        mesh,
        loads=loads,
        damping=damping,
        supports={"clamp": {"nodes": "start"}},
        outputs={"foot": {"type": "reaction", "nodes": "start", "point": POINT}},
    )
    rom = tmp_path / "rom.h5"
    options = ["-mor_band_hz", "200,12000", "-mor_tol", 1e-3, "-mor_out", rom]
    run("reduce", "-body", body, *options, ranks=ranks)
    model = ReducedModel.load(rom)
    assert model.claim.kind == "certified"
    claims = dict(zip(model.claim.kinds, model.claim.by_kind, strict=True))
    assert max(claims.values()) <= 1e-3
    free = assembled(tmp_path / "free.matrices", tmp_path / "free.h5")
    held = np.isin(free["node"], mesh.point_sets["start"])
    rows = [model.outputs.index(f"foot.{x}") for x in LETTERS]
    columns = {
        "force": [f"end.f{x}" for x in "xyz"],
        "acceleration": [f"gravity.a{x}" for x in "xyz"],
        "temperature": ["warm.T"],
    }
    modes = model.modes[(model.modes > 2 * np.pi * 200) & (model.modes < 2 * np.pi * 12000)]
    assert len(modes) > 2
    seen = set()
    for w in np.concatenate([modes, 0.5 * (modes[1:] + modes[:-1]), 2 * np.pi * np.array([201.0])]):
        expected, ours = full_answer(free, held, held, w, damping), model.transfer(w)[rows]
        for what, some in (("reaction", slice(0, 3)), ("reaction moment", slice(3, 6))):
            for load, names in columns.items():
                kind = f"{what} from {load}"
                if kind not in claims:
                    continue
                seen.add(kind)
                of = [model.inputs.index(name) for name in names]
                truth = expected[some][:, of]
                error = np.linalg.norm(ours[some][:, of] - truth) / np.linalg.norm(truth)
                assert error <= claims[kind] + 1e-8, (kind, w)
    assert {"reaction from force", "reaction from temperature"} <= seen
    if "eta" in damping:
        return
    A, B, C, D = model.state_space()
    w = float(modes[0])
    H = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
    assert np.abs(H - model.transfer(w)).max() < 1e-9 * np.abs(H).max()
    with pytest.warns(ReductionWarning, match="C q alone is not foot.rx"):
        assert model.C.shape == (len(model.outputs), model.order)


@pytest.mark.skipif(not shutil.which("ccx"), reason="ccx is not installed")
@pytest.mark.parametrize("element", ["C3D4", "C3D10", "C3D20", "C3D15"])
def test_forces_of_calculix(element: str, tmp_path: Path) -> None:
    """Total forces of two supports of a deck whose share statics alone do not tell."""
    kind = {**CALCULIX, "C3D20": "hexahedron20"}[element]
    mesh = sided(kind)
    plain = sided(kind, distort=False).points
    middle = np.flatnonzero((np.abs(plain[:, 0] - 0.05) < 0.013) & (plain[:, 2] < 1e-9))
    tip = int(mesh.point_sets["end"][0])
    extra = (
        "*NSET, NSET=MIDDLE\n"
        + "\n".join(f"{i + 10}," for i in middle)
        + "\n*BOUNDARY\nSTART, 1, 3\nMIDDLE, 3, 3\n*STEP\n*STATIC\n*CLOAD\n"
        + f"{tip + 10}, 2, 300\n{tip + 10}, 3, -700\n"
        + "*NODE PRINT, NSET=START, TOTALS=ONLY\nRF\n*NODE PRINT, NSET=MIDDLE, TOTALS=ONLY\nRF\n"
        + "*END STEP\n"
    )
    deck = write_deck(tmp_path / "box.inp", element, extra, mesh=mesh)
    subprocess.run(["ccx", deck.stem], cwd=tmp_path, capture_output=True, check=True)
    printed = {}
    lines = deck.with_suffix(".dat").read_text().splitlines()
    for k, line in enumerate(lines):
        if "total force" in line:
            printed[line.split("set ")[1].split()[0]] = np.array(lines[k + 2].split(), dtype=float)
    run(
        "import",
        deck,
        "--assemble",
        "--deck-loads",
        "--node",
        f"tip=NODES:{tip + 10}",
        "--measure",
        "foot=reaction:NSET:START",
        "--measure",
        "middle=reaction:NSET:MIDDLE",
        "-o",
        tmp_path / "body.h5",
    )
    run(
        "reduce",
        "-body",
        tmp_path / "body.h5",
        "-mor_band_hz",
        "10,3000",
        "-mor_tol",
        1e-6,
        "-mor_statics",
        "yes",
        "-mor_out",
        tmp_path / "rom.h5",
    )
    model = ReducedModel.load(tmp_path / "rom.h5")
    load = model.transfer(0.0)[:, model.inputs.index("step1_cload.load")].real
    largest = max(np.abs(values).max() for values in printed.values())
    for name, axes in (("foot", "xyz"), ("middle", "z")):
        theirs = printed["START" if name == "foot" else "MIDDLE"]
        for axis in axes:
            ours = load[model.outputs.index(f"{name}.r{axis}")]
            assert abs(ours - theirs["xyz".index(axis)]) < 3e-6 * largest
    assert abs(printed["MIDDLE"][2]) > 10  # it carries a share


def test_wrong_reactions(tmp_path: Path) -> None:
    mesh = sided("tetra")
    for changes, words in (
        ({"outputs": {"foot": {"type": "reaction", "nodes": "start"}}}, "no support holds any"),
        (
            {
                "supports": {"s": {"nodes": "start"}},
                "outputs": {"foot": {"type": "reaction", "nodes": "start", "direction": [1, 0, 0]}},
            },
            "reaction takes no direction",
        ),
        (
            {"outputs": {"foot": {"nodes": "start", "point": [1, 0, 0]}}},
            "displacement takes no point",
        ),
    ):
        with pytest.raises(BodyError, match=words):
            write_body(tmp_path / "body.h5", mesh, **changes)
    write_body(
        tmp_path / "body.h5",
        mesh,
        supports={"s": {"nodes": "start"}},
        outputs={"foot": {"type": "reaction", "nodes": "start"}},
    )
    with h5py.File(tmp_path / "body.h5", "r+") as file:
        file["outputs/foot"].attrs["axes"] = [0.0, 7.0]
    failed = run("plan", "-body", tmp_path / "body.h5", "-mor_band_hz", "10,100", expect=1)
    assert "output foot: axis 7 must be 0 to 5" in message(failed)


def test_a_negative_damping_of_outputs_is_refused(tmp_path: Path) -> None:
    """Bounds take its factor to rise with the frequency."""
    write_matrices(tmp_path / "b.h5", **chain(20))
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        file["output_beta"] = np.array([0.0, -1e-6])
    failed = run("plan", "-body", tmp_path / "b.h5", "-mor_band_hz", "0.01,0.1", expect=1)
    assert "/output_beta holds -1e-06, a negative damping" in message(failed)
    model = reduce(Matrices(**chain(20)), (0.01, 0.1), 1e-2)
    with pytest.raises(BodyError, match="negative damping"):
        System.of(fields_of(model) | {"output_eta": np.array([-0.1, 0.0])})


def fields_of(model: ReducedModel) -> dict[str, Any]:
    return {name: getattr(model.system, name) for name in "MDKBC"}
