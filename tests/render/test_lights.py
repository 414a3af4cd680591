import numpy as np
import pytest

from pcsg.errors import UsageError
from pcsg.graph.settings import SETTINGS
from pcsg.render.lights import PointLight, Sky, Sun, make_points, make_sky, make_sun
from pcsg.render.sampler import Sampler, cosine_hemisphere


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
    light = PointLight((0, 0, 3), (9.0, 9.0, 9.0), 0.0)
    sample = light.sample(np.zeros((1, 3)), np.zeros((1, 2)))
    np.testing.assert_allclose(sample.irradiance, 1)
    np.testing.assert_allclose(sample.direction, [[0, 0, 1]])
    assert sample.distance[0] == 3


def test_the_sky_gives_what_its_table_says():
    sky = make_sky(defaults("sky"))
    assert isinstance(sky, Sky)
    for normal in ([0, 0, 1.0], [0, 0, -1.0], [0.6, 0, 0.8], [1.0, 0, 0]):
        normals = np.broadcast_to(np.array(normal), (4096, 3))
        expected = sky.radiance(cosine_hemisphere(numbers(4096), normals)).mean(axis=0)
        np.testing.assert_allclose(sky.ambient(normals[:1])[0], expected, rtol=5e-3)


def test_a_uniform_sky_is_uniform_light():
    sky = Sky((0.5,) * 3, (0.5,) * 3, (0.5,) * 3)
    normals = np.array([[0, 0, 1.0], [0.6, 0, -0.8]])
    np.testing.assert_allclose(sky.ambient(normals), 0.5)


def test_lights_that_give_nothing_are_left_out():
    assert make_sun({**defaults("sun"), "strength": 0.0}) is None
    assert make_points([{**defaults("light"), "strength": 0.0}]) == []
    assert make_sky({**defaults("sky"), "kind": "none"}).zenith == (0, 0, 0)


def test_mistakes_are_named():
    with pytest.raises(UsageError, match="direction"):
        make_sun({**defaults("sun"), "direction": (0, 0, 0)})
    with pytest.raises(UsageError, match="physical"):
        make_sky({**defaults("sky"), "kind": "physical"})
    assert isinstance(make_sun(defaults("sun")), Sun)
