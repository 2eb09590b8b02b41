"""One command for all verbs: of the program, and of the Python package."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from conftest import ENVIRONMENT, PROGRAM, PYTHON, ROOT, message, run
from flexgram import __version__
from flexgram.__main__ import PROGRAM_VERBS
from flexgram.cli.commands import COMMANDS


def call(*words: str, **arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, **arguments)  # type: ignore


def test_help_lists_every_verb_with_the_words_of_its_own_help() -> None:
    text = run("-help").out
    for name, (what, *_) in COMMANDS.items():
        assert f"  flexgram {name:<9} {what}\n" in text
    for verb in PROGRAM_VERBS:
        assert f"  flexgram {verb} " in text
        assert call(str(PYTHON), "-m", "flexgram", verb, "--help").stdout == run(verb, "-help").out


def test_help_of_a_verb_shows_its_options_only() -> None:
    has = {verb: run(verb, "--help").out for verb in PROGRAM_VERBS}
    assert "-mor_sweep_hz" in has["sweep"] and "-mor_sweep_hz" not in has["reduce"]
    assert "-medium\n" in has["cut"] and "-medium\n" not in has["reduce"]
    assert "-mor_ordering" in has["certify"] and "-mor_ordering" not in has["cut"]
    assert all("-mor_monitor" in text for text in has.values())


@pytest.mark.parametrize("way", ["program", "link", "path"])
def test_python_verbs_of_the_program(tmp_path: Path, way: str) -> None:
    """From any folder, by its path, by a link, or found in PATH; an error keeps its status."""
    link = tmp_path / "a b" / "fg"
    link.parent.mkdir()
    link.symlink_to(PROGRAM)
    name = {"program": str(PROGRAM), "link": str(link), "path": "fg"}[way]
    environment = ENVIRONMENT | {"PATH": f"{link.parent}:{os.environ['PATH']}"}
    body = tmp_path / "rack.h5"
    (tmp_path / "yaml.py").write_text("raise SystemExit('not this one')")
    done = call(
        name,
        "import",
        str(ROOT / "meshes" / "rack.yaml"),
        "-o",
        str(body),
        cwd=tmp_path,
        env=environment,
    )
    assert done.returncode == 0 and body.exists(), done.stderr
    wrong = call(name, "info", "nothing.h5", cwd=tmp_path, env=environment)
    assert wrong.returncode == 1
    assert wrong.stderr == "flexgram: nothing.h5: no such file\n"


def test_python_verbs_under_mpirun_work_once(tmp_path: Path) -> None:
    body = tmp_path / "rack.h5"
    done = run("import", ROOT / "meshes" / "rack.yaml", "-o", body, ranks=2)
    assert done.out.count("interface lower") == 1 and body.exists()


def test_the_program_without_python_says_so() -> None:
    python = {"FLEXGRAM_PYTHON": "/nowhere/python3"}
    wrong = call(str(PROGRAM), "info", "nothing.h5", env=ENVIRONMENT | python)
    assert wrong.returncode == 1
    expected = "info belongs to the Python package: /nowhere/python3: No such file or directory"
    assert wrong.stderr == f"flexgram: {expected}\n"


def test_one_version() -> None:
    assert run("--version").out.splitlines()[0].split() == ["flexgram", __version__]


@pytest.mark.parametrize("verb", ["import", "info", "report", "export", "couple", "simulate"])
def test_help_and_status_of_the_verbs_of_python(verb: str) -> None:
    """As those of the program: -help, and 1 for a wrong command line (2 is a missed tolerance)."""
    said = run(verb, "-help").out
    assert said.startswith(f"usage: flexgram {verb}") and said == run(verb, "--help").out
    wrong = run(verb, "--no-such-option", expect=1)
    assert f"usage: flexgram {verb}" in wrong.err
    bare = run("reduce", expect=1)
    assert "option -body is missing" in message(bare) and "warning" not in bare.out + bare.err
