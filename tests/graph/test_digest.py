"""Digests tell graphs apart that make other pictures, and no others."""

from __future__ import annotations

import pytest

from pcsg.grammar import load_text
from pcsg.graph.digest import digest_of

TEXT = """{n = 3} A | move(0, 0, 2) material(gold) sphere
A if(n > 0, 2, 1)
1: A -> box
2: A -> uscale(0.5) {n = n - 1} (A | cone(0.5))
material gold { color = (1, 0.8, 0.2) }
"""


def test_a_digest_does_not_depend_on_how_a_text_is_laid_out() -> None:
    assert digest_of(load_text(TEXT)) == digest_of(load_text(TEXT.replace(" ", "  ")))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("n = 3", "n = 4"),
        ("sphere", "torus(0.5)"),
        ("A | cone", "A \\ cone"),
        ("cone(0.5)", "cone(0.25)"),
        ("move(0, 0, 2)", "move(0, 0, -2)"),
        ("uscale(0.5)", "scale(0.5, 0.5, 0.5)"),
        ("0.8", "0.7"),
        ("n - 1", "n - 2"),
        (" material(gold) sphere", " sphere"),
        ("uscale(0.5)", "uscale(n / 9)"),
    ],
)
def test_other_graphs_have_other_digests(old: str, new: str) -> None:
    assert digest_of(load_text(TEXT)) != digest_of(load_text(TEXT.replace(old, new)))
