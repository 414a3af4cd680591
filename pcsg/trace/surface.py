"""The surface at the first hits: shoot first, shade later."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_DEFAULTS, ATTRIBUTE_SLOTS
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_attributes, leaf_normal, leaf_other_uv, leaf_uv
from pcsg.leaf.registry import Pool
from pcsg.trace.hits import Hits
from pcsg.vec import Affine, Ray, Vec3, normalize, transform_normal

OWN_SLOTS = tuple(ATTRIBUTE_SLOTS.index(f"@{name}") for name in ("red", "green", "blue", "label"))
"""Attribute slots that a leaf may fill itself."""

LABEL = ATTRIBUTE_SLOTS.index("@label")

MOST = 2.0**53
"""Largest label; larger ones are cut off there."""


@njit
def whole_label(x: float) -> int:
    """Return a label as a whole number: towards zero; -1 for none."""
    return int(min(max(x, -MOST), MOST)) if x == x else -1


class Surface(NamedTuple):
    """What is known of the first hits of N rays.

    Attributes
    ----------
    t : float64 (N,)
        Infinite where missed.
    leaf : int64 (N,)
        Number of the leaf node, -1 where missed.
    position, normal : float64 (N, 3)
        World coordinates; unit and outward. Zero where missed.
    uv : float64 (N, 2)
        The leaf's surface coordinates.
    other_uv : float64 (N, 2, 3)
        Those of two more parts, and their shares.
    attributes : float64 (N, 7)
        Values of the attribute slots.
    """

    t: NDArray[np.float64]
    leaf: NDArray[np.int64]
    position: NDArray[np.float64]
    normal: NDArray[np.float64]
    uv: NDArray[np.float64]
    other_uv: NDArray[np.float64]
    attributes: NDArray[np.float64]

    def put(self, indices: NDArray[np.int64], other: Hits) -> None:
        """Take some of the hits from elsewhere."""
        self.t[indices], self.leaf[indices] = other.t, other.leaf
        self.position[indices], self.normal[indices] = other.position, other.normal
        self.uv[indices], self.other_uv[indices] = other.uv, other.other_uv
        self.attributes[indices] = np.column_stack(
            [other.color, other.material, other.texture, other.texture_scale, other.label]
        )

    def hits(self) -> Hits:
        """Return the same as users see it."""
        a = self.attributes
        return Hits(
            t=self.t,
            position=self.position,
            normal=self.normal,
            uv=self.uv,
            other_uv=self.other_uv,
            leaf=self.leaf,
            label=np.clip(a[:, LABEL], -MOST, MOST).astype(np.int64),
            color=np.ascontiguousarray(a[:, :3]),
            material=a[:, 3].astype(np.int64),
            texture=a[:, 4].astype(np.int64),
            texture_scale=np.ascontiguousarray(a[:, 5]),
        )


def make_surface(n: int) -> Surface:
    """Return the surface of n rays that miss."""
    return Surface(
        t=np.full(n, np.inf),
        leaf=np.full(n, -1, np.int64),
        position=np.zeros((n, 3)),
        normal=np.zeros((n, 3)),
        uv=np.zeros((n, 2)),
        other_uv=np.zeros((n, 2, 3)),
        attributes=np.tile(ATTRIBUTE_DEFAULTS, (n, 1)),
    )


@njit
def describe_hit(
    out: Surface,
    i: int,
    world: Ray,
    t: float,
    node: int,
    kind: int,
    local: Ray,
    args: NDArray[np.float64],
    args_at: int,
    pool: Pool,
    local_from_world: Affine,
    flip: int,
    attributes: NDArray[np.float64],
    attributes_at: int,
) -> None:
    """Write the surface where ray i meets a leaf.

    Parameters
    ----------
    world, local
        The ray in world coordinates and in the leaf's frame.
    node, kind
        Number of the leaf node and kind of the leaf.
    flip
        1 if the surface belongs to what is subtracted.
    attributes, attributes_at
        Values of the attribute slots.
    """
    p = Vec3(local.ox + t * local.dx, local.oy + t * local.dy, local.oz + t * local.dz)
    n = leaf_normal(kind, p, args, args_at, pool)
    n = normalize(transform_normal(local_from_world, normalize(n)))
    sign = -1.0 if flip == 1 else 1.0
    out.t[i] = t
    out.leaf[i] = node
    out.position[i, 0] = world.ox + t * world.dx
    out.position[i, 1] = world.oy + t * world.dy
    out.position[i, 2] = world.oz + t * world.dz
    out.normal[i, 0] = sign * n.x
    out.normal[i, 1] = sign * n.y
    out.normal[i, 2] = sign * n.z
    out.uv[i, 0], out.uv[i, 1] = leaf_uv(kind, p, args, args_at, pool)
    others = leaf_other_uv(kind, p, args, args_at, pool)
    for k in range(6):
        out.other_uv[i, k // 3, k % 3] = others[k]
    for k in range(out.attributes.shape[1]):
        out.attributes[i, k] = attributes[attributes_at + k]
    own = leaf_attributes(kind, p, args, args_at, pool)
    for k in range(4):
        if own[k] >= 0.0:
            out.attributes[i, OWN_SLOTS[k]] = own[k]
