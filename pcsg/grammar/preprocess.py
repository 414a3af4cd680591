"""Files, ``#include`` and ``#define``: from a file to the tokens of the whole set of files.

Files are read and cut into tokens first, then the macros of all of them are collected, then
replaced: a macro holds before and after its place.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, Source, SourceSpan
from pcsg.grammar.tokens import WORD_TYPES, Token, join, tokenize

MAX_BYTES = 16 * 2**20
"""A longer file is refused."""

MAX_EXPANSION = 300_000
"""Largest number of tokens that macros may produce."""

MAX_NESTING = 64
"""Deepest nesting of macros within macros."""


@dataclass
class Macro:
    """A name and the tokens that replace it."""

    name: Token
    body: list[Token]


@dataclass
class Unit:
    """One file: its tokens without directives, and the files that it includes."""

    path: Path | None
    tokens: list[Token] = field(default_factory=list)
    includes: list[tuple[Path, SourceSpan]] = field(default_factory=list)


@dataclass
class Preprocessed:
    """The root file, and the tokens of every file, the root first, macros replaced."""

    root: Source | None
    files: list[list[Token]]
    problems: list[Diagnostic]


def preprocess_file(path: Path, include: Iterable[str | Path]) -> Preprocessed:
    """Read a file and what it includes."""
    source, problems = _read(path, str(path))
    if source is None:
        return Preprocessed(None, [], problems)
    return _preprocess(source, path.resolve(), path.parent, include, problems)


def preprocess_text(text: str, name: str, include: Iterable[str | Path]) -> Preprocessed:
    """Read a text and what it includes; paths are relative to the working directory."""
    # A text from a file read elsewhere may begin with a byte order mark.
    source = Source(name, text.removeprefix("\ufeff"))
    return _preprocess(source, None, Path(), include, [])


def _read(path: Path, name: str) -> tuple[Source | None, list[Diagnostic]]:
    """Return the text of a file, as far as it is text."""
    try:
        if path.is_dir():
            return None, [diagnose("file-missing", f"`{name}` is a directory, not a grammar")]
        if not path.is_file():
            return None, [diagnose("file-missing", f"there is no file `{name}`")]
        if path.stat().st_size > MAX_BYTES:
            return None, [diagnose("file-too-large", f"`{name}` is larger than 16 MB")]
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        return None, [diagnose("file-missing", f"cannot read `{name}`: {reason}")]
    try:
        return Source(name, data.decode("utf-8-sig")), []
    except UnicodeDecodeError as error:
        # Bytes before the bad one are text; their number of characters is its offset.
        start = data[: error.start].decode("utf-8-sig")
        source = Source(name, data.decode("utf-8-sig", errors="replace"))
        span = SourceSpan(source, len(start), len(start) + 1)
        bad = data[error.start]
        message = f"not UTF-8: byte {bad:#04x} at offset {error.start}"
        return None, [diagnose("not-utf8", message, span, hint="save the file as UTF-8")]


def _preprocess(
    root: Source,
    root_path: Path | None,
    folder: Path,
    include: Iterable[str | Path],
    problems: list[Diagnostic],
) -> Preprocessed:
    allowed = [folder.resolve(), *(Path(p).resolve() for p in include)]
    macros: dict[str, Macro] = {}
    units: dict[Path | None, Unit] = {}
    # Files still to cut into tokens, with the folder that their includes are relative to.
    pending = [(root, root_path, folder)]
    while pending:
        source, path, folder = pending.pop(0)
        if path in units:
            continue
        unit = units[path] = Unit(path)
        tokens, found = tokenize(source)
        problems += found
        includes: list[tuple[Token, SourceSpan]] = []
        unit.tokens = _take_directives(tokens, macros, includes, problems)
        for token, span in includes:
            target = folder / token.text[1:-1]
            resolved = _resolve(target, span, allowed, problems)
            if resolved is None:
                continue
            unit.includes.append((resolved, span))
            if resolved in units:
                continue
            text, trouble = _read(resolved, str(target))
            for p in trouble:
                code = "include-missing" if p.span is None else p.code
                problems.append(diagnose(code, p.message, p.span or span, hint=p.hint))
            if text is not None:
                pending.append((text, resolved, target.parent))
    problems += _include_cycles(units)
    usable = _usable_macros(macros, problems)
    expander = _Expander(usable, problems)
    files = [expander.expand(unit.tokens) for unit in units.values()]
    return Preprocessed(root, files, problems)


def _resolve(
    target: Path, span: SourceSpan, allowed: Sequence[Path], problems: list[Diagnostic]
) -> Path | None:
    try:
        resolved = target.resolve()
    except (OSError, ValueError, RuntimeError):
        problems.append(diagnose("include-missing", f"cannot read `{target}`", span))
        return None
    if any(resolved.is_relative_to(folder) for folder in allowed):
        return resolved
    problems.append(
        diagnose(
            "include-outside",
            f"`{target}` is outside the folder of the root file",
            span,
            hint="allow its folder with --include DIR",
        )
    )
    return None


def _include_cycles(units: Mapping[Path | None, Unit]) -> list[Diagnostic]:
    """Report every include that leads back to a file that is being included."""
    problems: list[Diagnostic] = []
    done: set[Path | None] = set()
    on_path: dict[Path | None, int] = {}
    start = next(iter(units))
    stack: list[tuple[Path | None, int]] = [(start, 0)]
    while stack:
        path, k = stack.pop()
        on_path[path] = k
        unit = units.get(path)
        includes = unit.includes if unit else []
        if k >= len(includes):
            done.add(path)
            on_path.pop(path)
            continue
        stack.append((path, k + 1))
        target, span = includes[k]
        if target in on_path:
            message = f"`{target.name}` includes itself"
            names = [p.name for p in list(on_path)[list(on_path).index(target) :] if p]
            if len(names) > 1:
                message += " through " + ", ".join(f"`{n}`" for n in names[1:])
            problems.append(diagnose("include-cyclic", message, span))
        elif target not in done:
            stack.append((target, 0))
    return problems


def _take_directives(
    tokens: list[Token],
    macros: dict[str, Macro],
    includes: list[tuple[Token, SourceSpan]],
    problems: list[Diagnostic],
) -> list[Token]:
    """Collect the directives and return the tokens between them."""
    if not any(t.type == "HASH" for t in tokens):
        return tokens
    rest: list[Token] = []
    i = 0
    while i < len(tokens):
        token = tokens[i]
        if token.type != "HASH" or not token.first:
            rest.append(token)
            i += 1
            continue
        end = _line_end(tokens, i)
        line = tokens[i + 1 : end]
        word = line[0].text if line else ""
        if word == "define":
            i = _take_define(tokens, i, macros, problems)
            continue
        if word == "include" and len(line) == 2 and line[1].type == "STRING":
            includes.append((line[1], line[1].span))
        elif word == "include":
            span = join(token.span, tokens[end - 1].span)
            problems.append(
                diagnose("bad-directive", "`#include` needs a file", span, expected='`"file.pcsg"`')
            )
        else:
            span = join(token.span, line[0].span) if line else token.span
            problems.append(
                diagnose(
                    "bad-directive",
                    f"unknown directive `#{word}`",
                    span,
                    expected="`#define` or `#include`",
                )
            )
        i = end
    return rest


def _line_end(tokens: Sequence[Token], i: int) -> int:
    """Return the index behind the last token on the line of token i."""
    line = tokens[i].line
    while i < len(tokens) and tokens[i].line == line:
        i += 1
    return i


def _take_define(
    tokens: list[Token], i: int, macros: dict[str, Macro], problems: list[Diagnostic]
) -> int:
    """Collect a macro whose ``#`` is token i and return the index behind it."""
    end = _line_end(tokens, i)
    head = tokens[i + 1]
    if end == i + 2 or tokens[i + 2].type not in WORD_TYPES:
        span = join(tokens[i].span, head.span)
        problems.append(diagnose("bad-directive", "`#define` needs a name", span))
        return end
    name = tokens[i + 2]
    start = i + 3
    if start < end and tokens[start].type == "LPAREN" and not tokens[start].gap:
        problems.append(
            diagnose(
                "macro-function",
                f"macro `{name.text}` takes no arguments",
                name.span,
                hint="put a blank before `(` if the body begins with it",
            )
        )
        return end
    if start == end and start < len(tokens):
        # A brace block may open on the next line instead.
        opener = tokens[start]
        if opener.type == "LBRACE" and opener.line == name.line + 1:
            end = _line_end(tokens, start)
    depth = 0
    k = start
    while k < end:
        kind = tokens[k].type
        depth += 1 if kind == "LBRACE" else -1 if kind == "RBRACE" else 0
        k += 1
        if k == end and depth > 0 and end < len(tokens):
            end = _line_end(tokens, end)
    body = tokens[start:end]
    if not body:
        problems.append(diagnose("macro-empty", f"macro `{name.text}` has no body", name.span))
    elif depth > 0:
        opener = next(t for t in body if t.type == "LBRACE")
        problems.append(
            diagnose(
                "unbalanced-bracket",
                f"`{{` in the body of `{name.text}` is never closed",
                opener.span,
            )
        )
    elif name.text in macros:
        first = macros[name.text].name
        problems.append(
            diagnose(
                "macro-redefined",
                f"macro `{name.text}` is defined already",
                name.span,
                notes=[("first defined here", first.span)],
            )
        )
    if body and name.text not in macros:
        macros[name.text] = Macro(name, body)
    return end


