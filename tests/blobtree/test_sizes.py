"""Sizes of fields that single precision cannot hold are told."""

from __future__ import annotations

import pytest

import pcsg
from pcsg.errors import GrammarError


@pytest.mark.parametrize(
    "text",
    [
        "blob { point(1e-300) }",
        "blob { point(1e300) }",
        "blob { segment(1e300, 1) }",
        "blob { rotx(30) scale(1, 2, 3) cone(2, 1e-200, 0.5) }",
        "blob { taper(1e-300, 0.5) segment(2, 1) }",
        "blob { uscale(1e25) uscale(1e25) point(1) }",
        "blob { move(1e200, 0, 0) point(1) }",
    ],
)
def test_sizes_beyond_measure_are_told(text: str) -> None:
    with pytest.raises(GrammarError, match="this `blob` cannot be made"):
        assert pcsg.loads(text).stats()
