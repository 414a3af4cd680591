"""The ground plane in front of, behind and instead of the scene."""

from __future__ import annotations

import numpy as np

import pcsg
from pcsg.render.leaving import begin_rays, limit_rays
from pcsg.render.tracer import GROUND, GroundedTracer

SCENE = "color(0.1,0.2,0.3) label(4) sphere | move(3,0,-2) sphere"


def test_the_ground_hides_and_is_hidden() -> None:
    scene = pcsg.loads(SCENE)
    grounded = GroundedTracer(scene.tracer, -1.5, 7)
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(2_000, 3)) * 4.0
    directions = rng.normal(size=(2_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    hits = grounded.intersect(origins, directions, 0.0, np.inf)
    alone = scene.intersect(origins, directions)
    with np.errstate(divide="ignore"):
        plane = (-1.5 - origins[:, 2]) / directions[:, 2]
    plane[plane < 0] = np.inf
    first = np.minimum(plane, alone.t)
    np.testing.assert_array_equal(hits.t, first)
    on_ground = plane < alone.t
    assert 200 < on_ground.sum() < 1_800
    np.testing.assert_array_equal(hits.leaf == GROUND, on_ground)
    np.testing.assert_array_equal(hits.material == 7, on_ground)
    met = ~on_ground
    for name in ("leaf", "label", "color", "normal", "uv", "texture_scale"):
        np.testing.assert_array_equal(getattr(hits, name)[met], getattr(alone, name)[met])
    np.testing.assert_allclose(hits.position[on_ground, 2], -1.5)
    np.testing.assert_array_equal(hits.normal[on_ground], [[0.0, 0.0, 1.0]] * on_ground.sum())
    for t_max in (np.inf, rng.random(2_000) * 6.0):
        blocked = grounded.occluded(origins, directions, 0.0, t_max)
        np.testing.assert_array_equal(blocked, np.isfinite(first) & (first <= t_max))


def test_rays_leave_on_the_side_they_go_to() -> None:
    n = 4
    position = np.zeros((n, 3))
    facing = np.tile([0.0, 0.0, 1.0], (n, 1))
    towards = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 0.0, -1.0]])
    origins, directions, layered = np.empty((n, 3)), np.empty((n, 3)), np.empty(n, dtype=bool)
    translucency = np.array([0.5, 0.5, 0.5, 0.0])
    sheet = np.array([False, False, True, False])
    scale = np.full(n, 10.0)
    rows = np.array([3, 0, 1, 2])
    matter = facing, translucency, np.zeros(n), sheet
    begin_rays(rows, position, *matter, scale, towards, origins, directions, layered)
    np.testing.assert_array_equal(directions, towards[rows])
    np.testing.assert_allclose(origins[:, 2], [-1e-7, 1e-7, -1e-7, -1e-7])
    np.testing.assert_array_equal(layered, [False, False, True, False])
    t_max = np.empty(n)
    distance = np.array([2.0, np.inf, 1e-9, 3.0])
    limit_rays(rows, position, origins, directions, distance, scale, t_max)
    t_max = t_max[[1, 2, 3, 0]]
    assert t_max[1] == np.inf
    assert t_max[2] == 0.0
    np.testing.assert_allclose(t_max[[0, 3]], [2.0, 3.0], atol=1e-6)
    assert t_max[0] < 2.0 - 2e-7
