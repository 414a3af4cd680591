"""Heads of an L-system's rules: contexts, conditions, names and probabilities."""

from __future__ import annotations

import re
from collections.abc import Iterable

from pcsg.blobtree.lsystem import Pattern
from pcsg.blobtree.signs import plain_digits, string_signs
from pcsg.blobtree.strings import split_at_top, split_modules
from pcsg.errors import UsageError

LABEL = re.compile(r"^\s*p\d+\s*:(?=.)")
"""What books number rules by."""


def said(fields: list[str], k: int) -> str:
    """Return a field of a rule's head, empty for none."""
    text = fields[k].strip() if len(fields) > k else ""
    return "" if text == "*" else text


def split_probability(body: str) -> tuple[str, str]:
    """Return a successor and the probability behind it, which other programs write there."""
    parts = split_at_top(body, ":")
    if len(parts) > 2:
        raise UsageError("a rule has one `:` at most behind its arrow, before the probability")
    return parts[0].strip(), parts[1].strip() if len(parts) == 2 else ""


def split_context(text: str) -> tuple[str, str, str]:
    """Return left context, predecessor and right context; signs in numbers do not count."""
    parts = split_at_top(text, "<")
    left, rest = ("", parts[0]) if len(parts) == 1 else (parts[0], "<".join(parts[1:]))
    middle, *right = split_at_top(rest, ">")
    return left, middle, ">".join(right)


def check_brackets(right: tuple[Pattern, ...]) -> None:
    """Require that the brackets of a right context match.

    Raises
    ------
    UsageError
        They do not.
    """
    depth = 0
    for pattern in right:
        depth += {"[": 1, "]": -1}.get(pattern.symbol, 0)
        if depth < 0:
            break
    if depth:
        raise UsageError("the brackets of the right context do not match")


def bound_names(patterns: Iterable[Pattern]) -> frozenset[str]:
    """Return the names that a head gives to numbers, which must differ."""
    found: set[str] = set()
    for pattern in patterns:
        for name in pattern.names:
            if name in found and name.isidentifier():
                raise UsageError(f"`{name}` names two numbers of the rule's head")
            found.add(name)
    return frozenset(found)


def symbols_of(head: str, words: Iterable[str]) -> set[str]:
    """Return the modules that a rule's head names; none if it cannot be read."""
    try:
        context = " ".join(split_context(LABEL.sub("", plain_digits(head)).split(":")[0]))
        return {symbol for symbol, _ in split_modules(string_signs(context), words)}
    except UsageError:
        return set()
