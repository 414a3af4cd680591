"""Where the camera and the ground are when the grammar does not say.

Boxes tell where things may be; rays tell where they are. World frame as in `camera`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pcsg.errors import UsageError
from pcsg.graph.evaluate import check_camera
from pcsg.graph.settings import ANGLES
from pcsg.render.camera import ROUND, Camera, basis
from pcsg.render.tracer import Floats, Tracer, WideTracer
from pcsg.trace.coverage import Footprint

MARGIN = 0.05
"""Part of the picture that stays free on each side of a framed box."""

AZIMUTH = -118.0
"""Where the automatic camera stands: degrees from +x towards +y. Three quarters from the front,
with the default sun at its right shoulder."""


Reach = Callable[[Floats], Floats]
"""Tells how far things certainly reach in directions (N, 3); -inf where it is not known."""


def place(
    values: Mapping[str, Any],
    bounds: Floats,
    aspect: float,
    tracer: Tracer | None = None,
    reach: Reach | None = None,
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
    reach
        Who knows of things that rays miss.

    Raises
    ------
    UsageError
        The eye is the target, or the angle of view is none.
    """
    fault = check_camera(values)
    if fault is not None:
        raise UsageError(f"{fault.message}; expected {fault.expected}")
    if values["fov"] is not None and not values["fov"] > 0:
        raise UsageError(f"the camera's fov must be above 0 degrees, not {values['fov']:g}")
    eye, target, height = values["eye"], values["target"], values["height"]
    if not np.abs(np.asarray(values["up"], float)).max() > 0:
        raise UsageError("the camera's up is the zero vector")
    box = tame(bounds)
    view = _View.of(values, aspect)
    if eye is None and target is None:
        eye, target, found = _automatic(view, box, tracer, reach)
        height = height or found
    elif eye is None:
        eye = _stand_back(view, box, np.asarray(target, float))
    elif target is None:
        target = box.mean(axis=0)
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    if not np.isfinite([eye, target]).all() or not np.abs(target - eye).max() > 0:
        raise UsageError("the camera's eye and target are the same point")
    return Camera(
        _triple(eye),
        _triple(target),
        _triple(values["up"]),
        view.fov,
        float(values["aperture"]),
        values["focus"],
        values["projection"],
        height,
    )


def _automatic(view: _View, box: Floats, tracer: Tracer | None, reach: Reach | None) -> _Framed:
    """Return the frame of what rays find in a box; of the box, where they find nothing."""
    framed = frame(view, box, corners(box))
    if tracer is None:
        return framed
    points = probe(view.camera(framed), box, view.aspect, tracer)
    if len(points) == 0:
        return framed
    camera = view.camera(frame(view, box, points))
    points = seek_outliers(camera, box, view.aspect, tracer, points)
    framed = frame(view, box, points)
    if reach is not None and _is_cut_off(view, box, framed, reach):
        framed = frame(view, box, points, reach)
    eye, target, height = framed
    # Round numbers: the last bits of hits must not move the camera.
    grain = 10.0 ** math.floor(math.log10(float((box[1] - box[0]).max())) - 4)
    eye, target = np.round(eye / grain) * grain, np.round(target / grain) * grain
    return _Framed(eye, target, height and round(height / grain) * grain)


class _Framed(NamedTuple):
    """Eye and target, and the height of the picture if it is orthographic."""

    eye: Floats
    target: Floats
    height: float | None


