"""Lexers for Pygments: documentation, notebooks, terminals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

from pygments.lexer import Lexer, RegexLexer, bygroups, words
from pygments.token import (
    Comment,
    Error,
    Keyword,
    Name,
    Number,
    Operator,
    Punctuation,
    String,
    Text,
    Whitespace,
)

from pcsg.blobtree.formulas import FUNCTIONS
from pcsg.blobtree.plantsettings import SETTINGS
from pcsg.errors import Source
from pcsg.grammar.tokens import BETWEEN, Token, tokenize, unfold_all

_TYPES: dict[str, Any] = {
    "setting": Keyword.Declaration,
    "loop": Keyword,
    "function": Name.Function,
    "blend": Name.Builtin,
    "transformation": Name.Builtin,
    "attribute": Name.Decorator,
    "primitive": Name.Class,
    "constant": Keyword.Constant,
    "global": Name.Variable.Global,
    "operator": Operator.Word,
    "name": Name,
    "number": Number,
    "string": String,
    "directive": Comment.Preproc,
    "label": Name.Label,
    "error": Error,
}
_BRACKETS = frozenset("(){},;")


class PcsgLexer(Lexer):  # type: ignore[misc]  # Pygments ships no types
    """Grammars of pcsg, cut by the tokens of the language itself."""

    name = "pcsg"
    aliases: ClassVar = ["pcsg"]
    filenames: ClassVar = ["*.pcsg"]
    mimetypes: ClassVar = ["text/x-pcsg"]
    url = "https://pypi.org/project/pcsg-raytracer/"

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Any, str]]:
        """Yield offset, type and text of every piece."""
        from pcsg.editors.vocabulary import kinds_of

        tokens = unfold_all(tokenize(Source("<text>", text))[0])
        at = 0
        for token, kind in zip(tokens, kinds_of(tokens), strict=True):
            yield from _between(text, at, token.start)
            written = text[token.start : token.end]
            yield token.start, _type_of(token, kind, written), written
            at = token.end
        yield from _between(text, at, len(text))


def _type_of(token: Token, kind: str, written: str) -> Any:
    if kind == "sign":
        return Punctuation if written in _BRACKETS or token.type == "ARROW" else Operator
    return _TYPES[kind]


def _between(text: str, start: int, end: int) -> Iterator[tuple[int, Any, str]]:
    """Yield comments, blanks, and what is not cut because the text is too long."""
    at = start
    for match in BETWEEN.finditer(text, start, end):
        if match.start() > at:
            yield at, Text, text[at : match.start()]
        comment = Comment.Multiline if match[0].startswith("/*") else Comment.Single
        yield match.start(), comment if match.lastgroup == "COMMENT" else Whitespace, match[0]
        at = match.end()
    if at < end:
        yield at, Text, text[at:end]


class LsysLexer(RegexLexer):  # type: ignore[misc]  # likewise
    """L-systems of pcsg, in the notation of cpfg."""

    name = "L-system"
    aliases: ClassVar = ["lsys"]
    filenames: ClassVar = ["*.lsys"]
    mimetypes: ClassVar = ["text/x-lsys"]
    url = "https://pypi.org/project/pcsg-raytracer/"

    tokens: ClassVar = {
        "root": [
            (r"\s+", Whitespace),
            (r"//[^\n]*", Comment.Single),
            (r"/\*[\s\S]*?\*/", Comment.Multiline),
            (r"(#\s*define)([ \t]+)(\w+)", bygroups(Comment.Preproc, Whitespace, Name.Constant)),
            (r"(lsystem|endlsystem)\b", Comment.Preproc),
            (
                r"(?m)^([ \t]*)(axiom|\u03c9|module|ignore|consider|production|decomposition"
                r"|interpretation|homomorphism|" + "|".join(SETTINGS) + r")([ \t]*)(:)",
                bygroups(Whitespace, Keyword.Declaration, Whitespace, Punctuation),
            ),
            (words(sorted(FUNCTIONS), suffix=r"(?=\s*\()"), Name.Function),
            (r"-{1,2}>|={1,2}>", Punctuation),
            (r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", Number),
            (r"[(){},;:]", Punctuation),
            (r"[<>=!]=|&&|\|\||[-+*/^%<>!&|\\\[\]$'.\u2192]", Operator),
            (r"[^\W\d]\w*", Name),
            (r".", Text),
        ]
    }
