"""Texture coordinates along the limbs.

u runs once around a limb, v along it, measured in circumferences from the root, so that a picture
of bark is stretched nowhere and continues from a limb to the one that goes on from it.
"""

from __future__ import annotations

import math

import numpy as np

from pcsg.treemesh.cage import Cage
from pcsg.treemesh.skeleton import Floats, Limbs


def limb_coordinate(limbs: Limbs) -> Floats:
    """Return v at every entry of `Limbs.nodes`: the integral of ds / (2 pi r) from the root."""
    ra, rb = limbs.radius[:-1], limbs.radius[1:]
    step = np.diff(limbs.arc) / (math.pi * (ra + rb))
    step[limbs.ptr[1:-1] - 1] = 0.0
    along = np.concatenate([[0.0], np.cumsum(step)])
    along -= np.repeat(along[limbs.ptr[:-1]], np.diff(limbs.ptr))
    # Limbs come in order from the root, so a limb's start is known before the limb.
    total = along[limbs.ptr[1:] - 1]
    at_joint = np.full(len(limbs.joints), np.nan)
    start = np.zeros(len(limbs))
    for k, (a, b) in enumerate(limbs.ends.tolist()):
        if a >= 0:
            start[k] = 0.0 if np.isnan(at_joint[a]) else at_joint[a]
        if b >= 0 and np.isnan(at_joint[b]):
            at_joint[b] = start[k] + total[k]
    return along + np.repeat(start, np.diff(limbs.ptr))


def cage_coordinates(cage: Cage, limbs: Limbs) -> Floats:
    """Return (u, v) at the corners of a cage's faces, float64 (c, 2)."""
    along = limb_coordinate(limbs)
    s = cage.stations
    v = along[s.step] + s.part * (along[s.step + 1] - along[s.step])
    flat, ptr = cage.mesh.flat, cage.mesh.ptr
    uv = np.stack([0.25 * (flat % 4), v[flat // 4]], axis=1)
    sizes = cage.mesh.sizes
    face = np.repeat(np.arange(len(sizes)), sizes)
    rank = np.arange(len(flat)) - ptr[face]
    n_limbs = len(limbs)
    # Side quads run (a + q, a + q + 1, b + q + 1, b + q): across the seam u goes on to 1.
    station = flat // 4
    first = station[ptr[face]]
    is_limb = cage.owner[face] < n_limbs
    is_side = is_limb & (station[np.minimum(ptr[face] + 2, len(flat) - 1)] != first)
    beyond = is_side & ((rank == 1) | (rank == 2)) & (flat % 4 == 0)
    uv[beyond, 0] = 1.0
    # Tips are seen from their end.
    is_cap = is_limb & ~is_side
    around = 0.5 * math.pi * (flat[is_cap] % 4)
    uv[is_cap] += np.stack([np.cos(around), np.sin(around)], axis=1) / (2.0 * math.pi)
    uv[is_cap, 0] += 0.5 - 0.25 * (flat[is_cap] % 4)
    _unwrap_joints(uv, cage, face, ~is_limb)
    return uv


def _unwrap_joints(uv: Floats, cage: Cage, face: np.ndarray, at_joint: np.ndarray) -> None:
    """Bring the corners of a joint's face to the same turn of u, so that none spans the seam."""
    first = np.repeat(uv[cage.mesh.ptr[:-1], 0], cage.mesh.sizes)
    turned = uv[:, 0] - np.round(uv[:, 0] - first)
    uv[at_joint, 0] = turned[at_joint]
