"""The physical sky against a second, scalar writing of its paper, and what is known of skies."""

import math

import numpy as np
import pytest

from pcsg.render.daylight import PhysicalSky, luminance_xyy, sunlight

DIRECTIONS = [(0, 0, 1), (0, 1, 0.5), (-1, 0, 0.3), (0, -1, 0.1), (1, 0.3, 0.5)]


def naive(sun_angle, t, theta, gamma):
    """Preetham, Shirley and Smits 1999, appendix A.2, one number after the other."""

    def perez(a, b, c, d, e, theta, gamma):
        return (1 + a * math.exp(b / math.cos(theta))) * (
            1 + c * math.exp(d * gamma) + e * math.cos(gamma) ** 2
        )

    luminance = (
        0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251,
        0.1206 * t - 2.5771, -0.0670 * t + 0.3703,
    )  # fmt: skip
    x = (
        -0.0193 * t - 0.2592, -0.0665 * t + 0.0008, -0.0004 * t + 0.2125,
        -0.0641 * t - 0.8989, -0.0033 * t + 0.0452,
    )  # fmt: skip
    y = (
        -0.0167 * t - 0.2608, -0.0950 * t + 0.0092, -0.0079 * t + 0.2102,
        -0.0441 * t - 1.6537, -0.0109 * t + 0.0529,
    )  # fmt: skip
    s = sun_angle
    chi = (4 / 9 - t / 120) * (math.pi - 2 * s)
    zenith = (
        (4.0453 * t - 4.9710) * math.tan(chi) - 0.2155 * t + 2.4192,
        t * t * (0.00166 * s**3 - 0.00375 * s**2 + 0.00209 * s)
        + t * (-0.02903 * s**3 + 0.06377 * s**2 - 0.03202 * s + 0.00394)
        + 0.11693 * s**3 - 0.21196 * s**2 + 0.06052 * s + 0.25886,
        t * t * (0.00275 * s**3 - 0.00610 * s**2 + 0.00317 * s)
        + t * (-0.04214 * s**3 + 0.08970 * s**2 - 0.04153 * s + 0.00516)
        + 0.15346 * s**3 - 0.26756 * s**2 + 0.06670 * s + 0.26688,
    )  # fmt: skip
    return [
        z * perez(*k, theta, gamma) / perez(*k, 0.0, s)
        for z, k in zip(zenith, (luminance, x, y), strict=True)
    ]


@pytest.mark.parametrize("turbidity", [2.0, 3.5, 6.0])
@pytest.mark.parametrize("sun", [(0.6, 0.0, 0.8), (0.0, 0.95, 0.3122499)])
def test_the_formula_is_the_papers(sun, turbidity):
    sun = np.array(sun) / np.linalg.norm(sun)
    for towards in DIRECTIONS:
        d = np.array(towards, float) / np.linalg.norm(towards)
        found = luminance_xyy(sun[2], turbidity, d[None], sun)[0]
        angles = math.acos(sun[2]), math.acos(d[2]), math.acos(d @ sun)
        np.testing.assert_allclose(found, naive(angles[0], turbidity, *angles[1:]), rtol=1e-9)


def test_the_sky_is_blue_and_brightest_by_the_sun():
    sky = PhysicalSky((0.6, 0.0, 0.8), 2.5, 1.0)
    away, near = sky.radiance(np.array([[-0.6, 0.0, 0.8], [0.6, 0.05, 0.8]]))
    assert away[2] > 1.5 * away[0]
    assert near.mean() > 3 * away.mean()
    below = sky.radiance(np.array([[0.0, 0.6, -0.8]]))[0]
    assert (below > 0).all()
    assert below[0] > below[2] * 0.8  # earth, not sky


def test_low_suns_are_dim_and_red():
    noon, evening = sunlight(1.0, 2.0), sunlight(0.05, 3.0)
    np.testing.assert_allclose(noon, 1.0)
    assert evening[0] > 2 * evening[1] > 4 * evening[2]
    assert sunlight(-0.1, 3.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("sun", [(0, 0, 1.0), (1.0, 0, 0.0), (1.0, 0.0, -0.3)])
def test_every_sun_gives_a_sky(sun):
    sky = PhysicalSky(sun, 3.0, 1.0)
    z = np.linspace(-1, 1, 41)
    around = np.stack([np.sqrt(1 - z * z), 0 * z, z], axis=1)
    found = sky.radiance(around)
    assert np.isfinite(found).all()
    assert (found >= 0).all()
