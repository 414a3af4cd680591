"""Rays through blocks: the fast engine.

Ordered traversal of wide blocks; an instance maps the ray into its group's frame and goes on
at its first block. Below unions only, t shrinks to the first crossing; an operation is stepped
through by questions (`question`).

What needs whole lists (rays that start on a surface, sheets under an operation) is left to the
walker: `UNDECIDED`. Rays that start in a solid are stepped out of it by questions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.slabs import make_slabs, meet_block
from pcsg.graph.operators import DIFFERENCE
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.leaf.registry import ANY, NO_PART, OVERFLOW, Pool
from pcsg.simd import stay_apart
from pcsg.trace.coverage import Coverage, draw_hit
from pcsg.trace.ends import (
    CUT,
    MAX_DEPTH,
    STAND_IN,
    area_of,
    begin_levels,
    go_down,
    middle_of,
    squared_size,
)
from pcsg.trace.groups import BLOCK, INSTANCE, LEAF, OPERATION, SMALL, SUSPENDED
from pcsg.trace.owner import find_owner
from pcsg.trace.precision import Extent, is_far, is_touch, load_precision, tolerance
from pcsg.trace.question import ask, meets_subtracted
from pcsg.trace.traversal import (
    ENDS,
    HIT,
    HIT_PATH,
    INSIDE,
    MISS,
    NONE,
    PART,
    PATH,
    PRECISION,
    STAND_INS,
    UNDECIDED,
    VISITS,
    Scratch,
    T,
    Trees,
    choose_beginning,
    comes_first,
    copy_path,
    cross_reference,
    find_expansion,
    is_sheet,
    keep_path,
    keep_surface,
    load_beginning,
    load_ray,
    must_stop,
    precedes,
    push_references,
    store_ray,
)
from pcsg.vec import Ray, Vec3, determinant, load_affine, transform_ray

_DIFFERENCE = DIFFERENCE.kind


class Cut(NamedTuple):
    """Where rays end that see a state smaller than their footprint.

    Attributes
    ----------
    cover
        Areas of states; `Coverage.leaves` are leaf records.
    of_reference : int32 (R,)
        Number in `cover` of what an instance leads to, NEVER, or STAND_IN.
    boxes : float32 (6 R,)
        Boxes of references, in the frame of their group.
    sizes : float64 (3 R,)
        Squares of their sides; infinite where recursion does not end.
    goes_on : bool (R,)
        Whether recursion may end below a reference.
    linear : float64 (LEVEL MAX_DEPTH,)
        Working space of one thread, see `ends`.
    numbers, box : float64 (8,), (6,)
        Working space.
    """

    cover: Coverage
    of_reference: NDArray[np.int32]
    boxes: NDArray[np.float32]
    sizes: NDArray[np.float64]
    goes_on: NDArray[np.bool_]
    linear: NDArray[np.float64]
    numbers: NDArray[np.float64]
    box: NDArray[np.float64]


@njit
def _meet_end(
    trees: Trees, cut: Cut, index: int, ray: Ray, level: int, low: float, far: float
) -> tuple[float, int]:
    """Draw whether a state that is too small stops a ray that meets its box.

    Returns
    -------
    t, hit
        Where, and the hit that stands for it, -1 for none.
    """
    middle = middle_of(cut.box, ray)
    if not low <= middle <= far:
        return middle, -1
    inverse = load_affine(trees.inverses, 12 * index)
    # Volumes, and lengths along the ray, tell how areas across it change with the frame.
    area = abs(determinant(inverse)) * area_of(cut.box, ray)
    inner = transform_ray(inverse, ray)
    state = cut.of_reference[index]
    hit = draw_hit(cut.cover, state, inner, area, ray, cut.linear, level, cut.numbers)
    return middle, hit


@njit(contract=True, inline=True)
def find_first(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    root: int,
    extent: Extent,
    want: int,
    world: Ray,
    cut: Cut | None,
    width: float,
    spread: float,
) -> int:
    """Find the first crossing of a ray in [tmin, tmax], whose precision is in the scratch.

    Parameters
    ----------
    root, extent
        First block of the axiom's group, and where its boxes are.
    want
        FIRST, or ANY for any crossing.
    cut, width, spread
        Where recursion ends below the ray's footprint ``width + spread t``; None for nowhere.

    Returns
    -------
    int
        HIT (`small[T]` is t and the path at `HIT_PATH` leads to the leaf), MISS, INSIDE where the
        ray starts in a solid, or UNDECIDED where only lists can tell.
    """
    entry_t, entry_ref, rays = scratch.entry_t, scratch.entry_ref, scratch.rays
    paths, small, entries = scratch.paths, scratch.small, scratch.entries
    ray = world
    precision = load_precision(small, PRECISION)
    touch = world.tmin + tolerance(world.tmin, precision)
    near = world.tmin - 2.0 * tolerance(world.tmin, precision)
    best = world.tmax
    far = best
    hit = MISS
    top = 0
    present = 0
    at_level = 0
    code = wide(root) << 3 | BLOCK
    paths[HIT_PATH] = 0
    ordered = want != ANY
    entry = near
    about = 0.0
    if is_far(ray, extent):
        about = choose_beginning(approach(ray, extent.middle), near)
    store_ray(rays, 0, ray, about)
    slabs = make_slabs(ray, about, scratch.slabs)
    if cut is not None:
        begin_levels(cut.linear)
    while True:
        kind = code & 7
        index = code >> 3
        found = False
        ends = False
        shown = 0
        if cut is not None and kind in (INSTANCE, SUSPENDED):
            footprint = width + spread * max(entry, 0.0)
            ends = squared_size(cut.linear, at_level, cut.sizes, index) < footprint * footprint
            if ends and cut.of_reference[place(index)] == STAND_IN:
                ends = False
                shown = scratch.frames[place(STAND_INS)]
            if ends:
                for k in range(6):
                    cut.box[k] = cut.boxes[6 * index + k]
                ray = load_ray(rays, at_level)
                present = -1
                paths[place(at_level)] = index
                t, drawn = _meet_end(trees, cut, index, ray, at_level, world.tmin, far)
                e = tolerance(t, precision)
                if drawn >= 0 and (hit == MISS or t < best - e):
                    hit = HIT
                    best = t
                    far = min(world.tmax, best + e)
                    keep_path(paths, at_level + 1, CUT - drawn, HIT_PATH)
        if ends:
            pass
        elif kind <= SUSPENDED:
            block = index
            if kind != BLOCK or at_level != present:
                ray = load_ray(rays, at_level)
                about = load_beginning(rays, at_level)
                present = at_level
                if kind != BLOCK:
                    if at_level + 4 >= MAX_DEPTH:
                        return UNDECIDED
                    paths[place(at_level)] = index
                    inverse = load_affine(trees.inverses, 12 * index)
                    if cut is not None and cut.goes_on[place(index)]:
                        go_down(cut.linear, at_level, inverse)
                    ray = transform_ray(inverse, ray)
                    present = at_level + 1
                    about = choose_beginning(entry, near)
                    store_ray(rays, present, ray, about)
                    block = wide(trees.targets[place(index)])
                    if kind == SUSPENDED:
                        block = wide(find_expansion(scratch, shown + block))
                        if block < 0:
                            return UNDECIDED
                    scratch.frames[VISITS + 1] += 1
                slabs = make_slabs(ray, about, scratch.slabs)
            scratch.frames[VISITS] += 1
            met = meet_block(trees.boxes, block, slabs, near, far, scratch.slabs, scratch.entries)
            if met != NONE:
                if must_stop(scratch, top):
                    return UNDECIDED
                found = True
                code, entry, top = push_references(
                    trees.refs,
                    block,
                    met,
                    entries,
                    slabs,
                    entry_t,
                    entry_ref,
                    present,
                    top,
                    ordered,
                )
                at_level = present
        elif kind in (LEAF, SMALL):
            scratch.frames[VISITS + 2] += 1
            sheet = kind == LEAF and is_sheet(trees, index)
            inner = load_ray(rays, at_level, world.tmin if sheet else near, far)
            n = cross_reference(trees, pool, scratch, kind, index, inner, near, far, want)
            if n == OVERFLOW:
                return UNDECIDED
            for k in range(ENDS, n, 2):
                lo, hi = small[place(k)], small[place(k + 1)]
                if sheet:
                    if lo < world.tmin:
                        continue
                elif hi < near or is_touch(lo, hi):
                    continue
                elif lo <= touch:
                    return INSIDE if lo < near and hi > touch else UNDECIDED
                if lo > world.tmax:
                    break
                e = tolerance(lo, precision)
                if want == ANY:
                    hit = HIT
                elif (
                    hit == MISS
                    or lo < best - e
                    or (lo <= best + e and comes_first(paths, at_level, index, HIT_PATH))
                ):
                    hit = HIT
                    best = lo
                    far = min(world.tmax, best + e)
                    small[PART] = small[place(n)] if kind == LEAF else NO_PART
                    keep_surface(trees, scratch, at_level, kind, index, k, HIT_PATH)
                break
        elif kind == OPERATION:
            answer, t = step_operation(
                trees,
                pool,
                scratch,
                code,
                want,
                entry,
                top,
                at_level,
                touch,
                near,
                far,
                hit,
                best,
            )
            # Questions have prepared rays of their own for boxes.
            present = -1
            if answer == HIT:
                hit = HIT
                best = t
                far = min(world.tmax, best + tolerance(best, precision))
                small[PART] = NO_PART
            elif answer != MISS:
                return answer
        if hit == HIT and want == ANY:
            # Only a solid about the start could still hide it, which from infinity is anywhere.
            far = min(far, touch) if touch > -math.inf else far
        if not found:
            while top > 0:
                top -= 1
                entry = entry_t[place(top)]
                if entry <= far:
                    waits = entry_ref[place(top)]
                    code = waits >> 8
                    at_level = waits & 255
                    found = True
                    break
            if not found:
                small[T] = best
                return hit


@njit(inline=True)
def approach(ray: Ray, p: Vec3) -> float:
    """Return about where a ray comes nearest to a point; not finite where squares overflow."""
    along = (p.x - ray.ox) * ray.dx + (p.y - ray.oy) * ray.dy + (p.z - ray.oz) * ray.dz
    return along / (ray.dx * ray.dx + ray.dy * ray.dy + ray.dz * ray.dz)


@njit(contract=True)
def step_operation(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    code: int,
    want: int,
    entry: float,
    top: int,
    level: int,
    touch: float,
    near: float,
    far: float,
    hit: int,
    best: float,
) -> tuple[int, float]:
    """Step through an operation by questions, to the first crossing before the best one so far.

    Parameters
    ----------
    code, entry, level
        The reference to the operation, where the ray enters its box, and the level of the ray.
    want
        FIRST, or ANY: then nobody asks which leaf it is.
    top
        Where the free part of the stack begins.
    touch, near, far
        Where the ray begins, with what coincides with its beginning, and how far it matters.
    hit, best
        HIT if there is a hit so far, and where.

    Returns
    -------
    answer, t
        HIT with the t of a better one, whose path is then kept at `HIT_PATH`; MISS, INSIDE or
        UNDECIDED.
    """
    stay_apart()
    paths = scratch.paths
    precision = load_precision(scratch.small, PRECISION)
    ray = load_ray(scratch.rays, level)
    about = load_beginning(scratch.rays, level)
    entry = choose_beginning(entry, near)
    state, u, tied = ask(trees, pool, scratch, code, ray, near, far, entry, top, level)
    if state == UNDECIDED or u <= touch:
        return UNDECIDED, best
    if state == 1:
        return INSIDE, best
    held = PATH * (MAX_DEPTH - 1)
    answer = MISS
    # Whether a difference begins at t is asked of what is at t only; where it does not, one of the
    # subtracted mostly tells its end as well. What comes next is looked for where none does.
    probes = trees.operations[place(trees.targets[place(code >> 3)])] == _DIFFERENCE
    while state == 0 and u <= far and u < math.inf:
        t, unsure = u, tied
        if want != ANY:
            copy_path(paths, PATH * (level + 1), held)
        probe = min(far, t + 2.0 * tolerance(t, precision)) if probes else far
        state, u, tied = ask(trees, pool, scratch, code, ray, t, probe, t, top, level)
        if probes and state == 0 and not u < math.inf:
            state, u, tied = ask(trees, pool, scratch, code, ray, t, far, t, top, level)
        if state == UNDECIDED:
            return UNDECIDED, best
        if want == ANY and state == 1:
            best = t
            answer = HIT
            break
        # Of what is taken away, a question tells the end of any part that covers its place.
        if state == 1 and (unsure or meets_subtracted(trees, paths, held)):
            before, behind, t = find_owner(trees, pool, scratch, code, ray, t, top, level, False)
            if before != 0 or behind != 1:
                return UNDECIDED, best
            copy_path(paths, PATH * (level + 1), held)
        e = tolerance(t, precision)
        if state == 1 and (
            hit == MISS or t < best - e or (t <= best + e and precedes(paths, held, HIT_PATH))
        ):
            copy_path(paths, held, HIT_PATH)
            best = t
            answer = HIT
            break
    # Questions have left rays of their own at this level.
    store_ray(scratch.rays, level, ray, about)
    return answer, best


@njit(contract=True)
def find_exit(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    root: int,
    want: int,
    world: Ray,
) -> int:
    """Find where a ray that starts in a solid leaves the union in [tmin, tmax].

    Arguments and answers as for `find_first`, without INSIDE; for ANY there is no path.
    """
    stay_apart()
    precision = load_precision(scratch.small, PRECISION)
    code = wide(root) << 3 | BLOCK
    t = world.tmin - 2.0 * tolerance(world.tmin, precision)
    touch = world.tmin + tolerance(world.tmin, precision)
    state, u, _ = ask(trees, pool, scratch, code, world, t, world.tmax, t, 0, 0)
    if state != 1 or u <= touch:
        return UNDECIDED
    while state == 1 and u <= world.tmax and u < math.inf:
        t = u
        # Mostly nothing else is there, and nobody asks what comes next.
        probe = min(world.tmax, t + 2.0 * tolerance(t, precision))
        state, u, _ = ask(trees, pool, scratch, code, world, t, probe, t, 0, 0)
        if state == 1:
            # Of two solids that touch and a sheet between them it depends on the text what stays.
            before, _, _ = find_owner(trees, pool, scratch, code, world, t, 0, 0, True)
            if before == UNDECIDED:
                return UNDECIDED
            state, u, _ = ask(trees, pool, scratch, code, world, t, world.tmax, t, 0, 0)
    if state != 0:
        return MISS if state == 1 else UNDECIDED
    if want != ANY:
        # A question tells the end of any part that covers its place.
        before, behind, t = find_owner(trees, pool, scratch, code, world, t, 0, 0, False)
        if before != 1 or behind != 0:
            return UNDECIDED
        copy_path(scratch.paths, PATH, HIT_PATH)
        scratch.small[T], scratch.small[PART] = t, NO_PART
    return HIT
