"""A scene from far away, whose parts are smaller than a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np

from pcsg.trace.coverage import Footprint


def seen_from_afar(
    pixels: int, target: tuple[float, float, float], tangent: float, count: int
) -> Any:
    """Return rays through a picture of so many pixels, several each, and their footprint."""
    rng = np.random.default_rng(8)
    eye = np.array([14.0, -20.0, 9.0])
    forward = np.subtract(target, eye)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    place = rng.random((count, 2)) * 2.0 - 1.0
    directions = forward + tangent * (
        place[:, :1] * right + place[:, 1:] * np.cross(right, forward)
    )
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    footprint = Footprint(np.zeros(count), np.full(count, 2.0 * tangent / pixels))
    return np.broadcast_to(eye, (count, 3)).copy(), directions, footprint


def brightness(hits: Any) -> float:
    """Return how bright surfaces are on average, under one light."""
    light = np.clip(hits.normal @ np.array([0.37, -0.55, 0.75]), 0.0, None)
    return float(light.sum() / len(light))
