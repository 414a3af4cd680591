"""JSON whose values know where they stand, so that mistakes in a file can be shown in it."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from lark import Lark, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken
from lark.lexer import Token
from lark.tree import Meta

from pcsg.catalogue import diagnose
from pcsg.errors import GrammarError, Source, SourceSpan

_GRAMMAR = r"""
?value: record | row | TEXT | NUMBER | WORD
record: "{" [pair ("," pair)*] "}"
pair: TEXT ":" value
row: "[" [value ("," value)*] "]"
TEXT: /"([^"\\\x00-\x1f]|\\["\\\/bfnrt]|\\u[0-9a-fA-F]{4})*"/
NUMBER: /-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?/
WORD: "true" | "false" | "null"
%ignore /[ \t\r\n]+/
"""


DEEPEST = 40
"""Brackets within each other at most; species need five."""

_BRACKETS = re.compile(r'"(?:[^"\\\n]|\\.)*"|[][{}]')

LONGEST_INTEGER = 300
"""Digits of a whole number; longer ones are beyond all ranges, and infinite."""


@dataclass(frozen=True)
class Located:
    """A value of a file: a dict or list of located values, or text, a number, true, false, null.

    Attributes
    ----------
    value
        In a dict, keys are texts.
    span
        Where it stands.
    keys
        Where the keys of a dict stand.
    """

    value: Any
    span: SourceSpan
    keys: dict[str, SourceSpan]

    def plain(self) -> Any:
        """Return the value as plain Python data."""
        if isinstance(self.value, dict):
            return {k: v.plain() for k, v in self.value.items()}
        if isinstance(self.value, list):
            return [v.plain() for v in self.value]
        return self.value


def read_json(text: str, name: str) -> Located:
    """Return the value of a JSON text.

    Raises
    ------
    GrammarError
        Something else stands there.
    """
    source = Source(name, text)
    if (deep := _too_deep(text)) is not None:
        what = f"brackets within brackets, more than {DEEPEST}"
        span = SourceSpan(source, deep, deep + 1)
        raise GrammarError([diagnose("bad-species", what, span, expected="an object with keys")])
    try:
        tree = _parser().parse(text)
    except UnexpectedInput as e:
        raise GrammarError([_complain(source, e)]) from None
    found: Located = _Values(source).transform(tree)
    return found


def _too_deep(text: str) -> int | None:
    """Return the offset of a bracket that stands too deep; None if none does."""
    depth = 0
    for match in _BRACKETS.finditer(text):
        if match[0] in "{[":
            depth += 1
            if depth > DEEPEST:
                return match.start()
        elif match[0] in "}]":
            depth -= 1
    return None


@cache
def _parser() -> Lark:
    return Lark(_GRAMMAR, start="value", parser="lalr", propagate_positions=True)


def _complain(source: Source, error: UnexpectedInput) -> Any:
    expected = (
        "JSON: objects {...}, lists [...], texts in double quotes, numbers, true, false, null"
    )
    if isinstance(error, UnexpectedToken) and error.token.type != "$END":
        start = error.token.start_pos or 0
        end = start + max(1, len(error.token))
        what = f"`{error.token}` cannot stand here"
    elif isinstance(error, UnexpectedCharacters):
        start, end = error.pos_in_stream or 0, (error.pos_in_stream or 0) + 1
        what = f"`{source.text[start]}` cannot stand here"
    else:
        assert isinstance(error, UnexpectedToken | UnexpectedEOF)
        start = end = max(0, len(source.text.rstrip()) - 1)
        what = "the text ends before it is complete"
    return diagnose("bad-species", what, SourceSpan(source, start, end), expected=expected)


@v_args(meta=True)
class _Values(Transformer[Token, Located]):
    def __init__(self, source: Source) -> None:
        super().__init__(visit_tokens=True)
        self.source = source

    def _token(self, token: Token) -> Located:
        start = token.start_pos or 0
        return Located(json.loads(token), SourceSpan(self.source, start, start + len(token)), {})

    TEXT = WORD = _token

    def NUMBER(self, token: Token) -> Located:  # noqa: N802 -- the name of the terminal
        found = self._token if len(token) <= LONGEST_INTEGER else self._long_number
        return found(token)

    def _long_number(self, token: Token) -> Located:
        start = token.start_pos or 0
        return Located(float(token), SourceSpan(self.source, start, start + len(token)), {})

    def pair(self, _: Meta, children: list[Located]) -> tuple[Located, Located]:
        key, value = children
        return key, value

    def row(self, meta: Meta, children: list[Located | None]) -> Located:
        items = [c for c in children if c is not None]
        return Located(items, SourceSpan(self.source, meta.start_pos, meta.end_pos), {})

    def record(self, meta: Meta, children: list[Any]) -> Located:
        pairs = [c for c in children if c is not None]
        span = SourceSpan(self.source, meta.start_pos, meta.end_pos)
        values = {key.value: value for key, value in pairs}
        return Located(values, span, {key.value: key.span for key, _ in pairs})
