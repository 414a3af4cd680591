"""Laws of the algebra of sets, on the oracle and on both engines.

Solids without sheets, because a sheet is no set of points. Half of them stand on small integers, so
that faces coincide; then surfaces may belong to either operand, and the laws are about intervals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import oracle
import pytest
import strategies as cases
from agreement import Judge, cast, make_states
from hypothesis import given, settings
from hypothesis import strategies as st

from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Node
from pcsg.trace.walker import Walker

Spans = list[tuple[float, float]]

# Eighteen laws share the examples of a few tests.
few = settings(max_examples=settings().max_examples // 4)

UNIVERSE = cases.prefix("uscale", 64.0) * cases.solid("box")


def complement(node: Node) -> Node:
    return UNIVERSE - node


LAWS: dict[str, Callable[[Node, Node, Node], tuple[Node, Node]]] = {
    "union commutes": lambda a, b, c: (a | b, b | a),
    "intersection commutes": lambda a, b, c: (a & b, b & a),
    "union associates": lambda a, b, c: ((a | b) | c, a | grouped(b | c)),
    "intersection associates": lambda a, b, c: ((a & b) & c, a & grouped(b & c)),
    "intersection distributes": lambda a, b, c: (a & (b | c), (a & b) | (a & c)),
    "union distributes": lambda a, b, c: (a | (b & c), (a | b) & (a | c)),
    "union absorbs": lambda a, b, c: (a | (a & b), a),
    "intersection absorbs": lambda a, b, c: (a & (a | b), a),
    "union is idempotent": lambda a, b, c: (a | a, a),
    "intersection is idempotent": lambda a, b, c: (a & a, a),
    "difference of itself": lambda a, b, c: (a - a, cases.solid("empty")),
    "empty is neutral": lambda a, b, c: ((a | cases.solid("empty")) - cases.solid("empty"), a),
    "De Morgan, union": lambda a, b, c: (
        complement(a | b),
        complement(a) & complement(b),
    ),
    "De Morgan, intersection": lambda a, b, c: (
        complement(a & b),
        complement(a) | complement(b),
    ),
    "difference is intersection": lambda a, b, c: (
        (UNIVERSE & a) - b,
        (UNIVERSE & a) & complement(b),
    ),
    "difference twice": lambda a, b, c: ((a - b) - c, a - (b | c)),
    "difference of a difference": lambda a, b, c: (a - (b - c), (a - b) | (a & c)),
    "complement twice": lambda a, b, c: (complement(complement(a)), UNIVERSE & a),
}


def grouped(node: Node) -> Node:
    """Return an operation that is not flattened into the one above."""
    return cases.prefix("move", 0, 0, 0) * node


def oracle_spans(node: Node, rays: Sequence[cases.Ray]) -> list[Spans]:
    graph = Graph(node)
    return [list(oracle.spans(oracle.events(graph, o, d))) for o, d in rays]


def walker_spans(node: Node, rays: Sequence[cases.Ray]) -> list[Spans]:
    found = Walker(Graph(node)).spans([o for o, _ in rays], [d for _, d in rays])
    pairs = list(zip(found.t_in.tolist(), found.t_out.tolist(), strict=True))
    return [pairs[a:b] for a, b in zip(found.offsets, found.offsets[1:], strict=False)]


# The engine of states leaves spans and membership to the walker, so what it adds are first hits.
ENGINES = {"oracle": oracle_spans, "walker": walker_spans}


def hair(ray: cases.Ray, t: float) -> float:
    """Return more than the tolerance, wherever the scene is."""
    reach = 4.0 + max(map(abs, ray[0]))
    return 8.0 * oracle.tolerance(t, oracle.precision((reach,) * 3, ray[1]))


def without_hairs(spans: Spans, ray: cases.Ray) -> Spans:
    """Drop gaps and pieces within the tolerance: which side they fall to depends on the order."""
    joined: Spans = []
    for low, high in spans:
        if joined and low - joined[-1][1] <= hair(ray, low):
            joined[-1] = (joined[-1][0], high)
        else:
            joined.append((low, high))
    return [(a, b) for a, b in joined if not b - a <= hair(ray, a)]


def assert_same(a: Spans, b: Spans, ray: cases.Ray) -> None:
    a, b = without_hairs(a, ray), without_hairs(b, ray)
    assert len(a) == len(b), (a, b)
    for p, q in zip(a, b, strict=True):
        for x, y in zip(p, q, strict=True):
            assert x == y or abs(x - y) <= hair(ray, y), (a, b)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("law", LAWS)
@few
@given(data=st.data())
def test_laws_hold_on_rays(law: str, engine: str, data: st.DataObject) -> None:
    integral = data.draw(st.booleans())
    parts = [data.draw(cases.solids(integral, False, 1)) for _ in range(3)]
    left, right = LAWS[law](*parts)
    rays = data.draw(cases.many_rays(Graph(left), 4))
    answers = (ENGINES[engine](node, rays) for node in (left, right))
    for a, b, ray in zip(*answers, rays, strict=True):
        assert_same(a, b, ray)


@pytest.mark.parametrize("law", LAWS)
@few
@given(data=st.data())
def test_laws_hold_for_first_hits_of_states(law: str, data: st.DataObject) -> None:
    parts = [data.draw(cases.solids(False, False, 1)) for _ in range(3)]
    left, right = (Graph(node) for node in LAWS[law](*parts))
    rays = data.draw(cases.many_rays(left, 8))
    for graph in (left, right):
        judge = Judge(make_states(graph), graph)
        found = cast(judge.tracer, rays)
        for i, ray in enumerate(rays):
            judge.hit(ray, found, i)


TABLES: dict[str, tuple[Callable[[Node, Node], Node], Callable[[bool, bool], bool]]] = {
    "union": (lambda a, b: a | b, lambda a, b: a or b),
    "intersection": (lambda a, b: a & b, lambda a, b: a and b),
    "difference": (lambda a, b: a - b, lambda a, b: a and not b),
}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("operator", TABLES)
@given(data=st.data())
def test_membership_is_the_truth_table(operator: str, engine: str, data: st.DataObject) -> None:
    combine, truth = TABLES[operator]
    integral = data.draw(st.booleans())
    a = data.draw(cases.solids(integral, False, 2))
    b = data.draw(cases.solids(integral, False, 2))
    whole = combine(a, grouped(b))
    rays = data.draw(cases.many_rays(Graph(whole), 4))
    ts = np.array(data.draw(st.lists(st.floats(-8, 8), min_size=1, max_size=10)))
    spans = [ENGINES[engine](node, rays) for node in (whole, a, b)]
    for s, sa, sb, ray in zip(*spans, rays, strict=True):
        ends = [x for pair in (*s, *sa, *sb) for x in pair if math.isfinite(x)]
        between = [0.5 * (x + y) for x, y in zip(sorted(ends), sorted(ends)[1:], strict=False)]
        for t in (*ts, *between):
            if any(abs(t - x) <= hair(ray, x) for x in ends):
                continue
            inside, in_a, in_b = (any(low < t < high for low, high in x) for x in (s, sa, sb))
            assert inside == truth(in_a, in_b), (t, s, sa, sb)


@pytest.mark.parametrize("operator", TABLES)
@given(data=st.data())
def test_points_obey_the_truth_table(operator: str, data: st.DataObject) -> None:
    combine, truth = TABLES[operator]
    integral = data.draw(st.booleans())
    a = data.draw(cases.solids(integral, False, 2))
    b = data.draw(cases.solids(integral, False, 2))
    coordinates = st.integers(-3, 3).map(float) if integral else st.floats(-3, 3)
    points = data.draw(st.lists(st.tuples(*[coordinates] * 3), min_size=1, max_size=20))
    graphs = [Graph(combine(a, grouped(b))), Graph(a), Graph(b)]
    # A move by nothing is exact, so membership on a face is decided alike.
    for p in points:
        inside, in_a, in_b = (oracle.contains(g, p) for g in graphs)
        assert inside == truth(in_a, in_b)
    answers = [Walker(g).contains(points) for g in graphs]
    for inside, in_a, in_b in zip(*answers, strict=True):
        assert inside == truth(in_a, in_b)
