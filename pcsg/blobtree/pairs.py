"""Controlled blending: a graph of pairs says what may blend."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.blobtree.blend import Array, Blend, Slots, blend, put, take_positive_parts
from pcsg.errors import UsageError


def find_cliques(neighbours: list[set[int]]) -> list[list[int]]:
    """Return the largest sets of which every pair is allowed (Bron and Kerbosch 1973)."""
    cliques: list[list[int]] = []
    todo: list[tuple[set[int], set[int], set[int]]] = [(set(), set(range(len(neighbours))), set())]
    while todo:
        members, candidates, excluded = todo.pop()
        if not candidates and not excluded:
            cliques.append(sorted(members))
        for v in sorted(candidates):
            near = neighbours[v]
            todo.append((members | {v}, candidates & near, excluded & near))
            candidates, excluded = candidates - {v}, excluded | {v}
    return sorted(cliques)


@blend
class Controlled(Blend):
    """``controlled``: children blend with their neighbours in the list, others only touch.

    The greatest sum over sets of children of which every pair may blend (controlled blending, Guy
    and Wyvill 1995); in Python the graph of pairs may be any.
    """

    alone = True
    slotted = True

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        pairs = [(i, i + 1) for i in range(count - 1)]
        if args:
            pairs = [(int(i), int(j)) for i, j in zip(args[::2], args[1::2], strict=True)]
        neighbours: list[set[int]] = [set() for _ in range(count)]
        for i, j in pairs:
            if not (0 <= i < count and 0 <= j < count) or i == j:
                raise UsageError(f"controlled: there is no pair ({i}, {j}) of {count} children")
            neighbours[i].add(j)
            neighbours[j].add(i)
        cliques = find_cliques(neighbours)
        rows = [float(k in clique) for clique in cliques for k in range(count)]
        return [float(len(cliques)), float(count), *rows]

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        cliques, count = int(args[at]), int(args[at + 1])
        least, most, d_low, d_high = 0.0, 0.0, math.inf, -math.inf
        for sweep in range(2):
            for c in range(cliques):
                row = at + 2 + count * c
                low, high, p_low, p_high = 0.0, 0.0, 0.0, 0.0
                for j in range(base, base + n):
                    if args[row + slots[j]] != 0.0:
                        b = 4 * j
                        low, high = low + values[b], high + values[b + 1]
                        p_low, p_high = p_low + values[b + 2], p_high + values[b + 3]
                if sweep == 0:
                    least, most = max(least, low), max(most, high)
                elif high >= least:
                    d_low, d_high = min(d_low, p_low), max(d_high, p_high)
        put(values, base, least, most, d_low, d_high)
        return 0
