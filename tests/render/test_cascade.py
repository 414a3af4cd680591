"""Bright samples: alone they are no more than white, among their like they count."""

import numpy as np
import pytest

from pcsg.render.cascade import ENOUGH, Cascade

SIZE = 7, 5
EVERYWHERE = np.arange(35)


def filled(samples):
    """Return what of the sums (5, 7, 3) of samples (35, K, 3) remains."""
    cascade = Cascade(SIZE, 1.0)
    cascade.add(EVERYWHERE, samples)
    return samples.sum(axis=1).reshape(5, 7, 3) - cascade.excess()


def test_dark_pictures_stay_as_they_are():
    samples = np.random.default_rng(1).random((35, 8, 3))
    np.testing.assert_array_equal(filled(samples), samples.sum(axis=1).reshape(5, 7, 3))


@pytest.mark.parametrize("brightness", [1.5, 7.9, 8.1, 300.0, 3000.0])
def test_a_white_point_is_white(brightness):
    """Whatever its brightness, a sample alone counts as white, in its own colour."""
    samples = np.zeros((35, 8, 3))
    samples[17, 3] = np.array([0.9, 1.0, 1.1]) * brightness
    found = filled(samples)
    np.testing.assert_allclose(found[2, 3], [0.9, 1.0, 1.1], rtol=1e-3)
    found[2, 3] = 0
    assert (found == 0).all()


@pytest.mark.parametrize("brightness", [20.0, 3000.0])
def test_bright_things_stay_bright(brightness):
    samples = np.full((35, 16, 3), brightness)
    np.testing.assert_allclose(filled(samples), 16 * brightness, rtol=1e-5)
    # Also where they cover no more than a pixel.
    samples[EVERYWHERE != 17] = 0.1
    np.testing.assert_allclose(filled(samples)[2, 3], 16 * brightness, rtol=1e-5)


def test_rare_light_comes_with_the_samples():
    """One sample of a hundred has all the light: what is missing becomes less."""
    shares = []
    for count in (64, 256, 4096):
        rng = np.random.default_rng(2)
        samples = np.zeros((35, count, 3))
        samples[rng.random((35, count)) < 0.01] = 100.0
        shares.append(filled(samples).sum() / samples.sum())
    assert shares[0] < 0.75
    assert shares[0] < shares[1]
    assert shares[2] == pytest.approx(1.0)


def test_more_company_counts_more():
    found = []
    for others in range(int(ENOUGH) + 2):
        samples = np.zeros((35, 16, 3))
        samples[17, 0] = samples[18, :others] = 500.0
        found.append(filled(samples)[2, 3, 0])
    assert (np.diff(found) >= 0).all()
    assert found[0] == pytest.approx(1.0)
    assert found[-1] == pytest.approx(500.0)
