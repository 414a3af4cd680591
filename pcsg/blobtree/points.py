"""Values, gradients and attributes of a field at points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.evaluate import hull, leaf_hull, pull_back
from pcsg.blobtree.layout import (
    ABOUT,
    ATTRIBUTES,
    DIRECTION,
    ENTER,
    H_CONSTANT,
    H_ROW,
    KINDS,
    LEAF_BITS,
    LEAVE,
    LISTS,
    MET,
    NEAREST,
    PRIMITIVE,
    SILENT,
    SLOTS,
    Tables,
    Work,
    wide,
)
from pcsg.blobtree.meeting import meet
from pcsg.blobtree.skeletons import skeleton_ladder
from pcsg.jit import njit
from pcsg.vec import Vec3

FULL = -1

MODEL_SLOTS = ("@red", "@green", "@blue", "@material", "@texture", "@texture_scale", "@label")
"""Attributes of primitives, in the order of a model's table; NaN where there is none."""

COLOUR, LABEL, BOUND, U, V, OTHERS, ATTRIBUTE_COLUMNS = 3, 6, 7, 8, 9, 10, 16
"""The first three are mixed; then come the share of bounds, surface coordinates, and u, v and the
share of two more primitives."""

skeleton_uv = skeleton_ladder("uv", "p c at", "(0.0, 0.0)")
"""``(kind, p, c, at) -> (u, v)``"""


@njit(contract=True)
def locate(m: Tables, work: Work, p: Vec3, d: Vec3) -> int:
    """Prepare the primitives with a field at p, for a ray along d; their number or `FULL`.

    They are listed as the first list of the workspace.
    """
    boxes, ints = m.singles, m.ints
    node, n = 0, 0
    while node < m.node_count:
        at = m.s + 6 * node
        code = wide(ints[m.nodes + node])
        if (
            p.x < boxes[at]
            or p.y < boxes[at + 1]
            or p.z < boxes[at + 2]
            or p.x > boxes[at + 3]
            or p.y > boxes[at + 4]
            or p.z > boxes[at + 5]
        ):
            node = -code if code < 0 else node + 1
            continue
        node += 1
        if code >= 0:
            first = code // LEAF_BITS
            for i in range(first, first + code % LEAF_BITS):
                if n >= work.room - 1:
                    return FULL
                if (
                    meet(m, work, i, n, p, d)
                    and work.floats[MET * n + ENTER] <= 0.0 <= work.floats[MET * n + LEAVE]
                ):
                    work.ints[LISTS * work.room + n] = n
                    n += 1
    return n


@njit(contract=True)
def value_at(m: Tables, work: Work, p: Vec3, d: Vec3) -> tuple[float, float, int]:
    """Return the field at p, its slope along d, and how many primitives have a field there."""
    n = locate(m, work, p, d)
    if n <= 0:
        return 0.0, 0.0, n
    f, _f, d_low, d_high = hull(m, work, LISTS * work.room, n, 0.0, 0.0)
    return f, 0.5 * (d_low + d_high), n


@njit(contract=True)
def gradient_at(m: Tables, work: Work, p: Vec3) -> Vec3:
    """Return the gradient of the field at p, the slopes along the axes; NaN if there is no room."""
    _f, x, n = value_at(m, work, p, Vec3(1.0, 0.0, 0.0))
    if n == FULL:
        return Vec3(math.nan, math.nan, math.nan)
    _f, y, _n = value_at(m, work, p, Vec3(0.0, 1.0, 0.0))
    _f, z, _n = value_at(m, work, p, Vec3(0.0, 0.0, 1.0))
    return Vec3(x, y, z)


