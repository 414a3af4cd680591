"""Sixteen boxes against one ray, in vector registers, and working space on the machine's stack.

The one place where kernels are not plain Python: a loop over the boxes costs 1.5 to 2 times as
much, and kernels cannot allocate arrays. The vectors are as wide as a block; LLVM cuts them to the
registers that there are.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from pcsg.jit import Intrinsic

WIDTH = 16
"""Boxes in a block."""

SINGLE, DOUBLE = 5e-7, 1e-14
"""Errors, generously, of what is computed with single and with double precision."""

STEEPEST, _MOST = 3e17, 1e38
"""The largest inverse of a scaled direction's component, and of any number in single precision.
Boxes are padded by a relative 1e-9: a ray that is as good as parallel to a side does not reach it
within 300 million times their size."""

_BOXES = ir.VectorType(ir.FloatType(), WIDTH)
_AXES = ir.VectorType(ir.DoubleType(), 4)
_FAST = ("contract",)


def _whole(k: int) -> Any:
    return ir.Constant(ir.IntType(32), k)


def _load(builder: Any, at: Any, vector: Any) -> Any:
    values = builder.load(builder.bitcast(at, vector.as_pointer()))
    values.align = 4
    return values


def _store(builder: Any, values: Any, at: Any) -> None:
    builder.store(values, builder.bitcast(at, values.type.as_pointer())).align = 4


def _splat(builder: Any, x: Any, vector: Any) -> Any:
    nothing = ir.Constant(vector, ir.Undefined)
    v = builder.insert_element(nothing, x, _whole(0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(v, nothing, mask)


def _largest(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _smallest(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


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
    ray: Any,
    low: Any,
    high: Any,
    entries: Any,
) -> Any:
    """Test a ray against the boxes of a block that begin at ``boxes[at]``.

    Parameters
    ----------
    boxes, at
        float32 array; lower x of all boxes, lower y, z, upper x, y, z.
    near_x, ..., far_z
        Offsets of the planes that the ray meets first and last, by the signs of its direction.
    ray
        float32 array (12,): what `prepare_ray` has written.
    low, high
        The part of the ray that counts.
    entries
        float32 array (WIDTH,): receives where the ray enters each box; before `low` where its
        beginning is inside.

    Returns
    -------
    uint64
        Bit k is set where box k is met.
    """
    from numba.core import types

    real, whole = types.float32, types.uint64
    signature = whole(boxes, *[whole] * 7, ray, real, real, entries)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data, slabs, out = (
            context.make_array(sig.args[k])(context, builder, args[k]).data for k in (0, 8, 11)
        )

        def splat(x: Any) -> Any:
            return _splat(builder, x, _BOXES)

        def plane(offset: Any, axis: int, shift: int) -> Any:
            at = builder.gep(data, [builder.add(args[1], offset)], inbounds=True)
            planes = _load(builder, at, _BOXES)
            i, s = (
                builder.load(builder.gep(slabs, [_whole(k + axis)], inbounds=True))
                for k in (0, shift)
            )
            product = builder.fmul(planes, splat(i), flags=_FAST)
            return builder.fsub(product, splat(s), flags=_FAST)

        near = _largest(builder, plane(args[2], 0, 4), plane(args[3], 1, 4))
        near = _largest(builder, near, plane(args[4], 2, 4))
        far = _smallest(builder, plane(args[5], 0, 8), plane(args[6], 1, 8))
        far = _smallest(builder, far, _smallest(builder, plane(args[7], 2, 8), splat(args[10])))
        met = builder.fcmp_ordered("<=", _largest(builder, near, splat(args[9])), far)
        _store(builder, near, out)
        return builder.zext(builder.bitcast(met, ir.IntType(WIDTH)), ir.IntType(64))

    return signature, generate


def _overlap_boxes(
    typing: Any,
    boxes: Any,
    at: Any,
    lower_x: Any,
    lower_y: Any,
    lower_z: Any,
    upper_x: Any,
    upper_y: Any,
    upper_z: Any,
) -> Any:
    """Test a small box against the boxes of a block that begin at ``boxes[at]``.

    Returns
    -------
    uint64
        Bit k is set where box k overlaps it.
    """
    from numba.core import types

    real, whole = types.float32, types.uint64
    signature = whole(boxes, whole, *[real] * 6)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        overlap = None
        for k in range(6):
            offset = builder.add(args[1], ir.Constant(ir.IntType(64), WIDTH * k))
            planes = _load(builder, builder.gep(data, [offset], inbounds=True), _BOXES)
            # Lower sides against the upper ones of the small box, and upper against lower.
            other = _splat(builder, args[2 + (k + 3) % 6], _BOXES)
            inside = builder.fcmp_ordered("<=" if k < 3 else ">=", planes, other)
            overlap = inside if overlap is None else builder.and_(overlap, inside)
        return builder.zext(builder.bitcast(overlap, ir.IntType(WIDTH)), ir.IntType(64))

    return signature, generate


def _prepare_ray(
    typing: Any,
    ox: Any,
    oy: Any,
    oz: Any,
    dx: Any,
    dy: Any,
    dz: Any,
    about: Any,
    ray: Any,
) -> Any:
    """Prepare a ray for boxes in single precision.

    Its parameter is counted from `about`, near which it meets what matters, and is scaled to the
    lengths of the frame. So single precision loses nothing, however deep the frame and far the
    ray's origin.

    Parameters
    ----------
    ox, oy, oz, dx, dy, dz
        The ray.
    ray
        float32 array (12,): receives inverse direction, and origin times inverse direction, a bit
        more for planes that the ray meets first, a bit less for those that it meets last, so that
        rounding loses no box; four numbers each.

    Returns
    -------
    negative, speed, slowness
        Bits of the axes along which the ray goes down; lengths of the frame for each of t, and its
        inverse: powers of two.
    """
    from numba.core import types

    real, whole = types.float64, types.uint64
    three: Any = types.Tuple  # numba leaves it untyped
    signature = three((whole, real, real))(*[real] * 7, ray)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        out = context.make_array(sig.args[7])(context, builder, args[7]).data
        word = ir.IntType(64)

        def vector(*numbers: Any) -> Any:
            v = ir.Constant(_AXES, ir.Undefined)
            for k, x in enumerate(numbers):
                v = builder.insert_element(v, x, _whole(k))
            return v

        def constant(x: float) -> Any:
            return ir.Constant(_AXES, [x] * 4)

        def magnitude(x: Any) -> Any:
            vectors = isinstance(x.type, ir.VectorType)
            bits = ir.VectorType(word, 4) if vectors else word
            digits = (1 << 63) - 1
            mask = ir.Constant(bits, [digits] * 4 if vectors else digits)
            return builder.bitcast(builder.and_(builder.bitcast(x, bits), mask), x.type)

        def clamp(x: Any, most: float) -> Any:
            x = _smallest(builder, x, constant(most))
            return _largest(builder, x, constant(-most))

        def product(a: Any, b: Any) -> Any:
            return builder.fmul(a, b, flags=_FAST)

        def total(a: Any, b: Any) -> Any:
            return builder.fadd(a, b, flags=_FAST)

        # The exponent of the largest component, without its digits.
        x, y, z = (magnitude(d) for d in args[3:6])
        largest = builder.bitcast(_largest(builder, _largest(builder, x, y), z), word)
        exponent = builder.and_(largest, ir.Constant(word, 0x7FF << 52))
        for sign, limit in (("<", 64 << 52), (">", 1982 << 52)):
            limited = ir.Constant(word, limit)
            beyond = builder.icmp_unsigned(sign, exponent, limited)
            exponent = builder.select(beyond, limited, exponent)
        speed = builder.bitcast(exponent, ir.DoubleType())
        inverse = builder.sub(ir.Constant(word, 2046 << 52), exponent)
        slowness = builder.bitcast(inverse, ir.DoubleType())
        origin = vector(*args[:3], args[2])
        direction = vector(*args[3:6], args[5])
        rates = vector(*[speed] * 4)
        inverse = clamp(product(builder.fdiv(constant(1.0), direction), rates), STEEPEST)
        moved = total(origin, product(vector(*[args[6]] * 4), direction))
        shift = clamp(product(moved, inverse), _MOST)
        room = product(magnitude(product(origin, inverse)), constant(DOUBLE))
        room = total(product(magnitude(shift), constant(SINGLE)), room)
        room = _smallest(builder, room, constant(_MOST))
        first, last = builder.fadd(shift, room), builder.fsub(shift, room)
        for k, values in enumerate((inverse, first, last)):
            single = builder.fptrunc(values, ir.VectorType(ir.FloatType(), 4))
            _store(builder, single, builder.gep(out, [_whole(4 * k)], inbounds=True))
        down = builder.bitcast(builder.fcmp_ordered("<", inverse, constant(0.0)), ir.IntType(4))
        return context.make_tuple(
            builder, sig.return_type, [builder.zext(down, word), speed, slowness]
        )

    return signature, generate


def _stay_apart(typing: Any) -> Any:
    """Keep the function that calls this out of its callers' code, where it would crowd a loop."""
    from numba.core import types

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), generate


LOCAL = 768
"""Numbers in an array on the machine's stack."""


def _local_array(typing: Any, kind: Any) -> Any:
    """Return a generator of code for an array that lives as long as the call that asks for it."""
    from numba.core import cgutils, types

    array = types.Array(kind, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        item = context.get_data_type(kind)
        data = cgutils.alloca_once(builder, item, size=LOCAL)
        # What is written as a vector and read as numbers must not lie across cache lines.
        data.align = 64
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


def _local_singles(typing: Any) -> Any:
    """Return a float32 array of `LOCAL` numbers, whose content is undefined."""
    from numba.core import types

    return _local_array(typing, types.float32)


local_integers: Any = Intrinsic(_local_integers)
local_singles: Any = Intrinsic(_local_singles)
local_doubles: Any = Intrinsic(_local_doubles)
count_trailing_zeros: Any = Intrinsic(_count_trailing_zeros)
prepare_ray: Any = Intrinsic(_prepare_ray)
meet_boxes: Any = Intrinsic(_meet_boxes)
overlap_boxes: Any = Intrinsic(_overlap_boxes)
stay_apart: Any = Intrinsic(_stay_apart)
