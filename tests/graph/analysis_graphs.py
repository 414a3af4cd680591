"""Graphs for the analyses, and brute-force answers to compare with."""

from __future__ import annotations

import math
from typing import Any

import oracle
from paper_graphs import move, prefix, rotx, rotz, scale, sphere, uscale

from pcsg.graph.build import C, Prefix, S
from pcsg.graph.expr import Expr, P, Parameter, call, if_
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Calculation, Node
from pcsg.graph.states import LeafItem, StateGraph, StateItem
from pcsg.leaf import LEAVES
from pcsg.vec import IDENTITY, Affine, Vec3, compose

Vector = tuple[float, float, float]


def plant(order: int) -> Graph:
    """Return a plant whose every branch turns by chance, so that no two states are the same."""
    a = S("A", if_(P.n > 0, 2, 1))
    a.rule(1, uscale(0.1) * sphere())

    def branch(which: int, side: float) -> Any:
        turn = rotz(360 * P.id) * rotx(side * (20 + 30 * P.id))
        return C(n=P.n - 1, id=call("rand", P.id, which)) * turn * uscale(0.7) * a

    stem = scale(0.1, 0.1, 1) * prefix("cylinder")()
    a.rule(2, stem | move(0, 0, 1) * (branch(1, 1.0) | branch(2, -1.0)))
    return Graph(C(n=order, id=P.SEED) * a)


def terrain(order: int) -> Graph:
    """Return fig 8's terrain: midpoints displaced by chance, level by level."""
    corner = {k: (Parameter(f"x{k}"), Parameter(f"y{k}"), Parameter(f"z{k}")) for k in (1, 2, 3)}

    def middle(i: int, j: int) -> tuple[Expr, Expr, Expr]:
        (x1, y1, z1), (x2, y2, z2) = corner[i], corner[j]
        by = (P.add - call("ln", call("randedge", x1, y1, x2, y2) * P.ex + 1.0)) * P.delta
        return (x1 + x2) / 2, (y1 + y2) / 2, (z1 + z2) / 2 + by

    def below(*points: tuple[Expr, Expr, Expr]) -> Prefix:
        named = (zip("xyz", p, strict=True) for p in points)
        new = [(f"{axis}{k}", e) for k, p in enumerate(named, 1) for axis, e in p]
        pairs = [("cnt", P.cnt - 1), ("delta", P.delta * P.frc), *new]
        return Prefix([lambda node: Calculation(tuple(pairs), node, call=True)])

    t1, t2 = (S(name, if_(P.cnt > 0, 2, 1)) for name in ("T1", "T2"))
    zshear, half = prefix("zshear"), scale(0.5, 0.5, 1)
    lift = move(0, 0, P.z1)
    t1.rule(1, lift * zshear(P.z2 - P.z1, P.z3 - P.z1) * prefix("tri1")())
    t2.rule(1, lift * zshear(P.z1 - P.z2, P.z1 - P.z3) * prefix("tri2")())
    for one, other, s in ((t1, t2, 0.5), (t2, t1, -0.5)):
        p12, p13, p23 = middle(1, 2), middle(1, 3), middle(2, 3)
        one.rule(
            2,
            below(corner[1], p12, p13) * half * one
            | below(p12, corner[2], p23) * move(s, 0, 0) * half * one
            | below(p13, p23, corner[3]) * move(0, s, 0) * half * one
            | below(p23, p13, p12) * move(s, s, 0) * half * other,
        )
    first = C(x1=0, y1=0, z1=0, x2=1, y2=0, z2=0, x3=0, y3=1, z3=0) * t1
    second = C(x1=1, y1=1, z1=0, x2=0, y2=1, z2=0, x3=1, y3=0, z3=0) * move(1, 1, 0) * t2
    start = C(cnt=order, frc=0.47, delta=1.0, add=0.6, ex=call("exp", 1.0) - 1.0)
    return Graph(start * (first | second))


def turned(times: int) -> Graph:
    """Return fig 9: a cylinder turned by 45 degrees again and again, one node per turn."""
    node: Node = prefix("cylinder")()
    for _ in range(times):
        node = rotx(45) * node
    return Graph(node)


def leaves_of(found: StateGraph) -> list[tuple[int, tuple[float, ...], Affine]]:
    """Return node, arguments and frame of all leaves of the expanded states, in order."""
    out: list[tuple[int, tuple[float, ...], Affine]] = []

    def walk(k: int, frame: Affine) -> None:
        for item in found.states[k].content or ():
            if isinstance(item, LeafItem):
                place = compose.py_func(frame, item.state_from_leaf)  # type: ignore[attr-defined]
                out.append((item.node, item.args, place))
            elif isinstance(item, StateItem):
                walk(item.state, compose.py_func(frame, item.state_from_child))  # type: ignore[attr-defined]

    walk(0, IDENTITY)
    return out


def union_box(graph: Graph) -> tuple[Vector, Vector]:
    """Return the box of a union from the support of every leaf of the expanded graph."""
    ends = []
    for sign in (-1.0, 1.0):
        for axis in range(3):
            best = -math.inf
            for leaf in oracle.leaves(graph):
                row = leaf.frame[axis]
                d = Vec3(*(sign * x for x in row[:3]))
                support = LEAVES[leaf.name].support_of(d, leaf.args)
                best = max(best, sign * row[3] + support)
            ends.append(sign * best)
    return (ends[0], ends[1], ends[2]), (ends[3], ends[4], ends[5])
