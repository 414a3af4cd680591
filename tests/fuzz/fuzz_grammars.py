"""Grammars, spoilt: whatever a file holds, what follows is told as its mistake."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from mutations import spoil_text

from pcsg.grammar import check_text
from pcsg.grammar.tokens import words
from pcsg.graph.functions import FUNCTIONS

GRAMMARS = Path(__file__).parents[2] / "grammars"

WORDS = (
    *(f"{word} " for word in words()),
    *(f"{name}(" for name in FUNCTIONS),
    *"(){}|&\\-=:;,\n",
    "->",
    "#define ",
    "{c = c-1} ",
    "2: ",
)


def seeds() -> Sequence[str]:
    return [p.read_text(encoding="utf-8") for p in sorted(GRAMMARS.glob("*.pcsg"))]


def mutate(rng: random.Random, text: str) -> str:
    return spoil_text(rng, text, WORDS)


def run(text: str, _folder: Path) -> None:
    graph, diagnostics = check_text(text)
    errors = [d for d in diagnostics if d.severity == "error"]
    assert (graph is None) == bool(errors)
    for d in diagnostics:
        assert d.render()


SUBJECT = Subject("grammars", seeds, mutate, run)
