"""Loops mean the unions that they are short for."""

from __future__ import annotations

import math

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pcsg
from pcsg.errors import GrammarError
from pcsg.grammar import check_text, load_text


def placed(text: str) -> list[tuple[float, ...]]:
    """Return the places of all leaves, in the order of the text."""
    leaves = [leaf for leaf in oracle.leaves(load_text(text)) if leaf.name != "empty"]
    return [(*(x for row in leaf.frame for x in row), *leaf.args) for leaf in leaves]


@pytest.mark.parametrize(
    ("first", "last", "step", "values"),
    [
        ("1", "5", None, [1, 2, 3, 4, 5]),
        ("0", "1", "0.25", [0, 0.25, 0.5, 0.75, 1]),
        ("0", "0.3", "0.1", [0, 0.1, 0.2, 0.1 * 3]),
        ("3", "1", "-1", [3, 2, 1]),
        ("2", "2", None, [2]),
        ("2", "2.9", None, [2]),
        ("2", "1", None, []),
        ("1", "2", "-1", []),
    ],
)
def test_a_for_has_a_copy_for_each_value(
    first: str, last: str, step: str | None, values: list[float]
) -> None:
    given_step = "" if step is None else f", {step}"
    text = f"{{}} (for(i, {first}, {last}{given_step}) move(i, 0, 0) box | move(0,9,0) sphere)"
    moved = " | ".join([*(f"move({v!r}, 0, 0) box" for v in values), "move(0,9,0) sphere"])
    assert placed(text) == placed(f"{{}} ({moved})")


@given(st.integers(1, 40), st.floats(-3, 3), st.floats(0.1, 2))
def test_the_number_of_copies_is_that_of_the_range(n: int, first: float, step: float) -> None:
    last = first + (n - 1) * step
    text = f"for(i, {first!r}, {last!r}, {step!r}) move(i,0,0) box"
    assert len(placed(text)) == n


@pytest.mark.parametrize("count", ["0", "1", "4", "3.7", "-2"])
def test_a_repeat_puts_each_copy_into_the_frame_of_the_one_before(count: str) -> None:
    text = f"{{s = 1}} (repeat({count}, {{s = s/2}} move(0,0,s) rotz(90)) uscale(s) box | sphere)"
    copies = ["{s = 1} "]
    for _ in range(round(float(count)) - 1):
        copies.append(copies[-1] + "{s = s/2} move(0,0,s) rotz(90) ")
    shown = copies if round(float(count)) > 0 else []
    expected = " | ".join([*(f"{c}uscale(s) box" for c in shown), "sphere"])
    assert placed(text) == placed(f"{{}} ({expected})")


def test_loops_stand_in_loops_and_see_what_is_around_them() -> None:
    text = "{n = 3} for(i, 1, n) for(j, i, n) repeat(i, move(0,0,1)) move(4*i, 4*j, 0) box"
    scene = pcsg.loads(text)
    assert scene.stats()["primitives"] == sum(i for i in range(1, 4) for j in range(i, 4))
    assert set(scene.parameters) == {"n", "SEED", "TIME"}
    assert pcsg.loads(text, n=1).stats()["primitives"] == 1


def test_an_axiom_that_begins_with_a_loop_has_no_parameters_of_its_own() -> None:
    scene = pcsg.loads("for(i, 1, 3) move(i,0,0) box | sphere")
    assert set(scene.parameters) == {"SEED", "TIME"}


def test_a_long_for_is_not_deep() -> None:
    scene = pcsg.loads("for(i, 1, 20000) move(3*i, 0, 0) sphere")
    hits = scene.intersect([[60_000, 0, -5]], [[0, 0, 1]])
    assert math.isclose(hits.t[0], 4.0)


def test_loops_are_written_back_as_modules() -> None:
    text = (
        "{s = 1} (repeat(5, {s = 0.9*s} move(0,0,1)) uscale(s) box | for(i,0,2) move(i,0,0) cone)"
    )
    again = load_text(pcsg.loads(text).to_pcsg())
    rays = np.random.default_rng(1).normal(size=(200, 3))
    hits = [s.intersect(4 * rays, -rays).t for s in (pcsg.loads(text), pcsg.Scene(again))]
    np.testing.assert_array_equal(*hits)


@pytest.mark.parametrize(
    "text",
    [
        "repeat\n1: repeat -> box",
        "w: repeat(3)\np: repeat(n) : n > 1 -> move(n,0,0) box | repeat(n-1)\nq: repeat(n) -> box",
        "{for = 3} uscale(for) box",
        "for | box\nfor = sphere",
    ],
)
def test_names_of_loops_are_free_for_those_who_use_them(text: str) -> None:
    assert check_text(text)[1] == []


MISTAKES = {
    "for(i,1) box": "`for` takes 3 to 4 arguments, not 2",
    "for(i,1,5,0) box": "a step of 0 never gets anywhere",
    "for(i,1;2) box": "`for` takes no `;` among its arguments",
    "for(i,1,2) move(i,0,0)": "the file ends behind `)`",
    "for(i = 0; i < 3) box": "`for(i, 0, 9) ...`",
    "repeat(5) box": "unexpected `)`",
    "repeat(5, box) box": "a transformation or a block",
    "repeat(2, move(j,0,0)) box": "parameter `j` is never assigned",
    "repeat(2, move(1,0)) box": "`move` takes 3 arguments, not 2",
    "repeat(2, {x = foo(1)} move(x,0,0)) box": "unknown function `foo`",
    "repeat(bar(2), move(1,0,0)) box": "unknown function `bar`",
    "blob { repeat(3, move(0,0,1)) point(1) }": "`repeat` repeats solids",
    "10 * box": "repeat(10, move(1,0,0) rotz(36)) box",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_mistakes_in_loops_are_told_where_they_are(text: str) -> None:
    with pytest.raises(GrammarError) as told:
        pcsg.loads(text)
    assert MISTAKES[text] in str(told.value)


@pytest.mark.parametrize(
    ("loop", "body"),
    [
        ("for(i, 0, 1e9)", "box"),
        ("for(i, 0, 1e9) label(3)", "(box | move(4,0,0) (box \\ sphere))"),
        ("repeat(1e3, rotz(0))", "box"),
    ],
)
def test_copies_in_the_same_place_are_one(loop: str, body: str) -> None:
    """A billion of them would be entered by every ray."""
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(200, 3)) * 6
    aims = rng.uniform(-1.2, 1.2, (200, 3)) - origins
    many, one = (pcsg.loads(text) for text in (f"{{}} {loop} {body}", f"{{}} label(3) {body}"))
    hits, expected = (scene.intersect(origins, aims) for scene in (many, one))
    np.testing.assert_array_equal(hits.t, expected.t)
    np.testing.assert_array_equal(hits.normal, expected.normal)
    assert np.isfinite(hits.t).any()
    np.testing.assert_array_equal(many.contains(origins / 5), one.contains(origins / 5))
