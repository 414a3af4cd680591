"""Integers as kernels need them: numba mixes signed and unsigned ones into floats."""

from __future__ import annotations

import numpy as np

from pcsg.jit import njit


@njit(inline=True)
def wide(x: int | np.uint64) -> int:
    """Return an integer with 64 bits, wherever it comes from."""
    return np.int64(x)  # type: ignore[return-value]  # to numba it is an int


@njit(inline=True)
def place(x: int) -> np.uint64:
    """Return a number that is not negative as an index, which then needs no test of its sign."""
    return np.uint64(x)
