"""The cyclic walker finds what the oracle finds."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import oracle
import pytest
import strategies as cases
from agreement import Judge, Ray, cast
from hypothesis import assume, event, given
from hypothesis import strategies as st

from pcsg.errors import EvaluationFault, UsageError
from pcsg.graph.build import C, S
from pcsg.graph.expr import P, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Calculation, Node
from pcsg.graph.states import enumerate_states
from pcsg.trace.walker import Walker

move, solid, prefix = (
    lambda x, y=0.0, z=0.0: cases.prefix("move", x, y, z),
    cases.solid,
    cases.prefix,
)
BALL, BOX = solid("sphere"), solid("box")


def judge_all(graph: Graph, rays: Sequence[Ray], limits: Sequence[tuple[float, float]]) -> Judge:
    """Compare all queries of some rays."""
    walker = Walker(graph)
    judge = Judge(walker)
    for low, high in limits:
        found = cast(walker, rays, low, high)
        blocked = walker.occluded([o for o, _ in rays], [d for _, d in rays], low, high)
        assert (blocked == (found.leaf >= 0)).all()
        for i, ray in enumerate(rays):
            judge.hit(ray, found, i, low, high)
    spans = walker.spans([o for o, _ in rays], [d for _, d in rays])
    for i, ray in enumerate(rays):
        k = slice(spans.offsets[i], spans.offsets[i + 1])
        judge.spans(ray, list(zip(spans.t_in[k], spans.t_out[k], strict=True)))
    return judge


WINDOWS = st.one_of(
    st.just((0.0, math.inf)),
    st.just((0.0, math.inf)),
    st.just((-math.inf, math.inf)),
    st.tuples(st.sampled_from([-1.0, 0.0, 1e-4, 1.0, 2.0]), st.sampled_from([2.0, 3.5, 100.0])),
)


@given(data=st.data())
def test_trees_of_solids(data: st.DataObject) -> None:
    graph = data.draw(cases.solid_graphs())
    rays = data.draw(cases.many_rays(graph))
    judge = judge_all(graph, rays, [(0.0, math.inf), data.draw(WINDOWS)])
    event(f"forgiven: {judge.forgiven > 0}")


@given(data=st.data())
def test_grammars(data: st.DataObject) -> None:
    graph = data.draw(cases.graphs())
    assume(len(oracle.leaves(graph)) <= 150)
    rays = data.draw(cases.many_rays(graph, 8))
    judge_all(graph, rays, [(0.0, math.inf), data.draw(WINDOWS)])


@given(data=st.data())
def test_points_are_contained(data: st.DataObject) -> None:
    graph = data.draw(st.one_of(cases.solid_graphs(), cases.graphs()))
    coordinates = st.one_of(st.floats(-3, 3), st.integers(-3, 3).map(float))
    points = np.array(data.draw(st.lists(st.tuples(*[coordinates] * 3), min_size=1, max_size=20)))
    got = Walker(graph).contains(points)
    for p, answer in zip(points, got, strict=True):
        if oracle.contains(graph, p) != answer:
            hair = 1e-9 * np.vstack([np.eye(3), -np.eye(3)])
            assert any(oracle.contains(graph, p + h) == answer for h in hair), p


# Where everything is exact, nothing is forgiven.


@st.composite
def exact_trees(draw: cases.Draw, depth: int = 3) -> Node:
    """Return boxes and half-spaces at multiples of 1/2 of powers of two."""
    if depth and draw(st.integers(0, 4)):
        a, b = draw(exact_trees(depth - 1)), draw(exact_trees(depth - 1))
        operator = draw(st.sampled_from(["|", "&", "-"]))
        node: Node = a | b if operator == "|" else a & b if operator == "&" else a - b
    else:
        node = solid(draw(st.sampled_from(["box", "box", "box", "halfspace", "empty"])))
    for _ in range(draw(st.integers(0, 2))):
        if draw(st.booleans()):
            node = prefix("move", *(draw(st.integers(-3, 3)) for _ in range(3))) * node
        elif draw(st.booleans()):
            factors = st.sampled_from([0.5, 1.0, -1.0, 2.0])
            node = prefix("scale", *(draw(factors) for _ in range(3))) * node
        else:
            turn = draw(st.sampled_from([90.0, 180.0, -90.0]))
            node = prefix(draw(st.sampled_from(["rotx", "roty", "rotz"])), turn) * node
    return node


@given(data=st.data())
def test_exact_cases_agree_exactly(data: st.DataObject) -> None:
    graph = Graph(data.draw(exact_trees()))
    halves = st.integers(-9, 9).map(lambda k: 0.5 * k)
    rays = data.draw(
        st.lists(
            st.tuples(st.tuples(halves, halves, halves), cases._UNITS), min_size=4, max_size=16
        )
    )
    low = data.draw(st.sampled_from([0.0, 1.0, -math.inf]))
    walker = Walker(graph)
    found = cast(walker, rays, low, 6.0)
    spans = walker.spans([o for o, _ in rays], [d for _, d in rays])
    for i, (o, d) in enumerate(rays):
        events = oracle.events(graph, o, d)
        first = oracle.first_of(events, low, 6.0)
        expected = (math.inf, -1) if first is None else (first.t, first.leaf)
        assert (found.t[i], found.leaf[i]) == expected
        k = slice(spans.offsets[i], spans.offsets[i + 1])
        assert list(zip(spans.t_in[k], spans.t_out[k], strict=True)) == list(oracle.spans(events))
        assert walker.contains([o])[0] == oracle.contains(graph, o)


def random_rays(count: int, seed: int) -> list[Ray]:
    random = np.random.default_rng(seed)
    origins = random.uniform(-4.0, 4.0, (count, 3))
    targets = random.uniform(-1.5, 1.5, (count, 3))
    lengths = 10.0 ** random.uniform(-2.0, 2.0, (count, 1))
    directions = (targets - origins) * lengths
    return [
        (tuple(o), tuple(d)) for o, d in zip(origins.tolist(), directions.tolist(), strict=True)
    ]


def tree_of_branches(depth: int) -> Graph:
    """Return a tree as in fig 5 of the paper, small."""
    module = S("T", 1 + (P.c > 0))
    module.rule(1, prefix("scale", 0.3, 0.3, 1) * BALL)
    twigs = [
        prefix("move", 0, 0, 1)
        * prefix("rotz", 120.0 * k)
        * prefix("roty", 35.0 + 10.0 * call("rand", P.c, k))
        * prefix("uscale", 0.7)
        * C(c=P.c - 1)
        * module
        for k in range(3)
    ]
    limb = prefix("scale", 0.1, 0.1, 1) * solid("cylinder")
    module.rule(2, limb | twigs[0] | twigs[1] | twigs[2])
    return Graph(C(c=depth) * module)


def swiss_cheese() -> Graph:
    """Return a ball with many holes, some of which hold balls."""
    holes = move(0) * solid("empty")
    for k in range(12):
        place = prefix("rotz", 30.0 * k) * move(0.9, 0, 0.1 * (k - 6)) * prefix("uscale", 0.25)
        holes = holes | place * (BALL - prefix("uscale", 0.5) * BALL)
    return Graph(BALL - holes)


@pytest.mark.parametrize("graph", [tree_of_branches(3), swiss_cheese()], ids=["tree", "cheese"])
def test_generic_rays_need_no_forgiveness(graph: Graph) -> None:
    judge = judge_all(graph, random_rays(250, 1), [(0.0, math.inf), (0.1, 1.0)])
    assert judge.forgiven == 0


# Hand-made cases


def first(node: Node, o: Sequence[float], d: Sequence[float], *limits: float) -> tuple[float, int]:
    graph = Graph(node)
    found = cast(Walker(graph), [(o, d)], *limits)
    event_ = oracle.first(graph, o, d, *limits)
    expected = (math.inf, -1) if event_ is None else (event_.t, event_.leaf)
    got = (float(found.t[0]), int(found.leaf[0]))
    assert got == (pytest.approx(expected[0], rel=1e-12, abs=1e-12), expected[1])
    return got


def test_a_ray_that_starts_inside_sees_no_inner_face() -> None:
    pair = BALL | move(1) * BALL
    assert first(pair, (0.5, 0, 0), (1, 0, 0))[0] == 1.5
    assert first(pair, (-0.5, 0, 0), (1, 0, 0))[0] == 2.5
    row = BALL | move(1) * BALL | move(2) * BALL | move(3) * BALL
    assert first(row, (0, 0, 0), (1, 0, 0))[0] == 4.0
    # The one that covers the start stands last in the text.
    cover = move(1.5) * prefix("uscale", 0.25) * BALL | prefix("uscale", 5) * BALL
    assert first(cover, (0, 0, 0), (1, 0, 0))[0] == 5.0
    assert not Walker(Graph(cover)).occluded([(0, 0, 0)], [(1, 0, 0)], 0.0, 4.0)[0]
    sheet = move(0, 0, 1) * solid("tri1") | prefix("uscale", 5) * BALL
    assert first(sheet, (0.25, 0.25, 0), (0, 0, 1))[0] > 4.0


def test_a_ray_that_starts_on_a_face() -> None:
    assert first(BOX, (-1, 0, 0), (1, 0, 0)) == (0.0, 0)
    assert first(BOX, (1, 0, 0), (1, 0, 0)) == (0.0, 0)
    assert first(BOX, (-1, 0, 0), (1, 0, 0), 1e-9)[0] == 2.0
    assert first(BOX | move(2) * BOX, (1, 0, 0), (1, 0, 0))[0] == 2.0
    assert first(BOX | move(2) * BOX, (-1, 0, 0), (1, 0, 0), 0.0, 1.0)[0] == 0.0


def test_abutting_boxes_have_no_face_between() -> None:
    pair = BOX | move(2) * BOX
    assert first(pair, (-5, 0.25, 0.5), (1, 0, 0), 5.0)[0] == 8.0
    spans = Walker(Graph(pair)).spans([(-5, 0.25, 0.5)], [(1, 0, 0)])
    assert (spans.t_in.tolist(), spans.t_out.tolist()) == ([4.0], [8.0])


def test_coincident_faces() -> None:
    # Of two that coincide the first in the text answers.
    again = solid("box")
    assert first(BOX | again, (-3, 0, 0), (1, 0, 0)) == (2.0, 1)
    assert first(again | BOX, (-3, 0, 0), (1, 0, 0)) == (2.0, 1)
    assert first(BOX & again, (-3, 0, 0), (1, 0, 0)) == (2.0, 1)
    assert first(BOX - again, (-3, 0, 0), (1, 0, 0)) == (math.inf, -1)
    # Within the tolerance, though nearer.
    near = move(-1e-11) * solid("box")
    assert first(BOX | near, (-3, 0, 0), (1, 0, 0)) == (2.0, 1)
    # Beyond it.
    nearer = move(-1e-9) * solid("box")
    assert first(BOX | nearer, (-3, 0, 0), (1, 0, 0)) == (pytest.approx(2.0), 3)
    assert first(BOX & move(2) * solid("box"), (-3, 0, 0), (1, 0, 0))[1] == -1


@pytest.mark.parametrize("other", [solid("box"), move(0, 0, 2) * solid("box")])
@pytest.mark.parametrize("swap", [False, True])
def test_sheets_in_faces(other: Node, swap: bool) -> None:
    """A sheet at z = 1 lies in the upper face of one box and in the lower face of the other."""
    sheet = move(0, 0, 1) * solid("tri1")
    for node in (
        (other | sheet) if swap else (sheet | other),
        (other & sheet) if swap else (sheet & other),
        sheet - other,
    ):
        for direction in (1.0, -1.0):
            first(node, (0.25, 0.25, -4 * direction), (0, 0, direction))


def test_sheets_are_clipped_and_kept() -> None:
    sheet = solid("tri1")
    ray = (0.25, 0.25, -3.0), (0, 0, 1)
    assert first(sheet, *ray)[0] == 3.0
    assert first(sheet & BALL, *ray)[0] == 3.0
    assert first(sheet & move(3) * BALL, *ray)[0] == math.inf
    assert first(sheet - BALL, *ray)[0] == math.inf
    assert first(sheet - move(3) * BALL, *ray)[0] == 3.0
    assert first(sheet & sheet, *ray)[0] == math.inf
    spans = Walker(Graph(sheet | move(3) * BALL)).spans([ray[0]], [ray[1]])
    assert (spans.t_in.tolist(), spans.t_out.tolist()) == ([3.0], [3.0])


def test_half_spaces() -> None:
    half = solid("halfspace")
    assert first(half, (0, 0, 1), (0, 0, -1))[0] == 1.0
    assert first(half, (0, 0, -1), (0, 0, -1)) == (math.inf, -1)
    assert first(half, (0, 0, -1), (1, 0, 0)) == (math.inf, -1)
    assert first(half, (0, 0, -1), (0, 0, 1))[0] == 1.0
    assert first(half, (0, 0, -1), (0, 0, 1), -math.inf)[0] == 1.0
    slab = half & prefix("rotx", 180) * move(0, 0, 1) * half
    assert first(slab, (0, 0, 5), (0, 0, -1))[0] == 5.0
    assert first(BALL - half, (0, 0, -3), (0, 0, 1))[0] == 3.0
    everything = half | prefix("rotx", 180) * half
    assert first(everything, (0, 0, 5), (0, 0, -1)) == (math.inf, -1)
    spans = Walker(Graph(everything)).spans([(0, 0, 5)], [(0, 0, -1)])
    assert (spans.t_in.tolist(), spans.t_out.tolist()) == ([-math.inf], [math.inf])


def test_cuts_show_the_second_operand() -> None:
    node = prefix("label", 1) * BALL - prefix("label", 2) * move(1) * BALL
    found = cast(Walker(Graph(node)), [((3, 0, 0), (-1, 0, 0))])
    # The inner ball's surface at x = 0, seen from the hole.
    assert found.t[0] == pytest.approx(3.0)
    assert found.label[0] == 2
    assert found.normal[0] == pytest.approx([1, 0, 0])


def test_directions_need_not_be_unit() -> None:
    assert first(BALL, (-3, 0, 0), (1e-6, 0, 0))[0] == pytest.approx(2e6)
    assert first(BALL, (-3, 0, 0), (4e5, 0, 0))[0] == pytest.approx(5e-6)


def test_tiny_and_far_frames() -> None:
    for scale in (1e-6, 1e6):
        node = prefix("uscale", scale) * (BALL - move(1) * BALL)
        first(node, (-3 * scale, 0.1 * scale, 0), (scale, 0, 0))
    first(move(1e6) * BALL, (0, 0, 0), (1, 0, 0))


def test_shrunk_modules_are_empty() -> None:
    module = S("N", 1 + (P.c > 0))
    module.rule(1, BALL)
    module.rule(2, C(c=P.c - 1) * move(1) * prefix("uscale", 0.5) * module)
    for depth, count in ((51, 1), (52, 0), (60, 0)):
        centre = 2.0 - 2.0 ** (1 - depth)
        graph = Graph(C(c=depth) * module)
        spans = Walker(graph).spans([(centre, 0, 0)], [(0, 0, 1)])
        assert len(spans.t_in) == count


def test_parameters_of_an_attribute_that_is_overridden_are_dead() -> None:
    module = S("M", 1 + (P.c > 0))
    module.rule(1, prefix("label", 3) * solid("sphere"))
    module.rule(2, prefix("label", P.b) * (C(c=P.c - 1) * move(1) * module))
    graph = Graph(C(c=2, b=7) * module)
    assert enumerate_states(graph).diagnostics == []
    found = cast(Walker(graph), [((2, 0, -5), (0, 0, 1))])
    assert (found.t[0], found.label[0]) == (4.0, 3)


@pytest.mark.parametrize(("in_parallel", "place"), [(True, (2.0, 1.0)), (False, (2.0, 2.0))])
def test_calls_assign_in_parallel(in_parallel: bool, place: tuple[float, float]) -> None:
    module = S("M").rule(1, prefix("move", P.x, P.y, 0) * solid("sphere"))
    swap = (("x", P.y), ("y", P.x))
    node = C(x=1, y=2) * Calculation(swap, module, call=in_parallel)
    assert first(node, (*place, -5), (0, 0, 1))[0] == 4.0


# Chunks and threads


def test_results_do_not_depend_on_chunks_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = tree_of_branches(3)
    rays = random_rays(500, 2)
    o, d = [r[0] for r in rays], [r[1] for r in rays]
    whole = Walker(graph, threads=1).intersect(o, d)
    whole_spans = Walker(graph, threads=1).spans(o, d)
    assert 50 < (whole.leaf >= 0).sum() < 450
    places = [m for n, m in sys.modules.items() if n.startswith("pcsg.trace.")]
    places = [m for m in places if hasattr(m, "CHUNK")]
    assert places
    for place in places:
        monkeypatch.setattr(place, "CHUNK", 37)
    for threads in (1, 3):
        walker = Walker(graph, threads=threads)
        parts, spans = walker.intersect(o, d), walker.spans(o, d)
        for name in ("t", "leaf", "normal", "position", "uv", "label", "color"):
            assert np.array_equal(getattr(parts, name), getattr(whole, name)), name
        assert np.array_equal(walker.occluded(o, d), whole.leaf >= 0)
        for name in ("offsets", "t_in", "t_out"):
            assert np.array_equal(getattr(spans, name), getattr(whole_spans, name)), name
    with ThreadPoolExecutor(4) as executor:
        for parts in executor.map(lambda _: walker.intersect(o, d), range(4)):
            assert np.array_equal(parts.t, whole.t)


def test_a_ray_does_not_depend_on_its_company() -> None:
    graph = swiss_cheese()
    rays = random_rays(60, 3)
    walker = Walker(graph)
    whole = cast(walker, rays)
    for i, ray in enumerate(rays):
        alone = cast(walker, [ray])
        assert (alone.t[0], alone.leaf[0]) == (whole.t[i], whole.leaf[i])
        assert (alone.normal[0] == whole.normal[i]).all()


def test_no_rays() -> None:
    walker = Walker(Graph(BALL))
    none = np.empty((0, 3))
    assert len(walker.intersect(none, none).t) == 0
    assert walker.spans(none, none).offsets.tolist() == [0]
    assert walker.contains(none).tolist() == []


# Faults


def recursion(select: object, *, depth: int) -> Graph:
    module = S("M", select)  # type: ignore[arg-type]
    module.rule(1, BALL)
    module.rule(2, C(c=P.c - 1) * module)
    return Graph(C(c=depth) * module)


ENDLESS = Graph(C(c=1) * S("M", 2).rule(1, BALL)).root.successor  # type: ignore[attr-defined]
ENDLESS.rule(2, C(c=P.c + 1) * ENDLESS)


def unbounded(graph: Graph) -> np.ndarray:
    """Return boxes that hide nothing."""
    return np.tile([-math.inf] * 3 + [math.inf] * 3, (len(graph.nodes), 1))


FAULTS = {
    "not finite": Graph(C(x=0) * prefix("move", 1 / P.x, 0, 0) * BALL),
    "square root": Graph(C(x=-1) * C(y=call("sqrt", P.x)) * prefix("uscale", P.y) * BALL),
    "assigned elsewhere": Graph(C(x=1) * solid("box") | prefix("move", P.x, 0, 0) * BALL),
    "no such rule": recursion(3, depth=1),
    "rule between": recursion(0.4, depth=1),
    "singular": Graph(C(s=0) * prefix("scale", 1, P.s, 1) * BALL),
    "singular constant": Graph(prefix("scale", 1, 0, 1) * BALL),
    "no axis": Graph(C(s=0) * prefix("rot", 30, P.s, 0, 0) * BALL),
    "torus": Graph(C(r=1.5) * solid("torus", P.r)),
    "torus constant": Graph(solid("torus", 0.0)),
    "cone": Graph(C(r=-0.5) * solid("cone", P.r)),
    "endless": Graph(C(c=1) * ENDLESS),
    "weights": Graph(
        C(w=-1) * C(x=call("choose", 1, P.w, 2, seeds=1)) * prefix("uscale", P.x) * BALL
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_raised_by_both(name: str) -> None:
    graph = FAULTS[name]
    with pytest.raises(oracle.Fault):
        oracle.events(graph, (-3, 0, 0), (1, 0, 0))
    with pytest.raises(oracle.Fault):
        oracle.contains(graph, (0, 0, 0))
    # Without boxes, for a module at fault may be empty and be passed by.
    walker = Walker(graph, boxes=unbounded(graph))
    o, d = [(-3.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)]
    for query in (walker.intersect, walker.occluded, walker.spans):
        with pytest.raises(EvaluationFault):
            query(o, d)
    with pytest.raises(EvaluationFault):
        walker.contains([(0, 0, 0)])


@pytest.mark.parametrize("name", FAULTS)
def test_faults_that_a_box_hides_are_found_among_the_states(name: str) -> None:
    graph = FAULTS[name]
    if graph is FAULTS["endless"]:
        pytest.skip("has no end of states")
    assert enumerate_states(graph).diagnostics


def test_lazy_branches_that_are_not_taken_are_no_faults() -> None:
    graph = Graph(C(x=0) * prefix("move", if_(P.x > 0, 1 / P.x, 1), 0, 0) * BALL)
    assert cast(Walker(graph), [((-3, 0, 0), (1, 0, 0))]).t[0] == 3.0


def test_the_depth_limit_is_the_oracles() -> None:
    ray = [((-3.0, 0.0, 0.0), (1.0, 0.0, 0.0))]
    assert cast(Walker(Graph(cases.chain(40, BALL)), depth_limit=40), ray).t[0] == 2.0
    with pytest.raises(EvaluationFault):
        cast(Walker(Graph(cases.chain(41, BALL)), depth_limit=40), ray)
    assert cast(Walker(Graph(cases.chain(10_000, BALL))), ray).t[0] == 2.0
    with pytest.raises(EvaluationFault):
        cast(Walker(Graph(cases.chain(10_001, BALL))), ray)


def test_halves_round_to_even() -> None:
    for value, expected in ((0.5, None), (1.5, 2.0), (2.5, 2.0), (1.4999, 3.0)):
        module = S("M", P.v).rule(1, prefix("uscale", 0.5) * BALL)
        module.rule(2, prefix("uscale", 1.5) * BALL)
        graph = Graph(C(v=value) * module)
        if expected is None:
            with pytest.raises(EvaluationFault):
                cast(Walker(graph, boxes=unbounded(graph)), [((-3, 0, 0), (1, 0, 0))])
        else:
            hit = cast(Walker(graph), [((-3, 0, 0), (1, 0, 0))]).t[0]
            assert hit == (1.5 if expected == 2.0 else 2.5)


@pytest.mark.parametrize(
    ("origins", "directions"),
    [
        ([(0, 0)], [(1, 0)]),
        ([(0, 0, 0)], [(0, 0, 0)]),
        ([(0, 0, math.nan)], [(0, 0, 1)]),
        ([(0, 0, 0)], [(0, 0, math.inf)]),
        ([(0, 0, 0)] * 3, [(0, 0, 1)] * 2),
    ],
)
def test_wrong_rays_are_refused(
    origins: list[tuple[float, ...]], directions: list[tuple[float, ...]]
) -> None:
    for query in ("intersect", "occluded", "spans"):
        with pytest.raises(UsageError):
            getattr(Walker(Graph(BALL)), query)(origins, directions)


# Global parameters


def test_globals_reach_both() -> None:
    graph = Graph(prefix("move", P.SUNX + P.TIME, P.SEED, 0) * BALL)
    values = {"SEED": 2.0, "TIME": 3.0, "SUNX": 0.5}
    ray = ((3.4, 2.0, -5.0), (0.0, 0.0, 1.0))
    hit = cast(Walker(graph, values), [ray])
    expected = oracle.first(graph, *ray, globals=values)
    assert expected is not None
    assert hit.t[0] == pytest.approx(expected.t, rel=1e-12)
