"""Bounds of a whole field on an interval of a ray; on an interval of no length, its value.

Leaves are visited depth first with a stack of open operators, so that k leaves touch at most k - 1
operators, however deep the tree is: what has no field here is 0, and 0 is what operators ignore.
"""

from __future__ import annotations

import math

from pcsg.blobtree.blends import BLENDS, Array, blend_ladder
from pcsg.blobtree.fields import (
    bound_below,
    convex_hull,
    field_hull,
    slope_range,
    smooth_hull,
)
from pcsg.blobtree.layout import (
    ANCHOR,
    ARGS,
    CHAIN,
    DIRECTION,
    END,
    ENTER,
    FALL,
    FRAMES,
    H_ACCELERATION,
    H_CONSTANT,
    H_INVERSE,
    H_ROW,
    H_SPEED,
    H_WEIGHT,
    KIND,
    KINDS,
    LEAVE,
    LOOSE,
    MATRIX,
    MET,
    NEAREST,
    OPERATOR,
    PARENT,
    PRIMITIVE,
    RISE,
    SLOT,
    SLOTS,
    STEEP,
    UP,
    WARP_CONSTANT,
    WARP_SPEED,
    WHAT,
    Tables,
    Work,
    wide,
)
from pcsg.blobtree.skeletons import DIRECT, skeleton_ladder
from pcsg.blobtree.warps import warp_ladder
from pcsg.jit import njit
from pcsg.vec import Vec3, load_affine, transform_point, transform_vector

NOBODY = 1 << 40
"""A primitive behind all others."""

SUM = BLENDS["sum"].kind

skeleton_distance = skeleton_ladder("distance", "p d c at pool", "(1e300, 0.0)")
"""``(kind, p, d, c, at, pool) -> (g, g')``"""

warp_pull = warp_ladder()
"""``(kind, p, v, c, at) -> Warped``"""

blend_hull = blend_ladder()
"""``(kind, values, slots, base, n, args, at, out) -> 0``"""


@njit(contract=True)
def weigh(
    w: float, low: float, high: float, d_low: float, d_high: float
) -> tuple[float, float, float, float]:
    """Return w times the bounds of a positive field."""
    low = max(low, 0.0)
    if w < 0.0:
        return w * high, w * low, w * d_high, w * d_low
    return w * low, w * high, w * d_low, w * d_high


@njit(contract=True)
def pull_back(m: Tables, h: Array, at: int, t: float) -> tuple[Vec3, Vec3, float, float]:
    """Return where a point of the ray is behind warps, in the primitive's frame, and its velocity.

    And for how long the curve stays smooth, and in the domain.
    """
    f, row = m.floats, int(h[at + H_ROW])
    v = Vec3(h[at + DIRECTION], h[at + DIRECTION + 1], h[at + DIRECTION + 2])
    p = Vec3(h[at] + t * v.x, h[at + 1] + t * v.y, h[at + 2] + t * v.z)
    smooth, domain = math.inf, math.inf
    chain = m.primitives + int(f[row + CHAIN])
    for k in range(int(m.ints[chain])):
        warp = m.f + int(m.ints[chain + 2 * k + 2])
        local = load_affine(f, warp)
        q = warp_pull(
            int(m.ints[chain + 2 * k + 1]),
            transform_point(local, p),
            transform_vector(local, v),
            f,
            warp + WARP_CONSTANT,
        )
        speed = f[warp + WARP_SPEED]
        smooth, domain = min(smooth, q.smooth / speed), min(domain, q.domain / speed)
        p, v = q.p, q.v
    local = load_affine(f, row + MATRIX)
    return transform_point(local, p), transform_vector(local, v), smooth, domain


@njit(contract=True)
def warped_distance(
    m: Tables, kind: int, h: Array, at: int, t: float
) -> tuple[float, float, float, float]:
    """Return g and g' behind warps, and for how long the curve stays smooth, and in the domain."""
    p, v, smooth, domain = pull_back(m, h, at, t)
    g, slope = skeleton_distance(kind, p, v, h, at + H_CONSTANT, m.floats)
    return g, slope, smooth, domain


