"""Which engine answers the rays of a scene, and how it has the states.

Few states are unrolled in Python; more, as far as memory has room for them, in compiled code; the
others are made while rays are traced. What states cannot do the walker does.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pcsg.collector import collector_at_rest
from pcsg.errors import GrammarError, UsageError
from pcsg.graph.bounds import HyperBoxes, hyper_boxes
from pcsg.graph.graph import Graph
from pcsg.graph.states import StateGraph
from pcsg.graph.unroll import enumerate_states
from pcsg.memory import half_of_memory
from pcsg.trace.expand.reading import EXPANSION_MEMORY, StatesReader
from pcsg.trace.pool import pool_of
from pcsg.trace.preparing import Preparation
from pcsg.trace.rays import count_processors
from pcsg.trace.tracer import Engine, StatesTracer, trace_states
from pcsg.trace.walker import Walker

if TYPE_CHECKING:
    from pcsg.trace.expand.expansion import Expansion
    from pcsg.trace.expand.pack import Packed
    from pcsg.trace.expand.partial import PartialExpansion

UNROLL_BUDGET = 2_000
"""States that are unrolled before others are left to be made on demand."""

SUSPENDED_MEMORY = 16 << 20
"""Bytes of the states that are made beforehand where memory has no room for all."""

WHOLE_BUDGET = 16_000
"""States that are unrolled where they cannot be made on demand: seconds of preparation."""


class Limits(NamedTuple):
    """What a scene may take; None for what is usual, see `pcsg.Scene`."""

    threads: int | None = None
    max_memory: int | None = None
    block_memory: int | None = None


class EngineChoice:
    """The engine of a scene.

    Parameters
    ----------
    graph
        A graph without errors.
    values
        Values of the global parameters.
    asked
        The engine that was asked for.
    limits
        What it may take.

    Attributes
    ----------
    name
        ``states`` or ``cyclic``.

    Raises
    ------
    GrammarError
        A fault was found among the states.
    UsageError
        The states cannot be had that were asked for.
    """

    def __init__(
        self, graph: Graph, values: Mapping[str, float], asked: Engine, limits: Limits
    ) -> None:
        self.graph = graph
        self.values = values
        self._limits = limits
        faults = self.states.diagnostics
        if faults:
            raise GrammarError(faults)
        self._expansion: Expansion | None = None
        self._partial: PartialExpansion | None = None
        self._model_values: dict[int, list[tuple[float, ...]]] = {}
        unrolled = asked != "cyclic" and self._unroll()
        if asked == "states" and not unrolled:
            raise UsageError(f"{self._obstacle}; use the engine `cyclic` or `auto`")
        self.name = "states" if unrolled else "cyclic"

    def _unroll(self) -> bool:
        """Find how the engine of states can have its states; return whether it can."""
        if not self.states.finite:
            self._expansion = self._expand()
            if self._expansion is not None:
                self._model_values = self._expansion.model_values
                return True
            if self.states.unknown_models:
                raise GrammarError(self.states.unknown_models)
            return self._expand_partly()
        if self.states.finite and not self.states.acyclic:
            self._obstacle = "a module of the grammar leads back to itself with the same values"
        unrolled = self.states.finite and self.states.acyclic
        if unrolled and self._is_far():
            self._expansion = self._expand()
        return unrolled

    def _is_far(self) -> bool:
        """Return whether few states need frames that only compiled code lays out."""
        from pcsg.trace.blocks import OPEN_WHOLE
        from pcsg.trace.expand.frames import is_flat_and_small

        with np.errstate(over="ignore", invalid="ignore"):
            return is_flat_and_small(self.states, OPEN_WHOLE)

    def _expand_partly(self) -> bool:
        """Expand the largest states, so that the others can follow; return whether they can."""
        from pcsg.trace.expand.partial import NotSuspended, PartialExpansion

        given = self._limits.block_memory
        memory = SUSPENDED_MEMORY if given is None else given
        try:
            expansion = PartialExpansion(
                self.graph, self.values, pool_of(self.graph), memory, self._preparation(0.4, 0.5)
            )
        except NotSuspended as reason:
            self.states = enumerate_states(self.graph, self.values, WHOLE_BUDGET)
            self._obstacle = (
                f"the grammar has more than {self.states.count:,} states, which cannot be made"
                f" on demand ({reason})"
            )
            return self.states.finite and self.states.acyclic
        self._partial = expansion
        self._model_values = expansion.model_values
        return True

    def _expand(self) -> Expansion | None:
        """Return all states where memory has room for them, in compiled code."""
        memory = (
            EXPANSION_MEMORY if self._limits.block_memory is None else self._limits.block_memory
        )
        found = self.reader.expand(
            memory, pool_of(self.graph), preparation=self._preparation(0.0, 0.4)
        )
        if found is None:
            return None
        if found.diagnostics:
            raise GrammarError(found.diagnostics)
        return found if found.order is not None else None

    @cached_property
    def reader(self) -> StatesReader:
        """Who reads the states for others."""
        return StatesReader(self.graph, self.values, self.states, lambda: self._expansion)

    @cached_property
    def packed(self) -> Packed | None:
        """The expansion as blocks; the table of states goes."""
        from pcsg.trace.expand.pack import pack_expansion

        if self._expansion is None:
            return None
        packed = pack_expansion(self._expansion, self._preparation(0.4, 1.0))
        self._expansion = None
        return packed

    def _preparation(self, begin: float, end: float) -> Preparation:
        """Return a part of the preparation, from one share to another."""
        span = self.graph.root.span
        most = half_of_memory() if self._limits.max_memory is None else self._limits.max_memory
        return Preparation(span.source.name if span else "the scene", most, begin, end)

    @cached_property
    def states(self) -> StateGraph:
        """The graph unrolled over its states, as far as the budget goes."""
        return enumerate_states(self.graph, self.values, UNROLL_BUDGET)

    @cached_property
    def boxes(self) -> HyperBoxes:
        """Hyper-bounding boxes of the nodes."""
        with np.errstate(over="ignore", invalid="ignore"):
            return hyper_boxes(self.graph, self.values, self.states)

    @cached_property
    def tracer(self) -> Walker | StatesTracer:
        """Who answers the rays."""
        # What is beyond the numbers of boxes is infinite there, and so within them.
        with np.errstate(over="ignore", invalid="ignore"), collector_at_rest():
            return self._make_tracer()

    def _make_tracer(self) -> Walker | StatesTracer:
        if self._partial is not None:
            return self._trace_partly(self._partial)
        if self.packed is not None:
            packed, models = self.packed, pool_of(self.graph)
            return StatesTracer(
                packed.blocks,
                models,
                self._make_walker,
                self._limits.threads,
                lambda: packed.may_shrink,
            )
        if self.name == "states":
            return trace_states(self.graph, self.states, self._make_walker, self._limits.threads)
        return self._make_walker()

    def _trace_partly(self, expansion: PartialExpansion) -> StatesTracer:
        """Return the tracer of a graph of which only the largest states are expanded."""
        from pcsg.trace.expand.suspended import SuspendedBlocks

        threads = self._limits.threads or count_processors()
        suspended = SuspendedBlocks(expansion, threads, self._preparation(0.5, 1.0))
        self._partial = None
        return StatesTracer(
            suspended.packed.blocks,
            pool_of(self.graph),
            self._make_walker,
            self._limits.threads,
            suspended=suspended,
        )

    def _make_walker(self) -> Walker:
        if self.states.unknown_models and not self._model_values:
            table = self.reader.expand()
            self._model_values = {} if table is None else table.model_values
        limit = {} if self._limits.max_memory is None else {"max_bytes": self._limits.max_memory}
        return Walker(
            self.graph,
            self.values,
            boxes=self.boxes.boxes,
            threads=self._limits.threads,
            states=self.states,
            model_values=self._model_values,
            **limit,
        )
