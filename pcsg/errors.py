"""What can go wrong, and how it is told.

::

    PcsgError
    ├── GrammarError       mistakes in a file: one or more diagnostics          exit status 2
    ├── UsageError         mistakes in arguments, options or API calls          exit status 2
    ├── EvaluationFault    a fault met while walking the graph (NaN, depth...)  exit status 2
    └── EnvironmentFault   the surroundings failed (disk, memory)               exit status 1

A diagnostic has one form everywhere: file, line, column, the source line with carets, what is
wrong, what was expected, and the likely repair.
"""

from __future__ import annotations

import difflib
import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self


@dataclass(frozen=True)
class Source:
    """A text with the name users know it by.

    Attributes
    ----------
    folder
        What names of files in it are relative to.
    written
        Whether it is what stands in the file of that name, so that places in it mean something.
    """

    name: str
    text: str = field(repr=False)
    folder: str = field(default="", repr=False, compare=False)
    written: bool = field(default=True, repr=False, compare=False)

    @cached_property
    def line_starts(self) -> tuple[int, ...]:
        """Offsets of the first character of every line."""
        return (0, *(match.end() for match in re.finditer("\n", self.text)))

    def locate(self, offset: int) -> tuple[int, int]:
        """Return line and column of an offset, both counted from 1."""
        line = bisect_right(self.line_starts, offset)
        return line, offset - self.line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """Return the text of a line (counted from 1) without its end."""
        start = self.line_starts[number - 1]
        end = self.text.find("\n", start)
        return self.text[start : end if end >= 0 else len(self.text)].rstrip("\r")


# Not frozen: a file has hundreds of thousands, and they would take three times as long to make.
@dataclass(slots=True, unsafe_hash=True)
class SourceSpan:
    """The characters ``[start, end)`` of a source; nobody changes one.

    Attributes
    ----------
    body
        Where a macro stands there: the place inside its body, which may hold a macro in turn.
    """

    source: Source
    start: int
    end: int
    body: SourceSpan | None = None

    def __getstate__(self) -> tuple[Any, ...]:
        return self.source, self.start, self.end, self.body

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.source, self.start, self.end, self.body = state

    @property
    def line(self) -> int:
        """Line of the first character, from 1."""
        return self.source.locate(self.start)[0]

    @property
    def column(self) -> int:
        """Column of the first character, from 1."""
        return self.source.locate(self.start)[1]

    @property
    def text(self) -> str:
        """The characters themselves."""
        return self.source.text[self.start : self.end]

    @property
    def folder(self) -> str:
        """What names of files there are relative to: where they are written, also in a macro."""
        return self.body.folder if self.body else self.source.folder

    def __str__(self) -> str:
        if not self.source.written:
            return self.source.name
        line, column = self.source.locate(self.start)
        return f"{self.source.name}:{line}:{column}"

    def excerpt(self) -> str:
        """Return the first line of the span with carets under it."""
        line, column = self.source.locate(self.start)
        whole = self.source.line(line)
        width = max(1, min(self.end - self.start, len(whole) - column + 1))
        shown, column = _clip(whole, column, width)
        width = max(1, min(width, len(shown) - column + 1))
        pad = "".join("\t" if c == "\t" else " " for c in shown[: column - 1])
        number = str(line)
        return f"  {number} | {shown}\n  {' ' * len(number)} | {pad}{'^' * width}"


_EXCERPT_WIDTH = 120


