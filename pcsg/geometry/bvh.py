"""Building wide bounding volume hierarchies: blocks of sixteen boxes in single precision.

Binned surface area heuristic (Wald, "On fast Construction of SAH-based Bounding Volume
Hierarchies", 2007). A node is split until it has as many parts as a block has boxes, the largest
first (Ernst and Greiner, "Multi Bounding Volume Hierarchies", 2008), or each fits into one block.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.simd import SINGLE, WIDTH

Floats = NDArray[np.float64]

BLOCK, RUN, EMPTY = 0, 1, 7
"""References: the number of a block, or of a run of items, comes before its kind, in three bits.
Whoever gives items codes of their own has other kinds."""

BINS = 24

FARTHEST, LEAST_SINGLE = 3e20, 1e-37
"""A box that reaches farther has no end, so that single precision does not overflow; below the
other number it has fewer digits."""

_DEEP = 18
"""Levels of blocks below which parts are halved, so that the depth is bounded."""

STACK = 512
"""References that wait at most while a hierarchy is visited depth first."""

# Sixteen halves of halves have an eighth of the items each, at most.
assert (WIDTH - 1) * (_DEEP + 13) + WIDTH <= STACK


class Hierarchies(NamedTuple):
    """Blocks of many hierarchies, as in `Blocks`.

    Attributes
    ----------
    boxes : float32 (6 W B,)
    refs : int32 (W B,)
    """

    boxes: NDArray[np.float32]
    refs: NDArray[np.int32]


class Hierarchy(NamedTuple):
    """One hierarchy over N items, which are parted into runs.

    Attributes
    ----------
    boxes, refs
        As in `Hierarchies`; the first block is the root, and what is no block is a run.
    order : int32 (N,)
        Items, one run after the other.
    begins : int32 (R + 1,)
        Run k is ``order[begins[k]:begins[k + 1]]``.
    """

    boxes: NDArray[np.float32]
    refs: NDArray[np.int32]
    order: NDArray[np.int32]
    begins: NDArray[np.int32]


def build_hierarchy(boxes: Floats, most: int = 1) -> Hierarchy:
    """Build the hierarchy of boxes.

    Parameters
    ----------
    boxes : float64 (n, 6)
        Lower x, y, z, upper x, y, z of every item.
    most
        Items in a run, at most. Rays are tested against all items of a run at once, so a run costs
        the same however many it has.
    """
    n = len(boxes)
    work = make_build_work(n, runs=n, most=most)
    # Every block has at least two parts, and what is a block of its own more items than a run.
    blocks = 2 * n // (most + 1) + 2
    out = Hierarchies(np.empty(6 * WIDTH * blocks, np.float32), np.empty(WIDTH * blocks, np.int32))
    blocks = _build(np.ascontiguousarray(boxes).ravel(), out, work)
    runs = work.runs[: 2 * work.counts[0]].reshape(-1, 2)
    sizes = runs[:, 1] - runs[:, 0]
    begins = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    order = work.order[np.arange(n) + np.repeat(runs[:, 0] - begins[:-1], sizes)]
    return Hierarchy(
        out.boxes[: 6 * WIDTH * blocks].copy(), out.refs[: WIDTH * blocks].copy(), order, begins
    )


class BuildWork(NamedTuple):
    """Working space of the builder.

    Attributes
    ----------
    most : int
        Items in a run, at most; 0 where items have codes and there are no runs.
    counts : int64 (1,)
        Number of runs so far.
    runs : int32 (2 R,)
        First item and end of every run.
    order : int32 (N,)
        Items, sorted so that every part is a run.
    stack : int64 (4 D,)
        Parts that wait for their blocks: first item, last, block, level.
    parts : int64 (2 W,)
        The parts of the present block.
    bins, hulls : float64
        Number and box of every bin; boxes of the parts.
    """

    most: int
    counts: NDArray[np.int64]
    runs: NDArray[np.int32]
    order: NDArray[np.int32]
    stack: NDArray[np.int64]
    parts: NDArray[np.int64]
    bins: Floats
    hulls: Floats


def make_build_work(items: int, runs: int = 0, most: int = 0) -> BuildWork:
    """Return working space for hierarchies of so many items, runs, and items of a run at most."""
    return BuildWork(
        most=most,
        counts=np.zeros(1, np.int64),
        runs=np.empty(2 * max(1, runs), np.int32),
        order=np.empty(max(1, items), np.int32),
        stack=np.empty(4 * max(WIDTH * (_DEEP + 40), 1), np.int64),
        parts=np.empty(2 * WIDTH, np.int64),
        bins=np.empty(16 * BINS),
        hulls=np.empty(6 * (WIDTH + 1)),
    )


@njit(entry=True)
def _build(boxes: Floats, out: Hierarchies, work: BuildWork) -> int:
    """Build one hierarchy over all boxes; return the number of blocks."""
    blocks = 1
    waiting, unbounded = begin_hierarchy(boxes, 0, len(work.order), 0, work)
    while waiting > 0:
        blocks, waiting = build_block(boxes, work.order, out, blocks, waiting, unbounded, work)
    return blocks


@njit
def begin_hierarchy(
    boxes: Floats, first: int, count: int, block: int, work: BuildWork
) -> tuple[int, int]:
    """Begin the hierarchy over a run of items, whose root is a block that is free.

    Parameters
    ----------
    boxes : float64 (6 N,)
        Lower x, y, z, upper x, y, z of every item; may be infinite.
    first, count
        The run.

    Returns
    -------
    waiting, unbounded
        How many parts wait for their blocks: one. How many items have no bounds.
    """
    stack = work.stack
    stack[0], stack[1], stack[2], stack[3] = 0, count, block, 0
    return 1, _unbounded_first(boxes, first, count, work.order)


@njit
def build_block(
    boxes: Floats,
    codes: NDArray[np.int32],
    out: Hierarchies,
    blocks: int,
    waiting: int,
    unbounded: int,
    work: BuildWork,
) -> tuple[int, int]:
    """Build the block of the part that waits on top.

    Parameters
    ----------
    codes : int32 (N,)
        What stands in `refs` for every item; not read where there are runs.
    blocks
        Number of blocks before.
    waiting, unbounded
        As `begin_hierarchy` returns them.

    Returns
    -------
    blocks, waiting
        Their new numbers.
    """
    n, more = begin_block(boxes, waiting, work), 1
    while more > 0:
        n, more = split_block(boxes, waiting, unbounded, n, work)
    return end_block(boxes, codes, out, blocks, waiting, n, work)


@njit
def begin_block(boxes: Floats, waiting: int, work: BuildWork) -> int:
    """Begin the block of the part that waits on top; return how many parts it has so far."""
    top = 4 * (waiting - 1)
    begin, end = work.stack[top], work.stack[top + 1]
    work.parts[0], work.parts[1] = begin, end
    _find_hull(boxes, work.order, begin, end, work.hulls, 0)
    return 1 if end > begin else 0


@njit
def split_block(
    boxes: Floats, waiting: int, unbounded: int, n: int, work: BuildWork
) -> tuple[int, int]:
    """Split the largest of the n parts of the block that was begun, if there is anything to split.

    Returns
    -------
    n, items
        How many parts there are now, and how many items were parted; 0 where nothing was.
    """
    order, parts, hulls = work.order, work.parts, work.hulls
    single = max(1, work.most)
    # What one block can hold of single items is not parted further, and then dissolved.
    most_of_part = single if work.most > 1 else WIDTH
    deep = work.stack[4 * waiting - 1] > _DEEP
    k = _choose_part(parts, hulls, n, most_of_part, deep) if 0 < n < WIDTH else -1
    if k < 0:
        return n, 0
    a, b = parts[2 * k], parts[2 * k + 1]
    if a < unbounded < b:
        middle = unbounded
    elif a < unbounded or deep:
        middle = (a + b) // 2
    else:
        middle = _split(boxes, order, a, b, single, work.bins)
    parts[2 * k + 1] = middle
    parts[2 * n], parts[2 * n + 1] = middle, b
    _find_hull(boxes, order, a, middle, hulls, 6 * k)
    _find_hull(boxes, order, middle, b, hulls, 6 * n)
    return n + 1, b - a


@njit
def end_block(
    boxes: Floats,
    codes: NDArray[np.int32],
    out: Hierarchies,
    blocks: int,
    waiting: int,
    n: int,
    work: BuildWork,
) -> tuple[int, int]:
    """Write the block of the part that waits on top, of n parts; as `build_block`."""
    stack, parts, hulls = work.stack, work.parts, work.hulls
    waiting -= 1
    block, level = stack[4 * waiting + 2], stack[4 * waiting + 3]
    single = max(1, work.most)
    if work.most <= 1:
        n = _dissolve_parts(boxes, work, n)
    for k in range(WIDTH):
        at = WIDTH * block + k
        if k >= n:
            out.refs[at] = EMPTY
            for j in range(3):
                hulls[6 * k + j], hulls[6 * k + 3 + j] = math.inf, -math.inf
        elif parts[2 * k + 1] - parts[2 * k] <= single:
            out.refs[at] = _code_of(codes, parts[2 * k], parts[2 * k + 1], work)
        else:
            out.refs[at] = np.int32(blocks << 3 | BLOCK)
            top = 4 * waiting
            stack[top], stack[top + 1] = parts[2 * k], parts[2 * k + 1]
            stack[top + 2], stack[top + 3] = blocks, level + 1
            blocks += 1
            waiting += 1
        for j in range(3):
            place = 6 * WIDTH * block + WIDTH * j + k
            out.boxes[place] = _round_down(hulls[6 * k + j])
            out.boxes[place + 3 * WIDTH] = _round_up(hulls[6 * k + 3 + j])
    return blocks, waiting


@njit
def _code_of(codes: NDArray[np.int32], begin: int, end: int, work: BuildWork) -> np.int32:
    """Return what stands for items that are not parted any more."""
    if work.most == 0:
        return codes[work.order[begin]]  # type: ignore[no-any-return]
    n = work.counts[0]
    work.runs[2 * n], work.runs[2 * n + 1] = begin, end
    work.counts[0] = n + 1
    return np.int32(n << 3 | RUN)


@njit
def _unbounded_first(boxes: Floats, first: int, count: int, order: NDArray[np.int32]) -> int:
    """Write the items of a run to `order`, unbounded ones first; return how many these are."""
    n = 0
    for i in range(first, first + count):
        if not _is_bounded(boxes, 6 * i):
            order[n] = i
            n += 1
    unbounded = n
    for i in range(first, first + count):
        if _is_bounded(boxes, 6 * i):
            order[n] = i
            n += 1
    return unbounded


@njit
def _is_bounded(boxes: Floats, at: int) -> bool:
    for k in range(6):
        if not abs(boxes[at + k]) < FARTHEST:
            return False
    return True


@njit
def _choose_part(
    parts: NDArray[np.int64], hulls: Floats, n: int, most: int, by_number: bool
) -> int:
    """Return the largest part with more than `most` items, or the one with most; -1 if none."""
    chosen, best = -1, -1.0
    for k in range(n):
        size = parts[2 * k + 1] - parts[2 * k]
        weight = float(size) if by_number else half_area(hulls, 6 * k)
        if size > most and weight > best:
            chosen, best = k, weight
    return chosen


@njit
def _dissolve_parts(boxes: Floats, work: BuildWork, n: int) -> int:
    """Put the items of parts into the block itself while it has room; return what it holds.

    That saves the part's own block, which rays visit as often as its box is large.
    """
    parts, hulls = work.parts, work.hulls
    while True:
        chosen, best = -1, -1.0
        for k in range(n):
            more = parts[2 * k + 1] - parts[2 * k] - 1
            if 0 < more <= WIDTH - n and half_area(hulls, 6 * k) > best * more:
                chosen, best = k, half_area(hulls, 6 * k) / more
        if chosen < 0:
            return n
        begin, end = parts[2 * chosen], parts[2 * chosen + 1]
        for i in range(begin, end):
            k = chosen if i == begin else n
            n += k == n
            parts[2 * k], parts[2 * k + 1] = i, i + 1
            _find_hull(boxes, work.order, i, i + 1, hulls, 6 * k)


@njit
def half_area(boxes: Floats, at: int) -> float:
    """Return half the surface of a box, 0 for an empty one."""
    x, y, z = (
        boxes[at + 3] - boxes[at],
        boxes[at + 4] - boxes[at + 1],
        boxes[at + 5] - boxes[at + 2],
    )
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return 0.0
    area: float = x * y + y * z + z * x
    return area


@njit
def _find_hull(
    boxes: Floats, order: NDArray[np.int32], begin: int, end: int, out: Floats, at: int
) -> None:
    """Write the box about items [begin, end)."""
    x0 = y0 = z0 = math.inf
    x1 = y1 = z1 = -math.inf
    for i in range(begin, end):
        b = 6 * order[i]
        x0, y0, z0 = min(x0, boxes[b]), min(y0, boxes[b + 1]), min(z0, boxes[b + 2])
        x1, y1, z1 = max(x1, boxes[b + 3]), max(y1, boxes[b + 4]), max(z1, boxes[b + 5])
    out[at], out[at + 1], out[at + 2] = x0, y0, z0
    out[at + 3], out[at + 4], out[at + 5] = x1, y1, z1


@njit
def _split(
    boxes: Floats, order: NDArray[np.int32], begin: int, end: int, single: int, bins: Floats
) -> int:
    """Sort items about the plane where the surface area heuristic is least; return the middle.

    `single` items cost as much as one.
    """
    best = math.inf
    best_axis, best_bin = -1, 0
    best_low, best_scale = 0.0, 0.0
    n_bins = min(BINS, 4 + (end - begin) // 4)
    for axis in range(3):
        low, high = math.inf, -math.inf
        for i in range(begin, end):
            b = 6 * order[i] + axis
            c = boxes[b] + boxes[b + 3]
            low, high = min(low, c), max(high, c)
        if not high > low:
            continue
        scale = n_bins / (high - low)
        if not scale < math.inf:
            continue
        for k in range(n_bins):
            bins[8 * k] = 0.0
            for j in range(3):
                bins[8 * k + 1 + j], bins[8 * k + 4 + j] = math.inf, -math.inf
        for i in range(begin, end):
            b = 6 * order[i]
            k = 8 * _find_bin(boxes[b + axis] + boxes[b + 3 + axis], low, scale, n_bins)
            bins[k] += 1.0
            for j in range(3):
                bins[k + 1 + j] = min(bins[k + 1 + j], boxes[b + j])
                bins[k + 4 + j] = max(bins[k + 4 + j], boxes[b + 3 + j])
        cost, where = _sweep(bins, n_bins, single)
        if cost < best:
            best, best_axis, best_bin, best_low, best_scale = cost, axis, where, low, scale
    if best_axis < 0:
        return (begin + end) // 2
    i, j = begin, end - 1
    while i <= j:
        b = 6 * order[i] + best_axis
        if _find_bin(boxes[b] + boxes[b + 3], best_low, best_scale, n_bins) < best_bin:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i if begin < i < end else (begin + end) // 2


@njit
def _find_bin(center: float, low: float, scale: float, n_bins: int) -> int:
    return min(n_bins - 1, int((center - low) * scale))


@njit
def _sweep(bins: Floats, n_bins: int, single: int) -> tuple[float, int]:
    """Return the least cost of a split between bins, and the first bin behind it."""
    # Costs of what lies behind each split stand behind the bins' own numbers.
    side = 8 * BINS
    for j in range(3):
        bins[side + j], bins[side + 3 + j] = math.inf, -math.inf
    total = 0.0
    for k in range(n_bins - 1, 0, -1):
        total += _join(bins, k, side)
        bins[8 * k + 7] = math.ceil(total / single) * half_area(bins, side)
    for j in range(3):
        bins[side + j], bins[side + 3 + j] = math.inf, -math.inf
    total = 0.0
    best, where = math.inf, 0
    for k in range(1, n_bins):
        total += _join(bins, k - 1, side)
        cost = math.ceil(total / single) * half_area(bins, side) + bins[8 * k + 7]
        if cost < best and total > 0.0:
            best, where = cost, k
    return best, where


@njit
def _join(bins: Floats, k: int, at: int) -> float:
    """Join the box of bin k to the one at `at` and return its number of items."""
    for j in range(3):
        bins[at + j] = min(bins[at + j], bins[8 * k + 1 + j])
        bins[at + 3 + j] = max(bins[at + 3 + j], bins[8 * k + 4 + j])
    more: float = bins[8 * k]
    return more


@njit
def _round_down(x: float) -> np.float32:
    """Return a lower side in single precision, with room for errors; see `simd.prepare_ray`."""
    if x == math.inf:
        return np.float32(x)
    x -= _room(x)
    return np.float32(x if x >= -FARTHEST else -math.inf)


@njit
def _round_up(x: float) -> np.float32:
    """Return an upper side in single precision, with room for errors."""
    if x == -math.inf:
        return np.float32(x)
    x += _room(x)
    return np.float32(x if x <= FARTHEST else math.inf)


@njit
def _room(x: float) -> float:
    """Return how much a side may be off."""
    # Where single precision runs out of digits, its errors are no longer relative.
    return abs(x) * SINGLE + (1e-44 if 0.0 < abs(x) < LEAST_SINGLE else 0.0)
