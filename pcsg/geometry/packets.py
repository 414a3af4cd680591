"""Several triangles against one ray, in vector registers: watertight, in double precision.

A packet is the corners of `LANES` triangles: x of the first corners, then y and z, then the second
and third ones. Where there are fewer triangles, the rest is NaN, which nothing meets.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from pcsg.jit import Intrinsic

LANES = 8
"""Triangles in a packet."""

PACKET = 9 * LANES
"""Numbers of a packet."""

UNSURE, LEAST = 1e-15, 1e-300
"""An edge function that is smaller than its terms by the first factor, or than the second number,
may have the wrong sign."""

_REALS = ir.VectorType(ir.DoubleType(), LANES)
_WORDS = ir.VectorType(ir.IntType(64), LANES)


def pack_triangles(corners: NDArray[np.float64], begins: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return packets of triangles, one behind the other.

    Parameters
    ----------
    corners : float64 (n, 3, 3)
        Three corners of every triangle.
    begins : int32 (P + 1,)
        Packet k holds the triangles from ``begins[k]`` to ``begins[k + 1]``, at most `LANES`.
    """
    packets = np.full((len(begins) - 1, 3, 3, LANES), np.nan)
    sizes = np.diff(begins)
    owner = np.repeat(np.arange(len(sizes)), sizes)
    packets[owner, :, :, np.arange(len(corners)) - begins[owner]] = corners
    return packets.ravel()


def _constant(x: float) -> Any:
    return ir.Constant(_REALS, [x] * LANES)


