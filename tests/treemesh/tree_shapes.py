"""Skeletons and soups of tubes that tests are made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy", reason="needs the extra `mesh`")

import pcsg
from pcsg.treemesh.skeleton import Skeleton

SPECIES = ("quercus", "acer", "ulmus")
GRAMMARS = Path(__file__).parents[2] / "benchmarks" / "grammars"

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def species(name: str, **values: float) -> Skeleton:
    return pcsg.load(GRAMMARS / f"{name}.pcsg", **values).limbs().skeleton


def wild_skeleton(rng: np.random.Generator, segments: int, most_children: int = 6) -> Skeleton:
    """Directions, lengths and radii at random: nothing is too ugly."""
    pos, radius, edges = [np.zeros(3)], [0.1], []
    while len(edges) < segments:
        parent = int(rng.integers(max(0, len(pos) - 30), len(pos)))
        for _ in range(int(rng.integers(1, most_children + 1))):
            way = rng.normal(size=3)
            way *= radius[parent] * rng.uniform(0.5, 8.0) / np.linalg.norm(way)
            edges.append((parent, len(pos)))
            pos.append(pos[parent] + way)
            radius.append(float(np.clip(radius[parent] * rng.uniform(0.3, 1.2), 1e-3, 0.3)))
    return Skeleton.make(pos[: segments + 1], radius[: segments + 1], edges[:segments])


def forked_tree(rng: np.random.Generator, forks: int = 6, chain: int = 3) -> Skeleton:
    """Two limbs at each fork, well apart, of a few segments each."""
    pos, radius, edges = [np.zeros(3)], [0.1], []
    todo = [(0, np.array([0.0, 0.0, 1.0]))]
    ends = []

    def grow(node: int, way: Floats, r: float) -> tuple[int, Floats]:
        for _ in range(chain):
            way = way + 0.08 * rng.normal(size=3)
            way /= np.linalg.norm(way)
            edges.append((node, len(pos)))
            pos.append(pos[node] + 4.0 * r * way)
            radius.append(r)
            node = len(pos) - 1
            r *= 0.97
        return node, way

    node, way = grow(0, todo[0][1], 0.1)
    ends.append((node, way, 0.1))
    for _ in range(forks):
        node, way, r = ends.pop(0)
        side = np.cross(way, rng.normal(size=3))
        side /= np.linalg.norm(side)
        for sign, share in ((1.0, rng.uniform(0.72, 0.85)), (-1.0, rng.uniform(0.72, 0.85))):
            angle = np.radians(rng.uniform(26.0, 42.0))
            tilted = np.cos(angle) * way + sign * np.sin(angle) * side
            end, last = grow(node, tilted, r * share)
            ends.append((end, last, r * share))
    return Skeleton.make(pos, radius, edges)


def axis_distances(true: Skeleton, points: Floats) -> tuple[Floats, Floats]:
    """Distance of points from the axes of a skeleton, and the radius there."""
    limbs = true.limbs
    at = np.flatnonzero(limbs.edges >= 0)
    a, b = true.pos[limbs.nodes[at]], true.pos[limbs.nodes[at + 1]]
    ra, rb = limbs.radius[at], limbs.radius[at + 1]
    t = np.einsum("pij,ij->pi", points[:, None] - a, b - a) / ((b - a) ** 2).sum(axis=1)
    t = np.clip(t, 0.0, 1.0)
    d = np.linalg.norm(points[:, None] - a - t[..., None] * (b - a), axis=2)
    k = d.argmin(axis=1)
    rows = np.arange(len(points))
    return d[rows, k], ra[k] + t[rows, k] * (rb[k] - ra[k])


def tubes(skel: Skeleton, sides: int = 8, cap: bool = False, **change: Any) -> tuple[Floats, Ints]:
    """Every limb as a tube of its own, as tree generators write them.

    Parameters
    ----------
    cap
        Close the ends with flat polygons.
    change
        ``flip``: a share of the tubes that is inside out; ``soup``: every face has vertices of its
        own; ``seed``.
    """
    rng = np.random.default_rng(change.get("seed", 0))
    verts, faces, n = [], [], 0
    limbs = skel.limbs
    around = np.arange(sides) * 2.0 * np.pi / sides
    for k in range(len(limbs)):
        at = slice(limbs.ptr[k], limbs.ptr[k + 1])
        places, radii = skel.pos[limbs.nodes[at]], limbs.radius[at]
        tangent = np.gradient(places, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        u = np.cross(tangent[0], [0.3, 0.5, 0.8])
        for p, r, t in zip(places, radii, tangent, strict=True):
            u = u - t * (u @ t)
            u /= np.linalg.norm(u)
            circle = np.cos(around)[:, None] * u + np.sin(around)[:, None] * np.cross(t, u)
            verts.append(p + r * circle)
        own = []
        for i in range(len(places) - 1):
            for q in range(sides):
                a, b = n + i * sides + q, n + i * sides + (q + 1) % sides
                own += [(a, b, b + sides), (a, b + sides, a + sides)]
        if cap:
            last = n + (len(places) - 1) * sides
            own += [(n, n + q + 1, n + q) for q in range(1, sides - 1)]
            own += [(last, last + q, last + q + 1) for q in range(1, sides - 1)]
        if rng.random() < change.get("flip", 0.0):
            own = [face[::-1] for face in own]
        faces += own
        n += sides * len(places)
    v, f = np.concatenate(verts), np.array(faces)
    if change.get("soup"):
        v, f = v[f.ravel()], np.arange(f.size).reshape(-1, 3)
    return v, f
