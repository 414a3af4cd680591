"""Extents: boxes about solids whose arguments are known as intervals only."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

from pcsg.graph.hulls import EMPTY, EVERYTHING, INF, Bounds, join
from pcsg.graph.intervals import (
    Interval,
    Matrix,
    is_point,
    transform_intervals,
)
from pcsg.graph.nodes import Leaf
from pcsg.graph.operators import DIFFERENCE, INTERSECTION, Operator


class Extent(NamedTuple):
    """A box, and the largest distance from the origin, which rotations keep."""

    box: Bounds
    reach: float


NO_EXTENT = Extent(EMPTY, 0.0)
ANY_EXTENT = Extent(EVERYTHING, INF)


def leaf_extent(node: Leaf, args: list[Interval]) -> Extent:
    """Return the extent of a primitive; bounds are monotone in every argument."""
    ends = []
    if node.constants and not all(map(is_point, args)):
        return ANY_EXTENT
    for parameter, (lower, upper) in zip(node.parameters, args, strict=True):
        ends.append((max(lower, parameter.low), min(upper, parameter.high)))
    box = EMPTY
    for corner in product(*ends):
        if not all(map(math.isfinite, corner)):
            return ANY_EXTENT
        bounds = node.bounds_of(corner)
        box = join(box, (*bounds.lower, *bounds.upper))
    return Extent(box, _reach(box))


def _reach(box: Bounds) -> float:
    """Return the largest distance from the origin in a box."""
    if is_empty_extent(box):
        return 0.0
    return math.hypot(*(max(-box[i], box[i + 3]) for i in range(3))) * (1.0 + 1e-15)


def is_empty_extent(box: Bounds) -> bool:
    """Return whether a box contains nothing."""
    return any(box[i] > box[i + 3] for i in range(3))


def combine_extents(operator: Operator, operands: list[Extent], bounded_only: bool) -> Extent:
    """Return the extent of operands under an operator; of unbounded ones none, where told."""
    if operator is DIFFERENCE:
        return operands[0]
    if operator is INTERSECTION:
        box = operands[0].box
        for e in operands[1:]:
            lower = tuple(map(max, box[:3], e.box[:3]))
            upper = tuple(map(min, box[3:], e.box[3:]))
            box = (*lower, *upper)  # type: ignore[assignment]  # three and three are six
        if is_empty_extent(box):
            return NO_EXTENT
        return Extent(box, min(_reach(box), *(e.reach for e in operands)))
    if bounded_only:
        operands = [e for e in operands if math.isfinite(e.reach)] or operands
    total = NO_EXTENT
    for e in operands:
        total = join_extents(total, e)
    return total


def join_extents(a: Extent, b: Extent) -> Extent:
    """Return the least extent that contains two."""
    return Extent(join(a.box, b.box), max(a.reach, b.reach))


def transform_extent(m: Matrix, e: Extent, keeps_distance: bool) -> Extent:
    """Return the extent of what a matrix makes of an extent."""
    if is_empty_extent(e.box):
        return NO_EXTENT
    box = e.box
    intervals = transform_intervals(m, [(box[i], box[i + 3]) for i in range(3)])
    reach = e.reach
    if not keeps_distance:
        shift = math.hypot(*(max(-m[i][0], m[i][1]) for i in (3, 7, 11)))
        reach = (_stretch(m) * reach if reach else 0.0) + shift
    reach *= 1.0 + 1e-15
    lower = [max(i[0], -reach) for i in intervals]
    upper = [min(i[1], reach) for i in intervals]
    moved = (lower[0], lower[1], lower[2], upper[0], upper[1], upper[2])
    return Extent(moved, min(reach, _reach(moved)))


def _stretch(m: Matrix) -> float:
    """Return an upper bound of how much a matrix lengthens vectors: of its row sums and columns."""
    size = [[max(-m[i + j][0], m[i + j][1]) for j in range(3)] for i in (0, 4, 8)]
    rows = max(sum(row) for row in size)
    columns = max(sum(row[j] for row in size) for j in range(3))
    return math.sqrt(rows * columns)


def inflate_extent(e: Extent, by: float) -> Extent:
    """Return an extent grown by a fraction of its reach."""
    if is_empty_extent(e.box) or not math.isfinite(e.reach):
        return e
    d = by * e.reach
    b = e.box
    grown = (b[0] - d, b[1] - d, b[2] - d, b[3] + d, b[4] + d, b[5] + d)
    return Extent(grown, e.reach + d)


def lies_within(a: Extent, b: Extent) -> bool:
    """Return whether one extent contains no more than another."""
    if is_empty_extent(a.box):
        return True
    return (
        all(a.box[i] >= b.box[i] and a.box[i + 3] <= b.box[i + 3] for i in range(3))
        and a.reach <= b.reach
    )
