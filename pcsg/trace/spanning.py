"""Whole lines through blocks, by repeated questions.

What questions cannot tell, such as sheets under an operation, is left to the walker.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.registry import Pool
from pcsg.trace.groups import BLOCK
from pcsg.trace.owner import find_owner
from pcsg.trace.precision import Extent, load_precision, precision_of, store_precision, tolerance
from pcsg.trace.question import ask
from pcsg.trace.traversal import PATH, PRECISION, UNDECIDED, Scratch, Trees, begin_batch, begin_ray
from pcsg.vec import Ray

ROOMS = 16, 256, 4_096
"""Intervals that there is room for; rays that have more are asked again with more, at last the
walker."""

FULL = -2
"""What is said of a ray that has more."""


@njit(entry=True)
def span_batch(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    root: int,
    extent: Extent,
    box: NDArray[np.float64],
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    begin: int,
    end: int,
    room: int,
    counts: NDArray[np.int64],
    ends: NDArray[np.float64],
    records: NDArray[np.int32],
) -> None:
    """Write where rays enter and leave the solid.

    Parameters
    ----------
    box : float64 (2, 3)
        About the solid.
    room
        R: intervals that there is room for, of each ray.
    counts : int64 (N,)
        Receives the number of ends of every ray, UNDECIDED where only lists can tell, FULL.
    ends, records : float64 (2 R N,), int32
        Receive where they are, and the leaf records that they belong to.
    """
    begin_batch(scratch)
    for i in range(begin, end):
        ox, oy, oz = origins[i]
        dx, dy, dz = directions[i]
        ray = Ray(ox, oy, oz, dx, dy, dz, -math.inf, math.inf)
        store_precision(scratch.small, PRECISION, precision_of(ray, extent))
        begin_ray(scratch)
        at = 2 * room * i
        counts[i] = _step_through(trees, pool, scratch, root, box, ray, room, at, ends, records)


@njit
def _step_through(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    root: int,
    box: NDArray[np.float64],
    ray: Ray,
    room: int,
    at: int,
    ends: NDArray[np.float64],
    records: NDArray[np.int32],
) -> int:
    """Write the ends of one ray from `at` on; return their number, UNDECIDED or FULL."""
    low, high = _meet_box(box, ray)
    if not low <= high:
        return 0
    if math.isinf(low) or math.isinf(high):
        return UNDECIDED
    precision = load_precision(scratch.small, PRECISION)
    code = wide(root) << 3 | BLOCK
    t = low - 8.0 * tolerance(low, precision) - 1e-6 * (high - low)
    limit = high + 8.0 * tolerance(high, precision) + 1e-6 * (high - low)
    state, u, _ = ask(trees, pool, scratch, code, ray, t, limit, t, 0, 0)
    inside, n = 0, 0
    while state == inside and u <= limit:
        t = u
        state, u, _ = ask(trees, pool, scratch, code, ray, t, limit, t, 0, 0)
        if state == inside:
            continue
        if state == UNDECIDED:
            return UNDECIDED
        if n == 2 * room:
            return FULL
        before, behind, where = find_owner(trees, pool, scratch, code, ray, t, 0, 0, False)
        if before != inside or behind != state:
            return UNDECIDED
        ends[at + n] = where
        last = scratch.paths[PATH + scratch.paths[PATH]]
        records[at + n] = trees.targets[last]
        inside = state
        n += 1
    return n if state == inside == 0 else UNDECIDED


@njit
def _meet_box(box: NDArray[np.float64], ray: Ray) -> tuple[float, float]:
    """Return where a line enters and leaves a box; the first is larger where it misses."""
    low, high = -math.inf, math.inf
    for axis in range(3):
        o, d = ray[axis], ray[3 + axis]
        if d == 0.0:
            if not box[0, axis] <= o <= box[1, axis]:
                return math.inf, -math.inf
            continue
        a, b = (box[0, axis] - o) / d, (box[1, axis] - o) / d
        low, high = max(low, min(a, b)), min(high, max(a, b))
    return low, high
