"""Which states are flattened into their surroundings, and which are clusters of their own.

What is referred to once, or whose copies total at most 64 leaves, is flattened: its leaves stand
in the surrounding cluster with one matrix each. What is referred to several times and is large is
a shared cluster, entered by instances. Operands of large operations are hierarchies of their own in
the cluster's frame.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE, UNION
from pcsg.jit import njit
from pcsg.trace.expand.frames import (
    Frames,
    is_far,
    load_origin,
    middle_of,
    move_origin,
    store_origin,
)
from pcsg.trace.expand.programs import HAS_DATA, IS_EMPTY, IS_SHEET, L_FLAGS, LEAF_FIELDS, Programs
from pcsg.trace.expand.table import LEAF, OPERATION, STATE, Table
from pcsg.trace.small import MAX_PRIMITIVES
from pcsg.vec import Vec3

_UNION, _DIFFERENCE = UNION.kind, DIFFERENCE.kind

MOST_COPIED = 64
"""Leaves that all copies of a state may have together and be flattened."""

# Flags of states and of items.
PLAIN, SHEETS, CLUSTER, FAR = 1, 2, 4, 8
"""PLAIN: only leaves without data and without sheets, none of them in another cluster. SHEETS:
there are sheets below. FAR: a cluster whose frame must not be left, see `frames`."""


BOUNDS = 7
"""Numbers of the bounds of a state that is suspended."""


class Sizes(NamedTuple):
    """What states (N,) and items (M,) come to when they are flattened.

    Attributes
    ----------
    leaves, leaves_of : float64
        Leaves of the whole expansion, of a state and of an item.
    refs, refs_of : int32
        References in the surrounding hierarchy.
    rows, rows_of : int32
        References with those of operands and of small operations.
    lists, lists_of : int32
        Hierarchies of operands.
    numbers, numbers_of : int32
        Entries of records of operations.
    depth, depth_of : int32
        Runs of items that wait while it is flattened, at most.
    flags, flags_of : int32
    copies : float64
        How often a state stands in its surroundings.
    bounds : float64 (7 N,)
        Of states that are suspended: box, and reach from the origin.
    """

    leaves: NDArray[np.float64]
    refs: NDArray[np.int32]
    rows: NDArray[np.int32]
    lists: NDArray[np.int32]
    numbers: NDArray[np.int32]
    depth: NDArray[np.int32]
    flags: NDArray[np.int32]
    copies: NDArray[np.float64]
    bounds: NDArray[np.float64]
    leaves_of: NDArray[np.float64]
    refs_of: NDArray[np.int32]
    rows_of: NDArray[np.int32]
    lists_of: NDArray[np.int32]
    numbers_of: NDArray[np.int32]
    depth_of: NDArray[np.int32]
    flags_of: NDArray[np.int32]


def make_sizes(states: int, items: int) -> Sizes:
    """Return room for the sizes of states and items."""
    # What is laid out fits into memory, so that its numbers are small.
    kinds = {"leaves": np.float64, "copies": np.float64, "bounds": np.float64}
    room: dict[str, Any] = {}
    for name in Sizes._fields:
        kind = kinds.get(name.removesuffix("_of"), np.int32)
        room[name] = np.zeros(items if name.endswith("_of") else states, kind)
    return Sizes(**room)


@njit(inline=True)
def is_suspended(table: Table, state: int) -> bool:
    """Return whether a state's program has not run."""
    return bool(table.first[state] < 0)


