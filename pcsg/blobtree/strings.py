"""Strings of modules in texts of L-systems: characters, their numbers, where comments begin."""

from __future__ import annotations

import re
from collections.abc import Iterable

from pcsg.blobtree.formulas import Draws, read_formula
from pcsg.blobtree.signs import number_signs
from pcsg.errors import UsageError

MOST_NUMBERS = 50
"""Numbers of a module at most."""

_SLASHES = re.compile(r"/{2,}")


def split_modules(text: str, words: Iterable[str] = ()) -> list[tuple[str, list[str]]]:
    """Return the modules of a string, each with the texts of its numbers.

    Parameters
    ----------
    words
        Names of modules with several letters; all others are characters.

    Raises
    ------
    UsageError
        A parenthesis has no partner or no module.
    """
    out: list[tuple[str, list[str]]] = []
    # Of two that begin alike the longer one is meant.
    named = sorted(words, key=len, reverse=True)
    k = 0
    while k < len(text):
        symbol = next((word for word in named if text.startswith(word, k)), text[k])
        k += len(symbol)
        if symbol.isspace():
            continue
        args: list[str] = []
        # Between a module and its numbers there is no blank.
        if k < len(text) and text[k] == "(" and symbol not in "[]()":
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
            if len(args) > MOST_NUMBERS:
                raise UsageError(f"`{symbol}` has more than {MOST_NUMBERS} numbers")
        elif symbol in "()":
            raise UsageError(f"stray `{symbol}`; numbers stand behind their module without a blank")
        out.append((symbol, args))
    return out


def split_at_top(text: str, sign: str) -> list[str]:
    """Return the parts of a text between signs that stand in no parentheses."""
    parts, depth, start = [], 0, 0
    for k, character in enumerate(text):
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == sign and depth <= 0:
            parts.append(text[start:k])
            start = k + 1
    return [*parts, text[start:]]


def before_comment(text: str) -> str:
    """Return what stands before a comment where slashes mean nothing else."""
    return text.partition("//")[0]


def cut_comment(text: str, known: set[str]) -> tuple[str, str]:
    """Return a string of modules without its comment, and what is in doubt about it.

    In a string ``//`` are two rolls. Two slashes, no more, with a blank before or behind begin a
    comment unless all that follows could be modules of this L-system.

    Parameters
    ----------
    known
        The turtle's commands, and what rules rewrite or look for.
    """
    for match in _SLASHES.finditer(text):
        before, rest = text[: match.start()], text[match.end() :]
        apart = not before or before[-1].isspace()
        if len(match[0]) != 2 or before.count("(") > before.count(")"):
            continue
        if not (apart or not rest or rest[0].isspace()):
            continue
        if _could_be_modules(rest, known):
            if apart and (not rest or rest[0].isspace()):
                return text, "`//` is two rolls here; write `/ /`, or a comment on its own line"
            continue
        doubt = "" if apart else "`//` begins a comment here; for two rolls write `/ /`"
        return before, doubt
    return text, ""


def _could_be_modules(text: str, known: set[str]) -> bool:
    try:
        # Numbers directly behind belong to the last slash.
        words = [name for name in known if len(name) > 1]
        modules = split_modules("/" + text.split(":")[0], words)
        return all(s in known and all(_is_formula(a) for a in args) for s, args in modules)
    except UsageError:
        return False


def _is_formula(text: str) -> bool:
    try:
        read_formula(number_signs(text), Draws(0))
    except UsageError:
        return False
    return True
