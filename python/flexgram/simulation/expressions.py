"""Functions of time as users write them: arithmetic and the usual functions, nothing else."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from flexgram.basics import BodyError


def interp(t: Any, times: Any, values: Any) -> Any:
    """A table over time, linear between its points, as ``numpy.interp``.

    Raises
    ------
    BodyError
        If the times do not rise, where NumPy gives wrong numbers without a word.
    """
    if np.shape(times) != np.shape(values) or np.ndim(times) != 1 or not np.size(times):
        raise BodyError("interp(t, times, values): a value for each time, please")
    if not np.all(np.diff(times) > 0):
        raise BodyError("interp(t, times, values): the times must rise")
    return np.interp(t, times, values)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: getattr(np, name)
    for name in (
        "sin",
        "cos",
        "tan",
        "arcsin",
        "arccos",
        "arctan",
        "arctan2",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "log",
        "log10",
        "sqrt",
        "abs",
        "sign",
        "floor",
        "heaviside",
        "minimum",
        "maximum",
        "where",
        "sinc",
    )
} | {"interp": interp}
NUMBERS = {"pi": np.pi, "e": np.e}
OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.true_divide,
    ast.Mod: np.mod,
    ast.Pow: np.power,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.BitAnd: np.logical_and,
    ast.BitOr: np.logical_or,
}


def function_of_time(text: str, t: Any) -> Any:
    """The values of an expression such as ``-1e4*sin(20*pi*t)*(t < 0.1)`` at the times ``t``.

    Parameters
    ----------
    text : str
        Numbers, ``t``, ``pi``, ``e``, + - * / % ** < <= > >= & | and the functions ``FUNCTIONS``;
        lists of numbers as arguments of ``interp``.
    t : (n,) array
        Times [s].

    Returns
    -------
    (n,) array

    Raises
    ------
    BodyError
        For anything else, and where a value is not finite.
    """

    t = np.array(t, dtype=float)

    def value(node: ast.AST) -> Any:
        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
            return float(node.value)
        if isinstance(node, ast.Name) and node.id == "t":
            return t
        if isinstance(node, ast.Name) and node.id in NUMBERS:
            return NUMBERS[node.id]
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](value(node.left), value(node.right))
        if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](value(node.operand))
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OPERATORS:
            return OPERATORS[type(node.ops[0])](value(node.left), value(node.comparators[0]))
        if isinstance(node, ast.List):
            return np.array([value(item) for item in node.elts])
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            work = FUNCTIONS.get(node.func.id)
            takes = getattr(work, "nin", 1 if node.func.id == "sinc" else 3)
            if work is not None and len(node.args) == takes:  # NumPy would write into one more
                return work(*(value(argument) for argument in node.args))
        word = ast.get_source_segment(text, node) or text
        raise BodyError(
            f"{word!r} is not understood: an expression in t has numbers, pi, "
            f"+ - * / % ** < > & | and {', '.join(FUNCTIONS)}"
        )

    try:
        with np.errstate(all="ignore"):
            values = value(ast.parse(text.strip(), mode="eval").body)
            result = np.broadcast_to(np.asarray(values, dtype=float), np.shape(t))
    except SyntaxError as error:
        words = f"{text!r} is no expression in t ({error.msg})" if text else "expected PORT=f(t)"
        raise BodyError(words) from None
    except (ValueError, TypeError, RecursionError, OverflowError) as error:
        raise BodyError(f"{text}: {error}") from None
    if not np.all(np.isfinite(result)):
        at = t[int(np.argmin(np.isfinite(result)))]
        raise BodyError(f"{text}: not finite at t = {at:g}")
    return result


def between_times(text: str, t: Any) -> str | None:
    """What is lost between evenly spaced times, to which the response takes a force as linear.

    Examples
    --------
    >>> between_times("sin(2*pi*20000*t)", np.linspace(0, 0.01, 201))
    'it moves between the times by 1.0 of its largest value: take more times'
    >>> between_times("1e4*(t < 0.1)*sin(20*pi*t)", np.linspace(0, 0.2, 401)) is None
    True
    """
    t = np.asarray(t, dtype=float)
    if len(t) < 2:
        return None
    ends = function_of_time(text, t)
    away, largest = 0.0, float(np.abs(ends).max())
    for share in (0.25, 0.5, 0.75):
        inside = function_of_time(text, t[:-1] + share * np.diff(t))
        off = np.abs(inside - (1 - share) * ends[:-1] - share * ends[1:])
        jumps = np.abs(np.diff(ends))  # a step is as sharp as the times are
        away = max(away, float(np.where(off > jumps, off, 0).max()))
        largest = max(largest, float(np.abs(inside).max()))
    if away <= 0.1 * largest:
        return None
    return (
        f"it moves between the times by {away / largest:.1f} of its largest value: take more times"
    )
