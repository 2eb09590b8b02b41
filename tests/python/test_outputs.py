"""Every writer of the package: whole or not at all, files only, never its own input."""

from __future__ import annotations

import os
import re
import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest

from conftest import ENVIRONMENT, PROGRAM, PYTHON, ROOT, chain, message, run
from flexgram import BodyError, ReducedModel, write_matrices
from flexgram.basics import written_aside
from flexgram.body.meshfile import data_files
from flexgram.exporters import FORMATS, export


@pytest.fixture(scope="module")
def rom(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A free body with places, so that every format has what it needs."""
    folder = tmp_path_factory.mktemp("outputs")
    subprocess.run(
        [
            str(PYTHON),
            "-m",
            "flexgram",
            "import",
            str(ROOT / "meshes" / "rack.yaml"),
            "-o",
            str(folder / "rack.h5"),
        ],
        check=True,
        env=ENVIRONMENT,
        capture_output=True,
    )
    run(
        "reduce",
        "-body",
        folder / "rack.h5",
        "-mor_band_hz",
        "10,100",
        "-mor_tol",
        "1e-2",
        "-mor_out",
        folder / "rack.rom.h5",
    )
    return folder / "rack.rom.h5"


def limited(*words: Any, blocks: int = 8) -> subprocess.CompletedProcess[str]:
    """The command line where no file may grow beyond some kilobytes."""
    command = f'ulimit -f {blocks}; exec "$@"'
    return subprocess.run(
        ["bash", "-c", command, "-", str(PYTHON), "-m", "flexgram", *map(str, words)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("format", [*FORMATS, "report", "simulate", "plot"])
def test_a_full_disk_leaves_what_was_there(format: str, rom: Path, tmp_path: Path) -> None:
    suffix = {"report": ".html", "simulate": ".csv", "plot": ".png"}.get(format)
    out = tmp_path / f"out{suffix or FORMATS[format][1]}"
    out.write_text("earlier")
    words: dict[str, list[Any]] = {
        "report": ["report", rom],
        "simulate": ["simulate", rom, "--force", "upper.fz=sin(t)", "--time", "0,1,9999"],
        "plot": ["plot", rom, "--figure", "shapes"],
    }
    blocks = 2 if format == "mbdyn" else 8  # of interfaces alone: a small file
    done = limited(*words.get(format, ["export", rom, "--to", format]), "-o", out, blocks=blocks)
    assert done.returncode != 0
    assert out.read_text() == "earlier" and sorted(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(
    "words",
    [
        ["export", "{rom}", "--to", "npz", "-o", "{rom}"],
        ["report", "{rom}", "-o", "{rom}"],
        ["report", "{rom}", "--body", "{body}", "-o", "{body}"],
        ["plot", "{rom}", "--figure", "error", "-o", "{rom}"],
        ["simulate", "{rom}", "--force", "upper.fz=1", "-o", "{rom}"],
        ["import", "{yaml}", "-o", "{yaml}"],
    ],
)
def test_no_command_replaces_its_input(words: list[str], rom: Path, tmp_path: Path) -> None:
    yaml = tmp_path / "body.yaml"
    yaml.write_text((ROOT / "meshes" / "rack.yaml").read_text())
    places = {"rom": rom, "body": rom.with_name("rack.h5"), "yaml": yaml}
    before = {path: path.read_bytes() for path in places.values()}
    done = subprocess.run(
        [str(PYTHON), "-m", "flexgram", *(w.format(**places) for w in words)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1 and "would replace the input" in done.stderr, done.stderr
    assert {path: path.read_bytes() for path in places.values()} == before


def test_only_files_are_replaced(rom: Path, tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe", tmp_path / "link.npz"
    os.mkfifo(pipe)
    model = ReducedModel.load(rom)
    with pytest.raises(BodyError, match="no file"):
        export(model, pipe, "npz")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    with pytest.raises(BodyError, match="no file"):
        write_matrices(tmp_path, **chain())
    link.symlink_to("real.npz")
    export(model, link, "npz")
    assert link.is_symlink() and np.load(tmp_path / "real.npz")["K"].shape == model.K.shape
    with pytest.raises(BodyError, match=r"writes \.npz|would replace"):
        export(model, rom, "npz")


def test_the_companion_of_a_file_replaces_nothing(rom: Path, tmp_path: Path) -> None:
    """XDMF's data were in an .h5 of the name of the reduced file here."""
    own = tmp_path / "motion.h5"
    own.write_bytes(rom.read_bytes())
    model = ReducedModel.load(own)
    body = rom.with_name("rack.h5")
    export(model, tmp_path / "motion.xdmf", "vtu", body=body)
    assert data_files(tmp_path / "motion.xdmf") == [tmp_path / "motion.xdmf.h5"]
    command = [
        str(PYTHON),
        "-m",
        "flexgram",
        "simulate",
        str(own),
        "--force",
        "upper.fz=1",
        "--time",
        "0,1,3",
        "--body",
        str(body),
        "--xdmf",
        str(tmp_path / "motion.xdmf"),
        "-o",
        str(tmp_path / "motion.csv"),
    ]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "motion.xdmf").read_text()  # meshio reads no hexahedra of 20 nodes in XDMF
    named = re.findall(r"motion\.xdmf\.h5:/(data\d+)", text)
    with h5py.File(tmp_path / "motion.xdmf.h5") as file:
        assert sorted(named) == sorted(file) and len(named) == 2 + 3
    assert own.read_bytes() == rom.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "motion.csv",
        "motion.h5",
        "motion.xdmf",
        "motion.xdmf.h5",
    ]

    other = tmp_path / "motion.xdmf.h5"  # even here there may be what is another's
    other.write_bytes(rom.read_bytes())
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1 and "holds no data of motion.xdmf" in done.stderr
    with pytest.raises(BodyError, match=r"holds no data of motion\.xdmf"):
        export(model, tmp_path / "motion.xdmf", "vtu", body=body)
    assert other.read_bytes() == rom.read_bytes()


