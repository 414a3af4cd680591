"""The engine of lazy states: what is unrolled as far as memory allows, and made on demand below."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.graph.graph import GLOBALS
from pcsg.graph.recipes import Recipes
from pcsg.graph.states import enumerate_states
from pcsg.leaf.registry import ANY, FIRST, Pool
from pcsg.simd import WIDTH
from pcsg.trace.blocks import Blocks, build_fixtures
from pcsg.trace.hits import Hits, Spans
from pcsg.trace.lazy_batch import find_batch_lazy
from pcsg.trace.lazy_kernel import LazyScratch, make_lazy_scratch
from pcsg.trace.pool import pool_of
from pcsg.trace.rays import Rays, check_rays, count_processors, run_chunks
from pcsg.trace.rulebook import write_rulebook
from pcsg.trace.slots import HEAD, Lazy
from pcsg.trace.store import BLOCK_MEMORY, build_store
from pcsg.trace.surface import Surface, make_surface
from pcsg.trace.traversal import HIT, UNDECIDED, Trees
from pcsg.trace.walker import Walker


class LazyTracer:
    """Rays through the states of a graph that has too many of them.

    Parameters
    ----------
    recipes
        How states are made.
    values
        Values of the global parameters.
    walker
        Returns the walker, which answers what needs whole lists.
    threads
        Most threads of one call; by default one for each processor.
    block_memory
        Bytes of the states that are made beforehand; results do not depend on it.
    """

    def __init__(
        self,
        recipes: Recipes,
        values: Mapping[str, float] = GLOBALS,
        *,
        walker: Callable[[], Walker],
        threads: int | None = None,
        block_memory: int = BLOCK_MEMORY,
    ) -> None:
        states = enumerate_states(recipes.graph, values, starts=recipes.fixtures)
        self.blocks: Blocks
        self._models = pool_of(recipes.graph)
        self.blocks, fixtures = build_fixtures(recipes.graph, states, self._models)
        self.store = build_store(write_rulebook(recipes, fixtures), block_memory)
        self.threads = threads or count_processors()
        self._make_walker = walker
        self._lock = threading.Lock()
        self._trees = Trees(*(getattr(self.blocks, name) for name in Trees._fields))
        self._pool: Pool = self._models.pool
        self._local = threading.local()
        self._made: list[Lazy] = []

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of what rays read."""
        return {"blocks": self.blocks.nbytes, "store": self.store.nbytes, **self._models.nbytes}

    @property
    def counts(self) -> dict[str, int]:
        """Number of blocks, of states in the store, and of those that were made on demand."""
        with self._lock:
            made = sum(int(lazy.counts[1]) for lazy in self._made)
        slots = self.store.slots
        return {
            "blocks": self.blocks.n_blocks + len(slots.refs) // WIDTH,
            "stored_states": len(slots.heads) // HEAD - 1,
            "expansions": made,
        }

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
        rays = check_rays(origins, directions, t_min, t_max)
        surface = make_surface(len(rays.origins))
        found = self._find(rays, FIRST, surface)
        walked = np.flatnonzero(found == UNDECIDED)
        if len(walked):
            surface.put(walked, self.walker.find_surfaces(rays.take(walked)))
        return surface.hits()

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything, as `Walker.occluded`."""
        rays = check_rays(origins, directions, t_min, t_max)
        found = self._find(rays, ANY, _NO_SURFACE)
        out: NDArray[np.bool_] = found == HIT
        walked = np.flatnonzero(found == UNDECIDED)
        if len(walked):
            out[walked] = self.walker.find_occlusion(rays.take(walked))
        return out

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Find whether the solid contains points (N, 3)."""
        return self.walker.contains(points)

    def spans(self, origins: ArrayLike, directions: ArrayLike) -> Spans:
        """Find all inside intervals of every ray, on the whole line."""
        return self.walker.spans(origins, directions)

    def _find(self, rays: Rays, want: int, surface: Surface) -> NDArray[np.int8]:
        n = len(rays.origins)
        found = np.zeros(n, np.int8)

        def work(begin: int, end: int) -> None:
            lazy, scratch = self._own()
            find_batch_lazy(
                lazy,
                self._trees,
                self._pool,
                scratch,
                self.blocks.attributes,
                want,
                *rays,
                begin,
                end,
                surface,
                found,
            )

        run_chunks(n, self.threads, work)
        return found

    def _own(self) -> tuple[Lazy, LazyScratch]:
        if not hasattr(self._local, "own"):
            lazy = self.store.make_lazy()
            self._local.own = lazy, make_lazy_scratch()
            with self._lock:
                self._made.append(lazy)
        own: tuple[Lazy, LazyScratch] = self._local.own
        return own


_NO_SURFACE = make_surface(0)
