"""The example of a function's docstring: run_example.py MODULE.FUNCTION."""

import doctest
import importlib
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import flexgram


def run_example(function: Callable[..., Any], name: str) -> str:
    """What is wrong with it; empty: nothing."""
    module = inspect.getmodule(function)
    scope = {**vars(module), "flexgram": flexgram, "np": np, "Path": Path}
    found = doctest.DocTestParser().get_doctest(function.__doc__ or "", scope, name, None, 0)
    if not found.examples:
        return f"{name} has no example"
    said: list[str] = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    doctest.DocTestRunner(optionflags=flags).run(found, out=said.append)
    return "".join(said)


if __name__ == "__main__":
    place, _, member = sys.argv[1].rpartition(".")
    if wrong := run_example(getattr(importlib.import_module(place), member), sys.argv[1]):
        sys.exit(wrong)
