"""No command writes over a file that it was not told to: companions, endings, names, inputs."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from test_importers import FREQUENCY, write_deck

from conftest import PROGRAM, message, run
from flexgram import BodyError, ReducedModel
from flexgram.exporters import FORMATS, export, target_of


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


def test_a_checkpoint_replaces_only_a_checkpoint(held: Path, tmp_path: Path) -> None:
    """A file of another kind under the checkpoint's name is kept, and told before any work."""
    out = tmp_path / "r.h5"
    reduce = ("reduce", "-body", held / "box.h5", "-mor_band_hz", "100,4000", "-mor_out", out)
    text, body = b"a letter", (held / "box.h5").read_bytes()
    for ending, more in (("checkpoint", ()), ("samples", ("-mor_method", "pod"))):
        other = Path(f"{out}.{ending}")
        for content in (text, body):
            other.write_bytes(content)
            for mode in (("-mor_checkpoint", "yes"), (), ("-mor_restart", "yes")):
                failed = run(*reduce, *more, *mode, expect=1)
                assert "is there and is no checkpoint" in message(failed)
                assert other.read_bytes() == content and not out.exists()
        run(*reduce, *more, "-mor_checkpoint", "no")
        assert other.read_bytes() == body
        out.unlink()
        other.unlink()


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


def test_a_second_run_with_the_same_output_is_told(rack: Path, tmp_path: Path) -> None:
    """The other run's file comes while this one minimises, which takes it seconds."""
    out = tmp_path / "o.h5"
    options = ("-v", "--band", "10,500", "--order", "30", "--second-stage", "optimal")
    process = subprocess.Popen(
        [PROGRAM, "reduce", "-body", rack, *options, "-mor_out", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    for line in process.stdout:
        if line.split()[:1] == ["factors"]:  # told before the first factorisation
            out.write_text("another run's")
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
