"""Canonical solids. Size and place come from transformation nodes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pcsg.leaf.registry import UNIT_BOX, Pool, Solid, leaf
from pcsg.vec import Ray, Vec3


@leaf
class Sphere(Solid):
    """Unit ball about the origin: x2 + y2 + z2 <= 1."""

    bounds = UNIT_BOX

    @classmethod
    def support(cls, direction: Vec3, args: Sequence[float]) -> float:
        return math.hypot(*direction)

    @staticmethod
    def crossings(
        ray: Ray,
        want: int,
        args: NDArray[np.float64],
        at: int,
        pool: Pool,
        t: NDArray[np.float64],
        n: int,
    ) -> int:
        a = ray.dx * ray.dx + ray.dy * ray.dy + ray.dz * ray.dz
        # The chord's half length from the distance of the origin's foot, which keeps its digits
        # where the origin is far away.
        tm = -(ray.ox * ray.dx + ray.oy * ray.dy + ray.oz * ray.dz) / a
        fx, fy, fz = ray.ox + tm * ray.dx, ray.oy + tm * ray.dy, ray.oz + tm * ray.dz
        q = 1.0 - (fx * fx + fy * fy + fz * fz)
        if not q > 0.0:
            return n
        h = math.sqrt(q / a)
        t[n], t[n + 1] = tm - h, tm + h
        return n + 2

    @staticmethod
    def normal(p: Vec3, args: NDArray[np.float64], at: int, pool: Pool) -> Vec3:
        return p

    @staticmethod
    def inside(p: Vec3, args: NDArray[np.float64], at: int, pool: Pool) -> bool:
        return p.x * p.x + p.y * p.y + p.z * p.z <= 1.0

    @staticmethod
    def uv(p: Vec3, args: NDArray[np.float64], at: int, pool: Pool) -> tuple[float, float]:
        u = math.atan2(p.y, p.x) / (2.0 * math.pi)
        return u - np.floor(u), 0.5 + math.asin(min(1.0, max(-1.0, p.z))) / math.pi
