"""The torus: roots of a quartic, isolated so that their number is always even.

With its origin at the foot of the perpendicular from the centre and a unit direction u, the line
p + s u meets the torus where the quartic F(s) = (s2 + |p|2 + 1 - r2)2 - 4 (x2 + y2) is zero. F is
the product of G = (rho - 1)2 + z2 - r2, the squared distance from the ring less r2, and of
(rho + 1)2 + z2 - r2, which is nowhere negative. So F says where to look: between two neighbours of
its critical points, the roots of a cubic, there is one change of sign or none. And G, which keeps
its digits for the thinnest tube, says what the sign is and where it changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.jit import njit
from pcsg.leaf.registry import Array, LeafParameter, Pool, Solid, leaf
from pcsg.leaf.registry import Box as Bounds
from pcsg.leaf.solids import FLAT, GREATEST_SQUARE, LEAST_SQUARE, size, turns
from pcsg.vec import Ray, Vec3

THIRD = 2.0 * math.pi / 3.0
STEPS = 100


@njit(contract=True)
def excess(p: Vec3, u: Vec3, r: float, s: float) -> tuple[float, float]:
    """Return G at p + s u and its derivative by s."""
    x, y, z = p.x + s * u.x, p.y + s * u.y, p.z + s * u.z
    rho = math.sqrt(x * x + y * y)
    off = rho - 1.0
    # On the axis rho has no derivative; 0 there makes the search bisect.
    slope = 2.0 * (off * (x * u.x + y * u.y) / rho + z * u.z) if rho > 0.0 else 0.0
    return off * off + z * z - r * r, slope


@njit(contract=True)
def find_surface(p: Vec3, u: Vec3, r: float, outer: float, inner: float) -> float:
    """Return s on the surface between one outside and one inside: Newton, kept in the bracket."""
    s = 0.5 * (outer + inner)
    step = abs(inner - outer)
    for _ in range(STEPS):
        g, slope = excess(p, u, r, s)
        if g > 0.0:
            outer = s
        else:
            inner = s
        least, most = min(outer, inner), max(outer, inner)
        move = g / slope if slope != 0.0 else math.inf
        new = s - move
        # Bisect where Newton leaves the bracket or does not at least halve its step.
        if not (least <= new <= most and abs(move) <= 0.5 * step):
            new = 0.5 * (outer + inner)
        step = abs(new - s)
        s = new
        if step <= 4e-16:
            break
    return s


@njit(contract=True)
def critical_points(p: float, q: float) -> tuple[int, float, float, float]:
    """Return the real roots of s3 + p s + q, ascending, and how many they are: 1 or 3."""
    half, third = 0.5 * q, p / 3.0
    disc = half * half + third * third * third
    if disc > 0.0 or third > -1e-30:
        w = (abs(half) + math.sqrt(max(disc, 0.0))) ** (1.0 / 3.0)
        s = w - third / w if w > 0.0 else 0.0
        return 1, math.copysign(s, -half), 0.0, 0.0
    m = 2.0 * math.sqrt(-third)
    angle = math.acos(min(1.0, max(-1.0, q / (third * m)))) / 3.0
    return (
        3,
        m * math.cos(angle + THIRD),
        m * math.cos(angle - THIRD),
        m * math.cos(angle),
    )


@leaf
class Torus(Solid):
    """Torus about the z-axis: a ring of radius 1 in the xy-plane, with a tube of radius r.

    Surface coordinates: u goes round the axis from +x, v round the tube from its outermost line
    upwards, both from 0 to 1.
    """

    parameters = (LeafParameter("r", low=0.0, high=1.0, open_low=True),)

    @classmethod
    def bounds_of(cls, args: Sequence[float]) -> Bounds:
        r = args[0]
        return Bounds((-1.0 - r, -1.0 - r, -r), (1.0 + r, 1.0 + r, r))

    @staticmethod
    def support(d: Vec3, args: Sequence[float] | Array, at: int) -> float:
        return math.hypot(d.x, d.y) + args[at] * math.hypot(math.hypot(d.x, d.y), d.z)

    @staticmethod
    def crossings(ray: Ray, want: int, args: Array, at: int, pool: Pool, t: Array, n: int) -> int:
        r = args[at]
        ox, oy, oz = ray.ox, ray.oy, ray.oz
        dx, dy, dz, k = ray.dx, ray.dy, ray.dz, 1.0
        length = dx * dx + dy * dy + dz * dz
        if not LEAST_SQUARE < length < GREATEST_SQUARE:
            big = size(ray)
            if big == 0.0:
                return n
            k = 1.0 / big
            dx, dy, dz = dx * k, dy * k, dz * k
            length = dx * dx + dy * dy + dz * dz
        tm = -(ox * dx + oy * dy + oz * dz) / length
        p = Vec3(ox + tm * dx, oy + tm * dy, oz + tm * dz)
        away = p.x * p.x + p.y * p.y + p.z * p.z
        room = (1.0 + r) * (1.0 + r) - away
        if not room > 0.0:
            return n
        unit = 1.0 / math.sqrt(length)
        u = Vec3(dx * unit, dy * unit, dz * unit)
        # The part of the line in the bounding sphere and between the planes z = +-r: nothing of
        # the torus lies beyond, so both ends count as outside.
        hi = math.sqrt(room)
        lo = -hi
        if abs(u.z) > FLAT:
            a, b = (-r - p.z) / u.z, (r - p.z) / u.z
            lo, hi = max(lo, min(a, b)), min(hi, max(a, b))
        elif abs(p.z) > r:
            return n
        if not lo < hi:
            return n
        count, c0, c1, c2 = critical_points(
            away + 1.0 - r * r - 2.0 * (u.x * u.x + u.y * u.y), -2.0 * (p.x * u.x + p.y * u.y)
        )
        start, last, within = n, lo, False
        for j in range(count + 1):
            if j == count:
                s, now = hi, False
            else:
                s = c0 if j == 0 else (c1 if j == 1 else c2)
                if not last < s < hi:
                    continue
                g, _ = excess(p, u, r, s)
                # To touch the surface from outside is to miss, from inside to stay.
                now = g <= 0.0 if within else g < 0.0
            if now and not within:
                x = (tm + find_surface(p, u, r, last, s) * unit) * k
                if n > start and x <= t[n - 1]:
                    n -= 1
                else:
                    t[n] = x
                    n += 1
            elif within and not now:
                x = (tm + find_surface(p, u, r, s, last) * unit) * k
                if x > t[n - 1]:
                    t[n] = x
                    n += 1
                else:
                    n -= 1
            last, within = s, now
        return n

    @staticmethod
    def normal(p: Vec3, args: Array, at: int, pool: Pool) -> Vec3:
        rho = math.hypot(p.x, p.y)
        if rho == 0.0:
            return Vec3(0.0, 0.0, 1.0)
        k = 1.0 - 1.0 / rho
        return Vec3(p.x * k, p.y * k, p.z)

    @staticmethod
    def inside(p: Vec3, args: Array, at: int, pool: Pool) -> bool:
        off = math.hypot(p.x, p.y) - 1.0
        r: float = args[at]
        return off * off + p.z * p.z <= r * r

    @staticmethod
    def uv(p: Vec3, args: Array, at: int, pool: Pool) -> tuple[float, float]:
        return turns(p.y, p.x), turns(p.z, math.hypot(p.x, p.y) - 1.0)