def _splat(builder: Any, x: Any) -> Any:
    v = builder.insert_element(ir.Constant(_REALS, ir.Undefined), x, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(v, ir.Constant(_REALS, ir.Undefined), mask)


def _bits(builder: Any, flags: Any) -> Any:
    """Return a uint64 with a bit for every lane."""
    return builder.zext(builder.bitcast(flags, ir.IntType(LANES)), ir.IntType(64))


def _magnitude(builder: Any, v: Any) -> Any:
    mask = ir.Constant(_WORDS, [(1 << 63) - 1] * LANES)
    return builder.bitcast(builder.and_(builder.bitcast(v, _WORDS), mask), _REALS)


def _corner_loader(builder: Any, data: Any, at: Any) -> Any:
    """Return what loads coordinate `axis` (times LANES) of corner k of all triangles."""

    def load(k: int, axis: Any) -> Any:
        offset = builder.add(axis, ir.Constant(ir.IntType(64), 3 * LANES * k))
        p = builder.gep(data, [builder.add(at, offset)], inbounds=True)
        v = builder.load(builder.bitcast(p, _REALS.as_pointer()))
        v.align = 8
        return v

    return load


def _cross_packet(
    typing: Any,
    numbers: Any,
    at: Any,
    x: Any,
    y: Any,
    z: Any,
    ox: Any,
    oy: Any,
    oz: Any,
    sx: Any,
    sy: Any,
    sz: Any,
    ts: Any,
) -> Any:
    """Test a ray against the packet that begins at ``numbers[at]``.

    Parameters
    ----------
    x, y, z
        The axes of the sheared ray, times LANES.
    ox, ..., sz
        Its origin along them, shear along x and y, scale along z.
    ts
        float64 array (LANES,): receives where it crosses the triangles, if it crosses any.

    Returns
    -------
    uint64
        Bit k is set where triangle k is crossed for sure, bit LANES + k where that has to be found
        out, bit 2 LANES + k where its edge functions are negative.
    """
    from numba.core import types

    real, whole = types.float64, types.uint64
    signature = whole(numbers, *[whole] * 4, *[real] * 6, ts)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        out = context.make_array(sig.args[11])(context, builder, args[11]).data
        load = _corner_loader(builder, data, args[1])
        x, y, z = args[2:5]
        ox, oy, oz, sx, sy, sz = (_splat(builder, a) for a in args[5:11])
        add, sub, mul = builder.fadd, builder.fsub, builder.fmul

        def shear(k: int) -> tuple[Any, Any, Any]:
            pz = sub(load(k, z), oz)
            px = sub(sub(load(k, x), ox), mul(sx, pz))
            py = sub(sub(load(k, y), oy), mul(sy, pz))
            return px, py, pz

        def edge(p: Any, q: Any) -> tuple[Any, Any, Any]:
            """Return an edge function, and whether its sign is sure or may be wrong."""
            first, second = mul(p[0], q[1]), mul(p[1], q[0])
            area = sub(first, second)
            terms = add(_magnitude(builder, first), _magnitude(builder, second))
            doubt = add(mul(terms, _constant(UNSURE)), _constant(LEAST))
            size = _magnitude(builder, area)
            sure = builder.fcmp_ordered(">", size, doubt)
            return area, sure, builder.fcmp_ordered("<=", size, doubt)

        a, b, c = (shear(k) for k in range(3))
        (u, su, du), (v, sv, dv), (w, sw, dw) = edge(a, b), edge(b, c), edge(c, a)
        u_bits, v_bits, w_bits = (builder.bitcast(e, _WORDS) for e in (u, v, w))
        zero = ir.Constant(_WORDS, [0] * LANES)
        differ = builder.or_(builder.xor(u_bits, v_bits), builder.xor(u_bits, w_bits))
        agree = builder.icmp_signed(">=", differ, zero)
        crossed = builder.and_(builder.and_(su, sv), builder.and_(sw, agree))
        hit = _bits(builder, crossed)
        with builder.if_then(builder.icmp_unsigned("!=", hit, ir.Constant(ir.IntType(64), 0))):
            total = add(add(v, w), u)
            sum_z = add(add(mul(v, a[2]), mul(w, b[2])), mul(u, c[2]))
            t = mul(builder.fdiv(sum_z, total), sz)
            builder.store(t, builder.bitcast(out, _REALS.as_pointer())).align = 8
        doubtful = _bits(builder, builder.or_(du, builder.or_(dv, dw)))
        negative = _bits(builder, builder.icmp_signed("<", u_bits, zero))
        word = ir.IntType(64)
        doubtful = builder.shl(doubtful, ir.Constant(word, LANES))
        negative = builder.shl(negative, ir.Constant(word, 2 * LANES))
        return builder.or_(hit, builder.or_(doubtful, negative))

    return signature, generate


def _approach_packet(
    typing: Any, numbers: Any, at: Any, px: Any, py: Any, pz: Any, near: Any
) -> Any:
    """Test a point against the packet that begins at ``numbers[at]``.

    Returns
    -------
    uint64
        Bit k is set where triangle k may be as near as that: its box is, and its plane.
    """
    from numba.core import types

    real, whole = types.float64, types.uint64
    signature = whole(numbers, whole, *[real] * 4)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        load = _corner_loader(builder, data, args[1])
        add, sub, mul = builder.fadd, builder.fsub, builder.fmul
        axes = [ir.Constant(ir.IntType(64), LANES * axis) for axis in range(3)]
        near = _splat(builder, args[5])
        # Corners seen from the point.
        corners = [
            [sub(load(k, axes[j]), _splat(builder, args[2 + j])) for j in range(3)]
            for k in range(3)
        ]
        a, b, c = corners
        may = None
        for axis in range(3):
            for k, sign in ((0, "<="), (1, ">=")):
                side = near if k == 0 else builder.fsub(_constant(0.0), near)
                beside = [builder.fcmp_ordered(sign, corner[axis], side) for corner in corners]
                some = builder.or_(beside[0], builder.or_(beside[1], beside[2]))
                may = some if may is None else builder.and_(may, some)
        u, v = ([sub(q[j], a[j]) for j in range(3)] for q in (b, c))
        n = [sub(mul(u[j - 2], v[j - 1]), mul(u[j - 1], v[j - 2])) for j in range(3)]

        def dot(p: Any, q: Any) -> Any:
            return add(add(mul(p[0], q[0]), mul(p[1], q[1])), mul(p[2], q[2]))

        height = dot(n, a)
        limit = mul(mul(near, near), dot(n, n))
        flat = builder.fcmp_unordered("<=", mul(height, height), limit)
        return _bits(builder, builder.and_(may, flat))

    return signature, generate


cross_packet: Any = Intrinsic(_cross_packet)
approach_packet: Any = Intrinsic(_approach_packet)
