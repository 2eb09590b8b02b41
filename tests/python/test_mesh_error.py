"""The estimate of the mesh's own error against that of the same body with a fine mesh."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

import flexgram
from bodies import box, write_body_file
from flexgram.basics import BodyError
from flexgram.body.description import import_description
from flexgram.model.damped_modes import NaturalModes
from flexgram.model.geometry import Geometry
from flexgram.model.mesh_error import _energy_of_jumps, _parts, mesh_errors, modes_to_judge
from flexgram.pictures.report import write_report

SIZE = (1.0, 0.3, 0.03)
BAND = (5, 1500)
#: Modes in the band.
COUNT = 8


def solid(path: Path, kind: str, counts: tuple[int, int, int]) -> flexgram.ReducedModel:
    """A plate of solids, held at one end."""
    mesh = box(kind, counts, SIZE, distort=False)
    end = {"end": {"set": "end", "coupling": "rigid"}}
    held = {"start": [0, 1, 2]}
    write_body_file(path, mesh, interfaces=end, supports=held, damping=(1, 1e-7, 0))
    return flexgram.reduce(path, BAND, 1e-4)


def sheet(path: Path, kind: str, counts: tuple[int, int]) -> flexgram.ReducedModel:
    """The same of shells."""
    x, y = (np.linspace(0, s, n + 1) for s, n in zip(SIZE[:2], counts, strict=True))
    points = np.array([(a, b, 0.0) for a in x for b in y])
    at = np.arange(len(points)).reshape(len(x), len(y))
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    cells = quads if kind == "quad" else np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = meshio.Mesh(points, [(kind, cells)], point_sets={"start": at[0], "end": at[-1]})
    content = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
        "sections": {"plate": {"shape": "shell", "thickness": SIZE[2]}},
        "regions": {"all": {"material": "steel", "section": "plate"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start", "components": ["x", "y", "z", "rx", "ry", "rz"]}},
        "damping": {"alpha": 1.0, "beta": 1e-7},
    }
    import_description(content, "sheet", path, mesh=mesh)
    return flexgram.reduce(path, BAND, 1e-4)


@pytest.fixture(scope="module")
def fine(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Frequencies of fine meshes of solids and shells."""
    folder = tmp_path_factory.mktemp("fine")
    solids = solid(folder / "solid.h5", "hexahedron20", (40, 12, 2))
    shells = sheet(folder / "sheet.h5", "quad", (80, 24))
    return {"solid": solids.modes[:COUNT], "sheet": shells.modes[:COUNT]}


@pytest.mark.parametrize(
    ("kind", "counts"),
    [
        ("tetra", (40, 12, 2)),
        ("tetra10", (12, 4, 1)),
        ("hexahedron", (16, 5, 1)),
        ("hexahedron", (24, 8, 2)),
        ("hexahedron20", (10, 3, 1)),
        ("quad", (16, 5)),
        ("triangle", (16, 5)),
    ],
)
def test_against_a_fine_mesh(
    kind: str, counts: tuple[int, ...], fine: dict[str, np.ndarray], tmp_path: Path
) -> None:
    make, known = (solid, fine["solid"]) if len(counts) == 3 else (sheet, fine["sheet"])
    rom = make(tmp_path / "body.h5", kind, counts)
    estimated, true = mesh_errors(rom, np.arange(6)), rom.modes[:6] / known[:6] - 1
    assert 0.2 < estimated.max() / true.max() < 1.1, (true, estimated)


