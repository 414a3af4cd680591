from __future__ import annotations

from analysis_graphs import terrain
from paper_graphs import color, fig5a, move, prefix, rotz, scale, sierpinski, sphere, uscale

from pcsg.graph.build import C, S
from pcsg.graph.expr import P, call, if_
from pcsg.graph.graph import FRAME_SLOTS, Graph
from pcsg.graph.liveness import Liveness
from pcsg.graph.nodes import Calculation, Leaf, Node, Selection


def live(graph: Graph, selections_only: bool = False) -> dict[str, set[str]]:
    found = Liveness(graph, selections_only).live
    return {n.name: set(found[k]) for k, n in enumerate(graph.nodes) if isinstance(n, Selection)}


def test_counter_is_live_at_the_module_and_nothing_at_the_axiom() -> None:
    graph = sierpinski()
    found = Liveness(graph).live
    assert live(graph) == {"S": {"c"}}
    assert found[0] == frozenset()
    assert all(
        found[k] == frozenset() for k, node in enumerate(graph.nodes) if isinstance(node, Leaf)
    )


def test_fig5a() -> None:
    found = live(fig5a())
    leaf = {"D", "thickness", "dy", "dz", "fx", "fy", "fz"}
    segments = {"cnt", "noleaves", "segments", "fxSG", "fySG", "dSG", "fLV"} | leaf
    assert found["SG"] == segments
    assert found["TR"] == segments | {
        *("trunk", "fTR", "gamma", "alpha1", "alpha2", "fBR1", "fBR2"),
    }
    only = live(fig5a(), selections_only=True)
    assert only == {
        "SG": {"cnt", "noleaves", "segments"},
        "TR": {"cnt", "noleaves", "segments", "trunk"},
    }


def test_terrain_selects_by_its_counter_only() -> None:
    assert live(terrain(3), selections_only=True) == {"T1": {"cnt"}, "T2": {"cnt"}}
    heights = {"z1", "z2", "z3", "delta", "x1", "y2", "frc"}
    assert heights <= live(terrain(3))["T1"]


def test_assignments_are_seen_in_order_and_in_parallel_in_a_call() -> None:
    leaf = move(P.a, P.b, 0) * sphere()
    first = S("A").rule(1, C(a=1.0, b=P.a + P.d) * leaf)
    call_node = Calculation((("a", P.b), ("b", P.a)), leaf, call=True)
    second = S("B").rule(1, call_node)
    third = S("D").rule(1, C(a=P.b, b=P.a) * leaf)
    found = live(Graph(C(a=1, b=2, d=3) * (first | second | third)))
    assert found == {"A": {"d"}, "B": {"a", "b"}, "D": {"b"}}


def test_an_assignment_nobody_reads_keeps_nothing_alive() -> None:
    s = S("A").rule(1, C(unused=P.x * 2) * sphere())
    graph = Graph(C(x=1) * s)
    liveness = Liveness(graph)
    assert live(graph) == {"A": set()}
    k = next(k for k, n in enumerate(graph.nodes) if isinstance(n, Calculation) and k > 0)
    assert liveness.used_assignments(k) == []


def test_leaves_read_the_attributes_that_something_assigns() -> None:
    below = S("A").rule(1, sphere())
    found = live(Graph(color(1, 0, 0) * below | prefix("label")(3) * below))
    assert found["A"] == {"@red", "@green", "@blue", "@label"}
    inside = S("A").rule(1, color(P.x, 0, 0) * sphere())
    assert live(Graph(C(x=1) * inside))["A"] == {"x"}


def test_the_frame_is_live_above_world_queries_through_transformations() -> None:
    asks = S("A").rule(1, rotz(call("worldx", 1, 0, 0)) * sphere())
    above = S("B").rule(1, scale(P.q, 1, 1) * asks)
    found = live(Graph(C(q=2) * above | sphere()))
    assert found["A"] == set(FRAME_SLOTS)
    assert found["B"] == {*FRAME_SLOTS, "q"}
    selects = S("C", if_(call("worldz", 0, 0, 0) > 0, 2, 1)).rule(1, sphere()).rule(2, sphere())
    graph = Graph(C(q=2, r=3) * S("D").rule(1, uscale(P.q) * selects | uscale(P.r) * sphere()))
    assert live(graph, selections_only=True)["D"] == {*FRAME_SLOTS, "q"}


def test_deep_chains_need_no_recursion() -> None:
    node: Node = sphere()
    for _ in range(20_000):
        node = move(P.x, 0, 0) * node
    assert Liveness(Graph(C(x=1) * node)).live[1] == {"x"}
