"""From characters to tokens, each with its place.

The types of words come from the registries of transformations, attributes and primitives.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, Source, SourceSpan
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.operators import OPERATORS
from pcsg.graph.transforms import TRANSFORMS
from pcsg.graph.words import MARKS, WORD, normal
from pcsg.growth import leaf as _growing_trees  # noqa: F401 -- registers its words
from pcsg.leaf import LEAF_NAMES

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "e": math.e, "true": 1.0, "false": 0.0}


class Token:
    """A word, a number, a sign; or numbers in parentheses, one token behind the word they are for.

    Attributes
    ----------
    type
        Name of the terminal in the grammar.
    text
        Its canonical spelling.
    source, start, end
        Where it stands; for what a macro has replaced, where the macro stands.
    line
        Number of its line, not counting lines that end inside a comment.
    first, gap
        Whether it is the first on its line; whether a blank stands before it.
    origin
        For what a macro has replaced, the token in the macro's body.
    places
        The macros that stand within one another there, the outermost first.
    """

    __slots__ = (
        "end",
        "first",
        "gap",
        "line",
        "origin",
        "places",
        "source",
        "start",
        "text",
        "type",
    )

    def __init__(
        self, kind: str, text: str, source: Source, start: int, end: int, line: int = 0
    ) -> None:
        self.type = kind
        self.text = text
        self.source = source
        self.start = start
        self.end = end
        self.line = line
        self.first = False
        self.gap = False
        self.origin: Token | None = None
        self.places: tuple[SourceSpan, ...] = ()

    @property
    def span(self) -> SourceSpan:
        """Its place in the text, with those in the bodies of macros."""
        if self.origin is None:
            return SourceSpan(self.source, self.start, self.end)
        body = self.origin.span
        for place in reversed(self.places[1:]):
            body = SourceSpan(place.source, place.start, place.end, body)
        return SourceSpan(self.source, self.start, self.end, body)

    @property
    def size(self) -> int:
        """What it counts for where tokens are limited: the numbers in it count, too."""
        return 2 + self.text.count(",") if self.type == "LITERALS" else 1

    def copy_to(self, use: Token, places: tuple[SourceSpan, ...]) -> Token:
        """Return a copy that stands where a macro is used."""
        copy = Token(self.type, self.text, use.source, use.start, use.end, use.line)
        copy.origin, copy.places = self, places
        copy.gap = self.gap
        return copy


def span_of(first: Token, last: Token) -> SourceSpan:
    """Return the span from the start of one token to the end of another behind it."""
    if first.origin is None and last.origin is None:
        return SourceSpan(first.source, first.start, max(first.end, last.end))
    return join(first.span, last.span)


def join(a: SourceSpan, b: SourceSpan) -> SourceSpan:
    """Return the span from the start of one to the end of another behind it."""
    if a.start == b.start and a.end == b.end:
        # Both come from one use of a macro, or are the same.
        if a.body is None or b.body is None or a.body.source is not b.body.source:
            return a
        first, last = a.body, b.body
        body = SourceSpan(first.source, first.start, max(first.end, last.end), first.body)
        return SourceSpan(a.source, a.start, a.end, body)
    return SourceSpan(a.source, a.start, max(a.end, b.end))


_SYMBOLS: dict[str, tuple[str, str]] = {
    "(": ("LPAREN", "("),
    ")": ("RPAREN", ")"),
    "{": ("LBRACE", "{"),
    "}": ("RBRACE", "}"),
    ",": ("COMMA", ","),
    ";": ("SEMICOLON", ";"),
    ":": ("COLON", ":"),
    "=": ("ASSIGN", "="),
    "->": ("ARROW", "->"),
    "\u2192": ("ARROW", "->"),
    "!": ("NOT", "not"),
    "&&": ("OPERATOR", "and"),
    "||": ("OPERATOR", "or"),
    "#": ("HASH", "#"),
    **{s: ("OPERATOR", s) for s in ("+", "*", "/", "%", "^", "==", "!=", "<", "<=", ">", ">=")},
    **{
        sign: (operator.name.upper(), operator.symbols[0])
        for operator in OPERATORS
        for sign in operator.symbols
    },
    # The one sign that is an operator on numbers and on solids.
    "-": ("MINUS", "-"),
}

TAKES_LITERALS = frozenset({"NAME", "PRIMITIVE", "TRANSFORM", "ATTRIBUTE"})
"""Types of words that may have numbers in parentheses, which are one token, right behind them."""

MOST_LITERALS = 32
"""Most numbers in one token; longer lists come as one token for each number and sign."""

_NUMBER = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
# What is too large for a number, and told as such, is none of these.
_LITERAL = r"[ \t]*-?(?:[0-9]{1,99}(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,2})?[ \t]*"
_IN_LITERALS = re.compile(rf"[(),-]|{_NUMBER}")

_BETWEEN = r"""
    (?P<NEWLINE>\n)
    | (?P<BLANK>[ \t\r\f\v]+)
    | (?P<COMMENT>//[^\n]* | /\*[\s\S]*?\*/)
"""

BETWEEN = re.compile(_BETWEEN, re.VERBOSE)
"""What may stand between tokens: the end of a line, blanks, a comment."""

_PATTERN = re.compile(
    _BETWEEN
    + r"""
    | (?P<OPEN_COMMENT>/\*)
    | (?P<WORD>"""
    + WORD
    + rf""")(?P<LITERALS>\({_LITERAL}(?:,{_LITERAL}){{0,{MOST_LITERALS - 1}}}\))?
    | (?P<NUMBER>{_NUMBER})
    | (?P<STRING>"[^"\n]*")
    | (?P<OPEN_STRING>"[^"\n]*)
    | (?P<SYMBOL>"""
    + "|".join(re.escape(s) for s in sorted(_SYMBOLS, key=len, reverse=True))
    + r""")
    | (?P<STRAY>[\s\S])
    """,
    re.VERBOSE,
)
_WORD_TAIL = re.compile(rf"(?:[\w.]|[{MARKS}])+")

_LOOKALIKES = {
    "\u2212": "-",
    "\u2013": "-",
    "\u00d7": "*",
    "\u00b7": "*",
    "\u2264": "<=",
    "\u2265": ">=",
    "\u2260": "!=",
    "\u201c": '"',
    "\u201d": '"',
    "\u00a0": " ",
    "[": "(",
    "]": ")",
    "~": "not",
}


def words() -> dict[str, tuple[str, str]]:
    """Return the type and the canonical spelling of every reserved word."""
    found = {name: ("PRIMITIVE", name) for name, leaf in LEAF_NAMES.items() if not leaf.soft}
    found |= {name: ("ATTRIBUTE", name) for name in ATTRIBUTES}
    for name, transform in TRANSFORMS.items():
        found[name] = ("TRANSFORM" if transform.parameters else "MIRROR", name)
    found |= {name: ("CONSTANT", name) for name in CONSTANTS}
    found |= {name: ("OPERATOR", name) for name in ("and", "or")}
    return found | {"not": ("NOT", "not"), "else": ("ELSE", "else")}


MAX_TOKENS = 1_700_000
"""Most tokens of a file, `Token.size` added up: a hundred thousand solids with colours and places.

