"""Colours as people write them: names, `#7a9b3c`, hsv(h, s, v), palettes.

These are sRGB, as on a screen; the language's own numbers are linear.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan, suggest
from pcsg.grammar.precedence import SyntaxFault
from pcsg.grammar.syntax import Value
from pcsg.graph.expr import Apply, Expr, Number

_HEX = re.compile(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})")


@cache
def color_names() -> Mapping[str, str]:
    """Return the names of CSS and their digits."""
    from PIL import ImageColor

    return {name: code for name, code in ImageColor.colormap.items() if isinstance(code, str)}


def find_color(text: str) -> tuple[float, ...] | None:
    """Return the linear red, green and blue of a name or digits, None if it is neither."""
    digits = color_names().get(text.lower(), text)
    if not _HEX.fullmatch(digits):
        return None
    size = (len(digits) - 1) // 3
    parts = (digits[1 + k * size : 1 + (k + 1) * size] * (3 - size) for k in range(3))
    return tuple(to_linear(int(part, 16) / 255.0) for part in parts)


def read_color(text: str, span: SourceSpan) -> tuple[Expr, ...]:
    """Return the linear red, green and blue of a colour in quotes.

    Raises
    ------
    SyntaxFault
        It is neither a name nor digits.
    """
    found = find_color(text)
    if found is None:
        message = f"`{text}` is not a colour"
        hint = None if text.startswith("#") else suggest(text.lower(), color_names())
        expected = 'a name such as "olive", or "#7a9b3c"'
        raise SyntaxFault(diagnose("bad-value", message, span, expected=expected, hint=hint))
    return tuple(Number(x, span) for x in found)


def to_linear(shown: float) -> float:
    """Return a number of sRGB as a linear one."""
    return shown / 12.92 if shown <= 0.04045 else ((shown + 0.055) / 1.055) ** 2.4


def is_hsv(values: Sequence[Expr]) -> bool:
    """Return whether arguments are one ``hsv(...)``."""
    return len(values) == 1 and isinstance(values[0], Apply) and values[0].function == "hsv"


def read_hsv(values: Sequence[Expr], span: SourceSpan) -> tuple[Expr, ...]:
    """Return the linear red, green and blue of ``hsv(h, s, v)``: degrees, and two of 0 to 1.

    Raises
    ------
    SyntaxFault
        It has not three arguments.
    """
    (call,) = values
    assert isinstance(call, Apply)
    if len(call.args) != 3 or call.seeds:
        message = f"`hsv` takes 3 arguments, not {len(call.args)}"
        expected = "`hsv(hue, saturation, value)`"
        raise SyntaxFault(diagnose("wrong-arguments", message, span, expected=expected))
    hue, saturation, value = call.args
    colored = _apply("*", value, saturation)
    turn = _apply("/", hue, Number(60.0))
    parts = []
    for begin in (5.0, 3.0, 1.0):
        k = _apply("mod", _apply("+", Number(begin), turn), Number(6.0))
        ramp = _apply("min", k, _apply("-", Number(4.0), k), Number(1.0))
        shown = _apply("-", value, _apply("*", colored, _apply("max", Number(0.0), ramp)))
        dark = _apply("/", shown, Number(12.92))
        base = _apply("/", _apply("+", shown, Number(0.055)), Number(1.055))
        is_dark = _apply("<=", shown, Number(0.04045))
        parts.append(_apply("if", is_dark, dark, _apply("^", base, Number(2.4))))
    return tuple(parts)


def check_stops(value: Value) -> list[Diagnostic]:
    """Report stops of a palette that are not constants, or do not grow."""
    problems: list[Diagnostic] = []
    last = -math.inf
    for k, x in enumerate(value.numbers):
        number = constant_of(x)
        if number is None:
            span = getattr(x, "span", None) or value.span
            problems.append(diagnose("bad-value", "a stop is not a constant number", span))
        elif k % 4 == 0:
            if not number > last:
                span = getattr(x, "span", None) or value.span
                problems.append(diagnose("bad-value", f"stops grow, but {number:g} does not", span))
            last = number
    return problems


def constant_of(expr: Expr) -> float | None:
    """Return the value of a number as it is written, perhaps with a sign; else None."""
    if isinstance(expr, Apply) and expr.function == "neg" and isinstance(expr.args[0], Number):
        return -expr.args[0].value
    return expr.value if isinstance(expr, Number) else None


def is_palette(values: Sequence[Expr]) -> bool:
    """Return whether arguments are one ``palette(...)``."""
    return len(values) == 1 and isinstance(values[0], Apply) and values[0].function == "palette"


def palette_color(stops: Sequence[Expr], x: Expr) -> tuple[Expr, ...]:
    """Return the linear red, green and blue at a place of a palette.

    Parameters
    ----------
    stops
        Four numbers for each stop.
    """
    numbers = [constant_of(n) or 0.0 for n in stops]
    rows = [numbers[k : k + 4] for k in range(0, len(numbers), 4)]
    shares = []
    for (a, *_), (b, *_) in pairwise(rows):
        part = _apply("/", _apply("-", x, Number(a)), Number(b - a))
        shares.append(_apply("clamp", part, Number(0.0), Number(1.0)))
    found = []
    for channel in (1, 2, 3):
        total: Expr = Number(rows[0][channel])
        for (low, high), share in zip(pairwise(rows), shares, strict=True):
            step = high[channel] - low[channel]
            total = _apply("+", total, _apply("*", Number(step), share))
        found.append(total)
    return tuple(found)


def _apply(function: str, *args: Expr) -> Expr:
    return Apply(function, args, 0)
