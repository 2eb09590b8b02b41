"""One command for all verbs: of the program, and of the Python package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import flexgram
from conftest import ENVIRONMENT, PROGRAM, PYTHON, ROOT, message, run
from flexgram import __version__
from flexgram.__main__ import PROGRAM_VERBS
from flexgram.cli.commands import COMMANDS


def call(*words: str, **arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, **arguments)  # type: ignore


def test_help_lists_every_verb_with_the_words_of_its_own_help() -> None:
    text = run("-help").out
    for name, (what, *_) in COMMANDS.items():
        assert f"  flexgram {name:<10} {what}\n" in text
    for verb in PROGRAM_VERBS:
        assert f"  flexgram {verb} " in text
        for word in ("--help", "--help-all"):
            of_python = call(str(PYTHON), "-m", "flexgram", verb, word)
            assert of_python.stdout == run(verb, word).out


def test_help_of_a_verb_shows_its_options_only() -> None:
    """All by -help, as PETSc's users expect it."""
    has = {verb: run(verb, "--help-all").out for verb in PROGRAM_VERBS}
    assert all(text == run(verb, "-help").out for verb, text in has.items())
    assert "-mor_sweep_hz" in has["sweep"] and "-mor_sweep_hz" not in has["reduce"]
    assert "  --medium, -medium\n" in has["cut"] and "  --medium," not in has["reduce"]
    assert "-mor_ordering" in has["certify"] and "-mor_ordering" not in has["cut"]
    assert all("--monitor, -mor_monitor" in text for text in has.values())


def test_short_help_fits_a_screen_and_names_options_that_there_are() -> None:
    for verb in PROGRAM_VERBS:
        text, whole = run(verb, "--help").out, run(verb, "--help-all").out
        assert text == run(verb, "-h").out == run("help", verb).out
        assert ("2 if the tolerance" in text) == (verb in ("reduce", "certify", "cut"))
        assert len(text.splitlines()) <= 32 and max(map(len, text.splitlines())) <= 90
        shown = re.findall(r"^  (--[a-z-]+)", text, re.MULTILINE)
        assert len(shown) >= 2
        for option in set(shown) - {"--help-all"}:
            assert f"  {option}, -" in whole, (verb, option)


def test_short_words_are_the_same_command(tmp_path: Path) -> None:
    body, roms = tmp_path / "rack.h5", [tmp_path / f"{k}.rom.h5" for k in range(3)]
    run("import", ROOT / "meshes" / "rack.yaml", "-o", body)
    run("reduce", "-body", body, "-mor_band_hz", "10,500", "-mor_tol", "1e-3", "-mor_out", roms[0])
    run("reduce", body, "--band", "10,500", "--tol", "1e-3", "-o", roms[1])
    # Before and behind the file, with =, unit or per cent, mixed, a flag without its value.
    mixed = ("--band-hz=10,500", "-mor_tol", "0.1%", "--field-error", body, "--out", roms[2])
    run("reduce", *mixed, ranks=2)
    models = [flexgram.ReducedModel.load(rom) for rom in roms]
    assert np.array_equal(models[0].K, models[1].K)
    assert models[0].order == models[2].order and len(models[2].field_error) > 0
    sweep = tmp_path / "sweep.h5"
    said = run("sweep", body, roms[1], "--sweep", "10,500,3", "-o", sweep).out
    assert "at most" in said and sweep.exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--bnd", "10,500"), "unknown option --bnd: did you mean --band?"),
        (("-band", "10,500"), "unknown option -band: did you mean --band (-mor_band_hz in an"),
        (("-mor_band", "10,500"), "unknown option -mor_band: did you mean --band (-mor_band_hz"),
        (("--tolerance", "1e-3"), "unknown option --tolerance: did you mean --tol?"),
        (("--mor_tol", "1e-3"), "unknown option --mor-tol: did you mean --tol?"),
        (("--verbose",), "unknown option --verbose: did you mean -v?"),
        (("--sweep", "1,2,3"), "--sweep is an option of flexgram sweep, not of reduce"),
        (("--wobble", "1"), "unknown option --wobble: flexgram reduce --help-all lists all"),
        (("--tol", "1", "--tol", "2"), "--tol is given twice"),
        (("--tol", "1", "-mor_tol", "2"), "-mor_tol is given twice"),
        (("-mor_tol", "1", "--tol", "2"), "--tol is given twice"),
        (("--band", "1,2", "--band", "3,4"), "given twice: several bands are one list"),
        (("–tol", "1e-3"), "–tol begins with a dash of a text processor"),
        (("tol=1e-3",), "stray word tol=1e-3: did you mean --tol 1e-3?"),
        (("--band", "10-500"), "must be finite numbers with commas between them and no unit"),
        (("--order", "0"), "option --order 0: must be a whole number from 1 on"),
        (("--order", "3", "--tol", "1e-3"), "give --tol or --order, not both"),
        (("--band",), "--band needs a value"),
        (("--band", "--tol", "1e-3"), "--band needs a value"),
        (("-o",), "-o needs the name of the file"),
        (("two.h5",), "stray word two.h5: flexgram reduce takes 1 file, which is named already"),
        (("--tol", "small"), "option --tol small: must be a finite number"),
        (("--tol", "1%%"), "option --tol 1%%: must be a finite number"),
        (("--memory-limit-mb", "5%"), "must be a finite number"),
        (("--frame", "bucken"), "option --frame bucken: must be one of"),
        (("-mor_tolr", "1"), "unknown option -mor_tolr: did you mean --tol"),
    ],
)
def test_wrong_command_lines(words: tuple[str, ...], expected: str) -> None:
    assert expected in message(run("reduce", "body.h5", *words, expect=1))
    assert "writes no file" in message(run("plan", "body.h5", "-o", "x.h5", expect=1))


