"""Reduced bodies as superelements: the physical form, and what other programs read of its files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.linalg

from bodies import box, write_body_file
from conftest import run
from flexgram import BodyError, ReducedModel
from flexgram.exporters import export
from flexgram.model.physical import PhysicalForm

OMEGA = 2 * np.pi * np.array([20.0, 180.0, 700.0, 1500.0])
SIZE = (0.3, 0.04, 0.03)


def reduced(
    folder: Path, *options: str, coupling: str = "rigid", support: bool = False
) -> ReducedModel:
    folder.mkdir(exist_ok=True)
    body, rom = folder / "beam.h5", folder / "beam.rom.h5"
    mesh = box("tetra10", (8, 2, 2), SIZE)
    names = ("end",) if support else ("start", "end")
    interfaces = {name: {"coupling": coupling, "set": name} for name in names}
    write_body_file(
        body,
        mesh,
        interfaces=interfaces,
        damping=(3, 2e-6, 0),
        supports={"start": [0, 1, 2]} if support else None,
    )
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "10,2000",
        "-mor_out",
        rom,
        *(options or ("-mor_tol", "1e-5")),
    )
    return ReducedModel.load(rom)


@pytest.fixture(scope="module", params=["rigid", "distributing", "held"])
def model(request: Any, tmp_path_factory: pytest.TempPathFactory) -> ReducedModel:
    """A free beam with two interfaces, and one that is held at one end."""
    folder = tmp_path_factory.mktemp(request.param)
    if request.param == "held":
        return reduced(folder, support=True)
    return reduced(folder, coupling=request.param)


def assert_same_response(
    model: ReducedModel,
    K: Any,
    M: Any,
    D: Any,
    form: PhysicalForm,
    tolerance: float,
    omega: Any = OMEGA,
) -> None:
    """H of matrices in the order of the form, against the body's."""
    for w in omega:
        H = form.C @ np.linalg.solve(K + 1j * w * D - w * w * M, form.B) + form.feedthrough
        expected = model.transfer(w)
        assert np.linalg.norm(H - expected) <= tolerance * np.linalg.norm(expected)


def assert_same_modes(model: ReducedModel, K: Any, M: Any, tolerance: float) -> None:
    found = np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0))
    elastic = model.modes > 1
    assert np.allclose(found[elastic], model.modes[elastic], rtol=tolerance)


def test_physical_form(model: ReducedModel) -> None:
    form = model.physical()
    assert form.order == model.order
    n = len(form.boundary)
    assert_same_response(model, form.K, form.M, form.D, form, 1e-12, OMEGA[1:])
    # Rounding of K_bb, of which rigid motion leaves nothing, is 3e-12 of ω²M at 20 Hz.
    assert_same_response(model, form.K, form.M, form.D, form, 2e-11, OMEGA[:1])
    assert_same_modes(model, form.K, form.M, 1e-9)
    assert np.allclose(form.T.T @ model.K @ form.T, form.K, atol=1e-9 * np.abs(form.K).max())
    # Motions of the interfaces are coordinates; statics exact; modes with interfaces held.
    rows = [model.outputs.index(name) for name in form.boundary]
    assert np.allclose((model.C @ form.T)[rows], np.eye(form.order)[:n], atol=1e-9)
    assert not form.K[:n, n:].any() and np.array_equal(form.M[n:, n:], np.eye(form.order - n))
    held = scipy.linalg.eigh(form.K[n:, n:], form.M[n:, n:], eigvals_only=True)
    assert np.allclose(np.sqrt(held), form.frequencies)
    if model.frame["rigid_modes"]:  # rigid motion costs no energy, and weighs the body's mass
        R = form.rigid_motions()
        assert np.abs(form.K[:n, :n] @ R).max() < 1e-12 * np.abs(form.K[:n, :n]).max()
        R = np.vstack([R, np.zeros((form.order - n, 6))])
        assert np.allclose(R.T @ form.M @ R, model.frame["M_r"], rtol=1e-8, atol=1e-10)


