"""Rays through blocks: the fast engine.

Ordered traversal of four-wide blocks; an instance maps the ray into its group's frame and goes on
at its first block. Below unions only, t shrinks to the first crossing; an operation is stepped
through by questions (`question`).

What needs whole lists (rays that start on a surface, sheets under an operation) is left to the
walker: `UNDECIDED`.
"""

from __future__ import annotations

import math

from pcsg.jit import njit
from pcsg.leaf.registry import ANY, OVERFLOW, Pool
from pcsg.slabs import make_slabs, meet_block, wide
from pcsg.trace.groups import BLOCK, INSTANCE, LEAF, OPERATION, SMALL
from pcsg.trace.merge import tolerance
from pcsg.trace.question import ask, is_subtracted, settle_exit
from pcsg.trace.traversal import (
    ENDS,
    HIT,
    HIT_PATH,
    INSIDE,
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
    copy_path,
    cross_reference,
    keep_surface,
    load_ray,
    precedes,
    push_references,
    store_ray,
)
from pcsg.vec import Ray, load_affine, transform_ray


@njit(contract=True)
def find_first(trees: Trees, pool: Pool, scratch: Scratch, root: int, want: int, world: Ray) -> int:
    """Find the first crossing of a ray in [tmin, tmax].

    Parameters
    ----------
    root
        First block of the axiom's group.
    want
        FIRST, or ANY for any crossing.

    Returns
    -------
    int
        HIT (`small[T]` is t and the path at `HIT_PATH` leads to the leaf), MISS, INSIDE where the
        ray starts in a solid, or UNDECIDED where only lists can tell.
    """
    entry_t, entry_ref, rays = scratch.entry_t, scratch.entry_ref, scratch.rays
    paths, small = scratch.paths, scratch.small
    ray = world
    touch = world.tmin + tolerance(world.tmin)
    near = world.tmin - 2.0 * tolerance(world.tmin)
    best = world.tmax
    far = best
    hit = MISS
    top = 0
    present = 0
    at_level = 0
    code = wide(root) << 3 | BLOCK
    paths[HIT_PATH] = 0
    store_ray(rays, 0, ray)
    slabs = make_slabs(ray)
    while True:
        kind = code & 7
        index = code >> 3
        found = False
        if kind <= INSTANCE:
            block = index
            if kind == INSTANCE or at_level != present:
                ray = load_ray(rays, at_level)
                present = at_level
                if kind == INSTANCE:
                    if at_level + 4 >= MAX_DEPTH:
                        return UNDECIDED
                    paths[at_level] = index
                    ray = transform_ray(load_affine(trees.inverses, 12 * index), ray)
                    present = at_level + 1
                    store_ray(rays, present, ray)
                    block = wide(trees.targets[index])
                    scratch.visits[1] += 1
                slabs = make_slabs(ray)
            scratch.visits[0] += 1
            met = meet_block(trees.boxes, block, slabs, near, far, small)
            if met != NONE:
                if top >= STACK - 8:
                    return UNDECIDED
                found = True
                code, top = push_references(
                    trees.refs, block, met, small, entry_t, entry_ref, present, top
                )
                at_level = present
        elif kind in (LEAF, SMALL):
            scratch.visits[2] += 1
            n = cross_reference(trees, pool, scratch, kind, index, load_ray(rays, at_level))
            if n == OVERFLOW:
                return UNDECIDED
            for k in range(ENDS, n, 2):
                lo, hi = small[k], small[k + 1]
                if kind == LEAF and trees.leaves[4 * trees.targets[index] + 2] == 1:
                    if lo < world.tmin:
                        continue
                elif hi < near or hi <= lo:
                    continue
                elif lo <= touch:
                    return INSIDE if lo < near and hi > touch else UNDECIDED
                if lo > world.tmax:
                    break
                e = tolerance(lo)
                if (
                    hit == MISS
                    or lo < best - e
                    or (lo <= best + e and comes_first(paths, at_level, index, HIT_PATH))
                ):
                    hit = HIT
                    best = lo
                    far = min(world.tmax, best + e)
                    keep_surface(trees, scratch, at_level, kind, index, k, HIT_PATH)
                break
        elif kind == OPERATION:
            ray = load_ray(rays, at_level)
            state, u = ask(trees, pool, scratch, code, ray, near, far, top, at_level)
            if state == UNDECIDED or u <= touch:
                return UNDECIDED
            if state == 1:
                return INSIDE
            held = PATH * (MAX_DEPTH - 1)
            while state == 0 and u <= far and u < math.inf:
                t = u
                copy_path(paths, PATH * (at_level + 1), held)
                state, u = ask(trees, pool, scratch, code, ray, t, far, top, at_level)
                if state == UNDECIDED:
                    return UNDECIDED
                if state == 1 and is_subtracted(trees, paths, held):
                    sure, t = settle_exit(trees, pool, scratch, code, ray, t, top, at_level, 1)
                    # The question has left the reversed ray there.
                    store_ray(rays, at_level, ray)
                    if not sure:
                        return UNDECIDED
                    copy_path(paths, PATH * (at_level + 1), held)
                e = tolerance(t)
                if state == 1 and (
                    hit == MISS
                    or t < best - e
                    or (t <= best + e and precedes(paths, held, HIT_PATH))
                ):
                    hit = HIT
                    best = t
                    far = min(world.tmax, best + e)
                    copy_path(paths, held, HIT_PATH)
        if hit == HIT and want == ANY:
            # Only a solid about the start could still hide it.
            far = min(far, touch)
        if not found:
            while top > 0:
                top -= 1
                if entry_t[top] <= far:
                    code = entry_ref[top] >> 8
                    at_level = entry_ref[top] & 255
                    found = True
                    break
            if not found:
                small[T] = best
                return hit


@njit(contract=True)
def find_exit(trees: Trees, pool: Pool, scratch: Scratch, root: int, world: Ray) -> int:
    """Find whether a ray that starts in a solid leaves the union in [tmin, tmax].

    Arguments as for `find_first`; HIT, MISS or UNDECIDED.
    """
    code = wide(root) << 3 | BLOCK
    t = world.tmin - 2.0 * tolerance(world.tmin)
    touch = world.tmin + tolerance(world.tmin)
    state, u = ask(trees, pool, scratch, code, world, t, world.tmax, 0, 0)
    if state != 1 or u <= touch:
        return UNDECIDED
    while state == 1 and u <= world.tmax and u < math.inf:
        t = u
        state, u = ask(trees, pool, scratch, code, world, t, world.tmax, 0, 0)
    if state == UNDECIDED:
        return UNDECIDED
    return HIT if state == 0 else MISS
