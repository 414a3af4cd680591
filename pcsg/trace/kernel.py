"""Rays through blocks: the fast engine.

Ordered traversal of four-wide blocks; an instance maps the ray into its group's frame and goes on
at its first block. Below unions only, t shrinks to the first crossing. An operation is asked a
stateless question (section 4 of ``docs/performance.md``): *is the solid there at t, and until
where does it stay so at least?* Its caller steps from answer to answer. Every question is an
ordinary ordered walk, so there are no lists and no limits, and operations may stand anywhere.

What needs whole lists (rays that start in or on a solid, sheets under an operation) is left to the
walker: `UNDECIDED`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import ALL, ANY, Pool
from pcsg.trace.groups import BLOCK, INSTANCE, LEAF, OPERATION, SMALL
from pcsg.trace.merge import tolerance
from pcsg.trace.simd import count_trailing_zeros, meet_boxes
from pcsg.trace.small import ENTRY, HEADER, small_crossings
from pcsg.vec import Ray, load_affine, transform_ray

MISS, HIT, INSIDE, UNDECIDED = 0, 1, 2, -1

MAX_DEPTH = 120
"""Levels of instances and operations; deeper rays are undecided."""

_STACK = 4_096
_PATH = MAX_DEPTH + 4
_FRAME = 6
SLOT = -1_000_000
"""In a path, ``SLOT - k`` stands before the reference of primitive k of a small operation."""

HIT_PATH = _PATH * (MAX_DEPTH + 1)
T, _ENDS = 4, 8
_DIFFERENCE = DIFFERENCE.kind
_U0, _U1, _U4, _U8, _U12, _U16, _U20, _U24 = (np.uint64(k) for k in (0, 1, 4, 8, 12, 16, 20, 24))
_TINY = 1e-200


class Trees(NamedTuple):
    """What traversal reads of `Blocks`; few arrays, because calls pass every one of them.

    Attributes
    ----------
    boxes, refs, inverses, targets
        As in `Blocks`.
    leaves : int32 (4 L,)
        Kind, first argument, whether it is a sheet, and node number of leaf records.
    args : float64
        Arguments of leaves.
    operations : int32
        Operator, number of operands, whether there are sheets below; then the operands' first
        blocks. A reference's target is the index of the first of these.
    smalls, tables
        As in `Blocks`.
    """

    boxes: NDArray[np.float64]
    refs: NDArray[np.int32]
    inverses: NDArray[np.float64]
    targets: NDArray[np.int32]
    leaves: NDArray[np.int32]
    args: NDArray[np.float64]
    operations: NDArray[np.int32]
    smalls: NDArray[np.int32]
    tables: NDArray[np.uint64]


class Scratch(NamedTuple):
    """Working space of one thread.

    Attributes
    ----------
    entry_t, entry_ref : float64, int64
        Stack of references that wait: where the ray enters them; code and level.
    rays : float64 (6 _PATH,)
        The ray at every level.
    paths : int32 (_PATH (_PATH + 2),)
        References on the way: an instance or an operation, then its operand as ``-1 - k``. Then,
        `_PATH` entries each, the paths to the ends that questions have found at every level, and
        to the first hit at `HIT_PATH`: the number of references first, the leaf's last.
    frames, limits : int64 (_FRAME MAX_DEPTH,), float64 (4 MAX_DEPTH,)
        Operations that wait for an operand's answer: place in `operations`, operands done, level,
        and stack base, kept path and stack top of the question that met it; its limit, how far it
        looked, its nearest end, and until where the operation stays as it is.
    slots : int32
        Primitives that the crossings of a small operation belong to.
    small : float64
        Where the ray enters the boxes of a block (4), the first hit's t, and from `_ENDS` on the
        crossings of one leaf.
    visits : int64 (3,)
        Blocks, instances and leaves visited so far.
    """

    entry_t: NDArray[np.float64]
    entry_ref: NDArray[np.int64]
    rays: NDArray[np.float64]
    paths: NDArray[np.int32]
    frames: NDArray[np.int64]
    limits: NDArray[np.float64]
    slots: NDArray[np.int32]
    small: NDArray[np.float64]
    visits: NDArray[np.int64]


def make_scratch() -> Scratch:
    """Return working space for one thread."""
    return Scratch(
        entry_t=np.zeros(_STACK),
        entry_ref=np.zeros(_STACK, np.int64),
        rays=np.zeros(6 * _PATH),
        paths=np.zeros(_PATH * (_PATH + 2), np.int32),
        frames=np.zeros(_FRAME * MAX_DEPTH, np.int64),
        limits=np.zeros(4 * MAX_DEPTH),
        slots=np.zeros(_ENDS + 64, np.int32),
        small=np.zeros(_ENDS + 64),
        visits=np.zeros(3, np.int64),
    )


@njit(inline=True)
def _wide(x: int) -> int:
    """Return an integer with 64 bits, wherever it comes from."""
    return np.int64(x)  # type: ignore[return-value]  # to numba it is an int


@njit(inline=True)
def _nonzero(d: float) -> float:
    """Keep a direction's component away from zero, so that planes are never NaN."""
    return d if abs(d) > _TINY else math.copysign(_TINY, d)


