"""Affine maps as other programs take them: turned, scaled along axes, turned again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STRAIGHT = 1e-6
"""Cosines between axes that count as zero."""


def split(maps: Floats) -> tuple[Floats, Floats, Floats]:
    """Return rotations U, scales S and rotations W with ``map = U diag(S) W``.

    Where the map has no shear, W is the identity. Mirrors are negative scales.

    Parameters
    ----------
    maps
        (N, 3, 3).

    Returns
    -------
    outer : (N, 3, 3)
    scale : (N, 3)
    inner : (N, 3, 3)
    """
    scale = np.linalg.norm(maps, axis=1)
    axes = maps / np.maximum(scale[:, None, :], 1e-300)
    products = np.einsum("nji,njk->nik", axes, axes)
    products[:, range(3), range(3)] = 0.0
    sheared = np.abs(products).max(axis=(1, 2)) > STRAIGHT
    inner = np.broadcast_to(np.eye(3), maps.shape).copy()
    if sheared.any():
        u, s, w = np.linalg.svd(maps[sheared])
        axes[sheared], scale[sheared], inner[sheared] = u, s, w
        left = np.linalg.det(inner) < 0.0
        inner[left] *= -1.0
        scale[left] *= -1.0
    left = np.linalg.det(axes) < 0.0
    axes[left] *= -1.0
    scale[left] *= -1.0
    return axes, scale, inner


def is_sheared(inner: Floats) -> NDArray[np.bool_]:
    """Return (N,) which inner rotations of `split` are none."""
    return np.asarray((inner != np.eye(3)).any(axis=(1, 2)))


def quaternions(rotations: Floats) -> Floats:
    """Return rotations (N, 3, 3) as unit quaternions (N, 4): x, y, z, w."""
    m = rotations
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    # The largest of the four has most digits.
    squares = np.column_stack([2.0 * m[:, k, k] - trace for k in range(3)] + [trace]) + 1.0
    largest = squares.argmax(axis=1)
    found = np.empty((len(m), 4))
    for k in range(4):
        here = largest == k
        a = m[here]
        if k == 3:
            parts = [a[:, 2, 1] - a[:, 1, 2], a[:, 0, 2] - a[:, 2, 0], a[:, 1, 0] - a[:, 0, 1]]
            found[here] = np.column_stack([*parts, squares[here, 3]])
            continue
        i, j = (k + 1) % 3, (k + 2) % 3
        found[here, k] = squares[here, k]
        found[here, i] = a[:, i, k] + a[:, k, i]
        found[here, j] = a[:, j, k] + a[:, k, j]
        found[here, 3] = a[:, j, i] - a[:, i, j]
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def composed(outer: Floats, inner: Floats) -> Floats:
    """Return (..., 3, 4) maps that are the inner ones, then the outer ones."""
    linear = outer[..., :3] @ inner[..., :3]
    shift = np.einsum("...ij,...j->...i", outer[..., :3], inner[..., 3]) + outer[..., 3]
    return np.concatenate([linear, shift[..., None]], axis=-1)
