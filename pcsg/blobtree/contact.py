"""Precise contact: branches that press each other flat and swell beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.blobtree.blend import (
    Array,
    Blend,
    Slots,
    blend,
    greatest_hull,
    product,
    put,
    take_positive_parts,
)
from pcsg.blobtree.fields import T
from pcsg.errors import UsageError
from pcsg.jit import njit


@njit(contract=True)
def propagation(x: float, w: float, a0: float) -> tuple[float, float]:
    """Return the swelling h beside a contact and h', for x = T - f_other in [0, w]; else 0."""
    if x <= 0.0 or x >= w:
        return 0.0, 0.0
    if x < 0.5 * w:
        c2, c3 = 4.0 * (3.0 * a0 - w) / (w * w), 4.0 * (w - 4.0 * a0) / (w * w * w)
        return ((c3 * x + c2) * x + 1.0) * x, (3.0 * c3 * x + 2.0 * c2) * x + 1.0
    k, y = 4.0 * a0 / (w * w * w), x - w
    return k * y * y * (4.0 * x - w), 6.0 * k * y * (2.0 * x - w)


@njit(contract=True)
def swelling_hull(x0: float, x1: float, w: float, a0: float) -> tuple[float, float, float, float]:
    """Return least and greatest h and h' on [x0, x1], x1 > 0, x0 < w; 0 outside of [0, w]."""
    a, b = max(x0, 0.0), min(x1, w)
    h0, s0 = propagation(a, w, a0)
    h1, s1 = propagation(b, w, a0)
    if a == 0.0:
        s0 = 1.0
    low, high = min(h0, h1), max(h0, h1)
    s_low, s_high = min(s0, s1), max(s0, s1)
    half = 0.5 * w
    if a <= half <= b:
        high = max(high, a0)
        s_low, s_high = min(s_low, 0.0), max(s_high, 0.0)
    # h' is a parabola on either half: its turns.
    c2, c3 = 4.0 * (3.0 * a0 - w) / (w * w), 4.0 * (w - 4.0 * a0) / (w * w * w)
    if c3 != 0.0:
        turn = -c2 / (3.0 * c3)
        if max(a, 0.0) < turn < min(b, half):
            s = (3.0 * c3 * turn + 2.0 * c2) * turn + 1.0
            s_low, s_high = min(s_low, s), max(s_high, s)
    if a < 0.75 * w < b:
        s_low = min(s_low, -3.0 * a0 / w)
    if x0 < 0.0 or x1 > w:
        low, s_low, s_high = 0.0, min(s_low, 0.0), max(s_high, 0.0)
    return low, high, s_low, s_high


