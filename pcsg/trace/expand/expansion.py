"""Expanding a graph: its table of states, as far as memory allows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import Diagnostic, UsageError
from pcsg.graph.depth import MOST_SELECTIONS, depth_fault
from pcsg.graph.expr import Number
from pcsg.graph.faults import TOO_MANY_MODELS, fault_diagnostic, spell_path
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf, Selection
from pcsg.graph.states import State, StateGraph
from pcsg.graph.unroll import MODELS_BYTES, MODELS_LIMIT, find_faults
from pcsg.trace.expand.clusters import order_states
from pcsg.trace.expand.depth import (
    chain_above,
    chain_below,
    deepest_above,
    deepest_below,
    shrinks,
)
from pcsg.trace.expand.programs import L_ARGS, LEAF_FIELDS, Programs, ProgramWriter
from pcsg.trace.expand.table import (
    COUNTERS,
    DONE,
    F_STATE,
    FAULT,
    FULL,
    LEAF,
    N_ITEMS,
    N_MATRICES,
    N_NUMBERS,
    N_STATES,
    N_VALUES,
    N_WAITING,
    STATE,
    Table,
    Work,
    fill_table,
    rehash,
)
from pcsg.trace.pool import ModelPool
from pcsg.trace.preparing import UNLIMITED, Preparation

SLICE = 20_000
"""States that are made before control returns to Python, where Ctrl-C is seen."""

LEAF_BYTES = 256
"""Bytes of a leaf that stands in one place only, about."""

_EARLY = 100_000
"""States after which the expansion looks ahead."""

_PER_STATE = ("program", "module", "parent", "first", "last", "values_at", "waiting")
_PER_ITEM = ("kind", "target", "matrix", "numbers_at", "end")


class TooLarge(Exception):
    """The expansion needs more memory than it may take."""


class Expansion:
    """The states of a graph, all of them.

    Parameters
    ----------
    graph
        The graph.
    values
        Values of the global parameters.
    models
        Receives the models of leaves with data.
    max_bytes
        Of the table of states.
    leaves
        Returns how many leaves the whole derivation has, None where that is not known. Where
        hardly any states are alike, it tells early that there will be too many.
    without
        Nodes that are taken to be empty.
    preparation
        Is told how far it is, and asked for memory.

    Attributes
    ----------
    programs, table
        The rule programs, and the states that they lead to.
    order : int32 (N,)
        The states, each after those that it contains; None where one contains itself.
    diagnostics
        A fault that was met; the table is not complete then.
    model_values
        By node, the values that the numbers of leaves with data take.

    Raises
    ------
    TooLarge
        The table needs more memory.
    EnvironmentFault
        There is no more memory.
    """

    def __init__(
        self,
        graph: Graph,
        values: Mapping[str, float],
        models: ModelPool,
        max_bytes: int,
        leaves: Callable[[], int | None] = lambda: None,
        without: Collection[int] = frozenset(),
        preparation: Preparation = UNLIMITED,
    ) -> None:
        self.graph = graph
        self.values = values
        self.diagnostics: list[Diagnostic] = []
        self.model_values: dict[int, list[tuple[float, ...]]] = {}
        self.order: NDArray[np.int32] | None = None
        self._writer = ProgramWriter(graph, models, without)
        self.programs = self._writer.write()
        self.table = make_table(self.programs, 1_024 + 2 * self.programs.n_items)
        self.table.counters[N_STATES] = self.table.counters[N_WAITING] = 1
        self._leaves = leaves
        self._preparation = preparation
        if self._fill(max_bytes) and self._make_models():
            n = self.n_states
            order, seen = np.zeros(n, np.int32), np.zeros(n, np.int32)
            found = order_states(self.table, order, seen, np.zeros(2 * n + 2, np.int32))
            self.order = order[: np.count_nonzero(seen)] if found < 0 else None
            if n > MOST_SELECTIONS and self.order is not None:
                self._check_depth(self.order)

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """Bounds of the states, where some are suspended."""
        return None

    @property
    def n_states(self) -> int:
        """Number of states, with the axiom."""
        return int(self.table.counters[N_STATES])

    @property
    def n_items(self) -> int:
        """Number of items of all states."""
        return int(self.table.counters[N_ITEMS])

    @property
    def leaf_nodes(self) -> list[int]:
        """The node of every leaf that items may name."""
        return self._writer.leaf_nodes

    def link_of(self, module: int, program: int) -> tuple[int, int, int]:
        """Return the node of a module, the rule that leads to a program, and its first node."""
        return self._writer.link_of(module, program)

    def take_items(self) -> Table:
        """Return the table, whose states can no longer be told apart: their values are given up."""
        nothing = np.zeros(1, np.int32)
        self.table = self.table._replace(
            program=nothing,
            module=nothing,
            parent=nothing,
            values_at=nothing,
            values=np.zeros(1),
            slots=nothing,
            waiting=nothing,
        )
        return self.table

    def drop_items(self) -> None:
        """Give up the table, which nobody reads any more."""
        self.table = Table._make(array[:0] for array in self.table)

    def make_work(self) -> Work:
        """Return working space of the interpreter."""
        programs = self.programs
        return Work(
            params=np.concatenate([np.zeros(programs.n_registers), programs.literals]),
            initial=np.array(self._writer.code.initial(self.values)),
            matrices=np.zeros(12 * (programs.n_matrices + 1)),
            stack=np.zeros(programs.n_stack),
            open=np.zeros(programs.n_operations + 1, np.int32),
        )

    def _fill(self, max_bytes: int) -> bool:
        """Make all states; return False where a fault was met."""
        programs = self.programs
        work = self.make_work()
        looked = False
        expected: float | None = None
        while True:
            self._preparation.tell(None if expected is None else self.n_states / expected)
            status = fill_table(
                programs, self.table, self.table.values.view(np.uint64), work, SLICE
            )
            if status == DONE:
                return True
            if status == FAULT:
                self._report(int(self.table.counters[F_STATE]))
                return False
            if status == FULL:
                if self.n_states > MOST_SELECTIONS and self._is_too_deep():
                    return False
                used = used_bytes(self.table)
                if used > max_bytes:
                    raise TooLarge
                # For a moment what grows is there twice.
                self._preparation.require(2 * used)
                self.table = grow_table(programs, self.table)
            elif not looked and self.n_states > _EARLY:
                looked = True
                expected = self._look_ahead(max_bytes)

    def _is_too_deep(self) -> bool:
        """Report a path with too many selections among those that found states."""
        depth = np.zeros(self.n_states, np.int32)
        deepest = deepest_above(self.table, self._selects, depth)
        if depth[deepest] <= MOST_SELECTIONS:
            return False
        return self._report_depth(chain_above(self.table, deepest))

    def _check_depth(self, order: NDArray[np.int32]) -> None:
        """Report a path with too many selections."""
        depth, below = np.zeros((2, self.n_states), np.int32)
        deepest_below(self.table, order, self._selects, depth, below)
        if depth[0] > MOST_SELECTIONS:
            self._report_depth(chain_below(below))

    @property
    def _selects(self) -> NDArray[np.bool_]:
        """Which modules are selections."""
        nodes = (self.graph.nodes[n] for n in self._writer.module_nodes)
        return np.array([isinstance(node, Selection) for node in nodes])

    def _report_depth(self, chain: NDArray[np.int32]) -> bool:
        """Report a chain of states that is too deep, unless its frame shrinks to nothing."""
        table = self.table
        steps = np.flatnonzero(self._selects[table.module[chain[1:]]])[: MOST_SELECTIONS + 1]
        chain = chain[: int(steps[-1]) + 2]
        if shrinks(table, chain):
            return False
        inner = chain[1:][self._selects[table.module[chain[1:]]]]
        steps = table.module[inner].astype(np.int64) << 32 | table.program[inner]
        path = spell_path(steps, lambda step: self._name_of(step >> 32, step & 0xFFFFFFFF))
        last = int(chain[-1])
        n, _, start = self.link_of(int(table.module[last]), int(table.program[last]))
        names = tuple(self.graph.slots)
        live = self._writer.liveness.slots[start]
        numbers = table.values[table.values_at[last] : table.values_at[last + 1]].tolist()
        values = {names[slot]: x for slot, x in zip(live, numbers, strict=True)}
        self.diagnostics.append(depth_fault(self.graph, n, path, values, MOST_SELECTIONS))
        return True

    def _name_of(self, module: int, program: int) -> tuple[str, int]:
        n, rule, _ = self.link_of(module, program)
        node = self.graph.nodes[n]
        assert isinstance(node, Selection)
        return node.name, rule

    def _look_ahead(self, max_bytes: int) -> float | None:
        """Return how many states are expected, None where nobody knows.

        Raises
        ------
        TooLarge
            No states are alike, and the derivation has too many leaves.
        """
        kinds = self.table.kind[: self.n_items]
        if np.count_nonzero(kinds == STATE) >= 1.05 * self.n_states:
            return None
        leaves = self._leaves()
        if leaves is None:
            return None
        if leaves * LEAF_BYTES > max_bytes:
            raise TooLarge
        per_leaf = self.n_states / max(1, int(np.count_nonzero(kinds == LEAF)))
        return leaves * per_leaf

    def _make_models(self) -> bool:
        """Make the models that depend on the place, each a leaf of its own; False for a fault."""
        table = self.table
        items = self.n_items
        made: Counter[int] = Counter()
        total = 0
        for leaf in self._writer.varying:
            count = int(self.programs.leaves[LEAF_FIELDS * leaf + L_ARGS])
            here = np.flatnonzero((table.kind[:items] == LEAF) & (table.target[:items] == leaf))
            rows = table.numbers[table.numbers_at[here][:, None] + np.arange(count)]
            known: dict[tuple[float, ...], int] = {}
            for item, row in zip(here.tolist(), rows.tolist(), strict=True):
                args = tuple(row)
                if args not in known:
                    made[leaf] += 1
                    try:
                        known[args] = self._writer.add_model(leaf, args)
                    except UsageError:
                        self._report(self._state_of(item))
                        return False
                    node = self.graph.nodes[self._writer.leaf_nodes[leaf]]
                    total += node.model(args).data.nbytes  # type: ignore[attr-defined]
                    if sum(made.values()) > MODELS_LIMIT or total > MODELS_BYTES:
                        self._refuse_models(item, leaf)
                        return False
                table.target[item] = known[args]
            self.model_values.setdefault(self._writer.leaf_nodes[leaf], []).extend(known)
        for n in self._writer.leaf_nodes:
            node = self.graph.nodes[n]
            if isinstance(node, Leaf) and node.constants and n not in self.model_values:
                args = tuple(arg.value for arg in node.args if isinstance(arg, Number))
                self.model_values[n] = [args]
        if made:
            self.programs = self._writer.with_leaves(self.programs)
        return True

    def _refuse_models(self, item: int, leaf: int) -> None:
        """Report that there are too many models."""
        chain = self._chain(self._state_of(item))
        node = self._writer.leaf_nodes[leaf]
        detail = f"its parameters take more than {MODELS_LIMIT} different values"
        path = StateGraph(self.graph, chain).path(len(chain) - 1)
        self.diagnostics.append(
            fault_diagnostic(TOO_MANY_MODELS, self.graph, node, None, path, {}, detail)
        )

    def _state_of(self, item: int) -> int:
        """Return the state that an item belongs to."""
        n = self.n_states
        first, last = self.table.first[:n], self.table.last[:n]
        return int(np.flatnonzero((first <= item) & (item < last))[0])

    def _report(self, state: int) -> None:
        """Have the reference tell what is wrong with a state."""
        self.diagnostics += find_faults(self.graph, self.values, self._chain(state))

    def _chain(self, state: int) -> list[State]:
        """Return the states that lead to a state, from the axiom down."""
        table = self.table
        numbers = [state]
        while numbers[-1] > 0:
            numbers.append(int(table.parent[numbers[-1]]))
        chain = [State(0, 0, 0, (), -1)]
        for k, s in enumerate(numbers[-2::-1]):
            node, rule, start = self._writer.link_of(int(table.module[s]), int(table.program[s]))
            values = table.values[table.values_at[s] : table.values_at[s + 1]]
            chain.append(State(node, rule, start, tuple(values.tolist()), k))
        return chain


def make_table(programs: Programs, n: int) -> Table:
    """Return a table with room for n states and twice as many items."""
    m = 2 * n
    sizes = dict.fromkeys(_PER_STATE, n) | dict.fromkeys(_PER_ITEM, m)
    arrays: dict[str, Any] = {name: np.zeros(size, np.int32) for name, size in sizes.items()}
    table = Table(
        **arrays,
        values=np.zeros(2 * (programs.n_items + 1) * programs.n_slots + 8 * n),
        slots=np.full(1 << (4 * n).bit_length(), -1, np.int32),
        matrices=np.concatenate([programs.maps, np.zeros(12 * m)]),
        numbers=np.zeros(programs.n_items * 64 + 16 * m),
        counters=np.zeros(COUNTERS, np.int64),
    )
    table.module[0] = table.parent[0] = -1
    table.counters[N_MATRICES] = len(programs.maps) // 12
    return table


def _used(table: Table) -> dict[str, int]:
    """Return how much of every array of a table is in use."""
    c = table.counters
    return {
        **dict.fromkeys(_PER_STATE, int(c[N_STATES])),
        **dict.fromkeys(_PER_ITEM, int(c[N_ITEMS])),
        "matrices": 12 * int(c[N_MATRICES]),
        "numbers": int(c[N_NUMBERS]),
        "values": int(c[N_VALUES]),
    }


def used_bytes(table: Table) -> int:
    """Return how much memory a table takes; pages that nobody writes to take none."""
    arrays = table._asdict()
    used = sum(n * arrays[name].itemsize for name, n in _used(table).items())
    return int(used + table.slots.nbytes)


def grow_table(programs: Programs, table: Table) -> Table:
    """Return a table with more room where there is little left."""
    arrays: dict[str, Any] = table._asdict()
    used = _used(table)
    for name, n in used.items():
        if 2 * n > len(arrays[name]):
            array = np.zeros(4 * len(arrays[name]), arrays[name].dtype)
            # `values_at` has one more.
            array[: n + 1] = arrays[name][: n + 1]
            arrays[name] = array
    if 3 * used["program"] > len(table.slots):
        arrays["slots"] = np.full(2 * len(table.slots), -1, np.int32)
        grown = Table(**arrays)
        rehash(programs, grown, grown.values.view(np.uint64))
        return grown
    return Table(**arrays)
