"""Leaves that few scenes have: each is compiled apart from the loops that trace rays.

The kernels of such a leaf are one function, `answer`, which is called through its address. So a
scene compiles the kinds that it has and no others, and a new kind changes nothing for the rest:
neither the time to compile nor what the compiler makes of their loops. The addresses stand where
the integers of the pool begin, two for each kind; see `addresses_of`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.addresses import (
    FAR,
    call_with,
    join_address,
    split_address,
    view_doubles,
    view_ints,
    view_singles,
)
from pcsg.jit import function_address, njit
from pcsg.leaf.registry import LEAVES, Array, OtherUv, Pool, Solid
from pcsg.simd import local_doubles
from pcsg.vec import Ray, Vec3

CROSSINGS, NORMAL, PART_NORMAL, INSIDE, UV, OTHER_UV, ATTRIBUTES = range(7)
"""What can be asked: the kernels of the contract."""

_SIGNATURE = (
    "int64(int64, int64, float64, float64, float64, float64, float64, float64, float64, float64, "
    "CPointer(float64), int64, CPointer(float64), CPointer(float32), CPointer(int32), "
    "CPointer(float64), int64, int64)"
)


def _no_other_uv(p: Vec3, args: Array, at: int, pool: Pool) -> OtherUv:
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


def _no_attributes(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float, float, float]:
    return -1.0, -1.0, -1.0, -1.0


def build_answer(solid: type[Solid]) -> Callable[..., int]:
    """Return the one function that a leaf is compiled to; its result counts for crossings only."""

    def kernel(method: str, otherwise: Callable[..., Any] | None = None) -> Callable[..., Any]:
        own = getattr(solid, method)
        chosen = otherwise if otherwise and own is getattr(Solid, method) else own
        return njit(contract=True)(chosen)

    crossings, normal, inside, uv = map(kernel, ("crossings", "normal", "inside", "uv"))

    def whole_normal(p: Vec3, part: float, args: Array, at: int, pool: Pool) -> Vec3:
        n: Vec3 = normal(p, args, at, pool)
        return n

    part_normal = kernel("part_normal", whole_normal)
    other_uv = kernel("other_uv", _no_other_uv)
    attributes = kernel("attributes", _no_attributes)

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
        arguments: Any,
        at: int,
        doubles: Any,
        singles: Any,
        integers: Any,
        answers: Any,
        n: int,
        length: int,
    ) -> int:
        args, out = view_doubles(arguments, FAR), view_doubles(answers, length)
        pool = (view_doubles(doubles, FAR), view_singles(singles, FAR), view_ints(integers, FAR))
        if asked == CROSSINGS:
            found: int = crossings(
                Ray(ox, oy, oz, dx, dy, dz, tmin, tmax), want, args, at, pool, out, n
            )
            return found
        p = Vec3(ox, oy, oz)
        if asked == INSIDE:
            return int(inside(p, args, at, pool))
        if asked == NORMAL:
            out[0], out[1], out[2] = normal(p, args, at, pool)
        elif asked == PART_NORMAL:
            out[0], out[1], out[2] = part_normal(p, dx, args, at, pool)
        elif asked == UV:
            out[0], out[1] = uv(p, args, at, pool)
        elif asked == OTHER_UV:
            out[0], out[1], out[2], out[3], out[4], out[5] = other_uv(p, args, at, pool)
        elif asked == ATTRIBUTES:
            out[0], out[1], out[2], out[3] = attributes(p, args, at, pool)
        return 0

    return answer


@cache
def _address_of(kind: int) -> int:
    """Return where the function of a leaf is; compiled on the first call, or loaded."""
    (solid,) = (solid for solid in LEAVES.values() if solid.kind == kind)
    return function_address(_SIGNATURE, build_answer(solid))


def length_of_addresses(solids: Collection[type[Solid]]) -> int:
    """Return how many integers the addresses take at the beginning of a pool for these leaves."""
    return 2 * len(LEAVES) if any(solid.apart for solid in solids) else 0


def addresses_of(solids: Collection[type[Solid]]) -> NDArray[np.int32]:
    """Return the integers that a pool for these leaves begins with; compiles what is not yet."""
    table = np.zeros(length_of_addresses(solids), np.int32)
    for solid in solids:
        if solid.apart:
            table[2 * solid.kind : 2 * solid.kind + 2] = split_address(_address_of(solid.kind))
    return table


@njit
def _ask(
    asked: int, kind: int, want: int, ray: Ray, args: Array, at: int, pool: Pool, out: Array, n: int
) -> int:
    where = join_address(pool[2][2 * kind], pool[2][2 * kind + 1])
    found: int = call_with(where, (asked, want, ray, args, at, pool, out, n, len(out)))
    return found


@njit
def _ask_at(
    asked: int, kind: int, p: Vec3, part: float, args: Array, at: int, pool: Pool, out: Array
) -> int:
    """Ask about a point; it goes as the origin of a ray."""
    ray = Ray(p.x, p.y, p.z, part, 0.0, 0.0, 0.0, 0.0)
    return _ask(asked, kind, 0, ray, args, at, pool, out, 0)


@njit
def apart_crossings(
    kind: int, ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int
) -> int:
    """Ask a leaf that is compiled apart for its crossings."""
    return _ask(CROSSINGS, kind, want, ray, args, at, pool, t, n)


@njit
def apart_normal(kind: int, p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
    """Ask such a leaf for its normal."""
    out = local_doubles()
    _ask_at(NORMAL, kind, p, 0.0, args, at, pool, out)
    return Vec3(out[0], out[1], out[2])


@njit
def apart_part_normal(kind: int, p: Vec3, part: float, args: Array, at: int, pool: Pool) -> Vec3:
    """Ask such a leaf for its normal, where the part may be known."""
    out = local_doubles()
    _ask_at(PART_NORMAL, kind, p, part, args, at, pool, out)
    return Vec3(out[0], out[1], out[2])


@njit
def apart_inside(kind: int, p: Vec3, args: Array, at: int, pool: Pool) -> bool:
    """Ask such a leaf whether it contains a point."""
    return _ask_at(INSIDE, kind, p, 0.0, args, at, pool, args) != 0


@njit
def apart_uv(kind: int, p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
    """Ask such a leaf for its surface coordinates."""
    out = local_doubles()
    _ask_at(UV, kind, p, 0.0, args, at, pool, out)
    return out[0], out[1]


@njit
def apart_other_uv(kind: int, p: Vec3, args: Array, at: int, pool: Pool) -> OtherUv:
    """Ask such a leaf for the coordinates of its other parts."""
    out = local_doubles()
    _ask_at(OTHER_UV, kind, p, 0.0, args, at, pool, out)
    return out[0], out[1], out[2], out[3], out[4], out[5]


@njit
def apart_attributes(
    kind: int, p: Vec3, args: Array, at: int, pool: Pool
) -> tuple[float, float, float, float]:
    """Ask such a leaf for colour and label."""
    out = local_doubles()
    _ask_at(ATTRIBUTES, kind, p, 0.0, args, at, pool, out)
    return out[0], out[1], out[2], out[3]
