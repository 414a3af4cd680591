"""What an editor says about a place in a grammar: its meaning, what may stand there, repairs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from pcsg.editors.symbols import MACRO, PARAMETER, SOLID, Names, Occurrence
from pcsg.editors.vocabulary import is_word, kinds_of, vocabulary
from pcsg.errors import Diagnostic
from pcsg.grammar.check import CALLABLE
from pcsg.grammar.colors import find_color, to_linear
from pcsg.grammar.fields import FIELD_BLENDS, FIELD_UNARY
from pcsg.grammar.tokens import CONSTANTS, Token
from pcsg.graph.attributes import ATTRIBUTES
from pcsg.graph.functions import FUNCTIONS
from pcsg.graph.graph import GLOBALS
from pcsg.graph.settings import SETTINGS, Key, SettingKind, ValueKind
from pcsg.graph.transforms import TRANSFORMS
from pcsg.leaf import LEAF_NAMES

MOST_SHOWN = 1_500
"""Characters of a definition that are shown."""


class Proposal(NamedTuple):
    """A word that may stand at a place, with its kind and what it is."""

    word: str
    kind: str
    detail: str


class Colour(NamedTuple):
    """A colour in a text: where, and linear red, green and blue; whether it is in quotes."""

    start: int
    end: int
    rgb: tuple[float, float, float]
    quoted: bool


class Repair(NamedTuple):
    """A replacement for what a diagnostic points at."""

    start: int
    end: int
    text: str
    title: str


# Meaning


def explain(files: Sequence[Names], offset: int, values: Mapping[str, float]) -> str | None:
    """Return what stands at an offset of the first file, as Markdown.

    Parameters
    ----------
    values
        Of the axiom's parameters, as far as they are known.
    """
    names = files[0]
    at = next((i for i, t in enumerate(names.tokens) if t.start <= offset < t.end), None)
    found = names.at(offset)
    if at is None:
        return None
    token = names.tokens[at]
    if found is not None and found.name not in GLOBALS:
        return _explain_name(files, found, values)
    kind = list(kinds_of(names.tokens))[at]
    if kind == "name" and (setting := setting_around(names.tokens, at)) is not None:
        key = setting.keys.get(token.text)
        return None if key is None else _explain_key(setting, token.text, key)
    return explain_word(token.text, kind)


def _explain_name(
    files: Sequence[Names], found: Occurrence, values: Mapping[str, float]
) -> str | None:
    places = definitions(files, found)
    if found.space == PARAMETER:
        value = values.get(found.name)
        said = f"`{found.name}`: a parameter"
        if value is not None:
            return f"{said}; {value:g} in the axiom"
        return said
    texts = {
        o.source.text[o.item[0] : o.item[1]]: None
        for o in places
        if o.item[1] - o.item[0] <= MOST_SHOWN
    }
    what = {SOLID: "a module or a definition", MACRO: "a macro"}.get(
        found.space, f"a {found.space}"
    )
    head = f"`{found.name}`: {what}"
    body = "\n".join(texts)
    return f"{head}\n\n```pcsg\n{body}\n```" if body else head


def explain_word(word: str, kind: str) -> str | None:
    """Return what a word of the language is, as Markdown; None for all else."""
    if kind == "primitive" and word in LEAF_NAMES:
        solid = LEAF_NAMES[word]
        usage = [f'"{c.name}"' for c in solid.constants] + [p.name for p in solid.parameters]
        return _page(word, usage, solid.__doc__ or "")
    if kind == "transformation" and word in TRANSFORMS:
        return _page(word, TRANSFORMS[word].parameters, TRANSFORMS[word].summary)
    if kind == "attribute":
        return _page(word, (), ATTRIBUTES[word].summary)
    if kind == "function" and word in FUNCTIONS:
        return _page(word, (), FUNCTIONS[word].summary)
    if kind == "setting":
        return _page(word, (), SETTINGS[word].summary)
    if kind == "constant":
        return f"`{word}` = {CONSTANTS[word]:g}"
    if word in GLOBALS:
        return f"`{word}`: a number that is known everywhere"
    if kind in ("transformation", "blend", "primitive"):
        return f"`{word}`: of fields, in a blob"
    return None


def _page(word: str, parameters: Sequence[str], text: str) -> str:
    usage = f"{word}({', '.join(parameters)})" if parameters else word
    lines = [line.strip() for line in text.strip().splitlines()]
    return f"```pcsg\n{usage}\n```\n\n" + "\n".join(lines)


def _explain_key(setting: SettingKind, word: str, key: Key) -> str:
    takes = ", ".join(f"`{w}`" for w in key.words) if key.words else key.kind.value
    default = "automatic" if key.default is None else f"{key.default}"
    return f"`{word}` of `{setting.name}`: {key.summary}\n\nTakes {takes}; by default {default}."


def definitions(files: Sequence[Names], found: Occurrence) -> list[Occurrence]:
    """Return where a name gets its meaning."""
    return [o for o in uses(files, found) if o.defines]


def uses(files: Sequence[Names], found: Occurrence) -> list[Occurrence]:
    """Return all places of a name."""
    return [
        o
        for names in files
        for o in names.occurrences
        if o.name == found.name and o.space == found.space
    ]


# Completion


def setting_around(tokens: Sequence[Token], at: int) -> SettingKind | None:
    """Return the kind of setting in whose braces token number `at` stands."""
    depth = 0
    for i in range(at - 1, -1, -1):
        kind = tokens[i].type
        depth += (kind in ("RBRACE", "RPAREN")) - (kind in ("LBRACE", "LPAREN"))
        if depth < 0 and kind == "LBRACE":
            heads = (tokens[k] for k in (i - 1, i - 2) if k >= 0)
            return next((SETTINGS[t.text] for t in heads if t.text in SETTINGS), None)
    return None


def propose(files: Sequence[Names], offset: int) -> list[Proposal]:
    """Return what may stand at an offset of the first file."""
    tokens = files[0].tokens
    # The word that is being typed is no part of what stands before it.
    at = next(
        (i for i, t in enumerate(tokens) if t.end + (is_word(t) and t.type != "STRAY") > offset),
        len(tokens),
    )
    before = tokens[at - 1] if at else None
    setting = setting_around(tokens, at)
    if before is not None and before.type == "LPAREN" and at > 1:
        word = tokens[at - 2].text
        kind = "palette" if word == "palette" else None
        refers = ATTRIBUTES[word].refers_to if word in ATTRIBUTES else kind
        if refers:
            return _own(files, refers)
    if setting is not None and before is not None and before.type in ("LBRACE", "SEMICOLON"):
        return [Proposal(w, "key", k.summary) for w, k in setting.keys.items()]
    if setting is not None and before is not None and before.type == "ASSIGN":
        key = setting.keys.get(tokens[at - 2].text)
        if key is not None and key.words:
            return [Proposal(w, "value", "") for w in key.words]
        if key is not None and key.refers_to:
            return _own(files, key.refers_to)
    if setting is not None or _in_numbers(tokens, at):
        return [*_own(files, PARAMETER, MACRO), *_words("function", "constant", "global")]
    of_solids = ("primitive", "transformation", "attribute", "loop", "blend", "setting")
    return [*_own(files, SOLID, MACRO), *_words(*of_solids)]


def _own(files: Sequence[Names], *spaces: str) -> list[Proposal]:
    found = {
        o.name: Proposal(o.name, o.space, "")
        for names in files
        for o in names.occurrences
        if o.space in spaces and o.defines
    }
    return list(found.values())


def _words(*kinds: str) -> list[Proposal]:
    listed = vocabulary()
    return [Proposal(w, kind, _summary(w, kind)) for kind in kinds for w in listed[kind]]


def _summary(word: str, kind: str) -> str:
    page = explain_word(word, kind) or ""
    return page.rpartition("```\n\n")[2].partition("\n")[0]


def _in_numbers(tokens: Sequence[Token], at: int) -> bool:
    """Whether token number `at` stands among numbers: in a call's brackets, or in a block."""
    taking = {*TRANSFORMS, *ATTRIBUTES, *LEAF_NAMES, *CALLABLE, *FIELD_UNARY, *FIELD_BLENDS}
    depth = 0
    for i in range(at - 1, -1, -1):
        kind = tokens[i].type
        depth += (kind in ("RBRACE", "RPAREN")) - (kind in ("LBRACE", "LPAREN"))
        if depth < 0:
            if kind == "LBRACE":
                return True
            if i and tokens[i - 1].text in taking:
                return True
            depth = 0
    return False


