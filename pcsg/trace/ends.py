"""Where recursion ends: how large a state looks to a ray, in units of its footprint.

A state ends recursion where the diameter of its box, in the world, is less than the width of the
ray at the place nearest to the middle of the box, or, which differs by less than that, where it
enters the box. Boxes are known in the frame above the state; what the world's lengths are there is
followed along with the ray, level by level.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import place
from pcsg.jit import njit
from pcsg.vec import Affine, Ray

MAX_DEPTH = 120
"""Levels of instances and operations; deeper rays are undecided."""

NEVER = -1
"""Number in place of a coverage: recursion does not end here."""

STAND_IN = -2
"""The same: below a suspended state recursion ends in what the terminating rule shows."""

CUT = -2_000_000
"""In a path, ``CUT - k`` stands for hit k of the coverage."""

LEVEL, DRAWN, NUMBER = 14, 12, 13
"""Numbers for every level: the linear part of local_from_world, one over the squares of the lengths
of its rows, which part of [0, 1) has been drawn from, and the ray's random number there, negative
until it is needed; see `coverage`."""


_ONE, _TWO = np.uint64(1), np.uint64(2)


@njit
def begin_levels(linear: NDArray[np.float64]) -> None:
    """Write what the level of the world knows."""
    for k in range(LEVEL):
        linear[k] = 1.0 if (k % 4 == 0 or k > 8) and k < DRAWN else 0.0
    linear[NUMBER] = -1.0


@njit
def go_down(linear: NDArray[np.float64], level: int, m: Affine) -> None:
    """Write what a level knows of the world, below a matrix from the level above."""
    above, at = LEVEL * level, LEVEL * level + LEVEL
    for i in range(3):
        square = 0.0
        for j in range(3):
            x = (
                m[4 * i] * linear[above + j]
                + m[4 * i + 1] * linear[above + 3 + j]
                + m[4 * i + 2] * linear[above + 6 + j]
            )
            linear[at + 3 * i + j] = x
            square += x * x
        linear[at + 9 + i] = 1.0 / square
    linear[at + DRAWN] = 0.0
    linear[at + NUMBER] = -1.0


@njit(inline=True)
def squared_size(
    linear: NDArray[np.float64], level: int, sizes: NDArray[np.float64], index: int
) -> float:
    """Return about the square of the diameter in the world of a box at a level.

    The slab of an axis is as thick as its local thickness over the length of the axis' row,
    whatever the matrix; together they give the diagonal where the rows are at right angles.

    Parameters
    ----------
    sizes, index
        Squares of the box's sides are ``sizes[3 index:]``.
    """
    at = place(LEVEL * level + 9)
    side = place(3 * index)
    squared: float = (
        sizes[side] * linear[at]
        + sizes[side + _ONE] * linear[at + _ONE]
        + sizes[side + _TWO] * linear[at + _TWO]
    )
    return squared


@njit(inline=True)
def middle_of(box: NDArray[np.float64], ray: Ray) -> float:
    """Return where a ray passes nearest to the middle of a box."""
    x, y, z = 0.5 * (box[0] + box[3]), 0.5 * (box[1] + box[4]), 0.5 * (box[2] + box[5])
    along = (x - ray.ox) * ray.dx + (y - ray.oy) * ray.dy + (z - ray.oz) * ray.dz
    nearest: float = along / (ray.dx**2 + ray.dy**2 + ray.dz**2)
    return nearest


@njit
def area_of(box: NDArray[np.float64], ray: Ray) -> float:
    """Return how large a box looks along a ray, times the length of the ray's direction."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    area: float = abs(ray.dx) * y * z + abs(ray.dy) * z * x + abs(ray.dz) * x * y
    return area
