"""Setting a grammar in order: blanks, ends of lines, empty lines.

Where lines begin and end, how they are indented, and two blanks or more within a line are its
author's: operands stand below one another, values and comments in columns. What is left to do is
small, and never changes what the file says: the tokens and the comments before and after are the
same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pcsg.errors import GrammarError, Source
from pcsg.grammar.items import mark_words
from pcsg.grammar.tokens import BETWEEN, WORD_TYPES, Token, tokenize, unfold_all
from pcsg.graph.settings import SETTINGS

TAB = 4
"""A tab goes on to the next multiple of this many columns."""

EMPTY_LINES = 2
"""Most empty lines in a row."""

_BLANKS = " \t\r\f\v"

_OPERANDS = (WORD_TYPES | {"BLOB", "BLEND"}) - {"OPERATOR", "NOT", "ELSE"}
_OPEN_BRACES = frozenset({"LBRACE", "FOPEN"})
_CLOSE_BRACES = frozenset({"RBRACE", "FCLOSE"})
_CLOSES = _CLOSE_BRACES | {"RPAREN"}
_OPENS = _OPEN_BRACES | {"LPAREN"}
_SEPARATORS = frozenset({"COMMA", "SEMICOLON"})
_APART = frozenset({"ARROW", "UNION", "INTERSECTION", "DIFFERENCE"})
_ALIKE = frozenset({"OPERATOR", "MINUS", "ASSIGN"})
_ENDS_OPERAND = _OPERANDS | _CLOSES | {"NUMBER", "STRING"}
_STARTS_OPERAND = _OPERANDS | _OPENS | {"NUMBER", "STRING", "MINUS", "NOT"}


@dataclass(slots=True)
class _Piece:
    """A token, a comment or the end of a line.

    Attributes
    ----------
    text
        As it is written; a newline for the end of a line.
    blanks
        Columns between it and what stands before it on its line.
    token
        None for all else.
    """

    text: str
    blanks: int
    token: Token | None = None


def format_text(source: Source) -> str:
    """Return a grammar's text in order.

    Raises
    ------
    GrammarError
        It cannot be cut into tokens: a stray character, a comment that never ends.
    """
    tokens, problems = tokenize(source)
    if problems:
        raise GrammarError(problems)
    tokens = unfold_all(tokens)
    pieces = _pieces_of(source.text, tokens)
    mark_words(tokens)
    _space(pieces, _roomy_signs(tokens))
    return _join(pieces)


def _pieces_of(text: str, tokens: Sequence[Token]) -> list[_Piece]:
    """Return all that a text holds but blanks, which are measured."""
    pieces: list[_Piece] = []
    column = blanks = at = 0

    def add(written: str, token: Token | None) -> None:
        nonlocal column, blanks
        pieces.append(_Piece(written, blanks, token))
        column, blanks = _column_behind(written, column), 0

    for token in (*tokens, None):
        for match in BETWEEN.finditer(text, at, token.start if token else len(text)):
            if match.lastgroup == "BLANK":
                behind = _column_behind(match[0], column)
                blanks, column = blanks + behind - column, behind
            else:
                add(match[0], None)
        if token is not None:
            add(text[token.start : token.end], token)
            at = token.end
    return pieces


def _column_behind(text: str, column: int) -> int:
    """Return the column behind a text that begins at a column."""
    before, newline, last = text.rpartition("\n")
    column = 0 if newline else column
    for sign in last if newline else before + last:
        column += TAB - column % TAB if sign == "\t" else 1
    return column


def _roomy_signs(tokens: Sequence[Token]) -> set[Token]:
    """Return the braces of settings and of fields, and the commas between fields."""
    found: set[Token] = set()
    open_signs: list[Token] = []
    for i, token in enumerate(tokens):
        if token.type in _OPENS:
            open_signs.append(token)
            named = {t.text for t in tokens[max(0, i - 2) : i] if t.type in WORD_TYPES}
            is_setting = token.type == "LBRACE" and named & SETTINGS.keys()
            if token.type == "FOPEN" or is_setting:
                found.add(token)
        elif token.type in _CLOSES and open_signs:
            if open_signs.pop() in found:
                found.add(token)
        elif token.type == "COMMA" and open_signs and open_signs[-1].type == "FOPEN":
            found.add(token)
    return found


def _space(pieces: Sequence[_Piece], roomy: set[Token]) -> None:
    """Put the blanks between pieces of a line in order."""
    for k, piece in enumerate(pieces):
        before = pieces[k - 1] if k else None
        if before is None or before.text == "\n" or piece.text == "\n" or piece.blanks > 1:
            continue
        a, b = before.token, piece.token
        if b is None:
            piece.blanks = 1 if piece.text.startswith("//") else piece.blanks
        elif a is None:
            continue  # behind a comment
        elif b.type in _SEPARATORS or (b.type == "COLON" and a.first and a.type not in _CLOSES):
            piece.blanks = piece.blanks if b in roomy else 0
        elif _stand_apart(a, b, roomy):
            piece.blanks = 1
    for k in range(1, len(pieces) - 1):
        before, operator, behind = pieces[k - 1 : k + 2]
        if _is_binary(before.token, operator.token, behind.token) and (
            operator.blanks or behind.blanks
        ):
            operator.blanks = max(operator.blanks, 1)
            behind.blanks = max(behind.blanks, 1)


def _stand_apart(a: Token, b: Token, roomy: set[Token]) -> bool:
    """Return whether a blank has to stand between two tokens."""
    if a.type in _APART or b.type in _APART or a.type == "COLON":
        return True
    if a.type == "SEMICOLON" and b not in roomy:
        return b.type not in _CLOSES
    if (a in roomy and a.type in _OPEN_BRACES) or (b in roomy and b.type in _CLOSE_BRACES):
        return a.type not in _OPEN_BRACES or b.type not in _CLOSE_BRACES
    if a.type in _CLOSES or a.type == "STRING":
        return b.type in _OPERANDS or b.type in _OPENS or b.type in ("NUMBER", "STRING")
    # A blank between a name and `(` may mean something: it stays as it is.
    return a.type in _OPERANDS and (b.type in _OPEN_BRACES or b.type == "STRING")


def _is_binary(before: Token | None, operator: Token | None, behind: Token | None) -> bool:
    """Return whether a sign stands between two operands, where both its sides look alike."""
    return (
        before is not None
        and operator is not None
        and behind is not None
        and operator.type in _ALIKE
        and not operator.text.isalpha()  # `and`, `or`
        and before.type in _ENDS_OPERAND
        and behind.type in _STARTS_OPERAND
    )


def _join(pieces: Sequence[_Piece]) -> str:
    """Return the text of pieces, without blanks at ends of lines."""
    lines: list[str] = []
    line = ""
    for piece in (*pieces, _Piece("\n", 0)):
        if piece.text == "\n":
            lines.append(line)
            line = ""
            continue
        whole = " " * piece.blanks + "\n".join(p.rstrip(_BLANKS) for p in piece.text.split("\n"))
        line += whole
    kept: list[str] = []
    empty = 0
    for line in lines:
        empty = 0 if line else empty + 1
        if line or (kept and empty <= EMPTY_LINES):
            kept.append(line)
    while kept and not kept[-1]:
        kept.pop()
    return "\n".join([*kept, ""]) if kept else ""
