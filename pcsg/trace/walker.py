"""The walker in Python's terms: arrays in, arrays out, threads, larger buffers, faults.

Results do not depend on the number of threads or on how rays are cut into chunks: every ray is
walked by itself.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.errors import EnvironmentFault, EvaluationFault, UsageError
from pcsg.graph import faults
from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS
from pcsg.graph.bounds import hyper_boxes
from pcsg.graph.expr import Parameter
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.nodes import Leaf, Selection
from pcsg.leaf.registry import Pool
from pcsg.trace import walk
from pcsg.trace.batch import (
    CONTAINS,
    INTERVALS,
    OCCLUSION,
    OUTPUT_FULL,
    SURFACES,
    Intervals,
    Surface,
    trace_batch,
)
from pcsg.trace.hits import Hits, Spans
from pcsg.trace.tables import Tables, pack
from pcsg.trace.walk import RECORD, Scratch

CHUNK = 16_384
"""Rays that one thread takes at a time."""


class _Buffers:
    """The working space of one thread, which grows when a ray asks for more."""

    def __init__(self, tables: Tables, max_bytes: int) -> None:
        self._tables = tables
        self._max_bytes = max_bytes
        self._frames, self._chain, self._events, self._records = 256, 1024, 256, 128
        self.scratch = self._allocate()

    def grow(self, status: int) -> None:
        """Double what was too small.

        Raises
        ------
        EnvironmentFault
            The memory for this thread is used up.
        """
        if status == walk.FRAMES_FULL:
            self._frames *= 2
        elif status == walk.CHAIN_FULL:
            self._chain *= 2
        elif status == walk.EVENTS_FULL:
            self._events *= 2
        else:
            self._records *= 2
        per_frame = 40 + 8 * (9 + len(self._tables.initial))
        wanted = self._frames * per_frame + self._chain * 108 + self._events * 32
        wanted += self._records * (8 * RECORD + 12)
        if wanted > self._max_bytes:
            raise EnvironmentFault(
                f"a ray needs more than {self._max_bytes >> 20} MB of working memory for its "
                "intervals; raise --max-memory, or subtract and intersect smaller parts"
            )
        self.scratch = self._allocate()

    def _allocate(self) -> Scratch:
        p = len(self._tables.initial)
        return Scratch(
            frames=np.zeros(self._frames * 10, np.int32),
            states=np.zeros(self._frames * (9 + p)),
            chain=np.zeros(self._chain * 3, np.int32),
            chain_matrices=np.zeros(self._chain * 12),
            event_t=np.zeros(self._events),
            event_about=np.zeros(self._events * 2, np.int32),
            merged_t=np.zeros(self._events),
            merged_about=np.zeros(self._events * 2, np.int32),
            records=np.zeros(self._records * RECORD),
            record_about=np.zeros(self._records * 3, np.int32),
            params=np.zeros(p),
            stack=np.zeros(self._tables.stack_size),
            t=np.zeros(64),
            best=np.zeros(13),
            fault=np.zeros(3, np.int32),
        )


_FAULTS = {
    walk.NOT_FINITE: faults.NOT_FINITE,
    walk.UNASSIGNED: faults.UNASSIGNED_PARAMETER,
    walk.SELECTION_RANGE: faults.SELECTION_RANGE,
    walk.SINGULAR: faults.SINGULAR_MATRIX,
    walk.BAD_ARGUMENT: faults.BAD_ARGUMENT,
    walk.TOO_DEEP: faults.DEPTH_LIMIT,
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
    """

    def __init__(
        self,
        graph: Graph,
        values: Mapping[str, float] = GLOBALS,
        *,
        boxes: NDArray[np.float64] | None = None,
        depth_limit: int = 10_000,
        threads: int | None = None,
        max_bytes: int = 1 << 30,
    ) -> None:
        self.graph = graph
        if boxes is None:
            boxes = hyper_boxes(graph, values).boxes
        self.tables, self._program = pack(graph, boxes, values, depth_limit)
        self.threads = threads or os.cpu_count() or 1
        self._max_bytes = max_bytes
        self._pool: Pool = (np.zeros(1), np.zeros(1, np.float32), np.zeros(1, np.int32))
        self._local = threading.local()

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
        o, d = _rays(origins, directions)
        low, high = _limits(t_min, t_max, len(o))
        n = len(o)
        out = _surface(n)

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            status, i, _ = self._trace(scratch, SURFACES, o, d, low, high, begin, end, surface=out)
            return status, i

        self._run(n, work)
        a = out.attributes
        return Hits(
            t=out.t,
            position=out.position,
            normal=out.normal,
            uv=out.uv,
            leaf=out.leaf,
            label=a[:, 6].astype(np.int64),
            color=np.ascontiguousarray(a[:, :3]),
            material=a[:, 3].astype(np.int64),
            texture=a[:, 4].astype(np.int64),
            texture_scale=np.ascontiguousarray(a[:, 5]),
        )

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything in [t_min, t_max]; arguments as `intersect`."""
        o, d = _rays(origins, directions)
        low, high = _limits(t_min, t_max, len(o))
        out = np.zeros(len(o), np.bool_)

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            status, i, _ = self._trace(scratch, OCCLUSION, o, d, low, high, begin, end, flags=out)
            return status, i

        self._run(len(o), work)
        return out

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Find whether the solid contains points (N, 3)."""
        p = _vectors(points, "points")
        up = np.tile([0.0, 0.0, 1.0], (len(p), 1))
        low, high = _limits(-math.inf, math.inf, len(p))
        out = np.zeros(len(p), np.bool_)

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            status, i, _ = self._trace(scratch, CONTAINS, p, up, low, high, begin, end, flags=out)
            return status, i

        self._run(len(p), work)
        return out

    def spans(self, origins: ArrayLike, directions: ArrayLike) -> Spans:
        """Find all inside intervals of every ray, on the whole line."""
        o, d = _rays(origins, directions)
        n = len(o)
        low, high = _limits(-math.inf, math.inf, n)
        counts = np.zeros(n, np.int64)
        parts: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

        def work(begin: int, end: int, scratch: Scratch) -> tuple[int, int]:
            room = 2 * (end - begin) + 64
            out = Intervals(counts, np.empty(room), np.empty(room))
            i, used, status = begin, 0, walk.OK
            while i < end:
                status, i, used = self._trace(
                    scratch, INTERVALS, o, d, low, high, i, end, intervals=out, used=used
                )
                if status == OUTPUT_FULL:
                    more = np.empty(len(out.t_in) + len(scratch.event_t))
                    out = Intervals(
                        counts, np.concatenate([out.t_in, more]), np.concatenate([out.t_out, more])
                    )
                elif status != walk.OK:
                    break
            parts[begin] = out.t_in[:used].copy(), out.t_out[:used].copy()
            return status, i

        self._run(n, work)
        ordered = [parts[begin] for begin in sorted(parts)]
        offsets = np.concatenate([[0], np.cumsum(counts)])
        empty = np.empty(0)
        return Spans(
            offsets,
            np.concatenate([empty, *(a for a, _ in ordered)]),
            np.concatenate([empty, *(b for _, b in ordered)]),
        )

    def _trace(
        self,
        scratch: Scratch,
        asked: int,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        t_min: NDArray[np.float64],
        t_max: NDArray[np.float64],
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
            asked,
            origins,
            directions,
            t_min,
            t_max,
            begin,
            end,
            surface or _NO_SURFACE,
            _NO_FLAGS if flags is None else flags,
            intervals or _NO_INTERVALS,
            used,
        )

    def _run(self, n: int, work: Callable[[int, int, Scratch], tuple[int, int]]) -> None:
        """Do chunks of rays, in threads if there is more than one; raise the first fault."""
        starts = range(0, n, CHUNK)
        if len(starts) <= 1 or self.threads == 1:
            for begin in starts:
                self._run_chunk(begin, min(n, begin + CHUNK), work)
            return
        with ThreadPoolExecutor(min(self.threads, len(starts))) as executor:
            futures = [
                executor.submit(self._run_chunk, begin, min(n, begin + CHUNK), work)
                for begin in starts
            ]
            try:
                for future in futures:
                    future.result()
            except BaseException:
                executor.shutdown(cancel_futures=True)
                raise

    def _run_chunk(
        self, begin: int, end: int, work: Callable[[int, int, Scratch], tuple[int, int]]
    ) -> None:
        if not hasattr(self._local, "buffers"):
            self._local.buffers = _Buffers(self.tables, self._max_bytes)
        buffers: _Buffers = self._local.buffers
        i = begin
        while i < end:
            status, i = work(i, end, buffers.scratch)
            if status >= walk.FRAMES_FULL:
                buffers.grow(status)
            elif status != walk.OK:
                raise self._fault(status, buffers.scratch)

    def _fault(self, status: int, scratch: Scratch) -> EvaluationFault:
        """Tell a fault with its place, its derivation path and its parameters."""
        node, instruction, end = (int(x) for x in scratch.fault)
        path = []
        while end >= 0:
            parent, through, rule = (int(x) for x in scratch.chain[3 * end : 3 * end + 3])
            module = self.graph.nodes[through]
            if isinstance(module, Selection):
                path.append((module.name, rule))
            end = parent
        span = self._program.span(instruction) if instruction >= 0 else None
        values = {
            name: float(scratch.params[slot])
            for name, slot in self.graph.slots.items()
            if not name.startswith("@") and not math.isnan(scratch.params[slot])
        }
        path.reverse()
        detail = self._fault_detail(status, node, instruction, scratch)
        return faults.evaluation_fault(
            _FAULTS[status], self.graph, node, span, path, values, detail
        )

    def _fault_detail(self, status: int, node: int, instruction: int, scratch: Scratch) -> str:
        """Return what the walker knows of a fault beyond its kind."""
        found = self.graph.nodes[node]
        if status == walk.SELECTION_RANGE and isinstance(found, Selection):
            rules = ", ".join(str(rule) for rule in sorted(found.rules))
            return f"its value is {scratch.stack[0]:g}, the rules are {rules}"
        if status == walk.BAD_ARGUMENT and isinstance(found, Leaf):
            return ", ".join(
                f"{p.name} is {x:g}, it must be {p.condition}"
                for p, x in zip(found.solid.parameters, scratch.stack, strict=False)
            )
        if status == walk.UNASSIGNED:
            expr = self._program.exprs[instruction]
            return f"`{expr.name}`" if isinstance(expr, Parameter) else ""
        if status == walk.TOO_DEEP:
            return f"{self.tables.depth_limit} selections on one path"
        return ""


