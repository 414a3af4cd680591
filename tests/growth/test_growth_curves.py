"""Curves against scipy's, and what is wrong with files of species."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline, PchipInterpolator

from pcsg.errors import GrammarError, UsageError
from pcsg.growth.curves import Curve, smooth_step
from pcsg.growth.species import CURVES, Species, load_species, read_species, shipped

GRID = np.linspace(0.0, 1.0, 501)


@st.composite
def polygons(draw: st.DrawFn) -> list[tuple[float, float]]:
    inner = draw(st.sets(st.integers(1, 99), max_size=8))
    xs = [0.0, *(k / 100 for k in sorted(inner)), 1.0]
    return [(x, draw(st.integers(-50, 50)) / 10) for x in xs]


@given(polygons())
def test_pchip_is_that_of_scipy(points: list[tuple[float, float]]) -> None:
    x, y = np.array(points).T
    expected = PchipInterpolator(x, y)(GRID)
    found = Curve.make(points)(GRID)
    assert np.abs(found - expected).max() <= 1e-13 * max(1.0, np.abs(y).max())


@given(polygons())
def test_pchip_stays_between_its_points(points: list[tuple[float, float]]) -> None:
    x, y = np.array(points).T
    found = Curve.make(points)(GRID)
    k = np.clip(np.searchsorted(x, GRID, side="right") - 1, 0, len(x) - 2)
    assert (found >= np.minimum(y[k], y[k + 1]) - 1e-12).all()
    assert (found <= np.maximum(y[k], y[k + 1]) + 1e-12).all()


@given(polygons())
def test_bspline_is_that_of_scipy(points: list[tuple[float, float]]) -> None:
    p = np.array(points)
    degree = min(3, len(p) - 1)
    knots = np.concatenate(
        [np.zeros(degree), np.linspace(0.0, 1.0, len(p) - degree + 1), np.ones(degree)]
    )
    x, y = BSpline(knots, p, degree)(np.linspace(0.0, 1.0, 200)).T
    # The curve is kept as a polyline of 2048 pieces: where x stands still its ends differ most.
    assert np.abs(Curve.make(points, "bspline")(x) - y).max() <= 0.05
    assert np.median(np.abs(Curve.make(points, "bspline")(x) - y)) <= 1e-4


def test_arguments_are_clamped() -> None:
    for kind in ("pchip", "bspline", "linear"):
        curve = Curve.make([(0, 1), (0.5, 3), (1, 2)], kind)
        assert curve(-1.0) == 1.0 and curve(2.0) == 2.0


def test_the_step_has_flat_ends() -> None:
    h = 1e-4
    assert smooth_step(0.0) == 0.0 and smooth_step(1.0) == 1.0
    assert smooth_step(h) < 1e-10 and 1.0 - smooth_step(1.0 - h) < 1e-10


@pytest.mark.parametrize("name", shipped())
def test_shipped_species_come_back_from_their_text(name: str) -> None:
    one = load_species(name)
    assert read_species(one.to_json()) == one


def test_defaults_are_populus() -> None:
    assert load_species("populus") == Species()
    assert {n: c.points for n, c in Species().curves.items()} == {
        n: tuple((float(x), float(y)) for x, y in p) for n, p in CURVES.items()
    }


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
    '{"radius": {"rule": "pipe"}}': "one of distance",  # it was taken, and did nothing
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


def test_all_mistakes_at_once() -> None:
    with pytest.raises(GrammarError) as caught:
        read_species('{"ymax": 0, "lmin": -1, "leaf": {"form": "round"}, "what": 1}')
    assert len(caught.value.diagnostics) == 4


@given(st.text(max_size=40) | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(repr))
def test_any_text_is_a_species_or_a_diagnostic(text: str) -> None:
    with contextlib.suppress(GrammarError):
        read_species(text)


def test_no_such_species(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="did you mean `populus`"):
        load_species("populos")
    with pytest.raises(UsageError):
        load_species(tmp_path / "none.json")
