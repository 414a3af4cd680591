"""Rays through states that are made on demand.

Ordered traversal as in `kernel`, over items of slots: an entry's item leads to its state, which is
made if it is not there (`slots`), a primitive's is crossed, and a fixture's is traced by the kernel
of blocks. Below unions only, so that t shrinks to the first crossing.

What cannot be decided here is left to the walker: rays that start on a surface or in a solid,
paths that are too deep, and states that cannot be made, whose faults the walker tells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import ALL, ANY, Pool
from pcsg.simd import count_trailing_zeros
from pcsg.slabs import WIDTH, Slabs, make_slabs, meet_block
from pcsg.trace.coverage import Coverage, draw_hit
from pcsg.trace.ends import (
    CUT,
    MAX_DEPTH,
    NEVER,
    area_of,
    begin_levels,
    go_down,
    middle_of,
    world_size,
)
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.kernel import find_first
from pcsg.trace.precision import Extent, is_touch, precision_of, store_precision, tolerance
from pcsg.trace.rulebook import (
    E_STAND_IN,
    ENTRY_FIELDS,
    FIXTURE,
    P_KIND,
    P_SOLID,
    P_TARGET,
    PART_FIELDS,
)
from pcsg.trace.slots import FAULT, H_PARTS, HEAD, Lazy, Slots, make_stand_in, open_state
from pcsg.trace.traversal import (
    ENDS,
    HIT,
    HIT_PATH,
    MISS,
    NONE,
    PATH,
    PRECISION,
    STACK,
    UNDECIDED,
    VISITS,
    Scratch,
    T,
    Trees,
    comes_first,
    keep_path,
    load_ray,
    make_scratch,
    store_ray,
)
from pcsg.vec import Affine, Ray, Vec3, determinant, load_affine, transform_ray

_U1 = np.uint64(1)


_NEAR_ORIGIN = Extent(Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), 0.0)


class LazyScratch(NamedTuple):
    """Working space of one thread: for items, and for the kernel of blocks.

    Attributes
    ----------
    outer
        Its `HIT_PATH` leads to the first hit's item by places in the text.
    inner
        For the kernel of blocks.
    entries : float64 (4,)
        Where a ray enters the boxes of a block.
    path : int32
        The path that leads on from a fixture to the first hit, its length first.
    """

    outer: Scratch
    inner: Scratch
    entries: NDArray[np.float64]
    path: NDArray[np.int32]


def make_lazy_scratch() -> LazyScratch:
    """Return working space for one thread."""
    return LazyScratch(
        make_scratch(), make_scratch(), np.zeros(WIDTH), np.zeros(PATH + 2, np.int32)
    )


@njit(inline=True)
def _push_items(
    slots: Slots,
    slot: int,
    width: int,
    slabs: Slabs,
    near: float,
    far: float,
    scratch: LazyScratch,
    level: int,
    top: int,
) -> int:
    """Push the items of a slot whose boxes a ray meets, the nearest last; return the new top."""
    entry_t, entry_ref = scratch.outer.entry_t, scratch.outer.entry_ref
    entries = scratch.entries
    begin = top
    for block in range((slots.heads[HEAD * slot + H_PARTS] + WIDTH - 1) // WIDTH):
        base = slot * width + WIDTH * block
        met = meet_block(slots.boxes, base // WIDTH, slabs, near, far, entries)
        while met != NONE:
            k = wide(count_trailing_zeros(met))
            met &= met - _U1
            t = entries[k]
            p = top
            while p > begin and entry_t[p - 1] < t:
                entry_t[p] = entry_t[p - 1]
                entry_ref[p] = entry_ref[p - 1]
                p -= 1
            entry_t[p] = t
            entry_ref[p] = wide(slots.refs[base + k]) << 8 | level
            top += 1
    return top


class LazyCut(NamedTuple):
    """Where rays end that see a state smaller than their footprint.

    Attributes
    ----------
    cover
        Opacities of entries.
    of_entry : int32 (E,)
        Number of an entry in `cover`; STAND_IN, or NEVER.
    linear : float64 (12 MAX_DEPTH,)
        Working space of one thread: at every level, the linear part of local_from_world, and one
        over the squares of its rows' lengths.
    numbers, box : float64 (8,), (6,)
        Working space.
    """

    cover: Coverage
    of_entry: NDArray[np.int32]
    linear: NDArray[np.float64]
    numbers: NDArray[np.float64]
    box: NDArray[np.float64]


STAND_IN = -2
"""In `LazyCut.of_entry`: what the terminating rule shows. In a path, ``-1 - k`` is its part k."""


@njit(inline=True)
def _load_box(slots: Slots, own: int, box: NDArray[np.float64]) -> None:
    """Write the box of an item."""
    at = 6 * (own // WIDTH * WIDTH) + own % WIDTH
    for i in range(6):
        box[i] = slots.boxes[at + WIDTH * i]


@njit
def _meet_end(
    lazy: Lazy,
    cut: LazyCut,
    pool: Pool,
    ends: NDArray[np.float64],
    item: int,
    outer: Ray,
    inverse: Affine,
    ray: Ray,
    level: int,
    middle: float,
    low: float,
    far: float,
) -> tuple[int, float, int]:
    """Let what stands for a state that is too small stop a ray that meets its box.

    Parameters
    ----------
    outer, ray, level
        In the frame of the item's slot, and in the state's; the level of the former.
    middle
        Where the ray passes nearest to the middle of the box.

    Returns
    -------
    int, t, step
        HIT, MISS or UNDECIDED; the last step of the path.
    """
    book = lazy.book
    shared = len(lazy.store.refs)
    parts = lazy.store.parts if item < shared else lazy.cache.parts
    entry = book.parts[PART_FIELDS * parts[item if item < shared else item - shared] + P_TARGET]
    state = cut.of_entry[entry]
    if state >= 0:
        if not (low <= middle <= far):
            return MISS, 0.0, 0
        # Volumes, and lengths along the ray, tell how areas across it change with the frame.
        area = abs(determinant(inverse)) * area_of(cut.box, outer)
        hit = draw_hit(cut.cover, state, ray, area, outer, cut.linear, level, cut.numbers)
        return (HIT, middle, CUT - hit) if hit >= 0 else (MISS, 0.0, 0)
    first = make_stand_in(lazy, item, book.entries[ENTRY_FIELDS * entry + E_STAND_IN])
    if first == FAULT:
        return UNDECIDED, 0.0, 0
    best, step = math.inf, 0
    own = first - shared
    slots = lazy.cache
    for k in range(slots.heads[HEAD * (own // book.width) + H_PARTS]):
        part = PART_FIELDS * slots.parts[own + k]
        local = transform_ray(load_affine(slots.inverses, 12 * (own + k)), ray)
        solid, at = book.parts[part + P_SOLID] >> 1, book.n_values * (own + k)
        n = leaf_crossings(solid, local, ALL, slots.values, at, pool, ends, ENDS)
        if n > ENDS and low <= ends[ENDS] < best and ends[ENDS] <= far:
            best, step = ends[ENDS], -1 - k
    return (HIT, best, step) if best < math.inf else (MISS, 0.0, 0)


@njit(contract=True, inline=True)
def find_first_lazy(
    lazy: Lazy,
    trees: Trees,
    pool: Pool,
    scratch: LazyScratch,
    start: int,
    extent: Extent,
    want: int,
    world: Ray,
    cut: LazyCut | None,
    width: float,
    spread: float,
) -> int:
    """Find the first crossing of a ray in [tmin, tmax].

    Parameters
    ----------
    start
        The item to begin with, and the ray in the frame of its slot; 0 for the axiom.
    extent
        Where the scene is.
    want
        FIRST, or ANY for any crossing.
    cut, width, spread
        Where recursion ends below the ray's footprint ``width + spread t``; None for nowhere.

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
    precision = precision_of(world, extent)
    store_precision(inner.small, PRECISION, precision)
    touch = world.tmin + tolerance(world.tmin, precision)
    near = world.tmin - 2.0 * tolerance(world.tmin, precision)
    best = world.tmax
    far = best
    hit = MISS
    top = 0
    at_level = 0
    code = wide(start) << 3 | SUSPENDED
    paths[HIT_PATH] = 0
    store_ray(rays, 0, world, 0.0)
    if cut is not None:
        begin_levels(cut.linear)
    while True:
        item = code >> 3
        slots = lazy.store if item < shared else lazy.cache
        own = item if item < shared else item - shared
        part = PART_FIELDS * wide(slots.parts[own])
        step = own % book.width
        inverse = load_affine(slots.inverses, 12 * own)
        above = load_ray(rays, at_level)
        ray = transform_ray(inverse, above)
        if code & 7 != SUSPENDED:
            outer.frames[VISITS + 2] += 1
            solid = book.parts[part + P_SOLID]
            at = book.n_values * own
            n = leaf_crossings(solid >> 1, ray, ALL, slots.values, at, pool, small, ENDS)
            for k in range(ENDS, n, 2):
                lo, hi = small[k], small[k + 1]
                if solid & 1 == 1:
                    if lo < world.tmin:
                        continue
                elif hi < near or is_touch(lo, hi):
                    continue
                elif lo <= touch:
                    return UNDECIDED
                if lo > world.tmax:
                    break
                e = tolerance(lo, precision)
                first = hit == MISS or lo < best - e
                if first or (lo <= best + e and comes_first(paths, at_level, step, HIT_PATH)):
                    hit = HIT
                    best = lo
                    far = min(world.tmax, best + e)
                    keep_path(paths, at_level, step, HIT_PATH)
                break
        elif book.parts[part + P_KIND] == FIXTURE:
            block = wide(book.parts[part + P_TARGET])
            limited = Ray(ray.ox, ray.oy, ray.oz, ray.dx, ray.dy, ray.dz, world.tmin, far)
            found = find_first(
                trees, pool, inner, block, _NEAR_ORIGIN, want, limited, None, 0.0, 0.0
            )
            if found == HIT:
                t = inner.small[T]
                e = tolerance(t, precision)
                first = hit == MISS or t < best - e
                if first or (t <= best + e and comes_first(paths, at_level, step, HIT_PATH)):
                    hit = HIT
                    best = t
                    far = min(world.tmax, best + e)
                    keep_path(paths, at_level, step, HIT_PATH)
                    for k in range(inner.paths[HIT_PATH] + 1):
                        scratch.path[k] = inner.paths[HIT_PATH + k]
            elif found != MISS:
                return UNDECIDED
        else:
            if at_level + 4 >= MAX_DEPTH or top + book.width >= STACK - 8:
                return UNDECIDED
            outer.frames[VISITS + 1] += 1
            paths[at_level] = step
            opens = True
            if cut is not None:
                entry = wide(book.parts[part + P_TARGET])
                if cut.of_entry[entry] != NEVER and item != start:
                    _load_box(slots, own, cut.box)
                    middle = middle_of(cut.box, above)
                    size = world_size(cut.linear, at_level, cut.box)
                    opens = not size < width + spread * max(middle, 0.0)
                if not opens:
                    found, t, last = _meet_end(
                        lazy,
                        cut,
                        pool,
                        small,
                        item,
                        above,
                        inverse,
                        ray,
                        at_level,
                        middle,
                        world.tmin,
                        far,
                    )
                    if found == UNDECIDED:
                        return UNDECIDED
                    e = tolerance(t, precision)
                    level = at_level + 1
                    first = hit == MISS or t < best - e
                    tied = t <= best + e and comes_first(paths, level, last, HIT_PATH)
                    if found == HIT and (first or tied):
                        hit = HIT
                        best = t
                        far = min(world.tmax, best + e)
                        keep_path(paths, level, last, HIT_PATH)
                else:
                    go_down(cut.linear, at_level, inverse)
            if opens:
                at_level += 1
                store_ray(rays, at_level, ray, 0.0)
                slot = open_state(lazy, item, at_level)
                if slot == FAULT:
                    return UNDECIDED
                slabs = make_slabs(ray)
                if slot < n_shared:
                    top = _push_items(
                        lazy.store, slot, book.width, slabs, near, far, scratch, at_level, top
                    )
                else:
                    slot -= n_shared
                    top = _push_items(
                        lazy.cache, slot, book.width, slabs, near, far, scratch, at_level, top
                    )
        if hit == HIT and want == ANY:
            # Only a solid about the start could still hide it, which from infinity is anywhere.
            far = min(far, touch) if touch > -math.inf else far
        while top > 0 and entry_t[top - 1] > far:
            top -= 1
        if top == 0:
            small[T] = best
            return hit
        top -= 1
        code = entry_ref[top] >> 8
        at_level = wide(entry_ref[top] & 255)
