"""Four boxes against one ray, in vector registers, and working space on the machine's stack.

The one place where kernels are not plain Python: a loop over four boxes costs 1.5 to 2 times as
much, and kernels cannot allocate arrays.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from pcsg.jit import Intrinsic

WIDTH = 4
"""Boxes in a block."""

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_FAST = ("contract",)


def _count_trailing_zeros(typing: Any, x: Any) -> Any:
    """Return the number of the lowest set bit of a uint64 that is not zero."""
    from numba.core import types

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


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


LOCAL = 256
"""Numbers in an array on the machine's stack."""


def _local_array(typing: Any, kind: Any) -> Any:
    """Return a generator of code for an array that lives as long as the call that asks for it."""
    from numba.core import cgutils, types

    array = types.Array(kind, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        item = context.get_data_type(kind)
        data = cgutils.alloca_once(builder, item, size=LOCAL)
        made = context.make_array(array)(context, builder)
        size = context.get_constant(types.intp, LOCAL)
        width = context.get_constant(types.intp, context.get_abi_sizeof(item))
        context.populate_array(
            made, data=data, shape=(size,), strides=(width,), itemsize=width, meminfo=None
        )
        return made._getvalue()

    return array(), generate


def _local_integers(typing: Any) -> Any:
    """Return an int64 array of `LOCAL` numbers, whose content is undefined."""
    from numba.core import types

    return _local_array(typing, types.int64)


def _local_doubles(typing: Any) -> Any:
    """Return a float64 array of `LOCAL` numbers, whose content is undefined."""
    from numba.core import types

    return _local_array(typing, types.float64)


local_integers: Any = Intrinsic(_local_integers)
local_doubles: Any = Intrinsic(_local_doubles)
count_trailing_zeros: Any = Intrinsic(_count_trailing_zeros)
meet_boxes: Any = Intrinsic(_meet_boxes)
