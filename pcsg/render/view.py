"""View transforms: from linear light to what a display shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

KNEE = 0.75
"""Linear value above which the standard view compresses highlights instead of clipping them."""


def encode_srgb(linear: Any) -> Any:
    """Return sRGB values of linear values in [0, 1] (IEC 61966-2-1)."""
    linear = np.asarray(linear)
    shown = np.asarray(np.maximum(linear, 0.0031308) ** (1 / 2.4))
    shown *= 1.055
    shown -= 0.055
    dark = linear <= 0.0031308
    shown[dark] = 12.92 * linear[dark]
    return shown


def decode_srgb(shown: Any) -> Any:
    """Return linear values of sRGB values in [0, 1] (IEC 61966-2-1)."""
    shown = np.asarray(shown)
    return np.where(
        shown <= 0.04045, shown / 12.92, ((np.maximum(shown, 0.04045) + 0.055) / 1.055) ** 2.4
    )


def compress(linear: Any) -> Any:
    """Return values below 1: unchanged up to `KNEE`, then a smooth shoulder."""
    shown = np.asarray(np.maximum(linear, 0.0))
    bright = ~(shown <= KNEE)
    over = (shown[bright] - KNEE) / (1.0 - KNEE)
    shown[bright] = KNEE + (1.0 - KNEE) * (over / (1.0 + over))
    return shown


def film_curve(linear: Any) -> Any:
    """Return values below 1 with the toe and the long shoulder of film.

    The fit of Narkowicz 2016 to the curve of the Academy's reference display, for light that is
    0.6 times as bright as the fit takes, so that middle grey stays where it is.
    """
    x = 0.6 * np.maximum(linear, 0.0)
    return np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0)


WHITEST = 1e9
"""Brightness above which nothing looks different, and whose square fits into single precision."""

CURVES = {"standard": compress, "filmic": film_curve}


@dataclass(frozen=True)
class View:
    """How linear light is shown.

    Attributes
    ----------
    curve
        One of `CURVES`.
    exposure
        In stops: 1 is twice as bright.
    """

    curve: str = "standard"
    exposure: float = 0.0

    def encode(self, linear: Any) -> Any:
        """Return values to display, in [0, 1]."""
        scale = np.float32(2.0**self.exposure)
        linear = np.minimum(np.asarray(linear), np.float32(WHITEST / scale))
        return encode_srgb(CURVES[self.curve](linear * scale))