def test_a_body_does_not_replace_the_data_of_its_mesh(tmp_path: Path) -> None:
    """The numbers of lever.xdmf are in lever.h5."""
    block = meshio.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]], [("tetra", [[0, 1, 2, 3]])])
    meshio.write(tmp_path / "lever.xdmf", block)
    data = (tmp_path / "lever.h5").read_bytes()
    command = [
        str(PYTHON),
        "-m",
        "flexgram",
        "import",
        str(tmp_path / "lever.xdmf"),
        "--material",
        "steel",
        "--rigid",
        "a=NODES:1,2,3",
        "-o",
        str(tmp_path / "lever.h5"),
    ]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1 and "would replace the input" in done.stderr, done.stderr
    assert (tmp_path / "lever.h5").read_bytes() == data


def test_several_files_or_none(tmp_path: Path) -> None:
    out = tmp_path / "motion.xdmf"
    with pytest.raises(RuntimeError), written_aside(out) as place:
        place.write_text("half")
        place.with_suffix(".h5").write_text("half")
        raise RuntimeError
    assert not list(tmp_path.iterdir())
    with written_aside(out) as place:
        place.write_text("whole")
        place.with_suffix(".h5").write_text("whole")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["motion.h5", "motion.xdmf"]
    with pytest.raises(BodyError, match="may be another's"), written_aside(out) as place:
        place.write_text("again")
        place.with_suffix(".h5").write_text("again")
    assert out.read_text() == out.with_suffix(".h5").read_text() == "whole"
    assert stat.S_IMODE(out.stat().st_mode) & 0o444 == 0o444


@pytest.mark.parametrize("threads", [1, 2])
def test_a_limit_of_the_address_space_never_hangs(rom: Path, tmp_path: Path, threads: int) -> None:
    """OpenBLAS waits for ever where it gets no buffer: an error, or a result."""
    body, out = rom.parent / "rack.h5", tmp_path / "r.h5"
    seen = set()
    for megabytes in range(200, 1000, 50):
        command = f'ulimit -v {1024 * megabytes}; exec "$@"'
        words = [PROGRAM, "reduce", "-body", body, "-mor_band_hz", "10,100", "-mor_out", out]
        done = subprocess.run(
            ["bash", "-c", command, "-", *map(str, words)],
            text=True,
            env=ENVIRONMENT | {"OPENBLAS_NUM_THREADS": str(threads)},
            capture_output=True,
            timeout=300,
        )
        seen.add(done.returncode)
        assert done.returncode in (0, 1, 2), (megabytes, done.stderr)
        if done.returncode == 1:
            assert len([x for x in done.stderr.splitlines() if x.startswith("flexgram: ")]) == 1
    assert seen >= {0, 1}


