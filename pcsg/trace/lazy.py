"""The engine of lazy states: what is unrolled as far as memory allows, and made on demand below."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.bounds import hyper_boxes
from pcsg.graph.code import invert_affine
from pcsg.graph.graph import GLOBALS
from pcsg.graph.ordering import successors_first
from pcsg.graph.recipes import Recipes
from pcsg.graph.unroll import enumerate_states
from pcsg.jit import plain
from pcsg.leaf.registry import FIRST
from pcsg.slabs import WIDTH
from pcsg.trace.blocks import build_fixtures
from pcsg.trace.bounding import evaluate_sides
from pcsg.trace.coverage import (
    EXAMPLES,
    FINENESS,
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
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.hits import Hits
from pcsg.trace.lazy_batch import find_batch_lazy
from pcsg.trace.lazy_kernel import STAND_IN, LazyCut, LazyScratch, make_lazy_scratch
from pcsg.trace.pool import pool_of
from pcsg.trace.precision import Extent, extent_of
from pcsg.trace.rays import Rays, check_rays, check_values, run_chunks
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
from pcsg.trace.states_engine import StatesEngine
from pcsg.trace.store import BLOCK_MEMORY, build_store
from pcsg.trace.surface import Surface, make_surface
from pcsg.trace.traversal import HIT, UNDECIDED
from pcsg.trace.walker import Walker
from pcsg.vec import Affine

Floats = NDArray[np.float64]


class LazyTracer(StatesEngine):
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
    box : float64 (6,), optional
        The scene's hyper-bounding box; computed if not given.
    """

    kernel: Any = find_batch_lazy

    def __init__(
        self,
        recipes: Recipes,
        values: Mapping[str, float] = GLOBALS,
        *,
        walker: Callable[[], Walker],
        threads: int | None = None,
        block_memory: int = BLOCK_MEMORY,
        box: NDArray[np.float64] | None = None,
    ) -> None:
        models = pool_of(recipes.graph)
        states = enumerate_states(recipes.graph, values, starts=recipes.fixtures)
        blocks, fixtures = build_fixtures(recipes.graph, states, models)
        super().__init__(blocks, models, walker, threads)
        self.recipes = recipes
        if box is None:
            graph = recipes.graph
            box = hyper_boxes(graph, values).boxes[graph.number[graph.root]]
        self._extent = extent_of(box.reshape(2, 3))
        self.store = build_store(write_rulebook(recipes, fixtures), block_memory)
        self._made: list[Lazy] = []

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of what rays read."""
        return {**super().nbytes, "store": self.store.nbytes}

    @property
    def counts(self) -> dict[str, int]:
        """Number of blocks, of states in the store, and of those that were made on demand."""
        slots = self.store.slots
        return {
            "blocks": self.blocks.n_blocks + len(slots.refs) // WIDTH,
            "stored_states": len(slots.heads) // HEAD - 1,
            "expansions": self._expansions,
        }

    @property
    def _expansions(self) -> int:
        with self._lock:
            return sum(int(lazy.counts[1]) for lazy in self._made)

    @property
    def profile(self) -> dict[str, float]:
        """As for `StatesEngine`, and how many states a ray has made on demand."""
        return {**super().profile, "expansions": self._expansions / max(1, self._rays)}

    def _find_hits(self, rays: Rays, footprint: Footprint | None) -> Hits:
        surface = make_surface(len(rays.origins))
        answers = self._find(rays, FIRST, surface, footprint)
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            surface.put(walked, self.walker.find_surfaces(rays.take(walked)))
        return surface.hits()

    def _find(
        self, rays: Rays, want: int, out: Any, footprint: Footprint | None
    ) -> NDArray[np.int8]:
        check_values(rays)
        ends = self._ends if footprint is not None else None
        return self._cast(rays, want, out, footprint, ends, 0, self._extent)

    def _cast(
        self,
        rays: Rays,
        want: int,
        surface: Surface | None,
        footprint: Footprint | None,
        ends: Ends | None,
        start: int,
        extent: Extent,
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
                extent,
                want,
                None if ends is None else LazyCut(ends.cover, ends.of_place, *space),
                NO_FOOTPRINT if footprint is None else footprint,
                *rays,
                begin,
                end,
                _NO_SURFACE if surface is None else surface,
                found,
            )

        run_chunks(n, self.threads, work, self._pace)
        return found

    def _own(self) -> tuple[Lazy, LazyScratch, Space]:
        if not hasattr(self._local, "own"):
            lazy = self.store.make_lazy()
            scratch = make_lazy_scratch()
            self._local.own = lazy, scratch, make_space()
            self._remember(scratch.outer, scratch.inner)
            with self._lock:
                self._made.append(lazy)
        own: tuple[Lazy, LazyScratch, Space] = self._local.own
        return own

    @cached_property
    def _measured(self) -> Ends:
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
            ends = Ends(gather_coverage(collected), of_entry)
            found = [self._measure(int(item), entry, ends) for item in chosen]
            if any(c is None for c in found):
                continue
            of_entry[entry] = len(collected)
            collected.append(average([c for c in found if c is not None]))
        return Ends(gather_coverage(collected), of_entry)

    @property
    def _ends(self) -> Ends:
        with self._lock_of_ends:
            return self._measured

    def _measure(self, item: int, entry: int, ends: Ends) -> Collected | None:
        """Measure the state of an item; None where it has no bounds."""
        book, slots = self.store.book, self.store.slots
        box = np.zeros(6)
        sides = book.entries[ENTRY_FIELDS * entry + E_SIDES]
        plain(evaluate_sides)(book.shapes, sides, slots.values, book.n_values * item, box)
        if not np.isfinite(box).all() or (box[:3] > box[3:]).any():
            return None
        inverse = Affine(*slots.inverses[12 * item : 12 * item + 12])
        forward = np.array(invert_affine(inverse)[0]).reshape(3, 4)
        ends_of_box = np.array([forward[:, :3] @ box[:3], forward[:, :3] @ box[3:]])
        extent = extent_of(np.sort(ends_of_box + forward[:, 3], axis=0))
        rows = np.linalg.norm(np.array(inverse).reshape(3, 4)[:, :3], axis=1)
        size = float(np.linalg.norm((box[3:] - box[:3]) / rows))

        def cast(origins: Floats, directions: Floats) -> Sampled:
            n = len(origins)
            turned = directions @ forward[:, :3].T
            rays = check_rays(origins @ forward[:, :3].T + forward[:, 3], turned, 0.0, math.inf)
            surface = make_surface(n)
            footprint = Footprint(np.full(n, FINENESS * size), np.zeros(n))
            found = self._cast(rays, FIRST, surface, footprint, ends, item, extent)
            normals = surface.normal @ forward[:, :3]
            length = np.linalg.norm(normals, axis=1)
            normals /= np.where(length > 0.0, length, 1.0)[:, None]
            return Sampled(found == HIT, normals, surface.attributes, surface.leaf)

        return measure(box, cast, item, RAYS_PER_BIN // EXAMPLES)


_NO_SURFACE = make_surface(0)
