"""What the tokens of the language, the TextMate grammar and the Pygments lexer see in a text."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pygments.token import Comment

from pcsg.editors.pygments import PcsgLexer
from pcsg.editors.textmate import SCOPES, make_grammar
from pcsg.editors.vocabulary import kinds_of
from pcsg.errors import Source
from pcsg.grammar.tokens import tokenize, unfold_all


def told(text: str) -> list[tuple[str, str]]:
    """Return every token as it is written, and what it is."""
    tokens = unfold_all(tokenize(Source("<text>", text))[0])
    return [(text[t.start : t.end], k) for t, k in zip(tokens, kinds_of(tokens), strict=True)]


def scoped(text: str) -> Iterator[tuple[str, str]]:
    """Yield what the TextMate grammar finds, as an editor does."""
    rules = [
        (rule["name"].removesuffix(".pcsg"), re.compile(as_python(rule)))
        for rule in make_grammar()["patterns"]
    ]
    for line in re.sub(r"/\*[\s\S]*?\*/", " ", text).splitlines():
        at = 0
        while at < len(line):
            found = [
                (m.start(), k, m) for k, (_, r) in enumerate(rules) if (m := r.search(line, at))
            ]
            if not found:
                break
            _, k, match = min(found)
            if not rules[k][0].startswith("comment"):
                yield match[0].strip(), rules[k][0]
            at = match.end()


def as_python(rule: dict[str, str]) -> str:
    pattern = rule.get("match", r"(?!)")
    classes = {r"[\p{L}_]": r"[^\W\d]", r"[\p{L}\p{M}\p{N}_]": r"\w"}
    for class_, ours in classes.items():
        pattern = pattern.replace(class_, ours)
    assert r"\p" not in pattern
    return pattern


def check_agreement(text: str) -> None:
    """Assert that all three see the same in a text."""
    expected = told(text)
    shown = [(w, k) for w, k in expected if not re.fullmatch(r"[(){},;]", w)]
    # A directive is one for the TextMate grammar.
    merged: list[tuple[str, str]] = []
    for word, kind in shown:
        if kind == "directive" and merged and merged[-1] == ("#", kind):
            merged[-1] = (f"#{word}", kind)
        else:
            merged.append((word, kind))
    assert [(re.sub(r"^#\s*", "#", w), s) for w, s in scoped(text)] == [
        (w, SCOPES[k]) for w, k in merged
    ]
    pieces = list(PcsgLexer().get_tokens_unprocessed(text))
    assert "".join(value for _, _, value in pieces) == text
    cut = [v for _, t, v in pieces if t not in Comment or t in Comment.Preproc]
    assert [v for v in cut if v.strip()] == [w for w, _ in expected]
