"""Where the camera and the ground are when the grammar does not say.

Boxes tell where things may be; rays tell where they are. World frame as in `camera`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.render.camera import Camera, basis
from pcsg.render.tracer import Floats, Tracer, WideTracer
from pcsg.trace.coverage import Footprint

MARGIN = 0.05
"""Part of the picture that stays free on each side of a framed box."""

AZIMUTH = -118.0
"""Where the automatic camera stands: degrees from +x towards +y. Three quarters from the front,
with the default sun at its right shoulder."""


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
                    camera = Camera(_triple(eye), _triple(target), _triple(values["up"]), fov)
                    points = seek_outliers(camera, box, aspect, tracer, points)
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
    return _hits_within(box, tracer, origins, directions)


BAND = 24, 768
"""Rays across and along a strip beside what was found, in which thin parts are looked for."""

ROUNDS = 3
"""How often strips are looked through: each lies beside what the one before has found."""


def seek_outliers(
    camera: Camera, box: Floats, aspect: float, tracer: Tracer, points: Floats
) -> Floats:
    """Return points (N, 3) that a camera sees, and those of thin parts that stand out from them.

    The rays of `probe` pass between twigs. What they have missed may lie only where the box
    reaches farther than the points do; there the rays are close.
    """
    edges = np.clip(_project(camera, corners(box), aspect), -4.0, 4.0)
    outer = edges.min(axis=0), edges.max(axis=0)
    across, along = _band()
    for _ in range(ROUNDS):
        places = _project(camera, points, aspect)
        inner = places.min(axis=0), places.max(axis=0)
        strips = []
        for axis in (0, 1):
            other = outer[0][1 - axis] + along * (outer[1] - outer[0])[1 - axis]
            for a, b in ((outer[0], inner[0]), (inner[1], outer[1])):
                # What is closer fits into the margin.
                if b[axis] - a[axis] > MARGIN:
                    there = a[axis] + across * (b[axis] - a[axis])
                    strips.append(np.stack([there, other][:: 1 if axis == 0 else -1], axis=1))
        if not strips:
            break
        x, y = np.concatenate(strips).T
        origins, directions = camera.rays((x + 1.0) / 2.0 * aspect, (1.0 - y) / 2.0, (aspect, 1.0))
        fine = 2.0 * math.tan(math.radians(camera.fov) / 2) / BAND[1]
        found = _hits_within(box, tracer, origins, directions, spread=fine)
        if not len(found):
            break
        points = np.concatenate([points, found])
    return points


def _band() -> tuple[Floats, Floats]:
    """Return places across and along a strip, in [0, 1], each row shifted against the others."""
    row, number = (v.ravel() for v in np.mgrid[0 : BAND[0], 0 : BAND[1]])
    return (row + 0.5) / BAND[0], (number + (0.618034 * row) % 1.0) / BAND[1]


def _project(camera: Camera, points: Floats, aspect: float) -> Floats:
    """Return where points (N, 3) are in the picture, (N, 2): its edges are at -1 and 1."""
    right, upward, forward = basis(camera.eye, camera.target, camera.up)
    local = (points - np.array(camera.eye)) @ np.stack([right, upward, forward]).T
    tangent = math.tan(math.radians(camera.fov) / 2)
    # What is beside or behind the eye is far outside.
    depth = np.maximum(local[:, 2:], 1e-3 * np.abs(local).max(axis=1, keepdims=True))
    return np.asarray(local[:, :2] / depth / (tangent * np.array([aspect, 1.0])))


def _hits_within(
    box: Floats,
    tracer: Tracer,
    origins: Floats,
    directions: Floats,
    width: float = 0.0,
    spread: float = 0.0,
) -> Floats:
    """Return the (N, 3) points where rays meet something that lies in a box.

    Parameters
    ----------
    width, spread
        Of the rays at their origins, and what they gain per distance: what is smaller is not looked
        into, which would take long where rays graze a terrain.
    """
    if isinstance(tracer, WideTracer) and (width > 0.0 or spread > 0.0):
        n = len(origins)
        footprint = Footprint(np.full(n, width), np.full(n, spread))
        hits = tracer.intersect(origins, directions, 0.0, np.inf, footprint)
    else:
        hits = tracer.intersect(origins, directions, 0.0, np.inf)
    points = hits.position[np.isfinite(hits.t)]
    slack = 1e-6 * (box[1] - box[0]).max()
    inside = ((points >= box[0] - slack) & (points <= box[1] + slack)).all(axis=1)
    return np.asarray(points[inside])


CLOSE = 0.005
"""Part of the greatest side: a box that reaches only so far below what was found is right."""


def find_lowest(bounds: Floats, tracer: Tracer) -> float:
    """Return the height of the lowest point of the things in a box.

    The box may be larger than they are: what is cut off counts in it, and that of many states is
    an estimate.
    """
    box = tame(bounds)
    low, extent = float(box[0, 2]), float((box[1] - box[0]).max())
    fine = extent / BAND[1]
    found = _hits_within(box, tracer, *_upwards(box), width=fine)[:, 2].min(initial=box[1, 2])
    for _ in range(ROUNDS):
        if found - low <= CLOSE * extent:
            return low
        heights = _hits_within(box, tracer, *_below(box, found), width=fine)[:, 2]
        if not len(heights):
            break
        found = min(found, heights.min())
    return float(found) if found < box[1, 2] else low


def _upwards(box: Floats) -> tuple[Floats, Floats]:
    """Return rays from below through all of a box."""
    at = (np.arange(PROBES) + 0.5) / PROBES
    u, v = (w.ravel() for w in np.meshgrid(at, at))
    origins = box[0] + np.stack([u, v, np.full(len(u), -1e-3)], axis=1) * (box[1] - box[0])
    return origins, np.tile([0.0, 0.0, 1.0], (len(u), 1))


def _below(box: Floats, height: float) -> tuple[Floats, Floats]:
    """Return level rays through a box below a height, along x and along y."""
    across, along = _band()
    origins = np.tile(box[0], (2, len(along), 1))
    origins[:, :, 2] += across * (height - box[0, 2])
    for axis in (0, 1):
        origins[axis, :, axis] -= 1e-3 * (box[1] - box[0])[axis]
        origins[axis, :, 1 - axis] += along * (box[1] - box[0])[1 - axis]
    return origins.reshape(-1, 3), np.repeat(np.eye(3)[:2], len(along), axis=0)


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