@njit(entry=True)
def order_states(
    table: Table, order: NDArray[np.int32], seen: NDArray[np.int32], stack: NDArray[np.int32]
) -> int:
    """Write the states to `order`, each after those that it contains.

    Parameters
    ----------
    seen : int32 (N,)
        Zeros; afterwards the depth of every state, counted from its deepest leaf.
    stack : int32 (2 N,)
        Working space.

    Returns
    -------
    int
        -1, or a state that contains itself.
    """
    n = 0
    stack[0], stack[1] = 0, table.first[0]
    seen[0] = -1
    top = 1
    while top > 0:
        s, i = stack[2 * top - 2], stack[2 * top - 1]
        if i == table.last[s]:
            top -= 1
            order[n] = s
            n += 1
            seen[s] = 1
            continue
        stack[2 * top - 1] = i + 1
        if table.kind[i] == STATE:
            child = table.target[i]
            if seen[child] == -1:
                return int(child)
            if seen[child] == 0:
                seen[child] = -1
                stack[2 * top], stack[2 * top + 1] = child, table.first[child]
                top += 1
    return -1


@njit(entry=True)
def count_leaves(programs: Programs, table: Table, sizes: Sizes, order: NDArray[np.int32]) -> None:
    """Fill in the leaves of states and items, and the flag of sheets."""
    for s in order:
        total, flags = 0.0, 0
        if is_suspended(table, s):
            total = 1.0
            if programs.below[table.program[s]] & IS_SHEET:
                flags = SHEETS
        for i in range(table.last[s] - 1, table.first[s] - 1, -1):
            kind, target = table.kind[i], table.target[i]
            if kind == LEAF:
                own = programs.leaves[LEAF_FIELDS * target + L_FLAGS]
                sizes.leaves_of[i] = 0.0 if own & IS_EMPTY else 1.0
                sizes.flags_of[i] = (SHEETS if own & IS_SHEET else 0) | (
                    0 if own & (HAS_DATA | IS_SHEET) else PLAIN
                )
            elif kind == STATE:
                sizes.leaves_of[i] = sizes.leaves[target]
                sizes.flags_of[i] = sizes.flags[target] & SHEETS
            else:
                _count_operation(table, sizes, i)
        i = table.first[s]
        while i < table.last[s]:
            total += sizes.leaves_of[i]
            flags |= sizes.flags_of[i] & SHEETS
            i = table.end[i]
        sizes.leaves[s], sizes.flags[s] = total, flags


@njit
def _count_operation(table: Table, sizes: Sizes, i: int) -> None:
    """Fill in the leaves of an operation from those of its operands."""
    operator = table.target[i]
    total, flags = 0.0, 0
    j = i + 1
    while j < table.end[i]:
        if sizes.leaves_of[j] > 0.0:
            total += sizes.leaves_of[j]
            flags |= sizes.flags_of[j] & SHEETS
        elif operator != _UNION and (operator != _DIFFERENCE or j == i + 1):
            total, flags = 0.0, 0
            break
        j = table.end[j]
    sizes.leaves_of[i], sizes.flags_of[i] = total, flags


@njit(entry=True)
def choose_clusters(table: Table, sizes: Sizes, frames: Frames, order: NDArray[np.int32]) -> None:
    """Mark the states that are clusters of their own, from the axiom down."""
    framed = len(frames.widths) > 0
    sizes.copies[0] = 1.0
    sizes.flags[0] |= CLUSTER
    for k in range(len(order) - 1, -1, -1):
        s = order[k]
        copies, leaves = sizes.copies[s], sizes.leaves[s]
        if copies > 1.0 and leaves > 1.0 and copies * leaves > MOST_COPIED:
            sizes.flags[s] |= CLUSTER
        if framed and s != 0 and is_far(frames, s, leaves, load_origin(frames, s)):
            sizes.flags[s] |= CLUSTER | FAR
        if sizes.flags[s] & CLUSTER:
            copies = 1.0
            if framed:
                _choose_origin(sizes, frames, s)
        for i in range(table.first[s], table.last[s]):
            if table.kind[i] == STATE:
                sizes.copies[table.target[i]] += copies
                if framed:
                    move_origin(frames, table, s, i)


@njit
def _choose_origin(sizes: Sizes, frames: Frames, s: int) -> None:
    """Choose where the origin of a cluster's frame is."""
    origin = Vec3(0.0, 0.0, 0.0)
    if is_far(frames, s, sizes.leaves[s], origin):
        sizes.flags[s] |= FAR
        origin = middle_of(frames, s)
    store_origin(frames, s, origin)