# Colours


def colours(names: Names) -> Iterator[Colour]:
    """Yield the colours of a text that are written as numbers or in quotes."""
    tokens = names.tokens
    for i, token in enumerate(tokens):
        setting = None
        if token.type == "ATTRIBUTE" and token.text == "color":
            value = i + 1
        elif i + 1 < len(tokens) and tokens[i + 1].type == "ASSIGN":
            setting = setting_around(tokens, i)
            key = setting.keys.get(token.text) if setting else None
            if key is None or key.kind is not ValueKind.COLOR:
                continue
            value = i + 2
        else:
            continue
        found = _colour_at(tokens[value : value + 7], in_brackets=setting is None)
        if found is not None:
            yield found


def _colour_at(tokens: Sequence[Token], in_brackets: bool) -> Colour | None:
    """Return the colour that tokens begin with.

    Parameters
    ----------
    in_brackets
        Whether a colour in quotes stands in brackets: `color("olive")`.
    """
    types = [t.type for t in tokens]
    quoted = tokens[in_brackets : in_brackets + 1]
    if quoted and quoted[0].type == "STRING":
        rgb = find_color(quoted[0].text[1:-1])
        if rgb is not None:
            return Colour(quoted[0].start, quoted[0].end, (rgb[0], rgb[1], rgb[2]), True)
    if types == ["LPAREN", "NUMBER", "COMMA", "NUMBER", "COMMA", "NUMBER", "RPAREN"]:
        r, g, b = (float(t.text) for t in tokens[1:6:2])
        if max(r, g, b) <= 1.0:  # brighter ones no editor can show
            return Colour(tokens[0].start, tokens[-1].end, (r, g, b), False)
    return None


