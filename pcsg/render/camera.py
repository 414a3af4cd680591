"""The camera: rays through pixels.

World frame: right-handed, z up. Pixel (0, 0) is top left; x grows to the right, y downwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pcsg.render.tracer import Floats


@dataclass(frozen=True)
class Camera:
    """A perspective camera with a thin lens.

    Attributes
    ----------
    eye, target, up
        Position, the point in the middle of the picture, and which way is up.
    fov
        Vertical angle of view in degrees.
    aperture
        Diameter of the lens in world units; 0 is a pinhole.
    focus
        Distance of what is sharp, along the axis.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float = 35.0
    aperture: float = 0.0
    focus: float | None = None

    @cached_property
    def _basis(self) -> tuple[Floats, Floats, Floats]:
        return basis(self.eye, self.target, self.up)

    def rays(
        self, x: Floats, y: Floats, size: tuple[float, float], lens: Floats | None = None
    ) -> Any:
        """Return the rays through points of the picture.

        Parameters
        ----------
        x, y
            (N,) coordinates, commonly in pixels: the centre of the first one is (0.5, 0.5).
        size
            Width and height of the picture, in the unit of x and y.
        lens
            (N, 2) numbers in [0, 1) that choose points of the lens.

        Returns
        -------
        origins, directions
            (N, 3) each; directions have unit length.
        """
        right, up, forward = self._basis
        width, height = size
        tangent = math.tan(math.radians(self.fov) / 2)
        across = (2.0 * x - width) / height * tangent
        upward = (height - 2.0 * y) / height * tangent
        directions = np.empty((len(across), 3))
        for k in range(3):  # arrays of three columns are slow in NumPy
            directions[:, k] = forward[k] + across * right[k] + upward * up[k]
        origins = np.broadcast_to(np.asarray(self.eye, dtype=float), directions.shape).copy()
        if self.aperture > 0 and lens is not None:
            focus = self.focus or math.dist(self.eye, self.target)
            radius = 0.5 * self.aperture * np.sqrt(lens[:, 0])
            angle = 2 * np.pi * lens[:, 1]
            shift = (radius * np.cos(angle))[:, None] * right
            shift += (radius * np.sin(angle))[:, None] * up
            origins += shift
            directions = directions * focus - shift
        length = np.sqrt(np.einsum("ij,ij->i", directions, directions))
        for k in range(3):
            directions[:, k] /= length
        return origins, directions


def basis(eye: Any, target: Any, up: Any) -> tuple[Floats, Floats, Floats]:
    """Return the unit vectors right, up and forward of a camera.

    An up vector along the line of sight is replaced by the axis most square to it.
    """
    forward = _unit(np.asarray(target, float) - np.asarray(eye, float))
    upward = np.asarray(up, float)
    upward = upward / max(float(np.abs(upward).max()), 1e-300)  # no square is beyond numbers
    right = np.cross(forward, upward)
    if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(upward):
        right = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    right = _unit(right)
    return right, np.cross(right, forward), forward


def _unit(v: Floats) -> Floats:
    v = v / np.abs(v).max()
    return np.asarray(v / np.linalg.norm(v))
