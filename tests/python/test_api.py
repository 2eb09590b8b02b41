"""flexgram.reduce in Python, ReducedModel, report and command line."""

from __future__ import annotations

import copy
import html.parser
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import flexgram
from conftest import ENVIRONMENT, PYTHON, ROOT, chain, program, rom_matrices, rom_transfer, run
from flexgram.__main__ import main


@pytest.mark.parametrize("ranks", [1, 2])
def test_file_like_the_program(rack: Path, tmp_path: Path, ranks: int) -> None:
    theirs, ours = tmp_path / "program.h5", tmp_path / "python.h5"
    run("reduce", "-body", rack, "-mor_tol", "1e-3", "-mor_out", theirs, ranks=ranks)
    program("like_the_program", rack, ours, ranks=ranks)
    a, b = rom_matrices(theirs), rom_matrices(ours)
    for omega in (100.0, 700.0, 3000.0):
        assert np.allclose(rom_transfer(a, omega), rom_transfer(b, omega), rtol=1e-8)
    with h5py.File(theirs) as x, h5py.File(ours) as y:
        assert set(x) == set(y) and set(x["frame"]) == set(y["frame"])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("which", ["scipy", "petsc"])
def test_matrices_in_memory(tmp_path: Path, which: str, ranks: int) -> None:
    if which == "petsc":
        pytest.importorskip("petsc4py")
    program("in_memory", tmp_path / "rom.h5", which, ranks=ranks)
    model = flexgram.ReducedModel.load(tmp_path / "rom.h5")
    assert model.inputs == ["tip", "middle"] and model.outputs == ["third"]


@pytest.mark.parametrize("ranks", [1, 2])
def test_errors_are_exceptions_on_every_rank(tmp_path: Path, ranks: int) -> None:
    program("errors", ranks=ranks)


def test_duplicate_entries_are_summed_and_labels_are_any(tmp_path: Path) -> None:
    program("duplicates")


def test_petsc_matrix_is_free_afterwards(tmp_path: Path) -> None:
    """A kept result does not keep K."""
    pytest.importorskip("petsc4py")
    program("petsc_is_free")


def test_damper_to_ground_has_no_floating_frame(tmp_path: Path) -> None:
    """D on rigid motion cannot be handed to a floating frame; Rayleigh damping can."""
    import scipy.sparse as sp

    from bodies import box, write_body_file
    from conftest import assembled
    from flexgram.exporters import export

    mesh = box("tetra10", (4, 1, 1))
    ends = {name: {"set": name, "coupling": "rigid"} for name in ("start", "end")}
    write_body_file(tmp_path / "mesh.h5", mesh, interfaces=ends)
    full = assembled(tmp_path / "full.h5", tmp_path / "mesh.h5")
    n = full["K"].shape[0]
    node, at = np.unique(full["node"], return_inverse=True)
    places = np.zeros((len(node), 3))
    places[at] = full["position"]
    for name, D, alpha in (
        ("damper", sp.coo_matrix(([40.0], ([9], [9])), shape=(n, n)), 0.0),
        ("rayleigh", None, 5.0),
    ):
        body, rom = tmp_path / f"{name}.h5", tmp_path / f"{name}.rom.h5"
        flexgram.write_matrices(
            body,
            full["K"],
            full["M"],
            full["B"],
            D=D,
            alpha=alpha,
            node=at,
            component=full["component"],
            position=places,
            inputs=[str(x) for x in full["names"]],
        )
        run("reduce", "-body", body, "-mor_band_hz", "10,9000", "-mor_tol", "1e-2", "-mor_out", rom)
        model = flexgram.ReducedModel.load(rom)
        if name == "damper":
            with pytest.raises(flexgram.BodyError, match="dampers act on the rigid motion"):
                export(model, tmp_path / "x.npz", "exudyn")
        else:
            export(model, tmp_path / "x.npz", "exudyn")
    run(
        "reduce",
        "-body",
        tmp_path / "rayleigh.h5",
        "-mor_inputs",
        "end.fx,end.fz",
        "-mor_tol",
        "1e-2",
        "-mor_out",
        tmp_path / "few.h5",
    )
    with pytest.raises(flexgram.BodyError, match="end has the ports fx, fz only"):
        export(flexgram.ReducedModel.load(tmp_path / "few.h5"), tmp_path / "x.npz", "exudyn")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> flexgram.ReducedModel:
    folder = tmp_path_factory.mktemp("chain")
    body = chain(alpha=0.05)
    flexgram.write_matrices(folder / "chain.h5", **body)
    run(
        "reduce",
        "-body",
        folder / "chain.h5",
        "-mor_band_hz",
        "0.001,0.2",
        "-mor_tol",
        "1e-8",
        "-mor_out",
        folder / "rom.h5",
    )
    return flexgram.ReducedModel.load(folder / "rom.h5")


