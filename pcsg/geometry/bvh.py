"""Building wide bounding volume hierarchies: blocks of sixteen boxes in single precision.

Binned surface area heuristic (Wald, "On fast Construction of SAH-based Bounding Volume
Hierarchies", 2007). What has many items is split until it has as many parts as a block has boxes,
the largest first (Ernst and Greiner, "Multi Bounding Volume Hierarchies", 2008). Over fewer items a
binary tree is made, and collapsed to the blocks of which rays visit fewest (`collapse`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.collapse import (
    LEVELS_OF_HALVES,
    MOST_LEVELS,
    MOST_TOGETHER,
    BinaryTree,
    choose_slots,
    half_area,
    make_binary_tree,
    weigh_nodes,
)
from pcsg.jit import njit
from pcsg.simd import LOCAL, SINGLE, WIDTH

Floats = NDArray[np.float64]

BLOCK, RUN, EMPTY = 0, 1, 7
"""References: the number of a block, or of a run of items, comes before its kind, in three bits.
Whoever gives items codes of their own has other kinds."""

BINS = 32

FARTHEST, LEAST_SINGLE = 3e20, 1e-37
"""A box that reaches farther has no end, so that single precision does not overflow; below the
other number it has fewer digits."""

_DEEP = 6
"""Levels of blocks below which parts are halved, so that the depth is bounded."""

_PRICE = 16.0
"""What a block of a large hierarchy costs besides visits, for its memory; see `weigh_nodes`."""

STACK = LOCAL
"""References that wait at most while a hierarchy is visited depth first."""

# Sixteen halves of halves have an eighth of the items each, at most.
assert (WIDTH - 1) * (_DEEP + 8 + MOST_LEVELS) + WIDTH <= STACK


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
        Lower x, y, z, upper x, y, z of every item; finite.
    most
        Items in a run, at most. Rays are tested against all items of a run at once, so a run costs
        the same however many it has.
    """
    n = len(boxes)
    flat = np.ascontiguousarray(boxes).ravel()
    work = make_build_work(n, runs=n, most=most)
    room = min(n, MOST_TOGETHER) + WIDTH + 1
    out = _make_room(room + n // (4 * most))
    work.order[:n] = np.arange(n)
    work.stack[:4] = 0, n, 0, 0
    blocks, waiting = 1, 1
    while waiting > 0:
        blocks, waiting = _build(flat, out, blocks, waiting, room, work)
        if waiting > 0:
            more = _make_room(len(out.refs) // WIDTH)
            out = Hierarchies(*(np.concatenate(pair) for pair in zip(out, more, strict=True)))
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
    tree
        The binary tree over few items.
    """

    most: int
    counts: NDArray[np.int64]
    runs: NDArray[np.int32]
    order: NDArray[np.int32]
    stack: NDArray[np.int64]
    parts: NDArray[np.int64]
    bins: Floats
    hulls: Floats
    tree: BinaryTree


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
        tree=make_binary_tree(min(items, MOST_TOGETHER)),
    )


def _make_room(blocks: int) -> Hierarchies:
    return Hierarchies(np.empty(6 * WIDTH * blocks, np.float32), np.empty(WIDTH * blocks, np.int32))


@njit(entry=True)
def _build(
    boxes: Floats, out: Hierarchies, blocks: int, waiting: int, room: int, work: BuildWork
) -> tuple[int, int]:
    """Build blocks of parts that wait while there is room for so many more."""
    while waiting > 0 and WIDTH * (blocks + room) <= len(out.refs):
        blocks, waiting = build_block(boxes, work.order, out, blocks, waiting, 0, work)
    return blocks, waiting


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
    return end_block(boxes, codes, out, blocks, waiting, unbounded, n, work)


@njit
def begin_block(boxes: Floats, waiting: int, work: BuildWork) -> int:
    """Begin the block of the part that waits on top; return how many parts it has so far."""
    top = 4 * (waiting - 1)
    begin, end = work.stack[top], work.stack[top + 1]
    work.parts[0], work.parts[1] = begin, end
    _find_hull(boxes, work.order, begin, end, work.hulls, 0)
    return 1 if end > begin else 0


@njit
def _is_together(waiting: int, work: BuildWork) -> bool:
    """Return whether all blocks over the part that waits on top are built together."""
    top = 4 * (waiting - 1)
    return bool(work.stack[top + 1] - work.stack[top] <= MOST_TOGETHER)


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
    if _is_together(waiting, work):
        return n, 0
    deep = work.stack[4 * waiting - 1] > _DEEP
    k = _choose_part(parts, hulls, n, max(1, work.most), deep) if n < WIDTH else -1
    if k < 0:
        return n, 0
    a, b = parts[2 * k], parts[2 * k + 1]
    middle = _part(boxes, a, b, unbounded, deep, work)
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
    unbounded: int,
    n: int,
    work: BuildWork,
) -> tuple[int, int]:
    """Write the block of the part that waits on top, of n parts, as `build_block`.

    Where the part has few items, these are all blocks over them.
    """
    stack, parts, hulls = work.stack, work.parts, work.hulls
    together = _is_together(waiting, work)
    waiting -= 1
    block, level = stack[4 * waiting + 2], stack[4 * waiting + 3]
    single = max(1, work.most)
    if together:
        begin, end = stack[4 * waiting], stack[4 * waiting + 1]
        price = _PRICE if level > 0 else 0.0
        blocks = _build_together(
            boxes, codes, out, blocks, begin, end, block, unbounded, price, work
        )
        return blocks, waiting
    for k in range(WIDTH):
        if k >= n:
            _write_nothing(out, block, k)
            continue
        begin, end = parts[2 * k], parts[2 * k + 1]
        if end - begin <= single:
            code = _code_of(codes, begin, end, work)
        else:
            code = np.int32(blocks << 3 | BLOCK)
            top = 4 * waiting
            stack[top], stack[top + 1], stack[top + 2], stack[top + 3] = (
                begin,
                end,
                blocks,
                level + 1,
            )
            blocks += 1
            waiting += 1
        _write_slot(out, block, k, code, hulls, 6 * k)
    return blocks, waiting


@njit
def _build_together(
    boxes: Floats,
    codes: NDArray[np.int32],
    out: Hierarchies,
    blocks: int,
    begin: int,
    end: int,
    block: int,
    unbounded: int,
    price: float,
    work: BuildWork,
) -> int:
    """Build all blocks over a few items; return the new number of blocks."""
    tree = work.tree
    single = max(1, work.most)
    nodes = 1 if end > begin else 0
    tree.begins[0], tree.ends[0], tree.levels[0] = begin, end, 0
    node = 0
    while node < nodes:
        a, b = tree.begins[node], tree.ends[node]
        _find_hull(boxes, work.order, a, b, tree.hulls, 6 * node)
        tree.children[node] = -1
        if b - a > single:
            halves = tree.levels[node] >= MOST_LEVELS - LEVELS_OF_HALVES
            middle = _part(boxes, a, b, unbounded, halves, work)
            tree.children[node] = nodes
            tree.begins[nodes], tree.ends[nodes] = a, middle
            tree.begins[nodes + 1], tree.ends[nodes + 1] = middle, b
            tree.levels[nodes] = tree.levels[nodes + 1] = tree.levels[node] + 1
            nodes += 2
        node += 1
    weigh_nodes(tree, nodes, price)
    waits = work.stack
    top = len(waits)
    # From the end of the stack downwards; at its beginning other parts wait.
    top -= 2
    waits[top], waits[top + 1] = 0, block
    while top < len(waits):
        node, block = waits[top], waits[top + 1]
        top += 2
        n = choose_slots(tree, node) if nodes > 0 else 0
        for k in range(WIDTH):
            if k >= n:
                _write_nothing(out, block, k)
                continue
            part = tree.slots[k]
            if tree.children[part] < 0:
                code = _code_of(codes, tree.begins[part], tree.ends[part], work)
            else:
                code = np.int32(blocks << 3 | BLOCK)
                top -= 2
                waits[top], waits[top + 1] = part, blocks
                blocks += 1
            _write_slot(out, block, k, code, tree.hulls, 6 * part)
    return blocks


@njit
def _part(
    boxes: Floats, begin: int, end: int, unbounded: int, halves: bool, work: BuildWork
) -> int:
    """Sort items into two parts and return where the second one begins."""
    if begin < unbounded < end:
        return unbounded
    if begin < unbounded or halves or end - begin == 2:
        return (begin + end) // 2
    return _split(boxes, work.order, begin, end, max(1, work.most), work.bins)


@njit
def _write_slot(
    out: Hierarchies, block: int, k: int, code: np.int32, hulls: Floats, at: int
) -> None:
    """Write a reference of a block, and its box."""
    out.refs[WIDTH * block + k] = code
    for j in range(3):
        place = WIDTH * (6 * block + j) + k
        out.boxes[place] = _round_down(hulls[at + j])
        out.boxes[place + 3 * WIDTH] = _round_up(hulls[at + 3 + j])


@njit
def _write_nothing(out: Hierarchies, block: int, k: int) -> None:
    """Write that a slot of a block is not used."""
    out.refs[WIDTH * block + k] = EMPTY
    for j in range(3):
        place = WIDTH * (6 * block + j) + k
        out.boxes[place], out.boxes[place + 3 * WIDTH] = math.inf, -math.inf


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
def write_block(
    boxes: Floats, codes: NDArray[np.int32], first: int, count: int, out: Hierarchies, block: int
) -> None:
    """Write a block over a run of items that fit into it.

    Parameters
    ----------
    boxes, codes
        Of all items.
    first, count
        The run.
    """
    nowhere = np.float32(math.inf)
    at, planes = WIDTH * block, 6 * WIDTH * block
    # What is not used is written in one go.
    for k in range(WIDTH):
        out.refs[at + k] = EMPTY
    for k in range(3 * WIDTH):
        out.boxes[planes + k] = nowhere
    for k in range(3 * WIDTH, 6 * WIDTH):
        out.boxes[planes + k] = -nowhere
    for k in range(count):
        out.refs[at + k] = codes[first + k]
        item = 6 * (first + k)
        for j in range(3):
            place = planes + WIDTH * j + k
            out.boxes[place] = _round_down(boxes[item + j])
            out.boxes[place + 3 * WIDTH] = _round_up(boxes[item + 3 + j])


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
    n_bins = min(BINS, 4 + (end - begin) // 2)
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
