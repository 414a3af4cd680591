"""The engine of lazy states: what is unrolled as far as memory allows, and made on demand below."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.graph.code import invert_affine
from pcsg.graph.graph import GLOBALS
from pcsg.graph.liveness import successors_first
from pcsg.graph.recipes import Recipes
from pcsg.graph.states import enumerate_states
from pcsg.jit import plain
from pcsg.leaf.registry import ANY, FIRST, Pool
from pcsg.simd import WIDTH
from pcsg.trace.blocks import Blocks, build_fixtures
from pcsg.trace.bounding import evaluate_sides
from pcsg.trace.coverage import (
    EXAMPLES,
    FINENESS,
    RAYS_PER_BIN,
    Collected,
    Coverage,
    Footprint,
    Sampled,
    average,
    gather_coverage,
    measure,
)
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.hits import Hits, Spans
from pcsg.trace.lazy_batch import find_batch_lazy
from pcsg.trace.lazy_kernel import NEVER, STAND_IN, LazyCut, LazyScratch, make_lazy_scratch
from pcsg.trace.pool import pool_of
from pcsg.trace.rays import Rays, check_rays, count_processors, run_chunks
from pcsg.trace.rulebook import (
    E_SIDES,
    E_STAND_IN,
    ENTRY,
    ENTRY_FIELDS,
    P_KIND,
    P_TARGET,
    PART_FIELDS,
    write_rulebook,
)
from pcsg.trace.slots import HEAD, Lazy
from pcsg.trace.store import BLOCK_MEMORY, build_store
from pcsg.trace.surface import Surface, make_surface
from pcsg.trace.traversal import HIT, MAX_DEPTH, UNDECIDED, Trees
from pcsg.trace.walker import Walker
from pcsg.vec import Affine

Floats = NDArray[np.float64]


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
        self.recipes = recipes
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
        self._lock_of_ends = threading.Lock()
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
        footprint: Footprint | None = None,
    ) -> Hits:
        """Find the first crossing of every ray, as `Walker.intersect`.

        Parameters
        ----------
        footprint
            How wide the rays are: what is smaller only stops its share of them. Directions must
            be unit then.
        """
        rays = check_rays(origins, directions, t_min, t_max)
        surface = make_surface(len(rays.origins))
        found = self._find(rays, FIRST, surface, footprint)
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
        footprint: Footprint | None = None,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything; arguments as for `intersect`."""
        rays = check_rays(origins, directions, t_min, t_max)
        found = self._find(rays, ANY, _NO_SURFACE, footprint)
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

    def _find(
        self, rays: Rays, want: int, surface: Surface, footprint: Footprint | None
    ) -> NDArray[np.int8]:
        ends = self._ends if footprint is not None else None
        return self._cast(rays, want, surface, footprint, ends, 0)

    def _cast(
        self,
        rays: Rays,
        want: int,
        surface: Surface,
        footprint: Footprint | None,
        ends: _Ends | None,
        start: int,
    ) -> NDArray[np.int8]:
        """Cast rays from an item on, in the frame of its slot."""
        n = len(rays.origins)
        found = np.zeros(n, np.int8)

        def work(begin: int, end: int) -> None:
            lazy, scratch, space = self._own()
            find_batch_lazy(
                lazy,
                self._trees,
                self._pool,
                scratch,
                self.blocks.attributes,
                start,
                want,
                None if ends is None else LazyCut(ends.cover, ends.of_entry, *space),
                _NO_FOOTPRINT if footprint is None else footprint,
                *rays,
                begin,
                end,
                surface,
                found,
            )

        run_chunks(n, self.threads, work)
        return found

    def _own(self) -> tuple[Lazy, LazyScratch, tuple[Floats, Floats, Floats]]:
        if not hasattr(self._local, "own"):
            lazy = self.store.make_lazy()
            space = np.zeros(12 * MAX_DEPTH + 12), np.zeros(8), np.zeros(6)
            self._local.own = lazy, make_lazy_scratch(), space
            with self._lock:
                self._made.append(lazy)
        own: tuple[Lazy, LazyScratch, tuple[Floats, Floats, Floats]] = self._local.own
        return own

    @cached_property
    def _measured(self) -> _Ends:
        """Measure the entries, each after those that it leads to."""
        book, slots = self.store.book, self.store.slots
        entries = book.entries.reshape(-1, ENTRY_FIELDS)
        of_entry = np.where(entries[:, E_STAND_IN] >= 0, STAND_IN, NEVER).astype(np.int32)
        kept = np.flatnonzero((slots.refs & 7) == SUSPENDED)
        parts = book.parts.reshape(-1, PART_FIELDS)[slots.parts[kept]]
        collected: list[Collected] = []
        for entry in successors_first(self.recipes.successors):
            items = kept[(parts[:, P_KIND] == ENTRY) & (parts[:, P_TARGET] == entry)]
            if of_entry[entry] == STAND_IN or len(items) == 0:
                continue
            chosen = items[np.linspace(0, len(items) - 1, min(len(items), EXAMPLES)).astype(int)]
            ends = _Ends(gather_coverage(collected), of_entry)
            found = [self._measure(int(item), entry, ends) for item in chosen]
            if any(c is None for c in found):
                continue
            of_entry[entry] = len(collected)
            collected.append(average([c for c in found if c is not None]))
        return _Ends(gather_coverage(collected), of_entry)

    @property
    def _ends(self) -> _Ends:
        with self._lock_of_ends:
            return self._measured

    def _measure(self, item: int, entry: int, ends: _Ends) -> Collected | None:
        """Measure the state of an item; None where it has no bounds."""
        book, slots = self.store.book, self.store.slots
        box = np.zeros(6)
        sides = book.entries[ENTRY_FIELDS * entry + E_SIDES]
        plain(evaluate_sides)(book.shapes, sides, slots.values, book.n_values * item, box)
        if not np.isfinite(box).all() or (box[:3] > box[3:]).any():
            return None
        inverse = Affine(*slots.inverses[12 * item : 12 * item + 12])
        forward = np.array(invert_affine(inverse)[0]).reshape(3, 4)
        rows = np.linalg.norm(np.array(inverse).reshape(3, 4)[:, :3], axis=1)
        size = float(np.linalg.norm((box[3:] - box[:3]) / rows))

        def cast(origins: Floats, directions: Floats) -> Sampled:
            n = len(origins)
            turned = directions @ forward[:, :3].T
            rays = check_rays(origins @ forward[:, :3].T + forward[:, 3], turned, 0.0, math.inf)
            surface = make_surface(n)
            footprint = Footprint(np.full(n, FINENESS * size), np.zeros(n))
            found = self._cast(rays, FIRST, surface, footprint, ends, item)
            normals = surface.normal @ forward[:, :3]
            length = np.linalg.norm(normals, axis=1)
            normals /= np.where(length > 0.0, length, 1.0)[:, None]
            return Sampled(found == HIT, normals, surface.attributes, surface.leaf)

        return measure(box, cast, item, RAYS_PER_BIN // EXAMPLES)


class _Ends(NamedTuple):
    """Where recursion ends: what entries look like from afar, and which of it an entry has."""

    cover: Coverage
    of_entry: NDArray[np.int32]


_NO_FOOTPRINT = Footprint(np.zeros(0), np.zeros(0))
_NO_SURFACE = make_surface(0)
