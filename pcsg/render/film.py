"""The film: sums of samples per pixel, and which pixels need more of them.

Each pixel's samples are added by one batch per pass and in one order, so the sums have the same
bits however many threads there are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.render import cascade
from pcsg.render.cascade import Cascade
from pcsg.render.exposure import BRIGHTEST, Layers, add_samples, keep_first
from pcsg.render.tracer import GROUND, Bools, Floats, Ints
from pcsg.render.view import View
from pcsg.trace.hits import Hits

BYTES_PER_PIXEL = 120 + cascade.BYTES_PER_PIXEL
"""Memory of a film with its picture, an upper estimate."""

WHITE = 2.0
"""Brightness that single samples may have, over what is shown as white."""

CONTRAST = 0.03
"""Difference between neighbours, as displayed (0 to 1), that asks for more samples."""

NOISE = 0.006
"""Standard error of a pixel, as displayed, that asks for more samples."""

BEND = 0.03
"""Likewise 1 - cos between neighbours' normals; and the relative step in depth."""


class Film:
    """Accumulates samples.

    Parameters
    ----------
    size
        Width and height in pixels.
    view
        How light is shown: what looks alike needs no more samples.
    rare
        Whether there may be bright samples that are too rare to be shown: see `Cascade`.
    judged
        Whether somebody will ask which pixels are unfinished.

    Attributes
    ----------
    total
        (H, W, 3) float32 sum of linear samples.
    count
        (H, W) int32 number of samples.
    tone, tone2
        (H, W) float32 sums of samples' brightness as displayed, and of its square; zero where
        nobody judges by it.
    depth, normal, albedo, label, leaf
        (H, W[, 3]) of the first sample, at the pixel's centre.
    """

    def __init__(
        self, size: tuple[int, int], view: View, rare: bool = False, judged: bool = True
    ) -> None:
        width, height = size
        self.size = size
        self.view = view
        shape = (height, width)
        self.total = np.zeros((*shape, 3), dtype=np.float32)
        self.count = np.zeros(shape, dtype=np.int32)
        self.tone = np.zeros(shape, dtype=np.float32)
        self.tone2 = np.zeros(shape, dtype=np.float32)
        self.depth = np.full(shape, np.inf, dtype=np.float32)
        self.normal = np.zeros((*shape, 3), dtype=np.float32)
        self.albedo = np.zeros((*shape, 3), dtype=np.float32)
        self.label = np.full(shape, -1, dtype=np.int64)
        self.leaf = np.full(shape, -1, dtype=np.int32)
        self._judged = judged
        self._cascade = Cascade(size, WHITE * 2.0**-view.exposure) if rare else None

    def add(self, pixels: Ints, rgb: Floats) -> None:
        """Add samples (P, K, 3) to P different pixels, given by their positions in the picture."""
        add_samples(pixels, rgb, self.total.reshape(-1, 3), self.count.reshape(-1))
        if self._judged:
            tone = self.view.encode(rgb).mean(axis=2)
            self.tone.reshape(-1)[pixels] += tone.sum(axis=1).astype(np.float32)
            self.tone2.reshape(-1)[pixels] += (tone * tone).sum(axis=1).astype(np.float32)
        if self._cascade is not None:
            self._cascade.add(pixels, np.clip(rgb, -BRIGHTEST, BRIGHTEST))

    def set_first(self, pixels: Ints, hits: Hits, albedo: Floats) -> None:
        """Keep what the rays through the centres of P pixels met, and its colours (P, 3)."""
        n = self.count.size
        layers = Layers._make(layer.reshape(n, *layer.shape[2:]) for layer in self.layers)
        keep_first(
            pixels,
            np.ascontiguousarray(hits.t),
            np.ascontiguousarray(hits.normal),
            np.ascontiguousarray(albedo),
            np.ascontiguousarray(hits.label),
            np.ascontiguousarray(hits.leaf),
            layers,
        )

    @property
    def layers(self) -> Layers:
        """What the first samples met, (H, W[, 3]) each."""
        return Layers(self.depth, self.normal, self.albedo, self.label, self.leaf)

    def copied_layers(self) -> Layers:
        """Return `layers` as they are now."""
        return Layers._make(layer.copy() for layer in self.layers)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return all that has been gathered, by name; writing to it changes the film."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        if self._cascade is not None:
            arrays["layers"] = self._cascade.layers
        return arrays

    def mean(self) -> NDArray[np.float32]:
        """Return the (H, W, 3) linear picture; black where there are no samples yet."""
        total = self.total if self._cascade is None else self.total - self._cascade.excess()
        return self._per_sample(total)

    def _per_sample(self, total: NDArray[np.float32]) -> NDArray[np.float32]:
        count = np.maximum(self.count, 1)[..., None].astype(np.float32)
        return np.asarray(total / count, dtype=np.float32)

    def unfinished(self, taken: int) -> Bools:
        """Return the (H, W) pixels that need more samples.

        Parameters
        ----------
        taken
            How many samples the last pass brought its pixels to. Only they and their neighbours
            can need more.
        """
        last = self.count == taken
        different = np.zeros(self.count.shape, dtype=bool)
        shown, error = self.view.encode(self._per_sample(self.total)), self._error()
        for here, there in _NEIGHBOURS:
            step = np.abs(shown[here] - shown[there]).max(axis=2) > CONTRAST
            if taken == 1:
                step |= self._is_edge(here, there)
            else:
                # Neighbours may just differ; what asks for more now is noise in one of them.
                step &= np.maximum(error[here], error[there]) > NOISE
            different[here] |= step
            different[there] |= step
        if taken == 1:
            different = _grown(different)
        else:
            different |= error > NOISE
        return np.asarray(different & last)

    def _error(self) -> NDArray[np.float32]:
        """Return the (H, W) standard error of the brightness as displayed."""
        n = np.maximum(self.count, 1).astype(np.float32)
        mean = self.tone / n
        variance = np.maximum(self.tone2 / n - mean * mean, 0.0)
        return np.asarray(np.sqrt(variance / n), dtype=np.float32)

    def _is_edge(self, here: Slices, there: Slices) -> Bools:
        """Return whether two neighbours see different things."""
        near, far = self.depth[here], self.depth[there]
        with np.errstate(invalid="ignore"):
            step = np.abs(near - far) > BEND * np.minimum(near, far)
        turned = np.einsum("...i,...i", self.normal[here], self.normal[there]) < 1 - BEND
        # Depth on the ground plane changes fast towards the horizon, without any edge.
        met = (np.isfinite(near) | np.isfinite(far)) & (self.leaf[here] != GROUND)
        return np.asarray((self.leaf[here] != self.leaf[there]) | (met & (step | turned)))


_ARRAYS = ("total", "count", "tone", "tone2", "depth", "normal", "albedo", "label", "leaf")

Slices = tuple[slice, slice]

_ALL, _LOW, _HIGH = slice(None), slice(None, -1), slice(1, None)
_NEIGHBOURS: tuple[tuple[Slices, Slices], ...] = (
    ((_ALL, _LOW), (_ALL, _HIGH)),
    ((_LOW, _ALL), (_HIGH, _ALL)),
    ((_LOW, _LOW), (_HIGH, _HIGH)),
    ((_LOW, _HIGH), (_HIGH, _LOW)),
)


def _grown(mask: Bools) -> Bools:
    """Return a mask and its neighbours up, down, left and right."""
    grown = mask.copy()
    for here, there in _NEIGHBOURS[:2]:
        grown[here] |= mask[there]
        grown[there] |= mask[here]
    return grown
