"""The engines behind one interface, and the choice between them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.states import StateGraph
from pcsg.leaf.registry import ANY, FIRST, Pool
from pcsg.trace.blocks import Blocks, build_blocks
from pcsg.trace.blocks_batch import BAD_RAY, find_batch
from pcsg.trace.found import Found, FoundHits, make_found
from pcsg.trace.hits import Hits, Spans
from pcsg.trace.kernel import Extent
from pcsg.trace.pool import pool_of
from pcsg.trace.rays import Rays, check_values, count_processors, run_chunks, shape_rays
from pcsg.trace.traversal import HIT, UNDECIDED, Scratch, Trees, make_scratch
from pcsg.trace.walker import Walker
from pcsg.vec import Vec3

Engine = Literal["auto", "cyclic", "states"]
"""``cyclic`` walks the graph itself, ``states`` its unrolled states; ``auto`` takes the states
where they are finite in number."""


class StatesTracer:
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

    def __init__(
        self,
        graph: Graph,
        states: StateGraph,
        walker: Callable[[], Walker],
        threads: int | None = None,
    ) -> None:
        self._models = pool_of(graph)
        self.blocks: Blocks = build_blocks(graph, states, self._models)
        self.threads = threads or count_processors()
        self._make_walker = walker
        self._lock = threading.Lock()
        self._trees = Trees(*(getattr(self.blocks, name) for name in Trees._fields))
        self._extent = _extent_of(self.blocks.box)
        self._pool: Pool = self._models.pool
        self._local = threading.local()

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of what rays read."""
        return {"blocks": self.blocks.nbytes, **self._models.nbytes}

    @property
    def counts(self) -> dict[str, int]:
        """Number of blocks."""
        return {"blocks": self.blocks.n_blocks}

    @cached_property
    def _lists(self) -> Walker:
        return self._make_walker()

    @property
    def walker(self) -> Walker:
        """The walker, made when it is first needed."""
        with self._lock:
            return self._lists

    def intersect(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> Hits:
        """Find the first crossing of every ray, as `Walker.intersect`."""
        rays = shape_rays(origins, directions, t_min, t_max)
        found = make_found(len(rays.origins))
        answers = self._find(rays, FIRST, found)
        hits = FoundHits(found, self.blocks, self._pool)
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            hits.replace(walked, self.walker.find_surfaces(rays.take(walked)))
        return hits

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything, as `Walker.occluded`."""
        rays = shape_rays(origins, directions, t_min, t_max)
        answers = self._find(rays, ANY, _NOWHERE)
        out: NDArray[np.bool_] = answers == HIT
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            out[walked] = self.walker.find_occlusion(rays.take(walked))
        return out

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Find whether the solid contains points (N, 3)."""
        return self.walker.contains(points)

    def spans(self, origins: ArrayLike, directions: ArrayLike) -> Spans:
        """Find all inside intervals of every ray, on the whole line."""
        return self.walker.spans(origins, directions)

    def _find(self, rays: Rays, want: int, found: Found) -> NDArray[np.int8]:
        n = len(rays.origins)
        answers = np.empty(n, np.int8)

        def work(begin: int, end: int) -> None:
            status = find_batch(
                self._trees,
                self._pool,
                self._scratch(),
                self.blocks.root,
                self._extent,
                want,
                *rays,
                begin,
                end,
                found,
                answers,
            )
            if status == BAD_RAY:
                check_values(rays)

        run_chunks(n, self.threads, work)
        return answers

    def _scratch(self) -> Scratch:
        if not hasattr(self._local, "scratch"):
            self._local.scratch = make_scratch()
        scratch: Scratch = self._local.scratch
        return scratch


def _extent_of(box: NDArray[np.float64]) -> Extent:
    """Return where a box is; it may be infinite."""
    finite = np.where(np.isfinite(box), box, 0.0)
    middle = Vec3(*(float(x) for x in finite.mean(axis=0)))
    return Extent(middle, 1000.0 * float(np.abs(finite).max()))


_NOWHERE = make_found(0)
