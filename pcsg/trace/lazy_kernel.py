"""Rays through states that are made on demand.

Ordered traversal as in `kernel`, over items of slots: an entry's item leads to its state, which is
made if it is not there (`slots`), a primitive's is crossed, and a fixture's is traced by the kernel
of blocks. Below unions only, so that t shrinks to the first crossing.

What cannot be decided here is left to the walker: rays that start on a surface or in a solid,
paths that are too deep, and states that cannot be made, whose faults the walker tells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import ALL, ANY, Pool
from pcsg.simd import WIDTH, count_trailing_zeros
from pcsg.slabs import Slabs, make_slabs, meet_block, wide
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.kernel import find_first
from pcsg.trace.merge import tolerance
from pcsg.trace.rulebook import FIXTURE, P_KIND, P_SOLID, P_TARGET, PART_FIELDS
from pcsg.trace.slots import FAULT, H_PARTS, HEAD, Lazy, Slots, open_state
from pcsg.trace.traversal import (
    ENDS,
    HIT,
    HIT_PATH,
    MAX_DEPTH,
    MISS,
    NONE,
    PATH,
    STACK,
    UNDECIDED,
    Scratch,
    T,
    Trees,
    comes_first,
    load_ray,
    make_scratch,
    store_ray,
)
from pcsg.vec import Ray, load_affine, transform_ray

_U1 = np.uint64(1)


class LazyScratch(NamedTuple):
    """Working space of one thread: for items, and for the kernel of blocks.

    Attributes
    ----------
    outer
        Its `HIT_PATH` leads to the first hit's item by places in the text.
    inner
        For the kernel of blocks.
    path : int32
        The path that leads on from a fixture to the first hit, its length first.
    """

    outer: Scratch
    inner: Scratch
    path: NDArray[np.int32]


def make_lazy_scratch() -> LazyScratch:
    """Return working space for one thread."""
    return LazyScratch(make_scratch(), make_scratch(), np.zeros(PATH + 2, np.int32))


@njit
def _keep_path(paths: NDArray[np.int32], level: int, last: int, at: int) -> None:
    """Copy the present path down to a level, and its last part."""
    paths[at] = level + 1
    for k in range(level):
        paths[at + 1 + k] = paths[k]
    paths[at + 1 + level] = last


@njit(inline=True)
def _push_items(
    slots: Slots,
    slot: int,
    width: int,
    slabs: Slabs,
    near: float,
    far: float,
    scratch: Scratch,
    level: int,
    top: int,
) -> int:
    """Push the items of a slot whose boxes a ray meets, the nearest last; return the new top."""
    entry_t, entry_ref, small = scratch.entry_t, scratch.entry_ref, scratch.small
    begin = top
    for block in range((slots.heads[HEAD * slot + H_PARTS] + WIDTH - 1) // WIDTH):
        base = slot * width + WIDTH * block
        met = meet_block(slots.boxes, base // WIDTH, slabs, near, far, small)
        while met != NONE:
            k = wide(count_trailing_zeros(met))
            met &= met - _U1
            t = small[k]
            p = top
            while p > begin and entry_t[p - 1] < t:
                entry_t[p] = entry_t[p - 1]
                entry_ref[p] = entry_ref[p - 1]
                p -= 1
            entry_t[p] = t
            entry_ref[p] = wide(slots.refs[base + k]) << 8 | level
            top += 1
    return top


@njit(contract=True, inline=True)
def find_first_lazy(
    lazy: Lazy, trees: Trees, pool: Pool, scratch: LazyScratch, want: int, world: Ray
) -> int:
    """Find the first crossing of a ray in [tmin, tmax].

    Parameters
    ----------
    want
        FIRST, or ANY for any crossing.

    Returns
    -------
    int
        HIT (``outer.small[T]`` is t), MISS, or UNDECIDED.
    """
    outer, inner = scratch.outer, scratch.inner
    entry_t, entry_ref, rays = outer.entry_t, outer.entry_ref, outer.rays
    paths, small = outer.paths, outer.small
    book = lazy.book
    shared = len(lazy.store.refs)
    n_shared = len(lazy.store.heads) // HEAD
    touch = world.tmin + tolerance(world.tmin)
    near = world.tmin - 2.0 * tolerance(world.tmin)
    best = world.tmax
    far = best
    hit = MISS
    top = 0
    at_level = 0
    code = wide(SUSPENDED)
    paths[HIT_PATH] = 0
    store_ray(rays, 0, world)
    while True:
        item = code >> 3
        slots = lazy.store if item < shared else lazy.cache
        own = item if item < shared else item - shared
        part = PART_FIELDS * wide(slots.parts[own])
        step = own % book.width
        ray = transform_ray(load_affine(slots.inverses, 12 * own), load_ray(rays, at_level))
        if code & 7 != SUSPENDED:
            outer.visits[2] += 1
            solid = book.parts[part + P_SOLID]
            at = book.n_values * own
            n = leaf_crossings(solid >> 1, ray, ALL, slots.values, at, pool, small, ENDS)
            for k in range(ENDS, n, 2):
                lo, hi = small[k], small[k + 1]
                if solid & 1 == 1:
                    if lo < world.tmin:
                        continue
                elif hi < near or hi <= lo:
                    continue
                elif lo <= touch:
                    return UNDECIDED
                if lo > world.tmax:
                    break
                e = tolerance(lo)
                first = hit == MISS or lo < best - e
                if first or (lo <= best + e and comes_first(paths, at_level, step, HIT_PATH)):
                    hit = HIT
                    best = lo
                    far = min(world.tmax, best + e)
                    _keep_path(paths, at_level, step, HIT_PATH)
                break
        elif book.parts[part + P_KIND] == FIXTURE:
            block = wide(book.parts[part + P_TARGET])
            limited = Ray(ray.ox, ray.oy, ray.oz, ray.dx, ray.dy, ray.dz, world.tmin, far)
            found = find_first(trees, pool, inner, block, want, limited)
            if found == HIT:
                t = inner.small[T]
                e = tolerance(t)
                first = hit == MISS or t < best - e
                if first or (t <= best + e and comes_first(paths, at_level, step, HIT_PATH)):
                    hit = HIT
                    best = t
                    far = min(world.tmax, best + e)
                    _keep_path(paths, at_level, step, HIT_PATH)
                    for k in range(inner.paths[HIT_PATH] + 1):
                        scratch.path[k] = inner.paths[HIT_PATH + k]
            elif found != MISS:
                return UNDECIDED
        else:
            if at_level + 4 >= MAX_DEPTH or top + book.width >= STACK - 8:
                return UNDECIDED
            outer.visits[1] += 1
            paths[at_level] = step
            at_level += 1
            store_ray(rays, at_level, ray)
            slot = open_state(lazy, item, at_level)
            if slot == FAULT:
                return UNDECIDED
            slabs = make_slabs(ray)
            if slot < n_shared:
                top = _push_items(
                    lazy.store, slot, book.width, slabs, near, far, outer, at_level, top
                )
            else:
                slot -= n_shared
                top = _push_items(
                    lazy.cache, slot, book.width, slabs, near, far, outer, at_level, top
                )
        if hit == HIT and want == ANY:
            # Only a solid about the start could still hide it.
            far = min(far, touch)
        while top > 0 and entry_t[top - 1] > far:
            top -= 1
        if top == 0:
            small[T] = best
            return hit
        top -= 1
        code = entry_ref[top] >> 8
        at_level = wide(entry_ref[top] & 255)