@njit(inline=True)
def _planes(ix: float, iy: float, iz: float) -> tuple[np.uint64, np.uint64, np.uint64]:
    """Return 0 or 12 for each axis: whether the ray meets the lower or the upper plane first."""
    return (
        _U12 if ix < 0.0 else _U0,
        _U12 if iy < 0.0 else _U0,
        _U12 if iz < 0.0 else _U0,
    )


@njit(inline=True)
def _store_ray(rays: NDArray[np.float64], level: int, ray: Ray) -> None:
    at = 6 * level
    for k in range(6):
        rays[at + k] = ray[k]


@njit(inline=True)
def _load_ray(rays: NDArray[np.float64], level: int) -> Ray:
    at = 6 * level
    return Ray(
        rays[at], rays[at + 1], rays[at + 2], rays[at + 3], rays[at + 4], rays[at + 5], 0.0, 0.0
    )


@njit
def _keep_path(paths: NDArray[np.int32], level: int, last: int, at: int) -> None:
    """Copy the present path down to a level, and its last reference."""
    paths[at] = level + 1
    for k in range(level):
        paths[at + 1 + k] = paths[k]
    paths[at + 1 + level] = last


@njit(inline=True)
def _crossings(trees: Trees, pool: Pool, scratch: Scratch, kind: int, index: int, ray: Ray) -> int:
    """Write the crossings of a leaf or a small operation to `Scratch.small` from `_ENDS` on."""
    inner = transform_ray(load_affine(trees.inverses, 12 * index), ray)
    target = _wide(trees.targets[index])
    if kind == LEAF:
        solid, args_at = trees.leaves[4 * target], trees.leaves[4 * target + 1]
        n: int = leaf_crossings(solid, inner, ALL, trees.args, args_at, pool, scratch.small, _ENDS)
        return n
    return small_crossings(
        trees.smalls,
        trees.tables,
        trees.inverses,
        trees.leaves,
        trees.args,
        pool,
        target,
        inner,
        scratch.small,
        _ENDS,
        scratch.slots,
    )


@njit
def _keep_surface(
    trees: Trees, scratch: Scratch, level: int, kind: int, index: int, k: int, at: int
) -> None:
    """Keep the path to the surface that crossing k belongs to."""
    paths = scratch.paths
    _keep_path(paths, level, index, at)
    if kind == SMALL:
        slot = scratch.slots[k - _ENDS]
        paths[at] = level + 3
        paths[at + 2 + level] = SLOT - slot
        entry = trees.targets[index] + HEADER + ENTRY * slot
        paths[at + 3 + level] = trees.smalls[entry]


