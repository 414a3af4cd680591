"""Both engines find what the oracle finds."""

from __future__ import annotations

import math
import random
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import oracle
import pytest
import strategies as cases
from agreement import ENGINES, Judge, Make, Ray, cast, make_any_states
from assemblies import assemble
from consistency import rays_through
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from pcsg.errors import EvaluationFault, UsageError
from pcsg.grammar import load_file, load_text
from pcsg.graph.build import C, S
from pcsg.graph.expr import P, call, if_
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.nodes import Calculation, Node
from pcsg.graph.unroll import enumerate_states
from pcsg.scene import Scene
from pcsg.trace.tracer import Walker

move, solid, prefix = (
    lambda x, y=0.0, z=0.0: cases.prefix("move", x, y, z),
    cases.solid,
    cases.prefix,
)
BALL, BOX = solid("sphere"), solid("box")
both = pytest.mark.parametrize("make", ENGINES.values(), ids=ENGINES)


def judge_all(
    make: Make, graph: Graph, rays: Sequence[Ray], limits: Sequence[tuple[float, float]]
) -> Judge:
    """Compare all queries of some rays."""
    tracer = make(graph)
    judge = Judge(tracer, graph)
    for low, high in limits:
        found = cast(tracer, rays, low, high)
        blocked = tracer.occluded([o for o, _ in rays], [d for _, d in rays], low, high)
        assert (blocked == (found.leaf >= 0)).all()
        for i, ray in enumerate(rays):
            judge.hit(ray, found, i, low, high)
    spans = tracer.spans([o for o, _ in rays], [d for _, d in rays])
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


@both
@given(data=st.data())
def test_trees_of_solids(make: Make, data: st.DataObject) -> None:
    graph = data.draw(cases.solid_graphs())
    rays = data.draw(cases.many_rays(graph))
    judge = judge_all(make, graph, rays, [(0.0, math.inf), data.draw(WINDOWS)])
    event(f"forgiven: {judge.forgiven > 0}")


@both
@given(data=st.data())
def test_grammars(make: Make, data: st.DataObject) -> None:
    graph = data.draw(cases.graphs())
    assume(len(oracle.leaves(graph)) <= 150)
    rays = data.draw(cases.many_rays(graph, 8))
    judge_all(make, graph, rays, [(0.0, math.inf), data.draw(WINDOWS)])


