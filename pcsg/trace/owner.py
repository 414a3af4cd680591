"""Which leaf a surface belongs to, where ends of several coincide.

Questions (`question`) tell that a solid begins or ends at t, but not always by which leaf: a union
answers with the end of any leaf that covers its place, and an operation tells of ends at which it
stays as it is. So memberships before and behind t are worked out once more, from the leaves up, of
the little that stands there. `small` does the same for its tables.
"""

from __future__ import annotations

from pcsg.geometry.slabs import make_slabs, meet_block
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.registry import ALL, OVERFLOW, Pool
from pcsg.trace.ends import MAX_DEPTH
from pcsg.trace.groups import BLOCK, LEAF, OPERATION, SMALL, SUSPENDED
from pcsg.trace.merge import TABLES, truth
from pcsg.trace.precision import is_touch, load_precision, tolerance
from pcsg.trace.traversal import (
    ENDS,
    FRAME,
    LIMITS,
    NONE,
    PATH,
    PRECISION,
    UNDECIDED,
    VISITS,
    Scratch,
    Trees,
    comes_first,
    copy_path,
    cross_reference,
    find_expansion,
    is_sheet,
    keep_surface,
    load_ray,
    must_stop,
    precedes,
    push_references,
    store_ray,
)
from pcsg.vec import Ray, load_affine, transform_ray


