from __future__ import annotations

import math
import random

import numpy as np
import oracle
import pytest
from analysis_graphs import Vector, plant, terrain, turned, union_box
from hypothesis import given
from hypothesis import strategies as st
from paper_graphs import fig5a, move, prefix, rotx, rotz, scale, sierpinski, sphere, uscale
from strategies import graphs, solid_graphs

from pcsg.graph.bounds import HyperBoxes, hyper_boxes
from pcsg.graph.build import C, S
from pcsg.graph.expr import P, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.hulls import Hulls
from pcsg.graph.nodes import Node, Selection
from pcsg.graph.ranges import range_boxes
from pcsg.graph.unroll import enumerate_states
from pcsg.leaf.registry import Box

halfspace, box, empty = prefix("halfspace"), prefix("box"), prefix("empty")
INF = math.inf


def assert_box(found: Box, lower: Vector, upper: Vector, tolerance: float = 1e-8) -> None:
    """Check that a box contains the exact one and is not larger than the padding."""
    for a, b in zip(found.lower, lower, strict=True):
        assert b - tolerance <= a <= b, (found, lower)
    for a, b in zip(found.upper, upper, strict=True):
        assert b <= a <= b + tolerance, (found, upper)


def module_boxes(graph: Graph, found: HyperBoxes) -> dict[str, np.ndarray]:
    return {n.name: found.boxes[k] for k, n in enumerate(graph.nodes) if isinstance(n, Selection)}


@pytest.mark.parametrize("order", [0, 5, 40])
def test_sierpinski_fills_its_cube_at_every_node(order: int) -> None:
    graph = sierpinski(order)
    found = hyper_boxes(graph)
    assert found.kind == "exact"
    assert_box(found.scene, (-1, -1, -1), (1, 1, 1))
    assert found.scene_box == found.scene
    (s,) = module_boxes(graph, found).values()
    assert np.abs(s - [-1, -1, -1, 1, 1, 1]).max() < 1e-8
    assert found.boxes.shape == (len(graph.nodes), 6)


def test_boxes_of_all_nodes_are_in_their_own_frames() -> None:
    inner = uscale(2) * sphere()
    graph = Graph(C(a=1) * move(3, 0, 0) * (inner | move(0, 5, 0) * inner))
    found = hyper_boxes(graph).boxes
    names = [type(n).__name__ for n in graph.nodes]
    boxes = dict(zip(names, found.tolist(), strict=True))
    assert names == [
        *("Calculation", "Transformation", "Operation"),
        *("Transformation", "Leaf", "Transformation"),
    ]
    assert boxes["Calculation"] == pytest.approx([1, -2, -2, 5, 7, 2], abs=1e-7)
    assert boxes["Operation"] == pytest.approx([-2, -2, -2, 2, 7, 2], abs=1e-7)
    assert boxes["Leaf"] == pytest.approx([-1, -1, -1, 1, 1, 1], abs=1e-7)
    assert found[3] == pytest.approx([-2, -2, -2, 2, 2, 2], abs=1e-7)
    assert found[5] == pytest.approx([-2, 3, -2, 2, 7, 2], abs=1e-7)


def test_a_node_has_the_union_of_its_visits() -> None:
    s = S("S").rule(1, scale(P.a, 1, 1) * sphere())
    graph = Graph(C(a=3) * s | C(a=0.5) * move(9, 0, 0) * s)
    assert module_boxes(graph, hyper_boxes(graph))["S"] == pytest.approx(
        [-3, -1, -1, 3, 1, 1], abs=1e-7
    )


def test_rotations_do_not_make_boxes_grow() -> None:
    # Fig 9: a cylinder turned by 45 degrees, 17 times, against its own support.
    found = hyper_boxes(turned(17))
    assert_box(found.scene, *union_box(turned(17)))
    assert_box(hyper_boxes(turned(16)).scene, *union_box(turned(0)))


def test_nested_rotations_of_states_do_not_grow() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, box())
    s.rule(2, C(c=P.c - 1) * rotz(45) * s)
    assert_box(hyper_boxes(Graph(C(c=80) * s)).scene, (-1, -1, -1), (1, 1, 1))