Reading them takes up to ten seconds, and less than a gigabyte."""

LOOPS = {"for": "FOR", "repeat": "REPEAT", "scatter": "SCATTER"}
"""Names that stand for a loop where a solid may, before `(`, and their types there."""

TEXTUAL = frozenset(name for name, leaf in LEAF_NAMES.items() if leaf.soft and leaf.constants)
"""Primitives whose names are free for others, and which are known by a text behind `(`."""

WORD_TYPES = frozenset({"NAME", *LOOPS.values(), *(kind for kind, _ in words().values())})
"""Types that a word can have."""


def tokenize(source: Source) -> tuple[list[Token], list[Diagnostic]]:
    """Cut a text into tokens.

    Returns
    -------
    tokens, diagnostics
        Comments are gone. Where a character cannot be used a token of type ``STRAY`` stands, so
        that the item around it is known to be broken. Of a text that is too long there are none.
    """
    tokens: list[Token] = []
    problems: list[Diagnostic] = []
    reserved = words()
    room = MAX_TOKENS
    line = 1
    line_of_last = 0
    after = 0  # end of the last token
    stray_end = -1
    for match in _PATTERN.finditer(source.text):
        kind = match.lastgroup
        if kind == "BLANK" or kind == "COMMENT":
            continue
        if kind == "NEWLINE":
            line += 1
            continue
        start, end = match.span(match.lastgroup)  # type: ignore[arg-type]  # there is one
        text = source.text[start:end]
        literals = None
        if kind == "LITERALS":
            literals = Token(kind, text, source, start, end, line)
            kind = "WORD"
            start, end = match.span(kind)
            text = source.text[start:end]
        if start < after:  # the tail of a bad number
            if literals is not None and end == after:
                room -= literals.size
                tokens += unfold(literals)
                after = literals.end
            continue
        if kind == "WORD":
            text = normal(text)
            kind, text = reserved.get(text, ("NAME", text))
            if not text.isidentifier():  # superscripts and the like count as letters there
                # If each may stand in a name, the first cannot begin one: a digit of some script.
                each = ((k, source.text[k]) for k in range(start, end))
                bad = next((k for k, sign in each if not f"a{sign}".isidentifier()), start)
                problems.append(_stray(source, bad, bad + 1))
                kind = "STRAY"
        elif kind == "SYMBOL":
            kind, text = _SYMBOLS[text]
        elif kind == "NUMBER":
            tail = _WORD_TAIL.match(source.text, end)
            if tail or math.isinf(float(text)):
                kind, end = "STRAY", tail.end() if tail else end
                span = SourceSpan(source, start, end)
                shown = span.text if len(span.text) <= 40 else span.text[:40] + "..."
                problem = "is too large" if not tail else "is not a number"
                problems.append(diagnose("bad-number", f"`{shown}` {problem}", span))
        elif kind == "STRAY":
            if stray_end != start:
                problems.append(_stray(source, start, end))
            stray_end = end
        elif kind == "OPEN_COMMENT":
            kind = "STRAY"
            span = SourceSpan(source, start, end)
            problems.append(
                diagnose("unexpected-end", "the comment never ends", span, expected="`*/`")
            )
            end = len(source.text)
        elif kind == "OPEN_STRING":
            kind = "STRAY"
            span = SourceSpan(source, start, end)
            problems.append(diagnose("unexpected-end", "the text never ends", span, expected='`"`'))
        token = Token(kind or "", text, source, start, end, line)
        token.first = line != line_of_last
        token.gap = start > after
        line_of_last = line
        after = end
        tokens.append(token)
        room -= 1
        if literals is not None:
            room -= literals.size
            tokens += (literals,) if kind in TAKES_LITERALS else unfold(literals)
            after = literals.end
        if room < 0:
            told = f"`{source.name}` has more than {MAX_TOKENS:,} words, numbers and signs"
            span = SourceSpan(source, start, end)
            hint = "let modules repeat what is alike"
            return [], [diagnose("file-too-large", told, span, hint=hint)]
    return tokens, problems


def unfold(token: Token) -> list[Token]:
    """Return numbers in parentheses, which are one token, as a token for each number and sign."""
    if token.origin is not None:
        return [part.copy_to(token, token.places) for part in unfold(token.origin)]
    tokens: list[Token] = []
    after = token.start
    for match in _IN_LITERALS.finditer(token.text):
        text = match.group()
        kind, text = _SYMBOLS.get(text, ("NUMBER", text))
        start = token.start + match.start()
        part = Token(kind, text, token.source, start, start + len(text), token.line)
        part.gap = start > after
        after = part.end
        tokens.append(part)
    return tokens


def unfold_all(tokens: Iterable[Token]) -> list[Token]:
    """Return a token for each number and sign in place of those that hold several."""
    return [part for t in tokens for part in (unfold(t) if t.type == "LITERALS" else (t,))]


def _stray(source: Source, start: int, end: int) -> Diagnostic:
    character = source.text[start]
    shown = f"`{character}`" if character.isprintable() else f"U+{ord(character):04X}"
    instead = _LOOKALIKES.get(character)
    return diagnose(
        "stray-character",
        f"stray character {shown}",
        SourceSpan(source, start, end),
        hint=f"write `{instead}`" if instead else None,
    )
