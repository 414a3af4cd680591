"""Arithmetic of L-systems: texts as functions of named numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

from pcsg.errors import UsageError, suggest

LONGEST = 10_000
"""Characters of a formula at most."""

DEEPEST = 150
"""Operations within each other at most: each is a call of Python's."""

NESTED = 50
"""Parentheses, signs and powers within each other at most, for the same reason."""

Values = Mapping[str, float]
Compute = Callable[[Values], float]


class Draws:
    """Random numbers: splitmix64, the same everywhere and for ever."""

    def __init__(self, seed: int) -> None:
        self.state = (seed * 0x9E3779B97F4A7C15 + 0x632BE59BD9B4E019) % 2**64

    def uniform(self) -> float:
        """Return a number in [0, 1)."""
        self.state = (self.state + 0x9E3779B97F4A7C15) % 2**64
        z = self.state
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB % 2**64
        return ((z ^ (z >> 31)) >> 11) / 2.0**53

    def normal(self) -> float:
        """Return a standard normal number (Box and Muller)."""
        a, b = 1.0 - self.uniform(), self.uniform()
        return math.sqrt(-2.0 * math.log(a)) * math.cos(2.0 * math.pi * b)


@dataclass(frozen=True)
class Formula:
    """A function of named numbers.

    Attributes
    ----------
    compute
        Raises ArithmeticError or ValueError where there is no value.
    names
        What it reads.
    random
        Whether it draws numbers by chance.
    number
        Its value where it is a number, with or without a sign.
    size
        How many words and signs it has.
    """

    text: str
    compute: Compute
    names: frozenset[str] = frozenset()
    random: bool = False
    number: float | None = None
    size: int = 1

    @property
    def shown(self) -> str:
        """The text, or as much of it as a message holds."""
        return shorten(self.text)


def shorten(text: str) -> str:
    """Return as much of a text as a message holds."""
    return text if len(text) <= 60 else text[:60] + "..."


class _Function(NamedTuple):
    """A function, and how many numbers it takes; ``most`` -1 for any number of them."""

    call: Callable[..., float]
    least: int
    most: int


FUNCTIONS: dict[str, _Function] = {
    "sin": _Function(lambda a: math.sin(math.radians(a)), 1, 1),
    "cos": _Function(lambda a: math.cos(math.radians(a)), 1, 1),
    "tan": _Function(lambda a: math.tan(math.radians(a)), 1, 1),
    "atan2": _Function(lambda y, x: math.degrees(math.atan2(y, x)), 2, 2),
    "sqrt": _Function(math.sqrt, 1, 1),
    "exp": _Function(math.exp, 1, 1),
    "ln": _Function(math.log, 1, 1),
    "abs": _Function(abs, 1, 1),
    "min": _Function(min, 2, -1),
    "max": _Function(max, 2, -1),
    "floor": _Function(lambda x: float(math.floor(x)), 1, 1),
    "ceil": _Function(lambda x: float(math.ceil(x)), 1, 1),
    "round": _Function(lambda x: float(round(x)), 1, 1),
    "sign": _Function(lambda x: math.copysign(1.0, x) if x else 0.0, 1, 1),
}
"""Functions without chance; angles are degrees."""

CHANCE = {"ran": 1, "nran": 2}
"""Functions that draw numbers, and how many they take."""

_BINARY: dict[str, Callable[[float, float], float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "%": lambda a, b: a % b,
    # Not **, which has complex roots of negative numbers.
    "^": math.pow,
    "<": lambda a, b: float(a < b),
    "<=": lambda a, b: float(a <= b),
    ">": lambda a, b: float(a > b),
    ">=": lambda a, b: float(a >= b),
    "==": lambda a, b: float(a == b),
    "!=": lambda a, b: float(a != b),
}

_SPELLINGS = {"**": "^", "=": "==", "and": "&&", "or": "||"}

_LEVELS = (("||",), ("&&",), ("<", "<=", ">", ">=", "==", "!="), ("+", "-"), ("*", "/", "%"))
"""Operators from the loosest to the tightest; comparisons do not chain."""

_COMPARISONS = 2

_LEVEL_OF = {sign: level for level, signs in enumerate(_LEVELS) for sign in signs}

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?![\w.])|(?P<name>[^\W\d]\w*)"
    r"|(?P<sign>\*\*|&&|\|\||<=|>=|==|!=|[-+*/%^<>=!(),]))"
)

