from __future__ import annotations

import math

import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import expressions

from pcsg.graph.expr import Expr, P, apply, call, if_
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.intervals import (
    ALL,
    Interval,
    evaluate,
    is_point,
    keeps_distances,
    transform_intervals,
    transform_matrix,
)
from pcsg.graph.transforms import TRANSFORMS

ENDS = st.one_of(
    st.integers(-4, 4).map(float),
    st.sampled_from([90.0, 270.0, -450.0, 0.5, 1e-9]),
    st.floats(-400.0, 400.0),
)


@st.composite
def intervals_and_points(draw: st.DrawFn) -> tuple[Interval, float]:
    a, b = sorted((draw(ENDS), draw(ENDS)))
    if draw(st.integers(0, 3)) == 0:
        b = a
    # Between 0 and -0, in that order, hypothesis finds nothing.
    between = st.floats(a + 0.0 if a < b else a, b if a < b else a)
    return (a, b), draw(st.sampled_from([a, b, min(max((a + b) / 2, a), b)]) | between)


def assert_inside(expr: Expr, given_: dict[str, tuple[Interval, float]]) -> None:
    values = {name: point for name, (_, point) in given_.items()}
    try:
        value = oracle.evaluate(expr, values, oracle.IDENTITY)
    except oracle.Fault:
        return
    found = evaluate(expr, {name: interval for name, (interval, _) in given_.items()})
    assert found[0] <= value <= found[1], (expr, given_, value, found)


@pytest.mark.parametrize(
    "name", [n for n, f in FUNCTIONS.items() if f.form not in (Form.WORLD, Form.COLUMN)]
)
@given(data=st.data())
def test_extensions_contain_every_value(name: str, data: st.DataObject) -> None:
    least, most = FUNCTIONS[name].arity
    count = least if most else data.draw(st.integers(least, least + 2))
    names = "abcdef"[:count]
    given_ = {n: data.draw(intervals_and_points()) for n in names}
    args = [getattr(P, n) for n in names]
    assert_inside(apply(name, *args, seeds=1 if name == "choose" else 0), given_)


def test_a_remainder_whose_quotient_is_rounded_to_zero_is_contained() -> None:
    assert_inside(P.a % P.b, {"a": ((0.0, 5e-324), 5e-324), "b": ((-2.0, -2.0), -2.0)})


@given(expressions(("a", "b"), world=False), intervals_and_points(), intervals_and_points())
def test_expressions_contain_every_value(
    expr: Expr, a: tuple[Interval, float], b: tuple[Interval, float]
) -> None:
    assert_inside(expr, {"a": a, "b": b})


def test_single_numbers_stay_single_numbers() -> None:
    expr = call("sin", P.a) * call("rand", P.a, 3) - call("pow", P.a, 0.5)
    values = {"a": 7.3}
    expected = oracle.evaluate(expr, values, oracle.IDENTITY)
    found = evaluate(expr, {"a": (7.3, 7.3)})
    assert is_point(found)
    assert found[0] == expected


@pytest.mark.parametrize(
    ("expr", "expected"),
    [
        (call("sin", P.a), (0.0, 1.0)),
        (call("cos", P.a), (-1.0, 1.0)),
        (P.a / 2, (0.0, 90.0)),
        (if_(P.a >= 0, 1, call("ln", P.a)), (1.0, 1.0)),
        (if_(P.a > 90, 1, 3), (1.0, 3.0)),
        (call("rand", P.a), (0.0, 1.0)),
        (call("abs", P.a - 180), (0.0, 180.0)),
        (call("mod", P.a, 50), (0.0, 50.0)),
        (1 / P.a, (1 / 180, math.inf)),
        (P.nothing, ALL),
        (call("atan2", 1, P.a), (0.318, 90.0)),
        (call("clamp", P.a, 3, 7), (3.0, 7.0)),
    ],
)
def test_extensions_are_tight(expr: Expr, expected: Interval) -> None:
    assert evaluate(expr, {"a": (0.0, 180.0)}) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("name", TRANSFORMS)
@given(data=st.data())
def test_matrices_contain_every_matrix(name: str, data: st.DataObject) -> None:
    transform = TRANSFORMS[name]
    args = [data.draw(intervals_and_points()) for _ in transform.parameters]
    if name in ("rot", "align") and math.hypot(*(x for _, x in args[-3:-1])) < 1e-9:
        return
    rows = oracle.matrix(name, [x for _, x in args])
    found = transform_matrix(transform, [i for i, _ in args])
    flat = [x for row in rows for x in row]
    for (lower, upper), x in zip(found, flat, strict=True):
        assert lower - 1e-12 * (1 + abs(x)) <= x <= upper + 1e-12 * (1 + abs(x))
    p = (0.3, -0.7, 1.1)
    moved = [sum(r[k] * p[k] for k in range(3)) + r[3] for r in rows]
    for (lower, upper), x in zip(
        transform_intervals(found, [(v, v) for v in p]), moved, strict=True
    ):
        room = 1e-9 * (1 + abs(x))
        assert lower - room <= x <= upper + room
    if keeps_distances(transform):
        assert math.hypot(*moved) == pytest.approx(math.hypot(*p))
