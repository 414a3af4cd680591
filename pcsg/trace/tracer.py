"""The engines behind one interface, and the choice between them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.states import StateGraph
from pcsg.leaf.registry import FIRST
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
    gather_coverage,
    make_space,
    measure,
)
from pcsg.trace.ends import NEVER
from pcsg.trace.found import Found, FoundHits, make_found
from pcsg.trace.groups import BLOCK, INSTANCE
from pcsg.trace.hits import Hits
from pcsg.trace.kernel import Cut
from pcsg.trace.pool import pool_of
from pcsg.trace.precision import Extent, extent_of
from pcsg.trace.rays import Rays, check_values, run_chunks, shape_rays
from pcsg.trace.simd import WIDTH
from pcsg.trace.states_engine import StatesEngine
from pcsg.trace.traversal import HIT, UNDECIDED, Scratch, make_scratch
from pcsg.trace.walker import Walker

Engine = Literal["auto", "cyclic", "states"]
"""``cyclic`` walks the graph itself, ``states`` its unrolled states; ``auto`` takes the states
where they are finite in number."""


Floats = NDArray[np.float64]

RAYS_IN_ALL = 300_000
"""Rays that measure what instances lead to, all together."""


class StatesTracer(StatesEngine):
    """Rays through the blocks of a graph whose states are finite in number.

    Parameters
    ----------
    graph, states
        What is traced.
    walker
        Returns the walker, which answers what needs whole lists.
    threads
        Most threads of one call; by default one for each processor.
    """

    kernel: Any = find_batch

    def __init__(
        self,
        graph: Graph,
        states: StateGraph,
        walker: Callable[[], Walker],
        threads: int | None = None,
    ) -> None:
        models = pool_of(graph)
        super().__init__(build_blocks(graph, states, models), models, walker, threads)
        self._extent = extent_of(self.blocks.box)

    def _find_hits(self, rays: Rays, footprint: Footprint | None) -> Hits:
        found = make_found(len(rays.origins))
        answers = self._find(rays, FIRST, found, footprint)
        hits = FoundHits(found, self.blocks, self._pool)
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            hits.replace(walked, self.walker.find_surfaces(rays.take(walked)))
        return hits

    def _find(
        self, rays: Rays, want: int, out: Any, footprint: Footprint | None
    ) -> NDArray[np.int8]:
        ends, limits = self._ends if footprint is not None else (None, None)
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
            scratch, space = self._own()
            cut = None
            if ends is not None and limits is not None:
                cut = Cut(ends.cover, ends.of_place, self.blocks.ref_boxes, *limits, *space)
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
            )
            if status == BAD_RAY:
                check_values(rays)

        run_chunks(n, self.threads, work, self._pace)
        return answers

    def _own(self) -> tuple[Scratch, Space]:
        if not hasattr(self._local, "own"):
            self._local.own = make_scratch(), make_space()
            self._remember(self._local.own[0])
        own: tuple[Scratch, Space] = self._local.own
        return own

    @property
    def _ends(self) -> tuple[Ends, _Limits]:
        with self._lock_of_ends:
            return self._measured

    @cached_property
    def _measured(self) -> tuple[Ends, _Limits]:
        """Measure what instances lead to."""
        blocks = self.blocks
        kinds = blocks.refs & 7
        instances = _different(blocks.refs[kinds == INSTANCE] >> 3)
        below = blocks.targets[instances]
        of_place = np.full(len(blocks.targets), NEVER, np.int32)
        targets = _different(below).tolist()
        per_bin = int(np.clip(RAYS_IN_ALL // (BINS * max(1, len(targets))), 4, RAYS_PER_BIN))
        collected: list[Collected] = []
        for target in targets:
            box = _box_of(blocks, target)
            if np.isfinite(box).all() and (box[:3] <= box[3:]).all():
                of_place[instances[below == target]] = len(collected)
                collected.append(measure(box, self._sampler(target, box), target, per_bin))
        return Ends(gather_coverage(collected), of_place), _limit(blocks, of_place)

    def _sampler(self, target: int, box: Floats) -> Callable[[Floats, Floats], Sampled]:
        """Return what casts rays through a group, all of it."""
        extent = extent_of(box.reshape(2, 3))

        # Nothing ends here, but the kernel is the one that pictures need anyway.
        nowhere = np.full(len(self.blocks.targets), NEVER, np.int32)
        ends, limits = Ends(gather_coverage([]), nowhere), _limit(self.blocks, nowhere)

        def cast(origins: Floats, directions: Floats) -> Sampled:
            n = len(origins)
            wide = Footprint(np.zeros(n), np.zeros(n))
            out = make_found(n)
            rays = shape_rays(origins, directions, 0.0, math.inf)
            answers = self._cast(rays, FIRST, out, wide, ends, target, extent, limits)
            return Sampled(
                answers == HIT, out.normal, np.zeros((n, 0)), out.record.astype(np.int64)
            )

        return cast


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
    instances = kinds == INSTANCE
    number = np.where(instances, codes >> 3, 0)
    goes_on = np.zeros(len(never), dtype=bool)
    while True:
        may_end = (instances & (~never | goes_on)[number]).any(axis=1)
        # What a block leads to within its group has the larger number.
        for block in reversed(range(len(codes))):
            may_end[block] |= may_end[codes[block, kinds[block] == BLOCK] >> 3].any()
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
