"""Numbers in parentheses that are one token: what they stand for."""

from __future__ import annotations

from itertools import pairwise

from pcsg.errors import SourceSpan
from pcsg.grammar.tokens import Token, join, unfold
from pcsg.graph.expr import Number


def numbers_of(token: Token) -> tuple[Number, ...]:
    """Return the numbers of a token of type ``LITERALS``, each with its place."""
    if token.origin is not None:
        return _one_by_one(unfold(token))
    source, at = token.source, token.start + 1
    numbers: list[Number] = []
    for piece in token.text[1:-1].split(","):
        behind = at + len(piece)
        span = SourceSpan(source, behind - len(piece.lstrip()), at + len(piece.rstrip()))
        numbers.append(Number(float(piece), span))
        at = behind + 1
    return tuple(numbers)


def _one_by_one(parts: list[Token]) -> tuple[Number, ...]:
    """Return the numbers of signs and numbers that come from the body of a macro."""
    numbers: list[Number] = []
    for before, part in pairwise(parts):
        if part.type == "NUMBER" and before.type == "MINUS":
            numbers.append(Number(-float(part.text), join(before.span, part.span)))
        elif part.type == "NUMBER":
            numbers.append(Number(float(part.text), part.span))
    return tuple(numbers)
