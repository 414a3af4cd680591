"""How far apart ends along a ray may be and still coincide.

The definition is ``docs/solids.md``, section "Combining two lists". It follows the ray alone and
where the scene is, so that all engines compare alike, in every frame: a scene and its rays may be
of any size, and directions of any length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.vec import Ray, Vec3

COARSE, FINE = 1e-10, 1e-14
"""Of what a tolerance is that part: for rays that begin about the scene; and for those from so far
away that the first would be too much for what they see, and the second is what rounding needs."""

FAR = 1000.0
"""Rays come from far away that begin farther from the scene than this many times its size."""


class Extent(NamedTuple):
    """Where a scene is.

    Attributes
    ----------
    middle
        Of the hull of its boxes.
    anchor
        The point of the hull that is nearest to the world's origin.
    reach
        Rays whose origin is farther from the anchor come from far away; infinite where nothing is
        bounded.
    """

    middle: Vec3
    anchor: Vec3
    reach: float


def extent_of(box: NDArray[np.float64]) -> Extent:
    """Return where a box is; it may be infinite, or empty.

    Parameters
    ----------
    box : float64 (2, 3)
        Its corners.
    """
    finite = np.where(np.isfinite(box), box, 0.0)
    empty = bool((box[0] > box[1]).any())
    anchor = np.zeros(3) if empty else np.clip(0.0, box[0], box[1])
    size = float(np.abs(finite - np.where(np.isfinite(box), anchor, 0.0)).max())
    middle = Vec3(*(float(x) for x in finite.mean(axis=0)))
    return Extent(middle, Vec3(*map(float, anchor)), FAR * size if size > 0.0 else math.inf)


TOUCH = 4e-15
"""Rounding may make an interval of a touch that is no longer than this part of t."""


class Precision(NamedTuple):
    """What tolerances along one ray are made of.

    Attributes
    ----------
    least
        The least there is.
    slope
        What it is per t.
    """

    least: float
    slope: float


@njit(inline=True)
def is_far(ray: Ray, extent: Extent) -> bool:
    """Return whether a ray comes from far away."""
    x, y, z = ray.ox - extent.anchor.x, ray.oy - extent.anchor.y, ray.oz - extent.anchor.z
    return max(abs(x), abs(y), abs(z)) > extent.reach


@njit(inline=True)
def precision_of(ray: Ray, extent: Extent) -> Precision:
    """Return what tolerances along a ray in the scene's frame are made of."""
    x, y, z = ray.ox - extent.anchor.x, ray.oy - extent.anchor.y, ray.oz - extent.anchor.z
    away = max(abs(x), abs(y), abs(z))
    speed = max(abs(ray.dx), abs(ray.dy), abs(ray.dz))
    if away > extent.reach:
        return Precision(max(COARSE * extent.reach, FINE * away) / speed, FINE)
    return Precision(COARSE * away / speed, COARSE)


@njit
def tolerance(t: float, precision: Precision) -> float:
    """Return how far apart ends may be at t and still coincide."""
    e = max(precision.least, precision.slope * abs(t))
    return e if e < math.inf else 0.0


@njit
def is_touch(lo: float, hi: float) -> bool:
    """Return whether a ray only touches what it enters at lo and leaves at hi."""
    return hi <= lo + TOUCH * abs(lo)


@njit(inline=True)
def load_precision(numbers: NDArray[np.float64], at: int) -> Precision:
    """Return the precision that is kept in an array."""
    return Precision(numbers[at], numbers[at + 1])


@njit(inline=True)
def store_precision(numbers: NDArray[np.float64], at: int, precision: Precision) -> None:
    """Keep the precision of a ray in an array; calls have arguments enough."""
    numbers[at], numbers[at + 1] = precision.least, precision.slope
