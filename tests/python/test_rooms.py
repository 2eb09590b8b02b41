"""The rooms of the Python package: what each may import, and that nothing imports in a circle."""

from __future__ import annotations

import ast
import graphlib
import importlib
import re
import sys
from pathlib import Path

import pytest

import flexgram
from flexgram.moved import MOVED

ROOT = Path(flexgram.__file__).parent
MODULES = {
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in ROOT.rglob("*.py")
}
#: Modules beside the rooms and what these may import.
BESIDE = {
    "basics": set(),
    "moved": set(),
    "reduced_model": {"basics", "model", "pictures"},
    "__main__": {"basics", "cli"},
}


def imports_of(path: Path) -> set[str]:
    """Modules of flexgram that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "flexgram":
            for alias in node.names:
                deeper = f"{node.module}.{alias.name}"
                found.add(deeper if deeper in MODULES else str(node.module))
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names if a.name.split(".")[0] == "flexgram"}
    return found


def room_of(module: str) -> str:
    return [*module.split("."), ""][1]


def allowed(room: str) -> set[str] | None:
    """Rooms that a room may import, as the first lines of it say; None: all."""
    if room in BESIDE:
        return BESIDE[room]
    words = re.search(r"^May import: ([^.]+)\.", MODULES[f"flexgram.{room}"].read_text(), re.M)
    assert words, f"{room} does not say what it may import"
    return None if words[1] == "all" else set(words[1].split(", ")) | {room}


def test_rooms_import_what_they_say() -> None:
    wrong = []
    for module, path in MODULES.items():
        room = room_of(module)
        if not room:
            continue
        may = allowed(room)
        wrong += [
            f"{module} imports {other}"
            for other in imports_of(path)
            if may is not None and room_of(other) not in may
        ]
    assert not wrong


def test_no_imports_in_a_circle() -> None:
    graph = {module: imports_of(path) - {module, "flexgram"} for module, path in MODULES.items()}
    order = list(graphlib.TopologicalSorter(graph).static_order())
    assert set(MODULES) <= set(order)


@pytest.mark.parametrize("old", sorted(MOVED))
def test_names_of_before_lead_to_the_new_ones(old: str) -> None:
    sys.modules.pop(f"flexgram.{old}", None)
    try:
        with pytest.warns(DeprecationWarning, match=f"flexgram.{old} is flexgram.{MOVED[old]} now"):
            module = importlib.import_module(f"flexgram.{old}")
    except ImportError as error:  # it needs a package that is not there
        pytest.skip(str(error))
    assert module is importlib.import_module(f"flexgram.{MOVED[old]}")
