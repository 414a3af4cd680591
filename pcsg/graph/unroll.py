"""Enumerating the states of a graph: depth first, those that are alike only once."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cached_property
from struct import Struct

from pcsg.errors import Diagnostic, UsageError
from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.code import GraphCode, NodeFault, compose_affine
from pcsg.graph.depth import MOST_SELECTIONS, check_depth
from pcsg.graph.expr import asks_world, parameters_of
from pcsg.graph.faults import BAD_ARGUMENT, TOO_MANY_MODELS, fault_diagnostic
from pcsg.graph.graph import Graph
from pcsg.graph.liveness import Liveness
from pcsg.graph.nodes import Leaf, Operation, Selection, Transformation
from pcsg.graph.operators import UNION
from pcsg.graph.states import (
    Combine,
    Item,
    LeafItem,
    LeafStep,
    OperationStep,
    State,
    StateGraph,
    StateItem,
    StateStep,
    Step,
    UnaryStep,
)
from pcsg.vec import IDENTITY, Affine

BUDGET = 4_000
"""States that are enumerated unless the caller says otherwise."""


STEPS_PER_STATE = 10
"""The budget of node visits, per state of the budget of states."""


MODELS_LIMIT, MODELS_BYTES = 64, 2 << 30
"""Models of leaves with data whose numbers are not constants: most of them, and of their memory."""


DIAGNOSTICS_LIMIT = 20
"""Faults that are reported; each place in the text once."""


def enumerate_states(
    graph: Graph,
    globals_values: Mapping[str, float] | None = None,
    budget: int = BUDGET,
    depth_limit: int = MOST_SELECTIONS,
    without: Collection[int] = (),
) -> StateGraph:
    """Unroll a graph over its states.

    Parameters
    ----------
    globals_values
        Values of SEED, TIME and the like; by default those of `GLOBALS`.
    budget
        Most states; it bounds the visits to nodes too, by STEPS_PER_STATE each.
    depth_limit
        Most selections on a path.
    without
        Nodes that are taken to be empty.

    Returns
    -------
    StateGraph
        With `finite` False where the budget ended first, and with the faults met.
    """
    unroller = _Unroller(graph, globals_values, budget, without)
    # A text that is longer than all visits may be is not begun with.
    if len(graph.nodes) - len(without) > STEPS_PER_STATE * budget:
        unroller.give_up()
        return unroller.found
    unroller.run()
    check_depth(unroller.found, depth_limit)
    return unroller.found


def find_faults(
    graph: Graph, globals_values: Mapping[str, float] | None, chain: Sequence[State]
) -> list[Diagnostic]:
    """Return the faults in the right-hand side of the last state of a chain.

    Parameters
    ----------
    chain
        States from the axiom down, each with its place in the chain as the next one's parent.
    """
    unroller = _Unroller(graph, globals_values, len(chain))
    unroller.found.states = list(chain)
    unroller._expand(len(chain) - 1)
    return unroller.found.diagnostics


class _Unroller:
    """Enumerates states depth first, so that endless recursion shows itself by its depth."""

    def __init__(
        self,
        graph: Graph,
        globals_values: Mapping[str, float] | None,
        budget: int,
        without: Collection[int] = (),
    ) -> None:
        self.graph = graph
        self.without = without
        self.values = globals_values
        self.budget = budget
        self.found = StateGraph(graph, [State(0, 0, 0, (), -1)])
        self.index: dict[tuple[int, int, bytes], int] = {}
        self.pending: list[int] = []
        self.reported: set[object] = set()
        self.models: dict[tuple[object, ...], int] = {}  # bytes

    # What takes time for a long text is made when it is needed.

    @cached_property
    def liveness(self) -> Liveness:
        return Liveness(self.graph)

    @cached_property
    def code(self) -> GraphCode:
        return GraphCode(self.graph, self.liveness)

    @cached_property
    def cuts(self) -> set[int]:
        return cuts(self.graph)

    @cached_property
    def initial(self) -> list[float]:
        return self.code.initial(self.values)

    @cached_property
    def unassigned(self) -> list[float]:
        return [math.nan] * len(self.initial)

    @cached_property
    def attributes(self) -> list[int]:
        return [self.code.slots[name] for name in ATTRIBUTE_SLOTS]

    @cached_property
    def pack(self) -> dict[int, Callable[..., bytes]]:
        return {k: Struct(f"{len(s)}d").pack for k, s in enumerate(self.liveness.slots)}

    @cached_property
    def frame_mask(self) -> int:
        return 1 << self.code.frame_slot if self.code.frame_slot >= 0 else 0

    def run(self) -> None:
        """Expand states until none is left or the budget is spent."""
        states = self.found.states
        visits = 0
        todo = [0]
        while todo:
            k = todo.pop()
            self.pending.clear()
            self._expand(k)
            visits += len(states[k].steps)
            todo.extend(reversed(self.pending))
            if todo and (len(states) > self.budget or visits > STEPS_PER_STATE * self.budget):
                self.give_up()
                return

    def _expand(self, k: int) -> None:
        """Fill in the content of a state."""
        state = self.found.states[k]
        params = self.initial.copy() if k == 0 else self.unassigned.copy()
        for slot, value in zip(self.liveness.slots[state.start], state.values, strict=False):
            params[slot] = value
        content: list[Item] = []
        steps: list[Step] = []
        self._visit(k, params, content, steps)
        state.content, state.steps = tuple(content), tuple(steps)

    def _visit(
        self,
        k: int,
        params: list[float],
        content: list[Item],
        steps: list[Step],
    ) -> None:
        """Walk a right-hand side; what a branch assigns stays in the branch."""
        graph, code = self.graph, self.code
        start = self.found.states[k].start
        # A large shared expression begins a state where it is met, but not its own.
        opened = start if k > 0 and start == self.found.states[k].node else -1
        stack: list[tuple[int, list[float], Affine] | Step] = [(start, params, IDENTITY)]
        while stack:
            entry = stack.pop()
            if isinstance(entry, (UnaryStep, OperationStep)):
                steps.append(entry)
                if isinstance(entry, OperationStep):
                    content.append(Combine(entry.operator, entry.arity))
                continue
            n, params, matrix = entry  # type: ignore[misc]
            if n in self.without:
                steps.append(OperationStep(n, UNION, 0))
                content.append(Combine(UNION, 0))
                continue
            node = graph.nodes[n]
            is_cut = n in self.cuts and n != opened
            opened = -1
            try:
                if is_cut:
                    child = self._intern(n, params, k)
                    steps.append(StateStep(n, child))
                    content.append(StateItem(matrix, child))
                elif isinstance(node, Leaf):
                    args = code.leaf_arguments(n, params)
                    if node.constants:
                        self._count_model(n, node, args)
                    attributes = tuple(params[a] for a in self.attributes)
                    steps.append(LeafStep(n, args))
                    content.append(LeafItem(matrix, n, args, attributes))
                elif isinstance(node, Operation):
                    below = graph.successors[n]
                    stack.append(OperationStep(n, node.operator, len(below)))
                    stack.extend((s, params, matrix) for s in reversed(below))
                elif isinstance(node, Transformation):
                    (s,) = graph.successors[n]
                    m = code.matrix(n, params)
                    if self.liveness.masks[s] & self.frame_mask:
                        params = code.frame_below(params, m)
                    stack.append(UnaryStep(n, m))
                    stack.append((s, params, compose_affine(matrix, m)))
                else:
                    (s,) = graph.successors[n]
                    stack.append(UnaryStep(n, None))
                    stack.append((s, code.assign(n, params), matrix))
            except NodeFault as fault:
                self._report(fault, k, params if fault.params is None else fault.params)
                steps.append(OperationStep(n, UNION, 0))
                content.append(Combine(UNION, 0))

    def _intern(self, n: int, params: list[float], parent: int) -> int:
        """Return the number of a state, a new one if it was not met before."""
        node = self.graph.nodes[n]
        rule, start = 0, n
        if isinstance(node, Selection):
            rule = self.code.select(n, params)
            start = self.graph.number[node.rules[rule]]
        values = tuple([params[slot] for slot in self.liveness.slots[start]])
        key = n, rule, self.pack[start](*values)
        k = self.index.get(key)
        if k is None:
            k = self.index[key] = len(self.found.states)
            self.found.states.append(State(n, rule, start, values, parent))
            self.pending.append(k)
        return k

    def _count_model(self, n: int, node: Leaf, args: tuple[float, ...]) -> None:
        """Make the model of a leaf with data, and count those whose numbers differ by place."""
        try:
            model = node.model(args)
        except UsageError as error:
            raise NodeFault(BAD_ARGUMENT, n, None, str(error)) from None
        key = node.solid, node.constants, args
        if key in self.models or not _varies(node):
            return
        self.models[key] = model.data.nbytes
        if len(self.models) > MODELS_LIMIT:
            detail = f"its parameters take more than {MODELS_LIMIT} different values"
            raise NodeFault(TOO_MANY_MODELS, n, None, detail)
        if sum(self.models.values()) > MODELS_BYTES:
            detail = f"{len(self.models)} of them need more than {MODELS_BYTES >> 30} GB"
            raise NodeFault(TOO_MANY_MODELS, n, None, detail)

    def give_up(self) -> None:
        """Leave the rest, and tell which models the states that were not enumerated may need."""
        self.found.finite = False
        for n, node in enumerate(self.graph.nodes):
            if isinstance(node, Leaf) and node.constants and _varies(node):
                detail = "its parameters take more values than can be enumerated"
                fault = NodeFault(TOO_MANY_MODELS, n, None, detail)
                self.found.unknown_models.append(self._diagnose(fault, 0, self.initial))

    def _report(self, fault: NodeFault, k: int, params: list[float]) -> None:
        # One report for each place in the text, however many states meet it.
        place = (fault.kind, fault.node, fault.span)
        if place in self.reported or len(self.found.diagnostics) >= DIAGNOSTICS_LIMIT:
            return
        self.reported.add(place)
        self.found.diagnostics.append(self._diagnose(fault, k, params))

    def _diagnose(self, fault: NodeFault, k: int, params: list[float]) -> Diagnostic:
        """Return the diagnostic of a fault in a state."""
        values = {name: params[self.code.slots[name]] for name in self.graph.parameters}
        return fault_diagnostic(
            fault.kind,
            self.graph,
            fault.node,
            fault.span,
            self.found.path(k),
            values,
            fault.detail,
        )


class StatesOnDemand:
    """States of a graph that are made one by one, as somebody comes to them.

    Attributes
    ----------
    states
        Those that are known; the axiom is the first.
    """

    def __init__(self, graph: Graph, globals_values: Mapping[str, float]) -> None:
        self._unroller = _Unroller(graph, globals_values, BUDGET)
        self.states = self._unroller.found.states

    def content(self, k: int) -> tuple[Item, ...]:
        """Return what a state consists of."""
        state = self.states[k]
        if state.content is None:
            self._unroller._expand(k)
        assert state.content is not None
        return state.content

    def values(self, k: int) -> dict[str, float]:
        """Return the values of the grammar's parameters that are live in a state."""
        state, names = self.states[k], list(self._unroller.code.slots)
        slots = self._unroller.liveness.slots[state.start]
        pairs = zip((names[slot] for slot in slots), state.values, strict=False)
        return {name: x for name, x in pairs if not name.startswith("@") and x == x}


def _varies(node: Leaf) -> bool:
    """Return whether the numbers of a leaf depend on the place."""
    return asks_world(*node.args) or bool(parameters_of(*node.args))


_SHARED_SIZE = 250


def cuts(graph: Graph) -> set[int]:
    """Return the nodes where states begin: modules, and large expressions that are shared.

    Definitions of definitions could otherwise grow exponentially within one state.
    """
    found = {k for k, node in enumerate(graph.nodes) if isinstance(node, Selection)}
    uses = [0] * len(graph.nodes)
    for below in graph.successors:
        for s in below:
            uses[s] += 1
    size = [1] * len(graph.nodes)
    for k in graph.successors_first:
        if k in found:
            continue
        size[k] = 1 + sum(size[s] for s in graph.successors[k])
        if uses[k] > 1 and size[k] > _SHARED_SIZE:
            found.add(k)
            size[k] = 1
    return found
