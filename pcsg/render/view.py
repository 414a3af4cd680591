"""View transforms: from linear light to what a display shows."""

from __future__ import annotations

from typing import Any

import numpy as np

KNEE = 0.75
"""Linear value above which the standard view compresses highlights instead of clipping them."""


def encode_srgb(linear: Any) -> Any:
    """Return sRGB values of linear values in [0, 1] (IEC 61966-2-1)."""
    linear = np.asarray(linear)
    return np.where(
        linear <= 0.0031308,
        12.92 * linear,
        1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055,
    )


def decode_srgb(shown: Any) -> Any:
    """Return linear values of sRGB values in [0, 1] (IEC 61966-2-1)."""
    shown = np.asarray(shown)
    return np.where(
        shown <= 0.04045, shown / 12.92, ((np.maximum(shown, 0.04045) + 0.055) / 1.055) ** 2.4
    )


def compress(linear: Any) -> Any:
    """Return values below 1: unchanged up to `KNEE`, then a smooth shoulder."""
    linear = np.maximum(linear, 0.0)
    over = np.maximum(linear - KNEE, 0.0) / (1.0 - KNEE)
    return np.where(linear <= KNEE, linear, KNEE + (1.0 - KNEE) * (over / (1.0 + over)))


def encode(linear: Any) -> Any:
    """Return the standard view of linear light: sRGB with a soft shoulder, in [0, 1]."""
    return encode_srgb(compress(linear))
