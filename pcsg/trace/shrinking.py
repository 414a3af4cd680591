"""Whether a module's frame may have shrunk below rounding, where it is empty.

See ``docs/solids.md``, ends of recursion. Rays that find what is there within rounding need not
know; points and whole lines are asked about exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.states import StateGraph, StateItem
from pcsg.jit import njit
from pcsg.trace.walk_space import SHRUNK_DIRECTION, SHRUNK_ORIGIN
from pcsg.vec import IDENTITY, Affine, invert, load_affine

_SLACK = 1.0 + 1e-6
"""For rounding, at every step."""

_MARGIN = 0.5
"""Of the limit."""

_LONGEST = 1e100
"""The longest direction that is asked about."""


@njit
def stretch_of(m: Affine) -> float:
    """Return by how much a map lengthens at most: the largest of its singular values."""
    a = m.m00 * m.m00 + m.m10 * m.m10 + m.m20 * m.m20
    b = m.m01 * m.m01 + m.m11 * m.m11 + m.m21 * m.m21
    c = m.m02 * m.m02 + m.m12 * m.m12 + m.m22 * m.m22
    d = m.m00 * m.m01 + m.m10 * m.m11 + m.m20 * m.m21
    e = m.m00 * m.m02 + m.m10 * m.m12 + m.m20 * m.m22
    f = m.m01 * m.m02 + m.m11 * m.m12 + m.m21 * m.m22
    # The largest root of a cubic with three (Smith, "Eigenvalues of a symmetric 3x3 matrix", 1961).
    q = (a + b + c) / 3.0
    spread = (a - q) ** 2 + (b - q) ** 2 + (c - q) ** 2
    p = math.sqrt((spread + 2.0 * (d * d + e * e + f * f)) / 6.0)
    if p == 0.0:
        return math.sqrt(q)
    a, b, c, d, e, f = (a - q) / p, (b - q) / p, (c - q) / p, d / p, e / p, f / p
    half = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
    return math.sqrt(q + 2.0 * p * math.cos(angle))


@njit(entry=True)
def find_shrunk(
    order: NDArray[np.int32],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    inner: NDArray[np.int32],
    matrix: NDArray[np.int32],
    matrices: NDArray[np.float64],
    reach: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> int:
    """Return 1 where a state's frame may be below rounding, else 0.

    Parameters
    ----------
    order : int32 (N,)
        The states, each after those that it contains.
    first, last : int32 (N,)
        Items of every state.
    inner, matrix : int32 (M,)
        The state that an item is, or -1; where state_from_item stands in `matrices`, or -1.
    matrices : float64 (12,)
    reach, scale : float64 (N,)
        Zeros; receive how far the world's origin is at most in a state's frame, and by how much
        lengths of the world are larger there.
    """
    scale[0] = 1.0
    for k in range(len(order) - 1, -1, -1):
        s = order[k]
        far, large = reach[s], scale[s]
        if not (far <= _MARGIN * SHRUNK_ORIGIN and large <= SHRUNK_DIRECTION / _LONGEST):
            return 1
        for i in range(first[s], last[s]):
            child = inner[i]
            if child < 0:
                continue
            stretch, away = 1.0, 0.0
            if matrix[i] >= 0:
                m = load_affine(matrices, 12 * matrix[i])
                inverse, _ = invert(m)
                stretch = stretch_of(inverse) * _SLACK
                away = math.sqrt(m.m03 * m.m03 + m.m13 * m.m13 + m.m23 * m.m23)
            # The negations also answer for what is not a number.
            own = stretch * (far + away)
            if not own <= reach[child]:
                reach[child] = own
            own = stretch * large
            if not own <= scale[child]:
                scale[child] = own
    return 0


def may_shrink(states: StateGraph) -> bool:
    """Return whether the frame of a state of a finite acyclic graph may be below rounding."""
    n = len(states.states)
    first, inner, matrices = [0], list[int](), list[Affine]()
    for state in states.states:
        for item in state.content or ():
            if isinstance(item, StateItem):
                inner.append(item.state)
                matrices.append(item.state_from_child)
        first.append(len(inner))
    return bool(
        find_shrunk(
            np.array(states.children_first, np.int32),
            np.array(first[:-1], np.int32),
            np.array(first[1:], np.int32),
            np.array(inner or [-1], np.int32),
            np.arange(max(1, len(inner)), dtype=np.int32),
            np.array(matrices or [IDENTITY]).ravel(),
            np.zeros(n),
            np.zeros(n),
        )
    )
