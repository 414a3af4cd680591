"""States of a graph: what a module looks like for given values of its live parameters.

A *state* is a module together with the rule that it takes and the values of the parameters that are
live in that rule. Unrolling the cyclic graph over states gives a graph without cycles and with
constant matrices, as small as the derivation is regular: Sierpinski's tetrahedron of order n has
n + 1 states, fig 5a's tree 22.

The right-hand side of a state is kept twice: as `State.content`, its items with their matrices,
and as `State.steps`, one for every node visited on the way, which the hyper-bounding boxes need.
Both are in postfix order, flat, so that nesting costs no recursion and equal contents compare
equal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from pcsg.errors import Diagnostic
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Selection
from pcsg.graph.operators import Operator
from pcsg.graph.ordering import successors_first
from pcsg.vec import Affine


class LeafItem(NamedTuple):
    """A primitive in the frame of a state; `attributes` in the order of ATTRIBUTE_SLOTS."""

    state_from_leaf: Affine
    node: int
    args: tuple[float, ...]
    attributes: tuple[float, ...]


class StateItem(NamedTuple):
    """Another state in the frame of a state."""

    state_from_child: Affine
    state: int


class Combine(NamedTuple):
    """The operator applied to the `arity` solids before it; a union of none is empty."""

    operator: Operator
    arity: int


Item = LeafItem | StateItem | Combine


class LeafStep(NamedTuple):
    """A visit to a leaf."""

    node: int
    args: tuple[float, ...]


class StateStep(NamedTuple):
    """A visit to a module, where another state begins."""

    node: int
    state: int


class UnaryStep(NamedTuple):
    """A visit to a transformation (with its matrix), a calculation or an attribute."""

    node: int
    outer_from_inner: Affine | None


class OperationStep(NamedTuple):
    """A visit to an operator with `arity` operands."""

    node: int
    operator: Operator
    arity: int


Step = LeafStep | StateStep | UnaryStep | OperationStep


@dataclass(slots=True)
class State:
    """A module, the rule that it takes, and the values of the parameters that are live there.

    Attributes
    ----------
    node
        Number of the selection node; the root for the axiom, which is state 0. A large expression
        that is shared in the text begins a state too, so that no state is larger than its text.
    rule, start
        Number of the rule taken, 0 where there is no choice to take, and the node it begins with.
    values
        Of the slots that are live at `start`, in the order of `Liveness.slots`.
    parent
        The state that found it first, -1 for the axiom.
    content
        Its expanded right-hand side, postfix; None where the budget ended before it.
    steps
        The nodes visited on the way, postfix.
    """

    node: int
    rule: int
    start: int
    values: tuple[float, ...]
    parent: int
    content: tuple[Item, ...] | None = None
    steps: tuple[Step, ...] = ()


@dataclass
class StateGraph:
    """The states that the axiom reaches.

    Attributes
    ----------
    graph
        The graph that was unrolled.
    states
        All of them, the axiom first.
    finite
        Whether the budget sufficed.
    acyclic
        Whether no state contains itself; one that does never ends.
    diagnostics
        Faults found on the way.
    unknown_models
        Where the budget ended first: leaves with data whose models other states may need.
    """

    graph: Graph
    states: list[State]
    finite: bool = True
    acyclic: bool = True
    diagnostics: list[Diagnostic] = field(default_factory=list)
    unknown_models: list[Diagnostic] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of states without the axiom."""
        return len(self.states) - 1

    @cached_property
    def successors(self) -> tuple[tuple[int, ...], ...]:
        """States that every state contains, each once."""
        return tuple(
            tuple(dict.fromkeys(s.state for s in state.steps if isinstance(s, StateStep)))
            for state in self.states
        )

    @cached_property
    def children_first(self) -> list[int]:
        """Numbers of the states, each after those it contains where there is no cycle."""
        return successors_first(self.successors)

    def path(self, index: int) -> list[tuple[str, int]]:
        """Return modules and rules from the axiom to a state."""
        return [self._link(k) for k in self._chain(index) if self._is_selection(k)]

    def _chain(self, index: int) -> list[int]:
        chain = []
        while index > 0:
            chain.append(index)
            index = self.states[index].parent
        return chain[::-1]

    def _link(self, index: int) -> tuple[str, int]:
        state = self.states[index]
        node = self.graph.nodes[state.node]
        assert isinstance(node, Selection)
        return node.name, state.rule

    def _is_selection(self, index: int) -> bool:
        return index > 0 and isinstance(self.graph.nodes[self.states[index].node], Selection)
