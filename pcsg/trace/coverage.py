"""Coverage: what a state that is smaller than a pixel does to a ray.

Recursion below a ray's footprint costs time and shows nothing, but taking the state's box for its
surface would fatten whatever is thin. So of each state it is known for every direction how large
the part is that stops rays, as an area; and some hits, whose normals and colours stand for all
(after Hart and DeFanti 1991, "Efficient antialiased rendering of 3-D linear fractals", with areas
in place of their solid bounding volumes). A ray that meets the state's box is stopped with the
probability that is the ratio of that area and of the box's, whatever box it is. This is drawn by a
hash of the ray, so that pictures do not depend on threads.

Directions fall into the fields of a cube, 8 by 8 on each face. They are moved by up to half a field
at random before, which interpolates between fields.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.functions import rand
from pcsg.jit import njit
from pcsg.trace.ends import DRAWN, LEVEL, MAX_DEPTH, NUMBER
from pcsg.vec import Ray, Vec3

Floats = NDArray[np.float64]

SIDE = 8
BINS = 6 * SIDE * SIDE
RAYS_PER_BIN = 16
"""Rays that are cast for a state, per field of directions."""

EXAMPLES = 16
"""States that are measured where many share one measurement; the rays are divided among them."""

KEPT = 2
"""Hits that are kept for a field of directions of a state."""

APART = 0.85
"""How far apart states of one frame are drawn: 1 if none ever hid another. Independent draws let
through 4 % too much of Sierpinski's tetrahedron, 1 stops 7 % too much."""


class Coverage(NamedTuple):
    """Areas and hits of C states.

    Attributes
    ----------
    areas : float32 (BINS C,)
        Of what stops rays, across their direction, in the state's frame.
    begin : int32 (BINS C + 1,)
        Hits of every field.
    normals : int8 (3 H,)
        In the state's frame, 127 long.
    leaves : int32 (H,)
        The leaf records.
    """

    areas: NDArray[np.float32]
    begin: NDArray[np.int32]
    normals: NDArray[np.int8]
    leaves: NDArray[np.int32]

    @property
    def nbytes(self) -> int:
        """Memory of all arrays in bytes."""
        return sum(a.nbytes for a in self)


class Sampled(NamedTuple):
    """What rays through a state have found, in its frame.

    Attributes
    ----------
    mask : bool (N,)
        Which of them hit.
    normals, leaves
        Of all of them.
    """

    mask: NDArray[np.bool_]
    normals: Floats
    leaves: NDArray[np.int64]


class Footprint(NamedTuple):
    """How wide rays are: ``width + spread t``, in world coordinates along unit directions.

    Attributes
    ----------
    width, spread : float64 (N,)
    """

    width: Floats
    spread: Floats


NO_FOOTPRINT = Footprint(np.zeros(0), np.zeros(0))


class Ends(NamedTuple):
    """Where recursion ends: what states look like from afar.

    Attributes
    ----------
    of_place : int32 (R,)
        Which of them a reference has; negative for none.
    """

    cover: Coverage
    of_place: NDArray[np.int32]


Space = tuple[Floats, Floats, Floats]
"""Working space of one thread where recursion ends: levels, numbers, a box."""


def make_space() -> Space:
    """Return working space for one thread."""
    return np.zeros(LEVEL * (MAX_DEPTH + 1)), np.zeros(8), np.zeros(6)


@njit
def direction_bin(x: float, y: float, z: float, u: float, v: float) -> int:
    """Return the field of a direction, moved at random by u and v in [0, 1)."""
    a, b, c = abs(x), abs(y), abs(z)
    if a >= b and a >= c:
        face, p, q, m = (0 if x > 0.0 else 1), y, z, a
    elif b >= c:
        face, p, q, m = (2 if y > 0.0 else 3), z, x, b
    else:
        face, p, q, m = (4 if z > 0.0 else 5), x, y, c
    i = math.floor((p / m + 1.0) * 0.5 * SIDE + u - 0.5)
    j = math.floor((q / m + 1.0) * 0.5 * SIDE + v - 0.5)
    i = min(max(i, 0), SIDE - 1)
    j = min(max(j, 0), SIDE - 1)
    return (face * SIDE + i) * SIDE + j


@njit
def draw_hit(
    cover: Coverage,
    state: int,
    ray: Ray,
    area: float,
    outer: Ray,
    linear: Floats,
    level: int,
    numbers: Floats,
) -> int:
    """Draw whether a state stops a ray that meets its box; return the hit that stands for it.

    States in one frame are drawn by one number, each by its own part of [0, 1), because solids
    that make up a larger one seldom hide each other; they do a little, so these parts overlap.
    Frames are independent.

    Parameters
    ----------
    ray
        In the state's frame.
    area
        Across the ray, of all rays that are asked about, in the state's frame; times the length
        of the ray's direction there.
    outer, linear, level
        The ray in the frame above; the levels, see `ends`, and the one of that frame.
    numbers : float64 (8,)
        Working space.

    Returns
    -------
    int
        Number of the hit, -1 for none.
    """
    if linear[LEVEL * level + NUMBER] < 0.0:
        for k in range(6):
            numbers[k] = outer[k]
        linear[LEVEL * level + NUMBER] = rand(numbers, 0, 6, 0)
    # One number serves three times: what is left of it is random again.
    first = linear[LEVEL * level + NUMBER] * 64.0
    second = (first - math.floor(first)) * 64.0
    draw = second - math.floor(second)
    u, v = math.floor(first) / 64.0, math.floor(second) / 64.0
    field = BINS * state + direction_bin(ray.dx, ray.dy, ray.dz, u, v)
    length = math.sqrt(ray.dx**2 + ray.dy**2 + ray.dz**2)
    drawn = linear[LEVEL * level + DRAWN]
    share = cover.areas[field] * length / area if area > 0.0 else 1.0
    linear[LEVEL * level + DRAWN] = drawn + APART * share
    if not drawn <= draw < drawn + share:
        return -1
    begin, count = cover.begin[field], cover.begin[field + 1] - cover.begin[field]
    which = (draw - drawn) / share
    hit: int = begin + min(math.floor(which * count), count - 1)
    return hit


