"""Expressions of numbers written back in the language."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.errors import UsageError
from pcsg.graph.expr import Apply, Expr, Number, Parameter

# How tightly arithmetic binds, as in Python.
_OR, _AND, _NOT, _COMPARE, _ADD, _MULTIPLY, _NEGATE, _POWER, _ATOM = range(1, 10)

# Of every infix operator: how tightly it binds, and what its two sides must at least.
_INFIX = {
    "or": (_OR, _OR, _AND),
    "and": (_AND, _AND, _NOT),
    **dict.fromkeys(("<", "<=", ">", ">=", "==", "!="), (_COMPARE, _ADD, _ADD)),
    **dict.fromkeys(("+", "-"), (_ADD, _ADD, _MULTIPLY)),
    **dict.fromkeys(("*", "/", "%"), (_MULTIPLY, _MULTIPLY, _NEGATE)),
    "^": (_POWER, _ATOM, _NEGATE),
}


def number_text(value: float) -> str:
    """Return the shortest text that reads as this number; integers have no point."""
    if not math.isfinite(value):
        raise UsageError(f"a grammar cannot hold the number {value}")
    if value.is_integer() and abs(value) < 1e16:
        return f"{value:.0f}"
    return repr(value)


def expr_text(expr: Expr) -> str:
    """Return an expression in the language, with as few parentheses as it needs.

    Parameters
    ----------
    expr
        Any nesting.

    Raises
    ------
    UsageError
        A constant is infinite or NaN.
    """
    if isinstance(expr, Number):  # most are
        return number_text(expr.value)
    out: list[str] = []
    work: list[str | tuple[Expr, int]] = [(expr, 0)]
    while work:
        item = work.pop()
        if isinstance(item, str):
            out.append(item)
            continue
        inner, least = item
        binds, parts = _parts(inner)
        work.extend(reversed(parts if binds >= least else ["(", *parts, ")"]))
    return "".join(out)


def _parts(expr: Expr) -> tuple[int, list[str | tuple[Expr, int]]]:
    """Return how tightly an expression binds, and its text with its arguments left open."""
    if isinstance(expr, Number):
        return (_NEGATE if math.copysign(1.0, expr.value) < 0 else _ATOM), [number_text(expr.value)]
    if isinstance(expr, Parameter):
        return _ATOM, [expr.name]
    assert isinstance(expr, Apply)
    args = expr.args
    if expr.function in _INFIX:
        binds, left, right = _INFIX[expr.function]
        sign = "^" if expr.function == "^" else f" {expr.function} "
        return binds, [(args[0], left), sign, (args[1], right)]
    if expr.function == "neg":
        return _NEGATE, ["-", (args[0], _POWER)]
    if expr.function == "not":
        return _NOT, ["not ", (args[0], _NOT)]
    parts: list[str | tuple[Expr, int]] = [f"{expr.function}("]
    for k, arg in enumerate(args):
        if k:
            parts.append("; " if k == expr.seeds else ", ")
        parts.append((arg, 0))
    return _ATOM, [*parts, ")"]


def call_text(name: str, args: Sequence[Expr], reference: str | None = None) -> str:
    """Return ``name(reference, args)``, or the bare name where there are no arguments."""
    texts = [*([reference] if reference else []), *(expr_text(a) for a in args)]
    return f"{name}({', '.join(texts)})" if texts else name
