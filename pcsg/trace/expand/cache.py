"""Suspended states are expanded when a ray comes by, into the cache of its thread.

The shared arrays of blocks have a region for every thread. A state that a ray reaches is expanded
some levels at once, laid out like any other cluster, and written there as ordinary blocks, in the
frame of the state. A region that is full is emptied between two rays, so that nothing is lost that
a ray still needs; what is found does not depend on what is there.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.addresses import CALLED, build_reader, view_words
from pcsg.geometry.bvh import BuildWork, Hierarchies
from pcsg.graph.operators import UNION
from pcsg.indices import wide
from pcsg.jit import function_address, njit
from pcsg.simd import WIDTH, stay_apart
from pcsg.trace.ends import NEVER
from pcsg.trace.expand.clusters import (
    BOUNDS,
    CLUSTER,
    Sizes,
    count_leaves,
    measure_states,
)
from pcsg.trace.expand.entries import Entries, enter_state
from pcsg.trace.expand.flatten import finish_rows, lay_out
from pcsg.trace.expand.layout import (
    AT_STATE,
    N_ARGS,
    N_BLOCKS,
    N_LISTS,
    N_OPERATIONS,
    N_RECORDS,
    N_ROWS,
    N_SMALLS,
    N_TABLES,
    Layout,
    LayoutWork,
)
from pcsg.trace.expand.programs import Programs
from pcsg.trace.expand.table import (
    N_ITEMS,
    N_MATRICES,
    N_NUMBERS,
    N_STATES,
    N_VALUES,
    N_WAITING,
    OPERATION,
    STATE,
    Table,
    Work,
    has_room,
    run_program,
)
from pcsg.trace.expand.unions import lay_out_union
from pcsg.trace.groups import SUSPENDED
from pcsg.trace.traversal import GENERATION, IS_FULL, MEMO, STAND_INS

LEAST = 4
"""A state is expanded until it comes to so many references, or to nothing but leaves."""

# What is counted for a region, behind the counters of its layout.
N_SUSPENDED, EXPANSIONS, RUNS = range(3)

_ALL = 1 << 40

_UNION = UNION.kind

Words = NDArray[np.int64]


class Records(NamedTuple):
    """Suspended states.

    Attributes
    ----------
    program, entry : int32 (S,)
    values : float64 (V S,)
        Their live values.
    n_values : int
        V.
    """

    program: NDArray[np.int32]
    entry: NDArray[np.int32]
    values: NDArray[np.float64]
    n_values: int


class Endings(NamedTuple):
    """Where recursion ends, as in `kernel.Cut`, for all references.

    Attributes
    ----------
    of_state : int32 (E K,)
        By entry and program of a state, what `of_reference` says of references to it.
    of_reference, boxes, sizes
        As in `Cut`.
    """

    of_state: NDArray[np.int32]
    of_reference: NDArray[np.int32]
    boxes: NDArray[np.float32]
    sizes: NDArray[np.float64]


class Suspension(NamedTuple):
    """What one thread needs to expand states.

    Attributes
    ----------
    programs, entries
        Of the graph.
    records
        Suspended states, with the thread's own.
    table, bits, work
        The states of one expansion; number 1 is the suspended one.
    entry : int32
        Their entries.
    sizes, order, layout, layout_work, out, build
        What lays it out; the layout's arrays are those of the blocks.
    begins, ends : int64 (9,)
        Where the thread's region begins in every array that the layout counts, and at last in the
        records; and where it ends.
    fills : int64 (9,)
        Where it is full enough to be emptied.
    counts : int64 (3,)
        The number of records, of expansions so far, and of programs that have run for them.
    frames
        `Scratch.frames` of the thread.
    endings
        Where recursion ends.
    """

    programs: Programs
    entries: Entries
    records: Records
    table: Table
    bits: NDArray[np.uint64]
    work: Work
    entry: NDArray[np.int32]
    sizes: Sizes
    order: NDArray[np.int32]
    layout: Layout
    layout_work: LayoutWork
    out: Hierarchies
    build: BuildWork
    begins: NDArray[np.int64]
    ends: NDArray[np.int64]
    fills: NDArray[np.int64]
    counts: NDArray[np.int64]
    frames: NDArray[np.int64]
    endings: Endings


_read: Any = build_reader(Suspension)


def expand(words: Any, record: int) -> int:
    """Expand a suspended state and return its first block; empty the region for record -1.

    Parameters
    ----------
    words
        Of a `Suspension`.
    record
        A record, or, behind all records, that of what stands for the state.

    Returns
    -------
    int
        -1 where that cannot be: a fault, which the walker will tell, or there is no room left.
    """
    own = view_words(words)
    return _empty(own) if record < 0 else _expand(own, record)


@cache
def address() -> int:
    """Return where `expand` is; compiled on the first call, or loaded."""
    return function_address(CALLED, expand)


@njit
def _empty(words: Words) -> int:
    """Empty the thread's region."""
    suspension = _read(words)
    counters, counts, frames = suspension.layout.counters, suspension.counts, suspension.frames
    for k in range(N_BLOCKS + 1):
        counters[k] = suspension.begins[k]
    counts[N_SUSPENDED] = suspension.begins[N_BLOCKS + 1]
    frames[GENERATION] += 1
    frames[IS_FULL] = 0
    return 0


