"""Surfaces of primitives in numbers: area vectors, volumes, and points at random.

A flat face is one vector, normal times area. Round surfaces are many: products of Gauss-Legendre
and equidistant nodes, whose sums of lengths under any linear map converge to about 1e-9.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.leaf.mesh import MeshModel
from pcsg.leaf.polyhedra import CORNERS
from pcsg.leaf.registry import Constant, Solid

Floats = NDArray[np.float64]

_AROUND, _ALONG = 96, 48
"""Nodes about an axis, and along it."""


class Faces(NamedTuple):
    """The surface of a primitive in its own frame.

    Attributes
    ----------
    vectors : float64 (K, 3)
        Normals times areas; their lengths add up to the area. Of sheets one side counts.
    volume : float
        0 for sheets.
    """

    vectors: Floats
    volume: float

    @property
    def area(self) -> float:
        """The area."""
        return float(np.linalg.norm(self.vectors, axis=1).sum())


class Draw(NamedTuple):
    """Points at random on a surface, uniformly by area.

    Attributes
    ----------
    points, normals : float64 (N, 3)
    """

    points: Floats
    normals: Floats


def faces_of(solid: type[Solid], constants: Sequence[Constant], args: tuple[float, ...]) -> Faces:
    """Return the surface of a primitive.

    Raises
    ------
    UsageError
        It has no surface whose area is known: a half-space, or a blob.
    """
    if constants and isinstance(constants[0], MeshModel):
        return _faces_of_mesh(constants[0])
    return _faces(solid.name, args)


@lru_cache(maxsize=256)
def _faces(name: str, args: tuple[float, ...]) -> Faces:
    up = np.array([[0.0, 0.0, 1.0]])
    if name == "disc":
        return Faces(math.pi * up, 0.0)
    if name == "rectangle":
        return Faces(4.0 * up, 0.0)
    if name in ("tri1", "tri2"):
        return Faces(0.5 * up, 0.0)
    if name == "box":
        return Faces(4.0 * np.vstack([np.eye(3), -np.eye(3)]), 8.0)
    if name == "tetrahedron":
        return Faces(-2.0 * np.array(CORNERS), 8.0 / 3.0)
    if name == "sphere":
        return Faces(_ball(), 4.0 * math.pi / 3.0)
    if name in ("cylinder", "cone"):
        return _frustum(args[0] if name == "cone" else 1.0)
    if name == "torus":
        return _torus(args[0])
    if name == "empty":
        return Faces(np.zeros((0, 3)), 0.0)
    raise UsageError(f"the area of a `{name}` is not known")


def _around() -> tuple[Floats, Floats]:
    angle = 2.0 * math.pi * (np.arange(_AROUND) + 0.5) / _AROUND
    return np.cos(angle), np.sin(angle)


def _ball() -> Floats:
    """Return vectors of the unit sphere: equal heights have equal areas."""
    z, weights = np.polynomial.legendre.leggauss(_ALONG)
    cos, sin = _around()
    share = 2.0 * math.pi * weights / _AROUND
    r = np.sqrt(1.0 - z * z) * share
    parts = np.multiply.outer(r, cos), np.multiply.outer(r, sin)
    up = np.broadcast_to((z * share)[:, None], parts[0].shape)
    return np.stack([*parts, up], axis=-1).reshape(-1, 3)


def _frustum(r: float) -> Faces:
    """Return the surface of a cone from radius 1 at z = 0 to r at z = 1, with its ends."""
    cos, sin = _around()
    area = math.pi * (1.0 + r) / _AROUND
    side = np.stack([area * cos, area * sin, np.full(_AROUND, area * (1.0 - r))], axis=-1)
    ends = np.array([[0.0, 0.0, -math.pi], [0.0, 0.0, math.pi * r * r]])
    return Faces(np.vstack([side, ends]), math.pi * (1.0 + r + r * r) / 3.0)


def _torus(r: float) -> Faces:
    cos, sin = _around()
    angle = 2.0 * math.pi * (np.arange(_AROUND) + 0.5) / _AROUND
    share = (2.0 * math.pi / _AROUND) ** 2 * r * (1.0 + r * np.cos(angle))
    out, up = np.cos(angle) * share, np.sin(angle) * share
    parts = np.multiply.outer(out, cos), np.multiply.outer(out, sin)
    vectors = np.stack([*parts, np.broadcast_to(up[:, None], parts[0].shape)], axis=-1)
    return Faces(vectors.reshape(-1, 3), 2.0 * math.pi**2 * r * r)


def _corners_of(constant: Any) -> Floats:
    """Return the corners of a mesh's triangles, float64 (T, 3, 3)."""
    corners: Floats = constant.polygons.vertices[constant.triangles]
    return corners


def _faces_of_mesh(constant: Constant) -> Faces:
    a, b, c = np.moveaxis(_corners_of(constant), 1, 0)
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    closed = bool(constant.closed)  # type: ignore[attr-defined]
    return Faces(0.5 * np.cross(b - a, c - a), abs(volume) if closed else 0.0)


