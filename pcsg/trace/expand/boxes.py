"""Boxes of what is laid out.

Those of leaves are closed forms. Those of instances come from the hierarchy of their cluster, by
branch and bound over supports: the support of a solid in a direction d is the largest ``p . d``
over its points, and passes through matrices without loss.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.bvh import Hierarchies
from pcsg.graph.operators import DIFFERENCE, UNION
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_support
from pcsg.simd import WIDTH
from pcsg.trace.bounding import CORNERS, SUPPORT, bound_box, pad_box
from pcsg.trace.expand.clusters import BOUNDS, CLUSTER, Sizes, is_suspended
from pcsg.trace.expand.layout import Layout, LayoutWork, instance_matrix, item_matrix
from pcsg.trace.expand.programs import L_SHAPE, L_SHAPE_AT, L_SOLID, LEAF_FIELDS, Programs
from pcsg.trace.expand.shapes import bound_shape, join_box, start_box
from pcsg.trace.expand.table import LEAF, OPERATION, STATE, Table
from pcsg.trace.groups import BLOCK, EMPTY, INSTANCE, SMALL, SUSPENDED
from pcsg.trace.groups import LEAF as LEAF_REF
from pcsg.trace.small import ENTRY, HEADER
from pcsg.vec import Affine, Vec3, load_affine, store_affine

_UNION, _DIFFERENCE = UNION.kind, DIFFERENCE.kind

TOLERANCE = 0.01
"""Of the boxes of instances, relative to their size; exact ones would not pay."""


@njit
def bound_leaf(programs: Programs, table: Table, i: int, m: Affine, work: LayoutWork) -> None:
    """Write the box of a leaf to `work.box`."""
    bound_shape(programs, table, i, m, work.box)


@njit
def bound_suspended(sizes: Sizes, state: int, m: Affine, box: NDArray[np.float64]) -> None:
    """Write the box of a state that has not been expanded."""
    at = BOUNDS * state
    bound_box(m, sizes.bounds, at, 0.0, 0.0, 0.0, sizes.bounds[at + 6], box, 0)
    pad_box(box)


@njit
def bound_item(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    item: int,
    outer: Affine,
) -> None:
    """Write the box of an item to `work.box`.

    A union is as large as its operands together, an intersection as what their boxes share, a
    difference as its first operand.
    """
    frames, matrices, boxes = work.bound_frames, work.bound_matrices, work.accumulated
    frames[0], frames[1], frames[2] = item, item + 1, -1
    store_affine(matrices, 0, outer)
    start_box(boxes, 0)
    top, level = 1, 0
    while top > 0:
        at = 3 * (top - 1)
        i, end, operation_end = frames[at], frames[at + 1], frames[at + 2]
        if i >= end:
            if operation_end < 0:
                top -= 1
                continue
            # An operand of an intersection is done.
            level -= 1
            shared, own = 12 * level + 6, 12 * (level + 1)
            for k in range(3):
                boxes[shared + k] = max(boxes[shared + k], boxes[own + k])
                boxes[shared + 3 + k] = min(boxes[shared + 3 + k], boxes[own + 3 + k])
            if end < operation_end:
                frames[at], frames[at + 1] = end, table.end[end]
                level += 1
                start_box(boxes, 12 * level)
                continue
            top -= 1
            is_empty = False
            for k in range(3):
                is_empty = is_empty or boxes[shared + k] > boxes[shared + 3 + k]
            if not is_empty:
                join_box(boxes, 12 * level, boxes, shared)
            continue
        frames[at] = i + 1 if table.kind[i] != OPERATION else table.end[i]
        if sizes.leaves_of[i] == 0.0:
            continue
        kind, target = table.kind[i], table.target[i]
        outer = load_affine(matrices, 12 * (top - 1))
        if kind == LEAF:
            bound_leaf(programs, table, i, item_matrix(table, i, outer), work)
            join_box(boxes, 12 * level, work.box, 0)
            continue
        if kind == STATE and sizes.flags[target] & CLUSTER:
            m = instance_matrix(table, layout, i, outer)
            bound_instance(programs, table, layout, out, work, layout.list_of[target], m)
            join_box(boxes, 12 * level, work.box, 0)
            continue
        if kind == STATE and is_suspended(table, target):
            bound_suspended(sizes, target, item_matrix(table, i, outer), work.box)
            join_box(boxes, 12 * level, work.box, 0)
            continue
        if frames[at] >= end and operation_end < 0:
            top -= 1
        at = 3 * top
        frames[at + 2] = -1
        if kind == STATE:
            frames[at], frames[at + 1] = table.first[target], table.last[target]
            outer = item_matrix(table, i, outer)
        elif target == _UNION:
            frames[at], frames[at + 1] = i + 1, table.end[i]
        elif target == _DIFFERENCE:
            frames[at], frames[at + 1] = i + 1, table.end[i + 1]
        else:
            frames[at], frames[at + 1], frames[at + 2] = i + 1, table.end[i + 1], table.end[i]
            for k in range(3):
                boxes[12 * level + 6 + k], boxes[12 * level + 9 + k] = -math.inf, math.inf
            level += 1
            start_box(boxes, 12 * level)
        store_affine(matrices, 12 * top, outer)
        top += 1
    for k in range(6):
        work.box[k] = boxes[k]


@njit
def bound_instance(
    programs: Programs,
    table: Table,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    number: int,
    m: Affine,
) -> None:
    """Write the box of an instance of a list to `work.box`."""
    for i in range(3):
        d, shift = Vec3(m[4 * i], m[4 * i + 1], m[4 * i + 2]), m[4 * i + 3]
        upper = find_support(programs, table, layout, out, work, number, d, TOLERANCE)
        d = Vec3(-d.x, -d.y, -d.z)
        lower = find_support(programs, table, layout, out, work, number, d, TOLERANCE)
        work.box[i], work.box[i + 3] = shift - lower, shift + upper
    pad_box(work.box)


@njit
def find_support(
    programs: Programs,
    table: Table,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    number: int,
    direction: Vec3,
    tolerance: float,
) -> float:
    """Return the support of a list's solids, or a little more.

    Parameters
    ----------
    number
        Of the list, whose hierarchy is there.
    tolerance
        Relative to the width of the list in this direction.
    """
    heap, codes = work.heap, work.heap_codes
    room = len(codes) - 2 * WIDTH
    best = -math.inf
    block = layout.list_block[number]
    slack = tolerance * _block_width(out, block, direction)
    n = _push(heap, codes, 0, math.inf, direction, 0.0, block << 3 | BLOCK)
    while n > 0:
        bound, code = heap[0], codes[0]
        if not bound > best + slack or n > room:
            found: float = max(bound, best)
            return found
        d, offset = Vec3(heap[1], heap[2], heap[3]), heap[4]
        n = _pop(heap, codes, n)
        kind, index = code & 7, code >> 3
        if kind == BLOCK:
            for k in range(WIDTH):
                inner = out.refs[WIDTH * index + k]
                if inner & 7 != EMPTY:
                    reach = min(bound, offset + _box_support(out, index, k, d))
                    if reach > best:
                        n = _push(heap, codes, n, reach, d, offset, inner)
            continue
        if kind == SUSPENDED:
            # What is there is not known better than its box.
            best = max(best, bound)
            continue
        m = load_affine(layout.matrices, 12 * index)
        offset += d.x * m.m03 + d.y * m.m13 + d.z * m.m23
        d = _turn_back(m, d)
        if kind == INSTANCE:
            below = layout.list_block[layout.targets[index]] << 3 | BLOCK
            n = _push(heap, codes, n, bound, d, offset, below)
        elif kind == LEAF_REF:
            item = layout.record_item[layout.targets[index]]
            best = max(best, min(bound, offset + _leaf_support(programs, table, item, d)))
        elif kind == SMALL:
            reach = _small_support(programs, table, layout, layout.targets[index], d)
            best = max(best, min(bound, offset + reach))
        else:
            # No intersection and no difference is larger than its first operand.
            first = layout.operations[layout.targets[index] + 3]
            below = layout.list_block[first] << 3 | BLOCK
            n = _push(heap, codes, n, bound, d, offset, below)
    return best


@njit
def _small_support(programs: Programs, table: Table, layout: Layout, at: int, d: Vec3) -> float:
    """Return the support of a small operation, or more: of the primitives that hold all of it."""
    least = math.inf
    required = layout.smalls[at + 2]
    for j in range(layout.smalls[at]):
        if required >> j & 1:
            row = layout.smalls[at + HEADER + ENTRY * j]
            m = load_affine(layout.matrices, 12 * row)
            offset = d.x * m.m03 + d.y * m.m13 + d.z * m.m23
            own = _turn_back(m, d)
            least = min(least, offset + _leaf_support(programs, table, layout.items[row], own))
    return least


@njit(inline=True)
def _turn_back(m: Affine, d: Vec3) -> Vec3:
    """Return a direction of supports in the frame that a matrix comes from."""
    return Vec3(
        d.x * m.m00 + d.y * m.m10 + d.z * m.m20,
        d.x * m.m01 + d.y * m.m11 + d.z * m.m21,
        d.x * m.m02 + d.y * m.m12 + d.z * m.m22,
    )


@njit
def _leaf_support(programs: Programs, table: Table, item: int, d: Vec3) -> float:
    """Return the support of a leaf in its own frame."""
    leaf = LEAF_FIELDS * table.target[item]
    shape, at = programs.leaves[leaf + L_SHAPE], programs.leaves[leaf + L_SHAPE_AT]
    if shape == SUPPORT:
        solid = programs.leaves[leaf + L_SOLID]
        own: float = leaf_support(solid, d, table.numbers, table.numbers_at[item])
        return own
    shapes = programs.shapes
    if shape == CORNERS:
        best = -math.inf
        for k in range(int(shapes[at])):
            p = at + 1 + 3 * k
            best = max(best, d.x * shapes[p] + d.y * shapes[p + 1] + d.z * shapes[p + 2])
        return best
    total = 0.0
    for k in range(3):
        if d[k] != 0.0:
            total += d[k] * (shapes[at + 3 + k] if d[k] > 0.0 else shapes[at + k])
    radius = shapes[at + 9]
    if radius < math.inf:
        ball = d.x * shapes[at + 6] + d.y * shapes[at + 7] + d.z * shapes[at + 8]
        total = min(total, ball + radius * math.hypot(math.hypot(d.x, d.y), d.z))
    return total


@njit
def _box_support(out: Hierarchies, block: int, k: int, d: Vec3) -> float:
    """Return the support of a box of a block."""
    at = 6 * WIDTH * block + k
    total = 0.0
    for axis in range(3):
        if d[axis] != 0.0:
            upper = 3 * WIDTH if d[axis] > 0.0 else 0
            total += d[axis] * np.float64(out.boxes[at + WIDTH * axis + upper])
    return total


@njit
def _block_width(out: Hierarchies, block: int, d: Vec3) -> float:
    """Return the width of a block's boxes in a direction; 0 where it is infinite."""
    most, least = -math.inf, math.inf
    back = Vec3(-d.x, -d.y, -d.z)
    for k in range(WIDTH):
        if out.refs[WIDTH * block + k] & 7 != EMPTY:
            most = max(most, _box_support(out, block, k, d))
            least = min(least, -_box_support(out, block, k, back))
    width = most - least
    return width if 0.0 < width < math.inf else 0.0


