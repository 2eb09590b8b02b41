"""What a new user met in the first hour, each said in words that help."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

import flexgram
from bodies import box
from conftest import assembled, body_system, message, run
from flexgram import BodyError
from flexgram.pictures.plots import sweep_figure


def test_words_that_are_no_options(tmp_path: Path, rack: Path) -> None:
    def refused(*words: Any) -> str:
        return message(run("reduce", *words, expect=1))

    assert "unknown option --bodi: did you mean --body?" in refused("--bodi", rack)
    assert "unknown option -bodi: did you mean -body?" in refused("-bodi", rack)
    assert f"stray word {rack}" in refused(rack, rack)
    options = tmp_path / "part.options"
    options.write_text(f"# a job\n-body {rack}\n-mor_band_hz 10, 500\n")
    assert "part.options, line 3: -mor_band_hz 10, 500" in refused("-options_file", options)
    options.write_text(f"# a job\n-body {rack}  # the rack\n-mor_restart\n-mor_band_hz 10,100\n")
    run("reduce", "-options_file", options, "-mor_out", tmp_path / "r.h5")


@pytest.mark.parametrize("wrong", ["swapped", "reversed", "flat", "components"])
def test_coordinates_that_do_not_fit(rack: Path, tmp_path: Path, wrong: str) -> None:
    """Positions of matrices from Python: frame data of a wrong geometry must not come out."""
    parts = assembled(tmp_path / "m.h5", rack)
    with h5py.File(tmp_path / "m.h5") as file:
        places = file["nodes/position"][:][file["dofs/node"][:]]
        node = file["dofs/node"][:].astype(int)
    changed = {
        "swapped": places[:, [0, 2, 1]],
        "reversed": places[::-1],
        "flat": places * [1, 0, 0],
    }.get(wrong, places)
    arguments = {
        "K": parts["K"],
        "M": parts["M"],
        "B": parts["B"],
        "alpha": 2.0,
        "node": node,
        "component": parts["component"],
    }
    right = flexgram.reduce(flexgram.Matrices(**arguments, position=places), tol=1e-2)
    assert right.frame["mass"] == pytest.approx(178.28, rel=1e-3)
    if wrong == "components":  # a component for all nodes after the other, on rows node by node
        arguments["component"] = np.sort(parts["component"])
    rom = flexgram.reduce(flexgram.Matrices(**arguments, position=changed), tol=1e-2)
    assert any("the coordinates do not fit K" in words for words in rom.log["warnings"])
    assert "mass" not in rom.frame
    assert rom.certified_error <= 1e-2  # H is right without them


def test_a_zero_of_one_undamped_port_is_named() -> None:
    n = 300
    K = sp.diags([2.0, -1, -1], [0, 1, -1], shape=(n, n)).tolil()
    K[-1, -1] = 1
    B = np.zeros((n, 1))
    B[-1] = 1
    body = flexgram.Matrices(K.tocsr() * 1e6, sp.eye(n).tocsr(), B)
    with pytest.warns(UserWarning, match="H vanishes or nearly so.*relative_to band"):
        rom = flexgram.reduce(body, band_hz=(0.1, 10), tol=1e-4)
    assert not rom.met and ("no bound" in repr(rom) or rom.certified_error > 1e-4)
    options = {"mor_tol_relative_to": "band"}
    assert flexgram.reduce(body, band_hz=(0.1, 10), tol=1e-4, options=options).met


def test_reached_beside_undamped_resonances(tmp_path: Path, rack: Path) -> None:
    """What is said to be reached is, and is not far below the claim where that is tight."""
    body, out = tmp_path / "b.h5", tmp_path / "r.h5"
    flexgram.import_body(rack_description(tmp_path), body)
    run("reduce", "-body", body, "-mor_band_hz", "10,300", "-mor_tol", "1e-3", "-mor_out", out)
    rom = flexgram.ReducedModel.load(out)
    assert len(rom.excluded)
    system = body_system(body)
    omega = rom.attained_at
    H, H_r = system.transfer(omega), rom.transfer(omega)
    error = np.linalg.norm(H - H_r) / np.linalg.norm(H)
    assert error == pytest.approx(rom.attained_error, rel=0.05)
    ends = [w for pair in rom.excluded for w in pair if rom.band[0] < w < rom.band[1]]
    at_ends = [
        np.linalg.norm(system.transfer(w) - rom.transfer(w)) / np.linalg.norm(system.transfer(w))
        for w in ends
    ]
    assert max(at_ends) <= rom.certified_error
    assert rom.attained_error >= 0.5 * max(at_ends)


def rack_description(folder: Path) -> Path:
    """The rack without damping."""
    source = Path(flexgram.__file__).resolve().parents[2] / "meshes"
    lines = (source / "rack.yaml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith("damping")]
    path = folder / "rack.yaml"
    path.write_text("\n".join(kept).replace("mesh: ", f"mesh: {source}/") + "\n")
    return path


def test_a_mesh_in_python(tmp_path: Path) -> None:
    import meshio

    mesh = box("tetra10", distort=False)
    meshio.write(tmp_path / "box.vtu", mesh)
    ends = {"near": "rigid BOX:-1,-1,-1,1e-9,9,9", "far": "node AT:0.1,0,0"}
    facts = flexgram.import_mesh(tmp_path / "box.vtu", tmp_path / "b.h5", "steel", ends, eta=0.01)
    assert facts["interfaces"]["near"]["position"] == pytest.approx([0, 0.01, 0.015])

    def refused(**changes: Any) -> str:
        arguments = {"material": "steel", "interfaces": ends} | changes
        with pytest.raises(BodyError) as error:
            flexgram.import_mesh(tmp_path / "box.vtu", tmp_path / "b.h5", **arguments)
        return str(error.value)

    assert "no interface is named" in refused(interfaces={})
    assert "NSET:near" in refused(interfaces={"near": "rigid near"})
    assert "must be rigid, distributing or node" in refused(interfaces={"a": "NSET:near"})
    assert "on the same nodes" in refused(interfaces=ends | {"twice": ends["near"]})
    assert "expected one of steel" in refused(material="wood")
    with pytest.raises(BodyError, match="import_mesh"):
        flexgram.import_body(tmp_path / "box.vtu", tmp_path / "b.h5")


def test_python_arguments_of_wrong_kinds(rack: Path) -> None:
    for arguments in ({"band_hz": 10}, {"tol": "small"}, {"band_hz": ("a", 2)}):
        with pytest.raises(BodyError, match="must be"):
            flexgram.reduce(rack, **arguments)
    assert flexgram.reduce(rack, band_hz=np.array([10, 100]), tol=np.float64(0.1)).met
    with pytest.raises(BodyError, match=r"flexgram.Matrices\(K, M, B"):
        flexgram.reduce((1, 2, 3))  # type: ignore[arg-type]


def test_a_sweep_beside_another_body(rack: Path, tmp_path: Path) -> None:
    """The error that is drawn is that of the body that is named."""
    good, rough, sweep = (tmp_path / name for name in ("good.h5", "rough.h5", "s.h5"))
    for out, tol in ((good, "1e-6"), (rough, "1e-1")):
        run("reduce", "-body", rack, "-mor_band_hz", "10,300", "-mor_tol", tol, "-mor_out", out)
    run("sweep", "-body", rack, "-rom", rough, "-mor_sweep_hz", "10,300,9", "-mor_sweep_out", sweep)
    shown = [sweep_figure(sweep, rom).axes[1].lines[0].get_ydata() for rom in (good, rough)]
    with h5py.File(sweep) as file:
        assert np.allclose(shown[1], file["error/relative"][:], rtol=1e-6)
    assert shown[0].max() < 1e-6 < shown[1].max()
    few = tmp_path / "few.h5"
    run("reduce", "-body", rack, "-mor_inputs", "upper", "-mor_tol", "1e-1", "-mor_out", few)
    wrong = run("plot", sweep, "--rom", few, "-o", tmp_path / "p.svg", expect=1)
    assert "its ports are not those of" in message(wrong)
