"""The paper's listings as corrected, and the other grammars of the gallery that are built here."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pcsg.errors import GrammarError
from pcsg.grammar import check_file, load_file, load_text
from pcsg.graph.build import CONSTRUCTORS as K
from pcsg.graph.build import C, S
from pcsg.graph.counts import count_primitives
from pcsg.graph.expr import Expr, P, if_
from pcsg.graph.graph import Graph, content
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.tape import Program
from pcsg.graph.text import to_pcsg

GRAMMARS = Path(__file__).parents[2] / "grammars"
FILES = ["tree", "sierpinski", "sierpinski-pl", "leaf", "fig5a", "menger", "terrain"]
FIG_3A = """
{c=6} S // definition of the start node and initialization of c
S if(c > 0,2,1) // declaration of the module S and its selection function
1: S \u2192 tetrahedron // terminating rule
2: S \u2192 {c=c-1} move(0.5,0.5,0.5) uscale(0.5) S \u222a // generating rule
           move(-0.5,-0.5,0.5) uscale(0.5) S \u222a
           move(0.5,-0.5,-0.5) uscale(0.5) S \u222a
           move(-0.5,0.5,-0.5) uscale(0.5) S
"""
CORNERS = [(0.5, 0.5, 0.5), (-0.5, -0.5, 0.5), (0.5, -0.5, -0.5), (-0.5, 0.5, -0.5)]


def _without_settings(name: str) -> Graph:
    return Graph(load_file(GRAMMARS / f"{name}.pcsg").root)


def shape(graph: Graph) -> list[tuple[object, list[int]]]:
    """Return nodes and edges without attributes: what a grammar is, not how it looks."""

    def below(node: Node) -> Node:
        while isinstance(node, Attribute):
            node = node.successor
        return node

    number: dict[Node, int] = {}
    stack = [below(graph.root)]
    while stack:
        node = stack.pop()
        if node not in number:
            number[node] = len(number)
            stack.extend(below(n) for n in reversed(node.successors))
    return [(content(n), [number[below(s)] for s in n.successors]) for n in number]


@pytest.mark.parametrize("name", FILES)
def test_grammars_load_without_a_word_and_come_back_from_text(name: str) -> None:
    graph, diagnostics = check_file(GRAMMARS / f"{name}.pcsg")
    assert graph is not None and not diagnostics
    assert load_text(to_pcsg(graph)) == graph
    assert (GRAMMARS / f"{name}.pcsg").read_text(encoding="utf-8").startswith("// ")


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("tree", 557_058),
        ("sierpinski", 4**6),
        ("sierpinski-pl", 4**6),
        ("leaf", 5 + 3),
        ("fig5a", 118_785),
        ("menger", 1 + 3 * 73),
        ("terrain", 2 * 4**6),
    ],
)
def test_primitive_equivalents(name: str, count: int) -> None:
    assert count_primitives(load_file(GRAMMARS / f"{name}.pcsg")) == count


def test_fig_3a_is_the_graph_of_fig_3b() -> None:
    module = S("S", if_(P.c > 0, 2, 1))
    part = [K["move"](*p) * K["uscale"](0.5) * module for p in CORNERS]  # type: ignore[operator]
    module.rule(1, K["tetrahedron"])  # type: ignore[arg-type]
    module.rule(2, C(c=P.c - 1) * (part[0] | part[1] | part[2] | part[3]))
    assert _without_settings("sierpinski") == Graph(C(c=6) * module)


def test_literal_fig_3a_tells_the_repair() -> None:
    with pytest.raises(GrammarError) as caught:
        load_text(FIG_3A)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "endless-cycle"
    assert diagnostic.hint is not None
    assert diagnostic.hint.endswith("`2: S -> {c=c-1} ( move... | ... )`")
    repaired = re.sub(r"(\{c=c-1\}) ([^$]*)", r"\1 ( \2 )", FIG_3A)
    assert load_text(repaired) == _without_settings("sierpinski")


def test_literal_fig_2() -> None:
    part = " \u222a ".join(f"move({x:g},{y:g},{z:g}) uscale(0.5) S(c-1)" for x, y, z in CORNERS)
    text = f"w:S(6) // axiom\np1:S(c) : c=0 \u2192 tetrahedron\np2:S(c) : c>0 \u2192 {part}"
    assert load_text(text) == _without_settings("sierpinski-pl")


def test_macros_of_fig_6_may_be_parameters_too() -> None:
    graph = load_file(GRAMMARS / "leaf.pcsg")
    assert count_primitives(graph.override({"D": 0.5, "thickness": 0.1})) == 8


def test_orders_by_override() -> None:
    sierpinski = load_file(GRAMMARS / "sierpinski.pcsg")
    assert count_primitives(sierpinski.override({"c": 40.0})) == 4**40


# The terrain's corners.


def walk_terrain(order: int, seed: float) -> Iterator[tuple[str, dict[str, float], list[float]]]:
    """Expand the terrain: leaf, parameters there, and the place (x, y, scale) of its frame."""
    graph = load_file(GRAMMARS / "terrain.pcsg").override({"cnt": float(order)})
    slots = graph.slots
    program = Program(slots)
    code: dict[tuple[Expr, ...], int] = {}

    def run(exprs: tuple[Expr, ...], stores: list[str], values: list[float]) -> list[float]:
        if exprs not in code:
            code[exprs] = program.add(exprs, stores)
        return program.evaluate(code[exprs], values)

    start = [float("nan")] * len(slots)
    start[slots["SEED"]] = seed
    stack: list[tuple[Node, list[float], list[float]]] = [(graph.root, start, [0.0, 0.0, 1.0])]
    while stack:
        node, values, (x, y, s) = stack.pop()
        if isinstance(node, Selection):
            assert node.select is not None
            below: Node = node.rules[round(run((node.select,), [], values)[0])]
            stack.append((below, values, [x, y, s]))
        elif isinstance(node, Calculation):
            values = list(values)
            run(tuple(e for _, e in node.assignments), [n for n, _ in node.assignments], values)
            stack.append((node.successor, values, [x, y, s]))
        elif isinstance(node, Transformation):
            args = run(node.args, [], values)
            if node.transform.name == "move" and args[2] == 0.0:
                x, y = x + s * args[0], y + s * args[1]
            elif node.transform.name == "scale":
                s *= args[0]
            stack.append((node.successor, values, [x, y, s]))
        elif isinstance(node, Operation):
            stack.extend((o, values, [x, y, s]) for o in node.operands)
        elif isinstance(node, Leaf):
            names = {n: values[slots[n]] for n in slots if not n.startswith("@")}
            yield node.solid.name, names, [x, y, s]
        else:
            stack.append((node.successors[0], values, [x, y, s]))


@pytest.mark.parametrize("seed", [0.0, 3.0])
def test_shared_corners_of_the_terrain_agree_bit_for_bit(seed: float) -> None:
    order = 4
    heights: dict[tuple[float, float], float] = {}
    triangles = 0
    for leaf, v, (x, y, s) in walk_terrain(order, seed):
        triangles += 1
        sign = {"tri1": 1.0, "tri2": -1.0}[leaf]
        # The parameters are where the frame puts the triangle, exactly.
        offset = v["ox"]
        assert (v["x1"] - offset, v["y1"]) == (x, y)
        assert (v["x2"] - offset, v["y2"]) == (x + sign * s, y)
        assert (v["x3"] - offset, v["y3"]) == (x, y + sign * s)
        for k in "123":
            corner = (v[f"x{k}"], v[f"y{k}"])
            assert heights.setdefault(corner, v[f"z{k}"]) == v[f"z{k}"]
    assert triangles == 2 * 4**order
    assert len(heights) == (2**order + 1) ** 2
    assert len({z for z in heights.values() if z}) > len(heights) // 2


def test_another_seed_is_another_terrain() -> None:
    flat = [[v["z1"] for _, v, _ in walk_terrain(2, seed)] for seed in (0.0, 1.0)]
    assert flat[0] != flat[1]
