"""Rays against blocks of four boxes in double precision: the slab method."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from pcsg.jit import Intrinsic, njit
from pcsg.vec import Ray

WIDTH = 4
"""Boxes in a block."""

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_FAST = ("contract",)
_U0, _U4, _U8, _U12, _U16, _U20, _U24 = (np.uint64(k) for k in (0, 4, 8, 12, 16, 20, 24))
_TINY = 1e-200


@njit(inline=True)
def _nonzero(d: float) -> float:
    """Keep a direction's component away from zero, so that planes are never NaN."""
    return d if abs(d) > _TINY else math.copysign(_TINY, d)


def _meet_boxes(
    typing: Any,
    boxes: Any,
    at: Any,
    near_x: Any,
    near_y: Any,
    near_z: Any,
    far_x: Any,
    far_y: Any,
    far_z: Any,
    ix: Any,
    iy: Any,
    iz: Any,
    sx: Any,
    sy: Any,
    sz: Any,
    low: Any,
    high: Any,
    entries: Any,
) -> Any:
    """Test a ray against the four boxes that begin at ``boxes[at]``.

    Parameters
    ----------
    boxes, at
        float64 array; lower x of four boxes, lower y, z, upper x, y, z.
    near_x, ..., far_z
        Offsets of the planes that the ray meets first and last, by the signs of its direction.
    ix, iy, iz, sx, sy, sz
        Inverse direction, and origin times inverse direction.
    low, high
        The part of the ray that counts.
    entries
        float64 array (4,): receives where the ray enters each box.

    Returns
    -------
    uint64
        Bit k is set where box k is met.
    """
    from numba.core import types

    real, whole = types.float64, types.uint64
    signature = whole(boxes, *[whole] * 7, *[real] * 8, entries)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        out = context.make_array(sig.args[16])(context, builder, args[16]).data

        def splat(x: Any) -> Any:
            zero = ir.Constant(ir.IntType(32), 0)
            v = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), x, zero)
            mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
            return builder.shuffle_vector(v, ir.Constant(_VECTOR, ir.Undefined), mask)

        def load(offset: Any) -> Any:
            p = builder.gep(data, [builder.add(args[1], offset)], inbounds=True)
            v = builder.load(builder.bitcast(p, _VECTOR.as_pointer()))
            v.align = 8
            return v

        def plane(offset: Any, i: Any, s: Any) -> Any:
            product = builder.fmul(load(offset), splat(i), flags=_FAST)
            return builder.fsub(product, splat(s), flags=_FAST)

        def largest(a: Any, b: Any) -> Any:
            return builder.select(builder.fcmp_ordered(">", a, b), a, b)

        def smallest(a: Any, b: Any) -> Any:
            return builder.select(builder.fcmp_ordered("<", a, b), a, b)

        i, s = args[8:11], args[11:14]
        near = largest(plane(args[2], i[0], s[0]), plane(args[3], i[1], s[1]))
        near = largest(near, largest(plane(args[4], i[2], s[2]), splat(args[14])))
        far = smallest(plane(args[5], i[0], s[0]), plane(args[6], i[1], s[1]))
        far = smallest(far, smallest(plane(args[7], i[2], s[2]), splat(args[15])))
        # Rounding moves planes by a few ulp of t, which is more than a small box far away.
        size = largest(far, builder.fsub(ir.Constant(_VECTOR, [0.0] * WIDTH), far))
        slack = builder.fmul(size, ir.Constant(_VECTOR, [1e-14] * WIDTH))
        met = builder.fcmp_ordered("<=", near, builder.fadd(far, slack))
        store = builder.store(near, builder.bitcast(out, _VECTOR.as_pointer()))
        store.align = 8
        return builder.zext(builder.bitcast(met, ir.IntType(WIDTH)), ir.IntType(64))

    return signature, generate


meet_boxes: Any = Intrinsic(_meet_boxes)


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
