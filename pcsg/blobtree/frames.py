"""Frames along axes: directions that are carried from internode to internode without a twist."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def frames_of(axis: Array) -> tuple[Array, Array]:
    """Return two directions across each axis (N, 3), as `meeting.frame_of` does for one."""
    x, y, z = axis.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    u = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return u, np.stack([b, sign + y * y * a, -y], axis=1)


def carry(axis: Array, to: Array, across: Array) -> Array:
    """Return directions turned as little as takes one axis to another, all (N, 3) of length 1."""
    normal = np.cross(axis, to)
    cosine = (axis * to).sum(axis=1)[:, None]
    along = (normal * across).sum(axis=1)[:, None]
    # Rodrigues's formula; where an axis turns back there is no least turn.
    turned = cosine * across + np.cross(normal, across) + along * normal / (1.0 + cosine + 1e-12)
    turned -= (turned * to).sum(axis=1)[:, None] * to
    length = np.linalg.norm(turned, axis=1)[:, None]
    return np.where(length > 1e-9, turned / np.maximum(length, 1e-9), frames_of(to)[0])


def carried_turns(axis: Array, below: NDArray[np.int64]) -> Array:
    """Return the turns (N,) to add to u, counted in the frames of the axes (N, 3), so that u = 0
    is one line along every branch.

    Parameters
    ----------
    below
        Number of the piece that each one goes on from, before it; -1 where a branch begins.
    """
    rank = np.zeros(len(axis), np.int64)
    for k in np.flatnonzero(below >= 0).tolist():
        rank[k] = rank[below[k]] + 1
    u, w = frames_of(axis)
    zero = u.copy()
    # All of the same rank at a time: every branch has one of them.
    order = np.argsort(rank, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(rank[order])) + 1)[1:]:
        zero[group] = carry(axis[below[group]], axis[group], zero[below[group]])
    turns: Array = -np.arctan2((zero * w).sum(axis=1), (zero * u).sum(axis=1)) / (2.0 * math.pi)
    return turns
