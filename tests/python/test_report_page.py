"""The page of a reduced body: its data against the body, and what headless Chromium makes of it."""

from __future__ import annotations

import base64
import html.parser
import io
import json
import re
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
from PIL import Image, ImageDraw

import flexgram
from bodies import box
from conftest import run
from flexgram.__main__ import main
from flexgram.basics import BodyError
from flexgram.body.description import import_description
from flexgram.model.geometry import Geometry
from flexgram.pictures import page
from flexgram.pictures import report as report_module
from flexgram.pictures.scene import Scene, libraries, simplified
from flexgram.pictures.view import write_view

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_libraries = pytest.mark.skipif(
    not libraries(), reason="libjs-three and libjs-dygraphs are not installed"
)


class Content(html.parser.HTMLParser):
    """Pictures, text and data of a page; refuses what is not in the page itself."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.images, self.text, self.data = 0, "", {}
        self._inside: str | None = None
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attributes: Any) -> None:
        values = dict(attributes)
        for key in ("src", "href"):
            assert values.get(key, "data:").startswith("data:"), values
        self.images += tag == "img"
        self._inside = (values.get("id") or "code") if tag == "script" else None

    def handle_endtag(self, tag: str) -> None:
        self._inside = None

    def handle_data(self, data: str) -> None:
        if self._inside is None:
            self.text += data
        elif self._inside != "code":
            self.data[self._inside] = json.loads(data)


def numbers(text: str, kind: str) -> Any:
    return np.frombuffer(base64.b64decode(text), dtype=f"<{kind}")


@pytest.fixture(scope="module")
def made(rack: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The rack, reduced, with a sweep and a load history beside it."""
    folder = tmp_path_factory.mktemp("page")
    run("reduce", "-body", rack, "-mor_tol", "1e-2", "-mor_out", folder / "rack.rom.h5")
    sweep = ("-mor_sweep_hz", "10,500,21", "-mor_sweep_out", folder / "sweep.h5")
    run("sweep", "-body", rack, *sweep)
    t = np.linspace(0, 0.02, 201)
    rows = "\n".join(f"{x:.6g},{1e3 * np.sin(600 * x):.6g}" for x in t)
    (folder / "loads.csv").write_text(f"t,upper.fx\n{rows}\n")
    return folder


@pytest.fixture(scope="module")
def content(made: Path) -> Content:
    words = ["report", made / "rack.rom.h5", "--sweep", made / "sweep.h5", "--loads"]
    assert main([*map(str, words), str(made / "loads.csv"), "-o", str(made / "r.html")]) == 0
    return Content(made / "r.html")


@needs_libraries
def test_what_it_says(content: Content, made: Path) -> None:
    for words in ("From 10 to 500 Hz the responses", "Outside of this nothing is claimed",
                  "one in six million", "12 / 12", "skipped", "buckens", "fx fy fz mx my mz",
                  "moments of inertia", "Material steel: E = 2.1e+11 Pa",
                  "Damping: alpha = 2.4 1/s", "-mor_tol 1e-2"):  # fmt: skip
        assert words in content.text, words
    assert (made / "r.html").stat().st_size < 5e6
    # The body at rest, Gramian, spectrum of the loads, stress over time, largest stress, times.
    assert content.images == 6


@needs_libraries
def test_responses_are_those_of_the_body(content: Content, made: Path) -> None:
    data = content.data["chart-data"]
    model = flexgram.ReducedModel.load(made / "rack.rom.h5")
    hz, pairs = np.array(data["hz"]), data["pairs"]
    assert len(pairs) == 144 and data["left_out"] == 0
    reduced = numbers(data["reduced"], "f4").reshape(len(pairs), len(hz))
    H = np.abs(model.transfer(2 * np.pi * hz))
    full = numbers(data["full"], "f4").reshape(len(pairs), -1)
    assert full.shape[1] == len(data["full_hz"]) == 21
    for k in (0, 17, 143):
        i, j = model.outputs.index(pairs[k]["output"]), model.inputs.index(pairs[k]["input"])
        np.testing.assert_allclose(reduced[k], H[:, i, j], rtol=1e-6, atol=1e-9 * H.max())
    assert pairs[0]["unit"] == "m/N"
    at = np.interp(data["full_hz"], hz, reduced[0])
    assert np.median(np.abs(at / full[0] - 1)) < 1e-2
    error = data["error"]
    assert error["labels"] == ["frequency", "certified bound", "error against the medium model",
                               "tolerance", "rounding in it"]  # fmt: skip
    rows = np.array(error["rows"])
    np.testing.assert_allclose(rows[:, 1], model.claim.bound, rtol=1e-12)
    assert np.all(rows[:, 3] == 1e-2)


