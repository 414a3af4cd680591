"""What every traversal of blocks is made of: its arrays, the ray against a block, paths.

A *path* is the list of references from the root to a surface: instances and operations, each
operation followed by its operand as ``-1 - k``, the leaf last. Paths compare as places in the text
do, so ties go to what stands first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.addresses import call_at
from pcsg.geometry.slabs import Slabs
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import Pool
from pcsg.simd import WIDTH, count_trailing_zeros
from pcsg.trace.ends import MAX_DEPTH
from pcsg.trace.groups import LEAF, SMALL
from pcsg.trace.small import ENTRY, HEADER, small_crossings
from pcsg.vec import Ray, load_affine, transform_ray

MISS, HIT, INSIDE, UNDECIDED = 0, 1, 2, -1

STACK = 4_096
PATH = MAX_DEPTH + 4
FRAME, LIMITS = 6, 5
VISITS = FRAME * MAX_DEPTH
"""Behind the frames: how many blocks, instances and leaves were visited so far."""

UNTIL = VISITS + 3
"""How many blocks may have been visited before the present ray has looked at too many."""

MOST_BLOCKS = 20_000_000
"""Blocks that one ray may visit: about a second. The walker tells what makes more of them."""

EXPANSION = 32
"""Visits to blocks that take as long as an expansion."""

EXPANDER, WORDS, IS_FULL, GENERATION, STAND_INS, MEMO = range(UNTIL + 1, UNTIL + 7)
"""Behind these, where states are suspended: the addresses of what expands them (`expand.cache`) and
of its words; whether there is little room left; the generation of all that has been expanded; how
many states there are; and for every state the generation of its expansion and its first block,
``generation << 32 | block``. What stands for state k has the number STAND_INS + k."""

SLOT = -1_000_000
"""In a path, ``SLOT - k`` stands before the reference of primitive k of a small operation."""

HIT_PATH = PATH * (MAX_DEPTH + 1)
T, PART, PRECISION, ENDS = 0, 1, 2, 4
"""In `Scratch.small`; `small_crossings` takes the precision from before the ends."""

NONE, _ONE, _TWO, _THREE, _EIGHT = (np.uint64(k) for k in (0, 1, 2, 3, 8))
_W = np.uint64(WIDTH)


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

    boxes: NDArray[np.float32]
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
    rays : float64 (8 PATH,)
        The ray at every level, and where it is near the level's boxes.
    paths : int32 (PATH (PATH + 2),)
        References on the way: an instance or an operation, then its operand as ``-1 - k``. Then,
        `PATH` entries each, the paths to the ends that questions have found at every level, and
        to the first hit at `HIT_PATH`: the number of references first, the leaf's last.
    frames, limits : int64 (MEMO + 2 N,), float64 (LIMITS MAX_DEPTH,)
        Operations that wait for an operand's answer: place in `operations`, operands done, level,
        and stack base, kept path and stack top of the question that met it; its limit, how far it
        looked, its nearest end, until where the operation stays as it is, and until where
        all operands are known. See `VISITS` and `MEMO` for what stands behind.
    slots : int32
        Primitives that the crossings of a small operation belong to.
    small : float64
        The first hit's t, the part that its leaf may have told, the ray's precision, and from
        `ENDS` on the crossings of one leaf.
    slabs : float32 (12,)
        The present ray prepared for boxes.
    entries : float32 (WIDTH,)
        Where the ray enters the boxes of a block.
    """

    entry_t: NDArray[np.float64]
    entry_ref: NDArray[np.int64]
    rays: NDArray[np.float64]
    paths: NDArray[np.int32]
    frames: NDArray[np.int64]
    limits: NDArray[np.float64]
    slots: NDArray[np.int32]
    small: NDArray[np.float64]
    slabs: NDArray[np.float32]
    entries: NDArray[np.float32]


