"""Canonical solids cut out by planes; `solids` says what their crossings have in common."""

from __future__ import annotations

import math

from pcsg.leaf.registry import UNIT_BOX, Array, Pool, Solid, leaf
from pcsg.leaf.registry import Box as Bounds
from pcsg.leaf.solids import FLAT, INF
from pcsg.vec import Ray, Vec3


@leaf
class Box(Solid):
    """Cube about the origin: -1 <= x, y, z <= 1.

    Surface coordinates: from 0 to 1 across each face, to the right and up as seen from outside;
    up is +z, and +y on the faces across z.
    """

    aliases = ("cube",)
    bounds = UNIT_BOX
    inlined = True

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        lo, hi = -INF, INF
        if abs(ray.dx) > FLAT:
            inv = 1.0 / ray.dx
            u, v = (-1.0 - ray.ox) * inv, (1.0 - ray.ox) * inv
            lo, hi = min(u, v), max(u, v)
        elif not -1.0 <= ray.ox <= 1.0:
            return n
        if abs(ray.dy) > FLAT:
            inv = 1.0 / ray.dy
            u, v = (-1.0 - ray.oy) * inv, (1.0 - ray.oy) * inv
            lo, hi = max(lo, min(u, v)), min(hi, max(u, v))
        elif not -1.0 <= ray.oy <= 1.0:
            return n
        if abs(ray.dz) > FLAT:
            inv = 1.0 / ray.dz
            u, v = (-1.0 - ray.oz) * inv, (1.0 - ray.oz) * inv
            lo, hi = max(lo, min(u, v)), min(hi, max(u, v))
        elif not -1.0 <= ray.oz <= 1.0:
            return n
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        x, y, z = abs(p.x), abs(p.y), abs(p.z)
        if x >= y and x >= z:
            return Vec3(math.copysign(1.0, p.x), 0.0, 0.0)
        if y >= z:
            return Vec3(0.0, math.copysign(1.0, p.y), 0.0)
        return Vec3(0.0, 0.0, math.copysign(1.0, p.z))

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return -1.0 <= p.x <= 1.0 and -1.0 <= p.y <= 1.0 and -1.0 <= p.z <= 1.0

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        x, y, z = abs(p.x), abs(p.y), abs(p.z)
        if x >= y and x >= z:
            return 0.5 + 0.5 * math.copysign(p.y, p.x * p.y), 0.5 + 0.5 * p.z
        if y >= z:
            return 0.5 - 0.5 * math.copysign(p.x, p.x * p.y), 0.5 + 0.5 * p.z
        return 0.5 + 0.5 * math.copysign(p.x, p.x * p.z), 0.5 + 0.5 * p.y


CORNERS = ((1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0))
"""Corners of the tetrahedron. The face opposite to corner c has the outward normal -c, and its
points have -c . p = 1."""


@leaf
class Tetrahedron(Solid):
    """Regular tetrahedron with corners (1,1,1), (-1,-1,1), (1,-1,-1), (-1,1,-1).

    Surface coordinates: two barycentric coordinates of each face, those of its first two corners
    in the order above.
    """

    corners = (
        Vec3(1.0, 1.0, 1.0),
        Vec3(-1.0, -1.0, 1.0),
        Vec3(1.0, -1.0, -1.0),
        Vec3(-1.0, 1.0, -1.0),
    )

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        ox, oy, oz = ray.ox, ray.oy, ray.oz
        dx, dy, dz = ray.dx, ray.dy, ray.dz
        # Towards each face: how fast, and how far it is. The speeds add up to zero.
        ea, sa = -(dx + dy + dz), 1.0 + (ox + oy + oz)
        eb, sb = dx + dy - dz, 1.0 - (ox + oy - oz)
        ec, sc = dy + dz - dx, 1.0 - (oy + oz - ox)
        ed, sd = dx - dy + dz, 1.0 - (ox - oy + oz)
        # Selections, not branches: signs of speeds are as good as random.
        ta, tb, tc, td = sa / ea, sb / eb, sc / ec, sd / ed
        lo = max(
            max(ta if ea < 0.0 else -INF, tb if eb < 0.0 else -INF),
            max(tc if ec < 0.0 else -INF, td if ed < 0.0 else -INF),
        )
        hi = min(
            min(ta if ea > 0.0 else INF, tb if eb > 0.0 else INF),
            min(tc if ec > 0.0 else INF, td if ed > 0.0 else INF),
        )
        if not lo < hi:
            return n
        if (
            (ea == 0.0 and sa < 0.0)
            or (eb == 0.0 and sb < 0.0)
            or (ec == 0.0 and sc < 0.0)
            or (ed == 0.0 and sd < 0.0)
        ):
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        a, b, c, d = -(p.x + p.y + p.z), p.x + p.y - p.z, p.y + p.z - p.x, p.x - p.y + p.z
        if a >= max(b, c, d):
            return Vec3(-1.0, -1.0, -1.0)
        if b >= max(c, d):
            return Vec3(1.0, 1.0, -1.0)
        if c >= d:
            return Vec3(-1.0, 1.0, 1.0)
        return Vec3(1.0, -1.0, 1.0)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return max(-(p.x + p.y + p.z), p.x + p.y - p.z, p.y + p.z - p.x, p.x - p.y + p.z) <= 1.0

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        a, b, c, d = -(p.x + p.y + p.z), p.x + p.y - p.z, p.y + p.z - p.x, p.x - p.y + p.z
        # The barycentric coordinate of a corner is a quarter of the distance from its face.
        if a >= max(b, c, d):
            return 0.25 * (1.0 - b), 0.25 * (1.0 - c)
        if b >= max(c, d):
            return 0.25 * (1.0 - a), 0.25 * (1.0 - c)
        return 0.25 * (1.0 - a), 0.25 * (1.0 - b)


@leaf
class Halfspace(Solid):
    """Everything below the xy-plane: z <= 0.

    Surface coordinates: u is x, v is y.
    """

    bounds = Bounds((-INF, -INF, -INF), (INF, INF, 0.0))

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        lo, hi = -INF, INF
        if ray.dz > 0.0:
            hi = (0.0 - ray.oz) / ray.dz
        elif ray.dz < 0.0:
            lo = (0.0 - ray.oz) / ray.dz
        elif ray.oz > 0.0:
            return n
        if not lo < hi:
            return n
        t[n], t[n + 1] = lo, hi
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        return Vec3(0.0, 0.0, 1.0)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return p.z <= 0.0

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return p.x, p.y
