"""Curves between their points, and each mistake of a file by itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcsg.errors import GrammarError
from pcsg.growth.curves import Curve
from pcsg.growth.species import read_species

GRID = np.linspace(0.0, 1.0, 501)


@st.composite
def polygons(draw: st.DrawFn) -> list[tuple[float, float]]:
    inner = draw(st.sets(st.integers(1, 99), max_size=8))
    xs = [0.0, *(k / 100 for k in sorted(inner)), 1.0]
    return [(x, draw(st.integers(-50, 50)) / 10) for x in xs]


@given(polygons())
def test_pchip_stays_between_its_points(points: list[tuple[float, float]]) -> None:
    x, y = np.array(points).T
    found = Curve.make(points)(GRID)
    k = np.clip(np.searchsorted(x, GRID, side="right") - 1, 0, len(x) - 2)
    assert (found >= np.minimum(y[k], y[k + 1]) - 1e-12).all()
    assert (found <= np.maximum(y[k], y[k + 1]) + 1e-12).all()


def test_arguments_are_clamped() -> None:
    for kind in ("pchip", "bspline", "linear"):
        curve = Curve.make([(0, 1), (0.5, 3), (1, 2)], kind)
        assert curve(-1.0) == 1.0 and curve(2.0) == 2.0


WRONG = {
    '{"ymaks": 3}': "did you mean `ymax`?",
    '{"ymax": 0}': "this cannot be `ymax`",
    '{"ymax": 2.5}': "a whole number from 1 to 500",
    '{"curves": {"G_x": {"points": [[0, 0], [1, 1]]}}}': "there is no key `G_x`",
    '{"curves": {"G_h": {"points": [[0, 0], [0.5, 1]]}}}': "the last point is not at x = 1",
    '{"curves": {"G_h": {"points": [[0, 0], [0.5, 1], [0.4, 1], [1, 1]]}}}': "x does not increase",
    '{"curves": {"G_h": {"points": [[0, 0], [0.5], [1, 1]]}}}': "this is no point",
    '{"curves": {"G_h": {"type": "wavy", "points": [[0, 0], [1, 1]]}}}': "no such type",
    '{"curves": {"G_h": {"points": [[0, 0], [1, 0]]}}}': "`G_h` is 0 everywhere",
    '{"curves": {"g_int": {"points": [[0, 0.5], [1, 1]]}}}': "does not grow from 0 to 1",
    '{"season": {"burst": 0.7}}': "shoots end before they begin",
    '{"season": {"fall": [0.9, 0.8]}}': "the earlier one first",
    '{"radius": {"rule": "pipes"}}': "one of distance, pipe",
    '{"seed": true}': "this cannot be `seed`",
    '{"ymax": 3,}': "cannot stand here",
    '{"ymax": 3': "ends before it is complete",
    "[]": "this is no object",
    "": "bad-species",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes_in_a_file_are_told(text: str) -> None:
    with pytest.raises(GrammarError) as caught:
        read_species(text, "mine.json")
    assert WRONG[text] in str(caught.value)
    assert "mine.json:1:" in str(caught.value)
