"""Opening: the largest instances of a short list are replaced by what they lead to.

Rays then change their frame less often. The old list stays for those that open it in turn.
"""

from __future__ import annotations

import numpy as np

from pcsg.geometry.bvh import Hierarchies
from pcsg.geometry.collapse import half_area
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.trace.bounding import bound_box
from pcsg.trace.expand.boxes import (
    bound_instance,
    bound_item,
    bound_leaf,
    bound_suspended,
)
from pcsg.trace.expand.clusters import Sizes
from pcsg.trace.expand.layout import N_ROWS, Layout, LayoutWork, write_row
from pcsg.trace.expand.programs import Programs
from pcsg.trace.expand.table import Table
from pcsg.trace.groups import INSTANCE, LEAF, SUSPENDED
from pcsg.vec import IDENTITY, Affine, compose, load_affine, store_affine


@njit
def open_list(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    number: int,
    most: int,
) -> tuple[int, int]:
    """Open the instances of a list while it has no more than so many references.

    Returns
    -------
    first, end
        The references that the list's hierarchy is to be built over.
    """
    first, end = wide(layout.list_first[number]), wide(layout.list_end[number])
    rows, follows, areas = work.opened_rows, work.opened_next, work.opened_areas
    count = end - first
    if count == 0 or count >= most:
        return first, end
    used = _copy_list(layout, work, first, end, IDENTITY, 0)
    follows[used - 1] = -1
    head, opened = 0, 0
    while True:
        chosen, largest, before, previous = -1, 0.0, -1, -1
        k = head
        while k >= 0:
            if areas[k] > largest:
                target = layout.targets[rows[k]]
                more = layout.list_end[target] - layout.list_first[target] - 1
                if (
                    layout.list_far[target] == 0
                    and count + more <= most
                    and used + more + 1 <= len(rows)
                ):
                    chosen, largest, before = k, areas[k], previous
                else:
                    areas[k] = 0.0
            previous = k
            k = wide(follows[k])
        if chosen < 0:
            break
        opened += 1
        target = layout.targets[rows[chosen]]
        a, b = wide(layout.list_first[target]), wide(layout.list_end[target])
        m = load_affine(work.opened_matrices, 12 * chosen)
        behind = follows[chosen]
        inner = used
        used = _copy_list(layout, work, a, b, m, used)
        follows[used - 1] = behind
        if before < 0:
            head = inner
        else:
            follows[before] = inner
        count += b - a - 1
    if opened == 0:
        return first, end
    first = layout.counters[N_ROWS]
    row = first
    k = head
    while k >= 0:
        _write_opened(programs, table, sizes, layout, out, work, k, row)
        row += 1
        k = wide(follows[k])
    layout.counters[N_ROWS] = row
    return first, row


@njit
def _copy_list(layout: Layout, work: LayoutWork, first: int, end: int, m: Affine, to: int) -> int:
    """Append the references of a list in the frame that a matrix leads to; return the new end."""
    for row in range(first, end):
        work.opened_rows[to] = row
        work.opened_next[to] = to + 1
        own = compose(m, load_affine(layout.matrices, 12 * row))
        store_affine(work.opened_matrices, 12 * to, own)
        work.opened_areas[to] = 0.0
        if layout.codes[row] & 7 == INSTANCE:
            bound_box(m, layout.boxes, 6 * row, 0.0, 0.0, 0.0, np.inf, work.moved, 0)
            work.opened_areas[to] = half_area(work.moved, 0)
        to += 1
    return to


@njit
def _write_opened(
    programs: Programs,
    table: Table,
    sizes: Sizes,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    k: int,
    row: int,
) -> None:
    """Write a reference of an opened list, with its box."""
    source = work.opened_rows[k]
    kind, target, item = layout.codes[source] & 7, layout.targets[source], layout.items[source]
    m = load_affine(work.opened_matrices, 12 * k)
    if kind == LEAF:
        bound_leaf(programs, table, item, m, work)
    elif kind == INSTANCE:
        bound_instance(programs, table, layout, out, work, target, m)
    elif kind == SUSPENDED:
        bound_suspended(sizes, target, m, work.box)
    else:
        bound_item(programs, table, sizes, layout, out, work, item, m)
    write_row(layout, row, kind, target, item, m, work.box)
