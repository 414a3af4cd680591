"""Flattening: states become hierarchies of references, cluster by cluster.

Every cluster is flattened into a list of references in the order of the text, each with its matrix
to the cluster's frame and its box; then the hierarchy over the list is built. Clusters come after
those that they refer to, so that the boxes of instances are those of what they lead to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.bvh import (
    BuildWork,
    Hierarchies,
    begin_block,
    begin_hierarchy,
    build_block,
    end_block,
    split_block,
)
from pcsg.geometry.collapse import MOST_TOGETHER
from pcsg.graph.operators import UNION
from pcsg.jit import njit
from pcsg.trace.expand.boxes import bound_instance, bound_item, bound_leaf, bound_suspended
from pcsg.trace.expand.clusters import (
    CLUSTER,
    FAR,
    Sizes,
    count_operands,
    is_small,
    is_suspended,
)
from pcsg.trace.expand.layout import (
    AT_FIRST,
    AT_LIST,
    AT_PARTS,
    AT_PHASE,
    AT_PIECES,
    AT_ROW,
    AT_RUNS,
    AT_STATE,
    AT_UNBOUNDED,
    N_BLOCKS,
    N_LISTS,
    N_OPERATIONS,
    N_ROWS,
    Layout,
    LayoutWork,
    add_list,
    instance_matrix,
    item_matrix,
    move_frame,
    write_row,
)
from pcsg.trace.expand.opening import open_list
from pcsg.trace.expand.programs import Programs
from pcsg.trace.expand.records import find_record, write_operation, write_small
from pcsg.trace.expand.table import LEAF, OPERATION, STATE, Table
from pcsg.trace.groups import INSTANCE as INSTANCE_REF
from pcsg.trace.groups import LEAF as LEAF_REF
from pcsg.trace.groups import OPERATION as OPERATION_REF
from pcsg.trace.groups import SMALL as SMALL_REF
from pcsg.trace.groups import SUSPENDED as SUSPENDED_REF
from pcsg.vec import IDENTITY, invert, load_affine, store_affine

_UNION = UNION.kind


_NEXT_STATE, _NEXT_LIST, _FLATTEN, _OPEN, _BUILD = range(5)
"""Phases of a layout."""


@njit(entry=True)
def lay_out(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    order: NDArray[np.int32],
    origins: NDArray[np.float64],
    limit: int,
    root_limit: int,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    build: BuildWork,
    most: int,
) -> int:
    """Go on with the layout of the clusters, in the order of the states.

    Parameters
    ----------
    origins
        As in `Frames`.
    limit, root_limit
        References up to which lists are opened, and the axiom's.
    most
        Work until it returns: about the number of references.

    Returns
    -------
    int
        1 when all is done, else 0.
    """
    c = layout.counters
    boxes = layout.boxes
    while most > 0:
        phase = c[AT_PHASE]
        if phase == _NEXT_STATE:
            if c[AT_STATE] == len(order):
                return 1
            s = order[c[AT_STATE]]
            most -= 1
            # An axiom that is empty has an empty block.
            if sizes.flags[s] & CLUSTER and (sizes.leaves[s] > 0.0 or s == 0):
                c[AT_FIRST] = c[AT_LIST] = c[N_LISTS]
                k = add_list(layout, table.first[s], table.last[s])
                layout.list_of[s] = k
                if sizes.flags[s] & FAR:
                    layout.list_far[k] = 1
                    for j in range(3):
                        layout.list_middle[3 * k + j] = origins[3 * s + j]
                c[AT_PHASE] = _NEXT_LIST
            else:
                c[AT_STATE] += 1
        elif phase == _NEXT_LIST:
            # Operands have become lists of their own while others were flattened.
            if c[AT_LIST] < c[N_LISTS]:
                _begin_list(table, sizes, layout, work, c[AT_LIST])
                c[AT_PHASE] = _FLATTEN
            else:
                c[AT_LIST] = c[AT_FIRST]
                c[AT_PHASE] = _OPEN
        elif phase == _FLATTEN:
            most = _flatten(programs, table, sizes, layout, out, work, most)
            if c[AT_RUNS] == 0:
                layout.list_end[c[AT_LIST]] = c[AT_ROW]
                c[AT_LIST] += 1
                c[AT_PHASE] = _NEXT_LIST
        elif phase == _OPEN:
            if c[AT_LIST] == c[N_LISTS]:
                c[AT_STATE] += 1
                c[AT_PHASE] = _NEXT_STATE
                continue
            k = c[AT_LIST]
            is_root = order[c[AT_STATE]] == 0 and k == c[AT_FIRST]
            up_to = root_limit if is_root else limit
            row, end = open_list(programs, table, sizes, layout, out, work, k, up_to)
            layout.list_block[k] = c[N_BLOCKS]
            parts, unbounded = begin_hierarchy(boxes, row, end - row, c[N_BLOCKS], build)
            c[AT_PARTS], c[AT_UNBOUNDED] = parts, unbounded
            c[N_BLOCKS] += 1
            c[AT_PHASE] = _BUILD
            most -= end - row
        elif c[AT_PARTS] > 0:
            most -= _build_on(layout, out, build)
        else:
            c[AT_LIST] += 1
            c[AT_PHASE] = _OPEN
    return 0


@njit
def _build_on(layout: Layout, out: Hierarchies, build: BuildWork) -> int:
    """Go on with the present block, a split at a time; return about how much work that was."""
    c = layout.counters
    waiting, n = c[AT_PARTS], c[AT_PIECES]
    if n < 0:
        c[AT_PIECES] = begin_block(layout.boxes, waiting, build)
        return 1
    n, parted = split_block(layout.boxes, waiting, c[AT_UNBOUNDED], n, build)
    c[AT_PIECES] = n
    if parted == 0:
        items = int(build.stack[4 * waiting - 3] - build.stack[4 * waiting - 4])
        c[N_BLOCKS], c[AT_PARTS] = end_block(
            layout.boxes, layout.codes, out, c[N_BLOCKS], waiting, c[AT_UNBOUNDED], n, build
        )
        c[AT_PIECES] = -1
        # Blocks over few references are built together.
        return 1 + min(items, MOST_TOGETHER)
    # References are flattened about as fast as sixteen times as many are parted.
    return 1 + parted // 16


@njit
def _begin_list(table: Table, sizes: Sizes, layout: Layout, work: LayoutWork, k: int) -> None:
    """Put the items of a list on the stack, and keep room for its references."""
    c = layout.counters
    layout.list_first[k] = c[AT_ROW] = c[N_ROWS]
    i = layout.list_item[k]
    while i < layout.list_item_end[k]:
        c[N_ROWS] += sizes.refs_of[i]
        i = table.end[i]
    work.frames[0], work.frames[1] = layout.list_item[k], layout.list_item_end[k]
    store_affine(work.frame_matrices, 0, move_frame(IDENTITY, layout, k, -1.0))
    c[AT_RUNS] = 1


@njit
def _flatten(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    most: int,
) -> int:
    """Write references of the present list; return how much work is left to do before returning."""
    frames, matrices = work.frames, work.frame_matrices
    row, top = layout.counters[AT_ROW], layout.counters[AT_RUNS]
    while top > 0 and most > 0:
        i, end = frames[2 * top - 2], frames[2 * top - 1]
        if i >= end:
            top -= 1
            continue
        most -= 1
        frames[2 * top - 2] = table.end[i]
        if sizes.leaves_of[i] == 0.0:
            continue
        kind, target = table.kind[i], table.target[i]
        outer = load_affine(matrices, 12 * (top - 1))
        if kind == LEAF:
            m = item_matrix(table, i, outer)
            bound_leaf(programs, table, i, m, work)
            record = find_record(programs, table, layout, work, i)
            write_row(layout, row, LEAF_REF, record, i, m, work.box)
            row += 1
        elif kind == STATE and sizes.flags[target] & CLUSTER:
            m = instance_matrix(table, layout, i, outer)
            number = layout.list_of[target]
            bound_instance(programs, table, layout, out, work, number, m)
            write_row(layout, row, INSTANCE_REF, number, i, m, work.box)
            row += 1
        elif kind == STATE and is_suspended(table, target):
            m = item_matrix(table, i, outer)
            bound_suspended(sizes, target, m, work.box)
            write_row(layout, row, SUSPENDED_REF, target, i, m, work.box)
            row += 1
        elif kind == OPERATION and target != _UNION and count_operands(table, sizes, i) > 1:
            if is_small(sizes, i):
                code, at = SMALL_REF, write_small(programs, table, sizes, layout, work, i)
            else:
                code, at = OPERATION_REF, write_operation(table, sizes, layout, i)
            bound_item(programs, table, sizes, layout, out, work, i, outer)
            write_row(layout, row, code, at, i, outer, work.box)
            row += 1
        else:
            # A state or a union that is flattened. What is done with does not stay on the stack.
            if frames[2 * top - 2] >= end:
                top -= 1
            if kind == STATE:
                frames[2 * top], frames[2 * top + 1] = table.first[target], table.last[target]
                outer = item_matrix(table, i, outer)
            else:
                frames[2 * top], frames[2 * top + 1] = i + 1, table.end[i]
            store_affine(matrices, 12 * top, outer)
            top += 1
    layout.counters[AT_ROW], layout.counters[AT_RUNS] = row, top
    return most


@njit(entry=True)
def move_axiom(
    programs: Programs,
    table: Table,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    build: BuildWork,
) -> None:
    """Put the axiom's cluster into the world, where its frame is another one, as an instance."""
    c = layout.counters
    number = layout.list_of[0]
    k = add_list(layout, -1, -1)
    row = c[N_ROWS]
    layout.list_first[k], layout.list_end[k] = row, row + 1
    layout.list_block[k] = c[N_BLOCKS]
    c[N_ROWS], c[N_BLOCKS] = row + 1, c[N_BLOCKS] + 1
    m = move_frame(IDENTITY, layout, number, 1.0)
    bound_instance(programs, table, layout, out, work, number, m)
    write_row(layout, row, INSTANCE_REF, number, -1, m, work.box)
    waiting, unbounded = begin_hierarchy(layout.boxes, row, 1, layout.list_block[k], build)
    build_block(layout.boxes, layout.codes, out, c[N_BLOCKS], waiting, unbounded, build)
    layout.list_of[0] = k


@njit(entry=True)
def finish_layout(layout: Layout) -> None:
    """Turn matrices about, and lists into their first blocks."""
    finish_rows(layout, 0, 0)


@njit
def finish_rows(layout: Layout, first_row: int, operation: int) -> None:
    """Finish the references from one on, and the records of operations."""
    counters = layout.counters
    for row in range(first_row, counters[N_ROWS]):
        inverse, _ = invert(load_affine(layout.matrices, 12 * row))
        store_affine(layout.matrices, 12 * row, inverse)
        if layout.codes[row] & 7 == INSTANCE_REF:
            layout.targets[row] = layout.list_block[layout.targets[row]]
    at = operation
    while at < counters[N_OPERATIONS]:
        n = layout.operations[at + 1]
        for k in range(n):
            layout.operations[at + 3 + k] = layout.list_block[layout.operations[at + 3 + k]]
        at += 3 + n
