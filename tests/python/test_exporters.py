"""Exporters: what other people's readers make of the files, and the transfer function from it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import scipy.io

from bodies import box, write_body_file
from conftest import assembled, run
from flexgram import BodyError, ReducedModel
from flexgram.exporters import export
from flexgram.exporters.sid import DIALECTS, read_sid, taylor_terms
from flexgram.model.geometry import Geometry, interface_motion, interface_positions

SIZE = (0.3, 0.04, 0.03)
OMEGA = 2 * np.pi * np.array([20.0, 180.0, 700.0, 1500.0])


@pytest.fixture(scope="module", params=["rigid", "distributing"])
def beam(request: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Body file and reduced file of a free beam with two interfaces."""
    folder = tmp_path_factory.mktemp(request.param)
    body, rom = folder / "beam.h5", folder / "beam.rom.h5"
    mesh = box("tetra10", (8, 2, 2), SIZE)
    interfaces = {name: {"coupling": request.param, "set": name} for name in ("start", "end")}
    write_body_file(body, mesh, interfaces=interfaces, damping=(3, 2e-6, 0))
    run("reduce", "-body", body, "-mor_band_hz", "10,2000", "-mor_tol", "1e-5", "-mor_out", rom)
    return body, rom


def transfer(M: Any, D: Any, K: Any, B: Any, C: Any) -> Any:
    return np.array([C @ np.linalg.solve(K + 1j * w * D - w * w * M, B) for w in OMEGA])


def assert_transfer(ours: Any, theirs: Any, tolerance: float = 1e-10) -> None:
    assert np.linalg.norm(ours - theirs) <= tolerance * np.linalg.norm(ours)


