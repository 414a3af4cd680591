"""Light from single sources: the sun and balls that shine.

Radiance is linear; a surface of albedo a that faces an irradiance E sends out a E / pi.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from pcsg.errors import UsageError
from pcsg.render.sampler import around, disc_cone
from pcsg.render.tracer import Floats


class LightSample(NamedTuple):
    """Where light comes from, for N points.

    Attributes
    ----------
    direction
        (N, 3) unit vectors towards the light.
    distance
        (N,) how far it is; inf for the sun and the sky.
    irradiance
        (N, 3) on a surface that faces it, if nothing is in the way: radiance over density.
    density
        (N,) of the direction per solid angle; inf where no other direction is possible.
    """

    direction: Floats
    distance: Floats
    irradiance: Floats
    density: Floats


class Seen(NamedTuple):
    """What N rays that meet a light bring.

    Attributes
    ----------
    distance
        (N,) how far it is; inf for sun and sky, nan where the ray misses it.
    radiance
        (N, 3); 0 where missed.
    density
        (N,) with which `Light.sample` draws the ray's direction.
    """

    distance: Floats
    radiance: Floats
    density: Floats


class Light(Protocol):
    """A source that a shadow ray can reach.

    Attributes
    ----------
    is_far
        Whether what rays see of it does not depend on where they begin.
    """

    @property
    def is_far(self) -> bool:
        """See above."""
        ...

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """Choose a point of the light for each of (N, 3) positions by (N, 2) numbers."""
        ...

    def seen(self, origins: Floats, directions: Floats) -> Seen:
        """Return what rays see of the light, if nothing is in the way."""
        ...

    def estimate(self, position: Floats) -> Floats:
        """Return (N,) about how bright it is at positions (N, 3)."""
        ...


@dataclass(frozen=True)
class Sun:
    """A disc at infinity.

    Attributes
    ----------
    direction
        Unit vector towards it.
    irradiance
        On a surface that faces it.
    angle
        Full diameter in degrees.
    """

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float]
    angle: float

    is_far = True

    @property
    def _cosine(self) -> float:
        return math.cos(math.radians(self.angle / 2))

    @property
    def _solid_angle(self) -> float:
        return 4.0 * math.pi * math.sin(math.radians(self.angle / 4)) ** 2

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """See `Light`."""
        n = len(position)
        size = self._solid_angle
        return LightSample(
            disc_cone(pairs, np.array(self.direction), self._cosine),
            np.full(n, np.inf),
            np.broadcast_to(np.array(self.irradiance), (n, 3)),
            np.full(n, 1.0 / size if size > 0 else np.inf),
        )

    def seen(self, origins: Floats, directions: Floats) -> Seen:
        """See `Light`."""
        size = self._solid_angle
        # 1 - cos by the chord: cosines near 1 have no digits to spare.
        chord = np.square(directions - np.array(self.direction)).sum(axis=1)
        inside = (chord <= 4.0 * math.sin(math.radians(self.angle / 4)) ** 2) & (size > 0)
        brightness = np.array(self.irradiance) / max(size, 1e-300)
        return Seen(
            np.where(inside, np.inf, np.nan),
            inside[:, None] * brightness,
            np.where(inside, 1.0 / max(size, 1e-300), 0.0),
        )

    def estimate(self, position: Floats) -> Floats:
        """See `Light`."""
        return np.full(len(position), sum(self.irradiance) / 3)


@dataclass(frozen=True)
class Ball:
    """A ball that shines equally to all sides, or a point. The camera does not see it.

    Attributes
    ----------
    intensity
        Irradiance at distance 1 from its centre.
    radius
        Of the ball; 0 gives sharp shadows.
    """

    position: tuple[float, float, float]
    intensity: tuple[float, float, float]
    radius: float

    @property
    def is_far(self) -> bool:
        """Points are never seen, from nowhere."""
        return not self.radius > 0

    def sample(self, position: Floats, pairs: Floats) -> LightSample:
        """See `Light`. Points of the part that is seen are drawn evenly by solid angle."""
        centre = np.array(self.position) - position
        squared = np.maximum(np.einsum("ij,ij->i", centre, centre), 1e-300)
        distance = np.sqrt(squared)
        axis = centre / distance[:, None]
        irradiance = np.array(self.intensity) / squared[:, None]
        if not self.radius > 0:
            return LightSample(axis, distance, irradiance, np.full(len(distance), np.inf))
        one_less, inside = self._cap(squared)
        z = 1.0 - pairs[:, 0] * one_less
        direction = around(axis, z, pairs[:, 1])
        along = distance * z
        half = np.sqrt(np.maximum(self.radius**2 - squared * (1.0 - z * z), 0.0))
        reach = np.where(inside, along + half, along - half)
        size = 2.0 * math.pi * one_less
        radiance = np.array(self.intensity) / (math.pi * self.radius**2)
        return LightSample(direction, reach, radiance * size[:, None], 1.0 / size)

    def seen(self, origins: Floats, directions: Floats) -> Seen:
        """See `Light`."""
        n = len(origins)
        if not self.radius > 0:
            return Seen(np.full(n, np.nan), np.zeros((n, 3)), np.zeros(n))
        centre = np.array(self.position) - origins
        along = np.einsum("ij,ij->i", centre, directions)
        aside = centre - along[:, None] * directions
        left = self.radius**2 - np.einsum("ij,ij->i", aside, aside)
        squared = np.einsum("ij,ij->i", centre, centre)
        one_less, inside = self._cap(squared)
        half = np.sqrt(np.maximum(left, 0.0))
        reach = np.where(inside, along + half, along - half)
        met = (left > 0) & (reach > 0)
        radiance = np.array(self.intensity) / (math.pi * self.radius**2)
        return Seen(
            np.where(met, reach, np.nan),
            met[:, None] * radiance,
            np.where(met, 1.0 / (2.0 * math.pi * one_less), 0.0),
        )

    def _cap(self, squared: Floats) -> tuple[Floats, Any]:
        """Return 1 - cos of the half angle of the ball, and where one stands inside it."""
        sine = self.radius**2 / np.maximum(squared, 1e-300)
        inside = sine >= 1.0
        cosine = np.sqrt(np.maximum(1.0 - sine, 0.0))
        # sin^2 / (1 + cos) is 1 - cos with all digits.
        return np.where(inside, 2.0, np.minimum(sine, 1.0) / (1.0 + cosine)), inside

    def estimate(self, position: Floats) -> Floats:
        """See `Light`."""
        centre = np.array(self.position) - position
        squared = np.maximum(np.einsum("ij,ij->i", centre, centre), self.radius**2)
        return np.asarray(sum(self.intensity) / 3 / np.maximum(squared, 1e-300))


def make_sun(
    values: Mapping[str, Any], dimmed: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Sun | None:
    """Return the sun of a setting; None if it gives no light.

    Parameters
    ----------
    dimmed
        Part of its light that the air lets through.
    """
    if not values["strength"] > 0:
        return None
    direction = sun_direction(values)
    color = scale_color(values["color"], values["strength"])
    irradiance = color[0] * dimmed[0], color[1] * dimmed[1], color[2] * dimmed[2]
    return Sun(direction, irradiance, float(values["angle"])) if max(irradiance) > 0 else None


def sun_direction(values: Mapping[str, Any]) -> tuple[float, float, float]:
    """Return the unit vector towards the sun of a setting."""
    direction = np.asarray(values["direction"], float)
    if not np.abs(direction).max() > 0:
        raise UsageError("the sun's direction is the zero vector")
    direction = direction / np.abs(direction).max()  # so that no square is beyond the numbers
    direction = direction / np.linalg.norm(direction)
    return float(direction[0]), float(direction[1]), float(direction[2])


def make_balls(several: Sequence[Mapping[str, Any]]) -> list[Ball]:
    """Return the lights of settings ``light {}`` that shine."""
    return [
        Ball(
            scale_color(values["position"], 1.0),
            scale_color(values["color"], values["strength"]),
            float(values["radius"]),
        )
        for values in several
        if values["strength"] > 0
    ]


def scale_color(color: Any, strength: float) -> tuple[float, float, float]:
    """Return a colour of a setting times a number."""
    return float(color[0] * strength), float(color[1] * strength), float(color[2] * strength)
