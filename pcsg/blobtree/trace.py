"""Guaranteed intersection of a ray with a model: no root is missed, and none is made up.

The supports that the ray crosses are swept into clusters of overlapping ones. On an interval of a
cluster the field and its slope have bounds (`evaluate.hull`): an interval whose bounds leave out T
is dropped, one on which the field is monotone has the root that its ends tell, which is found by
Newton's method between brackets; any other is split, leaving out what the slope's bounds forbid
around the middle. Crossings alternate because the sign is carried from interval to interval.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.evaluate import hull
from pcsg.blobtree.fields import T
from pcsg.blobtree.layout import (
    ABOUT,
    CENTRE,
    ENTER,
    LEAF_BITS,
    LEAVE,
    LISTS,
    MET,
    ORDER,
    PRIMITIVE,
    ROW,
    SIZE,
    SLIM,
    STACK,
    Tables,
    Work,
    wide,
)
from pcsg.blobtree.meeting import meet, passes_by
from pcsg.jit import njit
from pcsg.vec import Ray, Vec3

ALL, FIRST, ANY = 0, 1, 2
"""As a leaf is asked; see `pcsg.leaf.registry`."""

FULL = -1
"""In place of a count: the workspace or the list is too short."""

ROUNDING = 4.4e-16


@njit(contract=True)
def collect(m: Tables, work: Work, o: Vec3, d: Vec3, begin: float, end: float) -> int:
    """Prepare the primitives whose support a ray of unit speed crosses within [begin, end].

    Returns their number, depth first, or `FULL`.
    """
    boxes, ints = m.singles, m.ints
    ix = 1.0 / d.x if abs(d.x) > 1e-150 else math.copysign(1e150, d.x)
    iy = 1.0 / d.y if abs(d.y) > 1e-150 else math.copysign(1e150, d.y)
    iz = 1.0 / d.z if abs(d.z) > 1e-150 else math.copysign(1e150, d.z)
    node, n = 0, 0
    while node < m.node_count:
        at = m.s + 6 * node
        x0, x1 = (boxes[at] - o.x) * ix, (boxes[at + 3] - o.x) * ix
        y0, y1 = (boxes[at + 1] - o.y) * iy, (boxes[at + 4] - o.y) * iy
        z0, z1 = (boxes[at + 2] - o.z) * iz, (boxes[at + 5] - o.z) * iz
        t0 = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), begin))
        t1 = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), end))
        code = wide(ints[m.nodes + node])
        if t0 > t1:
            node = -code if code < 0 else node + 1
            continue
        node += 1
        if code >= 0:
            first = code // LEAF_BITS
            for i in range(first, first + code % LEAF_BITS):
                if n >= work.room - 1:
                    return FULL
                at = m.primitives + PRIMITIVE * i
                slim = ints[at + ABOUT] & SLIM != 0
                if slim and passes_by(m.floats, m.f + wide(ints[at + ROW]), o, d):
                    continue
                if meet(m, work, i, n, o, d):
                    h = MET * n
                    if work.floats[h + LEAVE] >= begin and work.floats[h + ENTER] <= end:
                        n += 1
    return n


@njit(contract=True)
def sort_order(work: Work, n: int) -> None:
    """Sort what is met by where it begins (Shell's sort: lists are short or nearly sorted)."""
    ints, h, at = work.ints, work.floats, ORDER * work.room
    for k in range(n):
        ints[at + k] = k
    gap = 1
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap >= 1:
        for k in range(gap, n):
            x = ints[at + k]
            key = h[MET * x + ENTER]
            j = k
            while j >= gap and h[MET * ints[at + j - gap] + ENTER] > key:
                ints[at + j] = ints[at + j - gap]
                j -= gap
            ints[at + j] = x
        gap //= 3


@njit(contract=True)
def list_cluster(work: Work, begin: int, end: int) -> None:
    """Write a cluster's members depth first to the first list."""
    ints, order, at = work.ints, ORDER * work.room, LISTS * work.room
    n = end - begin
    for k in range(n):
        ints[at + k] = ints[order + begin + k]
    gap = 1
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap >= 1:
        for k in range(gap, n):
            x = ints[at + k]
            j = k
            while j >= gap and ints[at + j - gap] > x:
                ints[at + j] = ints[at + j - gap]
                j -= gap
            ints[at + j] = x
        gap //= 3


@njit(contract=True)
def refine(
    m: Tables, work: Work, begin: int, count: int, a: float, b: float, rising: bool, eps: float
) -> float:
    """Return the root of a monotone field on [a, b]: Newton's method between brackets."""
    x = 0.5 * (a + b)
    for _ in range(100):
        f, _f, d_low, d_high = hull(m, work, begin, count, x, x)
        g = f - T
        if (g >= 0.0) == rising:
            b = x
        else:
            a = x
        slope = 0.5 * (d_low + d_high)
        step = g / slope if slope != 0.0 else math.inf
        if abs(step) < eps + ROUNDING * abs(x) or b - a < eps + ROUNDING * abs(x):
            break
        x -= step
        if not a < x < b:
            x = 0.5 * (a + b)
    return x


@njit(contract=True)
def find_roots(
    m: Tables,
    work: Work,
    count: int,
    begin: float,
    end: float,
    sign: int,
    clipped: bool,
    enough: float,
    t: NDArray[np.float64],
    n: int,
    limit: int,
) -> int:
    """Write the roots of a cluster on [begin, end] to ``t[n:]`` and return the new length.

    Parameters
    ----------
    count
        Length of the cluster's list, the first of the workspace's.
    sign
        1 if the field is at least T at the beginning, -1 if not.
    clipped
        Whether there may be a field at the end.
    enough
        No root is needed after one beyond.
    """
    ints, h = work.ints, work.floats
    intervals, marks = work.intervals, work.marks
    size = m.floats[m.f + SIZE]
    least, eps = 1e-10 * size, 1e-14 * size
    room = len(ints)
    last = -1
    if clipped:
        f, _f, _d, _e = hull(m, work, LISTS * work.room, count, end, end)
        last = 1 if f >= T else -1
    intervals[0], intervals[1] = begin, end
    marks[0], marks[1], marks[2], marks[3] = sign, last, LISTS * work.room, count
    top = 1
    while top > 0:
        top -= 1
        a, b = intervals[2 * top], intervals[2 * top + 1]
        sa, sb, start, length = (
            marks[4 * top],
            marks[4 * top + 1],
            marks[4 * top + 2],
            marks[4 * top + 3],
        )
        at = start + length
        if at + length > room:
            return FULL
        active = 0
        for k in range(start, at):
            x = ints[k]
            if h[MET * x + ENTER] < b and h[MET * x + LEAVE] > a:
                ints[at + active] = x
                active += 1
        low, high, d_low, d_high = 0.0, 0.0, 0.0, 0.0
        if active > 0:
            low, high, d_low, d_high = hull(m, work, at, active, a, b)
        root = math.nan
        width = b - a
        if high < T or low >= T:
            if sa != sb:
                root = 0.5 * (a + b)
        elif d_low > 0.0 or d_high < 0.0:
            if sa != sb:
                root = refine(m, work, at, active, a, b, sb > 0, eps)
        elif width < least or width < 16.0 * ROUNDING * max(abs(a), abs(b)):
            if sa != sb:
                root = 0.5 * (a + b)
        else:
            x = 0.5 * (a + b)
            f, _f, _d, _e = hull(m, work, at, active, x, x)
            g = f - T
            middle = 1 if g >= 0.0 else -1
            # Around the middle the field cannot reach T within g over its steepest slope.
            right, left = b, a
            if g >= 0.0:
                right = x - g / d_low * (1.0 - 1e-9) if d_low < 0.0 else b
                left = x - g / d_high * (1.0 - 1e-9) if d_high > 0.0 else a
            else:
                right = x - g / d_high * (1.0 - 1e-9) if d_high > 0.0 else b
                left = x - g / d_low * (1.0 - 1e-9) if d_low < 0.0 else a
            if right <= x and left >= x:
                right, left = x, x
            if top + 2 > STACK:
                return FULL
            if right < b or middle != sb:
                intervals[2 * top], intervals[2 * top + 1] = min(right, b), b
                marks[4 * top], marks[4 * top + 1] = middle, sb
                marks[4 * top + 2], marks[4 * top + 3] = at, active
                top += 1
            if left > a or sa != middle:
                intervals[2 * top], intervals[2 * top + 1] = a, max(left, a)
                marks[4 * top], marks[4 * top + 1] = sa, middle
                marks[4 * top + 2], marks[4 * top + 3] = at, active
                top += 1
        if not math.isnan(root):
            if n >= limit:
                return FULL
            t[n] = root
            n += 1
            if root > enough:
                return n
    return n


@njit(contract=True)
def shoot(
    m: Tables, work: Work, ray: Ray, want: int, t: NDArray[np.float64], n: int, limit: int
) -> tuple[int, bool]:
    """Write the crossings of a ray to ``t[n:limit]``.

    For ALL every crossing of the line, else the first within [tmin, tmax].

    Returns
    -------
    length, inside
        The new length, or `FULL`. Unless ALL are wanted, whether the ray is inside before the
        crossing that was found; all the way within [tmin, tmax] where none was.
    """
    f = m.f
    speed = math.sqrt(ray.dx * ray.dx + ray.dy * ray.dy + ray.dz * ray.dz)
    if not 0.0 < speed < math.inf or m.primitive_count == 0:
        return n, False
    i = 1.0 / speed
    d = Vec3(ray.dx * i, ray.dy * i, ray.dz * i)
    # Lengths count from the point nearest to the model's middle: digits are needed there.
    ox, oy, oz = ray.ox, ray.oy, ray.oz
    near = (
        (m.floats[f + CENTRE] - ox) * d.x
        + (m.floats[f + CENTRE + 1] - oy) * d.y
        + (m.floats[f + CENTRE + 2] - oz) * d.z
    )
    o = Vec3(ox + near * d.x, oy + near * d.y, oz + near * d.z)
    size = m.floats[f + SIZE]
    begin, end = -2.0 * size, 2.0 * size
    first = want != ALL
    enough = math.inf
    if first:
        # Roots within the slack may lie outside of what is asked.
        slack = 1e-9 * size
        enough = ray.tmin * speed - near + slack
        begin, end = (
            max(begin, ray.tmin * speed - near - slack),
            min(end, ray.tmax * speed - near + slack),
        )
        if begin > end:
            return n, False
    met = collect(m, work, o, d, begin, end)
    if met <= 0:
        return n if met == 0 else FULL, False
    sort_order(work, met)
    h, order = work.floats, work.ints
    at = ORDER * work.room
    k = 0
    while k < met:
        start, stop = h[MET * order[at + k] + ENTER], h[MET * order[at + k] + LEAVE]
        j = k + 1
        while j < met and h[MET * order[at + j] + ENTER] < stop:
            stop = max(stop, h[MET * order[at + j] + LEAVE])
            j += 1
        list_cluster(work, k, j)
        sign = -1
        if start < begin:
            start = begin
            value, _v, _d, _e = hull(m, work, LISTS * work.room, j - k, start, start)
            sign = 1 if value >= T else -1
        m0 = n
        n = find_roots(m, work, j - k, start, min(stop, end), sign, stop > end, enough, t, n, limit)
        if n == FULL:
            return FULL, False
        inside = sign > 0
        for q in range(m0, n):
            t[q] = (near + t[q]) * i
            if first and t[q] >= ray.tmin:
                if t[q] > ray.tmax:
                    break
                t[m0] = t[q]
                return m0 + 1, inside
            inside = not inside
        if first:
            n = m0
            if inside:
                # It leaves behind tmax.
                return n, True
        k = j
    return n, False
