"""Operators of the BlobTree: what is made of the fields of the children, one class each.

An operator is one kernel, ``hull``: from bounds of its children's values and slopes on an interval
of a ray it makes bounds of its own. On an interval of no length that is the value itself. Children
without a field there are not among those it is given; their value is 0.

==============  ===============================================================================
values          float64: the children's, four numbers each from ``values[4 base]``: least and
                greatest value, least and greatest slope. The result replaces the first.
slots           int64: which child it is, from ``slots[base]``
n               the number of children that are given, at least 1
args, at        float64: the operator's numbers begin at ``args[at]``
out             ``values[out]`` is raised to the share of a bound, for attributes
==============  ===============================================================================

All but sum, weight and excess first take the positive part of their children.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.fields import T
from pcsg.errors import UsageError
from pcsg.jit import build_ladder, njit

Array = NDArray[np.float64]
Slots = NDArray[np.int64]


class Blend:
    """An operator of the BlobTree.

    Class attributes
    ----------------
    alone
        Whether the value with a single child is that child's positive part.
    flat
        Whether nested ones are one.
    slotted
        Whether it matters which child is which.
    """

    name: ClassVar[str]
    kind: ClassVar[int]
    alone: ClassVar[bool] = True
    flat: ClassVar[bool] = False
    slotted: ClassVar[bool] = False
    defaults: ClassVar[tuple[float, ...]] = ()

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        """Return what the kernel reads, for a number of children; raise if it can not be."""
        return [*args]

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        """Replace the first child's bounds by the operator's; the return value means nothing."""
        raise NotImplementedError


BLENDS: dict[str, type[Blend]] = {}
"""Every operator by its name."""

B = TypeVar("B", bound=type[Blend])


def blend(cls: B) -> B:
    """Register an operator under the name of its class in lower case."""
    cls.name = cls.__name__.lower()
    cls.kind = len(BLENDS)
    BLENDS[cls.name] = cls
    return cls


@njit(contract=True)
def put(values: Array, base: int, low: float, high: float, d_low: float, d_high: float) -> None:
    """Write a result."""
    b = 4 * base
    values[b], values[b + 1], values[b + 2], values[b + 3] = low, high, d_low, d_high


@njit(contract=True)
def take_positive_parts(values: Array, base: int, n: int) -> None:
    """Replace every child by max(child, 0)."""
    for b in range(4 * base, 4 * (base + n), 4):
        if values[b] < 0.0:
            values[b] = 0.0
            values[b + 2] = min(values[b + 2], 0.0)
            values[b + 3] = max(values[b + 3], 0.0)
            if values[b + 1] <= 0.0:
                values[b + 1], values[b + 2], values[b + 3] = 0.0, 0.0, 0.0


@njit(contract=True)
def product(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return the interval [a, b] [c, d]."""
    w, x, y, z = a * c, a * d, b * c, b * d
    return min(min(w, x), min(y, z)), max(max(w, x), max(y, z))


@njit(contract=True)
def find_slot(slots: Slots, base: int, n: int, slot: int) -> int:
    """Return which of the given children is a certain one, -1 if it has no field here."""
    for k in range(base, base + n):
        if slots[k] == slot:
            return k
    return -1


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


@njit(contract=True)
def greatest_hull(values: Array, base: int, n: int) -> tuple[float, float, float, float]:
    """Return the bounds of the greatest of n children of positive fields."""
    least, high, d_low, d_high = 0.0, 0.0, math.inf, -math.inf
    for b in range(4 * base, 4 * (base + n), 4):
        least = max(least, values[b])
        high = max(high, values[b + 1])
    for b in range(4 * base, 4 * (base + n), 4):
        if values[b + 1] >= least:
            d_low = min(d_low, values[b + 2])
            d_high = max(d_high, values[b + 3])
    return least, high, d_low, d_high


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


