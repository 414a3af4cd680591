"""Records: leaves with everything that does not depend on the place, and operations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE, UNION
from pcsg.jit import njit
from pcsg.leaf.registry import MODEL_ARGS
from pcsg.trace.expand.clusters import SHEETS, Sizes
from pcsg.trace.expand.layout import (
    N_ARGS,
    N_OPERATIONS,
    N_RECORDS,
    N_ROWS,
    N_SMALLS,
    N_TABLES,
    Layout,
    LayoutWork,
    add_list,
    item_matrix,
    write_row,
)
from pcsg.trace.expand.programs import (
    HAS_DATA,
    IS_SHEET,
    L_ARGS,
    L_FLAGS,
    L_NODE,
    L_SOLID,
    LEAF_FIELDS,
    Programs,
)
from pcsg.trace.expand.table import LEAF, N_ATTRIBUTES, STATE, Table, hash_values
from pcsg.trace.groups import LEAF as LEAF_REF
from pcsg.trace.merge import TABLES
from pcsg.trace.small import ENTRY, HEADER, MAX_PRIMITIVES
from pcsg.vec import IDENTITY, load_affine, store_affine

_UNION, _DIFFERENCE = UNION.kind, DIFFERENCE.kind
_NONE = np.uint64(0)


@njit
def find_record(programs: Programs, table: Table, layout: Layout, work: LayoutWork, i: int) -> int:
    """Return the leaf record of an item; items that are alike share one if there is a table."""
    if layout.record_of[i] >= 0:
        return int(layout.record_of[i])
    number = table.target[i]
    leaf = LEAF_FIELDS * number
    n = programs.leaves[leaf + L_ARGS]
    n_all = n
    for k in range(N_ATTRIBUTES):
        n_all += programs.attributes[k] >= 0
    at = table.numbers_at[i]
    mask = np.uint64(len(layout.record_slots) - 1)
    place = hash_values(number, work.bits, at, n_all) & mask if mask > _NONE else _NONE
    while mask > _NONE:
        record = layout.record_slots[place]
        if record < 0:
            break
        other = layout.record_item[record]
        if table.target[other] == number:
            k, there = 0, table.numbers_at[other]
            while k < n_all and work.bits[at + k] == work.bits[there + k]:
                k += 1
            if k == n_all:
                layout.record_of[i] = record
                return int(record)
        place = (place + np.uint64(1)) & mask
    counters = layout.counters
    record = counters[N_RECORDS]
    counters[N_RECORDS] = record + 1
    layout.record_slots[place] = record
    layout.record_item[record] = i
    layout.record_of[i] = record
    args = counters[N_ARGS]
    flags = programs.leaves[leaf + L_FLAGS]
    layout.leaves[4 * record] = programs.leaves[leaf + L_SOLID]
    layout.leaves[4 * record + 1] = args
    layout.leaves[4 * record + 2] = 1 if flags & IS_SHEET else 0
    layout.leaves[4 * record + 3] = programs.leaves[leaf + L_NODE]
    has_data = flags & HAS_DATA
    count = MODEL_ARGS if has_data else n
    for k in range(count):
        x = programs.fixed[MODEL_ARGS * number + k] if has_data else table.numbers[at + k]
        layout.args[args + k] = x
    counters[N_ARGS] = args + count
    for k in range(N_ATTRIBUTES):
        x = work.defaults[k]
        if programs.attributes[k] >= 0:
            # What is not assigned on the way here is not live, so the state does not know it.
            x = table.numbers[at + n] if table.numbers[at + n] == table.numbers[at + n] else x
            n += 1
        layout.attributes[N_ATTRIBUTES * record + k] = x
    return int(record)


@njit
def write_operation(table: Table, sizes: Sizes, layout: Layout, i: int) -> int:
    """Return where the record of an operation begins; its operands become lists.

    They stand in the frame of the operation's state, so that its copies share them.
    """
    if layout.record_of[i] >= 0:
        return int(layout.record_of[i])
    counters = layout.counters
    at = counters[N_OPERATIONS]
    operator = table.target[i]
    layout.record_of[i] = at
    layout.operations[at] = operator
    layout.operations[at + 2] = 1 if sizes.flags_of[i] & SHEETS else 0
    n = 0
    j = i + 1
    while j < table.end[i]:
        # All that is subtracted is one operand.
        rest = operator == _DIFFERENCE and j > i + 1
        end = table.end[i] if rest else table.end[j]
        if rest or sizes.leaves_of[j] > 0.0:
            layout.operations[at + 3 + n] = add_list(layout, j, end)
            n += 1
        j = end
    layout.operations[at + 1] = n
    counters[N_OPERATIONS] = at + 3 + n
    return int(at)


_SETS = (
    np.uint64(0xAAAAAAAAAAAAAAAA),
    np.uint64(0xCCCCCCCCCCCCCCCC),
    np.uint64(0xF0F0F0F0F0F0F0F0),
    np.uint64(0xFF00FF00FF00FF00),
    np.uint64(0xFFFF0000FFFF0000),
    np.uint64(0xFFFFFFFF00000000),
)
"""Bit m of number j tells whether primitive j is in set m."""


@njit
def combine_truths(table: int, a: np.uint64, b: np.uint64) -> np.uint64:
    """Return the truth table of an operator's result from those of its operands."""
    result = np.uint64(0)
    if table & 8:
        result |= a & b
    if table & 4:
        result |= a & ~b
    if table & 2:
        result |= ~a & b
    if table & 1:
        result |= ~(a | b)
    return result


