"""Light from solids that shine: which way to send shadow rays.

A shadow ray goes somewhere into one of the balls that cover what shines, chosen by how bright it
seems from here; what it brings is the emission of what it meets. That needs no points on surfaces,
so that solids of every kind shine, carved, scaled and overlapping ones too, and whatever else is in
the way casts a shadow. The density of a direction is that of all balls which lie there.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pcsg.jit import njit
from pcsg.render.tracer import Floats
from pcsg.vec import Vec3, dot


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
    balls
        (K, 5) centre, radius and power of each, K > 0.
    """

    def __init__(self, balls: Floats) -> None:
        self.balls = np.ascontiguousarray(balls, dtype=np.float64)

    def aim(self, position: Floats, pairs: Floats) -> Aim:
        """Choose a direction at each of (N, 3) positions by (N, 2) numbers in [0, 1)."""
        n = len(position)
        found = Aim(np.empty((n, 3)), np.empty(n))
        _aim(self.balls, np.ascontiguousarray(position), pairs, found.direction, found.density)
        return found

    def density(self, position: Floats, towards: Floats) -> Floats:
        """Return (N,) with which `aim` chooses unit directions (N, 3)."""
        density = np.empty(len(position))
        _fill_density(
            self.balls, np.ascontiguousarray(position), np.ascontiguousarray(towards), density
        )
        return density

    def estimate(self, position: Floats) -> Floats:
        """Return (N,) about how bright they are at positions (N, 3)."""
        bright = np.empty(len(position))
        _estimate(self.balls, np.ascontiguousarray(position), bright)
        return bright


@njit
def _brightness(balls: Floats, k: int, p: Vec3) -> float:
    """Return about how bright a ball seems."""
    x, y, z = balls[k, 0] - p.x, balls[k, 1] - p.y, balls[k, 2] - p.z
    return float(balls[k, 4] / max(x * x + y * y + z * z, balls[k, 3] * balls[k, 3]))


@njit
def _cap(squared: float, radius: float) -> float:
    """Return 1 - cos of the half angle of a ball, 2 from inside it."""
    sine = radius * radius / max(squared, 1e-300)
    if sine >= 1.0:
        return 2.0
    # sin^2 / (1 + cos) is 1 - cos with all digits.
    return sine / (1.0 + math.sqrt(1.0 - sine))


@njit
def _density_at(balls: Floats, p: Vec3, d: Vec3) -> float:
    """Return the density of a direction: of every ball that lies there, by its chance."""
    total, found = 0.0, 0.0
    for k in range(len(balls)):
        bright = _brightness(balls, k, p)
        total += bright
        c = Vec3(balls[k, 0] - p.x, balls[k, 1] - p.y, balls[k, 2] - p.z)
        squared = dot(c, c)
        cap = _cap(squared, balls[k, 3])
        along = dot(c, d)
        aside = Vec3(c.x - along * d.x, c.y - along * d.y, c.z - along * d.z)
        if cap == 2.0 or (along > 0.0 and dot(aside, aside) <= balls[k, 3] * balls[k, 3]):
            found += bright / (2.0 * math.pi * cap)
    return found / total


@njit(entry=True)
def _aim(
    balls: Floats, positions: Floats, pairs: Floats, directions: Floats, densities: Floats
) -> None:
    for i in range(len(positions)):
        p = Vec3(positions[i, 0], positions[i, 1], positions[i, 2])
        total = 0.0
        for k in range(len(balls)):
            total += _brightness(balls, k, p)
        # The number that chooses the ball is stretched and serves again.
        left = pairs[i, 0] * total
        chosen = len(balls) - 1
        for k in range(len(balls)):
            bright = _brightness(balls, k, p)
            if left < bright:
                chosen = k
                break
            left -= bright
        u = min(max(left / _brightness(balls, chosen, p), 0.0), 1.0)
        c = Vec3(balls[chosen, 0] - p.x, balls[chosen, 1] - p.y, balls[chosen, 2] - p.z)
        squared = dot(c, c)
        less = u * _cap(squared, balls[chosen, 3])
        # The axis; any, from its middle.
        n = Vec3(0.0, 0.0, 1.0)
        if squared > 0.0:
            length = math.sqrt(squared)
            n = Vec3(c.x / length, c.y / length, c.z / length)
        # The frame of Duff et al. 2017 has no singular direction.
        sign = math.copysign(1.0, n.z)
        a = -1.0 / (sign + n.z)
        b = n.x * n.y * a
        radius = math.sqrt(max(less * (2.0 - less), 0.0))
        turn = 2.0 * math.pi * pairs[i, 1]
        x, y, z = radius * math.cos(turn), radius * math.sin(turn), 1.0 - less
        d = Vec3(
            x * (1.0 + sign * n.x * n.x * a) + y * b + z * n.x,
            x * sign * b + y * (sign + n.y * n.y * a) + z * n.y,
            -x * sign * n.x - y * n.y + z * n.z,
        )
        directions[i, 0], directions[i, 1], directions[i, 2] = d.x, d.y, d.z
        densities[i] = _density_at(balls, p, d)


@njit(entry=True)
def _fill_density(balls: Floats, positions: Floats, towards: Floats, densities: Floats) -> None:
    for i in range(len(positions)):
        p = Vec3(positions[i, 0], positions[i, 1], positions[i, 2])
        d = Vec3(towards[i, 0], towards[i, 1], towards[i, 2])
        densities[i] = _density_at(balls, p, d)


@njit(entry=True)
def _estimate(balls: Floats, positions: Floats, bright: Floats) -> None:
    for i in range(len(positions)):
        p = Vec3(positions[i, 0], positions[i, 1], positions[i, 2])
        bright[i] = 0.0
        for k in range(len(balls)):
            bright[i] += _brightness(balls, k, p)


def make_emitters(balls: Any) -> Emitters | None:
    """Return what shines; None for nothing."""
    return Emitters(balls) if len(balls) else None
