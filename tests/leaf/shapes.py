"""What each solid is, said a second time in NumPy: implicit functions and extreme points.

Independent of the kernels: a signed function that is negative inside, about as steep as the
distance, and points among which the farthest in any direction is found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hypothesis import strategies as st

Args = Sequence[float]
Points = Any

ANGLES = np.linspace(0.0, 2.0 * np.pi, 181)


def rho(p: Points) -> Any:
    return np.hypot(p[..., 0], p[..., 1])


def circle(radius: float, z: float) -> Points:
    return np.stack(
        [radius * np.cos(ANGLES), radius * np.sin(ANGLES), np.full_like(ANGLES, z)], axis=-1
    )


def sphere_points(args: Args) -> Points:
    z = np.sin(np.linspace(-np.pi / 2.0, np.pi / 2.0, 91))
    return np.concatenate([circle(np.sqrt(1.0 - h * h), h) for h in z])


def torus_points(args: Args) -> Points:
    r = args[0]
    return np.concatenate([circle(1.0 + r * np.cos(v), r * np.sin(v)) for v in ANGLES])


TETRAHEDRON = np.array([[1, 1, 1], [-1, -1, 1], [1, -1, -1], [-1, 1, -1]], dtype=float)


def tetrahedron(p: Points, args: Args) -> Any:
    distances = []
    for k in range(4):
        a, b, c = np.delete(TETRAHEDRON, k, axis=0)
        n = np.cross(b - a, c - a)
        n *= -np.sign(n @ (TETRAHEDRON[k] - a)) / np.linalg.norm(n)
        distances.append((p - a) @ n)
    return np.max(distances, axis=0)


def cone(p: Points, args: Args) -> Any:
    r, z = args[0], p[..., 2]
    side = (rho(p) - (1.0 + (r - 1.0) * z)) / np.hypot(1.0, r - 1.0)
    return np.maximum(side, np.abs(z - 0.5) - 0.5)


def capsule(p: Points, args: Args) -> Any:
    """Distance of the hull of two balls: the farthest that a ball between them lets a point be."""
    r = args[0]
    fall = np.clip(r - 1.0, -1.0, 1.0)
    across, z = rho(p), p[..., 2]
    # The ball that a point is nearest to lies where the line to it meets the side at a right angle.
    slope = np.sqrt(max(0.0, 1.0 - fall * fall))
    along = np.where(
        slope > 0.0, z + across * fall / max(slope, 1e-300), np.where(fall > 0.0, 1, 0)
    )
    h = np.clip(along, 0.0, 1.0)
    return np.hypot(across, z - h) - (1.0 + (r - 1.0) * h)


def ball_points(height: float, radius: float) -> Points:
    return radius * sphere_points(()) + np.array([0.0, 0.0, height])


def infcone(p: Points, args: Args) -> Any:
    r, z = args[0], p[..., 2]
    radius = 1.0 + (r - 1.0) * z
    side = (rho(p) - radius) / np.hypot(1.0, r - 1.0)
    # Behind the apex it is the apex that is nearest.
    return np.maximum(side, np.where(radius < 0.0, -radius / np.hypot(1.0, r - 1.0), -np.inf))


def superellipsoid(p: Points, args: Args) -> Any:
    """The norm less 1, by its steepness: about the distance."""
    a, b = 2.0 / args[0], 2.0 / args[1]
    x, y, z = np.abs(np.moveaxis(np.asarray(p, dtype=float), -1, 0))
    # With the largest taken out, so that powers stay in range.
    big = np.maximum(np.maximum(x, y), 1e-300)
    ring = big * ((x / big) ** a + (y / big) ** a) ** (1.0 / a)
    big = np.maximum(np.maximum(ring, z), 1e-300)
    norm = np.maximum(big * ((ring / big) ** b + (z / big) ** b) ** (1.0 / b), 1e-300)
    by_ring, by_z = (ring / norm) ** (b - 1.0), (z / norm) ** (b - 1.0)
    safe = np.maximum(ring, 1e-300)
    by_x, by_y = (x / safe) ** (a - 1.0), (y / safe) ** (a - 1.0)
    return (norm - 1.0) / np.maximum(np.hypot(by_ring * np.hypot(by_x, by_y), by_z), 0.5)


def superellipsoid_points(args: Args) -> Points:
    def power(x: Any, e: float) -> Any:
        return np.sign(x) * np.abs(x) ** e

    # The farthest in a direction is where this ratio is that of its components, to a power.
    ratios = np.linspace(-9.0, 9.0, 181)
    u, v = (
        np.concatenate([[0.0], np.arctan(np.exp(ratios / (2.0 - min(e, 1.95)))), [np.pi / 2.0]])
        for e in args
    )
    cu, su = power(np.cos(u), args[0]), power(np.sin(u), args[0])
    cv, sv = power(np.cos(v), args[1]), power(np.sin(v), args[1])
    eighth = np.stack(
        [np.outer(cv, cu), np.outer(cv, su), np.outer(sv, np.ones_like(u))], axis=-1
    ).reshape(-1, 3)
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    return (eighth[None] * signs[:, None]).reshape(-1, 3)


@dataclass(frozen=True)
class Shape:
    """A second description of a solid.

    Attributes
    ----------
    implicit
        Negative inside, positive outside.
    extremes
        Points of the solid, with one close to the farthest in every direction; None if unbounded.
    args
        Legal arguments.
    reach
        A ball about the origin that contains what matters.
    """

    implicit: Callable[[Points, Args], Any]
    extremes: Callable[[Args], Points] | None
    args: st.SearchStrategy[tuple[float, ...]] = field(default_factory=lambda: st.just(()))
    reach: Callable[[Args], float] = lambda args: 2.0


RADII = st.one_of(st.sampled_from([0.0, 0.5, 1.0, 2.0]), st.floats(0.0, 3.0))
TUBES = st.one_of(
    st.sampled_from([1.0, 0.5, 0.25, 1e-3]), st.floats(0.01, 1.0), st.floats(1e-6, 0.01)
)

ROUNDNESS = st.one_of(st.sampled_from([1.0, 2.0, 0.5, 0.1]), st.floats(0.05, 2.0))

SHAPES: dict[str, Shape] = {
    "sphere": Shape(lambda p, a: np.linalg.norm(p, axis=-1) - 1.0, sphere_points),
    "cylinder": Shape(
        lambda p, a: np.maximum(rho(p) - 1.0, np.abs(p[..., 2] - 0.5) - 0.5),
        lambda a: np.concatenate([circle(1.0, 0.0), circle(1.0, 1.0)]),
    ),
    "cone": Shape(
        cone,
        lambda a: np.concatenate([circle(1.0, 0.0), circle(a[0], 1.0)]),
        RADII.map(lambda r: (r,)),
        lambda a: 2.0 + a[0],
    ),
    "box": Shape(
        lambda p, a: np.max(np.abs(p), axis=-1) - 1.0,
        lambda a: np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T,
    ),
    "tetrahedron": Shape(tetrahedron, lambda a: TETRAHEDRON),
    "torus": Shape(
        lambda p, a: np.hypot(rho(p) - 1.0, p[..., 2]) - a[0],
        torus_points,
        TUBES.map(lambda r: (r,)),
    ),
    "halfspace": Shape(lambda p, a: p[..., 2], None),
    "capsule": Shape(
        capsule,
        lambda a: np.concatenate([ball_points(0.0, 1.0), ball_points(1.0, a[0])]),
        RADII.map(lambda r: (r,)),
        lambda a: 3.0 + 2.0 * a[0],
    ),
    "superellipsoid": Shape(superellipsoid, superellipsoid_points, st.tuples(ROUNDNESS, ROUNDNESS)),
    "infcylinder": Shape(lambda p, a: rho(p) - 1.0, None, reach=lambda a: 4.0),
    "infcone": Shape(
        infcone, None, st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0]).map(lambda r: (r,)), lambda a: 4.0
    ),
    "empty": Shape(lambda p, a: np.full(p.shape[:-1], np.inf), None),
}


def box_distance(p: Points, lower: Args, upper: Args) -> Any:
    """About the signed distance of a box: exact inside and on the faces."""
    return np.max(np.maximum(np.array(lower) - p, p - np.array(upper)), axis=-1)


def bracket(p: Points, args: Args) -> Any:
    """Two boxes that share a face, as an L; inside also near the place where they meet."""
    foot = box_distance(p, (-1.0, -1.0, -1.0), (1.0, 1.0, 0.0))
    back = box_distance(p, (-1.0, -1.0, -1.0), (0.0, 1.0, 1.0))
    return np.minimum(foot, back)


_CUBE = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
_CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
_PROFILE = [(-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0)]
_BRACKET = [(x, y, z) for y in (-1.0, 1.0) for x, z in _PROFILE]
_BRACKET_FACES = [
    tuple(range(6)),
    tuple(range(11, 5, -1)),
    *((k + 6, (k + 1) % 6 + 6, (k + 1) % 6, k) for k in range(6)),
]
_OCTAHEDRON = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
_OCTAHEDRON_FACES = [
    (i, j, k) if (i + j + k) % 2 == 0 else (i, k, j) for i in (0, 1) for j in (2, 3) for k in (4, 5)
]


def _points(vertices: Any) -> Callable[[Args], Points]:
    return lambda args: np.array(vertices, dtype=float)


MESHES: dict[str, tuple[Any, Any, Shape]] = {
    "cube": (
        _CUBE,
        _CUBE_FACES,
        Shape(lambda p, a: np.max(np.abs(p), axis=-1) - 1.0, _points(_CUBE)),
    ),
    "inside-out": (
        _CUBE,
        [face[::-1] for face in _CUBE_FACES],
        Shape(lambda p, a: np.max(np.abs(p), axis=-1) - 1.0, _points(_CUBE)),
    ),
    "octahedron": (
        _OCTAHEDRON,
        _OCTAHEDRON_FACES,
        Shape(lambda p, a: (np.abs(p).sum(axis=-1) - 1.0) / np.sqrt(3.0), _points(_OCTAHEDRON)),
    ),
    "bracket": (_BRACKET, _BRACKET_FACES, Shape(bracket, _points(_BRACKET))),
}
"""Closed meshes: vertices, faces, and the second description."""
