"""Which names a grammar has, and where each is defined and used.

Names are found in the tokens, not in the syntax, so that a file that is being typed has them, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from pcsg.editors.vocabulary import vocabulary
from pcsg.errors import Diagnostic, Source, SourceSpan
from pcsg.grammar.items import cut_items
from pcsg.grammar.macros import Macro
from pcsg.grammar.preprocess import ENDING, read_source, take_directives
from pcsg.grammar.reach import Reach
from pcsg.grammar.tokens import Token, tokenize, unfold_all
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.settings import SETTINGS, ValueKind

SOLID, PARAMETER, MACRO = "solid", "parameter", "macro"
"""Spaces of names: modules and definitions; parameters; macros. A kind of settings is one, too."""

_TAKES_NUMBERS = frozenset({"NAME", "PRIMITIVE", "TRANSFORM", "ATTRIBUTE", "FOR", "SCATTER"})

MOST_FILES = 100
"""Files of a grammar that are looked at."""


@dataclass(frozen=True)
class Occurrence:
    """A name where it stands.

    Attributes
    ----------
    space
        ``solid``, ``parameter``, ``macro``, or a kind of named settings such as ``material``.
    defines
        Whether it gets its meaning there.
    item
        Where the item around it stands: what a definition says.
    """

    name: str
    space: str
    source: Source
    start: int
    end: int
    defines: bool = False
    item: tuple[int, int] = (0, 0)


@dataclass
class Names:
    """The names of a file.

    Attributes
    ----------
    includes
        The files that it includes, as it names them.
    """

    source: Source
    tokens: list[Token] = field(default_factory=list)
    occurrences: list[Occurrence] = field(default_factory=list)
    includes: list[Path] = field(default_factory=list)

    def at(self, offset: int) -> Occurrence | None:
        """Return the name at an offset."""
        found = (o for o in self.occurrences if o.start <= offset <= o.end)
        return next(found, None)


def names_of(source: Source, known: Sequence[Names] = ()) -> Names:
    """Return the names of a file.

    Parameters
    ----------
    known
        Other files of the grammar: their names tell what names here are.
    """
    tokens = unfold_all(tokenize(source)[0])
    # Those that are cut into items get other types on the way.
    found = Names(source, [copy(token) for token in tokens])
    if not tokens:
        return found
    macros: dict[str, Macro] = {}
    included: list[tuple[Token, SourceSpan]] = []
    problems: list[Diagnostic] = []
    rest = take_directives(tokens, macros, included, problems)
    found.includes = [Path(source.folder) / token.text[1:-1] for token, _ in included]
    items = cut_items(rest)
    others = [o for names in known for o in names.occurrences if o.defines]
    solids = {o.name for o in others if o.space == SOLID}
    macro_names = set(macros) | {o.name for o in others if o.space == MACRO}
    heads: set[Token] = set()
    for item in items:
        head = _head_of(item.kind, item.tokens)
        if head is not None:
            heads.add(head)
            solids.add(head.text)
    for item in items:
        span = item.tokens[0].start, item.tokens[-1].end
        number = item.kind == "module"
        found.occurrences += _occurrences(
            item.tokens, source, span, heads, solids, macro_names, number
        )
    for macro in macros.values():
        body = macro.body
        span = macro.name.start, body[-1].end
        found.occurrences.append(_at(macro.name, MACRO, source, span, True))
        found.occurrences += _occurrences(body, source, span, heads, solids, macro_names, False)
    found.occurrences.sort(key=lambda o: o.start)
    return found


def _head_of(kind: str, tokens: Sequence[Token]) -> Token | None:
    """Return the name that an item defines."""
    at = 1 if kind in ("rule", "labelled") else 0
    if kind == "labelled" and not any(t.type == "ARROW" for t in tokens):
        return None  # the axiom
    if kind in ("rule", "labelled", "module", "definition") and len(tokens) > at:
        return tokens[at] if tokens[at].type == "NAME" else None
    return None


def _at(
    token: Token, space: str, source: Source, item: tuple[int, int], defines: bool = False
) -> Occurrence:
    return Occurrence(token.text, space, source, token.start, token.end, defines, item)


def _occurrences(
    tokens: Sequence[Token],
    source: Source,
    span: tuple[int, int],
    heads: set[Token],
    solids: set[str],
    macros: set[str],
    number: bool,
) -> Iterator[Occurrence]:
    """Yield the names of an item."""
    setting = SETTINGS.get(tokens[0].text) if tokens and tokens[0].type == "SETTING" else None
    arithmetic = [number or setting is not None]
    formals = 0  # the names in the head of an attributed rule end before this token
    if tokens and tokens[0].type == "LABEL" and len(tokens) > 2 and tokens[1] in heads:
        formals = next((i for i, t in enumerate(tokens) if t.type == "RPAREN"), 0)
    for i, token in enumerate(tokens):
        before = tokens[i - 1] if i else None
        after = tokens[i + 1].type if i + 1 < len(tokens) else ""
        if token.type == "LPAREN":
            call = (
                before is not None
                and before.type in _TAKES_NUMBERS
                and before.text not in macros  # what one stands for ends before the bracket
            )
            arithmetic.append(arithmetic[-1] or call)
        elif token.type in ("LBRACE", "FOPEN"):
            arithmetic.append(token.type == "LBRACE")
        elif token.type in ("RPAREN", "RBRACE", "FCLOSE") and len(arithmetic) > 1:
            arithmetic.pop()
        if token.type != "NAME":
            continue
        name = token.text
        refers = _reference(tokens, i)
        if setting is not None and setting.named and i == 1:
            yield _at(token, setting.name, source, span, True)
        elif setting is not None and before is not None and before.type == "ASSIGN":
            key = setting.keys.get(tokens[i - 2].text)
            if key is not None and key.kind is ValueKind.NAME and key.refers_to:
                yield _at(token, key.refers_to, source, span)
            elif key is None or key.kind is not ValueKind.WORD:
                yield _at(token, MACRO if name in macros else PARAMETER, source, span)
        elif refers is not None:
            yield _at(token, refers, source, span)
        elif token in heads:
            yield _at(token, SOLID, source, span, True)
        elif name in macros:
            yield _at(token, MACRO, source, span)
        elif name in solids and not arithmetic[-1]:
            yield _at(token, SOLID, source, span)
        elif name in _fields() and not arithmetic[-1]:
            continue  # `point`, `line`
        elif after != "LPAREN" and (arithmetic[-1] or name not in solids):
            is_formal = (
                before is not None and before.type == "LPAREN" and tokens[i - 2].type == "FOR"
            )
            assigned = after == "ASSIGN" and arithmetic[-1]
            yield _at(token, PARAMETER, source, span, assigned or is_formal or i < formals)


@cache
def _fields() -> frozenset[str]:
    return frozenset(vocabulary()["primitive"])


def _reference(tokens: Sequence[Token], i: int) -> str | None:
    """Return the kind of setting that a name refers to, as in `material(bark)`."""
    if i < 2 or tokens[i - 1].type != "LPAREN":
        return None
    word = tokens[i - 2].text
    if word == "palette":
        return "palette"
    return ATTRIBUTES[word].refers_to if word in ATTRIBUTES else None


def files_of(source: Source, opened: dict[Path, str]) -> list[Names]:
    """Return the names of a file and of all that it includes, itself first.

    Parameters
    ----------
    opened
        Texts that are open in the editor, by their place without links.
    """
    sources = [source]
    seen: set[Path] = set()
    reach = Reach.of(Path(source.folder), ())
    for known in sources:
        for path in names_of(known).includes:
            place = reach.find(path)
            if place is None or place.suffix.lower() != ENDING or place in seen:
                continue
            if len(sources) >= MOST_FILES:
                break
            seen.add(place)
            if place in opened:
                sources.append(Source(str(path), opened[place], str(path.parent)))
            elif (read := read_source(path)[0]) is not None:
                sources.append(read)
    first = [names_of(s) for s in sources]
    return [names_of(s, first) for s in sources] if len(sources) > 1 else first
