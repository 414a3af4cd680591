"""L-systems: parametric, stochastic, context-sensitive rewriting, and the turtle that draws.

The text is like that of cpfg (Prusinkiewicz and Lindenmayer 1990)::

    #define steps 8
    axiom: !(0.1) A(1, 0.1)
    A(l, w) : l > 0.05 -> F(l) [ &(35) A(l*0.8, w*0.7) ] /(137.5) !(w*0.9) A(l*0.9, w*0.9)
    X < B(x) > Y : x > 1 : 0.6 -> B(x-1)

A rule has a left context, a predecessor, a right context, a condition (``*`` for none) and a
probability, of which only the predecessor must be. Modules are single characters with numbers.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pcsg.errors import UsageError

MOST_MODULES = 5_000_000


class Letter(NamedTuple):
    """A module of the string: a character and its numbers."""

    symbol: str
    args: tuple[float, ...]


@dataclass(frozen=True)
class Pattern:
    """A module with names for its numbers."""

    symbol: str
    names: tuple[str, ...]

    def binds(self, letter: Letter, into: dict[str, float]) -> bool:
        """Return whether a letter fits, and give names to its numbers."""
        if letter.symbol != self.symbol or len(letter.args) != len(self.names):
            return False
        into.update(zip(self.names, letter.args, strict=True))
        return True


Formula = Callable[[Mapping[str, float]], float]


@dataclass(frozen=True)
class LRule:
    """A rule of an L-system."""

    left: tuple[Pattern, ...]
    predecessor: Pattern
    right: tuple[Pattern, ...]
    condition: Formula | None
    probability: Formula | None
    successor: tuple[tuple[str, tuple[Formula, ...]], ...]


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


_FUNCTIONS: dict[str, Callable[..., float]] = {
    "sin": lambda a: math.sin(math.radians(a)),
    "cos": lambda a: math.cos(math.radians(a)),
    "tan": lambda a: math.tan(math.radians(a)),
    "atan2": lambda y, x: math.degrees(math.atan2(y, x)),
    "sqrt": math.sqrt,
    "exp": math.exp,
    "ln": math.log,
    "abs": abs,
    "min": min,
    "max": max,
    "floor": lambda x: float(math.floor(x)),
    "ceil": lambda x: float(math.ceil(x)),
    "round": lambda x: float(round(x)),
    "sign": lambda x: math.copysign(1.0, x) if x else 0.0,
}

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Mod: lambda a, b: a % b,
    ast.Pow: lambda a, b: a**b,
    ast.Lt: lambda a, b: float(a < b),
    ast.LtE: lambda a, b: float(a <= b),
    ast.Gt: lambda a, b: float(a > b),
    ast.GtE: lambda a, b: float(a >= b),
    ast.Eq: lambda a, b: float(a == b),
    ast.NotEq: lambda a, b: float(a != b),
}


def read_formula(text: str, draws: Draws) -> Formula:
    """Return a function of named numbers; ``ran(x)`` is uniform in [0, x), ``nran(m, s)`` normal.

    Raises
    ------
    UsageError
        The text is no arithmetic.
    """
    python = text.strip().replace("&&", " and ").replace("||", " or ").replace("^", "**")
    python = re.sub(r"!(?!=)", " not ", python)
    python = re.sub(r"(?<![<>=!])=(?!=)", "==", python)
    try:
        tree = ast.parse(python.strip(), mode="eval").body
    except (SyntaxError, ValueError):
        raise UsageError(f"`{text.strip()}` is not arithmetic") from None
    functions: dict[str, Callable[..., float]] = {
        **_FUNCTIONS,
        "ran": lambda x: x * draws.uniform(),
        "nran": lambda m, s: m + s * draws.normal(),
    }
    return _compile(tree, text, functions)


def _compile(node: ast.AST, text: str, functions: Mapping[str, Callable[..., float]]) -> Formula:
    def sub(child: ast.AST) -> Formula:
        return _compile(child, text, functions)

    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        number = float(node.value)
        return lambda _: number
    if isinstance(node, ast.Name):
        name = node.id

        def look_up(names: Mapping[str, float]) -> float:
            if name not in names:
                raise UsageError(f"`{name}` has no value in `{text.strip()}`")
            return names[name]

        return look_up
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        operate, a, b = _BINARY[type(node.op)], sub(node.left), sub(node.right)
        return lambda names: operate(a(names), b(names))
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _BINARY:
        operate, a, b = _BINARY[type(node.ops[0])], sub(node.left), sub(node.comparators[0])
        return lambda names: operate(a(names), b(names))
    if isinstance(node, ast.BoolOp):
        parts = [sub(value) for value in node.values]
        every = isinstance(node.op, ast.And)
        return lambda names: float((all if every else any)(p(names) for p in parts))
    if isinstance(node, ast.UnaryOp):
        value = sub(node.operand)
        if isinstance(node.op, ast.Not):
            return lambda names: float(not value(names))
        if isinstance(node.op, ast.USub):
            return lambda names: -value(names)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id not in functions:
            raise UsageError(f"unknown function `{node.func.id}`")
        function, values = functions[node.func.id], [sub(v) for v in node.args]
        return lambda names: float(function(*(v(names) for v in values)))
    raise UsageError(f"`{text.strip()}` is not arithmetic")


def split_modules(text: str) -> list[tuple[str, list[str]]]:
    """Return the characters of a string of modules, each with the texts of its numbers."""
    out: list[tuple[str, list[str]]] = []
    k = 0
    while k < len(text):
        symbol = text[k]
        k += 1
        if symbol.isspace():
            continue
        args: list[str] = []
        # Between a character and its numbers there is no blank.
        if k < len(text) and text[k] == "(" and symbol not in "[]":
            depth, start = 1, k + 1
            k += 1
            while depth and k < len(text):
                depth += {"(": 1, ")": -1}.get(text[k], 0)
                if (text[k] == "," and depth == 1) or depth == 0:
                    args.append(text[start:k])
                    start = k + 1
                k += 1
            if depth:
                raise UsageError(f"`(` without `)` behind `{symbol}`")
        elif symbol in "()":
            raise UsageError(f"stray `{symbol}`")
        out.append((symbol, args))
    return out


@dataclass
class LSystem:
    """A set of rules and where they begin.

    Attributes
    ----------
    constants
        Of ``#define``; ``steps`` and ``angle`` have a meaning.
    settings
        Other lines ``name: value``, such as ``junctions: contact``.
    """

    constants: dict[str, float] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    axiom: list[tuple[str, tuple[Formula, ...]]] = field(default_factory=list)
    rules: list[LRule] = field(default_factory=list)
    ignored: str = ""
    draws: Draws = field(default_factory=lambda: Draws(0))

    def derive(self, steps: int | None = None) -> list[Letter]:
        """Return the string after so many steps, by default the constant ``steps``."""
        count = int(self.constants.get("steps", 0)) if steps is None else steps
        string = [Letter(s, tuple(f(self.constants) for f in fs)) for s, fs in self.axiom]
        by_symbol: dict[str, list[LRule]] = {}
        for rule in self.rules:
            by_symbol.setdefault(rule.predecessor.symbol, []).append(rule)
        contexts = any(rule.left or rule.right for rule in self.rules)
        for _ in range(count):
            bearers, matches = _structure(string) if contexts else ([], [])
            out: list[Letter] = []
            for k, letter in enumerate(string):
                rules = by_symbol.get(letter.symbol)
                chosen = self._choose(rules, string, k, bearers, matches) if rules else None
                if chosen is None:
                    out.append(letter)
                    continue
                rule, names = chosen
                out += [Letter(s, tuple(f(names) for f in fs)) for s, fs in rule.successor]
            string = out
            if len(string) > MOST_MODULES:
                raise UsageError(f"the L-system grows beyond {MOST_MODULES:,} modules")
        return string

    def _choose(
        self,
        rules: Sequence[LRule],
        string: list[Letter],
        k: int,
        bearers: list[int],
        matches: list[int],
    ) -> tuple[LRule, dict[str, float]] | None:
        possible: list[tuple[LRule, dict[str, float], float]] = []
        for rule in rules:
            names = dict(self.constants)
            if not rule.predecessor.binds(string[k], names):
                continue
            if rule.left and not self._fits_left(rule.left, string, k, bearers, names):
                continue
            if rule.right and not self._fits_right(rule.right, string, k, matches, names):
                continue
            if rule.condition is not None and not rule.condition(names):
                continue
            if rule.probability is None:
                # A certain rule: the first that fits, unless a chance came before.
                if not possible:
                    return rule, names
                break
            possible.append((rule, names, rule.probability(names)))
        if not possible:
            return None
        # Probabilities that do not add up to 1 leave the rest to the module as it is.
        total = max(1.0, sum(p for _, _, p in possible))
        draw = self.draws.uniform() * total
        for rule, names, p in possible:
            draw -= p
            if draw < 0.0:
                return rule, names
        return None

    def _fits_left(
        self,
        patterns: tuple[Pattern, ...],
        string: list[Letter],
        k: int,
        bearers: list[int],
        names: dict[str, float],
    ) -> bool:
        at = bearers[k]
        for pattern in reversed(patterns):
            while at >= 0 and string[at].symbol in self.ignored:
                at = bearers[at]
            if at < 0 or not pattern.binds(string[at], names):
                return False
            at = bearers[at]
        return True

    def _fits_right(
        self,
        patterns: tuple[Pattern, ...],
        string: list[Letter],
        k: int,
        matches: list[int],
        names: dict[str, float],
    ) -> bool:
        at = k + 1
        for pattern in patterns:
            # Branches stand aside; the axis goes on behind them.
            while at < len(string) and (
                string[at].symbol == "[" or string[at].symbol in self.ignored
            ):
                at = matches[at] + 1 if string[at].symbol == "[" else at + 1
            if at >= len(string) or not pattern.binds(string[at], names):
                return False
            at += 1
        return True


def _structure(string: Sequence[Letter]) -> tuple[list[int], list[int]]:
    """Return what stands before every module on its path to the root, and where brackets end."""
    bearers, matches = [-1] * len(string), [len(string)] * len(string)
    stack: list[tuple[int, int]] = []
    last = -1
    for k, letter in enumerate(string):
        if letter.symbol == "[":
            stack.append((last, k))
        elif letter.symbol == "]":
            if stack:
                last, opened = stack.pop()
                matches[opened] = k
        else:
            bearers[k] = last
            last = k
    return bearers, matches


_RULE = re.compile(r"^(?P<head>.*?)->(?P<body>.*)$", re.DOTALL)


def read_lsystem(text: str, name: str = "<text>", seed: int = 0) -> LSystem:
    """Return the L-system of a text.

    Raises
    ------
    UsageError
        Every line that is not understood, with its number.
    """
    system = LSystem(draws=Draws(seed))
    problems: list[str] = []
    for number, raw in enumerate(text.splitlines(), 1):
        line = re.sub(r"//.*$", "", raw).strip()
        if not line:
            continue
        try:
            _read_line(system, line)
        except UsageError as error:
            problems.append(f"{name}:{number}: {error}\n  {number} | {raw.strip()}")
    if not problems and not system.axiom:
        problems.append(f"{name}: there is no line `axiom: ...`")
    if problems:
        raise UsageError("\n".join(problems))
    return system


def _read_line(system: LSystem, line: str) -> None:
    if line.startswith("#define"):
        parts = line.split(None, 2)
        if len(parts) != 3:
            raise UsageError("write `#define name value`")
        system.constants[parts[1]] = read_formula(parts[2], system.draws)(system.constants)
        return
    setting = re.match(r"^([a-z][a-z]+)\s*:(.*)$", line)
    if setting and "->" not in line:
        name, value = setting[1], setting[2].strip()
        if name == "axiom":
            system.axiom = _read_successor(value, system.draws)
        elif name == "ignore":
            system.ignored = value.replace(" ", "")
        else:
            system.settings[name] = value
        return
    match = _RULE.match(line)
    if not match:
        raise UsageError("expected a rule, `#define`, or a line `name: value`")
    system.rules.append(_read_rule(match["head"], match["body"], system.draws))


def _read_successor(text: str, draws: Draws) -> list[tuple[str, tuple[Formula, ...]]]:
    return [(s, tuple(read_formula(a, draws) for a in args)) for s, args in split_modules(text)]


def _read_rule(head: str, body: str, draws: Draws) -> LRule:
    fields = _split_colons(head)
    if len(fields) > 3:
        raise UsageError("a rule has a predecessor, a condition and a probability at most")
    left_text, middle, right_text = _split_context(fields[0])
    predecessors = _patterns(middle)
    if len(predecessors) != 1:
        raise UsageError("a rule rewrites exactly one module")
    condition = fields[1].strip() if len(fields) > 1 else ""
    chance = fields[2].strip() if len(fields) > 2 else ""
    successor = [] if body.strip() in ("", "*") else _read_successor(body, draws)
    return LRule(
        _patterns(left_text),
        predecessors[0],
        _patterns(right_text),
        None if condition in ("", "*") else read_formula(condition, draws),
        None if not chance else read_formula(chance, draws),
        tuple(successor),
    )


def _split_colons(text: str) -> list[str]:
    return text.split(":")


def _split_context(text: str) -> tuple[str, str, str]:
    left, less, rest = text.partition("<")
    if not less:
        left, rest = "", text
    middle, _greater, right = rest.partition(">")
    return left, middle, right


def _patterns(text: str) -> tuple[Pattern, ...]:
    return tuple(
        Pattern(symbol, tuple(a.strip() for a in args)) for symbol, args in split_modules(text)
    )