def _usable_macros(
    macros: Mapping[str, Macro], problems: list[Diagnostic]
) -> dict[str, Macro | None]:
    """Return the macros; None for those on a cycle, each of which is reported once."""
    usable: dict[str, Macro | None] = dict(macros)
    used = {
        name: [t.text for t in macro.body if t.type in WORD_TYPES and t.text in macros]
        for name, macro in macros.items()
    }
    done: set[str] = set()
    for start in macros:
        path: dict[str, None] = {}
        stack = [(start, 0)]
        while stack:
            name, k = stack.pop()
            if name in done:
                continue
            path[name] = None
            if k >= len(used[name]):
                done.add(name)
                del path[name]
                continue
            stack.append((name, k + 1))
            target = used[name][k]
            if target in path:
                cycle = list(path)[list(path).index(target) :]
                usable |= dict.fromkeys(cycle)
                shown = " -> ".join(f"`{n}`" for n in [*cycle, target])
                problems.append(
                    diagnose("macro-cyclic", f"cyclic macro: {shown}", macros[target].name.span)
                )
            elif target not in done:
                stack.append((target, 0))
    return usable


class _Expander:
    """Replaces macros, with a limit over all files together."""

    def __init__(self, macros: Mapping[str, Macro | None], problems: list[Diagnostic]) -> None:
        self.macros = macros
        self.problems = problems
        self.room = MAX_EXPANSION

    def expand(self, tokens: list[Token]) -> list[Token]:
        """Return the tokens with macros replaced."""
        macros = self.macros
        if not macros:
            return tokens
        out: list[Token] = []
        for token in tokens:
            if token.text in macros and token.type in WORD_TYPES:
                out.extend(self._replace(token))
            else:
                out.append(token)
        return out

    def _replace(self, use: Token) -> list[Token]:
        """Return what a use of a macro stands for."""
        out: list[Token] = []
        # Bodies being copied, with the chain of places that leads to each.
        stack: list[tuple[Iterator[Token], tuple[SourceSpan, ...]]] = [(iter([use]), ())]
        while stack:
            tokens, places = stack[-1]
            token = next(tokens, None)
            if token is None:
                stack.pop()
                continue
            if token.text in self.macros and token.type in WORD_TYPES:
                macro = self.macros[token.text]
                if macro is None:
                    # Reported as cyclic; the item around it is broken without another word.
                    return [self._stand_in(use)]
                if len(stack) > MAX_NESTING:
                    return self._give_up(use)
                stack.append((iter(macro.body), (*places, token.span)))
                continue
            self.room -= 1
            if self.room < 0:
                return self._give_up(use)
            copy = Token(token.type, token.text, use.source, use.start, use.end, use.line)
            copy.origin, copy.places = token, places
            copy.gap = token.gap
            out.append(copy)
        out[0].first = use.first
        out[0].gap = use.gap
        return out

    def _stand_in(self, use: Token) -> Token:
        token = Token("STRAY", use.text, use.source, use.start, use.end, use.line)
        token.first = use.first
        token.gap = use.gap
        return token

    def _give_up(self, use: Token) -> list[Token]:
        if not any(p.code == "macro-too-large" for p in self.problems):
            self.problems.append(
                diagnose(
                    "macro-too-large",
                    f"macro `{use.text}` grows beyond {MAX_EXPANSION:,} tokens or {MAX_NESTING} levels",
                    use.span,
                )
            )
        return [self._stand_in(use)]
