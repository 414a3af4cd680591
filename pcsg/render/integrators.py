"""From a batch of camera rays to the light they bring: what all ways of doing it have in common.

An integrator takes whole batches and asks the tracer in large calls; it holds no state between
batches, so batches can go to any thread in any order.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pcsg.render.emitters import Emitters
from pcsg.render.leaving import OFFSET, begin_rays, limit_rays
from pcsg.render.materials import Surface, dots, largest
from pcsg.render.stage import Stage
from pcsg.render.tracer import GROUND, Bools, Floats, Ints, Tracer
from pcsg.trace.hits import Hits


class Purpose:
    """What sample numbers are for. Lights take `LIGHT`, `LIGHT + 1`, ...

    Surfaces along a path take `BOUNCE + STRIDE * depth` and what follows it.
    """

    PIXEL, LENS, SKY, FIRST_SKY, SHINING, LIGHT = 0, 1, 2, 3, 4, 8
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


class Start(NamedTuple):
    """Rays that leave surfaces.

    Attributes
    ----------
    origins, directions
        (M, 3) where they begin and go.
    closed
        (M,) whether the ray ends at once.
    rays
        How many rays it took to find out.
    """

    origins: Floats
    directions: Floats
    closed: Bools
    rays: int


def leave(tracer: Tracer, surface: Surface, rows: Ints, scale: Floats, towards: Floats) -> Start:
    """Return the rays that leave some of N surfaces in unit directions (N, 3).

    They start off the surface, on the side they go to, by ten times the error of a position. A
    translucent leaf is one thin layer for light, also where it is modelled as a solid: a ray that
    goes through it begins where it comes out.

    Parameters
    ----------
    rows
        (M,) which of the surfaces.
    scale
        (N,) greatest coordinate or distance, to which errors are relative.
    """
    m = surface.matter
    n = len(rows)
    origins, directions = np.empty((2, n, 3))
    layered, closed = np.empty(n, dtype=bool), np.zeros(n, dtype=bool)
    begin_rays(
        rows,
        surface.position,
        m.facing,
        m.translucency,
        m.transmission,
        m.sheet,
        scale,
        towards,
        origins,
        directions,
        layered,
    )
    within = np.flatnonzero(layered)
    if len(within):
        through = tracer.intersect(origins[within], directions[within], 0.0, np.inf)
        out = dots(through.normal, directions[within])
        closed[within] = ~(out > 0) | (through.material != surface.number[rows[within]])
        away = OFFSET * scale[rows[within], None] * through.normal
        origins[within] = np.where(closed[within, None], origins[within], through.position + away)
    return Start(origins, directions, closed, len(within))


def find_blocked(
    tracer: Tracer,
    surface: Surface,
    rows: Ints,
    scale: Floats,
    towards: Floats,
    distance: Floats,
) -> tuple[Bools, int]:
    """Return whether anything lies between surfaces and lights, and how many rays it took.

    Arguments as for `leave`, and (N,) how far the lights are; the answers are those of the rows.
    """
    if len(rows) == 0:
        return np.zeros(0, dtype=bool), 0
    start = leave(tracer, surface, rows, scale, towards)
    t_max = np.empty(len(rows))
    limit_rays(rows, surface.position, start.origins, start.directions, distance, scale, t_max)
    blocked = start.closed | tracer.occluded(start.origins, start.directions, 0.0, t_max)
    return blocked, len(rows) + start.rays


class Shone(NamedTuple):
    """What N surfaces get from things of the scene that shine.

    Attributes
    ----------
    light
        (N, 3) towards the viewer.
    density
        (N,) with which the shadow rays' directions were chosen.
    scattered
        (N,) with which the surfaces scatter there.
    rays
        How many rays it took.
    """

    light: Floats
    density: Floats
    scattered: Floats
    rays: int


def ask_emitters(
    stage: Stage, emitters: Emitters, surface: Surface, scale: Floats, pairs: Floats
) -> Shone:
    """Send a shadow ray to what shines from every surface, by numbers (N, 2)."""
    light = np.zeros((len(scale), 3))
    aim = emitters.aim(surface.position, pairs)
    reflected = surface.reflect(aim.direction)
    useful = np.flatnonzero((largest(reflected.light) > 0) & (aim.density > 0))
    start = leave(stage.tracer, surface, useful, scale, aim.direction)
    met = stage.tracer.intersect(start.origins, start.directions, 0.0, np.inf)
    seen = np.isfinite(met.t) & ~start.closed
    emission = np.where(seen[:, None], stage.materials.emission(met.material), 0.0)
    light[useful] = reflected.light[useful] * emission / aim.density[useful, None]
    return Shone(light, aim.density, reflected.density, start.rays + len(useful))


def hazed(stage: Stage, light: Floats, hits: Hits, at: Ints, backdrop: Floats) -> Floats:
    """Let the ground plane fade into the horizon, where it would end in a hard line.

    Parameters
    ----------
    light
        (M, 3) of what rays `at` met.
    backdrop
        (N, 3) what all rays would see behind everything.
    """
    if not stage.ground:
        return light
    behind = backdrop[at]
    far = hits.t[at] / stage.haze
    clear = np.where(hits.leaf[at] == GROUND, np.exp(-far * far), 1.0)[:, None]
    return np.asarray(behind + clear * (light - behind))
