"""What people type who come from other languages, and how it is said here.

Only files that cannot be read are looked at, and only lines with mistakes, so that nothing that is
right is ever taken for something else.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, Source, SourceSpan
from pcsg.grammar.tokens import Token

Match = re.Match[str]


class _Spelling(NamedTuple):
    """A foreign spelling.

    Attributes
    ----------
    pattern
        What is written.
    message
        What it is, or would be.
    hint
        How it is said here.
    """

    pattern: re.Pattern[str]
    message: str
    hint: Callable[[Match], str]


_NUMBER = r"-?(?:\d+\.?\d*|\.\d+)"
_STEPS = {"x": "move({},0,0)", "y": "move(0,{},0)", "z": "move(0,0,{})"}
_STEPS |= {f"r{axis}": f"rot{axis}({{}})" for axis in "xyz"}
_STEP = re.compile(rf"\b(r?[xyz]|s)\s+({_NUMBER})(?:\s+({_NUMBER})\s+({_NUMBER}))?")


def _chain(text: str) -> str:
    """Return EisenScript's ``x 1 rz 30`` as transformations."""
    steps = []
    for word, first, *others in _STEP.findall(text):
        if word != "s":
            steps.append(_STEPS[word].format(first))
        elif others[0]:
            steps.append(f"scale({first},{others[0]},{others[1]})")
        else:
            steps.append(f"uscale({first})")
    return " ".join(steps) or "move(1,0,0)"


def _changed(found: Match) -> str:
    name, sign, more = found[1], found[2], found[3] or ""
    by = more.strip() or "1"
    return f"write `{{{name} = {name} {sign[0]} {by}}}`"


def _say(hint: str) -> Callable[[Match], str]:
    return lambda _: hint


_TRANSFORMED = {"translate": "move(x,y,z)", "rotate": "rotx(a)`, `roty(a)` or `rotz(a)"}
_OF_SIZE = "`sphere` has radius 1; size and place stand before it: `move(0,0,3) uscale(2) sphere`"

_SPELLINGS = tuple(
    _Spelling(re.compile(pattern), message, hint if callable(hint) else _say(hint))
    for pattern, message, hint in (
        (
            r"\b(?:difference|union|intersection|merge)\s*(?:\(\s*\))?\s*\{",
            "solids are combined by signs between them",
            r"`box \ uscale(1.3) sphere` takes away, `&` cuts, `|` joins",
        ),
        (
            rf"(\d+)\s*\*\s*\{{([^}}]*{_STEP.pattern}[^}}]*)\}}",
            "copies are made by `repeat`",
            lambda m: f"write `repeat({m[1]}, {_chain(m[2])})` before the solid",
        ),
        (
            rf"\{{[^{{}}=]*{_STEP.pattern}[^{{}}=]*\}}",
            "transformations are words with numbers in parentheses",
            lambda m: f"write `{_chain(m[0])}` before the solid",
        ),
        (
            r"\brule\s+(\w+)([^{\n]*)\{",
            "a rule is a number, a name and an arrow",
            lambda m: (
                f"write `1: {m[1]} -> ...`"
                + ("; a parameter counts the depth" if m[2].strip() else "")
            ),
        ),
        (
            r"\bstartshape\s+(\w+)",
            "a file begins with what it draws",
            lambda m: f"write `{{}} {m[1]}`",
        ),
        (
            r"\bset\s+(\w+)\s+(\S+)",
            "there is no `set`",
            "parameters are assigned in blocks: `{depth = 20} S`",
        ),
        (r"\bshape\s+(\w+)", "a shape is a module", lambda m: f"write `1: {m[1]} -> ...`"),
        (
            r"\bmodule\s+(\w+)\s*\(([^)]*)\)\s*\{",
            "a module is its rules",
            lambda m: f"write `p: {m[1]}({m[2]}) -> ...`, and call `{m[1]}(...)`",
        ),
        (
            r"\bfor\s*\(\s*(\w+)\s*=\s*\[\s*([^:\],]+)[:,]([^\]]*)\]\s*\)",
            "a loop names its parameter, its first and its last value",
            lambda m: f"write `for({m[1]}, {m[2].strip()}, {m[3].split(':')[-1].strip()}) ...`",
        ),
        (
            r"\bfor\s*\(\s*(\w+)\s*=\s*([^;]+);[^)]*\)",
            "a loop names its parameter, its first and its last value",
            lambda m: f"write `for({m[1]}, {m[2].strip()}, 9) ...`, and a step if it is not 1",
        ),
        (
            r"\b\w+\s*->\s*[^\n|]*\[[-+/\\&^]",
            "this is a rule of an L-system",
            'it stands in a file of its own: save that as `plant.lsys`; here, `blob("plant.lsys")`',
        ),
        (
            r"\{[^}]*?\b(\w+)\s*(--|\+\+)()",
            "a block assigns with `=`",
            _changed,
        ),
        (
            r"\b(\w+)\s*([-+*/])=\s*([^;,}\n]+)",
            "a block assigns with `=`",
            _changed,
        ),
        (
            r"\b(\w+)[ \t]+if\s+(.+?)\s+then\s+(\S+)(?:\s+else\s+(\S+))?",
            "`if` is a function",
            lambda m: f"write `{m[1]} if({m[2]}, {m[3]}, {m[4] or 1})`",
        ),
        (
            r"(?m)^[ \t]*if\s+(.+?)\s+then\b[^\n]*",
            "a module chooses among its rules",
            lambda m: f"write `A if({m[1]}, 1, 2)`, and rules `1: A -> ...`, `2: A -> ...`",
        ),
        (
            r"\b(mesh|blob|tree)\s*\(\s*([\w./-]*[A-Za-z][\w./-]*\.[A-Za-z]\w*)\s*\)",
            "names of files stand in quotes",
            lambda m: f'write `{m[1]}("{m[2]}")`',
        ),
        (
            r"\b(sphere|box|cube|cylinder|cone|torus)\s*\{\s*(?![{}])[<\w.-]",
            "a solid has no body",
            _OF_SIZE,
        ),
        (
            r"\b(sphere|box|cube|cylinder|cone|square|circle)\s*\(\s*(?:\[|\w+\s*=)",
            "solids have no sizes of their own",
            lambda m: f"size and place stand before them: `scale(1,2,3) {m[1]}`",
        ),
        (
            r"\b(translate|rotate)\b",
            "transformations have other names",
            lambda m: f"write `{_TRANSFORMED[m[1]]}`",
        ),
        (
            rf"<\s*{_NUMBER}\s*,[^<>\n]*>",
            "there are no vectors",
            "three numbers stand in parentheses: `move(1,2,3)`",
        ),
        (
            r"\b(move|scale|uscale|rot[xyz])\s+(-?[\d.]+(?:[\s,]+-?[\d.]+)*)",
            "numbers of a transformation stand in parentheses",
            lambda m: f"write `{m[1]}({','.join(m[2].replace(',', ' ').split())})`",
        ),
        (
            r"(?m)^[ \t]*(color|material|label|texture)\s*=\s*([^\n;]*)",
            "an attribute stands before its solid",
            lambda m: f"write `{m[1]}({m[2].strip().strip('()')}) ...`",
        ),
        (
            rf"(?m)^[ \t]*(\w+)\s*=\s*([^{{}}\n;]*{_NUMBER})\s*;?\s*$",
            "numbers are assigned in a block before a solid",
            lambda m: f"write `{{{m[1]} = {m[2].strip()}}} ...`",
        ),
        (
            r"#\s*(?:declare|local)\s+(\w+)\s*=",
            "there are no such directives",
            lambda m: f"write `{m[1]} = ...` for a solid, `{{{m[1]} = ...}}` for a number",
        ),
    )
)

