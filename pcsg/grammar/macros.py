"""Macros: collecting ``#define`` and replacing what it names.

Whole tokens are replaced, after comments are gone. Every copy knows the token in the macro's body
and the macros around it, so that a mistake points at the use with a note at the body.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, SourceSpan
from pcsg.grammar.tokens import TAKES_LITERALS, WORD_TYPES, Token, join, unfold

MAX_EXPANSION = 300_000
"""Largest number of tokens that macros may produce."""

MAX_NESTING = 64
"""Deepest nesting of macros within macros."""


@dataclass
class Macro:
    """A name and the tokens that replace it."""

    name: Token
    body: list[Token]


def line_end(tokens: Sequence[Token], i: int) -> int:
    """Return the index behind the last token on the line of token i."""
    line = tokens[i].line
    while i < len(tokens) and tokens[i].line == line:
        i += 1
    return i


def take_define(
    tokens: list[Token], i: int, macros: dict[str, Macro], problems: list[Diagnostic]
) -> int:
    """Collect a macro whose ``#`` is token i and return the index behind it."""
    end = line_end(tokens, i)
    head = tokens[i + 1]
    if end == i + 2 or tokens[i + 2].type not in WORD_TYPES:
        span = join(tokens[i].span, head.span)
        problems.append(diagnose("bad-directive", "`#define` needs a name", span))
        return end
    name = tokens[i + 2]
    start = i + 3
    if start < end and tokens[start].type in ("LPAREN", "LITERALS") and not tokens[start].gap:
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
            end = line_end(tokens, start)
    depth = 0
    k = start
    while k < end:
        kind = tokens[k].type
        depth += 1 if kind == "LBRACE" else -1 if kind == "RBRACE" else 0
        k += 1
        if k == end and depth > 0 and end < len(tokens):
            end = line_end(tokens, end)
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


def usable_macros(
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


class Expander:
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
                found = self._replace(token)
            else:
                found = [token]
            for part in found:
                if part.type == "LITERALS" and out[-1].type not in TAKES_LITERALS:
                    # A macro has put something else before them.
                    out.extend(unfold(part))
                else:
                    out.append(part)
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
            self.room -= token.size
            if self.room < 0:
                return self._give_up(use)
            out.append(token.copy_to(use, places))
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
                    f"macro `{use.text}` grows beyond {MAX_EXPANSION:,} tokens "
                    f"or {MAX_NESTING} levels",
                    use.span,
                )
            )
        return [self._stand_in(use)]
