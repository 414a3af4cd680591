"""Liveness: which parameters can still matter below a node.

A parameter is *live* at a node if its value there can influence a selection, a transformation, an
attribute or an argument of a leaf below. What is not live need not be part of a state, so that
states that differ in it only are one. Backward data flow over the cyclic graph, with sets as the
bits of integers (Aho, Lam, Sethi, Ullman 2006, "Compilers", section 9.2.5).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from pcsg.graph.expr import Apply, Expr, Number, Parameter, as_expr, operands, postorder
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.graph import FRAME_SLOTS, Graph, expressions
from pcsg.graph.nodes import Attribute, Calculation, Leaf, Selection, Transformation


def reads(*exprs: Expr) -> set[str]:
    """Return the names of all slots that expressions read, the frame's with world queries."""
    names: set[str] = set()
    for expr in exprs:
        if isinstance(expr, Number):
            continue
        for e in postorder(expr, operands):
            if isinstance(e, Parameter):
                names.add(e.name)
            elif isinstance(e, Apply) and FUNCTIONS[e.function].form is Form.WORLD:
                names.update(FRAME_SLOTS)
    return names


def attribute_stores(node: Attribute) -> tuple[str, ...]:
    """Return the slots that an attribute assigns: the named thing first, then what is written."""
    return node.kind.slots[: len(node.args) + (node.kind.refers_to is not None)]


def attribute_values(graph: Graph, node: Attribute) -> list[Expr]:
    """Return what an attribute assigns to its slots."""
    exprs = list(node.args)
    if node.kind.refers_to:
        number = graph.numbers_of(node.kind.refers_to).get(node.reference or "", -1)
        exprs.insert(0, as_expr(float(number)))
    return exprs


class Liveness:
    """Live parameters of every node of a graph.

    Parameters
    ----------
    graph
        The graph.
    selections_only
        Ask for the parameters that can influence selections only, through assignments too. Their
        values decide the shape of the derivation, hence the number of primitives.
    """

    def __init__(self, graph: Graph, selections_only: bool = False) -> None:
        self.graph = graph
        self.selections_only = selections_only
        self._bit = {name: 1 << k for name, k in graph.slots.items()}
        self._frame = self._mask(FRAME_SLOTS) if graph.uses_frame else 0
        self._reads: dict[int, int] = {}
        self._stored_by: dict[tuple[str, int], int] = {}

    @cached_property
    def live(self) -> tuple[frozenset[str], ...]:
        """Names of the live slots of every node, by its number; hidden ones begin with ``@``."""
        names = tuple(self.graph.slots)
        sets: dict[int, frozenset[str]] = {}
        for mask in self.masks:
            if mask not in sets:
                sets[mask] = frozenset(n for k, n in enumerate(names) if mask >> k & 1)
        return tuple(sets[mask] for mask in self.masks)

    @cached_property
    def slots(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the live slots of every node, ascending."""
        tuples: dict[int, tuple[int, ...]] = {}
        for mask in self.masks:
            if mask not in tuples:
                tuples[mask] = tuple(k for k in range(mask.bit_length()) if mask >> k & 1)
        return tuple(tuples[mask] for mask in self.masks)

    @cached_property
    def masks(self) -> tuple[int, ...]:
        """Live slots of every node as bits."""
        nodes, below = self.graph.nodes, self.graph.successors
        assigned = self._mask(
            slot for node in nodes if isinstance(node, Attribute) for slot in attribute_stores(node)
        )
        own = [self._own_reads(k, assigned) for k in range(len(nodes))]
        masks = [0] * len(nodes)
        order = self.graph.successors_first
        done = bytearray(len(nodes))
        changed, cyclic = True, False
        while changed:
            changed = False
            for k in order:
                mask = 0
                for s in below[k]:
                    mask |= masks[s]
                    cyclic = cyclic or not done[s]
                done[k] = 1
                mask = self._above(k, mask) | own[k]
                if mask != masks[k]:
                    masks[k] = mask
                    changed = True
            changed = changed and cyclic
        return tuple(masks)

    def reaches(self, k: int, node: Attribute) -> bool:
        """Return whether something below an attribute reads what it assigns."""
        return self.masks[self.graph.successors[k][0]] & self._stored(node) != 0

    def _stored(self, node: Attribute) -> int:
        """Return the slots that an attribute assigns, as bits."""
        key = node.kind.name, len(node.args)
        mask = self._stored_by.get(key)
        if mask is None:
            mask = self._stored_by[key] = self._mask(attribute_stores(node))
        return mask

    def _mask(self, names: Iterable[str]) -> int:
        mask = 0
        for name in names:
            # A parameter that nobody assigns is refused by the front end; here it has no slot.
            mask |= self._bit.get(name, 0)
        return mask

    def _expr_reads(self, expr: Expr) -> int:
        if isinstance(expr, Number):
            return 0
        key = id(expr)  # the graph keeps its expressions alive
        if key not in self._reads:
            self._reads[key] = self._mask(reads(expr))
        return self._reads[key]

    def _own_reads(self, k: int, assigned: int) -> int:
        """Return what a node reads whatever is live below it."""
        node = self.graph.nodes[k]
        mask = 0
        if isinstance(node, Leaf) and not self.selections_only:
            mask |= assigned
        if k not in self.graph.formulas:
            return mask
        if isinstance(node, Selection) or (
            isinstance(node, (Transformation, Leaf)) and not self.selections_only
        ):
            for expr in expressions(node):
                mask |= self._expr_reads(expr)
        return mask

    def _above(self, k: int, mask: int) -> int:
        """Return what is live above a node, given what is live below it."""
        if mask == 0:
            return 0
        node = self.graph.nodes[k]
        if isinstance(node, Calculation):
            return self._above_calculation(node, mask)[0]
        if isinstance(node, Attribute):
            stored = self._stored(node)
            if mask & stored:
                mask &= ~stored
                for expr in node.args:
                    mask |= self._expr_reads(expr)
            return mask
        if isinstance(node, Transformation) and mask & self._frame:
            for expr in node.args:
                mask |= self._expr_reads(expr)
        return mask

    def _above_calculation(self, node: Calculation, mask: int) -> tuple[int, list[int]]:
        """Return what is live above, and which assignments matter, the last one first."""
        used: list[int] = []
        read = 0
        for i in reversed(range(len(node.assignments))):
            name, expr = node.assignments[i]
            if mask & self._bit[name]:
                used.append(i)
                mask &= ~self._bit[name]
                if node.call:
                    read |= self._expr_reads(expr)
                else:
                    mask |= self._expr_reads(expr)
        return mask | read, used

    def used_assignments(self, k: int) -> list[int]:
        """Return the positions of the assignments of calculation k whose values are live."""
        node = self.graph.nodes[k]
        assert isinstance(node, Calculation)
        below = self.masks[self.graph.successors[k][0]]
        return self._above_calculation(node, below)[1][::-1]
