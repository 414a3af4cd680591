"""Building a bounding volume hierarchy of blocks of four boxes.

Binned surface area heuristic: Wald, "On fast Construction of SAH-based Bounding Volume
Hierarchies", 2007. A node is split until it has four parts, the largest first, as Ernst and
Greiner, "Multi Bounding Volume Hierarchies", 2008.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.simd import LOCAL, local_doubles, local_integers
from pcsg.slabs import WIDTH

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]

BLOCK_SIZE = 6 * WIDTH
"""Numbers of a block: lower x of four boxes, lower y, lower z, upper x, upper y, upper z."""

MOST = 4
"""Items in a leaf of the hierarchy."""

EMPTY = -1
"""Reference of an unused box, which no ray meets."""

_BINS = 16
_DEEP = 32
"""Levels below which parts are halved, so that the depth is bounded."""

STACK = LOCAL
assert (WIDTH - 1) * (_DEEP + 32) + WIDTH <= STACK


class Hierarchy(NamedTuple):
    """A hierarchy over n items.

    Attributes
    ----------
    boxes : float64 (24 B,)
        Boxes of B blocks; the first block is the root.
    refs : int32 (4 B,)
        What is in them: the number of a block, or ``-1 - (8 first + count)`` of a run of items in
        `order`.
    order : int32 (n,)
        The items, so that every run is together.
    """

    boxes: Floats
    refs: Indices
    order: Indices


def build_hierarchy(boxes: Floats) -> Hierarchy:
    """Build the hierarchy of boxes.

    Parameters
    ----------
    boxes : float64 (n, 6)
        Lower x, y, z, upper x, y, z of every item; finite.
    """
    n = len(boxes)
    order = np.arange(n, dtype=np.int32)
    planes = np.empty(BLOCK_SIZE * max(1, n))
    refs = np.empty(WIDTH * max(1, n), np.int32)
    stack = np.empty(4 * max(4, n), np.int64)
    flat = np.ascontiguousarray(boxes).ravel()
    count = _build(flat, order, planes, refs, stack)
    return Hierarchy(planes[: BLOCK_SIZE * count].copy(), refs[: WIDTH * count].copy(), order)


@njit(entry=True)
def _build(
    boxes: Floats, order: Indices, planes: Floats, refs: Indices, stack: NDArray[np.int64]
) -> int:
    """Fill in blocks and return their number; `stack` holds nodes that wait for their blocks."""
    parts = local_integers()
    bins = local_doubles()
    hulls = local_doubles()
    blocks = 1
    stack[0], stack[1], stack[2], stack[3] = 0, len(order), 0, 0
    top = 1
    while top > 0:
        top -= 1
        begin, end, block, depth = (
            stack[4 * top],
            stack[4 * top + 1],
            stack[4 * top + 2],
            stack[4 * top + 3],
        )
        # Parts are [parts[2 k], parts[2 k + 1]), with their boxes in `hulls`.
        parts[0], parts[1] = begin, end
        _hull(boxes, order, begin, end, hulls, 0)
        count = 1
        while count < WIDTH:
            widest = -1
            area = -1.0
            for k in range(count):
                if parts[2 * k + 1] - parts[2 * k] > MOST and _area(hulls, 6 * k) > area:
                    widest, area = k, _area(hulls, 6 * k)
            if widest < 0:
                break
            a, b = parts[2 * widest], parts[2 * widest + 1]
            middle = (a + b) // 2
            if depth < _DEEP:
                middle = _split(boxes, order, a, b, bins)
            parts[2 * widest + 1] = middle
            parts[2 * count], parts[2 * count + 1] = middle, b
            _hull(boxes, order, a, middle, hulls, 6 * widest)
            _hull(boxes, order, middle, b, hulls, 6 * count)
            count += 1
        for k in range(WIDTH):
            for axis in range(6):
                empty = math.inf if axis < 3 else -math.inf
                planes[BLOCK_SIZE * block + WIDTH * axis + k] = (
                    hulls[6 * k + axis] if k < count else empty
                )
            if k >= count or parts[2 * k] == parts[2 * k + 1]:
                refs[WIDTH * block + k] = EMPTY
            elif parts[2 * k + 1] - parts[2 * k] <= MOST:
                size = parts[2 * k + 1] - parts[2 * k]
                refs[WIDTH * block + k] = -1 - (8 * parts[2 * k] + size)
            else:
                refs[WIDTH * block + k] = blocks
                stack[4 * top], stack[4 * top + 1] = parts[2 * k], parts[2 * k + 1]
                stack[4 * top + 2], stack[4 * top + 3] = blocks, depth + 1
                blocks += 1
                top += 1
    return blocks


@njit
def _hull(boxes: Floats, order: Indices, begin: int, end: int, out: Floats, at: int) -> None:
    """Write the box about items [begin, end) to ``out[at:at + 6]``."""
    for axis in range(3):
        lower, upper = math.inf, -math.inf
        for i in range(begin, end):
            lower = min(lower, boxes[6 * order[i] + axis])
            upper = max(upper, boxes[6 * order[i] + 3 + axis])
        out[at + axis], out[at + 3 + axis] = lower, upper


@njit
def _area(boxes: Floats, at: int) -> float:
    """Return half the surface of a box, 0 for an empty one."""
    x, y, z = (
        boxes[at + 3] - boxes[at],
        boxes[at + 4] - boxes[at + 1],
        boxes[at + 5] - boxes[at + 2],
    )
    return max(x, 0.0) * (y + z) + max(y, 0.0) * z if x >= 0.0 else 0.0


@njit
def _split(boxes: Floats, order: Indices, begin: int, end: int, bins: Floats) -> int:
    """Sort items about the plane where the surface area heuristic is least; return the middle."""
    best = math.inf
    best_axis, best_bin = -1, 0
    best_low, best_scale = 0.0, 0.0
    for axis in range(3):
        low, high = math.inf, -math.inf
        for i in range(begin, end):
            c = boxes[6 * order[i] + axis] + boxes[6 * order[i] + 3 + axis]
            low, high = min(low, c), max(high, c)
        if not high > low:
            continue
        scale = _BINS / (high - low)
        if not scale < math.inf:
            continue
        # A bin: the number of its items, and their box.
        for k in range(_BINS):
            bins[7 * k] = 0.0
            for j in range(3):
                bins[7 * k + 1 + j], bins[7 * k + 4 + j] = math.inf, -math.inf
        for i in range(begin, end):
            at = 6 * order[i]
            k = _bin_of(boxes, at + axis, low, scale)
            bins[7 * k] += 1.0
            for j in range(3):
                bins[7 * k + 1 + j] = min(bins[7 * k + 1 + j], boxes[at + j])
                bins[7 * k + 4 + j] = max(bins[7 * k + 4 + j], boxes[at + 3 + j])
        cost, where = _sweep(bins)
        if cost < best:
            best, best_axis, best_bin, best_low, best_scale = cost, axis, where, low, scale
    if best_axis < 0:
        return (begin + end) // 2
    i, j = begin, end - 1
    while i <= j:
        if _bin_of(boxes, 6 * order[i] + best_axis, best_low, best_scale) < best_bin:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i if begin < i < end else (begin + end) // 2


@njit
def _bin_of(boxes: Floats, at: int, low: float, scale: float) -> int:
    return min(_BINS - 1, int((boxes[at] + boxes[at + 3] - low) * scale))


@njit
def _sweep(bins: Floats) -> tuple[float, int]:
    """Return the least cost of a split between bins, and the first bin behind it."""
    right = 7 * _BINS
    # Costs of what is behind each split, from the end; then those before it are added.
    for j in range(3):
        bins[right + j], bins[right + 3 + j] = math.inf, -math.inf
    total = 0.0
    for k in range(_BINS - 1, 0, -1):
        total = _join(bins, k, right, total)
        bins[right + 6 + k] = total * _area(bins, right)
    for j in range(3):
        bins[right + j], bins[right + 3 + j] = math.inf, -math.inf
    total = 0.0
    best, where = math.inf, 0
    for k in range(1, _BINS):
        total = _join(bins, k - 1, right, total)
        cost = total * _area(bins, right) + bins[right + 6 + k]
        if cost < best and total > 0.0:
            best, where = cost, k
    return best, where


@njit
def _join(bins: Floats, k: int, at: int, total: float) -> float:
    """Join the box of bin k to the one at `at` and return the number with its items."""
    for j in range(3):
        bins[at + j] = min(bins[at + j], bins[7 * k + 1 + j])
        bins[at + 3 + j] = max(bins[at + 3 + j], bins[7 * k + 4 + j])
    more: float = total + bins[7 * k]
    return more