@njit
def write_small(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    layout: Layout,
    work: LayoutWork,
    item: int,
) -> int:
    """Return where the record of a small operation begins; copies of an operation share it."""
    if layout.record_of[item] >= 0:
        return int(layout.record_of[item])
    counters, frames, matrices, truths = (
        layout.counters,
        work.small_frames,
        work.small_matrices,
        work.truths,
    )
    at = counters[N_SMALLS]
    row = counters[N_ROWS]
    count = np.int64(sizes.leaves_of[item])
    counters[N_ROWS] = row + count
    code = at + HEADER + ENTRY * count + 1
    done = n_truths = 0
    frames[0], frames[1], frames[2], frames[3], frames[4] = item, item + 1, _UNION, 0, 0
    store_affine(matrices, 0, IDENTITY)
    top = 1
    while top > 0:
        f = 5 * (top - 1)
        i, end = frames[f], frames[f + 1]
        if i >= end:
            top -= 1
            if top > 0:
                code, n_truths = _fold(layout, frames, 5 * (top - 1), truths, code, n_truths)
            continue
        operator, folded, flipped = frames[f + 2], frames[f + 3], frames[f + 4]
        frames[f] = table.end[i]
        if sizes.leaves_of[i] == 0.0:
            continue
        flips = flipped ^ (1 if operator == _DIFFERENCE and folded > 0 else 0)
        outer = load_affine(matrices, 12 * (top - 1))
        target = table.target[i]
        if table.kind[i] == LEAF:
            m = item_matrix(table, i, outer)
            record = find_record(programs, table, layout, work, i)
            write_row(layout, row + done, LEAF_REF, record, i, m, work.box)
            entry = at + HEADER + ENTRY * done
            layout.smalls[entry], layout.smalls[entry + 1] = row + done, record
            layout.smalls[entry + 2] = flips
            layout.smalls[code] = done
            truths[n_truths] = _SETS[done]
            done += 1
            code, n_truths = _fold(layout, frames, f, truths, code + 1, n_truths + 1)
            continue
        f = 5 * top
        frames[f + 2], frames[f + 3], frames[f + 4] = _UNION, 0, flips
        if table.kind[i] == STATE:
            frames[f], frames[f + 1] = table.first[target], table.last[target]
            outer = item_matrix(table, i, outer)
        else:
            frames[f], frames[f + 1], frames[f + 2] = i + 1, table.end[i], target
        store_affine(matrices, 12 * top, outer)
        top += 1
    tables = counters[N_TABLES]
    truth = truths[0]
    if count < MAX_PRIMITIVES:
        truth &= (np.uint64(1) << (np.uint64(1) << np.uint64(count))) - np.uint64(1)
    layout.tables[tables] = truth
    counters[N_TABLES] = tables + 1
    required = 0
    for j in range(count):
        if truth & ~_SETS[j] == np.uint64(0):
            required |= 1 << j
    layout.smalls[at], layout.smalls[at + 1], layout.smalls[at + 2] = count, tables, required
    begin = at + HEADER + ENTRY * count
    layout.smalls[begin] = code - begin - 1
    counters[N_SMALLS] = code
    layout.record_of[item] = at
    return int(at)


@njit
def _fold(
    layout: Layout,
    frames: NDArray[np.int32],
    f: int,
    truths: NDArray[np.uint64],
    code: int,
    n_truths: int,
) -> tuple[int, int]:
    """Count an operand of a frame as done; behind the first one comes the operator."""
    if frames[f + 3] > 0:
        operator = frames[f + 2]
        layout.smalls[code] = -1 - operator
        code += 1
        n_truths -= 1
        truths[n_truths - 1] = combine_truths(
            TABLES[operator], truths[n_truths - 1], truths[n_truths]
        )
    frames[f + 3] += 1
    return code, n_truths