@njit(contract=True)
def warped_hull(
    m: Tables, kind: int, h: Array, at: int, a: float, b: float
) -> tuple[float, float, float, float]:
    """Return bounds of the field of a warped primitive."""
    w, inverse = h[at + H_WEIGHT], h[at + H_INVERSE]
    begin, end = max(a, h[at + ENTER]), min(b, h[at + LEAVE])
    if begin > end:
        return 0.0, 0.0, 0.0, 0.0
    t = begin - h[at + NEAREST]
    span = end - begin
    smooth, domain = math.inf, math.inf
    ga, pa, gb, pb = 0.0, 0.0, 0.0, 0.0
    for _ in range(2):
        ga, pa = gb, pb
        gb, pb, more, left = warped_distance(m, kind, h, at, t)
        if a == b and kind >= DIRECT:
            return weigh(w, gb, gb, pb, pb)
        if a == b:
            return field_hull(gb, gb, pb, pb, inverse, w)
        smooth, domain = min(smooth, more), min(domain, left)
        t += span
    speed = h[at + H_SPEED]
    if domain <= span:
        # The curve may leave the domain: anything a lone primitive can be.
        steep, most = 2.0 * speed * math.sqrt(inverse) * abs(w), w
        if kind >= DIRECT:
            # No field is greater than its slope allows within its reach.
            steep = m.floats[int(h[at + H_ROW]) + STEEP]
            most = w * steep / math.sqrt(inverse)
            steep *= abs(w) * speed
        return min(most, 0.0), max(most, 0.0), -steep, steep
    if kind >= DIRECT:
        row = int(h[at + H_ROW])
        steep, bend = m.floats[row + STEEP], h[at + H_ACCELERATION]
        f_low = 0.5 * (ga + gb - steep * speed * span)
        f_high = 0.5 * (ga + gb + steep * speed * span)
        d_low, d_high = -steep * speed, steep * speed
        if smooth > span:
            fall = m.floats[row + FALL] * speed * speed + steep * bend
            rise = m.floats[row + RISE] * speed * speed + steep * bend
            x, y, u, v = smooth_hull(ga, pa, gb, pb, span, fall, rise)
            f_low, f_high = max(f_low, x), min(f_high, y)
            d_low, d_high = max(d_low, u), min(d_high, v)
        if begin > a or end < b:
            f_low, f_high = min(f_low, 0.0), max(f_high, 0.0)
            d_low, d_high = min(d_low, 0.0), max(d_high, 0.0)
        return weigh(w, f_low, f_high, d_low, d_high)
    da, db = math.sqrt(ga), math.sqrt(gb)
    near = max(0.5 * (da + db - speed * span), 0.0)
    far = 0.5 * (da + db + speed * span)
    low, high = near * near, far * far
    p_low, p_high = -2.0 * far * speed, 2.0 * far * speed
    if smooth > span:
        # g'' = 2 |q'|2 (less what the set bends away) + grad g . q''
        pull = 2.0 * far * h[at + H_ACCELERATION]
        push = 2.0 * speed * speed + pull
        low = max(low, bound_below(ga, pa, pb, span, pull, push))
        low = max(low, bound_below(gb, -pb, -pa, span, pull, push))
        high = min(high, -bound_below(-ga, -pa, -pb, span, push, pull))
        high = min(high, -bound_below(-gb, pb, pa, span, push, pull))
        low, high = min(low, min(ga, gb)), max(high, max(ga, gb))
        x, y = slope_range(pa, pb, span, pull, push)
        p_low, p_high = max(p_low, x), min(p_high, y)
    f_low, f_high, d_low, d_high = field_hull(low, high, p_low, p_high, inverse, w)
    if begin > a or end < b:
        f_low, f_high, d_low, d_high = (
            min(f_low, 0.0),
            max(f_high, 0.0),
            min(d_low, 0.0),
            max(d_high, 0.0),
        )
    return f_low, f_high, d_low, d_high