def test_simulate_is_exact_for_linear_inputs(model: flexgram.ReducedModel) -> None:
    """Ramp and sine against the adaptive integration of the same equations."""
    from scipy.integrate import solve_ivp

    t = np.linspace(0, 40, 401)
    A, B, C, _ = model.state_space()

    def u(x: float) -> Any:
        return [min(x, 10.0), np.interp(x, t, np.sin(0.4 * t))]

    q0 = np.linspace(0, 1, model.order)
    y, q = model.simulate(u, t, q0=q0)
    truth = solve_ivp(
        lambda x, s: A @ s + B @ u(x),
        (0, 40),
        np.r_[q0, 0 * q0],
        t_eval=t,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.1,
    ).y
    assert np.abs(y - truth.T @ C.T).max() < 1e-7 * np.abs(y).max()
    assert np.allclose(model.lift(q), q @ model.V.T)
    with pytest.raises(flexgram.BodyError, match="evenly spaced"):
        model.simulate(u, t**2)
    with pytest.raises(flexgram.BodyError, match="2 × 401, expected 401 times × 2"):
        model.simulate(np.zeros((2, 401)), t)
    with pytest.raises(flexgram.BodyError, match="rising"):
        model.simulate(u, t[::-1])
    with pytest.raises(flexgram.BodyError, match="401 × 3, expected 401 times × 2 inputs"):
        model.simulate(np.zeros((401, 3)), t)


def test_plot(model: flexgram.ReducedModel, tmp_path: Path) -> None:
    model.plot("error", tmp_path / "e.svg")
    assert (tmp_path / "e.svg").stat().st_size > 1000
    with pytest.raises(flexgram.BodyError, match="no mesh"):
        model.plot("shapes")
    with pytest.raises(flexgram.BodyError, match="must be one of"):
        model.plot("everything")


def test_poles(model: flexgram.ReducedModel) -> None:
    poles = model.poles()
    assert np.all(poles.real < 0) and len(poles) == 2 * model.order
    omega = np.sqrt(scipy.linalg.eigh(model.K, model.M, eigvals_only=True))
    assert np.allclose(np.sort(np.abs(poles))[::2], np.sort(omega), rtol=1e-8)


def test_command_line_under_mpirun(tmp_path: Path) -> None:
    """One rank works, the others do not disturb it; a failure is the run's."""
    body = tmp_path / "rack.h5"
    for description, status in (("rack.yaml", 0), ("none.yaml", 1)):
        command = [
            "mpirun",
            "-n",
            "2",
            str(PYTHON),
            "-m",
            "flexgram",
            "import",
            str(ROOT / "meshes" / description),
            "-o",
            str(body),
        ]
        done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
        assert done.returncode == status, done.stderr
        assert (done.stdout + done.stderr).count("rack.h5: " if status == 0 else "none.yaml: ") == 1
    assert h5py.is_hdf5(body)


class Page(html.parser.HTMLParser):
    """Counts what a report must have; refuses anything that is not in the page itself."""

    def __init__(self) -> None:
        super().__init__()
        self.images, self.text, self.open = 0, "", 0

    def handle_starttag(self, tag: str, attributes: Any) -> None:
        values = dict(attributes)
        for key in ("src", "href"):
            assert values.get(key, "data:").startswith("data:"), values
        self.images += tag == "img"

    def handle_data(self, data: str) -> None:
        self.text += data


def test_report_and_figures(rack: Path, tmp_path: Path) -> None:
    rom, sweep = tmp_path / "rack.rom.h5", tmp_path / "sweep.h5"
    run("reduce", "-body", rack, "-mor_tol", "1e-2", "-mor_out", rom)
    run("sweep", "-body", rack, "-mor_sweep_hz", "10,500,21", "-mor_sweep_out", sweep)
    assert main(["report", str(rom), "--sweep", str(sweep), "-o", str(tmp_path / "r.html")]) == 0
    page = Page()
    page.feed((tmp_path / "r.html").read_text())
    assert page.images in (3, 5)  # with the libraries of the page, and without
    assert 'class="card good"' in (tmp_path / "r.html").read_text()
    for words in ("12 / 12", "skipped", "buckens", "Modes of the reduced body", "-mor_tol 1e-2"):
        assert words in page.text, words
    model = flexgram.ReducedModel.load(rom)
    hz, _ = flexgram.pictures.drawings.elastic_modes(model, 5)
    assert np.allclose(hz, model.modes[6:11] / (2 * np.pi), rtol=1e-6)
    assert max(model.whole_error, *model.by_kind) == model.certified_error
    for name in ("error", "gramian", "transfer", "stages", "shapes"):
        for suffix in ("png", "svg", "pdf"):
            path = tmp_path / f"{name}.{suffix}"
            assert main(["plot", str(rom), "--figure", name, "-o", str(path)]) == 0
            assert path.stat().st_size > 1000
    assert main(["plot", str(rom), "-o", str(tmp_path / "all"), "--suffix", "svg"]) == 0
    assert len(list((tmp_path / "all").iterdir())) == 5
    shown = [
        "plot",
        str(rom),
        "--figure",
        "transfer",
        "--port",
        "upper.fz,lower.fz",
        "--sweep",
        str(sweep),
        "-o",
        str(tmp_path / "t.png"),
    ]
    assert main(shown) == 0