@pytest.mark.parametrize("graph", [fig5a().override({"cnt": 5}), plant(5), terrain(3)])
def test_boxes_of_unions_are_tight(graph: Graph) -> None:
    found = hyper_boxes(graph)
    assert found.kind == "exact"
    lower, upper = union_box(graph)
    if graph.parameters[0] == "cnt" and "gamma" in graph.parameters:
        # The tree's leaves are intersections, whose box may be smaller than that of all operands.
        assert np.all(np.array(found.scene.lower) >= np.array(lower) - 1e-8)
        assert np.all(np.array(found.scene.upper) <= np.array(upper) + 1e-8)
    else:
        assert_box(found.scene, lower, upper, 1e-6)


def test_an_irregular_plant_of_order_40_is_bounded_quickly() -> None:
    # 10^13 leaves in 51 states: the search must not follow them.
    found = enumerate_states(fig5a().override({"cnt": 40}))
    assert found.count == 51
    hulls = Hulls(found)
    assert not hulls.capped
    larger = hyper_boxes(fig5a().override({"cnt": 40}), None, found).scene
    smaller = hyper_boxes(fig5a()).scene
    assert np.all(np.array(larger.upper) >= np.array(smaller.upper) - 1e-6)
    assert np.all(np.array(larger.upper) <= np.array(smaller.upper) + 0.1)


def test_operators() -> None:
    ball = move(1, 0, 0) * sphere()
    assert_box(hyper_boxes(Graph(sphere() & ball)).scene, (0, -1, -1), (1, 1, 1))
    assert_box(hyper_boxes(Graph(sphere() - ball)).scene, (-1, -1, -1), (1, 1, 1))
    apart = hyper_boxes(Graph(sphere() & move(5, 0, 0) * sphere()))
    assert apart.boxes[0].tolist() == [INF] * 3 + [-INF] * 3
    nothing = hyper_boxes(Graph(empty()))
    assert nothing.boxes[0].tolist() == [INF] * 3 + [-INF] * 3
    assert hyper_boxes(Graph(sphere() | empty())).scene == hyper_boxes(Graph(sphere())).scene


def test_half_spaces_are_unbounded_and_left_out_of_the_frame() -> None:
    found = hyper_boxes(Graph(sphere() | move(0, 0, -2) * halfspace()))
    assert found.kind == "exact"
    assert found.scene.lower == (-INF, -INF, -INF)
    assert found.scene.upper[0] == INF
    assert found.scene.upper[2] == pytest.approx(1)
    assert_box(found.scene_box, (-1, -1, -1), (1, 1, 1))
    cut = hyper_boxes(Graph(sphere() & move(0, 0, 0.5) * halfspace()))
    assert_box(cut.scene, (-1, -1, -1), (1, 1, 0.5))
    alone = hyper_boxes(Graph(halfspace() - sphere()))
    assert alone.scene_box.lower[0] > alone.scene_box.upper[0]
    # A wedge of half-spaces bounds nothing alone, but cuts what it meets.
    wedge = rotx(90) * halfspace() | rotx(180) * halfspace()
    met = hyper_boxes(Graph(box() & wedge))
    assert all(map(math.isfinite, met.scene.upper))


def test_large_unions_are_searched_in_arrays() -> None:
    rng = random.Random(1)
    node: Node = sphere()
    for _ in range(300):
        place = [rng.uniform(-9, 9) for _ in range(3)]
        node = node | move(*place) * rotz(rng.uniform(0, 90)) * scale(1, 2, 3) * box()
    graph = Graph(rotz(30) * rotx(20) * node)
    assert_box(hyper_boxes(graph).scene, *union_box(graph), 1e-6)


def test_the_search_prunes_only_what_is_smaller() -> None:
    # Two balls far apart on a diagonal, turned upright: they reach all the way to the ball around
    # both, and a little beyond another solid that is found first.
    both = move(8, 8, 8) * sphere() | move(-8, -8, -8) * sphere()
    upright = prefix("roty")(-math.degrees(math.atan(math.sqrt(2)))) * rotz(-45) * both
    graph = Graph(upright | move(0, 0, 13.5) * sphere())
    found = hyper_boxes(graph)
    assert_box(found.scene, *union_box(graph), 1e-6)
    assert found.scene.upper[2] == pytest.approx(8 * math.sqrt(3) + 1)


def local_points(rng: random.Random, graph: Graph) -> list[Vector]:
    """Return points in and near the leaves of a graph, in world coordinates."""
    points = []
    for leaf in oracle.leaves(graph):
        for _ in range(8):
            p = [rng.uniform(-1.2, 1.2) for _ in range(3)]
            x, y, z = (sum(r[k] * p[k] for k in range(3)) + r[3] for r in leaf.frame)
            points.append((x, y, z))
    return points


