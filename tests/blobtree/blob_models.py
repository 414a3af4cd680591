"""Random models that use every primitive, operator and warp."""

from __future__ import annotations

import math

import numpy as np

from pcsg import blobtree as b
from pcsg.blobtree.blends import BLENDS
from pcsg.blobtree.fields import REACH
from pcsg.blobtree.nodes import Cones, Field, combine, warped
from pcsg.blobtree.skeletons import SKELETONS
from pcsg.blobtree.warps import WARPS

Rng = np.random.Generator

CONVEX = [(1.0, -0.6), (1.2, 0.5), (0.1, 1.1), (-0.9, 0.4), (-0.6, -0.8)]


def random_primitive(rng: Rng, kind: str) -> Field:
    r = rng.uniform(0.15, 0.5)
    length = rng.uniform(0.3, 1.5)
    match kind:
        case "point":
            return b.point(r)
        case "segment":
            return b.segment(length, r)
        case "cone":
            return b.cone(length, *rng.uniform(0.1, 0.5, 2))
        case "disc":
            return b.disc(length * 0.5, 0.5 * r)
        case "box":
            return b.box(*rng.uniform(0.05, 0.5, 3), 0.6 * r)
        case "polygon":
            return b.polygon(0.6 * np.array(CONVEX), 0.5 * r)
    return b.convolution_segment(length, *rng.uniform(0.1, 0.4, 2), kernel=kind)


def random_cones(rng: Rng) -> Field:
    """Branches as arrays, blended in groups or all together."""
    n = int(rng.integers(1, 6))
    radius = rng.uniform(0.1, 0.4, n)
    long = rng.random(n) < 0.9
    return Cones(
        rng.normal(0.0, 0.5, (n, 3)),
        rng.normal(0.0, 0.6, (n, 3)) * long[:, None],
        rng.uniform(0.0, 0.2, n) * long * (rng.random(n) < 0.7),
        REACH * radius,
        None,
        str(rng.choice(["sum", "union"])),
        np.array([0, *range(1, n, 2)]) if rng.random() < 0.5 else None,
    )


def random_map(rng: Rng, spread: float) -> np.ndarray:
    """A similarity half of the time, else with shears and other scales; a third is mirrored."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    a = q * rng.uniform(0.6, 1.4)
    if rng.random() < 0.3:
        a[:, 0] *= -1.0
    if rng.random() < 0.5:
        a = a @ (np.diag(rng.uniform(0.7, 1.4, 3)) + 0.15 * rng.normal(size=(3, 3)))
    return np.concatenate([a, rng.normal(0.0, spread, (3, 1))], axis=1)


def random_warp(rng: Rng, kind: str, child: Field) -> Field:
    if kind == "twist":
        return warped(kind, child, rng.uniform(-60.0, 60.0))
    if kind == "taper":
        return warped(kind, child, *rng.uniform(0.6, 1.5, 2))
    return warped(kind, child, rng.uniform(-40.0, 40.0), rng.uniform(0.0, 360.0))


def random_model(rng: Rng, kinds: tuple[str, ...] = (), depth: int = 3) -> Field:
    """A model of which the operator, warp or primitive in `kinds` is certainly part."""
    parts = [k for k in kinds if k in SKELETONS]
    operators = [k for k in kinds if k in BLENDS]
    warps = [k for k in kinds if k in WARPS]

    def leaf() -> Field:
        if not parts and rng.random() < 0.2:
            return random_cones(rng)
        kind = parts.pop() if parts else str(rng.choice(list(SKELETONS)))
        return random_primitive(rng, kind)

    def grow(level: int) -> Field:
        if level == 0:
            node = leaf()
            if (warps and rng.random() < 0.7) or rng.random() < 0.1:
                kind = warps.pop() if warps else str(rng.choice(list(WARPS)))
                # A thin thing along z can be bent.
                node = random_warp(rng, kind, b.place(np.eye(3, 4) * 0.5, node))
            node = b.place(random_map(rng, 0.45), node)
            return float(-rng.uniform(0.2, 0.8)) * node if rng.random() < 0.1 else node
        name = operators.pop() if operators else str(rng.choice(USABLE))
        return operate(name, level)

    def some(level: int, least: int) -> list[Field]:
        return [grow(max(0, level - rng.integers(1, 3))) for _ in range(rng.integers(least, 5))]

    def operate(name: str, level: int) -> Field:
        match name:
            case "weight":
                return b.weight(rng.uniform(-0.5, 1.5), b.total(*some(level, 2)))
            case "ricci":
                return b.ricci(rng.uniform(1.0, 6.0), *some(level, 2))
            case "pcm":
                w = rng.uniform(0.1, 0.5)
                return b.pcm(*some(level, 2), w=w, a0=rng.uniform(0.05, 0.5) * w)
            case "subtract" | "r_union" | "r_intersect":
                return combine(name, (grow(level - 1), grow(level - 1)))
            case "gbb":
                same = some(level, 2)
                bound = rng.uniform(0.5, 1.3) * b.place(random_map(rng, 0.3), b.point(0.7))
                return b.gbb(bound, b.pcm(*same), b.total(*same))
            case "joint" | "excess":
                same = some(level, 2)
                joints = [
                    (0.9 * b.place(random_map(rng, 0.4), b.point(0.4)), same[0], same[k])
                    for k in range(1, len(same))
                ]
                return b.joint(b.total(*same), *joints)
        return combine(name, some(level, 2))

    node = grow(depth)
    if warps:
        node = random_warp(rng, warps.pop(), node)
    return node


USABLE = [name for name in BLENDS if name != "excess"]


def random_rays(rng: Rng, model: object, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays through a model, half of them grazing its surface within 1e-8 to 1e-2 of its size."""
    low, high = model.support  # type: ignore[attr-defined]
    centre, size = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    target = centre + rng.normal(0.0, 0.3, (n, 3)) * (high - low)
    d = rng.normal(size=(n, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    o = target - 2.0 * size * d
    counts, t = model.shoot(o, d)  # type: ignore[attr-defined]
    ends = np.cumsum(counts)
    hit = np.flatnonzero(counts > 0)[: n // 2]
    p = o[hit] + t[ends[hit] - rng.integers(1, counts[hit] + 1)][:, None] * d[hit]
    normal = model.gradient(p)  # type: ignore[attr-defined]
    length = np.linalg.norm(normal, axis=1)
    good = length > 1e-6
    hit, p, normal = hit[good], p[good], normal[good] / length[good][:, None]
    tangent = rng.normal(size=p.shape)
    tangent -= (tangent * normal).sum(axis=1)[:, None] * normal
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    aside = size * 10.0 ** rng.uniform(-8.0, -2.0, len(p)) * rng.choice([-1.0, 1.0], len(p))
    o[hit] = p + aside[:, None] * normal - rng.uniform(0.5, 2.0, len(p))[:, None] * tangent * size
    d[hit] = tangent * rng.uniform(0.1, 10.0, len(p))[:, None]
    return o, d


def kinds_to_cover() -> list[tuple[str, ...]]:
    """Combinations that together use everything there is."""
    primitives = list(SKELETONS)
    out = [(name, primitives[k % len(primitives)]) for k, name in enumerate(USABLE)]
    out += [(name, primitives[k % len(primitives)]) for k, name in enumerate(WARPS)]
    out += [(warp, name) for warp in WARPS for name in ("pcm", "subtract", "gbb")]
    return out + [(name,) for name in primitives]


def tangent_scale(model: object) -> float:
    low, high = model.support  # type: ignore[attr-defined]
    return 0.5 * math.dist(low, high)
