"""Sums, powers and set operations of fields."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pcsg.blobtree.blend import (
    Array,
    Blend,
    Slots,
    blend,
    find_slot,
    greatest_hull,
    product,
    put,
    take_positive_parts,
)
from pcsg.blobtree.fields import T
from pcsg.errors import UsageError


@blend
class Sum(Blend):
    """``a + b``: the sum of the fields; they blend smoothly. Negative weights dig."""

    flat = True

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        low, high, d_low, d_high = 0.0, 0.0, 0.0, 0.0
        for b in range(4 * base, 4 * (base + n), 4):
            low += values[b]
            high += values[b + 1]
            d_low += values[b + 2]
            d_high += values[b + 3]
        put(values, base, low, high, d_low, d_high)
        return 0


@blend
class Weight(Blend):
    """``weight(w)``: the field times a factor."""

    alone = False

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        b, w = 4 * base, args[at]
        low, high, d_low, d_high = values[b], values[b + 1], values[b + 2], values[b + 3]
        if w < 0.0:
            low, high, d_low, d_high = high, low, d_high, d_low
        put(values, base, w * low, w * high, w * d_low, w * d_high)
        return 0


@blend
class Union(Blend):
    """``a | b``: the greatest field."""

    flat = True

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        low, high, d_low, d_high = greatest_hull(values, base, n)
        put(values, base, low, high, d_low, d_high)
        return 0


@blend
class Intersect(Blend):
    """``a & b``: the least field; nothing where one is missing."""

    alone = False
    flat = True

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        return [float(count)]

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        if n < args[at]:
            put(values, base, 0.0, 0.0, 0.0, 0.0)
            return 0
        take_positive_parts(values, base, n)
        low, most, d_low, d_high = math.inf, math.inf, math.inf, -math.inf
        for b in range(4 * base, 4 * (base + n), 4):
            low = min(low, values[b])
            most = min(most, values[b + 1])
        for b in range(4 * base, 4 * (base + n), 4):
            if values[b] <= most:
                d_low = min(d_low, values[b + 2])
                d_high = max(d_high, values[b + 3])
        put(values, base, low, most, d_low, d_high)
        return 0


@blend
class Subtract(Blend):
    r"""``a \ b``: min(a, 2T - b); a alone where there is no b, nothing without a.

    Where a is above 2T, inside of a blend, 2T is raised to a, so that the field has no jump
    where b begins; the surface is the same.
    """

    alone = False
    slotted = True

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        a, b = 4 * find_slot(slots, base, n, 0), 4 * find_slot(slots, base, n, 1)
        if a < 0:
            put(values, base, 0.0, 0.0, 0.0, 0.0)
            return 0
        low, high, d_low, d_high = values[a], values[a + 1], values[a + 2], values[a + 3]
        if b >= 0:
            # c = T + (max(a, 2T) - T) (T - b) / T
            k_low, k_high = max(low, 2.0 * T) / T - 1.0, max(high, 2.0 * T) / T - 1.0
            b_low, b_high = T - values[b + 1], T - values[b]
            c_low, c_high = product(k_low, k_high, b_low, b_high)
            c_low, c_high = T + c_low, T + c_high
            e_low, e_high = product(k_low, k_high, -values[b + 3], -values[b + 2])
            if low > 2.0 * T:
                x, y = product(d_low, d_high, b_low / T, b_high / T)
                e_low, e_high = e_low + x, e_high + y
            elif high > 2.0 * T:
                x, y = product(min(d_low, 0.0), max(d_high, 0.0), b_low / T, b_high / T)
                e_low, e_high = e_low + min(x, 0.0), e_high + max(y, 0.0)
            if c_high < low:
                low, high, d_low, d_high = c_low, c_high, e_low, e_high
            elif c_low <= high:
                low, high = min(low, c_low), min(high, c_high)
                d_low, d_high = min(d_low, e_low), max(d_high, e_high)
        put(values, base, low, high, d_low, d_high)
        take_positive_parts(values, base, 1)
        return 0


@blend
class Ricci(Blend):
    """``ricci(n)``: (sum a^n)^(1/n); n = 1 is the sum, large n nearly the greatest (Ricci 1973)."""

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        if len(args) != 1 or not 1.0 <= args[0] <= 1000.0:
            raise UsageError("ricci takes one number between 1 and 1000")
        return [*args]

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        e = args[at]
        # Over the greatest, so that powers stay in range.
        top_low, top_high = 0.0, 0.0
        for b in range(4 * base, 4 * (base + n), 4):
            top_low, top_high = max(top_low, values[b]), max(top_high, values[b + 1])
        sum_low, sum_high = 0.0, 0.0
        for b in range(4 * base, 4 * (base + n), 4):
            if top_low > 0.0:
                sum_low += (values[b] / top_low) ** e
            if top_high > 0.0:
                sum_high += (values[b + 1] / top_high) ** e
        low, high = top_low * sum_low ** (1.0 / e), top_high * sum_high ** (1.0 / e)
        d_low, d_high = 0.0, 0.0
        for b in range(4 * base, 4 * (base + n), 4):
            # dF/da = (a / F)^(n-1): greatest with a great and the others small.
            f_low, f_high = values[b], values[b + 1]
            w_low = (f_low / high) ** (e - 1.0) if high > 0.0 else 1.0
            w_high = 1.0
            if f_high < low:
                w_high = (f_high / low) ** (e - 1.0)
            elif f_high > 0.0 and top_low > 0.0:
                others = max(sum_low - (f_low / top_low) ** e, 0.0)
                w_high = (1.0 + others * (top_low / f_high) ** e) ** (1.0 / e - 1.0)
            x, y = product(min(w_low, w_high), w_high, values[b + 2], values[b + 3])
            d_low += x
            d_high += y
        put(values, base, low, high, d_low, d_high)
        return 0
