"""Triangles: no ray slips through a shared edge or corner, and none is met far beside."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit

import pcsg
from pcsg.leaf.registry import LEAVES
from pcsg.leaf.sheets import triangle_crossing
from pcsg.vec import Affine, Ray, compose, transform_ray


@njit
def count_hits(frames: Any, signs: Any, rays: Any, hits: Any) -> None:
    """Count, for every ray in the world, the triangles it meets."""
    t = np.zeros(2)
    for i in range(rays.shape[0]):
        r = rays[i]
        world = Ray(r[0], r[1], r[2], r[3], r[4], r[5], 0.0, np.inf)
        for k in range(signs.shape[0]):
            m = frames[k]
            frame = Affine(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10], m[11])
            if triangle_crossing(transform_ray(frame, world), signs[k], t, 0) == 2:
                hits[i] += 1


def neighbours(rng: Any, scale: float) -> tuple[Any, Any, Any]:
    """Return six triangles about a corner in their own frames, and the map to the world."""
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    world = scale * rotation @ (np.eye(3) + 0.3 * rng.normal(size=(3, 3)))
    base = np.hstack([np.linalg.inv(world), rng.uniform(-1.0, 1.0, (3, 1))])
    moves = [(0, 0, 1), (0, 0, -1), (-1, 0, 1), (0, -1, 1), (1, 0, -1), (0, 1, -1)]
    frames = []
    for k, (x, y, sign) in enumerate(moves):
        # The triangle stands at (x, y): its frame is the base frame moved back.
        move = Affine(1.0, 0.0, 0.0, -float(x), 0.0, 1.0, 0.0, -float(y), 0.0, 0.0, 1.0, 0.0)
        frame = compose(move, Affine(*base.ravel().tolist()))
        # Each begins at another corner, so that neighbours round differently.
        turn = Affine(0.0, 1.0, 0.0, 0.0, -1.0, -1.0, 0.0, float(sign), 0.0, 0.0, 1.0, 0.0)
        for _ in range(k % 3):
            frame = compose(turn, frame)
        frames.append(list(frame))
    return np.array(frames), np.array([float(s) for *_, s in moves]), base


def rays_at(rng: Any, base: Any, local: Any, distance: float) -> Any:
    """Return rays from all directions at points given in the base frame."""
    inverse = np.linalg.inv(base[:, :3])
    targets = (local - base[:, 3]) @ inverse.T
    directions = rng.normal(size=targets.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    length = np.linalg.norm(inverse, 2)
    return np.hstack([targets - distance * length * directions, directions])


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e4])
@pytest.mark.parametrize("distance", [1.0, 30.0, 1e5, 1e8])
def test_no_ray_slips_through_shared_edges(scale: float, distance: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        frames, signs, base = neighbours(rng, scale)
        s = rng.uniform(0.0, 1.0, 400)
        s[:40] = 0.0  # the corner itself
        ends = np.array([(1, 0), (0, 1), (-1, 0), (0, -1), (-1, 1), (1, -1)])
        edge = ends[rng.integers(0, 6, 400)]
        local = np.column_stack([s[:, None] * edge, np.zeros(400)])
        hits = np.zeros(400, np.int64)
        count_hits(frames, signs, rays_at(rng, base, local, distance), hits)
        assert (hits > 0).all()


def test_beside_the_triangles_there_is_nothing() -> None:
    rng = np.random.default_rng(8)
    frames, signs, base = neighbours(rng, 1.0)
    s = rng.uniform(0.0, 1.0, 2000)
    outer = np.column_stack([s + 1e-8, 1.0 - s + 1e-8, np.zeros(2000)])
    hits = np.zeros(2000, np.int64)
    count_hits(frames[:1], signs[:1], rays_at(rng, base, outer, 3.0), hits)
    assert (hits == 0).all()


@pytest.mark.parametrize("name", ["tri1", "tri2"])
def test_boxes_include_the_tolerance(name: str) -> None:
    solid = LEAVES[name]
    sign = 1.0 if name == "tri1" else -1.0
    box = solid.bounds_of(())
    t = np.zeros(2)
    rng = np.random.default_rng(9)
    s = rng.uniform(0.0, 1.0, 3000)
    e = 4e-11 * rng.uniform(-1.0, 1.0, (3000, 2))
    choice = rng.integers(0, 3, 3000)
    corners = [np.column_stack(c) for c in ((s, 0 * s), (0 * s, s), (s, 1.0 - s))]
    points = sign * (np.choose(choice[:, None], corners) + e)
    met = 0
    for x, y in points.tolist():
        ray = Ray(x, y, 1.0, 0.0, 0.0, -1.0, 0.0, math.inf)
        if triangle_crossing(ray, sign, t, 0):
            met += 1
            assert box.lower[0] <= x <= box.upper[0]
            assert box.lower[1] <= y <= box.upper[1]
            for d in ((1.0, 0.0, 0.0), (-1.0, 0.3, 0.0), (0.7, 0.7, 0.0), (0.0, -1.0, 2.0)):
                assert x * d[0] + y * d[1] <= solid.support_of(d, ()) + 1e-14
    assert 500 < met < 2500


def test_a_ray_almost_in_the_plane_does_not_hit_beside_the_triangle() -> None:
    ray = Ray(0.0, 3.0, 0.0, 0.0, -1.0, 6e-95, 0.0, math.inf)
    assert triangle_crossing(ray, 1.0, np.zeros(8), 0) == 0


def test_no_ray_slips_through_between_rectangles() -> None:
    text = "rotx(31) roty(17) for(i, -3, 3) for(j, -3, 3) move(2*i, 2*j, 0) rotz(90*i) rectangle"
    scene = pcsg.loads(text)
    rng = np.random.default_rng(5)
    edges = np.column_stack([rng.choice([-1.0, 1.0, 3.0], 4000), rng.uniform(-5, 5, 4000)])
    flip = rng.random(4000) < 0.5
    edges[flip] = edges[flip][:, ::-1]
    a, b = np.radians(31.0), np.radians(17.0)
    turn_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    turn_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    points = np.column_stack([edges, np.zeros(4000)]) @ (turn_x @ turn_y).T
    origins = rng.normal(size=(4000, 3)) * 2.0 + 9.0 * (turn_x @ turn_y)[:, 2]
    assert scene.occluded(origins, points - origins).all()


@pytest.mark.parametrize("name", ["disc", "rectangle"])
def test_flat_sheets_have_the_area_that_random_rays_meet(name: str) -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(-1.5, 1.5, (40_000, 2))
    origins = np.column_stack([xy, np.ones(len(xy))])
    scene = pcsg.loads(name)
    hit = scene.occluded(origins, np.broadcast_to((0.0, 0.0, -1.0), origins.shape))
    area = {"disc": math.pi, "rectangle": 4.0}[name]
    assert 9.0 * hit.mean() == pytest.approx(area, abs=0.08)
    assert not scene.contains(origins * (1.0, 1.0, 0.0)).any()