@njit(contract=True, inline=True)
def leaf_hull(
    m: Tables, work: Work, k: int, a: float, b: float
) -> tuple[float, float, float, float]:
    """Return bounds of the field of the k-th primitive that the ray meets, on [a, b]."""
    h, at, kind = work.floats, MET * k, work.ints[KINDS * work.room + k]
    if h[at + H_ROW] >= 0.0:
        return warped_hull(m, kind, h, at, a, b)
    d = Vec3(h[at + DIRECTION], h[at + DIRECTION + 1], h[at + DIRECTION + 2])
    inverse, w = h[at + H_INVERSE], h[at + H_WEIGHT]
    ga, pa, g, slope, t = 0.0, 0.0, 0.0, 0.0, a
    for _ in range(2):
        # First at a, then at b.
        s = t - h[at + NEAREST]
        p = Vec3(h[at] + s * d.x, h[at + 1] + s * d.y, h[at + 2] + s * d.z)
        ga, pa = g, slope
        g, slope = skeleton_distance(kind, p, d, h, at + H_CONSTANT, m.floats)
        if a == b and kind >= DIRECT:
            return weigh(w, g, g, slope, slope)
        if a == b:
            return field_hull(g, g, slope, slope, inverse, w)
        t = b
    if kind >= DIRECT:
        f_low, f_high, d_low, d_high = smooth_hull(
            ga, pa, g, slope, b - a, h[at + H_ACCELERATION], h[at + H_SPEED]
        )
        return weigh(w, f_low, f_high, d_low, d_high)
    low, high, p_low, p_high = convex_hull(ga, pa, g, slope, b - a, h[at + H_SPEED])
    return field_hull(low, high, p_low, p_high, inverse, w)


@njit(contract=True, inline=True)
def close_operator(m: Tables, work: Work, top: int, n: int) -> tuple[int, int]:
    """Make one value of those of the topmost open operator, for its parent.

    Returns the topmost frame and the number of values; -1 where the root has been closed.
    """
    values, slots, frames = work.floats, work.ints, FRAMES * work.room + 2 * top
    first = SLOTS * work.room
    op, base = slots[frames], slots[frames + 1]
    at, ints = m.operators + OPERATOR * op, m.ints
    # A single child is handed on, its positive part unless by a sum.
    what = wide(ints[at + WHAT])
    negative = values[4 * (first + base)] < 0.0 and what & KIND != SUM
    if n - base > 1 or negative or what & ANCHOR != 0:
        args = m.f + wide(ints[at + ARGS])
        blend_hull(
            what & KIND,
            values,
            slots,
            first + base,
            n - base,
            m.floats,
            args,
            4 * first,
        )
    slots[first + base] = what // SLOT
    up = wide(ints[at + UP])
    if up < 0 or (top > 0 and slots[frames - 2] == up):
        return top - 1, base + 1
    slots[frames] = up
    return top, base + 1


@njit(contract=True, inline=True)
def hull(
    m: Tables, work: Work, begin: int, count: int, a: float, b: float
) -> tuple[float, float, float, float]:
    """Return least and greatest value and slope of the field on [a, b] of the ray.

    Parameters
    ----------
    begin, count
        ``work.ints[begin:]`` lists what the ray meets there, depth first.
    """
    values, ints, ops = work.floats, work.ints, m.ints
    frames, first = FRAMES * work.room, SLOTS * work.room
    values[4 * first] = 0.0
    top, n = -1, 1
    for q in range(begin, begin + count + 1):
        # Behind the last primitive all operators are closed.
        i, op = NOBODY, wide(-1)
        low, high, d_low, d_high = 0.0, 0.0, 0.0, 0.0
        if q < begin + count:
            k = ints[q]
            low, high, d_low, d_high = leaf_hull(m, work, k, a, b)
            if low == 0.0 and high == 0.0:
                continue
            i = ints[k]
            op = wide(ops[m.primitives + PRIMITIVE * i + PARENT])
        while top >= 0:
            present = ints[frames + 2 * top]
            if i < ops[m.operators + OPERATOR * present + END]:
                break
            if i == NOBODY and top == 0 and n == 2 and values[4 * (first + 1)] >= 0.0:
                # A single value: nothing happens to it before the next anchor.
                what = wide(ops[m.operators + OPERATOR * present + WHAT])
                if what & LOOSE != 0:
                    top = -1
                    break
                # It comes through the child of the anchor that it is found in.
                while what & ANCHOR == 0:
                    ints[first + 1] = what // SLOT
                    present = wide(ops[m.operators + OPERATOR * present + UP])
                    what = wide(ops[m.operators + OPERATOR * present + WHAT])
                ints[frames] = present
            top, n = close_operator(m, work, top, n)
        if i == NOBODY:
            break
        if top < 0 or ints[frames + 2 * top] != op:
            top += 1
            ints[frames + 2 * top], ints[frames + 2 * top + 1] = op, n
        at = 4 * (first + n)
        values[at], values[at + 1], values[at + 2], values[at + 3] = low, high, d_low, d_high
        ints[first + n] = 0
        n += 1
    if n == 1:
        return 0.0, 0.0, 0.0, 0.0
    at = 4 * (first + 1)
    return values[at], values[at + 1], values[at + 2], values[at + 3]