def _surface(n: int) -> Surface:
    """Return a surface of n rays that miss."""
    return Surface(
        t=np.full(n, np.inf),
        leaf=np.full(n, -1, np.int64),
        position=np.zeros((n, 3)),
        normal=np.zeros((n, 3)),
        uv=np.zeros((n, 2)),
        attributes=np.tile(ATTRIBUTE_DEFAULTS, (n, 1)),
    )


_NO_SURFACE = _surface(0)
_NO_FLAGS = np.zeros(0, np.bool_)
_NO_INTERVALS = Intervals(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


def _vectors(values: ArrayLike, what: str) -> NDArray[np.float64]:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if not array.flags.writeable:
        array = array.copy()  # kernels are compiled for one type of array
    if array.ndim == 1 and array.shape == (3,):
        array = array[None, :]
    if array.ndim != 2 or array.shape[1] != 3:
        raise UsageError(f"{what} must have shape (N, 3), not {array.shape}")
    return array


def _rays(
    origins: ArrayLike, directions: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    o, d = _vectors(origins, "origins"), _vectors(directions, "directions")
    if len(o) == 1 and len(d) > 1:
        o = np.array(np.broadcast_to(o, d.shape), order="C")
    if len(d) == 1 and len(o) > 1:
        d = np.array(np.broadcast_to(d, o.shape), order="C")
    if o.shape != d.shape:
        raise UsageError(f"{len(o)} origins do not fit {len(d)} directions")
    if not (np.isfinite(o).all() and np.isfinite(d).all()):
        raise UsageError("rays must be finite")
    if not d.any(axis=1).all():
        raise UsageError("a ray's direction must not be zero")
    return o, d


def _limits(
    t_min: ArrayLike, t_max: ArrayLike, n: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    limits = []
    for value, name in ((t_min, "t_min"), (t_max, "t_max")):
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), (n,)):
            raise UsageError(f"{name} must be a number or have shape ({n},), not {array.shape}")
        if np.isnan(array).any():
            raise UsageError(f"{name} must not be NaN")
        limits.append(np.array(np.broadcast_to(array, (n,)), order="C"))
    return limits[0], limits[1]
