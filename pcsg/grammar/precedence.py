"""Flat lists of operands and operators, combined by tables of precedence.

The parser leaves them flat, so that the nesting of parentheses costs little and the precedence of
the operators on solids stays where they are registered.
"""

from __future__ import annotations

from collections.abc import Sequence

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic
from pcsg.grammar.syntax import Combination, Solid
from pcsg.grammar.tokens import Token, join
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.operators import OPERATORS, SUM

COMPARISONS = frozenset({"<", "<=", ">", ">=", "==", "!="})

PRECEDENCE: dict[str, int] = {
    "or": 1,
    "and": 2,
    "not": 3,
    **dict.fromkeys(COMPARISONS, 4),
    "+": 5,
    "-": 5,
    "*": 6,
    "/": 6,
    "%": 6,
    "neg": 7,
    "^": 8,
}
"""How tight operators on numbers bind, as in Python; ``not`` and ``neg`` stand before one."""


class SyntaxFault(Exception):
    """A mistake that the tables of the parser do not find."""

    def __init__(self, problem: Diagnostic) -> None:
        self.problem = problem
        super().__init__(problem.message)


class Signed:
    """An operand behind signs that wait for it; the innermost sign stands first."""

    __slots__ = ("operand", "signs")

    def __init__(self, operand: Expr, signs: list[Token]) -> None:
        self.operand = operand
        self.signs = signs


Term = Expr | Signed


def combine_numbers(chain: Sequence[Term | Token]) -> Expr:
    """Return the expression of ``operand operator operand ...`` (Dijkstra's shunting yard)."""
    if len(chain) == 1 and isinstance(chain[0], Expr):
        return chain[0]
    values: list[Expr] = []
    pending: list[tuple[int, str, Token]] = []

    def reduce() -> None:
        _, name, token = pending.pop()
        last = values.pop()
        assert isinstance(last, (Number, Parameter, Apply)) and last.span is not None
        if name in ("neg", "not"):
            values.append(Apply(name, (last,), 0, join(token.span, last.span)))
            return
        first = values.pop()
        assert isinstance(first, (Number, Parameter, Apply)) and first.span is not None
        values.append(Apply(name, (first, last), 0, join(first.span, last.span)))

    for item in chain:
        if isinstance(item, Token):
            name = item.text
            level = PRECEDENCE[name]
            while pending and (pending[-1][0] > level or (pending[-1][0] == level and name != "^")):
                if name in COMPARISONS and pending[-1][1] in COMPARISONS:
                    raise SyntaxFault(_chained(item, pending[-1][2]))
                reduce()
            pending.append((level, name, item))
        elif isinstance(item, Signed):
            for sign in reversed(item.signs):
                name = "neg" if sign.type == "MINUS" else "not"
                level = PRECEDENCE[name]
                if name == "not" and pending and pending[-1][0] > level:
                    raise SyntaxFault(_hidden_not(sign, pending[-1][2]))
                pending.append((level, name, sign))
            values.append(item.operand)
        else:
            values.append(item)
    while pending:
        reduce()
    return values[0]


def _chained(operator: Token, before: Token) -> Diagnostic:
    return diagnose(
        "chained-comparison",
        "comparisons do not chain",
        operator.span,
        hint="write `a < b and b < c`",
        notes=[("the first comparison", before.span)],
    )


def _hidden_not(sign: Token, before: Token) -> Diagnostic:
    return diagnose(
        "needs-parentheses",
        f"`{sign.span.text}` behind `{before.span.text}` needs parentheses",
        sign.span,
        hint="write `(not a)`",
    )


def combine_solids(chain: Sequence[Solid | Token]) -> Solid:
    """Return the solid of ``operand operator operand ...``, flat where operators repeat."""
    items = list(chain)
    for item in items:
        if isinstance(item, Token) and item.type == "OPERATOR" and item.text != "+":
            message = f"`{item.span.text}` does not combine solids"
            raise SyntaxFault(diagnose("unexpected-token", message, item.span))
    for operator in sorted((*OPERATORS, SUM), key=lambda o: -o.precedence):
        if len(items) == 1:
            break
        merged: list[Solid | Token] = []
        run: list[Solid] = [_solid(items[0])]
        for k in range(1, len(items), 2):
            sign, operand = items[k], _solid(items[k + 1])
            assert isinstance(sign, Token)
            if _is(sign, operator.name):
                run.append(operand)
                continue
            merged += [_run(operator.name, run), sign]
            run = [operand]
        merged.append(_run(operator.name, run))
        items = merged
    return _solid(items[0])


def _is(sign: Token, name: str) -> bool:
    if sign.type == "OPERATOR":
        return name == "sum"
    return sign.type == name.upper() or (sign.type == "MINUS" and name == "difference")


def _solid(item: Solid | Token) -> Solid:
    assert not isinstance(item, Token)
    return item


def _run(name: str, operands: list[Solid]) -> Solid:
    if len(operands) == 1:
        return operands[0]
    operator = next(o for o in (*OPERATORS, SUM) if o.name == name)
    span = join(operands[0].span, operands[-1].span)
    return Combination(operator, tuple(operands), span)
