"""Checks of graphs that were built in Python: no text, no excerpt, the same mistakes."""

from __future__ import annotations

from pcsg.graph.build import CONSTRUCTORS as K
from pcsg.graph.build import C, S
from pcsg.graph.expr import P, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Node, as_node
from pcsg.graph.termination import check_termination, strong_components
from pcsg.graph.validate import check_graph

move, uscale = K["move"], K["uscale"]
sphere: Node = as_node(K["sphere"])  # type: ignore[arg-type]
tri1: Node = as_node(K["tri1"])  # type: ignore[arg-type]


def codes(root: Node) -> list[str]:
    diagnostics = check_graph(Graph(root))
    assert all(d.span is None and d.render() for d in diagnostics)
    return [d.code for d in diagnostics]


def test_a_cycle_that_counts_down_is_fine() -> None:
    m = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere)
    m.rule(2, sphere | C(c=P.c - 1) * uscale(0.5) * m)  # type: ignore[operator]
    assert codes(C(c=3) * m) == []


def test_the_repair_of_fig_3a_is_told_without_text() -> None:
    m = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere)
    m.rule(2, C(c=P.c - 1) * move(1, 0, 0) * m | uscale(0.5) * m)  # type: ignore[operator]
    (diagnostic,) = check_termination(Graph(C(c=3) * m))
    assert diagnostic.code == "endless-cycle"
    assert diagnostic.hint is not None
    assert "`2: S -> {c = c - 1} ( move... | ... )`" in diagnostic.hint


def test_assigning_a_parameter_to_itself_changes_nothing() -> None:
    m = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere)
    m.rule(2, sphere | C(c=P.c) * m)
    assert codes(C(c=3) * m) == ["endless-cycle"]


def test_parameters_of_the_whole_component_count() -> None:
    # T reads d, which changes on the way through S; S alone reads c, which never changes.
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere)
    t = S("T", if_(P.d > 0, 2, 1)).rule(1, sphere)
    s.rule(2, C(d=P.d - 1) * t)
    t.rule(2, s)
    assert codes(C(c=3, d=3) * s) == []


def test_every_cycle_of_a_component_must_change_something() -> None:
    s = S("S", if_(P.c > 0, 2, 1)).rule(1, sphere)
    t = S("T", if_(P.c > 1, 2, 1)).rule(1, sphere)
    s.rule(2, C(c=P.c - 1) * s | t)
    t.rule(2, s)
    (diagnostic,) = check_termination(Graph(C(c=3) * s))
    assert diagnostic.message.startswith("endless cycle S -> T -> S")
    assert [text for text, _ in diagnostic.notes] == [
        "rule 2 of `S` leads to `T`",
        "rule 2 of `T` leads to `S`",
    ]


def test_world_queries_let_transformations_end_a_cycle() -> None:
    def grow(step: float | None) -> Node:
        m = S("S", if_(call("worldz", 0, 0, 0) < 5, 2, 1)).rule(1, sphere)
        return m.rule(2, sphere | (move(0, 0, step) * m if step else m))  # type: ignore[operator]

    assert codes(grow(1.0)) == []
    assert codes(grow(None)) == ["endless-cycle"]


def test_modules_without_a_terminating_rule() -> None:
    s, t = S("S", P.c), S("T")
    s.rule(1, C(c=P.c - 1) * t | sphere)
    s.rule(2, C(c=P.c - 2) * t)
    t.rule(1, s & sphere)
    (diagnostic,) = check_termination(Graph(C(c=1) * s))
    assert diagnostic.code == "no-terminating-rule"
    assert "`S`" in diagnostic.message and "`T`" in diagnostic.message
    # What merely uses them is not to blame.
    u = S("U").rule(1, C(c=1) * s)
    (diagnostic,) = check_termination(Graph(u))
    assert "`U`" not in diagnostic.message


def test_sheets_and_parameters() -> None:
    sheet = S("Sheet").rule(1, uscale(0.5) * tri1 | sphere)  # type: ignore[operator]
    assert codes(sphere - sheet) == ["sheet-subtracted"]
    assert codes(tri1 - sphere) == []
    assert codes(sphere - (sphere - tri1)) == ["sheet-subtracted", "sheet-subtracted"]
    assert codes(uscale(P.size) * sphere) == ["parameter-never-assigned"]  # type: ignore[operator]
    assert codes(C(a=P.b, b=1) * sphere) == ["parameter-never-assigned"]


def test_strong_components_of_a_long_ring_and_of_a_long_chain() -> None:
    n = 200_000
    ring = [((k + 1) % n,) for k in range(n)]
    (component,) = strong_components(ring, set(range(n)))
    assert len(component) == n
    assert strong_components(ring, set(range(1, n))) == []
    assert strong_components([(0,), (2,), (1, 0)], {0, 1, 2}) == [[0], [2, 1]]
