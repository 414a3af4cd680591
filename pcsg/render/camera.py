"""The camera: rays through pixels, and where it stands when the grammar does not say.

World frame: right-handed, z up. Pixel (0, 0) is top left; x grows to the right, y downwards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.render.tracer import Floats, Tracer

MARGIN = 0.05
"""Part of the picture that stays free on each side of a framed box."""

AZIMUTH = -118.0
"""Where the automatic camera stands: degrees from +x towards +y. Three quarters from the front,
with the default sun at its right shoulder."""


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

    def rays(self, x: Floats, y: Floats, size: tuple[int, int], lens: Floats | None = None) -> Any:
        """Return the rays through points of the picture.

        Parameters
        ----------
        x, y
            (N,) pixel coordinates; the centre of the first pixel is (0.5, 0.5).
        size
            Width and height of the picture in pixels.
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
        directions = forward + across[:, None] * right + upward[:, None] * up
        origins = np.broadcast_to(np.asarray(self.eye, dtype=float), directions.shape).copy()
        if self.aperture > 0 and lens is not None:
            focus = self.focus or math.dist(self.eye, self.target)
            radius = 0.5 * self.aperture * np.sqrt(lens[:, 0])
            angle = 2 * np.pi * lens[:, 1]
            shift = (radius * np.cos(angle))[:, None] * right
            shift += (radius * np.sin(angle))[:, None] * up
            origins += shift
            directions = directions * focus - shift
        directions /= np.sqrt(np.einsum("ij,ij->i", directions, directions))[:, None]
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


def place(
    values: Mapping[str, Any], bounds: Floats, aspect: float, tracer: Tracer | None = None
) -> Camera:
    """Return the camera of a setting; what the setting leaves open frames the bounds.

    Parameters
    ----------
    values
        Keys of the setting ``camera {}``; None where automatic.
    bounds
        (2, 3) box about the bounded parts; may be empty, flat, a point or unbounded.
    aspect
        Width over height of the picture.
    tracer
        Who shows where in the box the things are; without one, the box as such is framed.

    Raises
    ------
    UsageError
        The eye is the target, or the angle of view is none.
    """
    fov, eye, target = float(values["fov"]), values["eye"], values["target"]
    if not 0 < fov < 179:
        raise UsageError(f"the camera's fov must lie between 0 and 179 degrees, not {fov:g}")
    box = tame(bounds)
    if eye is None:
        if target is None:
            eye, target = frame(box, corners(box), aspect, fov, values["up"])
            if tracer is not None:
                camera = Camera(_triple(eye), _triple(target), _triple(values["up"]), fov)
                points = probe(camera, box, aspect, tracer)
                if len(points):
                    eye, target = frame(box, points, aspect, fov, values["up"])
                    # Round numbers: the last bits of hits must not move the camera.
                    grain = 10.0 ** math.floor(math.log10(float((box[1] - box[0]).max())) - 4)
                    eye, target = np.round(eye / grain) * grain, np.round(target / grain) * grain
        else:
            eye = _stand_back(box, np.asarray(target, float), aspect, fov, values["up"])
    elif target is None:
        target = box.mean(axis=0)
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    if not np.isfinite([eye, target]).all() or not np.abs(target - eye).max() > 0:
        raise UsageError("the camera's eye and target are the same point")
    if not np.abs(np.asarray(values["up"], float)).max() > 0:
        raise UsageError("the camera's up is the zero vector")
    return Camera(
        _triple(eye),
        _triple(target),
        _triple(values["up"]),
        fov,
        float(values["aperture"]),
        values["focus"],
    )


def _triple(v: Any) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def tame(bounds: Floats) -> Floats:
    """Return a finite box with some extent in place of any bounds.

    Unbounded axes get the largest finite extent (10 if there is none), from the finite side.
    """
    low, high = (np.array(b, dtype=float) for b in bounds)
    if np.isnan([low, high]).any() or (low > high).any():
        return np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    finite = np.isfinite(low) & np.isfinite(high)
    extent = float((high - low)[finite].max(initial=0.0))
    reach = extent if extent > 0 else 10.0
    for k in np.flatnonzero(~finite):
        if np.isfinite(low[k]):
            high[k] = low[k] + reach
        elif np.isfinite(high[k]):
            low[k] = high[k] - reach
        else:
            low[k], high[k] = -reach / 2, reach / 2
    size = float((high - low).max())
    if not size > 1e-12 * float(np.abs([low, high]).max()):
        pad = max(1e-3 * float(np.abs([low, high]).max()), 1.0 if size == 0 else size)
        low, high = low - pad, high + pad
    return np.array([low, high])


