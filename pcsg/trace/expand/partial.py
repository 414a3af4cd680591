"""Expanding a graph whose states are too many: the largest ones, and where the others begin."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.ranges import Ranges
from pcsg.trace.expand.best_first import Frontier, fill_best_first
from pcsg.trace.expand.clusters import BOUNDS
from pcsg.trace.expand.entries import Entries, pack_entries
from pcsg.trace.expand.expansion import SLICE, Expansion, grow_table, used_bytes
from pcsg.trace.expand.table import DONE, FAULT, FULL, Table
from pcsg.trace.pool import ModelPool
from pcsg.trace.preparing import UNLIMITED, Preparation

_FORCED = 64 << 20
"""Bytes of states without bounds, which are expanded whatever the budget is."""


class NotSuspended(Exception):
    """The graph has something that cannot be expanded while rays are traced."""


class PartialExpansion(Expansion):
    """The largest states of a graph.

    Parameters
    ----------
    graph
        The graph.
    values
        Values of the global parameters.
    models
        Receives the models of leaves with data.
    memory
        Bytes of what is made of the states; states beyond are suspended: `table.first` is -1.
    preparation
        Is told how far it is, and asked for memory.

    Attributes
    ----------
    entries
        Bounds of states.
    frontier
        Entries and bounds of the states in the table.

    Raises
    ------
    NotSuspended
        There is no end of states without bounds, models of leaves depend on the place, or a state
        contains itself.
    """

    entries: Entries
    frontier: Frontier

    def __init__(
        self,
        graph: Graph,
        values: Mapping[str, float],
        models: ModelPool,
        memory: int,
        preparation: Preparation = UNLIMITED,
    ) -> None:
        super().__init__(graph, values, models, memory, preparation=preparation)
        if self.order is None:
            raise NotSuspended("a module leads back to itself with the same values")

    def take_items(self) -> Table:
        """Return the table, with what suspended states are known by."""
        return self.table

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Bounds of the states."""
        return self.frontier.bounds

    def _fill(self, max_bytes: int) -> bool:
        """Make the largest states; faults are left for rays to meet."""
        if self._writer.varying:
            raise NotSuspended("the data of a leaf depends on the place")
        programs = self.programs
        self.entries = pack_entries(_find_ranges(self.graph, self.values), programs)
        self.frontier = _make_frontier(len(self.table.program))
        work = self.make_work()
        while True:
            self._preparation.tell(used_bytes(self.table) / max(1, max_bytes))
            status = fill_best_first(
                programs,
                self.entries,
                self.table,
                self.table.values.view(np.uint64),
                work,
                self.frontier,
                float(max_bytes),
                suspended_bytes(programs.live_at),
                float(_FORCED),
                SLICE,
            )
            if status == DONE:
                return True
            if status == FAULT:
                raise NotSuspended("there is no end of solids without bounds")
            if status == FULL:
                # For a moment what grows is there twice.
                self._preparation.require(2 * used_bytes(self.table))
                self.table = grow_table(programs, self.table)
                self.frontier = _grow_frontier(self.frontier, len(self.table.program))


def suspended_bytes(live_at: NDArray[np.int32]) -> int:
    """Return the memory of what is known of a suspended state."""
    return 8 + 8 * most_values(live_at)


def most_values(live_at: NDArray[np.int32]) -> int:
    """Return how many values a state has at most."""
    return max(1, int(np.diff(live_at).max()))


def _find_ranges(graph: Graph, values: Mapping[str, float]) -> Ranges:
    for by_values in (True, False):
        ranges = Ranges(graph, by_values)
        if ranges.run(values):
            return ranges
    raise NotSuspended("its parameters have too many ranges")


def _make_frontier(states: int) -> Frontier:
    frontier = Frontier(
        entry=np.full(states, -1, np.int32),
        bounds=np.zeros(BOUNDS * states),
        scale=np.ones(states),
        areas=np.zeros(states),
        states=np.zeros(states, np.int32),
        size=np.ones(1, np.int64),
    )
    frontier.entry[0] = 0
    frontier.areas[0] = np.inf
    return frontier


def _grow_frontier(frontier: Frontier, states: int) -> Frontier:
    grown = _make_frontier(max(states, len(frontier.entry)))
    for name in Frontier._fields:
        old = getattr(frontier, name)
        getattr(grown, name)[: len(old)] = old
    return grown