@both
@settings(max_examples=settings().max_examples // 3)
@given(rng=st.randoms(use_true_random=False), seed=st.integers(0, 1_000))
def test_assemblies(make: Make, rng: random.Random, seed: int) -> None:
    """Operations over modules in wide unions, as the long form in ``tests/fuzz`` makes them."""
    graph = load_text(assemble(rng))
    origins, directions = rays_through(graph, np.random.default_rng(seed), 3)
    # Whether a ray that starts on a surface meets it is a matter of rounding.
    rays = list(zip(origins.tolist(), directions.tolist(), strict=True))[:6]
    judge_all(make, graph, rays, [(0.0, math.inf)])


@both
@given(data=st.data())
def test_points_are_contained(make: Make, data: st.DataObject) -> None:
    graph = data.draw(st.one_of(cases.solid_graphs(), cases.graphs()))
    coordinates = st.one_of(st.floats(-3, 3), st.integers(-3, 3).map(float))
    points = np.array(data.draw(st.lists(st.tuples(*[coordinates] * 3), min_size=1, max_size=20)))
    got = make(graph).contains(points)
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


@both
@given(data=st.data())
def test_exact_cases_agree_exactly(make: Make, data: st.DataObject) -> None:
    graph = Graph(data.draw(exact_trees()))
    halves = st.integers(-9, 9).map(lambda k: 0.5 * k)
    rays = data.draw(
        st.lists(
            st.tuples(st.tuples(halves, halves, halves), cases._UNITS), min_size=4, max_size=16
        )
    )
    low = data.draw(st.sampled_from([0.0, 1.0, -math.inf]))
    tracer = make(graph)
    found = cast(tracer, rays, low, 6.0)
    spans = tracer.spans([o for o, _ in rays], [d for _, d in rays])
    for i, (o, d) in enumerate(rays):
        events = oracle.events(graph, o, d)
        first = oracle.first_of(events, low, 6.0)
        expected = (math.inf, -1) if first is None else (first.t, first.leaf)
        assert (found.t[i], found.leaf[i]) == expected
        k = slice(spans.offsets[i], spans.offsets[i + 1])
        assert list(zip(spans.t_in[k], spans.t_out[k], strict=True)) == list(oracle.spans(events))
        assert tracer.contains([o])[0] == oracle.contains(graph, o)


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


@both
@pytest.mark.parametrize("graph", [tree_of_branches(3), swiss_cheese()], ids=["tree", "cheese"])
def test_generic_rays_need_no_forgiveness(make: Make, graph: Graph) -> None:
    judge = judge_all(make, graph, random_rays(250, 1), [(0.0, math.inf), (0.1, 1.0)])
    assert judge.forgiven == 0


# Hand-made cases


def first(node: Node, o: Sequence[float], d: Sequence[float], *limits: float) -> tuple[float, int]:
    """Return t and leaf of a ray, the same from both engines and the oracle."""
    graph = Graph(node)
    event_ = oracle.first(graph, o, d, *limits)
    expected = (math.inf, -1) if event_ is None else (event_.t, event_.leaf)
    for name, make in ENGINES.items():
        found = cast(make(graph), [(o, d)], *limits)
        got = (float(found.t[0]), int(found.leaf[0]))
        assert got == (pytest.approx(expected[0], rel=1e-12, abs=1e-12), expected[1]), name
    return got


@both
def test_a_ray_that_starts_inside_sees_no_inner_face(make: Make) -> None:
    pair = BALL | move(1) * BALL
    assert first(pair, (0.5, 0, 0), (1, 0, 0))[0] == 1.5
    assert first(pair, (-0.5, 0, 0), (1, 0, 0))[0] == 2.5
    row = BALL | move(1) * BALL | move(2) * BALL | move(3) * BALL
    assert first(row, (0, 0, 0), (1, 0, 0))[0] == 4.0
    # The one that covers the start stands last in the text.
    cover = move(1.5) * prefix("uscale", 0.25) * BALL | prefix("uscale", 5) * BALL
    assert first(cover, (0, 0, 0), (1, 0, 0))[0] == 5.0
    assert not make(Graph(cover)).occluded([(0, 0, 0)], [(1, 0, 0)], 0.0, 4.0)[0]
    sheet = move(0, 0, 1) * solid("tri1") | prefix("uscale", 5) * BALL
    assert first(sheet, (0.25, 0.25, 0), (0, 0, 1))[0] > 4.0


def test_a_ray_that_starts_on_a_face() -> None:
    assert first(BOX, (-1, 0, 0), (1, 0, 0)) == (0.0, 0)
    assert first(BOX, (1, 0, 0), (1, 0, 0)) == (0.0, 0)
    assert first(BOX, (-1, 0, 0), (1, 0, 0), 1e-9)[0] == 2.0
    assert first(BOX | move(2) * BOX, (1, 0, 0), (1, 0, 0))[0] == 2.0
    assert first(BOX | move(2) * BOX, (-1, 0, 0), (1, 0, 0), 0.0, 1.0)[0] == 0.0


@both
def test_abutting_boxes_have_no_face_between(make: Make) -> None:
    pair = BOX | move(2) * BOX
    assert first(pair, (-5, 0.25, 0.5), (1, 0, 0), 5.0)[0] == 8.0
    spans = make(Graph(pair)).spans([(-5, 0.25, 0.5)], [(1, 0, 0)])
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


def test_of_exits_that_coincide_the_first_in_the_text_answers() -> None:
    half = prefix("uscale", 0.5) * (BOX | solid("box"))
    a, b = solid("box"), solid("box")
    assert first(half | a | b, (0, 0, 0), (1, 0, 0)) == (1.0, 5)
    assert first(half | b | a, (0, 0, 0), (1, 0, 0)) == (1.0, 5)
    # From a hole, too, the ray comes through the end of what was taken away.
    for x, y in ((a, b), (b, a)):
        node = prefix("uscale", 4) * BOX - (half | x | y)
        assert first(node, (0, 0, 0), (1, 0, 0)) == (1.0, 7)
    # Unions under operations that the other engine asks, not tables.
    many = [move(0, 0, 0.001 * k) * solid("box") for k in range(9)]
    node = many[0]
    for other in many[1:]:
        node = node | other
    first(prefix("uscale", 4) * BOX - node, (0, 0, 0.1), (1, 0, 0))
    first(node & prefix("uscale", 4) * BOX, (0, 0, 0.1), (1, 0, 0))
    first(BALL | (node & prefix("uscale", 4) * BOX), (-5, 0, 0.1), (1, 0, 0))


def test_what_stands_in_a_hole_is_seen_after_its_bottom() -> None:
    """The operation with the hole, too large for a table, is entered and so answers first."""
    hole = move(-4, 0, 0) * prefix("scale", 6, 1, 1) * BOX
    for k in range(6):
        hole = hole | move(-4, 0, 0.001 * k) * prefix("scale", 6, 1, 1) * BOX
    carved = prefix("uscale", 4) * BOX - hole
    inside = prefix("uscale", 0.5) * (BOX - move(1, 1, 1) * BALL)
    assert first(carved, (-8, 0, 0.1), (1, 0, 0))[0] == 10.0
    assert first(carved | inside, (-8, 0, 0.1), (1, 0, 0))[0] == 7.5
    assert first(inside | carved, (-8, 0, 0.1), (1, 0, 0))[0] == 7.5


def test_operands_that_meet_at_their_second_pieces_only() -> None:
    """More primitives than a table takes; the first operand ends before the second begins."""
    pieces = BALL | move(4) * BALL
    other = move(4) * prefix("uscale", 0.5) * BALL
    for k in range(4):
        pieces = pieces | move(0, 9 + k) * BALL
        other = other | move(4, 9 + k) * BALL
    for node in (pieces & other, other & pieces, (pieces & other) - move(4, 9) * BOX):
        assert first(node, (-5, 0, 0), (1, 0, 0))[0] == 8.5


def test_engines_agree_on_large_operations() -> None:
    random = np.random.default_rng(11)

    def tree(depth: int) -> Node:
        if depth == 0:
            name = random.choice(["sphere", "box", "cylinder", "cone", "tetrahedron"])
            turned = prefix("rotx", random.uniform(0, 360)) * solid(str(name))
            return move(*random.uniform(-1.2, 1.2, 3)) * prefix("uscale", 0.8) * turned
        a, b = tree(depth - 1), tree(depth - 1)
        what = random.integers(0, 4)
        return a & b if what == 0 else a - b if what == 1 else a | b

    hits = 0
    for k in range(30):
        rays = random_rays(200, k)
        hits += (assert_engines_agree(Graph(tree(4 + k % 2)), rays) >= 0).sum()
    assert hits > 1_000


def test_operations_with_no_room_are_empty() -> None:
    carved = prefix("rotx", 90) * move(3) * BOX - solid("box")
    assert first(BOX & carved, (0, 0, 0), (1, 0, 0)) == (math.inf, -1)
    assert first(BALL | (BOX & carved), (0, 0, 0), (1, 0, 0))[0] == 1.0


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


@both
def test_sheets_are_clipped_and_kept(make: Make) -> None:
    sheet = solid("tri1")
    ray = (0.25, 0.25, -3.0), (0, 0, 1)
    assert first(sheet, *ray)[0] == 3.0
    assert first(sheet & BALL, *ray)[0] == 3.0
    assert first(sheet & move(3) * BALL, *ray)[0] == math.inf
    assert first(sheet - BALL, *ray)[0] == math.inf
    assert first(sheet - move(3) * BALL, *ray)[0] == 3.0
    assert first(sheet & sheet, *ray)[0] == math.inf
    spans = make(Graph(sheet | move(3) * BALL)).spans([ray[0]], [ray[1]])
    assert (spans.t_in.tolist(), spans.t_out.tolist()) == ([3.0], [3.0])


@both
def test_half_spaces(make: Make) -> None:
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
    spans = make(Graph(everything)).spans([(0, 0, 5)], [(0, 0, -1)])
    assert (spans.t_in.tolist(), spans.t_out.tolist()) == ([-math.inf], [math.inf])


@both
def test_cuts_show_the_second_operand(make: Make) -> None:
    node = prefix("label", 1) * BALL - prefix("label", 2) * move(1) * BALL
    found = cast(make(Graph(node)), [((3, 0, 0), (-1, 0, 0))])
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


@both
def test_shrunk_modules_are_empty(make: Make) -> None:
    module = S("N", 1 + (P.c > 0))
    module.rule(1, BALL)
    module.rule(2, C(c=P.c - 1) * move(1) * prefix("uscale", 0.5) * module)
    for depth, count in ((51, 1), (52, 0), (60, 0)):
        centre = 2.0 - 2.0 ** (1 - depth)
        graph = Graph(C(c=depth) * module)
        spans = make(graph).spans([(centre, 0, 0)], [(0, 0, 1)])
        assert len(spans.t_in) == count


@both
def test_parameters_of_an_attribute_that_is_overridden_are_dead(make: Make) -> None:
    module = S("M", 1 + (P.c > 0))
    module.rule(1, prefix("label", 3) * solid("sphere"))
    module.rule(2, prefix("label", P.b) * (C(c=P.c - 1) * move(1) * module))
    graph = Graph(C(c=2, b=7) * module)
    assert enumerate_states(graph).diagnostics == []
    found = cast(make(graph), [((2, 0, -5), (0, 0, 1))])
    assert (found.t[0], found.label[0]) == (4.0, 3)


@pytest.mark.parametrize(("in_parallel", "place"), [(True, (2.0, 1.0)), (False, (2.0, 2.0))])
def test_calls_assign_in_parallel(in_parallel: bool, place: tuple[float, float]) -> None:
    module = S("M").rule(1, prefix("move", P.x, P.y, 0) * solid("sphere"))
    swap = (("x", P.y), ("y", P.x))
    node = C(x=1, y=2) * Calculation(swap, module, call=in_parallel)
    assert first(node, (*place, -5), (0, 0, 1))[0] == 4.0


# Deep and empty graphs, and the gallery


def assert_engines_agree(
    graph: Graph, rays: Sequence[Ray], values: Mapping[str, float] = GLOBALS
) -> np.ndarray:
    """Require the same hits from both engines; return the numbers of the leaves."""
    a, b = (cast(make(graph, values), rays) for make in (Walker, make_any_states))
    assert np.array_equal(a.leaf, b.leaf), np.flatnonzero(a.leaf != b.leaf)
    hit = a.leaf >= 0
    assert (np.abs(a.t[hit] - b.t[hit]) <= 1e-9 * np.maximum(1.0, np.abs(a.t[hit]))).all()
    assert np.isinf(b.t[~hit]).all()
    assert np.abs(a.normal - b.normal)[hit].max(initial=0.0) <= 1e-6
    for name in ("label", "material", "texture", "texture_scale"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    # Blobs mix colours by fields, which differ in the last bits of the place.
    np.testing.assert_allclose(a.color, b.color, rtol=0.0, atol=1e-6)
    found: np.ndarray = a.leaf
    return found


GRAMMARS = Path(__file__).parents[2] / "grammars"
SMALLER = {
    "terrain": {"cnt": 2.0},
    "sea": {"cnt": 2.0},
    "zoom": {"c": 22.0},
    "sponge": {"n": 4.0},
    "ages": {"trees": 2.0},
}


@pytest.mark.parametrize("name", sorted(path.stem for path in GRAMMARS.glob("*.pcsg")))
def test_engines_agree_on_the_gallery(name: str) -> None:
    graph = load_file(GRAMMARS / f"{name}.pcsg").override(SMALLER.get(name, {}))
    random = np.random.default_rng(5)
    box = Scene(graph).bounds
    size, centre = float(np.max(box[1] - box[0])), box.mean(axis=0)
    targets = random.uniform(box[0], box[1], (2_000, 3))
    origins = centre + random.normal(size=(2_000, 3)) * size
    # A quarter of the rays starts among the solids.
    origins[::4] = random.uniform(box[0], box[1], (500, 3))
    rays = list(zip(origins.tolist(), (targets - origins).tolist(), strict=True))
    leaves = assert_engines_agree(graph, rays, Scene(graph).values)
    assert (leaves >= 0).sum() > 20


def test_engines_agree_on_deep_graphs() -> None:
    corners = [(0.5, 0.5, 0.5), (-0.5, -0.5, 0.5), (0.5, -0.5, -0.5), (-0.5, 0.5, -0.5)]
    module = S("S", 1 + (P.c > 0))
    module.rule(1, solid("tetrahedron"))
    parts = [prefix("move", *p) * prefix("uscale", 0.5) * C(c=P.c - 1) * module for p in corners]
    module.rule(2, parts[0] | parts[1] | parts[2] | parts[3])
    rays = random_rays(300, 4)
    for order in (3, 30):
        leaves = assert_engines_agree(Graph(C(c=order) * module), rays)
        assert order > 3 or (leaves >= 0).sum() > 20
    assert (assert_engines_agree(Graph(cases.chain(1_000, BALL)), rays) >= 0).sum() > 20


def test_engines_agree_beyond_the_depth_of_the_blocks() -> None:
    module = S("N", 1 + (P.c > 0))
    module.rule(1, BALL)
    inner = prefix("rotz", 1) * move(0.001) * C(c=P.c - 1) * module
    module.rule(2, (inner | move(2) * prefix("uscale", 0.1) * BALL) - move(0, 1.5) * BOX)
    for depth in (40, 130):
        leaves = assert_engines_agree(Graph(C(c=depth) * module), random_rays(100, 6))
        assert (leaves >= 0).sum() > 5


def test_empty_scenes() -> None:
    everything = random_rays(20, 7)
    far = move(5) * BALL
    for node in (
        solid("empty"),
        solid("empty") | solid("empty"),
        BALL & far,
        solid("empty") - BALL,
    ):
        assert (assert_engines_agree(Graph(node), everything) == -1).all()
    assert (assert_engines_agree(Graph(BALL - BALL), everything) == -1).all()


# Chunks and threads


@both
def test_results_do_not_depend_on_chunks_and_threads(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph = tree_of_branches(3)
    rays = random_rays(500, 2)
    o, d = [r[0] for r in rays], [r[1] for r in rays]
    whole = make(graph, threads=1).intersect(o, d)
    whole_spans = make(graph, threads=1).spans(o, d)
    assert 50 < (whole.leaf >= 0).sum() < 450
    places = [m for n, m in sys.modules.items() if n.startswith("pcsg.trace.")]
    places = [m for m in places if hasattr(m, "CHUNK")]
    assert places
    for place in places:
        monkeypatch.setattr(place, "CHUNK", 37)
    for threads in (1, 3):
        tracer = make(graph, threads=threads)
        parts, spans = tracer.intersect(o, d), tracer.spans(o, d)
        for name in ("t", "leaf", "normal", "position", "uv", "label", "color"):
            assert np.array_equal(getattr(parts, name), getattr(whole, name)), name
        assert np.array_equal(tracer.occluded(o, d), whole.leaf >= 0)
        for name in ("offsets", "t_in", "t_out"):
            assert np.array_equal(getattr(spans, name), getattr(whole_spans, name)), name
    with ThreadPoolExecutor(4) as executor:
        for parts in executor.map(lambda _: tracer.intersect(o, d), range(4)):
            assert np.array_equal(parts.t, whole.t)


@both
def test_a_ray_does_not_depend_on_its_company(make: Make) -> None:
    graph = swiss_cheese()
    rays = random_rays(60, 3)
    tracer = make(graph)
    whole = cast(tracer, rays)
    for i, ray in enumerate(rays):
        alone = cast(tracer, [ray])
        assert (alone.t[0], alone.leaf[0]) == (whole.t[i], whole.leaf[i])
        assert (alone.normal[0] == whole.normal[i]).all()


@both
def test_no_rays(make: Make) -> None:
    tracer = make(Graph(BALL))
    none = np.empty((0, 3))
    assert len(tracer.intersect(none, none).t) == 0
    assert tracer.spans(none, none).offsets.tolist() == [0]
    assert tracer.contains(none).tolist() == []


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
    # The oracle's recursion is Python's, which ends before the limit does.
    limit = 1_000
    with pytest.raises(oracle.Fault):
        oracle.events(graph, (-3, 0, 0), (1, 0, 0), depth_limit=limit)
    with pytest.raises(oracle.Fault):
        oracle.contains(graph, (0, 0, 0), depth_limit=limit)
    # Without boxes, for a module at fault may be empty and be passed by.
    walker = Walker(graph, boxes=unbounded(graph), depth_limit=limit)
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


@both
def test_lazy_branches_that_are_not_taken_are_no_faults(make: Make) -> None:
    graph = Graph(C(x=0) * prefix("move", if_(P.x > 0, 1 / P.x, 1), 0, 0) * BALL)
    assert cast(make(graph), [((-3, 0, 0), (1, 0, 0))]).t[0] == 3.0


def test_the_depth_limit_is_the_oracles() -> None:
    ray = [((-3.0, 0.0, 0.0), (1.0, 0.0, 0.0))]
    assert cast(Walker(Graph(cases.chain(40, BALL)), depth_limit=40), ray).t[0] == 2.0
    with pytest.raises(EvaluationFault):
        cast(Walker(Graph(cases.chain(41, BALL)), depth_limit=40), ray)
    assert cast(Walker(Graph(cases.chain(10_001, BALL))), ray).t[0] == 2.0


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
@both
def test_wrong_rays_are_refused(
    make: Make, origins: list[tuple[float, ...]], directions: list[tuple[float, ...]]
) -> None:
    for query in ("intersect", "occluded", "spans"):
        with pytest.raises(UsageError):
            getattr(make(Graph(BALL)), query)(origins, directions)


# Global parameters


@both
def test_globals_reach_all(make: Make) -> None:
    graph = Graph(prefix("move", P.SUNX + P.TIME, P.SEED, 0) * BALL)
    values = {"SEED": 2.0, "TIME": 3.0, "SUNX": 0.5}
    ray = ((3.4, 2.0, -5.0), (0.0, 0.0, 1.0))
    hit = cast(make(graph, values), [ray])
    expected = oracle.first(graph, *ray, globals=values)
    assert expected is not None
    assert hit.t[0] == pytest.approx(expected.t, rel=1e-12)