def default_direction(box: Floats) -> Floats:
    """Return the unit vector from the box towards the automatic camera.

    Flat things are looked down upon, tall ones almost from their own height.
    """
    size = box[1] - box[0]
    slender = float(size[2] / max(size[:2].max(), 1e-300))
    s = min(max(slender / 1.7, 0.0), 1.0)
    elevation = math.radians(34.0 - 22.0 * s * s * (3.0 - 2.0 * s))
    azimuth = math.radians(AZIMUTH)
    flat = math.cos(elevation)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])


def corners(box: Floats) -> Floats:
    """Return the (8, 3) corners of a box."""
    return np.array(
        [[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )


PROBES = 96
"""Rays per side of the picture that look for the things in the box."""


def probe(camera: Camera, box: Floats, aspect: float, tracer: Tracer) -> Floats:
    """Return (N, 3) points of what a camera sees within a box.

    A box is a poor likeness of a tree: its lower corners are empty.
    """
    y, x = (v.ravel() + 0.5 for v in np.mgrid[0:PROBES, 0:PROBES])
    height = 1000.0
    size = (round(height * aspect), round(height))
    if size[0] < 1:
        return np.empty((0, 3))
    x, y = x * size[0] / PROBES, y * size[1] / PROBES
    origins, directions = camera.rays(x, y, size)
    hits = tracer.intersect(origins, directions, 0.0, np.inf)
    points = hits.position[np.isfinite(hits.t)]
    slack = 1e-6 * (box[1] - box[0]).max()
    inside = ((points >= box[0] - slack) & (points <= box[1] + slack)).all(axis=1)
    return np.asarray(points[inside])


def frame(box: Floats, points: Floats, aspect: float, fov: float, up: Any) -> tuple[Floats, Floats]:
    """Return eye and target of the nearest camera that sees points in a box, well placed.

    In the camera's axes a point (x, y, z) is inside the picture if |x - ex| <= tx (z - ez), so
    the foremost ez and the middle of what ex is left have a closed form; the same for y.
    """
    towards = default_direction(box)
    right, upward, forward = basis(towards, np.zeros(3), up)
    middle = box.mean(axis=0)
    local = (points - middle) @ np.stack([right, upward, forward]).T
    ty = math.tan(math.radians(fov) / 2) * (1 - 2 * MARGIN)
    ez = np.inf
    place_at = []
    for axis, tangent in ((0, ty * aspect), (1, ty)):
        above = float((local[:, axis] - tangent * local[:, 2]).max())
        below = float((-local[:, axis] - tangent * local[:, 2]).max())
        place_at.append((above - below) / 2)
        ez = min(ez, -(above + below) / (2 * tangent))
    size = float((box[1] - box[0]).max())
    ez = min(ez, float(local[:, 2].min()) - 1e-3 * size)
    eye = middle + place_at[0] * right + place_at[1] * upward + ez * forward
    depth = float(local[:, 2].mean()) - ez
    return eye, eye + depth * forward


def _stand_back(box: Floats, target: Floats, aspect: float, fov: float, up: Any) -> Floats:
    """Return the eye of a camera that looks at a given point and sees the whole box."""
    towards = default_direction(box)
    right, upward, _ = basis(towards, np.zeros(3), up)
    relative = corners(box) - target
    ty = math.tan(math.radians(fov) / 2) * (1 - 2 * MARGIN)
    nearer = relative @ towards
    needed = np.maximum(np.abs(relative @ right) / (ty * aspect), np.abs(relative @ upward) / ty)
    distance = max(float((nearer + needed).max()), 1e-3 * float((box[1] - box[0]).max()))
    return np.asarray(target + distance * towards)
