"""Rays against blocks of four boxes: the slab method."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.simd import meet_boxes
from pcsg.vec import Ray

_U0, _U4, _U8, _U12, _U16, _U20, _U24 = (np.uint64(k) for k in (0, 4, 8, 12, 16, 20, 24))
_TINY = 1e-200


@njit(inline=True)
def _nonzero(d: float) -> float:
    """Keep a direction's component away from zero, so that planes are never NaN."""
    return d if abs(d) > _TINY else math.copysign(_TINY, d)


class Slabs(NamedTuple):
    """A ray prepared for boxes.

    Attributes
    ----------
    ix, iy, iz, sx, sy, sz
        Inverse direction, and origin times inverse direction.
    nx, ny, nz
        0 or 12 for each axis: whether the ray meets the lower or the upper plane first.
    """

    ix: float
    iy: float
    iz: float
    sx: float
    sy: float
    sz: float
    nx: np.uint64
    ny: np.uint64
    nz: np.uint64


@njit(inline=True)
def make_slabs(ray: Ray) -> Slabs:
    """Prepare a ray."""
    ix, iy, iz = 1.0 / _nonzero(ray.dx), 1.0 / _nonzero(ray.dy), 1.0 / _nonzero(ray.dz)
    return Slabs(
        ix,
        iy,
        iz,
        ray.ox * ix,
        ray.oy * iy,
        ray.oz * iz,
        _U12 if ix < 0.0 else _U0,
        _U12 if iy < 0.0 else _U0,
        _U12 if iz < 0.0 else _U0,
    )


@njit(inline=True)
def meet_block(
    boxes: NDArray[np.float64],
    block: int,
    slabs: Slabs,
    low: float,
    high: float,
    entries: NDArray[np.float64],
) -> np.uint64:
    """Return which boxes of a block a ray meets in [low, high], as bits, and where it enters."""
    return meet_block_at(boxes, np.uint64(block) * _U24, slabs, low, high, entries)


@njit(inline=True)
def meet_block_at(
    boxes: NDArray[np.float64],
    at: np.uint64,
    slabs: Slabs,
    low: float,
    high: float,
    entries: NDArray[np.float64],
) -> np.uint64:
    """Do as `meet_block` for the block that begins at ``boxes[at]``."""
    met: np.uint64 = meet_boxes(
        boxes,
        at,
        slabs.nx,
        slabs.ny + _U4,
        slabs.nz + _U8,
        _U12 - slabs.nx,
        _U16 - slabs.ny,
        _U20 - slabs.nz,
        slabs.ix,
        slabs.iy,
        slabs.iz,
        slabs.sx,
        slabs.sy,
        slabs.sz,
        low,
        high,
        entries,
    )
    return met