_MOST_LINES, _WINDOW = 100, 2_000
"""Lines that are looked at, and characters from the beginning of each."""

_FOLLOW = frozenset({"no-axiom", "never-used", "undefined-module", "two-axioms"})
"""What comes of an item that could not be read."""


def explain_foreign(
    files: Iterable[Sequence[Token]], problems: Sequence[Diagnostic]
) -> list[Diagnostic]:
    """Return the problems, those on lines of foreign spellings replaced by what to write there."""
    wrong: dict[Source, set[int]] = {}
    for problem in problems:
        if problem.severity == "error" and problem.span and problem.code != "no-axiom":
            line = problem.span.source.locate(problem.span.start)[0]
            wrong.setdefault(problem.span.source, set()).add(line)
    told: dict[tuple[Source, int], Diagnostic] = {}
    for source, lines in wrong.items():
        starts = {t.start for tokens in files for t in tokens if t.source is source}
        for line in sorted(lines)[:_MOST_LINES]:
            found = _find(source, line, starts)
            if found is not None:
                told[source, line] = found
    if not told:
        return list(problems)
    others = [p for p in problems if p.code not in _FOLLOW and _line_of(p) not in told]
    return [*others, *told.values()]


def _line_of(problem: Diagnostic) -> tuple[Source, int] | None:
    span = problem.span
    return None if span is None else (span.source, span.source.locate(span.start)[0])


def _find(source: Source, line: int, starts: set[int]) -> Diagnostic | None:
    """Return what the first foreign spelling means that begins on a line of a file."""
    begin = source.line_starts[line - 1]
    end = source.line_starts[line] if line < len(source.line_starts) else len(source.text)
    window = source.text[begin : min(begin + _WINDOW, len(source.text))]
    for spelling in _SPELLINGS:
        for match in spelling.pattern.finditer(window):
            at = begin + match.start() + len(match[0]) - len(match[0].lstrip())
            if at < end and (at in starts or match[0][0] in "#<"):
                span = SourceSpan(source, at, begin + match.end())
                hint = spelling.hint(match)
                return diagnose("foreign-spelling", spelling.message, span, hint=hint)
    return None
