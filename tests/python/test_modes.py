"""Natural modes on the mesh: universal files as pyuff reads and writes them, and measured modes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from test_superelements import reduced

from bodies import box, write_body_file
from conftest import assembled, run
from flexgram import BodyError, Matrices, ReducedModel, certify, reduce
from flexgram.body.description import import_description
from flexgram.measured.mode_shapes import compare, mac, mode_shapes, read_universal, write_universal

pyuff = pytest.importorskip("pyuff")

LAST = 9000


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> ReducedModel:
    return reduced(
        tmp_path_factory.mktemp("modes"),
        "-mor_band_hz",
        f"10,{LAST}",
        "-mor_tol",
        "1e-5",
        coupling="distributing",
    )


@pytest.fixture(scope="module")
def full(model: ReducedModel, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Frequencies [Hz] and shapes (k, N, 3) of the full body, by SciPy, with its nodes."""
    assert model.path is not None
    a = assembled(tmp_path_factory.mktemp("full") / "full.h5", model.path.parent / "beam.h5")
    rows = np.lexsort((a["component"], a["node"]))
    K, M = (a[name].toarray()[rows][:, rows] for name in "KM")
    squares, shapes = scipy.linalg.eigh(K, M, subset_by_index=(6, 20))
    return {
        "hertz": np.sqrt(squares) / (2 * np.pi),
        "points": a["position"][rows][::3],
        "shapes": shapes.T.reshape(len(squares), -1, 3),
    }


def test_shapes_are_those_of_the_full_body(model: ReducedModel, full: dict[str, Any]) -> None:
    modes = mode_shapes(model)
    inside = full["hertz"] <= LAST
    assert len(modes.hertz) == inside.sum() > 3
    assert np.allclose(modes.hertz, full["hertz"][inside], rtol=1e-7)
    assert np.allclose(modes.points, full["points"]) and modes.labels[0] == 1
    for ours, theirs in zip(modes.shapes, full["shapes"], strict=False):
        sign = np.sign(np.sum(ours * theirs))
        assert np.abs(sign * ours - theirs).max() < 1e-4 * np.abs(theirs).max()
    w = 2 * np.pi * modes.hertz
    assert np.allclose(modes.damping, 3 / (2 * w) + 2e-6 * w / 2, rtol=1e-6)
    with pytest.raises(BodyError, match=r"no elastic mode up to 5 Hz; the first is at"):
        mode_shapes(model, last_hz=5)


def test_universal_file(model: ReducedModel, tmp_path: Path) -> None:
    modes = mode_shapes(model)
    write_universal(modes, tmp_path / "modes.unv", "a beam")
    sets = pyuff.UFF(str(tmp_path / "modes.unv")).read_sets()
    kinds = [one["type"] for one in sets]
    assert kinds == [164, 2411, *[55] * len(modes.hertz)]
    assert sets[0]["units_code"] == 1 and sets[0]["length"] == 1
    nodes = np.column_stack([sets[1][axis] for axis in "xyz"])
    assert np.array_equal(nodes, modes.points)
    assert np.array_equal(
        sets[1]["grid_global" if "grid_global" in sets[1] else "node_nums"], modes.labels
    )
    for k, one in enumerate(sets[2:]):
        shape = np.column_stack([one[f"r{j}"] for j in (1, 2, 3)])
        assert np.allclose(shape, modes.shapes[k], rtol=1e-5, atol=1e-9)
        assert one["mode_n"] == k + 1 and one["analysis_type"] == 2 and one["modal_m"] == 1
        assert one["freq"] == pytest.approx(modes.hertz[k], rel=1e-5)
        assert one["modal_damp_vis"] == pytest.approx(modes.damping[k], rel=1e-5)
    again = read_universal(tmp_path / "modes.unv")
    found = compare(again, modes)
    assert np.array_equal(found.partner, np.arange(len(modes.hertz)))
    assert np.allclose(np.diag(found.mac), 1, atol=1e-9) and found.farthest == 0


