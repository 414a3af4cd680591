"""Boxes of solids whose matrices are known.

A bounding shape is a run of numbers: BALL, a box of six numbers and a ball of four, which rotations
do not make grow; CORNERS, their number and the points themselves. SUPPORT: the kernel of the leaf
itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_support
from pcsg.vec import Affine, Vec3

BALL, CORNERS, SUPPORT = range(3)

PAD = 1e-9
"""Relative to the largest coordinate, for rounding."""


@njit
def _bound_corners(
    m: Affine, shapes: NDArray[np.float64], at: int, box: NDArray[np.float64]
) -> None:
    for k in range(int(shapes[at])):
        x, y, z = shapes[at + 1 + 3 * k], shapes[at + 2 + 3 * k], shapes[at + 3 + 3 * k]
        for i in range(3):
            p = m[4 * i] * x + m[4 * i + 1] * y + m[4 * i + 2] * z + m[4 * i + 3]
            box[i] = min(box[i], p)
            box[i + 3] = max(box[i + 3], p)


@njit
def bound_box(
    m: Affine,
    source: NDArray[np.float64],
    at: int,
    x: float,
    y: float,
    z: float,
    radius: float,
    box: NDArray[np.float64],
    to: int,
) -> None:
    """Write the box of what a matrix makes of ``source[at:]`` within a ball to ``box[to:]``."""
    for i in range(3):
        lower = m[4 * i + 3]
        upper = lower
        for j in range(3):
            a = m[4 * i + j]
            if a > 0.0:
                lower += a * source[at + j]
                upper += a * source[at + j + 3]
            elif a < 0.0:
                lower += a * source[at + j + 3]
                upper += a * source[at + j]
        if radius < math.inf:
            middle = m[4 * i] * x + m[4 * i + 1] * y + m[4 * i + 2] * z + m[4 * i + 3]
            reach = radius * math.sqrt(m[4 * i] ** 2 + m[4 * i + 1] ** 2 + m[4 * i + 2] ** 2)
            lower = max(lower, middle - reach)
            upper = min(upper, middle + reach)
        box[to + i] = lower
        box[to + i + 3] = upper


@njit
def pad_box(box: NDArray[np.float64]) -> None:
    """Grow a box outwards for rounding."""
    largest, bounded = 0.0, True
    for i in range(6):
        if abs(box[i]) < math.inf:
            largest = max(largest, abs(box[i]))
        else:
            bounded = False
    if largest == 0.0 and not bounded and box[0] <= box[3]:
        # Sides at zero of what has no size, such as a half-space, would have no room for rounding.
        largest = math.inf
    for i in range(3):
        box[i] -= PAD * largest
        box[i + 3] += PAD * largest


@njit
def bound_solid(
    kind: int, m: Affine, shapes: NDArray[np.float64], at: int, box: NDArray[np.float64]
) -> None:
    """Write the box of a solid in the frame that its matrix leads to, padded outwards.

    Parameters
    ----------
    kind, shapes, at
        Its bounding shape: CORNERS or BALL.
    box : float64 (6,)
        Receives lower x, y, z, upper x, y, z.
    """
    if kind == CORNERS:
        for i in range(3):
            box[i], box[i + 3] = math.inf, -math.inf
        _bound_corners(m, shapes, at, box)
    else:
        x, y, z = shapes[at + 6], shapes[at + 7], shapes[at + 8]
        bound_box(m, shapes, at, x, y, z, shapes[at + 9], box, 0)
    pad_box(box)


@njit
def bound_by_support(
    solid: int, m: Affine, args: NDArray[np.float64], at: int, box: NDArray[np.float64]
) -> None:
    """Write the box of a leaf that has a support kernel, padded outwards.

    Parameters
    ----------
    solid
        Its kind.
    args, at
        Its numbers.
    """
    for i in range(3):
        x, y, z, shift = m[4 * i], m[4 * i + 1], m[4 * i + 2], m[4 * i + 3]
        box[i] = shift - leaf_support(solid, Vec3(-x, -y, -z), args, at)
        box[i + 3] = shift + leaf_support(solid, Vec3(x, y, z), args, at)
    pad_box(box)
