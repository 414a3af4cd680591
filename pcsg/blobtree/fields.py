"""The field of a skeleton, and bounds of values and slopes on an interval of a ray.

``f(d) = (1 - d2/R2)3`` for d < R, else 0 (Wyvill, Guy, Galin 1999). Along a line the squared
distance g to a convex set is convex, continuously differentiable, and 0 <= g'' <= 2 |direction|2;
so g and g' at the two ends of an interval bound g, and with it f and f', between them. A curve
through a warp has other bounds of g'', and the same reasoning holds.
"""

from __future__ import annotations

import math

from pcsg.jit import njit

T = 0.5
"""The solid is where the field is T or more."""

LEVEL = math.sqrt(1.0 - T ** (1.0 / 3.0))
"""Distance over reach at which a lone primitive has the value T."""

REACH = 1.0 / LEVEL
"""Reach of a primitive that alone shall have radius 1."""


@njit(contract=True)
def bound_below(va: float, da: float, db: float, h: float, m: float, k: float) -> float:
    """Return a lower bound of a function on [0, h] from its value and slope at 0, its slope at h.

    Its second derivative lies in [-m, k]. The slope is at least the larger of two lines, which
    start at its ends; the bound is the least value of their integral.
    """
    if m + k <= 0.0:
        return va + min(0.0, da * h)
    x = min(max((da - db + k * h) / (m + k), 0.0), h)
    falls = da * x - 0.5 * m * x * x
    least = min(0.0, falls)
    # From x on the slope is at least db - k (h - s), which passes zero at h - db / k.
    turn = min(max(h - db / k, x), h) if k > 0.0 else h
    at_x, at_turn = db - k * (h - x), db - k * (h - turn)
    least = min(least, falls + 0.5 * (at_x + at_turn) * (turn - x))
    return va + least


@njit(contract=True)
def slope_range(da: float, db: float, h: float, m: float, k: float) -> tuple[float, float]:
    """Return bounds of the slope on [0, h] from its ends; the second derivative is in [-m, k]."""
    if m + k <= 0.0:
        return min(da, db), max(da, db)
    x = min(max((da - db + k * h) / (m + k), 0.0), h)
    y = min(max((db - da + m * h) / (m + k), 0.0), h)
    return min(da - m * x, min(da, db)), max(da + k * y, max(da, db))


@njit(contract=True)
def smooth_hull(
    va: float, da: float, vb: float, db: float, h: float, m: float, k: float
) -> tuple[float, float, float, float]:
    """Return bounds of a function and its slope: least, greatest, least slope, greatest slope."""
    low = max(bound_below(va, da, db, h, m, k), bound_below(vb, -db, -da, h, m, k))
    high = -max(bound_below(-va, -da, -db, h, k, m), bound_below(-vb, db, da, h, k, m))
    slope_low, slope_high = slope_range(da, db, h, m, k)
    return min(low, min(va, vb)), max(high, max(va, vb)), slope_low, slope_high


@njit(contract=True)
def convex_hull(
    ga: float, pa: float, gb: float, pb: float, h: float, k: float
) -> tuple[float, float, float, float]:
    """Return the same for a convex function, more tightly: its second derivative is in [0, k]."""
    if pa >= 0.0:
        low = ga
    elif pb <= 0.0:
        low = gb
    else:
        # The slope rises from pa to pb with k at most; the rest of h it may rest at zero.
        low = max(ga - 0.5 * pa * pa / k, gb - 0.5 * pb * pb / k)
        spare = h - (pb - pa) / k
        if spare > 0.0:
            low = max(ga + pa * spare - 0.5 * pa * pa / k, gb - pb * spare - 0.5 * pb * pb / k)
            low = min(low, min(ga, gb))
    return low, max(ga, gb), pa, pb


@njit(contract=True)
def field_hull(
    low: float, high: float, slope_low: float, slope_high: float, r: float, w: float
) -> tuple[float, float, float, float]:
    """Return bounds of w f and its slope from those of the squared distance; r is 1 / R2."""
    uh = 1.0 - max(low, 0.0) * r
    if uh <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    ul = max(1.0 - high * r, 0.0)
    uh2, ul2 = uh * uh, ul * ul
    k = 3.0 * r
    f_low, f_high = ul2 * ul, uh2 * uh
    d_low = -k * slope_high * (uh2 if slope_high > 0.0 else ul2)
    d_high = -k * slope_low * (uh2 if slope_low < 0.0 else ul2)
    if w == 1.0:
        return f_low, f_high, d_low, d_high
    if w < 0.0:
        return w * f_high, w * f_low, w * d_high, w * d_low
    return w * f_low, w * f_high, w * d_low, w * d_high
