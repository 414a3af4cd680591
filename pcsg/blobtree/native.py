"""Questions to a model, compiled once, behind one address.

Whoever asks calls a function at an address that he reads from the model: the ray tracer's kernels,
which know blobs as one leaf among many, and the batches of the Python interface. So the kernels of
blobs are compiled when a blob is first asked, and only then, and not once more in every caller.

The workspace lies on the stack of the function. Its length is not known to the compiler, which
would else take thousands of numbers for as many variables.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from pcsg.addresses import make_array
from pcsg.blobtree.layout import (
    LISTS,
    MET,
    STACK,
    Pool,
    Tables,
    Work,
    find_tables,
    list_length,
    wide,
)
from pcsg.blobtree.points import describe, gradient_at, value_at
from pcsg.blobtree.trace import ALL, FULL, shoot
from pcsg.jit import Intrinsic, function_address, njit
from pcsg.vec import Ray, Vec3

Array = NDArray[np.float64]

CROSSINGS, INTERVALS, FIELD, GRADIENT, DESCRIPTION = range(5)
"""What can be asked; answers are numbers: crossings as `trace.shoot` has them, or as a leaf's
intervals; the field; its gradient; `points.ATTRIBUTE_COLUMNS` attributes."""

MOST = 4096
"""Most primitives whose support a ray may cross: 1.4 MB of stack."""

FAR = 1 << 60
"""The length of an array of which the pointer is all that is known."""


def _reserve(item: str) -> Any:
    """Return an intrinsic for an array on the stack; it lives as long as its caller runs."""

    def reserve(typing_context: Any, length: Any) -> Any:
        from numba.core import types

        kind = getattr(types, item)

        def generate(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            data = builder.alloca(context.get_data_type(kind), size=args[0])
            return make_array(context, builder, kind, data, args[0])

        return types.Array(kind, 1, "C")(types.intp), generate

    return Intrinsic(reserve)


def _view(item: str) -> Any:
    """Return an intrinsic for an array of any length at a pointer."""

    def view(typing_context: Any, pointer: Any) -> Any:
        from numba.core import types

        kind = getattr(types, item)

        def generate(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            length = context.get_constant(types.intp, FAR)
            return make_array(context, builder, kind, args[0], length)

        return types.Array(kind, 1, "C")(pointer), generate

    return Intrinsic(view)


reserve_floats, reserve_ints = _reserve("float64"), _reserve("int64")
_view_doubles, _view_singles, _view_ints = (_view(item) for item in ("float64", "float32", "int32"))


@njit(contract=True)
def find_intervals(
    m: Tables, work: Work, ray: Ray, want: int, out: Array, n: int, length: int
) -> int:
    """Write the inside intervals of a ray and return the new length, or `FULL`.

    For FIRST and ANY only the first interval that does not end before tmin; of it, only the end
    that the ray meets first within [tmin, tmax] is exact.
    """
    if n + 2 > length:
        return FULL
    end, inside = shoot(m, work, ray, want, out, n, length)
    if want == ALL or end == FULL:
        return end
    if end == n:
        if not inside:
            return n
        out[n], out[n + 1] = -math.inf, math.inf
    elif inside:
        out[n], out[n + 1] = -math.inf, out[n]
    else:
        out[n + 1] = math.inf
    return n + 2


def answer(
    asked: int,
    want: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    tmin: float,
    tmax: float,
    doubles: Any,
    singles: Any,
    integers: Any,
    at_f: int,
    at_s: int,
    at_i: int,
    answers: Any,
    n: int,
    length: int,
) -> int:
    """Answer one question into ``answers[n:length]``.

    Returns
    -------
    int
        For crossings the new length or `FULL`; else the number of primitives with a field there,
        or `FULL`.
    """
    pool = (_view_doubles(doubles), _view_singles(singles), _view_ints(integers))
    m = find_tables(pool, at_f, at_s, at_i)
    out = _view_doubles(answers)
    room = min(m.primitive_count // 4 * 4 + 8, MOST)
    work = Work(
        reserve_floats((MET + 4) * room + 8),
        reserve_ints(LISTS * room + list_length(room)),
        reserve_floats(2 * STACK),
        reserve_ints(4 * STACK),
        room,
    )
    ray = Ray(ox, oy, oz, dx, dy, dz, tmin, tmax)
    if asked == CROSSINGS:
        return shoot(m, work, ray, want, out, n, length)[0]
    if asked == INTERVALS:
        return find_intervals(m, work, ray, want, out, n, length)
    p = Vec3(ox, oy, oz)
    if asked == FIELD:
        out[n], _slope, count = value_at(m, work, p, Vec3(1.0, 0.0, 0.0))
        return count
    if asked == GRADIENT:
        g = gradient_at(m, work, p)
        out[n], out[n + 1], out[n + 2] = g.x, g.y, g.z
        return FULL if math.isnan(g.x) else 1
    return describe(m, work, p, out, n)


_REALS = ", ".join(["float64"] * 8)
_POOL = "CPointer(float64), CPointer(float32), CPointer(int32), int64, int64, int64"
_SIGNATURE = f"int64(int64, int64, {_REALS}, {_POOL}, CPointer(float64), int64, int64)"


@cache
def address() -> int:
    """Return where `answer` is; compiled on the first call, or loaded."""
    return function_address(_SIGNATURE, answer)


def split_address(where: int) -> NDArray[np.int32]:
    """Return an address as two integers, as models hold it: the upper half comes last."""
    return np.array([where], "<u8").view("<i4").astype(np.int32)


@njit
def join_address(lower: int, upper: int) -> int:
    """Return the address that was split."""
    return (wide(upper) << 32) | (wide(lower) & 0xFFFFFFFF)


def _call(
    typing_context: Any, where: Any, asked: Any, want: Any, ray: Any, pool: Any, at: Any, out: Any,
    n: Any, length: Any,
) -> Any:  # fmt: skip
    """Call `answer` at an address."""
    from numba.core import cgutils, types

    signature = types.int64(where, asked, want, ray, pool, at, out, n, length)

    def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
        def cast(value: Any, kind: Any, wanted: Any) -> Any:
            return context.cast(builder, value, kind, wanted)

        def pointer(value: Any, kind: Any) -> Any:
            return context.make_array(kind)(context, builder, value).data

        kinds = given.args
        values = [cast(args[k], kinds[k], types.int64) for k in (1, 2)]
        values += cgutils.unpack_tuple(builder, args[3], 8)
        arrays = cgutils.unpack_tuple(builder, args[4], 3)
        values += [pointer(v, k) for v, k in zip(arrays, kinds[4].types, strict=True)]
        values += cgutils.unpack_tuple(builder, args[5], 3)
        values += [pointer(args[6], kinds[6])]
        values += [cast(args[k], kinds[k], types.int64) for k in (7, 8)]
        # The result, and what went wrong, which is nothing: no kernel raises.
        number, nothing = ir.IntType(64), ir.IntType(8).as_pointer()
        result = cgutils.alloca_once(builder, number)
        values = [result, cgutils.alloca_once(builder, nothing), *values]
        shape = ir.FunctionType(ir.IntType(32), [v.type for v in values])
        at_address = cast(args[0], kinds[0], types.int64)
        function = builder.inttoptr(at_address, shape.as_pointer())
        builder.call(function, values)
        return builder.load(result)

    return signature, generate


_call_at: Any = Intrinsic(_call)


@njit
def ask(
    where: int, asked: int, want: int, ray: Ray, pool: Pool, at_f: int, at_s: int, at_i: int,
    out: Array, n: int, length: int,
) -> int:  # fmt: skip
    """Ask a model; `where` is the `address`."""
    at = (np.int64(at_f), np.int64(at_s), np.int64(at_i))
    count: int = _call_at(where, asked, want, ray, pool, at, out, n, length)
    return count


@njit(entry=True)
def ask_batch(
    where: int,
    asked: int,
    want: int,
    pool: Pool,
    rays: NDArray[np.float64],
    begin: int,
    end: int,
    columns: int,
    out: Array,
    counts: NDArray[np.int64],
    used: int,
) -> tuple[int, int]:
    """Ask for rays [begin, end) of (N, 8), one after the other, into ``out[used:]``.

    Returns the number of the ray that found no room, or `end`; and how much of `out` is used.
    """
    for k in range(begin, end):
        ray = Ray(
            rays[k, 0],
            rays[k, 1],
            rays[k, 2],
            rays[k, 3],
            rays[k, 4],
            rays[k, 5],
            rays[k, 6],
            rays[k, 7],
        )
        n = ask(where, asked, want, ray, pool, 0, 0, 0, out, used, len(out))
        if n == FULL:
            return k, used
        counts[k] = n - used if columns == 0 else columns
        used += counts[k]
    return end, used
