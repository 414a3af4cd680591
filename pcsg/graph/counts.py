"""Primitive equivalents: the number of leaves of the fully expanded CSG tree.

The shape of the derivation depends only on the parameters that selections read, so that counts are
remembered by their values: 4^40 takes 41 entries, whatever the geometry does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from struct import Struct

from pcsg.graph.code import GraphCode, NodeFault
from pcsg.graph.graph import Graph
from pcsg.graph.liveness import Liveness
from pcsg.graph.nodes import Calculation, Leaf, Selection, Transformation
from pcsg.graph.unroll import cuts

BUDGET = 50_000
"""Entries that are remembered before counting is given up."""

Key = tuple[int, bytes]


def count_primitives(
    graph: Graph, globals_values: Mapping[str, float] | None = None, budget: int = BUDGET
) -> int | None:
    """Return the exact number of primitives of the expanded graph, all operands counted.

    None where counting does not end within the budget, or meets a fault.
    """
    return _Counter(graph, globals_values).count(budget)


class _Counter:
    def __init__(self, graph: Graph, globals_values: Mapping[str, float] | None) -> None:
        self.graph = graph
        self.liveness = Liveness(graph, selections_only=True)
        self.code = GraphCode(graph, self.liveness)
        self.cuts = cuts(graph)
        self.initial = self.code.initial(globals_values)
        self.pack = [Struct(f"{len(s)}d") for s in self.liveness.slots]
        self.frame_mask = 1 << self.code.frame_slot if self.code.frame_slot >= 0 else 0

    def count(self, budget: int) -> int | None:
        """Count depth first; an entry that waits for itself would never end."""
        root: Key = (-1, b"")
        done: dict[Key, int] = {}
        waiting: set[Key] = {root}
        try:
            stack = [(root, *self._expand(root))]
            while stack:
                key, own, below = stack[-1]
                todo = next((k for k in below if k not in done), None)
                if todo is None:
                    done[key] = own + sum(n * done[k] for k, n in below.items())
                    waiting.discard(key)
                    stack.pop()
                elif todo in waiting or len(done) + len(stack) > budget:
                    return None
                else:
                    waiting.add(todo)
                    stack.append((todo, *self._expand(todo)))
        except NodeFault:
            return None
        return done[root]

    def _expand(self, key: Key) -> tuple[int, dict[Key, int]]:
        """Return the leaves of an entry itself, and how often it has other entries."""
        graph, code = self.graph, self.code
        start, values = key
        opened = start
        if start < 0:
            start, params = 0, self.initial
        else:
            params = [math.nan] * len(self.initial)
            live = self.liveness.slots[start]
            for slot, value in zip(live, self.pack[start].unpack(values), strict=True):
                params[slot] = value
            node = graph.nodes[start]
            if isinstance(node, Selection):
                start = graph.number[node.rules[code.select(start, params)]]
                opened = -1
        own = 0
        below: dict[Key, int] = {}
        stack = [(start, params)]
        while stack:
            n, params = stack.pop()
            node = graph.nodes[n]
            if n in self.cuts and n != opened:
                found = n, self.pack[n].pack(*[params[s] for s in self.liveness.slots[n]])
                below[found] = below.get(found, 0) + 1
                continue
            if isinstance(node, Leaf):
                own += node.primitives
                continue
            successors = graph.successors[n]
            if isinstance(node, Calculation):
                params = code.assign(n, params)
            elif (
                isinstance(node, Transformation)
                and self.liveness.masks[successors[0]] & self.frame_mask
            ):
                params = code.frame_below(params, code.matrix(n, params))
            stack.extend((s, params) for s in successors)
        return own, below
