"""Cutting polygons into triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def triangulate(vertices: Floats, corners: Integers, offsets: Integers) -> tuple[Integers, int]:
    """Cut polygons into triangles.

    Quadrilaterals are cut along the diagonal that lies inside (the first one, if both do), larger
    polygons by their ears, seen along their mean normal; see `ears`.

    Returns
    -------
    int64 (T, 3)
        Positions in `corners`, in the order of the polygons.
    int
        Number of polygons that cross themselves, so that their triangles overlap.
    """
    counts = np.diff(offsets)
    begins = offsets[:-1]
    owners: list[Integers] = []
    parts: list[Integers] = []
    crossing = 0

    def add(owner: Integers, triangles: Integers) -> None:
        owners.append(owner)
        parts.append(triangles)

    three = np.flatnonzero(counts == 3)
    add(three, begins[three, None] + np.arange(3))
    four = np.flatnonzero(counts == 4)
    if len(four):
        quads = begins[four, None] + np.arange(4)
        a, b, c, d = (vertices[corners[quads[:, k]]] for k in range(4))
        # Lengths of about 1, so that products of four of them neither vanish nor overflow.
        size = np.max([np.abs(p - a).max(axis=1) for p in (b, c, d)], axis=0)
        b, c, d = ((p - a) / np.where(size > 0.0, size, 1.0)[:, None] for p in (b, c, d))
        a = np.zeros_like(b)
        along_first = _agreement(np.cross(b - a, c - a), np.cross(c - a, d - a))
        along_second = _agreement(np.cross(c - b, d - b), np.cross(d - b, a - b))
        second = ~(along_first > 0.0) & (along_second > 0.0)
        crossing = int(((along_first < 0.0) & (along_second < 0.0)).sum())
        first_cut = np.where(second[:, None], [1, 2, 3], [0, 1, 2])
        second_cut = np.where(second[:, None], [1, 3, 0], [0, 2, 3])
        add(four, begins[four, None] + first_cut)
        add(four, begins[four, None] + second_cut)
    many = np.flatnonzero(counts > 4)
    if len(many):
        triangles, more = _cut_many(vertices[corners], offsets, many)
        crossing += more
        add(np.repeat(many, counts[many] - 2), triangles)
    order = np.argsort(np.concatenate(owners), kind="stable")
    found: Integers = np.concatenate(parts)[order]
    return found, crossing


def _agreement(a: Floats, b: Floats) -> Floats:
    dots: Floats = np.einsum("ij,ij->i", a, b)
    return dots


def _cut_many(points: Floats, offsets: Integers, which: Integers) -> tuple[Integers, int]:
    """Cut polygons by their ears; return positions of corners, and how many cross themselves."""
    from pcsg.meshfile.ears import LARGEST_GRID, cut_polygons

    counts = np.diff(offsets)[which]
    most = int(counts.max())
    out = np.empty(3 * int((counts - 2).sum()), np.int64)
    crossing = cut_polygons(
        np.ascontiguousarray(points).ravel(),
        offsets,
        which,
        np.empty(2 * most),
        np.empty(4 * most, np.int64),
        np.empty(LARGEST_GRID**2 + 1, np.int64),
        np.empty(most, np.int64),
        out,
    )
    return out.reshape(-1, 3), crossing
