"""From a batch of camera rays to the light they bring: one class per way of doing it.

An integrator takes whole batches and asks the tracer in large calls; it holds no state between
batches, so batches can go to any thread in any order.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pcsg.render.materials import Surface
from pcsg.render.sampler import Sampler, cosine_hemisphere
from pcsg.render.stage import Stage
from pcsg.render.tracer import GROUND, Bools, Floats, Ints, Tracer
from pcsg.trace.hits import Hits


class Purpose:
    """What sample numbers are for. Lights take `LIGHT`, `LIGHT + 1`, ..."""

    PIXEL, LENS, SKY, FIRST_SKY, LIGHT = 0, 1, 2, 3, 8


class Samples(NamedTuple):
    """Which samples a batch stands for: pixels (N,), (N,) and number (N,)."""

    x: Ints
    y: Ints
    number: Ints


class Light(NamedTuple):
    """What a batch of camera rays brought.

    Attributes
    ----------
    rgb
        (N, 3) linear radiance.
    hits
        What the camera rays met.
    rays
        How many rays were traced.
    """

    rgb: Floats
    hits: Hits
    rays: int


class Integrator(Protocol):
    """A way to find the light along rays."""

    def radiance(self, origins: Floats, directions: Floats, samples: Samples) -> Light:
        """Return the light along (N, 3) rays with unit directions."""
        ...


class Preview:
    """Direct light with shadows, and light of the sky where nothing near blocks it.

    One shadow ray per light and one sky ray per camera ray. Sky rays end at a distance of half the
    scene: what they meet returns a part of its light instead of black, a cheap stand-in for what
    bounces between near surfaces.

    Parameters
    ----------
    stage
        The scene with camera and light.
    sampler
        Where the random numbers come from.
    """

    reach = 0.5
    bounce = 0.35
    first_rays = 4

    def __init__(self, stage: Stage, sampler: Sampler) -> None:
        self.stage = stage
        self.sampler = sampler

    def radiance(self, origins: Floats, directions: Floats, samples: Samples) -> Light:
        """See `Integrator`."""
        stage = self.stage
        hits = stage.tracer.intersect(origins, directions, 0.0, np.inf)
        rgb = stage.sky.backdrop(directions)
        at = np.flatnonzero(np.isfinite(hits.t))
        rays = len(directions)
        if len(at) == 0:
            return Light(rgb, hits, rays)
        surface = stage.materials.gather(hits, at, directions)
        here = Samples(samples.x[at], samples.y[at], samples.number[at])
        scale = np.maximum(np.abs(surface.position).max(axis=1), hits.t[at])
        light = surface.emission.copy()
        for number, source in enumerate(stage.lights):
            pairs = self.sampler.pairs(*here, Purpose.LIGHT + number)
            towards, distance, irradiance = source.sample(surface.position, pairs)
            share = surface.reflect(towards)
            useful = np.flatnonzero((share * irradiance).max(axis=1) > 0)
            blocked = self._blocked(stage.tracer, surface, scale, towards, distance, useful)
            rays += len(useful)
            lit = useful[~blocked]
            light[lit] += share[lit] * irradiance[lit]
        sky, sky_rays = self._sky_light(surface, scale, here)
        light += sky
        rays += sky_rays
        rgb[at] = self._hazed(light, hits, at, rgb[at])
        return Light(rgb, hits, rays)

    def _sky_light(self, surface: Surface, scale: Floats, samples: Samples) -> tuple[Floats, int]:
        """Return (N, 3) light of the sky, diffuse and mirrored, and how many rays it took."""
        sky = self.stage.sky
        open_share, rays = self._openness(surface, scale, samples)
        through = surface.translucency[:, None]
        ambient = sky.ambient(surface.normal) * (1.0 - through)
        ambient += sky.ambient(-surface.normal) * through
        seen = open_share + (1.0 - open_share) * self.bounce * surface.color
        diffuse = surface.color * (1.0 - surface.metallic)[:, None] * ambient
        cos = np.einsum("ij,ij->i", surface.normal, surface.viewer)
        mirrored = 2.0 * cos[:, None] * surface.normal - surface.viewer
        blur = surface.roughness[:, None]
        image = sky.radiance(mirrored) * (1.0 - blur) + ambient * blur
        # Rough surfaces shadow themselves at grazing angles.
        gloss = surface.fresnel(cos) * (1.0 - 0.7 * blur)
        return (diffuse + gloss * image) * seen, rays

    def _openness(self, surface: Surface, scale: Floats, samples: Samples) -> tuple[Floats, int]:
        """Return (N, 1) shares of sky rays that meet nothing near, and how many rays there were.

        The first sample of a pixel sends several rays: what it reports decides whether the pixel
        gets any further sample.
        """
        n = len(scale)
        limit = np.full(n, self.reach * self.stage.extent)
        everywhere = np.arange(n)
        first = bool((samples.number == 0).all())
        clear = np.zeros(n)
        count = self.first_rays if first else 1
        for k in range(count):
            number = np.full(n, k) if first else samples.number
            purpose = Purpose.FIRST_SKY if first else Purpose.SKY
            pairs = self.sampler.pairs(samples.x, samples.y, number, purpose)
            towards = cosine_hemisphere(pairs, surface.facing)
            # The ground does not block: what comes from it is the lower half of the sky.
            clear += ~self._blocked(self.stage.things, surface, scale, towards, limit, everywhere)
        return (clear / count)[:, None], n * count

    def _blocked(
        self,
        tracer: Tracer,
        surface: Surface,
        scale: Floats,
        towards: Floats,
        distance: Floats,
        at: Ints,
    ) -> Bools:
        """Return whether anything lies between points and lights.

        Rays start off the surface, on the side they go to, by ten times the error of a position.
        """
        if len(at) == 0:
            return np.zeros(0, dtype=bool)
        facing, towards = surface.facing[at], towards[at]
        side = np.where(np.einsum("ij,ij->i", facing, towards) < 0, -1.0, 1.0)
        step = OFFSET * scale[at]
        origins = surface.position[at] + (side * step)[:, None] * facing
        t_max = np.maximum(distance[at] - 2.0 * step, 0.0)
        return tracer.occluded(origins, towards, 0.0, t_max)

    def _hazed(self, light: Floats, hits: Hits, at: Ints, behind: Floats) -> Floats:
        """Let the ground plane fade into the horizon, where it would end in a hard line."""
        if not self.stage.ground:
            return light
        far = hits.t[at] / (HAZE * self.stage.extent)
        clear = np.where(hits.leaf[at] == GROUND, np.exp(-far * far), 1.0)[:, None]
        return np.asarray(behind + clear * (light - behind))


OFFSET = 1e-8
"""Start of secondary rays off the surface, relative to position and distance."""

HAZE = 12.0
"""Distance, in extents of the scene, at which the ground plane has faded into the sky."""
