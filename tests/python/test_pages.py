"""The commands, descriptions and programs of the pages run as they are printed."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import meshio
import numpy as np
import pytest
import scipy.sparse as sp
import yaml
from test_importers import write_deck

import flexgram
from bodies import box
from conftest import ENVIRONMENT, ROOT, chain, run
from flexgram.body.description import import_description

matplotlib.use("Agg")
STEEL = {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}}
PAGES = ("README.md", *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")))


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and text of each code block."""
    text = (ROOT / page).read_text()
    found = re.findall(r"^( *)```(\w*)\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    return [
        (language, re.sub(f"^{indent}", "", body, flags=re.M)) for indent, language, body in found
    ]


def shell(page: str, beginning: str) -> str:
    """The block of commands whose first line begins so."""
    (text,) = [text for language, text in blocks(page) if text.startswith(beginning)]
    return text


def in_bash(text: str, folder: Path) -> str:
    """What it prints, in a folder with the project's files, as the pages set the shell up."""
    for name in ("meshes", "examples"):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    (folder / "scripts").mkdir(exist_ok=True)
    (folder / "scripts" / "install").write_text("#!/bin/sh\n")  # all is there
    (folder / "scripts" / "install").chmod(0o755)
    (folder / "out").mkdir(exist_ok=True)
    environment = {k: v for k, v in ENVIRONMENT.items() if k != "PETSC_OPTIONS"}
    environment["PATH"] = f"{ROOT / '.venv' / 'bin'}:{environment['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", text],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def part(folder: Path, name: str, interfaces: tuple[str, str], band: str = "10,3000") -> None:
    """A free box and its reduced body."""
    ends = dict(zip(interfaces, ("start", "end"), strict=True))
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {key: {"coupling": "rigid", "nodes": nodes} for key, nodes in ends.items()},
        "damping": {"alpha": 5.0},
    }
    mesh = box("hexahedron", (6, 2, 2))
    import_description(content, name, folder / f"{name}.h5", mesh=mesh)
    run("reduce", folder / f"{name}.h5", "--band", band, "-o", folder / f"{name}.rom.h5")


def test_the_pages_of_the_rack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """reducing.md with the output that it shows, then the Python of python.md."""
    said = in_bash(shell("docs/reducing.md", "flexgram import"), tmp_path)
    (shown,) = [text for language, text in blocks("docs/reducing.md") if language == "text"]
    slow = ("done after", "s left", "  krylov: ", "  time  ")  # of a busy machine
    plain = [line for line in said.splitlines() if not any(word in line for word in slow)]
    at = plain.index(shown.splitlines()[0])
    for line, printed in zip(shown.splitlines(), plain[at:], strict=False):
        # 9.0e-05 on any processor
        assert re.sub(r"\d\.\de-\d+", "#", line) == re.sub(r"\d\.\de-\d+", "#", printed)
    in_bash(shell("docs/reducing.md", "mpirun -n 2 flexgram certify"), tmp_path)
    run("modes", tmp_path / "out" / "rack.rom.h5", "-o", tmp_path / "test.unv")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(dict(blocks("README.md"))["python"], names)
    assert str(names["rom"].claim) == "error 9.0e-05 (certified)" and names["H"].shape == (12, 12)
    exec(dict(blocks("docs/python.md")[:1])["python"], names)
    assert names["rom"].order == 38 and names["small"].order == 30
    assert names["found"].mac.shape[0] > 3 and names["r"].values.shape == (200,)