def make_scratch(suspended: int = 0) -> Scratch:
    """Return working space for one thread, and so many suspended states."""
    frames = np.zeros(MEMO + 2 * suspended, np.int64)
    frames[STAND_INS] = suspended
    # Memos of generation 0 are none.
    frames[GENERATION] = 1
    frames[UNTIL] = MOST_BLOCKS
    return Scratch(
        entry_t=np.zeros(STACK),
        entry_ref=np.zeros(STACK, np.int64),
        rays=np.zeros(8 * PATH),
        paths=np.zeros(PATH * (PATH + 2), np.int32),
        frames=frames,
        limits=np.zeros(LIMITS * MAX_DEPTH),
        slots=np.zeros(ENDS + 64, np.int32),
        small=np.zeros(ENDS + 65),
        slabs=np.zeros(12, np.float32),
        entries=np.zeros(WIDTH, np.float32),
    )


@njit(inline=True)
def choose_beginning(entry: float, low: float) -> float:
    """Return where to count from among boxes that a ray enters at `entry`, but not before `low`."""
    about = entry if entry > low else low
    return about if abs(about) < math.inf else 0.0


@njit(inline=True)
def store_ray(rays: NDArray[np.float64], level: int, ray: Ray, about: float) -> None:
    """Keep the ray of a level, and where it is near the level's boxes."""
    at = place(8 * level)
    rays[at], rays[at + _ONE], rays[at + _TWO] = ray.ox, ray.oy, ray.oz
    at += _THREE
    rays[at], rays[at + _ONE], rays[at + _TWO] = ray.dx, ray.dy, ray.dz
    rays[at + _THREE] = about


@njit(inline=True)
def load_ray(rays: NDArray[np.float64], level: int, low: float = 0.0, high: float = 0.0) -> Ray:
    """Return the ray of a level; where limits matter, with these."""
    a = place(8 * level)
    b = a + _THREE
    return Ray(
        rays[a],
        rays[a + _ONE],
        rays[a + _TWO],
        rays[b],
        rays[b + _ONE],
        rays[b + _TWO],
        low,
        high,
    )


@njit(inline=True)
def load_beginning(rays: NDArray[np.float64], level: int) -> float:
    """Return where the ray of a level is near the level's boxes."""
    return rays[place(8 * level + 6)]  # type: ignore[no-any-return]


@njit
def find_expansion(scratch: Scratch, suspended: int) -> int:
    """Return the first block of what a suspended state comes to, expanded if it has not been.

    -1 where that is not possible; the walker tells why.
    """
    frames = scratch.frames
    memo = frames[MEMO + suspended]
    if memo >> 32 == frames[GENERATION]:
        return wide(memo & 0xFFFFFFFF)
    frames[UNTIL] -= EXPANSION
    return call_at(frames[EXPANDER], frames[WORDS], suspended)  # type: ignore[no-any-return]


@njit(inline=True)
def begin_batch(scratch: Scratch) -> None:
    """Forget that a ray of another call has looked too far."""
    scratch.frames[UNTIL] = scratch.frames[VISITS] + MOST_BLOCKS


@njit(inline=True)
def begin_ray(scratch: Scratch) -> None:
    """Let a ray visit `MOST_BLOCKS` from now on; forget expansions if there is little room left.

    Rays behind one that has looked too far stop at once: the walker will tell of it.
    """
    frames = scratch.frames
    if frames[place(VISITS)] <= frames[place(UNTIL)]:
        frames[place(UNTIL)] = frames[place(VISITS)] + MOST_BLOCKS
    if frames[place(IS_FULL)] != 0:
        call_at(frames[place(EXPANDER)], frames[place(WORDS)], -1)


@njit(inline=True)
def must_stop(scratch: Scratch, top: int) -> bool:
    """Return whether the stack has no room for a block's references, or the ray looks too far."""
    return top >= STACK - WIDTH or scratch.frames[VISITS] > scratch.frames[UNTIL]


@njit
def keep_path(paths: NDArray[np.int32], level: int, last: int, at: int) -> None:
    """Copy the present path down to a level, and its last reference."""
    paths[at] = level + 1
    for k in range(level):
        paths[at + 1 + k] = paths[k]
    paths[at + 1 + level] = last


@njit(inline=True)
def is_sheet(trees: Trees, index: int) -> bool:
    """Return whether a reference to a leaf leads to a sheet."""
    return bool(trees.leaves[place(4 * wide(trees.targets[place(index)]) + 2)] == 1)


