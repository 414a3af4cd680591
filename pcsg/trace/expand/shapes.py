"""Boxes of single leaves, and what boxes are joined by."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.trace.bounding import SUPPORT, bound_by_support, bound_solid
from pcsg.trace.expand.programs import L_SHAPE, L_SHAPE_AT, L_SOLID, LEAF_FIELDS, Programs
from pcsg.trace.expand.table import Table
from pcsg.vec import Affine


@njit
def bound_shape(
    programs: Programs,
    table: Table,
    i: int,
    m: Affine,
    box: NDArray[np.float64],
) -> None:
    """Write the box of a leaf."""
    leaf = LEAF_FIELDS * table.target[i]
    shape, at = programs.leaves[leaf + L_SHAPE], programs.leaves[leaf + L_SHAPE_AT]
    if shape == SUPPORT:
        at = table.numbers_at[i]
        bound_by_support(programs.leaves[leaf + L_SOLID], m, table.numbers, at, box)
    else:
        bound_solid(shape, m, programs.shapes, at, box)


@njit
def start_box(box: NDArray[np.float64], at: int) -> None:
    """Write the box of nothing."""
    for k in range(3):
        box[at + k], box[at + 3 + k] = math.inf, -math.inf


@njit
def join_box(box: NDArray[np.float64], at: int, other: NDArray[np.float64], there: int) -> None:
    """Grow a box to contain another one."""
    for k in range(3):
        box[at + k] = min(box[at + k], other[there + k])
        box[at + 3 + k] = max(box[at + 3 + k], other[there + 3 + k])
