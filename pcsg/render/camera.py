"""The camera: rays through pixels.

World frame: right-handed, z up. Pixel (0, 0) is top left; x grows to the right, y downwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pcsg.graph.settings import ANGLES
from pcsg.render.sampler import around
from pcsg.render.tracer import Bools, Floats

ROUND = 90.0
"""Angle of view, as of a perspective camera, at whose distance cameras that see all around stand
when they are placed automatically."""


class Widths(NamedTuple):
    """How wide a pixel is at a distance t along its ray: ``fixed + spread t``."""

    fixed: float
    spread: float


@dataclass(frozen=True)
class Camera:
    """A camera with a thin lens.

    Attributes
    ----------
    eye, target, up
        Position, the point in the middle of the picture, and which way is up. A panorama stays
        level: its middle is where the target is, seen from above.
    fov
        Vertical angle of view in degrees; None for that of the projection.
    aperture
        Diameter of the lens in world units; 0 is a pinhole.
    focus
        Distance of what is sharp: along the axis, or along the ray if it sees all around.
    projection
        One of `PROJECTIONS`.
    height
        Of an orthographic picture in world units; None for what a perspective camera of the same
        angle shows at the target.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float | None = None
    aperture: float = 0.0
    focus: float | None = None
    projection: str = "perspective"
    height: float | None = None

    @cached_property
    def _basis(self) -> tuple[Floats, Floats, Floats]:
        return basis(self.eye, self.target, self.up)

    @property
    def keys(self) -> str:
        """Where it stands and what it shows, as ``pcsg render --camera`` takes it."""
        eye, target = (",".join(f"{x:.6g}" for x in p) for p in (self.eye, self.target))
        words = f"eye={eye} target={target} fov={math.degrees(self.angle):.6g}"
        if self.projection != "perspective":
            words += f" projection={self.projection}"
        return words + (f" height={self.height:.6g}" if self.height else "")

    @property
    def angle(self) -> float:
        """Vertical angle of view in radians."""
        default = ANGLES[self.projection][0]
        return math.radians(default if self.fov is None else self.fov)

    @property
    def tall(self) -> float:
        """Height of the picture in world units: at the distance 1, or anywhere if orthographic."""
        tangent = 2.0 * math.tan(self.angle / 2)
        if self.projection != "orthographic":
            return tangent
        return self.height or tangent * math.dist(self.eye, self.target)

    def widths(self, rows: float) -> Widths:
        """Return how wide a pixel is in a picture of so many rows."""
        if self.projection == "orthographic":
            return Widths(self.tall / rows, 0.0)
        if self.projection == "perspective":
            return Widths(0.0, self.tall / rows)
        return Widths(0.0, self.angle / rows)

    def covers(self, x: Floats, y: Floats, size: tuple[float, float]) -> Bools | None:
        """Return (N,) which points of the picture show something; None for all, always.

        A fisheye's picture is a disc, a panorama's no wider than once around.
        """
        across, upward = _from_middle(x, y, size)
        if self.projection == "fisheye":
            return np.asarray(across * across + upward * upward <= 1.0)
        if self.projection == "panorama":
            return np.asarray(np.abs(across) * self.angle / 2.0 <= math.pi)
        return None

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
        if self.projection == "orthographic":
            across, upward = (v * (self.tall / 2.0) for v in _from_middle(x, y, size))
            origins = _sum(np.asarray(self.eye, float), (across, right), (upward, up))
            directions = np.tile(forward, (len(origins), 1))
        else:
            directions = self._towards(x, y, size)
            origins = np.broadcast_to(np.asarray(self.eye, dtype=float), directions.shape).copy()
        if self.aperture > 0 and lens is not None:
            focus = self.focus or math.dist(self.eye, self.target)
            radius = 0.5 * self.aperture * np.sqrt(lens[:, 0])
            angle = 2 * np.pi * lens[:, 1]
            if self.projection in ("perspective", "orthographic"):
                shift = (radius * np.cos(angle))[:, None] * right
                shift += (radius * np.sin(angle))[:, None] * up
            else:
                directions = _unit_rows(directions)
                # A lens that faces every ray.
                shift = radius[:, None] * around(directions, np.zeros(len(radius)), lens[:, 1])
            origins += shift
            directions = directions * focus - shift
        return origins, _unit_rows(directions)

    def _towards(self, x: Floats, y: Floats, size: tuple[float, float]) -> Floats:
        """Return (N, 3) directions from the eye through points of the picture, of any length."""
        right, up, forward = self._basis
        if self.projection == "perspective":
            width, height = size
            tangent = math.tan(self.angle / 2)
            across = (2.0 * x - width) / height * tangent
            upward = (height - 2.0 * y) / height * tangent
            return _sum(forward, (across, right), (upward, up))
        across, upward = (v * (self.angle / 2.0) for v in _from_middle(x, y, size))
        zero = np.zeros(3)
        if self.projection == "fisheye":
            off = np.sqrt(across * across + upward * upward)
            side = np.sinc(off / math.pi)  # sin(off) / off, and 1 in the middle
            return _sum(zero, (np.cos(off), forward), (side * across, right), (side * upward, up))
        up = _unit(np.asarray(self.up, float))
        flat = np.cos(upward)
        return _sum(
            zero,
            (flat * np.cos(across), np.cross(up, right)),
            (flat * np.sin(across), right),
            (np.sin(upward), up),
        )


def _sum(start: Floats, *parts: tuple[Floats, Floats]) -> Floats:
    """Return (N, 3) sums of a vector and of others by (N,) lengths."""
    total = np.empty((len(parts[0][0]), 3))
    for k in range(3):  # arrays of three columns are slow in NumPy
        total[:, k] = start[k]
        for length, axis in parts:
            total[:, k] += length * axis[k]
    return total


def _from_middle(x: Floats, y: Floats, size: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return coordinates from the middle to the right and up, in half heights of the picture."""
    width, height = size
    return (2.0 * x - width) / height, (height - 2.0 * y) / height


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


def _unit_rows(v: Floats) -> Floats:
    length = np.sqrt(np.einsum("ij,ij->i", v, v))
    unit = np.empty_like(v)
    for k in range(3):
        unit[:, k] = v[:, k] / length
    return unit