@njit
def _copy_path(paths: NDArray[np.int32], source: int, target: int) -> None:
    for k in range(paths[source] + 1):
        paths[target + k] = paths[source + k]


@njit
def _comes_first(paths: NDArray[np.int32], level: int, last: int, at: int) -> bool:
    """Return whether the present path stands before a kept one in the text."""
    n = paths[at]
    for k in range(level + 1):
        mine = paths[k] if k < level else last
        if k >= n:
            return False
        theirs = paths[at + 1 + k]
        if mine != theirs:
            # Operands are written as -1 - k: the first one is the largest number.
            return bool(mine > theirs if mine < 0 else mine < theirs)
    return False


@njit
def _precedes(paths: NDArray[np.int32], a: int, b: int) -> bool:
    """Return whether one kept path stands before another one in the text."""
    for k in range(1, min(paths[a], paths[b]) + 1):
        mine, theirs = paths[a + k], paths[b + k]
        if mine != theirs:
            return bool(mine > theirs if mine < 0 else mine < theirs)
    return False


@njit(inline=True)
def _push(
    refs: NDArray[np.int32],
    block: int,
    met: np.uint64,
    entries: NDArray[np.float64],
    entry_t: NDArray[np.float64],
    entry_ref: NDArray[np.int64],
    level: int,
    top: int,
) -> tuple[int, int]:
    """Return the nearest reference that was met, and push the others, the nearest last."""
    base = 4 * block
    k = _wide(count_trailing_zeros(met))
    met &= met - _U1
    nearest_t = entries[k]
    nearest = _wide(refs[base + k])
    begin = top
    while met != _U0:
        k = _wide(count_trailing_zeros(met))
        met &= met - _U1
        t = entries[k]
        ref = _wide(refs[base + k])
        if t < nearest_t:
            t, nearest_t = nearest_t, t
            ref, nearest = nearest, ref
        p = top
        while p > begin and entry_t[p - 1] < t:
            entry_t[p] = entry_t[p - 1]
            entry_ref[p] = entry_ref[p - 1]
            p -= 1
        entry_t[p] = t
        entry_ref[p] = ref << 8 | level
        top += 1
    return nearest, top