def test_the_mesh_of_a_fine_body_is_fine(tmp_path: Path) -> None:
    """It falls with the size of elements: here ω errs by its fourth power."""
    coarse, half = (
        mesh_errors(solid(tmp_path / f"{n}.h5", "hexahedron20", (n, n // 4, 1))) for n in (12, 24)
    )
    assert half[:6].max() < coarse[:6].max() / 6


def test_a_part_of_two_materials_has_jumps_of_its_own(tmp_path: Path) -> None:
    """Two bars in a row, one ten times as stiff, pulled: no error where the stress is exact."""
    mesh = box("hexahedron", (8, 1, 1), (8.0, 1.0, 1.0), distort=False)
    cells = mesh.cells[0].data
    left = mesh.points[cells].mean(axis=1)[:, 0] < 4
    mesh = meshio.Mesh(
        mesh.points,
        [("hexahedron", cells[left]), ("hexahedron", cells[~left])],
        point_sets=mesh.point_sets,
        cell_sets={"soft": [np.arange(4), []], "stiff": [[], np.arange(4)]},
    )
    content = {
        "materials": {
            "soft": {"E": 1e9, "nu": 0.0, "rho": 1e3},
            "stiff": {"E": 1e10, "nu": 0.0, "rho": 1e3},
        },
        "regions": {"soft": {"material": "soft"}, "stiff": {"material": "stiff"}},
        "interfaces": {"end": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start", "components": ["x", "y", "z"]}},
        "damping": {"beta": 1e-7},
    }
    import_description(content, "bar", tmp_path / "bar.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "bar.h5", (1, 200), 1e-6)
    rows, vectors = rom.system.K, np.linalg.solve(rom.system.K, rom.system.B)
    pulled = vectors[:, rom.inputs.index("end.fx")]
    parts = list(_parts_of(tmp_path / "bar.h5", rom, pulled))
    assert len(parts) == 2
    assert sum(parts) < 1e-7 * (pulled @ rows @ pulled)  # the claim is 1e-6


def _parts_of(path: Path, rom: flexgram.ReducedModel, q: np.ndarray) -> list[float]:
    motion = Geometry.load(path).motion_and_rotation(rom, q)
    return [
        float(_energy_of_jumps(places, elements, 1)[0]) for places, elements in _parts(path, motion)
    ]


def test_bodies_without_an_estimate(tmp_path: Path) -> None:
    beam = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
        "sections": {"round": {"shape": "circle", "radius": 0.01}},
        "regions": {"all": {"material": "steel", "section": "round"}},
        "interfaces": {"end": {"coupling": "node", "nodes": "end"}},
        "damping": {"beta": 1e-7},
    }
    points = np.column_stack([np.linspace(0, 1, 9), *np.zeros((2, 9))])
    cells = np.column_stack([np.arange(8), np.arange(1, 9)])
    mesh = meshio.Mesh(points, [("line", cells)], point_sets={"end": [8]})
    import_description(beam, "beam", tmp_path / "beam.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "beam.h5", (5, 1000), 1e-4)
    with pytest.raises(BodyError, match="no solids and no shells"):
        mesh_errors(rom)
    rom.save(tmp_path / "beam.rom.h5")
    write_report(tmp_path / "beam.rom.h5", tmp_path / "beam.html")
    assert "mesh [%]" not in (tmp_path / "beam.html").read_text()


def test_the_report_tells_of_a_coarse_mesh(tmp_path: Path) -> None:
    for kind, counts, is_coarse in (("tetra", (20, 6, 1), True), ("tetra10", (20, 6, 1), False)):
        rom = solid(tmp_path / "body.h5", kind, counts)
        rom.save(tmp_path / "body.rom.h5")
        told = write_report(tmp_path / "body.rom.h5", tmp_path / "page.html").told
        worst = 100 * mesh_errors(rom, modes_to_judge(NaturalModes.of(rom))).max()
        words = f"is worst, by about {worst:.2g} %"
        assert words in (tmp_path / "page.html").read_text()
        assert [words in line for line in told] == [True] * is_coarse


def test_modes_in_the_band_are_judged(tmp_path: Path) -> None:
    rom = solid(tmp_path / "body.h5", "hexahedron", (20, 6, 1))
    inside = int((rom.modes < 2 * np.pi * BAND[1]).sum())
    natural = NaturalModes.of(rom)
    assert modes_to_judge(natural).tolist() == list(range(inside))
    assert modes_to_judge(natural, 4).tolist() == [0, 1, 2, inside - 1]
    assert mesh_errors(rom, np.empty(0, dtype=int)).tolist() == []
