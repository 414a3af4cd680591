"""The engines behind one interface, and the choice between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS, ATTRIBUTE_SLOTS
from pcsg.graph.graph import Graph
from pcsg.graph.states import StateGraph
from pcsg.leaf.registry import FIRST
from pcsg.simd import WIDTH
from pcsg.trace.blocks import Blocks, build_blocks
from pcsg.trace.blocks_batch import BAD_RAY, find_batch
from pcsg.trace.coverage import (
    BINS,
    NO_FOOTPRINT,
    RAYS_PER_BIN,
    Collected,
    Ends,
    Footprint,
    Sampled,
    Space,
    average,
    gather_coverage,
    make_space,
    measure,
)
from pcsg.trace.ends import NEVER
from pcsg.trace.expand.cache import EXPANSIONS
from pcsg.trace.expand.suspended import SuspendedBlocks
from pcsg.trace.found import Found, FoundHits, make_found
from pcsg.trace.groups import BLOCK, INSTANCE, SUSPENDED
from pcsg.trace.hits import Hits, RaySpans, Spans, join_spans
from pcsg.trace.kernel import Cut
from pcsg.trace.membership import contain_batch, make_matrices
from pcsg.trace.pool import ModelPool, pool_of
from pcsg.trace.precision import Extent, extent_of
from pcsg.trace.rays import Rays, check_points, check_rays, check_values, run_chunks, shape_rays
from pcsg.trace.shrinking import may_shrink
from pcsg.trace.spanning import FULL, ROOMS, span_batch
from pcsg.trace.states_engine import StatesEngine
from pcsg.trace.traversal import HIT, UNDECIDED, Scratch, make_scratch
from pcsg.trace.walker import Walker

Engine = Literal["auto", "cyclic", "states"]
"""``cyclic`` walks the graph itself, ``states`` its unrolled states; ``auto`` takes the states
where they are finite in number."""


Floats = NDArray[np.float64]

_SPANNED = 65_536
"""Rays whose inside intervals are collected at a time."""

_LABEL = ATTRIBUTE_SLOTS.index("@label")

RAYS_IN_ALL = 300_000
"""Rays that measure what instances lead to, all together."""

_FEWEST = 4
"""Rays for each field of directions, at least: clusters that no rays are left for are not measured,
and recursion does not end there."""


class StatesTracer(StatesEngine):
    """Rays through the blocks of a graph whose states are finite in number.

    Parameters
    ----------
    blocks, models
        What is traced.
    walker
        Returns the walker, which answers what needs whole lists.
    threads
        Most threads of one call; by default one for each processor.
    may_shrink
        Returns whether a module's frame may be below rounding, where it is empty.
    suspended
        Where states are suspended: the blocks with room for them.
    """

    kernel: Any = find_batch

    def __init__(
        self,
        blocks: Blocks,
        models: ModelPool,
        walker: Callable[[], Walker],
        threads: int | None = None,
        may_shrink: Callable[[], bool] = lambda: True,
        suspended: SuspendedBlocks | None = None,
    ) -> None:
        super().__init__(blocks, models, walker, threads)
        self._find_shrunk = may_shrink
        self._extent = extent_of(self.blocks.box)
        self._suspended = suspended
        self._attributes, self._ref_boxes = blocks.attributes, blocks.ref_boxes
        if suspended is not None:
            self._trees, self._attributes = suspended.trees, suspended.attributes
            self._ref_boxes = suspended.endings.boxes

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of what rays read."""
        found = super().nbytes
        return found if self._suspended is None else {**found, "blocks": self._suspended.nbytes}

    @property
    def counts(self) -> dict[str, int]:
        """What the blocks consist of, and how often a suspended state has been expanded."""
        return {**super().counts, "expansions": self._expansions}

    @property
    def profile(self) -> dict[str, float]:
        """As for `StatesEngine`, and how many states a ray has expanded."""
        return {**super().profile, "expansions": self._expansions / max(1, self._rays)}

    @property
    def _expansions(self) -> int:
        return 0 if self._suspended is None else self._suspended.count(EXPANSIONS)

    def _find_hits(self, rays: Rays, footprint: Footprint | None) -> Hits:
        args = 0 if self._suspended is None else self._suspended.args
        found = make_found(len(rays.origins), args)
        answers = self._find(rays, FIRST, found, footprint)
        hits = FoundHits(found, self.blocks, self._pool)
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            hits.replace(walked, self.walker.find_surfaces(rays.take(walked)))
        return hits

    @cached_property
    def _may_shrink(self) -> bool:
        return self._find_shrunk()

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Find whether the solid contains points (N, 3)."""
        places = check_rays(check_points(points), (0.0, 0.0, 1.0), -math.inf, math.inf).origins
        if self._may_shrink:
            return self.walker.contains(places)
        answers = np.zeros(len(places), np.int8)

        def work(begin: int, end: int) -> None:
            root, extent = self.blocks.root, self._extent
            with self._working() as (scratch, _):
                contain_batch(
                    self._trees,
                    self._pool,
                    scratch,
                    make_matrices(),
                    root,
                    extent,
                    places,
                    begin,
                    end,
                    answers,
                )

        run_chunks(len(places), self.threads, work, self._pace)
        inside: NDArray[np.bool_] = answers == 1
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            inside[walked] = self.walker.contains(places[walked])
        return inside

    def spans(self, origins: ArrayLike, directions: ArrayLike) -> Spans:
        """Find all inside intervals of every ray, on the whole line."""
        rays = check_rays(origins, directions, -math.inf, math.inf)
        # Sheets are intervals of their own.
        if self._may_shrink or self.blocks.leaves[2::4].any():
            return self.walker.spans(rays.origins, rays.directions)
        which = np.arange(len(rays.origins))
        parts = [
            self._span(rays, which[k : k + _SPANNED], *ROOMS)
            for k in range(0, len(which), _SPANNED)
        ]
        return join_spans(len(which), parts)

    def _span(self, rays: Rays, which: NDArray[np.int64], room: int, *rooms: int) -> list[RaySpans]:
        """Return the intervals of some rays, with room for so many of each, or else for more."""
        n = len(which)
        origins, directions = rays.origins[which], rays.directions[which]
        counts = np.zeros(n, np.int64)
        ends = np.zeros((n, 2 * room))
        records = np.zeros((n, 2 * room), np.int32)

        def work(begin: int, end: int) -> None:
            with self._working() as (scratch, _):
                span_batch(
                    self._trees,
                    self._pool,
                    scratch,
                    self.blocks.root,
                    self._extent,
                    self.blocks.box,
                    origins,
                    directions,
                    begin,
                    end,
                    room,
                    counts,
                    ends.reshape(-1),
                    records.reshape(-1),
                )

        run_chunks(n, self.threads, work, self._pace)
        used = np.arange(2 * room) < counts[:, None]
        leaf = self.blocks.find_nodes(records[used])
        table = self.blocks.attributes.reshape(-1, len(ATTRIBUTE_DEFAULTS))
        label = table[records[used], _LABEL].astype(np.int64)
        rows = np.repeat(which, np.maximum(counts, 0) // 2)
        t = ends[used]
        found = [RaySpans(rows, t[::2], t[1::2], leaf[::2], leaf[1::2], label[::2], label[1::2])]
        if rooms:
            more, most = which[counts == FULL], _SPANNED * ROOMS[0] // rooms[0]
            for k in range(0, len(more), most):
                found += self._span(rays, more[k : k + most], *rooms)
        walked = which[(counts == UNDECIDED) | ((counts == FULL) & (not rooms))]
        if len(walked):
            theirs = self.walker.spans(rays.origins[walked], rays.directions[walked])
            rows = np.repeat(walked, np.diff(theirs.offsets))
            found.append(RaySpans(rows, *(getattr(theirs, f) for f in RaySpans._fields[1:])))
        return found

    def _find(
        self, rays: Rays, want: int, out: Any, footprint: Footprint | None
    ) -> NDArray[np.int8]:
        found = None if footprint is None else self._ends
        ends, limits = (None, None) if found is None else found
        return self._cast(rays, want, out, footprint, ends, self.blocks.root, self._extent, limits)

    def _cast(
        self,
        rays: Rays,
        want: int,
        out: Found | None,
        footprint: Footprint | None,
        ends: Ends | None,
        root: int,
        extent: Extent,
        limits: _Limits | None,
    ) -> NDArray[np.int8]:
        """Cast rays from a block on, in the frame of its group."""
        n = len(rays.origins)
        answers = np.empty(n, np.int8)

        def work(begin: int, end: int) -> None:
            with self._working() as (scratch, space):
                cut = None
                if ends is not None and limits is not None:
                    cut = Cut(ends.cover, ends.of_place, self._ref_boxes, *limits, *space)
                status = find_batch(
                    self._trees,
                    self._pool,
                    scratch,
                    root,
                    extent,
                    want,
                    cut,
                    NO_FOOTPRINT if footprint is None else footprint,
                    *rays,
                    begin,
                    end,
                    _NOWHERE if out is None else out,
                    answers,
                    self._attributes,
                )
            if status == BAD_RAY:
                check_values(rays)

        run_chunks(n, self.threads, work, self._pace)
        return answers

    @contextmanager
    def _working(self) -> Iterator[tuple[Scratch, Space]]:
        """Provide what one thread works with."""
        if self._suspended is None:
            if not hasattr(self._local, "own"):
                self._local.own = make_scratch(), make_space()
                self._remember(self._local.own[0])
            yield self._local.own
            return
        own, is_new = self._suspended.take()
        if is_new:
            self._remember(own.scratch)
        try:
            yield own.scratch, own.space
        finally:
            self._suspended.give_back(own)

    @property
    def _ends(self) -> tuple[Ends, _Limits] | None:
        with self._lock_of_ends:
            return self._measured

    @cached_property
    def _measured(self) -> tuple[Ends, _Limits] | None:
        """Measure what instances lead to, and suspended states; None where there is none.

        Hierarchies of what is flattened end within a block or two of a pixel anyway.
        """
        blocks, suspended = self.blocks, self._suspended
        instances = _different(blocks.refs[(blocks.refs & 7) == INSTANCE] >> 3)
        if len(instances) == 0 and (suspended is None or suspended.n_suspended == 0):
            return None
        below = blocks.targets[instances]
        of_place = np.full(len(blocks.targets), NEVER, np.int32)
        uses = np.bincount(below)
        kinds = 0 if suspended is None else len(suspended.examples)
        # What stands in most places comes first, if there is too much of it.
        most = min(RAYS_IN_ALL // (BINS * _FEWEST) - kinds, (uses > 0).sum())
        targets = sorted(np.argsort(-uses, kind="stable")[:most])
        per_bin = min(RAYS_IN_ALL // (BINS * max(1, len(targets) + kinds)), RAYS_PER_BIN)
        collected: list[Collected] = []
        for target in targets:
            box = _box_of(blocks, target)
            if np.isfinite(box).all() and (box[:3] <= box[3:]).all():
                of_place[instances[below == target]] = len(collected)
                collected.append(measure(box, self._sampler(target, box), int(target), per_bin))
        if suspended is None:
            return Ends(gather_coverage(collected), of_place), _limit(blocks, of_place)
        self._measure_suspended(suspended, collected, per_bin)
        limits = _limit(blocks, of_place)
        endings, n = suspended.endings, len(of_place)
        endings.of_reference[:n] = of_place
        endings.sizes[: 3 * n] = limits.sizes
        suspended.goes_on[:n] = limits.goes_on
        suspended.note_endings()
        ends = Ends(gather_coverage(collected), endings.of_reference)
        return ends, _Limits(endings.sizes, suspended.goes_on)

    def _measure_suspended(
        self, suspended: SuspendedBlocks, collected: list[Collected], per_bin: int
    ) -> None:
        """Measure suspended states of every kind."""
        for entry, records in suspended.examples.items():
            found: list[Found] = []
            parts: list[Collected] = []
            each = max(1, per_bin // len(records))
            for record in records:
                block, box = suspended.place_example(record)
                cast = self._sampler(np.intp(block), box, found)
                parts.append(measure(box, cast, record, each))
            mean = average(parts)
            kept = suspended.keep_records(found, mean.leaves)
            suspended.name_entry(entry, len(collected))
            collected.append(mean._replace(leaves=kept))

    def _sampler(
        self, target: np.intp, box: Floats, kept: list[Found] | None = None
    ) -> Callable[[Floats, Floats], Sampled]:
        """Return what casts rays through a group, all of it.

        Parameters
        ----------
        kept
            Receives what is found, where hits have leaf records of their own; then leaves are
            numbers of rays, those of a batch behind those of the batches before.
        """
        extent = extent_of(box.reshape(2, 3))

        # Nothing ends here, but the kernel is the one that pictures need anyway.
        rows = len(self._ref_boxes) // 6
        nowhere = np.full(rows, NEVER, np.int32)
        ends = Ends(gather_coverage([]), nowhere)
        limits = _Limits(np.full(3 * rows, np.inf), np.zeros(rows, np.bool_))

        def cast(origins: Floats, directions: Floats) -> Sampled:
            n = len(origins)
            wide = Footprint(np.zeros(n), np.zeros(n))
            out = make_found(n, 0 if self._suspended is None else self._suspended.args)
            rays = shape_rays(origins, directions, 0.0, math.inf)
            answers = self._cast(rays, FIRST, out, wide, ends, int(target), extent, limits)
            leaves = out.record.astype(np.int64)
            if kept is not None:
                leaves += n * len(kept)
                kept.append(out)
            return Sampled(answers == HIT, out.normal, leaves)

        return cast


def trace_states(
    graph: Graph,
    states: StateGraph,
    walker: Callable[[], Walker],
    threads: int | None = None,
) -> StatesTracer:
    """Return the tracer of a finite acyclic state graph."""
    models = pool_of(graph)
    blocks = build_blocks(graph, states, models)
    return StatesTracer(blocks, models, walker, threads, lambda: may_shrink(states))


class _Limits(NamedTuple):
    """`Cut.sizes` and `Cut.goes_on`."""

    sizes: Floats
    goes_on: NDArray[np.bool_]


def _limit(blocks: Blocks, of_place: NDArray[np.int32]) -> _Limits:
    """Return below which sizes recursion ends, and where it may end farther down."""
    never = of_place == NEVER
    sides = blocks.ref_boxes.reshape(-1, 2, 3).astype(np.float64)
    sizes = np.where(never[:, None], np.inf, np.square(sides[:, 1] - sides[:, 0]))
    planes = blocks.boxes.reshape(-1, 6, WIDTH)
    codes = blocks.refs.reshape(-1, WIDTH)
    kinds = np.where(planes[:, 0] <= planes[:, 3], codes & 7, -1)
    instances, suspended = kinds == INSTANCE, kinds == SUSPENDED
    number = np.where(instances | suspended, codes >> 3, 0)
    goes_on = np.zeros(len(never), dtype=bool)
    goes_on[number[suspended]] = True
    outer, slots = np.nonzero(kinds == BLOCK)
    inner = codes[outer, slots] >> 3
    while True:
        may_end = ((instances | suspended) & (~never | goes_on)[number]).any(axis=1)
        known = -1
        while known < (known := int(may_end.sum())):
            np.logical_or.at(may_end, outer, may_end[inner])
        before = goes_on.copy()
        goes_on[number[instances]] = may_end[blocks.targets[number[instances]]]
        if (goes_on == before).all():
            return _Limits(sizes.ravel(), goes_on)


def _different(numbers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return which numbers there are, as `numpy.unique`, which takes 20 ms to be loaded."""
    return np.flatnonzero(np.bincount(numbers))


def _box_of(blocks: Blocks, block: int) -> Floats:
    """Return the box of a group, from the boxes of its first block."""
    planes = blocks.boxes[6 * WIDTH * block : 6 * WIDTH * (block + 1)].reshape(6, WIDTH)
    return np.concatenate([planes[:3].min(axis=1), planes[3:].max(axis=1)]).astype(np.float64)


_NOWHERE = make_found(0)
