"""R-functions of fields: union and intersection without the crease of the greatest."""

from __future__ import annotations

import math

from pcsg.blobtree.blend import Array, Blend, Slots, blend, product, put, take_positive_parts
from pcsg.blobtree.fields import T
from pcsg.jit import njit


@njit(contract=True)
def r_slopes(x_low: float, x_high: float, y_low: float, y_high: float) -> tuple[float, float]:
    """Return the range of x / sqrt(x2 + y2); [-1, 1] where both may be zero."""
    y_near = 0.0 if y_low <= 0.0 <= y_high else min(abs(y_low), abs(y_high))
    y_far = max(abs(y_low), abs(y_high))
    if y_near == 0.0 and x_low <= 0.0 <= x_high:
        return -1.0, 1.0
    low = x_low / math.hypot(x_low, y_near if x_low < 0.0 else y_far) if x_low != 0.0 else 0.0
    high = x_high / math.hypot(x_high, y_near if x_high > 0.0 else y_far) if x_high != 0.0 else 0.0
    return low, high


R_UNION_END = -(2.0 - math.sqrt(2.0)) * T
"""The R-union where both fields are zero."""

R_UNION_CURVE = -(T + R_UNION_END) / (R_UNION_END * R_UNION_END)


@blend
class R_union(Blend):  # noqa: N801 -- its name in the language has an underscore
    """``r_union``: a + b + sqrt(a2 + b2) of the fields less T (Pasko): a union without crease.

    Mapped back so that T stays T and nothing stays nothing. More than two are nested.
    """

    alone = False

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        b = 4 * base
        a0, a1, pa0, pa1 = values[b] - T, values[b + 1] - T, values[b + 2], values[b + 3]
        c0, c1, pc0, pc1 = -T, -T, 0.0, 0.0
        if n > 1:
            c0, c1, pc0, pc1 = values[b + 4] - T, values[b + 5] - T, values[b + 6], values[b + 7]
        # Monotone in both.
        low, high = a0 + c0 + math.hypot(a0, c0), a1 + c1 + math.hypot(a1, c1)
        u, v = r_slopes(a0, a1, c0, c1)
        x0, x1 = product(1.0 + u, 1.0 + v, pa0, pa1)
        u, v = r_slopes(c0, c1, a0, a1)
        y0, y1 = product(1.0 + u, 1.0 + v, pc0, pc1)
        k_low = 1.0 + 2.0 * R_UNION_CURVE * min(high, 0.0)
        k_high = 1.0 + 2.0 * R_UNION_CURVE * min(low, 0.0)
        d_low, d_high = product(min(k_low, k_high), max(k_low, k_high), x0 + y0, x1 + y1)
        low = T + low + (R_UNION_CURVE * low * low if low < 0.0 else 0.0)
        high = T + high + (R_UNION_CURVE * high * high if high < 0.0 else 0.0)
        put(values, base, max(low, 0.0), max(high, 0.0), d_low, d_high)
        return 0


@blend
class R_intersect(Blend):  # noqa: N801 -- its name in the language has an underscore
    """``r_intersect``: a + b - sqrt(a2 + b2) of the fields less T (Pasko).

    Mapped back so that T stays T; nothing where one has no field. More than two are nested.
    """

    alone = False

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        b = 4 * base
        if n < 2 or values[b + 1] <= 0.0 or values[b + 5] <= 0.0:
            put(values, base, 0.0, 0.0, 0.0, 0.0)
            return 0
        a0, a1, c0, c1 = values[b] - T, values[b + 1] - T, values[b + 4] - T, values[b + 5] - T
        low, high = a0 + c0 - math.hypot(a0, c0), a1 + c1 - math.hypot(a1, c1)
        u, v = r_slopes(a0, a1, c0, c1)
        x0, x1 = product(1.0 - v, 1.0 - u, values[b + 2], values[b + 3])
        u, v = r_slopes(c0, c1, a0, a1)
        y0, y1 = product(1.0 - v, 1.0 - u, values[b + 6], values[b + 7])
        # T (2 u2 - u3), u = 1 + r / T, from r = -T to 0: from no field to T, smoothly.
        u0, u1 = min(max(1.0 + low / T, 0.0), 1.0), min(max(1.0 + high / T, 0.0), 1.0)
        k0, k1 = (4.0 - 3.0 * u0) * u0, (4.0 - 3.0 * u1) * u1
        k_high = 4.0 / 3.0 if u0 < 2.0 / 3.0 < u1 else max(k0, k1)
        d_low, d_high = product(min(k0, k1), k_high, x0 + y0, x1 + y1)
        low = T + low if low > 0.0 else T * (2.0 - u0) * u0 * u0
        high = T + high if high > 0.0 else T * (2.0 - u1) * u1 * u1
        put(values, base, low, high, d_low, d_high)
        return 0
