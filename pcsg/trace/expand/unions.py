"""Unions of few solids are laid out in one go: one list, one block.

What rays expand is mostly of this kind; see `flatten` for everything else.
"""

from __future__ import annotations

from pcsg.geometry.bvh import Hierarchies, write_block
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.trace.expand.boxes import bound_leaf, bound_suspended
from pcsg.trace.expand.clusters import Sizes, is_suspended
from pcsg.trace.expand.layout import N_BLOCKS, N_ROWS, Layout, LayoutWork, item_matrix
from pcsg.trace.expand.programs import IS_EMPTY, L_FLAGS, LEAF_FIELDS, Programs
from pcsg.trace.expand.records import find_record
from pcsg.trace.expand.table import LEAF, OPERATION, Table
from pcsg.trace.groups import LEAF as LEAF_REF
from pcsg.trace.groups import SUSPENDED
from pcsg.vec import IDENTITY, invert, load_affine, store_affine


@njit(inline=True)
def lay_out_union(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    state: int,
) -> int:
    """Lay out a state that comes to no more leaves and suspended states than a block has boxes.

    Matrices are turned about at once, see `finish_rows`; targets of suspended references are
    states.

    Returns
    -------
    int
        The block.
    """
    counters, frames, matrices = layout.counters, work.frames, work.frame_matrices
    first = wide(counters[N_ROWS])
    row = first
    frames[0], frames[1] = table.first[state], table.last[state]
    store_affine(matrices, 0, IDENTITY)
    top = 1
    while top > 0:
        i, end = wide(frames[2 * top - 2]), wide(frames[2 * top - 1])
        if i >= end:
            top -= 1
            continue
        frames[2 * top - 2] = i + 1
        if table.kind[i] == OPERATION:
            # A union, whose operands come next.
            continue
        target = wide(table.target[i])
        m = item_matrix(table, i, load_affine(matrices, 12 * (top - 1)))
        if table.kind[i] == LEAF:
            if programs.leaves[LEAF_FIELDS * target + L_FLAGS] & IS_EMPTY:
                continue
            bound_leaf(programs, table, i, m, work)
            layout.targets[row] = find_record(programs, table, layout, work, i)
            layout.codes[row] = row << 3 | LEAF_REF
        elif is_suspended(table, target):
            bound_suspended(sizes, target, m, work.box)
            layout.targets[row] = target
            layout.codes[row] = row << 3 | SUSPENDED
        else:
            frames[2 * top], frames[2 * top + 1] = table.first[target], table.last[target]
            store_affine(matrices, 12 * top, m)
            top += 1
            continue
        at = 12 * wide(table.matrix[i])
        if top == 1 and 0 <= at < len(programs.inverses):
            store_affine(layout.matrices, 12 * row, load_affine(programs.inverses, at))
        else:
            inverse, _ = invert(m)
            store_affine(layout.matrices, 12 * row, inverse)
        for k in range(6):
            layout.boxes[6 * row + k] = work.box[k]
        row += 1
    block = wide(counters[N_BLOCKS])
    counters[N_BLOCKS] = block + 1
    counters[N_ROWS] = row
    write_block(layout.boxes, layout.codes, first, row - first, out, block)
    return block