@needs_libraries
def test_motions_are_those_of_the_body(content: Content, made: Path, rack: Path) -> None:
    data = content.data["scene-data"]
    model = flexgram.ReducedModel.load(made / "rack.rom.h5")
    geometry = Geometry.load(rack)
    points = numbers(data["points"], "i2").reshape(-1, 3) * data["unit"]
    centre = 0.5 * (geometry.points.max(axis=0) + geometry.points.min(axis=0))
    where = points + centre
    nearest = np.array([np.argmin(np.linalg.norm(geometry.points - x, axis=1)) for x in where])
    assert np.abs(geometry.points[nearest] - where).max() < 1e-4 * data["size"]
    assert numbers(data["triangles"], "u4").max() == len(points) - 1
    squares, shapes = scipy.linalg.eigh(model.K, model.M)  # six rigid ones first
    hz = np.sqrt(squares[6:]) / (2 * np.pi)
    motion = geometry.motion(model, shapes[:, 6 : 6 + len(data["motions"])].T)[:, nearest]
    assert len(data["motions"]) > 10
    for k, one in enumerate(data["motions"]):
        assert one["name"].endswith(f"{hz[k]:.5g} Hz")
        drawn = numbers(one["values"], "i2").reshape(-1, 3) * one["unit"]
        away = min(np.abs(drawn - sign * motion[k]).max() for sign in (1, -1))
        assert away < 1e-4 * np.abs(motion[k]).max()
    marked = np.array(data["interfaces"]["upper"]["drawn"])
    assert set(nearest[marked]) <= set(geometry.interfaces["upper"])
    history = data["history"]
    assert history["times"][0] == 0 and 0 < history["worst"] < len(history["times"])
    stress = numbers(history["stress"], "u1").reshape(len(history["times"]), -1)
    assert stress.shape[1] == len(points) and history["most"] > 1e5
    worst = stress[history["worst"]]
    assert worst[worst < 255].max() == 254  # 255: none is known


def test_without_the_libraries(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pictures that stand still, and a remedy."""
    monkeypatch.setattr(report_module, "libraries", dict)
    words = ["report", made / "rack.rom.h5", "--sweep", made / "sweep.h5", "-o", made / "s.html"]
    assert main([*map(str, words)]) == 0
    assert "apt install libjs-three libjs-dygraphs" in capsys.readouterr().out
    page_ = Content(made / "s.html")
    assert page_.images == 5 and not page_.data
    monkeypatch.setattr("flexgram.pictures.view.libraries", dict)
    with pytest.raises(BodyError, match="apt install libjs-three"):
        write_view(made / "rack.rom.h5", made / "x.html")


def test_fewer_triangles() -> None:
    """A sphere: none above the limit, none twice, none without area; every node is one of the
    sphere's, and none lies far from what it stands for."""
    u, v = np.meshgrid(np.linspace(0.05, np.pi - 0.05, 150), np.linspace(0, 2 * np.pi, 150)[:-1])
    points = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1)
    index = np.arange(u.size).reshape(u.shape)
    a, b = index[:, :-1], np.roll(index, -1, axis=0)[:, :-1]
    c, d = np.roll(index, -1, axis=0)[:, 1:], index[:, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    nodes, few = simplified(points.reshape(-1, 3), triangles, 5000)
    assert 2500 < len(few) <= 5000
    assert len(np.unique(np.sort(few, axis=1), axis=0)) == len(few)
    corners = points.reshape(-1, 3)[nodes][few]
    assert np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                          axis=1).min() > 0  # fmt: skip
    assert np.abs(np.linalg.norm(corners.mean(axis=1), axis=1) - 1).max() < 0.02
    same, all_of_them = simplified(points.reshape(-1, 3), triangles, len(triangles))
    assert np.array_equal(same[all_of_them], triangles)


