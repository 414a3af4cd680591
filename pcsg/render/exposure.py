"""What samples leave on the film, in one pass over them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit
from pcsg.render.tracer import Floats, Ints

BRIGHTEST = 1e30
"""Brightest light that is kept: the sum of a pixel's samples fits into single precision."""


@njit
def _bounded(light: float) -> float:
    """Return light whose sums single precision can hold."""
    if light > BRIGHTEST:
        return BRIGHTEST
    return -BRIGHTEST if light < -BRIGHTEST else light


class Layers(NamedTuple):
    """What the rays through the centres of N pixels met.

    Attributes
    ----------
    depth, normal, albedo : float32 (N,), (N, 3), (N, 3)
        Distance, infinite for nothing; zero there.
    label, leaf : int64 and int32 (N,)
    """

    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    label: Ints
    leaf: NDArray[np.int32]


@njit(entry=True)
def add_samples(
    pixels: Ints, rgb: Floats, total: NDArray[np.float32], count: NDArray[np.int32]
) -> None:
    """Add samples to pixels.

    Parameters
    ----------
    pixels
        (P,) different ones.
    rgb
        (P, K, 3) linear light of their samples.
    total, count
        (N, 3) sums and (N,) numbers of samples of all pixels.
    """
    for p in range(len(pixels)):
        pixel = pixels[p]
        for c in range(3):
            light = _bounded(rgb[p, 0, c])
            for k in range(1, rgb.shape[1]):
                light += _bounded(rgb[p, k, c])
            total[pixel, c] += np.float32(light)
        count[pixel] += rgb.shape[1]


@njit(entry=True)
def keep_first(
    pixels: Ints,
    t: Floats,
    normal: Floats,
    albedo: Floats,
    label: Ints,
    leaf: Ints,
    layers: Layers,
) -> None:
    """Write what the rays through the centres of pixels met.

    Parameters
    ----------
    pixels
        (P,) different ones.
    t, normal, label, leaf
        Fields of `Hits`, for each of them.
    albedo
        (P, 3) colours of what was met.
    layers
        Of all pixels.
    """
    for p in range(len(pixels)):
        pixel = pixels[p]
        # What is too far away for single precision is nowhere.
        layers.depth[pixel] = np.float32(t[p])
        for c in range(3):
            layers.normal[pixel, c] = np.float32(normal[p, c]) if t[p] < math.inf else 0.0
            layers.albedo[pixel, c] = np.float32(_bounded(albedo[p, c]))
        layers.label[pixel] = label[p]
        layers.leaf[pixel] = leaf[p]