def _clip(line: str, column: int, width: int) -> tuple[str, int]:
    """Cut a very long source line down to a window about the column."""
    if len(line) <= _EXCERPT_WIDTH:
        return line, column
    start = max(0, min(column - 1 - _EXCERPT_WIDTH // 3, len(line) - _EXCERPT_WIDTH))
    return line[start : start + _EXCERPT_WIDTH], column - start


@dataclass(frozen=True)
class Diagnostic:
    """One thing that is wrong with a file.

    Attributes
    ----------
    code
        Stable name of the kind of mistake, such as ``unknown-primitive``.
    message
        What is wrong, one line without a full stop.
    span
        Where; None only for what has no place, such as a missing file.
    expected
        What would have been right there.
    hint
        The likely repair.
    notes
        Further places that explain it, each with a message.
    severity
        ``error`` or ``warning``.
    """

    code: str
    message: str
    span: SourceSpan | None = None
    expected: str | None = None
    hint: str | None = None
    notes: tuple[tuple[str, SourceSpan | None], ...] = ()
    severity: str = "error"

    def render(self) -> str:
        """Return the diagnostic as text for people."""
        place = f"{self.span}: " if self.span else ""
        lines = [f"{place}{self.severity}[{self.code}]: {self.message}"]
        if self.span and self.span.source.written:
            lines.append(self.span.excerpt())
        if self.expected:
            lines.append(f"  expected: {self.expected}")
        if self.hint:
            lines.append(f"  help: {self.hint}")
        for message, span in self._all_notes():
            lines.append(f"  note: {f'{span}: ' if span else ''}{message}")
            if span and span.source.written:
                lines.append(span.excerpt())
        return "\n".join(lines)

    def _all_notes(self) -> list[tuple[str, SourceSpan | None]]:
        """Return the notes, before them the bodies of the macros that the span comes from."""
        found: list[tuple[str, SourceSpan | None]] = []
        body = self.span.body if self.span else None
        while body:
            found.append(("in the body of the macro", body))
            body = body.body
        return [*found, *self.notes]

    def to_json(self) -> dict[str, Any]:
        """Return the diagnostic as an object that JSON can carry."""
        return {
            "severity": self.severity,
            "code": self.code,
            "message": self.message,
            **_place_json(self.span),
            "expected": self.expected,
            "hint": self.hint,
            "notes": [{"message": text, **_place_json(span)} for text, span in self._all_notes()],
        }


def _place_json(span: SourceSpan | None) -> dict[str, Any]:
    if span is None or not span.source.written:
        file = span.source.name if span else None
        return {"file": file, "line": None, "column": None, "end_line": None, "end_column": None}
    line, column = span.source.locate(span.start)
    end_line, end_column = span.source.locate(span.end)
    return {
        "file": span.source.name,
        "line": line,
        "column": column,
        "end_line": end_line,
        "end_column": end_column,
    }


class PcsgError(Exception):
    """Base of every error that pcsg raises on purpose.

    Errors come back from other processes as they were: they pickle by what they were made of.
    """

    exit_status = 2

    _made_of: tuple[Any, ...]

    def __new__(cls, *args: Any) -> Self:
        """Keep the arguments; what `Exception` keeps is the text."""
        made = super().__new__(cls, *args)
        made._made_of = args
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to make it again."""
        return type(self), self._made_of, vars(self)

    def __str__(self) -> str:
        return printable(super().__str__())


class GrammarError(PcsgError):
    """Mistakes in a grammar, all of them at once."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n".join(d.render() for d in self.diagnostics))


class UsageError(PcsgError, ValueError):
    """A wrong argument of a command or an API call."""


class EvaluationFault(PcsgError):
    """A fault met while the graph is walked.

    Names the grammar line, the derivation path and the parameter values.
    """

    def __init__(self, diagnostic: Diagnostic) -> None:
        self.diagnostic = diagnostic
        super().__init__(diagnostic.render())


class EnvironmentFault(PcsgError):
    """The surroundings failed: no space, no permission, no memory."""

    exit_status = 1


_PICTURES = {
    **{code: 0x2400 + code for code in range(32) if chr(code) not in "\t\n"},
    127: 0x2421,
    # The other set of control characters, and those that turn the direction of writing.
    **dict.fromkeys([*range(0x80, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A)], 0xFFFD),
    # Halves of characters: bytes of a file's name that are no text.
    **dict.fromkeys(range(0xD800, 0xE000), 0xFFFD),
}


def printable(text: str) -> str:
    """Return a text that no terminal takes for commands, of the same length.

    Texts quote files, and files may be anybody's: control characters become their pictures.
    """
    return text.translate(_PICTURES)


def missing_extra(what: str, library: str, extra: str) -> str:
    """Return the message for a library of an extra that is not installed.

    Parameters
    ----------
    what
        Needs the library: ``tree meshes need``.
    """
    return f"{what} {library}; in the folder of pcsg's source: pip install '.[{extra}]'"


SYNONYMS = {
    "translate": "move",
    "translation": "move",
    "rotate": "rot",
    "resize": "uscale",
    "mirror": "flipxy",
    "transform": "matrix",
    "pigment": "color",
    "colour": "color",
    "rgb": "color",
    "ball": "sphere",
    "cuboid": "box",
    "plane": "halfspace",
    "location": "eye",
    "position": "eye",
    "from": "eye",
    "look_at": "target",
    "lookat": "target",
    "angle": "fov",
    "background": "sky",
    "environment": "sky",
    "light_source": "light",
    "floor": "ground",
    "diffuse": "color",
    "basecolor": "color",
    "base_color": "color",
    "metalness": "metallic",
}
"""What other programs call what a word of ours means."""


MOST_COMPARED = 1000
"""Of more candidates only those with the same first letter are compared, and no more of them."""


def suggest(word: str, candidates: Iterable[str]) -> str | None:
    """Return ``did you mean `x`?`` for what other programs call so, or the nearest candidate."""
    known = list(candidates)
    if len(known) > MOST_COMPARED:
        known = [k for k in known if k[:1] == word[:1]][:MOST_COMPARED]
    ours = SYNONYMS.get(word.lower())
    if ours in known:
        return f"did you mean `{ours}`?"
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean `{near[0]}`?" if near else None
