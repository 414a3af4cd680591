"""Light followed over surfaces: path tracing, and the direct light and mirrors of ray tracing.

At every surface lights are asked for by shadow rays, and found by rays that scatter; the two are
weighted by the power heuristic (Veach and Guibas 1995), so that neither small lights nor sharp
gloss are noisy. Long paths end by Russian roulette, which leaves the mean as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pcsg.render.integrators import (
    Light,
    Purpose,
    Samples,
    ask_emitters,
    find_blocked,
    hazed,
    leave,
)
from pcsg.render.materials import Scattered, Surface, largest
from pcsg.render.sampler import Sampler
from pcsg.render.stage import Stage
from pcsg.render.tracer import Bools, Floats, Ints

ROULETTE = 3
"""Surfaces after which paths end by chance."""

MATT = 1.0
"""Density of a scattered direction, per steradian, below which what it meets is not a mirror
image: in mode direct a ray ends there."""

MANY = 6
"""Most lights that are all asked at the first surface."""

BLUR = 0.6
"""Least roughness of gloss that is seen by way of matt surfaces; by way of gloss, it is at least as
rough as that. Light that a mirror or a lens gathers is blurred by it, instead of appearing as
single white points (Kaplanyan and Dachsbacher 2013)."""


class _Paths(NamedTuple):
    """Paths on their way.

    Attributes
    ----------
    row
        (N,) of the camera ray that a path belongs to.
    origins, directions
        (N, 3) of its last piece.
    share
        (N, 3) of the light along it that reaches the camera.
    density
        (N,) with which its direction was drawn.
    chances
        (L, N) with which each light was asked where it comes from; the last are what shines.
    matt
        (N,) whether it met a matt surface.
    least
        (N,) least roughness of what is seen along it.
    """

    row: Ints
    origins: Floats
    directions: Floats
    share: Floats
    density: Floats
    chances: Floats
    matt: Bools
    least: Floats

    def take(self, rows: Ints) -> _Paths:
        """Return some of the paths."""
        return _Paths(
            self.row[rows],
            self.origins[rows],
            self.directions[rows],
            self.share[rows],
            self.density[rows],
            self.chances[:, rows],
            self.matt[rows],
            self.least[rows],
        )


class Path:
    """Path tracing.

    Parameters
    ----------
    stage
        The scene with camera and light.
    sampler
        Where the random numbers come from.
    """

    follows_matt = True

    def __init__(self, stage: Stage, sampler: Sampler) -> None:
        self.stage = stage
        self.sampler = sampler

    @property
    def _count(self) -> int:
        """How many things can be asked for light."""
        return len(self.stage.sources) + (self.stage.emitters is not None)

    def radiance(self, origins: Floats, directions: Floats, samples: Samples) -> Light:
        """See `Integrator`."""
        stage = self.stage
        n, lights = len(origins), self._count
        first = stage.tracer.intersect(origins, directions, 0.0, np.inf)
        rgb = stage.sky.backdrop(directions)
        if stage.sun_is_seen and stage.lights:
            rgb += stage.lights[0].seen(origins, directions).radiance
        albedo = np.zeros((n, 3))
        rays = n
        at = seen = np.flatnonzero(np.isfinite(first.t))
        count = len(seen)
        found = np.zeros((count, 3))
        paths = _Paths(
            np.arange(count),
            origins[seen],
            directions[seen],
            np.ones((count, 3)),
            np.full(count, np.inf),
            np.ones((lights, count)),
            np.zeros(count, dtype=bool),
            np.zeros(count),
        )
        hits, seen_samples = first, samples.take(seen)
        for depth in range(stage.bounces):
            if len(at) == 0:
                break
            surface = stage.materials.gather(hits, at, paths.directions, stage.tracer)
            if depth == 0:
                albedo[seen] = surface.matter.color
            if stage.materials.shine:
                found[paths.row] += paths.share * self._met_shine(paths, surface.emission)
            if not self.follows_matt and depth > 0:
                going = np.flatnonzero(~paths.matt)
                paths, surface, at = paths.take(going), surface.take(going), at[going]
            surface = surface.roughened(paths.least)
            scale = np.maximum(largest(np.abs(surface.position)), hits.t[at])
            here = seen_samples.take(paths.row) if depth > 0 else seen_samples
            chances = self._chances(surface.position, depth)
            light, more = self._ask_lights(surface, scale, here, chances, depth)
            found[paths.row] += paths.share * light
            paths, more_rays = self._scatter(paths, surface, scale, here, chances, depth)
            rays += more + more_rays + len(paths.row)
            if len(paths.row) == 0:
                break
            hits = stage.tracer.intersect(paths.origins, paths.directions, 0.0, np.inf)
            found[paths.row] += paths.share * self._met_lights(paths, hits.t)
            at = np.flatnonzero(np.isfinite(hits.t))
            paths = paths.take(at)
        rgb[seen] = hazed(stage, found, first, seen, rgb)
        return Light(rgb, albedo, first, rays)

    def _chances(self, position: Floats, depth: int) -> Floats:
        """Return (L, N) chances that each light is asked: all of them first, then one."""
        emitters = self.stage.emitters
        if self._asks_all(depth):
            return np.ones((self._count, len(position)))
        sources = [*self.stage.sources, *((emitters,) if emitters else ())]
        bright = np.stack([source.estimate(position) for source in sources]) + 1e-300
        # Where most light seems to come from may lie in shadow: no light is neglected.
        even = 0.15 / len(sources)
        return np.asarray(even + 0.85 * bright / bright.sum(axis=0))

    def _asks_all(self, depth: int) -> bool:
        """Return whether every light is asked, or one by chance."""
        count = self._count
        return count < 2 or (depth == 0 and count <= MANY)

    def _ask_lights(
        self, surface: Surface, scale: Floats, samples: Samples, chances: Floats, depth: int
    ) -> tuple[Floats, int]:
        """Return (N, 3) light that comes directly from lights, and how many rays it took."""
        n, stage = len(scale), self.stage
        total, rays = np.zeros((n, 3)), 0
        every = self._asks_all(depth)
        purpose = Purpose.BOUNCE + Purpose.STRIDE * depth
        if not every:
            pick = self.sampler.pairs(*samples, purpose + Purpose.CHOICE)[:, 0]
            chosen = (pick >= np.cumsum(chances, axis=0)).sum(axis=0)
            shine = self.sampler.pairs(*samples, purpose + Purpose.SHINE)
        for number, source in enumerate(stage.sources):
            rows = np.arange(n) if every else np.flatnonzero(chosen == number)
            if len(rows) == 0:
                continue
            if every:
                pairs = self.sampler.pairs(*samples, Purpose.LIGHT + number)
            else:
                pairs = shine[rows]
            some = surface if every else surface.take(rows)
            chance = chances[number, rows]
            sample = source.sample(some.position, pairs)
            reflected = some.reflect(sample.direction)
            asked = chance * sample.density
            weight = _weight(asked, reflected.density)
            light = reflected.light * sample.irradiance * (weight / chance)[:, None]
            useful = np.flatnonzero(largest(light) > 0)
            blocked, more = find_blocked(
                stage.tracer, some, useful, scale[rows], sample.direction, sample.distance
            )
            lit = useful[~blocked]
            total[rows[lit]] += light[lit]
            rays += more
        emitters = stage.emitters
        if emitters is not None:
            rows = np.arange(n) if every else np.flatnonzero(chosen == len(stage.sources))
            pairs = shine[rows] if not every else self.sampler.pairs(*samples, Purpose.SHINING)
            some = surface if every else surface.take(rows)
            shone = ask_emitters(stage, emitters, some, scale[rows], pairs)
            asked = chances[-1, rows] * shone.density
            weight = _weight(asked, shone.scattered)
            total[rows] += shone.light * (weight / chances[-1, rows])[:, None]
            rays += shone.rays
        return total, rays

    def _scatter(
        self,
        paths: _Paths,
        surface: Surface,
        scale: Floats,
        samples: Samples,
        chances: Floats,
        depth: int,
    ) -> tuple[_Paths, int]:
        """Return the paths that go on, and how many rays it took to find where they begin."""
        purpose = Purpose.BOUNCE + Purpose.STRIDE * depth
        found: Scattered = surface.scatter(
            self.sampler.pairs(*samples, purpose + Purpose.DIRECTION),
            self.sampler.pairs(*samples, purpose + Purpose.LOBE),
        )
        on = self._may_bring(found, np.flatnonzero(found.density > 0), paths.matt)
        share = paths.share[on] * found.light[on] / found.density[on, None]
        if depth >= ROULETTE:
            luck = self.sampler.pairs(*samples.take(on), purpose + Purpose.CHOICE)[:, 1]
            stay = np.clip(largest(share), 0.05, 0.95)
            lucky = np.flatnonzero(luck < stay)
            on, share = on[lucky], share[lucky] / stay[lucky, None]
        bright = np.flatnonzero(largest(share) > 0)
        on, share = on[bright], share[bright]
        start = leave(self.stage.tracer, surface, on, scale, found.direction)
        free = np.flatnonzero(~start.closed)
        on = on[free]
        density = found.density[on]
        # A facet of roughness r, seen straight, mirrors with the density 1 / (4 pi r^4).
        spread = np.minimum((4.0 * np.pi * density) ** -0.25, BLUR)
        onward = _Paths(
            paths.row[on],
            start.origins[free],
            start.directions[free],
            share[free],
            density,
            chances[:, on],
            paths.matt[on] | (density < MATT),
            np.maximum(paths.least[on], spread),
        )
        return onward, start.rays

    def _may_bring(self, found: Scattered, on: Ints, matt: Bools) -> Ints:
        """Return which scattered directions may bring light, as far as they themselves tell it."""
        stage = self.stage
        if self.follows_matt or stage.materials.shine:
            return on
        if not all(source.is_far for source in stage.sources):
            return on
        # A ray from a matt surface ends at the next one; it finds only what shines beyond all.
        may = ~(matt[on] | (found.density[on] < MATT))
        directions = found.direction[on]
        for source in stage.sources:
            may |= ~np.isnan(source.seen(directions, directions).distance)
        return on[may]

    def _met_lights(self, paths: _Paths, t: Floats) -> Floats:
        """Return (N, 3) light of lights that scattered rays met."""
        total = np.zeros((len(t), 3))
        for number, source in enumerate(self.stage.sources):
            seen = source.seen(paths.origins, paths.directions)
            met = np.flatnonzero(~(t < seen.distance) & ~np.isnan(seen.distance) & (t >= 0))
            if len(met) == 0:
                continue
            asked = paths.chances[number, met] * seen.density[met]
            total[met] += _weight(paths.density[met], asked)[:, None] * seen.radiance[met]
        return total

    def _met_shine(self, paths: _Paths, emission: Floats) -> Floats:
        """Return (N, 3) light of shining things that rays met; all of it, if the camera's did."""
        emitters = self.stage.emitters
        if emitters is None:
            return emission
        total = np.zeros_like(emission)
        met = np.flatnonzero(largest(emission) > 0)
        asked = paths.chances[-1, met] * emitters.density(paths.origins[met], paths.directions[met])
        total[met] = _weight(paths.density[met], asked)[:, None] * emission[met]
        return total


def _weight(density: Floats, other: Floats) -> Floats:
    """Return (N,) weights of directions drawn with one density that another way finds too.

    The power heuristic; a way without a density, infinite, is the only one.
    """
    with np.errstate(invalid="ignore"):
        ratio = np.where(np.isinf(density), 0.0, other / density)
    return np.asarray(1.0 / (1.0 + ratio * ratio))


class Direct(Path):
    """The light of lights alone, with shadows, and what mirrors and glass show of it."""

    follows_matt = False
