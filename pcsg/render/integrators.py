"""From a batch of camera rays to the light they bring: what all ways of doing it have in common.

An integrator takes whole batches and asks the tracer in large calls; it holds no state between
batches, so batches can go to any thread in any order.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pcsg.render.materials import Surface, dots
from pcsg.render.stage import Stage
from pcsg.render.tracer import GROUND, Bools, Floats, Ints, Tracer
from pcsg.trace.hits import Hits


class Purpose:
    """What sample numbers are for. Lights take `LIGHT`, `LIGHT + 1`, ...

    Surfaces along a path take `BOUNCE + STRIDE * depth` and what follows it.
    """

    PIXEL, LENS, SKY, FIRST_SKY, LIGHT = 0, 1, 2, 3, 8
    BOUNCE, STRIDE = 256, 4
    DIRECTION, LOBE, CHOICE, SHINE = 0, 1, 2, 3


class Samples(NamedTuple):
    """Which samples a batch stands for: pixels (N,), (N,) and number (N,)."""

    x: Ints
    y: Ints
    number: Ints

    def take(self, rows: Ints) -> Samples:
        """Return some of them."""
        return Samples(self.x[rows], self.y[rows], self.number[rows])


class Light(NamedTuple):
    """What a batch of camera rays brought.

    Attributes
    ----------
    rgb
        (N, 3) linear radiance.
    albedo
        (N, 3) colour of what the camera rays met; 0 where nothing.
    hits
        What the camera rays met.
    rays
        How many rays were traced.
    """

    rgb: Floats
    albedo: Floats
    hits: Hits
    rays: int


class Integrator(Protocol):
    """A way to find the light along rays."""

    def radiance(self, origins: Floats, directions: Floats, samples: Samples) -> Light:
        """Return the light along (N, 3) rays with unit directions."""
        ...


OFFSET = 1e-8
"""Start of secondary rays off the surface, relative to position and distance."""

HAZE = 12.0
"""Distance, in extents of the scene, at which the ground plane has faded into the sky."""


class Start(NamedTuple):
    """Where rays that leave surfaces begin.

    Attributes
    ----------
    origins
        (N, 3)
    closed
        (N,) whether the ray ends at once.
    inside
        (N,) whether it begins inside of a solid.
    rays
        How many rays it took to find out.
    """

    origins: Floats
    closed: Bools
    inside: Bools
    rays: int


def leave(tracer: Tracer, surface: Surface, scale: Floats, towards: Floats) -> Start:
    """Return where rays begin that leave surfaces in unit directions (N, 3).

    They start off the surface, on the side they go to, by ten times the error of a position. A
    translucent leaf is one thin layer for light, also where it is modelled as a solid: a ray that
    goes through it begins where it comes out.

    Parameters
    ----------
    scale
        (N,) greatest coordinate or distance, to which errors are relative.
    """
    m = surface.matter
    inwards = dots(m.facing, towards) < 0
    step = OFFSET * scale
    origins = surface.position + (np.where(inwards, -step, step))[:, None] * m.facing
    closed = np.zeros(len(scale), dtype=bool)
    layered = inwards & (m.translucency > 0) & (m.transmission < 1) & ~m.sheet
    rows = np.flatnonzero(layered)
    if len(rows):
        through = find_exits(tracer, origins[rows], towards[rows], scale[rows])
        out = dots(through.normal, towards[rows])
        closed[rows] = ~(out > 0) | (through.material != surface.number[rows])
        away = step[rows, None] * through.normal
        origins[rows] = np.where(closed[rows, None], origins[rows], through.position + away)
    # From behind, as the viewer sees it, a closed surface is left when the viewer is inside.
    inside = np.where(m.leaving, ~inwards, inwards) & ~m.sheet
    inside[rows] = False
    return Start(origins, closed, inside, len(rows))


def find_exits(tracer: Tracer, origins: Floats, directions: Floats, scale: Floats) -> Hits:
    """Return the first crossings of rays that begin inside of solids.

    Whether there is a crossing up to a distance is a quick question, which it is not through which
    face. So the distance is found by asking, and the face by a ray that comes back from beyond it.

    Parameters
    ----------
    scale
        (N,) greatest coordinate or distance, to which errors are relative.
    """
    n = len(scale)
    near, far = np.zeros(n), 1e-6 * scale
    rows = np.arange(n)
    for _ in range(_GROWTHS):
        met = tracer.occluded(origins[rows], directions[rows], 0.0, far[rows])
        rows = rows[~met]
        if len(rows) == 0:
            break
        near[rows] = far[rows]
        far[rows] *= 4.0
    lost = rows
    for _ in range(_HALVINGS):
        middle = np.where(near > 0, np.sqrt(near * far), 0.25 * far)
        met = tracer.occluded(origins, directions, 0.0, middle)
        near, far = np.where(met, near, middle), np.where(met, middle, far)
    beyond = origins + far[:, None] * directions
    back = tracer.intersect(beyond, -directions, 0.0, far - near)
    t = np.where(np.isfinite(back.t), far - back.t, np.inf)
    t[lost] = np.inf
    # What was not seen from beyond, because something else is there, takes its time.
    unseen = np.setdiff1d(np.flatnonzero(~np.isfinite(t)), lost)
    found = back.replaced(t=t)
    if len(unseen):
        slow = tracer.intersect(origins[unseen], directions[unseen], 0.0, np.inf)
        for name, values in found.columns().items():
            values[unseen] = getattr(slow, name)
    return found


_GROWTHS, _HALVINGS = 24, 5
"""Steps that find the distance of a crossing: 1e-6 to 1e8 of the scale, then to one in twenty."""


def find_blocked(
    tracer: Tracer, surface: Surface, scale: Floats, towards: Floats, distance: Floats
) -> tuple[Bools, int]:
    """Return whether anything lies between surfaces and lights, and how many rays it took."""
    if len(scale) == 0:
        return np.zeros(0, dtype=bool), 0
    start = leave(tracer, surface, scale, towards)
    finite = np.where(np.isfinite(distance), distance, 0.0)[:, None]
    target = surface.position + finite * towards
    left = np.einsum("ij,ij->i", target - start.origins, towards)
    t_max = np.where(np.isfinite(distance), np.maximum(left - 2.0 * OFFSET * scale, 0.0), np.inf)
    return start.closed | tracer.occluded(start.origins, towards, 0.0, t_max), len(
        scale
    ) + start.rays


def hazed(stage: Stage, light: Floats, hits: Hits, at: Ints, behind: Floats) -> Floats:
    """Let the ground plane fade into the horizon, where it would end in a hard line."""
    if not stage.ground:
        return light
    far = hits.t[at] / (HAZE * stage.extent)
    clear = np.where(hits.leaf[at] == GROUND, np.exp(-far * far), 1.0)[:, None]
    return np.asarray(behind + clear * (light - behind))