def measured_file(
    path: Path, full: dict[str, Any], order: list[int], *, places: bool, complex_modes: bool
) -> Any:
    """Ten nodes of the full body's own modes, in two directions, with noise, by pyuff."""
    rng = np.random.default_rng(7)
    nodes = np.sort(rng.choice(len(full["points"]), 10, replace=False))
    file = pyuff.UFF(str(path))
    if places:
        x, y, z = full["points"][nodes].T + 1e-4 * rng.standard_normal((3, 10))
        file.write_sets(
            [
                {
                    "type": 15,
                    "node_nums": nodes + 1,
                    "def_cs": [0] * 10,
                    "disp_cs": [0] * 10,
                    "color": [1] * 10,
                    "x": x,
                    "y": y,
                    "z": z,
                }
            ],
            "add",
        )
    for number, k in enumerate(order, 1):
        shape = full["shapes"][k][nodes].copy()
        shape += 0.02 * np.abs(shape).max() * rng.standard_normal(shape.shape)
        shape[:, 0] = 0  # not measured
        w = 2 * np.pi * full["hertz"][k] * 1.01
        one: dict[str, Any] = {
            "type": 55,
            "data_ch": 2,
            "spec_data_type": 12,
            "load_case": 0,
            "node_nums": nodes + 1,
            "mode_n": number,
        }
        if complex_modes:
            turn = np.exp(0.7j)
            one |= {
                "analysis_type": 3,
                "eig": w * (-0.01 + 1j),
                **{f"r{j + 1}": turn * shape[:, j] for j in range(3)},
            }
        else:
            one |= {
                "analysis_type": 2,
                "freq": w / (2 * np.pi),
                "modal_damp_vis": 0.01,
                **{f"r{j + 1}": shape[:, j] for j in range(3)},
            }
        file.write_sets([one], "add")
    return nodes


@pytest.mark.parametrize("complex_modes", [False, True])
@pytest.mark.parametrize("places", [False, True])
def test_measured_modes(
    places: bool, complex_modes: bool, model: ReducedModel, full: dict[str, Any], tmp_path: Path
) -> None:
    """Modes in another order, of some directions, with noise: each finds its partner."""
    order = [2, 0, 3, 1]
    nodes = measured_file(
        tmp_path / "t.unv", full, order, places=places, complex_modes=complex_modes
    )
    measured = read_universal(tmp_path / "t.unv")
    assert np.array_equal(measured.labels, nodes + 1)
    assert np.allclose(measured.damping, 0.01, rtol=1e-3)
    found = compare(measured, mode_shapes(model))
    assert list(found.partner) == order
    best = found.mac[range(4), order]
    assert np.all(best > 0.97) and np.all(best < 1)
    assert (found.farthest < 1e-3) if places else np.isnan(found.farthest)
    x = measured.shapes[:, :, 1:].reshape(4, -1)
    y = mode_shapes(model).shapes[:, nodes, 1:].reshape(len(mode_shapes(model).hertz), -1)
    assert np.allclose(found.mac, mac(x, y))


