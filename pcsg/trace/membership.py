"""Points through blocks: which the solid contains.

A point is asked together with eight others about it, by the leaves' closed sets and the operators'
truth tables, which work on nine bits at once. Where they differ a surface is near, and whoever
follows the text to the last bit has to tell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.slabs import make_slabs, meet_block
from pcsg.graph.operators import DIFFERENCE, UNION
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_inside
from pcsg.leaf.registry import Pool
from pcsg.simd import WIDTH, count_trailing_zeros
from pcsg.trace.ends import MAX_DEPTH
from pcsg.trace.groups import BLOCK, LEAF, OPERATION, SUSPENDED
from pcsg.trace.precision import Extent, precision_of, tolerance
from pcsg.trace.small import ENTRY, HEADER
from pcsg.trace.traversal import (
    FRAME,
    NONE,
    STACK,
    UNDECIDED,
    Scratch,
    Trees,
    find_expansion,
)
from pcsg.vec import (
    IDENTITY,
    Affine,
    Ray,
    Vec3,
    compose,
    load_affine,
    store_affine,
    transform_point,
    transform_ray,
)

_UNION, _DIFFERENCE = UNION.kind, DIFFERENCE.kind

_ONE = np.uint64(1)

_ALL = 0x1FF
"""A point and the eight about it, all within."""

_NEAR = 1e-12
"""How near to a surface, in parts of `Extent.reach`, others have to tell of a point."""

_X, _Y, _Z = 0.5377, 0.7312, 0.4191
"""Where the eight are, with all triples of signs: not along faces as they are likely to stand, and
one of them lies within a corner that the point may be in."""


def make_matrices() -> NDArray[np.float64]:
    """Return room for level_from_world of every level, working space of one thread."""
    return np.zeros(12 * (MAX_DEPTH + 2))


@njit(entry=True)
def contain_batch(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    matrices: NDArray[np.float64],
    root: int,
    extent: Extent,
    points: NDArray[np.float64],
    begin: int,
    end: int,
    answers: NDArray[np.int8],
) -> None:
    """Write 1 for points that the solid contains, 0 for others, UNDECIDED near surfaces."""
    for i in range(begin, end):
        p = Vec3(points[i, 0], points[i, 1], points[i, 2])
        ray = Ray(p.x, p.y, p.z, _X, _Y, _Z, -math.inf, math.inf)
        about = 4.0 * tolerance(0.0, precision_of(ray, extent))
        if extent.reach < math.inf:
            about = max(about, _NEAR * extent.reach)
        within = find_within(trees, pool, scratch, matrices, root, p, about)
        sure = about > 0.0 and within in (0, _ALL)
        answers[i] = within & 1 if sure else UNDECIDED


@njit
def find_within(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    matrices: NDArray[np.float64],
    root: int,
    p: Vec3,
    about: float,
) -> int:
    """Return which of a point and the eight at a distance about it are within, as bits.

    Returns
    -------
    int
        Of nine bits the lowest is the point's own; `UNDECIDED` where operations are nested too
        deeply.
    """
    stack, frames = scratch.entry_ref, scratch.frames
    level = frame = top = base = mask = present = 0
    slabs = make_slabs(Ray(p.x, p.y, p.z, _X, _Y, _Z, -about, about), 0.0, scratch.slabs)
    store_affine(matrices, 0, IDENTITY)
    code = wide(root) << 3 | BLOCK
    while True:
        kind, index = code & 7, code >> 3
        if kind == OPERATION:
            if level + 2 >= MAX_DEPTH or frame + 2 >= MAX_DEPTH:
                return UNDECIDED
            target = wide(trees.targets[index])
            _go_down(trees, matrices, index, level)
            at = FRAME * frame
            frames[at], frames[at + 1], frames[at + 2] = target, 0, level
            frames[at + 3], frames[at + 4], frames[at + 5] = base, mask, 0
            frame += 1
            level += 1
            present = -1
            base, mask = top, 0
            code = wide(trees.operations[target + 3]) << 3 | BLOCK
            continue
        if kind <= SUSPENDED:
            block = index
            if kind != BLOCK:
                if level + 2 >= MAX_DEPTH:
                    return UNDECIDED
                _go_down(trees, matrices, index, level)
                level += 1
                present = -1
                block = wide(trees.targets[index])
                if kind == SUSPENDED:
                    block = wide(find_expansion(scratch, block))
                    if block < 0:
                        return UNDECIDED
            if top >= STACK - WIDTH:
                return UNDECIDED
            if level != present:
                # Boxes have more room in single precision than the eight points are away.
                ray = Ray(p.x, p.y, p.z, _X, _Y, _Z, -about, about)
                ray = transform_ray(load_affine(matrices, 12 * level), ray)
                slabs = make_slabs(ray, 0.0, scratch.slabs)
                present = level
            met = meet_block(
                trees.boxes, block, slabs, -about, about, scratch.slabs, scratch.entries
            )
            top = _push(trees.refs, block, met, stack, level, top)
        elif kind == LEAF:
            m = load_affine(matrices, 12 * level)
            record = wide(trees.targets[index])
            mask |= _leaf_mask(trees, pool, index, record, m, p, about)
        else:
            m = load_affine(matrices, 12 * level)
            m = compose(load_affine(trees.inverses, 12 * index), m)
            mask |= _small_mask(trees, pool, scratch, wide(trees.targets[index]), m, p, about)
        if mask == _ALL:
            top = base
        while top == base:
            # A union has answered: to the caller, or to the operation that asked.
            if frame == 0:
                return mask
            at = FRAME * (frame - 1)
            target, done, level = frames[at], frames[at + 1], frames[at + 2]
            held = frames[at + 5]
            if done == 0:
                held = mask
            elif trees.operations[target] == _DIFFERENCE:
                held &= ~mask
            elif trees.operations[target] == _UNION:
                held |= mask
            else:
                held &= mask
            done += 1
            if done < trees.operations[target + 1] and held != 0:
                frames[at + 1], frames[at + 5] = done, held
                level += 1
                mask = 0
                stack[top] = (wide(trees.operations[target + 3 + done]) << 3 | BLOCK) << 8 | level
                top += 1
                break
            frame -= 1
            base, mask = frames[at + 3], frames[at + 4] | held
            if mask == _ALL:
                top = base
        top -= 1
        code, level = stack[top] >> 8, stack[top] & 255


@njit
def _go_down(trees: Trees, matrices: NDArray[np.float64], index: int, level: int) -> None:
    """Write the frame below a reference."""
    inner = compose(load_affine(trees.inverses, 12 * index), load_affine(matrices, 12 * level))
    store_affine(matrices, 12 * (level + 1), inner)


@njit(inline=True)
def _push(
    refs: NDArray[np.int32],
    block: int,
    met: np.uint64,
    stack: NDArray[np.int64],
    level: int,
    top: int,
) -> int:
    """Put what is in the boxes of a block that were met onto the stack; return the new top."""
    while met != NONE:
        k = count_trailing_zeros(met)
        met &= met - _ONE
        stack[top] = wide(refs[place(WIDTH * block) + k]) << 8 | level
        top += 1
    return top


@njit
def _leaf_mask(
    trees: Trees, pool: Pool, reference: int, record: int, m: Affine, p: Vec3, about: float
) -> int:
    """Return which of the nine points a leaf contains."""
    solid, at = trees.leaves[4 * record], wide(trees.leaves[4 * record + 1])
    if trees.leaves[4 * record + 2] == 1:
        return 0
    m = compose(load_affine(trees.inverses, 12 * reference), m)
    mask = 0
    for k in range(9):
        q = Vec3(p.x, p.y, p.z)
        if k > 0:
            x = _X if k & 1 else -_X
            y = _Y if k & 2 else -_Y
            z = _Z if k & 4 else -_Z
            q = Vec3(p.x + about * x, p.y + about * y, p.z + about * z)
        if leaf_inside(solid, transform_point(m, q), trees.args, at, pool):
            mask |= 1 << k
    return mask


@njit
def _small_mask(
    trees: Trees, pool: Pool, scratch: Scratch, at: int, m: Affine, p: Vec3, about: float
) -> int:
    """Return which of the nine points a small operation contains."""
    slots = scratch.slots
    for k in range(9):
        slots[k] = 0
    for j in range(trees.smalls[at]):
        entry = at + HEADER + ENTRY * j
        reference, record = wide(trees.smalls[entry]), wide(trees.smalls[entry + 1])
        inside = _leaf_mask(trees, pool, reference, record, m, p, about)
        for k in range(9):
            slots[k] |= ((inside >> k) & 1) << j
    table = trees.tables[trees.smalls[at + 1]]
    mask = 0
    for k in range(9):
        mask |= int((table >> np.uint64(slots[k])) & np.uint64(1)) << k
    return mask