def test_matlab_numpy_state_space(beam: tuple[Path, Path], tmp_path: Path) -> None:
    model = ReducedModel.load(beam[1])
    H = model.transfer(OMEGA)
    export(model, tmp_path / "beam.mat", "mat")
    export(model, tmp_path / "beam.npz", "npz")
    for data in (scipy.io.loadmat(tmp_path / "beam.mat"), np.load(tmp_path / "beam.npz")):
        assert_transfer(H, transfer(*(data[name] for name in "MDKBC")))
    names = scipy.io.loadmat(tmp_path / "beam.mat")["inputs"].ravel()
    assert [str(x[0]) for x in names] == model.inputs
    export(model, tmp_path / "ss.mat", "state-space")
    A, B, C, D = (scipy.io.loadmat(tmp_path / "ss.mat")[name] for name in "ABCD")
    eye = np.eye(len(A))
    assert_transfer(H, np.array([C @ np.linalg.solve(1j * w * eye - A, B) + D for w in OMEGA]))


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="octave is not installed")
@pytest.mark.parametrize("structural", [False, True])
def test_script_in_octave(structural: bool, beam: tuple[Path, Path], tmp_path: Path) -> None:
    """What Octave makes of the script: H of its pair, natural frequencies and a step."""
    model = ReducedModel.load(beam[1])
    if structural:
        model.eta = 0.02
    export(model, tmp_path / "part_1.m", "octave")
    done = subprocess.run(
        [
            "octave-cli",
            "--no-gui",
            "--eval",
            "quiet = true; part_1; clear H; save('-v6', 'seen.mat')",
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    seen = scipy.io.loadmat(tmp_path / "seen.mat", squeeze_me=True)
    w = 2 * np.pi * seen["f"]
    assert w[0] == pytest.approx(model.band[0]) and w[-1] == pytest.approx(model.band[-1])
    i, j = int(seen["output"]) - 1, int(seen["input"]) - 1
    middle = np.abs(model.transfer(float(np.mean(model.band))))
    forces = [k for k, name in enumerate(model.inputs) if ".f" in name]
    assert j in forces and middle[i, j] == middle[:, forces].max()
    assert_transfer(model.transfer(w)[:, i, j], seen["h"])
    elastic = model.modes > 1
    assert np.allclose(seen["natural"][elastic], model.modes[elastic] / (2 * np.pi), rtol=1e-9)
    assert ("y" in seen) is not structural
    if not structural:
        t = seen["t"]
        u = np.zeros((len(t), len(model.inputs)))
        u[:, j] = 1
        y = model.simulate(u, t)[0]
        assert np.abs(seen["y"] - y).max() < 1e-9 * np.abs(y).max()
    with pytest.raises(BodyError, match="MATLAB's scripts are letters"):
        export(model, tmp_path / "part-1.m", "octave")
    export(model, tmp_path / "part_1.m", "octave")  # its own data are replaced


def test_script_replaces_nothing_of_others(beam: tuple[Path, Path], tmp_path: Path) -> None:
    """Neither the reduced file nor data of the same name; names of ports are never part of it."""
    shutil.copy(beam[1], tmp_path / "rob.m.mat")
    model = ReducedModel.load(tmp_path / "rob.m.mat")
    before = (tmp_path / "rob.m.mat").read_bytes()
    with pytest.raises(BodyError, match="not of such a script"):
        export(model, tmp_path / "rob.m", "octave")
    assert (tmp_path / "rob.m.mat").read_bytes() == before and not (tmp_path / "rob.m").exists()
    (tmp_path / "own.m.mat").write_text("precious")
    with pytest.raises(BodyError, match="not of such a script"):
        export(model, tmp_path / "own.m", "octave")
    for word in ("end", "load", "expm", "quiet"):
        with pytest.raises(BodyError, match="a word of the language"):
            export(model, tmp_path / f"{word}.m", "octave")
    model.inputs = [name.replace("start", "it's');system('false') % ") for name in model.inputs]
    model.outputs = list(model.inputs)
    export(model, tmp_path / "odd.m", "octave")
    assert "system" not in (tmp_path / "odd.m").read_text()
    if shutil.which("octave-cli"):
        done = subprocess.run(
            ["octave-cli", "--no-gui", "--eval", "quiet = true; odd"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr


def records(path: Path) -> dict[int, list[str]]:
    """Words of the records of an MBDyn file; lines that begin with ** are comments."""
    found: dict[int, list[str]] = {}
    for line in path.read_text().splitlines():
        if line.startswith("** RECORD GROUP"):
            number = int(line[16:].split(",")[0])
            found[number] = []
        elif not line.startswith("**"):
            found[number] += line.split()
    return found


def test_mbdyn_modal_joint(beam: tuple[Path, Path], tmp_path: Path) -> None:
    """What the file holds, by the manual's records: H of the elastic part, places, inertia."""
    model = ReducedModel.load(beam[1])
    export(model, tmp_path / "beam.fem", "mbdyn")
    read = records(tmp_path / "beam.fem")
    elastic = model.elastic()
    m = elastic.order
    assert read[1][1:] == ["2", str(m), "0", "0", "0"] and read[2] == ["start", "end"]
    at = {n: np.array(words, dtype=float) for n, words in read.items() if n > 2}
    for k, place in enumerate(interface_positions(model).values()):
        assert np.allclose([at[5][k], at[6][k], at[7][k]], place, atol=1e-15)
    shapes = at[8].reshape(m, 12).T
    M, K, D = (at[n].reshape(m, m) for n in (9, 10, 13))
    assert_transfer(elastic.transfer(OMEGA), transfer(M, D, K, shapes.T, shapes))
    mass, centre, J = at[12][0], at[12][1:4], at[12][4:].reshape(3, 3)
    about_origin = J + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    assert np.allclose(about_origin, model.frame["M_r"][3:, 3:], rtol=1e-12)
    assert mass == pytest.approx(model.frame["M_r"][0, 0], rel=1e-12)
    tangent = tmp_path / "tangent.h5"
    run(
        "reduce",
        "-body",
        beam[0],
        "-mor_band_hz",
        "10,2000",
        "-mor_frame",
        "tangent",
        "-mor_out",
        tangent,
    )
    with pytest.raises(BodyError, match="--frame buckens"):
        export(ReducedModel.load(tangent), tmp_path / "x.fem", "mbdyn")
    model.eta = 0.01
    with pytest.raises(BodyError, match="structural damping"):
        export(model, tmp_path / "x.fem", "mbdyn")


def test_rates_of_outputs(beam: tuple[Path, Path], tmp_path: Path) -> None:
    """Velocities and accelerations: iωH and −ω²H, and in time the derivatives."""
    model = ReducedModel.load(beam[1])
    every = ["displacement", "velocity", "acceleration"]
    export(model, tmp_path / "ss.mat", "state-space", rates=every)
    data = scipy.io.loadmat(tmp_path / "ss.mat")
    A, B, C, D = (data[name] for name in "ABCD")
    names = [str(x[0]) for x in data["outputs"].ravel()]
    n = len(model.outputs)
    assert names[::n] == [model.outputs[0] + dots for dots in ("", "'", "''")]
    eye = np.eye(len(A))
    for w, H in zip(OMEGA, model.transfer(OMEGA), strict=True):
        found = C @ np.linalg.solve(1j * w * eye - A, B) + D
        assert_transfer(np.vstack([H, 1j * w * H, -w * w * H])[None], found[None])
    t = np.linspace(0, 2e-3, 4001)
    force = np.outer(np.sin(2000 * t) ** 2, np.ones(len(model.inputs)))
    y, _ = model.simulate(force, t, rates=every)
    place, speed, jerk = y[:, :n], y[:, n : 2 * n], y[:, 2 * n :]
    inner = slice(10, -10)  # of one-sided differences nothing is asked
    for rate, of in ((speed, place), (jerk, speed)):
        off = np.abs(np.gradient(of, t, axis=0) - rate)[inner].max()
        assert off < 1e-4 * np.abs(rate).max()
    with pytest.raises(BodyError, match="expected some of displacement"):
        model.state_space(["speed"])


def test_pymor(beam: tuple[Path, Path]) -> None:
    pytest.importorskip("pymor")
    from flexgram.exporters.arrays import to_pymor

    model = ReducedModel.load(beam[1])
    theirs = to_pymor(model)
    values = np.array([theirs.transfer_function.eval_tf(1j * w) for w in OMEGA])
    assert_transfer(model.transfer(OMEGA), values)
    both = to_pymor(model, ["velocity", "displacement"]).transfer_function
    for w, H in zip(OMEGA, model.transfer(OMEGA), strict=True):
        assert_transfer(np.vstack([1j * w * H, H])[None], both.eval_tf(1j * w)[None])


def test_dmig_is_read_by_pynastran(beam: tuple[Path, Path], tmp_path: Path) -> None:
    pytest.importorskip("pyNastran")
    from pyNastran.bdf.bdf import BDF

    model = ReducedModel.load(beam[1])
    export(model, tmp_path / "beam.pch", "dmig")
    bulk = BDF(debug=None)
    bulk.read_bdf(str(tmp_path / "beam.pch"), punch=True, xref=False)

    def matrix(name: str, rows: int, columns: int) -> Any:
        card = bulk.dmig[name]
        full = np.zeros((rows, columns))
        for j, i, value in zip(card.GCj, card.GCi, card.Real, strict=True):
            full[i[0] - 1, j[0] - 1] = value
            if card.matrix_form == 6:
                full[j[0] - 1, i[0] - 1] = value
        return full

    m, p = model.order, len(model.inputs)
    K, M, D, P = (matrix(f"{x}RED", m, p if x == "P" else m) for x in "KMBP")
    # sixteen columns hold eleven digits of a negative number
    assert_transfer(model.transfer(OMEGA), transfer(M, D, K, P, P.T), 1e-10)
    assert sorted(bulk.spoints) == list(range(1, m + 1))


def test_shapes_are_read_by_meshio(beam: tuple[Path, Path], tmp_path: Path) -> None:
    body, rom = beam
    model = ReducedModel.load(rom)
    export(model, tmp_path / "beam.vtu", "vtu", body=body)
    mesh = meshio.read(tmp_path / "beam.vtu")
    with h5py.File(body) as file:
        assert np.allclose(mesh.points, file["mesh/points"][:])
        assert mesh.cells[0].data.shape == file["mesh/blocks/0000/connectivity"].shape
    # The first six are rigid: no point moves relative to another along their line.
    a, b = 0, len(mesh.points) - 1
    line = mesh.points[b] - mesh.points[a]
    for j in range(6):
        phi = mesh.point_data[f"phi_{j + 1:03d}"]
        assert abs((phi[b] - phi[a]) @ line) < 1e-10 * np.abs(phi).max() * np.linalg.norm(line)
    assert len(mesh.point_data) == model.order


def test_motion_over_time_is_read_by_meshio(beam: tuple[Path, Path], tmp_path: Path) -> None:
    from flexgram.exporters.shapes import write_motion

    model = ReducedModel.load(beam[1])
    q = np.eye(model.order)[:3]
    write_motion(model, tmp_path / "run.xdmf", [0.0, 0.1, 0.2], q, body=beam[0])
    with meshio.xdmf.TimeSeriesReader(tmp_path / "run.xdmf") as reader:
        reader.read_points_cells()
        steps = [reader.read_data(k) for k in range(reader.num_steps)]
    assert [time for time, *_ in steps] == [0.0, 0.1, 0.2]
    motion = Geometry.load(beam[0]).motion(model, q)
    assert np.allclose([data["u"] for _, data, *_ in steps], motion)


def test_interfaces_and_followers(beam: tuple[Path, Path]) -> None:
    """Positions from the rigid modes; nodes of rigid interfaces move with the mesh around them."""
    body, rom = beam
    model = ReducedModel.load(rom)
    geometry = Geometry.load(body)
    with h5py.File(body) as file:
        for name, at in interface_positions(model).items():
            assert np.allclose(at, file[f"interfaces/{name}"].attrs["position"], atol=1e-9)
    # a rigid translation by x in generalised coordinates
    q = model.frame["M_er"][:, 0] * (np.arange(model.order) < 6)
    motion = geometry.motion(model, q)[0]
    assert np.allclose(motion, [1, 0, 0], atol=1e-9)
    triangles = geometry.surface()
    normal = np.cross(
        *(geometry.points[triangles[:, k]] - geometry.points[triangles[:, 0]] for k in (1, 2))
    )
    volume = np.sum(geometry.points[triangles[:, 0]] * normal) / 6  # closed and outward
    with h5py.File(rom) as file:
        assert volume == pytest.approx(file["frame"].attrs["mass"] / 7850, rel=0.02)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_sid_identities_and_round_trip(
    beam: tuple[Path, Path], tmp_path: Path, dialect: str
) -> None:
    model = ReducedModel.load(beam[1])
    body = model.elastic()
    path = tmp_path / "beam.SID_FEM"
    export(model, path, "sid", dialect=dialect)
    sid = read_sid(path, dialect)
    n = body.order
    for name, (m0, m1) in taylor_terms(body).items():
        assert np.allclose(sid[name][0], m0, rtol=1e-14, atol=0), name
        assert (m1 is None) == (sid[name][1] is None)
        if m1 is not None:
            assert np.allclose(sid[name][1], m1, rtol=1e-14, atol=0), name
    # identities of a SID (mode q, axis a)
    Ct, Cr, J1 = sid["Ct"][0], sid["Cr"], sid["J"][1]
    assert np.allclose(sid["mdCM"][1][:, :, 0], Ct)
    C4 = -sid["Gr"][0].reshape(3, n, 3).transpose(1, 0, 2) / 2
    assert np.allclose(
        sid["Oe"][0],
        [
            [c[0, 0], c[1, 1], c[2, 2], c[0, 1] + c[1, 0], c[1, 2] + c[2, 1], c[0, 2] + c[2, 0]]
            for c in C4
        ],
    )
    full = -(C4 + C4.transpose(0, 2, 1))
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    assert np.allclose(J1[:, :, 0], [[c[p] for p in places] for c in full])
    Ge = sid["Ge"][0].reshape(n, n, 3)  # (j, mode, axis)
    assert np.allclose(Ge, 2 * Cr[1].transpose(1, 0, 2))
    # Buckens: no momentum
    scale = np.sqrt(sid["mass"])
    assert np.abs(Ct).max() < 1e-9 * scale and np.abs(Cr[0]).max() < 1e-9 * scale
    assert np.allclose(sid["Me"][0], np.eye(n), atol=1e-10)
    motion = interface_motion(body)
    for node, (phi, psi) in zip(sid["nodes"].values(), motion.values(), strict=True):
        assert np.allclose(node["origin"][1][:, :, 0], node["phi"][0].T)
        assert np.allclose(node["phi"][0], phi) and np.allclose(node["psi"][0], psi)
        for q, turn in enumerate(node["AP"][1]):
            assert np.allclose(turn @ [1, 2, 3], np.cross(psi[:, q], [1, 2, 3]))
    # the transfer function from the file (self-equilibrated part)
    P = np.vstack([np.vstack([v["phi"][0], v["psi"][0]]) for v in sid["nodes"].values()])
    K, M, D = (sid[name][0] for name in ("Ke", "Me", "De"))
    assert_transfer(body.transfer(OMEGA), transfer(M, D, K, P.T, P))
    with pytest.raises(BodyError, match="dialect"):
        export(model, path, "sid", dialect="none")


def test_exudyn_terms_against_its_own(beam: tuple[Path, Path], tmp_path: Path) -> None:
    """The integrals against those that EXUDYN computes from the full matrices."""
    pytest.importorskip("exudyn")
    from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface

    body, rom = beam
    model = ReducedModel.load(rom)
    path = tmp_path / "beam.npz"
    export(model, path, "exudyn", body=body)
    loaded = ObjectFFRFreducedOrderInterface()
    loaded.LoadFromFile(str(path))
    # The transfer function from what EXUDYN has: interfaces are the means of their six points.
    elastic = model.elastic()
    with np.load(path, allow_pickle=True) as file:
        points = [file["interfaceNodes"][k] for k in range(2)]
        D = file["dampingMatrixReduced"]
        assert [str(x) for x in file["interfaceNames"]] == ["start", "end"]
    basis = loaded.modeBasis.reshape(-1, 3, elastic.order)
    places = np.asarray(loaded.xRef).reshape(-1, 3)
    rows = []
    for nodes in points:
        arm = places[nodes] - places[nodes].mean(axis=0)
        inertia = np.einsum("ka,ka->", arm, arm) * np.eye(3) - arm.T @ arm
        turn = np.linalg.solve(inertia, np.cross(arm[:, :, None], basis[nodes], axis=1).sum(axis=0))
        rows += [basis[nodes].mean(axis=0), turn]
    P = np.vstack(rows)
    H = transfer(loaded.massMatrixReduced, D, loaded.stiffnessMatrixReduced, P.T, P)
    assert_transfer(elastic.transfer(OMEGA), H)
    if "rigid" in str(rom):  # its nodes with rotations have no place in EXUDYN's own computation
        assert loaded.totalMass == pytest.approx(model.frame["mass"])
        return
    full = assembled(tmp_path / "full.h5", body)
    order = np.lexsort((full["component"], full["node"]))
    elastic = model.elastic()
    ours = np.lexsort((model.component, model.node))
    assert np.array_equal(full["node"][order], model.node[ours])
    fem = FEMinterface()
    fem.nodes = {"Position": full["position"][order][::3]}

    fem.massMatrix, fem.stiffnessMatrix = (full[x][order][:, order].tocsr() for x in "MK")
    fem.modeBasis = {"matrix": elastic.V[ours], "type": "flexgram"}
    fem.surface, fem.postProcessingModes = [], {}
    theirs = ObjectFFRFreducedOrderInterface(fem, roundMassMatrix=0, roundStiffnessMatrix=0)
    expected = theirs.GetDictionary()
    for key in (
        "massMatrixReduced",
        "stiffnessMatrixReduced",
        "inertiaLocal",
        "Mtt",
        "chiU",
        "chiUtilde",
        "mPsiTildePsi",
        "mPsiTildePsiTilde",
        "mPhitTPsi",
        "mPhitTPsiTilde",
        "mXRefTildePsi",
        "mXRefTildePsiTilde",
    ):
        value = np.asarray(expected[key])
        scale = max(np.abs(value).max(), 1e-3)
        assert np.shape(getattr(loaded, key)) == value.shape, key
        assert np.abs(getattr(loaded, key) - value).max() <= 1e-9 * scale, key


def test_what_cannot_be_exported(tmp_path: Path) -> None:
    mesh = box("tetra10", (4, 1, 1), SIZE)
    for name, eta, support in (("held", 0.0, {"start": [0, 1, 2]}), ("lossy", 0.01, {})):
        body, rom = tmp_path / f"{name}.h5", tmp_path / f"{name}.rom.h5"
        write_body_file(
            body,
            mesh,
            interfaces={"end": {"coupling": "rigid", "set": "end"}},
            supports=support,
            damping=(0, 0, eta),
        )
        run("reduce", "-body", body, "-mor_tol", "1e-3", "-mor_out", rom)
    held, lossy = (ReducedModel.load(tmp_path / f"{x}.rom.h5") for x in ("held", "lossy"))
    for model, format, expected in (
        (held, "exudyn", "needs a free body with six rigid modes"),
        (held, "sid", "needs the frame integrals"),
        (lossy, "exudyn", "no structural damping"),
        (lossy, "sid", "no structural damping"),
        (lossy, "dmig", "PARAM,G"),
        (lossy, "state-space", "no real time-domain"),
        (held, "step", "must be one of"),
    ):
        with pytest.raises(BodyError, match=expected):
            export(model, tmp_path / "x", format)
    with pytest.raises(BodyError, match="no reduced file"):
        ReducedModel.load(tmp_path / "held.h5")
