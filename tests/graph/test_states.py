from __future__ import annotations

import math
from typing import Any

import oracle
import pytest
from analysis_graphs import leaves_of, plant, terrain
from hypothesis import given
from paper_graphs import color, fig5a, move, prefix, rotz, scale, sierpinski, sphere, uscale
from strategies import graphs

from pcsg.errors import EvaluationFault, UsageError
from pcsg.graph import faults
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.build import C, S
from pcsg.graph.counts import count_primitives
from pcsg.graph.expr import P, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Node, as_node
from pcsg.graph.operators import DIFFERENCE
from pcsg.graph.states import Combine, LeafItem, StateGraph, StateItem
from pcsg.graph.unroll import STEPS_PER_STATE, enumerate_states


@pytest.mark.parametrize("order", [0, 1, 6, 40])
def test_sierpinski(order: int) -> None:
    found = enumerate_states(sierpinski(order))
    assert (found.count, found.finite, found.acyclic) == (order + 1, True, True)
    assert found.diagnostics == []
    assert count_primitives(sierpinski(order)) == 4**order


def test_fig5a() -> None:
    # The paper's tree: 14 states of TR and 8 of SG. Without the rule in the state, 24: a segment's
    # last rule does not read the counter.
    found = enumerate_states(fig5a())
    assert (found.count, found.finite, found.diagnostics) == (22, True, [])
    assert count_primitives(fig5a()) == 118_785


def test_terrain_is_counted_at_any_order() -> None:
    assert count_primitives(terrain(20)) == 2 * 4**20
    assert count_primitives(terrain(3)) == len(oracle.leaves(terrain(3))) == 128


def test_content_is_the_right_hand_side_with_constant_matrices() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere())
    s.rule(2, move(P.c, 0, 0) * (sphere() - uscale(0.5) * C(c=P.c - 1) * color(1, 0, 0) * s))
    found = enumerate_states(Graph(C(c=1) * s))
    axiom, first, last = found.states
    (item,) = axiom.content or ()
    assert isinstance(item, StateItem)
    ball, below, combine = first.content or ()
    assert isinstance(ball, LeafItem)
    assert ball.state_from_leaf[3] == 1.0
    assert isinstance(below, StateItem)
    assert below.state == 2
    assert below.state_from_child[:4] == (0.5, 0.0, 0.0, 1.0)
    assert combine == Combine(DIFFERENCE, 2)
    (leaf,) = last.content or ()
    assert isinstance(leaf, LeafItem)
    assert leaf.attributes[: len(ATTRIBUTE_SLOTS)][:3] == (1.0, 0.0, 0.0)
    assert found.path(2) == [("S", 2), ("S", 1)]


def _is_faulty(graph: Graph) -> bool:
    try:
        oracle.leaves(graph)
    except oracle.Fault:
        return True
    return False


@given(graphs())
def test_expanded_states_are_the_expanded_grammar(graph: Graph) -> None:
    found = enumerate_states(graph)
    if found.diagnostics:
        assert _is_faulty(graph)
        return
    assert found.finite
    expected = oracle.leaves(graph)
    got = leaves_of(found)
    assert [(n, args) for n, args, _ in got] == [(e.number, e.args) for e in expected]
    for (_, _, frame), e in zip(got, expected, strict=True):
        flat = [x for row in e.frame for x in row]
        assert frame == pytest.approx(flat, rel=1e-9, abs=1e-9)
    assert count_primitives(graph) == sum(e.name != "empty" for e in expected)


def test_states_of_one_place_each_where_the_frame_is_asked_for() -> None:
    s = S("S", if_(P.c > 0, 2, 1))
    s.rule(1, move(call("worldx", 0, 0, 0), 0, 0) * sphere())
    s.rule(2, C(c=P.c - 1) * (move(1, 0, 0) * s | move(-1, 0, 0) * s))
    found = enumerate_states(Graph(C(c=3) * s))
    # Places are binomial: 1 + 2 + 3 + 4 of them.
    assert found.count == 10
    places = sorted(frame[3] for _, _, frame in leaves_of(found))
    assert places == [-6.0, *[-2.0] * 3, *[2.0] * 3, 6.0]


def test_minus_zero_is_another_value() -> None:
    s = S("S").rule(1, rotz(call("atan2", P.y, -1)) * sphere())
    found = enumerate_states(Graph(C(y=0.0) * s | C(y=-0.0) * s))
    assert found.count == 2


@pytest.mark.parametrize("make", [plant, terrain])
def test_the_budget_ends_gracefully(make: Any) -> None:
    found = enumerate_states(make(20), budget=300)
    assert not found.finite
    assert found.diagnostics == []
    visits = sum(len(s.steps) for s in found.states)
    assert visits <= STEPS_PER_STATE * 300 + 100
    assert any(s.content is None for s in found.states)
    assert count_primitives(make(20)) is not None


def test_counting_gives_up_where_every_branch_decides_for_itself() -> None:
    s = S("S", if_(P.x < 0.9999, 2, 1)).rule(1, sphere())
    left, right = (C(x=call("rand", P.x, k)) * s for k in (1, 2))
    s.rule(2, left | right)
    graph = Graph(C(x=0.5) * s)
    assert count_primitives(graph, budget=500) is None


