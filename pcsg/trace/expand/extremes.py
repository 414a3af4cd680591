"""How far a scene reaches, exactly: boxes of its outermost instances are made tight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.geometry.bvh import Hierarchies
from pcsg.graph.hulls import TOLERANCE
from pcsg.jit import njit
from pcsg.trace.expand.boxes import find_support
from pcsg.trace.expand.layout import Layout, LayoutWork
from pcsg.trace.expand.programs import Programs
from pcsg.trace.expand.table import Table
from pcsg.trace.groups import INSTANCE
from pcsg.vec import Vec3

_MOST = 200
"""Instances that are looked into for one side of a box."""


@njit(entry=True)
def find_reach(
    programs: Programs,
    table: Table,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    row: int,
    axis: int,
    sign: float,
    tolerance: float,
) -> float:
    """Return how far an instance reaches along an axis, forwards or backwards (sign -1)."""
    at = 12 * row + 4 * axis
    m = layout.matrices
    d = Vec3(sign * m[at], sign * m[at + 1], sign * m[at + 2])
    number = layout.targets[row]
    inner: float = find_support(programs, table, layout, out, work, number, d, tolerance)
    return sign * float(m[at + 3]) + inner


def outermost_boxes(
    programs: Programs,
    table: Table,
    layout: Layout,
    out: Hierarchies,
    work: LayoutWork,
    first: int,
    end: int,
) -> NDArray[np.float64]:
    """Return the boxes (N, 6) of a list's references, those on its hull without slack.

    Nobody writes to them.

    Parameters
    ----------
    first, end
        The references, before `finish_layout`.
    """
    boxes = layout.boxes[6 * first : 6 * end].reshape(-1, 6)
    bounded = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    instances = layout.codes[first:end] & 7 == INSTANCE
    if not instances[bounded].any():
        return boxes
    boxes = boxes.copy()
    for side in range(6):
        axis, sign = side % 3, -1.0 if side < 3 else 1.0
        reach = sign * boxes[bounded, side]
        done = ~instances[bounded]
        for _ in range(_MOST):
            k = int(reach.argmax())
            if done[k]:
                break
            row = first + int(bounded[k])
            found = find_reach(programs, table, layout, out, work, row, axis, sign, TOLERANCE)
            reach[k] = min(reach[k], found + TOLERANCE * abs(found))
            done[k] = True
        boxes[bounded, side] = sign * reach
    return boxes
