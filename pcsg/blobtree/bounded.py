"""Blends that bounds limit to a part of space: ridges of bark, junctions on an axis."""

from __future__ import annotations

from pcsg.blobtree.blend import (
    Array,
    Blend,
    Slots,
    blend,
    find_slot,
    product,
    put,
    take_positive_parts,
)


@blend
class Gbb(Blend):
    """``gbb { bound } { B1 } { B2 }``: B2 + b (B1 - B2), b the bound clamped to [0, 1].

    Generalised bounded blending (Galbraith, Muendermann, Wyvill 2004, eq. 4).
    """

    alone = False
    slotted = True

    @classmethod
    def is_silent(cls, slot: int) -> bool:
        return slot == 0

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

    @classmethod
    def is_silent(cls, slot: int) -> bool:
        # All wood is in the sum already.
        return slot > 0

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
