"""The walker in Python's terms: arrays in, arrays out, threads, larger buffers, faults.

Results do not depend on the number of threads or on how rays are cut into chunks: every ray is
walked by itself.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.errors import EnvironmentFault, EvaluationFault
from pcsg.graph import faults
from pcsg.graph.bounds import hyper_boxes
from pcsg.graph.depth import MOST_SELECTIONS
from pcsg.graph.expr import Parameter
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.nodes import Leaf, Node, Selection
from pcsg.graph.states import LeafStep, StateGraph
from pcsg.graph.unroll import enumerate_states
from pcsg.leaf.registry import Pool
from pcsg.trace import walk_space as ended
from pcsg.trace.batch import (
    CONTAINS,
    CROSSINGS,
    INTERVALS,
    OCCLUSION,
    OUTPUT_FULL,
    SURFACES,
    Intervals,
    make_intervals,
    trace_batch,
)
from pcsg.trace.hits import Crossings, Hits, Spans
from pcsg.trace.pool import pool_of
from pcsg.trace.precision import extent_of
from pcsg.trace.rays import Pace, Rays, check_points, check_rays, count_processors, run_chunks
from pcsg.trace.surface import Surface, make_surface
from pcsg.trace.tables import SELECTION, Models, Tables, pack
from pcsg.trace.walk_space import PRECISION, RECORD, Scratch, follow_chain


class _Buffers:
    """The working space of one thread, which grows when a ray asks for more."""

    def __init__(self, tables: Tables, max_bytes: int) -> None:
        self._tables = tables
        self._max_bytes = max_bytes
        self._sizes = {"frames": 256, "chain": 1024, "events": 256, "records": 128}
        self._sizes["crossings"] = 64
        self.scratch = self._allocate()

    def grow(self, status: int) -> None:
        """Make larger what was too small: by much, because a deep ray begins again.

        Raises
        ------
        EnvironmentFault
            The memory for this thread is used up.
        """
        name = _GROWING[status]
        for factor in (8, 4, 2):
            sizes = self._sizes | {name: factor * self._sizes[name]}
            if self._count_bytes(sizes) <= self._max_bytes:
                self._sizes = sizes
                self.scratch = self._allocate()
                return
        raise EnvironmentFault(
            f"a ray needs more than {self._max_bytes >> 20} MB of working memory for its "
            "intervals and the depth of the recursion; raise --max-memory, or subtract and "
            "intersect smaller parts"
        )

    def _count_bytes(self, sizes: Mapping[str, int]) -> int:
        per_frame = 40 + 8 * (9 + len(self._tables.initial))
        return (
            sizes["frames"] * per_frame
            + sizes["chain"] * 108
            + sizes["events"] * 32
            + sizes["records"] * (8 * RECORD + 12)
            + sizes["crossings"] * 8
        )

    def _allocate(self) -> Scratch:
        p = len(self._tables.initial)
        frames, chain, events, records, crossings = self._sizes.values()
        return Scratch(
            frames=np.zeros(frames * 10, np.int32),
            states=np.zeros(frames * (9 + p)),
            chain=np.zeros(chain * 3, np.int32),
            chain_matrices=np.zeros(chain * 12),
            event_t=np.zeros(events),
            event_about=np.zeros(events * 2, np.int32),
            merged_t=np.zeros(events),
            merged_about=np.zeros(events * 2, np.int32),
            records=np.zeros(records * RECORD),
            record_about=np.zeros(records * 3, np.int32),
            params=np.zeros(p),
            stack=np.zeros(self._tables.stack_size),
            t=np.zeros(crossings),
            best=np.zeros(PRECISION + 2),
            fault=np.zeros(3, np.int32),
        )


_GROWING = {
    ended.FRAMES_FULL: "frames",
    ended.CHAIN_FULL: "chain",
    ended.EVENTS_FULL: "events",
    ended.RECORDS_FULL: "records",
    ended.CROSSINGS_FULL: "crossings",
}

_FAULTS = {
    ended.NOT_FINITE: faults.NOT_FINITE,
    ended.UNASSIGNED: faults.UNASSIGNED_PARAMETER,
    ended.SELECTION_RANGE: faults.SELECTION_RANGE,
    ended.SINGULAR: faults.SINGULAR_MATRIX,
    ended.BAD_ARGUMENT: faults.BAD_ARGUMENT,
    ended.TOO_DEEP: faults.DEPTH_LIMIT,
    ended.TOO_LONG: faults.LONG_RAY,
}


class Walker:
    """Rays through the cyclic graph itself.

    Parameters
    ----------
    graph
        What is walked.
    values
        Values of the global parameters (SEED, TIME...).
    boxes : float64 (N, 6), optional
        Hyper-bounding boxes of the nodes; computed if not given.
    depth_limit
        Most selections on a path; more is a fault.
    threads
        Most threads of one call; by default one for each processor.
    max_bytes
        Most working memory of one thread.
    states
        The graph's states, which tell the models of leaves with data; enumerated if they are
        needed and not given.
    model_values
        By node, the values that the numbers of such leaves take, where the states do not tell.
    """

    kernel: Any = trace_batch
    """The compiled entry."""

    def __init__(
        self,
        graph: Graph,
        values: Mapping[str, float] = GLOBALS,
        *,
        boxes: NDArray[np.float64] | None = None,
        depth_limit: int = MOST_SELECTIONS,
        threads: int | None = None,
        max_bytes: int = 1 << 30,
        states: StateGraph | None = None,
        model_values: Mapping[int, Collection[tuple[float, ...]]] | None = None,
    ) -> None:
        self.graph = graph
        if states is None and (boxes is None or any(map(_has_data, graph.nodes))):
            states = enumerate_states(graph, values)
        if boxes is None:
            boxes = hyper_boxes(graph, values, states).boxes
        self._extent = extent_of(boxes[graph.number[graph.root]].reshape(2, 3))
        pool = pool_of(graph)
        models = Models(model_values or _model_values(states), pool.place)
        self.tables, self._program = pack(graph, boxes, values, depth_limit, models)
        self.threads = threads or count_processors()
        self._max_bytes = max_bytes
        self._pool: Pool = pool.pool
        self._local = threading.local()
        self._pace = Pace()

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of what rays read."""
        return {"graph": self.tables.nbytes, **pool_of(self.graph).nbytes}

    def intersect(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> Hits:
        """Find the first crossing of every ray in [t_min, t_max]; exits count.

        Parameters
        ----------
        origins, directions : array_like (N, 3)
            Directions need not be unit; t is in their lengths.
        t_min, t_max : array_like, scalar or (N,)

        Raises
        ------
        UsageError
            Shapes do not fit, or a ray is zero or not finite.
        EvaluationFault
            A ray met a fault of the grammar.
        """
        return self.find_surfaces(check_rays(origins, directions, t_min, t_max))

    def find_surfaces(self, rays: Rays) -> Hits:
        """Find the first crossings of checked rays."""
        out = make_surface(len(rays.origins))

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            status, i, _ = self._trace(scratch, SURFACES, rays, begin, end, surface=out)
            return status, i

        self._run(len(rays.origins), work)
        return out.hits()

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything in [t_min, t_max]; arguments as `intersect`."""
        return self.find_occlusion(check_rays(origins, directions, t_min, t_max))

    def find_occlusion(self, rays: Rays) -> NDArray[np.bool_]:
        """Find whether checked rays cross anything."""
        out = np.zeros(len(rays.origins), np.bool_)

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            status, i, _ = self._trace(scratch, OCCLUSION, rays, begin, end, flags=out)
            return status, i

        self._run(len(rays.origins), work)
        return out

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Find whether the solid contains points (N, 3)."""
        rays = check_rays(check_points(points), (0.0, 0.0, 1.0), -math.inf, math.inf)
        out = np.zeros(len(rays.origins), np.bool_)

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            status, i, _ = self._trace(scratch, CONTAINS, rays, begin, end, flags=out)
            return status, i

        self._run(len(rays.origins), work)
        return out

    def spans(self, origins: ArrayLike, directions: ArrayLike) -> Spans:
        """Find all inside intervals of every ray, on the whole line."""
        rays = check_rays(origins, directions, -math.inf, math.inf)
        counts = np.zeros(len(rays.origins), np.int64)
        parts = self._gather(
            rays,
            INTERVALS,
            lambda room: make_intervals(counts, room),
            lambda made: {"intervals": made},
            lambda made: made[1:],
        )
        return Spans(_offsets(counts), *parts)

    def find_crossings(self, rays: Rays) -> Crossings:
        """Find all crossings of checked rays."""
        n = len(rays.origins)
        counts = np.zeros(n, np.int64)
        intervals = make_intervals(counts, 0)
        *columns, entering = self._gather(
            rays,
            CROSSINGS,
            lambda room: (make_surface(room), np.empty(room, np.bool_)),
            lambda made: {"surface": made[0], "flags": made[1], "intervals": intervals},
            lambda made: (*made[0], made[1]),
        )
        hits = Surface(*columns).hits()
        sheets = np.array([isinstance(x, Leaf) and x.is_sheet for x in self.graph.nodes])
        return Crossings(
            **hits.columns(),
            offsets=_offsets(counts),
            ray=np.repeat(np.arange(n), counts),
            entering=entering,
            sheet=sheets[hits.leaf],
        )

    def _gather(
        self,
        rays: Rays,
        asked: int,
        make: Callable[[int], Any],
        given: Callable[[Any], dict[str, Any]],
        columns: Callable[[Any], Sequence[NDArray[Any]]],
    ) -> list[NDArray[Any]]:
        """Ask for several rows a ray and return their columns, in the order of the rays.

        Parameters
        ----------
        make
            Returns room for so many rows.
        given
            Returns it as arguments of `_trace`.
        columns
            Returns its columns.
        """
        # A chunk may be asked again from a ray on, with a larger working space.
        parts: dict[int, list[NDArray[Any]]] = {}

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            room = make(2 * (end - begin) + 64)
            i, used, done = begin, 0, begin
            while True:
                status, i, used = self._trace(
                    scratch, asked, rays, i, end, used=used, **given(room)
                )
                if used:
                    parts[done] = [a[:used].copy() for a in columns(room)]
                if status != OUTPUT_FULL:
                    return status, i
                # The next room holds all of this ray, and is larger.
                room = make(2 * len(columns(room)[0]) + len(scratch.event_t))
                used, done = 0, i

        self._run(len(rays.origins), work)
        none = [a[:0] for a in columns(make(0))]
        ordered = [parts[begin] for begin in sorted(parts)]
        return [np.concatenate(column) for column in zip(none, *ordered, strict=True)]

    def _trace(
        self,
        scratch: Scratch,
        asked: int,
        rays: Rays,
        begin: int,
        end: int,
        surface: Surface | None = None,
        flags: NDArray[np.bool_] | None = None,
        intervals: Intervals | None = None,
        used: int = 0,
    ) -> tuple[int, int, int]:
        return trace_batch(
            self.tables,
            self._pool,
            scratch,
            self._extent,
            asked,
            *rays,
            begin,
            end,
            surface or _NO_SURFACE,
            _NO_FLAGS if flags is None else flags,
            intervals or _NO_INTERVALS,
            used,
        )

    def _run(self, n: int, work: Callable[[int, int, Scratch], tuple[int, int]]) -> None:
        run_chunks(
            n, self.threads, lambda begin, end: self._run_chunk(begin, end, work), self._pace
        )

    def _run_chunk(
        self, begin: int, end: int, work: Callable[[int, int, Scratch], tuple[int, int]]
    ) -> None:
        if not hasattr(self._local, "buffers"):
            self._local.buffers = _Buffers(self.tables, self._max_bytes)
        buffers: _Buffers = self._local.buffers
        i = begin
        while i < end:
            status, i = work(i, end, buffers.scratch)
            if status >= ended.FRAMES_FULL:
                buffers.grow(status)
            elif status != ended.OK:
                raise self._fault(status, buffers.scratch)

    def _fault(self, status: int, scratch: Scratch) -> EvaluationFault:
        """Tell a fault with its place, its derivation path and its parameters."""
        node, instruction, end = (int(x) for x in scratch.fault)
        entries = np.zeros(end + 1, np.int32)
        entries = entries[: follow_chain(scratch.chain, end, entries)][::-1]
        _, through, rules = scratch.chain.reshape(-1, 3)[entries].T.astype(np.int64)
        steps = (through << 32 | rules)[self.tables.kind[through] == SELECTION]
        path = faults.spell_path(steps, self._link_of)
        span = self._program.span(instruction) if instruction >= 0 else None
        values = {
            name: float(scratch.params[slot])
            for name, slot in self.graph.slots.items()
            if not name.startswith("@") and not math.isnan(scratch.params[slot])
        }
        detail = self._fault_detail(status, node, instruction, scratch)
        return faults.evaluation_fault(
            _FAULTS[status], self.graph, node, span, path, values, detail
        )

    def _link_of(self, step: int) -> tuple[str, int]:
        """Return the name of a module and the number of a rule, from one number for both."""
        module = self.graph.nodes[step >> 32]
        assert isinstance(module, Selection)
        return module.name, step & 0xFFFFFFFF

    def _fault_detail(self, status: int, node: int, instruction: int, scratch: Scratch) -> str:
        """Return what the walker knows of a fault beyond its kind."""
        found = self.graph.nodes[node]
        if status == ended.SELECTION_RANGE and isinstance(found, Selection):
            rules = ", ".join(str(rule) for rule in sorted(found.rules))
            return f"its value is {scratch.stack[0]:g}, the rules are {rules}"
        if status == ended.BAD_ARGUMENT and isinstance(found, Leaf) and found.constants:
            given = zip(found.parameters, scratch.stack, strict=False)
            return "there is no model for " + ", ".join(f"{p.name} = {x:g}" for p, x in given)
        if status == ended.BAD_ARGUMENT and isinstance(found, Leaf):
            return ", ".join(
                f"{p.name} is {x:g}, it must be {p.condition}"
                for p, x in zip(found.parameters, scratch.stack, strict=False)
            )
        if status == ended.UNASSIGNED:
            expr = self._program.exprs[instruction]
            return f"`{expr.name}`" if isinstance(expr, Parameter) else ""
        if status == ended.TOO_DEEP:
            return f"{self.tables.depth_limit} selections on one path"
        if status == ended.TOO_LONG:
            return f"more than {self.tables.visit_limit:,} modules lie along it"
        return ""


def _has_data(node: Node) -> bool:
    return isinstance(node, Leaf) and bool(node.constants)


def _model_values(states: StateGraph | None) -> dict[int, dict[tuple[float, ...], None]]:
    """Return the values that the numbers of leaves with data take in the states."""
    found: dict[int, dict[tuple[float, ...], None]] = {}
    for state in states.states if states else ():
        for step in state.steps:
            if isinstance(step, LeafStep) and _has_data(states.graph.nodes[step.node]):  # type: ignore[union-attr]
                found.setdefault(step.node, {})[step.args] = None
    return found


_NO_SURFACE = make_surface(0)
_NO_FLAGS = np.zeros(0, np.bool_)
_NO_INTERVALS = make_intervals(np.zeros(0, np.int64), 0)


def _offsets(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)])
