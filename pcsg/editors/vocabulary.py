"""The words of the language by kind, from the registries, and what each token of a text is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from pcsg.grammar.check import CALLABLE
from pcsg.grammar.fields import FIELD_BLENDS, FIELD_PRIMITIVES, FIELD_UNARY
from pcsg.grammar.tokens import LOOPS, WORD_TYPES, Token, words
from pcsg.graph.graph import GLOBALS
from pcsg.graph.settings import SETTINGS
from pcsg.leaf import LEAF_NAMES

KINDS: Mapping[str, str] = {
    "setting": "before a brace, perhaps with a name between",
    "loop": "before a bracket",
    "function": "before a bracket",
    "blend": "before a brace or a bracket",
    "transformation": "",
    "attribute": "",
    "primitive": "",
    "constant": "",
    "global": "",
    "operator": "",
}
"""Kinds of words, and where words of that kind stand; elsewhere they are names."""


@cache
def vocabulary() -> Mapping[str, tuple[str, ...]]:
    """Return the words of each kind in alphabetical order; a word may have several kinds."""
    reserved = words()

    def of_types(*types: str) -> list[str]:
        return [word for word, (kind, _) in reserved.items() if kind in types]

    found = {
        "setting": list(SETTINGS),
        "loop": list(LOOPS),
        "function": [*CALLABLE, "hsv", "palette"],
        "blend": list(FIELD_BLENDS),
        "transformation": [*of_types("TRANSFORM", "MIRROR"), *FIELD_UNARY],
        "attribute": of_types("ATTRIBUTE"),
        "primitive": [*LEAF_NAMES, *FIELD_PRIMITIVES],
        "constant": of_types("CONSTANT"),
        "global": list(GLOBALS),
        "operator": of_types("OPERATOR", "NOT", "ELSE"),
    }
    return {kind: tuple(sorted(set(found[kind]))) for kind in KINDS}


def kinds_of(tokens: Sequence[Token]) -> Iterator[str]:
    """Yield what each token is.

    Yields
    ------
    str
        A kind of words, ``name``, ``number``, ``string``, ``sign``, ``directive`` for ``#`` and the
        word behind it, ``label`` for the number or the name of a rule, ``error``.
    """
    known = vocabulary()
    for i, token in enumerate(tokens):
        following = tokens[i + 1].type if i + 1 < len(tokens) else ""
        if token.type == "STRAY":
            yield "error"
        elif token.type == "HASH" or (i and tokens[i - 1].type == "HASH"):
            yield "directive"
        elif token.type == "LITERALS" or token.type == "NUMBER":
            yield "label" if following == "COLON" and token.first else "number"
        elif token.type == "STRING":
            yield "string"
        elif token.type not in WORD_TYPES or not is_word(token):
            yield "sign"
        elif following == "COLON" and token.first:
            yield "label"
        else:
            behind = tokens[i + 2].type if i + 2 < len(tokens) else ""
            is_name = following in WORD_TYPES and behind == "LBRACE"
            bracket = following in ("LPAREN", "LITERALS")
            places = {
                "setting": following == "LBRACE" or is_name,
                "loop": bracket,
                "function": bracket,
                "blend": bracket or following == "LBRACE",
            }
            kinds = (k for k in KINDS if places.get(k, True) and token.text in known[k])
            yield next(kinds, "name")


def is_word(token: Token) -> bool:
    """Return whether a token is written as a word: `and` is one, `&&` is not."""
    sign = token.source.text[token.start]
    return sign == "_" or sign.isalpha()
