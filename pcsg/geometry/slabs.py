"""Rays against blocks of boxes in single precision: the slab method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.indices import place
from pcsg.jit import njit
from pcsg.simd import WIDTH, meet_boxes, prepare_ray
from pcsg.vec import Ray

_ONE, _TWO = np.uint64(1), np.uint64(2)
_W, _W2, _W3, _W4, _W5, _W6 = (np.uint64(k * WIDTH) for k in range(1, 7))


class Slabs(NamedTuple):
    """A ray prepared for boxes, in single precision; the rest is in an array, see `make_slabs`.

    Attributes
    ----------
    about : float64
        The t from which its parameter is counted.
    speed, slowness : float64
        Lengths of the frame for each of t, and the inverse.
    nx, ny, nz
        0 or 3 WIDTH for each axis: whether the ray meets the lower or the upper plane first.
    """

    about: float
    speed: float
    slowness: float
    nx: np.uint64
    ny: np.uint64
    nz: np.uint64


@njit(inline=True)
def make_slabs(ray: Ray, about: float, out: NDArray[np.float32]) -> Slabs:
    """Prepare a ray; `about` is where it is near the boxes."""
    down, speed, slowness = prepare_ray(ray.ox, ray.oy, ray.oz, ray.dx, ray.dy, ray.dz, about, out)
    return Slabs(
        about,
        speed,
        slowness,
        (down & _ONE) * _W3,
        ((down >> _ONE) & _ONE) * _W3,
        ((down >> _TWO) & _ONE) * _W3,
    )


@njit(inline=True)
def meet_block(
    boxes: NDArray[np.float32],
    block: int,
    slabs: Slabs,
    low: float,
    high: float,
    prepared: NDArray[np.float32],
    entries: NDArray[np.float32],
) -> np.uint64:
    """Return which boxes of a block a ray meets in [low, high], as bits.

    `entries` receives where it enters them; `prepared` is what `make_slabs` wrote.
    """
    return meet_block_at(boxes, place(block) * _W6, slabs, low, high, prepared, entries)


@njit(inline=True)
def meet_block_at(
    boxes: NDArray[np.float32],
    at: np.uint64,
    slabs: Slabs,
    low: float,
    high: float,
    prepared: NDArray[np.float32],
    entries: NDArray[np.float32],
) -> np.uint64:
    """Do as `meet_block` for the block that begins at ``boxes[at]``."""
    met: np.uint64 = meet_boxes(
        boxes,
        at,
        slabs.nx,
        slabs.ny + _W,
        slabs.nz + _W2,
        _W3 - slabs.nx,
        _W4 - slabs.ny,
        _W5 - slabs.nz,
        prepared,
        np.float32((low - slabs.about) * slabs.speed),
        np.float32((high - slabs.about) * slabs.speed),
        entries,
    )
    return met
