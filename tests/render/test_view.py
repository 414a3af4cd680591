import numpy as np

from pcsg.render.view import KNEE, compress, decode_srgb, encode, encode_srgb


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
    assert encode(np.float32(-1.0)) == 0
    assert encode(np.ones(3, np.float32)).dtype == np.float32
