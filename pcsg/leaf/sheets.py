"""Triangles, disc and rectangle: sheets, which have a surface, no volume and no point inside."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.jit import njit
from pcsg.leaf.registry import Array, Pool, Solid, leaf
from pcsg.leaf.registry import Box as Bounds
from pcsg.leaf.solids import FLAT
from pcsg.vec import Ray, Vec3

EDGE = 1e-11
"""Barycentric tolerance: triangles reach this much over their edges, so that no ray slips through
between neighbours whose frames round differently. Their boxes include it."""

ROUNDING = 1e-15
"""What rounding may move a point of the plane z = 0, per distance of the origin: far triangles,
and those seen edge-on, reach farther over their edges by it."""

MOST = 1e-2
"""Never more than this: a ray almost in the plane is not let in from far beside the triangle."""

FAR = 1.0 + 2.0 * EDGE


@njit(contract=True)
def edge_reach(ray: Ray, inv: float) -> float:
    """Return how far a flat sheet reaches over its edges; `inv` is 1 over the ray's dz."""
    spread = (abs(ray.dx) + abs(ray.dy) + abs(ray.dz)) * abs(inv)
    reach = ROUNDING * (abs(ray.ox) + abs(ray.oy) + abs(ray.oz)) * spread
    return min(EDGE + reach, MOST)


@njit(contract=True)
def triangle_crossing(ray: Ray, sign: float, t: Array, n: int) -> int:
    """Cross the triangle (0,0,0), (sign,0,0), (0,sign,0); its one crossing is written twice."""
    if not abs(ray.dz) > FLAT:
        return n
    inv = 1.0 / ray.dz
    s = (0.0 - ray.oz) * inv
    u, v = sign * (ray.ox + s * ray.dx), sign * (ray.oy + s * ray.dy)
    edge = edge_reach(ray, inv)
    if u >= -edge and v >= -edge and u + v <= 1.0 + edge:
        t[n], t[n + 1] = s, s
        return n + 2
    return n


class _Flat(Solid):
    """What sheets in z = 0 have in common: the normal +z, and no point inside.

    Surface coordinates, but of triangles: x and y from -1 to 1 as 0 to 1.
    """

    sheet = True

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        return Vec3(0.0, 0.0, 1.0)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        return False

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return 0.5 + 0.5 * p.x, 0.5 + 0.5 * p.y


@leaf
class Tri1(_Flat):
    """Triangle (0,0,0), (1,0,0), (0,1,0): a sheet without volume, whose normal is +z.

    Surface coordinates: the barycentric ones of the second and the third corner.
    """

    bounds = Bounds((-EDGE, -EDGE, 0.0), (FAR, FAR, 0.0))
    corners = (Vec3(-EDGE, -EDGE, 0.0), Vec3(FAR, -EDGE, 0.0), Vec3(-EDGE, FAR, 0.0))

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        return triangle_crossing(ray, 1.0, t, n)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return p.x, p.y


@leaf
class Tri2(_Flat):
    """Triangle (0,0,0), (-1,0,0), (0,-1,0): a sheet without volume, whose normal is +z.

    Surface coordinates: the barycentric ones of the second and the third corner.
    """

    bounds = Bounds((-FAR, -FAR, 0.0), (EDGE, EDGE, 0.0))
    corners = (Vec3(EDGE, EDGE, 0.0), Vec3(-FAR, EDGE, 0.0), Vec3(EDGE, -FAR, 0.0))

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        return triangle_crossing(ray, -1.0, t, n)

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return -p.x, -p.y


@leaf
class Disc(_Flat):
    """Disc of radius 1 about the origin in z = 0: a sheet without volume, whose normal is +z.

    Surface coordinates: x and y, from 0 to 1.
    """

    bounds = Bounds((-1.0, -1.0, 0.0), (1.0, 1.0, 0.0))
    ball = (Vec3(0.0, 0.0, 0.0), 1.0)
    soft = True

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        return math.hypot(d.x, d.y)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        if not abs(ray.dz) > FLAT:
            return n
        s = (0.0 - ray.oz) / ray.dz
        x, y = ray.ox + s * ray.dx, ray.oy + s * ray.dy
        if x * x + y * y <= 1.0:
            t[n], t[n + 1] = s, s
            return n + 2
        return n


@leaf
class Rectangle(_Flat):
    """Square -1 <= x, y <= 1 in z = 0: a sheet without volume, whose normal is +z.

    Its edges reach over like those of triangles, so that no ray slips through between neighbours.
    Surface coordinates: x and y, from 0 to 1.
    """

    bounds = Bounds((-FAR, -FAR, 0.0), (FAR, FAR, 0.0))
    soft = True

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        if not abs(ray.dz) > FLAT:
            return n
        inv = 1.0 / ray.dz
        s = (0.0 - ray.oz) * inv
        x, y = ray.ox + s * ray.dx, ray.oy + s * ray.dy
        if max(abs(x), abs(y)) <= 1.0 + edge_reach(ray, inv):
            t[n], t[n + 1] = s, s
            return n + 2
        return n
