"""Forces as functions of time: a grammar of their own, nothing of Python's."""

from __future__ import annotations

import numpy as np
import pytest

from flexgram import BodyError
from flexgram.simulation.expressions import function_of_time

T = np.linspace(0, 1, 11)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-1e4*sin(20*pi*t)", -1e4 * np.sin(20 * np.pi * T)),
        ("where(t < 0.5, 1, 0)", np.where(T < 0.5, 1.0, 0.0)),
        ("(t > 0.2) & (t <= 0.8)", (T > 0.2) & (T <= 0.8)),
        ("interp(t, [0, 1], [2, 3])", 2 + T),
        ("2**-t % 3", 2**-T % 3),
        ("3", np.full(11, 3.0)),
    ],
)
def test_values(text: str, expected: object) -> None:
    assert np.allclose(function_of_time(text, T), expected, rtol=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "t.__class__",
        "lambda: 0",
        "[x for x in t]",
        "open('f')",
        "9**9**9",
        "1/t",
        "sin(t",
        "'a'",
        "sin(t, out=t)",
        "t if t else t",
        "",
        "load('x')",
        "maximum(0, 2*t, t)",
        "sin(t, t)",
        "where(t)",
    ],
)
def test_what_is_no_function_of_time(text: str) -> None:
    with pytest.raises(BodyError):
        function_of_time(text, T)


@pytest.mark.parametrize(
    "text",
    [
        "interp(t, [1, 0.5, 0], [0, 1, 0])",
        "interp(t, [0, 1, 0.5], [0, 1, 2])",
        "interp(t, [0, 0, 1], [0, 1, 2])",
    ],
)
def test_times_of_a_table_must_rise(text: str) -> None:
    """NumPy gives zeros for the first of these, in silence."""
    with pytest.raises(BodyError, match="must rise"):
        function_of_time(text, T)


def test_a_table_has_a_value_for_each_time() -> None:
    with pytest.raises(BodyError, match="a value for each time"):
        function_of_time("interp(t, [0, 1], [0, 1, 2])", T)
