import numpy as np
import pytest

from pcsg.render.view import CURVES, KNEE, View, compress, decode_srgb, encode_srgb


def test_srgb_there_and_back():
    linear = np.linspace(0, 1, 4001)
    np.testing.assert_allclose(decode_srgb(encode_srgb(linear)), linear, atol=1e-6)
    shown = np.arange(256) / 255
    back = np.round(encode_srgb(decode_srgb(shown)) * 255)
    assert (back == np.arange(256)).all()


def test_srgb_at_known_values():
    np.testing.assert_allclose(
        encode_srgb([0, 0.0031308, 0.18, 0.5, 1]), [0, 0.04045, 0.46136, 0.73536, 1], atol=1e-5
    )


def test_highlights_are_compressed_not_clipped():
    linear = np.linspace(0, 20, 5000)
    shown = compress(linear)
    assert (np.diff(shown) > 0).all()
    assert shown.max() < 1
    assert (shown[linear <= KNEE] == linear[linear <= KNEE]).all()
    slope = np.diff(shown) / np.diff(linear)
    assert np.abs(np.diff(slope)).max() < 0.05
    assert View().encode(np.float32(-1.0)) == 0
    assert View().encode(np.ones(3, np.float32)).dtype == np.float32


@pytest.mark.parametrize("curve", CURVES)
def test_curves_rise_from_black_and_stay_below_white(curve):
    shown = View(curve).encode(np.linspace(0, 50, 5000))
    assert shown[0] == 0
    assert (np.diff(shown) >= 0).all()
    assert 0.97 < shown[-1] <= 1
    grey = View(curve).encode(0.18)
    assert 0.4 < grey < 0.5


def test_a_stop_is_twice_the_light():
    linear = np.linspace(0, 2, 50)
    np.testing.assert_allclose(
        View("filmic", 1.0).encode(linear), View("filmic").encode(2 * linear)
    )
