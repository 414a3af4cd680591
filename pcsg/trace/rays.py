"""Batches of rays: checked arrays, and chunks of them over threads."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from operator import itemgetter
from threading import Event, Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array
from pcsg.errors import UsageError

CHUNK = 16_384
"""Rays that one of several threads takes at a time; fewer cost more for starting than they gain."""

LARGEST_CHUNK = 1 << 18
"""Rays that a single thread takes at a time."""

FIRST_CHUNK = 1_024
"""Rays in the first chunk, of which nothing is known yet."""

SMALLEST_CHUNK = 16
"""Rays in a chunk, however long they take."""

STEP = 16
"""By which factor a chunk is longer than the one before, at most."""

SECONDS = 0.2
"""That a chunk should take."""


class Rays(NamedTuple):
    """N checked rays.

    Attributes
    ----------
    origins, directions : float64 (N, 3)
    t_min, t_max : float64 (N,) or (1,)
        One serves for all.
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    t_min: NDArray[np.float64]
    t_max: NDArray[np.float64]

    def take(self, indices: NDArray[np.int64]) -> Rays:
        """Return some of the rays, each with its own limits."""
        n = len(self.origins)
        limits = (np.broadcast_to(a, (n,))[indices] for a in (self.t_min, self.t_max))
        return Rays(self.origins[indices], self.directions[indices], *limits)


def check_rays(
    origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike, t_max: ArrayLike
) -> Rays:
    """Return rays as kernels take them, each with its own limits.

    Parameters
    ----------
    origins, directions : array_like (N, 3)
        One of either serves for all of the other.
    t_min, t_max : array_like, scalar or (N,)

    Raises
    ------
    UsageError
        Shapes do not fit, or a ray is zero or not finite.
    """
    rays = shape_rays(origins, directions, t_min, t_max)
    check_values(rays)
    n = len(rays.origins)
    limits = (np.array(np.broadcast_to(a, (n,)), order="C") for a in (rays.t_min, rays.t_max))
    return Rays(rays.origins, rays.directions, *limits)


def shape_rays(
    origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike, t_max: ArrayLike
) -> Rays:
    """Return rays as arrays whose numbers nobody has looked at; arguments as for `check_rays`.

    Raises
    ------
    UsageError
        Shapes do not fit.
    """
    o, d = check_points(origins, "origins"), check_points(directions, "directions")
    if len(o) == 1 != len(d):
        o = np.repeat(o, len(d), axis=0)
    if len(d) == 1 != len(o):
        d = np.repeat(d, len(o), axis=0)
    if o.shape != d.shape:
        raise UsageError(f"{len(o)} origins do not fit {len(d)} directions")
    return Rays(o, d, _shape_limit(t_min, "t_min", len(o)), _shape_limit(t_max, "t_max", len(o)))


def check_values(rays: Rays) -> None:
    """Require that rays are what can be traced.

    Raises
    ------
    UsageError
        A ray is zero or not finite, or a limit is not a number.
    """
    if not (np.isfinite(rays.origins).all() and np.isfinite(rays.directions).all()):
        raise UsageError("rays must be finite")
    if not rays.directions.any(axis=1).all():
        raise UsageError("a ray's direction must not be zero")
    for name in ("t_min", "t_max"):
        if np.isnan(getattr(rays, name)).any():
            raise UsageError(f"{name} must not be NaN")


def check_points(points: ArrayLike, what: str = "points") -> NDArray[np.float64]:
    """Return points as float64 (N, 3); a single one may be (3,).

    Raises
    ------
    UsageError
        The shape does not fit.
    """
    found = array(points, what)
    if found.ndim == 1 and found.shape == (3,):
        found = found[None, :]
    if found.ndim != 2 or found.shape[1] != 3:
        raise UsageError(f"{what} must have shape (N, 3), not {found.shape}")
    # Kernels are compiled for arrays that can be written to.
    return found if found.flags.writeable else found.copy()


def _shape_limit(value: ArrayLike, name: str, n: int) -> NDArray[np.float64]:
    found = array(value, name)  # of one dimension at least
    if found.shape not in ((1,), (n,)):
        raise UsageError(f"{name} must be a number or have shape ({n},), not {found.shape}")
    return found if found.flags.writeable else found.copy()


