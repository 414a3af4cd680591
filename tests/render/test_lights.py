import numpy as np
import pytest

from pcsg.errors import UsageError
from pcsg.graph.settings import SETTINGS
from pcsg.render.daylight import PhysicalSky
from pcsg.render.lights import Ball, Sun, make_balls, make_sun
from pcsg.render.sampler import Sampler, around, cosine_hemisphere
from pcsg.render.sky import GradientSky, ImageSky, make_sky

UP = (0.0, 0.0, 1.0)


def defaults(kind):
    return {key: k.default for key, k in SETTINGS[kind].keys.items()}


def numbers(n):
    zeros = np.zeros(n, dtype=np.int64)
    return Sampler((1, 1), n, 1).pairs(zeros, zeros, np.arange(n), 0)


def test_the_sun_is_a_disc_about_its_direction():
    sun = make_sun({**defaults("sun"), "direction": (0, 0, 2), "angle": 10.0})
    sample = sun.sample(np.zeros((256, 3)), numbers(256))
    angles = np.degrees(np.arccos(sample.direction[:, 2]))
    assert 4.8 < angles.max() <= 5.0 + 1e-9
    assert np.isinf(sample.distance).all()
    np.testing.assert_allclose(sample.irradiance[0], (3, 2.88, 2.7))


def test_a_point_light_falls_off_with_the_square():
    light = Ball((0, 0, 3), (9.0, 9.0, 9.0), 0.0)
    sample = light.sample(np.zeros((1, 3)), np.zeros((1, 2)))
    np.testing.assert_allclose(sample.irradiance, 1)
    np.testing.assert_allclose(sample.direction, [[0, 0, 1]])
    assert sample.distance[0] == 3


def test_the_sky_gives_what_its_table_says():
    sky = make_sky(defaults("sky"), UP)
    assert isinstance(sky, GradientSky)
    for normal in ([0, 0, 1.0], [0, 0, -1.0], [0.6, 0, 0.8], [1.0, 0, 0]):
        normals = np.broadcast_to(np.array(normal), (4096, 3))
        expected = sky.radiance(cosine_hemisphere(numbers(4096), normals)).mean(axis=0)
        np.testing.assert_allclose(sky.ambient(normals[:1])[0], expected, rtol=5e-3)


def test_a_uniform_sky_is_uniform_light():
    sky = GradientSky((0.5,) * 3, (0.5,) * 3, (0.5,) * 3)
    normals = np.array([[0, 0, 1.0], [0.6, 0, -0.8]])
    np.testing.assert_allclose(sky.ambient(normals), 0.5)


def test_lights_that_give_nothing_are_left_out():
    assert make_sun({**defaults("sun"), "strength": 0.0}) is None
    assert make_balls([{**defaults("light"), "strength": 0.0}]) == []
    assert make_sky({**defaults("sky"), "kind": "none"}, UP) is None
    assert make_sky({**defaults("sky"), "strength": 0.0}, UP) is None


def test_mistakes_are_named(tmp_path):
    with pytest.raises(UsageError, match="direction"):
        make_sun({**defaults("sun"), "direction": (0, 0, 0)})
    with pytest.raises(UsageError, match="file"):
        make_sky({**defaults("sky"), "kind": "image"}, UP)
    with pytest.raises(UsageError, match=r"none\.hdr"):
        make_sky({**defaults("sky"), "kind": "image", "file": str(tmp_path / "none.hdr")}, UP)
    (tmp_path / "bad.hdr").write_bytes(b"P6 nothing")
    with pytest.raises(UsageError, match="Radiance"):
        make_sky({**defaults("sky"), "kind": "image", "file": str(tmp_path / "bad.hdr")}, UP)


def sphere(n):
    pairs = numbers(n)
    axis = np.broadcast_to(np.array(UP), (n, 3))
    return around(axis, 1.0 - 2.0 * pairs[:, 0], pairs[:, 1])


def image_sky():
    rng = np.random.default_rng(3)
    return ImageSky(rng.uniform(0, 1, (9, 14, 3)) ** 6 * 20, 40.0)


ALL = [
    GradientSky((0.2, 0.3, 0.9), (1.0, 0.9, 0.8), (0.1, 0.1, 0.1)),
    PhysicalSky((0.6, 0.0, 0.8), 3.0, 1.0),
    image_sky(),
    Ball((0.5, -1.0, 2.0), (3.0, 2.0, 1.0), 0.7),
    Ball((0.0, 0.1, 0.2), (3.0, 2.0, 1.0), 0.9),
    Sun((0.0, 0.6, 0.8), (3.0, 2.0, 1.0), 40.0),
]


@pytest.mark.parametrize("light", ALL, ids=lambda x: type(x).__name__)
def test_lights_draw_what_they_show(light):
    """Drawn directions, their densities and what rays see are three views of one thing."""
    n = 1 << 14
    position = np.zeros((n, 3))
    sample = light.sample(position, numbers(n))
    seen = light.seen(position, sample.direction)
    inside = ~np.isnan(seen.distance)
    assert inside.mean() > 0.999  # of discs, the rim is lost to rounding
    np.testing.assert_allclose(
        seen.radiance[inside], (sample.irradiance * sample.density[:, None])[inside], rtol=1e-6
    )
    np.testing.assert_allclose(seen.density[inside], sample.density[inside], rtol=1e-6)
    np.testing.assert_allclose(seen.distance[inside], sample.distance[inside], rtol=1e-6)
    # The integral over all directions, once by drawing and once evenly.
    every = light.seen(position, sphere(n))
    total = every.radiance.mean(axis=0) * 4 * np.pi
    np.testing.assert_allclose(sample.irradiance.mean(axis=0), total, rtol=0.03)
    assert every.density.mean() * 4 * np.pi == pytest.approx(1, rel=0.03)


@pytest.mark.parametrize("sky", ALL[1:3], ids=lambda x: type(x).__name__)
def test_ambient_light_is_the_mean_over_the_hemisphere(sky):
    n = 1 << 14
    for normal in ([0, 0, 1.0], [0.6, 0, 0.8], [0.0, 1.0, 0.0]):
        normals = np.broadcast_to(np.array(normal), (n, 3))
        expected = sky.radiance(cosine_hemisphere(numbers(n), normals)).mean(axis=0)
        # Three bands of harmonics are not the whole of a spotted sky.
        np.testing.assert_allclose(sky.ambient(normals[:1])[0], expected, rtol=0.12)


def test_balls_shine_as_points_of_their_intensity():
    ball = Ball((0.0, 0.0, 5.0), (50.0, 50.0, 50.0), 1.0)
    sample = ball.sample(np.zeros((4096, 3)), numbers(4096))
    lit = (sample.irradiance[:, 0] * sample.direction[:, 2]).mean()
    assert lit == pytest.approx(50.0 / 25.0, rel=1e-3)


def test_pictures_of_the_sky_are_the_right_way_round():
    pixels = np.zeros((8, 16, 3))
    pixels[0] = 1.0, 0.0, 0.0  # the row above
    pixels[4:, :8] = 0.0, 1.0, 0.0  # to the left of its middle, which is +x, lies +y
    sky = ImageSky(pixels, 0.0)
    found = sky.radiance(np.array([[0, 0, 1.0], [0, 0.98, -0.2], [0, -0.98, -0.2]]))
    np.testing.assert_allclose(found, [[1, 0, 0], [0, 1, 0], [0, 0, 0]], atol=1e-9)
    turned = ImageSky(pixels, 180.0).radiance(np.array([[0, -0.98, -0.2]]))
    np.testing.assert_allclose(turned, [[0, 1, 0]], atol=1e-9)
