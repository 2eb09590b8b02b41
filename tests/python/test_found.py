"""What other people's files and hands found: endings, companions, hidden nodes, singular masses,
damping that exists in frequency only, outputs that are a kind of their own."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import warnings
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from test_importers import FREQUENCY, ccx, write_deck
from test_mesh_loads import sided

import flexgram
from bodies import box
from conftest import PROGRAM, body_system, message, run
from flexgram import BodyError, ReducedModel
from flexgram.assembly.couple import Joint, couple
from flexgram.body.description import import_description
from flexgram.body.matrices import Matrices
from flexgram.cli.import_command import rayleigh
from flexgram.exporters import FORMATS, export, target_of
from flexgram.importers.nastran import _cards_of
from flexgram.model.equivalent_damping import with_viscous_damping
from flexgram.model.modes import massless, natural_modes
from flexgram.simulation.expressions import between_times

MESH = {
    "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
    "regions": {"all": {"material": "steel"}},
    "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
    "supports": {"clamp": {"nodes": "start"}},
}


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clamped box beside its reduced body."""
    folder = tmp_path_factory.mktemp("held")
    mesh = box("hexahedron", (4, 2, 2))
    import_description(MESH | {"damping": {"eta": 0.01}}, "box", folder / "box.h5", mesh=mesh)
    run(
        *("reduce", "-body", folder / "box.h5", "-mor_band_hz", "100,8000"),
        *("-mor_tol", 1e-4, "-mor_out", folder / "box.rom.h5"),
    )
    return folder


@pytest.fixture(scope="module")
def viscous(held: Path) -> Path:
    """The same with Rayleigh damping, reduced."""
    mesh = box("hexahedron", (4, 2, 2))
    damping = {"damping": {"alpha": 20.0}}
    import_description(MESH | damping, "box", held / "alpha.h5", mesh=mesh)
    run(
        *("reduce", "-body", held / "alpha.h5", "-mor_band_hz", "100,8000"),
        *("-mor_tol", 1e-4, "-mor_out", held / "alpha.rom.h5"),
    )
    return held / "alpha.rom.h5"


# -- files and endings


@pytest.mark.parametrize("kind", ["mat", "npz", "state-space", "sid", "exudyn", "abaqus"])
def test_an_export_is_named_by_its_format(kind: str, held: Path, tmp_path: Path) -> None:
    model = ReducedModel.load(held / "box.rom.h5")
    model.eta = 0.0
    own = FORMATS[kind][1]
    if kind not in ("sid", "exudyn"):  # these are of free bodies
        assert export(model, tmp_path / "body", kind) == tmp_path / f"body{own}"
        assert (tmp_path / f"body{own}").exists()
    for ending in (
        {".h5", ".npz", ".mat", ".txt"} - {own} - ({".npz"} if "space" in kind else set())
    ):
        with pytest.raises(BodyError, match="writes"):
            target_of(tmp_path / f"body{ending}", kind)


def test_the_body_beside_is_never_replaced(held: Path, viscous: Path, tmp_path: Path) -> None:
    """Every verb that writes, with the names of its neighbours, without an ending, and in capitals:
    body and reduced body are what they were."""
    for name in ("box.h5", "box.rom.h5"):
        shutil.copy(held / name, tmp_path / name)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    rom = tmp_path / "box.rom.h5"
    force = ("--force", "end.fx=1", "--time", "0,0.01,21", "-o", tmp_path / "s.csv")
    for xdmf in ("box", "box.XDMF", "box.vtu", "box.xmf"):
        run("simulate", viscous, *force, "--xdmf", tmp_path / xdmf, expect=None)
    for shapes in ("box", "box.xdmf", "box.h5"):
        run("export", rom, "--to", "vtu", "-o", tmp_path / shapes, expect=None)
    for out in ("box", "box.h5", "box.rom.h5"):
        run("plot", rom, "--figure", "error", "-o", tmp_path / out, expect=None)
        run("frf", rom, "--pair", "end.fx=end.fx", "-o", tmp_path / out, expect=None)
        run("modes", rom, "-o", tmp_path / out, expect=None)
        run("report", rom, "-o", tmp_path / out, expect=None)
        for kind in ("mat", "npz", "abaqus", "octave"):
            run("export", rom, "--to", kind, "-o", tmp_path / out, expect=None)
    for name, content in before.items():
        assert (tmp_path / name).read_bytes() == content, name
    assert (tmp_path / "box.XDMF").exists() and (tmp_path / "box.XDMF.h5").exists()


