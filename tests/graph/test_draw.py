from __future__ import annotations

import re
from itertools import combinations
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paper_graphs import cylinder, fig5a, move, random_graph, sierpinski, sphere

from pcsg.errors import UsageError
from pcsg.graph.build import C, S, define
from pcsg.graph.diagram import make_diagram
from pcsg.graph.display import Label, Picture, Rectangle, paint, text_width
from pcsg.graph.draw import draw, draw_dot, draw_png, draw_svg
from pcsg.graph.expr import P, call
from pcsg.graph.graph import Graph
from pcsg.graph.layout import find_back_edges
from pcsg.graph.nodes import AttributedForm, Calculation, Operation, Selection

SVG = "{http://www.w3.org/2000/svg}"


def texts(graph: Graph, merge_chains: bool = True) -> list[str]:
    tree = ElementTree.fromstring(draw_svg(graph, merge_chains))
    return [e.text or "" for e in tree.iter(f"{SVG}text")]


def test_sierpinski_shows_what_fig_3b_shows() -> None:
    found = texts(sierpinski())
    for text in ("c = 6", "S", "if(c > 0, 2, 1)", "1", "2", "c = c - 1", "tetrahedron"):
        assert found.count(text) == 1
    assert found.count("uscale(0.5)") == 4
    tree = ElementTree.fromstring(draw_svg(sierpinski()))
    assert len(list(tree.iter(f"{SVG}polygon"))) == 4 + 1  # four ways back, one way in


def test_only_ways_back_have_their_colour() -> None:
    picture = draw_svg(fig5a())
    back = re.findall(r'<path [^>]*stroke="#c8502e"', picture)
    diagram = make_diagram(fig5a())
    assert len(back) == len(find_back_edges(diagram.successors)) == 4


def test_definitions_show_their_names() -> None:
    found = texts(fig5a())
    for name in ("segment", "leaf", "connected_balls"):
        assert found.count(name) == 1


@given(st.integers(0, 10_000), st.booleans())
def test_the_diagram_shows_every_node_once(seed: int, merge_chains: bool) -> None:
    graph = random_graph(seed)
    diagram = make_diagram(graph, merge_chains)
    assert sorted(graph.number[n] for b in diagram.boxes for n in b.nodes) == list(
        range(len(graph.nodes))
    )
    for box, heads in zip(diagram.boxes, diagram.successors, strict=True):
        shown = [diagram.boxes[h].nodes[0] for h in heads]
        assert shown == list(box.nodes[-1].successors)
        for upper, lower in zip(box.nodes, box.nodes[1:], strict=False):
            assert upper.successors == (lower,)
    if not merge_chains:
        assert len(diagram.boxes) == len(graph.nodes)


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_labels_do_not_overlap_and_lie_inside(seed: int) -> None:
    picture = draw(random_graph(seed))
    frames = []
    for shape in picture.shapes:
        if isinstance(shape, Label):
            width = text_width(shape.text, shape.size)
            left = shape.x - width / 2 if shape.centred else shape.x
            half = 0.4 * shape.size
            frames.append((left, shape.y - half, left + width, shape.y + half))
    for (a, b, c, d), (e, f, g, h) in combinations(frames, 2):
        assert c <= e or g <= a or d <= f or h <= b
    for a, b, c, d in frames:
        assert a >= 0 and b >= 0 and c <= picture.width and d <= picture.height


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_drawings_are_well_formed_and_always_the_same(seed: int) -> None:
    graph = random_graph(seed)
    assert draw_svg(graph) == draw_svg(random_graph(seed))
    ElementTree.fromstring(draw_svg(graph))
    check_dot(graph, draw_dot(graph))


def check_dot(graph: Graph, text: str) -> None:
    lines = text.splitlines()
    assert lines[0] == "digraph pcsg {" and lines[-1] == "}"
    diagram = make_diagram(graph)
    value = r'(?:"(?:[^"\\]|\\.)*"|[\w.]+)'
    attributes = rf"\[\w+={value}(?:, \w+={value})*\]"
    nodes = [line for line in lines if re.fullmatch(rf"  n\d+ {attributes};", line)]
    edges = [line for line in lines if re.fullmatch(rf"  n\d+ -> n\d+(?: {attributes})?;", line)]
    assert len(nodes) == len(diagram.boxes)
    assert len(edges) == sum(map(len, diagram.successors))
    assert len(nodes) + len(edges) + 4 == len(lines)
    dashed = sum("style=dashed" in line for line in edges)
    assert dashed == len(find_back_edges(diagram.successors))


def test_dot_escapes_what_it_must() -> None:
    graph = Graph(sphere() - cylinder())
    check_dot(graph, draw_dot(graph))


def test_a_difference_marks_what_is_taken_away() -> None:
    diagram = make_diagram(Graph(sphere() - cylinder() - sphere()))
    assert isinstance(diagram.boxes[0].nodes[0], Operation)
    assert diagram.boxes[0].edge_labels == (None, "-", "-")


def test_attributed_modules_show_formals_conditions_and_calls() -> None:
    module = Selection("S", call("if", P.c > 0, 2, 1))
    module.attributed = AttributedForm(("c", "d"), ("p1", "p2"), (P.c <= 0, None))
    again = Calculation((("c", P.c - 1), ("d", P.c)), module, call=True)
    module.rule(1, sphere()).rule(2, move(1, 0, 0) * again)
    found = texts(Graph(C(c=1, d=2) * module))
    for text in ("S(c, d)", "p1: c <= 0", "p2: else", "(c, d) = (c - 1, c)"):
        assert text in found


def test_long_texts_are_wrapped_and_very_long_ones_cut() -> None:
    value = P.c
    for k in range(40):
        value = value + call("rand", P.c, k)
    found = texts(Graph(C(c=1) * C(c=value) * sphere()))
    assert 10 < len(found) < 40
    assert all(text_width(text, 13.0) <= 260 for text in found)
    assert texts(Graph(define("x" * 400, move(1, 2, 3) * sphere())))


def test_chains_that_are_too_long_are_split() -> None:
    node = sphere()
    for _ in range(5000):
        node = move(1, 0, 0) * node
    diagram = make_diagram(Graph(node))
    assert max(len(b.rows) for b in diagram.boxes) == 16
    ElementTree.fromstring(draw_svg(Graph(node)))


def test_pixels_show_the_colours_of_the_nodes() -> None:
    image = draw_png(sierpinski(), scale=1.0)
    picture = draw(sierpinski())
    assert abs(image.width - picture.width) <= 1 and abs(image.height - picture.height) <= 1
    pixels = image.load()
    assert pixels is not None
    for shape in picture.shapes:
        # Beside the text, near the left edge of every box.
        if isinstance(shape, Rectangle) and shape.width > 40:
            at = (round(shape.x + 3), round(shape.y + shape.height / 2 + 2))
            color = tuple(int(shape.fill[k : k + 2], 16) for k in (1, 3, 5))
            assert pixels[at] == color


def test_pictures_too_large_are_refused_and_large_ones_made_coarser() -> None:
    assert paint(Picture(40_000, 100, (), ""), 2.0).width == 30_000
    with pytest.raises(UsageError, match="too large"):
        paint(Picture(400_000, 400_000, (), ""))


def test_a_module_that_is_its_own_rule() -> None:
    module = S("S", P.c)
    module.rule(1, module).rule(2, C(c=1) * module)
    ElementTree.fromstring(draw_svg(Graph(C(c=2) * module)))
