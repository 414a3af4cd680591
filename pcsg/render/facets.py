"""Microfacets: the formulas of rough surfaces."""

from __future__ import annotations

import math

from pcsg.jit import njit
from pcsg.vec import Vec3, dot, normalize

MIN_ALPHA = 1e-4
"""Least width of a gloss: a mirror, sharper than any picture shows."""


@njit
def schlick(low: float, high: float, cosine: float) -> float:
    """Return the mirrored share (Schlick 1994)."""
    return low + (high - low) * (1.0 - min(max(cosine, 0.0), 1.0)) ** 5


@njit
def fresnel(cosine: float, eta: float) -> float:
    """Return the mirrored share of unpolarised light between dielectrics; 1 if all of it is."""
    squared = 1.0 - (1.0 - cosine * cosine) / (eta * eta)
    if squared <= 0.0:
        return 1.0
    beyond = math.sqrt(squared)
    parallel = (eta * cosine - beyond) / (eta * cosine + beyond)
    perpendicular = (cosine - eta * beyond) / (cosine + eta * beyond)
    return 0.5 * (parallel * parallel + perpendicular * perpendicular)


@njit
def ggx(nh: float, squared: float) -> float:
    """Return the density of normals."""
    slope = nh * nh * (squared - 1.0) + 1.0
    return squared / (math.pi * slope * slope)


@njit
def reach(cosine: float, squared: float) -> float:
    """Return cosine times (1 + 2 Lambda), of Smith's masking."""
    return math.sqrt(squared + (1.0 - squared) * cosine * cosine)


@njit
def visible_normal(v: Vec3, alpha: float, u: float, turn: float) -> Vec3:
    """Return a normal as seen from v: a point of a cap of the sphere (Dupuy and Benyoub 2023)."""
    s = normalize(Vec3(alpha * v.x, alpha * v.y, v.z))
    z = (1.0 - u) * (1.0 + s.z) - s.z
    radius = math.sqrt(max(1.0 - z * z, 0.0))
    x = radius * math.cos(2.0 * math.pi * turn) + s.x
    y = radius * math.sin(2.0 * math.pi * turn) + s.y
    return normalize(Vec3(alpha * x, alpha * y, max(z + s.z, 1e-12)))


@njit
def refract(v: Vec3, h: Vec3, eta: float) -> Vec3:
    """Return where a ray towards v comes from behind a facet, zero if from nowhere."""
    c = dot(v, h)
    squared = 1.0 - (1.0 - c * c) / (eta * eta)
    if squared <= 0.0:
        return Vec3(0.0, 0.0, 0.0)
    k = c / eta - math.sqrt(squared)
    return Vec3(k * h.x - v.x / eta, k * h.y - v.y / eta, k * h.z - v.z / eta)
