"""Signs that people paste from pages, read as those of the keyboard, and comments cut out."""

from __future__ import annotations

_EVERYWHERE = str.maketrans(
    {
        "\u2212": "-",  # minus sign
        "\u2013": "-",  # en dash
        "\u2010": "-",  # hyphen
        "\u2011": "-",
        "\u2192": "->",
        "\u27f6": "->",
        "\u21d2": "->",
        "\u27f9": "->",
        "\u21a6": "->",
        "\u2032": "'",  # prime
        "\u2018": "'",
        "\u2019": "'",
        "\u00b4": "'",
        "\u2033": "''",
        "\u2034": "'''",
        "\u201c": '"',
        "\u201d": '"',
        "\u02c6": "^",
        "\u2223": "|",
        "\u2216": "\\",
        "\u2044": "/",
        "\u2215": "/",
        "\u00a0": " ",
        "\u2007": " ",
        "\u202f": " ",
        "\u200b": "",  # without a width
        "\u00ad": "",
        "\ufeff": "",
    }
)
"""Signs with one meaning wherever they stand."""

_IN_NUMBERS = str.maketrans(
    {
        "\u00d7": "*",
        "\u00b7": "*",
        "\u22c5": "*",
        "\u2217": "*",
        "\u00f7": "/",
        "\u2264": "<=",
        "\u2265": ">=",
        "\u2260": "!=",
        "\u2227": "&&",
        "\u2228": "||",
        "\u00ac": "!",
    }
)
"""Signs of arithmetic."""

_IN_STRINGS = str.maketrans({"\u2227": "^"})
"""In a string of modules the wedge is the pitch, as books print it."""

_SUBSCRIPTS = str.maketrans({chr(0x2080 + k): str(k) for k in range(10)})


def plain_signs(text: str) -> str:
    """Return a text with the signs of the keyboard, where these have one meaning everywhere."""
    return text.translate(_EVERYWHERE)


def number_signs(text: str) -> str:
    """Return the text of a formula with the signs of the keyboard."""
    return text.translate(_IN_NUMBERS)


def string_signs(text: str) -> str:
    """Return the text of a string of modules with the signs of the keyboard."""
    return text.translate(_IN_STRINGS)


def plain_digits(text: str) -> str:
    """Return a text with subscripts as digits."""
    return text.translate(_SUBSCRIPTS)


def blank_block_comments(text: str) -> tuple[list[str], int | None]:
    """Return the lines of a text without comments ``/* ... */`` and lines of comment ``//``.

    Returns
    -------
    lines
        As many as before.
    open_line
        Number of the line, from 1, where a comment begins that never ends; None if there is none.
    """
    lines: list[str] = []
    open_line: int | None = None
    for number, line in enumerate(text.split("\n"), 1):
        kept = ""
        while line:
            if open_line is not None:
                _, ends, line = line.partition("*/")
                open_line = None if ends else open_line
            elif not kept.strip() and line.lstrip().startswith("//"):
                line = ""
            else:
                before, begins, line = line.partition("/*")
                kept += before + (" " if begins else "")
                open_line = number if begins else None
        lines.append(kept)
    return lines, open_line
