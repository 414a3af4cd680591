"""Files of species: read, written, and what is wrong with them told all at once."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline, PchipInterpolator

from pcsg.errors import GrammarError, UsageError
from pcsg.growth.curves import Curve, smooth_step
from pcsg.growth.species import Species, load_species, read_species, shipped

GRID = np.linspace(0.0, 1.0, 257)


@st.composite
def points(draw: st.DrawFn) -> list[tuple[float, float]]:
    inner = draw(st.lists(st.integers(1, 99), max_size=6, unique=True))
    places = [0.0, *(k / 100 for k in sorted(inner)), 1.0]
    return [(x, draw(st.integers(0, 40)) / 8) for x in places]


@given(points())
def test_pchip_is_scipys(chosen: list[tuple[float, float]]) -> None:
    x, y = zip(*chosen, strict=True)
    expected = PchipInterpolator(x, y)(GRID)
    assert np.abs(Curve.make(chosen)(GRID) - expected).max() < 1e-12


@given(points())
def test_bsplines_are_scipys(chosen: list[tuple[float, float]]) -> None:
    p = np.array(chosen)
    k = min(3, len(p) - 1)
    inner = np.linspace(0.0, 1.0, len(p) - k + 1)
    knots = np.concatenate([np.zeros(k), inner, np.ones(k)])
    on_curve = BSpline(knots, p, k)(np.linspace(0.0, 1.0, 301))
    curve = Curve.make(chosen, "bspline")
    assert np.abs(curve(on_curve[:, 0]) - on_curve[:, 1]).max() < 1e-3


def test_steps_have_flat_ends() -> None:
    assert smooth_step([-1.0, 0.0, 0.5, 1.0, 2.0]).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]
    near = smooth_step(1e-3)
    assert near < 2e-8


@pytest.mark.parametrize("name", shipped())
def test_what_is_written_is_read(name: str) -> None:
    species = load_species(name)
    assert read_species(species.to_json()) == species


def test_the_shipped_poplar_is_the_default() -> None:
    assert load_species("populus") == Species()


BAD = """{
  "species": "x", "sead": 3,
  "ymax": 0.5, "lmin": -1,
  "leaf": {"form": "round", "green": [1, 2, 3]},
  "season": {"fall": [0.9, 0.7]},
  "curves": {
    "G_h": {"points": [[0, 0], [0.5, 1], [0.5, 2], [0.9, 1]]},
    "G_x": {"points": [[0, 0], [1, 1]]},
    "G_m": {"type": "wavy", "points": [[0, 2], [1, "a"]]}
  }
}
"""


def test_all_mistakes_are_told_at_once() -> None:
    with pytest.raises(GrammarError) as caught:
        read_species(BAD, "bad.json")
    told = [(d.span.line if d.span else 0, d.message) for d in caught.value.diagnostics]
    assert told == [
        (2, "there is no key `sead`"),
        (3, "this cannot be `ymax`"),
        (3, "this cannot be `lmin`"),
        (4, "this cannot be `form`"),
        (4, "this cannot be `green`"),
        (5, "this cannot be `fall`"),
        (7, "x does not increase"),
        (7, "the last point is not at x = 1"),
        (8, "there is no key `G_x`"),
        (9, "no such type"),
        (9, "this is no point"),
    ]
    assert "did you mean `seed`?" in str(caught.value)
    assert "bad.json:3:" in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1, 2", '{"a" 1}', "{'a': 1}", '{"a": 01}', "3"])
def test_what_is_no_json_is_told_where(text: str) -> None:
    with pytest.raises(GrammarError, match="bad-species"):
        read_species(text, "x.json")


@given(st.text(max_size=40))
def test_any_text_is_json_or_a_mistake(text: str) -> None:
    try:
        read_species(text)
    except GrammarError:
        return
    json.loads(text)


def test_a_missing_file_names_what_there_is() -> None:
    with pytest.raises(UsageError, match="did you mean `populus`"):
        load_species("populs")
