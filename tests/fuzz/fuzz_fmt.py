"""Formatting grammars, spoilt and made up: what they say stays, and once is enough."""

from __future__ import annotations

from pathlib import Path

import fuzz_grammars
from driver import Subject

from pcsg.errors import Source
from pcsg.grammar import check_text
from pcsg.grammar.formatting import format_text
from pcsg.grammar.tokens import tokenize, unfold_all
from pcsg.graph.digest import digest_of


def words_of(text: str) -> list[tuple[str, str, bool]]:
    """Return the tokens, one for each number."""
    tokens, _ = tokenize(Source("<text>", text))
    parts = unfold_all(tokens)
    return [(p.type, p.text, p.first) for p in parts]


def run(text: str, _folder: Path) -> None:
    made = format_text(Source("<text>", text))
    assert format_text(Source("<text>", made)) == made
    assert words_of(made) == words_of(text)
    before, problems = check_text(text)
    after, again = check_text(made)
    assert [(p.code, p.message) for p in again] == [(p.code, p.message) for p in problems]
    assert (before is None) == (after is None)
    if before is not None and after is not None:
        assert digest_of(after) == digest_of(before)


SUBJECT = Subject("fmt", fuzz_grammars.seeds, fuzz_grammars.mutate, run)