@njit(contract=True)
def _ask(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    code: int,
    ray: Ray,
    t: float,
    limit: float,
    base: int,
    level: int,
) -> tuple[int, float]:
    """Ask whether the union of what a reference leads to is there at t, and until where.

    Parameters
    ----------
    code
        A block or an operation, in the ray's frame.
    limit
        Nothing beyond is of interest.
    base, level
        Where the free parts of the stack and of the levels begin.

    Returns
    -------
    state, u
        1 inside, 0 outside or `UNDECIDED`; it stays so on (t, u) at least. Infinite where nothing
        happens up to the limit. The path kept for `level` leads to the end u.
    """
    entry_t, entry_ref, rays = scratch.entry_t, scratch.entry_ref, scratch.rays
    paths, small, frames, limits = scratch.paths, scratch.small, scratch.frames, scratch.limits
    if level + 4 >= MAX_DEPTH or base >= _STACK - 64:
        return UNDECIDED, t
    beyond = t + tolerance(t)
    frame = 0
    kept = _PATH * (level + 1)
    paths[kept] = 0
    nearest = math.inf
    far = limit
    top = base
    present = -1
    at_level = level
    ix = iy = iz = sx = sy = sz = 0.0
    _store_ray(rays, level, ray)
    while True:
        kind = code & 7
        index = code >> 3
        found = False
        returns = False
        state = 0
        u = nearest
        if kind <= INSTANCE:
            block = index
            if kind == INSTANCE or at_level != present:
                ray = _load_ray(rays, at_level)
                present = at_level
                if kind == INSTANCE:
                    if at_level + 4 >= MAX_DEPTH:
                        return UNDECIDED, t
                    paths[at_level] = index
                    ray = transform_ray(load_affine(trees.inverses, 12 * index), ray)
                    present = at_level + 1
                    _store_ray(rays, present, ray)
                    block = _wide(trees.targets[index])
                    scratch.visits[1] += 1
                ix, iy = 1.0 / _nonzero(ray.dx), 1.0 / _nonzero(ray.dy)
                iz = 1.0 / _nonzero(ray.dz)
                sx, sy, sz = ray.ox * ix, ray.oy * iy, ray.oz * iz
            scratch.visits[0] += 1
            nx, ny, nz = _planes(ix, iy, iz)
            met = meet_boxes(
                trees.boxes,
                np.uint64(block) * _U24,
                nx,
                ny + _U4,
                nz + _U8,
                _U12 - nx,
                _U16 - ny,
                _U20 - nz,
                ix,
                iy,
                iz,
                sx,
                sy,
                sz,
                t,
                far,
                small,
            )
            if met != _U0:
                if top >= _STACK - 8:
                    return UNDECIDED, t
                found = True
                code, top = _push(trees.refs, block, met, small, entry_t, entry_ref, present, top)
                at_level = present
        elif kind in (LEAF, SMALL):
            scratch.visits[2] += 1
            n = _crossings(trees, pool, scratch, kind, index, _load_ray(rays, at_level))
            for k in range(_ENDS, n, 2):
                lo, hi = small[k], small[k + 1]
                if hi <= beyond or hi <= lo:
                    continue
                if lo <= beyond:
                    _keep_surface(trees, scratch, at_level, kind, index, k + 1, kept)
                    state = 1
                    u = hi
                    returns = True
                    break
                e = tolerance(lo)
                if lo < nearest - e or (
                    lo <= nearest + e and _comes_first(paths, at_level, index, kept)
                ):
                    nearest = lo
                    far = min(limit, nearest + e)
                    _keep_surface(trees, scratch, at_level, kind, index, k, kept)
                break
        elif kind == OPERATION:
            # Its first operand is asked next; a frame waits for the answer.
            target = _wide(trees.targets[index])
            if trees.operations[target + 2] == 1 or at_level + 6 >= MAX_DEPTH:
                return UNDECIDED, t
            inner = _load_ray(rays, at_level)
            inner = transform_ray(load_affine(trees.inverses, 12 * index), inner)
            paths[at_level] = index
            paths[at_level + 1] = -1
            at = _FRAME * frame
            frames[at], frames[at + 1], frames[at + 2] = target, 0, at_level
            frames[at + 3], frames[at + 4], frames[at + 5] = base, kept, top
            at = 4 * frame
            limits[at], limits[at + 1], limits[at + 2], limits[at + 3] = (
                limit,
                far,
                nearest,
                math.inf,
            )
            frame += 1
            at_level += 2
            kept = _PATH * (at_level + 1)
            paths[kept] = 0
            base = top
            limit = far
            nearest = math.inf
            present = -1
            _store_ray(rays, at_level, inner)
            code = _wide(trees.operations[target + 3]) << 3 | BLOCK
            continue
        while not found:
            if not returns:
                while top > base:
                    top -= 1
                    if entry_t[top] <= far:
                        code = entry_ref[top] >> 8
                        at_level = entry_ref[top] & 255
                        found = True
                        break
                if found:
                    break
                state = 0
                u = nearest
            # A group has answered (state, u): to the caller, or to the operation that asked.
            if frame == 0:
                return state, u
            at = _FRAME * (frame - 1)
            target, done, at_level = frames[at], frames[at + 1] + 1, frames[at + 2]
            own = _PATH * (at_level + 2)
            far = limits[4 * (frame - 1) + 1]
            until = limits[4 * (frame - 1) + 3]
            subtracted = trees.operations[target] == _DIFFERENCE and done > 1
            decided = False
            if state == 0 and not subtracted:
                # Outside an operand, the solid is outside for as long.
                decided = True
                until = u
                _copy_path(paths, kept, own)
            else:
                if u < until - tolerance(u):
                    until = u
                    _copy_path(paths, kept, own)
                decided = state == 1 and subtracted
            if not decided and done < trees.operations[target + 1]:
                frames[at + 1] = done
                limits[4 * (frame - 1) + 3] = until
                paths[at_level + 1] = -1 - done
                at_level += 2
                paths[kept] = 0
                top = base
                limit = min(far, until)
                far = limit
                nearest = math.inf
                present = -1
                code = _wide(trees.operations[target + 3 + done]) << 3 | BLOCK
                found = True
                break
            frame -= 1
            base, kept, top = frames[at + 3], frames[at + 4], frames[at + 5]
            limit, nearest = limits[4 * frame], limits[4 * frame + 2]
            present = -1
            returns = not decided
            if returns:
                state = 1
                u = until
                _copy_path(paths, own, kept)
            else:
                e = tolerance(until)
                if until < nearest - e or (until <= nearest + e and _precedes(paths, own, kept)):
                    nearest = until
                    far = min(limit, nearest + e)
                    _copy_path(paths, own, kept)