def one_fault(found: StateGraph) -> Any:
    (diagnostic,) = found.diagnostics
    return diagnostic


def recursive(rule: Node, start: float = 3.0) -> Graph:
    s = S("S", if_(P.c > 0, 2, 1))
    s.rule(1, rule).rule(2, C(c=P.c - 1) * move(1, 0, 0) * s)
    return Graph(C(c=start) * s)


FAULTS = {
    faults.NOT_FINITE: move(1 / P.c, 0, 0) * sphere(),
    faults.SINGULAR_MATRIX: scale(1, P.c, 1) * sphere(),
    faults.UNASSIGNED_PARAMETER: move(P.nowhere, 0, 0) * sphere(),
    faults.SELECTION_RANGE: S("T", P.c + 7).rule(1, sphere()).rule(2, sphere()),
    faults.BAD_ARGUMENT: prefix("torus")(P.c - 1),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_faults_name_the_path_and_the_parameters(kind: str) -> None:
    diagnostic = one_fault(enumerate_states(recursive(as_node(FAULTS[kind]))))
    assert diagnostic.code == kind
    assert "axiom > S:2 (3 times) > S:1" in diagnostic.render()
    if kind != faults.UNASSIGNED_PARAMETER:
        assert "c = 0" in diagnostic.render()


def test_details_of_faults() -> None:
    def message(kind: str) -> str:
        found = enumerate_states(recursive(as_node(FAULTS[kind])))
        return str(one_fault(found).message)

    assert "its value is 7, the rules are 1, 2" in message(faults.SELECTION_RANGE)
    assert "scale(1, 0, 1)" in message(faults.SINGULAR_MATRIX)
    assert "`nowhere`" in message(faults.UNASSIGNED_PARAMETER)
    assert "-1" in message(faults.BAD_ARGUMENT)
    assert "0 < " in message(faults.BAD_ARGUMENT)


def test_one_report_for_a_place_however_many_states_meet_it() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere())
    s.rule(2, scale(0, 1, 1) * sphere() | C(c=P.c - 1) * s)
    assert one_fault(enumerate_states(Graph(C(c=9) * s))).code == faults.SINGULAR_MATRIX


def test_a_chain_beyond_the_depth_limit() -> None:
    assert enumerate_states(recursive(as_node(sphere()), 99.0), depth_limit=100).diagnostics == []
    found = enumerate_states(recursive(as_node(sphere()), 100.0), depth_limit=100)
    assert one_fault(found).code == faults.DEPTH_LIMIT
    assert found.finite


def test_recursion_without_end() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere())
    s.rule(2, sphere() | C(c=P.c * 1) * move(1, 0, 0) * s)
    found = enumerate_states(Graph(C(c=1) * s))
    assert one_fault(found).code == faults.DEPTH_LIMIT
    assert not found.acyclic
    assert count_primitives(Graph(C(c=1) * s)) is None


def test_recursion_that_shrinks_to_nothing_is_no_fault() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere())
    s.rule(2, sphere() | C(c=P.c * 1) * move(1, 0, 0) * uscale(0.5) * s)
    found = enumerate_states(Graph(C(c=1) * s))
    assert found.diagnostics == []
    assert not found.acyclic
    assert enumerate_states(sierpinski(300), depth_limit=100).diagnostics == []


def test_shared_expressions_do_not_explode() -> None:
    node: Node = sphere()
    for _ in range(60):
        node = node | move(1, 0, 0) * node
    graph = Graph(node)
    found = enumerate_states(graph)
    assert found.finite
    assert sum(len(s.steps) for s in found.states) < 100_000
    assert count_primitives(graph) == 2**60


def test_deep_chains_need_no_recursion() -> None:
    node: Node = sphere()
    for _ in range(20_000):
        node = move(1e-3, 0, 0) * node
    graph = Graph(node)
    found = enumerate_states(graph)
    (leaf,) = found.states[0].content or ()
    assert isinstance(leaf, LeafItem)
    assert math.isclose(leaf.state_from_leaf[3], 20.0, rel_tol=1e-9)
    assert count_primitives(graph) == 1


def test_globals_are_given_by_name() -> None:
    s = S("S", P.SEED).rule(1, sphere()).rule(2, sphere() | sphere())
    graph = Graph(s)
    assert count_primitives(graph, {"SEED": 2.0}) == 2
    assert count_primitives(graph) is None
    assert enumerate_states(graph).diagnostics[0].code == faults.SELECTION_RANGE
    with pytest.raises(UsageError, match="SEDE"):
        enumerate_states(graph, {"SEDE": 2.0})


def test_the_walker_raises_the_same_diagnostic() -> None:
    graph = sierpinski()
    path = [("S", 2)] * 30 + [("T", k) for k in range(30)]
    raised = faults.evaluation_fault(faults.NOT_FINITE, graph, 1, None, path, {"c": 0.1, "@red": 1})
    assert isinstance(raised, EvaluationFault)
    text = str(raised)
    assert "error[not-finite]" in text
    assert "of module `S`" in text
    assert "c = 0.10000000000000001" in text
    assert "@red" not in text
    assert "... > T:18" in text
    assert "T:29" in text
