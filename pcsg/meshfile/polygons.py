"""Cutting polygons into triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def triangulate(vertices: Floats, corners: Integers, offsets: Integers) -> Integers:
    """Cut polygons into triangles.

    Quadrilaterals are cut along the diagonal that lies inside (the first one, if both do), larger
    polygons by their ears, seen along their mean normal.

    Returns
    -------
    int64 (T, 3)
        Positions in `corners`, in the order of the polygons.
    """
    counts = np.diff(offsets)
    begins = offsets[:-1]
    owners: list[Integers] = []
    parts: list[Integers] = []

    def add(owner: Integers, triangles: Integers) -> None:
        owners.append(owner)
        parts.append(triangles)

    three = np.flatnonzero(counts == 3)
    add(three, begins[three, None] + np.arange(3))
    four = np.flatnonzero(counts == 4)
    if len(four):
        quads = begins[four, None] + np.arange(4)
        a, b, c, d = (vertices[corners[quads[:, k]]] for k in range(4))
        with np.errstate(over="ignore", invalid="ignore"):
            along_first = _agree(np.cross(b - a, c - a), np.cross(c - a, d - a))
            along_second = _agree(np.cross(c - b, d - b), np.cross(d - b, a - b))
        second = ~along_first & along_second
        first_cut = np.where(second[:, None], [1, 2, 3], [0, 1, 2])
        second_cut = np.where(second[:, None], [1, 3, 0], [0, 2, 3])
        add(four, begins[four, None] + first_cut)
        add(four, begins[four, None] + second_cut)
    for f in np.flatnonzero(counts > 4):
        begin, end = offsets[f], offsets[f + 1]
        ears = cut_ears(vertices[corners[begin:end]])
        add(np.full(len(ears), f), begin + np.array(ears, np.int64))
    order = np.argsort(np.concatenate(owners), kind="stable")
    found: Integers = np.concatenate(parts)[order]
    return found


def _agree(a: Floats, b: Floats) -> NDArray[np.bool_]:
    agrees: NDArray[np.bool_] = np.einsum("ij,ij->i", a, b) > 0.0
    return agrees


def cut_ears(points: Floats) -> Sequence[tuple[int, int, int]]:
    """Cut a simple polygon into triangles by its ears.

    Parameters
    ----------
    points : float64 (n, 3)
        Corners, nearly in a plane.

    Returns
    -------
    Sequence
        n - 2 triples of positions. Where no ear is left, as in a polygon that crosses itself, the
        rest is cut as a fan.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _cut(_project(points))


def _cut(flat: Floats) -> Sequence[tuple[int, int, int]]:
    ring = list(range(len(flat)))
    found: list[tuple[int, int, int]] = []
    while len(ring) > 3:
        ear = next((k for k in range(len(ring)) if _is_ear(flat, ring, k)), 1)
        before, after = ring[ear - 1], ring[(ear + 1) % len(ring)]
        found.append((before, ring[ear], after))
        del ring[ear]
    return [*found, (ring[0], ring[1], ring[2])]


def _project(points: Floats) -> Floats:
    """Return plane coordinates in which the polygon turns to the left."""
    around = points - points.mean(axis=0)
    # Newell's normal: twice the area vector, right for corners that are not quite in a plane.
    normal = np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = around[:, [(axis + 1) % 3, (axis + 2) % 3]]
    if normal[axis] < 0.0:
        flat = flat * (1.0, -1.0)
    return np.ascontiguousarray(flat)


def _is_ear(flat: Floats, ring: Sequence[int], k: int) -> bool:
    a, b, c = flat[ring[k - 1]], flat[ring[k]], flat[ring[(k + 1) % len(ring)]]
    if not _turn(a, b, c) > 0.0:
        return False
    corners = (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])
    others = flat[[v for v in ring if v not in corners]]
    inside = (_turn(a, b, others) >= 0.0) & (_turn(b, c, others) >= 0.0)
    inside &= _turn(c, a, others) >= 0.0
    return not bool(inside.any())


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return twice the signed area of triangles."""
    turned: Floats = (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
    return turned
