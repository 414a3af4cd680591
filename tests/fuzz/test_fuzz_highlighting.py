"""Pygments, the TextMate grammar and the tokens see the same in grammars that are made up."""

from __future__ import annotations

import random

from fuzz_grammars import SMALL, make
from highlights import check_agreement, told


def test_all_three_agree_on_small_grammars() -> None:
    for text in SMALL:
        check_agreement(text)


def test_all_three_agree_on_grammars_made_up() -> None:
    texts = [make(random.Random(k)) for k in range(80)]
    good = [t for t in texts if "error" not in dict(told(t)).values()]  # numbers that are none
    assert len(good) > 40
    for text in good:
        check_agreement(text)
