from __future__ import annotations

import random
import time
from collections.abc import Sequence
from itertools import combinations, pairwise

from hypothesis import example, given
from hypothesis import strategies as st

from pcsg.graph.layout import Box, Layout, find_back_edges, lay_out

Heads = list[list[int]]


@st.composite
def cyclic_graphs(draw: st.DrawFn) -> Heads:
    """Return successors of every vertex; all are reached from the first."""
    count = draw(st.integers(1, 14))
    heads: Heads = [[] for _ in range(count)]
    for v in range(1, count):
        heads[draw(st.integers(0, v - 1))].append(v)
    for _ in range(draw(st.integers(0, 12))):
        heads[draw(st.integers(0, count - 1))].append(draw(st.integers(0, count - 1)))
    return heads


def boxes_for(heads: Heads, seed: int = 0) -> list[Box]:
    rng = random.Random(seed)
    boxes = []
    for below in heads:
        gap = rng.choice([0.0, 22.0])
        width = max(rng.uniform(20, 250), gap * len(below) + 12.0)
        boxes.append(Box(width, rng.uniform(20, 90), 26.0 * bool(gap), width - 32.0, gap))
    return boxes


def reachable(heads: Sequence[Sequence[int]], start: int) -> set[int]:
    seen, stack = {start}, [start]
    while stack:
        for w in heads[stack.pop()]:
            if w not in seen:
                seen.add(w)
                stack.append(w)
    return seen


def rectangles(boxes: list[Box], layout: Layout) -> list[tuple[float, float, float, float]]:
    return [
        (x - b.width / 2, y, x + b.width / 2, y + b.height + b.foot)
        for b, (x, y) in zip(boxes, layout.centres, strict=True)
    ]


@given(cyclic_graphs())
def test_back_edges_are_exactly_those_that_close_cycles(heads: Heads) -> None:
    back = find_back_edges(heads)
    forward = [[w for k, w in enumerate(ws) if (v, k) not in back] for v, ws in enumerate(heads)]
    for v, ws in enumerate(forward):
        assert all(v not in reachable(forward, w) for w in ws)
    for v, k in back:
        assert v in reachable(forward, heads[v][k])


@given(cyclic_graphs(), st.integers(0, 99))
@example([[1, 2, 3], [], [1, 4], [0, 2], [0, 0]], 0)
def test_nothing_overlaps_and_every_edge_is_drawn(heads: Heads, seed: int) -> None:
    boxes = boxes_for(heads, seed)
    layout = lay_out(boxes, heads)
    frames = rectangles(boxes, layout)
    for (a, b, c, d), (e, f, g, h) in combinations(frames, 2):
        assert c <= e + 1e-6 or g <= a + 1e-6 or d <= f + 1e-6 or h <= b + 1e-6
    for left, top, right, bottom in frames:
        assert left >= 0 and top >= 0 and right <= layout.width and bottom <= layout.height
    edges = [(v, k, w) for v, ws in enumerate(heads) for k, w in enumerate(ws)]
    back = find_back_edges(heads)
    assert len(layout.routes) == len(edges)
    for (v, k, w), route in zip(edges, layout.routes, strict=True):
        assert route.back == ((v, k) in back)
        start, end = route.points[0], route.points[-1]
        left, _, right, bottom = frames[v]
        assert left <= start[0] <= right and abs(start[1] - (bottom - boxes[v].foot)) < 1e-6
        if route.back:
            assert end[0] in (frames[w][0], frames[w][2])
            assert frames[w][1] <= end[1] <= frames[w][3]
            for (x0, y0), (x1, y1) in zip(route.points, route.points[1:], strict=False):
                assert x0 == x1 or y0 == y1
        else:
            assert end == layout.centres[w]
            assert layout.layers[v] < layout.layers[w]
            ys = [y for _, y in route.points]
            assert ys == sorted(ys)


@given(cyclic_graphs(), st.integers(0, 99))
def test_no_edge_runs_through_a_box(heads: Heads, seed: int) -> None:
    boxes = boxes_for(heads, seed)
    layout = lay_out(boxes, heads)
    frames = rectangles(boxes, layout)
    owners = [v for v, ws in enumerate(heads) for _ in ws]
    targets = [w for ws in heads for w in ws]
    for v, w, route in zip(owners, targets, layout.routes, strict=True):
        for (x0, y0), (x1, y1) in zip(route.points, route.points[1:], strict=False):
            low, high = min(x0, x1), max(x0, x1)
            top, bottom = min(y0, y1), max(y0, y1)
            for u, (a, b, c, d) in enumerate(frames):
                if u not in (v, w):
                    assert high <= a or low >= c or bottom <= b + 1e-6 or top >= d - 1e-6


@given(cyclic_graphs())
def test_the_layout_is_always_the_same(heads: Heads) -> None:
    boxes = boxes_for(heads)
    assert lay_out(boxes, heads) == lay_out(boxes, heads)


def test_labels_of_edges_have_room() -> None:
    heads = [[k + 1 for k in range(6)], *([] for _ in range(6))]
    layout = lay_out([Box(150, 40, 26, 118, 22), *(Box(60, 30) for _ in range(6))], heads)
    ports = sorted(route.points[0][0] for route in layout.routes)
    assert all(b - a >= 22 for a, b in pairwise(ports))


def test_a_tree_keeps_the_order_of_the_text_and_long_edges_are_straight() -> None:
    heads = [[1, 2, 3], [4], [], [5], [], [6], []]
    layout = lay_out([Box(50, 30)] * 7, heads)
    assert layout.centres[1][0] < layout.centres[2][0] < layout.centres[3][0]
    for route in layout.routes[3:]:
        assert len({x for x, _ in route.points}) == 1
    long_edge = [[1, 4], [2], [3], [4], []]
    route = lay_out([Box(50, 30)] * 5, long_edge).routes[1]
    inner = {x for x, _ in route.points[2:-1]}
    assert len(inner) == 1


def test_edges_back_share_one_lane() -> None:
    heads = [[1], [2], [3, 4, 5], [1], [1], [1]]
    layout = lay_out([Box(80, 30)] * 6, heads)
    back = [route for route in layout.routes if route.back]
    assert len(back) == 3
    assert len({route.points[-3:] for route in back}) == 1


def test_thousands_of_boxes_take_seconds() -> None:
    rng = random.Random(1)
    heads: Heads = [[] for _ in range(3000)]
    for v in range(1, 3000):
        heads[rng.randrange(max(0, v - 60), v)].append(v)
        if v % 3 == 0:
            heads[v].append(rng.randrange(3000))
    began = time.process_time()
    layout = lay_out([Box(60, 30)] * 3000, heads)
    assert len(layout.routes) == sum(map(len, heads))
    assert time.process_time() - began < 20


def test_a_long_chain_is_no_recursion() -> None:
    heads = [[k + 1] for k in range(20_000)] + [[0]]
    layout = lay_out([Box(40, 20)] * 20_001, heads)
    assert layout.layers[-1] == 20_000
    assert len({x for x, _ in layout.centres}) == 1
