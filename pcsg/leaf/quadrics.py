"""Capsule, and cylinder and cone without ends: what is built from the kernels of `solids`."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.jit import njit
from pcsg.leaf.registry import Array, LeafParameter, Pool, Solid, leaf
from pcsg.leaf.registry import Box as Bounds
from pcsg.leaf.solids import Cone, Sphere, cross_nappe, cross_pipe, turns
from pcsg.vec import Ray, Vec3

INF = math.inf

NO_BALL = 1e-100
"""A ball of this radius is a point."""

_sphere = njit(contract=True)(Sphere.crossings)
_cone = njit(contract=True)(Cone.crossings)


@njit(contract=True)
def capsule_ends(r: float) -> tuple[float, float]:
    """Return the lowest and the highest z of ``capsule(r)``."""
    return min(-1.0, 1.0 - r), max(1.0, 1.0 + r)


@njit(contract=True)
def capsule_center(p: Vec3, r: float) -> float:
    """Return the height of the ball of ``capsule(r)`` that a point is deepest in, or nearest to."""
    g = 1.0 - r
    square = r * (2.0 - r)
    if not square > 0.0:
        return 0.0 if r < 1.0 else 1.0
    return min(1.0, max(0.0, p.z - math.hypot(p.x, p.y) * g / math.sqrt(square)))


@leaf
class Capsule(Solid):
    """Balls of radius 1 about the origin and of radius r about (0, 0, 1), and all between them.

    Surface coordinates: u goes round the axis from +x, v is the height, from 0 to 1.
    """

    parameters = (LeafParameter("r", 1.0, low=0.0),)
    apart = True
    soft = True

    @classmethod
    def bounds_of(cls, args: Sequence[float]) -> Bounds:
        wide = max(1.0, args[0])
        # Not `capsule_ends`: nothing is compiled for a box.
        return Bounds((-wide, -wide, min(-1.0, 1.0 - args[0])), (wide, wide, 1.0 + args[0]))

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        length = math.hypot(math.hypot(d.x, d.y), d.z)
        return max(length, d.z + args[at] * length)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        r: float = args[at]
        lo, hi = INF, -INF
        # It is convex, and the union of its balls and of the part of a cone that touches both. The
        # larger ball alone where it contains the other.
        if r < 2.0 and _sphere(ray, want, args, at, pool, t, n) > n:
            lo, hi = t[n], t[n + 1]
        if r > NO_BALL:
            k = 1.0 / r
            ox, oy, oz = ray.ox * k, ray.oy * k, (ray.oz - 1.0) * k
            ball = Ray(ox, oy, oz, ray.dx * k, ray.dy * k, ray.dz * k, 0.0, INF)
            if _sphere(ball, want, args, at, pool, t, n) > n:
                lo, hi = min(lo, t[n]), max(hi, t[n + 1])
        # The sine of the cone's angle is 1 - r, and this the square of the cosine.
        height = r * (2.0 - r)
        if height > 0.0:
            wide, high = 1.0 / math.sqrt(height), 1.0 / height
            ox, oy, oz = ray.ox * wide, ray.oy * wide, (ray.oz - (1.0 - r)) * high
            cone = Ray(ox, oy, oz, ray.dx * wide, ray.dy * wide, ray.dz * high, 0.0, INF)
            if _cone(cone, want, args, at, pool, t, n) > n:
                lo, hi = min(lo, t[n]), max(hi, t[n + 1])
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        z = p.z - capsule_center(p, args[at])
        if p.x == 0.0 and p.y == 0.0 and z == 0.0:
            return Vec3(0.0, 0.0, 1.0)
        return Vec3(p.x, p.y, z)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        z = capsule_center(p, args[at])
        radius = 1.0 - (1.0 - args[at]) * z
        across = p.z - z
        return bool(p.x * p.x + p.y * p.y + across * across <= radius * radius)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        low, high = capsule_ends(args[at])
        return turns(p.y, p.x), min(1.0, max(0.0, (p.z - low) / (high - low)))


@leaf
class InfCylinder(Solid):
    """Cylinder without ends: x2 + y2 <= 1.

    For operations; a picture needs a scene that ends. Surface coordinates: u goes round the axis
    from +x, v is z.
    """

    bounds = Bounds((-1.0, -1.0, -INF), (1.0, 1.0, INF))
    apart = True
    soft = True

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        found, k, lo, hi = cross_pipe(ray)
        lo, hi = lo * k, hi * k
        if not (found and lo < hi):
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        if p.x == 0.0 and p.y == 0.0:
            return Vec3(1.0, 0.0, 0.0)
        return Vec3(p.x, p.y, 0.0)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return p.x * p.x + p.y * p.y <= 1.0

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return turns(p.y, p.x), p.z


@leaf
class InfCone(Solid):
    """Cone without ends: what ``cone(r)`` is part of, from its apex on.

    x2 + y2 <= (1 - (1-r) z)2 where 1 - (1-r) z >= 0. Surface coordinates: u goes round the axis
    from +x, v is z.
    """

    parameters = (LeafParameter("r", 0.0, low=0.0),)
    bounds = Bounds((-INF, -INF, -INF), (INF, INF, INF))
    apart = True
    soft = True

    @classmethod
    def bounds_of(cls, args: Sequence[float]) -> Bounds:
        g = 1.0 - args[0]
        if g == 0.0:
            return InfCylinder.bounds
        low, high = (-INF, 1.0 / g) if g > 0.0 else (1.0 / g, INF)
        return Bounds((-INF, -INF, low), (INF, INF, high))

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        found, k, tm, z, dz, lo, hi = cross_nappe(ray, args[at])
        if not found:
            return n
        # On this side of the apex only: where the radius is not negative.
        g = 1.0 - args[at]
        radius, slope = 1.0 - g * z, g * dz
        if slope > 0.0:
            hi = min(hi, radius / slope)
        elif slope < 0.0:
            lo = max(lo, radius / slope)
        elif radius < 0.0:
            return n
        lo, hi = (tm + lo) * k, (tm + hi) * k
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        rho, g = math.hypot(p.x, p.y), 1.0 - args[at]
        if rho == 0.0:
            return Vec3(0.0, 0.0, 1.0 if g >= 0.0 else -1.0)
        return Vec3(p.x / rho, p.y / rho, g)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        radius = 1.0 - (1.0 - args[at]) * p.z
        return bool(radius >= 0.0 and p.x * p.x + p.y * p.y <= radius * radius)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return turns(p.y, p.x), p.z
