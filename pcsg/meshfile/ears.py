"""Kernels that cut polygons of any size into triangles by their ears.

An ear is a corner whose triangle lies inside and holds no other corner; a simple polygon has at
least two (Meisters, 1975), and stays simple without one. Only corners that turn to the right can
lie in an ear; they stand in a grid, so that a polygon of a million corners is cut in seconds.
Corners at one place do not hide each other: the bridge to a hole is passed twice.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LARGEST_GRID = 512
"""Cells along a side of the grid."""

WORK = 100_000_000
"""Looks at cells and corners after which the polygons of a file are cut without looking."""

# How careful the search for an ear is: no corner in it or on its sides; none in it; any corner that
# turns to the left; any.
_STRICT, _TOUCHING, _TURNING, _ANY = range(4)


@njit
def _turn(flat: Floats, a: int, b: int, c: int) -> float:
    """Return twice the signed area of a triangle."""
    ax, ay = flat[2 * a], flat[2 * a + 1]
    bx, by = flat[2 * b] - ax, flat[2 * b + 1] - ay
    cx, cy = flat[2 * c] - ax, flat[2 * c + 1] - ay
    area: float = bx * cy - by * cx
    return area


@njit
def _same(flat: Floats, a: int, b: int) -> bool:
    same: bool = flat[2 * a] == flat[2 * b] and flat[2 * a + 1] == flat[2 * b + 1]
    return same


@njit
def _project(points: Floats, begin: int, n: int, flat: Floats) -> None:
    """Write plane coordinates, from -1 to 1, in which a polygon turns to the left."""
    size = 0.0
    for k in range(3 * n):
        size = max(size, abs(points[3 * begin + k] - points[3 * begin + k % 3]))
    if size == 0.0:
        size = 1.0
    # Newell's normal: twice the area vector, right for corners that are not quite in a plane.
    nx, ny, nz = 0.0, 0.0, 0.0
    ox, oy, oz = points[3 * begin], points[3 * begin + 1], points[3 * begin + 2]
    for k in range(n):
        a, b = 3 * (begin + k), 3 * (begin + (k + 1) % n)
        ax, ay, az = (
            (points[a] - ox) / size,
            (points[a + 1] - oy) / size,
            (points[a + 2] - oz) / size,
        )
        bx, by, bz = (
            (points[b] - ox) / size,
            (points[b + 1] - oy) / size,
            (points[b + 2] - oz) / size,
        )
        nx += ay * bz - az * by
        ny += az * bx - ax * bz
        nz += ax * by - ay * bx
    axis = 2
    normal = nz
    if abs(nx) >= abs(ny) and abs(nx) >= abs(nz):
        axis, normal = 0, nx
    elif abs(ny) >= abs(nz):
        axis, normal = 1, ny
    x, y = (axis + 1) % 3, (axis + 2) % 3
    way = -1.0 if normal < 0.0 else 1.0
    for k in range(n):
        at = 3 * (begin + k)
        flat[2 * k] = (points[at + x] - points[3 * begin + x]) / size
        flat[2 * k + 1] = way * ((points[at + y] - points[3 * begin + y]) / size)


@njit
def _cell(x: float, side: int) -> int:
    """Return the column of a coordinate from -1 to 1."""
    return max(0, min(side - 1, int((0.5 * x + 0.5) * side)))


@njit
def _fill_grid(
    flat: Floats, n: int, ring: Integers, starts: Integers, items: Integers
) -> tuple[int, int]:
    """Sort the corners that do not turn to the left into cells; return how many, and the side."""
    count = 0
    for k in range(n):
        turning = _turn(flat, (k - 1) % n, k, (k + 1) % n) > 0.0
        ring[4 * k + 2] = 0 if turning else 1
        count += ring[4 * k + 2]
    side = max(1, min(LARGEST_GRID, int(math.sqrt(count))))
    for c in range(side * side + 1):
        starts[c] = 0
    for k in range(n):
        if ring[4 * k + 2] == 1:
            starts[_cell(flat[2 * k], side) * side + _cell(flat[2 * k + 1], side) + 1] += 1
    for c in range(side * side):
        starts[c + 1] += starts[c]
    for k in range(n - 1, -1, -1):
        if ring[4 * k + 2] == 1:
            c = _cell(flat[2 * k], side) * side + _cell(flat[2 * k + 1], side)
            # The begin of the next cell counts down to that of this one.
            starts[c + 1] -= 1
            items[starts[c + 1]] = k
    for c in range(side * side):
        starts[c] = starts[c + 1]
    starts[side * side] = count
    return count, side


@njit
def _stretch(
    px: float, py: float, qx: float, qy: float, begin: float, end: float, low: float, high: float
) -> tuple[float, float]:
    """Return the y from `low` to `high`, and those of an edge between x = `begin` and `end`."""
    if max(px, qx) < begin or min(px, qx) > end:
        return low, high
    if px == qx:
        return min(low, py, qy), max(high, py, qy)
    slope = (qy - py) / (qx - px)
    u = py if begin <= px <= end else py + slope * ((begin if px < begin else end) - px)
    v = qy if begin <= qx <= end else py + slope * ((begin if qx < begin else end) - px)
    return min(low, u, v), max(high, u, v)


@njit
def _holds_a_corner(
    flat: Floats,
    a: int,
    b: int,
    c: int,
    level: int,
    ring: Integers,
    starts: Integers,
    items: Integers,
    side: int,
) -> tuple[bool, int]:
    """Return whether a triangle holds a corner of the ring, and how much work it was."""
    ax, ay = flat[2 * a], flat[2 * a + 1]
    bx, by = flat[2 * b], flat[2 * b + 1]
    cx, cy = flat[2 * c], flat[2 * c + 1]
    low, high = _cell(min(ax, bx, cx), side), _cell(max(ax, bx, cx), side)
    work = 0
    for column in range(low, high + 1):
        # What of the triangle lies in the column.
        begin, end = 2.0 * column / side - 1.0 - 1e-9, 2.0 * (column + 1) / side - 1.0 + 1e-9
        down, up = _stretch(ax, ay, bx, by, begin, end, math.inf, -math.inf)
        down, up = _stretch(bx, by, cx, cy, begin, end, down, up)
        down, up = _stretch(cx, cy, ax, ay, begin, end, down, up)
        left, right = _cell(down - 1e-9, side), _cell(up + 1e-9, side)
        work += 4
        # Cells of a column follow each other.
        for i in range(starts[column * side + left], starts[column * side + right + 1]):
            v = items[i]
            work += 1
            if ring[4 * v + 2] == 0 or v in (a, b, c):
                continue
            u, w, t = _turn(flat, a, b, v), _turn(flat, b, c, v), _turn(flat, c, a, v)
            if u < 0.0 or w < 0.0 or t < 0.0:
                continue
            if level == _TOUCHING and (u == 0.0 or w == 0.0 or t == 0.0):
                continue
            if not (_same(flat, v, a) or _same(flat, v, b) or _same(flat, v, c)):
                return True, work
    return False, work


@njit
def _is_ear(
    flat: Floats,
    k: int,
    level: int,
    waiting: int,
    ring: Integers,
    starts: Integers,
    items: Integers,
    side: int,
) -> tuple[bool, int]:
    """Return whether a corner is an ear at a level of care, and how much work it was."""
    a, c = ring[4 * k], ring[4 * k + 1]
    turn = _turn(flat, a, k, c)
    if level == _ANY:
        return True, 1
    if turn < 0.0 or (turn == 0.0 and level != _TOUCHING):
        return False, 1
    if turn == 0.0 or level == _TURNING or waiting == 0:
        return True, 1
    holds, work = _holds_a_corner(flat, a, k, c, level, ring, starts, items, side)
    return not holds, work


@njit
def _emit(out: Integers, at: int, begin: int, a: int, b: int, c: int) -> None:
    out[3 * at], out[3 * at + 1], out[3 * at + 2] = begin + a, begin + b, begin + c


@njit
def _cut(
    flat: Floats,
    n: int,
    begin: int,
    at: int,
    budget: int,
    ring: Integers,
    starts: Integers,
    items: Integers,
    out: Integers,
) -> tuple[int, float, float]:
    """Write the triangles of a polygon; return the work, and the sums of areas and of their sizes.

    Parameters
    ----------
    begin
        Its first corner, which is added to the numbers that are written.
    at
        Where its first triangle is written.
    budget
        Work after which it is cut without looking.
    ring
        Room for four numbers of every corner: the one before, the one after, and whether it is
        still there and turns to the right.
    """
    for k in range(n):
        ring[4 * k], ring[4 * k + 1] = (k - 1) % n, (k + 1) % n
    waiting, side = _fill_grid(flat, n, ring, starts, items)
    left = n
    k = 0
    seen = 0
    level = 0
    relaxed = 0
    work = 0
    areas, sizes = 0.0, 0.0
    while left > 3:
        ear, more = _is_ear(flat, k, level, waiting, ring, starts, items, side)
        work += more
        if work > budget:
            level = max(level, _TURNING if work < 2 * budget else _ANY)
        if not ear:
            k = ring[4 * k + 1]
            seen += 1
            if seen > left:
                level, seen = level + 1, 0
            continue
        a, c = ring[4 * k], ring[4 * k + 1]
        _emit(out, at, begin, a, k, c)
        at += 1
        area = _turn(flat, a, k, c)
        areas += area
        sizes += abs(area)
        waiting -= ring[4 * k + 2]
        ring[4 * k + 2] = 0
        ring[4 * a + 1], ring[4 * c] = c, a
        left -= 1
        for end in (a, c):
            if ring[4 * end + 2] == 1 and _turn(flat, ring[4 * end], end, ring[4 * end + 1]) > 0.0:
                ring[4 * end + 2] = 0
                waiting -= 1
        if level == _TOUCHING and relaxed < 64:
            # Where corners touch sides, one step with less care is mostly enough.
            level = _STRICT
            relaxed += 1
        seen = 0
        # The next but one, so that triangles stay small.
        k = ring[4 * c + 1]
    a, c = ring[4 * k], ring[4 * k + 1]
    _emit(out, at, begin, a, k, c)
    area = _turn(flat, a, k, c)
    return work, areas + area, sizes + abs(area)


@njit(entry=True)
def cut_polygons(
    points: Floats,
    offsets: Integers,
    which: Integers,
    flat: Floats,
    ring: Integers,
    starts: Integers,
    items: Integers,
    out: Integers,
) -> int:
    """Cut polygons into triangles.

    Parameters
    ----------
    points : float64 (3 C,)
        Corners of all polygons.
    offsets : int64 (F + 1,)
        Where polygons begin in them.
    which : int64 (P,)
        The polygons that are cut.
    flat, ring, starts, items
        Room for 2 n, 4 n, LARGEST_GRID^2 + 1 and n numbers, n the corners of the largest.
    out : int64 (3 T,)
        Receives triangles as numbers of corners, n - 2 for every polygon.

    Returns
    -------
    int
        Number of polygons that are not simple, so that their triangles overlap.
    """
    at = 0
    crossing = 0
    budget = WORK
    for i in range(len(which)):
        begin = offsets[which[i]]
        n = offsets[which[i] + 1] - begin
        _project(points, begin, n, flat)
        work, areas, sizes = _cut(flat, n, begin, at, budget, ring, starts, items, out)
        budget = max(0, budget - work)
        at += n - 2
        # Areas are relative to a polygon of size 1.
        if sizes - abs(areas) > 1e-9:
            crossing += 1
    return crossing