@njit
def _note_filling(words: Words) -> None:
    """Note whether the region is full enough to be emptied."""
    suspension = _read(words)
    fills, counters = suspension.fills, suspension.layout.counters
    full = suspension.counts[N_SUSPENDED] > fills[N_BLOCKS + 1]
    for k in range(N_BLOCKS + 1):
        full = full or (k != N_LISTS and counters[k] > fills[k])
    if full:
        suspension.frames[IS_FULL] = 1


@njit
def _expand(words: Words, record: int) -> int:
    """Expand a suspended state and return its first block.

    -1 where that cannot be: a fault, which the walker will tell, or there is no room left.
    """
    suspension = _read(words)
    counters, frames = suspension.layout.counters, suspension.frames
    suspension.counts[EXPANSIONS] += 1
    references = _run_levels(words, record)
    if references == 0:
        return -1
    row = counters[N_ROWS]
    block = wide(_lay_out_plain(words) if references <= WIDTH else _lay_out(words))
    if block < 0:
        return -1
    _keep_suspended(words, row)
    _note_filling(words)
    frames[MEMO + record] = frames[GENERATION] << 32 | np.int64(block)
    return int(block)


@njit
def _lay_out_plain(words: Words) -> int:
    """Lay out a union that one block holds; return the block or -1."""
    suspension = _read(words)
    ends, counters = suspension.ends, suspension.layout.counters
    has_room = (
        counters[N_ROWS] + WIDTH <= ends[N_ROWS]
        and counters[N_RECORDS] + WIDTH <= ends[N_RECORDS]
        and counters[N_ARGS] + suspension.table.counters[N_NUMBERS] + 3 * WIDTH <= ends[N_ARGS]
        and counters[N_BLOCKS] < ends[N_BLOCKS]
        and suspension.counts[N_SUSPENDED] + WIDTH <= ends[N_BLOCKS + 1]
    )
    if not has_room:
        return -1
    return lay_out_union(
        suspension.programs,
        suspension.table,
        suspension.sizes,
        suspension.layout,
        suspension.out,
        suspension.layout_work,
        1,
    )


@njit
def _lay_out(words: Words) -> int:
    """Lay out what operations are in, or is more than a block holds; return the block or -1."""
    stay_apart()
    suspension = _read(words)
    table, layout = suspension.table, suspension.layout
    counters = layout.counters
    order = suspension.order[: table.counters[N_STATES]]
    _measure(words, order)
    if not _fits(words):
        return -1
    row, operation = counters[N_ROWS], counters[N_OPERATIONS]
    counters[N_LISTS] = counters[AT_STATE] = 0
    lay_out(
        suspension.programs,
        table,
        suspension.sizes,
        order,
        layout.list_middle[:0],
        0,
        0,
        layout,
        suspension.out,
        suspension.layout_work,
        suspension.build,
        _ALL,
    )
    finish_rows(layout, row, operation)
    return int(layout.list_block[layout.list_of[1]])


@njit
def _run_levels(words: Words, record: int) -> int:
    """Run the programs of a state and of some below it.

    Returns
    -------
    int
        How many leaves and suspended states it comes to; one more than a block holds where
        operations are not unions only; 0 for a fault.
    """
    suspension = _read(words)
    programs, entries, table = suspension.programs, suspension.entries, suspension.table
    records, entry, bounds = suspension.records, suspension.entry, suspension.sizes.bounds
    layout = suspension.layout
    counters = table.counters
    counters[N_ITEMS] = counters[N_NUMBERS] = 0
    counters[N_MATRICES] = len(programs.maps) // 12
    counters[N_STATES] = 2
    states = suspension.frames[STAND_INS]
    shown = record >= states
    record -= states if shown else 0
    program, values = wide(records.program[record]), records.n_values * record
    if shown:
        at = records.entry[record] * entries.programs + program
        program, at = wide(entries.stand_in[at]), wide(entries.shown_at[at])
        n = wide(programs.live_at[program + 1] - programs.live_at[program])
        for k in range(n):
            table.values[k] = records.values[values + entries.shown[at + k]]
    else:
        n = wide(programs.live_at[program + 1] - programs.live_at[program])
        for k in range(n):
            table.values[k] = records.values[values + k]
    counters[N_VALUES] = n
    table.first[0] = table.last[0] = 0
    table.values_at[1], table.values_at[2] = 0, n
    table.program[1], table.first[1], table.last[1] = program, -1, -1
    entry[1] = records.entry[record]
    references = 1
    plain = True
    s = 1
    while s < counters[N_STATES]:
        if s > 1 and references >= LEAST and _is_bounded(bounds, BOUNDS * s):
            s += 1
            continue
        if not has_room(programs, table):
            return 0
        counters[N_WAITING] = 0
        before = counters[N_STATES]
        if not run_program(programs, table, suspension.bits, suspension.work, s):
            return 0
        suspension.counts[RUNS] += 1
        at = entries.below_at[entry[s] * entries.programs + table.program[s]]
        references -= 1
        for child in range(before, counters[N_STATES]):
            entry[child] = -1
        for i in range(table.first[s], table.last[s]):
            layout.record_of[i] = -1
            if table.kind[i] == OPERATION:
                plain = plain and table.target[i] == _UNION
                continue
            references += 1
            if table.kind[i] == STATE:
                child = table.target[i]
                enter_state(entries, table, child, at, entry, bounds)
                at += 1
        s += 1
    # What is empty has a block all the same.
    return max(1, references) if plain else WIDTH + 1