def test_what_is_printed(tmp_path: Path) -> None:
    """By default a few lines; the plan, the solver or nothing by -v, -vv, -q."""
    body, rom = tmp_path / "rack.h5", tmp_path / "rack.rom.h5"
    run("import", ROOT / "meshes" / "rack.yaml", "-o", body)
    words = ("reduce", str(body), "--band", "10,500", "--tol", "1e-3", "-o", str(rom))
    quiet = {key: value for key, value in ENVIRONMENT.items() if key != "PETSC_OPTIONS"}

    def said(*more: str) -> str:
        return call(str(PROGRAM), *words, *more, env=quiet).stdout

    brief = [line for line in said().splitlines() if "done after" not in line]
    assert brief[0].startswith(f"{body}: 5820 dofs, 12 inputs and outputs")
    assert brief[1].startswith("Reduced from 5820 to ")
    assert brief[2].startswith("Certified from 10 to 500 Hz: relative error at most ")
    assert brief[2].endswith("tolerance 0.001 met.")
    claim = float(brief[2].split("at most ")[1].split(",")[0])
    assert claim == pytest.approx(flexgram.ReducedModel.load(rom).certified_error, rel=0.05)
    assert brief[3].startswith("  It is largest for displacement from force; of H as a whole")
    assert brief[4].split() == ["wrote", str(rom)]
    assert brief[5].split()[1:] == f"flexgram report {rom} -o {rom.with_suffix('.html')}".split()
    assert len(brief) == 6
    plan = said("-v")
    assert "  skipped  " in plan and "  time  " in plan and len(said("-vv")) > len(plan)
    assert said("-q") == ""


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
    assert said.startswith(f"usage: flexgram {verb}") and said == run(verb, "--help-all").out
    short = run(verb, "--help").out
    assert short.startswith(f"usage: flexgram {verb}") and len(short.splitlines()) <= 60
    assert verb == "import" or short == said
    wrong = run(verb, "--no-such-option", expect=1)
    assert f"(flexgram {verb} --help)" in message(wrong)
    bare = run("reduce", expect=1)
    assert "no body file is named" in message(bare) and "warning" not in bare.out + bare.err


def test_short_help_of_import_names_options_that_there_are() -> None:
    short, whole = run("import", "--help").out, run("import", "--help-all").out
    options = set(re.findall(r"(--[a-z-]+)", short)) - {"--help-all"}
    assert len(options) > 10 and max(map(len, short.splitlines())) <= 100
    assert all(
        f"  {option} " in whole or f"[{option} " in whole or f"[{option}]" in whole
        for option in options
    )


def test_options_files_take_the_names_of_petsc(tmp_path: Path) -> None:
    options = tmp_path / "job.options"
    for text, expected in (
        (
            "--tol 1e-4\n",
            "unknown option --tol: an options file and PETSC_OPTIONS take PETSc's names, here -mor",
        ),
        ("-tol 1e-4\n", "unknown option -tol: did you mean --tol (-mor_tol in an options file"),
        ("band = 10,300\n", "line 1: band: each line begins with an option"),
    ):
        options.write_text(text)
        assert expected in message(run("reduce", "a.h5", "-options_file", options, expect=1))
    environment = ENVIRONMENT | {"PETSC_OPTIONS": "--tol 1e-4"}
    said = call(str(PROGRAM), "reduce", "a.h5", env=environment)
    assert said.returncode == 1 and "PETSc's names, here -mor_tol" in said.stderr


def test_verbs_of_python_name_what_is_near() -> None:
    wrong = run("import", "rack.yaml", "-o", "a.h5", "--alhpa", "4", expect=1)
    assert message(wrong) == (
        "flexgram: unknown option --alhpa: did you mean --alpha? (flexgram import --help)"
    )
    assert "the following arguments are required" in message(run("import", "rack.yaml", expect=1))
    assert "name a verb first: flexgram reduce" in message(run(ROOT / "README.md", expect=1))
    assert "unknown verb reduc: did you mean reduce?" in message(run("reduc", expect=1))
    assert "unknown verb reduc: did you mean reduce?" in message(run("help", "reduc", expect=1))


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not there")
@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        (["reduce", "--ban"], ["--band"]),
        (["red"], ["reduce"]),
        (["reduce", "--frame", ""], ["auto", "none", "buckens", "tangent"]),
        (["export", "rom.h5", "--to", "s"], ["sid", "simscape", "state-space"]),
        (["cut", "--sweep"], []),
        (["report", "--bo"], ["--body"]),
        (["completion", ""], ["bash", "zsh"]),
        (["help", "cer"], ["certify"]),
        (["reduce", "--statics", "wo"], ["words"]),
    ],
)
def test_completion_of_bash(tmp_path: Path, typed: list[str], expected: list[str]) -> None:
    """What bash answers to a tab."""
    (tmp_path / "words").write_text(call(str(PROGRAM), "completion", "bash").stdout)
    words = " ".join(f"'{word}'" for word in ["flexgram", *typed])
    shell = f"""
        source words
        COMP_WORDS=({words}) COMP_CWORD={len(typed)}
        _flexgram
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = call("bash", "-c", shell, cwd=tmp_path)
    assert done.stdout.split() == expected and not done.stderr
