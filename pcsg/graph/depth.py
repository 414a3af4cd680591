"""How deep a derivation goes: selections on a path, and recursion without end.

A frame that shrinks below rounding on the way ends the recursion and is no fault; see
docs/solids.md, ends of recursion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import Diagnostic
from pcsg.graph.faults import DEPTH_LIMIT, fault_diagnostic
from pcsg.graph.graph import Graph
from pcsg.graph.liveness import Liveness
from pcsg.graph.states import StateGraph, StateItem
from pcsg.jit import njit
from pcsg.vec import IDENTITY, Affine, compose, invert, load_affine

MOST_SELECTIONS = 2_000_000
"""Selections on a path; more are a fault, for every engine."""


def check_depth(found: StateGraph, limit: int) -> None:
    """Report a path with more selections than allowed, and recursion without end."""
    position = {k: i for i, k in enumerate(found.children_first)}
    for k in found.children_first:
        back = [s for s in found.successors[k] if position[s] >= position[k]]
        if back:
            found.acyclic = False
            cycle = _way(found, back[0], k)
            _report(found, found._chain(back[0]), cycle[1:] + cycle[:1], limit)
            return
    depth = [0] * len(found.states)
    deepest = [-1] * len(found.states)
    for k in found.children_first:
        for s in found.successors[k]:
            if deepest[k] < 0 or depth[s] > depth[deepest[k]]:
                deepest[k] = s
        below = depth[deepest[k]] if deepest[k] >= 0 else 0
        depth[k] = below + found._is_selection(k)
    if depth[0] > limit:
        chain, k = [], deepest[0]
        while k >= 0:
            chain.append(k)
            k = deepest[k]
        _report(found, chain, [], limit)


def _way(found: StateGraph, start: int, end: int) -> list[int]:
    """Return a way from one state to another, both included."""
    before = {start: start}
    queue = [start]
    for k in queue:
        if k == end:
            break
        for s in found.successors[k]:
            if s not in before:
                before[s] = k
                queue.append(s)
    way = [end]
    while way[-1] != start:
        way.append(before[way[-1]])
    return way[::-1]


def _report(found: StateGraph, chain: list[int], loop: list[int], limit: int) -> None:
    """Report states that lead too deep, unless their frame shrinks to nothing.

    Parameters
    ----------
    chain, loop
        States one within the other, and those that come after them again and again.
    """
    states = [k for k in chain if found._is_selection(k)]
    again = [k for k in loop if found._is_selection(k)]
    rounds = -(-(limit + 1 - len(states)) // len(again)) if again else 0
    path = (states + again * max(rounds, 0))[: limit + 1]
    places = [_place(found, above, k) for above, k in zip([0, *chain], chain, strict=False)]
    turns = [_place(found, above, k) for above, k in zip([*loop[-1:], *loop], loop, strict=False)]
    steps = len(chain) + max(rounds, 0) * len(loop)
    matrices = np.array([*places, *turns], np.float64).ravel()
    if count_until_shrunk(matrices, len(chain), steps) >= 0:
        return
    last = found.states[path[-1]]
    live = Liveness(found.graph).slots[last.start]
    slots = tuple(found.graph.slots)
    values = {slots[i]: v for i, v in zip(live, last.values, strict=True)}
    links = {k: found._link(k) for k in {*states, *again}}
    found.diagnostics.append(
        depth_fault(found.graph, last.node, [links[k] for k in path], values, limit)
    )


def _place(found: StateGraph, above: int, k: int) -> Affine:
    """Return the matrix of the first item of a state that is another one."""
    content = found.states[above].content or ()
    return next(i for i in content if isinstance(i, StateItem) and i.state == k).state_from_child


def depth_fault(
    graph: Graph,
    node: int,
    path: Sequence[tuple[str, int]],
    values: Mapping[str, float],
    limit: int,
) -> Diagnostic:
    """Return the diagnostic of a path with too many selections."""
    detail = f"more than {limit} modules on a path"
    return fault_diagnostic(DEPTH_LIMIT, graph, node, None, path, values, detail)


@njit(entry=True)
def count_until_shrunk(matrices: NDArray[np.float64], loop: int, most: int) -> int:
    """Return after how many steps inwards a frame is below rounding; -1 where it is not.

    Parameters
    ----------
    matrices : float64 (12 K,)
        outer_from_inner of every step.
    loop
        The step with which it begins again after the last one.
    most
        Steps.
    """
    m = IDENTITY
    n = len(matrices) // 12
    at = 0
    for step in range(most):
        if at == n:
            at = loop
        inverse, _ = invert(load_affine(matrices, 12 * at))
        m = compose(inverse, m)
        at += 1
        for k in range(12):
            # The negation also answers for NaN, from products beyond the range of numbers.
            if not abs(m[k]) <= (2.0**52 if k % 4 == 3 else 1e150):
                return step + 1
    return -1
