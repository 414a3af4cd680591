"""What an operator of the BlobTree is: the class, the register, and what their kernels share.

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
from collections.abc import Sequence
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit

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

    @classmethod
    def is_silent(cls, slot: int) -> bool:
        """Return whether a child has no part in colours and surface coordinates."""
        return False

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