def to_shown(linear: float) -> float:
    """Return a linear number as sRGB."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def colour_text(rgb: Sequence[float], quoted: bool) -> str:
    """Return how a colour of sRGB is written in place of one."""
    if quoted:
        return '"#' + "".join(f"{round(255 * x):02x}" for x in rgb) + '"'
    return "(" + ", ".join(f"{to_linear(x):.3g}" for x in rgb) + ")"


# Repairs

_MEANT = re.compile(r"did you mean `([^`]+)`\?")
_WRITE = re.compile(r"write `([^`]+)`")
_FIRST_WORD = re.compile(r"[^\W\d]\w*")


def repair(problem: Diagnostic) -> Repair | None:
    """Return the replacement that a diagnostic's help amounts to, if it is one."""
    span, hint = problem.span, problem.hint or ""
    if span is None or span.body is not None:
        return None  # what is wrong stands in a macro
    meant, write = _MEANT.fullmatch(hint), _WRITE.fullmatch(hint)
    if meant:
        word = _FIRST_WORD.match(span.text)
        quoted = f"`{word[0]}`" if word else ""
        if word and quoted in problem.message:
            end = span.start + len(word[0])
            return Repair(span.start, end, meant[1], f"Write `{meant[1]}`")
    elif write and problem.code == "stray-character":
        return Repair(span.start, span.end, write[1], f"Write `{write[1]}`")
    return None
