"""Batches of rays through states made on demand: the compiled entry."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE
from pcsg.indices import wide
from pcsg.jit import njit
from pcsg.leaf.registry import Pool
from pcsg.trace.coverage import Coverage, Footprint, stored_normal
from pcsg.trace.ends import CUT
from pcsg.trace.lazy_kernel import LazyCut, LazyScratch, find_first_lazy
from pcsg.trace.precision import Extent
from pcsg.trace.rulebook import (
    E_STAND_IN,
    ENTRY_FIELDS,
    FIXTURE,
    P_KIND,
    P_SOLID,
    P_TARGET,
    PART_FIELDS,
)
from pcsg.trace.slots import FAULT, Lazy, make_looks, make_stand_in, open_state
from pcsg.trace.small import ENTRY, HEADER
from pcsg.trace.surface import Surface, describe_hit
from pcsg.trace.traversal import HIT, HIT_PATH, SLOT, UNDECIDED, T, Trees
from pcsg.vec import (
    IDENTITY,
    Affine,
    Ray,
    compose,
    load_affine,
    normalize,
    transform_normal,
    transform_ray,
)

_DIFFERENCE = DIFFERENCE.kind


@njit
def _describe(
    lazy: Lazy,
    trees: Trees,
    pool: Pool,
    scratch: LazyScratch,
    attributes: NDArray[np.float64],
    world: Ray,
    i: int,
    start: int,
    cut: LazyCut | None,
    out: Surface,
) -> int:
    """Follow the path to the first hit and work out the surface there; return HIT.

    UNDECIDED is returned where attributes cannot be worked out; the walker tells why.
    """
    paths = scratch.outer.paths
    book = lazy.book
    shared = len(lazy.store.refs)
    t = scratch.outer.small[T]
    m = IDENTITY
    ray = world
    slot = wide(start) // book.width
    steps = paths[HIT_PATH]
    item = wide(start)
    for k in range(steps):
        above, recipe = item, -1
        item = slot * book.width + paths[HIT_PATH + 1 + k]
        slots = lazy.store if item < shared else lazy.cache
        own = item if item < shared else item - shared
        inverse = load_affine(slots.inverses, 12 * own)
        m = compose(inverse, m)
        ray = transform_ray(inverse, ray)
        part = PART_FIELDS * slots.parts[own]
        last = paths[HIT_PATH + 2 + k] if k + 1 < steps else 0
        if last <= CUT:
            if cut is not None:
                _describe_cut(cut.cover, CUT - last, world, t, m, i, out)
            return HIT
        if last < 0:
            # A stand-in: what was made once can be made again.
            recipe = wide(book.entries[ENTRY_FIELDS * book.parts[part + P_TARGET] + E_STAND_IN])
            above = item
            item = make_stand_in(lazy, item, recipe) - 1 - last
            slots = lazy.cache
            own = item - shared
            inverse = load_affine(slots.inverses, 12 * own)
            m = compose(inverse, m)
            ray = transform_ray(inverse, ray)
            part = PART_FIELDS * slots.parts[own]
        elif k + 1 < steps:
            # What the traversal went through can be made again, so this is never a fault.
            slot = open_state(lazy, item, k + 1)
            continue
        if make_looks(lazy, above, recipe, part // PART_FIELDS) == FAULT:
            return UNDECIDED
        if book.parts[part + P_KIND] != FIXTURE:
            describe_hit(
                out,
                i,
                world,
                t,
                book.parts[part + P_TARGET],
                book.parts[part + P_SOLID] >> 1,
                ray,
                slots.values,
                book.n_values * own,
                pool,
                m,
                0,
                lazy.work.looks,
                0,
            )
            return HIT
        _describe_fixture(trees, pool, scratch, attributes, world, i, ray, m, out)
        for j in range(out.attributes.shape[1]):
            if math.isnan(out.attributes[i, j]):
                out.attributes[i, j] = lazy.work.looks[j]
        return HIT
    return HIT


@njit
def _describe_cut(
    cover: Coverage, hit: int, world: Ray, t: float, m: Affine, i: int, out: Surface
) -> None:
    """Write the surface of a hit of the coverage, in the frame that a matrix leads to."""
    n = normalize(transform_normal(m, stored_normal(cover, hit)))
    sign = -1.0 if n.x * world.dx + n.y * world.dy + n.z * world.dz > 0.0 else 1.0
    out.t[i] = t
    out.leaf[i] = cover.leaves[hit]
    for k in range(3):
        out.position[i, k] = world[k] + t * world[k + 3]
        out.normal[i, k] = sign * n[k]
    for k in range(2):
        out.uv[i, k] = 0.5
        for j in range(3):
            out.other_uv[i, k, j] = 0.0
    slots = out.attributes.shape[1]
    for k in range(slots):
        out.attributes[i, k] = cover.attributes[slots * hit + k]


@njit
def _describe_fixture(
    trees: Trees,
    pool: Pool,
    scratch: LazyScratch,
    attributes: NDArray[np.float64],
    world: Ray,
    i: int,
    ray: Ray,
    m: Affine,
    out: Surface,
) -> None:
    """Follow the path on from a fixture, with the ray in its frame and the matrix to it."""
    t = scratch.outer.small[T]
    flip = 0
    before = 0
    for k in range(scratch.path[0]):
        step = scratch.path[1 + k]
        if step <= SLOT:
            entry = trees.targets[before] + HEADER + ENTRY * (SLOT - step)
            if trees.smalls[entry + 2] == 1:
                flip = 1 - flip
            continue
        if step < 0:
            if step < -1 and trees.operations[trees.targets[before]] == _DIFFERENCE:
                flip = 1 - flip
            continue
        inverse = load_affine(trees.inverses, 12 * step)
        m = compose(inverse, m)
        ray = transform_ray(inverse, ray)
        before = step
    leaf = trees.targets[before]
    describe_hit(
        out,
        i,
        world,
        t,
        trees.leaves[4 * leaf + 3],
        trees.leaves[4 * leaf],
        ray,
        trees.args,
        trees.leaves[4 * leaf + 1],
        pool,
        m,
        flip,
        attributes,
        out.attributes.shape[1] * leaf,
    )


@njit(entry=True)
def find_batch_lazy(
    lazy: Lazy,
    trees: Trees,
    pool: Pool,
    scratch: LazyScratch,
    attributes: NDArray[np.float64],
    start: int,
    extent: Extent,
    want: int,
    cut: LazyCut | None,
    footprint: Footprint,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    t_min: NDArray[np.float64],
    t_max: NDArray[np.float64],
    begin: int,
    end: int,
    surface: Surface,
    found: NDArray[np.int8],
) -> None:
    """Find the first crossings of rays [begin, end).

    Parameters
    ----------
    start, extent, want, cut
        As in `find_first_lazy`.
    footprint
        Of the rays; empty without a cut.
    t_min, t_max
        As in `Rays`.
    surface
        Receives the surfaces; empty where nobody asks for them.
    found
        Receives HIT, MISS or UNDECIDED for every ray.
    """
    describe = len(surface.t) > 0
    own_min, own_max = len(t_min) > 1, len(t_max) > 1
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
        width = spread = 0.0
        if cut is not None:
            width, spread = footprint.width[i], footprint.spread[i]
        result = find_first_lazy(
            lazy, trees, pool, scratch, start, extent, want, ray, cut, width, spread
        )
        if result == HIT and describe:
            result = _describe(lazy, trees, pool, scratch, attributes, ray, i, start, cut, surface)
        found[i] = result
