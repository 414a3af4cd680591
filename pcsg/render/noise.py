"""Noise of space: smooth heights, and distances to points at random."""

from __future__ import annotations

import math

from pcsg.jit import njit
from pcsg.render.tracer import Floats


@njit
def _gradient(ix: int, iy: int, iz: int, fx: float, fy: float, fz: float) -> float:
    """Return the height at f of the slope that belongs to a lattice point (Perlin 2002)."""
    h = (ix * 73856093) ^ (iy * 19349663) ^ (iz * 83492791)
    h = (h ^ (h >> 13)) * 1274126177
    h = (h ^ (h >> 16)) & 15
    u = fx if h < 8 else fy
    v = fy if h < 4 else (fx if h == 12 or h == 14 else fz)
    return (u if h & 1 == 0 else -u) + (v if h & 2 == 0 else -v)


@njit
def noise(x: float, y: float, z: float) -> float:
    """Return gradient noise in about [-1, 1] (Perlin 2002)."""
    bx, by, bz = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - bx, y - by, z - bz
    ix, iy, iz = int(bx), int(by), int(bz)
    u = fx * fx * fx * (fx * (fx * 6.0 - 15.0) + 10.0)
    v = fy * fy * fy * (fy * (fy * 6.0 - 15.0) + 10.0)
    w = fz * fz * fz * (fz * (fz * 6.0 - 15.0) + 10.0)
    total = 0.0
    for k in range(8):
        i, j, m = k & 1, (k >> 1) & 1, k >> 2
        weight = (u if i else 1.0 - u) * (v if j else 1.0 - v) * (w if m else 1.0 - w)
        total += weight * _gradient(ix + i, iy + j, iz + m, fx - i, fy - j, fz - m)
    return total


@njit
def fractal_noise(x: float, y: float, z: float, octaves: int) -> float:
    """Return noise summed over octaves, each of half the size and height of the one before."""
    total, height = 0.0, 0.5
    for _ in range(octaves):
        total += height * noise(x, y, z)
        # Shifts keep the lattices of the octaves from meeting at the origin.
        x, y, z = 2.03 * x + 17.17, 2.03 * y + 5.31, 2.03 * z + 11.73
        height *= 0.5
    return total


@njit
def cell(x: float, y: float, z: float) -> float:
    """Return the distance to the nearest of points at random, one in every unit cube; at most 1.

    (Worley 1996.)
    """
    bx, by, bz = math.floor(x), math.floor(y), math.floor(z)
    ix, iy, iz = int(bx), int(by), int(bz)
    least = 1.0
    for k in range(27):
        jx, jy, jz = ix + k % 3 - 1, iy + k // 3 % 3 - 1, iz + k // 9 - 1
        h = (jx * 73856093) ^ (jy * 19349663) ^ (jz * 83492791)
        h = (h ^ (h >> 13)) * 1274126177
        h = (h ^ (h >> 16)) * 668265263
        h = h ^ (h >> 15)
        dx = jx + (h & 1023) / 1024.0 - x
        dy = jy + ((h >> 10) & 1023) / 1024.0 - y
        dz = jz + ((h >> 20) & 1023) / 1024.0 - z
        least = min(least, dx * dx + dy * dy + dz * dz)
    return math.sqrt(least)


@njit(entry=True)
def fill_cells(points: Floats, values: Floats) -> None:
    """Write `cell` of points (N, 3) to values (N,)."""
    for k in range(len(points)):
        values[k] = cell(points[k, 0], points[k, 1], points[k, 2])


@njit(entry=True)
def stir(points: Floats, reach: Floats) -> None:
    """Move points (N, 3) by noise, about as far as `reach` (N,) says."""
    for k in range(len(points)):
        if reach[k] != 0.0:
            x, y, z = points[k, 0], points[k, 1], points[k, 2]
            points[k, 0] += reach[k] * 2.0 * fractal_noise(x + 31.7, y, z, 4)
            points[k, 1] += reach[k] * 2.0 * fractal_noise(x, y + 47.3, z, 4)
            points[k, 2] += reach[k] * 2.0 * fractal_noise(x, y, z + 59.1, 4)
