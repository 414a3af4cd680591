"""States as groups of references: unions of leaves, instances and operations.

A *group* is a union of references in one frame. A state whose right-hand side is a union becomes
one group; operands of intersections and differences become groups of their own. Groups of equal
content are one (hash-consing), so that the result is the smallest acyclic graph of its kind.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from pcsg.geometry import bvh
from pcsg.graph.code import compose_affine
from pcsg.graph.hulls import Hulls, Part
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import UNION, Operator
from pcsg.graph.states import Combine, LeafItem, LeafStep, OperationStep, StateGraph, StateItem
from pcsg.simd import WIDTH
from pcsg.vec import IDENTITY, Affine

BLOCK, INSTANCE, SUSPENDED, LEAF, OPERATION, SMALL = range(6)
EMPTY = bvh.EMPTY
"""Kinds of references. SMALL is an operation as a truth table, BLOCK leads to further references,
SUSPENDED is an instance of a state that is expanded when a ray comes by (`expand.cache`);
groups themselves have neither."""

assert BLOCK == bvh.BLOCK


class Reference(NamedTuple):
    """A member of a group.

    Attributes
    ----------
    kind, target
        LEAF: number of a leaf record. INSTANCE: number of a group. OPERATION: of an operation.
    group_from_target
        The matrix to the group's frame.
    hull
        Its solid in the group's frame, for boxes.
    """

    kind: int
    target: int
    group_from_target: Affine
    hull: Part


class LeafRecord(NamedTuple):
    """A leaf with everything that does not depend on the place.

    Attributes
    ----------
    has_data
        Whether it is a leaf with data, which a ray may cross any number of times.
    """

    node: int
    args: tuple[float, ...]
    attributes: tuple[float, ...]
    has_data: bool = False


class OperationRecord(NamedTuple):
    """An intersection or a difference of groups in the frame of the reference to it."""

    operator: Operator
    operands: tuple[int, ...]


@dataclass
class Groups:
    """All groups of a graph.

    Attributes
    ----------
    groups
        References in the order of the text.
    operations, leaves
        What references point at.
    root
        The group of the axiom, -1 if it is empty.
    """

    groups: list[tuple[Reference, ...]] = field(default_factory=list)
    operations: list[OperationRecord] = field(default_factory=list)
    leaves: list[LeafRecord] = field(default_factory=list)
    root: int = -1


def gather(states: StateGraph, hulls: Hulls) -> Groups:
    """Return the groups of a finite acyclic state graph."""
    return _Gatherer(states, hulls).gather()


class _Gatherer:
    def __init__(self, states: StateGraph, hulls: Hulls) -> None:
        self.states = states
        self.hulls = hulls
        self.found = Groups()
        self.known: dict[object, int] = {}
        self.of_state: dict[int, tuple[Reference, ...]] = {}

    def gather(self) -> Groups:
        for k in self.states.children_first:
            self.of_state[k] = self._expand(k)
        if self.of_state[0]:
            self.found.root = self._group(self.of_state[0])
        return self.found

    def _expand(self, k: int) -> tuple[Reference, ...]:
        """Return a state as a union of references."""
        stack: list[tuple[Reference, ...]] = []
        for item in self.states.states[k].content or ():
            if isinstance(item, LeafItem):
                stack.append(self._leaf(item))
            elif isinstance(item, StateItem):
                stack.append(self._instance(item))
            else:
                at = len(stack) - item.arity
                operands = stack[at:]
                del stack[at:]
                stack.append(self._combine(item, operands))
        return stack[-1] if stack else ()

    def _leaf(self, item: LeafItem) -> tuple[Reference, ...]:
        part = self.hulls.leaf_part(LeafStep(item.node, item.args))
        node = self.states.graph.nodes[item.node]
        assert isinstance(node, Leaf)
        if part is None or node.solid.primitives == 0:
            return ()
        record = LeafRecord(item.node, item.args, item.attributes, bool(node.constants))
        key = ("leaf", record)
        if key not in self.known:
            self.known[key] = len(self.found.leaves)
            self.found.leaves.append(record)
        m = item.state_from_leaf
        hull = Part(compose_affine(m, part.outer_from_inner), part.hull)
        return (Reference(LEAF, self.known[key], m, hull),)

    def _instance(self, item: StateItem) -> tuple[Reference, ...]:
        inner = self.of_state[item.state]
        m = item.state_from_child
        if len(inner) <= 1:
            return tuple(_moved(m, r) for r in inner)
        part = self.hulls.parts[item.state]
        if part is None:
            return ()
        hull = Part(compose_affine(m, part.outer_from_inner), part.hull)
        return (Reference(INSTANCE, self._group(inner), m, hull),)

    def _combine(
        self, item: Combine, operands: list[tuple[Reference, ...]]
    ) -> tuple[Reference, ...]:
        if item.operator is UNION:
            return _without_copies([r for operand in operands for r in operand])
        first, rest = operands[0], operands[1:]
        if item.operator.table & 0b0100:  # a difference: what is empty takes nothing away
            rest = [r for r in rest if r]
            if not first or not rest:
                return first
            if len(rest) > WIDTH:
                # A long chain is one hierarchy; of a few it is faster to ask one by one.
                rest = [tuple(r for operand in rest for r in operand)]
        elif not all(operands):
            return ()
        parts = [self._union_part(refs) for refs in (first, *rest)]
        step = OperationStep(0, item.operator, len(parts))
        hull = self.hulls.combine(step, parts)
        if hull is None:
            return ()
        groups = tuple(self._group(refs) for refs in (first, *rest))
        record = OperationRecord(item.operator, groups)
        key = ("operation", item.operator.kind, groups)
        if key not in self.known:
            self.known[key] = len(self.found.operations)
            self.found.operations.append(record)
        return (Reference(OPERATION, self.known[key], IDENTITY, hull),)

    def _union_part(self, refs: tuple[Reference, ...]) -> Part | None:
        parts: list[Part | None] = [r.hull for r in refs]
        return self.hulls.combine(OperationStep(0, UNION, len(parts)), parts)

    def _group(self, refs: tuple[Reference, ...]) -> int:
        """Return the number of a group; equal content is one group."""
        key = ("group", tuple((r.kind, r.target, r.group_from_target) for r in refs))
        if key not in self.known:
            self.known[key] = len(self.found.groups)
            self.found.groups.append(refs)
        return self.known[key]


def _without_copies(refs: list[Reference]) -> tuple[Reference, ...]:
    """Return a union without what stands in the same place once more: it adds nothing.

    A loop whose body does not look at its parameter is a single copy then, and not a billion that
    every ray enters.
    """
    return tuple({(r.kind, r.target, r.group_from_target): r for r in refs}.values())


def _moved(m: Affine, r: Reference) -> Reference:
    hull = Part(compose_affine(m, r.hull.outer_from_inner), r.hull.hull)
    return Reference(r.kind, r.target, compose_affine(m, r.group_from_target), hull)
