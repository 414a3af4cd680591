"""Light from solids that shine: which way to send shadow rays.

A shadow ray goes somewhere into one of the balls and boxes that cover what shines, chosen by how
bright it seems from here; what it brings is the emission of what it meets. That needs no points on
surfaces, so that solids of every kind shine, carved, scaled and overlapping ones too, and whatever
else is in the way casts a shadow. The density of a direction is that of all covers which lie there.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pcsg.graph.shining import AXES, INVERSE, POWER, RADIUS, VOLUME
from pcsg.jit import njit
from pcsg.render.tracer import Floats
from pcsg.vec import Vec3, dot, normalize


class Aim(NamedTuple):
    """Directions for shadow rays.

    Attributes
    ----------
    direction
        (N, 3) unit.
    density
        (N,) per solid angle.
    """

    direction: Floats
    density: Floats


class Emitters:
    """What shines in a scene.

    Parameters
    ----------
    covers
        (K, `COLUMNS`) of `pcsg.graph.shining`, K > 0.
    """

    def __init__(self, covers: Floats) -> None:
        self.covers = np.ascontiguousarray(covers, dtype=np.float64)

    def aim(self, position: Floats, pairs: Floats) -> Aim:
        """Choose a direction at each of (N, 3) positions by (N, 2) numbers in [0, 1)."""
        n = len(position)
        found = Aim(np.empty((n, 3)), np.empty(n))
        _aim(self.covers, np.ascontiguousarray(position), pairs, found.direction, found.density)
        return found

    def density(self, position: Floats, towards: Floats) -> Floats:
        """Return (N,) with which `aim` chooses unit directions (N, 3)."""
        density = np.empty(len(position))
        _fill_density(
            self.covers, np.ascontiguousarray(position), np.ascontiguousarray(towards), density
        )
        return density

    def estimate(self, position: Floats) -> Floats:
        """Return (N,) about how bright they are at positions (N, 3)."""
        bright = np.empty(len(position))
        _estimate(self.covers, np.ascontiguousarray(position), bright)
        return bright


@njit
def _brightness(covers: Floats, k: int, p: Vec3) -> float:
    """Return about how bright what is covered seems."""
    x, y, z = covers[k, 0] - p.x, covers[k, 1] - p.y, covers[k, 2] - p.z
    return float(covers[k, POWER] / max(x * x + y * y + z * z, covers[k, RADIUS] ** 2))


@njit
def _cap(squared: float, radius: float) -> float:
    """Return 1 - cos of the half angle of a ball, 2 from inside it."""
    sine = radius * radius / max(squared, 1e-300)
    if sine >= 1.0:
        return 2.0
    # sin^2 / (1 + cos) is 1 - cos with all digits.
    return sine / (1.0 + math.sqrt(1.0 - sine))


@njit
def _inside(covers: Floats, k: int, c: Vec3, d: Vec3) -> tuple[float, float]:
    """Return where a ray from -c, as the box's centre sees it, enters the box and leaves it."""
    near, far = 0.0, math.inf
    for axis in range(3):
        row = Vec3(
            covers[k, INVERSE + 3 * axis],
            covers[k, INVERSE + 3 * axis + 1],
            covers[k, INVERSE + 3 * axis + 2],
        )
        start, slope = -dot(row, c), dot(row, d)
        if slope == 0.0:
            if abs(start) > 1.0:
                return 1.0, 0.0
            continue
        one, other = (-1.0 - start) / slope, (1.0 - start) / slope
        near, far = max(near, min(one, other)), min(far, max(one, other))
    return near, far


@njit
def _density_in(covers: Floats, k: int, c: Vec3, d: Vec3) -> float:
    """Return the density of a direction within a cover; 0 where it does not lie.

    Even over the part of a ball that is seen, or over the points of a box: along a ray from r to s
    these have the density (s^3 - r^3) / 3 per solid angle.
    """
    squared = dot(c, c)
    cap = _cap(squared, covers[k, RADIUS])
    if cap < 2.0:
        along = dot(c, d)
        aside = Vec3(c.x - along * d.x, c.y - along * d.y, c.z - along * d.z)
        if along < 0.0 or dot(aside, aside) > covers[k, RADIUS] ** 2:
            return 0.0
    if covers[k, VOLUME] > 0.0:
        near, far = _inside(covers, k, c, d)
        if far <= near:
            return 0.0
        cubes = (far - near) * (far * far + far * near + near * near)
        return float(cubes / (3.0 * covers[k, VOLUME]))
    return float(1.0 / (2.0 * math.pi * cap))