@dataclass(frozen=True)
class _View:
    """What is known of a camera before its place is.

    Attributes
    ----------
    aspect
        Width over height of the picture.
    fov
        As the camera's.
    flat
        Whether the picture is orthographic.
    tangent
        Half the height of a perspective picture that is framed likewise, at the distance 1.
    """

    aspect: float
    fov: float
    up: Any
    flat: bool
    tangent: float

    @classmethod
    def of(cls, values: Mapping[str, Any], aspect: float) -> _View:
        """Return the view of a setting."""
        projection, fov = values["projection"], values["fov"]
        flat = projection == "orthographic"
        fov = ANGLES[projection][0] if fov is None else float(fov)
        angle = fov if flat or projection == "perspective" else ROUND
        return cls(aspect, fov, values["up"], flat, math.tan(math.radians(angle) / 2))

    def camera(self, framed: _Framed) -> Camera:
        """Return a camera that shows what the view will show."""
        return Camera(
            _triple(framed.eye),
            _triple(framed.target),
            _triple(self.up),
            math.degrees(2.0 * math.atan(self.tangent)),
            projection="orthographic" if self.flat else "perspective",
            height=framed.height,
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
        found = _hits_within(box, tracer, origins, directions, *camera.widths(BAND[1]))
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
    half = 0.5 * camera.tall * np.array([aspect, 1.0])
    if camera.projection == "orthographic":
        return np.asarray(local[:, :2] / half)
    # What is beside or behind the eye is far outside.
    depth = np.maximum(local[:, 2:], 1e-3 * np.abs(local).max(axis=1, keepdims=True))
    return np.asarray(local[:, :2] / depth / half)


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


def find_lowest(bounds: Floats, tracer: Tracer, reach: Reach | None = None) -> float:
    """Return the height of the lowest point of the things in a box.

    The box may be larger than they are: what is cut off counts in it, and that of many states is
    an estimate.

    Parameters
    ----------
    reach
        Who knows of things that rays miss.
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
    known = -math.inf if reach is None else float(reach(np.array([[0.0, 0.0, -1.0]]))[0])
    if -known < found - CLOSE * extent:
        return -known
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


def frame(view: _View, box: Floats, points: Floats, reach: Reach | None = None) -> _Framed:
    """Return the nearest camera that sees points in a box, and all that is known, well placed.

    In the camera's axes a point (x, y, z) is inside the picture if |x - ex| <= tx (z - ez), so
    the foremost ez and the middle of what ex is left have a closed form; the same for y.
    """
    axes = _axes(view, box)
    middle = box.mean(axis=0)
    size = float((box[1] - box[0]).max())

    def farthest(planes: Floats) -> Floats:
        """Return how far all reaches in directions (N, 3) of the camera's axes."""
        found = ((points - middle) @ axes.T @ planes.T).max(axis=0)
        if reach is not None:
            found = np.maximum(found, _reach(reach, planes, axes, middle))
        return np.asarray(found)

    depth = float(((points - middle) @ axes[2]).mean())
    front = -float(farthest(np.array([[0.0, 0.0, -1.0]]))[0])
    tangent = 0.0 if view.flat else view.tangent
    planes = _planes(view, tangent * (1 - 2 * MARGIN))
    above, below = farthest(planes).reshape(2, 2)
    x, y = (above - below) / 2
    across = above + below
    if view.flat:
        wide, tall = across / (1 - 2 * MARGIN)
        height = max(float(tall), float(wide) / view.aspect, 1e-6 * size)
        # As far away as a perspective camera would be: what is near is not cut off.
        ez = front - height / (2 * view.tangent) - 1e-3 * size
    else:
        height = None
        tangents = planes[:2, 2]
        ez = min(float((across / (2 * tangents)).min()), front - 1e-3 * size)
    right, upward, forward = axes
    eye = middle + x * right + y * upward + ez * forward
    return _Framed(eye, eye + (depth - ez) * forward, height)


def _axes(view: _View, box: Floats) -> Floats:
    """Return the axes of the automatic camera as rows: right, up and forward."""
    return np.stack(basis(default_direction(box), np.zeros(3), view.up))


def _planes(view: _View, tangent: float) -> Floats:
    """Return the directions square to a picture's edges: right, top, left, bottom."""
    tx = tangent * view.aspect
    return np.array(
        [[1.0, 0.0, -tx], [0.0, 1.0, -tangent], [-1.0, 0.0, -tx], [0.0, -1.0, -tangent]]
    )


def _reach(reach: Reach, planes: Floats, axes: Floats, middle: Floats) -> Floats:
    """Return how far things reach from the middle in directions of the camera's axes."""
    directions = planes @ axes
    return np.asarray(reach(directions) - directions @ middle)


def _is_cut_off(view: _View, box: Floats, framed: _Framed, reach: Reach) -> bool:
    """Return whether things reach far into the margin of a picture, or beyond it."""
    axes = _axes(view, box)
    most = 1 - MARGIN
    planes = _planes(view, 0.0 if view.flat else view.tangent * most)
    edge = np.zeros(4)
    if framed.height is not None:
        half = framed.height / 2 * most
        edge = np.array([half * view.aspect, half, half * view.aspect, half])
    return bool((_reach(reach, planes, axes, framed.eye) > edge).any())


def _stand_back(view: _View, box: Floats, target: Floats) -> Floats:
    """Return the eye of a camera that looks at a given point and sees the whole box."""
    towards = default_direction(box)
    right, upward, _ = basis(towards, np.zeros(3), view.up)
    relative = corners(box) - target
    ty = view.tangent * (1 - 2 * MARGIN)
    nearer = relative @ towards
    needed = np.maximum(
        np.abs(relative @ right) / (ty * view.aspect), np.abs(relative @ upward) / ty
    )
    size = float((box[1] - box[0]).max())
    distance = max(float((nearer + needed).max()), 1e-3 * size)
    if view.flat:
        distance = max(float(needed.max()), float(nearer.max()) + 1e-3 * size)
    return np.asarray(target + distance * towards)