def assert_contains(graph: Graph, boxes: list[Box], seed: int) -> None:
    for p in local_points(random.Random(seed), graph):
        if oracle.contains(graph, p):
            for found in boxes:
                inside = zip(found.lower, p, found.upper, strict=True)
                assert all(a <= x <= b for a, x, b in inside), (p, found)


@given(solid_graphs(), st.integers(0, 99))
def test_solids_lie_in_their_boxes(graph: Graph, seed: int) -> None:
    assert_contains(graph, [hyper_boxes(graph).scene], seed)


@given(graphs(), st.integers(0, 99))
def test_grammars_lie_in_both_kinds_of_boxes(graph: Graph, seed: int) -> None:
    states = enumerate_states(graph)
    if states.diagnostics:
        return
    exact = hyper_boxes(graph, None, states)
    loose, scene, _ = range_boxes(graph)
    assert_contains(graph, [exact.scene, Box(scene[:3], scene[3:])], seed)
    # Intervals see at least what states see, at every node.
    slack = 1e-7 * (1.0 + np.abs(np.nan_to_num(exact.boxes, posinf=0.0, neginf=0.0)).max())
    for a, b in zip(exact.boxes, np.array(loose), strict=True):
        if a[0] <= a[3]:
            assert np.all(a[:3] >= b[:3] - slack), (a, b)
            assert np.all(a[3:] <= b[3:] + slack), (a, b)


def test_continuous_parameters_get_interval_boxes() -> None:
    graph = terrain(10)
    found = hyper_boxes(graph)
    assert found.kind == "interval"
    assert all(map(math.isfinite, (*found.scene.lower, *found.scene.upper)))
    modules = module_boxes(graph, found)
    assert modules["T1"][[0, 1, 3, 4]] == pytest.approx([0, 0, 1, 1], abs=1e-8)
    assert modules["T2"][[0, 1, 3, 4]] == pytest.approx([-1, -1, 0, 0], abs=1e-8)
    # The corners of a smaller order are corners of the larger one, too.
    lower, upper = union_box(terrain(4))
    assert found.scene.lower[2] < lower[2]
    assert upper[2] < found.scene.upper[2] < 4.0
    assert range_boxes(terrain(4))[1][5] >= upper[2]


def test_turns_by_chance_get_interval_boxes() -> None:
    found = hyper_boxes(plant(13))
    assert found.kind == "interval"
    lower, upper = union_box(plant(9))
    assert np.all(np.array(found.scene.lower) <= lower)
    assert np.all(np.array(found.scene.upper) >= upper)
    assert np.all(np.array(found.scene.upper) < 5.0)


def test_contractions_are_bounded_without_their_states() -> None:
    found = hyper_boxes(sierpinski(100_000))
    assert found.kind == "interval"
    assert_box(found.scene, (-1, -1, -1), (1, 1, 1), 1e-3)


def test_cycles_of_shrinking_states() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere())
    s.rule(2, sphere() | C(c=P.c * 1) * move(1, 0, 0) * uscale(0.5) * s)
    found = hyper_boxes(Graph(C(c=1) * s))
    assert found.kind == "interval"
    # The ends of the chain gather at x = 2.
    assert found.scene.lower[0] == pytest.approx(-1.0, abs=0.1)
    assert 2.0 <= found.scene.upper[0] < 2.2


def test_growth_without_bound_is_told() -> None:
    s = S("S", if_(call("rand", P.x) < 0.999, 2, 1)).rule(1, sphere())
    s.rule(2, sphere() | C(x=P.x + 0.37) * move(1, 0, 0) * s)
    found = hyper_boxes(Graph(C(x=0) * s), None, enumerate_states(Graph(C(x=0) * s), budget=100))
    assert found.kind == "unbounded"
    assert found.scene.upper[0] == INF


def test_deep_chains_need_no_recursion() -> None:
    node: Node = sphere()
    for k in range(50_000):
        node = (move(1e-3, 0, 0) if k % 2 else rotz(90)) * node
    found = hyper_boxes(Graph(node))
    assert all(map(math.isfinite, found.scene.upper))
    nested: Node = sphere()
    for _ in range(1000):
        nested = (nested | sphere()) & sphere()
    assert_box(hyper_boxes(Graph(nested)).scene, (-1, -1, -1), (1, 1, 1))
