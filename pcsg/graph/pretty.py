"""Breaking lines: text with groups and possible breaks, laid out within a width.

After Oppen 1980, "Prettyprinting", reduced to what the language needs. Iterative, because groups
nest as deep as the user's graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum


class Mark(Enum):
    """What stands between the texts of a document.

    A group is set on one line where it fits; else each of its breaks ends a line. A `FILL` ends
    the line only where the text up to the next mark does not fit. Both are a blank otherwise.
    """

    OPEN = "open"
    CLOSE = "close"
    BREAK = "break"
    FILL = "fill"


Token = str | Mark


def format_tokens(tokens: Sequence[Token], width: int = 100, step: int = 4) -> str:
    """Return a document as lines of at most `width` characters, where that is possible.

    Parameters
    ----------
    tokens
        Texts without line ends, and marks; every OPEN has its CLOSE.
    step
        Indentation of what goes on below a filled line, and of groups that begin far to the
        right; other groups stand under their beginning.
    """
    flat_width = _flat_widths(tokens)
    out: list[str] = []
    column = 0
    # Of every open group: whether it is broken, and the column of its lines.
    groups: list[tuple[bool, int]] = [(False, step)]
    for k, token in enumerate(tokens):
        if isinstance(token, str):
            out.append(token)
            column += len(token)
        elif token is Mark.OPEN:
            indent = column if column <= width // 2 else min(groups[-1][1] + step, width // 2)
            groups.append((column + flat_width[k] > width, indent))
        elif token is Mark.CLOSE:
            groups.pop()
        else:
            broken, indent = groups[-1]
            if token is Mark.FILL:
                indent += step if broken else 0
                broken = column + 1 + flat_width[k] > width
            if broken:
                out.append("\n" + " " * indent)
                column = indent
            else:
                out.append(" ")
                column += 1
    return "".join(out)


def _flat_widths(tokens: Sequence[Token]) -> list[int]:
    """Return the width of every group on one line, and from every break to the next mark."""
    widths = [0] * len(tokens)
    total = 0
    opened: list[tuple[int, int]] = []
    last_break: tuple[int, int] | None = None
    for k, token in enumerate(tokens):
        if isinstance(token, str):
            total += len(token)
            continue
        if token is Mark.OPEN:
            opened.append((k, total))
        elif token is Mark.CLOSE:
            start, before = opened.pop()
            widths[start] = total - before
        else:
            if last_break is not None:
                widths[last_break[0]] = total - last_break[1]
            total += 1
            last_break = (k, total)
    if last_break is not None:
        widths[last_break[0]] = total - last_break[1]
    return widths