N = 30
ODD = {
    "parameter": ({"eta": 0.01, "terms": True}, (10.0, 60.0)),
    "from zero": ({"alpha": 0.5, "beta": 1e-5}, (0.0, 60.0)),
    "undamped": ({}, (1.0, 60.0)),
    "two bands": ({"alpha": 0.5}, [(1.0, 5.0), (20.0, 60.0)]),
}


def odd(kind: str, folder: Path) -> Path:
    """A chain of masses without a mesh."""
    given, band = ODD[kind]
    given = dict(given)
    K = sp.diags([np.full(N, 2e4), -1e4 * np.ones(N - 1), -1e4 * np.ones(N - 1)], [0, 1, -1])
    if given.pop("terms", None):
        T = sp.diags([1e4] * 5 + [0.0] * (N - 5)).tocsr()
        given["terms"] = {"k": (T, flexgram.parameter(1.0, 4.0, 2.0))}
    body = flexgram.Matrices(
        K.tocsr(),
        sp.identity(N).tocsr(),
        np.eye(N)[:, [0, N // 2]],
        inputs=["a.fx", "b.fx"],
        **given,
    )
    rom = flexgram.reduce(body, band, 1e-3)
    if kind == "parameter":
        rom = rom.at(k=1.7)  # of which no error over the band is known
    rom.save(folder / "odd.rom.h5")
    return folder / "odd.rom.h5"


@needs_libraries
@pytest.mark.parametrize("kind", ODD)
def test_odd_bodies(kind: str, tmp_path: Path) -> None:
    """Their pages run, without scripts that stop; what a history cannot show is left out."""
    rom = odd(kind, tmp_path)
    (tmp_path / "loads.csv").write_text("t,a.fx\n0,0\n0.1,1\n0.2,0\n")
    words = ["report", rom, "--loads", tmp_path / "loads.csv", "-o", tmp_path / "r.html"]
    assert main([*map(str, words)]) == 0
    data = Content(tmp_path / "r.html").data["chart-data"]
    assert np.all(np.isfinite(numbers(data["reduced"], "f4"))) and data["hz"][-1] == 60
    if kind == "two bands":
        assert ["gap"] in [row[1:2] for row in data["error"]["rows"]]


@needs_libraries
@pytest.mark.parametrize("kind", ODD)
def test_pages_of_odd_bodies_run(kind: str, tmp_path: Path, browser: None) -> None:
    words = ["report", odd(kind, tmp_path), "-o", tmp_path / "r.html"]
    assert main([*map(str, words)]) == 0
    assert READY in shown(tmp_path / "r.html", "--dump-dom", until=READY)


READY = 'data-ready="yes"'


def shown(path: Path, *flags: str, expected: str = "", until: str = "") -> str:
    """What headless Chromium makes of a page, without an error but one that is expected. On a busy
    machine it may end before the scripts have: ``until`` names what is to be there then."""
    assert CHROMIUM is not None
    for more in range(3):
        dom = _shown(path, *flags, expected=expected)
        if until in dom:
            break
        warnings.warn(f"{path}: not ready at try {more + 1}", stacklevel=2)
    return dom


def _shown(path: Path, *flags: str, expected: str) -> str:
    assert CHROMIUM is not None
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1200,900",
        "--force-prefers-reduced-motion", "--virtual-time-budget=10000", "--enable-logging=stderr",
        f"--user-data-dir={path.parent / 'profile'}", *flags, path.resolve().as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    said = re.findall(r".*CONSOLE.*", done.stderr)
    assert not [line for line in said if not expected or expected not in line], said
    return done.stdout


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Chromium that draws in space, or none of these tests: some containers have none."""
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    place = tmp_path_factory.mktemp("browser") / "page.html"
    place.write_text(
        "<p id=p></p><script>const c = document.createElement('canvas').getContext('webgl');"
        "document.getElementById('p').textContent = c ? 'draws' : 'none';</script>"
    )
    try:
        can = "draws</p>" in shown(place, "--dump-dom")
    except subprocess.TimeoutExpired:
        can = False
    if not can:
        pytest.skip("Chromium draws nothing in space here (WebGL by SwiftShader)")


@needs_libraries
def test_it_runs(content: Content, made: Path, browser: None) -> None:
    """Both scripts come to their end, without an error."""
    dom = shown(made / "r.html", "--dump-dom", until="<canvas")
    assert dom.count(READY) == 2
    assert "<canvas" in dom and 'class="dygraph-axis-label' in dom
    assert re.search(r'class="told"[^>]*>t = [\d.e-]+ s, largest displacement', dom)


def outline(scene: Scene, width: int, height: int) -> Any:
    """Pixels of the body in a picture, by triangles that are projected here."""
    x = scene.points - 0.5 * (scene.points.max(axis=0) + scene.points.min(axis=0))
    out = np.array([1, -1.4, 0.8]) / np.linalg.norm([1, -1.4, 0.8])
    right = np.cross([0, 0, 1], out) / np.linalg.norm(np.cross([0, 0, 1], out))
    up = np.cross(out, right)
    box = np.array(np.meshgrid(*zip(x.min(axis=0), x.max(axis=0), strict=True))).reshape(3, -1)
    tangent, aspect = 0.85 * np.tan(np.radians(15)), min(2.0, width / height)
    needed = np.maximum(np.abs(up @ box), np.abs(right @ box) / aspect) / tangent
    depth = (out @ box + needed).max() - x @ out
    scale = 0.5 * height / np.tan(np.radians(15)) / depth
    on = np.stack([0.5 * width + scale * (x @ right), 0.5 * height - scale * (x @ up)], axis=1)
    expected_picture = Image.new("1", (width, height))
    draw = ImageDraw.Draw(expected_picture)
    for triangle in scene.triangles:
        draw.polygon([tuple(p) for p in on[triangle]], fill=1)
    return np.asarray(expected_picture)


@needs_libraries
def test_the_picture_is_that_of_the_body(rack: Path, tmp_path: Path, browser: None) -> None:
    """The outline of the body in a screenshot, against triangles that are projected here."""
    geometry = Geometry.load(rack)
    geometry.interfaces = {}
    scene = Scene.of(geometry)
    text = page.document("rack", [page.viewer(scene)], {"scene-data": scene.data()})
    (tmp_path / "r.html").write_text(text)
    shown(tmp_path / "r.html", f"--screenshot={tmp_path / 'r.png'}")
    picture = np.asarray(Image.open(tmp_path / "r.png").convert("RGB")).astype(int)
    left, width, height = 41, 1118, 480
    body = picture[:, left : left + width]
    mask = (body.min(axis=2) < 245) & (body[..., 2] - body[..., 0] > 8)  # bluish: the material
    expected = outline(scene, width, height)
    best = 0.0
    for top in range(picture.shape[0] - height):
        part = mask[top : top + height]
        best = max(best, (part & expected).sum() / (part | expected).sum())
    assert best > 0.95


def test_the_still_picture_is_that_of_the_body(rack: Path) -> None:
    """What one sees before the script has run."""
    geometry = Geometry.load(rack)
    names = list(geometry.interfaces)
    scene = Scene.of(geometry)
    assert list(scene.marked()) == names
    text = page.viewer(scene)
    found = re.search(r'class="still" alt="[^"]+" src="data:image/png;base64,([^"]+)"', text)
    assert found and len(found[1]) < 120_000
    picture = Image.open(io.BytesIO(base64.b64decode(found[1]))).convert("RGB")
    mask = np.asarray(picture).min(axis=2) < 245
    expected = outline(scene, *picture.size)
    assert (mask & expected).sum() / (mask | expected).sum() > 0.95


@needs_libraries
def test_a_browser_that_draws_nothing_in_space_shows_the_still_picture(
    made: Path, content: Content, browser: None
) -> None:
    """Without WebGL; responses are drawn as always. Where there is WebGL it makes way."""
    flags = ("--dump-dom", "--disable-3d-apis")
    dom = shown(made / "r.html", *flags, expected="WebGL context", until="dygraph-axis-label")
    assert "WebGL is off" in dom and 'class="still"' in dom and "dygraph-axis-label" in dom
    dom = shown(made / "r.html", "--dump-dom", until=READY)
    assert 'class="still"' not in dom


@needs_libraries
def test_buttons_show_the_modes_of_their_rows(tmp_path: Path) -> None:
    """Of a body with a parameter too: with its present value."""
    content = {
        "materials": {"m": {"E": 2e9, "nu": 0.3, "rho": 1200.0, "parameter": {"E": [1e9, 4e9]}}},
        "regions": {"all": {"material": "m"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"root": {"nodes": "start"}},
        "damping": {"alpha": 5.0, "beta": 1e-5},
    }
    mesh = box("hexahedron20", (4, 1, 1), (0.4, 0.05, 0.03), distort=False)
    import_description(content, "bar", tmp_path / "bar.h5", mesh=mesh)
    run("reduce", tmp_path / "bar.h5", "--band", "5,800", "--tol", "1e-2", "-o", tmp_path / "r.h5")
    assert main(["report", str(tmp_path / "r.h5"), "-o", str(tmp_path / "r.html")]) == 0
    text = (tmp_path / "r.html").read_text()
    rows = re.findall(r"<button data-motion=(\d+) aria-pressed=false>([\d.e+-]+)</button>", text)
    motions = Content(tmp_path / "r.html").data["scene-data"]["motions"]
    assert len(rows) == len(motions) > 3
    for number, hz in rows:
        said = float(motions[int(number)]["name"].split(", ")[1].removesuffix(" Hz"))
        assert said == pytest.approx(float(hz), rel=1e-4)
    now = flexgram.ReducedModel.load(tmp_path / "r.h5").at()
    assert float(rows[0][1]) == pytest.approx(now.modes[0] / (2 * np.pi), rel=1e-5)


@needs_libraries
def test_the_mesh_of_another_body(
    made: Path, rack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file, h5py.File(rack) as own:
        for name in own:
            own.copy(name, file)
        file.attrs.update(own.attrs)
        file["mesh/points"][...] = 2 * own["mesh/points"][:]
    words = ["report", made / "rack.rom.h5", "--body", tmp_path / "other.h5", "-o"]
    assert main([*map(str, words), str(tmp_path / "r.html")]) == 0
    assert "left out shapes: the mesh is not that of the body" in capsys.readouterr().out


@needs_libraries
def test_view(made: Path, rack: Path, tmp_path: Path) -> None:
    """Bodies, meshes and reduced bodies before and after reduction."""
    run("view", rack, "-o", tmp_path / "body.html")
    body = Content(tmp_path / "body.html")
    assert "Mass 178.278 kg" in body.text and "upper" in body.text and "steel" in body.text
    assert not body.data["scene-data"]["motions"] and "forces act at" in body.text
    with h5py.File(rack) as file:
        at = np.round(file["interfaces/upper"].attrs["position"], 9) + 0.0
    assert ", ".join(f"{x:.5g}" for x in at) in body.text
    mesh = box("tetra10", (4, 2, 2))
    mesh.cell_sets = {"part": [np.arange(5)]}
    meshio.write(tmp_path / "box.inp", mesh)
    run("view", tmp_path / "box.inp", "-o", tmp_path / "mesh.html")
    of_mesh = Content(tmp_path / "mesh.html")
    assert all(name in of_mesh.text for name in ("part", "start", "end", "units of the mesh"))
    assert set(of_mesh.data["scene-data"]["interfaces"]) == {"part", "start", "end"}
    run("view", made / "rack.rom.h5", "-o", tmp_path / "rom.html")
    assert set(Content(tmp_path / "rom.html").data) == {"scene-data", "chart-data"}
    assert "no such file" in run("view", tmp_path / "none.h5", expect=1).err
    kept = (tmp_path / "box.inp").read_bytes()
    said = run("view", rack, "-o", tmp_path / "box.inp", expect=1).err
    assert "name it box.html" in said and (tmp_path / "box.inp").read_bytes() == kept
    (tmp_path / "a.txt").write_text("no mesh")
    assert "a.txt" in run("view", tmp_path / "a.txt", expect=1).err
