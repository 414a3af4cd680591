"""What the tracers of the engine of states have in common."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.leaf.registry import ANY, Pool
from pcsg.trace.blocks import Blocks
from pcsg.trace.coverage import Footprint
from pcsg.trace.hits import Crossings, Hits
from pcsg.trace.pool import ModelPool
from pcsg.trace.rays import Pace, Rays, count_processors, shape_rays
from pcsg.trace.traversal import HIT, MISS, UNDECIDED, VISITS, Scratch, Trees
from pcsg.trace.walker import Walker


class StatesEngine:
    """Rays through states; what needs whole lists is left to a walker.

    Parameters
    ----------
    blocks, models
        What is traced.
    walker
        Returns the walker.
    threads
        Most threads of one call; by default one for each processor.
    """

    takes_footprints = True

    kernel: Any
    """The compiled entry."""

    def __init__(
        self,
        blocks: Blocks,
        models: ModelPool,
        walker: Callable[[], Walker],
        threads: int | None,
    ) -> None:
        self.blocks = blocks
        self.threads = threads or count_processors()
        self._models = models
        self._pool: Pool = models.pool
        self._trees = Trees(*(getattr(blocks, name) for name in Trees._fields))
        self._make_walker = walker
        self._lock = threading.Lock()
        self._lock_of_ends = threading.Lock()
        self._local = threading.local()
        self._pace = Pace()
        self._scratches: list[Scratch] = []
        self._rays = 0

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of what rays read."""
        return {"blocks": self.blocks.nbytes, **self._models.nbytes}

    @property
    def counts(self) -> dict[str, int]:
        """What the blocks consist of, see `Blocks.contents`."""
        return self.blocks.contents

    @property
    def profile(self) -> dict[str, float]:
        """Number of rays so far, and what one of them has visited on average.

        States that are opened on the way are instances, wherever they are kept.
        """
        with self._lock:
            visits = sum((s.frames[VISITS : VISITS + 3] for s in self._scratches), np.zeros(3))
        names = ("blocks", "instances", "leaves")
        per_ray = visits / max(1, self._rays)
        return {"rays": self._rays, **dict(zip(names, map(float, per_ray), strict=True))}

    def _remember(self, *scratches: Scratch) -> None:
        """Keep the working space of a thread, for the profile."""
        with self._lock:
            self._scratches += scratches

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
            How wide the rays are: what is smaller stops its share of them and is not looked into.
            Directions must be unit then.
        """
        rays = shape_rays(origins, directions, t_min, t_max)
        self._rays += len(rays.origins)
        return self._find_hits(rays, footprint)

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
        footprint: Footprint | None = None,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything; arguments as for `intersect`."""
        rays = shape_rays(origins, directions, t_min, t_max)
        self._rays += len(rays.origins)
        answers = self._find(rays, ANY, None, footprint)
        out: NDArray[np.bool_] = answers == HIT
        walked = np.flatnonzero(answers == UNDECIDED)
        if len(walked):
            out[walked] = self.walker.find_occlusion(rays.take(walked))
        return out

    def find_crossings(self, rays: Rays) -> Crossings:
        """Find all crossings of checked rays; only those that meet something are walked."""
        met = np.flatnonzero(self._find(rays, ANY, None, None) != MISS)
        found = self.walker.find_crossings(rays.take(met))
        counts = np.zeros(len(rays.origins), np.int64)
        counts[met] = np.diff(found.offsets)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        return found.replaced(offsets=offsets, ray=met[found.ray])

    def _find_hits(self, rays: Rays, footprint: Footprint | None) -> Hits:
        """Return the first crossings."""
        raise NotImplementedError

    def _find(
        self, rays: Rays, want: int, out: Any, footprint: Footprint | None
    ) -> NDArray[np.int8]:
        """Return HIT, MISS or UNDECIDED for every ray; `out` receives the surfaces, if given."""
        raise NotImplementedError
