"""Points, directions, rays and affine maps as named tuples of floats, and their small kernels.

Tuples stay in registers; arrays of three numbers would be allocated. Names of maps read from
right to left: ``local_from_world`` takes world coordinates to local ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit


class Vec3(NamedTuple):
    """A point or a direction."""

    x: float
    y: float
    z: float


class Ray(NamedTuple):
    """The points ``o + t d`` for t in [tmin, tmax].

    The direction is never renormalised, so t is the same number in every frame.
    """

    ox: float
    oy: float
    oz: float
    dx: float
    dy: float
    dz: float
    tmin: float
    tmax: float


class Affine(NamedTuple):
    """The map ``p -> (m00 p.x + m01 p.y + m02 p.z + m03, ...)``: a row-major 3x4 matrix."""

    m00: float
    m01: float
    m02: float
    m03: float
    m10: float
    m11: float
    m12: float
    m13: float
    m20: float
    m21: float
    m22: float
    m23: float


IDENTITY = Affine(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@njit
def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return the vector product."""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@njit
def dot(a: Vec3, b: Vec3) -> float:
    """Return the scalar product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@njit
def normalize(a: Vec3) -> Vec3:
    """Return the unit vector, exactly also where squares would overflow; zero stays zero."""
    big = max(abs(a.x), abs(a.y), abs(a.z))
    if big == 0.0:
        return a
    x, y, z = a.x / big, a.y / big, a.z / big
    s = 1.0 / math.sqrt(x * x + y * y + z * z)
    return Vec3(x * s, y * s, z * s)


@njit
def transform_point(m: Affine, p: Vec3) -> Vec3:
    """Map a point."""
    return Vec3(
        m.m00 * p.x + m.m01 * p.y + m.m02 * p.z + m.m03,
        m.m10 * p.x + m.m11 * p.y + m.m12 * p.z + m.m13,
        m.m20 * p.x + m.m21 * p.y + m.m22 * p.z + m.m23,
    )


@njit
def transform_vector(m: Affine, v: Vec3) -> Vec3:
    """Map a direction."""
    return Vec3(
        m.m00 * v.x + m.m01 * v.y + m.m02 * v.z,
        m.m10 * v.x + m.m11 * v.y + m.m12 * v.z,
        m.m20 * v.x + m.m21 * v.y + m.m22 * v.z,
    )


@njit
def transform_normal(local_from_world: Affine, n: Vec3) -> Vec3:
    """Map a local normal to the world: the transpose of the map from world to local."""
    m = local_from_world
    return Vec3(
        m.m00 * n.x + m.m10 * n.y + m.m20 * n.z,
        m.m01 * n.x + m.m11 * n.y + m.m21 * n.z,
        m.m02 * n.x + m.m12 * n.y + m.m22 * n.z,
    )


@njit(inline=True)
def transform_ray(m: Affine, r: Ray) -> Ray:
    """Map a ray; t keeps its meaning."""
    return Ray(
        m.m00 * r.ox + m.m01 * r.oy + m.m02 * r.oz + m.m03,
        m.m10 * r.ox + m.m11 * r.oy + m.m12 * r.oz + m.m13,
        m.m20 * r.ox + m.m21 * r.oy + m.m22 * r.oz + m.m23,
        m.m00 * r.dx + m.m01 * r.dy + m.m02 * r.dz,
        m.m10 * r.dx + m.m11 * r.dy + m.m12 * r.dz,
        m.m20 * r.dx + m.m21 * r.dy + m.m22 * r.dz,
        r.tmin,
        r.tmax,
    )


@njit
def compose(a: Affine, b: Affine) -> Affine:
    """Return the map ``p -> a(b(p))``."""
    return Affine(
        a.m00 * b.m00 + a.m01 * b.m10 + a.m02 * b.m20,
        a.m00 * b.m01 + a.m01 * b.m11 + a.m02 * b.m21,
        a.m00 * b.m02 + a.m01 * b.m12 + a.m02 * b.m22,
        a.m00 * b.m03 + a.m01 * b.m13 + a.m02 * b.m23 + a.m03,
        a.m10 * b.m00 + a.m11 * b.m10 + a.m12 * b.m20,
        a.m10 * b.m01 + a.m11 * b.m11 + a.m12 * b.m21,
        a.m10 * b.m02 + a.m11 * b.m12 + a.m12 * b.m22,
        a.m10 * b.m03 + a.m11 * b.m13 + a.m12 * b.m23 + a.m13,
        a.m20 * b.m00 + a.m21 * b.m10 + a.m22 * b.m20,
        a.m20 * b.m01 + a.m21 * b.m11 + a.m22 * b.m21,
        a.m20 * b.m02 + a.m21 * b.m12 + a.m22 * b.m22,
        a.m20 * b.m03 + a.m21 * b.m13 + a.m22 * b.m23 + a.m23,
    )


@njit
def invert(m: Affine) -> tuple[Affine, bool]:
    """Return the inverse map by cofactors, and whether there is one.

    Rows are scaled to one before the determinant is judged, so that a frame that is merely small
    is not taken for a singular one.
    """
    s0 = max(abs(m.m00), abs(m.m01), abs(m.m02))
    s1 = max(abs(m.m10), abs(m.m11), abs(m.m12))
    s2 = max(abs(m.m20), abs(m.m21), abs(m.m22))
    if s0 == 0.0 or s1 == 0.0 or s2 == 0.0:
        return IDENTITY, False
    a, b, c = m.m00 / s0, m.m01 / s0, m.m02 / s0
    d, e, f = m.m10 / s1, m.m11 / s1, m.m12 / s1
    g, h, i = m.m20 / s2, m.m21 / s2, m.m22 / s2
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    det = a * A + b * B + c * C
    if not abs(det) > 1e-14:
        return IDENTITY, False
    k = 1.0 / det
    k0, k1, k2 = k / s0, k / s1, k / s2
    r00, r01, r02 = A * k0, (c * h - b * i) * k1, (b * f - c * e) * k2
    r10, r11, r12 = B * k0, (a * i - c * g) * k1, (c * d - a * f) * k2
    r20, r21, r22 = C * k0, (b * g - a * h) * k1, (a * e - b * d) * k2
    inverse = Affine(
        r00,
        r01,
        r02,
        -(r00 * m.m03 + r01 * m.m13 + r02 * m.m23),
        r10,
        r11,
        r12,
        -(r10 * m.m03 + r11 * m.m13 + r12 * m.m23),
        r20,
        r21,
        r22,
        -(r20 * m.m03 + r21 * m.m13 + r22 * m.m23),
    )
    total = 0.0
    for k in range(12):
        total += abs(inverse[k])
    return inverse, total < math.inf


@njit
def determinant(m: Affine) -> float:
    """Return how volumes change under a map; negative where it mirrors."""
    return (
        m.m00 * (m.m11 * m.m22 - m.m12 * m.m21)
        - m.m01 * (m.m10 * m.m22 - m.m12 * m.m20)
        + m.m02 * (m.m10 * m.m21 - m.m11 * m.m20)
    )


_ONE, _TWO, _THREE, _FOUR, _EIGHT = (np.uint64(k) for k in (1, 2, 3, 4, 8))


@njit(inline=True)
def load_affine(array: NDArray[np.float64], at: int) -> Affine:
    """Read 12 consecutive numbers as a map."""
    # Unsigned, so that no index needs a test of its sign.
    a = np.uint64(at)
    b, c = a + _FOUR, a + _EIGHT
    return Affine(
        array[a],
        array[a + _ONE],
        array[a + _TWO],
        array[a + _THREE],
        array[b],
        array[b + _ONE],
        array[b + _TWO],
        array[b + _THREE],
        array[c],
        array[c + _ONE],
        array[c + _TWO],
        array[c + _THREE],
    )


@njit
def store_affine(array: NDArray[np.float64], at: int, m: Affine) -> None:
    """Write a map to 12 consecutive numbers."""
    for k in range(12):
        array[at + k] = m[k]