def test_what_has_no_physical_form(tmp_path: Path) -> None:
    small = reduced(tmp_path / "a", "-mor_order", "9")
    with pytest.raises(BodyError, match="the 9 coordinates hold 9 of the 12 motions of start, end"):
        small.physical()
    with pytest.raises(BodyError, match="hold 9 of the 12"):
        export(small, tmp_path / "x.op4", "op4")
    moved = reduced(tmp_path / "b")
    C = moved.C
    moved.C = C * 2
    with pytest.raises(BodyError, match="is not what the input drives"):
        moved.physical()
    moved.C = C
    moved.outputs = ["y." + name for name in moved.outputs]
    with pytest.raises(BodyError, match="no port is a force and its displacement"):
        moved.physical()


def test_nastran_superelement(model: ReducedModel, tmp_path: Path) -> None:
    """pyNastran reads grids at the interfaces and matrices on them."""
    pytest.importorskip("pyNastran")
    from pyNastran.bdf.bdf import BDF

    form = model.physical()
    export(model, tmp_path / "part.bdf", "nastran")
    bulk = BDF(debug=None)
    bulk.read_bdf(str(tmp_path / "part.bdf"), punch=True, xref=False)
    places = form.positions()
    assert len(bulk.nodes) == len(places)
    of: dict[tuple[int, int], int] = {}
    for (name, moves), (label, grid) in zip(
        form.interfaces.items(), bulk.nodes.items(), strict=True
    ):
        assert np.allclose(grid.xyz, places[name], rtol=1e-10, atol=1e-12)
        of |= {(label, direction + 1): row for direction, row in moves.items()}
    points = sorted(bulk.spoints)
    of |= {(point, 0): len(form.boundary) + k for k, point in enumerate(points)}
    assert sorted(of.values()) == list(range(form.order))
    found = {}
    for name in ("KAAX", "MAAX", "BAAX"):
        card = bulk.dmig[name]
        assert card.matrix_form == 6
        found[name] = np.zeros((form.order, form.order))
        for j, i, value in zip(card.GCj, card.GCi, card.Real, strict=True):
            row, column = of[tuple(i)], of[tuple(j)]
            found[name][row, column] = found[name][column, row] = value
    # Eleven digits: of a free body K keeps as much of what rigid motion costs.
    assert np.allclose(found["KAAX"], form.K, rtol=1e-9, atol=1e-11 * np.abs(form.K).max())
    assert_same_response(model, found["KAAX"], found["MAAX"], found["BAAX"], form, 2e-5)
    assert_same_modes(model, found["KAAX"], found["MAAX"], 1e-7)


def test_op4(model: ReducedModel, tmp_path: Path) -> None:
    pytest.importorskip("pyNastran")
    from pyNastran.op4.op4 import OP4

    form = model.physical()
    export(model, tmp_path / "part.op4", "op4")
    read = OP4().read_op4(str(tmp_path / "part.op4"))
    K, M, D, P = (
        np.asarray(read[name].data if hasattr(read[name], "data") else read[name][1])
        for name in ("KAA", "MAA", "BAA", "PA")
    )
    assert np.array_equal(P, form.B)
    assert np.allclose(K, form.K, rtol=1e-15, atol=0) and np.allclose(M, form.M, rtol=1e-15, atol=0)
    assert_same_response(model, K, M, D, form, 1e-9)
    assert_same_modes(model, K, M, 1e-9)