@njit
def _density_at(covers: Floats, p: Vec3, d: Vec3) -> float:
    """Return the density of a direction: of every cover that lies there, by its chance."""
    total, found = 0.0, 0.0
    for k in range(len(covers)):
        bright = _brightness(covers, k, p)
        total += bright
        c = Vec3(covers[k, 0] - p.x, covers[k, 1] - p.y, covers[k, 2] - p.z)
        found += bright * _density_in(covers, k, c, d)
    return found / total


@njit
def _into_ball(c: Vec3, radius: float, u: float, turn: float) -> Vec3:
    """Return a direction into the ball about c, from anywhere in it if the origin is."""
    squared = dot(c, c)
    less = u * _cap(squared, radius)
    # From its middle, any axis will do.
    n = Vec3(0.0, 0.0, 1.0)
    if squared > 0.0:
        length = math.sqrt(squared)
        n = Vec3(c.x / length, c.y / length, c.z / length)
    # The frame of Duff et al. 2017 has no singular direction.
    sign = math.copysign(1.0, n.z)
    a = -1.0 / (sign + n.z)
    b = n.x * n.y * a
    aside = math.sqrt(max(less * (2.0 - less), 0.0))
    x, y = aside * math.cos(2.0 * math.pi * turn), aside * math.sin(2.0 * math.pi * turn)
    z = 1.0 - less
    return Vec3(
        x * (1.0 + sign * n.x * n.x * a) + y * b + z * n.x,
        x * sign * b + y * (sign + n.y * n.y * a) + z * n.y,
        -x * sign * n.x - y * n.y + z * n.z,
    )


@njit
def _into_box(covers: Floats, k: int, c: Vec3, u: float, v: float) -> Vec3:
    """Return the direction to a point of a box about c."""
    # The third number comes from low digits of the second, which are as good as any.
    w = v * 65536.0
    w -= math.floor(w)
    u, v, w = 2.0 * u - 1.0, 2.0 * v - 1.0, 2.0 * w - 1.0
    at = AXES
    x = c.x + u * covers[k, at] + v * covers[k, at + 3] + w * covers[k, at + 6]
    y = c.y + u * covers[k, at + 1] + v * covers[k, at + 4] + w * covers[k, at + 7]
    z = c.z + u * covers[k, at + 2] + v * covers[k, at + 5] + w * covers[k, at + 8]
    if x == 0.0 and y == 0.0 and z == 0.0:
        return Vec3(0.0, 0.0, 1.0)
    return normalize(Vec3(x, y, z))


@njit(entry=True)
def _aim(
    covers: Floats, positions: Floats, pairs: Floats, directions: Floats, densities: Floats
) -> None:
    for i in range(len(positions)):
        p = Vec3(positions[i, 0], positions[i, 1], positions[i, 2])
        total = 0.0
        for k in range(len(covers)):
            total += _brightness(covers, k, p)
        # The number that chooses the cover is stretched and serves again.
        left = pairs[i, 0] * total
        chosen = len(covers) - 1
        for k in range(len(covers)):
            bright = _brightness(covers, k, p)
            if left < bright:
                chosen = k
                break
            left -= bright
        u = min(max(left / _brightness(covers, chosen, p), 0.0), 1.0)
        c = Vec3(covers[chosen, 0] - p.x, covers[chosen, 1] - p.y, covers[chosen, 2] - p.z)
        if covers[chosen, VOLUME] > 0.0:
            d = _into_box(covers, chosen, c, u, pairs[i, 1])
        else:
            d = _into_ball(c, covers[chosen, RADIUS], u, pairs[i, 1])
        directions[i, 0], directions[i, 1], directions[i, 2] = d.x, d.y, d.z
        densities[i] = _density_at(covers, p, d)


@njit(entry=True)
def _fill_density(covers: Floats, positions: Floats, towards: Floats, densities: Floats) -> None:
    for i in range(len(positions)):
        p = Vec3(positions[i, 0], positions[i, 1], positions[i, 2])
        d = Vec3(towards[i, 0], towards[i, 1], towards[i, 2])
        densities[i] = _density_at(covers, p, d)


@njit(entry=True)
def _estimate(covers: Floats, positions: Floats, bright: Floats) -> None:
    for i in range(len(positions)):
        p = Vec3(positions[i, 0], positions[i, 1], positions[i, 2])
        bright[i] = 0.0
        for k in range(len(covers)):
            bright[i] += _brightness(covers, k, p)


def make_emitters(covers: Any) -> Emitters | None:
    """Return what shines; None for nothing."""
    return Emitters(covers) if len(covers) else None