def test_verb_and_report(model: ReducedModel, full: dict[str, Any], tmp_path: Path) -> None:
    assert model.path is not None
    measured_file(tmp_path / "t.unv", full, [1, 0], places=True, complex_modes=False)
    said = run("modes", model.path, "--measured", tmp_path / "t.unv", "-o", tmp_path / "m.png").out
    assert "measured mode 1" in said and ": mode 2," in said and "MAC 0.9" in said
    assert (tmp_path / "m.png").stat().st_size > 5000
    run("modes", model.path, "-o", tmp_path / "m.csv")
    table = np.loadtxt(tmp_path / "m.csv", delimiter=",", skiprows=1)
    assert np.allclose(table[:, 1], mode_shapes(model).hertz)
    beyond = run("modes", model.path, "--hz", "13000").out
    assert (
        beyond.count("outside the band") == (mode_shapes(model, last_hz=13000).hertz > LAST).sum()
    )
    run("report", model.path, "--measured", tmp_path / "t.unv", "-o", tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text()
    assert "Measured modes of t.unv" in page and "Modal assurance criterion" in page
    refused = run("modes", model.path, "-o", tmp_path / "m.png", expect=1)
    assert "needs --measured" in refused.err


def test_what_is_refused(model: ReducedModel, full: dict[str, Any], tmp_path: Path) -> None:
    modes = mode_shapes(model)
    measured_file(tmp_path / "t.unv", full, [0], places=True, complex_modes=False)
    far = read_universal(tmp_path / "t.unv")
    far.points *= 1000  # millimetres
    with pytest.raises(BodyError, match="the same axes, in metres"):
        compare(far, modes)
    measured_file(tmp_path / "n.unv", full, [0], places=False, complex_modes=False)
    other = read_universal(tmp_path / "n.unv")
    other.labels = other.labels + 100000
    with pytest.raises(BodyError, match="is no node of the mesh, and the file does not say where"):
        compare(other, modes)
    (tmp_path / "none.unv").write_text("    -1\n   151\nx\n    -1\n")
    with pytest.raises(BodyError, match="no mode shape"):
        read_universal(tmp_path / "none.unv")
    with pytest.raises(BodyError, match="no such file"):
        read_universal(tmp_path / "nothing.unv")
    whole = (tmp_path / "t.unv").read_text().splitlines()
    cut = [line if k != len(whole) - 6 else "    xx" for k, line in enumerate(whole)]
    (tmp_path / "broken.unv").write_text("\n".join(cut) + "\n")
    with pytest.raises(BodyError, match=r"broken\.unv"):
        read_universal(tmp_path / "broken.unv")


def test_without_a_mesh(model: ReducedModel, tmp_path: Path) -> None:
    """A table needs no nodes; a damping matrix couples modes; a body that is gone is missed."""
    n = 40
    K = sp.diags([np.full(n, 2e6), *2 * [np.full(n - 1, -1e6)]], [0, 1, -1]).tocsr()
    D = sp.lil_matrix((n, n))
    D[30, 30] = 50.0
    body = Matrices(
        K=K,
        M=sp.identity(n, format="csr"),
        B=np.eye(n)[:, [3, 30]],
        D=D.tocsr(),
        inputs=["a.fx", "b.fx"],
    )
    chain = reduce(body, (5, 200), 1e-3)
    with pytest.raises(BodyError, match="no dof map"):
        mode_shapes(chain)
    modes = mode_shapes(chain, at_nodes=False)
    assert modes.coupled > 0.1 and mode_shapes(model).coupled < 1e-6
    free = Matrices(
        K=sp.diags(
            [np.r_[1e6, np.full(n - 2, 2e6), 1e6], *2 * [np.full(n - 1, -1e6)]], [0, 1, -1]
        ).tocsr(),
        M=sp.identity(n, format="csr"),
        B=np.eye(n)[:, [3]],
        alpha=1.0,
        inputs=["a.fx"],
    )
    mixed = reduce(free, (5, 200), order=12, method="pod", options={"mor_samples": "12"})
    listed = mode_shapes(mixed, at_nodes=False)
    exact = 2e3 * np.sin(np.pi * np.arange(1, n) / (2 * n)) / (2 * np.pi)
    assert listed.hertz[0] == pytest.approx(exact[0], rel=1e-3)  # the rigid mode is none
    assert np.allclose(listed.damping, 1 / (4 * np.pi * listed.hertz), rtol=1e-2)
    chain.save(tmp_path / "chain.h5")
    said = run("modes", tmp_path / "chain.h5").out
    assert "damping couples the modes" in said and "at the ports" in said
    assert model.path is not None
    body_file = model.path.parent / "beam.h5"
    body_file.rename(tmp_path / "away.h5")
    try:
        with pytest.raises(BodyError, match="--body names it"):
            mode_shapes(model)  # its nodes would have other labels
        assert len(mode_shapes(model, tmp_path / "away.h5").labels) > 100
        other = box("tetra10", (7, 2, 2), (0.3, 0.04, 0.03))
        write_body_file(tmp_path / "other.h5", other)
        with pytest.raises(BodyError, match="the mesh is not that of the body"):
            mode_shapes(model, tmp_path / "other.h5")
    finally:
        (tmp_path / "away.h5").rename(body_file)


def test_files_that_would_be_misread(
    model: ReducedModel, full: dict[str, Any], tmp_path: Path
) -> None:
    measured_file(tmp_path / "t.unv", full, [0, 1], places=True, complex_modes=False)
    text = (tmp_path / "t.unv").read_text()

    def read(changed: str) -> Any:
        (tmp_path / "x.unv").write_text(changed)
        return read_universal(tmp_path / "x.unv")

    assert len(read("\ufeff" + text.replace("\n", "\r\n").replace("e+", "d+")).hertz) == 2
    with pytest.raises(BodyError, match="ends inside a dataset"):
        read(text[:-8])
    kinds = "         1         2         2        12         2         3"
    assert text.count(kinds) == 2
    assert len(read(text.replace(kinds, kinds[:20] + "         1" + kinds[30:], 1)).hertz) == 1
    with pytest.raises(BodyError, match="numbers of type 6"):
        read(text.replace(kinds, kinds[:40] + "         6" + kinds[50:]))
    with pytest.raises(BodyError, match="its datasets: 15, 55"):
        read(text.replace(kinds, kinds[:30] + "         2" + kinds[40:]))  # stress
    units = "    -1\n   164\n         5mm (milli-newton)            2\n"
    units += f"{1000.0:25.16E}{1000.0:25.16E}{1.0:25.16E}\n{273.15:25.16E}\n    -1\n"
    assert np.allclose(read(units + text).points, 1e-3 * read(text).points)
    with pytest.raises(BodyError, match="dataset 164"):
        read(units.replace("1.0000000000000000E+03", "0.0000000000000000E+00") + text)
    measured = read(text)
    measured.points[3] = np.nan
    with pytest.raises(BodyError, match=f"not of node {measured.labels[3]}"):
        compare(measured, mode_shapes(model))


def test_modes_of_a_body(model: ReducedModel, full: dict[str, Any], tmp_path: Path) -> None:
    """Without reducing it: all of them in the band, against SciPy's, with a bound of each."""
    assert model.path is not None
    path = model.path.parent / "beam.h5"
    said = run("modes", path, "--band", f"10,{LAST}", "-o", tmp_path / "m.unv")
    rows = [line.split() for line in said.out.splitlines() if " Hz   damping" in line]
    inside = full["hertz"] <= LAST
    assert inside.sum() > 3
    np.testing.assert_allclose([float(row[1]) for row in rows], full["hertz"][inside], rtol=1e-5)
    assert f"all modes from 10 to {LAST} Hz, counted by inertia" in said.out
    assert len(pyuff.UFF(str(tmp_path / "m.unv")).read_sets()) == 2 + inside.sum()
    medium = certify(path, (10, LAST), 0.1)
    found = medium.mode_omega / (2 * np.pi)
    slack = 1e-9  # of SciPy's
    assert len(found) >= inside.sum()
    theirs = full["hertz"][: len(found)]
    assert np.all(theirs <= found * (1 + slack))
    assert np.all(theirs >= found * (1 - medium.mode_error - slack))
    refused = run("modes", path, expect=1)
    assert "is a body that is not reduced: name the band" in refused.err
    refused = run("modes", path, "--band", "1,2", expect=1)
    assert "no elastic mode from 1 to 2 Hz" in refused.err


def test_modes_of_bodies_whose_stiffness_varies(tmp_path: Path) -> None:
    """No bound is told of frequencies that it is not of; free bodies may begin at 0 Hz."""
    mesh = box("hexahedron20", (6, 2, 2), (0.3, 0.02, 0.03))
    rubber = {"E": 2e9, "nu": 0.3, "rho": 1200.0}
    for more, words in (
        ({"viscoelastic": {"prony": [[0.5, 1e-3]]}}, "its stiffness varies over frequency"),
        ({}, "all modes from 0 to 3000 Hz, counted by inertia"),
    ):
        content = {
            "materials": {"m": rubber | more},
            "regions": {"all": {"material": "m"}},
            "interfaces": {"eye": {"coupling": "rigid", "nodes": "end"}},
        }
        import_description(content, "b", tmp_path / "b.h5", mesh=mesh)
        said = run("modes", tmp_path / "b.h5", "--band", "0,3000", expect=1 if more else 0)
        assert words in said.err + said.out