@blend
class Gbb(Blend):
    """``gbb { bound } { B1 } { B2 }``: B2 + b (B1 - B2), b the bound clamped to [0, 1].

    Generalised bounded blending (Galbraith, Muendermann, Wyvill 2004, eq. 4).
    """

    alone = False
    slotted = True

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        bound = 4 * find_slot(slots, base, n, 0)
        b_low, b_high, e_low, e_high = 0.0, 0.0, 0.0, 0.0
        if bound >= 0:
            b_low, b_high = min(values[bound], 1.0), min(values[bound + 1], 1.0)
            if values[bound] < 1.0:
                e_low, e_high = values[bound + 2], values[bound + 3]
                if values[bound + 1] > 1.0:
                    e_low, e_high = min(e_low, 0.0), max(e_high, 0.0)
        values[out] = max(values[out], b_high)
        one, two = 4 * find_slot(slots, base, n, 1), 4 * find_slot(slots, base, n, 2)
        f_low, f_high, p_low, p_high = 0.0, 0.0, 0.0, 0.0
        if one >= 0:
            f_low, f_high, p_low, p_high = (
                values[one],
                values[one + 1],
                values[one + 2],
                values[one + 3],
            )
        g_low, g_high, q_low, q_high = 0.0, 0.0, 0.0, 0.0
        if two >= 0:
            g_low, g_high, q_low, q_high = (
                values[two],
                values[two + 1],
                values[two + 2],
                values[two + 3],
            )
        if b_high == 0.0:
            put(values, base, g_low, g_high, q_low, q_high)
            return 0
        # Linear in each: extremes are at the corners.
        low = min(g_low + b_low * (f_low - g_low), g_low + b_high * (f_low - g_low))
        high = max(g_high + b_low * (f_high - g_high), g_high + b_high * (f_high - g_high))
        d_low = min(q_low + b_low * (p_low - q_low), q_low + b_high * (p_low - q_low))
        d_high = max(q_high + b_low * (p_high - q_high), q_high + b_high * (p_high - q_high))
        x, y = product(e_low, e_high, f_low - g_high, f_high - g_low)
        put(values, base, low, high, d_low + x, d_high + y)
        return 0


@blend
class Joint(Blend):
    """Junctions on a continuing axis: S + beta sum b_k e_k, beta = (1 - prod (1 - b_k)) / sum b_k.

    Child 0 is the sum S; children 2k + 1 and 2k + 2 are the bound b_k and the `Excess` e_k of a
    junction. For one bound this is generalised bounded blending of contact and sum; several that
    overlap cannot dig holes.
    """

    alone = False
    slotted = True

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        s_low, s_high, d_low, d_high = 0.0, 0.0, 0.0, 0.0
        # Over the bounds: least and greatest of their sum and of prod (1 - b), and sum b e.
        b_low, b_high, free_low, free_high = 0.0, 0.0, 1.0, 1.0
        db_low, db_high = 0.0, 0.0
        e_low, e_high, de_low, de_high = 0.0, 0.0, 0.0, 0.0
        count = 0
        for k in range(base, base + n):
            b = 4 * k
            if slots[k] == 0:
                s_low, s_high, d_low, d_high = (
                    values[b],
                    values[b + 1],
                    values[b + 2],
                    values[b + 3],
                )
            elif slots[k] & 1:
                # Depth first, a bound stands just before its excess.
                take_positive_parts(values, k, 1)
                low, high = min(values[b], 1.0), min(values[b + 1], 1.0)
                p_low, p_high = values[b + 2], values[b + 3]
                if values[b + 1] >= 1.0:
                    p_low, p_high = min(p_low, 0.0), max(p_high, 0.0)
                if high <= 0.0:
                    continue
                count += 1
                b_low, b_high = b_low + low, b_high + high
                free_low, free_high = free_low * (1.0 - high), free_high * (1.0 - low)
                db_low, db_high = db_low + p_low, db_high + p_high
                if k + 1 < base + n and slots[k + 1] == slots[k] + 1:
                    c = b + 4
                    x, y = product(low, high, values[c], values[c + 1])
                    e_low, e_high = e_low + x, e_high + y
                    x, y = product(low, high, values[c + 2], values[c + 3])
                    u, v = product(p_low, p_high, values[c], values[c + 1])
                    de_low, de_high = de_low + x + u, de_high + y + v
        if count == 0:
            put(values, base, s_low, s_high, d_low, d_high)
            return 0
        values[out] = max(values[out], 1.0 - free_low)
        if count == 1:
            put(values, base, s_low + e_low, s_high + e_high, d_low + de_low, d_high + de_high)
            return 0
        beta_low = (1.0 - free_low) / b_high
        beta_high = min(1.0, (1.0 - free_high) / b_low) if b_low > 0.0 else 1.0
        beta_low = min(beta_low, beta_high)
        # d beta / d b_k = (prod of the others' (1 - b) - beta) / sum b, in [-1, 0].
        c_low, c_high = 0.0, 0.0
        for k in range(base, base + n):
            b = 4 * k
            if slots[k] & 1 and values[b + 1] > 0.0:
                p_low, p_high = values[b + 2], values[b + 3]
                if values[b + 1] >= 1.0:
                    p_low, p_high = min(p_low, 0.0), max(p_high, 0.0)
                low, high = 1.0, 1.0
                for j in range(base, base + n):
                    if j != k and slots[j] & 1:
                        low *= 1.0 - min(values[4 * j + 1], 1.0)
                        high *= 1.0 - min(values[4 * j], 1.0)
                r_low, r_high = low - beta_high, min(high - beta_low, 0.0)
                r_low = max(-1.0, r_low / b_low) if b_low > 0.0 else -1.0
                r_high = r_high / b_high
                x, y = product(min(r_low, r_high), r_high, p_low, p_high)
                c_low, c_high = c_low + x, c_high + y
        x, y = product(beta_low, beta_high, e_low, e_high)
        u, v = product(beta_low, beta_high, de_low, de_high)
        r_low, r_high = product(c_low, c_high, e_low, e_high)
        put(values, base, s_low + x, s_high + y, d_low + u + r_low, d_high + v + r_high)
        return 0