def test_a_closed_pipe_ends_the_talk_not_the_work(rom: Path, tmp_path: Path) -> None:
    body, out = rom.parent / "rack.h5", tmp_path / "r.h5"
    command = (
        f"'{PROGRAM}' reduce -body '{body}' -mor_out '{out}' | head -1; exit ${{PIPESTATUS[0]}}"
    )
    done = subprocess.run(["bash", "-c", command], env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 0 and out.exists(), done.stderr
    pictures = tmp_path / "pictures"
    command = f"'{PROGRAM}' plot '{out}' -o '{pictures}' | head -1"
    done = subprocess.run(["bash", "-c", command], env=ENVIRONMENT, capture_output=True, text=True)
    assert len(list(pictures.iterdir())) == 5 and not done.stderr


@pytest.mark.parametrize("verb", ["reduce", "certify", "sweep", "assemble"])
def test_only_files_are_replaced_by_the_program(verb: str, tmp_path: Path) -> None:
    """A device, a pipe and a folder stay what they are; a symlink stays one."""
    body = tmp_path / "body.h5"
    write_matrices(body, **chain())
    out = {
        "reduce": "-mor_out",
        "certify": "-mor_medium_out",
        "sweep": "-mor_sweep_out",
        "assemble": "-body_out",
    }[verb]
    pipe, folder = tmp_path / "pipe", tmp_path / "folder"
    os.mkfifo(pipe)
    folder.mkdir()
    for target, what in ((pipe, "a device or pipe"), (folder, "a folder")):
        result = run(verb, "-body", body, "-mor_band_hz", "0.01,0.3", out, target, expect=1)
        assert f"it is {what}" in message(result)
    assert stat.S_ISFIFO(pipe.stat().st_mode) and folder.is_dir()
    result = run("plan", "-body", pipe, expect=1, timeout=120)  # would wait for ever
    assert "a device or pipe" in message(result)


def test_symlinks_and_many_writers(tmp_path: Path) -> None:
    """A symlink is followed, not replaced, and runs that write one file do not mix."""
    body, out, link = tmp_path / "body.h5", tmp_path / "rom.h5", tmp_path / "latest.h5"
    write_matrices(body, **chain())
    out.write_bytes(b"old")
    link.symlink_to("rom.h5")
    command = [
        str(PROGRAM),
        "reduce",
        "-body",
        str(body),
        "-mor_band_hz",
        "0.01,0.3",
        "-mor_out",
        str(link),
    ]
    runs = [subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL) for _ in range(6)]
    assert [r.wait() for r in runs] == [0] * 6
    assert link.is_symlink() and ReducedModel.load(out).order > 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["body.h5", "latest.h5", "rom.h5"]


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_full_disk_leaves_nothing_behind(ranks: int, tmp_path: Path) -> None:
    """A limit on the size of files, 8 MB, stands for the full disk: V alone needs 10 MB."""
    n, ports = 16000, 40
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    loads = np.random.default_rng(1).standard_normal((n, ports))
    write_matrices(body, **chain(n, B=loads))
    result = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "0.01,0.3",
        "-mor_order",
        "80",
        "-mor_method",
        "pod",
        "-mor_samples",
        "4",
        "-mor_validate",
        "0",
        "-mor_checkpoint",  # a busy machine would need more than the 20 s after which one is kept
        "no",
        "-mor_out",
        out,
        ranks=ranks,
        expect=1,
        timeout=300,
        file_limit_kb=8192,
    )
    assert "cannot write" in message(result)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["body.h5"]


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_existing_result_survives_a_failed_run(ranks: int, tmp_path: Path) -> None:
    body, out = tmp_path / "body.h5", tmp_path / "rom.h5"
    write_matrices(body, **chain())
    run("reduce", "-body", body, "-mor_band_hz", "0.01,0.3", "-mor_out", out, ranks=ranks)
    before = out.read_bytes()
    shutil.copy(body, tmp_path / "bad.h5")
    with h5py.File(tmp_path / "bad.h5", "a") as file:
        file["K/data"][0] = np.nan
    run("reduce", "-body", tmp_path / "bad.h5", "-mor_out", out, ranks=ranks, expect=1)
    assert out.read_bytes() == before


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_unwritable_place(ranks: int, tmp_path: Path) -> None:
    body = tmp_path / "body.h5"
    write_matrices(body, **chain())
    result = run(
        "reduce",
        "-body",
        body,
        "-mor_out",
        tmp_path / "no" / "rom.h5",
        ranks=ranks,
        expect=1,
        timeout=300,
    )
    assert "No such file" in message(result)


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_output_must_not_replace_the_body(ranks: int, tmp_path: Path) -> None:
    body = tmp_path / "body.h5"
    write_matrices(body, **chain())
    before = body.read_bytes()
    result = run("reduce", "-body", body, "-mor_out", body, ranks=ranks, expect=1)
    assert "would replace the input" in message(result)
    assert body.read_bytes() == before