@njit(contract=True)
def contact_hull(
    values: Array, base: int, n: int, w: float, a0: float
) -> tuple[float, float, float, float]:
    """Return the bounds of precise contact of n children of positive fields."""
    end = 4 * (base + n)
    least = 0.0
    for b in range(4 * base, end, 4):
        least = max(least, values[b])
    low, high, d_low, d_high = math.inf, -math.inf, math.inf, -math.inf
    for i in range(4 * base, end, 4):
        # i may be the greatest. What of its field is left between the pressing others...
        if values[i + 1] < least:
            continue
        i_low, i_high = max(values[i], least), values[i + 1]
        press_low, press_high, swell_low, swell_high = 0.0, 0.0, 0.0, 0.0
        p_low, p_high, s_low, s_high = 0.0, 0.0, 0.0, 0.0
        others = 0
        for j in range(4 * base, end, 4):
            j_low, j_high = values[j], min(values[j + 1], i_high)
            if j == i or T - j_high >= w:
                continue
            others += 1
            if j_high > T:
                press_low += T - j_high
                press_high += min(T - j_low, 0.0)
                q_low, q_high = -values[j + 3], -values[j + 2]
                if j_low < T:
                    q_low, q_high = min(q_low, 0.0), max(q_high, 0.0)
                p_low += q_low
                p_high += q_high
            # ... and the greatest swelling beside them.
            if j_low < T:
                h_low, h_high, r_low, r_high = swelling_hull(T - j_high, T - j_low, w, a0)
                swell_low, swell_high = max(swell_low, h_low), max(swell_high, h_high)
        if others == 1 and press_low < 0.0 and swell_high > 0.0:
            # One other: both parts are one function of it, which is smooth.
            for j in range(4 * base, end, 4):
                j_high = min(values[j + 1], i_high)
                if j != i and T - j_high < w:
                    h_low, h_high, r_low, r_high = swelling_hull(0.0, T - values[j], w, a0)
                    r_low, r_high = min(r_low, 1.0), max(r_high, 1.0)
                    p_low, p_high = product(-r_high, -r_low, values[j + 2], values[j + 3])
        elif swell_high > 0.0:
            s_low, s_high = math.inf, -math.inf
            if swell_low == 0.0:
                s_low, s_high = 0.0, 0.0
            for j in range(4 * base, end, 4):
                j_high = min(values[j + 1], i_high)
                if j != i and T - j_high < w and values[j] < T:
                    h_low, h_high, r_low, r_high = swelling_hull(T - j_high, T - values[j], w, a0)
                    if h_high >= swell_low:
                        x, y = product(-r_high, -r_low, values[j + 2], values[j + 3])
                        s_low, s_high = min(s_low, x), max(s_high, y)
        lowest, highest = i_low, i_high
        # Where others press, T is kept on the sheet of contact: differences first.
        if press_low < 0.0:
            lowest = min(i_low, max(T, T + (i_low - T) + press_low))
        if press_high < 0.0:
            highest = max(T, T + ((i_high - T) + press_high))
        c_low, c_high = values[i + 2] + p_low, values[i + 3] + p_high
        if others > 1 and press_low < 0.0 and (i_low - T) + press_low < 0.0:
            # Three and more in contact: where all is pressed away, only the swelling changes.
            c_low, c_high = min(c_low, 0.0), max(c_high, 0.0)
        low, high = min(low, lowest + swell_low), max(high, highest + swell_high)
        d_low, d_high = min(d_low, c_low + s_low), max(d_high, c_high + s_high)
    return low, high, d_low, d_high


W0 = 0.4
"""Default width of the swelling beside a contact, as a difference of field values."""


def contact_arguments(args: Sequence[float]) -> list[float]:
    """Return width and height of the swelling; the height is a sixth of the width by default."""
    w = args[0] if args else W0
    a0 = args[1] if len(args) > 1 else w / 6.0
    if not 0.0 < w <= T:
        raise UsageError(f"pcm: w must be > 0 and at most {T:g}, is {w:g}")
    if not 0.0 <= a0 <= w:
        raise UsageError(f"pcm: a0 must lie between 0 and w, is {a0:g}")
    return [w, a0]


@blend
class Pcm(Blend):
    """``pcm(w, a0)``: precise contact: children press each other flat and swell beside it.

    Galbraith, MacMurchy, Wyvill 2004 eq. 3 for two, in a form that does not depend on the order of
    its children for more. On the sheet of contact inside the solid the field is T exactly.
    """

    defaults = (W0, W0 / 6.0)

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        return contact_arguments(args)

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        low, high, d_low, d_high = contact_hull(values, base, n, args[at], args[at + 1])
        put(values, base, low, high, d_low, d_high)
        return 0


@blend
class Excess(Blend):
    """Precise contact less the sum, or less the union: what a junction's bound mixes in.

    Inside of `Joint` only. The third number is 1 for the union.
    """

    alone = False

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        return [*contact_arguments(args[:2]), args[2] if len(args) > 2 else 0.0]

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        if n == 1:
            put(values, base, 0.0, 0.0, 0.0, 0.0)
            return 0
        low, high, d_low, d_high = contact_hull(values, base, n, args[at], args[at + 1])
        if args[at + 2] == 1.0:
            least, most, s_low, s_high = greatest_hull(values, base, n)
            put(values, base, low - most, high - least, d_low - s_high, d_high - s_low)
            return 0
        for b in range(4 * base, 4 * (base + n), 4):
            low -= values[b + 1]
            high -= values[b]
            d_low -= values[b + 3]
            d_high -= values[b + 2]
        put(values, base, low, high, d_low, d_high)
        return 0