def find_cliques(neighbours: list[set[int]]) -> list[list[int]]:
    """Return the largest sets of which every pair is allowed (Bron and Kerbosch 1973)."""
    cliques: list[list[int]] = []
    todo: list[tuple[set[int], set[int], set[int]]] = [(set(), set(range(len(neighbours))), set())]
    while todo:
        members, candidates, excluded = todo.pop()
        if not candidates and not excluded:
            cliques.append(sorted(members))
        for v in sorted(candidates):
            near = neighbours[v]
            todo.append((members | {v}, candidates & near, excluded & near))
            candidates, excluded = candidates - {v}, excluded | {v}
    return sorted(cliques)


@blend
class Controlled(Blend):
    """``controlled``: children blend with their neighbours in the list, others only touch.

    The greatest sum over sets of children of which every pair may blend (controlled blending, Guy
    and Wyvill 1995); in Python the graph of pairs may be any.
    """

    alone = True
    slotted = True

    @classmethod
    def arguments(cls, args: Sequence[float], count: int) -> list[float]:
        pairs = [(i, i + 1) for i in range(count - 1)]
        if args:
            pairs = [(int(i), int(j)) for i, j in zip(args[::2], args[1::2], strict=True)]
        neighbours: list[set[int]] = [set() for _ in range(count)]
        for i, j in pairs:
            if not (0 <= i < count and 0 <= j < count) or i == j:
                raise UsageError(f"controlled: there is no pair ({i}, {j}) of {count} children")
            neighbours[i].add(j)
            neighbours[j].add(i)
        cliques = find_cliques(neighbours)
        rows = [float(k in clique) for clique in cliques for k in range(count)]
        return [float(len(cliques)), float(count), *rows]

    @staticmethod
    def hull(values: Array, slots: Slots, base: int, n: int, args: Array, at: int, out: int) -> int:
        take_positive_parts(values, base, n)
        cliques, count = int(args[at]), int(args[at + 1])
        least, most, d_low, d_high = 0.0, 0.0, math.inf, -math.inf
        for sweep in range(2):
            for c in range(cliques):
                row = at + 2 + count * c
                low, high, p_low, p_high = 0.0, 0.0, 0.0, 0.0
                for j in range(base, base + n):
                    if args[row + slots[j]] != 0.0:
                        b = 4 * j
                        low, high = low + values[b], high + values[b + 1]
                        p_low, p_high = p_low + values[b + 2], p_high + values[b + 3]
                if sweep == 0:
                    least, most = max(least, low), max(most, high)
                elif high >= least:
                    d_low, d_high = min(d_low, p_low), max(d_high, p_high)
        put(values, base, least, most, d_low, d_high)
        return 0


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


def blend_ladder() -> Callable[..., Any]:
    """Return the kernel that dispatches over the kinds of operators."""
    cases = [njit(contract=True)(cls.hull) for cls in BLENDS.values()]
    return build_ladder(
        "blend_hull",
        "kind",
        ["values", "slots", "base", "n", "args", "at", "out"],
        cases,
        "0",
        contract=True,
    )
