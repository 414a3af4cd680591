"""Batches of rays through blocks: the compiled entry of the fast engine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.operators import DIFFERENCE
from pcsg.jit import njit
from pcsg.leaf.registry import ANY, Pool
from pcsg.trace.kernel import find_exit, find_first
from pcsg.trace.small import ENTRY, HEADER
from pcsg.trace.surface import Surface, describe_hit
from pcsg.trace.traversal import HIT, HIT_PATH, INSIDE, SLOT, UNDECIDED, Scratch, T, Trees
from pcsg.vec import IDENTITY, Ray, compose, load_affine, transform_ray

_DIFFERENCE = DIFFERENCE.kind


@njit
def _describe(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    attributes: NDArray[np.float64],
    world: Ray,
    i: int,
    out: Surface,
) -> None:
    """Follow the path to the first hit and work out the surface there."""
    paths = scratch.paths
    m = IDENTITY
    ray = world
    flip = 0
    before = 0
    for k in range(paths[HIT_PATH]):
        step = paths[HIT_PATH + 1 + k]
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
        scratch.small[T],
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
def find_batch(
    trees: Trees,
    pool: Pool,
    scratch: Scratch,
    attributes: NDArray[np.float64],
    root: int,
    want: int,
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
    root, want
        As in `find_first`.
    surface
        Receives the surfaces; empty where nobody asks for them.
    found
        Receives HIT, MISS or UNDECIDED for every ray.
    """
    describe = len(surface.t) > 0
    for i in range(begin, end):
        ray = Ray(
            origins[i, 0],
            origins[i, 1],
            origins[i, 2],
            directions[i, 0],
            directions[i, 1],
            directions[i, 2],
            t_min[i],
            t_max[i],
        )
        result = find_first(trees, pool, scratch, root, want, ray)
        if result == INSIDE:
            # Whether it gets out is a question; through which of coinciding faces, only lists say.
            leaves = want == ANY
            result = find_exit(trees, pool, scratch, root, ray) if leaves else UNDECIDED
        found[i] = result
        if result == HIT and describe:
            _describe(trees, pool, scratch, attributes, ray, i, surface)