@njit
def _is_bounded(bounds: NDArray[np.float64], at: int) -> bool:
    """Return whether a state has a box, or is empty."""
    for k in range(3):
        if bounds[at + k] <= bounds[at + 3 + k] and not (
            abs(bounds[at + k]) < math.inf and abs(bounds[at + 3 + k]) < math.inf
        ):
            return False
    return True


@njit
def _measure(words: Words, order: NDArray[np.int32]) -> None:
    """Find out what the states come to; those that have been expanded are flattened into one."""
    suspension = _read(words)
    sizes, table, layout = suspension.sizes, suspension.table, suspension.layout
    n = len(order)
    for s in range(n):
        # States lead to those with larger numbers only.
        order[s] = n - 1 - s
        sizes.leaves[s] = 0.0
        sizes.refs[s] = sizes.rows[s] = sizes.lists[s] = sizes.numbers[s] = 0
        sizes.depth[s] = sizes.flags[s] = 0
        layout.list_of[s] = -1
    for i in range(table.counters[N_ITEMS]):
        sizes.leaves_of[i] = 0.0
        sizes.refs_of[i] = sizes.rows_of[i] = sizes.lists_of[i] = sizes.numbers_of[i] = 0
        sizes.depth_of[i] = sizes.flags_of[i] = 0
    count_leaves(suspension.programs, table, sizes, order)
    measure_states(table, sizes, order)
    sizes.flags[1] |= CLUSTER
    if sizes.leaves[1] == 0.0:
        # What is empty has a block all the same.
        sizes.leaves[1] = 1.0


@njit
def _fits(words: Words) -> bool:
    """Return whether the region has room for what is to be laid out."""
    suspension = _read(words)
    sizes, ends = suspension.sizes, suspension.ends
    counters = suspension.layout.counters
    rows, lists, numbers = sizes.rows[1], sizes.lists[1] + 1, sizes.numbers[1]
    values = suspension.table.counters[N_NUMBERS]
    return bool(
        counters[N_ROWS] + rows <= ends[N_ROWS]
        and lists <= ends[N_LISTS]
        and counters[N_RECORDS] + rows <= ends[N_RECORDS]
        and counters[N_ARGS] + values + 3 * rows <= ends[N_ARGS]
        and counters[N_SMALLS] + numbers <= ends[N_SMALLS]
        and counters[N_TABLES] + rows <= ends[N_TABLES]
        and counters[N_OPERATIONS] + numbers <= ends[N_OPERATIONS]
        and counters[N_BLOCKS] + rows + lists + 2 <= ends[N_BLOCKS]
        and suspension.counts[N_SUSPENDED] + rows <= ends[N_BLOCKS + 1]
        and 3 * (sizes.depth[1] + 4) <= len(suspension.layout_work.bound_frames)
        and rows <= len(suspension.build.order)
    )


@njit
def note_ending(endings: Endings, boxes: NDArray[np.float64], row: int, state: int) -> None:
    """Note where recursion ends at a reference; `state` is where `of_state` tells of it."""
    ends = endings.of_state[state]
    endings.of_reference[row] = ends
    for k in range(3):
        lower, upper = boxes[6 * row + k], boxes[6 * row + 3 + k]
        endings.boxes[6 * row + k], endings.boxes[6 * row + 3 + k] = lower, upper
        endings.sizes[3 * row + k] = math.inf if ends == NEVER else (upper - lower) ** 2


@njit
def _keep_suspended(words: Words, first_row: int) -> None:
    """Turn the targets of suspended references from states of the table into records."""
    suspension = _read(words)
    layout, records, table = suspension.layout, suspension.records, suspension.table
    counts, n_values = suspension.counts, records.n_values
    for row in range(first_row, layout.counters[N_ROWS]):
        if layout.codes[row] & 7 != SUSPENDED:
            continue
        state, record = layout.targets[row], counts[N_SUSPENDED]
        ends_at = suspension.entry[state] * suspension.entries.programs
        counts[N_SUSPENDED] = record + 1
        layout.targets[row] = record
        records.program[record], records.entry[record] = (
            table.program[state],
            suspension.entry[state],
        )
        note_ending(suspension.endings, layout.boxes, row, ends_at + table.program[state])
        begin = table.values_at[state]
        for k in range(table.values_at[state + 1] - begin):
            records.values[n_values * record + k] = table.values[begin + k]
