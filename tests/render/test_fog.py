"""Fog, the haze at the horizon, and lamps that shine into a cone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from spheres import Spheres

import pcsg
from pcsg.commands.options import parse_setting
from pcsg.errors import GrammarError, UsageError
from pcsg.graph.evaluate import check_settings, setting_defaults
from pcsg.render.fog import Fog, make_fog
from pcsg.render.lights import Ball
from pcsg.render.sky import BACKDROP, DARK, make_sky
from pcsg.render.spots import Spot, make_spots
from pcsg.render.stage import HAZE, build_stage

INF = math.inf


def clearness(fog: Fog, origin, direction, t) -> float:
    direction = np.array(direction, dtype=float)
    direction /= np.linalg.norm(direction)
    return float(fog.clearness(np.array([origin], dtype=float), direction[None], np.array([t]))[0])


def test_fog_that_is_everywhere_takes_the_same_part_of_every_length() -> None:
    fog = Fog((1, 1, 1), 0.1, 0.0, INF)
    assert clearness(fog, (0, 0, 5), (1, 2, 3), 7.0) == pytest.approx(math.exp(-0.7))
    assert clearness(fog, (0, 0, 5), (0, 0, 1), INF) == 0.0


@pytest.mark.parametrize("height", [0.3, 4.0, 1e6])
@pytest.mark.parametrize("z", [-2.0, 0.0, 3.0])
def test_fog_that_thins_is_what_a_sum_over_the_ray_says(height, z) -> None:
    fog = Fog((1, 1, 1), 0.2, z, height)
    rng = np.random.default_rng(1)
    for slope in (*rng.normal(size=6), 0.0, 1e-12):
        origin, direction = (0, 0, 4 * rng.normal()), np.array([0.6, 0.3, slope])
        direction /= np.linalg.norm(direction)
        s = (np.arange(200_000) + 0.5) * (9.0 / 200_000)
        above = np.maximum(origin[2] + s * direction[2] - z, 0.0)
        depth = 0.2 * np.exp(-above / height).mean() * 9.0
        assert clearness(fog, origin, direction, 9.0) == pytest.approx(math.exp(-depth), rel=1e-6)


def test_the_sky_is_seen_through_fog_that_lies_on_the_ground() -> None:
    fog = Fog((1, 1, 1), 0.2, 0.0, 3.0)
    assert clearness(fog, (0, 0, 0), (0, 0, 1), INF) == pytest.approx(math.exp(-0.6))
    assert clearness(fog, (0, 0, 3), (3, 0, 4), INF) == pytest.approx(math.exp(-0.6 / math.e / 0.8))
    assert clearness(fog, (0, 0, -5), (0, 0, 1), INF) == pytest.approx(math.exp(-1.6))
    assert clearness(fog, (0, 0, 3), (1, 0, 0), INF) == 0.0
    assert clearness(fog, (0, 0, 3), (0, 0, -1), INF) == 0.0
    assert clearness(fog, (0, 0, 900), (1, 0, 0), 5.0) == pytest.approx(1.0)
    assert clearness(fog, (0, 0, 1e9), (0, 0, -1), 1.0) == 1.0


@pytest.mark.parametrize("mode", ["preview", "direct", "path"])
def test_fog_covers_what_is_far_and_leaves_what_is_near(mode) -> None:
    scene = pcsg.loads("move(0, 4, 0) sphere | move(0, 400, 0) scale(400, 1, 400) box")
    values = {"eye": (0, 0, 0), "target": (0, 1, 0), "fov": 60}
    image, clear = (
        pcsg.render(scene, (16, 16), 1, camera=values, film={"mode": mode}, **fog)
        for fog in ({"fog": {"density": 0.02, "color": (0.2, 0.4, 0.8)}}, {})
    )
    far = math.exp(-0.02 * image.depth[0, 0])
    expected = (0.2, 0.4, 0.8) + far * (clear.rgb[0, 0] - (0.2, 0.4, 0.8))
    np.testing.assert_allclose(image.rgb[0, 0], expected, atol=1e-4)
    np.testing.assert_allclose(image.rgb[8, 8], clear.rgb[8, 8], atol=0.06)


def test_fog_takes_its_colour_and_its_height_from_the_sky_and_the_ground() -> None:
    values = setting_defaults("fog")
    sky = make_sky({**setting_defaults("sky"), "horizon": (0.5, 0.6, 0.7)}, (0, 0, 1))
    assert sky is not None
    fog = make_fog(values, sky, 2.5)
    assert fog is not None
    np.testing.assert_allclose(fog.color, BACKDROP * np.array([0.5, 0.6, 0.7]))
    assert (fog.z, fog.height) == (2.5, INF)
    assert make_fog({**values, "density": 0.0}, DARK, None) is None


def test_fog_is_a_setting_of_files_python_and_the_command_line() -> None:
    text = "sphere\nfog { density = 0.3; height = 2 }\nground { haze = 50 }\n"
    stage = build_stage(pcsg.loads(text), (8, 8), {})
    assert stage.fog is not None
    assert (stage.fog.density, stage.fog.height, stage.haze) == (0.3, 2.0, 50.0)
    again = pcsg.loads(pcsg.loads(text).to_pcsg())
    assert build_stage(again, (8, 8), {}).fog == stage.fog
    keys = parse_setting("fog", "density=0.3 height=2")
    given = build_stage(pcsg.loads("sphere\nground {}"), (8, 8), {"fog": keys})
    assert given.fog == stage.fog


def test_a_growing_tree_does_not_move_the_horizon() -> None:
    camera = {"camera": {"eye": (0.0, -5.0, 1.0), "target": (0.0, 0.0, 1.0)}, "ground": {}}
    for radius in (0.1, 40.0):
        scene = Spheres([(0.0, 60.0, radius)], [radius])
        assert build_stage(scene, (8, 8), camera).haze == HAZE * 5.0


SPOT = Spot(Ball((0, 0, 4), (8.0, 8.0, 8.0), 0.0), (0.0, 0.0, -1.0), 60.0, 0.5)


def test_a_spot_shines_in_its_cone_only_and_fades_at_the_edge() -> None:
    angles = np.radians([0.0, 14.9, 30.1, 90.0, 180.0])
    points = np.stack([np.sin(angles), 0 * angles, 4.0 - np.cos(angles)], axis=1)
    np.testing.assert_allclose(SPOT.share(points), [1, 1, 0, 0, 0])
    inner, outer = math.cos(math.radians(15)), math.cos(math.radians(30))
    half = math.acos((inner + outer) / 2)
    assert SPOT.share(np.array([[math.sin(half), 0, 4 - math.cos(half)]])) == pytest.approx(0.5)
    found = SPOT.sample(points, np.zeros((5, 2)))
    np.testing.assert_allclose(found.irradiance[:, 0], [8, 8, 0, 0, 0])


def test_a_sharp_spot_ends_at_its_angle() -> None:
    sharp = Spot(SPOT.ball, SPOT.axis, 60.0, 0.0)
    angles = np.radians([29.99, 30.01])
    points = np.stack([np.sin(angles), 0 * angles, 4.0 - np.cos(angles)], axis=1)
    np.testing.assert_allclose(sharp.share(points), [1, 0])


def test_what_is_seen_of_a_large_spot_is_what_is_sampled() -> None:
    spot = Spot(Ball((0, 0, 4), (8.0, 8.0, 8.0), 0.7), (0.0, 0.0, -1.0), 60.0, 0.5)
    rng = np.random.default_rng(2)
    points = np.concatenate([rng.normal(size=(50, 2)), np.zeros((50, 1))], axis=1)
    sample = spot.sample(points, rng.random((50, 2)))
    seen = spot.seen(points, sample.direction)
    np.testing.assert_allclose(seen.radiance, sample.irradiance * sample.density[:, None])
    np.testing.assert_allclose(seen.density, sample.density)
    np.testing.assert_allclose(seen.distance, sample.distance)
    assert (spot.estimate(points) >= 0).all()


@pytest.mark.parametrize("mode", ["preview", "direct", "path"])
def test_a_spot_lights_a_disc_of_a_table(mode) -> None:
    scene = pcsg.loads(
        "move(0,0,-1) scale(9,9,1) box\n"
        "spot { position = (0,0,4); angle = 60; soft = 0; strength = 20 }\n"
        "sky { kind = none }\nsun { strength = 0 }\n"
        "camera { projection = orthographic; eye = (0,0,9); target = (0,0,0); height = 8 }\n"
    )
    image = pcsg.render(scene, (40, 40), 1, film={"mode": mode})
    x, y = (v - 19.5 for v in np.meshgrid(np.arange(40), np.arange(40)))
    away = np.hypot(x, y) * 0.2
    lit = image.rgb.max(axis=2) > 1e-3
    edge = 4 * math.tan(math.radians(30))
    sure = np.abs(away - edge) > 0.01
    assert (lit == (away < edge))[sure].all()


def test_a_spot_that_shines_nowhere_is_refused() -> None:
    values = {**setting_defaults("spot"), "position": (1, 2, 3), "target": (1, 2, 3)}
    with pytest.raises(UsageError, match="same point"):
        make_spots([values])
    scene = pcsg.loads("sphere\nspot { position = (1,2,3); target = (1,2,3) }")
    (problem,) = check_settings(scene.graph, scene.values)
    assert "same point" in problem.message
    assert make_spots([{**setting_defaults("spot"), "strength": 0.0}]) == []


def test_names_stay_free() -> None:
    scene = pcsg.loads("{fog = 2} uscale(fog) spot\nspot = sphere\nmaterial fog { }")
    assert scene.bounds[1, 0] == pytest.approx(2.0)
    with pytest.raises(GrammarError, match="did you mean `density`"):
        pcsg.loads("sphere\nfog { densty = 1 }")