def test_checks_of_pyyeti(model: ReducedModel, tmp_path: Path) -> None:
    """pyYeti reads the matrices, drives the interfaces (``cbtf``) as H says, and its model checks
    (``cbcheck``) find the places, the rigid motions, the mass and the frequencies."""
    pytest.importorskip("pyyeti.cb")
    from pyyeti import cb
    from pyyeti.nastran import n2p, op4

    form = model.physical()
    export(model, tmp_path / "part.op4", "op4")
    read = op4.load(str(tmp_path / "part.op4"), into="dct")
    K, M, D = (np.asarray(read[name][0]) for name in ("kaa", "maa", "baa"))
    b = np.arange(len(form.boundary))
    outputs = [model.outputs.index(name) for name in form.boundary]
    inputs = [model.inputs.index(name) for name in form.boundary]
    for w in OMEGA:
        saved: dict[str, Any] = {}
        forces = np.array(
            [
                cb.cbtf(M, D, K, a, np.array([w / (2 * np.pi)]), b, saved).frc[:, 0]
                for a in -(w**2) * np.eye(len(b))
            ]
        ).T
        H = model.transfer(w)[np.ix_(outputs, inputs)]
        assert np.linalg.norm(H @ forces - np.eye(len(b))) < 1e-8 * len(b)
    uset = None
    for k, place in enumerate(form.positions().values()):
        uset = n2p.addgrid(uset, k + 1, "b", 0, place, 0)
    if model.frame["rigid_modes"]:
        said = tmp_path / "checks.txt"
        checked = cb.cbcheck(str(said), M, K, b, b[:6], uset, uref=1, n_freefree_modes=12)
        assert np.allclose(checked.cb_frq, form.frequencies / (2 * np.pi), rtol=1e-7)
        motions = form.rigid_motions()
        assert np.abs(checked.rbs[b] - np.linalg.solve(motions[:6].T, motions.T).T).max() < 1e-6
        mass = np.trace((checked.rbs.T @ checked.m @ checked.rbs)[:3, :3]) / 3
        assert mass == pytest.approx(model.frame["mass"], rel=1e-6)


@pytest.mark.parametrize("eta", [0.0, 0.02])
def test_abaqus_matrices(eta: float, model: ReducedModel, tmp_path: Path) -> None:
    """By the documented lines: row node, its dof, column node, its dof, value; one triangle."""
    kept, model.eta = model.eta, eta
    try:
        form = model.physical()
        export(model, tmp_path / "part.inp", "abaqus")
        lines = (tmp_path / "part.inp").read_text().splitlines()
        nodes: dict[int, list[float]] = {}
        matrices: dict[str, dict[tuple[int, ...], float]] = {}
        key, assembled = "", ""
        for line in lines:
            if line.startswith("**"):
                continue
            if line.startswith("*"):
                key = line
                assembled = line if line.startswith("*MATRIX ASSEMBLE") else assembled
            elif key.startswith("*NODE"):
                nodes[int(line.split(",")[0])] = [float(x) for x in line.split(",")[1:]]
            else:
                name = key.split("NAME=")[1].split(",")[0]
                *place, value = line.split(",")
                matrices.setdefault(name, {})[tuple(int(x) for x in place)] = float(value)
        of = {}
        for k, (name, moves) in enumerate(form.interfaces.items()):
            assert np.allclose(nodes[k + 1], form.positions()[name])
            of |= {(k + 1, direction + 1): row for direction, row in moves.items()}
        modes = [node for node in nodes if node > 1000]
        of |= {(node, 1): len(form.boundary) + k for k, node in enumerate(modes)}
        found = {}
        for role in ("STIFFNESS", "MASS", "VISCOUS DAMPING", "STRUCTURAL DAMPING"):
            a = np.zeros((form.order, form.order))
            for (n, d, o, e), value in matrices.get(
                f"FLEXGRAM_{role.replace(' ', '_')}", {}
            ).items():
                a[of[n, d], of[o, e]] = a[of[o, e], of[n, d]] = value
            assert (f"{role}=FLEXGRAM_{role.replace(' ', '_')}" in assembled) == bool(a.any())
            found[role] = a
        assert np.array_equal(found["STRUCTURAL DAMPING"], eta * form.K)
        K = found["STIFFNESS"] + 1j * found["STRUCTURAL DAMPING"]
        assert_same_response(model, K, found["MASS"], found["VISCOUS DAMPING"], form, 1e-9)
    finally:
        model.eta = kept