@njit
def _push(
    heap: NDArray[np.float64],
    codes: NDArray[np.int32],
    n: int,
    bound: float,
    d: Vec3,
    offset: float,
    code: int,
) -> int:
    """Add an entry to a heap of n, the largest bound on top; return the new size."""
    k = n
    while k > 0 and heap[5 * ((k - 1) // 2)] < bound:
        _copy_entry(heap, codes, (k - 1) // 2, k)
        k = (k - 1) // 2
    heap[5 * k], heap[5 * k + 4] = bound, offset
    heap[5 * k + 1], heap[5 * k + 2], heap[5 * k + 3] = d
    codes[k] = code
    return n + 1


@njit
def _pop(heap: NDArray[np.float64], codes: NDArray[np.int32], n: int) -> int:
    """Remove the top of a heap of n; return the new size."""
    last = n - 1
    bound = heap[5 * last]
    k = 0
    while True:
        child = 2 * k + 1
        if child >= last:
            break
        if child + 1 < last and heap[5 * child + 5] > heap[5 * child]:
            child += 1
        if heap[5 * child] <= bound:
            break
        _copy_entry(heap, codes, child, k)
        k = child
    _copy_entry(heap, codes, last, k)
    return last


@njit
def _copy_entry(heap: NDArray[np.float64], codes: NDArray[np.int32], k: int, to: int) -> None:
    for j in range(5):
        heap[5 * to + j] = heap[5 * k + j]
    codes[to] = codes[k]
