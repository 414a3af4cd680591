"""Canonical round solids, and none at all. Size and place come from transformation nodes.

What the crossings have in common:

- A direction may have any length from 1e-150 to 1e150 and any zeros in it. Where squares would
  leave the range of floats it is scaled first (`LEAST_SQUARE`); a component below `FLAT` is zero.
- Membership of a line parallel to a face is decided by the closed set.
- An interval is written only where ``lo < hi``, so tangents write nothing; a comparison with a NaN
  is false and writes nothing either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.jit import njit
from pcsg.leaf.registry import EMPTY_BOX, UNIT_BOX, Array, LeafParameter, Pool, Solid, leaf
from pcsg.leaf.registry import Box as Bounds
from pcsg.vec import Ray, Vec3

INF = math.inf
TURN = 2.0 * math.pi

FLAT = 1e-300
"""A component of a direction below this is zero: a ray moves 1e150 times farther elsewhere."""

LEAST_SQUARE, GREATEST_SQUARE = 1e-200, 1e200
"""Squared lengths between these need no scaling, however far the origin is."""

FLAT_SQUARE = 1e-290
"""The same as `FLAT` for the squared length of a scaled direction seen along an axis."""

PARALLEL = 1e-15
"""A line is parallel to the side of a cone where it departs from it by no more than this part."""


@njit(contract=True)
def size(ray: Ray) -> float:
    """Return the largest component of the direction, for scaling; 0 if it is no direction."""
    big = max(abs(ray.dx), abs(ray.dy), abs(ray.dz))
    return big if big > FLAT else 0.0


@njit(contract=True)
def turns(y: float, x: float) -> float:
    """Return the angle of (x, y) in [0, 1)."""
    u = math.atan2(y, x) / TURN
    return u if u >= 0.0 else min(u + 1.0, 1.0 - 2.0**-53)


@leaf
class Sphere(Solid):
    """Unit ball about the origin: x2 + y2 + z2 <= 1.

    Surface coordinates: u is the longitude from +x, v the latitude from the south pole, both from
    0 to 1.
    """

    bounds = UNIT_BOX
    ball = (Vec3(0.0, 0.0, 0.0), 1.0)
    inlined = True

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        return math.hypot(math.hypot(d.x, d.y), d.z)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        ox, oy, oz = ray.ox, ray.oy, ray.oz
        dx, dy, dz, k = ray.dx, ray.dy, ray.dz, 1.0
        a = dx * dx + dy * dy + dz * dz
        if not LEAST_SQUARE < a < GREATEST_SQUARE:
            big = size(ray)
            if big == 0.0:
                return n
            k = 1.0 / big
            dx, dy, dz = dx * k, dy * k, dz * k
            a = dx * dx + dy * dy + dz * dz
        # By Lagrange's identity the discriminant is |d|2 - |o x d|2: the distance of the line from
        # the centre keeps its digits where the origin is far away, and a miss costs no division.
        cx, cy, cz = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
        disc = a - (cx * cx + cy * cy + cz * cz)
        if not disc > 0.0:
            return n
        inv = k / a
        tm, h = -(ox * dx + oy * dy + oz * dz) * inv, math.sqrt(disc) * inv
        lo, hi = tm - h, tm + h
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        return p

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return p.x * p.x + p.y * p.y + p.z * p.z <= 1.0

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return turns(p.y, p.x), 0.5 + math.atan2(p.z, math.hypot(p.x, p.y)) / math.pi


SIDE, BOTTOM, TOP = 0, 1, 2


@njit(contract=True)
def frustum_face(p: Vec3, r: float) -> int:
    """Return the face of ``cone(r)`` that a point is nearest to."""
    g = 1.0 - r
    side = abs(math.hypot(p.x, p.y) - (1.0 - g * p.z)) / math.sqrt(1.0 + g * g)
    bottom, top = abs(p.z), abs(1.0 - p.z)
    if bottom < side and bottom <= top:
        return BOTTOM
    if top < side and r > 0.0:
        return TOP
    return SIDE


@njit(contract=True)
def frustum_normal(p: Vec3, r: float) -> Vec3:
    """Return the outward normal of ``cone(r)`` at a point of its surface."""
    face = frustum_face(p, r)
    if face == BOTTOM:
        return Vec3(0.0, 0.0, -1.0)
    rho = math.hypot(p.x, p.y)
    if face == TOP or rho == 0.0:
        return Vec3(0.0, 0.0, 1.0)
    return Vec3(p.x / rho, p.y / rho, 1.0 - r)


@njit(contract=True)
def frustum_uv(p: Vec3, r: float) -> tuple[float, float]:
    """Return the surface coordinates of ``cone(r)``."""
    face = frustum_face(p, r)
    if face == BOTTOM:
        return 0.5 - 0.5 * p.x, 0.5 + 0.5 * p.y
    if face == TOP:
        return 0.5 + 0.5 * p.x / r, 0.5 + 0.5 * p.y / r
    return turns(p.y, p.x), p.z


@njit(contract=True)
def cross_pipe(ray: Ray) -> tuple[bool, float, float, float]:
    """Meet x2 + y2 <= 1.

    Returns
    -------
    tuple
        Whether it is met, what the direction is scaled by, and where, times that: in s = t / k.
    """
    ox, oy = ray.ox, ray.oy
    dx, dy, k = ray.dx, ray.dy, 1.0
    a = dx * dx + dy * dy
    if not LEAST_SQUARE < a < GREATEST_SQUARE:
        big = size(ray)
        if big == 0.0:
            return False, k, 0.0, 0.0
        k = 1.0 / big
        dx, dy = dx * k, dy * k
        a = dx * dx + dy * dy
    if a > FLAT_SQUARE:
        # The distance of the line from the axis, as for the sphere.
        c = ox * dy - oy * dx
        disc = a - c * c
        if not disc > 0.0:
            return False, k, 0.0, 0.0
        inv = 1.0 / a
        tm, h = -(ox * dx + oy * dy) * inv, math.sqrt(disc) * inv
        return True, k, tm - h, tm + h
    return ox * ox + oy * oy <= 1.0, k, -INF, INF


@njit(contract=True)
def cross_nappe(ray: Ray, r: float) -> tuple[bool, float, float, float, float, float, float]:
    """Meet ``cone(r)`` without its ends.

    Returns
    -------
    tuple
        Whether it is met, what the direction is scaled by; the scaled parameter of the point of the
        line nearest to the middle of the axis, its z and the direction's; and where the cone is
        met, counted from there.
    """
    ox, oy, oz = ray.ox, ray.oy, ray.oz
    dx, dy, dz, k = ray.dx, ray.dy, ray.dz, 1.0
    flat = dx * dx + dy * dy
    length = flat + dz * dz
    if not LEAST_SQUARE < length < GREATEST_SQUARE:
        big = size(ray)
        if big == 0.0:
            return False, k, 0.0, 0.0, 0.0, 0.0, 0.0
        k = 1.0 / big
        dx, dy, dz = dx * k, dy * k, dz * k
        flat = dx * dx + dy * dy
        length = flat + dz * dz
    # From there, so that a far origin costs no digits. s is t counted from it.
    tm = -(ox * dx + oy * dy + (oz - 0.5) * dz) / length
    px, py, pz = ox + tm * dx, oy + tm * dy, oz + tm * dz
    # x2 + y2 - (radius at z)2 = a s2 + 2 b s + c along the line.
    g = 1.0 - r
    radius, slope = 1.0 - g * pz, g * dz
    a = flat - slope * slope
    if abs(a) <= PARALLEL * flat:
        # Rounding alone would give ends to a line beside the cone.
        a = 0.0
    b = px * dx + py * dy + radius * slope
    c = px * px + py * py - radius * radius
    # b2 - a c by Lagrange's identity, which keeps its digits at the apex.
    vx, vy = px * slope + radius * dx, py * slope + radius * dy
    across = px * dy - py * dx
    disc = vx * vx + vy * vy - across * across
    lo, hi = -INF, INF
    if disc > 0.0 or a < 0.0:
        root = math.sqrt(max(disc, 0.0))
        q = -(b + root) if b >= 0.0 else root - b
        # a = 0, parallel to the side, gives an infinite end; q = 0 is a hit of the apex.
        u, v = q / a, (c / q if q != 0.0 else 0.0)
        near, far = min(u, v), max(u, v)
        # Where a < 0 the line runs into both nappes; that of a positive radius counts.
        lo = near if a >= 0.0 else (-INF if slope > 0.0 else far)
        hi = far if a >= 0.0 else (near if slope > 0.0 else INF)
    elif not (a <= FLAT_SQUARE and c <= 0.0):
        return False, k, 0.0, 0.0, 0.0, 0.0, 0.0
    return True, k, tm, pz, dz, lo, hi


@leaf
class Cylinder(Solid):
    """Cylinder of radius 1 from the xy-plane up to z = 1: x2 + y2 <= 1, 0 <= z <= 1.

    Surface coordinates: on the side u goes round the axis from +x, v is z; on the caps both are
    the disc's own, as seen from outside.
    """

    bounds = Bounds((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    ball = (Vec3(0.0, 0.0, 0.5), math.hypot(1.0, 0.5))

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        return math.hypot(d.x, d.y) + max(0.0, d.z)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        found, k, lo, hi = cross_pipe(ray)
        if not found:
            return n
        oz, dz = ray.oz, ray.dz * k
        if abs(dz) > FLAT:
            inv = 1.0 / dz
            u, v = -oz * inv, (1.0 - oz) * inv
            lo, hi = max(lo, min(u, v)), min(hi, max(u, v))
        elif not 0.0 <= oz <= 1.0:
            return n
        lo, hi = lo * k, hi * k
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        return frustum_normal(p, 1.0)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return 0.0 <= p.z <= 1.0 and p.x * p.x + p.y * p.y <= 1.0

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return frustum_uv(p, 1.0)


@leaf
class Cone(Solid):
    """Cone on the unit disc, from the xy-plane up to z = 1: x2 + y2 <= (1 - (1-r) z)2, 0 <= z <= 1.

    r is the radius at the top: 0 gives a point, 1 the cylinder, more a cone that widens.
    Surface coordinates as those of the cylinder.
    """

    parameters = (LeafParameter("r", 0.0, low=0.0),)

    @classmethod
    def bounds_of(cls, args: Sequence[float]) -> Bounds:
        wide = max(1.0, args[0])
        return Bounds((-wide, -wide, 0.0), (wide, wide, 1.0))

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        across = math.hypot(d.x, d.y)
        return max(across, args[at] * across + d.z)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        found, k, tm, pz, dz, lo, hi = cross_nappe(ray, args[at])
        if not found:
            return n
        if abs(dz) > FLAT:
            inv = 1.0 / dz
            u, v = -pz * inv, (1.0 - pz) * inv
            lo, hi = max(lo, min(u, v)), min(hi, max(u, v))
        elif not 0.0 <= ray.oz <= 1.0:
            return n
        lo, hi = (tm + lo) * k, (tm + hi) * k
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        return frustum_normal(p, args[at])

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        radius = 1.0 - (1.0 - args[at]) * p.z
        return 0.0 <= p.z <= 1.0 and p.x * p.x + p.y * p.y <= radius * radius

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return frustum_uv(p, args[at])


@leaf
class Empty(Solid):
    """The empty solid: no point at all."""

    bounds = EMPTY_BOX
    primitives = 0

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        return n

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        return Vec3(0.0, 0.0, 1.0)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return False

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return 0.0, 0.0
