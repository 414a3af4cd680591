"""Batches of rays: checked arrays, and chunks of them over threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array
from pcsg.errors import UsageError

CHUNK = 16_384
"""Rays that one thread takes at a time; fewer cost more for starting than they gain."""


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


def run_chunks(n: int, threads: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(begin, end)`` for chunks of n rays, in threads if there are several.

    The first exception, in the order of the rays, is raised.
    """
    chunks = [(begin, min(n, begin + CHUNK)) for begin in range(0, n, CHUNK)]
    if len(chunks) <= 1 or threads == 1:
        for begin, end in chunks:
            work(begin, end)
        return
    executor = _workers(os.getpid(), threads)
    futures = [executor.submit(work, begin, end) for begin, end in chunks]
    try:
        for future in futures:
            future.result()
    except BaseException:
        for future in futures:
            future.cancel()
        wait(futures)
        raise


@cache
def _workers(process: int, threads: int) -> ThreadPoolExecutor:
    """Return threads that stay, and so does the working space that kernels keep for each of them.

    A process that was forked off has none of its parent's.
    """
    return ThreadPoolExecutor(threads, thread_name_prefix=f"pcsg-rays-{process}")
