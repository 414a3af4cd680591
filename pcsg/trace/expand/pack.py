"""From a table of states to blocks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.bvh import Hierarchies, make_build_work
from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS
from pcsg.simd import WIDTH
from pcsg.trace import blocks as opening
from pcsg.trace.blocks import Blocks, as_single
from pcsg.trace.expand.clusters import (
    CLUSTER,
    Sizes,
    choose_clusters,
    count_leaves,
    make_sizes,
    measure_states,
)
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.extremes import outermost_boxes
from pcsg.trace.expand.flatten import finish_layout, lay_out, move_axiom
from pcsg.trace.expand.frames import Frames, find_frames
from pcsg.trace.expand.layout import (
    AT_PIECES,
    AT_ROW,
    AT_RUNS,
    COUNTERS,
    N_ARGS,
    N_BLOCKS,
    N_OPERATIONS,
    N_RECORDS,
    N_ROWS,
    N_SMALLS,
    N_TABLES,
    Layout,
    LayoutWork,
)
from pcsg.trace.expand.table import LEAF, N_ATTRIBUTES, N_NUMBERS, STATE, Table
from pcsg.trace.groups import INSTANCE, SUSPENDED
from pcsg.trace.preparing import UNLIMITED, Preparation
from pcsg.trace.shrinking import find_shrunk

SLICE = 20_000
"""References that are laid out before control returns to Python, where Ctrl-C is seen."""

_ROW_BYTES = 320
"""Bytes of a reference while it is laid out, with its part of blocks and of copies."""

_PER_BLOCK = 9
"""References of a block, about."""

_HEAP = 4_096
"""Entries of a search for a support; with more, its bound stands."""


class Packed(NamedTuple):
    """An expansion, packed.

    Attributes
    ----------
    blocks
        Its blocks.
    box : float64 (2, 3)
        Box about everything; lower above upper where nothing is.
    bounded : float64 (2, 3)
        Box about all that is bounded.
    leaves : float
        Leaves of the whole expansion.
    clusters : int
        Clusters that several instances may share, with the axiom's.
    may_shrink : bool
        Whether a module's frame may be below rounding, where it is empty.
    """

    blocks: Blocks
    box: NDArray[np.float64]
    bounded: NDArray[np.float64]
    leaves: float
    clusters: int
    may_shrink: bool


def pack_expansion(expansion: Expansion, preparation: Preparation = UNLIMITED) -> Packed:
    """Return the blocks of an expansion without cycles; it is used up.

    Parameters
    ----------
    preparation
        Is told how far it is, and asked for memory.

    Raises
    ------
    EnvironmentFault
        There is no memory for it.
    """
    programs, table, order = expansion.programs, expansion.take_items(), expansion.order
    if order is None:
        raise ValueError("a state contains itself")
    shrinks = _may_shrink(expansion, table, order)
    sizes = make_sizes(expansion.n_states, expansion.n_items)
    if expansion.bounds is not None:
        sizes = sizes._replace(bounds=expansion.bounds)
    count_leaves(programs, table, sizes, order)
    if expansion.bounds is None:
        frames = find_frames(programs, table, sizes.leaves_of, order)
    else:
        # Suspended states have frames of their own.
        frames = Frames(np.zeros(0), np.zeros(0), np.zeros(0))
    choose_clusters(table, sizes, frames, order)
    measure_states(table, sizes, order)
    clusters = np.flatnonzero((sizes.flags & CLUSTER) != 0)
    # The axiom's may be moved.
    lists = int(sizes.lists[clusters].sum()) + len(clusters) + 1
    limit = min(opening.OPEN_GROUP, opening.OPEN_TOTAL // len(clusters))
    whole = sizes.leaves[0]
    root_limit = max(opening.OPEN_ROOT, int(whole) if whole <= opening.OPEN_WHOLE else 0)
    # Lists with instances are written a second time where they are opened.
    shared = limit * lists + root_limit if len(clusters) > 1 else 0
    rows = int(sizes.rows[clusters].sum()) + shared + 1
    preparation.require(sum(a.nbytes for a in table) + _ROW_BYTES * rows)
    layout = _make_layout(expansion, sizes, clusters, rows, lists)
    # Every block but the first of a list has two references at least.
    blocks = rows + lists + 2
    out = Hierarchies(np.empty(6 * WIDTH * blocks, np.float32), np.empty(WIDTH * blocks, np.int32))
    depth = int(max(sizes.depth.max(), sizes.depth_of.max(initial=0))) + 4
    work = make_layout_work(depth, max(root_limit, limit), table)
    build = make_build_work(rows)
    layout.counters[AT_PIECES] = -1
    limits = limit, root_limit
    arrays = programs, table, sizes, order, frames.origins, *limits, layout, out, work, build
    del frames
    while not lay_out(*arrays, SLICE):
        preparation.tell(_share_of(layout, rows))
    root = layout.list_of[0]
    first, end = int(layout.list_first[root]), int(layout.list_end[root])
    outermost = outermost_boxes(programs, table, layout, out, work, first, end)
    finite = np.isfinite(outermost).all(axis=1)
    hulls = _hull(outermost), _hull(outermost if finite.all() else outermost[finite])
    if layout.list_far[root]:
        middle = layout.list_middle[3 * root : 3 * root + 3]
        hulls = hulls[0] + middle, hulls[1] + middle
        move_axiom(programs, table, layout, out, work, build)
    finish_layout(layout)
    # Copies are made where nothing but the layout is left.
    expansion.drop_items()
    del arrays, table, sizes, work, build, outermost
    return Packed(_collect(layout, out), *hulls, whole, len(clusters), shrinks)


def _share_of(layout: Layout, rows: int) -> float:
    """Return how much of a layout is done, about: flattening is half of the work."""
    flattened = int(layout.counters[N_ROWS]) if layout.counters[AT_RUNS] == 0 else 0
    flattened = max(flattened, int(layout.counters[AT_ROW]))
    built = _PER_BLOCK * int(layout.counters[N_BLOCKS])
    return 0.5 * min(1.0, flattened / rows) + 0.5 * min(1.0, built / rows)


def _may_shrink(expansion: Expansion, table: Table, order: NDArray[np.int32]) -> bool:
    n, items = expansion.n_states, expansion.n_items
    inner = np.where(table.kind[:items] == STATE, table.target[:items], np.int32(-1))
    places = table.first, table.last, inner, table.matrix, table.matrices
    return bool(find_shrunk(order, *places, np.zeros(n), np.zeros(n)))


def _make_layout(
    expansion: Expansion, sizes: Sizes, clusters: NDArray[np.intp], rows: int, lists: int
) -> Layout:
    table, whole = expansion.table, np.int32
    leaves = int(np.count_nonzero(table.kind[: expansion.n_items] == LEAF))
    numbers = int(sizes.numbers[clusters].sum()) + 1
    rows = max(1, rows)
    # Pages that nobody writes to take no memory.
    return Layout(
        matrices=np.empty(12 * rows),
        targets=np.empty(rows, whole),
        codes=np.empty(rows, whole),
        items=np.empty(rows, whole),
        boxes=np.empty(6 * rows),
        list_first=np.empty(lists, whole),
        list_end=np.empty(lists, whole),
        list_block=np.empty(lists, whole),
        list_item=np.empty(lists, whole),
        list_item_end=np.empty(lists, whole),
        list_far=np.zeros(lists, whole),
        list_middle=np.zeros(3 * lists),
        list_of=np.full(expansion.n_states, -1, whole),
        record_of=np.full(expansion.n_items, -1, whole),
        record_slots=np.full(1 << (2 * leaves + 2).bit_length(), -1, whole),
        record_item=np.empty(leaves + 1, whole),
        leaves=np.zeros(4 * (leaves + 1), whole),
        args=np.empty(int(table.counters[N_NUMBERS]) + 3 * leaves + 1),
        attributes=np.empty(N_ATTRIBUTES * (leaves + 1)),
        smalls=np.empty(numbers, whole),
        tables=np.empty(rows + 1, np.uint64),
        operations=np.empty(numbers, whole),
        counters=np.zeros(COUNTERS, np.int64),
    )


def make_layout_work(depth: int, most: int, table: Table) -> LayoutWork:
    """Return working space for lists of so many references that are opened."""
    return LayoutWork(
        frames=np.zeros(2 * depth, np.int32),
        frame_matrices=np.zeros(12 * depth),
        bound_frames=np.zeros(3 * depth, np.int32),
        bound_matrices=np.zeros(12 * depth),
        small_frames=np.zeros(5 * depth, np.int32),
        small_matrices=np.zeros(12 * depth),
        truths=np.zeros(64, np.uint64),
        accumulated=np.zeros(12 * depth),
        heap=np.zeros(5 * _HEAP),
        heap_codes=np.zeros(_HEAP, np.int32),
        opened_rows=np.zeros(2 * most, np.int32),
        opened_next=np.zeros(2 * most, np.int32),
        opened_matrices=np.zeros(24 * most),
        opened_areas=np.zeros(2 * most),
        bits=table.numbers.view(np.uint64),
        box=np.zeros(6),
        moved=np.zeros(6),
        defaults=np.array(ATTRIBUTE_DEFAULTS),
    )


def _collect(layout: Layout, out: Hierarchies) -> Blocks:
    """Return what was laid out, cut to its size."""

    def used(array: NDArray[Any], counter: int, each: int = 1) -> NDArray[Any]:
        part = array[: each * max(1, int(layout.counters[counter]))]
        return part if 10 * len(part) > 9 * len(array) else part.copy()

    rows, records = int(layout.counters[N_ROWS]), int(layout.counters[N_RECORDS])
    boxes = layout.boxes[: 6 * rows].reshape(-1, 6)
    # Recursion ends at instances only.
    kinds = layout.codes[:rows] & 7
    nested = bool(((kinds == INSTANCE) | (kinds == SUSPENDED)).any())
    root = layout.list_of[0]
    own = boxes[layout.list_first[root] : layout.list_end[root]]
    attributes = layout.attributes[: N_ATTRIBUTES * records]
    return Blocks(
        boxes=used(out.boxes, N_BLOCKS, 6 * WIDTH),
        refs=used(out.refs, N_BLOCKS, WIDTH),
        inverses=used(layout.matrices, N_ROWS, 12),
        targets=used(layout.targets, N_ROWS),
        leaves=used(layout.leaves, N_RECORDS, 4),
        args=used(layout.args, N_ARGS),
        attributes=np.concatenate([attributes, np.array(ATTRIBUTE_DEFAULTS)]),
        operations=used(layout.operations, N_OPERATIONS),
        smalls=used(layout.smalls, N_SMALLS),
        tables=used(layout.tables, N_TABLES),
        ref_boxes=as_single(boxes if nested else boxes[:0]).ravel(),
        root=int(layout.list_block[root]),
        box=_hull(own) if len(own) else np.zeros((2, 3)),
    )


def _hull(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the box (2, 3) about boxes (N, 6); lower above upper about none."""
    lower = boxes[:, :3].min(axis=0, initial=np.inf)
    return np.array([lower, boxes[:, 3:].max(axis=0, initial=-np.inf)])