@njit(contract=True)
def find_owner(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    code: int,
    ray: Ray,
    t: float,
    base: int,
    level: int,
    whole: bool,
) -> tuple[int, int, float]:
    """Find which leaf the surface of a solid at t belongs to.

    Of a union it is the first one in the text that begins or ends there, of an operation that of
    the first operand which does.

    Parameters
    ----------
    code, base, level
        As for `question.ask`.
    whole
        Whether a sheet counts though the solid is there before and behind.

    Returns
    -------
    before, behind, u
        Whether the solid is there before and behind all that coincides with t; `UNDECIDED` twice
        where that is not known, or where a sheet is. Where the two differ, the path kept for
        `level` leads to the leaf, whose own crossing is at u.
    """
    entry_t, entry_ref, rays = scratch.entry_t, scratch.entry_ref, scratch.rays
    paths, small, frames, limits = scratch.paths, scratch.small, scratch.frames, scratch.limits
    precision = load_precision(small, PRECISION)
    low, high = t - 2.0 * tolerance(t, precision), t + 2.0 * tolerance(t, precision)
    frame = 0
    kept = PATH * (level + 1)
    paths[kept] = 0
    before = behind = 0
    u = t
    top = base
    present = -1
    at_level = level
    # Boxes are counted from the window's beginning: before t it might be infinite in single
    # precision, and then all boxes would seem to be met.
    slabs = make_slabs(ray, low, scratch.slabs)
    store_ray(rays, level, ray, low)
    while True:
        kind = code & 7
        index = code >> 3
        found = False
        if kind <= SUSPENDED:
            block = index
            if kind != BLOCK or at_level != present:
                ray = load_ray(rays, at_level)
                present = at_level
                if kind != BLOCK:
                    if at_level + 4 >= MAX_DEPTH:
                        return UNDECIDED, UNDECIDED, t
                    paths[at_level] = index
                    ray = transform_ray(load_affine(trees.inverses, 12 * index), ray)
                    present = at_level + 1
                    store_ray(rays, present, ray, low)
                    block = wide(trees.targets[index])
                    if kind == SUSPENDED:
                        block = wide(find_expansion(scratch, block))
                        if block < 0:
                            return UNDECIDED, UNDECIDED, t
                    scratch.frames[VISITS + 1] += 1
                slabs = make_slabs(ray, low, scratch.slabs)
            scratch.frames[VISITS] += 1
            met = meet_block(trees.boxes, block, slabs, low, high, scratch.slabs, scratch.entries)
            if met != NONE:
                if must_stop(scratch, top):
                    return UNDECIDED, UNDECIDED, t
                found = True
                refs, entries = trees.refs, scratch.entries
                code, _, top = push_references(
                    refs, block, met, entries, slabs, entry_t, entry_ref, present, top, False
                )
                at_level = present
        elif kind in (LEAF, SMALL):
            scratch.frames[VISITS + 2] += 1
            inner = load_ray(rays, at_level)
            n = cross_reference(trees, pool, scratch, kind, index, inner, low, high, ALL)
            if n == OVERFLOW:
                return UNDECIDED, UNDECIDED, t
            was, now, surface = 0, 0, ENDS
            sheet = kind == LEAF and is_sheet(trees, index)
            for k in range(ENDS, n, 2):
                lo, hi = small[k], small[k + 1]
                if lo > high:
                    break
                if sheet and lo >= low:
                    # Whichever stands first in the text is seen: lists can tell.
                    return UNDECIDED, UNDECIDED, t
                if hi < low or is_touch(lo, hi):
                    continue
                if lo < low:
                    was = 1
                    surface = k + 1
                if hi > high:
                    now = 1
                    if lo >= low:
                        surface = k
            before |= was
            behind |= now
            if was != now and (paths[kept] == 0 or comes_first(paths, at_level, index, kept)):
                u = small[surface]
                keep_surface(trees, scratch, at_level, kind, index, surface, kept)
        elif kind == OPERATION:
            # Its first operand is asked next; a frame waits for the answer.
            target = wide(trees.targets[index])
            if trees.operations[target + 2] == 1 or at_level + 6 >= MAX_DEPTH:
                return UNDECIDED, UNDECIDED, t
            inner = load_ray(rays, at_level)
            inner = transform_ray(load_affine(trees.inverses, 12 * index), inner)
            paths[at_level] = index
            paths[at_level + 1] = -1
            at = FRAME * frame
            frames[at], frames[at + 1], frames[at + 2] = target, 0, at_level
            frames[at + 3], frames[at + 4], frames[at + 5] = base, kept, top
            at = LIMITS * frame
            limits[at], limits[at + 1], limits[at + 2] = before, behind, u
            frame += 1
            at_level += 2
            kept = PATH * (at_level + 1)
            paths[kept] = 0
            base = top
            before = behind = 0
            present = -1
            store_ray(rays, at_level, inner, low)
            code = wide(trees.operations[target + 3]) << 3 | BLOCK
            continue
        while not found:
            if top > base and (whole or not (before == 1 and behind == 1)):
                top -= 1
                code = entry_ref[top] >> 8
                at_level = entry_ref[top] & 255
                break
            # A group has answered: to the caller, or to the operation that asked.
            if frame == 0:
                return before, behind, u
            at = FRAME * (frame - 1)
            target, done, at_level = frames[at], frames[at + 1] + 1, frames[at + 2]
            own = PATH * (at_level + 2)
            at_limits = LIMITS * (frame - 1)
            changed = False
            if done > 1:
                table = TABLES[trees.operations[target]]
                was, now = wide(limits[at_limits + 3]) >> 1, wide(limits[at_limits + 3]) & 1
                changed = was != now
                before, behind = truth(table, was, before), truth(table, now, behind)
            if before != behind and not changed:
                copy_path(paths, kept, own)
                limits[at_limits + 4] = u
            if done < trees.operations[target + 1] and before + behind > 0:
                frames[at + 1] = done
                limits[at_limits + 3] = 2 * before + behind
                paths[at_level + 1] = -1 - done
                at_level += 2
                paths[kept] = 0
                top = base
                before = behind = 0
                present = -1
                code = wide(trees.operations[target + 3 + done]) << 3 | BLOCK
                break
            frame -= 1
            base, kept, top = frames[at + 3], frames[at + 4], frames[at + 5]
            was, now, u = (
                wide(limits[at_limits]),
                wide(limits[at_limits + 1]),
                limits[at_limits + 2],
            )
            present = -1
            if before != behind and (paths[kept] == 0 or precedes(paths, own, kept)):
                u = limits[at_limits + 4]
                copy_path(paths, own, kept)
            before |= was
            behind |= now