@njit
def stored_normal(cover: Coverage, hit: int) -> Vec3:
    """Return the normal of a kept hit."""
    n = 3 * hit
    return Vec3(1.0 * cover.normals[n], 1.0 * cover.normals[n + 1], 1.0 * cover.normals[n + 2])


def rays_through(
    box: Floats, per_bin: int, rng: np.random.Generator
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return lines that meet a box, evenly over its outline, and the fields of their directions.

    Directions are spread over each field at random: along axes, fractals look denser than they are.
    """
    n = BINS * per_bin
    bins = np.repeat(np.arange(BINS), per_bin)
    face, i, j = bins // SIDE**2, bins // SIDE % SIDE, bins % SIDE
    # A tent about the middle of the field, as runtime moves directions by half a field.
    tent = rng.random((2, n)) + rng.random((2, n)) - 1.0
    p, q = np.clip((np.stack([i, j]) + 0.5 + tent) / SIDE, 0.0, 1.0) * 2.0 - 1.0
    one = np.where(face % 2 == 0, 1.0, -1.0)
    axis = face // 2
    directions = np.empty((n, 3))
    rows = np.arange(n)
    directions[rows, axis] = one
    directions[rows, (axis + 1) % 3] = p
    directions[rows, (axis + 2) % 3] = q
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    middle, half = (box[:3] + box[3:]) / 2.0, (box[3:] - box[:3]) / 2.0
    # A point of a face that the ray enters, faces chosen by how large they look.
    areas = np.array([half[1] * half[2], half[2] * half[0], half[0] * half[1]])
    seen = np.abs(directions) * areas
    chosen = (rng.random(n)[:, None] * seen.sum(axis=1)[:, None] > np.cumsum(seen, axis=1)).sum(1)
    chosen = np.minimum(chosen, 2)
    points = (2.0 * rng.random((n, 3)) - 1.0) * half
    points[rows, chosen] = -np.sign(directions[rows, chosen]) * half[chosen]
    back = 4.0 * float(np.linalg.norm(half))
    return middle + points - back * directions, directions, bins


class Collected(NamedTuple):
    """Areas and hits of one state."""

    areas: NDArray[np.float32]
    bins: NDArray[np.int64]
    normals: Floats
    leaves: NDArray[np.int64]


def measure(
    box: Floats, cast: Callable[[Floats, Floats], Sampled], seed: int, per_bin: int = RAYS_PER_BIN
) -> Collected:
    """Return areas and hits of one state.

    Parameters
    ----------
    box : float64 (6,)
        Of the state, in its frame.
    cast
        Casts rays in the state's frame.
    """
    rng = np.random.default_rng(seed)
    origins, directions, bins = rays_through(box, per_bin, rng)
    found = cast(origins, directions)
    size = box[3:] - box[:3]
    across = np.abs(directions) @ np.array(
        [size[1] * size[2], size[2] * size[0], size[0] * size[1]]
    )
    areas = np.bincount(bins, weights=found.mask * across, minlength=BINS) / per_bin
    hits = _few_of_each(bins, rng.permutation(np.flatnonzero(found.mask)))
    return Collected(
        areas.astype(np.float32),
        bins[hits],
        found.normals[hits],
        found.leaves[hits],
    )


def _few_of_each(bins: NDArray[np.int64], chosen: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first few of the chosen in every field, in the order of the fields."""
    chosen = chosen[np.argsort(bins[chosen], kind="stable")]
    of = bins[chosen]
    rank = np.arange(len(of)) - np.searchsorted(of, of)
    return chosen[rank < KEPT]


def average(collected: Sequence[Collected]) -> Collected:
    """Return what several states of a kind have in common."""
    areas = np.mean([c.areas for c in collected], axis=0).astype(np.float32)
    bins = np.concatenate([c.bins for c in collected])
    # By turns, so that the first few of a field are of different states.
    turn = np.argsort(np.concatenate([np.arange(len(c.bins)) for c in collected]), kind="stable")
    few = _few_of_each(bins, turn)
    return Collected(
        areas,
        bins[few],
        np.concatenate([c.normals for c in collected])[few],
        np.concatenate([c.leaves for c in collected])[few],
    )


def gather_coverage(collected: Sequence[Collected]) -> Coverage:
    """Return the coverage of states in arrays."""
    counts = [np.bincount(c.bins, minlength=BINS) for c in collected]
    ends = np.cumsum(np.concatenate([np.zeros(1, np.int64), *counts]))
    normals = np.concatenate([np.zeros((0, 3)), *(c.normals for c in collected)])
    return Coverage(
        areas=np.concatenate([np.zeros(0, np.float32), *(c.areas for c in collected)]),
        begin=ends.astype(np.int32),
        normals=np.rint(127.0 * normals).astype(np.int8).ravel(),
        leaves=np.concatenate([np.zeros(0), *(c.leaves for c in collected)]).astype(np.int32),
    )
