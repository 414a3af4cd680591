"""What editors ask about grammars that are being typed: spoilt ones, at any place."""

from __future__ import annotations

import random
from pathlib import Path

import fuzz_grammars
from driver import Subject

from pcsg.editors.assistance import colours, explain, propose, repair, uses
from pcsg.editors.symbols import files_of
from pcsg.errors import Source
from pcsg.grammar import check_text


def run(text: str, _folder: Path) -> None:
    source = Source("<text>", text)
    files = files_of(source, {})
    for found in files[0].occurrences:
        assert text[found.start : found.end]
        assert found in uses(files, found)
    rng = random.Random(len(text))
    for offset in (0, len(text), *(rng.randrange(len(text) + 1) for _ in range(8))):
        explain(files, offset, {})
        propose(files, offset)
    for colour in colours(files[0]):
        assert 0 <= colour.start < colour.end <= len(text)
    for problem in check_text(text)[1]:
        fix = repair(problem)
        assert fix is None or text[fix.start : fix.end] != fix.text


SUBJECT = Subject("editing", fuzz_grammars.seeds, fuzz_grammars.mutate, run)
