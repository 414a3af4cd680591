"""Rays for measurements: those of a picture, and random ones from all around."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class View(NamedTuple):
    """A camera that shows a box: eye, target, and vertical angle in degrees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float

    @property
    def option(self) -> str:
        """As ``pcsg render --camera`` takes it."""
        eye, target = (",".join(f"{x:.9g}" for x in p) for p in (self.eye, self.target))
        return f"eye={eye} target={target} fov={self.fov:g}"

    @property
    def basis(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors right, up and forward."""
        forward = np.subtract(self.target, self.eye)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward


def look_at(bounds: Floats) -> View:
    """Return a view that a box fills."""
    centre, radius = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0])) / 2
    direction = np.array([0.6, -0.7, 0.4]) / np.linalg.norm([0.6, -0.7, 0.4])
    eye = centre + 2.2 * radius * direction
    return View(tuple(map(float, eye)), tuple(map(float, centre)), 40.0)


def picture_rays(view: View, side: int) -> tuple[Floats, Floats]:
    """Return the rays through the pixels of a square picture, 8 x 8 pixels after each other."""
    right, up, forward = view.basis
    y, x = np.divmod(np.arange(side * side), side)
    order = np.lexsort((x % 8, y % 8, x // 8, y // 8))
    tangent = np.tan(np.radians(view.fov) / 2)
    across = ((x[order] + 0.5) / side * 2 - 1) * tangent
    upward = (1 - (y[order] + 0.5) / side * 2) * tangent
    directions = forward + across[:, None] * right + upward[:, None] * up
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return np.broadcast_to(np.array(view.eye), directions.shape).copy(), directions


def random_rays(bounds: Floats, n: int) -> tuple[Floats, Floats]:
    """Return rays from a sphere around a box to random points of it."""
    rng = np.random.default_rng(1)
    centre, radius = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0])) / 2
    origins = rng.normal(size=(n, 3))
    origins = centre + 1.3 * radius * origins / np.linalg.norm(origins, axis=1)[:, None]
    directions = bounds[0] + rng.random((n, 3)) * (bounds[1] - bounds[0]) - origins
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return origins, directions