@njit(contract=True)
def coordinates(m: Tables, work: Work, k: int) -> tuple[float, float]:
    """Return the surface coordinates of the k-th primitive that has a field at a point."""
    h, i = MET * k, work.ints[k]
    t = -work.floats[h + NEAREST]
    q = Vec3(
        work.floats[h] + t * work.floats[h + DIRECTION],
        work.floats[h + 1] + t * work.floats[h + DIRECTION + 1],
        work.floats[h + 2] + t * work.floats[h + DIRECTION + 2],
    )
    if work.floats[h + H_ROW] >= 0.0:
        q, _v, _s, _d = pull_back(m, work.floats, h, t)
    u, v = skeleton_uv(work.ints[KINDS * work.room + k], q, work.floats, h + H_CONSTANT)
    if m.uv >= 0:
        u += m.singles[m.s + m.uv + 2 * i]
        v += m.singles[m.s + m.uv + 2 * i + 1]
    return u - math.floor(u), v


@njit(contract=True)
def is_twin(m: Tables, work: Work, j: int, k: int) -> bool:
    """Return whether the j-th primitive at a point, if any, and the k-th look alike there."""
    if j < 0:
        return False
    u, v = coordinates(m, work, j)
    x, y = coordinates(m, work, k)
    return bool(u == x and v == y)


@njit(contract=True)
def describe(m: Tables, work: Work, p: Vec3, out: NDArray[np.float64], at: int) -> int:
    """Write the attributes of a point to ``out[at:]``, `ATTRIBUTE_COLUMNS` numbers.

    Colours are mixed by what their primitives contribute to the field; of the others the
    strongest primitive's stand. Surface coordinates are those of the three strongest; the shares
    are what these have above the fourth, so that nothing jumps where primitives change places.
    Returns how many primitives have a field there.
    """
    for k in range(ATTRIBUTE_COLUMNS):
        out[at + k] = math.nan if k < BOUND else 0.0
    f, _slope, n = value_at(m, work, p, Vec3(1.0, 0.0, 0.0))
    if n <= 0:
        return n
    out[at + BOUND] = work.floats[4 * SLOTS * work.room]
    most, second, third, fourth, coloured = 0.0, 0.0, 0.0, 0.0, 0.0
    a, b, c = -1, -1, -1
    red, green, blue = 0.0, 0.0, 0.0
    for k in range(n):
        f, _f, _d, _e = leaf_hull(m, work, k, 0.0, 0.0)
        i = work.ints[k]
        about = wide(m.ints[m.primitives + PRIMITIVE * i + ABOUT])
        if about & SILENT != 0:
            continue
        row = m.attributes + 7 * (about // ATTRIBUTES)
        if f > 0.0 and not math.isnan(m.floats[row]):
            coloured += f
            red += f * m.floats[row]
            green += f * m.floats[row + 1]
            blue += f * m.floats[row + 2]
        # Both parts of a bounded blend have the same primitives.
        if (
            (f == most and is_twin(m, work, a, k))
            or (f == second and is_twin(m, work, b, k))
            or (f == third and is_twin(m, work, c, k))
        ):
            continue
        if f > most:
            most, second, third, fourth = f, most, second, third
            a, b, c = k, a, b
            for column in range(COLOUR, 7):
                out[at + column] = m.floats[row + column]
        elif f > second:
            second, third, fourth = f, second, third
            b, c = k, b
        elif f > third:
            third, fourth, c = f, third, k
        elif f > fourth:
            fourth = f
    if a >= 0:
        out[at + U], out[at + V] = coordinates(m, work, a)
    whole = most + second + third - 3.0 * fourth
    if b >= 0 and second > fourth:
        out[at + OTHERS], out[at + OTHERS + 1] = coordinates(m, work, b)
        out[at + OTHERS + 2] = (second - fourth) / whole
    if c >= 0 and third > fourth:
        out[at + OTHERS + 3], out[at + OTHERS + 4] = coordinates(m, work, c)
        out[at + OTHERS + 5] = (third - fourth) / whole
    if coloured > 0.0:
        out[at], out[at + 1], out[at + 2] = red / coloured, green / coloured, blue / coloured
    return n