def test_simscape(model: ReducedModel, tmp_path: Path) -> None:
    """Frames where the interfaces are, six motions of each and then the modes; symmetric, M
    positive, and a free body costs no energy in rigid motion about its own frames."""
    form = model.physical()
    export(model, tmp_path / "part.mat", "simscape")
    data = scipy.io.loadmat(tmp_path / "part.mat")
    K, M, D, origins = (data[name] for name in ("K", "M", "D", "origins"))
    assert np.allclose(origins, list(form.positions().values()))
    assert np.array_equal(data["quaternions"], np.tile([1.0, 0, 0, 0], (len(origins), 1)))
    assert [str(x[0]) for x in data["frames"].ravel()] == list(form.interfaces)
    assert np.array_equal(K, K.T) and np.linalg.eigvalsh(M)[0] > 0
    assert_same_response(model, K, M, D, form, 1e-9)
    if model.frame["rigid_modes"]:
        R = np.zeros((len(K), 6))
        for k, place in enumerate(origins):
            x, y, z = place
            R[6 * k : 6 * k + 3] = [[1, 0, 0, 0, z, -y], [0, 1, 0, -z, 0, x], [0, 0, 1, y, -x, 0]]
            R[6 * k + 3 : 6 * k + 6, 3:] = np.eye(3)
        assert np.abs(K @ R).max() < 1e-11 * np.abs(K).max()
        assert np.trace((R.T @ M @ R)[:3, :3]) / 3 == pytest.approx(model.frame["mass"], rel=1e-9)


def flex5(path: Path) -> dict[str, Any]:
    """A file of the Flex 5 format, by its specification: lines with ! are comments or keys."""
    lines = iter(path.read_text().splitlines())
    assert next(lines).startswith("!") and "flex 5 format" in next(lines).lower()
    found: dict[str, Any] = {}
    for line in lines:
        key = line.strip().lower()
        if key.startswith("!dimension:"):
            found["n"] = int(key.partition(":")[2])
        elif key.startswith("!time increment in simulation:"):
            found["dt"] = float(key.partition(":")[2])
        elif key.startswith("!total simulation time in file:"):
            found["T"] = float(key.partition(":")[2])
        for name in ("mass", "stiffness", "damping"):
            if key.startswith(f"!{name} matrix"):
                assert next(lines).startswith("!")
                found[name] = np.array(
                    [[float(x) for x in next(lines).split()] for _ in range(found["n"])]
                )
        if key.startswith("!loading and wave elevation"):
            assert next(lines).startswith("!")
            steps = round(found["T"] / found["dt"]) + 1
            found["loads"] = np.array(
                [[float(x) for x in next(lines).split()] for _ in range(steps)]
            )
    return found


def test_extptfm(model: ReducedModel, tmp_path: Path) -> None:
    if len(model.physical().interfaces) > 1:
        with pytest.raises(BodyError, match="one interface of six ports"):
            export(model, tmp_path / "part.dat", "extptfm")
        return
    form = model.physical()
    export(model, tmp_path / "part.dat", "extptfm")
    read = flex5(tmp_path / "part.dat")
    assert read["n"] == form.order and read["loads"].shape == (2, form.order + 1)
    assert np.array_equal(read["stiffness"], form.K)
    assert_same_response(model, read["stiffness"], read["mass"], read["damping"], form, 1e-9)


def test_extptfm_by_the_reader_of_others(model: ReducedModel, tmp_path: Path) -> None:
    """weio, the files of OpenFAST in Python, reads the same matrices."""
    pytest.importorskip("weio.fast_input_file")
    from weio.fast_input_file import FASTInputFile

    form = model.physical()
    if len(form.interfaces) > 1:
        return
    export(model, tmp_path / "part.dat", "extptfm")
    read = FASTInputFile(str(tmp_path / "part.dat"))
    K, M, D = (
        np.asarray(read[f"{name}Matrix"], dtype=float) for name in ("Stiffness", "Mass", "Damping")
    )
    assert read.module == "ExtPtfm" and not np.any(np.asarray(read["Loading"])[:, 1:])
    assert_same_response(model, K, M, D, form, 1e-9)
    assert_same_modes(model, K, M, 1e-9)


def test_on_the_command_line(model: ReducedModel, tmp_path: Path) -> None:
    assert model.path is not None
    for format, name in (("nastran", "p.bdf"), ("op4", "p.op4"), ("simscape", "p.mat")):
        run("export", model.path, "--to", format, "-o", tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000