def count_processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Stopped(Exception):
    """A call was ended from outside; see `stoppable`."""


_called = threading.local()


@contextmanager
def stoppable(stop: Event, within: float = SECONDS) -> Iterator[None]:
    """Let calls of this thread end with `Stopped` soon after an event is set.

    Parameters
    ----------
    within
        Seconds that a chunk takes, and so a stop.
    """
    _called.stop, _called.share = stop, within / SECONDS
    try:
        yield
    finally:
        del _called.stop, _called.share


class Pace:
    """How many rays the next chunk takes, so that it ends within a part of a second.

    Python sees an interrupt only between chunks, and nobody knows before how long rays take.
    """

    def __init__(self) -> None:
        self._size = FIRST_CHUNK

    def next(self, most: int, share: float = 1.0) -> int:
        """Return the size of the next chunk, or of one that takes a share of the time."""
        return min(max(SMALLEST_CHUNK, round(self._size * share)), most)

    def learn(self, size: int, seconds: float) -> None:
        """Take in how long a chunk took."""
        wanted = int(size * SECONDS / max(seconds, 1e-6))
        most = max(self._size, STEP * size)
        self._size = max(SMALLEST_CHUNK, min(wanted, most, LARGEST_CHUNK))


PATIENCE = 0.5
"""Seconds that an exception waits for chunks that have begun: one ray may take for ever."""


def run_chunks(n: int, threads: int, work: Callable[[int, int], None], pace: Pace) -> None:
    """Call ``work(begin, end)`` for chunks of n rays, in threads if there are several.

    The first exception, in the order of the rays, is raised.

    Parameters
    ----------
    pace
        What calls like this one have learnt so far.
    """
    stop: Event | None = getattr(_called, "stop", None)
    alone = threads == 1 or n <= CHUNK
    if alone and 0 < n <= pace.next(LARGEST_CHUNK) and stop is None:
        # Calls with few rays are many.
        start = time.perf_counter()
        work(0, n)
        pace.learn(n, time.perf_counter() - start)
        return
    share = getattr(_called, "share", 1.0)
    chunks = _Chunks(n, LARGEST_CHUNK if alone else CHUNK, pace, work, stop, share)
    if alone:
        chunks.run()
    else:
        executor = _workers(os.getpid(), threads)
        futures = [executor.submit(chunks.run) for _ in range(min(threads, -(-n // CHUNK)))]
        try:
            for future in futures:
                future.result()
        except BaseException:
            chunks.end()
            wait(futures, PATIENCE)
            raise
    if chunks.errors:
        raise min(chunks.errors, key=itemgetter(0))[1]


class _Chunks:
    """Chunks of rays that threads take one after the other.

    Attributes
    ----------
    errors
        What was raised, with the first ray of its chunk.
    """

    def __init__(
        self,
        n: int,
        most: int,
        pace: Pace,
        work: Callable[[int, int], None],
        stop: Event | None,
        share: float,
    ) -> None:
        self._n, self._most, self._pace, self._work, self._stop = n, most, pace, work, stop
        self._share = share
        self._next = 0
        self._lock = Lock()
        self.errors: list[tuple[int, BaseException]] = []

    def run(self) -> None:
        """Do chunks until none is left, or something was raised."""
        while (chunk := self._take()) is not None:
            begin, end = chunk
            start = time.perf_counter()
            try:
                if self._stop is not None and self._stop.is_set():
                    raise Stopped
                self._work(begin, end)
            except BaseException as error:
                self.errors.append((begin, error))
                self.end()
            self._pace.learn(end - begin, time.perf_counter() - start)

    def end(self) -> None:
        """Let no chunk begin any more. Those before have begun."""
        with self._lock:
            self._next = self._n

    def _take(self) -> tuple[int, int] | None:
        with self._lock:
            begin = self._next
            if begin >= self._n:
                return None
            self._next = min(self._n, begin + self._pace.next(self._most, self._share))
            return begin, self._next


@cache
def _workers(process: int, threads: int) -> ThreadPoolExecutor:
    """Return threads that stay, and so does the working space that kernels keep for each of them.

    A process that was forked off has none of its parent's.
    """
    return ThreadPoolExecutor(threads, thread_name_prefix=f"pcsg-rays-{process}")
