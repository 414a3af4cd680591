"""Superellipsoids: unit balls of a norm, met by Newton's method between tangents.

Along a line the norm is convex, so its tangents lie below it: from a point before the solid the
tangent comes down to 1 no later than the norm does. The ends are approached so from both sides;
where the two pass each other, or the norm no longer falls, the line misses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.jit import njit
from pcsg.leaf.registry import Array, LeafParameter, Pool, Solid, leaf
from pcsg.leaf.solids import FLAT, size, turns
from pcsg.vec import Ray, Vec3

STEPS = 60
"""Most steps of Newton's method. Four or five are usual; a line that touches halves its error."""


@njit(contract=True)
def join(a: float, b: float, p: float) -> tuple[float, float, float]:
    """Return the p-norm of two numbers that are not negative, and its derivatives by them."""
    big, small = max(a, b), min(a, b)
    if big == 0.0:
        return 0.0, 0.0, 0.0
    ratio = small / big
    power = ratio**p
    total = 1.0 + power
    root = total ** (1.0 / p)
    # (big / norm)^(p-1); powers of numbers up to 1 stay in range, however large p is.
    steep = root / total
    # 0 to the power 0 is 1, as the derivative from this side is.
    flat = steep * ratio ** (p - 1.0)
    norm = big * root
    return (norm, steep, flat) if a >= b else (norm, flat, steep)


@njit(contract=True)
def norm_along(p: Vec3, d: Vec3, e: float, n: float) -> tuple[float, float]:
    """Return the norm at a point, and how fast it grows from there in a direction."""
    ring, by_x, by_y = join(abs(p.x), abs(p.y), 2.0 / e)
    norm, by_ring, by_z = join(ring, abs(p.z), 2.0 / n)
    # On a plane where a sign changes the norm grows to both sides.
    x = d.x if p.x > 0.0 else (-d.x if p.x < 0.0 else abs(d.x))
    y = d.y if p.y > 0.0 else (-d.y if p.y < 0.0 else abs(d.y))
    z = d.z if p.z > 0.0 else (-d.z if p.z < 0.0 else abs(d.z))
    if ring == 0.0:
        # From the axis it grows as the norm of the direction does.
        return norm, by_ring * join(abs(d.x), abs(d.y), 2.0 / e)[0] + by_z * z
    return norm, by_ring * (by_x * x + by_y * y) + by_z * z


@njit(contract=True)
def approach(p: Vec3, d: Vec3, e: float, n: float, s: float, end: float) -> tuple[bool, float]:
    """Go from outside at ``p + s d`` along d to the surface, or to `end`, where there is none.

    Returns
    -------
    tuple
        Whether the surface was met, and where.
    """
    for _ in range(STEPS):
        norm, slope = norm_along(Vec3(p.x + s * d.x, p.y + s * d.y, p.z + s * d.z), d, e, n)
        if norm <= 1.0:
            return True, s
        if not slope < 0.0:
            return False, s
        new = s + (norm - 1.0) / -slope
        if new > end:
            return False, s
        if not new > s:
            return True, s
        s = new
    return True, s


@leaf
class Superellipsoid(Solid):
    """Superellipsoid: (|x|^(2/e) + |y|^(2/e))^(e/n) + |z|^(2/n) <= 1.

    e rounds it as seen along z, n as seen from the side: 1 and 1 give the ball, towards 0 it
    becomes the box, (0.2, 1) a cushion, 2 gives edges: (2, 2) the octahedron. Up to 2 it is convex.
    Surface coordinates as those of the sphere.
    """

    parameters = (
        LeafParameter("e", low=0.0, high=2.0, open_low=True),
        LeafParameter("n", low=0.0, high=2.0, open_low=True),
    )
    apart = True
    soft = True

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        # The norm of the direction that is dual: 1/p + 1/q = 1. As p is 2/e, 1/q is 1 - e/2.
        big, small = max(abs(d.x), abs(d.y)), min(abs(d.x), abs(d.y))
        part = 1.0 - 0.5 * args[at]
        if big > 0.0 and part > 0.0:
            big = big * (1.0 + (small / big) ** (1.0 / part)) ** part
        big, small = max(big, abs(d.z)), min(big, abs(d.z))
        part = 1.0 - 0.5 * args[at + 1]
        if big > 0.0 and part > 0.0:
            big = big * (1.0 + (small / big) ** (1.0 / part)) ** part
        return big

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        big = size(ray)
        if big == 0.0:
            return n
        e, m = args[at], args[at + 1]
        k = 1.0 / big
        d = Vec3(ray.dx * k, ray.dy * k, ray.dz * k)
        # From the point nearest to the middle, so that a far origin costs no digits.
        tm = -(ray.ox * d.x + ray.oy * d.y + ray.oz * d.z) / (d.x * d.x + d.y * d.y + d.z * d.z)
        p = Vec3(ray.ox + tm * d.x, ray.oy + tm * d.y, ray.oz + tm * d.z)
        # Within the box, which touches it: outside the norm is more than 1.
        lo, hi = -math.inf, math.inf
        for axis in range(3):
            o, v = p[axis], d[axis]
            if abs(v) > FLAT:
                a, b = (-1.0 - o) / v, (1.0 - o) / v
                lo, hi = max(lo, min(a, b)), min(hi, max(a, b))
            elif abs(o) > 1.0:
                return n
        if not lo < hi:
            return n
        met, lo = approach(p, d, e, m, lo, hi)
        if not met:
            return n
        met, back = approach(p, Vec3(-d.x, -d.y, -d.z), e, m, -hi, -lo)
        if not met:
            return n
        lo, hi = (tm + lo) * k, (tm - back) * k
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        ring, by_x, by_y = join(abs(p.x), abs(p.y), 2.0 / args[at])
        _norm, by_ring, by_z = join(ring, abs(p.z), 2.0 / args[at + 1])
        x = math.copysign(by_x, p.x) * by_ring if p.x != 0.0 else 0.0
        y = math.copysign(by_y, p.y) * by_ring if p.y != 0.0 else 0.0
        z = math.copysign(by_z, p.z) if p.z != 0.0 else 0.0
        if x == 0.0 and y == 0.0 and z == 0.0:
            return Vec3(0.0, 0.0, 1.0)
        return Vec3(x, y, z)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        ring = join(abs(p.x), abs(p.y), 2.0 / args[at])[0]
        return bool(join(ring, abs(p.z), 2.0 / args[at + 1])[0] <= 1.0)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return turns(p.y, p.x), 0.5 + math.atan2(p.z, math.hypot(p.x, p.y)) / math.pi
