"""Texts of options: sizes, memory, assignments, settings."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from pcsg.errors import UsageError, suggest
from pcsg.grammar.colors import find_color
from pcsg.graph.settings import AUTO, SETTINGS, Key, ValueKind
from pcsg.graph.words import is_name

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


def parse_size(text: str) -> tuple[int, int]:
    """Return width and height of ``800x600``."""
    match = re.fullmatch(r"\s*([+-]?\d{1,18})\s*[xX\u00d7]\s*([+-]?\d{1,18})\s*", text)
    if not match:
        raise UsageError(f"--size takes width x height, such as 800x600, not `{text}`")
    return int(match[1]), int(match[2])


def parse_tile(text: str | None) -> tuple[int, int] | None:
    """Return part and number of parts of ``2/8``."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d{1,9})\s*/\s*(\d{1,9})\s*", text)
    if not match:
        raise UsageError(f"--tile takes a part and the number of parts, such as 2/8, not `{text}`")
    return int(match[1]), int(match[2])


def parse_memory(text: str | None, option: str = "--max-memory") -> int | None:
    """Return the bytes of ``4G``, ``512M``, ``1.5GB`` or a plain number."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d{1,18}(?:\.\d*)?)\s*([KMGT]?)(?:i?B)?\s*", text, re.IGNORECASE)
    if not match:
        raise UsageError(f"{option} takes a size such as 4G or 512M, not `{text}`")
    return int(float(match[1]) * _UNITS[match[2].upper()])


def parse_number(text: str, what: str) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"{what} takes a number, not `{text}`")
    return value


def parse_assignments(texts: Sequence[str]) -> dict[str, float]:
    """Return the values of ``name=value``; a later one wins."""
    values = {}
    for text in texts:
        name, sign, value = text.partition("=")
        name = name.strip()
        if not sign or not is_name(name):
            raise UsageError(f"-D takes NAME=VALUE, such as cnt=9, not `{text}`")
        values[name] = parse_number(value.strip(), f"-D {name}=")
    return values


_PAIR = re.compile(
    r"""([^\s=,;]+)\s*=\s*
    (   "[^"]*"
    |   \([^()]*\)(?=[\s,;]|$)
    |   [^\s,;()=]+(?:\s*,\s*[^\s,;()=]+){2}(?=[\s;]|$|,\s*(?:$|[A-Za-z_]\w*\s*=))
    |   \S+?(?=[,;]?(?:\s|$)|[,;][A-Za-z_]\w*\s*=)
    )[\s,;]*""",
    re.VERBOSE,
)
"""A key and its value: a text in quotes, a list with or without brackets, or a word."""


def parse_setting(kind: str, text: str) -> dict[str, Any]:
    """Return the values of ``key=value key=1,2,3`` for a kind of setting.

    What a grammar has between the braces is taken, too: ``key = (1, 2, 3); key = "text"``.
    """
    values = {}
    text = text.strip().removeprefix("{").removesuffix("}").strip()
    while text:
        found = _PAIR.match(text)
        if found is None:
            item = text.split()[0]
            raise UsageError(f"--{kind} takes KEY=VALUE separated by blanks, not `{item}`")
        name, value, text = found[1], found[2], text[found.end() :]
        key = SETTINGS[kind].keys.get(name)
        if key is None:
            hint = suggest(name, SETTINGS[kind].keys)
            known = ", ".join(SETTINGS[kind].keys)
            raise UsageError(f"--{kind} has no key `{name}`; {hint or f'its keys are {known}'}")
        values[name] = _parse_value(f"--{kind} {name}=", key, value)
    return values


def _parse_value(what: str, key: Key, text: str) -> Any:
    if key.default is None and text == AUTO:
        return None
    if key.kind is ValueKind.NUMBER:
        number = parse_number(text, what)
        if not key.low <= number <= key.high:
            raise UsageError(f"{what} must lie between {key.low:g} and {key.high:g}, not {text}")
        return number
    if key.kind is ValueKind.COLOR and (found := find_color(text.strip('"'))):
        return found
    if key.kind in (ValueKind.VECTOR, ValueKind.COLOR):
        parts = text.removeprefix("(").removesuffix(")").split(",")
        if len(parts) != 3:
            raise UsageError(f"{what} takes {key.kind.value} as 1,2,3, not `{text}`")
        return tuple(parse_number(part, what) for part in parts)
    if key.kind is ValueKind.WORD and text not in key.words:
        raise UsageError(f"{what} takes one of {', '.join(key.words)}, not `{text}`")
    if key.kind is ValueKind.FILE and len(text) > 1 and text[0] == text[-1] == '"':
        return text[1:-1]
    return text
