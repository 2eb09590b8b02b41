"""The pages of the Python API: whatever they document has an example, and each example runs."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from programs.run_example import run_example
from test_importers import write_deck

import flexgram
from bodies import box
from conftest import ENVIRONMENT, PYTHON, ROOT, run

matplotlib.use("Agg")
#: Examples that need another program's package.
NEED = {
    "flexgram.importers.dolfinx.body": "dolfinx",
    "flexgram.importers.kratos.matrices": "KratosMultiphysics",
    "flexgram.exporters.exudyn.add_body": "exudyn",
    "flexgram.exporters.arrays.to_pymor": "pymor",
}


#: Classes whose methods are users' verbs.
CLASSES = ("flexgram.Medium", "flexgram.ReducedModel")


def named(name: str) -> Any:
    module, _, member = name.rpartition(".")
    return getattr(importlib.import_module(module), member)


def members(module: str, listed: str) -> list[str]:
    """Of ``automodule``: the listed ones, or all that are defined there."""
    if listed:
        return [f"{module}.{word.strip()}" for word in listed.split(",")]
    found = vars(importlib.import_module(module)).items()
    own = (n for n, x in found if getattr(x, "__module__", "") == module and not n.startswith("_"))
    return [f"{module}.{name}" for name in own if callable(named(f"{module}.{name}"))]


def documented() -> dict[str, Callable[..., Any]]:
    """Functions of docs/api.rst, and methods of the classes whose members it shows."""
    text = (ROOT / "docs" / "api.rst").read_text()
    directive = re.compile(r"^\.\. auto(module|function|class):: (\S+)((?:\n +:.*)*)", re.MULTILINE)
    functions: dict[str, Callable[..., Any]] = {}
    for kind, name, options in directive.findall(text):
        listed = re.search(r":members:(.*)", options)
        names = members(name, listed[1].strip()) if kind == "module" and listed else [name]
        for each in names:
            thing = named(each) if kind != "module" or listed else None
            if inspect.isfunction(thing):
                functions[each] = thing
            elif listed and name in CLASSES:
                for method, value in inspect.getmembers(thing, callable):
                    if not method.startswith("_") and value.__module__.startswith("flexgram"):
                        functions[f"{each}.{method}"] = value
    return functions


FUNCTIONS = documented()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two racks: a free one, and one that stands, with stress, gravity and a load history."""
    place = tmp_path_factory.mktemp("examples")
    for file in ("rack.yaml", "standing_rack.yaml", "rack.msh"):
        shutil.copy(ROOT / "meshes" / file, place)
    flexgram.import_body(place / "rack.yaml", place / "rack.h5")
    flexgram.import_body(place / "standing_rack.yaml", place / "standing.h5")
    flexgram.reduce(place / "rack.h5", (10, 500), 1e-3).save(place / "rack.rom.h5")
    frequencies = ("-mor_sweep_hz", "50,450,9", "-mor_sweep_out", place / "rack.sweep.h5")
    run("sweep", "-body", place / "rack.h5", *frequencies)
    flexgram.reduce(place / "standing.h5", (5, 300), 1e-2).save(place / "standing.rom.h5")
    t = np.linspace(0, 1, 401)
    rows = np.column_stack([t, 50 * np.sin(2 * np.pi * 20 * t) * np.sin(np.pi * t) ** 2])
    np.savetxt(place / "loads.csv", rows, delimiter=",", header="t,upper.fx", comments="")
    write_deck(place / "bar.inp", mesh=box("tetra10", (4, 1, 1)))
    np.savetxt(place / "motion.csv", np.column_stack([t, np.ones((401, 4))]), delimiter=",")
    return place


def test_the_pages_name_functions() -> None:
    assert len(FUNCTIONS) > 80 and "flexgram.ReducedModel.transfer" in FUNCTIONS


@pytest.mark.parametrize("name", FUNCTIONS)
def test_examples_run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    if name in NEED:  # such packages do not live in one process with each other
        if importlib.util.find_spec(NEED[name]) is None:
            pytest.skip(f"{NEED[name]} is not installed")
        path = Path(__file__).parent / "programs" / "run_example.py"
        done = subprocess.run(
            [str(PYTHON), str(path), name], env=ENVIRONMENT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
    else:
        assert run_example(FUNCTIONS[name], name) == ""
