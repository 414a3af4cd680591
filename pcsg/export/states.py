"""The table of states, read by those who write a scene elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from pcsg.errors import UsageError
from pcsg.export.looks import Look
from pcsg.export.maps import composed
from pcsg.export.shapes import Floats
from pcsg.export.solids import MOST_OPERANDS, Carved, Primitive
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.nodes import Leaf, Selection
from pcsg.graph.operators import DIFFERENCE, INTERSECTION, UNION
from pcsg.leaf.registry import LEAVES
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.programs import L_ARGS, LEAF_FIELDS
from pcsg.trace.expand.table import LEAF, OPERATION, STATE
from pcsg.vec import IDENTITY

Key = tuple[int, int]
"""A state, and how many modules may follow below it; -1 for any number."""

_DEEPEST = 10_000
"""Modules below the axiom that a depth may name."""


class States:
    """States with their solids, and with those that they lead to.

    Parameters
    ----------
    expansion
        The table, complete.

    Raises
    ------
    UsageError
        A state contains itself.
    """

    def __init__(self, expansion: Expansion) -> None:
        if expansion.order is None:
            raise UsageError("a module of the grammar leads back to itself with the same values")
        table, programs = expansion.table, expansion.programs
        n, m = expansion.n_states, expansion.n_items
        self._expansion = expansion
        self._order: list[int] = expansion.order.tolist()
        self._first, self._last = table.first[:n].tolist(), table.last[:n].tolist()
        self._kind, self._target = table.kind[:m].tolist(), table.target[:m].tolist()
        self._end = table.end[:m].tolist()
        self._numbers_at = table.numbers_at[:m].tolist()
        self._matrix = table.matrix[:m].tolist()
        self._nodes = [expansion.graph.nodes[k] for k in expansion.leaf_nodes]
        self._counts = programs.leaves[L_ARGS::LEAF_FIELDS].tolist()
        assigned = programs.attributes >= 0
        self._slots = [
            slot for slot, is_set in zip(ATTRIBUTE_SLOTS, assigned, strict=True) if is_set
        ]

    # -- counts ------------------------------------------------------------------------------------

    @cached_property
    def _own(self) -> list[int]:
        """How many shapes every state has itself."""
        return [
            sum(1 for kind, i in self._outermost(s) if kind != STATE and not self._is_empty(i))
            for s in range(len(self._first))
        ]

    @cached_property
    def _below(self) -> list[list[int]]:
        """Items that lead from every state to others."""
        return [
            [i for kind, i in self._outermost(s) if kind == STATE] for s in range(len(self._first))
        ]

    def count(self, depth: int | None) -> int:
        """Return how many shapes stand in the scene, exactly."""
        totals: dict[Key, int] = {}
        for key in self.reachable(depth):
            totals[key] = self.own(key) + sum(totals[child] for child, _ in self.children(key))
        return totals[0, -1 if depth is None else depth]

    def deepest(self, most: int) -> int:
        """Return the largest depth at which no more shapes stand in the scene; 0 for none."""
        here = [1] * len(self._first)
        for depth in range(1, _DEEPEST):
            here = [
                own + sum(here[self._target[i]] for i in below)
                for own, below in zip(self._own, self._below, strict=True)
            ]
            if here[0] > most:
                return depth - 1
        return 0

    # -- the graph of states -----------------------------------------------------------------------

    def reachable(self, depth: int | None) -> list[Key]:
        """Return the states that are there, each behind those that it leads to."""
        if depth is None:
            seen = {0}
            for s in reversed(self._order):
                if s in seen:
                    seen.update(self._target[i] for i in self._below[s])
            return [(s, -1) for s in self._order if s in seen]
        layers: list[list[Key]] = [[(0, depth)]]
        while layers[-1] and layers[-1][0][1] > 0:
            layers.append(
                list(dict.fromkeys(child for key in layers[-1] for child, _ in self.children(key)))
            )
        return [key for layer in reversed(layers) for key in layer]

    def children(self, key: Key) -> list[tuple[Key, Floats]]:
        """Return the states that a state leads to, and where they stand in it."""
        state, depth = key
        if depth == 0:
            return []
        below = depth - 1 if depth > 0 else -1
        return [((self._target[i], below), self._map(i)) for i in self._below[state]]

    def name(self, key: Key) -> str:
        """Return what people call a state."""
        table = self._expansion.table
        if key[0] == 0:
            return "axiom"
        n, rule, _ = self._expansion.link_of(int(table.module[key[0]]), int(table.program[key[0]]))
        node = self._expansion.graph.nodes[n]
        if isinstance(node, Selection) and not node.hidden and node.name.isidentifier():
            return f"{node.name}_{rule}" if rule else node.name
        return "shared"

    # -- what a state is made of -------------------------------------------------------------------

    def own(self, key: Key) -> int:
        """Return how many shapes a state has itself."""
        return 1 if key[1] == 0 else self._own[key[0]]

    def primitives(self, key: Key) -> Iterator[tuple[Primitive, Look]]:
        """Yield the primitives of a state that no operation changes."""
        for kind, i in self._outermost(key[0]):
            if kind == LEAF and not self._is_empty(i):
                yield self._primitive(i, 0), self._look(i)

    def operations(self, key: Key) -> Iterator[tuple[Carved, list[Look]]]:
        """Yield the operations of a state, with the looks that their primitives number.

        Raises
        ------
        UsageError
            One has too many primitives.
        """
        for kind, i in self._outermost(key[0]):
            if kind == OPERATION:
                looks: dict[Look, int] = {}
                found = self._carved(i, np.eye(3, 4), looks, [MOST_OPERANDS])
                if found is not None:
                    yield found, list(looks)

    def proxy(self, key: Key) -> tuple[Leaf, Floats] | None:
        """Return a box in place of a state where nothing may follow; None elsewhere."""
        if key[1] != 0:
            return None
        low, high = self._boxes[key[0]]
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            low, high = np.full(3, -0.5), np.full(3, 0.5)
        half = np.maximum(0.5 * (high - low), 1e-9)
        return Leaf(LEAVES["box"]), np.column_stack([np.diag(half), 0.5 * (low + high)])

    @cached_property
    def _boxes(self) -> list[tuple[Floats, Floats]]:
        """Boxes that contain every state, in its own frame."""
        found = [(np.full(3, math.inf), np.full(3, -math.inf)) for _ in self._first]
        for s in self._order:
            ends = []
            for kind, i in self._leaves_of(s):
                if kind == STATE:
                    low, high = found[self._target[i]]
                else:
                    box = self._node(i).bounds_of(self._args(i))
                    low, high = np.array(box.lower), np.array(box.upper)
                if (low <= high).all() and np.isfinite(low).all() and np.isfinite(high).all():
                    at = self._map(i)
                    middle = at[:, :3] @ (0.5 * (low + high)) + at[:, 3]
                    half = np.abs(at[:, :3]) @ (0.5 * (high - low))
                    ends.append((middle - half, middle + half))
            if ends:
                lows, highs = zip(*ends, strict=True)
                found[s] = np.min(lows, axis=0), np.max(highs, axis=0)
        return found

    # -- items -------------------------------------------------------------------------------------

    def _outermost(self, state: int) -> Iterator[tuple[int, int]]:
        """Yield kinds and numbers of what is united in a state: leaves, states, operations."""
        i = self._first[state]
        while i < self._last[state]:
            kind = self._kind[i]
            if kind != OPERATION:
                yield kind, i
                i += 1
            elif self._target[i] == UNION.kind:
                i += 1
            else:
                yield kind, i
                i = self._end[i]

    def _leaves_of(self, state: int) -> Iterator[tuple[int, int]]:
        """Yield all leaves and states of a state that may be seen: nothing that is subtracted."""
        i = self._first[state]
        while i < self._last[state]:
            kind = self._kind[i]
            if kind != OPERATION:
                yield kind, i
            i += 1

    def _operands(self, i: int, end: int) -> Iterator[int]:
        while i < end:
            yield i
            i = self._end[i] if self._kind[i] == OPERATION else i + 1

    def _carved(
        self, i: int, outer: Floats, looks: dict[Look, int], room: list[int]
    ) -> Carved | None:
        """Return an operation; None where it is empty."""
        kind = self._target[i]
        operands: list[Carved | Primitive] = []
        for number, j in enumerate(self._operands(i + 1, self._end[i])):
            operand = self._solid(j, outer, looks, room)
            if operand is not None:
                operands.append(operand)
            elif kind == INTERSECTION.kind or (kind == DIFFERENCE.kind and number == 0):
                return None
        return Carved(kind, tuple(operands)) if operands else None

    def _solid(
        self, i: int, outer: Floats, looks: dict[Look, int], room: list[int]
    ) -> Carved | Primitive | None:
        if self._kind[i] == OPERATION:
            return self._carved(i, outer, looks, room)
        if self._kind[i] == STATE:
            s = self._target[i]
            here = composed(outer, self._map(i))
            found = [
                self._solid(j, here, looks, room)
                for j in self._operands(self._first[s], self._last[s])
            ]
            inside = tuple(x for x in found if x is not None)
            return Carved(UNION.kind, inside) if inside else None
        if self._is_empty(i):
            return None
        room[0] -= 1
        if room[0] < 0:
            raise UsageError(
                f"an operation has more than {MOST_OPERANDS:,} solids: too many for a mesh; lower"
                " the order"
            )
        made = self._primitive(i, looks.setdefault(self._look(i), len(looks)))
        return made._replace(matrix=composed(outer, made.matrix))

    def _node(self, i: int) -> Leaf:
        node = self._nodes[self._target[i]]
        assert isinstance(node, Leaf)
        return node

    def _is_empty(self, i: int) -> bool:
        return self._kind[i] == LEAF and self._node(i).solid.name == "empty"

    def _args(self, i: int) -> tuple[float, ...]:
        at = self._numbers_at[i]
        numbers = self._expansion.table.numbers
        return tuple(numbers[at : at + self._counts[self._target[i]]].tolist())

    def _primitive(self, i: int, look: int) -> Primitive:
        return Primitive(self._node(i), self._args(i), self._map(i), look)

    def _map(self, i: int) -> Floats:
        m = self._matrix[i]
        numbers = IDENTITY if m < 0 else self._expansion.table.matrices[12 * m : 12 * m + 12]
        return np.array(numbers, np.float64).reshape(3, 4)

    def _look(self, i: int) -> Look:
        at = self._numbers_at[i] + self._counts[self._target[i]]
        numbers = self._expansion.table.numbers[at : at + len(self._slots)].tolist()
        # An attribute that was not assigned on the way here has no value.
        told = {slot: x for slot, x in zip(self._slots, numbers, strict=True) if x == x}
        red, green, blue = (told.get(slot, -1.0) for slot in ("@red", "@green", "@blue"))
        return Look(
            int(told.get("@material", -1)),
            int(told.get("@texture", -1)),
            int(told.get("@label", -1)),
            (red, green, blue) if min(red, green, blue) >= 0.0 else None,
        )