@njit
def _is_subtracted(trees: Trees, paths: NDArray[np.int32], at: int) -> bool:
    """Return whether a kept path leads through an odd number of subtracted operands."""
    odd = False
    for k in range(2, paths[at] + 1):
        step = paths[at + k]
        if SLOT < step < -1:
            operation = trees.targets[paths[at + k - 1]]
            odd = odd != (trees.operations[operation] == _DIFFERENCE)
    return odd


@njit(contract=True)
def _settle_exit(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    code: int,
    ray: Ray,
    t: float,
    base: int,
    level: int,
    state: int,
) -> tuple[bool, float]:
    """Find which of the leaves that end within rounding of t stands first in the text.

    A question takes the end of any leaf that covers its place; where leaves begin it takes the
    first in the text. So this asks from behind t, along the reversed ray.

    Parameters
    ----------
    code, base, level
        As for `_ask`.
    state
        1 if the solid is there behind t, else 0.

    Returns
    -------
    bool, t
        Whether the answer is sure, and where that leaf ends; the path kept for `level` leads to it.
    """
    e = tolerance(t)
    back = Ray(ray.ox, ray.oy, ray.oz, -ray.dx, -ray.dy, -ray.dz, 0.0, 0.0)
    at, limit = -t - 2.0 * e, -t + 3.0 * e
    there, u = _ask(trees, pool, scratch, code, back, at, limit, base, level)
    subtracted = _is_subtracted(trees, scratch.paths, _PATH * (level + 1))
    return there == state and u <= -t + 2.0 * e and subtracted == (state == 1), -u


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
        ray starts in a solid (ask `find_exit`), or UNDECIDED where only lists can tell.
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
    code = _wide(root) << 3 | BLOCK
    paths[HIT_PATH] = 0
    _store_ray(rays, 0, ray)
    ix, iy, iz = 1.0 / _nonzero(ray.dx), 1.0 / _nonzero(ray.dy), 1.0 / _nonzero(ray.dz)
    sx, sy, sz = ray.ox * ix, ray.oy * iy, ray.oz * iz
    while True:
        kind = code & 7
        index = code >> 3
        found = False
        if kind <= INSTANCE:
            block = index
            if kind == INSTANCE or at_level != present:
                ray = _load_ray(rays, at_level)
                present = at_level
                if kind == INSTANCE:
                    if at_level + 4 >= MAX_DEPTH:
                        return UNDECIDED
                    paths[at_level] = index
                    ray = transform_ray(load_affine(trees.inverses, 12 * index), ray)
                    present = at_level + 1
                    _store_ray(rays, present, ray)
                    block = _wide(trees.targets[index])
                    scratch.visits[1] += 1
                ix, iy = 1.0 / _nonzero(ray.dx), 1.0 / _nonzero(ray.dy)
                iz = 1.0 / _nonzero(ray.dz)
                sx, sy, sz = ray.ox * ix, ray.oy * iy, ray.oz * iz
            scratch.visits[0] += 1
            nx, ny, nz = _planes(ix, iy, iz)
            met = meet_boxes(
                trees.boxes,
                np.uint64(block) * _U24,
                nx,
                ny + _U4,
                nz + _U8,
                _U12 - nx,
                _U16 - ny,
                _U20 - nz,
                ix,
                iy,
                iz,
                sx,
                sy,
                sz,
                near,
                far,
                small,
            )
            if met != _U0:
                if top >= _STACK - 8:
                    return UNDECIDED
                found = True
                code, top = _push(trees.refs, block, met, small, entry_t, entry_ref, present, top)
                at_level = present
        elif kind in (LEAF, SMALL):
            scratch.visits[2] += 1
            n = _crossings(trees, pool, scratch, kind, index, _load_ray(rays, at_level))
            for k in range(_ENDS, n, 2):
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
                    or (lo <= best + e and _comes_first(paths, at_level, index, HIT_PATH))
                ):
                    hit = HIT
                    best = lo
                    far = min(world.tmax, best + e)
                    _keep_surface(trees, scratch, at_level, kind, index, k, HIT_PATH)
                break
        elif kind == OPERATION:
            ray = _load_ray(rays, at_level)
            state, u = _ask(trees, pool, scratch, code, ray, near, far, top, at_level)
            if state == UNDECIDED or u <= touch:
                return UNDECIDED
            if state == 1:
                return INSIDE
            held = _PATH * (MAX_DEPTH - 1)
            while state == 0 and u <= far and u < math.inf:
                t = u
                _copy_path(paths, _PATH * (at_level + 1), held)
                state, u = _ask(trees, pool, scratch, code, ray, t, far, top, at_level)
                if state == UNDECIDED:
                    return UNDECIDED
                if state == 1 and _is_subtracted(trees, paths, held):
                    sure, t = _settle_exit(trees, pool, scratch, code, ray, t, top, at_level, 1)
                    if not sure:
                        return UNDECIDED
                    _copy_path(paths, _PATH * (at_level + 1), held)
                e = tolerance(t)
                if state == 1 and (
                    hit == MISS
                    or t < best - e
                    or (t <= best + e and _precedes(paths, held, HIT_PATH))
                ):
                    hit = HIT
                    best = t
                    far = min(world.tmax, best + e)
                    _copy_path(paths, held, HIT_PATH)
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
    """Find where a ray that starts in a solid leaves the union, in [tmin, tmax].

    Arguments and result as for `find_first`.
    """
    paths = scratch.paths
    code = _wide(root) << 3 | BLOCK
    t = world.tmin - 2.0 * tolerance(world.tmin)
    touch = world.tmin + tolerance(world.tmin)
    state, u = _ask(trees, pool, scratch, code, world, t, world.tmax, 0, 0)
    if state != 1 or u <= touch:
        return UNDECIDED
    while state == 1 and u <= world.tmax:
        t = u
        _copy_path(paths, _PATH, HIT_PATH)
        if t == math.inf:
            return MISS
        state, u = _ask(trees, pool, scratch, code, world, t, world.tmax, 0, 0)
    if state == UNDECIDED:
        return UNDECIDED
    if state == 1:
        return MISS
    if not _is_subtracted(trees, paths, HIT_PATH):
        sure, t = _settle_exit(trees, pool, scratch, code, world, t, 0, 0, 0)
        if not sure or t > world.tmax:
            return UNDECIDED
        _copy_path(paths, _PATH, HIT_PATH)
    scratch.small[T] = t
    return HIT