def test_report_of_a_body_without_mesh(model: Any, tmp_path: Path, capsys: Any) -> None:
    model.save(tmp_path / "rom.h5")
    assert main(["report", str(tmp_path / "rom.h5"), "-o", str(tmp_path / "r.html")]) == 0
    assert "left out shapes" in capsys.readouterr().out


def test_commands(rack: Path, tmp_path: Path, capsys: Any) -> None:
    rom = tmp_path / "rack.rom.h5"
    run("reduce", "-body", rack, "-mor_tol", "1e-2", "-mor_out", rom)
    assert main(["info", str(rom)]) == 0
    said = capsys.readouterr().out
    assert "two_step" in said and "mass 178.278 kg" in said and "certified" in said
    assert main(["info", str(rack)]) == 0
    assert "interface lower: rigid" in capsys.readouterr().out
    csv = tmp_path / "out.csv"
    force = ["--force", "upper.fz=-1e4*sin(20*pi*t)", "--force", "upper.fx=10*t"]
    assert (
        main(
            [
                "simulate",
                str(rom),
                *force,
                "--time",
                "0,0.1,101",
                "-o",
                str(csv),
                "--xdmf",
                str(tmp_path / "m.xdmf"),
            ]
        )
        == 0
    )
    table = np.genfromtxt(csv, delimiter=",", names=True)
    assert len(table) == 101 and len(table.dtype.names) == 13
    assert np.abs(table["upperfz"]).max() > 0 and (tmp_path / "m.xdmf.h5").exists()
    for to, name in (
        ("exudyn", "a.npz"),
        ("sid", "a.SID_FEM"),
        ("dmig", "a.pch"),
        ("mat", "a.mat"),
        ("npz", "b.npz"),
        ("state-space", "c.mat"),
        ("vtu", "a.vtu"),
    ):
        assert main(["export", str(rom), "--to", to, "-o", str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 1000
    capsys.readouterr()
    for arguments, expected in (
        (["info", str(tmp_path / "none.h5")], "no such file"),
        (["info", str(csv)], "not an HDF5 file"),
        (["report", str(rack), "-o", "x.html"], "no reduced file"),
        (["export", str(rom), "--to", "mat", "--dialect", "dlr", "-o", "x"], "belongs to --to sid"),
        (["simulate", str(rom), "--force", "upper=1", "-o", "x.csv"], "there is no port upper"),
        (["simulate", str(rom), "--force", "upper.fz=open('x')", "-o", "x.csv"], "--force"),
        (["plot", str(rom), "--figure", "modes", "-o", "x.png"], "must be one of"),
        (["plot", str(rom), "--figure", "error", "-o", str(tmp_path / "x.doc")], "x.doc"),
        (["import", "part.xyz", "-o", "x.h5"], "the format is not told by the name"),
    ):
        assert main(arguments) == 1
        message = capsys.readouterr().err
        assert message.startswith("flexgram: ") and expected in message, message
        assert message.count("\n") == 1


def test_ctrl_c_ends_a_call_and_nothing_else(rack: Path) -> None:
    told = [line.split(maxsplit=1) for line in program("interrupted", rack).splitlines()]
    assert [line[0] for line in told] == ["certify", "cut", "pod", "equal", "order"]
    assert all(how == "between the steps of flexgram's work" for _, how in told[:3])
    assert told[3:] == [["equal", "True"], ["order", "True certified"]]


@pytest.mark.parametrize("seed", range(6))
def test_ports_that_span_the_body(seed: int) -> None:
    """Where the space is all of the body, what is left of further vectors is rounding."""
    rng = np.random.default_rng(seed)
    n, n_in, n_out = (60, 70, 70) if seed % 2 else (105, 88, 80)
    first = np.r_[np.arange(n - 1), rng.integers(0, n - 1, n // 2)]
    last = np.minimum(first + np.r_[np.ones(n - 1, int), rng.integers(2, 30, n // 2)], n - 1)
    k = np.where(first == last, 0.0, 10 ** rng.uniform(4, 7, len(first)))
    entries = (
        np.r_[k, k, -k, -k],
        (np.r_[first, last, first, last], np.r_[first, last, last, first]),
    )
    K = sp.coo_matrix(entries, shape=(n, n)).tocsr()
    M = sp.diags(10 ** rng.uniform(-3, -1, n)).tocsr()
    B, C = np.zeros((n, n_in)), np.zeros((n_out, n))
    for columns, scale in ((B.T, 1e3), (C, 1.0)):  # a few entries each
        for column in columns:
            at = rng.integers(0, n, rng.integers(1, 6))
            column[at] = scale * rng.standard_normal(len(at))
    modes = np.sqrt(np.abs(scipy.linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)))
    band = (modes[1] / 4 / np.pi, modes[5] * 1.02 / 2 / np.pi)
    body = flexgram.Matrices(K=K, M=M, B=B, C=C, alpha=0.01, beta=1e-8)
    rom = flexgram.reduce(body, band, 1e-2)
    assert rom.met
    for w in 2 * np.pi * rng.uniform(*band, 6):
        A = K.toarray() * (1 + 1j * w * 1e-8) + (0.01j * w - w * w) * M.toarray()
        H = C @ np.linalg.solve(A, B)
        assert np.linalg.norm(rom.transfer(w) - H) <= 1.001e-2 * np.linalg.norm(H)


def test_bands_flat_and_in_pairs() -> None:
    body = chain()
    matrices = flexgram.Matrices(K=body["K"], M=body["M"], B=body["B"], alpha=1.0, beta=1e-6)
    flat = flexgram.reduce(matrices, (10, 60, 90, 150), 1e-3)
    pairs = flexgram.reduce(matrices, [(10, 60), (90, 150)], 1e-3)
    assert np.allclose(flat.bands, 2 * np.pi * np.array([[10, 60], [90, 150]]))
    assert np.array_equal(flat.bands, pairs.bands) and flat.order == pairs.order
    single = flexgram.reduce(matrices, (60,), 1e-3)
    assert np.allclose(single.bands, 2 * np.pi * 60) and single.met
    for wrong in ("10,60", [], [(10, 60), (90,)], [None, 3], (1, 2, 3), 5):
        with pytest.raises(flexgram.BodyError, match="band_hz must be first and last"):
            flexgram.reduce(matrices, wrong, 1e-3)  # type: ignore[arg-type]


def test_options_as_keywords() -> None:
    """Typed by the registry; what is none of them is a TypeError with the nearest name."""
    body = flexgram.Matrices(**chain(40))
    rom = flexgram.reduce(
        body,
        (0.01, 0.2),
        1e-3,
        second_stage="gramian",
        relative_to="band",
        statics=True,
        error_hz=[0.1, 0.15, 2],
    )
    named = {
        "mor_second_stage": "gramian",
        "mor_tol_relative_to": "band",
        "mor_statics": "yes",
        "mor_error_hz": "0.1,0.15,2",
    }
    same = flexgram.reduce(body, (0.01, 0.2), 1e-3, options=named)
    assert rom.claim.relative_to == "band" and rom.provenance.second_stage == "gramian"
    assert np.array_equal(rom.system.K, same.system.K)
    assert np.array_equal(rom.claim.omega, same.claim.omega)
    medium = flexgram.certify(body, (0.01, 0.2), 1e-4)
    assert medium.reduce(1e-3, inputs=None, second_stage="gramian").claim.met
    with pytest.raises(TypeError, match="no option secnd_stage: did you mean second_stage"):
        flexgram.reduce(body, (0.01, 0.2), 1e-3, secnd_stage="gramian")  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="no option tolerance: did you mean tol"):
        flexgram.reduce(body, (0.01, 0.2), tolerance=1e-3)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="no option checkpoint"):
        flexgram.certify(body, (0.01, 0.2), 1e-3, checkpoint="yes")  # type: ignore[call-arg]


def test_a_body_is_made_of_parts(model: flexgram.ReducedModel) -> None:
    """What users of 0.1 call attributes of the body are those of its parts, also when they are
    set."""
    assert model.K is model.system.K and model.V is model.basis.V
    assert model.certified_error == model.claim.supremum
    assert dict(model.frame) == {"kind": "none", "rigid_modes": 0} and "M_r" not in model.frame
    assert model.log["plan"] == model.provenance.plan
    other = copy.copy(model)
    other.eta = 0.02
    assert other.system.eta == 0.02 and model.system.eta == 0
    with pytest.raises(AttributeError, match="no attribute stiffness"):
        _ = model.stiffness