def test_pictures_without_an_ending_replace_nothing(held: Path, tmp_path: Path) -> None:
    (tmp_path / "rack.png").write_text("precious")
    rom = held / "box.rom.h5"
    failed = run("frf", rom, "--pair", "end.fx=end.fx", "-o", tmp_path / "rack", expect=1)
    assert (tmp_path / "rack.png").read_text() == "precious"
    assert message(failed)


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="octave is not installed")
def test_a_script_without_a_display(held: Path, tmp_path: Path) -> None:
    export(ReducedModel.load(held / "box.rom.h5"), tmp_path / "part_2.m", "octave")
    done = subprocess.run(
        ["octave-cli", "--no-gui", "--eval", "part_2"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr


# -- imports


@ccx
def test_nodes_of_incompatible_elements_have_places(tmp_path: Path) -> None:
    """C3D8I: internal nodes have none, but the real ones do."""
    deck = write_deck(tmp_path / "box.inp", "C3D8I", FREQUENCY)
    mesh = box("hexahedron", (4, 2, 2))
    labels = ",".join(str(n + 10) for n in mesh.point_sets["end"])
    at = ",".join(f"{x:.9g}" for x in mesh.points[mesh.point_sets["start"][0]])
    out, maps = ("-o", tmp_path / "b.h5"), []
    for words in (f"end=NODES:{labels}", "end=NSET:END"):
        done = run("import", deck, "--run-ccx", "--rigid", words, "--node", f"p=AT:{at}", *out)
        assert "6 of 6 rigid motions are free" in done.out and "mass" in done.out
        with h5py.File(tmp_path / "b.h5") as file:
            maps.append(file["B"][:])
            assert len(file["B"].attrs["names"]) == 9
    assert np.array_equal(*maps)
    spread = ("--distributing", "end=NSET:END", "-o", tmp_path / "c.h5")
    assert "interface end: distributing" in run("import", deck, "--run-ccx", *spread).out


@ccx
@pytest.mark.parametrize("kind", ["S8R", "S4", "S4R"])
def test_nodes_of_free_shells_by_number(kind: str, tmp_path: Path) -> None:
    """As by set: every node that ccx makes of it; one integration point is warned of."""
    lines = ["*NODE, NSET=NALL"]
    eight = kind.startswith("S8")
    step = 0.5 if eight else 1.0
    label: dict[tuple[float, float], int] = {}
    for i in np.arange(0, 4 + step, step):
        for j in np.arange(0, 2 + step, step):
            if eight and i % 1 and j % 1:
                continue
            label[float(i), float(j)] = len(label) + 1
            lines.append(f"{len(label)}, {0.1 * i}, {0.1 * j}, 0")
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=EALL")
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if eight:
        around += [(0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5)]
    for i in range(4):
        for j in range(2):
            nodes = [label[float(i + a), float(j + b)] for a, b in around]
            lines.append(f"{2 * i + j + 1}, " + ", ".join(map(str, nodes)))
    end = [n for (i, _), n in label.items() if i == 4]
    lines += ["*NSET, NSET=END", *(f"{n}," for n in end)]
    lines.append(
        "*MATERIAL, NAME=STEEL\n*ELASTIC\n210e9, 0.3\n*DENSITY\n7850\n"
        "*SHELL SECTION, ELSET=EALL, MATERIAL=STEEL\n0.01"
    )
    deck = tmp_path / "plate.inp"
    deck.write_text("\n".join(lines) + "\n" + FREQUENCY)
    found = []
    for word in ("NSET:END", "NODES:" + ",".join(map(str, end))):
        done = run(
            "import", deck, "--run-ccx", "--distributing", f"p={word}", "-o", tmp_path / "b.h5"
        )
        with h5py.File(tmp_path / "b.h5") as file:
            found.append(file["B"][:])
    assert np.array_equal(found[0], found[1])
    assert ("hourglass" in done.out) == (kind == "S4R")


@ccx
def test_the_hourglass_stiffness_is_named(tmp_path: Path) -> None:
    """A free distorted C3D8R body resists rotation in ccx: the cause, and what takes its place."""
    deck = write_deck(tmp_path / "box.inp", "C3D8I", FREQUENCY)
    text = deck.read_text()
    deck.write_text(text.replace("C3D8I", "C3D8R"))
    failed = run(
        "import", deck, "--run-ccx", "--node", "end=NSET:END", "-o", tmp_path / "b.h5", expect=1
    )
    assert "hourglass stiffness of C3D8R" in message(failed) and "C3D8I" in message(failed)
    deck.write_text(text)  # the remedy
    run("import", deck, "--run-ccx", "--node", "end=NSET:END", "-o", tmp_path / "b.h5")


def op4(path: Path, **matrices: Any) -> None:
    from pyNastran.op4.op4 import OP4

    names = list(matrices)
    OP4(debug=None).write_op4(
        str(path), {name: (6, matrices[name]) for name in names}, names, is_binary=False
    )


def test_empty_matrices_of_a_superelement(tmp_path: Path) -> None:
    """EXTSEOUT writes what is not there as one zero."""
    K = np.diag([2.0, 3.0, 4.0]) * 1e6
    for extra in ({"BXX1": np.zeros((1, 1))}, {"KASMX": np.zeros((1, 1))}, {"BAA": np.eye(2)}):
        op4(tmp_path / "x.op4", KXX=K, MXX=np.eye(3), **extra)
        for more in ((), ("--matrices", "K=KXX,M=MXX")):
            run("import", tmp_path / "x.op4", "-o", tmp_path / "b.h5", "--rows", "p=1,2", *more)
        assert np.allclose(body_system(tmp_path / "b.h5").K.toarray(), K)
        with h5py.File(tmp_path / "b.h5") as file:
            assert "D" not in file


def test_cards_of_a_file_that_cannot_be_read_whole() -> None:
    text = (
        "ID A\nCEND\nTITLE = x\nBEGIN SUPER=100\n$ comment\nGRID,1,,0.,0.,0.\n"
        "CBAR,1,bad\n+,more\nRBE2,9,1,123456,2\n,3,4\nGRID    2               1.0     0.0\n"
        "*       0.0\nENDDATA\n"
    )
    assert _cards_of(text, ("GRID", "RBE2")).splitlines() == [
        "GRID,1,,0.,0.,0.",
        "RBE2,9,1,123456,2",
        ",3,4",
        "GRID    2               1.0     0.0",
        "*       0.0",
    ]


def test_meshes_of_results_and_of_surfaces(tmp_path: Path) -> None:
    mesh = box("tetra", (2, 2, 2))
    mesh.field_data = {"med:nom": [[], []], "steps": np.array([1.0, 2.0, 3.0])}
    import_description(MESH, "box", tmp_path / "b.h5", mesh=mesh)
    flat = meshio.Mesh(np.eye(3), [("triangle", np.array([[0, 1, 2]]))])
    with pytest.raises(BodyError, match="no solids, only triangle"):
        import_description(MESH, "flat", tmp_path / "b.h5", mesh=flat)
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    failed = run("import", tmp_path / "part.step", "-o", tmp_path / "b.h5", expect=1)
    assert "gmsh part.step -3 -order 2" in message(failed)


def test_a_mass_that_one_direction_carries(tmp_path: Path) -> None:
    """Its mean over the directions is no mass."""
    deck = write_deck(tmp_path / "box.inp", "C3D4")
    from flexgram.importers.fe import FeMatrices, check

    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    K = sp.csr_matrix(np.diag(np.full(9, 1e6)))
    M = sp.csr_matrix(np.diag(np.tile([2.0, 0.0, 0.0], 3)))
    fe = FeMatrices(
        *(str(deck), K, M),
        node=np.repeat([1, 2, 3], 3),
        component=np.tile([0, 1, 2], 3),
        labels=np.arange(1, 4),
        points=points,
    )
    facts = check(fe)
    assert "mass" not in facts and "6, 0, 0 in x, y, z" in fe.remarks[-1]


def test_a_number_too_small_for_a_normal_double() -> None:
    """In K: neither an error nor digits that were printed."""
    K = sp.csr_matrix(np.array([[2.0, 5e-324], [5e-324, 3.0]]))
    model = flexgram.reduce(Matrices(K, sp.identity(2, format="csr"), np.eye(2)), (0.01, 0.1), 1e-3)
    assert model.order == 2
    lists = Matrices(sp.dok_matrix(K), sp.dok_matrix(np.eye(2)), np.eye(2))
    assert flexgram.reduce(lists, (0.01, 0.1), 1e-3).order == 2


# -- singular mass


def lumped(rng: np.random.Generator, n: int = 12) -> Matrices:
    """A beam in bending, whose rotations have no inertia; ports at both ends."""
    ends = [(2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3) for k in range(n)]
    size, L, EI = 2 * (n + 1), 1.0 / n, 20.0
    K = np.zeros((size, size))
    k = EI / L**3 * np.array(
        [[12, 6 * L, -12, 6 * L], [6 * L, 4 * L * L, -6 * L, 2 * L * L],
         [-12, -6 * L, 12, -6 * L], [6 * L, 2 * L * L, -6 * L, 4 * L * L]]
    )  # fmt: skip
    for dofs in ends:
        K[np.ix_(dofs, dofs)] += k
    K[0, 0] += 1e3
    K[1, 1] += 1e2
    M = np.diag(np.where(np.arange(size) % 2 == 0, rng.uniform(0.5, 1.5, size) / n, 0.0))
    B = np.zeros((size, 4))
    B[0, 0] = B[1, 1] = B[-2, 2] = B[-1, 3] = 1
    names = ["a.fy", "a.mz", "b.fy", "b.mz"]
    return Matrices(sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=names, alpha=0.2)


def with_massless_coordinate(model: ReducedModel, mass: float = 0.0) -> ReducedModel:
    """The body with a further coordinate without mass (or with little) at port b.fy."""
    system = model.system
    row = np.zeros((1, len(model.inputs)))
    row[0, model.inputs.index("b.fy")] = 1
    stiffness = 50 * float(np.diag(system.K).max())
    return model.with_parts(
        system=dataclasses.replace(
            system,
            M=scipy.linalg.block_diag(system.M, mass),
            D=scipy.linalg.block_diag(system.D, 0.0),
            K=scipy.linalg.block_diag(system.K, stiffness),
            B=np.vstack([system.B, row]),
            C=np.hstack([system.C, row.T]),
        )
    )


def test_assemblies_of_bodies_whose_mass_is_singular() -> None:
    """Joins in both orders and springs: frequencies and H of the assembly are those with a mass
    that is nearly nothing, and so is the claim."""
    bodies = [lumped(np.random.default_rng(seed)) for seed in (1, 2)]
    models = [flexgram.reduce(body, (0.05, 6.0), 1e-5, statics="yes") for body in bodies]
    without = [with_massless_coordinate(m) for m in models]
    assert [massless(m.system.K, m.system.M) for m in without] == [1, 1]
    light = 1e-9 * float(np.diag(without[0].system.M).max())
    for joint in (
        Joint("x.b", "y.a", directions=("y", "rz")),
        Joint("x.b", "y.b", directions=("y",)),
        Joint("x.b", "y.b", stiffness={"y": 1e3}),
    ):
        for order in (1, -1):
            found, expected = (
                couple(dict(zip("xy", some[::order], strict=True)), [joint])
                for some in (without, [with_massless_coordinate(m, light) for m in models])
            )
            values = scipy.linalg.eigvals(found.K, found.M)  # QZ: infinite ones apart
            exact = np.sqrt(np.sort(np.real(values[np.isfinite(values)])))
            slow = exact < 2 * np.pi * 10
            assert slow.sum() > 1
            for body in (found, expected):
                assert np.allclose(body.modes[: slow.sum()], exact[slow], rtol=1e-6)
                assert np.all(np.isfinite(body.modes))
            w = 2 * np.pi * 1.7
            H, other = found.transfer(w), expected.transfer(w)
            assert np.linalg.norm(H - other) < 1e-6 * np.linalg.norm(other)
            assert found.claim.kind == expected.claim.kind


def test_no_state_space_without_mass(tmp_path: Path) -> None:
    model = with_massless_coordinate(
        flexgram.reduce(lumped(np.random.default_rng(1)), (0.05, 6.0), 1e-5)
    )
    for work in (
        lambda: model.state_space(),
        lambda: model.simulate(np.ones((3, 4)), [0, 1, 2]),
        lambda: export(model, tmp_path / "b.pch", "dmig"),
        lambda: export(model, tmp_path / "b.fmu", "fmu"),
    ):
        with pytest.raises(BodyError, match="no mass"):
            work()


def test_natural_modes_of_singular_masses() -> None:
    K, M = np.diag([1.0, 4.0, 2.0]), np.diag([1.0, 1.0, 0.0])
    squares, modes = natural_modes(K, M)
    assert np.allclose(squares[:2], [1, 4]) and squares[2] == np.inf
    assert np.allclose(modes.T @ K @ modes, np.diag([1, 4, 1]))


# -- inputs


def test_numbers_that_are_no_frequency_and_no_force(held: Path) -> None:
    model = ReducedModel.load(held / "box.rom.h5")
    for omega in (np.nan, np.inf, 1 + 1j, [1.0, np.nan]):
        with pytest.raises(BodyError, match="finite real numbers"):
            model.transfer(omega)
    model.eta = 0.0
    u = np.ones((3, len(model.inputs)))
    for wrong in (u * np.nan, u * np.inf, u * 1j):
        with pytest.raises(BodyError, match="NaN, infinite or complex"):
            model.simulate(wrong, [0, 1e-3, 2e-3])
    failed = run(
        *("frf", held / "box.rom.h5", "--pair", "end.fx=end.fx", "--hz", "10,20,2.5"),
        *("-o", held / "f.csv"),
        expect=1,
    )
    assert "whole number" in message(failed)


def test_a_force_above_the_band_is_told(viscous: Path, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "s.csv")
    sampled = run(
        *("simulate", viscous, "--force", "end.fx=sin(2*pi*20000*t)"),
        *("--time", "0,0.01,201", *out),
    )
    assert "moves between the times" in sampled.out
    fine = run(
        *("simulate", viscous, "--force", "end.fx=sin(2*pi*20000*t)"),
        *("--time", "0,0.01,4001", *out),
    )
    assert "lies above the band" in fine.out and "moves between" not in fine.out
    assert between_times("t > 0.5", np.linspace(0, 1, 11)) is None


# -- damping


def test_a_damping_ratio_at_two_frequencies(held: Path, tmp_path: Path) -> None:
    alpha, beta = rayleigh("2%,100,1000")
    for hz in (100, 1000):
        w = 2 * np.pi * hz
        assert alpha / (2 * w) + beta * w / 2 == pytest.approx(0.02)
    meshio.write(tmp_path / "box.vtu", box("hexahedron", (4, 2, 2)))
    done = run(
        *("import", tmp_path / "box.vtu", "--material", "steel", "--zeta", "2%,100,1000"),
        *("--rigid", "p=BOX:-1,-1,-1,0.001,1,1", "-o", tmp_path / "b.h5"),
    )
    assert f"alpha = {alpha:g}" in done.out
    with pytest.raises(BodyError, match="expected a ratio"):
        rayleigh("2,100,100")


def test_a_loss_factor_is_told_and_replaced(held: Path, tmp_path: Path) -> None:
    """At the import; in the file; and by viscous damping whose error is that of H."""
    assert "exists in frequency only" in run("info", held / "box.h5").out
    model = ReducedModel.load(held / "box.rom.h5")
    assert model.eta == 0.01
    for kind, largest in (("modal", 0.02), ("rayleigh", 0.5)):
        viscous, error = with_viscous_damping(model, kind)
        assert viscous.eta == 0 and 0 < error < largest
        inside = model.modes[model.modes < model.band[1]]
        w = np.concatenate([inside, np.linspace(*model.band, 40)])
        H, other = model.transfer(w), viscous.transfer(w)
        true = np.linalg.norm(other - H, axis=(1, 2)) / np.linalg.norm(H, axis=(1, 2))
        assert true.max() < 1.2 * error
        assert "loss factor" in viscous.provenance.warnings[-1]
    failed = run("export", held / "box.rom.h5", "--to", "fmu", "-o", tmp_path / "b.fmu", expect=1)
    assert "structural damping" in message(failed)
    done = run(
        *("export", held / "box.rom.h5", "--to", "state-space", "--damping", "modal"),
        *("-o", tmp_path / "b.mat"),
    )
    assert "in the place of eta changes H by at most" in done.out
    with pytest.raises(BodyError, match="no loss factor"):
        with_viscous_damping(viscous)


# -- kinds


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_output_may_be_a_kind_of_its_own(ranks: int, tmp_path: Path) -> None:
    """A row that is small beside others of its kind keeps the tolerance that it has by name."""
    mesh = sided("hexahedron", counts=(6, 2, 2))
    body = tmp_path / "box.h5"
    outputs = {"foot": {"type": "reaction", "nodes": "start"}}
    import_description(
        MESH | {"outputs": outputs, "damping": {"alpha": 20.0}}, "box", body, mesh=mesh
    )
    rom = tmp_path / "rom.h5"
    options = ["-mor_band_hz", "200,4000", "-mor_tol", 1e-2, "-mor_out", rom]
    run("reduce", "-body", body, *options, "-mor_tol_kind", "foot.rz=1e-4", ranks=ranks)
    model = ReducedModel.load(rom)
    claims = dict(zip(model.claim.kinds, model.claim.by_kind, strict=True))
    named = {kind: e for kind, e in claims.items() if kind.startswith("foot.rz from")}
    assert set(named) == {"foot.rz from force", "foot.rz from moment"}
    assert max(named.values()) <= 1e-4
    full = body_system(body)
    with h5py.File(tmp_path / "box.assembled.h5") as file:
        names = [[str(x) for x in file[k].attrs["names"]] for k in "CB"]
    row = names[0].index("foot.rz")
    for kind, letter in (("force", "f"), ("moment", "m")):
        columns = [k for k, name in enumerate(names[1]) if f".{letter}" in name]
        for hz in (250.0, 1234.5, 2777.0, 3900.0):
            H = full.transfer(2 * np.pi * hz)[row, columns]
            ours = model.transfer(2 * np.pi * hz)[row, columns]
            assert np.linalg.norm(ours - H) <= named[f"foot.rz from {kind}"] * np.linalg.norm(H)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        from flexgram.simulation.histories import judge

        t = np.linspace(0, 0.01, 101)
        judge(model, t, np.outer(np.sin(2 * np.pi * 1000 * t), np.eye(len(model.inputs))[0]))
    failed = run("reduce", "-body", body, *options, "-mor_tol_kind", "foot.rq=1e-4", expect=1)
    assert "there is no output foot.rq" in message(failed)


# -- outputs of the program


def test_a_default_name_replaces_nothing_of_others(held: Path, tmp_path: Path) -> None:
    body, band = held / "box.h5", ("-mor_band_hz", "100,4000")
    for verb, name in (("reduce", "rom.h5"), ("certify", "medium.h5"), ("sweep", "sweep.h5")):
        more = ("-mor_sweep_hz", "100,200,2") if verb == "sweep" else band
        shutil.copy(body, tmp_path / name)
        before = (tmp_path / name).read_bytes()
        failed = subprocess.run(
            [PROGRAM, verb, "-body", body, *more], cwd=tmp_path, capture_output=True, text=True
        )
        assert failed.returncode == 1 and "name the output" in failed.stderr
        assert (tmp_path / name).read_bytes() == before
        (tmp_path / name).unlink()
        for _ in range(2):  # of its own kind it may be replaced
            subprocess.run([PROGRAM, verb, "-body", body, *more], cwd=tmp_path, check=True)


def test_inputs_of_the_program_are_kept(held: Path, tmp_path: Path) -> None:
    body, band = held / "box.h5", ("-mor_band_hz", "100,4000")
    loads = tmp_path / "loads.csv"
    loads.write_text("port,one\nend.fx,+1\nend.fy,1e-330\n")
    options = tmp_path / "options.txt"
    options.write_text("-mor_tol 1e-2\n")
    for more in (
        ("-mor_loads", loads, "-mor_out", loads),
        ("-options_file", options, "-mor_out", options),
    ):
        failed = run("reduce", "-body", body, *band, *more, expect=1)
        assert "would replace the input" in message(failed)
    run("reduce", "-body", body, *band, "-mor_loads", loads, "-mor_out", tmp_path / "r.h5")
    both = ("-mor_out", tmp_path / "o.h5", "-mor_medium_out", f"{tmp_path}/./o.h5")
    assert "the same file" in message(run("reduce", "-body", body, *band, *both, expect=1))


def test_a_second_run_with_the_same_output_is_told(held: Path, tmp_path: Path) -> None:
    out = tmp_path / "o.h5"
    band = ("-mor_band_hz", "100,8000", "-mor_tol", "1e-9")
    process = subprocess.Popen(
        [PROGRAM, "reduce", "-body", held / "box.h5", *band, "-mor_out", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    for line in process.stdout:
        if line.split()[:1] == ["factors"]:  # told before the first factorisation
            shutil.copy(held / "box.rom.h5", out)
            break
    said = "".join(process.communicate())
    assert process.returncode == 0 and "written by another run" in said


def test_what_a_body_file_holds_beside_is_named(held: Path, tmp_path: Path) -> None:
    from flexgram import write_matrices

    body = tmp_path / "b.h5"
    K = sp.csr_matrix(np.diag([2.0, 3.0]))
    write_matrices(body, K, sp.identity(2, format="csr"), np.eye(2))
    with h5py.File(body, "r+") as file:
        file["Damping"] = np.eye(2)
    done = run("plan", "-body", body, "-mor_band_hz", "0.01,0.1")
    assert "/Damping of" in done.out + done.err and "is not read" in done.out + done.err


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_body_that_is_rigid_as_a_whole(ranks: int, tmp_path: Path) -> None:
    """A rigid interface that holds every node: six modes, and H of the rigid body's mass."""
    mesh = box("hexahedron", (2, 2, 2))
    mesh.point_sets["all"] = np.arange(len(mesh.points))
    ends = {"interfaces": {"a": {"coupling": "rigid", "nodes": "all", "position": [0, 0, 0]}}}
    free = {key: value for key, value in MESH.items() if key != "supports"}
    import_description(free | ends, "box", tmp_path / "b.h5", mesh=mesh)
    rom = tmp_path / "rom.h5"
    run(
        *("reduce", "-body", tmp_path / "b.h5", "-mor_band_hz", "10,500", "-mor_out", rom),
        ranks=ranks,
    )
    model = ReducedModel.load(rom)
    assert model.order == 6 and model.claim.kind == "certified" and model.claim.whole < 1e-9
    with h5py.File(rom) as file:
        mass = file["frame/M_r"][:]
    w = 2 * np.pi * 100.0
    assert np.allclose(model.transfer(w) @ mass, -np.eye(6) / w**2, atol=1e-9 / w**2)


def test_rows_with_directions_join(tmp_path: Path) -> None:
    """Interfaces named by rows join where their directions are given; without, the message says
    how."""
    import scipy.io

    n = 12
    K = 1e4 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    scipy.io.savemat(tmp_path / "a.mat", {"K": sp.csc_matrix(K), "M": sp.eye(n, format="csc")})
    for name, rows in (("named", "fx:12"), ("bare", "12")):
        first = rows.replace("12", "1")
        run(
            *("import", tmp_path / "a.mat", "-o", tmp_path / f"{name}.h5", "--alpha", "0.5"),
            *("--rows", f"left={first}", "--rows", f"right={rows}"),
        )
        run(
            *("reduce", "-body", tmp_path / f"{name}.h5", "-mor_band_hz", "1,20", "-mor_tol", 1e-6),
            *("-mor_out", tmp_path / f"{name}.rom.h5"),
        )
    both = (f"x={tmp_path}/named.rom.h5", f"y={tmp_path}/named.rom.h5")
    run("couple", *both, "--join", "x.right=y.left:x", "-o", tmp_path / "w.h5")
    whole = ReducedModel.load(tmp_path / "w.h5")
    T = np.delete(np.eye(2 * n), n, axis=1)
    T[n, n - 1] = 1
    square = np.linalg.eigvals(np.linalg.solve(T.T @ T, T.T @ scipy.linalg.block_diag(K, K) @ T))
    expected = np.sort(np.sqrt(square.real))[:4]
    assert np.allclose(whole.modes[:4], expected, rtol=1e-6)
    bare = (f"x={tmp_path}/bare.rom.h5", f"y={tmp_path}/bare.rom.h5")
    failed = run("couple", *bare, "--join", "x.right=y.left", "-o", tmp_path / "v.h5", expect=1)
    assert "ports without directions" in message(failed) and "fx:25" in message(failed)


@pytest.mark.parametrize("verb", ["import", "info", "report", "export", "couple", "simulate"])
def test_help_and_status_of_the_verbs_of_python(verb: str) -> None:
    """As those of the program: -help, and 1 for a wrong command line (2 is a missed tolerance)."""
    said = run(verb, "-help").out
    assert said.startswith(f"usage: flexgram {verb}") and said == run(verb, "--help").out
    wrong = run(verb, "--no-such-option", expect=1)
    assert f"usage: flexgram {verb}" in wrong.err
    bare = run("reduce", expect=1)
    assert "option -body is missing" in message(bare) and "warning" not in bare.out + bare.err


def test_effective_masses_and_principal_stresses(tmp_path: Path) -> None:
    """Of all modes of a clamped bar they add up to its moving mass, and those of a bar along x to
    8/((2k - 1)² π²) of it; principal stresses are the tensor's eigenvalues."""
    from flexgram.body.stress import principal, signed_von_mises, von_mises

    mesh = box("hexahedron20", (10, 2, 2), distort=False)
    loads = {"gravity": {"type": "acceleration"}}
    body = tmp_path / "b.h5"
    import_description(MESH | {"loads": loads}, "bar", body, mesh=mesh)
    rom = tmp_path / "rom.h5"
    run(
        *("reduce", "-body", body, "-mor_band_hz", "100,60000", "-mor_tol", 1e-3),
        *("-mor_out", rom),
    )
    out = tmp_path / "modes.csv"
    said = run("modes", rom, "-o", out).out
    assert "effective mass of these modes in x, y, z" in said
    table = np.genfromtxt(out, delimiter=",", names=True)
    columns = [name for name in table.dtype.names if name.startswith("effective")]
    masses = np.array([table[name] for name in columns]).T
    with h5py.File(body) as file:
        from flexgram.body.whole import mass_facts

        mass = mass_facts(file).mass
    assert np.all(masses.sum(axis=0) < 1.0001 * mass) and masses[:, 0].sum() > 0.8 * mass
    first = masses[:, 0].max()
    assert first == pytest.approx(8 / np.pi**2 * mass, rel=0.02)
    rng = np.random.default_rng(1)
    s = rng.normal(size=(7, 6))
    for six, values in zip(s, principal(s), strict=True):
        xx, yy, zz, xy, yz, zx = six
        tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        assert np.allclose(np.sort(np.linalg.eigvals(tensor).real), values[::-1])
    assert np.allclose(np.abs(signed_von_mises(s)), von_mises(s))
    assert np.isnan(principal(np.full(6, np.nan))).all()


def test_what_a_deck_includes_is_no_output(tmp_path: Path) -> None:
    part = write_deck(tmp_path / "part.inp", "C3D10")
    before = part.read_bytes()
    (tmp_path / "top.inp").write_text("*INCLUDE, INPUT=part.inp\n" + FREQUENCY)
    table = tmp_path / "table.csv"
    table.write_text("10, 1, 0, 0\n")
    common = ("import", tmp_path / "top.inp", "--assemble", "--rigid", "end=NSET:END")
    for more, out in (((), part), (("--load", f"pull=nodal:{table}"), table)):
        failed = run(*common, *more, "-o", out, expect=1)
        assert "would replace the input" in message(failed)
    assert part.read_bytes() == before
