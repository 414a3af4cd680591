"""Primitives as polygons: closed where the primitive is a solid, corners on its surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pcsg.leaf.polyhedra import CORNERS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Outline = tuple[Floats, Ints]
"""Vertices (V, 3) and triangles (T, 3), counterclockwise as seen from outside."""


def outline_of(name: str, args: Sequence[float], segments: int) -> Outline | None:
    """Return a primitive's outline in its own frame; None for one without bounds or with data.

    Parameters
    ----------
    name
        As the language calls it.
    args
        Its arguments.
    segments
        Corners of a circle.
    """
    if name == "sphere":
        heights = np.linspace(-0.5 * math.pi, 0.5 * math.pi, segments // 2 + 1)
        return _revolved([(math.cos(a), math.sin(a)) for a in heights], segments)
    if name == "cylinder":
        return _revolved([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], segments)
    if name == "cone":
        return _revolved([(0.0, 0.0), (1.0, 0.0), (args[0], 1.0), (0.0, 1.0)], segments)
    if name == "torus":
        around = np.linspace(0.0, 2.0 * math.pi, segments // 2 + 1)
        circle = [(1.0 + args[0] * math.cos(a), args[0] * math.sin(a)) for a in around[:-1]]
        return _revolved([*circle, circle[0]], segments)
    if name == "box":
        return _hull(np.array([(x, y, z) for x in _ENDS for y in _ENDS for z in _ENDS]), _BOX)
    if name == "tetrahedron":
        return _hull(np.array(CORNERS), _TETRAHEDRON)
    if name in ("tri1", "tri2"):
        side = 1.0 if name == "tri1" else -1.0
        corners = np.array([(0.0, 0.0, 0.0), (side, 0.0, 0.0), (0.0, side, 0.0)])
        return corners, np.array([[0, 1, 2]])
    if name == "rectangle":
        corners = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
        return corners, np.array([[0, 1, 2], [0, 2, 3]])
    if name == "disc":
        angles = np.arange(segments) * (2.0 * math.pi / segments)
        rim: Floats = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(segments)])
        k = np.arange(1, segments - 1)
        return rim, np.column_stack([np.zeros_like(k), k, k + 1])
    return None


_ENDS = (-1.0, 1.0)
_BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_TETRAHEDRON = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))


def _hull(corners: Floats, faces: Sequence[Sequence[int]]) -> Outline:
    """Return convex polygons about the origin as triangles that face outwards."""
    found = []
    for face in faces:
        for k in range(1, len(face) - 1):
            a, b, c = face[0], face[k], face[k + 1]
            normal = np.cross(corners[b] - corners[a], corners[c] - corners[a])
            found.append((a, b, c) if normal @ corners[a] > 0.0 else (a, c, b))
    return corners, np.array(found, np.int64)


def _revolved(profile: Sequence[tuple[float, float]], segments: int) -> Outline:
    """Return a profile of radii and heights, turned about z; what it encloses lies to its left.

    A profile that ends where it begins makes a ring.
    """
    turns = np.arange(segments) * (2.0 * math.pi / segments)
    places: list[Floats] = []
    rows: list[Ints] = []
    count = 0
    ring = profile[0] == profile[-1]
    for radius, height in profile[: len(profile) - ring]:
        if radius < 1e-12:
            places.append(np.array([[0.0, 0.0, height]]))
            rows.append(np.full(segments + 1, count))
        else:
            heights = np.full(segments, height)
            places.append(
                np.column_stack([radius * np.cos(turns), radius * np.sin(turns), heights])
            )
            rows.append(count + np.arange(segments + 1) % segments)
        count += len(places[-1])
    if ring:
        rows.append(rows[0])
    faces = []
    for low, high in pairwise(rows):
        a, b, c, d = low[:-1], low[1:], high[1:], high[:-1]
        faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    found = np.concatenate(faces)
    a, b, c = found.T
    return np.concatenate(places), found[(a != b) & (b != c) & (c != a)]
