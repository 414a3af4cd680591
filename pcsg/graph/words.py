"""Names of the language: letters of any script, digits and ``_``, in one form of Unicode."""

from __future__ import annotations

import unicodedata

MARKS = (
    "\\u0300-\\u036f\\u0483-\\u0487\\u0591-\\u05bd\\u064b-\\u065f\\u0900-\\u0903"
    "\\u093a-\\u094f\\u0e31\\u0e34-\\u0e3a\\u0e47-\\u0e4e\\u3099\\u309a"
)
"""Signs that stand above, below or behind a letter: of Latin, Cyrillic, Hebrew, Arabic, Hindi..."""

WORD = rf"[^\W\d](?:\w|[{MARKS}])*"
"""Pattern of what may be a name, or a word of the language."""


def normal(name: str) -> str:
    """Return a name in the form in which names are compared: NFC, letters and marks in one."""
    return name if name.isascii() else unicodedata.normalize("NFC", name)


def is_name(name: str) -> bool:
    """Return whether a text is written as a name."""
    return normal(name).isidentifier()
