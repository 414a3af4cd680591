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
from numpy.typing import NDArray

from pcsg.addresses import FAR, call_with, make_array, view_doubles, view_ints, view_singles
from pcsg.blobtree.layout import (
    LISTS,
    MET,
    STACK,
    Pool,
    Tables,
    Work,
    find_tables,
    list_length,
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


reserve_floats, reserve_ints = _reserve("float64"), _reserve("int64")


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
    pool = (view_doubles(doubles, FAR), view_singles(singles, FAR), view_ints(integers, FAR))
    m = find_tables(pool, at_f, at_s, at_i)
    out = view_doubles(answers, FAR)
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


@njit
def ask(
    where: int, asked: int, want: int, ray: Ray, pool: Pool, at_f: int, at_s: int, at_i: int,
    out: Array, n: int, length: int,
) -> int:  # fmt: skip
    """Ask a model; `where` is the `address`."""
    count: int = call_with(where, (asked, want, ray, pool, at_f, at_s, at_i, out, n, length))
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
