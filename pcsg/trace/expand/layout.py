"""What is laid out: references with their matrices and boxes, and what they refer to.

A *list* is a run of references that one hierarchy stands over: a cluster's, or an operand's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.trace.expand.table import Table
from pcsg.vec import Affine, Vec3, compose, load_affine, store_affine, transform_point

# Counters of a layout: how many there are of each,
N_ROWS, N_LISTS, N_RECORDS, N_ARGS, N_SMALLS, N_TABLES, N_OPERATIONS, N_BLOCKS = range(8)
# and how far it has come: the position in the order of states, the cluster's first list, what is
# done with the present list, which one it is, the runs of items that wait, the next reference, the
# parts that wait for their blocks, and the items without bounds.
AT_STATE, AT_FIRST, AT_PHASE, AT_LIST, AT_RUNS, AT_ROW, AT_PARTS, AT_UNBOUNDED = range(8, 16)
# The parts of the block that is in the making, -1 for none.
AT_PIECES = 16
COUNTERS = 17


class Layout(NamedTuple):
    """References, and what they refer to; see `Blocks` for what is the same there.

    Attributes
    ----------
    matrices : float64 (12 R,)
        list_from_target of every reference; at the end its inverse.
    targets : int32 (R,)
        As in `Blocks`, but an instance's is the list of its cluster; at the end its first block.
    codes : int32 (R,)
        ``row << 3 | kind``.
    items : int32 (R,)
        The item of every reference.
    boxes : float64 (6 R,)
    list_first, list_end, list_block : int32 (L,)
        References of every list, and the first block of its hierarchy.
    list_item, list_item_end : int32 (L,)
        The items that it is made of.
    list_far : int32 (L,)
        1 for clusters whose frame must not be left, see `frames`: they are never opened.
    list_middle : float64 (3 L,)
        Where the origin of a cluster's frame is in that of its state.
    list_of : int32 (N,)
        The list of every cluster, by its state.
    record_of : int32 (M,)
        The leaf record or the record of the operation of every item, -1 before it was met.
    record_slots : int32 (H,)
        Hash table of leaf records, -1 where free; with one entry, records are not told apart.
    record_item : int32 (L,)
        An item of every leaf record.
    leaves, args, attributes, smalls, tables, operations
        As in `Blocks`; operands of operations are lists, at the end their first blocks.
    counters : int64
    """

    matrices: NDArray[np.float64]
    targets: NDArray[np.int32]
    codes: NDArray[np.int32]
    items: NDArray[np.int32]
    boxes: NDArray[np.float64]
    list_first: NDArray[np.int32]
    list_end: NDArray[np.int32]
    list_block: NDArray[np.int32]
    list_item: NDArray[np.int32]
    list_item_end: NDArray[np.int32]
    list_far: NDArray[np.int32]
    list_middle: NDArray[np.float64]
    list_of: NDArray[np.int32]
    record_of: NDArray[np.int32]
    record_slots: NDArray[np.int32]
    record_item: NDArray[np.int32]
    leaves: NDArray[np.int32]
    args: NDArray[np.float64]
    attributes: NDArray[np.float64]
    smalls: NDArray[np.int32]
    tables: NDArray[np.uint64]
    operations: NDArray[np.int32]
    counters: NDArray[np.int64]


class LayoutWork(NamedTuple):
    """Working space.

    Attributes
    ----------
    frames, frame_matrices : int32 (2 D,), float64 (12 D,)
        Stack of runs of items, and the matrix of each.
    bound_frames, bound_matrices : int32 (3 D,), float64 (12 D,)
        The same for bounding; and where the intersection ends whose operand a run is, else -1.
    small_frames, small_matrices : int32 (5 D,), float64 (12 D,)
        The same for a small operation; with the operator, the operands done, and whether it flips.
    truths : uint64
        Stack of truth tables.
    accumulated : float64 (12 D,)
        For every nested intersection: the box of what came before it, and its own so far.
    heap, heap_codes : float64 (5 K,), int32 (K,)
        What a search for a support has still to look into: its bound, the direction, the offset;
        and a reference.
    opened_rows, opened_next : int32 (C,)
        References of a list that is opened, as a linked list.
    opened_matrices, opened_areas : float64 (12 C,), float64 (C,)
        Their matrices, and the areas of the boxes of instances.
    bits : uint64
        `Table.numbers` as bits.
    box, moved : float64 (6,)
        Room for a box, and for one in another frame.
    defaults : float64 (7,)
        Of attributes.
    """

    frames: NDArray[np.int32]
    frame_matrices: NDArray[np.float64]
    bound_frames: NDArray[np.int32]
    bound_matrices: NDArray[np.float64]
    small_frames: NDArray[np.int32]
    small_matrices: NDArray[np.float64]
    truths: NDArray[np.uint64]
    accumulated: NDArray[np.float64]
    heap: NDArray[np.float64]
    heap_codes: NDArray[np.int32]
    opened_rows: NDArray[np.int32]
    opened_next: NDArray[np.int32]
    opened_matrices: NDArray[np.float64]
    opened_areas: NDArray[np.float64]
    bits: NDArray[np.uint64]
    box: NDArray[np.float64]
    moved: NDArray[np.float64]
    defaults: NDArray[np.float64]


@njit(inline=True)
def item_matrix(table: Table, i: int, outer: Affine) -> Affine:
    """Return the matrix of an item in the frame that `outer` leads to."""
    m = wide(table.matrix[i])
    return outer if m < 0 else compose(outer, load_affine(table.matrices, 12 * m))


@njit
def instance_matrix(table: Table, layout: Layout, i: int, outer: Affine) -> Affine:
    """Return the matrix of the cluster that an item is, in the frame that `outer` leads to."""
    m = item_matrix(table, i, outer)
    number = layout.list_of[table.target[i]]
    return move_frame(m, layout, number, 1.0)


@njit
def move_frame(m: Affine, layout: Layout, number: int, way: float) -> Affine:
    """Return a matrix from a cluster's frame by that from its state's, or the other one (-1)."""
    if layout.list_far[number] == 0:
        return m
    at = 3 * number
    x, y, z = layout.list_middle[at], layout.list_middle[at + 1], layout.list_middle[at + 2]
    x, y, z = way * x, way * y, way * z
    p = transform_point(m, Vec3(x, y, z))
    return Affine(m.m00, m.m01, m.m02, p.x, m.m10, m.m11, m.m12, p.y, m.m20, m.m21, m.m22, p.z)


@njit
def add_list(layout: Layout, item: int, end: int) -> int:
    """Append a list of what items come to, and return its number."""
    k = layout.counters[N_LISTS]
    layout.list_item[k], layout.list_item_end[k] = item, end
    layout.list_far[k] = 0
    layout.counters[N_LISTS] = k + 1
    return int(k)


@njit
def write_row(
    layout: Layout,
    row: int,
    kind: int,
    target: int,
    item: int,
    m: Affine,
    box: NDArray[np.float64],
) -> None:
    """Write a reference."""
    layout.codes[row] = np.int32(row << 3 | kind)
    layout.targets[row], layout.items[row] = target, item
    store_affine(layout.matrices, 12 * row, m)
    for k in range(6):
        layout.boxes[6 * row + k] = box[k]