def draw_points(
    solid: type[Solid], constants: Sequence[Constant], args: tuple[float, ...], u: Floats
) -> Draw:
    """Return points of a primitive's surface, uniform by area in its own frame.

    Parameters
    ----------
    u : float64 (N, 3)
        Uniform in [0, 1).

    Raises
    ------
    UsageError
        It is not known how.
    """
    name = solid.name
    if constants and isinstance(constants[0], MeshModel):
        return _draw_triangles(_corners_of(constants[0]), u)
    if name == "tetrahedron":
        c = np.array(CORNERS)
        faces = [[c[j] for j in range(4) if j != k] for k in range(4)]
        drawn = _draw_triangles(np.array(faces), u)
        return Draw(drawn.points, _outward(drawn))
    if name == "box":
        return _draw_box(u)
    if name in ("disc", "rectangle", "tri1", "tri2"):
        return _draw_sheet(name, u)
    if name == "sphere":
        z = 2.0 * u[:, 0] - 1.0
        points = _round(np.sqrt(np.maximum(0.0, 1.0 - z * z)), z, u[:, 1])
        return Draw(points, points)
    if name in ("cylinder", "cone"):
        return _draw_frustum(args[0] if name == "cone" else 1.0, u)
    if name == "torus":
        return _draw_torus(args[0], u)
    raise UsageError(f"points on a `{name}` cannot be drawn")


def _round(r: Floats, z: Floats, turn: Floats) -> Floats:
    angle = 2.0 * math.pi * turn
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)


def _outward(drawn: Draw) -> Floats:
    """Return normals that point away from the origin."""
    along = np.einsum("ij,ij->i", drawn.points, drawn.normals)
    return np.where(along[:, None] < 0.0, -drawn.normals, drawn.normals)


def _draw_triangles(corners: Floats, u: Floats) -> Draw:
    a, b, c = np.moveaxis(corners, 1, 0)
    vectors = np.cross(b - a, c - a)
    areas = np.linalg.norm(vectors, axis=1)
    shares = np.cumsum(areas) / areas.sum()
    k = np.minimum(np.searchsorted(shares, u[:, 0], side="right"), len(areas) - 1)
    s, t = np.sqrt(u[:, 1])[:, None], u[:, 2][:, None]
    points = a[k] * (1.0 - s) + b[k] * (s * (1.0 - t)) + c[k] * (s * t)
    return Draw(points, vectors[k] / areas[k][:, None])


def _draw_box(u: Floats) -> Draw:
    face = np.minimum((6.0 * u[:, 0]).astype(np.int64), 5)
    axis, sign = face // 2, np.where(face % 2 == 0, 1.0, -1.0)
    rows = np.arange(len(u))
    points, normals = np.zeros((len(u), 3)), np.zeros((len(u), 3))
    points[rows, axis] = normals[rows, axis] = sign
    points[rows, (axis + 1) % 3] = 2.0 * u[:, 1] - 1.0
    points[rows, (axis + 2) % 3] = 2.0 * u[:, 2] - 1.0
    return Draw(points, normals)


def _draw_sheet(name: str, u: Floats) -> Draw:
    n = len(u)
    normals = np.tile([0.0, 0.0, 1.0], (n, 1))
    if name == "disc":
        return Draw(_round(np.sqrt(u[:, 0]), np.zeros(n), u[:, 1]), normals)
    if name == "rectangle":
        return Draw(np.stack([2 * u[:, 0] - 1, 2 * u[:, 1] - 1, np.zeros(n)], axis=-1), normals)
    s, t = np.sqrt(u[:, 0]), u[:, 1]
    points = np.stack([s * (1.0 - t), s * t, np.zeros(n)], axis=-1)
    return Draw(points if name == "tri1" else -points, normals)


def _draw_frustum(r: float, u: Floats) -> Draw:
    side, top = (1.0 + r) * math.sqrt(1.0 + (1.0 - r) ** 2), r * r
    total = side + 1.0 + top
    where = u[:, 0] * total
    # Along the side, the share below z grows as the integral of the radius.
    s = u[:, 1]
    if r == 1.0:
        z = s
    else:
        z = (1.0 - np.sqrt(np.maximum(0.0, 1.0 - s * (1.0 - r * r)))) / (1.0 - r)
    points = _round(1.0 - (1.0 - r) * z, z, u[:, 2])
    normals = _round(np.ones(len(u)), np.full(len(u), 1.0 - r), u[:, 2])
    normals /= math.sqrt(1.0 + (1.0 - r) ** 2)
    at_top = where >= side + 1.0
    for ends, height, radius in ((where >= side, 0.0, 1.0), (at_top, 1.0, r)):
        flat = _round(radius * np.sqrt(s), np.full(len(u), height), u[:, 2])
        points[ends] = flat[ends]
        normals[ends] = (0.0, 0.0, 1.0 if height else -1.0)
    return Draw(points, normals)


def _draw_torus(r: float, u: Floats) -> Draw:
    # The angle about the tube has the density 1 + r cos: halving finds where its integral is u.
    wanted = 2.0 * math.pi * u[:, 0]
    low, high = np.zeros(len(u)), np.full(len(u), 2.0 * math.pi)
    for _ in range(53):
        angle = 0.5 * (low + high)
        below = angle + r * np.sin(angle) < wanted
        low, high = np.where(below, angle, low), np.where(below, high, angle)
    normals = _round(np.cos(low), np.sin(low), u[:, 1])
    ring = _round(np.ones(len(u)), np.zeros(len(u)), u[:, 1])
    return Draw(ring + r * normals, normals)
