"""Layers of a picture as the bytes that a browser shows."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from pcsg.render.image import Image

GRID = 128, 96
"""Most columns and rows of the distances that come with a picture."""

QUALITY = 82
"""Of pictures that are not the last ones."""


def color_layer(image: Image, layer: str) -> NDArray[np.uint8]:
    """Return a layer as (H, W, 3) pixels, or (H, W, 4) where some are unfinished."""
    if layer == "picture":
        return image.to_bytes()
    shown = _COLORINGS[layer](image)
    if image.finished.all():
        return shown
    opacity = np.where(image.finished, 255, 0).astype(np.uint8)
    return np.concatenate([shown, opacity[..., None]], axis=2)


def encode(pixels: NDArray[np.uint8], exact: bool) -> tuple[bytes, str]:
    """Return a picture as a file's bytes, and their kind; without loss if it must be exact."""
    buffer = io.BytesIO()
    if exact or pixels.shape[2] == 4:
        Pillow.fromarray(pixels).save(buffer, "PNG", compress_level=1)
        return buffer.getvalue(), "image/png"
    Pillow.fromarray(pixels).save(buffer, "JPEG", quality=QUALITY)
    return buffer.getvalue(), "image/jpeg"


def lay_over(pixels: NDArray[np.uint8], below: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    """Return a picture with a coarser one where it is unfinished; both of any size."""
    if pixels.shape[2] == 3 or below is None:
        return pixels
    height, width = pixels.shape[:2]
    coarse = Pillow.fromarray(below[..., :3]).resize((width, height), Pillow.Resampling.BILINEAR)
    return np.where(pixels[..., 3:] > 0, pixels[..., :3], np.asarray(coarse))


def sample_depth(image: Image) -> NDArray[np.float32]:
    """Return distances (rows, columns) of what is seen, at most `GRID` of them; inf for nothing.

    Of several pixels the nearest counts, so that a twig is found.
    """
    depth = np.where(image.finished, image.depth, np.float32(np.inf))
    for axis, most in ((1, GRID[0]), (0, GRID[1])):
        n = depth.shape[axis]
        if n > most:
            starts = np.arange(most) * n // most
            depth = np.minimum.reduceat(depth, starts, axis=axis)
    return np.ascontiguousarray(depth, np.float32)


def _color_depth(image: Image) -> NDArray[np.uint8]:
    """Near is bright."""
    depth = image.depth.astype(np.float64)
    met = np.isfinite(depth)
    if not met.any():
        return _grey(np.zeros(depth.shape))
    # Few pixels far away, as on a meadow, must not make all others alike.
    near, far = np.quantile(depth[met], (0.0, 0.98))
    share = (np.where(met, depth, far) - near) / max(far - near, 1e-300)
    return _grey(np.where(met, 0.08 + 0.92 * (1.0 - np.clip(share, 0.0, 1.0)), 0.0))


def _color_normal(image: Image) -> NDArray[np.uint8]:
    shown = 0.5 + 0.5 * image.normal
    shown[~np.isfinite(image.depth)] = 0.0
    return _bytes(shown)


def _color_albedo(image: Image) -> NDArray[np.uint8]:
    return _bytes(image.view.encode(np.clip(image.albedo, 0.0, 1.0)))


def _color_numbers(numbers: NDArray[Any]) -> NDArray[np.uint8]:
    """Different numbers get different colours; those below 0 are dark."""
    hue = np.mod(numbers.astype(np.float64) * 0.618034, 1.0)[..., None]
    phase = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0])
    shown = 0.55 + 0.4 * np.cos(2.0 * np.pi * (hue + phase))
    return _bytes(np.where((numbers < 0)[..., None], 0.1, shown))


def _grey(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.repeat(_bytes(values)[..., None], 3, axis=2)


def _bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    return np.asarray(values * 255.0 + 0.5, dtype=np.uint8)


_COLORINGS: Mapping[str, Callable[[Image], NDArray[np.uint8]]] = {
    "depth": _color_depth,
    "normal": _color_normal,
    "albedo": _color_albedo,
    "label": lambda image: _color_numbers(image.label),
    "leaf": lambda image: _color_numbers(image.leaf),
}