def test_the_part_of_the_first_hour(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    in_bash(shell("README.md", "scripts/install tutorial &&"), tmp_path)
    assert (tmp_path / "out" / "part.html").stat().st_size > 50_000


def test_a_lever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh in millimetres, by the command line and from Python."""
    mesh = box("tetra10", (6, 2, 2), (100, 20, 30))
    ends = {"eye": mesh.point_sets["end"], "foot": mesh.point_sets["start"]}
    mesh = meshio.Mesh(mesh.points, mesh.cells, point_sets=ends)
    mesh.write(tmp_path / "lever.inp")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lever.msh").write_text((tmp_path / "lever.inp").read_text())
    command = shell("docs/meshes.md", "flexgram import lever.msh")
    in_bash(command.replace("lever.msh", "lever.inp"), tmp_path)
    text = next(text for _, text in blocks("docs/python.md") if "import_mesh" in text)
    write_deck(tmp_path / "part.inp", mesh=mesh)
    exec(text.replace("lever.msh", "lever.inp"), {"flexgram": flexgram})
    rom = flexgram.reduce("lever.h5", (10, 500), 1e-2)
    assert {name.split(".")[0] for name in rom.inputs} == {"eye", "foot"}


def test_a_blade(tmp_path: Path) -> None:
    """The description of its spin, and the commands beneath."""
    (spin,) = [text for language, text in blocks("docs/rotors.md") if language == "yaml"]
    content = {
        "materials": STEEL,
        "regions": {"all": {"material": "steel"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"root": {"nodes": "start"}},
    } | yaml.safe_load(spin)
    mesh = box("hexahedron20", (6, 1, 1), (0.4, 0.01, 0.03), distort=False)
    mesh.points -= [0, 0.005, 0.015]  # its middle line goes through the axis
    import_description(content, "blade", tmp_path / "blade.h5", mesh=mesh)
    in_bash(shell("docs/rotors.md", "flexgram reduce blade.h5"), tmp_path)
    assert (tmp_path / "campbell.png").exists() and (tmp_path / "blade400.rom.h5").exists()


MESHER = (4, 8)  #: of gmsh, whose meshes the tutorials show
NUMBER = re.compile(r"-?\d[\d.]*(?:e[-+]?\d+)?")


def is_said(shown: str, said: str) -> bool:
    """Whether a line holds what is shown: its words, and its numbers but for what other versions of
    mesher and EXUDYN change, a twentieth or one. Numbers of nodes may be those of mirror images."""
    words = NUMBER.sub("#", shown)
    numbers = [float(x) for x in NUMBER.findall(shown)]
    for line in said.splitlines():
        at = NUMBER.sub("#", line).find(words)
        if at < 0:
            continue
        skipped = NUMBER.sub("#", line)[:at].count("#")
        found = [float(x) for x in NUMBER.findall(line)][skipped : skipped + len(numbers)]
        if words.startswith("node"):
            found[0] = numbers[0]
        near = [
            abs(a - b) <= max(0.05 * abs(b), 1e-6, 1 if b == round(b) else 0)
            for a, b in zip(found, numbers, strict=True)
        ]
        if all(near):
            return True
    return False


def test_numbers_are_compared() -> None:
    said = "Reduced from 7143 to 19 dofs.\nlargest stress of the neck: 23.6 MPa\n"
    assert is_said("largest stress of the neck: 23.8 MPa", said)
    assert is_said("Reduced from 7143 to 20 dofs.", said)
    assert not is_said("largest stress of the neck: 33.6 MPa", said)
    assert not is_said("largest stress of the eye: 23.6 MPa", said)


@pytest.mark.parametrize(
    ("page", "files", "pictures"),
    [
        ("tutorial", ["draw.py", "move.py"], ["neck.svg"]),
        ("rod", ["draw.py", "run.py"], ["shank.svg", "rod.png"]),
        ("robot", ["arm.yaml", "column.py"], ["sideways.svg"]),
        ("job", ["rod.options", "rod.sh"], []),
    ],
)
def test_tutorials(page: str, files: list[str], pictures: list[str], tmp_path: Path) -> None:
    """Programs and commands in their order, and the lines that each page shows of the last."""
    pytest.importorskip("exudyn")
    gmsh = pytest.importorskip("gmsh")
    version = (gmsh.GMSH_API_VERSION_MAJOR, gmsh.GMSH_API_VERSION_MINOR)
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "activate").touch()
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "mpi-environment", tmp_path / "scripts")
    first, *others = blocks(f"docs/{page}.md")
    in_bash(first[1], tmp_path)
    if page in ("robot", "job"):
        drawn_in = "docs/tutorial.md" if page == "robot" else "docs/rod.md"
        draw = next(text for language, text in blocks(drawn_in) if language == "python")
        (tmp_path / "draw.py").write_text(draw)
    said, waiting = "", list(files)
    for k, (language, text) in enumerate(others):
        if language == "text":
            for line in text.splitlines():
                shown = line.partition("…")[0].strip()
                if version != MESHER:  # another mesh: its words alone
                    assert NUMBER.sub("#", shown) in NUMBER.sub("#", said), (line, said)
                else:
                    assert is_said(shown, said), (line, said)
            continue
        if language:
            name = waiting.pop(0)
            (tmp_path / name).write_text(text)
            if language != "python" or f"python3 {name}" in others[k + 1][1]:
                continue  # the next commands take it
            text = f"python3 {name}"
        said = in_bash(f"export MPLBACKEND=Agg\n{text}", tmp_path)
    assert not waiting
    for script in tmp_path.glob("*.sh"):  # of a batch system that is not here
        subprocess.run(["bash", "-n", script], check=True)
    for picture in pictures:
        assert (tmp_path / picture).stat().st_size > 5000


def test_a_dolfinx_program(tmp_path: Path) -> None:
    """The page shows the example as it is, what it prints, and its commands."""
    pytest.importorskip("dolfinx")
    page = dict(blocks("docs/program.md"))
    source = (ROOT / "examples" / "dolfinx_beam.py").read_text()
    assert source.endswith(page["python"])
    run_it, use_it = [text for language, text in blocks("docs/program.md") if not language]
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "mpi-environment", tmp_path / "scripts")
    (tmp_path / ".venv").symlink_to(ROOT / ".venv")
    said = re.sub(r"\d[\d.e-]*", "#", in_bash(run_it, tmp_path))
    assert re.sub(r"\d[\d.e-]*", "#", page["text"]) in said
    in_bash(use_it, tmp_path)
    assert (tmp_path / "out" / "beam.fmu").exists()


def test_questions(tmp_path: Path) -> None:
    """Every command of the page, of a part of each kind."""
    part(tmp_path, "part", ("foot", "eye"))
    t = np.linspace(0, 0.1, 401)
    rows = "".join(f"{x:.5g},{np.sin(3000 * x):.5g}\n" for x in t)
    (tmp_path / "history.csv").write_text(f"t,eye.fx\n{rows}")
    mesh = box("tetra10", (5, 2, 2), (100, 20, 20))
    deck = meshio.Mesh(mesh.points, mesh.cells, point_sets=mesh.point_sets)
    deck.write(tmp_path / "plain.inp")
    nodes = (tmp_path / "plain.inp").read_text().replace("*NSET, NSET=end", "*NSET, NSET=END")
    nodes = nodes.replace("*NSET, NSET=start", "*NSET, NSET=START")
    nodes = re.sub(
        r"\*ELEMENT, *TYPE=C3D10.*", "*ELEMENT, TYPE=C3D10, ELSET=ALL", nodes, flags=re.I
    )
    (tmp_path / "part.inp").write_text(
        nodes + "*MATERIAL, NAME=S\n*ELASTIC\n210e9, 0.3\n*DENSITY\n7850.\n"
        "*SOLID SECTION, ELSET=ALL, MATERIAL=S\n"
    )
    (tmp_path / "part.bdf").write_text(
        "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,1207,,1.,0.,0.\n"
        "CBAR,1,1,1,1207,0.,1.,0.\nPBAR,1,1,6.-4,4.5-8,2.-8,5.-8\nMAT1,1,2.1+11,,0.3,7850.\n"
        "SPC1,1,123456,1\nENDDATA\n"
    )
    commands = [text for language, text in blocks("docs/questions.md") if not language]
    assert len(commands) == 8
    made = tmp_path / "part.h5"
    kept = made.read_bytes()
    for text in commands:
        in_bash(text, tmp_path)
        made.write_bytes(kept)  # others make files of that name
    assert (tmp_path / "part.fmu").exists() and (tmp_path / "cb.rom.h5").exists()


def test_a_crank_and_a_rod(tmp_path: Path) -> None:
    part(tmp_path, "crank", ("main", "pin"))
    part(tmp_path, "rod", ("big", "small"))
    in_bash(shell("docs/assemblies.md", "flexgram couple"), tmp_path)
    assert flexgram.ReducedModel.load(tmp_path / "ab.rom.h5").order > 20


@pytest.mark.skipif(importlib.util.find_spec("exudyn") is None, reason="EXUDYN is not there")
def test_a_body_in_exudyn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    part(tmp_path, "part", ("foot", "eye"))
    text = (ROOT / "docs" / "multibody.md").read_text()
    in_bash(re.search(r"`(flexgram export\s+part.rom.h5[^`]*)`", text)[1], tmp_path)  # type: ignore
    monkeypatch.chdir(tmp_path)
    exec(next(text for language, text in blocks("docs/multibody.md") if language == "python"), {})
    t = np.linspace(0, 0.01, 40)
    order = flexgram.ReducedModel.load("part.rom.h5").elastic().order
    q = np.outer(np.sin(2000 * t), np.full(order, 1e-6))
    np.savetxt("q.csv", np.column_stack([t, q]), delimiter=",")
    in_bash(shell("docs/multibody.md", "flexgram report"), tmp_path)


def test_programs_of_matrices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With K, M, B as the pages have them, and parts of K."""
    monkeypatch.chdir(tmp_path)
    parts = chain()
    n = parts["K"].shape[0]
    T = sp.csr_matrix(([1.0], ([3], [3])), (n, n))
    known = {"flexgram": flexgram, "Matrices": flexgram.Matrices} | {
        "K": 1e6 * parts["K"], "M": parts["M"], "B": parts["B"], "K_rubber": 1e5 * T, "T": T,
    }  # fmt: skip
    text = next(text for _, text in blocks("docs/bodies.md") if "write_matrices(" in text)
    exec(text, dict(known))
    programs = [text for language, text in blocks("docs/damping.md") if language == "python"]
    assert len(programs) == 3
    known["Matrices"] = lambda *a, **k: flexgram.Matrices(*a, eta=1e-2, **k)
    for text in programs:
        exec(text.replace("(10, 2000)", "(1, 20)"), known)
        body = flexgram.Matrices(known["K"], known["M"], known["B"], eta=1e-2, terms=known["terms"])
        assert flexgram.reduce(body, (1, 20), 1e-2).order > 0


#: Sets of nodes that descriptions of the pages name.
PLANES = {"lip": 1, "seat": 2, "edge_of_sheet": 5, "bolts": 6, "end": 8}
FACES = {"piston_face": (3, 5), "flange": (3, 4)}
#: What is beside a block: of a page, by its first key.
BESIDE: dict[tuple[str, str], Any] = {
    ("docs/meshes.md", "regions"): {
        "materials": {
            "carbon": {"E1": 140e9, "E2": 10e9, "E3": 10e9, "nu12": 0.3, "nu13": 0.3, "nu23": 0.4}
            | {"G12": 5e9, "G13": 5e9, "G23": 3e9, "rho": 1600.0}
        }
    },
    ("docs/connections.md", "masses"): {
        "interfaces": {
            name: {"coupling": "rigid", "nodes": nodes}
            for name, nodes in zip(
                ("hub", "journal", "foot", "frame"), ("lip", "seat", "flange", "end"), strict=True
            )
        }
    },
    ("docs/loads.md", "loads"): {"supports": {"root": {"nodes": "start"}}},
    ("docs/preload.md", "loads"): {"supports": {"root": {"nodes": "start"}}},
    ("docs/loads.md", "outputs"): {"supports": {"root": {"nodes": "bolts"}}},
    ("docs/rotors.md", "spin"): {"supports": {"root": {"nodes": "start"}}},
}


def descriptions() -> list[Any]:
    return [
        pytest.param(page, text, id=f"{Path(page).stem}-{k}")
        for page in PAGES
        for k, (language, text) in enumerate(blocks(page))
        if language == "yaml" and page not in ("docs/shells.md", "docs/robot.md")
    ]


@pytest.mark.parametrize(("page", "text"), descriptions())
def test_descriptions(page: str, text: str, tmp_path: Path) -> None:
    """Each block joins a description of a solid box whose sets have the names of the page."""
    given = yaml.safe_load(text)
    mesh = box("hexahedron", (8, 4, 4), (0.4, 0.1, 0.1), distort=False)
    layer = np.round(mesh.points[:, 0] / 0.05).astype(int)
    on_top = mesh.points[:, 2] > 0.099
    for name, at in PLANES.items():
        mesh.point_sets[name] = np.flatnonzero(layer == at)
    for name, (first, last) in FACES.items():
        mesh.point_sets[name] = np.flatnonzero(on_top & (layer >= first) & (layer <= last))
    count = len(mesh.cells[0].data)
    parts = list(given.get("materials", {})) if "regions" not in given else ["tube"]
    if parts:
        each = np.array_split(np.arange(count), len(parts))
        mesh.cell_sets = {name: [own] for name, own in zip(parts, each, strict=True)}
    base: dict[str, Any] = {
        "materials": STEEL,
        "regions": {name: {"material": name} for name in parts} or {"all": {"material": "steel"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "damping": {"alpha": 5.0},
    }
    base |= BESIDE.get((page, next(iter(given))), {})
    import_description(base | given, "body", tmp_path / "body.h5", mesh=mesh)
    run("assemble", tmp_path / "body.h5", "-o", tmp_path / "matrices.h5")


def test_a_housing(tmp_path: Path) -> None:
    """The whole description of shells.md, with its mesh."""
    (text,) = [text for language, text in blocks("docs/shells.md") if language == "yaml"]
    x, y = np.meshgrid(np.arange(0, 201, 20.0), np.arange(0, 221, 20.0), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    number = np.arange(len(points)).reshape(x.shape)
    cells = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    half = len(cells) // 2
    mesh = meshio.Mesh(
        points, [("quad", cells)], point_sets={"bolts": np.array([0, 1, 12, 13])},
        cell_sets={"walls": [np.arange(half)], "roof": [np.arange(half, len(cells))]},
    )  # fmt: skip
    import_description(yaml.safe_load(text), "housing", tmp_path / "h.h5", mesh=mesh)
    run("assemble", tmp_path / "h.h5", "-o", tmp_path / "m.h5")


def test_every_block_is_known() -> None:
    """A new block belongs to a test above, or to what no test can run."""
    languages: Callable[[str], set[str]] = lambda page: {language for language, _ in blocks(page)}  # noqa: E731
    assert languages("docs/cluster.md") == {"bash", ""}  # a batch job
    for page in PAGES:
        assert languages(page) <= {"", "yaml", "python", "text", "bash", "sh"}, page
