"""White points: samples that are too bright for how rarely they come.

Light that glass gathers is found by few of the rays, and these bring much of it. Until there are
enough of them, what the eye sees is not that light but single white points. Here bright samples
are kept apart by their brightness: one counts as not much more than white until there are others as
bright around it. Where light really is so bright they come by and by, so that the mean is right in
the end. The idea and the layers are those of Zirr, Hanika and Dachsbacher 2018, *Re-weighting
firefly samples for improved finite-sample Monte Carlo estimates*.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.render.tracer import Floats, Ints

LAYERS, BASE = 6, 8.0
"""How many layers there are, and by how much each is brighter than the one before."""

ENOUGH = 10.0
"""Samples as bright in a pixel and the eight around it that make any of them count in full."""

BYTES_PER_PIXEL = 12 * LAYERS + 40
"""Memory of a cascade and of its use, an upper estimate."""


class Cascade:
    """Sums of bright samples, apart by brightness.

    Parameters
    ----------
    size
        Width and height in pixels.
    white
        Brightness of the first layer.

    Attributes
    ----------
    layers
        (L, H, W, 3) float32 sums. A sample between two brightnesses is parted between their layers
        so that it counts as one of them in all.
    """

    def __init__(self, size: tuple[int, int], white: float) -> None:
        self.white = white
        self.layers = np.zeros((LAYERS, size[1], size[0], 3), dtype=np.float32)

    def add(self, pixels: Ints, rgb: Floats) -> None:
        """Add samples (P, K, 3) to P different pixels, given by their positions in the picture."""
        bright = rgb.mean(axis=2) / self.white
        for_pixel, sample = np.nonzero(bright > 1.0)
        if len(for_pixel) == 0:
            return
        light, level = rgb[for_pixel, sample], np.log(bright[for_pixel, sample]) / np.log(BASE)
        low = np.minimum(level.astype(np.int64), LAYERS - 1)
        part = (BASE ** (low - level) - 1.0 / BASE) / (1.0 - 1.0 / BASE)
        part = np.where(low == LAYERS - 1, 1.0, part)
        flat = self.layers.reshape(LAYERS, -1, 3)
        at = pixels[for_pixel]
        np.add.at(flat, (low, at), (part[:, None] * light).astype(np.float32))
        high = np.minimum(low + 1, LAYERS - 1)
        np.add.at(flat, (high, at), ((1.0 - part)[:, None] * light).astype(np.float32))

    def excess(self) -> NDArray[np.float32]:
        """Return the (H, W, 3) sums of light that does not count."""
        total = np.zeros(self.layers.shape[1:], dtype=np.float32)
        # How many samples of a pixel and those around it are in every layer or a brighter one.
        count = np.empty(self.layers.shape[:3], dtype=np.float32)
        for k, layer in enumerate(self.layers):
            count[k] = _around(layer.mean(axis=2) / np.float32(self.white * BASE**k))
        count = np.cumsum(count[::-1], axis=0)[::-1]
        # The first layer always counts. Samples that are a little darker speak for others, but not
        # those of the first layer, which are many wherever the sun shines.
        for k in range(1, LAYERS):
            trust = np.clip((count[max(k - 1, 1)] - 1.0) / np.float32(ENOUGH - 1.0), 0.0, 1.0)
            lost = (1.0 - trust) * np.float32(1.0 - BASE**-k)
            total += lost[..., None] * self.layers[k]
        return total


def _around(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the (H, W) sums of every pixel and the eight around it."""
    wide = np.pad(values, 1)
    rows = wide[:-2] + wide[1:-1] + wide[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])
