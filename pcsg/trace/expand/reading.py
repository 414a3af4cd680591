"""Who reads the states of a scene: in Python where they are few, else in their table.

The table is made again for every reader, and nobody keeps it beside the blocks: that takes less
than a second for a million states.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import GrammarError, UsageError
from pcsg.graph.counts import count_primitives
from pcsg.graph.graph import Graph
from pcsg.graph.states import StateGraph
from pcsg.graph.stats import Counts
from pcsg.trace.pool import ModelPool, make_pool
from pcsg.trace.preparing import UNLIMITED, Preparation

if TYPE_CHECKING:
    from pcsg.graph.leaves import Leaves
    from pcsg.trace.expand.expansion import Expansion
    from pcsg.trace.expand.measuring import Measuring

EXPANSION_MEMORY = 512 << 20
"""Bytes of all states, where they are many and are unrolled in compiled code."""

_FEW = 2_000
"""Entries of a count of leaves that is made to look ahead."""


class StatesReader:
    """Answers what is asked about all states of a graph.

    Parameters
    ----------
    graph, values
        The graph, and values of the global parameters.
    states
        Its states as far as Python has enumerated them.
    known
        Returns a complete table where somebody has one at the moment.
    """

    def __init__(
        self,
        graph: Graph,
        values: Mapping[str, float],
        states: StateGraph,
        known: Callable[[], Expansion | None] = lambda: None,
    ) -> None:
        self.graph = graph
        self.values = values
        self.states = states
        self._known = known
        # Bytes that all states are known not to fit into.
        self._too_little = -1

    def expand(
        self,
        memory: int = EXPANSION_MEMORY,
        models: ModelPool | None = None,
        without: Collection[int] = frozenset(),
        preparation: Preparation = UNLIMITED,
    ) -> Expansion | None:
        """Return a new table of all states; None where it needs more memory.

        Parameters
        ----------
        memory
            Bytes of the table.
        models
            Receives the models of leaves with data.
        without
            Nodes that are taken to be empty.
        preparation
            Is told how far it is, and asked for memory.
        """
        from pcsg.trace.expand.expansion import Expansion, TooLarge

        def look_ahead() -> int | None:
            return count_primitives(self.graph, self.values, _FEW)

        try:
            return Expansion(
                self.graph,
                self.values,
                models or make_pool(self.graph),
                memory,
                look_ahead,
                without,
                preparation,
            )
        except TooLarge:
            if not without:
                self._too_little = max(self._too_little, memory)
            return None

    def _table(self, without: Collection[int] = frozenset()) -> Expansion | None:
        """Return the table to read; None where Python reads, or nobody can."""
        if self.states.finite:
            return None
        if not without and self._too_little >= EXPANSION_MEMORY:
            return None
        found = None if without else self._known()
        found = found or self.expand(without=without)
        return found if found is not None and found.order is not None else None

    def leaves(self, size: int) -> Iterator[Leaves]:
        """Yield the primitives in the order of the text, so many at a time.

        Raises
        ------
        UsageError
            There are too many states.
        """
        from pcsg.graph import leaves
        from pcsg.trace.expand import placing

        table = self._table()
        if table is not None:
            return placing.batches_of_leaves(table, size)
        return leaves.batches_of_leaves(self.states, size)

    def covers(self, strengths: Sequence[float]) -> NDArray[np.float64]:
        """Return covers of all that shines; see `pcsg.graph.shining`.

        Parameters
        ----------
        strengths
            How much a surface of every material shines.
        """
        from pcsg.graph import shining
        from pcsg.trace.expand import light

        if not self.states.finite:
            table = self._table(without=shining.dark_nodes(self.graph, strengths))
            if table is not None:
                return light.shining_covers(table, strengths)
        return shining.shining_covers(self.states, strengths)

    @cached_property
    def measuring(self) -> Measuring:
        """Who integrates over all primitives, in a table of its own that stays.

        Raises
        ------
        UsageError
            There are too many states, or one contains itself.
        """
        from pcsg.trace.expand.measuring import Measuring

        # Whoever packs the known one takes it apart.
        return Measuring(self.expand_whole())

    def expand_whole(self) -> Expansion:
        """Return a new table of all states.

        Raises
        ------
        UsageError
            There are too many states.
        GrammarError
            A fault was met.
        """
        found = self.expand()
        if found is None:
            raise UsageError("the scene has too many states for their table: some millions")
        if found.diagnostics:
            raise GrammarError(found.diagnostics)
        return found

    def count(self) -> Counts | None:
        """Return what is counted in the table; None where there is none."""
        from pcsg.trace.expand import census

        table = self._table()
        if table is None:
            return None
        return Counts(table.n_states - 1, census.count_primitives(table), census.data_leaves(table))
