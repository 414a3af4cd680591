"""Hits that are looked up on demand, beside those of the walker."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg
from pcsg.errors import UsageError
from pcsg.leaf.registry import FIRST
from pcsg.trace.blocks_batch import BAD_RAY, find_batch
from pcsg.trace.coverage import NO_FOOTPRINT
from pcsg.trace.found import make_found
from pcsg.trace.rays import shape_rays
from pcsg.trace.traversal import MISS, UNDECIDED

COLOURED = """
ball | move(3,0,0) color(1,0,0) label(7) torus(0.3) | move(0,3,0) material(bark) uscale(0.5) box
ball = sphere \\ move(0.5,0.5,0.5) uscale(0.7) box
material bark { roughness = 0.5 }
"""
NAMES = ("t", "position", "normal", "leaf", "uv", "label", "color", "material", "texture")


def _rays(n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    origins = rng.normal(size=(n, 3)) * 2.0  # some of them inside
    return origins, rng.uniform(-1, 4, (n, 3)) * (1, 1, 0.2) - origins


def test_everything_about_a_hit_is_the_walkers() -> None:
    walked = pcsg.loads(COLOURED, engine="cyclic").intersect(*_rays())
    found = pcsg.loads(COLOURED, engine="states").intersect(*_rays())
    assert 100 < found.mask.sum() < 400
    for name in (*NAMES, "other_uv", "texture_scale"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(walked, name), rtol=1e-9, atol=1e-9, err_msg=name
        )


def test_hits_do_not_change_with_the_rays_of_the_user() -> None:
    origins, directions = _rays()
    found = pcsg.loads(COLOURED, engine="states").intersect(origins, directions)
    before = found.position.copy(), pcsg.loads(COLOURED).intersect(*_rays()).uv
    origins += 1.0
    directions *= 2.0
    np.testing.assert_array_equal(found.position, before[0])
    np.testing.assert_array_equal(found.uv, before[1])


@pytest.mark.parametrize(
    ("origin", "direction", "limits", "message"),
    [
        ((0, 0, np.nan), (0, 0, 1), (0, 1), "finite"),
        ((0, 0, 0), (0, np.inf, 1), (0, 1), "finite"),
        ((0, 0, 0), (0, 0, 0), (0, 1), "zero"),
        ((0, 0, 0), (0, 0, 1), (np.nan, 1), "t_min"),
        ((0, 0, 0), (0, 0, 1), (0, np.nan), "t_max"),
    ],
)
@pytest.mark.parametrize("verb", ["intersect", "occluded"])
def test_one_bad_ray_among_good_ones_is_told(origin, direction, limits, message, verb) -> None:
    origins, directions = _rays(40_000)
    origins[30_000], directions[30_000] = origin, direction
    scene = pcsg.loads(COLOURED, engine="states", threads=2)
    with pytest.raises(UsageError, match=message):
        getattr(scene, verb)(origins, directions, *limits)


def test_limits_of_single_rays() -> None:
    scene = pcsg.loads("sphere", engine="states")
    origins = np.array([(0.0, 0.0, 5.0)] * 3)
    t_max = np.array([10.0, 3.0, 10.0])
    hits = scene.intersect(origins, (0.0, 0.0, -1.0), 0.0, t_max)
    assert hits.mask.tolist() == [True, False, True]
    hits = scene.intersect(origins, (0.0, 0.0, -1.0), np.array([0.0, 0.0, 7.0]), 10.0)
    assert hits.mask.tolist() == [True, True, False]


HOLLOW = """hall | move(0.4,0,0) uscale(0.3) ball | move(2.5,0,0) sphere
hall = uscale(3) box \\ uscale(2.9) sphere
ball = sphere \\ move(0,0,0.5) uscale(0.8) sphere
"""


def test_rays_from_within_are_answered_without_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    origins, directions = rng.uniform(-3, 3, (3000, 3)), rng.normal(size=(3000, 3))
    walker = pcsg.loads(HOLLOW, engine="cyclic")
    within = walker.contains(origins)
    origins, directions = origins[within], directions[within]
    assert len(origins) > 500
    walked = walker.intersect(origins, directions)
    near = walker.intersect(origins, directions, 0.0, 0.5)
    blocked = walker.occluded(origins, directions, 0.0, 0.5)
    scene = pcsg.loads(HOLLOW, engine="states")
    monkeypatch.setattr(type(scene.tracer), "walker", property(lambda self: pytest.fail("walked")))
    for found, expected in (
        (scene.intersect(origins, directions), walked),
        (scene.intersect(origins, directions, 0.0, 0.5), near),
    ):
        np.testing.assert_array_equal(found.leaf, expected.leaf)
        np.testing.assert_allclose(found.t, expected.t, rtol=1e-9)
        np.testing.assert_allclose(found.normal, expected.normal, atol=1e-9)
    np.testing.assert_array_equal(scene.occluded(origins, directions, 0.0, 0.5), blocked)


@pytest.mark.parametrize("where", [0, 7, 399])
@pytest.mark.parametrize("far", [(1e308, 1e308, 0), (1e308, 1e308, -1e308), (0, 1.7e308, 1.7e308)])
def test_a_ray_whose_components_add_up_to_infinity_ends_nothing(
    where: int, far: tuple[float, float, float]
) -> None:
    origins, directions = _rays()
    scene = pcsg.loads(COLOURED, engine="states", threads=1)
    kept = np.arange(len(origins)) != where
    expected = scene.intersect(origins[kept], directions[kept])
    hidden = scene.occluded(origins[kept], directions[kept])
    for of_origins in (True, False):
        o, d = origins.copy(), directions.copy()
        (o if of_origins else d)[where] = far
        found = scene.intersect(o, d)
        for name in NAMES:
            np.testing.assert_array_equal(getattr(found, name)[kept], getattr(expected, name))
        assert not of_origins or (found.t[where] == np.inf and found.leaf[where] == -1)
        assert (found.uv[where] == 0).all() or found.mask[where]
        assert (scene.occluded(o, d)[kept] == hidden).all()


def test_a_ray_that_cannot_be_traced_leaves_the_others_answered() -> None:
    origins, directions = _rays()
    tracer = pcsg.loads(COLOURED, engine="states", threads=1).tracer
    expected = tracer.intersect(origins, directions)
    origins[3, 1] = np.inf
    found, answers = make_found(len(origins)), np.full(len(origins), 99, np.int8)
    rays = shape_rays(origins, directions, 0.0, np.inf)
    for array in found:
        array[...] = 99
    with tracer._working() as (scratch, _):
        arrays = tracer._trees, tracer._pool, scratch, tracer.blocks.root, tracer._extent
        out = found, answers, tracer._attributes
        status = find_batch(*arrays, FIRST, None, NO_FOOTPRINT, *rays, 0, len(origins), *out)
    assert status == BAD_RAY
    assert answers[3] == MISS and found.t[3] == np.inf and found.record[3] == -1
    assert not (answers == 99).any() and not any((array == 99).any() for array in found)
    decided = (answers != UNDECIDED) & (np.arange(len(origins)) != 3)
    assert (found.t[decided] == expected.t[decided]).all()
