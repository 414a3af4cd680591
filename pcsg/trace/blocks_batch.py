"""Batches of rays through blocks: the compiled entry of the fast engine."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_part_normal
from pcsg.leaf.registry import Pool
from pcsg.trace.coverage import Footprint, stored_normal
from pcsg.trace.ends import CUT
from pcsg.trace.expand.table import N_ATTRIBUTES
from pcsg.trace.found import Found
from pcsg.trace.kernel import Cut, find_exit, find_first
from pcsg.trace.precision import Extent, precision_of, store_precision
from pcsg.trace.small import ENTRY, HEADER
from pcsg.trace.traversal import (
    HIT,
    HIT_PATH,
    INSIDE,
    MISS,
    PART,
    PRECISION,
    SLOT,
    Scratch,
    T,
    Trees,
    begin_batch,
    begin_ray,
)
from pcsg.vec import Ray, Vec3, load_affine, normalize, transform_normal, transform_ray

OK, BAD_RAY = 0, 1

_DIFFERENCE = DIFFERENCE.kind


@njit(inline=True)
def _is_sound(ray: Ray) -> bool:
    """Return whether a ray is finite, is going anywhere, and has limits."""
    # Infinity less itself is not a number; sums of finite components may be infinite.
    nothing = (ray.ox - ray.ox) + (ray.oy - ray.oy) + (ray.oz - ray.oz)
    nothing += (ray.dx - ray.dx) + (ray.dy - ray.dy) + (ray.dz - ray.dz)
    still = ray.dx == 0.0 and ray.dy == 0.0 and ray.dz == 0.0
    return nothing == 0.0 and not still and ray.tmin == ray.tmin and ray.tmax == ray.tmax


@njit(inline=True)
def _miss(out: Found, i: int) -> None:
    """Write that ray i meets nothing."""
    out.t[i] = math.inf
    out.record[i] = -1
    for k in range(3):
        out.position[i, k] = 0.0
        out.normal[i, k] = 0.0
        out.local[i, k] = 0.0


@njit(inline=True)
def _describe(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    world: Ray,
    i: int,
    cut: Cut | None,
    out: Found,
) -> None:
    """Follow the path to the first hit, work out the normal there, and take it back."""
    paths = scratch.paths
    ray = world
    flip = False
    before = 0
    steps = wide(paths[HIT_PATH])
    drawn = -1
    for k in range(steps):
        step = wide(paths[HIT_PATH + 1 + k])
        if step <= CUT:
            drawn = CUT - step
        elif step <= SLOT:
            entry = wide(trees.targets[before]) + HEADER + ENTRY * (SLOT - step)
            flip = flip != (trees.smalls[entry + 2] == 1)
        elif step < 0:
            if step < -1 and trees.operations[trees.targets[before]] == _DIFFERENCE:
                flip = not flip
        else:
            ray = transform_ray(load_affine(trees.inverses, 12 * step), ray)
            before = step
    leaf = 0 if drawn >= 0 else wide(trees.targets[before])
    t = scratch.small[T]
    p = Vec3(ray.ox + t * ray.dx, ray.oy + t * ray.dy, ray.oz + t * ray.dz)
    kind, at = trees.leaves[4 * leaf], trees.leaves[4 * leaf + 1]
    n = leaf_part_normal(kind, p, scratch.small[PART], trees.args, at, pool)
    if cut is not None and drawn >= 0:
        n = stored_normal(cut.cover, drawn)
        # Of two sides a ray sees the one that it comes from.
        flip = n.x * ray.dx + n.y * ray.dy + n.z * ray.dz > 0.0
        leaf = wide(cut.cover.leaves[drawn])
    if flip:
        n = Vec3(-n.x, -n.y, -n.z)
    for k in range(steps):
        step = wide(paths[HIT_PATH + steps - k])
        if step >= 0:
            n = transform_normal(load_affine(trees.inverses, 12 * step), n)
    n = normalize(n)
    out.t[i] = t
    out.record[i] = leaf
    out.position[i, 0] = world.ox + t * world.dx
    out.position[i, 1] = world.oy + t * world.dy
    out.position[i, 2] = world.oz + t * world.dz
    for k in range(3):
        out.normal[i, k] = n[k]
        out.local[i, k] = p[k]


@njit
def _keep_record(trees: Trees, attributes: NDArray[np.float64], out: Found, i: int) -> None:
    """Copy the leaf record of hit i, which is its own from now on: caches are emptied."""
    record = wide(out.record[i])
    out.record[i] = i
    args = wide(trees.leaves[4 * record + 1])
    for k in range(4):
        out.leaves[4 * i + k] = trees.leaves[4 * record + k]
    each = len(out.args) // len(out.t)
    out.leaves[4 * i + 1] = each * i
    for k in range(min(each, len(trees.args) - args)):
        out.args[each * i + k] = trees.args[args + k]
    for k in range(N_ATTRIBUTES):
        out.attributes[N_ATTRIBUTES * i + k] = attributes[N_ATTRIBUTES * record + k]


@njit(entry=True)
def find_batch(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    root: int,
    extent: Extent,
    want: int,
    cut: Cut | None,
    footprint: Footprint,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    t_min: NDArray[np.float64],
    t_max: NDArray[np.float64],
    begin: int,
    end: int,
    found: Found,
    answers: NDArray[np.int8],
    attributes: NDArray[np.float64],
) -> int:
    """Find the first crossings of rays [begin, end).

    Parameters
    ----------
    root, extent, want, cut
        As in `find_first`.
    footprint
        Of the rays; empty without a cut.
    t_min, t_max
        As in `Rays`.
    found
        Receives the surfaces; empty where nobody asks for them.
    answers
        Receives HIT, MISS or UNDECIDED for every ray.
    attributes
        Of leaf records, where hits have records of their own.

    Returns
    -------
    int
        OK, or BAD_RAY where a ray is zero, or not finite, or without limits; it meets nothing, and
        the others are answered all the same.
    """
    status = OK
    describe = len(found.t) > 0
    own_min, own_max = len(t_min) > 1, len(t_max) > 1
    begin_batch(scratch)
    for i in range(begin, end):
        ray = Ray(
            origins[i, 0],
            origins[i, 1],
            origins[i, 2],
            directions[i, 0],
            directions[i, 1],
            directions[i, 2],
            t_min[i if own_min else 0],
            t_max[i if own_max else 0],
        )
        if not _is_sound(ray):
            status = BAD_RAY
            answers[i] = MISS
            if describe:
                _miss(found, i)
            continue
        width = spread = 0.0
        if cut is not None:
            width, spread = footprint.width[i], footprint.spread[i]
        store_precision(scratch.small, PRECISION, precision_of(ray, extent))
        begin_ray(scratch)
        result = find_first(trees, pool, scratch, root, extent, want, ray, cut, width, spread)
        if result == INSIDE:
            result = find_exit(trees, pool, scratch, root, want, ray)
        answers[i] = result
        if describe:
            if result == HIT:
                _describe(trees, pool, scratch, ray, i, cut, found)
                if len(found.leaves) > 0:
                    _keep_record(trees, attributes, found, i)
            else:
                _miss(found, i)
    return status
