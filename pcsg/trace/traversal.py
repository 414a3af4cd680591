"""What every traversal of blocks is made of: its arrays, the ray against a block, paths.

A *path* is the list of references from the root to a surface: instances and operations, each
operation followed by its operand as ``-1 - k``, the leaf last. Paths compare as places in the text
do, so ties go to what stands first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings
from pcsg.leaf.registry import ALL, Pool
from pcsg.simd import count_trailing_zeros
from pcsg.slabs import wide
from pcsg.trace.groups import LEAF, SMALL
from pcsg.trace.small import ENTRY, HEADER, small_crossings
from pcsg.vec import Ray, load_affine, transform_ray

MISS, HIT, INSIDE, UNDECIDED = 0, 1, 2, -1

MAX_DEPTH = 120
"""Levels of instances and operations; deeper rays are undecided."""

STACK = 4_096
PATH = MAX_DEPTH + 4
FRAME = 6
SLOT = -1_000_000
"""In a path, ``SLOT - k`` stands before the reference of primitive k of a small operation."""

HIT_PATH = PATH * (MAX_DEPTH + 1)
T, ENDS = 4, 8
NONE, _U1 = np.uint64(0), np.uint64(1)


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
    rays : float64 (6 PATH,)
        The ray at every level.
    paths : int32 (PATH (PATH + 2),)
        References on the way: an instance or an operation, then its operand as ``-1 - k``. Then,
        `PATH` entries each, the paths to the ends that questions have found at every level, and
        to the first hit at `HIT_PATH`: the number of references first, the leaf's last.
    frames, limits : int64 (FRAME MAX_DEPTH,), float64 (4 MAX_DEPTH,)
        Operations that wait for an operand's answer: place in `operations`, operands done, level,
        and stack base, kept path and stack top of the question that met it; its limit, how far it
        looked, its nearest end, and until where the operation stays as it is.
    slots : int32
        Primitives that the crossings of a small operation belong to.
    small : float64
        Where the ray enters the boxes of a block (4), the first hit's t, and from `ENDS` on the
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
        entry_t=np.zeros(STACK),
        entry_ref=np.zeros(STACK, np.int64),
        rays=np.zeros(6 * PATH),
        paths=np.zeros(PATH * (PATH + 2), np.int32),
        frames=np.zeros(FRAME * MAX_DEPTH, np.int64),
        limits=np.zeros(4 * MAX_DEPTH),
        slots=np.zeros(ENDS + 64, np.int32),
        small=np.zeros(ENDS + 64),
        visits=np.zeros(3, np.int64),
    )


@njit(inline=True)
def store_ray(rays: NDArray[np.float64], level: int, ray: Ray) -> None:
    """Keep the ray of a level."""
    at = 6 * level
    for k in range(6):
        rays[at + k] = ray[k]


@njit(inline=True)
def load_ray(rays: NDArray[np.float64], level: int) -> Ray:
    """Return the ray of a level."""
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
def cross_reference(
    trees: Trees, pool: Pool, scratch: Scratch, kind: int, index: int, ray: Ray
) -> int:
    """Write the crossings of a leaf or a small operation to `Scratch.small` from `ENDS` on."""
    inner = transform_ray(load_affine(trees.inverses, 12 * index), ray)
    target = wide(trees.targets[index])
    if kind == LEAF:
        solid, args_at = trees.leaves[4 * target], trees.leaves[4 * target + 1]
        n: int = leaf_crossings(solid, inner, ALL, trees.args, args_at, pool, scratch.small, ENDS)
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
        ENDS,
        scratch.slots,
    )


@njit
def keep_surface(
    trees: Trees, scratch: Scratch, level: int, kind: int, index: int, k: int, at: int
) -> None:
    """Keep the path to the surface that crossing k belongs to."""
    paths = scratch.paths
    _keep_path(paths, level, index, at)
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
    entries: NDArray[np.float64],
    entry_t: NDArray[np.float64],
    entry_ref: NDArray[np.int64],
    level: int,
    top: int,
) -> tuple[int, int]:
    """Return the nearest reference that was met, and push the others, the nearest last."""
    base = 4 * block
    k = wide(count_trailing_zeros(met))
    met &= met - _U1
    nearest_t = entries[k]
    nearest = wide(refs[base + k])
    begin = top
    while met != NONE:
        k = wide(count_trailing_zeros(met))
        met &= met - _U1
        t = entries[k]
        ref = wide(refs[base + k])
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
