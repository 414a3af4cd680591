"""Graphs of the paper's listings, built in Python, and larger ones by chance."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

from pcsg.graph.build import CONSTRUCTORS, C, S, define
from pcsg.graph.expr import P, as_expr, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Node, as_node


def prefix(name: str) -> Callable[..., Any]:
    made: Any = CONSTRUCTORS[name]
    return made  # type: ignore[no-any-return]


move, scale, uscale = prefix("move"), prefix("scale"), prefix("uscale")
rotx, rotz, flipxz, color = prefix("rotx"), prefix("rotz"), prefix("flipxz"), prefix("color")
sphere, cylinder, tetrahedron = prefix("sphere"), prefix("cylinder"), prefix("tetrahedron")


def sierpinski(order: int = 6) -> Graph:
    """Return fig 3a, corrected."""
    s = S("S", if_(P.c > 0, 2, 1))
    corners = [(0.5, 0.5, 0.5), (-0.5, -0.5, 0.5), (0.5, -0.5, -0.5), (-0.5, 0.5, -0.5)]
    a, b, c, d = (move(*corner) * uscale(0.5) * s for corner in corners)
    s.rule(1, tetrahedron()).rule(2, C(c=P.c - 1) * (a | b | c | d))
    return Graph(C(c=order) * s)


def fig5a() -> Graph:
    """Return fig 5a with the leaf of fig 6."""
    big = move(-P.D, 0, 0) * sphere() | move(P.D, 0, 0) * sphere()
    inner = uscale(1 - P.thickness)
    small = move(-P.D, 0, 0) * inner * sphere() | move(P.D, 0, 0) * inner * sphere()
    balls = define("connected_balls", big - small)
    leaf = define("leaf", move(0, P.dy, P.dz) * scale(P.fx, P.fy, P.fz) * cylinder() & balls)
    two = uscale(P.fLV) * leaf | flipxz() * uscale(P.fLV) * leaf
    stem = scale(P.fxSG, P.fySG, P.dSG) * cylinder()
    segment = define("segment", stem | move(0, 0, P.dSG) * two)
    tr = S("TR", if_(P.trunk > 0, 2, if_(P.cnt > 0, 3, 1)))
    sg = S("SG", if_(P.cnt < P.noleaves, if_(P.segments > 0, 3, 2), 1))
    tr.rule(1, sg).rule(2, sg | C(trunk=P.trunk - 1) * move(0, 0, 1) * uscale(P.fTR) * tr)
    left = C(cnt=P.cnt - 1) * rotx(P.alpha1) * uscale(P.fBR1) * tr
    right = C(cnt=P.cnt - 1) * rotx(P.alpha2) * uscale(P.fBR2) * tr
    tr.rule(3, sg | move(0, 0, 1) * rotz(P.gamma) * (left | right))
    sg.rule(1, scale(P.fxSG, P.fySG, 1) * cylinder()).rule(2, segment)
    again = C(segments=P.segments - 1) * move(0, 0, P.dSG) * rotz(-90) * sg
    sg.rule(3, segment | again)
    # fmt: off
    start = C(
        cnt=11, trunk=2, fTR=0.96, gamma=-72, alpha1=-60, alpha2=20, fBR1=0.73, fBR2=0.67,
        noleaves=3, segments=2, fxSG=as_expr(1) / 7, fySG=as_expr(1) / 7, dSG=1 / P.segments,
        fLV=0.6, D=0.4, thickness=0.1, dy=0, dz=0.5, fx=0.3, fy=0.2, fz=1,
    )
    # fmt: on
    return Graph(start * tr)


def random_graph(seed: int, modules: int = 3, depth: int = 4) -> Graph:
    """Return a graph with modules in each other's rules, sharing and all kinds of nodes.

    Its recursion ends because every way back counts a down.
    """
    rng = random.Random(seed)
    made = [S(f"M{k}", if_(P.a > 0, call("mod", P.a + k, 2) + 2, 1)) for k in range(modules)]
    below = C(a=P.a - 1)
    shared: list[Node] = [as_node(define("ball", sphere()))]

    def expression(depth: int) -> Node:
        u = rng.random()
        if depth == 0 or u < 0.08:
            return rng.choice(
                [tetrahedron(), cylinder(), below * rng.choice(made), rng.choice(shared)]
            )
        if u < 0.45:
            return move(round(rng.random(), 2), P.a, 1) * expression(depth - 1)
        if u < 0.6:
            return C(a=P.a - 1, b=P.a * rng.randrange(9)) * expression(depth - 1)
        if u < 0.65:
            return color(1, 0.5, 0) * expression(depth - 1)
        x, y = expression(depth - 1), expression(depth - 1)
        both = x | y if u < 0.85 else x & y if u < 0.92 else x - y
        if rng.random() < 0.1:
            shared.append(both)
        return both

    for k, module in enumerate(made):
        module.rule(1, sphere())
        module.rule(2, expression(depth))
        module.rule(3, expression(depth) | below * made[(k + 1) % modules])
    return Graph(C(a=3, b=1) * made[0])