@njit(entry=True)
def measure_states(table: Table, sizes: Sizes, order: NDArray[np.int32]) -> None:
    """Fill in what states and items come to, from the leaves up."""
    for s in order:
        for i in range(table.last[s] - 1, table.first[s] - 1, -1):
            kind, target = table.kind[i], table.target[i]
            if sizes.leaves_of[i] == 0.0:
                sizes.flags_of[i] |= PLAIN
            elif kind == LEAF:
                sizes.refs_of[i] = sizes.rows_of[i] = 1
            elif kind == OPERATION:
                _measure_operation(table, sizes, i)
            elif sizes.flags[target] & CLUSTER or is_suspended(table, target):
                sizes.refs_of[i] = sizes.rows_of[i] = 1
            else:
                sizes.refs_of[i], sizes.rows_of[i] = sizes.refs[target], sizes.rows[target]
                # Pages that nobody writes to take no memory.
                if sizes.numbers[target] > 0:
                    sizes.lists_of[i] = sizes.lists[target]
                    sizes.numbers_of[i] = sizes.numbers[target]
                sizes.depth_of[i] = sizes.depth[target]
                sizes.flags_of[i] |= sizes.flags[target] & PLAIN
        plain = PLAIN
        i = table.first[s]
        while i < table.last[s]:
            # What comes last does not wait for anything.
            wait = 1 if table.end[i] < table.last[s] else 0
            sizes.depth[s] = max(sizes.depth[s], 1, sizes.depth_of[i] + wait)
            sizes.refs[s] += sizes.refs_of[i]
            sizes.rows[s] += sizes.rows_of[i]
            if sizes.numbers_of[i] > 0:
                sizes.lists[s] += sizes.lists_of[i]
                sizes.numbers[s] += sizes.numbers_of[i]
            plain &= sizes.flags_of[i]
            i = table.end[i]
        sizes.flags[s] |= plain


@njit
def _measure_operation(table: Table, sizes: Sizes, i: int) -> None:
    operator = table.target[i]
    refs = rows = lists = numbers = operands = 0
    plain = PLAIN
    j = i + 1
    while j < table.end[i]:
        if sizes.leaves_of[j] > 0.0:
            operands += 1
            refs += sizes.refs_of[j]
            rows += sizes.rows_of[j]
            lists += sizes.lists_of[j]
            numbers += sizes.numbers_of[j]
            plain &= sizes.flags_of[j]
        sizes.depth_of[i] = max(sizes.depth_of[i], sizes.depth_of[j] + 1)
        j = table.end[j]
    sizes.flags_of[i] |= plain
    if operator != _UNION and operands > 1:
        refs = 1
        if plain and sizes.leaves_of[i] <= MAX_PRIMITIVES:
            rows = 1 + int(sizes.leaves_of[i])
            lists = 0
            numbers = 3 + 3 * (rows - 1) + 1 + 2 * (rows - 1)
        else:
            # All that is subtracted is one hierarchy.
            operands = 2 if operator == _DIFFERENCE else operands
            rows += 1
            lists += operands
            numbers += 3 + operands
    sizes.refs_of[i], sizes.rows_of[i] = refs, rows
    sizes.lists_of[i], sizes.numbers_of[i] = lists, numbers


@njit
def is_small(sizes: Sizes, i: int) -> bool:
    """Return whether an operation is a truth table over a few primitives."""
    return bool(sizes.flags_of[i] & PLAIN) and sizes.leaves_of[i] <= MAX_PRIMITIVES


@njit
def count_operands(table: Table, sizes: Sizes, i: int) -> int:
    """Return how many operands of an operation are not empty."""
    n = 0
    j = i + 1
    while j < table.end[i]:
        n += sizes.leaves_of[j] > 0.0
        j = table.end[j]
    return n
