"""Pictures in seconds: direct light, and the sky's where nothing near blocks it."""

from __future__ import annotations

import numpy as np

from pcsg.render.integrators import Light, Purpose, Samples, ask_emitters, find_blocked, hazed
from pcsg.render.materials import Surface, dots, largest
from pcsg.render.sampler import Sampler, cosine_hemisphere
from pcsg.render.sky import Sky
from pcsg.render.stage import Stage
from pcsg.render.tracer import Floats


class Preview:
    """Direct light with shadows, and light of the sky where nothing near blocks it.

    One shadow ray per light and one sky ray per camera ray. Sky rays end at a distance of half the
    scene: what they meet returns a part of its light instead of black, a cheap stand-in for what
    bounces between near surfaces. Mirrors and glass show the sky only.

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
        albedo = np.zeros_like(rgb)
        at = np.flatnonzero(np.isfinite(hits.t))
        rays = len(directions)
        if len(at) == 0:
            return Light(rgb, albedo, hits, rays)
        surface = stage.materials.gather(hits, at, directions[at], stage.tracer)
        albedo[at] = surface.matter.color
        here = samples.take(at)
        scale = np.maximum(largest(np.abs(surface.position)), hits.t[at])
        light = surface.emission.copy()
        for number, source in enumerate(stage.lights):
            pairs = self.sampler.pairs(*here, Purpose.LIGHT + number)
            sample = source.sample(surface.position, pairs)
            share = surface.reflect(sample.direction).light * sample.irradiance
            useful = np.flatnonzero(largest(share) > 0)
            blocked, more = find_blocked(
                stage.tracer, surface, useful, scale, sample.direction, sample.distance
            )
            rays += more
            lit = useful[~blocked]
            light[lit] += share[lit]
        if stage.emitters is not None:
            pairs = self.sampler.pairs(*here, Purpose.SHINING)
            shone = ask_emitters(stage, stage.emitters, surface, scale, pairs)
            light += shone.light
            rays += shone.rays
        sky, sky_rays = self._sky_light(surface, scale, here)
        light += sky
        rays += sky_rays
        rgb[at] = hazed(stage, light, hits, at, rgb)
        return Light(rgb, albedo, hits, rays)

    def _sky_light(self, surface: Surface, scale: Floats, samples: Samples) -> tuple[Floats, int]:
        """Return (N, 3) light of the sky, diffuse and mirrored, and how many rays it took."""
        sky, m = self.stage.sky, surface.matter
        open_share, rays = self._openness(surface, scale, samples)
        through = m.translucency[:, None]
        ambient = sky.ambient(m.normal)
        behind = np.flatnonzero(m.translucency > 0)
        if len(behind):
            there = sky.ambient(-m.normal[behind])
            ambient[behind] += through[behind] * (there - ambient[behind])
        seen = open_share + (1.0 - open_share) * self.bounce * m.color
        clear = (m.transmission * (1.0 - m.metallic))[:, None]
        diffuse = m.color * (1.0 - m.metallic)[:, None] * (1.0 - clear) * ambient
        if clear.any():
            diffuse += m.color * clear * sky.radiance(-m.viewer)
        shiny = np.flatnonzero((m.specular > 0) | (m.metallic > 0))
        if len(shiny):
            diffuse[shiny] += _mirror(sky, surface.take(shiny), ambient[shiny])
        return diffuse * seen, rays

    def _openness(self, surface: Surface, scale: Floats, samples: Samples) -> tuple[Floats, int]:
        """Return (N, 1) shares of sky rays that meet nothing near, and how many rays there were.

        The first sample of a pixel sends several rays: what it reports decides whether the pixel
        gets any further sample.
        """
        n = len(scale)
        limit = np.full(n, self.reach * self.stage.extent)
        first = bool((samples.number == 0).all())
        every, clear = np.arange(n), np.zeros(n)
        count = self.first_rays if first else 1
        rays = 0
        for k in range(count):
            number = np.full(n, k) if first else samples.number
            purpose = Purpose.FIRST_SKY if first else Purpose.SKY
            pairs = self.sampler.pairs(samples.x, samples.y, number, purpose)
            towards = cosine_hemisphere(pairs, surface.matter.facing)
            # The ground does not block: what comes from it is the lower half of the sky.
            blocked, more = find_blocked(self.stage.things, surface, every, scale, towards, limit)
            clear += ~blocked
            rays += more
        return (clear / count)[:, None], rays


def _mirror(sky: Sky, surface: Surface, ambient: Floats) -> Floats:
    """Return (N, 3) light of the sky that surfaces mirror, more or less blurred."""
    m = surface.matter
    cos = dots(m.normal, m.viewer)
    mirrored = 2.0 * cos[:, None] * m.normal - m.viewer
    blur = m.roughness[:, None]
    image = sky.radiance(mirrored) * (1.0 - blur) + ambient * blur
    # Rough surfaces shadow themselves at grazing angles.
    return np.asarray(surface.fresnel(cos) * (1.0 - 0.7 * blur) * image)
