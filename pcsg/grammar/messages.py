"""What the parser expected, in words."""

from __future__ import annotations

from collections.abc import Set

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic
from pcsg.grammar.tokens import WORD_TYPES, Token

_ITEM_NAMES = {
    "axiom": "the axiom",
    "module": "the module declaration",
    "rule": "the rule",
    "attributed": "the rule",
    "definition": "the definition",
    "setting": "the setting",
}

# Groups of terminals that stand for one thing in the reader's mind, the larger first.
_GROUPS: tuple[tuple[str, frozenset[str]], ...] = (
    (
        "a solid",
        frozenset({"NAME", "PRIMITIVE", "TRANSFORM", "MIRROR", "ATTRIBUTE", "LBRACE", "LPAREN"}),
    ),
    ("a transformation or a block", frozenset({"TRANSFORM", "MIRROR", "ATTRIBUTE", "LBRACE"})),
    ("a number", frozenset({"NAME", "NUMBER", "CONSTANT", "LPAREN", "MINUS", "NOT"})),
    ("an operator", frozenset({"UNION", "INTERSECTION", "DIFFERENCE", "MINUS"})),
    ("an operator", frozenset({"OPERATOR", "MINUS"})),
    ("`,`", frozenset({"SEMICOLON", "COMMA", "RPAREN"})),
    ("`;`", frozenset({"SEMICOLON", "COMMA"})),
)

_TERMINALS = {
    "NAME": "a name",
    "NUMBER": "a number",
    "STRING": "a text in quotes",
    "KEY": "a key and `=`",
    "ELSE": "`else`",
    "LPAREN": "`(`",
    "RPAREN": "`)`",
    "LBRACE": "`{`",
    "RBRACE": "`}`",
    "COMMA": "`,`",
    "LIST_COMMA": "`,`",
    "SEMICOLON": "`;`",
    "COLON": "`:`",
    "ASSIGN": "`=`",
    "ARROW": "`->`",
    "$END": "the end of the item",
}

_RESERVED = {
    "PRIMITIVE": "a primitive",
    "TRANSFORM": "a transformation",
    "MIRROR": "a transformation",
    "ATTRIBUTE": "an attribute",
    "CONSTANT": "a constant",
    "OPERATOR": "an operator",
    "NOT": "an operator",
    "ELSE": "a word of the language",
}


def explain(kind: str, tokens: list[Token], at: int, accepts: Set[str], last: bool) -> Diagnostic:
    """Return the diagnostic of a syntax error.

    Parameters
    ----------
    kind
        The item's kind.
    tokens, at
        Its tokens, and the index of the one that does not fit; their number for the item's end.
    accepts
        Types that would have fitted.
    last
        Whether the file ends behind the item.
    """
    expected = _describe(accepts)
    item = _ITEM_NAMES[kind]
    if at >= len(tokens):
        message = f"{'the file' if last else item} ends behind `{_shown(tokens[-1])}`"
        hint = None
        if expected == "a solid" and tokens[-1].type == "RPAREN":
            hint = "transformations and attributes stand before their solid: `color(1,0,0) sphere`"
        return diagnose("unexpected-end", message, tokens[-1].span, expected=expected, hint=hint)
    token = tokens[at]
    if "NAME" in accepts and token.type in WORD_TYPES and _names_something(kind, tokens, at):
        message = f"`{token.text}` is reserved: it is {_RESERVED[token.type]}"
        return diagnose("reserved-name", message, token.span, hint="choose another name")
    return diagnose(
        "unexpected-token",
        f"unexpected `{_shown(token)}` in {item}",
        token.span,
        expected=expected,
        hint=_hint(kind, tokens, at),
    )


def _shown(token: Token) -> str:
    text = (token.origin or token).span.text
    text = " ".join(text.split())
    return text if len(text) <= 40 else text[:40] + "..."


def _names_something(kind: str, tokens: list[Token], at: int) -> bool:
    """Whether a reserved word stands where a name is given, rather than where one is used."""
    following = tokens[at + 1].type if at + 1 < len(tokens) else ""
    if following == "ASSIGN" or at == 0:
        return True
    if kind in ("rule", "attributed"):
        before = [t.type for t in tokens[:at]]
        return "ARROW" not in before and "COLON" not in before
    return tokens[at].type in ("TRANSFORM", "ATTRIBUTE", "MIRROR") and following != "LPAREN"


def _hint(kind: str, tokens: list[Token], at: int) -> str | None:
    token = tokens[at]
    if token.type == "ARROW" and kind == "axiom":
        return "a rule begins with its number: `1: S -> ...`"
    if token.type == "ASSIGN":
        return "to compare, write `==`"
    if token.type == "NUMBER" and at + 1 < len(tokens) and tokens[at + 1].text == "*":
        return f"to repeat a solid, write `repeat({_shown(token)}, move(1,0,0) rotz(36)) box`"
    if kind == "setting" and token.type in WORD_TYPES | {"NUMBER"}:
        return "put `;` between two keys"
    return None


def _describe(accepts: Set[str]) -> str | None:
    """Return the types that would have fitted, in words."""
    left = set(accepts)
    words: list[str] = []
    for name, group in _GROUPS:
        if group <= left or (name == "a number" and group <= set(accepts)):
            words.append(name)
            left -= group - {"RPAREN"}
    words += sorted(_TERMINALS[t] for t in left if t in _TERMINALS)
    words = list(dict.fromkeys(words))
    if not words:
        return None
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " or " + words[-1]
