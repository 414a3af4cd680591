"""The stateless question to a solid: is it there at t, and until where, at least.

Section 4 of the design of speed: a union answers with the first leaf that covers t, and its end,
else with the nearest entry. An intersection is outside while one operand is; a difference is its
first operand and none of the others. The caller steps from answer to answer. Every question is an
ordinary ordered walk: no lists, no allocation, no limit; operations may stand anywhere. Nested
questions wait in frames of an explicit stack.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.slabs import make_slabs, meet_block
from pcsg.graph.operators import DIFFERENCE
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.registry import ALL, OVERFLOW, Pool
from pcsg.simd import WIDTH
from pcsg.trace.ends import MAX_DEPTH
from pcsg.trace.groups import BLOCK, LEAF, OPERATION, SMALL, SUSPENDED
from pcsg.trace.precision import is_touch, load_precision, tolerance
from pcsg.trace.traversal import (
    ENDS,
    FRAME,
    LIMITS,
    NONE,
    PATH,
    PRECISION,
    SLOT,
    STACK,
    UNDECIDED,
    VISITS,
    Scratch,
    Trees,
    choose_beginning,
    comes_first,
    copy_path,
    cross_reference,
    find_expansion,
    keep_surface,
    load_beginning,
    load_ray,
    must_stop,
    precedes,
    push_references,
    store_ray,
)
from pcsg.vec import Ray, load_affine, transform_ray

_DIFFERENCE = DIFFERENCE.kind


@njit(contract=True)
def ask(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    code: int,
    ray: Ray,
    t: float,
    limit: float,
    entry: float,
    base: int,
    level: int,
) -> tuple[int, float, bool]:
    """Ask whether the union of what a reference leads to is there at t, and until where.

    Parameters
    ----------
    code
        A block or an operation, in the ray's frame.
    limit
        Nothing beyond is of interest.
    entry
        About where the ray enters what the reference leads to.
    base, level
        Where the free parts of the stack and of the levels begin.

    Returns
    -------
    state, u, tied
        1 inside, 0 outside or `UNDECIDED`; it stays so on (t, u) at least. Infinite where nothing
        happens up to the limit; beyond it only what is known of all that is asked. The path kept
        for `level` leads to the end u; if ends of several leaves coincide, to one of them.
    """
    entry_t, entry_ref, rays = scratch.entry_t, scratch.entry_ref, scratch.rays
    paths, small, frames, limits = scratch.paths, scratch.small, scratch.frames, scratch.limits
    entries = scratch.entries
    if level + 4 >= MAX_DEPTH or base >= STACK - 2 * WIDTH:
        return UNDECIDED, t, False
    precision = load_precision(small, PRECISION)
    beyond = t + tolerance(t, precision)
    alone = code & 7 == OPERATION
    frame = 0
    kept = PATH * (level + 1)
    paths[kept] = 0
    nearest = math.inf
    tied = False
    far = limit
    top = base
    present = -1
    at_level = level
    about = choose_beginning(entry, t)
    slabs = make_slabs(ray, about, scratch.slabs)
    store_ray(rays, level, ray, about)
    while True:
        kind = code & 7
        index = code >> 3
        found = False
        returns = False
        state = 0
        u = nearest
        if kind <= SUSPENDED:
            block = index
            if kind != BLOCK or at_level != present:
                ray = load_ray(rays, at_level)
                about = load_beginning(rays, at_level)
                present = at_level
                if kind != BLOCK:
                    if at_level + 4 >= MAX_DEPTH:
                        return UNDECIDED, t, False
                    paths[at_level] = index
                    ray = transform_ray(load_affine(trees.inverses, 12 * index), ray)
                    present = at_level + 1
                    about = choose_beginning(entry, t)
                    store_ray(rays, present, ray, about)
                    block = wide(trees.targets[index])
                    if kind == SUSPENDED:
                        block = wide(find_expansion(scratch, block))
                        if block < 0:
                            return UNDECIDED, t, False
                    scratch.frames[VISITS + 1] += 1
                slabs = make_slabs(ray, about, scratch.slabs)
            scratch.frames[VISITS] += 1
            met = meet_block(trees.boxes, block, slabs, t, far, scratch.slabs, scratch.entries)
            if met != NONE:
                if must_stop(scratch, top):
                    return UNDECIDED, t, False
                found = True
                code, entry, top = push_references(
                    trees.refs, block, met, entries, slabs, entry_t, entry_ref, present, top, True
                )
                at_level = present
        elif kind in (LEAF, SMALL):
            scratch.frames[VISITS + 2] += 1
            inner = load_ray(rays, at_level)
            n = cross_reference(trees, pool, scratch, kind, index, inner, t, far, ALL)
            if n == OVERFLOW:
                return UNDECIDED, t, False
            for k in range(ENDS, n, 2):
                lo, hi = small[k], small[k + 1]
                if hi <= t or is_touch(lo, hi):
                    continue
                # What ends where the question begins is over, unless it is thinner than that.
                if hi <= beyond and not (lo <= t and hi <= lo + tolerance(lo, precision)):
                    continue
                if lo <= beyond:
                    keep_surface(trees, scratch, at_level, kind, index, k + 1, kept)
                    state = 1
                    u = hi
                    returns = True
                    break
                e = tolerance(lo, precision)
                coincides = nearest - e <= lo <= nearest + e
                tied = tied or coincides
                if lo < nearest - e or (coincides and comes_first(paths, at_level, index, kept)):
                    nearest = lo
                    far = min(limit, nearest + e)
                    keep_surface(trees, scratch, at_level, kind, index, k, kept)
                break
        elif kind == OPERATION:
            # Its first operand is asked next; a frame waits for the answer.
            target = wide(trees.targets[index])
            if trees.operations[target + 2] == 1 or at_level + 6 >= MAX_DEPTH:
                return UNDECIDED, t, False
            inner = load_ray(rays, at_level)
            inner = transform_ray(load_affine(trees.inverses, 12 * index), inner)
            paths[at_level] = index
            paths[at_level + 1] = -1
            at = FRAME * frame
            frames[at], frames[at + 1], frames[at + 2] = target, 0, at_level
            frames[at + 3], frames[at + 4], frames[at + 5] = base, kept, top
            at = LIMITS * frame
            limits[at], limits[at + 1], limits[at + 2] = limit, far, nearest
            limits[at + 3], limits[at + 4] = math.inf, math.inf
            frame += 1
            at_level += 2
            kept = PATH * (at_level + 1)
            paths[kept] = 0
            base = top
            limit = far
            nearest = math.inf
            present = -1
            store_ray(rays, at_level, inner, choose_beginning(entry, t))
            code = wide(trees.operations[target + 3]) << 3 | BLOCK
            continue
        while not found:
            if not returns:
                while top > base:
                    top -= 1
                    entry = entry_t[top]
                    if entry <= far:
                        code = entry_ref[top] >> 8
                        at_level = entry_ref[top] & 255
                        found = True
                        break
                if found:
                    break
                state = 0
                # Beyond the limit something else may come first, if there is anything else.
                u = nearest if nearest <= limit or (alone and frame == 0) else math.inf
            # A group has answered (state, u): to the caller, or to the operation that asked.
            if frame == 0:
                return state, u, tied
            at = FRAME * (frame - 1)
            target, done, at_level = frames[at], frames[at + 1] + 1, frames[at + 2]
            own = PATH * (at_level + 2)
            at_limits = LIMITS * (frame - 1)
            far = limits[at_limits + 1]
            until = limits[at_limits + 3]
            subtracted = trees.operations[target] == _DIFFERENCE and done > 1
            # Where nothing happens up to the limit, the operation stays as it is until an operand
            # before it ends. Where the solid may begin, an end that another leaf goes on beyond
            # does not count, so of two that coincide it is the one just found.
            decided = (state == 1) == subtracted
            e = tolerance(u, precision)
            coincides = until - e <= u <= until + e and u < math.inf
            tied = tied or coincides
            if u < until - e or (decided and coincides):
                until = u
                copy_path(paths, kept, own)
            if not u < math.inf:
                limits[at_limits + 4] = far
            if not decided and done < trees.operations[target + 1]:
                frames[at + 1] = done
                limits[at_limits + 3] = until
                paths[at_level + 1] = -1 - done
                at_level += 2
                paths[kept] = 0
                top = base
                limit = min(far, until + tolerance(until, precision))
                far = limit
                nearest = math.inf
                present = -1
                code = wide(trees.operations[target + 3 + done]) << 3 | BLOCK
                found = True
                break
            known = math.inf if decided and u < math.inf else limits[at_limits + 4]
            if until > known:
                # An operand is known up to the limit only, whatever others do behind it.
                until = math.inf
            frame -= 1
            base, kept, top = frames[at + 3], frames[at + 4], frames[at + 5]
            limit, nearest = limits[LIMITS * frame], limits[LIMITS * frame + 2]
            present = -1
            returns = not decided
            if returns and not until < math.inf and far < limit:
                # It was asked no farther than to where a leaf beside it begins. That matters no
                # longer, because the operation is there at t: until where, up to the limit?
                far = limit
                returns = False
                found = True
                entry = t
                code = wide(paths[at_level]) << 3 | OPERATION
            elif returns:
                state = 1
                u = until
                copy_path(paths, own, kept)
            else:
                e = tolerance(until, precision)
                coincides = nearest - e <= until <= nearest + e and until < math.inf
                tied = tied or coincides
                if until < nearest - e or (coincides and precedes(paths, own, kept)):
                    nearest = until
                    far = min(limit, nearest + e)
                    copy_path(paths, own, kept)


@njit
def meets_subtracted(trees: Trees, paths: NDArray[np.int32], at: int) -> bool:
    """Return whether a kept path leads through a subtracted operand."""
    for k in range(2, paths[at] + 1):
        step = paths[at + k]
        if SLOT < step < -1:
            operation = trees.targets[paths[at + k - 1]]
            if trees.operations[operation] == _DIFFERENCE:
                return True
    return False
