"""Frames below rounding: where points and whole lines are left to the walker, and where not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.grammar import load_text
from pcsg.jit import plain
from pcsg.trace.groups import INSTANCE
from pcsg.trace.shrinking import stretch_of
from pcsg.trace.tracer import StatesTracer
from pcsg.trace.walker import Walker
from pcsg.vec import Affine

GRAMMARS = Path(__file__).parents[2] / "grammars"

VILLAGE = """
{a = 0; n = %d} STREET
STREET if(n > 1, 2, 1)
1: STREET -> move(9*rand(a,1), 9*rand(a,2), 0) rotz(360*rand(a,3)) uscale(0.1 + 0.1*rand(a,4)) HOUSE
2: STREET -> {n = floor(n/2)} STREET | {a = a + floor(n/2); n = n - floor(n/2)} STREET
HOUSE 1
1: HOUSE -> (box \\ uscale(0.8) box) | {k = 70} FENCE
FENCE if(k > 0, 2, 1)
1: FENCE -> empty
2: FENCE -> {k = k-1} FENCE | rotz(5*k) move(2,0,0) scale(0.05,0.1,0.4) box
"""
"""Houses that stand as instances of one cluster."""


def lines_through(bounds: Any, n: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(4)
    return rng.uniform(*bounds, (n, 3)), rng.normal(size=(n, 3))


@pytest.mark.parametrize("houses", [100, 3_000])
def test_points_and_lines_of_instances_need_no_walker(
    houses: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = pcsg.loads(VILLAGE % houses)
    tracer = scene.tracer
    assert isinstance(tracer, StatesTracer)
    assert ((tracer.blocks.refs & 7) == INSTANCE).sum() >= houses
    points, ways = lines_through(scene.bounds, 300)
    expected, lists = tracer.walker.contains(points), tracer.walker.spans(points, ways)
    assert expected.any() and len(lists.t_in) > 100
    monkeypatch.setattr(StatesTracer, "walker", property(lambda self: pytest.fail("walked")))
    assert np.array_equal(scene.contains(points), expected)
    found = scene.spans(points, ways)
    assert np.array_equal(found.offsets, lists.offsets)
    np.testing.assert_allclose(found.t_in, lists.t_in, atol=1e-9)
    np.testing.assert_allclose(found.t_out, lists.t_out, atol=1e-9)
    assert np.array_equal(found.leaf_in, lists.leaf_in)


ROW = """
{n = 300} ROW
ROW if(n > 0, 2, 1)
1: ROW -> empty
2: ROW -> {n = n-1} (ROW | move(3*n,0,0) box)
"""


def test_lines_with_many_intervals_need_no_walker(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = pcsg.loads(ROW)
    monkeypatch.setattr(StatesTracer, "walker", property(lambda self: pytest.fail("walked")))
    origins = [[-5.0, 0.3, 0.1 * k + 0.03] for k in range(-12, 13)]
    found = scene.spans(origins, [[1.0, 0.0, 0.0]])
    inside = np.abs([o[2] for o in origins]) < 1.0
    assert np.array_equal(np.diff(found.offsets), 300 * inside)
    np.testing.assert_allclose(np.diff(found.t_in[:300]), 3.0)


BALLS = " | ".join(f"move({k},0,0) sphere" for k in range(0, 210, 3))
SMALL = """
{c = 60} M
M if(c > 0, 2, 1)
1: M -> sphere
2: M -> uscale(0.5) {c = c-1} (M | move(1,0,0) M)
"""


@pytest.mark.parametrize(
    "text",
    [
        f"{{}} M\nM 1\n1: M -> move(1e16,0,0) N\nN 1\n1: N -> uscale(1e15) ({BALLS})",
        f"{{}} M\nM 1\n1: M -> move(1,0,0) uscale(1e-17) N\nN 1\n1: N -> uscale(1e17) ({BALLS})",
        f"{{}} M\nM 1\n1: M -> uscale(1e-160) N\nN 1\n1: N -> uscale(1e160) ({BALLS})",
        SMALL,
    ],
)
def test_frames_below_rounding_are_left_to_the_walker(text: str) -> None:
    graph = load_text(text)
    walked, scene = Walker(graph), pcsg.Scene(graph)
    tracer = scene.tracer
    assert isinstance(tracer, StatesTracer) and tracer._may_shrink
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1e16, 0, 0], [0.999, 0, 0]])
    assert np.array_equal(scene.contains(points), walked.contains(points))


@pytest.mark.parametrize("order", [6, 40])
def test_deep_fractals_are_far_from_rounding(order: int) -> None:
    tracer = pcsg.load(GRAMMARS / "sierpinski.pcsg", c=order).tracer
    assert isinstance(tracer, StatesTracer) and not tracer._may_shrink


def test_plants_of_many_turns_are_far_from_rounding() -> None:
    tracer = pcsg.load(GRAMMARS / "tree.pcsg").tracer
    assert isinstance(tracer, StatesTracer) and not tracer._may_shrink


def test_a_map_stretches_by_its_largest_singular_value() -> None:
    rng = np.random.default_rng(5)
    stretch = plain(stretch_of)
    for kind in range(300):
        m = rng.normal(size=(3, 3))
        if kind % 3 == 1:
            m = np.linalg.qr(m)[0] * 10.0 ** rng.uniform(-9, 9)
        elif kind % 3 == 2:
            m = m * 10.0 ** rng.uniform(-5, 5, 3)
        rows = np.hstack([m, rng.normal(size=(3, 1))])
        assert stretch(Affine(*rows.ravel())) == pytest.approx(np.linalg.norm(m, 2), rel=1e-6)