@njit(inline=True)
def cross_reference(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    kind: int,
    index: int,
    ray: Ray,
    low: float,
    high: float,
    want: int,
) -> int:
    """Write the crossings of a leaf or a small operation to `Scratch.small` from `ENDS` on.

    A small operation needs all of them, whatever is wanted, but leaves out what lies before `low`
    or beyond `high`, if it likes.
    """
    inner = transform_ray(load_affine(trees.inverses, 12 * index), ray)
    target = wide(trees.targets[place(index)])
    if kind == LEAF:
        at = place(4 * target)
        solid, args_at = trees.leaves[at], trees.leaves[at + _ONE]
        n: int = leaf_crossings(solid, inner, want, trees.args, args_at, pool, scratch.small, ENDS)
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
        low,
        high,
        scratch.small,
        ENDS,
        scratch.slots,
    )


@njit
def keep_surface(
    trees: Trees, scratch: Scratch, level: int, kind: int, index: int, k: int, at: int
) -> None:
    """Keep the path to the surface that crossing k belongs to."""
    paths = scratch.paths
    keep_path(paths, level, index, at)
    if kind == SMALL:
        slot = scratch.slots[k - ENDS]
        paths[at] = level + 3
        paths[at + 2 + level] = SLOT - slot
        entry = trees.targets[index] + HEADER + ENTRY * slot
        paths[at + 3 + level] = trees.smalls[entry]


@njit
def copy_path(paths: NDArray[np.int32], source: int, target: int) -> None:
    """Copy a kept path."""
    for k in range(paths[source] + 1):
        paths[target + k] = paths[source + k]


@njit
def comes_first(paths: NDArray[np.int32], level: int, last: int, at: int) -> bool:
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
def precedes(paths: NDArray[np.int32], a: int, b: int) -> bool:
    """Return whether one kept path stands before another one in the text."""
    for k in range(1, min(paths[a], paths[b]) + 1):
        mine, theirs = paths[a + k], paths[b + k]
        if mine != theirs:
            return bool(mine > theirs if mine < 0 else mine < theirs)
    return False


@njit(inline=True)
def push_references(
    refs: NDArray[np.int32],
    block: int,
    met: np.uint64,
    entries: NDArray[np.float32],
    slabs: Slabs,
    entry_t: NDArray[np.float64],
    entry_ref: NDArray[np.int64],
    level: int,
    top: int,
    ordered: bool,
) -> tuple[int, float, int]:
    """Push the references that were met, the nearest last, but return the nearest itself.

    Where the order does not matter, any one comes last, and another one is returned.

    Returns
    -------
    code, entry, top
        The nearest one and where the ray enters its box; the new end of the stack.
    """
    base = place(block) * _W
    k = count_trailing_zeros(met)
    met &= met - _ONE
    nearest_t = slabs.about + entries[k] * slabs.slowness
    nearest = wide(refs[base + k])
    if met == NONE:
        return nearest, nearest_t, top
    begin = place(top)
    end = begin
    if not ordered:
        while met != NONE:
            entry_t[end] = nearest_t
            entry_ref[end] = nearest << 8 | level
            end += _ONE
            k = count_trailing_zeros(met)
            met &= met - _ONE
            nearest_t = slabs.about + entries[k] * slabs.slowness
            nearest = wide(refs[base + k])
        return nearest, nearest_t, wide(end)
    while met != NONE:
        k = count_trailing_zeros(met)
        met &= met - _ONE
        t = slabs.about + entries[k] * slabs.slowness
        ref = wide(refs[base + k])
        if t < nearest_t:
            t, nearest_t = nearest_t, t
            ref, nearest = nearest, ref
        p = end
        while p > begin and entry_t[p - _ONE] < t:
            entry_t[p] = entry_t[p - _ONE]
            entry_ref[p] = entry_ref[p - _ONE]
            p -= _ONE
        entry_t[p] = t
        entry_ref[p] = ref << 8 | level
        end += _ONE
    return nearest, nearest_t, wide(end)