NAME = re.compile(r"[^\W\d]\w*")
"""What a number can be called."""


def read_formula(text: str, draws: Draws) -> Formula:
    """Return the function that a text is.

    ``ran(x)`` is uniform in [0, x), ``nran(m, s)`` normal. Operators are those of C, with ``^`` for
    powers; ``!`` binds tightly, the word ``not`` loosely.

    Raises
    ------
    UsageError
        The text is no arithmetic.
    """
    return _Reader(text.strip(), draws).read()


class _Part(NamedTuple):
    """A part of a formula, and how deeply its operations nest."""

    compute: Compute
    depth: int
    number: float | None = None


class _Reader:
    def __init__(self, text: str, draws: Draws) -> None:
        self.shown = shorten(text)
        if len(text) > LONGEST:
            raise UsageError(f"`{self.shown}` is longer than {LONGEST:,} characters")
        self.text, self.draws = text, draws
        self.tokens = self._cut()
        self.at = 0
        self.nesting = 0
        self.names: set[str] = set()
        self.random = False

    def _cut(self) -> list[tuple[str, str]]:
        tokens, at = [], 0
        while at < len(self.text):
            match = _TOKEN.match(self.text, at)
            if not match:
                if not self.text[at:].strip():
                    break
                raise self._no_arithmetic()
            kind = match.lastgroup or ""
            word = match[kind]
            if word in _SPELLINGS:
                kind, word = "sign", _SPELLINGS[word]
            elif word == "not":
                kind = "sign"
            tokens.append((kind, word))
            at = match.end()
        return tokens

    def _no_arithmetic(self) -> UsageError:
        return UsageError(f"`{self.shown}` is not arithmetic")

    @property
    def next(self) -> str:
        """The next sign, none where a number, a name or the end is."""
        if self.at < len(self.tokens) and self.tokens[self.at][0] == "sign":
            return self.tokens[self.at][1]
        return ""

    def read(self) -> Formula:
        part = self._operation(0)
        if self.at < len(self.tokens):
            raise self._no_arithmetic()
        names, size = frozenset(self.names), len(self.tokens)
        return Formula(self.text, part.compute, names, self.random, part.number, size)

    def _made(self, compute: Compute, *below: _Part) -> _Part:
        depth = 1 + max(part.depth for part in below)
        if depth > DEEPEST:
            raise UsageError(f"`{self.shown}` has too many operations; `#define` parts of it")
        return _Part(compute, depth)

    def _operation(self, least: int) -> _Part:
        """Return operands joined by operators of a level or a tighter one."""
        if self.next == "not" and least <= _COMPARISONS:
            self.at += 1
            with self._inside():
                part = self._negated(self._operation(_COMPARISONS))
        else:
            part = self._signed()
        while (level := _LEVEL_OF.get(self.next, -1)) >= least:
            sign = self.next
            self.at += 1
            part = self._binary(sign, part, self._operation(level + 1))
            if level == _COMPARISONS and _LEVEL_OF.get(self.next) == _COMPARISONS:
                raise UsageError(f"`{self.shown}`: comparisons do not chain: `a < b && b < c`")
        return part

    @contextmanager
    def _inside(self) -> Iterator[None]:
        """Count how deeply what is read stands; texts may not use up Python's stack."""
        self.nesting += 1
        if self.nesting > NESTED:
            raise UsageError(
                f"`{self.shown}` nests more than {NESTED} times; `#define` parts of it"
            )
        yield
        self.nesting -= 1

    def _binary(self, sign: str, left: _Part, right: _Part) -> _Part:
        a, b = left.compute, right.compute
        # What the left side decides does not look at the right one: x > 0 && 1/x > 2.
        if sign == "&&":
            return self._made(lambda names: float(bool(a(names) and b(names))), left, right)
        if sign == "||":
            return self._made(lambda names: float(bool(a(names) or b(names))), left, right)
        operate = _BINARY[sign]
        return self._made(lambda names: operate(a(names), b(names)), left, right)

    def _negated(self, part: _Part) -> _Part:
        value = part.compute
        return self._made(lambda names: float(not value(names)), part)

    def _signed(self) -> _Part:
        """Return what signs, and powers that bind tighter than these, stand before."""
        sign = self.next
        if sign not in ("-", "+", "!"):
            return self._raised()
        self.at += 1
        with self._inside():
            part = self._signed()
        if sign == "!":
            return self._negated(part)
        if sign == "+":
            return part
        if part.number is not None:
            number = -part.number
            return _Part(lambda _: number, part.depth, number)
        value = part.compute
        return self._made(lambda names: -value(names), part)

    def _raised(self) -> _Part:
        part = self._atom()
        if self.next != "^":
            return part
        self.at += 1
        with self._inside():
            exponent = self._signed()
        return self._binary("^", part, exponent)

    def _atom(self) -> _Part:
        if self.at >= len(self.tokens):
            raise self._no_arithmetic()
        kind, word = self.tokens[self.at]
        self.at += 1
        if kind == "number":
            number = float(word)
            if not math.isfinite(number):
                raise UsageError(f"`{self.shown}`: the number is too large")
            return _Part(lambda _: number, 0, number)
        if kind == "name":
            if self.next == "(":
                return self._call(word)
            self.names.add(word)
            return _Part(lambda names: names[word], 0)
        if word != "(":
            raise self._no_arithmetic()
        (part,) = self._arguments(1, 1, "")
        return part

    def _arguments(self, least: int, most: int, name: str) -> list[_Part]:
        """Return what stands between parentheses, the first of which is read."""
        with self._inside():
            parts = [] if self.next == ")" else [self._operation(0)]
            while self.next == ",":
                self.at += 1
                parts.append(self._operation(0))
        if self.next != ")":
            raise self._no_arithmetic()
        self.at += 1
        if len(parts) < least or 0 <= most < len(parts):
            if not name:
                raise self._no_arithmetic()
            wanted = f"{least} number{'s' if least != 1 else ''}" + (" or more" if most < 0 else "")
            raise UsageError(f"`{self.shown}`: `{name}` takes {wanted}, not {len(parts)}")
        return parts

    def _call(self, name: str) -> _Part:
        self.at += 1
        if name in CHANCE:
            self.random = True
            parts = self._arguments(CHANCE[name], CHANCE[name], name)
            return self._by_chance(name, parts)
        if name not in FUNCTIONS:
            hint = suggest(name, [*FUNCTIONS, *CHANCE])
            raise UsageError(f"unknown function `{name}`" + (f"; {hint}" if hint else ""))
        function = FUNCTIONS[name]
        parts = self._arguments(function.least, function.most, name)
        call, values = function.call, tuple(part.compute for part in parts)
        if len(values) == 1:
            value = values[0]
            return self._made(lambda names: call(value(names)), *parts)
        return self._made(lambda names: call(*(v(names) for v in values)), *parts)

    def _by_chance(self, name: str, parts: list[_Part]) -> _Part:
        draws, first = self.draws, parts[0].compute
        if name == "ran":
            return self._made(lambda names: first(names) * draws.uniform(), *parts)
        spread = parts[1].compute
        return self._made(lambda names: first(names) + spread(names) * draws.normal(), *parts)
